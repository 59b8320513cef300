"""Findings about a program by another author, as lines of text that can be compared.

A program is examined in four ways, each as a user has it:

- `verify`: the command line, `camgen verify PROGRAM`: exit code and all that it prints;
- `run`: the interpreter of the language: findings, assumptions, losses, frames, and each
  instruction with its line; then again from each of its first routines (`--entry`);
- `read`: the program as the part of a new one: notes and each instruction;
- `build`: the program posted for another controller: notes and text, or the refusal.

An error that is not camgen's own is written down as a traceback. Numbers are rounded to 1e-5 mm or
rad, and fields with their default value are left out, so that a new field changes nothing.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import msgspec
import numpy as np

import camgen
from camgen.cli import main as run_command
from camgen.lang.programs import LEVELS, Executed, RunRequest, find_language
from camgen.lang.recorded import Recorded
from camgen.model.program import Instruction, Output

#: Controller for which a program is built: the one of the language, and the arm of its joints.
_TARGETS = {
    "gcode": ("rapid", ""),
    "pacscript": ("rapid", "VS-060"),
    "rapid": ("pacscript", "IRB 1200"),
    "vplus": ("rapid", "IRB 1200"),
}
#: Name of output k for the controllers of `_TARGETS`.
_OUTPUTS: dict[str, Callable[[int], object]] = {
    "rapid": "do{}".format,
    "pacscript": lambda place: 24 + place,
}
#: Comments of the built programs. They name version and source.
_COMMENTS = {"rapid": re.compile(r"^\s*!"), "pacscript": re.compile(r"^\s*'")}
#: Routines from which a program is run again.
_ROUTINES = {
    "pacscript": r"^\s*(?:public\s+|private\s+)?(?:sub|function|program)\s+(\w+)",
    "rapid": r"^\s*(?:local\s+)?proc\s+(\w+)",
    "vplus": r"^\s*\.program\s+([\w.]+)",
}
#: Largest number of these routines: a library has hundreds.
_MOST_ROUTINES = 20
#: Exit code of a fault in camgen.
_FAULT = 1
HEADINGS = ("verify", "run", "read", "build")


class Examined(NamedTuple):
    """The findings of a program.

    exit_code: exit code of `camgen verify`.
    counts: number of findings of the first run by kind; of runs, of their instructions, and of
        tracebacks.
    motions: lines of the instructions of all runs.
    build: "built", or the refusal with its exit code.
    texts: lines of all four ways, with a heading for each.
    """

    exit_code: int
    counts: Counter[str]
    motions: list[str]
    build: str
    texts: list[str]


def digest(lines: Sequence[str]) -> str:
    """The first 16 digits of the SHA-256 of lines."""
    return hashlib.sha256("\n".join(lines).encode("utf-8", "replace")).hexdigest()[:16]


def format_value(value: object) -> str:
    """A value in one line: structs with the fields that are not the default, rounded numbers."""
    if isinstance(value, float):
        return f"{round(float(value), 5) + 0.0:g}" if abs(value) < 1 else f"{value + 0.0:.5f}"
    if isinstance(value, np.ndarray):
        return format_value(value.tolist())
    if isinstance(value, msgspec.Struct):
        fields = [
            f"{field.name}={format_value(getattr(value, field.name))}"
            for field in msgspec.structs.fields(value)
            if not _is_default(getattr(value, field.name), field.default)
        ]
        return f"{type(value).__name__}({', '.join(fields)})"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(format_value, value))})"
    return str(value)


def _is_default(value: object, default: object) -> bool:
    if value is default:
        return True
    return isinstance(value, int | float | str | tuple) and value == default


def list_body(body: Sequence[Instruction], lines: Sequence[int], frame: Sequence[int]) -> list[str]:
    """A line for each instruction: its line in the text, its frame, and its fields."""
    frames: Sequence[int] = frame or [0] * len(body)
    return [
        f"{line} [{place}] {format_value(item)}"
        for line, place, item in zip(lines, frames, body, strict=True)
    ]


def examine(language: str, name: str, data: bytes) -> Examined:
    """The findings of a program.

    language: language that the program is written in.
    name: name of the file.
    data: its content.
    """
    counts: Counter[str] = Counter()
    text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    with TemporaryDirectory() as folder, chdir(folder):
        Path(name).write_bytes(data)
        exit_code, verified = verify(name)
        counts["traceback"] += exit_code == _FAULT
        executed: list[Executed] = []
        ran = _catch(lambda: list(_run(language, name, text, executed)), counts)
        counts.update(_count(executed))
        settings = _settings(language, executed)
        read = _catch(lambda: list(_read(name, settings)), counts)
        post = _TARGETS[language][0]
        built = _catch(lambda: list(_build(name, post, settings)), counts)
    motions: list[str] = []
    for run in executed:
        motions += list_body(run.body, run.lines, run.frame)
    texts: list[str] = []
    for heading, lines in zip(HEADINGS, (verified, ran, read, built), strict=True):
        texts += [f"== {heading}", *lines]
    return Examined(exit_code, counts, motions, built[0], texts)


def _run(language: str, name: str, text: str, executed: list[Executed]) -> Iterator[str]:
    """A line for each fact and each instruction of all runs. executed: takes the runs."""
    entries = [""]
    if language in _ROUTINES:
        pattern = re.compile(_ROUTINES[language], re.IGNORECASE | re.MULTILINE)
        entries += list(dict.fromkeys(pattern.findall(text)))[:_MOST_ROUTINES]
    for entry in entries:
        run = find_language(language).run({name: text}, RunRequest(entry=entry))
        executed.append(run)
        if entry:
            yield f"-- {entry}"
        yield from _list_facts(run)
        yield from list_body(run.body, run.lines, run.frame)


def verify(name: str) -> tuple[int, list[str]]:
    """Exit code and output of `camgen verify`."""
    output, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        code = run_command(["verify", name])
    return code, [f"exit {code}", *output.getvalue().splitlines(), *errors.getvalue().splitlines()]


def _list_facts(executed: Executed) -> Iterator[str]:
    """A line for each fact about a run except its instructions."""
    for finding in executed.findings:
        yield f"{finding.line} {finding.level}: {finding.what}"
    for assumption in executed.assumed:
        setting = f" {assumption.key}={format_value(assumption.value)}" if assumption.key else ""
        yield f"{assumption.line} assumed: {assumption.what}{setting}"
    for line, what in executed.lost:
        yield f"{line} lost: {what}"
    for line, what in executed.omitted:
        yield f"{line} omitted: {what}"
    for label, what in executed.facts:
        yield f"fact: {label}: {what}"
    if executed.stopped:
        yield "{} stopped: {}".format(*executed.stopped)
    for place, frames in enumerate(executed.frames):
        yield f"frames {place}: {format_value(frames)}"


def _count(executed: Sequence[Executed]) -> dict[str, int]:
    """The number of findings of the first run by kind, and the size of all runs."""
    if not executed:
        return {}
    first = executed[0]
    levels = Counter(finding.level for finding in first.findings)
    return {
        **{level: levels[level] for level in LEVELS},
        "assumed": len(first.assumed),
        "lost": len(first.lost),
        "omitted": len(first.omitted),
        "stopped": int(first.stopped is not None),
        "runs": len(executed),
        "instructions": sum(len(each.body) for each in executed),
    }


def _settings(language: str, executed: Sequence[Executed]) -> dict[str, Any]:
    """The job of a translation: a name for each output, and the arm of the joint values."""
    post, arm = _TARGETS[language]
    body = executed[0].body if executed else ()
    outputs = dict.fromkeys(item.signal for item in body if isinstance(item, Output))
    names = {signal: _OUTPUTS[post](place) for place, signal in enumerate(outputs)}
    settings: dict[str, Any] = {"post": {"signals": names}}
    if arm:
        settings["operation"] = {"taught_on": arm}
    return settings


def _read(name: str, settings: dict[str, Any]) -> Iterator[str]:
    """Notes and instructions of the program as a part."""
    part = camgen.read(name, {key: settings[key] for key in settings if key != "post"})
    if not isinstance(part, Recorded):
        yield f"no program but {type(part).__name__}"
        return
    yield "read"
    yield from map(str, part.notes)
    yield from list_body(part.run.body, part.run.lines, ())


def _build(name: str, post: str, settings: dict[str, Any]) -> Iterator[str]:
    """Notes and text of the program for another controller, without its comments."""
    result = camgen.build(name, post=post, job=settings, name="again")
    yield "built"
    yield from map(str, result.notes)
    for file in result.files:
        for line in file.text.splitlines():
            if not _COMMENTS[post].match(line):
                yield line


def _catch(lines: Callable[[], list[str]], counts: Counter[str]) -> list[str]:
    """Lines, or the line of the error that ends them."""
    try:
        return lines()
    except camgen.CamgenError as error:
        return [f"exit {error.exit_code}: {error}"]
    except Exception as error:
        return [_format_error(error, counts)]


def _format_error(error: Exception, counts: Counter[str]) -> str:
    """The line of a fault in camgen, which is counted."""
    counts["traceback"] += 1
    return f"traceback: {type(error).__name__}: {error}"
