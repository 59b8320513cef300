"""Many searches halved at once find what each finds alone, in as many questions as the longest needs."""

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.halving import find_first


@given(st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40)), max_size=6))
def test_the_first_that_holds_is_found(searches: list[tuple[int, int]]) -> None:
    asked: list[int] = []

    def hold(at: Mapping[int, int]) -> list[bool]:
        asked.append(len(at))
        assert all(place < searches[key][0] for key, place in at.items())
        return [place >= searches[key][1] for key, place in at.items()]

    found = find_first({key: count for key, (count, _) in enumerate(searches)}, hold)
    assert found == {key: first for key, (count, first) in enumerate(searches) if first < count}
    longest = max((count for count, _ in searches), default=0)
    assert len(asked) <= longest.bit_length()
