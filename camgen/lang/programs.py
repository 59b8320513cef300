"""The contract of a language: the request and the result of a run, and how camgen checks them.

A language is found through the entry points `camgen.languages`. Its name is that of the post whose
controller speaks it. It has one function, `Language.run`, for three uses:

- read-back: `build` runs each program that a post has written, strictly (`RunRequest.options`)
- `verify` runs a program of any author and lists its findings
- `translate` posts the motions of a program for another controller

`docs/writing-a-post.md` writes a language step by step.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.metadata import EntryPoint
from types import NoneType
from typing import Any, Literal

from msgspec import Struct, field
from msgspec.structs import replace

from camgen.lang.coverage import Coverage
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
from camgen.model.plugins import find, list_entries, load
from camgen.model.pose import Pose
from camgen.model.program import Instruction, Output
from camgen.model.text import counted, grouped

LANGUAGES = "camgen.languages"

#: The controller refuses the line; it may do harm; it is one of these only if something is so that
#: the text does not determine; few programs have such a line.
Level = Literal["refused", "dangerous", "possible", "unusual"]
#: The worst level first.
LEVELS: tuple[Level, ...] = ("refused", "dangerous", "possible", "unusual")
#: The levels that rest on nothing assumed.
CERTAIN: tuple[Level, ...] = ("refused", "dangerous")


#: The byte order mark of UTF-8, as a character and as its bytes in Latin-1; and those of UTF-16.
_MARKS, _WIDE_MARKS = ("\ufeff", "\xef\xbb\xbf"), (b"\xff\xfe", b"\xfe\xff")


def strip_mark(text: str) -> str:
    """The text without a byte order mark at its beginning."""
    for mark in _MARKS:
        text = text.removeprefix(mark)
    return text


def unify_line_ends(text: str) -> str:
    """The text with LF line ends."""
    # A search takes a tenth of the time of two replacements.
    if "\r" not in text:
        return text
    return text.replace("\r\n", "\n").replace("\r", "\n")


def find_text_fault(data: bytes) -> str:
    """The reason why the bytes of a file cannot be read as text, empty without one."""
    if data.startswith(_WIDE_MARKS):
        return "is UTF-16, which no controller reads"
    if b"\0" in data:
        return "is not a text"
    return "" if data.strip() else "is empty"


class Finding(Struct, frozen=True):
    """A finding about a line of a program.

    line: number of the line, from 1 through all files in order.
    what: the finding with its reason.
    """

    level: Level
    line: int
    what: str


class Frames(Struct, frozen=True, eq=False):
    """The tool and the work object in force.

    tool, work: names in the text, empty without one.
    flange_from_tool, base_from_work: frames, None if the text does not state them.
    """

    tool: str = ""
    work: str = ""
    flange_from_tool: Pose | None = None
    base_from_work: Pose | None = None


def index_frames(frames: Sequence[Frames], indices: Sequence[int]) -> tuple[int, ...]:
    """The indices of the frames of all instructions, empty if there is at most one frame."""
    if len(frames) > 1:
        return tuple(indices)
    return ()


def carry_pose(pose: Pose, then: Frames, now: Frames) -> Pose | None:
    """The pose of another tool in another work object for the same place of the arm.

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
    """A value that the text does not hold, and that was assumed: of an input, a wait, a question.

    key: name by which the user sets it (`--assume key=value`), empty if it cannot be set.
    """

    line: int
    what: str
    key: str = ""
    value: float = 0.0


class OpenChoice(Struct, frozen=True):
    """A branch, a case or a loop that the text does not determine.

    line: its line, from 1 through all files.
    what: the value on which it depends.
    options: number of branches or cases.
    """

    line: int
    what: str
    options: int = 2


class RunRequest(Struct, frozen=True):
    """The request of a run.

    dialect: dialect of the language, empty for its usual one.
    assume: values of inputs and other things that the text does not hold, by name in lower case.
    points: files of locations by name.
    entry: routine with which the program begins, empty for the usual one.
    limits: limits of the run.
    flange: base_from_flange of the arm from joint values (rad, mm), None for another number of
        them. Without this function joint values have no pose.
    options: options of `[post]` with which a post wrote the text. The run is then strict: a
        statement that the post does not write is a finding, and so is a setting that differs from
        the options. None for a program of another author.
    shifts: number of options after the default one that the run takes at an open choice, by the
        line of the choice.
    """

    dialect: str = ""
    assume: Mapping[str, float] = field(default_factory=dict)
    points: Mapping[str, str] = field(default_factory=dict)
    entry: str = ""
    limits: Limits = Limits()
    flange: Callable[[Sequence[float]], Pose | None] | None = None
    options: Mapping[str, object] | None = None
    shifts: Mapping[int, int] = field(default_factory=dict)

    def find_flange(self, joints: Sequence[float]) -> Pose | None:
        """base_from_flange at joint values, rad or mm. None for an arm that is not known."""
        if self.flange is None:
            return None
        return self.flange(joints)


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
    is_limited: whether it ended there because of a limit, such as that of its steps.
    untimed: number of motions of external axes. Their time is not known.
    choices: open choices that the run came to, in order.
    steps: number of steps of the run, if it came to open choices.
    coverage: statements of the program and which of them ran, None if that is not known.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    frames: tuple[Frames, ...] = ()
    frame: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()
    assumed: tuple[Assumption, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    lost: tuple[tuple[int, str], ...] = ()
    omitted: tuple[tuple[int, str], ...] = ()
    stopped: tuple[int, str] | None = None
    is_limited: bool = False
    untimed: int = 0
    choices: tuple[OpenChoice, ...] = ()
    steps: int = 0
    coverage: Coverage | None = None

    @property
    def first_frames(self) -> Frames:
        """The frames of the first motion."""
        return next(iter(self.frames), Frames())

    @property
    def work(self) -> Pose | None:
        """base_from_work that the text states for its first motion, None if it states none."""
        return self.first_frames.base_from_work

    @property
    def tool(self) -> Pose | None:
        """flange_from_tool that the text states for its first motion, None if it states none."""
        return self.first_frames.flange_from_tool


class Language(Struct, frozen=True):
    """A language of controllers.

    name: name of the post whose controller runs it.
    about: one line for the summary.
    suffixes: endings of its files, in lower case, with the point.
    recognise: returns whether the beginning of a text is certainly in this language.
    run: runs the program in `files`, which are texts with LF line ends by name, in order. It never
        raises an exception for a text.
    dialects: names that `RunRequest.dialect` may have.
    takes: the words "entry" and "points", if those members of `RunRequest` have an effect.
    """

    name: str
    about: str
    suffixes: tuple[str, ...]
    recognise: Callable[[str], bool]
    run: Callable[[Mapping[str, str], RunRequest], Executed]
    dialects: tuple[str, ...] = ()
    takes: tuple[str, ...] = ("entry",)


def find_language(name: str) -> Language:
    """The language of the controller of the post `name`. Raises JobError if none is installed."""
    return _load(find(list_entries(LANGUAGES), name, "language", "camgen posts lists them"))


def list_languages() -> list[Language]:
    """All installed languages in the order of their names."""
    return [_load(entry) for entry in list_entries(LANGUAGES)]


def _load(entry: EntryPoint) -> Language:
    return check_language(load(entry), entry.name)


def check_language(language: Any, name: str = "") -> Language:
    """The language of a plug-in. Each result of its `run` is checked.

    name: name of its entry point.

    Raises JobError for a value that is not a Language.
    """
    plug_in = f"language {name or getattr(language, 'name', '')}"
    check_value(plug_in, _LANGUAGE, language, _REMEDY)
    run = partial(run_checked, plug_in, language.run)
    return replace(language, run=run)  # type: ignore[no-any-return]


def run_checked(
    plug_in: str,
    run: Callable[[Mapping[str, str], RunRequest], Executed],
    files: Mapping[str, str],
    request: RunRequest,
) -> Executed:
    """The result of `Language.run`. Raises JobError for a result that is not an Executed.

    plug_in: the language, for the message.
    """
    executed: Any = run(files, request)
    check_value(plug_in, _RUN, executed, _REMEDY)
    return executed if request.options is None else find_open(executed)


def find_open(executed: Executed) -> Executed:
    """The result of a strict run, in which all that the text leaves open is a finding.

    An assumption, a loss and an end before the end of the text are refused, an omission is unusual.
    """
    refused = [(entry.line, f"assumed: {entry.what}") for entry in executed.assumed]
    refused += executed.lost
    if executed.stopped is not None:
        refused.append(executed.stopped)
    if not refused and not executed.omitted:
        return executed
    findings = [*executed.findings]
    findings += [Finding("refused", line, what) for line, what in refused]
    findings += [Finding("unusual", line, what) for line, what in executed.omitted]
    findings.sort(key=lambda finding: (finding.line, LEVELS.index(finding.level)))
    return replace(
        executed, findings=tuple(findings), assumed=(), lost=(), omitted=(), stopped=None
    )


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
    "frames": be_each(tuple, be(Frames, "Frames"), "a tuple of Frames"),
    "frame": be(tuple, "a tuple of places in frames"),
    "findings": be_each(tuple, _FINDING, "a tuple of Finding"),
    "assumed": be_each(tuple, _ASSUMPTION, "a tuple of Assumption"),
    "facts": be(tuple, "a tuple of pairs of texts"),
    "lost": be(tuple, "a tuple of lines with texts"),
    "omitted": be(tuple, "a tuple of lines with texts"),
    "is_limited": be(bool, "True or False"),
    "untimed": be(int, "a number of motions"),
    "choices": be_each(tuple, be(OpenChoice, "an OpenChoice"), "a tuple of OpenChoice"),
    "steps": be(int, "a number of steps"),
    "coverage": be((Coverage, NoneType), "a Coverage"),
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
    """The body with other names of its outputs.

    file: name for messages.

    Raises InputError for a name that the body does not switch.
    """
    used = dict.fromkeys(item.signal for item in body if isinstance(item, Output))
    for name in names:
        if name not in used:
            known = ", ".join(used) or "none"
            raise InputError(
                file, f"switches no output {name!r}", "input.signals", f"it switches {known}"
            )
    return name_outputs(body, names)


def name_outputs(body: Iterable[Instruction], names: Mapping[str, str]) -> tuple[Instruction, ...]:
    """The body with other names of those outputs that have one in `names`."""
    return tuple(
        Output(names[item.signal], item.value)
        if isinstance(item, Output) and item.signal in names
        else item
        for item in body
    )


class Places:
    """Files and line numbers of the lines of a program, which are counted through all its files."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._names = list(texts)
        self._last = list(
            itertools.accumulate(
                text.count("\n") + (not text.endswith("\n")) for text in texts.values()
            )
        )

    def __call__(self, line: int) -> str:
        """Return file and line of a line that is counted through all files."""
        name, number = self.find(line)
        return f"{name} line {grouped(number)}" if name else f"line {line}"

    def find(self, line: int) -> tuple[str, int]:
        """Return the file and the number in it of a line that is counted through all files.

        The file is empty for a line beyond the last one.
        """
        k = bisect_left(self._last, line)
        if k == len(self._names):
            return "", line
        return self._names[k], line - (self._last[k - 1] if k else 0)
