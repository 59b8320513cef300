"""The end of a run: limits of steps, and loops that repeat themselves."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import count, repeat

import pytest

from camgen.lang.run import Budget, LoopRounds, Stopped


def test_a_budget_is_the_length_of_the_text_and_the_limit() -> None:
    budget = Budget(7, 1000.0, "rapid_steps")
    for _ in range(7 + 900):
        budget.spend()
    budget.spend(100)
    with pytest.raises(
        Stopped, match=r"^the program has not ended after 1,000 steps .*rapid_steps"
    ):
        budget.spend()


def find_repetition(states: Iterator[object]) -> int:
    """The number of rounds after which a loop with these states is found to repeat itself."""
    rounds = LoopRounds()
    for number in range(1, 5000):
        state = next(states)
        if rounds.is_repeated(partial(next, repeat(state)), length=10 * number):
            return number
    return 0


@pytest.mark.parametrize("period", [1, 2, 4, 8, 64])
@pytest.mark.parametrize("before", [0, 3, 100])
def test_a_loop_whose_period_is_a_power_of_two_is_found(before: int, period: int) -> None:
    states = (k if k < before else before + k % period for k in count())
    number = find_repetition(states)
    assert 0 < number <= 4 * max(before, period) + 8


def test_a_loop_with_new_states_does_not_repeat_itself() -> None:
    assert not find_repetition(iter(range(5000)))
    assert not find_repetition(None for _ in range(5000))


def test_few_states_of_a_long_loop_are_read() -> None:
    rounds, reads = LoopRounds(), 0

    def read() -> int:
        nonlocal reads
        reads += 1
        return reads

    for _ in range(100_000):
        assert not rounds.is_repeated(read)
    assert reads < 50


def test_the_kept_length_is_that_before_the_repetition() -> None:
    rounds = LoopRounds()
    states, lengths = ["a", "b", "b"], [5, 9, 9]
    pairs = zip(states, lengths, strict=True)
    assert [rounds.is_repeated(partial(str, state), length) for state, length in pairs] == [
        False,
        False,
        True,
    ]
    assert rounds.length == 9
