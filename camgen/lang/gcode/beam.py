"""The beam of a laser under GRBL's laser mode: when it is on, and with what power.

Source: GRBL 1.1, doc/markdown/laser_mode.md. With $32=1 the beam is on in the motion modes G1, G2
and G3 alone. M3 keeps it on while the machine stands; M4 has it on during motions alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from camgen.model.program import Instruction, MoveC, MoveL, Output, Wait

_LASER_MODE = re.compile(r"^[ \t]*\$32[ \t]*=[ \t]*1\b", re.MULTILINE)
_WORKING_MODES = ("G1", "G2", "G3")


def sets_laser_mode(text: str) -> bool:
    """Whether a text sets GRBL's laser mode."""
    return _LASER_MODE.search(text) is not None


@dataclass(slots=True)
class Beam:
    """The output of a beam in laser mode.

    signal: name of the output.
    level: its last value.
    """

    signal: str
    level: float = 0.0

    def before(self, item: Instruction, power: float, spindle: str, mode: str) -> Output | None:
        """The output before an instruction, None for no change.

        power: value of S, or 1 for a program that only switches.
        spindle: M3, M4 or M5.
        mode: the motion code in force.
        """
        if isinstance(item, Output):
            return None
        if isinstance(item, MoveL | MoveC):
            return self._set(power if spindle != "M5" else 0.0)
        if isinstance(item, Wait):
            return self.at_rest(power, spindle, mode)
        return self._set(0.0)

    def at_rest(self, power: float, spindle: str, mode: str) -> Output | None:
        """The output while the machine stands, None for no change."""
        if spindle == "M3" and mode in _WORKING_MODES:
            return self._set(power)
        return self._set(0.0)

    def _set(self, level: float) -> Output | None:
        if level == self.level:
            return None
        self.level = level
        return Output(self.signal, level)
