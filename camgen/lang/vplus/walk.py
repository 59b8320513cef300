"""The run of V+ programs by the engine, as far as the strict run and that of others are alike."""

from __future__ import annotations

from typing import Protocol

from camgen.lang.code import Act, Step
from camgen.lang.flow import Language
from camgen.lang.run import Budget
from camgen.model.program import Instruction

from .text import Statement, Stretch, Unreadable


class Walker(Language, Protocol):
    """A run of programs.

    line: line of the instruction that is run.
    body: instructions in order.
    budget: steps that may still be taken. Each motion of a stretch takes one.
    """

    faults: type[Exception] = Unreadable
    line: int
    body: list[Instruction]
    budget: Budget

    def begin(self, step: Step) -> None:
        """Take note that a step runs now."""
        self.line = step.line

    def count_instructions(self) -> int:
        """Return the number of instructions so far."""
        return len(self.body)

    def act(self, statement: Statement) -> None:
        """Run an instruction that is not part of the flow."""

    def report(self, step: Step, error: Exception) -> None:
        """Add a finding for a step that cannot be run."""
        operand = getattr(step, "operand", None)
        word = operand.word if isinstance(operand, Statement) else ""
        self.add_fault(step.line, word, error)

    def add_fault(self, line: int, word: str, error: Exception) -> None:
        """Add a finding for an instruction that cannot be run. Its word is empty in the flow."""

    def try_stretch(self, plain: Stretch) -> bool:
        """Run all motions of a stretch. Return False, and run none, in an unusual state."""

    def run_stretch(self, plain: Stretch) -> None:
        """Run the motions of a stretch, one by one in an unusual state."""
        count = len(plain.poses)
        if count <= self.budget.left and self.try_stretch(plain):
            self.budget.spend(count)
            self.line = plain.line + count - 1
            return
        for number, raw in enumerate(plain.source.text.splitlines(), start=plain.line):
            statement = Statement(number, plain.word, raw.split()[1])
            step = Act(statement.line, do=Walker.act, operand=statement)
            self.begin(step)
            self.budget.spend()
            try:
                self.act(statement)
            except Unreadable as error:
                self.report(step, error)
