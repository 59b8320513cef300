"""RAPID at the limits of its controller: motions that the post splits or refuses, and findings."""

import math

import numpy as np
import pytest
from camgen_posts.rapid.force import arc_fault, find_round

from camgen.model.errors import Refused
from camgen.model.pose import IDENTITY, TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import Force, Joints, MoveC, MoveJ, MoveL
from tests.post.changes.rapid import CALIBRATE, PRESS, PRESSED, PROGRAMS, VIA, at, sample


def test_an_arc_that_is_a_point_to_the_controller_is_a_remark() -> None:
    cut = PROGRAMS["cut"]
    text = cut.change(VIA, "MoveC [[0.040,0.020,0.000]").replace("[[10.000,", "[[0.080,")
    remarks = [fault.what for fault in cut.list_faults(text) if fault.level == "unusual"]
    assert remarks == ["the points of an arc are less than 0.1 mm apart"]


def test_a_routine_that_does_not_raise_an_error_again_is_a_remark() -> None:
    cut = PROGRAMS["cut"]
    routine = "\n    PROC sub()\n        WaitTime 1;\n    ENDPROC\nENDMODULE"
    text = cut.change("        MoveJ ", "        sub;\n        MoveJ ")
    faults = cut.list_faults(text.replace("\nENDMODULE", routine))
    what = "sub has no ERROR handler that hands an error on to main"
    assert [fault.what for fault in faults] == [what]


@pytest.mark.parametrize(
    ("load", "heavier"),
    [("lTool", "lOther"), ("[1.2,[0,0,60],[1,0,0,0],0,0,0]", "[1.3,[0,0,60],[1,0,0,0],0,0,0]")],
)
def test_a_calibration_has_the_load_of_the_options(load: str, heavier: str) -> None:
    pressed = sample(PRESSED, {"force_load": load})
    assert pressed.faults_after(f"FCCalib {load};", f"FCCalib {heavier};")


def test_the_length_of_a_string_counts_an_escape_as_one_character() -> None:
    """Escapes are two quotes, two backslashes, or a backslash with two digits (kernel manual)."""
    for sign in ('""', "\\\\", "\\0A"):
        for count, is_long in ((80, False), (81, True)):
            faults = PROGRAMS["cut"].faults_after('TRUE,"",', f'TRUE,"{sign * count}",')
            assert any("characters; a controller takes 80" in what for what in faults) == is_long


def test_the_post_refuses_a_rotation_whose_sense_is_open() -> None:
    flip = (MoveJ(at(0, 0, 20), 100.0), MoveL(Pose(IDENTITY, (9, 0, 20)), 20.0))
    with pytest.raises(
        Refused, match="the tool turns by 180 deg in one straight motion and its sense is open"
    ) as caught:
        _ = sample(flip).text
    assert caught.value.index == 2
    nearly = Pose(frozen(rotation_about(0, math.radians(179)) @ TOOL_DOWN), (9, 0, 20))
    assert sample((flip[0], MoveL(nearly, 20.0), MoveJ(at(9, 0, 20), 20.0))).text


def test_the_post_refuses_joint_values_beyond_any_arm() -> None:
    with pytest.raises(
        Refused, match="an axis at 630 deg, which arms do not turn to; give 450 at most"
    ):
        _ = sample((MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.0, math.radians(630))), 50.0),)).text


def test_an_arc_that_is_flat_by_its_digits_becomes_lines() -> None:
    """The angle between circle point and end is 1.26 deg as planned, and 0.98 deg as printed."""
    start, via, end = (
        at(3.18159, -1.3925, -3.4127),
        at(3.25727, -1.19126, -3.41748),
        at(3.3266, -0.98769, -3.4156),
    )
    body = (MoveJ(start, 50.0), MoveC(via, end, 20.0))
    assert "MoveC" not in sample(body).text
    assert "MoveC" in sample(body, {"decimals": 5}).text


def test_each_planned_calibration_is_required() -> None:
    """A second section has one too, unless the tool stays low before it."""
    twice = PROGRAMS["twice"]
    assert twice.text.count("FCCalib lTool;") == 2
    start, _, end = twice.text.rpartition(CALIBRATE)
    what = "no FCCalib before pressing, though post.force_load asks for it"
    assert [fault.what for fault in twice.list_faults(start + end)] == [what]
    again = (
        MoveL(at(0, 0, 0.5), 20.0),
        Force(9.0, PRESS),
        MoveL(at(20, 0), 20.0, 0.0, 9.0, PRESS),
        Force(0.0),
    )
    low = (*PRESSED[:-1], MoveL(at(30, 0, 0.5), 20.0), *again, MoveL(at(20, 0, 30), 20.0))
    assert sample(low, {"force_load": "lTool"}).text.count("FCCalib lTool;") == 1


def test_an_arc_whose_circle_point_is_near_an_end_is_split() -> None:
    """The manual advises against it, so it would be a remark of the read-back."""
    start, via, end = at(0, 0), at(377, 0, 58), at(451, 0, 121)
    halved = sample((MoveJ(start, 50.0), MoveC(via, end, 20.0)), {"decimals": 0})
    assert halved.text.count("MoveC") == 2


def test_an_arc_that_is_legal_by_column_is_legal_singly() -> None:
    rng = np.random.default_rng(5)
    start = rng.normal(size=(4000, 3)) * 10.0 ** rng.uniform(-2, 3, (4000, 1))
    along, across = rng.normal(size=(2, 4000, 3))
    across -= along * ((across * along).sum(axis=1) / (along**2).sum(axis=1))[:, None]
    along, across = (v / np.linalg.norm(v, axis=1)[:, None] for v in (along, across))
    radius = 10.0 ** rng.uniform(-1.5, 3, (4000, 1))
    sweep = rng.uniform(0.03, 2.4, (4000, 1))
    part = sweep * rng.uniform(0.1, 0.9, (4000, 1))
    via, end = (
        start + radius * (np.sin(t) * along + (1 - np.cos(t)) * across) for t in (part, sweep)
    )
    points = [list(map(tuple, column.tolist())) for column in (start, via, end)]
    legal = np.array([not arc_fault(*arc, 3) for arc in zip(*points, strict=True)])
    by_column = find_round(start, via, end, 3)
    assert not (by_column & ~legal).any()
    assert np.count_nonzero(by_column) > 0.99 * np.count_nonzero(legal) > 500
