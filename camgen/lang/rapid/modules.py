"""Runs ABB RAPID modules of any origin: links them, chooses the entry, and runs it.

Sources: the kernel manual for the language, the technical reference manual for instructions and
functions. docs/languages/rapid.md states the limits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain

from camgen.lang.coverage import measure_coverage
from camgen.lang.programs import Executed, RunRequest, index_frames, strip_mark, unify_line_ends
from camgen.model.program import pack

from .code import compile_routines, list_called, moves
from .grammar import parse
from .machine import Machine, ModuleScope
from .polled import find_polled
from .run import Runner, report_end, run_entry
from .tokens import Wrong
from .tree import Data, Module, Routine
from .values import Variable

#: The longest name (kernel manual, identifiers).
_LONGEST_NAME = 32


def run_modules(files: Mapping[str, str], request: RunRequest) -> Executed:
    """The effects of the modules' entry, run once. Raises nothing, whatever the text."""
    machine = Machine(request)
    modules: list[Module] = []
    line = 1
    for name, text in files.items():
        plain = unify_line_ends(strip_mark(text)).rstrip("\x00\x1a")
        if "\x00" in plain[:1000]:
            what = "controllers write modules that may not be seen like this"
            machine.log.find("refused", f"{name[-60:]} is not text: {what}", line=line)
            line += plain.count("\n") + 1
        else:
            modules += parse(plain, line, machine.log)
            line += plain.count("\n") + (not plain.endswith("\n"))
    entry = _link(machine, modules)
    stopped = None if entry is None else run_entry(machine, entry, line)
    if entry is not None and stopped is None:
        report_end(machine, entry.last or entry.line)
    return Executed(
        body=pack(machine.body),
        lines=tuple(machine.lines),
        frames=tuple(machine.frames),
        frame=index_frames(machine.frames, machine.frame_of),
        stopped=stopped,
        coverage=measure_coverage(machine.codes.values(), machine.log.ran, machine.line),
        **machine.log.list_all("; ", 8),
    )


# Links: enters the names of the modules, finds those declared twice, chooses the entry.


def _link(machine: Machine, modules: Sequence[Module]) -> Routine | None:
    """Enter the modules into the machine. Returns the entry of the program, None without one."""
    for module in modules:
        for record in module.records:
            if record.alias:
                machine.aliases[record.name] = record.components[0][0]
            else:
                machine.types[record.name] = tuple((name, kind) for kind, name in record.components)
    seen: dict[str, int] = {}
    for module in modules:
        _check_names(machine, module, seen)
    for module in modules:
        _enter(machine, module)
    machine.codes = compile_routines(
        machine.homes,
        Runner.perform,
        lambda routine, key: machine.find_routine(machine.homes[routine], key),
    )
    _choose_polled(machine, find_polled(machine.data, machine.codes.values()))
    _evaluate_all(machine)
    return _find_entry(machine, modules)


def _choose_polled(machine: Machine, polled: Sequence[Variable]) -> None:
    """Take the values of the text for data that are set outside of it; another run has none.

    A value that the user gives counts in each run.
    """
    is_given = {variable: variable.name.lower() in machine.request.assume for variable in polled}
    machine.polled.update(variable for variable in polled if is_given[variable])
    rest = [variable for variable in polled if not is_given[variable]]
    if rest:
        names = ", ".join(variable.name for variable in rest)
        machine.line = rest[0].line
        machine.log.fact("set outside", f"{names}: the run has the values of the text")
        if machine.log.decide(f"{names}, set outside of this program", 0, 2):
            machine.polled.update(rest)


def _evaluate_all(machine: Machine) -> None:
    homes = {id(home): home for home in machine.homes.values()}
    for level in (machine.data, *(home.data for home in homes.values())):
        for variable in list(level.values()):
            try:
                if variable.start is not None:
                    machine.load(variable)
            except Wrong as wrong:
                machine.log.find("refused", wrong.what, line=wrong.line)


def _check_names(machine: Machine, module: Module, seen: dict[str, int]) -> None:
    """Refuse names that are too long or are declared twice in one scope.

    seen: line of each global name of the modules before. The module's own ones are added.
    """
    module_lines: dict[str, int] = {}
    declarations: list[Data | Routine] = [*module.data, *module.routines]
    for item in declarations:
        name, line, key = item.name, item.line, item.name.lower()
        if len(name) > _LONGEST_NAME:
            what = f"{name[:40]} is longer than {_LONGEST_NAME} characters"
            machine.log.find("refused", what, line=line)
        first = module_lines.get(key) or (None if item.local else seen.get(key))
        if first:
            what = f"{name[:40]} is declared twice, first in line {first}"
            machine.log.find("refused", what, line=line)
        module_lines.setdefault(key, line)
        if item.local:
            continue
        if key == module.name.lower():
            what = f"{name[:40]} has the name of its module: the controller cannot distinguish them"
            machine.log.find("refused", what, line=line)
        seen.setdefault(key, line)
    for routine in module.routines:
        names = {parameter.name for parameter in routine.parameters}
        for data in routine.data:
            key = data.name.lower()
            if key in names:
                what = f"{data.name[:40]} is declared twice in {routine.name}"
                machine.log.find("refused", what, line=data.line)
            names.add(key)


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
        names = home.data if data.local else machine.data
        before = names.get(key)
        # A PERS without a value is replaced by one of another module with a value.
        has_no_value = before is not None and before.storage == "pers" and before.start is None
        if before is None or (has_no_value and data.value is not None):
            names[key] = machine.declare(data, home)


def _find_entry(machine: Machine, modules: Sequence[Module]) -> Routine | None:
    wanted = machine.request.entry.lower()
    routines = list(chain.from_iterable(module.routines for module in modules))
    entry = machine.routines.get(wanted or "main")
    if entry is None and wanted:
        entry = next((routine for routine in routines if routine.name.lower() == wanted), None)
        if entry is None:
            what = f"there is no PROC {machine.request.entry[:40]}, which is asked for"
            machine.log.find("refused", what, line=1)
            return None
    if entry is not None and (wanted or entry.body) and _can_run_alone(entry):
        machine.log.fact("entry", entry.name)
        return entry
    candidates = [
        routine
        for routine in routines
        if _can_run_alone(routine) and (routine.body or entry is None)
    ]
    if not candidates and entry is not None and entry.kind == "proc":
        candidates = [entry]
    if not candidates:
        machine.log.fact("entry", "none: no PROC can be run by itself")
        return None
    return _choose_entry(machine, routines, candidates)


def _can_run_alone(routine: Routine) -> bool:
    return routine.kind == "proc" and all(item.optional for item in routine.parameters)


def _choose_entry(
    machine: Machine, routines: Sequence[Routine], candidates: list[Routine]
) -> Routine:
    """The first candidate that moves and that no other routine calls.

    Without one: the first that moves, else the first that is not called, else the first.
    """
    called: set[str] = set()
    for routine in routines:
        called |= set(list_called(machine.codes[routine])) - {routine.name.lower()}
    free = [routine for routine in candidates if routine.name.lower() not in called] or candidates
    moving = (routine for routine in (*free, *candidates) if moves(machine.codes[routine]))
    entry = next(moving, free[0])
    reason = "main does nothing" if "main" in machine.routines else "there is no main"
    machine.log.fact("entry", f"{entry.name}, as {reason}")
    return entry
