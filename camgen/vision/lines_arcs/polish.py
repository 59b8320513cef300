"""Fits a closed chain of lines and arcs to its points: all corners and bulges together.

The unknowns are the corners and the bulges. Each point is measured against the line or arc of its
run, in least squares. So the chain is always closed, and a corner lies where its two sides cross. A
tangential joint is a row of the fit with a weight that nothing outweighs. The method is
Gauss-Newton. Its normal matrix couples a corner only with the next two corners on each side, so it
is solved in overlapping windows.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import compute_first_rows, count_rows, list_owners
from camgen.geometry.rings import ComplexArray
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.vision.lines_arcs.joints import PASSES, TURNS, compute_zone, find_valley

#: Rounds of Gauss-Newton.
_ROUNDS = 5
#: px/rad: weight of a tangential joint.
_TANGENT_WEIGHT = 300.0
#: Weight with which a corner is held in its place, in case the points do not determine it.
_HOLD_WEIGHT = 0.03
#: Corners that are solved together.
_WINDOW = 24
#: Corners on each side of a window whose result is not used, as their neighbours are missing.
_MARGIN = 8
#: px: a corner with a longer step is held with a weight in proportion,
_MAX_STEP = 1.0
#: this many times in a round.
_HOLDS = 2
#: Factor on the weights of all corners if a round makes the fit worse.
_TIGHTENING = 10.0
#: px: the fit ends with a round that moves no corner and no middle of a piece by more.
_SETTLED_PX = 1e-4
#: px: step for numerical derivatives.
_STEP_PX = 1e-6


class FittedChain(Struct, frozen=True, eq=False):
    """A closed chain of K pieces, lines and arcs. Piece k leaves corner k.

    corners: (K,) px.
    bulges: (K,) bulge of each piece, 0 for a line.
    straight: (K,) the piece remains a line.
    smooth: (K,) the pieces remain tangential at the corner.
    """

    corners: ComplexArray
    bulges: FloatArray
    straight: BoolArray
    smooth: BoolArray


def polish(
    chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> FittedChain:
    """Move the corners and bulges of a chain so that it fits `points` (N,) best.

    piece: (N,) piece to which each point belongs, ascending.
    weight: (N,) weight of each point.
    """
    stiffness = np.full(len(chain.corners), _HOLD_WEIGHT)
    squares = _sum_squares(chain, points, piece, weight)
    for _ in range(_ROUNDS):
        for _ in range(_HOLDS):
            step = _solve(*_make_normal_equations(chain, points, piece, weight, stiffness))
            # A long step is not cut off, as the bulges beside the corner belong to it.
            stiffness = stiffness * np.maximum(np.hypot(step[:, 0], step[:, 1]) / _MAX_STEP, 1.0)
        moved = _move(chain, step)
        moved_squares = _sum_squares(moved, points, piece, weight)
        if moved_squares < squares:
            chain, squares = moved, moved_squares
            half = np.abs(np.roll(chain.corners, -1) - chain.corners) / 2
            if max(np.abs(step[:, :2]).max(), np.abs(step[:, 2] * half).max()) < _SETTLED_PX:
                break
        else:
            stiffness = stiffness * _TIGHTENING
    return chain


def _move(chain: FittedChain, step: FloatArray) -> FittedChain:
    """The chain with changed x, y and bulges, `step` (K, 3)."""
    bulges = np.where(chain.straight, 0.0, chain.bulges + step[:, 2])
    corners = chain.corners + step[:, 0] + 1j * step[:, 1]
    return FittedChain(corners, bulges, chain.straight, chain.smooth)


def _sum_squares(
    chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> float:
    tangents = _TANGENT_WEIGHT * _measure_kinks(chain)[chain.smooth]
    return float(weight @ measure_errors(chain, points, piece) ** 2 + tangents @ tangents)


def _measure_kinks(chain: FittedChain) -> FloatArray:
    """Change of direction (K,) at each corner, rad, signed."""
    chord = np.roll(chain.corners, -1) - chain.corners
    half_sweep = 2 * np.arctan(chain.bulges)
    rotation = np.exp(-1j * (np.roll(half_sweep, 1) + half_sweep))
    return np.asarray(np.angle(chord * np.roll(chord, 1).conj() * rotation))


def measure_from_arcs(
    points: ComplexArray, a: ComplexArray, b: ComplexArray, bulge: FloatArray
) -> FloatArray:
    """Signed distances (N,) of points to the circles of arcs, to a line if the bulge is 0; px.

    a, b, bulge: (N,) beginning, end and bulge of the arc of each point.
    """
    chord = b - a
    c = np.maximum(np.abs(chord), 1e-9)
    local = (points - a) * chord.conj() / c
    x, y = local.real, local.imag
    k, g2 = 4 * bulge / c, bulge * bulge
    # All terms are multiplied by 4 |bulge| / chord, so that the equation of the circle stays finite
    # if its centre is far away.
    radial = np.hypot(k * (x - c / 2), k * y - (1 - g2))
    return np.asarray(((x * x - c * x + y * y) * k - 2 * (1 - g2) * y) / (radial + 1 + g2))


def _make_normal_equations(
    chain: FittedChain,
    points: ComplexArray,
    piece: IntArray,
    weight: FloatArray,
    stiffness: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The normal equations of the fit, for x, y and bulge of each corner.

    stiffness: (K,) weight with which each corner is held in its place.

    Returns blocks (K, 5, 3, 3) that couple corner k with k - 2 to k + 2, and the right side (K, 3).
    """
    count = len(chain.corners)
    products = _sum_products(chain, points, piece, weight)
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
    stay = np.stack([stiffness, stiffness, stiffness * half**2 + chain.straight], axis=1)
    # This part matters only if two corners have met, as then one of them is not determined.
    stay += 1e-6 + 1e-9 * np.trace(matrix[:, 2], axis1=1, axis2=2)[:, None]
    matrix[:, 2] += stay[:, :, None] * np.eye(3)
    return matrix, right


def _sum_products(
    chain: FittedChain, points: ComplexArray, piece: IntArray, weight: FloatArray
) -> FloatArray:
    """Sums (K, 5, 6) over the points of each piece, of products of five derivatives and distance.

    The derivatives of the distance of a point are those by x and y of the start of its piece, by
    the bulge, and by x and y of the end. The sixth column is the distance itself.
    """
    count = len(chain.corners)
    a, b, g = chain.corners[piece], np.roll(chain.corners, -1)[piece], chain.bulges[piece]
    error = measure_from_arcs(points, a, b, g)
    shifts = (
        (_STEP_PX, 0, 0),
        (1j * _STEP_PX, 0, 0),
        (0, 0, _STEP_PX),
        (0, _STEP_PX, 0),
        (0, 1j * _STEP_PX, 0),
    )
    slopes = [
        (measure_from_arcs(points, a + p, b + q, g + r) - error) / _STEP_PX for p, q, r in shifts
    ]
    columns = np.stack([*slopes, error])
    columns[2] *= ~chain.straight[piece]
    first = np.searchsorted(piece, np.arange(count))
    products = np.empty((count, 5, 6))
    for i in range(5):
        products[:, i] = np.add.reduceat(columns * (weight * columns[i]), first, axis=1).T
    return products


def _add_tangents(chain: FittedChain, matrix: FloatArray, right: FloatArray) -> None:
    """Add a heavy row for each tangential corner, at which both pieces have one direction.

    `matrix` and `right` are the normal equations, which are changed.
    """
    k = np.flatnonzero(chain.smooth)
    count = len(chain.corners)
    before, after = (k - 1) % count, (k + 1) % count
    into, out = chain.corners[k] - chain.corners[before], chain.corners[after] - chain.corners[k]
    g0, g1 = chain.bulges[before], chain.bulges[k]
    error = _measure_kinks(chain)[k]
    turn0 = 1j * into / np.maximum(np.abs(into), 1e-6) ** 2
    turn1 = 1j * out / np.maximum(np.abs(out), 1e-6) ** 2
    bulge0 = -2 / (1 + g0 * g0) * ~chain.straight[before]
    bulge1 = -2 / (1 + g1 * g1) * ~chain.straight[k]
    of_before = np.stack([turn0.real, turn0.imag, bulge0], axis=1)
    of_corner = np.stack([-(turn0 + turn1).real, -(turn0 + turn1).imag, bulge1], axis=1)
    of_after = np.stack([turn1.real, turn1.imag, np.zeros(len(k))], axis=1)
    rows = np.stack([of_before, of_corner, of_after], axis=1) * _TANGENT_WEIGHT
    places = np.stack([before, k, after], axis=1)
    for i in range(3):
        np.add.at(right, places[:, i], -rows[:, i] * (error * _TANGENT_WEIGHT)[:, None])
        for j in range(3):
            np.add.at(
                matrix,
                (places[:, i], np.full(len(k), j - i + 2)),
                rows[:, i, :, None] * rows[:, j, None, :],
            )


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve the normal equations in windows, whose margins are so wide that errors die out.

    Returns the steps (K, 3).
    """
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
        # In a chain of two pieces a pair of corners occurs twice, and `np.add.at` adds both blocks.
        blocks = matrix[rows[:, inside], k + 2].swapaxes(0, 1)
        np.add.at(whole, (place[inside], column[inside] % size), blocks)
    whole = whole.transpose(2, 0, 3, 1, 4)
    steps = np.linalg.solve(
        whole.reshape(len(starts), size * 3, size * 3), right[rows].reshape(len(starts), -1, 1)
    )
    result = np.zeros((count, 3))
    kept = slice(0, count) if count <= _WINDOW else slice(_MARGIN, _MARGIN + step)
    result[rows[:, kept]] = steps.reshape(len(starts), size, 3)[:, kept]
    return result


# Small radii at the corners of a chain, and pieces that do not follow their points.

#: Points before and after a corner from which its rounding is measured.
_CORNER_POINTS = 10
#: A corner has a radius if its points pass it at more than this many times the distance that the
#: blur explains. A sharp corner reaches 1.4 times, depending on how the pixels lie. A right angle
#: needs a radius of 2.6 sigmas of the blur.
_MIN_RADIUS_FACTOR = 1.45
#: px: and at this much more.
_MIN_RADIUS_PX = 0.05
#: px: a sharp corner is not a corner if its points pass it at this much more than that,
_MAX_PASS_PX = 1.0
#: or at more than this many sigmas of the blur, and px. Lines that are almost parallel cross
#: anywhere.
_MAX_PASS_BLURS, _MAX_PASS_BLURS_PX = 2.5, 0.7
#: Distance of the half-way threshold in a picture from the vertex of a sharp corner, relative to
#: that in the picture of a Gaussian.
_PASS_FACTOR = 1.08
#: rad: angles between which a radius can be measured.
_MEASURABLE_TURN = np.radians([5.0, 150.0])
#: Largest fraction of a neighbouring piece that a fillet takes.
_MAX_FILLET_FRACTION = 0.45
#: rad: a corner that turns by more may be due to a wrong fit, so points that it passes count.
_POINTED = np.radians(110.0)
#: px: largest distance of the places at a quarter, half and three quarters of a piece from its
#: points.
_MAX_GAP_PX = 3.0
#: Standard deviations of the noise by which the points of a piece may be off, rms,
_SIGMAS = 3.0
#: and px more.
_EXTRA_PX = 0.1


class Fillets(Struct, frozen=True, eq=False):
    """Corners of a chain of K pieces.

    reach: (K,) distance of the corner from the beginning of its arc, px, 0 for a sharp corner.
    turn: (K,) change of direction, rad.
    lost: (K,) the points are too far from the corner, and a fillet does not explain it.
    rounding: (K,) distance of a sharp corner from its points that the blur explains, px.
    zone: (K,) distance from a sharp corner within which the blur moves points, px.
    """

    reach: FloatArray
    turn: FloatArray
    lost: BoolArray
    rounding: FloatArray
    zone: FloatArray


def find_places(
    a: ComplexArray, b: ComplexArray, bulges: FloatArray, fraction: float | FloatArray
) -> ComplexArray:
    """The places (K,) at a fraction of the length of each line or arc, px.

    a, b, bulges: (K,) beginning, end and bulge of the lines and arcs.
    """
    sweep = 4 * np.arctan(bulges)
    is_arc = np.abs(sweep) > 1e-6
    safe = np.where(is_arc, sweep, 1.0)
    # Along an arc the chord grows as exp(i sweep fraction) - 1, up to exp(i sweep) - 1 at its end.
    on_arc = np.expm1(1j * safe * fraction) / np.expm1(1j * safe)
    return np.asarray(a + (b - a) * np.where(is_arc, on_arc, fraction))


def _find_places(chain: FittedChain, fraction: float | FloatArray) -> ComplexArray:
    return find_places(chain.corners, np.roll(chain.corners, -1), chain.bulges, fraction)


def measure_errors(chain: FittedChain, points: ComplexArray, piece: IntArray) -> FloatArray:
    """Signed distances (N,) of points from their pieces, px."""
    ends = np.roll(chain.corners, -1)
    return measure_from_arcs(points, chain.corners[piece], ends[piece], chain.bulges[piece])


def select_beyond(
    chain: FittedChain, fillets: Fillets, points: ComplexArray, piece: IntArray
) -> BoolArray:
    """Select the points (N,) that are not within reach of a fillet of their piece."""
    end, end_reach = np.roll(chain.corners, -1)[piece], np.roll(fillets.reach, -1)[piece]
    at_start = np.abs(points - chain.corners[piece]) < fillets.reach[piece]
    return np.asarray(~at_start & ~(np.abs(points - end) < end_reach))


def measure_roundings(
    chain: FittedChain, fillets: Fillets, points: ComplexArray, piece: IntArray
) -> FloatArray:
    """Distance (N,) of points from a sharp corner that the blur explains, px.

    0 for points that are not near a sharp corner.
    """
    explained = np.zeros(len(points))
    for corner in (piece, (piece + 1) % len(chain.corners)):
        near = np.abs(points - chain.corners[corner]) < fillets.zone[corner]
        explained = np.maximum(explained, np.where(near, fillets.rounding[corner], 0.0))
    return explained


def compute_astray_limit(sigma: float) -> float:
    """The largest rms distance, px, of points with the noise `sigma` (px) from their own curve."""
    return _SIGMAS * sigma + _EXTRA_PX


def find_astray(
    chain: FittedChain,
    fillets: Fillets,
    points: ComplexArray,
    piece: IntArray,
    counts: BoolArray,
    sigma: float,
) -> BoolArray:
    """Find the pieces (K,) that do not follow their points.

    If a corner is lost, it is the shorter one of its two pieces.

    counts: (N,) the point counts.
    sigma: noise of the points, px.
    """
    count = len(chain.corners)
    begin = np.searchsorted(piece, np.arange(count))
    squares = measure_errors(chain, points, piece) ** 2 * counts
    mean = np.add.reduceat(squares, begin) / np.maximum(np.add.reduceat(counts * 1.0, begin), 1)
    is_bad = mean > compute_astray_limit(sigma) ** 2
    for fraction in (0.25, 0.5, 0.75):
        distance = np.abs(points - _find_places(chain, fraction)[piece])
        is_bad |= ~(np.minimum.reduceat(distance, begin) < _MAX_GAP_PX)
    size = np.bincount(piece, minlength=count)
    is_shorter = size <= np.roll(size, 1)
    is_bad |= fillets.lost & is_shorter | np.roll(fillets.lost & ~is_shorter, -1)
    return is_bad | ~np.isfinite(chain.bulges)


def measure_fillets(
    chain: FittedChain, points: ComplexArray, piece: IntArray, blur: float, sigma: float
) -> Fillets:
    """Measure the small radii at the corners of a chain, by how far its points are from a corner.

    The picture of a corner of radius r passes the vertex at the root of the sum of two squares: of
    the distance of the arc, r (1 / cos(turn / 2) - 1), and of that of the picture of a sharp
    corner. It is exact to 0.1 px on drawn pictures.

    blur, sigma: sigma of the blur, and noise of the points, px.
    """
    chord = np.roll(chain.corners, -1) - chain.corners
    length = np.maximum(np.abs(chord), 1e-9)
    half_sweep = np.exp(2j * np.arctan(chain.bulges))
    out, into = chord / length / half_sweep, np.roll(chord / length * half_sweep, 1)
    turn = np.angle(out * into.conj())
    inwards = 1j * np.sign(turn) * into * np.exp(0.5j * turn)
    depth = _measure_depths(chain.corners, inwards, points, piece)
    sharp_depth = _PASS_FACTOR * np.interp(np.abs(turn), TURNS, PASSES) * blur
    angle = np.abs(turn).clip(*_MEASURABLE_TURN)
    arc_depth = np.sqrt(np.maximum(depth**2 - sharp_depth**2, 0.0))
    reach = arc_depth / (1 / np.cos(angle / 2) - 1) * np.tan(angle / 2)
    max_reach = _MAX_FILLET_FRACTION * np.minimum(length, np.roll(length, 1))
    has_radius = (
        (depth > _MIN_RADIUS_FACTOR * sharp_depth + _MIN_RADIUS_PX + sigma)
        & (angle == np.abs(turn))
        & (reach < max_reach)
        & ~chain.smooth
        & (len(turn) > 2)
    )
    max_depth = np.minimum(
        _MIN_RADIUS_FACTOR * sharp_depth + _MAX_PASS_PX, _MAX_PASS_BLURS * blur + _MAX_PASS_BLURS_PX
    )
    is_lost = ~has_radius & ~chain.smooth & (depth > max_depth)
    zone = np.where(chain.smooth, 0.0, compute_zone(turn, np.full(len(turn), blur)))
    rounding = np.where(np.abs(turn) < _POINTED, sharp_depth, 0.0)
    return Fillets(np.where(has_radius, reach, 0.0), turn, is_lost, rounding, zone)


def make_no_fillets(chain: FittedChain) -> Fillets:
    """Sharp corners, without looking for radii."""
    none = np.zeros(len(chain.corners))
    return Fillets(none, none, none > 0, none, none)


def _measure_depths(
    corners: ComplexArray, inwards: ComplexArray, points: ComplexArray, piece: IntArray
) -> FloatArray:
    """Distance (K,) at which the points around each corner pass it, in the direction `inwards`, px.

    Only points of the halves of its two pieces next to the corner count.
    """
    size = np.bincount(piece, minlength=len(corners))
    begin = compute_first_rows(size)
    offset = np.arange(-_CORNER_POINTS, _CORNER_POINTS)
    rows = (begin[:, None] + offset) % len(points)
    local = (points[rows] - corners[:, None]) * inwards[:, None].conj()
    is_near = (offset >= -np.roll(size, 1)[:, None] / 2) & (offset < size[:, None] / 2)
    lowest = np.argmin(np.where(is_near, local.real, np.inf), axis=1).clip(1, len(offset) - 2)
    three = local[np.arange(len(corners))[:, None], lowest[:, None] + np.arange(-1, 2)]
    return find_valley(three.imag.T, three.real.T)


def repair(
    chain: FittedChain, fillets: Fillets, bad: BoolArray, points: ComplexArray, piece: IntArray
) -> tuple[ComplexArray, FloatArray, IntArray]:
    """Insert the fillets into a chain, and replace bad pieces by lines between their points.

    bad: (K,) the piece is replaced.
    piece: (N,) piece to which each point belongs, ascending; each piece has a point.

    Returns corners (M,), bulges (M,), and the piece (M,) of the chain that each belongs to.
    """
    rounded = np.where(bad | np.roll(bad, 1), 0.0, fillets.reach)
    begin = np.searchsorted(piece, np.arange(len(bad) + 1))
    length = _measure_lengths(chain)
    low, high = rounded / length, 1 - np.roll(rounded, -1) / length
    # The corner beside a bad piece is unreliable, so the piece next to it ends at its own points.
    low = np.where(np.roll(bad, 1), _find_fractions(chain, points[begin[:-1]]), low)
    high = np.where(np.roll(bad, -1), _find_fractions(chain, points[begin[1:] - 1]), high)
    first, last = _find_places(chain, low), _find_places(chain, high)
    bulges = np.tan(np.arctan(chain.bulges) * (high - low))
    corners: list[ComplexArray] = []
    shapes: list[FloatArray] = []
    for k in range(len(bad)):
        after = (k + 1) % len(bad)
        piece_corners, shape = first[k : k + 1], bulges[k : k + 1]
        if bad[k]:
            piece_corners = points[begin[k] : begin[k + 1]]
            shape = np.zeros(len(piece_corners))
        elif bad[after] or rounded[after] > 0:
            # A line or a fillet lies between the end of this piece and the beginning of the next.
            piece_corners = np.append(piece_corners, last[k])
            shape = np.append(shape, 0.0 if bad[after] else np.tan(fillets.turn[after] / 4))
        corners.append(piece_corners)
        shapes.append(shape)
    return np.concatenate(corners), np.concatenate(shapes), list_owners(count_rows(corners))


def _measure_lengths(chain: FittedChain) -> FloatArray:
    """Length (K,) of each piece along its curve, px."""
    chord = np.abs(np.roll(chain.corners, -1) - chain.corners)
    half_sweep = 2 * np.arctan(chain.bulges)
    is_arc = np.abs(half_sweep) > 1e-9
    safe = np.where(is_arc, half_sweep, 1.0)
    return np.asarray(np.maximum(chord * np.where(is_arc, safe / np.sin(safe), 1.0), 1e-9))


def _find_fractions(chain: FittedChain, points: ComplexArray) -> FloatArray:
    """Fraction of each piece at the foot of its point (K,): 0 at the start, 1 at the end."""
    a, b, bulge = chain.corners, np.roll(chain.corners, -1), chain.bulges
    is_arc = np.abs(bulge) > 1e-6
    safe = np.where(is_arc, bulge, 1.0)
    centre = (a + b) / 2 + 1j * (b - a) * (1 - safe**2) / (4 * safe)
    middle = _find_places(chain, 0.5) - centre
    middle = np.where(np.abs(middle) > 1e-9, middle, 1.0)
    on_arc = 0.5 + np.angle((points - centre) / middle) / (4 * np.arctan(safe))
    on_line = ((points - a) * (b - a).conj()).real / np.maximum(np.abs(b - a) ** 2, 1e-18)
    return np.asarray(np.where(is_arc, on_arc, on_line))
