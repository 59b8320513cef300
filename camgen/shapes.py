"""What a reader returns: contours or a solid, and notes on what was skipped, mended or assumed on the way.

A segment of a contour is a line or an arc of at most half a circle, given by its bulge = tan(sweep / 4), positive
counter-clockwise (the DXF convention; CavalierContours shows that arcs survive an offset this way).
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.note import Note, NoteKind
from camgen.pose import FloatArray
from camgen.solid import Solid

__all__ = ["Contour", "Note", "NoteKind", "Part", "Raster"]


class Contour(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in the plane, work frame, mm.

    points: (N, 2), no point repeated at the end of a closed chain. bulges: (N,); ``bulges[i]`` shapes the segment
    that leaves point i, the last one counts only where ``closed``. |bulge| <= 1. id: the place in ``Part.contours``
    as users see it, e.g. ``c12``.
    """

    points: FloatArray
    bulges: FloatArray
    closed: bool
    layer: str
    id: str = ""


class Raster(Struct, frozen=True, eq=False):
    """A picture of a part, and what was seen in it. Pixel (0, 0) is the centre of the first one, v runs down.

    photo: as it was taken, (H, W) or (H, W, 3) blue, green, red. framed: (N, 2) px, the view's border in the photo.
    view: the work plane to scale, (h, w) or (h, w, 3). work_from_view: (2, 3), mm of a pixel centre of it. mask: (h, w)
    of the view, 255 where the part is. borders: of the part, closed, (N, 2) px of the view, finer than the mask.
    """

    photo: NDArray[np.uint8]
    framed: FloatArray
    view: NDArray[np.uint8]
    work_from_view: FloatArray
    mask: NDArray[np.uint8]
    borders: tuple[FloatArray, ...]


class Part(Struct, frozen=True, eq=False):
    """What was read. ``source`` is the file's name without folder, ``units`` says what one drawing unit was.

    raster: the picture that it was read from, None where there is none. solid: the 3-D part, None for a flat one.
    """

    name: str
    source: str
    units: str
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]
    raster: Raster | None = None
    solid: Solid | None = None
