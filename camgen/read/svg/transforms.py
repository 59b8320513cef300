"""Transforms of SVG elements (CSS Transforms 1 and 2) as matrices (2, 3).

`transform` is an attribute with numbers alone or a property of CSS with units; `translate`,
`rotate` and `scale` are properties alone. All are applied about `transform-origin`, which is
measured in the reference box that `transform-box` names.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np

from camgen.model.pose import FloatArray
from camgen.read.svg.style import Style
from camgen.read.svg.values import NUMBER, Malformed, ViewBox, combine, numbers, read_css_length
from camgen.read.svg.vocabulary import TRANSFORMS

_FUNCTION = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)")
_CSS_FUNCTION = re.compile(r"\s*([a-zA-Z0-9]+)\(([^()]*)\)")
#: Degrees of each unit of an angle.
_DEGREES = {"deg": 1.0, "grad": 0.9, "rad": 180 / math.pi, "turn": 360.0}
_ANGLE = re.compile(rf"({NUMBER.pattern})(deg|grad|rad|turn)")
_ORIGIN = frozenset({"transform-origin", "transform-box"})
_PLAIN_NUMBER = re.compile(rf"(?<!\S)({NUMBER.pattern})(?!\S)")
#: Places in a box, as fractions of its size.
_KEYWORDS = {"left": 0.0, "top": 0.0, "center": 0.5, "right": 1.0, "bottom": 1.0}
#: Reference boxes of shapes. A box with the stroke is not computed.
_OBJECT_BOXES = ("fill-box", "content-box")

#: Gives the box of an element without its stroke, user units. Raises Malformed if it cannot.
MeasureBox = Callable[[], ViewBox]


def read_transform(text: str) -> FloatArray:
    """The matrix of a transform attribute, the last function applied first. Raises Malformed."""
    total, position = np.eye(3), 0
    while text[position:].strip(" \t\r\n,"):
        match = _FUNCTION.match(text, position)
        if match is None:
            raise Malformed(f"unknown transform {text[:40]}")
        total = total @ _matrix(match[1], numbers(match[2]))
        position = match.end()
    return np.asarray(total[:2])


def _matrix(name: str, values: list[float]) -> FloatArray:
    count = len(values)
    matrix = np.eye(3)
    if name == "matrix" and count == 6:
        matrix[:2] = np.array(values).reshape(3, 2).T
    elif name == "translate" and count in (1, 2):
        matrix[:2, 2] = values[0], (values[1] if count == 2 else 0.0)
    elif name == "scale" and count in (1, 2):
        matrix[0, 0], matrix[1, 1] = values[0], values[-1]
    elif name == "rotate" and count in (1, 3):
        cosine, sine = _cos_sin(values[0])
        x, y = values[1:] or (0.0, 0.0)
        matrix[:2] = [
            [cosine, -sine, x - cosine * x + sine * y],
            [sine, cosine, y - sine * x - cosine * y],
        ]
    elif name == "skewX" and count == 1:
        matrix[0, 1] = math.tan(math.radians(values[0]))
    elif name == "skewY" and count == 1:
        matrix[1, 0] = math.tan(math.radians(values[0]))
    else:
        raise Malformed(f"transform {name} with {count} numbers")
    return matrix


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Exact at right angles, so that turned rectangles stay square to the axes."""
    quarters = degrees / 90
    if quarters == round(quarters):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    return math.cos(math.radians(degrees)), math.sin(math.radians(degrees))


def find_matrix(
    attributes: Mapping[str, str], style: Style, view: ViewBox, measure: MeasureBox
) -> FloatArray | None:
    """The matrix of an element in the user units around it; None if it has no transform.

    view: reference box of elements without a `transform-box`.
    measure: gives the box of the element itself.
    Raises Malformed for a transform that is not read.
    """
    text = attributes.get("transform")
    if style.keys().isdisjoint(TRANSFORMS) and _ORIGIN.isdisjoint(attributes):
        return None if text is None else read_transform(text)
    if "transform" not in style and text is None and style.keys().isdisjoint(_SINGLE):
        return None
    box = _find_box(attributes, style, view, measure)
    matrix = np.eye(3)
    for name in _SINGLE:
        value = style.get(name, "none")
        if value != "none":
            matrix = matrix @ _read_single(name, value, box)
    value = style.get("transform", "")
    if value:
        matrix = matrix @ _read_css_transform(value, box)
    elif text is not None:
        matrix[:2] = combine(matrix[:2], read_transform(text))
    x, y = _find_origin(attributes, style, box)
    return combine(combine(_shift(x, y)[:2], matrix[:2]), _shift(-x, -y)[:2])


def _find_box(
    attributes: Mapping[str, str], style: Style, view: ViewBox, measure: MeasureBox
) -> ViewBox:
    name = style.get("transform-box", attributes.get("transform-box", "view-box"))
    if name == "view-box":
        return view
    if name in _OBJECT_BOXES:
        return measure()
    raise Malformed(f"transform-box {name[:40]} is not read")


def _shift(x: float, y: float) -> FloatArray:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _find_origin(attributes: Mapping[str, str], style: Style, box: ViewBox) -> tuple[float, float]:
    text = style.get("transform-origin")
    if text is None:
        # Only an attribute has lengths without a unit.
        text = _PLAIN_NUMBER.sub(r"\1px", attributes.get("transform-origin", "0 0"))
    words = text.split()
    if len(words) == 1:
        words.append("center")
    if words[0] in ("top", "bottom") or words[1] in ("left", "right"):
        words[:2] = words[1], words[0]
    if len(words) not in (2, 3) or words[0] in ("top", "bottom") or words[1] in ("left", "right"):
        raise Malformed(f"transform-origin {text[:40]} is not read")
    return box.x + _place(words[0], box.width), box.y + _place(words[1], box.height)


def _place(word: str, size: float) -> float:
    if word in _KEYWORDS:
        return _KEYWORDS[word] * size
    return read_css_length(word, "transform-origin", size)


def _read_css_transform(text: str, box: ViewBox) -> FloatArray:
    """The matrix (3, 3) of a transform property."""
    total, position = np.eye(3), 0
    if text == "none":
        return total
    while text[position:].strip():
        match = _CSS_FUNCTION.match(text, position)
        if match is None:
            raise Malformed(f"transform {text[:40]} is not read")
        values = [value.strip() for value in match[2].split(",")] if match[2].strip() else []
        total = total @ _css_matrix(match[1].lower(), values, box)
        position = match.end()
    return total


def _css_matrix(name: str, values: list[str], box: ViewBox) -> FloatArray:
    counts, read = _CSS_FUNCTIONS.get(name, ((), None))
    if read is None or len(values) not in counts:
        raise Malformed(f"transform {name[:20]} with {len(values)} values is not read")
    return read(values, box)


def _angle(text: str) -> float:
    """Degrees."""
    match = _ANGLE.fullmatch(text.lower())
    if match is not None:
        return float(match[1]) * _DEGREES[match[2]]
    if _number(text) == 0:
        return 0.0
    raise Malformed(f"the angle {text[:20]} has no unit")


def _number(text: str) -> float:
    if NUMBER.fullmatch(text) is None:
        raise Malformed(f"{text[:20]} is not a number")
    return float(text)


def _scale_factor(text: str) -> float:
    return _number(text[:-1]) / 100 if text.endswith("%") else _number(text)


def _translate(values: list[str], box: ViewBox) -> FloatArray:
    x = read_css_length(values[0], "translate", box.width)
    y = read_css_length(values[1], "translate", box.height) if len(values) > 1 else 0.0
    return _shift(x, y)


def _scale(values: list[str], _box: ViewBox) -> FloatArray:
    return _matrix("scale", list(map(_scale_factor, values)))


def _rotate(values: list[str], _box: ViewBox) -> FloatArray:
    return _matrix("rotate", [_angle(values[0])])


def _skew(values: list[str], _box: ViewBox) -> FloatArray:
    matrix = np.eye(3)
    matrix[0, 1] = math.tan(math.radians(_angle(values[0])))
    matrix[1, 0] = math.tan(math.radians(_angle(values[1]))) if len(values) > 1 else 0.0
    return matrix


#: Reads a function of CSS from its values.
_Read = Callable[[list[str], ViewBox], FloatArray]
#: Functions of CSS in the plane: the numbers of values that they take, and their matrices.
_CSS_FUNCTIONS: dict[str, tuple[tuple[int, ...], _Read]] = {
    "translate": ((1, 2), _translate),
    "translatex": ((1,), _translate),
    "translatey": ((1,), lambda values, box: _translate(["0", *values], box)),
    "scale": ((1, 2), _scale),
    "scalex": ((1,), lambda values, box: _scale([*values, "1"], box)),
    "scaley": ((1,), lambda values, box: _scale(["1", *values], box)),
    "rotate": ((1,), _rotate),
    "rotatez": ((1,), _rotate),
    "skew": ((1, 2), _skew),
    "skewx": ((1,), _skew),
    "skewy": ((1,), lambda values, box: _skew(["0", *values], box)),
    "matrix": ((6,), lambda values, _box: _matrix("matrix", list(map(_number, values)))),
}


def _read_single(name: str, text: str, box: ViewBox) -> FloatArray:
    """The matrix of a property translate, rotate or scale."""
    if name == "rotate":
        text = text.removeprefix("z ").removeprefix("0 0 1 ")
    values = text.split()
    # A third value is a move or a scale along z.
    values = values[:2] if len(values) == 3 else values
    return _css_matrix(name, values, box)


#: Properties of a single transform, in the order of their matrices.
_SINGLE = ("translate", "rotate", "scale")
