"""Reads a photo or a scan: its pixels in 8 bits, and the density that may count as its scale.

These decisions are made here, each with a note:

- 16-bit pixels are scaled by the bits that are in use (a 12-bit camera fills 0 to 4095). So 0 stays
  0, and two photos of one camera are scaled alike.
- Transparent pixels are blended onto white.
- The Exif orientation is applied: the picture is turned as every viewer shows it. `Picture.turned`
  states this, because a lens calibration belongs to the pixels as the sensor delivers them.
- A density of 72 or 96 dots per inch (or per cm, a common mistake) does not count as a scale:
  programs write it when they know none. Neither does the density of a file with exposure data, as a
  camera does not know how far away the part was, nor one that differs in x and y, nor one outside
  of 10 to 25 400 DPI.
"""

from __future__ import annotations

import os
import re
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread
from typing import BinaryIO, Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.model.errors import InputError, make_one_line
from camgen.model.files import Source
from camgen.model.job import CameraTable
from camgen.model.limits import Limits, format_limit
from camgen.model.part import Note
from camgen.model.text import counted, short

# The header of an image file: kind, size, density, orientation. The first bytes show its kind.

Kind = Literal["PNG", "JPEG", "TIFF", "BMP", "PGM"]
#: Dots per inch in x and y.
Density = tuple[float, float]
#: A directory of TIFF: type, count and offset of the value, by tag.
_Ifd = dict[int, tuple[int, int, int]]

_MM_PER_INCH = 25.4
#: Factor to dots per inch, by ResolutionUnit of Exif and TIFF: inch, cm.
_INCHES = {2: 1.0, 3: _MM_PER_INCH / 10}
#: The same by the unit of JFIF.
_JFIF_INCHES = {1: 1.0, 2: _MM_PER_INCH / 10}
#: Bytes of a value, by the type of TIFF.
_TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}

# Tags of TIFF.
_SUBFILE, _WIDTH, _HEIGHT, _BITS, _ORIENTATION, _SAMPLES = 254, 256, 257, 258, 274, 277
_DENSITY_X, _DENSITY_Y, _DENSITY_UNIT, _EXIF = 282, 283, 296, 0x8769
#: ExposureTime, FNumber, FocalLength: written by cameras, not by scanners.
_EXPOSURE = {0x829A, 0x829D, 0x920A}
#: FocalLengthIn35mmFilm, a whole number of mm, 0 if unknown; and the diagonal of that film, mm.
_FOCAL_35MM, _FILM_DIAGONAL = 0xA405, 43.267
#: Frame headers of a JPEG (SOF0 to SOF15 without DHT, JPG and DAC).
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
#: Width, height and the value of white of a PGM, separated by spaces and by comments, which run to
#: the end of their line.
_PGM = re.compile(rb"P[25]" + 3 * rb"(?:\s|#[^\n\r]*[\n\r])+([0-9]{1,9})")
#: Channels by the colour type of a PNG; a palette is decoded to colours and transparency.
_CHANNELS = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}
#: Markers of a JPEG without a length: TEM, RST0 to RST7, SOI.
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}


class Header(Struct, frozen=True):
    """The header of an image.

    kind: format of the file.
    width, height: pixels as stored.
    density: dots per inch in x and y, as the file states them; None for none.
    orientation: Exif orientation, 1 to 8.
    exposed: the file has exposure data, so a camera took the image.
    pages: number of pages, 2 for two or more.
    white: maximum value of an 8-bit pixel, if it is decoded as it is stored.
    depth: bytes of a decoded pixel, as far as the header states it.
    focal_35mm: focal length in a camera with 35 mm film, mm; 0 if unknown.
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


def read_header(data: bytes) -> Header | None:
    """Read the header of an image.

    Returns None for a file of another kind, and for one that ends within its header.
    """
    readers = [read for magic, read in _READERS if data.startswith(magic)]
    if not readers:
        return None
    try:
        result = readers[0](data)
    except (struct.error, IndexError):  # unpack_from checks the bounds.
        return None
    return result if result.width > 0 and result.height > 0 else None


def _read_png(data: bytes) -> Header:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    head = Header("PNG", width, height, depth=_CHANNELS.get(colour, 4) * (2 if bits == 16 else 1))
    offset = 8
    while offset + 12 <= len(data):
        length, name = struct.unpack_from(">I4s", data, offset)
        if name == b"pHYs":
            x, y, unit = struct.unpack_from(">IIB", data, offset + 8)
            if unit == 1:  # Dots per metre; 0 is a ratio only.
                head = replace(head, density=(x * _MM_PER_INCH / 1000, y * _MM_PER_INCH / 1000))
        elif name == b"eXIf":
            head = _add_exif(head, data[offset + 8 : offset + 8 + length])
        offset += 12 + length
    return head


def _read_jpeg(data: bytes) -> Header:
    head = Header("JPEG", 0, 0)
    offset = 2
    while head.width == 0:
        start, marker = struct.unpack_from(">BB", data, offset)
        if start != 0xFF:
            return head
        if marker == 0xFF or marker in _WITHOUT_LENGTH:  # Fill bytes and restart markers.
            offset += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack_from(">H", data, offset + 2)
        if length < 2:
            return head
        body = data[offset + 4 : offset + 2 + length]
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", body, 1)
            head = replace(head, width=width, height=height, depth=3 if body[5] > 1 else 1)
        elif marker == 0xE0 and body.startswith(b"JFIF\0") and head.density is None:
            unit, x, y = struct.unpack_from(">BHH", body, 7)
            if unit in _JFIF_INCHES:
                head = replace(head, density=(x * _JFIF_INCHES[unit], y * _JFIF_INCHES[unit]))
        elif marker == 0xE1 and body.startswith(b"Exif\0\0"):
            head = _add_exif(head, body[6:])
        offset += 2 + length
    return head


def _read_bmp(data: bytes) -> Header:
    (size,) = struct.unpack_from("<I", data, 14)
    if size < 40:  # The old header has 16-bit sizes and no density.
        return Header("BMP", *struct.unpack_from("<HH", data, 18))
    width, height = struct.unpack_from("<ii", data, 18)
    x, y = struct.unpack_from("<ii", data, 38)
    density = (x * _MM_PER_INCH / 1000, y * _MM_PER_INCH / 1000) if x > 0 and y > 0 else None
    return Header("BMP", width, abs(height), density)  # A negative height means rows from the top.


def _read_pgm(data: bytes) -> Header:
    """Read a PGM, netpbm's pgm(5): grey values as text (P2) or bytes (P5).

    OpenCV scales grey values in text to 255, but not those in bytes.
    """
    match = _PGM.match(data)
    if match is None:
        return Header("PGM", 0, 0)
    width, height, white = map(int, match.groups())
    if not (data.startswith(b"P5") and 0 < white < 255):
        white = 255
    return Header("PGM", width, height, white=white)


def _add_exif(head: Header, data: bytes) -> Header:
    """The header with the values of its Exif part, which is ignored if it is broken."""
    try:
        tiff = _read_tiff(data)
    except (struct.error, IndexError):
        return head
    return replace(
        head,
        density=tiff.density or head.density,
        orientation=tiff.orientation,
        exposed=tiff.exposed,
        focal_35mm=tiff.focal_35mm,
    )


def _read_tiff(data: bytes) -> Header:
    """Read a TIFF structure: a file of its own, or the Exif part of another one."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return Header("TIFF", 0, 0)
    (first,) = struct.unpack_from(order + "I", data, 4)
    tags, following = _read_directory(data, order, first)

    def number(tag: int, default: int) -> int:
        return _read_number(data, order, tags[tag]) if tag in tags else default

    exif = _read_directory(data, order, number(_EXIF, 0))[0] if _EXIF in tags else {}
    orientation = number(_ORIENTATION, 1)
    return Header(
        "TIFF",
        width=number(_WIDTH, 0),
        height=number(_HEIGHT, 0),
        density=_read_density(data, order, tags, number(_DENSITY_UNIT, 2)),
        orientation=orientation if 1 <= orientation <= 8 else 1,
        exposed=bool(_EXPOSURE & set(exif)),
        focal_35mm=_read_number(data, order, exif[_FOCAL_35MM]) if _FOCAL_35MM in exif else 0,
        pages=2 if following and _is_page(data, order, following) else 1,
        depth=max(1, number(_SAMPLES, 1)) * (2 if number(_BITS, 8) > 8 else 1),
    )


def _read_density(data: bytes, order: str, tags: _Ifd, unit: int) -> Density | None:
    """Dots per inch in x and y; None for none. unit: ResolutionUnit."""
    if unit not in _INCHES or _DENSITY_X not in tags or _DENSITY_Y not in tags:
        return None
    x, y = _read_ratio(data, order, tags[_DENSITY_X]), _read_ratio(data, order, tags[_DENSITY_Y])
    return x * _INCHES[unit], y * _INCHES[unit]


def _is_page(data: bytes, order: str, offset: int) -> bool:
    """Whether the directory at `offset` is a page of its own, not a small copy of the first."""
    tags, _ = _read_directory(data, order, offset)
    return not (_SUBFILE in tags and _read_number(data, order, tags[_SUBFILE]) & 1)


def _read_directory(data: bytes, order: str, offset: int) -> tuple[_Ifd, int]:
    """Read the directory at `offset`.

    Returns type, count and offset of the value by tag, and the offset of the next directory, 0 for
    none.
    """
    (count,) = struct.unpack_from(order + "H", data, offset)
    tags: _Ifd = {}
    for i in range(count):
        entry = offset + 2 + 12 * i
        tag, kind, number = struct.unpack_from(order + "HHI", data, entry)
        place = entry + 8
        # A value of more than 4 bytes is elsewhere in the file.
        if _TYPE_BYTES.get(kind, 8) * number > 4:
            place = struct.unpack_from(order + "I", data, place)[0]
        tags[tag] = kind, number, place
    end = offset + 2 + 12 * count
    return tags, struct.unpack_from(order + "I", data, end)[0] if end + 4 <= len(data) else 0


def _read_number(data: bytes, order: str, entry: tuple[int, int, int]) -> int:
    kind, _, place = entry
    return int(struct.unpack_from(order + ("H" if kind == 3 else "I"), data, place)[0])


def _read_ratio(data: bytes, order: str, entry: tuple[int, int, int]) -> float:
    numerator, denominator = struct.unpack_from(order + "II", data, entry[2])
    return float(numerator / denominator) if denominator else 0.0


_READERS: tuple[tuple[bytes, Callable[[bytes], Header]], ...] = (
    (b"\x89PNG\r\n\x1a\n", _read_png),
    (b"\xff\xd8\xff", _read_jpeg),
    (b"II*\0", _read_tiff),
    (b"MM\0*", _read_tiff),
    (b"BM", _read_bmp),
    (b"P2", _read_pgm),
    (b"P5", _read_pgm),
)


Pixels = NDArray[np.uint8]

#: The largest value of eight bits: white, or opaque.
WHITE = 255

#: DPI that programs write when they know none; the last two are these per cm.
_DEFAULTS = (72.0, 96.0, 72 * 2.54, 96 * 2.54)
#: DPI of scanners.
_MIN_DPI, _MAX_DPI = 10.0, 25_400.0
#: Some cameras write a few extra bytes before the end mark. More of them are damaged blocks.
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


def read_picture(
    source: Source, *, sensor: bool = False, meanwhile: Callable[[], None] | None = None
) -> Picture:
    """Read a PNG, JPEG, TIFF, BMP or PGM file.

    sensor: leave the pixels as the sensor delivered them, without the Exif orientation, for use
        with a calibrated lens. A TIFF is turned in any case.
    meanwhile: called in a second thread while the pixels are decoded.

    Raises InputError for a file of another kind, and for one that is damaged, cut off or too large.
    """
    name, data = source.name, source.data
    if not data:
        raise InputError(name, "is empty")
    head = read_header(data)
    if head is None:
        raise InputError(
            name,
            "is not a PNG, JPEG, TIFF, BMP or PGM image, or cut off in its first bytes",
            remedy="give a photo or a scan in one of these formats",
        )
    _check_size(name, head, source.limits)
    notes: list[Note] = [*source.notes]
    with _run_beside(meanwhile):
        stored = _decode(data, name, head, notes)
    if head.white < 255:
        scaled = stored.astype(np.float64) * (255 / head.white)
        stored = scaled.clip(0, 255).round().astype(np.uint8)
        notes.append(
            Note("assumed", f"grey values scaled to 255, white is {head.white} in the file")
        )
    if head.pages > 1:
        notes.append(
            Note("skipped", "all pages but the first", "camgen reads one picture from a file")
        )
    pixels, alpha = _blend_onto_white(_convert_to_eight_bits(stored, name, notes), notes)
    # OpenCV has turned a TIFF already.
    turned = head.orientation != 1 and not (sensor and head.kind != "TIFF")
    if turned:
        pixels = _turn_upright(pixels, head)
        alpha = None if alpha is None else _turn_upright(alpha, head)
        notes.append(Note("assumed", f"picture turned by its Exif orientation {head.orientation}"))
    pixels = np.ascontiguousarray(pixels)
    pixels.flags.writeable = False
    focal = head.focal_35mm / _FILM_DIAGONAL * float(np.hypot(head.width, head.height))
    dpi = _find_scale(head, notes)
    return Picture(name, pixels, dpi, turned, tuple(notes), alpha, focal_px=focal or None)


def convert_to_grey(pixels: Pixels) -> Pixels:
    """The grey values (H, W) of a picture, (H, W) or (H, W, 3) blue, green, red."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    if pixels.ndim == 2:
        return pixels
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)


def is_of_sensor(camera: CameraTable) -> bool:
    """Whether the pixels are used as the sensor delivered them, as a lens calibration needs them.

    They are not if points are given: the user has read these off the picture as a viewer shows it,
    turned.
    """
    return bool(camera.file) and camera.points_px is None


def _check_size(name: str, head: Header, limits: Limits) -> None:
    pixels = head.width * head.height
    if pixels > limits.picture_pixels:
        raise InputError(
            name,
            f"has {head.width} x {head.height} pixels, "
            f"more than {format_limit(limits.picture_pixels)}",
            remedy="crop it, scan with fewer DPI, or raise limits.picture_pixels",
        )
    size = pixels * head.depth
    if size > limits.picture_bytes:
        raise InputError(
            name,
            f"its pixels take {size:,} bytes, more than {format_limit(limits.picture_bytes)}",
            remedy="save it with 8 bits a channel and without transparency, crop it, "
            "or raise limits.picture_bytes",
        )


def _decode(data: bytes, name: str, head: Header, notes: list[Note]) -> NDArray[np.generic]:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    remedy = "copy or export it again"
    if data.startswith(b"P2"):
        data += b"\n"  # OpenCV needs a character after the last number.
    with _catch_messages() as messages:
        try:
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise InputError(name, f"cannot be decoded: {error.err}", remedy=remedy) from error
    if stored is None:
        raise InputError(
            name, f"is cut off or damaged: OpenCV cannot decode this {head.kind}", remedy=remedy
        )
    # libjpeg fills parts that it cannot decode with grey and continues, so they are lost.
    for message in messages:
        if "orrupt" in message:
            line = make_one_line(message)
            if not _HARMLESS.search(line):
                raise InputError(name, f"is damaged: {line}", remedy=remedy)
            notes.append(Note("warning", f"the decoder says: {line}", "nothing seems to be lost"))
    return stored


@contextmanager
def _run_beside(work: Callable[[], None] | None) -> Iterator[None]:
    """Run `work` in a second thread during the body, and wait for its end."""
    thread = Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        thread.join()


@contextmanager
def _catch_messages() -> Iterator[list[str]]:
    """Catch the lines that decoders in C write to standard error, instead of showing them.

    The list is filled at the end. OpenCV does not pass warnings of libjpeg on, so corrupt data
    cannot be noticed in another way.
    """
    messages: list[str] = []
    sys.stderr.flush()
    try:
        screen = os.dup(2)
    except OSError:  # Without a standard error nothing is shown.
        yield messages
        return
    caught: BinaryIO
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            yield messages
        finally:
            os.dup2(screen, 2)
            os.close(screen)
            caught.seek(0)
            messages.extend(caught.read().decode("utf-8", "replace").splitlines())


def _convert_to_eight_bits(stored: NDArray[np.generic], name: str, notes: list[Note]) -> Pixels:
    """The pixels in 8 bits; 16-bit colours by the bits in use, with a note.

    Raises InputError for pixels of another type.
    """
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
    bits = max(int((deep[..., :3] if deep.ndim == 3 else deep).max()).bit_length(), 8)
    scaled = cv2.convertScaleAbs(deep, alpha=255 / (2**bits - 1))
    if deep.ndim == 3 and deep.shape[2] == 4:
        # Transparency always uses all 16 bits.
        scaled[..., 3] = cv2.convertScaleAbs(np.ascontiguousarray(deep[..., 3]), alpha=255 / 65535)
    notes.append(Note("assumed", f"16-bit pixels scaled to 8 bits, {bits} bits are in use"))
    return scaled.astype(np.uint8, copy=False)


def _blend_onto_white(pixels: Pixels, notes: list[Note]) -> tuple[Pixels, Pixels | None]:
    """The pixels without their fourth channel, and that channel (H, W).

    None takes its place if it is missing, or if all of it is opaque.
    """
    if pixels.ndim == 2 or pixels.shape[2] == 3:
        return pixels, None
    flat, alpha = np.ascontiguousarray(pixels[..., :3]), np.ascontiguousarray(pixels[..., 3])
    clear = alpha < WHITE
    count = int(np.count_nonzero(clear))
    if not count:
        return flat, None
    opacity = alpha[clear].astype(np.uint16)[:, None]
    blended = (flat[clear] * opacity + np.uint16(255) * (255 - opacity) + 127) // 255
    flat[clear] = blended.astype(np.uint8)
    notes.append(Note("assumed", f"{counted(count, 'transparent pixel')} blended onto white"))
    return flat, alpha


def _turn_upright(pixels: Pixels, head: Header) -> Pixels:
    """Turn and mirror a picture as Exif 2.3 defines its orientation.

    A TIFF is left as it is, as OpenCV has turned it.
    """
    if head.kind == "TIFF":
        return pixels
    if head.orientation in (5, 6, 7, 8):
        pixels = pixels.swapaxes(0, 1)
    if head.orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if head.orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return pixels


def _find_scale(head: Header, notes: list[Note]) -> float | None:
    """The density that counts as a scale, DPI; None for none.

    A note states why another density does not count.
    """
    if head.density is None:
        return None
    x, y = head.density
    why = _explain_no_scale(head, x, y)
    if not why:
        return (x + y) / 2
    if x > 0:
        why += f"; if it is meant, set [image] mm_per_px = {short(25.4 / x, 5)}"
    notes.append(Note("assumed", f"{short(x, 2)} DPI in the file is not used as a scale", why))
    return None


def _explain_no_scale(head: Header, x: float, y: float) -> str:
    """The reason why a density of x and y DPI does not count as a scale; empty if it does."""
    if head.exposed:
        return "a camera does not know how far away the part was"
    if not (_MIN_DPI <= x <= _MAX_DPI and _MIN_DPI <= y <= _MAX_DPI):
        return "no scanner has it"
    if abs(x / y - 1) > 0.005:
        return f"it is {short(y, 2)} DPI in the other direction"
    if any(abs(x / usual - 1) < 0.005 for usual in _DEFAULTS):
        return "programs write it when they know none"
    return ""
