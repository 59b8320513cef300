"""Ragged arrays, judged by lists of lists."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry import ragged
from camgen.geometry.ragged import (
    begins,
    each_once,
    first_of_each,
    following,
    matches,
    offsets,
    owners,
    ramp,
    run_lengths,
    stretches,
)

COUNTS = st.lists(st.integers(0, 4), max_size=8)


@given(COUNTS)
def test_rows_of_groups(counts: list[int]) -> None:
    groups = [list(range(sum(counts[:k]), sum(counts[: k + 1]))) for k in range(len(counts))]
    assert begins(counts).tolist() == [sum(counts[:k]) for k in range(len(counts))]
    assert offsets(counts).tolist() == [sum(counts[:k]) for k in range(len(counts) + 1)]
    assert owners(counts).tolist() == [k for k, group in enumerate(groups) for _ in group]
    assert ramp(counts).tolist() == [place for group in groups for place in range(len(group))]
    assert following(counts).tolist() == [row for group in groups for row in group[1:] + group[:1]]


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 4)), max_size=8))
def test_stretches_of_another_table(pairs: list[tuple[int, int]]) -> None:
    first, counts = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    assert stretches(first, counts).tolist() == [
        low + k for low, count in pairs for k in range(count)
    ]


@given(st.lists(st.integers(1, 4), max_size=8))
def test_runs_of_equal_neighbours(counts: list[int]) -> None:
    # Neighbours differ, but a number may come again.
    owner = np.repeat(np.arange(len(counts)) % 2, counts)
    assert run_lengths(owner).tolist() == counts


@given(st.lists(st.integers(-3, 3), max_size=8))
def test_each_once(values: list[int]) -> None:
    assert each_once(np.array(values, dtype=np.int64)).tolist() == sorted(set(values))


@given(st.lists(st.integers(-3, 3), max_size=40))
def test_first_of_each(values: list[int]) -> None:
    found = first_of_each(np.array(values, dtype=np.int64))
    assert found.tolist() == [values.index(one) for one in sorted(set(values))]


@given(
    st.lists(st.integers(0, 5), max_size=12),
    st.lists(st.integers(0, 5), max_size=12),
    st.integers(0, 4),
)
def test_matches(label: list[int], other: list[int], most: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ragged, "PAIRS", 4)
        few, many = matches(np.array(label, dtype=np.int64), np.array(other, dtype=np.int64), most)
        chunks = [*few]
    assert all(len(one) == len(two) <= 4 for one, two in chunks)
    found = [(k, m) for one, two in chunks for k, m in zip(one.tolist(), two.tolist(), strict=True)]
    assert many.tolist() == [k for k, name in enumerate(label) if other.count(name) > most]
    pairs = [(k, m) for k, name in enumerate(label) for m, o in enumerate(other) if o == name]
    assert found == [(k, m) for k, m in pairs if k not in many.tolist()]
