"""The path of the tool centre in pixels, with the direction towards the part (PIST, sections 3.2.2 to 3.2.4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import owners, ramp
from camgen.geometry.rings import (
    ComplexArray,
    Rings,
    apply_hysteresis,
    find_latest,
    make_rings,
    space_evenly,
    unit,
)
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.plan.image_space.border import CLOSE, Border, border, foot, iso_line, near
from camgen.plan.image_space.field import (
    Distances,
    Field,
    beyond,
    chains,
    gradient,
    inside,
    sample_field,
    within,
)

#: A border of fewer pixels is no path: a spot of about two pixels, in which it is not sure that the tool centre fits.
_FEWEST = 8
#: Half the side (px) of the square over which the gradient is taken: at most, as the normal; and only to find a border.
_NORMAL, _SEARCH = 5, 2
#: The border lies about so far (px) outside the centres of the outermost pixels.
_HALF = 0.5
#: Inner corners cannot be rounder than so many pixels in an iso-line; a smaller radius is made so.
_ROUND = 2.0
#: What a place may be off (px) for the tool to be said to reach it.
_REACHED_PX = 1.0


class PixelWay(Struct, frozen=True, eq=False):
    """Closed curves about a pixel from point to point, pixels of the field, the part on the left as seen on the screen.

    press: (N,) unit vectors of the force angle theta_f. parent: (L,) the curve around each, -1 for none. back: distance
    of the pixels to where a tool larger by the corner radius would fit; None without a corner radius.
    """

    table: Rings
    points: ComplexArray
    press: ComplexArray
    parent: IntArray
    back: Distances | None


def pixel_way(picture: Field, distance: float, radius: float) -> PixelWay:
    """The integer pixels of the border of the offset mask, as in the paper [3.2.4]: theta_f = theta_g - 180 from the
    gradient of the distance image at each pixel [3.2.3].
    """
    mask = within(picture.far, distance + radius)
    back = inside(mask) if radius else None
    found = chains(mask if back is None else beyond(back, radius), _FEWEST)
    half = int(np.clip(distance / 3, 1, _NORMAL))
    press = -unit(gradient(picture.far, found.pixels, half))
    return PixelWay(found.table, found.pixels, press, found.parent, back)


def iso_way(picture: Field, edge: Border, distance: float, radius: float) -> PixelWay:
    """The iso-line of the distance to the part's border `edge`, and its gradient there.

    The border of the offset mask gives which lines there are and about where; each of its pixels is then brought to the
    exact distance. With a corner radius the same is done a second time, inwards from the first line; the gradient is
    then that of the distance to this line, the same where the tool touches, and turning steadily around the corner
    where it does not.
    """
    radius = max(radius, _ROUND) if radius else 0.0
    mask = within(picture.far, distance + radius + _HALF)
    found = chains(mask, 1 if radius else _FEWEST)
    points, away = _bring(picture.far, edge, found.table, found.pixels, distance + radius)
    if not radius:
        table, (points, away) = space_evenly(found.table, points, away)
        return PixelWay(table, points, -unit(away), found.parent, None)
    back = inside(mask)
    line = border(found.table, points, mask.shape)
    found = chains(beyond(back, radius + _HALF), _FEWEST)
    points, away = _bring(back, line, found.table, found.pixels, -radius)
    table, (points, away) = space_evenly(found.table, points, away)
    return PixelWay(table, points, -unit(away), found.parent, back)


def check_reach(
    way: PixelWay, picture: Field, edge: Border, distance: float, radius: float
) -> BoolArray:
    """(N,) of `edge`: whether the tool may stand where it would touch that point of the part."""
    centre = edge.points + distance * edge.away
    if way.back is None:
        return sample_field(picture.far, centre) >= distance - _REACHED_PX
    return sample_field(way.back, centre) <= max(radius, _ROUND) + _HALF + _REACHED_PX


def place_borders(borders: Sequence[FloatArray], picture: Field) -> tuple[Rings, ComplexArray]:
    """Borders in view pixels as curves of the field with the part on the left, a point every pixel or so."""
    table = make_rings([len(one) for one in borders])
    points = np.concatenate([one[:, 0] + 1j * one[:, 1] for one in borders]) - picture.corner
    table, (points,) = space_evenly(table, points)
    right = unit(1j * (points[table.shifted(1)] - points[table.shifted(-1)]))
    outside = sample_field(picture.far, points + 2 * right) - sample_field(
        picture.far, points - 2 * right
    )
    turned = np.bincount(table.loop, outside, len(table.count)) < 0
    row = np.arange(len(table))
    first, count = table.first[table.loop], table.count[table.loop]
    return table, points[np.where(turned[table.loop], 2 * first + count - 1 - row, row)]


def _bring(
    far: Distances, line: Border, table: Rings, pixels: ComplexArray, level: float
) -> tuple[ComplexArray, ComplexArray]:
    """Pixels at about `level` px from `line`, brought there. far: the distance image of what `line` is around."""
    gap = sample_field(far, pixels)
    about = pixels - gap * unit(gradient(far, pixels, _SEARCH))
    return iso_line(line, table, pixels, about, gap, level)


# Contact points, feed and force along the waypoints (PIST, sections 3.3 and 4.2.1).

#: Part of the path's speed at which the contact point stands still: a sharp outer corner. Below the first it begins,
#: above the second it is over.
_STANDS, _MOVES = 0.1, 0.35
#: Noise (rad) of the force direction along a path that is straight or an arc: to the exact border, and from pixels.
ANGLE_NOISE, PIXEL_NOISE = 0.02, 0.05
#: Radius (px) of a sharp corner in a photo.
_ROUND_PX = 3.0
#: Radius (px) up to which a corner in a photo may be a sharp one; the largest turn (rad) of one.
_ROUNDED, _SHARPEST = 4, 2.6
#: The tool centre is never slowed below this part of the feed, however tight the inner curve.
_SLOWEST = 0.02


def contact_points(points: ComplexArray, press: ComplexArray, distance: float) -> ComplexArray:
    """Where the tool should touch: each centre moved by the offset distance (px) along the force direction (eq. 10)."""
    return points + distance * press


def observe(
    table: Rings, points: ComplexArray, contacts: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """(N,) px by which the contact point runs along, and the tool centre, on the segment that ends in each row.

    Their quotient is the observed feed for a tool centre of speed 1. The distance of contact points in eq. (11) is in
    pixels and takes the path's own points to be one apart; on a border of pixels they are 1 or sqrt(2) apart, hence the
    division. Only what runs along the path counts, so that the sideways noise of the angles does not make the contact
    seem faster.
    """
    step = points - points[table.shifted(-1)]
    way = contacts - contacts[table.shifted(-1)]
    return np.asarray((way * unit(step).conj()).real), np.abs(step)


def feeds(ratio: FloatArray, contact: BoolArray, fastest: float) -> FloatArray:
    """(N,) feed of the tool centre as a multiple of the nominal feed: 1 / ratio (eq. 11), at most `fastest` (twice in
    the paper). Without contact there is nothing to hold constant: 1.
    """
    return np.where(contact, np.clip(1 / np.maximum(ratio, 1e-9), _SLOWEST, fastest), 1.0)


def touching(table: Rings, gap: FloatArray, tolerance: float) -> BoolArray:
    """(N,) where contact is expected [4.2.1]: lost where the contact point is more than `tolerance` px from the part,
    back at half of that.
    """
    return apply_hysteresis(table, gap <= tolerance / 2, gap > tolerance, True)


def standing_below(distance: float) -> float:
    """The ratio below which the contact point stands still, for an offset of `distance` px: a corner as round as a
    photo makes a sharp one has no less.
    """
    return max(_STANDS, _ROUND_PX / (distance + _ROUND_PX))


def moving(table: Rings, ratio: FloatArray, below: float) -> BoolArray:
    """(N,) false at sharp outer corners, where the observed feed is near zero [4.2.1]. below: `standing_below`."""
    return apply_hysteresis(table, ratio >= below + _MOVES - _STANDS, ratio < below, True)


def sharpen(
    table: Rings, ratio: FloatArray, along: FloatArray, press: ComplexArray, below: float
) -> FloatArray:
    """`ratio` where the contact point stands still at sharp corners, and not about them.

    A photo shows a corner round, by a pixel or two, and the contact point seems to stand from where that begins. The
    corner is where the lines beside it meet: the tangent of half the turn times that radius, which is what the contact
    point ran by divided by the turn. So much at both ends belongs to the lines, at most `_ROUNDED` px. below:
    `standing_below`.
    """
    still = ratio < below
    starts = still & ~still[table.shifted(-1)]
    start = find_latest(table, starts)
    row = np.flatnonzero(still & (start >= 0))
    start, size = start[row], np.bincount(start[row], minlength=len(table))
    ran = np.bincount(start, along[row], len(table))
    turn = np.bincount(
        start, np.abs(np.angle(press[row] * press[table.shifted(-1)[row]].conj())), len(table)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.nan_to_num(ran / turn * np.tan(np.minimum(turn, _SHARPEST) / 2))
    shift = np.clip(np.floor(shift), 0, np.minimum(_ROUNDED, size // 3))
    place = (row - start) % table.count[table.loop[row]]
    result = ratio.copy()
    before, after = table.along(start, -1), table.along(start, size[start])
    result[row] = np.where(place < shift[start], ratio[before], result[row])
    result[row] = np.where(place >= size[start] - shift[start], ratio[after], result[row])
    return result


def slowed(table: Rings, ratio: FloatArray) -> FloatArray:
    """`ratio` with the greater one of two neighbours: where it changes, the tool rather is slow too early."""
    return np.asarray(
        np.maximum(np.maximum(ratio[table.shifted(-1)], ratio[table.shifted(1)]), ratio)
    )


def nearest(edge: Border, contacts: ComplexArray) -> tuple[FloatArray, IntArray]:
    """The distance (N,) px from each contact point to the border of the part, and the row there; inf and -1 where none
    is near. It is the distance to the foreground mask of [4.2.1], to a fraction of a pixel.
    """
    start = near(edge, contacts)
    on, row = foot(edge, contacts, np.maximum(start, 0), CLOSE)
    return np.where(start >= 0, np.abs(contacts - on), np.inf), np.where(start >= 0, row, -1)


# From a point at every pixel to few waypoints (PIST, section 3.4).


class Limits(Struct, frozen=True):
    """What the removal of waypoints keeps to. rate: rad/px of the force direction below which a path counts as
    straight. off: px by which the path may change.
    """

    rate: float
    off: float


#: Zero crossings of the low-pass on each side of its middle.
_LOBES = 4
#: Bound (rad) on the angle by which the removal of waypoints may turn the force direction in between.
_PRESS_TURN = np.radians(1.0)


def smooth(table: Rings, count: IntArray, *columns: ComplexArray) -> list[ComplexArray]:
    """Closed curves of N points, low-pass filtered for re-sampling to `count` (L,) points at most N [3.4.1].

    The factor num / den is count / N of each curve, so that whole periods remain whole. Of up-sampling by num, the
    low-pass at f_c = f_n / max(num, den) (eq. 13) and down-sampling by den only the filter is left here: its values at
    all N points, of which `choose_needed` takes those at the new spacing, and others where they are needed. Each is
    the sum of the points around it, weighted by a sinc of the cut-off in a Hann window, with wrap-around. In cycles per
    point of the input f_c is half of count / N. Directions are filtered as unit vectors.
    """
    factor = (table.count / count)[table.loop]
    reach = int(np.ceil(_LOBES * float(np.max(factor, initial=1.0))))
    tap = np.arange(-reach, reach + 1)
    # In zero crossings from the point.
    place = tap / factor[:, None]
    weight = np.sinc(place) * np.where(
        np.abs(place) < _LOBES, 0.5 + 0.5 * np.cos(np.pi * place / _LOBES), 0.0
    )
    weight /= weight.sum(axis=1, keepdims=True)
    source = table.along(np.arange(len(table))[:, None], tap)
    return [np.einsum("nt,nt->n", column[source], weight) for column in columns]


def spaced(table: Rings, count: IntArray) -> BoolArray:
    """(N,) the rows that are nearest to `count` (L,) places evenly along each curve."""
    loop = owners(count)
    places = np.rint(ramp(count) * (table.count / count)[loop]).astype(np.int64)
    chosen = np.zeros(len(table), dtype=bool)
    chosen[table.first[loop] + places % table.count[loop]] = True
    return chosen


def choose_needed(
    first: IntArray,
    points: ComplexArray,
    press: ComplexArray,
    spaced: BoolArray,
    switched: BoolArray,
    limits: Limits,
) -> BoolArray:
    """Which waypoints (N,) remain when the redundant ones are removed [3.4.2].

    first: (L + 1,) rows at which the curves begin, and N; each curve's last row is its end. spaced: (N,) those at the
    spacing that is asked for. The force angle's backward difference per px of path decides: of these, waypoints where
    it is below `limits.rate` on both sides go. Those that are `switched` (N,), where force or feed changes, stay.
    Then the waypoint farthest off comes back, in every gap, until none is farther than `limits.off` px from the
    straight line that is left, and no press direction turned by more than 1 deg.
    """
    keep = switched.copy()
    keep[first[:-1]] = keep[first[1:] - 1] = True
    row = np.flatnonzero(spaced | keep)
    turn = np.abs(np.angle(press[row[1:]] * press[row[:-1]].conj()))
    quick = turn >= limits.rate * np.abs(np.diff(points[row]))
    keep[row[1:][quick]] = keep[row[:-1][quick]] = True
    while True:
        off = _deviation(np.flatnonzero(keep), points, press, limits.off)
        begin = np.flatnonzero(keep)
        worst = np.maximum.reduceat(off, begin)
        over = worst > 1.0
        if not over.any():
            return keep
        gap = np.cumsum(keep) - 1
        hit = np.flatnonzero((off == worst[gap]) & over[gap])
        keep[hit] = True


def _deviation(
    begin: IntArray, points: ComplexArray, press: ComplexArray, bound: float
) -> FloatArray:
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
    return np.asarray(np.maximum(np.abs(here - part * way) / bound, angle / _PRESS_TURN))
