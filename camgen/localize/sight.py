"""The surface of a model that is seen from a place: rays against its triangles."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.tree import search_tree
from camgen.geometry.vectors import cross, dots, in_blocks, unit
from camgen.localize.model import Model
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: A place off the model by this part of its size is on it: a ray from there does not meet the triangle it starts on.
ON_SURFACE = 1e-5
#: Share by which a ray may pass beside a triangle and meet it still, so that none slips through between two.
_SEAM = 1e-9
#: Directions that are tried all around, and then about the best one.
_AROUND, _NEARER = 60, 16
#: Two directions agree about as well with the seen places if their coefficients differ by less.
_ABOUT_AS_WELL = 0.05
#: A far eye stands this many sizes of the model away.
_FAR = 1e4
#: The best directions that are refined, and the eyes that agree about as well, at most.
_BEST, _ALIKE = 3, 80
#: Rounds of the estimate of an eye: the angle about the best directions for the next round, rad,
#: and the distances of the eyes, in sizes of the model.
_ROUNDS: tuple[tuple[float, tuple[float, ...]], ...] = (
    (0.3, (_FAR,)),
    (0.15, (4.0, _FAR)),
    (0.08, (3.0, 6.0, _FAR)),
)


def hidden(model: Model, places: FloatArray, eyes: FloatArray, gap: float) -> BoolArray:
    """Which ``places`` (N, 3) the model hides from ``eyes`` (3,) or (N, 3), all in the model's frame, mm: a triangle
    is on the way there, more than ``gap`` (mm) from the place.
    """
    ways = unit(eyes - places)
    ways[ways == 0] = 1e-300
    # A place within the box leaves it after one diagonal, any other meets it between here and its far end.
    inverse, pad = 1 / ways, 1e-9 * model.size

    columns, shares = np.ascontiguousarray(places.T), np.ascontiguousarray(inverse.T)

    def meets(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        here, share = columns.take(which, axis=1), shares.take(which, axis=1)
        one, two = (low - pad - here) * share, (high + pad - here) * share
        enters, leaves = np.minimum(one, two).max(axis=0), np.maximum(one, two).min(axis=0)
        return np.flatnonzero((leaves >= enters) & (leaves > gap))

    ray, triangle, _ = search_tree(model.tree, len(places), meets)
    blocked = np.zeros(len(places), dtype=bool)
    distances = in_blocks(
        _cross,
        model.tree.corners.take(triangle, axis=0),
        places.take(ray, axis=0),
        ways.take(ray, axis=0),
    )
    blocked[ray[distances > gap]] = True
    return blocked


def _cross(corners: FloatArray, places: FloatArray, ways: FloatArray) -> FloatArray:
    """How far from each place (n, 3) along its unit way the triangle (n, 3, 3) is met, mm; -inf if it is not (Moeller
    and Trumbore, Fast, minimum storage ray/triangle intersection, 1997).
    """
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = cross(ways, two)
    volume = dots(one, across)
    volume[volume == 0] = np.inf  # beside the triangle: all quotients are 0 and the distance too
    from_corner = places - corners[:, 0]
    u = dots(from_corner, across) / volume
    turned = cross(from_corner, one)
    v = dots(ways, turned) / volume
    met = (u >= -_SEAM) & (v >= -_SEAM) & (u + v <= 1 + _SEAM)
    return np.asarray(np.where(met, dots(two, turned) / volume, -np.inf))


def far_eyes(model: Model, directions: FloatArray) -> FloatArray:
    """Eyes (D, 3) that look at the model from far away, from the unit ``directions`` (D, 3)."""
    return np.asarray((model.low + model.high) / 2 + _FAR * model.size * directions)


def look(
    model: Model, places: FloatArray, normals: FloatArray, eyes: FloatArray, facing: float
) -> BoolArray:
    """Which places (N, 3) on the model, with their normals, each of ``eyes`` (D, 3) sees: (D, N). A surface whose
    normal and the way to the eye have a cosine of ``facing`` or less is too steep to be seen.
    """
    ways = unit((eyes[:, None] - places).reshape(-1, 3)).reshape(len(eyes), -1, 3)
    seen = np.asarray(np.einsum("dnk,nk->dn", ways, normals) > facing)
    eye, place = np.nonzero(seen)
    seen[eye, place] = ~hidden(model, places[place], eyes[eye], ON_SURFACE * model.size)
    return seen


def around() -> FloatArray:
    """Unit directions (D, 3) on a spiral all around."""
    k = np.arange(_AROUND) + 0.5
    up, turn = 1 - 2 * k / _AROUND, np.pi * (3 - 5**0.5) * k
    out = np.sqrt(1 - up * up)
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), up])


class SeenPlaces(Struct, frozen=True, eq=False):
    """Places (N, 3) on the model with their unit normals (N, 3).

    hit: (N,), whether each place was seen.
    """

    places: FloatArray
    normals: FloatArray
    hit: BoolArray


class EyeEstimate(Struct, frozen=True, eq=False):
    """An estimate of the scanner's place. Places are in the model's frame, mm.

    eye: (3,), the place with the sight nearest to the seen places.
    share: the share of the seen places that it sees, 0..1.
    alike: (K, 3), places that agree about as well with the seen places, the best first.
    """

    eye: FloatArray
    share: float
    alike: FloatArray


def estimate_eye(
    model: Model,
    seen: SeenPlaces,
    facing: float,
    up: FloatArray | None = None,
    likely: FloatArray | None = None,
) -> EyeEstimate:
    """The scanner's place, by Dice's coefficient of its sight and the seen places.

    facing: the cosine between a face and the line of sight above which the face is seen.
    up: (3,), towards the side of the eye; None for any side.
    likely: (3,), a direction to try besides those all around.
    """
    middle = (model.low + model.high) / 2

    def compare(eyes: FloatArray) -> tuple[FloatArray, FloatArray]:
        sight = look(model, seen.places, seen.normals, eyes, facing)
        both, count = (sight & seen.hit).sum(axis=1), int(seen.hit.sum())
        agree = 2 * both / np.maximum(sight.sum(axis=1) + count, 1)
        return np.asarray(agree), np.asarray(both / max(count, 1))

    usual = [*_usual(seen.normals[seen.hit]), *([] if likely is None else [likely[None]])]
    directions = above(np.vstack([around(), *usual]), up)
    eyes, agree, shares = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    for cone, distances in _ROUNDS:
        tried = np.concatenate([middle + far * model.size * directions for far in distances])
        results = compare(tried)
        eyes = np.vstack([eyes, tried])
        agree, shares = np.append(agree, results[0]), np.append(shares, results[1])
        best = unit(eyes[np.argsort(-agree, kind="stable")[:_BEST]] - middle)
        directions = above(np.vstack([_ring(direction, cone) for direction in best]), up)
    order = np.argsort(-agree, kind="stable")[:_ALIKE]
    alike = order[agree[order] >= agree[order[0]] - _ABOUT_AS_WELL]
    return EyeEstimate(eyes[order[0]], float(shares[order[0]]), eyes[alike])


def _usual(normals: FloatArray) -> list[FloatArray]:
    """Unit directions of many scanners: the mean of the normals (1, 3) and the axes (6, 3)."""
    mean = normals.mean(axis=0, keepdims=True) if len(normals) else np.zeros((0, 3))
    return [unit(mean), np.vstack([np.eye(3), -np.eye(3)])]


def above(directions: FloatArray, up: FloatArray | None) -> FloatArray:
    """The directions (D, 3) that point up, at least the nearest one; all if ``up`` is None."""
    if up is None:
        return directions
    rise = directions @ up
    return directions[rise > min(0.0, float(rise.max()) - 1e-9)]


def _ring(axis: FloatArray, cone: float) -> FloatArray:
    """Unit directions (N, 3) about one, at ``cone`` and half of that, rad."""
    turn = 2 * np.pi * np.arange(_NEARER) / _NEARER
    side = unit(np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])[None])[0]
    ring = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(axis, side))
    wide = np.where(np.arange(_NEARER) % 2, cone, cone / 2)[:, None]
    return np.asarray(np.cos(wide) * axis + np.sin(wide) * ring)
