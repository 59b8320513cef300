"""Drawings in black and white, to be traced, filled or drilled: the borders of the ink, point by point
(continuous-path.md, 3), and where thin lines and lettering are traced their middles.

``plan/simplify`` makes lines and arcs of them once the size on the page is known.
"""

from __future__ import annotations

import numpy as np

from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.job import ImageTable, Job
from camgen.model.part import Contour, Note, Part, Raster
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.vision.centre import divide_ink, find_centre_lines, find_piece
from camgen.vision.image import Picture, read_picture
from camgen.vision.ink import Ink, find_ink, trace_borders
from camgen.vision.to_scale import ScaledView, make_scaled_view


def read(source: Source, job: Job, _files: Files) -> Part:
    """The ink in the picture ``source``: contours of one point per pixel of border or middle, lines between them.

    InputError if the picture has no ink or no scale, JobError for settings that a drawing has no use for.
    """
    _nothing_unused(job)
    picture = read_picture(source)
    view = _view(picture, job)
    threshold = job.image.threshold
    ink = find_ink(picture.pixels, threshold, job.image.invert)
    if ink is None:
        what = "has no ink: it is of one grey value" + (
            "" if threshold is None else f" beside {short(threshold, 1)}"
        )
        raise InputError(source.name, what, remedy="draw dark on light, or set [image] threshold")
    found = trace_borders(ink)
    # Pixel (0, 0) of what was found is the paper around the picture.
    matrix = np.column_stack([view.work_from_view[:, :2], view.work_from_view @ (-1.0, -1.0, 1.0)])
    contours, told = _contours(ink, found, matrix, job)
    height, width = picture.pixels.shape[:2]
    mask = ink.pixels.view(np.uint8) * np.uint8(255)
    grey = np.clip(ink.grey, 0, 255).astype(np.uint8)
    for array in (mask, grey):
        array.flags.writeable = False
    raster = Raster(
        photo=picture.pixels,
        framed=frozen([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]]),
        view=grey,
        work_from_view=frozen(matrix),
        mask=mask,
        borders=tuple(frozen(border) for border in found),
    )
    notes = (
        *picture.notes,
        *view.notes,
        Note("assumed", f"ink told from paper by {ink.why}", "image.invert swaps them"),
        *told,
    )
    return Part(
        source.stem, source.name, f"{short(view.mm_per_px, 5)} mm/px", contours, notes, raster
    )


def _contours(
    ink: Ink, found: list[FloatArray], matrix: FloatArray, job: Job
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The borders ``found``, and instead of those of thin lines their middles, if the drawing is traced."""
    drawn = [(border, True) for border in found]
    notes: tuple[Note, ...] = ()
    if job.operation.kind == "trace" and job.image.lines != "border":
        pieces = divide_ink(ink, job.image.lines == "centre")
        middles, once = find_centre_lines(pieces)
        drawn = [(border, True) for border in found if not once[find_piece(border, pieces)]]
        drawn += [(middle.points, middle.closed) for middle in middles]
        if once.any():
            what = f"{counted(int(once.sum()), 'piece')} of ink drawn once, along the middle"
            rest = len(once) - 1 - int(once.sum())
            what += f", {counted(rest, 'piece')} along the border" if rest else ""
            notes = (
                Note(
                    "assumed", what, f'image.lines = "{job.image.lines}"; "border" draws both sides'
                ),
            )
    contours = []
    for k, (points, closed) in enumerate(drawn, 1):
        placed = frozen(points @ matrix[:, :2].T + matrix[:, 2])
        contours.append(Contour(placed, frozen(np.zeros(len(placed))), closed, "0", f"c{k}"))
    return tuple(contours), notes


def _view(picture: Picture, job: Job) -> ScaledView:
    """To scale; on a page whose scale is not the picture's own a pixel counts as 1 mm until it is laid there."""
    image = job.image
    given = image.mm_per_px is not None or image.width_mm is not None
    if job.page.size and job.page.scale != "true":
        if given:
            what = f"page.scale = {job.page.scale} gives the scale"
            raise JobError(
                "[image]",
                f"mm_per_px and width_mm have no effect: {what}",
                remedy='use page.scale = "true"',
            )
        return ScaledView(picture.pixels, make_scaled_view(picture, 1.0).work_from_view, 1.0)
    return make_scaled_view(picture, image.mm_per_px, image.width_mm)


def _nothing_unused(job: Job) -> None:
    """JobError for a setting of photos: the user believes that it does something."""
    default = ImageTable()
    for key in ("region", "tones", "background", "lamp_moved", "color", "min_area"):
        if getattr(job.image, key) != getattr(default, key):
            remedy = "leave it out; input.min_length drops what is small"
            what = "has no effect on a drawing that is traced, filled or drilled"
            raise JobError(f"[image] {key}", what, remedy=remedy)
    if job.image.lines != default.lines and job.operation.kind != "trace":
        raise JobError(
            "[image] lines", "has no effect on a drawing that is not traced", remedy="leave it out"
        )
