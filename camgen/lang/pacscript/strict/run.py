"""The strict run of a PacScript program: what no program of a post has is a finding."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from camgen.lang.code import Step
from camgen.lang.flow import Rules
from camgen.lang.pacscript.code import ProcedureCode
from camgen.lang.pacscript.evaluate import assign, evaluate
from camgen.lang.pacscript.expressions import Node, arguments, parse
from camgen.lang.pacscript.functions import calculate, call
from camgen.lang.pacscript.machine import posture_of
from camgen.lang.pacscript.motion import Motion
from camgen.lang.pacscript.motions import go
from camgen.lang.pacscript.run import Run
from camgen.lang.pacscript.source import Module, Procedure, read_files, stem
from camgen.lang.pacscript.statements import CONSTANTS
from camgen.lang.pacscript.values import (
    UNDEFINED,
    Either,
    ExternalPose,
    Mps,
    PoseWithFigure,
    Speed,
    Unreadable,
    Value,
    describe_value,
    index,
    position,
)
from camgen.lang.run import Budget, Ended, Stopped
from camgen.lang.values import Unknown
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Joints, MoveC
from camgen.model.text import counted

from .machine import StrictMachine
from .source import StrictReader
from .values import TYPES, check_speed, join, require_number, spread

#: Maximum depth of calls.
_CALLS = 20
_CALL = re.compile(r"(\w+)\s*(?:\((.*)\))?")
_SHORT = re.compile(r"[pjtvifds]\d{1,9}", re.ASCII)
#: The parts of expressions and the functions that are evaluated.
_KINDS = frozenset(("number", "left out", "name", "index", "call", "tuple", "sign", *"+-*/"))
_FUNCTIONS = frozenset(("p", "j", "t", "v"))


class StrictRun(Run):
    """A strict run.

    compile_strictly: returns the steps of a procedure.
    procedures: procedures of all files by name. `Main` of a file after the first has the name of
        the file, by which `Call` calls it.
    called: line of the procedure that was called last.
    speeds: speeds by their expression, for the present values of the variables.
    """

    machine: StrictMachine

    def __init__(
        self,
        files: Mapping[str, str],
        options: Mapping[str, object],
        steps: int,
        compile_strictly: Callable[[Procedure], ProcedureCode],
    ) -> None:
        super().__init__(StrictMachine(options), Budget(0, steps, ""), Rules(_CALLS))
        self.compile_strictly = compile_strictly
        self.procedures: dict[str, tuple[Module, Procedure]] = {}
        self.called = 0
        self.speeds: dict[str, Speed] = {}
        self.files = read_files(files, self.add_fault, self._remark)
        for number, name in enumerate(self.files):
            self.modules[name] = module = Module(stem(name))
            StrictReader(module, self.files, self.add_fault, self._remark).file(name, 0)
            self._add_procedures(module, stem(name) if number else "main")

    def _add_procedures(self, module: Module, main: str) -> None:
        for given, procedure in module.procedures.items():
            name = main if given == "main" else given
            if name in self.procedures:
                self.add_fault(procedure.line, f"a second procedure {given}")
            else:
                self.procedures[name] = module, procedure

    def _remark(self, line: int, what: str) -> None:
        self.log.find("unusual", what, line=line)

    def run_main(self) -> bool:
        """Runs the program from its start to its end. Returns whether it has a start."""
        if "main" not in self.procedures:
            self.add_fault(1, "there is no Sub Main")
            return False
        self.module, main = self.procedures["main"]
        self.called = main.line
        try:
            self._execute(main, [])
        except Ended:
            pass
        except Stopped as error:
            what = "more statements than a program can have" if self.budget.left < 0 else str(error)
            self.machine.fault(what)
        return True

    # -- procedures and variables --------------------------------------------------------------

    def compile(self, procedure: Procedure) -> ProcedureCode:
        """Return the steps of a procedure."""
        return self.compile_strictly(procedure)

    def report(self, step: Step, error: Exception) -> None:  # noqa: ARG002
        """Tells that a step cannot be carried out."""
        self.fail_motion(error)

    def fail_motion(self, error: Exception) -> None:
        """Tells that a motion cannot be carried out."""
        self.machine.fault(str(error))
        self.machine.forget_place()

    def call_procedure(self, rest: str) -> None:
        """Runs `Call name(values)`."""
        match = _CALL.fullmatch(rest)
        if match is None or match[1].lower() not in self.procedures:
            raise Unreadable(f"unknown procedure {rest}")
        module, procedure = self.procedures[match[1].lower()]
        parts = [parse(part) for part in arguments(match[2] or "") if part]
        if len(parts) != len(procedure.parameters):
            count = counted(len(procedure.parameters), "value")
            raise Unreadable(f"{match[1]} takes {count}, not {len(parts)}")
        for parameter, part in zip(procedure.parameters, parts, strict=True):
            _check_type(parameter.name, parameter.kind, self.evaluate(part))
        if procedure.line < self.called:
            self.machine.remark("procedures are called in another order than they are written")
        self.called = procedure.line
        self.speeds.clear()
        self.call((module, procedure), tuple(parts))
        self.speeds.clear()

    def set_variable(self, target: Node, value: Value) -> None:
        """Sets a variable. Raises Unreadable if its type cannot hold the value."""
        self.speeds.clear()
        if target.kind == "name":
            name = str(target.content)
            _check_type(name, self.scope.kinds.get(name, "variant"), value)
        assign(self, target, value)

    # -- expressions ---------------------------------------------------------------------------

    def evaluate(self, node: Node) -> Value:
        """The value of an expression. Raises Unreadable if the text alone does not give it."""
        kind, content = node.kind, node.content
        if kind not in _KINDS:
            raise Unreadable(f"{content if kind == 'text' else kind} is not evaluated")
        if kind == "name":
            name = str(content)
            if (
                name not in self.scope.names
                and name not in CONSTANTS
                and not _SHORT.fullmatch(name)
            ):
                raise Unreadable(f"unknown name {name}")
        elif kind == "call":
            return self._call_function(str(content), node.parts)
        value = evaluate(self, node)
        if isinstance(value, tuple):
            if len(value) == 2:
                raise Unreadable("two values in brackets are not evaluated")
            return _make_position(value)
        if isinstance(value, ExternalPose):
            raise Unreadable(f"{value.base} is not set in the text")
        if isinstance(value, Unknown):
            raise Unreadable(f"{value.what} is not set in the text")
        return value

    def combine(self, sign: str, a: Value, b: Value) -> Value:
        """The value of two numbers with an operator between them."""
        if isinstance(a, Either) or isinstance(b, Either):
            pairs = zip(*spread(a, b), strict=True)
            return join([require_number(calculate(sign, *pair)) for pair in pairs])
        return calculate(sign, require_number(a), require_number(b))

    def read_number(self, text: str) -> float:
        """The value of an expression. Raises Unreadable if it is not a number."""
        value = self.evaluate(parse(text))
        if not isinstance(value, float):
            raise Unreadable(f"{text} is not a number")
        return value

    def _call_function(self, name: str, parts: tuple[Node, ...]) -> Value:
        values = [self.evaluate(part) for part in parts]
        if name == "mps":
            if len(values) != 1 or not isinstance(values[0], (float, Either)):
                raise Unreadable("Mps needs one number")
            return Mps(values[0])
        if name not in _FUNCTIONS:
            raise Unreadable(f"the function {name} is not evaluated")
        numbers: list[Value] = [require_number(value) for value in values]
        return _make_position(tuple(numbers)) if name == "p" else call(name, numbers)

    # -- motions -------------------------------------------------------------------------------

    def blend_of(self, mark: str | Node) -> float:
        """The blend of a pass mark, mm."""
        if isinstance(mark, Node):
            raise Unreadable("a pass mark by an expression is not evaluated")
        blend = self.machine.blends.get(mark)
        return self.machine.blend(mark) if blend is None else blend

    def speed_of(self, expression: str) -> Speed:
        """The internal speed of a motion in the usual spelling."""
        if not expression:
            return self.machine.internal_speed()
        speed = self.speeds.get(expression)
        if speed is None:
            speed = self.speeds[expression] = check_speed(self.evaluate(parse(expression)))
        return speed

    def read_speed(self, motion: Motion) -> Speed:
        """The internal speed of a motion. Other options are findings."""
        for name in motion.options:
            if name in ("accel", "decel"):
                what = f"a motion with an {name.capitalize()} of its own"
                self.machine.remark(f"{what}, which no option asks for")
            elif name != "speed":
                raise Unreadable(f"the option {name} of a motion is not evaluated")
        if "speed" not in motion.options:
            return self.machine.internal_speed()
        return check_speed(self.evaluate(motion.options["speed"]))

    def find_start(self) -> Pose:
        """The place of the arm. Raises Unreadable if the text does not give it."""
        if isinstance(self.machine.current_pose, ExternalPose):
            raise Unreadable("a motion from a place that the text does not give")
        return self.machine.current_pose

    def place_of(self, node: Node) -> Value:
        """A place to move to."""
        value = self.evaluate(node)
        if not isinstance(value, (Pose, Joints)):
            raise Unreadable(f"{describe_value(value)} is not a place to move to")
        return value

    def go(
        self, linear: bool, target: Value, speed: Speed, blend: float, at_once: bool = False
    ) -> None:
        """Moves to a place. With `at_once` the next statement does not wait for the arm."""
        if isinstance(target, Unknown):
            raise Unreadable(f"{target.what} is not evaluated")
        if linear and isinstance(target, Joints):
            raise Unreadable("a straight line to joints is not evaluated")
        go(self, linear, target, speed, blend)
        self.machine.passing = self.machine.passing or at_once

    def arc(
        self, via: Value, end: Value, speed: Speed, blend: float, at_once: bool = False
    ) -> None:
        """Moves through `via` to `end`."""
        machine = self.machine
        if not isinstance(via, Pose) or not isinstance(end, Pose):
            raise Unreadable("an arc through joints is not evaluated")
        if isinstance(machine.current_pose, ExternalPose):
            machine.fault("an arc from a place that the text does not give")
        elif fault := _find_arc_fault(machine.current_pose.origin, via.origin, end.origin):
            machine.fault(fault)
        _compare_figures(machine, via, end)
        posture, figure = posture_of(end)
        via, end = (Pose(place.rotation, place.origin) for place in (via, end))
        mm_s, share = machine.speed(speed)
        item = MoveC(via, end, mm_s, blend, *machine.pressing, posture=posture)
        machine.move(machine.pace(item, share, ""), blend > 0 or at_once)
        machine.figure = figure


def _check_type(name: str, kind: str, value: Value) -> None:
    if not TYPES[kind](value):
        raise Unreadable(f"{name} is {kind.capitalize()} and does not hold this value")


def _make_position(values: tuple[Value, ...]) -> Pose:
    """The pose of `P(x, y, z, rx, ry, rz, fig)`, mm and deg. A figure of -1 is open."""
    numbers = [require_number(value) for value in values]
    if len(numbers) > 6 and numbers[6] != UNDEFINED:
        index(numbers[6])
    return position(numbers)


def _compare_figures(machine: StrictMachine, via: Pose, end: Pose) -> None:
    """Adds findings if the via point and the end of an arc have different figures.

    The reference asks for the same figure at both ends. It does not define that of the via point.
    """
    if isinstance(via, PoseWithFigure) and isinstance(end, PoseWithFigure):
        if via.figure != end.figure:
            machine.fault("the points of the arc have different figures")
    elif isinstance(via, PoseWithFigure):
        machine.remark(f"the via point of an arc has figure {via.figure}, its end leaves it open")
    elif isinstance(end, PoseWithFigure):
        machine.remark(f"the via point of an arc leaves its figure open, its end has {end.figure}")


def _find_arc_fault(start: Vec3, via: Vec3, end: Vec3) -> str:
    """The fault of an arc through three points, empty without one.

    The angle at the via point is half the arc on the other side of the chord.
    """
    x, y, z = via
    a_x, a_y, a_z = start[0] - x, start[1] - y, start[2] - z
    b_x, b_y, b_z = end[0] - x, end[1] - y, end[2] - z
    product = math.hypot(a_x, a_y, a_z) * math.hypot(b_x, b_y, b_z)
    cross = math.hypot(a_y * b_z - a_z * b_y, a_z * b_x - a_x * b_z, a_x * b_y - a_y * b_x)
    if cross <= 1e-6 * product:
        return "the three points of the arc are on one line"
    cosine = (a_x * b_x + a_y * b_y + a_z * b_z) / product
    return "an arc of more than 180 deg" if cosine > 0.01 else ""
