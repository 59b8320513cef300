"""The figure of a 3-D part: visible edges and the numbers of its edges."""

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
def result() -> Result:
    """The nominal job leaves out an upright edge and parts of both rims of the bore."""
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
def view(result: Result) -> View:
    return make_view(result)


@pytest.fixture(scope="module")
def edges(view: View) -> dict[str, FigureEdge]:
    """The edges by their ids; edges that are run in pieces by the ids of their paths."""
    assert view.solid is not None
    look = make_oblique()
    figure_edges = list_figure_edges(view, view.solid, look, shade(view.solid, look))
    return {line.path or line.id: edge for line, edge in zip(view.lines, figure_edges, strict=True)}


def test_edges_have_the_numbers_of_their_paths_in_the_tour(
    result: Result, edges: dict[str, FigureEdge]
) -> None:
    for k, path in enumerate(result.tour.paths, start=1):
        assert edges[path.id].text == str(k)
    assert {name for name, edge in edges.items() if edge.state == "skipped"} == {
        "e12",
        "e13",
        "e15",
    }
    assert all(edges[name].text == name for name in ("e12", "e13", "e15"))
    # The six edges at the bottom are not selected.
    assert sum(edge.text == "" for edge in edges.values()) == 6


def test_edges_behind_the_part_are_hidden(edges: dict[str, FigureEdge]) -> None:
    """The view is from the front, the right and above: the left and back edges are hidden."""
    visible_fraction = {name: float(np.mean(edge.seen)) for name, edge in edges.items()}
    for name in ("e1", "e2", "e3", "e9", "e13", "e14", "e15", "e16"):
        assert visible_fraction[name] > 0.95, name
    for name in ("e12", "e11", "e19", "e21"):
        assert visible_fraction[name] < 0.1, name


def test_points_inside_and_behind_are_hidden_and_points_above_and_in_front_visible(
    view: View,
) -> None:
    assert view.solid is not None
    look = make_oblique()
    points = np.array([[60.0, 50, 35], [60, 50, 75], [60, 50, 70], [60, -40, 20], [60, 140, 20]])
    is_visible = find_visible(shade(view.solid, look), view.solid, look, points)
    assert is_visible.tolist() == [False, True, True, True, False]


def test_the_svg_has_all_numbers_and_skipped_edges_in_red(result: Result) -> None:
    text = draw_preview(result, Path("x.svg")).decode()
    root = ET.fromstring(text)
    numbers = [
        e.text for e in root.iter("{http://www.w3.org/2000/svg}text") if e.get("class") == "n"
    ]
    assert sorted(numbers) == sorted(LABELS)
    assert re.search(r'class="skipped"[^>]*><title>e13</title>', text)
    assert re.search(r'class="skipped hidden"[^>]*><title>e12</title>', text)
    assert "left out: edge e15" in text
    assert draw_preview(result, Path("x.svg")).decode() == text


def test_the_page_and_the_picture_have_the_numbers(view: View) -> None:
    numbers = page._list_view(view, None)["numbers"]
    assert isinstance(numbers, list)
    assert sorted(row[0] for row in numbers) == sorted(LABELS)
    assert {row[0]: row[4] for row in numbers}["3"] == 2
    assert {row[0]: row[4] for row in numbers}["e13"] == -1
    image = cv2.imdecode(np.frombuffer(png.draw_png(view), np.uint8), cv2.IMREAD_COLOR)
    red = (image == np.array([46, 16, 200])).all(axis=2)
    assert red.sum() > 3000  # three discs, their edges
