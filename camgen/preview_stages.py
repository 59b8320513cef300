"""The way from a photo to a path as one SVG file: the stages side by side (PIST, figures 4, 6, 11 and 12).

Photo with the work plane, the view to scale, the part, its distance, the normals, the path with feed and with force.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import one_line
from camgen.paths import Tour
from camgen.pose import FloatArray
from camgen.preview_draw import Chains, Page, of_contours, path_data
from camgen.shapes import Note, Part, Raster

Pixels = NDArray[np.uint8]

#: A panel's width and the space around it, page mm; panels in a row; pixels of its picture at most.
_WIDE, _GAP, _COLUMNS, _MOST_PX = 88.0, 6.0, 3, 900
#: Shown around the part, mm, at least; and how far apart the normals are drawn, mm of the page.
_ROOM, _APART = 8.0, 2.5
#: From slow to fast, from no force to the most.
_RAMP = ("#30123b", "#4662d7", "#36aaf9", "#1ae4b6", "#72fe5e", "#c8ef34", "#faba39", "#f66b19", "#ca2a04")

_STYLE = """\
.bg{fill:#fff}text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.2px;fill:#202124}
.big{font-size:4.6px;font-weight:600}path{fill:none;stroke-linecap:round;stroke-linejoin:round}
.part{stroke:#d0103a;stroke-width:.3}.plane{stroke:#ffb300;stroke-width:.5}.normal{stroke:#1f6feb;stroke-width:.25}
.track{stroke-width:.7}.off{stroke:#9aa0a6;stroke-width:.5}.x{stroke:#e5484d;stroke-width:.6}.y{stroke:#30a46c;stroke-width:.6}
.warn{fill:#d0103a}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.warn{fill:#ff6b81}}"""


class _Crop(Struct, frozen=True):
    """The rectangle of the view that is shown: pixels from left, top to right, bottom; scale: page mm per mm."""

    left: int
    top: int
    right: int
    bottom: int
    scale: float
    high: float


def svg(part: Part, raster: Raster, tour: Tour, notes: Sequence[Note], title: str) -> str:
    """The picture as SVG text, sized in mm."""
    crop = _crop(raster)
    photo_high = _WIDE * raster.photo.shape[0] / raster.photo.shape[1]
    rows = max(crop.high, photo_high)
    panels = [
        ("photo and work plane", _photo(raster)),
        (f"to scale, {part.units}", [_cropped(raster, crop, raster.view)]),
        ("part and its outline", [_cropped(raster, crop, raster.mask), _outline(part, raster, crop)]),
        ("distance from the part", [_cropped(raster, crop, _distance(raster))]),
        ("normals, towards the part", [_faint(raster, crop), *_normals(tour, raster, crop)]),
        _coloured("path by feed, mm/s", 1.0, [p.feed for p in tour.paths], tour, raster, crop),
        _coloured("path by force, N", 0.0, [p.force for p in tour.paths], tour, raster, crop),
    ]
    width = _COLUMNS * (_WIDE + _GAP) + _GAP
    body: list[str] = []
    for k, (name, content) in enumerate(panels):
        x, y = _GAP + k % _COLUMNS * (_WIDE + _GAP), 18 + k // _COLUMNS * (rows + 10)
        body.append(f'<text x="{x}" y="{y:.2f}">{k + 1} {_text(name)}</text>')
        body += [f'<g transform="translate({x} {y + 2:.2f})">', *content, "</g>"]
    bottom = 18 + -(-len(panels) // _COLUMNS) * (rows + 10)
    skipped = [_text(f"left out: {note.what}") for note in notes if note.kind == "skipped"][:6]
    lines = [f'<text class="warn" x="{_GAP}" y="{bottom + 5 * k:.2f}">{text}</text>' for k, text in enumerate(skipped)]
    height = bottom + 5 * len(skipped)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
            f'viewBox="0 0 {width:.2f} {height:.2f}">',
            f"<title>{_text(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_GAP}" y="9">{_text(title)}</text>',
            *body,
            *lines,
            "</svg>\n",
        ]
    )


def _crop(raster: Raster) -> _Crop:
    """What is shown of the view: the part and some room."""
    rows, columns = np.flatnonzero(raster.mask.any(axis=1)), np.flatnonzero(raster.mask.any(axis=0))
    height, width = raster.mask.shape
    mm_per_px = float(np.hypot(*raster.work_from_view[:, 0]))
    room = int(max(_ROOM, 0.15 * np.ptp(columns) * mm_per_px) / mm_per_px) + 1
    left, right = max(int(columns[0]) - room, 0), min(int(columns[-1]) + room + 1, width)
    top, bottom = max(int(rows[0]) - room, 0), min(int(rows[-1]) + room + 1, height)
    scale = _WIDE / ((right - left) * mm_per_px)
    return _Crop(left, top, right, bottom, scale, _WIDE * (bottom - top) / (right - left))


def _page(raster: Raster, crop: _Crop) -> Page:
    """From the work frame to the panel. A view's u runs along x, its v against y."""
    corner = raster.work_from_view @ (crop.left - 0.5, crop.top - 0.5, 1.0)
    return Page(crop.scale, -float(corner[0]) * crop.scale, float(corner[1]) * crop.scale)


# Pictures.


def _image(pixels: Pixels, wide: float, high: float, smooth: bool = True) -> str:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    step = max(pixels.shape[:2]) / _MOST_PX
    if step > 1:
        size = (max(1, round(pixels.shape[1] / step)), max(1, round(pixels.shape[0] / step)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    kind, options = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 85]) if smooth else (".png", [])
    data = base64.b64encode(cv2.imencode(kind, pixels, options)[1].tobytes()).decode()
    form = "jpeg" if smooth else "png"
    return f'<image width="{wide:.2f}" height="{high:.2f}" href="data:image/{form};base64,{data}"/>'


def _cropped(raster: Raster, crop: _Crop, pixels: Pixels) -> str:
    shown = np.ascontiguousarray(pixels[crop.top : crop.bottom, crop.left : crop.right])
    return _image(shown, _WIDE, crop.high, smooth=pixels is not raster.mask)


def _faint(raster: Raster, crop: _Crop) -> str:
    """The view as a background to draw on."""
    pale = (raster.view[crop.top : crop.bottom, crop.left : crop.right] // 3 + np.uint8(170)).astype(np.uint8)
    return _image(np.ascontiguousarray(pale), _WIDE, crop.high)


def _photo(raster: Raster) -> Iterator[str]:
    """The photo with the border of the view and the axes of the work plane, x red, y green."""
    height, width = raster.photo.shape[:2]
    scale = _WIDE / width
    yield _image(raster.photo, _WIDE, height * scale)
    framed = raster.framed[np.isfinite(raster.framed).all(axis=1)].clip(0, (width - 1, height - 1)) * scale
    if len(framed) > 2:
        yield f'<path class="plane" d="{_line(framed)}Z"/>'


def _distance(raster: Raster) -> Pixels:
    """Distance from the part, near dark, far bright."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    far = cv2.distanceTransform(np.uint8(255) - raster.mask, cv2.DIST_L2, cv2.DIST_MASK_5)
    size = float(np.hypot(*raster.work_from_view[:, 0]))
    return cv2.applyColorMap((far * (size * 10)).clip(0, 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS).astype(np.uint8)


# Lines.


def _line(points: FloatArray) -> str:
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())


def _outline(part: Part, raster: Raster, crop: _Crop) -> str:
    return f'<path class="part" d="{"".join(path_data(of_contours(part.contours), _page(raster, crop)))}"/>'


def _normals(tour: Tour, raster: Raster, crop: _Crop) -> Iterator[str]:
    """From the tool centre towards the part, evenly along the paths."""
    page = _page(raster, crop)
    data = []
    for path in tour.paths:
        start, end, via = path.position[:-1], path.position[1:], path.via[1:]
        via = np.where(np.isnan(via), (start + end) / 2, via)
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - start, axis=1))]) * crop.scale
        at = np.arange(_APART / 2, run[-1], _APART)
        k = np.searchsorted(run, at, side="right").clip(1, len(start)) - 1
        t = ((at - run[k]) / np.maximum(run[k + 1] - run[k], 1e-12))[:, None]
        # The parabola through start, middle and end is near enough to the arc for a picture.
        place = (1 - t) * (1 - 2 * t) * start[k] + 4 * t * (1 - t) * via[k] + t * (2 * t - 1) * end[k]
        press = (1 - t) * path.press[k + 1, 0] + t * path.press[k + 1, 1]
        strokes = np.stack([page.place(place), page.place(place + press * (1.8 / crop.scale))], axis=1)
        data += [_line(stroke) for stroke in strokes]
    yield f'<path class="normal" d="{"".join(data)}"/>'


def _coloured(
    name: str, low: float, values: Sequence[FloatArray], tour: Tour, raster: Raster, crop: _Crop
) -> tuple[str, list[str]]:
    """The path with a colour for each value, low to high; grey where it is 0."""
    found = np.concatenate([v[1:] for v in values]) if values else np.zeros(0)
    shown = found[found > 0]
    least, most = (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 0.0)
    least = least if low else 0.0
    place = (found - least) / (most - least) if most > least else np.ones(len(found))
    colour = np.where(found > 0, (place * (len(_RAMP) - 1)).round().astype(int).clip(0, len(_RAMP) - 1), -1)
    pieces = path_data(_segments(tour), _page(raster, crop))
    lines = [_faint(raster, crop)]
    for k in np.unique(colour).tolist():
        data = "".join(piece for piece, at in zip(pieces, colour.tolist(), strict=True) if at == k)
        style = 'class="off"' if k < 0 else f'class="track" stroke="{_RAMP[k]}"'
        lines.append(f'<path {style} d="{data}"/>')
    return f"{name}: {least:.3g} to {most:.3g}" if most > 0 else f"{name}: none", lines


def _segments(tour: Tour) -> Chains:
    """Every segment of the paths as a chain of its own."""
    pairs, bulges = [np.zeros((0, 2))], [np.zeros(0)]
    for path in tour.paths:
        start, end, via = path.position[:-1, :2], path.position[1:, :2], path.via[1:, :2]
        chord = end - start
        square = (chord**2).sum(axis=1)
        height = chord[:, 0] * (via - start)[:, 1] - chord[:, 1] * (via - start)[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            bulge = np.nan_to_num(np.where(square > 0, -2 * height / square, 0.0))
        pairs.append(np.stack([start, end], axis=1).reshape(-1, 2))
        bulges.append(np.stack([np.zeros(len(bulge)), bulge], axis=1).ravel())
    points = np.concatenate(pairs)
    return Chains(points, np.concatenate(bulges), np.arange(0.0, len(points), 2.0))


def _text(text: str) -> str:
    return escape(one_line(text))
