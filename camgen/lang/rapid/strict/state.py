"""State of a RAPID program of a post: the machine with declared names and typed values.

The types are those of the RAPID system data types manual, the predefined data those of its chapters
speeddata and zonedata. Units: mm, deg, mm/s, kg.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import cast

from msgspec import Struct

from camgen.lang.programs import RunRequest
from camgen.lang.rapid.functions import SPECIAL
from camgen.lang.rapid.machine import Machine, RoutineScope
from camgen.lang.rapid.places import pose_of
from camgen.lang.rapid.tokens import Wrong
from camgen.lang.rapid.tree import Calling, Expr, Module, Point, Ref, Routine, Run, name_reference
from camgen.lang.rapid.types import LITERAL, PREDEFINED, TYPES, UNUSED, Value
from camgen.lang.rapid.values import Variable
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import BodyBuilder, Instruction, Joints, Posture
from camgen.model.text import counted

from .expected import PostSettings, check_load

#: Data of the system whose values depend on the robot. They are not read.
_OF_THE_ROBOT = frozenset(("vmax", "load0"))


class Bound(Struct, frozen=True, eq=False):
    """A motion without its points.

    name: name of the instruction in lower case.
    speed: mm/s.
    blend: blend radius, mm.
    values: values of all arguments, by name.
    posture: configuration of the target, None if it is all zeros.
    turn: maximum speed of reorientation, rad/s.
    """

    name: str
    speed: float
    blend: float
    values: Mapping[str, Value]
    posture: Posture | None = None
    turn: float = 0.0


@dataclass(eq=False, kw_only=True)
class State(Machine):
    """The program that has been read so far, and the state after it.

    settings: options of the post.
    modules: modules, and `module_names` their names in lower case.
    declared: data of all modules.
    scopes: scope of each routine. Routines of a module without data of their own share one.
    used: names of data that are used, in lower case.
    ran: routines in the order in which they were first run.
    handling: routines that ERROR handlers call.
    packing: N instructions.
    lines: (N,) line of each instruction.
    set_up: name and frame of the tool and of the work object.
    moved: whether the program has moved.
    count: number of statements that were run.
    supervised: state of ConfJ and ConfL, and the line that set it.
    postures: whether targets state a configuration, for ConfJ and ConfL.
    singularity: argument of SingArea, empty without one.
    acceleration: arguments of AccSet, empty without one.
    calibrated: whether the force sensor was calibrated after the last section with force.
    is_settled: whether the last statement was WaitTime with InPos, which waits for standstill.
    pressed: whether a section with force has started.
    free_targets: targets after the last section with force. The (N, 3) targets of a sequence of
        statements are an array, mm.
    waiting: statements that wait to be run, each sequence with the scope of its routine.
    """

    request: RunRequest = field(default_factory=RunRequest)
    settings: PostSettings
    modules: list[Module] = field(default_factory=list)
    module_names: set[str] = field(default_factory=set)
    declared: list[Variable] = field(default_factory=list)
    scopes: dict[Routine, RoutineScope] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    ran: dict[Routine, None] = field(default_factory=dict)
    handling: set[Routine] = field(default_factory=set)
    packing: BodyBuilder = field(default_factory=BodyBuilder)
    lines: array[int] = field(default_factory=partial(array, "q"))
    set_up: dict[str, tuple[str, Pose | None]] = field(default_factory=dict)
    moved: bool = False
    count: int = 0
    supervised: dict[str, tuple[bool, int]] = field(default_factory=dict)
    postures: set[tuple[str, bool]] = field(default_factory=set)
    singularity: str = ""
    acceleration: tuple[float, ...] = ()
    calibrated: bool = False
    is_settled: bool = False
    pressed: bool = False
    free_targets: list[Pose | Joints | FloatArray] = field(default_factory=list)
    waiting: list[tuple[Run, RoutineScope]] = field(default_factory=list)

    def add(self, item: Instruction) -> None:
        """Adds an instruction of the line that runs."""
        self.packing.append(item)
        self.lines.append(self.line)

    # -- names and values: each has its type

    def find_system_data(self, name: str) -> Variable | None:
        """Data that the system declares and whose values do not depend on the robot."""
        return super().find_system_data(name) if name.lower() in PREDEFINED else None

    def known(self, expr: Expr | None) -> bool:
        """Whether an expression is a name that is declared or predefined."""
        return isinstance(expr, Ref) and self.variable(expr.name) is not None

    def typed(self, expr: Expr | None, want: str, line: int = 0) -> Value:
        """The value of an expression of the type `want`. Raises Wrong if it is of another type.

        line: line of the expression, 0 for the line that runs.
        """
        line = line or self.line
        if isinstance(expr, Ref):
            return self._read_name(expr.name, want, line)
        if isinstance(expr, Calling):
            return self._call_function(expr, want)
        if isinstance(expr, Point):
            if want != "robtarget":
                raise Wrong(line, f"a robtarget stands where {want} is needed")
            what = _find_orient_fault(expr.value[1]) or _find_posture_fault(expr.value[2:])
            if what:
                raise Wrong(line, what)
            return expr.value
        if want in TYPES:
            return self._read_record(expr, want, line)
        if isinstance(expr, (float, bool, str)) and type(expr) is LITERAL.get(want):
            return expr
        raise Wrong(line, f"a value of type {want} is needed")

    def _read_record(self, expr: Expr | None, want: str, line: int) -> Value:
        components = TYPES[want]
        if not isinstance(expr, tuple):
            raise Wrong(line, f"a value of type {want} is needed")
        if len(expr) != len(components):
            raise Wrong(
                line, f"{want} has {counted(len(components), 'component')}, not {len(expr)}"
            )
        value = tuple(
            self.typed(item, part, line) for item, (_, part) in zip(expr, components, strict=True)
        )
        what = _find_record_fault(want, value)
        if what:
            raise Wrong(line, what)
        return value

    def _read_name(self, name: str, want: str, line: int) -> Value:
        variable = self.variable(name)
        if variable is None and name.lower() in _OF_THE_ROBOT:
            raise Wrong(line, f"{name} depends on the robot and is not read")
        if variable is None:
            raise Wrong(line, f"{name[:40]} is not declared")
        if variable.type != want:
            raise Wrong(line, f"{name} is {variable.type}, not {want}")
        value: Value = self.load(variable)
        if variable.fault is not None:
            raise variable.fault
        self.used.add(name.lower())
        return value

    def begin_value(self, variable: Variable) -> Value:
        """The initial value of a declaration. Raises Wrong if it has none."""
        if variable.type not in TYPES and variable.type not in LITERAL:
            raise Wrong(variable.line, f"the data type {variable.type[:40]} is not read")
        if variable.start is None:
            raise Wrong(variable.line, f"{variable.name} has no value")
        return self.typed(variable.start, variable.type, variable.line)

    def _call_function(self, call: Calling, want: str) -> Value:
        if call.name not in ("offs", "reltool") or want != "robtarget":
            raise Wrong(call.line, f"the function {call.name[:40]} is not read here")
        if len(call.args) != 4:
            raise Wrong(call.line, f"{call.name} has 4 arguments, not {len(call.args)}")
        self.typed(call.args[0], "robtarget", call.line)
        for number in call.values[1:]:
            self.typed(number, "num", call.line)
        angles = [name for name, _ in call.options]
        if call.name == "offs" and angles:
            raise Wrong(call.line, "Offs has no optional argument")
        if len(angles) > 1 or any(name not in ("rx", "ry", "rz") for name in angles):
            raise Wrong(call.line, "RelTool is read with one of Rx, Ry, Rz only")
        value: Value = SPECIAL[call.name](self, call)
        return value

    def turned(self, q: tuple[float, ...]) -> FloatArray | None:
        """The rotation matrix of a quaternion as written, None if it is not normalised."""
        return None if q not in self.turns and _find_orient_fault(q) else self.rotation(q)

    # -- statements

    def note_target(self, targets: Pose | Joints | FloatArray) -> None:
        """Adds targets to those after the last section with force, if there was one."""
        if self.pressed:
            self.free_targets.append(targets)

    def remark(self, what: str, *, line: int = 0) -> None:
        """Adds an unusual finding of the line that runs, or of another one, once.

        Nothing is added if `what` is empty.
        """
        if what:
            self.log.find("unusual", what, line=line, once=what)

    def stopped(self, what: str) -> None:
        """Adds a finding if the last motion does not stop before `what`."""
        if self.blending:
            self.log.find("refused", f"a motion that blends before {what}", line=self.blending)
            self.blending = 0

    def set_frame(self, kind: str, expr: Expr | None, value: Value | None) -> None:
        """Sets the tool or the work object of a motion.

        Raises Wrong if the program has another one already.
        """
        name = name_reference(expr)
        if kind not in self.set_up:
            frame = None if value is None else self._read_frame(kind, value)
            self.set_up[kind] = (name.lower(), frame)
            if kind == "tool" and value is not None:
                self.remark(check_load(self.settings, cast(tuple[Value, ...], value)[2]))
        elif self.set_up[kind][0] != name.lower():
            raise self.wrong(f"{name} is a second {'tool' if kind == 'tool' else 'work object'}")

    def _read_frame(self, kind: str, value: Value) -> Pose:
        """The frame of a tool or a work object. Raises Wrong for one that posts do not write."""
        if kind == "tool":
            held, frame, load = cast(tuple[Value, ...], value)
            if not held:
                raise self.wrong("a tool that the robot does not hold is not read")
            if numbers(load)[0] <= 0:
                raise self.wrong("the mass of a tool must be positive")
            return pose_of(self, frame)
        held, fixed, unit, user, part = cast(tuple[Value, ...], value)
        if held or not fixed or unit:
            raise self.wrong("a work object that is held or moved is not read")
        return pose_of(self, user) @ pose_of(self, part)


# Faults of records (RAPID system data types manual).


def numbers(value: Value) -> tuple[float, ...]:
    """A value whose type was checked to be numbers only."""
    return cast(tuple[float, ...], value)


def _find_record_fault(kind: str, value: Value) -> str:
    """The fault of the numbers of a record, empty without one."""
    if kind == "orient":
        return _find_orient_fault(numbers(value))
    return _find_fault(kind, numbers(value))


@lru_cache(maxsize=1000)
def _find_posture_fault(parts: tuple[tuple[float, ...], ...]) -> str:
    """The fault of the configuration or the external axes of a robtarget, empty without one."""
    conf, external = parts
    return _find_fault("confdata", conf) or _find_fault("extjoint", external)


def _find_orient_fault(q: tuple[float, ...]) -> str:
    """The fault of a quaternion, empty without one."""
    w, x, y, z = q
    deviation = abs(w * w + x * x + y * y + z * z - 1)
    if deviation <= 1e-5:
        return ""
    return f"a quaternion is not normalised (its square differs from 1 by {deviation:.2g})"


def _find_fault(kind: str, parts: tuple[float, ...]) -> str:
    is_wrong, fault = _FAULTS.get(kind, (None, ""))
    if is_wrong is not None and is_wrong(parts):
        return fault
    return ""


#: Test of the numbers of a record for the fault after it.
_FAULTS: dict[str, tuple[Callable[[tuple[float, ...]], bool], str]] = {
    "extjoint": (lambda axes: any(v != UNUSED for v in axes), "external axes are not read"),
    "confdata": (lambda conf: any(v != int(v) for v in conf), "confdata must be whole numbers"),
    "speeddata": (
        lambda speed: min(speed[:2]) <= 0 or min(speed) < 0,
        "a speed that is not positive",
    ),
    "zonedata": (
        lambda zone: not zone[0] and zone[1] <= 0,
        "a zone that is not a stop point must have a radius",
    ),
}
