"""Draws a view as a PNG picture without the robot: flat parts from above, 3-D parts oblique."""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import pairwise

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import find_run_starts
from camgen.geometry.vectors import interpolate_rows
from camgen.model.errors import make_one_line
from camgen.model.part import Solid
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.preview.aside import TILT, TURN, compute_view_axes
from camgen.preview.curves import lift
from camgen.preview.draw import choose_bar, choose_colour
from camgen.preview.figure import (
    list_figure_edges,
    make_oblique,
    place_labels,
    shade,
    split_visibility,
)
from camgen.preview.view import View

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

#: Pixels: width and height of the picture, border, height of the title.
_WIDE, _HIGH, _BORDER, _TITLE = 1600, 1200, 60, 90
#: Height of the footer, px, and the scale at which texts are drawn before they are reduced.
_FOOT, _TEXT_SCALE = 52, 4
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
#: Number of marks of the stock proof that have their width beside them, the widest ones.
_LABELLED = 12
_SHEET, _INK, _TRAVEL = (236, 229, 223), (48, 36, 27), (170, 150, 138)
#: Colours of a fixture and its edge, and its opacity.
_CLAMP, _CLAMP_EDGE, _CLAMP_SHARE = (90, 190, 245), (0, 106, 160), 0.6
#: From the first path to the last, as on the page; blue, green, red.
_RAMP = np.array([[220.0, 98.0, 31.0], [190.0, 50.0, 150.0], [30.0, 88.0, 226.0]])


class _Sheet(Struct, frozen=True, eq=False):
    """The transform from the work frame to the picture.

    axes: (2, 3) directions to the right and down.
    scale: pixels per mm.
    shift: (2,) pixel of the work origin.
    """

    axes: FloatArray
    scale: float
    shift: FloatArray

    def place(self, points: FloatArray) -> NDArray[np.int32]:
        """Pixels (N, 1, 2) of points (N, 3) as OpenCV draws them, times 2 ** _SHIFT."""
        pixels = points @ self.axes.T * self.scale + self.shift
        fixed: NDArray[np.int32] = np.round(pixels * 2**_SHIFT).astype(np.int32)
        return fixed[:, None]


def draw_png(view: View) -> bytes:
    """The picture as the bytes of a PNG file."""
    image = np.full((_HIGH, _WIDE, 3), 255, np.uint8)
    sheet = _fit_sheet(view)
    if view.solid is None:
        _draw_part(image, view, sheet)
        _draw_fixtures(image, view, sheet)
        _draw_track(image, view, sheet)
        _draw_marks(image, view, sheet)
    else:
        _draw_solid(image, view, view.solid, sheet)
    _draw_words(image, view, sheet)
    return bytes(cv2.imencode(".png", image)[1])


def _fit_sheet(view: View) -> _Sheet:
    axes = (
        compute_view_axes(-math.pi / 2, math.pi / 2) if view.flat else compute_view_axes(TURN, TILT)
    )
    right, up = axes @ view.upright
    seen = np.array([right, -up])
    work = view.track.events.path[view.track.event] >= 0
    loops: list[FloatArray] = []
    for fixture in view.fixtures:
        loops += map(lift, fixture.loops)
    flat = np.concatenate([view.chains.points, view.track.position[work], *loops]) @ seen.T
    if not len(flat):
        flat = view.track.position @ seen.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = np.array([_WIDE - 2 * _BORDER, _HIGH - 2 * _BORDER - _TITLE], float)
    scale = float((room / np.maximum(high - low, 1e-6)).min())
    middle = np.array([_WIDE / 2, (_HIGH + _TITLE) / 2])
    return _Sheet(seen, scale, middle - (low + high) / 2 * scale)


def _draw_solid(image: Pixels, view: View, solid: Solid, sheet: _Sheet) -> None:
    """Draw shaded faces, edges by state, the track, and the numbers of the edges.

    Hidden edges are thin.
    """
    projection = make_oblique(view.upright)
    shaded = shade(solid, projection)
    # From a pixel of the shaded picture to one of the image.
    scale, left = shaded.per_px * sheet.scale, shaded.low * (1.0, -1.0) * sheet.scale + sheet.shift
    lift = left[1] - scale * (len(shaded.front) - 1)
    matrix = np.array([[scale, 0.0, left[0]], [0.0, scale, lift]])
    faces = cv2.warpAffine(
        shaded.pixels(), matrix, (_WIDE, _HIGH), flags=cv2.INTER_LINEAR, borderValue=(0, 0, 0, 0)
    )
    np.copyto(image, faces[..., :3], where=faces[..., 3:] > 127)
    edges = list_figure_edges(view, solid, projection, shaded)
    chains: dict[tuple[str, bool], list[NDArray[np.int32]]] = defaultdict(list)
    for edge in edges:
        for is_seen, points in split_visibility(edge):
            chains[edge.state, is_seen].append(sheet.place(points))
    for is_seen, width in ((False, 1), (True, 2)):
        for state, colour in _COLOURS.items():
            drawn, thickness = chains[state, is_seen], width + (state == "skipped")
            cv2.polylines(image, drawn, False, colour, thickness, cv2.LINE_AA, _SHIFT)
    _draw_track(image, view, sheet)
    for edge, place, seen in place_labels(edges, projection, 46 / sheet.scale):
        x, y = (place * (1.0, -1.0) * sheet.scale + sheet.shift).round().astype(int).tolist()
        colour = _choose_shade(edge.number, len(view.rows))
        _draw_disc(image, edge.text, (x, y), colour, is_full=seen)


def _choose_shade(number: int, count: int) -> Colour:
    """Blue, green, red of the path `number` of `count`; -1 for an edge that is left out."""
    if number < 0:
        return _COLOURS["skipped"]
    red, green, blue = bytes.fromhex(choose_colour(number, count)[1:])
    return blue, green, red


def _draw_disc(
    image: Pixels, text: str, centre: tuple[int, int], colour: Colour, *, is_full: bool
) -> None:
    """Draw a disc with a text in it, hollow unless it is full."""
    size = 0.62 if len(text) < 3 else 0.45
    width, height = _measure(text, size)
    fill, ink = (colour, (255, 255, 255)) if is_full else ((255, 255, 255), colour)
    cv2.circle(image, centre, 20, fill, -1, cv2.LINE_AA)
    cv2.circle(image, centre, 20, colour, 2, cv2.LINE_AA)
    _write(image, text, (centre[0] - width // 2, centre[1] + height // 2), size, ink, bold=True)


def _draw_part(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Draw contours by state, over the filled inside of closed ones."""
    if not view.lines:
        return
    ends = np.cumsum(view.chains.counts)[:-1]
    split = np.split(sheet.place(view.chains.points), ends)
    chains = list(zip(view.lines, split, strict=True))
    if view.flat:
        closed = [points for line, points in chains if line.closed and line.state != "unused"]
        if closed:
            cv2.fillPoly(image, closed, _SHEET, cv2.LINE_AA, _SHIFT)
    for state, colour in _COLOURS.items():
        drawn = [points for line, points in chains if line.state == state]
        width = 1 if state == "seen" else 2
        cv2.polylines(image, drawn, False, colour, width, cv2.LINE_AA, _SHIFT)


def _draw_fixtures(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Draw the fixtures of a mill with their numbers and the heights of their tops."""
    for fixture in view.fixtures if view.flat else ():
        loops = [sheet.place(lift(loop)) for loop in fixture.loops]
        filled = cv2.fillPoly(image.copy(), loops, _CLAMP, cv2.LINE_AA, _SHIFT)
        # A clamp is drawn translucent, over the part below it.
        cv2.addWeighted(filled, _CLAMP_SHARE, image, 1 - _CLAMP_SHARE, 0.0, dst=image)
        cv2.polylines(image, loops, True, _CLAMP_EDGE, 2, cv2.LINE_AA, _SHIFT)
        places = loops[0].reshape(-1, 2) >> _SHIFT
        x, y = ((places.min(axis=0) + places.max(axis=0)) // 2).tolist()
        text = f"{fixture.number}: z {fixture.top:g}"
        width, _ = _measure(text, 0.5)
        _write(image, text, (x - width // 2, y + 6), 0.5)


def _draw_marks(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Draw the findings of the stock proof, with the widths of the widest."""
    if not view.flat:
        return
    for mark in view.marks:
        rings = [sheet.place(lift(loop, mark.z)) for loop in (mark.polygon, *mark.holes)]
        cv2.fillPoly(image, rings, _MARKS[mark.kind], cv2.LINE_AA, _SHIFT)
        cv2.polylines(image, rings, True, _INK, 1, cv2.LINE_AA, _SHIFT)
    for mark in view.marks[:_LABELLED]:
        middle = np.array([[*mark.polygon.mean(axis=0), mark.z]])
        x, y = (sheet.place(middle)[0, 0] >> _SHIFT).tolist()
        _write(image, f"{mark.width:.3g} mm", (x + 6, y - 6), 0.5)


def _draw_track(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Draw travel, then the paths from the first to the last, one stroke per path."""
    path = view.track.events.path[view.track.event]
    pixels = sheet.place(view.track.position)
    travel, strokes = [], []
    for start, end in pairwise([*find_run_starts(path).tolist(), len(path)]):
        points = pixels[max(start - 1, 0) : end]
        if path[start] < 0:
            travel.append(points)
        else:
            strokes.append((int(path[start]), points))
    cv2.polylines(image, travel, False, _TRAVEL, 1, cv2.LINE_AA, _SHIFT)
    last = max(len(view.rows) - 1, 1)
    for owner, points in strokes:
        place = np.array([2 * owner / last])
        (colour,) = interpolate_rows(place, np.arange(3.0), _RAMP).tolist()
        cv2.polylines(image, [points], False, colour, 3, cv2.LINE_AA, _SHIFT)
        cv2.circle(image, points[0, 0].tolist(), 5 << _SHIFT, _INK, 2, cv2.LINE_AA, _SHIFT)


def _draw_words(image: Pixels, view: View, sheet: _Sheet) -> None:
    """Draw title, numbers and the scale bar on white, over any travel there."""
    cv2.rectangle(image, (0, 0), (_WIDE, _TITLE + 14), (255, 255, 255), -1)
    cv2.rectangle(image, (0, _HIGH - _FOOT), (_WIDE, _HIGH), (255, 255, 255), -1)
    facts = dict(view.facts)
    _write(image, _replace_letters(view.title), (_BORDER, 55), 1.0, bold=True)
    names = ("Paths", "Work", "Travel", "Time", "Robot")
    # The method of the order, in brackets, is on the page.
    numbers = [f"{name.lower()} {_replace_letters(facts[name]).split(' (')[0]}" for name in names]
    _write(image, ", ".join(numbers), (_BORDER, 92), 0.6)
    below = []
    if view.skipped:
        reasons = counted(len(view.skipped), "reason")
        below.append(f"left out for {reasons}, in red where it was drawn")
    if any(line.state == "seen" for line in view.lines):
        below.append("green: the outline in the photo")
    if below:
        _write(image, "; ".join(below), (_BORDER, _HIGH - 22), 0.6)
    if view.flat:
        bar = choose_bar(300 / sheet.scale)
        right, y = _WIDE - _BORDER, _HIGH - 22
        cv2.line(image, (right - round(bar * sheet.scale), y), (right, y), _INK, 3)
        _write(image, f"{bar:g} mm", (right - 90, _HIGH - 32), 0.6)


def _write(
    image: Pixels,
    text: str,
    start: tuple[int, int],
    size: float,
    ink: Colour = _INK,
    *,
    bold: bool = False,
) -> None:
    """Draw a text whose base line starts at the pixel `start`.

    OpenCV places letters on whole pixels, which makes the gaps between small ones uneven. So the
    text is drawn larger and reduced.
    """
    face, scale, weight = cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE * size, 2 if bold else 1
    (width, height), below = cv2.getTextSize(text, face, scale, weight)
    border = _TEXT_SCALE * 2
    rows = -(-(height + below + 2 * border) // _TEXT_SCALE)
    columns = -(-(width + 2 * border) // _TEXT_SCALE)
    drawn = np.zeros((rows * _TEXT_SCALE, columns * _TEXT_SCALE), np.uint8)
    cv2.putText(drawn, text, (border, height + border), face, scale, 255, weight, cv2.LINE_AA)
    mask = np.asarray(cv2.resize(drawn, (columns, rows), interpolation=cv2.INTER_AREA))
    left, top = start[0] - 2, start[1] - round(height / _TEXT_SCALE) - 2
    mask = mask[max(-top, 0) : _HIGH - top, max(-left, 0) : _WIDE - left]
    under = image[max(top, 0) :, max(left, 0) :][: mask.shape[0], : mask.shape[1]]
    opacity = mask[..., None] / 255
    under[:] = (under * (1 - opacity) + np.array(ink) * opacity).round().astype(np.uint8)


def _measure(text: str, size: float) -> tuple[int, int]:
    """Width and height of a bold text, px."""
    face, scale = cv2.FONT_HERSHEY_SIMPLEX, _TEXT_SCALE * size
    (width, height), _ = cv2.getTextSize(text, face, scale, 2)
    return round(width / _TEXT_SCALE), round(height / _TEXT_SCALE)


def _replace_letters(text: str) -> str:
    """`text` in the letters that OpenCV can write."""
    return make_one_line(text).encode("ascii", "replace").decode()
