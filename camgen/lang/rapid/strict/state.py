"""What a RAPID program has done up to a statement: the state in which its statements are read."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import cast

from msgspec import Struct

from camgen.lang.log import Log
from camgen.lang.rapid.types import Value
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_from_quaternion
from camgen.model.program import Instruction, Joints, Packing, Posture

from .asked import Asked, judge_load
from .data import Scope, orient_fault, pose
from .rows import Rows, Run
from .syntax import Expr, Ref, Shape, Wrong


@dataclass(frozen=True, slots=True)
class Known:
    """What the text does not say and the post's options do.

    signals: logical name by identifier in lower case. external: tool and work object are not declared in the text.
    sign: +1 when a positive force presses along the positive tool axis. asked: what the text should say.
    """

    signals: Mapping[str, str]
    external: bool
    sign: int
    longest_name: int
    asked: Asked


class Bound(Struct, frozen=True, eq=False):
    """What a motion says beside its points: its name in lower case, mm/s, mm, all its arguments by name, the
    configuration of its target, none where that is all zero, and rad/s that the tool turns.
    """

    name: str
    speed: float
    blend: float
    values: Mapping[str, Value]
    posture: Posture | None = None
    turn: float = 0.0


class Waiting(Struct, eq=False):
    """Statements that are to be done, the rows ``first`` to before ``last`` of a file, and what they see."""

    rows: Rows
    first: int
    last: int
    scope: Scope


@dataclass
class State:
    """What has been read so far. scope: what the current routine sees."""

    known: Known
    scope: Scope
    log: Log
    body: Packing = field(default_factory=Packing)
    lines: array[int] = field(default_factory=partial(array, "q"))
    frames: dict[str, tuple[str, Pose | None]] = field(
        default_factory=dict
    )  # tool and work: name, frame
    frame_of: dict[str, tuple[str, Scope]] = field(
        default_factory=dict
    )  # tool and work: what was checked last
    bound: dict[tuple[Scope, Shape], Bound] = field(
        default_factory=dict
    )  # of motions that could be read
    here: Pose | None = None
    blending: int = 0  # line of the last motion, if it blends
    moved: bool = False
    pressing: tuple[int, int] | None = None  # tool axis 0..2 and direction +-1
    count: int = 0
    supervised: dict[str, tuple[bool, int]] = field(
        default_factory=dict
    )  # ConfJ and ConfL: on, and the line
    postures: set[tuple[str, bool]] = field(
        default_factory=set
    )  # of ConfJ and ConfL: whether targets state one
    singularity: str = ""
    acceleration: tuple[float, ...] = ()
    calibrated: bool = False  # since the last section with force
    settled: bool = (
        False  # WaitTime\\InPos has waited for standstill, and nothing has been done since
    )
    pressed: bool = False  # a section with force has begun
    # Targets since the last section with force; those of a run of statements are an array.
    way: list[Pose | Joints | FloatArray] = field(default_factory=list)
    waiting: list[Waiting] = field(default_factory=list)
    rotations: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)

    def add(self, item: Instruction, line: int) -> None:
        """One more instruction of the program."""
        self.body.append(item)
        self.lines.append(line)

    def wait(self, run: Run, scope: Scope) -> None:
        """Statements that are to be done, with those before them where they go on."""
        before = self.waiting[-1] if self.waiting else None
        if (
            before is not None
            and before.last == run.first
            and before.rows is run.rows
            and before.scope is scope
        ):
            before.last = run.last
        else:
            self.waiting.append(Waiting(run.rows, run.first, run.last, scope))

    def note_way(self, targets: Pose | Joints | FloatArray) -> None:
        """Remembers where the tool has been since a section with force, if there was one."""
        if self.pressed:
            self.way.append(targets)

    def remark(self, line: int, what: str) -> None:
        """Notes once what a controller takes and a program of ours does not say."""
        if what:
            self.log.find("unusual", what, line=line, once=what)

    def stopped(self, what: str) -> None:
        """Notes it when the last motion does not stop before ``what``."""
        if self.blending:
            self.log.find("refused", f"a motion that blends before {what}", line=self.blending)
            self.blending = 0

    def frame(self, kind: str, expr: Expr | None, value: Value | None, line: int) -> None:
        """Notes the tool or the work object of a motion; there may be one of each in a program."""
        name = expr.name if isinstance(expr, Ref) else ""
        if kind not in self.frames:
            frame = None if value is None else (_tool if kind == "tool" else _work)(value, line)
            self.frames[kind] = (name.lower(), frame)
            if kind == "tool" and value is not None:
                self.remark(line, judge_load(self.known.asked, cast(tuple[Value, ...], value)[2]))
        elif self.frames[kind][0] != name.lower():
            raise Wrong(line, f"{name} is a second {'tool' if kind == 'tool' else 'work object'}")

    def pose(self, value: Value) -> Pose:
        """The pose of a robtarget; equal orientations share one matrix."""
        trans, q, *_ = cast(tuple[Vec3, tuple[float, ...]], value)
        return Pose(self._rotation(q), trans)

    def turned(self, q: tuple[float, ...]) -> FloatArray | None:
        """The rotation of a quaternion as written, unless it is not normalised."""
        found = self.rotations.get(q)
        return found if found is not None or orient_fault(q) else self._rotation(q)

    def _rotation(self, q: tuple[float, ...]) -> FloatArray:
        if q not in self.rotations:
            self.rotations[q] = rotation_from_quaternion(q)
        return self.rotations[q]


def _tool(value: Value, line: int) -> Pose:
    held, frame, load = cast(tuple[Value, ...], value)
    if not held:
        raise Wrong(line, "a tool that the robot does not hold is not read")
    if cast(tuple[float, ...], load)[0] <= 0:
        raise Wrong(line, "the mass of a tool must be positive")
    return pose(frame)


def _work(value: Value, line: int) -> Pose:
    held, fixed, unit, user, part = cast(tuple[Value, ...], value)
    if held or not fixed or unit:
        raise Wrong(line, "a work object that is held or moved is not read")
    return pose(user) @ pose(part)
