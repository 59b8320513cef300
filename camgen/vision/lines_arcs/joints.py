"""Finds where neighbouring lines and arcs meet: at corners, or tangentially.

The blur of the picture rounds a sharp corner. So the points near a corner do not show where it is;
it is computed as the crossing of the two curves.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.rings import ComplexArray, Rings
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import Curves
from camgen.vision.lines_arcs.runs import Runs, wrap_rows

#: rad: angles by which a sharp corner turns.
TURNS = np.radians([0, 10, 20, 30, 45, 60, 75, 90, 105, 120, 135, 150, 160, 170])
#: Distances at which the half-way threshold passes these corners in the picture, in sigmas of the
#: blur: where a Gaussian has half its weight in a wedge of this angle. Computed by quadrature.
PASSES = np.array(
    [0, 0.07, 0.141, 0.213, 0.328, 0.454, 0.599, 0.771, 0.988, 1.285, 1.741, 2.604, 3.884, 7.739]
)
#: Distance from the other edge of a corner, in sigmas of the blur, at which the picture of an edge
#: is straight within 0.02 px.
_CORNER_REACH = 2.5
#: px: a rounding below the first is lost in the noise, one above the second is visible.
_VISIBLE_ROUNDING = (0.05, 0.2)
#: A run is only the rounding of a corner if it passes the vertex at up to this many times the
#: expected distance,
_ROUNDING_FACTOR = 1.5
#: and up to this many px more.
_ROUNDING_PX = 0.25
#: rad: a joint that turns by less may be tangential.
_MAX_TANGENTIAL_TURN = np.radians(30.0)
#: Standard deviations of the noise within which curves touch,
_SIGMAS = 4.0
#: and px more.
_GAP_PX = 0.03
#: px: distance from the ends of the runs at which their curves may cross or touch.
_NEAR_PX = 4.0
#: A tangential joint lies within this fraction of the shorter of its two runs.
_JOINT_FRACTION = 0.25
#: px: smallest height of a wall, beside the noise.
_MIN_WALL_PX = 0.5
#: Points that a short line and a short arc keep.
_MIN_POINTS = (3, 4)


class CornerJoints(Struct, frozen=True, eq=False):
    """The joints of P runs: each run's end with the beginning of the run after it.

    vertex: (P,) place of the joint, px.
    turn: (P,) change of direction, rad, signed.
    smooth: (P,) the curves touch within the noise, and the joint is tangential.
    zone: (P,) distance from the vertex up to which the blur has rounded the corner, px.
    """

    vertex: ComplexArray
    turn: FloatArray
    smooth: BoolArray
    zone: FloatArray


def orient(curves: Curves, runs: Runs, loops: Rings, points: ComplexArray) -> Curves:
    """Choose the sign of each curve so that 1j times its gradient points along its run."""
    half = runs.count // 2
    middle = _find_rows(runs, loops, half)
    before = _find_rows(runs, loops, np.maximum(half - 1, 0))
    after = _find_rows(runs, loops, half + 1)
    direction = 1j * _compute_gradient(curves, points[middle])
    is_opposite = ((points[after] - points[before]) * direction.conj()).real < 0
    form = np.where(is_opposite[:, None], -curves.form, curves.form)
    return Curves(curves.origin, form, curves.sse)


def find_joints(
    curves: Curves,
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    sigma: FloatArray,
    blur: FloatArray,
) -> CornerJoints:
    """Find the joint of each oriented curve with the one that follows.

    sigma: (L,) noise of the points of each loop, px.
    blur: (L,) sigma of the blur of each loop, px.
    """
    after = runs.following()
    end = points[_find_rows(runs, loops, runs.count)]
    near = (points[_find_rows(runs, loops, runs.count - 1)] + end) / 2
    following = curves.take(after)
    vertex, crossing = find_crossings(curves, following, near)
    run_blur = blur[runs.loop]
    turn = _compute_turn(curves, following, vertex)
    crossing &= np.abs(vertex - near) < _NEAR_PX + compute_zone(turn, run_blur)
    start = np.where(crossing, vertex, near)
    smooth, touch = _find_touching(
        curves, following, start, sigma[runs.loop], runs.count, runs.count[after]
    )
    smooth &= ~crossing | (np.abs(turn) < _MAX_TANGENTIAL_TURN)
    between = _find_middle(curves, following, near)
    vertex = np.where(smooth, touch, np.where(crossing, vertex, between))
    turn = _compute_turn(curves, following, vertex)
    zone = np.where(smooth, 0.0, compute_zone(turn, run_blur))
    return CornerJoints(vertex, turn, smooth, zone)


def find_crossings(
    first: Curves, second: Curves, near: ComplexArray
) -> tuple[ComplexArray, BoolArray]:
    """Find the crossing (P,) of each pair of curves next to `near` (P,), by Newton's method.

    Returns the crossings, px, and whether there is one, (P,).
    """
    point = near.copy()
    miss = np.full(len(near), np.inf)
    # In one array, as the calls take longer than the sums.
    curves = Curves(
        np.concatenate([first.origin, second.origin]),
        np.concatenate([first.form, second.form]),
        np.concatenate([first.sse, second.sse]),
    )
    for _ in range(12):
        points = np.concatenate([point, point])
        f, g = curves.distances(points).reshape(2, -1)
        miss = np.hypot(f, g)
        a, b = compute_normals(curves, points).reshape(2, -1)
        cross = (a.conj() * b).imag
        cross = np.where(np.abs(cross) < 1e-6, 1e-6, cross)
        step = 1j * (f * b - g * a) / cross
        size = np.abs(step)
        # Steps of more than 20 px are shortened.
        point = point + step * np.minimum(1.0, 20.0 / np.maximum(size, 1e-12))
    return point, miss < 1e-6


def find_small_corners(
    curves: Curves, runs: Runs, loops: Rings, points: ComplexArray, blur: FloatArray
) -> BoolArray:
    """Find the runs that are only the rounded picture of a corner between their neighbours.

    blur: (L,) sigma of the blur of each loop, px.

    Returns a mask (P,) of the runs.
    """
    after, before = runs.following(), runs.before()
    previous, following = curves.take(before), curves.take(after)
    middle = points[_find_rows(runs, loops, runs.count // 2)]
    vertex, crossing = find_crossings(previous, following, middle)
    run_blur = blur[runs.loop]
    turn = _compute_turn(previous, following, vertex)
    zone = compute_zone(turn, run_blur)
    first = points[_find_rows(runs, loops, np.zeros_like(after))]
    last = points[_find_rows(runs, loops, runs.count - 1)]
    reach = np.maximum(np.abs(first - vertex), np.abs(last - vertex))
    inwards = 1j * np.sign(turn) * compute_tangents(previous, vertex) * np.exp(0.5j * turn)
    # Two points of each neighbour count too: the one nearest to the vertex may belong to it.
    wider = wrap_rows(Runs(runs.first - 2, runs.count + 4, runs.loop), loops)
    depth = _measure_depths(wider, loops, points, vertex, inwards)
    expected = np.interp(np.abs(turn), TURNS, PASSES) * run_blur
    is_rounding = (depth > -0.5) & (depth < _ROUNDING_FACTOR * expected + _ROUNDING_PX)
    return np.asarray(crossing & (before != after) & (reach < 1.5 * zone + 2.0) & is_rounding)


def find_walls(
    curves: Curves, runs: Runs, loops: Rings, points: ComplexArray, sigma: FloatArray
) -> BoolArray:
    """Find the runs whose neighbours pass on both sides of their middle: walls of a shallow step.

    sigma: (L,) noise of the points of each loop, px.

    Returns a mask (P,) of the runs.
    """
    first = points[_find_rows(runs, loops, 0 * runs.count)]
    middle = (first + points[_find_rows(runs, loops, runs.count - 1)]) / 2
    before = curves.take(runs.before()).distances(middle)
    after = curves.take(runs.following()).distances(middle)
    min_height = _SIGMAS * sigma[runs.loop] + _MIN_WALL_PX
    return np.asarray((before * after < 0) & (np.abs(before - after) > min_height))


def _measure_depths(
    runs: Runs, loops: Rings, points: ComplexArray, vertex: ComplexArray, inwards: ComplexArray
) -> FloatArray:
    """Distance (P,) at which each run passes its vertex in the direction `inwards` (P,), px.

    It is the lowest point of a parabola through the lowest point of the run and its neighbours.
    """
    rows, begin = runs.rows(loops)
    owner = list_owners(runs.count)
    local = (points[rows] - vertex[owner]) * inwards[owner].conj()
    lowest = np.minimum.reduceat(local.real, begin)
    place = np.full(len(runs), -1)
    is_lowest = np.flatnonzero(local.real <= lowest[owner])
    place[owner[is_lowest]] = is_lowest - begin[owner[is_lowest]]
    three = np.stack(
        [(points[_find_rows(runs, loops, place + k)] - vertex) * inwards.conj() for k in (-1, 0, 1)]
    )
    return find_valley(three.imag, three.real)


def find_valley(x: FloatArray, y: FloatArray) -> FloatArray:
    """The lowest value (P,) of parabolas through three points each, `x` and `y` (3, P).

    The lowest of the three points if the parabola has no minimum, or one far below the points.
    """
    with np.errstate(all="ignore"):
        first, second = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
        bend = (second - first) / (x[2] - x[0])
        slope = first + bend * (x[1] - x[0])
        minimum = y[1] - slope * slope / (4 * bend)
    lowest_point = y.min(axis=0)
    is_usable = np.isfinite(minimum) & (bend > 0) & (minimum > lowest_point - 0.5)
    return np.asarray(np.where(is_usable, minimum, lowest_point))


def select_clear(
    corners: CornerJoints, curves: Curves, runs: Runs, loops: Rings, points: ComplexArray
) -> BoolArray:
    """Select the points (N,) of the loops that no corner has rounded.

    A short run keeps a few points in its middle in any case, as they are rounded least.
    """
    before = runs.before()
    rows, begin = runs.rows(loops)
    owner = list_owners(runs.count)
    z = points[rows]
    to_end = np.abs(z - corners.vertex[owner]) / np.maximum(corners.zone[owner], 1e-9)
    start, start_zone = corners.vertex[before][owner], corners.zone[before][owner]
    to_start = np.abs(z - start) / np.maximum(start_zone, 1e-9)
    keep = np.zeros(len(points), dtype=np.bool_)
    is_clear = np.minimum(to_end, to_start) >= 1.0
    clear_count = np.add.reduceat(is_clear.astype(np.int64), begin)
    min_count = np.where(curves.curvature == 0, *_MIN_POINTS)
    place = number_rows(runs.count)
    margin = np.maximum((runs.count - min_count) // 2, 0)[owner]
    is_middle = (place >= margin) & (place < runs.count[owner] - margin)
    keep[rows] = is_clear | ((clear_count < min_count)[owner] & is_middle)
    return keep


def _find_rows(runs: Runs, loops: Rings, place: IntArray) -> IntArray:
    """The row (P,) of the point at `place` (P,) of each run, counted from its first point."""
    base = loops.first[runs.loop]
    return np.asarray(base + (runs.first - base + place) % loops.count[runs.loop])


def _compute_gradient(curves: Curves, points: ComplexArray) -> ComplexArray:
    """Gradient (P,) of each curve's form at a point, as a complex number."""
    local = points - curves.origin
    return np.asarray(2 * curves.form[:, 0] * local + curves.form[:, 1] + 1j * curves.form[:, 2])


def compute_normals(curves: Curves, points: ComplexArray) -> ComplexArray:
    """Unit vectors (P,) at points (P,) in which the signed distance from the curves grows."""
    gradient = _compute_gradient(curves, points)
    return np.asarray(gradient / np.maximum(np.abs(gradient), 1e-9))


def compute_tangents(curves: Curves, points: ComplexArray) -> ComplexArray:
    """Unit vectors (P,) along oriented curves at points (P,) on them, as their runs go."""
    return 1j * compute_normals(curves, points)


def _compute_turn(first: Curves, second: Curves, vertex: ComplexArray) -> FloatArray:
    """Angle (P,) by which the direction changes from the first to the second curve, rad."""
    return np.asarray(
        np.angle(compute_tangents(second, vertex) * compute_tangents(first, vertex).conj())
    )


def compute_zone(turn: FloatArray, blur: FloatArray) -> FloatArray:
    """Distance from the vertex (P,) up to which the blur rounds a corner, px.

    There the other edge is nearer than `_CORNER_REACH` sigmas. It is less, down to 0, if the
    rounding is lost in the noise.
    """
    size = np.abs(turn)
    sine = np.where(size > np.pi / 2, np.maximum(np.sin(size), 0.25), 1.0)
    rounding = np.interp(size, TURNS, PASSES) * blur
    visible = np.interp(rounding, _VISIBLE_ROUNDING, (0.0, 1.0))
    return np.asarray(_CORNER_REACH * blur / sine * visible)


def _find_middle(first: Curves, second: Curves, near: ComplexArray) -> ComplexArray:
    """The middle (P,) between the feet of `near` (P,) on both curves."""
    first_foot = near - first.distances(near) * compute_normals(first, near)
    second_foot = near - second.distances(near) * compute_normals(second, near)
    return (first_foot + second_foot) / 2


def _find_touching(
    first: Curves,
    second: Curves,
    near: ComplexArray,
    sigma: FloatArray,
    first_count: IntArray,
    second_count: IntArray,
) -> tuple[BoolArray, ComplexArray]:
    """Find the points close to `near` (P,) at which two curves touch within their noise.

    sigma: (P,) noise, px.
    first_count, second_count: (P,) number of points of each curve.

    Returns whether the curves touch (P,), and where (P,), px.
    """
    gap = first.distances(near) - second.distances(near)
    bend = second.curvature - first.curvature
    is_bent = np.abs(bend) > 1e-5
    safe_bend = np.where(is_bent, bend, 1.0)
    # Along the tangent the gap is gap - theta x - bend x^2 / 2. The curves touch where it is least.
    theta = _compute_turn(first, second, near)
    x = np.where(is_bent, -theta / safe_bend, 0.0)
    least_gap = gap - theta * x - bend * x * x / 2
    allowed = _SIGMAS * sigma * np.sqrt(4.0 / first_count + 4.0 / second_count) + _GAP_PX
    # A line and a curve that is nearly one touch anywhere. The joint is not farther away than the
    # points that determine it.
    reach = _NEAR_PX + 2 * np.sqrt(2 * allowed / np.maximum(np.abs(bend), 1e-5))
    shorter = np.minimum(first_count, second_count)
    reach = np.minimum(reach, _NEAR_PX + _JOINT_FRACTION * shorter)
    touch = _find_middle(first, second, near + x * compute_tangents(first, near))
    return is_bent & (np.abs(least_gap) < allowed) & (np.abs(x) < reach), touch
