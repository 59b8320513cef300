"""Reads a grammar in the notation of Grammar-Kit, and says whether a text is of its language.

Only what decides that: what recovers from errors, builds trees and colours is passed over. Choices are ordered, and
repetitions greedy, as there. The rule that all expressions extend is run by the priorities of its alternatives.
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

#: What matches at a token: the place behind it, None where it does not.
Match = Callable[[int], int | None]


@dataclass
class Grammar:
    """rules: the pieces of each by name. words, signs: literals of letters, in capitals, and of other characters, the
    longest first. start, expression: the names of rules. tokens: (N) kind and text of the text that is judged.
    """

    rules: dict[str, list[tuple[str, str]]]
    words: frozenset[str]
    signs: Sequence[str]
    kinds: Sequence[tuple[str, re.Pattern[str]]]
    start: str
    expression: str
    tokens: list[tuple[str, str]] = field(default_factory=list)
    made: dict[str, Match] = field(default_factory=dict)

    def takes(self, text: str) -> bool:
        """Whether a text is of the language."""
        tokens = self._split(text)
        if tokens is None:
            return False
        self.tokens = tokens
        return self._rule(self.start)(0) == len(tokens)

    def _split(self, text: str) -> list[tuple[str, str]] | None:
        found, at = [], 0
        while True:
            space = _SPACE.match(text, at)
            at = space.end() if space else at
            if at == len(text):
                return found
            token = self._token(text, at)
            if token is None:
                return None
            found.append(token)
            at += len(token[1])

    def _token(self, text: str, at: int) -> tuple[str, str] | None:
        sign = next((one for one in self.signs if text[at : at + len(one)].upper() == one), "")
        for kind, pattern in self.kinds:
            match = pattern.match(text, at)
            if match and len(match[0]) > len(sign):
                return ("literal" if match[0].upper() in self.words else kind), match[0]
        return ("literal", sign) if sign else None

    # Rules, as what matches.

    def _rule(self, name: str) -> Match:
        if name not in self.made:
            self.made[name] = partial(self._late, name)  # a rule may stand within itself
            if name == self.expression:
                self.made[name] = lambda at: self._climb(at, -1)
            elif name in self.rules:
                self.made[name] = self._choice(self.rules[name], 0)[0]
            else:
                self.made[name] = lambda at: (
                    at + 1 if at < len(self.tokens) and self.tokens[at][0] == name else None
                )
        return partial(self._late, name)

    def _late(self, name: str, at: int) -> int | None:
        return self.made[name](at)

    def _choice(self, pieces: Sequence[tuple[str, str]], k: int) -> tuple[Match, int]:
        ways, k = self._sequence(pieces, k)
        some = [ways]
        while k < len(pieces) and pieces[k] == ("sign", "|"):
            ways, k = self._sequence(pieces, k + 1)
            some.append(ways)
        return (lambda at: next((end for way in some if (end := way(at)) is not None), None)), k

    def _sequence(self, pieces: Sequence[tuple[str, str]], k: int) -> tuple[Match, int]:
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

    def _part(self, pieces: Sequence[tuple[str, str]], k: int) -> tuple[Match, int]:
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
            match = lambda at: at if at == len(self.tokens) else None  # noqa: E731 (one of four ways)
        else:
            match = self._rule(text)
        k += 1
        while k < len(pieces) and pieces[k] in (("sign", "?"), ("sign", "*"), ("sign", "+")):
            match = {"?": _maybe, "*": _many, "+": _some}[pieces[k][1]](match)
            k += 1
        return match, k

    def _literal(self, text: str) -> Match:
        def match(at: int) -> int | None:
            token = self.tokens[at] if at < len(self.tokens) else ("", "")
            return at + 1 if token[0] == "literal" and token[1].upper() == text else None

        return match

    # Expressions, by the priorities of their alternatives.

    def _climb(self, at: int, least: int) -> int | None:
        first, behind = self._operators()
        ends = [end for priority, way in first if (end := way(at, priority)) is not None]
        place = max(ends, default=None)
        while place is not None:
            ends = [
                end
                for priority, way in behind
                if priority > least and (end := way(place, priority)) is not None
            ]
            if not ends:
                return place
            place = max(ends)
        return None

    def _operators(self) -> tuple[list[tuple[int, Way]], list[tuple[int, Way]]]:
        if not self.ways:
            first, behind = self.ways = ([], [])
            for priority, name in self._alternatives(self.expression):
                pieces = self.rules[name]
                left = pieces[0] == ("name", self.expression)
                pieces = pieces[1:] if left else pieces
                right = pieces[-1] == ("name", self.expression)
                (behind if left else first).append(
                    (priority, self._way(pieces[:-1] if right else pieces, right))
                )
        return self.ways

    def _way(self, pieces: Sequence[tuple[str, str]], right: bool) -> Way:
        match = self._choice(pieces, 0)[0]

        def way(at: int, priority: int) -> int | None:
            end = match(at)
            return self._climb(end, priority) if right and end is not None else end

        return way

    def _alternatives(self, name: str, priority: int = -1) -> list[tuple[int, str]]:
        """The rules of expressions, by priority: groups of them count from 0."""
        found = []
        for k, one in enumerate(text for kind, text in self.rules[name] if kind == "name"):
            grouped = {kind for kind, _ in self.rules[one]} <= {"name", "sign"} and all(
                text == "|" or text.endswith("_expression") for _, text in self.rules[one]
            )
            if priority < 0 and grouped and one.startswith("priority"):
                found += self._alternatives(one, k)
            else:
                found.append((max(priority, 0), one))
        return found

    ways: tuple[list[tuple[int, Way]], list[tuple[int, Way]]] | tuple[()] = ()


Way = Callable[[int, int], int | None]


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
    """A grammar from its file. kinds: name and pattern of the tokens that are no literals, in their order."""
    head = _HEAD.match(text)
    literals = {
        two for _, two in _NAMED.findall(head[0] if head else "") if not two.startswith("regexp:")
    }
    body = re.sub(r"^\s*//.*$", "", text[head.end() if head else 0 :], flags=re.MULTILINE)
    starts = list(_RULE.finditer(body))
    rules = {}
    for one, after in zip(starts, [*starts[1:], None], strict=True):
        rule = _SETTINGS.sub("", body[one.end() : after.start() if after else len(body)])
        rules[one[1]] = [_piece(piece) for piece in _PIECE.finditer(rule)]
    words = frozenset(one.upper() for one in literals if one[0].isalpha())
    signs = sorted({one.upper() for one in literals} - words, key=len, reverse=True)
    patterns = [(name, re.compile(pattern, re.IGNORECASE)) for name, pattern in kinds]
    return Grammar(rules, words, signs, patterns, start, expression)


def _piece(piece: re.Match[str]) -> tuple[str, str]:
    single, double, end, name, sign = piece.groups()
    if single is not None or double is not None:
        return "literal", single if single is not None else double
    return ("end", end) if end else ("name", name) if name else ("sign", sign)
