"""Old G-code as an input: its motions, outputs and waits, to be replayed by another machine (docs/inputs/gcode.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.gcode.replayed import replay
from camgen.lang.programs import Ask, Places, rename_outputs
from camgen.lang.recorded import ProgramRun, Recorded
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job, ToolTable
from camgen.model.part import Note
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Output, Wait
from camgen.model.text import counted, short
from camgen.read.files import Files


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
                [
                    "work: "
                    + ", ".join(f"{a} {short(b, 3)} to {short(c, 3)}" for a, b, c in spans)
                    + " mm"
                ]
                if self.low
                else []
            ),
            *(
                [f"feeds: {short(self.feeds[0], 3)} to {short(self.feeds[1], 3)} mm/s"]
                if self.low
                else []
            ),
            *([f"outputs: {', '.join(self.signals)}"] if self.signals else []),
            *map(str, self.notes),
            *([f"cannot be replayed: {self.stopped}"] if self.stopped else []),
        ]
        return "\n".join(rows)


def read(source: Source, job: Job, _files: Files) -> Recorded:
    """The program in ``source``. InputError for a line that is not replayed, and for a program without a motion."""
    return read_files([source], job)


def read_files(sources: Sequence[Source], job: Job) -> Recorded:
    """The program in the first of several files, as ``read`` does it; the others hold its subprograms."""
    name = " + ".join(source.name for source in sources)
    texts = {source.name: _text_of(source) for source in sources}
    place = Places(texts) if len(sources) > 1 else "line {}".format
    run = replay(texts, _ask(job, sources[0]), job.tolerance.chord)
    if run.stopped:
        line, reason = run.stopped
        what, _, remedy = reason.partition("; ")
        raise InputError(
            name, what, place(line), remedy or "mend the line, or build from the drawing"
        )
    if not any(isinstance(item, (MoveL, MoveC)) for item in run.body):
        raise InputError(
            name,
            "holds no motion at feed (G1, G2, G3 or a cycle)",
            remedy="give a program that cuts",
        )
    notes = _notes(run, place)
    run = replace(run, body=rename_outputs(run.body, job.input.signals, name))
    return Recorded(
        name=sources[0].stem, source=name, units=run.units, contours=(), notes=notes, run=run
    )


def inspect(source: Source, job: Job, _files: Files) -> ProgramFacts:
    """What is in the program, also where it cannot be replayed to its end. InputError if it is no text."""
    text = _text_of(source)
    run = replay({source.name: text}, _ask(job, source), job.tolerance.chord)
    columns = Columns(run.body)
    working = ~columns.moves_are(MoveJ)
    points = (
        np.concatenate([columns.ends[working], columns.vias[working]])
        if working.any()
        else np.zeros((0, 3))
    )
    points = points[~np.isnan(points).any(axis=1)]
    speeds = columns.speed[working]
    names: dict[type[Instruction], str] = {
        MoveJ: "rapid motion", MoveL: "line", MoveC: "arc", Output: "output", Wait: "wait"
    }  # fmt: skip
    return ProgramFacts(
        lines=text.count("\n") + (not text.endswith("\n")),
        units=run.units,
        counts={name: int(columns.are(kind).sum()) for kind, name in names.items()},
        low=tuple(points.min(axis=0).tolist()) if len(points) else (),
        high=tuple(points.max(axis=0).tolist()) if len(points) else (),
        feeds=(float(speeds.min()), float(speeds.max())) if len(speeds) else (0.0, 0.0),
        signals=tuple(dict.fromkeys(item.signal for item in columns.of(Output))),
        notes=_notes(run, "line {}".format),
        stopped=f"line {run.stopped[0]}: {run.stopped[1]}" if run.stopped else "",
    )


def _ask(job: Job, source: Source) -> Ask:
    """What the job says of a program: its dialect, what no text holds, and the tools, whose radii compensation needs.

    [tool] is that of a program with one tool where it is said which: by its number, its name or its diameter.
    """
    given = {key.lower(): value for key, value in job.input.assume.items()}
    for row in job.tools:
        given |= {f"t{row.number}.diameter": row.diameter, f"t{row.number}.length": row.length}
    own, usual = job.tool, ToolTable()
    if own.number:
        given.setdefault(f"t{own.number}.diameter", own.diameter)
    elif (own.name, own.diameter) != (usual.name, usual.diameter):
        given.setdefault("tool.diameter", own.diameter)
    if own.kind == "laser":
        given.setdefault("laser", 1.0)
    if job.operation.compensation == "as-programmed":
        given["compensation"] = 0.0
    return Ask(job.input.dialect, given, limits=source.limits)


def _notes(run: ProgramRun, place: Callable[[int], str]) -> tuple[Note, ...]:
    notes = tuple(replace(note, what=f"{place(line)}: {note.what}") for line, note in run.remarks)
    if run.ended or run.stopped:
        return notes
    return (
        *notes,
        Note("assumed", "the program ends with its file", "neither M2 nor M30 stands in it"),
    )


def _text_of(source: Source) -> str:
    data = source.data
    if not data.strip() or b"\0" in data:
        raise InputError(
            source.name,
            "is empty" if not data.strip() else "is not a text",
            remedy="give a G-code program",
        )
    # Comments may hold any byte; nothing else in a program does, so each byte is a character.
    return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
