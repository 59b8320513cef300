"""A photo or a scan: its pixels as 8 bits, and the density that may count as its scale.

What is decided here, and said in a note each time:

- 16-bit pixels are scaled by the bits that are in use (a 12-bit camera fills 0 to 4095), so that 0 stays 0 and two
  photos of one camera are scaled alike.
- Transparent pixels are blended onto white.
- The Exif orientation is honoured: the picture is turned as every viewer shows it. ``Picture.turned`` says so, because
  a lens calibration belongs to the pixels as the sensor delivers them.
- A density of 72 or 96 dots per inch (or per cm, a common slip) is what programs write when they know none. It is no
  scale; nor is the density of a file with exposure data (a camera does not know how far away the part was), one that
  differs in x and y, or one out of 10 to 25 400 DPI.
"""

from __future__ import annotations

import os
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import BinaryIO, Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.errors import InputError, one_line
from camgen.model.files import Source
from camgen.model.job import CameraTable
from camgen.model.limits import Limits, tell
from camgen.model.part import Note
from camgen.model.text import counted, short

# What the head of an image file says: kind, size, density, orientation. The first bytes tell its kind.

Kind = Literal["PNG", "JPEG", "TIFF", "BMP", "PGM"]
Density = tuple[float, float]
_Ifd = dict[int, tuple[int, int, int]]

_MM_PER_INCH = 25.4
_INCHES = {2: 1.0, 3: _MM_PER_INCH / 10}  # Exif and TIFF ResolutionUnit: dots per inch, dots per cm
_JFIF_INCHES = {1: 1.0, 2: _MM_PER_INCH / 10}
_TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}

# TIFF tags
_SUBFILE, _WIDTH, _HEIGHT, _BITS, _ORIENTATION, _SAMPLES = 254, 256, 257, 258, 274, 277
_DENSITY_X, _DENSITY_Y, _DENSITY_UNIT, _EXIF = 282, 283, 296, 0x8769
#: ExposureTime, FNumber, FocalLength: written by cameras, not by scanners.
_EXPOSURE = {0x829A, 0x829D, 0x920A}
#: FocalLengthIn35mmFilm, a whole number of mm, 0 if unknown; and the diagonal of that film, mm.
_FOCAL_35MM, _FILM_DIAGONAL = 0xA405, 43.267
#: Frame headers of a JPEG (SOF0 to SOF15 without DHT, JPG and DAC).
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
#: Width, height and the value of white of a PGM: apart by spaces, and comments to the end of their line.
_PGM = re.compile(rb"P[25]" + 3 * rb"(?:\s|#[^\n\r]*[\n\r])+([0-9]{1,9})")
#: Channels by the colour type of a PNG; a palette is decoded to colours and transparency.
_CHANNELS = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}


class Header(Struct, frozen=True):
    """The head of an image. width, height: pixels as stored. density: dots per inch along both, as the file says them.

    depth: bytes of a pixel as decoded, as far as the head says it. orientation: the Exif number 1 to 8. exposed: a
    camera took it. pages: 2 for two or more. white: the greatest value of a pixel of 8 bits that is decoded as it is
    stored. focal_35mm: focal length in a camera with 35 mm film, mm; 0 if unknown.
    """

    kind: Kind
    width: int
    height: int
    density: Density | None = None
    orientation: int = 1
    exposed: bool = False
    pages: int = 1
    white: int = 255
    depth: int = 1
    focal_35mm: int = 0


class _Tiff(Struct, frozen=True):
    """What a TIFF structure says, as a file of its own or as the Exif part of another one."""

    width: int = 0
    height: int = 0
    density: Density | None = None
    orientation: int = 1
    exposed: bool = False
    pages: int = 1
    depth: int = 1
    focal_35mm: int = 0


def header(data: bytes) -> Header | None:
    """The head of the image ``data``; None if it is none of these kinds, or ends within its head."""
    reader = next((read for magic, read in _READERS if data.startswith(magic)), None)
    if reader is None:
        return None
    try:
        found = reader(data)
    except (struct.error, IndexError):  # unpack_from checks the bounds
        return None
    return found if found.width > 0 and found.height > 0 else None


def _png(data: bytes) -> Header:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    found = Header("PNG", width, height, depth=_CHANNELS.get(colour, 4) * (2 if bits == 16 else 1))
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
            found = replace(found, width=width, height=height, depth=3 if body[5] > 1 else 1)
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


def _pgm(data: bytes) -> Header:
    """Grey values as text (P2) or bytes (P5), netpbm's pgm(5). OpenCV scales the text to 255, and not the bytes."""
    found = _PGM.match(data)
    if found is None:
        return Header("PGM", 0, 0)
    width, height, white = (int(number) for number in found.groups())
    return Header(
        "PGM", width, height, white=white if data.startswith(b"P5") and 0 < white < 255 else 255
    )


def _tiff_file(data: bytes) -> Header:
    said = _tiff(data)
    head = Header(
        "TIFF", said.width, said.height, said.density, said.orientation, said.exposed, said.pages
    )
    return replace(head, depth=said.depth, focal_35mm=said.focal_35mm)


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
        focal_35mm=said.focal_35mm,
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
        focal_35mm=_number(data, order, exif[_FOCAL_35MM]) if _FOCAL_35MM in exif else 0,
        pages=2 if following and _is_page(data, order, following) else 1,
        depth=max(1, number(_SAMPLES, 1)) * (2 if number(_BITS, 8) > 8 else 1),
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
        tags[tag] = (
            kind,
            number,
            at + 8 if inside else struct.unpack_from(order + "I", data, at + 8)[0],
        )
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
    (b"P2", _pgm),
    (b"P5", _pgm),
)


Pixels = NDArray[np.uint8]

#: The largest value of eight bits: white, or opaque.
WHITE = 255

_DEFAULTS = (72.0, 96.0, 72 * 2.54, 96 * 2.54)
_LEAST_DPI, _MOST_DPI = 10.0, 25_400.0
#: A few bytes of filling before the end mark are some cameras' habit; more of them are blocks that came out of step.
_HARMLESS = re.compile(r": [1-4] extraneous bytes before marker 0xd9")


class Picture(Struct, frozen=True, eq=False):
    """An image as read.

    pixels: (H, W) grey or (H, W, 3) blue, green, red; uint8, read-only. Transparent pixels are
        blended onto white.
    name: the file without folder.
    dpi: dots per inch if the file has a density that counts as a scale.
    turned: whether the Exif orientation turned or mirrored the pixels.
    alpha: (H, W) uint8, 0 transparent to 255 opaque; None if all is opaque.
    focal_px: focal length by the file's 35 mm focal length, px, if all of the photo is there; None
        if the file has none.
    """

    name: str
    pixels: Pixels
    dpi: float | None = None
    turned: bool = False
    notes: tuple[Note, ...] = ()
    alpha: Pixels | None = None
    focal_px: float | None = None


def load(source: Source, *, sensor: bool = False) -> Picture:
    """The picture in a PNG, JPEG, TIFF, BMP or PGM file. InputError if it is none, damaged, cut off or too large.

    sensor: its pixels as the sensor delivered them, whatever the Exif orientation says, for use with a calibrated lens.
    """
    name, data = source.name, source.data
    if not data:
        raise InputError(name, "is empty")
    head = header(data)
    if head is None:
        what = "is not a PNG, JPEG, TIFF, BMP or PGM image, or cut off in its first bytes"
        raise InputError(name, what, remedy="give a photo or a scan in one of these formats")
    _insist_on_size(name, head, source.limits)
    notes: list[Note] = [*source.notes]
    stored = _decode(data, name, head, notes)
    if head.white < 255:
        stored = (
            (stored.astype(np.float64) * (255 / head.white)).clip(0, 255).round().astype(np.uint8)
        )
        notes.append(
            Note("assumed", f"grey values scaled to 255, white is {head.white} in the file")
        )
    if head.pages > 1:
        notes.append(
            Note("skipped", "all pages but the first", "camgen reads one picture from a file")
        )
    eight_bits = _eight_bits(stored, name, notes)
    alpha = _transparency(eight_bits)
    pixels = _opaque(eight_bits, notes)
    # OpenCV has turned a TIFF already.
    turned = head.orientation != 1 and not (sensor and head.kind != "TIFF")
    if turned:
        pixels = _upright(pixels, head)
        alpha = None if alpha is None else _upright(alpha, head)
        notes.append(Note("assumed", f"picture turned by its Exif orientation {head.orientation}"))
    pixels = np.ascontiguousarray(pixels)
    pixels.flags.writeable = False
    focal = head.focal_35mm / _FILM_DIAGONAL * float(np.hypot(head.width, head.height))
    return Picture(
        name, pixels, _dpi(head, notes), turned, tuple(notes), alpha, focal_px=focal or None
    )


def is_of_sensor(camera: CameraTable) -> bool:
    """Whether the pixels are used as the sensor delivered them: a lens belongs to these.

    Points were read off the picture as a viewer shows it, turned.
    """
    return bool(camera.file) and camera.points_px is None


def _insist_on_size(name: str, head: Header, limits: Limits) -> None:
    pixels = head.width * head.height
    if pixels > limits.picture_pixels:
        what = f"has {head.width} x {head.height} pixels, more than {tell(limits.picture_pixels)}"
        raise InputError(
            name, what, remedy="crop it, scan with fewer DPI, or raise limits.picture_pixels"
        )
    if pixels * head.depth > limits.picture_bytes:
        what = (
            f"its pixels take {pixels * head.depth:,} bytes, more than {tell(limits.picture_bytes)}"
        )
        remedy = "save it with 8 bits a channel and without transparency, crop it, or raise limits.picture_bytes"
        raise InputError(name, what, remedy=remedy)


def _decode(data: bytes, name: str, head: Header, notes: list[Note]) -> NDArray[np.generic]:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    remedy = "copy or export it again"
    if data.startswith(b"P2"):
        data += b"\n"  # OpenCV wants something behind the last number
    with _decoder_speaks() as said:
        try:
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise InputError(name, f"cannot be decoded: {error.err}", remedy=remedy) from error
    if stored is None:
        raise InputError(
            name, f"is cut off or damaged: OpenCV cannot decode this {head.kind}", remedy=remedy
        )
    # libjpeg fills what it cannot decode with grey and goes on: a part of the picture is lost, or there is none.
    for line in (one_line(line) for line in said if "orrupt" in line):
        if not _HARMLESS.search(line):
            raise InputError(name, f"is damaged: {line}", remedy=remedy)
        notes.append(Note("warning", f"the decoder says: {line}", "nothing seems to be lost"))
    return stored


@contextmanager
def _decoder_speaks() -> Iterator[list[str]]:
    """The lines that the decoders in C write to standard error, instead of on the user's screen.

    There is no other way to learn that libjpeg met corrupt data: OpenCV does not pass its warnings on.
    """
    said: list[str] = []
    sys.stderr.flush()
    try:
        screen = os.dup(2)
    except OSError:  # no standard error at all: nothing to keep clean
        yield said
        return
    spoken: BinaryIO
    with tempfile.TemporaryFile() as spoken:
        os.dup2(spoken.fileno(), 2)
        try:
            yield said
        finally:
            os.dup2(screen, 2)
            os.close(screen)
            spoken.seek(0)
            said.extend(spoken.read().decode("utf-8", "replace").splitlines())


def _eight_bits(stored: NDArray[np.generic], name: str, notes: list[Note]) -> Pixels:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    if stored.dtype == np.uint8:
        return stored.astype(np.uint8, copy=False)
    if stored.dtype != np.uint16:
        raise InputError(
            name,
            f"has pixels of type {stored.dtype}",
            remedy="save it with 8 or 16 bits per channel",
        )
    deep = stored.astype(np.uint16, copy=False)
    colours = deep[..., :3] if deep.ndim == 3 else deep
    bits = max(int(colours.max()).bit_length(), 8)
    scaled = cv2.convertScaleAbs(deep, alpha=255 / (2**bits - 1))
    if deep.ndim == 3 and deep.shape[2] == 4:
        scaled[..., 3] = cv2.convertScaleAbs(np.ascontiguousarray(deep[..., 3]), alpha=255 / 65535)
    notes.append(Note("assumed", f"16-bit pixels scaled to 8 bits, {bits} bits are in use"))
    return scaled.astype(np.uint8, copy=False)


def _transparency(pixels: Pixels) -> Pixels | None:
    """The fourth channel, where it is not opaque everywhere."""
    if pixels.ndim == 2 or pixels.shape[2] == 3 or pixels[..., 3].min() == WHITE:
        return None
    return np.ascontiguousarray(pixels[..., 3])


def _opaque(pixels: Pixels, notes: list[Note]) -> Pixels:
    if pixels.ndim == 2 or pixels.shape[2] == 3:
        return pixels
    clear = pixels[..., 3] < 255
    flat = np.ascontiguousarray(pixels[..., :3])
    count = int(np.count_nonzero(clear))
    if count:
        alpha = pixels[..., 3][clear].astype(np.uint16)[:, None]
        blended = (flat[clear] * alpha + np.uint16(255) * (255 - alpha) + 127) // 255
        flat[clear] = blended.astype(np.uint8)
        notes.append(Note("assumed", f"{counted(count, 'transparent pixel')} blended onto white"))
    return flat


def _upright(pixels: Pixels, head: Header) -> Pixels:
    """Turned and mirrored as Exif 2.3 defines its orientation. OpenCV does so by itself for TIFF, and only there."""
    if head.kind == "TIFF":
        return pixels
    if head.orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if head.orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if head.orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def _dpi(head: Header, notes: list[Note]) -> float | None:
    """The density that counts as a scale. Why another does not is noted."""
    if head.density is None:
        return None
    x, y = head.density
    why = _no_scale(head, x, y)
    if not why:
        return (x + y) / 2
    meant = f"; if it is meant, set [image] mm_per_px = {short(25.4 / x, 5)}" if x > 0 else ""
    notes.append(
        Note("assumed", f"{short(x, 2)} DPI in the file is not used as a scale", why + meant)
    )
    return None


def _no_scale(head: Header, x: float, y: float) -> str:
    if head.exposed:
        return "a camera does not know how far away the part was"
    if not (_LEAST_DPI <= x <= _MOST_DPI and _LEAST_DPI <= y <= _MOST_DPI):
        return "no scanner has it"
    if abs(x / y - 1) > 0.005:
        return f"it is {short(y, 2)} DPI in the other direction"
    if any(abs(x / usual - 1) < 0.005 for usual in _DEFAULTS):
        return "programs write it when they know none"
    return ""
