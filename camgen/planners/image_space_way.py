"""The path of the tool centre in pixels, with the direction towards the part (PIST, sections 3.2.2 to 3.2.4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.geometry.segments import BoolArray, IntArray
from camgen.planners.image_space_border import Border, border, iso_line
from camgen.planners.image_space_field import Distances, Field, beyond, chains, gradient, inside, sampled, within
from camgen.planners.image_space_rings import ComplexArray, Rings, evenly, rings, unit
from camgen.pose import FloatArray

#: A border of fewer pixels is no path: a spot of about two pixels, in which it is not sure that the tool centre fits.
_FEWEST = 8
#: Half the side (px) of the square over which the gradient is taken: at most, as the normal; and only to find a border.
_NORMAL, _SEARCH = 5, 2
#: The border lies about so far (px) outside the centres of the outermost pixels.
_HALF = 0.5
#: Inner corners cannot be rounder than so many pixels in an iso-line; a smaller radius is made so.
_ROUND = 2.0
#: What a place may be off (px) for the tool to be said to reach it.
_SLACK = 1.0


class Way(Struct, frozen=True, eq=False):
    """Closed curves about a pixel from point to point, pixels of the field, the part on the left as seen on the screen.

    press: (N,) unit vectors of the force angle theta_f. parent: (L,) the curve around each, -1 for none. back: distance
    of the pixels to where a tool larger by the corner radius would fit; None without a corner radius.
    """

    table: Rings
    points: ComplexArray
    press: ComplexArray
    parent: IntArray
    back: Distances | None


def pixel_way(picture: Field, distance: float, radius: float) -> Way:
    """The integer pixels of the border of the offset mask, as in the paper [3.2.4]: theta_f = theta_g - 180 from the
    gradient of the distance image at each pixel [3.2.3].
    """
    mask = within(picture.far, distance + radius)
    back = inside(mask) if radius else None
    found = chains(mask if back is None else beyond(back, radius), _FEWEST)
    half = int(np.clip(distance / 3, 1, _NORMAL))
    press = -unit(gradient(picture.far, found.pixels, half))
    return Way(found.table, found.pixels, press, found.parent, back)


def iso_way(picture: Field, edge: Border, distance: float, radius: float) -> Way:
    """The iso-line of the distance to the part's border ``edge``, and its gradient there.

    The border of the offset mask gives which lines there are and about where; each of its pixels is then brought to the
    exact distance. With a corner radius the same is done a second time, inwards from the first line; the gradient is
    then that of the distance to this line, the same where the tool touches, and turning steadily around the corner
    where it does not.
    """
    radius = max(radius, _ROUND) if radius else 0.0
    mask = within(picture.far, distance + radius + _HALF)
    found = chains(mask, 1 if radius else _FEWEST)
    points, away = _brought(picture.far, edge, found.table, found.pixels, distance + radius)
    if not radius:
        table, (points, away) = evenly(found.table, points, away)
        return Way(table, points, -unit(away), found.parent, None)
    back = inside(mask)
    line = border(found.table, points, mask.shape)
    found = chains(beyond(back, radius + _HALF), _FEWEST)
    points, away = _brought(back, line, found.table, found.pixels, -radius)
    table, (points, away) = evenly(found.table, points, away)
    return Way(table, points, -unit(away), found.parent, back)


def reached(way: Way, picture: Field, edge: Border, distance: float, radius: float) -> BoolArray:
    """(N,) of ``edge``: whether the tool may stand where it would touch that point of the part."""
    centre = edge.points + distance * edge.away
    if way.back is None:
        return sampled(picture.far, centre) >= distance - _SLACK
    return sampled(way.back, centre) <= max(radius, _ROUND) + _HALF + _SLACK


def given(borders: Sequence[FloatArray], picture: Field) -> tuple[Rings, ComplexArray]:
    """Borders in view pixels as curves of the field with the part on the left, a point every pixel or so."""
    table = rings([len(one) for one in borders])
    points = np.concatenate([one[:, 0] + 1j * one[:, 1] for one in borders]) - picture.corner
    table, (points,) = evenly(table, points)
    right = unit(1j * (points[table.shifted(1)] - points[table.shifted(-1)]))
    outside = sampled(picture.far, points + 2 * right) - sampled(picture.far, points - 2 * right)
    turned = np.bincount(table.loop, outside, len(table.count)) < 0
    row = np.arange(len(table))
    first, count = table.first[table.loop], table.count[table.loop]
    return table, points[np.where(turned[table.loop], 2 * first + count - 1 - row, row)]


def _brought(
    far: Distances, line: Border, table: Rings, pixels: ComplexArray, level: float
) -> tuple[ComplexArray, ComplexArray]:
    """Pixels at about ``level`` px from ``line``, brought there. far: the distance image of what ``line`` is around."""
    gap = sampled(far, pixels)
    about = pixels - gap * unit(gradient(far, pixels, _SEARCH))
    return iso_line(line, table, pixels, about, gap, level)
