"""Finds the pieces of an edge that the arm can work if it cannot work the whole edge.

Stations along the edge, orientations of the tool and branches of the inverse kinematics form a
ladder graph (`pose_chains`). Each chain of the best cover is examined as the robot runs it. A
stretch in which a chain fails is closed, and the best cover is searched again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets, list_owners
from camgen.model.job import ProcessTable
from camgen.model.part import BoolArray, Line
from camgen.model.pose import FloatArray
from camgen.model.tolerance import SAME_POINT_MM
from camgen.motion.pose_chains import CHANGE, PoseChain, States, Steps, find_cover, find_steps
from camgen.motion.pose_paths import Index, PosePath, count_parts, cut, divide, join
from camgen.motion.reach import widest_grid
from camgen.motion.search import (
    Grid,
    check_states,
    make_states,
    prove,
    thin_out,
)
from camgen.motion.setup import (
    JUMP,
    MARGIN,
    Blockage,
    EdgeMotion,
    FreeSpace,
    OrientationFreedom,
    SampledMotion,
    Setup,
    compute_flange_poses,
    compute_tip_feed,
)
from camgen.robots.kinematics.continuity import Choice, follow
from camgen.robots.kinematics.joint_limits import ON_LIMIT, list_turn_counts
from camgen.robots.models import Robot

#: mm: shorter pieces are not worked.
SHORTEST_MM = 5.0
#: mm: largest distance of two stations, so that each piece has a station.
_STATION_MM = SHORTEST_MM
#: mm: length that a piece must add at least.
_PRICE = SHORTEST_MM / 2
#: rad: largest rotation of the tool, and of a joint, between two stations.
_STATION_TURN, _JUMP = math.radians(10), math.radians(45)
#: rad: largest rotation of the tool if most motions are too fast for a joint. With a step of the
#: roll from station to station the tool does not rotate with the rim of a small hole.
_WIDE_TURN = math.radians(30)
#: Fraction of the motions between stations from which on these are most of them.
_MOSTLY = 0.5
#: Maximum number of stretches of an edge. On a longer edge the stations are farther apart.
_MAX_STRETCHES = 400
#: rad or mm: joint values that differ by less are equal.
_SAME_JOINTS = 1e-6
#: Fraction of a time by which a joint may be late.
_SAME_TIME = 1e-6
#: Number of moves that may fail in a stretch before no chain runs through it.
_FAILURES = 3
#: Parts of the stretch beyond the end of a chain, by which the chain is extended.
_PARTS_BEYOND = 10


class _Ladder(Struct, frozen=True, eq=False):
    """The graph of an edge.

    path: pose path of the edge.
    lengths: length of the edge along each segment of the path, mm.
    folded: whether each segment is folded, so that no piece may run along it.
    parts: number of stretches between stations in each of its segments.
    stations: the pose path with a row at each of the K stations.
    states, transitions: states at the stations, and steps between them.
    checked: (K,) whether the colliding states of a station are closed.
    too_fast: (K - 1,) stretches along which each motion would need a faster joint.
    late: fraction of the motions between stations that would need a faster joint.
    """

    path: PosePath
    lengths: FloatArray
    folded: BoolArray
    parts: Index
    stations: PosePath
    states: States
    transitions: Steps
    checked: BoolArray
    too_fast: BoolArray
    late: float

    def find_chains(self, setup: Setup) -> list[PoseChain]:
        """The best cover of the edge by states that are free.

        All states of a station are checked if a chain is not free there.
        """
        while True:
            chains = find_cover(self.states, self.transitions, self.along_edge, _PRICE)
            if not chains:
                return chains
            station = np.concatenate([np.arange(chain.first, chain.last + 1) for chain in chains])
            joints = np.concatenate([chain.joints for chain in chains])
            is_open = ~self.checked[station]
            colliding = station[is_open][~setup.roomy(joints[is_open])]
            if not len(colliding):
                return chains
            unchecked = np.zeros_like(self.checked)
            unchecked[colliding] = True
            self._check(setup, unchecked)

    @property
    def along_edge(self) -> FloatArray:
        """(K - 1,) length of the edge along each stretch, mm."""
        return np.asarray((self.lengths / self.parts)[list_owners(self.parts)])

    def roll(self, start: int, path: PosePath, lengths: FloatArray, folded: BoolArray) -> _Ladder:
        """The graph of a closed edge that begins at station `start`.

        The joints have the same values at the first and the last station.

        path, lengths, folded: result of `_begin_at`.
        """
        segment, share = self.locate(start)
        parts = np.roll(self.parts, -segment)
        if share > 0:
            before = round(share * int(parts[0]))
            parts = np.concatenate([[parts[0] - before], parts[1:], [before]])
        stations = np.concatenate([np.arange(start, len(self.stations)), np.arange(1, start + 1)])
        stretches = np.roll(np.arange(len(self.too_fast)), -start)
        states, transitions = self.states, self.transitions
        return _Ladder(
            path,
            lengths,
            folded,
            parts,
            divide(path, parts),
            replace(
                states,
                joints=states.joints[stations],
                usable=states.usable[stations],
                open=states.open[stretches],
            ),
            Steps(transitions.time[stretches], transitions.before[stretches]),
            self.checked[stations],
            self.too_fast[stretches],
            self.late,
        )

    def find_lone_states(self, chains: Sequence[PoseChain], setup: Setup) -> list[PoseChain]:
        """Chains of one station each, at stations next to no chain that the arm can reach.

        A stretch that is twice as long as `_STATION_MM` may have no two stations.
        """
        taken = np.zeros(len(self.checked), dtype=np.bool_)
        for chain in chains:
            taken[max(chain.first - 1, 0) : chain.last + 2] = True
        taken |= ~self.states.usable.any(axis=(1, 2, 3))
        self._check(setup, ~self.checked & ~taken)
        lone = []
        for station in np.flatnonzero(~taken).tolist():
            usable = self.states.usable[station]
            cost = np.where(usable.any(axis=-1), self.states.cost[:, None], math.inf)
            orientation, branch = np.unravel_index(int(cost.argmin()), cost.shape)
            if math.isfinite(cost[orientation, branch]):
                turn = int(usable[orientation, branch].argmax())
                joints = self.states.joints[station, orientation, branch]
                joints = joints + math.tau * self.states.table[turn]
                chosen, none = np.array([orientation]), np.zeros(0, dtype=np.int64)
                lone.append(PoseChain(station, chosen, none, int(branch), joints[None]))
        return lone

    def _check(self, setup: Setup, stations: BoolArray) -> None:
        """Close the colliding states of some stations (K,)."""
        check_states(setup.roomy, self.states, np.flatnonzero(stations).tolist())
        self.checked[stations] = True

    def locate(self, station: float) -> tuple[int, float]:
        """The segment of a station, or of a place between two, and its position there, 0 to 1."""
        first = compute_offsets(self.parts)[:-1]
        segment = int(np.searchsorted(first, station, "right")) - 1
        return segment, float((station - first[segment]) / self.parts[segment])

    def measure(self, station: float, lengths: FloatArray) -> float:
        """Distance of a station, or of a place between two, from the start, mm.

        lengths: lengths of the segments, of the edge or of its path, mm.
        """
        segment, share = self.locate(station)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        return float(ends[segment] + share * lengths[segment])


class _Extension(Struct, frozen=True, eq=False):
    """An extension of a chain at one of its ends.

    share: fraction of the stretch beyond that end.
    joints: (1, J) joint values there; (0, J) for none.
    """

    share: float
    joints: FloatArray


class _Piece(Struct, frozen=True, eq=False):
    """A chain with its pose path.

    path: the pose path, with a row at each station and at each end.
    chain: the states at these rows.
    marks: places of these rows along the path of the whole edge, mm.
    trimmed: lengths of the edge before and after the piece, mm.
    segments: segment of the edge between each two rows.
    """

    path: PosePath
    chain: PoseChain
    marks: FloatArray
    trimmed: tuple[float, float]
    segments: Index

    @classmethod
    def make(
        cls, ladder: _Ladder, chain: PoseChain, before: _Extension, after: _Extension
    ) -> _Piece:
        """The piece of a chain that is extended at its ends."""
        ends = len(before.joints), len(after.joints)
        places = np.arange(chain.first - ends[0], chain.last + ends[1] + 1, dtype=np.float64)
        segments = list_owners(ladder.parts)[places[:-1].astype(np.int64)]
        if ends[0]:
            places[0] = chain.first - before.share
        if ends[1]:
            places[-1] = chain.last + after.share
        marks = np.array([ladder.measure(place, ladder.path.length) for place in places.tolist()])
        low, high = (ladder.measure(place, ladder.lengths) for place in (places[0], places[-1]))
        trimmed = low, max(float(ladder.lengths.sum()) - high, 0.0)
        path = join([cut(ladder.path, *pair) for pair in pairwise(marks.tolist())])
        longer = PoseChain(
            chain.first - ends[0],
            np.pad(chain.orientation, ends, mode="edge"),
            np.pad(chain.moves, ends),
            chain.branch,
            np.concatenate([before.joints, chain.joints, after.joints]),
        )
        return cls(path, longer, marks, trimmed, segments)

    def thin_out(self, ladder: _Ladder, motion: EdgeMotion) -> EdgeMotion:
        """The motion with the rows at which a segment ends or the orientation begins to change."""
        changes = self.chain.moves != 0
        needed = changes[:-1] | changes[1:] | (np.diff(self.segments) > 0)
        kept = np.flatnonzero(np.concatenate([[True], needed, [True]]))
        thin = join([cut(ladder.path, *pair) for pair in pairwise(self.marks[kept].tolist())])
        return replace(thin_out(motion, kept, thin), trimmed=self.trimmed)


#: The motion of a chain and of its extensions, and the fraction of the stretch after it in use.
_Lengthened = tuple[EdgeMotion, float]


class _Failure(Struct, frozen=True, eq=False):
    """A chain without a motion, and the number of its stretch that fails."""

    chain: PoseChain
    stretch: int


#: First station, branch and orientations of a chain, and the parts by which it may be longer.
_ChainKey = tuple[int, int, bytes, tuple[int, int]]


class Pieces(Struct, frozen=True, eq=False):
    """The result of the search along an edge.

    motions: the pieces, or the motion along the whole edge, which is not called a piece.
    too_fast: length of the edge along which a joint would have to be faster than it can be, mm.
    late: fraction of the motions between stations that would need a faster joint.
    """

    motions: tuple[EdgeMotion, ...] = ()
    too_fast: float = 0.0
    late: float = 0.0

    def measure(self, line: Line) -> float:
        """Length of an edge along its motions, mm."""
        return sum(line.length - sum(motion.trimmed) for motion in self.motions)


class Coverage(Struct, frozen=True, eq=False):
    """A search for pieces of edges.

    setup: arm, work and tool.
    space: free space, with the test of whole motions.
    freedom: orientations that the tool may have.
    process: feed along the edge.
    """

    setup: Setup
    space: FreeSpace
    freedom: OrientationFreedom
    process: ProcessTable

    def find_pieces(
        self,
        line: Line,
        path: PosePath,
        lengths: FloatArray,
        folded: BoolArray | None = None,
    ) -> Pieces:
        """The motions along as much of an edge as possible, in the order of its length.

        path: pose path of `line`.
        lengths: length of `line` along each segment of the path, mm.
        folded: whether no piece may run along each segment of the path.
        """
        # Without a closed form the joint values at a station depend on those before it.
        if self.setup.robot.arm is None:
            return Pieces()
        if folded is None:
            folded = np.zeros(len(lengths), dtype=np.bool_)
        result = self._find(line, path, lengths, folded, _STATION_TURN)
        if line.length - result.measure(line) < SHORTEST_MM or result.late < _MOSTLY:
            return result
        wide = self._find(line, path, lengths, folded, _WIDE_TURN)
        return wide if wide.measure(line) > result.measure(line) + SAME_POINT_MM else result

    def _find(
        self, line: Line, path: PosePath, lengths: FloatArray, folded: BoolArray, turn: float
    ) -> Pieces:
        """`find_pieces` with stations between which the tool rotates by at most `turn` rad."""
        setup, choice = self.setup, widest_grid(self.freedom, path)
        ladder = self._make_ladder(path, lengths, folded, choice, turn)
        shift = 0.0
        if line.closed:
            start = _choose_start(ladder.find_chains(setup), len(ladder.stations) - 1)
            shift = ladder.measure(start, lengths)
        if shift > 0:
            rotated = _begin_at(ladder, start)
            first, last = ladder.states.joints[[0, -1]]
            same = np.allclose(first, last, rtol=0.0, atol=_SAME_JOINTS, equal_nan=True)
            ladder = (
                ladder.roll(start, *rotated) if same else self._make_ladder(*rotated, choice, turn)
            )
        whole = float(lengths.sum())
        motions = self._prove_all(line.id, ladder, choice)
        if len(motions) == 1 and not shift and max(motions[0].trimmed) < SAME_POINT_MM:
            return Pieces((replace(motions[0], trimmed=(0.0, 0.0)),), late=ladder.late)
        long = [motion for motion in motions if whole - sum(motion.trimmed) >= SHORTEST_MM]
        pieces = [
            replace(
                motion,
                id=f"{line.id}.{number}",
                part_of=line.id,
                trimmed=_shift_ends(motion.trimmed, shift, whole),
            )
            for number, motion in enumerate(long, 1)
        ]
        return Pieces(tuple(pieces), float(ladder.along_edge[ladder.too_fast].sum()), ladder.late)

    def count_stations(self, path: PosePath) -> int:
        """The number of stations along a pose path."""
        return int(_divide_evenly(path, _STATION_TURN).sum()) + 1

    def _make_ladder(
        self,
        path: PosePath,
        lengths: FloatArray,
        folded: BoolArray,
        choice: Grid,
        turn: float,
    ) -> _Ladder:
        setup = self.setup
        parts = _divide_evenly(path, turn)
        stations = divide(path, parts)
        states = make_states(setup, stations, choice, _JUMP)
        transitions = find_steps(replace(setup.robot, speeds=setup.robot.fastest), states, _JUMP)
        turning = CHANGE * (np.arange(len(states.moves)) > 0)[:, None, None]
        along_edge = (lengths / parts)[list_owners(parts)]
        feed = compute_tip_feed(stations.length / along_edge, self.process)
        slowest = (stations.length / feed)[:, None, None, None]
        in_time = np.where(transitions.time - turning <= slowest, transitions.time, math.inf)
        is_possible, is_in_time = np.isfinite(transitions.time), np.isfinite(in_time)
        too_fast = np.asarray(is_possible.any(axis=(1, 2, 3)) & ~is_in_time.any(axis=(1, 2, 3)))
        late = 1 - int(is_in_time.sum()) / max(int(is_possible.sum()), 1)
        states.open[folded[list_owners(parts)]] = False
        return _Ladder(
            path,
            lengths,
            folded,
            parts,
            stations,
            states,
            replace(transitions, time=in_time),
            np.zeros(len(stations), dtype=np.bool_),
            too_fast,
            late,
        )

    def _prove_all(self, name: str, ladder: _Ladder, choice: Grid) -> list[EdgeMotion]:
        """The motions of the best cover whose chains all have motions."""
        failures = np.zeros(len(ladder.stations) - 1, dtype=np.int64)
        known: dict[_ChainKey, _Lengthened] = {}
        while True:
            chains = ladder.find_chains(self.setup)
            lengthened = self._lengthen_all(name, ladder, chains, choice, known)
            if isinstance(lengthened, _Failure):
                _close(ladder, lengthened, failures)
                continue
            if lone := ladder.find_lone_states(chains, self.setup):
                chains = sorted([*chains, *lone], key=lambda chain: chain.first)
                lengthened = self._lengthen_all(name, ladder, chains, choice, known)
                assert not isinstance(lengthened, _Failure)
            return lengthened

    def _lengthen_all(
        self,
        name: str,
        ladder: _Ladder,
        chains: list[PoseChain],
        choice: Grid,
        known: dict[_ChainKey, _Lengthened],
    ) -> list[EdgeMotion] | _Failure:
        """The motions of chains, each as far beyond its ends as the arm can run it.

        The first chain without a motion is returned instead. A single station without a motion is
        left out.

        known: motions that are proven already; further ones are added.
        """
        motions: list[EdgeMotion] = []
        free = 0.0
        for number, chain in enumerate(chains):
            following = chains[number + 1].first if number + 1 < len(chains) else math.inf
            parts = min(int((chain.first - free) * _PARTS_BEYOND), _PARTS_BEYOND - 1)
            room = parts, (_PARTS_BEYOND - 1) * (chain.last < following)
            key = chain.first, chain.branch, chain.orientation.tobytes(), room
            if key not in known:
                proved = self._lengthen(name, ladder, chain, choice, room)
                if proved is None:
                    continue
                if isinstance(proved, _Failure):
                    return proved
                known[key] = proved
            motion, beyond = known[key]
            motions.append(motion)
            free = chain.last + beyond
        return motions

    def _lengthen(
        self,
        name: str,
        ladder: _Ladder,
        chain: PoseChain,
        choice: Grid,
        room: tuple[int, int],
    ) -> _Lengthened | _Failure | None:
        """The motion of a chain as far beyond its ends as the arm can run it, or without extension.

        None for a single station that cannot be extended.

        room: parts of the stretches before and after the chain that may be used.
        """
        none = _Extension(0.0, chain.joints[:0])
        before = self._extend(ladder, chain, choice, 0, room[0])
        after = self._extend(ladder, chain, choice, -1, room[1])
        failed = 0
        for ends in ((before, after), (none, none)):
            if not len(chain.moves) and ends[0].share + ends[1].share == 0:
                return None
            piece = _Piece.make(ladder, chain, *ends)
            proved = self._prove(name, piece, choice)
            if isinstance(proved, EdgeMotion):
                late = self._find_too_fast(ladder, piece)
                if not len(late):
                    return piece.thin_out(ladder, proved), ends[1].share
                failed = int(late[0])
            else:
                failed = proved - len(ends[0].joints)
                if 0 <= failed < len(chain.moves):
                    break
        return _Failure(chain, failed) if len(chain.moves) else None

    def _prove(self, name: str, piece: _Piece, choice: Grid) -> EdgeMotion | int:
        """The motion of a piece, or the stretch of the piece in which it fails."""
        tilt, stretches = self.freedom.tilt, len(piece.segments)
        # Between two stations the turns next to home may be beyond a limit.
        for chain in (_turn_to_home(self.setup.robot, piece.chain), piece.chain):
            proved = prove(self.setup, name, piece.path, choice, chain, tilt)
            if isinstance(proved, EdgeMotion) or proved[1]:
                break
        if not isinstance(proved, EdgeMotion):
            return min(proved[0], stretches - 1)
        motion = SampledMotion(proved.sampled_joints, proved.sampled_path)
        (hit,) = self.space.find_blockages([motion])
        if isinstance(hit, Blockage):
            return min(int(np.searchsorted(proved.at, hit.at, "right")), stretches) - 1
        return proved

    def _find_too_fast(self, ladder: _Ladder, piece: _Piece) -> Index:
        """The stretches that take a joint longer than the tool at the feed of the piece."""
        length = piece.path.length
        along_edge = float(ladder.lengths.sum()) - sum(piece.trimmed)
        feed = compute_tip_feed(length.sum() / along_edge, self.process)
        moved = np.abs(np.diff(piece.chain.joints, axis=0)) / self.setup.robot.fastest
        return np.flatnonzero(moved.max(axis=1) > (1 + _SAME_TIME) * length / feed)

    def _extend(
        self, ladder: _Ladder, chain: PoseChain, choice: Grid, end: int, parts: int
    ) -> _Extension:
        """The extension of a chain beyond an end, in the orientation at that end.

        end: 0 for its start, -1 for its end.
        parts: largest number of parts of the stretch beyond the end that may be used.
        """
        none = _Extension(0.0, chain.joints[:0])
        row, beyond = (chain.first, -1) if end == 0 else (chain.last, 1)
        if not 0 <= row + beyond < len(ladder.stations):
            return none
        low = min(row, row + beyond)
        if ladder.folded[ladder.locate(low)[0]]:
            return none
        samples = divide(ladder.stations.slice(low, low + 2), np.array([_PARTS_BEYOND]))
        turned = samples.rotation @ choice.nominal_from_tool[chain.orientation[end]]
        rotations, origins = compute_flange_poses(self.setup, samples.position, turned)
        rotations, origins, start = rotations[::beyond], origins[::beyond], chain.joints[end]
        while parts > 0:
            goal = rotations[: parts + 1], origins[: parts + 1]
            followed = follow(self.setup.robot, goal, start, MARGIN, JUMP)
            if not isinstance(followed, Choice):
                parts = min(parts, followed.row) - 1
                continue
            hits = np.flatnonzero(~self.setup.roomy(followed.joints))
            if not len(hits):
                return _Extension(parts / _PARTS_BEYOND, followed.joints[-1:])
            parts = int(hits[0]) - 1
        return none


def _divide_evenly(path: PosePath, turn: float) -> Index:
    """The number of stretches between stations in each segment of a pose path.

    turn: largest turn of the tool between two stations, rad.
    """
    return count_parts(path, max(_STATION_MM, float(path.length.sum()) / _MAX_STRETCHES), turn)


def _close(ladder: _Ladder, failure: _Failure, failures: Index) -> None:
    """Close the move of a chain in the stretch in which it fails, or all moves after some failures.

    failures: number of failures in each stretch of the edge; it is increased.
    """
    chain, stretch = failure.chain, failure.stretch
    row = chain.first + stretch
    failures[row] += 1
    if failures[row] > _FAILURES:
        ladder.states.open[row] = False
        return
    move, orientation = chain.moves[stretch], chain.orientation[stretch + 1]
    ladder.states.open[row, move, orientation, chain.branch] = False


def _turn_to_home(robot: Robot, chain: PoseChain) -> PoseChain:
    """The chain, moved next to home by whole turns, within the limits of its joints."""
    low, high = chain.joints.min(axis=0), chain.joints.max(axis=0)
    lower = np.ceil((robot.limits[:, 0] - ON_LIMIT - low) / math.tau)
    upper = (robot.limits[:, 1] + ON_LIMIT - high) // math.tau
    whole = np.clip(np.rint((robot.home - (low + high) / 2) / math.tau), lower, upper)
    return replace(
        chain, joints=chain.joints + math.tau * whole * list_turn_counts(robot).any(axis=0)
    )


def _choose_start(chains: list[PoseChain], last: int) -> int:
    """The station at which the motions along a closed edge should begin: in the longest gap.

    last: number of the last station, which is at the position of the first.
    """
    if not chains:
        return 0
    starts = [*(chain.first for chain in chains[1:]), chains[0].first + last]
    gaps = [start - chain.last for chain, start in zip(chains, starts, strict=True)]
    longest = int(np.argmax(gaps))
    return (chains[longest].last + gaps[longest] // 2) % last


def _begin_at(ladder: _Ladder, station: int) -> tuple[PosePath, FloatArray, BoolArray]:
    """The path of a closed edge that begins at a station.

    Returns the path, the lengths of its segments, mm, and whether each segment is folded.
    """
    segment, share = ladder.locate(station)
    path, lengths, folded = ladder.path, ladder.lengths, ladder.folded
    at = ladder.measure(station, path.length)
    turned = join([cut(path, at, float(np.cumsum(path.length)[-1])), cut(path, 0.0, at)])
    if share == 0:
        return turned, np.roll(lengths, -segment), np.roll(folded, -segment)
    divided = np.insert(lengths, segment, share * lengths[segment])
    divided[segment + 1] *= 1 - share
    folded = np.insert(folded, segment, folded[segment])
    return turned, np.roll(divided, -segment - 1), np.roll(folded, -segment - 1)


def _shift_ends(trimmed: tuple[float, float], shift: float, length: float) -> tuple[float, float]:
    """The lengths before and after a piece from the start of a closed edge, mm.

    The second is negative for a piece that runs over the start.

    trimmed: these lengths from the point at which the pieces begin.
    shift: distance of this point from the start, mm.
    length: length of the edge, mm.
    """
    low, high = trimmed[0] + shift, length - trimmed[1] + shift
    if low >= length:
        low, high = low - length, high - length
    return (low, length - high) if shift else trimmed
