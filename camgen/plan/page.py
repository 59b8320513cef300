"""[page]: a drawing centred on its paper, as large as it goes or at a given scale (continuous-path.md, section 3.2)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.segments import compute_bounds, from_contours
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job, PageTable
from camgen.model.page import page_size
from camgen.model.part import Contour, Note, Part, Raster
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.read.units import MM
from camgen.vision.similarity import measure_scale

#: A drawing may leave the page by so much, mm: rounding.
_ROUNDING = 1e-6


def on_page(part: Part, job: Job) -> Part:
    """``part`` scaled and centred on ``[page]``, the work frame at the page's lower left corner; as it is without one.

    JobError for a page that is none or a table without effect, InputError for a drawing that leaves the page.
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
    if not part.contours:
        return part
    low, high = _box(part)
    size = page_size(page)
    drawn = high - low
    room = np.array(size) - 2 * page.margin
    if room.min() <= 0:
        what = f"{page.margin:g} mm on each side leaves nothing of {_describe(size)}"
        raise JobError("job", what, "page.margin", "lower page.margin")
    ratio = _ratio(part, page, drawn, room)
    if (drawn * ratio > room + _ROUNDING).any():
        raise _leaves(part, page, size, drawn * ratio)
    return _lay(part, size, (low, high), ratio, ratio)


def in_margin(part: Part, laid: Part, drawn: Part, job: Job) -> Part:
    """``drawn``, what came of ``part`` when it was ``laid`` on the page, with its own box centred and as large as the
    page allows.

    Lines and arcs that are laid through the points of a drawing leave its box a little, to either side. What is filled
    or drilled is planned on the picture and not on them. InputError for a drawing with a scale that leaves the page.
    """
    page = job.page
    pixels = drawn.raster is not None and job.operation.kind in ("fill", "drill")
    if not page.size or not drawn.contours or drawn.contours is laid.contours or pixels:
        return drawn
    size = page_size(page)
    low, high = _box(drawn)
    room = np.array(size) - 2 * page.margin
    ratio = _ratio(drawn, page, high - low, room) if page.scale == "fit" else 1.0
    if ((high - low) * ratio > room + _ROUNDING).any():
        raise _leaves(drawn, page, size, high - low)
    own = float(np.ptp(_box(laid), axis=0).max() / np.ptp(_box(part), axis=0).max())
    kept = replace(drawn, notes=tuple(note for note in drawn.notes if note is not laid.notes[-1]))
    return _lay(kept, size, (low, high), ratio, own * ratio)


def _box(part: Part) -> tuple[FloatArray, FloatArray]:
    """Its lower left and upper right corner, mm."""
    box = compute_bounds(from_contours(part.contours))
    return box[:, :2].min(axis=0), box[:, 2:].max(axis=0)


def _lay(
    part: Part,
    size: tuple[float, float],
    box: tuple[FloatArray, FloatArray],
    ratio: float,
    in_all: float,
) -> Part:
    """``part`` times ``ratio``, the middle of its ``box`` in that of the page. in_all: the ratio to what was read."""
    low, high = box
    shift = np.array(size) / 2 - ratio * (low + high) / 2
    pixels = part.raster is not None
    unit = (ratio if pixels else in_all) * _unit(part)
    told = f"1 {'px' if pixels else 'unit'} = {short(unit, 5)} mm, drawing {_describe((high - low) * ratio)}"
    note = Note(
        "assumed",
        f"centred on a page of {_describe(size)}: {told}",
        f"the drawing's own size times {in_all:.6g}",
    )
    return replace(
        part,
        contours=_move(part.contours, ratio, shift),
        raster=None if part.raster is None else _move_raster(part.raster, ratio, shift),
        units=f"{short(unit, 5)} mm/px" if pixels else part.units,
        notes=(*part.notes, note),
    )


def _ratio(part: Part, page: PageTable, drawn: FloatArray, room: FloatArray) -> float:
    """The factor on the part: the smaller of the two ratios to fit, or what the job says."""
    if page.scale == "true":
        return 1.0
    if page.scale != "fit":
        return float(page.scale) / _unit(part)
    # A drawing without height, a single line, is limited by its width alone.
    ratios = [r / d for r, d in zip(room.tolist(), drawn.tolist(), strict=True) if d > 0]
    if not ratios:
        remedy = 'set page.scale to "true" or to mm per unit'
        what = "the drawing has no size that could fit the page"
        raise InputError(part.source, what, "page.scale", remedy)
    return float(min(ratios))


def _unit(part: Part) -> float:
    """The mm of one unit or pixel of the input, in the part as it is."""
    if part.raster is not None:
        return measure_scale(part.raster.work_from_view)
    units = set(part.units.split(" + "))
    if len(units) == 1:
        name = units.pop()
        number = re.match(r"[\d.]+(?:e-?\d+)?(?= mm/)", name)
        if name in MM or number:
            return float(number[0]) if number else MM[name]
    remedy = 'set page.scale to "fit" or "true"'
    raise JobError(
        "job", f"a scale per unit does not go with units {part.units}", "page.scale", remedy
    )


def _leaves(
    part: Part, page: PageTable, size: tuple[float, float], drawn: FloatArray
) -> InputError:
    what = f"the drawing is {_describe(drawn)}, the page {_describe(size)} with a margin of {short(page.margin, 3)} mm"
    return InputError(
        part.source,
        f"leaves the page: {what}",
        "page.scale",
        'set page.scale to "fit" or a larger page',
    )


def _describe(size: Sequence[float] | FloatArray) -> str:
    return " x ".join(short(float(v), 2) for v in size) + " mm"


def _move(contours: Sequence[Contour], ratio: float, shift: FloatArray) -> tuple[Contour, ...]:
    """All contours times ``ratio`` plus ``shift``: shapes stay, hence bulges too."""
    points = np.concatenate([c.points for c in contours])
    points = points * ratio + shift
    points.flags.writeable = False
    ends = np.cumsum([0, *(len(c.points) for c in contours)]).tolist()
    return tuple(
        replace(c, points=points[a:b]) for c, (a, b) in zip(contours, pairwise(ends), strict=True)
    )


def _move_raster(raster: Raster, ratio: float, shift: FloatArray) -> Raster:
    matrix = raster.work_from_view * ratio
    matrix[:, 2] += shift
    if not math.isfinite(float(matrix.sum())):
        remedy = "set page.scale to mm per pixel"
        raise InputError("picture", "has no finite scale on this page", "page.scale", remedy)
    return replace(raster, work_from_view=frozen(matrix))


# What would be drawn of a picture, for ``camgen inspect``: strokes, scale and size on the page.


class DrawingFacts(Struct, frozen=True):
    """What a picture is as a drawing; its ``str`` is a page to print. Lengths mm. lines, arcs: of all strokes.

    use: what is done with them, "" where they are drawn.
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
        width, height = (short(v, 2) for v in self.drawn)
        what = "borders of the ink" if self.use else "strokes"
        lines = [
            f"picture of {self.size[0]} x {self.size[1]} px, taken as a drawing",
            f"scale: {self.scale}, drawing {width} x {height} mm",
            f"{what}: {self.strokes}, all closed, of {counted(self.lines, 'line')} and {counted(self.arcs, 'arc')}; "
            f"{short(self.length, 1)} mm in all, the shortest {short(self.shortest, 2)} mm",
            *([self.use] if self.use else []),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


def inspect(raw: Part, job: Job) -> DrawingFacts:
    """What ``job`` makes of a picture that was read as a drawing. Errors as of a build."""
    from camgen.plan.simplify import simplify  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    assert raw.raster is not None
    laid = on_page(raw, job)
    part = in_margin(raw, laid, simplify(laid, job), job)
    segments = from_contours(part.contours)
    box = compute_bounds(segments)
    lengths = np.bincount(segments.owner, segments.length, minlength=len(part.contours))
    arcs = sum(int((c.bulges != 0).sum()) for c in part.contours)
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
        use=_use(job),
        notes=part.notes,
    )


def _use(job: Job) -> str:
    if job.operation.kind == "fill":
        return f"filled with a pen of {short(job.tool.diameter, 3)} mm (tool.diameter)"
    return "drilled at marks and rings; build says which" if job.operation.kind == "drill" else ""
