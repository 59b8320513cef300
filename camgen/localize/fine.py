"""The exact refinement: scan points to the planes of their closest triangles, robust, until nothing moves."""

from __future__ import annotations

from collections.abc import Generator
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import turn_poses
from camgen.localize.model import Cloud, Model, Touch, TouchPairs, candidates, find_touched
from camgen.localize.sight import hidden
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.tolerance import SIGMAS_OF_MEDIAN

#: Tukey's biweight: points beyond this many standard deviations count nothing; 95 % efficient for normal noise.
TUKEY = 4.685
_ROUNDS, _STEPS = 8, 12
#: How far a pose may move, as part of the reach, before the candidates are looked for again.
_SLACK_SHARE = 0.2
#: A pose that moves by less than this part of the model's size is at rest. Points that change their triangle keep it
#: from standing quite still.
_STILL_SHARE = 5e-7
#: One of two poses is worse if its losses exceed the others by this many standard deviations, and
#: by this sum.
_DECISIVE, _FEW_POINTS = 4.0, 6.0
#: A face whose normal has less than this cosine with the way up faces the bench.
_DOWN = -0.5


class ScanFit(Struct, frozen=True, eq=False):
    """A refined pose: model_from_scan as ``rotation`` (3, 3) and ``origin`` (3,), mm.

    noise: standard deviation of the residuals, robust, mm. rms: of the points that count, mm. used: which they are.
    information: (6, 6) of a turn (rad, times ``arm`` mm) about ``centre`` and a shift, in the model's frame.
    """

    rotation: FloatArray
    origin: FloatArray
    noise: float
    rms: float
    used: IntArray
    information: FloatArray
    centre: FloatArray
    arm: float

    def apply(self, points: FloatArray) -> FloatArray:
        """``points`` (N, 3) of the scan in the model's frame."""
        return np.asarray(points @ self.rotation.T + self.origin)


#: What the way of a pose asks: where its points (N, 3) are, and if they are to be looked for anew, how far from the
#: model they count and how far they may move before that is asked again, mm.
_Question = tuple[FloatArray, tuple[float, float] | None]


def refine(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    start: tuple[FloatArray, FloatArray],
    gate: float,
) -> ScanFit:
    """The pose near ``start`` (model_from_scan) that puts ``points`` (N, 3) onto the model.

    gate: mm, points farther from the model do not count; it closes as the residuals shrink. Where fewer than seven
    points are left, the start comes back with infinite noise.
    """
    return refine_all(model, samples, points, [start], gate)[0]


def refine_all(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    starts: list[tuple[FloatArray, FloatArray]],
    gate: float,
) -> list[ScanFit]:
    """Each of ``starts`` as ``refine`` does it. What they ask is answered for many of them at once: a question of some
    hundred points takes little more time than its call.
    """
    ways = [_way(model, points, start, gate) for start in starts]
    asked: dict[int, _Question] = {k: next(way) for k, way in enumerate(ways)}
    pairs: dict[int, TouchPairs] = {}
    found: dict[int, ScanFit] = {}
    while asked:
        # All go on until each of them has to look again, and then they do so together.
        moving = [k for k, (_, limits) in asked.items() if limits is None]
        if not moving:
            moving = list(asked)
            pairs = dict(
                zip(moving, _look_for(model, samples, [asked[k] for k in moving]), strict=True)
            )
        touched = _touch(model, [pairs[k] for k in moving], [asked[k][0] for k in moving])
        for k, touch in zip(moving, touched, strict=True):
            try:
                asked[k] = ways[k].send(touch)
            except StopIteration as end:
                del asked[k]
                found[k] = end.value
    return [found[k] for k in range(len(starts))]


def _look_for(model: Model, samples: Cloud, questions: list[_Question]) -> list[TouchPairs]:
    """The candidates of each question, which has as many points as any."""
    limits = [limits for _, limits in questions if limits is not None]
    at, each = np.concatenate([at for at, _ in questions]), len(questions[0][0])
    reach, slack = (np.repeat(values, each) for values in zip(*limits, strict=True))
    pairs = candidates(model, samples, at, reach, slack)
    ends = np.searchsorted(pairs.point, each * np.arange(len(questions) + 1))
    return [
        TouchPairs(pairs.point[a:b] - each * k, pairs.triangle[a:b])
        for k, (a, b) in enumerate(pairwise(ends.tolist()))
    ]


def _touch(model: Model, pairs: list[TouchPairs], places: list[FloatArray]) -> list[Touch]:
    """The closest candidates of each of some sets of places, which are as many in each."""
    each = len(places[0])
    all_pairs = TouchPairs(
        np.concatenate([some.point + each * k for k, some in enumerate(pairs)]),
        np.concatenate([some.triangle for some in pairs]),
    )
    touch = find_touched(model, all_pairs, np.concatenate(places))
    ends = np.searchsorted(touch.point, each * np.arange(len(places) + 1))
    return [
        Touch(touch.point[a:b] - each * k, touch.at[a:b], touch.triangle[a:b], touch.distance[a:b])
        for k, (a, b) in enumerate(pairwise(ends.tolist()))
    ]


def _way(
    model: Model, points: FloatArray, start: tuple[FloatArray, FloatArray], gate: float
) -> Generator[_Question, Touch, ScanFit]:
    """The way of a pose from its start to where it is at rest: it asks where its points touch the model."""
    rotation, origin = start
    floor, still = 1e-6 * model.size, _STILL_SHARE * model.size
    noise = least = gate / TUKEY
    found = ScanFit(
        rotation,
        origin,
        np.inf,
        np.inf,
        np.zeros(0, dtype=np.int64),
        np.zeros((6, 6)),
        np.zeros(3),
        1.0,
    )
    for _ in range(_ROUNDS):
        reach = max(TUKEY * noise, 10 * floor)
        slack = max(_SLACK_SHARE * reach, floor)
        limits: tuple[float, float] | None = (reach, slack)
        moved = 0.0
        for _ in range(_STEPS):
            at = points @ rotation.T + origin
            touch = yield at, limits
            limits = None
            near = touch.distance <= reach
            if np.count_nonzero(near) < 7:
                return found
            spread = SIGMAS_OF_MEDIAN * float(np.median(touch.distance[near]))
            noise = max(min(spread, gate / TUKEY), least, floor)
            found, turn, shift = _step(model, touch, at, noise, (rotation, origin))
            rotation = turn @ rotation
            origin = turn @ (origin - found.centre) + found.centre + shift
            step = float(np.linalg.norm(shift)) + found.arm * float(
                np.linalg.norm(turn - np.eye(3))
            )
            moved += 2 * step
            if step < still or moved > slack:
                break
        settled = step < still and TUKEY * noise > 0.8 * reach and noise > least
        # The gate closes by halves at most: few points beyond the rims hold a flat part sideways.
        least *= 0.5
        if settled or (step < still and reach <= 10 * floor):
            break
    return found


def draw(model: Model, samples: Cloud, points: FloatArray, start: ScanFit, reach: float) -> ScanFit:
    """The pose near ``start`` that puts ``points`` (N, 3) onto the model, all that are within ``reach`` (mm) of it to
    the end, however near the most of them are. Points without noise that hold a motion by few of them need that.
    """
    rotation, origin, found = start.rotation, start.origin, start
    for _ in range(_STEPS):
        at = points @ rotation.T + origin
        touch = find_touched(model, candidates(model, samples, at, reach, 0.0), at)
        if len(touch.point) < 7:
            break
        found, turn, shift = _step(model, touch, at, reach / TUKEY, (rotation, origin))
        rotation = turn @ rotation
        origin = turn @ (origin - found.centre) + found.centre + shift
        if (
            float(np.linalg.norm(shift)) + found.arm * float(np.linalg.norm(turn - np.eye(3)))
            < _STILL_SHARE * model.size
        ):
            break
    return found


def _step(
    model: Model, touch: Touch, at: FloatArray, noise: float, pose: tuple[FloatArray, FloatArray]
) -> tuple[ScanFit, FloatArray, FloatArray]:
    """One Gauss-Newton step: the fit before it, and the turn (3, 3) about its centre and shift (3,) that it takes."""
    ratio = (touch.distance / (TUKEY * noise)) ** 2
    weight = np.where(ratio < 1, (1 - ratio) ** 2, 0.0)
    counts = weight > 0
    total = float(weight.sum())
    places = at[touch.point]
    normals, off = _pulls(model, touch, places)
    centre = (weight[:, None] * places).sum(axis=0) / total
    arms = places - centre
    arm = float(np.sqrt((weight * (arms * arms).sum(axis=1)).sum() / total))
    lines = np.concatenate([np.cross(arms, normals) / arm, normals], axis=1)
    pulled = lines * weight[:, None]
    matrix = pulled.T @ lines / total
    damped = matrix + 1e-9 * np.eye(6)
    step = -np.linalg.solve(damped, pulled.T @ off / total)
    rms = float(np.sqrt((off[counts] ** 2).mean()))
    fit = ScanFit(pose[0], pose[1], noise, rms, touch.point[counts], matrix, centre, arm)
    return fit, turn_poses(step[None, :3] / arm)[0], step[3:]


def _pulls(model: Model, touch: Touch, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Which way each place moves away from the model fastest (K, 3), and how far away it is, signed, mm.

    Over a face that is its normal. Beside an edge it is the way from there: what lies beyond the rim of a face says
    where that ends, which is all that holds a box sideways that is seen from above.
    """
    away, normals = places - touch.at, model.normals[touch.triangle]
    off = np.einsum("ij,ij->i", away, normals)
    beside = np.flatnonzero(touch.distance > np.abs(off) * (1 + 1e-6) + 1e-9 * model.size)
    normals[beside] = away[beside] / touch.distance[beside, None]
    off[beside] = touch.distance[beside]
    return normals, off


class View(Struct, frozen=True, eq=False):
    """Points of a scan (N, 3), mm, and the place of the scanner as far as it is known.

    eye: (3,), its place, mm; None if it is not known.
    up: (3,), unit, from the bench to the part and the scanner; None without a bench.
    """

    points: FloatArray
    eye: FloatArray | None = None
    up: FloatArray | None = None


def losses(model: Model, samples: Cloud, view: View, fit: ScanFit, gate: float) -> FloatArray:
    """The loss of each point of a view, 0..1 (N,): its squared distance in units of ``gate`` (mm).

    It is 1 for points farther than the gate, and on places that the scanner cannot have seen.
    """
    touch = on(model, samples, fit.apply(view.points), gate)
    seen = ~unseen(model, touch, view, fit, gate)
    loss = np.ones(len(view.points))
    loss[touch.point[seen]] = (touch.distance[seen] / gate) ** 2
    return loss


def cost(model: Model, samples: Cloud, view: View, fit: ScanFit, gate: float) -> float:
    """The mean of the ``losses``, 0..1."""
    return float(losses(model, samples, view, fit, gate).mean())


def is_worse(losses: FloatArray, best: FloatArray) -> bool:
    """Whether losses (N,) exceed the losses ``best`` of another pose by more than chance."""
    more = losses - best
    spread = float(np.sqrt((more * more).sum()))
    return float(more.sum()) > max(_DECISIVE * spread, _FEW_POINTS)


def unseen(model: Model, touch: Touch, view: View, fit: ScanFit, gap: float) -> BoolArray:
    """Whether the scanner cannot have seen each of the touched places: (N,).

    The model hides them by more than ``gap`` mm, or they face the bench.
    """
    if view.eye is not None:
        # From the model, not from the points: noise puts those of a face that is seen aslant far behind it.
        return hidden(model, touch.at, fit.apply(view.eye), gap)
    if view.up is not None:
        return np.asarray(model.normals[touch.triangle] @ (fit.rotation @ view.up) < _DOWN)
    return np.zeros(len(touch.point), dtype=bool)


def _mean_cost(near: FloatArray, count: int, gate: float) -> float:
    """The cost of ``count`` points of which those at the distances ``near`` (mm) are on the model."""
    return 1 - (len(near) - float(((near / gate) ** 2).sum())) / count


def costs(
    model: Model,
    samples: Cloud,
    view: View,
    fits: list[ScanFit],
    gate: float,
    same: float = 0.0,
) -> list[float]:
    """The ``cost`` of each fit.

    Sight makes no cost less. So it is examined only for fits that may be the best, or worse by at
    most ``same``.
    """
    if not fits:
        return []
    points = view.points
    touch = on(model, samples, np.concatenate([fit.apply(points) for fit in fits]), gate)
    ends = np.searchsorted(touch.point, len(points) * np.arange(1, len(fits)))
    results = [_mean_cost(near, len(points), gate) for near in np.split(touch.distance, ends)]
    if view.eye is None and view.up is None:
        return results
    best = np.inf
    for i in sorted(range(len(fits)), key=results.__getitem__):
        if results[i] > best + same:
            break
        results[i] = cost(model, samples, view, fits[i], gate)
        best = min(best, results[i])
    return results


def on(model: Model, samples: Cloud, at: FloatArray, reach: float) -> Touch:
    """The touches of the places ``at`` (N, 3) within ``reach`` (mm) of the model."""
    touch = find_touched(model, candidates(model, samples, at, reach, 0.0), at)
    near = touch.distance <= reach
    return Touch(touch.point[near], touch.at[near], touch.triangle[near], touch.distance[near])
