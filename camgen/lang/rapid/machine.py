"""The state of a RAPID program that runs: its names, its data, and the instructions so far."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, MutableSequence
from dataclasses import dataclass, field
from itertools import count

from msgspec import Struct

from camgen.lang.code import Code
from camgen.lang.log import Log
from camgen.lang.programs import Frames, RunRequest
from camgen.lang.values import Unknown, find_first_unknown
from camgen.model.instructions import Instruction
from camgen.model.pose import FloatArray, Pose, rotation_from_quaternion
from camgen.model.text import counted

from .tokens import Wrong
from .tree import (
    Calling,
    Component,
    Data,
    Element,
    Expr,
    Hole,
    Maybe,
    Negation,
    Operation,
    Point,
    Ref,
    Routine,
    find_root,
)
from .types import MORE, MORE_TYPES, NUMBERS, PREDEFINED, TEXTS, TYPES, USER
from .values import (
    NOTHING,
    UserValue,
    Value,
    Variable,
    copy_arrays,
    find_unknown,
    negate,
    operate,
    replace_part,
)

#: Elements of the longest array that is stored. A longer one has an unknown value.
_LONGEST_ARRAY = 100_000
_ATOMS: dict[str, type] = {**dict.fromkeys(NUMBERS, float), "bool": bool, "string": str}
#: Error numbers of the run begin with this.
_FIRST_ERROR = 1001
#: Declarations that may wait for each other's values. Longer chains are refused as circles.
_LONGEST_CHAIN = 50


#: Data or a part of them: the variable, the index of each component and element on the path to the
#: part, its type, and its dimensions.
Place = tuple[Variable, tuple[int, ...], str, int]
#: An interrupt: the identity of its data, and the path to the element within them.
InterruptKey = tuple[int, tuple[int, ...]]


@dataclass(eq=False)
class ModuleScope:
    """The local names of a module, in lower case."""

    name: str
    data: dict[str, Variable] = field(default_factory=dict)
    routines: dict[str, Routine] = field(default_factory=dict)


@dataclass(eq=False)
class RoutineScope:
    """The names that a running routine sees.

    routine: the routine, None while declarations are evaluated.
    home: names of its module.
    data: its local data by name in lower case.
    counters: names of the variables of the FORs that run, each with the data that it hides.
    result: value of RETURN.
    """

    routine: Routine | None
    home: ModuleScope
    data: dict[str, Variable] = field(default_factory=dict)
    counters: list[tuple[str, Variable | None]] = field(default_factory=list)
    result: Value = NOTHING

    def add_counter(self, name: str) -> Variable:
        """Add the variable of a FOR."""
        key = name.lower()
        self.counters.append((key, self.data.get(key)))
        counter = self.data[key] = Variable(name, "num", "counter")
        return counter

    def drop_counters(self, count: int) -> None:
        """Remove the variables of all FORs but the first `count`."""
        while len(self.counters) > count:
            key, hidden = self.counters.pop()
            del self.data[key]
            if hidden is not None:
                self.data[key] = hidden


class RobotPosition(Struct, frozen=True, eq=False):
    """The position of the arm: a pose, or joint values, or neither if it is not known.

    pose: pose of the TCP in the work frame, mm.
    frame: index of the work frame in `Machine.frames`.
    rest: configuration and external axes of the target.
    joints: joint values, deg.
    """

    pose: Pose | None = None
    frame: int = -1
    rest: tuple[Value, ...] = ()
    joints: tuple[float, ...] | None = None


@dataclass(eq=False)
class Machine:
    """The robot and the memory of its program.

    request: settings of the run, with the values that the user gives.
    body: instructions so far.
    lines: line of each instruction.
    frame_of: index into `frames` of each instruction.
    frames: tool and work frames that motions use.
    frame_keys: index into `frames` by the data of tool and work object.
    frame: index into `frames` of the last motion.
    data: global data by name in lower case.
    routines: global routines by name in lower case.
    codes: compiled steps of each routine.
    homes: module of each routine.
    types: components of each record type, name and type.
    aliases: data type that an ALIAS stands for.
    outputs: value last set of each signal, by name in lower case.
    scope: names of the routine that runs.
    line: line of the statement that runs.
    position: position of the arm.
    external: values of the external axes in the last target.
    placed: work objects of frames that are not in the program text.
    placed_here: last position with such a frame, and the name of the frame.
    displaced: program displacement, None without one.
    has_conf_l: whether configurations are supervised on straight motions and arcs.
    speed_override: factor of VelSet on all speeds.
    speed_most: maximum speed of VelSet, mm/s, 0 without one.
    passes_circle_point: whether arcs pass the orientation of the circle point.
    blending: line of the last motion if it blends and nothing was switched since, else 0.
    changes: number of assignments that changed data.
    version: number of assignments to records and arrays.
    pressing: axis of the tool and sign of the force, None without force control.
    welding: whether the arc burns.
    errors: numbers of errors that no error has yet. The numbers of the controller are not known.
    pending: data whose declarations are being evaluated.
    turns: rotation matrix of each quaternion so far.
    bound: arguments of motions that were evaluated before.
    connected: TRAP of each interrupt.
    asleep: interrupts that ISleep switched off.
    arrived: TRAPs whose interrupt has come.
    due: TRAPs that run next.
    held: whether IDisable makes interrupts wait.
    polled: data that are set outside of the program, whose value in the text does not count.
    call: runs a routine of the text; a FUNC returns a value.
    function: evaluates a function.
    interrupt: called with each interrupt that may come at a place of a motion.
    log: findings, assumptions and facts.
    """

    request: RunRequest
    body: list[Instruction] = field(default_factory=list)
    lines: MutableSequence[int] = field(default_factory=list)
    frame_of: list[int] = field(default_factory=list)
    frames: list[Frames] = field(default_factory=list)
    frame_keys: dict[tuple[Value, ...], int] = field(default_factory=dict)
    frame: int = 0
    data: dict[str, Variable] = field(default_factory=dict)
    routines: dict[str, Routine] = field(default_factory=dict)
    codes: dict[Routine, Code] = field(default_factory=dict)
    homes: dict[Routine, ModuleScope] = field(default_factory=dict)
    types: dict[str, tuple[tuple[str, str], ...]] = field(
        default_factory=lambda: TYPES | MORE_TYPES
    )
    aliases: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, float] = field(default_factory=dict)
    scope: RoutineScope = field(default_factory=lambda: RoutineScope(None, ModuleScope("")))
    line: int = 0
    position: RobotPosition = field(default_factory=RobotPosition)
    external: Value | None = None
    placed: dict[str, str] = field(default_factory=dict)
    placed_here: tuple[RobotPosition, str] | None = None
    displaced: Pose | None = None
    has_conf_l: bool = True
    speed_override: float = 1.0
    speed_most: float = 0.0
    passes_circle_point: bool = False
    blending: int = 0
    changes: int = 0
    version: int = 0
    pressing: tuple[int, int] | None = None
    welding: bool = False
    errors: Iterator[int] = field(default_factory=lambda: count(_FIRST_ERROR))
    pending: list[Variable] = field(default_factory=list)
    turns: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)
    bound: dict[tuple[Value, ...], Value] = field(default_factory=dict)
    connected: dict[InterruptKey, Routine] = field(default_factory=dict)
    asleep: set[InterruptKey] = field(default_factory=set)
    arrived: set[Routine] = field(default_factory=set)
    due: list[Routine] = field(default_factory=list)
    held: bool = False
    polled: set[Variable] = field(default_factory=set)
    call: Callable[[Routine, Calling], Value] = lambda _routine, _call: NOTHING
    function: Callable[[Machine, Calling], Value] = lambda _machine, _call: NOTHING
    interrupt: Callable[[Machine, Expr], None] = lambda _machine, _interrupt: None
    log: Log = field(init=False)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line, self.request.shifts)

    def wrong(self, what: str) -> Wrong:
        """The exception for a fault of the line that runs."""
        return Wrong(self.line, what)

    # -- values of the user ----------------------------------------------------------------------

    def given(self, name: str) -> float | None:
        """The value that the user gives to `name`, None without one."""
        return self.request.assume.get(name.lower())

    def ask_for(self, what: str, key: str) -> Value:
        """The value that the user gives to `key`, or an unknown value described by `what`."""
        value = self.given(key)
        return Unknown(what, key.lower()) if value is None else UserValue(value)

    def settled(self, kind: str, value: Value) -> Value:
        """A value of the user converted to the type `kind`; other values as they are."""
        if type(value) is not UserValue:
            return value
        return value.meet(self.kind(kind) == "bool" or 0.0)

    def truth(self, condition: Expr, word: str) -> Value:
        """The value of a condition, which may be unknown. Raises Wrong if it is not a bool."""
        value = self.value(condition)
        if type(value) is UserValue:
            return value != 0.0
        if type(value) is not bool and not isinstance(value, Unknown):
            raise self.wrong(f"the condition of {word} is not a bool")
        return value

    # -- names -----------------------------------------------------------------------------------

    def variable(self, name: str) -> Variable | None:
        """The data that the running routine calls `name`: its own, global, or the system's."""
        key, scope = name.lower(), self.scope
        declared = scope.data.get(key) or scope.home.data.get(key) or self.data.get(key)
        return declared or self.find_system_data(name)

    def find_system_data(self, name: str) -> Variable | None:
        """Add data that the system declares to the global data."""
        key = name.lower()
        if key in PREDEFINED or key in MORE:
            kind, value = PREDEFINED[key] if key in PREDEFINED else MORE[key]
            storage = "pers" if kind in ("tooldata", "wobjdata") else "const"
            variable = Variable(name, kind, storage, value)
        elif key.startswith("err_"):
            variable = Variable(name, "errnum", "const", float(next(self.errors)))
        elif key in USER:
            variable = Variable(name, USER[key], "var", self.zero(USER[key]))
        else:
            return None
        self.data[key] = variable
        return variable

    def routine(self, name: str) -> Routine | None:
        """The routine that the running routine calls `name`."""
        return self.find_routine(self.scope.home, name.lower())

    def find_routine(self, home: ModuleScope, key: str) -> Routine | None:
        """The routine that a module calls by a name in lower case."""
        return home.routines.get(key) or self.routines.get(key)

    def kind(self, name: str) -> str:
        """A data type without its aliases."""
        for _ in range(_LONGEST_CHAIN):
            if name not in self.aliases:
                break
            name = self.aliases[name]
        return name

    def zero(self, kind: str, depth: int = 0) -> Value:
        """The initial value of data of a type."""
        kind = self.kind(kind)
        if kind in NUMBERS:
            return 0.0
        if kind == "bool":
            return False
        if kind in TEXTS:
            return ""
        if kind in self.types and depth < 10:
            return tuple(self.zero(part, depth + 1) for _, part in self.types[kind])
        return Unknown(f"data of the type {kind}")

    def fit(self, kind: str, value: Value, within: str = "") -> None:
        """Raise Wrong if a value does not have the type `kind`.

        within: type of the record that the value is a part of.
        """
        if isinstance(value, Unknown):
            return
        kind = self.kind(kind)
        parts = self.types.get(kind)
        if parts:
            if not isinstance(value, tuple):
                raise self.wrong(f"a {kind} is needed{within and f' in a {within}'}")
            if len(value) != len(parts):
                raise self.wrong(f"{kind} has {counted(len(parts), 'component')}, not {len(value)}")
            for (_, part), item in zip(parts, value, strict=True):
                self.fit(part, item, kind)
        elif kind in _ATOMS and type(value) not in (_ATOMS[kind], UserValue):
            raise self.wrong(f"a {kind} is needed{within and f' in a {within}'}")

    # -- data ------------------------------------------------------------------------------------

    def declare(self, data: Data, home: ModuleScope) -> Variable:
        """A variable whose first value is evaluated when it is read."""
        variable = Variable(data.name, data.type, data.storage, None, data.line)
        variable.start, variable.dims = data.value, data.dims
        variable.home, variable.declaration = home, data
        # `load` takes a variable as its own value for one that is not evaluated yet.
        variable.value = variable
        return variable

    def begin_value(self, variable: Variable) -> Value:
        """The first value of a variable. Raises Wrong if its declaration is invalid."""
        what = ""
        if variable.start is None and variable.storage == "pers":
            what = f"{variable.name}, which has no value here"
        elif variable in self.polled:
            what = f"{variable.name}, which is set outside of this program"
        if what:
            return self.settled(variable.type, self.ask_for(what, variable.name))
        sizes = [self.value(dim) for dim in variable.dims]
        if variable.start is None:
            return self._array(self.zero(variable.type), sizes)
        value = self.shaped(self.value(variable.start), len(variable.dims))
        if variable.dims:
            self._fit_array(variable.name, value, sizes)
        else:
            self.fit(variable.type, value)
        return value

    def _fit_array(self, name: str, value: Value, sizes: list[Value]) -> None:
        if not sizes or isinstance(value, Unknown):
            return
        if not isinstance(value, list):
            raise self.wrong(f"{name} is an array")
        if type(sizes[0]) is float and len(value) != sizes[0]:
            raise self.wrong(f"{name} has {sizes[0]:g} elements, its value {len(value)}")
        for item in value:
            self._fit_array(name, item, sizes[1:])

    def _array(self, item: Value, sizes: list[Value]) -> Value:
        length = 1.0
        for size in sizes:
            if type(size) is not float or not size >= 0:
                return Unknown("an array of unknown size")
            length *= size
        if length > _LONGEST_ARRAY:
            return Unknown("a long array")
        array = item
        for size in reversed(sizes):
            array = [copy_arrays(array) for _ in range(int(size))]
        return array

    def load(self, variable: Variable) -> Value:
        """The value of a variable."""
        if variable.base is not None:
            base, path = variable.base
            value = self.load(base)
            for place in path:
                if not isinstance(value, (tuple, list)):
                    break
                value = value[place]
            return value
        if variable.value is variable:
            self._evaluate_declaration(variable)
        return variable.value

    def _evaluate_declaration(self, variable: Variable) -> None:
        if variable in self.pending or len(self.pending) > _LONGEST_CHAIN:
            variable.value = Unknown(f"{variable.name}, which is defined by itself")
            variable.fault = Wrong(
                variable.line, f"{variable.name} is defined by itself or through too many others"
            )
            raise variable.fault
        scope, line = self.scope, self.line
        self.pending.append(variable)
        if isinstance(variable.home, ModuleScope) and scope.home is not variable.home:
            self.scope = RoutineScope(None, variable.home)
        self.line = variable.line
        try:
            variable.value = self.begin_value(variable)
        except Wrong as wrong:
            variable.value = Unknown(f"{variable.name}, whose value is wrong")
            variable.fault = wrong
            self.log.find("refused", wrong.what, line=wrong.line)
        finally:
            self.pending.pop()
            self.scope, self.line = scope, line

    def shaped(self, value: Value, dims: int) -> Value:
        """An aggregate as an array of `dims` dimensions; other values as they are."""
        if dims <= 0 or not isinstance(value, tuple):
            return copy_arrays(value)
        return [self.shaped(item, dims - 1) for item in value]

    def store(self, variable: Variable, path: tuple[int, ...], value: Value) -> None:
        """Give data, or the part of them at a path, a value."""
        if variable.base is not None:
            base, before = variable.base
            self.store(base, (*before, *path), value)
            return
        old = self.load(variable)
        if path:
            try:
                if not variable.dims:
                    old = self._spread(self.kind(variable.type), old, path)
                value = replace_part(old, path, value)
            except (IndexError, TypeError):
                return
            self.changes += 1
        elif type(old) is not type(value) or old != value:
            self.changes += 1
        variable.value = value
        if not isinstance(value, (float, bool, str)):
            self.version += 1

    def _spread(self, kind: str, old: Value, path: tuple[int, ...]) -> Value:
        """The old value, with one unknown value for each part if it is unknown as a whole."""
        if kind not in self.types or not path:
            return old
        parts = [part for _, part in self.types[kind]]
        unknown = find_unknown(old) if isinstance(old, Unknown) else None
        whole = old if unknown is None else tuple(unknown for _ in parts)
        place = path[0]
        if not isinstance(whole, tuple) or place >= min(len(parts), len(whole)):
            return whole
        inner = self._spread(self.kind(parts[place]), whole[place], path[1:])
        return (*whole[:place], inner, *whole[place + 1 :])

    # -- expressions -----------------------------------------------------------------------------

    def value(self, expr: Expr | None) -> Value:
        """The value of an expression. Raises Wrong if no controller can evaluate it."""
        kind = type(expr)
        if kind is float or kind is bool or kind is str:
            return expr
        if kind is Ref:
            return self._named(expr.name)  # type: ignore[union-attr]
        return _VALUES[kind](self, expr)

    def number(self, expr: Expr | None) -> Value:
        """The value of an expression as a num, which may be unknown. A bool counts as 0 or 1.

        Raises Wrong if it is neither.
        """
        value = self.value(expr)
        if type(value) is float or isinstance(value, Unknown):
            return value
        if type(value) in (UserValue, bool):
            return float(value)
        raise self.wrong("a num is needed")

    def _named(self, name: str) -> Value:
        variable = self.variable(name)
        return self.read_signal(name) if variable is None else self.load(variable)

    def read_signal(self, name: str) -> Value:
        """The value of a signal: the user's, else the one that the program last set."""
        key = name.lower()
        if key in self.outputs and key not in self.request.assume:
            return self.outputs[key]
        return self.ask_for(name, key)

    def place(self, expr: Expr | None) -> Place | None:
        """The data to which an expression refers, None if this is not known.

        Raises Wrong if there is no such part.
        """
        if isinstance(expr, (Component, Element)):
            inner = self.place(expr.base)
            if inner is None:
                return None
            if isinstance(expr, Component):
                return self._find_component(expr, *inner)
            return self._find_element(expr, *inner)
        variable = self.variable(expr.name) if isinstance(expr, Ref) else None
        if variable is None:
            return None
        return variable, (), self.kind(variable.type), len(variable.dims)

    def _find_component(
        self, expr: Component, variable: Variable, path: tuple[int, ...], kind: str, dims: int
    ) -> Place | None:
        if not self.types.get(kind):
            return None
        names = [name for name, _ in self.types[kind]]
        if expr.name not in names:
            raise self.wrong(f"{kind} has no component {expr.name[:40]}")
        index = names.index(expr.name)
        return variable, (*path, index), self.kind(self.types[kind][index][1]), dims

    def _find_element(
        self, expr: Element, variable: Variable, path: tuple[int, ...], kind: str, dims: int
    ) -> Place | None:
        value = self.load(variable)
        for place in path:
            value = value[place] if isinstance(value, (tuple, list)) else None
        for index in expr.index:
            number = self.number(index)
            if isinstance(number, Unknown) or not isinstance(value, list):
                return None
            if not 1 <= number <= len(value):
                raise self.wrong(f"element {number:g} of {variable.name}, which has {len(value)}")
            path = (*path, int(number) - 1)
            value = value[path[-1]]
        return variable, path, kind, max(dims - len(expr.index), 0)

    def part(self, expr: Expr) -> Value:
        """The value of a component or an element."""
        place = self.place(expr)
        if place is None:
            return find_unknown(self.value(find_root(expr))) or NOTHING
        variable, path, _, _ = place
        value = self.load(variable)
        for index in path:
            if not isinstance(value, (tuple, list)):
                return find_unknown(value) or NOTHING
            if index >= len(value):
                return NOTHING
            value = value[index]
        return value

    def assign(self, target: Expr, value: Value) -> None:
        """``target := value``."""
        place = self.place(target)
        if place is None:
            self._forget_arrays(target)
            return
        variable, path, kind, dims = place
        if variable.storage == "const":
            raise self.wrong(f"{variable.name} is a constant")
        if not dims:
            self.fit(kind, value)
        self.store(variable, path, self.shaped(self.settled(kind, value), dims))

    def _forget_arrays(self, target: Expr) -> None:
        """Make an array unknown if the index of the element to be set is unknown."""
        while isinstance(target, (Component, Element)):
            if isinstance(target, Element):
                unknown = find_first_unknown(map(self.value, target.index))
                if unknown is not None and isinstance(target.base, Ref):
                    self.assign(target.base, Unknown(unknown.what))
            target = target.base

    # -- poses -----------------------------------------------------------------------------------

    def rotation(self, q: tuple[float, ...]) -> FloatArray:
        """The rotation matrix of a quaternion; equal quaternions share one matrix."""
        matrix = self.turns.get(q)
        if matrix is None:
            matrix = self.turns[q] = rotation_from_quaternion(q)
        return matrix

    def cut(self, length: int) -> None:
        """Remove all instructions but the first `length`."""
        for kept in (self.body, self.lines, self.frame_of):
            del kept[length:]

    def add(self, item: Instruction) -> None:
        """Add an instruction of the line that runs."""
        self.body.append(item)
        self.lines.append(self.line)
        self.frame_of.append(self.frame)


def _maybe(machine: Machine, expr: Maybe) -> Value:
    variable = machine.variable(expr.name)
    return NOTHING if variable is None else machine.load(variable)


def _operation(machine: Machine, expr: Operation) -> Value:
    # The tree of a + b + c is as deep on the left as the sum is long: no recursion there.
    chain, first = [expr], expr.left
    while isinstance(first, Operation):
        chain.append(first)
        first = first.left
    value = machine.value(first)
    for operation in reversed(chain):
        value = operate(operation.sign, value, machine.value(operation.right), machine.line)
    return value


_VALUES: Mapping[type, Callable[[Machine, Value], Value]] = {
    tuple: lambda machine, expr: tuple(
        machine.settled("", value) for value in map(machine.value, expr)
    ),
    Point: lambda _machine, expr: expr.value,
    Operation: _operation,
    Negation: lambda machine, expr: negate(expr.sign, machine.value(expr.value), machine.line),
    Component: lambda machine, expr: machine.part(expr),
    Element: lambda machine, expr: machine.part(expr),
    Calling: lambda machine, expr: machine.function(machine, expr),
    Maybe: _maybe,
    Hole: lambda _machine, expr: Unknown(f"{expr.text}, which the text leaves open"),
    type(None): lambda _machine, _expr: NOTHING,
}
