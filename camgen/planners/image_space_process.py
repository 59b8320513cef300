"""Contact points, feed and force along the waypoints (PIST, sections 3.3 and 4.2.1)."""

from __future__ import annotations

import numpy as np

from camgen.geometry.segments import BoolArray, IntArray
from camgen.planners.image_space_border import CLOSE, Border, foot, near
from camgen.planners.image_space_rings import ComplexArray, Rings, held, unit
from camgen.pose import FloatArray

#: Part of the path's speed at which the contact point stands still: a sharp outer corner. Below the first it begins,
#: above the second it is over.
_STANDS, _MOVES = 0.1, 0.35
#: The tool centre is never slowed below this part of the feed, however tight the inner curve.
_SLOWEST = 0.02


def contact_points(points: ComplexArray, press: ComplexArray, distance: float) -> ComplexArray:
    """Where the tool should touch: each centre moved by the offset distance (px) along the force direction (eq. 10)."""
    return points + distance * press


def observed(table: Rings, points: ComplexArray, contacts: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """(N,) px by which the contact point runs along, and the tool centre, on the segment that ends in each row.

    Their quotient is the observed feed for a tool centre of speed 1. The distance of contact points in eq. (11) is in
    pixels and takes the path's own points to be one apart; on a border of pixels they are 1 or sqrt(2) apart, hence the
    division. Only what runs along the path counts, so that the sideways noise of the angles does not make the contact
    seem faster.
    """
    step = points - points[table.shifted(-1)]
    way = contacts - contacts[table.shifted(-1)]
    return np.asarray((way * unit(step).conj()).real), np.abs(step)


def averaged(table: Rings, along: FloatArray, step: FloatArray, contact: BoolArray, half: int) -> FloatArray:
    """(N,) observed feed for a tool centre of speed 1, over the segment of each row and ``half`` more on both sides.

    It is the change of an angle, in which the noise of the angle is many times as large: over a tool's radius it is no
    longer seen. Segments without contact are no part of it; 1 where there is no other.
    """
    row = table.along(np.arange(len(table))[:, None], np.arange(-half, half + 1))
    ran = np.where(contact, along, 0.0)[row].sum(axis=1)
    whole = np.where(contact, step, 0.0)[row].sum(axis=1)
    return np.where(whole > 0, np.maximum(ran, 0.0) / np.where(whole > 0, whole, 1.0), 1.0)


def feeds(ratio: FloatArray, contact: BoolArray, fastest: float) -> FloatArray:
    """(N,) feed of the tool centre as a multiple of the nominal feed: 1 / ratio (eq. 11), at most ``fastest`` (twice in
    the paper). Without contact there is nothing to hold constant: 1.
    """
    return np.where(contact, np.clip(1 / np.maximum(ratio, 1e-9), _SLOWEST, fastest), 1.0)


def touching(table: Rings, gap: FloatArray, tolerance: float) -> BoolArray:
    """(N,) where contact is expected [4.2.1]: lost where the contact point is more than ``tolerance`` px from the part,
    back at half of that.
    """
    return held(table, gap <= tolerance / 2, gap > tolerance, True)


def moving(table: Rings, along: FloatArray, step: FloatArray) -> BoolArray:
    """(N,) false at sharp outer corners, where the observed feed is near zero [4.2.1]."""
    return held(table, along >= _MOVES * step, along < _STANDS * step, True)


def nearest(edge: Border, contacts: ComplexArray) -> tuple[FloatArray, IntArray]:
    """The distance (N,) px from each contact point to the border of the part, and the row there; inf and -1 where none
    is near. It is the distance to the foreground mask of [4.2.1], to a fraction of a pixel.
    """
    start = near(edge, contacts)
    on, row = foot(edge, contacts, np.maximum(start, 0), CLOSE)
    return np.where(start >= 0, np.abs(contacts - on), np.inf), np.where(start >= 0, row, -1)
