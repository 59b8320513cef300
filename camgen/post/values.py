"""The values that posts return."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from camgen.model.part import Note
from camgen.model.pose import Pose
from camgen.model.program import Joints, Motion


class OutputFile(Struct, frozen=True):
    """A file of a program.

    name: file name without a folder.
    text: content, LF line ends; the file gets those of `Post.newline`.
    """

    name: str
    text: str


class Tolerance(Struct, frozen=True):
    """The rounding of a text: half the last printed digit.

    The rounding of the angles of an orientation adds up.

    mm: error of a coordinate, mm.
    angle: error of an orientation, rad.
    joint: error of a joint value, rad or mm.
    speed: error of the speed of the TCP, mm/s.
    force: error of a force, N.
    seconds: error of a wait, s.
    turn: error of the speed at which the tool turns on the spot, rad/s.
    share: error of the share of the highest joint speeds, a fraction.
    rate: error of the speed of a joint, rad/s.
    """

    mm: float
    angle: float
    joint: float
    speed: float
    force: float
    seconds: float
    turn: float = 1e-5
    share: float = 0.0
    rate: float = 1e-5


def choose_words(words: Mapping[str, bool]) -> frozenset[str]:
    """The words that are true."""
    return frozenset(word for word, is_chosen in words.items() if is_chosen)


def choose_line(condition: object, line: str, other: str) -> tuple[str]:
    """One line of a program: `line` if the condition is true, else the other one."""
    if condition:
        return (line,)
    return (other,)


def end_of(motion: Motion | None) -> Pose | None:
    """The pose in which a motion ends; None for a motion to joint values, and for no motion."""
    if motion is None or isinstance(motion.target, Joints):
        return None
    return motion.target


def pose_of(motion: Motion) -> Pose:
    """The Cartesian target of a motion. Raises ValueError for a motion to joint values."""
    if isinstance(motion.target, Joints):
        raise ValueError("a motion to joints has no pose")
    return motion.target


def note_renamed(text: str, name: str, controller: str) -> tuple[Note, ...]:
    """The note that a program is not called as its input.

    text: name of the input.
    name: name of the program on the controller.
    controller: language of the controller.
    """
    return (
        Note(
            "assumed",
            f"the program is called {name}, not {text}",
            f"{text} is a word of {controller}, or a name that the controller has already",
        ),
    )
