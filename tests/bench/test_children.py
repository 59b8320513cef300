"""A forked child gives its results as far as it comes, and says what ended it."""

import os
import signal
import time
from collections.abc import Iterator

from bench.support.children import Limits, run_in_child

LIMITS = Limits(memory=8 * 1024**3)


def give_two(number: int = 0) -> Iterator[int]:
    """Two results, then an end by a signal; 0: the usual end."""
    yield 1
    yield 2
    if number:
        os.kill(os.getpid(), number)


def test_all_results_are_received() -> None:
    child = run_in_child(give_two, LIMITS)
    assert child.results == [1, 2]
    assert child.signal == 0
    assert child.peak > 1


def test_a_signal_ends_the_results() -> None:
    child = run_in_child(lambda: give_two(signal.SIGKILL), LIMITS)
    assert child.results == [1, 2]
    assert child.signal == signal.SIGKILL


def test_an_error_ends_the_results_and_not_the_tests() -> None:
    child = run_in_child(lambda: (1 // (1 - k) for k in range(3)), LIMITS)
    assert child.results == [1]
    assert child.signal == 0


def test_a_child_that_gives_nothing_in_time_is_killed() -> None:
    def wait() -> Iterator[int]:
        yield 1
        time.sleep(1000)

    child = run_in_child(wait, LIMITS._replace(clock=0.2))
    assert child.results == [1]
    assert child.signal == signal.SIGXCPU


def test_the_processor_has_a_limit() -> None:
    def compute() -> Iterator[int]:
        while True:
            pass
        yield 1

    assert run_in_child(compute, LIMITS._replace(processor=1)).signal == signal.SIGXCPU


def test_memory_has_a_limit() -> None:
    child = run_in_child(lambda: [len(bytes(9 * 1024**3))], LIMITS)
    assert child.results == []
