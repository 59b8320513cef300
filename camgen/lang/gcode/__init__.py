"""Old G-code as an input: motions, outputs and waits that another machine replays.

See docs/inputs/gcode.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import compress

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.gcode.dialects import LINUXCNC, Dialect
from camgen.lang.gcode.machine import Machine
from camgen.lang.gcode.run import run_program
from camgen.lang.programs import Places, RunRequest, rename_outputs
from camgen.lang.recorded import ProgramRun, Recorded, format_box
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job, ToolTable
from camgen.model.limits import Limits
from camgen.model.part import Note
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.model.text import counted, short
from camgen.read.files import Files

_GIVEN: dict[str, float] = {}
#: Codes that need no note, with the reason.
WITHOUT_EFFECT = {
    "M48": "the overrides of the operator are on, as at the start",
    "G8": "how far the controller looks ahead",
    "G103": "how far the controller looks ahead",
    "G15": "polar coordinates are off, as at the start; G16 is not read",
    "G23": "the check of spindle speed, or of stored limits, is off, as at the start",
    "G50": "scaling is off, as at the start; G51 is not read",
    "G50.1": "mirroring is off, as at the start; G51.1 is not read",
    "M17": "the motors of a printer are on, as for any motion",
    "M82": "how filament counts; E that moves is refused",
    "M83": "how filament counts; E that moves is refused",
}


class ProgramFacts(Struct, frozen=True):
    """Summary of a program. Its ``str`` is a page to print.

    lines: number of lines of the text.
    units: "mm" or "inch".
    counts: number of instructions by kind.
    low, high: corners of the box around the motions at feed, mm. Empty without one.
    feeds: lowest and highest feed, mm/s.
    signals: names of the outputs.
    notes: assumptions, warnings and skipped words, each with its line.
    stopped: line and reason of a refusal, empty without one.
    """

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
        rows = [
            f"G-code of {counted(self.lines, 'line')}, units {self.units}",
            f"does: {counts}",
        ]
        if self.low:
            rows.append(f"work: {format_box(self.low, self.high)}")
            rows.append(f"feeds: {short(self.feeds[0], 3)} to {short(self.feeds[1], 3)} mm/s")
        if self.signals:
            rows.append(f"outputs: {', '.join(self.signals)}")
        rows += map(str, self.notes)
        if self.stopped:
            rows.append(f"cannot be replayed: {self.stopped}")
        return "\n".join(rows)


def read(source: Source, job: Job, _files: Files) -> Recorded:
    """Reads the program in ``source``.

    Raises InputError for a line that cannot be replayed and for a program without a motion at feed.
    """
    return read_files([source], job)


def read_files(sources: Sequence[Source], job: Job) -> Recorded:
    """Reads the first of several files as `read` does. The others have its subprograms."""
    name = " + ".join(source.name for source in sources)
    texts = {source.name: _text_of(source) for source in sources}
    place = Places(texts) if len(sources) > 1 else "line {}".format
    run = replay(texts, _make_request(job, sources[0]), job.tolerance.chord)
    if run.stopped:
        line, reason = run.stopped
        what, _, remedy = reason.partition("; ")
        remedy = remedy or "correct the line, or build from the drawing"
        raise InputError(name, what, place(line), remedy)
    if not any(isinstance(item, (MoveL, MoveC)) for item in run.body):
        raise InputError(
            name,
            "holds no motion at feed (G1, G2, G3 or a cycle)",
            remedy="give a program that cuts",
        )
    notes = _note_run(run, place)
    run = replace(run, body=rename_outputs(run.body, job.input.signals, name))
    return Recorded(
        name=sources[0].stem, source=name, units=run.units, contours=(), notes=notes, run=run
    )


def inspect(source: Source, job: Job, _files: Files) -> ProgramFacts:
    """Summarises a program, even one that cannot be replayed to its end.

    Raises InputError if the file is not a text.
    """
    text = _text_of(source)
    run = replay({source.name: text}, _make_request(job, source), job.tolerance.chord)
    columns = Columns(run.body)
    working = ~columns.moves_are(MoveJ)
    points = np.concatenate([columns.ends[working], columns.vias[working]])
    points = points[~np.isnan(points).any(axis=1)]
    speeds = columns.speed[working]
    names: dict[type[Instruction], str] = {
        MoveJ: "rapid motion",
        MoveL: "line",
        MoveC: "arc",
        Output: "output",
        Wait: "wait",
    }
    return ProgramFacts(
        lines=text.count("\n") + (not text.endswith("\n")),
        units=run.units,
        counts={name: int(columns.are(kind).sum()) for kind, name in names.items()},
        low=tuple(points.min(axis=0).tolist()) if len(points) else (),
        high=tuple(points.max(axis=0).tolist()) if len(points) else (),
        feeds=(float(speeds.min()), float(speeds.max())) if len(speeds) else (0.0, 0.0),
        signals=tuple(dict.fromkeys(item.signal for item in columns.list_kinds(Output))),
        notes=_note_run(run, "line {}".format),
        stopped=f"line {run.stopped[0]}: {run.stopped[1]}" if run.stopped else "",
    )


def _make_request(job: Job, source: Source) -> RunRequest:
    """The request of a run from the job: dialect, assumed values, and sizes of tools.

    Cutter compensation needs the diameters of tools. The table [tool] describes tool `tool.number`.
    Without a number, it describes the only tool of a program, if its name or diameter is not the
    default.
    """
    given = {key.lower(): value for key, value in job.input.assume.items()}
    for row in job.tools:
        given |= {f"t{row.number}.diameter": row.diameter, f"t{row.number}.length": row.length}
    tool, default = job.tool, ToolTable()
    if tool.number:
        given.setdefault(f"t{tool.number}.diameter", tool.diameter)
    elif (tool.name, tool.diameter) != (default.name, default.diameter):
        given.setdefault("tool.diameter", tool.diameter)
    if tool.kind == "laser":
        given.setdefault("laser", 1.0)
    if job.operation.compensation == "as-programmed":
        given["compensation"] = 0.0
    return RunRequest(job.input.dialect, given, limits=source.limits)


def _note_run(run: ProgramRun, place: Callable[[int], str]) -> tuple[Note, ...]:
    notes = tuple(replace(note, what=f"{place(line)}: {note.what}") for line, note in run.remarks)
    if run.ended or run.stopped:
        return notes
    why = "neither M2 nor M30 stands in it"
    return (*notes, Note("assumed", "the program ends with its file", why))


def _text_of(source: Source) -> str:
    data = source.data
    if not data.strip() or b"\0" in data:
        what = "is not a text" if data.strip() else "is empty"
        raise InputError(source.name, what, remedy="give a G-code program")
    # A comment may have any byte, in any encoding. The rest is ASCII: one byte is one character.
    return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")


# The run for another machine: its instructions, or the reason of a refusal.


def interpret(
    lines: Sequence[str], given: Mapping[str, float] = _GIVEN, limits: Limits | None = None
) -> ProgramRun:
    """Runs the lines of a program as LinuxCNC does.

    given: values from the user, by name.
    """
    request = RunRequest(assume=given, limits=limits or Limits())
    return replay({"": "\n".join(lines)}, request, None, LINUXCNC)


def replay(
    texts: Mapping[str, str], request: RunRequest, chord: float | None, usual: Dialect | None = None
) -> ProgramRun:
    """Runs the first of ``texts`` for another machine. Never raises for a text.

    The first line that cannot be run, that its controller refuses, or whose effect would be lost
    stops the run.

    chord: deviation of the lines of helices and splines, mm. None: the deviation of the dialect.
    usual: dialect if the request names none. None: the text determines it.
    """
    m, stopped, _ = run_program(texts, request, usual, chord)
    refused = [(item.line, item.what) for item in m.log.list_findings() if item.level == "refused"]
    stops = [*m.log.list_lost(), *([stopped] if stopped else []), *refused]
    reasons = sorted(stops, key=lambda stop: stop[0])
    body, lines = _without_optional_stops(m)
    return ProgramRun(
        body,
        lines,
        _list_remarks(m),
        m.held,
        m.entry,
        next(iter(reasons), None),
        ended=m.ended,
        units="mm" if m.scale == 1.0 else "inch",
    )


def _without_optional_stops(m: Machine) -> tuple[tuple[Instruction, ...], tuple[int, ...]]:
    """The body without M1, which a switch of the machine decides on, and its lines."""
    is_kept = [not _is_optional(item) for item in m.body]
    return tuple(compress(m.body, is_kept)), tuple(compress(m.lines, is_kept))


def _make_note(label: str, what: str) -> Note:
    """The note about a word without a motion.

    label: kind of the word in the facts of ``Executed``.
    """
    if label == "work offset":
        return Note("assumed", f"the origin of {what} is that of the work frame")
    return Note("skipped", what if label == "left out" else f"{what}: {label}")


def _is_optional(item: Instruction) -> bool:
    return isinstance(item, Stop) and item.optional


def _list_remarks(m: Machine) -> tuple[tuple[int, Note], ...]:
    """The assumptions, the findings that stop nothing, and the words left out, by line."""
    remarks = [(item.line, Note("assumed", item.what)) for item in m.log.list_assumed()]
    remarks += [
        (item.line, Note("warning", item.what))
        for item in m.log.list_findings()
        if item.level != "refused"
    ]
    for label, items in m.log.facts.items():
        remarks += [
            (line, _make_note(label, what))
            for what, line in items.items()
            if label != "dialect" and what not in WITHOUT_EFFECT
        ]
    optional = [line for item, line in zip(m.body, m.lines, strict=True) if _is_optional(item)]
    stop = Note("skipped", "M1 stops where the operator wants it", "a program here runs through")
    remarks += [(line, stop) for line in optional[:1]]
    return tuple(sorted(remarks, key=lambda remark: remark[0]))
