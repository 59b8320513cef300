"""Whether a program harms the part or the tool, told by points: distances of many of them from every motion.

Nothing of the proof is used: points beside the drawn lines and in between say what may be cut how deep, a grid of
depths what is gone, and OpenCV what hangs together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

import camgen
from bench.check.scenes import Rule, Scene, outline
from bench.render.shapes import Pieces
from camgen.check.stock import Cut

Array = NDArray[np.float64]

#: Harm that is smaller is none, mm: points stand so far from the lines.
LEAST_MM = 0.02
#: Points along the lines, points in between, cells of the grid, and the stock around the drawing, mm.
_ALONG, _BETWEEN, _CELL, _MARGIN = 0.15, 0.7, 0.25, 10.0
#: A slanted motion is so many level ones.
_STEPS = 40


@dataclass(frozen=True)
class Harm:
    """gouge: mm of the deepest, 0: none. rapid: through material. loose: a part that should be held is not."""

    gouge: float
    rapid: bool
    loose: bool

    @property
    def any(self) -> bool:
        """Whether there is any."""
        return self.gouge > 0 or self.rapid or self.loose


@dataclass(frozen=True)
class _Way:
    """A level motion.

    a, b: its ends, mm.
    sweep: angle of an arc, rad, positive counter-clockwise; 0 for a line.
    depth: mm below the top face.
    """

    a: complex
    b: complex
    sweep: float
    depth: float
    rapid: bool
    radius: float
    lifts: bool

    @property
    def piece(self) -> Pieces:
        """The motion as a line or an arc."""
        return Pieces(np.array([self.a]), np.array([self.b - self.a]), np.array([self.sweep]))


def _even_odd(points: Array, lines: list[Array]) -> NDArray[np.bool_]:
    """(N,) whether a ray to the right crosses the lines an odd number of times."""
    order = np.argsort(points[:, 1])
    x, y = points[order].T
    odd = np.zeros(len(points), dtype=bool)
    for line in lines:
        a, b = line, np.roll(line, -1, axis=0)
        # Only points as high as a line can have it on their right.
        first, last = (
            np.searchsorted(y, ends) for ends in (np.minimum(a, b)[:, 1], np.maximum(a, b)[:, 1])
        )
        for (ax, ay), (bx, by), i, j in zip(
            a.tolist(), b.tolist(), first.tolist(), last.tolist(), strict=True
        ):
            odd[i:j] ^= x[i:j] < (bx - ax) * (y[i:j] - ay) / (by - ay) + ax
    inside = np.zeros(len(points), dtype=bool)
    inside[order] = odd
    return inside


class Judge:
    """What a scene allows, at points and cells."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        lines = [outline(contour, _ALONG) for contour in scene.contours]
        every = np.concatenate(lines)
        self.low, self.high = every.min(axis=0) - _MARGIN, every.max(axis=0) + _MARGIN
        beside = [side for line in lines for side in self._beside(line)]
        x, y = (np.arange(a, b, _BETWEEN) for a, b in zip(self.low, self.high, strict=True))
        # None of them near a line, where rounding would tell on which side it is.
        near = np.zeros((len(y), len(x)), dtype=bool)
        ends = (
            np.searchsorted(some, every[:, k] + sign * _ALONG)
            for k, some in enumerate((x, y))
            for sign in (-1, 1)
        )
        for left, right, low, high in zip(*(end.tolist() for end in ends), strict=True):
            near[low:high, left:right] = True
        between = np.stack(np.meshgrid(x, y), -1)[~near]
        self.points = np.concatenate([*beside, between])
        self.allowed = self._depths(self.points, scene.rules)

    @staticmethod
    def _beside(line: Array) -> list[Array]:
        way = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
        length = np.hypot(*way.T)
        normal = np.column_stack([-way[:, 1], way[:, 0]]) / np.maximum(length, 1e-12)[:, None]
        # At corners the normal is neither side's: one point in the corner, as far from both sides, and one outside.
        after = np.roll(line, -1, axis=0) - line
        step = np.hypot(*after.T)
        straight = np.abs(length - step - np.roll(step, 1)) < 1e-3
        unit = (after / step[:, None])[~straight]
        before = (np.roll(after, 1, axis=0) / np.roll(step, 1)[:, None])[~straight]
        inwards = (unit - before) / np.maximum(np.hypot(*(unit - before).T), 1e-12)[:, None]
        half = np.sqrt(np.maximum((1 + (unit * before).sum(axis=1)) / 2, 1e-3))[:, None]
        corners = line[~straight]
        corner_points = [corners + LEAST_MM / half * inwards, corners - LEAST_MM * inwards]
        return [*((line + sign * LEAST_MM * normal)[straight] for sign in (-1, 1)), *corner_points]

    @staticmethod
    def _depths(points: Array, rules: tuple[Rule, ...]) -> Array:
        depth = np.zeros(len(points))
        for rule in rules:
            lines = [
                outline(contour, 0.02) if contour.bulges.any() else contour.points
                for contour in rule.contours
            ]
            chosen = _even_odd(points, lines) == rule.inside
            depth[chosen] = np.maximum(depth[chosen], rule.depth)
        return depth

    @cached_property
    def cells(self) -> tuple[Array, Array]:
        """Of the grid, x and y."""
        x, y = (np.arange(a, b, _CELL) for a, b in zip(self.low, self.high, strict=True))
        return x, y

    def judge(self, cuts: tuple[Cut, ...]) -> Harm:
        """The harm that ``cuts`` do."""
        ways = [way for cut in cuts for way in _ways(cut)]
        gouge = max((self._gouge(way) for way in ways if way.depth > LEAST_MM), default=0.0)
        rapid, loose = self._run(ways)
        return Harm(gouge, rapid, loose)

    def _gouge(self, way: _Way) -> float:
        deep = np.flatnonzero(self.allowed < way.depth - LEAST_MM)
        into = way.radius - _apart(self.points[deep], way)
        hit = into > 0
        up = way.depth - self.allowed[deep][hit]
        return float(np.minimum(into[hit] + LEAST_MM, up).max(initial=0.0))

    def _run(self, ways: list[_Way]) -> tuple[bool, bool]:
        """Whether a rapid motion meets material, and whether the part comes loose too early, in order of time."""
        x, y = self.cells
        gone = np.zeros((len(y), len(x)))
        rapid, free, loose = False, False, False
        for way in ways:
            if way.lifts and free:
                # What is cut free stays; whatever cuts at it from here on moves it.
                loose |= self.scene.tabs
            if way.depth <= LEAST_MM:
                continue
            rows, columns = self._box(way)
            part = np.stack(np.meshgrid(x[columns], y[rows]), -1).reshape(-1, 2)
            apart = _apart(part, way).reshape(gone[rows, columns].shape)
            view = gone[rows, columns]
            new = (apart < way.radius - 0.05) & (view < way.depth - LEAST_MM)
            rapid |= bool(way.rapid and new.any())
            if free and new.any():
                loose |= self._at_part(part[new.ravel()], way)
            np.maximum(view, np.where(apart < way.radius, way.depth, 0.0), out=view)
            if not free and way.depth > self.scene.thickness - LEAST_MM:
                free = self._is_free(gone)
        return rapid, loose or (free and self.scene.tabs)

    def _box(self, way: _Way) -> tuple[slice, slice]:
        places = _samples(way)
        low = np.array([places.real.min(), places.imag.min()]) - way.radius - self.low
        high = np.array([places.real.max(), places.imag.max()]) + way.radius - self.low
        first = np.maximum(np.floor(low / _CELL).astype(int), 0)
        last = np.maximum(np.ceil(high / _CELL).astype(int) + 1, 0)
        return slice(first[1], last[1]), slice(first[0], last[0])

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        """Cells of the part, which hang together with nothing else in the end."""
        x, y = self.cells
        points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        return (self._depths(points, self.scene.rules) == 0).reshape(len(y), len(x))

    def _is_free(self, gone: Array) -> bool:
        if self.scene.rules[-1].inside:
            return False  # the part is not cut out
        left = (gone < self.scene.thickness - LEAST_MM).astype(np.uint8)
        _, label = cv2.connectedComponents(left, connectivity=4)
        of_part = np.unique(label[self._held & (left > 0)])
        rim = np.unique(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]))
        sizes = np.bincount(label.ravel())
        return not any(sizes[k] > 50 for k in np.intersect1d(of_part, rim).tolist() if k)

    def _at_part(self, points: Array, way: _Way) -> bool:
        """Whether new cells are beside the part: the tool cuts at it, not at waste."""
        held = self.points[self.allowed == 0]
        return bool((_apart(held, way) < way.radius + 0.1).any()) and len(points) > 2


def _ways(cut: Cut) -> list[_Way]:
    """Level motions of a cut; what goes down slantwise in steps."""
    found: list[_Way] = []
    here: complex | None = None
    height = 0.0
    radius = cut.tool.diameter / 2
    for item in cut.body:
        if not isinstance(item, (camgen.MoveJ, camgen.MoveL, camgen.MoveC)) or not isinstance(
            item.target, camgen.Pose
        ):
            continue
        x, y, z = item.target.origin
        there = complex(x, y)
        start = there if here is None else here
        rapid = isinstance(item, camgen.MoveJ)
        sweep = 0.0
        if isinstance(item, camgen.MoveC):
            sweep = _sweep(start, complex(*item.via.origin[:2]), there)
        if abs(z - height) < 1e-9 or here is None:
            found.append(_Way(start, there, sweep, -z, rapid, radius, lifts=False))
        elif abs(there - start) < 1e-9:
            if not (rapid and z > height):
                found.append(_Way(there, there, 0.0, -min(z, height), rapid, radius, lifts=False))
        else:
            places = _samples(_Way(start, there, sweep, 0, rapid, radius, lifts=False), _STEPS + 1)
            for k in range(_STEPS):
                depth = -(height + (z - height) * (k + 0.5) / _STEPS)
                found.append(_Way(places[k], places[k + 1], 0.0, depth, rapid, radius, lifts=False))
        if z > 0 and found:
            found.append(_Way(there, there, 0.0, -z, rapid, radius, lifts=True))
        here, height = there, z
    return found


def _sweep(a: complex, via: complex, b: complex) -> float:
    """The angle of the arc through three points; 0 if they lie on a line.

    From its first chord to its second an arc turns by half its angle.
    """
    cross = ((b - a).conjugate() * (via - a)).imag
    if abs(cross) < 1e-9:
        return 0.0
    return 2 * float(np.angle((b - via) / (via - a)))


def _samples(way: _Way, count: int = 33) -> NDArray[np.complex128]:
    return way.piece.at(np.zeros(count, dtype=int), np.linspace(0, 1, count))[0]


def _apart(points: Array, way: _Way) -> Array:
    """(N,) mm from each point to the way."""
    places = points[:, 0] + 1j * points[:, 1]
    if abs(way.b - way.a) < 1e-12:
        return np.abs(places - way.a)
    return way.piece.distance(places)
