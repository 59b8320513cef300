"""From a point at every pixel to few waypoints (PIST, section 3.4)."""

from __future__ import annotations

import numpy as np

from camgen.geometry.segments import BoolArray, IntArray
from camgen.planners.image_space_rings import ComplexArray, Rings, rings
from camgen.pose import FloatArray

#: Zero crossings of the low-pass on each side of its middle.
_LOBES = 4
#: Bound (rad) on the angle by which the removal of waypoints may turn the force direction in between.
_TURN = np.radians(1.0)


def resampled(table: Rings, count: IntArray, *columns: ComplexArray) -> tuple[Rings, list[ComplexArray]]:
    """Closed curves of N points as curves of ``count`` (L,) points, low-pass filtered [3.4.1].

    The factor num / den is count / N of each curve, so that whole periods remain whole. Of up-sampling by num, the
    low-pass at f_c = f_n / max(num, den) (eq. 13) and down-sampling by den only the points that are left are worked
    out: each is the sum of the points around it, weighted by a sinc of the cut-off in a Hann window, with wrap-around.
    In cycles per point of the input f_c is half of min(1, count / N). Directions are filtered as unit vectors.
    """
    result = rings(count)
    loop = result.loop
    factor = (table.count / count)[loop]
    exact = (np.arange(len(result)) - result.first[loop]) * factor
    middle = np.floor(exact).astype(np.int64)
    cutoff = 1.0 / np.maximum(factor, 1.0)
    reach = int(np.ceil(_LOBES * float(np.max(factor, initial=1.0))))
    tap = np.arange(1 - reach, reach + 1)
    # In zero crossings from the point.
    place = (tap - (exact - middle)[:, None]) * cutoff[:, None]
    weight = np.sinc(place) * np.where(np.abs(place) < _LOBES, 0.5 + 0.5 * np.cos(np.pi * place / _LOBES), 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    source = table.first[loop][:, None] + (middle[:, None] + tap) % table.count[loop][:, None]
    return result, [np.einsum("nt,nt->n", column[source], weight) for column in columns]


def needed(
    first: IntArray, points: ComplexArray, press: ComplexArray, force: BoolArray, rate: float, bound: float
) -> BoolArray:
    """Which waypoints (N,) remain when the redundant ones are removed [3.4.2].

    first: (L + 1,) rows at which the curves begin, and N; each curve's last row is its end. The force angle's backward
    difference per px of path decides: waypoints where it is below ``rate`` on both sides go. Those where force begins
    or ends stay; force (N,) is of the segment that ends in a row. Then the waypoint farthest off comes back, in every
    gap, until none is farther than ``bound`` px from the straight line that is left, and no press direction turned by
    more than 1 deg.
    """
    turn = np.abs(np.angle(press[1:] * press[:-1].conj()))
    slow = np.append(turn < rate * np.abs(np.diff(points)), True)
    keep = ~slow
    keep[1:] |= ~slow[:-1]
    keep[:-1] |= force[1:] != force[:-1]
    keep[first[:-1]] = keep[first[1:] - 1] = True
    while True:
        off = _deviation(np.flatnonzero(keep), points, press, bound)
        begin = np.flatnonzero(keep)
        worst = np.maximum.reduceat(off, begin)
        over = worst > 1.0
        if not over.any():
            return keep
        gap = np.cumsum(keep) - 1
        hit = np.flatnonzero((off == worst[gap]) & over[gap])
        keep[hit] = True


def _deviation(begin: IntArray, points: ComplexArray, press: ComplexArray, bound: float) -> FloatArray:
    """(N,) how far each waypoint is from the line between the kept ones around it, and its press from that between
    theirs, as a part of what is allowed.
    """
    gap = np.repeat(np.arange(len(begin)), np.diff(np.append(begin, len(points))))
    low = begin[gap]
    high = np.append(begin[1:], len(points) - 1)[gap]
    way, here = points[high] - points[low], points - points[low]
    size = np.maximum(way.real**2 + way.imag**2, 1e-18)
    part = np.clip((here * way.conj()).real / size, 0.0, 1.0)
    between = (1 - part) * press[low] + part * press[high]
    angle = np.abs(np.angle(press * between.conj()))
    return np.asarray(np.maximum(np.abs(here - part * way) / bound, angle / _TURN))
