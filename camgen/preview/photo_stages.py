"""The stages from a photo to its paths, side by side in one SVG file.

The stages are the photo with the work plane, the view to scale, the part, the distance from it, the
normals, and the paths by feed and by force (PIST, figures 4, 6, 11 and 12).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from camgen.geometry.arcs import compute_bulges
from camgen.model.part import Note, Part, Raster
from camgen.model.path import Tour
from camgen.model.sequences import take_rows
from camgen.preview.draw import PageChains, format_path_data, join_path_data, make_contour_chains
from camgen.preview.panels import (
    WIDE,
    Crop,
    Panel,
    Pixels,
    format_background,
    format_crop,
    format_image,
    format_line,
    format_sheet,
    make_crop,
    make_paper,
)

#: Distance between normals, page mm.
_NORMAL_SPACING_MM = 2.5
#: Blue, green, red of uncertain regions.
_DOUBT = np.array([0, 90, 170], dtype=np.uint8)
#: Colours from the lowest to the highest value.
_RAMP = (
    "#30123b",
    "#4662d7",
    "#36aaf9",
    "#1ae4b6",
    "#72fe5e",
    "#c8ef34",
    "#faba39",
    "#f66b19",
    "#ca2a04",
)


def svg(part: Part, raster: Raster, tour: Tour, notes: Sequence[Note], title: str) -> str:
    """The picture as SVG text, sized in mm."""
    crop = make_crop(raster)
    panels = [
        Panel(
            "photo and work plane",
            WIDE * raster.photo.shape[0] / raster.photo.shape[1],
            _photo(raster),
        ),
        Panel(f"to scale, {part.units}", crop.high, [format_crop(crop, raster.view)]),
        Panel(
            "part and its outline",
            crop.high,
            [format_crop(crop, raster.mask, smooth=False), _outline(part, raster, crop)],
        ),
        *_make_doubt_panel(part, raster, crop),
        Panel("distance from the part", crop.high, [format_crop(crop, _draw_distance(raster))]),
        Panel(
            "normals, towards the part",
            crop.high,
            [format_background(raster, crop), *_normals(tour, raster, crop)],
        ),
        _make_colour_panel("path by feed, mm/s", "feed", None, tour, raster, crop),
        _make_colour_panel("path by force, N", "force", 0.0, tour, raster, crop),
    ]
    return format_sheet(panels, notes, title)


# Pictures.


def _photo(raster: Raster) -> Iterator[str]:
    """The photo with the border of the view."""
    height, width = raster.photo.shape[:2]
    scale = WIDE / width
    yield format_image(raster.photo, WIDE, height * scale)
    finite = raster.framed[np.isfinite(raster.framed).all(axis=1)]
    framed = finite.clip(0, (width - 1, height - 1)) * scale
    if len(framed) > 2:
        yield f'<path class="plane" d="{format_line(framed)}Z"/>'


def _make_doubt_panel(part: Part, raster: Raster, crop: Crop) -> Iterator[Panel]:
    """The regions that other segmentation methods classify differently, orange on the view."""
    if raster.doubt is None:
        return
    view = raster.view if raster.view.ndim == 3 else np.repeat(raster.view[..., None], 3, axis=2)
    doubtful = raster.doubt[..., None] > 0
    tinted = np.where(doubtful, view // 3 + _DOUBT, 255 - (255 - view) // 2).astype(np.uint8)
    content = [format_crop(crop, tinted), _outline(part, raster, crop)]
    yield Panel("in doubt: part or bench by the method", crop.high, content)


def _draw_distance(raster: Raster) -> Pixels:
    """The distance from the part as a colour, dark near it and bright far from it."""
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    distance = cv2.distanceTransform(np.uint8(255) - raster.mask, cv2.DIST_L2, cv2.DIST_MASK_5)
    mm_per_px = float(np.hypot(*raster.work_from_view[:, 0]))
    levels = (distance * (mm_per_px * 10)).clip(0, 255).astype(np.uint8)
    return cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS).astype(np.uint8)


# Lines.


def _outline(part: Part, raster: Raster, crop: Crop) -> str:
    data = join_path_data(make_contour_chains(part.contours), make_paper(raster, crop))
    return f'<path class="part" d="{data}"/>'


def _normals(tour: Tour, raster: Raster, crop: Crop) -> Iterator[str]:
    """The normals from the TCP towards the part, evenly spaced along the paths."""
    page = make_paper(raster, crop)
    data = []
    for path in tour.paths:
        start, end, via = path.position[:-1], path.position[1:], path.via[1:]
        via = np.where(np.isnan(via), (start + end) / 2, via)
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - start, axis=1))]) * crop.scale
        places = np.arange(_NORMAL_SPACING_MM / 2, run[-1], _NORMAL_SPACING_MM)
        k = np.searchsorted(run, places, side="right").clip(1, len(start)) - 1
        t = ((places - run[k]) / np.maximum(run[k + 1] - run[k], 1e-12))[:, None]
        # For a picture the parabola through start, middle and end is close enough to the arc.
        foot = (
            (1 - t) * (1 - 2 * t) * start[k] + 4 * t * (1 - t) * via[k] + t * (2 * t - 1) * end[k]
        )
        direction = (1 - t) * path.force_direction[k + 1, 0] + t * path.force_direction[k + 1, 1]
        head = foot + direction * (1.8 / crop.scale)
        strokes = np.stack([page.place(foot), page.place(head)], axis=1)
        data += [format_line(stroke) for stroke in strokes]
    yield f'<path class="normal" d="{"".join(data)}"/>'


def _make_colour_panel(
    name: str,
    column: str,
    least: float | None,
    tour: Tour,
    raster: Raster,
    crop: Crop,
) -> Panel:
    """The paths with a colour for each value.

    name: name of the panel, with the unit of the values.
    column: name of the values, one per waypoint of a path. Segments with the value 0 are grey.
    least: value of the first colour; None for the smallest value above 0.
    """
    values = [getattr(path, column)[1:] for path in tour.paths]
    by_segment = np.concatenate([np.zeros(0), *values])
    shown = by_segment[by_segment > 0]
    lowest, highest = (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 0.0)
    if least is not None:
        lowest = least
    fraction = np.ones(len(by_segment))
    if highest > lowest:
        fraction = (by_segment - lowest) / (highest - lowest)
    steps = (fraction * (len(_RAMP) - 1)).round().astype(int).clip(0, len(_RAMP) - 1)
    colour = np.where(by_segment > 0, steps, -1)
    pieces = format_path_data(_segments(tour), make_paper(raster, crop))
    lines = [format_background(raster, crop)]
    for k in np.unique(colour).tolist():
        data = "".join(take_rows(pieces, np.flatnonzero(colour == k).tolist()))
        style = 'class="off"' if k < 0 else f'class="track" stroke="{_RAMP[k]}"'
        lines.append(f'<path {style} d="{data}"/>')
    extent = f"{lowest:.3g} to {highest:.3g}" if highest > 0 else "none"
    return Panel(f"{name}: {extent}", crop.high, lines)


def _segments(tour: Tour) -> PageChains:
    """Each segment of the paths as its own chain."""
    pairs, rows = [np.zeros((0, 2))], [np.zeros(0)]
    for path in tour.paths:
        start, end = path.position[:-1, :2], path.position[1:, :2]
        bulge = compute_bulges(start, path.via[1:, :2], end)
        pairs.append(np.stack([start, end], axis=1).reshape(-1, 2))
        rows.append(np.stack([np.zeros(len(bulge)), bulge], axis=1).ravel())
    points = np.concatenate(pairs)
    return PageChains(points, np.concatenate(rows), np.arange(0, len(points), 2))
