"""Path data and basic shapes of SVG 1.1 (chapters 8 and 9) as runs of lines, Bezier segments and elliptical arcs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import accumulate

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.read.svg.values import NUMBER, Malformed, length, numbers

#: Letters and what is between them.
_COMMANDS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])")
_SEPARATORS = str.maketrans("", "", " \t\r\n\f,")
#: The two flags of an arc are one digit each and need nothing around them.
_N = rf"[\s,]*({NUMBER.pattern})"
_NUMBER = re.compile(_N)
_ARC = re.compile(_N * 3 + r"[\s,]*([01])[\s,]*([01])" + _N * 2)
#: Ends and radii of arcs, and their inverse: squares of what is beyond this are no numbers any more.
_FARTHEST = 1e100
#: From so many numbers on lines are taken together.
_MANY = 8
#: Numbers that a command takes at a time.
_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


class Oval(Struct, frozen=True, eq=False):
    """The arc center + first cos t + second sin t, t from start to end (rad); conjugate half diameters (2,)."""

    center: FloatArray
    first: FloatArray
    second: FloatArray
    start: float
    end: float


#: Points (N, 2) of lines, control points (S, degree + 1, 2) of Bezier segments, or an elliptical arc.
Run = FloatArray | Oval


class Subpath(Struct, frozen=True, eq=False):
    """One subpath: runs end to end, in user units."""

    runs: tuple[Run, ...]
    closed: bool


def tracks(data: str) -> tuple[list[Subpath], str]:
    """The subpaths of the path data up to its first fault, and what that is: "" for none (section 8.3.9)."""
    pen = _Pen()
    try:
        for letter, values in _commands(data):
            pen.draw(letter, values)
    except Malformed as error:
        pen.finish(False)
        return pen.done, str(error)
    pen.finish(False)
    return pen.done, ""


def _commands(data: str) -> Iterator[tuple[str, list[float]]]:
    parts = _COMMANDS.split(data)
    if parts[0].translate(_SEPARATORS):
        raise Malformed("path data begins without a command")
    for letter, text in zip(parts[1::2], parts[2::2], strict=True):
        arc = letter in "Aa"
        found = [v for group in _ARC.findall(text) for v in group] if arc else NUMBER.findall(text)
        size = _TAKES[letter.upper()]
        clean = "".join(found) == text.translate(_SEPARATORS)
        if not clean:
            found = _good(_ARC if arc else _NUMBER, text)
        whole = len(found) // size * size if size else 0
        yield letter, [float(v) for v in found[:whole]]
        if not clean or whole != len(found) or (size and not found):
            raise Malformed(f"path data is damaged in a {letter} command")


def _good(pattern: re.Pattern[str], text: str) -> list[str]:
    """The numbers up to the first thing that is none."""
    found: list[str] = []
    match = pattern.match(text)
    while match:
        found += match.groups()
        match = pattern.match(text, match.end())
    return found


class _Pen:
    """The state that path data changes: where the pen is, where the subpath began, the last control point."""

    def __init__(self) -> None:
        self.done: list[Subpath] = []
        self.runs: list[Run] = []
        self.rows: list[tuple[float, ...]] = []
        self.size = 0
        self.x = self.y = self.x0 = self.y0 = 0.0
        #: The control point that S and T mirror, and the degree of the segment it belongs to.
        self.control = (0.0, 0.0, 0)
        self.begun = False

    def draw(self, letter: str, values: list[float]) -> None:
        """One command with all its repetitions."""
        command = letter.upper()
        if not self.begun and command != "M":
            raise Malformed("path data begins without M")
        if command == "Z":
            self._close()
            return
        size = _TAKES[command]
        relative = letter != command
        if command == "L" and len(values) > _MANY:
            self._lines(values, relative)
            return
        step = getattr(self, f"_{command.lower()}")
        for k in range(0, len(values), size):
            step(values[k : k + size], relative)
            if command == "M":
                # Further pairs are lines.
                step = self._l

    def finish(self, closed: bool) -> None:
        """Ends the subpath."""
        self._flush()
        if self.runs:
            self.done.append(Subpath(tuple(self.runs), closed))
        self.runs = []

    def _flush(self) -> None:
        if self.rows and (self.size != 2 or len(self.rows) > 1):
            array = np.array(self.rows)
            self.runs.append(array if self.size == 2 else array.reshape(len(array), -1, 2))
        self.rows = []

    def _close(self) -> None:
        if (self.x, self.y) != (self.x0, self.y0):
            self._to(self.x0, self.y0)
        self.finish(True)
        self.control = (0.0, 0.0, 0)

    def _to(self, x: float, y: float) -> None:
        if self.size != 2 or not self.rows:
            self._flush()
            self.size = 2
            self.rows.append((self.x, self.y))
        self.rows.append((x, y))
        self.x, self.y = x, y
        self.control = (x, y, 1)

    def _curve(self, row: tuple[float, ...]) -> None:
        if self.size != len(row):
            self._flush()
            self.size = len(row)
        self.rows.append(row)
        self.x, self.y = row[-2:]
        self.control = (row[-4], row[-3], len(row) // 2 - 1)

    def _mirrored(self, degree: int) -> tuple[float, float]:
        if self.control[2] != degree:
            return self.x, self.y
        return 2 * self.x - self.control[0], 2 * self.y - self.control[1]

    def _m(self, v: list[float], relative: bool) -> None:
        self.finish(False)
        self.x, self.y = (self.x + v[0], self.y + v[1]) if relative else (v[0], v[1])
        self.x0, self.y0, self.begun = self.x, self.y, True
        self.control = (0.0, 0.0, 0)

    def _l(self, v: list[float], relative: bool) -> None:
        self._to(*((self.x + v[0], self.y + v[1]) if relative else v))

    def _lines(self, v: list[float], relative: bool) -> None:
        """Many lines at once."""
        self._l(v[:2], relative)
        ways = v[2::2], v[3::2]
        if relative:
            xs, ys = (
                list(accumulate(way, initial=at))[1:]
                for way, at in zip(ways, (self.x, self.y), strict=True)
            )
        else:
            xs, ys = ways
        self.rows.extend(zip(xs, ys, strict=True))
        self.x, self.y = xs[-1], ys[-1]
        self.control = (self.x, self.y, 1)

    def _h(self, v: list[float], relative: bool) -> None:
        self._to(self.x + v[0] if relative else v[0], self.y)

    def _v(self, v: list[float], relative: bool) -> None:
        self._to(self.x, self.y + v[0] if relative else v[0])

    def _c(self, v: list[float], relative: bool) -> None:
        x, y = self.x, self.y
        if relative:
            self._curve((x, y, x + v[0], y + v[1], x + v[2], y + v[3], x + v[4], y + v[5]))
        else:
            self._curve((x, y, *v))

    def _s(self, v: list[float], relative: bool) -> None:
        first = self._mirrored(3)
        x, y = (self.x, self.y) if relative else (0.0, 0.0)
        self._curve((self.x, self.y, *first, x + v[0], y + v[1], x + v[2], y + v[3]))

    def _q(self, v: list[float], relative: bool) -> None:
        x, y = (self.x, self.y) if relative else (0.0, 0.0)
        self._curve((self.x, self.y, x + v[0], y + v[1], x + v[2], y + v[3]))

    def _t(self, v: list[float], relative: bool) -> None:
        x, y = (self.x, self.y) if relative else (0.0, 0.0)
        self._curve((self.x, self.y, *self._mirrored(2), x + v[0], y + v[1]))

    def _a(self, v: list[float], relative: bool) -> None:
        rx, ry, turn, large, sweep, x, y = v
        if relative:
            x, y = self.x + x, self.y + y
        if (x, y) == (self.x, self.y):
            return
        if rx == 0 or ry == 0:
            self._to(x, y)
            return
        if (
            max(map(abs, (self.x, self.y, x, y, rx, ry))) > _FARTHEST
            or min(abs(rx), abs(ry)) < 1 / _FARTHEST
        ):
            raise Malformed("an arc beyond all measure")
        self._flush()
        self.size = 0
        self.runs.append(
            _oval((self.x, self.y), (x, y), (abs(rx), abs(ry)), turn, bool(large), bool(sweep))
        )
        self.x, self.y = x, y
        self.control = (x, y, 0)


def _oval(
    a: tuple[float, float],
    b: tuple[float, float],
    radii: tuple[float, float],
    turn: float,
    large: bool,
    sweep: bool,
) -> Oval:
    """From end points to centre (appendix F.6): on the unit circle, where the radii are one."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    first, second = np.array([c, s]) * radii[0], np.array([-s, c]) * radii[1]
    start, end = np.array(a), np.array(b)
    # The chord in units of the radii; radii too small for it are enlarged until it is a diameter.
    chord = np.array(
        [(end - start) @ first / radii[0] ** 2, (end - start) @ second / radii[1] ** 2]
    )
    half = float(np.hypot(*chord)) / 2
    if half >= 1:
        first, second, chord, half = first * half, second * half, chord / half, 1.0
    middle = (start + end) / 2
    # The centre lies to the left of the chord (in these axes) where large and sweep differ.
    away = math.sqrt(max(0.0, 1 - half * half)) / (2 * half) * (1 if large != sweep else -1)
    offset = np.array([-chord[1], chord[0]]) * away
    center = middle + first * offset[0] + second * offset[1]
    low = -chord / 2 - offset
    begin = math.atan2(low[1], low[0])
    angle = 2 * math.asin(min(1.0, half))
    angle = 2 * math.pi - angle if large else angle
    return Oval(center, first, second, begin, begin + (angle if sweep else -angle))


# The basic shapes of SVG as the subpaths that they stand for (SVG 1.1, chapter 9).

View = tuple[float, float]
Attributes = Mapping[str, str]


def shape(kind: str, attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    """The subpaths of a shape and what is wrong with it. Raises Malformed where nothing of it can be drawn."""
    return _SHAPES[kind](attributes, view)


def _value(attributes: Attributes, name: str, view: View, default: float = 0.0) -> float:
    text = attributes.get(name)
    return default if text is None or text.strip() == "auto" else length(text, name, view)


def _path(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:  # noqa: ARG001 (one of a table)
    return tracks(attributes.get("d", ""))


def _line(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    x1, y1, x2, y2 = (_value(attributes, name, view) for name in ("x1", "y1", "x2", "y2"))
    return [Subpath((np.array([[x1, y1], [x2, y2]]),), False)], ""


def _points(attributes: Attributes, closed: bool) -> tuple[list[Subpath], str]:
    values = numbers(attributes.get("points", ""))
    fault = "an odd number of coordinates" if len(values) % 2 else ""
    points = np.array(values[: len(values) // 2 * 2]).reshape(-1, 2)
    if closed and len(points):
        points = np.concatenate([points, points[:1]])
    return ([Subpath((points,), closed)] if len(points) > 1 else []), fault


def _polyline(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:  # noqa: ARG001
    return _points(attributes, False)


def _polygon(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:  # noqa: ARG001
    return _points(attributes, True)


def _rect(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
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
        return [Subpath((corners,), True)], ""
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
    return [Subpath(tuple(runs), True)], ""


def _round(attributes: Attributes, view: View, rx: float, ry: float) -> tuple[list[Subpath], str]:
    if rx < 0 or ry < 0:
        raise Malformed("a negative radius")
    if rx == 0 or ry == 0:
        return [], ""
    center = np.array([_value(attributes, "cx", view), _value(attributes, "cy", view)])
    oval = Oval(center, np.array([rx, 0.0]), np.array([0.0, ry]), 0.0, 2 * math.pi)
    return [Subpath((oval,), True)], ""


def _circle(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    radius = _value(attributes, "r", view)
    return _round(attributes, view, radius, radius)


def _ellipse(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    rx, ry = _value(attributes, "rx", view, math.nan), _value(attributes, "ry", view, math.nan)
    rx, ry = (ry if math.isnan(rx) else rx), (rx if math.isnan(ry) else ry)
    return _round(attributes, view, *((0.0, 0.0) if math.isnan(rx) else (rx, ry)))


_SHAPES: dict[str, Callable[[Attributes, View], tuple[list[Subpath], str]]] = {
    "path": _path,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polygon,
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
}
KINDS = frozenset(_SHAPES)
