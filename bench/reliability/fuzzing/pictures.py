"""Small pictures with changes, mostly in their heads."""

from __future__ import annotations

import struct
import zlib
from functools import cache

import cv2
import numpy as np
from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import change_bytes, change_file, rarely

_PNG_HEAD = b"\x89PNG\r\n\x1a\n"
#: Bytes of a PNG before its second chunk.
_FIRST_CHUNK = 33
_CHUNKS = (b"pHYs", b"tEXt", b"gAMA", b"PLTE", b"tRNS", b"eXIf", b"zzzz", b"acTL", b"iCCP")
_PGM = (
    "P2\n# a\n4 3\n255\n0 9 200 0\n0 9 200 255\n0 9 200 0\n",
    "P2\n3 3\n65535\n0 0 0 0 60000 0 0 0 0\n",
)
#: Bytes of a file that are changed.
_HEAD = 200


@cache
def _encode_samples(suffix: str) -> tuple[bytes, ...]:
    """A part on a bench, bars and two pixels, in grey, colour and 16 bit, as files of a format."""
    part = np.full((40, 40), 230, np.uint8)
    part[8:30, 10:33] = 40
    bars = np.tile(np.array([30] * 5 + [220] * 5, np.uint8), (17, 4))
    samples = []
    for grey in (part, bars, part[:1, :2]):
        kinds = [grey, np.repeat(grey[:, :, None], 3, axis=2)]
        if suffix in (".png", ".tif"):
            kinds.append(grey.astype(np.uint16) * 257)
        for pixels in kinds:
            is_possible, data = cv2.imencode(suffix, pixels)
            if is_possible:
                samples.append(bytes(data))
    return tuple(samples)


@st.composite
def _png(draw: st.DrawFn) -> bytes:
    """A PNG with changes, at times with a further chunk. Its checksums are right, mostly."""
    data = draw(change_bytes(_encode_samples(".png"), 80))
    if draw(st.booleans()):
        body = draw(st.binary(max_size=12))
        chunk = struct.pack(">I", len(body)) + draw(st.sampled_from(_CHUNKS)) + body + bytes(4)
        data = data[:_FIRST_CHUNK] + chunk + data[_FIRST_CHUNK:]
    return data if draw(rarely) else _seal(data)


def _seal(data: bytes) -> bytes:
    """A PNG with its own head, and with the checksum of each chunk whose length fits."""
    sealed = bytearray(_PNG_HEAD + data[len(_PNG_HEAD) :])
    place = len(_PNG_HEAD)
    while place + 12 <= len(sealed):
        (length,) = struct.unpack_from(">I", sealed, place)
        end = place + 8 + length
        if end + 4 > len(sealed):
            break
        struct.pack_into(">I", sealed, end, zlib.crc32(sealed[place + 4 : end]))
        place = end + 4
    return bytes(sealed)


def _change_samples(suffix: str) -> st.SearchStrategy[bytes]:
    return st.deferred(lambda: change_bytes(_encode_samples(suffix), _HEAD))


picture = st.one_of(
    _png(),
    *map(_change_samples, (".bmp", ".pgm", ".jpg", ".tif")),
    change_file(_PGM),
)
