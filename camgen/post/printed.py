"""The printed lines of a program: of most motions as forms with their numbers in columns, made text when a file is.

A post that says how it prints motions by column (``Post.forms``) is asked for the lines of all other instructions
alone. A form is filled in for thousands of motions at once, and the lines of a long program are never there one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain
from typing import Any, overload

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.body import Indices, Mask
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction
from camgen.model.text import fixed

#: So many instructions become text at a time.
_SOME = 8192
#: As near as this to the middle between two digits, in digits, a number is rounded by itself.
_NEAR = 1e-6


def rounded(values: FloatArray, decimals: int) -> FloatArray:
    """The numbers as ``fixed`` prints them, of any shape: rounded as their text is, and never -0.

    >>> rounded(np.array([-0.0004, 2.0005, 0.0015]), 3).tolist()
    [0.0, 2.0, 0.002]
    """
    found = np.empty(values.shape)
    for low in range(0, len(values), _SOME):
        some = slice(low, low + _SOME)
        scaled = values[some] * 10.0**decimals
        whole = np.rint(scaled)
        found[some] = whole / 10.0**decimals + 0.0  # which makes -0 0
        # Where a product may lie on the other side of the middle between two digits than the number itself.
        near = np.abs(np.abs(scaled - whole) - 0.5) <= np.maximum(
            _NEAR, 4 * np.spacing(np.abs(scaled))
        )
        found[some][near] = [float(fixed(value, decimals)) for value in values[some][near].tolist()]
    return found


class Forms(Struct, frozen=True, eq=False):
    """How K motions are printed. rows: (K,) which of the motions, rising. form: (K,) of each its place in ``table``,
    %-formats of its lines with LF between them. numbers: what all of them print, one after the other; counts: (K,) how
    many each prints.
    """

    rows: Indices
    form: Indices
    table: Sequence[str]
    numbers: FloatArray
    counts: Indices


def forms_of(rows: Indices, keys: Sequence[NDArray[Any]], form: Callable[..., str], numbers: FloatArray,
             used: Mask) -> Forms:  # fmt: skip
    """The forms of the motions ``rows`` (K,). keys: columns (K,) of whole numbers from 0 that decide on the form, which
    ``form`` tells of one of each. numbers: (K, F) what they may print, used: (K, F) what they do, in this order.
    """
    one = np.zeros(len(rows), np.int64)
    for key in keys:
        one = one * (int(key.max(initial=0)) + 1) + key
    _, first, place = np.unique(one, return_index=True, return_inverse=True)
    table = [form(*(int(key[k]) for key in keys)) for k in first.tolist()]
    return Forms(rows, place, table, numbers[used], used.sum(axis=1))


class _Made(Struct, frozen=True, eq=False):
    """Of N instructions: texts, the forms or what they print of those that print anything; begins: (N + 1,) where those
    of each begin. lines: (N + 1,) how many come before each. numbers: of all forms, places: (N + 1,) where those of
    each begin.
    """

    texts: list[str]
    begins: Indices
    lines: Indices
    numbers: FloatArray
    places: Indices

    def take(self, span: range) -> list[str]:
        """The texts of some instructions."""
        return self.texts[self.begins[span.start] : self.begins[span.stop]]


class Printed(Iterable[Sequence[str]]):
    """What a program prints: the lines of each instruction, in order. Nothing is printed before it is asked for.

    each: prints instructions. forms: tells of motions that are printed by column; None for no motion.
    """

    def __init__(
        self,
        columns: Columns,
        each: Callable[[Iterable[Instruction]], Iterable[Sequence[str]]],
        forms: Callable[[], Forms | None],
    ) -> None:
        self._columns, self._each, self._find = columns, each, forms

    @cached_property
    def _forms(self) -> Forms | None:
        return self._find()

    def __iter__(self) -> Iterator[Sequence[str]]:
        if self._forms is None:
            return iter(self._each(self._columns.body))
        return (
            self.text([range(k, k + 1)]).split("\n") if n else ()
            for k, n in enumerate(self.counts().tolist())
        )

    def counts(self, span: range | None = None) -> Indices:
        """(N,): the numbers of lines of the instructions, or of some of them."""
        before = self._made.lines
        return np.diff(before if span is None else before[span.start : span.stop + 1])

    def lines_before(self, instructions: Indices) -> Indices:
        """How many lines come before those of instructions."""
        return self._made.lines[instructions]

    def parts(self, most: int) -> list[Lines]:
        """All lines in as few parts as possible, cut between instructions: of ``most`` lines at most (0: all in one),
        unless one instruction has more.
        """
        before = self._made.lines
        size = len(before) - 1
        cuts = [0]
        while most and before[-1] - before[cuts[-1]] > most:
            begun = before[cuts[-1]]
            fits = int(np.searchsorted(before, begun + most, side="right")) - 1
            cuts.append(
                fits if before[fits] > begun else int(np.searchsorted(before, begun, side="right"))
            )
        return [
            Lines([range(low, high)], self)
            for low, high in zip(cuts, [*cuts[1:], size], strict=True)
        ]

    def changed(
        self, change: Callable[[Iterable[Sequence[str]]], Iterable[Sequence[str]]]
    ) -> Printed:
        """The same with other lines, where nothing is printed by column."""
        return Printed(self._columns, lambda items: change(self._each(items)), lambda: None)

    def text(self, pieces: Iterable[str | range]) -> str:
        """Lines, and those of runs of instructions, with LF between them."""
        made = self._made
        blocks: list[str] = []
        texts: list[str] = []
        spans: list[range] = []

        def close() -> None:
            if texts:
                numbers = [
                    made.numbers[made.places[span.start] : made.places[span.stop]] for span in spans
                ]
                blocks.append(self._fill("\n".join(texts), numbers))
            texts.clear()
            spans.clear()

        for piece in pieces:
            if isinstance(piece, str):
                texts.append(self._escape(piece))
                continue
            for low in range(piece.start, piece.stop, _SOME):
                span = range(low, min(low + _SOME, piece.stop))
                texts += made.take(span)
                if spans and spans[-1].stop == span.start:
                    spans[-1] = range(spans[-1].start, span.stop)
                else:
                    spans.append(span)
                if len(texts) >= _SOME:
                    close()
        close()
        return "\n".join(blocks)

    def _escape(self, text: str) -> str:
        return text if self._forms is None or "%" not in text else text.replace("%", "%%")

    def _fill(self, text: str, numbers: Sequence[FloatArray]) -> str:
        return (
            text
            if self._forms is None
            else text % tuple(chain.from_iterable(one.tolist() for one in numbers))
        )

    @cached_property
    def _made(self) -> _Made:
        columns, forms = self._columns, self._forms
        size = len(columns.body)
        texts = np.full(size, "", object)
        counts, used = np.zeros(size, np.intp), np.zeros(size, np.intp)
        alone = np.ones(size, np.bool_)
        numbers = np.zeros(0)
        if forms is None:
            self._put(texts, counts, np.flatnonzero(alone), columns.body)
        else:
            at = columns.at[forms.rows]
            alone[at] = False
            texts[at] = np.array(forms.table, object)[forms.form]
            counts[at] = np.array([form.count("\n") + 1 for form in forms.table], np.intp)[
                forms.form
            ]
            used[at] = forms.counts
            numbers = forms.numbers
            others = np.flatnonzero(alone)
            self._put(texts, counts, others, columns.pick(others))
        before, places, begins = (
            np.append(0, np.cumsum(each)) for each in (counts, used, counts > 0)
        )
        return _Made(texts[counts > 0].tolist(), begins, before, numbers, places)

    def _put(
        self,
        texts: NDArray[np.object_],
        counts: Indices,
        places: Indices,
        items: Iterable[Instruction],
    ) -> None:
        """Puts what the ``items`` at ``places`` print into ``texts``, and the numbers of lines into ``counts``."""
        lines = list(self._each(items))
        counts[places] = np.fromiter(map(len, lines), np.intp, len(lines))
        texts[places] = [self._escape(one[0] if len(one) == 1 else "\n".join(one)) for one in lines]


class Lines(Sequence[str]):
    """Lines of a file. pieces: lines with LF between them, and runs of instructions of what is ``printed``. size: how
    many lines these are, where that is known.
    """

    def __init__(
        self, pieces: Sequence[str | range], printed: Printed, size: int | None = None
    ) -> None:
        self.pieces, self.printed, self._size = pieces, printed, size

    def items(self) -> list[Lines]:
        """The same piece by piece, and instruction by instruction where it is one of those."""
        found: list[Lines] = []
        for piece in self.pieces:
            if isinstance(piece, str):
                found.append(Lines([piece], self.printed, piece.count("\n") + 1))
                continue
            sizes = self.printed.counts(piece).tolist()
            found += [
                Lines([range(k, k + 1)], self.printed, size)
                for k, size in zip(piece, sizes, strict=True)
            ]
        return found

    def __len__(self) -> int:
        if self._size is None:
            runs = [(one.start, one.stop) for one in self.pieces if isinstance(one, range)]
            before = self.printed.lines_before(np.array(runs, np.intp).reshape(-1, 2))
            self._size = int((before[:, 1] - before[:, 0]).sum())
            self._size += sum(one.count("\n") + 1 for one in self.pieces if isinstance(one, str))
        return self._size

    def __iter__(self) -> Iterator[str]:
        return iter(self.printed.text(self.pieces).split("\n") if len(self) else ())

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> list[str]: ...
    def __getitem__(self, index: int | slice) -> str | list[str]:
        return list(self)[index]


def are_forms_current(post: type) -> bool:
    """Whether a class defines `forms` no further up than each method that prints a motion.

    A class that overrides such a method alone prints other lines than the inherited `forms`.
    """
    classes = post.__mro__

    def depth(name: str) -> int:
        return next(k for k, base in enumerate(classes) if name in vars(base))

    return depth("forms") <= min(map(depth, ("movej", "movel", "movec")))


def cut_lines(printed: Iterable[Sequence[str]], max_lines: int) -> list[list[str]]:
    """Lines in parts of at most `max_lines` (0: in one part), cut between instructions.

    printed: the lines of each instruction.
    """
    parts: list[list[str]] = [[]]
    for lines in printed:
        if max_lines and len(parts[-1]) + len(lines) > max_lines and parts[-1]:
            parts.append([])
        parts[-1] += lines
    return parts


def as_printed(columns: Columns, lines: Iterable[Sequence[str]]) -> Printed:
    """The lines of each instruction of ``columns`` as what they print."""
    return (
        lines
        if isinstance(lines, Printed)
        else Printed(columns, lambda _items: lines, lambda: None)
    )


def join_lines(*parts: Sequence[str]) -> str:
    """The text of a file: lines one part after the other, each with its LF."""
    printed = next((part.printed for part in parts if isinstance(part, Lines)), None)
    if printed is None:
        return "\n".join(chain.from_iterable(parts)) + "\n"
    pieces = (
        part.pieces if isinstance(part, Lines) and part.printed is printed else part
        for part in parts
    )
    return printed.text(chain(chain.from_iterable(pieces), ("",)))
