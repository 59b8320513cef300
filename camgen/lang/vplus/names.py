"""V+ names: what counts of them, and which words are taken.

Source: V+ Language User's Guide (names of at most 15 characters, no keywords), as far as docs/posts/vplus.md quotes it.
"""

from __future__ import annotations

from functools import lru_cache

#: Names are told apart by so many characters; the rest is cut silently.
NAME = 15
#: Instructions, functions and constants that the language has: none of them names a program or a variable.
TAKEN = frozenset(
    """ABORT ABOVE ABS ACCEL ALIGN ALTER ALWAYS AND ANY APPRO APPROS ATAN2 ATTACH AUTO BASE BELOW BRAKE BREAK BY
    CALIBRATE CALL CASE CLOSE CLOSEI COARSE COS CPOFF CPON DECOMPOSE DELAY DEPART DEPARTS DEST DETACH DISABLE
    DISTANCE DO DRIVE DURATION DX DY DZ ELSE ENABLE END EXECUTE EXIT FALSE FCLOSE FINE FLIP FOPEN FOR FRAME GLOBAL
    GOTO HALT HERE IF IGNORE INRANGE INT INVERSE LEFTY LOCAL MC MOD MOVE MOVES MOVEST MOVET MULTIPLE NEXT NOFLIP
    NONULL NOT NULL OFF ON OPEN OPENI OR PARAMETER PAUSE PI REACT REACTI READ READY RESET RETURN RETURNE RIGHTY RX
    RY RZ SCALE SELECT SET SHIFT SIG SIGNAL SIN SINGLE SPEED SQRT STATE STOP SWITCH TASK THEN TIME TIMER TO TOOL
    TRANS TRANSB TRUE TYPE UNTIL VALUE WAIT WAIT.EVENT WHILE WRITE XOR
    """.split()  # noqa: SIM905 (a table)
)


@lru_cache(maxsize=4096)
def canonical(name: str) -> str:
    """The name as V+ keeps it: case does not count, nor what follows the 15th character. A ``#`` or ``$`` stays, and so
    do subscripts.
    """
    bare, bracket, subscripts = name.lstrip("#$").partition("[")
    return f"{name[: len(name) - len(name.lstrip('#$'))]}{bare[:NAME].lower()}{bracket}{subscripts}"
