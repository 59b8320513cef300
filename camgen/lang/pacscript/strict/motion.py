"""Motion statements `Move`, `Approach`, `Depart` and `Draw`, and speeds (PacScript reference)."""

from __future__ import annotations

import math
import re
from functools import lru_cache

from camgen.lang.pacscript.motion import EXTENDED, LINEAR, OPTION, split_mark
from camgen.lang.pacscript.plain import Plain, motions
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Posture
from camgen.model.text import counted

from .machine import Machine
from .values import (
    Figured,
    Mps,
    Unreadable,
    Value,
    Vector,
    arguments,
    evaluate,
    number,
)
from .values import speed as checked_speed

_NAMED = re.compile(r"\* [A-Za-z]")


def move(machine: Machine, rest: str) -> None:
    """Runs a `Move` statement.

    It is `Move P|L, [@mark] target, ... [, options]` or `Move C, via, [@mark] target [, options]`.
    """
    parts = arguments(rest)
    kind = parts[0].lower()
    if kind != "c" and kind not in LINEAR:
        raise Unreadable(f"Move {parts[0]} is not evaluated")
    targets, speed, at_once = _options(machine, parts[1:])
    if kind == "c":
        _arc(machine, targets, speed, at_once)
        return
    if not targets:
        raise Unreadable("a motion without a target")
    for text in targets:
        mark, expression = split_mark(text)
        go(machine, LINEAR[kind], _target(machine, expression), machine.blend(mark), speed, at_once)


def _read_mark(text: str) -> str:
    """The mark before the target of a motion. Raises Unreadable if `move` would refuse it."""
    return split_mark(f"{text}P()")[0]


def _read_speed(text: str) -> float | Mps | str | None:
    """The speed of a motion.

    It is a text if it contains a name, and None if the motion does not have a speed of its own.
    Raises Unreadable if `move` would refuse it.
    """
    for part in arguments(text)[1:]:
        option = OPTION.fullmatch(part)
        if option is None:
            raise Unreadable(f"{part} is no speed")
        if _NAMED.search(option[2]):
            return option[2]
        return checked_speed(evaluate(option[2], nothing))
    return None


def nothing(key: str | tuple[str, int]) -> Value:
    """Raises Unreadable. It is the lookup of variables for an expression without names."""
    raise Unreadable(f"{key} is not asked for")


def approach(machine: Machine, rest: str) -> None:
    """Runs `Approach P|L, reference, [@mark] length`.

    The target is the reference moved back by the length along its tool z.
    """
    parts = arguments(rest)
    linear = _interpolation(parts)
    (reference, length), speed, at_once = _exactly(machine, parts[1:], 2)
    pose = _target(machine, reference)
    mark, expression = split_mark(length)
    if isinstance(pose, Joints):
        raise Unreadable("an approach to joints is not evaluated")
    target = _back(pose, number(expression, machine.lookup))
    go(machine, linear, target, machine.blend(mark), speed, at_once)


def depart(machine: Machine, rest: str) -> None:
    """Runs `Depart P|L, [@mark] length`.

    The target is the current pose moved back by the length along its tool z.
    """
    parts = arguments(rest)
    linear = _interpolation(parts)
    (length,), speed, at_once = _exactly(machine, parts[1:], 1)
    mark, expression = split_mark(length)
    target = _back(_require_pose(machine), number(expression, machine.lookup))
    go(machine, linear, target, machine.blend(mark), speed, at_once)


def draw(machine: Machine, rest: str) -> None:
    """Runs `Draw P|L, [@mark] V(dx, dy, dz)`.

    It moves by a vector in the work frame and keeps the orientation.
    """
    parts = arguments(rest)
    linear = _interpolation(parts)
    (argument,), speed, at_once = _exactly(machine, parts[1:], 1)
    mark, expression = split_mark(argument)
    vector, start = evaluate(expression, machine.lookup), _require_pose(machine)
    if not isinstance(vector, Vector):
        raise Unreadable("Draw needs a vector")
    x, y, z = (a + b for a, b in zip(start.origin, vector.values, strict=True))
    go(machine, linear, Pose(start.rotation, (x, y, z)), machine.blend(mark), speed, at_once)


def speed_statement(machine: Machine, rest: str) -> None:
    """Runs `Speed`, in percent or by `Mps`, for motions without a speed of their own."""
    machine.internal = machine.stated_internal = checked_speed(evaluate(rest, machine.lookup))
    machine.acceleration, machine.settled = (), False  # Speed changes it (reference, Speed).


def external_speed(machine: Machine, rest: str) -> None:
    """Runs `ExtSpeed`, in percent of the internal speed."""
    values = [number(part, machine.lookup) for part in arguments(rest)]
    if not 0 < values[0] <= 100:
        raise Unreadable(f"an external speed of {values[0]:g} %")
    machine.external = machine.stated_external = values[0]
    machine.settled = False
    if len(values) > 1:
        machine.remark("ExtSpeed with an acceleration, which no option asks for")


def acceleration(machine: Machine, rest: str) -> None:
    """Runs `Accel`, in percent. A second value is the deceleration."""
    values = _percent(machine, rest)
    machine.acceleration = (*values, *(machine.acceleration or ())[1:])[:2]
    machine.settled = False


def deceleration(machine: Machine, rest: str) -> None:
    """Runs `Decel`, in percent."""
    machine.acceleration = (*(machine.acceleration or ())[:1], *_percent(machine, rest)[:1])
    machine.settled = False


def _percent(machine: Machine, rest: str) -> list[float]:
    """One or two accelerations, %. Raises Unreadable if they are out of range."""
    values = [number(part, machine.lookup) for part in arguments(rest)]
    for value in values:
        if not 0.0001 <= value <= 100:
            raise Unreadable(f"an acceleration of {value:g} %")
    if len(values) > 2:
        raise Unreadable("an acceleration has one value or two")
    return values


def _options(machine: Machine, parts: list[str]) -> tuple[list[str], float | Mps, bool]:
    """The arguments of a motion, its speed, and whether it has `Next`.

    With `Next` the next statement runs before the arm arrives.
    """
    targets: list[str] = []
    speed: Value | None = None
    at_once = False
    for part in parts:
        if "=" in part and (option := OPTION.fullmatch(part)):
            value = evaluate(option[2], machine.lookup)
            if option[1].lower() in ("speed", "s"):
                speed = value
            elif option[1].lower() in ("accel", "decel"):
                name = option[1].capitalize()
                machine.remark(f"a motion with an {name} of its own, which no option asks for")
            else:
                raise Unreadable(f"the option {option[1]} of a motion is not evaluated")
        elif part.lower() == "next":
            at_once = True
        elif ("x" in part or "X" in part) and EXTENDED.search(part):
            raise Unreadable("extended axes are not evaluated")
        else:
            targets.append(part)
    return targets, machine.internal_speed() if speed is None else checked_speed(speed), at_once


def _exactly(machine: Machine, parts: list[str], count: int) -> tuple[list[str], float | Mps, bool]:
    targets, speed, at_once = _options(machine, parts)
    if len(targets) != count:
        raise Unreadable(f"{counted(count, 'value')} expected, {len(targets)} found")
    return targets, speed, at_once


def _interpolation(parts: list[str]) -> bool:
    if parts[0].lower() not in LINEAR:
        raise Unreadable(f"{parts[0] or 'no'} interpolation")
    return LINEAR[parts[0].lower()]


def _target(machine: Machine, expression: str) -> Pose | Joints:
    value = evaluate(expression, machine.lookup)
    if not isinstance(value, (Pose, Joints)):
        raise Unreadable(f"{expression} is no place to move to")
    return value


def _require_pose(machine: Machine) -> Pose:
    """The current pose. Raises Unreadable if the text does not give it."""
    if machine.current_pose is None:
        raise Unreadable("a motion from a place that the text does not give")
    return machine.current_pose


def _back(pose: Pose, length: float) -> Pose:
    return Pose(pose.rotation, pose.apply((0.0, 0.0, -length)))


def go(
    machine: Machine,
    linear: bool,
    target: Pose | Joints,
    blend: float,
    speed: float | Mps,
    at_once: bool,
) -> None:
    """Adds a motion to `target`. Raises Unreadable for a line to joint values.

    blend: blend radius, mm.
    at_once: whether the next statement does not wait for the arm.
    """
    passing = blend > 0 or at_once
    posture = _posture(target)
    if isinstance(target, Figured):
        target = Pose(target.rotation, target.origin)
    if not linear:
        limit, share = machine.joint_speed(speed)
        machine.emit_motion(MoveJ(target, limit, blend, posture=posture, share=share), passing)
    elif isinstance(target, Joints):
        raise Unreadable("a straight line to joints is not evaluated")
    elif isinstance(speed, Mps) or not _is_still(machine, target):
        mm_s = machine.mm_per_second(speed)
        item = MoveL(target, mm_s, blend, *machine.pressing(), posture=posture)
        machine.emit_motion(item, passing)
    else:
        # A reorientation, even if it is smaller than a printed digit. It has no speed in mm/s.
        limit, turn = machine.joint_speed(speed)[0], machine.turning(speed)
        item = MoveL(target, limit, blend, *machine.pressing(), posture=posture, turn=turn)
        machine.emit_motion(item, passing)


def _is_still(machine: Machine, target: Pose) -> bool:
    """Whether the TCP keeps its position on the way to a target."""
    start = machine.current_pose
    return start is not None and start.origin == target.origin


def _arc(machine: Machine, targets: list[str], speed: float | Mps, at_once: bool) -> None:
    if len(targets) != 2:
        raise Unreadable(f"Move C has {counted(len(targets), 'point')} instead of two")
    mark, expression = split_mark(targets[1])
    via, end = _target(machine, targets[0]), _target(machine, expression)
    if isinstance(via, Joints) or isinstance(end, Joints):
        raise Unreadable("an arc through joints is not evaluated")
    arc(machine, via, end, machine.blend(mark), speed, at_once)


def arc(
    machine: Machine, via: Pose, end: Pose, blend: float, speed: float | Mps, at_once: bool
) -> None:
    """Adds an arc through `via` to `end`.

    blend: blend radius, mm.
    at_once: whether the next statement does not wait for the arm.
    """
    if machine.current_pose is None:
        machine.fault("an arc from a place that the text does not give")
    elif shape := _shape(machine.current_pose.origin, via.origin, end.origin):
        machine.fault(shape)
    _compare_figures(machine, via, end)
    posture = _posture(end)
    via, end = (Pose(place.rotation, place.origin) for place in (via, end))
    mm_s = machine.mm_per_second(speed)
    item = MoveC(via, end, mm_s, blend, *machine.pressing(), posture=posture)
    machine.emit_motion(item, blend > 0 or at_once)


def _compare_figures(machine: Machine, via: Pose, end: Pose) -> None:
    """Adds findings if the via point and the end of an arc have different figures.

    The reference asks for the same figure at both ends. It does not define that of the via point.
    """
    if isinstance(via, Figured) and isinstance(end, Figured):
        if via.figure != end.figure:
            machine.fault("the points of the arc have different figures")
    elif isinstance(via, Figured):
        machine.remark(f"the via point of an arc has figure {via.figure}, its end leaves it open")
    elif isinstance(end, Figured):
        machine.remark(f"the via point of an arc leaves its figure open, its end has {end.figure}")


@lru_cache(maxsize=64)
def _read_figure(figure: int) -> Posture:
    return Posture(figure=figure)


def _posture(place: Pose | Joints) -> Posture | None:
    """The figure of a position, None without one."""
    return _read_figure(place.figure) if isinstance(place, Figured) else None


def _shape(start: Vec3, via: Vec3, end: Vec3) -> str:
    """The fault of an arc through three points, empty without one.

    The angle at the via point is half the arc on the other side of the chord.
    """
    x, y, z = via
    ax, ay, az = start[0] - x, start[1] - y, start[2] - z
    bx, by, bz = end[0] - x, end[1] - y, end[2] - z
    product = math.hypot(ax, ay, az) * math.hypot(bx, by, bz)
    cross = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    if cross <= 1e-6 * product:
        return "the three points of the arc are on one line"
    cosine = (ax * bx + ay * by + az * bz) / product
    return "an arc of more than 180 deg" if cosine > 0.01 else ""


# The motion lines that most of a PacScript program consists of, read without an expression.

MOTIONS = motions(_read_mark, _read_speed)


def carry_out(machine: Machine, item: Plain) -> None:
    """Runs a motion in the usual spelling with the result of `move`."""
    speed = machine.internal_speed() if item.speed is None else item.speed
    if isinstance(speed, str):
        speed = machine.speed_of(speed)
    blend = machine.blend(item.mark)
    if item.via is not None:
        arc(machine, item.via, item.target, blend, speed, False)
    else:
        go(machine, item.kind == "L", item.target, blend, speed, False)
