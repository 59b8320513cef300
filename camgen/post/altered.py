"""Program texts with a number changed, for the conformance kit.

A build is safe only if a wrong number in a text is seen. So the kit changes numbers and expects a
fault, or a difference from the plan, from every change.

The sample: lines that differ only in their numbers have the same shape, and of each shape the first
and the last line are taken. Each number in them is changed three times: its first digit, its last
digit, and its sign. A number of value 0 has no sign.

A digit is changed by 5. One step of the last digit may be within the tolerance of a comparison,
which adds up the rounding of several numbers, such as three angles.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import NamedTuple

_STEP = 5
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


class Alteration(NamedTuple):
    """A text with one change.

    text: the whole text after the change.
    place: index of the changed character in the text before; of a sign that is added, the index
        of the character before the number.
    line: 1-based line of the change.
    what: the line before and after, for a message.
    """

    text: str
    place: int
    line: int
    what: str


def alter_numbers(text: str, first_line: int = 1) -> Iterator[Alteration]:
    """Changes each number of the sample. Lines before `first_line` stay as they are."""
    begin = 0
    lines: dict[str, list[tuple[int, int]]] = {}
    for number, line in enumerate(text.split("\n"), 1):
        if number >= first_line:
            lines.setdefault(_NUMBER.sub("0", line), []).append((number, begin))
        begin += len(line) + 1
    for same in lines.values():
        for number, start in dict.fromkeys((same[0], same[-1])):
            line = text[start:].split("\n", 1)[0]
            for place, altered in _alter_line(line):
                changed = text[:start] + altered + text[start + len(line) :]
                yield Alteration(changed, start + place, number, f"{line!r} as {altered!r}")


def _alter_line(line: str) -> Iterator[tuple[int, str]]:
    for match in _NUMBER.finditer(line):
        first, last = match.start(), match.end() - 1
        for place in dict.fromkeys((first, last)):
            yield place, line[:place] + str((int(line[place]) + _STEP) % 10) + line[place + 1 :]
        if not float(match.group()):
            continue
        if line[first - 1 : first] == "-":
            yield first - 1, line[: first - 1] + line[first:]
        else:
            yield first - 1, f"{line[:first]}-{line[first:]}"


def is_excused(alteration: Alteration, text: str, meaningless: Collection[str]) -> bool:
    """Whether a change lies in what the author of a post says to mean nothing.

    text: before the change.
    meaningless: patterns; where one has a group, the group is meant, else the whole match.
    """
    for pattern in meaningless:
        for match in re.finditer(pattern, text, re.MULTILINE):
            begin, end = match.span(1) if match.re.groups else match.span()
            if begin <= alteration.place < end:
                return True
    return False
