import math
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath, Tour, make_waypoints
from camgen.model.pose import frozen
from camgen.preview.draw import (
    Paper,
    format_path_data,
    make_contour_chains,
    make_path_chains,
    measure_bounds,
    place_arrows,
)
from camgen.preview.svg import format_svg

SVG = "{http://www.w3.org/2000/svg}"


def make_contour(
    points: list[tuple[float, float]], bulges: list[float], closed: bool = True, ident: str = "c1"
) -> Contour:
    return Contour(frozen(points), frozen(bulges), closed, "holes", ident)


def make_path(
    position: list[tuple[float, float]], via: dict[int, tuple[float, float]], ident: str = "c1"
) -> ToolPath:
    count = len(position)
    via_points = np.full((count, 3), np.nan)
    for row, (x, y) in via.items():
        via_points[row] = (x, y, 0.0)
    columns = np.column_stack([np.array(position), np.zeros(count)])
    table = make_waypoints(columns, via_points, 20.0)
    return ToolPath(ident, "holes", table, True, contours=(ident.partition(".")[0],))


def make_ring(x: float, y: float, r: float, ident: str = "c1") -> ToolPath:
    """A counter-clockwise circle of two half circles."""
    return make_path([(x - r, y), (x + r, y), (x - r, y)], {1: (x, y - r), 2: (x, y + r)}, ident)


PLATE = make_contour([(0, 0), (100, 0), (100, 50), (0, 50)], [0, 0, 0, 0], ident="c1")
HOLE = make_contour([(40, 25), (60, 25)], [1, 1], ident="c2")
PART = Part("plate", "plate.dxf", "mm", (PLATE, HOLE), ())


def test_an_arc_of_a_contour_keeps_its_radius_and_turns_the_same_way_on_the_page() -> None:
    # Two half circles counter-clockwise about (50, 25) with radius 10, drawn at twice the size.
    (data,) = format_path_data(make_contour_chains([HOLE]), Paper(2.0, 0.0, 100.0))
    assert data == "M80.00 50.00A20.00 20.00 0 0 0 120.00 50.00A20.00 20.00 0 0 0 80.00 50.00"


def test_a_clockwise_arc_has_the_other_sweep() -> None:
    (data,) = format_path_data(
        make_contour_chains([make_contour([(0, 0), (10, 0)], [-1, 0], closed=False)]),
        Paper(1.0, 0.0, 0.0),
    )
    assert data == "M0.00 0.00A5.00 5.00 0 0 1 10.00 0.00"


def test_a_tool_path_is_drawn_like_the_contour_of_the_same_shape() -> None:
    page = Paper(1.5, 3.0, 70.0)
    assert format_path_data(make_path_chains([make_ring(50, 25, 10)]), page) == format_path_data(
        make_contour_chains([HOLE]), page
    )


@pytest.mark.parametrize("turn", [0.0, 0.3, math.pi / 4, 2.0, -1.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_bounds_contain_the_whole_circle_for_any_start(turn: float, sign: float) -> None:
    dx, dy = 10 * math.cos(turn), 10 * math.sin(turn)
    low, high = measure_bounds(
        [make_contour_chains([make_contour([(5 + dx, dy), (5 - dx, -dy)], [sign, sign])])]
    )
    assert low == pytest.approx([-5, -10])
    assert high == pytest.approx([15, 10])


@pytest.mark.parametrize("bulge", [0.2, -0.2, 0.9, -0.9])
def test_bounds_of_an_arc_are_those_of_its_points(bulge: float) -> None:
    start, end = np.array([1.0, 2.0]), np.array([7.0, 4.0])
    low, high = measure_bounds(
        [make_contour_chains([make_contour([(1, 2), (7, 4)], [bulge, 0], closed=False)])]
    )
    # Samples of the arc, rotated about the centre that follows from the ends and the via point.
    half = (end - start) / 2
    top = start + half + np.array([half[1], -half[0]]) * bulge
    a = np.array([2 * (end - start), 2 * (top - start)])
    centre = np.linalg.solve(a, [end @ end - start @ start, top @ top - start @ start])
    first = math.atan2(*(start - centre)[::-1])
    angles = first + np.linspace(0, 4 * math.atan(bulge), 20001)
    points = centre + np.hypot(*(start - centre)) * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
    assert points[-1] == pytest.approx(end)
    assert low == pytest.approx(points.min(axis=0), abs=1e-6)
    assert high == pytest.approx(points.max(axis=0), abs=1e-6)


def test_arrows_point_along_the_travel() -> None:
    # To the right is 0 deg. Upwards is -90 deg, because y points down on the page.
    right, up = make_path([(0, 0), (10, 0)], {}), make_path([(0, 0), (0, 10)], {})
    page = Paper(1.0, 0.0, 0.0)
    assert place_arrows(right, page, 90) == [(5.0, 0.0, 0.0)]
    assert place_arrows(up, page, 90) == [(0.0, -5.0, -90.0)]
    assert len(place_arrows(make_path([(0, 0), (10, 0), (20, 0), (30, 0)], {}), page, 10)) == 3


def test_the_arrow_of_an_arc_sits_on_the_arc() -> None:
    arrows = place_arrows(make_ring(0, 0, 10), Paper(1.0, 0.0, 0.0), 1000)
    assert arrows == [(0.0, 10.0, 0.0)]  # the bottom, which is y = +10 on the page, towards +x


def draw_picture(
    paths: tuple[ToolPath, ...], notes: tuple[Note, ...] = (), part: Part = PART
) -> ET.Element:
    return ET.fromstring(
        format_svg(part, Tour(paths, 12.0, "nearest neighbour"), notes, "plate.dxf, rapid")
    )


def test_the_picture_has_part_path_and_title_and_its_size_in_mm() -> None:
    root = draw_picture((make_ring(50, 25, 7, "c2"),))
    assert re.fullmatch(r"[\d.]+mm", root.attrib["width"])
    assert root.attrib["viewBox"].split()[2:] == [
        root.attrib[k].removesuffix("mm") for k in ("width", "height")
    ]
    classes = [e.attrib.get("class") for e in root.iter(f"{SVG}path")]
    assert classes.count("part") == 1
    assert classes.count("path") == 1
    assert "".join(root.itertext()).count("plate.dxf, rapid") == 2


def test_a_contour_without_a_path_is_marked_and_its_reason_given() -> None:
    root = draw_picture(
        (make_ring(50, 25, 7, "c2.1"),),
        (Note("skipped", "c1", "too small"), Note("joined", "3 ends")),
    )
    (unused,) = [e for e in root.iter(f"{SVG}path") if e.attrib.get("class") == "unused"]
    assert unused.attrib["d"].startswith("M")
    assert unused.attrib["d"].count("L") == 4  # the plate, closed
    text = "".join(root.itertext())
    assert "left out: c1 (too small)" in text
    assert "3 ends" not in text


def test_travel_is_drawn_from_the_end_of_a_path_to_the_next_start() -> None:
    root = draw_picture(
        (make_path([(0, 0), (100, 0)], {}, "c1"), make_path([(100, 50), (0, 50)], {}, "c2"))
    )
    (travel,) = [e for e in root.iter(f"{SVG}path") if e.attrib.get("class") == "travel"]
    a, b, c, d = (float(v) for v in re.findall(r"[\d.]+", travel.attrib["d"]))
    assert a == c  # straight up on the right side
    assert b > d


def test_the_scale_bar_has_the_length_of_its_label() -> None:
    root = draw_picture((make_ring(50, 25, 7, "c2"),))
    (bar,) = [e for e in root.iter(f"{SVG}path") if e.attrib.get("class") == "bar"]
    label = next(
        e.text
        for e in root.iter(f"{SVG}text")
        if (e.text or "").endswith(" mm") and "," not in (e.text or "")
    )
    left, _, _, right, _ = (float(v) for v in re.findall(r"-?[\d.]+", bar.attrib["d"]))
    (plate,) = [e for e in root.iter(f"{SVG}path") if e.attrib.get("class") == "unused"]
    xs = [float(x) for x in re.findall(r"[ML]([\d.]+)", plate.attrib["d"])]
    scale = (max(xs) - min(xs)) / 100  # the plate is 100 mm wide
    assert (right - left) / scale == pytest.approx(float((label or "").split()[0]), rel=1e-3)


def test_text_of_the_drawing_cannot_break_the_file() -> None:
    evil = replace(make_ring(50, 25, 7, "c2"), layer='</title><script>alert(1)</script>&"\x00\x1b')
    root = draw_picture(
        (evil,), (Note("skipped", "<b>\x07</svg>", "a & b"),), replace(PART, source="<&>.dxf")
    )
    assert not list(root.iter(f"{SVG}script"))
    assert "left out: <b> </svg> (a & b)" in "".join(root.itertext())


def test_many_paths_have_no_numbers() -> None:
    ten_rings = draw_picture(tuple(make_ring(x, 25, 1, f"c{x}") for x in range(10)))
    assert [e.text for e in ten_rings.iter(f"{SVG}text") if e.attrib.get("class") == "n"] == [
        str(k) for k in range(1, 11)
    ]
    rings_300 = draw_picture(tuple(make_ring(x, 25, 1, f"c{x}") for x in range(300)))
    assert not [e for e in rings_300.iter(f"{SVG}text") if e.attrib.get("class") == "n"]
    rings_2000 = draw_picture(tuple(make_ring(x, 25, 1, f"c{x}") for x in range(2000)))
    drawn = [
        e.attrib["d"] for e in rings_2000.iter(f"{SVG}path") if e.attrib.get("class") == "path"
    ]
    assert len(drawn) < 50
    assert sum(d.count("M") for d in drawn) == 2000


def test_a_picture_without_contours_and_paths_is_drawn() -> None:
    root = draw_picture((), (), Part("empty", "empty.dxf", "mm", (), ()))
    assert "0 paths" in "".join(root.itertext())


def test_the_same_build_gives_the_same_picture() -> None:
    tour = Tour((make_ring(50, 25, 7, "c2"),), 1.0, "as drawn")
    assert format_svg(PART, tour, (), "t") == format_svg(PART, tour, (), "t")
