"""Ragged arrays have the values of lists of lists."""

from itertools import accumulate, chain, pairwise, product

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
def test_rows_of_groups_are_those_of_lists(counts: list[int]) -> None:
    ends = list(accumulate(counts, initial=0))
    assert compute_first_rows(counts).tolist() == ends[:-1]
    assert compute_offsets(counts).tolist() == ends
    assert list_owners(counts).tolist() == [*chain(*([k] * n for k, n in enumerate(counts)))]
    assert number_rows(counts).tolist() == [*chain(*(range(count) for count in counts))]
    groups = [list(range(first, end)) for first, end in pairwise(ends)]
    following = [group[1:] + group[:1] for group in groups]
    assert find_following_rows(counts).tolist() == [*chain(*following)]


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 4)), max_size=8))
def test_numbers_of_ranges_are_those_of_python(pairs: list[tuple[int, int]]) -> None:
    first, counts = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    numbers = chain(*(range(low, low + count) for low, count in pairs))
    assert list_range_numbers(first, counts).tolist() == list(numbers)


@given(st.lists(st.integers(1, 4), max_size=8))
def test_runs_of_equal_neighbours_are_found(counts: list[int]) -> None:
    # The numbers of neighbouring runs differ, and each number occurs again in a later run.
    owner = np.repeat(np.arange(len(counts)) % 2, counts)
    assert measure_runs(owner).tolist() == counts
    assert find_run_starts(owner).tolist() == compute_first_rows(counts).tolist()
    lasts = [sum(counts[: k + 1]) - 1 for k in range(len(counts))]
    assert np.flatnonzero(mark_run_ends(owner)).tolist() == lasts


def test_runs_of_a_table_have_the_same_whole_rows() -> None:
    table = np.array([[0, 1], [0, 1], [0, 2], [1, 2], [1, 2]])
    assert mark_run_starts(table).tolist() == [True, False, True, True, False]
    assert mark_run_ends(table).tolist() == [False, True, True, False, True]


@given(st.lists(st.booleans(), max_size=12))
def test_runs_of_true_rows_are_found(mask: list[bool]) -> None:
    runs = find_true_runs(np.array(mask, dtype=np.bool_)).tolist()
    rows = chain.from_iterable(range(*run) for run in runs)
    assert list(rows) == [row for row, value in enumerate(mask) if value]
    # A row that is not true lies between two runs.
    assert all(end < begin for (_, end), (begin, _) in pairwise(runs))


def test_the_first_of_two_equally_near_rows_is_found() -> None:
    values = np.array([0.0, 2.0, 4.0])
    assert [find_nearest_row(values, wanted) for wanted in (1.0, 1.1, 9.0)] == [0, 1, 2]
    assert find_nearest_row(np.array([0j, 1 + 1j]), 1 + 0.4j) == 1


@given(st.lists(st.integers(-3, 3), max_size=8))
def test_distinct_values_are_sorted_and_occur_once(values: list[int]) -> None:
    assert select_distinct(np.array(values, dtype=np.int64)).tolist() == sorted(set(values))


@given(st.lists(st.integers(-3, 3), max_size=40))
def test_the_first_row_of_each_value_is_found(values: list[int]) -> None:
    rows = find_first_occurrences(np.array(values, dtype=np.int64))
    assert rows.tolist() == [values.index(value) for value in sorted(set(values))]


@given(
    st.lists(st.integers(0, 5), max_size=12),
    st.lists(st.integers(0, 5), max_size=12),
    st.integers(0, 4),
)
def test_equal_pairs_are_listed_in_chunks_up_to_a_limit_for_each_row(
    label: list[int], other: list[int], limit: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ragged, "PAIRS", 4)
        tables = np.array(label, dtype=np.int64), np.array(other, dtype=np.int64)
        chunks, unpaired = find_equal_pairs(*tables, limit)
        listed = [np.column_stack(chunk).tolist() for chunk in chunks]
    assert all(len(chunk) <= 4 for chunk in listed)
    assert unpaired.tolist() == [k for k, name in enumerate(label) if other.count(name) > limit]
    rows = product(range(len(label)), range(len(other)))
    pairs = [[k, m] for k, m in rows if label[k] == other[m]]
    assert [*chain(*listed)] == [pair for pair in pairs if pair[0] not in unpaired.tolist()]


@given(
    st.lists(st.integers(1, 5000), max_size=4),
    st.lists(st.tuples(st.integers(0, 3), st.integers(0, 5000)), max_size=5),
)
def test_divided_runs_cover_all_rows_and_settled_runs_have_no_odd_row(
    counts: list[int], odd: list[tuple[int, int]]
) -> None:
    tested = 0

    def holds_no_odd_row(runs: Runs) -> BoolArray:
        nonlocal tested
        tested += len(runs.group)
        return np.array([not _contains(run, odd) for run in _list_runs(runs)])

    runs = divide_runs(np.array(counts, dtype=np.int64), holds_no_odd_row)
    size = runs.end - runs.first
    assert np.repeat(runs.group, size).tolist() == list_owners(counts).tolist()
    assert list_range_numbers(runs.first, size).tolist() == number_rows(counts).tolist()
    for run, settled in zip(_list_runs(runs), runs.settled, strict=True):
        assert not _contains(run, odd) if settled else run[2] - run[1] <= 64
    # Three divisions by eight leave at most 64 of 5000 rows.
    assert tested <= 8 * len(counts) + 2 * 8 * len(odd)


def _list_runs(runs: Runs) -> list[tuple[int, int, int]]:
    """Group, first row and the row after the last one of each run."""
    return [*zip(runs.group.tolist(), runs.first.tolist(), runs.end.tolist(), strict=True)]


def _contains(run: tuple[int, int, int], rows: list[tuple[int, int]]) -> bool:
    group, first, end = run
    return any(owner == group and first <= row < end for owner, row in rows)
