"""Names of RAPID programs of a post: faults of declarations, scopes, and unused names."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from camgen.lang.rapid.machine import ModuleScope, RoutineScope
from camgen.lang.rapid.tree import Data, Module, Routine
from camgen.lang.rapid.types import INSTALLED, PREDEFINED, RESIDENT
from camgen.lang.rapid.values import Variable

from .state import State
from .statements import STATEMENTS

#: Types of data that motions need as persistents.
_PERSISTENT = ("tooldata", "wobjdata")
#: Names of the system, which a program may not declare.
_SYSTEM = (INSTALLED | PREDEFINED.keys() | STATEMENTS.keys()) - RESIDENT


def enter_module(state: State, module: Module) -> None:
    """Adds a module. Names that are not legal, or not new in their scope, are findings."""
    key = module.name.lower()
    if key in state.module_names:
        state.log.find("refused", f"a second module {module.name}", line=module.line)
    elif key in state.data or key in state.routines:
        what = f"the module {module.name} has the name of something global"
        state.log.find("refused", what, line=module.line)
    state.modules.append(module)
    state.module_names.add(key)
    _check_name(state, module, is_global=True)
    names: set[str] = set()
    members: tuple[Data | Routine, ...] = (*module.data, *module.routines)
    for member in members:
        _check_member(state, member, names)
        names.add(member.name.lower())
    home = ModuleScope(module.name)
    for routine in module.routines:
        state.homes[routine] = home
        routines = home.routines if routine.local else state.routines
        routines[routine.name.lower()] = routine
    for data in module.data:
        variables = home.data if data.local else state.data
        variable = variables[data.name.lower()] = state.declare(data, home)
        state.declared.append(variable)


def _check_member(state: State, member: Data | Routine, names: Collection[str]) -> None:
    """Adds findings for the name of a member.

    names: names of the members before it, in lower case.
    """
    key, line, is_global = member.name.lower(), member.line, not member.local
    _check_name(state, member, is_global=is_global)
    if key in names or (is_global and (key in state.data or key in state.routines)):
        state.log.find("refused", f"{member.name} is declared twice", line=line)
    if is_global and key in state.module_names:
        what = f"{member.name} is global and has the name of a module"
        state.log.find("refused", what, line=line)
    if isinstance(member, Data) and member.storage == "pers" and member.type not in _PERSISTENT:
        what = f"{member.name} is PERS: an earlier run or another task may have changed it"
        state.log.find("refused", what, line=line)


def _check_name(state: State, item: Module | Data | Routine, *, is_global: bool) -> None:
    name, line, longest = item.name, item.line, state.settings.longest_name
    if len(name) > longest:
        state.log.find("refused", f"{name[:40]} is longer than {longest} characters", line=line)
    if name.lower() in _SYSTEM:
        state.log.find("refused", f"{name} is predefined", line=line)
    if is_global and name.lower() in RESIDENT:
        what = f"{name} is the name of a system module or of what one declares"
        state.log.find("refused", what, line=line)


def open_scopes(state: State) -> None:
    """Makes the scope of each routine, and evaluates every declaration, used or not."""
    _evaluate(state, state.declared)
    shared = RoutineScope(None, ModuleScope(""))
    for routine, home in state.homes.items():
        # Routines without data share a scope. The arguments of a motion are bound once in it.
        if shared.home is not home:
            shared = RoutineScope(None, home)
        state.scopes[routine] = shared
        if routine.data:
            scope = state.scope = state.scopes[routine] = RoutineScope(routine, home)
            for data in routine.data:
                _check_name(state, data, is_global=False)
                scope.data[data.name.lower()] = state.declare(data, home)
            _evaluate(state, scope.data.values())
    state.scope = RoutineScope(None, ModuleScope(""))


def _evaluate(state: State, variables: Iterable[Variable]) -> None:
    for variable in variables:
        if variable.start is not None:
            state.load(variable)


def list_unused(state: State) -> Iterator[Data | Routine]:
    """Routines and data of modules that neither main nor an ERROR handler uses.

    Tool and work object of the options may be unused.
    """
    used = state.used | {name.lower() for name in state.settings.names.values()}
    for module in state.modules:
        yield from (item for item in module.data if item.name.lower() not in used)
        for routine in module.routines:
            if routine not in state.ran and routine not in state.handling:
                yield routine
