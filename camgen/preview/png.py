"""The view as a PNG picture for a report: flat parts from above, to scale; 3-D parts oblique; without the robot."""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import run_starts
from camgen.model.errors import one_line
from camgen.model.part import Solid
from camgen.model.pose import FloatArray
from camgen.preview.aside import TILT, TURN, look_from
from camgen.preview.draw import by_order
from camgen.preview.figure import figure_edges, label_places, oblique, runs, shade
from camgen.preview.view import View

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

#: Pixels: width and height of the picture, border, height of the title.
_WIDE, _HIGH, _BORDER, _TITLE = 1600, 1200, 60, 90
#: Height of what stands below, and how many times larger texts are drawn.
_FOOT, _FINER = 52, 4
#: Corners are drawn to a sixteenth of a pixel.
_SHIFT = 4
_COLOURS: dict[str, Colour] = {
    "done": (86, 70, 58),
    "skipped": (46, 16, 200),
    "wrong": (46, 16, 200),
    "noted": (86, 70, 58),
    "unused": (191, 178, 169),
    "seen": (59, 122, 11),
}
_MARKS: dict[str, Colour] = {"gouge": (46, 16, 200), "excess": (0, 160, 245)}
#: So many of the marks of a proof have their number beside them.
_NAMED = 12
_SHEET, _INK, _TRAVEL = (236, 229, 223), (48, 36, 27), (170, 150, 138)
#: Colours of a fixture and its edge, and its opacity.
_CLAMP, _CLAMP_EDGE, _CLAMP_SHARE = (90, 190, 245), (0, 106, 160), 0.6
#: From the first path to the last, as on the page; blue, green, red.
_RAMP = np.array([[220.0, 98.0, 31.0], [190.0, 50.0, 150.0], [30.0, 88.0, 226.0]])


class _Sheet(Struct, frozen=True, eq=False):
    """From the work frame to the picture: axes (2, 3), right and down, then pixels per mm and a shift in pixels."""

    axes: FloatArray
    scale: float
    shift: FloatArray

    def place(self, points: FloatArray) -> NDArray[np.int32]:
        """Pixels (N, 1, 2) as OpenCV draws them, times 2 ** _SHIFT."""
        at = points @ self.axes.T * self.scale + self.shift
        pixels: NDArray[np.int32] = np.round(at * 2**_SHIFT).astype(np.int32)
        return pixels[:, None]


def png(view: View) -> bytes:
    """The picture as the bytes of a PNG file."""
    image = np.full((_HIGH, _WIDE, 3), 255, np.uint8)
    sheet = _fit(view)
    if view.solid is None:
        _part(image, view, sheet)
        _fixtures(image, view, sheet)
        _way(image, view, sheet)
        _marks(image, view, sheet)
    else:
        _solid(image, view, view.solid, sheet)
    _words(image, view, sheet)
    return bytes(cv2.imencode(".png", image)[1])


def _fit(view: View) -> _Sheet:
    axes = look_from(-math.pi / 2, math.pi / 2) if view.flat else look_from(TURN, TILT)
    right, up = axes @ view.upright
    seen = np.array([right, -up])
    work = view.track.events.path[view.track.event] >= 0
    loops: list[FloatArray] = []
    for fixture in view.fixtures:
        loops += [np.column_stack([loop, np.zeros(len(loop))]) for loop in fixture.loops]
    flat = np.concatenate([view.chains.points, view.track.position[work], *loops]) @ seen.T
    if not len(flat):
        flat = view.track.position @ seen.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([_WIDE - 2 * _BORDER, _HIGH - 2 * _BORDER - _TITLE], float)
    scale = float((room / np.maximum(high - low, 1e-6)).min())
    middle = np.array([_WIDE / 2, (_HIGH + _TITLE) / 2])
    return _Sheet(seen, scale, middle - (low + high) / 2 * scale)


def _solid(image: Pixels, view: View, solid: Solid, sheet: _Sheet) -> None:
    """Shaded faces, edges by state, thin where they are hidden, the way, and the number of every edge."""
    look = oblique(view.upright)
    shaded = shade(solid, look)
    # From a pixel of the shaded picture to one of the image.
    scale, left = shaded.per_px * sheet.scale, shaded.low * (1.0, -1.0) * sheet.scale + sheet.shift
    lift = left[1] - scale * (len(shaded.front) - 1)
    matrix = np.array([[scale, 0.0, left[0]], [0.0, scale, lift]])
    laid = cv2.warpAffine(
        shaded.pixels(), matrix, (_WIDE, _HIGH), flags=cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0)
    )
    np.copyto(image, laid[..., :3], where=laid[..., 3:] > 127)
    edges = figure_edges(view, solid, look, shaded)
    for wanted, wide in ((False, 1), (True, 2)):
        for state, colour in _COLOURS.items():
            own = [
                sheet.place(p)
                for edge in edges
                if edge.state == state
                for seen, p in runs(edge)
                if seen == wanted
            ]
            cv2.polylines(
                image, own, False, colour, wide + (state == "skipped"), cv2.LINE_AA, _SHIFT
            )
    _way(image, view, sheet)
    for edge, (at, seen) in zip(edges, label_places(edges, look, 46 / sheet.scale), strict=True):
        if edge.text:
            x, y = (at * (1.0, -1.0) * sheet.scale + sheet.shift).round().astype(int).tolist()
            _disc(image, edge.text, (x, y), _shade_of(edge.number, len(view.rows)), full=seen)


def _shade_of(number: int, count: int) -> Colour:
    """Blue, green, red of a number in the order; of what has none that of what is left out."""
    if number < 0:
        return _COLOURS["skipped"]
    red, green, blue = bytes.fromhex(by_order(number, count)[1:])
    return blue, green, red


def _disc(image: Pixels, text: str, at: tuple[int, int], colour: Colour, *, full: bool) -> None:
    """A disc with a text; not full: hollow."""
    size = 0.62 if len(text) < 3 else 0.45
    wide, high = _measure(text, size)
    fill, ink = (colour, (255, 255, 255)) if full else ((255, 255, 255), colour)
    cv2.circle(image, at, 20, fill, -1, cv2.LINE_AA)
    cv2.circle(image, at, 20, colour, 2, cv2.LINE_AA)
    _write(image, text, (at[0] - wide // 2, at[1] + high // 2), size, ink, bold=True)


def _part(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Contours by state, over the sheet inside closed ones."""
    ends = np.cumsum(view.chains.counts)[:-1]
    chains = (
        list(zip(view.lines, np.split(sheet.place(view.chains.points), ends), strict=True))
        if view.lines
        else []
    )
    if view.flat:
        closed = [points for line, points in chains if line.closed and line.state != "unused"]
        if closed:
            cv2.fillPoly(image, closed, _SHEET, cv2.LINE_AA, _SHIFT)
    for state, colour in _COLOURS.items():
        own = [points for line, points in chains if line.state == state]
        width = 1 if state == "seen" else 2
        cv2.polylines(image, own, False, colour, width, cv2.LINE_AA, _SHIFT)


def _fixtures(image: Pixels, view: View, sheet: _Sheet) -> None:
    """The fixtures of a mill with their numbers and the heights of their tops."""
    for fixture in view.fixtures if view.flat else ():
        loops = [
            sheet.place(np.column_stack([loop, np.zeros(len(loop))])) for loop in fixture.loops
        ]
        filled = cv2.fillPoly(image.copy(), loops, _CLAMP, cv2.LINE_AA, _SHIFT)
        # A clamp is drawn translucent, over the part below it.
        cv2.addWeighted(filled, _CLAMP_SHARE, image, 1 - _CLAMP_SHARE, 0.0, dst=image)
        cv2.polylines(image, loops, True, _CLAMP_EDGE, 2, cv2.LINE_AA, _SHIFT)
        places = loops[0].reshape(-1, 2) >> _SHIFT
        x, y = ((places.min(axis=0) + places.max(axis=0)) // 2).tolist()
        text = f"{fixture.number}: z {fixture.top:g}"
        wide, _ = _measure(text, 0.5)
        _write(image, text, (x - wide // 2, y + 6), 0.5)


def _marks(image: Pixels, view: View, sheet: _Sheet) -> None:
    """What a proof on the stock found, with the millimetres of the worst."""
    if not view.flat:
        return
    for mark in view.marks:
        loops = (mark.polygon, *mark.holes)
        rings = [sheet.place(np.column_stack([loop, np.full(len(loop), mark.z)])) for loop in loops]
        cv2.fillPoly(image, rings, _MARKS[mark.kind], cv2.LINE_AA, _SHIFT)
        cv2.polylines(image, rings, True, _INK, 1, cv2.LINE_AA, _SHIFT)
    for mark in view.marks[:_NAMED]:
        (x, y) = (
            sheet.place(np.array([[*mark.polygon.mean(axis=0), mark.z]]))[0, 0] >> _SHIFT
        ).tolist()
        text = f"{mark.number:.3g} mm"
        _write(image, text, (x + 6, y - 6), 0.5)


def _way(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Travel, then the paths from the first to the last, in one stroke for every run of stations of a path."""
    way = view.track
    path = way.events.path[way.event]
    at = sheet.place(way.position)
    cuts = run_starts(path)
    strokes = [
        (int(path[a]), at[max(a - 1, 0) : b])
        for a, b in zip(cuts, [*cuts[1:], len(path)], strict=True)
    ]
    travel = [points for owner, points in strokes if owner < 0]
    cv2.polylines(image, travel, False, _TRAVEL, 1, cv2.LINE_AA, _SHIFT)
    last = max(len(view.rows) - 1, 1)
    for owner, points in strokes:
        if owner >= 0:
            blue, green, red = (
                float(np.interp(2 * owner / last, (0, 1, 2), _RAMP[:, k])) for k in range(3)
            )
            cv2.polylines(image, [points], False, (blue, green, red), 3, cv2.LINE_AA, _SHIFT)
            cv2.circle(image, points[0, 0].tolist(), 5 << _SHIFT, _INK, 2, cv2.LINE_AA, _SHIFT)


def _words(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Title, numbers and the scale bar, on white: what travels there is not seen."""
    cv2.rectangle(image, (0, 0), (_WIDE, _TITLE + 14), (255, 255, 255), -1)
    cv2.rectangle(image, (0, _HIGH - _FOOT), (_WIDE, _HIGH), (255, 255, 255), -1)
    facts = dict(view.facts)
    _write(image, _plain(view.title), (_BORDER, 55), 1.0, bold=True)
    names = ("Paths", "Work", "Travel", "Time", "Robot")
    # How the order was found stands on the page.
    told = ", ".join(f"{name.lower()} {_plain(facts[name]).split(' (')[0]}" for name in names)
    _write(image, told, (_BORDER, 92), 0.6)
    below = []
    if view.skipped:
        below.append(f"left out: {len(view.skipped)}, in red where it was drawn")
    if any(line.state == "seen" for line in view.lines):
        below.append("green: the outline in the photo")
    if below:
        _write(image, "; ".join(below), (_BORDER, _HIGH - 22), 0.6)
    if view.flat:
        power = 10.0 ** math.floor(math.log10(300 / sheet.scale))
        bar = max(m * power for m in (1, 2, 5) if m * power <= 300 / sheet.scale * (1 + 1e-12))
        right = _WIDE - _BORDER
        cv2.line(
            image, (right - round(bar * sheet.scale), _HIGH - 22), (right, _HIGH - 22), _INK, 3
        )
        _write(image, f"{bar:g} mm", (right - 90, _HIGH - 32), 0.6)


def _write(
    image: Pixels,
    text: str,
    at: tuple[int, int],
    size: float,
    ink: Colour = _INK,
    *,
    bold: bool = False,
) -> None:
    """A text whose base line begins at ``at``.

    It is drawn larger and made small again: letters stand on whole pixels, and of small ones the gaps are then uneven.
    """
    face, fine, wide = (
        cv2.FONT_HERSHEY_SIMPLEX,
        _FINER * size,
        2 if bold else 1,
    )  # OpenCV's words for a weight
    (long, high), below = cv2.getTextSize(text, face, fine, wide)
    room = _FINER * 2
    shape = (
        -(-(high + below + 2 * room) // _FINER) * _FINER,
        -(-(long + 2 * room) // _FINER) * _FINER,
    )
    drawn = np.zeros(shape, np.uint8)
    cv2.putText(drawn, text, (room, high + room), face, fine, 255, wide, cv2.LINE_AA)
    mask = np.asarray(
        cv2.resize(drawn, (shape[1] // _FINER, shape[0] // _FINER), interpolation=cv2.INTER_AREA)
    )
    left, top = at[0] - 2, at[1] - round(high / _FINER) - 2
    mask = mask[max(-top, 0) : _HIGH - top, max(-left, 0) : _WIDE - left]
    under = image[max(top, 0) :, max(left, 0) :][: mask.shape[0], : mask.shape[1]]
    share = mask[..., None] / 255
    under[:] = (under * (1 - share) + np.array(ink) * share).round().astype(np.uint8)


def _measure(text: str, size: float) -> tuple[int, int]:
    """Width and height of a bold text, px."""
    (wide, high), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _FINER * size, 2)
    return round(wide / _FINER), round(high / _FINER)


def _plain(text: str) -> str:
    """``text`` in the letters that OpenCV can write."""
    return one_line(text).encode("ascii", "replace").decode()
