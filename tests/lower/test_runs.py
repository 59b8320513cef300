"""Entries of a mill, tested on the motions alone: slopes, depths and uncut stretches."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

import camgen
from camgen.geometry.arcs import measure_path
from camgen.geometry.intersect import measure_gaps
from camgen.geometry.segments import make_contour_segments, make_segments
from camgen.lower.runs import make_helix_entry
from camgen.model.errors import JobError
from camgen.model.part import Contour
from camgen.model.path import ToolPath
from camgen.model.pose import Pose
from camgen.model.program import MoveC, MoveJ, MoveL, Output, Program
from camgen.pipeline import Result, build
from tests.support.cuts import Cut, below, cuts, swept
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.examples import fewer
from tests.support.rs274 import assert_moves, needs_rs274, run

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
SHAPES = {
    "square corners": [rectangle(0, 0, 60, 40)],
    "round corners": [rounded(60, 40, 8)],
    "a disc with a hole": [circle(0, 0, 25), circle(0, 0, 9, "c2")],
    "lines in a row": [contour([(0, 0), (50, 0), (50, 30)], closed=False)],
}


def mill(
    shapes: list[Contour],
    post: str = "gcode",
    tool: float = 6.0,
    spindle: float = 9000,
    **operation: object,
) -> Result:
    """A build with feed 20 and plunge 5 mm/s. It also verifies its text."""
    job = {
        "operation": {"entry": "ramp", **operation},
        "process": {"spindle": spindle, "feed": 20, "plunge": 5},
        "tool": {"diameter": tool},
    }
    return build(part(*shapes), post=post, job=job)


def cuts_of_paths(program: Program) -> list[Cut]:
    """The cuts along paths, without approaches and retracts."""
    return [cut for cut in cuts(program) if cut.work]


def measure_steepest(path_cuts: list[Cut]) -> float:
    """The largest angle between a descending cut and the horizontal, deg; 0 if none descends."""
    descending = [cut for cut in path_cuts if cut.drop > 1e-9]
    return max((math.degrees(math.atan2(cut.drop, cut.run)) for cut in descending), default=0.0)


def assert_nothing_is_drilled(all_cuts: list[Cut], radius: float) -> None:
    """Each vertical cut goes through material that earlier cuts have removed."""
    for k, cut in enumerate(all_cuts):
        if cut.run < 1e-6 and cut.drop > 1e-9 and cut.end[2] < -1e-9:
            tool = shapely.Point(cut.end[:2]).buffer(radius - 2e-3)
            assert swept(all_cuts[:k], cut.end[2] + 1e-9, radius).covers(tool), cut


def assert_covered(path_cuts: list[Cut], path: ToolPath, depth: float) -> None:
    """The cuts at `depth` cover the whole path, and nothing else."""
    flat = [(a[:2], b[:2]) for a, b in below(path_cuts, -depth + 1e-9)]
    lines = shapely.union_all(
        [shapely.LineString(ends) for ends in flat if math.dist(*ends) > 1e-9]
    )
    points = np.concatenate([path.position[:, :2], path.via[1:, :2]])
    points = points[~np.isnan(points[:, 0])]
    assert float(shapely.distance(shapely.points(points), lines).max()) < 1e-3
    pieces = shapely.union_all([shapely.buffer(line, 1e-3, quad_segs=2) for line in lines.geoms])
    # A band about the whole path, 2e-3 mm wide, with round ends.
    assert pieces.area == pytest.approx(measure_path(path) * 2e-3, rel=2e-2)


def measure_distances(shapes: list[Contour], path_cuts: list[Cut]) -> np.ndarray:
    """Distance from each straight cut to the nearest contour, mm."""
    count = len(path_cuts)
    start = np.array([cut.start[:2] for cut in path_cuts])
    end = np.array([cut.end[:2] for cut in path_cuts])
    return measure_gaps(
        make_segments(start, end, np.zeros(count), np.arange(count)),
        make_contour_segments(shapes),
        20.0,
    )


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize(("angle", "passes"), [(3.0, 1), (3.0, 3), (20.0, 2)])
def test_a_ramp_keeps_the_entry_angle_and_the_path_is_cut_at_each_depth(
    name, angle, passes
) -> None:
    kind = "trace" if name == "lines in a row" else "follow"
    result = mill(SHAPES[name], kind=kind, depth=6.0, passes=passes, entry_angle=angle)
    all_cuts = cuts(result.program)
    cutting = cuts_of_paths(result.program)
    assert angle * 0.95 < measure_steepest(cutting) <= angle + 1e-6
    assert max(cut.speed for cut in cutting if cut.drop > 1e-9) == 5.0
    assert_nothing_is_drilled(all_cuts, 3.0)
    for number, path in enumerate(result.tour.paths):
        path_cuts = [cut for cut in cutting if cut.path == number]
        assert min(cut.end[2] for cut in path_cuts) == -6.0
        for k in range(passes):
            depth = 6.0 * (k + 1) / passes
            starting = [cut for cut in path_cuts if abs(cut.start[2] + depth) < 1e-9]
            at_depth = [cut for cut in starting if abs(cut.end[2] + depth) < 1e-9]
            assert_covered(at_depth, path, depth)


@pytest.mark.parametrize("name", ["square corners", "round corners", "a disc with a hole"])
def test_the_chords_of_a_ramp_keep_the_tool_radius_from_the_part(name) -> None:
    result = mill(SHAPES[name], depth=8.0, entry_angle=5.0)
    ramp = [cut for cut in cuts_of_paths(result.program) if cut.drop > 1e-9]
    distances = measure_distances(SHAPES[name], ramp)
    assert float(distances.min()) > 3.0 - 1e-5
    assert float(distances.max()) < 3.0 + 0.0101  # tolerance.chord


def test_a_ramp_longer_than_a_closed_path_runs_along_it_more_than_once() -> None:
    result = mill([circle(0, 0, 5)], side="inside", depth=4.0, entry_angle=3.0)
    cutting = cuts_of_paths(result.program)
    descending = math.fsum(cut.run for cut in cutting if cut.drop > 1e-9)
    # 4 mm at 3 deg are 76.3 mm, about six circles of 2 mm radius.
    assert descending == pytest.approx(4 / math.tan(math.radians(3)), rel=1e-2)
    assert descending > 6 * 2 * math.pi * 2
    centre = max(abs(math.hypot(*cut.end[:2]) - 2.0) for cut in cutting)
    assert centre < 0.0101


def test_passes_of_a_closed_path_are_cut_without_a_lift_and_end_at_its_start() -> None:
    result = mill([rectangle(0, 0, 60, 40)], depth=6.0, passes=3, entry_angle=10.0)
    (path,) = result.tour.paths
    cutting = cuts_of_paths(result.program)
    for cut, following in pairwise(cutting):
        assert math.dist(cut.end, following.start) < 1e-9
    assert cutting[-1].end == (*path.position[0, :2].tolist(), -6.0)
    assert sum(isinstance(item, MoveJ) for item in result.program.body) <= 7
    # The first ramp starts ahead of the start point by the length of the three ramps.
    before = 6 / math.tan(math.radians(10))
    begin = shapely.LineString(path.position[::-1, :2]).interpolate(before)
    first = cutting[0].start
    assert first[2] == 0.0
    arcs = 4 * 2 * math.pi * 3 / 4 * 0.01  # chord and arc of four corners differ by less
    assert math.dist(first[:2], (begin.x, begin.y)) < 3 + arcs


def test_an_open_path_is_entered_back_and_forth() -> None:
    line = contour([(0, 0), (80, 0)], closed=False)
    result = mill([line], kind="trace", depth=2.0, entry_angle=5.0)
    cutting = cuts_of_paths(result.program)
    x = [cut.end[0] for cut in cutting]
    half = 2 / math.tan(math.radians(5)) / 2
    first = cutting[0].start[0]
    assert [abs(value - first) for value in x] == pytest.approx([half, 0, 80])
    assert [cut.end[2] for cut in cutting] == pytest.approx([-1, -2, -2])


def test_a_short_open_path_is_entered_back_and_forth_several_times() -> None:
    line = contour([(0, 0), (5, 0)], closed=False)
    result = mill([line], kind="trace", depth=2.0, entry_angle=5.0)
    cutting = cuts_of_paths(result.program)
    # The ramp of 22.9 mm fits into 5 mm if it runs back and forth three times.
    assert len([cut for cut in cutting if cut.drop > 1e-9]) == 6
    assert measure_steepest(cutting) == pytest.approx(
        math.degrees(math.atan(2 / 6 / (22.86 / 6))), abs=0.01
    )
    assert max(cut.run for cut in cutting) == pytest.approx(5)


def test_leads_are_entered_back_and_forth_too() -> None:
    result = mill([rounded(60, 40, 8)], depth=4.0, passes=2, lead_in=4.0, lead_out=4.0, overlap=2.0)
    assert measure_steepest(cuts_of_paths(result.program)) <= 3.0 + 1e-6
    assert_nothing_is_drilled(cuts(result.program), 3.0)
    (path,) = result.tour.paths
    last = [cut for cut in cuts_of_paths(result.program) if cut.start[2] == cut.end[2] == -4.0]
    points = [last[0].start[:2], *(cut.end[:2] for cut in last)]
    assert shapely.LineString(points).length == pytest.approx(measure_path(path), rel=1e-4)


LEADS = st.one_of(st.just(0.0), st.floats(0.5, 6))
sizes = st.tuples(st.floats(25, 90), st.floats(25, 60), st.floats(0.5, 12))
cut_depths = st.tuples(st.floats(0.5, 9), st.integers(1, 3))


@fewer(8)
@given(sizes, st.floats(1, 8), cut_depths, st.floats(1, 45), LEADS, st.integers(0, 3))
def test_a_ramp_of_any_size_keeps_its_slope_and_depth(
    size, tool, depth_and_passes, angle, lead, tabs
) -> None:
    """Nothing is drilled either."""
    depth, passes = depth_and_passes
    holds = {"tabs": tabs, "tab_width": 3.0, "tab_height": depth / 3} if tabs else {}
    more = {
        "depth": depth,
        "passes": passes,
        "entry_angle": angle,
        "lead_in": lead,
        "overlap": lead / 2,
        **holds,
    }
    result = mill([rounded(*size)], tool=tool, **more)
    cutting = cuts_of_paths(result.program)
    slanted = [cut for cut in cutting if abs(cut.drop) > 1e-9]
    assert float(measure_distances([rounded(*size)], slanted).min()) > tool / 2 - 1e-5
    limit = max(angle, 45.0) if tabs else angle
    assert measure_steepest(cutting) <= limit + 1e-6
    assert min(cut.end[2] for cut in cutting) == pytest.approx(-depth, abs=1e-12)
    assert_nothing_is_drilled(cuts(result.program), tool / 2)
    down = [cut for cut in cutting if cut.drop > 1e-9]
    assert max(cut.speed * cut.drop / math.hypot(cut.run, cut.drop) for cut in down) <= 5.0 + 1e-9


# Helices


def pocket(
    radius: float, passes: int = 1, direction: str = "climb"
) -> tuple[Program, camgen.plan.Plan]:
    """A pass in a pocket with room for a helix about its first point, and its path."""
    job = {
        "operation": {
            "entry": "helix",
            "depth": 4.0,
            "passes": passes,
            "entry_angle": 4.0,
            "direction": direction,
        },
        "process": {"spindle": 9000, "feed": 20, "plunge": 5},
    }
    inside = {**job, "operation": {**job["operation"], "side": "inside"}}
    plan = camgen.plan(part(circle(0, 0, 20)), inside)
    marked = [replace(path, operation="pocket", entry_radius=radius) for path in plan.paths]
    tour = camgen.order(replace(plan, paths=tuple(marked)), job, "gcode")
    program = camgen.lower(tour, job, "gcode")
    camgen.verify(camgen.post(program, "gcode", job), program, "gcode", job)
    return program, tour.paths[0]


@pytest.mark.parametrize(("direction", "sense"), [("climb", 1), ("conventional", -1)])
@pytest.mark.parametrize("passes", [1, 2])
def test_a_pocket_is_entered_on_a_helix(direction, sense, passes) -> None:
    program, path = pocket(2.7, passes, direction)
    cutting = cuts_of_paths(program)
    down = [cut for cut in cutting if cut.drop > 1e-9]
    centre = np.array(path.position[0, :2])
    for cut in down:
        for point in (cut.start, cut.end):
            assert math.dist(point[:2], centre) == pytest.approx(2.7)
        middle = (np.array(cut.start[:2]) + np.array(cut.end[:2])) / 2
        assert 2.7 - math.dist(middle, centre) <= 0.01 + 1e-9
        a, b = np.array(cut.start[:2]) - centre, np.array(cut.end[:2]) - centre
        assert (a[0] * b[1] - a[1] * b[0]) * sense > 0
    assert 3.9 < measure_steepest(cutting) <= 4.0 + 1e-9
    assert {cut.speed for cut in down} == {5.0}
    # A full circle at the foot of the helix is cut at the feed before the path is.
    flat = [cut for cut in cutting if cut.start[2] == cut.end[2] == -4.0]
    flat = [cut for cut in flat if abs(math.dist(cut.end[:2], centre) - 2.7) < 1e-6]
    assert math.fsum(cut.run for cut in flat) == pytest.approx(2 * math.pi * 2.7, rel=1e-3)
    assert_nothing_is_drilled(cuts(program), 3.0)
    assert_covered(cutting[cutting.index(flat[-1]) + 2 :], path, 4.0)


def test_a_path_without_room_for_a_helix_has_a_ramp() -> None:
    ramp = mill([circle(0, 0, 20)], depth=4.0, side="inside").program
    helix = mill([circle(0, 0, 20)], depth=4.0, side="inside", entry="helix").program
    assert [cut.end for cut in cuts(helix)] == [cut.end for cut in cuts(ramp)]


@fewer(8)
@given(st.floats(0.05, 20), st.floats(0.3, 45), st.floats(0.01, 5), st.floats(1e-3, 0.2))
def test_a_helix_of_any_size_keeps_its_radius_slope_and_chord_error(
    radius, angle, depth, chord
) -> None:
    _, path = pocket(2.7)
    entry = make_helix_entry(path, -1.0, -1.0 - depth, radius, math.radians(angle), chord)
    distances = np.linalg.norm(entry.position[:-1, :2] - path.position[0, :2], axis=1)
    assert distances == pytest.approx(radius)
    drop = -np.diff(entry.position[:, 2])
    run = np.linalg.norm(np.diff(entry.position[:, :2], axis=0), axis=1)
    assert (drop[:-3] <= math.tan(math.radians(angle)) * run[:-3] * (1 + 1e-9)).all()
    assert entry.position[0, 2] == -1.0
    assert (entry.position[-4:, 2] == -1.0 - depth).all()
    sagitta = radius - np.sqrt(np.maximum(radius**2 - (run[:-3] / 2) ** 2, 0.0))
    assert (sagitta <= chord * (1 + 1e-9)).all()
    assert entry.position[-1, :2].tolist() == path.position[0, :2].tolist()


# Other machines, and refusals


@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus", "grbl"])
def test_every_controller_runs_ramps_and_tabs(post) -> None:
    spindle = 9000 if post == "grbl" else 0  # on robots it is a signal
    result = mill(
        [rounded(60, 40, 8)], post, spindle=spindle, depth=4.0, passes=2, entry_angle=10.0, tabs=3
    )
    assert result.deviation.max_mm < 0.01
    assert min(cut.end[2] for cut in cuts_of_paths(result.program)) == pytest.approx(-4.0)


@needs_rs274
@pytest.mark.parametrize(
    "operation",
    [
        {"entry": "ramp"},
        {"entry": "ramp", "tabs": 4},
        {"entry": "plunge", "tabs": 4, "lead_in": 4.0},
    ],
)
def test_linuxcnc_runs_entries_and_tabs_as_planned(operation) -> None:
    job = {"operation": {"depth": 6.0, "passes": 2, **operation}, "process": {"spindle": 9000}}
    result = build(BRACKET, post="gcode", job=job)
    canon = run(result.text)
    assert canon.error == ""
    assert_moves(result.program, canon)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"operation": {"entry": "ramp"}}, "job: has no effect without a depth (operation.entry)"),
        (
            {"operation": {"entry_angle": 5.0}},
            "job: has no effect without operation.entry (operation.entry_angle)",
        ),
        ({"operation": {"tabs": 2}}, "job: has no effect without a depth (operation.tabs)"),
        (
            {"operation": {"tab_width": 2.0}},
            "job: has no effect without operation.tabs (operation.tab_width)",
        ),
        (
            {"operation": {"kind": "drill", "depth": 2.0, "entry": "ramp"}},
            "job: has no effect on drill (operation.entry)",
        ),
        (
            {"operation": {"kind": "trace", "depth": 2.0, "tabs": 2}},
            "job: has no effect on trace (operation.tabs); leave it out; it is for follow",
        ),
        (
            {"operation": {"side": "on", "depth": 2.0, "tab_spacing": 20.0}},
            "job: has no effect on trace (operation.tab_spacing)",
        ),
        (
            {"operation": {"entry": "ramp", "depth": 2.0}, "process": {"force": 3.0}},
            "job: a ramp into the material and a force against it (process.force)",
        ),
        (
            {"operation": {"entry": "helix", "depth": 2.0}, "tool": {"orient": "follow"}},
            (
                "job: a tool that turns with the contour goes straight down, not on a helix "
                "(tool.orient)"
            ),
        ),
        (
            {"operation": {"entry": "ramp", "depth": 2.0, "entry_angle": 1e-4}},
            "motions; the limit is 3,000,000 (operation.entry_angle)",
        ),
    ],
)
def test_a_setting_that_has_no_effect_or_no_room_is_refused(tables, message) -> None:
    with pytest.raises(JobError) as error:
        build(BRACKET, post="rapid", job=tables)
    assert message in str(error.value)


def test_a_link_at_working_height_has_no_ramp() -> None:
    job = {
        "operation": {"entry": "ramp", "depth": 2.0},
        "process": {"stay_down": True, "spindle": 9000},
        "tool": {"diameter": 2.0},
    }
    shapes = [circle(0, 0, 10), circle(40, 0, 10, "c2")]
    with pytest.raises(
        JobError,
        match=r"reached at working height cannot be entered on a ramp .process\.stay_down.",
    ):
        build(part(*shapes), post="gcode", job=job)


@pytest.mark.parametrize("kind", ["laser", "plasma"])
def test_a_torch_pierces_at_the_start_of_its_lead_outside_the_part(kind) -> None:
    job = {
        "operation": {"lead_in": 5.0},
        "process": {"switch": "contact", "dwell": 0.5},
        "tool": {"kind": kind, "diameter": 0.4},
    }
    shapes = [circle(0, 0, 30), circle(0, 0, 9, "c2")]
    result = build(part(*shapes), post="gcode", job=job)
    position, pierced = None, []
    for item in result.program.body:
        if isinstance(item, (MoveJ, MoveL, MoveC)) and isinstance(item.target, Pose):
            position = item.target.origin
        if isinstance(item, Output) and item.value == 1.0:
            pierced.append(position)
    # The lead is a quarter of a circle, 5 mm long. Its ends differ by the radius in x and in y.
    quarter = 5 / (math.pi / 2)
    hole, outline = sorted(pierced, key=lambda point: math.hypot(*point[:2]))
    assert math.hypot(*hole[:2]) == pytest.approx(math.hypot(9 - 0.2 - quarter, quarter))
    assert math.hypot(*outline[:2]) == pytest.approx(math.hypot(30 + 0.2 + quarter, quarter))
    assert hole[2] == outline[2] == 0.0


def test_a_drill_ignores_the_entry_of_all_operations_but_refuses_one_of_its_row() -> None:
    """A key in `operation` holds for all rows, so a row may have no use for it."""
    drill: dict[str, object] = {"kind": "drill", "ids": ["c2"]}
    job = {
        "operation": {"depth": 4.0, "entry": "ramp", "entry_angle": 8.0, "tab_height": 1.0},
        "process": {"spindle": 9000},
        "operations": [drill, {"kind": "follow", "ids": ["c1"], "tabs": 3}],
    }
    plate = part(rounded(60, 40, 8), circle(30, 20, 3, "c2"))
    result = build(plate, post="gcode", job=job)
    kinds = [path.operation for path in result.tour.paths]
    cutting = cuts_of_paths(result.program)
    assert all(cut.run < 1e-9 for cut in cutting if kinds[cut.path] == "drill")
    followed = [cut for cut in cutting if kinds[cut.path] == "follow"]
    assert measure_steepest(followed) <= 45.0
    assert [note.what for note in result.notes if "tab" in note.what] == [
        "3 tabs of 5 x 1 mm on 1:c1"
    ]
    with pytest.raises(JobError, match=r"has no effect on drill .operation\.tabs."):
        build(plate, post="gcode", job={**job, "operations": [{**drill, "tabs": 2}]})
