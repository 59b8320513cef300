"""The edges of a 3-D part: which the arm reaches, the route over them, and the tool paths (RFA paper)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct

from camgen.collision.cell import Meshes, Surroundings, around
from camgen.collision.hits import hits
from camgen.collision.motion import motions
from camgen.collision.scene import Scene, told
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Edge, Note, Solid
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Joints
from camgen.model.text import short
from camgen.order.edges.links import Along, Turn
from camgen.order.edges.retract import Room
from camgen.order.edges.route import Route, route
from camgen.plan.edges.motion import Freedom, Reached, Setup, Unreached, feed_of
from camgen.plan.edges.reach import reach
from camgen.plan.edges.select import select
from camgen.plan.unused import no_idle
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

#: mm: what two bodies may enter each other before a motion in between is found to collide.
STEP = 2.0


class Finished(Struct, frozen=True, eq=False):
    """where: the cell. route: its legs. lengths: mm of each leg's edge on the part. tour: the legs as tool paths."""

    where: Surroundings
    route: Route
    lengths: tuple[float, ...]
    tour: Tour
    notes: tuple[Note, ...]


def finished(
    solid: Solid, job: Job, robot: Robot, cell: Cell, meshes: Meshes, watch: Callable[[str], None]
) -> Finished:
    """The route over the selected edges of ``solid`` with ``robot`` from and back to the home of ``cell``.

    meshes: fixtures that are meshes. watch: is told the stages. InputError for a part without edges, JobError for
    settings that do not go together, NoSafeProgram where no edge is left.
    """
    _check(job, cell)
    edges = _chosen(solid, job)
    where = around(job, robot, cell, solid, meshes)
    home = _home(robot, cell, where.scene)
    setup = setup_of(robot, cell, where.scene)
    freedom = Freedom(math.radians(job.tool.axis_tilt), job.tool.symmetric)
    watch("reaching")
    found = reach(edges.values(), setup, job.operation.offset, job.operation.offset_along, freedom, job.operation.trim)
    room = room_of(where)
    found = _clear_between(found, room)
    good = [one for one in found if isinstance(one, Reached)]
    watch("linking")
    best, lifted = job.tour.method == "best", job.process.force > 0
    made = route(setup, room, good, tuple(edges.values()), home, job.process.travel, best, lifted)
    lost = [*(one for one in found if isinstance(one, Unreached)), *made.dropped]
    if not made.legs:
        raise NoSafeProgram(solid.source, f"none of {len(edges)} edges can be processed: {lost[0].id}", lost[0].text)
    lengths = tuple(edges[leg.motion.id].length - sum(leg.motion.trimmed) for leg in made.legs)
    paths = tuple(_path(leg.motion, edges[leg.motion.id], job) for leg in made.legs)
    tour = Tour(paths, _travel(made, setup, home), "best found" if best else "nearest neighbour")
    notes = (*where.notes, *_skipped(lost, edges), *_advice(lost, freedom), *_freed(made), *_said(made))
    return Finished(where, made, lengths, tour, notes)


def _clear_between(found: Sequence[Reached | Unreached], room: Room) -> tuple[Reached | Unreached, ...]:
    """``found``, without the motions that collide between two of the places where they were looked at."""
    said = iter(room.hits([one.dense for one in found if isinstance(one, Reached)]))
    result: list[Reached | Unreached] = []
    for one in found:
        hit = next(said) if isinstance(one, Reached) else ""
        result.append(Unreached(one.id, "collision", f"collision, {hit}, on the way along it") if hit else one)
    return tuple(result)


def _chosen(solid: Solid, job: Job) -> dict[str, Edge]:
    """The selected edges by their ids."""
    if not solid.edges:
        raise InputError(solid.source, "has no sharp edges", remedy="camgen inspect shows what is in it")
    chosen = set(select(solid, [job.input.select]))
    if not chosen:
        what = f"picks none of the {len(solid.edges)} edges"
        raise JobError("job", what, "input.select", "camgen inspect lists them")
    return {edge.id: edge for edge in solid.edges if edge.id in chosen}


def _check(job: Job, cell: Cell) -> None:
    if job.operation.kind not in ("auto", "edges"):
        what = f'"{job.operation.kind}" is for flat parts, this is a 3-D part'
        raise JobError("job", what, "operation.kind", 'set operation.kind to "edges"')
    if job.tour.method == "as-drawn":
        raise JobError("job", "the edges of a part have no drawn order", "tour.method", 'set it to "best" or "nearest"')
    if not isinstance(cell.home, Joints):
        raise JobError("job", "edges of 3-D parts need an arm", "--post", "give rapid, pacscript or vplus")
    no_idle(job, "a 3-D part")


def _home(robot: Robot, cell: Cell, scene: Scene) -> FloatArray:
    assert isinstance(cell.home, Joints)
    home = frozen(cell.home.values)
    if len(home) != len(robot.joints):
        what = f"{robot.name} has {len(robot.joints)} joints, home has {len(home)}"
        raise JobError("job", what, "cell.home", "give home for this robot")
    pair = int(hits(scene, home[None])[0])
    if pair >= 0:
        raise NoSafeProgram("job", f"home collides: {told(scene, pair)}", "cell.home", "give another, or move the part")
    return home


def setup_of(robot: Robot, cell: Cell, scene: Scene) -> Setup:
    """What motions along edges are tried in."""
    return Setup(
        robot,
        cell.base_from_work,
        cell.flange_from_tool,
        lambda joints: hits(scene, joints) < 0,
        lambda joints: told(scene, int(hits(scene, joints[None])[0])),
    )


def room_of(where: Surroundings) -> Room:
    """What links are tried in."""

    def found(several: Sequence[FloatArray]) -> list[str]:
        if not several:
            return []
        return [told(where.scene, c.pair) if c.pair >= 0 else "" for c in motions(where.scene, several, STEP)]

    return Room(where.level, where.low, where.high, where.room, found)


def _path(motion: Reached, edge: Edge, job: Job) -> ToolPath:
    way, count = motion.way, len(motion.way)
    axis = frozen(way.rotation[:, :, 2])
    press = np.stack([np.concatenate([axis[:1], axis[:-1]]), axis], axis=1)
    feed = feed_of(motion, edge.length - sum(motion.trimmed), job.process)
    return ToolPath(
        id=motion.id,
        layer=edge.kind,
        position=way.position,
        via=way.via,
        axis=axis,
        press=frozen(press),
        force=frozen(np.full(count, job.process.force)),
        feed=frozen(np.full(count, feed)),
        closed=edge.closed,
        contours=(edge.id,),
        operation="edges",
    )


def _skipped(lost: Sequence[Unreached], edges: dict[str, Edge]) -> list[Note]:
    found = [(one, edges[one.id]) for one in lost]
    return [
        Note("skipped", f"edge {one.id}, {edge.kind} of {short(edge.length, 1)} mm", one.text, (one.id,))
        for one, edge in found
    ]


def _advice(lost: Sequence[Unreached], freedom: Freedom) -> list[Note]:
    """What a user may not know that he can do about edges that are left out."""
    if freedom or not any(one.kind in ("limit", "singular", "jump", "collision") for one in lost):
        return []
    what = f"{len(lost)} edges are out of reach of the nominal tool"
    return [Note("warning", what, "a tilt or a free roll may reach them: tool.axis_tilt = 15, tool.symmetric = true")]


def _freed(made: Route) -> list[Note]:
    """The edges that the nominal orientation does not reach."""
    notes = []
    for leg in made.legs:
        if leg.motion.freed is not None:
            tilt, roll = (short(value, 1) for value in leg.motion.freed)
            notes.append(
                Note("assumed", f"edge {leg.motion.id} is reached with {tilt} deg of tilt, {roll} deg of roll")
            )
    for leg in made.legs:
        if sum(leg.motion.trimmed) > 0:
            before, after = (short(value, 1) for value in leg.motion.trimmed)
            what = f"edge {leg.motion.id} is run without its first {before} and last {after} mm"
            notes.append(Note("skipped", what, "the whole cannot be reached", (leg.motion.id,)))
    return notes


def _said(made: Route) -> list[Note]:
    kinds = [piece.kind for leg in made.legs for piece in leg.link if isinstance(piece, Along)]
    free = sum(any(isinstance(p, Along) and p.kind == "approach" for p in leg.link) for leg in made.legs)
    direct = len(made.legs) - free
    what = (
        f"links: {free} with approach from free space, {direct} direct, {kinds.count('shared edge')} edges run idle; "
        f"{short(made.seconds, 1)} s, nearest neighbour {short(made.nearest, 1)} s"
    )
    return [Note("assumed", what)]


def _travel(made: Route, setup: Setup, home: FloatArray) -> float:
    """The way of the TCP, mm, between the edges, joint motions as the straight line between their ends."""
    rows = [home]
    length = 0.0
    pieces = [piece for leg in made.legs for piece in (*leg.link, leg.motion)] + [*made.back]
    here = home
    for piece in pieces:
        if isinstance(piece, Turn):
            rows += [here, piece.joints]
            here = piece.joints
        else:
            length += 0.0 if isinstance(piece, Reached) else float(piece.way.length.sum())
            here = piece.joints[-1]
    rotations, origins = flange(setup.robot, np.stack(rows[1:]))
    tips = origins + rotations @ np.asarray(setup.flange_from_tool.origin)
    return length + float(np.linalg.norm(tips[1::2] - tips[::2], axis=1).sum())
