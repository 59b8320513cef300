"""Numbers of a text by column: those that posts print, a few digits with a few decimals."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.model.program import Indices, Mask

Codes = NDArray[np.uint8]

#: What ``read_numbers`` reads. So few digits are a whole number below 2^53 over a power of ten below 10^22, both exact,
#: so that their quotient is the double nearest to the number, as ``float`` finds it.
DECIMAL = r"-?[0-9]{1,7}(?:\.[0-9]{1,8})?"
_MOST_WHOLE, _MOST_DECIMALS = 7, 8
#: So many characters are read as one word of 64 bits, in which each is a byte; so many zeros stand before a text.
WORD = 8
_POWERS = 10 ** np.arange(_MOST_DECIMALS + 1)
#: The last bytes of a word, by how many of its characters are digits of the number.
_LAST = np.array([(1 << 64) - (1 << 8 * (WORD - count)) for count in range(WORD + 1)], np.uint64)
_ZEROS, _BEYOND, _HIGH = (
    np.uint64(byte * 0x0101010101010101) for byte in (ord("0"), 0x80 - 10, 0x80)
)
_PAIR, _SECOND_PAIR = np.uint64(0x000000FF000000FF), np.uint64(16)
_TEN, _BYTE, _HALF = np.uint64(10), np.uint64(8), np.uint64(32)
_THOUSANDS, _ONES = np.uint64(100 + (1000000 << 32)), np.uint64(1 + (10000 << 32))


def codes_of(text: str) -> Codes:
    """The characters of a text, one byte each, behind as many zeros as ``read_numbers`` needs; a question mark for one
    that is not ASCII.
    """
    return np.frombuffer(b"0" * WORD + text.encode("ascii", "replace"), np.uint8)


def read_numbers(codes: Codes, begins: Indices, ends: Indices) -> tuple[FloatArray, Mask]:
    """(N,): the numbers that stand from ``begins`` to before ``ends``, which rise, and which of them are spelled like
    ``DECIMAL``; what the others are worth is not told. codes: from ``codes_of``, with one more behind the last number.
    """
    minus = codes[begins] == ord("-")
    points = np.flatnonzero(codes == ord("."))[::-1]
    owners = np.searchsorted(ends, points)
    inside = owners < len(ends)
    point = ends.copy()
    point[owners[inside]] = points[
        inside
    ]  # the first of several, and what is before the number is too long
    whole, decimals = point - begins - minus, ends - point - 1
    sound = (whole >= 1) & (whole <= _MOST_WHOLE) & (decimals != 0) & (decimals <= _MOST_DECIMALS)
    left, right = np.where(sound, whole, 0), np.where(sound, np.maximum(decimals, 0), 0)
    values, sound_whole = _read_digits(codes, point, left)
    parts, sound_part = _read_digits(codes, ends, right)
    scale = _POWERS[right]
    values *= scale
    values += parts
    found = values / scale
    np.negative(found, out=found, where=minus)
    return found, sound & sound_whole & sound_part


def _read_digits(codes: Codes, ends: Indices, counts: Indices) -> tuple[NDArray[np.int64], Mask]:
    """(N,): the whole numbers of ``counts`` digits, ``WORD`` at most, before ``ends``, and which are of digits alone.

    Neighbours are put together in three steps, all in a word: digits to pairs, pairs to fours, fours to eight.
    """
    words = sliding_window_view(codes, WORD)[ends - WORD].view("<u8")[:, 0]
    words = (words ^ _ZEROS) & _LAST[counts]
    sound = ((words + _BEYOND) | words) & _HIGH == 0
    words = words * _TEN + (words >> _BYTE)
    words = (words & _PAIR) * _THOUSANDS + ((words >> _SECOND_PAIR) & _PAIR) * _ONES
    return (words >> _HALF).astype(np.int64), sound
