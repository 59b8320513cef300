"""Places a drawing on its page, `[page]`: centred, as large as it fits or at a given scale.

See continuous-path.md, section 3.2.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import compute_offsets
from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job, PageTable
from camgen.model.page import compute_page_size
from camgen.model.part import Contour, Note, Part, Raster, count_arcs, tabulate_contours
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.read.units import MM
from camgen.vision.similarity import measure_scale

#: Length by which a drawing may leave the page, mm: rounding.
_ROUNDING = 1e-6


def place_on_page(part: Part, job: Job) -> Part:
    """Scale `part` and centre it on `[page]`, whose lower left corner is the work frame.

    Without a page the part is returned unchanged. Raises JobError for an invalid page or a table
    without effect, and InputError for a drawing that leaves the page.
    """
    page = job.page
    if not page.size:
        if page != PageTable():
            raise JobError(
                "job",
                "[page] has no effect without a size",
                "page.size",
                'set page.size, for example "A4"',
            )
        return part
    if part.solid is not None:
        raise JobError(
            "job", "a page is for drawings, and this is a 3-D part", "page.size", "leave [page] out"
        )
    return _place_part(part, page, 1.0) if part.contours else part


def fit_to_page(part: Part, placed: Part, simplified: Part, job: Job) -> Part:
    """Centre `simplified` by its own box and, for the scale "fit", scale it to the page again.

    part: the part as it was read.
    placed: `part` on its page.
    simplified: `placed` as lines and arcs, whose box differs slightly from that of the points.
    Fill and drill work on the pixels of a picture, so such a part is returned unchanged. Raises
    InputError for a drawing of a given scale that leaves the page.
    """
    page = job.page
    on_pixels = simplified.raster is not None and job.operation.kind in ("fill", "drill")
    is_same = simplified.contours is placed.contours
    if not page.size or not simplified.contours or is_same or on_pixels:
        return simplified
    if page.scale != "fit":
        page = replace(page, scale="true")  # the scale is that of the first placement
    placed_extent = np.ptp(_measure_box(placed), axis=0).max()
    placed_ratio = float(placed_extent / np.ptp(_measure_box(part), axis=0).max())
    # The note of the first placement is replaced by that of the second one.
    notes = tuple(note for note in simplified.notes if note is not placed.notes[-1])
    return _place_part(replace(simplified, notes=notes), page, placed_ratio)


def _measure_box(part: Part) -> tuple[FloatArray, FloatArray]:
    box = compute_bounds(make_contour_segments(part.contours))
    return box[:, :2].min(axis=0), box[:, 2:].max(axis=0)


def _place_part(part: Part, page: PageTable, placed_ratio: float) -> Part:
    """Scale `part` as `page.scale` states and centre it on the page, with a note.

    placed_ratio: ratio of `part` to the part as it was read.
    """
    size = compute_page_size(page)
    low, high = _measure_box(part)
    extent = high - low
    room = np.array(size) - 2 * page.margin
    if room.min() <= 0:
        raise JobError(
            "job",
            f"{page.margin:g} mm on each side leaves nothing of {_format_size(size)}",
            "page.margin",
            "lower page.margin",
        )
    ratio = _compute_ratio(part, page, extent, room)
    if (extent * ratio > room + _ROUNDING).any():
        margin = f"with a margin of {short(page.margin, 3)} mm"
        raise InputError(
            part.source,
            f"leaves the page: the drawing is {_format_size(extent * ratio)}, "
            f"the page {_format_size(size)} {margin}",
            "page.scale",
            'set page.scale to "fit" or a larger page',
        )
    input_ratio = placed_ratio * ratio
    shift = np.array(size) / 2 - ratio * (low + high) / 2
    has_pixels = part.raster is not None
    unit = (ratio if has_pixels else input_ratio) * _measure_unit(part)
    name = "px" if has_pixels else "unit"
    scale = f"1 {name} = {short(unit, 5)} mm, drawing {_format_size(extent * ratio)}"
    note = Note(
        "assumed",
        f"centred on a page of {_format_size(size)}: {scale}",
        f"the drawing's own size times {input_ratio:.6g}",
    )
    return replace(
        part,
        contours=_move_contours(part.contours, ratio, shift),
        raster=None if part.raster is None else _move_raster(part.raster, ratio, shift),
        units=f"{short(unit, 5)} mm/px" if has_pixels else part.units,
        notes=(*part.notes, note),
    )


def _compute_ratio(part: Part, page: PageTable, extent: FloatArray, room: FloatArray) -> float:
    """The scale factor of the part, from `page.scale`.

    extent, room: (2,) width and height of the drawing and of the page within its margins, mm.
    """
    if page.scale == "true":
        return 1.0
    if page.scale != "fit":
        return float(page.scale) / _measure_unit(part)
    # A drawing without height, a single line, is limited by its width alone.
    ratios = room[extent > 0] / extent[extent > 0]
    if not len(ratios):
        raise InputError(
            part.source,
            "the drawing has no size that could fit the page",
            "page.scale",
            'set page.scale to "true" or to mm per unit',
        )
    return float(ratios.min())


def _measure_unit(part: Part) -> float:
    """Length of one unit or pixel of the input in the part, mm. JobError for mixed units."""
    if part.raster is not None:
        return measure_scale(part.raster.work_from_view)
    units = set(part.units.split(" + "))
    if len(units) == 1:
        name = units.pop()
        number = re.match(r"[\d.]+(?:e-?\d+)?(?= mm/)", name)
        if name in MM or number:
            return float(number[0]) if number else MM[name]
    raise JobError(
        "job",
        f"a scale per unit does not go with units {part.units}",
        "page.scale",
        'set page.scale to "fit" or "true"',
    )


def _format_size(size: Sequence[float] | FloatArray) -> str:
    return " x ".join(short(float(v), 2) for v in size) + " mm"


def _move_contours(
    contours: Sequence[Contour], ratio: float, shift: FloatArray
) -> tuple[Contour, ...]:
    points, _, counts, _ = tabulate_contours(contours)
    points = points * ratio + shift
    points.flags.writeable = False
    ends = compute_offsets(counts).tolist()
    return tuple(
        replace(c, points=points[a:b]) for c, (a, b) in zip(contours, pairwise(ends), strict=True)
    )


def _move_raster(raster: Raster, ratio: float, shift: FloatArray) -> Raster:
    matrix = raster.work_from_view * ratio
    matrix[:, 2] += shift
    if not math.isfinite(float(matrix.sum())):
        raise InputError(
            "picture",
            "has no finite scale on this page",
            "page.scale",
            "set page.scale to mm per pixel",
        )
    return replace(raster, work_from_view=frozen(matrix))


# Facts about a picture that is read as a drawing, for `camgen inspect`.


class DrawingFacts(Struct, frozen=True):
    """A picture as a drawing; its `str` is printed by `camgen inspect`.

    size: width and height of the picture, px.
    scale: mm per pixel, as text.
    strokes: number of closed contours.
    lines, arcs: number of lines and of arcs in all strokes.
    length: total length, mm.
    shortest: length of the shortest stroke, mm.
    drawn: width and height on the page, mm.
    use: use of the contours if they are not drawn, otherwise "".
    notes: messages of the reader and of the planner.
    """

    size: tuple[int, int]
    scale: str
    strokes: int
    lines: int
    arcs: int
    length: float
    shortest: float
    drawn: tuple[float, float]
    use: str
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        name = "borders of the ink" if self.use else "strokes"
        segments = f"{counted(self.lines, 'line')} and {counted(self.arcs, 'arc')}"
        lines = [
            f"picture of {self.size[0]} x {self.size[1]} px, taken as a drawing",
            f"scale: {self.scale}, drawing {_format_size(self.drawn)}",
            f"{name}: {self.strokes}, all closed, of {segments}; "
            f"{short(self.length, 1)} mm in all, the shortest {short(self.shortest, 2)} mm",
            *([self.use] if self.use else []),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


def inspect(raw: Part, job: Job) -> DrawingFacts:
    """The facts about a picture that was read as a drawing, with the settings of `job`.

    Raises the errors that a build raises.
    """
    from camgen.plan.simplify import simplify  # noqa: PLC0415 (it loads OpenCV)

    assert raw.raster is not None
    placed = place_on_page(raw, job)
    part = fit_to_page(raw, placed, simplify(placed, job), job)
    segments = make_contour_segments(part.contours)
    box = compute_bounds(segments)
    lengths = np.bincount(segments.owner, segments.length, minlength=len(part.contours))
    arcs = count_arcs(part.contours)
    extent = (box[:, 2:].max(axis=0) - box[:, :2].min(axis=0)).tolist() if len(box) else [0.0, 0.0]
    height, width = raw.raster.photo.shape[:2]
    return DrawingFacts(
        size=(width, height),
        scale=part.units,
        strokes=len(part.contours),
        lines=len(segments.length) - arcs,
        arcs=arcs,
        length=float(lengths.sum()),
        shortest=float(lengths.min(initial=np.inf)) if len(lengths) else 0.0,
        drawn=(extent[0], extent[1]),
        use=_format_use(job),
        notes=part.notes,
    )


def _format_use(job: Job) -> str:
    if job.operation.kind == "fill":
        return f"filled with a pen of {short(job.tool.diameter, 3)} mm (tool.diameter)"
    return "drilled at marks and rings; build says which" if job.operation.kind == "drill" else ""
