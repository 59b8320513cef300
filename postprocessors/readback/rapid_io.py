"""RAPID statements that do not move: signals, waits, supervision, the force sensor."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from camgen.ir import Output, Wait

from .rapid_lexis import Wrong
from .rapid_state import State
from .rapid_tree import Call, Ref


def _signal(state: State, call: Call) -> str:
    """The logical name of the signal that is the first argument."""
    if call.options:
        raise Wrong(call.line, f"\\{call.options[0][0][:40]} of {call.name} is not read")
    if not call.args or not isinstance(call.args[0], Ref):
        raise Wrong(call.line, f"{call.name} needs the name of a signal")
    name = call.args[0].name
    if len(name) > state.known.longest_name:
        raise Wrong(call.line, f"{name[:40]} is longer than {state.known.longest_name} characters")
    return state.known.signals.get(name.lower(), name)


def _set_signal(state: State, call: Call) -> None:
    """SetDO, SetAO: a signal and its value."""
    signal = _signal(state, call)
    if len(call.args) != 2:
        raise Wrong(call.line, f"{call.name} has 2 arguments, not {len(call.args)}")
    value = cast(float, state.scope.value(call.args[1], "num", call.line))
    if call.name == "setdo" and value not in (0, 1):
        raise Wrong(call.line, "a digital output is 0 or 1")
    state.stopped(call.name)
    state.add(Output(signal, value), call.line)


def _switch_signal(state: State, call: Call) -> None:
    """Set, Reset: a signal."""
    signal = _signal(state, call)
    if len(call.args) != 1:
        raise Wrong(call.line, f"{call.name} has 1 argument, not {len(call.args)}")
    state.stopped(call.name)
    state.add(Output(signal, 1.0 if call.name == "set" else 0.0), call.line)


def _wait(state: State, call: Call) -> None:
    """WaitTime. With InPos it waits for standstill first: a wait of 0 s then adds nothing to the stop before it."""
    switches = [name for name, _ in call.options]
    if switches not in ([], ["inpos"]) or any(value is not None for _, value in call.options):
        raise Wrong(call.line, f"\\{switches[0][:40]} of waittime is not read")
    if len(call.args) != 1:
        raise Wrong(call.line, f"waittime has 1 argument, not {len(call.args)}")
    seconds = cast(float, state.scope.value(call.args[0], "num", call.line))
    if seconds < 0:
        raise Wrong(call.line, "a wait must not be negative")
    state.stopped(call.name)
    if seconds > 0 or not switches:
        state.add(Wait(seconds), call.line)


def _configuration(_state: State, call: Call) -> None:
    """ConfL, ConfJ: switch the supervision of the posture, which no instruction holds."""
    if call.args or call.options not in ((("on", None),), (("off", None),)):
        raise Wrong(call.line, f"{call.name} needs \\On or \\Off")


def _calibrate(state: State, call: Call) -> None:
    """FCCalib: sets the force sensor to zero, with the load of the tool."""
    if len(call.args) != 1 or call.options:
        raise Wrong(call.line, "fccalib needs one loaddata")
    load = call.args[0]
    if not (isinstance(load, Ref) and load.name.lower() == state.known.load.lower() and not state.scope.known(load)):
        state.scope.value(load, "loaddata", call.line)
    if state.pressing is not None:
        raise Wrong(call.line, "fccalib while pressing")
    state.stopped(call.name)


STATEMENTS: dict[str, Callable[[State, Call], None]] = {
    "setdo": _set_signal, "setao": _set_signal, "set": _switch_signal, "reset": _switch_signal, "waittime": _wait,
    "confl": _configuration, "confj": _configuration, "fccalib": _calibrate,
}  # fmt: skip
