"""Runs a PacScript program from its start to its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lang.beside import sum_up
from camgen.lang.pacscript import flow
from camgen.lang.pacscript.code import Code, Op, compile_procedure
from camgen.lang.pacscript.evaluate import assign, blank, evaluate, fit, is_stored
from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.machine import Machine, Raised, Scope, copy_value
from camgen.lang.pacscript.orders import ACTIONS, WAYS
from camgen.lang.pacscript.points import read_points
from camgen.lang.pacscript.source import (
    File,
    Module,
    Parameter,
    Procedure,
    list_included,
    read_files,
    read_module,
    stem,
)
from camgen.lang.pacscript.values import Array, Unknown, Unreadable, Value, Wrong, index, number
from camgen.lang.pacscript.words import RESERVED
from camgen.lang.programs import Ask, Executed
from camgen.lang.run import Budget, Ended, Stopped

#: Procedures may call each other so deep.
_DEEPEST = 40
_MOST_IO = 24063
#: So many tasks are looked at.
_MOST_BESIDE = 20
#: Statements of each, beyond those of the text.
_MOST_OF_A_TASK = 5_000


class Run:
    """A run. scope: the names of the procedure that runs, module_scope: those of its file. read: a run that has read
    the same files.
    """

    def __init__(self, files: Mapping[str, str], ask: Ask, read: Run | None = None) -> None:
        points, faulty = read_points(ask.points)
        self.machine = Machine(
            {key.lower(): float(value) for key, value in ask.assume.items()}, points
        )
        self.machine.flange = ask.flange
        for what in faulty:
            self.machine.log.assume(what)
        self.ask = ask
        self.files: dict[str, File] = read.files if read else read_files(files, self.say)
        statements = sum(len(file.statements) for file in self.files.values())
        self.budget = Budget(statements, ask.limits.pacscript_steps, "pacscript_steps")
        self.modules: dict[str, Module] = read.modules if read else {}
        self.scopes: dict[str, Scope] = {}
        ranked = sorted(self.files, key=lambda name: name.endswith(".h"))
        self.stems = {stem(name): name for name in reversed(ranked)}
        self.module = Module("")
        self.scope = self.module_scope = Scope()
        self.depth = 0
        self.learned: dict[int, Value] = {}
        #: Procedures that several files include, by their statements.
        self.codes: dict[Any, Code] = read.codes if read else {}

    def say(self, line: int, what: str) -> None:
        """Notes something that the language does not have."""
        self.machine.log.find("refused", what, line=max(1, line))

    # From its start to its end.

    def whole(self, beside: bool = True) -> Executed:
        """What the program does. beside: whether the tasks that it starts are looked at."""
        stopped = None
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
            self._look_beside()
        return self.machine.finish(stopped)

    def _look_beside(self) -> None:
        """Runs the tasks that this one starts, each by itself: what they do is told, and what is wrong in them."""
        machine = self.machine
        limits = replace(
            self.ask.limits, pacscript_steps=min(self.ask.limits.pacscript_steps, _MOST_OF_A_TASK)
        )
        for name, line in list(machine.tasks.items())[:_MOST_BESIDE]:
            other = Run({}, replace(self.ask, entry=name, limits=limits), self)
            if isinstance(other._entry(), str):
                machine.log.fact("other tasks", f"{name}, not shown")
                machine.log.lose(f"another task, {name}, is not shown", line=line)
                continue
            done = other.whole(beside=False)
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
            self._run(flow.Frame(self._code(declared), {}, {}, set(), {}, []), declared)
            self.module, self.scope, self.module_scope, self.machine.line = before
        return found

    def _code(self, procedure: Procedure) -> Code:
        if procedure.code is None:
            key = (procedure.line, tuple(procedure.statements))
            if key not in self.codes:
                self.codes[key] = compile_procedure(procedure, self.say, self.module.pac)
            procedure.code = self.codes[key]
        code: Code = procedure.code
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
        if self.depth >= _DEEPEST:
            raise Stopped("procedures that call each other without end")
        values = [evaluate(self, part) for part in parts]
        if len(values) > len(procedure.parameters):
            self.machine.log.find(
                "refused",
                f"{procedure.name} takes {len(procedure.parameters)} values, not {len(values)}",
            )
        before, line = (self.module, self.scope, self.module_scope), self.machine.line
        self.depth += 1
        self.module, self.module_scope = module, self._scope_of(module)
        try:
            scope = self._execute(procedure, values)
        finally:
            self.depth -= 1
            self.module, self.scope, self.module_scope = before
        self.machine.line = line
        for parameter, part, value in zip(procedure.parameters, parts, values, strict=False):
            passed = flow.comparable(self._fit(value, parameter))
            if flow.comparable(scope.names.get(parameter.name)) != passed:
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
        self._run(flow.Frame(code, {}, {}, set(), {}, []), procedure)
        return scope

    def _fit(self, value: Value, parameter: Parameter) -> Value:
        try:
            return fit(value, parameter.kind)
        except Unreadable:
            return value

    def _run(self, frame: flow.Frame, procedure: Procedure) -> None:
        """The steps of a procedure to its end."""
        ops, machine, at = frame.code.ops, self.machine, 0
        while at < len(ops):
            op = ops[at]
            machine.line = op.line
            self.budget.spend()
            try:
                to = self._step(frame, at, op, procedure.returns == "program")
                at = at + 1 if to is None else to
                continue
            except Raised:
                if not frame.handler:
                    raise
                at = frame.code.labels[frame.handler]
                continue
            except Wrong as error:
                machine.log.find("refused", str(error))
                machine.lose(op.do)
            except Unreadable as error:
                machine.log.leave_out(f"{error}: left out")
                machine.lose(op.do)
            at += 1

    def _step(self, frame: flow.Frame, at: int, op: Op, pac: bool) -> int | None:
        """A step; where to go on, None with the next one."""
        if action := ACTIONS.get(op.do):
            action(self, op)
            return None
        if way := WAYS.get(op.do):
            return way(self, frame, at, op)
        if op.do == "return" and frame.returns:
            return frame.returns.pop()
        if op.do in ("exit", "return") or pac:
            return len(frame.code.ops)
        raise Ended

    # Inputs and outputs.

    def signal(self, at: int) -> Value:
        """An input, or an output as the program has set it."""
        if str(at) in self.machine.outputs:
            return self.machine.outputs[str(at)]
        if at in self.learned:
            return self.learned[at]
        return self.machine.unknown(f"IO[{at}]", f"io[{at}]")

    def set_signal(self, at: int, value: Value) -> None:
        """Sets an output."""
        if at > _MOST_IO:
            raise Wrong(f"IO[{at}]: the highest is IO[{_MOST_IO}]")
        self.machine.outputs[str(at)] = value
        self._put(str(at), value)

    def _put(self, signal: str, value: Value) -> None:
        if isinstance(value, Unknown):
            self.machine.log.assume(
                f"{value.what}, to which IO[{signal}] is set, is taken for 0", value.key
            )
        self.machine.switch(signal, 0.0 if isinstance(value, Unknown) else number(value))

    def port(self, name: str) -> Value | None:
        """What an input or output with a name of its own is."""
        found = self.scope.ios.get(name) or self.module_scope.ios.get(name)
        if found is None:
            return None
        return self.machine.outputs.get(name) or self.machine.unknown(
            f"{name}, IO[{found[1]}]", name
        )

    def write_port(self, name: str, value: Value) -> bool:
        """Sets such an output; whether there is one."""
        if name not in self.scope.ios and name not in self.module_scope.ios:
            return False
        self.machine.outputs[name] = value
        self._put(name, value)
        return True

    def learn(self, node: Node, value: Value) -> None:
        """Takes a variable or an input for what a program has waited for."""
        said = str(node.said)
        if node.kind == "index" and said == "io":
            at = evaluate(self, node.parts[0])
            if not isinstance(at, Unknown):
                self.learned[index(number(at))] = value
        elif node.kind == "name" and said.startswith("io") and said[2:].isdecimal():
            self.learned[int(said[2:9])] = value
        elif (
            node.kind == "index"
            or said in self.scope.names
            or said in self.module_scope.names
            or is_stored(said)
        ):
            assign(self, node, value)

    def told_by_user(self, node: Node) -> str:
        """What of a condition the user has said himself."""
        if node.kind == "index" and node.parts and node.parts[0].kind == "number":
            key = f"{node.said}[{node.parts[0].said:g}]"
            return key if self.machine.given(key) is not None else ""
        if node.kind == "name" and self.machine.given(str(node.said)) is not None:
            return str(node.said)
        return next((found for part in node.parts if (found := self.told_by_user(part))), "")

    # What the text does not have.

    def undeclared(self, name: str) -> Value:
        """A name that nobody has given a value: what the program counts with begins at 0."""
        if name in self.scope.assigned and self.machine.given(name) is None:
            self.machine.log.assume(f"{name} begins at 0", name)
            return 0.0
        value = self.machine.unknown(name, name)
        if isinstance(value, Unknown):
            self.machine.log.assume(f"{name} has no value in the text", name)
        return value

    def left_out(self, name: str) -> Value:
        """A procedure that is in no file."""
        self.machine.trusting = True
        self.machine.log.leave_out(
            f"{name} is in no file that is given: left out, with all that it moves and sets"
        )
        return Unknown(f"what {name} gives")


def run_files(files: Mapping[str, str], ask: Ask) -> Executed:
    """What the files say when they are run once."""
    return Run(files, ask).whole()
