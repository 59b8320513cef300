"""Sews faces that do not share their edges, and joins bodies that touch face to face."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, compress
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.part import BoolArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.read.solid import kernel
from camgen.read.solid.topology import label_components

#: mm: smallest tolerance for sewing. Smaller gaps do not matter to any machine.
_MIN_TOLERANCE_MM = 1e-4
#: Largest tolerance for sewing, as a fraction of the size of all bodies. A larger uncertainty in a
#: file is a mistake.
_MAX_TOLERANCE = 1e-3
#: Fraction by which the tolerance is raised for the rounding of numbers in a text.
_ROUNDING = 0.01


class Body(Struct, frozen=True, eq=False):
    """A solid, or a surface of faces that belong to no solid.

    name: its name in the file, "" without one.
    shape: shape of the kernel.
    is_solid: whether the file states that it is a solid.
    """

    name: str
    shape: Any
    is_solid: bool


def choose_tolerance(stated: float, size: float) -> tuple[float, list[Note]]:
    """The distance over which faces are sewn, mm, and a note if the stated one is too large.

    stated: uncertainty that the file states, mm, 0 for none.
    size: size of all bodies, mm.
    """
    limit = max(_MAX_TOLERANCE * size, _MIN_TOLERANCE_MM)
    if stated <= limit:
        return max(stated, _MIN_TOLERANCE_MM), []
    return limit, [
        Note(
            "assumed",
            f"faces no more than {short(limit, 4)} mm apart belong together",
            f"the file states an uncertainty of {short(stated, 4)} mm, too much for its size",
        )
    ]


class _Sewing(NamedTuple):
    """The result of sewing a body.

    pieces: solids, shells and faces.
    edges: number of edges that two faces share after sewing and did not share before.
    gap: largest distance between their faces, mm.
    turned: number of faces that were wound against the others.
    lost: number of edges and faces that are smaller than the tolerance and were left out.
    """

    pieces: list[Any]
    edges: int = 0
    gap: float = 0.0
    turned: int = 0
    lost: int = 0


def sew_bodies(bodies: Sequence[Body], tolerance: float) -> tuple[list[Body], list[Note]]:
    """Make edges common that are within `tolerance` (mm). Returns the bodies, and notes.

    Solids are sewn one by one, surfaces all together. Each connected surface is one body then.
    """
    result, surfaces, sewings = list[Body](), list[Body](), list[_Sewing]()
    for body in bodies:
        if not body.is_solid:
            surfaces.append(body)
            continue
        sewing = _sew(body.shape, tolerance, True)
        sewings.append(sewing)
        result.append(replace(body, shape=kernel.make_compound(sewing.pieces)))
    if surfaces:
        sewing = _sew(kernel.make_compound(_list_shapes(surfaces)), tolerance, False)
        sewings.append(sewing)
        names = {body.name for body in surfaces}
        name = names.pop() if len(names) == 1 else ""
        pieces = [Body(name, piece, kernel.is_solid(piece)) for piece in sewing.pieces]
        result += pieces if sewing.edges else surfaces
    return result, list(_note_sewing(sewings))


def _sew(shape: Any, tolerance: float, is_solid: bool) -> _Sewing:
    """A body with its faces sewn. It is unchanged if no edges are close together."""
    edges = kernel.list_edges(shape)
    if all(len(edge.uses) > 1 or kernel.is_degenerate(edge.edge) for edge in edges):
        return _Sewing([shape])
    tool = kernel.import_ocp("BRepBuilderAPI").BRepBuilderAPI_Sewing(tolerance * (1 + _ROUNDING))
    faces = list(kernel.list_subshapes(shape, "Face"))
    for face in faces:
        tool.Add(face)
    tool.Perform()
    sewn = tool.SewedShape()
    shared = _list_shared(kernel.list_edges(sewn))
    count = len(shared) - len(_list_shared(edges))
    if count <= 0:
        return _Sewing([shape])
    was_forward = {hash(tool.ModifiedSubShape(face)): kernel.is_forward(face) for face in faces}
    pieces = _list_pieces(sewn, was_forward, is_solid)
    lost = int(tool.NbDegeneratedShapes()) + int(tool.NbDeletedFaces())
    gap = max(map(kernel.measure_tolerance, shared))
    turned = sum(_count_turned(piece, was_forward) for piece in pieces)
    return _Sewing(pieces, count, gap, turned, lost)


def _list_shared(edges: Sequence[kernel.EdgeUses]) -> list[Any]:
    return [edge.edge for edge in edges if len(edge.uses) > 1]


def _list_pieces(sewn: Any, was_forward: Mapping[int, bool], is_solid: bool) -> list[Any]:
    """The shells of a sewn shape, closed ones as solids, and the faces that are in no shell.

    A closed shell is turned outward. Other shells keep the orientation that most of their faces
    had. So do the shells of a solid with several, because some of them bound its voids.

    was_forward: orientation of each face before sewing, by its hash.
    """
    shells = list(kernel.list_subshapes(sewn, "Shell"))
    pieces = []
    for shell in shells:
        if shell.Closed() and not (is_solid and len(shells) > 1):
            pieces.append(kernel.make_solid(shell))
        else:
            face_count = len(list(kernel.list_subshapes(shell, "Face")))
            is_turned = 2 * _count_turned(shell, was_forward) > face_count
            pieces.append(shell.Reversed() if is_turned else shell)
    return pieces + list(kernel.list_subshapes(sewn, "Face", "Shell"))


def _count_turned(shape: Any, was_forward: Mapping[int, bool]) -> int:
    """The number of faces whose orientation changed. `was_forward` is as in `_list_pieces`."""
    count = 0
    for face in kernel.list_subshapes(shape, "Face"):
        is_forward = kernel.is_forward(face)
        count += was_forward.get(hash(face), is_forward) != is_forward
    return count


def _note_sewing(sewings: Sequence[_Sewing]) -> Iterator[Note]:
    _, edges, gaps, turned, lost = zip(*sewings, strict=True)
    if any(edges):
        text = counted(
            sum(edges), "edge that faces did not share was", "edges that faces did not share were"
        )
        why = f"the faces are no more than {max(gaps):.2g} mm apart"
        yield Note("repaired", f"{text} sewn", why)
    if any(turned):
        text = counted(sum(turned), "face was", "faces were")
        yield Note("repaired", f"{text} wound against the others of the body and turned")
    if any(lost):
        text = counted(sum(lost), "edge or face was", "edges or faces were")
        yield Note("skipped", f"{text} left out", "smaller than the tolerance of sewing")


# Bodies that touch.


class _FaceTable(NamedTuple):
    """The faces of a body.

    boxes: (F, 2, 3) mm, corners of boxes around them.
    surfaces: surfaces of the faces.
    """

    boxes: FloatArray
    surfaces: list[kernel.Surface]


def join_touching(bodies: Sequence[Body], tolerance: float) -> tuple[Any, list[Note]]:
    """All bodies as one shape, in which bodies that touch face to face are joined, and notes.

    Joined bodies have no edge where they are flush, and a concave one where one ends on another.
    """
    solids: list[Body] = []
    shapes: list[Any] = []
    for body in bodies:
        if kernel.is_solid(body.shape):
            solids.append(body)
        else:
            shapes.append(body.shape)
    if len(solids) < 2:
        return kernel.make_compound(_list_shapes(bodies)), []
    tables = list(map(_tabulate, _list_shapes(solids)))
    pairs = np.array(list(combinations(range(len(solids)), 2)))
    may_touch = [_may_touch(tables[a], tables[b], tolerance) for a, b in pairs.tolist()]
    first, second = pairs[np.array(may_touch)].T
    group = label_components(len(solids), first, second)
    notes: list[Note] = []
    for label in np.unique(group).tolist():
        members = list(compress(solids, group == label))
        shapes += _join(members, tolerance, notes) if len(members) > 1 else [members[0].shape]
    return kernel.make_compound(shapes), notes


def _join(bodies: Sequence[Body], tolerance: float, notes: list[Note]) -> list[Any]:
    """The shapes of bodies that may touch, joined if they do."""
    shapes = _list_shapes(bodies)
    union = kernel.unite(shapes, tolerance)
    if union is None:
        notes.append(
            Note(
                "warning",
                f"{len(bodies)} bodies that may touch cannot be joined: {_list_names(bodies)}",
                "where they are flush, their seam is an edge",
            )
        )
        return shapes
    count = len(list(kernel.list_subshapes(union, "Solid")))
    if count == len(shapes):
        return shapes
    overlap = sum(map(kernel.measure_volume, shapes)) - kernel.measure_volume(union)
    if abs(overlap) > tolerance * sum(map(kernel.measure_area, shapes)):
        return _set_aside(bodies, overlap, tolerance, notes)
    notes.append(
        Note(
            "joined",
            f"{len(bodies)} bodies that touch are worked as {count}: {_list_names(bodies)}",
            "no edge where they are flush, a concave one where one ends on another",
        )
    )
    return [union]


def _set_aside(
    bodies: Sequence[Body], overlap: float, tolerance: float, notes: list[Note]
) -> list[Any]:
    """The shapes of bodies if some overlap: these unchanged, the others joined where they touch.

    overlap: volume that the bodies share, mm3.
    """
    is_aside = np.zeros(len(bodies), bool)
    for a, b in combinations(range(len(bodies)), 2):
        if _overlap(bodies[a].shape, bodies[b].shape, tolerance):
            is_aside[[a, b]] = True
    is_aside |= not is_aside.any()
    alone, others = list(compress(bodies, is_aside)), list(compress(bodies, ~is_aside))
    notes.append(
        Note(
            "warning",
            f"{len(alone)} bodies overlap by {short(overlap, 1)} mm3: {_list_names(alone)}",
            "each has its edges as if it stood alone",
        )
    )
    shapes = _list_shapes(alone)
    if others:
        joined, more = join_touching(others, tolerance)
        shapes.append(joined)
        notes += more
    return shapes


def _overlap(first: Any, second: Any, tolerance: float) -> bool:
    """Whether two solids share more volume than a contact within the tolerance explains."""
    boxes = kernel.measure_box(first)[None], kernel.measure_box(second)[None]
    if not _meet(boxes[0], boxes[1], tolerance).all():
        return False
    common = kernel.intersect(first, second, tolerance)
    slack = tolerance * (kernel.measure_area(first) + kernel.measure_area(second))
    return common is not None and kernel.measure_volume(common) > slack


def _list_shapes(bodies: Sequence[Body]) -> list[Any]:
    return [body.shape for body in bodies]


def _list_names(bodies: Sequence[Body]) -> str:
    return ", ".join(body.name or "one without a name" for body in bodies)


def _tabulate(shape: Any) -> _FaceTable:
    faces = list(kernel.list_subshapes(shape, "Face"))
    boxes = np.array(list(map(kernel.measure_box, faces))).reshape(-1, 2, 3)
    return _FaceTable(boxes, list(map(kernel.Surface, faces)))


def _may_touch(first: _FaceTable, second: _FaceTable, tolerance: float) -> bool:
    """Whether two bodies have faces with boxes that meet on the same surface."""
    if not _meet(_enclose(first.boxes), _enclose(second.boxes), tolerance).all():
        return False
    near = _meet(first.boxes, second.boxes, tolerance)
    return any(
        first.surfaces[a].is_same(second.surfaces[b], tolerance)
        for a, b in np.argwhere(near).tolist()
    )


def _enclose(boxes: FloatArray) -> FloatArray:
    """(1, 2, 3) the box that encloses all boxes (F, 2, 3)."""
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])[None]


def _meet(first: FloatArray, second: FloatArray, tolerance: float) -> BoolArray:
    """(N, M) whether boxes (N, 2, 3) and (M, 2, 3) are within the tolerance of each other."""
    lower = np.maximum(first[:, None, 0], second[None, :, 0])
    upper = np.minimum(first[:, None, 1], second[None, :, 1])
    return np.asarray((lower <= upper + tolerance).all(axis=2))
