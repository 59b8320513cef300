"""The pictures of docs/pist.md beside those of the paper.

They are contact points (figure 5), force frames (figure 12), and error and force over the distance
along the path (figure 13).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np

import camgen
from camgen.geometry.segments import flatten, make_contour_segments

STYLE = """.bg{fill:#fff}
text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}
.tick{font-size:2.5px;text-anchor:end}.below{font-size:2.5px;text-anchor:middle}
path{fill:none;stroke-linejoin:round}
.frame{stroke:#9aa0a6;stroke-width:.2}.grid{stroke:#9aa0a6;stroke-width:.1;stroke-dasharray:1 1}
.part{fill:#9aa0a633;stroke:#5f6368;stroke-width:.3}.way{stroke:#1f6feb;stroke-width:.3}
.press{stroke:#9aa0a6;stroke-width:.15}.centre{fill:#f29900}.contact{fill:#188038}
.x{stroke:#d93025}.y{stroke:#188038}.z{stroke:#1f6feb}.x,.y,.z{stroke-width:.35}
.line0,.line1,.line2{stroke-width:.3}
.line0{stroke:#1f6feb}.line1{stroke:#d93025}.line2{stroke:#188038}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}}"""
#: Length of path between contact points and between frames, mm.
CONTACTS, FRAMES = 2.0, 5.0
#: Half of the height of a row of errors, mm, and the height of a row of force, N.
ERROR, FORCE = 0.3, 3.0
#: Length of the path, deviation (mm) and force (N) at points.
Series = tuple[np.ndarray, np.ndarray, np.ndarray]


def contacts(part: camgen.Part, path: camgen.ToolPath, radius: float) -> str:
    """Points evenly along the path of the tool centre, and its contact points, as in figure 5."""
    centres, press = _space_evenly(path, CONTACTS)
    touch = centres + radius * press
    shape, low, high = _outline(part, 12.0)
    scale = 2.0
    down = [f'<path class="part" d="{_data(shape, low, high, scale)}Z"/>']
    down += [f'<path class="way" d="{_data(_places(path), low, high, scale)}"/>']
    for ends in np.column_stack([centres, touch]):
        down.append(f'<path class="press" d="{_data(ends, low, high, scale)}"/>')
    for name, points in (("centre", centres), ("contact", touch)):
        for point in points:
            x, y = _page(point, low, high, scale)
            down.append(f'<circle class="{name}" cx="{x:.2f}" cy="{y:.2f}" r=".7"/>')
    title = "tool centre every 2 mm (orange) and where the tool touches (green)"
    return _sheet(down, (high - low).real * scale, (high - low).imag * scale + 12, title)


def frames(part: camgen.Part, path: camgen.ToolPath) -> str:
    """Force frames in space, seen aslant, as in figure 12.

    x points into the part, y along the motion, z up the tool.
    """
    centres, press = _space_evenly(path, FRAMES)
    shape, low, high = _outline(part, 16.0)
    scale = 2.0
    middle = (low + high) / 2

    def seen(points: np.ndarray, up: np.ndarray | float = 0.0) -> np.ndarray:
        local = (points - middle) * np.exp(0.45j)
        return np.asarray(local.real + 1j * (0.55 * local.imag + 0.83 * np.asarray(up)))

    around = seen(_places(path))
    a = complex(around.real.min() - 4, around.imag.min() - 4)
    b = complex(around.real.max() + 4, around.imag.max() + 6)
    drawn = [f'<path class="part" d="{_data(seen(shape), a, b, scale)}Z"/>']
    drawn += [f'<path class="way" d="{_data(seen(_places(path)), a, b, scale)}"/>']
    size = 4.0
    for point, x in zip(centres, press, strict=True):
        # Climb: the part is on the right of the travel, a quarter turn counter-clockwise of x.
        ends = {"x": (point + size * x, 0.0), "y": (point + size * 1j * x, 0.0), "z": (point, size)}
        for name, (end, up) in ends.items():
            line = np.concatenate([seen(np.array([point])), seen(np.array([end]), up)])
            drawn.append(f'<path class="{name}" d="{_data(line, a, b, scale)}"/>')
    title = "force frames every 5 mm: x into the part (red), y along the motion (green), "
    title += "z up the tool (blue)"
    return _sheet(drawn, (b - a).real * scale, (b - a).imag * scale + 12, title)


def errors(routes: dict[str, list[Series]], force: float) -> str:
    """Error and force of each route over the distance along the path, as in figure 13.

    Each placement has a line.
    """
    wide, left, low, high = 250.0, 16.0, 24.0, 24.0
    longest = max(float(series[0][-1]) for series in chain.from_iterable(routes.values()))
    drawn, top = [], 14.0
    for name, placements in routes.items():
        drawn.append(f'<text x="{left}" y="{top - 1.5}">{name}: error (mm) and force (N)</text>')
        drawn += _grid(left, top, wide, low, (f"+{ERROR:g}", "0", f"-{ERROR:g}"))
        drawn += _grid(left, top + low + 2, wide, high, (f"{FORCE:g}", "", "0"))
        level = top + low + 2 + high * (1 - force / FORCE)
        drawn.append(f'<path class="grid" d="M{left} {level:.2f}h{wide}"/>')
        for k, (along, deviation, pushed) in enumerate(placements):
            x = left + along / longest * wide
            error = top + low / 2 - deviation.clip(-ERROR, ERROR) / ERROR * low / 2
            push = top + low + 2 + high * (1 - pushed.clip(0, FORCE) / FORCE)
            for y in (error, push):
                drawn.append(f'<path class="line{k}" d="{_thin_out(x, y)}"/>')
        top += low + high + 11
    for mark in range(0, int(longest) + 1, 50):
        x = left + mark / longest * wide
        drawn.append(f'<text class="below" x="{x:.1f}" y="{top - 5}">{mark}</text>')
    middle, title = left + wide / 2, "distance along the path, mm"
    drawn.append(f'<text class="below" x="{middle}" y="{top - 1}">{title}</text>')
    return _sheet(drawn, 270, top + 2, "")


def _grid(left: float, top: float, wide: float, high: float, marks: Sequence[str]) -> list[str]:
    lines = [f'<path class="frame" d="M{left} {top}h{wide}v{high}h-{wide}z"/>']
    lines += [f'<path class="grid" d="M{left} {top + high / 2}h{wide}"/>']
    for y, mark in zip((top + 2, top + high / 2 + 1, top + high), marks, strict=True):
        if mark:
            lines.append(f'<text class="tick" x="{left - 1}" y="{y}">{mark}</text>')
    return lines


def _thin_out(x: np.ndarray, y: np.ndarray) -> str:
    """A line with at most one point in each quarter of a mm of the page.

    It is the point that is farthest from the mean.
    """
    slot = (x * 4).astype(int)
    starts = np.append(np.flatnonzero(np.append(True, np.diff(slot) != 0)), len(y))
    points = []
    for start, end in pairwise(starts.tolist()):
        group = y[start:end]
        k = start + int(np.argmax(np.abs(group - np.add.reduce(group) / len(group))))
        points.append(f"{x[k]:.1f} {y[k]:.2f}")
    return "M" + "L".join(points)


def _places(path: camgen.ToolPath) -> np.ndarray:
    """The path, arcs as short chords."""
    return _sample(path)[0]


def _sample(path: camgen.ToolPath) -> tuple[np.ndarray, np.ndarray]:
    """Places every tenth of a mm or so, and the direction of the force there."""
    places, presses = [], []
    for k in range(1, len(path.position)):
        a, b = path.position[k - 1 : k + 1, :2] @ [1, 1j]
        via = complex(*path.via[k, :2])
        t = np.linspace(0, 1, max(int(abs(b - a) * 12), 2))
        if np.isfinite(via):
            sweep = 2 * float(np.angle((b - via) / (via - a)))
            along = np.expm1(1j * sweep * t) / np.expm1(1j * sweep)
        else:
            along = t.astype(complex)
        places.append(a + (b - a) * along)
        start, end = (complex(*row[:2]) for row in path.force_direction[k])
        turn = float(np.angle(end / start)) if start and end else 0.0
        presses.append(start * np.exp(1j * turn * t))
    return np.concatenate(places), np.concatenate(presses)


def _space_evenly(path: camgen.ToolPath, distance: float) -> tuple[np.ndarray, np.ndarray]:
    places, press = _sample(path)
    along = np.append(0.0, np.cumsum(np.abs(np.diff(places))))
    row = np.searchsorted(along, np.arange(0.0, along[-1], distance))
    return places[row], press[row]


def _outline(part: camgen.Part, room: float) -> tuple[np.ndarray, complex, complex]:
    points, _ = flatten(make_contour_segments(list(part.contours[:1])), 0.01)
    low = complex(*points.min(axis=0)) - room * (1 + 1j)
    high = complex(*points.max(axis=0)) + room * (1 + 1j)
    return points @ [1, 1j], low, high


def _page(point: complex, low: complex, high: complex, scale: float) -> tuple[float, float]:
    return (point.real - low.real) * scale, 10 + (high.imag - point.imag) * scale


def _data(points: np.ndarray, low: complex, high: complex, scale: float) -> str:
    places = (_page(point, low, high, scale) for point in points.tolist())
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in places)


def _sheet(drawn: list[str], wide: float, high: float, title: str) -> str:
    size = f'width="{wide:.0f}mm" height="{high:.0f}mm" viewBox="0 0 {wide:.1f} {high:.1f}"'
    head = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', f"<style>{STYLE}</style>"]
    head.append('<rect class="bg" width="100%" height="100%"/>')
    if title:
        head.append(f'<text x="4" y="6">{title}</text>')
    return "\n".join([*head, *drawn, "</svg>\n"])
