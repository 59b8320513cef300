"""docs/papers.md: every section, equation, figure and table of the three papers, and where camgen has it.

The rows stand in ``papers.toml``. What they name is looked up before the page is made: a module or a document that is
not there, a command that is none, a figure that its page does not state, an item of a paper without a row or with one
that does not exist stop it.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
from msgspec import Struct

from camgen.cli import parsers

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("papers.toml")
_NUMBER = re.compile(r"\d+(?:,\d{3})*(?:\.\d+)?")
_HEAD = """# The papers, row by row

camgen contains three papers. This page has every section with a method or a result, every equation, figure and table
of them: where it is, the command that shows it, what the paper states and what camgen comes to, and where camgen
differs on purpose. A row that names what is not there any more, or a figure that its page does not have, stops
`python -m docs.make.pages`, which makes this page.
"""


class Row(Struct, frozen=True, forbid_unknown_fields=True):
    """items: of the paper, as "3.2.1", "eq. 7", "fig. 3". where: modules and documents, from the root. said, ours:
    figures of the paper and of camgen, the latter with the page that states them. differs: on purpose, and why.
    """

    items: tuple[str, ...]
    what: str
    where: tuple[str, ...]
    command: str = ""
    said: str = ""
    ours: str = ""
    page: str = ""
    differs: str = ""


class Paper(Struct, frozen=True, forbid_unknown_fields=True):
    """sections: those with a method or a result. equations, figures, tables: how many are numbered."""

    title: str
    authors: str
    sections: tuple[str, ...]
    equations: int
    figures: int
    tables: int
    rows: tuple[Row, ...]

    def items(self) -> set[str]:
        """All that needs a row."""
        numbered = (("eq.", self.equations), ("fig.", self.figures), ("table", self.tables))
        return {
            *self.sections,
            *(f"{kind} {k}" for kind, count in numbered for k in range(1, count + 1)),
        }


def read_papers() -> list[Paper]:
    """The papers as ``papers.toml`` has them."""
    return msgspec.convert(tomllib.loads(TABLE.read_text(encoding="utf-8"))["paper"], list[Paper])


def find_faults(papers: list[Paper]) -> list[str]:
    """What no longer holds, in words."""
    faults = []
    for paper in papers:
        named = [item for row in paper.rows for item in row.items]
        faults += [
            f"{paper.title}: {item} has no row" for item in sorted(paper.items() - set(named))
        ]
        faults += [
            f"{paper.title}: there is no {item}" for item in sorted(set(named) - paper.items())
        ]
        faults += [
            f"{paper.title}: {row.items[0]}: {why}" for row in paper.rows for why in _faults(row)
        ]
    return faults


def _faults(row: Row) -> list[str]:
    faults = [f"{name} is not there" for name in row.where if not (ROOT / name).exists()]
    if row.command and not _is_command(row.command):
        faults.append(f"{row.command} is no command")
    if row.ours and not row.page:
        faults.append("its figures name no page")
    if row.page:
        stated = set(_NUMBER.findall((ROOT / row.page).read_text(encoding="utf-8")))
        faults += [
            f"{row.page} does not state {one}"
            for one in _NUMBER.findall(row.ours)
            if one not in stated
        ]
    return faults


def _is_command(command: str) -> bool:
    """Whether a bench has it in its README, or the command line of camgen."""
    if command.startswith("python -m "):
        module = command.split()[2]
        return (ROOT / (module.replace(".", "/") + ".py")).exists() and (
            not module.startswith("bench.")
            or f"`python -m {module}" in (ROOT / "bench/README.md").read_text()
        )
    return command.startswith("camgen ") and command.split()[1] in parsers()[1]


def papers_page() -> str:
    """The text of docs/papers.md. ValueError with all faults where a row has gone stale."""
    papers = read_papers()
    faults = find_faults(papers)
    if faults:
        raise ValueError("docs/make/papers.toml: " + "; ".join(faults))
    return _HEAD + "".join(_section(paper) for paper in papers)


def _section(paper: Paper) -> str:
    head = f"\n## {paper.title}\n\n{paper.authors}\n\n"
    head += "| of the paper | what | where | command | paper | camgen | differs |\n|---|---|---|---|---|---|---|\n"
    return head + "".join(_line(row) for row in paper.rows)


def _line(row: Row) -> str:
    where = ", ".join(_place(name) for name in row.where)
    ours = row.ours + (
        f" ([{_title(row.page)}]({row.page.removeprefix('docs/')}))"
        if row.page and row.ours
        else ""
    )
    command = f"`{row.command}`" if row.command else ""
    cells = (", ".join(row.items), row.what, where, command, row.said, ours, row.differs)
    return f"| {' | '.join(cells)} |\n"


def _place(name: str) -> str:
    shown = name.startswith("docs/") and not name.endswith(
        ".py"
    )  # of docs/ all but what makes them is on the site
    return f"[{_title(name)}]({name.removeprefix('docs/')})" if shown else f"`{name}`"


def _title(name: str) -> str:
    return Path(name).stem
