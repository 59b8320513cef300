"""Nearly valid STEP, meshes of each format, and point clouds."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import (
    as_bytes,
    counts,
    edited,
    names,
    numbers,
    plain_numbers,
    rarely,
)

_PARTS = Path(__file__).parents[3] / "fixtures" / "parts"

# Part 21. The words are entities and values, put in the place of others.

_STEP_WORDS = (
    "LINE", "CIRCLE", "ELLIPSE", "B_SPLINE_CURVE_WITH_KNOTS", "PLANE", "CYLINDRICAL_SURFACE", "CONICAL_SURFACE",
    "SPHERICAL_SURFACE", "TOROIDAL_SURFACE", "EDGE_CURVE", "ORIENTED_EDGE", "VERTEX_POINT", "CARTESIAN_POINT",
    "DIRECTION", "ADVANCED_FACE", "FACE_BOUND", "FACE_OUTER_BOUND", "CLOSED_SHELL", "OPEN_SHELL", "MANIFOLD_SOLID_BREP",
    "VECTOR", "SI_UNIT", "EXTERNAL_SOURCE", "$", "*", ".T.", ".F.", ".U.", "''", "#12", "#0", "#99999", "()", "((",
    "/*", "ENDSEC;", "DATA;", ";", "#1=", "\\X2\\00E4\\X0\\", "\"0F\"",
)  # fmt: skip


def step() -> st.SearchStrategy[bytes]:
    """A part with changed entities."""
    texts = [(_PARTS / "rfa1.step").read_text(encoding="utf-8")]
    return edited(texts, _STEP_WORDS, 3).map(as_bytes)


# Meshes: the corners of a box or a few odd ones, and faces over them.

_BOX = tuple((str(x), str(y), str(z)) for x in (0, 20) for y in (0, 30) for z in (0, 10))
_BOX_FACES = (
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
    (1, 5, 7), (1, 7, 3),
)  # fmt: skip
_Soup = tuple[list[tuple[str, ...]], list[tuple[int, ...]]]


@st.composite
def _soup(draw: st.DrawFn) -> _Soup:
    """A box with some corners and faces changed, dropped, doubled or turned over."""
    corners, faces = [tuple(corner) for corner in _BOX], [tuple(face) for face in _BOX_FACES]
    for _ in range(draw(st.integers(0, 4))):
        what = draw(st.sampled_from(("corner", "corner", "drop", "double", "over", "face", "none")))
        at = draw(st.integers(0, len(faces) - 1)) if faces else 0
        if what == "corner":
            corners[draw(st.integers(0, 7))] = (draw(numbers), draw(plain_numbers), draw(numbers))
        elif what == "none" and draw(rarely):
            faces = []
        elif faces and what == "drop":
            del faces[at]
        elif faces and what == "double":
            faces.append(faces[at])
        elif faces and what == "over":
            faces[at] = faces[at][::-1]
        elif what == "face":
            faces.append(tuple(draw(st.lists(st.integers(-2, 9), min_size=0, max_size=5))))
    return corners, faces


def _float(text: str) -> float:
    try:
        return struct.unpack("<f", struct.pack("<f", float(text)))[0]  # type: ignore[no-any-return]
    except (ValueError, OverflowError):
        return float("nan")


@st.composite
def stl(draw: st.DrawFn) -> bytes:
    """As text or as bytes."""
    corners, faces = draw(_soup())
    faces = [tuple(k % 8 for k in face[:3]) for face in faces if len(face) >= 3]
    if draw(st.booleans()):
        lines = ["solid " + draw(names)]
        for face in faces:
            rows = [f"vertex {' '.join(corners[k])}" for k in face]
            normal = " ".join(draw(numbers) for _ in range(3)) if draw(rarely) else "0 0 1"
            lines += [f"facet normal {normal}", "outer loop", *rows, "endloop", "endfacet"]
        return as_bytes("\n".join([*lines, draw(st.sampled_from(("endsolid", "endsolid", "")))]))
    body = b""
    for face in faces:
        values = [0.0, 0.0, 1.0, *(_float(v) for k in face for v in corners[k])]
        body += struct.pack("<12fH", *values, 0)
    count = draw(st.sampled_from((0, 1, 2**32 - 1, len(faces) + 1))) if draw(rarely) else len(faces)
    return (
        draw(st.sampled_from((b"solid x", b"", b"\xff"))).ljust(80)
        + struct.pack("<I", count)
        + body
    )


@st.composite
def obj(draw: st.DrawFn) -> bytes:
    """With groups, texture indices, free-form statements."""
    corners, faces = draw(_soup())
    lines = [f"v {' '.join(corner)}" for corner in corners]
    form = draw(st.sampled_from(("{}", "{}//1", "{}/1", "{}/1/1", "{}/", "{}.0")))
    others = st.sampled_from(
        ("vt 0 0", "vn 0 0 1", "g x", "usemtl a", "mtllib ../x.mtl", "s off", "l 1 2", "f", "v", "v 1", "vn", "p 1",
         "curv 0 1 1 2", "f 1 2", "f 1 2 99", "f -1 -2 -3", "f a b c", "\\", "o", "v 1 2 3 4 5 6 7 8", "vt nan")
    )  # fmt: skip
    lines += ["f " + " ".join(form.format(k + 1) for k in face) for face in faces]
    for other in draw(st.lists(others, max_size=4)):
        lines.insert(draw(st.integers(0, len(lines))), other)
    return as_bytes("\n".join(lines))


@st.composite
def off(draw: st.DrawFn) -> bytes:
    """With counts that need not be so."""
    corners, faces = draw(_soup())
    told = (
        (draw(counts), draw(counts), "0")
        if draw(rarely)
        else (str(len(corners)), str(len(faces)), "0")
    )
    head = draw(st.sampled_from(("OFF", "OFF", "COFF", "NOFF", "STOFF", "off", "")))
    lines = [head, " ".join(told), *(" ".join(corner) for corner in corners)]
    lines += [f"{len(face)} {' '.join(map(str, face))}" for face in faces]
    return as_bytes("\n".join(lines))


_PLY_TYPES = st.sampled_from(
    ("float",) * 6 + ("double", "int", "uchar", "short", "float32", "uint8", "x", "list")
)


@st.composite
def _ply(
    draw: st.DrawFn, corners: list[tuple[str, ...]], faces: list[tuple[int, ...]], cloud: bool
) -> bytes:
    way = draw(
        st.sampled_from(("ascii", "ascii", "binary_little_endian", "binary_big_endian", "x", ""))
    )
    told = draw(counts) if draw(rarely) else str(len(corners))
    lines = ["ply", f"format {way} 1.0", "comment " + draw(names), f"element vertex {told}"]
    kinds = [draw(_PLY_TYPES) if draw(rarely) else "float" for _ in "xyz"]
    lines += [f"property {kind} {axis}" for kind, axis in zip(kinds, "xyz", strict=True)]
    if not cloud:
        told = draw(counts) if draw(rarely) else str(len(faces))
        lists = st.sampled_from(
            ("uchar int", "uchar int", "uchar uint", "int int", "char float", "float int", "x")
        )
        lines += [f"element face {told}", f"property list {draw(lists)} vertex_indices"]
    if draw(rarely):
        at = draw(st.integers(0, len(lines) - 1))
        lines[at : at + 1] = draw(
            st.sampled_from(([], [lines[at]] * 2, ["property"], ["element"], ["format"]))
        )
    head = as_bytes("\n".join([*lines, "end_header"]) + "\n")
    if way.startswith("binary"):
        order = ">" if "big" in way else "<"
        body = b"".join(struct.pack(order + "3f", *map(_float, corner)) for corner in corners)
        rows = () if cloud else faces
        body += b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in rows)
        return head + (body[: len(body) // 2] if draw(rarely) else body)
    rows = [] if cloud else [f"{len(face)} {' '.join(map(str, face))}" for face in faces]
    return head + as_bytes("\n".join([*(" ".join(corner) for corner in corners), *rows]))


@st.composite
def ply(draw: st.DrawFn) -> bytes:
    """A mesh."""
    return draw(_ply(*draw(_soup()), cloud=False))


@st.composite
def three_mf(draw: st.DrawFn) -> bytes:
    """An archive with a model, at times one of components."""
    corners, faces = draw(_soup())
    rows = "".join('<vertex x="{}" y="{}" z="{}"/>'.format(*corner) for corner in corners)
    cells = "".join(
        '<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in faces if len(face) == 3
    )
    unit = draw(st.sampled_from(("millimeter", "millimeter", "inch", "micron", "x", "")))
    matrix = ""
    if draw(st.booleans()):
        matrix = ' transform="' + " ".join(draw(numbers) for _ in range(12 - draw(rarely))) + '"'
    other = draw(st.sampled_from(("1", "2", "1", "9", "")))
    component = (
        f'<object id="2"><components><component objectid="{other}"{matrix}/></components></object>'
    )
    mesh = f"<mesh><vertices>{rows}</vertices><triangles>{cells}</triangles></mesh>"
    item = f'<item objectid="{draw(st.sampled_from(("1", "1", "2", "x")))}"{matrix}/>'
    space = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    model = (
        f'<model unit="{unit}" xmlns="{space}"><resources><object id="1" type="model">{mesh}</object>'
        f"{component if draw(st.booleans()) else ''}</resources><build>{item}</build></model>"
    )
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        name = draw(st.sampled_from(("3D/3dmodel.model",) * 20 + ("3D/other.model", "x")))
        zipped.writestr(zipfile.ZipInfo(name), model)  # of no date: the same bytes at any time
        zipped.writestr(zipfile.ZipInfo("[Content_Types].xml"), "<Types/>")
    data = archive.getvalue()
    return data[: draw(st.integers(0, len(data)))] if draw(rarely) else data


_SMALL = st.sampled_from((0, 0, 1, 2, 3, 8, 36, -1, 2**31, 5121, 5123, 5125, 5126))
_WILD: st.SearchStrategy[object] = _SMALL | st.sampled_from((None, "VEC3", 1.5, [], {}, True))


@st.composite
def glb(draw: st.DrawFn) -> bytes:
    """GlTF in one file, with any value of its tree changed."""
    corners, faces = draw(_soup())
    places = b"".join(struct.pack("<3f", *map(_float, corner)) for corner in corners)
    triangles = [face for face in faces if len(face) == 3 and min(face) >= 0]
    indices = b"".join(struct.pack("<3H", *face) for face in triangles)
    body = places + indices + bytes(-len(indices) % 4)
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    tree: dict[str, object] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": matrix, "children": [1]}, {"rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3 * len(triangles), "type": "SCALAR", "byteOffset": 0},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(indices)},
        ],
        "buffers": [{"byteLength": len(body)}],
    }  # fmt: skip
    for _ in range(draw(st.integers(0, 3))):
        _change(draw, tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(body), b"BIN\0")
        + body
    )
    length = draw(st.sampled_from((0, 12, 2**32 - 1))) if draw(rarely) else 12 + len(chunks)
    return struct.pack("<4sII", b"glTF", 1 if draw(rarely) else 2, length) + chunks


def _change(draw: st.DrawFn, tree: object) -> None:
    """One value somewhere in a tree becomes another, or is gone."""
    while isinstance(tree, dict | list) and tree:
        key = draw(st.sampled_from(sorted(tree) if isinstance(tree, dict) else range(len(tree))))
        value = tree[key]
        if not isinstance(value, dict | list) or not value or draw(rarely):
            if draw(rarely):
                del tree[key]
            else:
                tree[key] = draw(_WILD)
            return
        tree = value


# Point clouds: a hundred points or more, of which a few are changed.


@st.composite
def _points(draw: st.DrawFn) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [
        (str(k % 7), str(k % 11), str(k % 13)) for k in range(draw(st.integers(90, 130)))
    ]
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(rows) - 1))
        rows[at] = (
            tuple(draw(st.lists(numbers, min_size=2, max_size=4)))
            if draw(rarely)
            else (draw(numbers), "2", "3")
        )
    return rows


@st.composite
def ply_cloud(draw: st.DrawFn) -> bytes:
    """Vertices alone."""
    rows = [(*row, "0", "0")[:3] for row in draw(_points())]
    return draw(_ply(rows, [], cloud=True))


@st.composite
def pcd(draw: st.DrawFn) -> bytes:
    """As text, as records and packed."""
    rows = draw(_points())
    way = draw(st.sampled_from(("ascii", "ascii", "binary", "binary_compressed", "x")))
    fields = {"FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1"}
    fields |= {"WIDTH": str(len(rows)), "HEIGHT": "1", "POINTS": str(len(rows)), "DATA": way}
    odd = {
        "FIELDS": ("x y", "x y z w", "a b c", ""), "SIZE": ("8 4 2", "0 0 0", "-4 4 4", "4 4", "x", "3 3 3", "99 9 9"),
        "TYPE": ("I U F", "F F", "x y z", "I I I"), "COUNT": ("1 1 2", "0 1 1", "1000000000 1 1", "-1 1 1", "x 1 1"),
        "POINTS": ("0", "-1", "1e9", "999999999", "", "2147483648"),
        "DATA": ("ascii", "binary", "", "binary_compressed"),
    }  # fmt: skip
    for _ in range(draw(st.integers(0, 2))):
        key = draw(st.sampled_from(sorted(odd)))
        if draw(rarely):
            fields.pop(key, None)
        else:
            fields[key] = draw(st.sampled_from(odd[key]))
    head = "VERSION .7\n" + "".join(f"{key} {value}\n" for key, value in fields.items())
    values = [[_float(v) for v in (*row, "0", "0")[:3]] for row in rows]
    if way == "ascii":
        body = as_bytes("\n".join(" ".join(row) for row in rows))
    elif way == "binary":
        body = b"".join(struct.pack("<3f", *row) for row in values)
    else:
        plain = b"".join(
            struct.pack(f"<{len(values)}f", *column) for column in zip(*values, strict=True)
        )
        packed = b"".join(
            bytes([len(plain[k : k + 32]) - 1]) + plain[k : k + 32]
            for k in range(0, len(plain), 32)
        )
        packed = packed[: draw(st.integers(0, len(packed)))] if draw(rarely) else packed
        body = struct.pack("<II", len(packed), len(plain)) + packed
        if draw(st.booleans()):
            at = draw(st.integers(0, len(body) - 1))
            body = body[:at] + bytes([draw(st.integers(0, 255))]) + body[at + 1 :]
    return head.encode() + body


def _ptx_text() -> str:
    """A scan of 110 points in two of PTX's columns, and one of none."""
    head = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    rows = [f"0.{k} 1.{k} 2.5 0.5" for k in range(110)]
    return f"2\n55\n{head}" + "\n".join(rows) + f"\n1\n1\n{head}0 0 0 0.5\n"


def ptx() -> st.SearchStrategy[bytes]:
    """Two scans with changed numbers and lines."""
    words = ("0 0 0", "55", "2.5", "-1", "1e10", "\n", "\n2\n55\n", "0 0 0 1\n", ";", "1,5")
    return edited([_ptx_text()], words).map(as_bytes)


def headed_cloud() -> st.SearchStrategy[bytes]:
    """Text with a head, and with decimal commas, both changed."""
    points = [(f"{k}.5", f"{k % 7}.25", f"{k % 3}") for k in range(110)]
    named = "id,x,y,z\n" + "".join(f"{k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(points))
    commas = "".join(f"{x};{y};{z}\n" for x, y, z in points).replace(".", ",")
    heads = ("X [m];Y [m];Z [m]\n", "//X Y Z\n110\n", '"Points:0";"Points:1";"Points:2"\n')
    words = (
        "x",
        "Y",
        "z [mm]",
        "[m]",
        ";",
        ",",
        "\t",
        "1,5",
        "1.5",
        "110",
        "#",
        "//",
        '"',
        "easting",
    )
    return edited([named, *(head + commas for head in heads)], words).map(as_bytes)


@st.composite
def las(draw: st.DrawFn) -> bytes:
    """LAS 1.2 with 110 points, and bytes changed or cut off."""
    head = struct.pack(
        "<4s4x16xBB64x4xHIIBHI20x", b"LASF", 1, 2, 227, 227, 0, 0, 20, 110
    ) + struct.pack("<12d", *[0.01] * 3, *[0.0] * 9)
    body = b"".join(struct.pack("<3i8x", 10 * k, 7 * k % 50, k % 3) for k in range(110))
    data = bytearray(head + body)
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(head) - 1))
        data[at] = draw(st.sampled_from((0, 1, 2, 127, 128, 255)))
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(rarely) else data)


@st.composite
def text_cloud(draw: st.DrawFn) -> bytes:
    """x, y, z and whatever follows, with heads and comments."""
    mark = draw(st.sampled_from((" ", ",", ";", "\t", ", ")))
    rows = [mark.join(row) for row in draw(_points())]
    others = st.sampled_from(
        ("x,y,z", "# 1 2 3", "", "// a", "1 2", "a b c", "1 2 3 4 5 6", "110", "\xe4 \xf6 \xfc")
    )
    for other in draw(st.lists(others, max_size=3)):
        rows.insert(0 if draw(st.booleans()) else draw(st.integers(0, len(rows))), other)
    return as_bytes(draw(st.sampled_from(("\n", "\n", "\r\n", "\r"))).join(rows))
