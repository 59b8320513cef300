"""Words of V+ instructions with a method that runs them; all others are in `effects.py`.

Source: V+ Language Reference Guide, keywords (docs/languages/vplus.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from .arm import POSTURES
from .robot import Robot
from .text import Statement

#: They set a reaction of the program to a signal or an error.
REACTIONS = frozenset({"REACT", "REACTE", "REACTI"})

DOES: Mapping[str, Callable[[Robot, Statement], None]] = {
    "ALIGN": Robot.move_external, "APPRO": Robot.appro, "APPROS": Robot.appro, "BASE": Robot.base,
    "BITS": Robot.set_bits, "BRAKE": Robot.brake, "BREAK": Robot.brake, "CPOFF": Robot.path,
    "CPON": Robot.path, "DECOMPOSE": Robot.decompose, "DELAY": Robot.delay,
    "DEPART": Robot.depart, "DEPARTS": Robot.depart, "DISABLE": Robot.switch,
    "DRIVE": Robot.drive, "DURATION": Robot.duration, "ENABLE": Robot.switch,
    "JMOVE": Robot.jmove, "MOVE": Robot.move, "MOVES": Robot.move, "MOVEST": Robot.move,
    "MOVET": Robot.move, "NEST": Robot.move_external, "PAUSE": Robot.stop,
    "READY": Robot.move_external,
    "RESET": Robot.reset, "SIGNAL": Robot.signal, "SPEED": Robot.speed, "TOOL": Robot.set_tool,
    **dict.fromkeys(POSTURES, Robot.configure),
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), Robot.set_accuracy),
    **dict.fromkeys(("CLOSE", "CLOSEI", "OPEN", "OPENI", "RELAX", "RELAXI"), Robot.hand),
}  # fmt: skip
#: Motions: if one cannot be read, the pose of the robot is not known after it.
MOTIONS = frozenset(
    """ALIGN APPRO APPROS DEPART DEPARTS DRIVE JMOVE MOVE MOVES MOVEST MOVET NEST READY
    """.split()  # noqa: SIM905 (a table)
)
