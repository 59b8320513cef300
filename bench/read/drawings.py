"""Reads every drawing of a folder and compares its length with the measured one.

    python -m bench.read.drawings [FOLDER]

FOLDER holds ``truth.jsonl`` and ``dxf/`` (default: ``shared/data`` beside the repository). The
measured length counts double lines twice.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import camgen
from bench.render.shapes import pieces, to_loops
from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, read_words, run
from bench.support.timing import timed
from camgen.read import dxf
from camgen.read.files import Files
from camgen.read.units import INSUNITS, MM

COLUMNS = "file | used | skipped | repaired, assumed, warned | verdict"
TOLERANCE = 0.005
KNOWN = {
    "arrayed-holes.dxf": ": measured without the block array, which holds the outline and 14 holes",
    "duplicate_handles.dxf": ": measured without 2 of the 111 lines, whose handles are used twice",
}


def measure_length(contour: camgen.Contour) -> float:
    """Arc length, mm."""
    lengths = pieces(to_loops([contour])).length
    return float(lengths.sum() if contour.closed else lengths[:-1].sum())


def compare_length(part: camgen.Part, truth: dict[str, object]) -> str:
    """The verdict on the length of all contours."""
    total = truth.get("visible_exact") or truth.get("total_exact")
    if not isinstance(total, int | float) or not total:
        return "no measured length"
    code = truth.get("insunits" if truth.get("binary") else "insunits_raw")
    expected = total * MM[INSUNITS.get(code if isinstance(code, int) else 0, "mm")]
    share = sum(map(measure_length, part.contours)) / expected - 1
    if abs(share) <= TOLERANCE:
        return f"ok, {100 * share:+.3f} %"
    twice = [n.what for n in part.notes if "drawn twice" in n.why]
    if twice and share < 0:
        return f"{100 * share:+.2f} %: {'; '.join(twice)} as drawn twice"
    known = KNOWN.get(part.source)
    differs = f"DIFFERS {100 * share:+.2f} %"
    return Missed(differs) if known is None else f"{differs}{known}"


def measure(path: Path, truth: dict[str, object]) -> Iterator[Cells]:
    """The row of a drawing."""
    name = f"{path.parent.name}/{path.name}"
    try:
        part, seconds = timed(partial(dxf.read, Files().read(path), camgen.Job(), Files()))
    except camgen.CamgenError as error:
        yield name, *"---", f"refused: {error}"
        return
    closed = sum(c.closed for c in part.contours)
    used = f"{closed} closed, {len(part.contours) - closed} open, {part.units}, {seconds:.2f} s"
    notes: dict[bool, list[str]] = {True: [], False: []}
    for note in part.notes:
        if note.kind in ("skipped", "repaired", "joined", "assumed", "warning"):
            notes[note.kind == "skipped"].append(f"{note.what} ({note.why})")
    skipped, repaired = "; ".join(notes[True]), "; ".join(notes[False])
    yield name, used, skipped or "-", repaired or "-", compare_length(part, truth)


def read_truth(folder: Path) -> dict[str, dict[str, object]]:
    """The measured facts of each file of a folder, by its name."""
    lines = (folder / "truth.jsonl").read_text().splitlines()
    entries = [json.loads(line) for line in lines]
    return {entry["file"]: entry for entry in entries if "file" in entry}


if __name__ == "__main__":
    (folder,) = read_words(SHARED)
    truth = read_truth(folder)
    files = find_files(folder / "dxf", (".dxf",))
    inputs = [(path, truth.get(str(path.relative_to(folder)), {})) for path in files]
    sys.exit(run(Scenario(COLUMNS, inputs, measure)))
