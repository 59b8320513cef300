"""What part and bench differ in: one number per pixel, and the first idea of the part in cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from msgspec import Struct

from camgen.vision.mask_cells import Bench, Bools, Bytes, Cells, Floats, bench_of, depth, rim
from camgen.vision.mask_level import Levels, halfway, spread_out

#: The part differs from the bench by so many spreads of the bench, and so many values of 255.
_SPREADS, _LEAST = 6.0, 5.0
#: The tone next to the bench's: so many percent of the part are nearer. A soft shadow is less, and weaker.
_NEAR_TONE = 15
#: Cells on a boundary are less deep, with one more for a blur.
MIXED = 1.5
#: A part is so many cells at least.
_FEW = 4
_TURNS = 2
_STRIP = 64


class Channel(Struct, frozen=True, eq=False):
    """pixels: makes the channel, (H, W) uint8 or float32. cells: (h, w), the same in cells.

    black: its value where there is no light; None for a difference, on which light has no say.
    """

    pixels: Callable[[], Bytes | Floats]
    cells: Floats
    black: float | None = 0.0


class Found(Struct, frozen=True, eq=False):
    """A part found in a channel. part: (h, w)."""

    channel: Channel
    part: Bools
    levels: Levels
    bench: Bench

    @property
    def clear(self) -> float:
        """Contrast against the spread of the bench."""
        return abs(self.levels.contrast) / max(self.levels.without, self.bench.sigma)


def differing(values: Floats, cells: Cells, bench: Bench, invert: bool = False) -> Bools | None:
    """The cells on that side of the bench, lighter or darker, where more differs; the other side with ``invert``.

    The threshold is halfway to the part's tone next to the bench's, if it has several: a shiny part is no less there.
    """
    off = np.where(cells.valid, values - bench.values, np.float32(0))
    least = max(_SPREADS * bench.sigma, _LEAST)
    sides = [np.where(side * off > least, side * off, np.float32(0)) for side in (-1, 1)]
    amounts = [float(side.sum()) for side in sides]
    off = sides[int(amounts[1] > amounts[0]) ^ int(invert)]
    part = off > 0
    # Without the boundary: what is there is a mixture.
    deep = depth(part) > MIXED
    tones = off[deep if np.count_nonzero(deep) >= _FEW else part]
    if tones.size < _FEW:
        return None
    near, middle = np.percentile(tones, [_NEAR_TONE, 50])
    return np.asarray(off > max(near / 2, middle / 4), np.bool_)


def split_at(values: Floats, cells: Cells, threshold: float, invert: bool = False) -> Bools:
    """The cells on the other side of the threshold than most of the rim."""
    above = values > threshold
    bench_above = float(np.mean(above[rim(cells.valid)])) > 0.5
    return np.asarray((above ^ bench_above ^ invert) & cells.valid, np.bool_)


def otsu(values: Floats, cells: Cells) -> float:
    """Otsu's threshold of the valid cells (Otsu 1979)."""
    seen = np.clip(np.rint(values[cells.valid]), 0, 255).astype(np.uint8)
    return float(cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]) + 0.5


def settled(channel: Channel, part: Bools | None, cells: Cells, bench: Bench | None = None) -> Found | None:
    """``part`` drawn again at the local levels until it stays, twice at most. None: there is no part, or no bench."""
    bench = bench or bench_of(channel.cells, cells.valid)
    for _ in range(_TURNS):
        levels = _levels(channel, part, cells, bench)
        if part is None or levels is None:
            return None
        level = spread_out(levels.tiles, levels.tile, part.shape)
        before, side = part, np.less if levels.contrast < 0 else np.greater
        part = np.asarray(side(channel.cells, level) & cells.valid, np.bool_)
        if same(part, before):
            return Found(channel, part, levels, bench)
    levels = _levels(channel, part, cells, bench)
    return None if part is None or levels is None else Found(channel, part, levels, bench)


def as_it_is(channel: Channel, part: Bools, cells: Cells) -> Found | None:
    """``part`` where it was found, only measured."""
    bench = bench_of(channel.cells, cells.valid)
    levels = _levels(channel, part, cells, bench)
    return Found(channel, part, levels, bench) if levels is not None else None


def _levels(channel: Channel, part: Bools | None, cells: Cells, bench: Bench) -> Levels | None:
    if part is None or not part.any() or not (cells.valid & ~part).any():
        return None
    levels = halfway(channel.cells, part, cells, bench, channel.black)
    return levels if levels.contrast else None


def same(one: Bools, other: Bools) -> bool:
    """Are the two the same but for cells on the boundary?"""
    apart = np.count_nonzero(depth(one ^ other) > MIXED)
    return bool(apart <= max(2, 0.002 * min(np.count_nonzero(one), np.count_nonzero(other))))


def strips(cells: Floats, size: int, shape: tuple[int, ...]) -> Iterator[tuple[slice, Floats]]:
    """``cells`` interpolated to all pixels, a few rows at a time: a whole picture of it would be ten times as large."""
    rows = cells.shape[0]
    for first in range(0, rows, _STRIP):
        last = min(first + _STRIP, rows)
        low, high = max(0, first - 1), min(rows, last + 1)
        top, bottom = first * size, shape[0] if last == rows else last * size
        whole = cv2.resize(cells[low:high], (cells.shape[1] * size, (high - low) * size))
        beside, below = shape[1] - whole.shape[1], max(0, bottom - low * size - whole.shape[0])
        whole = cv2.copyMakeBorder(whole, 0, below, 0, beside, cv2.BORDER_REPLICATE)
        yield slice(top, bottom), np.asarray(whole[top - low * size : bottom - low * size], np.float32)
