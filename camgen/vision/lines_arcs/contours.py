"""Outlines to contours of lines and arcs in mm: what a drawing of the part would have held.

The points of an outline are noisy, and rounded where the part has a corner. A line or an arc through many of them is
far better known than each of them, and a corner is where two of those cross.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.rings import ComplexArray, Rings, rings
from camgen.model.part import Contour, IntArray, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.vision.lines_arcs.fit import BoolArray, Curves
from camgen.vision.lines_arcs.joints import (
    CornerJoints,
    clear,
    joints,
    normals,
    orient,
    small_corners,
    tangents,
    walls,
)
from camgen.vision.lines_arcs.noise import divide, measure, residuals_of
from camgen.vision.lines_arcs.polish import (
    FittedChain,
    astray,
    astray_beyond,
    beyond,
    errors,
    fillets_of,
    no_fillets,
    polish,
)
from camgen.vision.lines_arcs.runs import (
    Runs,
    fit_runs,
    merge,
    relax,
    trim,
    within,
)
from camgen.vision.lines_arcs.spots import FITTED, make_sound, stretches_of
from camgen.vision.outline import Outline
from camgen.vision.similarity import scale_of

# Outlines divided into runs for lines and arcs: the order of the steps.

_ROUNDS, _RELAXED, _CORNERS = 3, 2, 3
#: Fewer points than this are no feature.
_LEAST_POINTS = 3
#: The shift by the blur is not believed beyond this, px: the arc is as small as the blur.
_MOST_SHIFT = 0.3


class Divided(Struct, frozen=True, eq=False):
    """Outlines as runs.

    points: (N,) px, put right for the blur.
    runs, curves: lines and arcs.
    joints: corners and touches, one at the end of each run.
    counts: (N,) whether no corner has rounded a point.
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
    """Lines and arcs of closed loops of points where the grey value is half-way; sigma, blur (L,) px."""
    weight, told = np.ones(len(halfway)), sigma
    runs, level = divide(loops, halfway, told, blur)
    for _ in range(_ROUNDS):
        curves = fit_runs(runs, loops, halfway, weight, sigma)[1]
        residuals = residuals_of(runs, loops, halfway, curves)
        measured = measure(runs, loops, residuals, weight, blur)
        single, sigma = (
            np.where(np.isnan(noise), level, np.maximum(noise, told)) for noise in measured
        )
        for _ in range(_RELAXED):
            _, curves, _ = fit_runs(runs, loops, halfway, weight, sigma)
            runs = relax(runs, loops, halfway, curves, sigma)
            _, curves, _ = fit_runs(runs, loops, halfway, weight, sigma)
            weight = trim(runs, loops, halfway, curves, single, blur)
        for _ in range(_CORNERS):
            runs, curves = _without_corners(runs, loops, halfway, weight, sigma, blur)
            found = joints(curves, runs, loops, halfway, sigma, blur)
            weight = clear(found, curves, runs, loops, halfway) * trim(
                runs, loops, halfway, curves, single, blur
            )
        runs = merge(runs, loops, halfway, weight, sigma)
    curves = _curves(runs, loops, halfway, weight, sigma)
    points = _put_right(runs, loops, halfway, curves, blur)
    curves = _curves(runs, loops, points, weight, sigma)
    found = joints(curves, runs, loops, points, sigma, blur)
    counts = clear(found, curves, runs, loops, points)
    return Divided(points, runs, curves, found, counts, single)


def _curves(
    runs: Runs, loops: Rings, points: ComplexArray, weight: FloatArray, sigma: FloatArray
) -> Curves:
    return orient(fit_runs(runs, loops, points, weight, sigma)[1], runs, loops, points)


def _without_corners(
    runs: Runs,
    loops: Rings,
    points: ComplexArray,
    weight: FloatArray,
    sigma: FloatArray,
    blur: FloatArray,
) -> tuple[Runs, Curves]:
    """The runs without those that are the picture's rounding of a corner, or next to nothing."""
    curves = _curves(runs, loops, points, weight, sigma)
    small = (runs.count < _LEAST_POINTS) & runs.several()
    small &= ~walls(curves, runs, loops, points, sigma)
    small |= small_corners(curves, runs, loops, points, blur)
    if not small.any():
        return runs, curves
    runs = _give_away(runs, loops, small, curves)
    return runs, _curves(runs, loops, points, weight, sigma)


def _give_away(runs: Runs, loops: Rings, small: BoolArray, curves: Curves) -> Runs:
    """``small`` runs given to their neighbours, half each: of neighbours the one that bends most."""
    after, before = runs.following(), runs.before()
    rank = np.empty(len(runs), dtype=np.int64)
    rank[np.argsort(np.abs(curves.curvature), kind="stable")] = np.arange(len(runs))
    rank = np.where(small, rank, -1)
    gone = np.flatnonzero(small & (rank > rank[before]) & (rank > rank[after]))
    first, count = runs.first.copy(), runs.count.copy()
    half = runs.count[gone] // 2
    rest = runs.count[gone] - half
    # A run between two that go gets a share of both.
    np.add.at(count, before[gone], half)
    np.add.at(count, after[gone], rest)
    np.add.at(first, after[gone], -rest)
    keep = np.ones(len(runs), dtype=np.bool_)
    keep[gone] = False
    return within(Runs(first[keep], count[keep], runs.loop[keep]), loops)


def _put_right(
    runs: Runs, loops: Rings, points: ComplexArray, curves: Curves, blur: FloatArray
) -> ComplexArray:
    """The points of arcs moved away from their centre by what the blur has moved them towards it, s^2 / (2 r)."""
    rows, _ = runs.rows(loops)
    which = np.repeat(np.arange(len(runs)), runs.count)
    shift = (curves.curvature * blur[runs.loop] ** 2 / 2).clip(-_MOST_SHIFT, _MOST_SHIFT)
    moved = points.copy()
    moved[rows] += shift[which] * normals(curves.take(which), points[rows])
    return moved


#: What the picture hides beside noise, px: the pattern of its pixels, and distortion that the camera model leaves.
_HIDDEN = 0.02


class OutlineFit(Struct, frozen=True):
    """How well a contour follows its outline: rms_mm and max_mm of the points away from rounded corners, and how many
    lines and arcs it has. doubtful: stretches that no line or arc follows, kept as lines, of lines_mm in all; places:
    their middles, mm. cut: px2 of small loops that were cut off.
    """

    rms_mm: float
    max_mm: float
    lines: int
    arcs: int
    doubtful: int = 0
    lines_mm: float = 0.0
    places: tuple[tuple[float, float], ...] = ()
    cut: float = 0.0


def primitives(
    outlines: Sequence[Outline], work_from_view: FloatArray, layer: str = "0"
) -> tuple[tuple[Contour, ...], tuple[OutlineFit, ...], tuple[Note, ...]]:
    """The ``outlines`` (view pixels) as contours in the work frame (mm), and how well each fits.

    work_from_view: (2, 3), mm of a pixel centre; a similarity, v may run against y. Outer contours run
    counter-clockwise, holes clockwise; arcs are half a circle at most. Stretches that no line or arc follows soundly
    are kept as lines within the noise of their points. A contour whose points cross themselves is cut off at small
    loops, and left out if they are large; notes say so. Every decision is made in pixels: the scale has no say.
    Raises InputError if the view is not to scale.
    """
    matrix = np.asarray(work_from_view, dtype=np.float64)
    scale_of(matrix)
    if not outlines:
        return (), (), ()
    loops = rings(np.array([len(o.halfway) for o in outlines]))
    halfway = np.concatenate([o.halfway for o in outlines]) @ np.array([1, 1j])
    sigma = np.array([np.hypot(o.sigma, _HIDDEN) for o in outlines])
    parts = divide_loops(loops, halfway, sigma, np.array([o.blur for o in outlines]))
    rows, begin = parts.runs.rows(loops)
    ends = np.searchsorted(parts.runs.loop, np.arange(len(outlines) + 1))
    contours: list[Contour] = []
    fits: list[OutlineFit] = []
    notes: list[Note] = []
    for k, outline in enumerate(outlines):
        mine = np.arange(ends[k], ends[k + 1])
        stop = begin[mine[-1]] + parts.runs.count[mine[-1]]
        found = _contour(parts, mine, rows[begin[mine[0]] : stop], outline.blur, matrix)
        if found is None:
            notes.append(
                Note("skipped", f"outline {k + 1} crosses itself", "the mask is too ragged there")
            )
        else:
            contours.append(Contour(*found[0], True, layer, f"c{len(contours) + 1}"))
            fits.append(found[1])
    return tuple(contours), tuple(fits), (*notes, *_tell_lines(contours, fits))


def _tell_lines(contours: Sequence[Contour], fits: Sequence[OutlineFit]) -> tuple[Note, ...]:
    """What was kept as lines, and what was cut off."""
    notes = []
    of = [k for k, fit in enumerate(fits) if fit.doubtful]
    if of:
        count, length = sum(fits[k].doubtful for k in of), sum(fits[k].lines_mm for k in of)
        what = f"{counted(count, 'stretch', 'stretches')} of {counted(len(of), 'outline')} kept as lines"
        what += f", {short(length, 1)} mm in all"
        ids, places = (
            tuple(contours[k].id for k in of),
            tuple(p for k in of for p in fits[k].places),
        )
        notes.append(Note("warning", what, "no lines and arcs follow them soundly", ids, places))
    cut = [k for k, fit in enumerate(fits) if fit.cut]
    if cut:
        what = f"{short(sum(fits[k].cut for k in cut), 1)} px2 of {counted(len(cut), 'outline')} cut off"
        why = "small loops where they cross themselves"
        notes.append(Note("warning", what, why, tuple(contours[k].id for k in cut)))
    return tuple(notes)


_Found = tuple[tuple[FloatArray, FloatArray], OutlineFit]


def _contour(
    parts: Divided, mine: IntArray, rows: IntArray, blur: float, matrix: FloatArray
) -> _Found | None:
    """Points and bulges in mm of the runs ``mine`` of one outline, whose points are ``rows``; None if it fails."""
    points, counts = parts.points[rows], parts.counts[rows]
    sigma = float(parts.noise[parts.runs.loop[mine[0]]])
    circle = _circle(parts, mine, points, sigma, matrix) if len(mine) == 1 else None
    if circle is not None:
        return circle
    if len(mine) == 1:
        chain, piece = _points_only(points), np.zeros(len(points), dtype=np.int64)
    else:
        chain, piece = _chain(parts, mine, points, counts)
    if len(chain.corners) < 3 and chain.straight.all():
        fillets, bad = no_fillets(chain), np.ones(len(chain.corners), dtype=np.bool_)
    else:
        fillets = fillets_of(chain, points, piece, blur, sigma)
        counts = counts & beyond(chain, fillets, points, piece)
        bad = astray(chain, fillets, points, piece, counts, sigma)
    sound = make_sound(chain, fillets, bad, points, piece, astray_beyond(sigma))
    if sound is None:
        return None
    shape = _in_work(sound.ring.corners, sound.ring.bulges, matrix)
    error = errors(chain, points, piece)[counts & (sound.drawn == FITTED)[piece]]
    middles, lengths = stretches_of(sound.drawn, points, piece)
    fit = _fit(error, shape[1], matrix)
    places = tuple((x, y) for x, y in _in_work(middles, np.zeros(len(middles)), matrix)[0].tolist())
    lines_mm = scale_of(matrix) * float(lengths.sum())
    return shape, replace(
        fit, doubtful=len(places), lines_mm=lines_mm, places=places, cut=sound.cut
    )


def _points_only(points: ComplexArray) -> FittedChain:
    """A chain of one piece that is no curve: points that no circle follows."""
    one = np.ones(1, dtype=np.bool_)
    return FittedChain(points[:1], np.zeros(1), one, ~one)


def _fit(error: FloatArray, bulges: FloatArray, matrix: FloatArray) -> OutlineFit:
    """error: distances of points, px."""
    size = scale_of(matrix) * np.abs(error)
    arcs = int((bulges != 0).sum())
    rms, most = (float(np.sqrt((size**2).mean())), float(size.max())) if len(size) else (0.0, 0.0)
    return OutlineFit(rms, most, len(bulges) - arcs, arcs)


def _circle(
    parts: Divided, mine: IntArray, points: ComplexArray, sigma: float, matrix: FloatArray
) -> _Found | None:
    """A whole circle as two arcs; None where the points are not on one, or not all around."""
    curve = parts.curves.take(mine)
    bend = float(curve.curvature[0])
    if bend == 0:
        return None
    centre = complex(curve.origin[0] - (curve.form[0, 1] + 1j * curve.form[0, 2]) / bend)
    error = curve.distances(points[None])[0]
    around = abs(float(np.ptp(np.unwrap(np.angle(points - centre)))))
    if around < np.pi or np.sqrt((error**2).mean()) > astray_beyond(sigma):
        return None
    corners = np.array([centre + 1 / abs(bend), centre - 1 / abs(bend)])
    shape = _in_work(corners, np.full(2, np.sign(bend)), matrix)
    return shape, _fit(error, shape[1], matrix)


def _chain(
    parts: Divided, mine: IntArray, points: ComplexArray, counts: BoolArray
) -> tuple[FittedChain, IntArray]:
    """Lines and arcs through the points of several runs, and which of them each point belongs to."""
    piece = np.repeat(np.arange(len(mine)), parts.runs.count[mine])
    curves = parts.curves.take(mine)
    corners, smooth = np.roll(parts.joints.vertex[mine], 1), np.roll(parts.joints.smooth[mine], 1)
    after = np.roll(corners, -1)
    turn = np.angle(tangents(curves, after) * tangents(curves, corners).conj())
    way = np.bincount(piece, np.append(np.abs(np.diff(points)), 0.0))
    # The directions at both ends tell the sweep but for whole turns.
    turn += 2 * np.pi * np.round((curves.curvature * way - turn) / (2 * np.pi))
    straight = curves.curvature == 0
    bulges = np.where(straight, 0.0, np.tan(turn.clip(-6.25, 6.25) / 4))
    return polish(
        FittedChain(corners, bulges, straight, smooth), points, piece, counts.astype(np.float64)
    ), piece


def _in_work(
    corners: ComplexArray, bulges: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) mm and bulges, the part on the left."""
    points = np.column_stack([corners.real, corners.imag]) @ matrix[:, :2].T + matrix[:, 2]
    if np.linalg.det(matrix[:, :2]) < 0:
        return frozen(points), frozen(0.0 - bulges)
    # Not mirrored, so the part is on the right: the other way round, which turns the bulges too.
    return frozen(points[::-1]), frozen(0.0 - np.roll(bulges[::-1], -1))
