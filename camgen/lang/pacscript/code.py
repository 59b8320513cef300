"""The statements of a procedure as a flat list with jumps, so that ``GoTo`` may go anywhere."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any

from msgspec import Struct

from camgen.lang.columns import Run
from camgen.lang.pacscript.effects import SILENT
from camgen.lang.pacscript.expressions import Node, arguments, parse
from camgen.lang.pacscript.plain import motions, plain
from camgen.lang.pacscript.source import Procedure, Say, Statement
from camgen.lang.pacscript.statements import (
    DECLARE,
    READERS,
    VERB,
    find_equals,
    read_call,
    read_case,
    read_condition,
    read_declarations,
)
from camgen.lang.pacscript.values import Unreadable
from camgen.lang.pacscript.words import RESERVED

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


class Op(Struct, gc=False):
    """A step. do: what to do; a, b: with what; to: where to go on, of jumps."""

    line: int
    do: str
    a: Any = None
    b: Any = None
    to: int = -1


class Code(Struct):
    """The steps of a procedure. labels: the step that each names, in small letters; moves: the lines on which something
    moves or is switched; ends: the lines that end the procedure.
    """

    ops: list[Op]
    labels: dict[str, int]
    #: By step, how many of those before it move the arm or switch an output.
    acting: list[int]
    #: The names that are given a value.
    assigned: frozenset[str]


class _Block(Struct):
    """A block that is open. start: its first step; leaving: jumps to its end."""

    kind: str
    start: int
    line: int
    leaving: list[Op]
    pending: Op | None = None
    cases: list[Any] = []


_ACTING = frozenset(("plain", "move", "approach", "depart", "draw", "drive", "drivea", "archmove", "rotate", "rotateh",
                     "switch", "call", "delay", "gohome"))  # fmt: skip


def compile_procedure(procedure: Procedure, say: Say, pac: bool) -> Code:
    """The steps of a procedure; what the language does not have so is said, and left out. pac: in the older dialect,
    which keeps other names.
    """
    compiler = _Compiler(say, pac)
    _read_statements(procedure.statements, compiler)
    for block in compiler.blocks:
        say(block.line, f"{_OPENS[block.kind]} has no {_CLOSES[block.kind]}")
        compiler.close(block)
    for op in compiler.ops:
        if op.do == "goto" and op.a:
            op.to = compiler.labels.get(op.a, -1)
            if op.to < 0:
                say(op.line, f"there is no label {op.a}")
    acting = [0]
    for op in compiler.ops:
        speaks = op.do == "call" and op.a.said == "msgbox"
        acting.append(acting[-1] + (op.do in _ACTING and not speaks))
    assigned = frozenset(
        str(op.a.said) for op in compiler.ops if op.do == "assign" and op.a.kind == "name"
    )
    return Code(compiler.ops, compiler.labels, acting, assigned)


def _read_statements(statements: Sequence[Statement], compiler: _Compiler) -> None:
    left = iter(statements)
    for piece in _MOTIONS.cut("".join(f"{statement.text}\n" for statement in statements)):
        if isinstance(piece, Run):
            for item, statement in zip(plain(piece, 0), islice(left, len(piece)), strict=True):
                compiler.line = statement.line
                compiler.add("plain", item)
        else:
            for statement in islice(left, piece.count("\n")):
                compiler.statement(statement.line, statement.text)


_OPENS = {
    "if": "If",
    "for": "For",
    "do": "Do",
    "while": "While",
    "select": "Select Case",
    "repeat": "Repeat",
}
_CLOSES = {
    "if": "End If", "for": "Next", "do": "Loop", "while": "Wend", "select": "End Select", "repeat": "Until",
}  # fmt: skip


class _Compiler:
    """The steps so far, the blocks that are open, and the labels."""

    def __init__(self, say: Say, pac: bool) -> None:
        self.say, self.pac = say, pac
        self.ops: list[Op] = []
        self.blocks: list[_Block] = []
        self.labels: dict[str, int] = {}
        self.line = 0

    def add(self, do: str, a: Any = None, b: Any = None, to: int = -1) -> Op:
        """Adds a step of the current line."""
        op = Op(self.line, do, a, b, to)
        self.ops.append(op)
        return op

    def statement(self, line: int, text: str) -> None:
        """A statement, or several with colons between them."""
        self.line = line
        if ".\\" in text or "./" in text:
            text = _PATH.sub(lambda match: match[1] or match[0], text)
        try:
            self._statement(text)
        except Unreadable as error:
            self.say(line, str(error)[:160])
        except RecursionError:
            self.say(line, "brackets nested too deep")

    def _statement(self, text: str) -> None:
        while text := text.strip():
            if (text[0] == "*" or ":" in text) and (label := _LABEL.fullmatch(text)):
                name = (label[1] or label[3]).lower()
                if label[1] or name not in RESERVED:
                    self.label(name)
                    text = label[2] or label[4] or ""
                    continue
            verb = VERB.match(text)
            word = verb[1].lower() if verb else ""
            if word == "if" or (word in ("else", "elseif") and verb):
                self.conditional(word, verb[2] if verb else "")
                return
            text, rest = _cut_colon(text) if ":" in text else (text, "")
            self.simple(text)
            text = rest

    def label(self, name: str) -> None:
        """A place to go to."""
        if name in self.labels:
            self.say(self.line, f"a second label {name}")
        self.labels.setdefault(name, len(self.ops))

    def simple(self, text: str) -> None:
        """A statement that is no condition."""
        verb = VERB.fullmatch(text)
        if verb is None:
            raise Unreadable(f"{text[:60]} is not understood")
        word, rest = verb[1].lower(), verb[2]
        if handler := _FLOW.get(word):
            handler(self, rest)
        elif reader := READERS.get(word):
            if op := reader(word, rest):
                self.add(*op)
        elif word in DECLARE:
            self.add("dim", read_declarations(word, rest, self.pac))
        elif word in SILENT:
            if rest.count('"') % 2:
                raise Unreadable("a text has no end")
        else:
            self.ordinary(text)

    def ordinary(self, text: str) -> None:
        """An assignment or a call."""
        at = find_equals(text)
        if at >= 0:
            target = parse(text[:at].strip())
            if target.kind not in ("name", "index", "call", "member", "element"):
                raise Unreadable(f"{text[:at].strip()[:40]} cannot be given a value")
            if target.kind == "name" and target.said in RESERVED and not self.pac:
                raise Unreadable(f"{target.said} is a word of the language")
            self.add("assign", target, parse(text[at + 1 :].strip()))
        else:
            target, values = read_call(text)
            raises = target.kind == "member" and (target.said, target.parts[0].said) == (
                "raise",
                "err",
            )
            self.add("raise" if raises else "call", target, values)

    # Blocks.

    def conditional(self, word: str, rest: str) -> None:
        """``If``, ``ElseIf`` or ``Else`` with what follows it."""
        if word == "else" and rest.lower().startswith("if "):
            word, rest = "elseif", rest[3:]
        if word == "if":
            self._if(rest)
            return
        block = self.blocks[-1] if self.blocks else None
        if block is None or block.kind != "if" or block.pending is None:
            raise Unreadable(f"{word.capitalize()} without If")
        block.leaving.append(self.add("goto"))
        block.pending.to, block.pending = len(self.ops), None
        if word == "elseif":
            found = _IF.fullmatch(rest)
            if found is None:
                raise Unreadable("ElseIf without Then")
            block.pending = self.add("if", parse(found[1].strip()))
            rest = found[3]
        if rest.strip():
            self._statement(rest.strip().removeprefix(":"))

    def _if(self, rest: str) -> None:
        found = _IF.fullmatch(rest)
        if found is None:
            raise Unreadable("If without Then")
        tail = found[3].strip()
        if found[2].lower() == "goto":
            tail = "goto " + tail
        branch = self.add("if", parse(found[1].strip()))
        block = _Block("if", len(self.ops) - 1, self.line, [], branch)
        self.blocks.append(block)
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
            block.leaving.append(self.add("goto"))
            branch.to, block.pending = len(self.ops), None
            self._branch(other)
        while self.blocks and self.blocks[-1] is not block:
            self.blocks.pop()
        if self.blocks:
            self.blocks.pop()
        self.close(block)

    def _branch(self, text: str) -> None:
        text = text.strip()
        if (goal := _GOAL.fullmatch(text)) and text.startswith("*"):
            self.add("goto", goal[1].lower())
        elif text:
            self._statement(text)

    def close(self, block: _Block) -> None:
        """Ends a block here."""
        if block.pending is not None:
            block.pending.to = len(self.ops)
        for op in block.leaving:
            op.to = len(self.ops)

    def end(self, *kinds: str) -> _Block:
        """The innermost block, which is one of ``kinds``."""
        if not self.blocks or self.blocks[-1].kind not in kinds:
            inner = f" inside {_OPENS[self.blocks[-1].kind]}" if self.blocks else ""
            raise Unreadable(f"{_CLOSES[kinds[0]]} without {_OPENS[kinds[0]]}{inner}")
        return self.blocks.pop()

    def end_word(self, rest: str) -> None:
        """``End If``, ``End Select``, or ``End``."""
        word = rest.strip().lower()
        if word in ("if", "select"):
            self.close(self.end(word))
        elif word == "while":
            self.wend("")
        elif word:
            raise Unreadable(f"End {rest[:40]} is not understood")
        else:
            self.add("end")

    def for_(self, rest: str) -> None:
        """``For i = a To b [Step c]``."""
        at = find_equals(rest)
        found = _FOR.fullmatch(rest[at + 1 :]) if at >= 0 else None
        if found is None:
            raise Unreadable("For needs a name, = and To")
        step = parse(found[3].strip()) if found[3] is not None else Node("number", 1.0)
        head = (parse(rest[:at].strip()), parse(found[1].strip()), parse(found[2].strip()), step)
        op = self.add("for", head)
        self.blocks.append(_Block("for", len(self.ops) - 1, self.line, [op]))

    def next_(self, _rest: str) -> None:
        """``Next [i]``."""
        block = self.end("for")
        self.add("next", to=block.start)
        self.close(block)

    def do(self, rest: str) -> None:
        """``Do [While|Until condition]``."""
        condition, sense = read_condition(rest)
        op = self.add("do", condition, sense)
        self.blocks.append(_Block("do", len(self.ops) - 1, self.line, [op]))

    def loop(self, rest: str) -> None:
        """``Loop [While|Until condition]``."""
        block = self.end("do")
        condition, sense = read_condition(rest)
        self.add("loop", condition, sense, block.start)
        self.close(block)

    def while_(self, rest: str) -> None:
        """``While condition``."""
        op = self.add("do", parse(rest), True)
        self.blocks.append(_Block("while", len(self.ops) - 1, self.line, [op]))

    def wend(self, _rest: str) -> None:
        """``Wend``."""
        block = self.end("while")
        self.add("loop", to=block.start)
        self.close(block)

    def repeat(self, _rest: str) -> None:
        """``Repeat`` of the older dialect."""
        self.blocks.append(_Block("repeat", len(self.ops), self.line, [self.add("do")]))

    def until(self, rest: str) -> None:
        """``Until condition``."""
        block = self.end("repeat")
        self.add("loop", parse(rest), False, block.start)
        self.close(block)

    def select(self, rest: str) -> None:
        """``Select Case value``."""
        match = VERB.fullmatch(rest)
        if match is None or match[1].lower() != "case":
            raise Unreadable("Select without Case")
        op = self.add("select", parse(match[2]), [])
        self.blocks.append(_Block("select", len(self.ops) - 1, self.line, [op], cases=op.b))

    def case(self, rest: str) -> None:
        """``Case value, a To b, Is > c`` or ``Case Else``."""
        block = self.blocks[-1] if self.blocks else None
        if block is None or block.kind != "select":
            raise Unreadable("Case without Select Case")
        if len(self.ops) > block.start + 1:
            block.leaving.append(self.add("goto"))
        other = rest.strip().lower() == "else"
        block.cases.append(
            (None if other else [read_case(part) for part in arguments(rest)], len(self.ops))
        )

    def exit(self, rest: str) -> None:
        """``Exit Sub|Function|For|Do|Loop``."""
        word = rest.strip().lower()
        if word in ("sub", "function", "program"):
            self.add("exit")
            return
        kinds = {
            "for": ("for",),
            "do": ("do", "while", "repeat"),
            "loop": ("do", "while", "repeat"),
            "while": ("while",),
        }
        for block in reversed(self.blocks):
            if block.kind in kinds.get(word, ()):
                block.leaving.append(self.add("goto", b="exit"))
                return
        raise Unreadable(f"Exit {rest[:20]} outside such a block")

    def goto(self, rest: str) -> None:
        """``GoTo label``."""
        goal = _GOAL.fullmatch(rest.strip())
        if goal is None:
            raise Unreadable(f"GoTo {rest[:40]} is not understood")
        self.add("goto", goal[1].lower())

    def gosub(self, rest: str) -> None:
        """``GoSub label``."""
        goal = _GOAL.fullmatch(rest.strip())
        if goal is None:
            raise Unreadable(f"GoSub {rest[:40]} is not understood")
        self.add("gosub", goal[1].lower())

    def on(self, rest: str) -> None:
        """``On Error GoTo label`` or ``On n GoTo a, b``."""
        found = re.fullmatch(r"(.*?)\b(goto|gosub)\b(.*)", rest, re.IGNORECASE | re.DOTALL)
        if rest.lower().startswith("error"):
            goal = _GOAL.fullmatch(found[3].strip()) if found else None
            self.add("on error", goal[1].lower() if goal else "")
            return
        if found is None:
            raise Unreadable("On needs GoTo or GoSub")
        goals = [goal[1].lower() for part in arguments(found[3]) if (goal := _GOAL.fullmatch(part))]
        self.add("on", parse(found[1].strip()), (found[2].lower(), goals))


def _cut_colon(text: str) -> tuple[str, str]:
    """A statement, and what follows it behind a colon."""
    depth = 0
    for match in _COLON.finditer(text):
        if match[0] == ":" and depth == 0:
            return text[: match.start()].strip(), text[match.end() :]
        depth += (match[0] in ("(", "[")) - (match[0] in (")", "]"))
    return text, ""


_FLOW: dict[str, Callable[[_Compiler, str], object]] = {
    "end": _Compiler.end_word,
    "endif": lambda compiler, _rest: compiler.end_word("if"),
    "for": _Compiler.for_,
    "next": _Compiler.next_,
    "do": _Compiler.do,
    "loop": _Compiler.loop,
    "while": _Compiler.while_,
    "wend": _Compiler.wend,
    "repeat": _Compiler.repeat,
    "until": _Compiler.until,
    "select": _Compiler.select,
    "case": _Compiler.case,
    "exit": _Compiler.exit,
    "goto": _Compiler.goto,
    "gosub": _Compiler.gosub,
    "on": _Compiler.on,
    "return": lambda compiler, _rest: compiler.add("return"),
    "resume": lambda compiler, _rest: compiler.add("exit"),
}


_MOTIONS = motions(
    lambda mark: mark.strip()[1:] or "0",
    lambda speed: parse(speed.partition("=")[2].strip()) if speed else None,
)
