"""Fits a photo to a drawing: the rotation and shift between their outlines.

Iterated closest points (Besl and McKay 1992) with distances to lines instead of points (Chen and
Medioni 1991), under Tukey's weights, so that burrs and gaps have no weight in the end. It starts
from the pose of the part in the photo, and from rotations all around with both middles at the same
point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import CamgenError, InputError
from camgen.model.pose import FloatArray, PlanePose
from camgen.model.tolerance import SIGMAS_OF_MEDIAN

#: Number of rotations that are tried first.
_TURNS = 36
#: Number of points of each outline for these rotations, and for the final fit.
_COARSE_POINTS, _FINE_POINTS = 400, 6000
#: Maximum number of iterations for these rotations, and for the final fit.
_COARSE_ROUNDS, _FINE_ROUNDS = 15, 40
#: Branches of a node of the tree of pieces. The nearest one is found twice as fast as with 10.
_NODE_CAPACITY = 3
#: Constant of Tukey's biweight, and the smallest standard deviation for it, mm.
_TUKEY, _MIN_SIGMA = 4.685, 0.01
#: A point fits within this fraction of the size of the drawing.
_NEAR_SHARE = 0.005
#: Another rotation fits as well if it fits this fraction of the points of the best one.
_AS_WELL = 0.99
#: rad: rotations that differ by less are one.
_SAME_TURN = 0.05


class Fit(Struct, frozen=True):
    """The pose drawing_from_photo.

    turn: rotation, before the shift, rad.
    shift: shift, mm.
    share: fraction of the points of the photo that fit.
    rms: root mean square distance of these points, mm.
    near: distance within which points fit, mm.
    rivals: equally good fits with another rotation.
    """

    turn: float
    shift: tuple[float, float]
    share: float
    rms: float
    near: float = 0.0
    rivals: tuple[Fit, ...] = ()

    @property
    def rival_turns(self) -> tuple[float, ...]:
        """Further rotations of the photo at which it fits as well, rad."""
        turns = (math.remainder(rival.turn - self.turn, math.tau) for rival in self.rivals)
        return tuple(sorted(turns))

    @property
    def photo_from_drawing(self) -> PlanePose:
        """The pose of the drawing in the photo."""
        return PlanePose(self.turn, *self.shift).inverse()

    def apply(self, points: FloatArray) -> FloatArray:
        """Transform `points` (N, 2) of the photo to the drawing's frame."""
        return PlanePose(self.turn, *self.shift).apply(points)


class _Line(Struct, frozen=True, eq=False):
    """The expected outline, in mm.

    tree: index of its pieces.
    start, end, normal: (N, 2) ends and unit normal of each piece.
    size: diagonal of the box around it.
    """

    tree: shapely.STRtree
    start: FloatArray
    end: FloatArray
    normal: FloatArray
    size: float


def fit_outlines(
    borders: Sequence[FloatArray], region: shapely.Geometry, turn: float | None = None
) -> Fit:
    """Find the pose that fits `borders` (N, 2) mm of a photo to the outline of `region`.

    turn: expected rotation, rad, which decides between equally good poses; None is a rotation of 0,
        from the pose of the part in the photo.
    """
    line = _make_line(region)
    points = np.concatenate(borders)
    coarse, fine = _thin_out(points, _COARSE_POINTS), _thin_out(points, _FINE_POINTS)
    near = max(_NEAR_SHARE * line.size, 0.2)
    hulls = shapely.convex_hull([shapely.MultiPoint(points), region])
    seen, expected = shapely.get_coordinates(shapely.centroid(hulls))

    def fit_middles(turn: float) -> Fit:
        """Return the fit that rotates by `turn` rad and shifts one middle to the other."""
        x, y = (expected - PlanePose(turn, 0.0, 0.0).apply(seen[None])[0]).tolist()
        return Fit(turn, (x, y), 0.0, 0.0)

    starts = [fit_middles(k * math.tau / _TURNS) for k in range(_TURNS)]
    starts.insert(0, Fit(0.0, (0.0, 0.0), 0.0, 0.0) if turn is None else fit_middles(turn))
    fits = []
    for start in starts:
        refined = _refine(line, coarse, start, _COARSE_ROUNDS, line.size / 10)
        fits.append(_score(refined, line, coarse, near))
    best = max(fits, key=lambda fit: (round(fit.share, 2), -fit.rms))
    share, rms = _AS_WELL * best.share, 1.5 * best.rms + 0.02
    alike = [fit for fit in fits if fit.share >= share and fit.rms <= rms]
    # The smallest of equally good rotations: the part lies about as the photo shows it.
    wanted = turn or 0.0
    chosen = min(alike, key=lambda fit: round(abs(math.remainder(fit.turn - wanted, math.tau)), 1))
    final = _score(_refine(line, fine, chosen, _FINE_ROUNDS, near * 3), line, fine, near)
    return replace(final, near=near, rivals=_select_rivals(alike, chosen))


def check_fit(
    name: str,
    source: str,
    share: float,
    near: float,
    least: float,
    refusal: type[CamgenError] = InputError,
) -> None:
    """Check that the fraction `share` of outlines within `near` mm is at least `least`.

    Raises `refusal` if it is not.
    """
    if share < least:
        what = f"does not show {source}: {100 * share:.0f} % of its outline "
        what += f"lies within {near:.2f} mm of that"
        remedy = "give the drawing of this part, "
        remedy += "check the scale of the photo, or its mask by camgen inspect"
        raise refusal(name, what, f"{100 * least:.0f} % must", remedy)


def _make_line(region: shapely.Geometry) -> _Line:
    rings = shapely.get_parts(shapely.boundary(region))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    is_side = ring[1:] == ring[:-1]
    start, end = points[:-1][is_side], points[1:][is_side]
    long = np.linalg.norm(end - start, axis=1) > 1e-9
    start, end = start[long], end[long]
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    lines = shapely.linestrings(np.stack([start, end], axis=1))
    tree = shapely.STRtree(lines, node_capacity=_NODE_CAPACITY)
    size = float(np.hypot(*np.ptp(np.concatenate([start, end]), axis=0)))
    return _Line(tree, start, end, np.column_stack([along[:, 1], -along[:, 0]]), size)


def _thin_out(points: FloatArray, count: int) -> FloatArray:
    return points[:: max(1, len(points) // count)]


def _find_nearest(line: _Line, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return signed distances (N,) to the nearest piece of the outline, and normals (N, 2).

    At a corner of the outline the normal is the direction from the corner to the point.
    """
    which = line.tree.nearest(shapely.points(at))
    start, end = line.start[which], line.end[which]
    along = end - start
    t = np.einsum("ni,ni->n", at - start, along) / np.einsum("ni,ni->n", along, along)
    t = np.clip(t, 0.0, 1.0)
    normal = line.normal[which]
    gap = at - (start + t[:, None] * along)
    far = np.linalg.norm(gap, axis=1)
    corner = ((t <= 0) | (t >= 1)) & (far > 1e-9)
    normal = np.where(corner[:, None], gap / np.maximum(far, 1e-9)[:, None], normal)
    return np.asarray(np.einsum("ni,ni->n", gap, normal)), np.asarray(normal)


def _refine(line: _Line, points: FloatArray, fit: Fit, rounds: int, gate: float) -> Fit:
    """Refine a fit by Gauss-Newton.

    Points beyond `gate` mm have no weight, and the gate narrows as the residuals shrink.
    """
    reach = gate
    for _ in range(rounds):
        at = fit.apply(points)
        distance, normal = _find_nearest(line, at)
        near = np.abs(distance) < reach
        if np.count_nonzero(near) < 8:
            return fit
        middle = at[near].mean(axis=0)
        weight = (1 - (distance[near] / reach) ** 2) ** 2
        arm = at[near] - middle
        torque = arm[:, 0] * normal[near, 1] - arm[:, 1] * normal[near, 0]
        rows = np.column_stack([normal[near], torque])
        matrix = (rows * weight[:, None]).T @ rows + 1e-9 * np.eye(3)
        step = np.linalg.solve(matrix, -(rows * weight[:, None]).T @ distance[near])
        turn = float(step[2])
        moved = PlanePose(turn, 0.0, 0.0).apply(np.array(fit.shift)[None] - middle)[0]
        x, y = (moved + middle + step[:2]).tolist()
        fit = Fit(fit.turn + turn, (x, y), 0.0, 0.0)
        sigma = max(float(np.median(np.abs(distance[near]))) * SIGMAS_OF_MEDIAN, _MIN_SIGMA)
        change = np.abs(step[:2]).max() + abs(step[2]) * line.size
        is_settled = change < 1e-6 and reach <= _TUKEY * sigma
        reach = min(reach, max(_TUKEY * sigma, 0.6 * reach))
        if is_settled:
            break
    return fit


def _score(fit: Fit, line: _Line, points: FloatArray, near: float) -> Fit:
    distance, _ = _find_nearest(line, fit.apply(points))
    fits = np.abs(distance) < near
    rms = float(np.sqrt(np.mean(distance[fits] ** 2))) if fits.any() else math.inf
    return Fit(math.remainder(fit.turn, math.tau), fit.shift, float(fits.mean()), rms)


def _select_rivals(alike: Sequence[Fit], chosen: Fit) -> tuple[Fit, ...]:
    rivals: list[Fit] = []
    for fit in alike:
        others = (chosen, *rivals)
        turns = [abs(math.remainder(fit.turn - other.turn, math.tau)) for other in others]
        if min(turns) > _SAME_TURN:
            rivals.append(fit)
    return tuple(rivals)
