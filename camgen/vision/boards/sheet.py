"""Marker sheets: a ring of ArUco markers around a free area for the part, and ChArUco boards; what is where in mm.

The work frame of a sheet: origin at the lower left corner of the free area, x to the right, y up, z out of the paper.
Two strokes that meet in that corner, outside of the area, mark it. A sheet that was printed too small or too large is
described by the length that its 100 mm ruler really has; all positions are scaled by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import true_runs
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short

DICTIONARY = "4X4_50"
#: Landscape, width and height in mm.
SIZES = {"A4": (297.0, 210.0), "A3": (420.0, 297.0), "A2": (594.0, 420.0), "LETTER": (279.4, 215.9)}
RULER = 100.0
#: Width of the lines of the ruler and of the marks of the origin, mm.
STROKE = 0.3

#: Printers leave about 5 mm at the edge; below the markers there is the ruler.
_MARGIN, _FOOT = 10.0, 20.0
#: White between markers and around them, in widths of a marker: detection needs a module of white, 1 of 6.
_GAP_SHARE = 0.4
_MOST_MARKERS = 50
_LEAST_MARKER = 8.0
_LEAST_FREE = 20.0
_PRINTED = (0.8, 1.25)


class Sheet(Struct, frozen=True, eq=False):
    """A marker sheet as printed. Lengths in mm, all of them already scaled by the printed length of the ruler.

    size: its name. page: width and height. origin: of the work frame, from the lower left corner of the page. free:
    width and height of the free area. marker: side of a marker. ids: (N,). corners: (N, 4, 2) in the work frame, upper
    left, upper right, lower right, lower left of each marker. printed: what the 100 mm ruler measures.
    """

    size: str
    page: tuple[float, float]
    origin: tuple[float, float]
    free: tuple[float, float]
    marker: float
    ids: tuple[int, ...]
    corners: FloatArray
    printed: float = RULER

    @property
    def label(self) -> str:
        """How messages and the sheet itself call it."""
        return f"camgen {self.size} marker sheet, markers {short(self.marker * RULER / self.printed, 2)} mm"


class Board(Struct, frozen=True):
    """A ChArUco board: ``columns`` x ``rows`` squares of ``square`` mm, markers of ``marker`` mm, a dictionary's name.

    Its work frame: origin at the lower left corner of the squares, x to the right, y up, as the board is upright in
    OpenCV's own drawing of it.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = DICTIONARY

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"ChArUco board {self.columns}x{self.rows}"


def sheet(size: str = "A4", marker: float = 20.0, printed: float = RULER) -> Sheet:
    """The sheet of this page size (landscape) and marker width in mm. JobError for a size or width that cannot be.

    printed: what the 100 mm ruler on the paper measures, mm.
    """
    page = SIZES.get(size.upper())
    if page is None:
        raise JobError(
            "marker sheet", f"no size {size!r}", remedy=f"give one of {', '.join(SIZES)}"
        )
    if not (math.isfinite(printed) and RULER * _PRINTED[0] <= printed <= RULER * _PRINTED[1]):
        what = f"the ruler of {short(RULER, 0)} mm cannot have printed as {short(printed, 3)} mm"
        raise JobError(
            "marker sheet",
            what,
            remedy="measure the printed ruler from its first to its last mark, in mm",
        )
    most = (page[1] - _MARGIN - _FOOT - _LEAST_FREE) / (2 + 2 * _GAP_SHARE)
    if not _LEAST_MARKER <= marker <= most:
        what = f"markers of {short(marker, 2)} mm do not fit on {size.upper()}"
        raise JobError(
            "marker sheet",
            what,
            remedy=f"give {short(_LEAST_MARKER, 0)} to {short(most - 0.05, 1)} mm",
        )
    left, low = _ring(page, marker)
    corner = (_MARGIN + marker * (1 + _GAP_SHARE), _FOOT + marker * (1 + _GAP_SHARE))
    free = (page[0] - 2 * corner[0], page[1] - _MARGIN - marker * (1 + _GAP_SHARE) - corner[1])
    grow = printed / RULER
    square = marker * np.array([(0, 1), (1, 1), (1, 0), (0, 0)])
    corners = np.column_stack([left, low])[:, None, :] + square - corner
    return Sheet(
        size.upper(),
        (page[0] * grow, page[1] * grow),
        (corner[0] * grow, corner[1] * grow),
        (free[0] * grow, free[1] * grow),
        marker * grow,
        tuple(range(len(left))),
        frozen(corners * grow),
        printed,
    )


def _ring(page: tuple[float, float], marker: float) -> tuple[FloatArray, FloatArray]:
    """Left and lower sides of the markers around the page, from the upper left one on, clockwise."""
    across, along = page[0] - 2 * _MARGIN, page[1] - _MARGIN - _FOOT
    columns, rows = _fitting(across, marker), _fitting(along, marker)
    while 2 * (columns + rows) - 4 > _MOST_MARKERS:
        columns, rows = (columns - 1, rows) if columns > rows else (columns, rows - 1)
    xs = np.linspace(_MARGIN, _MARGIN + across - marker, columns)
    ys = np.linspace(_FOOT + along - marker, _FOOT, rows)
    ring: list[tuple[float, float]] = [(x, ys[0]) for x in xs]
    ring += [(xs[-1], y) for y in ys[1:]]
    ring += [(x, ys[-1]) for x in xs[-2::-1]]
    ring += [(xs[0], y) for y in ys[-2:0:-1]]
    places = np.array(ring)
    return places[:, 0], places[:, 1]


def _fitting(length: float, marker: float) -> int:
    return int((length + marker * _GAP_SHARE) / (marker * (1 + _GAP_SHARE)) + 1e-9)


# -- drawing

_Rectangle = tuple[float, float, float, float]


def draw_svg(what: Sheet) -> bytes:
    """The sheet as an SVG page in mm, to be printed at 100 %."""
    width, height = what.page
    paths = "".join(
        f'<path d="{"".join(_svg_rectangle(r, height) for r in group)}"/>\n'
        for group in _rectangles(what)
    )
    words = "".join(
        f'<text x="{_mm(x)}" y="{_mm(height - y)}" font-family="Helvetica, Arial, sans-serif" '
        f'font-size="{_mm(size)}">{text}</text>\n'
        for x, y, size, text in _words(what)
    )
    page = (
        f'width="{_mm(width)}mm" height="{_mm(height)}mm" viewBox="0 0 {_mm(width)} {_mm(height)}"'
    )
    return f'<svg xmlns="http://www.w3.org/2000/svg" {page}>\n{paths}{words}</svg>\n'.encode()


def draw_pdf(what: Sheet) -> bytes:
    """The sheet as a PDF page of its true size. Viewers are asked to print it unscaled (PDF 1.7, 12.2)."""
    point = 72 / 25.4
    content = [f"{point:.9f} 0 0 {point:.9f} 0 0 cm"]
    for group in _rectangles(what):
        content += [" ".join([*map(_mm, r), "re"]) for r in group]
        content.append("f")
    for x, y, size, text in _words(what):
        content.append(f"BT /F1 {_mm(size)} Tf {_mm(x)} {_mm(y)} Td ({text}) Tj ET")
    stream = "\n".join(content)
    width, height = (f"{v * point:.4f}" for v in what.page)
    return _pdf(
        [
            "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] /Contents 4 0 R "
            "/Resources << /Font << /F1 5 0 R >> >> >>",
            f"<< /Length {len(stream)} >>\nstream\n{stream}\nendstream",
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        ]
    )


def _pdf(objects: Sequence[str]) -> bytes:
    """A file of these objects, the first one its catalog, with the table of their places (PDF 1.7, 7.5)."""
    text = "%PDF-1.4\n"
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(text))
        text += f"{number} 0 obj\n{body}\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    end = f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(text)}\n%%EOF\n"
    return f"{text}xref\n0 {count}\n0000000000 65535 f \n{table}{end}".encode("ascii")


def _rectangles(what: Sheet) -> list[list[_Rectangle]]:
    """Black rectangles (left, low, width, height) on the page, mm; one group per marker, filled as one path so that
    no hair line shows between its modules; the last group is ruler and marks.
    """
    groups = []
    for black, corners in zip(_modules(what.ids), what.corners, strict=True):
        left, low = (corners[3] + what.origin).tolist()
        step = what.marker / len(black)
        group = []
        for row, line in enumerate(black):
            for start, end in true_runs(line).tolist():
                y = low + what.marker - (row + 1) * step
                group.append((left + start * step, y, (end - start) * step, step))
        groups.append(group)
    return [*groups, _marks(what)]


def _modules(ids: Sequence[int]) -> list[NDArray[np.bool_]]:
    """Which modules of each marker are black, row by row from above, with the black border of one module."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{DICTIONARY}"))
    side = dictionary.markerSize + 2
    return [cv2.aruco.generateImageMarker(dictionary, number, side) < 128 for number in ids]


def _marks(what: Sheet) -> list[_Rectangle]:
    """The ruler below the markers, measured from the outer side of its first mark to that of its last; the origin."""
    thin, grow = STROKE, what.printed / RULER
    left, low = _MARGIN * grow, 9.0 * grow
    length = RULER * grow
    ruler = [(left, low, length, thin)]
    ruler += [
        (left + (length - thin) * i / 10, low + thin, thin, 4.0 if i in (0, 5, 10) else 2.5)
        for i in range(11)
    ]
    x, y = what.origin
    return [*ruler, (x - 4, y - thin, 4.0, thin), (x - thin, y - 4, thin, 4.0)]


def _words(what: Sheet) -> list[tuple[float, float, float, str]]:
    grow = what.printed / RULER
    text = "Measure this: 100 mm over all. If it is not, give what it measures as printed_length."
    return [
        ((_MARGIN + RULER + 5) * grow, y * grow, 2.8, line)
        for y, line in ((12.0, text), (8.0, what.label))
    ]


def _svg_rectangle(rectangle: _Rectangle, height: float) -> str:
    x, y, w, h = rectangle
    return f"M{_mm(x)} {_mm(height - y - h)}h{_mm(w)}v{_mm(h)}h{_mm(-w)}z"


def _mm(value: float) -> str:
    return short(value, 4)
