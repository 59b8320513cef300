"""Chooses the public programs of each language: python -m bench.languages.choose FOLDER [--accept]

FOLDER has the git directories of public repositories (`mirror`). The rule was committed before any
of the repositories was read:

1. `repositories.tsv` has the repositories of each language in two groups. `known` are those of
   docs/languages/programs.md. `new` are those that an index of public files names for one of these
   paths: MainModule.mod, Module1.mod and RAPID/TASK1/PROGMOD/MainModule.mod (RAPID); test.ngc,
   circle.ngc, square.nc and circle.nc (G-code); PRO1.PAC (PacScript). No further repository was
   found for V+.
2. The repositories of a group follow each other in the order of the SHA-256 of their names. Each
   is read at its newest commit. If a repository is not to be had, it is left out and named.
3. A file is a program of its language if its name ends with a suffix of `RULES`, it has 100 to
   300,000 bytes, and enough of its lines match the patterns of `RULES`.
4. The files of a repository follow each other in the order of the git id of their content, which
   is as good as random. The first ones are taken, up to a limit for each repository. A content
   counts once.
5. A group is full with its number of programs. The further repositories are not read.

The command prints the number of programs of each group, and how many of them are not in
`public.tsv`. A repository that is missing in FOLDER is listed with the group that it is needed for.

--accept: write `public.tsv`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from bench.languages.mirror import Mirror, MissingError
from bench.support.runner import open_table, read_words

REPOSITORIES = Path(__file__).with_name("repositories.tsv")
LIST = Path(__file__).with_name("public.tsv")
#: Smallest and largest file, bytes.
SIZES = 100, 300_000


class Rule(NamedTuple):
    """The programs of a language.

    suffixes: ends of file names, lower case.
    patterns: a pattern and the least number of lines that it must match.
    per_repository: largest number of programs of one repository.
    per_group: number of programs with which a group is full.
    """

    suffixes: tuple[str, ...]
    patterns: tuple[tuple[str, int], ...]
    per_repository: int
    per_group: int

    def is_program(self, path: str, text: str) -> bool:
        """Whether a file is a program of the language."""
        if not path.lower().endswith(self.suffixes):
            return False
        for pattern, minimum in self.patterns:
            if len(re.findall(pattern, text, re.IGNORECASE | re.MULTILINE)) < minimum:
                return False
        return True


RULES = {
    # Ten lines with G0 or G1 and an axis outside of a comment.
    "gcode": Rule(
        (".nc", ".ngc", ".gcode", ".gc", ".tap", ".cnc", ".g"),
        ((r"^[^;(\r\n]*\bG0*[01](?![\d.])[^;(\r\n]*[XYZ] *[-+.\d#\[]", 10),),
        2,
        30,
    ),
    # A procedure of PacScript or PAC.
    "pacscript": Rule(
        (".pcs", ".pac"), ((r"^\s*(public\s+|private\s+)?(sub|function|program)\s+\w", 1),), 10, 60
    ),
    # A module and an instruction that moves.
    "rapid": Rule(
        (".mod", ".modx", ".prg", ".sys", ".sysx"),
        ((r"^\s*module\s+\w", 1), (r"^\s*(move|trigg|arc)(absj|j|l|c)(start|end|do|sync)?\s", 1)),
        2,
        30,
    ),
    # A program.
    "vplus": Rule((".v2", ".v", ".v+", ".pg", ".txt"), ((r"^\s*\.program\s+[\w.]+", 1),), 30, 60),
}


class Entry(NamedTuple):
    """A row of `public.tsv`.

    language: key of `RULES`.
    group: known or new.
    repository: owner/name.
    commit: 40 hex digits.
    path: path in the repository.
    """

    language: str
    group: str
    repository: str
    commit: str
    path: str


def read_repositories() -> dict[tuple[str, str], list[str]]:
    """The repositories by language and group, in their order."""
    groups: dict[tuple[str, str], list[str]] = {}
    for line in REPOSITORIES.read_text(encoding="utf-8").splitlines()[1:]:
        language, group, repository = line.split("\t")
        groups.setdefault((language, group), []).append(repository)
    return groups


def read_list() -> list[Entry]:
    """The programs of `public.tsv`."""
    lines = LIST.read_text(encoding="utf-8").splitlines()[1:]
    return [Entry(*line.split("\t")) for line in lines]


class Program(NamedTuple):
    """A program of the list.

    data: its content; None if it is gone.
    gone: the part of it that is gone, empty otherwise.
    """

    entry: Entry
    data: bytes | None
    gone: str = ""

    @property
    def name(self) -> str:
        """The name of its file."""
        return PurePosixPath(self.entry.path).name

    @property
    def text(self) -> str:
        """Its text with line ends of one kind."""
        return self.data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")


def read_programs(folder: Path, languages: Iterable[str] = RULES) -> Iterator[Program]:
    """The programs of `public.tsv` in some languages from the git directories in a folder."""
    for entry in read_list():
        if entry.language not in languages:
            continue
        try:
            data = Mirror(folder, entry.repository).read_file(entry.commit, entry.path)
            yield Program(entry, data)
        except MissingError as error:
            yield Program(entry, None, str(error))


def list_programs(mirror: Mirror, rule: Rule, seen: set[str]) -> Iterator[tuple[str, str]]:
    """Commit and path of the programs of a repository, in order, without contents in `seen`.

    seen: ids of contents, extended by those of the programs.
    """
    commit = mirror.find_head()
    smallest, largest = SIZES
    taken = 0
    for file in sorted(mirror.list_files(commit)):
        if file.blob in seen or not file.path.lower().endswith(rule.suffixes):
            continue
        if not smallest <= file.size <= largest or taken == rule.per_repository:
            continue
        if rule.is_program(file.path, mirror.read_blob(file.blob).decode("latin-1")):
            seen.add(file.blob)
            taken += 1
            yield commit, file.path


def choose(folder: Path) -> tuple[list[Entry], list[str]]:
    """The programs of all groups, and a line for each repository that the folder does not hold."""
    entries: list[Entry] = []
    missing: list[str] = []
    seen: set[str] = set()
    for (language, group), repositories in read_repositories().items():
        rule = RULES[language]
        chosen: list[Entry] = []
        for repository in repositories:
            if len(chosen) >= rule.per_group:
                break
            try:
                programs = list(list_programs(Mirror(folder, repository), rule, seen))
            except MissingError as error:
                missing.append(f"{language}, {group}: {error}")
                continue
            chosen += [Entry(language, group, repository, *file) for file in programs]
        entries += chosen[: rule.per_group]
    return entries, missing


def main() -> None:
    """Prints the numbers of the list."""
    folder, *options = read_words(".")
    entries, missing = choose(Path(folder))
    listed = set(read_list())
    table = open_table("language | group | repositories {} | programs {} | not in the list {}")
    for language, group in read_repositories():
        chosen = [entry for entry in entries if entry[:2] == (language, group)]
        repositories = {entry.repository for entry in chosen}
        table.add(language, group, len(repositories), len(chosen), len({*chosen} - listed))
    if options == ["--accept"]:
        rows = ["\t".join(row) for row in (Entry._fields, *entries)]
        LIST.write_text("\n".join(rows) + "\n", encoding="utf-8")
    print(f"\n{len(missing)} repositories are missing in the folder")
    print("\n".join(missing))


if __name__ == "__main__":
    main()
