"""What a program does that somebody else wrote, whatever its language: one type that all interpreters return.

A language is found through the entry points ``camgen.languages``; the name is that of the post whose controller speaks
it. ``verify`` judges by it, and ``build`` posts what it says anew for another controller.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from msgspec import Struct, field

from camgen.model.errors import InputError
from camgen.model.limits import Limits
from camgen.model.plugins import entries, find, load
from camgen.model.pose import Pose
from camgen.model.program import Instruction, Output
from camgen.model.text import grouped

LANGUAGES = "camgen.languages"

#: What a controller turns down or what ends it; what it takes and may do harm; what it takes and few would write.
Level = Literal["refused", "dangerous", "unusual"]
#: The gravest first.
LEVELS: tuple[Level, ...] = ("refused", "dangerous", "unusual")


class Finding(Struct, frozen=True):
    """Something about a line of a program. line: 1-based, counted through all files in order. what: with its reason."""

    level: Level
    line: int
    what: str


class Frames(Struct, frozen=True, eq=False):
    """The tool and the work object in force, by the names that the text gives them, "" where it names none.

    flange_from_tool, base_from_work: None where the text does not say them.
    """

    tool: str = ""
    work: str = ""
    flange_from_tool: Pose | None = None
    base_from_work: Pose | None = None


class Assumption(Struct, frozen=True):
    """What a program asked for that no text holds, and what was taken: an input, a wait, a question to the operator.

    key: what the user says to set it otherwise (``--assume key=value``), "" where it cannot be set.
    """

    line: int
    what: str
    key: str = ""
    value: float = 0.0


class Ask(Struct, frozen=True):
    """What the user says of a program. dialect: of the language, "" its own. assume: values by name in lower case, of
    inputs and whatever else no text holds. points: files of locations by name. entry: where it begins, "" as usual.
    flange: base_from_flange of the arm that the program is for, from its joint values (rad, mm), None for another
    number of them; without it nobody knows where joint values lead.
    """

    dialect: str = ""
    assume: Mapping[str, float] = field(default_factory=dict)
    points: Mapping[str, str] = field(default_factory=dict)
    entry: str = ""
    limits: Limits = Limits()
    flange: Callable[[Sequence[float]], Pose | None] | None = None


class Executed(Struct, frozen=True, eq=False):
    """What a program does when it is run once.

    body: (N) motions to poses in the work frame in force or to joint values, outputs, waits, stops. lines: (N) 1-based,
    counted through all files. frames: those used, in order; frame: (N) the place in ``frames`` of those in force, empty
    where there is at most one. findings: in order of line. assumed: likewise, each told once. facts: label and text
    of what else stands in the program and moves nothing. lost: line and text of what the program does and the body
    does not: what was left out, or stands for what nobody knows; no other machine runs such a body. stopped: line and
    reason where it could not be run to its end.
    """

    body: Sequence[Instruction]
    lines: tuple[int, ...]
    frames: tuple[Frames, ...] = ()
    frame: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    lost: tuple[tuple[int, str], ...] = ()
    stopped: tuple[int, str] | None = None


class Language(Struct, frozen=True):
    """One language of controllers. suffixes: in small letters, with the dot. dialects: the names that ``Ask.dialect``
    takes. recognise: whether the beginning of a text is surely in this language. run: what its files say, by name in
    order, LF line ends; never raises for a text. takes: which of ``entry`` and ``points`` it heeds.
    """

    name: str
    about: str
    suffixes: tuple[str, ...]
    recognise: Callable[[str], bool]
    run: Callable[[Mapping[str, str], Ask], Executed]
    dialects: tuple[str, ...] = ()
    takes: tuple[str, ...] = ("entry",)


def find_language(name: str) -> Language:
    """The language of the controller that the post ``name`` writes for. JobError if none is installed."""
    return load(find(entries(LANGUAGES), name, "language", "camgen posts lists them"))  # type: ignore[return-value]


def list_languages() -> list[Language]:
    """All that are installed, by name."""
    return [load(entry) for entry in entries(LANGUAGES)]  # type: ignore[misc]


def rename_outputs(
    body: Sequence[Instruction], names: Mapping[str, str], file: str
) -> tuple[Instruction, ...]:
    """The body with other names for its outputs. InputError for a name that it does not switch. file: for messages."""
    used = dict.fromkeys(item.signal for item in body if isinstance(item, Output))
    for name in names:
        if name not in used:
            known = ", ".join(used) or "none"
            raise InputError(
                file, f"switches no output {name!r}", "input.signals", f"it switches {known}"
            )
    return tuple(
        Output(names[item.signal], item.value)
        if isinstance(item, Output) and item.signal in names
        else item
        for item in body
    )


class Places:
    """Where the lines of a program are, which are counted from 1 through all its files."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._names = list(texts)
        self._last = list(
            itertools.accumulate(
                text.count("\n") + (not text.endswith("\n")) for text in texts.values()
            )
        )

    def __call__(self, line: int) -> str:
        """File and line."""
        k = bisect_left(self._last, line)
        if k == len(self._names):
            return f"line {line}"
        return f"{self._names[k]} line {grouped(line - (self._last[k - 1] if k else 0))}"
