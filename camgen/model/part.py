"""Parts as readers return them: contours, curves or a solid, with notes for the user."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from operator import attrgetter
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.drawing import draw_svg
from camgen.model.pose import FloatArray
from camgen.model.text import counted

_Item = TypeVar("_Item")
_get_id = attrgetter("id")

#: `skipped` is something in the input that the program will not do.
NoteKind = Literal["assumed", "repaired", "joined", "skipped", "warning"]


class Note(Struct, frozen=True):
    """A message to the user about something that was read or planned.

    kind: consequence for the program, see `GRAVEST`.
    what: the thing that the note is about, with its number or count.
    why: reason and remedy.
    ids: all contours and edges that the note is about.
    places: points in the part for the preview, mm.
    strict: whether `--strict` makes the note an error, as it always does for the kind `skipped`.
    lacks: the leads or tabs, if its paths have fewer or shorter ones than the job asks for; paths,
        if earlier operations leave nothing for them.
    length: length that is left out of an edge, mm; 0 if the whole edge is left out.
    """

    kind: NoteKind
    what: str
    why: str = ""
    ids: tuple[str, ...] = ()
    places: tuple[tuple[float, float], ...] = ()
    strict: bool = False
    lacks: Literal["", "leads", "tabs", "paths"] = ""
    length: float = 0.0

    @property
    def fails_strict(self) -> bool:
        """Whether `--strict` makes the note an error."""
        return self.strict or self.kind == "skipped"

    def __str__(self) -> str:
        reason = f" ({self.why})" if self.why else ""
        return f"{self.kind}: {self.what}{reason}"


#: Kinds of notes by severity: not done, possibly wrong, value assumed, input repaired or joined.
GRAVEST: tuple[NoteKind, ...] = ("skipped", "warning", "assumed", "repaired", "joined")


def sort_notes(*stages: Iterable[Note]) -> tuple[Note, ...]:
    """Each note once, sorted by kind as in `GRAVEST`, then strict before others, then by stage.

    Notes of later stages come first: they are closer to what the machine does. A note of two stages
    counts for the earlier one.
    """
    stage_of: dict[Note, int] = {}
    for stage, notes in enumerate(stages):
        for note in notes:
            stage_of.setdefault(note, stage)

    def rank(note: Note) -> tuple[int, bool, int]:
        return GRAVEST.index(note.kind), not note.strict, -stage_of[note]

    return tuple(sorted(stage_of, key=rank))


# A 3-D part: triangles for collision tests, and the sharp edges that a tool can follow.

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

EdgeKind = Literal["line", "arc", "circle", "curve"]

#: mm: a curve whose heights differ by no more is flat.
LEVEL_MM = 1e-3
#: rad: faces that meet at a smaller angle are one smooth surface. The margin above 30 deg treats
#: all walls at exactly 30 deg alike, whatever the rounding of their vertices is.
FEATURE_ANGLE = float(np.radians(30.05))


class Edge(Struct, frozen=True, eq=False):
    """A chain of spans between two faces of a part, each a line or an arc of at most half a circle.

    id: "e1" and so on.
    kind: a line has more than two points only if its normals change along it. A curve is neither
        line nor arc: its spans fit it within the tolerance of the reader.
    points: (N, 3) ends of the spans in order, mm; a closed edge ends with its first point again.
    via: (N - 1, 3) middle of each span, mm; on the chord of a straight span.
    normals: (N, 2, 3) unit outward normals of the two faces at `points`. The first one belongs to
        the face on the left of the direction of travel, seen from outside.
    via_normals: (N - 1, 2, 3) the same at `via`.
    angle: angle between the two normals, rad (RFA paper, section III.A), 0 for tangent faces.
    convex: whether it is an outer corner of the part, not an inner one.
    closed: whether the edge ends where it starts.
    radius: radius of an arc or a circle, mm, 0 for others.
    length: length along the edge, mm, arcs exact.
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
        shape = "convex" if self.convex else "concave"
        return f"Edge({self.id!r}, {self.kind}, {self.length:.3f} mm, {shape})"


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
    """A 3-D part.

    source: name of the file without its folder.
    units: unit of the file, in words.
    vertices: (V, 3) mm.
    faces: (F, 3) rows of vertices, counter-clockwise seen from outside.
    normals: (F, 3) unit outward normals.
    edges: sharp edges, in the order of their ids.
    borders: (N, 3) each, where the surface ends, mm; none if it is closed.
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
        faces, edges = counted(len(self.faces), "face"), counted(len(self.edges), "edge")
        return f"Solid({self.name!r}, {faces}, {edges})"


# The results of readers: contours, curves or a solid, with notes.


class Contour(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in the plane, work frame, mm.

    points: (N, 2); a closed chain does not repeat its first point at the end.
    bulges: (N,) tan(sweep / 4), from -1 to 1; `bulges[i]` shapes the segment that begins at point
        i. The last one counts only for a closed chain.
    id: number in `Part.contours` for the user, for example "c12".
    sources: ids of the contours from which this one was made; empty for a contour of the input.
    color: color of its first piece, for example "#ff0000"; "" if the input has none.
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
        points = counted(len(self.points), "point")
        return f"Contour({self.id!r}, {points}, {'closed' if self.closed else 'open'})"


def select_closed(contours: Iterable[Contour]) -> list[Contour]:
    """The closed contours, in order."""
    return [contour for contour in contours if contour.closed]


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
    """Contours whose arrays are views of one table.

    To make that table of 100,000 contours takes long, so it is kept.

    columns: the table.
    """

    columns: ContourColumns

    @classmethod
    def from_columns(cls, contours: Iterable[Contour], columns: ContourColumns) -> Contours:
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


def select_open(contours: Iterable[Contour]) -> list[Contour]:
    """The open ones of `contours`."""
    return [contour for contour in contours if not contour.closed]


def list_closed_rows(contours: Sequence[Contour]) -> list[int]:
    """The rows of the closed ones of `contours`."""
    return [row for row, contour in enumerate(contours) if contour.closed]


def list_layers(contours: Iterable[Contour]) -> list[str]:
    """The layers of `contours`, each once, sorted."""
    return sorted({contour.layer for contour in contours})


def count_arcs(contours: Sequence[Contour]) -> int:
    """The number of arcs of `contours`."""
    return int(np.count_nonzero(tabulate_contours(contours).bulges))


# Contours, edges, curves and paths have ids.


def list_ids(items: Iterable[Any]) -> tuple[str, ...]:
    """The ids of `items`, in order."""
    return tuple(item.id for item in items)


def index_by_id(items: Iterable[_Item]) -> dict[str, _Item]:
    """The `items` by their ids, in order."""
    return {_get_id(item): item for item in items}


def keep_ids(items: Iterable[_Item], ids: Container[str]) -> tuple[_Item, ...]:
    """The `items` whose id is in `ids`, in order."""
    return tuple(item for item in items if _get_id(item) in ids)


def drop_ids(items: Iterable[_Item], ids: Container[str]) -> tuple[_Item, ...]:
    """The `items` whose id is not in `ids`, in order."""
    return tuple(item for item in items if _get_id(item) not in ids)


class Curve(Struct, frozen=True, eq=False):
    """A chain of lines and arcs in space, work frame, mm.

    id: number in `Part.curves` for the user, for example "c12".
    points: (N, 3) ends of the spans in order; a closed curve ends with its first point again.
    middles: (N - 1, 3) middle of each span.
    curved: (N - 1,) whether a span is an arc, of at most half a circle.
    length: length along the curve, arcs exact.
    rotations: (N, 3, 3) work_from_tool at the points; None if the input has no orientations.
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
        """(N - 1, 3) middles of the arcs, NaN for lines."""
        return np.where(self.curved[:, None], self.middles, np.nan)

    @property
    def level(self) -> float | None:
        """Height of a curve that is parallel to the work plane, mm; None for others."""
        heights = np.concatenate([self.points[:, 2], self.middles[:, 2]])
        return float(heights[0]) if np.ptp(heights) <= LEVEL_MM else None

    def __repr__(self) -> str:
        return f"Curve({self.id!r}, {counted(len(self.points), 'point')}, {self.length:.3f} mm)"


#: A line in space that an arm can follow.
Line = Edge | Curve


class Raster(Struct, frozen=True, eq=False):
    """A photo of a part with the results of its segmentation.

    The centre of the first pixel is (0, 0); v points down.

    photo: (H, W) or (H, W, 3) blue, green, red, as it was taken.
    framed: (N, 2) border of the view in the photo, px.
    view: (h, w) or (h, w, 3) rectified view of the work plane.
    work_from_view: (2, 3) maps a pixel of the view to the work plane, mm.
    mask: (h, w) of the view, 255 on the part.
    borders: (N, 2) each, closed sub-pixel contours of the part in the view, px.
    doubt: (h, w), 255 where other segmentation methods differ; None if they agree everywhere.
    blur: standard deviation of the blur across the edges in the view, px; 0 if not measured.
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
    """A part as it was read.

    source: name of the file without its folder.
    units: unit of the drawing, in words.
    raster: the photo from which it was read, or None.
    solid: the 3-D part, None for a flat one.
    curves: curves in space. A part with curves has no contours; its solid, if any, is the part on
        or beside which they lie.
    worked: ids of the contours on which an operation works, the others only say where material is;
        None for all of them.
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
        """Whether an operation works on one of the contours `ids`."""
        return self.worked is None or not self.worked.isdisjoint(ids)

    def list_worked_rows(self) -> list[int]:
        """The rows of the contours on which an operation works, or on a source of which."""
        return [
            row
            for row, contour in enumerate(self.contours)
            if self.works_on(contour.sources or (contour.id,))
        ]

    def __repr__(self) -> str:
        geometry = counted(len(self.contours), "contour")
        if self.curves:
            geometry = counted(len(self.curves), "curve")
        elif self.solid is not None:
            geometry = repr(self.solid)
        return f"Part({self.name!r}, {geometry}, {counted(len(self.notes), 'note')})"

    def _repr_svg_(self) -> str | None:
        return draw_svg(self)
