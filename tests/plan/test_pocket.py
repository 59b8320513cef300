"""Pockets: all that the tool can reach is cut and nothing else, links too; order, direction, engagement, notes."""

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
        contour([(0, 0), (40, 0), (40, 16), (60, 16), (60, 0), (110, 0), (110, 40), (60, 40), (60, 24), (40, 24),
                 (40, 40), (0, 40)]),
    ),
    "two basins and a neck too narrow": (
        contour([(0, 0), (40, 0), (40, 17.5), (60, 17.5), (60, 0), (110, 0), (110, 40), (60, 40), (60, 22.5),
                 (40, 22.5), (40, 40), (0, 40)]),
    ),
    "an island": (rectangle(0, 0, 100, 60), circle(40, 30, 10, "c2")),
    "islands": (rectangle(0, 0, 100, 60), rectangle(30, 20, 20, 20, "c2"), circle(75, 30, 10, "c3")),
    "a pocket in an island": (circle(0, 0, 60), circle(5, 0, 40, "c2"), rounded(30, 20, 4, "c3")),
    "an island near the wall": (rectangle(0, 0, 60, 60), circle(16, 30, 12, "c2")),
}  # fmt: skip


def job(**operation: object) -> Job:
    table = OperationTable(kind="pocket", **operation)  # type: ignore[arg-type]
    return Job(
        tool=ToolTable(diameter=2 * RADIUS), operation=table, process=ProcessTable(feed=10.0)
    )


def planned(*contours: Contour, **operation: object) -> Plan:
    return plan(part(*contours), job(**operation))


def bare_and_gouged(contours: tuple[Contour, ...], made: Plan) -> tuple[float, float]:
    """Areas, mm2: what could be reached and is bare by more than 0.01 mm; what is cut beyond the walls by 0.005."""
    region, covered = enclosed(contours), swept(made.paths, RADIUS)
    bare = reachable(region, RADIUS).difference(covered).buffer(-0.005)
    return bare.area, covered.difference(region.buffer(0.005)).area


@pytest.mark.parametrize("stepover", [0.3, 0.5, 0.7, 0.95])
@pytest.mark.parametrize("name", SHAPES)
def test_all_that_the_tool_reaches_is_cut_and_nothing_else(name: str, stepover: float) -> None:
    made = planned(*SHAPES[name], stepover=stepover)
    assert bare_and_gouged(SHAPES[name], made) == (0.0, 0.0)
    assert not [note for note in made.notes if note.kind == "skipped"]


@pytest.mark.parametrize("name", SHAPES)
def test_rough_and_last_passes_together_leave_nothing(name: str) -> None:
    made = planned(*SHAPES[name], finish=0.4, depth=6.0, passes=3)
    assert bare_and_gouged(SHAPES[name], made) == (0.0, 0.0)
    rough = [path for path in made.paths if ".finish" not in path.id]
    region = enclosed(SHAPES[name])
    assert swept(rough, RADIUS).difference(region.buffer(-0.395)).area == 0.0
    last = [path for path in made.paths if ".finish" in path.id]
    assert {path.depths for path in last} == {(6.0,)} or name in (
        "two basins and a neck",
        "an island near the wall",
    )
    assert all(path.closed for path in last)


def test_a_last_pass_where_the_others_found_no_room_goes_down_pass_by_pass() -> None:
    slot = (rounded(60, 6.5, 3.2),)
    made = planned(*slot, finish=0.4, depth=6.0, passes=3)
    (path,) = made.paths
    assert path.id == "c1.finish"
    assert path.depths == (2.0, 4.0, 6.0)
    assert bare_and_gouged(slot, made) == (0.0, 0.0)


@st.composite
def pockets(draw: st.DrawFn) -> tuple[Contour, ...]:
    """A polygon about the middle with arcs and islands about places in it; islands may lie beyond its walls."""

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
@given(pockets(), st.floats(0.2, 0.95))
def test_random_pockets_with_islands(shapes: tuple[Contour, ...], stepover: float) -> None:
    assume(all(outline(shape).is_valid for shape in shapes))
    made = planned(*shapes, stepover=stepover)
    left_out = {name for note in made.notes if note.kind == "skipped" for name in note.ids}
    cut = tuple(shape for shape in shapes if shape.id not in left_out)
    if "c1" in left_out:
        # Without its outer wall nothing is a pocket but what was drawn to be an island of it.
        assert not made.paths or "c1" not in {name for path in made.paths for name in path.contours}
        return
    # What crosses the wall would have taken it along; what lies over it by a hair's breadth touches it.
    outer, hair = outline(shapes[0]), 0.02
    for shape in (outline(one) for one in shapes if one.id in left_out):
        assert outer.intersection(shape).area <= hair * min(outer.length, shape.length)
    assert bare_and_gouged(cut, made) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("direction", "right"), [("climb", True), ("conventional", False), ("any", True)]
)
def test_climb_has_the_walls_on_the_right(direction: str, right: bool) -> None:
    shapes = SHAPES["a pocket in an island"]
    walls = enclosed(shapes).boundary
    looked = 0
    for path in planned(*shapes, direction=direction).paths:
        for a, b in pairwise(shapely.get_coordinates(centre_line(path))):
            middle = shapely.Point((a + b) / 2)
            if walls.distance(middle) < RADIUS + 0.001 and np.hypot(*(b - a)) > 0.02:
                foot = shapely.get_coordinates(shapely.shortest_line(middle, walls))[1]
                along, aside = b - a, foot - (a + b) / 2
                assert (along[0] * aside[1] - along[1] * aside[0] < 0) == right
                looked += 1
    assert looked > 100


def test_passes_are_arcs_where_the_walls_are() -> None:
    (path,) = planned(circle(0, 0, 30), stepover=0.5, engagement=1.0).paths
    radii = np.hypot(*path.via[~np.isnan(path.via[:, 0]), :2].T)
    # One radius beyond each other from the wall inwards: 27, 24, ... 3, and nothing else is an arc.
    assert np.unique(np.round(radii, 6)).tolist() == [
        3.0,
        6.0,
        9.0,
        12.0,
        15.0,
        18.0,
        21.0,
        24.0,
        27.0,
    ]
    from_middle = np.hypot(*path.position[:, :2].T)
    assert (np.diff(from_middle) > -1e-6).all()


def test_one_entry_for_a_basin_and_the_rest_after_it() -> None:
    shapes = SHAPES["two basins and a neck"]
    left, right = planned(*shapes, depth=4.0, passes=2, engagement=1.0).paths
    assert (left.id, right.id) == ("c1.1", "c1.2")
    # The larger basin leads on to the passes around both.
    assert (left.parent, right.parent) == (1, -1)
    assert centre_line(right).bounds[0] == pytest.approx(3.0)
    for path in (left, right):
        assert path.depths == (2.0, 4.0)
        assert not path.closed
        assert not path.reversible
        assert (path.position[:, 2] == 0).all()
    (alone,) = planned(*SHAPES["an L"], stepover=0.4).paths
    assert alone.id == "c1"


@pytest.mark.parametrize(("radius", "room"), [(4.0, 1.0), (5.0, 2.0), (30.0, 2.7)])
def test_the_helix_of_the_entry_stays_in_the_pocket(radius: float, room: float) -> None:
    (path,) = planned(circle(2, 1, radius)).paths
    # From the middle of a circle its radius less the tool's, and no more than 0.45 of the diameter.
    assert path.entry_radius == pytest.approx(room, abs=0.02)
    assert math.dist(path.position[0, :2], (2, 1)) < max(0.02, radius - RADIUS - room + 0.02)


@pytest.mark.parametrize("name", SHAPES)
def test_the_tool_on_the_helix_never_touches_a_wall(name: str) -> None:
    region = enclosed(SHAPES[name])
    paths = planned(*SHAPES[name], finish=0.2).paths
    assert any(path.entry_radius > 1.0 for path in paths)
    for path in paths:
        if path.entry_radius:
            there = shapely.Point(path.position[0, :2])
            assert region.contains(there)
            assert region.boundary.distance(there) >= path.entry_radius + RADIUS + 0.2 - 0.005


def told(made: Plan, word: str) -> str:
    (text,) = [str(note) for note in made.notes if word in str(note)]
    return text


def test_engagement_on_the_rings_of_a_circle() -> None:
    # Worst on the largest steps inwards: tool of 3 on a ring of 6 about one of 3 that cleared 6 mm.
    made = planned(circle(0, 0, 30), stepover=0.5, engagement=1.0)
    shares = []
    for ring in np.arange(6.0, 28.0, 3.0):
        cosine = (ring**2 + RADIUS**2 - ring**2) / (2 * ring * RADIUS)
        # The law of cosines: where the tool's edge leaves the circle that is cleared, measured from the wall's side.
        shares.append((1 - math.cos(math.pi - math.acos(cosine))) / 2)
    most = 100 * max((1 + RADIUS / (2 * ring)) / 2 for ring in np.arange(6.0, 28.0, 3.0))
    assert 100 * max(shares) == pytest.approx(most)
    text = told(made, "engagement")
    assert f"{most:.0f} % at most" in text or f"{math.ceil(most + 0.5):.0f} % at most" in text


def test_engagement_along_a_straight_wall_is_the_step() -> None:
    text = told(planned(rectangle(0, 0, 400, 300), stepover=0.4, engagement=1.0), "engagement")
    assert "c1: " in text
    assert (
        "2.4 mm apart, engagement 40 % of the diameter or less on half" in text
        or "engagement 41 % of" in text
    )
    # In a square corner the tool is in contact all round its front.
    assert "100 % at most" in text


def test_what_stays_in_the_corners_is_told() -> None:
    text = told(planned(rectangle(0, 0, 100, 60)), "not cleared")
    # Of each corner a square of the radius less a quarter of the disc.
    assert f"{(4 - math.pi) * RADIUS**2:.2f} mm2 of 6000 mm2" in text
    assert "4 places" in text
    assert not [note for note in planned(circle(0, 0, 20)).notes if "not cleared" in str(note)]


def test_a_neck_too_narrow_is_told_with_its_place() -> None:
    (note,) = [
        n
        for n in planned(*SHAPES["two basins and a neck too narrow"]).notes
        if "not cleared" in n.what
    ]
    # The neck of 20 x 5 mm is the largest of what is left, but for what the tool reaches into its mouths.
    assert any(40 < x < 60 and 17.5 < y < 22.5 for x, y in note.places)
    assert note.ids == ("c1",)


def test_a_pocket_too_narrow_is_left_out_by_name() -> None:
    made = planned(rectangle(0, 0, 40, 5.9, "c1"), circle(0, 40, 20, "c2"))
    assert {path.contours for path in made.paths} == {("c2",)}
    note = told(made, "narrow:")
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
def test_what_might_be_an_island_is_not_cut_away(inside: Contour) -> None:
    made = planned(rectangle(0, 0, 60, 40), inside, rectangle(100, 0, 50, 50, "c3"))
    assert {path.contours for path in made.paths} == {("c3",)}
    left_out = [note.ids for note in made.notes if note.kind == "skipped"]
    assert sorted(left_out) == [("c1",), ("c2",)]


def test_an_island_that_crosses_the_wall_by_a_sliver_is_not_cut_away() -> None:
    # A twentieth of a mm beyond the wall, over 20 mm: no more than the flattened contours of the nesting are apart.
    made = planned(
        rectangle(0, 0, 60, 40), rectangle(-0.05, 10, 20, 20, "c2"), rectangle(100, 0, 50, 50, "c3")
    )
    assert {path.contours for path in made.paths} == {("c3",)}
    assert "2 contours not cleared, crossing each other: c1-c2" in told(made, "crossing")
    # With an edge on that of the wall it leaves the pocket no side there.
    touching = planned(rectangle(0, 0, 60, 40), rectangle(0, 10, 20, 20, "c2"))
    assert not touching.paths
    assert "check failed: c1 on layer 0" in told(touching, "edges lie on one line")


def test_only_the_contours_worked_on_are_walls() -> None:
    shapes = (
        rectangle(0, 0, 200, 200, "c1"),
        rectangle(20, 20, 80, 60, "c2"),
        circle(50, 50, 10, "c3"),
    )
    chosen = camgen.Part("part", "part.dxf", "mm", shapes, (), worked=frozenset({"c2", "c3"}))
    made = plan(chosen, job())
    assert {path.contours for path in made.paths} == {("c2", "c3")}
    assert bare_and_gouged(shapes[1:], made) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("changed", "place"),
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
def test_settings_that_make_no_sense(changed: dict[str, object], place: str) -> None:
    asked = Job(**{"operation": OperationTable(kind="pocket"), **changed})  # type: ignore[arg-type]
    with pytest.raises(JobError) as found:
        plan(part(*SHAPES["an L"]), asked)
    assert place in str(found.value)


def test_nothing_closed_is_an_error() -> None:
    with pytest.raises(InputError, match="no closed contour to clear"):
        planned(contour([(0, 0), (50, 0), (50, 50)], closed=False))


def test_passes_whose_chords_cross_are_planned() -> None:
    plate = Path(__file__).parents[2] / "fixtures" / "parts" / "plate.dxf"
    operation = {"kind": "pocket", "depth": 6.0, "passes": 3, "entry": "helix", "finish": 0.2}
    tables = {"operation": operation, "tool": {"diameter": 3.0}, "process": {"spindle": 8000.0}}
    result = camgen.build(plate, post="gcode", job=tables)
    # The stock proof finds no gouge, else there is no result.
    assert result.proof is not None


@pytest.mark.parametrize("lobe", [0.3, 0.9])
def test_a_wall_that_crosses_itself_is_told_with_its_place(lobe: float) -> None:
    """The upper edge of 200 x 60 mm overshoots by a square loop, outside of which was planned."""
    corners = [(0, 0), (200, 0), (200, 60), (50 - lobe, 60), (50 - lobe, 60 + lobe),
               (50, 60 + lobe), (50, 59.5), (0, 59.5)]  # fmt: skip
    plan_of_both = planned(contour(corners), rectangle(0, 100, 40, 30, "c2"))
    assert [path.contours for path in plan_of_both.paths] == [("c2",)]
    place = f"near {50 - lobe / 2:g} {60 + lobe / 2:g} mm"
    assert place in told(plan_of_both, "1 contour not cleared, crossing themselves: c1")


def test_a_loop_within_a_pocket_is_no_wall_of_it() -> None:
    """A wall that runs round a square of the pocket a second time encloses nothing new."""
    corners = [(0, 0), (200, 0), (200, 60), (50, 60), (50, 59.3), (50.7, 59.3), (50.7, 60.5),
               (0, 60.5)]  # fmt: skip
    settings = {"kind": "pocket", "depth": 1.0}
    tables = {"operation": settings, "tool": {"diameter": 0.5}, "process": {"spindle": 9000.0}}
    result = camgen.build(part(contour(corners)), post="gcode", job=tables)
    assert not [note for note in result.notes if note.kind == "skipped"]


def test_a_stray_arc_beside_a_border_leaves_no_pocket_out() -> None:
    """One candidate of this offset is cut too late; its rest has no successor."""
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
    tables = {"operation": {"kind": "pocket", "depth": 2.0}, "tool": {"diameter": 3.0}}
    tables |= {"process": {"spindle": 9000.0}}
    result = camgen.build(part(wall, island), post="gcode", job=tables)
    assert not [note for note in result.notes if note.kind == "skipped"]


def test_a_triangle_is_cleared_in_its_middle() -> None:
    """The box of its longest side covers it; the proof took a loop there for one along it."""
    wall = contour([(0, 0), (206.6254, 0), (0, 151.0303)])
    tables = {
        "operation": {"kind": "pocket", "depth": 2.0, "entry": "helix"},
        "tool": {"diameter": 4.0},
    }
    tables |= {"process": {"spindle": 9000.0}}
    assert camgen.build(part(wall), post="gcode", job=tables).proof is not None
