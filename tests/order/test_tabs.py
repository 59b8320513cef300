"""Tabs: where they stand, and what they leave of the material, from the discs that the tool sweeps."""

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


def built(shapes: list[Contour], tool: float = 6.0, **operation: object) -> Result:
    job = {
        "operation": {"depth": 4.0, "tab_width": 5.0, "tab_height": 1.5, **operation},
        "process": PROCESS,
        "tool": {"diameter": tool},
    }
    return build(part(*shapes), post="gcode", job=job)


def work(result: Result, path: int) -> list[Cut]:
    return [cut for cut in cuts(result.program) if cut.work and cut.path == path]


@lru_cache(maxsize=8)
def removed(result: Result, level: float, path: int) -> Any:
    """What a path has taken away at ``level``."""
    return swept(work(result, path), level, result.job.tool.diameter / 2)


def bridges(result: Result, level: float, path: int = -1) -> list[Any]:
    """What is left at ``level`` of what the path would cut there without tabs, pieces of it that hold."""
    number = path % len(result.tour.paths)
    left = removed(result, 0.0, number).difference(removed(result, level, number))
    return [piece for piece in getattr(left, "geoms", [left]) if piece.area > 0.5]


def middle(path: ToolPath) -> Any:
    """The way of the tool's centre, as a line."""
    return shapely.LineString(chorded(path, 1e-4).position[:, :2])


# Sizes.


@pytest.mark.parametrize("shape", [rectangle(0, 0, 100, 60), circle(0, 0, 40), rounded(90, 60, 12)])
@pytest.mark.parametrize("passes", [1, 2, 4])
def test_tabs_leave_bridges_of_the_width_at_the_top_and_by_45_degrees_wider_at_the_foot(
    shape, passes
) -> None:
    result = built([shape], tabs=4, passes=passes)
    (path,) = result.tour.paths
    line, top = middle(path), -2.5
    assert len(bridges(result, top - 1e-6)) == 4
    for piece in bridges(result, top - 1e-6):
        # The ends are round: the bridge is narrowest on the way of the centre. On an arc a disc reaches a little
        # farther along it than on a line.
        assert line.intersection(piece).length == pytest.approx(5.0, abs=0.02)
        assert line.intersection(piece).length >= 5.0 - 0.02
    for piece in bridges(result, -4.0 + 1e-6):
        assert line.intersection(piece).length == pytest.approx(5.0 + 2 * 1.5, abs=0.02)
    # Nothing is left above the tabs.
    assert bridges(result, top + 1e-6) == []
    assert min(cut.end[2] for cut in work(result, 0)) == pytest.approx(-4.0, abs=1e-12)


def test_passes_above_the_tabs_run_through_and_those_below_rise_to_one_height() -> None:
    result = built([rectangle(0, 0, 100, 60)], tabs=2, passes=4)
    heights = [{round(z, 9) for cut in work(result, 0) for z in (cut.start[2], cut.end[2])}]
    assert heights == [{-1.0, -2.0, -3.0, -4.0, -2.5}]
    at = [cut for cut in work(result, 0) if max(cut.start[2], cut.end[2]) > -2.5 + 1e-9]
    assert all(cut.start[2] == cut.end[2] for cut in at)


def test_the_tool_goes_down_behind_a_tab_no_faster_than_it_plunges() -> None:
    result = built([rectangle(0, 0, 100, 60)], tabs=2)
    down = [cut for cut in work(result, 0) if cut.drop > 1e-9]
    assert len(down) == 2
    for cut in down:
        assert cut.speed * cut.drop / math.hypot(cut.drop, cut.run) == pytest.approx(5.0)
    up = [cut for cut in work(result, 0) if cut.drop < -1e-9]
    assert {cut.speed for cut in up} == {20.0}
    # By 45 degrees at most: chords of the corners' arcs would be steeper without a little more way.
    assert all(
        1.5 <= cut.run < 1.52 and abs(cut.drop) == pytest.approx(1.5) for cut in (*up, *down)
    )


def test_arcs_over_and_under_tabs_stay_arcs() -> None:
    result = built([circle(0, 0, 40)], tabs=3)
    # A slope is two chords that touch the arc from outside: one with its ends on it would come nearer to the part.
    (path,) = result.tour.paths
    level = path.floor[1:] == path.floor[:-1]
    assert (~np.isnan(path.via[1:, 0]) == level).all()
    assert np.sum(~level) == 3 * 2 * 2
    radius = np.linalg.norm(path.via[1:][level][:, :2], axis=1)
    assert radius == pytest.approx(43.0, abs=1e-6)


# Places.


def test_tabs_are_spread_evenly_round_a_circle() -> None:
    result = built([circle(0, 0, 40)], tabs=5)
    angles = sorted(math.atan2(p.centroid.y, p.centroid.x) for p in bridges(result, -3.0))
    steps = np.diff([*angles, angles[0] + 2 * math.pi])
    assert steps == pytest.approx(2 * math.pi / 5, abs=1e-3)


@pytest.mark.parametrize(("spacing", "count"), [(1000.0, 2), (100.0, 4), (60.0, 6)])
def test_a_spacing_is_one_tab_for_so_many_mm_and_two_at_least(spacing, count) -> None:
    # The path is 2 (100 + 60) + 6 pi = 338.8 mm long.
    result = built([rectangle(0, 0, 100, 60)], tab_spacing=spacing)
    assert len(bridges(result, -3.0)) == count


def test_no_tab_comes_within_the_tools_radius_of_a_corner() -> None:
    corners = [(0, 0), (100, 0), (100, 60), (0, 60)]
    for count in range(1, 13):
        result = built([rectangle(0, 0, 100, 60)], tabs=count)
        line = middle(result.tour.paths[0])
        pieces = bridges(result, -2.5 - 1e-6)
        assert len(pieces) == count
        for piece in pieces:
            # What is held of the part's edge lies between the corners, the radius away from both.
            on = line.intersection(piece)
            for corner in corners:
                assert on.distance(shapely.Point(corner)) >= math.hypot(3, 3) - 0.02
        assert not [note for note in result.notes if "corner" in note.what]


def test_inner_corners_are_corners_too() -> None:
    ell = contour([(0, 0), (80, 0), (80, 30), (30, 30), (30, 80), (0, 80)])
    result = built([ell], tabs=8)
    line = middle(result.tour.paths[0])
    for piece in bridges(result, -2.5 - 1e-6):
        # The centre turns at (33, 33), the tool's radius away from the drawn corner.
        assert line.intersection(piece).distance(shapely.Point(33, 33)) >= 3.0 - 0.02


def test_where_every_place_is_near_a_corner_the_best_one_is_taken_and_told() -> None:
    # Sides of 10 mm are too short for a tab of 5 mm and a tool of 6: 5 + 6 = 11.
    side = 10.0
    radius = side / 2 / math.sin(math.pi / 8)
    points = [
        (radius * math.cos(k * math.pi / 4), radius * math.sin(k * math.pi / 4)) for k in range(8)
    ]
    result = built([contour(points)], tabs=2)
    assert [note.what for note in result.notes if "corner" in note.what] == [
        "tabs near corners on c1"
    ]
    pieces = bridges(result, -2.5 - 1e-6)
    assert len(pieces) == 2
    line = middle(result.tour.paths[0])
    for piece in pieces:
        # In the middle of a side, where it is 5 mm from both corners.
        centre = line.intersection(piece).interpolate(0.5, normalized=True)
        nearest_corners = sorted(math.dist((centre.x, centre.y), point) for point in points)[:2]
        assert nearest_corners == pytest.approx([math.hypot(5, 3)] * 2, abs=0.05)


def test_a_loop_that_is_too_short_for_its_tabs_says_so() -> None:
    result = built([circle(0, 0, 4)], tabs=6)
    (note,) = [note for note in result.notes if note.what.startswith("fewer")]
    assert note.what == "fewer tabs than requested on c1"
    # 2 pi 7 = 44 mm, of which each tab takes 5 + 6 + 2 x 1.5 = 14, beside the seam: three of them.
    assert len(bridges(result, -3.0)) == 3


def test_a_path_that_does_not_run_all_round_has_no_tabs_and_says_so() -> None:
    # The tool does not fit between the two squares, of which one is cut out; round the disc it does.
    beside = part(
        rectangle(0, 0, 40, 40, "c1"), rectangle(45, 0, 40, 40, "c2"), circle(150, 20, 20, "c3")
    )
    row = {
        "kind": "follow",
        "tool": "mill",
        "ids": ["c1", "c3"],
        "depth": 4.0,
        "tabs": 3,
        "tab_height": 1.5,
    }
    result = build(
        beside,
        post="gcode",
        job={"tools": [{"name": "mill", "diameter": 6.0, "speed": 9000}], "operations": [row]},
    )
    assert {path.contours: path.floor is not None for path in result.tour.paths} == {
        ("c1",): False,
        ("c3",): True,
    }
    (note,) = [note for note in result.notes if note.kind == "warning" and "tab" in note.what]
    assert note.what == "no tabs on 0:c1"


def test_no_tab_is_where_the_path_begins_or_its_leads_reach() -> None:
    for seam in range(6):
        shape = rounded(60 + seam, 40 + 3 * seam, 8)
        more = {"lead_in": 6.0, "lead_out": 9.0, "overlap": 4.0}
        # So many that there is one right beside the seam on both sides.
        result = built([shape], tabs=11, **more)
        (path,) = result.tour.paths
        assert not path.closed
        along = lengths_along(path)
        raised = path.floor > -4.0
        # The lead in is 6 mm of way, the lead out 9, and the loop is run again for 4 mm.
        assert along[raised].min() > 6.0
        assert along[raised].max() < along[-1] - 13.0
        # Leads sweep nothing of the bridges away: they have their whole width.
        line = middle(path)
        for piece in bridges(result, -2.5 - 1e-6):
            assert line.intersection(piece).length == pytest.approx(5.0, abs=0.02)


def test_holes_and_what_is_traced_inside_have_none() -> None:
    result = built([rounded(90, 60, 12), circle(30, 30, 12, "c2")], tabs=3)
    floors = {path.id: path.floor is not None for path in result.tour.paths}
    assert floors == {"c1": True, "c2": False}
    (note,) = [note for note in result.notes if "tab" in note.what]
    assert note.what == "3 tabs of 5 x 1.5 mm on c1"
    # The previews ring them, on the way of the tool's centre.
    outline = middle(next(path for path in result.tour.paths if path.id == "c1"))
    assert len(note.places) == 3
    assert all(outline.distance(shapely.Point(place)) < 1e-3 for place in note.places)


def test_an_operation_of_holes_alone_holds_their_slugs() -> None:
    inside = built([circle(30, 30, 12)], tabs=3, side="inside")
    assert [note.what for note in inside.notes if "tab" in note.what] == [
        "3 tabs of 5 x 1.5 mm on c1"
    ]


def test_a_part_in_a_window_and_the_window_have_tabs_beside_each_other() -> None:
    shapes = [rounded(120, 100, 12), circle(60, 50, 36, "c2"), circle(60, 50, 20, "c3")]
    result = built([*shapes, circle(15, 15, 8, "c4")], tabs=3)
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
    # Each tab of the window stands beside one of the part, as seen from their common middle.
    gaps = np.abs((angles[0][:, None] - angles[1] + 180) % 360 - 180).min(axis=1)
    assert gaps.max() < 15


@pytest.mark.parametrize("direction", ["climb", "conventional"])
def test_an_outer_contour_is_known_whichever_way_it_is_run(direction) -> None:
    result = built([rounded(90, 60, 12), circle(30, 30, 12, "c2")], tabs=3, direction=direction)
    assert {path.id for path in result.tour.paths if path.floor is not None} == {"c1"}


def test_a_finishing_path_has_its_tabs_where_the_first_one_has() -> None:
    """Two paths beside one contour, begun at other places: what one leaves the other must not cut."""
    job = {"operation": {"depth": 4.0, "tabs": 4, "tab_height": 1.5}, "process": PROCESS}
    shape = rounded(90, 60, 12)
    wide, near = (
        camgen.plan(part(shape), {**job, "tool": {"diameter": d}}).paths[0] for d in (6.6, 6.0)
    )
    near = replace(move_start(near, 3, 0.4), id="c1.finish")
    found, (note,) = add_tabs(
        [wide, near], [wide, near], camgen.job({**job, "tool": {"diameter": 6.0}})
    )
    assert note.what == "4 tabs of 5 x 1.5 mm on c1, c1.finish"
    places = []
    for path in found:
        along = lengths_along(path)
        tops = np.flatnonzero(path.floor > -4.0 + 1e-9)
        middles = [(along[a] + along[b]) / 2 for a, b in zip(tops[::2], tops[1::2], strict=True)]
        places.append(np.array([point_at(path, at)[:2] for at in middles]))
    assert len(places[0]) == len(places[1]) == 4
    apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2).min(axis=1)
    assert apart == pytest.approx(0.3, abs=1e-3)


# Whatever the numbers are.


@st.composite
def stars(draw: Any) -> Contour:
    """A simple polygon about the origin with some edges as arcs."""
    count = draw(st.integers(3, 9))
    radii = draw(st.lists(st.floats(25, 70), min_size=count, max_size=count))
    bulges = draw(st.lists(st.sampled_from([0.0, 0.0, 0.15, -0.1]), min_size=count, max_size=count))
    angles = [2 * math.pi * k / count for k in range(count)]
    return contour(
        [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)], bulges
    )


def test_tabs_that_stand_in_a_pass_before_a_ramp_are_proven() -> None:
    corners = [(25.0625, 0.0), (-12.5, 21.65), (-13.625, -23.6)]
    triangle = contour(corners, [0.0, 0.0, -0.1])
    tabs = {"tabs": 4, "tab_width": 8.4375, "tab_height": 2.28125}
    ramps = {"passes": 2, "entry": "ramp", "entry_angle": 20.0, "lead_in": 0.0, "lead_out": 0.0}
    result = built([triangle], 4.984375, **tabs, **ramps)
    # The passes are at -2 and -4 mm and the tabs reach up to -1.72 mm: both passes leave them.
    assert len(bridges(result, -1.71875 - 1e-6, 0)) == 4
    assert any(note.what.startswith("4 tabs") for note in result.notes)


@fewer(8)
@given(
    stars(),
    st.floats(2, 8),
    st.floats(1, 9),
    st.floats(0.2, 2.9),
    st.integers(1, 5),
    st.sampled_from([0.0, 5.0]),
)
def test_tabs_of_any_size_on_anything(shape, tool, width, height, count, lead) -> None:
    more = {
        "tabs": count,
        "tab_width": width,
        "tab_height": height,
        "passes": 2,
        "entry": "ramp",
        "entry_angle": 20.0,
    }
    try:
        result = built([shape], tool, lead_in=lead, lead_out=lead, **more)
    except NoSafeProgram:
        assume(False)
    for number, path in enumerate(result.tour.paths):
        if path.floor is None:
            continue
        told = sum(
            int(match[1])
            for note in result.notes
            if (match := re.match(r"(\d+) tabs? of", note.what))
        )
        pieces = bridges(result, -4.0 + height - 1e-6, number)
        if len(result.tour.paths) == 1:
            assert len(pieces) == told
        line = middle(path)
        for piece in pieces:
            # Where the way turns about a corner, the tool's discs reach around it.
            straight = not [note for note in result.notes if "corner" in note.what]
            if straight:
                assert line.intersection(piece).length == pytest.approx(width, abs=0.05 * width)
        for cut in work(result, number):
            steepest = 20.0 if cut.drop > 0 else 45.0
            angle = math.degrees(math.atan2(abs(cut.drop), cut.run))
            assert abs(cut.drop) < 1e-9 or angle <= steepest + 1e-6


# What is refused.


@pytest.mark.parametrize(
    ("tables", "said"),
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
def test_tabs_that_cannot_be_are_refused(tables, said) -> None:
    with pytest.raises(JobError) as error:
        build(BRACKET, post="rapid", job=tables)
    assert str(error.value).startswith(said)


# Pieces of paths.


def planned(shape: Contour, side: str = "outside") -> ToolPath:
    (path,) = camgen.plan(part(shape), {"operation": {"side": side}}).paths
    return path


# Short pieces of arcs are determined by three points to 1e-4 mm, a tenth of a printed digit.
@settings(derandomize=True)
@given(stars(), st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_a_path_is_the_same_way_however_it_is_cut(shape, parts) -> None:
    (path, *_) = camgen.plan(part(shape), {}).paths
    length = float(lengths_along(path)[-1])
    split = split_at(path, np.array(parts) * length)
    assert float(lengths_along(split)[-1]) == pytest.approx(length)
    for share in np.linspace(0.01, 0.99, 23):
        # A short piece of an arc is known by three points close together: its radius is less sure than they are.
        assert point_at(split, share * length) == pytest.approx(
            point_at(path, share * length), abs=1e-4
        )
    # Press is square to the travel at both ends of every piece, as it is planned.
    shape_of = camgen.geometry.arcs.make_span_chain(split.position, split.via[1:])
    for k, tangent in enumerate(shape_of.tangents()):
        assert np.abs(np.einsum("nd,nd->n", tangent, split.force_direction[1:, k])).max() < 1e-5
    begun = begin_at(path, parts[0] * length)
    assert begun.closed
    # At its own start the end of a closed path is as near as pieces of curves are that meet.
    assert begun.position[0] == pytest.approx(begun.position[-1], abs=2e-4)
    assert point_at(begun, 0.5 * length) == pytest.approx(
        point_at(path, (parts[0] + 0.5) % 1 * length), abs=1e-4
    )
    way = stretch(path, parts[0] * length, 2.3 * length)
    assert float(lengths_along(way)[-1]) == pytest.approx(2.3 * length)
    assert float(lengths_along(head(path, 0.3 * length))[-1]) == pytest.approx(0.3 * length)
    at, away = nearest(path, point_at(path, parts[0] * length))
    assert away == pytest.approx(0.0, abs=1e-4)
    assert point_at(path, at) == pytest.approx(point_at(path, parts[0] * length), abs=1e-4)


@pytest.mark.parametrize("chord", [0.1, 0.01, 0.001])
@pytest.mark.parametrize(("side", "low", "high"), [("outside", 0.0, 1.0), ("inside", 0.0, 1.0)])
def test_chords_leave_an_arc_by_the_tolerance_and_never_towards_the_part(
    chord, side, low, high
) -> None:
    path = planned(circle(0, 0, 20), side)
    flat = chorded(path, chord)
    assert np.isnan(flat.via).all()
    radius = 23.0 if side == "outside" else 17.0
    a, b = flat.position[:-1, :2], flat.position[1:, :2]
    middles = np.linalg.norm((a + b) / 2, axis=1)
    ends = np.linalg.norm(flat.position[:, :2], axis=1)
    away = np.concatenate([middles, ends]) - radius
    away = away if side == "outside" else -away
    assert away.min() >= low - 1e-6
    assert away.max() <= high * chord + 1e-6


def test_a_floor_runs_straight_on_between_its_waypoints() -> None:
    path = planned(rectangle(0, 0, 100, 60))
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


def test_neighbours_have_tabs_of_their_own() -> None:
    # The paths are 1 mm apart, nearer than the tool is wide.
    result = built([rectangle(0, 0, 60, 60, "c1"), rectangle(67, 0, 60, 60, "c2")], tabs=4)
    (text,) = [note.what for note in result.notes if " tabs of " in note.what]
    assert text.startswith("8 tabs of 5 x 1.5 mm on c")
    for number in (0, 1):
        assert len(bridges(result, -2.5 - 1e-6, number)) == 4


def test_tabs_keep_away_from_the_kerf_of_a_neighbour() -> None:
    """Two outlines 9 mm apart: kerfs of 6 mm meet between them, and a tab there holds nothing."""
    shapes = [rounded(60, 60, 6), drawn_at(rounded(60, 60, 6, "c2"), 69, 0)]
    result = built(shapes, tabs=3)
    (note,) = [note for note in result.notes if "tabs of" in note.what]
    assert len(note.places) == 6
    # The tool's centre runs at 63 mm and at 66 mm there, from 6 mm to 54 mm.
    assert not [place for place in note.places if 60 < place[0] < 69 and 3 < place[1] < 57]


def drawn_at(shape, x, y):
    return replace(shape, points=frozen(shape.points + np.array([x, y])))


def test_a_hole_without_a_slug_has_no_tab() -> None:
    """A path that is as short as this encloses nothing."""
    result = built([circle(30, 30, 3.02)], tabs=1, side="inside")
    assert [path.floor for path in result.tour.paths] == [None]


@pytest.mark.parametrize("narrow", [1.4, 3.1, 40.0])
def test_a_loop_comes_back_where_two_of_its_points_are_near_but_not_along_it(narrow: float) -> None:
    """Points on the sides of a rectangle, each compared with each."""
    corners = np.array([(0, 0), (50, 0), (50, narrow), (0, narrow), (0, 0)], dtype=float)
    along = np.append(0.0, np.cumsum(np.abs(np.diff(corners, axis=0)).sum(axis=1)))
    places = np.linspace(0.0, float(along[-1]), 211)
    points = np.column_stack([np.interp(places, along, corners[:, k]) for k in (0, 1)])
    gaps = np.abs(places[:, None] - places)
    gaps = np.minimum(gaps, places[-1] - gaps)
    near = np.hypot(*(points[:, None] - points).transpose(2, 0, 1)) <= 3.0
    expected = (near & (gaps > math.pi * 3.0)).any(axis=1)
    assert _are_narrow(points, places, 3.0).tolist() == expected.tolist()
    assert expected.any() == (narrow < 3.0)
