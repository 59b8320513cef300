"""A way of the joints round what collides, by one place in between or two, where a tour has no better state."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from camgen.model.pose import FloatArray
from camgen.motion.limits import MotionLimits
from camgen.robots.models import Robot

#: So many of the quickest places are tried at a time, of those that are clear, and so many rounds with more.
_TRIED, _ROUNDS = 24, 3
#: Places that are drawn by lot in a round, and how far beside the straight way, rad or as a share of a slide's range.
_DRAWN, _BESIDE = 48, 1.0

#: Which of several motions of the joints, each from and to (J,), are blocked.
Blocked = Callable[[Sequence[tuple[FloatArray, FloatArray]]], list[bool]]
#: Which joint values (N, J) are clear (N,).
Clear = Callable[[FloatArray], "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]"]


def find_detour(
    robot: Robot,
    limits: MotionLimits,
    ends: tuple[FloatArray, FloatArray],
    others: FloatArray,
    clear: Clear,
    blocked: Blocked,
) -> tuple[FloatArray, ...] | None:
    """The joint values (J,) to go through between both ``ends``, or None where none are found.

    others: (K, J) places that may do, tried with all those that have some joints of one end and some of the other; then
    places drawn by lot, the same each time.
    """
    a, b = ends
    lot = np.random.Generator(np.random.PCG64(0))
    out: list[FloatArray] = []
    into: list[FloatArray] = []
    places = np.concatenate([_mixes(a, b), others])
    for _ in range(_ROUNDS):
        found = _try(limits, ends, places[clear(places)], blocked, out, into)
        if found is not None:
            return found
        share = lot.random((_DRAWN, 1))
        wide = _BESIDE * (2 * lot.random((_DRAWN, len(a))) - 1)
        wide *= [
            limit[1] - limit[0] if joint.sliding else 1.0
            for joint, limit in zip(robot.joints, robot.limits, strict=True)
        ]
        places = np.clip(a + share * (b - a) + wide, robot.limits[:, 0], robot.limits[:, 1])
    return None


def _mixes(a: FloatArray, b: FloatArray) -> FloatArray:
    """All places with some joints of one end and some of the other."""
    moved = np.flatnonzero(np.abs(b - a) > 1e-9)
    rows = []
    for count in range(1, len(moved)):
        for some in itertools.combinations(moved.tolist(), count):
            place = a.copy()
            place[list(some)] = b[list(some)]
            rows.append(place)
    return np.array(rows).reshape(-1, len(a))


def _try(
    limits: MotionLimits,
    ends: tuple[FloatArray, FloatArray],
    places: FloatArray,
    blocked: Blocked,
    out: list[FloatArray],
    into: list[FloatArray],
) -> tuple[FloatArray, ...] | None:
    """The quickest way by one of ``places`` (K, J), or by one that is reached and one that leads on; these are added to
    ``out`` and ``into``.
    """
    a, b = ends
    if len(places):
        took = limits.seconds(places - a, 0.0) + limits.seconds(b - places, 0.0)
        best = places[np.argsort(took, kind="stable")[:_TRIED]]
        stops = blocked([(a, place) for place in best] + [(place, b) for place in best])
        first, second = stops[: len(best)], stops[len(best) :]
        for place, one, two in zip(best, first, second, strict=True):
            if not one and not two:
                return (place,)
            if not one:
                out.append(place)
            if not two:
                into.append(place)
    if not out or not into:
        return None
    ways = [(p, q) for p in out for q in into]
    took = np.array([limits.seconds(np.stack([p - a, q - p, b - q]), 0.0).sum() for p, q in ways])
    tried = [ways[k] for k in np.argsort(took, kind="stable")[: 2 * _TRIED]]
    return next((way for way, stop in zip(tried, blocked(tried), strict=True) if not stop), None)
