"""Parses PacScript expressions to trees, which a run evaluates (RC8 manual 450)."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from camgen.lang.pacscript.values import Unreadable, finite

#: Maximum depth of nested brackets: keeps a hostile text from exhausting the stack of Python.
_MAX_DEPTH = 40
#: One part of a list whose brackets do not nest, and the comma after it.
_PART = re.compile(r'((?:[^,()\[\]"]|\([^()\[\]"]*+\)|\[[^()\[\]"]*+\])*+)(,|$)')
_SEPARATOR = re.compile(r'"[^"]*"?|[(),\[\]]')
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?(?!\w|\.\d))(?:[!#%](?!\w))?"
    r"|&b(?P<binary>[01]+)(?!\w)"
    r"|&h(?P<hex>[\da-f]+)(?!\w)"
    r'|"(?P<text>(?:[^"]|"")*)"|(?P<name>[a-z_]\w*)[!#%$]?'
    r"|(?P<sign><<|>>|<>|><|<=|>=|=>|=<|==|[-+*/\\^&=<>(),\[\].]))",
    re.IGNORECASE,
)
#: Binding power of each operator; the larger one binds more closely.
_BINDS = {
    "xor": 1, "or": 2, "and": 3, "=": 5, "==": 5, "<>": 5, "><": 5, "<": 5, ">": 5, "<=": 5,
    "=<": 5, ">=": 5, "=>": 5, "&": 6, "<<": 6, ">>": 6, "+": 7, "-": 7, "mod": 8, "\\": 9,
    "*": 10, "/": 10, "^": 12,
}  # fmt: skip
OPERATORS = frozenset(_BINDS)
_NOT, _SIGN = 4, 11
_SAME = {"==": "=", "><": "<>", "=<": "<=", "=>": ">="}


class Node(NamedTuple):
    """A node of the tree of an expression.

    kind: number, text, name, call, index, element, range, member, tuple, left out, sign, not, or an
        operator.
    content: value of a number, text or sign; otherwise the name in lower case.
    parts: operands or arguments.
    """

    kind: str
    content: float | str = 0.0
    parts: tuple[Node, ...] = ()


LEFT_OUT = Node("left out")


def parse_optional(text: str | None) -> Node | None:
    """Parse an expression; None for no text. Raises Unreadable."""
    if text:
        return parse(text)
    return None


def list_arguments(text: str) -> list[str]:
    """Split the text of a list that may have no part."""
    if text.strip():
        return arguments(text)
    return []


def arguments(text: str) -> list[str]:
    """Split a text at the commas outside of brackets and quotes; each part is stripped."""
    flat = _PART.findall(text)
    if sum(map(len, map("".join, flat))) == len(text) and flat[-1][1] == "":
        # The usual case; an empty match after a last comma is its empty part.
        return [
            part.strip() for part, _ in flat[: len(flat) if len(flat) == 1 or flat[-2][1] else -1]
        ]
    parts, depth, start = [], 0, 0
    for match in _SEPARATOR.finditer(text):
        sign = match.group()
        if sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        elif sign == "," and depth == 0:
            parts.append(text[start : match.start()].strip())
            start = match.end()
    return [*parts, text[start:].strip()]


@lru_cache(maxsize=4096)
def parse(text: str) -> Node:
    """Parse an expression. Raises Unreadable if it is not one."""
    parser = _Parser(text)
    node = parser.expression(0)
    if parser.tokens[parser.at][0] != "end":
        raise Unreadable(f"{parser.tokens[parser.at][1]} is not understood in {text}")
    return node


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens, at = [], 0
    text = text.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            raise Unreadable(f"{text} is not understood")
        tokens.append((match.lastgroup, match[match.lastgroup]))
        at = match.end()
    return [*tokens, ("end", "")]


class _Parser:
    """A Pratt parser over tokens."""

    def __init__(self, text: str) -> None:
        self.tokens, self.at, self.depth = _tokens(text), 0, 0

    def take(self, *signs: str) -> str:
        """Take the next token if it is one of `signs`. Returns it, or an empty text."""
        kind, text = self.tokens[self.at]
        if kind != "sign" or text not in signs:
            return ""
        self.at += 1
        return text

    def operator(self) -> str:
        """Return the next token in lower case if it is an operator, otherwise an empty text."""
        kind, text = self.tokens[self.at]
        text = text.lower()
        return text if kind in ("sign", "name") and text in _BINDS else ""

    def expression(self, least: int) -> Node:
        """Parse an expression whose operators bind more closely than `least`."""
        node = self.prefixed()
        while (operator := self.operator()) and _BINDS[operator] > least:
            self.at += 1
            other = self.expression(_BINDS[operator])
            # The older dialect has `+ (...)H`, along the axes of the hand.
            if operator == "+" and self.take_word("h"):
                node = Node("call", "devh", (node, other))
            else:
                node = Node(_SAME.get(operator, operator), 0.0, (node, other))
        return node

    def take_word(self, word: str) -> bool:
        """Take the next token if it is `word` directly after a bracket. Returns whether it was."""
        kind, text = self.tokens[self.at]
        after_bracket = self.tokens[self.at - 1] == ("sign", ")")
        taken = after_bracket and kind == "name" and text.lower() == word
        self.at += taken
        return taken

    def take_to(self) -> bool:
        """Take the word of a range, `P[1 TO 3]`, if it comes next."""
        is_next = self.tokens[self.at][1].lower() == "to"
        self.at += is_next
        return is_next

    def prefixed(self) -> Node:
        """Parse a value with its signs."""
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise Unreadable("brackets nested too deep")
        try:
            negative, any_sign = False, False
            while sign := self.take("+", "-"):
                negative, any_sign = negative != (sign == "-"), True
            if any_sign:
                return Node("sign", -1.0 if negative else 1.0, (self.expression(_SIGN),))
            if self.tokens[self.at] in _NOTS:
                self.at += 1
                return Node("not", 0.0, (self.expression(_NOT),))
            return self.members(self.atom())
        finally:
            self.depth -= 1

    def atom(self) -> Node:
        kind, text = self.tokens[self.at]
        if kind == "end":
            raise Unreadable("a value is missing")
        self.at += 1
        if kind == "number":
            return Node("number", finite(float(text)))
        if kind in ("binary", "hex"):
            return Node("number", float(finite(int(text, 2 if kind == "binary" else 16))))
        if kind == "text":
            return Node("text", text.replace('""', '"'))
        if text == "(":
            return Node("tuple", 0.0, self.inside(")"))
        if kind != "name" or (lower := text.lower()) in _BINDS:
            raise Unreadable(f"{text} is not understood")
        if self.take("("):
            return Node("call", lower, self.inside(")"))
        if self.take("["):
            return Node("index", lower, self.inside("]"))
        return Node("name", lower)

    def members(self, node: Node) -> Node:
        """Parse the members and elements after a node."""
        while True:
            if self.take("."):
                if self.tokens[self.at][0] != "name":
                    raise Unreadable("a name is missing after a dot")
                name = self.tokens[self.at][1].lower()
                self.at += 1
                node = Node("member", name, (node, *(self.inside(")") if self.take("(") else ())))
            elif node.kind in ("index", "call", "member") and self.take("("):
                node = Node("element", 0.0, (node, *self.inside(")")))
            else:
                return node

    def inside(self, closing: str) -> tuple[Node, ...]:
        """Parse values up to the bracket `closing`."""
        if not (closing == ")" and self.take(")")):
            values: list[Node] = []
            while True:
                empty = self.tokens[self.at] in (("sign", ","), ("sign", closing))
                values.append(LEFT_OUT if empty else self.expression(0))
                if closing == "]" and self.take_to():
                    values[-1] = Node("range", 0.0, (values[-1], self.expression(0)))
                if self.take(closing):
                    return tuple(values)
                if not self.take(","):
                    raise Unreadable(f"{closing} is missing")
        return ()


_NOTS = tuple(("name", word) for word in ("not", "Not", "NOT"))
