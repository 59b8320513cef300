"""The judge of harm: programs with one fault each, and public programs.

    python -m bench.check.harm [FAULTS] [--public FOLDER]

FAULTS is a folder with `table.tsv` (language, file, fault) and one folder for each language, which
holds these files and a program without a fault, `sound.*`. The default is the data beside the
repository.
FOLDER has the git directories of the repositories of bench/languages/public.tsv.

A fault is found if the language, the judge of harm or the comparison of the header has a finding.
The bench fails if less than 70 % are found in a language, or if a sound program has a finding.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from bench.languages.choose import Entry, read_list
from bench.languages.mirror import Mirror, MissingError
from bench.support.runner import SHARED, Missed, Table, open_table
from camgen.check.harm import find_harm
from camgen.cli.judge import add_harm
from camgen.lang.programs import Executed, RunRequest, find_language

#: Share of the faults that are to be found in each language.
_GOAL = 0.7


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("faults", nargs="?", type=Path, default=SHARED / "faults")
    parser.add_argument("--public", type=Path)
    options = parser.parse_args(arguments)
    failed = count_found(options.faults)
    if options.public:
        list_alarms(options.public)
    return failed


def run(language: str, name: str, text: str) -> Executed:
    """The run of a program with all findings. GRBL is a dialect of G-code."""
    request = RunRequest(dialect="grbl" if language == "grbl" else "")
    executed = find_language("gcode" if language == "grbl" else language).run({name: text}, request)
    return add_harm(executed, {name: text})


def count_found(folder: Path) -> int:
    """Prints the faults by language, and those that are not found. Returns the exit code."""
    faults: dict[str, list[tuple[str, str]]] = defaultdict(list)
    with (folder / "table.tsv").open(encoding="utf-8") as rows:
        for row in csv.DictReader(rows, delimiter="\t"):
            faults[row["language"]].append((row["file"], row["fault"]))
    table = open_table(
        "language | faults {} | found {} | % {:.0f} | dangerous or refused {} | sound"
    )
    unseen = []
    for language, listed in faults.items():
        counts: Counter[str] = Counter()
        for name, fault in listed:
            path = folder / language / name
            levels = {item.level for item in run(language, name, path.read_text()).findings}
            counts["any"] += bool(levels)
            counts["stops"] += bool(levels & {"dangerous", "refused"})
            if not levels:
                unseen.append((language, name, fault))
        sound = next((folder / language).glob("sound.*"))
        alarms = len(run(language, sound.name, sound.read_text()).findings)
        share = counts["any"] / len(listed)
        count = counts["any"] if share >= _GOAL else Missed(str(counts["any"]))
        verdict = Missed(f"{alarms} findings") if alarms else "no finding"
        table.add(language, len(listed), count, 100 * share, counts["stops"], verdict)
    missed = Table("not found in | file | fault")
    for row in unseen:
        missed.add(*row)
    return int(table.missed > 0)


def list_alarms(folder: Path) -> None:
    """Prints the public programs in which the judge of harm has findings, and its seconds."""
    table = Table("language | program | line {} | level | finding")
    programs: Counter[str] = Counter()
    seconds = 0.0
    for entry, text in read_public(folder):
        name = PurePosixPath(entry.path).name
        executed = find_language(entry.language).run({name: text}, RunRequest())
        begun = time.process_time()
        harm = find_harm(executed)
        seconds += time.process_time() - begun
        programs["all"] += 1
        programs["with findings"] += bool(harm)
        for finding in harm:
            where = f"{entry.repository} {entry.path}"
            table.add(entry.language, where, finding.line, finding.level, finding.what)
    alarms, count = programs["with findings"], programs["all"]
    print(f"\n{alarms} of {count} programs have a finding. The judge took {seconds:.2f} s.")


def read_public(folder: Path) -> Iterator[tuple[Entry, str]]:
    """The programs of the list that are in the folder, with their texts."""
    for entry in read_list():
        try:
            data = Mirror(folder, entry.repository).read_file(entry.commit, entry.path)
        except MissingError:
            continue
        text = data.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n")
        yield entry, text


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
