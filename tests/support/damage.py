"""Robot programs with faults, at random but repeatably: for tests that hold two ways of reading against each other."""

import random
from collections.abc import Callable, Sequence

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
    """The line with a sign put in or in the place of another."""
    at = chance.randrange(len(line) + 1)
    return line[:at] + chance.choice(signs) + line[at + chance.randrange(2) :]
