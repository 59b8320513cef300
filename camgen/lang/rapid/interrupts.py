"""RAPID's interrupts: which TRAP is connected to what, and whether it comes (technical reference manual, interrupts).

No text holds whether an interrupt comes. It does not, unless the user says so by the name of its TRAP: then it comes
once, where it first may. What a TRAP that is not run would do is looked at beside the program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from camgen.lang.beside import sum_up

from .effects import DEFINED
from .instructions import EFFECTS
from .machine import Machine
from .motions import Trigger
from .tree import Calling, Connect, Expr, Routine


def _key(machine: Machine, interrupt: Expr) -> tuple[int, tuple[int, ...]] | None:
    """Which interrupt an expression means."""
    found = machine.place(interrupt)
    return None if found is None else (id(found[0]), found[1])


def connect(machine: Machine, item: Connect) -> None:
    """``CONNECT interrupt WITH trap``."""
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
    """An interrupt may come from here on: where the user says that it comes, its TRAP runs behind this statement."""
    key = _key(machine, interrupt) if interrupt is not None else None
    routine = machine.connected.get(key) if key is not None else None
    if routine is None or key in machine.asleep or not machine.given(routine.name):
        return
    if routine not in machine.arrived:
        machine.arrived.add(routine)
        machine.due.append(routine)


def _arm(machine: Machine, call: Calling) -> None:
    """ISignalDI, ITimer, IPers and the like: the interrupt is their last argument."""
    queue_trap(machine, call.args[-1] if call.args else None)


def _watch(machine: Machine, call: Calling) -> None:
    """ISleep, IWatch, IDelete: interrupts that are off, on again, and gone."""
    key = _key(machine, call.args[0]) if call.args else None
    if key is None:
        return
    if call.name == "idelete":
        machine.connected.pop(key, None)
    elif call.name == "isleep":
        machine.asleep.add(key)
    else:
        machine.asleep.discard(key)
        queue_trap(machine, call.args[0])


def _hold(machine: Machine, call: Calling) -> None:
    """IDisable, IEnable: all of them wait."""
    machine.held = call.name == "idisable"


def _define(machine: Machine, call: Calling) -> None:
    """TriggInt: an interrupt at a place of a motion. The others switch nothing here."""
    if call.name in DEFINED:
        machine.log.leave_out(f"{call.name}: {DEFINED[call.name]}")
    elif call.name == "triggcheckio":
        machine.log.omit("triggcheckio: a check of a signal on the way")
    if not call.args:
        return
    options = dict(call.options)
    place = machine.number(call.args[1]) if len(call.args) > 1 else 0.0
    distance = place if type(place) is float and "time" not in options else 0.0
    interrupt = call.args[-1] if call.name == "triggint" and len(call.args) > 2 else None
    machine.assign(call.args[0], Trigger(distance, "start" in options, (), interrupt))


EFFECTS.update(
    {
        **dict.fromkeys(
            (
                "isignalai", "isignalao", "isignaldi", "isignaldo", "isignalgi", "isignalgo", "itimer", "ipers",
                "ierror", "ivarvalue", "icap", "ipathpos", "irmqmessage",
            ),
            _arm,
        ),
        **dict.fromkeys(("isleep", "iwatch", "idelete"), _watch),
        **dict.fromkeys(("idisable", "ienable"), _hold),
        **dict.fromkeys(("triggint", "triggcheckio", "triggspeed", "triggrampao"), _define),
    }
)  # fmt: skip


# What a TRAP that is not run would do ---------------------------------------------------------------------------


def run_trap_aside(machine: Machine, routine: Routine, run: Callable[[], object]) -> None:
    """Lets ``run`` run a TRAP, and tells what it does; nothing of it stays. What is refused on this way is unusual: it
    is not known what the data are worth when the TRAP comes.
    """
    with _aside(machine) as begin:
        run()
        done = machine.body[begin:]
        findings = machine.log.list_findings()
    machine.log.fact("interrupts", f"{routine.name} (line {routine.line}): {sum_up(done)}")
    for finding in findings:
        is_known = machine.log.has(finding) or finding.level == "dangerous"
        # The value of an index depends on what the program has done so far.
        if not is_known and not finding.what.startswith("element "):
            what = f"in the TRAP {routine.name}, where it comes: {finding.what}"
            machine.log.find("unusual", what, line=finding.line)


@contextmanager
def _aside(machine: Machine) -> Iterator[int]:
    """What is done within leaves nothing behind but what data are worth; the place in the body where it begins."""
    kept = {name: getattr(machine, name) for name in _KEPT}
    copies = {name: getattr(machine, name).copy() for name in ("log", "outputs", "frame_keys")}
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
    "speed_override", "speed_most", "passes_circle_point",
)  # fmt: skip
