"""The typed program between planning and posts: few instructions, checked once, with a text form (``ir_text``).

A program says what the machine does, never how a controller spells it. Planners are judged on the text form without any
post, posts on hand-written text without any planner.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from camgen.body import Columns
from camgen.instructions import Comment, Force, Instruction, Joints, Motion, MoveC, MoveJ, MoveL, Output, Posture, Wait
from camgen.ir_rules import check, check_frame
from camgen.pose import Pose

__all__ = [
    "Comment", "Force", "Instruction", "Joints", "Motion", "MoveC", "MoveJ", "MoveL", "Output", "Posture", "Program",
    "Wait", "motions",
]  # fmt: skip


class Program(Struct, frozen=True, eq=False, dict=True):
    """A whole program in one work frame.

    base_from_work and flange_from_tool: the frames that the poses are in. header: remarks for its top, in order.
    Construction raises Refused unless the first motion is joint-interpolated, every number is finite, every speed
    positive, and no motion before an output, a wait, a force change or the end blends.
    """

    name: str
    base_from_work: Pose
    flange_from_tool: Pose
    body: tuple[Instruction, ...]
    header: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for frame in (self.base_from_work, self.flange_from_tool):
            check_frame(frame)
        check(self.columns)

    @cached_property
    def columns(self) -> Columns:
        """The body by column."""
        return Columns(self.body)

    def with_body(self, body: tuple[Instruction, ...]) -> Program:
        """The same program with another body."""
        return replace(self, body=body)


def motions(body: tuple[Instruction, ...]) -> Iterator[tuple[int, Motion]]:
    """The motions of a body with their index in it."""
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            yield index, item
