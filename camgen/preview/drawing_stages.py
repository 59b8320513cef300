"""The way from a picture to a drawing as one SVG file: the stages side by side (continuous-path.md, figures 4-7, 9-11).

Picture, ink, borders, then lines and arcs, or the lines of the pen in its width and what they cover, and the strokes on
the page in the order in which they were found, and in that in which they are run.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from camgen.model.job import Job
from camgen.model.page import page_size
from camgen.model.part import Note, Part, Raster
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.order.arrange import measure_travel
from camgen.plan.fill.cover import coverage_map
from camgen.preview import Built
from camgen.preview.draw import Paper, by_order, of_contours, of_paths, path_data, spots
from camgen.preview.panels import (
    WIDE,
    Crop,
    Panel,
    faint,
    image,
    line,
    make_crop,
    on_panel,
    sheet,
    show_crop,
)

#: Radius of the points, and width of the drawn lines, page mm. Colours from the first stroke to the last.
_DOT, _STROKE, _BINS = 0.55, 0.45, 32
#: px of the map of what is covered, along its longer side.
_MAP = 1000


def svg(result: Built, raster: Raster, title: str) -> str:
    """The picture as SVG text, sized in mm. ``raster``: of the drawing."""
    part, tour, notes, job = result.part, result.tour, result.notes, result.job
    crop = make_crop(raster)
    height, width = raster.photo.shape[:2]
    points = counted(sum(len(border) for border in raster.borders), "point")
    high = WIDE * height / width
    fill = job.operation.kind == "fill"
    drawn = _fill(part, raster, tour, notes, job, crop) if fill else [_simplify(part, raster, crop)]
    panels = [
        Panel(f"picture, {width} x {height} px", high, [image(raster.photo, WIDE, high)]),
        Panel("ink", crop.high, [show_crop(crop, np.bitwise_not(raster.mask), smooth=False)]),
        Panel(
            f"borders of the ink, {points}",
            crop.high,
            [faint(raster, crop), _borders(raster, crop)],
        ),
        *drawn,
        _order(raster, result.planned, measure_travel(result.planned, None), "as found", job),
        _order(raster, tour.paths, tour.travel, "by order", job),
    ]
    return sheet(panels, notes, title)


def _borders(raster: Raster, crop: Crop) -> str:
    page = on_panel(raster, crop)
    matrix = raster.work_from_view
    data = "".join(
        line(page.place(b @ matrix[:, :2].T + matrix[:, 2])) + "Z" for b in raster.borders
    )
    return f'<path class="part" d="{data}"/>'


def _simplify(part: Part, raster: Raster, crop: Crop) -> Panel:
    """Lines and arcs with their points, which are the starts of segments."""
    page = on_panel(raster, crop)
    rows = [np.zeros((0, 2)), *(c.points for c in part.contours)]
    dots = page.place(np.concatenate(rows))
    arcs = sum(int((c.bulges != 0).sum()) for c in part.contours)
    # A point is a line without length and round ends: one element for all of them.
    data = "".join(f"M{x:.2f} {y:.2f}h0" for x, y in dots.tolist())
    return Panel(
        f"lines and {counted(arcs, 'arc')}, {counted(len(dots), 'point')}",
        crop.high,
        [
            faint(raster, crop),
            f'<path class="part" d="{"".join(path_data(of_contours(part.contours), page))}"/>',
            f'<path class="dot" stroke-width="{2 * _DOT}" d="{data}"/>',
        ],
    )


def _fill(
    part: Part, raster: Raster, tour: Tour, notes: tuple[Note, ...], job: Job, crop: Crop
) -> list[Panel]:
    """What the pen draws, and what of that is where it should be."""
    found = coverage_map(part, tour.paths, job.tool.diameter, _MAP)
    height, width = found.pixels.shape[:2]
    ends = found.work_from_map @ np.array([[-0.5, width - 0.5], [-0.5, height - 0.5], [1.0, 1.0]])
    (left, right), (top, bottom) = on_panel(raster, crop).place(ends.T).T.tolist()
    picture = image(found.pixels, right - left, bottom - top, smooth=False)
    content = [f'<g transform="translate({left:.2f} {top:.2f})">{picture}</g>']
    red = spots(notes, on_panel(raster, crop), job.tool.radius)
    content += red
    told = "green: covered, red: bare, yellow: ink outside" + (
        ", ring: not as drawn" if red else ""
    )
    return [_draw_covered(raster, tour, job, crop), Panel(told, crop.high, content)]


def _draw_covered(raster: Raster, tour: Tour, job: Job, crop: Crop) -> Panel:
    """What the pen inks, in its width, over the ink that was asked for."""
    width = job.tool.diameter * crop.scale
    data = "".join(path_data(of_paths(tour.paths), on_panel(raster, crop)))
    return Panel(
        f"lines of a pen of {short(job.tool.diameter, 3)} mm",
        crop.high,
        [
            faint(raster, crop),
            f'<path class="ink" stroke-width="{width:.2f}" d="{data}"/>',
            f'<path class="dot" stroke-width="0.2" d="{data}"/>',
        ],
    )


def _order(raster: Raster, paths: tuple[ToolPath, ...], travel: float, how: str, job: Job) -> Panel:
    """The page with the strokes in colour from first to last, and between them the ``travel`` mm with the pen up."""
    if job.page.size:
        width, height = page_size(job.page)
        corner = (0.0, 0.0)
    else:
        # Without a page the picture is one.
        rows, columns = raster.mask.shape
        ends = raster.work_from_view @ np.array(
            [[-0.5, columns - 0.5], [rows - 0.5, -0.5], [1.0, 1.0]]
        )
        (x0, x1), (y0, y1) = ends.tolist()
        width, height, corner = x1 - x0, y1 - y0, (x0, y0)
    scale = WIDE / width
    page = Paper(scale, -corner[0] * scale, (corner[1] + height) * scale)
    content = [
        f'<rect class="sheet" width="{WIDE}" height="{height * scale:.2f}"/>',
        *_strokes(paths, page),
    ]
    count = (
        f"{len(paths)} {'holes, travel' if job.operation.kind == 'drill' else 'strokes, pen up'}"
    )
    told = f"{short(width, 1)} x {short(height, 1)} mm: {count} {short(travel, 1)} mm, {how}"
    return Panel(told, height * scale, content)


def _strokes(paths: tuple[ToolPath, ...], page: Paper) -> Iterator[str]:
    data = path_data(of_paths(paths), page)
    edges = np.unique(np.linspace(0, len(data), _BINS + 1).astype(int)).tolist()
    for a, b in pairwise(edges):
        yield f'<path stroke="{by_order(a, len(data))}" stroke-width="{_STROKE}" d="{"".join(data[a:b])}"/>'
    # A hole is a point.
    points = [k for k, path in enumerate(paths) if not np.ptp(path.position[:, :2], axis=0).any()]
    for k in points:
        x, y = page.place(paths[k].position[:1])[0].tolist()
        colour = by_order(k, len(data))
        yield f'<path stroke="{colour}" stroke-width="{4 * _STROKE}" d="M{x:.2f} {y:.2f}h0"/>'
    gaps = pairwise(paths)
    ups: list[FloatArray] = [page.place(np.stack([a.position[-1], b.position[0]])) for a, b in gaps]
    if ups:
        yield f'<path class="up" d="{"".join(map(line, ups))}"/>'
