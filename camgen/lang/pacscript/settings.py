"""What the statements of PacScript that move nothing do: arm, speeds, frames, delays, force."""

from __future__ import annotations

from typing import Any

from camgen.lang.pacscript.code import Op
from camgen.lang.pacscript.evaluate import evaluate, fit
from camgen.lang.pacscript.running import Running
from camgen.lang.pacscript.values import Rate, Unknown, Value, Wrong, number
from camgen.model.pose import Pose

_LONGEST_DELAY = 2**31 - 1


def checked(run: Running, value: Value) -> float:
    """A speed in % that the controller takes."""
    if isinstance(value, Unknown):
        run.machine.log.assume(
            f"{value.what}, a speed, is taken for the one in force", value.key, run.machine.internal
        )
        return run.machine.internal
    said = number(value, "a speed")
    if isinstance(said, Rate) or isinstance(value, Rate):
        if value.mm_s <= 0:  # type: ignore[union-attr]
            raise Wrong(f"a speed of Mps({value.mm_s:g})")  # type: ignore[union-attr]
        return value  # type: ignore[return-value]
    if not 0.1 <= said <= 100:
        run.machine.log.find("refused", f"a speed of {said:g} %: the controller takes 0.1 to 100")
        return min(100.0, max(0.1, said))
    return said


def take_arm(run: Running, op: Op) -> None:
    """``TakeArm [group] [Keep = 0|1]``."""
    machine = run.machine
    group, keep = (evaluate(run, node) if node is not None else None for node in op.a)
    machine.armed = True
    if isinstance(keep, float) and keep == 0:
        machine.internal = 100.0
        machine.change_frame("tool", 0)
        machine.change_frame("work", 0)
    if isinstance(group, float) and group:
        machine.log.fact("arm group", f"{group:g}")


def give_arm(run: Running, _op: Op) -> None:
    """``GiveArm``."""
    run.machine.armed = False
    run.machine.passing = False


def motor(run: Running, op: Op) -> None:
    """``Motor On|Off``."""
    if not op.a:
        raise Wrong("Motor needs On or Off")
    value = evaluate(run, op.a[0])
    if not isinstance(value, Unknown):
        run.machine.motor = bool(number(value))


def speed_statement(run: Running, op: Op) -> None:
    """``Speed``, for motions without their own."""
    if not op.a:
        raise Wrong("Speed needs a number")
    omit_accelerations(run, op)
    run.machine.internal = checked(run, evaluate(run, op.a[0]))


def omit_accelerations(run: Running, op: Op) -> None:
    """Notes the accelerations in a statement of a speed."""
    if len(op.a) > 1:
        run.machine.log.omit(f"{op.do} with more than one value: accelerations")


def external_speed(run: Running, op: Op) -> None:
    """``ExtSpeed`` in percent of the internal one."""
    value = evaluate(run, op.a[0]) if op.a else 100.0
    omit_accelerations(run, op)
    if isinstance(value, Unknown):
        run.machine.log.assume(
            f"{value.what}, the external speed, is taken for 100 %", value.key, 100.0
        )
        return
    said = number(value)
    if not 0 < said <= 100:
        run.machine.log.find(
            "refused", f"an external speed of {said:g} %: the controller takes up to 100"
        )
        return
    run.machine.external = said
    run.machine.log.fact("external speed", f"{said:g} %")


def change(run: Running, op: Op) -> None:
    """``ChangeTool`` and ``ChangeWork``."""
    kind = op.do.removeprefix("change")
    value = evaluate(run, op.a[0]) if op.a else 0.0
    if isinstance(value, Unknown):
        run.machine.log.assume(f"{value.what}, a {kind} number, is taken for the one in force")
        return
    at = int(number(value))
    if not 0 <= at <= 63:
        run.machine.log.find("refused", f"{kind} {at}: there are 0 to 63")
        return
    run.machine.change_frame(kind, at)


def define(run: Running, op: Op) -> None:
    """``Tool n, P(...)`` and ``Work n, P(...)``."""
    if len(op.a) < 2:
        raise Wrong(f"{op.do.capitalize()} needs a number and a position")
    at, pose = evaluate(run, op.a[0]), fit(evaluate(run, op.a[1]), "position")
    if isinstance(at, Unknown) or not isinstance(pose, Pose):
        run.machine.log.assume(f"a {op.do} frame that the text does not hold")
        return
    run.machine.define_frame(op.do, int(number(at)), Pose(pose.rotation, pose.origin))


def delay(run: Running, op: Op) -> None:
    """``Delay`` in ms."""
    value = evaluate(run, op.a[0]) if op.a else None
    if value is None:
        raise Wrong("Delay needs a number")
    if isinstance(value, Unknown):
        run.machine.log.assume(f"{value.what}, a delay, is taken for 0", value.key)
        return
    said = number(value)
    if not 0 <= said <= _LONGEST_DELAY:
        raise Wrong(f"a delay of {said:g} ms")
    run.machine.wait(said / 1000)


def force_parameter(run: Running, op: Op) -> None:
    """``ForceParam table, frame, P(fx, fy, fz, ...)``; a table that is on presses so from now on."""
    if len(op.a) < 3:
        raise Wrong("ForceParam needs a table, a frame and a force")
    values: list[Any] = [evaluate(run, node) for node in op.a[:3]]
    force, machine = fit(values[2], "position"), run.machine
    if isinstance(force, Pose) and not any(isinstance(one, Unknown) for one in values):
        table = int(number(values[0]))
        machine.forces[table] = (int(number(values[1])), force.origin)
        if machine.table == table and not machine.press(table):
            machine.log.leave_out("a force in a frame that the text does not give is left out")


def force_control(run: Running, op: Op) -> None:
    """``ForceCtrl True, table`` and ``ForceCtrl False``."""
    values = [evaluate(run, node) for node in op.a]
    machine = run.machine
    if any(isinstance(one, Unknown) for one in values) or not values:
        machine.log.leave_out("force control by values that the text does not hold is left out")
        return
    on = bool(number(values[0]))
    if machine.press((int(number(values[1])) if len(values) > 1 else 1) if on else None):
        machine.tell_force()
    else:
        machine.log.leave_out("a force that the text does not give is left out")


def hold(run: Running, _op: Op) -> None:
    """``Hold`` and ``Halt``: until the operator starts again."""
    run.machine.stop()
    run.machine.passing = False


def settle(run: Running, op: Op) -> None:
    """``Arrive`` and ``WaitMotion``: what follows is meant to happen on the way."""
    for node in op.a:
        evaluate(run, node)
    if op.do == "arrive":
        run.machine.log.omit(
            "Arrive: what follows happens on the way; here it waits for the motion"
        )
    else:
        run.machine.log.fact(
            "waits", "WaitMotion waits for the motion, as all that follows one does here"
        )
    run.machine.passing = False


def nothing(run: Running, op: Op) -> None:
    """Something that moves nothing by itself."""
    for node in op.a or ():
        evaluate(run, node)


def interrupt(run: Running, op: Op) -> None:
    """``Interrupt`` and ``MotionSkip``: motions may be cut short."""
    nothing(run, op)
    run.machine.log.assume(
        f"{op.do.capitalize()}: motions that something may cut short are taken to their end"
    )


def set_home(run: Running, op: Op) -> None:
    """``Home p``."""
    if op.a:
        run.machine.home = fit(evaluate(run, op.a[0]), "position")
