"""Runs a PacScript program from its start to its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lang.beside import sum_up
from camgen.lang.code import Act, Branch, Effect, Step
from camgen.lang.coverage import measure_coverage
from camgen.lang.flow import Choice, Counter, Flow, Raised, Rules
from camgen.lang.pacscript import motions
from camgen.lang.pacscript.code import CountRange, ProcedureCode, compile_procedure
from camgen.lang.pacscript.evaluate import assign, blank, combine, evaluate, fit
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.functions import calculate
from camgen.lang.pacscript.machine import Machine, Scope, copy_value
from camgen.lang.pacscript.points import read_points
from camgen.lang.pacscript.source import (
    File,
    Module,
    Parameter,
    Procedure,
    list_included,
    normalize,
    read_files,
    read_module,
    stem,
)
from camgen.lang.pacscript.state import State
from camgen.lang.pacscript.values import (
    Array,
    Unreadable,
    Value,
    Wrong,
    comparable,
    number,
)
from camgen.lang.pacscript.words import RESERVED
from camgen.lang.programs import Ask, Executed
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown

#: Procedures may call each other so deep.
_DEEPEST = 40
#: So many tasks are looked at.
_MOST_BESIDE = 20
#: Statements of each, beyond those of the text.
_MOST_OF_A_TASK = 5_000
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


class Run(State):
    """The run of procedures, for all programs.

    files: files that are given, by name.
    modules: files that were read, by name.
    codes: procedures that several files include, by their statements.
    scopes: names of each file, which it has as long as the program runs.
    module: file of the procedure that runs.
    """

    faults: type[Exception] = Unreadable

    def __init__(self, machine: Machine, budget: Budget, rules: Rules) -> None:
        super().__init__(machine, budget)
        self.flow = Flow(self, budget, rules)
        self.files: dict[str, File] = {}
        self.modules: dict[str, Module] = {}
        self.codes: dict[Any, ProcedureCode] = {}
        self.scopes: dict[str, Scope] = {}
        self.module = Module("")

    def say(self, line: int, what: str) -> None:
        """Notes a fault of the text."""
        self.machine.log.find("refused", what, line=max(1, line))

    def read(self, name: str) -> Module:
        """The module of a file that is given."""
        if name not in self.modules:
            self.modules[name] = read_module(name, self.files, self.machine.assume, self.say)
        return self.modules[name]

    def _scope_of(self, module: Module) -> Scope:
        """The names of a file, which it has as long as the program runs."""
        found = self.scopes.get(module.name)
        if found is None:
            found = self.scopes[module.name] = Scope()
            declared = Procedure("", 0, [], "", module.declarations)
            before = self.module, self.scope, self.module_scope, self.machine.line
            self.module, self.scope, self.module_scope = module, found, found
            self.flow.run(self._code(declared).code)
            self.module, self.scope, self.module_scope, self.machine.line = before
        return found

    def _code(self, procedure: Procedure) -> ProcedureCode:
        if procedure.code is None:
            key = (procedure.line, tuple(procedure.statements))
            if key not in self.codes:
                self.codes[key] = compile_procedure(procedure, self.say, self.module.pac)
            procedure.code = self.codes[key]
        code: ProcedureCode = procedure.code
        return code

    # Procedures.

    def find_procedure(self, name: str) -> tuple[Module, Procedure] | None:
        """A procedure of this file, or the start of another one."""
        if (found := self.module.procedures.get(name)) and name != "main":
            return self.module, found
        if name in self.stems and name not in RESERVED:
            module = self.read(self.stems[name])
            if main := module.procedures.get("main"):
                return module, main
        return None

    def find_function(self, name: str) -> bool:
        """Whether a name without brackets calls a function."""
        found = self.find_procedure(name)
        return found is not None and found[1].returns not in ("", "program")

    def call(self, found: tuple[Module, Procedure], parts: tuple[Node, ...]) -> Value:
        """Calls a procedure; what it gives, 0 of a Sub. Parameters that are not ByVal give their values back."""
        module, procedure = found
        self.flow.check_depth("procedures that call each other without end")
        values = [self.evaluate(part) for part in parts]
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
        if parameter.by_value or value is None or part.kind not in ("name", "index", "call"):
            return
        said = str(part.said)
        held = self.scope.names.get(said, self.module_scope.names.get(said))
        if part.kind == "call" and not isinstance(held, Array):
            return
        if part.kind == "name" and (held is None or held is value):
            return
        if part.kind == "index" and said == "io":
            return
        assign(self, part, value)

    def _execute(self, procedure: Procedure, values: list[Value]) -> Scope:
        scope = Scope()
        for k, parameter in enumerate(procedure.parameters):
            value = values[k] if k < len(values) else blank(parameter.kind)
            scope.kinds[parameter.name] = parameter.kind
            value = copy_value(value) if parameter.by_value else value
            scope.names[parameter.name] = (
                value if isinstance(value, Array) else self._fit(value, parameter)
            )
        if procedure.returns not in ("", "program"):
            scope.names[procedure.name] = (
                blank(procedure.returns) if procedure.returns != "variant" else 0.0
            )
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

    def begin(self, step: Step) -> None:
        """A step begins."""
        self.machine.line = step.line

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
        """Whether one of the values of a Case is ``value``."""
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
        """The counter of ``For``."""
        first, last, step = (self.evaluate(part) for part in count[1:])
        for value in (first, last, step):
            if isinstance(value, Unknown):
                begin = Unknown(first.what) if isinstance(first, Unknown) else first
                return Counter(count.counter, begin, unknown=value)
        return Counter(count.counter, number(first), number(last), number(step))

    def read_state(self) -> object:
        """The values of all names."""
        machine = self.machine
        tables: tuple[Mapping[Any, Value], ...] = (
            self.scope.names,
            self.module_scope.names,
            machine.globals,
            machine.outputs,
        )
        return [dict(zip(table, map(comparable, table.values()), strict=True)) for table in tables]

    def count_instructions(self) -> int:
        """The number of instructions so far."""
        return len(self.machine.body)

    def assume(
        self, choice: Choice, step: Step, unknown: Unknown | None = None, length: int = 0
    ) -> bool:
        """Tells a choice of the engine."""
        del length
        if choice is Choice.LOOP_ENDLESS:
            self.log.fact("goes round for ever", f"from line {step.line}: shown once")
            return True
        unknown = unknown or Unknown("")
        if isinstance(step, Branch) and step.condition.value.kind == "call":
            unknown = Unknown(str(step.condition.value.said))
        self.log.choose(_CHOICES[choice].format(what=unknown.what, line=step.line), unknown.key)
        return True

    def report(self, step: Step, error: Exception) -> None:
        """Tells that a step cannot be carried out."""
        if isinstance(step, Act) and step.effect is Effect.MOVES:
            self.fail_motion(error)
        else:
            self._tell(error)

    def fail_motion(self, error: Exception) -> None:
        """Tells that a motion cannot be carried out. It leads to an unknown place."""
        self._tell(error)
        self.machine.lose_motion()

    def _tell(self, error: Exception) -> None:
        if isinstance(error, Wrong):
            self.log.find("refused", str(error))
        else:
            self.log.leave_out(f"{error}: left out")


class ProgramRun(Run):
    """The run of a program of any author, with the tasks that it starts."""

    def __init__(
        self, files: Mapping[str, str], ask: Ask, parent: ProgramRun | None = None
    ) -> None:
        """parent: a run that has read the same files."""
        points, faulty = read_points(ask.points)
        assumed = {key.lower(): float(value) for key, value in ask.assume.items()}
        budget = Budget(0, ask.limits.pacscript_steps, "pacscript_steps")
        super().__init__(Machine(assumed, points), budget, Rules(_DEEPEST))
        self.machine.log.shifts = ask.shifts
        self.machine.flange = ask.flange
        for what in faulty:
            self.machine.log.assume(what)
        self.ask = ask
        if parent is not None:
            self.files, self.modules, self.codes = parent.files, parent.modules, parent.codes
        else:
            texts = {name: normalize(text) for name, text in files.items()}
            self.files = read_files(texts, self.say)
        budget.left += sum(file.count_statements() for file in self.files.values())
        ranked = sorted(self.files, key=lambda name: name.endswith(".h"))
        self.stems = {stem(name): name for name in reversed(ranked)}

    def whole(self, beside: bool = True) -> Executed:
        """Runs the program. beside: whether the tasks that it starts are run too."""
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
        if beside:
            self._read_rest()
            end = self.machine.line
            self._look_beside()
            codes = [procedure.code for procedure in self.codes.values()]
            coverage = measure_coverage(codes, self.log.ran, end)
        return replace(self.machine.finish(stopped), coverage=coverage)

    def _look_beside(self) -> None:
        """Runs the tasks that this one starts, each by itself: what they do is told, and what is wrong in them."""
        machine = self.machine
        limits = replace(
            self.ask.limits, pacscript_steps=min(self.ask.limits.pacscript_steps, _MOST_OF_A_TASK)
        )
        for name, line in list(machine.tasks.items())[:_MOST_BESIDE]:
            other = ProgramRun({}, replace(self.ask, entry=name, limits=limits), self)
            if isinstance(other._entry(), str):
                machine.log.fact("other tasks", f"{name}, not shown")
                machine.log.lose(f"another task, {name}, is not shown", line=line)
                continue
            done = other.whole(beside=False)
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
        found = self._entry()
        if isinstance(found, str):
            return (1, found)
        module, procedure = found
        self.machine.line = procedure.line
        self.machine.trusting = bool(procedure.parameters) or (
            procedure.name != "main" and procedure.returns != "program"
        )
        self.module, self.module_scope = module, self._scope_of(module)
        values: list[Value] = []
        for parameter in procedure.parameters:
            what = f"{parameter.name} (a parameter of {procedure.name})"
            values.append(self.machine.unknown(what, parameter.name))
        self._execute(procedure, values)
        return None

    def _entry(self) -> tuple[Module, Procedure] | str:
        """The procedure to begin with, or why there is none."""
        wanted = stem(self.ask.entry)
        own = self._modules()
        if wanted:
            if called := self.find_procedure(wanted):
                return called
            for module in [*own, *map(self.read, self.files)]:
                if named := module.procedures.get(wanted):
                    return module, named
            return f"there is no procedure {self.ask.entry[:60]}"
        for module in own:
            if found := module.procedures.get("main"):
                return module, found
        every = [(module, one) for module in own for one in module.procedures.values()]
        if len(every) == 1:
            return every[0]
        if not every:
            return "there is no procedure"
        names = ", ".join(one.name for _, one in every[:6])
        return f"there is no Sub Main: choose where to begin of {names}" + (
            " ..." if len(every) > 6 else ""
        )

    def _modules(self) -> list[Module]:
        """The files that no other one includes, else the first."""
        included = {
            one for name, file in self.files.items() for one in list_included(file) if one != name
        }
        return [
            self.read(name) for name in self.files if name not in included or len(self.files) == 1
        ] or [self.read(name) for name in list(self.files)[:1]]

    def _read_rest(self) -> None:
        """What is wrong with procedures that did not run."""
        for module in self.modules.values():
            for name, line in module.missing.items():
                self.machine.log.fact("files that are not given", name)
                self.machine.line = line
                self.machine.log.assume(f"{name} is not given: what it holds is not known")
        for module in self._modules():
            self.module = module
            for procedure in module.procedures.values():
                self._code(procedure)


def run_files(files: Mapping[str, str], ask: Ask) -> Executed:
    """What the files say when they are run once."""
    return ProgramRun(files, ask).whole()
