"""Which way leads on, where a RAPID program asks what no text holds: one that moves and does not break off."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from .machine import Machine
from .motions import form_of
from .tree import (
    Block,
    Call,
    Expr,
    For,
    Goto,
    If,
    Inline,
    Negation,
    Operation,
    Ref,
    Routine,
    Statement,
    Test,
    While,
    Word,
)
from .values import Unknown, Value

#: Instructions after which a program does not go on as it should.
_BREAKS = frozenset(("stop", "exitcycle", "break", "systemstop", "systemstopaction", "errraise"))
_COMPARES = frozenset(("=", "<>", "<", "<=", ">", ">="))
_WORDS = frozenset(("raise", "exit", "return"))


@dataclass(eq=False)
class Ways:
    """What blocks and routines of a program do at all."""

    machine: Machine
    moving: dict[str, bool] = field(default_factory=dict)  # routines by name

    def choose(self, blocks: Sequence[Block]) -> int:
        """The place of the block that leads on: the first that moves and does not break off, or else the first that
        does something and does not break off; of those that all do, the first that only leaves its routine.
        """
        sound = [place for place, block in enumerate(blocks) if self.leads(block)]
        sound = sound or [place for place, block in enumerate(blocks) if self.survives(block)]
        for place in sound:
            if self.moves(blocks[place]):
                return place
        return next(
            (place for place in sound if blocks[place]), sound[0] if sound else len(blocks) - 1
        )

    def survives(self, block: Block) -> bool:
        """Whether a block leaves its routine at most."""
        return not any((isinstance(item, Word) and item.name in ("raise", "exit"))
                       or (isinstance(item, Call) and item.name in _BREAKS) for item in block)  # fmt: skip

    def leads(self, block: Block) -> bool:
        """Whether nothing in a block surely breaks the program off."""
        for item in block:
            if isinstance(item, Word) and item.name in _WORDS:
                return False
            if isinstance(item, Goto) or (isinstance(item, Call) and item.name in _BREAKS):
                return False
        return True

    def moves(self, block: Block) -> bool:
        """Whether a motion stands in a block or in what it calls."""
        return any(self._moves(item) for item in flat(block))

    def _moves(self, item: Statement) -> bool:
        if isinstance(item, Inline):
            return form_of(item.shape.name) is not None
        if not isinstance(item, Call):
            return False
        routine = self.machine.routine(item.name)
        return (
            self._routine_moves(routine) if routine is not None else form_of(item.name) is not None
        )

    def _routine_moves(self, routine: Routine) -> bool:
        key = routine.name.lower()
        if key not in self.moving:
            self.moving[key] = False  # of one that calls itself, until it is known
            if len(self.moving) < 5000:
                self.moving[key] = any(self._moves(item) for item in flat(routine.body))
        return self.moving[key]

    def escapes(self, block: Block) -> bool:
        """Whether something in a loop may leave it."""
        return any(isinstance(item, Goto) or (isinstance(item, Word) and item.name in _WORDS)
                   or (isinstance(item, Call) and item.name == "exitcycle") for item in flat(block))  # fmt: skip


def flat(block: Block) -> Iterator[Statement]:
    """All statements of a block, those within others among them."""
    pending: list[Iterable[Statement]] = [block]
    while pending:
        for item in pending.pop():
            yield item
            if isinstance(item, If):
                pending += [inner for _, inner in item.branches] + [item.otherwise or ()]
            elif isinstance(item, (For, While)):
                pending.append(item.body)
            elif isinstance(item, Test):
                pending += [inner for _, inner in item.cases] + [item.otherwise or ()]


def hint(machine: Machine, condition: Expr, unknown: Unknown, holds: bool) -> tuple[str, float]:
    """What the user may say so that a condition is otherwise: a key, and the value that was taken here."""
    expr = condition
    for _ in range(20):
        if isinstance(expr, Negation):
            holds, expr = not holds, expr.value
        elif isinstance(expr, Operation) and expr.sign in ("and", "or", "xor"):
            left = _plain(machine, expr.left)
            expr = expr.right if left is not None and not isinstance(left, Unknown) else expr.left
        else:
            break
    if not isinstance(expr, Operation) or expr.sign not in _COMPARES:
        return unknown.key, 1.0 if holds else 0.0
    sides = [_plain(machine, expr.left), _plain(machine, expr.right)]
    if any(isinstance(side, (str, tuple)) for side in sides):
        return "", 0.0
    number = next((float(v) for v in sides if type(v) in (float, bool)), 1.0)
    if expr.sign in ("=", "<>"):
        other = 1.0 - number if number in (0.0, 1.0) else number + 1.0
        return unknown.key, number if holds == (expr.sign == "=") else other
    more = (expr.sign in (">", ">=")) == holds
    if sides[0] is not None and not isinstance(sides[0], Unknown):  # the number stands on the left
        more = not more
    return unknown.key, number + 1.0 if more else number - 1.0


def _plain(machine: Machine, expr: Expr) -> Value:
    """What an expression is worth that calls nothing; None for others: to call again might do something again."""
    if isinstance(expr, (Ref, float, bool, str)):
        return machine.value(expr)
    return None
