"""Simplifies a drawing: thins out lines, fits arcs to borders of pictures, drops short contours.

A contour of lines and arcs differs from the contour that was read by at most `tolerance.simplify`,
in both directions. See continuous-path.md, section 3.3, steps 2 and 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import make_contour_segments
from camgen.geometry.thinning import Polylines, thin_chains
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part, count_arcs, tabulate_contours
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.plan.border_arcs import fit_arcs
from camgen.read import is_drawing
from camgen.vision.similarity import measure_scale

#: Default tolerance of a border, px. In a picture with two values the border may be half a pixel
#: off the edge that it shows, more at corners. Grey values locate it to a fraction of a pixel.
_PIXELS, _GREY_PIXELS = 1.0, 1 / 3
#: In a picture with two values at least this fraction of the border points lies on the half-pixel
#: grid, within a distance in px.
_TWO_VALUES, _ON_GRID = 0.9, 1e-3
#: Decimals of a pixel to which points are rounded, and the addition to the tolerance in px. With
#: both the result is the same at every scale.
_DIGITS, _SLACK = 6, 1e-6


def simplify(part: Part, job: Job) -> Part:
    """Apply `tolerance.simplify` and `input.min_length` to `part`, with a note on each."""
    raster = part.raster if is_drawing(job) else None
    tolerance = job.tolerance.simplify
    if tolerance is None and raster is not None:
        tolerance = _choose_tolerance(part.contours, raster.work_from_view)
    contours, notes = part.contours, list(part.notes)
    if job.input.min_length and contours:
        contours = _select_long(contours, job.input.min_length, notes)
    if tolerance and contours:
        before = len(tabulate_contours(contours).points)
        # A fill is planned on the pixels; its contours are only shown.
        is_fill = job.operation.kind == "fill"
        fits_arcs = raster is not None and job.tolerance.arc_fit > 0 and not is_fill
        contours = (
            thin_out(contours, tolerance, fits_arcs)
            if raster is None
            else _thin_in_pixels(contours, tolerance, fits_arcs, raster.work_from_view)
        )
        arcs = count_arcs(contours)
        lines = len(make_contour_segments(contours)) - arcs
        what = f"{counted(before, 'point')} thinned out to {counted(lines, 'line')}"
        what += f" and {counted(arcs, 'arc')}" if fits_arcs or arcs else ""
        notes.append(Note("assumed", what, f"within tolerance.simplify = {short(tolerance, 4)} mm"))
    return replace(part, contours=contours, notes=tuple(notes))


def _choose_tolerance(contours: Sequence[Contour], work_from_view: FloatArray) -> float:
    scale = measure_scale(work_from_view)
    if not contours:
        return _PIXELS * scale
    points = tabulate_contours(contours).points - work_from_view[:, 2]
    halves = 2 * points @ np.linalg.inv(work_from_view[:, :2]).T
    on_grid = (np.abs(halves - np.round(halves)) < _ON_GRID).all(axis=1).mean()
    return (_PIXELS if on_grid > _TWO_VALUES else _GREY_PIXELS) * scale


def _select_long(
    contours: Sequence[Contour], min_length: float, notes: list[Note]
) -> tuple[Contour, ...]:
    """The contours of at least `min_length` mm. Adds a note on the others to `notes`."""
    segments = make_contour_segments(contours)
    lengths = np.bincount(segments.owner, segments.length, minlength=len(contours))
    chosen = tuple(compress(contours, lengths >= min_length))
    if len(chosen) < len(contours):
        count = counted(len(contours) - len(chosen), "contour")
        notes.append(
            Note("skipped", f"{count} shorter than {short(min_length, 3)} mm", "input.min_length")
        )
    return chosen


def _thin_in_pixels(
    contours: Sequence[Contour], tolerance: float, fits_arcs: bool, work_from_view: FloatArray
) -> tuple[Contour, ...]:
    """`thin_out` in the pixels of the picture: the lines and arcs do not depend on the scale."""
    linear, shift = work_from_view[:, :2], work_from_view[:, 2]
    # Rounded far finer than the uncertainty of a pixel and far coarser than the last digits.
    inverse = np.linalg.inv(linear).T
    in_pixels = [
        replace(c, points=np.round((c.points - shift) @ inverse, _DIGITS)) for c in contours
    ]
    thinned = thin_out(in_pixels, tolerance / measure_scale(work_from_view) + _SLACK, fits_arcs)
    # The rows of a picture run down; seen from the other side, arcs bend the other way.
    side = np.sign(np.linalg.det(linear))
    return tuple(
        replace(c, points=frozen(c.points @ linear.T + shift), bulges=frozen(side * c.bulges + 0.0))
        for c in thinned
    )


def thin_out(contours: Sequence[Contour], tolerance: float, fits_arcs: bool) -> tuple[Contour, ...]:
    """The contours with the points that they need to stay within `tolerance` mm.

    fits_arcs: replace lines by arcs where these fit.
    """
    chains = Polylines.from_contours(contours)
    row = thin_chains(chains, tolerance)
    points, bulges = chains.points[row], chains.bulges[row]
    is_closed = tabulate_contours(contours).closed
    if fits_arcs:
        row, points, bulges = fit_arcs(chains, row, is_closed, tolerance)
    # The first point of a closed contour is repeated at its end.
    first = np.searchsorted(row, chains.first[:-1])
    end = np.searchsorted(row, chains.first[1:]) - is_closed.astype(np.int64)
    return tuple(
        replace(contour, points=frozen(points[a:b]), bulges=frozen(bulges[a:b]))
        for contour, a, b in zip(contours, first.tolist(), end.tolist(), strict=True)
    )
