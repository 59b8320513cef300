"""Tabs: their places, and the material that they leave, computed from the discs of the tool."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

import camgen
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.part import Contour
from camgen.model.path import ToolPath, join_paths
from camgen.model.pose import frozen
from camgen.order.tabs import _are_narrow, add_tabs
from camgen.pipeline import Result, build
from camgen.plan.pieces import (
    begin_at,
    chorded,
    head,
    lengths_along,
    nearest,
    point_at,
    split_at,
    stretch,
)
from camgen.plan.starting import move_start
from tests.support.cuts import Cut, cuts, swept
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.examples import fewer

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
PROCESS = {"spindle": 9000, "feed": 20, "plunge": 5}


def build_tabs(shapes: list[Contour], tool: float = 6.0, **operation: object) -> Result:
    job = {
        "operation": {"depth": 4.0, "tab_width": 5.0, "tab_height": 1.5, **operation},
        "process": PROCESS,
        "tool": {"diameter": tool},
    }
    return build(part(*shapes), post="gcode", job=job)


def list_cuts(result: Result, path: int) -> list[Cut]:
    """Cuts of a path with the process on."""
    return [cut for cut in cuts(result.program) if cut.work and cut.path == path]


@lru_cache(maxsize=8)
def find_removed_area(result: Result, level: float, path: int) -> Any:
    """Area that a path removes at the height `level`, mm."""
    return swept(list_cuts(result, path), level, result.job.tool.diameter / 2)


def find_tabs(result: Result, level: float, path: int = -1) -> list[Any]:
    """Tabs of a path at the height `level`, mm: areas over 0.5 mm2 that the path leaves."""
    number = path % len(result.tour.paths)
    left = find_removed_area(result, 0.0, number).difference(
        find_removed_area(result, level, number)
    )
    return [piece for piece in getattr(left, "geoms", [left]) if piece.area > 0.5]


def make_centre_line(path: ToolPath) -> Any:
    """The path of the tool centre, as a line."""
    return shapely.LineString(chorded(path, 1e-4).position[:, :2])


# Sizes.


@pytest.mark.parametrize("shape", [rectangle(0, 0, 100, 60), circle(0, 0, 40), rounded(90, 60, 12)])
@pytest.mark.parametrize("passes", [1, 2, 4])
def test_a_tab_has_its_width_at_the_top_and_slopes_of_45_degrees(shape, passes) -> None:
    result = build_tabs([shape], tabs=4, passes=passes)
    (path,) = result.tour.paths
    line, top = make_centre_line(path), -2.5
    assert len(find_tabs(result, top - 1e-6)) == 4
    for piece in find_tabs(result, top - 1e-6):
        # The ends of a tab are round, so it is narrowest on the path of the tool centre.
        # On an arc a disc reaches a little farther along the path than on a line.
        assert line.intersection(piece).length == pytest.approx(5.0, abs=0.02)
        assert line.intersection(piece).length >= 5.0 - 0.02
    for piece in find_tabs(result, -4.0 + 1e-6):
        assert line.intersection(piece).length == pytest.approx(5.0 + 2 * 1.5, abs=0.02)
    # The material above the tabs is removed.
    assert find_tabs(result, top + 1e-6) == []
    assert min(cut.end[2] for cut in list_cuts(result, 0)) == pytest.approx(-4.0, abs=1e-12)


def test_passes_below_the_top_of_the_tabs_rise_to_one_height() -> None:
    result = build_tabs([rectangle(0, 0, 100, 60)], tabs=2, passes=4)
    ends = np.array([(cut.start[2], cut.end[2]) for cut in list_cuts(result, 0)])
    assert {*ends.round(9).ravel().tolist()} == {-1.0, -2.0, -3.0, -4.0, -2.5}
    above_tabs = ends[ends.max(axis=1) > -2.5 + 1e-9]
    assert (above_tabs[:, 0] == above_tabs[:, 1]).all()


def test_the_tool_goes_down_after_a_tab_with_the_plunge_feed_at_most() -> None:
    result = build_tabs([rectangle(0, 0, 100, 60)], tabs=2)
    down = [cut for cut in list_cuts(result, 0) if cut.drop > 1e-9]
    assert len(down) == 2
    for cut in down:
        assert cut.speed * cut.drop / math.hypot(cut.drop, cut.run) == pytest.approx(5.0)
    up = [cut for cut in list_cuts(result, 0) if cut.drop < -1e-9]
    assert {cut.speed for cut in up} == {20.0}
    # The slope is 45 degrees at most. It is a little longer than the tab is high,
    # because the chords of the arcs at corners would be steeper otherwise.
    assert all(
        1.5 <= cut.run < 1.52 and abs(cut.drop) == pytest.approx(1.5) for cut in (*up, *down)
    )


def test_arcs_on_tabs_and_between_tabs_stay_arcs() -> None:
    result = build_tabs([circle(0, 0, 40)], tabs=3)
    # A slope is two chords that touch the arc from outside.
    # A chord with its ends on the arc would come nearer to the part.
    (path,) = result.tour.paths
    level = path.floor[1:] == path.floor[:-1]
    assert (~np.isnan(path.via[1:, 0]) == level).all()
    assert np.sum(~level) == 3 * 2 * 2
    radius = np.linalg.norm(path.via[1:][level][:, :2], axis=1)
    assert radius == pytest.approx(43.0, abs=1e-6)


# Places.


def test_tabs_are_spread_evenly_around_a_circle() -> None:
    result = build_tabs([circle(0, 0, 40)], tabs=5)
    angles = sorted(math.atan2(p.centroid.y, p.centroid.x) for p in find_tabs(result, -3.0))
    steps = np.diff([*angles, angles[0] + 2 * math.pi])
    assert steps == pytest.approx(2 * math.pi / 5, abs=1e-3)


@pytest.mark.parametrize(("spacing", "count"), [(1000.0, 2), (100.0, 4), (60.0, 6)])
def test_a_spacing_gives_one_tab_for_this_length_and_two_at_least(spacing, count) -> None:
    # The path is 2 (100 + 60) + 6 pi = 338.8 mm long.
    result = build_tabs([rectangle(0, 0, 100, 60)], tab_spacing=spacing)
    assert len(find_tabs(result, -3.0)) == count


def test_tabs_keep_the_radius_of_the_tool_from_corners() -> None:
    corners = [(0, 0), (100, 0), (100, 60), (0, 60)]
    for count in range(1, 13):
        result = build_tabs([rectangle(0, 0, 100, 60)], tabs=count)
        line = make_centre_line(result.tour.paths[0])
        pieces = find_tabs(result, -2.5 - 1e-6)
        assert len(pieces) == count
        for piece in pieces:
            # The tab holds a length of the edge that lies one radius from both corners.
            on = line.intersection(piece)
            for corner in corners:
                assert on.distance(shapely.Point(corner)) >= math.hypot(3, 3) - 0.02
        assert not [note for note in result.notes if "corner" in note.what]


def test_tabs_keep_the_radius_of_the_tool_from_inner_corners() -> None:
    ell = contour([(0, 0), (80, 0), (80, 30), (30, 30), (30, 80), (0, 80)])
    result = build_tabs([ell], tabs=8)
    line = make_centre_line(result.tour.paths[0])
    for piece in find_tabs(result, -2.5 - 1e-6):
        # The tool centre has its corner at (33, 33), one radius from the drawn corner.
        assert line.intersection(piece).distance(shapely.Point(33, 33)) >= 3.0 - 0.02


def test_if_every_place_is_near_a_corner_tabs_get_the_best_places_and_a_note() -> None:
    # Sides of 10 mm are too short for a tab of 5 mm and a tool of 6 mm: 5 + 6 = 11.
    side = 10.0
    radius = side / 2 / math.sin(math.pi / 8)
    points = [
        (radius * math.cos(k * math.pi / 4), radius * math.sin(k * math.pi / 4)) for k in range(8)
    ]
    result = build_tabs([contour(points)], tabs=2)
    assert [note.what for note in result.notes if "corner" in note.what] == [
        "tabs near corners on c1"
    ]
    pieces = find_tabs(result, -2.5 - 1e-6)
    assert len(pieces) == 2
    line = make_centre_line(result.tour.paths[0])
    for piece in pieces:
        # In the middle of a side, 5 mm from both corners.
        centre = line.intersection(piece).interpolate(0.5, normalized=True)
        nearest_corners = sorted(math.dist((centre.x, centre.y), point) for point in points)[:2]
        assert nearest_corners == pytest.approx([math.hypot(5, 3)] * 2, abs=0.05)


@pytest.mark.parametrize(
    "inner",
    [
        contour([(32.601, 24.201), (31.007, 24.880), (32.392, 25.920)], name="c3"),
        circle(30, 29.5, 5.9, "c3"),
    ],
    ids=["triangle", "circle"],
)
def test_a_hole_no_wider_than_the_tool_around_a_part_has_tabs(inner: Contour) -> None:
    """The tool touches both walls, at a corner of the triangle or all around the circle."""
    shapes = [circle(30, 29.5, 8), circle(30, 29.5, 6.4, "c2"), inner]
    result = build_tabs(shapes, tool=0.5, tabs=4, tab_width=1.0)
    names = [path.contours for path in result.tour.paths]
    assert len(find_tabs(result, -3.9, names.index(("c2", "c3")))) == 4


def test_a_note_names_a_path_that_is_too_short_for_its_tabs() -> None:
    result = build_tabs([circle(0, 0, 4)], tabs=6)
    (note,) = [note for note in result.notes if note.what.startswith("fewer")]
    assert note.what == "fewer tabs than requested on c1"
    # The path is 2 pi 7 = 44 mm long and each tab takes 5 + 6 + 2 x 1.5 = 14 mm.
    # So three tabs fit next to the seam.
    assert len(find_tabs(result, -3.0)) == 3


def test_a_path_that_does_not_run_around_its_contour_has_no_tabs_but_a_note() -> None:
    # The tool does not fit between the two squares, of which one is cut out.
    # It fits around the disc.
    neighbours = part(
        rectangle(0, 0, 40, 40, "c1"), rectangle(45, 0, 40, 40, "c2"), circle(150, 20, 20, "c3")
    )
    row = {"kind": "follow", "tool": "mill", "ids": ["c1", "c3"], "depth": 4.0, "tabs": 3}
    job = {
        "tools": [{"name": "mill", "diameter": 6.0, "speed": 9000}],
        "operations": [{**row, "tab_height": 1.5}],
    }
    result = build(neighbours, post="gcode", job=job)
    assert {path.contours: path.floor is not None for path in result.tour.paths} == {
        ("c1",): False,
        ("c3",): True,
    }
    (note,) = [note for note in result.notes if note.kind == "warning" and "tab" in note.what]
    assert note.what == "no tabs on 0:c1"


def test_tabs_keep_clear_of_the_seam_and_of_the_leads() -> None:
    for seam in range(6):
        shape = rounded(60 + seam, 40 + 3 * seam, 8)
        more = {"lead_in": 6.0, "lead_out": 9.0, "overlap": 4.0}
        # With 11 tabs there is one next to the seam on both sides.
        result = build_tabs([shape], tabs=11, **more)
        (path,) = result.tour.paths
        assert not path.closed
        along = lengths_along(path)
        raised = path.floor > -4.0
        # The lead-in is 6 mm long, the lead-out 9 mm, and the first 4 mm are run again.
        assert along[raised].min() > 6.0
        assert along[raised].max() < along[-1] - 13.0
        # The leads do not cut into the tabs, which have their whole width.
        line = make_centre_line(path)
        for piece in find_tabs(result, -2.5 - 1e-6):
            assert line.intersection(piece).length == pytest.approx(5.0, abs=0.02)


def test_the_holes_of_a_part_have_no_tabs() -> None:
    result = build_tabs([rounded(90, 60, 12), circle(30, 30, 12, "c2")], tabs=3)
    floors = {path.id: path.floor is not None for path in result.tour.paths}
    assert floors == {"c1": True, "c2": False}
    (note,) = [note for note in result.notes if "tab" in note.what]
    assert note.what == "3 tabs of 5 x 1.5 mm on c1"
    # The previews mark the tabs on the path of the tool centre.
    outline = make_centre_line(next(path for path in result.tour.paths if path.id == "c1"))
    assert len(note.places) == 3
    assert all(outline.distance(shapely.Point(place)) < 1e-3 for place in note.places)


def test_an_operation_of_holes_alone_holds_their_slugs_with_tabs() -> None:
    inside = build_tabs([circle(30, 30, 12)], tabs=3, side="inside")
    assert [note.what for note in inside.notes if "tab" in note.what] == [
        "3 tabs of 5 x 1.5 mm on c1"
    ]


def test_a_part_in_a_window_and_the_window_have_tabs_next_to_each_other() -> None:
    shapes = [rounded(120, 100, 12), circle(60, 50, 36, "c2"), circle(60, 50, 20, "c3")]
    result = build_tabs([*shapes, circle(15, 15, 8, "c4")], tabs=3)
    paths = {path.id: path for path in result.tour.paths}
    assert {name: path.floor is not None for name, path in paths.items()} == {
        "c1": True, "c2": True, "c3": True, "c4": False,
    }  # fmt: skip
    angles = []
    for name in ("c2", "c3"):
        floor = paths[name].floor
        assert floor is not None
        x, y = (paths[name].position[floor > floor.min()][:, :2] - [60, 50]).T
        angles.append(np.degrees(np.arctan2(y, x)))
    # Seen from the common centre, each tab of the window is next to one of the part.
    gaps = np.abs((angles[0][:, None] - angles[1] + 180) % 360 - 180).min(axis=1)
    assert gaps.max() < 15


@pytest.mark.parametrize("direction", ["climb", "conventional"])
def test_an_outer_contour_has_tabs_in_both_directions(direction) -> None:
    result = build_tabs(
        [rounded(90, 60, 12), circle(30, 30, 12, "c2")], tabs=3, direction=direction
    )
    assert {path.id for path in result.tour.paths if path.floor is not None} == {"c1"}


def test_a_finishing_path_has_its_tabs_at_the_places_of_the_first_path() -> None:
    """The two paths have different seams, and the second must not cut the tabs of the first."""
    job = {"operation": {"depth": 4.0, "tabs": 4, "tab_height": 1.5}, "process": PROCESS}
    shape = rounded(90, 60, 12)
    wide, near = (
        camgen.plan(part(shape), {**job, "tool": {"diameter": d}}).paths[0] for d in (6.6, 6.0)
    )
    near = replace(move_start(near, 3, 0.4), id="c1.finish")
    paths, (note,) = add_tabs(
        [wide, near], [wide, near], camgen.job({**job, "tool": {"diameter": 6.0}})
    )
    assert note.what == "4 tabs of 5 x 1.5 mm on c1, c1.finish"
    places = []
    for path in paths:
        along = lengths_along(path)
        tops = np.flatnonzero(path.floor > -4.0 + 1e-9)
        middles = [(along[a] + along[b]) / 2 for a, b in zip(tops[::2], tops[1::2], strict=True)]
        places.append(np.array([point_at(path, at)[:2] for at in middles]))
    assert len(places[0]) == len(places[1]) == 4
    distances = np.linalg.norm(places[0][:, None] - places[1][None], axis=2).min(axis=1)
    assert distances == pytest.approx(0.3, abs=1e-3)


# Any shapes and sizes.


@st.composite
def draw_stars(draw: Any) -> Contour:
    """A simple polygon around the origin, some of its edges arcs."""
    count = draw(st.integers(3, 9))
    radii = draw(st.lists(st.floats(25, 70), min_size=count, max_size=count))
    bulges = draw(st.lists(st.sampled_from([0.0, 0.0, 0.15, -0.1]), min_size=count, max_size=count))
    angles = [2 * math.pi * k / count for k in range(count)]
    return contour(
        [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)], bulges
    )


def test_tabs_in_a_pass_before_a_ramp_are_proven() -> None:
    corners = [(25.0625, 0.0), (-12.5, 21.65), (-13.625, -23.6)]
    triangle = contour(corners, [0.0, 0.0, -0.1])
    tabs = {"tabs": 4, "tab_width": 8.4375, "tab_height": 2.28125}
    ramps = {"passes": 2, "entry": "ramp", "entry_angle": 20.0, "lead_in": 0.0, "lead_out": 0.0}
    result = build_tabs([triangle], 4.984375, **tabs, **ramps)
    # The passes are at -2 and -4 mm and the tabs reach up to -1.72 mm, so both passes leave them.
    assert len(find_tabs(result, -1.71875 - 1e-6, 0)) == 4
    assert any(note.what.startswith("4 tabs") for note in result.notes)


@fewer(8)
@given(
    draw_stars(),
    st.floats(2, 8),
    st.floats(1, 9),
    st.floats(0.2, 2.9),
    st.integers(1, 5),
    st.sampled_from([0.0, 5.0]),
)
def test_tabs_of_any_size_have_their_width_and_slopes(
    shape, tool, width, height, count, lead
) -> None:
    more = {
        "tabs": count,
        "tab_width": width,
        "tab_height": height,
        "passes": 2,
        "entry": "ramp",
        "entry_angle": 20.0,
    }
    try:
        result = build_tabs([shape], tool, lead_in=lead, lead_out=lead, **more)
    except NoSafeProgram:
        assume(False)
    for number, path in enumerate(result.tour.paths):
        if path.floor is None:
            continue
        listed = re.findall(r"^(\d+) tabs? of", "\n".join(note.what for note in result.notes), re.M)
        pieces = find_tabs(result, -4.0 + height - 1e-6, number)
        if len(result.tour.paths) == 1:
            assert len(pieces) == sum(map(int, listed))
        line = make_centre_line(path)
        for piece in pieces:
            # At a corner of the path the discs of the tool reach around it.
            straight = not [note for note in result.notes if "corner" in note.what]
            if straight:
                assert line.intersection(piece).length == pytest.approx(width, abs=0.05 * width)
        for cut in list_cuts(result, number):
            steepest = 20.0 if cut.drop > 0 else 45.0
            angle = math.degrees(math.atan2(abs(cut.drop), cut.run))
            assert abs(cut.drop) < 1e-9 or angle <= steepest + 1e-6


# Refused settings.


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (
            {"operation": {"tabs": 2, "depth": 1.0}},
            "job: tabs of 1 mm in a depth of 1 mm (operation.tab_height)",
        ),
        (
            {"operation": {"tabs": 2, "tab_spacing": 9.0, "depth": 2.0}},
            "job: both their number and their spacing are given (operation.tab_spacing)",
        ),
        (
            {"operation": {"tabs": 2, "depth": 2.0}, "tool": {"kind": "laser"}},
            "job: a laser cuts through tabs at any height of its head (operation.tabs)",
        ),
    ],
)
def test_impossible_tabs_are_refused(tables, message) -> None:
    with pytest.raises(JobError) as error:
        build(BRACKET, post="rapid", job=tables)
    assert str(error.value).startswith(message)


# Pieces of paths.


def plan_path(shape: Contour, side: str = "outside") -> ToolPath:
    (path,) = camgen.plan(part(shape), {"operation": {"side": side}}).paths
    return path


# Three points determine a short piece of an arc to 1e-4 mm, a tenth of the last printed digit.
@settings(derandomize=True)
@given(draw_stars(), st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_a_split_path_runs_along_the_same_line(shape, parts) -> None:
    (path, *_) = camgen.plan(part(shape), {}).paths
    length = float(lengths_along(path)[-1])
    split = split_at(path, np.array(parts) * length)
    assert float(lengths_along(split)[-1]) == pytest.approx(length)
    for share in np.linspace(0.01, 0.99, 23):
        # Three points close together give a short piece of an arc, so its radius is less exact.
        assert point_at(split, share * length) == pytest.approx(
            point_at(path, share * length), abs=1e-4
        )
    # The force is perpendicular to the travel at both ends of every piece, as planned.
    shape_of = camgen.geometry.arcs.make_span_chain(split.position, split.via[1:])
    for k, tangent in enumerate(shape_of.tangents()):
        assert np.abs(np.einsum("nd,nd->n", tangent, split.force_direction[1:, k])).max() < 1e-5
    moved = begin_at(path, parts[0] * length)
    assert moved.closed
    # The end of a closed path is as near to its start as pieces of curves that meet.
    assert moved.position[0] == pytest.approx(moved.position[-1], abs=2e-4)
    assert point_at(moved, 0.5 * length) == pytest.approx(
        point_at(path, (parts[0] + 0.5) % 1 * length), abs=1e-4
    )
    long = stretch(path, parts[0] * length, 2.3 * length)
    assert float(lengths_along(long)[-1]) == pytest.approx(2.3 * length)
    assert float(lengths_along(head(path, 0.3 * length))[-1]) == pytest.approx(0.3 * length)
    at, distance = nearest(path, point_at(path, parts[0] * length))
    assert distance == pytest.approx(0.0, abs=1e-4)
    assert point_at(path, at) == pytest.approx(point_at(path, parts[0] * length), abs=1e-4)


@pytest.mark.parametrize("chord", [0.1, 0.01, 0.001])
@pytest.mark.parametrize(("side", "low", "high"), [("outside", 0.0, 1.0), ("inside", 0.0, 1.0)])
def test_chords_deviate_from_an_arc_by_the_tolerance_away_from_the_part(
    chord, side, low, high
) -> None:
    path = plan_path(circle(0, 0, 20), side)
    flat = chorded(path, chord)
    assert np.isnan(flat.via).all()
    radius = 23.0 if side == "outside" else 17.0
    a, b = flat.position[:-1, :2], flat.position[1:, :2]
    middles = np.linalg.norm((a + b) / 2, axis=1)
    ends = np.linalg.norm(flat.position[:, :2], axis=1)
    deviation = (np.concatenate([middles, ends]) - radius) * (1 if side == "outside" else -1)
    assert deviation.min() >= low - 1e-6
    assert deviation.max() <= high * chord + 1e-6


def test_a_floor_is_linear_between_its_waypoints() -> None:
    path = plan_path(rectangle(0, 0, 100, 60))
    length = lengths_along(path)
    held = replace(path, floor=frozen(-4 + length / length[-1]))
    cut = split_at(held, np.array([10.0, 77.0, 150.0]))
    assert cut.floor == pytest.approx(-4 + lengths_along(cut) / length[-1])
    assert chorded(held, 0.01).floor[-1] == -3.0
    back = held.reversed()
    assert back.floor.tolist() == held.floor[::-1].tolist()
    assert held.rows(1, 4).floor.tolist() == held.floor[1:4].tolist()
    assert len(join_paths([held.rows(0, 3), held.rows(2, 5)]).floor) == 5
    with pytest.raises(ValueError, match="pieces with a floor and pieces without"):
        join_paths([held, path])
    with pytest.raises(ValueError, match="chosen before them"):
        move_start(held, 2, 0.5)


def test_neighbouring_parts_each_have_their_tabs() -> None:
    # The paths are 1 mm apart, which is less than the diameter of the tool.
    result = build_tabs([rectangle(0, 0, 60, 60, "c1"), rectangle(67, 0, 60, 60, "c2")], tabs=4)
    (text,) = [note.what for note in result.notes if " tabs of " in note.what]
    assert text.startswith("8 tabs of 5 x 1.5 mm on c")
    for number in (0, 1):
        assert len(find_tabs(result, -2.5 - 1e-6, number)) == 4


def test_tabs_keep_away_from_the_kerf_of_a_neighbour() -> None:
    """Two outlines are 9 mm apart. Their kerfs of 6 mm meet, and a tab there would hold nothing."""
    shapes = [rounded(60, 60, 6), move_contour(rounded(60, 60, 6, "c2"), 69, 0)]
    result = build_tabs(shapes, tabs=3)
    (note,) = [note for note in result.notes if "tabs of" in note.what]
    assert len(note.places) == 6
    # The tool centre runs at x 63 mm and x 66 mm there, from y 6 mm to y 54 mm.
    assert not [place for place in note.places if 60 < place[0] < 69 and 3 < place[1] < 57]


def move_contour(shape, x, y):
    return replace(shape, points=frozen(shape.points + np.array([x, y])))


def test_a_hole_without_a_slug_has_no_tab() -> None:
    """The path is so short that it encloses nothing."""
    result = build_tabs([circle(30, 30, 3.02)], tabs=1, side="inside")
    assert [path.floor for path in result.tour.paths] == [None]


@pytest.mark.parametrize("width", [1.4, 3.1, 40.0])
def test_a_path_is_narrow_where_two_points_are_near_but_far_along_it(width: float) -> None:
    """All points on the sides of a rectangle are compared with each other."""
    corners = np.array([(0, 0), (50, 0), (50, width), (0, width), (0, 0)], dtype=float)
    along = np.append(0.0, np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1)))
    places = np.linspace(0.0, float(along[-1]), 211)
    points = np.column_stack([np.interp(places, along, corners[:, k]) for k in (0, 1)])
    gaps = np.abs(places[:, None] - places)
    gaps = np.minimum(gaps, places[-1] - gaps)
    near = np.hypot(*(points[:, None] - points).transpose(2, 0, 1)) <= 3.0
    expected = (near & (gaps > math.pi * 3.0)).any(axis=1)
    assert _are_narrow(points, places, 3.0).tolist() == expected.tolist()
    assert expected.any() == (width < 3.0)
