"""The CAD kernel (OCCT by the package OCP, extra ``step``): shapes in, numbers out. The only module that knows it.

OCP 8 renamed and dropped some of what OCP 7 has; only what both have is used, or asked for here. All is in mm: OCCT
converts when it reads.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from io import BytesIO
from typing import Any

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import cross
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import tell
from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.solid.part21 import LARGEST_ID, find_wild_id, find_wild_place, take_out

#: What a shape that is sound on paper only makes the kernel raise.
STUMBLES = (RuntimeError, ValueError, TypeError)
_SAVE_AGAIN = "export it again from the CAD program"
#: Leaving something out may show another fault; so often it is looked at.
_ROUNDS = 4
#: A step along an edge, as a part of its parameters, away from a place where the surface has no normal.
_ASIDE = 1e-4


class Meeting(Struct, frozen=True, eq=False):
    """An edge of the shape and the faces that have it: (edge as it runs in the face, face) each."""

    edge: Any
    uses: list[tuple[Any, Any]]


def part(name: str) -> Any:
    """A module of ``OCP`` by its name. ``ImportError`` if the extra is not installed."""
    return import_module(f"OCP.{name}")


def load(source: Source) -> tuple[Any, tuple[Note, ...]]:
    """The shape in a STEP file, all roots as one, and what was left out. ``InputError`` if there is none."""
    try:
        part("STEPControl")
    except ImportError as error:
        raise InputError(
            source.name, "STEP needs the CAD kernel", "", "pip install 'camgen[step]'"
        ) from error
    message = part("Message")
    # OCCT prints what it finds odd; the command line alone prints.
    message.Message.DefaultMessenger_s().RemovePrinters(
        message.Message_PrinterOStream.get_type_descriptor_s()
    )
    _try_aside(source)
    return _load(source)


def _try_aside(source: Source) -> None:
    """``InputError`` where reading the file ends a process: a child reads it first. OCCT does not check all that it
    takes from a file, and what it then touches is no error that could be caught.
    """
    if not hasattr(os, "fork"):
        return
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        with suppress(BaseException):  # whatever it is, the parent meets it too, and tells it
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what it says as it dies is for nobody
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, source.limits.step_seconds)
            _load(source)
        os._exit(0)
    ended = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(ended):
        what, remedy = "is damaged: it ends the CAD kernel", _SAVE_AGAIN
        if os.WTERMSIG(ended) == signal.SIGALRM:
            what = f"takes the CAD kernel more than {tell(source.limits.step_seconds)} s"
            remedy = f"{_SAVE_AGAIN}, or raise limits.step_seconds"
        raise InputError(source.name, what, "", remedy)


def _load(source: Source) -> tuple[Any, tuple[Note, ...]]:
    failure = part("Standard").Standard_Failure
    try:
        reader, notes = _sound(source)
        shape = reader.OneShape() if reader.TransferRoots() else None
    except (failure, *STUMBLES) as error:
        raise InputError(
            source.name, "is damaged: the CAD kernel cannot read it", "", _SAVE_AGAIN
        ) from error
    return (None if shape is None or shape.IsNull() else shape), notes


def _sound(source: Source) -> tuple[Any, tuple[Note, ...]]:
    """The kernel's reader of a text whose every entity could be read: of what is not sound OCCT would leave out what
    needs it, or end the process. What no edge needs is left out of the text. ``InputError`` for anything else.
    """
    data, notes = source.data, tuple[Note, ...]()
    if wild := find_wild_id(data):
        what = f"is damaged: {wild} is no number of an entity, which are 1 to {LARGEST_ID}"
        raise InputError(source.name, what, "", _SAVE_AGAIN)
    if far := find_wild_place(data, source.limits.step_place):
        remedy = f"{_SAVE_AGAIN}, or raise limits.step_place"
        raise InputError(
            source.name, f"is damaged: a point at {far}, no part is so large", "", remedy
        )
    for _ in range(_ROUNDS):
        reader = part("STEPControl").STEPControl_Reader()
        if reader.ReadStream(source.name, BytesIO(data)).name != "IFSelect_RetDone":
            raise InputError(source.name, "is no STEP file, or damaged", "", _SAVE_AGAIN)
        model = reader.StepModel()
        faults = _faults(model)
        if not faults:
            if model.GlobalCheck(True).HasFailed():
                raise InputError(
                    source.name, "is damaged: entities are missing or there twice", "", _SAVE_AGAIN
                )
            return reader, notes
        mended = take_out(data, faults)
        if mended.why:
            of = counted(int(model.NbEntities()), "entity", "entities")
            what = (
                f"is damaged: {len(faults)} of {of} cannot be read, and the part needs {mended.why}"
            )
            raise InputError(source.name, what, "", _SAVE_AGAIN)
        data, notes = mended.data, (*notes, *mended.notes)
    raise InputError(source.name, "is damaged: its entities cannot be read", "", _SAVE_AGAIN)


def _faults(model: Any) -> dict[int, list[str]]:
    """What OCCT says of the entities that it cannot read, by their place in the file from 0."""
    found = {}
    for k in range(1, int(model.NbEntities()) + 1):
        if model.IsErrorEntity(k):
            check = model.ReportEntity(k).Check()
            found[k - 1] = [str(check.CFail(i)) for i in range(1, check.NbFails() + 1)]
    return found


def inside(shape: Any, kind: str) -> Iterator[Any]:
    """All sub-shapes of ``kind`` ("Face", "Edge") that ``shape`` uses, as it uses them."""
    explorer = part("TopExp").TopExp_Explorer(
        shape, getattr(part("TopAbs"), f"TopAbs_{kind.upper()}")
    )
    topods = part("TopoDS").TopoDS
    cast = getattr(topods, f"{kind}_s", None) or getattr(topods, kind)
    while explorer.More():
        yield cast(explorer.Current())
        explorer.Next()


def count_wires(shape: Any) -> int:
    """How many curves of ``shape`` are in no face."""
    kinds = part("TopAbs")
    explorer = part("TopExp").TopExp_Explorer(shape, kinds.TopAbs_EDGE, kinds.TopAbs_FACE)
    count = 0
    while explorer.More():
        count += 1
        explorer.Next()
    return count


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


def size(shape: Any) -> float:
    """The diagonal of a box around ``shape``, mm."""
    box = part("Bnd").Bnd_Box()
    part("BRepBndLib").BRepBndLib.Add_s(shape, box)
    return 0.0 if box.IsVoid() else float(np.sqrt(box.SquareExtent()))
