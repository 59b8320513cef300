"""Where a 3-D part should stand before an arm: places searched coarse to fine, the best few built whole.

First by kinematics alone, all places of a grid at once; then, for the best, every edge with its collisions and the
tool's nominal orientation, refined step by step; the best few are then built as ``build`` does it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.collision.cell import around
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Part, Solid
from camgen.model.pose import FloatArray, Pose, fixed_xyz, rotation_about, to_vec3
from camgen.model.text import counted
from camgen.motion.cell import home_of, setup_of
from camgen.motion.pose_paths import PosePath, counts, divide
from camgen.motion.setup import MARGIN, EdgeMotion, Setup, flange_poses
from camgen.pipeline import Result, build
from camgen.plan import Watch, ignore_stages
from camgen.plan.edges import choose
from camgen.plan.edges.contact import find_contacts
from camgen.plan.edges.last_face import Offset, offset_along
from camgen.plan.edges.poses import poses, reach
from camgen.robots.kinematics.inverse import inverse
from camgen.robots.kinematics.joint_limits import excess
from camgen.robots.kinematics.singular import from_singular
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell


class Spot(Struct, frozen=True, order=True):
    """Where a part stands: mm from axis 1 of the arm to the middle of its bottom, mm from the base up to that, deg by
    which it is turned about the vertical from how the job has it.
    """

    distance: float
    height: float
    turn: float


class Found(Struct, frozen=True, eq=False):
    """A place and what comes of it. nominal: edges that the nominal tool reaches. result: the build, None where it came
    to nothing.
    """

    spot: Spot
    base_from_work: tuple[float, ...]
    nominal: int
    edges: int
    seconds: float
    result: Result | None = None


class Search(Struct, frozen=True, eq=False):
    """What the places that were looked at came to. here: the place of the job. best: all from which an edge is reached,
    the best first, that of the job among them where it has the height that is asked for. looked: places of the grid,
    and those with collisions.
    """

    here: Found
    best: tuple[Found, ...]
    edges: int
    looked: tuple[int, int]


#: Shares of the arm's length: from where to where the part may stand, and how many distances and heights are tried.
_DISTANCES, _HEIGHTS, _STEPS = (0.15, 0.75), (-0.3, 0.6), 20
#: deg between turns.
_TURN = 30.0
#: So many places of the grid are looked at with collisions, so many of them refined so often, so many built.
_TRIED, _REFINED, _ROUNDS, _BUILT = 40, 3, 4, 3
#: rad: room to a limit beyond which more is no better.
_ROOM = math.radians(30)
#: mm, rad: an edge is looked at so often in the grid.
_LOOK_MM, _LOOK_TURN = 40.0, math.radians(45)


class _Case(Struct, frozen=True, eq=False):
    """What is placed. middle: (3,) of its bottom, work frame. rotation: (3, 3) of the work in the base, unturned.
    azimuth: rad, where about axis 1 it stands. looks: places and rotations of the tool on each edge.
    """

    job: Job
    cell: Workcell
    robot: Robot
    solid: Solid
    middle: FloatArray
    rotation: FloatArray
    azimuth: float
    looks: tuple[PosePath, ...]
    direction: Offset
    tip: float

    def base_from_work(self, spot: Spot) -> Pose:
        """The work frame where the part stands at ``spot``."""
        turned = rotation_about(2, math.radians(spot.turn)) @ self.rotation
        away = math.cos(self.azimuth) * spot.distance, math.sin(self.azimuth) * spot.distance
        return Pose(turned, to_vec3(np.array([*away, spot.height]) - turned @ self.middle))


def search_place(
    part: Part,
    job: Job,
    cell: Workcell,
    post: str,
    height: float | None = None,
    watch: Watch = ignore_stages,
) -> Search:
    """Where ``part`` should stand for the most edges, then the least time. height: of its bottom above the base, mm,
    where that is fixed. Deterministic. JobError for what is no 3-D part or no arm with a closed form, NoSafeProgram
    where no place is any good.
    """
    case = _case(part, job, cell)
    spots = list(_grid(case, height))
    watch("searching the grid")
    far = [
        _far(case, some)
        for some in _in_chunks(spots, lambda done: watch(f"searching the grid {done}"))
    ]
    values = [one for chunk in far for one in chunk]
    known: dict[Spot, tuple[int, float]] = {}
    chosen = _apart(spots, values)
    for k, spot in enumerate(chosen[:_TRIED]):
        watch(f"placing {k + 1} of {counted(min(_TRIED, len(chosen)), 'place')}")
        _look(case, spot, known)
    for start in sorted(known, key=lambda s: (*_rank(known[s]), s))[:_REFINED]:
        _refine(case, start, known, height is None, watch)
    ordered = sorted(known, key=lambda s: (*_rank(known[s]), s))
    found = []
    for k, spot in enumerate(_different(case, ordered)):
        watch(f"building {k + 1} of {_BUILT}")
        found.append(_whole(case, part, spot, known[spot][0], post))
    watch("building where the job has it")
    here = _whole(case, part, _spot_of(case), _nominal(case, _spot_of(case)), post)
    # What the search sets aside is the freedom of the tool: with it the job's own place may be the best of all.
    if height is None or math.isclose(height, here.spot.height, abs_tol=1e-6):
        found.append(here)
    best = sorted(
        (one for one in found if one.edges), key=lambda one: (-one.edges, one.seconds, one.spot)
    )
    if not best:
        raise NoSafeProgram(
            part.source, "no place was found from which an edge is reached", "", "give another tool"
        )
    return Search(here, tuple(best), len(case.looks), (len(spots), len(known)))


def _different(case: _Case, ordered: Sequence[Spot]) -> list[Spot]:
    """The first few that do not stand beside another one."""
    step = 0.75 / _STEPS * 2 * case.robot.lever
    kept: list[Spot] = []
    for spot in ordered:
        around_turn = [abs((spot.turn - one.turn + 180) % 360 - 180) >= _TURN for one in kept]
        moved = [
            max(abs(spot.distance - one.distance), abs(spot.height - one.height)) >= step
            for one in kept
        ]
        if all(a or b for a, b in zip(around_turn, moved, strict=True)):
            kept.append(spot)
    return kept[:_BUILT]


def _case(part: Part, job: Job, cell: Workcell) -> _Case:
    if part.solid is None or cell.arm is None or cell.arm.arm is None:
        what = (
            "is no 3-D part"
            if part.solid is None
            else "needs an arm whose joints have a closed form"
        )
        raise JobError(
            part.source, what, "camgen place", "give a mesh or a STEP model, and a post of an arm"
        )
    edges = choose(part.solid, job)
    direction = offset_along(job, part.solid, edges.values())
    ways = [poses(edge, job.operation.offset, direction) for edge in edges.values()]
    looks = [
        divide(way, counts(way, _LOOK_MM, _LOOK_TURN)) for way in ways if isinstance(way, PosePath)
    ]
    rotation = cell.base_from_work.rotation
    placed = part.solid.vertices @ rotation.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    bottom = np.array([*((low + high) / 2)[:2], low[2]])
    x, y, _ = cell.base_from_work.origin + bottom
    azimuth = math.atan2(y, x) if math.hypot(x, y) > 1.0 else 0.0
    tip = max(find_contacts(edges.values(), job, direction).values(), default=0.0)
    middle = rotation.T @ bottom
    return _Case(
        job, cell, cell.arm, part.solid, middle, rotation, azimuth, tuple(looks), direction, tip
    )


def _spot_of(case: _Case) -> Spot:
    """Where the job has the part."""
    x, y, z = case.cell.base_from_work.apply(case.middle.tolist())
    return Spot(float(math.hypot(x, y)), float(z), 0.0)


def _grid(case: _Case, height: float | None) -> Iterator[Spot]:
    long = 2 * case.robot.lever
    distances = np.round(np.linspace(*_DISTANCES, _STEPS) * long)
    heights = np.round(np.linspace(*_HEIGHTS, _STEPS) * long) if height is None else [height]
    for turn, up, away in product(np.arange(0.0, 360.0, _TURN), heights, distances):
        yield Spot(float(away), float(up), float(turn))


def _in_chunks(
    spots: Sequence[Spot], tell: Callable[[str], None], size: int = 200
) -> Iterator[Sequence[Spot]]:
    for start in range(0, len(spots), size):
        tell(f"{start} of {counted(len(spots), 'place')}")
        yield spots[start : start + size]


def _far(case: _Case, spots: Sequence[Spot]) -> list[tuple[int, float]]:
    """How many edges the joints reach at each place, collisions aside: no more are ever reached; and the mean room, as
    a share, that the joints have to their limits.
    """
    frames = [case.base_from_work(spot) for spot in spots]
    good, room = (
        np.zeros((len(spots), len(case.looks)), bool),
        np.zeros((len(spots), len(case.looks))),
    )
    position, rotation = (
        np.concatenate([getattr(w, name) for w in case.looks]) for name in ("position", "rotation")
    )
    goals = [_flange(case, frame, position, rotation) for frame in frames]
    rotations, origins = (np.concatenate(parts) for parts in zip(*goals, strict=True))
    found = inverse(case.robot, rotations, origins, case.robot.home)
    found = found.reshape(len(spots), len(position), found.shape[1], -1)
    left = -excess(case.robot, found).max(axis=-1)
    clear = np.nan_to_num(from_singular(case.robot, found), nan=0.0).min(axis=-1, initial=math.inf)
    left = np.where(clear >= MARGIN, left, -math.inf)
    ends = np.cumsum([len(way) for way in case.looks])[:-1]
    for k, own in enumerate(np.split(left, ends, axis=1)):
        most = own.min(axis=1).max(axis=1)
        good[:, k], room[:, k] = most >= 0, np.clip(most, 0.0, _ROOM) / _ROOM
    return list(zip(good.sum(axis=1).tolist(), room.mean(axis=1).tolist(), strict=True))


def _flange(
    case: _Case, frame: Pose, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return flange_poses(Setup(case.robot, frame, case.cell.flange_from_tool), position, rotation)


def _apart(spots: Sequence[Spot], values: Sequence[tuple[int, float]]) -> list[Spot]:
    """The best distance for each height and turn, the best first."""
    best: dict[tuple[float, float], tuple[tuple[float, float], Spot]] = {}
    for spot, value in zip(spots, values, strict=True):
        key, rank = (spot.height, spot.turn), (_rank(value), spot)
        if value[0] and (key not in best or rank < best[key]):
            best[key] = rank
    return [spot for _, spot in sorted(best.values())]


def _rank(value: tuple[int, float]) -> tuple[float, float]:
    """Least for the best: more edges, then more room."""
    return -value[0], -round(value[1], 6)


def _look(case: _Case, spot: Spot, known: dict[Spot, tuple[int, float]]) -> tuple[int, float]:
    """The edges that the nominal tool reaches, collisions counted, and the room. Where fewer than the best so far can
    be reached it is not looked at: none.
    """
    if spot not in known:
        ((most, room),) = _far(case, [spot])
        so_far = max((count for count, _ in known.values()), default=0)
        known[spot] = (_nominal(case, spot) if most >= so_far else 0, room)
    return known[spot]


def _nominal(case: _Case, spot: Spot) -> int:
    cell = replace(case.cell, base_from_work=case.base_from_work(spot))
    where = around(case.job, cell, case.solid, case.tip)
    try:
        home_of(case.robot, cell, where.scene)
    except NoSafeProgram:
        return 0
    # As many edges are reached with the margin as without it.
    setup = setup_of(case.robot, cell, replace(where, margin=0.0))
    edges = choose(case.solid, case.job).values()
    return sum(
        isinstance(one, EdgeMotion)
        for one in reach(edges, setup, case.job.operation.offset, case.direction)
    )


def _refine(
    case: _Case, start: Spot, known: dict[Spot, tuple[int, float]], free: bool, watch: Watch
) -> None:
    """From ``start`` to ever better neighbours, in steps that are halved."""
    step = 0.75 / _STEPS * 2 * case.robot.lever / 2
    turn, here = _TURN / 2, start
    for _ in range(_ROUNDS):
        moves = [(step, 0.0, 0.0), (-step, 0.0, 0.0), (0.0, 0.0, turn), (0.0, 0.0, -turn)]
        moves += [(0.0, step, 0.0), (0.0, -step, 0.0)] if free else []
        for away, up, by in moves:
            watch(
                f"placing {counted(len(known), 'place')}, at most {max(n for n, _ in known.values())} edges"
            )
            near = (here.distance + away, here.height + up, (here.turn + by) % 360)
            spot = Spot(float(round(near[0])), float(round(near[1])), float(near[2]))
            if spot.distance > 0 and _rank(_look(case, spot, known)) < _rank(known[here]):
                here = spot
        step, turn = step / 2, turn / 2


def _whole(case: _Case, part: Part, spot: Spot, nominal: int, post: str) -> Found:
    """The build at this place."""
    frame = case.base_from_work(spot)
    angles = [math.degrees(angle) for angle in fixed_xyz(frame.rotation)]
    values = tuple(round(v, 4) + 0.0 for v in (*frame.origin, *angles))
    job = replace(case.job, cell=replace(case.job.cell, base_from_work=list(values)))
    try:
        result = build(part, post=post, job=job)
    except NoSafeProgram:
        return Found(spot, values, nominal, 0, math.inf)
    return Found(spot, values, nominal, len(result.tour.paths), result.cycle.total, result)
