"""Programs of tests for PacScript: their parts, their texts, and the comparison with a reading."""

import math

import numpy as np
import pytest
from camgen_posts.pacscript import PacScript

from camgen.lang.programs import Executed
from camgen.model.pose import TOOL_DOWN, Pose, pose_from_values, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
)
from camgen.post.plugins import make_post
from tests.support.whole import whole

HOME = Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0)))
WORK = pose_from_values((300.0, -75.0, 150.0, 0.0, 0.0, 90.0))
TOOL = translation(0.0, 0.0, 100.0)


def down(x: float, y: float = 0.0, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction, name: str = "bracket", header: tuple[str, ...] = ()) -> Program:
    return Program(
        name, WORK, TOOL, whole((MoveJ(HOME, 100.0), MoveJ(down(0, 0, 20), 100.0), *body)), header
    )


def print_text(plan: Program, **options: object) -> str:
    post = make_post(PacScript, options)
    (file,) = post.render(post.prepare(plan, 0.01))
    return file.text


def print_body(plan: Program, **options: object) -> list[str]:
    """The lines between the two motions with which `program` begins and GiveArm."""
    lines = [line.strip() for line in print_text(plan, **options).splitlines()]
    opening = [k for k, line in enumerate(lines) if line.startswith("Move P")]
    return lines[opening[1] + 1 : len(lines) - 1 - lines[::-1].index("GiveArm")]


def list_instructions(body: tuple[Instruction, ...]) -> list[Instruction]:
    return [item for item in body if not isinstance(item, Comment)]


def assert_same(planned: Program, reading: Executed, post: PacScript) -> None:
    """The reading has the instructions of `planned` within the tolerance that the post states."""
    limit = post.tolerance()
    assert reading.findings == ()
    assert len(reading.lines) == len(reading.body)
    for want, got in zip(list_instructions(planned.body), reading.body, strict=True):
        assert type(want) is type(got)
        if isinstance(want, (MoveJ, MoveL, MoveC)) and isinstance(got, (MoveJ, MoveL, MoveC)):
            assert_near(want.target, got.target, limit.mm, limit.angle, limit.joint)
            if not turn_of(want):  # a reorientation at a fixed TCP has no TCP speed
                assert got.speed == pytest.approx(want.speed, abs=limit.speed, rel=0)
            elif isinstance(got, MoveL):
                assert got.turn == pytest.approx(turn_of(want), abs=limit.turn, rel=0)
            assert (want.blend > 0) == (got.blend > 0)
        if isinstance(want, MoveC) and isinstance(got, MoveC):
            assert_near(want.via, got.via, limit.mm, limit.angle, limit.joint)
        if isinstance(want, (MoveL, MoveC)) and isinstance(got, (MoveL, MoveC)):
            assert np.multiply(want.force, want.force_direction) == pytest.approx(
                np.multiply(got.force, got.force_direction), abs=0.0105
            )
        if isinstance(want, Force) and isinstance(got, Force):
            assert np.multiply(want.newtons, want.force_direction) == pytest.approx(
                np.multiply(got.newtons, got.force_direction), abs=6e-4
            )
        if isinstance(want, Output):
            assert want == got
        if isinstance(want, Wait) and isinstance(got, Wait):
            assert got.seconds == pytest.approx(want.seconds, abs=5.1e-4, rel=0)


def turn_of(item: MoveJ | MoveL | MoveC) -> float:
    """The speed of a reorientation, rad/s; 0 for other motions."""
    return item.turn if isinstance(item, MoveL) else 0.0


def assert_near(
    want: Pose | Joints, got: Pose | Joints, mm: float, angle: float, joint: float
) -> None:
    if isinstance(want, Joints):
        assert isinstance(got, Joints)
        assert got.values == pytest.approx(want.values, abs=joint, rel=0)
    else:
        assert isinstance(got, Pose)
        assert got.origin == pytest.approx(want.origin, abs=mm, rel=0)
        # The Frobenius norm |A - B| of two rotations is 2 sqrt(2) sin(angle / 2).
        assert np.linalg.norm(want.rotation - got.rotation) / math.sqrt(2) <= angle


SMALL = """\
'!TITLE "bracket"
' camgen 0.1.0
' layer _holes_ M3
' work 1 must be set on the pendant to: 300.000, -75.000, 150.000, 0.0000, 0.0000, 90.0000 mm, deg
' tool 1 must be set on the pendant to: 0.000, 0.000, 100.000, 0.0000, 0.0000, 0.0000 mm, deg
' posture: fixed by the first joint move
' external speed: the pendant's, 100 % for the planned speeds
Sub Main
    TakeArm Keep = 0
    Reset IO[24]
    ' Mps() is a percentage: 0.1 m/s is over 0.5 % of any arm, 0.1 mm/s not over 0.1 %
    Dim unit As Single = 1
    If Mps(0.1) > 0.2 Then
        unit = 0.001
    End If
    ' now Mps(100 * unit) is 100 mm/s; no motion where that is not 0.5 to 20 %
    If Mps(100 * unit) < 0.5 Or Mps(100 * unit) > 20 Then
        GiveArm
        Exit Sub
    End If
    Speed 10
    Accel 50, 50
    ChangeTool 1
    ChangeWork 1
    Move P, @0 J(0.0000, 0.0000, 90.0000, 0.0000, 30.0000, 0.0000), Speed = Mps(100 * unit)
    Move P, @P P(12.500, 8.000, 20.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(100 * unit)
    Move L, @0 P(12.500, 8.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(20 * unit)
    ' contour c1
    Set IO[24]
    Delay 150
    Move L, @P P(52.500, 8.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(15.5 * unit)
    Move C, P(62.500, 18.000, 0.000, 180.0000, 0.0000, 0.0000, -1), \
@0 P(52.500, 28.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(20 * unit)
    Reset IO[24]
    Move L, @0 P(52.500, 28.000, 20.000, 180.0000, 0.0000, 90.0000, -1), Speed = Mps(100 * unit)
    GiveArm
End Sub
"""


def line_and_arc(radius: float, sweep: float, force: float = 0.0) -> tuple[MoveL, MoveC]:
    """A line to (0, 0), and an arc that starts there, anticlockwise about (-radius, 0)."""
    press = (1.0, 0.0, 0.0) if force else (0.0, 0.0, 0.0)
    via, end = (down(radius * (math.cos(a) - 1), radius * math.sin(a)) for a in (sweep / 2, sweep))
    return MoveL(down(0, 0), 20.0, 0.0, force, press), MoveC(via, end, 20.0, 0.0, force, press)


def force_program() -> Program:
    """A force of 10 N along +y that turns by 30 deg and falls to 8 N before the tool leaves."""
    turned = (-math.sin(math.radians(30)), math.cos(math.radians(30)), 0.0)
    return program(
        Force(10.0, (0.0, 1.0, 0.0)),
        MoveL(down(10, 0), 20.0, 1.0, 10.0, (0.0, 1.0, 0.0)),
        MoveL(down(20, 0), 20.0, 1.0, 10.0005, (0.0, 1.0, 0.0)),
        MoveL(down(30, 5), 20.0, 1.0, 8.0, turned),
        MoveL(down(40, 10), 20.0, 0.0),
        Force(0.0),
        MoveL(down(40, 10, 20), 100.0),
    )


#: Options of a template that a user writes for calls of a cell.
OWN_TEMPLATE = {
    "force": "template",
    "force_table": 4,
    "force_on": ["' our cell", "Call PressOn({n}, -({x}), -({y}), -({z}))", "Delay 200"],
    "force_change": ["Call PressTo({newtons}, {x}, {y}, {z})"],
    "force_off": ["Call  PressOff ' up"],
}
