"""The exact refinement: robust point-to-plane registration (ICP) with the closest triangles.

Its costs say how well a pose fits, with regard to what the scanner can see.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import add_coordinates, cross, measure_lengths, multiply_rows
from camgen.localize.coarse import make_turns
from camgen.localize.model import (
    Model,
    Touch,
    TouchPairs,
    find_candidates,
    find_touched,
    find_touched_within,
    narrow_candidates,
)
from camgen.localize.sight import find_hidden
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Pose, frozen, to_vec3
from camgen.model.sequences import take_rows
from camgen.model.tolerance import SIGMAS_OF_MEDIAN

#: Tukey's biweight: points beyond this many standard deviations have no weight. It is 95 %
#: efficient for normal noise.
TUKEY = 4.685
#: Maximum number of times that the gate closes, and of steps with each gate.
_ROUNDS, _STEPS = 8, 12
#: Fewer points than this do not hold a pose, which has six unknowns.
_LEAST_POINTS = 7
#: The candidates are found again if a pose moves the points by more than this part of the reach.
_SLACK_SHARE = 0.2
#: Candidates are searched with this many times the slack, so that they hold for later rounds.
_WIDER = 2.0
#: A pose is at rest if a step moves it by less than this part of the model's size. Points that
#: change their triangle keep it from coming to a complete rest.
_STILL_SHARE = 5e-7
#: A pose is worse than another one if the sum of its losses is larger by this many standard
#: deviations, and by this number of points.
_DECISIVE, _FEW_POINTS = 4.0, 6.0
#: A face whose normal has less than this cosine with the way up faces the bench.
_DOWN = -0.5


class ScanFit(Struct, frozen=True, eq=False):
    """A refined pose of the scan in the model's frame, mm.

    rotation: (3, 3), model_from_scan.
    origin: (3,), model_from_scan, mm.
    noise: robust standard deviation of the residuals, mm.
    rms: rms residual of the points that have a weight, mm.
    used: indices of these points.
    information: (6, 6), information matrix of a turn (rad, times `arm`) about `centre` and a shift.
    centre: (3,), weighted mean of the points, mm.
    arm: rms distance of the points from `centre`, mm.
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
        """`points` (N, 3) of the scan in the model's frame."""
        return np.asarray(points @ self.rotation.T + self.origin)

    def invert(self, middle: FloatArray) -> Pose:
        """base_from_work, for points that are relative to `middle` (3,) of the scan, mm."""
        return Pose(frozen(self.rotation.T), to_vec3(middle - self.rotation.T @ self.origin))


#: model_from_scan: rotation (3, 3) and origin (3,), mm.
_Placement = tuple[FloatArray, FloatArray]
#: Places (N, 3) for which the closest triangles are wanted, mm. The second is the reach and the
#: slack (see `find_candidates`) if the candidates have to be found again, otherwise 0 and 0.
_Question = tuple[FloatArray, tuple[float, float]]


def refine(model: Model, points: FloatArray, start: _Placement, gate: float) -> ScanFit:
    """The pose near `start` that puts `points` (N, 3) onto the model.

    gate: mm, points farther from the model have no weight. It closes as the residuals shrink.

    If fewer than seven points are within the gate, the start is returned, with infinite noise.
    """
    return refine_all(model, points, [start], gate)[0]


def refine_all(
    model: Model, points: FloatArray, starts: list[_Placement], gate: float
) -> list[ScanFit]:
    """Each of `starts`, refined as by `refine`.

    The poses are refined side by side, so that the closest triangles are found for many of them in
    one call. A call takes about as long as the answer for some hundred points.
    """
    refinements = [_refine_steps(model, points, start, gate) for start in starts]
    questions: dict[int, _Question] = {k: next(each) for k, each in enumerate(refinements)}
    searches: dict[int, tuple[_Question, TouchPairs]] = {}
    pairs: dict[int, TouchPairs] = {}
    fits: dict[int, ScanFit] = {}
    while questions:
        # Poses that need no new candidates go first, until all others wait for theirs.
        moving = [k for k, (_, limits) in questions.items() if not any(limits)]
        if not moving:
            moving = list(questions)
            new = {
                k: (at, (reach, _WIDER * slack))
                for k, (at, (reach, slack)) in questions.items()
                if k not in searches or not _holds(searches[k][0], questions[k])
            }
            answers = _find_all_candidates(model, list(new.values())) if new else []
            searches.update(zip(new, zip(new.values(), answers, strict=True), strict=True))
            for k, (at, limits) in questions.items():
                pairs[k] = narrow_candidates(model, searches[k][1], at, *limits)
        places = [questions[k][0] for k in moving]
        touches = _find_all_touched(model, take_rows(pairs, moving), places)
        for k, touch in zip(moving, touches, strict=True):
            try:
                questions[k] = refinements[k].send(touch)
            except StopIteration as end:
                del questions[k]
                fits[k] = end.value
    return list(map(fits.__getitem__, range(len(starts))))


def _holds(searched: _Question, question: _Question) -> bool:
    """Whether the candidates for `searched` hold those for another question."""
    (before, (old_reach, old_slack)), (places, (reach, slack)) = searched, question
    moved = float(measure_lengths(places - before).max())
    return reach <= old_reach and moved + slack <= old_slack


def _find_all_candidates(model: Model, questions: list[_Question]) -> list[TouchPairs]:
    """The candidates for each question. All questions have the same number of places."""
    count, limits = len(questions[0][0]), np.array([limits for _, limits in questions], np.float64)
    places = np.concatenate([places for places, _ in questions])
    reach, slack = np.repeat(limits, count, axis=0).T
    pairs = find_candidates(model, places, reach, slack)
    ends = np.searchsorted(pairs.point, count * np.arange(1, len(questions)))
    points, triangles = np.split(pairs.point % count, ends), np.split(pairs.triangle, ends)
    return list(map(TouchPairs, points, triangles))


def _find_all_touched(
    model: Model, pairs: list[TouchPairs], places: list[FloatArray]
) -> list[Touch]:
    """The closest of the candidates for each set of places. All sets have the same size."""
    count = len(places[0])
    all_pairs = TouchPairs(
        np.concatenate([each.point + count * k for k, each in enumerate(pairs)]),
        np.concatenate([each.triangle for each in pairs]),
    )
    touch = find_touched(model, all_pairs, np.concatenate(places))
    ends = np.searchsorted(touch.point, count * np.arange(1, len(places)))
    points, at = np.split(touch.point % count, ends), np.split(touch.at, ends)
    triangles, distances = np.split(touch.triangle, ends), np.split(touch.distance, ends)
    return list(map(Touch, points, at, triangles, distances))


def _refine_steps(
    model: Model, points: FloatArray, start: _Placement, gate: float
) -> Generator[_Question, Touch, ScanFit]:
    """Refines one pose. It yields its questions, gets the answers, and returns the fit."""
    placement = start
    floor, still = 1e-6 * model.size, _STILL_SHARE * model.size
    noise = least = gate / TUKEY
    nothing, zero = np.zeros(0, dtype=np.int64), np.zeros(3)
    fit = ScanFit(*start, np.inf, np.inf, nothing, np.zeros((6, 6)), zero, 1.0)
    for _ in range(_ROUNDS):
        reach = max(TUKEY * noise, 10 * floor)
        slack = max(_SLACK_SHARE * reach, floor)
        limits = (reach, slack)
        moved = 0.0
        for _ in range(_STEPS):
            places = points @ placement[0].T + placement[1]
            touch = yield places, limits
            limits = (0.0, 0.0)
            near = touch.distance <= reach
            if np.count_nonzero(near) < _LEAST_POINTS:
                return fit
            spread = SIGMAS_OF_MEDIAN * float(np.median(touch.distance[near]))
            noise = max(min(spread, gate / TUKEY), least, floor)
            fit, placement, step = _compute_step(model, touch, places, noise, placement)
            moved += 2 * step
            if step < still or moved > slack:
                break
        settled = step < still and TUKEY * noise > 0.8 * reach and noise > least
        # The gate closes by halves at most: few points beyond the rims hold a flat part sideways.
        least *= 0.5
        if settled or (step < still and reach <= 10 * floor):
            break
    return fit


def draw_pose(model: Model, points: FloatArray, start: ScanFit, reach: float) -> ScanFit:
    """The pose near `start` that puts `points` (N, 3) onto the model, with a gate that stays open.

    All points within `reach` (mm) of the model keep their weight, however near most of them are.
    That is right for points without noise of which only a few hold a motion.
    """
    placement, fit = (start.rotation, start.origin), start
    for _ in range(_STEPS):
        places = points @ placement[0].T + placement[1]
        touch = find_touched(model, find_candidates(model, places, reach, 0.0), places)
        if len(touch.point) < _LEAST_POINTS:
            break
        fit, placement, step = _compute_step(model, touch, places, reach / TUKEY, placement)
        if step < _STILL_SHARE * model.size:
            break
    return fit


def _compute_step(
    model: Model, touch: Touch, places: FloatArray, noise: float, placement: _Placement
) -> tuple[ScanFit, _Placement, float]:
    """One Gauss-Newton step: the fit before it, the placement after it, and its length, mm.

    The length counts the turn at the distance `arm`.
    """
    ratio = (touch.distance / (TUKEY * noise)) ** 2
    weight = np.where(ratio < 1, (1 - ratio) ** 2, 0.0)
    counts = weight > 0
    total = float(weight.sum())
    places = places[touch.point]
    normals, residuals = _compute_pulls(model, touch, places)
    centre = (weight[:, None] * places).sum(axis=0) / total
    arms = places - centre
    arm = float(np.sqrt((weight * add_coordinates(arms * arms)).sum() / total))
    rows = np.concatenate([cross(arms, normals) / arm, normals], axis=1)
    weighted = rows * weight[:, None]
    matrix = weighted.T @ rows / total
    step = -np.linalg.solve(matrix + 1e-9 * np.eye(6), weighted.T @ residuals / total)
    rms = float(np.sqrt((residuals[counts] ** 2).mean()))
    rotation, origin = placement
    fit = ScanFit(rotation, origin, noise, rms, touch.point[counts], matrix, centre, arm)
    turn, shift = make_turns(step[None, :3] / arm)[0], step[3:]
    moved = turn @ rotation, turn @ (origin - centre) + centre + shift
    return fit, moved, float(np.linalg.norm(shift)) + arm * float(np.linalg.norm(turn - np.eye(3)))


def _compute_pulls(model: Model, touch: Touch, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit directions (K, 3) away from the model, and signed distances (K,), mm, of `places`.

    Over a face the direction is its normal. Beyond an edge it comes from the closest point: places
    beyond the rim of a face show where it ends. They alone hold a box sideways if it is seen from
    above.
    """
    offsets, normals = places - touch.at, model.normals[touch.triangle]
    distances = multiply_rows(offsets, normals)
    beyond = np.flatnonzero(touch.distance > np.abs(distances) * (1 + 1e-6) + 1e-9 * model.size)
    normals[beyond] = offsets[beyond] / touch.distance[beyond, None]
    distances[beyond] = touch.distance[beyond]
    return normals, distances


# How well a pose fits.


class View(Struct, frozen=True, eq=False):
    """Points of a scan, and the place of the scanner as far as it is known.

    points: (N, 3), mm.
    eye: (3,), place of the scanner, mm; None if it is not known.
    up: (3,), unit, from the bench to the part and the scanner; None without a bench.
    """

    points: FloatArray
    eye: FloatArray | None = None
    up: FloatArray | None = None

    def first(self, count: int) -> View:
        """The view with its first `count` points."""
        return View(self.points[:count], self.eye, self.up)


def compute_losses(model: Model, view: View, fit: ScanFit, gate: float) -> FloatArray:
    """The loss of each point of a view, 0..1 (N,): its squared distance in units of `gate` (mm).

    It is 1 for points farther than the gate, and on places that the scanner cannot have seen.
    """
    touch = find_touched_within(model, fit.apply(view.points), gate)
    seen = ~find_unseen(model, touch, view, fit, gate)
    loss = np.ones(len(view.points))
    loss[touch.point[seen]] = (touch.distance[seen] / gate) ** 2
    return loss


def compute_cost(model: Model, view: View, fit: ScanFit, gate: float) -> float:
    """The mean of the losses, 0..1."""
    return float(compute_losses(model, view, fit, gate).mean())


def is_worse(losses: FloatArray, best: FloatArray) -> bool:
    """Whether `losses` (N,) exceed the losses `best` of another pose by more than chance."""
    excess = losses - best
    deviation = float(np.sqrt((excess * excess).sum()))
    return float(excess.sum()) > max(_DECISIVE * deviation, _FEW_POINTS)


def find_unseen(model: Model, touch: Touch, view: View, fit: ScanFit, gap: float) -> BoolArray:
    """Whether the scanner cannot have seen each of the touched places: (N,).

    The model hides them by more than `gap` mm, or they face the bench.
    """
    if view.eye is not None:
        # The rays start on the model. Noise puts points of a steep face far below the surface.
        return find_hidden(model, touch.at, fit.apply(view.eye), gap)
    if view.up is not None:
        return np.asarray(model.normals[touch.triangle] @ (fit.rotation @ view.up) < _DOWN)
    return np.zeros(len(touch.point), dtype=bool)


def compute_costs(
    model: Model, view: View, fits: list[ScanFit], gate: float, same: float = 0.0
) -> list[float]:
    """The cost of each fit.

    Regard to sight can only raise a cost. So it is taken only for fits that may be the best one,
    or worse by at most `same`.
    """
    if not fits:
        return []
    count = len(view.points)
    places = np.concatenate([fit.apply(view.points) for fit in fits])
    touch = find_touched_within(model, places, gate)
    ends = np.searchsorted(touch.point, count * np.arange(1, len(fits)))
    groups = np.split(touch.distance, ends)
    results = [1 - (len(near) - float(((near / gate) ** 2).sum())) / count for near in groups]
    if view.eye is None and view.up is None:
        return results
    best = np.inf
    for i in sorted(range(len(fits)), key=results.__getitem__):
        if results[i] > best + same:
            break
        results[i] = compute_cost(model, view, fits[i], gate)
        best = min(best, results[i])
    return results
