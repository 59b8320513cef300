"""The state of a PacScript program that runs: names, inputs, outputs, procedures."""

from __future__ import annotations

from abc import ABC, abstractmethod

from camgen.lang.pacscript.expressions import Node
from camgen.lang.pacscript.machine import Machine, Scope
from camgen.lang.pacscript.motion import Motion
from camgen.lang.pacscript.source import File, Module, Procedure, read_module
from camgen.lang.pacscript.values import Speed, Value, Wrong, number
from camgen.lang.pacscript.words import RESERVED
from camgen.lang.run import Budget
from camgen.lang.values import Unknown
from camgen.model.pose import Pose

#: Highest number of an IO (RC8 manual 5512).
LAST_SIGNAL = 24063


class State(ABC):
    """The state of a run.

    machine: robot and log.
    scope: names of the procedure that runs.
    module_scope: names of its file.
    files: files that are given, by name.
    modules: files that were read, by name.
    module: file of the procedure that runs.
    stems: files by the name under which programs call them.
    learned: inputs as a `Wait` has left them, by their number.
    budget: steps that the run may take.
    """

    def __init__(self, machine: Machine, budget: Budget) -> None:
        self.machine, self.budget = machine, budget
        self.log = machine.log
        self.scope = self.module_scope = Scope()
        self.files: dict[str, File] = {}
        self.modules: dict[str, Module] = {}
        self.module = Module("")
        self.stems: dict[str, str] = {}
        self.learned: dict[int, Value] = {}

    # -- values and motions. The strict run has rules of its own for them. -------------------------

    @abstractmethod
    def evaluate(self, node: Node) -> Value:
        """Return the value of an expression. Raises Unreadable."""

    @abstractmethod
    def combine(self, sign: str, a: Value, b: Value) -> Value:
        """Return the value of two values with an operator between them. Raises Unreadable."""

    @abstractmethod
    def blend_of(self, mark: str | Node) -> float:
        """Return the blend of a pass mark, mm."""

    @abstractmethod
    def speed_of(self, expression: str) -> Speed:
        """Return the internal speed of a motion in the usual spelling, that in force if empty."""

    @abstractmethod
    def read_speed(self, motion: Motion) -> Speed:
        """Return the internal speed of a motion. Notes the options that the body does not have."""

    @abstractmethod
    def place_of(self, node: Node) -> Value:
        """Return a place to move to."""

    @abstractmethod
    def go(
        self, linear: bool, target: Value, speed: Speed, blend: float, at_once: bool = False
    ) -> None:
        """Move to a place."""

    @abstractmethod
    def arc(
        self, via: Value, end: Value, speed: Speed, blend: float, at_once: bool = False
    ) -> None:
        """Move through a place to another one."""

    def find_start(self) -> Pose:
        """Return the place of the arm, for a motion that begins there."""
        return self.machine.current_pose

    def add_fault(self, line: int, what: str) -> None:
        """Add a finding for a fault of the text."""
        self.log.find("refused", what, line=max(1, line))

    def add_error(self, error: Exception) -> None:
        """Add a finding for a step that cannot be run."""
        if isinstance(error, Wrong):
            self.log.find("refused", str(error))
        else:
            self.log.leave_out(f"{error}: left out")

    def fail_motion(self, error: Exception) -> None:
        """Add a finding for a motion that cannot be run. Its target is unknown."""
        self.add_error(error)
        self.machine.lose_motion()

    # -- procedures ----------------------------------------------------------------------------

    def read(self, name: str) -> Module:
        """Return the module of a file that is given."""
        if name not in self.modules:
            self.modules[name] = read_module(name, self.files, self.machine.assume, self.add_fault)
        return self.modules[name]

    def find_procedure(self, name: str) -> tuple[Module, Procedure] | None:
        """Return a procedure of this file, or the start of another one. None without one."""
        if (procedure := self.module.procedures.get(name)) and name != "main":
            return self.module, procedure
        if name in self.stems and name not in RESERVED:
            module = self.read(self.stems[name])
            if main := module.procedures.get("main"):
                return module, main
        return None

    def find_function(self, name: str) -> bool:
        """Return whether a name without brackets calls a function."""
        procedure = self.find_procedure(name)
        return procedure is not None and procedure[1].returns not in ("", "program")

    @abstractmethod
    def call(self, procedure: tuple[Module, Procedure], parts: tuple[Node, ...]) -> Value:
        """Call a procedure and return its value, 0 of a Sub."""

    def leave_out(self, name: str) -> Value:
        """Leave out a procedure that is in no file."""
        self.machine.trusting = True
        self.log.leave_out(
            f"{name} is in no file that is given: left out, with all that it moves and sets"
        )
        return Unknown(f"what {name} gives")

    def find_variable(self, name: str) -> Value | None:
        """Return the value of a variable of the program, None if no variable has that name."""
        return self.scope.names.get(name, self.module_scope.names.get(name))

    # -- inputs and outputs --------------------------------------------------------------------

    def signal(self, at: int) -> Value:
        """Return an input, or an output as the program has set it."""
        if str(at) in self.machine.outputs:
            return self.machine.outputs[str(at)]
        if at in self.learned:
            return self.learned[at]
        return self.machine.unknown(f"IO[{at}]", f"io[{at}]")

    def set_signal(self, at: int, value: Value) -> None:
        """Set an output."""
        if at > LAST_SIGNAL:
            raise Wrong(f"IO[{at}]: the highest is IO[{LAST_SIGNAL}]")
        self.machine.outputs[str(at)] = value
        self._switch(str(at), value)

    def _switch(self, signal: str, value: Value) -> None:
        if isinstance(value, Unknown):
            what = f"{value.what}, to which IO[{signal}] is set, is assumed to be 0"
            self.log.assume(what, value.key)
        self.machine.switch(signal, 0.0 if isinstance(value, Unknown) else number(value))

    def port(self, name: str) -> Value | None:
        """Return the value of an input or output with a name of its own. None for another name."""
        port = self.scope.ios.get(name, self.module_scope.ios.get(name))
        if port is None:
            return None
        if name in self.machine.outputs:
            return self.machine.outputs[name]
        return self.machine.unknown(f"{name}, IO[{port}]", name)

    def write_port(self, name: str, value: Value) -> bool:
        """Set an output with a name of its own. Return whether there is one."""
        if name not in self.scope.ios and name not in self.module_scope.ios:
            return False
        self.machine.outputs[name] = value
        self._switch(name, value)
        return True

    def undeclared(self, name: str) -> Value:
        """Return the value of a name without one. What the program counts with begins at 0."""
        if name in self.scope.assigned and self.machine.given(name) is None:
            self.log.assume(f"{name} begins at 0", name)
            return 0.0
        value = self.machine.unknown(name, name)
        if isinstance(value, Unknown):
            self.log.assume(f"{name} has no value in the text", name)
        return value
