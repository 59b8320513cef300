"""What can go wrong, as a tree of exceptions that keep their data.

    CamgenError            one line for the user, an exit code for scripts
    |- InputError     (2)  a file that cannot be used as it is
    |  `- AmbiguousInput   a file with two meanings: the user has to decide
    |- JobError       (2)  a setting or an option that makes no sense
    |- NoSafeProgram  (3)  nothing reachable, a collision, or --strict and something left out
    |  |- Refused          an instruction that the chosen controller cannot do
    |  `- Blocked          paths on which the arm is stuck or collides
    `- VerifyError    (4)  the text read back does not say what was planned

Whoever raises one names the place and the remedy; the command line prints ``str(error)`` on one line.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal, NamedTuple


class CamgenError(Exception):
    """Base of all errors that are addressed to the user. ``exit_code`` is what the process returns."""

    exit_code = 1

    def __init__(self, file: str, what: str, where: str = "", remedy: str = "") -> None:
        super().__init__(file, what, where, remedy)
        self.file = file
        self.what = what
        self.where = where
        self.remedy = remedy

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return one_line(f"{self.file}: {self.what}{place}{remedy}")


class InputError(CamgenError):
    """The input cannot be used: unreadable, empty of curves, out of the plane."""

    exit_code = 2


class AmbiguousInput(InputError):
    """The input has two meanings, between which only the user can decide."""


class JobError(CamgenError):
    """A job file, ``--set`` or option that cannot be meant."""

    exit_code = 2


class NoSafeProgram(CamgenError):
    """Nothing that could be handed to a machine remains."""

    exit_code = 3


class Refused(NoSafeProgram):
    """The controller has no such instruction. ``index`` is its place in the program's body."""

    def __init__(self, post: str, index: int, what: str, remedy: str = "") -> None:
        super().__init__(post, what, f"instruction {index}" if index >= 0 else "", remedy)
        self.index = index


class Loss(NamedTuple):
    """A path that cannot be run.

    path: its number in the program, -1 if it is on no path.
    why: the reason with its position.
    way: whether the link to it is blocked, or the one home; the path itself may be free.
    at_end: whether the end of that link is blocked, at which the path begins.
    """

    path: int
    kind: Literal["collision", "jump"]
    why: str
    way: bool = False
    at_end: bool = False


class Blocked(NoSafeProgram):
    """The arm cannot follow a program, or collides on it. ``lost`` says on which paths, the ways to them included."""

    def __init__(
        self, file: str, what: str, where: str = "", remedy: str = "", lost: tuple[Loss, ...] = ()
    ) -> None:
        super().__init__(file, what, where, remedy)
        self.lost = lost


class VerifyError(CamgenError):
    """The text does not say what was planned. ``line`` is 1-based in the text, 0 if unknown."""

    exit_code = 4

    def __init__(self, file: str, what: str, line: int = 0, remedy: str = "") -> None:
        super().__init__(file, what, f"line {line}" if line else "", remedy)
        self.line = line


def one_line(text: str) -> str:
    """``text`` without control characters: what a drawing or a path name holds must not break a message in two."""
    return "".join(c if c.isprintable() else " " for c in text)


@contextmanager
def rename_errors(inner: str, outer: str) -> Iterator[None]:
    """Errors about ``inner`` are told as errors about ``outer``, the name that the user knows."""
    try:
        yield
    except (InputError, JobError) as error:
        if error.file == inner:
            raise type(error)(outer, error.what, error.where, error.remedy) from error
        raise
