"""Names of RAPID programs of a post: faults of declarations, scopes, and unused names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from camgen.lang.rapid.machine import ModuleScope, RoutineScope
from camgen.lang.rapid.tree import Data, Module, Routine
from camgen.lang.rapid.types import PREDEFINED, RESIDENT
from camgen.lang.rapid.values import Variable
from camgen.lang.rapid.words import INSTALLED

from .state import State
from .statements import MOTIONS, STATEMENTS

#: Names of the system, which a program may not declare.
_SYSTEM = (INSTALLED | PREDEFINED.keys() | MOTIONS.keys() | STATEMENTS.keys()) - RESIDENT


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
    _check_legal(state, module.name, module.line)
    _check_new(state, module.name, module.line)
    members: tuple[Data | Routine, ...] = (*module.data, *module.routines)
    if not _are_new(state, members):
        _check_each(state, members)
    home = ModuleScope(module.name)
    for routine in module.routines:
        state.homes[routine] = home
        routines = home.routines if routine.local else state.routines
        routines[routine.name.lower()] = routine
    for data in module.data:
        variables = home.data if data.local else state.data
        variable = variables[data.name.lower()] = state.declare(data, home)
        state.declared.append(variable)


def _are_new(state: State, members: Sequence[Data | Routine]) -> bool:
    """Whether all members of a module have legal and new names. Tests all names together."""
    keys = {item.name.lower() for item in members}
    taken = (_SYSTEM, RESIDENT, state.module_names, state.data.keys(), state.routines.keys())
    longest = max((len(item.name) for item in members), default=0)
    is_short = longest <= state.settings.longest_name
    return len(keys) == len(members) and is_short and all(map(keys.isdisjoint, taken))


def _check_each(state: State, members: Sequence[Data | Routine]) -> None:
    names: set[str] = set()
    for item in members:
        key = item.name.lower()
        _check_legal(state, item.name, item.line)
        if not item.local:
            _check_new(state, item.name, item.line)
        if key in names or (not item.local and (key in state.data or key in state.routines)):
            state.log.find("refused", f"{item.name} is declared twice", line=item.line)
        if not item.local and key in state.module_names:
            what = f"{item.name} is global and has the name of a module"
            state.log.find("refused", what, line=item.line)
        names.add(key)


def _check_legal(state: State, name: str, line: int) -> None:
    longest = state.settings.longest_name
    if len(name) > longest:
        state.log.find("refused", f"{name[:40]} is longer than {longest} characters", line=line)
    if name.lower() in _SYSTEM:
        state.log.find("refused", f"{name} is predefined", line=line)


def _check_new(state: State, name: str, line: int) -> None:
    if name.lower() in RESIDENT:
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
                _check_legal(state, data.name, data.line)
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
    used = state.used | {name.lower() for name in state.settings.expected.names.values()}
    for module in state.modules:
        yield from (item for item in module.data if item.name.lower() not in used)
        for routine in module.routines:
            if routine not in state.ran and routine not in state.handling:
                yield routine
