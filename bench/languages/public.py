"""Runs the public programs of `public.tsv`: python -m bench.languages.public FOLDER [LANGUAGE ...]

    python -m bench.languages.public FOLDER [LANGUAGE ...] [--texts TEXTS] [--accept]

FOLDER has the git directories of the repositories (`mirror`). The programs stay there. A
repository, a commit or a file that is gone is named. Each program is examined as `examine` says.
Without --accept the result is compared with `findings.tsv`, and each program with another result is
listed.

--texts TEXTS: folder of the whole findings, one file per program. With --accept they are written;
    without it they are read, and the lines that differ from them are printed.
--accept: write `findings.tsv`.

The exit code is 1 if a program has another result, is gone, or gives a traceback. No clock decides
a result: a program that does not end is stopped by camgen's own limits.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from difflib import unified_diff
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from bench.languages.choose import RULES, Entry, Program, read_list, read_programs
from bench.languages.examine import Examined, digest, examine
from bench.support.runner import must_be_none, open_table

FINDINGS = Path(__file__).with_name("findings.tsv")
#: Kinds of findings that are counted, as columns of `findings.tsv` and of the table.
KINDS = ("refused", "dangerous", "unusual", "assumed", "lost", "omitted", "stopped")
_COLUMNS = (
    "language | programs {} | gone {} | to the end {} | refused {} | dangerous {} | unusual {} | "
    "assumed {} | lost {} | omitted {} | stopped {} | tracebacks | runs {:,} | "
    "instructions {:,} | read {} | built {} | other than before"
)


class Row(NamedTuple):
    """A row of `findings.tsv`.

    repository, path: the program.
    exit_code: exit code of `camgen verify`.
    counts: numbers of findings, as "kind=number" for each kind that occurs.
    motions: digest of the instructions.
    build: built, or the exit code of the refusal.
    texts: digest of all findings.
    """

    repository: str
    path: str
    exit_code: str
    counts: str
    motions: str
    build: str
    texts: str


class Result(NamedTuple):
    """A program of the list with its row and its findings, which are None if it is gone."""

    program: Program
    row: Row | None = None
    examined: Examined | None = None

    @property
    def entry(self) -> Entry:
        """The program as the list has it."""
        return self.program.entry

    @property
    def key(self) -> tuple[str, str]:
        """Repository and path."""
        return self.entry.repository, self.entry.path


def read_findings() -> dict[tuple[str, str], Row]:
    """The rows of `findings.tsv` by repository and path."""
    if not FINDINGS.exists():
        return {}
    lines = FINDINGS.read_text(encoding="utf-8").splitlines()[1:]
    rows = [Row(*line.split("\t")) for line in lines]
    return {(row.repository, row.path): row for row in rows}


def run(program: Program) -> Result:
    """Examines a program."""
    if program.data is None:
        return Result(program)
    entry = program.entry
    examined = examine(entry.language, program.name, program.data)
    counts = " ".join(f"{kind}={count}" for kind, count in sorted(examined.counts.items()) if count)
    build = "built" if examined.build == "built" else examined.build.partition(":")[0]
    code, motions, texts = str(examined.exit_code), examined.motions, examined.texts
    row = Row(entry.repository, entry.path, code, counts, digest(motions), build, digest(texts))
    return Result(program, row, examined)


def name_text(entry: Entry) -> str:
    """The name of the file with the whole findings of a program."""
    return f"{entry.repository}/{entry.path}".replace("/", "+") + ".txt"


def format_difference(result: Result, before: Row | None, texts: Path | None) -> Iterator[str]:
    """Lines that say how a result differs from that of before."""
    yield f"\n{result.entry.repository} {result.entry.path}"
    now = result.row
    if before is None or now is None:
        yield f"  {result.program.gone or 'has no row in findings.tsv'}"
        return
    for name, old, new in zip(Row._fields, before, now, strict=True):
        if old != new:
            yield f"  {name}: {old} -> {new}"
    path = texts / name_text(result.entry) if texts else None
    if path is not None and path.is_file() and result.examined is not None:
        old_texts = path.read_text(encoding="utf-8").splitlines()
        for line in unified_diff(old_texts, result.examined.texts, "before", "now", "", "", 1, ""):
            yield f"  {line}"


def sum_up(language: str, results: list[Result], differ: int) -> list[object]:
    """The cells of a language. differ: number of programs with another result than before."""
    examined = [result.examined for result in results if result.examined is not None]
    counts = sum((each.counts for each in examined), Counter[str]())
    lines = Counter(chain.from_iterable(set(each.texts) for each in examined))
    ended = sum(1 for each in examined if not each.counts["stopped"])
    return [
        language,
        len(results),
        len(results) - len(examined),
        ended,
        *(counts[kind] for kind in KINDS),
        must_be_none(counts["traceback"]),
        counts["runs"],
        counts["instructions"],
        lines["read"],
        lines["built"],
        must_be_none(differ),
    ]


def main() -> int:
    """Prints the table and the differences."""
    arguments = _parse_arguments()
    texts = Path(arguments.texts) if arguments.texts else None
    before = read_findings()
    languages = arguments.languages or list(RULES)
    results = [run(program) for program in read_programs(Path(arguments.folder), languages)]
    differing = []
    for result in results:
        if result.row is None or result.row != before.get(result.key):
            differing.append(result)
    table = open_table(_COLUMNS)
    for language in languages:
        group = [result for result in results if result.entry.language == language]
        differ = sum(1 for result in differing if result.entry.language == language)
        table.add(*sum_up(language, group, differ))
    shown = None if arguments.accept else texts
    for result in differing:
        print("\n".join(format_difference(result, before.get(result.key), shown)))
    for result in results:
        for line in result.examined.texts if result.examined else ():
            if line.startswith("traceback: "):
                print(f"\n{result.entry.repository} {result.entry.path}: {line}")
    if arguments.accept:
        _accept(results, before, texts)
    return int(table.missed > 0)


def _accept(results: list[Result], before: dict[tuple[str, str], Row], texts: Path | None) -> None:
    """Writes the rows of the results and their whole findings. Other rows stay."""
    rows = before | {result.key: result.row for result in results if result.row}
    keys = [(entry.repository, entry.path) for entry in read_list()]
    lines = ["\t".join(Row._fields), *("\t".join(rows[key]) for key in keys if key in rows)]
    FINDINGS.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if texts is None:
        return
    texts.mkdir(parents=True, exist_ok=True)
    for result in results:
        if result.examined is not None:
            text = "\n".join(result.examined.texts) + "\n"
            (texts / name_text(result.entry)).write_text(text, encoding="utf-8", errors="replace")


def _parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.languages.public")
    parser.add_argument("folder", metavar="FOLDER", help="git directories of the repositories")
    parser.add_argument(
        "languages", nargs="*", metavar="LANGUAGE", choices=[*RULES, []], help=", ".join(RULES)
    )
    parser.add_argument("--texts", metavar="TEXTS", help="folder of the whole findings")
    parser.add_argument("--accept", action="store_true", help="write findings.tsv")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
