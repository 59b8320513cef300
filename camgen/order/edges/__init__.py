"""The order of the edges of a 3-D part: one route over all processing motions (RFA paper)."""

from __future__ import annotations

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
from camgen.order.edges.route import Route, RouteCell, RouteOptions, route
from camgen.order.tours import EdgeTour
from camgen.plan import EdgePlan, Watch
from camgen.plan.contact_feed import CAPPED, note_contact_feed
from camgen.robots.kinematics.forward import flange
from camgen.robots.workcell import Workcell


def order_edges(plan: EdgePlan, job: Job, cell: Cell | None, watch: Watch) -> EdgeTour:
    """The route over the motions of ``plan`` from and back to the home of ``cell``.

    Raises NoSafeProgram if there is no free link to any of them.
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
    process, where = job.process, plan.where
    strict = (
        None if where.strict is None else make_free_space(replace(where, work=where.strict), setup)
    )
    place = RouteCell(setup, make_free_space(where, setup), home, where.rims, strict)
    options = RouteOptions(
        choose_link_speeds(process, cell.pace, pressed=lifted), best, lifted, plan.barred
    )

    def tell(far: str) -> None:
        watch(f"linking {far}")

    made = route(place, plan.motions, plan.edges, options, tell)
    # What the margin asks for costs no edge: the motion that was preferred but for it may have a way to it.
    lost_ids = {one.id for one in made.dropped}
    others = [one.nearer if one.nearer and one.id in lost_ids else one for one in plan.motions]
    if any(one is not other for one, other in zip(others, plan.motions, strict=True)):
        again = route(place, others, plan.edges, options, tell)
        made = again if len(again.legs) > len(made.legs) else made
    lost = [*plan.unreached, *made.dropped]
    if not made.legs:
        raise make_no_edge_error(plan.part, len(edges), lost[0], plan.noun)
    lengths = tuple(edges[leg.motion.line].length - sum(leg.motion.trimmed) for leg in made.legs)
    paths = tuple(make_tool_path(leg.motion, edges[leg.motion.line], job) for leg in made.legs)
    method = "best found" if best else "nearest neighbour"
    notes = (
        *note_left_out(made.dropped, edges, list_pieces(plan.motions, edges)),
        *_note_freed(made, plan.noun),
        *_note_feeds(made, lengths, job, plan.noun),
        *_note_links(made, plan.noun),
    )
    return EdgeTour(
        paths,
        _travel(made, setup, home),
        method,
        notes=notes,
        route=made,
        lengths=lengths,
        made=paths,
    )


def _note_freed(made: Route, noun: str) -> list[Note]:
    """The edges that the nominal orientation does not reach."""
    notes = []
    for leg in made.legs:
        if leg.motion.freed is not None:
            tilt, roll = (short(value, 1) for value in leg.motion.freed)
            notes.append(
                Note(
                    "assumed",
                    f"{noun} {leg.motion.id} is reached with {tilt} deg of tilt, {roll} deg of roll",
                )
            )
    return notes


def _note_feeds(tour: Route, lengths: Sequence[float], job: Job, noun: str) -> Iterator[Note]:
    """The edges along which the tool runs slower than the feed of the job, by its factor."""
    process = job.process
    factors = [
        compute_feed_factor(leg.motion, n) for leg, n in zip(tour.legs, lengths, strict=True)
    ]
    slow = [k for k, factor in enumerate(factors) if factor > process.max_feed_factor * CAPPED]
    if not slow:
        return
    worst = max(slow, key=factors.__getitem__)
    what = f"{counted(len(slow), noun)} slower than process.feed"
    names = tuple(tour.legs[k].motion.id for k in slow)
    yield note_contact_feed(what, tour.legs[worst].motion.id, factors[worst], process, names)


def _note_links(made: Route, noun: str) -> list[Note]:
    kinds = [piece.kind for leg in made.legs for piece in leg.link if isinstance(piece, PathLink)]
    free = sum(
        any(isinstance(p, PathLink) and p.kind == "approach" for p in leg.link) for leg in made.legs
    )
    direct = len(made.legs) - free
    what = (
        f"links: {free} with approach from free space, {direct} direct, "
        f"{counted(kinds.count('shared edge'), noun)} run idle; "
        f"{short(made.seconds, 1)} s, nearest neighbour {_tell_time(made.nearest)}"
    )
    notes = [Note("assumed", what)]
    if made.searched:
        ways = f"the way home from {counted(made.searched, noun)} was found by search"
        notes.append(Note("assumed", ways, "what leads up from there collides"))
    return notes


def _tell_time(seconds: float) -> str:
    return f"{short(seconds, 1)} s" if math.isfinite(seconds) else "has no free way"


def _travel(made: Route, setup: Setup, home: FloatArray) -> float:
    """The way of the TCP, mm, between the edges, joint motions as the straight line between their ends."""
    rows = [home]
    length = 0.0
    pieces = [piece for leg in made.legs for piece in (*leg.link, leg.motion)] + [*made.back]
    here = home
    for piece in pieces:
        if isinstance(piece, JointLink):
            rows += [here, piece.joints]
            here = piece.joints
        else:
            length += 0.0 if isinstance(piece, EdgeMotion) else float(piece.way.length.sum())
            here = piece.joints[-1]
    rotations, origins = flange(setup.robot, np.stack(rows[1:]))
    tips = origins + rotations @ np.asarray(setup.flange_from_tool.origin)
    return length + float(np.linalg.norm(tips[1::2] - tips[::2], axis=1).sum())
