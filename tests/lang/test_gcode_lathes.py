"""Cycles of lathes: the passes of G71 and G72, and G70 along the profile."""

import math

import pytest

from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import Executed, RunRequest
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support import canon
from tests.support.rs274 import needs_rs274

Place = tuple[float, float]


def moves(executed: Executed) -> list[tuple[str, float, float]]:
    """Kind, X and Z of the motions, without those that lead nowhere."""
    assert executed.stopped is None
    found: list[tuple[str, float, float]] = []
    for item in executed.body:
        if isinstance(item, MoveJ | MoveL | MoveC):
            x, _, z = item.target.origin
            if not found or math.dist(found[-1][1:], (x, z)) > 1e-6:
                found.append((type(item).__name__, round(x, 4), round(z, 4)))
    return found


def linuxcnc(cycle: str, profile: str) -> str:
    lines = "G21 G18 G90 G94 G8\nF100 S100 M3\no100 sub\n{}\no100 endsub\nG0 X20 Y0 Z2\n{}\nM2\n"
    return lines.format(profile, cycle)


STEPS = "G0 X10 Z2\nG1 Z-10\nX15 Z-15\nZ-20\nX20"


@needs_rs274
@pytest.mark.parametrize(
    ("cycle", "profile"),
    [
        ("G71 Q100 X20 Z2 D0 I2 R0.5", STEPS),
        ("G71 Q100 X20 Z2 D0 I1.7 R0.3", STEPS),
        ("G71.1 Q100 X20 Z2 D0 I4 R1\nG70 Q100 X20 Z2 D0", STEPS),
        ("G70 Q100 X20 Z2", STEPS),
        ("G72 Q100 X20 Z2 D0 I2 R0.5", "G0 X20 Z-10\nG1 X15\nX10 Z-5\nX5\nZ2"),
    ],
)
def test_passes_are_those_of_linuxcnc(cycle, profile):
    text = linuxcnc(cycle, profile)
    judge = canon.run(text)
    assert judge.error == ""
    theirs: list[tuple[str, float, float]] = []
    for call in judge.moves:
        kind, (x, _, z) = call.kind, call.end
        if not theirs or math.dist(theirs[-1][1:], (x, z)) > 1e-6:
            theirs.append(
                ("MoveJ" if kind == "STRAIGHT_TRAVERSE" else "MoveL", round(x, 4), round(z, 4))
            )
    assert moves(run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))) == theirs


FANUC = """\
%
O0001
G21 G18 G98 G0 X40. Z2.
G97 S900 M3
G71 U2. R0.5
G71 P10 Q20 U0.4 W0.1 F120.
N10 G0 X20.
G1 Z-10. F60.
N20 X40.
G70 P10 Q20
G0 X50. Z9.
M30
%
"""


def test_fanuc_roughs_between_two_numbers_and_goes_on_behind_them():
    """X are diameters. Passes of 2 mm of the radius to 0.2 and 0.1 mm off the profile, then along it; G70 finishes."""
    found = run_gcode({"a.nc": FANUC}, RunRequest("fanuc-lathe"))
    begin = ("MoveJ", 20.0, 2.0)
    passes = [
        row
        for x in (18.0, 16.0, 14.0, 12.0)
        for row in (
            ("MoveJ", x, 2.0), ("MoveL", x, -9.9), ("MoveJ", x + 0.5, -9.4), ("MoveJ", x + 0.5, 2.0),
        )
    ]  # fmt: skip
    along = [("MoveJ", 10.2, 2.1), ("MoveL", 10.2, -9.9), ("MoveL", 20.2, -9.9), begin]
    finish = [("MoveJ", 10.0, 2.0), ("MoveL", 10.0, -10.0), ("MoveL", 20.0, -10.0), begin]
    assert moves(found) == [begin, *passes, *along, *finish, ("MoveJ", 25.0, 9.0)]
    speeds = {
        line: item.speed
        for item, line in zip(found.body, found.lines, strict=True)
        if isinstance(item, MoveL)
    }
    assert speeds == {6: 2.0, 8: 1.0, 9: 1.0}
    assert any(
        "G71: passes to where each first meets the profile" in one.what for one in found.assumed
    )


def test_no_other_machine_runs_them():
    assert run_gcode({"a.nc": FANUC}, RunRequest("fanuc-lathe")).lost[0][1] == (
        "a program of a lathe: the part turns, which no machine here does"
    )
    lost = run_gcode({"a.nc": linuxcnc("G71 Q100", STEPS)}, RunRequest("linuxcnc")).lost
    assert lost == ((11, "G71 is of a lathe: the part turns"),)


def test_compensation_that_is_on_is_told():
    """LinuxCNC takes it; the profile is shown as programmed."""
    text = linuxcnc("G42.1 D1 L3\nG1 X30 Z5\nG70 Q100 X20 Z2\nG40", STEPS)
    found = run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))
    assert [one for one in found.findings if one.level == "refused"] == []
    assert moves(found)[-4:] == [
        ("MoveL", 10, -10),
        ("MoveL", 15, -15),
        ("MoveL", 15, -20),
        ("MoveL", 20, -20),
    ]
    assert any("the profile is run as programmed" in one.what for one in found.assumed)


def test_one_line_of_haas_has_the_depth_in_d():
    text = FANUC.replace("G71 U2. R0.5\n", "").replace("W0.1 F120.", "W0.1 D2. F120.")
    levels = [
        x
        for kind, x, z in moves(run_gcode({"a.nc": text}, RunRequest("fanuc-lathe")))
        if kind == "MoveL" and z == -9.9
    ]
    assert levels == [18, 16, 14, 12, 10.2, 20.2]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (linuxcnc("G71 X20 Z2", STEPS), "G71 without its profile (Q)"),
        (linuxcnc("G71 Q7", STEPS), "O7 is not in this file: the profile of the cycle"),
        (linuxcnc("G71 Q100", "M9"), "G71: the profile moves nothing"),
    ],
)
def test_cycles_that_are_none(text, what):
    found = run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))
    assert [(one.level, one.what) for one in found.findings] == [("refused", what)]
