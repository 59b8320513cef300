"""The grammar of a procedure: its statements as the steps of the engine."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

from msgspec import Struct

from camgen.lang.code import (
    Act,
    Block,
    Call,
    Code,
    Compiler,
    Condition,
    CountStart,
    Effect,
    End,
    Handle,
    JumpTable,
    LoopStart,
    Raise,
    Return,
    Select,
)
from camgen.lang.columns import Run
from camgen.lang.pacscript.effects import SILENT
from camgen.lang.pacscript.expressions import Node, arguments, parse
from camgen.lang.pacscript.lines import FaultCallback
from camgen.lang.pacscript.motions import run_motions
from camgen.lang.pacscript.orders import Assignment, Calling, declare
from camgen.lang.pacscript.plain import list_motions
from camgen.lang.pacscript.source import Procedure
from camgen.lang.pacscript.statements import (
    ASSIGN,
    CALL,
    DECLARE,
    ORDERS,
    VERB,
    Order,
    find_equals,
    find_outside,
    make_condition,
    read_call,
    read_case,
    read_declarations,
    read_list,
    read_loop_condition,
)
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import RESERVED
from camgen.lang.values import require

_LABEL = re.compile(
    r"\*\s*([a-z_]\w*)\s*:?\s*(.*)|([a-z_]\w*)\s*:(?!=)\s*(.*)", re.IGNORECASE | re.DOTALL
)
_COLON = re.compile(r'"[^"]*"|[()\[\]]|:')
_IF = re.compile(r'((?:[^"]|"[^"]*")*?)\b(then|goto)\b(.*)', re.IGNORECASE | re.DOTALL)
_ELSE = re.compile(r'"[^"]*"|\belse\b', re.IGNORECASE)
_FOR = re.compile(r"(.*?)\bto\b(.*?)(?:\bstep\b(.*))?", re.IGNORECASE | re.DOTALL)
_GOAL = re.compile(r"\*?\s*([a-z_]\w*)", re.IGNORECASE)
#: A program in another folder: its name is what counts.
_PATH = re.compile(r'"[^"]*"|(?<![\w.])(?:\.{1,2}[\\/]+)(?:\w+[\\/]+|\.\.[\\/]+)*(\w+)')


class ProcedureCode(Struct):
    """The steps of a procedure. assigned: names that it gives a value somewhere."""

    code: Code
    assigned: frozenset[str]


def compile_procedure(procedure: Procedure, report: FaultCallback, pac: bool) -> ProcedureCode:
    """Compile a procedure. Statements with a fault are reported and left out.

    report: called with line and text of a fault.
    pac: the text is in the older dialect, which reserves other names.
    """
    compiler = _Compiler(report, pac, procedure.returns == "program")
    for line, text in procedure.statements:
        if isinstance(text, Run):
            compiler.add(make_motions(line, text))
        else:
            compiler.statement(line, text)
    compiler.close_down_to(0)
    code = compiler.finish()
    for jump in compiler.list_missing():
        report(jump.line, f"there is no label {jump.label}")
    return ProcedureCode(code, frozenset(compiler.assigned))


def make_motions(line: int, run: Run) -> Act:
    """The step of motions in the usual spelling. Each of them takes a step of the budget."""
    motions = list_motions(run, line)
    lines = len(motions)
    return Act(line, cost=0, do=run_motions, operand=motions, effect=Effect.MOVES, lines=lines)


_OPENS = {
    "if": "If",
    "for": "For",
    "do": "Do",
    "while": "While",
    "select": "Select Case",
    "repeat": "Repeat",
}
_CLOSES = {
    "if": "End If",
    "for": "Next",
    "do": "Loop",
    "while": "Wend",
    "select": "End Select",
    "repeat": "Until",
}


class CountRange(NamedTuple):
    """``For counter = first To last [Step step]``."""

    counter: Node
    first: Node
    last: Node
    step: Node


class _Compiler(Compiler):
    """The grammar of the statements that make the flow of a procedure.

    pac: whether the older dialect is read.
    is_program: whether the procedure is a PROGRAM, which a call of it may end.
    """

    def __init__(self, report: FaultCallback, pac: bool, is_program: bool) -> None:
        super().__init__()
        self.add_fault, self.pac, self.is_program = report, pac, is_program
        self.assigned: set[str] = set()

    def act(self, order: Order, operand: Any) -> None:
        """Adds a step that the tables of the statements carry out."""
        if isinstance(operand, Assignment) and operand.target.kind == "name":
            self.assigned.add(str(operand.target.content))
        speaks = isinstance(operand, Calling) and operand.target.content == "msgbox"
        effect = Effect.NONE if speaks else order.effect
        self.add(Act(self.line, do=order.do, operand=operand, effect=effect))

    def statement(self, line: int, text: str) -> None:
        """A statement, or several with colons between them."""
        self.line = line
        if ".\\" in text or "./" in text:
            text = _PATH.sub(lambda match: match[1] or match[0], text)
        try:
            self._statement(text)
        except Unreadable as error:
            self.add_fault(line, str(error)[:160])
        except RecursionError:
            self.add_fault(line, "brackets nested too deep")

    def _statement(self, text: str) -> None:
        while text := text.strip():
            if (text[0] == "*" or ":" in text) and (label := _LABEL.fullmatch(text)):
                name = (label[1] or label[3]).lower()
                if label[1] or name not in RESERVED:
                    if not self.mark(name):
                        self.add_fault(self.line, f"a second label {name}")
                    text = label[2] or label[4] or ""
                    continue
            verb = VERB.match(text)
            if verb and verb[1].lower() in ("if", "else", "elseif"):
                self.conditional(verb[1].lower(), verb[2])
                return
            colon = find_outside(_COLON, text, ":") if ":" in text else -1
            end = len(text) if colon < 0 else colon
            self.simple(text[:end].strip())
            text = text[end + 1 :]

    def simple(self, text: str) -> None:
        """A statement that is not a condition."""
        verb = require(VERB.fullmatch(text), Unreadable(f"{text[:60]} is not understood"))
        word, rest = verb[1].lower(), verb[2]
        if handler := _FLOW.get(word):
            handler(self, rest)
        elif order := ORDERS.get(word):
            self.act(order, order.read(rest))
        elif word in DECLARE:
            self.add(Act(self.line, do=declare, operand=read_declarations(word, rest, self.pac)))
        elif word in SILENT:
            if rest.count('"') % 2:
                raise Unreadable("a text has no end")
        else:
            self.ordinary(text)

    def ordinary(self, text: str) -> None:
        """An assignment or a call."""
        at = find_equals(text)
        if at < 0:
            self.call(read_call(text))
            return
        target = parse(text[:at].strip())
        if target.kind not in ("name", "index", "call", "member", "element"):
            raise Unreadable(f"{text[:at].strip()[:40]} cannot be given a value")
        if target.kind == "name" and target.content in RESERVED and not self.pac:
            raise Unreadable(f"{target.content} is a word of the language")
        self.act(ASSIGN, Assignment(target, parse(text[at + 1 :].strip())))

    def call(self, calling: Calling) -> None:
        """A call, or a member of ``Err`` that raises an error."""
        target = calling.target
        if target.kind == "member" and (target.content, target.parts[0].content) == (
            "raise",
            "err",
        ):
            self.add(Raise(self.line))
        else:
            self.act(CALL, calling)

    # Blocks.

    def conditional(self, word: str, rest: str) -> None:
        """Compile `If`, `ElseIf` or `Else` with the rest of its line."""
        if word == "else" and rest.lower().startswith("if "):
            word, rest = "elseif", rest[3:]
        if word == "if":
            self._if(rest)
            return
        block = self.innermost
        if block is None or block.kind != "if" or block.pending is None:
            raise Unreadable(f"{word.capitalize()} without If")
        self.add_alternative(block)
        if word == "elseif":
            match = require(_IF.fullmatch(rest), Unreadable("ElseIf without Then"))
            self.add_condition(block, make_condition(parse(match[1].strip())))
            rest = match[3]
        if rest.strip():
            self._statement(rest.strip().removeprefix(":"))

    def _if(self, rest: str) -> None:
        match = require(_IF.fullmatch(rest), Unreadable("If without Then"))
        tail = match[3].strip()
        if match[2].lower() == "goto":
            tail = "goto " + tail
        block = self.open_branch("if", make_condition(parse(match[1].strip())))
        if not tail:
            return
        cut = next((m for m in _ELSE.finditer(tail) if m[0][0] != '"'), None)
        then, other = (
            (tail[: cut.start()], tail[cut.end() :])
            if cut and not tail.lower().startswith("if ")
            else (tail, "")
        )
        self._branch(then)
        if other.strip():
            self.add_alternative(block)
            self._branch(other)
        if block in self.blocks:
            self.close_down_to(self.blocks.index(block) + 1)
            self.blocks.pop()
        self.close(block)

    def _branch(self, text: str) -> None:
        text = text.strip()
        if (goal := _GOAL.fullmatch(text)) and text.startswith("*"):
            self.jump(goal[1].lower())
        elif text:
            self._statement(text)

    def close_down_to(self, count: int) -> None:
        """Close all blocks except the first `count`; each one is a fault."""
        for block in self.blocks[count:]:
            self.add_fault(block.line, f"{_OPENS[block.kind]} has no {_CLOSES[block.kind]}")
            self.close(block)
        del self.blocks[count:]

    def end(self, *kinds: str) -> Block:
        """Take the innermost block, which must be one of `kinds`."""
        if not self.blocks or self.blocks[-1].kind not in kinds:
            inner = f" inside {_OPENS[self.blocks[-1].kind]}" if self.blocks else ""
            raise Unreadable(f"{_CLOSES[kinds[0]]} without {_OPENS[kinds[0]]}{inner}")
        return self.blocks.pop()

    def end_word(self, rest: str) -> None:
        """Compile `End If`, `End Select` or `End`."""
        word = rest.strip().lower()
        if word in ("if", "select"):
            self.close(self.end(word))
        elif word == "while":
            self.close_loop(self.end("while"))
        elif word:
            raise Unreadable(f"End {rest[:40]} is not understood")
        else:
            self.add(Return(self.line) if self.is_program else End(self.line))

    def for_(self, rest: str) -> None:
        """Compile `For i = a To b [Step c]`."""
        at = find_equals(rest)
        match = _FOR.fullmatch(rest[at + 1 :]) if at >= 0 else None
        if match is None:
            raise Unreadable("For needs a name, = and To")
        step = parse(match[3].strip()) if match[3] is not None else Node("number", 1.0)
        counter, first, last = (parse(text.strip()) for text in (rest[:at], match[1], match[2]))
        self.open("for", CountStart(self.line, count=CountRange(counter, first, last, step)))

    def start_loop(self, kind: str, condition: Condition | None) -> None:
        """Compile the start of a loop without a count."""
        self.open(kind, LoopStart(self.line, condition=condition))

    def select(self, rest: str) -> None:
        """``Select Case value``."""
        match = VERB.fullmatch(rest)
        if match is None or match[1].lower() != "case":
            raise Unreadable("Select without Case")
        self.open("select", Select(self.line, value=parse(match[2]), cases=[]))

    def case(self, rest: str) -> None:
        """``Case value, a To b, Is > c`` or ``Case Else``."""
        block = self.innermost
        if block is None or block.kind != "select":
            raise Unreadable("Case without Select Case")
        self.end_case(block)
        is_other = rest.strip().lower() == "else"
        tests = None if is_other else [read_case(part) for part in arguments(rest)]
        self.add_case(block, tests)

    def leave(self, rest: str) -> None:
        """``Exit Sub|Function|For|Do|Loop``."""
        word = rest.strip().lower()
        if word in ("sub", "function", "program"):
            self.add(Return(self.line))
            return
        kinds = {
            "for": ("for",),
            "do": ("do", "while", "repeat"),
            "loop": ("do", "while", "repeat"),
            "while": ("while",),
        }
        if not self.exit(kinds.get(word, ())):
            raise Unreadable(f"Exit {rest[:20]} outside such a block")

    def on(self, rest: str) -> None:
        """``On Error GoTo label`` or ``On n GoTo a, b``."""
        match = re.fullmatch(r"(.*?)\b(goto|gosub)\b(.*)", rest, re.IGNORECASE | re.DOTALL)
        if rest.lower().startswith("error"):
            goal = _GOAL.fullmatch(match[3].strip()) if match else None
            self.add(Handle(self.line, label=goal[1].lower() if goal else ""))
            return
        if match is None:
            raise Unreadable("On needs GoTo or GoSub")
        goals = [_GOAL.fullmatch(part) for part in arguments(match[3])]
        labels = [goal[1].lower() for goal in goals if goal]
        value, is_call = parse(match[1].strip()), match[2].lower() == "gosub"
        self.add(JumpTable(self.line, value=value, labels=labels, is_call=is_call))

    def stop(self, rest: str) -> None:
        """``Stop`` and ``StopEnd``."""
        read_list(rest)
        self.add(End(self.line))


def _read_goal(rest: str, word: str) -> str:
    reason = Unreadable(f"{word} {rest[:40]} is not understood")
    return require(_GOAL.fullmatch(rest.strip()), reason)[1].lower()


_FLOW: dict[str, Callable[[_Compiler, str], object]] = {
    "end": _Compiler.end_word,
    "endif": lambda compiler, _rest: compiler.end_word("if"),
    "for": _Compiler.for_,
    "next": lambda compiler, _rest: compiler.close_count(compiler.end("for")),
    "do": lambda compiler, rest: compiler.start_loop("do", read_loop_condition(rest)),
    "loop": lambda compiler, rest: compiler.close_loop(
        compiler.end("do"), read_loop_condition(rest)
    ),
    "while": lambda compiler, rest: compiler.start_loop("while", make_condition(parse(rest))),
    "wend": lambda compiler, _rest: compiler.close_loop(compiler.end("while")),
    "repeat": lambda compiler, _rest: compiler.start_loop("repeat", None),
    "until": lambda compiler, rest: compiler.close_loop(
        compiler.end("repeat"), make_condition(parse(rest), wanted=False)
    ),
    "select": _Compiler.select,
    "case": _Compiler.case,
    "exit": _Compiler.leave,
    "goto": lambda compiler, rest: compiler.jump(_read_goal(rest, "GoTo")),
    "gosub": lambda compiler, rest: compiler.add(
        Call(compiler.line, label=_read_goal(rest, "GoSub"))
    ),
    "on": _Compiler.on,
    "return": lambda compiler, _rest: compiler.add(Return(compiler.line, is_to_call=True)),
    "resume": lambda compiler, _rest: compiler.add(Return(compiler.line)),
    "stop": _Compiler.stop,
    "stopend": _Compiler.stop,
}
