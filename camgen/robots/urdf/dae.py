"""COLLADA meshes of a URDF: triangles and polygons, placed by the nodes of the scene.

Source: COLLADA 1.4.1 (Khronos, April 2006), chapters 4 and 5. pycollada reads colours, cameras and
animations too, which are not needed here, and would be one more package.

The up axis of a file is not applied. A mesh of a URDF stands in the frame of its link, and RViz
does not turn it either. All 17 public files that were compared, with Y_UP and a mesh for collisions
beside them, fit that mesh as they are.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from xml.etree.ElementTree import Element, ParseError, XMLParser, fromstring

import numpy as np

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, rotation_about_axis
from camgen.read.solid.polygons import Triangles, triangulate_polygons
from camgen.robots.urdf.xml import DeclaredError, UndeclaredBuilder

#: Nodes within nodes.
_DEEPEST = 50
_POLYGONS = ("triangles", "polylist", "polygons")
#: Elements that hold a shape or a transform, and are not read.
_UNREAD = ("tristrips", "trifans", "instance_controller", "skew", "lookat", "spline")


def read_dae(source: Source) -> tuple[FloatArray, Triangles]:
    """Vertices (V, 3), m, and faces.

    Raises InputError for a damaged file and for a shape that is not read.
    """
    try:
        root: Element = fromstring(source.data, XMLParser(target=UndeclaredBuilder()))
        for element in root.iter():
            element.tag = str(element.tag).rpartition("}")[2]
        unread = next((kind for kind in _UNREAD if root.find(f".//{kind}") is not None), None)
        if unread:
            raise InputError(source.name, f"holds {unread}, which are not read", "", _AGAIN)
        return _Document(root).read()
    except DeclaredError:
        raise InputError(
            source.name, "declares a DOCTYPE, which COLLADA does not need", remedy="remove it"
        ) from None
    except (ParseError, ValueError, LookupError, ArithmeticError) as error:
        raise InputError(
            source.name, f"is damaged or no COLLADA mesh: {error}", "", _AGAIN
        ) from error


_AGAIN = "export it again as STL"


class _Document:
    """The elements of a file by their ids."""

    def __init__(self, root: Element) -> None:
        self.root = root
        self.by_id = {key: element for element in root.iter() if (key := element.get("id"))}

    def read(self) -> tuple[FloatArray, Triangles]:
        """Everything that the scene shows."""
        unit = self.root.find("asset/unit")
        metres = 1.0 if unit is None else float(unit.get("meter", "1"))
        scene = self.root.find("scene/instance_visual_scene")
        shown = self.root.find(".//visual_scene") if scene is None else self.named(scene, "url")
        if shown is None:
            raise ValueError("it has no scene")
        vertices, polygons, count = [np.zeros((0, 3))], [], 0
        for geometry, placed in self.placed(shown, np.eye(4), 0):
            for points, tables in self.shapes(geometry):
                vertices.append(metres * (points @ placed[:3, :3].T + placed[:3, 3]))
                polygons += [table + count for table in tables]
                count += len(points)
        corners = np.concatenate(vertices)
        return corners, triangulate_polygons(corners, polygons)

    def named(self, element: Element, key: str) -> Element:
        """The element that the attribute `key` of another names: "#id"."""
        return self.by_id[element.attrib[key].removeprefix("#")]

    def placed(
        self, node: Element, outer: FloatArray, deep: int
    ) -> Iterator[tuple[Element, FloatArray]]:
        """The geometries in a node, and their matrices (4, 4)."""
        if deep > _DEEPEST:
            raise ValueError("its nodes hold each other")
        matrix = outer
        for child in node:
            if child.tag in _TRANSFORMS:
                matrix = matrix @ _TRANSFORMS[child.tag](_numbers(child))
        for child in node:
            if child.tag == "instance_geometry":
                yield self.named(child, "url"), matrix
            elif child.tag == "node":
                yield from self.placed(child, matrix, deep + 1)
            elif child.tag == "instance_node":
                yield from self.placed(self.named(child, "url"), matrix, deep + 1)

    def shapes(self, geometry: Element) -> Iterator[tuple[FloatArray, list[IntArray]]]:
        """The vertices (V, 3) of each set of polygons in a geometry, and its tables of corners."""
        for kind in _POLYGONS:
            for polygons in geometry.findall(f"mesh/{kind}"):
                inputs = polygons.findall("input")
                corner = _find_input(inputs, "VERTEX")
                width = 1 + max(int(item.get("offset", "0")) for item in inputs)
                column = int(corner.get("offset", "0"))
                rows = []
                for element in polygons.findall("p"):
                    rows.append(_integers(element).reshape(-1, width)[:, column])
                points = self.points(self.named(corner, "source"))
                yield points, list(_by_corners(kind, polygons, rows))

    def points(self, vertices: Element) -> FloatArray:
        """The positions (V, 3) of `vertices`."""
        position = _find_input(vertices.findall("input"), "POSITION")
        accessor = self.named(position, "source").find("technique_common/accessor")
        if accessor is None:
            raise ValueError("a source has no accessor")
        stride, offset = int(accessor.get("stride", "1")), int(accessor.get("offset", "0"))
        numbers = _numbers(self.named(accessor, "source"))
        count = int(accessor.attrib["count"])
        return numbers[offset : offset + count * stride].reshape(count, stride)[:, :3]


def _find_input(inputs: list[Element], semantic: str) -> Element:
    (only,) = [item for item in inputs if item.get("semantic") == semantic]
    return only


def _by_corners(kind: str, polygons: Element, rows: list[IntArray]) -> Iterator[IntArray]:
    """Tables (P, N) of the vertices of polygons with N corners.

    rows: the vertices, in the order of the file.
    """
    if kind == "polygons":
        yield from (row[None] for row in rows)
        return
    corners = np.concatenate([np.zeros(0, dtype=np.int64), *rows])
    if kind == "triangles":
        yield corners.reshape(-1, 3)
        return
    counts = np.concatenate([_integers(element) for element in polygons.findall("vcount")])
    if counts.sum() != len(corners):
        raise ValueError("a polylist has another number of corners than it states")
    first = np.cumsum(counts) - counts
    for count in np.unique(counts).tolist():
        yield corners[first[counts == count][:, None] + np.arange(count)]


def _numbers(element: Element) -> FloatArray:
    return np.array((element.text or "").split(), dtype=np.float64)


def _integers(element: Element) -> IntArray:
    text = (element.text or "").strip()
    if not text:
        return np.zeros(0, dtype=np.int64)
    with warnings.catch_warnings():
        # Before 2.4 NumPy warns of what it cannot read, and leaves it out.
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.int64, sep=" ")
        except DeprecationWarning as error:
            raise ValueError(str(error)) from error


def _translation(numbers: FloatArray) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3, 3] = numbers
    return matrix


def _rotation(numbers: FloatArray) -> FloatArray:
    """The rotation about an axis x, y, z by an angle, deg: four numbers."""
    matrix = np.eye(4)
    axis = numbers[:3] / np.linalg.norm(numbers[:3])
    matrix[:3, :3] = rotation_about_axis(axis, math.radians(numbers[3]))
    return matrix


#: Matrices (4, 4) of the elements that transform a node.
_TRANSFORMS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "matrix": lambda numbers: numbers.reshape(4, 4),
    "translate": _translation,
    "rotate": _rotation,
    "scale": lambda numbers: np.diag([*numbers, 1.0]),
}
