"""Runs the scenarios of a bench: prints the machine and their tables, and returns the exit code.

A scenario is a value: the columns of its table, its inputs, and the function that measures an
input. This module imports nothing heavy: the peak memory of a child counts that of its parent.
"""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
#: Drawings, pictures and meshes of others, which stand beside the repository.
SHARED = ROOT.parent / "shared" / "data"

Cells = Sequence[object]
#: A head, and the format of its cells, which begins with the word that has the first brace.
_COLUMN = re.compile(r"([^{]*?) *([^ {]*\{.*)?")


def machine() -> str:
    """One line about the machine: processor, cores, Python.

    Processes that are started from here on keep compiled modules, as installed ones do.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    info = Path("/proc/cpuinfo")
    models = re.findall(r"model name\s*: (.*)", info.read_text()) if info.exists() else []
    name = models[0].strip() if models else platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}"


class Missed(str):
    """A cell that says that a goal is missed. A table with such a cell fails its bench."""

    __slots__ = ()


def verdict(is_met: bool) -> str:
    """The cell that says whether a goal is met."""
    return "ok" if is_met else Missed("**missed**")


def must_be_none(count: int) -> str:
    """The cell of a number that has to be 0."""
    return Missed(str(count)) if count else "0"


class Table:
    """A table in Markdown that is printed row by row.

    heads: names of the columns.
    formats: format of the cells of each column.
    missed: number of rows with a missed goal.
    """

    def __init__(self, columns: str) -> None:
        """Prints the head.

        columns: the heads between bars, each followed by the format of its cells. A column
            without a format has texts. A format of several numbers takes a tuple.
        """
        self.heads, self.formats, self.missed = [], [], 0
        for column in columns.split("|"):
            head, form = _COLUMN.fullmatch(column.strip()).groups()
            self.heads.append(head)
            self.formats.append(form or "{}")
        print()
        self._print(self.heads)
        print(f"|{'---|' * len(self.heads)}", flush=True)

    def add(self, *cells: object) -> None:
        """Prints a row. A text stands as it is, None is empty, and so is a cell that is missing."""
        texts = [_write(cell, form) for cell, form in zip(cells, self.formats, strict=False)]
        self._print(texts + [""] * (len(self.heads) - len(texts)))
        self.missed += any(isinstance(cell, Missed) for cell in cells)

    @staticmethod
    def _print(texts: Iterable[str]) -> None:
        cells = [f"| {text} ".replace("\n", " ") if text else "| " for text in texts]
        print("".join(cells) + "|", flush=True)


def open_table(columns: str, note: str = "") -> Table:
    """Prints the machine and the head of the first table of a bench.

    note: words after the machine.
    """
    print(f"{machine()}{note}")
    return Table(columns)


def _write(cell: object, form: str) -> str:
    if cell is None:
        return ""
    if isinstance(cell, str):
        return str(cell)
    return form.format(*cell) if isinstance(cell, tuple) else form.format(cell)


class Scenario(NamedTuple):
    """A table of a bench.

    columns: heads and formats of the table, see `Table`.
    inputs: arguments of `measure`, a tuple for each input.
    measure: gives the rows of an input. A CamgenError becomes the last row.
    title: a line above the table, empty without one.
    may_refuse: whether the goals are met if an input is refused.
    """

    columns: str
    inputs: Iterable[tuple[Any, ...]]
    measure: Callable[..., Iterable[Cells]]
    title: str = ""
    may_refuse: bool = False


def run(*scenarios: Scenario, note: str = "") -> int:
    """Prints machine and tables. Returns the exit code: 1 if a goal is missed.

    note: words after the machine.
    """
    print(f"{machine()}{note}")
    return int(sum(fill(scenario).missed for scenario in scenarios) > 0)


def fill(scenario: Scenario) -> Table:
    """Prints the table of a scenario and returns it."""
    from camgen.model.errors import CamgenError  # noqa: PLC0415 (not in what only starts processes)

    if scenario.title:
        print(f"\n{scenario.title}")
    table = Table(scenario.columns)
    for values in scenario.inputs:
        try:
            for cells in scenario.measure(*values):
                table.add(*cells)
        except CamgenError as error:
            refusal = f"refused: {error}"
            table.add(*_name(values), refusal if scenario.may_refuse else Missed(refusal))
    return table


def _name(values: tuple[Any, ...]) -> list[str]:
    """The cell that names an input: a file by its name."""
    return [value.name if isinstance(value, Path) else str(value) for value in values[:1]]


def read_words(*defaults: Any) -> list[Any]:
    """The words of the command line, each as the type of its default, then all further words."""
    words = sys.argv[1:]
    values = [type(default)(word) for default, word in zip(defaults, words, strict=False)]
    return [*values, *defaults[len(words) :], *words[len(defaults) :]]


def select(names: Iterable[str], wanted: Sequence[str]) -> list[str]:
    """The names that are wanted, all if none is."""
    return [name for name in names if not wanted or name in wanted]


def find_files(folder: Path, suffixes: Iterable[str]) -> list[Path]:
    """The files below a folder whose name ends so, in order."""
    endings = tuple(suffixes)
    return sorted(path for path in folder.rglob("*") if path.name.lower().endswith(endings))
