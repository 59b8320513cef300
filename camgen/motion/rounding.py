"""The path that a controller runs if one motion continues into the next one without a stop.

RAPID leaves the path at the edge of the zone of a corner, whatever the turn, and runs a parabola
(manual, `zonedata`). Other controllers begin the next motion while the one before ends. The curve
of RAPID between a line and an arc is not documented, and neither is whether other controllers brake
and accelerate equally hard or equally long. So two curves are computed for each, and the one that
leaves the path farther counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camgen.geometry.arcs import Spans
from camgen.geometry.vectors import add_coordinates, cross, measure_lengths, multiply_rows
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO

#: Points of a rounded path. Their number is odd, so that one lies in the middle.
_POINTS = 33
#: Tangents whose lines meet at a smaller sine of their angle have no parabola between them.
_PARALLEL = 1e-6


class Transitions(NamedTuple):
    """K transitions from one motion into the next.

    first, second: K motions before and after the transitions.
    blend: (K,) distance, mm, before the end of the first motion at which rounding begins.
    fast: (K,) the higher of the two speeds, mm/s.
    """

    first: Spans
    second: Spans
    blend: FloatArray
    fast: FloatArray


def measure_rounding(transitions: Transitions, dynamics: Dynamics) -> FloatArray:
    """(K,) distance, mm, between the programmed and the executed path where it is largest.

    dynamics: dynamics of the controller.
    """
    if dynamics.corner == "junction" or not len(transitions.blend):
        return np.zeros(len(transitions.blend))
    if dynamics.corner == "arc":
        # LinuxCNC keeps to the distance that `G64 P` states.
        return np.full(len(transitions.blend), dynamics.deviation)
    distances = [_measure_deviation(transitions, path) for path in round_off(transitions, dynamics)]
    return np.asarray(np.max(distances, axis=0))


def round_off(transitions: Transitions, dynamics: Dynamics) -> list[FloatArray]:
    """The executed paths of transitions by each model of the controller, (K, P, 3) mm each.

    A path leads from the place where the controller leaves the first motion to the place where it
    is on the second one.
    """
    reach = _find_reach(transitions, dynamics)
    if dynamics.corner == "overlap":
        return [_overlap(transitions, reach, dynamics.acceleration), _mix(transitions, *reach)]
    return [_mix(transitions, *reach), _bend(transitions, *reach)]


class RoundedCorners(NamedTuple):
    """The executed paths of K transitions.

    before: (K,) length, mm, of the first motion that is not run.
    after: (K,) length, mm, of the second motion that is not run.
    path: (K, P, 3) points of the path that is run instead, mm.
    deviation: (K,) distance, mm, of the path from the programmed one.
    """

    before: FloatArray
    after: FloatArray
    path: FloatArray
    deviation: FloatArray


def trace_corners(transitions: Transitions, dynamics: Dynamics) -> RoundedCorners:
    """One executed path of each transition; in zones the model that leaves the path farther."""
    before, after = _find_reach(transitions, dynamics)
    path = _mix(transitions, before, after)
    deviation = _measure_deviation(transitions, path)
    if dynamics.corner == "zone":
        bent = _bend(transitions, before, after)
        bent_deviation = _measure_deviation(transitions, bent)
        path = np.where((bent_deviation > deviation)[:, None, None], bent, path)
        deviation = np.maximum(bent_deviation, deviation)
    return RoundedCorners(before, after, path, deviation)


def _find_reach(transitions: Transitions, dynamics: Dynamics) -> tuple[FloatArray, FloatArray]:
    """(K,) lengths, mm, of the pieces of both motions within which the controller leaves them."""
    first, second = transitions.first, transitions.second
    if dynamics.corner == "overlap":
        brake = transitions.fast**2 / (2 * dynamics.acceleration)
        return np.minimum(brake, first.length / 2), np.minimum(brake, second.length / 2)
    # A controller cuts a zone at half of the shorter neighbour.
    room = np.minimum(first.length, second.length) / 2
    before, after = (_reach(motion, transitions.blend) for motion in (first, second))
    return np.minimum(before, room), np.minimum(after, room)


def _reach(motion: Spans, blend: FloatArray) -> FloatArray:
    """(K,) length, mm, of the piece of a motion within the blend of its end."""
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.arcsin(np.clip(blend / (2 * motion.radius), 0.0, 1.0))
    return np.where(motion.curved, 2 * motion.radius * half, blend)


def _mix(transitions: Transitions, before: FloatArray, after: FloatArray) -> FloatArray:
    """Both motions at once: the first with even deceleration, the second with even acceleration."""
    fraction = np.linspace(0.0, 1.0, _POINTS)
    return _add(transitions, (1 - fraction) ** 2 * before[:, None], fraction**2 * after[:, None])


def _overlap(
    transitions: Transitions, reach: tuple[FloatArray, FloatArray], acceleration: float
) -> FloatArray:
    """The second motion begins when the first one begins to brake, as hard as that brakes.

    reach: (K,) lengths, mm, on which the motions brake and accelerate.
    """
    before, after = reach
    seconds = [np.sqrt(2 * length / acceleration)[:, None] for length in (before, after)]
    time = np.linspace(0.0, 1.0, _POINTS) * np.maximum(*seconds)
    left = acceleration / 2 * np.maximum(seconds[0] - time, 0.0) ** 2
    ramp = np.minimum(time, seconds[1])
    return _add(transitions, left, acceleration * ramp * (time - ramp / 2))


def _add(transitions: Transitions, left: FloatArray, run: FloatArray) -> FloatArray:
    """(K, P, 3) the sum of two motions.

    left: (K, P) mm of the first motion that are not run yet.
    run: (K, P) mm of the second motion that are run.
    """
    first, second = transitions.first, transitions.second
    rows = np.repeat(np.arange(len(left)), left.shape[1])
    along = [
        1 - left / np.maximum(first.length, NONZERO)[:, None],
        np.minimum(run / np.maximum(second.length, NONZERO)[:, None], 1.0),
    ]
    places = [
        motion.point(fraction.ravel(), rows).reshape(*left.shape, 3)
        for motion, fraction in zip((first, second), along, strict=True)
    ]
    return np.asarray(places[0] + places[1] - first.end[:, None])


def _bend(transitions: Transitions, before: FloatArray, after: FloatArray) -> FloatArray:
    """A parabola with the tangents of both motions, (K, P, 3) mm.

    Its middle control point is where the tangents meet. Where they do not meet ahead, a cubic of
    the same lengths stands for it.
    """
    start, start_tangent = _tangents_at(transitions.first, before, end=True)
    end, end_tangent = _tangents_at(transitions.second, after, end=False)
    chord, cosine = end - start, multiply_rows(start_tangent, end_tangent)
    square = np.maximum(1 - cosine**2, NONZERO)
    ahead = (
        multiply_rows(chord, start_tangent) - cosine * multiply_rows(chord, end_tangent)
    ) / square
    back = (
        multiply_rows(chord, end_tangent) - cosine * multiply_rows(chord, start_tangent)
    ) / square
    longest = 2 * np.maximum(before, after)
    meet = (
        (measure_lengths(cross(start_tangent, end_tangent)) > _PARALLEL) & (ahead > 0) & (back > 0)
    )
    meet &= (ahead < longest) & (back < longest)
    start_handle = np.where(meet, ahead, before) * 2 / 3
    end_handle = np.where(meet, back, after) * 2 / 3
    fraction = np.linspace(0.0, 1.0, _POINTS)[:, None]
    second = start + start_handle[:, None] * start_tangent
    points = (start, second, end - end_handle[:, None] * end_tangent, end)
    weights = (
        (1 - fraction) ** 3,
        3 * fraction * (1 - fraction) ** 2,
        3 * fraction**2 * (1 - fraction),
        fraction**3,
    )
    return np.asarray(sum(w * point[:, None] for w, point in zip(weights, points, strict=True)))


def _tangents_at(motion: Spans, length: FloatArray, *, end: bool) -> tuple[FloatArray, FloatArray]:
    """Points (K, 3), mm, and directions of travel (K, 3) at a length from an end of motions."""
    fraction = length / np.maximum(motion.length, NONZERO)
    fraction = 1 - fraction if end else fraction
    angle = ((fraction - 0.5) * motion.sweep)[:, None]
    turned = np.cos(angle) * motion.along - np.sin(angle) * motion.towards
    return motion.point(fraction), np.where(motion.curved[:, None], turned, motion.along)


def _measure_deviation(transitions: Transitions, path: FloatArray) -> FloatArray:
    """(K,) distance, mm, between executed paths (K, P, 3) and the programmed ones."""
    nearest = np.minimum(_distance(transitions.first, path), _distance(transitions.second, path))
    return np.asarray(np.maximum(nearest.max(axis=1), _measure_pass(path, transitions.first.end)))


def _measure_pass(path: FloatArray, corner: FloatArray) -> FloatArray:
    """(K,) distance, mm, at which polylines (K, P, 3) pass points (K, 3)."""
    start, step = path[:, :-1], np.diff(path, axis=1)
    arm = corner[:, None] - start
    fraction = add_coordinates(arm * step) / np.maximum(add_coordinates(step * step), NONZERO)
    offset = arm - np.clip(fraction, 0.0, 1.0)[..., None] * step
    return np.asarray(measure_lengths(offset).min(axis=1))


def _distance(motion: Spans, points: FloatArray) -> FloatArray:
    """(K, P) distance, mm, of points (K, P, 3) from motions."""
    result = _distance_to_lines(motion, points)
    arcs = np.flatnonzero(motion.curved)
    if len(arcs):
        result[arcs] = _distance_to_arcs(motion.pick(arcs), points[arcs])
    return result


def _distance_to_lines(motion: Spans, points: FloatArray) -> FloatArray:
    arm = points - motion.start[:, None]
    along = np.clip(add_coordinates(arm * motion.along[:, None]), 0.0, motion.length[:, None])
    return measure_lengths(arm - along[..., None] * motion.along[:, None])


def _distance_to_arcs(arcs: Spans, points: FloatArray) -> FloatArray:
    arm = points - (arcs.via - arcs.radius[:, None] * arcs.towards)[:, None]
    x = add_coordinates(arm * arcs.towards[:, None])
    y = add_coordinates(arm * arcs.along[:, None])
    above = np.maximum(add_coordinates(arm * arm) - x**2 - y**2, 0.0)
    across = np.sqrt((np.hypot(x, y) - arcs.radius[:, None]) ** 2 + above)
    to_start, to_end = (
        measure_lengths(points - arcs.start[:, None]),
        measure_lengths(points - arcs.end[:, None]),
    )
    within = np.abs(np.arctan2(y, x)) <= arcs.sweep[:, None] / 2
    return np.asarray(np.where(within, across, np.minimum(to_start, to_end)))
