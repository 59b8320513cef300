"""The parser of RAPID expressions and arguments (RAPID kernel manual, expressions)."""

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

#: Depth of expressions within each other.
_DEEPEST = 20
#: Terms of a sum.
_MOST_TERMS = 1000
_RELATIONS = frozenset(("<", "<=", "=", ">", ">=", "<>"))
_PRODUCTS = frozenset(("*", "/", "div", "mod"))
_Arguments = tuple[tuple[Expr, ...], tuple[tuple[str, Expr | None], ...]]


class Calls:
    """A parser by recursive descent with one token of look-ahead.

    whole: whether it reads all expressions; else names, values written out and calls.
    token: current token.
    """

    whole: ClassVar[bool] = True
    source: Iterator[Token]

    def __init__(self, text: str, line: int, start: int = 0) -> None:
        self.text = text
        self.token: Token = ("end", "", line, start)
        self.jump(start, line)

    # -- tokens ----------------------------------------------------------------------------------

    def take(self) -> Token:
        """Take the current token, so that the next one becomes current. The end is not passed."""
        token = self.token
        self.token = next(self.source, ("end", "", token[2], token[3]))
        return token

    def word(self) -> str:
        """The current token in lower case if it is a name, else an empty text."""
        return self.token[1].lower() if self.token[0] == "name" else ""

    def accept(self, mark: str) -> bool:
        """Take `mark` if it is the current token, and return whether it was."""
        if self.token[0] == "mark" and self.token[1] == mark:
            self.take()
            return True
        return False

    def expect(self, mark: str) -> None:
        """Take `mark`. Raises Wrong if it is not the current token."""
        if not self.accept(mark):
            raise Wrong(self.token[2], f"{mark} expected, found {show_token(self.token)}")

    def name(self, what: str) -> str:
        """Take a name. Raises Wrong for another token or a reserved word.

        what: noun for the message.
        """
        kind, text, line, _ = self.token
        if kind != "name" or text.lower() in RESERVED:
            raise Wrong(line, f"{what} expected, found {show_token(self.token)}")
        self.take()
        return text

    def jump(self, start: int, line: int) -> None:
        """Continue at an offset of the text and its line, between two tokens."""
        self.source = tokens(self.text, line, start)
        self.take()

    # -- statements ------------------------------------------------------------------------------

    def statement_call(self) -> Calling:
        """A call as a statement. Raises Wrong for another statement that begins with a name."""
        _, text, line, _ = self.take()
        if self.token[0] == "mark" and self.token[1] in (":=", ":", ".", "{", "("):
            raise Wrong(line, f"{text}{self.token[1]} is a statement that is not read")
        return self.call_of(text, line)

    def call_of(self, name: str, line: int) -> Calling:
        """A call with its arguments up to the semicolon, after its name."""
        if self.accept(";"):
            return Calling(line, name.lower())
        arguments, options = self.arguments(0)
        self.expect(";")
        return Calling(line, name.lower(), arguments, options)

    # -- expressions -----------------------------------------------------------------------------

    def arguments(self, depth: int) -> _Arguments:
        """Arguments in order, and optional arguments, which follow a backslash."""
        args: list[Expr] = []
        options: list[tuple[str, Expr | None]] = []
        while True:
            if self.accept("\\"):
                options.append(self.option(depth))
            else:
                value = self.expression(depth)
                # An argument may follow the name of its parameter.
                if self.whole and isinstance(value, Ref) and self.accept(":="):
                    value = self.expression(depth)
                args.append(value)
            if not self.accept(",") and self.token[1] != "\\":
                return tuple(args), tuple(options)

    def option(self, depth: int) -> tuple[str, Expr | None]:
        """Name and value of an optional argument after its backslash."""
        name = self.name("the name of an optional argument").lower()
        if self.whole and self.accept("?"):
            return name, Maybe(self.name("the name of a parameter").lower())
        return name, self.expression(depth) if self.accept(":=") else None

    def expression(self, depth: int = 0) -> Expr:
        """An expression: conjunctions with OR or XOR between them."""
        if not self.whole:
            return self.primary(depth)
        value = self.conjunction(depth)
        while (word := self.word()) in ("or", "xor"):
            self.take()
            value = Operation(word, value, self.conjunction(depth))
        return value

    def conjunction(self, depth: int) -> Expr:
        """Relations with AND between them. A leading NOT negates all of them (kernel manual)."""
        if self.word() == "not":
            self.take()
            return Negation("not", self.conjunction(self.deeper(depth)))
        value = self.relation(depth)
        while self.word() == "and":
            self.take()
            value = Operation("and", value, self.relation(depth))
        return value

    def relation(self, depth: int) -> Expr:
        """A sum, or two sums with a comparison between them."""
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
        """Primaries with `*`, `/`, DIV or MOD between them."""
        value = self.primary(depth)
        while self.token[0] in ("mark", "name") and (sign := self.token[1].lower()) in _PRODUCTS:
            self.take()
            value = Operation(sign, value, self.primary(depth))
        return value

    def deeper(self, depth: int) -> int:
        """The depth of an inner expression. Raises Wrong above the limit."""
        if depth >= _DEEPEST:
            raise Wrong(self.token[2], "an expression nested too deeply")
        return depth + 1

    def primary(self, depth: int) -> Expr:
        """A value written out, an aggregate, a name, a call, or an expression in brackets."""
        token = kind, text, line, _ = self.token
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
            items = self.listed(depth + 1)
            self.expect("]")
            return items
        if self.token[0] == "number" and (text == "-" or (text == "+" and not self.whole)):
            return number(text + self.take()[1], line)
        if self.whole and text in _MARKED:
            return _MARKED[text](self, depth + 1)
        raise Wrong(line, f"a value expected, found {show_token(token)}")

    def listed(self, depth: int = 0) -> tuple[Expr, ...]:
        """Expressions with commas between them."""
        items = [self.expression(depth)]
        while self.accept(","):
            items.append(self.expression(depth))
        return tuple(items)

    def named(self, depth: int) -> Expr:
        """TRUE, FALSE, a name with its parts, or a call with its arguments."""
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
        """A name and the elements and components that follow it."""
        for _ in range(_DEEPEST):
            if self.accept("."):
                value = Component(value, self.name("a component").lower())
            elif self.accept("{"):
                value = Element(value, self.listed(depth + 1))
                self.expect("}")
            else:
                return value
        raise Wrong(self.token[2], "an expression nested too deeply")


def _in_brackets(parser: Calls, depth: int) -> Expr:
    value = parser.expression(depth)
    parser.expect(")")
    return value


#: Marks that begin a value, with their productions.
_MARKED: dict[str, Callable[[Calls, int], Expr]] = {
    "(": _in_brackets,
    "*": lambda _parser, _depth: Hole("*"),
    "-": lambda parser, depth: Negation("-", parser.primary(depth)),
    "+": lambda parser, depth: parser.primary(depth),
}
