"""Judges by points whether a program harms the part or the tool: their distances from every motion.

Nothing of the proof is used. Points beside the drawn lines and between them have the allowed depth,
a grid has the depth that was cut, and OpenCV finds the pieces that are connected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import cv2
import numpy as np
from numpy.typing import NDArray

import camgen
from bench.check.scenes import Rule, Scene, sample_outline
from bench.render.shapes import Pieces
from camgen.check.stock import Cut

Array = NDArray[np.float64]

#: Distance of the points from the lines, mm. Smaller harm is not seen.
LEAST_MM = 0.02
#: mm between points along the lines, between the other points, and between cells of the grid.
_ALONG, _BETWEEN, _CELL = 0.15, 0.7, 0.25
#: Width of the stock around the drawing, mm.
_MARGIN = 10.0
#: Number of level motions that replace a slanted one.
_STEPS = 40


@dataclass(frozen=True)
class Harm:
    """The harm of a program.

    gouge: depth of the deepest gouge, mm, 0 without one.
    rapid: whether a rapid motion meets material.
    loose: whether a part comes loose that tabs should hold.
    """

    gouge: float
    rapid: bool
    loose: bool

    @property
    def any(self) -> bool:
        """Whether there is harm of any kind."""
        return self.gouge > 0 or self.rapid or self.loose


@dataclass(frozen=True)
class _Motion:
    """A level motion.

    a, b: its ends, mm.
    sweep: angle of an arc, rad, positive counter-clockwise; 0 for a line.
    depth: mm below the top face.
    rapid: whether it is rapid.
    radius: radius of the tool, mm.
    lifts: whether the tool is above the part.
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
        # The rays of these points may cross a segment: their y lies between those of its ends.
        first = np.searchsorted(y, np.minimum(a, b)[:, 1]).tolist()
        last = np.searchsorted(y, np.maximum(a, b)[:, 1]).tolist()
        for (x1, y1), (x2, y2), i, j in zip(a.tolist(), b.tolist(), first, last, strict=True):
            odd[i:j] ^= x[i:j] < (x2 - x1) * (y[i:j] - y1) / (y2 - y1) + x1
    inside = np.zeros(len(points), dtype=bool)
    inside[order] = odd
    return inside


class Judge:
    """The allowed depth of a scene, at points and cells."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        lines = [sample_outline(contour, _ALONG) for contour in scene.contours]
        outlines = np.concatenate(lines)
        self.low, self.high = outlines.min(axis=0) - _MARGIN, outlines.max(axis=0) + _MARGIN
        points: list[Array] = []
        for line in lines:
            points += self._offset_points(line)
        x, y = self._grid(_BETWEEN)
        # Near a line, rounding would decide on which side a point is.
        near = np.zeros((len(y), len(x)), dtype=bool)
        box = []
        for k, axis in enumerate((x, y)):
            box.append(np.searchsorted(axis, outlines[:, k] - _ALONG).tolist())
            box.append(np.searchsorted(axis, outlines[:, k] + _ALONG).tolist())
        for left, right, low, high in zip(*box, strict=True):
            near[low:high, left:right] = True
        between = np.stack(np.meshgrid(x, y), -1)[~near]
        self.points = np.concatenate([*points, between])
        self.allowed = self._find_depths(self.points, scene.rules)

    def _grid(self, step: float) -> tuple[Array, Array]:
        """The x and the y of a grid over the stock, mm."""
        (left, bottom), (right, top) = self.low, self.high
        return np.arange(left, right, step), np.arange(bottom, top, step)

    @staticmethod
    def _offset_points(line: Array) -> list[Array]:
        """Points at ``LEAST_MM`` from a line, on both sides of it."""
        chord = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
        length = np.hypot(*chord.T)
        normal = np.column_stack([-chord[:, 1], chord[:, 0]]) / np.maximum(length, 1e-12)[:, None]
        # A corner has no normal: it gets one point inside, as far from both sides, and one outside.
        after = np.roll(line, -1, axis=0) - line
        step = np.hypot(*after.T)
        straight = np.abs(length - step - np.roll(step, 1)) < 1e-3
        unit = (after / step[:, None])[~straight]
        before = (np.roll(after, 1, axis=0) / np.roll(step, 1)[:, None])[~straight]
        inwards = (unit - before) / np.maximum(np.hypot(*(unit - before).T), 1e-12)[:, None]
        half = np.sqrt(np.maximum((1 + (unit * before).sum(axis=1)) / 2, 1e-3))[:, None]
        corners = line[~straight]
        corner_points = [corners + LEAST_MM / half * inwards, corners - LEAST_MM * inwards]
        sides = [(line + sign * LEAST_MM * normal)[straight] for sign in (-1, 1)]
        return sides + corner_points

    @staticmethod
    def _find_depths(points: Array, rules: tuple[Rule, ...]) -> Array:
        depth = np.zeros(len(points))
        for rule in rules:
            lines = []
            for contour in rule.contours:
                lines.append(
                    sample_outline(contour, 0.02) if contour.bulges.any() else contour.points
                )
            chosen = _even_odd(points, lines) == rule.inside
            depth[chosen] = np.maximum(depth[chosen], rule.depth)
        return depth

    @cached_property
    def cells(self) -> tuple[Array, Array]:
        """The x and the y of the cells, mm."""
        return self._grid(_CELL)

    def measure_harm(self, cuts: tuple[Cut, ...]) -> Harm:
        """The harm of cuts."""
        motions = list(chain.from_iterable(map(_list_motions, cuts)))
        deep = [motion for motion in motions if motion.depth > LEAST_MM]
        gouge = max((self._measure_gouge(motion) for motion in deep), default=0.0)
        return Harm(gouge, *self._run(motions))

    def _measure_gouge(self, motion: _Motion) -> float:
        shallow = np.flatnonzero(self.allowed < motion.depth - LEAST_MM)
        into = motion.radius - _measure_distance(self.points[shallow], motion)
        hit = into > 0
        up = motion.depth - self.allowed[shallow][hit]
        return float(np.minimum(into[hit] + LEAST_MM, up).max(initial=0.0))

    def _run(self, motions: list[_Motion]) -> tuple[bool, bool]:
        """Whether a rapid motion meets material, and whether the part comes loose too early."""
        x, y = self.cells
        removed = np.zeros((len(y), len(x)))
        rapid, free, loose = False, False, False
        for motion in motions:
            if motion.lifts and free:
                # A part that is cut free stays in its place until a motion cuts at it.
                loose |= self.scene.tabs
            if motion.depth <= LEAST_MM:
                continue
            rows, columns = self._find_box(motion)
            points = np.stack(np.meshgrid(x[columns], y[rows]), -1).reshape(-1, 2)
            view = removed[rows, columns]
            distance = _measure_distance(points, motion).reshape(view.shape)
            new = (distance < motion.radius - 0.05) & (view < motion.depth - LEAST_MM)
            rapid |= bool(motion.rapid and new.any())
            if free and np.count_nonzero(new) > 2:
                loose |= self._touches_part(motion)
            np.maximum(view, np.where(distance < motion.radius, motion.depth, 0.0), out=view)
            if not free and motion.depth > self.scene.thickness - LEAST_MM:
                free = self._is_free(removed)
        return rapid, loose or (free and self.scene.tabs)

    def _find_box(self, motion: _Motion) -> tuple[slice, slice]:
        """The rows and columns of the cells that a motion may reach."""
        places = _sample_motion(motion)
        low = np.array([places.real.min(), places.imag.min()]) - motion.radius - self.low
        high = np.array([places.real.max(), places.imag.max()]) + motion.radius - self.low
        first = np.maximum(np.floor(low / _CELL).astype(int), 0)
        last = np.maximum(np.ceil(high / _CELL).astype(int) + 1, 0)
        return slice(first[1], last[1]), slice(first[0], last[0])

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        """Mask of the cells of the part."""
        x, y = self.cells
        points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        return (self._find_depths(points, self.scene.rules) == 0).reshape(len(y), len(x))

    def _is_free(self, removed: Array) -> bool:
        """Whether the part is no longer connected with the rim of the stock."""
        if self.scene.rules[-1].inside:
            return False  # the part is not cut out
        left = (removed < self.scene.thickness - LEAST_MM).astype(np.uint8)
        _, label = cv2.connectedComponents(left, connectivity=4)
        of_part = np.unique(label[self._held & (left > 0)])
        rim = np.unique(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]))
        sizes = np.bincount(label.ravel())
        return not any(sizes[k] > 50 for k in np.intersect1d(of_part, rim).tolist() if k)

    def _touches_part(self, motion: _Motion) -> bool:
        """Whether the tool cuts at the part, not at waste."""
        held = self.points[self.allowed == 0]
        return bool((_measure_distance(held, motion) < motion.radius + 0.1).any())


def _list_motions(cut: Cut) -> list[_Motion]:
    """Level motions of a cut. A slanted motion is replaced by ``_STEPS`` of them."""
    motions: list[_Motion] = []
    before: complex | None = None
    height = 0.0
    radius = cut.tool.diameter / 2
    for item in cut.body:
        if not isinstance(item, (camgen.MoveJ, camgen.MoveL, camgen.MoveC)) or not isinstance(
            item.target, camgen.Pose
        ):
            continue
        x, y, z = item.target.origin
        end = complex(x, y)
        start = end if before is None else before
        rapid = isinstance(item, camgen.MoveJ)
        sweep = 0.0
        if isinstance(item, camgen.MoveC):
            sweep = _find_sweep(start, complex(*item.via.origin[:2]), end)
        level = _Motion(start, end, sweep, -z, rapid, radius, lifts=False)
        if abs(z - height) < 1e-9 or before is None:
            motions.append(level)
        elif abs(end - start) < 1e-9:
            if not (rapid and z > height):
                motions.append(replace(level, a=end, sweep=0.0, depth=-min(z, height)))
        else:
            places = _sample_motion(level, _STEPS + 1)
            for k in range(_STEPS):
                depth = -(height + (z - height) * (k + 0.5) / _STEPS)
                step = replace(level, a=places[k], b=places[k + 1], sweep=0.0, depth=depth)
                motions.append(step)
        if z > 0 and motions:
            motions.append(replace(level, a=end, sweep=0.0, lifts=True))
        before, height = end, z
    return motions


def _find_sweep(a: complex, via: complex, b: complex) -> float:
    """The angle of the arc through three points; 0 if they lie on a line.

    From its first chord to its second an arc turns by half its angle.
    """
    cross = ((b - a).conjugate() * (via - a)).imag
    if abs(cross) < 1e-9:
        return 0.0
    return 2 * float(np.angle((b - via) / (via - a)))


def _sample_motion(motion: _Motion, count: int = 33) -> NDArray[np.complex128]:
    return motion.piece.at(np.zeros(count, dtype=int), np.linspace(0, 1, count))[0]


def _measure_distance(points: Array, motion: _Motion) -> Array:
    """The distance of each point from a motion, (N,) mm."""
    places = points[:, 0] + 1j * points[:, 1]
    if abs(motion.b - motion.a) < 1e-12:
        return np.abs(places - motion.a)
    return motion.piece.distance(places)
