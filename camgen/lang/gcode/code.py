"""A G-code program as the steps of the engine: O-words of LinuxCNC and macros of Fanuc.

Lines without a word of the flow are one step, which the interpreter runs in order.

Labels of the steps: "sub 100" and "sub <name>" for the first step of a subroutine, "endsub 100" for
its end, "o100" for the program of a number, "n20" for the line of a number, "end of main" for the
end of the first of several files.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from camgen.lang.code import (
    Act,
    Block,
    Code,
    Compiler,
    Condition,
    CountStart,
    End,
    Jump,
    LoopStart,
    Step,
)
from camgen.lang.gcode.dialects import Dialect
from camgen.lang.gcode.interpreter import Interpreter, Macro, OWord
from camgen.lang.gcode.words import BLANKS, LineError, bare, drop_comments
from camgen.lang.values import require

_START = re.compile(r"[ \t]*/?[ \t]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO]")
_PROGRAM = re.compile(
    r"[ \t%]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO][ \t]*([0-9]{1,9})(?![0-9])(?![ \t]*[a-zA-Z])"
)
_NUMBERED = re.compile(r"[ \t]*/?[ \t]*[nN][ \t]*([0-9]{1,9})(?![0-9.])")
_FILE = re.compile(r"[oO]?([0-9]{1,9})(?:\.[A-Za-z]+)?")
_O_WORD = re.compile(
    r"o(?:<([^<>]*)>|([0-9]+)|(\[.*\])(?=call))"
    r"(sub|endsub|call|return|if|elseif|else|endif|while|endwhile|do|repeat|endrepeat|break"
    r"|continue)?(.*)"
)
#: Words that go to the number of a line: GOTO, M97, M99 P, G70 to G72, codes from an expression.
_GOES = re.compile(r"g\s*o\s*t\s*o|m[\s+0]*9\s*[79]|g[\s+0]*7\s*[0-2]|[gm]\s*[-\[#]", re.IGNORECASE)
_MACRO = re.compile(r"(?:n[0-9]+(?:\.[0-9]*)?)?(if|goto|while|end|do)(.*)")
_LOOP = re.compile(r".*do([0-9]+)")
_LOOPS = ("while", "do", "repeat")


def compile_lines(count: int) -> Code:
    """Return the steps of a program without words of the flow. count: number of its lines."""
    return Code([_run_lines(range(count)), End(count, cost=0)], {})


def _run_lines(span: range) -> Act:
    first, count = span.start + 1, len(span)
    return Act(first, cost=0, do=Interpreter.run_lines, operand=span, lines=count)


def compile_program(lines: Sequence[str], dialect: Dialect, files: Mapping[str, int]) -> Code:
    """Return the steps of a program.

    files: first line of each file, from 0, by name.
    Raises LineError with the line, from 1, as its second argument.
    """
    return _Program(lines, dialect, files).code


class _Program(Compiler):
    """The steps of a program while its lines are read in order.

    code: the steps after all lines.
    """

    def __init__(self, lines: Sequence[str], dialect: Dialect, files: Mapping[str, int]) -> None:
        super().__init__()
        self._dialect = dialect
        self._start = 0
        #: Subroutine and label of each block.
        self._labels: set[tuple[str, str]] = set()
        starts = sorted(files.values())
        main_end = starts[1] if len(starts) > 1 else -1
        first_steps = {}
        has_jumps = _GOES.search("\n".join(lines)) is not None
        for number, raw in enumerate(lines):
            self.line = number + 1
            if number in starts:
                self._end_lines(number)
                if number == main_end:
                    self.mark("end of main")
                    self.add(Act(number, cost=0, do=Interpreter.end_main))
                first_steps[number] = len(self.steps)
            if ("o" in raw or "O" in raw) and _START.match(raw):
                self._read_o_line(number, raw)
            elif has_jumps:
                # Each line may be the target of a jump, or the last one of a profile.
                self._end_lines(number)
                if numbered := _NUMBERED.match(raw):
                    self.mark(f"n{int(numbered[1])}")
            if dialect.increments and (macro := self._find_macro(raw)):
                self._end_lines(number)
                self._read_macro(macro[2], Macro(raw, macro[1]))
                self._start = number + 1
        self._end_lines(len(lines))
        self._close_rest()
        for name, start in files.items():
            if digits := _FILE.fullmatch(name):
                self.labels.setdefault(f"o{int(digits[1])}", first_steps.get(start, 0))
        self.line = len(lines)
        self.add(End(self.line, cost=0))
        self.code: Code = self.finish()

    def _end_lines(self, number: int) -> None:
        if number > self._start:
            self.add(_run_lines(range(self._start, number)))
        self._start = number

    def _close_rest(self) -> None:
        """Replace the starts of Fanuc's loops without END. Raises LineError for other blocks."""
        if self.blocks and self._dialect.flow:
            block = self.blocks[-1]
            raise LineError(f"{block.kind} has no end", block.line)
        for block in self.blocks:
            assert isinstance(block.first, LoopStart)
            assert block.first.condition is not None
            macro = block.first.condition.value
            self.steps[block.start] = Act(block.line, do=Interpreter.test_alone, operand=macro)

    # -- O-words -------------------------------------------------------------------------------

    def _read_o_line(self, number: int, raw: str) -> None:
        """A line that begins with O. It may be the number of a program, alone or with a title."""
        # All dialects but GRBL have numbers of programs.
        if self._dialect.flow or self._dialect.open:
            self._end_lines(number)
            self._start = number + 1
        if self._dialect.flow:
            try:
                self._read_o_word(raw)
            except LineError as wrong:
                raise LineError(str(wrong), self.line) from wrong
        if program := _PROGRAM.match(raw):
            self.mark(f"o{int(program[1])}")

    def _read_o_word(self, raw: str) -> None:
        text = bare(raw)
        match = require(_O_WORD.fullmatch(text), LineError(f"cannot read the O-word {text[:16]!r}"))
        name, digits, expression, word, rest = match.groups()
        label = expression
        if not label:
            label = f"<{name}>" if name is not None else str(int(digits))
        o_word = OWord(label, word or "", rest)
        if rest and word in _ALONE:
            raise LineError(f"cannot read {rest[:12]!r} after o{label} {word}")
        if word:
            _O_WORDS[word](self, o_word)
        elif rest:
            what = f"cannot read {rest[:12]!r} after o{label}"
            self.add(Act(self.line, do=Interpreter.refuse, operand=what))

    def _open(self, o_word: OWord, first: Step) -> None:
        self.open(f"o{o_word.label} {o_word.word}", first)

    def _get_block(self, o_word: OWord, opener: str) -> Block:
        """The innermost block, which an O-word continues or ends. Raises LineError."""
        top = self.innermost
        if top is None or top.kind != f"o{o_word.label} {opener}":
            inside = f"; {top.kind} is open" if top else ""
            raise LineError(f"o{o_word.label} {o_word.word} has no {opener} before it{inside}")
        return top

    def _close(self, o_word: OWord, opener: str) -> Block:
        block = self._get_block(o_word, opener)
        self.blocks.pop()
        return block

    def _sub(self, o_word: OWord) -> None:
        self._open(o_word, Jump(self.line))
        if not self.mark(f"sub {o_word.label}"):
            raise LineError(f"o{o_word.label} sub is there twice")

    def _endsub(self, o_word: OWord) -> None:
        block = self._close(o_word, "sub")
        self.mark(f"endsub {o_word.label}")
        self._act(o_word)
        self.close(block)

    def _act(self, o_word: OWord) -> None:
        self.add(Act(self.line, do=_ACTS[o_word.word], operand=o_word))

    def _refuse_again(self, o_word: OWord) -> None:
        """Refuses a second block with one label in a subroutine.

        So does LinuxCNC, except for DO: the end of the second loop goes back to the first one.
        """
        scope = next((block.kind for block in self.blocks if block.kind.endswith(" sub")), "")
        if (scope, o_word.label) in self._labels:
            what = f"o{o_word.label} is the label of another block already"
            self.add(Act(self.line, do=Interpreter.refuse, operand=what))
        self._labels.add((scope, o_word.label))

    def _if(self, o_word: OWord) -> None:
        self._refuse_again(o_word)
        self.open_branch(f"o{o_word.label} if", Condition(o_word))

    def _elseif(self, o_word: OWord) -> None:
        block = self._get_block(o_word, "if")
        self.add_alternative(block)
        self.add_condition(block, Condition(o_word))

    def _else(self, o_word: OWord) -> None:
        self.add_alternative(self._get_block(o_word, "if"))

    def _while(self, o_word: OWord) -> None:
        top = self.innermost
        if top is not None and top.kind == f"o{o_word.label} do":
            self.close_loop(self.blocks.pop(), Condition(o_word))
        else:
            self._refuse_again(o_word)
            self._open(o_word, LoopStart(self.line, condition=Condition(o_word)))

    def _end_block(self, o_word: OWord) -> None:
        opener = o_word.word.removeprefix("end")
        _CLOSE[opener](self, self._close(o_word, opener))

    def _do(self, o_word: OWord) -> None:
        self._refuse_again(o_word)
        self._open(o_word, LoopStart(self.line))

    def _open_repeat(self, o_word: OWord) -> None:
        self._refuse_again(o_word)
        self._open(o_word, CountStart(self.line, count=o_word))

    def _leave_round(self, o_word: OWord) -> None:
        """Break and continue."""
        leave = self.exit if o_word.word == "break" else self.end_round
        if not leave([f"o{o_word.label} {word}" for word in _LOOPS]):
            raise LineError(f"o{o_word.label} {o_word.word} is not in such a loop")

    # -- macros --------------------------------------------------------------------------------

    def _find_macro(self, raw: str) -> re.Match[str] | None:
        """The word and the rest of a line of a macro, without blanks, in lower case."""
        text = drop_comments(raw, self._dialect.nested).translate(BLANKS).lower()
        return _MACRO.match(text.lstrip("/"))

    def _read_macro(self, rest: str, macro: Macro) -> None:
        """A line of a macro. Its condition and its numbers are read when it runs."""
        word = macro.word
        if word == "goto":
            self.add(Act(self.line, do=Interpreter.go, operand=macro))
        elif word == "if":
            block = self.open_branch(word, Condition(macro))
            self.add(Act(self.line, cost=0, do=Interpreter.go_on, operand=macro))
            self.blocks.pop()
            self.close(block)
        elif word == "end":
            self._end_loop(rest, macro)
        elif loop := _LOOP.fullmatch(word + rest):
            macro.number = loop[1].lstrip("0") or "0"
            self.open(f"DO {macro.number}", LoopStart(self.line, condition=Condition(macro)))
        else:
            self.add(Act(self.line, do=Interpreter.test_alone, operand=macro))

    def _end_loop(self, rest: str, macro: Macro) -> None:
        """END: the end of the innermost loop of its number."""
        macro.number = (rest.lstrip("0") or "0") if rest.isdigit() else ""
        for block in reversed(self.blocks):
            if block.kind == f"DO {macro.number}":
                self.blocks.remove(block)
                self.close_loop(block, Condition(macro))
                return
        self.add(Act(self.line, do=Interpreter.test_alone, operand=macro))


_ACTS = {
    "call": Interpreter.call,
    "return": Interpreter.come_back,
    "endsub": Interpreter.come_back,
}
#: The end of each block, by the word that opens it.
_CLOSE: dict[str, Callable[[Compiler, Block], None]] = {
    "if": Compiler.close,
    "while": Compiler.close_loop,
    "repeat": Compiler.close_count,
}
#: O-words that no value follows.
_ALONE = ("sub", "else", "endif", "endwhile", "do", "endrepeat", "break", "continue")
_O_WORDS: dict[str, Callable[[_Program, OWord], None]] = {
    "sub": _Program._sub,
    "endsub": _Program._endsub,
    "return": _Program._act,
    "call": _Program._act,
    "if": _Program._if,
    "elseif": _Program._elseif,
    "else": _Program._else,
    "endif": _Program._end_block,
    "while": _Program._while,
    "endwhile": _Program._end_block,
    "do": _Program._do,
    "repeat": _Program._open_repeat,
    "endrepeat": _Program._end_block,
    "break": _Program._leave_round,
    "continue": _Program._leave_round,
}
