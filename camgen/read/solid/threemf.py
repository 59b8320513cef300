"""3MF files: the bodies that the build lists, also with components in other parts of the archive.

Sources: 3MF Core Specification 1.3, sections 3 and 4; 3MF Production Extension 1.1, section 2.
"""

from __future__ import annotations

import re
from io import BytesIO
from operator import attrgetter, itemgetter
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
from msgspec import Struct

from camgen.model.part import IntArray, Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.solid.soup import MeshSoup, NamedVertices, UnreadShape

_ROOT = "3d/3dmodel.model"
_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
#: Extensions that a file may require: production is read, the others change no shape.
_KNOWN = frozenset(
    [
        _CORE,
        _PRODUCTION,
        "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
        "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07",
    ]
)
_PATH = f"{{{_PRODUCTION}}}path"
#: Types of objects that are not parts of the model (core specification, section 4.1).
_NOT_MODEL = ("support", "solidsupport", "other")
#: Elements of extensions that hold a shape, required or not.
_SHAPES = frozenset(["beamlattice", "booleanshape", "displacementmesh", "levelset"])
#: A namespace of a model part, and bytes at its start that are searched for namespaces.
_SPACES, _HEAD = re.compile(r"xmlns:([\w.-]+)\s*=\s*[\"']([^\"']+)"), 10_000
#: Maximum depth of components within components.
_MAX_DEPTH = 50


class _Reference(Struct, frozen=True):
    """A component or an item.

    part: name of the part of the archive with the object, in lower case.
    number: id of the object in that part.
    transform: (4, 4) position. A point is a row vector, so its image is `point @ transform`.
    """

    part: str
    number: str
    transform: FloatArray


class _Object(Struct, frozen=True, eq=False):
    vertices: FloatArray
    faces: IntArray
    type: str
    name: str
    components: list[_Reference]


class _Part(Struct, frozen=True):
    """A model part of the archive.

    unit: unit of length.
    objects: objects by id. Another part may use the same id for another object.
    items: objects of the build.
    """

    unit: str
    objects: dict[str, _Object]
    items: list[_Reference]


def read_3mf(data: bytes, limit: float) -> MeshSoup:
    """The bodies that the build of a 3MF lists.

    limit: maximum number of bytes of all model parts together, and of vertices of all bodies.
    Raises ValueError for a file that is damaged, OverflowError for one beyond the limit, and
    UnreadShape for one that requires an extension that is not read.
    """
    with ZipFile(BytesIO(data)) as archive:
        names = {info.filename.lower(): info for info in archive.infolist()}
        models = {name: info for name, info in names.items() if name.endswith(".model")}
        root = next((name for name in models if _ROOT in name), "")
        if not root:
            raise UnreadShape("lacks the model of a 3MF: 3D/3dmodel.model is not in it")
        if sum(info.file_size for info in models.values()) > limit:
            raise OverflowError("bytes")
        parts = {name: _read_part(archive.read(info), name) for name, info in models.items()}
    builder = _Builder(parts, limit)
    for item in parts[root].items:
        builder.add(item, np.eye(4), 0)
    return builder.finish(parts[root].unit.lower())


class _Builder:
    def __init__(self, parts: dict[str, _Part], limit: float) -> None:
        self._parts, self._limit = parts, limit
        self._vertices: list[FloatArray] = [np.zeros((0, 3))]
        self._faces: list[IntArray] = [np.zeros((0, 3), dtype=np.int64)]
        self._names: list[str] = []
        self._count = self._left_out = 0

    def add(self, reference: _Reference, outer: FloatArray, depth: int, name: str = "") -> None:
        """Add the body of a reference, with its components.

        outer: (4, 4) position of the object that contains it.
        depth: number of objects that contain it.
        name: name of the object that contains it, for a body without a name.

        Raises ValueError for an object that is missing or contains itself, and OverflowError for
        too many vertices.
        """
        part = self._parts.get(reference.part)
        body = None if part is None else part.objects.get(reference.number)
        if body is None:
            raise ValueError(f"object {reference.number} is not in {reference.part}")
        if depth > _MAX_DEPTH:
            raise ValueError("components contain each other")
        if body.type in _NOT_MODEL:
            self._left_out += 1
            return
        place = reference.transform @ outer
        name = body.name or name
        if len(body.faces):
            points = body.vertices @ place[:3, :3] + place[3, :3]
            # The faces of a mirrored body would be wound inward.
            mirrored = np.linalg.det(place[:3, :3]) < 0
            self._vertices.append(points)
            self._names.append(name)
            self._faces.append((body.faces[:, ::-1] if mirrored else body.faces) + self._count)
            self._count += len(points)
            if self._count > self._limit:
                raise OverflowError("vertices")
        for component in body.components:
            self.add(component, place, depth + 1, name)

    def finish(self, unit: str) -> MeshSoup:
        notes: tuple[Note, ...] = ()
        if self._left_out:
            what = f"{counted(self._left_out, 'object')} of the build left out"
            notes = (Note("skipped", what, "a support, or of the type other"),)
        owners = np.repeat(np.arange(len(self._names)), list(map(len, self._vertices[1:])))
        return MeshSoup(
            np.concatenate(self._vertices),
            np.concatenate(self._faces),
            unit,
            notes,
            NamedVertices(self._names, owners),
        )


def _read_part(data: bytes, name: str) -> _Part:
    if b"<!DOCTYPE" in data:
        raise ValueError("it has a document type, which no model has")
    model = ElementTree.fromstring(data)
    spaces = dict(_SPACES.findall(data[:_HEAD].decode("latin-1")))
    for prefix in model.get("requiredextensions", "").split():
        space = spaces.get(prefix, prefix)
        if space not in _KNOWN:
            raise UnreadShape(f"requires the extension {space}, which is not read")
    for item in model.iter():
        if item.tag.rpartition("}")[2] in _SHAPES:
            raise UnreadShape(f"has a {item.tag.rpartition('}')[2]}, which is not read")
    return _Part(
        model.get("unit", "millimeter"),
        {item.attrib["id"]: _read_object(item, name) for item in model.iter(f"{{{_CORE}}}object")},
        [_read_reference(item, name) for item in model.iter(f"{{{_CORE}}}item")],
    )


def _read_object(item: ElementTree.Element, name: str) -> _Object:
    points = map(attrgetter("attrib"), item.iter(f"{{{_CORE}}}vertex"))
    vertices = list(map(itemgetter("x", "y", "z"), points))
    triangles = map(attrgetter("attrib"), item.iter(f"{{{_CORE}}}triangle"))
    faces = list(map(itemgetter("v1", "v2", "v3"), triangles))
    table = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(table) and (table.min() < 0 or table.max() >= len(vertices)):
        raise ValueError("a triangle names a vertex that is not there")
    return _Object(
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        table,
        item.get("type", "model"),
        item.get("name", ""),
        [_read_reference(row, name) for row in item.iter(f"{{{_CORE}}}component")],
    )


def _read_reference(item: ElementTree.Element, name: str) -> _Reference:
    path = item.get(_PATH, name).lstrip("/").lower()
    matrix = np.eye(4)
    numbers = item.get("transform", "").split()
    if numbers:
        # The rows are the images of the axes and the translation (section 3.3).
        matrix[:, :3] = np.array(numbers, dtype=np.float64).reshape(4, 3)
    return _Reference(path, item.attrib["objectid"], matrix)
