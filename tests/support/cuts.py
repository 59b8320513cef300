"""The cuts of a program, from its motions alone: slopes, and the area that a tool sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.arcs import compute_circle
from camgen.model.pose import Pose, Vec3
from camgen.model.program import MoveC, MoveJ, MoveL, Program

#: Arcs become chords that deviate from them by less than this, mm.
FINE = 1e-3


class Cut(Struct, frozen=True):
    """A straight motion, or a straight piece of an arc.

    start, end: mm.
    speed: mm/s.
    path: index of its path.
    work: whether it runs along the path.
    arc: whether it is a piece of an arc.
    rapid: whether it is a rapid motion.
    """

    start: Vec3
    end: Vec3
    speed: float
    path: int
    work: bool
    arc: bool
    rapid: bool

    @property
    def drop(self) -> float:
        """Distance downwards, mm."""
        return self.start[2] - self.end[2]

    @property
    def run(self) -> float:
        """Length of the motion in the plane, mm."""
        return math.dist(self.start[:2], self.end[:2])


def cuts(program: Program) -> list[Cut]:
    """The motions of a program with a known start and end. Arcs are split into pieces."""
    motions: list[Cut] = []
    start: Vec3 | None = None
    for item in program.body:
        if not isinstance(item, (MoveJ, MoveL, MoveC)):
            continue
        end = item.target.origin if isinstance(item.target, Pose) else None
        if start is not None and end is not None:
            for a, b in pairwise(_points(start, item, end)):
                arc, rapid = isinstance(item, MoveC), isinstance(item, MoveJ)
                work = not rapid and item.work
                motions.append(Cut(a, b, item.speed, item.path, work, arc, rapid))
        start = end
    return motions


def _points(start: Vec3, item: MoveJ | MoveL | MoveC, end: Vec3) -> list[Vec3]:
    if not isinstance(item, MoveC):
        return [start, end]
    middle, radius, axis, sweep = compute_circle(start, item.via.origin, end)
    count = max(1, math.ceil(sweep / (2 * math.acos(1 - FINE / radius)))) if radius > FINE else 1
    arm = np.subtract(start, middle)
    side = np.cross(axis, arm)
    angles = np.linspace(0, sweep, count + 1)
    points = [tuple((middle + math.cos(t) * arm + math.sin(t) * side).tolist()) for t in angles]
    return [start, *points[1:-1], end]


def below(motions: list[Cut], level: float) -> Iterator[tuple[Vec3, Vec3]]:
    """The ends of those parts of the cuts that are at the height `level` (mm) or below it."""
    for cut in motions:
        a, b = np.array(cut.start), np.array(cut.end)
        if min(a[2], b[2]) > level:
            continue
        if max(a[2], b[2]) > level:
            between = a + (b - a) * (level - a[2]) / (b[2] - a[2])
            a, b = (between, b) if a[2] > level else (a, between)
        yield (tuple(a.tolist()), tuple(b.tolist()))


def swept(motions: list[Cut], level: float, radius: float) -> Any:
    """The area that a flat tool of `radius` mm has removed at the height `level`, mm."""
    lines = []
    for a, b in below(motions, level):
        lines.append(
            shapely.Point(a[:2])
            if math.dist(a[:2], b[:2]) < 1e-9
            else shapely.LineString([a[:2], b[:2]])
        )
    return shapely.union_all([line.buffer(radius, quad_segs=32) for line in lines])
