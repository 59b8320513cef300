"""The printed lines of a program, which become text when a file is made.

Most motions are kept as forms, with their numbers in columns. A post that prints motions by column
(`Post.forms`) prints only the other instructions one by one. A form is filled in for thousands of
motions at once, so the lines of a long program are never in memory one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, pairwise, starmap
from typing import Any, overload

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.ragged import compute_offsets
from camgen.model.body import Indices, Mask
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction
from camgen.model.text import fixed

#: Number of instructions that become text at a time.
_BLOCK = 8192
#: Distance from the middle between two digits, in digits, within which a number is rounded alone.
_NEAR = 1e-6


def round_numbers(values: FloatArray, decimals: int) -> FloatArray:
    """Round numbers of any shape as `fixed` prints them; the result is never -0.

    >>> rounded(np.array([-0.0004, 2.0005, 0.0015]), 3).tolist()
    [0.0, 2.0, 0.002]
    """
    result = np.empty(values.shape)
    for low in range(0, len(values), _BLOCK):
        block = slice(low, low + _BLOCK)
        scaled = values[block] * 10.0**decimals
        whole = np.rint(scaled)
        result[block] = whole / 10.0**decimals + 0.0  # which makes -0 0
        # The product may be on the other side of the middle between two digits than the number.
        limit = np.maximum(_NEAR, 4 * np.spacing(np.abs(scaled)))
        near = np.abs(np.abs(scaled - whole) - 0.5) <= limit
        result[block][near] = [
            float(fixed(value, decimals)) for value in values[block][near].tolist()
        ]
    return result


class Forms(Struct, frozen=True, eq=False):
    """The forms by which K motions are printed.

    rows: (K,) indices of the motions, in increasing order.
    form: (K,) index in `table` of the form of each motion.
    table: forms; %-formats of the lines, with LF between them.
    numbers: numbers of all motions, one after the other.
    counts: (K,) number of numbers of each motion.
    """

    rows: Indices
    form: Indices
    table: Sequence[str]
    numbers: FloatArray
    counts: Indices


def make_forms(
    rows: Indices,
    keys: Sequence[NDArray[Any]],
    form: Callable[..., str],
    numbers: FloatArray,
    used: Mask,
) -> Forms:
    """Make the forms of the motions `rows` (K,).

    keys: columns (K,) of whole numbers from 0 that decide on the form.
    form: returns the form for one number of each key.
    numbers: (K, F) numbers that the motions may print, in this order.
    used: (K, F) whether a motion prints the number.
    """
    combined = np.zeros(len(rows), np.int64)
    for key in keys:
        combined = combined * (int(key.max(initial=0)) + 1) + key
    _, first, index = np.unique(combined, return_index=True, return_inverse=True)
    table = list(starmap(form, np.column_stack(keys)[first].astype(np.int64).tolist()))
    return Forms(rows, index, table, numbers[used], used.sum(axis=1))


class _Texts(Struct, frozen=True, eq=False):
    """The texts of N instructions.

    texts: the form or the lines of each instruction that prints anything.
    begins: (N + 1,) index of the first text of each instruction.
    lines: (N + 1,) number of lines before each instruction.
    numbers: numbers of all forms.
    places: (N + 1,) index of the first number of each instruction.
    """

    texts: list[str]
    begins: Indices
    lines: Indices
    numbers: FloatArray
    places: Indices


class Printed(Iterable[Sequence[str]]):
    """The printed lines of each instruction of a program, in order, made on demand.

    each: prints instructions.
    forms: returns the forms of motions that are printed by column; None for none.
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
        """Return the number of lines of all instructions, or of those in `span`, (N,)."""
        before = self._texts.lines
        return np.diff(before if span is None else before[span.start : span.stop + 1])

    def lines_before(self, instructions: Indices) -> Indices:
        """Return the number of lines before each of `instructions`."""
        return self._texts.lines[instructions]

    def parts(self, max_lines: int) -> list[Lines]:
        """Divide all lines between instructions into as few parts as possible.

        max_lines: maximum number of lines of a part; 0 for one part. A single instruction may have
            more.
        """
        before = self._texts.lines
        cuts = [0]
        while max_lines and before[-1] - before[cuts[-1]] > max_lines:
            start = before[cuts[-1]]
            end = int(np.searchsorted(before, start + max_lines, side="right")) - 1
            if before[end] == start:
                end = int(np.searchsorted(before, start, side="right"))
            cuts.append(end)
        return [Lines([range(low, high)], self) for low, high in pairwise([*cuts, len(before) - 1])]

    def changed(
        self, change: Callable[[Iterable[Sequence[str]]], Iterable[Sequence[str]]]
    ) -> Printed:
        """Return the program with changed lines; no motion is printed by column."""
        return Printed(self._columns, lambda items: change(self._each(items)), lambda: None)

    def text(self, pieces: Iterable[str | range]) -> str:
        """Join lines, and the lines of runs of instructions, with LF between them."""
        printed = self._texts
        blocks: list[str] = []
        texts: list[str] = []
        spans: list[range] = []

        def close() -> None:
            if texts:
                numbers: list[float] = []
                for span in spans:
                    first, last = printed.places[span.start], printed.places[span.stop]
                    numbers += printed.numbers[first:last].tolist()
                block = "\n".join(texts)
                blocks.append(block if self._forms is None else block % tuple(numbers))
            texts.clear()
            spans.clear()

        for piece in pieces:
            if isinstance(piece, str):
                texts.append(self._escape(piece))
                continue
            for low in range(piece.start, piece.stop, _BLOCK):
                span = range(low, min(low + _BLOCK, piece.stop))
                texts += printed.texts[printed.begins[span.start] : printed.begins[span.stop]]
                if spans and spans[-1].stop == span.start:
                    spans[-1] = range(spans[-1].start, span.stop)
                else:
                    spans.append(span)
                if len(texts) >= _BLOCK:
                    close()
        close()
        return "\n".join(blocks)

    def _escape(self, text: str) -> str:
        return text if self._forms is None or "%" not in text else text.replace("%", "%%")

    @cached_property
    def _texts(self) -> _Texts:
        columns, forms = self._columns, self._forms
        size = len(columns.body)
        texts = np.full(size, "", object)
        counts, used = np.zeros(size, np.intp), np.zeros(size, np.intp)
        alone = np.ones(size, np.bool_)
        numbers = np.zeros(0)
        if forms is None:
            self._print(texts, counts, np.flatnonzero(alone), columns.body)
        else:
            at = columns.at[forms.rows]
            alone[at] = False
            texts[at] = np.array(forms.table, object)[forms.form]
            line_counts = [form.count("\n") + 1 for form in forms.table]
            counts[at] = np.array(line_counts, np.intp)[forms.form]
            used[at] = forms.counts
            numbers = forms.numbers
            others = np.flatnonzero(alone)
            self._print(texts, counts, others, columns.pick(others))
        begins, lines = compute_offsets((counts > 0).astype(np.int64)), compute_offsets(counts)
        return _Texts(texts[counts > 0].tolist(), begins, lines, numbers, compute_offsets(used))

    def _print(
        self,
        texts: NDArray[np.object_],
        counts: Indices,
        places: Indices,
        items: Iterable[Instruction],
    ) -> None:
        lines = list(self._each(items))
        counts[places] = np.fromiter(map(len, lines), np.intp, len(lines))
        texts[places] = [self._escape("\n".join(item_lines)) for item_lines in lines]


class Lines(Sequence[str]):
    """Lines of a file.

    pieces: lines with LF between them, and runs of instructions of `printed`.
    printed: the printed lines of the program.
    size: number of lines, if it is known.
    """

    def __init__(
        self, pieces: Sequence[str | range], printed: Printed, size: int | None = None
    ) -> None:
        self.pieces, self.printed, self._size = pieces, printed, size

    def items(self) -> list[Lines]:
        """Divide the lines by pieces, and runs of instructions by instructions."""
        items: list[Lines] = []
        for piece in self.pieces:
            if isinstance(piece, str):
                items.append(Lines([piece], self.printed, piece.count("\n") + 1))
                continue
            for k, size in zip(piece, self.printed.counts(piece).tolist(), strict=True):
                items.append(Lines([range(k, k + 1)], self.printed, size))
        return items

    def __len__(self) -> int:
        if self._size is None:
            self._size = 0
            for piece in self.pieces:
                if isinstance(piece, str):
                    self._size += piece.count("\n") + 1
                else:
                    self._size += int(self.printed.counts(piece).sum())
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
    """Whether a class defines `forms` at least as far down as each method that prints a motion.

    A class that overrides such a method alone prints other lines than the inherited `forms`.
    """
    classes = post.__mro__

    def depth(name: str) -> int:
        return next(k for k, base in enumerate(classes) if name in vars(base))

    return depth("forms") <= min(map(depth, ("movej", "movel", "movec")))


def cut_lines(printed: Iterable[Sequence[str]], max_lines: int) -> list[list[str]]:
    """Divide lines between instructions into parts of at most `max_lines` (0: one part).

    printed: the lines of each instruction.
    """
    parts: list[list[str]] = [[]]
    for lines in printed:
        if max_lines and len(parts[-1]) + len(lines) > max_lines and parts[-1]:
            parts.append([])
        parts[-1] += lines
    return parts


def make_printed(columns: Columns, lines: Iterable[Sequence[str]]) -> Printed:
    """Return the lines of each instruction of `columns` as `Printed`."""
    if isinstance(lines, Printed):
        return lines
    return Printed(columns, lambda _items: lines, lambda: None)


def join_lines(*parts: Sequence[str]) -> str:
    """Join the parts of a file; each line ends with LF."""
    printed = next((part.printed for part in parts if isinstance(part, Lines)), None)
    if printed is None:
        return "\n".join(chain.from_iterable(parts)) + "\n"
    pieces = (
        part.pieces if isinstance(part, Lines) and part.printed is printed else part
        for part in parts
    )
    return printed.text(chain(chain.from_iterable(pieces), ("",)))
