"""Counts the calls of a run.

Linear work is separated from quadratic by its calls, on every machine and however busy it is.
"""

import cProfile
from collections.abc import Callable

#: Calls of each line of a text may grow by this factor when the text becomes twice as long.
#: Where every line is compared with all others, they grow by a factor of two.
SLACK = 1.25

#: Most calls of one statement of a controller language. Statements that join texts take 56.
CALLS_OF_A_STEP = 100


def count_calls(run: Callable[[], object]) -> int:
    """Calls of Python and C functions in `run`. Work within a function of C counts once."""
    profile = cProfile.Profile()
    profile.runcall(run)
    return sum(entry.callcount for entry in profile.getstats())


def assert_linear(run: Callable[[int], object], size: int) -> None:
    """`run(size)` must take at most `SLACK` times twice the calls of `run(size // 2)`.

    A first run at a quarter is not counted: it imports modules, and fills caches with half of
    the lines of either run.
    """
    half = size // 2
    run(half // 2)
    small, large = count_calls(lambda: run(half)), count_calls(lambda: run(size))
    allowed = SLACK * small * size / half
    assert large <= allowed, f"{small} calls at {half}, {large} at {size}: not linear"
