"""A V+ program that reads its motions from a file, run statement by statement in single precision.

It runs as much of V+ as such a program needs: WHILE, IF, CASE and GOTO, sums and comparisons of
reals, READ from one file. All other statements are effects of the program: each becomes a line with
its sums worked out.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence

import numpy as np

from bench.reliability.modal import vplus
from bench.reliability.modal.machine import Event

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*|[.$#]?[A-Za-z][A-Za-z0-9_.]*|==|<>|<=|>=|\S')
#: Limit of statements, which no file of the bench reaches.
_MOST = 200_000
#: Status of a file after its last record, and of a file that does not exist.
_END_OF_FILE, _NO_FILE = -504, -508
_OPENINGS = ("while", "if", "case")
_ARITHMETIC = frozenset("+-*/")
#: Operators: how strongly they bind, and their meaning.
_OPERATORS: dict[str, tuple[int, Callable[[np.float32, np.float32], object]]] = {
    "or": (1, np.logical_or),
    "==": (2, operator.eq),
    "<>": (2, operator.ne),
    "<": (2, operator.lt),
    "<=": (2, operator.le),
    "+": (3, operator.add),
    "-": (3, operator.sub),
    "*": (4, operator.mul),
    "/": (4, operator.truediv),
    "mod": (4, np.fmod),
}


class Stopped(Exception):
    """A statement that cannot be run: the controller stops there."""


def trace(program: str, data: str) -> list[Event]:
    """The trace of the effects of a program with its data, then its statements.

    The statements begin at the first ATTACH of a file: a run may not reach all of them.
    """
    lines = _split(program)
    start = 0
    for number, words in enumerate(lines):
        if words[:3] == ["attach", "(", "cg.lun"]:
            start = number
            break
    statements: list[Event] = []
    for words in lines[start:]:
        if words != ["return"]:
            statements.append(("statement", *words))
    return vplus.trace("\n".join(carry_out(program, data))) + statements


def carry_out(program: str, data: str | None) -> list[str]:
    """The lines that a program runs, with its first and last one.

    data: text of its file; None if the file does not exist
    """
    return _Run(_split(program), data).run()


def _split(program: str) -> list[list[str]]:
    """The words of each line in lower case, strings as they are, without comments."""
    lines = []
    for line in program.split("\n"):
        code = re.match(r'(?:"[^"]*"|[^";])*', line)
        words = _WORD.findall(code[0]) if code else []
        if words:
            lines.append([word if word[0] == '"' else word.lower() for word in words])
    return lines


class _Run:
    """A run of a program.

    reals: variables by name
    records: records of the open file that are not read yet; None without an open file
    status: status of the file
    effects: lines that were run
    """

    def __init__(self, lines: list[list[str]], data: str | None) -> None:
        self.lines, self.data = lines, data
        self.reals: dict[str, np.float32] = {}
        self.records: list[str] | None = None
        self.status = 0
        self.effects: list[str] = []

    def run(self) -> list[str]:
        """Runs the program, and returns its effects."""
        place = count = 0
        try:
            while place < len(self.lines):
                count += 1
                if count > _MOST:
                    raise Stopped
                place = self.run_line(place)
        except Stopped:
            self.effects += ["stop", ".end"]
        return self.effects

    def run_line(self, place: int) -> int:
        """Runs a line. Returns the index of the next one."""
        words = self.lines[place]
        word = words[0]
        if word in ("while", "if"):
            is_true = self.evaluate(words[1:-1]) != 0
            return place + 1 if is_true else self.find_other_end(place, 1) + 1
        if word == "case":
            return self.choose(place, self.evaluate(words[1:-1]))
        if word in ("value", "any"):
            return self.find_other_end(place - 1, 1)
        if word == "end":
            opening = self.find_other_end(place, -1)
            return opening if self.lines[opening][0] == "while" else place + 1
        if word == "goto":
            return self.lines.index(words[1:])
        if word in ("stop", "return"):
            self.effects += [word, ".end"]
            return len(self.lines)
        if not word.isdigit():
            self.run_statement(words)
        return place + 1

    def run_statement(self, words: list[str]) -> None:
        """Runs a statement that is not a jump."""
        word = words[0]
        if words[1:2] == ["="]:
            self.reals[word] = self.evaluate(words[2:])
        elif word == "attach" and words[1:3] == ["(", "cg.lun"]:
            self.status = 1
            self.reals["cg.lun"] = np.float32(5)
        elif word == "fopenr":
            self.records = None if self.data is None else self.data.split("\n")[:-1]
            self.status = _NO_FILE if self.records is None else 1
        elif word == "read":
            self.read_record([name for name in words[4:] if name != ","])
        elif word == "fclose" or (word == "detach" and "cg.lun" in words):
            self.records = None
        else:
            self.effects.append(" ".join(self.work_out_sums(words)))

    def read_record(self, names: Sequence[str]) -> None:
        """Reads a record into variables.

        Missing numbers are 0, a word that is not a number is an error, and further ones are left.
        """
        if not self.records:
            self.status = _END_OF_FILE
            return
        record = [part for part in re.split("[, ]+", self.records.pop(0)) if part]
        try:
            numbers = [np.float32(part) for part in record]
        except ValueError:
            self.status = -1
            return
        numbers += [np.float32(0)] * (len(names) - len(numbers))
        self.reals.update(zip(names, numbers, strict=False))
        self.status = 1

    def choose(self, place: int, value: np.float32) -> int:
        """The first line of the branch of a CASE for a value."""
        end = self.find_other_end(place, 1)
        depth = 0
        for number in range(place + 1, end):
            words = self.lines[number]
            is_branch = depth == 0 and words[0] in ("value", "any")
            if is_branch and (words == ["any"] or self.evaluate(words[1:-1]) == value):
                return number + 1
            depth += (words[0] in _OPENINGS) - (words[0] == "end")
        return end + 1

    def find_other_end(self, place: int, step: int) -> int:
        """Finds the line that closes or opens the block of a line. Stopped without one.

        step: 1 to the end, -1 to the start
        """
        depth = 1
        last = len(self.lines) if step > 0 else -1
        for number in range(place + step, last, step):
            word = self.lines[number][0]
            depth += step * ((word in _OPENINGS) - (word == "end"))
            if depth == 0:
                return number
        raise Stopped

    def work_out_sums(self, words: Sequence[str]) -> list[str]:
        """The words with the value of each sum that has a variable in it."""
        lines: list[str] = []
        terms: list[str] = []
        for word in [*words, ""]:
            if word and (word in self.reals or word in _ARITHMETIC or word[0].isdigit()):
                terms.append(word)
                continue
            if any(term in self.reals for term in terms):
                terms = [f"{float(self.evaluate(terms)):.6f}".rstrip("0").rstrip(".")]
            lines += terms
            terms = []
            if word:
                lines.append(word)
        return lines

    def evaluate(self, words: Sequence[str]) -> np.float32:
        """The value of a sum. Raises Stopped if it has none."""
        rest = list(words)
        value = self.evaluate_sum(rest, 0)
        if rest:
            raise Stopped
        return value

    def evaluate_sum(self, rest: list[str], level: int) -> np.float32:
        """The value of the first sum whose operators bind more than `level`.

        rest: words, from which the sum is removed
        """
        value = self.evaluate_term(rest)
        while rest and rest[0] in _OPERATORS and _OPERATORS[rest[0]][0] > level:
            binding, compute = _OPERATORS[rest.pop(0)]
            value = np.float32(compute(value, self.evaluate_sum(rest, binding)))
        return value

    def evaluate_term(self, rest: list[str]) -> np.float32:
        """The value of a number, a variable, a bracket, or the status of the file."""
        word = rest.pop(0) if rest else ""
        if word == "-":
            return -self.evaluate_term(rest)
        if word == "iostat" and rest[:3] == ["(", "cg.lun", ")"]:
            del rest[:3]
            return np.float32(self.status)
        if word == "(":
            value = self.evaluate_sum(rest, 0)
            if not rest or rest.pop(0) != ")":
                raise Stopped
            return value
        if word in self.reals:
            return self.reals[word]
        if re.fullmatch(r"\d+\.?\d*", word):
            return np.float32(word)
        raise Stopped
