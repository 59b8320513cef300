"""Finds the outlines of a part: closed curves of sub-pixel edge points along the borders of a mask.

The points come from the grey values across the border, so they are far more exact than the mask.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import count_rows
from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.model.errors import InputError
from camgen.model.part import BoolArray, IntArray, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.vision.image import Pixels

# The place of an edge, to a hundredth of a pixel, from the pixels across a border.

Float32 = NDArray[np.float32]

#: Factor with which a logistic function comes nearest to the integral of a Gaussian.
_LOGISTIC = np.float32(1.702)
#: Pixels that are read along the row or column, counted outwards from the border pixel.
_STEPS = np.arange(-5, 7)
#: px: distance up to which the mask is searched for the next edge.
_SEARCH_PX = 9
#: px: distance from another edge that is kept free.
_CLEAR_PX = 2.0
#: Rows before and after that share their plateaus, the grey values inside and outside.
_WINDOW = 8
#: Weight of the plateaus of the whole loop among those of the window.
_LOOP_WEIGHT = 1.0
#: A profile whose misfit is more than this many times the usual, as at corners, hardly influences
#: the plateaus.
_USUAL_FACTOR = 1.5
#: Rounds of the fit.
_ROUNDS = 5
#: px: range of the blur in a fit.
_MIN_BLUR, _MAX_BLUR = 0.3, 4.0
#: px: a wider edge is a slope of light.
_MAX_EDGE_BLUR = 3.0
#: px: an edge farther than this from the border of the mask is another edge.
_MAX_DISTANCE_PX = 2.5
#: Rows before and after over which the curvature of a border is measured.
_BEND_ROWS = 3
#: Rows before and after at which the curvature is compared.
_BEND_APART = 6


class MaskEdge(Struct, frozen=True, eq=False):
    """The edge at N border pixels of L loops.

    halfway: (N,) place at which the grey value is the mean of inside and outside, px.
    shift: (N,) vector from there to the edge, px; not 0 where the border bends evenly.
    is_near: (N,) the edge was found near the border of the mask. Otherwise `halfway` is the border.
    blur: (L,) sigma of the blur of each loop, px.
    contrast: (N,) grey value inside minus outside.
    misfit: (N,) rms residual of the fit, grey values.
    """

    halfway: ComplexArray
    shift: ComplexArray
    is_near: BoolArray
    blur: FloatArray
    contrast: Float32
    misfit: Float32


class _Profiles(Struct, frozen=True, eq=False):
    """Pixels across the border at N border pixels.

    loops: the loops of the border pixels.
    axis: (N,) 1, -1, 1j or -1j, the direction out of the part.
    values: (N, K) grey values at `_STEPS` along the axis.
    weight: (N, K) 1 for values that no other edge disturbs, else 0.
    """

    loops: Rings
    axis: ComplexArray
    values: Float32
    weight: Float32


class _Fit(Struct, frozen=True, eq=False):
    """The state of the fit of N profiles in L loops.

    place: (N,) place of the edge, steps from the border pixel.
    blur: (L,) sigma of the blur, px.
    trust: (N,) weight of each profile for the plateaus.
    contrast: (N,) grey value inside minus outside.
    misfit: (N,) rms residual, grey values.
    """

    place: FloatArray
    blur: Float32
    trust: FloatArray
    contrast: Float32
    misfit: Float32


def fit_edge(grey: Pixels | Float32, mask: Pixels, loops: Rings, chain: ComplexArray) -> MaskEdge:
    """Fit the edges along closed loops of border pixels.

    chain: (N,) u + iv, the outermost pixels of the mask, with the part on the left.
    """
    outward = 1j * measure_directions(loops, chain)
    axis = _choose_axes(outward)
    values = _read_pixels(grey, chain, axis, _STEPS).astype(np.float32)
    profiles = _Profiles(loops, axis, values, _find_weights(mask, chain, axis))
    zero = np.zeros(len(chain), dtype=np.float32)
    blur = np.ones(len(loops.count), dtype=np.float32)
    fit = _Fit(np.full(len(chain), 0.5), blur, np.ones(len(chain)), zero, zero)
    bend = np.zeros(len(chain))
    for k in range(_ROUNDS):
        if k % 2 == 0:
            points = chain + axis * fit.place
            along = measure_directions(loops, points)
            outward, bend = 1j * along, _measure_bends(loops, points, along)
        fit = _improve(profiles, fit, outward, bend)
    is_near = np.abs(fit.place - 0.5) < _MAX_DISTANCE_PX
    points = chain + axis * np.where(is_near, fit.place, 0.5)
    shift = outward * (_select_even_bends(loops, bend) * fit.blur[loops.loop] ** 2 / 2)
    return MaskEdge(points, shift, is_near, fit.blur.astype(np.float64), fit.contrast, fit.misfit)


def _choose_axes(outward: ComplexArray) -> ComplexArray:
    """The axis (N,) of the picture nearest to each direction out of the part: 1, -1, 1j or -1j."""
    is_upright = np.abs(outward.imag) > np.abs(outward.real)
    return np.where(is_upright, 1j * np.sign(outward.imag), np.sign(outward.real))


def _improve(profiles: _Profiles, fit: _Fit, outward: ComplexArray, bend: FloatArray) -> _Fit:
    """One round: first the plateaus, then a step of Gauss-Newton for places and blur."""
    loops, values, weight = profiles.loops, profiles.values, profiles.weight
    blur = fit.blur[loops.loop][:, None]
    lean = profiles.axis * outward.conj()
    u = _measure_distances(lean.real, fit.place, bend) * (_LOGISTIC / blur)
    inner = 1 / (1 + np.exp(u.clip(-30, 30)))
    inside, outside = _fit_plateaus(profiles, inner, fit.trust)
    contrast = inside - outside
    error = (values - outside[:, None] - contrast[:, None] * inner) * weight
    place_slope = weight * inner * (1 - inner) * (contrast[:, None] * _LOGISTIC / blur)
    blur_slope = place_slope * u / _LOGISTIC
    step = _divide(_dot(place_slope, error), _dot(place_slope, place_slope))
    move = step / np.maximum(lean.real, 0.3)
    blur_error = np.add.reduceat(_dot(blur_slope, error), loops.first)
    change = _divide(blur_error, np.add.reduceat(_dot(blur_slope, blur_slope), loops.first))
    misfit = np.sqrt(_dot(error, error) / np.maximum(weight.sum(axis=1), 1))
    usual = _USUAL_FACTOR * np.maximum(loops.mean(misfit), 1e-3)[loops.loop]
    return _Fit(
        fit.place + move.clip(-0.5, 0.5),
        (fit.blur + change.clip(-0.5, 0.5)).clip(_MIN_BLUR, _MAX_BLUR),
        1 / (1 + (misfit / usual).astype(np.float64) ** 4),
        contrast,
        misfit,
    )


def _measure_distances(lean: FloatArray, place: FloatArray, bend: FloatArray) -> Float32:
    """Signed distance (N, K) of the pixels of each profile from the edge, positive outside, px.

    The edge is an arc of the curvature `bend` (N,), 1/px.

    lean: (N,) cosine of the angle between axis and normal of the edge.
    place: (N,) place of the edge, steps.
    """
    lean32, place32, bend32 = np.stack([lean, place, bend]).astype(np.float32)[:, :, None]
    step = _STEPS.astype(np.float32) - place32
    square = step * (2 * lean32 + bend32 * step)
    return np.asarray(square / (1 + np.sqrt(np.maximum(1 + bend32 * square, 0))))


def _read_pixels(
    picture: Pixels | Float32, chain: ComplexArray, axis: ComplexArray, steps: IntArray
) -> NDArray[np.uint8] | Float32:
    """Pixels (N, K) at whole `steps` (K,) along `axis` (N,) from `chain` (N,).

    Beyond the border of the picture its last pixels are repeated.
    """
    height, width = picture.shape
    u = chain.real.astype(np.int64)[:, None] + axis.real.astype(np.int64)[:, None] * steps
    v = chain.imag.astype(np.int64)[:, None] + axis.imag.astype(np.int64)[:, None] * steps
    pixels: NDArray[np.uint8] | Float32 = picture[v.clip(0, height - 1), u.clip(0, width - 1)]
    return pixels


def _find_weights(mask: Pixels, chain: ComplexArray, axis: ComplexArray) -> Float32:
    """Weights (N, K): 1 for the pixels at `_STEPS` that no other edge disturbs, else 0."""
    outside = _read_pixels(mask, chain, axis, np.arange(2, _SEARCH_PX + 1)) != 0
    inside = _read_pixels(mask, chain, axis, -np.arange(1, _SEARCH_PX)) == 0
    step = _STEPS - 0.5
    is_clear = (step <= _measure_clear(outside)) & (step >= -_measure_clear(inside))
    return is_clear.astype(np.float32)


def _measure_clear(is_other: BoolArray) -> FloatArray:
    """Distance (N, 1) from this edge up to which the next one does not disturb pixels, px.

    The next edge is where `is_other` (N, K) is first true, or at twice the searched distance.
    """
    first = np.argmax(is_other, axis=1)
    distance = np.where(is_other.any(axis=1), first + 1.0, 2.0 * _SEARCH_PX)
    return np.maximum(distance / 2, distance - _CLEAR_PX)[:, None]


def _fit_plateaus(
    profiles: _Profiles, inner: Float32, trust: FloatArray
) -> tuple[Float32, Float32]:
    """Fit the grey values inside and outside (N,) over a window of rows, in least squares.

    They are drawn towards those of the whole loop.

    inner: (N, K) fraction of each pixel that is part.
    trust: (N,) weight of each profile.
    """
    loops, outer = profiles.loops, 1 - inner
    inner_weight, outer_weight = profiles.weight * inner, profiles.weight * outer
    pairs = (
        (inner_weight, inner),
        (inner_weight, outer),
        (outer_weight, outer),
        (inner_weight, profiles.values),
        (outer_weight, profiles.values),
    )
    sums = np.stack([_dot(a, b) for a, b in pairs], axis=1) * trust[:, None]
    inside, outside = _solve_plateaus(loops.mean(sums) + np.array([1e-6, 0, 1e-6, 0, 0]))
    unit = np.ones(len(loops))
    of_loop = np.column_stack([unit, 0 * unit, unit, inside[loops.loop], outside[loops.loop]])
    inside, outside = _solve_plateaus(loops.around(sums, _WINDOW) + _LOOP_WEIGHT * of_loop)
    return inside.astype(np.float32), outside.astype(np.float32)


def _solve_plateaus(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve M systems of two equations, `sums` (M, 5): matrix a b, b c and right side p, q."""
    a, b, c, p, q = sums.T
    size = np.maximum(a * c - b * b, 1e-12)
    return (c * p - b * q) / size, (a * q - b * p) / size


def _dot(a: Float32, b: Float32) -> Float32:
    """Sum (N,) of the products of each row of `a` and `b` (N, K)."""
    return np.asarray(np.einsum("nk,nk->n", a, b))


def _divide(a: Float32, b: Float32) -> Float32:
    """`a` divided by `b`, which is 0 or more; never infinite."""
    return np.asarray(a / np.maximum(b, np.float32(1e-6)))


def _measure_bends(loops: Rings, points: ComplexArray, along: ComplexArray) -> FloatArray:
    """Curvature (N,) of the border, 1/px, positive where the part is convex.

    It is the change of direction from 3 rows before to 3 rows after, divided by the length between.
    """
    ahead, before = loops.shifted(_BEND_ROWS), loops.shifted(-_BEND_ROWS)
    # Seen with v upwards, where the part is on the left, a convex border turns to the left.
    turn = np.angle(along[before] * along[ahead].conj())
    step = np.abs(points[loops.shifted(1)] - points)
    length = loops.around(step, _BEND_ROWS) - step[ahead]
    return np.asarray((turn / np.maximum(length, 1.0)).clip(-0.5, 0.5))


def _select_even_bends(loops: Rings, bend: FloatArray) -> FloatArray:
    """The smallest curvature (N,) of each row and of those `_BEND_APART` rows before and after.

    0 where they differ in sign, as at a corner.
    """
    ahead, before = bend[loops.shifted(_BEND_APART)], bend[loops.shifted(-_BEND_APART)]
    least = np.minimum(np.abs(bend), np.minimum(np.abs(ahead), np.abs(before)))
    return np.where((bend * ahead > 0) & (bend * before > 0), np.copysign(least, bend), 0.0)


# Outlines from the edges.

#: px: a point that is less than this ahead of the one before is left out, as both profiles have
#: found the same place.
_MIN_STEP = 0.4
#: A loop has no edge in the grey picture if its contrast is below this many times the misfit.
_MIN_CONTRAST_RATIO = 3.0
#: px: blur of the mask, which replaces a grey picture without an edge.
_MASK_BLUR = 1.5
#: px: noise of points from a blurred mask. For rendered discs and rectangles it is 0.15 with a blur
#: of 1, 0.12 with 1.5 and 0.10 with 2, but a larger blur rounds the corners more.
_MASK_SIGMA = 0.12
#: px: smallest noise of a point, which remains in a picture without noise.
_MIN_SIGMA = 0.008
#: Points of an outline, at least.
_MIN_POINTS = 8
#: An edge is soft if its steepest step is smaller than this fraction of that of the sharp edges.
_SOFT = 0.55
#: A note warns if this fraction of the edges is soft.
_MIN_SOFT = 0.1
#: Outlines are those of a shadow alone if this fraction of their soft edges faces one way, and of
#: their sharp edges the other way.
_FACING = 0.9
#: The middle half of the lengths across such a shadow, in this direction, differs by at most this
#: fraction of the median: a part that is moved by one vector covers as much everywhere beside its
#: former place. Across a disc the lengths differ by 0.16 of their median.
_EVEN_LENGTHS = 0.1
#: Edges that face a direction have a normal within 45 deg of it.
_FACES = np.cos(np.pi / 4)


class Outline(Struct, frozen=True, eq=False):
    """A closed border of the part.

    points: (N, 2) edge points in view pixels, the first one not repeated; with v upwards, the part
        is on the left.
    halfway: (N, 2) places at which the grey value is the mean of part and bench, px. Where the
        border bends with radius r they are off the edge by blur^2 / (2 r). `points` are corrected
        for that if the bend is the same for six pixels to both sides.
    hole: it is the border of a hole.
    sigma: noise of a point across the border, px, without the part that it shares with its
        neighbours. In a rectified view interpolation connects them, and they share as much again.
    blur: sigma of the blur across the edge, px.
    has_edge: the grey picture shows an edge there.
    is_shadow: all borders together are those of a shadow without its part.
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


def find_outlines(
    grey: Pixels | Float32, mask_pixels: Pixels
) -> tuple[tuple[Outline, ...], tuple[Note, ...]]:
    """Find the outlines of the part in a mask, as exactly as the grey picture shows them.

    There is about one point per pixel of border. None is interpolated, so the noise of neighbours
    is independent. Along sharp corners the points are as round as the picture. If the grey picture
    shows no edge beside the mask, as for a part that differs only in colour, the border of the mask
    is smoothed instead, and a note reports it. Borders of fewer than 8 points are left out, with a
    note.

    grey: (H, W) uint8 or float32.
    mask_pixels: (H, W) uint8, not 0 on the part.

    Returns the outlines and notes. Raises InputError if picture and mask do not fit together.
    """
    _check_pictures(grey, mask_pixels)
    loops, chain, holes = _find_chains(mask_pixels)
    if not len(loops.count):
        return (), (Note("skipped", "no part in the mask", "choose another mask"),)
    edge = fit_edge(grey, mask_pixels, loops, chain)
    lacks_edge = _find_without_edge(loops, edge)
    widths = _measure_widths(grey, mask_pixels, loops, chain)
    is_shadow = _is_shadow_alone(mask_pixels, chain, widths)
    notes = list(_note_soft(widths))
    if lacks_edge.any():
        edge = _merge_edges(loops, edge, _fit_mask_edge(mask_pixels, loops, chain), lacks_edge)
        notes.append(
            Note(
                "warning",
                f"{int(lacks_edge.sum())} of {counted(len(lacks_edge), 'outline')} "
                "taken from the mask alone",
                "the grey picture shows no edge there; their noise is about a tenth of a pixel",
            )
        )
    results: list[Outline] = []
    for loop, rows in enumerate(_select_rows(loops, edge.halfway)):
        if len(rows) >= _MIN_POINTS:
            halfway, shift = edge.halfway[rows], edge.shift[rows]
            has_edge = not lacks_edge[loop]
            sigma = max(_measure_noise(halfway), _MIN_SIGMA if has_edge else _MASK_SIGMA)
            points, blur = _convert_points(halfway + shift), float(edge.blur[loop])
            hole, halfway_points = bool(holes[loop]), _convert_points(halfway)
            results.append(Outline(points, halfway_points, hole, sigma, blur, has_edge, is_shadow))
    small_count = len(loops.count) - len(results)
    if small_count:
        notes.append(
            Note(
                "skipped",
                f"{counted(small_count, 'border')} of fewer than {_MIN_POINTS} points",
                "smaller than 3 px",
            )
        )
    return tuple(results), tuple(notes)


def _check_pictures(grey: Pixels | Float32, mask: Pixels) -> None:
    if mask.ndim != 2 or mask.dtype != np.uint8:
        raise InputError(
            "mask", f"has shape {mask.shape} of {mask.dtype}", remedy="give (H, W) uint8"
        )
    if grey.shape != mask.shape or grey.dtype not in (np.uint8, np.float32):
        raise InputError(
            "grey picture",
            f"has shape {grey.shape} of {grey.dtype} beside a mask of {mask.shape}",
            remedy="give (H, W) uint8 or float32 of the same size",
        )


def _find_chains(mask: Pixels) -> tuple[Rings, ComplexArray, NDArray[np.bool_]]:
    """Find the outermost pixels of the part along every border.

    Returns the L loops, the pixels (N,) u + iv, and which loops are holes (L,).
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not chains:
        return make_rings(()), np.zeros(0, dtype=complex), np.zeros(0, dtype=bool)
    flat = np.concatenate(chains)[:, 0].astype(np.float64)
    return make_rings(count_rows(chains)), flat @ np.array([1, 1j]), tree[0, :, 3] >= 0


def _find_without_edge(loops: Rings, edge: MaskEdge) -> NDArray[np.bool_]:
    """Find the loops (L,) without an edge in the grey picture.

    Both sides have about the same grey value, or there is only a slope of light, or the edge is far
    from the mask.
    """
    contrast = np.abs(loops.mean(edge.contrast))
    misfit = np.sqrt(loops.mean(edge.misfit.astype(np.float64) ** 2))
    has_low_contrast = (contrast < _MIN_CONTRAST_RATIO * misfit) | (contrast < 2.0)
    is_slope = edge.blur > _MAX_EDGE_BLUR
    is_far = loops.mean(edge.is_near * 1.0) < 0.9
    return np.asarray(has_low_contrast | is_slope | is_far)


def _measure_widths(
    grey: Pixels | Float32, mask: Pixels, loops: Rings, chain: ComplexArray
) -> _EdgeWidths:
    """Measure the widths of the edges beside all borders, by their steepest step."""
    outward = 1j * measure_directions(loops, chain)
    axis = _choose_axes(outward)
    values = _read_pixels(grey, chain, axis, _STEPS).astype(np.float64)
    steps = loops.around(np.abs(np.diff(values, axis=1)), _WINDOW)
    steepness = steps.max(axis=1) / np.maximum(steps.sum(axis=1), 1e-6)
    # Another edge within the profile would count as width.
    alone = np.asarray(_find_weights(mask, chain, axis).all(axis=1))
    if not alone.any():
        return _EdgeWidths(outward, alone, alone)
    is_soft: BoolArray = steepness < _SOFT * np.percentile(steepness[alone], 90)
    return _EdgeWidths(outward, alone & is_soft, alone & ~is_soft)


def _note_soft(widths: _EdgeWidths) -> tuple[Note, ...]:
    """The note on stretches where the edge is much wider than elsewhere: shadows, or motion."""
    measured = widths.soft | widths.sharp
    if not measured.any():
        return ()
    fraction = float(np.mean(widths.soft[measured]))
    if fraction < _MIN_SOFT:
        return ()
    return (
        Note(
            "warning",
            f"{100 * fraction:.0f} % of the outlines are soft, the rest is sharp",
            "a shadow is soft on the side of the bench; a camera that moves blurs along its "
            "motion; look at the preview",
        ),
    )


def _is_shadow_alone(mask: Pixels, chain: ComplexArray, widths: _EdgeWidths) -> bool:
    """Whether the borders are those of a shadow without its part.

    The part beside it has the tone of the bench. Its own edge, towards the lamp, is sharp, and the
    far edge of the shadow is soft. A part with its shadow has sharp edges on all sides, or is not
    as wide everywhere as the vector by which the lamp moves its outline.
    """
    soft, sharp = widths.soft, widths.sharp
    if not (soft.any() and sharp.any()) or np.mean(soft[soft | sharp]) < _MIN_SOFT:
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
    return bool(high - low <= _EVEN_LENGTHS * middle)


def _measure_across(mask: Pixels, points: ComplexArray, lamp_ray: complex) -> IntArray:
    """Distance (N,) from border pixels to the other border, against `lamp_ray`, px."""
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


def _fit_mask_edge(mask: Pixels, loops: Rings, chain: ComplexArray) -> MaskEdge:
    """Fit the edges in the blurred mask, without a grey picture."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    soft = cv2.GaussianBlur(mask, (0, 0), _MASK_BLUR)
    return fit_edge(np.asarray(soft, dtype=np.uint8), mask, loops, chain)


def _merge_edges(
    loops: Rings, edge: MaskEdge, other: MaskEdge, from_other: NDArray[np.bool_]
) -> MaskEdge:
    """The edges of `edge`, and of `other` for the loops `from_other` (L,)."""
    rows = from_other[loops.loop]
    return MaskEdge(
        np.where(rows, other.halfway, edge.halfway),
        np.where(rows, other.shift, edge.shift),
        np.where(rows, other.is_near, edge.is_near),
        np.where(from_other, other.blur, edge.blur),
        np.where(rows, other.contrast, edge.contrast),
        np.where(rows, other.misfit, edge.misfit),
    )


def _select_rows(loops: Rings, points: ComplexArray) -> list[IntArray]:
    """The rows of each loop without points that are not ahead of the one before."""
    rows = np.arange(len(points))
    for _ in range(3):
        table = make_rings(np.bincount(loops.loop[rows], minlength=len(loops.count)))
        step = points[rows] - points[rows[table.shifted(-1)]]
        is_late = (step * measure_directions(table, points[rows]).conj()).real < _MIN_STEP
        # If two neighbours are late, only the first one is removed, then all are tested again.
        # No loop loses all of its rows.
        is_late &= ~is_late[table.shifted(-1)] & (table.count[table.loop] > 2)
        if not is_late.any():
            break
        rows = rows[~is_late]
    return np.split(rows, np.cumsum(np.bincount(loops.loop[rows], minlength=len(loops.count)))[:-1])


def _convert_points(points: ComplexArray) -> FloatArray:
    """Convert points (N,) u + iv to (N, 2), read-only."""
    return frozen(np.column_stack([points.real, points.imag]))


def _measure_noise(points: ComplexArray) -> float:
    """Noise of points (N,) across the border, px, a standard deviation.

    Third differences remove any smooth curve, and the median ignores corners.
    """
    b, c, d = np.roll(points, -1), np.roll(points, -2), np.roll(points, -3)
    along = (c - b) / np.maximum(np.abs(c - b), 1e-9)
    third = ((d - 3 * c + 3 * b - points) * along.conj()).imag
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def measure_directions(loops: Rings, points: ComplexArray, half: int = 3) -> ComplexArray:
    """Unit vectors (N,) along the loops, from the mean of the rows before to that of those after.

    half: number of rows on either side.
    """
    # Sums of the rows from -2 half to 0 and from 0 to 2 half.
    total = loops.around(points, half)
    ahead, before = total[loops.shifted(half)], total[loops.shifted(-half)]
    along = ahead - before
    size = np.abs(along)
    return np.asarray(np.where(size > 1e-9, along / np.maximum(size, 1e-9), 1.0))
