"""Searches a detour of the joints through one or two intermediate joint values."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.motion.limits import MotionLimits
from camgen.robots.models import Robot

#: Fastest clear candidates that are tried at a time.
_TRIED = 24
#: Rounds with more candidates.
_ROUNDS = 3
#: Random candidates in a round.
_DRAWN = 48
#: Largest distance of these from the direct motion, rad, or as a fraction of a slide's range.
_DISTANCE = 1.0

#: A test of joint motions, each from and to (J,): which are blocked.
BlockedTest = Callable[[Sequence[tuple[FloatArray, FloatArray]]], list[bool]]
#: A test of joint values (N, J): which are clear, (N,).
ClearTest = Callable[[FloatArray], BoolArray]


def find_detour(
    robot: Robot,
    limits: MotionLimits,
    ends: tuple[FloatArray, FloatArray],
    others: FloatArray,
    clear: ClearTest,
    blocked: BlockedTest,
) -> tuple[FloatArray, ...] | None:
    """Find the joint values (J,) to pass through between both ends; None if none are found.

    Candidates are mixtures of both ends and `others`, then random joint values, the same each time.

    others: (K, J) joint values.
    """
    a, b = ends
    rng = np.random.Generator(np.random.PCG64(0))
    low, high = robot.limits[:, 0], robot.limits[:, 1]
    widths = np.where(robot.revolute, 1.0, high - low)
    leaving: list[FloatArray] = []
    arriving: list[FloatArray] = []
    candidates = np.concatenate([_mix_ends(a, b), others])
    for _ in range(_ROUNDS):
        clear_candidates = candidates[clear(candidates)]
        detour = _try_candidates(limits, ends, clear_candidates, blocked, (leaving, arriving))
        if detour is not None:
            return detour
        fraction = rng.random((_DRAWN, 1))
        offset = _DISTANCE * (2 * rng.random((_DRAWN, len(a))) - 1) * widths
        candidates = np.clip(a + fraction * (b - a) + offset, low, high)
    return None


def _mix_ends(a: FloatArray, b: FloatArray) -> FloatArray:
    """All joint values with some joints of one end and the others of the other end."""
    moved = np.flatnonzero(np.abs(b - a) > 1e-9)
    rows = []
    for count in range(1, len(moved)):
        for joints in itertools.combinations(moved.tolist(), count):
            row = a.copy()
            row[list(joints)] = b[list(joints)]
            rows.append(row)
    return np.array(rows).reshape(-1, len(a))


def _try_candidates(
    limits: MotionLimits,
    ends: tuple[FloatArray, FloatArray],
    candidates: FloatArray,
    blocked: BlockedTest,
    half_linked: tuple[list[FloatArray], list[FloatArray]],
) -> tuple[FloatArray, ...] | None:
    """Find the fastest detour through a candidate (K, J), or through two with half a link each.

    half_linked: joint values that are linked with the first end, and with the second end. The
        candidates are added to them.
    """
    a, b = ends
    leaving, arriving = half_linked
    if len(candidates):
        seconds = limits.seconds(candidates - a, 0.0) + limits.seconds(b - candidates, 0.0)
        fastest = candidates[np.argsort(seconds, kind="stable")[:_TRIED]]
        is_blocked = blocked([*itertools.product([a], fastest), *itertools.product(fastest, [b])])
        count = len(fastest)
        for joints, first, second in zip(
            fastest, is_blocked[:count], is_blocked[count:], strict=True
        ):
            if not first and not second:
                return (joints,)
            if not first:
                leaving.append(joints)
            if not second:
                arriving.append(joints)
    if not leaving or not arriving:
        return None
    pairs: list[tuple[FloatArray, FloatArray]] = list(itertools.product(leaving, arriving))
    times = [limits.seconds(np.stack([p - a, q - p, b - q]), 0.0).sum() for p, q in pairs]
    tried = take_rows(pairs, np.argsort(np.array(times), kind="stable")[: 2 * _TRIED].tolist())
    for pair, is_pair_blocked in zip(tried, blocked(tried), strict=True):
        if not is_pair_blocked:
            return pair
    return None
