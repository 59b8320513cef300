"""Lines and arcs cut at the edges of viewports and of clip paths.

A clip is a convex polygon. The line of a shape is kept where it lies in all of its clips.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.read.pieces import BoolArray

#: mm outside of an edge at which a point counts as inside, so that a line on the edge is kept.
_ON_EDGE = 1e-6

#: Points (N, 2) and bulges (N,) of an outline; the bulge of the last point of an open one is 0.
Outline = tuple[FloatArray, FloatArray]


class HalfPlanes(Struct, frozen=True, eq=False):
    """The edges of clips: a point is inside of edge k if normals[k] @ point <= limits[k].

    normals: (E, 2), unit vectors that point outwards.
    limits: (E,), mm.
    """

    normals: FloatArray
    limits: FloatArray


def make_half_planes(corners: FloatArray) -> HalfPlanes | None:
    """The edges of a convex polygon; None if the polygon is not convex or has no area.

    corners: (N, 2), in order, without a repeated first corner.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    is_convex = (turns > 0).all() or (turns < 0).all()
    if len(corners) not in (3, 4) or not is_convex or not np.isfinite(lengths).all():
        return None
    outwards = np.column_stack([edges[:, 1], -edges[:, 0]]) * np.sign(turns[0])
    normals = outwards / lengths[:, None]
    return HalfPlanes(normals, (normals * corners).sum(axis=1))


def join_half_planes(first: HalfPlanes | None, second: HalfPlanes) -> HalfPlanes:
    """The edges of two clips that both count."""
    if first is None:
        return second
    return HalfPlanes(
        np.concatenate([first.normals, second.normals]),
        np.concatenate([first.limits, second.limits]),
    )


def is_inside(points: FloatArray, clip: HalfPlanes) -> BoolArray:
    """Whether points (N, 2) lie in a clip."""
    return np.asarray((points @ clip.normals.T <= clip.limits + _ON_EDGE).all(axis=1))


def cut_outline(outline: Outline, is_closed: bool, clip: HalfPlanes) -> list[Outline] | None:
    """The parts of an outline in a clip, each open; None if all of it is inside.

    outline: points in mm; the last point of a closed outline is its first one.
    """
    points, bulges = outline
    safe = _is_surely_inside(points, bulges, clip)
    if safe.all():
        return None
    pieces: list[_Piece] = []
    is_cut = False
    for k, bulge in enumerate(bulges[:-1].tolist()):
        start, end = points[k], points[k + 1]
        crossings = [] if safe[k] else _find_crossings(start, end, bulge, clip)
        for first, last in pairwise([0.0, *crossings, 1.0]):
            middle = _point_on(start, end, bulge, (first + last) / 2)
            if not safe[k] and not is_inside(middle[None], clip)[0]:
                is_cut = True
                continue
            part = _Piece(
                [_point_on(start, end, bulge, first), _point_on(start, end, bulge, last)],
                [_part_of_bulge(bulge, last - first)],
            )
            if not pieces or not np.array_equal(pieces[-1].points[-1], part.points[0]):
                pieces.append(part)
            else:
                pieces[-1].append(part)
    if not is_cut:
        return None
    # The ends of a closed outline are one point.
    if is_closed and len(pieces) > 1:
        starts = np.array_equal(points[0], pieces[0].points[0])
        ends = np.array_equal(points[-1], pieces[-1].points[-1])
        if starts and ends:
            pieces[-1].append(pieces.pop(0))
    return [(np.array(p.points), np.array([*p.bulges, 0.0])) for p in pieces]


def _is_surely_inside(points: FloatArray, bulges: FloatArray, clip: HalfPlanes) -> BoolArray:
    """Whether each segment of an outline keeps so far from all edges that it cannot cross them."""
    distances = (clip.limits + _ON_EDGE - points @ clip.normals.T).min(axis=1)
    chords = np.hypot(*np.diff(points, axis=0).T)
    sizes = np.abs(bulges[:-1])
    # An arc of more than half a circle reaches beyond the ends of its chord.
    reaches = chords * sizes / 2 + np.where(sizes > 1, chords * sizes, 0.0)
    return np.asarray(np.minimum(distances[:-1], distances[1:]) >= reaches)


class _Piece(Struct):
    """A part of an outline: N points and the N - 1 bulges between them."""

    points: list[FloatArray]
    bulges: list[float]

    def append(self, other: _Piece) -> None:
        """Appends a part that starts at the end of this one."""
        self.points += other.points[1:]
        self.bulges += other.bulges


def _part_of_bulge(bulge: float, fraction: float) -> float:
    return bulge if fraction == 1 else math.tan(math.atan(bulge) * fraction)


def _point_on(start: FloatArray, end: FloatArray, bulge: float, fraction: float) -> FloatArray:
    """The point at a fraction of a line or of the angle of an arc."""
    if fraction in (0.0, 1.0):
        return end if fraction else start
    if bulge == 0:
        return start + (end - start) * fraction
    center, sweep = _find_center(start, end, bulge), 4 * math.atan(bulge)
    cosine, sine = math.cos(sweep * fraction), math.sin(sweep * fraction)
    x, y = (start - center).tolist()
    return np.asarray(center + np.array([cosine * x - sine * y, sine * x + cosine * y]))


def _find_center(start: FloatArray, end: FloatArray, bulge: float) -> FloatArray:
    chord = end - start
    normal = np.array([-chord[1], chord[0]])
    return np.asarray((start + end) / 2 + normal * (1 - bulge * bulge) / (4 * bulge))


def _find_crossings(
    start: FloatArray, end: FloatArray, bulge: float, clip: HalfPlanes
) -> list[float]:
    """Fractions between 0 and 1 at which a line or an arc crosses an edge, in order."""
    if bulge == 0:
        before, after = clip.normals @ start - clip.limits, clip.normals @ end - clip.limits
        crosses = (before > 0) != (after > 0)
        fractions = before[crosses] / (before[crosses] - after[crosses])
    else:
        center, sweep = _find_center(start, end, bulge), 4 * math.atan(bulge)
        radius = float(np.hypot(*(start - center)))
        offsets = (clip.limits - clip.normals @ center) / radius
        crosses = np.abs(offsets) < 1
        half = np.arccos(offsets[crosses])
        towards = np.arctan2(clip.normals[crosses, 1], clip.normals[crosses, 0])
        begin = math.atan2(start[1] - center[1], start[0] - center[0])
        angles = np.concatenate([towards - half, towards + half]) - begin
        fractions = (angles * math.copysign(1, sweep)) % (2 * math.pi) / abs(sweep)
    return sorted(f for f in fractions.tolist() if 1e-12 < f < 1 - 1e-12)
