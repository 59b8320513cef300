"""The CAD kernel (OCCT in the package OCP, extra `step`): its shapes, and measures of them.

No other module imports OCP. They call these functions, and `import_ocp` for the rest of the kernel.
Everything is in mm: OCCT converts while it reads.

OCP 8 renamed or dropped some names of OCP 7. This module uses the names that both have, or tries
both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from itertools import chain
from typing import Any

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray

#: Where a surface has no normal, the normal is taken aside. Step towards the middle of the edge, as
#: a fraction of the parameters up to there.
_ASIDE = 1e-4


class EdgeUses(Struct, frozen=True, eq=False):
    """An edge of a shape.

    edge: the edge.
    uses: the edge as it runs in a face, and that face, for each face that has it.
    """

    edge: Any
    uses: list[tuple[Any, Any]]


def import_ocp(name: str) -> Any:
    """A module of OCP by its name. Raises ImportError if the extra is not installed."""
    return import_module(f"OCP.{name}")


def list_errors() -> tuple[type[BaseException], ...]:
    """The errors that the kernel raises for shapes that are sound in form and not in geometry."""
    return import_ocp("Standard").Standard_Failure, RuntimeError, ValueError, TypeError


def list_subshapes(shape: Any, kind: str, avoid: str = "Shape") -> Iterator[Any]:
    """All sub-shapes of a kind ("Face", "Edge") as the shape uses them.

    avoid: kind of sub-shapes that are not searched.
    """
    kinds = import_ocp("TopAbs")
    wanted, avoided = f"TopAbs_{kind.upper()}", f"TopAbs_{avoid.upper()}"
    explorer = import_ocp("TopExp").TopExp_Explorer(
        shape, getattr(kinds, wanted), getattr(kinds, avoided)
    )
    topods = import_ocp("TopoDS").TopoDS
    cast = getattr(topods, f"{kind}_s", None) or getattr(topods, kind)
    while explorer.More():
        yield cast(explorer.Current())
        explorer.Next()


def list_members(shape: Any) -> Iterator[Any]:
    """The shapes that a compound consists of, at their positions in it."""
    iterator = import_ocp("TopoDS").TopoDS_Iterator(shape)
    while iterator.More():
        yield iterator.Value()
        iterator.Next()


def make_compound(shapes: Sequence[Any]) -> Any:
    """One shape that consists of several; a single shape itself."""
    if len(shapes) == 1:
        return shapes[0]
    compound, builder = import_ocp("TopoDS").TopoDS_Compound(), import_ocp("BRep").BRep_Builder()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    return compound


def is_solid(shape: Any) -> bool:
    """Whether a shape is one closed body."""
    return bool(shape.ShapeType().name == "TopAbs_SOLID")


def make_solid(shell: Any) -> Any:
    """The solid in a closed shell, with its faces outward."""
    solid = import_ocp("BRepBuilderAPI").BRepBuilderAPI_MakeSolid(shell).Solid()
    import_ocp("BRepLib").BRepLib.OrientClosedSolid_s(solid)
    return solid


def unite(solids: Sequence[Any], tolerance: float) -> Any:
    """The union of solids that may be `tolerance` (mm) apart, None if the kernel finds none."""
    return _combine("Fuse", solids, tolerance)


def intersect(first: Any, second: Any, tolerance: float) -> Any:
    """The volume that two solids share, None if the kernel finds none."""
    return _combine("Common", [first, second], tolerance)


def _combine(operation: str, solids: Sequence[Any], tolerance: float) -> Any:
    algorithm = getattr(import_ocp("BRepAlgoAPI"), f"BRepAlgoAPI_{operation}")()
    algorithm.SetArguments(_list_shapes(solids[:1]))
    algorithm.SetTools(_list_shapes(solids[1:]))
    algorithm.SetFuzzyValue(tolerance)
    try:
        algorithm.Build()
    except list_errors():
        return None
    return algorithm.Shape() if algorithm.IsDone() and not algorithm.Shape().IsNull() else None


def _list_shapes(shapes: Sequence[Any]) -> Any:
    """A list of the kernel, whose name is not the same in OCP 7 and OCP 8."""
    try:
        listed = import_ocp("TopTools").TopTools_ListOfShape()
    except (ImportError, AttributeError):
        listed = import_ocp("collections").List_TopoDS_Shape()
    for shape in shapes:
        listed.Append(shape)
    return listed


#: rad: largest angle between the axes of surfaces that count as the same.
_PARALLEL = 1e-4


class Surface:
    """The surface of a face, to compare it with others."""

    def __init__(self, face: Any) -> None:
        adaptor = import_ocp("BRepAdaptor").BRepAdaptor_Surface(face, False)
        self.kind = str(adaptor.GetType().name)
        self._axis, self._position, self._radius = np.zeros(3), np.zeros(3), 0.0
        if self.kind in ("GeomAbs_Plane", "GeomAbs_Cylinder"):
            is_plane = self.kind == "GeomAbs_Plane"
            shape = adaptor.Plane() if is_plane else adaptor.Cylinder()
            self._axis = np.array(shape.Axis().Direction().Coord())
            self._position = np.array(shape.Location().Coord())
            self._radius = 0.0 if is_plane else float(shape.Radius())

    def is_same(self, other: Surface, tolerance: float) -> bool:
        """Whether two surfaces are within `tolerance` (mm) of each other.

        Only planes and cylinders are compared. Others count as the same if they are of one kind.
        """
        if self.kind != other.kind:
            return False
        if np.linalg.norm(cross(self._axis, other._axis)) > _PARALLEL:
            return False
        offset = other._position - self._position
        along = offset @ self._axis
        is_plane = self.kind == "GeomAbs_Plane"
        distance = abs(along) if is_plane else np.linalg.norm(offset - along * self._axis)
        is_near = distance <= tolerance and abs(self._radius - other._radius) <= tolerance
        return bool(is_near) or not self._axis.any()


def list_edges(shape: Any) -> list[EdgeUses]:
    """The edges of the faces of a shape, each once, in the order of the file."""
    by_hash: dict[int, list[EdgeUses]] = {}
    for face in list_subshapes(shape, "Face"):
        for edge in list_subshapes(face, "Edge"):
            group = by_hash.setdefault(hash(edge), [])
            edge_uses = next((known for known in group if known.edge.IsSame(edge)), None)
            if edge_uses is None:
                edge_uses = EdgeUses(edge, [])
                group.append(edge_uses)
            edge_uses.uses.append((edge, face))
    return list(chain.from_iterable(by_hash.values()))


def is_forward(shape: Any) -> bool:
    """Whether an edge runs with its parameter, or a face has the orientation of its surface."""
    return bool(shape.Orientation().name == "TopAbs_FORWARD")


def is_degenerate(edge: Any) -> bool:
    """Whether an edge has no length."""
    return bool(import_ocp("BRep").BRep_Tool.Degenerated_s(edge))


class Curve:
    """An edge as a curve.

    kind: type of the curve as OCCT names it: "Line", "Circle" and so on.
    low, high: range of its parameters.
    """

    def __init__(self, edge: Any) -> None:
        self._curve = import_ocp("BRepAdaptor").BRepAdaptor_Curve(edge)
        self._gp = import_ocp("gp")
        self.kind = str(self._curve.GetType().name).removeprefix("GeomAbs_")
        self.low = float(self._curve.FirstParameter())
        self.high = float(self._curve.LastParameter())

    def points(self, at: FloatArray) -> FloatArray:
        """(N, 3) points at the parameters `at` (N,), mm."""
        return np.array([self._curve.Value(t).Coord() for t in at.tolist()]).reshape(-1, 3)

    def tangent(self, at: float) -> FloatArray:
        """(3,) the derivative of the curve at a parameter."""
        point, vector = self._gp.gp_Pnt(), self._gp.gp_Vec()
        self._curve.D1(at, point, vector)
        return np.array(vector.Coord())

    def circle(self) -> tuple[FloatArray, FloatArray, float]:
        """Centre, axis and radius of a circle. Its parameters are angles about the axis, rad."""
        circle = self._curve.Circle()
        center, axis = circle.Location().Coord(), circle.Axis().Direction().Coord()
        return np.array(center), np.array(axis), float(circle.Radius())


class FaceAlongEdge:
    """A face along one of its edges."""

    def __init__(self, edge: Any, face: Any) -> None:
        adaptor = import_ocp("BRepAdaptor")
        self._trace = adaptor.BRepAdaptor_Curve2d(edge, face)
        self._surface = adaptor.BRepAdaptor_Surface(face, False)
        self._sign = 1.0 if is_forward(face) else -1.0
        self._gp = import_ocp("gp")
        self._middle = (self._trace.FirstParameter() + self._trace.LastParameter()) / 2

    def normals(self, at: FloatArray) -> FloatArray:
        """(N, 3) outward unit normals at the parameters `at` (N,) of the edge, 0 without a normal.

        Where the surface has no normal, as at the tip of a cone, the one beside it counts.
        """
        result = self._compute_normals(at)
        for aside in (_ASIDE, 100 * _ASIDE):
            missing = np.flatnonzero(~result.any(axis=1))
            if not len(missing):
                break
            nearby = at[missing] + aside * (self._middle - at[missing])
            result[missing] = self._compute_normals(nearby)
        return result

    def _compute_normals(self, at: FloatArray) -> FloatArray:
        slopes = np.array([self._compute_slopes(t) for t in at.tolist()]).reshape(-1, 2, 3)
        normal = cross(slopes[:, 0], slopes[:, 1])
        size = np.linalg.norm(normal, axis=1)
        is_sound = size > 1e-9 * np.linalg.norm(slopes, axis=2).prod(axis=1)
        factor = np.where(is_sound, self._sign / np.where(is_sound, size, 1.0), 0.0)
        return np.asarray(factor[:, None] * normal)

    def _compute_slopes(
        self, t: float
    ) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        place = self._trace.Value(t)
        point, u, v = self._gp.gp_Pnt(), self._gp.gp_Vec(), self._gp.gp_Vec()
        self._surface.D1(place.X(), place.Y(), point, u, v)
        return u.Coord(), v.Coord()


def triangulate(shape: Any, deflection: float, angle: float) -> tuple[FloatArray, IntArray]:
    """The faces of a shape as triangles, wound outward: vertices (V, 3) mm and faces (F, 3).

    deflection: largest distance of a triangle from its face, mm.
    angle: largest angle between neighbouring sides along a curve, rad.
    """
    import_ocp("BRepMesh").BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    tool, location = import_ocp("BRep").BRep_Tool, import_ocp("TopLoc").TopLoc_Location
    vertices: list[tuple[float, float, float]] = []
    faces = [np.zeros((0, 3), dtype=np.int64)]
    for face in list_subshapes(shape, "Face"):
        place = location()
        mesh = tool.Triangulation_s(face, place)
        if mesh is None:
            continue
        move = place.Transformation()
        first = len(vertices)
        vertices += [mesh.Node(k).Transformed(move).Coord() for k in range(1, mesh.NbNodes() + 1)]
        triangles = [mesh.Triangle(k).Get() for k in range(1, mesh.NbTriangles() + 1)]
        corners = np.array(triangles, dtype=np.int64).reshape(-1, 3) - 1 + first
        faces.append(corners if is_forward(face) else corners[:, ::-1])
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.concatenate(faces)


def measure_tolerance(shape: Any) -> float:
    """The largest distance, mm, between an edge and its faces or ends, as the kernel states it."""
    return float(import_ocp("ShapeAnalysis").ShapeAnalysis_ShapeTolerance().Tolerance(shape, 1))


def measure_box(shape: Any) -> FloatArray:
    """(2, 3) mm, the corners of a box around a shape, nan for a shape without extent."""
    box = import_ocp("Bnd").Bnd_Box()
    import_ocp("BRepBndLib").BRepBndLib.Add_s(shape, box)
    if box.IsVoid():
        return np.full((2, 3), np.nan)
    return np.array([box.CornerMin().Coord(), box.CornerMax().Coord()])


def measure_diagonal(shape: Any) -> float:
    """The diagonal of a box around a shape, mm; 0 for a shape without extent."""
    lower, upper = measure_box(shape)
    return float(np.nan_to_num(np.linalg.norm(upper - lower)))


def measure_volume(shape: Any) -> float:
    """The volume of a shape, mm3; negative for a body that is inside out."""
    return _integrate(shape, "VolumeProperties_s")


def measure_area(shape: Any) -> float:
    """The area of the faces of a shape, mm2."""
    return _integrate(shape, "SurfaceProperties_s")


def _integrate(shape: Any, method: str) -> float:
    properties = import_ocp("GProp").GProp_GProps()
    getattr(import_ocp("BRepGProp").BRepGProp, method)(shape, properties)
    return float(properties.Mass())
