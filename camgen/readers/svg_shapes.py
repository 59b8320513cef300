"""The basic shapes of SVG as the subpaths that they stand for (SVG 1.1, chapter 9)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from camgen.readers.svg_path import Oval, Run, Track, tracks
from camgen.readers.svg_values import Malformed, length, numbers

View = tuple[float, float]
Attributes = Mapping[str, str]


def shape(kind: str, attributes: Attributes, view: View) -> tuple[list[Track], str]:
    """The subpaths of a shape and what is wrong with it. Raises Malformed where nothing of it can be drawn."""
    return _SHAPES[kind](attributes, view)


def _value(attributes: Attributes, name: str, view: View, default: float = 0.0) -> float:
    text = attributes.get(name)
    return default if text is None or text.strip() == "auto" else length(text, name, view)


def _path(attributes: Attributes, view: View) -> tuple[list[Track], str]:  # noqa: ARG001 (one of a table)
    return tracks(attributes.get("d", ""))


def _line(attributes: Attributes, view: View) -> tuple[list[Track], str]:
    x1, y1, x2, y2 = (_value(attributes, name, view) for name in ("x1", "y1", "x2", "y2"))
    return [Track((np.array([[x1, y1], [x2, y2]]),), False)], ""


def _points(attributes: Attributes, closed: bool) -> tuple[list[Track], str]:
    values = numbers(attributes.get("points", ""))
    fault = "an odd number of coordinates" if len(values) % 2 else ""
    points = np.array(values[: len(values) // 2 * 2]).reshape(-1, 2)
    if closed and len(points):
        points = np.concatenate([points, points[:1]])
    return ([Track((points,), closed)] if len(points) > 1 else []), fault


def _polyline(attributes: Attributes, view: View) -> tuple[list[Track], str]:  # noqa: ARG001
    return _points(attributes, False)


def _polygon(attributes: Attributes, view: View) -> tuple[list[Track], str]:  # noqa: ARG001
    return _points(attributes, True)


def _rect(attributes: Attributes, view: View) -> tuple[list[Track], str]:
    x, y, w, h = (_value(attributes, name, view) for name in ("x", "y", "width", "height"))
    if w < 0 or h < 0:
        raise Malformed("a negative size")
    if w == 0 or h == 0:
        return [], ""
    rx, ry = _value(attributes, "rx", view, math.nan), _value(attributes, "ry", view, math.nan)
    rx, ry = (ry if math.isnan(rx) else rx), (rx if math.isnan(ry) else ry)
    rx, ry = (0.0, 0.0) if math.isnan(rx) or min(rx, ry) <= 0 else (min(rx, w / 2), min(ry, h / 2))
    if rx == 0:
        corners = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]])
        return [Track((corners,), True)], ""
    runs: list[Run] = []
    quarter = math.pi / 2
    first, second = np.array([rx, 0.0]), np.array([0.0, ry])
    sides = (
        ((x + rx, y), (x + w - rx, y), (x + w - rx, y + ry), -1),
        ((x + w, y + ry), (x + w, y + h - ry), (x + w - rx, y + h - ry), 0),
        ((x + w - rx, y + h), (x + rx, y + h), (x + rx, y + h - ry), 1),
        ((x, y + h - ry), (x, y + ry), (x + rx, y + ry), 2),
    )
    for begin, end, center, turn in sides:
        runs.append(np.array([begin, end]))
        runs.append(Oval(np.array(center), first, second, turn * quarter, (turn + 1) * quarter))
    return [Track(tuple(runs), True)], ""


def _round(attributes: Attributes, view: View, rx: float, ry: float) -> tuple[list[Track], str]:
    if rx < 0 or ry < 0:
        raise Malformed("a negative radius")
    if rx == 0 or ry == 0:
        return [], ""
    center = np.array([_value(attributes, "cx", view), _value(attributes, "cy", view)])
    oval = Oval(center, np.array([rx, 0.0]), np.array([0.0, ry]), 0.0, 2 * math.pi)
    return [Track((oval,), True)], ""


def _circle(attributes: Attributes, view: View) -> tuple[list[Track], str]:
    radius = _value(attributes, "r", view)
    return _round(attributes, view, radius, radius)


def _ellipse(attributes: Attributes, view: View) -> tuple[list[Track], str]:
    rx, ry = _value(attributes, "rx", view, math.nan), _value(attributes, "ry", view, math.nan)
    rx, ry = (ry if math.isnan(rx) else rx), (rx if math.isnan(ry) else ry)
    return _round(attributes, view, *((0.0, 0.0) if math.isnan(rx) else (rx, ry)))


_SHAPES: dict[str, Callable[[Attributes, View], tuple[list[Track], str]]] = {
    "path": _path,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polygon,
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
}
KINDS = frozenset(_SHAPES)
