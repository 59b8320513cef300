"""What of an old program another machine may run: all that it does, or why not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from camgen.model.limits import Limits
from camgen.model.part import Note
from camgen.model.program import Instruction, Stop
from camgen.read.gcode.dialects import LINUXCNC, Dialect
from camgen.read.gcode.foreign import Foreign
from camgen.read.gcode.language import play
from camgen.read.programs import Ask
from camgen.read.recorded import ProgramRun

_GIVEN: dict[str, float] = {}


def interpret(
    lines: Sequence[str], given: Mapping[str, float] = _GIVEN, limits: Limits | None = None
) -> ProgramRun:
    """What the lines of a program do, as LinuxCNC runs them. given: what the user says that no text holds."""
    ask = Ask(assume=given, limits=limits or Limits())
    return replay({"": "\n".join(lines)}, ask, None, LINUXCNC)


def replay(
    texts: Mapping[str, str], ask: Ask, chord: float | None, usual: Dialect | None = None
) -> ProgramRun:
    """What the first of ``texts`` does, to be run by another machine. chord: of the lines of helices, mm. usual: the
    dialect where ``ask`` names none, None: what the text shows. Never raises for a text.

    It is stopped by the first of what cannot be run, what its controller refuses, and what would be lost.
    """
    m, stopped = play(texts, ask, usual, chord)
    refused = [(one.line, one.what) for one in m.findings if one.level == "refused"]
    lost = [(line, what) for what, line in m.lost.items()]
    reasons = sorted([*lost, *([stopped] if stopped else []), *refused], key=lambda one: one[0])
    body, lines = _without_optional_stops(m)
    return ProgramRun(
        body,
        lines,
        _remarks(m),
        m.held,
        m.entry,
        reasons[0] if reasons else None,
        unread=False,
        ended=m.ended,
        units="mm" if m.scale == 1.0 else "inch",
    )


def _without_optional_stops(m: Foreign) -> tuple[tuple[Instruction, ...], tuple[int, ...]]:
    """The body without M1, which a switch of the machine decides on, and its lines."""
    kept = [
        (item, line) for item, line in zip(m.body, m.lines, strict=True) if not _is_optional(item)
    ]
    return tuple(item for item, _ in kept), tuple(line for _, line in kept)


def _is_optional(item: Instruction) -> bool:
    return isinstance(item, Stop) and item.optional


def _remarks(m: Foreign) -> tuple[tuple[int, Note], ...]:
    """What was assumed, what is wrong and does not hinder, and what is left out and moves nothing, by line."""
    found = [(one.line, Note("assumed", one.what)) for one in m.assumed.values()]
    found += [(one.line, Note("warning", one.what)) for one in m.findings if one.level != "refused"]
    found += [(line, Note("skipped", what)) for what, line in m.facts.get("left out", {}).items()]
    optional = [line for item, line in zip(m.body, m.lines, strict=True) if _is_optional(item)]
    why = "a program here runs through"
    found += [
        (line, Note("skipped", "M1 stops where the operator wants it", why))
        for line in optional[:1]
    ]
    return tuple(sorted(found, key=lambda one: one[0]))
