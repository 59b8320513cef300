"""Runs PacScript statements without a motion: arm, speeds, frames, delays, force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from camgen.lang.pacscript.evaluate import evaluate_all, fit
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import get_value
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import Rate, Speed, Value, Wrong, number
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.pose import Pose
from camgen.model.program import Force

#: Longest delay, ms, and highest number of a tool or work frame (RC8 manual 1943).
LONGEST_DELAY, LAST_FRAME = 2**31 - 1, 63

Nodes = Sequence[Node]


def check_speed(run: State, value: Value) -> Speed:
    """Convert a value to a speed in % that the controller accepts."""
    if isinstance(value, Unknown):
        internal = run.machine.internal
        assert isinstance(internal, float)
        what = f"{value.what}, a speed, is assumed to be the one in force"
        run.machine.log.assume(what, value.key, internal)
        return internal
    percentage = number(value, "a speed")
    if isinstance(value, Rate):
        if value.mm_s <= 0:
            raise Wrong(f"a speed of Mps({value.mm_s:g})")
        return value
    if not 0.1 <= percentage <= 100:
        run.machine.log.find(
            "refused", f"a speed of {percentage:g} %: the controller takes 0.1 to 100"
        )
        return min(100.0, max(0.1, percentage))
    return percentage


def take_arm(run: State, parts: list[Node | None]) -> None:
    """Run `TakeArm [group] [Keep = 0|1]`."""
    machine = run.machine
    group, keep = (run.evaluate(node) if node is not None else None for node in parts)
    machine.armed = True
    if isinstance(keep, float) and keep == 0:
        machine.internal = 100.0
        machine.change_frame("tool", 0)
        machine.change_frame("work", 0)
    if isinstance(group, float) and group:
        machine.log.fact("arm group", f"{group:g}")


def give_arm(run: State, _parts: Nodes) -> None:
    """Run `GiveArm`."""
    run.machine.armed = False
    run.machine.passing = False


def motor(run: State, parts: Nodes) -> None:
    """Run `Motor On|Off`."""
    if not parts:
        raise Wrong("Motor needs On or Off")
    value = run.evaluate(parts[0])
    if not isinstance(value, Unknown):
        run.machine.motor = bool(number(value))


def speed_statement(run: State, parts: Nodes) -> None:
    """Run `Speed`, for motions without their own speed."""
    if not parts:
        raise Wrong("Speed needs a number")
    _omit_accelerations(run, "speed", parts)
    run.machine.internal = check_speed(run, run.evaluate(parts[0]))


def _omit_accelerations(run: State, word: str, parts: Nodes) -> None:
    if len(parts) > 1:
        run.machine.log.omit(f"{word} with more than one value: accelerations")


def external_speed(run: State, parts: Nodes) -> None:
    """Run `ExtSpeed`, in % of the internal speed."""
    value = run.evaluate(next(iter(parts), Node("number", 100.0)))
    _omit_accelerations(run, "extspeed", parts)
    if isinstance(value, Unknown):
        run.machine.log.assume(
            f"{value.what}, the external speed, is assumed to be 100 %", value.key, 100.0
        )
        return
    percentage = number(value)
    if not 0 < percentage <= 100:
        run.machine.log.find(
            "refused", f"an external speed of {percentage:g} %: the controller takes up to 100"
        )
        return
    run.machine.external = percentage
    run.machine.log.fact("external speed", f"{percentage:g} %")


def change(run: State, parts: Nodes, kind: str) -> None:
    """Run `ChangeTool` or `ChangeWork`. kind: tool or work."""
    value = run.evaluate(next(iter(parts), Node("number", 0.0)))
    if isinstance(value, Unknown):
        run.machine.log.assume(f"{value.what}, a {kind} number, is assumed to be the one in force")
        return
    at = int(number(value))
    if not 0 <= at <= LAST_FRAME:
        run.machine.log.find("refused", f"{kind} {at}: there are 0 to 63")
        return
    run.machine.change_frame(kind, at)


def define(run: State, parts: Nodes, kind: str) -> None:
    """Run `Tool n, P(...)` or `Work n, P(...)`. kind: tool or work."""
    if len(parts) < 2:
        raise Wrong(f"{kind.capitalize()} needs a number and a position")
    at, pose = run.evaluate(parts[0]), fit(run.evaluate(parts[1]), "position")
    if isinstance(at, Unknown) or not isinstance(pose, Pose):
        run.machine.log.assume(f"a {kind} frame that the text does not hold")
        return
    run.machine.define_frame(kind, int(number(at)), Pose(pose.rotation, pose.origin))


def delay(run: State, parts: Nodes) -> None:
    """Run `Delay`, in ms."""
    if not parts:
        raise Wrong("Delay needs a number")
    value = run.evaluate(parts[0])
    if isinstance(value, Unknown):
        run.machine.log.assume(f"{value.what}, a delay, is assumed to be 0", value.key)
        return
    milliseconds = number(value)
    if not 0 <= milliseconds <= LONGEST_DELAY:
        raise Wrong(f"a delay of {milliseconds:g} ms")
    run.machine.wait(milliseconds / 1000)


def force_parameter(run: State, parts: Nodes) -> None:
    """Run `ForceParam table, frame, P(fx, fy, fz, ...)`. A table in force changes at once."""
    if len(parts) < 3:
        raise Wrong("ForceParam needs a table, a frame and a force")
    values: list[Any] = evaluate_all(run, parts[:3])
    force, machine = fit(values[2], "position"), run.machine
    if isinstance(force, Pose) and find_first_unknown(values) is None:
        table = int(number(values[0]))
        machine.forces[table] = (int(number(values[1])), force.origin)
        if machine.table == table and not machine.press(table):
            machine.log.leave_out("a force in a frame that the text does not give is left out")


def force_control(run: State, parts: Nodes) -> None:
    """Run `ForceCtrl True, table` or `ForceCtrl False`."""
    values = evaluate_all(run, parts)
    machine = run.machine
    if find_first_unknown(values) is not None or not values:
        machine.log.leave_out("force control by values that the text does not hold is left out")
        return
    force_set = None
    if number(values[0]):
        force_set = int(number(get_value(values, 1, 1.0)))
    if machine.press(force_set):
        machine.emit(Force(*machine.pressing))
    else:
        machine.log.leave_out("a force that the text does not give is left out")


def wait_for_operator(run: State, _parts: Nodes) -> None:
    """Run `Hold` or `Halt`, until the operator starts again."""
    run.machine.stop()


def arrive(run: State, parts: Nodes) -> None:
    """Note `Arrive`, which lets the next statement run during the motion."""
    evaluate_all(run, parts)
    run.log.omit("Arrive: the next statement runs during the motion; here it waits for the motion")
    run.machine.passing = False


def wait_for_motion(run: State, parts: Nodes) -> None:
    """Note `WaitMotion`."""
    evaluate_all(run, parts)
    run.log.fact("waits", "WaitMotion waits for the motion, as all that follows one does here")
    run.machine.passing = False


def cut_short(run: State, parts: Nodes, word: str) -> None:
    """Note `Interrupt` or `MotionSkip`, which may end a motion early."""
    evaluate_all(run, parts)
    run.log.assume(f"{word}: motions that may be cut short run to their end here")


def set_home(run: State, parts: Nodes) -> None:
    """Run `Home p`."""
    if parts:
        run.machine.home = fit(run.evaluate(parts[0]), "position")
