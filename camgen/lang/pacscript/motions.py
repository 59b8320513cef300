"""Runs the motion statements of PacScript."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from camgen.geometry.arcs import compute_circle, turn_about
from camgen.lang.pacscript.effects import OMITTED_OPTIONS
from camgen.lang.pacscript.evaluate import fit
from camgen.lang.pacscript.expressions import Node, parse_optional
from camgen.lang.pacscript.machine import PASS_MM, posture_of
from camgen.lang.pacscript.motion import LINEAR, Axes, Goal, Motion
from camgen.lang.pacscript.plain import Plain
from camgen.lang.pacscript.settings import check_speed
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import (
    ExternalPose,
    Speed,
    Unreadable,
    Value,
    Vector,
    Wrong,
    base_of,
    describe_value,
    figure_of,
    index,
    keep_frame,
    name_place,
    number,
    with_figure,
)
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.pose import (
    Pose,
    Vec3,
    frozen,
    rotation_about,
    rotation_about_axis,
    rotation_between,
)
from camgen.model.program import Joints, MoveC

#: Blends by pass mark, mm. The controller chooses how near `@P` and `@C` pass their target.
MARKS = {"0": 0.0, "E": 0.0, "P": PASS_MM, "C": PASS_MM}
#: Marks whose exact effect the controller decides, with their effect here.
_MEANINGS = {
    **dict.fromkeys(("P", "C"), f"blends as near as the controller likes: {PASS_MM:g} mm is shown"),
    "E": "waits for the encoders: a stop is shown",
}
#: rad: maximum sweep of one `MoveC`, half a turn and a margin for rounded points.
_MAX_SWEEP = math.pi + 0.02
#: mm: a via point nearer than this to the middle of its arc is kept.
_VIA_TOLERANCE = 0.05
#: Name of the assumption that the arm has four axes; vertical part of z of a tool that points up.
_SCARA, _UP = "__scara_robot__", 0.999


def blend_of(run: State, mark: str | Node) -> float:
    """Return the blend radius of a pass mark, mm."""
    if isinstance(mark, Node):
        value = run.evaluate(mark)
        if isinstance(value, Unknown):
            run.machine.log.assume(f"{value.what} of a pass mark is assumed to be @0")
            return 0.0
        radius = number(value)
        return PASS_MM if radius < 0 else radius
    if mark in MARKS:
        if mark in _MEANINGS:
            run.machine.log.fact("pass marks", f"@{mark} {_MEANINGS[mark]}")
        return MARKS[mark]
    return float(mark)


def speed_of(run: State, expression: str) -> Speed:
    """Return the internal speed of a motion in the usual spelling, %.

    expression: its own speed, empty for the one in force.
    """
    return _own_speed(run, parse_optional(expression))


def _own_speed(run: State, node: Node | None) -> Speed:
    """Return the internal speed of a motion, or the one in force, %."""
    if node is None:
        return run.machine.internal
    value = run.evaluate(node)
    if isinstance(value, tuple):
        run.machine.log.omit("Speed of a motion with more than one value: accelerations")
        value = value[0]
    return check_speed(run, value)


def read_speed(run: State, motion: Motion) -> Speed:
    """Return the internal speed of a motion, %. Notes the options that have no effect here."""
    for name, effect in OMITTED_OPTIONS.items():
        if name in motion.options:
            run.machine.log.omit(f"{name.capitalize()} of a motion: {effect}")
    if motion.at_once:
        run.machine.log.omit(
            "Next: the next statement runs during the motion; here it waits for the motion"
        )
    return _own_speed(run, motion.options.get("speed"))


def run_motions(run: State, items: Sequence[Plain]) -> None:
    """Run motions in the usual spelling."""
    machine, budget = run.machine, run.budget
    for item in items:
        machine.line = item.line
        budget.spend()
        try:
            speed, blend = run.speed_of(item.speed), run.blend_of(item.mark)
            if item.via is not None:
                run.arc(item.via, item.target, speed, blend)
            else:
                machine.go(item.kind == "L", item.target, speed, blend)
        except Unreadable as error:
            run.fail_motion(error)


def move(run: State, motion: Motion) -> None:
    """Run `Move`."""
    speed = run.read_speed(motion)
    if motion.kind == "s":
        _follow_path(run, motion, speed)
        return
    if motion.kind == "c":
        if len(motion.goals) != 2:
            raise Wrong(f"Move C needs two points, not {len(motion.goals)}")
        via, end = (run.place_of(goal.value) for goal in motion.goals)
        run.arc(via, end, speed, run.blend_of(motion.goals[1].mark), motion.at_once)
        return
    if not motion.goals:
        raise Wrong("a motion without a target")
    for goal in motion.goals:
        if goal.extended is not None:
            run.machine.log.lose_axes("extended axes move too and are not shown")
        for node in _list_places(run, goal.value):
            target = run.place_of(node)
            run.go(LINEAR[motion.kind], target, speed, run.blend_of(goal.mark), motion.at_once)


def _list_places(run: State, node: Node) -> Iterator[Node]:
    """Yield the target of a goal, or each one of a range such as `P[1 TO 3]`."""
    if node.kind != "index" or not node.parts or node.parts[0].kind != "range":
        yield node
        return
    first, last = (index(number(run.evaluate(bound))) for bound in node.parts[0].parts)
    if last < first:
        raise Unreadable(f"the range from {first} to {last} runs backwards")
    run.log.assume("the pass mark of a range of positions holds for each of them")
    for place in range(first, last + 1):
        run.budget.spend()
        yield Node("index", node.content, (Node("number", float(place)),))


def add_path_point(run: State, parts: Sequence[Node]) -> None:
    """Run `AddPathPoint path, position`, in the older dialect `SetSplinePoint`."""
    if len(parts) < 2:
        raise Wrong("a point of a path needs its path and its position")
    path = index(number(run.evaluate(parts[0])))
    run.machine.paths.setdefault(path, []).append(run.place_of(parts[1]))


def clear_path(run: State, parts: Sequence[Node]) -> None:
    """Run `ClrPathPoint path`, in the older dialect `ClrSplinePoint`."""
    for part in parts[:1]:
        run.machine.paths.pop(index(number(run.evaluate(part))), None)


def _follow_path(run: State, motion: Motion, speed: Speed) -> None:
    """Run `Move S, path`, a free curve through the points of a path."""
    machine = run.machine
    curve = f"the free curve of line {machine.line}"
    path = run.evaluate(motion.goals[0].value) if motion.goals else 0.0
    points = [] if isinstance(path, Unknown) else machine.paths.get(index(number(path)), [])
    if not points:
        machine.go(True, name_place(f"the end of {curve}"), speed, 0.0, motion.at_once)
        return
    machine.log.leave_out(f"{curve} is shown as lines through its points")
    for point in points:
        run.go(True, point, speed, 0.0, motion.at_once)


def place_of(run: State, node: Node) -> Value:
    """Evaluate a target: a position, joint values, or Unknown."""
    value = run.evaluate(node)
    if isinstance(value, (tuple, Vector)):
        value = fit(value, "position")
    if not isinstance(value, (Pose, Joints, Unknown)):
        raise Wrong(f"{describe_value(value)} is not a place to move to")
    return value


def go(
    run: State, linear: bool, target: Value, speed: Speed, blend: float, at_once: bool = False
) -> None:
    """Add a motion to a target."""
    machine = run.machine
    if isinstance(target, Unknown):
        stored = target.what.startswith(("J[", "where", "the end"))
        where = target.what if stored else f"{target.what} of line {machine.line}"
        machine.go(linear, name_place(where), speed, blend, at_once)
    elif isinstance(target, Joints) and linear:
        machine.go(
            True,
            name_place(f"where the joint values of line {machine.line} lead"),
            speed,
            blend,
            at_once,
        )
        machine.joints = target
    elif isinstance(target, Joints):
        machine.go_joints(target, speed, blend, at_once)
    elif isinstance(target, Pose):
        machine.go(linear, target, speed, blend, at_once)


def approach(run: State, motion: Motion) -> None:
    """Run `Approach P|L, reference, [@mark] length`: backwards along the tool axis there."""
    reference, length = _exactly(motion, 2)
    target, back = run.place_of(reference.value), run.evaluate(length.value)
    speed, blend = run.read_speed(motion), run.blend_of(length.mark)
    if isinstance(target, Joints):
        target = Unknown("a place before joint values")
    if isinstance(target, Pose):
        target = (
            Unknown(f"{back.what} before a place")
            if isinstance(back, Unknown)
            else move_back(run, target, number(back))
        )
    run.go(LINEAR[motion.kind], target, speed, blend, motion.at_once)


def depart(run: State, motion: Motion) -> None:
    """Run `Depart P|L, [@mark] length`: backwards along the tool axis from the present pose."""
    (length,) = _exactly(motion, 1)
    back = run.evaluate(length.value)
    speed, blend = run.read_speed(motion), run.blend_of(length.mark)
    if isinstance(back, Unknown):
        target: Value = Unknown(f"{back.what} before where the arm stands")
    else:
        target = move_back(run, run.find_start(), number(back))
    run.go(LINEAR[motion.kind], target, speed, blend, motion.at_once)


def draw(run: State, motion: Motion) -> None:
    """Run `Draw P|L, [@mark] V(dx, dy, dz)`: by a vector in the work frame."""
    (goal,) = _exactly(motion, 1)
    value = fit(run.evaluate(goal.value), "vector")
    if not isinstance(value, (Vector, Unknown)):
        raise Wrong(f"Draw needs a vector, not {describe_value(value)}")
    start = run.find_start()
    speed, blend = run.read_speed(motion), run.blend_of(goal.mark)
    if isinstance(start, ExternalPose) or isinstance(value, Unknown):
        target: Value = Unknown("a place beside where the arm stands")
    else:
        x, y, z = (a + b for a, b in zip(start.origin, value.values, strict=True))
        target = Pose(start.rotation, (x, y, z))
    run.go(LINEAR[motion.kind], target, speed, blend, motion.at_once)


def _exactly(motion: Motion, count: int) -> tuple[Goal, ...]:
    if len(motion.goals) != count:
        raise Wrong(f"{count} values are expected, not {len(motion.goals)}")
    return motion.goals


def move_back(run: State, pose: Pose, length: float) -> Pose:
    """Move a pose backwards along the tool axis by a length, mm.

    With an arm of four axes it moves up along z, since the tool axis of that arm points up.
    """
    scara = bool(run.machine.given(_SCARA))
    if pose.rotation[2, 2] > _UP and not isinstance(pose, ExternalPose) and not scara:
        what = (
            "a tool that points up is assumed to be that of an arm of six axes: back of it is below"
        )
        run.machine.log.assume(what, _SCARA)
    origin = pose.apply((0.0, 0.0, length if scara else -length))
    return keep_frame(with_figure(Pose(pose.rotation, origin), figure_of(pose)), pose)


def arc(
    run: State, via: Value, end: Value, speed: Speed, blend: float, at_once: bool = False
) -> None:
    """Add arcs through `via` to `end`, of at most half a circle, with the via point half-way."""
    machine = run.machine
    start = machine.current_pose
    bases = {base_of(place) for place in (start, via, end) if isinstance(place, Pose)}
    if not (isinstance(via, Pose) and isinstance(end, Pose)) or len(bases) > 1:
        goal = (
            end
            if isinstance(end, Pose)
            else name_place(f"the end of the arc of line {machine.line}")
        )
        what = "is shown as a line: its three points are not in the text"
        machine.log.assume(f"the arc of line {machine.line} {what}")
        machine.go(True, goal, speed, blend, at_once)
        return
    try:
        center, _, axis, sweep = compute_circle(start.origin, via.origin, end.origin)
    except ValueError:
        machine.log.find("refused", "the three points of the arc are on one line")
        machine.current_pose = keep_frame(Pose(end.rotation, end.origin), end)
        return
    figure = posture_of(end)[1]
    if figure is not None and machine.figure not in (None, figure):
        machine.log.find(
            "unusual", f"an arc from figure {machine.figure} to {figure}: an error may occur"
        )
    middle = _turn_point(start.origin, center, axis, sweep / 2)
    if sweep <= _MAX_SWEEP and math.dist(middle, via.origin) <= _VIA_TOLERANCE:
        mm_s, share = machine.speed(speed)
        middle_pose, end_pose = Pose(via.rotation, via.origin), Pose(end.rotation, end.origin)
        item = MoveC(
            middle_pose, end_pose, mm_s, blend, *machine.pressing, posture=posture_of(end)[0]
        )
        machine.move(machine.pace(item, share, *bases), blend > 0 and not at_once, *bases)
    else:
        _add_arcs(run, start, end, (center, axis, sweep), (speed, blend, at_once))
    machine.figure = figure


def _turn_point(point: Vec3, center: Vec3, axis: Vec3, angle: float) -> Vec3:
    x, y, z = (a - c for a, c in zip(point, center, strict=True))
    dx, dy, dz = turn_about((x, y, z), axis, angle)
    return (center[0] + dx, center[1] + dy, center[2] + dz)


def _add_arcs(
    run: State,
    start: Pose,
    end: Pose,
    revolution: tuple[Vec3, Vec3, float],
    manner: tuple[Speed, float, bool],
) -> None:
    """Add the arcs about an axis. The orientation changes uniformly from start to end.

    revolution: center of the arc, axis, and sweep in rad.
    manner: speed, blend radius of the last arc, and whether the next statement does not wait.
    """
    machine = run.machine
    base = base_of(start)
    center, axis, sweep = revolution
    speed, blend, at_once = manner
    mm_s, share = machine.speed(speed)
    pieces = max(1, math.ceil(abs(sweep) / _MAX_SWEEP))
    posture = posture_of(end)[0]

    def at(fraction: float) -> Pose:
        rotation = rotation_between(start.rotation, end.rotation, fraction)
        return Pose(rotation, _turn_point(start.origin, center, axis, fraction * sweep))

    for k in range(pieces):
        last = k == pieces - 1
        goal = Pose(end.rotation, end.origin) if last else at((k + 1) / pieces)
        item = MoveC(at((k + 0.5) / pieces), goal, mm_s, blend if last else 0.0, *machine.pressing,
                     posture=posture if last else None)  # fmt: skip
        machine.move(machine.pace(item, share, base), last and blend > 0 and not at_once, base)


def rotate(run: State, motion: Motion) -> None:
    """Run `Rotate XY|YZ|ZX, angle[, center][, pose = 1|2]`: an arc about a work axis."""
    machine = run.machine
    if len(motion.goals) < 2:
        raise Wrong("Rotate needs a plane and an angle")
    plane = str(motion.goals[0].value.content)
    normal = {"xy": (0.0, 0.0, 1.0), "yz": (1.0, 0.0, 0.0), "zx": (0.0, 1.0, 0.0)}.get(plane)
    angle = run.evaluate(motion.goals[1].value)
    about = (
        run.evaluate(motion.goals[2].value) if len(motion.goals) > 2 else Vector((0.0, 0.0, 0.0))
    )
    speed, blend = run.read_speed(motion), run.blend_of(motion.goals[1].mark)
    start = machine.current_pose
    if (
        normal is None
        or isinstance(start, ExternalPose)
        or not isinstance(about, Vector)
        or isinstance(angle, Unknown)
    ):
        machine.go(
            True,
            name_place(f"the end of the turn of line {run.machine.line}"),
            speed,
            blend,
            motion.at_once,
        )
        return
    towards = start.rotation[:, 2].tolist()
    static = number(run.evaluate(motion.options.get("static", Node("number", 0.0))))
    if not static and sum(a * b for a, b in zip(normal, towards, strict=True)) < 0:
        normal = (-normal[0], -normal[1], -normal[2])
    sweep = math.radians(number(angle))
    keeps = number(run.evaluate(motion.options.get("pose", Node("number", 2.0)))) != 1
    turned = (
        start.rotation
        if keeps
        else frozen(rotation_about_axis(frozen(normal), sweep) @ start.rotation)
    )
    offset = zip(start.origin, about.values, normal, strict=True)
    height = sum((p - a) * n for p, a, n in offset)
    x, y, z = (a + height * n for a, n in zip(about.values, normal, strict=True))
    center = x, y, z
    end = Pose(turned, _turn_point(start.origin, center, normal, sweep))
    manner = speed, blend, motion.at_once
    if math.dist(start.origin, center) < 1e-6 or abs(sweep) < 1e-9:
        machine.go(True, end, *manner)
    else:
        _add_arcs(run, start, end, (center, normal, sweep), manner)


def rotate_hand(run: State, motion: Motion) -> None:
    """Run `RotateH [@mark] angle`: a rotation about the tool axis."""
    (goal,) = _exactly(motion, 1)
    angle, start = run.evaluate(goal.value), run.machine.current_pose
    speed, blend = run.read_speed(motion), run.blend_of(goal.mark)
    if isinstance(angle, Unknown):
        target: Pose = name_place(f"the end of the turn of line {run.machine.line}")
    else:
        rotation = frozen(start.rotation @ rotation_about(2, math.radians(number(angle))))
        target = keep_frame(Pose(rotation, start.origin), start)
    run.machine.go(True, target, speed, blend, motion.at_once)


def arch(run: State, motion: Motion) -> None:
    """Run `ArchMove target, height[, ...]`: up, across and down."""
    if len(motion.goals) < 2:
        raise Wrong("ArchMove needs a target and a height")
    target, height = run.place_of(motion.goals[0].value), run.evaluate(motion.goals[1].value)
    start, speed = run.machine.current_pose, run.read_speed(motion)
    stored = isinstance(target, ExternalPose) or isinstance(start, ExternalPose)
    if not isinstance(target, Pose) or stored or isinstance(height, Unknown):
        arch_text = f"the arch of line {run.machine.line}"
        run.log.assume(f"{arch_text} is shown without its height, which is not in the text")
        run.go(False, target, speed, 0.0)
        return
    top = min(start.origin[2], target.origin[2]) + number(height)
    for place in (
        Pose(start.rotation, (*start.origin[:2], top)),
        Pose(target.rotation, (*target.origin[:2], top)),
    ):
        run.machine.go(False, place, speed, PASS_MM)
    run.machine.go(False, target, speed, 0.0)


def drive(run: State, axes_of_motion: Axes, relative: bool) -> None:
    """Run `Drive` (relative) or `DriveA` for single axes."""
    mark, axes, motion = axes_of_motion
    speed, blend = run.read_speed(motion), run.blend_of(mark)
    if isinstance(axes, Node):
        value = fit(run.evaluate(axes), "joint")
        if isinstance(value, Joints):
            amounts: dict[int, Value] = {
                k + 1: math.degrees(angle) for k, angle in enumerate(value.values[:6])
            }
        elif isinstance(value, Unknown):
            run.go(False, value, speed, blend, motion.at_once)
            return
        else:
            raise Wrong(f"{describe_value(value)} is not a joint value")
    else:
        amounts = {}
        for axis, amount_node in axes:
            which, amount = run.evaluate(axis), run.evaluate(amount_node)
            if not isinstance(which, Unknown):
                amounts[index(number(which))] = _axis_value(amount, int(number(which)))
    _drive(run, amounts, relative, (speed, blend, motion.at_once))


def _axis_value(value: Value, axis: int) -> Value:
    if isinstance(value, Joints):
        return math.degrees(value.values[axis - 1]) if 1 <= axis <= len(value.values) else 0.0
    return value


def _drive(
    run: State, amounts: dict[int, Value], relative: bool, manner: tuple[Speed, float, bool]
) -> None:
    machine = run.machine
    if any(axis > 6 for axis in amounts):
        others = {axis: amounts[axis] for axis in sorted(amounts) if axis > 6}
        values = {}
        for axis, value in others.items():
            start = machine.others.setdefault(axis, 0.0 if relative else math.nan)
            amount = math.nan if isinstance(value, Unknown) else number(value)
            if amount or not relative:
                values[axis] = start + amount if relative else amount
        machine.move_others(values, ", ".join(f"axis {axis} moves" for axis in others))
        amounts = {axis: value for axis, value in amounts.items() if axis <= 6}
        if not amounts:
            return
    now = machine.joints.values if machine.joints else ()
    whole = not relative and set(amounts) >= set(range(1, 7))
    if find_first_unknown(amounts.values()) is not None or not (now or whole):
        run.go(False, name_place(f"where the axes of line {machine.line} lead"), *manner)
        return
    joint_values = [*now, *[0.0] * (max(0, *amounts) - len(now))]
    for axis, value in amounts.items():
        joint_values[axis - 1] = math.radians(number(value)) + (
            joint_values[axis - 1] if relative else 0.0
        )
    machine.go_joints(Joints(tuple(joint_values)), *manner)


def go_home(run: State, _parts: object) -> None:
    """Run `GoHome`."""
    home = run.machine.home
    if not isinstance(home, (Pose, Joints)):
        home = name_place("the home position of the controller")
    run.go(False, home, run.machine.internal, 0.0)
