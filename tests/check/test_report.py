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


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


BODY = (
    Comment("start"),
    MoveJ(Joints((0.0,) * 6), 100.0),
    Output("spindle", 8000.0),
    MoveJ(at(0, 0), 50.0),
    Output("process", 1.0),
    Force(5.0, (1.0, 0.0, 0.0)),
    MoveL(at(30, 40), 10.0),
    MoveC(at(35, 45), at(40, 40), 20.0),  # the quarter circle about (35, 40) is a half: radius 5
    Wait(1.5),
    Force(0.0),
    Output("process", 0.0),
    MoveJ(at(40, 0), 80.0),
)


def test_lengths_time_and_extents() -> None:
    found = sum_up(Columns(BODY))
    assert found.straight == pytest.approx(50.0)
    assert found.arc == pytest.approx(math.pi * 5)
    assert found.joint == pytest.approx(40.0)  # the one from joints has no known length
    assert found.seconds == pytest.approx(50 / 10 + math.pi * 5 / 20 + 40 / 80 + 1.5)
    assert found.extents == ((0.0, 0.0, 0.0), (40.0, 45.0, 0.0))
    assert found.speeds == (10.0, 100.0)
    assert found.outputs == {"spindle": (8000.0,), "process": (1.0, 0.0)}
    assert found.force == 5.0
    kinds = {"MoveJ": 3, "MoveL": 1, "MoveC": 1, "Output": 3, "Wait": 1, "Force": 2}
    assert found.counts == kinds | {"ToolChange": 0, "Stop": 0}


def test_a_program_without_motion_has_no_extents() -> None:
    found = sum_up(Columns((Wait(2.0),)))
    assert (found.extents, found.seconds, found.speeds) == (None, 2.0, (0.0, 0.0))


@given(
    radius=st.floats(0.1, 1000), first=st.floats(-4, 4), sweep=st.floats(0.01, math.pi), part=st.floats(0.1, 0.9)
)  # fmt: skip
def test_arc_length_is_radius_times_sweep_wherever_via_lies(
    radius: float, first: float, sweep: float, part: float
) -> None:
    points = [
        [radius * math.cos(a), radius * math.sin(a), 7.0]
        for a in (first, first + part * sweep, first + sweep)
    ]
    start, via, end = (frozen([p]) for p in points)
    assert measure_arcs(start, via, end)[0] == pytest.approx(radius * sweep, rel=1e-6)


def tool_path(
    ident: str, feeds: list[float], force: list[float], depths: tuple[float, ...] = (0.0,)
) -> ToolPath:
    """Along x in steps of 10 mm."""
    n = len(feeds)
    position = frozen(np.column_stack([np.arange(n) * 10.0, np.zeros(n), np.zeros(n)]))
    return ToolPath(
        ident, "cut", make_waypoints(position, np.nan, feeds, force=force),
        closed=False, depths=depths,
        contours=(ident,), operation="follow",
    )  # fmt: skip


def test_sums_of_paths_count_every_pass_and_every_feed() -> None:
    paths = [tool_path("c1", [10, 10, 5], [0, 0, 0]), tool_path("c2", [20, 20], [3, 3], (1.0, 2.0))]
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
    tour = Tour((tool_path("c1", [10, 10, 5], [0, 4, 2]),), 7.0, "nearest neighbour")
    time = Cycle(4.26, 1.06, frozen([3.2]), frozen([0.555]))
    found = report(part, tour, notes, time, Verified(("p.mod",), 0.00049))
    assert list(found) == [
        "input", "paths", "skipped", "tour", "time_s", "travel_s", "checks", "verify", "files", "notes",
    ]  # fmt: skip
    assert found["input"] == {
        "source": "p?.dxf", "units": "inch", "contours": 2, "closed": 1, "open": 1, "layers": ["cut", "holes"],
    }  # fmt: skip
    # 20 mm in 1 s + 2 s
    assert found["paths"] == [
        {
            "id": "c1", "layer": "cut", "contours": ["c1"], "operation": "follow",
            "closed": False, "length_mm": 20.0, "feed": 6.667, "force": 4.0,
            "time_s": 3.2, "travel_s": 0.56,
        }
    ]  # fmt: skip
    assert found["skipped"] == [{"what": "3 TEXT", "why": "no curves"}]
    assert found["tour"] == {
        "method": "nearest neighbour",
        "work_mm": 20.0,
        "travel_mm": 7.0,
        "bound_mm": None,
    }
    assert (found["time_s"], found["travel_s"]) == (4.3, 1.1)
    assert found["checks"] == dict.fromkeys(("reach", "collision", "limits"), "not checked")
    assert found["verify"] == {"status": "equal", "max_deviation_mm": 0.00049}
    assert found["files"] == ["p.mod"]
    assert found["notes"] == [
        {"kind": "skipped", "what": "3 TEXT", "why": "no curves"}, {"kind": "joined", "what": "2 ends", "why": ""},
    ]  # fmt: skip
