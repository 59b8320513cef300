"""Path data and basic shapes of SVG as runs of lines, Bezier segments and elliptical arcs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import accumulate, chain

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.read.svg.values import NUMBER, STRAY_COMMA, Malformed, ViewBox, length, numbers

#: Letters of commands, which separate their numbers.
_COMMANDS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])")
#: A path in a property of CSS.
_PATH_FUNCTION = re.compile(r"path\(\s*([\"'])(.*)\1\s*\)", re.S)
_SEPARATORS = str.maketrans("", "", " \t\r\n\f,")
#: The two flags of an arc are one digit each and need nothing around them.
_SEPARATOR = r"\s*,?\s*"
_N = rf"{_SEPARATOR}({NUMBER.pattern})"
_NUMBER = re.compile(_N)
_FLAG = rf"{_SEPARATOR}([01])"
_ARC = re.compile(_N * 3 + _FLAG * 2 + _N * 2)
#: Limit of ends and radii of arcs, and of the inverse of radii: larger squares are infinite.
_FARTHEST = 1e100
#: Numbers of a command from which its lines are read together.
_MANY = 8
#: Numbers that a command takes at a time.
_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


class Oval(Struct, frozen=True, eq=False):
    """The arc center + first cos t + second sin t, t from start to end.

    center: (2,), user units.
    first: (2,), half diameter.
    second: (2,), half diameter that is conjugate to it.
    start: rad.
    end: rad.
    """

    center: FloatArray
    first: FloatArray
    second: FloatArray
    start: float
    end: float


#: Points (N, 2) of lines, control points (S, degree + 1, 2) of Bezier segments, or an arc.
Run = FloatArray | Oval


class Subpath(Struct, frozen=True, eq=False):
    """One subpath: runs end to end, in user units."""

    runs: tuple[Run, ...]
    closed: bool


def tracks(data: str) -> tuple[list[Subpath], str]:
    """The subpaths of path data up to its first fault, and the fault; "" without a fault."""
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
    if parts[1:] and parts[1] not in "Mm":
        raise Malformed("path data begins without M")
    for letter, text in zip(parts[1::2], parts[2::2], strict=True):
        is_arc = letter in "Aa"
        texts = list(chain(*_ARC.findall(text))) if is_arc else NUMBER.findall(text)
        size = _TAKES[letter.upper()]
        is_clean = "".join(texts) == text.translate(_SEPARATORS)
        if "," in text and STRAY_COMMA.search(text):
            is_clean = False
        if not is_clean:
            texts = list(_read_numbers(_ARC if is_arc else _NUMBER, text))
        whole = len(texts) // size * size if size else 0
        yield letter, list(map(float, texts[:whole]))
        if not is_clean or whole != len(texts) or (size and not texts):
            raise Malformed(f"path data is damaged in a {letter} command")


def _read_numbers(pattern: re.Pattern[str], text: str) -> Iterator[str]:
    """The numbers up to the first word that is not a number."""
    match = pattern.match(text)
    while match:
        yield from match.groups()
        match = pattern.match(text, match.end())


class _Pen:
    """The state that path data changes: pen, start of the subpath, last control point."""

    def __init__(self) -> None:
        self.done: list[Subpath] = []
        self.runs: list[Run] = []
        self.rows: list[tuple[float, ...]] = []
        self.size = 0
        self.x = self.y = self.x0 = self.y0 = 0.0
        #: The control point that S and T mirror, and the degree of the segment it belongs to.
        self.control = (0.0, 0.0, 0)

    def draw(self, letter: str, values: list[float]) -> None:
        """One command with all its repetitions."""
        command = letter.upper()
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

    def _base(self, relative: bool) -> tuple[float, float]:
        return (self.x, self.y) if relative else (0.0, 0.0)

    def _m(self, v: list[float], relative: bool) -> None:
        self.finish(False)
        self.x, self.y = (self.x + v[0], self.y + v[1]) if relative else (v[0], v[1])
        self.x0, self.y0 = self.x, self.y
        self.control = (0.0, 0.0, 0)

    def _l(self, v: list[float], relative: bool) -> None:
        self._to(*((self.x + v[0], self.y + v[1]) if relative else v))

    def _lines(self, v: list[float], relative: bool) -> None:
        self._l(v[:2], relative)
        xs, ys = v[2::2], v[3::2]
        if relative:
            xs = list(accumulate(xs, initial=self.x))[1:]
            ys = list(accumulate(ys, initial=self.y))[1:]
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
        x, y = self._base(relative)
        self._curve((self.x, self.y, *first, x + v[0], y + v[1], x + v[2], y + v[3]))

    def _q(self, v: list[float], relative: bool) -> None:
        x, y = self._base(relative)
        self._curve((self.x, self.y, x + v[0], y + v[1], x + v[2], y + v[3]))

    def _t(self, v: list[float], relative: bool) -> None:
        x, y = self._base(relative)
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
            raise Malformed("an arc that is too large")
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
    distance = math.sqrt(max(0.0, 1 - half * half)) / (2 * half) * (1 if large != sweep else -1)
    offset = np.array([-chord[1], chord[0]]) * distance
    center = middle + first * offset[0] + second * offset[1]
    low = -chord / 2 - offset
    begin = math.atan2(low[1], low[0])
    angle = 2 * math.asin(min(1.0, half))
    if large:
        angle = 2 * math.pi - angle
    return Oval(center, first, second, begin, begin + (angle if sweep else -angle))


def list_corners(subpaths: Sequence[Subpath]) -> FloatArray | None:
    """The corners (N, 2) of a polygon; None for curves, for several subpaths and for none."""
    if len(subpaths) != 1 or len(subpaths[0].runs) != 1:
        return None
    run = subpaths[0].runs[0]
    if not isinstance(run, np.ndarray) or run.ndim != 2:
        return None
    return run[:-1] if np.array_equal(run[0], run[-1]) else run


def measure_bounds(subpaths: list[Subpath]) -> ViewBox:
    """The box around subpaths, user units. Raises Malformed without subpaths."""
    runs = chain.from_iterable(subpath.runs for subpath in subpaths)
    extremes = list(map(_find_extremes, runs))
    if not extremes:
        raise Malformed("a box around nothing")
    points = np.concatenate(extremes)
    x, y = points.min(axis=0).tolist()
    width, height = np.ptp(points, axis=0).tolist()
    return ViewBox(x, y, width, height)


def _find_extremes(run: Run) -> FloatArray:
    """Points (N, 2) of a run that include its extremes along both axes."""
    if isinstance(run, Oval):
        return _find_extremes_of_arc(run)
    if run.ndim == 2:
        return run
    points = [run[:, 0], run[:, -1]]
    for segment in run:
        for coordinates in segment.T:
            roots = _bernstein(coordinates).deriv().roots()
            inner = roots.real[(abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)]
            points.append(np.column_stack([_bernstein(values)(inner) for values in segment.T]))
    return np.concatenate(points)


def _bernstein(values: FloatArray) -> np.polynomial.Polynomial:
    """A coordinate of a Bezier segment as a polynomial of its parameter."""
    rows = {
        3: [[1, 0, 0], [-2, 2, 0], [1, -2, 1]],
        4: [[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]],
    }
    return np.polynomial.Polynomial(np.array(rows[len(values)]) @ values)


def _find_extremes_of_arc(arc: Oval) -> FloatArray:
    low, high = sorted((arc.start, arc.end))
    angles = [low, high]
    for axis in (0, 1):
        extreme = math.atan2(arc.second[axis], arc.first[axis])
        first = math.ceil((low - extreme) / math.pi)
        last = math.floor((high - extreme) / math.pi)
        angles += [extreme + k * math.pi for k in range(first, last + 1)]
    t = np.array(angles)[:, None]
    return np.asarray(arc.center + np.cos(t) * arc.first + np.sin(t) * arc.second)


# The basic shapes of SVG as the subpaths that they stand for (SVG 2, chapter 10).

View = tuple[float, float]
Attributes = Mapping[str, str]


def _value(attributes: Attributes, name: str, view: View, default: float = 0.0) -> float:
    text = attributes.get(name)
    if text is None or text.strip() in ("", "auto"):
        return default
    value = length(text, name, view)
    if value < 0 and name in ("rx", "ry"):
        raise Malformed("a negative radius")
    return value


def _path(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:  # noqa: ARG001
    data = attributes.get("d", "")
    if data.startswith("path("):
        match = _PATH_FUNCTION.fullmatch(data)
        if match is None:
            raise Malformed(f"d is not a path: {data[:20]!r}")
        data = match[2]
    return tracks("" if data.strip() == "none" else data)


def _line(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    start = _value(attributes, "x1", view), _value(attributes, "y1", view)
    end = _value(attributes, "x2", view), _value(attributes, "y2", view)
    return [Subpath((np.array([start, end]),), False)], ""


def _points(attributes: Attributes, _view: View, closed: bool) -> tuple[list[Subpath], str]:
    values = numbers(attributes.get("points", ""))
    fault = "an odd number of coordinates" if len(values) % 2 else ""
    points = np.array(values[: len(values) // 2 * 2]).reshape(-1, 2)
    if closed and len(points):
        points = np.concatenate([points, points[:1]])
    return ([Subpath((points,), closed)] if len(points) > 1 else []), fault


def _rect(attributes: Attributes, view: View) -> tuple[list[Subpath], str]:
    x, y = _value(attributes, "x", view), _value(attributes, "y", view)
    w, h = _value(attributes, "width", view), _value(attributes, "height", view)
    if w < 0 or h < 0:
        raise Malformed("a negative size")
    if w == 0 or h == 0:
        return [], ""
    rx, ry = _read_radii(attributes, view)
    if min(rx, ry) <= 0:
        corners = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]])
        return [Subpath((corners,), True)], ""
    rx, ry = min(rx, w / 2), min(ry, h / 2)
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
    return _round(attributes, view, *_read_radii(attributes, view))


def _read_radii(attributes: Attributes, view: View) -> tuple[float, float]:
    """The attributes rx and ry. A missing one equals the other; both are 0 if both are missing."""
    rx, ry = _value(attributes, "rx", view, math.nan), _value(attributes, "ry", view, math.nan)
    if math.isnan(rx):
        rx = ry
    if math.isnan(rx):
        return 0.0, 0.0
    if math.isnan(ry):
        ry = rx
    return rx, ry


#: Functions of the subpaths of a shape and its fault, by the name of its element. They raise
#: Malformed if nothing of it can be drawn.
SHAPES: dict[str, Callable[[Attributes, View], tuple[list[Subpath], str]]] = {
    "path": _path,
    "line": _line,
    "polyline": partial(_points, closed=False),
    "polygon": partial(_points, closed=True),
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
}
KINDS = frozenset(SHAPES)
