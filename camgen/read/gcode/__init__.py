"""Old G-code as an input: its motions, outputs and waits, to be replayed by another machine (docs/inputs/gcode.md)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Output, Wait
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.read.gcode.arcs import LINUXCNC
from camgen.read.gcode.interpreter import ProgramRun, Recorded, interpret


class ProgramFacts(Struct, frozen=True):
    """What is in a program; its ``str`` is a page to print. low, high: the corners of its motions at feed, mm."""

    lines: int
    units: str
    counts: dict[str, int]
    low: tuple[float, ...]
    high: tuple[float, ...]
    feeds: tuple[float, float]
    signals: tuple[str, ...]
    notes: tuple[Note, ...]
    stopped: str

    def __str__(self) -> str:
        counts = ", ".join(counted(n, name) for name, n in self.counts.items())
        spans = zip("xyz", self.low, self.high, strict=False)
        rows = [
            f"G-code of {counted(self.lines, 'line')}, units {self.units}",
            f"does: {counts}",
            *(
                ["work: " + ", ".join(f"{a} {short(b, 3)} to {short(c, 3)}" for a, b, c in spans) + " mm"]
                if self.low
                else []
            ),
            *([f"feeds: {short(self.feeds[0], 3)} to {short(self.feeds[1], 3)} mm/s"] if self.low else []),
            *([f"outputs: {', '.join(self.signals)}"] if self.signals else []),
            *map(str, self.notes),
            *([f"cannot be replayed: {self.stopped}"] if self.stopped else []),
        ]
        return "\n".join(rows)


def read(source: Source, job: Job, _files: Files) -> Recorded:
    """The program in ``source``. InputError for a line that is not replayed, and for a program without a motion."""
    run = _run(_lines(source), source, job)
    if run.stopped:
        line, what = run.stopped
        raise InputError(source.name, what, f"line {line}", "mend the line, or build from the drawing")
    if not any(isinstance(item, (MoveL, MoveC)) for item in run.body):
        raise InputError(
            source.name, "holds no motion at feed (G1, G2, G3 or a cycle)", remedy="give a program that cuts"
        )
    return Recorded(name=source.stem, source=source.name, units=run.units, contours=(), notes=_notes(run), run=run)


def inspect(source: Source, job: Job, _files: Files) -> ProgramFacts:
    """What is in the program, also where it cannot be replayed to its end. InputError if it is no text."""
    lines = _lines(source)
    run = _run(lines, source, job)
    columns = Columns(run.body)
    working = ~columns.moves_are(MoveJ)
    points = np.concatenate([columns.ends[working], columns.vias[working]]) if working.any() else np.zeros((0, 3))
    points = points[~np.isnan(points).any(axis=1)]
    speeds = columns.speed[working]
    names: dict[type[Instruction], str] = {
        MoveJ: "rapid motion", MoveL: "line", MoveC: "arc", Output: "output", Wait: "wait"
    }  # fmt: skip
    return ProgramFacts(
        lines=len(lines) - (lines[-1] == ""),
        units=run.units,
        counts={name: int(columns.are(kind).sum()) for kind, name in names.items()},
        low=tuple(points.min(axis=0).tolist()) if len(points) else (),
        high=tuple(points.max(axis=0).tolist()) if len(points) else (),
        feeds=(float(speeds.min()), float(speeds.max())) if len(speeds) else (0.0, 0.0),
        signals=tuple(dict.fromkeys(item.signal for item in columns.of(Output))),
        notes=_notes(run),
        stopped=f"line {run.stopped[0]}: {run.stopped[1]}" if run.stopped else "",
    )


def _run(lines: Sequence[str], source: Source, job: Job) -> ProgramRun:
    limits = source.limits
    return interpret(lines, replace(LINUXCNC, helix=job.tolerance.chord, pieces=limits.gcode_pieces), limits)


def _notes(run: ProgramRun) -> tuple[Note, ...]:
    notes = tuple(replace(note, what=f"line {line}: {note.what}") for line, note in run.remarks)
    if run.ended or run.stopped:
        return notes
    return (*notes, Note("assumed", "the program ends with its file", "neither M2 nor M30 stands in it"))


def _lines(source: Source) -> list[str]:
    data = source.data
    if not data.strip() or b"\0" in data:
        raise InputError(
            source.name, "is empty" if not data.strip() else "is not a text", remedy="give a G-code program"
        )
    # Comments may hold any byte; nothing else in a program does, so each byte is a character.
    return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
