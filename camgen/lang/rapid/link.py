"""RAPID modules put together: who sees which name, what is declared twice, where the program begins."""

from __future__ import annotations

from collections.abc import Sequence

from .code import Do, compile_routines, list_called, moves
from .machine import Machine, ModuleScope
from .polled import find_polled
from .tokens import Wrong
from .tree import Module, Record, Routine

#: The longest name (kernel manual, identifiers).
_LONGEST_NAME = 32


def link(machine: Machine, modules: Sequence[Module], do: Do) -> Routine | None:
    """Enters the modules, and the routine where the program begins, if there is one.

    do: carries out a statement.
    """
    for module in modules:
        for record in module.records:
            _enter_record(machine, record)
    seen: dict[str, int] = {}
    for module in modules:
        _check_names(machine, module, seen)
    for module in modules:
        _enter(machine, module)
    machine.codes = compile_routines(
        machine.homes, do, lambda routine, key: machine.find_routine(machine.homes[routine], key)
    )
    machine.polled.update(find_polled(machine.data, machine.codes.values()))
    _value_all(machine)
    return _find_entry(machine, modules)


def _value_all(machine: Machine) -> None:
    """Works out what all data are worth at first, so that what is wrong is told though nothing uses it."""
    homes = {id(home): home for home in machine.homes.values()}
    for level in (machine.data, *(home.data for home in homes.values())):
        for variable in list(level.values()):
            try:
                if variable.start is not None:
                    machine.load(variable)
            except Wrong as wrong:
                machine.log.find("refused", wrong.what, line=wrong.line)


def _enter_record(machine: Machine, record: Record) -> None:
    if record.alias:
        machine.aliases[record.name] = record.components[0][0]
    else:
        machine.types[record.name] = tuple((name, kind) for kind, name in record.components)


def _check_names(machine: Machine, module: Module, seen: dict[str, int]) -> None:
    """Notes names that are too long or declared twice where they are seen."""
    own: dict[str, int] = {}
    items = [
        *((d.name, d.line, d.local) for d in module.data),
        *((r.name, r.line, r.local) for r in module.routines),
    ]
    for name, line, local in items:
        key = name.lower()
        if len(name) > _LONGEST_NAME:
            machine.log.find(
                "refused", f"{name[:40]} is longer than {_LONGEST_NAME} characters", line=line
            )
        before = own.get(key) or (None if local else seen.get(key))
        if before:
            machine.log.find(
                "refused", f"{name[:40]} is declared twice, first in line {before}", line=line
            )
        own[key] = own.get(key, line)
        if not local and key == module.name.lower():
            what = f"{name[:40]} has the name of its module: the controller cannot tell them apart"
            machine.log.find("refused", what, line=line)
        if not local:
            seen[key] = seen.get(key, line)
    for routine in module.routines:
        inner = {one.name for one in routine.parameters}
        for data in routine.data:
            key = data.name.lower()
            if key in inner:
                machine.log.find(
                    "refused",
                    f"{data.name[:40]} is declared twice in {routine.name}",
                    line=data.line,
                )
            inner.add(key)


def _enter(machine: Machine, module: Module) -> None:
    home = ModuleScope(module.name)
    for routine in module.routines:
        machine.homes[routine] = home
        key = routine.name.lower()
        if routine.local:
            home.routines.setdefault(key, routine)
        else:
            machine.routines.setdefault(key, routine)
    for data in module.data:
        key = data.name.lower()
        place = home.data if data.local else machine.data
        known = place.get(key)
        if known is None or (
            known.storage == "pers" and known.start is None and data.value is not None
        ):
            place[key] = machine.declare(data, home)


def _find_entry(machine: Machine, modules: Sequence[Module]) -> Routine | None:
    """The routine that the user names, or main, or the first that can be run and that no other calls."""
    wanted = machine.ask.entry.lower()
    found = machine.routines.get(wanted or "main")
    if found is None and wanted:
        found = next((r for m in modules for r in m.routines if r.name.lower() == wanted), None)
        if found is None:
            machine.log.find(
                "refused", f"there is no PROC {machine.ask.entry[:40]}, which is asked for", line=1
            )
            return None
    idle = found is not None and not wanted and not found.body
    if (
        found is not None
        and not idle
        and found.kind == "proc"
        and all(one.optional for one in found.parameters)
    ):
        machine.log.fact("entry", found.name)
        return found
    ready = [
        routine
        for module in modules
        for routine in module.routines
        if routine.kind == "proc"
        and (routine.body or found is None)
        and all(p.optional for p in routine.parameters)
    ]
    if not ready and found is not None and found.kind == "proc":
        ready = [found]
    if not ready:
        machine.log.fact("entry", "none: no PROC can be run by itself")
        return None
    return _first_of(machine, modules, ready)


def _first_of(machine: Machine, modules: Sequence[Module], ready: list[Routine]) -> Routine:
    """The first of the routines that no other calls, one that moves before others."""
    called = {
        name
        for module in modules
        for routine in module.routines
        for name in list_called(machine.codes[routine])
        if name != routine.name.lower()
    }
    free = [routine for routine in ready if routine.name.lower() not in called] or ready
    moving = (routine for routine in (*free, *ready) if moves(machine.codes[routine]))
    chosen = next(moving, free[0])
    why = "main does nothing" if "main" in machine.routines else "there is no main"
    machine.log.fact("entry", f"{chosen.name}, as {why}")
    return chosen
