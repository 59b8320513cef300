"""Search the resting pose of a 3-D part before an arm: the face on which it rests, and its place.

The part rests on a face of its hull, or as the job has it. A grid of places is examined by the
joints alone, the best of them with collisions at samples of the edges, and these are improved step
by step. The best few are built as ``build`` does it, and the lengths that they work decide. What
the best set-up leaves is searched again in the same way: the second set-up.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.collision.cell import make_cell_scene
from camgen.collision.hits import find_collisions
from camgen.geometry.resting import RestingFace, find_resting_faces, make_rotation_down, turn_down
from camgen.model.advice import drop_place
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import BoolArray, Edge, Part, Solid
from camgen.model.pose import FloatArray, Pose, compute_fixed_xyz, rotation_about, to_vec3
from camgen.model.text import counted
from camgen.motion.cell import find_home
from camgen.motion.coverage import SHORTEST_MM
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.setup import MARGIN, FoldedEdge, Setup, compute_flange_poses
from camgen.pipeline import Result, build
from camgen.pipeline.tool_room import Samples, make_samples
from camgen.plan import Watch, ignore_stages
from camgen.plan.edges import select_edges_of_job
from camgen.plan.edges.contact import find_contacts
from camgen.plan.edges.last_face import read_offset
from camgen.plan.edges.poses import make_poses, measure_line
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import measure_excess
from camgen.robots.kinematics.singular import measure_singularity_distance
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

#: Number of set-ups at most.
SET_UPS = 2
#: Resting faces that are searched beside the resting pose of the job, the largest ones.
_FACES = 6
#: Shares of the arm's length: between which distances and heights the grid has places, and steps.
_DISTANCES, _HEIGHTS = (0.15, 0.75), (-0.3, 0.6)
_STEPS, _LEVELS = 10, 6
#: deg between turns of the grid.
_TURN = 30.0
#: Samples of the edges that the grid is examined at, and orientations of the tool at each.
_GRID_SAMPLES, _GRID_CHOICES = 48, 2
#: Places that are examined with collisions on each face, places that are improved, rounds in which
#: they are, places that are built, and the same of the second set-up.
_EXAMINED, _IMPROVED, _ROUNDS, _BUILT = 12, 4, 4, 3
_SECOND_BUILT = 2
#: Share of the length that two other set-ups have to promise before they are built.
_GAIN = 0.01
#: Joint values of each sample that are tested for collisions.
_TESTED = 8
#: rad: room to a limit beyond which more room counts the same.
_ROOM = math.radians(30)
#: mm: how often the worked length of an edge is measured.
_MARK_MM = 1.0
#: Normals of faces that differ by less, as a sine, are one.
_SAME = 0.01


class Spot(Struct, frozen=True, order=True):
    """A place of the part before the arm.

    distance: distance of the middle of the bottom of the part from axis 1 of the arm, mm.
    height: height of that bottom above the base, mm.
    turn: angle about the vertical, deg.
    resting_pose: number of the resting pose of the part.
    """

    distance: float
    height: float
    turn: float
    resting_pose: int = 0


class RestingPose(Struct, frozen=True, eq=False):
    """The face on which the part rests.

    face: the resting face; None if the job has the part on another side.
    rotation: (3, 3) base_from_work before the part is turned about the vertical.
    middle: (3,) middle of the bottom of the part, work frame, mm.
    job: the job with the surroundings of this resting pose.
    cell: its cell.
    is_own: whether it is the resting pose of the job.
    samples: places of the edges, and orientations in which the tool has room there.
    """

    face: RestingFace | None
    rotation: FloatArray
    middle: FloatArray
    job: Job
    cell: Workcell
    is_own: bool
    samples: Samples

    @property
    def turned(self) -> tuple[FloatArray, float]:
        """Axis (work frame) and angle (rad) of the rotation from how the file has the part."""
        down = np.array([0.0, 0.0, -1.0]) if self.face is None else self.face.normal
        return make_rotation_down(down)


class Trial(Struct, frozen=True, eq=False):
    """A set-up and its build.

    spot, resting_pose: place and resting pose of the part.
    job: the job of the set-up.
    worked: mask of the millimetres of each edge that are worked, by its id.
    whole: ids of edges that are worked whole.
    reasons: why an edge is not worked, by its id.
    seconds: time of the program, s.
    result: the build; None if it came to nothing.
    """

    spot: Spot
    resting_pose: RestingPose
    job: Job
    worked: Mapping[str, BoolArray]
    whole: frozenset[str]
    reasons: Mapping[str, str]
    seconds: float
    result: Result | None = None

    @property
    def base_from_work(self) -> tuple[float, ...]:
        """The work frame, mm and deg."""
        return tuple(self.job.cell.base_from_work or ())


class Search(Struct, frozen=True, eq=False):
    """The result of a search.

    as_given: the set-up as the job has it.
    best: the set-ups that were built and work something, the best one first.
    set_ups: the best set-up, or two that together work more. The first one leaves to the second
        what that works whole.
    case: the part with its edges and the resting poses that were searched.
    places: number of places that were examined by the joints alone, and with collisions.
    """

    as_given: Trial
    best: tuple[Trial, ...]
    set_ups: tuple[Trial, ...]
    case: Case
    places: tuple[int, int]

    @property
    def length(self) -> float:
        """Length of all edges, mm."""
        return sum(edge.length for edge in self.case.edges.values())


class Request(Struct, frozen=True, eq=False):
    """The settings with which set-ups are built.

    source: the file of the part, or a part that was made in code. Headers of programs name it.
    post: name of the post.
    stem: first part of the names of the programs, see `name_set_up`.
    """

    source: Path | Part
    post: str
    stem: str = "place"


class Case(Struct, frozen=True, eq=False):
    """A part that is to be placed.

    request: post and names of its set-ups.
    robot, solid: the arm and the part.
    azimuth: direction in which it stands about axis 1, rad.
    edges: the edges by their ids.
    paths: pose path of each edge that has one, with a row at every millimetre.
    resting_poses: the resting poses of the part, that of the job first.
    faces: number of resting faces of the part.
    tip: mm that its own edge may enter the tool.
    """

    request: Request
    robot: Robot
    solid: Solid
    azimuth: float
    edges: Mapping[str, Edge]
    paths: Mapping[str, PosePath]
    resting_poses: tuple[RestingPose, ...]
    faces: int
    tip: float

    def base_from_work(self, spot: Spot) -> Pose:
        """The work frame of a place."""
        resting_pose = self.resting_poses[spot.resting_pose]
        turned = rotation_about(2, math.radians(spot.turn)) @ resting_pose.rotation
        x, y = math.cos(self.azimuth) * spot.distance, math.sin(self.azimuth) * spot.distance
        return Pose(turned, to_vec3(np.array([x, y, spot.height]) - turned @ resting_pose.middle))

    @property
    def lengths(self) -> FloatArray:
        """(E,) length of each edge with a pose path, mm."""
        return np.array([self.edges[name].length for name in self.paths])


class Reached(Struct, frozen=True, eq=False):
    """Shares of the edges that the arm reaches from places.

    shares: (S, E) share of each edge.
    room: (S,) mean room of the joints to their limits, as a share.
    """

    shares: FloatArray
    room: FloatArray

    def rank(self, lengths: FloatArray) -> list[tuple[float, float]]:
        """A key for each place that is least for the best: length first, then room."""
        reached = np.round(-self.shares @ lengths, 3).tolist()
        return list(zip(reached, np.round(-self.room, 6).tolist(), strict=True))


class _Hunt(Struct, eq=False):
    """A search while it runs.

    spots: places of the grid, with what the joints reach from them.
    known: shares that the arm reaches without a collision.
    height: height of the bottom of the part, mm; None if it is searched.
    """

    case: Case
    height: float | None
    watch: Watch
    spots: list[Spot]
    reached: Reached
    known: dict[Spot, Reached] = field(default_factory=dict)

    def find(self, lengths: FloatArray) -> list[Spot]:
        """The best places for edges of these lengths that count, the best first."""
        chosen = self._choose(lengths)
        for number, spot in enumerate(chosen, 1):
            self.watch(f"placing {number} of {counted(len(chosen), 'place')}")
            self._examine(spot)
        for start in _select_apart(self.case, self._order(lengths), _IMPROVED):
            self._improve(start, lengths)
        return self._order(lengths)

    def _choose(self, lengths: FloatArray) -> list[Spot]:
        """The best places of the grid on each resting pose, one for each height and turn."""
        ranks = self.reached.rank(lengths)
        order = sorted(range(len(self.spots)), key=lambda k: (ranks[k], self.spots[k]))
        taken: dict[tuple[int, float, float], Spot] = {}
        for k in order:
            spot = self.spots[k]
            if ranks[k][0] < 0:
                taken.setdefault((spot.resting_pose, spot.height, spot.turn), spot)
        chosen: list[Spot] = []
        for resting_pose in range(len(self.case.resting_poses)):
            chosen += [spot for spot in taken.values() if spot.resting_pose == resting_pose][
                :_EXAMINED
            ]
        return chosen

    def choose_pair(self, lengths: FloatArray) -> tuple[Spot, float]:
        """The pair of places that reaches most together: the one that reaches more alone.

        Returns it with the length that the two reach at the samples, mm.
        """
        spots = sorted(self.known)
        shares = np.concatenate([self.known[spot].shares for spot in spots])
        alone = shares @ lengths
        longest = np.array([(np.maximum(shares, row) @ lengths).max() for row in shares])
        order = np.lexsort((np.arange(len(spots)), -alone.round(3), -longest.round(3)))
        return spots[order[0]], float(longest[order[0]])

    def _order(self, lengths: FloatArray) -> list[Spot]:
        return sorted(self.known, key=lambda spot: (self.known[spot].rank(lengths), spot))

    def _examine(self, spot: Spot) -> Reached:
        if spot not in self.known:
            self.known[spot] = examine(self.case, spot)
        return self.known[spot]

    def _improve(self, start: Spot, lengths: FloatArray) -> None:
        """Move from `start` to neighbours with a lower rank, in steps that are halved."""
        step, turn, current = _step(self.case) / 2, _TURN / 2, start
        moves = [(1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)]
        if self.height is None:
            moves += [(0, 1, 0), (0, -1, 0)]
        for _ in range(_ROUNDS):
            for outwards, up, rotated in moves:
                self.watch(f"placing {counted(len(self.known), 'place')}")
                spot = Spot(
                    float(round(current.distance + outwards * step)),
                    current.height + float(round(up * step)),
                    (current.turn + rotated * turn) % 360,
                    current.resting_pose,
                )
                best = self.known[current].rank(lengths)
                if spot.distance > 0 and self._examine(spot).rank(lengths) < best:
                    current = spot
            step, turn = step / 2, turn / 2


def search_place(
    part: Part,
    job: Job,
    cell: Workcell,
    request: Request,
    height: float | None = None,
    watch: Watch = ignore_stages,
) -> Search:
    """Search the resting pose of `part` that works most of the edges, then in the shortest time.

    height: height of the lowest point of the part above the base, mm, if it is fixed.

    The search is deterministic. Raises JobError for a part without a solid or a resting face and
    for an arm without a closed form, NoSafeProgram if no edge is reached from any place.
    """
    case = make_case(part, job, cell, request, watch)
    spots = list_spots(case, height)
    hunt = _Hunt(case, height, watch, spots, _reach_all(case, spots, watch))
    ordered = _select_apart(case, hunt.find(case.lengths), _BUILT)
    trials = []
    for number, spot in enumerate(ordered, 1):
        trials.append(_build(case, spot, _name(watch, f"building {number} of {len(ordered)}")))
    job_spot = _own_spot(case)
    job_trial = _build(case, job_spot, _name(watch, "building where the job has it"))
    # The search samples the edges: the place of the job may work more than its samples say.
    if height is None or math.isclose(height, job_spot.height, abs_tol=1e-6):
        trials.append(job_trial)
    best = sorted(
        (trial for trial in trials if trial.worked), key=lambda trial: _order_trial(case, trial)
    )
    if not best:
        raise NoSafeProgram(
            part.source, "no place was found from which an edge is reached", "", "give another tool"
        )
    set_ups = _find_set_ups(case, hunt, best[0])
    return Search(job_trial, tuple(best), set_ups, case, (len(spots), len(hunt.known)))


def _find_set_ups(case: Case, hunt: _Hunt, best: Trial) -> tuple[Trial, ...]:
    """The best set-up with the second one to it, or two others that together work more."""
    set_ups = _find_second(case, hunt, best)
    spot, length = hunt.choose_pair(case.lengths)
    gain = length - sum(measure_worked(case.edges, set_ups).values())
    if spot == best.spot or gain < _GAIN * case.lengths.sum():
        return set_ups
    first = _build(case, spot, _name(hunt.watch, "building another set-up 1"))
    others = _find_second(case, hunt, first)
    return min(set_ups, others, key=lambda trials: _order_trial(case, *trials))


def _find_second(case: Case, hunt: _Hunt, first: Trial) -> tuple[Trial, ...]:
    """The first set-up, and a second one for what it leaves if that works any of it."""
    done = measure_worked(case.edges, [first])
    pending: dict[str, float] = {}
    for name, edge in case.edges.items():
        left = edge.length - done.get(name, 0.0)
        if name not in done or left >= SHORTEST_MM:
            pending[name] = left
    lengths = np.array([pending.get(name, 0.0) for name in case.paths])
    if not lengths.any():
        return (first,)
    spots = [spot for spot in hunt.find(lengths) if hunt.known[spot].rank(lengths)[0][0] < 0]
    trials = []
    for number, spot in enumerate(_select_apart(case, spots, _SECOND_BUILT), 1):
        watch = _name(hunt.watch, f"building set-up 2, {number} of {_SECOND_BUILT}")
        trials.append(_build(case, spot, watch, list(pending), 2))
    if not trials:
        return (first,)
    second = min(trials, key=lambda trial: _order_trial(case, first, trial))
    added = _find_added(case, first, second)
    if added and added != pending.keys():
        # Program 2 works nothing else: the rest belongs to program 1, or is worked in neither.
        watch = _name(hunt.watch, "building set-up 2 again")
        kept = [name for name in case.edges if name in added]
        second = replace(_build(case, second.spot, watch, kept, 2), reasons=second.reasons)
        added = _find_added(case, first, second)
    if not added:
        return (first,)
    partly = first.worked.keys() - second.whole
    kept = [name for name in case.edges if name not in added or name in partly]
    if first.worked.keys() & set(kept):
        watch = _name(hunt.watch, "building set-up 1 again")
        again = replace(_build(case, first.spot, watch, kept), reasons=first.reasons)
        if _order_trial(case, again, second)[0] <= _order_trial(case, first, second)[0] + 1.0:
            first = again
    return first, second


def _find_added(case: Case, first: Trial, second: Trial) -> set[str]:
    """Edges of which the second set-up works a piece that the first one leaves."""
    done = measure_worked(case.edges, [first])
    both = measure_worked(case.edges, [first, second])
    return {name for name in both if name not in done or both[name] - done[name] >= SHORTEST_MM}


def _order_trial(case: Case, *trials: Trial) -> tuple[float, float, Spot]:
    """A key that is least for the best set-ups: worked length, then time."""
    worked = round(sum(measure_worked(case.edges, trials).values()), 1)
    return -worked, sum(trial.seconds for trial in trials), trials[-1].spot


def measure_worked(edges: Mapping[str, Edge], trials: Sequence[Trial]) -> dict[str, float]:
    """Length that the set-ups work of each edge of which they work something, mm.

    A stretch that several of them work counts once.
    """
    worked = {}
    for name, edge in edges.items():
        marks = [trial.worked[name] for trial in trials if name in trial.worked]
        if any(name in trial.whole for trial in trials):
            worked[name] = edge.length
        elif marks:
            worked[name] = edge.length * float(np.any(marks, axis=0).mean())
    return worked


def _name(watch: Watch, name: str) -> Watch:
    """Report the stages of a build after its name."""
    watch(name)
    return lambda stage: watch(f"{name}, {stage}")


def name_set_up(stem: str, number: int) -> str:
    """Name of the program of a set-up, from 1."""
    return f"{stem}-{number}"


def make_case(
    part: Part, job: Job, cell: Workcell, request: Request, watch: Watch = ignore_stages
) -> Case:
    """A part with its edges and all its resting poses. Raises JobError as `search_place` does."""
    solid, robot = part.solid, cell.arm
    if solid is None or robot is None or robot.arm is None:
        what = "needs an arm whose joints have a closed form" if solid else "is not a 3-D part"
        raise JobError(
            part.source, what, "camgen place", "give a mesh or a STEP model, and a post of an arm"
        )
    edges = select_edges_of_job(solid, job)
    direction = read_offset(job, solid, edges.values())
    tip = max(find_contacts(edges.values(), job, direction).values(), default=0.0)
    paths: dict[str, PosePath] = {}
    marks: dict[str, PosePath] = {}
    for name, edge in edges.items():
        path = make_poses(edge, job.operation.offset, direction)
        if isinstance(path, FoldedEdge):
            path = path.path
        if isinstance(path, PosePath):
            paths[name] = path
            parts = np.ceil(measure_line(edge, path) / _MARK_MM).astype(np.int64)
            marks[name] = divide(path, np.maximum(parts, 1))
    watch("finding resting faces")
    resting = find_resting_faces(solid.vertices, solid.faces)
    if not resting:
        raise JobError(
            part.source,
            "has no face on which it rests",
            "camgen place",
            "give a closed part that stands on its own",
        )
    rotation_of_job = cell.base_from_work.rotation
    down = -rotation_of_job[2]
    faces = [face for face in resting if np.linalg.norm(face.normal - down) > _SAME]
    same = next((face for face in resting if np.linalg.norm(face.normal - down) <= _SAME), None)
    resting_poses: list[RestingPose] = []
    for face in [same, *faces[:_FACES]]:
        is_own = face is same
        rotation, resting_job, resting_cell = rotation_of_job, job, cell
        if not is_own and face is not None:
            rotation = turn_down(rotation_of_job @ face.normal) @ rotation_of_job
            table = replace(job.cell, fixtures=None, rests_on=face.normal.tolist())
            resting_job, resting_cell = replace(job, cell=table), replace(cell, meshes=())
        placed = solid.vertices @ rotation.T
        low, high = placed.min(axis=0), placed.max(axis=0)
        bottom = np.array([*((low + high) / 2)[:2], low[2]])
        watch(f"finding the room of the tool, face {len(resting_poses) + 1}")
        upright = replace(resting_cell, base_from_work=Pose(rotation, (0.0, 0.0, 0.0)))
        samples = make_samples(resting_job, upright, solid, tip, paths)
        resting_poses.append(
            RestingPose(
                face, rotation, rotation.T @ bottom, resting_job, resting_cell, is_own, samples
            )
        )
    x, y, _ = cell.base_from_work.origin + rotation_of_job @ resting_poses[0].middle
    azimuth = math.atan2(y, x) if math.hypot(x, y) > 1.0 else 0.0
    return Case(
        request=request,
        robot=robot,
        solid=solid,
        azimuth=azimuth,
        edges=edges,
        paths=marks,
        resting_poses=tuple(resting_poses),
        faces=len(resting),
        tip=tip,
    )


def list_spots(case: Case, height: float | None) -> list[Spot]:
    """The grid of places on all resting poses."""
    long = 2 * case.robot.lever
    distances = np.round(np.linspace(*_DISTANCES, _STEPS) * long).tolist()
    if height is None:
        heights = np.round(np.linspace(*_HEIGHTS, _LEVELS) * long).tolist()
    else:
        heights = [height]
    turns = np.arange(0.0, 360.0, _TURN).tolist()
    cells = product(range(len(case.resting_poses)), turns, heights, distances)
    return [Spot(distance, up, turn, resting_pose) for resting_pose, turn, up, distance in cells]


def _step(case: Case) -> float:
    """Distance of places of the grid, mm."""
    return (_DISTANCES[1] - _DISTANCES[0]) / (_STEPS - 1) * 2 * case.robot.lever


def _own_spot(case: Case) -> Spot:
    """The place that the job has."""
    resting_pose = case.resting_poses[0]
    x, y, z = resting_pose.cell.base_from_work.apply(resting_pose.middle.tolist())
    return Spot(float(math.hypot(x, y)), float(z), 0.0)


def _select_apart(case: Case, ordered: Sequence[Spot], count: int) -> list[Spot]:
    """The first places that are not beside another one."""
    step = _step(case)
    kept: list[Spot] = []
    for spot in ordered:
        if len(kept) == count:
            break
        if all(_are_apart(spot, other, step) for other in kept):
            kept.append(spot)
    return kept


def _are_apart(spot: Spot, other: Spot, step: float) -> bool:
    turned = abs((spot.turn - other.turn + 180) % 360 - 180) >= _TURN
    moved = max(abs(spot.distance - other.distance), abs(spot.height - other.height)) >= step
    return spot.resting_pose != other.resting_pose or turned or moved


def _reach_all(case: Case, spots: Sequence[Spot], watch: Watch) -> Reached:
    """The shares that the joints reach from the places of the grid, at some samples."""
    shares = np.zeros((len(spots), len(case.paths)))
    room = np.zeros(len(spots))
    for number, resting_pose in enumerate(case.resting_poses):
        samples = resting_pose.samples.thin_out(_GRID_SAMPLES, _GRID_CHOICES)
        rows = np.array([k for k, spot in enumerate(spots) if spot.resting_pose == number])
        for begin in range(0, len(rows), 100):
            watch(f"searching the grid {begin + int(rows[0])} of {counted(len(spots), 'place')}")
            batch = rows[begin : begin + 100]
            reached = reach_joints(case, [spots[k] for k in batch.tolist()], samples)
            shares[batch], room[batch] = reached.shares, reached.room
    return Reached(shares, room)


def reach_joints(case: Case, spots: Sequence[Spot], samples: Samples) -> Reached:
    """The shares that the joints reach from places on one resting pose, collisions aside.

    samples: samples of the resting pose.

    A sample is reached if the joints have values within their limits, apart from singularities, for
    one of its orientations.
    """
    if not len(samples.owner):
        return Reached(np.zeros((len(spots), len(case.paths))), np.zeros(len(spots)))
    _, margins = _find_joints(case, spots, samples)
    best = np.maximum.reduceat(margins.max(axis=2), samples.starts, axis=1)
    return Reached(samples.sum_by_edge(best >= 0), (np.clip(best, 0.0, _ROOM) / _ROOM).mean(axis=1))


def _find_joints(
    case: Case, spots: Sequence[Spot], samples: Samples
) -> tuple[FloatArray, FloatArray]:
    """Joint values (S, M, B, J) at all orientations, and their room to the limits (S, M, B), rad.

    The room is -inf without joint values, and near a singularity.
    """
    cell = case.resting_poses[spots[0].resting_pose].cell
    position = samples.position[samples.owner]
    goals = []
    for spot in spots:
        setup = Setup(case.robot, case.base_from_work(spot), cell.flange_from_tool)
        goals.append(compute_flange_poses(setup, position, samples.rotation))
    rotations, origins = map(np.concatenate, zip(*goals, strict=True))
    joints = compute_solutions(case.robot, rotations, origins, case.robot.home)
    margins = np.full(joints.shape[:2], -math.inf)
    exists = np.isfinite(joints).all(axis=-1)
    values = joints[exists]
    singularity_distance = measure_singularity_distance(case.robot, values).min(
        axis=-1, initial=math.inf
    )
    room = -measure_excess(case.robot, values).max(axis=-1)
    margins[exists] = np.where(singularity_distance >= MARGIN, room, -math.inf)
    shape = len(spots), len(position)
    return joints.reshape(*shape, *joints.shape[1:]), margins.reshape(*shape, -1)


def examine(case: Case, spot: Spot) -> Reached:
    """The shares that the arm reaches from a place without a collision, at all samples."""
    resting_pose = case.resting_poses[spot.resting_pose]
    samples = resting_pose.samples
    nothing = Reached(np.zeros((1, len(case.paths))), np.zeros(1))
    cell = replace(resting_pose.cell, base_from_work=case.base_from_work(spot))
    scene = make_cell_scene(resting_pose.job, cell, case.solid, case.tip).scene
    if not len(samples.owner):
        return nothing
    try:
        find_home(case.robot, cell, scene)
    except NoSafeProgram:
        return nothing
    (joints,), (margins,) = _find_joints(case, [spot], samples)
    is_free = np.zeros(len(samples.position), dtype=np.bool_)
    room = np.zeros(len(samples.position))
    # Candidates of each sample, those with most room first.
    owner = np.repeat(samples.owner, margins.shape[1])
    flat = np.flatnonzero(margins.ravel() >= 0)
    flat = flat[np.lexsort((-margins.ravel()[flat].round(6), owner[flat]))]
    first = np.searchsorted(owner[flat], np.arange(len(is_free)))
    last = np.searchsorted(owner[flat], np.arange(len(is_free)), "right")
    values = joints.reshape(-1, joints.shape[-1])
    for number in range(_TESTED):
        pending = np.flatnonzero(~is_free & (first + number < last))
        if not len(pending):
            break
        tested = flat[first[pending] + number]
        clear = find_collisions(scene, values[tested]) < 0
        is_free[pending] = clear
        room[pending] = np.where(clear, margins.ravel()[tested], 0.0)
    share = np.clip(room, 0.0, _ROOM).mean(keepdims=True) / _ROOM
    return Reached(samples.sum_by_edge(is_free[None]), share)


def _build(
    case: Case, spot: Spot, watch: Watch, names: Collection[str] | None = None, number: int = 1
) -> Trial:
    """The build of a set-up.

    names: ids of the edges that are asked for; None for those of the job.
    number: number of the set-up, which names its program.
    """
    resting_pose = case.resting_poses[spot.resting_pose]
    job = resting_pose.job
    if spot != _own_spot(case) or job.cell.base_from_work is None:
        frame = case.base_from_work(spot)
        angles = [math.degrees(angle) for angle in compute_fixed_xyz(frame.rotation)]
        values = [round(value, 4) + 0.0 for value in (*frame.origin, *angles)]
        job = replace(job, cell=replace(job.cell, base_from_work=values))
    if names is not None:
        job = replace(job, input=replace(job.input, select=" ".join(names)))
    request = case.request
    name = name_set_up(request.stem, number)
    try:
        result = build(request.source, post=request.post, job=job, name=name, watch=watch)
    except NoSafeProgram as error:
        why = drop_place("; ".join(filter(None, (error.what, error.where))))
        reasons = dict.fromkeys(case.edges if names is None else names, why)
        return Trial(spot, resting_pose, job, {}, frozenset(), reasons, math.inf)
    notes = tuple(replace(note, why=drop_place(note.why)) for note in result.notes)
    result = replace(result, notes=notes)
    reasons = {note.ids[-1]: note.why for note in notes if note.kind == "skipped" and note.ids}
    pieces: dict[str, list[PosePath]] = {}
    for path in result.tour.paths:
        eye = np.broadcast_to(np.eye(3), (len(path), 3, 3))
        pieces.setdefault(path.contours[0], []).append(PosePath(path.position, path.via, eye))
    whole = frozenset(path.id for path in result.tour.paths if path.id in case.edges)
    worked = {name: _mark(case.paths[name], edge_pieces) for name, edge_pieces in pieces.items()}
    return Trial(spot, resting_pose, job, worked, whole, reasons, result.cycle.total, result)


def _mark(edge: PosePath, pieces: Sequence[PosePath]) -> BoolArray:
    """Which millimetres of an edge the tool runs along.

    edge: the pose path of the whole edge, with a row at every millimetre.
    """
    middles = (edge.position[1:] + edge.position[:-1]) / 2
    nearest = np.full(len(middles), math.inf)
    for piece in pieces:
        dense = divide(piece, count_parts(piece, _MARK_MM / 2, math.inf)).position
        distances = np.linalg.norm(middles[:, None] - dense[None], axis=2).min(axis=1)
        nearest = np.minimum(nearest, distances)
    return np.asarray(nearest <= _MARK_MM)
