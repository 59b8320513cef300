"""A photo laid on a drawing: the turn and the shift that bring outlines onto outlines, whatever is too much or missing.

Iterated closest points (Besl and McKay 1992) with distances to lines instead of points (Chen and Medioni 1991), under
Tukey's weights: burrs and gaps count nothing in the end. It starts from where the photo says that the part lies, and
from turns all around with both middles on each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import CamgenError, InputError
from camgen.model.pose import FloatArray, PlanePose
from camgen.model.tolerance import SIGMAS_OF_MEDIAN

#: Turns that are tried first; points of each outline then, and at last.
_TURNS, _FEW, _MANY = 36, 400, 6000
_ROUNDS, _FINE_ROUNDS = 15, 40
#: Tukey's biweight, and the least deviation that it is used with, mm.
_TUKEY, _LEAST_SIGMA = 4.685, 0.01
#: Points count as fitting within this part of the size of the drawing.
_NEAR_SHARE = 0.005
#: Another turn fits as well where it fits so many of the points that the best one fits.
_AS_WELL = 0.99
#: Turns nearer to each other than this are one, rad.
_SAME_TURN = 0.05


class Fit(Struct, frozen=True):
    """drawing_from_photo.

    turn: rad, before the shift.
    shift: mm.
    share: share of the points of the photo that fit.
    rms: distance of those, mm.
    near: points fit within this distance, mm.
    rivals: fits with another turn that are as good.
    """

    turn: float
    shift: tuple[float, float]
    share: float
    rms: float
    near: float = 0.0
    rivals: tuple[Fit, ...] = ()

    @property
    def rival_turns(self) -> tuple[float, ...]:
        """Further turns of the photo by which it fits as well, rad."""
        turns = (math.remainder(rival.turn - self.turn, math.tau) for rival in self.rivals)
        return tuple(sorted(turns))

    @property
    def photo_from_drawing(self) -> PlanePose:
        """The place of the drawing in the photo."""
        return PlanePose(self.turn, *self.shift).inverse()

    def apply(self, points: FloatArray) -> FloatArray:
        """``points`` (N, 2) of the photo in the drawing's frame."""
        return PlanePose(self.turn, *self.shift).apply(points)


class _Line(Struct, frozen=True, eq=False):
    """The expected outline, in mm.

    tree: index of its pieces.
    start, end, normal: (N, 2), ends and unit normal of each piece.
    size: diagonal of its box.
    """

    tree: shapely.STRtree
    start: FloatArray
    end: FloatArray
    normal: FloatArray
    size: float


def lay_on(
    borders: Sequence[FloatArray], region: shapely.Geometry, turn: float | None = None
) -> Fit:
    """The pose that brings ``borders`` (N, 2) mm of a photo onto the outline of ``region``.

    turn: rad. The nearest of the poses that fit as well is taken; None is a turn of 0, which is
        searched from where the photo shows the part.
    """
    line = _line(region)
    points = np.concatenate(borders)
    few, many = (_some(points, count) for count in (_FEW, _MANY))
    near = max(_NEAR_SHARE * line.size, 0.2)
    middles = _Middles.of(borders, region)
    starts = [middles.fit(k * math.tau / _TURNS) for k in range(_TURNS)]
    starts.insert(0, Fit(0.0, (0.0, 0.0), 0.0, 0.0) if turn is None else middles.fit(turn))
    tried = [
        _score(_refine(line, few, start, _ROUNDS, line.size / 10), line, few, near)
        for start in starts
    ]
    best = max(tried, key=lambda fit: (round(fit.share, 2), -fit.rms))
    alike = [
        fit
        for fit in tried
        if fit.share >= _AS_WELL * best.share and fit.rms <= 1.5 * best.rms + 0.02
    ]
    # Of turns that fit as well the least: the part lies as the photo says, more or less.
    wanted = turn or 0.0
    chosen = min(alike, key=lambda fit: round(abs(math.remainder(fit.turn - wanted, math.tau)), 1))
    found = _score(_refine(line, many, chosen, _FINE_ROUNDS, near * 3), line, many, near)
    return replace(found, near=near, rivals=_rivals(alike, chosen))


def insist_on_fit(
    name: str,
    source: str,
    share: float,
    near: float,
    least: float,
    refusal: type[CamgenError] = InputError,
) -> None:
    """Raises ``refusal`` if the ``share`` of outlines within ``near`` mm is below ``least``."""
    if share < least:
        what = f"does not show {source}: {100 * share:.0f} % of its outline lies within {near:.2f} mm of that"
        remedy = "give the drawing of this part, check the scale of the photo, or its mask by camgen inspect"
        raise refusal(name, what, f"{100 * least:.0f} % must", remedy)


def _line(region: shapely.Geometry) -> _Line:
    ends = [np.asarray(ring.coords) for ring in shapely.get_parts(shapely.boundary(region))]
    start = np.concatenate([ring[:-1] for ring in ends])
    end = np.concatenate([ring[1:] for ring in ends])
    long = np.linalg.norm(end - start, axis=1) > 1e-9
    start, end = start[long], end[long]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    tree = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
    size = float(np.hypot(*np.ptp(np.concatenate([start, end]), axis=0)))
    return _Line(tree, start, end, normal, size)


def _some(points: FloatArray, count: int) -> FloatArray:
    return points[:: max(1, len(points) // count)]


class _Middles(NamedTuple):
    """The middles (2,) of the outlines in the photo and of the expected ones, mm."""

    seen: FloatArray
    expected: FloatArray

    @classmethod
    def of(cls, borders: Sequence[FloatArray], region: shapely.Geometry) -> _Middles:
        hull = shapely.convex_hull(shapely.MultiPoint(np.concatenate(borders)))
        middles = (shapely.centroid(shape) for shape in (hull, shapely.convex_hull(region)))
        seen, expected = (np.array(middle.coords[0]) for middle in middles)
        return cls(seen, expected)

    def fit(self, turn: float) -> Fit:
        """The photo turned by ``turn`` rad, with its middle on the other one."""
        x, y = (self.expected - PlanePose(turn, 0.0, 0.0).apply(self.seen[None])[0]).tolist()
        return Fit(turn, (x, y), 0.0, 0.0)


def _nearest(line: _Line, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signed distances (N,) to the nearest piece of the outline, along normals (N, 2).

    At a corner of the outline the normal is the direction from the corner to the point.
    """
    which = line.tree.nearest(shapely.points(at))
    start, end = line.start[which], line.end[which]
    along = end - start
    t = np.clip(
        np.einsum("ni,ni->n", at - start, along) / np.einsum("ni,ni->n", along, along), 0.0, 1.0
    )
    foot = start + t[:, None] * along
    normal = line.normal[which]
    gap = at - foot
    far = np.linalg.norm(gap, axis=1)
    corner = ((t <= 0) | (t >= 1)) & (far > 1e-9)
    normal = np.where(corner[:, None], gap / np.maximum(far, 1e-9)[:, None], normal)
    return np.asarray(np.einsum("ni,ni->n", gap, normal)), np.asarray(normal)


def _refine(line: _Line, points: FloatArray, fit: Fit, rounds: int, gate: float) -> Fit:
    """Gauss-Newton; points beyond the gate count nothing, and it closes as the residuals shrink."""
    reach = gate
    for _ in range(rounds):
        at = fit.apply(points)
        off, normal = _nearest(line, at)
        near = np.abs(off) < reach
        if np.count_nonzero(near) < 8:
            return fit
        middle = at[near].mean(axis=0)
        weight = (1 - (off[near] / reach) ** 2) ** 2
        arm = at[near] - middle
        rows = np.column_stack(
            [normal[near], arm[:, 0] * normal[near, 1] - arm[:, 1] * normal[near, 0]]
        )
        matrix = (rows * weight[:, None]).T @ rows + 1e-9 * np.eye(3)
        step = np.linalg.solve(matrix, -(rows * weight[:, None]).T @ off[near])
        moved = Fit(float(step[2]), (0.0, 0.0), 0.0, 0.0).apply(np.array(fit.shift)[None] - middle)[
            0
        ]
        shift = moved + middle + step[:2]
        fit = Fit(fit.turn + float(step[2]), (float(shift[0]), float(shift[1])), 0.0, 0.0)
        sigma = max(float(np.median(np.abs(off[near]))) * SIGMAS_OF_MEDIAN, _LEAST_SIGMA)
        settled = (
            np.abs(step[:2]).max() + abs(step[2]) * line.size < 1e-6 and reach <= _TUKEY * sigma
        )
        reach = min(reach, max(_TUKEY * sigma, 0.6 * reach))
        if settled:
            break
    return fit


def _score(fit: Fit, line: _Line, points: FloatArray, near: float) -> Fit:
    off, _ = _nearest(line, fit.apply(points))
    fits = np.abs(off) < near
    rms = float(np.sqrt(np.mean(off[fits] ** 2))) if fits.any() else math.inf
    return Fit(math.remainder(fit.turn, math.tau), fit.shift, float(fits.mean()), rms)


def _rivals(alike: Sequence[Fit], chosen: Fit) -> tuple[Fit, ...]:
    rivals: list[Fit] = []
    for fit in alike:
        others = (chosen, *rivals)
        turns = [abs(math.remainder(fit.turn - other.turn, math.tau)) for other in others]
        if min(turns) > _SAME_TURN:
            rivals.append(fit)
    return tuple(rivals)
