"""What a 3-D part is to camgen: triangles for collision, and the sharp edges that a tool can follow.

All lengths mm, angles rad, coordinates those of the file: the part's own frame is the work frame.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.note import Note
from camgen.pose import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

EdgeKind = Literal["line", "arc", "circle", "curve"]

#: Faces that meet at less than this (rad) are one smooth surface.
FEATURE_ANGLE = float(np.radians(30.0))


class Edge(Struct, frozen=True, eq=False):
    """A chain of spans between two faces of a part, each a straight line or an arc of at most half a circle.

    id: "e1" and on. points: (N, 3) in order, the ends of the spans; a closed edge repeats its first point at the end.
    via: (N - 1, 3), the middle of each span; on the chord where the span is straight. normals: (N, 2, 3) outward unit
    normals of the two faces at ``points``, first of the face on the left of the way, seen from outside; via_normals:
    (N - 1, 2, 3) the same at ``via``. angle: between the two normals (RFA paper, section III.A), 0 where the faces are
    tangent. radius: of an arc or a circle, else 0. length: arcs exact.

    A line has more than two points only where the normals turn along it. A curve is what is neither: spans within the
    reader's tolerance.
    """

    id: str
    kind: EdgeKind
    points: FloatArray
    via: FloatArray
    normals: FloatArray
    via_normals: FloatArray
    angle: float
    convex: bool
    closed: bool
    radius: float
    length: float


class Solid(Struct, frozen=True, eq=False):
    """A 3-D part. ``source`` is the file's name without folder, ``units`` says what one unit of the file was.

    vertices: (V, 3). faces: (F, 3) indices, counter-clockwise seen from outside. normals: (F, 3) unit, outward.
    edges: sharp ones, in the order of their ids. borders: (N, 3) each, where the surface ends; none if it is closed.
    """

    name: str
    source: str
    units: str
    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    edges: tuple[Edge, ...]
    borders: tuple[FloatArray, ...]
    notes: tuple[Note, ...]
