"""The path of the tool centre in pixels, with force directions, feed and waypoints.

See PIST, sections 3.2.2 to 3.2.4, 3.3, 3.4 and 4.2.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import count_rows, list_owners, number_rows
from camgen.geometry.rings import (
    ComplexArray,
    Rings,
    find_latest,
    make_rings,
    normalize,
    space_evenly,
)
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.plan.image_space.border import (
    CLOSE,
    Border,
    find_foot,
    find_near,
    make_border,
    move_to_distance,
)
from camgen.plan.image_space.field import (
    Distances,
    Field,
    FieldCurves,
    compute_gradient,
    find_chains,
    mask_beyond,
    mask_within,
    measure_inside,
    sample_field,
)

#: Minimum number of pixels of a path. In a smaller spot the tool centre may not fit.
_MIN_PIXELS = 8
#: Half the side of the square of a gradient, px: maximum for a normal, and for finding a border.
_NORMAL, _SEARCH = 5, 2
#: Approximate distance from the centres of the outermost pixels to the border, px.
_HALF = 0.5
#: Minimum radius of inner corners of an iso-line, px. A smaller `corner_radius` is raised to it.
_MIN_CORNER_RADIUS = 2.0
#: Largest distance that a tool may be off a point that it reaches, px.
_REACHED_PX = 1.0


class PixelPath(Struct, frozen=True, eq=False):
    """Closed curves of points about a pixel apart, with the part on the left as seen on the screen.

    table: lengths of the curves.
    points: (N,) positions of the tool centre, pixels of the field.
    force_direction: (N,) unit vectors of the force angle theta_f.
    parent: (L,) index of the curve around each, or -1.
    inside: distance from each pixel to where a tool larger by the corner radius would fit; None
        without a corner radius.
    """

    table: Rings
    points: ComplexArray
    force_direction: ComplexArray
    parent: IntArray
    inside: Distances | None


def make_pixel_path(picture: Field, distance: float, radius: float) -> PixelPath:
    """The integer pixels along the border of the offset mask, as in the paper [3.2.4].

    theta_f = theta_g - 180 deg, from the gradient of the distance image at each pixel [3.2.3].
    """
    mask = mask_within(picture.far, distance + radius)
    inside = measure_inside(mask) if radius else None
    chains = find_chains(mask if inside is None else mask_beyond(inside, radius), _MIN_PIXELS)
    half = int(np.clip(distance / 3, 1, _NORMAL))
    direction = -normalize(compute_gradient(picture.far, chains.pixels, half))
    return PixelPath(chains.table, chains.pixels, direction, chains.parent, inside)


def make_iso_path(picture: Field, edge: Border, distance: float, radius: float) -> PixelPath:
    """The iso-line of the distance from the part's border `edge`, with its gradient.

    The pixels along the border of the offset mask are moved to the exact distance. With a corner
    radius this is repeated, inwards from the first iso-line. The gradient is then that of the
    distance from the first line: it is the same where the tool touches, and turns evenly around a
    corner where it does not.
    """
    radius = max(radius, _MIN_CORNER_RADIUS) if radius else 0.0
    mask = mask_within(picture.far, distance + radius + _HALF)
    chains = find_chains(mask, 1 if radius else _MIN_PIXELS)
    points, outward = _move_pixels(picture.far, edge, chains, distance + radius)
    inside = None
    if radius:
        inside = measure_inside(mask)
        line = make_border(chains.table, points, mask.shape)
        chains = find_chains(mask_beyond(inside, radius + _HALF), _MIN_PIXELS)
        points, outward = _move_pixels(inside, line, chains, -radius)
    table, (points, outward) = space_evenly(chains.table, points, outward)
    return PixelPath(table, points, -normalize(outward), chains.parent, inside)


def is_reached(
    path: PixelPath, picture: Field, edge: Border, distance: float, radius: float
) -> BoolArray:
    """(N,) true for points of `edge` that the tool can touch without a collision."""
    centre = edge.points + distance * edge.outward
    if path.inside is None:
        return sample_field(picture.far, centre) >= distance - _REACHED_PX
    limit = max(radius, _MIN_CORNER_RADIUS) + _HALF + _REACHED_PX
    return sample_field(path.inside, centre) <= limit


def place_borders(borders: Sequence[FloatArray], picture: Field) -> tuple[Rings, ComplexArray]:
    """Convert borders in view pixels to curves of the field with the part on the left.

    The points are spaced about a pixel apart.
    """
    table = make_rings(count_rows(borders))
    flat = np.concatenate(borders)
    table, (points,) = space_evenly(table, flat[:, 0] + 1j * flat[:, 1] - picture.corner)
    right = normalize(1j * (points[table.shifted(1)] - points[table.shifted(-1)]))
    on_right = sample_field(picture.far, points + 2 * right)
    outside = on_right - sample_field(picture.far, points - 2 * right)
    is_reversed = np.bincount(table.loop, outside, len(table.count)) < 0
    row = np.arange(len(table))
    first, count = table.first[table.loop], table.count[table.loop]
    return table, points[np.where(is_reversed[table.loop], 2 * first + count - 1 - row, row)]


def _move_pixels(
    far: Distances, border: Border, chains: FieldCurves, distance: float
) -> tuple[ComplexArray, ComplexArray]:
    """Move the pixels of chains to `distance` px from `border`. Returns points and gradients.

    far: distance image of the inside of `border`.
    """
    gap = sample_field(far, chains.pixels)
    about = chains.pixels - gap * normalize(compute_gradient(far, chains.pixels, _SEARCH))
    return move_to_distance(border, chains.table, chains.pixels, about, gap, distance)


# Contact points, feed and force along the waypoints (PIST, sections 3.3 and 4.2.1).

#: Speed of the contact point, as a fraction of that of the tool centre. Below the first it stands
#: still, as at a sharp outer corner, until it is above the second.
STANDS, MOVES = 0.1, 0.35
#: Noise of the force direction along lines and arcs, rad: from the exact border, and from pixels.
ANGLE_NOISE, PIXEL_NOISE = 0.02, 0.05
#: Radius of a sharp corner in a photo, px.
CORNER_PX = 3.0
#: Maximum length by which a corner in a photo is shortened at each end, px, and its largest angle
#: for that, rad.
_MAX_SHIFT, _MAX_CORNER = 4, 2.6
#: Minimum speed of the tool centre on a tight inner curve, as a fraction of the feed.
_SLOWEST = 0.02


def measure_runs(
    table: Rings, points: ComplexArray, contacts: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """(N,) lengths that contact point and tool centre run on the segment before each row, px.

    Their ratio is the observed feed for a tool centre of speed 1. Eq. (11) takes the points of the
    path to be 1 px apart, but on a border of pixels they are 1 or sqrt(2) apart; hence the ratio.
    Only the component of the contact point along the path counts, so that the noise of the angles
    across the path does not make it seem faster.
    """
    step = points - points[table.shifted(-1)]
    contact_step = contacts - contacts[table.shifted(-1)]
    return np.asarray((contact_step * normalize(step).conj()).real), np.abs(step)


def compute_feeds(ratio: FloatArray, contact: BoolArray, fastest: float) -> FloatArray:
    """(N,) feed of the tool centre as a multiple of the nominal feed.

    It is 1 / ratio (eq. 11), at most `fastest` (2 in the paper), and 1 without contact.
    """
    return np.where(contact, np.clip(1 / np.maximum(ratio, 1e-9), _SLOWEST, fastest), 1.0)


def sharpen_corners(
    table: Rings, ratio: FloatArray, along: FloatArray, direction: ComplexArray, standing: float
) -> FloatArray:
    """`ratio` with corners shortened to where the contact point stands still at a sharp corner.

    A photo shows a corner with a radius of a pixel or two, so the contact point seems to stand from
    the start of the arc on. The true corner is the crossing of the lines beside it. It is away
    from both ends by the radius times the tangent of half the corner angle; the radius is the
    length that the contact point ran by the angle. These stretches belong to the lines.

    along: (N,) length of the contact point on the segment before each row, px.
    standing: speed ratio below which the contact point stands still.
    """
    still = ratio < standing
    start = find_latest(table, still & ~still[table.shifted(-1)])
    row = np.flatnonzero(still & (start >= 0))
    start, size = start[row], np.bincount(start[row], minlength=len(table))
    length = np.bincount(start, along[row], len(table))
    step = np.abs(np.angle(direction[row] * direction[table.shifted(-1)[row]].conj()))
    turn = np.bincount(start, step, len(table))
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.nan_to_num(length / turn * np.tan(np.minimum(turn, _MAX_CORNER) / 2))
    shift = np.clip(np.floor(shift), 0, np.minimum(_MAX_SHIFT, size // 3))
    place = (row - start) % table.count[table.loop[row]]
    sharpened = ratio.copy()
    before, after = table.along(start, -1), table.along(start, size[start])
    sharpened[row] = np.where(place < shift[start], ratio[before], sharpened[row])
    sharpened[row] = np.where(place >= size[start] - shift[start], ratio[after], sharpened[row])
    return sharpened


def spread_slow(table: Rings, ratio: FloatArray) -> FloatArray:
    """(N,) the largest ratio of each row and its neighbours: the tool slows down early."""
    neighbours = np.maximum(ratio[table.shifted(-1)], ratio[table.shifted(1)])
    return np.asarray(np.maximum(neighbours, ratio))


def measure_gaps(
    edge: Border, contacts: ComplexArray, field: Field | None
) -> tuple[FloatArray, IntArray]:
    """The distance (N,) of each contact point from the part, px, and the nearest row of `edge`.

    inf and -1 if no point of the border is near. It is the distance to the foreground mask of
    [4.2.1]: to a fraction of a pixel, or from the distance image of `field`.
    """
    start = find_near(edge, contacts)
    foot, row = find_foot(edge, contacts, np.maximum(start, 0), CLOSE)
    distance = np.where(start >= 0, np.abs(contacts - foot), np.inf)
    gap = distance if field is None else sample_field(field.far, contacts)
    return gap, np.where(start >= 0, row, -1)


# From a point at every pixel to few waypoints (PIST, section 3.4).


class Limits(Struct, frozen=True):
    """Limits for the removal of waypoints.

    rate: change of the force direction below which a path is straight, rad/px.
    deviation: largest change of the path, px.
    """

    rate: float
    deviation: float


#: Zero crossings of the low-pass filter on each side of its middle.
_LOBES = 4
#: Maximum angle by which the removal of waypoints may turn the force direction, rad.
_MAX_TURN = np.radians(1.0)


def smooth(table: Rings, count: IntArray, *columns: ComplexArray) -> list[ComplexArray]:
    """Low-pass filter closed curves of N points for resampling to `count` (L,) points [3.4.1].

    The factor num / den is count / N, at most 1 for each curve, so that whole periods stay whole.
    The paper up-samples by num, filters with f_c = f_n / max(num, den) (eq. 13), and down-samples
    by den. This function only filters, at all N points; `choose_needed` selects points. A value is
    the sum of the points around it with wrap-around, weighted by a sinc of the cut-off in a Hann
    window. In cycles per point of the input f_c is half of count / N. Directions are filtered as
    unit vectors.
    """
    factor = (table.count / count)[table.loop]
    half = int(np.ceil(_LOBES * float(np.max(factor, initial=1.0))))
    tap = np.arange(-half, half + 1)
    # Distance from the point in zero crossings.
    place = tap / factor[:, None]
    weight = np.sinc(place) * np.where(
        np.abs(place) < _LOBES, 0.5 + 0.5 * np.cos(np.pi * place / _LOBES), 0.0
    )
    weight /= weight.sum(axis=1, keepdims=True)
    source = table.along(np.arange(len(table))[:, None], tap)
    return [np.einsum("nt,nt->n", column[source], weight) for column in columns]


def mark_spaced(table: Rings, count: IntArray) -> BoolArray:
    """(N,) true for the rows nearest to `count` (L,) even places along each curve."""
    loop = list_owners(count)
    places = np.rint(number_rows(count) * (table.count / count)[loop]).astype(np.int64)
    is_spaced = np.zeros(len(table), dtype=bool)
    is_spaced[table.first[loop] + places % table.count[loop]] = True
    return is_spaced


def choose_needed(
    first: IntArray,
    points: ComplexArray,
    direction: ComplexArray,
    is_spaced: BoolArray,
    is_switched: BoolArray,
    limits: Limits,
) -> BoolArray:
    """(N,) true for the waypoints that stay when redundant ones are removed [3.4.2].

    first: (L + 1,) first row of each curve, and N. The last row of a curve is its end.
    direction: (N,) unit vectors of the force.
    is_spaced: (N,) waypoints at the requested spacing.
    is_switched: (N,) waypoints at which force or feed changes; all of them stay.

    A spaced waypoint is redundant if the force angle changes by less than `limits.rate` per px on
    both sides. Then in every gap the farthest waypoint is restored, until the path deviates by at
    most `limits.deviation` px and the force direction by at most 1 deg.
    """
    keep = is_switched.copy()
    keep[first[:-1]] = keep[first[1:] - 1] = True
    row = np.flatnonzero(is_spaced | keep)
    turn = np.abs(np.angle(direction[row[1:]] * direction[row[:-1]].conj()))
    is_turning = turn >= limits.rate * np.abs(np.diff(points[row]))
    keep[row[1:][is_turning]] = keep[row[:-1][is_turning]] = True
    while True:
        begin = np.flatnonzero(keep)
        deviation = _compute_deviation(begin, points, direction, limits.deviation)
        worst = np.maximum.reduceat(deviation, begin)
        is_over = worst > 1.0
        if not is_over.any():
            return keep
        gap = np.cumsum(keep) - 1
        keep[np.flatnonzero((deviation == worst[gap]) & is_over[gap])] = True


def _compute_deviation(
    begin: IntArray, points: ComplexArray, direction: ComplexArray, limit: float
) -> FloatArray:
    """(N,) deviation of each waypoint from the line between the kept ones around it.

    The larger one of position and force direction, as a multiple of the limits.
    """
    gap = np.repeat(np.arange(len(begin)), np.diff(np.append(begin, len(points))))
    low = begin[gap]
    high = np.append(begin[1:], len(points) - 1)[gap]
    line, offset = points[high] - points[low], points - points[low]
    size = np.maximum(line.real**2 + line.imag**2, 1e-18)
    fraction = np.clip((offset * line.conj()).real / size, 0.0, 1.0)
    between = (1 - fraction) * direction[low] + fraction * direction[high]
    angle = np.abs(np.angle(direction * between.conj()))
    return np.asarray(np.maximum(np.abs(offset - fraction * line) / limit, angle / _MAX_TURN))
