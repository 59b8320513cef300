"""Nearly valid STEP, meshes of each format, and point clouds."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import (
    change_bytes,
    change_file,
    change_text,
    encode,
    rarely,
    split_words,
)

_PARTS = Path(__file__).parents[3] / "fixtures" / "parts"
#: Entities and values of part 21, which replace others.
_STEP_WORDS = (
    *split_words("LINE CIRCLE ELLIPSE B_SPLINE_CURVE_WITH_KNOTS PLANE CYLINDRICAL_SURFACE VECTOR"),
    *split_words("CONICAL_SURFACE SPHERICAL_SURFACE TOROIDAL_SURFACE EDGE_CURVE ORIENTED_EDGE"),
    *split_words("VERTEX_POINT CARTESIAN_POINT DIRECTION ADVANCED_FACE FACE_BOUND SI_UNIT"),
    *split_words("FACE_OUTER_BOUND CLOSED_SHELL OPEN_SHELL MANIFOLD_SOLID_BREP EXTERNAL_SOURCE"),
    *split_words("$ * .T. .F. .U. '' #12 #0 #99999 () (( /* ENDSEC; DATA; ; #1="),
    *("\\X2\\00E4\\X0\\", '"0F"'),
)


def step() -> st.SearchStrategy[bytes]:
    """A part with changed entities."""
    texts = [(_PARTS / "rfa1.step").read_text(encoding="utf-8")]
    return change_file(texts, _STEP_WORDS, 3)


# Meshes: a box in each format, with changes.

_STL_WORDS = split_words("solid facet normal outer loop vertex endloop endfacet endsolid nan")
_OBJ_WORDS = (
    *("\nvt 0 0\n", "\nvn 0 0 1\n", "\ng x\n", "\nusemtl a\n", "\nmtllib ../x.mtl\n", "\ns off\n"),
    *(
        "\nl 1 2\n",
        "\nf\n",
        "\nv\n",
        "\nv 1\n",
        "\nvn\n",
        "\np 1\n",
        "\ncurv 0 1 1 2\n",
        "\nf 1 2\n",
    ),
    *("\nf 1 2 99\n", "\nf -1 -2 -3\n", "\nf a b c\n", "\\", "\nv 1 2 3 4 5 6 7 8\n", "\nvt nan\n"),
    *("f", "v", "//1", "/1", "/1/1", "/", ".0", "-1", "0"),
)
_PLY_WORDS = (
    *split_words(
        "float double int uchar char short float32 uint8 uint list property element format"
    ),
    *split_words("binary_big_endian binary_little_endian ascii vertex face comment obj_info x"),
)
_3MF = (
    '<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
    '\n<resources>\n<object id="1" type="model"><mesh><vertices>\n{}\n</vertices>\n<triangles>\n'
    '{}\n</triangles></mesh></object>\n<object id="2"><components>\n'
    '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 2.5"/>\n</components></object>'
    '\n</resources>\n<build>\n<item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/>\n</build>'
    "\n</model>"
)
_3MF_WORDS = split_words("inch micron millimeter id objectid transform v1 v2 x y z mesh item 2 9")


_BOX = trimesh.creation.box((20, 30, 10))


def _export_box(kind: str) -> bytes:
    if kind == "ply_ascii":
        return _BOX.export(file_type="ply", encoding="ascii")  # type: ignore[no-any-return]
    data = _BOX.export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


@st.composite
def _change_head(
    draw: st.DrawFn, samples: Sequence[bytes], end: str, words: Sequence[str]
) -> bytes:
    """A file with changes in the head of text that ends with a line, at times cut off."""
    data = draw(st.sampled_from(samples))
    size = data.index(b"\n", data.index(end.encode())) + 1
    head = draw(change_text([data[:size].decode()], words, 3))
    body = data[size:]
    return encode(head) + body[: len(body) // 2 if draw(rarely) else len(body)]


def stl() -> st.SearchStrategy[bytes]:
    """A mesh as text or as bytes."""
    text = change_file([_export_box("stl_ascii").decode()], _STL_WORDS, 2)
    return text | change_bytes([_export_box("stl")], 300)


def obj() -> st.SearchStrategy[bytes]:
    """A mesh with groups, texture indices and free-form statements."""
    return change_file([_export_box("obj").decode()], _OBJ_WORDS, 2)


def object_file() -> st.SearchStrategy[bytes]:
    """A mesh with counts that may be wrong."""
    words = split_words("OFF COFF NOFF STOFF off 3 4 # -1")
    return change_file([_export_box("off").decode()], words, 2)


def ply() -> st.SearchStrategy[bytes]:
    """A mesh with changes in its head, or anywhere in its text."""
    text = _export_box("ply_ascii")
    big = _swap_bytes(_export_box("ply"))
    heads = _change_head([text, _export_box("ply"), big], "end_header", _PLY_WORDS)
    return heads | change_file([text.decode()], _PLY_WORDS, 2)


def _swap_bytes(data: bytes) -> bytes:
    """The box as a big-endian PLY: eight corners of three floats, then faces of three indices."""
    head, mark, body = data.partition(b"end_header\n")
    corners = np.frombuffer(body[:96], "<f4").astype(">f4").tobytes()
    faces = np.frombuffer(body[96:], np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    swapped = faces.astype(np.dtype([("count", "u1"), ("corners", ">i4", 3)])).tobytes()
    return head.replace(b"little", b"big") + mark + corners + swapped


@st.composite
def three_mf(draw: st.DrawFn) -> bytes:
    """An archive with a changed model of components, at times cut off."""
    corners = ['<vertex x="{}" y="{}" z="{}"/>'.format(*row) for row in _BOX.vertices.tolist()]
    faces = ['<triangle v1="{}" v2="{}" v3="{}"/>'.format(*row) for row in _BOX.faces.tolist()]
    text = _3MF.format("\n".join(corners), "\n".join(faces))
    model = draw(change_file([text], _3MF_WORDS, 2))
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zipped:
        name = draw(st.sampled_from(("3D/3dmodel.model",) * 20 + ("3D/other.model", "x")))
        # Without a date, the bytes are the same at any time.
        zipped.writestr(zipfile.ZipInfo(name), model)
        zipped.writestr(zipfile.ZipInfo("[Content_Types].xml"), "<Types/>")
    data = archive.getvalue()
    return data[: draw(st.integers(0, len(data)))] if draw(rarely) else data


_SMALL = st.sampled_from((0, 0, 1, 2, 3, 8, 36, -1, 2**31, 5121, 5123, 5125, 5126))
_WILD: st.SearchStrategy[object] = _SMALL | st.sampled_from((None, "VEC3", 1.5, [], {}, True))


@st.composite
def glb(draw: st.DrawFn) -> bytes:
    """GlTF in one file, with up to three values of its tree and of its bytes changed."""
    places = _BOX.vertices.astype("<f4").tobytes()
    indices = _BOX.faces.astype("<u2").tobytes()
    body = draw(change_bytes([places + indices], len(places + indices)))
    matrix = np.eye(4).ravel().tolist()
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR", "byteOffset": 0},
    ]
    turned = {"rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    tree: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": matrix, "children": [1]}, turned],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteLength": len(places)},
            {"buffer": 0, "byteOffset": len(places), "byteLength": len(indices)},
        ],
        "buffers": [{"byteLength": len(body)}],
    }
    for _ in range(draw(st.integers(0, 3))):
        _change_value(draw, tree)
    text = json.dumps(tree).encode()
    chunks = b""
    for kind, chunk, filler in ((b"JSON", text, b" "), (b"BIN\0", body, b"\0")):
        filled = chunk + filler * (-len(chunk) % 4)
        chunks += struct.pack("<I4s", len(filled), kind) + filled
    length = draw(st.sampled_from((0, 12, 2**32 - 1))) if draw(rarely) else 12 + len(chunks)
    return struct.pack("<4sII", b"glTF", 1 if draw(rarely) else 2, length) + chunks


def _change_value(draw: st.DrawFn, tree: object) -> None:
    """Replaces or drops one value of a tree of dicts and lists."""
    while isinstance(tree, dict | list) and tree:
        key = draw(st.sampled_from(sorted(tree) if isinstance(tree, dict) else range(len(tree))))
        value = tree[key]
        is_branch = isinstance(value, dict | list) and value
        if is_branch and not draw(rarely):
            tree = value
            continue
        if draw(rarely):
            del tree[key]
        else:
            tree[key] = draw(_WILD)
        return


# Point clouds: 110 points with changes.

_POINTS = [(number % 7, number % 11, number % 13) for number in range(110)]


def _join(rows: Iterable[Sequence[object]], mark: str = " ") -> str:
    return "".join(mark.join(map(str, row)) + "\n" for row in rows)


def ply_cloud() -> st.SearchStrategy[bytes]:
    """Vertices alone."""
    head = "ply\nformat {} 1.0\nelement vertex 110\nproperty float x\nproperty float y\n"
    head += "property float z\nend_header\n"
    text = head.format("ascii") + _join(_POINTS)
    samples = [text.encode()]
    for kind, order in (("binary_little_endian", "<f4"), ("binary_big_endian", ">f4")):
        samples.append(head.format(kind).encode() + np.array(_POINTS, order).tobytes())
    heads = _change_head(samples, "end_header", _PLY_WORDS)
    return heads | change_file([text], _PLY_WORDS)


_PCD_WORDS = (
    *split_words("x y z w FIELDS SIZE TYPE COUNT WIDTH HEIGHT POINTS DATA ascii binary"),
    *split_words("binary_compressed F I U 0 -4 99 3 8 1000000000 1e9 999999999 2147483648"),
)


def pcd() -> st.SearchStrategy[bytes]:
    """Points as text, as records and packed, with changed heads, and packed ones with any bytes."""
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    head += "WIDTH 110\nHEIGHT 1\nPOINTS 110\nDATA "
    text = f"{head}ascii\n{_join(_POINTS)}"
    records = np.array(_POINTS, "<f4")
    plain = records.T.tobytes()
    packed = b""
    for place in range(0, len(plain), 32):
        # A literal run of LZF: its length less one, then its bytes.
        run = plain[place : place + 32]
        packed += bytes([len(run) - 1]) + run
    packed = struct.pack("<II", len(packed), len(plain)) + packed
    packed = f"{head}binary_compressed\n".encode() + packed
    samples = [text.encode(), f"{head}binary\n".encode() + records.tobytes(), packed]
    return _change_head(samples, "DATA", _PCD_WORDS) | change_bytes([packed], len(packed))


def ptx() -> st.SearchStrategy[bytes]:
    """A scan of two columns of 55 points and one of a single point, with changes."""
    head = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    rows = "".join(f"0.{number} 1.{number} 2.5 0.5\n" for number in range(110))
    text = f"2\n55\n{head}{rows}1\n1\n{head}0 0 0 0.5\n"
    words = ("0 0 0", "55", "2.5", "-1", "1e10", "\n", "\n2\n55\n", "0 0 0 1\n", ";", "1,5")
    return change_file([text], words)


def headed_cloud() -> st.SearchStrategy[bytes]:
    """Text with a head, and with decimal commas, both changed."""
    points = [(f"{number}.5", f"{number % 7}.25", f"{number % 3}") for number in range(110)]
    named = "id,x,y,z\n" + _join([(number, *point) for number, point in enumerate(points)], ",")
    commas = _join(points, ";").replace(".", ",")
    heads = ("X [m];Y [m];Z [m]\n", "//X Y Z\n110\n", '"Points:0";"Points:1";"Points:2"\n')
    words = ("x", "Y", "z [mm]", "[m]", ";", ",", "\t", "1,5", "1.5", "110", "#", "//", '"')
    texts = [named, *(head + commas for head in heads)]
    return change_file(texts, (*words, "easting"))


def las() -> st.SearchStrategy[bytes]:
    """LAS 1.2 with 110 points, with changes in its head."""
    form = "<4s4x16xBB64x4xHIIBHI20x12d"
    scale = [0.01] * 3 + [0.0] * 9
    head = struct.pack(form, b"LASF", 1, 2, 227, 227, 0, 0, 20, 110, *scale)
    body = b"".join(struct.pack("<3i8x", 10 * x, 10 * y, z) for x, y, z in _POINTS)
    return change_bytes([head + body], len(head))


@st.composite
def text_cloud(draw: st.DrawFn) -> bytes:
    """x, y, z and further columns, with heads, comments and line ends of each kind."""
    mark = draw(st.sampled_from((" ", ",", ";", "\t", ", ")))
    words = ("x,y,z", "# 1 2 3\n", "\n", "// a\n", "1 2\n", "a b c\n", "1 2 3 4 5 6\n", "110")
    text = draw(change_text([_join(_POINTS, mark)], (*words, "\xe4 \xf6 \xfc\n")))
    head = draw(st.sampled_from(("", "", "", "x,y,z\n", "110\n", "// a\n")))
    end = draw(st.sampled_from(("\n", "\n", "\r\n", "\r")))
    return encode((head + text).replace("\n", end))
