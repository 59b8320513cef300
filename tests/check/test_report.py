import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.check.report import Cycle, Verified, path_sums, report, sum_up
from camgen.geometry.arcs import measure_arcs
from camgen.model.part import Contour, Note, Part
from camgen.model.path import ToolPath, Tour, make_waypoints
from camgen.model.pose import TOOL_DOWN, Pose, frozen
from camgen.model.program import Columns, Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Wait


def make_pose(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


BODY = (
    Comment("start"),
    MoveJ(Joints((0.0,) * 6), 100.0),
    Output("spindle", 8000.0),
    MoveJ(make_pose(0, 0), 50.0),
    Output("process", 1.0),
    Force(5.0, (1.0, 0.0, 0.0)),
    MoveL(make_pose(30, 40), 10.0),
    MoveC(make_pose(35, 45), make_pose(40, 40), 20.0),  # half a circle about (35, 40) with radius 5
    Wait(1.5),
    Force(0.0),
    Output("process", 0.0),
    MoveJ(make_pose(40, 0), 80.0),
)


def test_lengths_time_and_extents_of_a_program_are_summed() -> None:
    sums = sum_up(Columns(BODY))
    assert sums.straight == pytest.approx(50.0)
    assert sums.arc == pytest.approx(math.pi * 5)
    assert sums.joint == pytest.approx(40.0)  # the motion from joint values has an unknown length
    assert sums.seconds == pytest.approx(50 / 10 + math.pi * 5 / 20 + 40 / 80 + 1.5)
    assert sums.extents == ((0.0, 0.0, 0.0), (40.0, 45.0, 0.0))
    assert sums.speeds == (10.0, 100.0)
    assert sums.outputs == {"spindle": (8000.0,), "process": (1.0, 0.0)}
    assert sums.force == 5.0
    kinds = {"MoveJ": 3, "MoveL": 1, "MoveC": 1, "Output": 3, "Wait": 1, "Force": 2}
    assert sums.counts == kinds | {"ToolChange": 0, "Stop": 0}


def test_a_program_without_motion_has_no_extents() -> None:
    sums = sum_up(Columns((Wait(2.0),)))
    assert (sums.extents, sums.seconds, sums.speeds) == (None, 2.0, (0.0, 0.0))


@given(
    radius=st.floats(0.1, 1000),
    first=st.floats(-4, 4),
    sweep=st.floats(0.01, math.pi),
    fraction=st.floats(0.1, 0.9),
)
def test_the_length_of_an_arc_is_radius_times_sweep_for_any_via_point(
    radius: float, first: float, sweep: float, fraction: float
) -> None:
    points = [
        [radius * math.cos(a), radius * math.sin(a), 7.0]
        for a in (first, first + fraction * sweep, first + sweep)
    ]
    start, via, end = (frozen([point]) for point in points)
    assert measure_arcs(start, via, end)[0] == pytest.approx(radius * sweep, rel=1e-6)


def make_tool_path(
    ident: str, feeds: list[float], force: list[float], depths: tuple[float, ...] = (0.0,)
) -> ToolPath:
    """A path along x in steps of 10 mm."""
    n = len(feeds)
    position = frozen(np.column_stack([np.arange(n) * 10.0, np.zeros(n), np.zeros(n)]))
    return ToolPath(
        ident, "cut", make_waypoints(position, np.nan, feeds, force=force),
        closed=False, depths=depths,
        contours=(ident,), operation="follow",
    )  # fmt: skip


def test_sums_of_paths_include_each_pass_and_each_feed() -> None:
    paths = [
        make_tool_path("c1", [10, 10, 5], [0, 0, 0]),
        make_tool_path("c2", [20, 20], [3, 3], (1.0, 2.0)),
    ]
    lengths, seconds = path_sums(paths)
    assert lengths.tolist() == [20.0, 20.0]
    assert seconds.tolist() == [10 / 10 + 10 / 5, 2 * 10 / 20]


def test_the_report_has_the_keys_of_the_contract() -> None:
    contours = (
        Contour(frozen([[0, 0], [1, 0]]), frozen([0, 0]), False, "cut", "c1"),
        Contour(frozen([[0, 0], [1, 0]]), frozen([1, 1]), True, "holes", "c2"),
    )
    part = Part("p", "p\udce4.dxf", "inch", contours, ())
    notes = (Note("skipped", "3 TEXT", "no curves"), Note("joined", "2 ends"))
    tour = Tour((make_tool_path("c1", [10, 10, 5], [0, 4, 2]),), 7.0, "nearest neighbour")
    time = Cycle(4.26, 1.06, frozen([3.2]), frozen([0.555]))
    data = report(part, tour, notes, time, Verified(("p.mod",), 0.00049))
    assert list(data) == [
        "input", "paths", "skipped", "tour", "time_s", "travel_s", "checks", "verify", "files",
        "notes",
    ]  # fmt: skip
    assert data["input"] == {
        "source": "p?.dxf", "units": "inch", "contours": 2, "closed": 1, "open": 1,
        "layers": ["cut", "holes"],
    }  # fmt: skip
    # The feed is the mean: 20 mm in 1 s + 2 s.
    assert data["paths"] == [
        {
            "id": "c1", "layer": "cut", "contours": ["c1"], "operation": "follow",
            "closed": False, "length_mm": 20.0, "feed": 6.667, "force": 4.0,
            "time_s": 3.2, "travel_s": 0.56,
        }
    ]  # fmt: skip
    assert data["skipped"] == [{"what": "3 TEXT", "why": "no curves"}]
    assert data["tour"] == {
        "method": "nearest neighbour",
        "work_mm": 20.0,
        "travel_mm": 7.0,
        "bound_mm": None,
    }
    assert (data["time_s"], data["travel_s"]) == (4.3, 1.1)
    assert data["checks"] == dict.fromkeys(("reach", "collision", "limits"), "not checked")
    assert data["verify"] == {"status": "equal", "max_deviation_mm": 0.00049}
    assert data["files"] == ["p.mod"]
    assert data["notes"] == [
        {"kind": "skipped", "what": "3 TEXT", "why": "no curves"},
        {"kind": "joined", "what": "2 ends", "why": ""},
    ]  # fmt: skip
