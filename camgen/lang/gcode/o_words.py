"""The flow of a G-code program: O-words of LinuxCNC, jumps and subprograms of other controllers.

`list_blocks` finds the structure once, before the program runs. `Flow` determines the next line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from msgspec import Struct, field

from camgen.lang.gcode.words import LineError, Parameters, bare, value_at

NO_FILES: dict[str, int] = {}
_START = re.compile(r"[ \t]*/?[ \t]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO]")
_PROGRAM = re.compile(
    r"[ \t%]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO][ \t]*([0-9]{1,9})(?![0-9])(?![ \t]*[a-zA-Z])"
)
_NUMBERED = re.compile(r"[ \t]*/?[ \t]*[nN][ \t]*([0-9]{1,9})(?![0-9.])")
_FILE = re.compile(r"[oO]?([0-9]{1,9})(?:\.[A-Za-z]+)?")
_OWORD = re.compile(
    r"o(?:<([^<>]*)>|([0-9]+)|(\[.*\])(?=call))"
    r"(sub|endsub|call|return|if|elseif|else|endif|while|endwhile|do|repeat|endrepeat|break"
    r"|continue)?(.*)"
)
_LOOPS = frozenset({"while", "do", "repeat"})
#: The word that opens the structure which a word closes.
_CLOSES = {"endsub": "sub", "endif": "if", "endwhile": "while", "endrepeat": "repeat"}


class Block(Struct):
    """One O-word.

    label: number, name in < >, or expression in [ ] of its number.
    word: keyword, such as "if".
    rest: text after the keyword.
    places: lines, from 0, of all parts of its structure: sub and endsub; if, elseif, else and
        endif; while and endwhile; do and while; repeat and endrepeat.
    """

    label: str
    word: str
    rest: str
    places: list[int] = field(default_factory=list)


class Blocks(Struct):
    """The O-words and numbers of a program.

    at: O-words by line, from 0.
    subs: line of each sub by its label.
    numbers: lines of programs and blocks by their numbers, such as "o100" and "n20".
    main: first line after the first of several files, 0 for one file.
    """

    at: dict[int, Block]
    subs: dict[str, int]
    numbers: dict[str, int] = field(default_factory=dict)
    main: int = 0


def list_blocks(
    lines: Sequence[str],
    flow: bool = True,
    files: Mapping[str, int] = NO_FILES,
    numbers: bool = True,
) -> Blocks:
    """The O-words of a program.

    flow: whether O-words change the flow, as in LinuxCNC. Else they are numbers of programs.
    files: first line of each file, from 0, by name.
    numbers: whether an O-word may be the number of a program.

    Raises LineError with the line, from 1, as its second argument.
    """
    blocks = Blocks({}, {})
    opened: list[Block] = []
    starts = sorted(files.values())
    blocks.main = starts[1] if len(starts) > 1 else 0
    for number, raw in enumerate(lines):
        if ("o" in raw or "O" in raw) and _START.match(raw):
            if flow:
                try:
                    _enter(blocks, opened, number, raw)
                except LineError as wrong:
                    raise LineError(str(wrong), number + 1) from wrong
            _number(blocks, number, raw, flow, numbers)
        elif line := _NUMBERED.match(raw):
            blocks.numbers.setdefault(f"n{int(line[1])}", number)
    for name, start in files.items():
        if digits := _FILE.fullmatch(name):
            # A program begins behind its number.
            blocks.numbers.setdefault(f"o{int(digits[1])}", start - 1)
    if opened:
        block = opened[-1]
        raise LineError(f"o{block.label} {block.word} has no end", block.places[0] + 1)
    return blocks


def _number(blocks: Blocks, number: int, raw: str, flow: bool, numbers: bool) -> None:
    """Adds the number of a program: O1234, alone or with a title."""
    program = _PROGRAM.match(raw)
    if program:
        blocks.numbers.setdefault(f"o{int(program[1])}", number)
    if not flow and numbers:
        blocks.at[number] = Block(program[1] if program else "", "", "")


def _enter(blocks: Blocks, opened: list[Block], number: int, raw: str) -> None:
    """Adds the O-word of a line. Raises LineError.

    opened: structures that have no end yet.
    number: line, from 0.
    """
    text = bare(raw)
    match = _OWORD.fullmatch(text)
    if not match:
        raise LineError(f"cannot read the O-word {text[:16]!r}")
    name, digits, expression, word, rest = match.groups()
    label = expression
    if not label:
        label = f"<{name}>" if name is not None else str(int(digits))
    block = Block(label, word or "", rest)
    blocks.at[number] = block
    top = opened[-1] if opened else None
    if word == "while" and top and top.word == "do" and top.label == block.label:
        block.places = top.places
        block.word = "until"
        block.places.append(number)
        opened.pop()
    elif word in ("sub", "if", "while", "do", "repeat"):
        block.places = [number]
        opened.append(block)
        if word == "sub":
            if block.label in blocks.subs:
                raise LineError(f"o{block.label} sub is there twice")
            blocks.subs[block.label] = number
    elif word in ("elseif", "else") or word in _CLOSES:
        _go_on(opened, block, number, _CLOSES.get(word, "if"))
    elif word in ("break", "continue"):
        loops = [outer for outer in opened if outer.label == block.label and outer.word in _LOOPS]
        if not loops:
            raise LineError(f"o{block.label} {word} stands in no such loop")
        block.places = loops[-1].places


def _go_on(opened: list[Block], block: Block, number: int, opener: str) -> None:
    """Adds a part to the innermost structure, or closes it. Raises LineError."""
    top = opened[-1] if opened else None
    if top is None or top.word != opener or top.label not in (block.label, ""):
        inside = f"; o{top.label} {top.word} is open" if top else ""
        raise LineError(f"o{block.label} {block.word} has no {opener} before it{inside}")
    block.places = top.places
    block.places.append(number)
    if block.word in _CLOSES:
        opened.pop()


#: Depth of calls, and number of arguments, as in LinuxCNC.
_LEVELS, _MOST_ARGUMENTS = 10, 30


class _Call(Struct):
    """A subroutine that runs.

    back: line after the call, from 0.
    arguments, named, counts: parameters and repeats of the caller.
    start, again: first line of a subprogram (M98), and number of its further runs.
    """

    back: int
    arguments: dict[int, float]
    named: dict[str, float]
    counts: dict[int, int]
    start: int = 0
    again: int = 0


class Flow(Struct):
    """The flow of a program that runs.

    blocks: O-words of the program.
    known: parameters.
    absent: is called with a message for a subroutine that is in no file.
    calls: subroutines that run.
    counts: rounds left of each repeat by its line.
    """

    blocks: Blocks
    known: Parameters
    absent: Callable[[str], None]
    calls: list[_Call] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)

    def depth(self) -> int:
        """Return the number of subroutines that run."""
        return len(self.calls)

    def after(self, at: int, block: Block) -> int:
        """Return the line, from 0, that runs after the O-word of line `at`. Raises LineError."""
        match block.word:
            case "call":
                return self._call(at, block)
            case "endsub" | "return":
                return self._return(block)
            case "if":
                return self._branch(block)
            case "sub" | "elseif" | "else":
                # A definition, or the end of the branch that has run.
                return block.places[-1] + 1
            case "repeat" | "endrepeat":
                return self._repeat(at, block)
            case "while" | "endwhile" | "until" | "break" | "continue":
                return self._loop(at, block)
        return at + 1  # do, endif, or a program number

    def _loop(self, at: int, block: Block) -> int:
        first, last = block.places[0], block.places[-1]
        match block.word:
            case "while":
                return at + 1 if self._holds(block) else last + 1
            case "until":
                return first + 1 if self._holds(block) else last + 1
            case "break":
                self.counts.pop(first, None)
                return last + 1
            case "continue":
                return first if self.blocks.at[first].word == "while" else last
        return first  # endwhile

    def _holds(self, block: Block) -> bool:
        return bool(self._values(block, 1)[0])

    def _values(self, block: Block, count: int) -> list[float]:
        """Return the expressions in brackets after the word. Raises LineError."""
        at, text = 0, block.rest
        values: list[float] = []
        while text[at : at + 1] == "[" and len(values) < count:
            value, at = value_at(text, at, self.known)
            values.append(value)
        if at < len(text):
            raise LineError(f"cannot read {text[at : at + 12]!r} after o{block.label} {block.word}")
        if count == 1 and not values:
            raise LineError(f"o{block.label} {block.word} without its condition or number")
        return values

    def _branch(self, block: Block) -> int:
        """Return the first line of the first branch whose condition holds."""
        for place in block.places:
            branch = self.blocks.at[place]
            if branch.word in ("else", "endif") or self._holds(branch):
                return place + 1
        return block.places[-1] + 1

    def _repeat(self, at: int, block: Block) -> int:
        first = block.places[0]
        if block.word == "repeat":
            left = int(self._values(block, 1)[0])
        else:
            left = self.counts.get(first, 1) - 1
        if left > 0:
            self.counts[first] = left
            return first + 1
        self.counts.pop(first, None)
        return block.places[-1] + 1 if block.word == "repeat" else at + 1

    def _call(self, at: int, block: Block) -> int:
        values, label = self._values(block, _MOST_ARGUMENTS), block.label
        if label.startswith("["):  # o[#1+100] call
            label = f"{value_at(label, 0, self.known)[0]:.0f}"
        if label not in self.blocks.subs:
            self.absent(f"o{label} call: the subroutine is not in this file")
            return at + 1
        if len(self.calls) >= _LEVELS:
            raise LineError(f"o{label} call: more than {_LEVELS} subroutines in each other")
        self.calls.append(_Call(at + 1, self.known.arguments, self.known.named, self.counts))
        self.known.arguments = dict(enumerate(values, 1))
        self.known.named, self.counts = {}, {}
        return self.blocks.subs[label] + 1

    def leap(
        self,
        at: int,
        code: str,
        number: float,
        times: int,
        given: Mapping[int, float] | None = None,
    ) -> int:
        """Return the line after M97, M98, M99, GOTO or G65 in line `at`. Raises LineError.

        number: number of the program or block.
        times: number of runs.
        given: arguments of the subprogram, None if it keeps the arguments of the caller.
        """
        if code == "M99":
            return self._come_back(number)
        if code == "GOTO":
            return self.find_number(f"n{number:.0f}") + 1
        start = self.blocks.numbers.get(f"{'n' if code == 'M97' else 'o'}{number:.0f}")
        if start is None:
            self.absent(f"{code} P{number:g}: the subprogram is not in this file")
            return at + 1
        if len(self.calls) >= _LEVELS:
            raise LineError(f"{code} P{number:g}: more than {_LEVELS} subroutines in each other")
        if times < 1:
            return at + 1
        known = self.known
        first = start + (code != "M97")
        self.calls.append(
            _Call(at + 1, known.arguments, known.named, self.counts, first, times - 1)
        )
        if given is not None:
            known.arguments, known.named = dict(given), {}
        return self.calls[-1].start

    def _come_back(self, number: float) -> int:
        if not self.calls:
            raise LineError("M99 outside a subprogram that was called")
        call = self.calls[-1]
        if call.again > 0:
            call.again -= 1
            return call.start
        self.calls.pop()
        self.known.arguments, self.known.named = call.arguments, call.named
        return self.find_number(f"n{number:.0f}") if number else call.back

    def find_profile(self, first: float | None, last: float) -> tuple[int, int]:
        """Return the first and the last line of a profile, from 0. Raises LineError.

        first, last: numbers of its blocks. Without `first`, `last` is the label of a subroutine.
        """
        if first is not None:
            return self.find_number(f"n{first:.0f}"), self.find_number(f"n{last:.0f}")
        if f"{last:.0f}" not in self.blocks.subs:
            raise LineError(f"O{last:.0f} is not in this file: the profile of the cycle")
        start = self.blocks.subs[f"{last:.0f}"]
        return start + 1, self.blocks.at[start].places[-1] - 1

    def find_number(self, name: str) -> int:
        """Return the line, from 0, of a number such as n20. Raises LineError."""
        if name not in self.blocks.numbers:
            raise LineError(f"a jump to {name.upper()}, which no line has")
        return self.blocks.numbers[name]

    def _return(self, block: Block) -> int:
        values = self._values(block, 2)
        if not self.calls:
            raise LineError(f"o{block.label} {block.word} outside a subroutine that was called")
        call = self.calls.pop()
        self.known.arguments, self.known.named, self.counts = (
            call.arguments,
            call.named,
            call.counts,
        )
        self.known.shared["_value"] = values[0] if values else 0.0
        self.known.shared["_value_returned"] = float(bool(values))
        return call.back
