"""Measures the engagement of the tool along the passes of a pocket."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
import shapely

from camgen.geometry.intersect import Obstacles
from camgen.geometry.ragged import count_rows, list_owners, number_rows
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    make_contour_segments,
    points_at,
    tangents_at,
)
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.plan.pocket.channel import Channel, unite_channels
from camgen.plan.pocket.linking import find_outermost, group_channels
from camgen.plan.pocket.regions import OffsetRegion

#: Maximum number of samples on one segment, in addition to its end.
_MAX_SAMPLES = 6
#: Directions on the front of the tool that are tested for material.
_DIRECTIONS = 13
#: Bisection steps between two of these directions.
_HALVINGS = 5
#: Fraction of the tool radius. Thinner material does not count, because the polygons of channels
#: deviate from the cleared area by as much.
_CHIP_FRACTION = 0.02
#: Passes that are cut before a pass are at most this many stepovers farther from the walls.
_REACHED_STEPOVERS = 1.05


def measure_engagement(
    regions: Sequence[OffsetRegion],
    channels: Sequence[Sequence[Channel]],
    radius: float,
    stepover: float,
    climb: bool,
) -> tuple[FloatArray, FloatArray]:
    """Engagements (M,) along all passes and channels, and the length (M,) of each, mm.

    The material is on a part of the tool's front, from theta_1 to theta_2. Both angles start at
    the side of the walls. So the engagement is (cos theta_1 - cos theta_2) / 2. On a straight pass
    this is the stepover divided by the diameter.

    Regions that the tool enters without a channel are left out: there the first pass is a slot.

    channels: channels of each region, which are cut before it; only outermost regions have any.
    radius: tool radius, mm.
    stepover: mm.
    climb: whether the material is on the right of the direction of travel.
    """
    engagements, lengths = [np.zeros(0)], [np.zeros(0)]
    distance = np.array([region.distance for region in regions])
    parents = {region.parent for region in regions}
    root_channels = take_rows(channels, find_outermost(regions))
    cleared = _make_cleared_areas(regions, channels, radius)
    for current in np.unique(distance):
        at_distance = np.flatnonzero(distance == current).tolist()
        rows = []
        for k in at_distance:
            if k in parents or not regions[k].is_whole or root_channels[k]:
                rows.append(k)
        if rows:
            is_before = (distance > current) & (distance <= current + _REACHED_STEPOVERS * stepover)
            before = Obstacles(*_gather_passes(regions, np.flatnonzero(is_before).tolist()))
            passes, pocket = _gather_passes(regions, rows)
            wall_side = -1 if climb else 1
            sampled = _sample_engagement(passes, pocket, before, cleared, radius, wall_side)
            engagements.append(sampled[0])
            lengths.append(sampled[1])
    for channel in chain.from_iterable(channels):
        engagements.append(channel.engagements)
        lengths.append(channel.lengths)
    return np.concatenate(engagements), np.concatenate(lengths)


def _make_cleared_areas(
    regions: Sequence[OffsetRegion], channels: Sequence[Sequence[Channel]], radius: float
) -> dict[int, Any]:
    """The area that channels clear, by pocket, with strips that are too thin to count.

    Pockets without channels are left out.
    """
    cleared = {}
    for pocket, pocket_channels in group_channels(regions, channels).items():
        cleared[pocket] = unite_channels(pocket_channels, radius * (1 + _CHIP_FRACTION))
        shapely.prepare(cleared[pocket])
    return cleared


def _gather_passes(
    regions: Sequence[OffsetRegion], rows: Sequence[int]
) -> tuple[Segments, IntArray]:
    passes: list[Segments] = []
    pockets: list[int] = []
    for k in rows:
        passes += regions[k].passes
        pockets += [regions[k].pocket] * len(regions[k].passes)
    pocket = np.repeat(np.array(pockets, dtype=np.int64), count_rows(passes))
    return concatenate(passes) if passes else make_contour_segments([]), pocket


def _sample_engagement(
    passes: Segments,
    pocket: IntArray,
    before: Obstacles,
    cleared: dict[int, Any],
    radius: float,
    wall_side: int,
) -> tuple[FloatArray, FloatArray]:
    """Engagements (M,) at samples of N segments, and the length (M,) of each sample, mm.

    pocket: (N,) pocket of each segment.
    before: passes that are cut before, grouped by pocket.
    cleared: area that channels clear, by pocket.
    radius: tool radius, mm.
    wall_side: 1 if the walls are on the left of the direction of travel, -1 if on the right.
    """
    count = np.clip(np.ceil(passes.length / radius), 1, _MAX_SAMPLES).astype(np.int64)
    row = list_owners(count)
    fraction = (number_rows(count) + 0.5) / count[row]
    length = (passes.length / count)[row]
    # The ends are samples without a length: engagement is highest at corners.
    row = np.concatenate([row, np.arange(len(passes))])
    fraction = np.concatenate([fraction, np.ones(len(passes))])
    length = np.concatenate([length, np.zeros(len(passes))])
    segments = passes.take(row)
    centre, direction = points_at(segments, fraction), tangents_at(segments, fraction)
    heading = np.arctan2(direction[:, 1], direction[:, 0])
    sample_pocket = pocket[row]

    def is_in_contact(theta: FloatArray) -> BoolArray:
        """Whether there is material at angles `theta` (K, M) from the side of the walls, rad."""
        angle = (heading + wall_side * (np.pi / 2 - theta)).ravel()
        times = len(theta)
        points = np.tile(centre, (times, 1))
        points += radius * np.column_stack([np.cos(angle), np.sin(angle)])
        pockets = np.tile(sample_pocket, times)
        contact = ~before.nearer_than(points, pockets, np.full(len(points), radius))
        for cleared_pocket, area in cleared.items():
            rows = np.flatnonzero(contact & (pockets == cleared_pocket))
            contact[rows] = ~shapely.contains_xy(area, points[rows])
        return contact.reshape(theta.shape)

    thetas = np.linspace(0.0, np.pi, _DIRECTIONS)
    contact = is_in_contact(np.repeat(thetas[:, None], len(row), axis=1))
    is_engaged = contact.any(axis=0)
    first = np.argmax(contact, axis=0)
    last = _DIRECTIONS - 1 - np.argmax(contact[::-1], axis=0)
    # Bisection of both ends of the front between a direction in the material and one outside.
    inside = thetas[np.stack([first, last])]
    outside = thetas[np.clip(np.stack([first - 1, last + 1]), 0, _DIRECTIONS - 1)]
    for _ in range(_HALVINGS):
        middle = (inside + outside) / 2
        contact = is_in_contact(middle)
        inside, outside = np.where(contact, middle, inside), np.where(contact, outside, middle)
    return np.where(is_engaged, (np.cos(outside[0]) - np.cos(outside[1])) / 2, 0.0), length
