"""Errors for the user, as a tree of exceptions that keep their data.

    CamgenError            one line for the user, an exit code for scripts
    |- InputError     (2)  a file that cannot be used as it is
    |  `- AmbiguousInput   a file with two meanings: the user has to decide
    |- JobError       (2)  a setting or an option that makes no sense
    |- NoSafeProgram  (3)  nothing reachable, a collision, or --strict and something left out
    |  |- Refused          an instruction that the chosen controller cannot do
    |  `- Blocked          paths on which the arm is stuck or collides
    `- VerifyError    (4)  the printed text deviates from the plan

An error names the place and the remedy. The command line prints `str(error)` on one line.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal, NamedTuple


class CamgenError(Exception):
    """Base of all errors that are addressed to the user.

    exit_code: exit code of the process.
    file: file, option or post that the error is about.
    what: the fault.
    where: place in the file; "" if it is unknown.
    remedy: instruction that removes the fault; "" without one.
    """

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
        return make_one_line(f"{self.file}: {self.what}{place}{remedy}")


class InputError(CamgenError):
    """The input cannot be used: unreadable, empty of curves, out of the plane."""

    exit_code = 2


class AmbiguousInput(InputError):
    """The input has two meanings, between which only the user can decide."""


class JobError(CamgenError):
    """A job file, `--set` or option has a value that makes no sense."""

    exit_code = 2


class NoSafeProgram(CamgenError):
    """No program remains that a machine could run safely."""

    exit_code = 3


class Refused(NoSafeProgram):
    """The controller cannot do an instruction.

    index: index of the instruction in the body of the program, -1 if it is unknown.
    """

    def __init__(self, post: str, index: int, what: str, remedy: str = "") -> None:
        super().__init__(post, what, f"instruction {index}" if index >= 0 else "", remedy)
        self.index = index


class BlockedPath(NamedTuple):
    """A path that cannot be run.

    path: index of the path in the program, -1 for a motion on no path.
    why: the reason, with its position.
    on_link: whether the link to it is blocked, or the one home; the path itself may be free.
    at_end: whether the end of that link is blocked, at which the path begins.
    """

    path: int
    kind: Literal["collision", "jump"]
    why: str
    on_link: bool = False
    at_end: bool = False


class Blocked(NoSafeProgram):
    """The arm cannot follow a program, or collides on it.

    lost: the paths that cannot be run, those with a blocked link included.
    """

    def __init__(
        self,
        file: str,
        what: str,
        where: str = "",
        remedy: str = "",
        lost: tuple[BlockedPath, ...] = (),
    ) -> None:
        super().__init__(file, what, where, remedy)
        self.lost = lost


class VerifyError(CamgenError):
    """The printed text deviates from the plan.

    line: line of the text, from 1; 0 if it is unknown.
    """

    exit_code = 4

    def __init__(self, file: str, what: str, line: int = 0, remedy: str = "") -> None:
        super().__init__(file, what, f"line {line}" if line else "", remedy)
        self.line = line


def make_one_line(text: str) -> str:
    """`text` with spaces for control characters, so that a name does not break a message in two."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " for c in text)


@contextmanager
def rename_errors(inner: str, outer: str) -> Iterator[None]:
    """In the body, errors about the file `inner` become errors about `outer`, known to the user."""
    try:
        yield
    except (InputError, JobError) as error:
        if error.file == inner:
            raise type(error)(outer, error.what, error.where, error.remedy) from error
        raise
