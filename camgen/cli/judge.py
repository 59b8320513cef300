"""``camgen verify`` on a program that nobody planned here: judged by its own language, not by the options of a post."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from msgspec.structs import replace

from camgen.cli.header import find_stale_frames
from camgen.cli.program_texts import read_texts
from camgen.cli.say import join_names
from camgen.lang.programs import (
    LEVELS,
    Ask,
    Executed,
    Finding,
    Frames,
    Language,
    Places,
    find_language,
    list_languages,
)
from camgen.model.errors import CamgenError, InputError, JobError, NoSafeProgram, one_line
from camgen.model.job import Job
from camgen.model.pose import format_frame
from camgen.model.text import counted, duration
from camgen.read.files import Files

Row = tuple[str, str]
_LINE = re.compile(r"\bline (\d{1,9})\b")
#: So many assumptions are told; --json has all of them.
_TOLD = 40
#: So many tools and frames are listed.
_FRAMES = 20
_WORDS = {"true": 1.0, "on": 1.0, "false": 0.0, "off": 0.0}


def find_own(name: str, texts: Mapping[str, str]) -> Language:
    """The language that the files are in. name: what the user says, "" for what the first of them looks like. JobError
    where nothing tells.
    """
    if name:
        return find_language(name)
    file, text = next(iter(texts.items()))
    every = list_languages()
    suffix = Path(file).suffix.lower()
    fit = [one for one in every if one.recognise(text)] or [
        one for one in every if suffix in one.suffixes
    ]
    if not fit:
        remedy = f"name its controller: --post {' or '.join(one.name for one in every)}"
        raise JobError(file, "does not look like a program of any language here", remedy=remedy)
    return fit[0]


def ask_of(language: Language, arguments: Namespace, job: Job, files: Files) -> Ask:
    """What the user says of the program. JobError for what makes no sense."""
    dialect = arguments.dialect or ""
    if dialect and dialect not in language.dialects:
        known = f"it has {join_names(language.dialects)}" if language.dialects else "it has none"
        raise JobError("--dialect", f"{language.name} has no dialect {dialect}", remedy=known)
    for name in ("entry", "points"):
        if getattr(arguments, name) and name not in language.takes:
            what = {
                "entry": "has no routines to begin with",
                "points": "has its locations in its text",
            }[name]
            raise JobError(f"--{name}", f"{language.name} {what}", remedy="leave it out")
    points = read_texts([Path(name) for name in arguments.points], files)
    flange = None
    if job.operation.taught_on:
        from camgen.plan.taught import find_flange  # noqa: PLC0415 (only for what needs it)

        flange = find_flange(job.operation.taught_on)
    return Ask(
        dialect,
        dict(chain.from_iterable(map(_read_assumed, arguments.assume))),
        points,
        arguments.entry or "",
        job.limits,
        flange,
    )


def _read_assumed(given: str) -> Iterator[tuple[str, float]]:
    """The values of `name=value`, by name in small letters: `name=[a,b]` has name[1] and name[2].

    JobError for anything else.
    """
    name, _, value = given.partition("=")
    values = value.strip()
    if not (values.startswith("[") and values.endswith("]")):
        yield _assumed(given)
        return
    for number, item in enumerate(values[1:-1].split(","), 1):
        yield _assumed(f"{name.strip()}[{number}]={item}")


def _assumed(given: str) -> tuple[str, float]:
    """``name=value``, the name in small letters. JobError for what is none."""
    name, _, value = given.partition("=")
    word = value.strip().lower()
    try:
        number = _WORDS[word] if word in _WORDS else float(word)
    except ValueError:
        number = None
    if number is None or not name.strip():
        raise JobError(
            "--assume",
            f"{given!r} is no name with its value",
            remedy="say for example --assume di1=1",
        )
    return name.strip().lower(), number


#: Assumptions on units and speeds, by key. They change no path.
_SCALES = frozenset({"feed", "inch", "mps", "rated"})


def add_harm(executed: Executed, texts: Mapping[str, str]) -> Executed:
    """``executed`` with what may do harm in its motion, and what its header says otherwise.

    If the path rests on an assumption, a dangerous finding is only possible.
    """
    from camgen.check.harm import find_harm  # noqa: PLC0415 (numpy: only where a program is judged)

    harm = [*find_harm(executed), *find_stale_frames(texts, executed.frames)]
    if _is_assumed(executed):
        harm = [_if_as_assumed(finding) for finding in harm]
    findings = sorted(
        (*executed.findings, *harm), key=lambda finding: (finding.line, LEVELS.index(finding.level))
    )
    return replace(executed, findings=tuple(findings))


def _is_assumed(executed: Executed) -> bool:
    """Whether the path rests on an assumption."""
    return any(assumed.key not in _SCALES for assumed in executed.assumed)


def find_stop(executed: Executed) -> tuple[Finding, ...]:
    """The end of a run before the end of its text, as a finding; nothing without one.

    A limit that a path on assumptions reaches, such as a loop that an unknown input would end, is
    only possible.
    """
    if executed.stopped is None:
        return ()
    line, what = executed.stopped
    stop = Finding("refused", line, f"cannot be run on: {what}")
    if executed.is_limited and _is_assumed(executed):
        stop = Finding("possible", line, f"{stop.what}, if all is as assumed")
    return (stop,)


def _if_as_assumed(finding: Finding) -> Finding:
    if finding.level != "dangerous":
        return finding
    return replace(finding, level="possible", what=f"{finding.what}, if all is as assumed")


def name_files(executed: Executed, place: Places) -> Executed:
    """``executed`` with the file beside each line that its texts speak of, for programs of several files."""

    def told(what: str) -> str:
        return _LINE.sub(lambda found: place(int(found[1])), what)

    return replace(
        executed,
        findings=tuple(replace(one, what=told(one.what)) for one in executed.findings),
        assumed=tuple(replace(one, what=told(one.what)) for one in executed.assumed),
        stopped=executed.stopped and (executed.stopped[0], told(executed.stopped[1])),
    )


def tell_time(seconds: float, untimed: int) -> str:
    """The time of a program as text.

    seconds: time of the motions of the arm, s.
    untimed: number of motions of external axes, whose time is not known.
    """
    if not untimed:
        return f"about {duration(seconds)}"
    motions = counted(untimed, "motion")
    return f"not known: {motions} of external axes; the arm moves for about {duration(seconds)}"


def check_page(name: str) -> None:
    """JobError for the name of a report that is no page."""
    if Path(name).suffix.lower() != ".html":
        raise JobError(
            name, "the report of a program is a page", remedy="give a name that ends in .html"
        )


def rows_of(executed: Executed, place: Places) -> list[Row]:
    """What stands in the program beside its motions, for the summary."""
    rows = [*_frames(executed.frames), *executed.facts]
    rows += [("left out", f"{place(line)}: {what}") for line, what in executed.omitted]
    for one in executed.assumed[:_TOLD]:
        more = f" (--assume {one.key}=VALUE)" if one.key else ""
        rows.append(("assumed", f"{place(one.line)}: {one.what}{more}"))
    left = len(executed.assumed) - _TOLD
    if left > 0:
        rows.append(("assumed", f"and {counted(left, 'thing')} more; --json tells all"))
    return [(one_line(label), one_line(text)) for label, text in rows]


def _frames(frames: Sequence[Frames]) -> list[Row]:
    tools = {one.tool: one.flange_from_tool for one in frames if one.tool}
    works = {one.work: one.base_from_work for one in frames if one.work}
    found = [("tool", name, pose) for name, pose in tools.items()]
    found += [("frame", name, pose) for name, pose in works.items()]
    rows = [
        (label, f"{name}: {format_frame(pose) if pose else 'not in the text'}")
        for label, name, pose in found
    ]
    more = (
        [("frame", f"and {counted(len(rows) - _FRAMES, 'frame')} more")]
        if len(rows) > _FRAMES
        else []
    )
    return rows[:_FRAMES] + more


def tell_findings(executed: Executed, place: Places) -> str:
    """A line for each finding, in the order of the program."""
    found = [f"{place(one.line)}: {one.level}: {one.what}" for one in executed.findings]
    for stop in find_stop(executed):
        level = "possible: " if stop.level == "possible" else ""
        found.append(f"{place(stop.line)}: {level}{stop.what}")
    # What a file holds may be anything, to a terminal too.
    return "".join(f"{one_line(text)}\n" for text in found)


def as_data(executed: Executed, place: Places) -> dict[str, object]:
    """Findings and assumptions for --json."""
    coverage = executed.coverage
    return {
        "faults": [
            {"place": place(one.line), "what": one.what, "level": one.level}
            for one in executed.findings
        ],
        "assumed": [
            {"place": place(one.line), "what": one.what, "key": one.key, "value": one.value}
            for one in executed.assumed
        ],
        "stopped": executed.stopped
        and {"place": place(executed.stopped[0]), "what": executed.stopped[1]},
        "coverage": coverage and coverage.as_data(),
    }


def verdict(executed: Executed, program: Path, place: Places) -> CamgenError | None:
    """InputError for what the controller refuses and what cannot be run on, NoSafeProgram for what may do harm."""
    refused = [one for one in executed.findings if one.level == "refused"]
    if refused:
        what = f"{counted(len(refused), 'line is', 'lines are')} refused, first: {refused[0].what}"
        return InputError(str(program), what, place(refused[0].line), "correct the program")
    if executed.stopped and find_stop(executed)[0].level == "refused":
        line, what = executed.stopped
        return InputError(
            str(program), f"cannot be run to its end: {what}", place(line), "correct the program"
        )
    harm = [one for one in executed.findings if one.level == "dangerous"]
    if harm:
        what = f"{counted(len(harm), 'line is', 'lines are')} dangerous, first: {harm[0].what}"
        return NoSafeProgram(str(program), what, place(harm[0].line), "correct the program")
    return None
