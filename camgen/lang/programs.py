"""What a program does that somebody else wrote, whatever its language: one type that all interpreters return.

A language is found through the entry points ``camgen.languages``; the name is that of the post whose controller speaks
it. ``verify`` judges by it, and ``build`` posts what it says anew for another controller.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import EntryPoint
from typing import Any, Literal

from msgspec import Struct, field
from msgspec.structs import replace

from camgen.model.contract import (
    Member,
    be,
    be_all,
    be_between,
    be_body,
    be_callable,
    be_each,
    be_struct,
    be_text,
    be_words,
    check_value,
    find_wrong_lines,
)
from camgen.model.errors import InputError
from camgen.model.limits import Limits
from camgen.model.plugins import entries, find, load
from camgen.model.pose import Pose
from camgen.model.program import Instruction, Output
from camgen.model.text import counted, grouped

LANGUAGES = "camgen.languages"

#: What a controller turns down or what ends it; what it takes and may do harm; what it takes and few would write.
Level = Literal["refused", "dangerous", "unusual"]
#: The gravest first.
LEVELS: tuple[Level, ...] = ("refused", "dangerous", "unusual")


#: The byte order mark of UTF-8, as a character and as its bytes in Latin-1; and those of UTF-16.
_MARKS, _WIDE_MARKS = ("\ufeff", "\xef\xbb\xbf"), (b"\xff\xfe", b"\xfe\xff")


def strip_mark(text: str) -> str:
    """The text without a byte order mark at its beginning."""
    for mark in _MARKS:
        text = text.removeprefix(mark)
    return text


def find_text_fault(data: bytes) -> str:
    """The reason why the bytes of a file cannot be read as text, empty without one."""
    if data.startswith(_WIDE_MARKS):
        return "is UTF-16, which no controller reads"
    if b"\0" in data:
        return "is not a text"
    return "" if data.strip() else "is empty"


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


def carry_pose(pose: Pose, then: Frames, now: Frames) -> Pose | None:
    """A pose of one tool in one work object as the pose of another tool in another, with the arm in the same place.

    None if a frame is not known.
    """
    flange = pose
    if then.tool != now.tool or then.flange_from_tool is not now.flange_from_tool:
        if then.flange_from_tool is None or now.flange_from_tool is None:
            return None
        flange = pose @ then.flange_from_tool.inverse() @ now.flange_from_tool
    if then.work == now.work and then.base_from_work is now.base_from_work:
        return flange
    if then.base_from_work is None or now.base_from_work is None:
        return None
    return now.base_from_work.inverse() @ then.base_from_work @ flange


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
    """The effect of a program that is run once.

    body: (N) motions to poses in the work frame in force or to joint values, outputs, waits, stops.
    lines: (N) line of each instruction, from 1 through all files.
    frames: frames that are used, in order.
    frame: (N) index in `frames` of the frames in force, empty if there is at most one.
    findings: findings in order of line.
    assumed: assumptions in order of line, each once.
    facts: label and text of facts that move nothing.
    lost: line and text of effects without which no other machine may run the body.
    omitted: line and text of effects that another machine does without, such as accelerations.
    stopped: line and reason where the run ended too early, None if it ended as the text says.
    """

    body: Sequence[Instruction]
    lines: tuple[int, ...]
    frames: tuple[Frames, ...] = ()
    frame: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    lost: tuple[tuple[int, str], ...] = ()
    omitted: tuple[tuple[int, str], ...] = ()
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
    return _load(find(entries(LANGUAGES), name, "language", "camgen posts lists them"))


def list_languages() -> list[Language]:
    """All that are installed, by name."""
    return [_load(entry) for entry in entries(LANGUAGES)]


def _load(entry: EntryPoint) -> Language:
    """The language of an entry point; what its `run` returns is checked each time."""
    language: Any = load(entry)
    plug_in = f"language {entry.name}"
    check_value(plug_in, _LANGUAGE, language, _REMEDY)
    run = CheckedRun(plug_in, language.run)
    return replace(language, run=run)  # type: ignore[no-any-return]


class CheckedRun(Struct, frozen=True):
    """The interpreter of a language, whose result is checked.

    plug_in: the language, for the message.
    run: the function of the plug-in.
    """

    plug_in: str
    run: Callable[[Mapping[str, str], Ask], Executed]

    def __call__(self, files: Mapping[str, str], ask: Ask) -> Executed:
        """Runs the program. Raises JobError for a result that is not an Executed."""
        executed: Any = self.run(files, ask)
        check_value(self.plug_in, _RUN, executed, _REMEDY)
        return executed  # type: ignore[no-any-return]


_REMEDY = "correct or remove its package"
_TEXT = be(str, "a text")
_SUFFIX = be_text(lambda text: text[:1] == "." and text == text.lower(), "a lower-case file ending")
_LANGUAGE = Member(
    "the entry point",
    be_struct(
        Language,
        {
            "name": be_text(str.strip, "a name"),
            "about": be_text(str.strip, "a line of text"),
            "suffixes": be_each(tuple, _SUFFIX, "a tuple of file endings"),
            "recognise": be_callable,
            "run": be_callable,
            "dialects": be_each(tuple, _TEXT, "a tuple of names"),
            "takes": be_words(tuple, ("entry", "points"), "a tuple of words"),
        },
    ),
)
_LINE = be_between(0)
_FINDING = be_struct(
    Finding, {"level": be_text(LEVELS.__contains__, "a level"), "line": _LINE, "what": _TEXT}
)
_ASSUMPTION = be_struct(Assumption, {"line": _LINE, "what": _TEXT, "key": _TEXT})
_EXECUTED = {
    "body": be_body,
    "lines": be(tuple, "a tuple of line numbers"),
    "frames": be_each(tuple, be(Frames, "Frames"), "a tuple of Frames"),
    "frame": be(tuple, "a tuple of places in frames"),
    "findings": be_each(tuple, _FINDING, "a tuple of Finding"),
    "assumed": be_each(tuple, _ASSUMPTION, "a tuple of Assumption"),
    "facts": be(tuple, "a tuple of pairs of texts"),
    "lost": be(tuple, "a tuple of lines with texts"),
    "omitted": be(tuple, "a tuple of lines with texts"),
}


def _find_wrong_lines(executed: Executed) -> str:
    size = len(executed.body)
    fault = find_wrong_lines(executed.lines, size)
    if fault:
        return f"has lines that {fault}"
    if executed.frame and len(executed.frame) != size:
        return f"has {len(executed.frame)} places of frames for {counted(size, 'instruction')}"
    if executed.frame and max(executed.frame) >= len(executed.frames):
        return "has a place of a frame that is not there"
    return ""


_RUN = Member("run()", be_all(be_struct(Executed, _EXECUTED), _find_wrong_lines))


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
