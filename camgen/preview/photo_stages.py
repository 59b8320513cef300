"""The way from a photo to a path as one SVG file: the stages side by side (PIST, figures 4, 6, 11 and 12).

Photo with the work plane, the view to scale, the part, its distance, the normals, the path with feed and with force.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from camgen.geometry.arcs import compute_bulges
from camgen.model.part import Note, Part, Raster
from camgen.model.path import Tour
from camgen.model.pose import FloatArray
from camgen.preview.draw import PageChains, of_contours, path_data
from camgen.preview.panels import (
    WIDE,
    Crop,
    Panel,
    Pixels,
    faint,
    image,
    line,
    make_crop,
    on_panel,
    sheet,
    show_crop,
)

#: How far apart the normals are drawn, mm of the page.
_NORMALS_APART_MM = 2.5
#: Blue, green, red of what is in doubt.
_DOUBT = np.array([0, 90, 170], dtype=np.uint8)
#: From slow to fast, from no force to the most.
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
        Panel(f"to scale, {part.units}", crop.high, [show_crop(crop, raster.view)]),
        Panel(
            "part and its outline",
            crop.high,
            [show_crop(crop, raster.mask, smooth=False), _outline(part, raster, crop)],
        ),
        *_doubt(part, raster, crop),
        Panel("distance from the part", crop.high, [show_crop(crop, _distance(raster))]),
        Panel(
            "normals, towards the part",
            crop.high,
            [faint(raster, crop), *_normals(tour, raster, crop)],
        ),
        _colour("path by feed, mm/s", 1.0, [p.feed for p in tour.paths], tour, raster, crop),
        _colour("path by force, N", 0.0, [p.force for p in tour.paths], tour, raster, crop),
    ]
    return sheet(panels, notes, title)


# Pictures.


def _photo(raster: Raster) -> Iterator[str]:
    """The photo with the border of the view and the axes of the work plane, x red, y green."""
    height, width = raster.photo.shape[:2]
    scale = WIDE / width
    yield image(raster.photo, WIDE, height * scale)
    framed = (
        raster.framed[np.isfinite(raster.framed).all(axis=1)].clip(0, (width - 1, height - 1))
        * scale
    )
    if len(framed) > 2:
        yield f'<path class="plane" d="{line(framed)}Z"/>'


def _doubt(part: Part, raster: Raster, crop: Crop) -> Iterator[Panel]:
    """Where other ways to tell the part from the bench differ, in orange over the view."""
    if raster.doubt is None:
        return
    view = raster.view if raster.view.ndim == 3 else np.repeat(raster.view[..., None], 3, axis=2)
    tinted = np.where(
        raster.doubt[..., None] > 0, view // 3 + _DOUBT, 255 - (255 - view) // 2
    ).astype(np.uint8)
    content = [show_crop(crop, tinted), _outline(part, raster, crop)]
    yield Panel("in doubt: part or bench by the method", crop.high, content)


def _distance(raster: Raster) -> Pixels:
    """Distance from the part, near dark, far bright."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    far = cv2.distanceTransform(np.uint8(255) - raster.mask, cv2.DIST_L2, cv2.DIST_MASK_5)
    size = float(np.hypot(*raster.work_from_view[:, 0]))
    return cv2.applyColorMap(
        (far * (size * 10)).clip(0, 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS
    ).astype(np.uint8)


# Lines.


def _outline(part: Part, raster: Raster, crop: Crop) -> str:
    return f'<path class="part" d="{"".join(path_data(of_contours(part.contours), on_panel(raster, crop)))}"/>'


def _normals(tour: Tour, raster: Raster, crop: Crop) -> Iterator[str]:
    """From the tool centre towards the part, evenly along the paths."""
    page = on_panel(raster, crop)
    data = []
    for path in tour.paths:
        start, end, via = path.position[:-1], path.position[1:], path.via[1:]
        via = np.where(np.isnan(via), (start + end) / 2, via)
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - start, axis=1))]) * crop.scale
        at = np.arange(_NORMALS_APART_MM / 2, run[-1], _NORMALS_APART_MM)
        k = np.searchsorted(run, at, side="right").clip(1, len(start)) - 1
        t = ((at - run[k]) / np.maximum(run[k + 1] - run[k], 1e-12))[:, None]
        # The parabola through start, middle and end is near enough to the arc for a picture.
        place = (
            (1 - t) * (1 - 2 * t) * start[k] + 4 * t * (1 - t) * via[k] + t * (2 * t - 1) * end[k]
        )
        press = (1 - t) * path.force_direction[k + 1, 0] + t * path.force_direction[k + 1, 1]
        strokes = np.stack(
            [page.place(place), page.place(place + press * (1.8 / crop.scale))], axis=1
        )
        data += [line(stroke) for stroke in strokes]
    yield f'<path class="normal" d="{"".join(data)}"/>'


def _colour(
    name: str, low: float, values: Sequence[FloatArray], tour: Tour, raster: Raster, crop: Crop
) -> Panel:
    """The path with a colour for each value, low to high; grey where it is 0."""
    found = np.concatenate([v[1:] for v in values]) if values else np.zeros(0)
    shown = found[found > 0]
    least, most = (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 0.0)
    least = least if low else 0.0
    place = (found - least) / (most - least) if most > least else np.ones(len(found))
    colour = np.where(
        found > 0, (place * (len(_RAMP) - 1)).round().astype(int).clip(0, len(_RAMP) - 1), -1
    )
    pieces = path_data(_segments(tour), on_panel(raster, crop))
    lines = [faint(raster, crop)]
    for k in np.unique(colour).tolist():
        data = "".join(piece for piece, at in zip(pieces, colour.tolist(), strict=True) if at == k)
        style = 'class="off"' if k < 0 else f'class="track" stroke="{_RAMP[k]}"'
        lines.append(f'<path {style} d="{data}"/>')
    told = f"{name}: {least:.3g} to {most:.3g}" if most > 0 else f"{name}: none"
    return Panel(told, crop.high, lines)


def _segments(tour: Tour) -> PageChains:
    """Every segment of the paths as a chain of its own."""
    pairs, rows = [np.zeros((0, 2))], [np.zeros(0)]
    for path in tour.paths:
        start, end = path.position[:-1, :2], path.position[1:, :2]
        bulge = compute_bulges(start, path.via[1:, :2], end)
        pairs.append(np.stack([start, end], axis=1).reshape(-1, 2))
        rows.append(np.stack([np.zeros(len(bulge)), bulge], axis=1).ravel())
    points = np.concatenate(pairs)
    return PageChains(points, np.concatenate(rows), np.arange(0, len(points), 2))
