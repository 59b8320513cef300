"""Verdicts on the alarms in public programs: python -m bench.languages.verdicts FOLDER

FOLDER has the git directories of the repositories of `public.tsv` (`mirror`). The rule was
committed before any finding was examined. These findings of each program are examined:

1. If `camgen verify` ends with exit code 2 or 3, the reason: the first line that is refused, else
   the place where the run breaks off, else the first line that is dangerous.
2. Each finding of harm in the motion, each possible finding, and each finding that the default run
   of the program does not have.

`verdicts.tsv` has a verdict on each:

- true: the controller refuses the line, or cannot run the program; the line may do harm; the
  motion is unusual as stated. If the finding names a condition, this holds under the condition. A
  text at which "the run stops here" may also be for a controller without a dialect here.
- false: the controller runs the line, or the harm is not there.
- unclear: the text does not hold the answer. The reason names the missing fact.

The command prints findings without a verdict, verdicts whose finding is gone, and the verdicts by
language. A false finding is gone when its cause is corrected. The exit code is 1 if a verdict is
missing, if 2 % of the programs or more have a false finding, or if a false finding is the reason of
an exit code 2.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import chdir
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from bench.languages.choose import RULES, Entry, Program, read_programs
from bench.languages.examine import verify
from bench.support.runner import Missed, Table, must_be_none, open_table, read_words
from camgen.cli.judge import add_harm, read_texts
from camgen.lang.alternatives import run_alternatives
from camgen.lang.programs import Finding, RunRequest, find_language
from camgen.read.files import Files

VERDICTS = Path(__file__).with_name("verdicts.tsv")
KINDS = ("true", "false", "unclear")
#: Share of the programs with a false finding, %, that is not reached.
_LIMIT = 2.0
_COLUMNS = (
    "language | programs {} | gone {} | examined {} | findings {} | true {} | false {} | "
    "unclear {} | without verdict {} | wrong exits {} | false in % of the programs {:.1f}"
)
#: The columns that name a finding, and those of each program.
Key = tuple[str, ...]
ProgramKeys = dict[Entry, list[Key]]


class Verdict(NamedTuple):
    """A row of `verdicts.tsv`.

    repository, path: the program.
    line: line of the finding, 0 for the whole program.
    level, finding: level and text of the finding.
    verdict: true, false or unclear.
    reason: a sentence that can be checked in the text of the program.
    """

    repository: str
    path: str
    line: str
    level: str
    finding: str
    verdict: str
    reason: str


def read_verdicts() -> dict[Key, Verdict]:
    """The verdicts by all columns that name the finding."""
    lines = VERDICTS.read_text(encoding="utf-8").splitlines()[1:]
    verdicts = [Verdict(*line.split("\t")) for line in lines]
    return {verdict[:5]: verdict for verdict in verdicts}


def list_findings(language: str, name: str, data: bytes) -> list[Finding]:
    """The findings of a program that are to be examined, by line.

    name: name of its file.
    data: its content.
    """
    with TemporaryDirectory() as folder, chdir(folder):
        Path(name).write_bytes(data)
        exit_code, printed = verify(name)
        texts = read_texts([Path(name)], Files())
    spoken = find_language(language)
    executed = add_harm(run_alternatives(spoken, texts, RunRequest()).executed, texts)
    certain = {
        (item.level, item.line, item.what) for item in spoken.run(texts, RunRequest()).findings
    }
    listed = []
    for item in executed.findings:
        if item.level == "possible" or (item.level, item.line, item.what) not in certain:
            listed.append(item)
    if exit_code:
        reasons = [item for item in executed.findings if item.level == "refused"]
        if executed.stopped:
            line, what = executed.stopped
            reasons.append(Finding("refused", line, f"the run stops here: {what}"))
        reasons += [item for item in executed.findings if item.level == "dangerous"]
        # The reason of an error without a finding is in the last line.
        reasons.append(Finding("refused", 0, printed[-1].removeprefix("camgen: error: ")))
        listed += [item for item in reasons[:1] if item not in listed]
    return sorted(listed, key=lambda item: item.line)


def list_keys(program: Program) -> Iterator[Key]:
    """The columns that name each finding of a program."""
    entry = program.entry
    for item in list_findings(entry.language, program.name, program.data):
        yield entry.repository, entry.path, str(item.line), item.level, item.what


def sum_up(
    language: str, programs: ProgramKeys, gone: int, verdicts: dict[Key, Verdict]
) -> Iterator[object]:
    """The cells of a language, or of all.

    gone: number of programs that are not in the folder.
    """
    counts: Counter[str] = Counter()
    wrong_exits = 0
    false_programs = set()
    for entry, keys in programs.items():
        for key in keys:
            kind = verdicts[key].verdict if key in verdicts else "missing"
            counts[kind] += 1
            if kind == "false":
                false_programs.add(entry)
                wrong_exits += key[3] == "refused"
    share = 100 * len(false_programs) / max(1, len(programs))
    examined = sum(map(bool, programs.values()))
    yield from (language, len(programs) + gone, gone, examined, counts.total())
    yield from (counts[kind] for kind in KINDS)
    yield must_be_none(counts["missing"])
    yield must_be_none(wrong_exits)
    yield Missed(f"{share:.1f}") if language == "all" and share >= _LIMIT else share


def main() -> int:
    """Prints the table, and the findings and verdicts without each other."""
    (folder,) = read_words(".")
    verdicts = read_verdicts()
    programs: ProgramKeys = {}
    gone: Counter[str] = Counter()
    for program in read_programs(Path(folder)):
        if program.data is None:
            gone[program.entry.language] += 1
        else:
            programs[program.entry] = list(list_keys(program))
    table = open_table(_COLUMNS)
    for language in RULES:
        group = {entry: keys for entry, keys in programs.items() if entry.language == language}
        table.add(*sum_up(language, group, gone[language], verdicts))
    table.add(*sum_up("all", programs, gone.total(), verdicts))
    present = {(entry.repository, entry.path) for entry in programs}
    current = dict.fromkeys(chain.from_iterable(programs.values()))
    listing = Table("finding | repository | path | line | level | text")
    for key in current:
        if key not in verdicts:
            listing.add("without a verdict", *key)
    for key in verdicts:
        if key[:2] in present and key not in current:
            listing.add("gone", *key)
    return int(table.missed > 0)


if __name__ == "__main__":
    sys.exit(main())
