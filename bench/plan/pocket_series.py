"""Sixty pockets of real drawings: python -m bench.plan.pocket_series [FOLDER] [COUNT, 60]

The rule. Each closed contour of every DXF drawing in FOLDER is a candidate: the area between it and
the closed contours directly within it. Candidates are taken in the order of the SHA-256 of their
drawing's path and their number, four of one drawing at most, and moved to the origin. The tool is
drawn by that hash from those of 1, 1.5, 2, 3, 4, 5, 6, 8, 10 and 12 mm that are at most half as
wide as the contour's narrower side, and at least a hundredth of its longer side. A candidate is
left out, and the next one takes its place, if there is no such tool, if the drawing is not read, or
if camgen leaves the contour out with a note that names it. Each other one is built as a G-code
program of two passes, 2 mm deep.

Told are the refusals of the stock proof and of the other proofs, exceptions, gouges by a sweep of
the text (`bench.support.swept_text`), and seconds. Goals: none of each. Exits with 1 if one is
missed.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

import camgen
from bench.support.runner import SHARED, Missed, Table, open_table
from bench.support.swept_text import cleared, read_cut
from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import make_contour_segments
from tests.support.swept import enclosed

TOOLS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0)
DEPTH = 2.0
#: Candidates of one drawing that are built, at most.
_OF_ONE = 4
COLUMNS = "drawing | contour | tool mm {:g} | mm {:.0f} | gouged mm2 {:.4f} | s {:.1f} | "
#: Gouge that counts, mm2, beyond 0.006 mm of the walls: a place is printed in thousandths.
_GOUGE, _BESIDE = 1e-3, 0.006


class Candidate(NamedTuple):
    """A closed contour of a drawing.

    key: hash that gives its place in the order.
    drawing: path of the drawing in the folder.
    number: place of the contour among the closed ones.
    contours: the contour, and those directly within it.
    """

    key: str
    drawing: str
    number: int
    contours: tuple[camgen.Contour, ...]


def candidates(folder: Path, left_out: Counter[str]) -> list[Candidate]:
    """All candidates of the drawings in a folder, in order. left_out: counts drawings not read."""
    listed: list[Candidate] = []
    for file in sorted(folder.rglob("*")):
        if file.suffix.lower() != ".dxf":
            continue
        name = file.relative_to(folder).as_posix()
        try:
            part = camgen.read(file)
        except camgen.CamgenError:
            left_out["drawing not read"] += 1
            continue
        closed = [contour for contour in part.contours if contour.closed]
        nesting = find_nesting(make_contour_segments(closed), len(closed))
        for number, contour in enumerate(closed):
            inner = np.flatnonzero(nesting.parent == number).tolist()
            key = hashlib.sha256(f"{name}:{number}".encode()).hexdigest()
            corner = contour.points.min(axis=0)
            members = [
                replace(closed[k], points=closed[k].points - corner) for k in (number, *inner)
            ]
            listed.append(Candidate(key, name, number, tuple(members)))
    return sorted(listed, key=lambda candidate: candidate.key)


def choose_tool(candidate: Candidate) -> float | None:
    """The diameter of the tool, mm; None if no usual one fits."""
    sides = sorted(np.ptp(candidate.contours[0].points, axis=0).tolist())
    fit = [tool for tool in TOOLS if sides[1] / 100 <= tool <= sides[0] / 2]
    return fit[int(candidate.key[:8], 16) % len(fit)] if fit else None


def build(candidate: Candidate, tool: float) -> tuple[str, float, float]:
    """The refusal of a candidate, "" for a program; the length of its cuts, mm, and gouge, mm2.

    "left out" begins the reason for which another one takes its place.
    """
    part = camgen.Part("pocket", candidate.drawing, "mm", candidate.contours, ())
    job: dict[str, Any] = {
        "tool": {"diameter": tool},
        "operation": {"kind": "pocket", "depth": DEPTH, "passes": 2, "entry": "helix"},
        "process": {"spindle": 12000.0},
    }
    try:
        text = camgen.build(part, post="gcode", job=job).text
    except camgen.NoSafeProgram as error:
        reason = str(error)
        if "no path is left" in reason:
            return f"left out: {reason.rpartition(': ')[2]}", 0.0, 0.0
        return f"stock: {reason}", 0.0, 0.0
    except camgen.CamgenError as error:
        return f"{type(error).__name__}: {error}", 0.0, 0.0
    except Exception as error:  # any is a defect
        return f"exception {type(error).__name__}: {error}", 0.0, 0.0
    motions = read_cut(text)
    region = enclosed(candidate.contours)
    swept = cleared(motions, tool / 2, -DEPTH)
    gouged = swept.difference(region.buffer(_BESIDE)).area
    return "", sum(motion.length for motion in motions), gouged


def rows(folder: Path, count: int, left_out: Counter[str]) -> Iterator[tuple[object, ...]]:
    """A row for each pocket that is built or refused."""
    done: Counter[str] = Counter()
    for candidate in candidates(folder, left_out):
        if done[candidate.drawing] == _OF_ONE:
            continue
        tool = choose_tool(candidate)
        if tool is None:
            left_out["no usual tool fits"] += 1
            continue
        start = time.perf_counter()
        refusal, length, gouged = build(candidate, tool)
        seconds = time.perf_counter() - start
        if refusal.startswith("left out"):
            left_out["left out by camgen with a note"] += 1
            continue
        is_met = not refusal and gouged <= _GOUGE
        cells = (candidate.drawing, candidate.number, tool, length, gouged, seconds)
        yield *cells, "ok" if is_met else Missed(f"**missed** {refusal}")
        done[candidate.drawing] += 1
        if done.total() == count:
            return


def main(words: list[str]) -> int:
    """Prints the table, and how many candidates were left out; 1 if a goal is missed."""
    folder = Path(words[0]) if words else SHARED / "dxf"
    table: Table = open_table(COLUMNS)
    left_out: Counter[str] = Counter()
    for row in rows(folder, int(words[1]) if len(words) > 1 else 60, left_out):
        table.add(*row)
    for reason, number in sorted(left_out.items()):
        print(f"\n{number}: {reason}")
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
