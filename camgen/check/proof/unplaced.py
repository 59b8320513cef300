"""The motions of a text with an end of which the text states no pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.program import Columns, Instruction, Joints

#: Added to the largest error of a joint value, rad or mm: rounding of binary numbers.
_SLACK = 1e-9


class Unplaced(Struct, frozen=True):
    """Numbers of motions without a pose at their start or at their end.

    at_home: motions to or from the joint values of the rest position. The two are compared.
    elsewhere: motions to or from other joint values. They are not compared.
    begins: motions that begin a text: they start where the robot stands.
    """

    at_home: int = 0
    elsewhere: int = 0
    begins: int = 0

    def __add__(self, other: Unplaced) -> Unplaced:
        return Unplaced(
            self.at_home + other.at_home,
            self.elsewhere + other.elsewhere,
            self.begins + other.begins,
        )


def count_unplaced(body: Sequence[Instruction], home: Joints | None, error: float) -> Unplaced:
    """Counts the motions of a text without a pose at one of their ends.

    home: joint values of the rest position, rad or mm, None if they are not known.
    error: largest error of a joint value in the text, rad or mm.
    """
    columns = Columns(body)
    by_joints = np.isnan(columns.ends[:, 0])
    others = np.zeros(len(by_joints), np.bool_)
    rows = np.flatnonzero(by_joints)
    for row, motion in zip(rows.tolist(), columns.pick(columns.at[rows]), strict=True):
        others[row] = not _is_at(home, motion.target.values, error)
    unplaced, is_elsewhere = by_joints.copy(), others.copy()
    unplaced[1:] |= by_joints[:-1]
    is_elsewhere[1:] |= others[:-1]
    return Unplaced(
        at_home=int((unplaced & ~is_elsewhere).sum()),
        elsewhere=int(is_elsewhere.sum()),
        begins=int(len(unplaced) > 0 and not unplaced[0]),
    )


def _is_at(home: Joints | None, values: Sequence[float], error: float) -> bool:
    if home is None or len(home.values) != len(values):
        return False
    return bool(np.allclose(values, home.values, rtol=0.0, atol=error + _SLACK))
