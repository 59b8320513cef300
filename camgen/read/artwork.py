"""Reads a black and white drawing that is traced, filled or drilled (continuous-path.md, 3).

The contours are the borders of the ink, one point per pixel, or the middles of thin lines and
letters. `plan/simplify` turns them into lines and arcs when their size on the page is known.
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
    """The ink in a picture as contours, with a point per pixel and lines between them.

    Raises InputError if the picture has no ink or no scale, and JobError for a setting that has no
    effect on a drawing.
    """
    _check_no_photo_settings(job)
    picture = read_picture(source)
    view = _scale(picture, job)
    threshold = job.image.threshold
    ink = find_ink(picture.pixels, threshold, job.image.invert)
    if ink is None:
        what = "has no ink: it is of one grey value"
        if threshold is not None:
            what += f" beside {short(threshold, 1)}"
        raise InputError(source.name, what, remedy="draw dark on light, or set [image] threshold")
    ink_borders = trace_borders(ink)
    # The borders count pixels with a frame of paper around the picture, which is pixel (0, 0).
    matrix = np.column_stack([view.work_from_view[:, :2], view.work_from_view @ (-1.0, -1.0, 1.0)])
    contours, line_notes = _make_contours(ink, ink_borders, matrix, job)
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
        borders=tuple(frozen(border) for border in ink_borders),
    )
    ink_note = Note("assumed", f"ink separated from paper by {ink.why}", "image.invert swaps them")
    return Part(
        source.stem,
        source.name,
        f"{short(view.mm_per_px, 5)} mm/px",
        contours,
        (*picture.notes, *view.notes, ink_note, *line_notes),
        raster,
    )


def _make_contours(
    ink: Ink, ink_borders: list[FloatArray], matrix: FloatArray, job: Job
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The borders as contours. In a drawing that is traced, thin lines become their middles.

    matrix: (2, 3) from pixels to mm in the work frame.
    """
    lines = [(border, True) for border in ink_borders]
    notes: tuple[Note, ...] = ()
    if job.operation.kind == "trace" and job.image.lines != "border":
        pieces = divide_ink(ink, job.image.lines == "centre")
        middles, is_thin = find_centre_lines(pieces)
        lines = [line for line in lines if not is_thin[find_piece(line[0], pieces)]]
        lines += middles
        if is_thin.any():
            count = int(is_thin.sum())
            others = len(is_thin) - 1 - count
            what = f"{counted(count, 'piece')} of ink drawn once, along the middle"
            if others:
                what += f", {counted(others, 'piece')} along the border"
            why = f'image.lines = "{job.image.lines}"; "border" draws both sides'
            notes = (Note("assumed", what, why),)
    contours = []
    for number, (points, closed) in enumerate(lines, 1):
        placed = frozen(points @ matrix[:, :2].T + matrix[:, 2])
        contours.append(Contour(placed, frozen(np.zeros(len(placed))), closed, "0", f"c{number}"))
    return tuple(contours), notes


def _scale(picture: Picture, job: Job) -> ScaledView:
    """The picture with its scale. On a page that sets the scale itself a pixel is 1 mm for now.

    Raises JobError if the job gives a scale that the page replaces.
    """
    image = job.image
    if not job.page.size or job.page.scale == "true":
        return make_scaled_view(picture, image.mm_per_px, image.width_mm)
    if image.mm_per_px is not None or image.width_mm is not None:
        raise JobError(
            "[image]",
            f"mm_per_px and width_mm have no effect: page.scale = {job.page.scale} gives the scale",
            remedy='use page.scale = "true"',
        )
    return ScaledView(picture.pixels, make_scaled_view(picture, 1.0).work_from_view, 1.0)


def _check_no_photo_settings(job: Job) -> None:
    default = ImageTable()
    for key in ("region", "tones", "background", "lamp_moved", "color", "min_area"):
        if getattr(job.image, key) != getattr(default, key):
            raise JobError(
                f"[image] {key}",
                "has no effect on a drawing that is traced, filled or drilled",
                remedy="leave it out; input.min_length drops what is small",
            )
    if job.image.lines != default.lines and job.operation.kind != "trace":
        raise JobError(
            "[image] lines", "has no effect on a drawing that is not traced", remedy="leave it out"
        )
