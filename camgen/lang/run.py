"""The end of a run: the end of the program, a limit of steps, a loop that repeats itself."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from camgen.model.limits import format_limit

#: The states after this many rounds of a loop are all compared, later ones at powers of two.
_FIRST_ROUNDS = 8


class Ended(Exception):
    """The program has ended as its text says."""


class Stopped(Exception):
    """The run cannot continue. The text of the exception is the reason."""


class LimitReached(Stopped):
    """The run has reached a limit, such as that of its steps."""


class Budget:
    """The steps that a run may take.

    A program may take as many steps as its text has statements, and the steps of its limit more.

    left: number of steps that may still be taken.
    spent: number of steps that were taken.
    limit: number of steps in loops and calls.
    key: name of the limit in the job, such as "rapid_steps".
    """

    def __init__(self, statements: int, limit: float, key: str) -> None:
        self.left = statements + int(limit)
        self.spent = 0
        self.limit = limit
        self.key = key

    def spend(self, steps: int = 1) -> None:
        """Take steps. LimitReached if the budget has too few of them."""
        self.left -= steps
        self.spent += steps
        if self.left < 0:
            steps_text = f"{format_limit(self.limit)} steps in loops and calls (limits.{self.key})"
            raise LimitReached(f"the program has not ended after {steps_text}")


class LoopRounds(Struct):
    """The rounds of one loop, to find out that it has no end.

    A loop repeats itself if the run is in the same state after two rounds. After the first rounds
    the state is read at each power of two and in the round after it. So a loop with a period of 1,
    2, 4 ... rounds is found, and a long loop costs little (R. P. Brent, An improved Monte Carlo
    factorization algorithm, 1980).

    count: number of rounds so far.
    length: number of instructions of the run when the state was kept that the last one repeats.
    first_length: number of instructions of the run after the first round.
    """

    count: int = 0
    length: int = 0
    first_length: int = 0
    _kept: object = None

    def is_repeated(self, read_state: Callable[[], object], length: int = 0) -> bool:
        """Count a round and return whether the state after it has been there before.

        read_state: function that returns what the next round depends on, comparable by ``==``. None
            for a state that is too large to keep.
        length: number of instructions of the run so far.
        """
        self.count += 1
        if self.count == 1:
            self.first_length = length
        is_first = self.count <= _FIRST_ROUNDS
        is_power = self.count & (self.count - 1) == 0
        if not is_first and not is_power and (self.count - 1) & (self.count - 2):
            return False
        state = read_state()
        if state is not None and state == self._kept:
            return True
        if is_first or is_power:
            self._kept, self.length = state, length
        return False
