"""RAPID text as a tree: modules, data, routines, statements and values. Lines are 1-based."""

from __future__ import annotations

from functools import lru_cache

from msgspec import Struct

from camgen.pose import Vec3

Numbers = tuple[float, ...]


class Ref(Struct, frozen=True, gc=False):
    """A name used as a value."""

    name: str


class Point(Struct, frozen=True, gc=False):
    """A robtarget written out: its numbers, grouped as the manual groups them."""

    value: tuple[Numbers, ...]


class Call(Struct, frozen=True, eq=False, gc=False):
    """A statement, or a function inside one: name in lower case, arguments in order, optional arguments by name."""

    line: int
    name: str
    args: tuple[Expr, ...] = ()
    options: tuple[tuple[str, Expr | None], ...] = ()


Expr = float | bool | str | tuple["Expr", ...] | Ref | Point | Call


class Shape(Struct, frozen=True, eq=False, gc=False):
    """What statements have in common that differ in the positions and orientations of their points only.

    name, args, options: as in Call, without the points, which come first. points: for each its configuration and
    external axes. lead, lines: line ends before the name and before the semicolon, from the statement before on.
    """

    name: str
    points: tuple[tuple[Numbers, ...], ...]
    args: tuple[Expr, ...]
    options: tuple[tuple[str, Expr | None], ...]
    lead: int
    lines: int


class Inline(Struct, frozen=True, eq=False, gc=False):
    """A motion to a point written out, through another one if its shape has two: a Call in a few bytes.

    to, via: positions. turn, via_turn: quaternions, as written.
    """

    line: int
    shape: Shape
    to: Vec3
    turn: Numbers
    via: Vec3 | None = None
    via_turn: Numbers = ()

    def call(self) -> Call:
        """The same motion as a statement like any other."""
        ends = ((self.to, self.turn),) if self.via is None else ((self.via, self.via_turn), (self.to, self.turn))
        points = (Point((*end, *rest)) for end, rest in zip(ends, self.shape.points, strict=True))
        return Call(self.line, self.shape.name, (*points, *self.shape.args), self.shape.options)


class Data(Struct, frozen=True, eq=False, gc=False):
    """A declaration. storage: const, pers or var."""

    line: int
    storage: str
    type: str
    name: str
    local: bool
    value: Expr | None


class Routine(Struct, frozen=True, eq=False, gc=False):
    """A PROC without parameters."""

    line: int
    name: str
    local: bool
    data: tuple[Data, ...]
    body: tuple[Call | Inline, ...]


class Module(Struct, frozen=True, eq=False, gc=False):
    """A module with what it declares."""

    line: int
    name: str
    data: tuple[Data, ...]
    routines: tuple[Routine, ...]


@lru_cache(maxsize=1000)
def refs(*names: str) -> tuple[Ref, ...]:
    """Names as arguments; the same ones are shared by the many motions that have them."""
    return tuple(Ref(name) for name in names)


@lru_cache(maxsize=1000)
def work_object(name: str) -> tuple[tuple[str, Expr | None], ...]:
    """The optional argument WObj, shared in the same way."""
    return (("wobj", Ref(name)),)
