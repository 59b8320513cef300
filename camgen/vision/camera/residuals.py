"""The residuals of a calibration as one SVG file: where in the photo they point which way, and how large per photo."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from camgen.model.errors import one_line
from camgen.model.pose import FloatArray
from camgen.model.text import escape, short
from camgen.vision.camera.calibrate import Calibration

#: Page mm: the photo fits into this box; beside it the bars; below it the cloud of all residuals.
_WIDE, _HIGH, _MARGIN, _TOP = 180.0, 135.0, 8.0, 20.0
_BARS, _NAMES, _LINE_HEIGHT_MM = 46.0, 34.0, 4.2
_CLOUD = 52.0
#: A residual as large as the rms is drawn so long, page mm, or a little less: the factor is a round one.
_ARROW_MM = 3.0
#: Directions are coloured around the circle in so many steps, so that a pattern of the lens shows as areas of a colour.
_HUES = 12
#: Names in the list of photos are cut to so many characters.
_MOST_LETTERS = 18

_STYLE = """\
.bg{fill:#fff}.frame{fill:none;stroke:#9aa0a6;stroke-width:.3}.axis{stroke:#9aa0a6;stroke-width:.2;fill:none}
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.1px;fill:#202124}.big{font-size:4.6px;font-weight:600}
.bar{fill:#1f6feb}.warn{fill:#d0103a}.r{text-anchor:end}.arrow{fill:none;stroke-width:.3;stroke-linecap:round}
.dot{stroke-width:.7;stroke-linecap:round;fill:none;opacity:.6}.cross{stroke:#5f6368;stroke-width:.35}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}.warn{fill:#ff6b81}.cross{stroke:#bdc1c6}}"""


def svg(found: Calibration, title: str) -> str:
    """The picture as SVG text, sized in mm, legible on light and dark."""
    width, height = found.camera.size
    scale = min(_WIDE / width, _HIGH / height)
    wide, high = width * scale, height * scale
    lines = len(found.used) + 2 + len(found.left_out) + bool(found.left_out)
    page_w = 2 * _MARGIN + wide + 8 + _NAMES + _BARS
    page_h = _TOP + max(high + 10 + _CLOUD, lines * _LINE_HEIGHT_MM) + _MARGIN
    factor = _round_factor(found.rms / _ARROW_MM * scale)
    said = f"{short(found.rms, 3)} px rms; strokes {short(factor, 1)} times their length in px, coloured by direction"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{page_w:.2f}mm" height="{page_h:.2f}mm" '
            f'viewBox="0 0 {page_w:.2f} {page_h:.2f}">',
            f"<title>{_text(title)}</title>",
            f"<style>{_STYLE}</style>",
            '<rect class="bg" width="100%" height="100%"/>',
            f'<text class="big" x="{_MARGIN}" y="9">{_text(title)}</text>',
            f'<text x="{_MARGIN}" y="15">{said}</text>',
            *_arrows(found, scale, factor),
            *_cloud(found, _TOP + high + 8),
            *_bars(found, _MARGIN + wide + 8),
            "</svg>\n",
        ]
    )


def _arrows(found: Calibration, scale: float, factor: float) -> Iterator[str]:
    """The photo's frame, the principal point, and a stroke from where each corner was calculated to where it was seen,
    lengthened. One path per direction.
    """
    width, height = (v * scale for v in found.camera.size)
    yield f'<rect class="frame" x="{_MARGIN}" y="{_TOP}" width="{width:.2f}" height="{height:.2f}"/>'
    corners = np.concatenate([one.seen.corners for one in found.used])
    errors = np.concatenate([one.errors for one in found.used])
    # The centre of the first pixel is (0, 0): the photo begins half a pixel before it.
    start = (corners - errors + 0.5) * scale + (_MARGIN, _TOP)
    end = start + errors * (factor * scale)
    hue = _hues(errors)
    for step in range(_HUES):
        strokes = [
            f"M{x0:.2f} {y0:.2f}L{x1:.2f} {y1:.2f}"
            for (x0, y0), (x1, y1) in zip(
                start[hue == step].tolist(), end[hue == step].tolist(), strict=True
            )
        ]
        if strokes:
            yield f'<path class="arrow" stroke="{_colour(step)}" d="{"".join(strokes)}"/>'
    x, y = ((found.camera.matrix[:2, 2] + 0.5) * scale + (_MARGIN, _TOP)).tolist()
    yield f'<path class="cross" d="M{x - 2:.2f} {y:.2f}h4M{x:.2f} {y - 2:.2f}v4"/>'


def _cloud(found: Calibration, top: float) -> Iterator[str]:
    """All residuals as dots about their zero, in a square of a round number of px."""
    errors = np.concatenate([one.errors for one in found.used])
    most = float(np.abs(errors).max())
    reach = _round_up(most) if most > 0 else 1.0
    half = _CLOUD / 2
    x, y = _MARGIN + half, top + half
    yield f'<rect class="frame" x="{_MARGIN}" y="{top:.2f}" width="{_CLOUD}" height="{_CLOUD}"/>'
    yield f'<path class="axis" d="M{_MARGIN} {y:.2f}h{_CLOUD}M{x:.2f} {top:.2f}v{_CLOUD}"/>'
    dots = errors * (half / reach) + (x, y)
    hue = _hues(errors)
    for step in range(_HUES):
        marks = [f"M{u:.2f} {v:.2f}h0" for u, v in dots[hue == step].tolist()]
        if marks:
            yield f'<path class="dot" stroke="{_colour(step)}" d="{"".join(marks)}"/>'
    words = ("all corners, seen less calculated:", f"the square is {short(2 * reach, 6)} px wide")
    for i, line in enumerate(words):
        yield f'<text x="{_MARGIN + _CLOUD + 4:.2f}" y="{top + 5 + i * _LINE_HEIGHT_MM:.2f}">{line}</text>'


def _bars(found: Calibration, left: float) -> Iterator[str]:
    """The rms of each photo, and the photos left out."""
    longest = max(one.rms for one in found.used) or 1.0
    y = _TOP + 3
    yield f'<text x="{left:.2f}" y="{y:.2f}">px rms of each photo</text>'
    for one in found.used:
        y += _LINE_HEIGHT_MM
        length = (_BARS - 14) * one.rms / longest
        yield f'<text x="{left:.2f}" y="{y:.2f}">{_name(one.name)}</text>'
        yield f'<rect class="bar" x="{left + _NAMES:.2f}" y="{y - 2.6:.2f}" width="{length:.2f}" height="3"/>'
        yield f'<text x="{left + _NAMES + length + 1.5:.2f}" y="{y:.2f}">{short(one.rms, 3)}</text>'
    if found.left_out:
        y += 2 * _LINE_HEIGHT_MM
        yield f'<text class="warn" x="{left:.2f}" y="{y:.2f}">left out</text>'
    for other in found.left_out:
        y += _LINE_HEIGHT_MM
        hint = f"<title>{_text(other.why)}</title>"
        yield f'<text class="warn" x="{left:.2f}" y="{y:.2f}">{_name(other.name)}{hint}</text>'


def _hues(errors: FloatArray) -> NDArray[np.int64]:
    turn = np.arctan2(errors[:, 1], errors[:, 0]) / (2 * np.pi)
    return np.rint(turn * _HUES).astype(np.int64) % _HUES


def _colour(step: int) -> str:
    return f"hsl({360 * step // _HUES},70%,45%)"


def _round_factor(mm_per_long: float) -> float:
    """How many times longer: 1, 2 or 5 times a power of ten."""
    return 1 / _round_up(mm_per_long) if mm_per_long > 0 else 1.0


def _round_up(value: float) -> float:
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9))


def _name(text: str) -> str:
    return _text(text if len(text) <= _MOST_LETTERS else "..." + text[3 - _MOST_LETTERS :])


def _text(text: str) -> str:
    return escape(one_line(text))
