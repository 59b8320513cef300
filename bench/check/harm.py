"""The judge of harm on programs with one fault each: python -m bench.check.harm [FAULTS]

FAULTS is a folder with `table.tsv` (language, file, fault) and one folder for each language, which
holds these files and a program without a fault, `sound.*`. The default is the data beside the
repository.

A fault is found if the language, the judge of harm or the comparison of the header has a finding.
The bench fails if less than 70 % are found in a language, or if a sound program has a finding.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter, defaultdict
from pathlib import Path

from bench.support.runner import SHARED, Missed, Table, open_table, read_words
from camgen.cli.judge import add_harm
from camgen.lang.programs import RunRequest, find_language

#: Share of the faults that are to be found in each language.
_GOAL = 0.7
COLUMNS = "language | faults {} | found {} | % {:.0f} | dangerous or refused {} | sound"


def list_levels(language: str, path: Path) -> list[str]:
    """The levels of the findings in a program. GRBL is a dialect of G-code."""
    dialect = "grbl" if language == "grbl" else ""
    texts = {path.name: path.read_text()}
    reader = find_language("gcode" if dialect else language)
    executed = add_harm(reader.run(texts, RunRequest(dialect=dialect)), texts)
    return [finding.level for finding in executed.findings]


def main(folder: Path) -> int:
    """Prints the faults by language, and those that are not found. Returns the exit code."""
    faults: dict[str, list[tuple[str, str]]] = defaultdict(list)
    with (folder / "table.tsv").open(encoding="utf-8") as rows:
        for row in csv.DictReader(rows, delimiter="\t"):
            faults[row["language"]].append((row["file"], row["fault"]))
    table = open_table(COLUMNS)
    unseen = []
    for language, listed in faults.items():
        counts: Counter[str] = Counter()
        for name, fault in listed:
            levels = set(list_levels(language, folder / language / name))
            counts["any"] += bool(levels)
            counts["stops"] += bool(levels & {"dangerous", "refused"})
            if not levels:
                unseen.append((language, name, fault))
        sound = next((folder / language).glob("sound.*"))
        alarms = len(list_levels(language, sound))
        share = counts["any"] / len(listed)
        count = counts["any"] if share >= _GOAL else Missed(str(counts["any"]))
        verdict = Missed(f"{alarms} findings") if alarms else "no finding"
        table.add(language, len(listed), count, 100 * share, counts["stops"], verdict)
    missed = Table("not found in | file | fault")
    for row in unseen:
        missed.add(*row)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(SHARED / "faults")))
