"""Drawn pieces in flat arrays, and their clean-up before they are joined.

Repeated points and repeated pieces are dropped, and arcs above a half circle are halved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles
from camgen.geometry.ragged import (
    compute_offsets,
    find_following_rows,
    find_run_starts,
    list_owners,
    list_range_numbers,
)
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

#: mm: largest coordinate, a million kilometres. Larger ones are damage.
FARTHEST = 1e12
#: Bulges are equal if they are in one cell of a grid with this width.
_SAME_BULGE = 1e-6
#: Largest bulge. An arc with a larger one lacks less than a millionth of a degree of a full circle,
#: which is damage.
_WIDEST = 1e9
#: Names of layers that a note lists.
_MAX_LAYERS = 8


class DrawnPieces(Struct, frozen=True, eq=False):
    """P drawn pieces. Piece i has the rows first[i] to first[i + 1] of points and bulges.

    points: (V, 2) mm.
    bulges: (V,) bulge of the segment after each point. The last one of an open piece has no
        meaning.
    first: (P + 1,) first row of each piece, and the number of rows.
    closed: (P,) whether the piece returns to its first point.
    layer, kind, color: (P,) indices in `layers`, `kinds` and `colors`.
    layers, kinds, colors: names.
    """

    points: FloatArray
    bulges: FloatArray
    first: IntArray
    closed: BoolArray
    layer: IntArray
    kind: IntArray
    color: IntArray
    layers: tuple[str, ...]
    kinds: tuple[str, ...]
    colors: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.closed)

    def take(self, index: IntArray | BoolArray) -> DrawnPieces:
        """The pieces at `index`, in its order."""
        index = np.flatnonzero(index) if index.dtype == np.bool_ else index
        counts = np.diff(self.first)[index]
        rows = list_range_numbers(self.first[index], counts)
        return replace(
            self,
            points=self.points[rows],
            bulges=self.bulges[rows],
            first=compute_offsets(counts),
            closed=self.closed[index],
            layer=self.layer[index],
            kind=self.kind[index],
            color=self.color[index],
        )


def describe_elements(kinds: Iterable[str], layers: Iterable[str]) -> str:
    """The elements of a note, as in "1 HATCH, 3 TEXT on layers A, B".

    kinds: kind of each element, or the number of elements by kind.
    layers: layers of the elements, as they are in the file, or none.
    """
    text = format_counts(Counter(kinds))
    names = sorted({harmless(layer) for layer in layers})
    if not names:
        return text
    noun = "layers" if len(names) > 1 else "layer"
    return f"{text} on {noun} {list_first(names, _MAX_LAYERS)}"


def format_counts(counts: Mapping[str, int]) -> str:
    """Numbers of elements by kind, as in "1 HATCH, 3 TEXT"; "none" without elements."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items())) or "none"


def list_first(texts: Sequence[str], limit: int, separator: str = ", ", last: str = " ") -> str:
    """The first `limit` of `texts` with `separator`, then with `last` the number of the others."""
    listed = separator.join(texts[:limit])
    more = len(texts) - limit
    return f"{listed}{last}and {more} more" if more > 0 else listed


def index_names(names: Sequence[str]) -> tuple[tuple[str, ...], IntArray]:
    """The different names, sorted, and (N,) the index of each name among them."""
    different = sorted(set(names))
    index_of = {name: index for index, name in enumerate(different)}
    return tuple(different), np.array([index_of[name] for name in names], dtype=np.intp)


def find_next_rows(soup: DrawnPieces) -> IntArray:
    """(V,) the row after each row in its piece. The last row is followed by the first."""
    return find_following_rows(np.diff(soup.first))


def compute_same_distance(soup: DrawnPieces) -> float:
    """The distance up to which two points of the soup are one, mm."""
    largest = float(np.abs(soup.points).max(initial=0.0))
    return max(SAME_POINT_MM, 16 * float(np.spacing(largest)))


def are_credible(soup: DrawnPieces) -> BoolArray:
    """(P,) whether all numbers of a piece are within `FARTHEST` and the largest bulge."""
    if not len(soup):
        return np.zeros(0, dtype=np.bool_)
    with np.errstate(invalid="ignore"):
        good = (np.abs(soup.points) <= FARTHEST).all(axis=1) & (np.abs(soup.bulges) <= _WIDEST)
    return np.asarray(np.logical_and.reduceat(good, soup.first[:-1]))


def normalize_pieces(soup: DrawnPieces) -> DrawnPieces:
    """The pieces without repeated points and wide arcs, and with all full circles in one form.

    Arcs above a half circle are halved. A full circle is two half circles, counter-clockwise from
    the point with the largest x.
    """
    soup = _drop_repeats(soup)
    soup = _halve_wide_arcs(soup)
    rows = soup.first[:-1][soup.closed & (np.diff(soup.first) == 2)]
    bulges = soup.bulges[rows]
    rows = rows[(np.abs(bulges) == 1) & (bulges == soup.bulges[rows + 1])]
    if not len(rows):
        return soup
    points, bulges = soup.points.copy(), soup.bulges.copy()
    center = (points[rows] + points[rows + 1]) / 2
    arm = np.zeros((len(rows), 2))
    arm[:, 0] = np.hypot(*(points[rows] - points[rows + 1]).T) / 2
    points[rows], points[rows + 1] = center + arm, center - arm
    bulges[rows] = bulges[rows + 1] = 1.0
    return replace(soup, points=points, bulges=bulges)


def _drop_repeats(soup: DrawnPieces) -> DrawnPieces:
    """The pieces without points that lie on the next one. A piece keeps at least one point."""
    steps = soup.points[find_next_rows(soup)] - soup.points
    is_repeated = np.abs(steps).max(axis=1, initial=0.0) <= compute_same_distance(soup)
    counts = np.diff(soup.first)
    last = soup.first[1:] - 1
    is_repeated[last] &= soup.closed & (counts > 1)
    if not is_repeated.any():
        return soup
    # The later one of two equal points stays: it has the bulge of the segment that remains.
    piece = list_owners(counts)
    is_repeated[last[np.bincount(piece[~is_repeated], minlength=len(soup)) == 0]] = False
    keep = ~is_repeated
    counts = np.bincount(piece[keep], minlength=len(soup))
    return replace(
        soup,
        points=soup.points[keep],
        bulges=soup.bulges[keep],
        first=compute_offsets(counts),
    )


def _halve_wide_arcs(soup: DrawnPieces) -> DrawnPieces:
    """The pieces with each arc of more than a half circle as two arcs of half its angle."""
    is_segment = np.ones(len(soup.points), dtype=np.bool_)
    is_segment[(soup.first[1:] - 1)[~soup.closed]] = False
    wide = np.flatnonzero(is_segment & (np.abs(soup.bulges) > 1))
    if not len(wide):
        return soup
    bulge = soup.bulges[wide]
    middle = find_bulge_middles(soup.points[wide], bulge, soup.points[find_next_rows(soup)[wide]])
    half = np.tan(np.arctan(bulge) / 2)
    bulges = soup.bulges.copy()
    bulges[wide] = half
    piece = np.searchsorted(soup.first, wide, side="right") - 1
    counts = np.diff(soup.first) + np.bincount(piece, minlength=len(soup))
    return replace(
        soup,
        points=np.insert(soup.points, wide + 1, middle, axis=0),
        bulges=np.insert(bulges, wide + 1, half),
        first=compute_offsets(counts),
    )


def are_first(soup: DrawnPieces, label: IntArray) -> BoolArray:
    """(P,) whether a piece differs from all before it.

    Equal pieces may run in opposite directions, and closed ones may start at different points.

    label: (P,) pieces of different labels are not compared.
    """
    keep = np.ones(len(soup), dtype=np.bool_)
    counts = np.diff(soup.first)
    groups = (counts * 2 + soup.closed) * (int(label.max(initial=0)) + 1) + label
    cell = compute_same_distance(soup)
    order = np.argsort(groups, kind="stable")
    for members in np.split(order, find_run_starts(groups[order])[1:]):
        if len(members) < 2:
            continue
        rows = soup.first[members][:, None] + np.arange(counts[members[0]])
        points = np.floor(soup.points[rows] / cell + OFF_GRID).astype(np.int64)
        bulges = np.floor(soup.bulges[rows] / _SAME_BULGE + OFF_GRID).astype(np.int64)
        # OFF_GRID is not one half, so the cell of -b is not minus the cell of b.
        negated = np.floor(-soup.bulges[rows] / _SAME_BULGE + OFF_GRID).astype(np.int64)
        keys = _make_keys(points, bulges, negated, bool(soup.closed[members[0]]))
        seen: set[bytes] = set()
        for k in _find_candidates(keys).tolist():
            row = keys[k].tobytes()
            keep[members[k]] = row not in seen
            seen.add(row)
    return keep


def _find_candidates(keys: NDArray[np.int64]) -> IntArray:
    """The rows of `keys` (N, K) that may equal another row, all equal ones among them.

    They have the same sum, in which each column has a factor of its own. Sorting the rows
    themselves takes ten times as long.
    """
    factors = np.random.default_rng(0).integers(1, 2**62, (keys.shape[1],), dtype=np.uint64)
    total = (keys.view(np.uint64) * (2 * factors + 1)).sum(axis=1)
    ranked = np.sort(total)
    return np.flatnonzero(np.isin(total, ranked[1:][ranked[1:] == ranked[:-1]]))


def _make_keys(
    points: NDArray[np.int64], bulges: NDArray[np.int64], negated: NDArray[np.int64], closed: bool
) -> NDArray[np.int64]:
    """(N, K) a key of each piece that is the same for both directions and all starts of a loop.

    points: (N, M, 2) cells of the points.
    bulges, negated: (N, M) cells of the bulges, and of the bulges with the opposite sign.
    """
    if closed:
        forward = _rotate(points, bulges)
        backward = _rotate(points[:, ::-1], np.roll(negated[:, ::-1], -1, axis=1))
    else:
        count = len(points)
        forward = np.concatenate([points.reshape(count, -1), bulges[:, :-1]], axis=1)
        backward = np.concatenate([points[:, ::-1].reshape(count, -1), negated[:, -2::-1]], axis=1)
    at = np.argmax(forward != backward, axis=1)[:, None]
    less = np.take_along_axis(forward, at, axis=1) <= np.take_along_axis(backward, at, axis=1)
    return np.where(less, forward, backward)


def _rotate(points: NDArray[np.int64], bulges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Points and bulges of each loop in one row, from its leftmost and then lowest point on."""
    count, size, _ = points.shape
    x = points[:, :, 0]
    y = np.where(x == x.min(axis=1, keepdims=True), points[:, :, 1], np.iinfo(np.int64).max)
    turn = (np.argmin(y, axis=1)[:, None] + np.arange(size)) % size
    rotated = np.take_along_axis(points, turn[:, :, None], axis=1).reshape(count, -1)
    return np.concatenate([rotated, np.take_along_axis(bulges, turn, axis=1)], axis=1)
