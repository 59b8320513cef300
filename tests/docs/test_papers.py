"""docs/papers.md has a row for each item of the three papers, and outdated rows are found."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from docs.make.papers import Paper, find_faults, read_papers

PAPERS = Path(__file__).parents[2].parent / "shared" / "papers"
#: The stored texts of the papers, by the word of their titles.
TEXTS = {"PIST": "pist.md", "Continuous": "continuous-path.md", "RFA": "rfa.md"}


def test_no_row_is_stale() -> None:
    assert find_faults(read_papers()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"where": ("camgen/no_such_room.py",)}, "camgen/no_such_room.py is not there"),
        ({"command": "python -m bench.no_such"}, "python -m bench.no_such is not a command"),
        ({"command": "camgen buidl"}, "camgen buidl is not a command"),
        ({"ours": "0.98765 mm", "page": "docs/pist.md"}, "docs/pist.md does not state 0.98765"),
        ({"ours": "3 mm", "page": ""}, "its figures name no page"),
        ({"items": ("eq. 99",)}, "there is no eq. 99"),
    ],
)
def test_a_stale_row_is_found(change: dict[str, object], message: str) -> None:
    paper = read_papers()[0]
    rows = (replace(paper.rows[0], **change), *paper.rows[1:])
    assert any(message in fault for fault in find_faults([replace(paper, rows=rows)]))


def test_an_item_without_a_row_is_found() -> None:
    paper = read_papers()[0]
    faults = find_faults([replace(paper, rows=paper.rows[1:])])
    assert [fault.rpartition(": ")[2] for fault in faults] == [
        f"{item} has no row" for item in sorted(paper.rows[0].items)
    ]


@pytest.mark.parametrize("paper", read_papers(), ids=lambda paper: paper.title.split()[0])
def test_the_numbers_of_equations_and_figures_are_those_of_the_papers(paper: Paper) -> None:
    name = next(file for word, file in TEXTS.items() if word in paper.title)
    path = PAPERS / name
    if not path.exists():
        pytest.skip(f"shared/papers/{name} is not beside the repository")
    text = path.read_text(encoding="utf-8")
    figures = {int(k) for k in re.findall(r"^Fig\.? (\d+)[.: ]", text, re.M)}
    # A display ends with "\\quad (7)", "\\tag{7}" or "(7)": a number in brackets before "$$".
    equations = {int(k) for k in re.findall(r"\((\d{1,2})\)\s*\$\$", text)}
    assert figures == set(range(1, paper.figures + 1))
    assert equations == set(range(1, paper.equations + 1))
