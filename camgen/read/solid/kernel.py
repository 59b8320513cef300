"""The CAD kernel (OCCT by the package OCP, extra ``step``): shapes in, numbers out.

Other modules reach it through `part` alone.

OCP 8 renamed and dropped some of what OCP 7 has; only what both have is used, or asked for here. All is in mm: OCCT
converts when it reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: What a shape that is sound on paper only makes the kernel raise.
STUMBLES = (RuntimeError, ValueError, TypeError)
#: A step along an edge, as a part of its parameters, away from a place where the surface has no normal.
_ASIDE = 1e-4


class Meeting(Struct, frozen=True, eq=False):
    """An edge of the shape and the faces that have it: (edge as it runs in the face, face) each."""

    edge: Any
    uses: list[tuple[Any, Any]]


def part(name: str) -> Any:
    """A module of ``OCP`` by its name. ``ImportError`` if the extra is not installed."""
    return import_module(f"OCP.{name}")


def inside(shape: Any, kind: str, avoid: str = "Shape") -> Iterator[Any]:
    """All sub-shapes of a kind ("Face", "Edge") that a shape uses, as it uses them.

    avoid: kind of sub-shapes that are not looked into.
    """
    kinds = part("TopAbs")
    explorer = part("TopExp").TopExp_Explorer(
        shape, *(getattr(kinds, f"TopAbs_{name.upper()}") for name in (kind, avoid))
    )
    topods = part("TopoDS").TopoDS
    cast = getattr(topods, f"{kind}_s", None) or getattr(topods, kind)
    while explorer.More():
        yield cast(explorer.Current())
        explorer.Next()


def members(shape: Any) -> Iterator[Any]:
    """The shapes that a compound is made of, in its place."""
    iterator = part("TopoDS").TopoDS_Iterator(shape)
    while iterator.More():
        yield iterator.Value()
        iterator.Next()


def make_compound(shapes: Sequence[Any]) -> Any:
    """One shape of several; the same one if it is alone."""
    if len(shapes) == 1:
        return shapes[0]
    compound, builder = part("TopoDS").TopoDS_Compound(), part("BRep").BRep_Builder()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def count_wires(shape: Any) -> int:
    """How many curves of ``shape`` are in no face."""
    return sum(1 for _ in inside(shape, "Edge", "Face"))


def is_solid(shape: Any) -> bool:
    """Whether a shape is one closed body."""
    return bool(shape.ShapeType().name == "TopAbs_SOLID")


def make_solid(shell: Any) -> Any:
    """The solid in a closed shell, with its faces outward."""
    solid = part("BRepBuilderAPI").BRepBuilderAPI_MakeSolid(shell).Solid()
    part("BRepLib").BRepLib.OrientClosedSolid_s(solid)
    return solid


def unite(solids: Sequence[Any], tolerance: float) -> Any:
    """The union of solids that may be `tolerance` (mm) apart, None if the kernel finds none."""
    return _combine("Fuse", solids, tolerance)


def intersect(first: Any, second: Any, tolerance: float) -> Any:
    """The volume that two solids share, None if the kernel finds none."""
    return _combine("Common", [first, second], tolerance)


def _combine(operation: str, solids: Sequence[Any], tolerance: float) -> Any:
    algorithm = getattr(part("BRepAlgoAPI"), f"BRepAlgoAPI_{operation}")()
    algorithm.SetArguments(_list_shapes(solids[:1]))
    algorithm.SetTools(_list_shapes(solids[1:]))
    algorithm.SetFuzzyValue(tolerance)
    try:
        algorithm.Build()
    except (part("Standard").Standard_Failure, *STUMBLES):
        return None
    return algorithm.Shape() if algorithm.IsDone() and not algorithm.Shape().IsNull() else None


def _list_shapes(shapes: Sequence[Any]) -> Any:
    """A list of the kernel: OCP 8 has it under another name than OCP 7."""
    try:
        listed = part("TopTools").TopTools_ListOfShape()
    except (ImportError, AttributeError):
        listed = part("collections").List_TopoDS_Shape()
    for shape in shapes:
        listed.Append(shape)
    return listed


#: Surfaces are the same if their axes agree to this (rad).
_PARALLEL = 1e-4


class Surface:
    """The surface of a face, to compare it with others."""

    def __init__(self, face: Any) -> None:
        adaptor = part("BRepAdaptor").BRepAdaptor_Surface(face, False)
        self.kind = str(adaptor.GetType().name)
        self._axis, self._place, self._radius = np.zeros(3), np.zeros(3), 0.0
        if self.kind in ("GeomAbs_Plane", "GeomAbs_Cylinder"):
            is_plane = self.kind == "GeomAbs_Plane"
            shape = adaptor.Plane() if is_plane else adaptor.Cylinder()
            self._axis = np.array(shape.Axis().Direction().Coord())
            self._place = np.array(shape.Location().Coord())
            self._radius = 0.0 if is_plane else float(shape.Radius())

    def is_same(self, other: Surface, tolerance: float) -> bool:
        """Whether two surfaces are within `tolerance` (mm) of each other; True if that is not known."""
        if self.kind != other.kind:
            return False
        if np.linalg.norm(cross(self._axis, other._axis)) > _PARALLEL:
            return False
        offset = other._place - self._place
        along = offset @ self._axis
        is_plane = self.kind == "GeomAbs_Plane"
        distance = abs(along) if is_plane else np.linalg.norm(offset - along * self._axis)
        is_near = distance <= tolerance and abs(self._radius - other._radius) <= tolerance
        return bool(is_near) or not self._axis.any()


def meetings(shape: Any) -> list[Meeting]:
    """Every edge of the faces of ``shape`` once, in the order of the file."""
    found: dict[int, list[Meeting]] = {}
    for face in inside(shape, "Face"):
        for edge in inside(face, "Edge"):
            same = found.setdefault(hash(edge), [])
            meeting = next((m for m in same if m.edge.IsSame(edge)), None)
            if meeting is None:
                meeting = Meeting(edge, [])
                same.append(meeting)
            meeting.uses.append((edge, face))
    return [m for same in found.values() for m in same]


def forward(shape: Any) -> bool:
    """Whether an edge runs with its parameter, or a face points the way of its surface."""
    return bool(shape.Orientation().name == "TopAbs_FORWARD")


def degenerate(edge: Any) -> bool:
    """Whether an edge is but a point."""
    tool = part("BRep").BRep_Tool
    return bool(tool.Degenerated_s(edge))


class Curve:
    """An edge as a curve: ``kind`` as OCCT names it ("Line", "Circle", ...), parameters from ``low`` to ``high``."""

    def __init__(self, edge: Any) -> None:
        self._curve = part("BRepAdaptor").BRepAdaptor_Curve(edge)
        self._gp = part("gp")
        self.kind = str(self._curve.GetType().name).removeprefix("GeomAbs_")
        self.low, self.high = (
            float(self._curve.FirstParameter()),
            float(self._curve.LastParameter()),
        )

    def points(self, at: FloatArray) -> FloatArray:
        """(N, 3) at the parameters ``at`` (N,)."""
        return np.array([self._curve.Value(t).Coord() for t in at.tolist()]).reshape(-1, 3)

    def tangent(self, at: float) -> FloatArray:
        """(3,) the way of growing parameters."""
        point, vector = self._gp.gp_Pnt(), self._gp.gp_Vec()
        self._curve.D1(at, point, vector)
        return np.array(vector.Coord())

    def circle(self) -> tuple[FloatArray, FloatArray, float]:
        """Centre, axis and radius of a circle; parameters are angles about the axis."""
        circle = self._curve.Circle()
        axis = circle.Axis()
        return (
            np.array(circle.Location().Coord()),
            np.array(axis.Direction().Coord()),
            float(circle.Radius()),
        )


class FacesBeside:
    """A face along one of its edges."""

    def __init__(self, edge: Any, face: Any) -> None:
        adaptor = part("BRepAdaptor")
        self._trace = adaptor.BRepAdaptor_Curve2d(edge, face)
        self._surface = adaptor.BRepAdaptor_Surface(face, False)
        self._sign = 1.0 if forward(face) else -1.0
        self._gp = part("gp")
        self._middle = (self._trace.FirstParameter() + self._trace.LastParameter()) / 2

    def normals(self, at: FloatArray) -> FloatArray:
        """(N, 3) outward unit normals at the edge's parameters ``at`` (N,), zero where there is none."""
        result = self._normals(at)
        for aside in (_ASIDE, 100 * _ASIDE):
            lost = np.flatnonzero(~result.any(axis=1))
            if not len(lost):
                break
            result[lost] = self._normals(at[lost] + aside * (self._middle - at[lost]))
        return result

    def _normals(self, at: FloatArray) -> FloatArray:
        slopes = np.array([self._slopes(t) for t in at.tolist()]).reshape(-1, 2, 3)
        normal = cross(slopes[:, 0], slopes[:, 1])
        size = np.linalg.norm(normal, axis=1)
        sound = size > 1e-9 * np.linalg.norm(slopes, axis=2).prod(axis=1)
        return np.asarray(
            np.where(sound, self._sign / np.where(sound, size, 1.0), 0.0)[:, None] * normal
        )

    def _slopes(self, t: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        place = self._trace.Value(t)
        point, u, v = self._gp.gp_Pnt(), self._gp.gp_Vec(), self._gp.gp_Vec()
        self._surface.D1(place.X(), place.Y(), point, u, v)
        return u.Coord(), v.Coord()


def triangles(shape: Any, deflection: float, angle: float) -> tuple[FloatArray, IntArray]:
    """The faces of ``shape`` as triangles, wound outward: no farther than ``deflection`` (mm) from them."""
    part("BRepMesh").BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    tool, location = part("BRep").BRep_Tool, part("TopLoc").TopLoc_Location
    vertices, faces = [], []
    count = 0
    for face in inside(shape, "Face"):
        place = location()
        mesh = tool.Triangulation_s(face, place)
        if mesh is None:
            continue
        move = place.Transformation()
        vertices += [mesh.Node(k).Transformed(move).Coord() for k in range(1, mesh.NbNodes() + 1)]
        corners = np.array(
            [mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)], dtype=np.int64
        )
        corners = corners.reshape(-1, 3) - 1 + count
        faces.append(corners if forward(face) else corners[:, ::-1])
        count = len(vertices)
    both = np.concatenate(faces) if faces else np.zeros((0, 3), dtype=np.int64)
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), both


def measure_tolerance(shape: Any) -> float:
    """The largest distance, mm, between an edge and its faces or its ends as the kernel has it."""
    return float(part("ShapeAnalysis").ShapeAnalysis_ShapeTolerance().Tolerance(shape, 1))


def measure_box(shape: Any) -> FloatArray:
    """(2, 3) mm, the corners of a box around a shape, nan for a shape without extent."""
    box = part("Bnd").Bnd_Box()
    part("BRepBndLib").BRepBndLib.Add_s(shape, box)
    if box.IsVoid():
        return np.full((2, 3), np.nan)
    return np.array([box.CornerMin().Coord(), box.CornerMax().Coord()])


def measure_volume(shape: Any) -> float:
    """mm3, negative for a body that is inside out."""
    return _integrate(shape, "VolumeProperties_s")


def measure_area(shape: Any) -> float:
    """mm2."""
    return _integrate(shape, "SurfaceProperties_s")


def _integrate(shape: Any, method: str) -> float:
    properties = part("GProp").GProp_GProps()
    getattr(part("BRepGProp").BRepGProp, method)(shape, properties)
    return float(properties.Mass())


def size(shape: Any) -> float:
    """The diagonal of a box around ``shape``, mm."""
    lower, upper = measure_box(shape)
    return float(np.nan_to_num(np.linalg.norm(upper - lower)))
