"""The surface of a model that is seen from a place: rays against its triangles."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.collision.tree import search_tree
from camgen.geometry.vectors import compute_in_blocks, cross, multiply_rows, normalize
from camgen.localize.model import Model
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray

#: A place is on the model if it is off by less than this part of the model's size. A ray from there
#: does not meet the triangle on which it starts.
ON_SURFACE = 1e-5
#: Share of a triangle by which a ray may pass beside it and still meets it, so that no ray slips
#: through between two triangles.
_SEAM = 1e-9
#: Directions that are tried all around, and then about each of the best ones.
_AROUND, _NEARER = 60, 16
#: Two directions agree about as well with the seen places if their coefficients differ by less.
_ABOUT_AS_WELL = 0.05
#: Turns in which many eyes are asked, each with eyes in different directions.
_TURNS = 8
#: A far eye is this many sizes of the model away.
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


def find_hidden(model: Model, places: FloatArray, eyes: FloatArray, gap: float) -> BoolArray:
    """Whether the model hides each of `places` (N, 3) from an eye: (N,).

    A triangle hides a place if the ray to the eye meets it more than `gap` (mm) from the place.

    eyes: one eye (3,), or one for each place (N, 3). All are in the model's frame, mm.
    """
    directions = normalize(eyes - places)
    directions[directions == 0] = 1e-300
    # Boxes are padded, so that rounding loses none of them.
    inverse, pad = 1 / directions, 1e-9 * model.size
    columns, inverses = np.ascontiguousarray(places.T), np.ascontiguousarray(inverse.T)

    def meets(which: IntArray, low: FloatArray, high: FloatArray) -> IntArray:
        start, factor = columns.take(which, axis=1), inverses.take(which, axis=1)
        to_low, to_high = low - (start + pad), high - (start - pad)
        to_low *= factor
        to_high *= factor
        enters = np.minimum(to_low, to_high).max(axis=0)
        leaves = np.maximum(to_low, to_high).min(axis=0)
        return np.flatnonzero((leaves >= enters) & (leaves > gap))

    ray, triangle, _ = search_tree(model.tree, len(places), meets)
    distances = compute_in_blocks(
        _measure_ray,
        model.tree.corners.take(triangle, axis=0),
        places.take(ray, axis=0),
        directions.take(ray, axis=0),
    )
    return np.isin(np.arange(len(places)), ray[distances > gap])


def _measure_ray(corners: FloatArray, places: FloatArray, directions: FloatArray) -> FloatArray:
    """(n,) distance along each ray to its triangle, mm; -inf if the ray does not meet it.

    A ray goes from a place (n, 3) in a unit direction (n, 3); triangles are (n, 3, 3) (Moeller and
    Trumbore, Fast, minimum storage ray/triangle intersection, 1997).
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = cross(directions, second)
    volume = multiply_rows(first, across)
    volume[volume == 0] = np.inf  # parallel: all quotients are 0, and the distance too
    from_corner = places - corners[:, 0]
    u = multiply_rows(from_corner, across) / volume
    turned = cross(from_corner, first)
    v = multiply_rows(directions, turned) / volume
    is_met = (u >= -_SEAM) & (v >= -_SEAM) & (u + v <= 1 + _SEAM)
    return np.asarray(np.where(is_met, multiply_rows(second, turned) / volume, -np.inf))


def make_far_eyes(model: Model, directions: FloatArray) -> FloatArray:
    """Eyes (D, 3) far away from the model, in the unit `directions` (D, 3) from its middle."""
    return np.asarray((model.low + model.high) / 2 + _FAR * model.size * directions)


def find_seen(
    model: Model, places: FloatArray, normals: FloatArray, eyes: FloatArray, facing: float
) -> BoolArray:
    """Whether each of `eyes` (D, 3) sees each of `places` (N, 3) on the model: (D, N).

    normals: (N, 3), unit normals at the places.
    facing: a surface is too steep to be seen if the cosine between its normal and the direction to
        the eye is not larger than this.
    """
    seen = _find_facing(places, normals, eyes, facing)
    eye, place = np.nonzero(seen)
    seen[eye, place] = ~find_hidden(model, places[place], eyes[eye], ON_SURFACE * model.size)
    return seen


def find_shown(
    model: Model,
    places: FloatArray,
    normals: FloatArray,
    eyes: FloatArray,
    facing: float,
    share: float,
) -> BoolArray:
    """Whether at least `share` (0..1) of the eyes see each of the places: (N,), as by `find_seen`.

    A few eyes from different directions decide about most places. The others are not asked.
    """
    faced, least = _find_facing(places, normals, eyes, facing), (share - 1e-9) * len(eyes)
    possible = faced.sum(axis=0)
    certain = np.zeros_like(possible)
    for k in range(_TURNS):
        is_open = (possible >= least) & (certain < least)
        eye, place = np.nonzero(faced[k::_TURNS] & is_open)
        gap = ON_SURFACE * model.size
        hidden = find_hidden(model, places[place], eyes[k::_TURNS][eye], gap)
        possible -= np.bincount(place[hidden], minlength=len(places))
        certain += np.bincount(place[~hidden], minlength=len(places))
    return np.asarray(possible >= least)


def _find_facing(
    places: FloatArray, normals: FloatArray, eyes: FloatArray, facing: float
) -> BoolArray:
    """Whether each of `eyes` (D, 3) is in front of the surface at each of `places`: (D, N)."""
    directions = normalize((eyes[:, None] - places).reshape(-1, 3)).reshape(len(eyes), -1, 3)
    return np.asarray(np.einsum("dnk,nk->dn", directions, normals) > facing)


def spread_directions() -> FloatArray:
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

    The first round tries far eyes all around. The next rounds try directions about the best ones,
    with nearer eyes too.

    facing: the cosine between a face and the line of sight above which the face is seen.
    up: (3,), towards the side of the eye; None for any side.
    likely: (3,), a direction to try besides those all around.
    """
    middle = (model.low + model.high) / 2

    def compare(eyes: FloatArray) -> tuple[FloatArray, FloatArray]:
        sight = find_seen(model, seen.places, seen.normals, eyes, facing)
        both, count = (sight & seen.hit).sum(axis=1), int(seen.hit.sum())
        agree = 2 * both / np.maximum(sight.sum(axis=1) + count, 1)
        return np.asarray(agree), np.asarray(both / max(count, 1))

    tries = [spread_directions(), np.eye(3), -np.eye(3)]
    if seen.hit.any():
        tries.insert(1, normalize(seen.normals[seen.hit].mean(axis=0, keepdims=True)))
    if likely is not None:
        tries.append(likely[None])
    directions = select_above(np.vstack(tries), up)
    eyes, agree, shares = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    for cone, distances in _ROUNDS:
        shifts = np.multiply.outer(np.array(distances) * model.size, directions)
        tried = (middle + shifts).reshape(-1, 3)
        results = compare(tried)
        eyes = np.vstack([eyes, tried])
        agree, shares = np.append(agree, results[0]), np.append(shares, results[1])
        best = normalize(eyes[np.argsort(-agree, kind="stable")[:_BEST]] - middle)
        rings = [_spread_ring(direction, cone) for direction in best]
        directions = select_above(np.vstack(rings), up)
    order = np.argsort(-agree, kind="stable")[:_ALIKE]
    alike = order[agree[order] >= agree[order[0]] - _ABOUT_AS_WELL]
    return EyeEstimate(eyes[order[0]], float(shares[order[0]]), eyes[alike])


def select_above(directions: FloatArray, up: FloatArray | None) -> FloatArray:
    """The directions (D, 3) that point up, or at least the nearest one; all if `up` is None."""
    if up is None:
        return directions
    rise = directions @ up
    return directions[rise > min(0.0, float(rise.max()) - 1e-9)]


def _spread_ring(axis: FloatArray, cone: float) -> FloatArray:
    """Unit directions (N, 3) around a unit axis, at the angles `cone` and `cone` / 2, rad."""
    turn = 2 * np.pi * np.arange(_NEARER) / _NEARER
    side = normalize(np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])[None])[0]
    ring = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(axis, side))
    angle = np.where(np.arange(_NEARER) % 2, cone, cone / 2)[:, None]
    return np.asarray(np.cos(angle) * axis + np.sin(angle) * ring)
