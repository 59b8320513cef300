"""Ragged arrays: groups of rows, one after the other in one table.

`counts` (G,) is the number of rows of each group.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from typing import Any, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.part import BoolArray, IntArray

#: Pairs of rows in a chunk: bounds the memory.
PAIRS = 500_000

_Value = TypeVar("_Value", bound=np.generic)


def count_rows(groups: Sequence[Sized]) -> IntArray:
    """(G,) the number of rows of each group."""
    return np.fromiter(map(len, groups), np.int64, len(groups))


def number_kept(rows: Iterable[int] | IntArray) -> dict[int, int]:
    """The new row of each of `rows` in a table that has these rows alone, in this order."""
    return {row: number for number, row in enumerate(rows)}


def concatenate_columns(parts: Iterable[Sequence[Any]]) -> list[NDArray[Any]]:
    """The columns of several parts, each joined to one array; a part is a sequence of columns."""
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def compute_first_rows(counts: Sequence[int] | IntArray) -> IntArray:
    """(G,) the first row of each group; where an empty one would begin."""
    counts = np.asarray(counts, dtype=np.int64)
    return np.cumsum(counts) - counts


def compute_offsets(counts: Sequence[int] | IntArray) -> IntArray:
    """(G + 1,) the first row of each group, and the number of rows."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])


def list_owners(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the group of each row."""
    return np.repeat(np.arange(len(counts)), counts)


def number_rows(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the place of each row in its group: 0, 1, 2 and so on."""
    return np.asarray(
        np.arange(np.sum(counts, dtype=np.int64)) - np.repeat(compute_first_rows(counts), counts)
    )


def list_range_numbers(first: IntArray, counts: IntArray) -> IntArray:
    """(N,) rows of another table from first[g] on, `counts[g]` of them for each group."""
    return np.asarray(
        np.arange(np.sum(counts, dtype=np.int64))
        + np.repeat(first - compute_first_rows(counts), counts)
    )


#: Rows of a run up to which `divide_runs` leaves it whole.
_SHORT_RUN = 64
#: Parts into which `divide_runs` divides a longer run.
_PARTS = 8


class Runs(Struct, frozen=True, eq=False):
    """Runs of rows within groups.

    group, first, end: (R,) the group of each run, its first row in the group, and the row after
    its last one.
    settled: (R,) whether all rows of the run are known to be alike.
    """

    group: IntArray
    first: IntArray
    end: IntArray
    settled: BoolArray


def divide_runs(counts: IntArray, is_settled: Callable[[Runs], BoolArray]) -> Runs:
    """Runs that together are all rows of groups of `counts` (G,) rows, in order.

    Long runs are divided until they are short or settled.

    is_settled: gets R runs and returns (R,) whether all rows of each are known to be alike.
    """
    group = np.arange(len(counts))
    settled = np.zeros(len(counts), dtype=bool)
    runs = Runs(group, np.zeros_like(counts), counts, settled)
    while (long := ~runs.settled & (runs.end - runs.first > _SHORT_RUN)).any():
        parts = np.where(long, _PARTS, 1)
        part, run = number_rows(parts), list_owners(parts)
        size = (runs.end - runs.first)[run]
        first = runs.first[run] + part * size // parts[run]
        end = runs.first[run] + (part + 1) * size // parts[run]
        settled, new = runs.settled[run], np.flatnonzero(long[run])
        runs = Runs(runs.group[run], first, end, settled)
        settled[new] = is_settled(
            Runs(runs.group[new], first[new], end[new], np.zeros(len(new), dtype=bool))
        )
    return runs


def find_following_rows(counts: Sequence[int] | IntArray) -> IntArray:
    """(N,) the row after each in its group; after the last one its first."""
    counts = np.asarray(counts, dtype=np.int64)
    counts = counts[counts > 0]
    after = np.arange(1, int(counts.sum()) + 1)
    after[np.cumsum(counts) - 1] = compute_first_rows(counts)
    return after


def find_root(parents: list[int], item: int) -> int:
    """The item that stands for the group of `item`; `parents` lead there and are shortened."""
    while parents[item] != item:
        parents[item] = parents[parents[item]]
        item = parents[item]
    return item


def list_chains(following: IntArray) -> list[list[int]]:
    """The rows (N,) as chains, each row before the one that follows it.

    Chains with a first row come in its order, then closed ones, each from its lowest row on.

    following: (N,) the row after each, which follows no other one; -1 for none.
    """
    after = following.tolist()
    is_first = np.bincount(following[following >= 0], minlength=len(after)) == 0
    seen = [False] * len(after)
    chains = []
    for begin in [*np.flatnonzero(is_first).tolist(), *range(len(after))]:
        chain: list[int] = []
        row = begin
        while row >= 0 and not seen[row]:
            seen[row] = True
            chain.append(row)
            row = after[row]
        if chain:
            chains.append(chain)
    return chains


def find_equal_pairs(
    label: IntArray, other: IntArray, limit: int
) -> tuple[Iterator[tuple[IntArray, IntArray]], IntArray]:
    """Pairs of rows of `label` (N,) and of `other` (M,) that have the same number.

    Returns the pairs in chunks of at most `PAIRS`, in the order of both tables, and the rows of
    `label` whose number is in `other` more than `limit` times. These rows make no pairs.

    Numbers are not negative. The memory grows with the largest one.
    """
    order = np.argsort(other, kind="stable")
    counts = np.bincount(other, minlength=int(label.max(initial=-1)) + 1)
    first, is_paired = compute_first_rows(counts), counts[label] <= limit
    rows, step = np.flatnonzero(is_paired), PAIRS // limit if limit else len(label) + 1

    def pairs() -> Iterator[tuple[IntArray, IntArray]]:
        for begin in range(0, len(rows), step):
            chunk = rows[begin : begin + step]
            times = counts[label[chunk]]
            yield np.repeat(chunk, times), order[list_range_numbers(first[label[chunk]], times)]

    return pairs(), np.flatnonzero(~is_paired)


def select_distinct(values: NDArray[_Value]) -> NDArray[_Value]:
    """(K,) each of `values` (N,) once, in order.

    `np.unique` loads numpy's masked arrays, which takes 5 ms.
    """
    values = np.sort(values)
    return values[mark_run_starts(values)]


def find_first_occurrences(values: IntArray) -> IntArray:
    """(K,) the first row of each different value of `values` (N,), in the order of the values.

    `np.unique` takes twice as long.
    """
    order = np.argsort(values)
    return np.minimum.reduceat(order, find_run_starts(values[order])) if len(values) else order


def measure_runs(values: NDArray[_Value]) -> IntArray:
    """(R,) lengths of the runs of equal neighbours in `values` (N,)."""
    return np.diff(np.append(find_run_starts(values), len(values)))


def find_run_starts(values: NDArray[_Value]) -> IntArray:
    """(R,) the first row of each run of equal neighbours in `values` (N, ...)."""
    return np.flatnonzero(mark_run_starts(values))


def mark_run_starts(values: NDArray[_Value]) -> BoolArray:
    """(N,) whether each row of `values` (N, ...) differs from the row before it; the first does."""
    first = np.ones(len(values), dtype=np.bool_)
    first[1:] = (values[1:] != values[:-1]).any(axis=tuple(range(1, values.ndim)))
    return first


def mark_run_ends(values: NDArray[_Value]) -> BoolArray:
    """(N,) whether each row of `values` (N, ...) differs from the row after it; the last does."""
    return mark_run_starts(values[::-1])[::-1]


def find_true_runs(mask: BoolArray) -> IntArray:
    """(R, 2) the first row of each run of true values in `mask` (N,), and the row after it."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
