"""What part and bench differ in: one number per pixel, and the first idea of the part in cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import short
from camgen.model.tolerance import SIGMAS_OF_MEDIAN
from camgen.vision.mask.cells import (
    Bench,
    Bools,
    Bytes,
    Cells,
    Floats,
    bench_of,
    cells_of,
    covariance,
    depth,
    inner_cells,
    quadratic,
    rim,
    robust,
    some,
    surface,
)
from camgen.vision.mask.level import BAND_BEGIN_PX, Levels, halfway, spread_out

#: The part differs from the bench by so many spreads of the bench, and so many values of 255.
_LEAST_SPREADS, _LEAST_CONTRAST = 6.0, 5.0
#: The tone next to the bench's: so many percent of the part are nearer. A soft shadow is less, and weaker.
_NEAR_TONE = 15
#: A bench is rough if this difference may be texture. Then it is averaged with a Gaussian of these
#: standard deviations, cells.
_ROUGH, _SCALES = 12.0, (3.0, 8.0)
#: Shares of the usual difference of a part from its bench: cells deep in the part with more are
#: part, and so are holes with more in the mean.
_CORE_SHARE, _HOLE_SHARE = 0.75, 0.5
#: The share of strong cells in a piece of a part, at least.
_LEAST_SEEDS = 0.05
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
    """The cells on the side of the bench, lighter or darker, where more differs.

    invert: the other side.

    The threshold is halfway to the part's tone next to the bench's, if it has several. The texture
    of a bench may reach it. Cells above it belong to the part only in one piece with cells that no
    texture reaches (hysteresis, Canny 1986).
    """
    off = np.where(cells.valid, values - bench.values, np.float32(0))
    least = max(_LEAST_SPREADS * bench.sigma, _LEAST_CONTRAST)
    seeds = [side * off > least for side in (-1, 1)]
    amounts = [float(np.abs(off[strong]).sum()) for strong in seeds]
    side = (-1, 1)[(amounts[1] > amounts[0]) ^ invert]
    part = seeds[(side + 1) // 2]
    threshold = _threshold(side * off, part, inner_cells(part))
    if threshold >= least:
        return np.asarray(side * off > threshold, np.bool_)
    if least > _ROUGH:
        rough = [
            _find_seeds(side * off, part, cells) for side, part in zip((-1, 1), seeds, strict=True)
        ]
        amounts = [float(np.abs(off[strong]).sum()) for strong, _ in rough]
        side = (-1, 1)[(amounts[1] > amounts[0]) ^ invert]
        part, inner = rough[(side + 1) // 2]
        threshold = _threshold(side * off, part, inner)
    if not threshold:
        return None
    whole = np.asarray(side * off > max(threshold, _LEAST_CONTRAST), np.bool_)
    return _with_seeds(whole, part, _FEW)


def _threshold(off: Floats, part: Bools, inner: Bools) -> float:
    """Halfway to the tone of a part next to the bench's; 0 without a part.

    inner: the cells of the part without its boundary, which is a mixture.
    """
    tones = off[inner if np.count_nonzero(inner) >= _FEW else part]
    if tones.size < _FEW:
        return 0.0
    near, middle = np.percentile(tones, [_NEAR_TONE, 50]).tolist()
    return float(max(near / 2, middle / 4))


def _find_seeds(off: Floats, part: Bools, cells: Cells) -> tuple[Bools, Bools]:
    """The cells that no texture of a rough bench reaches, and those that lie deep among them.

    off: (h, w), the difference from the bench.
    part: (h, w), the cells that no texture of a single cell reaches.

    Texture averages out over some cells, and the part does not.
    """
    seeds, inner = part.copy(), inner_cells(part)
    edge = rim(cells.valid)
    for scale in _SCALES:
        smooth = np.asarray(cv2.GaussianBlur(off, (0, 0), scale), np.float32)
        spread = SIGMAS_OF_MEDIAN * float(np.median(np.abs(smooth[edge])))
        strong = smooth > max(_LEAST_SPREADS * spread, _LEAST_CONTRAST)
        seeds |= strong & (off > 0)
        inner |= depth(strong) > MIXED + 2 * scale
    return seeds, np.asarray(inner & seeds, np.bool_)


def _with_seeds(part: Bools, seeds: Bools, least: int = 1) -> Bools:
    """The pieces of ``part`` in which ``least`` cells, and a share of all, are seeds."""
    count, owners = cv2.connectedComponents(part.view(np.uint8), connectivity=4)
    sizes, seeded = (
        np.bincount(cells, minlength=count) for cells in (owners.ravel(), owners[seeds])
    )
    kept = seeded >= np.maximum(least, _LEAST_SEEDS * sizes)
    kept[0] = False
    return np.asarray(kept[owners], np.bool_)


def split_at(values: Floats, cells: Cells, threshold: float, invert: bool = False) -> Bools:
    """The cells on the other side of the threshold than most of the rim."""
    above = values > threshold
    bench_above = float(np.mean(above[rim(cells.valid)])) > 0.5
    return np.asarray((above ^ bench_above ^ invert) & cells.valid, np.bool_)


def otsu(values: Floats, cells: Cells) -> float:
    """Otsu's threshold of the valid cells (Otsu 1979)."""
    seen = np.clip(np.rint(values[cells.valid]), 0, 255).astype(np.uint8)
    return float(cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]) + 0.5


def settle(
    channel: Channel, part: Bools | None, cells: Cells, bench: Bench | None = None
) -> Found | None:
    """``part`` drawn again at the local levels until it stays, twice at most.

    None: there is no part, or no bench.

    Only its border moves. A part of several tones crosses the level within it, and the texture of a
    bench does beside it.
    """
    bench = bench or bench_of(channel.cells, cells.valid)
    if part is None:
        return None
    pieces, inner = part, depth(part) > MIXED + BAND_BEGIN_PX / cells.size
    off = np.where(cells.valid, np.abs(channel.cells - bench.values), np.float32(0))
    usual = float(np.median(off[inner])) if inner.any() else np.inf
    core = inner & (off > _CORE_SHARE * usual)
    for _ in range(_TURNS):
        levels = _levels(channel, part, cells, bench)
        if levels is None:
            return None
        whole = _with_seeds(beyond_level(channel, levels, cells) | core, pieces)
        before, part = part, _fill_holes(whole, off, _HOLE_SHARE * usual)
        if same(part, before):
            return Found(channel, part, levels, bench)
    levels = _levels(channel, part, cells, bench)
    return None if levels is None else Found(channel, part, levels, bench)


def beyond_level(channel: Channel, levels: Levels, cells: Cells) -> Bools:
    """The cells on the part's side of the local levels."""
    level = spread_out(levels.tiles, levels.tile, cells.valid.shape)
    side = np.less if levels.contrast < 0 else np.greater
    return np.asarray(side(channel.cells, level) & cells.valid, np.bool_)


def _fill_holes(part: Bools, off: Floats, largest: float) -> Bools:
    """``part`` with the holes that differ from the bench by more than ``largest`` in the mean.

    off: (h, w), the difference.
    """
    if not (off[~part] > largest).any():
        return part
    count, owners = cv2.connectedComponents((~part).view(np.uint8), connectivity=4)
    owner = owners.ravel()
    sizes = np.bincount(owner, minlength=count)
    means = np.bincount(owner, off.ravel(), minlength=count) / np.maximum(sizes, 1)
    return np.asarray((means > largest)[owners] | part, np.bool_)


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
    apart = np.count_nonzero(inner_cells(one ^ other))
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
        yield (
            slice(top, bottom),
            np.asarray(whole[top - low * size : bottom - low * size], np.float32),
        )


# The part as what differs from a photo of the empty bench.


class _Light(Struct, frozen=True, eq=False):
    """gains: (h, w, c). offsets: (c,)."""

    gains: Floats
    offsets: Floats


#: The bench of the other photo must come back to within this, of 255: sigma of a cell.
_FIT = 10.0
#: Cells of the bench agree with a fit to within this, of 255; and the pairs of cells tried.
_SAME_BENCH, _PAIRS = 6.0, 400
#: Light changes by less: a gain of nothing would turn any bench into one of one tone.
_LEAST_GAIN = 0.2


def find_by_background(pixels: Bytes, cells: Cells, empty: Bytes, name: str) -> Found | None:
    """The part in the channel of the difference; None where nothing differs. InputError: another bench."""
    before = cells_of(empty, None).values
    now, before = (a.reshape(*a.shape[:2], -1) for a in (cells.values, before))
    fits = [_light(before[..., k], now[..., k], cells.valid, name) for k in range(now.shape[2])]
    light = _Light(np.dstack([g for g, _ in fits]), np.array([o for _, o in fits], np.float32))
    difference = np.asarray(now - light.gains * before - light.offsets, np.float32)
    size = _along(None, difference)
    part = differing(size, cells, bench_of(size, cells.valid))
    if part is None or not (cells.valid & ~part).any():
        return None
    tone = np.median(now[part], axis=0).astype(np.float32)
    for axis in (_axis(difference, part, cells), None):
        usual = float(np.median(_along(axis, tone - now + difference)[part]))
        even = _Even(axis, tone, usual)
        pixelwise = partial(_difference, pixels, empty, light, even, cells.size)
        channel = Channel(pixelwise, even.apply(now, difference), black=None)
        found = settle(channel, part, cells)
        # Where a part is here lighter and there darker than the bench, only the size of the difference shows it all.
        if found is not None and (axis is None or same(found.part, part)):
            return found
    return None


class _Even(Struct, frozen=True, eq=False):
    """A difference that is the same wherever the part covers the bench, whatever texture it covers.

    axis: (1, c), the direction in colours; None for the size of the difference.
    tone: (c,), the part's.
    usual: difference of the part from the bench.
    """

    axis: Floats | None
    tone: Floats
    usual: float

    def apply(self, now: Floats, difference: Floats) -> Floats:
        """(h, w) of a picture (h, w, c) and its difference from the bench (h, w, c).

        The difference is scaled by that which the part's tone has there, at most threefold.
        """
        usual = abs(self.usual)
        expected = np.maximum(
            np.abs(_along(self.axis, self.tone - now + difference)), max(usual / 3, 1e-3)
        )
        return np.asarray(_along(self.axis, difference) * (usual / expected), np.float32)


def remove_shadows(pixels: Bytes, other: Bytes, name: str) -> Bytes:
    """The brighter of two photos with the lamp in two places, in the light of the first.

    A shadow that is in one of them only is gone. The pictures are (H, W) or (H, W, 3).
    name: file of ``other``. Raises InputError if it shows another place.
    """
    now, before = (cells_of(photo, None).values for photo in (pixels, other))
    now, before = (values.reshape(*values.shape[:2], -1) for values in (now, before))
    valid = np.ones(now.shape[:2], np.bool_)
    which = "with the lamp moved"
    fits = [_light(before[..., k], now[..., k], valid, name, which) for k in range(now.shape[2])]
    gains, offsets = np.dstack([gain for gain, _ in fits]), np.array([o for _, o in fits])
    brighter = np.empty_like(pixels)
    size = max(1, pixels.shape[0] // now.shape[0])
    for rows, gain in strips(gains, size, pixels.shape):
        lit = gain.reshape(pixels[rows].shape) * other[rows] + offsets.astype(np.float32)
        brighter[rows] = np.maximum(pixels[rows], np.rint(lit.clip(0, 255)).astype(np.uint8))
    return brighter


def _light(
    before: Floats, now: Floats, valid: Bools, name: str, which: str = "of the empty bench"
) -> tuple[Floats, float]:
    """Gain (h, w) and offset that turn the bench of another photo into the bench of the photo.

    which: name of the other photo in messages.

    Gain and offset of a rim of one tone are ambiguous, and a large part hides the bench. So the
    fit starts from the rim and from lines through pairs of cells. The fit with which more cells
    agree is the result.
    """
    starts = (rim(valid), _find_bench(before, now, valid))
    fits = [_agree(before, now, where, valid) for where in starts]
    gain, offset, sigma, _ = max(fits, key=lambda fit: fit[3])
    if sigma > _FIT:
        raise _other_bench(name, which)
    return gain, offset


def _find_bench(before: Floats, now: Floats, valid: Bools) -> Bools:
    """The cells that agree with the most common gain and offset.

    Lines through pairs of cells are tried (Fischler and Bolles 1981).
    """
    at = some(valid)
    b, n = before[at], now[at]
    first, second = np.random.default_rng(0).integers(0, len(b), (2, _PAIRS))
    differs = np.abs(b[second] - b[first]) > _SAME_BENCH
    first, second = first[differs], second[differs]
    gains = (n[second] - n[first]) / (b[second] - b[first])
    likely = (gains > _LEAST_GAIN) & (gains < 1 / _LEAST_GAIN)
    gains, first = np.append(gains[likely], np.float32(1)), first[likely]
    offsets = np.append(n[first] - gains[:-1] * b[first], np.median(n - b))
    counts = [
        np.count_nonzero(np.abs(n - gain * b - offset) < _SAME_BENCH)
        for gain, offset in zip(gains, offsets, strict=True)
    ]
    best = int(np.argmax(counts))
    off = np.abs(now - gains[best] * before - offsets[best])
    return np.asarray(valid & (off < _SAME_BENCH), np.bool_)


def _agree(
    before: Floats, now: Floats, where: Bools, valid: Bools
) -> tuple[Floats, float, float, int]:
    """The fit to the cells ``where``, repeated with all that agree, and how many agree then."""
    for _ in range(_TURNS):
        gain, offset, sigma = _fit_gain(before, now, where)
        off = np.abs(now - gain * before - offset)
        where = np.asarray(valid & (off < 4 * sigma), np.bool_)
    count = int(np.count_nonzero(valid & (off < _SAME_BENCH)))
    return gain, offset, sigma, count if gain.min() > _LEAST_GAIN else 0


def _fit_gain(before: Floats, now: Floats, where: Bools) -> tuple[Floats, float, float]:
    """Gain, offset and what is left, a standard deviation."""
    at = some(where)
    b, wanted = (values[at].astype(np.float64) for values in (before, now))
    # In hundreds, so that the offset is as easily moved as the gain.
    basis = np.column_stack([quadratic(where.shape, at) * (b / 100)[:, None], np.ones_like(b)])
    # The change is sought: where a bench of one tone does not tell gain from offset, the smaller one is taken.
    c, sigma = robust(basis, wanted - b)
    return surface(where.shape, c[:6] / 100) + np.float32(1), float(c[6]), sigma


def _other_bench(name: str, which: str) -> InputError:
    what = f"the photo {which} shows another place, or the camera was moved"
    return InputError(
        name, what, remedy="take both with the camera fixed, or choose another [image] mask"
    )


def _axis(apart: Floats, part: Bools, cells: Cells) -> Floats:
    """(1, c): the direction, in colours, in which the part differs most clearly."""
    outside, inside = (apart[where].astype(np.float64) for where in (~part & cells.valid, part))
    spread = covariance(inside) + covariance(outside) + 2 * np.eye(apart.shape[2])
    axis = np.linalg.solve(spread, np.median(inside, axis=0))
    # Upwards in brightness, so that a dark part is below the level here as well.
    length = float(np.abs(axis).sum()) * (1 if axis.sum() >= 0 else -1)
    return (
        np.asarray(axis / length, np.float32)[None, :]
        if length
        else np.ones((1, len(axis)), np.float32)
    )


def _difference(pixels: Bytes, empty: Bytes, light: _Light, even: _Even, size: int) -> Floats:
    """(H, W): the even difference at every pixel."""
    out = np.empty(pixels.shape[:2], np.float32)
    for rows, gain in strips(light.gains, size, out.shape):
        shape = (*out[rows].shape, -1)
        now, before = (a[rows].reshape(shape).astype(np.float32) for a in (pixels, empty))
        apart = np.asarray(now - gain.reshape(shape) * before - light.offsets, np.float32)
        out[rows] = even.apply(now, apart)
    return out


def _along(axis: Floats | None, apart: Floats) -> Floats:
    """(h, w): the component along ``axis`` of a difference (h, w, c), or its size."""
    if axis is None:
        return np.asarray(np.sqrt(np.square(apart).mean(axis=2)), np.float32)
    return np.asarray(apart @ axis[0], np.float32)


# Part and bench told apart by colour.

Colour = tuple[float, float, float]

#: Distances in L*a*b* times this are counted as grey levels are: 100 is black against white.
_SCALE = 2.55


def find_by_colour(pixels: Bytes, cells: Cells, given: Colour | None) -> Found | None:
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
    return _project(pixels, cells, part) or _by_distance(pixels, cells, surfaces, part)


def find_beside_shadow(pixels: Bytes, cells: Cells) -> Found | None:
    """The part in a channel in which a shadow on the bench does not show. None where nothing does.

    A shadow has the colour of the bench in less light: it lies between black and the bench's
    colour. What counts is the distance from that line.
    """
    bench = np.dstack([bench_of(cells.values[..., k], cells.valid).values for k in range(3)])
    # The nearest place on the line, as a share of the bench's light.
    light = (cells.values * bench).sum(axis=2) / np.square(bench).sum(axis=2).clip(1)
    nearest = light.clip(0, 1)[..., None] * bench
    distance = np.sqrt(np.square(cells.values - nearest).sum(axis=2)).astype(np.float32)
    part = differing(distance, cells, bench_of(distance, cells.valid))
    if part is None or not part.any() or not (cells.valid & ~part).any():
        return None
    return _project(pixels, cells, part)


def _distance(colours: Floats, bench: Floats) -> Floats:
    """(h, w): distance of two pictures in L*a*b*, times ``_SCALE``."""
    apart = _lab(colours) - _lab(bench)
    return np.asarray(np.sqrt(np.square(apart).sum(axis=2)) * np.float32(_SCALE), np.float32)


def _lab(colours: Floats) -> Floats:
    scaled = np.clip(colours, 0, 255).astype(np.float32) / np.float32(255)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2Lab), np.float32)


def _project(pixels: Bytes, cells: Cells, part: Bools) -> Found | None:
    """Fisher's linear discriminant of bench and part, if it tells them apart as the distance does: one colour each."""
    pure = inner_cells(part), inner_cells(~part) & cells.valid
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
    found = settle(channel, part, cells)
    return found if found is not None and same(found.part, part) else None


def _by_distance(pixels: Bytes, cells: Cells, bench: Floats, part: Bools) -> Found | None:
    """The distance itself, at every pixel: a part of several colours."""

    def everywhere() -> Floats:
        far = np.empty(pixels.shape[:2], np.float32)
        for rows, there in strips(np.ascontiguousarray(bench), cells.size, far.shape):
            far[rows] = _distance(pixels[rows].astype(np.float32), there)
        return far

    return settle(Channel(everywhere, _distance(cells.values, bench), black=None), part, cells)


# Noise that would break the boundary up is smoothed away before the comparison, and only then.

#: Half the contrast is so many sigmas of the noise: one pixel in 150 000 is on the wrong side.
_CLEAR_SIGMAS = 4.5
_LEAST_NOISE, _MOST_NOISE = 0.8, 2.5
#: Measured so far from the boundary, px: with the neighbours, the blur is out of reach.
_CLEAN = 5.0


def quiet(
    grey: Bytes | Floats, found: Found, cells: Cells
) -> tuple[Bytes | Floats, tuple[Note, ...]]:
    """``grey``, or, where its noise is too strong for the contrast, smoothed (float32), with a note.

    A smoothed boundary of radius r moves by sigma^2 / 2 r towards its centre.
    """
    deep = 1 + _CLEAN / cells.size
    noise = max(
        _noise(grey, depth(side) >= deep, cells.size)
        for side in (found.part, ~found.part & cells.valid)
    )
    clear = abs(found.levels.contrast) / 2 / max(noise, 1e-6)
    if clear >= _CLEAR_SIGMAS:
        return grey, ()
    # Gauss's bell of this sigma reduces white noise by sigma * 2 sqrt(pi) (a half more is for neighbours that agree).
    sigma = float(
        np.clip(1.5 * _CLEAR_SIGMAS / clear / (2 * np.sqrt(np.pi)), _LEAST_NOISE, _MOST_NOISE)
    )
    what = f"picture smoothed by {short(sigma, 1)} px"
    why = f"its noise is {short(noise, 1)}, part and bench are {short(abs(found.levels.contrast), 0)} apart"
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), sigma), np.float32)
    return smooth, (Note("assumed", what, why),)


def _noise(grey: Bytes | Floats, where: Bools, size: int) -> float:
    """Standard deviation of a pixel against its neighbours, two pixels away along the row, in the cells ``where``.

    Two, since rectifying makes next neighbours agree.
    """
    rows, columns = some(where)
    v, u = (
        rows * size + size // 2,
        np.clip(columns * size + size // 2, 2, max(2, grey.shape[1] - 3)),
    )
    if grey.shape[1] < 5:
        return 0.0
    left, centre, right = (grey[v, u + k].astype(np.float32) for k in (-2, 0, 2))
    off = 2 * centre - left - right
    return SIGMAS_OF_MEDIAN * float(np.median(np.abs(off))) / np.sqrt(6) if off.size else 0.0
