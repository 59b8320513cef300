"""Words that select edges of a part."""

import re
from pathlib import Path

import pytest

from camgen.model.errors import JobError
from camgen.plan.edges.select import select_edges
from camgen.read.solid import mesh
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
RFA1 = mesh.read(source(PARTS / "rfa1.stl"))
RFA2 = mesh.read(source(PARTS / "rfa2.stl"))


def ids(*numbers: int) -> tuple[str, ...]:
    return tuple(f"e{n}" for n in numbers)


def test_without_the_bottom_15_and_20_edges_remain_as_in_the_paper() -> None:
    assert select_edges(RFA1, ["convex", "not bottom"]) == ids(*range(1, 16))
    assert len(select_edges(RFA2, ["convex", "not bottom"])) == 20


def test_without_a_word_that_adds_edges_the_convex_edges_are_selected() -> None:
    convex = tuple(e.id for e in RFA2.edges if e.convex)
    assert select_edges(RFA2, []) == select_edges(RFA2, ["convex"]) == convex
    assert select_edges(RFA2, ["not bottom"]) == select_edges(RFA2, ["convex", "not bottom"])


def test_all_selects_the_concave_edges_too() -> None:
    assert select_edges(RFA2, ["all"]) == tuple(e.id for e in RFA2.edges)
    assert len(select_edges(RFA2, ["all", "not convex"])) == 6


@pytest.mark.parametrize(
    "words", [["e7", "e3-e5", "e4"], ["e7, e3-e5"], ["e3-e8 not e6 not e8"], ["not e6,e3-e7"]]
)
def test_ids_and_ranges_come_in_the_order_of_the_part(words: list[str]) -> None:
    assert select_edges(RFA1, words) == (ids(3, 4, 5, 7))


def test_the_bottom_has_the_edges_in_the_lowest_plane_and_none_that_only_touch_it() -> None:
    assert select_edges(RFA1, ["bottom"]) == ids(*range(16, 22))


@pytest.mark.parametrize(
    ("word", "message"),
    [
        (
            "convx",
            'input.select: "convx" is neither an id nor one of all, convex, bottom, not; '
            "nearest is convex",
        ),
        (
            "E3",
            'input.select: "E3" is neither an id nor one of all, convex, bottom, not; '
            "nearest is e3",
        ),
        ("e22", "input.select: rfa1.stl has no edge e22; its edges are e1 to e21"),
        ("e0", 'input.select: "e0" is neither'),
        ("e3-e22", "input.select: rfa1.stl has no edge e22"),
        ("e7-e3", 'input.select: the range "e7-e3" runs backwards; write "e3-e7"'),
        ("e3 not", 'input.select: nothing follows "not"'),
        ("not not e3", 'input.select: "not" is neither'),
        ("e3-", 'input.select: "e3-" is neither'),
    ],
)
def test_an_unknown_word_is_refused_with_the_nearest_word(word: str, message: str) -> None:
    with pytest.raises(JobError, match="^" + re.escape(message)):
        select_edges(RFA1, [word])
