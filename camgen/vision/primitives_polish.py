"""A closed chain of lines and arcs fitted to its points as one: corners and bulges together, least squares.

Unknown are the corners and the bulges; each point is measured against the line or arc of its run. So the chain is
closed whatever comes out, a corner lies where its two sides cross, and tangential joints can be asked for: each is a
row of the fit with a weight that nothing outweighs. Gauss-Newton; the normal matrix couples a corner only with its next
two neighbours on each side, and is solved in overlapping windows.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.pose import FloatArray
from camgen.vision.outlines_loops import ComplexArray, IntArray
from camgen.vision.primitives_fit import BoolArray

_ROUNDS = 5
#: Weight of a tangential joint, px/rad, and of staying where one is, for what the points do not tell.
_TANGENT, _STAY = 300.0, 0.03
#: Corners solved together, and how many of them on each side only serve as neighbours.
_WINDOW, _MARGIN = 24, 8
_LONGEST_STEP = 1.0
#: Step for slopes, px.
_TINY = 1e-6


class Chain(Struct, frozen=True, eq=False):
    """corners (K,) px; bulges (K,) of the pieces that leave them; straight (K,): pieces that stay lines; smooth (K,):
    corners that stay tangential.
    """

    corners: ComplexArray
    bulges: FloatArray
    straight: BoolArray
    smooth: BoolArray


def polished(chain: Chain, points: ComplexArray, piece: IntArray, weight: FloatArray) -> Chain:
    """``chain`` moved to fit ``points`` (N,) best; piece (N,): ascending, which one each belongs to."""
    corners, bulges = chain.corners, chain.bulges
    for _ in range(_ROUNDS):
        matrix, right = _normal_equations(Chain(corners, bulges, chain.straight, chain.smooth), points, piece, weight)
        step = _solved(matrix, right)
        move = step[:, 0] + 1j * step[:, 1]
        size = np.abs(move)
        corners = corners + move * np.minimum(1.0, _LONGEST_STEP / np.maximum(size, 1e-12))
        bulges = np.where(chain.straight, 0.0, bulges + step[:, 2].clip(-0.3, 0.3))
    return Chain(corners, bulges, chain.straight, chain.smooth)


def to_arcs(points: ComplexArray, a: ComplexArray, b: ComplexArray, bulge: FloatArray) -> FloatArray:
    """Signed distances (N,) of points to the circles of the arcs a -> b, one each; to the line where bulge is 0."""
    chord = b - a
    c = np.maximum(np.abs(chord), 1e-9)
    local = (points - a) * chord.conj() / c
    x, y = local.real, local.imag
    k, g2 = 4 * bulge / c, bulge * bulge
    # Everything times 4 |bulge| / chord: the circle's equation stays finite when its centre runs away.
    radial = np.hypot(k * (x - c / 2), k * y - (1 - g2))
    return np.asarray(((x * x - c * x + y * y) * k - 2 * (1 - g2) * y) / (radial + 1 + g2))


def _normal_equations(
    chain: Chain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Blocks (K, 5, 3, 3) that couple corner k with k - 2 .. k + 2, and the right side (K, 3): x, y, bulge."""
    count = len(chain.corners)
    products = _products(chain, points, piece, weight)
    matrix, right = np.zeros((count, 5, 3, 3)), np.zeros((count, 3))
    after = np.roll(np.arange(count), -1)
    matrix[:, 2] += products[:, :3, :3]
    matrix[:, 3, :, :2] += products[:, :3, 3:5]
    matrix[after, 2, :2, :2] += products[:, 3:, 3:5]
    matrix[after, 1, :2, :] += products[:, 3:, :3]
    right -= products[:, :3, 5]
    right[after, :2] -= products[:, 3:, 5]
    _add_tangents(chain, matrix, right)
    half = np.abs(chain.corners[after] - chain.corners) / 2
    stay = np.stack([np.full(count, _STAY), np.full(count, _STAY), _STAY * half**2 + chain.straight], axis=1)
    # The last part only matters where two corners have met, and one of them tells nothing.
    stay += 1e-6 + 1e-9 * np.trace(matrix[:, 2], axis1=1, axis2=2)[:, None]
    matrix[:, 2] += stay[:, :, None] * np.eye(3)
    return matrix, right


def _products(chain: Chain, points: ComplexArray, piece: IntArray, weight: FloatArray) -> FloatArray:
    """(K, 5, 6): for each piece, sums of the products of the five slopes of its points' distances with one another and
    with the distances; the slopes are those by x, y of its start, its bulge, and x, y of its end.
    """
    count = len(chain.corners)
    a, b, g = chain.corners[piece], np.roll(chain.corners, -1)[piece], chain.bulges[piece]
    error = to_arcs(points, a, b, g)
    shifts = ((_TINY, 0, 0), (1j * _TINY, 0, 0), (0, 0, _TINY), (0, _TINY, 0), (0, 1j * _TINY, 0))
    columns = np.stack([*((to_arcs(points, a + p, b + q, g + r) - error) / _TINY for p, q, r in shifts), error])
    columns[2] *= ~chain.straight[piece]
    first = np.searchsorted(piece, np.arange(count))
    products = np.empty((count, 5, 6))
    for i in range(5):
        products[:, i] = np.add.reduceat(columns * (weight * columns[i]), first, axis=1).T
    return products


def _add_tangents(chain: Chain, matrix: FloatArray, right: FloatArray) -> None:
    """One heavy row for each tangential corner: the piece that arrives and the one that leaves have one direction."""
    k = np.flatnonzero(chain.smooth)
    count = len(chain.corners)
    before, after = (k - 1) % count, (k + 1) % count
    into, out = chain.corners[k] - chain.corners[before], chain.corners[after] - chain.corners[k]
    g0, g1 = chain.bulges[before], chain.bulges[k]
    error = np.angle(out * into.conj() * np.exp(-2j * (np.arctan(g0) + np.arctan(g1))))
    turn0, turn1 = (1j * chord / np.maximum(np.abs(chord), 1e-6) ** 2 for chord in (into, out))
    zero = np.zeros(len(k))
    rows = np.stack(
        [
            np.stack([turn0.real, turn0.imag, -2 / (1 + g0 * g0) * ~chain.straight[before]], axis=1),
            np.stack([-(turn0 + turn1).real, -(turn0 + turn1).imag, -2 / (1 + g1 * g1) * ~chain.straight[k]], axis=1),
            np.stack([turn1.real, turn1.imag, zero], axis=1),
        ],
        axis=1,
    ) * _TANGENT  # fmt: skip
    places = np.stack([before, k, after], axis=1)
    for i in range(3):
        np.add.at(right, places[:, i], -rows[:, i] * (error * _TANGENT)[:, None])
        for j in range(3):
            np.add.at(matrix, (places[:, i], np.full(len(k), j - i + 2)), rows[:, i, :, None] * rows[:, j, None, :])


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """The steps (K, 3), in windows of so many corners that what lies beyond does not matter."""
    count = len(right)
    size = min(count, _WINDOW)
    step = count if count <= _WINDOW else _WINDOW - 2 * _MARGIN
    starts = np.arange(0, count, step)
    rows = (starts[:, None] - (_MARGIN if count > _WINDOW else 0) + np.arange(size)) % count
    whole = np.zeros((size, size, len(starts), 3, 3))
    place = np.arange(size)
    for k in range(-2, 3):
        column = place + k
        inside = (column >= 0) & (column < size) | (count <= _WINDOW)
        # Of two pieces the same pair of corners meets on both sides: np.add.at does not forget one.
        blocks = matrix[rows[:, inside], k + 2].swapaxes(0, 1)
        np.add.at(whole, (place[inside], column[inside] % size), blocks)
    whole = whole.transpose(2, 0, 3, 1, 4)
    found = np.linalg.solve(whole.reshape(len(starts), size * 3, size * 3), right[rows].reshape(len(starts), -1, 1))
    result = np.zeros((count, 3))
    kept = slice(0, count) if count <= _WINDOW else slice(_MARGIN, _MARGIN + step)
    found = found.reshape(len(starts), size, 3)
    result[rows[:, kept]] = found[:, kept]
    return result
