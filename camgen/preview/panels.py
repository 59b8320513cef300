"""Pictures side by side on one sheet, each with its name: what the previews of photos and of drawings share."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import one_line
from camgen.model.part import Note, Raster
from camgen.model.pose import FloatArray
from camgen.model.text import escape
from camgen.preview.draw import Paper, tell_wrong

Pixels = NDArray[np.uint8]

#: A panel's width, page mm.
WIDE = 88.0
#: The space around it, page mm; panels in a row; pixels of its picture at most.
_GAP, _COLUMNS, _MOST_PX = 6.0, 3, 900
#: Shown around the part, mm, at least.
_ROOM_MM = 8.0

_STYLE = """\
.bg{fill:#fff}text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.2px;fill:#202124}
.big{font-size:4.6px;font-weight:600}path{fill:none;stroke-linecap:round;stroke-linejoin:round}
.part{stroke:#d0103a;stroke-width:.3}.plane{stroke:#ffb300;stroke-width:.5}.normal{stroke:#1f6feb;stroke-width:.25}
.track{stroke-width:.7}.off{stroke:#9aa0a6;stroke-width:.5}.x{stroke:#e5484d;stroke-width:.6}.y{stroke:#30a46c;stroke-width:.6}
.dot{stroke:#1f6feb}.ink{stroke:#d0103a;stroke-opacity:.45}.sheet{fill:#fff;stroke:#9aa0a6;stroke-width:.3}.up{stroke:#5f6368;stroke-width:.15}.warn{fill:#d0103a}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.warn{fill:#ff6b81}}"""


class Panel(Struct, frozen=True):
    """One picture of the sheet: name, height in page mm, and the SVG elements in it."""

    name: str
    high: float
    content: Iterable[str]


class Crop(Struct, frozen=True):
    """The rectangle of the view that is shown: pixels from left, top to right, bottom; scale: page mm per mm."""

    left: int
    top: int
    right: int
    bottom: int
    scale: float
    high: float


def sheet(panels: Sequence[Panel], notes: Sequence[Note], title: str) -> str:
    """The panels, ``_COLUMNS`` in a row, as SVG text sized in mm, and under them what was left out or went wrong."""
    width = _COLUMNS * (WIDE + _GAP) + _GAP
    body: list[str] = []
    top = 18.0
    for first in range(0, len(panels), _COLUMNS):
        row = panels[first : first + _COLUMNS]
        for k, panel in enumerate(row):
            x = _GAP + k * (WIDE + _GAP)
            body.append(f'<text x="{x}" y="{top:.2f}">{first + k + 1} {xml(panel.name)}</text>')
            body += [f'<g transform="translate({x} {top + 2:.2f})">', *panel.content, "</g>"]
        top += max(panel.high for panel in row) + 10
    skipped = [xml(what) for what, _ in tell_wrong(notes)][:6]
    lines = [
        f'<text class="warn" x="{_GAP}" y="{top + 5 * k:.2f}">{text}</text>'
        for k, text in enumerate(skipped)
    ]
    height = top + 5 * len(skipped)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" height="{height:.2f}mm" '
            f'viewBox="0 0 {width:.2f} {height:.2f}">',
            f"<title>{xml(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_GAP}" y="9">{xml(title)}</text>',
            *body,
            *lines,
            "</svg>\n",
        ]
    )


def make_crop(raster: Raster) -> Crop:
    """What is shown of the view: the part and some room."""
    rows, columns = np.flatnonzero(raster.mask.any(axis=1)), np.flatnonzero(raster.mask.any(axis=0))
    height, width = raster.mask.shape
    mm_per_px = float(np.hypot(*raster.work_from_view[:, 0]))
    room = int(max(_ROOM_MM, 0.15 * np.ptp(columns) * mm_per_px) / mm_per_px) + 1
    left, right = max(int(columns[0]) - room, 0), min(int(columns[-1]) + room + 1, width)
    top, bottom = max(int(rows[0]) - room, 0), min(int(rows[-1]) + room + 1, height)
    scale = WIDE / ((right - left) * mm_per_px)
    return Crop(left, top, right, bottom, scale, WIDE * (bottom - top) / (right - left))


def on_panel(raster: Raster, crop: Crop) -> Paper:
    """From the work frame to the panel. A view's u runs along x, its v against y."""
    corner = raster.work_from_view @ (crop.left - 0.5, crop.top - 0.5, 1.0)
    return Paper(crop.scale, -float(corner[0]) * crop.scale, float(corner[1]) * crop.scale)


def image(pixels: Pixels, wide: float, high: float, smooth: bool = True) -> str:
    """The picture as an SVG element of that size, page mm."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    step = max(pixels.shape[:2]) / _MOST_PX
    if step > 1:
        size = (max(1, round(pixels.shape[1] / step)), max(1, round(pixels.shape[0] / step)))
        pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    kind, options = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 85]) if smooth else (".png", [])
    data = base64.b64encode(cv2.imencode(kind, pixels, options)[1].tobytes()).decode()
    form = "jpeg" if smooth else "png"
    return f'<image width="{wide:.2f}" height="{high:.2f}" href="data:image/{form};base64,{data}"/>'


def show_crop(crop: Crop, pixels: Pixels, smooth: bool = True) -> str:
    """The crop of a picture of the view's size."""
    return image(
        np.ascontiguousarray(pixels[crop.top : crop.bottom, crop.left : crop.right]),
        WIDE,
        crop.high,
        smooth,
    )


def faint(raster: Raster, crop: Crop) -> str:
    """The view as a background to draw on."""
    pale = (
        raster.view[crop.top : crop.bottom, crop.left : crop.right] // 3 + np.uint8(170)
    ).astype(np.uint8)
    return image(np.ascontiguousarray(pale), WIDE, crop.high)


def line(points: FloatArray) -> str:
    """Points (N, 2), page mm, as path data."""
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())


def xml(text: str) -> str:
    """Text of any origin as XML: no control characters, no markup."""
    return escape(one_line(text))
