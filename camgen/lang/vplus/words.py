"""What V+ instructions that are no motions say: speeds, outputs, dwells.

Each function reads a whole text; Unreadable where it does not fit.
"""

from __future__ import annotations

from .locations import Expression
from .text import Impossible, Unreadable

_INCH = 25.4


def real(text: Expression) -> float:
    """A number alone."""
    value = text.real()
    text.finish()
    return value


def reals(text: Expression) -> list[float]:
    """Numbers with commas between them; one that is missing is 0."""
    values = text.reals()
    text.finish()
    return values


def speed(text: Expression) -> tuple[float, str, float, bool]:
    """The value of a SPEED, its unit (%, mm/s or MONITOR), the rotational speed in %, 100 where it says none, and
    whether it holds for more than one motion.
    """
    value = text.real()
    turning = text.real() if text.accept(",") else 100.0
    if turning <= 0:
        raise Impossible("a rotational speed must be positive")
    words = []
    while text.peek():
        words.append(text.take())
    units = [w for w in words if w != "ALWAYS"]
    if (
        len(units) > 1
        or len(set(words)) < len(words)
        or not set(words) <= {"ALWAYS", "MMPS", "IPS", "MONITOR"}
    ):
        raise Unreadable(f"SPEED cannot end with {' '.join(words)[:40]}")
    if value <= 0:
        raise Impossible("a speed must be positive")
    scale, unit = _UNITS[units[0] if units else ""]
    return value * scale, unit, turning, "ALWAYS" in words


_UNITS = {
    "": (1.0, "%"),
    "MMPS": (1.0, "mm/s"),
    "IPS": (_INCH, "mm/s"),
    "MONITOR": (1.0, "MONITOR"),
}


#: Outputs are 1 to 1000, inputs 1001 to 2000, soft signals the rest.
_MOST_SIGNAL = 9999


def outputs(text: Expression) -> list[float]:
    """The numbers of a SIGNAL, negative: off."""
    values = reals(text)
    for value in values:
        number = abs(value)
        if number != int(number) or number == 0 or 1000 < number <= 2000 or number > _MOST_SIGNAL:
            raise Impossible(f"{value:g} is no output")
    return values


def dwell(text: Expression) -> float:
    """Seconds."""
    seconds = real(text)
    if seconds <= 0:
        raise Impossible("a dwell must be positive")
    return seconds


def event(text: Expression) -> float:
    """The seconds of a ``WAIT.EVENT , s``."""
    if not text.accept(","):
        raise Unreadable("WAIT.EVENT with an event is not evaluated")
    return dwell(text)
