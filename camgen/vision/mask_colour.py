"""Part and bench told apart by colour.

The part is what is far from the bench's colour in CIE L*a*b* (D65, sRGB), in which equal distances look equally
different. Where it has one colour, part and bench are then projected on the line between their colours in the file's
own values: there a mixed pixel on the boundary lies between them in proportion, and the boundary has a level.
"""

from __future__ import annotations

import cv2
import numpy as np

from camgen.vision.mask_cells import Bools, Bytes, Cells, Floats, bench_of, depth, rim
from camgen.vision.mask_channel import MIXED, Channel, Found, differing, otsu, same, settled, strips
from camgen.vision.mask_fit import covariance

Colour = tuple[float, float, float]

#: Distances in L*a*b* times this are counted as grey levels are: 100 is black against white.
_SCALE = 2.55


def found_by_colour(pixels: Bytes, cells: Cells, given: Colour | None) -> Found | None:
    """The part in the channel in which it stands out by its colour. None where nothing does.

    given: (red, green, blue), 0 to 255: the bench's colour if most of the rim has it, else the part's. None: that of
    the bench is measured at the rim.
    """
    surfaces = np.dstack([bench_of(cells.values[..., k], cells.valid).values for k in range(3)])
    distance = _distance(cells.values, surfaces)
    if given is None:
        part = differing(distance, cells, bench_of(distance, cells.valid))
    else:
        known = np.broadcast_to(np.array(given[::-1], np.float32), cells.values.shape)
        away = _distance(cells.values, known)
        far = away > otsu(away, cells)
        if float(np.mean(far[rim(cells.valid)])) < 0.5:
            surfaces, part = known, far & cells.valid
        else:
            part = (away < distance) & cells.valid
    if part is None or not part.any() or not (cells.valid & ~part).any():
        return None
    return _projected(pixels, cells, part) or _by_distance(pixels, cells, surfaces, part)


def _distance(colours: Floats, bench: Floats) -> Floats:
    """(h, w): distance of two pictures in L*a*b*, times ``_SCALE``."""
    apart = _lab(colours) - _lab(bench)
    return np.asarray(np.sqrt(np.square(apart).sum(axis=2)) * np.float32(_SCALE), np.float32)


def _lab(colours: Floats) -> Floats:
    scaled = np.clip(colours, 0, 255).astype(np.float32) / np.float32(255)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2Lab), np.float32)


def _projected(pixels: Bytes, cells: Cells, part: Bools) -> Found | None:
    """Fisher's linear discriminant of bench and part, if it tells them apart as the distance does: one colour each."""
    pure = depth(part) > MIXED, (depth(~part) > MIXED) & cells.valid
    if not (pure[0].any() and pure[1].any()):
        return None
    inside, outside = (cells.values[where].astype(np.float64) for where in pure)
    spread = sum(covariance(one) for one in (inside, outside)) + 2 * np.eye(3)
    axis = np.linalg.solve(spread, inside.mean(axis=0) - outside.mean(axis=0))
    axis *= 1 if axis.sum() >= 0 else -1  # upwards in brightness
    ends = np.percentile(cells.values[cells.valid] @ axis, [0, 100])
    if not np.ptp(ends):
        return None
    # Over 20 to 235, so that noise is not cut off; in whole numbers finer than a file has them.
    gain = 215 / np.ptp(ends)
    weights = np.append(axis * gain, 20 - ends[0] * gain)[None, :]
    channel = Channel(
        lambda: np.asarray(cv2.transform(pixels, weights), np.uint8),
        np.asarray(cells.values @ weights[0, :3] + weights[0, 3], np.float32),
        black=float(weights[0, 3]),
    )
    found = settled(channel, part, cells)
    return found if found is not None and same(found.part, part) else None


def _by_distance(pixels: Bytes, cells: Cells, bench: Floats, part: Bools) -> Found | None:
    """The distance itself, at every pixel: a part of several colours."""

    def everywhere() -> Floats:
        far = np.empty(pixels.shape[:2], np.float32)
        for rows, there in strips(np.ascontiguousarray(bench), cells.size, far.shape):
            far[rows] = _distance(pixels[rows].astype(np.float32), there)
        return far

    return settled(Channel(everywhere, _distance(cells.values, bench), black=None), part, cells)
