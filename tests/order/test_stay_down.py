"""Ways at working height: the distance of a way from what is drawn, and programs without a needless lift."""

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.intersect import measure_gaps
from camgen.geometry.segments import make_contour_segments, make_segments, points_at
from camgen.model.job import CellTable, Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.pose import Pose, frozen
from camgen.model.program import MoveC, MoveJ, MoveL, Output
from camgen.order.stay_down import stay_down
from camgen.pipeline import build
from tests.support.examples import fewer


@fewer(10)
@given(st.integers(0, 10**6))
def test_the_distance_of_a_way_is_that_of_its_points(seed: int) -> None:
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
    fine = 150
    t = np.linspace(0, 1, fine + 1)
    found = measure_gaps(lines, drawn, 100.0)
    for k in range(6):
        way = lines.start[k] + t[:, None] * (lines.end[k] - lines.start[k])
        least = math.inf
        for row in range(8):
            one = drawn.take(np.full(len(t), row))
            points = points_at(one, t)
            least = min(least, np.linalg.norm(way[:, None] - points[None], axis=2).min())
        # Points so close along both are no farther apart than the two together, and no nearer.
        step = (float(lines.length[k]) + float(drawn.length.max())) / fine / 2
        assert found[k] <= least + 1e-9
        assert found[k] >= least - step - 1e-9
    near = measure_gaps(lines, drawn, 2.0)
    assert (near[found <= 2.0] == found[found <= 2.0]).all()
    assert np.isinf(near[found > 2.0]).all()


def block(x: float, y: float, side: float, name: str) -> Contour:
    points = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]
    return Contour(frozen(points), frozen(np.zeros(4)), True, "0", name)


def drawing(tmp_path, contours: list[list[tuple[float, float]]]):
    import ezdxf  # noqa: PLC0415

    document = ezdxf.new("R2010", units=4)
    for points in contours:
        document.modelspace().add_lwpolyline(points, close=True)
    file = tmp_path / "part.dxf"
    document.saveas(file)
    return file


def box(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


def lifts(result) -> int:
    """Ways at the height of travel between paths: rapid motions that end above."""
    heights = [i.target.origin[2] for i in result.program.body if isinstance(i, (MoveL, MoveJ)) and
               isinstance(i.target, Pose)]  # fmt: skip
    return sum(1 for a, b in itertools.pairwise(heights) if a <= 0 < b)


def test_neighbours_are_reached_without_a_lift_and_what_lies_behind_another_is_not(
    tmp_path,
) -> None:
    # Two blocks face each other; the third has a hole, which needs a lift on both of its ways.
    file = drawing(
        tmp_path, [box(0, 0, 20), box(50, 0, 20), box(1000, 1000, 20), box(1006, 1006, 8)]
    )
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}, "process": {"switch": "contact"}}
    plain = build(file, post="gcode", job=job)
    down = build(
        file, post="gcode", job={**job, "process": {"switch": "contact", "stay_down": True}}
    )
    assert [note.what for note in down.notes if "lifts" in note.what] == ["lifts saved: 1 of 3"]
    assert not [note for note in plain.notes if "lifts" in note.what]
    assert lifts(plain) == 4
    assert lifts(down) == 3
    assert down.motions.seconds < plain.motions.seconds
    # The process is off on every such way, and each keeps 2 mm from every block.
    on, here, ways = False, None, []
    for item in down.program.body:
        if isinstance(item, Output):
            on = bool(item.value)
        elif isinstance(item, (MoveL, MoveC, MoveJ)) and isinstance(item.target, Pose):
            there = item.target.origin
            if here is not None and here[2] == there[2] == -1.0 and not on:
                ways.append((here, there))
            here = there
    assert len(ways) == 1
    drawn = make_contour_segments(down.part.contours)
    for a, b in ways:
        t = np.linspace(0, 1, 2001)[:, None]
        points = np.array(a[:2]) + t * (np.array(b[:2]) - np.array(a[:2]))
        for row in range(len(drawn)):
            sides = points_at(drawn.take(np.full(501, row)), np.linspace(0, 1, 501))
            assert np.linalg.norm(points[:, None] - sides, axis=2).min() >= 2.0 - 0.005


def test_a_tool_that_turns_stays_on_where_it_stays_down(tmp_path) -> None:
    """Off only where it is up: between two blocks that face each other it is not. A block with a hole needs a lift."""
    file = drawing(tmp_path, [box(0, 0, 20), box(50, 0, 20), box(100, 0, 40), box(110, 10, 20)])
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}}
    for stay in (False, True):
        result = build(file, post="rapid", job={**job, "process": {"stay_down": stay}})
        lifted = 4 - len(result.tour.down)
        assert (lifted < 4) == stay
        values = [item.value for item in result.program.body if isinstance(item, Output)]
        assert values == [0, *[1, 0] * lifted]
        on, here = False, None
        for item in result.program.body:
            if isinstance(item, Output):
                on = bool(item.value)
            elif isinstance(item, (MoveL, MoveC)):
                there = item.target.origin
                assert on or there[2] >= 2.0, "at depth with the tool off"
                assert not on or here[:2] == there[:2] or here[2] == there[2] == -1.0, (
                    "travels above the part with it on"
                )
                here = there
            elif isinstance(item, MoveJ) and isinstance(item.target, Pose):
                here = item.target.origin


@pytest.mark.parametrize(
    ("why", "table", "saved"),
    [
        ("clear", {}, 1),
        ("a clamp between", {"cell": {"fixtures": [[30, -50, -5, 40, 80, 10]]}}, 0),
        ("a clamp below the tool", {"cell": {"fixtures": [[30, -50, -5, 40, 80, -2]]}}, 1),
        ("a clamp aside", {"cell": {"fixtures": [[30, 60, -5, 40, 80, 10]]}}, 1),
        (
            "a clamp that holds all of it",
            # An arm is not held up by it: without a robot nothing is known to run into.
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
def test_what_keeps_a_lift(tmp_path, why, table, saved) -> None:
    file = drawing(tmp_path, [box(0, 0, 20), box(50, 0, 20)])
    job = {"tool": {"diameter": 4.0}, "operation": {"depth": 1.0}, **table}
    job["process"] = {
        "stay_down": True,
        "spindle": 0 if "process" in table else 9000,
        **table.get("process", {}),
    }
    result = build(file, post="rapid" if "post" in table else "gcode", job=job)
    assert [n.what for n in result.notes if "lifts" in n.what] == [f"lifts saved: {saved} of 1"], (
        why
    )


def test_no_way_is_taken_down_that_comes_near_a_block() -> None:
    rng = random.Random(5)
    from camgen.order.arrange import TourSettings, order_paths  # noqa: PLC0415
    from camgen.plan.follow import follow  # noqa: PLC0415

    cells = rng.sample([(x, y) for x in range(8) for y in range(8)], 30)
    contours = tuple(
        block(25.0 * x, 25.0 * y, rng.uniform(8, 20), f"c{k}") for k, (x, y) in enumerate(cells)
    )
    part = Part("p", "p.dxf", "mm", contours, ())
    job = Job(operation=OperationTable(depth=1.0), tool=ToolTable(diameter=3.0), process=ProcessTable(stay_down=True),
              cell=CellTable())  # fmt: skip
    tour = order_paths(follow(part, job)[0], TourSettings("best", (0.0, 0.0), True))
    led, _ = stay_down(tour, part, job)
    assert 5 < len(led.down) < 30
    t = np.linspace(0, 1, 801)[:, None]
    for index in range(1, 30):
        a, b = led.paths[index - 1].position[-1, :2], led.paths[index].position[0, :2]
        points = a + t * (b - a)
        room = math.inf
        for contour in contours:
            low, high = contour.points.min(axis=0), contour.points.max(axis=0)
            outside = np.maximum(np.maximum(low - points, points - high), 0.0)
            room = min(room, float(np.hypot(*outside.T).min()))
        step = float(np.hypot(*(b - a))) / 800
        assert (index in led.down) == (room >= 1.5 - 0.005) or abs(room - 1.5) < step + 0.01
        if index in led.down:
            assert room >= 1.5 - 0.006


#: A block, and two stretches of its lower side for two operations, the second within the first.
BLOCK = [(0, 0), (40, 0), (40, 20), (0, 20)]
STRETCHES = {"a": [(10, 0), (30, 0)], "b": [(12, 0), (28, 0)]}


@pytest.mark.parametrize(
    ("why", "below", "table", "row", "is_lifted"),
    [
        ("clear", -20.0, {}, {}, False),
        # The tool of 4 mm returns 3 mm off the block, and its far edge is 7 mm off. A burr of 3 mm
        # may stand on the other block.
        ("another block", -9.9, {}, {}, True),
        ("another block, farther", -10.1, {}, {}, False),
        ("a clamp", -20.0, {"cell": {"fixtures": [[15, -9.5, -5, 25, -8, 10]]}}, {}, True),
        ("a clamp, farther", -20, {"cell": {"fixtures": [[15, -11, -5, 25, -9.1, 10]]}}, {}, False),
        ("another speed", -20.0, {}, {"spindle": 5000.0}, True),
        ("another depth", -20.0, {}, {"depth": 1.2}, True),
        ("force", -20.0, {"post": {"force": "ignore"}}, {"force": 5.0}, True),
        ("a ramp", -20.0, {}, {"entry": "ramp"}, True),
        ("not asked for", -20.0, {}, {"stay_down": False}, True),
    ],
)  # fmt: skip
def test_the_way_to_the_next_operation_leads_beside_the_contour(
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
    assert lifts(result) == 1 + is_lifted, why
    if not is_lifted:
        # In, along the first stretch, out, back, in, and along the second one.
        places = np.array([(30, -2), (10, -2), (10, -5), (28, -5), (28, -2), (12, -2)])
        mirrored = places * (-1, 1) + (40, 0)
        assert any(np.allclose(low[:, :2], expected) for expected in (places, mirrored))
