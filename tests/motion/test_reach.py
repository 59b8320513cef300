"""Which edges a robot reaches, with which joints, and why not: judged by forward kinematics and by hand."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.part import Edge
from camgen.model.pose import FloatArray, Pose, pose_from_values, translation
from camgen.motion.pose_paths import PosePath, cut
from camgen.motion.setup import EdgeMotion, OrientationFreedom, Setup, UnreachableEdge
from camgen.plan.edges.last_face import TOP as UPPER
from camgen.plan.edges.poses import make_poses, reach
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.joint_limits import are_within_limits
from tests.support.arm_models import by_hand
from tests.support.edge_shapes import rim, straight
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = find_robot("IRB 2400")
TOOL = pose_from_values((-60, 0, 240, 0, -45, 0))
CELL = Setup(ARM, pose_from_values((900, -50, 600, 0, 0, 30)), TOOL)
TOP = straight((0, 0, 50), (120, 0, 50), (0, 0, 1), (0, -1, 0))
NONE, BOTH = OrientationFreedom(), OrientationFreedom(math.radians(20), roll=True)


def matrix(pose: Pose) -> FloatArray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = pose.rotation, pose.origin
    return out


def tcp(cell: Setup, joints: FloatArray) -> FloatArray:
    """work_from_tcp (N, 4, 4) of joints (N, J) by textbook matrices."""
    rows = [by_hand(cell.robot.name, np.degrees(q)) @ matrix(cell.flange_from_tool) for q in joints]
    return np.linalg.inv(matrix(cell.base_from_work)) @ np.array(rows)


def reached(cell: Setup, edge: Edge, freedom: OrientationFreedom = NONE) -> EdgeMotion:
    (found,) = reach([edge], cell, 5.0, "mean", freedom)
    assert isinstance(found, EdgeMotion), found
    return found


def refused(cell: Setup, edge: Edge, freedom: OrientationFreedom = NONE) -> UnreachableEdge:
    (found,) = reach([edge], cell, 5.0, "mean", freedom)
    assert isinstance(found, UnreachableEdge)
    return found


def judged(cell: Setup, found: EdgeMotion) -> FloatArray:
    """The joints of ``found`` against its way, the limits and continuity; returns the dense TCP frames."""
    for frame, position, rotation in zip(
        tcp(cell, found.joints), found.pose_path.position, found.pose_path.rotation, strict=True
    ):
        assert np.allclose(frame[:3, 3], position, atol=1e-6)
        assert np.allclose(frame[:3, :3], rotation, atol=1e-9)
    assert np.array_equal(found.sampled_joints[found.at], found.joints)
    assert are_within_limits(cell.robot, found.sampled_joints).all()
    assert np.abs(np.diff(found.sampled_joints, axis=0)).max() <= math.radians(15) + 1e-9
    dense = tcp(cell, found.sampled_joints)
    assert np.linalg.norm(np.diff(dense[:, :3, 3], axis=0), axis=1).max() <= 5 + 1e-6
    assert cell.clear(found.sampled_joints).all()
    return dense


def nominal(edge: Edge) -> FloatArray:
    way = make_poses(edge, 5.0)
    assert isinstance(way, PosePath)
    return way.rotation[0]


def test_a_line_is_two_rows_and_stays_a_line_with_its_orientation() -> None:
    found = reached(CELL, TOP)
    assert len(found.pose_path) == 2
    dense = judged(CELL, found)
    h = 5 / math.sqrt(2)
    assert np.allclose(dense[:, 1:3, 3], [-h, 50 + h], atol=1e-6)
    assert np.allclose(dense[[0, -1], 0, 3], [0, 120], atol=1e-6)
    assert (np.diff(dense[:, 0, 3]) > 0).all()
    assert np.allclose(dense[:, :3, :3], nominal(TOP), atol=1e-9)


def test_freedom_is_not_used_where_it_is_not_needed() -> None:
    plain, freed = reached(CELL, TOP), reached(CELL, TOP, BOTH)
    assert freed.freed is None
    assert np.array_equal(plain.sampled_joints, freed.sampled_joints)


def test_backwards_is_the_same_motion() -> None:
    found = reached(CELL, rim((60, 60, 40), 40, outer=True))
    back = found.reversed()
    assert (found.backwards, back.backwards) == (False, True)
    assert np.array_equal(back.sampled_joints, found.sampled_joints[::-1])
    judged(CELL, back)
    assert np.array_equal(back.reversed().at, found.at)


def test_out_of_reach_says_by_how_many_mm() -> None:
    # The tool straight down: the wrist is 85 + 240 mm above the TCP along the flange, here with a tool straight ahead.
    cell = Setup(ARM, translation(2500, 0, 0), translation(0, 0, 240))
    (found,) = reach([straight((0, 0, 0), (50, 0, 0), (0, 0, 1), (0, -1, 0))], cell, 5.0, UPPER)
    assert isinstance(found, UnreachableEdge)
    # Axis 2 of an IRB 2400/10 at x = 100, z = 615; upper arm 705, forearm 755 and 135.
    wrist = math.hypot(2500 - 100, 5 + 240 + 85 - 615)
    by = wrist - 705 - math.hypot(755, 135)
    assert found.kind == "reach"
    stated = re.fullmatch(r"out of reach by ([0-9.]+) mm, 0 mm along it", found.text)
    assert stated
    assert float(stated[1]) == pytest.approx(by, abs=1e-3)


def through(joints: list[float], ahead: float) -> tuple[Setup, Edge]:
    """An edge along tool y whose nominal pose in its middle is that of ``joints`` (deg), and a cell with it."""
    frame = by_hand(ARM.name, joints) @ matrix(TOOL)
    z, y, at = frame[:3, 2], frame[:3, 1], frame[:3, 3] + 5 * frame[:3, 2]
    cell = Setup(ARM, translation(0, 0, 0), TOOL)
    return cell, straight(at - ahead * y, at + ahead * y, -z, -z)


def test_a_straight_wrist_is_named() -> None:
    cell, edge = through([0, 10, 20, 0, 0, 0], 30)
    found = refused(cell, edge)
    assert found.kind == "singular"
    assert "wrist straight" in found.text


def test_freedom_leads_past_the_singularity() -> None:
    cell, edge = through([0, 10, 20, 0, 0, 0], 30)
    found = reached(cell, edge, BOTH)
    judged(cell, found)
    assert found.freed
    assert np.abs(found.sampled_joints[:, 4]).min() >= math.radians(2)


def test_a_limit_is_named_with_its_amount() -> None:
    # Nominal pose with axis 5 at 125 deg of 120, the other wrist at -125; nothing else comes near the edge.
    cell, edge = through([0, 0, 0, 0, 125, 0], 1)
    found = refused(cell, edge)
    assert found.kind == "limit"
    stated = re.match(r"axis 5 is beyond its limit by ([0-9.]+) deg, 0 mm along it$", found.text)
    assert stated
    assert float(stated[1]) == pytest.approx(5, abs=0.2)


def leaning(cell: Setup, axis: FloatArray, least: float) -> Setup:
    """``cell`` where the tool must lean by ``least`` deg from ``axis`` (work frame) at least."""

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        z = cell.base_from_work.rotation.T @ compute_flange(ARM, joints)[0] @ TOOL.rotation[:, 2]
        return np.asarray(z @ axis <= math.cos(math.radians(least)))

    return replace(cell, clear=clear, hit=lambda _: "the holder with the part")


def test_a_collision_is_named_and_then_avoided_by_no_more_tilt_than_needed() -> None:
    axis = nominal(TOP)[:, 2]
    cell = leaning(CELL, axis, 8)
    assert refused(cell, TOP) == UnreachableEdge(
        "e1", "collision", "collision, the holder with the part, 0 mm along it"
    )
    found = reached(cell, TOP, OrientationFreedom(math.radians(20)))
    judged(cell, found)
    assert found.freed
    assert found.freed[0] == pytest.approx(10)  # the grid has halves of 20
    assert found.freed[1] == pytest.approx(0, abs=1e-9)
    assert len(found.pose_path) == 2
    dense = tcp(cell, found.sampled_joints)
    assert np.allclose(np.degrees(np.arccos(dense[:, :3, 2] @ axis)), 10)
    assert np.allclose(np.degrees(found.tilt), 10)


def test_what_no_tilt_avoids_is_refused_with_both_reasons() -> None:
    cell = leaning(CELL, nominal(TOP)[:, 2], 25)
    text = refused(cell, TOP, BOTH).text
    first = "collision, the holder with the part, 0 mm along it"
    assert text == f"{first}; with 20 deg of tilt and any roll: collision, the holder with the part"


def test_a_roll_is_taken_before_a_tilt() -> None:
    frame = nominal(TOP)

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        x = CELL.base_from_work.rotation.T @ compute_flange(ARM, joints)[0] @ TOOL.rotation[:, 0]
        return np.asarray(x @ frame[:, 0] <= math.cos(math.radians(20)))

    cell = replace(CELL, clear=clear)
    found = reached(cell, TOP, BOTH)
    judged(cell, found)
    assert found.freed == pytest.approx((0, 30), abs=1e-6)


def test_another_branch_is_taken_before_any_freedom() -> None:
    first = reached(CELL, TOP)
    sign = math.copysign(1, first.joints[0, 4])
    cell = replace(CELL, clear=lambda joints: np.asarray(joints[:, 4] * sign < 0))
    found = reached(cell, TOP, BOTH)
    judged(cell, found)
    assert found.freed is None
    # Without freedom allowed too: no orientation but the nominal one is needed.
    assert np.array_equal(reached(cell, TOP).sampled_joints, found.sampled_joints)


def test_an_obstacle_half_way_is_passed_by_tilting_there_only() -> None:
    axis = nominal(TOP)[:, 2]

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        frames = tcp(CELL, joints)
        there = np.abs(frames[:, 0, 3] - 60) < 15
        return np.asarray(~there | (frames[:, :3, 2] @ axis <= math.cos(math.radians(5))))

    cell = replace(CELL, clear=clear)
    assert refused(cell, TOP).text == "collision, something, 50 mm along it"
    found = reached(cell, TOP, OrientationFreedom(math.radians(20)))
    dense = judged(cell, found)
    assert np.allclose(dense[:, 1:3, 3], [-5 / math.sqrt(2), 50 + 5 / math.sqrt(2)], atol=1e-6)
    assert np.degrees(found.tilt).max() == pytest.approx(10, abs=0.01)
    assert np.allclose(found.tilt[[0, -1]], 0, atol=1e-9)
    assert (
        len(found.pose_path) == 4
    )  # 120 mm in stretches of 40: upright, leaning, leaning, upright


@pytest.mark.parametrize("name", ["e6", "e11"])
def test_a_rim_that_winds_the_wrist_up_is_unwound_by_rolling_along_it(name: str) -> None:
    solid = mesh.read(source(PARTS / "rfa2.stl"))
    edge = next(e for e in solid.edges if e.id == name)
    arm = find_robot("IRB 2000")
    cell = Setup(
        arm, pose_from_values((1050, -50, 500, 0, 0, 45)), pose_from_values((60, 0, 240, 0, 45, 0))
    )
    assert refused(cell, edge).kind in ("limit", "jump", "singular")
    found = reached(cell, edge, OrientationFreedom(roll=True))
    dense = judged(cell, found)
    assert found.freed
    assert found.freed[0] < 2  # between rows 30 deg apart the axis cuts the cone's corner
    assert len(found.pose_path) <= 13
    # The TCP stays on the circle: bore of radius 20, square to the bank, less the offset's part.
    middle = edge.points[:2].mean(axis=0)
    out = edge.normals[0, 1] + edge.normals[1, 1]
    out /= np.linalg.norm(out)
    away = dense[:, :3, 3] - middle
    assert np.allclose(away @ out, 5 / math.sqrt(2), atol=0.02)
    radius = np.linalg.norm(away - np.outer(away @ out, out), axis=1)
    assert np.allclose(radius, 20 - 5 / math.sqrt(2), atol=0.02)


def test_an_arm_without_a_closed_form_has_freedom_too() -> None:
    arm = find_robot("COBOTTA")
    edge = straight((-15, 0, 0), (15, 0, 0), (0, 0, 1), (0, -1, 0))
    cell = Setup(arm, translation(200, 60, 100), translation(0, 0, 60))
    plain = reached(cell, edge)
    axis = nominal(edge)[:, 2]

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(
            compute_flange(arm, joints)[0][:, :, 2] @ axis <= math.cos(math.radians(5))
        )

    found = reached(replace(cell, clear=clear), edge, OrientationFreedom(math.radians(10)))
    assert plain.freed is None
    assert found.freed == pytest.approx((5, 0), abs=1e-6) or found.freed == pytest.approx(
        (10, 0), abs=1e-6
    )
    rotations, origins = compute_flange(arm, found.sampled_joints)
    line = origins + rotations @ [0, 0, 60] - [200, 60, 100]
    assert np.allclose(line[:, 1:], [-5 / math.sqrt(2), 5 / math.sqrt(2)], atol=1e-6)
    assert clear(found.sampled_joints).all()


@pytest.mark.parametrize("name", ["IRB 2400", "COBOTTA", "Cobra s600", "3-axis mill"])
def test_an_edge_far_away_is_refused_whatever_is_free(name: str) -> None:
    cell = Setup(find_robot(name), translation(90_000, 0, 0), translation(0, 0, 100))
    found = refused(cell, TOP, BOTH)
    assert found.kind in ("reach", "lean", "limit")
    assert found.text.endswith("; with 20 deg of tilt and any roll: no way either")


def test_a_scara_reaches_an_edge_from_above_but_cannot_lean() -> None:
    cell = Setup(find_robot("Cobra s600"), translation(350, 100, 100), translation(0, 0, 60))
    (burr, mean) = (reach([TOP], cell, 5.0, direction)[0] for direction in (UPPER, "mean"))
    assert isinstance(burr, EdgeMotion)
    rotations, origins = compute_flange(cell.robot, burr.joints)
    assert np.allclose(origins + rotations @ [0, 0, 60], [[350, 100, 155], [470, 100, 155]])
    assert isinstance(mean, UnreachableEdge)
    assert (mean.kind, mean.text) == (
        "lean",
        "the robot cannot lean its tool by 45 deg, 0 mm along it",
    )


# -- pieces of ways --------------------------------------------------------------------------------


@pytest.mark.parametrize(("low", "high"), [(0.0, 30.0), (10.0, 55.0), (25.0, 26.0), (12.0, 71.4)])
def test_a_piece_of_a_way_is_the_same_motion(low: float, high: float) -> None:
    """A line of 20 mm and a quarter circle of radius 30 mm: points, length and turn of the piece by hand."""
    quarter = 30 * math.pi / 2
    turn = [np.eye(3), np.eye(3), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])]
    via = [
        (math.nan,) * 3,
        (math.nan,) * 3,
        (20 + 30 * math.sin(math.pi / 4), 30 - 30 * math.cos(math.pi / 4), 0),
    ]
    way = PosePath(np.array([(0.0, 0, 0), (20, 0, 0), (50, 30, 0)]), np.array(via), np.array(turn))
    high = min(high, 20 + quarter)
    piece = cut(way, low, high)
    assert piece.length.sum() == pytest.approx(high - low)

    def at(s: float) -> tuple[FloatArray, float]:
        if s <= 20:
            return np.array([s, 0, 0]), 0.0
        angle = (s - 20) / 30
        return np.array([20 + 30 * math.sin(angle), 30 - 30 * math.cos(angle), 0]), angle

    for k, s in ((0, low), (-1, high)):
        place, angle = at(s)
        assert piece.position[k] == pytest.approx(place, abs=1e-9)
        assert math.atan2(piece.rotation[k, 1, 0], piece.rotation[k, 0, 0]) == pytest.approx(
            angle, abs=1e-9
        )
    if high > 20:
        assert piece.via[-1] == pytest.approx(at((max(low, 20) + high) / 2)[0], abs=1e-9)
    assert np.isnan(piece.via[0]).all()
