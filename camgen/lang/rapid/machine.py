"""The state of a RAPID program that runs: who sees which name, what data are worth, what has been done so far."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, MutableSequence
from dataclasses import dataclass, field

from msgspec import Struct

from camgen.lang.code import Code
from camgen.lang.log import Log
from camgen.lang.programs import Ask, Frames
from camgen.lang.values import Unknown
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
    Given,
    Value,
    Variable,
    copied,
    find_unknown,
    negate,
    operate,
    put,
)

#: Longest array that is made: elements.
_LONGEST_ARRAY = 100_000
_ATOMS: dict[str, type] = {**dict.fromkeys(NUMBERS, float), "bool": bool, "string": str}
_FIRST_ERROR = 1000
#: Constants that are defined by each other, in a chain.
_LONGEST_CHAIN = 50


@dataclass(eq=False)
class Home:
    """A module as its routines see it. Names in lower case."""

    name: str
    data: dict[str, Variable] = field(default_factory=dict)  # local ones
    routines: dict[str, Routine] = field(default_factory=dict)  # local ones


@dataclass(eq=False)
class Frame:
    """A routine that runs.

    routine: None while declarations are evaluated.
    home: its module.
    data: its data by name in lower case.
    counters: names of the variables of the FORs that run, each with the data that it hides.
    result: value of RETURN.
    """

    routine: Routine | None
    home: Home
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
    """Where the arm is: the pose of the TCP in the work frame ``frame``, with the configuration and the external axes
    of the target; or its joints, deg. What is not known is None.
    """

    pose: Pose | None = None
    frame: int = -1
    rest: tuple[Value, ...] = ()
    joints: tuple[float, ...] | None = None


@dataclass(eq=False)
class Machine:
    """All of it. line: of the statement that runs. call: runs a FUNC of the text, set by whoever runs routines.
    interrupt: is told of an interrupt that may come.
    """

    ask: Ask
    body: list[Instruction] = field(default_factory=list)
    lines: MutableSequence[int] = field(default_factory=list)
    frame_of: list[int] = field(default_factory=list)
    frames: list[Frames] = field(default_factory=list)
    frame_keys: dict[tuple[Value, ...], int] = field(default_factory=dict)
    frame: int = 0
    data: dict[str, Variable] = field(default_factory=dict)  # what is global
    routines: dict[str, Routine] = field(default_factory=dict)
    codes: dict[Routine, Code] = field(default_factory=dict)
    homes: dict[Routine, Home] = field(default_factory=dict)
    types: dict[str, tuple[tuple[str, str], ...]] = field(
        default_factory=lambda: TYPES | MORE_TYPES
    )
    aliases: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, float] = field(default_factory=dict)  # by name in lower case, as last set
    scope: Frame = field(default_factory=lambda: Frame(None, Home("")))
    line: int = 0
    position: RobotPosition = field(default_factory=RobotPosition)
    external: Value | None = None  # values of the external axes in the last target
    placed: dict[str, str] = field(
        default_factory=dict
    )  # work objects of frames that no text states
    placed_here: tuple[RobotPosition, str] | None = None  # the last position with such a frame
    displaced: Pose | None = None
    has_conf_l: bool = True  # whether configurations are supervised on straight motions and arcs
    speed_override: float = 1.0
    speed_most: float = 0.0
    passes_circle_point: bool = False  # whether arcs turn by way of the circle point
    blending: int = 0  # line of the last motion, where it blends and nothing was switched since
    changes: int = 0  # how often data have been given another value
    version: int = 0  # how often records have
    pressing: tuple[int, int] | None = None
    welding: bool = False
    errors: int = 0  # numbers of errors that were given
    pending: list[Variable] = field(default_factory=list)
    turns: dict[tuple[float, ...], FloatArray] = field(default_factory=dict)
    bound: dict[tuple[Value, ...], Value] = field(default_factory=dict)
    connected: dict[tuple[int, tuple[int, ...]], Routine] = field(
        default_factory=dict
    )  # TRAPs by their interrupt
    asleep: set[tuple[int, tuple[int, ...]]] = field(default_factory=set)
    come: set[Routine] = field(default_factory=set)  # TRAPs whose interrupt has come
    due: list[Routine] = field(default_factory=list)  # those that run next
    held: bool = False  # interrupts wait
    polled: set[Variable] = field(default_factory=set)  # data that are set outside of the program
    call: Callable[[Routine, Calling], Value] = lambda _routine, _call: NOTHING
    function: Callable[[Machine, Calling], Value] = lambda _machine, _call: NOTHING
    interrupt: Callable[[Machine, Expr], None] = lambda _machine, _interrupt: None
    log: Log = field(init=False)

    def __post_init__(self) -> None:
        self.log = Log(lambda: self.line, self.ask.shifts)

    def wrong(self, what: str) -> Wrong:
        """A fault of the line that runs."""
        return Wrong(self.line, what)

    def error_number(self) -> float:
        """The number of one more error; each has its own, whichever the controller gives it."""
        self.errors += 1
        return float(_FIRST_ERROR + self.errors)

    # -- what is said ----------------------------------------------------------------------------------------------

    def given(self, name: str) -> float | None:
        """What the user says of ``name``."""
        return self.ask.assume.get(name.lower())

    def ask_for(self, what: str, key: str) -> Value:
        """The value that the user gives to ``key``, or one that is not known."""
        value = self.ask.assume.get(key.lower())
        return Unknown(what, key.lower()) if value is None else Given(value)

    def settled(self, kind: str, value: Value) -> Value:
        """A value that the user gives as data of the type ``kind``."""
        return value.meet(self.kind(kind) == "bool" or 0.0) if type(value) is Given else value

    def truth(self, condition: Expr, word: str) -> Value:
        """A bool, or one that is not known. Wrong where it is neither."""
        value = self.value(condition)
        if type(value) is Given:
            return value != 0.0
        if type(value) is not bool and not isinstance(value, Unknown):
            raise self.wrong(f"the condition of {word} is no bool")
        return value

    # -- names -----------------------------------------------------------------------------------------------------

    def variable(self, name: str) -> Variable | None:
        """The data that ``name`` means where the program is, those that the system declares among them."""
        key = name.lower()
        found = self.scope.data.get(key) or self.scope.home.data.get(key) or self.data.get(key)
        return found or self.find_system(name)

    def find_system(self, name: str) -> Variable | None:
        """Data that the system declares. They are global from here on."""
        key, found = name.lower(), None
        if key in PREDEFINED or key in MORE:
            kind, value = PREDEFINED[key] if key in PREDEFINED else MORE[key]
            found = self.data[key] = Variable(
                name, kind, "pers" if kind in ("tooldata", "wobjdata") else "const", value
            )
        elif key.startswith("err_"):
            found = self.data[key] = Variable(name, "errnum", "const", self.error_number())
        elif key in USER:
            found = self.data[key] = Variable(name, USER[key], "var", self.zero(USER[key]))
        return found

    def routine(self, name: str) -> Routine | None:
        """The routine that ``name`` means where the program is."""
        return self.find_routine(self.scope.home, name.lower())

    def find_routine(self, home: Home, key: str) -> Routine | None:
        """The routine that a name in lower case means in a module."""
        return home.routines.get(key) or self.routines.get(key)

    def kind(self, name: str) -> str:
        """A data type without its aliases."""
        for _ in range(_LONGEST_CHAIN):
            if name not in self.aliases:
                break
            name = self.aliases[name]
        return name

    def zero(self, kind: str, depth: int = 0) -> Value:
        """What data of a type are worth before anybody gives them a value."""
        kind = self.kind(kind)
        if kind in NUMBERS:
            return 0.0
        if kind == "bool":
            return False
        if kind in TEXTS:
            return ""
        if kind in self.types and depth < 10:
            return tuple(self.zero(part, depth + 1) for part, _ in self._parts(kind))
        return Unknown(f"data of the type {kind}")

    def _parts(self, kind: str) -> Iterable[tuple[str, str]]:
        return [(part, name) for name, part in self.types[kind]]

    def fit(self, kind: str, value: Value, within: str = "") -> None:
        """Raises Wrong for a value that is no data of the type ``kind``. within: the record that it is part of."""
        if isinstance(value, Unknown) or type(value) is Given:
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
        elif kind in _ATOMS and type(value) is not _ATOMS[kind]:
            raise self.wrong(f"a {kind} is needed{within and f' in a {within}'}")

    # -- data ------------------------------------------------------------------------------------------------------

    def declare(self, data: Data, home: Home) -> Variable:
        """A variable whose value is worked out when it is asked for."""
        found = Variable(data.name, data.type, data.storage, None, data.line)
        found.start, found.dims, found.home, found.declaration = data.value, data.dims, home, data
        found.value = found  # worked out when it is asked for: see ``load``
        return found

    def begin_value(self, variable: Variable) -> Value:
        """The value of a variable at first. Raises Wrong if it has none."""
        if variable.start is None and variable.storage == "pers":
            found = self.ask_for(f"{variable.name}, which has no value here", variable.name)
            return self.settled(variable.type, found)
        if variable in self.polled:
            what = f"{variable.name}, which is set outside of this program"
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
        """Raises Wrong for an aggregate that has not as many elements as its array."""
        if not sizes or isinstance(value, Unknown):
            return
        if not isinstance(value, list):
            raise self.wrong(f"{name} is an array")
        if type(sizes[0]) is float and len(value) != sizes[0]:
            raise self.wrong(f"{name} has {sizes[0]:g} elements, its value {len(value)}")
        for item in value:
            self._fit_array(name, item, sizes[1:])

    def _array(self, item: Value, sizes: list[Value]) -> Value:
        count = 1.0
        for size in sizes:
            if type(size) is not float or not size >= 0:
                return Unknown("an array of unknown size")
            count *= size
        if count > _LONGEST_ARRAY:
            return Unknown("a long array")
        made = item
        for size in reversed(sizes):
            made = [copied(made) for _ in range(int(size))]
        return made

    def load(self, variable: Variable) -> Value:
        """What a variable is worth."""
        if variable.base is not None:
            base, path = variable.base
            value = self.load(base)
            for place in path:
                if not isinstance(value, (tuple, list)):
                    break
                value = value[place]
            return value
        if variable.value is variable:
            self._work_out(variable)
        return variable.value

    def _work_out(self, variable: Variable) -> None:
        """The value that a declaration gives."""
        if variable in self.pending or len(self.pending) > _LONGEST_CHAIN:
            variable.value = Unknown(f"{variable.name}, which is defined by itself")
            variable.fault = Wrong(
                variable.line, f"{variable.name} is defined by itself or through too many others"
            )
            raise variable.fault
        scope, line = self.scope, self.line
        self.pending.append(variable)
        if isinstance(variable.home, Home) and scope.home is not variable.home:
            self.scope = Frame(None, variable.home)
        self.line = variable.line
        try:
            variable.value = self.begin_value(variable)
        except Wrong as wrong:
            variable.value, variable.fault = (
                Unknown(f"{variable.name}, whose value is wrong"),
                wrong,
            )
            self.log.find("refused", wrong.what, line=wrong.line)
        finally:
            self.pending.pop()
            self.scope, self.line = scope, line

    def shaped(self, value: Value, dims: int) -> Value:
        """An aggregate as an array of so many dimensions."""
        if dims <= 0 or not isinstance(value, tuple):
            return copied(value)
        return [self.shaped(item, dims - 1) for item in value]

    def store(self, variable: Variable, path: tuple[int, ...], value: Value) -> None:
        """Gives data, or a part of them, a value."""
        if variable.base is not None:
            base, before = variable.base
            self.store(base, (*before, *path), value)
            return
        old = self.load(variable)
        if path:
            try:
                value = put(self._spread(variable, old, path), path, value)
            except (IndexError, TypeError):
                return
            self.changes += 1
        elif type(old) is not type(value) or old != value:
            self.changes += 1
        variable.value = value
        if not isinstance(value, (float, bool, str)):
            self.version += 1

    def _spread(self, variable: Variable, old: Value, path: tuple[int, ...]) -> Value:
        """The old value, with parts of its own where it was not known as a whole."""
        kind = self.kind(variable.type)
        if variable.dims or not isinstance(old, (Unknown, tuple)) or kind not in self.types:
            return old
        return self._spread_record(kind, old, path)

    def _spread_record(self, kind: str, old: Value, path: tuple[int, ...]) -> Value:
        if kind not in self.types or not path:
            return old
        parts = [part for part, _ in self._parts(kind)]
        unknown = find_unknown(old) if isinstance(old, Unknown) else None
        whole = old if unknown is None else tuple(unknown for _ in parts)
        place = path[0]
        if not isinstance(whole, tuple) or place >= min(len(parts), len(whole)):
            return whole
        inner = self._spread_record(self.kind(parts[place]), whole[place], path[1:])
        return (*whole[:place], inner, *whole[place + 1 :])

    # -- expressions -----------------------------------------------------------------------------------------------

    def value(self, expr: Expr | None) -> Value:
        """What an expression is worth. Wrong where no controller can work it out."""
        kind = type(expr)
        if kind is float or kind is bool or kind is str:
            return expr
        if kind is Ref:
            return self._named(expr.name)  # type: ignore[union-attr]
        return _VALUES[kind](self, expr)

    def number(self, expr: Expr | None) -> Value:
        """A num, or one that is not known. Wrong where it is neither."""
        found = self.value(expr)
        if type(found) is float or isinstance(found, Unknown):
            return found
        if type(found) is Given:
            return float(found)
        if type(found) is bool:
            return float(found)
        raise self.wrong("a num is needed")

    def _named(self, name: str) -> Value:
        variable = self.variable(name)
        if variable is not None:
            return self.load(variable)
        key = name.lower()
        if key in self.outputs and key not in self.ask.assume:
            return self.outputs[key]
        return self.ask_for(name, key)

    def place(self, expr: Expr) -> tuple[Variable, tuple[int, ...], str, int] | None:
        """The data that an expression names, the places within them, the type there and the dimensions that are left;
        None where that is not known. Wrong where there is no such part.
        """
        if isinstance(expr, Ref):
            found = self.variable(expr.name)
            return None if found is None else (found, (), self.kind(found.type), len(found.dims))
        if isinstance(expr, Component):
            return self._component(expr)
        return self._element(expr) if isinstance(expr, Element) else None

    def _component(self, expr: Component) -> tuple[Variable, tuple[int, ...], str, int] | None:
        inner = self.place(expr.base)
        if inner is None:
            return None
        variable, path, kind, dims = inner
        if kind not in self.types or not self.types[kind]:
            return None
        names = [name for name, _ in self.types[kind]]
        if expr.name not in names:
            raise self.wrong(f"{kind} has no component {expr.name[:40]}")
        at = names.index(expr.name)
        return variable, (*path, at), self.kind(self.types[kind][at][1]), dims

    def _element(self, expr: Element) -> tuple[Variable, tuple[int, ...], str, int] | None:
        inner = self.place(expr.base)
        if inner is None:
            return None
        variable, path, kind, dims = inner
        value = self.load(variable)
        for place in path:
            value = value[place] if isinstance(value, (tuple, list)) else None
        places = []
        for index in expr.index:
            at = self.number(index)
            if isinstance(at, Unknown) or not isinstance(value, list):
                return None
            if not 1 <= at <= len(value):
                raise self.wrong(f"element {at:g} of {variable.name}, which has {len(value)}")
            places.append(int(at) - 1)
            value = value[int(at) - 1]
        return variable, (*path, *places), kind, max(dims - len(places), 0)

    def part(self, expr: Expr) -> Value:
        """The worth of a component or an element."""
        found = self.place(expr)
        if found is None:
            return find_unknown(self.value(find_root(expr))) or NOTHING
        variable, path, _, _ = found
        value = self.load(variable)
        for place in path:
            if not isinstance(value, (tuple, list)):
                return find_unknown(value) or NOTHING
            if place >= len(value):
                return NOTHING
            value = value[place]
        return value

    def assign(self, target: Expr, value: Value) -> None:
        """``target := value``."""
        found = self.place(target)
        if found is None:
            self._blur(target)
            return
        variable, path, kind, dims = found
        if variable.storage == "const":
            raise self.wrong(f"{variable.name} is a constant")
        if not dims:
            self.fit(kind, value)
        self.store(variable, path, self.shaped(self.settled(kind, value), dims))

    def _blur(self, target: Expr) -> None:
        """An element whose index is not known: the array is not known from here on."""
        while isinstance(target, (Component, Element)):
            if isinstance(target, Element):
                unknown = next(
                    (v for v in map(self.value, target.index) if isinstance(v, Unknown)), None
                )
                if unknown is not None and isinstance(target.base, Ref):
                    self.assign(target.base, Unknown(unknown.what))
            target = target.base

    # -- poses -----------------------------------------------------------------------------------------------------

    def rotation(self, q: tuple[float, ...]) -> FloatArray:
        """The rotation of a quaternion; the same ones share one matrix."""
        found = self.turns.get(q)
        if found is None:
            found = self.turns[q] = rotation_from_quaternion(q)
        return found

    def cut(self, length: int) -> None:
        """Remove all instructions but the first `length`."""
        for kept in (self.body, self.lines, self.frame_of):
            del kept[length:]

    def add(self, item: Instruction) -> None:
        """One more instruction."""
        self.body.append(item)
        self.lines.append(self.line)
        self.frame_of.append(self.frame)


def _maybe(machine: Machine, expr: Maybe) -> Value:
    variable = machine.variable(expr.name)
    return NOTHING if variable is None else machine.load(variable)


def _operation(machine: Machine, expr: Operation) -> Value:
    chain, first = [expr], expr.left  # a + b + c is as deep on the left as it is long
    while isinstance(first, Operation):
        chain.append(first)
        first = first.left
    value = machine.value(first)
    for one in reversed(chain):
        value = operate(one.sign, value, machine.value(one.right), machine.line)
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
