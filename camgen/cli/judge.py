"""Reads the texts of programs, and judges third-party ones by their language, without a post."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from msgspec.structs import replace

from camgen.cli.header import find_stale_frames
from camgen.cli.say import join_names
from camgen.lang.programs import (
    LEVELS,
    Executed,
    Finding,
    Frames,
    Language,
    Places,
    RunRequest,
    find_language,
    find_text_fault,
    list_languages,
)
from camgen.model.errors import CamgenError, InputError, JobError, NoSafeProgram, make_one_line
from camgen.model.job import Job
from camgen.model.pose import format_frame
from camgen.model.text import counted, duration
from camgen.read.files import Files, reason

Row = tuple[str, str]
_LINE = re.compile(r"\bline (\d{1,9})\b")
#: Maximum number of assumptions in the summary; --json has all of them.
_ASSUMPTIONS = 40
#: Maximum number of tools and frames in the summary.
_FRAMES = 20
_WORDS = {"true": 1.0, "on": 1.0, "false": 0.0, "off": 0.0}


def read_texts(paths: Sequence[Path], files: Files) -> Mapping[str, str]:
    """The texts by file name, in order, with LF line ends. Raises InputError for other files."""
    texts: dict[str, str] = {}
    for path in paths:
        try:
            data = files.open(path).data
        except (OSError, ValueError) as error:
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error
        fault = find_text_fault(data)
        if fault:
            raise InputError(str(path), fault, remedy="give a program that is saved as text")
        if path.name in texts:
            raise InputError(
                str(path),
                "another file has this name",
                remedy="the files of a program differ in name",
            )
        # Comments of other programs may hold any byte, so each byte is a character.
        texts[path.name] = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    return texts


def recognise_language(name: str, texts: Mapping[str, str]) -> Language:
    """The language of the files.

    name: name that the user gives; "" to recognise it by the first file.

    Raises JobError if the language is not recognised.
    """
    if name:
        return find_language(name)
    file, text = next(iter(texts.items()))
    languages = list_languages()
    suffix = Path(file).suffix.lower()
    fitting = [language for language in languages if language.recognise(text)]
    fitting += [language for language in languages if suffix in language.suffixes]
    if not fitting:
        names = " or ".join(language.name for language in languages)
        raise JobError(
            file,
            "is not recognised as a program of any known language",
            remedy=f"name its controller: --post {names}",
        )
    return fitting[0]


def make_run_options(
    language: Language, arguments: Namespace, job: Job, files: Files
) -> RunRequest:
    """The options of the user for a program. Raises JobError for options without effect on it."""
    dialect = arguments.dialect or ""
    if dialect and dialect not in language.dialects:
        known = f"it has {join_names(language.dialects) or 'none'}"
        raise JobError("--dialect", f"{language.name} has no dialect {dialect}", remedy=known)
    for name, what in (("entry", "has no routines"), ("points", "has its locations in its text")):
        if getattr(arguments, name) and name not in language.takes:
            raise JobError(f"--{name}", f"{language.name} {what}", remedy="leave it out")
    points = read_texts(list(map(Path, arguments.points)), files)
    flange = None
    if job.operation.taught_on:
        from camgen.plan.taught import find_flange  # noqa: PLC0415 (only for robot programs)

        flange = find_flange(job.operation.taught_on)
    return RunRequest(
        dialect,
        dict(chain.from_iterable(map(_read_assumed, arguments.assume))),
        points,
        arguments.entry or "",
        job.limits,
        flange,
    )


def _read_assumed(given: str) -> Iterator[tuple[str, float]]:
    """The values of `name=value` by the name in lower case; `name=[a,b]` sets name[1] and name[2].

    Raises JobError for anything else.
    """
    name, _, value = given.partition("=")
    values = value.strip()
    if not (values.startswith("[") and values.endswith("]")):
        yield _assumed(given)
        return
    for number, item in enumerate(values[1:-1].split(","), 1):
        yield _assumed(f"{name.strip()}[{number}]={item}")


def _assumed(given: str) -> tuple[str, float]:
    """The name, in lower case, and the value of `name=value`. Raises JobError for anything else."""
    name, _, value = given.partition("=")
    word = value.strip().lower()
    try:
        number = _WORDS[word] if word in _WORDS else float(word)
    except ValueError:
        number = None
    if number is None or not name.strip():
        raise JobError(
            "--assume",
            f"{given!r} is not a name with a value",
            remedy="give for example --assume di1=1",
        )
    return name.strip().lower(), number


#: Keys of assumptions on units and speeds, which change no path.
_SCALES = frozenset({"feed", "inch", "mps", "rated"})


def add_harm(executed: Executed, texts: Mapping[str, str]) -> Executed:
    """`executed` with findings on harmful motions, and on frames of its header that it never sets.

    If the path depends on an assumption, a dangerous finding is only possible.
    """
    from camgen.check.harm import find_harm  # noqa: PLC0415 (numpy, only to judge programs)

    harm = [*find_harm(executed), *find_stale_frames(texts, executed.frames)]
    if _is_assumed(executed):
        harm = list(map(_if_as_assumed, harm))
    findings = [*executed.findings, *harm]
    findings.sort(key=lambda finding: (finding.line, LEVELS.index(finding.level)))
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
    stop = Finding("refused", line, f"the run stops here: {what}")
    if executed.is_limited and _is_assumed(executed):
        stop = Finding("possible", line, f"{stop.what}, if all is as assumed")
    return (stop,)


def _if_as_assumed(finding: Finding) -> Finding:
    if finding.level != "dangerous":
        return finding
    return replace(finding, level="possible", what=f"{finding.what}, if all is as assumed")


def name_files(executed: Executed, place: Places) -> Executed:
    """`executed` with the file of each line that its messages name, for several files."""

    def add_file(what: str) -> str:
        return _LINE.sub(lambda match: place(int(match[1])), what)

    findings = [replace(finding, what=add_file(finding.what)) for finding in executed.findings]
    assumed = [replace(assumed, what=add_file(assumed.what)) for assumed in executed.assumed]
    stopped = executed.stopped and (executed.stopped[0], add_file(executed.stopped[1]))
    return replace(executed, findings=tuple(findings), assumed=tuple(assumed), stopped=stopped)


def format_time(seconds: float, untimed: int) -> str:
    """The time of a program as text.

    seconds: time of the motions of the arm, s.
    untimed: number of motions of external axes, whose time is not known.
    """
    if not untimed:
        return f"about {duration(seconds)}"
    motions = counted(untimed, "motion")
    return f"not known: {motions} of external axes; the arm moves for about {duration(seconds)}"


def list_rows(executed: Executed, place: Places) -> list[Row]:
    """Rows of the summary on frames, facts, omissions and assumptions."""
    rows = [*_frames(executed.frames), *executed.facts]
    rows += [("left out", f"{place(line)}: {what}") for line, what in executed.omitted]
    for assumed in executed.assumed[:_ASSUMPTIONS]:
        option = f" (--assume {assumed.key}=VALUE)" if assumed.key else ""
        rows.append(("assumed", f"{place(assumed.line)}: {assumed.what}{option}"))
    more = len(executed.assumed) - _ASSUMPTIONS
    if more > 0:
        rows.append(("assumed", f"and {counted(more, 'value')} more; --json lists all"))
    return [(make_one_line(label), make_one_line(text)) for label, text in rows]


def _frames(frames: Sequence[Frames]) -> list[Row]:
    tools = {("tool", row.tool): row.flange_from_tool for row in frames if row.tool}
    works = {("frame", row.work): row.base_from_work for row in frames if row.work}
    rows = []
    for (label, name), pose in (tools | works).items():
        rows.append((label, f"{name}: {format_frame(pose) if pose else 'not in the text'}"))
    if len(rows) > _FRAMES:
        rows[_FRAMES:] = [("frame", f"and {counted(len(rows) - _FRAMES, 'frame')} more")]
    return rows


def format_findings(executed: Executed, place: Places) -> str:
    """A line for each finding in the order of the program, and one on the line where it stops."""
    lines = [f"{place(row.line)}: {row.level}: {row.what}" for row in executed.findings]
    for stop in find_stop(executed):
        level = "possible: " if stop.level == "possible" else ""
        lines.append(f"{place(stop.line)}: {level}{stop.what}")
    # A text from a file may hold control characters for the terminal.
    return "".join(f"{make_one_line(line)}\n" for line in lines)


def list_as_data(findings: Iterable[Finding], place: Callable[[int], str]) -> list[dict[str, str]]:
    """Findings with their places."""
    return [{"place": place(row.line), "what": row.what, "level": row.level} for row in findings]


def convert_findings(executed: Executed, place: Places) -> dict[str, object]:
    """Findings and assumptions for --json."""
    coverage = executed.coverage
    assumptions = []
    for row in executed.assumed:
        assumptions.append(
            {"place": place(row.line), "what": row.what, "key": row.key, "value": row.value}
        )
    return {
        "faults": list_as_data(executed.findings, place),
        "assumed": assumptions,
        "stopped": executed.stopped
        and {"place": place(executed.stopped[0]), "what": executed.stopped[1]},
        "coverage": coverage and coverage.as_data(),
    }


def find_error(executed: Executed, program: Path, place: Places) -> CamgenError | None:
    """The error of a program, None if it has none.

    InputError for lines that the controller refuses and for a run that stops before its end,
    NoSafeProgram for motions that may do harm.
    """
    refused = [finding for finding in executed.findings if finding.level == "refused"]
    if refused:
        what = f"{counted(len(refused), 'line is', 'lines are')} refused, first: {refused[0].what}"
        return InputError(str(program), what, place(refused[0].line), "correct the program")
    if executed.stopped and find_stop(executed)[0].level == "refused":
        line, reason = executed.stopped
        what = f"cannot be run to its end: {reason}"
        return InputError(str(program), what, place(line), "correct the program")
    harm = [finding for finding in executed.findings if finding.level == "dangerous"]
    if harm:
        what = f"{counted(len(harm), 'line is', 'lines are')} dangerous, first: {harm[0].what}"
        return NoSafeProgram(str(program), what, place(harm[0].line), "correct the program")
    return None
