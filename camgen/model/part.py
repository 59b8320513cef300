"""What the user should know about what was read or planned."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.drawing import draw_svg
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: ``skipped`` is something of the input that the program will not do.
NoteKind = Literal["assumed", "repaired", "joined", "skipped", "warning"]


class Note(Struct, frozen=True):
    """One thing the user should know. ``what`` names and counts it, ``why`` gives the reason and the remedy.

    ids: of the contours and edges that it is about, all of them. places: mm, where it is in the part, for the preview.
    strict: --strict makes it an error, as it does of all that was skipped.
    lacks: the part of their paths of which there is less than the job asks for.
    length: mm that are left out of an edge; 0 where the edge is left out as a whole.
    """

    kind: NoteKind
    what: str
    why: str = ""
    ids: tuple[str, ...] = ()
    places: tuple[tuple[float, float], ...] = ()
    strict: bool = False
    lacks: Literal["", "leads", "tabs"] = ""
    length: float = 0.0

    @property
    def fails_strict(self) -> bool:
        """Whether --strict makes it an error."""
        return self.strict or self.kind == "skipped"

    def __str__(self) -> str:
        return f"{self.kind}: {self.what}" + (f" ({self.why})" if self.why else "")


#: The gravest first: what is not done, what may be wrong, what was taken for granted or mended.
GRAVEST: tuple[NoteKind, ...] = ("skipped", "warning", "assumed", "repaired", "joined")


def sort_notes(*stages: Iterable[Note]) -> tuple[Note, ...]:
    """Each note once, the gravest first. Of one kind what --strict refuses leads; then what a later stage says goes
    before what reading said: it is about what the machine does.
    """
    stage_of = {note: k for k, notes in reversed([*enumerate(stages)]) for note in notes}
    once = dict.fromkeys(note for notes in stages for note in notes)
    return tuple(
        sorted(once, key=lambda note: (GRAVEST.index(note.kind), not note.strict, -stage_of[note]))
    )


# What a 3-D part is to camgen: triangles for collision, and the sharp edges that a tool can follow.

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

EdgeKind = Literal["line", "arc", "circle", "curve"]

#: A curve whose heights differ by no more, mm, is flat.
LEVEL_MM = 1e-3
#: Faces that meet at less than this (rad) are one smooth surface. The margin above 30 deg treats
#: walls at exactly 30 deg alike, whatever the rounding of their vertices is.
FEATURE_ANGLE = float(np.radians(30.05))


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

    def __repr__(self) -> str:
        return f"Edge({self.id!r}, {self.kind}, {self.length:.3f} mm, {'convex' if self.convex else 'concave'})"


#: Names of bodies that are listed in a summary.
_LISTED_BODIES = 20


def describe_bodies(bodies: Sequence[str]) -> str:
    """The number of bodies and their names, each once: "3 (lid, 2 x foot)"."""
    names = Counter(filter(None, bodies))
    texts = [f"{count} x {name}" if count > 1 else name for name, count in names.items()]
    if len(texts) > _LISTED_BODIES:
        texts[_LISTED_BODIES:] = [f"{len(texts) - _LISTED_BODIES} more names"]
    return f"{len(bodies)} ({', '.join(texts)})" if texts else f"{len(bodies)}"


class Solid(Struct, frozen=True, eq=False):
    """A 3-D part. ``source`` is the file's name without folder, ``units`` says what one unit of the file was.

    vertices: (V, 3). faces: (F, 3) indices, counter-clockwise seen from outside. normals: (F, 3) unit, outward.
    edges: sharp ones, in the order of their ids. borders: (N, 3) each, where the surface ends; none if it is closed.
    bodies: names of the bodies, "" for a body without a name.
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
    bodies: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Solid({self.name!r}, {counted(len(self.faces), 'face')}, {counted(len(self.edges), 'edge')})"


# What a reader returns: contours or a solid, and notes on what was skipped, mended or assumed on the way.


class Contour(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in the plane, work frame, mm.

    points: (N, 2), no point repeated at the end of a closed chain. bulges: (N,); ``bulges[i]`` shapes the segment
    that leaves point i, the last one counts only where ``closed``. |bulge| <= 1. id: the place in ``Part.contours``
    as users see it, e.g. ``c12``. sources: ids of the contours that it was
    made of, where it is none of the input. color: "#ff0000", of its first piece; "" where the input has none.
    is_mark: whether it stands for a point of the drawing, which is drilled and nothing else.
    """

    points: FloatArray
    bulges: FloatArray
    closed: bool
    layer: str
    id: str = ""
    sources: tuple[str, ...] = ()
    color: str = ""
    is_mark: bool = False

    def __repr__(self) -> str:
        return f"Contour({self.id!r}, {counted(len(self.points), 'point')}, {'closed' if self.closed else 'open'})"


class ContourColumns(NamedTuple):
    """The points of C contours in one table.

    points: (N, 2) mm, contour after contour.
    bulges: (N,) as in `Contour`.
    counts: (C,) number of points of each contour.
    closed: (C,) whether each contour is closed.
    """

    points: FloatArray
    bulges: FloatArray
    counts: NDArray[np.intp]
    closed: BoolArray


class Contours(tuple[Contour, ...]):
    """Contours that are stretches of one table, which takes long to make of 100,000 of them."""

    columns: ContourColumns

    @classmethod
    def of(cls, contours: Iterable[Contour], columns: ContourColumns) -> Contours:
        """Contours with the table of which their arrays are views."""
        views = cls(contours)
        views.columns = columns
        return views


def tabulate_contours(contours: Sequence[Contour]) -> ContourColumns:
    """The points of `contours` in one table, in order."""
    if isinstance(contours, Contours):
        return contours.columns
    rows = [(contour.points, contour.bulges, contour.closed) for contour in contours]
    if not rows:
        return ContourColumns(
            np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.intp), np.zeros(0, np.bool_)
        )
    points, bulges, closed = zip(*rows, strict=True)
    counts = np.array(list(map(len, bulges)))
    return ContourColumns(np.concatenate(points), np.concatenate(bulges), counts, np.array(closed))


class Curve(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in space, work frame, mm.

    points: (N, 3) in order, the ends of the spans; a closed one repeats its first point at the end. middles: (N - 1, 3)
    of the spans. curved: (N - 1,) whether each is an arc, of at most half a circle, and no line. length: arcs exact.
    rotations: (N, 3, 3) work_from_tool at the points, None where the input does not say how the tool stands. id: the
    place in ``Part.curves`` as users see it, e.g. ``c12``.
    """

    id: str
    layer: str
    points: FloatArray
    middles: FloatArray
    curved: BoolArray
    closed: bool
    length: float
    rotations: FloatArray | None = None

    @property
    def via(self) -> FloatArray:
        """(N - 1, 3) half-way along the arcs, NaN for lines."""
        return np.where(self.curved[:, None], self.middles, np.nan)

    @property
    def level(self) -> float | None:
        """The height, mm, of one that lies parallel to the work plane, None of others."""
        heights = np.concatenate([self.points[:, 2], self.middles[:, 2]])
        return float(heights[0]) if np.ptp(heights) <= LEVEL_MM else None

    def __repr__(self) -> str:
        return f"Curve({self.id!r}, {counted(len(self.points), 'point')}, {self.length:.3f} mm)"


#: What an arm follows in space.
Line = Edge | Curve


class Raster(Struct, frozen=True, eq=False):
    """A picture of a part, and what was seen in it. Pixel (0, 0) is the centre of the first one, v runs down.

    photo: as it was taken, (H, W) or (H, W, 3) blue, green, red. framed: (N, 2) px, the view's border in the photo.
    view: the work plane to scale, (h, w) or (h, w, 3). work_from_view: (2, 3), mm of a pixel centre of it. mask: (h, w)
    of the view, 255 where the part is. borders: of the part, closed, (N, 2) px of the view, finer than the mask.
    doubt: (h, w), 255 where other ways to tell the part from the bench see it differently, None where none does.
    blur: across its edges, px of the view, a standard deviation; 0: not measured.
    """

    photo: NDArray[np.uint8]
    framed: FloatArray
    view: NDArray[np.uint8]
    work_from_view: FloatArray
    mask: NDArray[np.uint8]
    borders: tuple[FloatArray, ...]
    doubt: NDArray[np.uint8] | None = None
    blur: float = 0.0


class OpenOutline(Struct, frozen=True):
    """A chain of open contours that would enclose closed ones if its gaps were closed.

    ids: the open contours along the chain.
    inside: the closed contours that it would enclose.
    gap: width of its widest gap, mm.
    place: middle of that gap, mm.
    join: value of `input.join` that closes all open outlines of the drawing, mm; 0 for a part that
        no reader has joined.
    """

    ids: tuple[str, ...]
    inside: tuple[str, ...]
    gap: float
    place: tuple[float, float]
    join: float


class EarlierRun(Struct, frozen=True, eq=False):
    """The lines and arcs along which a flat tool runs before an operation, seen from above.

    start: (N, 2) mm.
    end: (N, 2) mm.
    bulge: (N,) tangent of a quarter of the angle of an arc, 0 for a line.
    radius: radius of the tool, mm.
    depth: depth of the last pass, mm.
    """

    start: FloatArray
    end: FloatArray
    bulge: FloatArray
    radius: float
    depth: float


class Part(Struct, frozen=True, eq=False):
    """What was read. ``source`` is the file's name without folder, ``units`` says what one drawing unit was.

    raster: the picture that it was read from, None where there is none. solid: the 3-D part, None for a flat one.
    curves: in space; where there are any there are no contours, and a solid is what they lie on or beside. worked:
    ids of the contours that an operation works on, the others only say where material is; None: all of them.

    open_outlines: outlines with a gap that enclose closed contours.
    moved: distance in x and y by which `input.origin` moved the drawing, mm; None without it.
    earlier: lines and arcs of the tools of operations that run before, for `operation.rest`.
    clamps: closed contours on the layers that `cell.fixtures` names; none of `contours`.
    """

    name: str
    source: str
    units: str
    contours: tuple[Contour, ...]
    notes: tuple[Note, ...]
    raster: Raster | None = None
    solid: Solid | None = None
    curves: tuple[Curve, ...] = ()
    worked: frozenset[str] | None = None
    open_outlines: tuple[OpenOutline, ...] = ()
    moved: tuple[float, float] | None = None
    earlier: tuple[EarlierRun, ...] = ()
    clamps: tuple[Contour, ...] = ()

    def works_on(self, ids: tuple[str, ...]) -> bool:
        """Whether one of the contours ``ids`` is worked on."""
        return self.worked is None or not self.worked.isdisjoint(ids)

    def __repr__(self) -> str:
        what = counted(len(self.contours), "contour") if self.solid is None else repr(self.solid)
        what = counted(len(self.curves), "curve") if self.curves else what
        return f"Part({self.name!r}, {what}, {counted(len(self.notes), 'note')})"

    def _repr_svg_(self) -> str | None:
        return draw_svg(self)
