"""V+ names: their canonical form, and the words that the language reserves.

Source: V+ Language User's Guide (names of at most 15 characters, no keywords), as far as
docs/posts/vplus.md quotes it.
"""

from __future__ import annotations

from functools import lru_cache

#: Number of characters by which names differ. V+ cuts the rest without a message.
NAME = 15
#: Instructions, functions and constants, which cannot be names of programs or variables.
TAKEN = frozenset(
    """
    ABORT ABOVE ABS ACCEL ALIGN ALTER ALWAYS AND ANY APPRO APPROS ATAN2 ATTACH AUTO BASE BELOW
    BRAKE BREAK BY CALIBRATE CALL CASE CLOSE CLOSEI COARSE COS CPOFF CPON DECOMPOSE DELAY DEPART
    DEPARTS DEST DETACH DISABLE DISTANCE DO DRIVE DURATION DX DY DZ ELSE ENABLE END EXECUTE EXIT
    FALSE FCLOSE FINE FLIP FOPEN FOR FRAME GLOBAL GOTO HALT HERE IF IGNORE INRANGE INT INVERSE
    LEFTY LOCAL MC MOD MOVE MOVES MOVEST MOVET MULTIPLE NEXT NOFLIP NONULL NOT NULL OFF ON OPEN
    OPENI OR PARAMETER PAUSE PI REACT REACTI READ READY RESET RETURN RETURNE RIGHTY RX RY RZ
    SCALE SELECT SET SHIFT SIG SIGNAL SIN SINGLE SPEED SQRT STATE STOP SWITCH TASK THEN TIME
    TIMER TO TOOL TRANS TRANSB TRUE TYPE UNTIL VALUE WAIT WAIT.EVENT WHILE WRITE XOR
    """.split()  # noqa: SIM905 (a table)
)


@lru_cache(maxsize=4096)
def canonical(name: str) -> str:
    """Return a name in lower case without its characters after the 15th.

    A prefix `#` or `$` and subscripts are kept.
    """
    bare, bracket, subscripts = name.lstrip("#$").partition("[")
    prefix = name[: len(name) - len(name.lstrip("#$"))]
    return f"{prefix}{bare[:NAME].lower()}{bracket}{subscripts}"
