"""Cycles of lathes: the passes of G71 and G72, and G70 along the profile."""

import math
from collections.abc import Iterable

import pytest

from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import Executed, RunRequest
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support import canon
from tests.support.rs274 import needs_rs274

Row = tuple[str, float, float]


def skip_repeats(rows: Iterable[Row]) -> list[Row]:
    """Rows of kind, X and Z in mm, rounded, without those that stay at the position before them."""
    moved: list[Row] = []
    for kind, x, z in rows:
        if not moved or math.dist(moved[-1][1:], (x, z)) > 1e-6:
            moved.append((kind, round(x, 4), round(z, 4)))
    return moved


def list_moves(executed: Executed) -> list[Row]:
    """The motions as rows of kind, X and Z in mm."""
    assert executed.stopped is None
    motions = [item for item in executed.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return skip_repeats(
        (type(motion).__name__, motion.target.origin[0], motion.target.origin[2])
        for motion in motions
    )


def make_linuxcnc_program(cycle: str, profile: str) -> str:
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
def test_the_passes_of_a_cycle_are_those_of_linuxcnc(cycle, profile):
    text = make_linuxcnc_program(cycle, profile)
    reference = canon.run(text)
    assert reference.error == ""
    kinds = {"STRAIGHT_TRAVERSE": "MoveJ"}
    expected = skip_repeats(
        (kinds.get(call.kind, "MoveL"), call.end[0], call.end[2]) for call in reference.moves
    )
    assert list_moves(run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))) == expected


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


def test_fanuc_roughs_the_profile_between_two_numbers_and_continues_after_it():
    """Passes of 2 mm leave 0.2 and 0.1 mm, one pass follows the profile there, G70 finishes it.

    Words X are diameters, motions have radii.
    """
    executed = run_gcode({"a.nc": FANUC}, RunRequest("fanuc-lathe"))
    start = ("MoveJ", 20.0, 2.0)
    passes = []
    for x in (18.0, 16.0, 14.0, 12.0):
        passes += [("MoveJ", x, 2.0), ("MoveL", x, -9.9)]
        passes += [("MoveJ", x + 0.5, -9.4), ("MoveJ", x + 0.5, 2.0)]
    along = [("MoveJ", 10.2, 2.1), ("MoveL", 10.2, -9.9), ("MoveL", 20.2, -9.9), start]
    finish = [("MoveJ", 10.0, 2.0), ("MoveL", 10.0, -10.0), ("MoveL", 20.0, -10.0), start]
    assert list_moves(executed) == [start, *passes, *along, *finish, ("MoveJ", 25.0, 9.0)]
    speeds = {
        line: item.speed
        for item, line in zip(executed.body, executed.lines, strict=True)
        if isinstance(item, MoveL)
    }
    assert speeds == {6: 2.0, 8: 1.0, 9: 1.0}
    assert any(
        "G71: passes to where each first meets the profile" in assumption.what
        for assumption in executed.assumed
    )


def test_a_cycle_of_a_lathe_is_a_loss():
    assert run_gcode({"a.nc": FANUC}, RunRequest("fanuc-lathe")).lost[0][1] == (
        "a program of a lathe: the part turns, which no machine here does"
    )
    lost = run_gcode(
        {"a.nc": make_linuxcnc_program("G71 Q100", STEPS)}, RunRequest("linuxcnc")
    ).lost
    assert lost == ((11, "G71 is of a lathe: the part turns"),)


def test_compensation_along_a_profile_is_an_assumption():
    """LinuxCNC accepts it; here the profile is run as programmed."""
    text = make_linuxcnc_program("G42.1 D1 L3\nG1 X30 Z5\nG70 Q100 X20 Z2\nG40", STEPS)
    executed = run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))
    assert [finding for finding in executed.findings if finding.level == "refused"] == []
    assert list_moves(executed)[-4:] == [
        ("MoveL", 10, -10),
        ("MoveL", 15, -15),
        ("MoveL", 15, -20),
        ("MoveL", 20, -20),
    ]
    assert any(
        "the profile is run as programmed" in assumption.what for assumption in executed.assumed
    )


def test_haas_has_the_depth_of_a_pass_in_d():
    text = FANUC.replace("G71 U2. R0.5\n", "").replace("W0.1 F120.", "W0.1 D2. F120.")
    moves = list_moves(run_gcode({"a.nc": text}, RunRequest("fanuc-lathe")))
    radii = [x for kind, x, z in moves if kind == "MoveL" and z == -9.9]
    assert radii == [18, 16, 14, 12, 10.2, 20.2]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (make_linuxcnc_program("G71 X20 Z2", STEPS), "G71 without its profile (Q)"),
        (
            make_linuxcnc_program("G71 Q7", STEPS),
            "O7 is not in this file: the profile of the cycle",
        ),
        (make_linuxcnc_program("G71 Q100", "M9"), "G71: the profile moves nothing"),
    ],
)
def test_a_cycle_without_a_profile_is_refused(text, what):
    executed = run_gcode({"a.ngc": text}, RunRequest("linuxcnc"))
    assert [(finding.level, finding.what) for finding in executed.findings] == [("refused", what)]
