"""Paths along contours: side, direction, feed and force, and notes on contours without a path."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from msgspec.structs import replace

import camgen
from camgen.geometry.arcs import measure_path
from camgen.geometry.intersect import Obstacles
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.job import ImageTable, Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour
from camgen.model.path import ToolPath
from camgen.plan import Plan, plan
from camgen.read import read
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.swept import centre_line

ROOT = Path(__file__).parents[2]
SIX = ToolTable(diameter=6.0)


def plan_follow(*contours: Contour, **operation: object) -> Plan:
    job = Job(
        tool=SIX, operation=OperationTable(**operation), process=ProcessTable(feed=10.0, force=5.0)
    )
    return plan(part(*contours), job)


def measure_signed_area(path: ToolPath) -> float:
    """Signed area of the vertices and via points of a path, positive if counter-clockwise."""
    points = np.column_stack([path.via[:, :2], path.position[:, :2]]).reshape(-1, 2)
    x, y = points[~np.isnan(points[:, 0])].T
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2


def make_plate() -> tuple[Contour, ...]:
    return rectangle(0, 0, 100, 60, "c1"), circle(30, 30, 10, "c2")


def test_the_paths_run_outside_of_the_outline_and_inside_of_the_hole() -> None:
    outline, hole = plan_follow(*make_plate()).paths
    assert measure_path(outline) == pytest.approx(320 + 6 * math.pi)
    assert measure_path(hole) == pytest.approx(2 * math.pi * 7)
    assert (outline.id, hole.id) == ("c1", "c2")
    assert (outline.parent, hole.parent) == (-1, 0)


@pytest.mark.parametrize(("direction", "sign"), [("climb", -1), ("conventional", 1)])
def test_climb_milling_has_the_part_on_the_right(direction: str, sign: int) -> None:
    outline, hole = plan_follow(*make_plate(), direction=direction).paths
    assert np.sign(measure_signed_area(outline)) == sign
    assert np.sign(measure_signed_area(hole)) == -sign


@pytest.mark.parametrize("direction", ["climb", "conventional"])
def test_the_force_points_to_the_contour(direction: str) -> None:
    shapes = make_plate()
    obstacles = Obstacles(
        drawn := make_contour_segments(shapes), np.zeros(len(drawn), dtype=np.int64)
    )
    paths = plan_follow(*shapes, direction=direction).paths
    assert len(paths) == 2
    for path in paths:
        touching = path.position[1:, :2] + 3.0 * path.force_direction[1:, 1, :2]
        gap = obstacles.nearest(touching, np.zeros(len(touching), dtype=np.int64), 1.0)
        assert gap == pytest.approx(0.0, abs=1e-9)
        before = path.position[:-1, :2] + 3.0 * path.force_direction[1:, 0, :2]
        assert obstacles.nearest(
            before, np.zeros(len(before), dtype=np.int64), 1.0
        ) == pytest.approx(0.0, abs=1e-9)


def test_the_contact_point_keeps_the_feed_on_arcs() -> None:
    (path,) = plan_follow(rounded(60, 40, 5)).paths
    arc = ~np.isnan(path.via[1:, 0])
    # Outside a corner of 5 mm the centre of a 6 mm tool runs on 8 mm: 8/5 of the feed.
    assert path.feed[1:][arc] == pytest.approx(16.0)
    assert path.feed[1:][~arc] == pytest.approx(10.0)
    (hole,) = plan_follow(circle(0, 0, 10), side="inside").paths
    assert hole.feed == pytest.approx(7.0)


def test_the_feed_is_limited_and_the_force_off_at_a_sharp_corner() -> None:
    (path,) = plan_follow(rectangle(0, 0, 50, 50)).paths
    corner = ~np.isnan(path.via[1:, 0])
    assert corner.sum() == 4
    assert path.feed[1:][corner] == pytest.approx(20.0)
    assert path.force[1:][corner] == pytest.approx(0.0)
    assert path.force[1:][~corner] == pytest.approx(5.0)


def test_rounded_inner_corners_have_no_contact() -> None:
    (path,) = plan_follow(rectangle(0, 0, 50, 30), side="inside", corner_radius=2.0).paths
    arc = ~np.isnan(path.via[1:, 0])
    assert arc.sum() == 4
    chord = path.position[1:][arc] - path.position[:-1][arc]
    assert np.linalg.norm(chord, axis=1) == pytest.approx(2 * math.sqrt(2))
    assert measure_path(path) == pytest.approx(2 * (40 + 20) + 4 * math.pi)
    assert path.force[1:][arc] == pytest.approx(0.0)
    assert path.force[1:][~arc] == pytest.approx(5.0)


def test_a_corner_radius_does_not_change_a_convex_outline() -> None:
    (plain,) = plan_follow(rectangle(0, 0, 50, 50)).paths
    (round_,) = plan_follow(rectangle(0, 0, 50, 50), corner_radius=2.0).paths
    assert measure_path(round_) == pytest.approx(measure_path(plain))
    assert sorted(round_.force.tolist()) == sorted(plain.force.tolist())


def test_passes_reach_the_depth_in_equal_steps() -> None:
    (path,) = plan_follow(circle(0, 0, 10), depth=3.0, passes=3).paths
    assert path.depths == pytest.approx((1.0, 2.0, 3.0))


def test_a_hole_that_is_too_small_is_a_note() -> None:
    result = plan_follow(
        rectangle(0, 0, 100, 60), circle(20, 20, 2.5, "c2"), circle(40, 20, 3.0, "c3")
    )
    assert [p.id for p in result.paths] == ["c1"]
    (note,) = [n for n in result.notes if n.kind == "skipped"]
    assert "c2-c3" in note.what
    assert "6 mm tool does not fit" in note.why


def test_an_open_contour_is_left_out_unless_a_side_is_given() -> None:
    corner = contour([(0, 0), (50, 0), (50, 30)], closed=False)
    (note,) = plan_follow(corner).notes
    assert note.kind == "skipped"
    (right,) = plan_follow(corner, side="right").paths
    (left,) = plan_follow(corner, side="left").paths
    # On the outer side of the corner the path is longer by the arc.
    # On the inner side it is shorter by 3 mm twice.
    assert measure_path(right) == pytest.approx(80 + 1.5 * math.pi)
    assert measure_path(left) == pytest.approx(80 - 6)


def test_climb_runs_an_open_contour_with_the_part_on_the_right() -> None:
    line = contour([(0, 0), (50, 0)], closed=False)
    (left,) = plan_follow(line, side="left").paths
    (right,) = plan_follow(line, side="right").paths
    assert left.position[:, 0].tolist() == [0.0, 50.0]
    assert right.position[:, 0].tolist() == [50.0, 0.0]
    assert left.force_direction[1, 1].tolist() == pytest.approx([0, -1, 0])


def test_the_side_on_runs_along_the_contour() -> None:
    (path,) = plan_follow(rounded(60, 40, 5), side="on").paths
    assert measure_path(path) == pytest.approx(200 - 40 + 10 * math.pi)


def test_a_contour_that_crosses_another_is_left_out_by_name() -> None:
    result = plan_follow(
        rectangle(0, 0, 30, 30, "c1"), rectangle(20, 20, 30, 30, "c2"), circle(100, 0, 9, "c3")
    )
    assert [p.id for p in result.paths] == ["c3"]
    assert any("c1-c2" in n.what and "crossing" in n.what for n in result.notes)


def left_out(planned: Plan) -> list[tuple[tuple[str, ...], str]]:
    """Ids of the contours that are left out, and how the note calls them."""
    notes = [note for note in planned.notes if note.kind == "skipped"]
    return [(note.ids, note.what.split(", ")[1].split(":")[0]) for note in notes]


def test_a_path_that_would_cut_crossing_contours_is_left_out() -> None:
    """c2 lies inside of c3, which c4 crosses. The path beside c1 would cut c3."""
    crossing = rectangle(13, -1, 12, 17, "c3"), rectangle(14, 14, 10, 10, "c4")
    result = plan_follow(
        rectangle(0, 0, 10, 10, "c1"),
        rectangle(14, 0, 10, 10, "c2"),
        *crossing,
        rectangle(-20, 0, 10, 10, "c5"),
    )
    assert [path.id for path in result.paths] == ["c2", "c5"]
    assert left_out(result) == [
        (("c3", "c4"), "crossing each other"),
        (("c1",), "too near to crossing ones"),
    ]
    for path in result.paths:
        for other in crossing:
            assert centre_line(path).distance(shapely.linearrings(other.points)) >= 3


def test_a_roughing_pass_leaves_no_allowance_at_crossing_contours() -> None:
    """The gap is 6.5 mm: room for the tool of 6 mm beside an allowance of 0.5 mm."""
    plate, first = rectangle(0, 0, 40, 30, "plate"), rectangle(46.5, 0, 20, 10, "first")
    second = rectangle(56.5, 5, 20, 10, "second")
    result = plan_follow(plate, first, second, finish=0.5)
    assert [path.id for path in result.paths] == ["plate", "plate.finish"]


def test_contours_inside_crossing_ones_are_worked_as_far_as_the_tool_keeps_clear_of_them() -> None:
    """`slot` crosses `ring`. The path around `near`, outside of both, is 1 mm from `ring`."""
    ring, hole, island = circle(20, 40, 10, "ring"), circle(20, 40, 8, "hole"), circle(24, 42, 1)
    slot, near = rectangle(28, 20, 4, 20, "slot"), circle(7, 40, 2, "near")
    result = plan_follow(ring, hole, replace(island, id="island"), slot, near)
    assert [path.id for path in result.paths] == ["hole"]
    assert left_out(result) == [
        (("ring", "slot"), "crossing each other"),
        (("near",), "too near to crossing ones"),
    ]


def test_a_part_within_a_part_does_not_cost_the_part_around_it() -> None:
    """The hole between `plate` and `island` crosses `bridge`."""
    plate, hole = circle(0, 52, 8, "plate"), circle(0, 52, 4, "hole")
    bridge, island = circle(5, 55, 2, "bridge"), circle(5, 55, 1, "island")
    result = plan_follow(plate, hole, bridge, island)
    assert [path.id for path in result.paths] == ["plate"]
    assert left_out(result) == [
        (("hole", "bridge"), "crossing each other"),
        (("island",), "too near to crossing ones"),
    ]


@pytest.mark.parametrize(
    "back",
    [
        [(50, 25), (60, 25), (50, 25)],
        [(50, 25), (40, 25), (50, 25)],
        [(50, 25), (50, 15), (50, 25)],
    ],
    ids=["outward", "inward", "along"],
)
def test_a_contour_that_runs_back_over_itself_is_left_out_alone(
    back: list[tuple[int, int]],
) -> None:
    outline = [(10, 10), (50, 10), *back, (50, 40), (10, 40)]
    result = plan_follow(contour(outline), circle(100, 25, 9, "c2"))
    assert [path.id for path in result.paths] == ["c2"]
    (note,) = [note for note in result.notes if note.kind == "skipped"]
    assert "1 contour not followed, crossing or retracing themselves: c1" in note.what


def test_a_bridge_between_outline_and_hole_is_no_reason_to_leave_them_out() -> None:
    """One contour: 50 x 40 mm, to the hole of 20 x 15 mm and back."""
    outline = [(60, 10), (60, 50), (35, 50), (35, 40), (45, 40), (45, 25), (25, 25), (25, 40)]
    paths = plan_follow(contour([(10, 10), *outline, (35, 40), (35, 50), (10, 50)])).paths
    lengths = sorted(measure_path(path) for path in paths)
    assert lengths == pytest.approx([2 * (14 + 9), 2 * (50 + 40) + 6 * math.pi])


@pytest.mark.parametrize("miss", [0.0003, 0.0027])
def test_a_closing_line_that_runs_back_by_a_rounding_costs_no_path(miss: float) -> None:
    """An arc ends beyond the start of the outline, in the direction of the first line."""
    corners = [(31.816 + miss, 63.455), (31.533, 63.4524), (0, 60), (0, 0), (37.293, 0)]
    corners += [(37.293, 58.134), (31.816, 63.455)]
    outline = contour(corners, [0, 0, 0, 0, 0, 0.3995, 0])
    (path,) = plan_follow(outline).paths
    drawn = shapely.Polygon(flatten(make_contour_segments([outline]), 1e-4)[0]).buffer(0)
    assert path.closed
    assert measure_path(path) == pytest.approx(drawn.buffer(3, quad_segs=256).length, abs=0.02)


def test_a_path_beside_an_island_and_its_hole_is_run_before_the_outline() -> None:
    """One path runs round the island and along the hole. More of it is beside the island."""
    plate, hole = rectangle(0, 0, 100, 60, "c1"), rectangle(20, 10, 40, 36, "c2")
    island = [(24, 18), (50, 18), (50, 24), (32, 24), (32, 32), (50, 32), (50, 38), (24, 38)]
    paths = plan_follow(plate, hole, contour(island, name="island")).paths
    assert {path.id: path.parent for path in paths} == {"c1": -1, "island": 0}
    assert set(paths[1].contours) == {"island", "c2"}


def test_a_note_gives_the_length_that_the_tool_cannot_touch() -> None:
    # A hole of 40 x 20 mm has sharp corners, and the mill has a radius of 3 mm.
    # At x mm from a corner the mill leaves sqrt(3^2 + (3 - x)^2) - 3 mm. More than 0.02 mm counts.
    each = 3 - math.sqrt(3.02**2 - 3**2)
    result = plan_follow(rectangle(0, 0, 40, 20), side="inside")
    (note,) = result.notes
    assert note.kind == "warning"
    assert float(note.what.split(" ")[0]) == pytest.approx(8 * each, abs=0.5)
    assert " mm of 120 mm of contour not touched" in note.what


def test_a_trace_runs_along_every_contour() -> None:
    job = Job(operation=OperationTable(kind="trace"), process=ProcessTable(feed=10.0))
    result = plan(part(circle(0, 0, 10), contour([(0, 0), (3, 4)], closed=False)), job)
    assert [measure_path(p) for p in result.paths] == pytest.approx([20 * math.pi, 5.0])
    assert not any(p.force_direction.any() for p in result.paths)


@pytest.mark.parametrize("diameter", [1.0, 3.0, 6.0])
@pytest.mark.parametrize("digits", [2, 4])
def test_an_outline_of_rounded_numbers_has_one_closed_path(diameter: float, digits: int) -> None:
    """Rounded numbers make corners that are nearly tangent, and the path is closed nevertheless."""
    t = np.linspace(0, math.pi / 2, 12)
    arc = 1.15 * np.column_stack([np.cos(t), np.sin(t)])
    corners = []
    for k, centre in enumerate([(60.0, 40.0), (0.0, 43.0), (-3.0, 0.0), (57.0, -5.0)]):
        c, s = math.cos(k * math.pi / 2), math.sin(k * math.pi / 2)
        corners.append(arc @ np.array([[c, s], [-s, c]]) + centre)
    outline = contour(np.concatenate(corners).round(digits).tolist())
    job = Job(tool=ToolTable(diameter=diameter))
    result = plan(part(outline), job)
    assert [(p.id, p.closed) for p in result.paths] == [("c1", True)]
    assert not [n for n in result.notes if n.kind == "skipped"]


def test_neighbours_with_a_common_edge_have_one_path_around_both() -> None:
    result = plan_follow(rectangle(0, 0, 20, 20), rectangle(0, 20, 20, 20, "c2"))
    (path,) = result.paths
    assert path.closed
    assert np.ptp(path.position[:, :2], axis=0) == pytest.approx([26.0, 46.0])
    note = result.notes[0]
    assert note.what == "common edges not followed: c1-c2"
    assert note.why.startswith("edges on one line leave the tool no side")
    assert not [n for n in result.notes if n.kind == "skipped"]


@pytest.mark.parametrize(
    ("upper", "lower"),
    [
        ((50, 50, 20, 10), (55, 30, 10, 20)),
        ((45, 60, 10, 10), (51, 50, 20, 10)),
        ((20, 50, 10, 30), (10, 20, 20, 30)),
    ],
)
def test_no_path_beside_a_common_edge_runs_into_the_other_contour(
    upper: tuple[int, int, int, int], lower: tuple[int, int, int, int]
) -> None:
    """Inside of the lower one the mill has room, and is 3 mm from the common edge too."""
    result = plan_follow(rectangle(*upper, "c1"), rectangle(*lower, "c2"))
    (path,) = result.paths
    boxes = [shapely.box(x, y, x + w, y + h) for x, y, w, h in (upper, lower)]
    both = shapely.union_all(boxes)
    assert path.closed
    assert centre_line(path).distance(both) == pytest.approx(3, abs=1e-3)
    assert shapely.Polygon(centre_line(path)).contains(both)


#: An arc that ends in a cusp of 179.2 deg and crosses the next one again 0.16 mm before it.
CUSP = ([(-27.9, -9.5), (2.7, -29.7), (42.5, -19.4), (45.9, -7.2)], [0.0, -0.65, -0.51, 0.0])


@pytest.mark.parametrize("diameter", [0.5, 1.0, 3.0, 6.0, 20.0])
def test_a_cusp_that_crosses_itself_is_run_around(diameter: float) -> None:
    """GEOS computes the length of the path around the cusp and a circle next to it."""
    neighbour = circle(42.5 + 4 + diameter * 0.7, -22.0, 4, "c2")
    result = plan(part(contour(*CUSP), neighbour), Job(tool=ToolTable(diameter=diameter)))
    assert not [note for note in result.notes if note.kind == "skipped"]
    areas = [
        shapely.make_valid(shapely.Polygon(flatten(make_contour_segments([c]), 1e-4)[0]))
        for c in (contour(*CUSP), neighbour)
    ]
    border = shapely.union_all(areas).buffer(diameter / 2, quad_segs=300).boundary
    assert sum(map(measure_path, result.paths)) == pytest.approx(border.length, rel=1e-4)


def make_horn() -> Contour:
    """A hole between a line and an arc that is tangent to it, so that it ends in a tip of 0 deg."""
    end = (30 * math.sin(0.9), 30 - 30 * math.cos(0.9))
    return contour([(0, 0), (end[0], 0), end], [0, 0, -math.tan(0.9 / 4)])


@pytest.mark.parametrize("diameter", [0.5, 1.0, 2.0])
def test_the_path_in_a_tip_between_tangent_sides_is_closed_and_shorter(diameter: float) -> None:
    job = Job(tool=ToolTable(diameter=diameter), operation=OperationTable(side="inside"))
    result = plan(part(make_horn()), job)
    assert [path.closed for path in result.paths] == [True]
    assert not [note for note in result.notes if note.kind == "skipped"]
    (outside,) = plan(part(make_horn()), Job(tool=ToolTable(diameter=diameter))).paths
    assert measure_path(outside) > measure_path(result.paths[0])


@pytest.mark.parametrize("gap", [0.001, 0.005, 0.02, 0.15])
def test_a_hole_that_the_tool_just_fits_has_its_path(gap: float) -> None:
    shapes = [
        circle(20, 20, 3 + gap / 2, "c2"),
        rectangle(40, 20, 6 + gap, 6 + gap, "c3"),
        contour([(60, 20), (70, 20), (70, 26 + gap), (60, 26 + gap)], [0, 1, 0, 1], name="c4"),
    ]
    result = plan_follow(rectangle(0, 0, 100, 60), *shapes)
    assert {p.id: p.closed for p in result.paths} == dict.fromkeys(["c1", "c2", "c3", "c4"], True)
    lengths = [math.pi * gap, 4 * gap, math.pi * gap + 20]
    assert [measure_path(p) for p in result.paths[1:]] == pytest.approx(lengths, rel=1e-6)


def test_a_hole_as_wide_as_the_tool_has_no_path() -> None:
    result = plan_follow(rectangle(0, 0, 100, 60), circle(20, 20, 3.0, "c2"))
    (note,) = [n for n in result.notes if n.kind == "skipped"]
    assert "too narrow" in note.what


Corners = list[tuple[float, float, float]]
#: A tool and two contours that it can just not pass between; x, y and bulge of their corners.
PAIRS: list[tuple[float, Corners, Corners]] = [
    (
        3.0,
        [(51.235, 4.63, 0.28), (54.05, -13.627, 0), (68.776, -1.612, 0), (65.587, 2.754, -0.33),
         (66.795, 7.645, -0.46), (60.786, 8.653, 0.59), (60.758, 9.162, 0.1), (60.372, 11.704, 0)],
        [(16.8, 2.2, 0), (8.4, 28.7, 0.7360652784094979), (30.1, 44.0, 0), (47.8, -8.3, 0)],
    ),
    (
        10.0,
        [(19.9, 0.2, -0.35), (9.4, 5.6, -0.45), (3.2, 27.5, 0), (-2.9, 18, 0), (-15.9, 15, 0),
         (-21.9, 19.1, -0.03), (-18.1, 6.6, 0), (-20.6, 1.5, 0.03), (-10.6, -9.8, 0),
         (19.7, -9, 0.69), (27.3, -3.8, 0.64)],
        [(55.975, -2.993, 0), (49.634, -7.891, -0.43), (46.303, -6.99, -0.23),
         (41.965, -8.198, -0.34), (39.127, -10.341, 0), (36.96, -0.328, 0), (37.372, 3.272, 0),
         (41.049, 7.514, 0.34), (42.913, 11.619, 0.03), (46.877, 11.423, -0.33),
         (50.872, 12.52, -0.02)],
    ),
]  # fmt: skip


def make_bent(corners: Corners, name: str) -> Contour:
    return contour([row[:2] for row in corners], [row[2] for row in corners], name=name)


@pytest.mark.parametrize(("diameter", "first", "second"), PAIRS)
def test_neighbours_that_the_tool_can_just_not_pass_between_have_common_paths(
    diameter: float, first: Corners, second: Corners
) -> None:
    """At the narrowest place the offset curves meet a few micrometres before a corner."""
    shapes = make_bent(first, "c1"), make_bent(second, "c2")
    result = plan(part(*shapes), Job(tool=ToolTable(diameter=diameter)))
    assert result.paths
    assert all(path.closed for path in result.paths)
    assert not [note for note in result.notes if note.kind == "skipped"]


def test_a_contour_that_encloses_no_area_is_left_out() -> None:
    back = contour([(120.0, 0.0), (150.0, 0.0), (150.0, 10.0), (150.0, 0.0)], name="c9")
    result = plan_follow(*make_plate(), back)
    assert [path.contours for path in result.paths] == [("c1",), ("c2",)]
    (note,) = [note for note in result.notes if note.ids == ("c9",)]
    assert note.kind == "skipped"
    assert "without an inside" in note.what


def test_a_hole_comes_before_the_first_path_of_its_outline() -> None:
    # The mill does not pass through the gap of 4 mm, so the outline has one path around it
    # and one in the area after the gap.
    around = [(40, 42), (100, 42), (100, 80), (0, 80), (0, 0), (100, 0), (100, 38), (40, 38)]
    area = [(40, 10), (30, 10), (30, 70), (40, 70)]
    outline = contour([*around, *area], name="c1")
    result = plan_follow(outline, circle(15, 40, 8, "c2"))
    ids = [path.id for path in result.paths]
    hole = result.paths[ids.index("c2")]
    outer = [index for index, path in enumerate(result.paths) if "c1" in path.contours]
    assert len(outer) == 2
    assert hole.parent == min(outer)


def test_the_paths_of_one_contour_are_numbered_from_one() -> None:
    # Two areas of 20 mm are joined by a passage of 4 mm, in which a tool of 6 mm does not fit.
    lower = [(0, 0), (20, 0), (20, 8), (30, 8), (30, 0), (50, 0)]
    upper = [(50, 20), (30, 20), (30, 12), (20, 12), (20, 20), (0, 20)]
    paths = plan_follow(contour(lower + upper), side="inside").paths
    assert [path.id for path in paths] == ["c1.1", "c1.2"]


@pytest.mark.parametrize("diameter", [5.9, 5.99, 6.0, 6.01, 7.0, 12.0])
def test_a_path_along_an_open_spiral_ends_where_the_tool_meets_its_beginning(diameter):
    """A spiral of one turn starts at (55, 40), and its end lies 6 mm outside of its start.

    A tool of 6 mm or more does not reach the end: its centre stops one radius from (55, 40).
    """
    angle = np.linspace(0, 2 * np.pi, 61)
    radius = 15 + 6 * angle / (2 * np.pi)
    chain = np.column_stack([40 + radius * np.cos(angle), 40 + radius * np.sin(angle)])
    job = {"operation": {"kind": "follow", "side": "left"}, "tool": {"diameter": diameter}}
    result = camgen.build(camgen.part(chain), post="rapid", job=job)
    assert result.motion is not None
    assert not result.motion.unproven
    ends = np.concatenate([path.table[[0, -1], :2] for path in result.tour.paths])
    gaps = np.linalg.norm(ends - (55, 40), axis=1)
    assert gaps.min() > diameter / 2 - 1e-6
    if diameter > 6:
        assert gaps.max() == pytest.approx(diameter / 2, abs=1e-4)


def test_a_note_names_an_arc_on_which_the_feed_factor_slows_down_the_contact_point() -> None:
    """The centre of a tool of 10 mm runs around an arc of 2 mm on a radius of 7 mm.

    So it is 3.5 times as fast as the contact point. With a factor of 2 the contact point runs at
    10 * 2 / 3.5 = 5.7 mm/s.
    """
    job = Job(tool=ToolTable(diameter=10.0), process=ProcessTable(feed=10.0, force=5.0))
    note = plan(part(rounded(40, 30, 2)), job).notes[-1]
    assert str(note) == (
        "warning: outer arcs slower than process.feed: the contact point runs at 5.7 of 10 mm/s on "
        "c1 (the tool would run 3.5 times as fast, and process.max_feed_factor = 2)"
    )
    assert not plan(part(rounded(40, 30, 6)), job).notes


@pytest.mark.parametrize("diameter", [0.7, 1.0])
def test_the_paths_of_a_picture_with_rounded_corners_are_closed(diameter: float) -> None:
    # Arcs of its outlines meet at angles of 0.00001 rad, and offset curves have gaps of 0.0001 mm.
    job = Job(
        image=ImageTable(mm_per_px=0.1),
        tool=ToolTable(diameter=diameter),
        operation=OperationTable(corner_radius=diameter / 4),
    )
    result = plan(read(ROOT / "fixtures" / "parts" / "board.png", job), job)
    assert not [note for note in result.notes if "failed" in note.what or "left out" in note.what]
    assert all(path.closed for path in result.paths)


@pytest.mark.parametrize("overlap", [0.005, 0.01, 0.5])
def test_contours_that_overlap_slightly_are_left_out_with_the_reason(overlap: float) -> None:
    result = plan_follow(rectangle(0, 0, 20, 20, "c1"), rectangle(20 - overlap, 3, 40, 13, "c2"))
    (note,) = [note for note in result.notes if note.kind == "skipped"]
    assert "crossing each other: c1-c2" in note.what


def test_a_small_circle_over_a_corner_or_over_an_outline_crosses_it() -> None:
    """Areas with a rounding of 0.02 mm do not show that."""
    plate, others = rectangle(0, 0, 60, 40, "c1"), [circle(100, 0, 9, "c2")]
    beyond = circle(30, 1.98, 2, "c3")  # 0.02 mm of it are outside of the plate
    corner = circle(60.7, 40.7, 1, "c3")  # 0.01 mm of the corner are inside
    for small in (beyond, corner):
        result = plan_follow(plate, *others, small)
        assert [path.id for path in result.paths] == ["c2"]
        (note,) = [note for note in result.notes if note.kind == "skipped"]
        assert "crossing each other: c1, c3" in note.what


def test_an_island_in_a_hole_that_is_left_out_is_worked_before_the_outline() -> None:
    plate, hole = rectangle(0, 0, 100, 60, "c1"), circle(40, 30, 20, "c2")
    result = plan_follow(plate, hole, circle(60, 30, 3, "c3"), circle(35, 30, 5, "island"))
    parents = {path.id: path.parent for path in result.paths}
    names = [path.id for path in result.paths]
    assert parents == {"c1": -1, "island": names.index("c1")}


def test_a_contour_that_crosses_itself_slightly_is_left_out_with_the_reason() -> None:
    corners = [(0, 0), (20, 0), (20, 10), (10, 10.01), (10.01, 10.02), (10.01, 10), (0, 10)]
    result = plan_follow(contour(corners, [0.0] * 7))
    (note,) = [note for note in result.notes if note.kind == "skipped"]
    assert "crossing themselves: c1" in note.what
    assert "report" not in note.why


def test_a_path_around_two_contours_with_a_common_edge_works_on_both() -> None:
    """A mill at the common edge would cut into one of the two parts, so the edge stays."""
    left, right = shapely.box(0, 0, 30, 20), shapely.box(30, 0, 70, 20)
    result = plan_follow(rectangle(0, 0, 30, 20, "left"), rectangle(30, 0, 40, 20, "right"))
    (path,) = result.paths
    assert set(path.contours) == {"left", "right"}
    assert measure_path(path) == pytest.approx(2 * (70 + 20) + 2 * math.pi * 3)
    assert centre_line(path).distance(shapely.union(left, right)) == pytest.approx(3.0, abs=0.002)
    assert any("40 mm of 220 mm of contour not touched" in note.what for note in result.notes)
    for x, neighbour in ((27.0, left), (33.0, right)):
        disc = shapely.Point(x, 10.0).buffer(3.0)
        assert neighbour.contains(disc)


def test_a_contour_that_is_followed_in_part_is_named_beside_others_that_are_not_followed() -> None:
    """The outline `a` runs back over itself. `c` and `d` overlap by less than a crossing."""
    outline = [(90, 140), (50, 190), (0, 190), (0, 40), (16, 40), (16, 60), (24, 60), (24, 40)]
    outline += [(40, 40), (40, 100), (0, 100), (90, 100)]
    second = [(80, 40), (64, 40), (64, 20), (56, 20), (56, 40), (40, 40), (40, 0), (80, 0)]
    notes = plan_follow(
        contour(outline, name="a"),
        contour(second, name="b"),
        rectangle(500, 0, 20, 20, "c"),
        rectangle(519.996, 3, 40, 13, "d"),
    ).notes
    skipped = {note.what.split(",")[0]: note.ids for note in notes if note.kind == "skipped"}
    assert skipped["2 contours not followed"] == ("c", "d")
    assert skipped["2 pieces of path left out"] == ("a",)
