"""State of a RAPID program between two statements."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import cast

from msgspec import Struct

from camgen.lang.log import Log
from camgen.lang.rapid.rows import Rows
from camgen.lang.rapid.tree import Run
from camgen.lang.rapid.types import Value
from camgen.model.pose import FloatArray, Pose, Vec3, rotation_from_quaternion
from camgen.model.program import Instruction, Joints, Packing, Posture

from .data import Scope, orient_fault, pose
from .expected import Expected, judge_load
from .syntax import Expr, Ref, Shape, Wrong


@dataclass(frozen=True, slots=True)
class PostSettings:
    """Options of the post that the text does not state.

    signals: logical name of a signal by its identifier in lower case.
    external: whether tool and work object are declared on the controller, not in the text.
    sign: +1 if a positive force presses along the positive tool axis, else -1.
    longest_name: maximum number of characters of a name.
    expected: options that the text must agree with.
    """

    signals: Mapping[str, str]
    external: bool
    sign: int
    longest_name: int
    expected: Expected


class Bound(Struct, frozen=True, eq=False):
    """A motion without its points.

    name: name of the instruction in lower case.
    speed: mm/s.
    blend: blend radius, mm.
    values: values of all arguments, by name.
    posture: configuration of the target, None if it is all zeros.
    turn: maximum speed of reorientation, rad/s.
    """

    name: str
    speed: float
    blend: float
    values: Mapping[str, Value]
    posture: Posture | None = None
    turn: float = 0.0


class Waiting(Struct, eq=False):
    """Statements that wait to be run: the rows `first` to before `last` of a file."""

    rows: Rows
    first: int
    last: int
    scope: Scope


@dataclass
class State:
    """The program that has been read so far, and the state after it.

    settings: options of the post.
    scope: data that the current routine sees.
    log: findings.
    body: N instructions.
    lines: (N,) line of each instruction.
    frames: name and frame of the tool and of the work object.
    frame_of: name and scope of the tool and the work object that were checked last.
    bound: motions without their points, by scope and shape.
    current_pose: last commanded pose, None if it is unknown.
    blending: line of the last motion if it blends, else 0.
    moved: whether the program has moved.
    pressing: tool axis, 0 to 2, and direction, +1 or -1, of the force that is on. None without one.
    count: number of statements that were run.
    supervised: state of ConfJ and ConfL, and the line that set it.
    postures: whether targets state a configuration, for ConfJ and ConfL.
    singularity: argument of SingArea, empty without one.
    acceleration: arguments of AccSet, empty without one.
    calibrated: whether the force sensor was calibrated after the last section with force.
    settled: whether the last statement was WaitTime with InPos, which waits for standstill.
    pressed: whether a section with force has started.
    free_targets: targets after the last section with force. The (N, 3) targets of a sequence of
        statements are an array, mm.
    waiting: statements that wait to be run.
    rotations: rotation matrices by quaternion.
    """

    settings: PostSettings
    scope: Scope
    log: Log
    body: Packing = field(default_factory=Packing)
    lines: array[int] = field(default_factory=partial(array, "q"))
    frames: dict[str, tuple[str, Pose | None]] = field(default_factory=dict)
    frame_of: dict[str, tuple[str, Scope]] = field(default_factory=dict)
    bound: dict[tuple[Scope, Shape], Bound] = field(default_factory=dict)
    current_pose: Pose | None = None
    blending: int = 0
    moved: bool = False
    pressing: tuple[int, int] | None = None
    count: int = 0
    supervised: dict[str, tuple[bool, int]] = field(default_factory=dict)
    postures: set[tuple[str, bool]] = field(default_factory=set)
    singularity: str = ""
    acceleration: tuple[float, ...] = ()
    calibrated: bool = False
    settled: bool = False
    pressed: bool = False
    free_targets: list[Pose | Joints | FloatArray] = field(default_factory=list)
    waiting: list[Waiting] = field(default_factory=list)
    rotations: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)

    def add(self, item: Instruction, line: int) -> None:
        """Adds an instruction."""
        self.body.append(item)
        self.lines.append(line)

    def wait(self, run: Run, scope: Scope) -> None:
        """Adds statements to those that wait. Adjacent sequences become one."""
        before = self.waiting[-1] if self.waiting else None
        is_same = before is not None and before.rows is run.rows and before.scope is scope
        if before is not None and is_same and before.last == run.first:
            before.last = run.last
        else:
            self.waiting.append(Waiting(run.rows, run.first, run.last, scope))

    def note_target(self, targets: Pose | Joints | FloatArray) -> None:
        """Adds targets to those after the last section with force, if there was one."""
        if self.pressed:
            self.free_targets.append(targets)

    def remark(self, line: int, what: str) -> None:
        """Adds an unusual finding once. Nothing is added if `what` is empty."""
        if what:
            self.log.find("unusual", what, line=line, once=what)

    def stopped(self, what: str) -> None:
        """Adds a finding if the last motion does not stop before `what`."""
        if self.blending:
            self.log.find("refused", f"a motion that blends before {what}", line=self.blending)
            self.blending = 0

    def frame(self, kind: str, expr: Expr | None, value: Value | None, line: int) -> None:
        """Sets the tool or the work object of a motion.

        Raises Wrong if the program has another one already.
        """
        name = expr.name if isinstance(expr, Ref) else ""
        if kind not in self.frames:
            read_frame = _tool if kind == "tool" else _work
            frame = None if value is None else read_frame(value, line)
            self.frames[kind] = (name.lower(), frame)
            if kind == "tool" and value is not None:
                self.remark(
                    line, judge_load(self.settings.expected, cast(tuple[Value, ...], value)[2])
                )
        elif self.frames[kind][0] != name.lower():
            raise Wrong(line, f"{name} is a second {'tool' if kind == 'tool' else 'work object'}")

    def pose(self, value: Value) -> Pose:
        """The pose of a robtarget. Equal orientations share a matrix."""
        trans, q, *_ = cast(tuple[Vec3, tuple[float, ...]], value)
        return Pose(self._rotation(q), trans)

    def turned(self, q: tuple[float, ...]) -> FloatArray | None:
        """The rotation matrix of a quaternion as written, None if it is not normalised."""
        rotation = self.rotations.get(q)
        if rotation is not None or orient_fault(q):
            return rotation
        return self._rotation(q)

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
