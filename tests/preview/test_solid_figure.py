"""The figure of a 3-D part: which edges are in front, and which number each has."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest

import camgen
from camgen.pipeline import Result
from camgen.preview import page, png
from camgen.preview.drawings import draw_preview
from camgen.preview.figure import FigureEdge, find_visible, list_figure_edges, make_oblique, shade
from camgen.preview.view import View, make_view

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: Numbers of twelve whole edges and two pieces of rims, and names of the edges that are left out.
LABELS = [*map(str, range(1, 15)), "e12", "e13", "e15"]


@pytest.fixture(scope="module")
def built() -> Result:
    """Nominal: an upright edge of the block is left out, and a part of each rim of its bore."""
    sets = {
        "tool": {"holder": [[-35, -35, 0, 35, 35, 100]]},
        "input": {"select": "convex, not bottom"},
    }
    cell = {
        "robot": "IRB 2400", "base_from_work": [937.5, -47.5, 640, 0, 0, 0],
        "flange_from_tool": [-103.923, 0, 160, 0, -60, 0],
        "fixtures": [[-100, -100, -60, 225, 195, -40.5], str(PARTS / "rfa1_base.stl")],
    }  # fmt: skip
    return camgen.build(
        PARTS / "rfa1.stl", post="rapid", job={**sets, "operation": {"offset": 2}, "cell": cell}
    )


@pytest.fixture(scope="module")
def shown(built: Result) -> View:
    return make_view(built)


@pytest.fixture(scope="module")
def edges(shown: View) -> dict[str, FigureEdge]:
    """The edges by their ids, and what of them is worked in pieces by the ids of its paths."""
    assert shown.solid is not None
    look = make_oblique()
    found = list_figure_edges(shown, shown.solid, look, shade(shown.solid, look))
    return {line.path or line.id: edge for line, edge in zip(shown.lines, found, strict=True)}


def test_numbers_are_the_places_in_the_tour(built: Result, edges: dict[str, FigureEdge]) -> None:
    for k, path in enumerate(built.tour.paths, start=1):
        assert edges[path.id].text == str(k)
    assert {name for name, edge in edges.items() if edge.state == "skipped"} == {
        "e12",
        "e13",
        "e15",
    }
    assert all(edges[name].text == name for name in ("e12", "e13", "e15"))
    # The six at the bottom are not asked for.
    assert sum(edge.text == "" for edge in edges.values()) == 6


def test_what_is_behind_the_part_is_hidden(edges: dict[str, FigureEdge]) -> None:
    """Seen from in front, right and above: the rim on the left and the upright edge at the back are behind."""
    share = {name: float(np.mean(edge.seen)) for name, edge in edges.items()}
    for name in ("e1", "e2", "e3", "e9", "e13", "e14", "e15", "e16"):
        assert share[name] > 0.95, name
    for name in ("e12", "e11", "e19", "e21"):
        assert share[name] < 0.1, name


def test_a_point_inside_is_hidden_and_one_above_is_seen(shown: View) -> None:
    assert shown.solid is not None
    look = make_oblique()
    points = np.array([[60.0, 50, 35], [60, 50, 75], [60, 50, 70], [60, -40, 20], [60, 140, 20]])
    seen = find_visible(shade(shown.solid, look), shown.solid, look, points)
    assert seen.tolist() == [False, True, True, True, False]


def test_the_svg_has_every_number_and_what_is_left_out_in_red(built: Result) -> None:
    text = draw_preview(built, Path("x.svg")).decode()
    root = ET.fromstring(text)
    told = [e.text for e in root.iter("{http://www.w3.org/2000/svg}text") if e.get("class") == "n"]
    assert sorted(told) == sorted(LABELS)
    assert re.search(r'class="skipped"[^>]*><title>e13</title>', text)
    assert re.search(r'class="skipped hidden"[^>]*><title>e12</title>', text)
    assert "left out: edge e15" in text
    assert draw_preview(built, Path("x.svg")).decode() == text


def test_the_page_and_the_picture_have_the_numbers(shown: View) -> None:
    numbers = page._list_view(shown, None)["numbers"]
    assert isinstance(numbers, list)
    assert sorted(row[0] for row in numbers) == sorted(LABELS)
    assert {row[0]: row[4] for row in numbers}["3"] == 2
    assert {row[0]: row[4] for row in numbers}["e13"] == -1
    image = cv2.imdecode(np.frombuffer(png.draw_png(shown), np.uint8), cv2.IMREAD_COLOR)
    red = (image == np.array([46, 16, 200])).all(axis=2)
    assert red.sum() > 3000  # three discs, their edges
