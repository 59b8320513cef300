"""The borders of a part mask as closed curves of sub-pixel points, from the grey values beside them."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.rings import ComplexArray, Rings, rings
from camgen.model.errors import InputError
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.vision.image import Pixels

# Where the edge is, to a hundredth of a pixel, from the raw pixels across a border.

BoolArray = NDArray[np.bool_]

_SLOPE = np.float32(1.702)
#: Pixels read along the row or column, counted outwards from the border pixel.
_STEPS = np.arange(-5, 7)
#: How far the mask is searched for the next edge, px, and what is kept free of it.
_LOOK_PX, _CLEAR_PX = 9, 2.0
#: Rows before and after that share their plateaus; the weight of the whole loop's plateaus among them.
_WINDOW, _PULL = 8, 1.0
#: Profiles that fit worse than this many times the usual, at corners, hardly tell the plateaus.
_USUAL = 1.5
_ROUNDS = 5
_LEAST_BLUR, _MOST_BLUR = 0.3, 4.0
#: A wider edge is a slope.
_WIDEST_BLUR = 3.0
#: An edge farther than this from the border of the mask, px, is not its edge.
_FARTHEST_PX = 2.5
#: Rows before and after over which the border's bend is taken, and beyond which it is another one.
_BEND, _BEND_APART = 3, 6


class MaskEdge(Struct, frozen=True, eq=False):
    """halfway (N,): where the grey value is half-way between the plateaus, px. shift (N,): from there to the edge,
    where the border bends evenly. found (N,): which of them are more than the border of the mask. blur (L,): s of each
    loop, px. contrast (N,): inside minus outside; misfit (N,): rms of what the fit leaves, grey values.
    """

    halfway: ComplexArray
    shift: ComplexArray
    found: BoolArray
    blur: FloatArray
    contrast: Float32
    misfit: Float32


class _Profiles(Struct, frozen=True, eq=False):
    """chain (N,): border pixels. axis (N,): 1, -1, 1j or -1j, out of the part. values, weight (N, K) at ``_STEPS``."""

    loops: Rings
    chain: ComplexArray
    axis: ComplexArray
    values: Float32
    weight: Float32


class _Fit(Struct, frozen=True, eq=False):
    """at (N,): steps from the border pixel to the edge. trust (N,): weight of a profile for the plateaus."""

    at: FloatArray
    blur: Float32
    trust: FloatArray
    contrast: Float32
    misfit: Float32


def fit_edge(grey: Pixels | Float32, mask: Pixels, loops: Rings, chain: ComplexArray) -> MaskEdge:
    """The edges beside ``chain`` (N,), the outermost pixels of the mask along closed loops, the part on the left."""
    outward = 1j * directions(loops, chain)
    upright = np.abs(outward.imag) > np.abs(outward.real)
    axis = np.where(upright, 1j * np.sign(outward.imag), np.sign(outward.real))
    values = _read(grey, chain, axis, _STEPS).astype(np.float32)
    profiles = _Profiles(loops, chain, axis, values, _weights(mask, chain, axis))
    zero = np.zeros(len(chain), dtype=np.float32)
    fit = _Fit(
        np.full(len(chain), 0.5),
        np.ones(len(loops.count), dtype=np.float32),
        np.ones(len(chain)),
        zero,
        zero,
    )
    bend = np.zeros(len(chain))
    for k in range(_ROUNDS):
        if k % 2 == 0:
            points = chain + axis * fit.at
            along = directions(loops, points)
            outward, bend = 1j * along, _bends(loops, points, along)
        fit = _improve(profiles, fit, outward, bend)
    found = np.abs(fit.at - 0.5) < _FARTHEST_PX
    points = chain + axis * np.where(found, fit.at, 0.5)
    shift = outward * (_even(loops, bend) * fit.blur[loops.loop] ** 2 / 2)
    return MaskEdge(points, shift, found, fit.blur.astype(np.float64), fit.contrast, fit.misfit)


def _improve(profiles: _Profiles, fit: _Fit, outward: ComplexArray, bend: FloatArray) -> _Fit:
    """One round of Gauss-Newton for place and blur, after the plateaus."""
    loops, values, weight = profiles.loops, profiles.values, profiles.weight
    s = fit.blur[loops.loop][:, None]
    turned = profiles.axis * outward.conj()
    u = _distances(turned.real, fit.at, bend) * (_SLOPE / s)
    inner = 1 / (1 + np.exp(u.clip(-30, 30)))
    inside, outside = _plateaus(profiles, inner, fit.trust)
    contrast = inside - outside
    error = (values - outside[:, None] - contrast[:, None] * inner) * weight
    slope = weight * inner * (1 - inner) * (contrast[:, None] * _SLOPE / s)
    wide = slope * u / _SLOPE
    move = _ratio(_dot(slope, error), _dot(slope, slope)) / np.maximum(turned.real, 0.3)
    change = _ratio(*(np.add.reduceat(_dot(wide, other), loops.first) for other in (error, wide)))
    misfit = np.sqrt(_dot(error, error) / np.maximum(weight.sum(axis=1), 1))
    usual = _USUAL * np.maximum(loops.mean(misfit), 1e-3)[loops.loop]
    return _Fit(
        fit.at + move.clip(-0.5, 0.5),
        (fit.blur + change.clip(-0.5, 0.5)).clip(_LEAST_BLUR, _MOST_BLUR),
        1 / (1 + (misfit / usual).astype(np.float64) ** 4),
        contrast,
        misfit,
    )


def _distances(lean: FloatArray, at: FloatArray, bend: FloatArray) -> Float32:
    """Distance (N, K) of the pixels read from the edge, outwards positive: from the circle that it bends with."""
    lean32, at32, bend32 = (column.astype(np.float32)[:, None] for column in (lean, at, bend))
    step = _STEPS.astype(np.float32) - at32
    square = step * (2 * lean32 + bend32 * step)
    return np.asarray(square / (1 + np.sqrt(np.maximum(1 + bend32 * square, 0))))


def _read(
    picture: Pixels | Float32, chain: ComplexArray, axis: ComplexArray, steps: IntArray
) -> NDArray[np.uint8] | Float32:
    """Pixels (N, K) at whole ``steps`` along ``axis`` from ``chain``; the border of the picture goes on."""
    height, width = picture.shape
    u = chain.real.astype(np.int64)[:, None] + axis.real.astype(np.int64)[:, None] * steps
    v = chain.imag.astype(np.int64)[:, None] + axis.imag.astype(np.int64)[:, None] * steps
    found: NDArray[np.uint8] | Float32 = picture[v.clip(0, height - 1), u.clip(0, width - 1)]
    return found


def _weights(mask: Pixels, chain: ComplexArray, axis: ComplexArray) -> Float32:
    """(N, K) 1 for the pixels of ``_STEPS`` that no other edge disturbs."""
    ahead = _next(_read(mask, chain, axis, np.arange(2, _LOOK_PX + 1)) != 0)
    behind = _next(_read(mask, chain, axis, -np.arange(1, _LOOK_PX)) == 0)
    high, low = (np.maximum(d / 2, d - _CLEAR_PX)[:, None] for d in (ahead, behind))
    step = _STEPS - 0.5
    return ((step <= high) & (step >= -low)).astype(np.float32)


def _next(other: BoolArray) -> FloatArray:
    """Distance (N,) px to the next edge, where ``other`` (N, K) first holds, counted from this edge."""
    first = np.argmax(other, axis=1)
    return np.where(other.any(axis=1), first + 1.0, 2.0 * _LOOK_PX)


def _plateaus(profiles: _Profiles, inner: Float32, trust: FloatArray) -> tuple[Float32, Float32]:
    """Grey values (N,) inside and outside by least squares over a window, drawn towards those of the whole loop."""
    loops, outer = profiles.loops, 1 - inner
    heavy, light = profiles.weight * inner, profiles.weight * outer
    pairs = (
        (heavy, inner),
        (heavy, outer),
        (light, outer),
        (heavy, profiles.values),
        (light, profiles.values),
    )
    sums = np.stack([_dot(a, b) for a, b in pairs], axis=1) * trust[:, None]
    inside, outside = _solve(loops.mean(sums) + np.array([1e-6, 0, 1e-6, 0, 0]))
    near = loops.around(sums, _WINDOW)
    near[:, 0] += _PULL
    near[:, 2] += _PULL
    near[:, 3] += _PULL * inside[loops.loop]
    near[:, 4] += _PULL * outside[loops.loop]
    inside, outside = _solve(near)
    return inside.astype(np.float32), outside.astype(np.float32)


def _solve(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    a, b, c, p, q = sums.T
    size = np.maximum(a * c - b * b, 1e-12)
    return (c * p - b * q) / size, (a * q - b * p) / size


def _dot(a: Float32, b: Float32) -> Float32:
    return np.asarray(np.einsum("nk,nk->n", a, b))


def _ratio(a: Float32, b: Float32) -> Float32:
    return np.asarray(a / np.maximum(b, np.float32(1e-6)))


def _bends(loops: Rings, points: ComplexArray, along: ComplexArray) -> FloatArray:
    """Curvature (N,) 1/px, positive where the part is convex: the turn over +-3 rows by the way between them."""
    ahead, behind = loops.shifted(_BEND), loops.shifted(-_BEND)
    # Seen with v upwards, where the part is on the left, a convex border turns to the left.
    turn = np.angle(along[behind] * along[ahead].conj())
    step = np.abs(points[loops.shifted(1)] - points)
    way = loops.around(step, _BEND) - step[ahead]
    return np.asarray((turn / np.maximum(way, 1.0)).clip(-0.5, 0.5))


def _even(loops: Rings, bend: FloatArray) -> FloatArray:
    """The least of the bends here and some rows before and after, 0 where they differ in sign: a corner is no bend."""
    ahead, behind = bend[loops.shifted(_BEND_APART)], bend[loops.shifted(-_BEND_APART)]
    least = np.minimum(np.abs(bend), np.minimum(np.abs(ahead), np.abs(behind)))
    return np.where((bend * ahead > 0) & (bend * behind > 0), np.copysign(least, bend), 0.0)


Float32 = NDArray[np.float32]

#: Points that go ahead by less than this (px) beyond the one before are left out: two profiles told the same place.
_LEAST_STEP = 0.4
#: Rings with less contrast than this many times what the edge fit leaves have no edge in the grey picture.
_LEAST_CONTRAST = 3.0
#: Blur (px) of the mask that stands for a grey picture where there is none, and the noise of what comes out. Rendered
#: discs and rectangles: 0.15 px with a blur of 1, 0.12 with 1.5, 0.10 with 2, and corners ever rounder.
_MASK_BLUR, _MASK_SIGMA = 1.5, 0.12
#: No picture is known better than this, px: what is left without any noise.
_LEAST_SIGMA = 0.008
_FEWEST = 8
#: An edge is soft if its steepest step is smaller than this share of that of the sharp edges. This
#: share of soft edges is a warning.
_SOFT, _LEAST_SOFT = 0.55, 0.1
#: Outlines are those of a shadow alone if this share of their soft edges faces one way, and of
#: their sharp edges the other way. The middle half of the lengths across them in this direction
#: differs by this share of the median at most: a part that is moved by one vector covers as much
#: everywhere beside its former place. Across a disc the lengths differ by 0.16 of their median.
_FACING, _EVEN = 0.9, 0.1
#: Edges that face a direction have a normal within 45 deg of it.
_FACES = np.cos(np.pi / 4)


class Outline(Struct, frozen=True, eq=False):
    """A closed border. points: (N, 2) view pixels, the first not repeated; with v upwards, the part is on the left.

    halfway: (N, 2), where the grey value is half-way between part and ground: off the edge by blur^2 / (2 r) where it
    bends with radius r. In ``points`` this is put right wherever the bend is the same for six pixels to both sides.
    hole: the border of a hole. sigma: noise of a point across the border, px, as far as its neighbours do not share it:
    in a rectified view interpolation ties them, and they share as much again. blur: standard deviation of the blur
    across the edge, px. has_edge: whether the grey picture shows an edge there.

    is_shadow: whether all borders together are those of a shadow without its part.
    """

    points: FloatArray
    halfway: FloatArray
    hole: bool
    sigma: float
    blur: float
    has_edge: bool = True
    is_shadow: bool = False


class _EdgeWidths(Struct, frozen=True, eq=False):
    """The widths of the edges at N border pixels. No row is both soft and sharp.

    outward: (N,) complex unit vectors out of the part.
    soft, sharp: (N,) whether an edge is much wider than the sharp ones, or as sharp as they.
    """

    outward: ComplexArray
    soft: BoolArray
    sharp: BoolArray


def outlines(
    grey: Pixels | Float32, mask_pixels: Pixels
) -> tuple[tuple[Outline, ...], tuple[Note, ...]]:
    """The outlines of the part in ``mask_pixels`` (H, W; not 0: part), as exact as ``grey`` (H, W) tells.

    About one point per pixel of border, nowhere interpolated, so that the noise of neighbours is independent; along
    sharp corners the points are as round as the picture. Where ``grey`` shows no edge beside the mask (a part told by
    its colour alone), the border of the mask is smoothed instead, and a note says so. Borders of fewer than 8 points
    are left out, with a note. Raises InputError if the two do not fit together.
    """
    _insist(grey, mask_pixels)
    loops, chain, holes = _chains(mask_pixels)
    if not len(loops.count):
        return (), (Note("skipped", "no part in the mask", "choose another mask"),)
    edge = fit_edge(grey, mask_pixels, loops, chain)
    plain = _without_edge(loops, edge)
    widths = _measure_widths(grey, mask_pixels, loops, chain)
    is_shadow = _is_shadow_alone(mask_pixels, chain, widths)
    notes = list(_note_soft(widths))
    if plain.any():
        edge = _mix(loops, edge, _edge_of_mask(mask_pixels, loops, chain), plain)
        why = "the grey picture shows no edge there; their noise is about a tenth of a pixel"
        what = f"{int(plain.sum())} of {counted(len(plain), 'outline')} taken from the mask alone"
        notes.append(Note("warning", what, why))
    found = [
        _outline(
            edge.halfway[rows],
            edge.shift[rows],
            bool(hole),
            float(blur),
            not bare,
            is_shadow,
        )
        for rows, hole, blur, bare in zip(
            _order(loops, edge.halfway), holes, edge.blur, plain, strict=True
        )
    ]
    small = sum(o is None for o in found)
    if small:
        what = f"{counted(small, 'border')} of fewer than {_FEWEST} points"
        notes.append(Note("skipped", what, "smaller than 3 px"))
    return tuple(o for o in found if o is not None), tuple(notes)


def _insist(grey: Pixels | Float32, mask: Pixels) -> None:
    if mask.ndim != 2 or mask.dtype != np.uint8:
        raise InputError(
            "mask", f"has shape {mask.shape} of {mask.dtype}", remedy="give (H, W) uint8"
        )
    if grey.shape != mask.shape or grey.dtype not in (np.uint8, np.float32):
        what = f"has shape {grey.shape} of {grey.dtype} beside a mask of {mask.shape}"
        raise InputError(
            "grey picture", what, remedy="give (H, W) uint8 or float32 of the same size"
        )


def _chains(mask: Pixels) -> tuple[Rings, ComplexArray, NDArray[np.bool_]]:
    """The outermost pixels of the part along every border, and which borders are holes (L,)."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not chains:
        return (
            rings(np.zeros(0, dtype=np.int64)),
            np.zeros(0, dtype=complex),
            np.zeros(0, dtype=bool),
        )
    flat = np.concatenate(chains)[:, 0].astype(np.float64)
    return rings(np.array([len(c) for c in chains])), flat @ np.array([1, 1j]), tree[0, :, 3] >= 0


def _without_edge(loops: Rings, edge: MaskEdge) -> NDArray[np.bool_]:
    """(L,) loops with much the same grey values on both sides, a mere slope, or an edge far from the mask."""
    contrast = np.abs(loops.mean(edge.contrast))
    misfit = np.sqrt(loops.mean(edge.misfit.astype(np.float64) ** 2))
    return np.asarray(
        (contrast < _LEAST_CONTRAST * misfit)
        | (contrast < 2.0)
        | (edge.blur > _WIDEST_BLUR)
        | (loops.mean(edge.found * 1.0) < 0.9)
    )


def _measure_widths(
    grey: Pixels | Float32, mask: Pixels, loops: Rings, chain: ComplexArray
) -> _EdgeWidths:
    """The widths of the edges beside all borders, by their steepest step."""
    outward = 1j * directions(loops, chain)
    upright = np.abs(outward.imag) > np.abs(outward.real)
    axis = np.where(upright, 1j * np.sign(outward.imag), np.sign(outward.real))
    profiles = np.abs(np.diff(_read(grey, chain, axis, _STEPS).astype(np.float64), axis=1))
    steepest = loops.around(profiles, _WINDOW)
    share = steepest.max(axis=1) / np.maximum(steepest.sum(axis=1), 1e-6)
    # Another edge within the profile would count as width.
    alone = np.asarray(_weights(mask, chain, axis).all(axis=1))
    if not alone.any():
        return _EdgeWidths(outward, alone, alone)
    is_soft: BoolArray = share < _SOFT * np.percentile(share[alone], 90)
    return _EdgeWidths(outward, alone & is_soft, alone & ~is_soft)


def _note_soft(widths: _EdgeWidths) -> tuple[Note, ...]:
    """The note on stretches where the edge is much wider than elsewhere: shadows, or motion."""
    measured = widths.soft | widths.sharp
    if not measured.any():
        return ()
    part = float(np.mean(widths.soft[measured]))
    if part < _LEAST_SOFT:
        return ()
    what = f"{100 * part:.0f} % of the outlines are soft, the rest is sharp"
    why = "a shadow is soft on the side of the bench; a camera that moves blurs along its motion"
    return (Note("warning", what, f"{why}; look at the preview"),)


def _is_shadow_alone(mask: Pixels, chain: ComplexArray, widths: _EdgeWidths) -> bool:
    """Whether the borders are those of a shadow without its part.

    The part beside it has the tone of the bench. Its own edge, towards the lamp, is sharp, and the
    far edge of the shadow is soft. A part with its shadow has sharp edges on all sides, or is not
    as wide everywhere as the vector by which the lamp moves its outline.
    """
    soft, sharp = widths.soft, widths.sharp
    if not (soft.any() and sharp.any()) or np.mean(soft[soft | sharp]) < _LEAST_SOFT:
        return False
    lamp_ray = complex(widths.outward[soft].mean() - widths.outward[sharp].mean())
    lamp_ray /= max(abs(lamp_ray), 1e-9)
    ahead = (widths.outward * np.conj(lamp_ray)).real
    if np.mean(ahead[soft] > 0) < _FACING or np.mean(ahead[sharp] < 0) < _FACING:
        return False
    lengths = np.sort(_measure_across(mask, chain[soft & (ahead > _FACES)], lamp_ray))
    if not len(lengths):
        return False
    quarter = len(lengths) // 4
    low, middle, high = lengths[[quarter, len(lengths) // 2, -1 - quarter]].tolist()
    return bool(high - low <= _EVEN * middle)


def _measure_across(mask: Pixels, points: ComplexArray, lamp_ray: complex) -> IntArray:
    """(N,) px from border pixels to the other border, against ``lamp_ray``."""
    height, width = mask.shape
    steps = np.arange(1, height + width)
    lengths = np.zeros(len(points), np.intp)
    for row, point in enumerate(points.tolist()):
        places = point - lamp_ray * steps
        columns, rows = np.rint(places.real).astype(np.intp), np.rint(places.imag).astype(np.intp)
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        covered = inside.copy()
        covered[inside] = mask[rows[inside], columns[inside]] > 0
        lengths[row] = int(covered.argmin())
    return lengths


def _edge_of_mask(mask: Pixels, loops: Rings, chain: ComplexArray) -> MaskEdge:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    soft = cv2.GaussianBlur(mask, (0, 0), _MASK_BLUR)
    return fit_edge(np.asarray(soft, dtype=np.uint8), mask, loops, chain)


def _mix(loops: Rings, edge: MaskEdge, other: MaskEdge, where: NDArray[np.bool_]) -> MaskEdge:
    """``edge`` with the loops ``where`` (L,) from ``other``."""
    rows = where[loops.loop]
    return MaskEdge(
        np.where(rows, other.halfway, edge.halfway),
        np.where(rows, other.shift, edge.shift),
        np.where(rows, other.found, edge.found),
        np.where(where, other.blur, edge.blur),
        np.where(rows, other.contrast, edge.contrast),
        np.where(rows, other.misfit, edge.misfit),
    )


def _order(loops: Rings, points: ComplexArray) -> list[IntArray]:
    """The rows of each loop without those whose points do not go ahead of the one before."""
    rows = np.arange(len(points))
    for _ in range(3):
        table = rings(np.bincount(loops.loop[rows], minlength=len(loops.count)))
        step = points[rows] - points[rows[table.shifted(-1)]]
        late = (step * directions(table, points[rows]).conj()).real < _LEAST_STEP
        # Of neighbours that are late one goes, then they are looked at again; no loop loses all of its rows.
        late &= ~late[table.shifted(-1)] & (table.count[table.loop] > 2)
        if not late.any():
            break
        rows = rows[~late]
    return np.split(rows, np.cumsum(np.bincount(loops.loop[rows], minlength=len(loops.count)))[:-1])


def _outline(
    halfway: ComplexArray,
    shift: ComplexArray,
    hole: bool,
    blur: float,
    has_edge: bool,
    is_shadow: bool,
) -> Outline | None:
    if len(halfway) < _FEWEST:
        return None
    sigma = max(_noise(halfway), _LEAST_SIGMA if has_edge else _MASK_SIGMA)
    points = _pairs(halfway + shift)
    return Outline(points, _pairs(halfway), hole, sigma, blur, has_edge, is_shadow)


def _pairs(points: ComplexArray) -> FloatArray:
    return frozen(np.column_stack([points.real, points.imag]))


def _noise(points: ComplexArray) -> float:
    """Noise across the border: what the third differences leave of any smooth curve; corners are outvoted."""
    a, b, c, d = (np.roll(points, -k) for k in range(4))
    along = (c - b) / np.maximum(np.abs(c - b), 1e-9)
    third = ((d - 3 * c + 3 * b - a) * along.conj()).imag
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def directions(loops: Rings, points: ComplexArray, half: int = 3) -> ComplexArray:
    """(N,) unit vectors along the loops: from the mean of the rows behind to that of the rows ahead."""
    # Telescoped: the sum of points ahead minus the sum of points behind.
    total = loops.around(points, half)
    ahead, behind = total[loops.shifted(half)], total[loops.shifted(-half)]
    along = ahead - behind
    size = np.abs(along)
    return np.asarray(np.where(size > 1e-9, along / np.maximum(size, 1e-9), 1.0))
