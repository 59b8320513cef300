"""Numbers, lengths and viewports of SVG."""

from __future__ import annotations

import math
import re

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LENGTH = re.compile(rf"\s*({NUMBER.pattern})([a-zA-Z%]*)\s*")
#: Commas that are not between two numbers.
STRAY_COMMA = re.compile(r",\s*,|^\s*,|,\s*$")

#: px of each absolute unit: 96 px are an inch (CSS 2.1, section 4.3.2).
PX = {
    "": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6,
    "pt": 96 / 72, "pc": 16.0,
}  # fmt: skip
MM_PER_PX = 25.4 / 96
_AXES = {
    "width": 0,
    "x": 0,
    "x1": 0,
    "x2": 0,
    "cx": 0,
    "rx": 0,
    "height": 1,
    "y": 1,
    "y1": 1,
    "y2": 1,
    "cy": 1,
    "ry": 1,
}


class Malformed(ValueError):
    """A value that cannot be read, with a text of one line that names it."""

    def __init__(self, text: str) -> None:
        super().__init__("".join(sign if sign.isprintable() else " " for sign in text))


def length(text: str, name: str, view: tuple[float, float]) -> float:
    """A length in user units. Raises Malformed.

    view: width and height of the viewport, for percentages.
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise Malformed(f"{name} is not a length: {text[:20]!r}")
    value, unit = float(match[1]), match[2].lower()
    if unit == "%":
        # A length along neither x nor y is measured by the diagonal (section 7.10).
        along = view[_AXES[name]] if name in _AXES else math.hypot(*view) / math.sqrt(2)
        return value / 100 * along
    if unit not in PX:
        raise Malformed(f"{name} has the unit {unit}")
    return value * PX[unit]


def numbers(text: str) -> list[float]:
    """All numbers of a list with commas and spaces, as far as it is one."""
    texts = NUMBER.findall(text)
    is_list = "".join(texts) == "".join(text.replace(",", " ").split())
    if not is_list or STRAY_COMMA.search(text):
        raise Malformed(f"not a list of numbers: {text[:20]!r}")
    return list(map(float, texts))


def read_css_length(text: str, name: str, whole: float) -> float:
    """A length of CSS in user units, which needs a unit if it is not 0. Raises Malformed.

    whole: length of 100 %.
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise Malformed(f"{name} has {text[:20]}, which is not a length")
    if match[2] == "%":
        return float(match[1]) / 100 * whole
    if not match[2] and float(match[1]):
        raise Malformed(f"{name} has {text[:20]} without a unit")
    return length(text, name, (0.0, 0.0))


def combine(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """The matrix (2, 3) that does ``inner`` and then ``outer``."""
    return np.column_stack([outer[:, :2] @ inner[:, :2], outer[:, :2] @ inner[:, 2] + outer[:, 2]])


class ViewBox(Struct, frozen=True):
    """A viewBox: x, y, width, height in user units."""

    x: float
    y: float
    width: float
    height: float


def view_box(text: str | None) -> ViewBox | None:
    """The box of a viewBox attribute; None without one. Raises Malformed for a box without area."""
    if text is None or not text.strip():
        return None
    values = numbers(text)
    if len(values) != 4 or not all(map(math.isfinite, values)) or values[2] <= 0 or values[3] <= 0:
        raise Malformed("viewBox is not a box")
    return ViewBox(*values)


def fit_viewport(box: ViewBox, width: float, height: float, aspect: str) -> FloatArray:
    """The matrix (2, 3) from a box to a viewport of this size, by preserveAspectRatio."""
    words = [word for word in aspect.split() if word != "defer"] or ["xMidYMid"]
    sx, sy = width / box.width, height / box.height
    if words[0] == "none":
        return np.array([[sx, 0.0, -box.x * sx], [0.0, sy, -box.y * sy]])
    place = re.fullmatch(r"x(Min|Mid|Max)Y(Min|Mid|Max)", words[0])
    if place is None:
        raise Malformed("preserveAspectRatio is unknown")
    scale = max(sx, sy) if words[1:] == ["slice"] else min(sx, sy)
    shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
    left = (width - box.width * scale) * shares[place[1]]
    top = (height - box.height * scale) * shares[place[2]]
    return np.array([[scale, 0.0, left - box.x * scale], [0.0, scale, top - box.y * scale]])
