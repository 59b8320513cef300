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
    """A robtarget written out: its numbers, grouped as the manual groups them."""

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
    """Two values and what stands between them, in lower case: ``+``, ``div``, ``<=``, ``and``."""

    sign: str
    left: Expr
    right: Expr


class Negation(Struct, frozen=True):
    """``-a``, or ``not a``."""

    sign: str
    value: Expr


class Maybe(Struct, frozen=True, gc=False):
    """An optional parameter that is handed on where it is given, with a question mark."""

    name: str


class Hole(Struct, frozen=True, gc=False):
    """A place that is not filled in: ``<EXP>``, or ``*``, a point that only the controller holds."""

    text: str


class Calling(Struct, frozen=True, eq=False, gc=False):
    """A statement, or a function inside one: name in lower case, arguments in order, optional arguments by name."""

    line: int
    name: str
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


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


def find_root(expr: Expr) -> Expr:
    """The expression of the data of which `expr` is an element or a component."""
    while isinstance(expr, (Component, Element)):
        expr = expr.base
    return expr


class Shape(Struct, frozen=True, eq=False, gc=False):
    """What statements have in common that differ in the positions and orientations of their points only.

    name, args, options: as in Calling, without the points, which come first. points: for each its configuration and
    external axes. lead: line ends before the name, from the statement before on.
    """

    name: str
    points: tuple[tuple[Numbers, ...], ...]
    args: tuple[Expr, ...]
    options: tuple[tuple[str, Expr | None], ...]
    lead: int


class Inline(Struct, frozen=True, eq=False, gc=False):
    """A motion to a point written out, through another one if its shape has two: a Calling in a few bytes.

    to, via: positions. turn, via_turn: quaternions, as written.
    """

    line: int
    shape: Shape
    to: Vec3
    turn: Numbers
    via: Vec3 | None = None
    via_turn: Numbers = ()

    def call(self) -> Calling:
        """The same motion as a statement like any other."""
        ends = (
            ((self.to, self.turn),)
            if self.via is None
            else ((self.via, self.via_turn), (self.to, self.turn))
        )
        points = (Point((*end, *rest)) for end, rest in zip(ends, self.shape.points, strict=True))
        return Calling(self.line, self.shape.name, (*points, *self.shape.args), self.shape.options)


# Statements beside calls. A block is a list of them, and of runs of those that are read by column.


class Assign(Struct, frozen=True, eq=False):
    """``target := value;``."""

    line: int
    target: Expr
    value: Expr


class If(Struct, frozen=True, eq=False):
    """IF with its conditions and their blocks in order; ELSE is the last block. A compact IF has one."""

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
    """TEST value with its cases, each with its values; DEFAULT is the last block."""

    line: int
    value: Expr
    cases: tuple[tuple[tuple[Expr, ...], Block], ...]
    otherwise: Block | None = None


class Label(Struct, frozen=True, eq=False, gc=False):
    """``name:``; the name in lower case."""

    line: int
    name: str


class Goto(Struct, frozen=True, eq=False, gc=False):
    """GOTO; the name in lower case."""

    line: int
    name: str


class Word(Struct, frozen=True, eq=False):
    """RETURN, RAISE (each with a value or none), RETRY, TRYNEXT, EXIT; in lower case."""

    line: int
    name: str
    value: Expr | None = None


class Connect(Struct, frozen=True, eq=False):
    """CONNECT target WITH trap."""

    line: int
    target: Expr
    trap: str


class CallByName(Struct, frozen=True, eq=False):
    """``%name% arguments;``: the routine that a string names."""

    line: int
    name: Expr
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


class Empty(Struct, frozen=True, eq=False, gc=False):
    """``<SMT>``: a place for a statement; the text is kept."""

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
    """RECORD with its components, type and name of each; an ALIAS has one without a name. All in lower case."""

    line: int
    name: str
    components: tuple[tuple[str, str], ...]
    alias: bool = False


class Data(Struct, frozen=True, eq=False, gc=False):
    """A declaration. storage: const, pers or var. task: of TASK PERS. dims: of an array."""

    line: int
    storage: str
    type: str
    name: str
    local: bool
    value: Expr | None
    task: bool = False
    dims: tuple[Expr, ...] = ()


class Parameter(Struct, frozen=True, gc=False):
    """A parameter. mode: "", var, pers, inout or ref. dims: of an array. optional: after a backslash; those of one
    group are alternatives.
    """

    mode: str
    type: str
    name: str
    dims: int = 0
    optional: bool = False
    group: int = 0


class Routine(Struct, frozen=True, eq=False, gc=False):
    """A routine. handler: the statements behind ERROR, None where there is no such clause. kind: proc, func or trap.
    gives: the data type of a FUNC. last: the line of its end.
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
    """A module with what it declares. attributes: SYSMODULE and the like, in lower case."""

    line: int
    name: str
    data: tuple[Data, ...]
    routines: tuple[Routine, ...]
    records: tuple[Record, ...] = ()
    attributes: tuple[str, ...] = ()
