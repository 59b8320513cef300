"""The summary of a build: one line each for what was read, left out, planned, proved and written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from camgen.cli_say import counted, duration, grouped, length, listed, size
from camgen.job import Result
from camgen.report import path_sums
from camgen.shapes import Note, NoteKind

Row = tuple[str, str, str]

#: Notes in the order in which they are told, with their tone.
_TONES: dict[NoteKind, str] = {
    "joined": "plain",
    "repaired": "plain",
    "assumed": "look",
    "warning": "look",
    "skipped": "look",
}
#: So many notes of a kind are told; -v tells all.
_NOTES = 8


def rows(
    result: Result, job: Path | None, inputs: Sequence[Path], programs: Sequence[tuple[Path, bytes]], verbose: int
) -> list[Row]:
    """Label, text and tone of every line."""
    return [
        ("input", _input(result), "plain"),
        *_job(job, inputs),
        *_notes(result.notes, verbose),
        *_planned(result),
        ("cell", _cell(result), "look"),
        ("time", f"about {duration(result.motions.seconds)}", "plain"),
        *(_program(path, data, result.post.newline) for path, data in programs),
        ("verified", _verified(result), "good"),
    ]


def _cell(result: Result) -> str:
    if result.reach is None:
        return f"{result.cell.name}; reach, collision and limits not checked: no robot model"
    samples = grouped(result.reach.samples)
    found = f"{result.reach.robot} reaches all of it within its limits, in a posture that the text does not state"
    return f"{found} ({samples} poses); collisions not checked"


def _input(result: Result) -> str:
    contours = result.part.contours
    closed = sum(c.closed for c in contours)
    layers = sorted({c.layer for c in contours})
    shapes = f"{counted(len(contours), 'contour')} ({grouped(closed)} closed, {grouped(len(contours) - closed)} open)"
    noun = "layer" if len(layers) == 1 else "layers"
    return f"{result.part.source}: {result.part.units}, {shapes}, {noun} {listed(layers)}"


def _job(job: Path | None, inputs: Sequence[Path]) -> list[Row]:
    """Which job file was used; a second input's own one is not, which the user may not expect."""
    found: list[Row] = [("job", f"{job}", "plain")] if job else []
    others = [path for path in (one.with_suffix(".toml") for one in inputs[1:]) if path.is_file() and path != job]
    return found + [("warning", f"{path} is not used: one job goes for all inputs", "look") for path in others]


def _notes(notes: Sequence[Note], verbose: int) -> list[Row]:
    told: list[Row] = []
    for kind, tone in _TONES.items():
        own = [note for note in notes if note.kind == kind]
        shown = own if verbose else own[:_NOTES]
        told += [(kind, note.what + (f" ({note.why})" if note.why else ""), tone) for note in shown]
        if len(own) > len(shown):
            told.append((kind, f"and {grouped(len(own) - len(shown))} more (-v shows all, --report lists them)", tone))
    return told


def _planned(result: Result) -> list[Row]:
    work = math.fsum(path_sums(result.tour.paths)[0].tolist())
    travel = result.tour.travel
    return [
        ("plan", f"{counted(len(result.tour.paths), 'path')}, work {length(work)}", "plain"),
        ("tour", f"{result.tour.method}: work {length(work)}, travel {length(travel)}", "plain"),
    ]


def _program(path: Path, data: bytes, newline: str) -> Row:
    lines = data.count(newline.encode())
    return ("program", f"{path}, {counted(lines, 'line')}, {size(len(data))}", "plain")


def _verified(result: Result) -> str:
    compared = counted(result.deviation.instructions, "instruction")
    return f"read back, {compared} equal, largest deviation {result.deviation.max_mm:.6f} mm"
