"""Conditions of V+ programs, waits for them, and the inputs with which they hold."""

from __future__ import annotations

import re

from .locations import Expression
from .statements import Statements
from .text import Statement, Unreadable

_TIMER = re.compile(r"TIMER\s*\(([^()]*)\)\s*>=?\s*([^<>=]+)", re.IGNORECASE)


class Conditions(Statements):
    """Evaluates tests and waits."""

    def condition(self, rest: str, ends: tuple[str, ...]) -> tuple[bool, bool]:
        """Evaluate a condition.

        Returns whether it holds, and whether its value is constant or assumed.

        ends: words of which one must follow; "" is the end of the line.
        """
        text = Expression(rest, self)
        value = text.logic()
        self.warn(text)
        word = text.peek()
        if ends and word not in ends:
            wanted = " or ".join(filter(None, ends))
            if not wanted:
                raise Unreadable(f"{word[:20]!r} is not expected here")
            raise Unreadable(f"{wanted} expected before {word[:20] or 'the end of the line'}")
        return value != 0, text.constant or self.doubt

    def change_inputs(self, rest: str, wanted: bool, fresh: bool) -> bool:
        """Set inputs so that a condition has the value `wanted`. Returns whether that was possible.

        fresh: only inputs that were not read before may change.
        """
        changeable = [n for n in self.consulted if not (fresh and n in self.inputs)][:16]
        attempts = [[n] for n in changeable]
        if len(changeable) > 1:
            attempts.append(changeable)
        for flipped in attempts:
            before = {n: self.inputs.get(n) for n in flipped}
            for n in flipped:
                self.inputs[n] = not before[n]
            if (Expression(rest, self).logic() != 0) == wanted:
                return True
            for n, value in before.items():
                if value is None:
                    del self.inputs[n]
                else:
                    self.inputs[n] = value
        return False

    def wait(self, statement: Statement) -> None:
        """Run `WAIT condition`: a dwell for a timer, else no time, with inputs that meet it."""
        rest = statement.rest
        if not rest:
            return
        timer = _TIMER.fullmatch(rest)
        if timer:
            number, until = Expression(timer[1], self).logic(), Expression(timer[2], self).logic()
            self.pause(max(0.0, until - (self.clock - self.timers.get(number, 0.0))))
            return
        holds, open_ = self.condition(rest, ("",))
        if holds and not open_ and not self.consulted:
            return
        if holds and not self.doubt:
            what = f"WAIT takes a condition, and {rest} is one that always holds: it does not wait"
            self.log.find("unusual", what)
            return
        self.rest()
        # An input that was read before must have changed in the meantime.
        again = any(number in self.inputs for number in self.consulted)
        if not holds and (not self.change_inputs(rest, True, fresh=False) or again):
            self.log.assume(f"WAIT {rest} is over at once")

    def wait_event(self, statement: Statement) -> None:
        """Run `WAIT.EVENT mask, seconds`: a dwell if it has seconds."""
        text = Expression(statement.rest, self)
        if text.peek() not in (",", ""):
            text.logic()
        if text.accept(","):
            seconds = text.logic()
            text.finish()
            self.pause(seconds)
            return
        text.finish()
        self.rest()
        self.log.assume("WAIT.EVENT is over at once")
