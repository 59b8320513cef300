"""What the head of an image file says: kind, size, density, orientation. PNG, JPEG, TIFF and BMP, by their first bytes.

OpenCV decodes pixels but tells neither density nor orientation, and it must not be given a file before its size is
known. Formats: PNG 1.2 (IHDR, pHYs, eXIf), JFIF 1.02 (APP0), Exif 2.3 (APP1), TIFF 6.0, and the BITMAPINFOHEADER.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

Kind = Literal["PNG", "JPEG", "TIFF", "BMP"]
Density = tuple[float, float]
_Ifd = dict[int, tuple[int, int, int]]

_MM_PER_INCH = 25.4
_INCHES = {2: 1.0, 3: _MM_PER_INCH / 10}  # Exif and TIFF ResolutionUnit: dots per inch, dots per cm
_JFIF_INCHES = {1: 1.0, 2: _MM_PER_INCH / 10}
_TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}

# TIFF tags
_SUBFILE, _WIDTH, _HEIGHT, _ORIENTATION = 254, 256, 257, 274
_DENSITY_X, _DENSITY_Y, _DENSITY_UNIT, _EXIF = 282, 283, 296, 0x8769
#: ExposureTime, FNumber, FocalLength: written by cameras, not by scanners.
_EXPOSURE = {0x829A, 0x829D, 0x920A}
#: Frame headers of a JPEG (SOF0 to SOF15 without DHT, JPG and DAC).
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}


class Header(Struct, frozen=True):
    """The head of an image. width, height: pixels as stored. density: dots per inch along both, as the file says them.

    orientation: the Exif number 1 to 8. exposed: a camera took it. pages: 2 for two or more.
    """

    kind: Kind
    width: int
    height: int
    density: Density | None = None
    orientation: int = 1
    exposed: bool = False
    pages: int = 1


class _Tiff(Struct, frozen=True):
    """What a TIFF structure says, as a file of its own or as the Exif part of another one."""

    width: int = 0
    height: int = 0
    density: Density | None = None
    orientation: int = 1
    exposed: bool = False
    pages: int = 1


def header(data: bytes) -> Header | None:
    """The head of the image ``data``; None if it is none of the four kinds, or ends within its head."""
    reader = next((read for magic, read in _READERS if data.startswith(magic)), None)
    if reader is None:
        return None
    try:
        found = reader(data)
    except (struct.error, IndexError):  # unpack_from checks the bounds
        return None
    return found if found.width > 0 and found.height > 0 else None


def _png(data: bytes) -> Header:
    found = Header("PNG", *struct.unpack_from(">II", data, 16))
    at = 8
    while at + 12 <= len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        if name == b"pHYs":
            x, y, unit = struct.unpack_from(">IIB", data, at + 8)
            if unit == 1:  # per metre; 0 is a ratio only
                found = replace(found, density=(x * _MM_PER_INCH / 1000, y * _MM_PER_INCH / 1000))
        elif name == b"eXIf":
            found = _with_exif(found, data[at + 8 : at + 8 + length])
        at += 12 + length
    return found


def _jpeg(data: bytes) -> Header:
    found = Header("JPEG", 0, 0)
    at = 2
    while found.width == 0:
        start, marker = struct.unpack_from(">BB", data, at)
        if start != 0xFF:
            return found
        if marker == 0xFF or marker in _WITHOUT_LENGTH:  # fill bytes, restart markers
            at += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        if length < 2:
            return found
        body = data[at + 4 : at + 2 + length]
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", body, 1)
            found = replace(found, width=width, height=height)
        elif marker == 0xE0 and body.startswith(b"JFIF\0") and found.density is None:
            unit, x, y = struct.unpack_from(">BHH", body, 7)
            if unit in _JFIF_INCHES:
                found = replace(found, density=(x * _JFIF_INCHES[unit], y * _JFIF_INCHES[unit]))
        elif marker == 0xE1 and body.startswith(b"Exif\0\0"):
            found = _with_exif(found, body[6:])
        at += 2 + length
    return found


def _bmp(data: bytes) -> Header:
    (size,) = struct.unpack_from("<I", data, 14)
    if size < 40:  # the old head has 16-bit sizes and no density
        return Header("BMP", *struct.unpack_from("<HH", data, 18))
    width, height = struct.unpack_from("<ii", data, 18)
    x, y = struct.unpack_from("<ii", data, 38)
    density = (x * _MM_PER_INCH / 1000, y * _MM_PER_INCH / 1000) if x > 0 and y > 0 else None
    return Header("BMP", width, abs(height), density)  # a negative height: rows from the top


def _tiff_file(data: bytes) -> Header:
    said = _tiff(data)
    return Header("TIFF", said.width, said.height, said.density, said.orientation, said.exposed, said.pages)


def _with_exif(found: Header, data: bytes) -> Header:
    """``found`` with what its Exif part says. A broken one is left out: the image itself is whole."""
    try:
        said = _tiff(data)
    except (struct.error, IndexError):
        return found
    return replace(
        found,
        density=said.density or found.density,
        orientation=said.orientation,
        exposed=said.exposed,
    )


def _tiff(data: bytes) -> _Tiff:
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return _Tiff()
    (first,) = struct.unpack_from(order + "I", data, 4)
    tags, following = _ifd(data, order, first)

    def number(tag: int, default: int) -> int:
        return _number(data, order, tags[tag]) if tag in tags else default

    exif = _ifd(data, order, number(_EXIF, 0))[0] if _EXIF in tags else {}
    orientation = number(_ORIENTATION, 1)
    return _Tiff(
        width=number(_WIDTH, 0),
        height=number(_HEIGHT, 0),
        density=_tiff_density(data, order, tags, number(_DENSITY_UNIT, 2)),
        orientation=orientation if 1 <= orientation <= 8 else 1,
        exposed=bool(_EXPOSURE & set(exif)),
        pages=2 if following and _is_page(data, order, following) else 1,
    )


def _tiff_density(data: bytes, order: str, tags: _Ifd, unit: int) -> Density | None:
    if unit not in _INCHES or _DENSITY_X not in tags or _DENSITY_Y not in tags:
        return None
    x, y = (_ratio(data, order, tags[tag]) for tag in (_DENSITY_X, _DENSITY_Y))
    return (x * _INCHES[unit], y * _INCHES[unit])


def _is_page(data: bytes, order: str, offset: int) -> bool:
    """Whether the directory at ``offset`` is a page of its own, not a small copy of the first."""
    tags, _ = _ifd(data, order, offset)
    return not (_SUBFILE in tags and _number(data, order, tags[_SUBFILE]) & 1)


def _ifd(data: bytes, order: str, offset: int) -> tuple[_Ifd, int]:
    """Tag -> (type, count, where its value is), and the offset of the next directory, 0 for none."""
    (count,) = struct.unpack_from(order + "H", data, offset)
    tags: _Ifd = {}
    for i in range(count):
        at = offset + 2 + 12 * i
        tag, kind, number = struct.unpack_from(order + "HHI", data, at)
        inside = _TYPE_BYTES.get(kind, 8) * number <= 4
        tags[tag] = (kind, number, at + 8 if inside else struct.unpack_from(order + "I", data, at + 8)[0])
    end = offset + 2 + 12 * count
    return tags, struct.unpack_from(order + "I", data, end)[0] if end + 4 <= len(data) else 0


def _number(data: bytes, order: str, entry: tuple[int, int, int]) -> int:
    kind, _, at = entry
    value: int = struct.unpack_from(order + ("H" if kind == 3 else "I"), data, at)[0]
    return value


def _ratio(data: bytes, order: str, entry: tuple[int, int, int]) -> float:
    over, under = struct.unpack_from(order + "II", data, entry[2])
    return float(over / under) if under else 0.0


_READERS: tuple[tuple[bytes, Callable[[bytes], Header]], ...] = (
    (b"\x89PNG\r\n\x1a\n", _png),
    (b"\xff\xd8\xff", _jpeg),
    (b"II*\0", _tiff_file),
    (b"MM\0*", _tiff_file),
    (b"BM", _bmp),
)
