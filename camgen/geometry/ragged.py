"""Ragged arrays: groups of rows, one after the other in one table; ``counts`` (G,) is how many rows each group has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from camgen.model.part import BoolArray, IntArray

#: Pairs of rows that are looked at together: bounds the memory.
PAIRS = 500_000

_Value = TypeVar("_Value", bound=np.generic)


def begins(counts: Sequence[int] | IntArray) -> IntArray:
    """(G,) the first row of each group; where an empty one would begin."""
    counts = np.asarray(counts, dtype=np.int64)
    return np.cumsum(counts) - counts


def offsets(counts: Sequence[int] | IntArray) -> IntArray:
    """(G + 1,) the first row of each group, and the number of rows."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])


def owners(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the group of each row."""
    return np.repeat(np.arange(len(counts)), counts)


def ramp(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the place of each row in its group: 0, 1, 2 and so on."""
    return np.asarray(np.arange(np.sum(counts, dtype=np.int64)) - np.repeat(begins(counts), counts))


def stretches(first: IntArray, counts: IntArray) -> IntArray:
    """(N,) the rows first[g], first[g] + 1 and so on of another table, ``counts[g]`` of them for each group."""
    return np.asarray(
        np.arange(np.sum(counts, dtype=np.int64)) + np.repeat(first - begins(counts), counts)
    )


def following(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the row after each in its group; after the last one its first."""
    counts = np.asarray(counts, dtype=np.int64)
    counts = counts[counts > 0]
    after = np.arange(1, int(counts.sum()) + 1)
    after[np.cumsum(counts) - 1] = begins(counts)
    return after


def matches(
    label: IntArray, other: IntArray, most: int
) -> tuple[Iterator[tuple[IntArray, IntArray]], IntArray]:
    """Pairs of rows of ``label`` (N,) and of ``other`` (M,) that hold one number, in the order of both and in chunks of
    at most ``PAIRS``, for numbers that ``other`` has no more than ``most`` times; and the rows of ``label`` with a
    number that it has more often.

    The numbers are not negative, and not much larger than there are rows: the memory goes by the largest.
    """
    order = np.argsort(other, kind="stable")
    counts = np.bincount(other, minlength=int(label.max(initial=-1)) + 1)
    first, few = begins(counts), counts[label] <= most
    rows, step = np.flatnonzero(few), PAIRS // most if most else len(label) + 1

    def pairs() -> Iterator[tuple[IntArray, IntArray]]:
        for begin in range(0, len(rows), step):
            chunk = rows[begin : begin + step]
            times = counts[label[chunk]]
            yield np.repeat(chunk, times), order[stretches(first[label[chunk]], times)]

    return pairs(), np.flatnonzero(~few)


def each_once(values: NDArray[_Value]) -> NDArray[_Value]:
    """The different ones of ``values`` (N,), in order. ``np.unique`` loads numpy's masked arrays, which takes 5 ms."""
    values = np.sort(values)
    return values[starts_run(values)]


def first_of_each(values: IntArray) -> IntArray:
    """(K,) of each different one of ``values`` (N,), in order, where it is first; ``np.unique`` takes twice as long."""
    order = np.argsort(values)
    return np.minimum.reduceat(order, run_starts(values[order])) if len(values) else order


def run_lengths(values: NDArray[_Value]) -> IntArray:
    """(R,) how many equal neighbours there are in ``values`` (N,), run after run."""
    return np.diff(np.append(run_starts(values), len(values)))


def run_starts(values: NDArray[_Value]) -> IntArray:
    """(R,) the first row of each run of equal neighbours in `values` (N, ...)."""
    return np.flatnonzero(starts_run(values))


def starts_run(values: NDArray[_Value]) -> BoolArray:
    """(N,) whether each row of `values` (N, ...) differs from the row before it; the first does."""
    first = np.ones(len(values), dtype=np.bool_)
    differs = values[1:] != values[:-1]
    first[1:] = differs.any(axis=tuple(range(1, values.ndim)))
    return first


def ends_run(values: NDArray[_Value]) -> BoolArray:
    """(N,) whether each row of `values` (N, ...) differs from the row after it; the last does."""
    return starts_run(values[::-1])[::-1]


def true_runs(mask: BoolArray) -> IntArray:
    """(R, 2) the first row of each run of true values in `mask` (N,), and the row after it."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
