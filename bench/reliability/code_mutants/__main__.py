"""Mutants of camgen's code: does a build notice them, and is the text right if it does not?

    python -m bench.reliability.code_mutants [--count 1000] [--seed N] [--only NAME] [--table FILE]
    python -m bench.reliability.code_mutants survivors [--count 130]

The first command draws mutants of posts, passes, lowering and order, builds the jobs of `cases`
with each, and judges every text that differs from that of the unchanged code. The second draws
mutants of core modules and runs the tests of their folder. Both print a table for
docs/reliability.md. The exit code is 1 if a wrong text was written, or if a survivor is not in
`survivors.tsv`.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from bench.reliability.code_mutants.cases import CASES
from bench.reliability.code_mutants.running import WRITTEN, run_cases, run_mutant
from bench.reliability.code_mutants.survivors import find_survivors, read_reasons
from bench.reliability.code_mutants.targets import CORE_GROUPS, PROGRAM_GROUPS, SEED, Mutant, draw
from bench.reliability.code_mutants.verdicts import (
    RIGHT,
    SAME_MOTION,
    UNKNOWN,
    WRONG,
    find_fault,
    find_verdict,
)
from bench.support.runner import machine, open_table

_PROCESSES = 2
#: Outcomes of a mutant over all jobs, the most serious first, as columns of the table.
COLUMNS = (WRONG, UNKNOWN, RIGHT, SAME_MOTION, "error", "same text")


class Judged(NamedTuple):
    """A mutant with an outcome of each job: an error, the same text, or the verdict on another."""

    mutant: Mutant
    outcomes: dict[str, tuple[str, str]]

    @property
    def kind(self) -> str:
        """The most serious outcome over all jobs."""
        kinds = {kind for kind, _ in self.outcomes.values()}
        return next(column for column in COLUMNS if column in kinds)


def find_outcomes(originals: Sequence[str], mutant: Mutant) -> Judged:
    """Builds the jobs with a mutant, and judges the texts that differ.

    originals: the program of each job of `CASES` by the unchanged code.
    """
    outcomes = {}
    for case, original, outcome in zip(CASES, originals, run_mutant(mutant), strict=True):
        if outcome.kind != WRITTEN:
            outcomes[case.name] = ("error", f"{outcome.kind}: {outcome.text}")
        elif outcome.text == original:
            outcomes[case.name] = ("same text", "")
        else:
            outcomes[case.name] = tuple(find_verdict(case, outcome.text, original))
    return Judged(mutant, outcomes)


def build_originals() -> list[str]:
    """The programs of the unchanged code. ValueError if one is not built, or is wrong.

    The processes that are forked afterwards share the libraries.
    """
    originals = []
    for case, outcome in zip(CASES, run_cases(), strict=True):
        if outcome.kind != WRITTEN:
            raise ValueError(f"{case.name}: {outcome.kind} {outcome.text}")
        fault = find_fault(case, outcome.text)
        if fault:
            raise ValueError(f"{case.name}: {fault}")
        originals.append(outcome.text)
    return originals


def find_all_outcomes(mutants: Sequence[Mutant], originals: Sequence[str]) -> Iterator[Judged]:
    """Judges mutants in parallel, in their order."""
    with ProcessPoolExecutor(_PROCESSES, mp_context=get_context("fork")) as pool:
        yield from pool.map(partial(find_outcomes, originals), mutants)


def main() -> int:
    """Runs the command that the docstring of this module describes."""
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.code_mutants")
    parser.add_argument("command", nargs="?", choices=["judge", "survivors"], default="judge")
    parser.add_argument("--count", type=int, help="mutants that are drawn: 1000, survivors: 130")
    parser.add_argument("--seed", type=int, default=SEED, help="of the draw")
    parser.add_argument("--only", default="", help="name of a mutant, or a part of names")
    parser.add_argument("--table", type=Path, help="file for the mutants written and judged")
    given = parser.parse_args()
    if given.command == "survivors":
        return _run_survivors(given)
    return _run_judge(given)


def _run_judge(given: argparse.Namespace) -> int:
    mutants = draw(PROGRAM_GROUPS, given.count or 1000, given.seed)
    mutants = [mutant for mutant in mutants if given.only in mutant.name]
    judged: list[Judged] = []
    for result in find_all_outcomes(mutants, build_originals()):
        judged.append(result)
        wrong = sum(each.kind == WRONG for each in judged)
        print(f"\r{len(judged)} of {len(mutants)}, {wrong} wrong", end="", file=sys.stderr)
    print(file=sys.stderr)
    print_summary(judged)
    if given.table:
        given.table.write_text(make_table(judged), encoding="utf-8")
    if given.only:
        print(make_table(judged))
    return int(any(result.kind == WRONG for result in judged))


def _run_survivors(given: argparse.Namespace) -> int:
    mutants = draw(CORE_GROUPS, given.count or 130, given.seed)
    mutants = [mutant for mutant in mutants if given.only in mutant.name]
    reasons = read_reasons()
    survivors = listed = 0
    for mutant, survives in find_survivors(mutants):
        if not survives:
            continue
        survivors += 1
        before, after = mutant.describe()
        reason = reasons.get((mutant.module, before, after), "")
        listed += bool(reason)
        print(f"{mutant.name}\t{before}\t{after}\t{reason or 'NO REASON'}", flush=True)
    print(f"\n{machine()}: {len(mutants)} mutants, {survivors} survive, {listed} with a reason")
    return int(survivors > listed)


def print_summary(judged: Sequence[Judged]) -> None:
    """Prints a table of the most serious outcomes by group of modules."""
    table = open_table(f"modules | mutants | {' | '.join(COLUMNS)}")
    for name in (*PROGRAM_GROUPS, "all"):
        members = [each for each in judged if name in (each.mutant.group, "all")]
        counts = Counter(result.kind for result in members)
        table.add(name, len(members), *(counts[column] for column in COLUMNS))


def make_table(judged: Sequence[Judged]) -> str:
    """A row for each mutant that wrote another text: where, what, and the verdicts."""
    rows = ["verdict\tmutant\tbefore\tafter\tjobs\treason"]
    for result in judged:
        if result.kind in ("error", "same text"):
            continue
        before, after = result.mutant.describe()
        jobs, reasons = [], []
        for name, (kind, reason) in result.outcomes.items():
            if kind == result.kind:
                jobs.append(name)
                reasons.append(reason)
        fields = (result.kind, result.mutant.name, before, after, ", ".join(jobs), reasons[0])
        rows.append("\t".join(fields))
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    sys.exit(main())
