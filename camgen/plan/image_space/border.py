"""The border of a pixel mask to a fraction of a pixel, and the exact distance from it.

Between a pixel of the part and its neighbour outside, the border crosses the line that joins their
centres, a link. A mask does not show where. But a border that is smooth over many pixels has to
cross all their links. So parabolas are fitted to stretches of the border, as long as they still
cross every link, and averaged. For lines this is the idea of maximal segments (Lachaud, Vialard,
de Vieilleville: Fast, accurate and convergent tangent estimation on digital contours, 2007). A
straight edge along the pixels stays uncertain by half a pixel, since the mask holds no more.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from camgen.geometry.ragged import number_rows
from camgen.geometry.rings import ComplexArray, Rings, find_latest, make_rings, normalize
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.plan.image_space.field import FieldCurves

Singles = NDArray[np.float32]

#: Half lengths of the stretches to which parabolas are fitted, in links.
_STRETCHES = (3, 6, 12, 24, 48, 96)
#: Maximum distance by which a parabola may miss a link, px: the noise of a mask from a photo.
_MISS = 0.1
#: Unit steps by Freeman code, v down: 0 to the right, 2 up. Even codes are direct neighbours.
_STEPS = np.array([1, 1 - 1j, -1j, -1 - 1j, -1, -1 + 1j, 1j, 1 + 1j])
#: Freeman code by (v + 1, u + 1).
_CODES = np.array([[3, 2, 1], [4, 0, 0], [5, 6, 7]])
#: Maximum excess of a measured distance over the distance image, px: half a pixel at both ends,
#: and the slant.
_UNCERTAINTY = 2.0
#: Half the side of the square in which a point of the border is searched, px.
_WINDOW = 3
#: Steps along the border, in rows, of a search for the nearest point: from a guess, and from the
#: nearest point of the round before.
FAR = np.array([[-24, -12, -6, -3, 0, 3, 6, 12, 24]] * 2 + [[-4, -3, -2, -1, 0, 1, 2, 3, 4]])
CLOSE = np.array([[-3, -2, -1, 0, 1, 2, 3]])


class Border(Struct, frozen=True, eq=False):
    """Closed curves with their inside on the left as seen on the screen, a point about every pixel.

    table: lengths of the curves.
    points: (N,) px.
    outward: (N,) unit normals.
    rows: (H, W) row + 1 of a point in that pixel, 0 without a point.
    """

    table: Rings
    points: ComplexArray
    outward: ComplexArray
    rows: NDArray[np.int32]


def make_border(table: Rings, points: ComplexArray, shape: tuple[int, ...]) -> Border:
    """A border through `points`. shape: (H, W) of the picture."""
    # A clockwise quarter turn of the travel points to its right, which is outside.
    outward = normalize(1j * (points[table.shifted(2)] - points[table.shifted(-2)]))
    rows = np.zeros(shape, dtype=np.int32)
    u, v = np.rint(points.real).astype(np.int64), np.rint(points.imag).astype(np.int64)
    is_visible = (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
    rows[v[is_visible], u[is_visible]] = np.flatnonzero(is_visible) + 1
    return Border(table, points, outward, rows)


def fit_border(chains: FieldCurves) -> tuple[Rings, ComplexArray]:
    """Fit smooth curves between the pixels of a mask and those outside. Their order stays."""
    table, inner, outer = _find_links(chains)
    middle = (inner + outer) / 2
    # In a corner even the shortest stretch may miss its links: the middles of links are kept.
    total, weight = middle * 1e-9, np.full(len(middle), 1e-9)
    # Each curve is extended by its end before its start and its start after its end, so that
    # stretches are slices.
    longest = _STRETCHES[-1]
    padded = make_rings(table.count + 2 * longest)
    row = table.first[padded.loop]
    row = row + (number_rows(padded.count) - longest) % table.count[padded.loop]
    # Single precision is enough near the origin.
    origin = middle[table.first][padded.loop]
    columns = (*_to_singles(middle[row] - origin), *_to_singles((outer - inner)[row] / 2))
    for half in _STRETCHES:
        centre = np.arange(0, len(middle), max(1, half // 3))
        centre = centre[table.count[table.loop[centre]] > 2 * half]
        begin = centre + (2 * table.loop[centre] + 1) * longest - half
        u, v, right, down = (sliding_window_view(column, 2 * half + 1)[begin] for column in columns)
        place = np.arange(-half, half + 1)
        fit, good = _fit_parabolas((place / half).astype(np.float32), (u, v), (right, down))
        link = row[(begin[good, None] + place + half).ravel()]
        tent = half**4 * (1 - np.abs(place) / (half + 1))
        tent = np.broadcast_to(tent, (len(link) // len(place), len(place))).ravel()
        weight += np.bincount(link, tent, len(middle))
        curve = (fit[0][good] + 1j * fit[1][good]).ravel() + middle[table.first][table.loop[link]]
        real = np.bincount(link, tent * curve.real, len(middle))
        total += real + 1j * np.bincount(link, tent * curve.imag, len(middle))
    return table, total / weight


def _to_singles(points: ComplexArray) -> tuple[Singles, Singles]:
    return points.real.astype(np.float32), points.imag.astype(np.float32)


def _find_links(chains: FieldCurves) -> tuple[Rings, ComplexArray, ComplexArray]:
    """Pairs of pixels (inside, outside) along the borders, in order.

    At each pixel the directions between the step back and the step on, counter-clockwise on the
    screen, are outside. The direct neighbours among them are links.
    """
    pixels = chains.pixels
    back = _encode(pixels[chains.table.shifted(-1)] - pixels)
    ahead = _encode(pixels[chains.table.shifted(1)] - pixels)
    turn = np.arange(1, 8)
    code = (back[:, None] + turn) % 8
    outside = (turn <= ((ahead - back - 1) % 8)[:, None]) & (code % 2 == 0)
    row, column = np.nonzero(outside)
    table = make_rings(np.bincount(chains.table.loop[row], minlength=len(chains.table.count)))
    return table, pixels[row], pixels[row] + _STEPS[code[row, column]]


def _encode(step: ComplexArray) -> IntArray:
    return np.asarray(_CODES[step.imag.astype(np.int64) + 1, step.real.astype(np.int64) + 1])


def _fit_parabolas(
    place: Singles, points: tuple[Singles, Singles], links: tuple[Singles, Singles]
) -> tuple[tuple[Singles, Singles], BoolArray]:
    """Least-squares parabolas (C, P) through C stretches, and (C,) whether each crosses its links.

    points: u and v (C, P) of the middles of the links.
    links: u and v (C, P) from the middle of each link to its outer end.
    """
    weights = np.linalg.pinv(np.stack([np.ones_like(place), place, place**2])).T.astype(np.float32)
    # For matrices so narrow, einsum is many times as fast as the product of matrices.
    factors = []
    for coordinate in points:
        sums = (np.einsum("cp,p->c", coordinate, weight)[:, None] for weight in weights)
        factors.append(tuple(sums))
    fits = [a + place * (b + place * c) for a, b, c in factors]
    u, v = (b + 2 * place * c for _, b, c in factors)
    # The direction (-v, u) is perpendicular to the travel (u, v), on its right and so outside. A
    # link is crossed if the parabola misses its middle by less than its half length there.
    missed = np.abs((points[1] - fits[1]) * u - (points[0] - fits[0]) * v) - (
        links[1] * u - links[0] * v
    )
    crossed: BoolArray = (missed <= _MISS * np.sqrt(u * u + v * v)).all(axis=1)
    return (fits[0], fits[1]), crossed


def find_near(border: Border, points: ComplexArray) -> IntArray:
    """(N,) row of a border point in the pixel nearest to each of `points`; -1 without one."""
    step = np.arange(-_WINDOW, _WINDOW + 1)
    right, down = np.tile(step, len(step)), np.repeat(step, len(step))
    nearest = np.argsort(right**2 + down**2, kind="stable")
    height, width = border.rows.shape
    u = np.clip(np.rint(points.real).astype(np.int64), _WINDOW, width - 1 - _WINDOW)
    v = np.clip(np.rint(points.imag).astype(np.int64), _WINDOW, height - 1 - _WINDOW)
    window = border.rows.ravel()[(v * width + u)[:, None] + (down * width + right)[nearest]]
    first = np.argmax(window > 0, axis=1)
    row: IntArray = window[np.arange(len(points)), first].astype(np.int64) - 1
    return row


def find_foot(
    border: Border, points: ComplexArray, start: IntArray, steps: IntArray
) -> tuple[ComplexArray, IntArray]:
    """The nearest point (N,) of the border to each of `points`, and its row.

    The search goes along the border from the rows `start`, in rounds by the rows of `steps` (S, W).
    """
    row = start
    for offsets in steps:
        tried = border.table.along(row[:, None], offsets)
        best = np.argmin(_squares(border.points[tried] - points[:, None]), axis=1)
        row = tried[np.arange(len(row)), best]
    vertex = border.points[row]
    nearest, distance = vertex, np.abs(points - vertex)
    for neighbour in (-1, 1):
        side = border.points[border.table.along(row, neighbour)] - vertex
        along = ((points - vertex) * side.conj()).real
        fraction = np.clip(along / np.maximum(_squares(side), 1e-18), 0.0, 1.0)
        on_side = vertex + fraction * side
        size = np.abs(points - on_side)
        nearest = np.where(size < distance, on_side, nearest)
        distance = np.minimum(size, distance)
    return nearest, row


def move_to_distance(
    border: Border,
    table: Rings,
    points: ComplexArray,
    about: ComplexArray,
    far: FloatArray,
    distance: float,
) -> tuple[ComplexArray, ComplexArray]:
    """Move points to a distance from the border, px, and compute the gradient of the distance.

    distance: positive outside the border. The points are on that side already.
    table: lengths of the closed curves of `points`.
    about: approximate nearest points of the border.
    far: approximate distances from the border, to a pixel or two.
    Near an inner corner a point has two sides to keep away from. So the nearest points of its
    neighbours are tried too, and the projection is repeated. Returns points and unit gradients.
    """
    foot, row = _find_feet(border, table, points, about, far)
    for round_ in range(3):
        for shift in (-3, 3) if round_ else ():
            other, other_row = find_foot(border, points, row[table.shifted(shift)], CLOSE)
            nearer = _squares(points - other) < _squares(points - foot)
            foot, row = np.where(nearer, other, foot), np.where(nearer, other_row, row)
        gradient = np.sign(distance) * normalize(points - foot)
        points = foot + distance * gradient
        foot, row = find_foot(border, points, row, CLOSE)
    return points, gradient


def _find_feet(
    border: Border, table: Rings, points: ComplexArray, about: ComplexArray, far: FloatArray
) -> tuple[ComplexArray, IntArray]:
    """The nearest point (N,) of the border to each of `points`, and its row.

    It is searched near `about`, then near that of the point before, then among all points.
    """
    foot, row = find_foot(border, points, np.maximum(find_near(border, about), 0), FAR)
    limit = far + _UNCERTAINTY
    before = find_latest(table, np.abs(points - foot) <= limit)
    lost = np.flatnonzero(np.abs(points - foot) > limit)
    if len(lost):
        start = row[np.maximum(before[lost], 0)]
        foot[lost], row[lost] = find_foot(border, points[lost], start, FAR)
    for k in lost[np.abs(points[lost] - foot[lost]) > limit[lost]].tolist():
        row[k] = np.argmin(_squares(border.points - points[k]))
        foot[k] = border.points[row[k]]
    return foot, row


def _squares(vectors: ComplexArray) -> FloatArray:
    return np.asarray(vectors.real**2 + vectors.imag**2)
