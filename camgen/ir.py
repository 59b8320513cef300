"""The typed program between planning and posts: few instructions, checked once, with a text form.

A program says what the machine does, never how a controller spells it: a signal is a name, a posture is a joint
solution, an arc is two poses. Planners are judged on the text form without any post, posts on hand-written text
without any planner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from msgspec import Struct, field
from msgspec.structs import replace

from camgen.errors import Refused
from camgen.pose import Pose, quaternion, rotation_from_quaternion
from camgen.text import harmless, short

#: Digits of the text form: 1e-6 mm, and quaternions to 1e-9.
_DIGITS, _ANGLE_DIGITS = 6, 9


class Joints(Struct, frozen=True, gc=False):
    """Controller joint values: rad for revolute, mm for sliding joints, axis 1 first."""

    values: tuple[float, ...]


class MoveJ(Struct, frozen=True, eq=False, gc=False):
    """Joint-interpolated motion to joints or to a pose of the TCP in the work frame. speed: TCP limit, mm/s."""

    target: Pose | Joints
    speed: float
    blend: float = 0.0
    joints: Joints | None = None


class MoveL(Struct, frozen=True, eq=False, gc=False):
    """Straight line of the TCP. target: work_from_tcp. blend: radius in mm within which the corner may be rounded, 0
    = exact stop. force: N to press with during this motion, while a ``Force`` is on. press: its direction at the
    target, unit vector in the work frame from the tool towards the surface.
    """

    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    press: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None


class MoveC(Struct, frozen=True, eq=False, gc=False):
    """Arc of the TCP from where it is through ``via`` (half-way) to ``target``, at most half a circle."""

    via: Pose
    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    press: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None


class Output(Struct, frozen=True, gc=False):
    """Sets a named signal. value: 0 off, 1 on; for ``spindle`` its speed in rpm."""

    signal: str
    value: float


class Wait(Struct, frozen=True, gc=False):
    """Stands still for so many seconds."""

    seconds: float


class Force(Struct, frozen=True, gc=False):
    """Force control on, pressing with ``newtons`` along ``press`` (unit, work frame) from the next motion on; 0 N: off,
    and the next motion leaves the surface.
    """

    newtons: float
    press: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Comment(Struct, frozen=True, gc=False):
    """A remark for whoever reads the program; posts clean it."""

    text: str


Motion = MoveJ | MoveL | MoveC
Instruction = MoveJ | MoveL | MoveC | Output | Wait | Force | Comment


class Program(Struct, frozen=True, eq=False, gc=False):
    """A whole program in one work frame.

    base_from_work and flange_from_tool: the frames that the poses are in. header: remarks for its top, in order.
    Construction raises Refused unless the first motion is joint-interpolated, every number is finite, every speed
    positive, and no motion before an output, a wait, a force change or the end blends.
    """

    name: str
    base_from_work: Pose
    flange_from_tool: Pose
    body: tuple[Instruction, ...]
    header: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        for frame in (self.base_from_work, self.flange_from_tool):
            _check_finite(-1, *frame.origin, *frame.rotation.ravel().tolist())
        check(self.body)

    def with_body(self, body: tuple[Instruction, ...]) -> Program:
        """The same program with another body."""
        return replace(self, body=body)


def motions(body: tuple[Instruction, ...]) -> Iterator[tuple[int, Motion]]:
    """The motions of a body with their index in it."""
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            yield index, item


def check(body: tuple[Instruction, ...]) -> None:
    """Raises Refused for the first instruction that breaks a rule of ``Program``."""
    blending = -1
    pressing = moved = False
    rotations: set[int] = set()
    for index, item in enumerate(body):
        if isinstance(item, (MoveL, MoveC, MoveJ)):
            if not moved and not isinstance(item, MoveJ):
                raise Refused("program", index, "the first motion must be joint-interpolated")
            moved = True
            _check_motion(index, item, pressing, rotations)
            blending = index if item.blend > 0 else -1
        elif not isinstance(item, Comment):
            if blending >= 0:
                raise Refused("program", blending, "a motion before an output, a wait or a force change must not blend")
            if isinstance(item, Force):
                pressing = item.newtons > 0
                _check_finite(index, item.newtons, *item.press)
            else:
                _check_finite(index, item.value if isinstance(item, Output) else item.seconds)
                if isinstance(item, Wait) and item.seconds < 0:
                    raise Refused("program", index, "a wait must not be negative")
    if blending >= 0:
        raise Refused("program", blending, "the last motion must not blend")
    if pressing:
        raise Refused("program", len(body) - 1, "force control must be off at the end")


def _check_motion(index: int, item: Motion, pressing: bool, rotations: set[int]) -> None:
    """``rotations``: the ids of those that were looked at, since a program shares them."""
    numbers = [item.speed, item.blend]
    if item.joints is not None:
        numbers += item.joints.values
    for target in (item.via, item.target) if isinstance(item, MoveC) else (item.target,):
        if isinstance(target, Joints):
            numbers += target.values
            continue
        numbers += target.origin
        if id(target.rotation) not in rotations:
            rotations.add(id(target.rotation))
            numbers += target.rotation.ravel().tolist()
    if not isinstance(item, MoveJ):
        numbers += (item.force, *item.press)
        if item.force > 0 and not pressing:
            raise Refused("program", index, "a motion presses while force control is off")
    _check_finite(index, *numbers)
    if item.speed <= 0 or item.blend < 0:
        raise Refused("program", index, "a speed must be positive and a blend not negative")


def _check_finite(index: int, *values: float) -> None:
    if not math.isfinite(sum(values)):  # nothing cancels an infinity or what is no number
        raise Refused("program", index, "a number is not finite")


# The text form: one instruction a line, words and numbers, `camgen-ir 1` first.


def dump(program: Program) -> str:
    """The program as text, exact to 1e-6 mm. ``parse`` is its inverse."""
    lines = ["camgen-ir 1", f"name {harmless(program.name)}"]
    lines.append("work " + _pose_text(program.base_from_work))
    lines.append("tool " + _pose_text(program.flange_from_tool))
    lines += [f"# {harmless(line, 200)}" for line in program.header]
    lines.append("body")
    rotations: dict[bytes, str] = {}
    lines += [_line(item, rotations) for item in program.body]
    return "\n".join(lines) + "\n"


def _line(item: Instruction, rotations: dict[bytes, str]) -> str:
    match item:
        case MoveJ():
            if isinstance(item.target, Joints):
                return "movej joints " + _numbers(item.target.values, _ANGLE_DIGITS) + _tail(item)
            return "movej " + _pose_text(item.target, rotations) + _tail(item)
        case MoveL():
            return "movel " + _pose_text(item.target, rotations) + _tail(item)
        case MoveC():
            via = _pose_text(item.via, rotations)
            return f"movec {via} to {_pose_text(item.target, rotations)}" + _tail(item)
        case Output():
            return f"output {harmless(item.signal)} {short(item.value, _DIGITS)}"
        case Wait():
            return f"wait {short(item.seconds, _DIGITS)}"
        case Force():
            return f"force {short(item.newtons, _DIGITS)} press {_numbers(item.press, _ANGLE_DIGITS)}"
        case Comment():
            return f"# {harmless(item.text, 200)}"


def _numbers(values: tuple[float, ...], digits: int) -> str:
    return " ".join(short(v, digits) for v in values)


def _pose_text(pose: Pose, rotations: dict[bytes, str] | None = None) -> str:
    cache = {} if rotations is None else rotations
    key = pose.rotation.tobytes()
    if key not in cache:
        cache[key] = _numbers(quaternion(pose.rotation), _ANGLE_DIGITS)
    return f"{_numbers(pose.origin, _DIGITS)} q {cache[key]}"


def _tail(item: Motion) -> str:
    text = f" speed {short(item.speed, _DIGITS)}"
    if item.blend:
        text += f" blend {short(item.blend, _DIGITS)}"
    if not isinstance(item, MoveJ) and (item.force or any(item.press)):
        text += f" force {short(item.force, _DIGITS)} press {_numbers(item.press, _ANGLE_DIGITS)}"
    if item.joints is not None:
        text += " at " + _numbers(item.joints.values, _ANGLE_DIGITS)
    return text


def parse(text: str) -> Program:
    """The program that ``dump`` wrote. ValueError names the line that cannot be read."""
    lines = text.splitlines()
    if not lines or lines[0] != "camgen-ir 1":
        raise ValueError("line 1: not a camgen-ir 1 text")
    name, work, tool = "", Pose(*_NEUTRAL), Pose(*_NEUTRAL)
    header: list[str] = []
    body: list[Instruction] = []
    in_body = False
    for number, line in enumerate(lines[1:], start=2):
        word, _, rest = line.partition(" ")
        try:
            if word == "name":
                name = rest
            elif word == "work":
                work = _parse_pose(rest.split())
            elif word == "tool":
                tool = _parse_pose(rest.split())
            elif word == "body":
                in_body = True
            elif word == "#" and not in_body:
                header.append(rest)
            elif word:
                body.append(_parse_instruction(word, rest))
        except (ValueError, IndexError, KeyError, ZeroDivisionError) as error:
            raise ValueError(f"line {number}: {line!r}: {error}") from error
    return Program(name, work, tool, tuple(body), tuple(header))


_NEUTRAL = (rotation_from_quaternion((1.0, 0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))
_TAIL_WORDS = ("speed", "blend", "force", "press", "at")


def _parse_pose(words: list[str]) -> Pose:
    x, y, z = (float(w) for w in words[:3])
    if words[3] != "q" or len(words) != 8:
        raise ValueError("a pose is x y z q w x y z")
    return Pose(rotation_from_quaternion([float(w) for w in words[4:8]]), (x, y, z))


def _split(words: list[str]) -> tuple[list[str], dict[str, list[float]]]:
    """The words before the tail, and the tail as lists of numbers by word."""
    tail: dict[str, list[float]] = {}
    head: list[str] = []
    current: list[float] | None = None
    for word in words:
        if word in _TAIL_WORDS:
            current = tail.setdefault(word, [])
        elif current is None:
            head.append(word)
        else:
            current.append(float(word))
    return head, tail


def _parse_instruction(word: str, rest: str) -> Instruction:
    if word == "#":
        return Comment(rest)
    if word == "output":
        signal, value = rest.rsplit(" ", 1)
        return Output(signal, float(value))
    if word == "wait":
        return Wait(float(rest))
    head, tail = _split(rest.split())
    if word == "force":
        x, y, z = tail["press"]
        return Force(float(head[0]), (x, y, z))
    speed = tail["speed"][0]
    blend = tail.get("blend", [0.0])[0]
    joints = Joints(tuple(tail["at"])) if "at" in tail else None
    if word == "movej":
        target = Joints(tuple(float(w) for w in head[1:])) if head[0] == "joints" else _parse_pose(head)
        return MoveJ(target, speed, blend, joints)
    force = tail.get("force", [0.0])[0]
    x, y, z = tail.get("press", [0.0, 0.0, 0.0])
    if word == "movel":
        return MoveL(_parse_pose(head), speed, blend, force, (x, y, z), joints)
    if word == "movec":
        middle = head.index("to")
        return MoveC(
            _parse_pose(head[:middle]), _parse_pose(head[middle + 1 :]), speed, blend, force, (x, y, z), joints
        )
    raise ValueError(f"unknown instruction {word!r}")
