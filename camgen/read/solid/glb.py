"""Prepares binary glTF 2.0 files for trimesh, which reads the meshes.

trimesh ignores extensions, and integers that represent fractions. So files with extensions that
hold shapes are refused, and such integers are converted.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from camgen.model.pose import FloatArray
from camgen.read.solid.soup import UnreadShape

_HEAD = 12
_QUANTIZED = "KHR_mesh_quantization"
#: Prefixes of extensions that change no shape (glTF registry).
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "KHR_xmp")
#: Extensions that hold shapes or copies of shapes, required or not.
_SHAPES = {
    "KHR_draco_mesh_compression": "compressed meshes (Draco)",
    "EXT_meshopt_compression": "compressed meshes (meshopt)",
    "EXT_mesh_gpu_instancing": "instances of meshes",
}
#: Types of integers by their code, each with the value that represents 1.
_TYPES = {
    5120: ("<i1", 127.0),
    5121: ("<u1", 255.0),
    5122: ("<i2", 32767.0),
    5123: ("<u2", 65535.0),
}
_FLOAT = 5126


def prepare_glb(data: bytes) -> bytes:
    """The file with all positions as floats. Raises UnreadShape for a shape that is not read."""
    document, body = split_glb(data)
    required = set(document.get("extensionsRequired", ()))
    for name in sorted(required | set(document.get("extensionsUsed", ()))):
        shape = _SHAPES.get(name)
        if shape:
            raise UnreadShape(f"has {shape}, the extension {name}, which is not read")
        if name in required and name != _QUANTIZED and not name.startswith(_HARMLESS):
            raise UnreadShape(f"requires the extension {name}, which is not read")
    accessors = document.get("accessors", [])
    positions: set[int] = set()
    for mesh in document.get("meshes", ()):
        for primitive in mesh.get("primitives", ()):
            attributes = primitive.get("attributes", {})
            if "POSITION" in attributes:
                positions.add(attributes["POSITION"])
    if any("sparse" in accessors[k] for k in positions):
        raise UnreadShape("has sparse accessors, which are not read")
    normalized = [k for k in sorted(positions) if accessors[k].get("normalized")]
    if not normalized:
        return data
    for k in normalized:
        values = _dequantize(document, accessors[k], body).astype("<f4").tobytes()
        body += b"\0" * (-len(body) % 4)
        views = document["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(values)})
        accessors[k] = {
            "bufferView": len(views) - 1,
            "componentType": _FLOAT,
            "count": accessors[k]["count"],
            "type": "VEC3",
        }
        body += values
    document["buffers"][0]["byteLength"] = len(body)
    return _join(document, body)


def list_names(data: bytes) -> set[str]:
    """The names of the nodes and meshes of a file."""
    document, _ = split_glb(data)
    members = [*document.get("nodes", ()), *document.get("meshes", ())]
    return {str(member["name"]) for member in members if member.get("name")}


def split_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The document and the binary chunk of a file."""
    (length,) = struct.unpack_from("<I", data, _HEAD)
    begin = _HEAD + 8
    return json.loads(data[begin : begin + length]), data[begin + length + 8 :]


def _join(document: dict[str, Any], body: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body += b"\0" * (-len(body) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, _HEAD + len(chunks)) + chunks


def _dequantize(document: dict[str, Any], accessor: dict[str, Any], body: bytes) -> FloatArray:
    """(N, 3) positions of integers that represent -1 to 1, or 0 to 1 (section 3.6.2.2)."""
    kind, largest = _TYPES[accessor["componentType"]]
    view = document["bufferViews"][accessor["bufferView"]]
    size = np.dtype(kind).itemsize
    stride = view.get("byteStride", 3 * size)
    first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count = accessor["count"]
    if count < 0 or first + stride * (count - 1) + 3 * size > len(body):
        raise ValueError("an accessor is larger than the file")
    rows = np.ndarray((count, 3), kind, body, first, (stride, size))
    return np.maximum(rows / largest, -1.0)
