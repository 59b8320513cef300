"""Share of the statements of the public programs that `camgen verify` runs.

    python -m bench.languages.coverage FOLDER

FOLDER has the git directories of the repositories of `public.tsv` (`mirror`). A statement that does
not run has one of three reasons: its routine is not called from the routine where the program
begins; the program cannot be run on before it; or it is in a branch, a case or an error handler
that no run took.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from bench.languages.choose import read_programs
from bench.support.runner import open_table, read_words
from camgen.lang.alternatives import run_alternatives
from camgen.lang.programs import RunRequest, find_language

#: The first line of a routine. G-code has none that a program does not enter.
_ROUTINE = {
    "pacscript": re.compile(r"\s*(?:(?:public|private)\s+)?(?:sub|function|program)\s", re.I),
    "rapid": re.compile(r"\s*(?:local\s+)?(?:proc|func\s+\w+|trap)\s", re.I),
    "vplus": re.compile(r"\s*\.program\s", re.I),
}


def count(language: str, name: str, text: str) -> Counter[str]:
    """Numbers of the statements of a program: all, run, and not run by reason."""
    executed = run_alternatives(find_language(language), {name: text}, RunRequest()).executed
    coverage = executed.coverage
    counts: Counter[str] = Counter(programs=1)
    if coverage is None:
        return counts
    starts = []
    if language in _ROUTINE:
        lines = enumerate(text.split("\n"), 1)
        starts = [number for number, line in lines if _ROUTINE[language].match(line)]
    routine = np.searchsorted(starts, coverage.lines, "right")
    is_called = np.isin(routine, routine[coverage.ran])
    reason = "other" if executed.stopped is None else "stopped"
    counts.update(coverage.as_data())
    counts["not called"] = int(np.sum(~is_called))
    counts[reason] = int(np.sum(is_called & ~coverage.ran))
    return counts


def main(folder: Path) -> None:
    """Prints a row for each language."""
    sums: dict[str, Counter[str]] = defaultdict(Counter)
    for program in read_programs(folder):
        if program.data is not None:
            language = program.entry.language
            sums[language] += count(language, program.name, program.text)
    table = open_table(
        "language | programs {} | statements {:,} | run, % {:.1f} | routine not called, % {:.1f} | "
        "after a stop, % {:.1f} | other branches, % {:.1f} | run of the called routines, % {:.1f}"
    )
    for language, counts in sums.items():
        statements = max(counts["statements"], 1)
        called = max(statements - counts["not called"], 1)
        shares = [counts[key] / statements for key in ("run", "not called", "stopped", "other")]
        percents = [100 * share for share in (*shares, counts["run"] / called)]
        table.add(language, counts["programs"], counts["statements"], *percents)


if __name__ == "__main__":
    main(*read_words(Path()))
