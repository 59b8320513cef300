"""How much of the tool is in the material along the passes of a pocket."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from camgen.geometry.intersect import Obstacles
from camgen.geometry.ragged import owners, ramp
from camgen.geometry.segments import (
    IntArray,
    Segments,
    concatenate,
    from_contours,
    points_at,
    tangents_at,
)
from camgen.model.pose import FloatArray
from camgen.plan.pocket.channel import Channel
from camgen.plan.pocket.linking import find_outermost
from camgen.plan.pocket.regions import OffsetRegion

#: Places looked at on one segment at most, beside its end.
_MOST_PLACES = 6
#: The front of the tool is looked at in so many directions, and what lies between two of them is halved so often.
_DIRECTIONS, _HALVINGS = 13, 5
#: Material thinner than this share of the tool's radius is none: flat polygons of channels leave as much.
_CHIP = 0.02


def engagement(
    pieces: Sequence[OffsetRegion],
    channels: Sequence[Sequence[Channel]],
    radius: float,
    step: float,
    climb: bool,
) -> tuple[FloatArray, FloatArray]:
    """Radial engagements (M,) as shares of the diameter at places along the passes, and how long each lasts (M,), mm.

    channels: of each piece, those run before it in the outermost ones. What of the tool's front is in contact, from
    theta_1 to theta_2 round from the side of the walls, takes (cos theta_1 - cos theta_2) / 2 of its width; on a
    straight pass that is the step over the diameter. Pieces in which nothing was cut before are left out: there the
    tool cuts a slot.
    """
    shares, ways = [np.zeros(0)], [np.zeros(0)]
    distance = np.array([piece.distance for piece in pieces])
    inner = {piece.parent for piece in pieces}
    opened = [bool(channels[root]) for root in find_outermost(pieces)]
    clear = _clear(pieces, channels, radius)
    for level in np.unique(distance):
        at_level = np.flatnonzero(distance == level).tolist()
        rows = [k for k in at_level if k in inner or not pieces[k].is_whole or opened[k]]
        if rows:
            cleared = np.flatnonzero(
                (distance > level) & (distance <= level + 1.05 * step)
            ).tolist()
            chains, of = _gather(pieces, cleared)
            done = Obstacles(
                chains, np.array([pieces[k].pocket for k in cleared], dtype=np.int64)[of]
            )
            own, piece = _gather(pieces, rows)
            pocket = np.array([pieces[k].pocket for k in rows])[piece]
            share, way = _along(own, pocket, done, clear, radius, -1 if climb else 1)
            shares.append(share)
            ways.append(way)
    own_channels = [channel for own in channels for channel in own]
    shares += [channel.engagements for channel in own_channels]
    ways += [channel.lengths for channel in own_channels]
    return np.concatenate(shares), np.concatenate(ways)


def _clear(
    pieces: Sequence[OffsetRegion], channels: Sequence[Sequence[Channel]], radius: float
) -> dict[int, Any]:
    """What the channels of each pocket clear; what is thinner than a chip worth the name with it."""
    found: dict[int, list[Any]] = {}
    for piece, own in zip(pieces, channels, strict=True):
        found.setdefault(piece.pocket, []).extend(
            channel.make_polygon(radius * (1 + _CHIP)) for channel in own
        )
    made = {pocket: shapely.union_all(areas) for pocket, areas in found.items() if areas}
    for area in made.values():
        shapely.prepare(area)
    return made


def _gather(pieces: Sequence[OffsetRegion], rows: Sequence[int]) -> tuple[Segments, IntArray]:
    """All segments of the pieces ``rows``, and the place in ``rows`` of each."""
    parts = [chain for k in rows for chain in pieces[k].passes]
    of = np.repeat(
        np.arange(len(rows)), [sum(len(chain) for chain in pieces[k].passes) for k in rows]
    )
    return concatenate(parts) if parts else from_contours([]), of


def _along(
    chains: Segments,
    pocket: IntArray,
    done: Obstacles,
    clear: dict[int, Any],
    radius: float,
    side: int,
) -> tuple[FloatArray, FloatArray]:
    """Engagements and their lengths; pocket: (N,) of each segment. side: +1: the walls on the left."""
    count = np.clip(np.ceil(chains.length / radius), 1, _MOST_PLACES).astype(np.int64)
    row = owners(count)
    fraction = (ramp(count) + 0.5) / count[row]
    way = (chains.length / count)[row]
    # Ends as well, where corners are; a moment long.
    row = np.concatenate([row, np.arange(len(chains))])
    fraction, way = (
        np.concatenate([fraction, np.ones(len(chains))]),
        np.concatenate([way, np.zeros(len(chains))]),
    )
    places = chains.take(row)
    at, along = points_at(places, fraction), tangents_at(places, fraction)
    heading = np.arctan2(along[:, 1], along[:, 0])
    group = pocket[row]

    def in_contact(theta: FloatArray, which: IntArray) -> np.ndarray:
        """Whether there is material at ``theta`` from the side of the walls, forwards."""
        angle = heading[which] + side * (np.pi / 2 - theta)
        points = at[which] + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        contact = ~done.nearer_than(points, group[which], np.full(len(which), radius))
        for name, area in clear.items():
            rows = np.flatnonzero(contact & (group[which] == name))
            contact[rows] = ~shapely.contains_xy(area, points[rows])
        return contact

    every = np.arange(len(row))
    thetas = np.linspace(0.0, np.pi, _DIRECTIONS)
    contact = np.array([in_contact(np.full(len(every), theta), every) for theta in thetas])
    some = contact.any(axis=0)
    first = np.argmax(contact, axis=0)
    last = _DIRECTIONS - 1 - np.argmax(contact[::-1], axis=0)
    inside = thetas[np.stack([first, last])]
    outside = thetas[np.clip(np.stack([first - 1, last + 1]), 0, _DIRECTIONS - 1)]
    for k in range(2):
        for _ in range(_HALVINGS):
            middle = (inside[k] + outside[k]) / 2
            beyond = in_contact(middle, every)
            inside[k], outside[k] = (
                np.where(beyond, middle, inside[k]),
                np.where(beyond, outside[k], middle),
            )
    share = (np.cos(outside[0]) - np.cos(outside[1])) / 2
    return np.where(some, share, 0.0), way
