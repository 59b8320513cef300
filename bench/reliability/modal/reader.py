"""A V+ program that reads its motions from a file, carried out statement by statement in single precision.

As far as such a program needs it: WHILE, IF, CASE and GOTO, sums and comparisons of reals, READ from one file. What is
none of these is what the program does, and comes out as a line with the numbers worked out.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from bench.reliability.modal import vplus
from bench.reliability.modal.machine import Event

_WORD = re.compile(r'"[^"]*"|\d+\.?\d*|[.$#]?[A-Za-z][A-Za-z0-9_.]*|==|<>|<=|>=|\S')
#: More statements than any file of the bench needs.
_MOST = 200_000
_END_OF_FILE = -504
_ARITHMETIC = frozenset("+-*/")
_SUMS: dict[str, tuple[int, Callable[[np.float32, np.float32], np.float32]]] = {
    "or": (1, lambda a, b: np.float32(bool(a) or bool(b))),
    "==": (2, lambda a, b: np.float32(a == b)),
    "<>": (2, lambda a, b: np.float32(a != b)),
    "<": (2, lambda a, b: np.float32(a < b)),
    "<=": (2, lambda a, b: np.float32(a <= b)),
    "+": (3, lambda a, b: a + b),
    "-": (3, lambda a, b: a - b),
    "*": (4, lambda a, b: a * b),
    "/": (4, lambda a, b: a / b),
    "mod": (4, np.fmod),
}


class Stopped(Exception):
    """A statement that cannot be carried out: the controller stops there."""


def trace(program: str, data: str) -> list[Event]:
    """The trace of what the program does with its data, and of its statements behind the first READ or ATTACH of a
    file, which may be left out of that.
    """
    lines = _split(program)
    start = next((k for k, words in enumerate(lines) if words[:3] == ["attach", "(", "cg.lun"]), 0)
    stated: list[Event] = [("statement", *words) for words in lines[start:] if words != ["return"]]
    return vplus.trace("\n".join(carry_out(program, data))) + stated


def carry_out(program: str, data: str | None) -> list[str]:
    """The lines that the program does, its first and its last included. data: of its file; None: there is none."""
    return _Run(_split(program), data).run()


def _split(program: str) -> list[list[str]]:
    """The lines in words, small but in strings, without comments."""
    found = []
    for line in program.split("\n"):
        code = re.match(r'(?:"[^"]*"|[^";])*', line)
        words = _WORD.findall(code[0]) if code else []
        if words:
            found.append([word if word[0] == '"' else word.lower() for word in words])
    return found


class _Run:
    """One run. reals: the variables. opened: the records that are still to come. status: of the file."""

    def __init__(self, lines: list[list[str]], data: str | None) -> None:
        self.lines, self.data = lines, data
        self.reals: dict[str, np.float32] = {}
        self.opened: list[str] | None = None
        self.status = 0
        self.done: list[str] = []

    def run(self) -> list[str]:
        """All lines that are done."""
        at = count = 0
        while at < len(self.lines):
            words = self.lines[at]
            count += 1
            try:
                if count > _MOST:
                    raise Stopped
                at = self.step(at, words)
            except Stopped:
                self.done += ["stop", ".end"]
                break
        return self.done

    def step(self, at: int, words: list[str]) -> int:
        """One line; the place of the next."""
        word = words[0]
        if word in ("while", "if"):
            true = self.value(words[1:-1]) != 0
            return at + 1 if true else self.end(at) + 1
        if word == "case":
            return self.choose(at, self.value(words[1:-1]))
        if word in ("value", "any"):
            return self.end(at - 1)
        if word == "end":
            back = self.begin(at)
            return back if self.lines[back][0] == "while" else at + 1
        if word == "goto":
            return self.lines.index(words[1:])
        if word in ("stop", "return"):
            self.done += [word, ".end"]
            return len(self.lines)
        if not word.isdigit():
            self.act(words)
        return at + 1

    def act(self, words: list[str]) -> None:
        """A statement that is no jump."""
        word = words[0]
        if words[1:2] == ["="]:
            self.reals[word] = self.value(words[2:])
        elif word == "attach" and words[1:3] == ["(", "cg.lun"]:
            self.status = 1
            self.reals["cg.lun"] = np.float32(5)
        elif word == "fopenr":
            self.opened = None if self.data is None else self.data.split("\n")[:-1]
            self.status = 1 if self.opened is not None else -508
        elif word == "read":
            self.read([name for name in words[4:] if name != ","])
        elif word == "fclose" or (word == "detach" and "cg.lun" in words):
            self.opened = None
        else:
            self.done.append(" ".join(self.worked_out(words)))

    def read(self, names: Sequence[str]) -> None:
        """A record: numbers that it lacks are 0, what is no number is an error, and those it has too many are left."""
        if not self.opened:
            self.status = _END_OF_FILE
            return
        record = [part for part in re.split("[, ]+", self.opened.pop(0)) if part]
        try:
            numbers = [np.float32(part) for part in record]
        except ValueError:
            self.status = -1
            return
        numbers += [np.float32(0)] * (len(names) - len(numbers))
        self.reals.update(zip(names, numbers, strict=False))
        self.status = 1

    def choose(self, at: int, value: np.float32) -> int:
        """The first line of the case of ``value``."""
        depth = 0
        for k in range(at + 1, self.end(at)):
            words = self.lines[k]
            if depth == 0 and (
                words == ["any"] or (words[0] == "value" and self.value(words[1:-1]) == value)
            ):
                return k + 1
            depth += (words[0] in ("while", "if", "case")) - (words[0] == "end")
        return self.end(at) + 1

    def end(self, at: int) -> int:
        """The END of the block that the line stands at the start of, or within."""
        return self.other(at, 1)

    def begin(self, at: int) -> int:
        """The start of the block that ends here."""
        return self.other(at, -1)

    def other(self, at: int, step: int) -> int:
        """The other end of a block. Stopped where there is none."""
        depth, first = 1, at + step
        for k in range(first, len(self.lines) if step > 0 else -1, step):
            word = self.lines[k][0]
            depth += step * ((word in ("while", "if", "case")) - (word == "end"))
            if depth == 0:
                return k
        raise Stopped

    def worked_out(self, words: Sequence[str]) -> list[str]:
        """The words with every sum that has a variable in it replaced by its value."""
        found: list[str] = []
        run: list[str] = []
        for word in [*words, ""]:
            if word and (word in self.reals or word in _ARITHMETIC or word[0].isdigit()):
                run.append(word)
                continue
            if any(part in self.reals for part in run):
                found.append(f"{float(self.value(run)):.6f}".rstrip("0").rstrip("."))
            else:
                found += run
            run = []
            found += [word] if word else []
        return found

    def value(self, words: Sequence[str]) -> np.float32:
        """A sum. Stopped where it cannot be worked out."""
        rest = list(words)
        found = self.sum(rest, 0)
        if rest:
            raise Stopped
        return found

    def sum(self, rest: list[str], above: int) -> np.float32:
        """The first sum of ``rest`` whose signs bind more than ``above``; what was read is taken off."""
        found = self.one(rest)
        while rest and rest[0] in _SUMS and _SUMS[rest[0]][0] > above:
            level, does = _SUMS[rest.pop(0)]
            found = np.float32(does(found, self.sum(rest, level)))
        return found

    def one(self, rest: list[str]) -> np.float32:
        """A number, a variable, a bracket, or the status of the file."""
        word = rest.pop(0) if rest else ""
        if word == "-":
            return -self.one(rest)
        if word == "iostat" and rest[:3] == ["(", "cg.lun", ")"]:
            del rest[:3]
            return np.float32(self.status)
        if word == "(":
            found = self.sum(rest, 0)
            if not rest or rest.pop(0) != ")":
                raise Stopped
            return found
        if word in self.reals:
            return self.reals[word]
        if re.fullmatch(r"\d+\.?\d*", word):
            return np.float32(word)
        raise Stopped
