"""Meshes of known solids in every format and spelling.

python -m bench.read.meshes [FIRST, 0] [COUNT, 60]

The rule: mesh number n has the n-th combination of format and spelling in ``SPELLINGS``, again
and again, and one, two or three prisms by the seed n. A prism is a box or a U profile, and its
bodies stand 20 mm apart. The formula knows size, bodies and edges: a box has 12 edges, a U profile
24, of which 2 are concave.

A mesh is

- right: size, number of bodies, edges and concave edges are those of the formula;
- reported: they differ, and a note of the kind skipped or a warning says so;
- refused: one line;
- silent: they differ and no note says so.

Damaged spellings may be reported or refused. The others must be right, except those in
`MAY_REFUSE`: extensions that a file requires.
"""

from __future__ import annotations

import json
import random
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple
from zipfile import ZipFile

import numpy as np

import camgen
from bench.render.solid import triangulate
from bench.support.runner import Cells, Missed, Scenario, must_be_none, read_words, run
from camgen.model.pose import FloatArray

COLUMNS = (
    "format | spelling | meshes {} | right {} | reported {} | refused {} | silent | wrong refusals"
)

Faces = list[list[int]]


class Body(NamedTuple):
    """A prism: corners (V, 3) mm, faces and triangles by the numbers of their corners.

    They turn left, seen from outside.
    """

    corners: FloatArray
    faces: Faces
    triangles: Faces
    edges: int
    concave: int


def make_prism(
    outline: Sequence[tuple[float, float]], height: float
) -> tuple[FloatArray, Faces, Faces]:
    """Corners, faces and triangles of the prism over a polygon that turns left."""
    count = len(outline)
    low = np.array([(x, y, 0.0) for x, y in outline])
    corners = np.concatenate([low, low + np.array([0.0, 0.0, height])])
    sides = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
    faces = [list(range(count))[::-1], list(range(count, 2 * count)), *sides]
    cap = triangulate([low[:, :2]])
    triangles = [*cap[:, ::-1].tolist(), *(cap + count).tolist()]
    for a, b, c, d in sides:
        triangles += [[a, b, c], [a, c, d]]
    return corners, faces, triangles


def make_body(rng: random.Random, place: float) -> Body:
    """A box or a U profile whose lowest x is `place`."""
    width, depth, height = (float(rng.randint(10, 60)) for _ in range(3))
    if rng.random() < 0.5:
        outline = [(0, 0), (width, 0), (width, depth), (0, depth)]
        edges, concave = 12, 0
    else:
        wall, floor = width / 4, depth / 3
        outline = [
            (0, 0), (width, 0), (width, depth), (width - wall, depth), (width - wall, floor),
            (wall, floor), (wall, depth), (0, depth),
        ]  # fmt: skip
        edges, concave = 24, 2
    first = rng.randrange(len(outline))
    corners, *faces = make_prism(outline[first:] + outline[:first], height)
    return Body(corners + np.array([place, 0.0, 0.0]), *faces, edges, concave)


def make_bodies(seed: int) -> list[Body]:
    """One to three prisms, 20 mm apart."""
    rng = random.Random(seed)
    bodies: list[Body] = []
    place = 0.0
    for _ in range(rng.randint(1, 3)):
        bodies.append(make_body(rng, place))
        place = float(bodies[-1].corners[:, 0].max()) + 20.0
    return bodies


def split_faces(bodies: list[Body]) -> list[Body]:
    """The bodies with triangles for faces."""
    return [body._replace(faces=body.triangles) for body in bodies]


# The formats. Each writes the bodies and returns the bytes.


def write_stl(bodies: list[Body], end: str = "endsolid {}\n", name: str = "body") -> bytes:
    text = ""
    for number, body in enumerate(bodies):
        text += f"solid {name}{number}\n"
        for a, b, c in body.triangles:
            rows = "".join("vertex {:g} {:g} {:g}\n".format(*body.corners[k]) for k in (a, b, c))
            text += f"facet normal 0 0 0\nouter loop\n{rows}endloop\nendfacet\n"
        text += end.format(f"{name}{number}")
    return text.encode("latin-1")


def write_cut_stl(bodies: list[Body]) -> bytes:
    data = write_stl(bodies)
    return data[: data.rindex(b"facet normal")]


def write_open_stl(bodies: list[Body]) -> bytes:
    data = write_stl(bodies)
    return data[: data.rindex(b"endsolid")]


def write_binary_stl(bodies: list[Body], less: int = 0) -> bytes:
    triangles = np.concatenate([body.corners[np.array(body.triangles)] for body in bodies])
    rows = b"".join(
        np.concatenate([np.zeros(3), corners.ravel()]).astype("<f4").tobytes() + b"\0\0"
        for corners in triangles
    )
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + rows[: len(rows) - less]


def write_obj(
    bodies: list[Body], form: str = "f {}\n", index: str = "{}", base: str = "first"
) -> bytes:
    """base: first: the vertices count from 1; last: the vertices count back from the line."""
    text, before = "# bodies\n", 0
    for number, body in enumerate(bodies):
        text += f"o body{number}\n"
        text += "".join("v {:g} {:g} {:g}\n".format(*row) for row in body.corners)
        size = len(body.corners)
        for face in body.faces:
            numbers = [k - size if base == "last" else k + 1 + before for k in face]
            text += form.format(" ".join(index.format(k) for k in numbers))
        before += size
    return text.encode()


def write_ply(bodies: list[Body], order: str = "", triangles: bool = False) -> bytes:
    """order: byte order, "<" or ">"; "" for text."""
    corners = np.concatenate([body.corners for body in bodies])
    faces: Faces = []
    before = 0
    for body in bodies:
        polygons = body.triangles if triangles else body.faces
        faces += [(np.array(face) + before).tolist() for face in polygons]
        before += len(body.corners)
    form = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {form} 1.0\nelement vertex {len(corners)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    if not order:
        rows = ["{:g} {:g} {:g}".format(*row) for row in corners]
        rows += [" ".join(map(str, [len(face), *face])) for face in faces]
        return (head + "\n".join(rows) + "\n").encode()
    body_bytes = corners.astype(f"{order}f4").tobytes()
    for face in faces:
        body_bytes += bytes([len(face)]) + np.array(face, f"{order}i4").tobytes()
    return head.encode() + body_bytes


def write_off(bodies: list[Body], first: str = "OFF\n", triangles: bool = False) -> bytes:
    corners = np.concatenate([body.corners for body in bodies])
    text, before, rows = "", 0, 0
    for body in bodies:
        for face in body.triangles if triangles else body.faces:
            text += " ".join(map(str, [len(face), *(k + before for k in face)])) + "\n"
            rows += 1
        before += len(body.corners)
    points = "".join("{:g} {:g} {:g}\n".format(*row) for row in corners)
    return f"{first}{len(corners)} {rows} 0\n{points}{text}".encode()


_CORE = 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"'
_PRODUCTION = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'


def write_object(body: Body, number: int) -> str:
    points = "".join('<vertex x="{:g}" y="{:g}" z="{:g}"/>'.format(*row) for row in body.corners)
    faces = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in body.triangles)
    mesh = f"<mesh><vertices>{points}</vertices><triangles>{faces}</triangles></mesh>"
    return f'<object id="{number}" type="model">{mesh}</object>'


def pack_3mf(files: dict[str, str]) -> bytes:
    out = BytesIO()
    with ZipFile(out, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, f'<?xml version="1.0"?>{text}')
    return out.getvalue()


def write_3mf(bodies: list[Body]) -> bytes:
    objects = "".join(write_object(body, k + 1) for k, body in enumerate(bodies))
    items = "".join(f'<item objectid="{k + 1}"/>' for k in range(len(bodies)))
    model = f"<resources>{objects}</resources><build>{items}</build>"
    return pack_3mf({"3D/3dmodel.model": f'<model unit="millimeter" {_CORE}>{model}</model>'})


def write_production_3mf(bodies: list[Body]) -> bytes:
    """The production extension: each body in a file of its own, all with the id 1."""
    files, objects, items = {}, "", ""
    for k, placed in enumerate(bodies):
        x = float(placed.corners[:, 0].min())
        body = placed._replace(corners=placed.corners - np.array([x, 0.0, 0.0]))
        name = f"/3D/Objects/body{k}.model"
        model = f"<resources>{write_object(body, 1)}</resources><build/>"
        files[name[1:]] = f'<model unit="millimeter" {_CORE}>{model}</model>'
        component = f'<component p:path="{name}" objectid="1"/>'
        objects += (
            f'<object id="{k + 11}" type="model"><components>{component}</components></object>'
        )
        items += f'<item objectid="{k + 11}" transform="1 0 0 0 1 0 0 0 1 {x:g} 0 0"/>'
    head = f'<model unit="millimeter" {_CORE} {_PRODUCTION} requiredextensions="p">'
    root = f"{head}<resources>{objects}</resources><build>{items}</build></model>"
    return pack_3mf({"3D/3dmodel.model": root, **files})


def write_glb(bodies: list[Body], extension: str = "") -> bytes:
    """In metres. extension: name of an extension that the file requires."""
    data, views, accessors, meshes, nodes = b"", [], [], [], []

    def add(values: np.ndarray, kind: str, component: int, **more: object) -> int:
        nonlocal data
        data += b"\0" * (-len(data) % 4)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        count = len(values) if kind != "SCALAR" else values.size
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind}
            | more
        )
        data += values.tobytes()
        return len(accessors) - 1

    for body in bodies:
        low, high = body.corners.min(axis=0) / 1000, body.corners.max(axis=0) / 1000
        node: dict[str, object] = {"mesh": len(meshes)}
        if extension == "KHR_mesh_quantization":
            scale = high - low
            values = np.round((body.corners / 1000 - low) / scale * 32767).astype("<i2")
            padded = np.zeros((len(values), 4), "<i2")
            padded[:, :3] = values
            place = add(padded, "VEC3", 5122, normalized=True, min=[0, 0, 0], max=[32767] * 3)
            accessors[place]["count"] = len(values)
            views[-1]["byteStride"] = 8
            node |= {"translation": low.tolist(), "scale": scale.tolist()}
        else:
            values = (body.corners / 1000).astype("<f4")
            place = add(values, "VEC3", 5126, min=values.min(axis=0).tolist(),
                        max=values.max(axis=0).tolist())  # fmt: skip
        faces = add(np.array(body.triangles, "<u4").ravel(), "SCALAR", 5125)
        meshes.append({"primitives": [{"attributes": {"POSITION": place}, "indices": faces}]})
        nodes.append(node)
    document: dict[str, object] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes, "meshes": meshes, "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }  # fmt: skip
    if extension:
        document |= {"extensionsUsed": [extension], "extensionsRequired": [extension]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


class Spelling(NamedTuple):
    """A way to write bodies. damaged: the file has not all of them."""

    name: str
    suffix: str
    write: Callable[[list[Body]], bytes]
    damaged: bool = False


SPELLINGS = [
    Spelling("text", ".stl", write_stl),
    Spelling("text, name in Latin-1", ".stl", lambda b: write_stl(b, name="Geh\xe4use")),
    Spelling("text, no name after endsolid", ".stl", lambda b: write_stl(b, end="endsolid\n")),
    Spelling("text, cut off in the last solid", ".stl", write_cut_stl, damaged=True),
    Spelling("text, the last endsolid missing", ".stl", write_open_stl),
    Spelling("binary", ".stl", write_binary_stl),
    Spelling("binary, cut off", ".stl", lambda b: write_binary_stl(b, 70), damaged=True),
    Spelling("polygons", ".obj", write_obj),
    Spelling("triangles", ".obj", lambda b: write_obj(split_faces(b))),
    Spelling("polygons, relative indices", ".obj", lambda b: write_obj(b, base="last")),
    Spelling("polygons, v//n", ".obj", lambda b: write_obj(b, index="{}//1")),
    Spelling("polygons, tabs", ".obj", lambda b: write_obj(b).replace(b" ", b"\t")),
    Spelling("polygons, continued lines", ".obj", lambda b: write_obj(b, form="f \\\n {}\n")),
    Spelling("text, polygons", ".ply", write_ply),
    Spelling("text, triangles", ".ply", lambda b: write_ply(b, triangles=True)),
    Spelling("binary, polygons", ".ply", lambda b: write_ply(b, "<")),
    Spelling("binary, big end first, polygons", ".ply", lambda b: write_ply(b, ">")),
    Spelling("binary, triangles", ".ply", lambda b: write_ply(b, "<", True)),
    Spelling("polygons", ".off", write_off),
    Spelling("triangles", ".off", lambda b: write_off(b, triangles=True)),
    Spelling("counts in the first line", ".off", lambda b: write_off(b, first="OFF ")),
    Spelling("remark after the head", ".off", lambda b: write_off(b, first="OFF\n# bodies\n")),
    Spelling("objects", ".3mf", write_3mf),
    Spelling("production extension, equal ids", ".3mf", write_production_3mf),
    Spelling("nodes", ".glb", write_glb),
    Spelling("quantised", ".glb", lambda b: write_glb(b, "KHR_mesh_quantization")),
    Spelling("unknown extension", ".glb", lambda b: write_glb(b, "EXT_of_somebody")),
]
#: Spellings that may be refused though nothing is damaged.
MAY_REFUSE = {"quantised", "unknown extension"}


def compare_file(bodies: list[Body], spelling: Spelling, folder: Path) -> tuple[str, str]:
    """The name of a column, and the text of a refusal."""
    path = folder / f"part{spelling.suffix}"
    path.write_bytes(spelling.write(bodies))
    try:
        solid = camgen.read(path).solid
    except camgen.CamgenError as error:
        return "refused", str(error)
    corners = np.concatenate([body.corners for body in bodies])
    is_right = (
        np.allclose(np.ptp(solid.vertices, axis=0), np.ptp(corners, axis=0), atol=0.01)
        and len(solid.bodies) == len(bodies)
        and len(solid.edges) == sum(body.edges for body in bodies)
        and sum(not edge.convex for edge in solid.edges) == sum(body.concave for body in bodies)
    )
    if is_right:
        return "right", ""
    is_reported = any(note.kind in ("skipped", "warning") for note in solid.notes)
    return "reported" if is_reported else "silent", ""


def measure(number: int, first: int, count: int) -> Iterator[Cells]:
    """The row of a spelling."""
    spelling = SPELLINGS[number]
    counts = dict.fromkeys(("right", "reported", "refused", "silent"), 0)
    wrong: set[str] = set()
    with tempfile.TemporaryDirectory() as place:
        for seed in range(first, first + count):
            if seed % len(SPELLINGS) == number:
                kind, text = compare_file(make_bodies(seed), spelling, Path(place))
                counts[kind] += 1
                if kind == "refused" and not (spelling.damaged or spelling.name in MAY_REFUSE):
                    wrong.add(text.partition(": ")[2][:60])
    values = list(counts.values())
    refusals = Missed("; ".join(sorted(wrong))) if wrong else "0"
    counted = sum(values), *values[:3], must_be_none(values[-1])
    yield spelling.suffix[1:], spelling.name, *counted, refusals


if __name__ == "__main__":
    first, count = read_words(0, 60)
    rows = [(number, first, count) for number in range(len(SPELLINGS))]
    sys.exit(run(Scenario(COLUMNS, rows, measure)))
