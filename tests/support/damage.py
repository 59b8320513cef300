"""Robot programs with faults, at random but repeatably, for tests that compare two parsers."""

import random
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

ENDS = [["\n"], ["\n"], ["\r\n"], ["\n", "\r\n", "\r", "\n\r", "\r\r\n", "\n\n"]]


def damaged(
    text: str,
    chance: random.Random,
    statements: Sequence[str],
    changed_line: Callable[[str, random.Random], str],
) -> str:
    """The text with some lines changed, moved, doubled, left out or put in, and some line ends."""
    lines = text.split("\n")
    for _ in range(chance.choice([1, 1, 2, 3, 6, 20])):
        k, kind = chance.randrange(len(lines)), chance.randrange(8)
        if kind < 3:
            lines[k] = changed_line(lines[k], chance)
        elif kind < 5:
            lines.insert(k, " " * chance.choice([0, 4]) + chance.choice(statements))
        elif kind == 5:
            lines.insert(k, lines.pop(chance.randrange(len(lines))))
        elif kind == 6:
            lines[k:k] = lines[chance.randrange(len(lines)) :][: chance.randrange(9)]
        else:
            del lines[k : k + chance.choice([1, 1, 1, 4])]
        lines = lines or [""]
    ends = chance.choice(ENDS)
    return "".join(line + chance.choice(ends) for line in lines)


def one_sign_changed(line: str, chance: random.Random, signs: Sequence[str]) -> str:
    """The line with a sign inserted, or with a sign instead of another one."""
    at = chance.randrange(len(line) + 1)
    return line[:at] + chance.choice(signs) + line[at + chance.randrange(2) :]


class Damage(NamedTuple):
    """Ways to damage a text of a language.

    statements: lines that are inserted.
    spellings: pairs of a pattern of tokens and the spellings that replace a token.
    starts, ends: additions to the start and the end of a line.
    characters: characters that are inserted or that replace another.
    headers: first lines of the second file, if a text is cut into two files.
    """

    statements: Sequence[str]
    spellings: Sequence[tuple[re.Pattern[str], Sequence[str]]]
    starts: Sequence[str]
    ends: Sequence[str]
    characters: Sequence[str]
    headers: Sequence[str] = ("",)

    def change_line(self, line: str, chance: random.Random) -> str:
        """`line` with one change."""
        kind = chance.randrange(8)
        if kind < 4:
            pattern, spellings = chance.choice(self.spellings)
            tokens = list(pattern.finditer(line))
            if tokens:
                token = chance.choice(tokens)
                return line[: token.start()] + chance.choice(spellings) + line[token.end() :]
        if kind == 4:
            return chance.choice([line.lower(), line.upper(), line.swapcase(), line.title()])
        if kind == 5:
            return chance.choice(self.starts) + line.lstrip(" ")
        if kind == 6:
            return line + chance.choice(self.ends)
        return one_sign_changed(line, chance, self.characters)
