"""Bisections of many ranges at once take as many calls as that of the longest range."""

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.halving import find_first


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), max_size=6))
def test_the_first_index_that_passes_is_found(searches: list[tuple[int, int]]) -> None:
    calls = 0

    def passes(indices: Mapping[int, int]) -> list[bool]:
        nonlocal calls
        calls += 1
        assert all(index < searches[key][0] for key, index in indices.items())
        return [index >= searches[key][1] for key, index in indices.items()]

    firsts = find_first({key: count for key, (count, _) in enumerate(searches)}, passes)
    assert firsts == {key: first for key, (count, first) in enumerate(searches) if first < count}
    longest = max((count for count, _ in searches), default=0)
    assert calls <= longest.bit_length()
