"""The border of a pixel mask to a fraction of a pixel, and the exact distance to it.

Between a pixel of the part and its neighbour outside, the border crosses the line that joins their centres. Where, the
mask does not say; but what is smooth over many pixels must cross all of these links. So parabolas are fitted to
stretches of the border, as long ones as still cross every link, and averaged. For lines this is the idea of maximal
segments (Lachaud, Vialard, de Vieilleville: Fast, accurate and convergent tangent estimation on digital contours,
2007). A straight edge along the pixels keeps its doubt of half a pixel: the mask knows no more.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from camgen.geometry.ragged import ramp
from camgen.geometry.rings import ComplexArray, Rings, find_latest, make_rings, unit
from camgen.geometry.segments import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.plan.image_space.field import FieldCurves

Singles = NDArray[np.float32]

#: Half lengths, in links, of the stretches that are tried.
_STRETCHES = (3, 6, 12, 24, 48, 96)
#: How far (px) a parabola may miss a link: the noise of a mask from a photo.
_MISS = 0.1
#: Unit steps by Freeman code, v down: 0 to the right, 2 up. Even ones lead to the four direct neighbours.
_STEPS = np.array([1, 1 - 1j, -1j, -1 - 1j, -1, -1 + 1j, 1j, 1 + 1j])
#: Freeman code by (v + 1, u + 1).
_CODES = np.array([[3, 2, 1], [4, 0, 0], [5, 6, 7]])
#: By how much (px) a foot may be farther than the distance image says: half a pixel at each end, and its slant.
_DOUBT = 2.0
#: Half the side (px) of the square in which a point of the border is looked for.
_WINDOW = 3
#: Ways along the border (rows) that are tried for a nearer point: from a guess, and from where one was just now.
FAR = np.array([[-24, -12, -6, -3, 0, 3, 6, 12, 24]] * 2 + [[-4, -3, -2, -1, 0, 1, 2, 3, 4]])
CLOSE = np.array([[-3, -2, -1, 0, 1, 2, 3]])


class Border(Struct, frozen=True, eq=False):
    """Closed curves of points about a pixel apart, what they enclose on the left as seen on the screen.

    points, away: (N,), unit normals out of what is enclosed. rows: (H, W) row + 1 of a point in that pixel, 0: none.
    """

    table: Rings
    points: ComplexArray
    away: ComplexArray
    rows: NDArray[np.int32]


def border(table: Rings, points: ComplexArray, shape: tuple[int, ...]) -> Border:
    """A border through `points`; shape: (H, W) of the picture."""
    # The clockwise quarter turn of the travel points to its right, out of what lies on its left.
    away = unit(1j * (points[table.shifted(2)] - points[table.shifted(-2)]))
    rows = np.zeros(shape, dtype=np.int32)
    u, v = np.rint(points.real).astype(np.int64), np.rint(points.imag).astype(np.int64)
    seen = (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
    rows[v[seen], u[seen]] = np.flatnonzero(seen) + 1
    return Border(table, points, away, rows)


def between_pixels(found: FieldCurves) -> tuple[Rings, ComplexArray]:
    """The smooth curves between the pixels of a mask and those outside, from its chains. Loops keep their order."""
    table, inner, outer = _links(found)
    middle = (inner + outer) / 2
    # Where not even the shortest stretch crosses its links, as in the midst of a corner, the middles are kept.
    total, weight = middle * 1e-9, np.full(len(middle), 1e-9)
    # Every curve with its end before its start and its start after its end, so that stretches are slices.
    longest = _STRETCHES[-1]
    padded = make_rings(table.count + 2 * longest)
    row = table.first[padded.loop]
    row = row + (ramp(padded.count) - longest) % table.count[padded.loop]
    # Single precision is enough for what is near the origin.
    origin = middle[table.first][padded.loop]
    columns = (*_parts(middle[row] - origin), *_parts((outer - inner)[row] / 2))
    for half in _STRETCHES:
        centre = np.arange(0, len(middle), max(1, half // 3))
        centre = centre[table.count[table.loop[centre]] > 2 * half]
        begin = centre + (2 * table.loop[centre] + 1) * longest - half
        u, v, right, down = (sliding_window_view(column, 2 * half + 1)[begin] for column in columns)
        place = np.arange(-half, half + 1)
        fit, good = _parabolas((place / half).astype(np.float32), (u, v), (right, down))
        at = row[(begin[good, None] + place + half).ravel()]
        tent = np.broadcast_to(
            half**4 * (1 - np.abs(place) / (half + 1)), (len(at) // len(place), len(place))
        ).ravel()
        weight += np.bincount(at, tent, len(middle))
        curve = (fit[0][good] + 1j * fit[1][good]).ravel() + middle[table.first][table.loop[at]]
        total += np.bincount(at, tent * curve.real, len(middle)) + 1j * np.bincount(
            at, tent * curve.imag, len(middle)
        )
    return table, total / weight


def _parts(points: ComplexArray) -> tuple[Singles, Singles]:
    return points.real.astype(np.float32), points.imag.astype(np.float32)


def _links(found: FieldCurves) -> tuple[Rings, ComplexArray, ComplexArray]:
    """Pixel pairs (inside, outside) along the borders, in order.

    At each pixel, what lies between the step back to the pixel before and the step on to the next, counter-clockwise
    on the screen, is outside; the direct neighbours among it are links.
    """
    pixels = found.pixels
    back = _code(pixels[found.table.shifted(-1)] - pixels)
    ahead = _code(pixels[found.table.shifted(1)] - pixels)
    turn = np.arange(1, 8)
    code = (back[:, None] + turn) % 8
    outside = (turn <= ((ahead - back - 1) % 8)[:, None]) & (code % 2 == 0)
    row, column = np.nonzero(outside)
    table = make_rings(np.bincount(found.table.loop[row], minlength=len(found.table.count)))
    return table, pixels[row], pixels[row] + _STEPS[code[row, column]]


def _code(step: ComplexArray) -> IntArray:
    return np.asarray(_CODES[step.imag.astype(np.int64) + 1, step.real.astype(np.int64) + 1])


def _parabolas(
    place: Singles, points: tuple[Singles, Singles], links: tuple[Singles, Singles]
) -> tuple[tuple[Singles, Singles], BoolArray]:
    """Least-squares parabolas (C, P) through C stretches of `points`, and whether each crosses all its links, (C,).

    links: (C, P) from the middle of each link, which is in `points`, to its outer end. All in u and v.
    """
    powers = np.stack([np.ones_like(place), place, place**2])
    weights = np.linalg.pinv(powers).T.astype(np.float32)
    # Sums of products by einsum: for so narrow matrices it is many times as fast as the product of matrices.
    factors = [[np.einsum("cp,p->c", one, weight)[:, None] for weight in weights] for one in points]
    fits = [a + place * (b + place * c) for a, b, c in factors]
    u, v = (b + 2 * place * c for _, b, c in factors)
    # Across the travel (u, v) lies (-v, u), on the right and so outside. A link of half length h is crossed where the
    # parabola passes its middle by less than what h is long in that direction.
    missed = np.abs((points[1] - fits[1]) * u - (points[0] - fits[0]) * v) - (
        links[1] * u - links[0] * v
    )
    crossed: BoolArray = (missed <= _MISS * np.sqrt(u * u + v * v)).all(axis=1)
    return (fits[0], fits[1]), crossed


def near(line: Border, about: ComplexArray) -> IntArray:
    """(N,) the row of a point of the border in the pixel nearest to `about`; -1 where there is none around it."""
    step = np.arange(-_WINDOW, _WINDOW + 1)
    right, down = np.tile(step, len(step)), np.repeat(step, len(step))
    nearest = np.argsort(right**2 + down**2, kind="stable")
    height, width = line.rows.shape
    u = np.clip(np.rint(about.real).astype(np.int64), _WINDOW, width - 1 - _WINDOW)
    v = np.clip(np.rint(about.imag).astype(np.int64), _WINDOW, height - 1 - _WINDOW)
    around = line.rows.ravel()[(v * width + u)[:, None] + (down * width + right)[nearest]]
    first = np.argmax(around > 0, axis=1)
    row: IntArray = around[np.arange(len(about)), first].astype(np.int64) - 1
    return row


def foot(
    line: Border, points: ComplexArray, start: IntArray, ways: IntArray
) -> tuple[ComplexArray, IntArray]:
    """The nearest point (N,) of the border and its row, found from the rows `start` by going along it: steps of
    `ways` (S, W), one row of them after the other.
    """
    row = start
    for way in ways:
        tried = line.table.along(row[:, None], way)
        row = tried[
            np.arange(len(row)), np.argmin(_squares(line.points[tried] - points[:, None]), axis=1)
        ]
    here = line.points[row]
    best, gap = here, np.abs(points - here)
    for by in (-1, 1):
        side = line.points[line.table.along(row, by)] - here
        part = np.clip(
            ((points - here) * side.conj()).real / np.maximum(_squares(side), 1e-18), 0.0, 1.0
        )
        on = here + part * side
        size = np.abs(points - on)
        best, gap = np.where(size < gap, on, best), np.minimum(size, gap)
    return best, row


def iso_line(
    line: Border,
    table: Rings,
    points: ComplexArray,
    about: ComplexArray,
    far: FloatArray,
    level: float,
) -> tuple[ComplexArray, ComplexArray]:
    """`points` (closed curves, `table`) brought to the distance `level` px from the border, and the gradient of
    that distance there, unit vectors.

    The distance is positive outside what the border encloses; `points` are on that side of it on which they end.
    about: where the nearest point of the border should be. far: how far away it is, to a pixel or two. Beside an inner
    corner a point has two sides to keep away from, so the feet of its neighbours are tried too, and the projection is
    repeated.
    """
    on, row = _feet(line, table, points, about, far)
    for again in range(3):
        for by in (-3, 3) if again else ():
            other, there = foot(line, points, row[table.shifted(by)], CLOSE)
            nearer = _squares(points - other) < _squares(points - on)
            on, row = np.where(nearer, other, on), np.where(nearer, there, row)
        gradient = np.sign(level) * unit(points - on)
        points = on + level * gradient
        on, row = foot(line, points, row, CLOSE)
    return points, gradient


def _feet(
    line: Border, table: Rings, points: ComplexArray, about: ComplexArray, far: FloatArray
) -> tuple[ComplexArray, IntArray]:
    """The nearest point (N,) of the border and its row: near `about`, else near that of the point before, else the
    nearest of all.
    """
    on, row = foot(line, points, np.maximum(near(line, about), 0), FAR)
    before = find_latest(table, np.abs(points - on) <= far + _DOUBT)
    lost = np.flatnonzero(np.abs(points - on) > far + _DOUBT)
    if len(lost):
        on[lost], row[lost] = foot(line, points[lost], row[np.maximum(before[lost], 0)], FAR)
    for k in lost[np.abs(points[lost] - on[lost]) > far[lost] + _DOUBT].tolist():
        row[k] = np.argmin(_squares(line.points - points[k]))
        on[k] = line.points[row[k]]
    return on, row


def _squares(vectors: ComplexArray) -> FloatArray:
    return np.asarray(vectors.real**2 + vectors.imag**2)
