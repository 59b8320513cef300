"""Converts outlines to contours of lines and arcs in mm, as a drawing of the part would have them.

The points of an outline are noisy, and the blur rounds its corners. A line or an arc through many
points is far more exact than each point, and a corner is where two of them cross.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, compress

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import count_rows
from camgen.geometry.rings import ComplexArray, Rings, make_rings
from camgen.model.part import BoolArray, Contour, IntArray, Note, list_ids
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.vision.lines_arcs.fit import Curves
from camgen.vision.lines_arcs.joints import (
    CornerJoints,
    compute_normals,
    compute_tangents,
    find_joints,
    find_small_corners,
    find_walls,
    orient,
    select_clear,
)
from camgen.vision.lines_arcs.noise import divide, measure, measure_residuals
from camgen.vision.lines_arcs.polish import (
    FittedChain,
    compute_astray_limit,
    find_astray,
    make_no_fillets,
    measure_errors,
    measure_fillets,
    polish,
    select_beyond,
)
from camgen.vision.lines_arcs.runs import (
    Runs,
    fit_runs,
    merge,
    relax,
    trim,
    wrap_rows,
)
from camgen.vision.lines_arcs.spots import FITTED, find_stretches, make_sound
from camgen.vision.outline import Outline
from camgen.vision.similarity import measure_scale

# Outlines divided into runs for lines and arcs: the order of the steps.

#: Rounds of measuring the noise, moving ends and merging.
_ROUNDS = 3
#: In each round, times that the ends between runs are moved,
_END_ROUNDS = 2
#: and times that roundings of corners are removed.
_CORNER_ROUNDS = 3
#: Points of a run, at least. Fewer do not show a feature.
_MIN_POINTS = 3
#: px: largest shift of an arc by the blur. With a larger one the arc is as small as the blur.
_MAX_SHIFT = 0.3


class Divided(Struct, frozen=True, eq=False):
    """L outlines, divided into runs.

    points: (N,) px, corrected for the blur.
    runs, curves: lines and arcs.
    joints: corners and tangential joints, one at the end of each run.
    counts: (N,) the point counts, as no corner has rounded it.
    noise: (L,) standard deviation of a point across its outline, px.
    """

    points: ComplexArray
    runs: Runs
    curves: Curves
    joints: CornerJoints
    counts: BoolArray
    noise: FloatArray


def divide_loops(
    loops: Rings, halfway: ComplexArray, sigma: FloatArray, blur: FloatArray
) -> Divided:
    """Divide closed loops of points into lines and arcs.

    halfway: (N,) points whose grey value is the mean of those inside and outside, px.
    sigma: (L,) noise of the points that the picture predicts, px.
    blur: (L,) sigma of the blur, px.
    """
    weight, predicted = np.ones(len(halfway)), sigma
    runs, level = divide(loops, halfway, predicted, blur)
    for _ in range(_ROUNDS):
        curves = fit_runs(runs, loops, halfway, weight, sigma)[1]
        residuals = measure_residuals(runs, loops, halfway, curves)
        measured = np.stack(measure(runs, loops, residuals, weight, blur))
        single, sigma = np.where(np.isnan(measured), level, np.maximum(measured, predicted))
        for _ in range(_END_ROUNDS):
            _, curves, _ = fit_runs(runs, loops, halfway, weight, sigma)
            runs = relax(runs, loops, halfway, curves, sigma)
            _, curves, _ = fit_runs(runs, loops, halfway, weight, sigma)
            weight = trim(runs, loops, halfway, curves, single, blur)
        for _ in range(_CORNER_ROUNDS):
            former_runs, former_weight = runs, weight
            runs, curves = _remove_roundings(runs, loops, halfway, weight, sigma, blur)
            corners = find_joints(curves, runs, loops, halfway, sigma, blur)
            is_clear = select_clear(corners, curves, runs, loops, halfway)
            weight = is_clear * trim(runs, loops, halfway, curves, single, blur)
            if runs is former_runs and np.array_equal(weight, former_weight):
                break  # another time would change nothing
        runs = merge(runs, loops, halfway, weight, sigma)
    curves = _fit_oriented(runs, loops, halfway, weight, sigma)
    points = _correct_blur(runs, loops, halfway, curves, blur)
    curves = _fit_oriented(runs, loops, points, weight, sigma)
    corners = find_joints(curves, runs, loops, points, sigma, blur)
    counts = select_clear(corners, curves, runs, loops, points)
    return Divided(points, runs, curves, corners, counts, single)


def _fit_oriented(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> Curves:
    """Fit a line or arc to each run, signed in the direction of the run."""
    return orient(fit_runs(runs, loops, points, weight, sigma)[1], runs, loops, points)


def _remove_roundings(
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    weight: FloatArray,
    sigma: FloatArray,
    blur: FloatArray,
) -> tuple[Runs, Curves]:
    """Remove runs that are only the rounded picture of a corner, or have hardly any points."""
    curves = _fit_oriented(runs, loops, points, weight, sigma)
    is_small = (runs.count < _MIN_POINTS) & runs.several()
    is_small &= ~find_walls(curves, runs, loops, points, sigma)
    is_small |= find_small_corners(curves, runs, loops, points, blur)
    if not is_small.any():
        return runs, curves
    runs = _give_away(runs, loops, is_small, curves)
    return runs, _fit_oriented(runs, loops, points, weight, sigma)


def _give_away(runs: Runs, loops: Rings, small: BoolArray, curves: Curves) -> Runs:
    """Give the points of small runs to their neighbours, half to each.

    If two neighbours are small, only the one that bends more is given away.
    """
    after, before = runs.following(), runs.before()
    rank = np.empty(len(runs), dtype=np.int64)
    rank[np.argsort(np.abs(curves.curvature), kind="stable")] = np.arange(len(runs))
    rank = np.where(small, rank, -1)
    removed = np.flatnonzero(small & (rank > rank[before]) & (rank > rank[after]))
    first, count = runs.first.copy(), runs.count.copy()
    half = runs.count[removed] // 2
    other_half = runs.count[removed] - half
    # A run between two removed ones gets points of both, which `np.add.at` adds up.
    np.add.at(count, before[removed], half)
    np.add.at(count, after[removed], other_half)
    np.add.at(first, after[removed], -other_half)
    kept = np.delete(np.arange(len(runs)), removed)
    return wrap_rows(Runs(first[kept], count[kept], runs.loop[kept]), loops)


def _correct_blur(
    runs: Runs, loops: Rings, points: ComplexArray, curves: Curves, blur: FloatArray
) -> ComplexArray:
    """Move the points of arcs away from the centre.

    A blur of sigma s has moved those of an arc of radius r towards it by s^2 / (2 r).
    """
    rows, _ = runs.rows(loops)
    owner = np.repeat(np.arange(len(runs)), runs.count)
    shift = (curves.curvature * blur[runs.loop] ** 2 / 2).clip(-_MAX_SHIFT, _MAX_SHIFT)
    moved = points.copy()
    moved[rows] += shift[owner] * compute_normals(curves.take(owner), points[rows])
    return moved


# Contours of lines and arcs.

#: px: errors of a point that are not noise: the pattern of the pixels, and the distortion that the
#: camera model leaves.
_SYSTEMATIC_PX = 0.02


class OutlineFit(Struct, frozen=True):
    """Deviations of a contour from its outline, and the spots where it is not fitted.

    rms_mm, max_mm: distances of the points that no corner has rounded, root mean square and
        maximum, mm.
    lines, arcs: number of lines and of arcs.
    doubtful: number of stretches that no line or arc follows, and that are kept as lines.
    lines_mm: total length of these stretches, mm.
    places: x and y of their middles, mm.
    cut: area of small loops that were cut off, px2.
    """

    rms_mm: float
    max_mm: float
    lines: int
    arcs: int
    doubtful: int = 0
    lines_mm: float = 0.0
    places: tuple[tuple[float, float], ...] = ()
    cut: float = 0.0


def make_contours(
    outlines: Sequence[Outline], work_from_view: FloatArray, layer: str = "0"
) -> tuple[tuple[Contour, ...], tuple[OutlineFit, ...], tuple[Note, ...]]:
    """Convert outlines (view pixels) to contours in the work frame (mm).

    Outer contours run counter-clockwise, holes clockwise; an arc is at most half a circle.
    Stretches that no line or arc follows are kept as lines within the noise of their points. A
    contour whose points cross loses small loops, and is left out if the loops are large; notes
    report this. All decisions are made in pixels, so the scale has no influence.

    work_from_view: (2, 3), from pixel centres to mm, a similarity; v may run against y.

    Returns the contours, how well each one fits, and notes. Raises InputError if the view is not to
    scale.
    """
    matrix = np.asarray(work_from_view, dtype=np.float64)
    measure_scale(matrix)
    if not outlines:
        return (), (), ()
    borders = [outline.halfway for outline in outlines]
    loops = make_rings(count_rows(borders))
    halfway = np.concatenate(borders) @ np.array([1, 1j])
    sigma = np.array([np.hypot(outline.sigma, _SYSTEMATIC_PX) for outline in outlines])
    parts = divide_loops(loops, halfway, sigma, np.array([outline.blur for outline in outlines]))
    rows, begin = parts.runs.rows(loops)
    ends = np.searchsorted(parts.runs.loop, np.arange(len(outlines) + 1))
    contours: list[Contour] = []
    fits: list[OutlineFit] = []
    notes: list[Note] = []
    for k, outline in enumerate(outlines):
        runs = np.arange(ends[k], ends[k + 1])
        stop = begin[runs[-1]] + parts.runs.count[runs[-1]]
        shape = _make_contour(parts, runs, rows[begin[runs[0]] : stop], outline.blur, matrix)
        if shape is None:
            notes.append(
                Note("skipped", f"outline {k + 1} crosses itself", "the mask is too ragged there")
            )
        else:
            (points, bulges), fit = shape
            contours.append(Contour(points, bulges, True, layer, f"c{len(contours) + 1}"))
            fits.append(fit)
    return tuple(contours), tuple(fits), (*notes, *_note_lines(contours, fits))


def _note_lines(contours: Sequence[Contour], fits: Sequence[OutlineFit]) -> tuple[Note, ...]:
    """Notes on stretches that are kept as lines, and on loops that were cut off."""
    notes = []
    places = tuple(chain.from_iterable(fit.places for fit in fits))
    if places:
        length = sum(fit.lines_mm for fit in fits)
        ids = list_ids(compress(contours, (fit.doubtful for fit in fits)))
        stretches = (
            f"{counted(len(places), 'stretch', 'stretches')} of {counted(len(ids), 'outline')} "
            f"kept as lines, {short(length, 1)} mm in all"
        )
        notes.append(Note("warning", stretches, "no lines and arcs fit them reliably", ids, places))
    area = sum(fit.cut for fit in fits)
    if area:
        ids = list_ids(compress(contours, (fit.cut for fit in fits)))
        loops = f"{short(area, 1)} px2 of {counted(len(ids), 'outline')} cut off"
        notes.append(Note("warning", loops, "small loops where they cross themselves", ids))
    return tuple(notes)


#: Points (N, 2) and bulges (N,) of a contour, mm, and how well it fits.
_FittedContour = tuple[tuple[FloatArray, FloatArray], OutlineFit]


def _make_contour(
    parts: Divided, runs: IntArray, rows: IntArray, blur: float, matrix: FloatArray
) -> _FittedContour | None:
    """The contour of one outline, or None if it crosses itself too much.

    runs: numbers of its runs.
    rows: rows of its points.
    """
    points, counts = parts.points[rows], parts.counts[rows]
    sigma = float(parts.noise[parts.runs.loop[runs[0]]])
    if len(runs) == 1:
        circle = _make_circle(parts, runs, points, sigma, matrix)
        if circle is not None:
            return circle
        # A single piece without a curve, as no circle follows the points.
        smooth = np.zeros(1, dtype=np.bool_)
        fitted = FittedChain(points[:1], np.zeros(1), ~smooth, smooth)
        piece = np.zeros(len(points), dtype=np.int64)
    else:
        fitted, piece = _fit_chain(parts, runs, points, counts)
    if len(fitted.corners) < 3 and fitted.straight.all():
        fillets, bad = make_no_fillets(fitted), np.ones(len(fitted.corners), dtype=np.bool_)
    else:
        fillets = measure_fillets(fitted, points, piece, blur, sigma)
        counts = counts & select_beyond(fitted, fillets, points, piece)
        bad = find_astray(fitted, fillets, points, piece, counts, sigma)
    sound = make_sound(fitted, fillets, bad, points, piece, compute_astray_limit(sigma))
    if sound is None:
        return None
    shape = _convert_to_work(sound.ring.corners, sound.ring.bulges, matrix)
    error = measure_errors(fitted, points, piece)[counts & (sound.drawn == FITTED)[piece]]
    middles, lengths = find_stretches(sound.drawn, points, piece)
    fit = _measure_fit(error, shape[1], matrix)
    middles_mm, _ = _convert_to_work(middles, np.zeros(len(middles)), matrix)
    places = tuple((x, y) for x, y in middles_mm.tolist())
    lines_mm = measure_scale(matrix) * float(lengths.sum())
    return shape, replace(
        fit, doubtful=len(places), lines_mm=lines_mm, places=places, cut=sound.cut
    )


def _measure_fit(error: FloatArray, bulges: FloatArray, matrix: FloatArray) -> OutlineFit:
    """Measure how well a contour with these bulges (N,) fits.

    error: (M,) distances of its points, px.
    """
    distance = measure_scale(matrix) * np.abs(error)
    arcs = int((bulges != 0).sum())
    rms = float(np.sqrt((distance**2).sum() / max(len(distance), 1)))
    return OutlineFit(rms, float(distance.max(initial=0.0)), len(bulges) - arcs, arcs)


def _make_circle(
    parts: Divided, runs: IntArray, points: ComplexArray, sigma: float, matrix: FloatArray
) -> _FittedContour | None:
    """A whole circle as two arcs, or None if the points are not on a circle or not all around it.

    runs: the number of its single run.
    """
    curve = parts.curves.take(runs)
    bend = float(curve.curvature[0])
    if bend == 0:
        return None
    centre = complex(curve.origin[0] - (curve.form[0, 1] + 1j * curve.form[0, 2]) / bend)
    error = curve.distances(points[None])[0]
    angle = abs(float(np.ptp(np.unwrap(np.angle(points - centre)))))
    if angle < np.pi or np.sqrt((error**2).mean()) > compute_astray_limit(sigma):
        return None
    corners = np.array([centre + 1 / abs(bend), centre - 1 / abs(bend)])
    shape = _convert_to_work(corners, np.full(2, np.sign(bend)), matrix)
    return shape, _measure_fit(error, shape[1], matrix)


def _fit_chain(
    parts: Divided, runs: IntArray, points: ComplexArray, counts: BoolArray
) -> tuple[FittedChain, IntArray]:
    """Fit a chain of lines and arcs to the points of several runs.

    Returns the chain, and the piece (N,) that each point belongs to.
    """
    piece = np.repeat(np.arange(len(runs)), parts.runs.count[runs])
    curves = parts.curves.take(runs)
    corners, smooth = np.roll(parts.joints.vertex[runs], 1), np.roll(parts.joints.smooth[runs], 1)
    after = np.roll(corners, -1)
    sweep = np.angle(compute_tangents(curves, after) * compute_tangents(curves, corners).conj())
    length = np.bincount(piece, np.append(np.abs(np.diff(points)), 0.0))
    # The directions at both ends determine the sweep up to whole revolutions.
    sweep += 2 * np.pi * np.round((curves.curvature * length - sweep) / (2 * np.pi))
    straight = curves.curvature == 0
    bulges = np.where(straight, 0.0, np.tan(sweep.clip(-6.25, 6.25) / 4))
    fitted = FittedChain(corners, bulges, straight, smooth)
    return polish(fitted, points, piece, counts.astype(np.float64)), piece


def _convert_to_work(
    corners: ComplexArray, bulges: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Convert corners (N,) in px to points (N, 2) in mm; the part is on the left of the contour.

    Returns the points and their bulges (N,).
    """
    points = np.column_stack([corners.real, corners.imag]) @ matrix[:, :2].T + matrix[:, 2]
    if np.linalg.det(matrix[:, :2]) < 0:
        return frozen(points), frozen(0.0 - bulges)
    # The view is not mirrored, so the part is on the right. The contour is reversed, and with it
    # the bulges.
    return frozen(points[::-1]), frozen(0.0 - np.roll(bulges[::-1], -1))
