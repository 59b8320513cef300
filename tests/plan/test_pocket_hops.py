"""Hops of pockets: rapid links over cleared ground, a little above the floor, and their faults."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

import camgen
from bench.plan.pockets import shapes
from bench.support.gcode_text import Move
from bench.support.swept_text import count_struck, read_cut
from camgen.model.body import Body
from camgen.model.errors import NoSafeProgram, VerifyError
from camgen.model.job import Job, OperationTable
from camgen.plan import plan
from tests.support.drawn import circle, part, rectangle
from tests.support.sabotage import Patch, change_program, with_columns

LIFT, DIAMETER = 0.3, 6.0
POCKET = part(rectangle(0, 0, 60, 40), circle(20, 20, 6, "c2"))


def make_job(**operation: Any) -> dict[str, Any]:
    settings = {"kind": "pocket", "depth": 4.0, "passes": 2, "entry": "helix", **operation}
    return {
        "operation": settings,
        "tool": {"diameter": DIAMETER},
        "process": {"spindle": 9000.0, "feed": 20.0, "travel": 100.0},
    }


@cache
def build_text(**operation: Any) -> str:
    """The G-code text of the pocket, built once for all tests."""
    return camgen.build(POCKET, post="gcode", job=make_job(**operation)).text


def list_hops(motions: list[Move]) -> list[Move]:
    """Rapid motions across, below the top face."""
    across = [motion for motion in motions if motion.rapid and motion.low < 0]
    return [hop for hop in across if math.dist(hop.points[0, :2], hop.points[-1, :2]) > 1e-6]


@pytest.mark.parametrize("settings", [{}, {"stepover": 0.3}, {"direction": "conventional"}])
def test_hops_are_level_above_a_floor_and_meet_no_material(settings: dict[str, Any]) -> None:
    motions = read_cut(build_text(**settings))
    hops = list_hops(motions)
    assert len(hops) > 20
    for motion in hops:
        assert np.ptp(motion.points[:, 2]) == 0.0
        assert min(abs(motion.low - LIFT + depth) for depth in (2.0, 4.0)) < 1e-6
    assert count_struck(motions, DIAMETER / 2) == 0


def test_hops_of_random_pockets_meet_no_material() -> None:
    motions = read_cut(camgen.build(shapes(6), post="gcode", job=make_job()).text)
    assert list_hops(motions)
    assert count_struck(motions, DIAMETER / 2) == 0


@pytest.mark.parametrize(
    "settings", [{"engagement": 1.0}, {"entry": "ramp"}], ids=["no channel", "on a ramp"]
)
def test_a_pocket_without_level_returns_has_no_hops(settings: dict[str, Any]) -> None:
    assert not list_hops(read_cut(build_text(**settings)))


def find_hops(body: Body) -> np.ndarray:
    """Indices of the horizontal motions at the height of a hop, (K,)."""
    height = body.packed.end[:, 2]
    level = np.append(False, np.abs(np.diff(height)) < 1e-9)
    return np.flatnonzero(level & (np.abs(height + 4.0 - LIFT) < 1e-6))


def lower_to_floor(body: Body) -> Body:
    """Leaves out the lift of the first hop."""
    end = body.packed.end.copy()
    row = int(find_hops(body)[0])
    end[[row - 1, row], 2] = -4.0
    return with_columns(body, end=end)


def raise_hop(body: Body) -> Body:
    end = body.packed.end.copy()
    row = int(find_hops(body)[0])
    end[[row - 1, row], 2] += 1.0
    return with_columns(body, end=end)


def lengthen_hop(body: Body) -> Body:
    """Makes the first hop 12 mm longer."""
    end, row = body.packed.end.copy(), int(find_hops(body)[0])
    step = end[row, :2] - end[row - 1, :2]
    end[row, :2] += 12 * step / np.hypot(*step)
    return with_columns(body, end=end)


@pytest.mark.parametrize("fault", [lower_to_floor, raise_hop, lengthen_hop])
def test_a_fault_in_a_hop_is_found(fault: Any, monkeypatch: Patch) -> None:
    assert build_text()
    change_program(monkeypatch, fault)
    with pytest.raises((VerifyError, NoSafeProgram)):
        camgen.build(POCKET, post="gcode", job=make_job())


def test_a_pocket_of_no_depth_has_no_hops() -> None:
    """A pocket of no depth has no floor to hop above."""
    flat = plan(POCKET, Job(operation=OperationTable(kind="pocket")))
    assert all(not path.position[:, 2].any() for path in flat.paths)
