"""Poses of a RAPID program: tools, work objects, and the pose of the arm as far as it is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec.structs import replace

from camgen.lang.programs import Frames, carry_pose
from camgen.lang.values import Unknown
from camgen.model.pose import Pose, compute_quaternion, rotation_from_quaternion, translation

from .machine import Machine
from .tree import Calling, Expr, Ref
from .values import RelativeTarget, Value, find_unknown

#: Largest difference from 1 of the sum of squares of an orientation (manual, NOrient).
WORST_NORM = 0.1
#: Configuration and external axes of a robtarget that states none.
_NO_REST = ((0.0,) * 4, (9e9,) * 6)
#: A position and an orientation at the origin of a frame.
_ORIGIN = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
#: End of the name of a frame with the axes of the tool.
_BY_TOOL = ", along the tool"
#: kg: mass of tool0, rounded up. Up to it no load is reported.
_NO_MASS = 0.0011


def pose_of(machine: Machine, value: Value) -> Pose:
    """The pose of a position and an orientation, mm. Raises Wrong if it is not normalised."""
    (x, y, z), turn = value[0], value[1]
    norm = sum(v * v for v in turn)
    if abs(norm - 1) > WORST_NORM:
        raise machine.wrong(f"an invalid orientation (the sum of its squares is {norm:.3g})")
    return Pose(machine.rotation(turn), (x, y, z))


def encode_pose(pose: Pose) -> Value:
    """A frame as position and quaternion, mm."""
    return (tuple(map(float, pose.origin)), compute_quaternion(pose.rotation))


# Tools and work objects ---------------------------------------------------------------------


def choose_frame(machine: Machine, tool: Expr, work: Expr | None, joints: bool) -> int:
    """The index into `machine.frames` of the tool and the work object of a motion.

    joints: whether the motion leads to joint values.
    """
    tool_name, tool_value = _persistent(machine, tool, "tooldata")
    work_name, work_value = _persistent(machine, work, "wobjdata")
    if joints and work is None and machine.frames:
        # Joint values do not depend on a work object: the one of the motion before remains.
        work_name = machine.frames[machine.frame].work
        keys = (key for key, index in machine.frame_keys.items() if index == machine.frame)
        work_value = next((key[3] for key in keys), None)
    key = (tool_name, _stamp(tool_value), work_name, _stamp(work_value))
    index = machine.frame_keys.get(key)
    if index is None:
        flange = _tool_frame(machine, tool_name, tool_value)
        if work is None and not work_name:
            base: Pose | None = translation(0, 0, 0)
        else:
            base = _work_frame(machine, work_name, work_value)
        index = machine.frame_keys[key] = len(machine.frames)
        machine.frames.append(Frames(tool_name, work_name, flange, base))
    return index


def _stamp(value: Value) -> Value:
    return value if isinstance(value, tuple) and find_unknown(value) is None else None


def _persistent(machine: Machine, expr: Expr | None, kind: str) -> tuple[str, Value]:
    if expr is None:
        return "", None
    value = machine.value(expr)
    name = ""
    if isinstance(expr, Ref):
        variable = machine.variable(expr.name)
        while variable is not None and variable.base is not None:
            variable = variable.base[0]
        name = expr.name if variable is None else variable.name
        if variable is not None and variable.storage in ("var", "const") and variable.type == kind:
            rule = f"the {kind} of a motion must be a persistent (PERS)"
            machine.log.find("refused", f"{variable.name} is {variable.storage.upper()}: {rule}")
    machine.fit(kind, value)
    return name, value


def _tool_frame(machine: Machine, name: str, value: Value) -> Pose | None:
    if not isinstance(value, tuple) or find_unknown(value[:2]) is not None or len(value) < 3:
        machine.log.assume(f"the tool {name} is in none of the files: its frame is not known")
        return None
    _report_mass(machine, name, value)
    if value[0] is False:
        machine.log.leave_out(
            f"the tool {name} stands still, and the robot holds the work: the arm has to move the "
            "other way; teach it with the tool on the robot"
        )
        return None
    return pose_of(machine, value[1])


def _report_mass(machine: Machine, name: str, value: Value) -> None:
    mass = value[2][0] if isinstance(value[2], tuple) and value[2] else None
    if type(mass) is float and mass > _NO_MASS:
        machine.log.fact("load", f"{name} {mass:g} kg")
    if type(mass) is float and mass <= 0:
        what = f"the mass of the tool {name} is {mass:g} kg; the manual asks for more than 0"
        machine.log.find("unusual", what)


def _work_frame(machine: Machine, name: str, value: Value) -> Pose | None:
    if not isinstance(value, tuple) or len(value) < 5 or find_unknown(value) is not None:
        machine.log.assume(
            f"the work object {name} is in none of the files: its frame is not known"
        )
        return None
    held, fixed, unit, user, part = value
    if held is True:
        machine.log.leave_out(
            f"the work object {name} is held by the robot: the arm has to move the other way; "
            "teach it with the tool on the robot"
        )
        return None
    if fixed is False or unit:
        machine.log.leave_out(
            f"the work object {name} is moved by {unit or 'another unit'}: its place is not known; "
            "teach it in one that stands"
        )
        return None
    return pose_of(machine, user) @ pose_of(machine, part)


# The pose of the arm ------------------------------------------------------------------------


def see_pose(machine: Machine) -> Pose | None:
    """The pose of the TCP of the current tool in the current work frame, None if not known."""
    arm = machine.position
    if arm.pose is None and arm.joints is not None:
        return _compute_pose(machine, arm.joints, machine.frames[machine.frame])
    if arm.pose is None or arm.frame == machine.frame:
        return arm.pose
    return carry_pose(arm.pose, machine.frames[arm.frame], machine.frames[machine.frame])


def see_joints(
    machine: Machine, joints: Sequence[float], tool: Expr, work: Expr | None
) -> Pose | None:
    """The pose of a tool in a work object at joint values, deg. None if it is not known."""
    if machine.request.flange is None:
        return None
    tool_name, tool_value = _persistent(machine, tool, "tooldata")
    work_name, work_value = _persistent(machine, work, "wobjdata")
    flange = _tool_frame(machine, tool_name, tool_value)
    base = translation(0, 0, 0) if work is None else _work_frame(machine, work_name, work_value)
    return _compute_pose(machine, joints, Frames(tool_name, work_name, flange, base))


def _compute_pose(machine: Machine, joints: Sequence[float], frames: Frames) -> Pose | None:
    """The pose of the tool at joint values, deg, in the work object. None if it is not known."""
    base_from_work, flange_from_tool = frames.base_from_work, frames.flange_from_tool
    flange = machine.request.find_flange([math.radians(value) for value in joints])
    if flange is None or flange_from_tool is None or base_from_work is None:
        return None
    return base_from_work.inverse() @ flange @ flange_from_tool


def see_here(machine: Machine, call: Calling) -> Value:
    """The end of the last motion in the frames of the arguments: CRobT, or CPos (position)."""
    options = dict(call.options)
    kept = machine.frame
    if machine.frames and ("tool" in options or "wobj" in options):
        tool = options.get("tool") or Ref(machine.frames[kept].tool or "tool0")
        before = machine.frames[kept].work
        before = machine.placed.get(before, before)
        work = options.get("wobj") or (Ref(before) if before else None)
        machine.frame = choose_frame(machine, tool, work, False)
    pose, rest = see_pose(machine) if machine.frames else None, machine.position.rest
    work_name = machine.frames[machine.frame].work if machine.frames else ""
    machine.frame = kept
    if pose is None or _find_placed(machine):
        machine.log.assume(f"{call.name}: where the arm is is not known")
        if call.name == "cpos" or machine.displaced is not None:
            return Unknown("where the arm is")
        return _place_here(machine, machine.placed.get(work_name, work_name))
    if machine.displaced is not None:
        pose = machine.displaced.inverse() @ pose
    position, turn = encode_pose(pose)
    if len(rest) != 2:
        rest = _NO_REST
    return position if call.name == "cpos" else (position, turn, *rest)


# Points relative to a pose that is not in the program text ------------------------------------


def _find_placed(machine: Machine) -> str:
    """The frame without a pose in which the arm is, empty without one."""
    arm = machine.position
    name = machine.frames[arm.frame].work if machine.frames and arm.pose is not None else ""
    return name if name in machine.placed else ""


def _place_here(machine: Machine, work: str) -> RelativeTarget:
    """The robtarget at the arm's present pose, in a frame that is not in the program text.

    work: work object in force.
    """
    arm, point, name = machine.position, _ORIGIN, _find_placed(machine)
    if name and arm.pose is not None:
        point = encode_pose(arm.pose)
    else:
        if machine.placed_here is None or machine.placed_here[0] is not arm:
            machine.placed_here = arm, f"where the arm is in line {machine.line}"
        name = machine.placed_here[1]
    return RelativeTarget("where the arm is", point=point, frame=name, work=_name_work(work))


def _name_work(name: str) -> str:
    return "" if name.lower() == "wobj0" else name


def shift_placed(placed: RelativeTarget, shift: Sequence[float]) -> Value:
    """A point that Offs shifts along the axes of its frame; unknown in a frame of the tool."""
    if placed.frame.endswith(_BY_TOOL):
        return find_unknown(placed)
    position, turn = placed.point
    x, y, z = (a + b for a, b in zip(position, shift, strict=True))
    return replace(placed, point=((x, y, z), turn))


def turn_placed(placed: RelativeTarget, displacement: Pose) -> Value:
    """A point that RelTool displaces, in a frame with the axes of the tool."""
    if not placed.frame.endswith(_BY_TOOL):
        if placed.point != _ORIGIN:
            return find_unknown(placed)
        placed = replace(placed, frame=placed.frame + _BY_TOOL)
    (x, y, z), turn = placed.point
    pose = Pose(rotation_from_quaternion(turn), (x, y, z))
    return replace(placed, point=encode_pose(pose @ displacement))


def enter_placed(machine: Machine, points: list[Value]) -> list[Value]:
    """The points of a motion in their frame, which becomes the one in force.

    Points in different frames stay as they are.
    """
    first, tool = points[0], machine.frames[machine.frame]
    if not all(
        isinstance(point, RelativeTarget) and point.frame == first.frame for point in points
    ):
        return points
    if first.work != _name_work(tool.work) or machine.displaced is not None:
        return points
    what = f"{first.frame} is not in the text: motions from there are shown in a frame of that name"
    machine.log.leave_out(what)
    key = (tool.tool, first.frame)
    if key not in machine.frame_keys:
        machine.frame_keys[key] = len(machine.frames)
        machine.frames.append(Frames(tool.tool, first.frame, tool.flange_from_tool))
        machine.placed[first.frame] = first.work
    machine.frame = machine.frame_keys[key]
    return [(*point.point, *_NO_REST) for point in points]
