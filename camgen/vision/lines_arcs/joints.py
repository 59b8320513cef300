"""Where neighbouring lines and arcs meet: at a corner that the picture has rounded, or tangentially."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import owners, ramp
from camgen.geometry.rings import ComplexArray, Rings
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import BoolArray, Curves
from camgen.vision.lines_arcs.runs import Runs, within

#: Turn of a sharp corner, and how far from it the half-way level of its picture passes, in units of the blur:
#: where a Gaussian of sigma 1 has half its weight in a wedge of that shape. Computed by quadrature.
TURNS = np.radians([0, 10, 20, 30, 45, 60, 75, 90, 105, 120, 135, 150, 160, 170])
PASSES = np.array(
    [0, 0.07, 0.141, 0.213, 0.328, 0.454, 0.599, 0.771, 0.988, 1.285, 1.741, 2.604, 3.884, 7.739]
)
#: Beyond so many blurs from the other edge the picture of a corner is that of a straight edge, within 0.02 px.
_ROUND = 2.5
#: Roundings (px) that are lost in the noise, and that are not.
_SHOWN = (0.05, 0.2)
#: A rounding is that of the picture up to so many times what is expected, and so many px.
_ROUNDING_SLACK, _ROUNDING_PX = 1.5, 0.25
#: Joints that turn by less (rad) may be tangential; a gap of so many sigma, and px, between the curves is none.
_SHALLOW = np.radians(30.0)
_SIGMAS, _GAP_PX = 4.0, 0.03
_NEAR_PX = 4.0
#: A tangential joint lies within this share of the shorter of its two runs.
_JOINT_SHARE = 0.25
#: Lowest wall, px.
_WALL_PX = 0.5
#: Points that a short line and a short arc keep.
_CORE = (3, 4)


class CornerJoints(Struct, frozen=True, eq=False):
    """For each run the joint at its end, with the run after it. vertex (P,) px; turn (P,) rad, signed; crossing (P,):
    whether the curves cross there; smooth (P,): whether they touch within the noise. zone (P,): px around the vertex
    that the blur has rounded.
    """

    vertex: ComplexArray
    turn: FloatArray
    crossing: BoolArray
    smooth: BoolArray
    zone: FloatArray


def orient(curves: Curves, runs: Runs, loops: Rings, points: ComplexArray) -> Curves:
    """The same curves, signed so that 1j times the gradient of the form points along the run."""
    middle = _row(runs, loops, runs.count // 2)
    before, after = (
        _row(runs, loops, np.maximum(runs.count // 2 - 1, 0)),
        _row(runs, loops, runs.count // 2 + 1),
    )
    along = 1j * _gradient(curves, points[middle])
    wrong = ((points[after] - points[before]) * along.conj()).real < 0
    return Curves(curves.origin, np.where(wrong[:, None], -curves.form, curves.form), curves.sse)


def joints(
    curves: Curves,
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    sigma: FloatArray,
    blur: FloatArray,
) -> CornerJoints:
    """Joints of oriented ``curves`` with those that follow; sigma, blur (L,) px."""
    after = runs.following()
    end = points[_row(runs, loops, runs.count)]
    near = (points[_row(runs, loops, runs.count - 1)] + end) / 2
    other = curves.take(after)
    vertex, crossing = crossings(curves, other, near)
    s = blur[runs.loop]
    turn = _turn(curves, other, vertex)
    crossing &= np.abs(vertex - near) < _NEAR_PX + zone_of(turn, s)
    foot = np.where(crossing, vertex, near)
    smooth, touch = _touching(curves, other, foot, sigma[runs.loop], runs.count, runs.count[after])
    smooth &= ~crossing | (np.abs(turn) < _SHALLOW)
    vertex = np.where(smooth, touch, np.where(crossing, vertex, _between(curves, other, near)))
    turn = _turn(curves, other, vertex)
    return CornerJoints(vertex, turn, crossing, smooth, np.where(smooth, 0.0, zone_of(turn, s)))


def crossings(one: Curves, two: Curves, near: ComplexArray) -> tuple[ComplexArray, BoolArray]:
    """The crossing (P,) of each pair next to ``near``, by Newton's method, and whether there is one."""
    point = near.copy()
    miss = np.full(len(near), np.inf)
    for _ in range(12):
        f, g = one.distances(point), two.distances(point)
        miss = np.hypot(f, g)
        a, b = normals(one, point), normals(two, point)
        cross = (a.conj() * b).imag
        cross = np.where(np.abs(cross) < 1e-6, 1e-6, cross)
        step = 1j * (f * b - g * a) / cross
        size = np.abs(step)
        point = point + step * np.minimum(1.0, 20.0 / np.maximum(size, 1e-12))
    return point, miss < 1e-6


def small_corners(
    curves: Curves, runs: Runs, loops: Rings, points: ComplexArray, blur: FloatArray
) -> BoolArray:
    """Which runs (P,) are no more than the picture's rounding of a corner between their neighbours."""
    after, before = runs.following(), runs.before()
    one, two = curves.take(before), curves.take(after)
    middle = points[_row(runs, loops, runs.count // 2)]
    vertex, crossing = crossings(one, two, middle)
    s = blur[runs.loop]
    turn = _turn(one, two, vertex)
    zone = zone_of(turn, s)
    first, last = (
        points[_row(runs, loops, np.zeros_like(after))],
        points[_row(runs, loops, runs.count - 1)],
    )
    reach = np.maximum(np.abs(first - vertex), np.abs(last - vertex))
    inwards = 1j * np.sign(turn) * tangents(one, vertex) * np.exp(0.5j * turn)
    # The place nearest to the vertex may just have gone to a neighbour.
    depth = _depths(
        within(Runs(runs.first - 2, runs.count + 4, runs.loop), loops),
        loops,
        points,
        vertex,
        inwards,
    )
    expected = np.interp(np.abs(turn), TURNS, PASSES) * s
    found = (
        crossing
        & (before != after)
        & (reach < 1.5 * zone + 2.0)
        & (depth < _ROUNDING_SLACK * expected + _ROUNDING_PX)
    )
    return np.asarray(found & (depth > -0.5))


def walls(
    curves: Curves, runs: Runs, loops: Rings, points: ComplexArray, sigma: FloatArray
) -> BoolArray:
    """(P,) whether neighbours pass on both sides of a run: it is a wall, as in a shallow notch."""
    first, last = (points[_row(runs, loops, place)] for place in (0 * runs.count, runs.count - 1))
    middle = (first + last) / 2
    before = curves.take(runs.before()).distances(middle)
    after = curves.take(runs.following()).distances(middle)
    height = _SIGMAS * sigma[runs.loop] + _WALL_PX
    return np.asarray((before * after < 0) & (np.abs(before - after) > height))


def _depths(
    runs: Runs, loops: Rings, points: ComplexArray, vertex: ComplexArray, inwards: ComplexArray
) -> FloatArray:
    """How far ``inwards`` (P,) of its vertex each run passes: the lowest point of a parabola over its lowest three."""
    rows, begin = runs.rows(loops)
    which = owners(runs.count)
    local = (points[rows] - vertex[which]) * inwards[which].conj()
    low = np.minimum.reduceat(local.real, begin)
    place = np.full(len(runs), -1)
    hit = np.flatnonzero(local.real <= low[which])
    place[which[hit]] = hit - begin[which[hit]]
    around = np.stack(
        [(points[_row(runs, loops, place + k)] - vertex) * inwards.conj() for k in (-1, 0, 1)]
    )
    return valley(around.imag, around.real)


def valley(x: FloatArray, y: FloatArray) -> FloatArray:
    """The lowest value (P,) of parabolas through three points each, x and y (3, P); of the points, if there is none."""
    with np.errstate(all="ignore"):
        first, second = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
        bend = (second - first) / (x[2] - x[0])
        slope = first + bend * (x[1] - x[0])
        lowest = y[1] - slope * slope / (4 * bend)
    low = y.min(axis=0)
    found: FloatArray = np.where(
        np.isfinite(lowest) & (bend > 0) & (lowest > low - 0.5), lowest, low
    )
    return found


def clear(
    found: CornerJoints, curves: Curves, runs: Runs, loops: Rings, points: ComplexArray
) -> BoolArray:
    """(N,) which points of the loops count: those that no corner has rounded, as long as a run keeps a few."""
    before = runs.before()
    rows, begin = runs.rows(loops)
    which = owners(runs.count)
    z = points[rows]
    ahead = np.abs(z - found.vertex[which]) / np.maximum(found.zone[which], 1e-9)
    behind = np.abs(z - found.vertex[before][which]) / np.maximum(found.zone[before][which], 1e-9)
    clear = np.minimum(ahead, behind)
    keep = np.zeros(len(points), dtype=np.bool_)
    counts = clear >= 1.0
    enough = np.add.reduceat(counts.astype(np.int64), begin)
    # A short run keeps its middle, the least rounded of what there is.
    core = np.where(curves.curvature == 0, *_CORE)
    place = ramp(runs.count)
    third = np.maximum((runs.count - core) // 2, 0)[which]
    middle = (place >= third) & (place < runs.count[which] - third)
    keep[rows] = counts | ((enough < core)[which] & middle)
    return keep


def _row(runs: Runs, loops: Rings, place: IntArray) -> IntArray:
    """The row (P,) of the point at ``place`` of each run, counted from its first."""
    base = loops.first[runs.loop]
    return np.asarray(base + (runs.first - base + place) % loops.count[runs.loop])


def _gradient(curves: Curves, points: ComplexArray) -> ComplexArray:
    local = points - curves.origin
    return np.asarray(2 * curves.form[:, 0] * local + curves.form[:, 1] + 1j * curves.form[:, 2])


def normals(curves: Curves, points: ComplexArray) -> ComplexArray:
    """Unit vectors (P,) in which the distance from the curves grows."""
    gradient = _gradient(curves, points)
    size = np.abs(gradient)
    return np.asarray(gradient / np.maximum(size, 1e-9))


def tangents(curves: Curves, points: ComplexArray) -> ComplexArray:
    """Unit directions of travel (P,) of oriented curves at points (P,) of theirs."""
    return 1j * normals(curves, points)


def _turn(one: Curves, two: Curves, vertex: ComplexArray) -> FloatArray:
    return np.asarray(np.angle(tangents(two, vertex) * tangents(one, vertex).conj()))


def zone_of(turn: FloatArray, blur: FloatArray) -> FloatArray:
    """Distance from the vertex within which the other edge is nearer than a few blurs; less if it does not show."""
    size = np.abs(turn)
    sine = np.where(size > np.pi / 2, np.maximum(np.sin(size), 0.25), 1.0)
    shown = np.interp(np.interp(size, TURNS, PASSES) * blur, _SHOWN, (0.0, 1.0))
    return np.asarray(_ROUND * blur / sine * shown)


def _between(one: Curves, two: Curves, near: ComplexArray) -> ComplexArray:
    """Half-way between the feet of ``near`` on both curves."""
    feet = [near - curves.distances(near) * normals(curves, near) for curves in (one, two)]
    return (feet[0] + feet[1]) / 2


def _touching(
    one: Curves,
    two: Curves,
    near: ComplexArray,
    sigma: FloatArray,
    count: IntArray,
    other: IntArray,
) -> tuple[BoolArray, ComplexArray]:
    """Whether the curves touch within their noise close to ``near``, and where."""
    apart = one.distances(near) - two.distances(near)
    bend = two.curvature - one.curvature
    bent = np.abs(bend) > 1e-5
    safe = np.where(bent, bend, 1.0)
    # Along the tangent the two part as apart - theta x - bend x^2 / 2; where that is least, they touch.
    theta = np.angle(tangents(two, near) * tangents(one, near).conj())
    x = np.where(bent, -theta / safe, 0.0)
    least = apart - theta * x - bend * x * x / 2
    allowed = _SIGMAS * sigma * np.sqrt(4.0 / count + 4.0 / other) + _GAP_PX
    # A line and what is nearly one touch anywhere: not beyond the points that tell the joint.
    reach = _NEAR_PX + 2 * np.sqrt(2 * allowed / np.maximum(np.abs(bend), 1e-5))
    reach = np.minimum(reach, _NEAR_PX + _JOINT_SHARE * np.minimum(count, other))
    touch = near + x * tangents(one, near)
    touch = _between(one, two, touch)
    return bent & (np.abs(least) < allowed) & (np.abs(x) < reach), touch
