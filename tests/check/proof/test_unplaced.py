"""Motions to and from joint values: the values of home are compared, others are counted."""

import math

import pytest

from camgen.check.proof.unplaced import Unplaced, count_unplaced
from camgen.model.pose import IDENTITY, Pose
from camgen.model.program import Instruction, Joints, MoveJ, MoveL, Output

HOME = Joints((0.0, 0.5, 0.0))
#: rad: half of the last digit of an angle with four decimals in deg.
ERROR = math.radians(0.00005)


def move_joints(*values: float) -> MoveJ:
    return MoveJ(Joints(values), 0.5)


POSE = Pose(IDENTITY, (10.0, 0.0, 20.0))
POSED, LINE = MoveJ(POSE, 0.5), MoveL(POSE, 10.0)
AT_HOME, AWAY = move_joints(*HOME.values), move_joints(0.1, 0.5, 0.0)


@pytest.mark.parametrize(
    ("body", "counts"),
    [
        # To home, from home to a pose, and back.
        ([AT_HOME, POSED, LINE, AT_HOME], Unplaced(at_home=3)),
        # The text begins with a pose; the position of the robot before it is unknown.
        ([POSED, LINE, LINE], Unplaced(begins=1)),
        ([LINE, AT_HOME], Unplaced(at_home=1, begins=1)),
        # A link passes other joint values, and a motion leads from them to the line.
        ([AT_HOME, POSED, AWAY, LINE], Unplaced(at_home=2, elsewhere=2)),
        # From home to other joint values and back: both are motions to or from these.
        ([AT_HOME, AWAY, AT_HOME], Unplaced(at_home=1, elsewhere=2)),
        ([Output("glue", 1.0)], Unplaced()),
    ],
)
def test_motions_to_and_from_joint_values_are_counted(
    body: list[Instruction], counts: Unplaced
) -> None:
    assert count_unplaced(body, HOME, ERROR) == counts


def test_home_is_compared_within_the_rounding_of_the_text() -> None:
    near = move_joints(0.9 * ERROR, 0.5, 0.0)
    far = move_joints(1.1 * ERROR, 0.5, 0.0)
    assert count_unplaced([near], HOME, ERROR).elsewhere == 0
    assert count_unplaced([far], HOME, ERROR).elsewhere == 1


@pytest.mark.parametrize("home", [None, Joints((0.0, 0.5))])
def test_nothing_is_compared_if_the_joint_values_of_home_are_unknown(home: Joints | None) -> None:
    assert count_unplaced([AT_HOME, POSED], home, ERROR) == Unplaced(elsewhere=2)
