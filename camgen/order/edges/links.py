"""All links between the ends of processing motions, what each takes, and the one that is cheapest.

RFA paper, section III.B: direct where two ends share a vertex, along a reached edge where one joins them, else by
retraction, free motion and approach. One retraction for each end makes them all: O(n) motions, not O(n^2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.limits import LinkSpeeds, turn_speed
from camgen.motion.pose_paths import Way
from camgen.motion.setup import Reached, Setup
from camgen.order.edges.retract import Retraction
from camgen.robots.kinematics.forward import flange
from camgen.robots.models import Robot

#: Up to so many motions it is looked for links along more than one edge: the cost is the cube of their number.
MANY = 150
#: Links by retraction, free motion and approach, the second by way of the home position.
FREE, BY_HOME = -1, -2


class Turn(Struct, frozen=True, eq=False):
    """A motion of the joints to ``joints`` (J,), all of them evenly. free: it is in free space, not at the part. speed:
    mm/s of the TCP, and share: of the joints' greatest speeds, 0 where the speed alone holds; both by ``paced``.
    """

    joints: FloatArray
    free: bool = True
    speed: float = 0.0
    share: float = 0.0


class Along(Struct, frozen=True, eq=False):
    """A motion of the TCP along ``way``, from its first row. joints: (N, J). speed: (N - 1,) mm/s of each segment."""

    way: Way
    joints: FloatArray
    speed: FloatArray
    kind: Literal["retraction", "approach", "shared edge"]


Piece = Turn | Along


class Ends(Struct, frozen=True, eq=False):
    """The ends of n motions, 2 i the start of motion i, 2 i + 1 its end. joints: (2 n, J). safe: (2 n, J) where the
    retraction of each leads. out: (2 n,) s it takes. free: (2 n, 2 n) s from safe to safe. direct: (2 n, 2 n) s of the
    direct motions that are clear, else infinite. through: (n,) s along each motion with the process off. speed: mm/s
    at the part.
    """

    joints: FloatArray
    safe: FloatArray
    out: FloatArray
    free: FloatArray
    direct: FloatArray
    through: FloatArray
    speed: float


def seconds(robot: Robot, a: FloatArray, b: FloatArray, speed: float) -> FloatArray:
    """What the joints need from ``a`` to ``b`` (..., J), the slowest counting, or the flange at ``speed`` mm/s."""
    joints = (np.abs(b - a) / robot.fastest).max(axis=-1)
    places = [
        flange(robot, x.reshape(-1, x.shape[-1]))[1].reshape(*x.shape[:-1], 3) for x in (a, b)
    ]
    ways = np.linalg.norm(places[1] - places[0], axis=-1)
    return np.asarray(np.maximum(joints, ways / speed))


def distinct(vertices: FloatArray, near: float) -> BoolArray:
    """(2 n, 2 n): which ends of different edges are at one vertex. vertices: (2 n, 3) of the edges, not of the tool."""
    same = np.linalg.norm(vertices[:, None] - vertices[None], axis=2) < near
    own = np.arange(len(vertices)) // 2
    same &= own[:, None] != own[None]
    return np.asarray(same)


def along(ends: Ends) -> tuple[FloatArray, IntArray]:
    """Seconds (2 n, 2 n) of the cheapest link at the part from each end to each other, and the next end on its way."""
    best = ends.direct.copy()
    at = np.arange(len(best))
    first = np.broadcast_to(at[None], best.shape).copy()
    if len(best) <= 2 * MANY:
        best[at, at ^ 1] = ends.through[at // 2]
        for k in range(len(best)):
            over = best[:, k, None] + best[None, k]
            better = over < best - 1e-12
            best = np.where(better, over, best)
            first = np.where(better, first[:, k, None], first)
    return best, first


def steps(
    ends: Ends, at_part: tuple[FloatArray, IntArray], blocked: BoolArray, home: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Seconds (2 n, 2 n) of the cheapest link from each end to each other, and how it begins (2 n, 2 n): the next end
    on the way, ``FREE`` for retraction, free motion and approach, ``BY_HOME`` for the same by way of the home position.

    at_part: as of ``along``. blocked: (2 n, 2 n) free motions that collide. home: (2 n,) s from free space to home,
    infinite where that collides.
    """
    moving = np.stack([np.where(blocked, math.inf, ends.free), home[:, None] + home[None]])
    free = moving.min(axis=0) + ends.out[:, None] + ends.out[None]
    begins = np.where(moving.argmin(axis=0) == 0, FREE, BY_HOME)
    best, first = at_part
    rfa = free < best
    return np.where(rfa, free, best), np.where(rfa, begins, first)


def pieces(
    a: int,
    b: int,
    ends: Ends,
    first: IntArray,
    motions: Sequence[Reached],
    out: Sequence[Retraction],
    home: FloatArray,
) -> Iterator[Piece]:
    """The link from end ``a`` to end ``b`` as it is run. home: (J,)."""
    if first[a, b] < 0:
        yield leaving(out[a])
        if first[a, b] == BY_HOME:
            yield from (Turn(joints) for joints in (*out[a].via, home, *out[b].via[::-1]))
        yield Turn(ends.safe[b])
        yield entering(out[b])
        return
    while a != b:
        over = int(first[a, b])
        if over == a ^ 1:
            motion = motions[a // 2] if a % 2 == 0 else motions[a // 2].reversed()
            yield Along(
                motion.way, motion.joints, np.full(len(motion.way) - 1, ends.speed), "shared edge"
            )
        else:
            yield Turn(ends.joints[over], free=False)
        a = over


def paced(
    setup: Setup, pieces: Sequence[Piece], here: FloatArray, speeds: LinkSpeeds
) -> tuple[Piece, ...]:
    """``pieces`` of a link that begins at the joints ``here`` (J,), its motions of the joints in free space as fast as
    the joints and ``speeds`` allow.
    """
    found: list[Piece] = []
    for piece in pieces:
        if isinstance(piece, Turn):
            found.append(_pace_turn(setup, piece, here, speeds))
            here = piece.joints
        else:
            found.append(piece)
            here = piece.joints[-1]
    return tuple(found)


def _pace_turn(setup: Setup, turn: Turn, here: FloatArray, speeds: LinkSpeeds) -> Turn:
    speed, share = turn_speed(setup, here, turn.joints, speeds) if turn.free else (speeds.part, 0.0)
    return replace(turn, speed=speed, share=share)


def leaving(out: Retraction) -> Along:
    """A retraction."""
    return Along(out.way, out.joints, out.speed, "retraction")


def entering(out: Retraction) -> Along:
    """The same as an approach."""
    return Along(out.way.reversed(), out.joints[::-1], out.speed[::-1], "approach")


def by_way_of(motion: Reached, end: int, other: Retraction, speed: float) -> Retraction:
    """Out of one end (0 start, 1 end) back along the motion at ``speed`` mm/s and then as from its other end."""
    there = motion if end == 0 else motion.reversed()
    return Retraction(
        _chain(there.way, other.way),
        np.concatenate([there.joints, other.joints[1:]]),
        _chain(there.looks, other.looks),
        np.concatenate([there.dense, other.dense[1:]]),
        np.concatenate([np.full(len(there.way) - 1, speed), other.speed]),
        "back along the edge",
        other.via,
    )


def _chain(one: Way, other: Way) -> Way:
    """``one`` and then ``other``, which begins where it ends."""
    return Way(
        *(np.concatenate([getattr(one, f), getattr(other, f)[1:]]) for f in Way.__struct_fields__)
    )
