"""Orders the edges of a 3-D part: one route over all processing motions (RFA paper)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.motion.cell import find_home, make_free_space, make_setup
from camgen.motion.edge_paths import list_pieces, make_no_edge_error, make_tool_path, note_left_out
from camgen.motion.limits import choose_link_speeds
from camgen.motion.setup import EdgeMotion, Setup, compute_feed_factor
from camgen.order.edges.links import JointLink, PathLink
from camgen.order.edges.problem import RouteCell, RouteOptions
from camgen.order.edges.route import Route, find_route
from camgen.order.tours import EdgeTour
from camgen.plan import EdgePlan, Watch
from camgen.plan.contact_feed import CAPPED, note_contact_feed
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.workcell import Workcell


def order_edges(plan: EdgePlan, job: Job, cell: Cell | None, watch: Watch) -> EdgeTour:
    """Order the motions of `plan` on a route from and back to the home of `cell`.

    Raises JobError without an arm, and NoSafeProgram if no motion has a collision-free link.
    """
    if not isinstance(cell, Workcell) or cell.arm is None:
        raise JobError(
            "job", "edges of 3-D parts need an arm", "--post", "give rapid, pacscript or vplus"
        )
    edges = {edge.id: edge for edge in plan.edges}
    setup = make_setup(cell.arm, cell, plan.where)
    home = find_home(cell.arm, cell, plan.where.scene)
    watch("linking")
    best, lifted = job.tour.method == "best", job.process.force > 0
    process, where, strict = job.process, plan.where, None
    if where.strict is not None:
        strict = make_free_space(replace(where, work=where.strict), setup)
    route_cell = RouteCell(setup, make_free_space(where, setup), home, where.rims, strict)
    speeds = choose_link_speeds(process, cell.pace, pressed=lifted)
    options = RouteOptions(speeds, best, lifted, plan.barred)

    def link(motions: Sequence[EdgeMotion]) -> Route:
        return find_route(
            route_cell, motions, plan.edges, options, lambda step: watch(f"linking {step}")
        )

    route = link(plan.motions)
    # The margin must not cost an edge. If the motion that keeps the margin has no link, the one
    # that would be preferred without a margin may have one.
    dropped = {motion.id for motion in route.dropped}
    motions = [m.nearer if m.nearer and m.id in dropped else m for m in plan.motions]
    if any(motion is not old for motion, old in zip(motions, plan.motions, strict=True)):
        second_route = link(motions)
        if len(second_route.legs) > len(route.legs):
            route = second_route
    if not route.legs:
        unreachable = [*plan.unreached, *route.dropped]
        raise make_no_edge_error(plan.part, len(edges), unreachable[0], plan.noun)
    lengths = tuple(edges[leg.motion.line].length - sum(leg.motion.trimmed) for leg in route.legs)
    paths = tuple(make_tool_path(leg.motion, edges[leg.motion.line], job) for leg in route.legs)
    method = "best found" if best else "nearest neighbour"
    notes = (
        *note_left_out(route.dropped, edges, list_pieces(plan.motions, edges)),
        *_note_freed(route, plan.noun),
        *_note_feeds(route, lengths, job, plan.noun),
        *_note_links(route, plan.noun),
    )
    travel = _measure_travel(route, setup, home)
    return EdgeTour(
        paths, travel, method, notes=notes, route=route, lengths=lengths, original_paths=paths
    )


def _note_freed(route: Route, noun: str) -> Iterator[Note]:
    for leg in route.legs:
        if leg.motion.freed is not None:
            tilt, roll = (short(value, 1) for value in leg.motion.freed)
            what = f"{noun} {leg.motion.id} is reached with {tilt} deg of tilt, {roll} deg of roll"
            yield Note("assumed", what)


def _note_feeds(route: Route, lengths: Sequence[float], job: Job, noun: str) -> Iterator[Note]:
    process = job.process
    slow: dict[str, float] = {}
    for leg, length in zip(route.legs, lengths, strict=True):
        factor = compute_feed_factor(leg.motion, length)
        if factor > process.max_feed_factor * CAPPED:
            slow[leg.motion.id] = factor
    if not slow:
        return
    slowest = max(slow, key=slow.__getitem__)
    what = f"{counted(len(slow), noun)} slower than process.feed"
    yield note_contact_feed(what, slowest, slow[slowest], process, tuple(slow))


def _note_links(route: Route, noun: str) -> Iterator[Note]:
    with_approach, shared = 0, 0
    for leg in route.legs:
        kinds = [motion.kind for motion in leg.link if isinstance(motion, PathLink)]
        with_approach += "approach" in kinds
        shared += kinds.count("shared edge")
    nearest = "has no collision-free links"
    if math.isfinite(route.nearest):
        nearest = f"{short(route.nearest, 1)} s"
    what = (
        f"links: {with_approach} with approach from free space, "
        f"{len(route.legs) - with_approach} direct, {counted(shared, noun)} run idle; "
        f"{short(route.seconds, 1)} s, nearest neighbour {nearest}"
    )
    yield Note("assumed", what)
    if route.searched:
        detours = f"the link home from {counted(route.searched, noun)} is a detour found by search"
        yield Note("assumed", detours, "the direct motion from its retract collides")


def _measure_travel(route: Route, setup: Setup, home: FloatArray) -> float:
    """Travel of the TCP, mm; a joint motion counts as the line between its ends."""
    motions = itertools.chain.from_iterable((*leg.link, leg.motion) for leg in route.legs)
    rows = []
    length = 0.0
    current = home
    for motion in (*motions, *route.back):
        if isinstance(motion, JointLink):
            rows += [current, motion.joints]
            current = motion.joints
        else:
            if not isinstance(motion, EdgeMotion):
                length += float(motion.pose_path.length.sum())
            current = motion.joints[-1]
    rotations, origins = compute_flange(setup.robot, np.stack(rows))
    tips = origins + rotations @ np.asarray(setup.flange_from_tool.origin)
    return length + float(np.linalg.norm(tips[1::2] - tips[::2], axis=1).sum())
