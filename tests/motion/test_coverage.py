"""Pieces of edges that cannot be worked whole, with walls that are formulas of the TCP."""

import math
import sys
from collections.abc import Callable
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
from tests.motion.test_reach import CELL, TOP, judged, tcp
from tests.support.edge_shapes import rim, straight

OFFSET = 5.0
FREE = OrientationFreedom(math.radians(15), roll=True)
RIM = rim((60, 60, 50), 50, outer=True)
BORE = rim((60, 60, 50), 6, outer=False)
Blocked = Callable[[FloatArray], FloatArray]


def cover(
    edge: Edge, wall: Blocked, freedom: OrientationFreedom = FREE, feed: float = 20.0
) -> tuple[Setup, tuple[EdgeMotion, ...]]:
    """The pieces of an edge, whose TCP positions (N, 3) must not lie where ``wall`` is true."""

    def clear(joints: FloatArray) -> FloatArray:
        return np.asarray(~wall(tcp(CELL, joints)[:, :3, 3]))

    def look(motions: list[SampledMotion]) -> list[Blockage | float]:
        hits = [np.flatnonzero(~clear(motion.joints)) for motion in motions]
        return [Blockage("collision", "wall", float(hit[0])) if len(hit) else 9.0 for hit in hits]

    cell = replace(CELL, clear=clear, roomy=clear)
    none = np.zeros(3)
    space = FreeSpace(0.0, none, none, 0.0, 0.0, look, lambda joints: np.zeros(len(joints)))
    path = make_poses(edge, OFFSET)
    result = Coverage(cell, space, freedom, ProcessTable(feed=feed)).find_pieces(
        edge, path, measure_line(edge, path)
    )
    return cell, result.motions


def stretches(edge: Edge, pieces: tuple[EdgeMotion, ...]) -> list[tuple[float, float]]:
    """The lengths along the edge between which each piece runs."""
    return [(piece.trimmed[0], edge.length - piece.trimmed[1]) for piece in pieces]


@pytest.mark.parametrize(("low", "high"), [(40.0, 55.0), (41.3, 47.9), (17.0, 103.5)])
def test_a_clamp_over_the_middle_costs_its_own_width(low: float, high: float) -> None:
    """The TCP runs along x beside an edge of 120 mm."""
    cell, pieces = cover(TOP, lambda at: (at[:, 0] > low) & (at[:, 0] < high))
    assert [piece.id for piece in pieces] == ["e1.1", "e1.2"]
    assert {piece.line for piece in pieces} == {"e1"}
    (start, end), (again, last) = stretches(TOP, pieces)
    assert (start, last) == (0.0, pytest.approx(TOP.length))
    assert low - 0.5 - 1e-9 <= end <= low
    assert high <= again <= high + 0.5 + 1e-9
    for piece, (begin, stop) in zip(pieces, stretches(TOP, pieces), strict=True):
        judged(cell, piece)
        assert piece.pose_path.position[[0, -1], 0] == pytest.approx([begin, stop])


@pytest.mark.parametrize(("feed", "share"), [(20.0, 0.0), (1e5, 1.0)])
def test_the_length_is_measured_along_which_the_joints_are_too_slow(
    feed: float, share: float
) -> None:
    """At 1e5 mm/s the rim takes 3 ms, in which no joint turns by a degree."""
    none = np.zeros(3)
    space = FreeSpace(0.0, none, none, 0.0, 0.0, lambda motions: [9.0] * len(motions), all_clear)
    path = make_poses(RIM, OFFSET)
    result = Coverage(CELL, space, FREE, ProcessTable(feed=feed)).find_pieces(
        RIM, path, measure_line(RIM, path)
    )
    assert result.too_fast == pytest.approx(share * RIM.length)
    assert bool(result.motions) is (share == 0.0)


def test_no_piece_runs_along_a_folded_segment() -> None:
    """The rim consists of four arcs, of which the second and the third are folded in turn."""
    path = make_poses(RIM, OFFSET)
    lengths = measure_line(RIM, path)
    none = np.zeros(3)
    space = FreeSpace(0.0, none, none, 0.0, 0.0, lambda motions: [9.0] * len(motions), all_clear)
    search_of_pieces = Coverage(CELL, space, FREE, ProcessTable())
    quarter = RIM.length / 4
    for segment in range(4):
        folded = np.arange(4) == segment
        (piece,) = search_of_pieces.find_pieces(RIM, path, lengths, folded).motions
        judged(CELL, piece)
        ((start, end),) = stretches(RIM, (piece,))
        assert end - start == pytest.approx(3 * quarter)
        assert (start - (segment + 1) * quarter) % RIM.length == pytest.approx(0.0, abs=1e-6)


def test_a_free_stretch_that_is_too_short_is_not_worked() -> None:
    assert cover(TOP, lambda at: at[:, 0] > SHORTEST_MM - 0.2)[1] == ()
    (piece,) = cover(TOP, lambda at: (at[:, 0] < 33) | (at[:, 0] > 33.6 + SHORTEST_MM))[1]
    (stretch,) = stretches(TOP, (piece,))
    assert 33.0 - 1e-9 <= stretch[0] <= 33.5
    assert 33.1 + SHORTEST_MM <= stretch[1] <= 33.6 + SHORTEST_MM + 1e-9


def test_a_piece_of_a_closed_edge_runs_over_its_start() -> None:
    """The rim starts at (110, 60); the wall is at its other side."""
    cell, (piece,) = cover(RIM, lambda at: at[:, 0] < 30)
    judged(cell, piece)
    (stretch,) = stretches(RIM, (piece,))
    assert stretch[0] > RIM.length / 2 > stretch[1] - RIM.length
    run = RIM.length - sum(piece.trimmed)
    # The TCP runs on a circle that is as much wider as it is farther out.
    wide = np.hypot(*(piece.pose_path.position[0, :2] - [60, 60]))
    free = RIM.length * (1 - math.acos(30 / wide) / math.pi)
    assert free - 0.6 <= run <= free
    assert np.abs(piece.pose_path.position[[0, -1], 0] - 30).max() < 1.0
    assert piece.reversed().trimmed == piece.trimmed[::-1]


def test_pieces_of_a_closed_edge_do_not_overlap() -> None:
    wall = lambda at: (np.abs(at[:, 1] - 60) < 4) | (np.abs(at[:, 0] - 60) < 4)  # noqa: E731
    _, pieces = cover(RIM, wall)
    assert len(pieces) == 4
    ends = sorted(stretches(RIM, pieces))
    assert all(end <= start for (_, end), (start, _) in pairwise(ends))
    wide = float(np.hypot(*(pieces[0].pose_path.position[0, :2] - [60, 60])))
    quarter = RIM.length / 4 - 2 * RIM.length * math.asin(4 / wide) / math.tau
    for low, high in ends:
        assert quarter - 1.2 <= high - low <= quarter


@pytest.mark.parametrize("edge", [RIM, BORE], ids=["boss", "bore"])
def test_the_graph_of_a_closed_edge_is_the_same_from_its_new_start(
    edge: Edge, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wall(at: FloatArray) -> FloatArray:
        return np.asarray(at[:, 0] > 58)

    _, turned = cover(edge, wall)
    monkeypatch.setattr(coverage, "_SAME_JOINTS", -1.0)
    _, made_again = cover(edge, wall)
    assert stretches(edge, turned) == [
        pytest.approx(stretch) for stretch in stretches(edge, made_again)
    ]
    for piece, other in zip(turned, made_again, strict=True):
        assert piece.sampled_joints == pytest.approx(other.sampled_joints, abs=1e-6)


def test_another_orientation_leads_past_what_only_the_nominal_one_meets() -> None:
    """A wall that the axis of the tool meets where it is not leant by 5 deg at least."""
    nominal = make_poses(TOP, OFFSET).rotation[0, :, 2]

    def clear(joints: FloatArray) -> FloatArray:
        frames = tcp(CELL, joints)
        leant = np.degrees(np.arccos(np.clip(frames[:, :3, 2] @ nominal, -1, 1))) > 5
        return np.asarray(leant | (np.abs(frames[:, 0, 3] - 60) > 10))

    cell = replace(CELL, clear=clear, roomy=clear)
    none = np.zeros(3)
    space = FreeSpace(0.0, none, none, 0.0, 0.0, lambda motions: [9.0] * len(motions), all_clear)
    path = make_poses(TOP, OFFSET)
    lengths = measure_line(TOP, path)
    (piece,) = Coverage(cell, space, FREE, ProcessTable()).find_pieces(TOP, path, lengths).motions
    assert piece.trimmed == (0.0, pytest.approx(0.0, abs=1e-9))
    judged(cell, piece)
    stiff = Coverage(cell, space, OrientationFreedom(), ProcessTable()).find_pieces(
        TOP, path, lengths
    )
    assert len(stiff.motions) == 2


def test_whole_turns_that_no_joint_comes_to_change_no_piece(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An arm whose joints turn by 360 deg either way, as those of Universal Robots do."""
    limits = frozen(np.tile([-math.tau, math.tau], (6, 1)))
    module = sys.modules[__name__]
    wide = replace(CELL, robot=replace(CELL.robot, limits=limits))
    monkeypatch.setattr(module, "CELL", wide)
    calls: list[int] = []

    def pass_all(_: Robot, joints: FloatArray, __: float) -> BoolArray:
        calls.append(len(joints))
        return np.ones(joints.shape[2:], dtype=np.bool_)

    for edge in (TOP, RIM):
        _, pieces = cover(edge, lambda at: (at[:, 0] > 40) & (at[:, 0] < 55))
        with monkeypatch.context() as patch:
            patch.setattr(search, "_pass_half_turns", pass_all)
            _, expected = cover(edge, lambda at: (at[:, 0] > 40) & (at[:, 0] < 55))
        assert pieces
        for piece, other in zip(pieces, expected, strict=True):
            assert piece.joints == pytest.approx(other.joints, abs=1e-9)
    assert calls


@pytest.mark.parametrize(("edge", "feed"), [(RIM, 400.0), (BORE, 60.0)], ids=["boss", "bore"])
def test_no_joint_is_asked_to_be_faster_than_it_can(edge: Edge, feed: float) -> None:
    """Each stretch takes as long as the contact needs along the edge, not the tip on its circle."""
    cell, pieces = cover(edge, lambda at: at[:, 0] < edge.points[:, 0].min() + 6, feed=feed)
    assert pieces
    for piece in pieces:
        moved = np.abs(np.diff(piece.sampled_joints, axis=0)) / cell.robot.speeds
        tip = piece.sampled_path.length.sum()
        seconds = piece.sampled_path.length / tip * (edge.length - sum(piece.trimmed)) / feed
        assert (moved.max(axis=1) <= seconds * 1.05 + 1e-9).all()
        # The joints would be too slow in the bore if the tip itself ran at the feed.
        assert (moved.max(axis=1) > piece.sampled_path.length / feed).any() == (edge is BORE)


def test_the_tool_need_not_turn_with_the_rim_of_a_small_hole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 60 mm/s a joint is too slow for the turn of a rim of 5 mm, unless the roll counters it."""
    hole = rim((60, 60, 50), 5, outer=False)
    _, whole = cover(hole, lambda at: at[:, 0] < -1e9, feed=60.0)
    assert [piece.trimmed for piece in whole] == [(0.0, 0.0)]
    monkeypatch.setattr(coverage, "_WIDE_TURN", coverage._STATION_TURN)
    _, pieces = cover(hole, lambda at: at[:, 0] < -1e9, feed=60.0)
    worked = sum(hole.length - sum(piece.trimmed) for piece in pieces)
    assert worked < hole.length - SHORTEST_MM


def test_a_piece_counts_by_the_length_of_the_edge_in_a_small_hole() -> None:
    """6 mm of the rim are free, along which the tip runs 2.5 mm."""
    hole = rim((60, 60, 50), 6, outer=False)
    half = SHORTEST_MM / 2 + 0.5

    def wall(at: FloatArray) -> FloatArray:
        angle = np.arctan2(at[:, 1] - 60, at[:, 0] - 60)
        return np.abs(np.abs(angle) - math.pi / 2) * 6 > half

    cell, pieces = cover(hole, lambda at: wall(at) | (at[:, 1] < 60), feed=1.0)
    (piece,) = pieces
    judged(cell, piece)
    ((start, end),) = stretches(hole, pieces)
    assert SHORTEST_MM <= end - start <= 2 * half
    assert piece.pose_path.length.sum() < SHORTEST_MM / 2


def test_an_arm_without_a_closed_form_has_no_pieces() -> None:
    path = make_poses(TOP, OFFSET)
    space = FreeSpace(0.0, path.position[0], path.position[0], 0.0, 0.0, list, all_clear)
    bare = replace(CELL, robot=replace(CELL.robot, arm=None))
    assert (
        Coverage(bare, space, FREE, ProcessTable()).find_pieces(TOP, path, path.length).motions
        == ()
    )


def test_lengths_are_those_of_the_edge_not_of_the_way_beside_it() -> None:
    path = make_poses(RIM, OFFSET)
    assert measure_line(RIM, path).sum() == pytest.approx(RIM.length)
    assert path.length.sum() == pytest.approx(RIM.length * (50 + OFFSET / math.sqrt(2)) / 50)
    line = straight((0, 0, 0), (60, 0, 0), (0, 0, 1), (0, -1, 0))
    assert measure_line(line, make_poses(line, OFFSET)).tolist() == [60.0]
