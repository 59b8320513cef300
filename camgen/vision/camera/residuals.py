"""Draws the residuals of a calibration as an SVG file.

A residual is a corner as seen in the photo minus the corner as calculated, px. The page shows where
in the photo the residuals point in which direction, all residuals around a common zero, and the rms
of each photo.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import compress

import numpy as np

from camgen.model.errors import make_one_line
from camgen.model.pose import FloatArray
from camgen.model.text import escape, short
from camgen.vision.camera.calibrate import Calibration

# All lengths are mm on the page. The bars stand beside the photo, the cloud below it.

#: Largest width and height of the photo.
_MAX_WIDTH, _MAX_HEIGHT = 180.0, 135.0
#: Space around everything, and space at the top for two lines of text.
_MARGIN, _TOP = 8.0, 20.0
#: Width of the bars with their numbers, and of the names beside them.
_BARS, _NAMES = 46.0, 34.0
#: Distance between lines of text.
_LINE_HEIGHT = 4.2
#: Side of the square of the cloud.
_CLOUD = 52.0
#: Length of a stroke for a residual as large as the rms, or a little less: the factor is round.
_STROKE = 3.0
#: Directions with a colour of their own, around the circle. A pattern of the lens shows as areas of
#: one colour.
_HUES = 12
#: Characters of the name of a photo, at most.
_MAX_LETTERS = 18

_STYLE = (
    ".bg{fill:#fff}.frame{fill:none;stroke:#9aa0a6;stroke-width:.3}"
    ".axis{stroke:#9aa0a6;stroke-width:.2;fill:none}\n"
    "text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.1px;fill:#202124}"
    ".big{font-size:4.6px;font-weight:600}\n"
    ".bar{fill:#1f6feb}.warn{fill:#d0103a}.r{text-anchor:end}"
    ".arrow{fill:none;stroke-width:.3;stroke-linecap:round}\n"
    ".dot{stroke-width:.7;stroke-linecap:round;fill:none;opacity:.6}"
    ".cross{stroke:#5f6368;stroke-width:.35}\n"
    "@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}"
    ".warn{fill:#ff6b81}.cross{stroke:#bdc1c6}}"
)


def draw_residuals(calibration: Calibration, title: str) -> str:
    """Draw the residuals as SVG text, sized in mm, for light and dark screens."""
    width, height = calibration.camera.size
    scale = min(_MAX_WIDTH / width, _MAX_HEIGHT / height)
    photo_width, photo_height = width * scale, height * scale
    lines = len(calibration.used) + 2 + len(calibration.left_out) + bool(calibration.left_out)
    page_width = 2 * _MARGIN + photo_width + 8 + _NAMES + _BARS
    page_height = _TOP + max(photo_height + 10 + _CLOUD, lines * _LINE_HEIGHT) + _MARGIN
    # The largest factor of 1, 2 or 5 times a power of ten: no stroke as large as the rms is longer.
    inverse = calibration.rms / _STROKE * scale
    factor = 1 / _round_up(inverse) if inverse > 0 else 1.0
    legend = (
        f"{short(calibration.rms, 3)} px rms; strokes {short(factor, 1)} times their length in px, "
        "coloured by direction"
    )
    return "\n".join(
        [
            '<svg xmlns="http://www.w3.org/2000/svg" '
            f'width="{page_width:.2f}mm" height="{page_height:.2f}mm" '
            f'viewBox="0 0 {page_width:.2f} {page_height:.2f}">',
            f"<title>{_escape(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_MARGIN}" y="9">{_escape(title)}</text>',
            f'<text x="{_MARGIN}" y="15">{legend}</text>',
            *_draw_strokes(calibration, scale, factor),
            *_draw_cloud(calibration, _TOP + photo_height + 8),
            *_draw_bars(calibration, _MARGIN + photo_width + 8),
            "</svg>\n",
        ]
    )


def _draw_strokes(calibration: Calibration, scale: float, factor: float) -> Iterator[str]:
    """Yield the frame of the photo, the strokes and the principal point.

    A stroke begins at the corner as calculated and points to the corner as seen.

    scale: page mm per px.
    factor: length of a stroke divided by that of its residual to scale.
    """
    width, height = calibration.camera.size
    size = f'width="{width * scale:.2f}" height="{height * scale:.2f}"'
    yield f'<rect class="frame" x="{_MARGIN}" y="{_TOP}" {size}/>'
    corners = np.concatenate([photo.seen.corners for photo in calibration.used])
    errors = np.concatenate([photo.errors for photo in calibration.used])
    # The centre of the first pixel is (0, 0): the photo begins half a pixel before it.
    start = (corners - errors + 0.5) * scale + (_MARGIN, _TOP)
    end = start + errors * (factor * scale)
    strokes = [
        f"M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}"
        for x0, y0, x1, y1 in np.hstack([start, end]).tolist()
    ]
    yield from _colour_by_direction("arrow", strokes, errors)
    x, y = ((calibration.camera.matrix[:2, 2] + 0.5) * scale + (_MARGIN, _TOP)).tolist()
    yield f'<path class="cross" d="M{x - 2:.2f} {y:.2f}h4M{x:.2f} {y - 2:.2f}v4"/>'


def _draw_cloud(calibration: Calibration, top: float) -> Iterator[str]:
    """Yield all residuals as dots around a common zero, in a square with a round number of px."""
    errors = np.concatenate([photo.errors for photo in calibration.used])
    largest = float(np.abs(errors).max())
    reach = _round_up(largest) if largest > 0 else 1.0
    half = _CLOUD / 2
    x, y = _MARGIN + half, top + half
    yield f'<rect class="frame" x="{_MARGIN}" y="{top:.2f}" width="{_CLOUD}" height="{_CLOUD}"/>'
    yield f'<path class="axis" d="M{_MARGIN} {y:.2f}h{_CLOUD}M{x:.2f} {top:.2f}v{_CLOUD}"/>'
    places = errors * (half / reach) + (x, y)
    dots = [f"M{u:.2f} {v:.2f}h0" for u, v in places.tolist()]
    yield from _colour_by_direction("dot", dots, errors)
    words = ("all corners, seen less calculated:", f"the square is {short(2 * reach, 6)} px wide")
    left = _MARGIN + _CLOUD + 4
    for i, line in enumerate(words):
        yield f'<text x="{left:.2f}" y="{top + 5 + i * _LINE_HEIGHT:.2f}">{line}</text>'


def _draw_bars(calibration: Calibration, left: float) -> Iterator[str]:
    """Yield the rms of each photo as a bar, then the names of the photos that were left out."""
    largest = max(photo.rms for photo in calibration.used) or 1.0
    y = _TOP + 3
    yield f'<text x="{left:.2f}" y="{y:.2f}">px rms of each photo</text>'
    bar_left = left + _NAMES
    for photo in calibration.used:
        y += _LINE_HEIGHT
        length = (_BARS - 14) * photo.rms / largest
        yield f'<text x="{left:.2f}" y="{y:.2f}">{_shorten_name(photo.name)}</text>'
        yield (
            f'<rect class="bar" x="{bar_left:.2f}" y="{y - 2.6:.2f}" '
            f'width="{length:.2f}" height="3"/>'
        )
        yield f'<text x="{bar_left + length + 1.5:.2f}" y="{y:.2f}">{short(photo.rms, 3)}</text>'
    if calibration.left_out:
        y += 2 * _LINE_HEIGHT
        yield f'<text class="warn" x="{left:.2f}" y="{y:.2f}">left out</text>'
    for unused in calibration.left_out:
        y += _LINE_HEIGHT
        yield (
            f'<text class="warn" x="{left:.2f}" y="{y:.2f}">{_shorten_name(unused.name)}'
            f"<title>{_escape(unused.why)}</title></text>"
        )


def _colour_by_direction(name: str, marks: list[str], errors: FloatArray) -> Iterator[str]:
    """Yield a path of the class `name` for each colour, with the marks of its residuals (N, 2)."""
    revolutions = np.arctan2(errors[:, 1], errors[:, 0]) / (2 * np.pi)
    hues = np.rint(revolutions * _HUES).astype(np.int64) % _HUES
    for hue in range(_HUES):
        path = "".join(compress(marks, hues == hue))
        if path:
            yield f'<path class="{name}" stroke="hsl({360 * hue // _HUES},70%,45%)" d="{path}"/>'


def _round_up(value: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is not below `value` (> 0)."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9))


def _shorten_name(text: str) -> str:
    return _escape(text if len(text) <= _MAX_LETTERS else "..." + text[3 - _MAX_LETTERS :])


def _escape(text: str) -> str:
    return escape(make_one_line(text))
