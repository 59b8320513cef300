"""RAPID tokens as calls with their values: the grammar of a statement (RAPID kernel manual, grammar)."""

from __future__ import annotations

from collections.abc import Iterator

from .rapid_lexis import RESERVED, Token, Wrong, number, point, shown, tokens, whole_move
from .rapid_tree import Call, Expr, Point, Ref, refs, work_object

_DEEPEST = 12


class Calls:
    """Recursive descent with one token of look-ahead."""

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
            raise Wrong(self.token[2], f"{mark} expected, found {shown(self.token)}")

    def name(self, what: str) -> str:
        """Takes a name that is no reserved word."""
        kind, text, line, _ = self.token
        if kind != "name" or text.lower() in RESERVED:
            raise Wrong(line, f"{what} expected, found {shown(self.token)}")
        self.take()
        return text

    def jump(self, start: int, line: int) -> None:
        """Goes on at the offset ``start``, in ``line``: the end of a statement or the start of a token."""
        self.source = tokens(self.text, line, start)
        self.take()

    # -- statements ----------------------------------------------------------------------------------------------

    def statement_call(self) -> Call:
        """A statement that begins with a name, which is no reserved word, or is a whole motion."""
        kind, text, line, _ = self.take()
        if kind == "move":
            name, target, speed, zone, tool, work = whole_move(text)
            args: tuple[Expr, ...] = (Point(point(target, line)), *refs(speed, zone, tool))
            return Call(line, name.lower(), args, work_object(work))
        if self.token[0] == "mark" and self.token[1] in (":=", ":", ".", "{", "("):
            raise Wrong(line, f"{text}{self.token[1]} is a statement that is not read")
        if self.accept(";"):
            return Call(line, text.lower())
        arguments, options = self.arguments(0)
        self.expect(";")
        return Call(line, text.lower(), arguments, options)

    # -- expressions ---------------------------------------------------------------------------------------------

    def arguments(self, depth: int) -> tuple[tuple[Expr, ...], tuple[tuple[str, Expr | None], ...]]:
        """Arguments up to what is none, optional ones (after a backslash) apart."""
        args: list[Expr] = []
        options: list[tuple[str, Expr | None]] = []
        while True:
            if self.accept("\\"):
                name = self.name("the name of an optional argument").lower()
                options.append((name, self.expression(depth) if self.accept(":=") else None))
            else:
                args.append(self.expression(depth))
            if not self.accept(",") and self.token[1] != "\\":
                return tuple(args), tuple(options)

    def expression(self, depth: int = 0) -> Expr:
        """A value: written out, an aggregate, a name or a function."""
        token = self.token
        kind, text, line, _ = token
        if depth > _DEEPEST:
            raise Wrong(line, "an expression nested too deeply")
        if kind in ("number", "string", "point"):
            self.take()
            if kind == "number":
                return number(text, line)
            return Point(point(text, line)) if kind == "point" else text[1:-1].replace('""', '"')
        if kind == "name":
            return self.named(depth)
        self.take()
        if text == "[":
            items = [self.expression(depth + 1)]
            while self.accept(","):
                items.append(self.expression(depth + 1))
            self.expect("]")
            return tuple(items)
        if text in ("+", "-") and self.token[0] == "number":
            return number(text + self.take()[1], line)
        raise Wrong(line, f"a value expected, found {shown(token)}")

    def named(self, depth: int) -> Expr:
        """A name, TRUE, FALSE or a function with its arguments."""
        line = self.token[2]
        if self.word() in ("true", "false"):
            return self.take()[1].lower() == "true"
        name = self.name("a value")
        if not self.accept("("):
            return Ref(name)
        args, options = self.arguments(depth + 1)
        self.expect(")")
        return Call(line, name.lower(), args, options)
