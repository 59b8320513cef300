"""What a program does to the material, worked out from its motions alone: slopes, and swept discs with shapely."""

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

#: Arcs are looked at as chords that leave them by less than this, mm.
FINE = 1e-3


class Cut(Struct, frozen=True):
    """A motion in a straight line, or a piece of an arc. path: its number. work: it runs along the path. arc: it is
    one piece of one.
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
        """How far it goes down, mm."""
        return self.start[2] - self.end[2]

    @property
    def run(self) -> float:
        """How far it goes, seen from above, mm."""
        return math.dist(self.start[:2], self.end[:2])


def cuts(program: Program) -> list[Cut]:
    """All motions with a known start and end, arcs in pieces."""
    found: list[Cut] = []
    here: Vec3 | None = None
    for item in program.body:
        if not isinstance(item, (MoveJ, MoveL, MoveC)):
            continue
        there = item.target.origin if isinstance(item.target, Pose) else None
        if here is not None and there is not None:
            for a, b in pairwise(_points(here, item, there)):
                arc, rapid = isinstance(item, MoveC), isinstance(item, MoveJ)
                work = not rapid and item.work
                found.append(Cut(a, b, item.speed, item.path, work, arc, rapid))
        here = there
    return found


def _points(here: Vec3, item: MoveJ | MoveL | MoveC, there: Vec3) -> list[Vec3]:
    if not isinstance(item, MoveC):
        return [here, there]
    middle, radius, axis, sweep = compute_circle(here, item.via.origin, there)
    count = max(1, math.ceil(sweep / (2 * math.acos(1 - FINE / radius)))) if radius > FINE else 1
    arm = np.subtract(here, middle)
    side = np.cross(axis, arm)
    turns = np.linspace(0, sweep, count + 1)
    points = [tuple((middle + math.cos(t) * arm + math.sin(t) * side).tolist()) for t in turns]
    return [here, *points[1:-1], there]


def below(found: list[Cut], level: float) -> Iterator[tuple[Vec3, Vec3]]:
    """The stretches of the cuts that are at ``level`` mm or below it."""
    for cut in found:
        a, b = np.array(cut.start), np.array(cut.end)
        if min(a[2], b[2]) > level:
            continue
        if max(a[2], b[2]) > level:
            between = a + (b - a) * (level - a[2]) / (b[2] - a[2])
            a, b = (between, b) if a[2] > level else (a, between)
        yield (tuple(a.tolist()), tuple(b.tolist()))


def swept(found: list[Cut], level: float, radius: float) -> Any:
    """What a flat tool of ``radius`` has removed at ``level``, as a shapely geometry."""
    lines = []
    for a, b in below(found, level):
        lines.append(
            shapely.Point(a[:2])
            if math.dist(a[:2], b[:2]) < 1e-9
            else shapely.LineString([a[:2], b[:2]])
        )
    return shapely.union_all([line.buffer(radius, quad_segs=32) for line in lines])
