"""The pictures of docs/pist.md beside those of the paper: contact points (figure 5), force frames (figure 12), and
error and force over the distance along the path (figure 13).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import camgen
from camgen.geometry.segments import flatten, make_contour_segments

STYLE = """.bg{fill:#fff}text{font-family:system-ui,Helvetica,Arial,sans-serif;font-size:3.4px;fill:#202124}
.tick{font-size:2.5px;text-anchor:end}.below{font-size:2.5px;text-anchor:middle}path{fill:none;stroke-linejoin:round}
.frame{stroke:#9aa0a6;stroke-width:.2}.grid{stroke:#9aa0a6;stroke-width:.1;stroke-dasharray:1 1}
.part{fill:#9aa0a633;stroke:#5f6368;stroke-width:.3}.way{stroke:#1f6feb;stroke-width:.3}
.press{stroke:#9aa0a6;stroke-width:.15}.centre{fill:#f29900}.contact{fill:#188038}
.x{stroke:#d93025}.y{stroke:#188038}.z{stroke:#1f6feb}.x,.y,.z{stroke-width:.35}
.line0,.line1,.line2{stroke-width:.3}.line0{stroke:#1f6feb}.line1{stroke:#d93025}.line2{stroke:#188038}
@media (prefers-color-scheme:dark){.bg{fill:#17181b}text{fill:#e8eaed}}"""
#: mm of path between what is drawn of it.
CONTACTS, FRAMES = 2.0, 5.0
#: mm: half the height of a row of errors; N: the height of a row of force.
ERROR, FORCE = 0.3, 3.0
Series = tuple[np.ndarray, np.ndarray, np.ndarray]


def contacts(part: camgen.Part, path: camgen.ToolPath, radius: float) -> str:
    """Points evenly along the path of the tool centre and where the tool touches, as in figure 5."""
    at, press = _evenly(path, CONTACTS)
    touch = at + radius * press
    shape, low, high = _outline(part, 12.0)
    scale = 2.0
    down = [f'<path class="part" d="{_data(shape, low, high, scale)}Z"/>']
    down += [f'<path class="way" d="{_data(_places(path), low, high, scale)}"/>']
    for a, b in zip(at, touch, strict=True):
        down.append(f'<path class="press" d="{_data(np.array([a, b]), low, high, scale)}"/>')
    for name, points in (("centre", at), ("contact", touch)):
        for point in points:
            x, y = _page(point, low, high, scale)
            down.append(f'<circle class="{name}" cx="{x:.2f}" cy="{y:.2f}" r=".7"/>')
    title = "tool centre every 2 mm (orange) and where the tool touches (green)"
    return _sheet(down, (high - low).real * scale, (high - low).imag * scale + 12, title)


def frames(part: camgen.Part, path: camgen.ToolPath) -> str:
    """Force frames in space, seen aslant, as in figure 12: x into the part, y along the motion, z up the tool."""
    at, press = _evenly(path, FRAMES)
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
    for point, x in zip(at, press, strict=True):
        # Climb: the part is on the right of the travel, which then is a quarter turn counter-clockwise of the press.
        ends = {"x": (point + size * x, 0.0), "y": (point + size * 1j * x, 0.0), "z": (point, size)}
        for name, (end, up) in ends.items():
            line = np.concatenate([seen(np.array([point])), seen(np.array([end]), up)])
            drawn.append(f'<path class="{name}" d="{_data(line, a, b, scale)}"/>')
    title = "force frames every 5 mm: x into the part (red), y along the motion (green), z up the tool (blue)"
    return _sheet(drawn, (b - a).real * scale, (b - a).imag * scale + 12, title)


def errors(routes: dict[str, list[Series]], force: float) -> str:
    """Error and force of each route over the distance along the path, a line for each placement, as in figure 13."""
    wide, left, low, high = 250.0, 16.0, 24.0, 24.0
    most = max(float(way[-1]) for found in routes.values() for way, *_ in found)
    drawn, top = [], 14.0
    for name, found in routes.items():
        drawn.append(f'<text x="{left}" y="{top - 1.5}">{name}: error (mm) and force (N)</text>')
        drawn += _grid(left, top, wide, low, (f"+{ERROR:g}", "0", f"-{ERROR:g}"))
        drawn += _grid(left, top + low + 2, wide, high, (f"{FORCE:g}", "", "0"))
        level = top + low + 2 + high * (1 - force / FORCE)
        drawn.append(f'<path class="grid" d="M{left} {level:.2f}h{wide}"/>')
        for k, (way, off, pushed) in enumerate(found):
            x = left + way / most * wide
            for y in (
                top + low / 2 - off.clip(-ERROR, ERROR) / ERROR * low / 2,
                top + low + 2 + high * (1 - pushed.clip(0, FORCE) / FORCE),
            ):
                drawn.append(f'<path class="line{k}" d="{_line(x, y)}"/>')
        top += low + high + 11
    for mark in range(0, int(most) + 1, 50):
        drawn.append(
            f'<text class="below" x="{left + mark / most * wide:.1f}" y="{top - 5}">{mark}</text>'
        )
    drawn.append(
        f'<text class="below" x="{left + wide / 2}" y="{top - 1}">distance along the path, mm</text>'
    )
    return _sheet(drawn, 270, top + 2, "")


def _grid(left: float, top: float, wide: float, high: float, marks: Sequence[str]) -> list[str]:
    lines = [f'<path class="frame" d="M{left} {top}h{wide}v{high}h-{wide}z"/>']
    lines += [f'<path class="grid" d="M{left} {top + high / 2}h{wide}"/>']
    places = (top + 2, top + high / 2 + 1, top + high)
    texts = zip(places, marks, strict=True)
    return lines + [
        f'<text class="tick" x="{left - 1}" y="{y}">{mark}</text>' for y, mark in texts if mark
    ]


def _line(x: np.ndarray, y: np.ndarray) -> str:
    """At most a point every quarter of a mm of the page, each the farthest from the mean of its place."""
    slot = (x * 4).astype(int)
    begin = np.flatnonzero(np.append(True, np.diff(slot) != 0))
    end = np.append(begin[1:], len(y))
    mean = np.add.reduceat(y, begin) / (end - begin)
    far = [int(a + np.argmax(np.abs(y[a:b] - m))) for a, b, m in zip(begin, end, mean, strict=True)]
    return "M" + "L".join(
        f"{a:.1f} {b:.2f}" for a, b in zip(x[far].tolist(), y[far].tolist(), strict=True)
    )


def _places(path: camgen.ToolPath) -> np.ndarray:
    """The path, arcs as short chords."""
    return _dense(path)[0]


def _dense(path: camgen.ToolPath) -> tuple[np.ndarray, np.ndarray]:
    """Places every tenth of a mm or so, and the direction of the force there."""
    places, presses = [], []
    for k in range(1, len(path.position)):
        a, b, via = (
            complex(*row[:2]) for row in (path.position[k - 1], path.position[k], path.via[k])
        )
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


def _evenly(path: camgen.ToolPath, apart: float) -> tuple[np.ndarray, np.ndarray]:
    at, press = _dense(path)
    run = np.append(0.0, np.cumsum(np.abs(np.diff(at))))
    row = np.searchsorted(run, np.arange(0.0, run[-1], apart))
    return at[row], press[row]


def _outline(part: camgen.Part, room: float) -> tuple[np.ndarray, complex, complex]:
    points, _ = flatten(make_contour_segments(list(part.contours[:1])), 0.01)
    shape = points[:, 0] + 1j * points[:, 1]
    return (
        shape,
        complex(shape.real.min() - room, shape.imag.min() - room),
        complex(shape.real.max() + room, shape.imag.max() + room),
    )


def _page(point: complex, low: complex, high: complex, scale: float) -> tuple[float, float]:
    return (point.real - low.real) * scale, 10 + (high.imag - point.imag) * scale


def _data(points: np.ndarray, low: complex, high: complex, scale: float) -> str:
    places = (_page(point, low, high, scale) for point in points.tolist())
    return "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in places)


def _sheet(drawn: list[str], wide: float, high: float, title: str) -> str:
    size = f'width="{wide:.0f}mm" height="{high:.0f}mm" viewBox="0 0 {wide:.1f} {high:.1f}"'
    head = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', f"<style>{STYLE}</style>"]
    head += [
        '<rect class="bg" width="100%" height="100%"/>',
        f'<text x="4" y="6">{title}</text>' if title else "",
    ]
    return "\n".join([*filter(None, head), *drawn, "</svg>\n"])
