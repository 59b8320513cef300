"""Pockets: the tool clears all that it can reach and cuts nothing else, not on its links either.

Also tested: the order and direction of the passes, the engagement of the tool, and the notes.
"""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

import camgen
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour
from camgen.pipeline import Result
from camgen.plan import Plan, plan
from tests.support.drawn import circle, clockwise, contour, part, rectangle, rounded
from tests.support.examples import fewer
from tests.support.swept import centre_line, enclosed, outline, reachable, swept

RADIUS = 3.0
SHAPES = {
    "rectangle": (rectangle(0, 0, 100, 60),),
    "drawn clockwise": (clockwise(rectangle(0, 0, 100, 60)),),
    "circle": (circle(0, 0, 30),),
    "rounded": (rounded(80, 50, 12),),
    "an L": (contour([(0, 0), (80, 0), (80, 25), (25, 25), (25, 70), (0, 70)]),),
    "a thin wedge": (contour([(0, 0), (100, 0), (10, 30)]),),
    "a star": (
        contour(
            [
                (math.cos(t) * size, math.sin(t) * size)
                for t, size in zip(np.arange(14) * math.pi / 7, [50, 20] * 7, strict=True)
            ]
        ),
    ),
    "two basins and a neck": (
        contour([(0, 0), (40, 0), (40, 16), (60, 16), (60, 0), (110, 0),
                 (110, 40), (60, 40), (60, 24), (40, 24), (40, 40), (0, 40)]),
    ),
    "two basins and a neck too narrow": (
        contour([(0, 0), (40, 0), (40, 17.5), (60, 17.5), (60, 0), (110, 0),
                 (110, 40), (60, 40), (60, 22.5), (40, 22.5), (40, 40), (0, 40)]),
    ),
    "an island": (rectangle(0, 0, 100, 60), circle(40, 30, 10, "c2")),
    "islands": (
        rectangle(0, 0, 100, 60), rectangle(30, 20, 20, 20, "c2"), circle(75, 30, 10, "c3"),
    ),
    "a pocket in an island": (circle(0, 0, 60), circle(5, 0, 40, "c2"), rounded(30, 20, 4, "c3")),
    "an island near the wall": (rectangle(0, 0, 60, 60), circle(16, 30, 12, "c2")),
}  # fmt: skip


def make_job(**operation: object) -> Job:
    table = OperationTable(kind="pocket", **operation)  # type: ignore[arg-type]
    return Job(
        tool=ToolTable(diameter=2 * RADIUS), operation=table, process=ProcessTable(feed=10.0)
    )


def plan_pocket(*contours: Contour, **operation: object) -> Plan:
    return plan(part(*contours), make_job(**operation))


def build_pocket(diameter: float, *contours: Contour, **operation: object) -> Result:
    """A program of a pocket for a mill of this diameter."""
    tables = {"operation": {"kind": "pocket", **operation}, "tool": {"diameter": diameter}}
    tables["process"] = {"spindle": 9000.0}
    return camgen.build(part(*contours), post="gcode", job=tables)


def measure_faults(contours: tuple[Contour, ...], planned: Plan) -> tuple[float, float]:
    """Area that the tool can reach and did not clear, and area that it cut outside the walls, mm2.

    Strips narrower than 0.01 mm that are not cleared do not count.
    Cuts up to 0.005 mm beyond a wall do not count either.
    """
    region, covered = enclosed(contours), swept(planned.paths, RADIUS)
    bare = reachable(region, RADIUS).difference(covered).buffer(-0.005)
    return bare.area, covered.difference(region.buffer(0.005)).area


@pytest.mark.parametrize("stepover", [0.3, 0.5, 0.7, 0.95])
@pytest.mark.parametrize("name", SHAPES)
def test_all_that_the_tool_reaches_is_cut_and_nothing_else(name: str, stepover: float) -> None:
    planned = plan_pocket(*SHAPES[name], stepover=stepover)
    assert measure_faults(SHAPES[name], planned) == (0.0, 0.0)
    assert not [note for note in planned.notes if note.kind == "skipped"]


@pytest.mark.parametrize("name", SHAPES)
def test_roughing_and_finishing_passes_together_clear_the_pocket(name: str) -> None:
    planned = plan_pocket(*SHAPES[name], finish=0.4, depth=6.0, passes=3)
    assert measure_faults(SHAPES[name], planned) == (0.0, 0.0)
    rough = [path for path in planned.paths if ".finish" not in path.id]
    region = enclosed(SHAPES[name])
    assert swept(rough, RADIUS).difference(region.buffer(-0.395)).area == 0.0
    last = [path for path in planned.paths if ".finish" in path.id]
    assert {path.depths for path in last} == {(6.0,)} or name in (
        "two basins and a neck",
        "an island near the wall",
    )
    assert all(path.closed for path in last)


def test_a_finishing_pass_without_roughing_passes_goes_down_in_steps() -> None:
    slot = (rounded(60, 6.5, 3.2),)
    planned = plan_pocket(*slot, finish=0.4, depth=6.0, passes=3)
    (path,) = planned.paths
    assert path.id == "c1.finish"
    assert path.depths == (2.0, 4.0, 6.0)
    assert measure_faults(slot, planned) == (0.0, 0.0)


@st.composite
def draw_pockets(draw: st.DrawFn) -> tuple[Contour, ...]:
    """A polygon around the origin, some of its sides arcs, with up to three islands.

    An island may cross the wall or lie outside of it.
    """

    def star(x: float, y: float, low: float, high: float, name: str) -> Contour:
        count = draw(st.integers(3, 9))
        sizes = [draw(st.floats(low, high)) for _ in range(count)]
        turns = [draw(st.floats(0.2, 0.8)) for _ in range(count)]
        angles = [2 * math.pi * (k + turn) / count for k, turn in enumerate(turns)]
        points = [
            (x + r * math.cos(t), y + r * math.sin(t)) for r, t in zip(sizes, angles, strict=True)
        ]
        bulges = [draw(st.sampled_from([0.0, 0.0, 0.2, -0.2])) for _ in range(count)]
        return contour(points, bulges, name=name)

    shapes = [star(0, 0, 20, 70, "c1")]
    for k in range(draw(st.integers(0, 3))):
        angle = 2 * math.pi * k / 3
        shapes.append(star(18 * math.cos(angle), 18 * math.sin(angle), 2, 12, f"c{k + 2}"))
    return tuple(shapes)


@fewer(8)
@given(draw_pockets(), st.floats(0.2, 0.95))
def test_random_pockets_with_islands_are_cleared_or_left_out_with_a_note(
    shapes: tuple[Contour, ...], stepover: float
) -> None:
    assume(all(outline(shape).is_valid for shape in shapes))
    planned = plan_pocket(*shapes, stepover=stepover)
    left_out: set[str] = set()
    for note in planned.notes:
        if note.kind == "skipped":
            left_out.update(note.ids)
    cut = tuple(shape for shape in shapes if shape.id not in left_out)
    if "c1" in left_out:
        # Without the outer wall, only its islands can be pockets.
        assert all("c1" not in path.contours for path in planned.paths)
        return
    # An island that crosses the wall would have been left out together with the wall.
    # So each island that was left out alone overlaps the wall in a strip of 0.02 mm or less.
    outer, strip_width = outline(shapes[0]), 0.02
    for shape in shapes:
        if shape.id in left_out:
            island = outline(shape)
            overlap = outer.intersection(island).area
            assert overlap <= strip_width * min(outer.length, island.length)
    assert measure_faults(cut, planned) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("direction", "wall_on_the_right"), [("climb", True), ("conventional", False), ("any", True)]
)
def test_climb_milling_has_the_walls_on_the_right(direction: str, wall_on_the_right: bool) -> None:
    shapes = SHAPES["a pocket in an island"]
    walls = enclosed(shapes).boundary
    tested = 0
    for path in plan_pocket(*shapes, direction=direction).paths:
        for a, b in pairwise(shapely.get_coordinates(centre_line(path))):
            middle = shapely.Point((a + b) / 2)
            if walls.distance(middle) < RADIUS + 0.001 and np.hypot(*(b - a)) > 0.02:
                foot = shapely.get_coordinates(shapely.shortest_line(middle, walls))[1]
                along, aside = b - a, foot - (a + b) / 2
                assert (along[0] * aside[1] - along[1] * aside[0] < 0) == wall_on_the_right
                tested += 1
    assert tested > 100


def test_passes_are_arcs_where_the_walls_are() -> None:
    (path,) = plan_pocket(circle(0, 0, 30), stepover=0.5, engagement=1.0).paths
    radii = np.hypot(*path.via[~np.isnan(path.via[:, 0]), :2].T)
    # The stepover is the tool radius, 3 mm. The first pass lies one tool radius inside the wall.
    assert np.unique(np.round(radii, 6)).tolist() == np.arange(3.0, 28.0, 3.0).tolist()
    from_middle = np.hypot(*path.position[:, :2].T)
    assert (np.diff(from_middle) > -1e-6).all()


def test_each_basin_has_one_entry_and_the_larger_basin_comes_last() -> None:
    shapes = SHAPES["two basins and a neck"]
    left, right = plan_pocket(*shapes, depth=4.0, passes=2, engagement=1.0).paths
    assert (left.id, right.id) == ("c1.1", "c1.2")
    # The larger basin continues with the passes around both basins.
    assert (left.parent, right.parent) == (1, -1)
    assert centre_line(right).bounds[0] == pytest.approx(3.0)
    for path in (left, right):
        assert path.depths == (2.0, 4.0)
        assert not path.closed
        assert not path.reversible
        assert (path.position[:, 2] == 0).all()
    (alone,) = plan_pocket(*SHAPES["an L"], stepover=0.4).paths
    assert alone.id == "c1"


@pytest.mark.parametrize(("radius", "entry_radius"), [(4.0, 1.0), (5.0, 2.0), (30.0, 2.7)])
def test_the_helix_of_the_entry_stays_in_the_pocket(radius: float, entry_radius: float) -> None:
    (path,) = plan_pocket(circle(2, 1, radius)).paths
    # In a circle: its radius minus the radius of the tool, at most 0.45 tool diameters.
    assert path.entry_radius == pytest.approx(entry_radius, abs=0.02)
    assert math.dist(path.position[0, :2], (2, 1)) < max(
        0.02, radius - RADIUS - entry_radius + 0.02
    )


@pytest.mark.parametrize("name", SHAPES)
def test_the_tool_on_the_helix_never_touches_a_wall(name: str) -> None:
    region = enclosed(SHAPES[name])
    paths = plan_pocket(*SHAPES[name], finish=0.2).paths
    assert any(path.entry_radius > 1.0 for path in paths)
    for path in paths:
        if path.entry_radius:
            entry_point = shapely.Point(path.position[0, :2])
            assert region.contains(entry_point)
            assert region.boundary.distance(entry_point) >= path.entry_radius + RADIUS + 0.2 - 0.005


def find_note(planned: Plan, word: str) -> str:
    """The text of the only note that holds a word."""
    (text,) = [str(note) for note in planned.notes if word in str(note)]
    return text


def test_the_engagement_on_the_passes_of_a_circle_follows_from_their_curvature() -> None:
    # The engagement is highest on the smallest of these passes, which has a radius of 6 mm.
    planned = plan_pocket(circle(0, 0, 30), stepover=0.5, engagement=1.0)
    shares = []
    for ring in np.arange(6.0, 28.0, 3.0):
        cosine = (ring**2 + RADIUS**2 - ring**2) / (2 * ring * RADIUS)
        # The law of cosines gives the angle at which the tool's edge leaves the cleared circle.
        # It is measured from the side of the wall.
        shares.append((1 - math.cos(math.pi - math.acos(cosine))) / 2)
    highest = 100 * max((1 + RADIUS / (2 * ring)) / 2 for ring in np.arange(6.0, 28.0, 3.0))
    assert 100 * max(shares) == pytest.approx(highest)
    text = find_note(planned, "engagement")
    rounded_up = math.ceil(highest + 0.5)
    assert f"{highest:.0f} % at most" in text or f"{rounded_up:.0f} % at most" in text


def test_the_engagement_along_a_straight_wall_is_the_stepover() -> None:
    text = find_note(
        plan_pocket(rectangle(0, 0, 400, 300), stepover=0.4, engagement=1.0), "engagement"
    )
    assert "c1: " in text
    assert (
        "2.4 mm apart, engagement 40 % of the diameter or less on half" in text
        or "engagement 41 % of" in text
    )
    # In a square corner the whole front half of the tool is in the material.
    assert "100 % at most" in text


def test_a_note_gives_the_rest_material_in_the_corners() -> None:
    text = find_note(plan_pocket(rectangle(0, 0, 100, 60)), "not cleared")
    # In each corner: a square of the tool radius minus a quarter of the tool's disc.
    assert f"{(4 - math.pi) * RADIUS**2:.2f} mm2 of 6000 mm2" in text
    assert "4 places" in text
    assert not [note for note in plan_pocket(circle(0, 0, 20)).notes if "not cleared" in str(note)]


def test_the_note_of_a_neck_too_narrow_gives_its_place() -> None:
    planned = plan_pocket(*SHAPES["two basins and a neck too narrow"])
    (note,) = [note for note in planned.notes if "not cleared" in note.what]
    # The neck of 20 x 5 mm is the largest rest material.
    # The tool reaches a little into both of its ends.
    assert any(40 < x < 60 and 17.5 < y < 22.5 for x, y in note.places)
    assert note.ids == ("c1",)


def test_a_pocket_too_narrow_is_left_out_by_name() -> None:
    planned = plan_pocket(rectangle(0, 0, 40, 5.9, "c1"), circle(0, 40, 20, "c2"))
    assert {path.contours for path in planned.paths} == {("c2",)}
    note = find_note(planned, "narrow:")
    assert "1 contour not cleared, too narrow: c1 on layer 0" in note
    assert "(it is 5.9 mm wide, a 6 mm tool does not fit)" in note


@pytest.mark.parametrize(
    "inside",
    [
        contour([(20, 20), (30, 30), (30, 20), (20, 30)], name="c2"),
        contour([(20, 20), (30, 30), (30, 20)], closed=False, name="c2"),
        contour([(20, 20), (30, 20)], name="c2"),
    ],
    ids=["crossing itself", "open", "without an inside"],
)
def test_a_pocket_with_an_unclear_contour_inside_is_left_out(inside: Contour) -> None:
    planned = plan_pocket(rectangle(0, 0, 60, 40), inside, rectangle(100, 0, 50, 50, "c3"))
    assert {path.contours for path in planned.paths} == {("c3",)}
    left_out = [note.ids for note in planned.notes if note.kind == "skipped"]
    assert sorted(left_out) == [("c1",), ("c2",)]


def test_a_pocket_whose_island_crosses_the_wall_by_a_sliver_is_left_out() -> None:
    # The island lies 0.05 mm beyond the wall over 20 mm.
    # The flattened contours of the nesting may deviate by as much.
    planned = plan_pocket(
        rectangle(0, 0, 60, 40), rectangle(-0.05, 10, 20, 20, "c2"), rectangle(100, 0, 50, 50, "c3")
    )
    assert {path.contours for path in planned.paths} == {("c3",)}
    assert "2 contours not cleared, crossing each other: c1-c2" in find_note(planned, "crossing")
    # An edge of this island lies on the wall, so the pocket has no area between them.
    touching = plan_pocket(rectangle(0, 0, 60, 40), rectangle(0, 10, 20, 20, "c2"))
    assert not touching.paths
    assert "check failed: c1 on layer 0" in find_note(touching, "edges lie on one line")


def test_pockets_whose_corners_cross_a_little_are_left_out() -> None:
    """The corner of c1 is 0.38 mm inside of the circle c2."""
    rest = rectangle(60, 0, 20, 10, "c3")
    planned = plan_pocket(rectangle(0, 0, 20, 10, "c1"), circle(30, -12, 16, "c2"), rest)
    assert "2 contours not cleared, crossing each other: c1-c2" in find_note(planned, "crossing")
    assert [path.id for path in planned.paths] == ["c3"]


def test_contours_inside_crossing_ones_are_no_pockets() -> None:
    """Without the frame, `rim` is a pocket and `middle` an island. With it they are the opposite.

    The bar crosses the frame.
    """
    frame, bar = rectangle(0, 0, 60, 40, "frame"), rectangle(40, 30, 60, 5, "bar")
    rim, middle = circle(20, 20, 12, "rim"), circle(20, 20, 5, "middle")
    planned = plan_pocket(frame, bar, rim, middle, rectangle(0, 60, 20, 20, "other"))
    assert [path.id for path in planned.paths] == ["other"]
    notes = [note.ids for note in planned.notes if note.kind == "skipped"]
    assert notes == [("frame", "bar"), ("rim", "middle")]


def test_only_selected_contours_are_walls() -> None:
    shapes = (
        rectangle(0, 0, 200, 200, "c1"),
        rectangle(20, 20, 80, 60, "c2"),
        circle(50, 50, 10, "c3"),
    )
    chosen = camgen.Part("part", "part.dxf", "mm", shapes, (), worked=frozenset({"c2", "c3"}))
    planned = plan(chosen, make_job())
    assert {path.contours for path in planned.paths} == {("c2", "c3")}
    assert measure_faults(shapes[1:], planned) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"tool": ToolTable(kind="drill")}, "tool.kind"),
        ({"process": ProcessTable(force=5.0)}, "process.force"),
        ({"operation": OperationTable(kind="pocket", stepover=1.0)}, "operation.stepover"),
        ({"operation": OperationTable(kind="pocket", finish=3.5)}, "operation.finish"),
        (
            {"operation": OperationTable(kind="pocket", inside_first=False)},
            "operation.inside_first",
        ),
        ({"operation": OperationTable(kind="pocket", width=1.0)}, "operation.width"),
        ({"operation": OperationTable(kind="follow", stepover=0.5)}, "operation.stepover"),
        ({"operation": OperationTable(kind="trace", finish=0.5)}, "operation.finish"),
    ],
)
def test_a_setting_without_effect_on_the_operation_is_an_error(
    changed: dict[str, object], key: str
) -> None:
    tables = {"operation": OperationTable(kind="pocket"), **changed}
    with pytest.raises(JobError) as error:
        plan(part(*SHAPES["an L"]), Job(**tables))  # type: ignore[arg-type]
    assert key in str(error.value)


def test_a_part_without_closed_contours_is_an_error() -> None:
    with pytest.raises(InputError, match="no closed contour to clear"):
        plan_pocket(contour([(0, 0), (50, 0), (50, 50)], closed=False))


def test_passes_whose_chords_cross_are_planned() -> None:
    plate = Path(__file__).parents[2] / "fixtures" / "parts" / "plate.dxf"
    operation = {"kind": "pocket", "depth": 6.0, "entry": "helix", "finish": 0.2}
    tables = {"operation": operation, "tool": {"diameter": 3.0}, "process": {"spindle": 8000.0}}
    result = camgen.build(plate, post="gcode", job=tables)
    # A build whose stock proof finds a gouge raises, so there would not be a result.
    assert result.proof is not None


@pytest.mark.parametrize("lobe", [0.3, 0.9])
def test_the_note_of_a_wall_that_crosses_itself_gives_the_place(lobe: float) -> None:
    """The upper edge of the 200 x 60 mm pocket ends in a small square loop outside of it."""
    corners = [(0, 0), (200, 0), (200, 60), (50 - lobe, 60), (50 - lobe, 60 + lobe),
               (50, 60 + lobe), (50, 59.5), (0, 59.5)]  # fmt: skip
    planned = plan_pocket(contour(corners), rectangle(0, 100, 40, 30, "c2"))
    assert [path.contours for path in planned.paths] == [("c2",)]
    place = f"near {50 - lobe / 2:g} {60 + lobe / 2:g} mm"
    assert place in find_note(planned, "1 contour not cleared, crossing themselves: c1")


def test_a_loop_of_the_wall_inside_the_pocket_does_not_stop_it() -> None:
    """The wall encloses a small square of the pocket a second time, which adds no area."""
    corners = [(0, 0), (30, 0), (30, 10), (12, 10), (12, 9.3), (12.7, 9.3), (12.7, 10.5), (0, 10.5)]
    result = build_pocket(0.5, contour(corners), depth=1.0)
    assert not [note for note in result.notes if note.kind == "skipped"]


def test_a_pocket_is_planned_although_a_candidate_of_its_offset_curve_has_no_successor() -> None:
    """One candidate segment of this offset curve is cut too late.

    Therefore no other segment continues its rest.
    """
    wall = contour(
        [(15.743, 10.701), (12.057, 15.013), (-3.091, 7.326), (-8.089, 7.77), (-16.076, -2.055),
         (-10.342, -10.931), (-3.834, -21.828), (6.306, -18.358), (8.324, -3.609)],
        [0.4396, 0.1515, 0.2351, 0.1922, 0.0, -0.4197, 0.7005, 0.0358, -0.5054],
    )  # fmt: skip
    island = contour(
        [(0.608, 7.206), (-3.211, 7.454), (-4.017, 3.515), (-1.416, 3.354), (0.795, 3.23)],
        [0.0, 0.5195, 0.0, 0.0, -0.3122],
        name="c2",
    )
    result = build_pocket(3.0, wall, island, depth=2.0)
    assert not [note for note in result.notes if note.kind == "skipped"]


def test_a_triangle_is_cleared_in_its_middle() -> None:
    """The bounding box of the longest side covers the triangle.

    The stock proof once treated a loop in the middle as a loop along that side.
    """
    wall = contour([(0, 0), (206.6254, 0), (0, 151.0303)])
    assert build_pocket(4.0, wall, depth=2.0, entry="helix").proof is not None
