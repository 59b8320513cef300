"""The values that posts and read-backs return."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from msgspec import Struct

from camgen.model.pose import Pose
from camgen.model.program import Instruction, Joints, Motion


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
    """

    mm: float
    angle: float
    joint: float
    speed: float
    force: float
    seconds: float
    turn: float = 1e-5
    share: float = 0.0


class Fault(Struct, frozen=True):
    """A place of a program text that is wrong or that the read-back does not know.

    line: 1-based.
    what: the fault, for a message.
    """

    line: int
    what: str


class Remark(Fault, frozen=True):
    """A statement that a controller takes although the text leaves its meaning open.

    It is harmless in a foreign program and a fault in a program of camgen.
    """


class Reading(Struct, frozen=True, eq=False):
    """The meaning of a program text.

    body: the instructions without comments; poses in the work frame.
    lines: 1-based line of each instruction, counted through all files in order.
    faults: faults and remarks, in order of line.
    work: base_from_work that the text defines; None if it relies on the controller's.
    tool: flange_from_tool that the text defines; None if it relies on the controller's.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    faults: tuple[Fault, ...]
    work: Pose | None = None
    tool: Pose | None = None


#: A read-back: (files by name in the order written, options as given in `[post]`) -> their meaning.
Readback = Callable[[Mapping[str, str], Mapping[str, object]], Reading]


def pose_of(motion: Motion) -> Pose:
    """The Cartesian target of a motion. Raises ValueError for a motion to joint values."""
    if isinstance(motion.target, Joints):
        raise ValueError("a motion to joints has no pose")
    return motion.target
