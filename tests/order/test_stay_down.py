"""Links at working height: their distance from contours, and programs without needless lifts."""

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.intersect import measure_gaps
from camgen.geometry.segments import make_contour_segments, make_segments, points_at
from camgen.model.job import CellTable, Job, OperationTable, ProcessTable, ToolTable, TourTable
from camgen.model.part import Contour, Part
from camgen.model.pose import Pose, frozen
from camgen.model.program import MoveC, MoveJ, MoveL, Output
from camgen.order.arrange import order_paths
from camgen.order.stay_down import stay_down
from camgen.pipeline import build
from camgen.plan.follow import follow
from tests.support.examples import fewer


@fewer(10)
@given(st.integers(0, 10**6))
def test_the_distance_of_a_line_is_the_least_distance_of_its_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines = make_segments(
        rng.uniform(0, 20, (6, 2)),
        rng.uniform(0, 20, (6, 2)),
        np.zeros(6),
        np.zeros(6, dtype=np.int64),
    )
    bulge = rng.uniform(-1, 1, 8) * (rng.random(8) < 0.7)
    drawn = make_segments(
        rng.uniform(0, 20, (8, 2)), rng.uniform(0, 20, (8, 2)), bulge, np.zeros(8, dtype=np.int64)
    )
    intervals = 150
    t = np.linspace(0, 1, intervals + 1)
    gaps = measure_gaps(lines, drawn, 100.0)
    for k in range(6):
        on_line = lines.start[k] + t[:, None] * (lines.end[k] - lines.start[k])
        least = math.inf
        for row in range(8):
            points = points_at(drawn.take(np.full(len(t), row)), t)
            least = min(least, np.linalg.norm(on_line[:, None] - points[None], axis=2).min())
        # The sampled distance is too large by half of the two steps at most, and never too small.
        step = (float(lines.length[k]) + float(drawn.length.max())) / intervals / 2
        assert gaps[k] <= least + 1e-9
        assert gaps[k] >= least - step - 1e-9
    near = measure_gaps(lines, drawn, 2.0)
    assert (near[gaps <= 2.0] == gaps[gaps <= 2.0]).all()
    assert np.isinf(near[gaps > 2.0]).all()


def make_block(x: float, y: float, side: float, name: str) -> Contour:
    points = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]
    return Contour(frozen(points), frozen(np.zeros(4)), True, "0", name)


def write_drawing(tmp_path, contours: list[list[tuple[float, float]]]):
    import ezdxf  # noqa: PLC0415

    document = ezdxf.new("R2010", units=4)
    for points in contours:
        document.modelspace().add_lwpolyline(points, close=True)
    file = tmp_path / "part.dxf"
    document.saveas(file)
    return file


def list_corners(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


def count_lifts(result) -> int:
    """Number of motions from the part or below up to free space."""
    motions = [item for item in result.program.body if isinstance(item, (MoveL, MoveJ))]
    heights = [motion.target.origin[2] for motion in motions if isinstance(motion.target, Pose)]
    return sum(1 for a, b in itertools.pairwise(heights) if a <= 0 < b)


def test_a_link_between_facing_blocks_needs_no_lift_and_a_link_over_a_block_does(tmp_path) -> None:
    # Two blocks face each other. The third has a hole, and both links of the hole need a lift.
    file = write_drawing(
        tmp_path,
        [
            list_corners(0, 0, 20),
            list_corners(50, 0, 20),
            list_corners(1000, 1000, 20),
            list_corners(1006, 1006, 8),
        ],
    )
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}, "process": {"switch": "contact"}}
    plain = build(file, post="gcode", job=job)
    down = build(
        file, post="gcode", job={**job, "process": {"switch": "contact", "stay_down": True}}
    )
    assert [note.what for note in down.notes if "lifts" in note.what] == ["lifts saved: 1 of 3"]
    assert not [note for note in plain.notes if "lifts" in note.what]
    assert count_lifts(plain) == 4
    assert count_lifts(down) == 3
    assert down.motions.seconds < plain.motions.seconds
    # The process is off on such links, and they keep 2 mm from every block.
    on, start, links = False, None, []
    for item in down.program.body:
        if isinstance(item, Output):
            on = bool(item.value)
        elif isinstance(item, (MoveL, MoveC, MoveJ)) and isinstance(item.target, Pose):
            end = item.target.origin
            if start is not None and start[2] == end[2] == -1.0 and not on:
                links.append((start, end))
            start = end
    assert len(links) == 1
    a, b = links[0]
    drawn = make_contour_segments(down.part.contours)
    t = np.linspace(0, 1, 2001)[:, None]
    points = np.array(a[:2]) + t * (np.array(b[:2]) - np.array(a[:2]))
    for row in range(len(drawn)):
        sides = points_at(drawn.take(np.full(501, row)), np.linspace(0, 1, 501))
        assert np.linalg.norm(points[:, None] - sides, axis=2).min() >= 2.0 - 0.005


def test_a_rotating_tool_stays_on_while_it_stays_down(tmp_path) -> None:
    """The spindle is off only above the part.

    The tool stays down between two blocks that face each other. A block with a hole needs a lift.
    """
    file = write_drawing(
        tmp_path,
        [
            list_corners(0, 0, 20),
            list_corners(50, 0, 20),
            list_corners(100, 0, 40),
            list_corners(110, 10, 20),
        ],
    )
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}}
    for stay in (False, True):
        result = build(file, post="rapid", job={**job, "process": {"stay_down": stay}})
        lifted = 4 - len(result.tour.down)
        assert (lifted < 4) == stay
        values = [item.value for item in result.program.body if isinstance(item, Output)]
        assert values == [0, *[1, 0] * lifted]
        on, start = False, None
        for item in result.program.body:
            if isinstance(item, Output):
                on = bool(item.value)
            elif isinstance(item, (MoveL, MoveC)):
                end = item.target.origin
                assert on or end[2] >= 2.0, "at depth with the tool off"
                assert not on or start[:2] == end[:2] or start[2] == end[2] == -1.0, (
                    "travels above the part with the tool on"
                )
                start = end
            elif isinstance(item, MoveJ) and isinstance(item.target, Pose):
                start = item.target.origin


@pytest.mark.parametrize(
    ("why", "table", "saved"),
    [
        ("clear", {}, 1),
        ("a clamp between", {"cell": {"fixtures": [[30, -50, -5, 40, 80, 10]]}}, 0),
        ("a clamp below the tool", {"cell": {"fixtures": [[30, -50, -5, 40, 80, -2]]}}, 1),
        ("a clamp aside", {"cell": {"fixtures": [[30, 60, -5, 40, 80, 10]]}}, 1),
        (
            "a clamp that holds all of it",
            # The program has no robot, so the clamp is not tested for collisions.
            {
                "cell": {"fixtures": [[-900, -900, -5, 900, 900, 10]]},
                "post": {"signals": {"spindle": "ao"}},
            },
            0,
        ),
        ("two passes", {"operation": {"depth": 2.0, "passes": 2}}, 0),
        ("force", {"process": {"force": 5.0}, "post": {"force_calibrated": True}}, 0),
        ("marks", {"operation": {"kind": "trace"}}, 0),
    ],
)
def test_a_lift_is_kept_for_an_obstacle_or_a_setting_that_needs_it(
    tmp_path, why, table, saved
) -> None:
    file = write_drawing(tmp_path, [list_corners(0, 0, 20), list_corners(50, 0, 20)])
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}, **table}
    job["process"] = {
        "stay_down": True,
        "spindle": 0 if "process" in table else 9000,
        **table.get("process", {}),
    }
    result = build(file, post="rapid" if "post" in table else "gcode", job=job)
    saved_lifts = [note.what for note in result.notes if "lifts" in note.what]
    assert saved_lifts == [f"lifts saved: {saved} of 1"], why


def test_a_link_near_a_block_is_lifted() -> None:
    rng = random.Random(5)
    cells = rng.sample(list(itertools.product(range(8), repeat=2)), 30)
    contours = tuple(
        make_block(25.0 * x, 25.0 * y, rng.uniform(8, 20), f"c{k}")
        for k, (x, y) in enumerate(cells)
    )
    part = Part("p", "p.dxf", "mm", contours, ())
    job = Job(
        operation=OperationTable(depth=1.0),
        tool=ToolTable(diameter=3.0),
        process=ProcessTable(stay_down=True),
        cell=CellTable(),
    )
    tour = order_paths(follow(part, job)[0], TourTable("best"), (0.0, 0.0), True)
    lowered, _ = stay_down(tour, part, job)
    assert 5 < len(lowered.down) < 30
    t = np.linspace(0, 1, 801)[:, None]
    for index in range(1, 30):
        a, b = lowered.paths[index - 1].position[-1, :2], lowered.paths[index].position[0, :2]
        points = a + t * (b - a)
        distance = math.inf
        for contour in contours:
            low, high = contour.points.min(axis=0), contour.points.max(axis=0)
            outside = np.maximum(np.maximum(low - points, points - high), 0.0)
            distance = min(distance, float(np.hypot(*outside.T).min()))
        step = float(np.hypot(*(b - a))) / 800
        assert (index in lowered.down) == (distance >= 1.5 - 0.005) or abs(
            distance - 1.5
        ) < step + 0.01
        if index in lowered.down:
            assert distance >= 1.5 - 0.006


#: A block, and two stretches of its lower side for two operations, the second within the first.
BLOCK = [(0, 0), (40, 0), (40, 20), (0, 20)]
STRETCHES = {"a": [(10, 0), (30, 0)], "b": [(12, 0), (28, 0)]}


@pytest.mark.parametrize(
    ("why", "below", "table", "row", "is_lifted"),
    [
        ("clear", -20.0, {}, {}, False),
        # The tool of 4 mm returns 3 mm from the block, so its far edge is 7 mm from the block.
        # The other block may have a burr of 3 mm.
        ("another block", -9.9, {}, {}, True),
        ("another block, farther", -10.1, {}, {}, False),
        ("a clamp", -20.0, {"cell": {"fixtures": [[15, -9.5, -5, 25, -8, 10]]}}, {}, True),
        ("a clamp, farther", -20, {"cell": {"fixtures": [[15, -11, -5, 25, -9.1, 10]]}}, {}, False),
        ("another speed", -20.0, {}, {"spindle": 5000.0}, True),
        ("another depth", -20.0, {}, {"depth": 1.2}, True),
        ("force", -20.0, {"post": {"force": "ignore"}}, {"force": 5.0}, True),
        ("a ramp", -20.0, {}, {"entry": "ramp"}, True),
        ("not requested", -20.0, {}, {"stay_down": False}, True),
    ],
)  # fmt: skip
def test_the_link_to_the_next_operation_leads_along_the_contour(
    tmp_path, why: str, below: float, table: dict, row: dict, is_lifted: bool
) -> None:
    import ezdxf  # noqa: PLC0415

    document = ezdxf.new("R2010", units=4)
    outlines = [BLOCK, [(0, below - 5), (40, below - 5), (40, below), (0, below)]]
    for points in outlines:
        document.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": "part"})
    for layer, points in STRETCHES.items():
        document.modelspace().add_lwpolyline(points, dxfattribs={"layer": layer})
    document.saveas(tmp_path / "part.dxf")
    job = {
        "tool": {"diameter": 4.0, "center_cutting": True},
        "process": {"spindle": 9000.0},
        "operation": {"depth": 1.0, "side": "right"},
        "operations": [{"layers": ["a"]}, {"layers": ["b"], "stay_down": True} | row],
        **table,
    }
    result = build(tmp_path / "part.dxf", post="gcode", job=job)
    moves = [item for item in result.program.body if isinstance(item, (MoveJ, MoveL))]
    ends = np.array([move.target.origin for move in moves if isinstance(move.target, Pose)])
    low = ends[ends[:, 2] < 0]
    assert count_lifts(result) == 1 + is_lifted, why
    if not is_lifted:
        # In, along the first stretch, out, back, in, and along the second stretch.
        corners = np.array([(30, -2), (10, -2), (10, -5), (28, -5), (28, -2), (12, -2)])
        mirrored = corners * (-1, 1) + (40, 0)
        assert any(np.allclose(low[:, :2], expected) for expected in (corners, mirrored))
