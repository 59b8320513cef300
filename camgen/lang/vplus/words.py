"""Parses operands of V+ instructions: speeds, outputs, dwells.

Each function parses a whole text, and raises Unreadable if it does not fit.
"""

from __future__ import annotations

from .locations import Expression
from .text import Impossible, Unreadable

_INCH = 25.4


def parse_real(text: Expression) -> float:
    """Parse a single number."""
    value = text.real()
    text.finish()
    return value


def parse_reals(text: Expression) -> list[float]:
    """Parse numbers with commas between them; a missing one is 0."""
    values = text.reals()
    text.finish()
    return values


def parse_speed(text: Expression) -> tuple[float, str, float, bool]:
    """Parse a SPEED.

    Returns its value, its unit (%, mm/s or MONITOR), the rotational speed in % (100 if it is
    missing), and whether the setting holds for more than one motion.
    """
    value = text.real()
    turning = text.after(",", text.real, 100.0)
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


#: Largest signal. Outputs are 1 to 1000, inputs 1001 to 2000, soft signals the rest.
_MAX_SIGNAL = 9999


def parse_outputs(text: Expression) -> list[float]:
    """Parse the numbers of a SIGNAL, which are negative to switch off."""
    values = parse_reals(text)
    for value in values:
        number = abs(value)
        if number != int(number) or number == 0 or 1000 < number <= 2000 or number > _MAX_SIGNAL:
            raise Impossible(f"{value:g} is not an output")
    return values


def parse_dwell(text: Expression) -> float:
    """Parse the seconds of a dwell."""
    seconds = parse_real(text)
    if seconds <= 0:
        raise Impossible("a dwell must be positive")
    return seconds


def parse_event(text: Expression) -> float:
    """Parse the seconds of `WAIT.EVENT , s`."""
    if not text.accept(","):
        raise Unreadable("WAIT.EVENT with an event is not evaluated")
    return parse_dwell(text)
