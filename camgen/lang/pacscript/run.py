"""Runs a PacScript program from its start to its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lang.beside import sum_up
from camgen.lang.code import Act, Branch, Effect, Step
from camgen.lang.coverage import measure_coverage
from camgen.lang.flow import Choice, Counter, Flow, MachineLanguage, Raised, Rules
from camgen.lang.pacscript import motions
from camgen.lang.pacscript.code import CountRange, ProcedureCode, compile_procedure
from camgen.lang.pacscript.evaluate import assign, combine, evaluate, evaluate_all, fit
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import calculate, get_value
from camgen.lang.pacscript.machine import Machine, Scope, blank, copy_value
from camgen.lang.pacscript.points import read_points
from camgen.lang.pacscript.source import (
    Module,
    Parameter,
    Procedure,
    list_included,
    read_files,
    stem,
)
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import (
    Array,
    Unreadable,
    Value,
    comparable,
    number,
)
from camgen.lang.programs import Executed, RunRequest, strip_mark, unify_line_ends
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown, find_first_unknown

#: Maximum depth of calls.
_MAX_DEPTH = 40
#: Maximum number of other tasks that are run.
_MAX_TASKS = 20
#: Maximum number of steps of each, in addition to those of the text.
_MAX_TASK_STEPS = 5_000
#: Texts of the choices of the engine.
_CHOICES = {
    Choice.BRANCH_ENTERED: "{what} is not known: the branch is gone into",
    Choice.BRANCH_PASSED: "{what} is not known: the branch is passed by",
    Choice.LOOP_RUN_ONCE: "{what} is not known: the loop is gone through once",
    Choice.LOOP_ENDED: "{what} is not known: the loop ends",
    Choice.LOOP_LEFT: "the loop from line {line} is left after one round",
    Choice.LOOP_REPEATS: (
        "the condition of the loop from line {line} never changes here: the loop is left"
    ),
    Choice.FIRST_CASE: "{what} is not known: the first Case that does something is taken",
    Choice.FIRST_LABEL: "{what} is not known: the first way of On is taken",
}


class Run(State, MachineLanguage):
    """The run of procedures, for all programs.

    codes: procedures that several files include, by their statements.
    scopes: names of each file, which it has as long as the program runs.
    """

    faults: type[Exception] = Unreadable

    def __init__(self, machine: Machine, budget: Budget, rules: Rules) -> None:
        super().__init__(machine, budget)
        self.flow = Flow(self, budget, rules)
        self.codes: dict[Any, ProcedureCode] = {}
        self.scopes: dict[str, Scope] = {}

    def _scope_of(self, module: Module) -> Scope:
        """Return the names of a file, which it keeps during the whole run."""
        scope = self.scopes.get(module.name)
        if scope is None:
            scope = self.scopes[module.name] = Scope()
            declared = Procedure("", 0, [], "", module.declarations)
            before = self.module, self.scope, self.module_scope, self.machine.line
            self.module, self.scope, self.module_scope = module, scope, scope
            self.flow.run(self._code(declared).code)
            self.module, self.scope, self.module_scope, self.machine.line = before
        return scope

    def _code(self, procedure: Procedure) -> ProcedureCode:
        if procedure.code is None:
            key = (procedure.line, tuple(procedure.statements))
            if key not in self.codes:
                self.codes[key] = self.compile(procedure)
            procedure.code = self.codes[key]
        code: ProcedureCode = procedure.code
        return code

    def compile(self, procedure: Procedure) -> ProcedureCode:
        """Return the steps of a procedure."""
        return compile_procedure(procedure, self.add_fault, self.module.pac)

    # Procedures.

    def call(self, target: tuple[Module, Procedure], parts: tuple[Node, ...]) -> Value:
        """Call a procedure. Returns its value, which is 0 for a Sub.

        Values of parameters without ByVal are assigned to the arguments.
        """
        module, procedure = target
        self.flow.check_depth("procedures that call each other without end")
        values = evaluate_all(self, parts)
        if len(values) > len(procedure.parameters):
            self.machine.log.find(
                "refused",
                f"{procedure.name} takes {len(procedure.parameters)} values, not {len(values)}",
            )
        before, line = (self.module, self.scope, self.module_scope), self.machine.line
        self.module, self.module_scope = module, self._scope_of(module)
        try:
            scope = self._execute(procedure, values)
        finally:
            self.module, self.scope, self.module_scope = before
        self.machine.line = line
        for parameter, part, value in zip(procedure.parameters, parts, values, strict=False):
            passed = comparable(self._fit(value, parameter))
            if comparable(scope.names.get(parameter.name)) != passed:
                self._give_back(parameter, part, scope)
        return scope.names.get(procedure.name, 0.0)

    def _give_back(self, parameter: Parameter, part: Node, scope: Scope) -> None:
        value = scope.names.get(parameter.name)
        name = str(part.content)
        variable = self.find_variable(name)
        takes_value = {
            "call": isinstance(variable, Array),
            "name": variable is not None and variable is not value,
            "index": name != "io",
        }
        if value is not None and not parameter.by_value and takes_value.get(part.kind, False):
            assign(self, part, value)

    def _execute(self, procedure: Procedure, values: list[Value]) -> Scope:
        scope = Scope()
        for k, parameter in enumerate(procedure.parameters):
            value = get_value(values, k, blank(parameter.kind))
            scope.kinds[parameter.name] = parameter.kind
            if parameter.by_value:
                value = copy_value(value)
            scope.names[parameter.name] = (
                value if isinstance(value, Array) else self._fit(value, parameter)
            )
        if procedure.returns not in ("", "program"):
            scope.names[procedure.name] = blank(procedure.returns)
            scope.kinds[procedure.name] = procedure.returns
        self.scope, code = scope, self._code(procedure)
        scope.assigned = code.assigned
        self.flow.run(code.code)
        return scope

    def _fit(self, value: Value, parameter: Parameter) -> Value:
        try:
            return fit(value, parameter.kind)
        except Unreadable:
            return value

    # What the engine asks (`camgen.lang.flow.Language`).

    evaluate = evaluate
    combine = combine
    blend_of = motions.blend_of
    speed_of = motions.speed_of
    read_speed = motions.read_speed
    place_of = motions.place_of
    go = motions.go
    arc = motions.arc
    assign = assign
    to_number = staticmethod(number)

    def matches(self, value: Value, tests: list[tuple[str, Node, Node | None]]) -> bool:
        """Whether one of the values of a Case is `value`."""
        for sign, first, last in tests:
            low = self.evaluate(first)
            if last is None:
                result = calculate(sign, value, low)
                is_equal = not isinstance(result, Unknown) and bool(result)
            else:
                high = self.evaluate(last)
                is_equal = bool(calculate(">=", value, low)) and bool(calculate("<=", value, high))
            if is_equal:
                return True
        return False

    def open_count(self, count: CountRange) -> Counter:
        """Open the counter of a `For`."""
        first, last, step = evaluate_all(self, count[1:])
        unknown = find_first_unknown((first, last, step))
        if unknown is not None:
            return Counter(count.counter, first, unknown=unknown)
        return Counter(count.counter, number(first), number(last), number(step))

    def read_state(self) -> object:
        """Return the values of all names, which can be compared."""
        machine = self.machine
        tables: tuple[Mapping[Any, Value], ...] = (
            self.scope.names,
            self.module_scope.names,
            machine.globals,
            machine.outputs,
        )
        return [dict(zip(table, map(comparable, table.values()), strict=True)) for table in tables]

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Add a choice of the engine to the log."""
        del length
        if choice is Choice.LOOP_ENDLESS:
            self.log.fact("runs forever", f"from line {step.line}: shown once")
            return True
        unknown = unknown or Unknown("")
        if isinstance(step, Branch) and step.condition.value.kind == "call":
            unknown = Unknown(str(step.condition.value.content))
        self.log.choose(_CHOICES[choice].format(what=unknown.what, line=step.line), unknown.key)
        return True

    def report(self, step: Step, error: Exception) -> None:
        """Add a finding for a step that cannot be run."""
        if isinstance(step, Act) and step.effect is Effect.MOVES:
            self.fail_motion(error)
        else:
            self.add_error(error)


class ProgramRun(Run):
    """The run of a program of any author, with the tasks that it starts."""

    def __init__(
        self, files: Mapping[str, str], request: RunRequest, parent: ProgramRun | None = None
    ) -> None:
        """parent: a run that has read the same files."""
        points, faulty = read_points(request.points)
        assumed = {key.lower(): float(value) for key, value in request.assume.items()}
        budget = Budget(0, request.limits.pacscript_steps, "pacscript_steps")
        super().__init__(Machine(assumed, points), budget, Rules(_MAX_DEPTH))
        self.machine.log.shifts = request.shifts
        self.machine.flange = request.find_flange
        for what in faulty:
            self.machine.log.assume(what)
        self.request = request
        if parent is not None:
            self.files, self.modules, self.codes = parent.files, parent.modules, parent.codes
        else:
            texts = {name: strip_mark(unify_line_ends(text)) for name, text in files.items()}
            self.files = read_files(texts, self.add_fault)
        budget.left += sum(file.count_statements() for file in self.files.values())
        ranked = sorted(self.files, key=lambda name: name.endswith(".h"))
        self.stems = {stem(name): name for name in reversed(ranked)}

    def run(self, with_tasks: bool = True) -> Executed:
        """Run the program. with_tasks: run the tasks that it starts, too."""
        stopped = None
        coverage = None
        try:
            stopped = self._start()
        except Ended:
            pass
        except Stopped as error:
            stopped = (self.machine.line or 1, str(error))
        except Raised:
            stopped = (self.machine.line or 1, "the program raises an error here")
        except RecursionError:
            stopped = (self.machine.line or 1, "procedures and brackets nested too deep")
        if with_tasks:
            self._read_rest()
            end = self.machine.line
            self._run_tasks()
            codes = [procedure.code for procedure in self.codes.values()]
            coverage = measure_coverage(codes, self.log.ran, end)
        return replace(self.machine.finish(stopped), coverage=coverage)

    def _run_tasks(self) -> None:
        machine = self.machine
        limits = replace(
            self.request.limits,
            pacscript_steps=min(self.request.limits.pacscript_steps, _MAX_TASK_STEPS),
        )
        for name, line in list(machine.tasks.items())[:_MAX_TASKS]:
            other = ProgramRun({}, replace(self.request, entry=name, limits=limits), self)
            if isinstance(other._entry(), str):
                machine.log.fact("other tasks", f"{name}, not shown")
                machine.log.lose(f"another task, {name}, is not shown", line=line)
                continue
            done = other.run(with_tasks=False)
            self.log.ran |= other.log.ran
            machine.log.fact("other tasks", f"{name}: {sum_up(done.body)}, not shown")
            if done.body:
                what = f"another task, {name}, is not shown: {sum_up(done.body)}"
                machine.log.lose(what, line=line)
            for finding in done.findings:
                if finding.level == "dangerous" or machine.log.has(finding):
                    machine.log.find(finding.level, finding.what, line=finding.line)
                else:
                    what = f"in {name}: {finding.what}"
                    machine.log.find("unusual", what, line=finding.line)

    def _start(self) -> tuple[int, str] | None:
        entry = self._entry()
        if isinstance(entry, str):
            return (1, entry)
        module, procedure = entry
        self.machine.line = procedure.line
        self.machine.trusting = bool(procedure.parameters) or (
            procedure.name != "main" and procedure.returns != "program"
        )
        self.module, self.module_scope = module, self._scope_of(module)
        names = [parameter.name for parameter in procedure.parameters]
        what = f"(a parameter of {procedure.name})"
        self._execute(procedure, [self.machine.unknown(f"{name} {what}", name) for name in names])
        return None

    def _entry(self) -> tuple[Module, Procedure] | str:
        """Return the first procedure to run, or the reason why no procedure runs."""
        wanted = stem(self.request.entry)
        modules = self._modules()
        if wanted:
            if called := self.find_procedure(wanted):
                return called
            for module in [*modules, *map(self.read, self.files)]:
                if named := module.procedures.get(wanted):
                    return module, named
            return f"there is no procedure {self.request.entry[:60]}"
        for module in modules:
            if main := module.procedures.get("main"):
                return module, main
        candidates: list[tuple[Module, Procedure]] = []
        for module in modules:
            candidates += [(module, procedure) for procedure in module.procedures.values()]
        if len(candidates) == 1:
            return candidates[0]
        if not candidates:
            return "there is no procedure"
        names = ", ".join(procedure.name for _, procedure in candidates[:6])
        return f"there is no Sub Main: choose where to begin of {names}" + (
            " ..." if len(candidates) > 6 else ""
        )

    def _modules(self) -> list[Module]:
        """Return the files that no other file includes, or else the first file."""
        included: set[str] = set()
        for name, file in self.files.items():
            included.update(set(list_included(file)) - {name})
        names = [name for name in self.files if name not in included] or list(self.files)[:1]
        return [self.read(name) for name in names]

    def _read_rest(self) -> None:
        """Compile the procedures that were not run, for their faults, and note missing files."""
        for module in self.modules.values():
            for name, line in module.missing.items():
                self.machine.log.fact("files that are not given", name)
                self.machine.line = line
                self.machine.log.assume(f"{name} is not given: what it holds is not known")
        for module in self._modules():
            self.module = module
            for procedure in module.procedures.values():
                self._code(procedure)
