"""Pictures of a few pixels, sound ones and such as their heads do not fit."""

from __future__ import annotations

import struct
import zlib
from functools import cache

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import as_bytes, counts, names, numbers, rarely

_SIZES = st.sampled_from((1, 2, 3, 8, 17, 40, 40, 40))
_ODD_SIZES = st.sampled_from((0, 65_535, 2**31 - 1, 2**32 - 1, 20_000))


@st.composite
def _pixels(draw: st.DrawFn, count: int) -> bytes:
    """So many bytes in bars of two greys: a border or many for who looks for one."""
    dark, light = draw(st.integers(0, 255)), draw(st.integers(0, 255))
    bar = draw(st.integers(1, 30))
    row = (bytes([dark]) * bar + bytes([light]) * bar) * (count // (2 * bar) + 1)
    start = draw(st.integers(0, count // 2))
    return bytes([light]) * start + row[: count - start]


def _chunk(kind: bytes, data: bytes, sound: bool = True) -> bytes:
    return (
        struct.pack(">I", len(data))
        + kind
        + data
        + struct.pack(">I", zlib.crc32(kind + data) ^ (not sound))
    )


@st.composite
def _png(draw: st.DrawFn) -> bytes:
    width, height = draw(_SIZES), draw(_SIZES)
    bits, colour = draw(
        st.sampled_from(((8, 0), (8, 2), (8, 6), (16, 0), (16, 6), (1, 0), (8, 3), (8, 4), (3, 7)))
    )
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(colour, 1)
    stride = (width * channels * bits + 7) // 8
    body = draw(_pixels(stride * height))
    rows = b"".join(
        bytes([draw(rarely)]) + body[y * stride : (y + 1) * stride] for y in range(height)
    )
    told = (draw(_ODD_SIZES), height) if draw(rarely) else (width, height)
    head = struct.pack(">IIBBBBB", *told, bits, colour, 0, 0, draw(rarely))
    extra = b""
    if draw(st.booleans()):
        kind = draw(
            st.sampled_from(
                (b"pHYs", b"tEXt", b"gAMA", b"PLTE", b"tRNS", b"eXIf", b"zzzz", b"acTL", b"iCCP")
            )
        )
        extra = _chunk(kind, draw(st.binary(max_size=12)), not draw(rarely))
    data = zlib.compress(rows[: len(rows) // 2] if draw(rarely) else rows)
    return (
        b"\x89PNG\r\n\x1a\n"
        + _chunk(b"IHDR", head)
        + extra
        + _chunk(b"IDAT", data)
        + _chunk(b"IEND", b"")
    )


@st.composite
def _bmp(draw: st.DrawFn) -> bytes:
    width, height = draw(_SIZES), draw(_SIZES)
    bits = draw(st.sampled_from((8, 24, 32, 24, 1, 4, 16, 7)))
    stride = (width * bits + 31) // 32 * 4
    palette = bytes(4 * 256) if bits <= 8 else b""
    told = draw(_ODD_SIZES) if draw(rarely) else width
    offset = draw(st.sampled_from((0, 2**31, 20))) if draw(rarely) else 54 + len(palette)
    sign = -1 if draw(rarely) else 1
    packing = draw(st.sampled_from((1, 2, 3, 9))) if draw(rarely) else 0
    head = struct.pack("<IIiHHIIiiII", 40, told, sign * height, 1, bits, packing, 0, 0, 0, 0, 0)
    body = draw(_pixels(stride * height))
    return b"BM" + struct.pack("<IHHI", 0, 0, 0, offset) + head + palette + body


@st.composite
def _pgm(draw: st.DrawFn) -> bytes:
    width, height = draw(_SIZES), draw(_SIZES)
    kind = draw(st.sampled_from(("P5", "P5", "P2")))
    told = draw(counts) if draw(rarely) else str(width)
    most = draw(st.sampled_from(("255", "255", "65535", "0", "-1", "1", "70000")))
    comment = f"# {draw(names)}\n" if draw(rarely) else ""
    head = as_bytes(f"{kind}\n{comment}{told} {height}\n{most}\n")
    if kind == "P5":
        return head + draw(_pixels(width * height))
    return head + " ".join(draw(st.lists(numbers, max_size=12))).encode("utf-8")


@cache
def _coded() -> tuple[bytes, ...]:
    """Small sound pictures of the formats whose bytes are too much for a strategy."""
    import cv2  # noqa: PLC0415 (only for these)
    import numpy as np  # noqa: PLC0415

    grey = np.full((40, 40), 230, np.uint8)
    grey[8:30, 10:33] = 40
    colour = np.repeat(grey[:, :, None], 3, axis=2)
    kinds = (
        (".jpg", colour),
        (".jpg", grey),
        (".tif", grey),
        (".tif", colour),
        (".tif", grey.astype(np.uint16) * 257),
    )
    return tuple(bytes(cv2.imencode(suffix, pixels)[1]) for suffix, pixels in kinds)


@st.composite
def _damaged(draw: st.DrawFn) -> bytes:
    """Bytes of a coded picture changed, mostly in its head."""
    data = bytearray(draw(st.sampled_from(_coded())))
    for _ in range(draw(st.integers(0, 5))):
        at = draw(st.integers(0, min(len(data), 200) - 1)) * (-1 if draw(st.booleans()) else 1)
        data[at] = draw(st.integers(0, 255))
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(rarely) else data)


picture = st.one_of(_png(), _bmp(), _pgm(), st.deferred(_damaged))
