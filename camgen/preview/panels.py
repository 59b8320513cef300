"""Named pictures side by side on one sheet, for the previews of photos and of drawings."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.part import Note, Raster
from camgen.model.pose import FloatArray
from camgen.preview.draw import Paper, escape_line, list_faults

Pixels = NDArray[np.uint8]

#: Width of a panel, page mm.
WIDE = 88.0
#: Gap between panels, page mm; panels per row; maximum number of pixels of a side of a picture.
_GAP, _COLUMNS, _MAX_PX = 6.0, 3, 900
#: Minimum width of the strip of bench that is shown around the part, mm.
_STRIP_MM = 8.0

_STYLE = """\
.bg{fill:#fff}text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.2px;fill:#202124}
.big{font-size:4.6px;font-weight:600}path{fill:none;stroke-linecap:round;stroke-linejoin:round}
.part{stroke:#d0103a;stroke-width:.3}.plane{stroke:#ffb300;stroke-width:.5}\
.normal{stroke:#1f6feb;stroke-width:.25}
.track{stroke-width:.7}.off{stroke:#9aa0a6;stroke-width:.5}.x{stroke:#e5484d;stroke-width:.6}\
.y{stroke:#30a46c;stroke-width:.6}
.dot{stroke:#1f6feb}.ink{stroke:#d0103a;stroke-opacity:.45}\
.sheet{fill:#fff;stroke:#9aa0a6;stroke-width:.3}\
.up{stroke:#5f6368;stroke-width:.15}.warn{fill:#d0103a}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.warn{fill:#ff6b81}}"""


class Panel(Struct, frozen=True):
    """One picture of the sheet.

    name: its name.
    high: its height, page mm.
    content: its SVG elements.
    """

    name: str
    high: float
    content: Iterable[str]


class Crop(Struct, frozen=True):
    """The rectangle of the view that is shown.

    left, top, right, bottom: its borders, px; right and bottom are not in it.
    scale: page mm per mm.
    high: its height, page mm.
    """

    left: int
    top: int
    right: int
    bottom: int
    scale: float
    high: float


def format_sheet(panels: Sequence[Panel], notes: Sequence[Note], title: str) -> str:
    """The panels in rows, with the faults below them, as SVG text sized in mm."""
    width = _COLUMNS * (WIDE + _GAP) + _GAP
    body: list[str] = []
    top = 18.0
    for first in range(0, len(panels), _COLUMNS):
        row = panels[first : first + _COLUMNS]
        for k, panel in enumerate(row):
            x = _GAP + k * (WIDE + _GAP)
            name = f"{first + k + 1} {escape_line(panel.name)}"
            body.append(f'<text x="{x}" y="{top:.2f}">{name}</text>')
            body += [f'<g transform="translate({x} {top + 2:.2f})">', *panel.content, "</g>"]
        top += max(panel.high for panel in row) + 10
    faults = list_faults(notes)[:6]
    lines = [
        f'<text class="warn" x="{_GAP}" y="{top + 5 * k:.2f}">{escape_line(what)}</text>'
        for k, (what, _) in enumerate(faults)
    ]
    height = top + 5 * len(faults)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" '
            f'height="{height:.2f}mm" viewBox="0 0 {width:.2f} {height:.2f}">',
            f"<title>{escape_line(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_GAP}" y="9">{escape_line(title)}</text>',
            *body,
            *lines,
            "</svg>\n",
        ]
    )


def make_crop(raster: Raster) -> Crop:
    """The rectangle of the view with the part and a strip around it."""
    rows, columns = np.flatnonzero(raster.mask.any(axis=1)), np.flatnonzero(raster.mask.any(axis=0))
    height, width = raster.mask.shape
    mm_per_px = float(np.hypot(*raster.work_from_view[:, 0]))
    strip = int(max(_STRIP_MM, 0.15 * np.ptp(columns) * mm_per_px) / mm_per_px) + 1
    left, right = max(int(columns[0]) - strip, 0), min(int(columns[-1]) + strip + 1, width)
    top, bottom = max(int(rows[0]) - strip, 0), min(int(rows[-1]) + strip + 1, height)
    scale = WIDE / ((right - left) * mm_per_px)
    return Crop(left, top, right, bottom, scale, WIDE * (bottom - top) / (right - left))


def make_paper(raster: Raster, crop: Crop) -> Paper:
    """The transform from the work frame to the panel. u of a view is along x, v against y."""
    corner = raster.work_from_view @ (crop.left - 0.5, crop.top - 0.5, 1.0)
    return Paper(crop.scale, -float(corner[0]) * crop.scale, float(corner[1]) * crop.scale)


def format_image(pixels: Pixels, wide: float, high: float, smooth: bool = True) -> str:
    """The picture as an SVG element, `wide` x `high` page mm."""
    import cv2  # noqa: PLC0415 (slow, only for pictures)

    step = max(pixels.shape[:2]) / _MAX_PX
    if step > 1:
        size = (max(1, round(pixels.shape[1] / step)), max(1, round(pixels.shape[0] / step)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    kind, options = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 85]) if smooth else (".png", [])
    data = base64.b64encode(cv2.imencode(kind, pixels, options)[1].tobytes()).decode()
    form = "jpeg" if smooth else "png"
    return f'<image width="{wide:.2f}" height="{high:.2f}" href="data:image/{form};base64,{data}"/>'


def format_crop(crop: Crop, pixels: Pixels, smooth: bool = True) -> str:
    """The crop of a picture of the view's size, as an SVG element."""
    shown = np.ascontiguousarray(pixels[crop.top : crop.bottom, crop.left : crop.right])
    return format_image(shown, WIDE, crop.high, smooth)


def format_background(raster: Raster, crop: Crop) -> str:
    """The view, paler, as a background to draw on."""
    pale = (raster.view // 3 + np.uint8(170)).astype(np.uint8)
    return format_crop(crop, pale)


def format_line(points: FloatArray) -> str:
    """Points (N, 2), page mm, as path data."""
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())
