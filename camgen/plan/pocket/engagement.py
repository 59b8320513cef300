"""How much of the tool is in the material along the passes of a pocket."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.geometry.intersect import Obstacles
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import IntArray, Segments, points_at, tangents_at
from camgen.model.pose import FloatArray
from camgen.plan.pocket.chains import concatenate
from camgen.plan.pocket.rings import Piece

#: Places looked at on one segment at most, beside its end.
_MOST_PLACES = 6
#: The front of the tool is looked at in so many directions, and what lies between two of them is halved so often.
_DIRECTIONS, _HALVINGS = 13, 5


def engagement(pieces: Sequence[Piece], radius: float, step: float, climb: bool) -> tuple[FloatArray, FloatArray]:
    """Radial engagements (M,) as shares of the diameter at places along the passes, and how long each lasts (M,), mm.

    Of the material that lies before the tool, from the side of the walls on, theta is how far round it is in contact:
    (1 - cos theta) / 2, which on a straight pass is the step over the diameter. Pieces in which nothing was cut before
    are left out: there the tool cuts a slot.
    """
    shares, ways = [np.zeros(0)], [np.zeros(0)]
    distance = np.array([piece.distance for piece in pieces])
    inner = {piece.parent for piece in pieces}
    for level in np.unique(distance):
        rows = [k for k in np.flatnonzero(distance == level).tolist() if k in inner or not pieces[k].ring]
        cleared = np.flatnonzero((distance > level) & (distance <= level + 1.05 * step)).tolist()
        if rows and cleared:
            chains, of = _gather(pieces, cleared)
            done = Obstacles(chains, np.array([pieces[k].pocket for k in cleared])[of])
            own, piece = _gather(pieces, rows)
            pocket = np.array([pieces[k].pocket for k in rows])[piece]
            share, way = _along(own, pocket, done, radius, -1 if climb else 1)
            shares.append(share)
            ways.append(way)
    return np.concatenate(shares), np.concatenate(ways)


def _gather(pieces: Sequence[Piece], rows: Sequence[int]) -> tuple[Segments, IntArray]:
    """All segments of the pieces ``rows``, and the place in ``rows`` of each."""
    parts = [chain for k in rows for chain in pieces[k].chains]
    of = np.repeat(np.arange(len(rows)), [sum(len(chain) for chain in pieces[k].chains) for k in rows])
    return concatenate(parts), of


def _along(
    chains: Segments, pocket: IntArray, done: Obstacles, radius: float, side: int
) -> tuple[FloatArray, FloatArray]:
    """Engagements and their lengths; pocket: (N,) of each segment. side: +1: the walls on the left."""
    count = np.clip(np.ceil(chains.length / radius), 1, _MOST_PLACES).astype(np.int64)
    row = owners(count)
    fraction = (ramp(count) + 0.5) / count[row]
    way = (chains.length / count)[row]
    # Ends as well, where corners are; a moment long.
    row = np.concatenate([row, np.arange(len(chains))])
    fraction, way = np.concatenate([fraction, np.ones(len(chains))]), np.concatenate([way, np.zeros(len(chains))])
    places = chains.take(row)
    at, along = points_at(places, fraction), tangents_at(places, fraction)
    heading = np.arctan2(along[:, 1], along[:, 0])
    group = pocket[row]

    def in_contact(theta: FloatArray, which: IntArray) -> np.ndarray:
        """Whether there is material at ``theta`` from the side of the walls, forwards."""
        angle = heading[which] + side * (np.pi / 2 - theta)
        points = at[which] + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        return ~done.nearer_than(points, group[which], np.full(len(which), radius))

    every = np.arange(len(row))
    thetas = np.linspace(0.0, np.pi, _DIRECTIONS)
    contact = np.array([in_contact(np.full(len(every), theta), every) for theta in thetas])
    last = np.where(contact.any(axis=0), _DIRECTIONS - 1 - np.argmax(contact[::-1], axis=0), -1)
    low, high = thetas[np.maximum(last, 0)], thetas[np.minimum(np.maximum(last, 0) + 1, _DIRECTIONS - 1)]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        beyond = in_contact(middle, every)
        low, high = np.where(beyond, middle, low), np.where(beyond, high, middle)
    share = np.where(last < 0, 0.0, (1 - np.cos(high)) / 2)
    return share, way
