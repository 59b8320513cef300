"""Makes docs/papers.md: each section, equation, figure and table of the three papers, in camgen.

The rows are in `papers.toml`. The page is not made if a module, document or command of a row does
not exist, if a page does not state the figure that a row has from it, if an item of a paper has
no row, or if a row names an item that the paper does not have.
"""

from __future__ import annotations

import re
import tomllib
from itertools import chain
from pathlib import Path

import msgspec
from msgspec import Struct

from camgen.cli import make_parsers

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("papers.toml")
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")
_HEAD = """# The papers, row by row

camgen contains three papers. The first table compares their figures with camgen's. The other tables
have each section with a method or a result, each equation, figure and table: where it is in camgen,
the command that shows it, and where camgen differs on purpose. `python -m docs.make.pages` makes
this page, and stops at a row that no longer holds.

## Figures of the papers and of camgen

| of the paper | what | paper | camgen |
|---|---|---|---|
"""


class Row(Struct, frozen=True, forbid_unknown_fields=True):
    """One or more items of a paper, and their place in camgen.

    items: sections and numbered items of the paper, as "3.2.1", "eq. 7", "fig. 3".
    what: subject of the items.
    where: modules and documents, paths from the root.
    command: command that shows it.
    published: figures of the paper.
    ours: figures of camgen.
    page: document that states the figures of camgen.
    differs: difference on purpose, and its reason.
    """

    items: tuple[str, ...]
    what: str
    where: tuple[str, ...]
    command: str = ""
    published: str = ""
    ours: str = ""
    page: str = ""
    differs: str = ""


class Paper(Struct, frozen=True, forbid_unknown_fields=True):
    """A paper and its rows.

    title: heading of the page.
    short: name in the table of figures.
    authors: names of the authors, and links to the pages about it.
    sections: numbers of the sections with a method or a result.
    equations: number of numbered equations.
    figures: number of numbered figures.
    tables: number of numbered tables.
    rows: rows of the page.
    """

    title: str
    short: str
    authors: str
    sections: tuple[str, ...]
    equations: int
    figures: int
    tables: int
    rows: tuple[Row, ...]

    def items(self) -> set[str]:
        """Items that need a row."""
        items = set(self.sections)
        numbered = (("eq.", self.equations), ("fig.", self.figures), ("table", self.tables))
        for kind, count in numbered:
            items |= {f"{kind} {k}" for k in range(1, count + 1)}
        return items


def read_papers() -> list[Paper]:
    """Reads `papers.toml`."""
    return msgspec.convert(tomllib.loads(TABLE.read_text(encoding="utf-8"))["paper"], list[Paper])


def find_faults(papers: list[Paper]) -> list[str]:
    """Faults of the rows, one sentence each."""
    faults = []
    for paper in papers:
        items = paper.items()
        named = set(chain.from_iterable(row.items for row in paper.rows))
        faults += [f"{paper.title}: {item} has no row" for item in sorted(items - named)]
        faults += [f"{paper.title}: there is no {item}" for item in sorted(named - items)]
        for row in paper.rows:
            faults += [f"{paper.title}: {row.items[0]}: {fault}" for fault in list_row_faults(row)]
    return faults


def list_row_faults(row: Row) -> list[str]:
    faults = [f"{name} is not there" for name in row.where if not (ROOT / name).exists()]
    if row.command and not _is_command(row.command):
        faults.append(f"{row.command} is not a command")
    if row.ours and not row.page:
        faults.append("its figures name no page")
    if row.page:
        stated = set(_NUMBER.findall((ROOT / row.page).read_text(encoding="utf-8")))
        faults += [
            f"{row.page} does not state {number}"
            for number in _NUMBER.findall(row.ours)
            if number not in stated
        ]
    return faults


def _is_command(command: str) -> bool:
    """Whether a command is a bench of bench/README.md, another module, or a command of camgen."""
    if command.startswith("python -m "):
        module = command.split()[2]
        return (ROOT / (module.replace(".", "/") + ".py")).exists() and (
            not module.startswith("bench.")
            or f"`python -m {module}" in (ROOT / "bench/README.md").read_text()
        )
    return command.startswith("camgen ") and command.split()[1] in make_parsers()[1]


def papers_page() -> str:
    """Text of docs/papers.md. Raises ValueError with all faults if a row no longer holds."""
    papers = read_papers()
    faults = find_faults(papers)
    if faults:
        raise ValueError("docs/make/papers.toml: " + "; ".join(faults))
    return _HEAD + "".join(_figures(paper) for paper in papers) + "".join(map(_section, papers))


def _figures(paper: Paper) -> str:
    """Lines of the table of figures: rows with a figure of the paper or of camgen."""
    lines = ""
    for row in paper.rows:
        if row.published or row.ours:
            page = f" ([{_title(row.page)}]({row.page.removeprefix('docs/')}))" if row.ours else ""
            item = f"{paper.short}: {', '.join(row.items)}"
            lines += f"| {item} | {row.what} | {row.published} | {row.ours}{page} |\n"
    return lines


def _section(paper: Paper) -> str:
    head = f"\n## {paper.title}\n\n{paper.authors}\n\n"
    head += "| of the paper | what | where | command | differs |\n|---|---|---|---|---|\n"
    return head + "".join(_line(row) for row in paper.rows)


def _line(row: Row) -> str:
    where = ", ".join(_place(name) for name in row.where)
    command = f"`{row.command}`" if row.command else ""
    cells = (", ".join(row.items), row.what, where, command, row.differs)
    return f"| {' | '.join(cells)} |\n"


def _place(name: str) -> str:
    # The pages of docs/ are on the site, the modules that make them are not.
    is_on_site = name.startswith("docs/") and not name.endswith(".py")
    return f"[{_title(name)}]({name.removeprefix('docs/')})" if is_on_site else f"`{name}`"


def _title(name: str) -> str:
    return Path(name).stem
