"""Fewer points for the same drawing: lines thinned out, arcs found in the borders of pictures, short pieces dropped.

continuous-path.md, section 3.3, steps 2 and 3. A contour of lines and arcs leaves what was read by at most
``tolerance.simplify``, in both directions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.segments import from_contours
from camgen.geometry.thinning import Polylines, thin_chains
from camgen.model.job import Job
from camgen.model.part import Contour, Note, Part
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.plan.border_arcs import with_arcs
from camgen.read import is_drawing
from camgen.vision.similarity import measure_scale

#: Of a picture in two values the border lies up to half a pixel beside the line that it shows, and a little more where
#: it turns. Grey values along the border tell where it is to a small part of a pixel.
_PIXELS, _GREY_PIXELS = 1.0, 1 / 3
#: The border of a picture in two values runs over middles of pixels and of their sides: so many of its points, px.
_TWO_VALUES, _ON_GRID = 0.9, 1e-3
#: Digits of a pixel that count, and what is added to the tolerance so that the same one is the same at every scale, px.
_DIGITS, _SLACK = 6, 1e-6


def simplify(part: Part, job: Job) -> Part:
    """``part`` with ``tolerance.simplify`` and ``input.min_length`` applied, and a note on each."""
    artwork = part.raster is not None and is_drawing(job)
    tolerance = job.tolerance.simplify
    if tolerance is None:
        tolerance = (
            _of_pixels(part.contours, part.raster.work_from_view)
            if part.raster is not None and artwork
            else 0.0
        )
    contours, notes = part.contours, list(part.notes)
    if job.input.min_length and contours:
        contours = _long_enough(contours, job.input.min_length, notes)
    if tolerance and contours:
        before = sum(len(c.points) for c in contours)
        # A fill is planned on the pixels; its contours are only shown.
        arcs_wanted = artwork and job.tolerance.arc_fit > 0 and job.operation.kind != "fill"
        if part.raster is not None and artwork:
            contours = _thin_in_pixels(contours, tolerance, arcs_wanted, part.raster.work_from_view)
        else:
            contours = thin_out(contours, tolerance, arcs_wanted)
        count, arcs = (
            sum(len(c.points) for c in contours),
            sum(int((c.bulges != 0).sum()) for c in contours),
        )
        lines = count - sum(not c.closed for c in contours) - arcs
        what = f"{counted(before, 'point')} thinned out to {counted(lines, 'line')}"
        what += f" and {counted(arcs, 'arc')}" if arcs_wanted or arcs else ""
        notes.append(Note("assumed", what, f"within tolerance.simplify = {short(tolerance, 4)} mm"))
    return replace(part, contours=contours, notes=tuple(notes))


def _of_pixels(contours: Sequence[Contour], work_from_view: FloatArray) -> float:
    """How far the border of a picture may be left, mm: by what its pixels do not tell."""
    scale = measure_scale(work_from_view)
    if not contours:
        return _PIXELS * scale
    points = np.concatenate([c.points for c in contours]) - work_from_view[:, 2]
    halves = 2 * points @ np.linalg.inv(work_from_view[:, :2]).T
    on_grid = (np.abs(halves - np.round(halves)) < _ON_GRID).all(axis=1).mean()
    return (_PIXELS if on_grid > _TWO_VALUES else _GREY_PIXELS) * scale


def _long_enough(
    contours: Sequence[Contour], least: float, notes: list[Note]
) -> tuple[Contour, ...]:
    segments = from_contours(contours)
    lengths = np.bincount(segments.owner, segments.length, minlength=len(contours))
    kept = tuple(c for c, length in zip(contours, lengths.tolist(), strict=True) if length >= least)
    if len(kept) < len(contours):
        what = f"{counted(len(contours) - len(kept), 'contour')} shorter than {short(least, 3)} mm"
        notes.append(Note("skipped", what, "input.min_length"))
    return kept


def _thin_in_pixels(
    contours: Sequence[Contour], tolerance: float, arcs: bool, work_from_view: FloatArray
) -> tuple[Contour, ...]:
    """The same for borders of pixels, in pixels: the drawing at another scale gets the same lines and arcs."""
    turned, shift, scale = (
        work_from_view[:, :2],
        work_from_view[:, 2],
        measure_scale(work_from_view),
    )
    # Far below what a pixel tells, and far above what the scale leaves in the last digits.
    grid = [np.round((c.points - shift) @ np.linalg.inv(turned).T, _DIGITS) for c in contours]
    drawn = thin_out(
        [replace(c, points=g) for c, g in zip(contours, grid, strict=True)],
        tolerance / scale + _SLACK,
        arcs,
    )
    # A picture's rows run down: seen from the other side arcs bend the other way.
    side = np.sign(np.linalg.det(turned))
    return tuple(
        replace(c, points=frozen(c.points @ turned.T + shift), bulges=frozen(side * c.bulges + 0.0))
        for c in drawn
    )


def thin_out(contours: Sequence[Contour], tolerance: float, arcs: bool) -> tuple[Contour, ...]:
    """The contours with the points that they need to stay within ``tolerance``; arcs: those of them that are found."""
    chains = Polylines.from_contours(contours)
    kept = thin_chains(chains, tolerance)
    row, points, bulges = kept, chains.points[kept], chains.bulges[kept]
    if arcs:
        row, points, bulges = with_arcs(
            chains, kept, np.array([c.closed for c in contours]), tolerance
        )
    # A closed one ends with its first point again.
    last = np.searchsorted(row, chains.first[1:])
    first, end = np.searchsorted(row, chains.first[:-1]), last - [c.closed for c in contours]
    return tuple(
        replace(c, points=frozen(points[a:b]), bulges=frozen(bulges[a:b]))
        for c, a, b in zip(contours, first.tolist(), end.tolist(), strict=True)
    )
