"""Runs an old program for another machine: its instructions, or the reason of a refusal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from camgen.lang.gcode.dialects import LINUXCNC, Dialect
from camgen.lang.gcode.machine import Machine
from camgen.lang.gcode.run import run_program
from camgen.lang.programs import RunRequest
from camgen.lang.recorded import ProgramRun
from camgen.model.limits import Limits
from camgen.model.part import Note
from camgen.model.program import Instruction, Stop

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
    kept = [
        (item, line) for item, line in zip(m.body, m.lines, strict=True) if not _is_optional(item)
    ]
    return tuple(item for item, _ in kept), tuple(line for _, line in kept)


def _make_note(label: str, what: str) -> Note:
    """The note about a word without a motion.

    label: kind of the word in the facts of ``Executed``.
    """
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
    why = "a program here runs through"
    stop = Note("skipped", "M1 stops where the operator wants it", why)
    remarks += [(line, stop) for line in optional[:1]]
    return tuple(sorted(remarks, key=lambda remark: remark[0]))
