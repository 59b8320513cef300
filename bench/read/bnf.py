"""Reads a grammar in the notation of Grammar-Kit, and decides whether a text is of its language.

Error recovery, trees and colours do not change the decision, and their settings are skipped. As in
Grammar-Kit, choices are ordered and repetitions are greedy. The rule that all expressions extend is
run by precedence climbing, with the priorities of its alternatives.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

_RULE = re.compile(
    r"^[ \t]*(?:(?:private|fake|upper|external|left|inner|meta)[ \t]+)*(\w+)[ \t]*::=", re.MULTILINE
)
_HEAD = re.compile(r"^\s*\{.*?^\}", re.DOTALL | re.MULTILINE)
_NAMED = re.compile(r"^\s*(\w+)\s*=\s*'([^']+)'", re.MULTILINE)
_SETTINGS = re.compile(r"\{\s*(?:pin|recoverWhile|elementType|extends|name|mixin)\b[^\n]*\}")
_PIECE = re.compile(r"\s*(?:'([^']*)'|\"([^\"]*)\"|(<<eof>>)|(\w+)|([()\[\]|?*+&!]))")
_SPACE = re.compile(r"(?:\s|![^\n]*)+")

#: A piece of a rule: its kind (literal, end, name, sign) and its text.
Piece = tuple[str, str]
#: Matches from the token of an index on. Returns the index of the next token, None without a match.
Match = Callable[[int], int | None]
#: As `Match`, for an operator; the second number is its priority.
Operator = Callable[[int, int], int | None]


@dataclass
class Grammar:
    """A grammar, and the text that is decided.

    rules: pieces of each rule.
    words: literals of letters, in capitals.
    signs: literals of other characters, the longest first.
    kinds: name and pattern of the tokens that are not literals.
    start: name of the rule of a whole text.
    expression: name of the rule of an expression.
    tokens: kind and text of the tokens of the text.
    matches: match of each rule that was used.
    operators: priority and match of the operators that start, and of those that continue, an
        expression.
    """

    rules: dict[str, list[Piece]]
    words: frozenset[str]
    signs: Sequence[str]
    kinds: Sequence[tuple[str, re.Pattern[str]]]
    start: str
    expression: str
    tokens: list[tuple[str, str]] = field(default_factory=list)
    matches: dict[str, Match] = field(default_factory=dict)
    operators: tuple[list[tuple[int, Operator]], list[tuple[int, Operator]]] | None = None

    def takes(self, text: str) -> bool:
        """Whether a text is of the language."""
        tokens = self._split(text)
        if tokens is None:
            return False
        self.tokens = tokens
        return self._rule(self.start)(0) == len(tokens)

    def _split(self, text: str) -> list[tuple[str, str]] | None:
        tokens, at = [], 0
        while True:
            space = _SPACE.match(text, at)
            at = space.end() if space else at
            if at == len(text):
                return tokens
            token = self._token(text, at)
            if token is None:
                return None
            tokens.append(token)
            at += len(token[1])

    def _token(self, text: str, at: int) -> tuple[str, str] | None:
        sign = next((s for s in self.signs if text[at : at + len(s)].upper() == s), "")
        for kind, pattern in self.kinds:
            match = pattern.match(text, at)
            if match and len(match[0]) > len(sign):
                return ("literal" if match[0].upper() in self.words else kind), match[0]
        return ("literal", sign) if sign else None

    def _rule(self, name: str) -> Match:
        late = partial(self._match_late, name)
        if name not in self.matches:
            self.matches[name] = late  # a rule may contain itself
            if name == self.expression:
                self.matches[name] = partial(self._climb, least=-1)
            elif name in self.rules:
                self.matches[name] = self._choice(self.rules[name], 0)[0]
            else:
                self.matches[name] = lambda at: at + 1 if self._token_at(at)[0] == name else None
        return late

    def _match_late(self, name: str, at: int) -> int | None:
        return self.matches[name](at)

    def _token_at(self, at: int) -> tuple[str, str]:
        return self.tokens[at] if at < len(self.tokens) else ("", "")

    def _choice(self, pieces: Sequence[Piece], k: int) -> tuple[Match, int]:
        """The match of a choice that starts at piece `k`, and the index of the piece after it."""
        match, k = self._sequence(pieces, k)
        choices = [match]
        while k < len(pieces) and pieces[k] == ("sign", "|"):
            match, k = self._sequence(pieces, k + 1)
            choices.append(match)

        def match_first(at: int) -> int | None:
            ends = (choice(at) for choice in choices)
            return next((end for end in ends if end is not None), None)

        return match_first, k

    def _sequence(self, pieces: Sequence[Piece], k: int) -> tuple[Match, int]:
        parts: list[Match] = []
        while k < len(pieces) and pieces[k] not in (("sign", "|"), ("sign", ")"), ("sign", "]")):
            part, k = self._part(pieces, k)
            parts.append(part)

        def match(at: int) -> int | None:
            place: int | None = at
            for part in parts:
                place = part(place) if place is not None else None
            return place

        return match, k

    def _part(self, pieces: Sequence[Piece], k: int) -> tuple[Match, int]:
        kind, text = pieces[k]
        if (kind, text) in (("sign", "!"), ("sign", "&")):
            inner, k = self._part(pieces, k + 1)
            return (lambda at: at if (inner(at) is None) == (text == "!") else None), k
        if kind == "sign":
            inner, k = self._choice(pieces, k + 1)
            match = _maybe(inner) if text == "[" else inner
        elif kind == "literal":
            match = self._literal(text.upper())
        elif kind == "end":
            match = self._match_end
        else:
            match = self._rule(text)
        k += 1
        while k < len(pieces) and pieces[k] in (("sign", "?"), ("sign", "*"), ("sign", "+")):
            match = {"?": _maybe, "*": _many, "+": _some}[pieces[k][1]](match)
            k += 1
        return match, k

    def _match_end(self, at: int) -> int | None:
        return at if at == len(self.tokens) else None

    def _literal(self, text: str) -> Match:
        def match(at: int) -> int | None:
            kind, token = self._token_at(at)
            return at + 1 if kind == "literal" and token.upper() == text else None

        return match

    def _climb(self, at: int, least: int) -> int | None:
        """Matches the longest expression at `at` whose operators have priorities above `least`."""
        starting, continuing = self._list_operators()
        allowed = [(priority, match) for priority, match in continuing if priority > least]
        end = _match_longest(starting, at)
        longest = None
        while end is not None:
            longest = end
            end = _match_longest(allowed, end)
        return longest

    def _list_operators(self) -> tuple[list[tuple[int, Operator]], list[tuple[int, Operator]]]:
        if self.operators is None:
            starting, continuing = self.operators = ([], [])
            operand = ("name", self.expression)
            for priority, name in self._alternatives(self.expression):
                pieces = self.rules[name]
                has_left = pieces[0] == operand
                pieces = pieces[1:] if has_left else pieces
                has_right = pieces[-1] == operand
                match = self._operator(pieces[:-1] if has_right else pieces, has_right)
                (continuing if has_left else starting).append((priority, match))
        return self.operators

    def _operator(self, pieces: Sequence[Piece], has_right: bool) -> Operator:
        match = self._choice(pieces, 0)[0]

        def match_operator(at: int, priority: int) -> int | None:
            end = match(at)
            return self._climb(end, priority) if has_right and end is not None else end

        return match_operator

    def _alternatives(self, name: str, priority: int = -1) -> list[tuple[int, str]]:
        """Priority and name of the rules of expressions. Groups of rules count from 0."""
        alternatives = []
        for k, rule in enumerate(text for kind, text in self.rules[name] if kind == "name"):
            pieces = self.rules[rule]
            is_group = rule.startswith("priority") and all(
                piece == ("sign", "|") or (piece[0] == "name" and piece[1].endswith("_expression"))
                for piece in pieces
            )
            if priority < 0 and is_group:
                alternatives += self._alternatives(rule, k)
            else:
                alternatives.append((max(priority, 0), rule))
        return alternatives


def _match_longest(operators: Sequence[tuple[int, Operator]], at: int) -> int | None:
    ends = [match(at, priority) for priority, match in operators]
    return max((end for end in ends if end is not None), default=None)


def _maybe(match: Match) -> Match:
    return lambda at: at if (end := match(at)) is None else end


def _many(match: Match) -> Match:
    def run(at: int) -> int:
        while (end := match(at)) is not None and end > at:
            at = end
        return at

    return run


def _some(match: Match) -> Match:
    return lambda at: None if (end := match(at)) is None else _many(match)(end)


def read_grammar(
    text: str, kinds: Sequence[tuple[str, str]], start: str, expression: str
) -> Grammar:
    """Reads the text of a grammar.

    kinds: name and pattern of the tokens that are not literals, in their order.
    start: name of the rule of a whole text.
    expression: name of the rule of an expression.
    """
    head = _HEAD.match(text)
    values = [value for _, value in _NAMED.findall(head[0] if head else "")]
    literals = {value.upper() for value in values if not value.startswith("regexp:")}
    body = re.sub(r"^\s*//.*$", "", text[head.end() if head else 0 :], flags=re.MULTILINE)
    starts = list(_RULE.finditer(body))
    rules = {}
    ends = [match.start() for match in starts[1:]] + [len(body)]
    for rule, end in zip(starts, ends, strict=True):
        content = _SETTINGS.sub("", body[rule.end() : end])
        rules[rule[1]] = [_read_piece(piece) for piece in _PIECE.finditer(content)]
    words = frozenset(literal for literal in literals if literal[0].isalpha())
    signs = sorted(literals - words, key=len, reverse=True)
    patterns = [(name, re.compile(pattern, re.IGNORECASE)) for name, pattern in kinds]
    return Grammar(rules, words, signs, patterns, start, expression)


def _read_piece(piece: re.Match[str]) -> Piece:
    kinds = "literal", "literal", "end", "name", "sign"
    return next(
        (kind, text) for kind, text in zip(kinds, piece.groups(), strict=True) if text is not None
    )
