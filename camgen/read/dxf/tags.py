"""A DXF text as columns of tags: group codes, and the places of their values in the text."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Texts = NDArray[np.bytes_]
Index = NDArray[np.int64]
Places = NDArray[np.int32]
Mask = NDArray[np.bool_]

#: Bytes that are read of a value at most, and of a number.
LONGEST, LONGEST_NUMBER = 64, 32
#: Digits of a group code.
_CODE_DIGITS = 4


class Tags(Struct, frozen=True, eq=False):
    """Tags of a text. An entity is a tag with the group code 0 and all tags up to the next one.

    text: bytes of the text, followed by `LONGEST` zeros.
    at: (T,) offset of each tag.
    code: (T,) group codes.
    begin: (T,) offset of each value.
    length: (T,) bytes of each value.
    head: (E,) index of the first tag of each entity.
    count: (E,) number of its tags.
    """

    text: Bytes
    at: Places
    code: Places
    begin: Places
    length: Places
    head: Index
    count: Index

    def values(self, tags: Index, widest: int) -> Texts:
        """(N,) values of `tags`; empty if longer than `widest` bytes, `LONGEST` at most."""
        length = self.length[tags]
        length[length > widest] = 0
        width = max(1, int(length.max(initial=1)))
        # A window from each byte of the text: copying all values at once is faster than one by one.
        windows = as_strided(
            self.text[:width].view(f"V{width}"), (len(self.text) - width + 1,), (1,)
        )
        letters = windows[self.begin[tags]].view(np.uint8).reshape(-1, width)
        letters *= np.arange(width, dtype=np.int32) < length[:, None]
        return np.asarray(letters.view(f"S{width}")[:, 0])

    def value(self, tag: int) -> bytes:
        """The whole value of a tag."""
        begin = int(self.begin[tag])
        return self.text[begin : begin + int(self.length[tag])].tobytes()

    def are(self, kinds: tuple[str, ...]) -> Mask:
        """(E,) whether each entity is of one of `kinds`."""
        return np.isin(self.values(self.head, 8), np.array(kinds, dtype=np.bytes_))


def tabulate(data: bytes) -> Tags | None:
    """The tags of a text in which each line ends in a line feed.

    Returns None if a line that should hold a group code holds something else.
    """
    text = np.frombuffer(data + bytes(LONGEST), np.uint8)
    ends = np.flatnonzero(text == ord("\n")).astype(np.int32)
    if not len(ends) or len(ends) % 2:
        return None
    begin = np.concatenate([np.zeros(1, np.int32), ends[:-1] + np.int32(1)])
    if b"\r" in data:
        ends -= (ends > begin) & (text[ends - 1] == ord("\r"))
    code = _read_codes(text, begin[::2], ends[::2])
    if code is None:
        return None
    head = np.flatnonzero(code == 0)
    count = np.diff(head, append=len(code))
    return Tags(text, begin[::2], code, begin[1::2], (ends - begin)[1::2], head, count)


def _read_codes(text: Bytes, begin: Places, end: Places) -> Places | None:
    """(T,) numbers of one to four digits after blanks, or None if a line holds something else."""
    size = end - begin
    code = np.zeros(len(begin), np.int32)
    is_code = (size > 0) & (size <= _CODE_DIGITS)
    digit_follows = np.ones(len(begin), np.bool_)
    for k in range(min(_CODE_DIGITS, int(size.max(initial=0)))):
        letter = text.take(end - (1 + k), mode="clip")
        inside = size > k
        # Bytes below "0" wrap to large numbers, so that other characters are above 9.
        digit = letter - np.uint8(ord("0"))
        is_digit = inside & (digit <= 9)
        if k:
            is_code &= (is_digit & digit_follows) | ~inside | (letter == ord(" "))
        else:
            is_code &= is_digit
        code += (digit * is_digit).astype(np.int32) * np.int32(10**k)
        digit_follows = is_digit
    return code if is_code.all() else None
