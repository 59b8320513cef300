"""RAPID's interrupts and their TRAPs (technical reference manual, interrupts).

The program text does not determine whether an interrupt comes. An interrupt does not come, unless
the user gives its TRAP a value: then it comes once, at the first place where it may. A TRAP that
was not run is run after the program, and its effects are reported and then undone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from camgen.lang.beside import sum_up

from .effects import DEFINED
from .instructions import EFFECTS
from .machine import InterruptKey, Machine
from .motions import Trigger
from .tree import Calling, Connect, Expr, Routine


def _key(machine: Machine, interrupt: Expr | None) -> InterruptKey | None:
    place = machine.place(interrupt)
    return None if place is None else (id(place[0]), place[1])


def connect(machine: Machine, item: Connect) -> None:
    """Run ``CONNECT interrupt WITH trap``."""
    routine = machine.routine(item.trap)
    if routine is None:
        machine.log.leave_out(f"the TRAP {item.trap} is in none of the files: it is left out")
        return
    key = _key(machine, item.target)
    if key is not None:
        machine.connected[key] = routine
    comes = machine.given(item.trap) not in (None, 0.0)
    what = "comes once, where it first may" if comes else "does not come"
    machine.log.assume(f"the interrupt {item.trap} {what}", item.trap.lower(), float(comes))


def queue_trap(machine: Machine, interrupt: Expr | None) -> None:
    """Let the TRAP of an interrupt run after this statement, once, if the user wants it to come."""
    key = _key(machine, interrupt)
    routine = None if key is None else machine.connected.get(key)
    if routine is None or key in machine.asleep or not machine.given(routine.name):
        return
    if routine not in machine.arrived:
        machine.arrived.add(routine)
        machine.due.append(routine)


def _arm(machine: Machine, call: Calling) -> None:
    queue_trap(machine, call.args[-1] if call.args else None)


def _watch(machine: Machine, call: Calling) -> None:
    """Switch an interrupt off (ISleep) or on again (IWatch), or remove it (IDelete)."""
    key = _key(machine, call.argument(0))
    if key is None:
        return
    if call.name == "idelete":
        machine.connected.pop(key, None)
    elif call.name == "isleep":
        machine.asleep.add(key)
    else:
        machine.asleep.discard(key)
        queue_trap(machine, call.args[0])


def _disable(machine: Machine, call: Calling) -> None:
    machine.held = call.name == "idisable"


def _define(machine: Machine, call: Calling) -> None:
    """Define a trigger: TriggInt has an interrupt. Triggers of the others switch nothing."""
    if call.name in DEFINED:
        machine.log.leave_out(f"{call.name}: {DEFINED[call.name]}")
    elif call.name == "triggcheckio":
        machine.log.omit("triggcheckio: a check of a signal on the way")
    if not call.args:
        return
    options = dict(call.options)
    place = machine.number(call.argument(1, 0.0))
    distance = place if type(place) is float and "time" not in options else 0.0
    interrupt = call.args[-1] if call.name == "triggint" and len(call.args) > 2 else None
    machine.assign(call.args[0], Trigger(distance, "start" in options, (), interrupt))


EFFECTS.update(
    {
        **dict.fromkeys(
            (
                "isignalai", "isignalao", "isignaldi", "isignaldo", "isignalgi", "isignalgo",
                "itimer", "ipers", "ierror", "ivarvalue", "icap", "ipathpos", "irmqmessage",
            ),
            _arm,
        ),
        **dict.fromkeys(("isleep", "iwatch", "idelete"), _watch),
        **dict.fromkeys(("idisable", "ienable"), _disable),
        **dict.fromkeys(("triggint", "triggcheckio", "triggspeed", "triggrampao"), _define),
    }
)  # fmt: skip


# TRAPs that the program did not run --------------------------------------------------------------


def run_trap_aside(machine: Machine, routine: Routine, run: Callable[[], object]) -> None:
    """Run a TRAP by calling `run`, report its effects and undo them.

    Its findings count as unusual, since the values of data when the interrupt comes are unknown. A
    finding of harm counts as possible.
    """
    with _aside(machine) as begin:
        run()
        instructions = machine.body[begin:]
        findings = machine.log.list_findings()
    machine.log.fact("interrupts", f"{routine.name} (line {routine.line}): {sum_up(instructions)}")
    for finding in findings:
        # An index that is out of range now may be in range when the interrupt comes.
        if not machine.log.has(finding) and not finding.what.startswith("element "):
            what = f"in the TRAP {routine.name}, where it comes: {finding.what}"
            is_harm = finding.level == "dangerous"
            machine.log.find("possible" if is_harm else "unusual", what, line=finding.line)


@contextmanager
def _aside(machine: Machine) -> Iterator[int]:
    """Undo all effects of the block except values of data.

    Yields the index of the first instruction of the block.
    """
    kept = {name: getattr(machine, name) for name in _KEPT}
    copies = {name: getattr(machine, name).copy() for name in _COPIED}
    begin, frames = len(machine.body), len(machine.frames)
    machine.blending = 0
    try:
        yield begin
    finally:
        for name, value in (kept | copies).items():
            setattr(machine, name, value)
        machine.cut(begin)
        del machine.frames[frames:]


_KEPT = (
    "scope", "line", "position", "displaced", "frame", "blending", "pressing", "welding", "held",
    "speed_override", "speed_most", "passes_circle_point", "has_conf_l", "external", "placed_here",
)  # fmt: skip
_COPIED = ("log", "outputs", "frame_keys", "placed", "connected", "asleep", "arrived", "due")
