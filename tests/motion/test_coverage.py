"""Pieces of edges that cannot be worked as a whole; walls are formulas of the TCP."""

import math
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from camgen.model.job import ProcessTable
from camgen.model.part import BoolArray, Edge
from camgen.model.pose import FloatArray, frozen
from camgen.motion import coverage, search
from camgen.motion.coverage import SHORTEST_MM, Coverage
from camgen.motion.setup import (
    Blockage,
    EdgeMotion,
    FreeSpace,
    OrientationFreedom,
    SampledMotion,
    Setup,
    all_clear,
)
from camgen.plan.edges.poses import make_poses, measure_line
from camgen.robots.models import Robot
from tests.motion.test_reach import CELL, TOP, check_edge_motion, compute_tcp
from tests.support.edge_shapes import rim, straight

OFFSET = 5.0
FREE = OrientationFreedom(math.radians(15), roll=True)
RIM = rim((60, 60, 50), 50, outer=True)
BORE = rim((60, 60, 50), 6, outer=False)


def _find_no_blockage(motions: Sequence[SampledMotion]) -> list[Blockage | float]:
    return [9.0] * len(motions)


#: Free space without obstacles: each motion has a clearance of 9 mm.
EMPTY_SPACE = FreeSpace(
    0.0, np.zeros(3), np.zeros(3), 0.0, 0.0, _find_no_blockage, _find_no_blockage, all_clear
)
Blocked = Callable[[FloatArray], FloatArray]


def find_pieces(
    edge: Edge, wall: Blocked, freedom: OrientationFreedom = FREE, feed: float = 20.0
) -> tuple[Setup, tuple[EdgeMotion, ...]]:
    """The set-up and the pieces of an edge; the TCP (N, 3) must not be where `wall` is true."""

    def clear(joints: FloatArray) -> FloatArray:
        return np.asarray(~wall(compute_tcp(CELL, joints)[:, :3, 3]))

    def look(motions: list[SampledMotion]) -> list[Blockage | float]:
        colliding = [np.flatnonzero(~clear(motion.joints)) for motion in motions]
        return [
            Blockage("collision", "wall", float(hit[0])) if len(hit) else 9.0 for hit in colliding
        ]

    cell = replace(CELL, clear=clear, roomy=clear)
    space = replace(EMPTY_SPACE, find_blockages=look, gaps=lambda joints: np.zeros(len(joints)))
    path = make_poses(edge, OFFSET)
    result = Coverage(cell, space, freedom, ProcessTable(feed=feed)).find_pieces(
        edge, path, measure_line(edge, path)
    )
    return cell, result.motions


def list_stretches(edge: Edge, pieces: tuple[EdgeMotion, ...]) -> list[tuple[float, float]]:
    """Start and end of each piece, mm along the edge."""
    return [(piece.trimmed[0], edge.length - piece.trimmed[1]) for piece in pieces]


@pytest.mark.parametrize(("low", "high"), [(40.0, 55.0), (41.3, 47.9), (17.0, 103.5)])
def test_a_clamp_over_the_middle_of_an_edge_costs_its_own_width(low: float, high: float) -> None:
    """The TCP runs along x, next to an edge of 120 mm."""
    cell, pieces = find_pieces(TOP, lambda tcp: (tcp[:, 0] > low) & (tcp[:, 0] < high))
    assert [piece.id for piece in pieces] == ["e1.1", "e1.2"]
    assert {piece.line for piece in pieces} == {"e1"}
    (start, end), (restart, last) = list_stretches(TOP, pieces)
    assert (start, last) == (0.0, pytest.approx(TOP.length))
    assert low - 0.5 - 1e-9 <= end <= low + 1e-9
    assert high - 1e-9 <= restart <= high + 0.5 + 1e-9
    for piece, (begin, stop) in zip(pieces, list_stretches(TOP, pieces), strict=True):
        check_edge_motion(cell, piece)
        assert piece.pose_path.position[[0, -1], 0] == pytest.approx([begin, stop])


@pytest.mark.parametrize(("feed", "fraction"), [(20.0, 0.0), (1e5, 1.0)])
def test_the_length_on_which_the_joints_are_too_slow_is_measured(
    feed: float, fraction: float
) -> None:
    """At 1e5 mm/s the rim takes 3 ms, in which no joint can rotate by 1 deg."""
    path = make_poses(RIM, OFFSET)
    result = Coverage(CELL, EMPTY_SPACE, FREE, ProcessTable(feed=feed)).find_pieces(
        RIM, path, measure_line(RIM, path)
    )
    assert result.too_fast == pytest.approx(fraction * RIM.length)
    assert bool(result.motions) is (fraction == 0.0)


def test_no_piece_runs_along_a_folded_segment() -> None:
    """The rim consists of four arcs, of which the second and the third are folded in turn."""
    path = make_poses(RIM, OFFSET)
    lengths = measure_line(RIM, path)
    search_of_pieces = Coverage(CELL, EMPTY_SPACE, FREE, ProcessTable())
    quarter = RIM.length / 4
    for segment in range(4):
        folded = np.arange(4) == segment
        (piece,) = search_of_pieces.find_pieces(RIM, path, lengths, folded).motions
        check_edge_motion(CELL, piece)
        ((start, end),) = list_stretches(RIM, (piece,))
        assert end - start == pytest.approx(3 * quarter)
        assert (start - (segment + 1) * quarter) % RIM.length == pytest.approx(0.0, abs=1e-6)


def test_a_free_stretch_that_is_too_short_is_not_worked() -> None:
    assert find_pieces(TOP, lambda tcp: tcp[:, 0] > SHORTEST_MM - 0.2)[1] == ()
    (piece,) = find_pieces(TOP, lambda tcp: (tcp[:, 0] < 33) | (tcp[:, 0] > 33.6 + SHORTEST_MM))[1]
    (stretch,) = list_stretches(TOP, (piece,))
    assert 33.0 - 1e-9 <= stretch[0] <= 33.5
    assert 33.1 + SHORTEST_MM <= stretch[1] <= 33.6 + SHORTEST_MM + 1e-9


def test_a_piece_of_a_closed_edge_runs_over_its_start() -> None:
    """The rim starts at (110, 60), and the wall is on the opposite side."""
    cell, (piece,) = find_pieces(RIM, lambda tcp: tcp[:, 0] < 30)
    check_edge_motion(cell, piece)
    (stretch,) = list_stretches(RIM, (piece,))
    assert stretch[0] > RIM.length / 2 > stretch[1] - RIM.length
    length = RIM.length - sum(piece.trimmed)
    # The circle of the TCP is larger than the rim, and its free part is in proportion.
    radius = np.hypot(*(piece.pose_path.position[0, :2] - [60, 60]))
    free_length = RIM.length * (1 - math.acos(30 / radius) / math.pi)
    assert free_length - 0.6 <= length <= free_length
    assert np.abs(piece.pose_path.position[[0, -1], 0] - 30).max() < 1.0
    assert piece.reversed().trimmed == piece.trimmed[::-1]


def test_pieces_of_a_closed_edge_do_not_overlap() -> None:
    wall = lambda tcp: (np.abs(tcp[:, 1] - 60) < 4) | (np.abs(tcp[:, 0] - 60) < 4)  # noqa: E731
    _, pieces = find_pieces(RIM, wall)
    assert len(pieces) == 4
    ends = sorted(list_stretches(RIM, pieces))
    assert all(end <= start for (_, end), (start, _) in pairwise(ends))
    radius = float(np.hypot(*(pieces[0].pose_path.position[0, :2] - [60, 60])))
    quarter = RIM.length / 4 - 2 * RIM.length * math.asin(4 / radius) / math.tau
    for low, high in ends:
        assert quarter - 1.2 <= high - low <= quarter


@pytest.mark.parametrize("edge", [RIM, BORE], ids=["boss", "bore"])
def test_a_rotated_graph_of_a_closed_edge_agrees_with_a_rebuilt_one(
    edge: Edge, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wall(tcp: FloatArray) -> FloatArray:
        return np.asarray(tcp[:, 0] > 58)

    _, rotated = find_pieces(edge, wall)
    monkeypatch.setattr(coverage, "_SAME_JOINTS", -1.0)
    _, rebuilt = find_pieces(edge, wall)
    assert list_stretches(edge, rotated) == [
        pytest.approx(stretch) for stretch in list_stretches(edge, rebuilt)
    ]
    for piece, other in zip(rotated, rebuilt, strict=True):
        assert piece.sampled_joints == pytest.approx(other.sampled_joints, abs=1e-6)


def test_a_tilt_avoids_a_wall_that_blocks_the_nominal_orientation() -> None:
    """The wall blocks the tool unless it is tilted by more than 5 deg."""
    nominal = make_poses(TOP, OFFSET).rotation[0, :, 2]

    def clear(joints: FloatArray) -> FloatArray:
        frames = compute_tcp(CELL, joints)
        is_tilted = np.degrees(np.arccos(np.clip(frames[:, :3, 2] @ nominal, -1, 1))) > 5
        return np.asarray(is_tilted | (np.abs(frames[:, 0, 3] - 60) > 10))

    cell = replace(CELL, clear=clear, roomy=clear)
    path = make_poses(TOP, OFFSET)
    lengths = measure_line(TOP, path)
    (piece,) = (
        Coverage(cell, EMPTY_SPACE, FREE, ProcessTable()).find_pieces(TOP, path, lengths).motions
    )
    assert piece.trimmed == (0.0, pytest.approx(0.0, abs=1e-9))
    check_edge_motion(cell, piece)
    nominal_only = Coverage(cell, EMPTY_SPACE, OrientationFreedom(), ProcessTable()).find_pieces(
        TOP, path, lengths
    )
    assert len(nominal_only.motions) == 2


def test_turn_counts_that_no_joint_reaches_do_not_change_pieces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All joints have +-360 deg, as those of Universal Robots."""
    limits = frozen(np.tile([-math.tau, math.tau], (6, 1)))
    module = sys.modules[__name__]
    wide_cell = replace(CELL, robot=replace(CELL.robot, limits=limits))
    monkeypatch.setattr(module, "CELL", wide_cell)
    calls: list[int] = []

    def pass_all(_: Robot, joints: FloatArray, __: float) -> BoolArray:
        calls.append(len(joints))
        return np.ones(joints.shape[2:], dtype=np.bool_)

    for edge in (TOP, RIM):
        _, pieces = find_pieces(edge, lambda tcp: (tcp[:, 0] > 40) & (tcp[:, 0] < 55))
        with monkeypatch.context() as patch:
            patch.setattr(search, "_pass_half_turns", pass_all)
            _, expected = find_pieces(edge, lambda tcp: (tcp[:, 0] > 40) & (tcp[:, 0] < 55))
        assert pieces
        for piece, other in zip(pieces, expected, strict=True):
            assert piece.joints == pytest.approx(other.joints, abs=1e-9)
    assert calls


@pytest.mark.parametrize(("edge", "feed"), [(RIM, 400.0), (BORE, 60.0)], ids=["boss", "bore"])
def test_no_joint_exceeds_its_speed_along_a_piece(edge: Edge, feed: float) -> None:
    """The feed is the speed of the contact along the edge, not of the TCP on its circle."""
    cell, pieces = find_pieces(edge, lambda tcp: tcp[:, 0] < edge.points[:, 0].min() + 6, feed=feed)
    assert pieces
    for piece in pieces:
        joint_seconds = np.abs(np.diff(piece.sampled_joints, axis=0)) / cell.robot.speeds
        tcp_length = piece.sampled_path.length.sum()
        seconds = piece.sampled_path.length / tcp_length * (edge.length - sum(piece.trimmed)) / feed
        assert (joint_seconds.max(axis=1) <= seconds * 1.05 + 1e-9).all()
        # In the bore the joints would be too slow if the TCP itself ran at the feed.
        assert (joint_seconds.max(axis=1) > piece.sampled_path.length / feed).any() == (
            edge is BORE
        )


def test_the_roll_counters_the_rotation_along_the_rim_of_a_small_hole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 60 mm/s a joint is too slow for a rim with a radius of 5 mm without a change of roll."""
    hole = rim((60, 60, 50), 5, outer=False)
    _, whole = find_pieces(hole, lambda tcp: tcp[:, 0] < -1e9, feed=60.0)
    assert [piece.trimmed for piece in whole] == [(0.0, 0.0)]
    monkeypatch.setattr(coverage, "_WIDE_TURN", coverage._STATION_TURN)
    _, pieces = find_pieces(hole, lambda tcp: tcp[:, 0] < -1e9, feed=60.0)
    worked = sum(hole.length - sum(piece.trimmed) for piece in pieces)
    assert worked < hole.length - SHORTEST_MM


def test_the_length_of_a_piece_in_a_small_hole_is_measured_along_the_edge() -> None:
    """6 mm of the rim are free, and the TCP travels 2.5 mm along them."""
    hole = rim((60, 60, 50), 6, outer=False)
    half = SHORTEST_MM / 2 + 0.5

    def wall(tcp: FloatArray) -> FloatArray:
        angle = np.arctan2(tcp[:, 1] - 60, tcp[:, 0] - 60)
        return np.abs(np.abs(angle) - math.pi / 2) * 6 > half

    cell, pieces = find_pieces(hole, lambda tcp: wall(tcp) | (tcp[:, 1] < 60), feed=1.0)
    (piece,) = pieces
    check_edge_motion(cell, piece)
    ((start, end),) = list_stretches(hole, pieces)
    assert SHORTEST_MM <= end - start <= 2 * half
    assert piece.pose_path.length.sum() < SHORTEST_MM / 2


def test_an_arm_without_a_closed_form_has_no_pieces() -> None:
    path = make_poses(TOP, OFFSET)
    space = FreeSpace(0.0, path.position[0], path.position[0], 0.0, 0.0, list, list, all_clear)
    without_closed_form = replace(CELL, robot=replace(CELL.robot, arm=None))
    pieces = Coverage(without_closed_form, space, FREE, ProcessTable())
    assert pieces.find_pieces(TOP, path, path.length).motions == ()


def test_lengths_are_measured_along_the_edge_and_not_along_the_pose_path() -> None:
    path = make_poses(RIM, OFFSET)
    assert measure_line(RIM, path).sum() == pytest.approx(RIM.length)
    assert path.length.sum() == pytest.approx(RIM.length * (50 + OFFSET / math.sqrt(2)) / 50)
    line = straight((0, 0, 0), (60, 0, 0), (0, 0, 1), (0, -1, 0))
    assert measure_line(line, make_poses(line, OFFSET)).tolist() == [60.0]
