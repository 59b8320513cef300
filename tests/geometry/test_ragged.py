"""Ragged arrays, judged by lists of lists."""

from itertools import chain, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry import ragged
from camgen.geometry.ragged import (
    Runs,
    compute_first_rows,
    compute_offsets,
    divide_runs,
    find_equal_pairs,
    find_first_occurrences,
    find_following_rows,
    find_run_starts,
    find_true_runs,
    list_owners,
    list_range_numbers,
    mark_run_ends,
    mark_run_starts,
    measure_runs,
    number_rows,
    select_distinct,
)
from camgen.geometry.vectors import find_nearest_row
from camgen.model.part import BoolArray

COUNTS = st.lists(st.integers(0, 4), max_size=8)


@given(COUNTS)
def test_rows_of_groups(counts: list[int]) -> None:
    groups = [list(range(sum(counts[:k]), sum(counts[: k + 1]))) for k in range(len(counts))]
    assert compute_first_rows(counts).tolist() == [sum(counts[:k]) for k in range(len(counts))]
    assert compute_offsets(counts).tolist() == [sum(counts[:k]) for k in range(len(counts) + 1)]
    assert list_owners(counts).tolist() == [k for k, group in enumerate(groups) for _ in group]
    assert number_rows(counts).tolist() == [
        place for group in groups for place in range(len(group))
    ]
    assert find_following_rows(counts).tolist() == [
        row for group in groups for row in group[1:] + group[:1]
    ]


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 4)), max_size=8))
def test_stretches_of_another_table(pairs: list[tuple[int, int]]) -> None:
    first, counts = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    assert list_range_numbers(first, counts).tolist() == [
        low + k for low, count in pairs for k in range(count)
    ]


@given(st.lists(st.integers(1, 4), max_size=8))
def test_runs_of_equal_neighbours(counts: list[int]) -> None:
    # Neighbours differ, but a number may come again.
    owner = np.repeat(np.arange(len(counts)) % 2, counts)
    assert measure_runs(owner).tolist() == counts
    assert find_run_starts(owner).tolist() == compute_first_rows(counts).tolist()
    lasts = [sum(counts[: k + 1]) - 1 for k in range(len(counts))]
    assert np.flatnonzero(mark_run_ends(owner)).tolist() == lasts


def test_rows_of_a_table_are_compared_whole() -> None:
    table = np.array([[0, 1], [0, 1], [0, 2], [1, 2], [1, 2]])
    assert mark_run_starts(table).tolist() == [True, False, True, True, False]
    assert mark_run_ends(table).tolist() == [False, True, True, False, True]


@given(st.lists(st.booleans(), max_size=12))
def test_true_runs(mask: list[bool]) -> None:
    runs = find_true_runs(np.array(mask, dtype=np.bool_)).tolist()
    rows = chain.from_iterable(range(*run) for run in runs)
    assert list(rows) == [row for row, value in enumerate(mask) if value]
    # A row that is not true lies between two runs.
    assert all(end < begin for (_, end), (begin, _) in pairwise(runs))


def test_the_first_of_two_equally_near_rows_is_taken() -> None:
    values = np.array([0.0, 2.0, 4.0])
    assert [find_nearest_row(values, wanted) for wanted in (1.0, 1.1, 9.0)] == [0, 1, 2]
    assert find_nearest_row(np.array([0j, 1 + 1j]), 1 + 0.4j) == 1


@given(st.lists(st.integers(-3, 3), max_size=8))
def test_each_once(values: list[int]) -> None:
    assert select_distinct(np.array(values, dtype=np.int64)).tolist() == sorted(set(values))


@given(st.lists(st.integers(-3, 3), max_size=40))
def test_first_of_each(values: list[int]) -> None:
    rows = find_first_occurrences(np.array(values, dtype=np.int64))
    assert rows.tolist() == [values.index(value) for value in sorted(set(values))]


@given(
    st.lists(st.integers(0, 5), max_size=12),
    st.lists(st.integers(0, 5), max_size=12),
    st.integers(0, 4),
)
def test_matches(label: list[int], other: list[int], limit: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ragged, "PAIRS", 4)
        tables = np.array(label, dtype=np.int64), np.array(other, dtype=np.int64)
        chunks, unpaired = find_equal_pairs(*tables, limit)
        listed = [np.column_stack(chunk).tolist() for chunk in chunks]
    assert all(len(chunk) <= 4 for chunk in listed)
    assert unpaired.tolist() == [k for k, name in enumerate(label) if other.count(name) > limit]
    pairs = [[k, m] for k, name in enumerate(label) for m, o in enumerate(other) if o == name]
    assert [*chain(*listed)] == [pair for pair in pairs if pair[0] not in unpaired.tolist()]


@given(
    st.lists(st.integers(1, 5000), max_size=4),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5000)), max_size=5),
)
def test_divided_runs_are_all_rows_and_settled_ones_hold_no_odd_row(
    counts: list[int], odd: list[tuple[int, int]]
) -> None:
    judged = 0

    def holds_no_odd_row(runs: Runs) -> BoolArray:
        nonlocal judged
        judged += len(runs.group)
        return np.array([not _holds(run, odd) for run in _list(runs)])

    runs = divide_runs(np.array(counts, dtype=np.int64), holds_no_odd_row)
    size = runs.end - runs.first
    assert np.repeat(runs.group, size).tolist() == list_owners(counts).tolist()
    assert list_range_numbers(runs.first, size).tolist() == number_rows(counts).tolist()
    for run, settled in zip(_list(runs), runs.settled, strict=True):
        assert not _holds(run, odd) if settled else run[2] - run[1] <= 64
    # 5000 rows are 64 or fewer after three divisions by eight.
    assert judged <= 8 * len(counts) + 2 * 8 * len(odd)


def _list(runs: Runs) -> list[tuple[int, int, int]]:
    """Group, first row and the row after the last one of each run."""
    return [*zip(runs.group.tolist(), runs.first.tolist(), runs.end.tolist(), strict=True)]


def _holds(run: tuple[int, int, int], rows: list[tuple[int, int]]) -> bool:
    group, first, end = run
    return any(owner == group and first <= row < end for owner, row in rows)
