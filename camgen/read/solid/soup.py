"""A mesh as it is in its file, and the error for a shape that is not read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from msgspec import Struct

from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray

#: mm per unit, by name. A 3MF states its unit, glTF 2.0 is in metres (section 3.4).
_MM = {
    "microns": 1e-3, "micron": 1e-3, "millimeters": 1.0, "millimeter": 1.0, "mm": 1.0,
    "centimeters": 10.0, "centimeter": 10.0, "cm": 10.0, "inches": 25.4, "inch": 25.4, "in": 25.4,
    "feet": 304.8, "foot": 304.8, "meters": 1000.0, "meter": 1000.0, "m": 1000.0,
}  # fmt: skip


class UnreadShape(Exception):
    """The error for a file that is sound and has a shape that is not read; its text names it."""


class NamedVertices(NamedTuple):
    """Names of bodies in a file.

    names: names, in the order of the file.
    owners: (V,) index of the name of each vertex, -1 for a vertex without one.
    """

    names: Sequence[str]
    owners: IntArray


class MeshSoup(Struct, frozen=True, eq=False):
    """A mesh as it is in its file.

    vertices: (V, 3) in units of the file.
    faces: (F, 3) numbers of vertices.
    unit: name of the unit, "" if the format has none.
    notes: notes on repairs and on shapes that were left out.
    named: names of bodies by vertex, None if the file has none.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str = ""
    notes: tuple[Note, ...] = ()
    named: NamedVertices | None = None

    @property
    def mm(self) -> float:
        """Length of the unit, mm; 1 for an unknown one."""
        return _MM.get(self.unit, 1.0)
