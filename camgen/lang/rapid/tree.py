"""RAPID as a tree: modules, types, data, routines, statements and values. Lines are 1-based.

Nodes within a statement have no line, except functions: statements that look the same share them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from msgspec import Struct

from camgen.model.pose import Vec3

Numbers = tuple[float, ...]


class Ref(Struct, frozen=True, gc=False):
    """A name used as a value."""

    name: str


class Point(Struct, frozen=True, gc=False):
    """A robtarget written out: position, orientation, configuration and external axes."""

    value: tuple[Numbers, ...]


class Element(Struct, frozen=True):
    """An element of an array: ``a{i,j}``."""

    base: Expr
    index: tuple[Expr, ...]


class Component(Struct, frozen=True):
    """A component of a record: ``p.trans``; its name in lower case."""

    base: Expr
    name: str


class Operation(Struct, frozen=True):
    """Two values and their operator in lower case: ``+``, ``div``, ``<=``, ``and``."""

    sign: str
    left: Expr
    right: Expr


class Negation(Struct, frozen=True):
    """``-a``, or ``not a``."""

    sign: str
    value: Expr


class Maybe(Struct, frozen=True, gc=False):
    """An optional parameter after a question mark: it is passed on if it was given."""

    name: str


class Hole(Struct, frozen=True, gc=False):
    """A placeholder: ``<EXP>`` is to be filled in, ``*`` is a point that is not in the text."""

    text: str


class Calling(Struct, frozen=True, eq=False, gc=False):
    """The call of an instruction, a routine or a function, its name in lower case.

    args: arguments in order.
    options: name and value of each optional argument; a switch has no value.
    """

    line: int
    name: str
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()

    def argument(self, index: int, default: Expr | None = None) -> Expr | None:
        """The argument at an index from 0, `default` without one."""
        if index < len(self.args):
            return self.args[index]
        return default

    @property
    def values(self) -> tuple[Expr | None, ...]:
        """All arguments, None for a switch."""
        return (*self.args, *(value for _, value in self.options))


Expr = (
    float
    | bool
    | str
    | tuple["Expr", ...]
    | Ref
    | Point
    | Element
    | Component
    | Operation
    | Negation
    | Maybe
    | Hole
    | Calling
)


def name_reference(expr: Expr | None) -> str:
    """The name of an expression that is one, empty for any other expression."""
    if isinstance(expr, Ref):
        return expr.name
    return ""


def find_root(expr: Expr) -> Expr:
    """The expression of the whole data, if `expr` is an element or a component of them."""
    while isinstance(expr, (Component, Element)):
        expr = expr.base
    return expr


class Shape(Struct, frozen=True, eq=False, gc=False):
    """The common part of motions that differ only in the position and orientation of their points.

    name: name of the instruction in lower case.
    points: configuration and external axes of each point.
    args: arguments after the points.
    options: name and value of each optional argument.
    lead: number of line ends between the statement before and the name.
    """

    name: str
    points: tuple[tuple[Numbers, ...], ...]
    args: tuple[Expr, ...]
    options: tuple[tuple[str, Expr | None], ...]
    lead: int


class Inline(Struct, frozen=True, eq=False, gc=False):
    """A motion to a point written out, in fewer bytes than a `Calling`.

    shape: common part of such motions.
    to: position of the target, mm.
    turn: quaternion of the target, as written.
    via: position of the circle point, mm, None without one.
    via_turn: quaternion of the circle point.
    """

    line: int
    shape: Shape
    to: Vec3
    turn: Numbers
    via: Vec3 | None = None
    via_turn: Numbers = ()

    def call(self) -> Calling:
        """The motion as a `Calling`."""
        shape = self.shape
        points = [Point((self.to, self.turn, *shape.points[-1]))]
        if self.via is not None:
            points.insert(0, Point((self.via, self.via_turn, *shape.points[0])))
        return Calling(self.line, shape.name, (*points, *shape.args), shape.options)


# Statements other than calls. A block holds statements, and runs of statements read by column.


class Assign(Struct, frozen=True, eq=False):
    """``target := value;``."""

    line: int
    target: Expr
    value: Expr


class If(Struct, frozen=True, eq=False):
    """IF with a condition and a block for each branch.

    otherwise: block of ELSE, None without one.
    """

    line: int
    branches: tuple[tuple[Expr, Block], ...]
    otherwise: Block | None = None


class For(Struct, frozen=True, eq=False):
    """FOR name FROM first TO last STEP step DO."""

    line: int
    name: str
    first: Expr
    last: Expr
    step: Expr | None
    body: Block


class While(Struct, frozen=True, eq=False):
    """WHILE condition DO."""

    line: int
    condition: Expr
    body: Block


class Test(Struct, frozen=True, eq=False):
    """TEST value with the values and the block of each CASE.

    otherwise: block of DEFAULT, None without one.
    """

    line: int
    value: Expr
    cases: tuple[tuple[tuple[Expr, ...], Block], ...]
    otherwise: Block | None = None


class Label(Struct, frozen=True, eq=False, gc=False):
    """A label, its name in lower case."""

    line: int
    name: str


class Goto(Struct, frozen=True, eq=False, gc=False):
    """GOTO, with the name of its label in lower case."""

    line: int
    name: str


class Word(Struct, frozen=True, eq=False):
    """RETURN, RAISE, RETRY, TRYNEXT or EXIT, in lower case. The first two may have a value."""

    line: int
    name: str
    value: Expr | None = None


class Connect(Struct, frozen=True, eq=False):
    """CONNECT target WITH trap."""

    line: int
    target: Expr
    trap: str


class CallByName(Struct, frozen=True, eq=False):
    """``%name% arguments;``: the call of a routine whose name is a string."""

    line: int
    name: Expr
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


class Empty(Struct, frozen=True, eq=False, gc=False):
    """``<SMT>``: the placeholder of a statement."""

    line: int
    text: str


Statement = (
    Calling
    | Inline
    | Assign
    | If
    | For
    | While
    | Test
    | Label
    | Goto
    | Word
    | Connect
    | CallByName
    | Empty
)


class Run(Struct, frozen=True, eq=False):
    """Consecutive statements: the rows `first` to before `last` of a file.

    rows: rows of the file (`camgen.lang.rapid.rows`).
    is_free: whether they only move and switch.
    """

    rows: Any
    first: int
    last: int
    is_free: bool

    def __len__(self) -> int:
        return self.last - self.first


def list_statements(block: Iterable[Statement | Run]) -> Iterator[Statement]:
    """The statements of a block one by one."""
    for item in block:
        if isinstance(item, Run):
            yield from map(item.rows.statement, range(item.first, item.last))
        else:
            yield item


Block = tuple[Statement | Run, ...]


# Declarations


class Record(Struct, frozen=True, eq=False):
    """RECORD or ALIAS, in lower case.

    components: type and name of each component. An ALIAS has one without a name.
    """

    line: int
    name: str
    components: tuple[tuple[str, str], ...]
    alias: bool = False


class Data(Struct, frozen=True, eq=False, gc=False):
    """A declaration of data.

    storage: const, pers or var.
    type: data type in lower case.
    local: whether it is LOCAL.
    value: expression of the first value.
    task: whether it is TASK PERS.
    dims: size of each dimension of an array.
    """

    line: int
    storage: str
    type: str
    name: str
    local: bool
    value: Expr | None
    task: bool = False
    dims: tuple[Expr, ...] = ()


class Parameter(Struct, frozen=True, gc=False):
    """A parameter of a routine.

    mode: var, pers, inout, ref, or empty if the argument is copied.
    type: data type in lower case.
    dims: 1 for an array, else 0.
    optional: whether a backslash precedes it.
    group: number of its group. Optional parameters of one group exclude each other.
    """

    mode: str
    type: str
    name: str
    dims: int = 0
    optional: bool = False
    group: int = 0


class Routine(Struct, frozen=True, eq=False, gc=False):
    """A routine.

    handler: statements of the ERROR clause, None without one.
    kind: proc, func or trap.
    gives: data type of a FUNC.
    last: line of its end.
    """

    line: int
    name: str
    local: bool
    data: tuple[Data, ...]
    body: Block
    handler: Block | None = None
    kind: str = "proc"
    parameters: tuple[Parameter, ...] = ()
    gives: str = ""
    last: int = 0


class Module(Struct, frozen=True, eq=False, gc=False):
    """A module with its declarations."""

    line: int
    name: str
    data: tuple[Data, ...]
    routines: tuple[Routine, ...]
    records: tuple[Record, ...] = ()
