"""Solids that links sweep about an axis: each holds its link at all angles of the joint.

A rotation about the axis does not change the solid. Many links of an arm are nearly round about the
axis of one of their joints, so the solid of such a link is hardly larger than the link.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from msgspec import Struct

from camgen.collision.mesh import join_surfaces, make_model
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.vectors import measure_lengths
from camgen.model.pose import FloatArray, Vec3
from camgen.robots.models import Link

#: Maximum number of discs of a solid; neighbours are merged if their radii differ by less, mm.
_DISCS, _SAME_RADIUS_MM = 64, 0.1
#: Sides of the prism around a disc.
_SIDES = 32
#: mm by which discs are larger than computed, for rounding.
_ROUNDING_MM = 1e-6


class SweptSolid(Struct, frozen=True, eq=False):
    """A stack of discs about an axis, in the frame of the link.

    heights: (n + 1,) ends of the discs along the axis, mm.
    radii: (n,) their radii, mm.
    origin: (3,) point on the axis from which heights count.
    axis: (3,) its direction, a unit vector.
    model: model of fcl of prisms around the discs.
    """

    heights: FloatArray
    radii: FloatArray
    origin: FloatArray
    axis: FloatArray
    model: Any

    def holds_any(self, points: FloatArray, rotation: FloatArray, origin: FloatArray) -> bool:
        """Whether any of points (N, 3) is in a prism.

        rotation, origin: pose of the link in the frame of the points.
        """
        axis = rotation @ self.axis
        start = origin + rotation @ self.origin
        height = points @ axis - start @ axis
        near = np.flatnonzero((height >= self.heights[0]) & (height <= self.heights[-1]))
        disc = (np.searchsorted(self.heights, height[near]) - 1).clip(0)
        radius = np.linalg.norm(points[near] - start - height[near, None] * axis, axis=1)
        return bool((radius * math.cos(math.pi / _SIDES) <= self.radii[disc]).any())


def enlarge_levers(levers: FloatArray) -> FloatArray:
    """The levers of the solid of a link, which is a little larger than the link."""
    return np.asarray((levers + _SAME_RADIUS_MM) / math.cos(math.pi / _SIDES))


@lru_cache(maxsize=64)
def measure_roundness(link: Link, origin: Vec3, axis: Vec3) -> float:
    """The volume of a cylinder about an axis that holds a link, divided by that of its cuboids."""
    vertices, _ = join_surfaces(link)
    height, radius = _measure(vertices, origin, axis)
    cuboids = sum(8 * math.prod(box.half) for box in link.boxes)
    return math.pi * float(radius.max()) ** 2 * float(np.ptp(height)) / cuboids


@lru_cache(maxsize=64)
def sweep(link: Link, origin: Vec3, axis: Vec3) -> SweptSolid:
    """The solid that a link sweeps about an axis, a unit vector through `origin`.

    The part of a triangle between two heights is farthest from the axis at one of its corners: a
    corner of the triangle, or the point at which a side crosses one of the heights.
    """
    vertices, faces = join_surfaces(link)
    height, radius = _measure(vertices, origin, axis)
    planes = np.linspace(height.min(), height.max(), _DISCS + 1)
    size = max(float(planes[-1] - planes[0]), _ROUNDING_MM) / _DISCS
    lower, upper = (
        ((height + shift - planes[0]) // size).astype(np.int64).clip(0, _DISCS - 1)
        for shift in (-_ROUNDING_MM, _ROUNDING_MM)
    )
    radii = np.zeros(_DISCS)
    np.maximum.at(radii, upper, radius)
    sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    falls = height[sides[:, 0]] > height[sides[:, 1]]
    begin, end = np.where(falls[:, None], sides[:, ::-1], sides).T
    crosses = lower[begin] < upper[end]
    begin, end = begin[crosses], end[crosses]
    counts = upper[end] - lower[begin]
    side = list_owners(counts)
    disc = lower[begin][side] + number_rows(counts)
    rise = (height[end] - height[begin])[side]
    fraction = (planes[disc + 1] - height[begin][side]) / np.where(rise > 0, rise, 1.0)
    first, last = vertices[begin][side], vertices[end][side]
    _, distance = _measure(first + fraction.clip(0.0, 1.0)[:, None] * (last - first), origin, axis)
    np.maximum.at(radii, disc, distance)
    np.maximum.at(radii, disc + 1, distance)
    starts = [0]
    for number in range(1, _DISCS):
        if np.ptp(radii[starts[-1] : number + 1]) > _SAME_RADIUS_MM:
            starts.append(number)
    heights = planes[[*starts, _DISCS]]
    heights[[0, -1]] += (-_ROUNDING_MM, _ROUNDING_MM)
    radii = np.maximum.reduceat(radii, starts) + _ROUNDING_MM
    start, along = np.array(origin), np.array(axis)
    return SweptSolid(heights, radii, start, along, _make_prisms(heights, radii, start, along))


def _measure(points: FloatArray, origin: Vec3, axis: Vec3) -> tuple[FloatArray, FloatArray]:
    """Heights (N,) of points (N, 3) along an axis, and distances from it, mm."""
    shifted = points - np.array(origin)
    height = shifted @ np.array(axis)
    return height, measure_lengths(shifted - height[:, None] * np.array(axis))


def _make_prisms(
    heights: FloatArray, radii: FloatArray, origin: FloatArray, axis: FloatArray
) -> Any:
    """The model of fcl of prisms around discs: one surface with two rings of corners per disc."""
    across = np.linalg.svd(axis[None])[2][1:]
    angles = math.tau / _SIDES * np.arange(_SIDES)
    circle = np.column_stack([np.cos(angles), np.sin(angles)]) @ across
    radius = np.repeat(radii, 2) / math.cos(math.pi / _SIDES)
    middles = origin + np.repeat(heights, 2)[1:-1, None] * axis
    corners = (middles[:, None] + radius[:, None, None] * circle).reshape(-1, 3)
    low = np.arange(len(corners) - _SIDES)
    following = low // _SIDES * _SIDES + (low + 1) % _SIDES
    number = np.arange(1, _SIDES - 1)
    end = np.column_stack([0 * number, number, number + 1])
    faces = np.concatenate(
        [
            np.column_stack([low, following, low + _SIDES]),
            np.column_stack([following, following + _SIDES, low + _SIDES]),
            end,
            end + len(corners) - _SIDES,
        ]
    )
    return make_model(corners, faces)
