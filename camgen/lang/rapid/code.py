"""The routines of RAPID modules as the steps of the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from msgspec import Struct

from camgen.lang.code import (
    Act,
    Code,
    Compiler,
    Condition,
    CountStart,
    Effect,
    End,
    Handle,
    LoopStart,
    Raise,
    Resume,
    Return,
    Select,
)

from .motions import find_form
from .tokens import Wrong
from .tree import (
    Block,
    Calling,
    Empty,
    Expr,
    For,
    Goto,
    If,
    Inline,
    Label,
    Routine,
    Statement,
    Test,
    While,
    Word,
    list_statements,
)
from .values import Value, Variable

#: Instructions after which the rest of a block is not meant to run.
_BREAKS = frozenset(
    ("stop", "exitcycle", "break", "systemstop", "systemstopaction", "errraise", "raisetouser")
)
#: Label of the ERROR handler. No label of a program has a blank.
_HANDLER = "error handler"

#: Carries out a statement. It gets the run and the statement.
Do = Callable[[Any, Any], object]
#: Finds the routine that a name in lower case means in a routine.
Find = Callable[[Routine, str], Routine | None]


class Question(Struct, frozen=True, gc=False):
    """A condition.

    value: its expression.
    word: IF or WHILE.
    """

    value: Expr
    word: str


class LoopVariable(Struct, gc=False):
    """The variable of a FOR that runs. An assignment to it in the loop changes no round.

    variable: variable that the loop sees.
    value: value of this round.
    """

    variable: Variable
    value: Value


class CountRange(Struct, frozen=True):
    """FOR, and the number of FORs around it."""

    loop: For
    around: int


def compile_routines(routines: Iterable[Routine], do: Do, find: Find) -> dict[Routine, Code]:
    """Return the steps of routines. A call of a routine that moves is a step that moves."""
    compilers = {routine: _Translator(routine, do) for routine in routines}
    callers: dict[Routine, list[tuple[Routine, Act]]] = {}
    moving: list[Routine] = []
    for routine, compiler in compilers.items():
        for call in compiler.calls:
            called = find(routine, call.operand.name)
            if called is None:
                call.effect = _find_effect(call.operand.name)
            else:
                callers.setdefault(called, []).append((routine, call))
        if compiler.moves():
            moving.append(routine)
    while moving:
        for caller, call in callers.pop(moving.pop(), ()):
            is_new = not compilers[caller].moves()
            call.effect = Effect.MOVES
            if is_new and compilers[caller].moves():
                moving.append(caller)
    return {routine: compiler.finish() for routine, compiler in compilers.items()}


def list_called(code: Code) -> Iterator[str]:
    """Return the names of the routines and instructions that a routine calls, in lower case."""
    for step in code.steps:
        if isinstance(step, Act) and isinstance(step.operand, Calling):
            yield step.operand.name


def moves(code: Code) -> bool:
    """Return whether a routine moves the robot, its ERROR handler aside."""
    return code.acts(range(code.labels.get(_HANDLER, len(code.steps))))


def _find_effect(name: str) -> Effect:
    if find_form(name) is not None:
        return Effect.MOVES
    return Effect.LEAVES if name in _BREAKS else Effect.NONE


class _Translator(Compiler):
    """Translates the statements of a routine in order.

    calls: steps that call a routine or an instruction.
    """

    def __init__(self, routine: Routine, do: Do) -> None:
        super().__init__()
        self.calls: list[Act] = []
        self._has_motion = False
        self._body_calls: list[Act] = []
        self._do = do
        self._counters = 0
        self._is_handler = False
        #: For each open block the labels in it: name among all labels, and number of FORs around.
        self._scopes: list[dict[str, tuple[str, int]]] = []
        self._names = 0
        has_handler = routine.handler is not None
        self.line = routine.line
        if has_handler:
            self._set_handler()
        self._read(routine.body, stays_open=True)
        if routine.handler is not None:
            self.line = routine.last or routine.line
            self.add(Return(self.line, cost=0))
            self.mark(_HANDLER)
            self._body_calls = self.calls.copy()
            self._is_handler = True
            self.add(Handle(self.line, cost=0, label=""))
            self._read(routine.handler)
            self.add(Raise(self.line, is_again=True))

    def moves(self) -> bool:
        """Return whether the body of the routine moves, as far as is known now."""
        calls = self._body_calls if self._is_handler else self.calls
        self._has_motion |= any(call.effect is Effect.MOVES for call in calls)
        return self._has_motion

    def _set_handler(self) -> None:
        self.add(Handle(self.line, cost=0, label=_HANDLER))

    def _read(self, block: Block, *, stays_open: bool = False) -> None:
        """Translate a block. stays_open: whether later blocks see its labels."""
        labels = {}
        statements = list(list_statements(block))
        for item in statements:
            if isinstance(item, Label):
                self._names += 1
                labels[item.name] = f"{item.name} {self._names}", self._counters
        self._scopes.append(labels)
        for item in statements:
            self.line = item.line
            _TRANSLATE.get(type(item), _Translator._act)(self, item)
        if not stays_open:
            self._scopes.pop()

    def _act(self, item: Statement) -> None:
        self.add(Act(item.line, do=self._do, operand=item))

    def _call(self, item: Calling) -> None:
        self.calls.append(self.add(Act(item.line, do=self._do, operand=item)))

    def _inline(self, item: Inline) -> None:
        self._has_motion |= not self._is_handler
        self.add(Act(item.line, do=self._do, operand=item, effect=Effect.MOVES))

    def _empty(self, item: Empty) -> None:
        self._refuse(f"{item.text}: a place that is not filled in; the controller stops there")

    def _refuse(self, what: str) -> None:
        self.add(Act(self.line, do=refuse, operand=what))

    # -- blocks --------------------------------------------------------------------------------

    def _if(self, item: If) -> None:
        (first, body), *others = item.branches
        is_idle = not body and bool(others or item.otherwise)
        block = self.open_branch("if", Condition(Question(first, "IF"), is_unlikely=is_idle))
        self._read(body)
        for condition, other in others:
            self.line = item.line
            self.add_alternative(block)
            self.add_condition(block, Condition(Question(condition, "IF")))
            self._read(other)
        if item.otherwise is not None:
            self.add_alternative(block)
            self._read(item.otherwise)
        self.close(self.blocks.pop())

    def _for(self, item: For) -> None:
        around = self._counters
        self.open("for", CountStart(item.line, count=CountRange(item, around)))
        self._counters += 1
        self._read(item.body)
        self._counters = around
        self.line = item.line
        self.close_count(self.blocks.pop())
        self._drop_counters(around)

    def _drop_counters(self, count: int) -> None:
        self.add(Act(self.line, cost=0, do=_drop_counters, operand=count))

    def _while(self, item: While) -> None:
        condition = None
        if item.condition is not True:
            condition = Condition(Question(item.condition, "WHILE"))
        self.open("while", LoopStart(item.line, condition=condition))
        self._read(item.body)
        self.line = item.line
        self.close_loop(self.blocks.pop())

    def _test(self, item: Test) -> None:
        block = self.open("test", Select(item.line, value=item.value, cases=[]))
        cases: list[tuple[Any, Block]] = list(item.cases)
        if item.otherwise is not None:
            cases.append((None, item.otherwise))
        for tests, body in cases:
            self.end_case(block)
            self.add_case(block, tests)
            self._read(body)
        self.close(self.blocks.pop())

    # -- jumps ---------------------------------------------------------------------------------

    def _label(self, item: Label) -> None:
        self.mark(self._scopes[-1][item.name][0])
        self.add(Act(item.line, do=_do_nothing, operand=item))

    def _goto(self, item: Goto) -> None:
        for depth, labels in reversed(list(enumerate(self._scopes))):
            if item.name in labels:
                label, counters = labels[item.name]
                if self._counters > counters or self._is_handler:
                    self._drop_counters(counters)
                if self._is_handler and depth == 0:
                    self._set_handler()
                self.jump(label)
                return
        self._refuse(f"GOTO {item.name[:40]}: there is no such label where it could go to")
        self.add(Return(item.line))

    def _word(self, item: Word) -> None:
        """RETURN, RAISE, RETRY, TRYNEXT or EXIT."""
        if item.name == "exit":
            self.add(End(item.line))
        elif item.name == "return":
            if item.value is not None:
                self._act(item)
            self.add(Return(item.line))
        elif item.name == "raise":
            if item.value is not None:
                self.add(Act(item.line, do=self._do, operand=item, effect=Effect.LEAVES))
            else:
                self.add(Raise(item.line, is_again=self._is_handler))
        elif self._is_handler:
            self._set_handler()
            self.add(Resume(item.line, is_again=item.name == "retry"))
        else:
            self._refuse(f"{item.name.upper()} outside of an error handler")


def refuse(run: Any, what: str) -> None:
    """Report a statement that no controller can carry out."""
    raise Wrong(run.machine.line, what)


def _drop_counters(run: Any, count: int) -> None:
    run.machine.scope.drop_counters(count)


def _do_nothing(_run: Any, _operand: object) -> None:
    """A label only marks a place."""


_TRANSLATE: Mapping[type[Any], Callable[[_Translator, Any], None]] = {
    Calling: _Translator._call,
    Inline: _Translator._inline,
    Empty: _Translator._empty,
    If: _Translator._if,
    For: _Translator._for,
    While: _Translator._while,
    Test: _Translator._test,
    Label: _Translator._label,
    Goto: _Translator._goto,
    Word: _Translator._word,
}
