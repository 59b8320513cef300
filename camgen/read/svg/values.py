"""Numbers, lengths, transforms and viewports of SVG 1.1 (chapters 4 and 7) as matrices."""

from __future__ import annotations

import math
import re

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LENGTH = re.compile(rf"\s*({NUMBER.pattern})\s*([a-zA-Z%]*)\s*")
_FUNCTION = re.compile(r"[\s,]*(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]*)\)")

#: px of each absolute unit: 96 px are an inch (CSS 2.1, section 4.3.2).
PX = {
    "": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 96 / 101.6, "pt": 96 / 72, "pc": 16.0,
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
    """A value that cannot be read; the text says which."""


def length(text: str, name: str, view: tuple[float, float]) -> float:
    """A length in user units. view: width and height of the viewport, for percentages. Raises Malformed."""
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise Malformed(f"{name} is no length")
    value, unit = float(match[1]), match[2].lower()
    if unit == "%":
        # What is neither along x nor y is measured by the diagonal (section 7.10).
        along = view[_AXES[name]] if name in _AXES else math.hypot(*view) / math.sqrt(2)
        return value / 100 * along
    if unit not in PX:
        raise Malformed(f"{name} has the unit {unit}")
    return value * PX[unit]


def numbers(text: str) -> list[float]:
    """All numbers of a list with commas and spaces, as far as it is one."""
    found = NUMBER.findall(text)
    if "".join(found) != "".join(text.replace(",", " ").split()):
        raise Malformed("not a list of numbers")
    return [float(v) for v in found]


def transform(text: str) -> FloatArray:
    """The matrix (2, 3) of a transform list, the last one applied first. Raises Malformed."""
    total, at = np.eye(3), 0
    while text[at:].strip(" \t\r\n,"):
        match = _FUNCTION.match(text, at)
        if match is None:
            raise Malformed("unknown transform")
        total = total @ _matrix(match[1], numbers(match[2]))
        at = match.end()
    return np.asarray(total[:2])


def _matrix(name: str, v: list[float]) -> FloatArray:
    count = len(v)
    matrix = np.eye(3)
    if name == "matrix" and count == 6:
        matrix[:2] = np.array(v).reshape(3, 2).T
    elif name == "translate" and count in (1, 2):
        matrix[:2, 2] = v[0], (v[1] if count == 2 else 0.0)
    elif name == "scale" and count in (1, 2):
        matrix[0, 0], matrix[1, 1] = v[0], v[-1]
    elif name == "rotate" and count in (1, 3):
        c, s = _cos_sin(v[0])
        x, y = v[1:] or (0.0, 0.0)
        matrix[:2] = [[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y]]
    elif name == "skewX" and count == 1:
        matrix[0, 1] = math.tan(math.radians(v[0]))
    elif name == "skewY" and count == 1:
        matrix[1, 0] = math.tan(math.radians(v[0]))
    else:
        raise Malformed(f"{name} with {count} numbers")
    return matrix


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Exact at right angles, so that turned rectangles stay square to the axes."""
    turns = degrees / 90
    if turns == round(turns):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(turns) % 4]
    return math.cos(math.radians(degrees)), math.sin(math.radians(degrees))


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
    """The box of a viewBox attribute; None where there is none. Raises Malformed for one that is empty or no box."""
    if text is None or not text.strip():
        return None
    values = numbers(text)
    if len(values) != 4 or not all(map(math.isfinite, values)) or values[2] <= 0 or values[3] <= 0:
        raise Malformed("viewBox is no box")
    return ViewBox(*values)


def fit_viewport(box: ViewBox, width: float, height: float, aspect: str) -> FloatArray:
    """The matrix (2, 3) from ``box`` to a viewport of this size, by preserveAspectRatio (section 7.8)."""
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
