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
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import InputError, one_line
from camgen.shapes import Note
from camgen.text import short
from camgen.vision.image_header import Header, header

Pixels = NDArray[np.uint8]

_MOST_BYTES = 1_000_000_000
_MOST_PIXELS = 200_000_000
_DEFAULTS = (72.0, 96.0, 72 * 2.54, 96 * 2.54)
_LEAST_DPI, _MOST_DPI = 10.0, 25_400.0
#: A few bytes of filling before the end mark are some cameras' habit; more of them are blocks that came out of step.
_HARMLESS = re.compile(r": [1-4] extraneous bytes before marker 0xd9")


class Picture(Struct, frozen=True, eq=False):
    """An image as read. pixels: (H, W) grey or (H, W, 3) blue, green, red; uint8, read-only.

    name: the file without folder. dpi: dots per inch if the file has one that counts as a scale. turned: its pixels
    were turned or mirrored by the Exif orientation.
    """

    name: str
    pixels: Pixels
    dpi: float | None = None
    turned: bool = False
    notes: tuple[Note, ...] = ()


def load(path: Path, *, sensor: bool = False) -> Picture:
    """The picture in a PNG, JPEG, TIFF or BMP file. InputError if it is none, damaged, cut off or too large.

    sensor: its pixels as the sensor delivered them, whatever the Exif orientation says, for use with a calibrated lens.
    """
    data = _read(path)
    head = header(data)
    if head is None:
        what = "is not a PNG, JPEG, TIFF or BMP image, or cut off in its first bytes"
        raise InputError(path.name, what, remedy="give a photo or a scan in one of these formats")
    if head.width * head.height > _MOST_PIXELS:
        what = f"has {head.width} x {head.height} pixels, more than {_MOST_PIXELS // 1_000_000} million"
        raise InputError(path.name, what, remedy="crop it or scan with fewer DPI")
    notes: list[Note] = []
    stored = _decoded(data, path.name, head, notes)
    if head.pages > 1:
        notes.append(Note("skipped", "all pages but the first", "camgen reads one picture from a file"))
    pixels = _opaque(_eight_bits(stored, path.name, notes), notes)
    # OpenCV has turned a TIFF already.
    turned = head.orientation != 1 and not (sensor and head.kind != "TIFF")
    if turned:
        pixels = _upright(pixels, head)
        notes.append(Note("assumed", f"picture turned by its Exif orientation {head.orientation}"))
    pixels = np.ascontiguousarray(pixels)
    pixels.flags.writeable = False
    return Picture(path.name, pixels, _dpi(head, notes), turned, tuple(notes))


def _read(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise InputError(path.name, f"has {size} bytes, too many for a picture", remedy="crop it")
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(path.name, f"cannot be read: {reason}") from error
    if not data:
        raise InputError(path.name, "is empty")
    return data


def _decoded(data: bytes, name: str, head: Header, notes: list[Note]) -> NDArray[np.generic]:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    remedy = "copy or export it again"
    with _decoder_speaks() as said:
        try:
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise InputError(name, f"cannot be decoded: {error.err}", remedy=remedy) from error
    if stored is None:
        raise InputError(name, f"is cut off or damaged: OpenCV cannot decode this {head.kind}", remedy=remedy)
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
        raise InputError(name, f"has pixels of type {stored.dtype}", remedy="save it with 8 or 16 bits per channel")
    deep = stored.astype(np.uint16, copy=False)
    colours = deep[..., :3] if deep.ndim == 3 else deep
    bits = max(int(colours.max()).bit_length(), 8)
    scaled = cv2.convertScaleAbs(deep, alpha=255 / (2**bits - 1))
    if deep.ndim == 3 and deep.shape[2] == 4:
        scaled[..., 3] = cv2.convertScaleAbs(np.ascontiguousarray(deep[..., 3]), alpha=255 / 65535)
    notes.append(Note("assumed", f"16-bit pixels scaled to 8 bits, {bits} bits are in use"))
    return scaled.astype(np.uint8, copy=False)


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
        notes.append(Note("assumed", f"{count} transparent pixels blended onto white"))
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
    notes.append(Note("assumed", f"{short(x, 2)} DPI in the file is not used as a scale", why + meant))
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
