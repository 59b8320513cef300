"""RAPID tokens as values and calls: expressions and arguments (RAPID kernel manual, expressions)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

from .tokens import RESERVED, Token, Wrong, number, point, show_token, string, tokens
from .tree import (
    Calling,
    Component,
    Element,
    Expr,
    Hole,
    Maybe,
    Negation,
    Operation,
    Point,
    Ref,
)

#: Values within values that are read.
_DEEPEST = 20
_MOST_TERMS = 1000
_RELATIONS = frozenset(("<", "<=", "=", ">", ">=", "<>"))
_PRODUCTS = frozenset(("*", "/", "div", "mod"))
_Arguments = tuple[tuple[Expr, ...], tuple[tuple[str, Expr | None], ...]]


class Calls:
    """Recursive descent with one token of look-ahead. whole: all of the language, or values that are written out."""

    whole: ClassVar[bool] = True
    source: Iterator[Token]

    def __init__(self, text: str, line: int, start: int = 0) -> None:
        self.text = text
        self.token: Token = ("end", "", line, start)
        self.jump(start, line)

    # -- tokens --------------------------------------------------------------------------------------------------

    def take(self) -> Token:
        """The current token; the next one becomes current. The end stays the end."""
        token = self.token
        self.token = next(self.source, ("end", "", token[2], token[3]))
        return token

    def word(self) -> str:
        """The current name in lower case, or nothing."""
        return self.token[1].lower() if self.token[0] == "name" else ""

    def accept(self, mark: str) -> bool:
        """Takes ``mark`` if it is next."""
        if self.token[0] == "mark" and self.token[1] == mark:
            self.take()
            return True
        return False

    def expect(self, mark: str) -> None:
        """Takes ``mark`` or raises Wrong."""
        if not self.accept(mark):
            raise Wrong(self.token[2], f"{mark} expected, found {show_token(self.token)}")

    def name(self, what: str) -> str:
        """Takes a name that is no reserved word."""
        kind, text, line, _ = self.token
        if kind != "name" or text.lower() in RESERVED:
            raise Wrong(line, f"{what} expected, found {show_token(self.token)}")
        self.take()
        return text

    def jump(self, start: int, line: int) -> None:
        """Goes on at the offset ``start``, in ``line``: the end of a statement or the start of a token."""
        self.source = tokens(self.text, line, start)
        self.take()

    # -- statements ----------------------------------------------------------------------------------------------

    def statement_call(self) -> Calling:
        """A statement that begins with a name, which is no reserved word."""
        _, text, line, _ = self.take()
        if self.token[0] == "mark" and self.token[1] in (":=", ":", ".", "{", "("):
            raise Wrong(line, f"{text}{self.token[1]} is a statement that is not read")
        return self.call_of(text, line)

    def call_of(self, name: str, line: int) -> Calling:
        """The arguments of a statement up to its semicolon."""
        if self.accept(";"):
            return Calling(line, name.lower())
        arguments, options = self.arguments(0)
        self.expect(";")
        return Calling(line, name.lower(), arguments, options)

    # -- expressions ---------------------------------------------------------------------------------------------

    def arguments(self, depth: int) -> _Arguments:
        """Arguments up to what is none, optional ones (after a backslash) apart."""
        args: list[Expr] = []
        options: list[tuple[str, Expr | None]] = []
        while True:
            if self.accept("\\"):
                options.append(self.option(depth))
            else:
                value = self.expression(depth)
                if (
                    self.whole and isinstance(value, Ref) and self.accept(":=")
                ):  # with the name of the parameter
                    value = self.expression(depth)
                args.append(value)
            if not self.accept(",") and self.token[1] != "\\":
                return tuple(args), tuple(options)

    def option(self, depth: int) -> tuple[str, Expr | None]:
        """An optional argument behind its backslash."""
        name = self.name("the name of an optional argument").lower()
        if self.whole and self.accept("?"):
            return name, Maybe(self.name("the name of a parameter").lower())
        return name, self.expression(depth) if self.accept(":=") else None

    def expression(self, depth: int = 0) -> Expr:
        """A value."""
        if not self.whole:
            return self.primary(depth)
        value = self.conjunction(depth)
        while (word := self.word()) in ("or", "xor"):
            self.take()
            value = Operation(word, value, self.conjunction(depth))
        return value

    def conjunction(self, depth: int) -> Expr:
        """Relations with AND between them. NOT in front negates them all (kernel manual, operators)."""
        if self.word() == "not":
            self.take()
            return Negation("not", self.conjunction(self.deeper(depth)))
        value = self.relation(depth)
        while self.word() == "and":
            self.take()
            value = Operation("and", value, self.relation(depth))
        return value

    def relation(self, depth: int) -> Expr:
        """A sum, or two that are compared."""
        if self.word() == "not":
            self.take()
            return Negation("not", self.relation(self.deeper(depth)))
        value = self.sum(depth)
        sign = self.token[1]
        if self.token[0] == "mark" and sign in _RELATIONS:
            self.take()
            value = Operation(sign, value, self.sum(depth))
        return value

    def sum(self, depth: int) -> Expr:
        """Products with + or - between them."""
        value = self.product(depth)
        terms = 0
        while self.token[0] == "mark" and (sign := self.token[1]) in ("+", "-"):
            self.take()
            value = Operation(sign, value, self.product(depth))
            terms += 1
            if terms > _MOST_TERMS:
                raise Wrong(self.token[2], f"a sum of more than {_MOST_TERMS} terms")
        return value

    def product(self, depth: int) -> Expr:
        """Primaries that are multiplied or divided."""
        value = self.primary(depth)
        while self.token[0] in ("mark", "name") and (sign := self.token[1].lower()) in _PRODUCTS:
            self.take()
            value = Operation(sign, value, self.primary(depth))
        return value

    def deeper(self, depth: int) -> int:
        """The depth of what stands within. Wrong where it is too much."""
        if depth >= _DEEPEST:
            raise Wrong(self.token[2], "an expression nested too deeply")
        return depth + 1

    def primary(self, depth: int) -> Expr:
        """A value: written out, an aggregate, a name or a function."""
        token = self.token
        kind, text, line, _ = token
        if depth > _DEEPEST:
            raise Wrong(line, "an expression nested too deeply")
        if kind in ("number", "string", "point"):
            self.take()
            if kind == "number":
                return number(text, line)
            return Point(point(text, line)) if kind == "point" else string(text, line)
        if kind == "name":
            return self.named(depth)
        self.take()
        if kind == "hole" and self.whole:
            return Hole(text)
        if text == "[":
            items = [self.expression(depth + 1)]
            while self.accept(","):
                items.append(self.expression(depth + 1))
            self.expect("]")
            return tuple(items)
        if text in ("+", "-") and self.token[0] == "number":
            return (
                number(text + self.take()[1], line)
                if text == "-" or not self.whole
                else self.primary(depth + 1)
            )
        if self.whole and text in _MARKED:
            return _MARKED[text](self, depth + 1)
        raise Wrong(line, f"a value expected, found {show_token(token)}")

    def named(self, depth: int) -> Expr:
        """A name, TRUE, FALSE or a function with its arguments."""
        line = self.token[2]
        if self.word() in ("true", "false"):
            return self.take()[1].lower() == "true"
        name = self.name("a value")
        if not self.accept("("):
            return self.part(Ref(name), depth) if self.whole else Ref(name)
        if self.whole and self.accept(")"):
            return Calling(line, name.lower())
        args, options = self.arguments(depth + 1)
        self.expect(")")
        return Calling(line, name.lower(), args, options)

    def part(self, value: Expr, depth: int) -> Expr:
        """A name with the elements and components behind it."""
        for _ in range(_DEEPEST):
            if self.accept("."):
                value = Component(value, self.name("a component").lower())
            elif self.accept("{"):
                index = [self.expression(depth + 1)]
                while self.accept(","):
                    index.append(self.expression(depth + 1))
                self.expect("}")
                value = Element(value, tuple(index))
            else:
                return value
        raise Wrong(self.token[2], "an expression nested too deeply")


def _in_brackets(parser: Calls, depth: int) -> Expr:
    value = parser.expression(depth)
    parser.expect(")")
    return value


#: What begins a value and is no word.
_MARKED: dict[str, Callable[[Calls, int], Expr]] = {
    "(": _in_brackets,
    "*": lambda _parser, _depth: Hole("*"),
    "-": lambda parser, depth: Negation("-", parser.primary(depth)),
    "+": lambda parser, depth: parser.primary(depth),
}
