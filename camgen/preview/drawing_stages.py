"""The stages from a picture to its strokes, side by side in one SVG file.

The stages are the picture, its ink and the borders of the ink. Then come lines and arcs, or the
lines of the pen in its width and the ink that they cover. The last two are the strokes on the page
in the order in which they were found and in which they are run (continuous-path.md, figures 4-7,
9-11).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from camgen.model.job import Job
from camgen.model.page import compute_page_size
from camgen.model.part import Part, Raster
from camgen.model.path import ToolPath, Tour
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.order.arrange import measure_travel
from camgen.plan.fill.cover import make_coverage_map
from camgen.preview import Built
from camgen.preview.draw import (
    Paper,
    choose_colour,
    draw_places,
    format_path_data,
    join_path_data,
    make_contour_chains,
    make_path_chains,
)
from camgen.preview.panels import (
    WIDE,
    Crop,
    Panel,
    format_background,
    format_crop,
    format_image,
    format_line,
    format_sheet,
    make_crop,
    make_paper,
)

#: Radius of the points, and width of the drawn lines, page mm.
_DOT, _STROKE = 0.55, 0.45
#: Number of colours from the first stroke to the last.
_BINS = 32
#: Pixels of the coverage map along its longer side.
_MAP = 1000


def svg(result: Built, raster: Raster, title: str) -> str:
    """The picture as SVG text, sized in mm. raster: pixels of the drawing."""
    tour, job = result.tour, result.job
    crop = make_crop(raster)
    height, width = raster.photo.shape[:2]
    points = counted(sum(len(border) for border in raster.borders), "point")
    high = WIDE * height / width
    if job.operation.kind == "fill":
        drawn = _make_fill_panels(result, raster, crop)
    else:
        drawn = [_make_lines_panel(result.part, raster, crop)]
    panels = [
        Panel(f"picture, {width} x {height} px", high, [format_image(raster.photo, WIDE, high)]),
        Panel("ink", crop.high, [format_crop(crop, np.bitwise_not(raster.mask), smooth=False)]),
        Panel(
            f"borders of the ink, {points}",
            crop.high,
            [format_background(raster, crop), _borders(raster, crop)],
        ),
        *drawn,
        _make_order_panel(
            raster, result.planned, measure_travel(result.planned, None), "as found", job
        ),
        _make_order_panel(raster, tour.paths, tour.travel, "by order", job),
    ]
    return format_sheet(panels, result.notes, title)


def _borders(raster: Raster, crop: Crop) -> str:
    page = make_paper(raster, crop)
    matrix = raster.work_from_view
    data = "".join(
        format_line(page.place(b @ matrix[:, :2].T + matrix[:, 2])) + "Z" for b in raster.borders
    )
    return f'<path class="part" d="{data}"/>'


def _make_lines_panel(part: Part, raster: Raster, crop: Crop) -> Panel:
    """The lines and arcs, with the start points of their segments."""
    page = make_paper(raster, crop)
    dots = page.place(np.concatenate([np.zeros((0, 2)), *(c.points for c in part.contours)]))
    arcs = sum(int((c.bulges != 0).sum()) for c in part.contours)
    # A line of no length with round ends is a dot. So one element draws all points.
    data = "".join(f"M{x:.2f} {y:.2f}h0" for x, y in dots.tolist())
    return Panel(
        f"lines and {counted(arcs, 'arc')}, {counted(len(dots), 'point')}",
        crop.high,
        [
            format_background(raster, crop),
            f'<path class="part" d="{join_path_data(make_contour_chains(part.contours), page)}"/>',
            f'<path class="dot" stroke-width="{2 * _DOT}" d="{data}"/>',
        ],
    )


def _make_fill_panels(result: Built, raster: Raster, crop: Crop) -> list[Panel]:
    """The lines of the pen, and the coverage map of the ink."""
    tour, tool = result.tour, result.job.tool
    coverage = make_coverage_map(result.part, tour.paths, tool.diameter, _MAP)
    height, width = coverage.pixels.shape[:2]
    corners = np.array([[-0.5, width - 0.5], [-0.5, height - 0.5], [1.0, 1.0]])
    page = make_paper(raster, crop)
    places = page.place((coverage.work_from_map @ corners).T)
    (left, right), (top, bottom) = places.T.tolist()
    picture = format_image(coverage.pixels, right - left, bottom - top, smooth=False)
    rings = draw_places(result.notes, page, tool.radius)
    content = [f'<g transform="translate({left:.2f} {top:.2f})">{picture}</g>', *rings]
    name = "green: covered, red: bare, yellow: ink outside"
    if rings:
        name += ", ring: not as drawn"
    return [_make_pen_panel(raster, tour, result.job, crop), Panel(name, crop.high, content)]


def _make_pen_panel(raster: Raster, tour: Tour, job: Job, crop: Crop) -> Panel:
    """The lines of the pen in its width, over the ink of the picture."""
    width = job.tool.diameter * crop.scale
    data = join_path_data(make_path_chains(tour.paths), make_paper(raster, crop))
    return Panel(
        f"lines of a pen of {short(job.tool.diameter, 3)} mm",
        crop.high,
        [
            format_background(raster, crop),
            f'<path class="ink" stroke-width="{width:.2f}" d="{data}"/>',
            f'<path class="dot" stroke-width="0.2" d="{data}"/>',
        ],
    )


def _make_order_panel(
    raster: Raster, paths: tuple[ToolPath, ...], travel: float, how: str, job: Job
) -> Panel:
    """The page with the strokes, coloured from first to last, and the travel between them.

    travel: length of the travel with the pen up, mm.
    how: name of the order.
    """
    # Without a page the picture is the page.
    rows, columns = raster.mask.shape
    corners = np.array([[-0.5, columns - 0.5], [rows - 0.5, -0.5], [1.0, 1.0]])
    (left, right), (low, high) = (raster.work_from_view @ corners).tolist()
    width, height = right - left, high - low
    if job.page.size:
        (width, height), left, low = compute_page_size(job.page), 0.0, 0.0
    scale = WIDE / width
    page = Paper(scale, -left * scale, (low + height) * scale)
    sheet = f'<rect class="sheet" width="{WIDE}" height="{height * scale:.2f}"/>'
    kind = "holes, travel" if job.operation.kind == "drill" else "strokes, pen up"
    size = f"{short(width, 1)} x {short(height, 1)} mm"
    name = f"{size}: {len(paths)} {kind} {short(travel, 1)} mm, {how}"
    return Panel(name, height * scale, [sheet, *_strokes(paths, page)])


def _strokes(paths: tuple[ToolPath, ...], page: Paper) -> Iterator[str]:
    data = format_path_data(make_path_chains(paths), page)
    edges = np.unique(np.linspace(0, len(data), _BINS + 1).astype(int)).tolist()
    for a, b in pairwise(edges):
        style = f'stroke="{choose_colour(a, len(data))}" stroke-width="{_STROKE}"'
        yield f'<path {style} d="{"".join(data[a:b])}"/>'
    for k, path in enumerate(paths):
        if np.ptp(path.position[:, :2], axis=0).any():
            continue
        # A hole is a point.
        x, y = page.place(path.position[:1])[0].tolist()
        colour = choose_colour(k, len(data))
        yield f'<path stroke="{colour}" stroke-width="{4 * _STROKE}" d="M{x:.2f} {y:.2f}h0"/>'
    gaps = pairwise(paths)
    ups: list[FloatArray] = [page.place(np.stack([a.position[-1], b.position[0]])) for a, b in gaps]
    if ups:
        yield f'<path class="up" d="{"".join(map(format_line, ups))}"/>'
