"""The part as what differs from a photo of the empty bench.

The light may have changed between the two photos: photo = gain * empty + offset on the bench, the gain a quadratic
surface over the picture, the offset one number, both found robustly, channel by channel. Then texture, stains and
uneven light of the bench are in both and drop out.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.vision.mask_cells import Bools, Bytes, Cells, Floats, bench_of, cells_of, rim
from camgen.vision.mask_channel import Channel, Found, differing, same, settled, strips
from camgen.vision.mask_fit import covariance, quadratic, robust, some, surface


class _Light(Struct, frozen=True, eq=False):
    """gains: (h, w, c). offsets: (c,)."""

    gains: Floats
    offsets: Floats


#: The bench of the other photo must come back to within this, of 255: sigma of a cell.
_FIT = 10.0


def found_by_background(pixels: Bytes, cells: Cells, empty: Bytes, name: str) -> Found | None:
    """The part in the channel of the difference; None where nothing differs. InputError: another bench."""
    before = cells_of(empty, None).values
    now, before = (a.reshape(*a.shape[:2], -1) for a in (cells.values, before))
    fits = [_light(before[..., k], now[..., k], cells.valid, name) for k in range(now.shape[2])]
    light = _Light(np.dstack([g for g, _ in fits]), np.array([o for _, o in fits], np.float32))
    apart = np.asarray(now - light.gains * before - light.offsets, np.float32)
    size = _along(None, apart)
    part = differing(size, cells, bench_of(size, cells.valid))
    if part is None or not (cells.valid & ~part).any():
        return None
    for axis in (_axis(apart, part, cells), None):
        pixelwise = partial(_difference, pixels, empty, light, axis, cells.size)
        found = settled(Channel(pixelwise, _along(axis, apart), black=None), part, cells)
        # Where a part is here lighter and there darker than the bench, only the size of the difference shows it all.
        if found is not None and (axis is None or same(found.part, part)):
            return found
    return None


def _light(before: Floats, now: Floats, valid: Bools, name: str) -> tuple[Floats, float]:
    """Gain (h, w) and offset that turn the empty bench into the bench of the photo, from the rim, then from all."""
    edge = rim(valid)
    gain, offset, sigma = _fitted(before, now, edge)
    gain, offset, sigma = _fitted(before, now, edge | (valid & (np.abs(now - gain * before - offset) < 4 * sigma)))
    if sigma > _FIT:
        raise _other_bench(name)
    return gain, offset


def _fitted(before: Floats, now: Floats, where: Bools) -> tuple[Floats, float, float]:
    """Gain, offset and what is left, a standard deviation."""
    at = some(where)
    b, wanted = (values[at].astype(np.float64) for values in (before, now))
    # In hundreds, so that the offset is as easily moved as the gain.
    basis = np.column_stack([quadratic(where.shape, at) * (b / 100)[:, None], np.ones_like(b)])
    # The change is sought: where a bench of one tone does not tell gain from offset, the smaller one is taken.
    c, sigma = robust(basis, wanted - b)
    return surface(where.shape, c[:6] / 100) + np.float32(1), float(c[6]), sigma


def _other_bench(name: str) -> InputError:
    what = "the photo of the empty bench shows another place, or the camera was moved"
    return InputError(name, what, remedy="take both with the camera fixed, or choose another [image] mask")


def _axis(apart: Floats, part: Bools, cells: Cells) -> Floats:
    """(1, c): the direction, in colours, in which the part differs most clearly."""
    outside, inside = (apart[where].astype(np.float64) for where in (~part & cells.valid, part))
    spread = covariance(inside) + covariance(outside) + 2 * np.eye(apart.shape[2])
    axis = np.linalg.solve(spread, np.median(inside, axis=0))
    # Upwards in brightness, so that a dark part is below the level here as well.
    length = float(np.abs(axis).sum()) * (1 if axis.sum() >= 0 else -1)
    return np.asarray(axis / length, np.float32)[None, :] if length else np.ones((1, len(axis)), np.float32)


def _difference(pixels: Bytes, empty: Bytes, light: _Light, axis: Floats | None, size: int) -> Floats:
    """(H, W): the difference along ``axis`` at every pixel."""
    out = np.empty(pixels.shape[:2], np.float32)
    for rows, gain in strips(light.gains, size, out.shape):
        shape = (*out[rows].shape, -1)
        now, before = (a[rows].reshape(shape).astype(np.float32) for a in (pixels, empty))
        apart = np.asarray(now - gain.reshape(shape) * before - light.offsets, np.float32)
        out[rows] = _along(axis, apart)
    return out


def _along(axis: Floats | None, apart: Floats) -> Floats:
    """(h, w): the component along ``axis`` of a difference (h, w, c), or its size."""
    if axis is None:
        return np.asarray(np.sqrt(np.square(apart).mean(axis=2)), np.float32)
    return np.asarray(apart @ axis[0], np.float32)
