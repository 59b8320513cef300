"""Drawn pieces, flat in a few arrays, and what is cleaned before they are joined: repeats, wide arcs, duplicates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import find_bulge_middles
from camgen.geometry.ragged import following, offsets, owners, run_starts, stretches
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.model.tolerance import OFF_GRID, SAME_POINT_MM

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

#: Coordinates beyond this (mm) are damage: a million kilometres.
FARTHEST = 1e12
#: Bulges in one cell of a grid so wide are the same.
_SAME_BULGE = 1e-6
#: A bulge beyond this is damage too: an arc that lacks less than a millionth of a degree to a full circle.
_WIDEST = 1e9


class Soup(Struct, frozen=True, eq=False):
    """Drawn pieces, flat: piece i owns rows first[i] to first[i + 1] of points (V, 2, mm) and bulges (V,).

    The bulge of the last row of an open piece means nothing. layer, kind and color (P,) index layers, kinds and colors.
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

    def take(self, index: IntArray | BoolArray) -> Soup:
        """The pieces of ``index`` in its order."""
        index = np.flatnonzero(index) if index.dtype == np.bool_ else index
        counts = np.diff(self.first)[index]
        rows = stretches(self.first[index], counts)
        return replace(
            self,
            points=self.points[rows],
            bulges=self.bulges[rows],
            first=offsets(counts),
            closed=self.closed[index],
            layer=self.layer[index],
            kind=self.kind[index],
            color=self.color[index],
        )


def tally(kinds: Sequence[str], layers: Sequence[str]) -> str:
    """``3 TEXT, 1 HATCH on layers A, B``: what a note counts; names from the file made harmless."""
    return tally_counts(Counter(kinds), layers)


def tally_counts(counts: Mapping[str, int], layers: Iterable[str]) -> str:
    """The text of `tally` for numbers of elements by kind; layers may be empty."""
    text = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    names = sorted({harmless(layer) for layer in layers})
    if not names:
        return text
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    return f"{text} on layer{'s' if len(names) > 1 else ''} {shown}"


def next_row(soup: Soup) -> IntArray:
    """Row of the point that follows each row; the last row of a piece is followed by its first."""
    return following(np.diff(soup.first))


def same_distance(soup: Soup) -> float:
    """Below this distance (mm) two points of the soup are one."""
    reach = float(np.abs(soup.points).max(initial=0.0))
    return max(SAME_POINT_MM, 16 * float(np.spacing(reach)))


def credible(soup: Soup) -> BoolArray:
    """Which pieces (P,) have only credible numbers."""
    with np.errstate(invalid="ignore"):
        good = (np.abs(soup.points) <= FARTHEST).all(axis=1) & (np.abs(soup.bulges) <= _WIDEST)
    return (
        np.asarray(np.logical_and.reduceat(good, soup.first[:-1]))
        if len(soup)
        else np.zeros(0, dtype=np.bool_)
    )


def tidy(soup: Soup) -> Soup:
    """Without points that repeat their predecessor, arcs above a half circle halved, full circles in one form."""
    soup = _without_repeats(soup)
    soup = _halve(soup)
    full = soup.closed & (np.diff(soup.first) == 2)
    rows = soup.first[:-1][full]
    circle = np.abs(soup.bulges[rows]) == 1
    circle &= soup.bulges[rows] == soup.bulges[rows + 1]
    rows = rows[circle]
    if not len(rows):
        return soup
    points, bulges = soup.points.copy(), soup.bulges.copy()
    center = (points[rows] + points[rows + 1]) / 2
    radius = np.column_stack(
        [np.hypot(*(points[rows] - points[rows + 1]).T) / 2, np.zeros(len(rows))]
    )
    points[rows], points[rows + 1] = center + radius, center - radius
    bulges[rows] = bulges[rows + 1] = 1.0
    return replace(soup, points=points, bulges=bulges)


def _without_repeats(soup: Soup) -> Soup:
    """Drop every point that lies on the next one; a piece without any length keeps one point."""
    following = next_row(soup)
    near = np.abs(soup.points[following] - soup.points).max(axis=1, initial=0.0) <= same_distance(
        soup
    )
    counts = np.diff(soup.first)
    last = soup.first[1:] - 1
    near[last] &= soup.closed & (counts > 1)
    if not near.any():
        return soup
    # The row kept is the later one: it holds the bulge of the segment that remains.
    piece = owners(counts)
    near[last[np.bincount(piece[~near], minlength=len(soup)) == 0]] = False
    keep = ~near
    counts = np.bincount(piece[keep], minlength=len(soup))
    return replace(
        soup,
        points=soup.points[keep],
        bulges=soup.bulges[keep],
        first=offsets(counts),
    )


def _halve(soup: Soup) -> Soup:
    """Arcs of more than a half circle in two: tan of half the angle, with a point on the arc."""
    following = next_row(soup)
    used = np.ones(len(soup.points), dtype=np.bool_)
    used[(soup.first[1:] - 1)[~soup.closed]] = False
    wide = np.flatnonzero(used & (np.abs(soup.bulges) > 1))
    if not len(wide):
        return soup
    b = soup.bulges[wide]
    middle = find_bulge_middles(soup.points[wide], b, soup.points[following[wide]])
    half = np.tan(np.arctan(b) / 2)
    bulges = soup.bulges.copy()
    bulges[wide] = half
    piece = np.searchsorted(soup.first, wide, side="right") - 1
    counts = np.diff(soup.first) + np.bincount(piece, minlength=len(soup))
    return replace(
        soup,
        points=np.insert(soup.points, wide + 1, middle, axis=0),
        bulges=np.insert(bulges, wide + 1, half),
        first=offsets(counts),
    )


def first_of_its_kind(soup: Soup, label: IntArray) -> BoolArray:
    """(P,) whether each piece is not drawn before: in either direction, from any start if closed.

    label: (P,) pieces of different labels are not compared.
    """
    keep = np.ones(len(soup), dtype=np.bool_)
    counts = np.diff(soup.first)
    sorts = (counts * 2 + soup.closed) * (int(label.max(initial=0)) + 1) + label
    cell = same_distance(soup)
    order = np.argsort(sorts, kind="stable")
    for members in np.split(order, run_starts(sorts[order])[1:]):
        if len(members) < 2:
            continue
        rows = soup.first[members][:, None] + np.arange(counts[members[0]])
        points = np.floor(soup.points[rows] / cell + OFF_GRID).astype(np.int64)
        bulges = np.floor(soup.bulges[rows] / _SAME_BULGE + OFF_GRID).astype(np.int64)
        # Minus a bulge is one cell off, as OFF_GRID is not one half: round the negative one for itself.
        back = np.floor(-soup.bulges[rows] / _SAME_BULGE + OFF_GRID).astype(np.int64)
        keys = _keys(points, bulges, back, bool(soup.closed[members[0]]))
        seen: set[bytes] = set()
        for k in _perhaps_twice(keys).tolist():
            row = keys[k].tobytes()
            keep[members[k]] = row not in seen
            seen.add(row)
    return keep


def _perhaps_twice(keys: NDArray[np.int64]) -> IntArray:
    """The rows of ``keys`` (N, K) that may be there more than once, among them all that are: those whose sum, each
    number with a factor of its own, is that of another. To sort the rows themselves takes ten times as long.
    """
    factors = np.random.default_rng(0).integers(1, 2**62, (keys.shape[1],), dtype=np.uint64)
    total = (keys.view(np.uint64) * (2 * factors + 1)).sum(axis=1)
    ranked = np.sort(total)
    again = ranked[1:][ranked[1:] == ranked[:-1]]
    return np.flatnonzero(np.isin(total, again))


def _keys(
    points: NDArray[np.int64], bulges: NDArray[np.int64], back: NDArray[np.int64], closed: bool
) -> NDArray[np.int64]:
    """One row per piece that does not depend on its direction nor, if closed, on its start."""
    if closed:
        forward = _from_least(points, bulges)
        backward = _from_least(points[:, ::-1], np.roll(back[:, ::-1], -1, axis=1))
    else:
        count = len(points)
        forward = np.concatenate([points.reshape(count, -1), bulges[:, :-1]], axis=1)
        backward = np.concatenate([points[:, ::-1].reshape(count, -1), back[:, -2::-1]], axis=1)
    differ = forward != backward
    at = np.argmax(differ, axis=1)[:, None]
    less = np.take_along_axis(forward, at, axis=1) <= np.take_along_axis(backward, at, axis=1)
    return np.where(less, forward, backward)


def _from_least(points: NDArray[np.int64], bulges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows that begin with the leftmost, then lowest point of each closed piece."""
    count, size, _ = points.shape
    x = points[:, :, 0]
    y = np.where(x == x.min(axis=1, keepdims=True), points[:, :, 1], np.iinfo(np.int64).max)
    turn = (np.argmin(y, axis=1)[:, None] + np.arange(size)) % size
    rolled = np.take_along_axis(points, turn[:, :, None], axis=1).reshape(count, -1)
    return np.concatenate([rolled, np.take_along_axis(bulges, turn, axis=1)], axis=1)
