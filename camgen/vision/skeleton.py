"""The centre lines of a mask, one pixel wide, by parallel thinning of its border.

Guo and Hall, "Parallel thinning with two-subiteration algorithms" (1989): what a pixel's eight neighbours look like
decides whether it goes, so the neighbours are read as one byte, and two tables of 256 answers say it for all pixels.
"""

from __future__ import annotations

import cv2
import numpy as np

from camgen.vision.image import Pixels

#: Neighbours from the one above, clockwise; the weight of each in the byte.
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
_KERNEL = np.array([[128, 1, 2], [64, 0, 4], [32, 16, 8]], dtype=np.float32)
#: While an iteration takes away more than one pixel in so many, all are looked at again.
_WORTH = 2000


def skeleton(mask: Pixels, keep: Pixels | None = None) -> Pixels:
    """The centre lines (H, W) of ``mask`` ((H, W) uint8, not 0: inside), 255 on a line, connected as the mask is.

    keep: pixels of the mask that stay whatever they look like; lines then end at them. What touches the border of the
    picture is thinned as if there were nothing beyond it.
    """
    found = np.zeros(mask.shape, dtype=np.uint8)
    u, v, width, height = cv2.boundingRect(mask)
    if not width:
        return found
    inside = (slice(v, v + height), slice(u, u + width))
    rest = np.pad((mask[inside] != 0).astype(np.uint8), 1)
    free = np.ones_like(rest) if keep is None else np.pad((keep[inside] == 0).astype(np.uint8), 1)
    rest = _few(*_many(rest, free))
    found[inside] = rest[1:-1, 1:-1] * np.uint8(255)
    return found


def _many(rest: Pixels, free: Pixels) -> tuple[Pixels, Pixels]:
    """Whole iterations over the picture, as long as they are worth it; and what of the picture is still free to go."""
    most = cv2.countNonZero(rest) // _WORTH
    gone = most + 1
    while gone > most:
        gone = 0
        for table in _TABLES:
            code = cv2.filter2D(rest, cv2.CV_8U, _KERNEL, borderType=cv2.BORDER_CONSTANT)
            going = cv2.bitwise_and(cv2.bitwise_and(cv2.LUT(code, table), rest), free)
            gone += cv2.countNonZero(going)
            rest = np.asarray(cv2.subtract(rest, going), dtype=np.uint8)
    return rest, free


def _few(rest: Pixels, free: Pixels) -> Pixels:
    """The same for the pixels alone whose neighbours have changed; all are looked at once for each half."""
    flat, may = rest.ravel(), free.ravel()
    width = rest.shape[1]
    step = np.array([down * width + right for down, right in _AROUND])
    weight = 1 << np.arange(8)
    changed = [np.flatnonzero(flat & may)] * 2
    turn = 0
    while len(changed[0]) or len(changed[1]):
        at = changed[turn]
        at = at[flat[at] != 0]
        going = at[_TABLES[turn][flat[at[:, None] + step] @ weight] != 0]
        flat[going] = 0
        near = np.unique(going[:, None] + step)
        near = near[(flat[near] & may[near]) != 0]
        changed = [near if k == turn else np.union1d(changed[k], near) for k in (0, 1)]
        turn = 1 - turn
    return rest


def _table(turn: int) -> Pixels:
    """For each byte of neighbours 1 where the pixel between them goes in this half of an iteration."""
    n, ne, e, se, s, sw, w, nw = ((np.arange(256) >> k & 1).astype(bool) for k in range(8))
    pairs = ((n, ne, e), (e, se, s), (s, sw, w), (w, nw, n))
    # The runs of neighbours: one, and taking the pixel away parts nothing.
    runs = sum((~a & (b | c)).astype(int) for a, b, c in pairs)
    one = sum((a | b).astype(int) for a, b in ((nw, n), (ne, e), (se, s), (sw, w)))
    other = sum((a | b).astype(int) for a, b in ((n, ne), (e, se), (s, sw), (w, nw)))
    fewest = np.minimum(one, other)
    side = (n | ne | ~se) & e if turn else (s | sw | ~nw) & w
    return np.asarray(((runs == 1) & (fewest >= 2) & (fewest <= 3) & ~side).astype(np.uint8))


_TABLES = (_table(0), _table(1))
