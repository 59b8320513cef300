"""RAPID's motions as instructions (technical reference manual: Move, Trigg, Search; processes).

A motion to an unknown target is left out, and the log of the run notes it.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache

from msgspec import Struct
from msgspec.structs import replace

from camgen.lang.motion_speed import Limit, limit_speed, measure_arc, measure_line
from camgen.lang.values import Unknown
from camgen.model.instructions import Force, Joints, MoveC, MoveJ, MoveL, Output, Posture
from camgen.model.pose import Pose, Vec3, frozen, rotation_between, to_vec3

from .effects import LOST_OPTIONS, OMITTED_OPTIONS, READ_OPTIONS, SILENT_OPTIONS
from .functions import name_of
from .machine import Machine, RobotPosition
from .places import WORST_NORM, choose_frame, enter_placed, pose_of, see_pose
from .tree import Calling, Expr, Inline
from .values import RelativeTarget, Value, find_unknown
from .ways import find_arc_faults, is_half_turn, split_arc, split_at_circle_point

#: Difference of two quadrants of an axis from which on it turns by more than 180 deg.
_FAR_QUARTER_TURNS = 3
#: mm/s that replaces a speed which is not positive.
_SLOWEST = 0.01
#: Deviation from 1 of the sum of squares of an orientation above which a finding is added.
#: NOrient accepts 1e-5; programs often have four digits.
_LOOSE_NORM = 1e-3
#: Values above this are 9E9 rounded, which stands for an axis that does not exist.
_NINES = 8.9e9
#: deg/s of reorientation in all predefined speeddata.
_USUAL_TURN = 500.0
#: `_USUAL_TURN` in rad/s, less a margin for rounding.
_USUAL_TURN_RAD = math.radians(_USUAL_TURN) * (1 - 1e-9)
#: mm: radius of z0. Up to it the tool is at the target when it switches.
_NO_CORNER = 0.3
#: Number of motions whose arguments are stored.
_MOST_REMEMBERED = 10_000
#: Names that look like predefined speeddata and zonedata.
_LIKE_PREDEFINED = re.compile(r"[vz][0-9]+", re.IGNORECASE)


class Form(Struct, frozen=True):
    """The arguments that a motion instruction has.

    kind: j, l, c, abs or ext.
    before: number of arguments before the points.
    after: number of arguments after the tool.
    trigg: number of triggers after the speed.
    zone: whether it has a zone.
    process: process that runs during the motion, empty without one.
    """

    kind: str
    before: int = 0
    after: int = 0
    trigg: int = 0
    zone: bool = True
    process: str = ""

    @property
    def point_count(self) -> int:
        """Number of points: an arc has a circle point too."""
        return 2 if self.kind == "c" else 1


class Trigger(Struct, frozen=True):
    """An event at a place of a motion, as TriggIO, TriggEquip or TriggInt defines it.

    distance: mm from the end of the motion, or from its start.
    start: whether the distance is from the start.
    outputs: name and value of each output that is set.
    interrupt: interrupt that may come there.
    """

    distance: float
    start: bool
    outputs: tuple[tuple[str, float], ...]
    interrupt: Expr | None = None


FORMS: dict[str, Form] = {
    "moveabsj": Form("abs"), "movej": Form("j"), "movel": Form("l"), "movec": Form("c"),
    "moveextj": Form("ext"),
    **{f"move{kind}do": Form(kind, after=2) for kind in "jlc"},
    **{f"move{kind}ao": Form(kind, after=2) for kind in "jlc"},
    **{f"move{kind}go": Form(kind, after=2) for kind in "jlc"},
    **{f"move{kind}sync": Form(kind, after=1) for kind in "jlc"},
    "triggj": Form("j", trigg=1), "triggl": Form("l", trigg=1), "triggc": Form("c", trigg=1),
    "triggabsj": Form("abs", trigg=1), "triggjios": Form("j"), "trigglios": Form("l"),
    "searchl": Form("l", before=2, zone=False), "searchc": Form("c", before=2, zone=False),
    "searchextj": Form("ext", before=2, zone=False),
    "fcpress1lstart": Form("l", trigg=1, process="force"),
    "fcpressl": Form("l", trigg=1, process="force"),
    "fcpressc": Form("c", trigg=1, process="force"),
    "fcpressend": Form("l", zone=False, process="force"),
}  # fmt: skip
#: Motions of packages for processes: the process, Move if it is off, the kind of motion, and
#: whether the motion starts or ends the process.
_PROCESS = re.compile(
    r"(arc|arcadapt|arccalc|contact|cap|spot|spotm|disp|paint|cut|laser|nut|glue|seal|plasma)"
    r"(move)?(absj|extj|l|c|j)(\d*start|\d*end|\d*)"
)


@lru_cache(maxsize=1000)
def find_form(name: str) -> Form | None:
    """The form of an instruction, its name in lower case. None if it is not a known motion."""
    if name in FORMS:
        return FORMS[name]
    match = _PROCESS.fullmatch(name)
    if match is None:
        return None
    process, plain, kind, _ = match.groups()
    return Form({"absj": "abs", "extj": "ext"}.get(kind, kind), process="" if plain else process)


class Bound(Struct, frozen=True):
    """The values of a motion's arguments except its points.

    speed: speed of the TCP, mm/s.
    turn: speed of reorientation, rad/s, 0 without one.
    blend: blend radius, mm.
    frame: index of its tool and work object in `Machine.frames`.
    seconds: time of the whole motion, s, that replaces both speeds; 0 without one.
    """

    speed: float
    turn: float
    blend: float
    frame: int
    seconds: float = 0.0

    @property
    def turns_slowly(self) -> bool:
        """Whether reorientation is slower than in all predefined speeddata."""
        return 0 < self.turn < _USUAL_TURN_RAD


def move(machine: Machine, call: Calling) -> Bound | None:
    """Run a motion statement and return its arguments, None for a motion of external axes.

    Raises Wrong if no controller accepts the statement.
    """
    form = find_form(call.name)
    assert form is not None
    if form.kind == "ext":
        machine.log.lose_axes("move on their own and are not shown")
        return None
    points, speed, zone, tool, tail = _arguments(machine, form, call)
    bound = _bind(machine, form, call, speed, zone, tool)
    if form.kind == "abs":
        if bound.seconds:
            machine.log.omit(
                f"{call.name} \\T:={bound.seconds:g}: the time of a motion to joint values; "
                f"it runs at {bound.speed:g} mm/s"
            )
        _move_joints(machine, machine.value(points[-1]), bound)
    else:
        _move_pose(machine, form, call, [machine.value(point) for point in points], bound)
    _do_after(machine, form, call, points, tail)
    return bound


def _arguments(
    machine: Machine, form: Form, call: Calling
) -> tuple[tuple[Expr, ...], Expr, Expr | None, Expr, tuple[Expr, ...]]:
    count = form.point_count
    args = call.args[form.before :]
    after = form.after
    if call.name.endswith("go") and any(name in ("value", "dvalue") for name, _ in call.options):
        after = 1
    first_after = len(args) - after
    args, tail = args[:first_after], args[first_after:]
    needed = count + 2 + form.zone
    if len(args) < needed or (len(args) > needed + form.trigg and not form.process):
        total = needed + form.trigg + form.before + after
        raise machine.wrong(f"{call.name} has {total} arguments, not {len(call.args)}")
    return args[:count], args[count], args[-2] if form.zone else None, args[-1], tail


#: Motions whose arguments except the point are stored, and found again by their shape.
_REMEMBERED = ("movej", "movel")


def move_inline(machine: Machine, item: Inline) -> None:
    """Run a motion to points written out.

    Its other arguments are evaluated once, and again only after a change of data or speeds.
    """
    shape = item.shape
    if shape.name not in _REMEMBERED or machine.scope.data or item.via is not None:
        move(machine, item.call())
        return
    key = (shape, machine.scope.home, machine.version, machine.speed_override, machine.speed_most)
    bound = machine.bound.get(key)
    if bound is None:
        bound = move(machine, item.call())
        has_time = any(name == "t" for name, _ in shape.options)
        if len(machine.bound) < _MOST_REMEMBERED and not has_time:
            machine.bound[key] = bound
        return
    _check_turn(machine, item.turn)
    target = Pose(machine.rotation(item.turn), item.to)
    if machine.displaced is not None:
        target = machine.displaced @ target
    machine.frame = bound.frame
    form = FORMS[shape.name]
    bound = _limit_speed(machine, shape.name, bound, None, target, by_joints=form.kind == "j")
    _emit(machine, form, None, target, bound, shape.points[0])


# Arguments of a motion except its points ---------------------------------------------------------


def _bind(
    machine: Machine, form: Form, call: Calling, speed: Expr, zone: Expr | None, tool: Expr
) -> Bound:
    options = dict(call.options)
    machine.frame = choose_frame(machine, tool, options.get("wobj"), form.kind == "abs")
    mm_s, rad_s = _speed(machine, form, call, machine.value(speed), options)
    seconds = _read_time(machine, call, options)
    _note_options(machine, form, call)
    blend = 0.0
    if zone is not None and "inpos" not in options:
        blend = _blend(machine, machine.value(zone), options)
    return Bound(mm_s, rad_s, blend, machine.frame, seconds)


def _note_options(machine: Machine, form: Form, call: Calling) -> None:
    for name, _ in call.options:
        if name in LOST_OPTIONS:
            machine.log.leave_out(f"{call.name} \\{name}: {LOST_OPTIONS[name]}")
        elif name in OMITTED_OPTIONS:
            machine.log.omit(f"{call.name} \\{name}: {OMITTED_OPTIONS[name]}")
        elif not _is_read(form, name):
            machine.log.omit(f"{call.name} \\{name}: an argument that is not read")


def _is_read(form: Form, name: str) -> bool:
    if name in READ_OPTIONS or name in SILENT_OPTIONS:
        return True
    if form.process == "force":
        return name in ("fx", "fy", "fz")
    values = ("value", "dvalue") if form.after else ()
    return name in values or bool(form.trigg and re.fullmatch(r"t\d", name))


def _speed(
    machine: Machine, form: Form, call: Calling, value: Value, options: dict[str, Expr | None]
) -> tuple[float, float]:
    """The speeds of TCP, mm/s, and reorientation, rad/s.

    VelSet scales both, but not the speed of welding. Its maximum is for the TCP alone.
    """
    machine.fit("speeddata", value)
    override = machine.speed_override
    if "v" in options:
        given = machine.number(options["v"])
        turn = value[1] if isinstance(value, tuple) else _USUAL_TURN
        value = (given, turn) if type(given) is float else given
    if form.process == "arc" and machine.welding:
        welding = _weld_speed(machine, call, value)
        override = override if welding is value else 1.0
        value = welding
    unknown = find_unknown(value)
    if unknown is not None:
        name = _name_of(machine, unknown)
        machine.log.assume(f"a speed is not known ({name}): 100 mm/s is taken")
        value = (100.0, _USUAL_TURN)
    mm_s = value[0] * override
    if machine.speed_most > 0:
        mm_s = min(mm_s, machine.speed_most)
    if not mm_s > 0:
        machine.log.find("unusual", f"a speed of {mm_s:g} mm/s: the arm hardly moves")
        mm_s = _SLOWEST
    return mm_s, math.radians(max(0.0, value[1]) * override)


def _read_time(machine: Machine, call: Calling, options: dict[str, Expr | None]) -> float:
    """The time of the whole motion by its argument T, s, 0 without it. VelSet scales it.

    Raises Wrong for a time that is not positive.
    """
    if "t" not in options:
        return 0.0
    seconds = machine.number(options["t"])
    if isinstance(seconds, Unknown):
        machine.log.omit(f"{call.name} \\T: the time is not known ({seconds.what[:60]})")
        return 0.0
    if not seconds > 0:
        raise machine.wrong(f"{call.name} in \\T:={seconds:g} s")
    return float(seconds / machine.speed_override)


def _weld_speed(machine: Machine, call: Calling, value: Value) -> Value:
    """The speed of the weld data, which counts while the arc burns, or `value` without one."""
    # Before the weld data are the points, the speed and the seam data.
    index = (2 if find_form(call.name) == Form("c", process="arc") else 1) + 2
    weld = machine.value(call.argument(index))
    if isinstance(weld, tuple) and weld and type(weld[0]) is float and weld[0] > 0:
        return (weld[0], _USUAL_TURN)
    return value


def _name_of(machine: Machine, unknown: Unknown) -> str:
    """The name of an unknown value. Adds a finding if it looks like a name of RAPID's own data."""
    name = unknown.what
    if _LIKE_PREDEFINED.fullmatch(name):
        what = f"{name} is not a predefined speed or zone, and no file defines it"
        machine.log.find("unusual", what, once=name.lower())
    return name


def _blend(machine: Machine, value: Value, options: dict[str, Expr | None]) -> float:
    """The blend radius, mm, 0 for a stop."""
    machine.fit("zonedata", value)
    if "z" in options:
        radius = machine.number(options["z"])
        if isinstance(radius, Unknown):
            machine.log.assume(f"a zone is not known ({radius.what[:60]}): a stop is taken")
            return 0.0
        return max(float(radius), 0.0)
    unknown = find_unknown(value)
    if unknown is not None:
        machine.log.assume(f"a zone is not known ({_name_of(machine, unknown)}): a stop is taken")
        return 0.0
    return 0.0 if value[0] else max(value[1], 0.0)


# Motions to joint values and to poses ------------------------------------------------------------


def _move_joints(machine: Machine, value: Value, bound: Bound) -> None:
    machine.fit("jointtarget", value)
    if isinstance(value, Unknown) or find_unknown(value[0]) is not None:
        _leave_out(machine, value)
        return
    axes = tuple(0.0 if v > _NINES else v for v in value[0])
    _note_external_axes(machine, value[1])
    turn = bound.turn if bound.turns_slowly else 0.0
    item = MoveJ(Joints(tuple(math.radians(v) for v in axes)), bound.speed, bound.blend, turn=turn)
    machine.add(item)
    machine.position = RobotPosition(None, machine.frame, (), axes)
    machine.blending = machine.line if bound.blend > _NO_CORNER else 0


def _can_move(machine: Machine, point: Value) -> bool:
    """Whether a target is known. If not, the log notes that its motion is left out.

    Raises Wrong if the value is not a robtarget.
    """
    machine.fit("robtarget", point)
    pose = point[:2] if isinstance(point, tuple) else ()
    if isinstance(point, Unknown) or find_unknown(pose) is not None:
        _leave_out(machine, point)
        return False
    if machine.log.assumed and not any(point[1]):
        _leave_out(machine, Unknown("it has no value yet"))
        return False
    _check_turn(machine, point[1])
    return True


def _move_pose(
    machine: Machine, form: Form, call: Calling, points: list[Value], bound: Bound
) -> None:
    if any(isinstance(point, RelativeTarget) for point in points):
        points = enter_placed(machine, points)
    if not all(_can_move(machine, point) for point in points):
        return
    poses = [pose_of(machine, point) for point in points]
    if machine.displaced is not None:
        poses = [machine.displaced @ pose for pose in poses]
    via = poses[0] if len(poses) > 1 else None
    target, rest = poses[-1], points[-1][2:]
    bound = _limit_speed(machine, call.name, bound, via, target, by_joints=form.kind == "j")
    triggers = _triggers(machine, form, call)
    if form.process == "force":
        _press(machine, call, bound, via, target, _posture(rest))
        machine.position = RobotPosition(target, machine.frame, rest)
    elif triggers and via is None and form.kind == "l":
        _trigger_on_line(machine, triggers, target, bound, rest)
    else:
        _emit(machine, form, via, target, bound, rest)
        if any(trigger.start or trigger.distance > 0 for trigger in triggers):
            machine.log.omit(
                f"{call.name}: the place of its triggers on the way; here they act at its end"
            )
        for trigger in triggers:
            _switch(machine, trigger)


def _leave_out(machine: Machine, value: Value) -> None:
    """Leave out a motion with an unknown target. The position of the arm is unknown after it."""
    unknown = find_unknown(value)
    reason = "it is worked out on the controller"
    if unknown is not None and unknown.what:
        reason = unknown.what
    machine.log.leave_out(f"a target is not known ({reason[:60]}): motions there are left out")
    machine.position = RobotPosition(None, machine.frame)


def _check_turn(machine: Machine, turn: tuple[float, ...]) -> None:
    """Raise Wrong if the sum of squares of a quaternion is far from 1."""
    if turn in machine.turns:
        return
    norm = sum(v * v for v in turn)
    deviation = abs(norm - 1)
    if deviation > WORST_NORM:
        raise machine.wrong(f"an invalid orientation (the sum of its squares is {norm:.3g})")
    if deviation > _LOOSE_NORM:
        squares = f"the sum of its squares is off by {deviation:.2g}"
        what = f"an orientation that is not normalised ({squares})"
        machine.log.find("unusual", what, once="norm")


def _check_configuration(machine: Machine, rest: tuple[Value, ...]) -> None:
    """Add a finding for a configuration that no straight motion or arc leads to.

    With ConfL the controller stops there. Another cfx needs another shoulder, elbow or wrist. An
    axis that is three quarter turns away turns by more than 180 deg.
    """
    before, after = (_read_confdata(values) for values in (machine.position.rest, rest))
    if before is None or after is None:
        return
    turns = [abs(new - old) for new, old in zip(after[:3], before[:3], strict=True)]
    if after[3] != before[3] or max(turns) >= _FAR_QUARTER_TURNS:
        old, new = _format_conf(before), _format_conf(after)
        what = f"the configuration of the axes changes from {old} to {new} on the way"
        machine.log.find("dangerous", f"{what}: with ConfL the controller stops there")


def _format_conf(conf: tuple[float, ...]) -> str:
    return f"[{','.join(f'{value:g}' for value in conf)}]"


def _emit(
    machine: Machine,
    form: Form,
    via: Pose | None,
    target: Pose,
    bound: Bound,
    rest: tuple[Value, ...],
) -> None:
    start = see_pose(machine)
    posture = _posture(rest)
    if form.kind != "j" and machine.has_conf_l:
        _check_configuration(machine, rest)
    if len(rest) > 1:
        _note_external_axes(machine, rest[1])
    if form.kind == "j":
        machine.add(MoveJ(target, bound.speed, bound.blend, posture=posture, turn=bound.turn))
    elif via is None:
        if start is not None and is_half_turn(start, target):
            machine.log.find(
                "unusual", "the tool turns by 180 deg in one straight motion; its sense is open"
            )
        machine.add(MoveL(target, bound.speed, bound.blend, posture=posture, turn=bound.turn))
    else:
        _emit_arc(machine, start, via, target, bound, posture)
    machine.position = RobotPosition(target, machine.frame, rest)
    machine.blending = machine.line if bound.blend > _NO_CORNER else 0


@lru_cache(maxsize=1000)
def _confdata(conf: tuple[float, ...]) -> Posture | None:
    cf1, cf4, cf6, cfx = (int(v) for v in conf)
    return Posture((cf1, cf4, cf6, cfx)) if any(conf) else None


def _posture(rest: tuple[Value, ...]) -> Posture | None:
    conf = _read_confdata(rest)
    return None if conf is None else _confdata(conf)


def _read_confdata(rest: tuple[Value, ...]) -> tuple[float, ...] | None:
    conf = rest[0] if rest else None
    if not isinstance(conf, tuple) or len(conf) != 4:
        return None
    if all(type(v) is float and abs(v) < 1e6 for v in conf):
        return conf
    return None


def _note_external_axes(machine: Machine, axes: Value) -> None:
    """Add a loss if a target has values of external axes.

    The axes move if the last target had other values.
    """
    before, machine.external = machine.external, axes
    if isinstance(axes, tuple) and any(type(v) is float and v < _NINES for v in axes):
        is_moving = before is not None and axes != before
        machine.log.lose_axes("have values in the targets; they are not shown", is_moving)


def _emit_arc(
    machine: Machine,
    start: Pose | None,
    via: Pose,
    target: Pose,
    bound: Bound,
    posture: Posture | None,
) -> None:
    """Add an arc in pieces of at most half a circle, each with its via point."""
    if start is None:
        machine.add(MoveC(via, target, bound.speed, bound.blend, posture=posture))
        return
    fault, remark = find_arc_faults(start.origin, via.origin, target.origin)
    if fault:
        machine.log.find("refused", fault)
        machine.add(MoveL(target, bound.speed, bound.blend, posture=posture))
        return
    if remark:
        machine.log.find("unusual", remark, once=remark)
    split = split_at_circle_point if machine.passes_circle_point else split_arc
    *points, _ = split(start, via, target)
    for middle, end in zip(points[0:-1:2], points[1::2], strict=True):
        machine.add(MoveC(middle, end, bound.speed, 0.0, posture=posture))
    machine.add(MoveC(points[-1], target, bound.speed, bound.blend, posture=posture))


def _limit_speed(
    machine: Machine, name: str, bound: Bound, via: Pose | None, target: Pose, *, by_joints: bool
) -> Bound:
    """`bound` with the speed that the time and the speed of reorientation allow."""
    start = see_pose(machine)
    if start is None:
        if bound.seconds:
            machine.log.omit(f"{name} \\T:={bound.seconds:g}: where it begins is not known")
        elif bound.turns_slowly and by_joints:
            return replace(bound, seconds=0.0)
        elif bound.turns_slowly:
            degrees = f"{math.degrees(bound.turn):g} deg/s"
            machine.log.omit(f"{name} with v_ori {degrees}: where it begins is not known")
        return replace(bound, turn=0.0, seconds=0.0)
    if via is None:
        extent = measure_line(start, target)
    else:
        extent = measure_arc(start, via, target, turns_by_via=machine.passes_circle_point)
    limit = Limit(bound.speed, bound.turn, bound.seconds, is_exact=bound.seconds > 0)
    speed, turn = limit_speed(extent, limit)
    return replace(bound, speed=speed, turn=turn, seconds=0.0)


# Triggers, and effects at the end of a motion ----------------------------------------------------


def _triggers(machine: Machine, form: Form, call: Calling) -> list[Trigger]:
    if not form.trigg or form.process:
        return []
    expressions: list[Expr | None] = [call.args[form.point_count + 1]]
    expressions += [value for name, value in call.options if re.fullmatch(r"t\d", name)]
    triggers: list[Trigger] = []
    for expr in expressions:
        value = machine.value(expr)
        for trigger in value if isinstance(value, list) else [value]:
            if not isinstance(trigger, Trigger):
                machine.log.leave_out(f"{call.name}: a trigger is not known; define it by TriggIO")
            elif trigger.outputs or trigger.interrupt is not None:
                triggers.append(trigger)
    return triggers


def _switch(machine: Machine, trigger: Trigger) -> None:
    for name, value in trigger.outputs:
        machine.add(Output(name, value))
        machine.outputs[name.lower()] = value
    if trigger.interrupt is not None:
        machine.interrupt(machine, trigger.interrupt)


def _trigger_on_line(
    machine: Machine, triggers: list[Trigger], target: Pose, bound: Bound, rest: tuple[Value, ...]
) -> None:
    """A straight motion in pieces, between which the triggers act.

    The pieces have no blend, although the arm does not stop between them.
    """
    start = see_pose(machine)
    length = math.dist(start.origin, target.origin) if start is not None else 0.0
    places = sorted(
        ((t.distance if t.start else length - t.distance), k) for k, t in enumerate(triggers)
    )
    for distance, k in places:
        if start is not None and 0.01 < distance < length - 0.01:
            pose = _interpolate(start, target, distance / length)
            machine.add(MoveL(pose, bound.speed, posture=_posture(rest)))
            machine.log.fact(
                "triggers",
                "straight motions are shown in pieces, between which outputs are switched",
            )
        elif distance >= length - 0.01:
            break
        _switch(machine, triggers[k])
        triggers[k] = Trigger(0.0, False, ())
    _emit(machine, Form("l"), None, target, bound, rest)
    for trigger in triggers:
        _switch(machine, trigger)


def _interpolate(start: Pose, target: Pose, fraction: float) -> Pose:
    x, y, z = (a + (b - a) * fraction for a, b in zip(start.origin, target.origin, strict=True))
    return Pose(frozen(rotation_between(start.rotation, target.rotation, fraction)), (x, y, z))


def _do_after(
    machine: Machine, form: Form, call: Calling, points: tuple[Expr, ...], tail: tuple[Expr, ...]
) -> None:
    """The effects at the end of a motion: it sets a signal, calls a routine or ends a search."""
    if form.after == 2 and tail:
        options = dict(call.options)
        last = tail[1] if len(tail) > 1 else None
        value = machine.number(options.get("value") or options.get("dvalue") or last)
        name = name_of(machine, tail[0])
        if type(value) is float:
            machine.add(Output(name, value))
            machine.outputs[name.lower()] = value
    elif form.after == 1 and tail:
        name = str(machine.value(tail[0]))
        routine = machine.routine(name)
        if routine is not None:
            machine.call(routine, Calling(machine.line, name.lower()))
    elif form.before:
        signal = name_of(machine, call.args[0])
        machine.log.assume(f"{signal}: a search does not stop before its end point", "")
        machine.assign(call.args[1], machine.value(points[-1]))
    if form.process and form.process != "force":
        machine.log.omit(f"{form.process} by {call.name} and its like: the process is not switched")
    if form.process == "arc":
        machine.log.fact("process", "arc welding")
        if "start" in call.name or "end" in call.name:
            machine.welding = "start" in call.name
    elif form.process and form.process != "force":
        machine.log.fact("process", f"{form.process} along {call.name} and its like")


# Motions with force ------------------------------------------------------------------------------


def _press(
    machine: Machine,
    call: Calling,
    bound: Bound,
    via: Pose | None,
    target: Pose,
    posture: Posture | None,
) -> None:
    """Motions with a force along an axis of the tool: FCPress1LStart, FCPressL, FCPressC.

    FCPressEnd switches the force off.
    """
    if call.name == "fcpress1lstart":
        newtons = _begin_pressing(machine, call, target)
    elif machine.pressing is None:
        raise machine.wrong(f"{call.name} without FCPress1LStart")
    elif call.name == "fcpressend":
        machine.pressing = None
        machine.add(Force(0.0))
        machine.add(MoveL(target, bound.speed, bound.blend, posture=posture))
        return
    else:
        force = machine.number(call.args[2 if via is None else 3])
        if isinstance(force, Unknown):
            machine.log.assume(
                f"a force to press with is not known ({force.what[:60]}): 1 N is taken"
            )
            force = 1.0
        newtons = abs(force)
    assert machine.pressing is not None
    press = find_direction(target, machine.pressing)
    if via is None:
        machine.add(MoveL(target, bound.speed, bound.blend, newtons, press, posture=posture))
    else:
        machine.add(MoveC(via, target, bound.speed, bound.blend, newtons, press, posture=posture))
    machine.blending = machine.line if bound.blend > _NO_CORNER else 0


def _begin_pressing(machine: Machine, call: Calling, target: Pose) -> float:
    """Start force control and return the force, N. Without FX, FY or FZ it is 1 N along z."""
    names = ("fx", "fy", "fz")
    options = sorted(call.options, key=lambda option: option[0])
    forces = [
        (names.index(name), machine.number(value)) for name, value in options if name in names
    ]
    axis, force = next(iter(forces), (2, 1.0))
    if type(force) is not float or force == 0:
        machine.log.assume("the force to press with is not known: 1 N is taken")
        force = 1.0
    machine.pressing = (axis, 1 if force > 0 else -1)
    machine.add(Force(abs(force), find_direction(see_pose(machine) or target, machine.pressing)))
    return abs(force)


def find_direction(at: Pose, pressing: tuple[int, int]) -> Vec3:
    """The signed tool axis in the work frame along which a force presses."""
    axis, sign = pressing
    return to_vec3(at.rotation[:, axis] * sign)
