"""``camgen verify FOLDER --summary``: many programs, one row each.

A file is a program of its own, unless another file calls what it defines. Files that call each
other are one program, and one row.
"""

from __future__ import annotations

import glob
import re
from argparse import Namespace
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from camgen.check.report import sum_up
from camgen.cli.judge import (
    add_harm,
    find_error,
    find_stop,
    format_time,
    list_as_data,
    make_run_options,
    name_files,
    read_texts,
    recognise_language,
)
from camgen.cli.say import Terminal, format_table
from camgen.lang.alternatives import run_alternatives
from camgen.lang.coverage import Coverage
from camgen.lang.programs import LEVELS, Finding, Language, Places, list_languages
from camgen.lang.taught import as_far_as_known
from camgen.model.errors import CamgenError, InputError, JobError
from camgen.model.job import Job
from camgen.model.program import Columns
from camgen.model.text import counted
from camgen.model.version import __version__
from camgen.read.files import Files

#: Exit codes, the worst first.
_CODES = (1, 2, 3, 0)
#: Level of a finding in SARIF 2.1.0, section 3.27.10.
_SARIF_LEVELS = {
    "refused": "error",
    "dangerous": "error",
    "possible": "warning",
    "unusual": "warning",
}
#: Definitions of what other files may call, by language. The group is the name.
_DEFINITIONS = {
    "rapid": re.compile(r"^\s*(?:LOCAL\s+)?(?:PROC|FUNC\s+\w+|TRAP)\s+(\w+)", re.I | re.M),
    "vplus": re.compile(r"^\s*\.PROGRAM\s+([\w.]+)", re.I | re.M),
}
_WORD = re.compile(r"[\w.]+")
#: Options of `camgen verify` that are for a single program.
_SINGLE = ("post", "job", "sets", "plan", "part", "entry", "report")


class Judged(Struct, frozen=True, eq=False):
    """A program that was judged.

    names: its files.
    language: name of its language, empty if it could not be read.
    findings: its findings, in order of line.
    place: file and line of a line that is counted through all files.
    seconds: time of the motions of the arm, s.
    untimed: number of motions of external axes, whose time is not known.
    exit_code: the code with which `camgen verify` ends for it alone.
    error: the line of its error, empty without one.
    coverage: its statements and which of them ran, None if that is not known.
    """

    names: tuple[str, ...]
    language: str
    findings: tuple[Finding, ...]
    place: Places
    seconds: float
    untimed: int
    exit_code: int
    error: str
    coverage: Coverage | None = None

    def count(self, level: str) -> int:
        """Return the number of findings of a level."""
        return sum(finding.level == level for finding in self.findings)


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Print a table, JSON or SARIF of all programs. Return the worst exit code.

    JobError for an option that is for a single program, InputError if no program is found.
    """
    for name in _SINGLE:
        if getattr(arguments, name):
            raise JobError(
                f"--{name}",
                "is for a single program",
                remedy="leave it out, or leave out --summary",
            )
    if arguments.json and arguments.sarif:
        raise JobError("--sarif", "and --json are both given", remedy="give one of them")
    files = Files()
    paths, others = _list_files(arguments.programs)
    programs = list(_group(paths, files))
    judged = []
    for number, (group, language) in enumerate(programs, 1):
        terminal.stage(f"{number} of {len(programs)}: {group[0]}")
        judged.append(_verify_group(group, language, arguments, files))
    if arguments.json:
        terminal.data(list(map(_as_data, judged)))
    elif arguments.sarif:
        terminal.data(_as_sarif(judged))
    else:
        terminal.out(_as_table(judged, others))
    return min((program.exit_code for program in judged), key=_CODES.index)


def _list_files(names: Sequence[str]) -> tuple[list[Path], int]:
    """Return the files of programs, and the number of other files in the folders.

    A name is a file, a folder with all that is in it, or a pattern.
    """
    suffixes: set[str] = set()
    for language in list_languages():
        suffixes.update(language.suffixes)
    paths: list[Path] = []
    others = 0
    for name in names:
        path = Path(name)
        if path.is_dir():
            for item in sorted(path.rglob("*")):
                if not item.is_file():
                    continue
                if item.suffix.lower() in suffixes:
                    paths.append(item)
                else:
                    others += 1
        elif glob.has_magic(name) and not path.exists():
            fitting = sorted(map(Path, glob.glob(name, recursive=True)))
            if not fitting:
                raise InputError(name, "fits no file", remedy="name a file or a folder")
            paths += fitting
        else:
            paths.append(path)
    paths = list(dict.fromkeys(paths))
    if not paths:
        raise InputError(
            names[0], "has no file that ends as a program does", remedy="name the files"
        )
    return paths, others


def _group(paths: Sequence[Path], files: Files) -> Iterator[tuple[list[Path], Language | None]]:
    """Yield the files of each program, with its language. None for a file without one."""
    texts: dict[Path, str] = {}
    languages: dict[Path, Language | None] = {}
    for path in paths:
        try:
            text = read_texts([path], files)
            languages[path] = recognise_language("", text)
            texts[path] = text[path.name]
        except (InputError, JobError):
            # The error is repeated when the program is judged.
            languages[path] = None
    groups = {path: [path] for path in paths}
    for path, other in _find_calls(texts, languages):
        large, small = sorted((groups[path], groups[other]), key=len, reverse=True)
        if large is not small:
            large += small
            groups.update(dict.fromkeys(small, large))
    order = {path: number for number, path in enumerate(paths)}
    for path, group in groups.items():
        group.sort(key=order.__getitem__)
        if group[0] == path:
            yield group, languages[path]


def _find_calls(
    texts: Mapping[Path, str], languages: Mapping[Path, Language | None]
) -> Iterator[tuple[Path, Path]]:
    """Yield pairs of files in one folder of which the first names what only the second defines."""
    owners: dict[tuple[Path, str, str], list[Path]] = defaultdict(list)
    for path, text in texts.items():
        for name in _list_definitions(path, text, languages[path]):
            owners[path.parent, _name(languages[path]), name].append(path)
    for path, text in texts.items():
        for word in sorted(set(map(str.lower, _WORD.findall(text)))):
            owner = owners.get((path.parent, _name(languages[path]), word), [])
            if len(owner) == 1 and owner[0] != path:
                yield path, owner[0]


def _name(language: Language | None) -> str:
    return "" if language is None else language.name


def _list_definitions(path: Path, text: str, language: Language | None) -> set[str]:
    """Return the names in lower case that other files may call. A file of PacScript has its own."""
    name = _name(language)
    if name == "pacscript":
        return {path.stem.lower(), path.name.lower()}
    if name not in _DEFINITIONS:
        return set()
    return {word.lower() for word in _DEFINITIONS[name].findall(text)}


def _verify_group(
    group: Sequence[Path], language: Language | None, arguments: Namespace, files: Files
) -> Judged:
    """Return a program with its findings, or with the error for which it has none."""
    names = tuple(map(str, group))
    try:
        texts = read_texts(group, files)
        place = Places(texts)
        language = language or recognise_language("", texts)
        if arguments.dialect not in language.dialects:
            arguments = Namespace(**{**vars(arguments), "dialect": None})
        request = make_run_options(language, arguments, Job(), files)
        executed = add_harm(run_alternatives(language, texts, request).executed, texts)
    except CamgenError as error:
        return Judged(names, _name(language), (), Places({}), 0.0, 0, error.exit_code, str(error))
    if len(group) > 1:
        executed = name_files(executed, place)
    refusal = find_error(executed, group[0], place)
    findings = (*executed.findings, *find_stop(executed))
    carried = as_far_as_known(executed)
    return Judged(
        names=names,
        language=language.name,
        findings=findings,
        place=place,
        seconds=sum_up(Columns(carried.body), carried.works).seconds,
        untimed=executed.untimed,
        exit_code=0 if refusal is None else refusal.exit_code,
        error="",
        coverage=executed.coverage,
    )


def _as_table(judged: Sequence[Judged], others: int) -> str:
    rows = [("program", "language", *LEVELS, "coverage", "time", "exit code")]
    for program in judged:
        name = program.names[0]
        if len(program.names) > 1:
            name += f" and {counted(len(program.names) - 1, 'more file')}"
        share = "-" if program.coverage is None else f"{int(100 * program.coverage.share)} %"
        counts = [str(program.count(level)) for level in LEVELS]
        time = program.error or format_time(program.seconds, program.untimed)
        rows.append((name, program.language or "-", *counts, share, time, str(program.exit_code)))
    codes = Counter(program.exit_code for program in judged)
    summary = f"{counted(len(judged), 'program')}: {codes[0]} without refusal or danger"
    left = f"; {counted(others, 'other file')} in the folders" if others else ""
    return f"{format_table(rows)}{summary}{left}\n"


def _as_data(program: Judged) -> dict[str, object]:
    return {
        "files": program.names,
        "language": program.language,
        "seconds": program.seconds,
        "untimed": program.untimed,
        "coverage": program.coverage and program.coverage.as_data(),
        "exit_code": program.exit_code,
        "error": program.error,
        "findings": list_as_data(program.findings, program.place),
    }


def _as_sarif(judged: Sequence[Judged]) -> dict[str, object]:
    """Return a log of SARIF 2.1.0 with a result for each finding and for each error."""
    results = []
    for program in judged:
        if program.error:
            results.append(_as_result("refused", program.error, program.names[0], 1))
        folder = Path(program.names[0]).parent
        for finding in program.findings:
            name, number = program.place.find(finding.line)
            file = (folder / name).as_posix()
            results.append(_as_result(finding.level, finding.what, file, number))
    rules = [{"id": level} for level in LEVELS]
    driver = {"name": "camgen verify", "version": __version__, "rules": rules}
    return {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "results": results}],
    }


def _as_result(level: str, what: str, file: str, line: int) -> dict[str, object]:
    location = {"artifactLocation": {"uri": file}, "region": {"startLine": line}}
    return {
        "ruleId": level,
        "level": _SARIF_LEVELS[level],
        "message": {"text": what},
        "locations": [{"physicalLocation": location}],
    }
