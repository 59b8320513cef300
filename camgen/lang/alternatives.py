"""Runs a program on the branches that its text leaves open.

A run takes the default option at each open choice. Further runs take another option at one choice
each, so that faults on those branches are found too. A finding that depends on a choice has the
level "possible".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.coverage import join_coverage
from camgen.lang.log import IF_HERE
from camgen.lang.programs import LEVELS, Executed, Finding, Language, OpenChoice, RunRequest
from camgen.model.text import counted

#: Number of further runs.
_RUN_LIMIT = 24
#: Size of all further runs together: lines of the text, instructions and steps of each. A long
#: program, or one with long loops, takes the time of one run.
_SIZE_LIMIT = 100_000
#: Line and text of a finding.
_Key = tuple[int, str]


class Alternatives(Struct, frozen=True, eq=False):
    """The runs of a program.

    executed: the default run with the findings of all runs. If the default run breaks off and
        another run does not, it is that run.
    choices: open choices in any of the runs.
    runs: number of runs.
    missing: number of options that were not run, because they are too many or the program is too
        long.
    """

    executed: Executed
    choices: tuple[OpenChoice, ...] = ()
    runs: int = 1
    missing: int = 0


class _Run(Struct, frozen=True, eq=False):
    """A run.

    shifts: options that it takes, see `RunRequest.shifts`.
    executed: its effect.
    """

    shifts: Mapping[int, int]
    executed: Executed


def run_alternatives(
    language: Language, files: Mapping[str, str], request: RunRequest
) -> Alternatives:
    """Run a program with its default options, and with others up to limits of number and size.

    files: texts by name, see `Language.run`.
    """
    default = _Run({}, language.run(files, request))
    if not default.executed.choices:
        return Alternatives(default.executed)
    text_lines = sum(text.count("\n") + 1 for text in files.values())
    # A further run is expected to be as large as the default run.
    left = _SIZE_LIMIT - _measure(default, text_lines)
    choices: dict[int, OpenChoice] = {}
    waiting = [*_list_new_options(default, choices)]
    runs = [default]
    while waiting and len(runs) <= _RUN_LIMIT and left >= 0:
        shifts = waiting.pop(0)
        run = _Run(shifts, language.run(files, replace(request, shifts=shifts)))
        runs.append(run)
        left -= _measure(run, text_lines)
        waiting += _list_new_options(run, choices)
    return Alternatives(_join(runs, choices), tuple(choices.values()), len(runs), len(waiting))


def _measure(run: _Run, text_lines: int) -> int:
    return text_lines + len(run.executed.lines) + run.executed.steps


def _list_new_options(run: _Run, choices: dict[int, OpenChoice]) -> Iterator[Mapping[int, int]]:
    """The options at choices that no earlier run had. They are added to `choices`."""
    for choice in run.executed.choices:
        if choice.line not in choices:
            choices[choice.line] = choice
            for shift in range(1, choice.options):
                yield {**run.shifts, choice.line: shift}


def _join(runs: list[_Run], choices: Mapping[int, OpenChoice]) -> Executed:
    """The default run, or one that does not break off, with the findings of all runs.

    runs: the default run first.
    """
    main = next((run for run in runs if not run.executed.stopped), runs[0])
    others = [run for run in runs if run is not main]
    main_keys = set(map(_key, main.executed.findings))
    # A finding that another option does not have depends on its choice.
    depends: dict[_Key, Mapping[int, int]] = {}
    for run in others:
        shifts = run.shifts or main.shifts
        if len(shifts) == 1:
            absent = main_keys.difference(map(_key, run.executed.findings))
            depends |= dict.fromkeys(absent - depends.keys(), shifts)
    findings: dict[_Key, Finding] = {}
    for finding in main.executed.findings:
        shifts = depends.get(_key(finding), {})
        findings[_key(finding)] = _make_possible(finding, shifts, choices)
    for run in others:
        for finding in _list_with_end(run.executed):
            possible = _make_possible(finding, run.shifts or main.shifts, choices)
            findings.setdefault(_key(finding), possible)
    in_order = sorted(findings.values(), key=lambda item: (item.line, LEVELS.index(item.level)))
    coverage = join_coverage(run.executed.coverage for run in runs)
    return replace(main.executed, findings=tuple(in_order), coverage=coverage)


def _key(finding: Finding) -> _Key:
    return finding.line, finding.what.removesuffix(IF_HERE)


def _list_with_end(executed: Executed) -> list[Finding]:
    """The findings of a run, with the place where it breaks off."""
    findings = [*executed.findings]
    if executed.stopped:
        line, reason = executed.stopped
        findings.append(Finding("refused", line, f"the run stops here: {reason}"))
    return findings


def _make_possible(
    finding: Finding, shifts: Mapping[int, int], choices: Mapping[int, OpenChoice]
) -> Finding:
    """The finding with the choices on which it depends. An unusual finding is returned as it is.

    shifts: the choices by their lines. Without any the finding is certain.
    """
    if finding.level == "unusual" or not shifts:
        return finding
    names = " and ".join(f"{choices[line].what} in line {line}" for line in sorted(shifts))
    what = f"{finding.what.removesuffix(IF_HERE)}; it depends on {names}"
    return replace(finding, level="possible", what=what)


def format_alternatives(result: Alternatives) -> list[tuple[str, str]]:
    """A row of the summary with the number of runs; none for a program without open choices."""
    if not result.choices:
        return []
    text = f"{counted(len(result.choices), 'choice')} left open, {counted(result.runs, 'run')}"
    if result.missing:
        text += f", {counted(result.missing, 'branch', 'branches')} not run"
    return [("branches", text)]
