"""Makes marker sheets, a ring of ArUco markers around a free area for the part, and ChArUco boards.

The work frame of a sheet has its origin at the lower left corner of the free area, x to the right,
y up, and z out of the paper. Two strokes outside of the area meet in that corner and mark it. If a
sheet was printed too small or too large, the measured length of its 100 mm ruler is given, and all
positions are scaled by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import find_true_runs
from camgen.model.errors import JobError
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short

DICTIONARY = "4X4_50"
#: Width and height of a page in landscape, mm.
SIZES = {"A4": (297.0, 210.0), "A3": (420.0, 297.0), "A2": (594.0, 420.0), "LETTER": (279.4, 215.9)}
#: mm: nominal length of the ruler.
RULER = 100.0
#: Width of the lines of the ruler and of the marks of the origin, mm.
STROKE = 0.3

#: mm: distance of the markers from the left, right and upper edge. Printers leave about 5 mm blank.
_MARGIN = 10.0
#: mm: distance of the markers from the lower edge, with the ruler.
_FOOT = 20.0
#: White between markers and around them, in widths of a marker. Detection needs a module of white,
#: a sixth of the width.
_GAP = 0.4
#: Markers of the dictionary.
_MAX_MARKERS = 50
#: mm: smallest width of a marker, and smallest height of the free area.
_MIN_MARKER, _MIN_FREE = 8.0, 20.0
#: Smallest and largest ratio of the printed and the nominal length of the ruler.
_PRINTED = (0.8, 1.25)


class Sheet(Struct, frozen=True, eq=False):
    """A marker sheet as printed.

    All lengths are in mm, scaled by the printed length of the ruler.

    size: name of the page size.
    page: width and height.
    origin: origin of the work frame, from the lower left corner of the page.
    free: width and height of the free area.
    marker: side of a marker.
    ids: (N,) numbers of the markers.
    corners: (N, 4, 2) upper left, upper right, lower right and lower left corner of each marker in
        the work frame.
    printed: measured length of the ruler.
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
        """Name of the sheet in messages and on the sheet itself."""
        nominal_marker = short(self.marker * RULER / self.printed, 2)
        return f"camgen {self.size} marker sheet, markers {nominal_marker} mm"


class Board(Struct, frozen=True):
    """A ChArUco board.

    Its work frame has its origin at the lower left corner of the squares, x to the right and y up,
    as the board is upright in OpenCV's own drawing of it.

    columns, rows: number of squares.
    square: side of a square, mm.
    marker: side of a marker, mm.
    dictionary: name of the dictionary of the markers.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = DICTIONARY

    @property
    def label(self) -> str:
        """Name of the board in messages."""
        return f"ChArUco board {self.columns}x{self.rows}"


def make_sheet(size: str = "A4", marker: float = 20.0, printed: float = RULER) -> Sheet:
    """Make a marker sheet.

    size: name of the page size, landscape.
    marker: nominal width of a marker, mm.
    printed: measured length of the 100 mm ruler on the paper, mm.

    Raises JobError for values that are not possible.
    """
    page = SIZES.get(size.upper())
    if page is None:
        raise JobError(
            "marker sheet", f"no size {size!r}", remedy=f"give one of {', '.join(SIZES)}"
        )
    if not (math.isfinite(printed) and RULER * _PRINTED[0] <= printed <= RULER * _PRINTED[1]):
        raise JobError(
            "marker sheet",
            f"the ruler of {short(RULER, 0)} mm cannot be {short(printed, 3)} mm long in print",
            remedy="measure the printed ruler from its first to its last mark, in mm",
        )
    max_marker = (page[1] - _MARGIN - _FOOT - _MIN_FREE) / (2 + 2 * _GAP)
    if not _MIN_MARKER <= marker <= max_marker:
        raise JobError(
            "marker sheet",
            f"markers of {short(marker, 2)} mm do not fit on {size.upper()}",
            remedy=f"give {short(_MIN_MARKER, 0)} to {short(max_marker - 0.05, 1)} mm",
        )
    left, low = _place_markers(page, marker)
    corner = (_MARGIN + marker * (1 + _GAP), _FOOT + marker * (1 + _GAP))
    free = (page[0] - 2 * corner[0], page[1] - _MARGIN - marker * (1 + _GAP) - corner[1])
    scale = printed / RULER
    square = marker * np.array([(0, 1), (1, 1), (1, 0), (0, 0)])
    corners = np.column_stack([left, low])[:, None, :] + square - corner
    return Sheet(
        size.upper(),
        (page[0] * scale, page[1] * scale),
        (corner[0] * scale, corner[1] * scale),
        (free[0] * scale, free[1] * scale),
        marker * scale,
        tuple(range(len(left))),
        frozen(corners * scale),
        printed,
    )


def _place_markers(page: tuple[float, float], marker: float) -> tuple[FloatArray, FloatArray]:
    """Left and lower sides (N,) of the markers around the page, clockwise from the upper left."""
    width, height = page[0] - 2 * _MARGIN, page[1] - _MARGIN - _FOOT
    columns, rows = _count_fitting(width, marker), _count_fitting(height, marker)
    while 2 * (columns + rows) - 4 > _MAX_MARKERS:
        if columns > rows:
            columns -= 1
        else:
            rows -= 1
    xs = np.linspace(_MARGIN, _MARGIN + width - marker, columns)
    ys = np.linspace(_FOOT + height - marker, _FOOT, rows)
    left = [xs, np.full(rows - 1, xs[-1]), xs[-2::-1], np.full(rows - 2, xs[0])]
    low = [np.full(columns, ys[0]), ys[1:], np.full(columns - 1, ys[-1]), ys[-2:0:-1]]
    return np.concatenate(left), np.concatenate(low)


def _count_fitting(length: float, marker: float) -> int:
    """Number of markers with gaps that fit into a length, mm."""
    return int((length + marker * _GAP) / (marker * (1 + _GAP)) + 1e-9)


# Drawings of a sheet.

#: Left and lower side, width and height, mm.
_Rectangle = tuple[float, float, float, float]


def draw_svg(what: Sheet) -> bytes:
    """Draw a sheet as an SVG page in mm, to be printed at 100 %."""
    width, height = what.page
    paths = ""
    for group in _list_rectangles(what):
        outline = "".join(
            f"M{_mm(x)} {_mm(height - y - h)}h{_mm(w)}v{_mm(h)}h{_mm(-w)}z" for x, y, w, h in group
        )
        paths += f'<path d="{outline}"/>\n'
    words = "".join(
        f'<text x="{_mm(x)}" y="{_mm(height - y)}" font-family="Helvetica, Arial, sans-serif" '
        f'font-size="{_mm(size)}">{text}</text>\n'
        for x, y, size, text in _list_words(what)
    )
    page = (
        f'width="{_mm(width)}mm" height="{_mm(height)}mm" viewBox="0 0 {_mm(width)} {_mm(height)}"'
    )
    return f'<svg xmlns="http://www.w3.org/2000/svg" {page}>\n{paths}{words}</svg>\n'.encode()


def draw_pdf(what: Sheet) -> bytes:
    """Draw a sheet as a PDF page of its true size.

    Viewers are asked to print it unscaled (PDF 1.7, 12.2).
    """
    point = 72 / 25.4
    content = [f"{point:.9f} 0 0 {point:.9f} 0 0 cm"]
    for group in _list_rectangles(what):
        content += [" ".join([*map(_mm, rectangle), "re"]) for rectangle in group]
        content.append("f")
    for x, y, size, text in _list_words(what):
        content.append(f"BT /F1 {_mm(size)} Tf {_mm(x)} {_mm(y)} Td ({text}) Tj ET")
    stream = "\n".join(content)
    width, height = what.page
    return _make_pdf(
        [
            "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            "<< /Type /Page /Parent 2 0 R "
            f"/MediaBox [0 0 {width * point:.4f} {height * point:.4f}] "
            "/Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>",
            f"<< /Length {len(stream)} >>\nstream\n{stream}\nendstream",
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        ]
    )


def _make_pdf(objects: Sequence[str]) -> bytes:
    """A PDF file of objects, the first one its catalog, with their table (PDF 1.7, 7.5)."""
    text = "%PDF-1.4\n"
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(text))
        text += f"{number} 0 obj\n{body}\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    count = len(objects) + 1
    end = f"trailer\n<< /Size {count} /Root 1 0 R >>\nstartxref\n{len(text)}\n%%EOF\n"
    return f"{text}xref\n0 {count}\n0000000000 65535 f \n{table}{end}".encode("ascii")


def _list_rectangles(what: Sheet) -> list[list[_Rectangle]]:
    """Black rectangles on the page, in groups: one for each marker, the last for ruler and marks.

    A group is filled as one path, so that no hair line shows between the modules of a marker.
    """
    groups = []
    for black, corners in zip(_draw_modules(what.ids), what.corners, strict=True):
        left, low = (corners[3] + what.origin).tolist()
        step = what.marker / len(black)
        group = []
        for row, line in enumerate(black):
            for start, end in find_true_runs(line).tolist():
                y = low + what.marker - (row + 1) * step
                group.append((left + start * step, y, (end - start) * step, step))
        groups.append(group)
    return [*groups, _list_marks(what)]


def _draw_modules(ids: Sequence[int]) -> list[NDArray[np.bool_]]:
    """The modules of each marker with its border of one module, rows from above: True is black."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{DICTIONARY}"))
    side = dictionary.markerSize + 2
    return [cv2.aruco.generateImageMarker(dictionary, number, side) < 128 for number in ids]


def _list_marks(what: Sheet) -> list[_Rectangle]:
    """The ruler below the markers, and the two strokes at the origin.

    The ruler is measured from the outer side of its first mark to that of its last.
    """
    thin, scale = STROKE, what.printed / RULER
    left, low = _MARGIN * scale, 9.0 * scale
    length = RULER * scale
    ruler = [(left, low, length, thin)]
    ruler += [
        (left + (length - thin) * i / 10, low + thin, thin, 4.0 if i in (0, 5, 10) else 2.5)
        for i in range(11)
    ]
    x, y = what.origin
    return [*ruler, (x - 4, y - thin, 4.0, thin), (x - thin, y - 4, thin, 4.0)]


def _list_words(what: Sheet) -> list[tuple[float, float, float, str]]:
    """Lines of text: x, y and size, mm, and the text."""
    scale = what.printed / RULER
    text = "Measure this: 100 mm over all. If it is not, give what it measures as printed_length."
    left = (_MARGIN + RULER + 5) * scale
    return [(left, 12.0 * scale, 2.8, text), (left, 8.0 * scale, 2.8, what.label)]


def _mm(value: float) -> str:
    return short(value, 4)
