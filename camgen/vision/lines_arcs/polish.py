"""A closed chain of lines and arcs fitted to its points as one: corners and bulges together, least squares.

Unknown are the corners and the bulges; each point is measured against the line or arc of its run. So the chain is
closed whatever comes out, a corner lies where its two sides cross, and tangential joints can be asked for: each is a
row of the fit with a weight that nothing outweighs. Gauss-Newton; the normal matrix couples a corner only with its next
two neighbours on each side, and is solved in overlapping windows.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import begins
from camgen.geometry.rings import ComplexArray
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.fit import BoolArray
from camgen.vision.lines_arcs.joints import PASSES, TURNS, valley, zone_of

_ROUNDS = 5
#: Weight of a tangential joint, px/rad, and of staying where one is, for what the points do not tell.
_TANGENT, _STAY = 300.0, 0.03
#: Corners solved together, and how many of them on each side only serve as neighbours.
_WINDOW, _MARGIN = 24, 8
#: A corner that steps farther, px, is held in proportion. Number of times in a round, and factor
#: for all corners if the fit got worse.
_LONGEST_STEP, _HOLDS, _TIGHTER = 1.0, 2, 10.0
#: Step for slopes, px.
_STEP_PX = 1e-6


class FittedChain(Struct, frozen=True, eq=False):
    """corners (K,) px; bulges (K,) of the pieces that leave them; straight (K,): pieces that stay lines; smooth (K,):
    corners that stay tangential.
    """

    corners: ComplexArray
    bulges: FloatArray
    straight: BoolArray
    smooth: BoolArray


def polish(
    chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> FittedChain:
    """``chain`` moved to fit ``points`` (N,) best; piece (N,): ascending, which one each belongs to."""
    hold = np.full(len(chain.corners), _STAY)
    misfit = _misfit(chain, points, piece, weight)
    for _ in range(_ROUNDS):
        for _ in range(_HOLDS):
            step = _solve(*_normal_equations(chain, points, piece, weight, hold))
            # A step is not cut off: the bulges beside the corner belong to it.
            hold = hold * np.maximum(np.hypot(step[:, 0], step[:, 1]) / _LONGEST_STEP, 1.0)
        moved = _stepped(chain, step)
        after = _misfit(moved, points, piece, weight)
        if after < misfit:
            chain, misfit = moved, after
        else:
            hold = hold * _TIGHTER
    return chain


def _stepped(chain: FittedChain, step: FloatArray) -> FittedChain:
    bulges = np.where(chain.straight, 0.0, chain.bulges + step[:, 2])
    corners = chain.corners + step[:, 0] + 1j * step[:, 1]
    return FittedChain(corners, bulges, chain.straight, chain.smooth)


def _misfit(chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray) -> float:
    """The sum of squares to be minimised, px2."""
    tangents = _TANGENT * _kinks(chain)[chain.smooth]
    return float(weight @ errors(chain, points, piece) ** 2 + tangents @ tangents)


def _kinks(chain: FittedChain) -> FloatArray:
    """(K,) turn of the direction at each corner, rad."""
    out = np.roll(chain.corners, -1) - chain.corners
    half = 2 * np.arctan(chain.bulges)
    return np.asarray(
        np.angle(out * np.roll(out, 1).conj() * np.exp(-1j * (np.roll(half, 1) + half)))
    )


def to_arcs(
    points: ComplexArray, a: ComplexArray, b: ComplexArray, bulge: FloatArray
) -> FloatArray:
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
    chain: FittedChain,
    points: ComplexArray,
    piece: IntArray,
    weight: FloatArray,
    hold: FloatArray,
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
    stay = np.stack([hold, hold, hold * half**2 + chain.straight], axis=1)
    # The last part only matters where two corners have met, and one of them tells nothing.
    stay += 1e-6 + 1e-9 * np.trace(matrix[:, 2], axis1=1, axis2=2)[:, None]
    matrix[:, 2] += stay[:, :, None] * np.eye(3)
    return matrix, right


def _products(
    chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> FloatArray:
    """(K, 5, 6): for each piece, sums of the products of the five slopes of its points' distances with one another and
    with the distances; the slopes are those by x, y of its start, its bulge, and x, y of its end.
    """
    count = len(chain.corners)
    a, b, g = chain.corners[piece], np.roll(chain.corners, -1)[piece], chain.bulges[piece]
    error = to_arcs(points, a, b, g)
    shifts = (
        (_STEP_PX, 0, 0),
        (1j * _STEP_PX, 0, 0),
        (0, 0, _STEP_PX),
        (0, _STEP_PX, 0),
        (0, 1j * _STEP_PX, 0),
    )
    columns = np.stack(
        [*((to_arcs(points, a + p, b + q, g + r) - error) / _STEP_PX for p, q, r in shifts), error]
    )
    columns[2] *= ~chain.straight[piece]
    first = np.searchsorted(piece, np.arange(count))
    products = np.empty((count, 5, 6))
    for i in range(5):
        products[:, i] = np.add.reduceat(columns * (weight * columns[i]), first, axis=1).T
    return products


def _add_tangents(chain: FittedChain, matrix: FloatArray, right: FloatArray) -> None:
    """One heavy row for each tangential corner: the piece that arrives and the one that leaves have one direction."""
    k = np.flatnonzero(chain.smooth)
    count = len(chain.corners)
    before, after = (k - 1) % count, (k + 1) % count
    into, out = chain.corners[k] - chain.corners[before], chain.corners[after] - chain.corners[k]
    g0, g1 = chain.bulges[before], chain.bulges[k]
    error = _kinks(chain)[k]
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
            np.add.at(
                matrix,
                (places[:, i], np.full(len(k), j - i + 2)),
                rows[:, i, :, None] * rows[:, j, None, :],
            )


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
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
    found = np.linalg.solve(
        whole.reshape(len(starts), size * 3, size * 3), right[rows].reshape(len(starts), -1, 1)
    )
    result = np.zeros((count, 3))
    kept = slice(0, count) if count <= _WINDOW else slice(_MARGIN, _MARGIN + step)
    found = found.reshape(len(starts), size, 3)
    result[rows[:, kept]] = found[:, kept]
    return result


# What a chain of lines and arcs still lacks: small radii at its corners, and pieces that leave their points.

#: Points before and after a corner that tell how far it is rounded.
_LOOK_POINTS = 10
#: A corner that passes its vertex by more than this many times its own picture's rounding, and px, has a radius. A
#: sharp one reaches 1.4 times, for it depends on how the pixels lie; a right angle needs a radius of 2.6 blurs.
_ROUNDER, _MORE = 1.45, 0.05
#: Farther than that and 1 px from its points, or than so many blurs and px, a corner is none: lines that are almost
#: parallel meet anywhere.
_LOST, _BLURS, _TIP = 1.0, 2.5, 0.7
#: The half-way level of the model beside that of a Gaussian's picture, at a sharp corner.
_OWN = 1.08
#: Turns (rad) between which a radius can be told, and the largest part of a neighbour that it may take.
_TURN = np.radians([5.0, 150.0])
_ROOM_SHARE = 0.45
#: A corner that turns by more, rad, may come of a fit gone wrong: points that it passes by count.
_POINTED = np.radians(110.0)
#: A quarter, half and three quarters along a piece, no place is farther than this from its points, px. Its points are
#: off by this many sigma, and px, at most, rms.
_ASTRAY = 3.0
_SIGMAS, _OFF = 3.0, 0.1


class Fillets(Struct, frozen=True, eq=False):
    """Corners of a chain.

    reach: (K,) distance of the corner from the begin of its arc, px, 0 where it is sharp.
    turn: (K,) rad.
    lost: (K,) whether the points keep away from the corner without an arc to be told by.
    rounding: (K,) distance of a sharp corner from its points that the blur explains, px.
    zone: (K,) distance from a sharp corner within which the blur moves points, px.
    """

    reach: FloatArray
    turn: FloatArray
    lost: BoolArray
    rounding: FloatArray
    zone: FloatArray


def along(chain: FittedChain, share: float | FloatArray) -> ComplexArray:
    """The place (K,) at ``share`` of each piece."""
    a, b, sweep = chain.corners, np.roll(chain.corners, -1), 4 * np.arctan(chain.bulges)
    arc = np.abs(sweep) > 1e-6
    safe = np.where(arc, sweep, 1.0)
    # Between a and b the arc has gone exp(i sweep share) - 1 of exp(i sweep) - 1.
    part = np.where(arc, np.expm1(1j * safe * share) / np.expm1(1j * safe), share)
    return np.asarray(a + (b - a) * part)


def errors(chain: FittedChain, points: ComplexArray, piece: IntArray) -> FloatArray:
    """Signed distances (N,) px of points from their pieces."""
    return to_arcs(
        points, chain.corners[piece], np.roll(chain.corners, -1)[piece], chain.bulges[piece]
    )


def beyond(
    chain: FittedChain, fillets: Fillets, points: ComplexArray, piece: IntArray
) -> BoolArray:
    """Which points (N,) no fillet has to do with."""
    after, reach = np.roll(chain.corners, -1)[piece], np.roll(fillets.reach, -1)[piece]
    at_start = np.abs(points - chain.corners[piece]) < fillets.reach[piece]
    return np.asarray(~at_start & ~(np.abs(points - after) < reach))


def roundings(
    chain: FittedChain, fillets: Fillets, points: ComplexArray, piece: IntArray
) -> FloatArray:
    """(N,) distance of points from a sharp corner that the blur explains, px; else 0."""
    explained = np.zeros(len(points))
    for corner in (piece, (piece + 1) % len(chain.corners)):
        near = np.abs(points - chain.corners[corner]) < fillets.zone[corner]
        explained = np.maximum(explained, np.where(near, fillets.rounding[corner], 0.0))
    return explained


def astray_beyond(sigma: float) -> float:
    """The rms distance (px) beyond which points of noise ``sigma`` are not those of their curve."""
    return _SIGMAS * sigma + _OFF


def astray(
    chain: FittedChain,
    fillets: Fillets,
    points: ComplexArray,
    piece: IntArray,
    counts: BoolArray,
    sigma: float,
) -> BoolArray:
    """Which pieces (K,) do not follow their points; of two that meet in a corner that is none, the one with fewer."""
    count = len(chain.corners)
    begin = np.searchsorted(piece, np.arange(count))
    square = errors(chain, points, piece) ** 2 * counts
    mean = np.add.reduceat(square, begin) / np.maximum(np.add.reduceat(counts * 1.0, begin), 1)
    bad = mean > astray_beyond(sigma) ** 2
    for share in (0.25, 0.5, 0.75):
        near = np.minimum.reduceat(np.abs(points - along(chain, share)[piece]), begin)
        bad |= ~(near < _ASTRAY)
    size = np.bincount(piece, minlength=count)
    shorter = size <= np.roll(size, 1)
    bad |= fillets.lost & shorter | np.roll(fillets.lost & ~shorter, -1)
    return bad | ~np.isfinite(chain.bulges)


def fillets_of(
    chain: FittedChain, points: ComplexArray, piece: IntArray, blur: float, sigma: float
) -> Fillets:
    """The small radii at the corners of ``chain``, told by how far its points keep from the corner.

    The picture of a corner of radius r passes the vertex at the root of the sum of two squares: the distance of the
    arc, r (1 / cos(turn / 2) - 1), and that of the picture of a sharp corner; within 0.1 px on drawn pictures.
    """
    chord = np.roll(chain.corners, -1) - chain.corners
    size = np.maximum(np.abs(chord), 1e-9)
    lean = np.exp(2j * np.arctan(chain.bulges))
    out, into = chord / size / lean, np.roll(chord / size * lean, 1)
    turn = np.angle(out * into.conj())
    depth = _depths(chain.corners, 1j * np.sign(turn) * into * np.exp(0.5j * turn), points, piece)
    own = _OWN * np.interp(np.abs(turn), TURNS, PASSES) * blur
    within = np.abs(turn).clip(*_TURN)
    reach = (
        np.sqrt(np.maximum(depth**2 - own**2, 0.0))
        / (1 / np.cos(within / 2) - 1)
        * np.tan(within / 2)
    )
    room = _ROOM_SHARE * np.minimum(size, np.roll(size, 1))
    told = (
        (depth > _ROUNDER * own + _MORE + sigma)
        & (within == np.abs(turn))
        & (reach < room)
        & ~chain.smooth
    )
    told &= len(turn) > 2
    farthest = np.minimum(_ROUNDER * own + _LOST, _BLURS * blur + _TIP)
    lost = ~told & ~chain.smooth & (depth > farthest)
    zone = np.where(chain.smooth, 0.0, zone_of(turn, np.full(len(turn), blur)))
    rounding = np.where(np.abs(turn) < _POINTED, own, 0.0)
    return Fillets(np.where(told, reach, 0.0), turn, lost, rounding, zone)


def no_fillets(chain: FittedChain) -> Fillets:
    """Sharp corners, whatever the points say."""
    none = np.zeros(len(chain.corners))
    return Fillets(none, none, none > 0, none, none)


def _depths(
    corners: ComplexArray, inwards: ComplexArray, points: ComplexArray, piece: IntArray
) -> FloatArray:
    """How far ``inwards`` (K,) of each corner the points around it pass."""
    size = np.bincount(piece, minlength=len(corners))
    begin = begins(size)
    offset = np.arange(-_LOOK_POINTS, _LOOK_POINTS)
    rows = (begin[:, None] + offset) % len(points)
    local = (points[rows] - corners[:, None]) * inwards[:, None].conj()
    theirs = (offset >= -np.roll(size, 1)[:, None] / 2) & (offset < size[:, None] / 2)
    low = np.argmin(np.where(theirs, local.real, np.inf), axis=1).clip(1, len(offset) - 2)
    three = local[np.arange(len(corners))[:, None], low[:, None] + np.arange(-1, 2)]
    return valley(three.imag.T, three.real.T)


def repair(
    chain: FittedChain, fillets: Fillets, bad: BoolArray, points: ComplexArray, piece: IntArray
) -> tuple[ComplexArray, FloatArray, IntArray]:
    """Corners, bulges and their pieces with the fillets put in, and with ``bad`` (K,) pieces as lines between points.

    piece (N,): ascending, which one each of the ``points`` belongs to; each has one at least.
    """
    rounded = np.where(bad | np.roll(bad, 1), 0.0, fillets.reach)
    begin = np.searchsorted(piece, np.arange(len(bad) + 1))
    low, high = rounded / _lengths(chain), 1 - np.roll(rounded, -1) / _lengths(chain)
    # Beside a bad piece the corner is as doubtful: a good one begins and ends where its own points do.
    low = np.where(np.roll(bad, 1), _share(chain, points[begin[:-1]]), low)
    high = np.where(np.roll(bad, -1), _share(chain, points[begin[1:] - 1]), high)
    first, last = along(chain, low), along(chain, high)
    bulges = np.tan(np.arctan(chain.bulges) * (high - low))
    corners: list[ComplexArray] = []
    shapes: list[FloatArray] = []
    for k in range(len(bad)):
        after = (k + 1) % len(bad)
        # The end of a piece is the beginning of the next, unless something lies between.
        between = not bad[k] and (bad[after] or rounded[after] > 0)
        own = points[begin[k] : begin[k + 1]] if bad[k] else first[k : k + 1]
        corners.append(np.append(own, last[k]) if between else own)
        shape = np.zeros(len(own)) if bad[k] else bulges[k : k + 1]
        shapes.append(
            np.append(shape, 0.0 if bad[after] else np.tan(fillets.turn[after] / 4))
            if between
            else shape
        )
    counts = [len(own) for own in corners]
    return np.concatenate(corners), np.concatenate(shapes), np.repeat(np.arange(len(bad)), counts)


def _lengths(chain: FittedChain) -> FloatArray:
    chord, half = np.abs(np.roll(chain.corners, -1) - chain.corners), 2 * np.arctan(chain.bulges)
    safe = np.where(np.abs(half) > 1e-9, half, 1.0)
    return np.asarray(
        np.maximum(chord * np.where(np.abs(half) > 1e-9, safe / np.sin(safe), 1.0), 1e-9)
    )


def _share(chain: FittedChain, points: ComplexArray) -> FloatArray:
    """Where on each piece the foot of its point (K,) lies, 0 at the start, 1 at the end."""
    a, b, g = chain.corners, np.roll(chain.corners, -1), chain.bulges
    arc = np.abs(g) > 1e-6
    safe = np.where(arc, g, 1.0)
    centre = (a + b) / 2 + 1j * (b - a) * (1 - safe**2) / (4 * safe)
    middle = along(chain, 0.5) - centre
    middle = np.where(np.abs(middle) > 1e-9, middle, 1.0)
    turned = np.angle((points - centre) / middle) / (4 * np.arctan(safe))
    straight = ((points - a) * (b - a).conj()).real / np.maximum(np.abs(b - a) ** 2, 1e-18)
    found: FloatArray = np.where(arc, 0.5 + turned, straight)
    return found
