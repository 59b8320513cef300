"""Conditions of V+ programs, and waiting for them: what they rest on, and how inputs must be for them to hold."""

from __future__ import annotations

import re

from .locations import Expression
from .statements import Statements
from .text import Unreadable

_TIMER = re.compile(r"TIMER\s*\(([^()]*)\)\s*>=?\s*([^<>=]+)", re.IGNORECASE)


class Conditions(Statements):
    """What a test or a wait comes to."""

    def condition(self, rest: str, ends: tuple[str, ...]) -> tuple[bool, bool, str]:
        """Whether a condition holds, whether that rests on nothing but constants or on an assumption, and the word
        that ends it.
        """
        text = Expression(rest, self)
        value = text.logic()
        self.warn(text)
        word = text.peek()
        if ends and word not in ends:
            wanted = " or ".join(filter(None, ends))
            raise Unreadable(
                f"{wanted} expected before {word[:20] or 'the end of the line'}"
                if wanted
                else f"{word[:20]!r} is not expected here"
            )
        return value != 0, text.constant or self.doubt, word

    def wish(self, rest: str, wanted: bool, fresh: bool) -> bool:
        """Sets inputs so that a condition is as wanted; whether that works. fresh: only those not heard before."""
        asked = [n for n in self.consulted if not (fresh and n in self.inputs)][:16]
        tries = [[n] for n in asked] + ([asked] if len(asked) > 1 else [])
        for flipped in tries:
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

    def wait(self, rest: str) -> None:
        """``WAIT condition``: over at once, with the inputs as it wants them; a timer is waited for."""
        if not rest:
            return
        timer = _TIMER.fullmatch(rest)
        if timer:
            number, until = Expression(timer[1], self).logic(), Expression(timer[2], self).logic()
            self.pause(max(0.0, until - (self.clock - self.timers.get(number, 0.0))))
            return
        holds, open_, _ = self.condition(rest, ("",))
        if holds and not open_ and not self.consulted:
            return
        if holds and not self.doubt:
            self.log.find(
                "unusual",
                f"WAIT takes a condition, and {rest} is one that always holds: it does not wait",
            )
            return
        self.rest()
        # An input that was heard before has changed meanwhile.
        again = any(number in self.inputs for number in self.consulted)
        if not holds and (not self.wish(rest, True, fresh=False) or again):
            self.log.assume(f"WAIT {rest} is over at once")

    def wait_event(self, rest: str) -> None:
        """``WAIT.EVENT mask, seconds``: a dwell where it has seconds."""
        text = Expression(rest, self)
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
