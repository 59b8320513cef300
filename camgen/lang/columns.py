"""Lines in the usual spelling of a language, read by column: most of a long program.

The lines of a long program differ in their numbers alone. A `Template` describes such a line. It
cuts a text into runs of these lines, and into the text between them, which is read line by line.
Lines are matched, numbers are decoded and words are looked up for many lines at a time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from msgspec import DecodeError, Struct
from msgspec.json import Decoder

from camgen.model.body import Indices
from camgen.model.pose import FloatArray, Vec3

#: Characters of a text that are cut at a time. Their columns fit into the processor's cache.
_BLOCK = 1 << 16
#: Lines of a run. A reader counts lines against its limits at the end of a run.
_LONGEST = 256
_decode_rows = Decoder(list[Vec3 | None]).decode
_decode_numbers = Decoder(list[float]).decode


class Source(Struct, frozen=True, gc=False):
    """Lines of a text.

    whole: the text.
    start, end: offsets of the first line and of the end of the last one.
    """

    whole: str
    start: int
    end: int

    @property
    def text(self) -> str:
        """The lines with their ends."""
        return self.whole[self.start : self.end]


class Run(Struct, frozen=True, eq=False):
    """Consecutive lines in the usual spelling.

    columns: values of each group of the template in the lines of a block.
    low, high: bounds of the run among these lines.
    source: the lines as text.
    """

    columns: Mapping[str, Sequence[Any]]
    low: int
    high: int
    source: Source

    def __len__(self) -> int:
        return self.high - self.low

    def __getitem__(self, name: str) -> Sequence[Any]:
        """The value of a group in each line, None in a line without it."""
        return self.columns[name][self.low : self.high]


class Template:
    """The usual spelling of a line.

    line: pattern of a line with its end, which is LF or the end of the text. All its groups have
        names. None of them may match a line end.
    places: names of groups of three numbers with commas between them, as in JSON: (x, y, z).
    words: decoders of other groups by name. Each is called once for each distinct text of a block.
        With ValueError it refuses a text; the line is then none in the usual spelling.
    alike: names of groups that are the same in all lines of a run.
    """

    def __init__(
        self,
        line: str,
        *,
        places: Collection[str],
        words: Mapping[str, Callable[[str], Any]],
        alike: Collection[str] = (),
    ) -> None:
        pattern = re.compile(f"^({line})", re.MULTILINE)
        self._split = pattern.split
        self._names = list(pattern.groupindex)
        self._places, self._words, self._alike = places, words, alike

    def cut(self, text: str) -> Iterator[Run | str]:
        """Yields the whole text in order: runs, and whole lines in other spellings between them."""
        start = 0
        while start < len(text):
            end = text.find("\n", start + _BLOCK) + 1 or len(text)
            yield from self._cut_block(text, start, end)
            start = end

    def _cut_block(self, text: str, start: int, end: int) -> Iterator[Run | str]:
        # The text before a line, the line and its groups, again and again, and the text behind.
        pieces = self._split(text[start:end])
        width = len(self._names) + 2
        between, lines = pieces[::width], pieces[1::width]
        columns: dict[str, Sequence[Any]] = {
            name: pieces[k::width] for k, name in enumerate(self._names, start=2)
        }
        for name in self._places:
            columns[name] = _read_places(columns[name])
        refused: set[int] = set()
        for name, decode in self._words.items():
            columns[name], odd = read_words(columns[name], decode)
            refused.update(odd)
        for low, high in pairwise(self._find_bounds(columns, between, refused)):
            if between[low]:
                yield between[low]
                start += len(between[low])
            end = start + sum(map(len, lines[low:high]))
            if low in refused:
                yield lines[low]
            else:
                yield Run(columns, low, high, Source(text, start, end))
            start = end
        if between[-1]:
            yield between[-1]

    def _find_bounds(
        self, columns: Mapping[str, Sequence[Any]], between: Sequence[str], refused: set[int]
    ) -> list[int]:
        count = len(between) - 1
        bounds = {*range(0, count, _LONGEST), count, *refused, *(line + 1 for line in refused)}
        bounds.update(line for line, gap in enumerate(between) if gap)
        for name in self._alike:
            pairs = enumerate(pairwise(columns[name]), start=1)
            bounds.update(line for line, (before, value) in pairs if value != before)
        return sorted(bounds)


def _read_places(texts: Sequence[str | None]) -> list[Vec3 | None]:
    """The numbers of each text, None for None."""
    if None in texts:
        rows = ",".join("null" if text is None else f"[{text}]" for text in texts)
    else:
        rows = "],[".join(text for text in texts if text is not None).join(("[", "]"))
    return _decode_rows(f"[{rows}]") if texts else []


def read_words(
    texts: Sequence[str | None], decode: Callable[[str], Any]
) -> tuple[list[Any], list[int]]:
    """The value of each text, None for None, and the indices of those that `decode` refuses.

    decode: called once for each distinct text. With ValueError it refuses it.
    """
    values: dict[str | None, Any] = {None: None}
    refused: set[str | None] = set()
    for text in dict.fromkeys(texts):
        if text is None:
            continue
        try:
            values[text] = decode(text)
        except ValueError:
            values[text] = None
            refused.add(text)
    odd = [index for index, text in enumerate(texts) if text in refused] if refused else []
    return list(map(values.__getitem__, texts)), odd


def read_numbers(text: bytes) -> FloatArray | None:
    """(N,): numbers with commas between them, None if one is not spelled as in JSON.

    They are those of `float`, to the last bit, except the sign of -0 without a point.
    """
    try:
        numbers = _decode_numbers(b"[%b]" % text)
    except DecodeError:
        return None
    return np.fromiter(numbers, np.float64, len(numbers))


def find_distinct(texts: Sequence[str]) -> tuple[list[str], Indices]:
    """The distinct texts, and (N,): for each of `texts` its index among them."""
    number = {text: index for index, text in enumerate(dict.fromkeys(texts))}
    return list(number), np.fromiter(map(number.__getitem__, texts), np.intp, len(texts))
