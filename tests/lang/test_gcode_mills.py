"""Words of mills that not all controllers have: rotated coordinates, modal macros, circular pockets."""

import math

import pytest

from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import Executed, RunRequest
from camgen.model.program import MoveC, MoveJ, MoveL

LEAD = "G21 G90 G17 G94 G0 X0 Y0 Z5\nF600.\n"


def run(text: str, dialect: str = "fanuc", **given: float) -> Executed:
    return run_gcode({"a.nc": LEAD + text + "\nM30\n"}, RunRequest(dialect, given))


def ends(executed: Executed) -> list[tuple[float, ...]]:
    """Where the motions behind the lead end."""
    assert executed.stopped is None
    assert not [one for one in executed.findings if one.level == "refused"]
    moves = [item for item in executed.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return [tuple(round(value, 6) + 0.0 for value in item.target.origin) for item in moves[1:]]


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("fanuc", "G68 X10. Y0 R90.\nG1 X20. Y0\nX30.\nG69\nX0"),
        ("iso", "G68 X10. Y0 R90.\nG1 X20. Y0\nX30.\nG69 X0"),
        ("mach3", "G68 A10 B0 R90\nG1 X20 Y0\nX30\nG69\nX0"),
        ("mach3", "G68 A10 B0 R60\nG68 A10 B0 I1 R30\nG1 X20 Y0\nX30\nG69\nX0"),
    ],
)
def test_coordinates_turn_about_the_centre(dialect, text):
    """By a quarter about (10, 0): 10 mm along X become 10 mm along Y."""
    assert ends(run(text, dialect)) == [(10, 10, 5), (10, 20, 5), (0, 20, 5)]


def test_increments_turn_with_them_whatever_the_centre():
    assert ends(run("G68 X99. Y99. R90.\nG91 G1 X4.\nY2.\nG69\nX1.")) == [
        (0, 4, 5),
        (-2, 4, 5),
        (-1, 4, 5),
    ]


def test_arcs_and_holes_turn_too():
    found = run("G68 X0 Y0 R90.\nG1 X10. Y0\nG3 X0 Y10. I-10. J0\nG0 Z1.\nG81 X5. Y0 Z-1. R1.\nG80")
    arc = next(item for item in found.body if isinstance(item, MoveC))
    half = math.sqrt(0.5) * 10
    assert arc.via.origin == pytest.approx((-half, half, 5))
    assert arc.target.origin == pytest.approx((-10, 0, 5), abs=1e-9)
    assert ends(found)[-3:] == [(0, 5, 1), (0, 5, -1), (0, 5, 1)]


def test_without_a_centre_they_turn_about_the_tool():
    assert ends(run("G1 X10. Y5.\nG68 R180.\nG1 X12. Y5.")) == [(10, 5, 5), (8, 5, 5)]


def test_an_angle_of_the_machine_is_told_and_lost_to_others():
    found = run("G68 X0 Y0\nG1 X9.")
    assert found.lost == ((3, "G68 without R: the angle is the machine's, deg"),)
    assert run("G68 X0 Y0\nG1 X9.", **{"g68.r": 90.0}).lost == ()


def test_linuxcnc_has_no_rotation():
    assert (
        next(one.what for one in run("G68 X0 Y0 R9", "linuxcnc").findings)
        == "G68 is not a code of linuxcnc"
    )


def test_a_modal_macro_runs_behind_every_motion():
    """Not for its own motions, nor for lines that move nothing."""
    text = "G66 P2000 A3.\nG1 X5.\nM8\nY5. F300.\nG67\nX0\nM30\nO2000\nG91 Z#1\nZ-#1\nG90\nM99"
    assert ends(run(text)) == [
        (5, 0, 5),
        (5, 0, 8),
        (5, 0, 5),
        (5, 5, 5),
        (5, 5, 8),
        (5, 5, 5),
        (0, 5, 5),
    ]
    assert run("G66 P1\nG1 X5.").lost == ((4, "G65 P1: the subprogram is not in this file"),)


def radii(executed: Executed, centre: tuple[float, float]) -> list[float]:
    """How far from the centre each half circle ends."""
    arcs = [item for item in executed.body if isinstance(item, MoveC)]
    return [round(math.dist(item.target.origin[:2], centre), 6) for item in arcs]


def test_a_circular_pocket_of_one_circle():
    """Half a circle to it, round, and back: 8 mm less the 2 mm of the tool."""
    found = run("G1 X10. Y5.\nG13 I8. Z-1. D2", **{"t2.diameter": 4.0})
    assert ends(found)[:2] == [(10, 5, 5), (10, 5, -1)]
    assert radii(found, (10, 5)) == [6, 6, 6, 0]
    first, *_ = (item for item in found.body if isinstance(item, MoveC))
    assert first.via.origin == pytest.approx((13, 2, -1))  # G13 goes to the left of its way
    assert [what for _, what in found.lost] == []


def test_a_circular_pocket_from_circle_to_circle_and_deeper():
    found = run("G91 G12 I4. K9. Q3. Z-1. L2 D0")
    assert radii(found, (0, 0)) == [4, 4, 4, 7, 7, 7, 9, 9, 9, 0] * 2
    assert {item.target.origin[2] for item in found.body if isinstance(item, MoveC)} == {4, 3}
    first, *_ = (item for item in found.body if isinstance(item, MoveC))
    assert first.via.origin == pytest.approx((2, 2, 4))


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("G13 Z-1.", "G13 without a radius (I), or K without Q"),
        ("G13 I4. K9. Z-1.", "G13 without a radius (I), or K without Q"),
        ("G13 I2. Z-1. D1", "G13 with a first circle (I) that is not larger than the tool"),
    ],
)
def test_a_circular_pocket_that_is_none(line, what):
    found = run(line, **{"t1.diameter": 8.0})
    assert [(one.level, one.what) for one in found.findings] == [("refused", what)]


@pytest.mark.parametrize(
    ("text", "line", "name"),
    [
        ("%_N_PART_MPF\nG0 X1\n", 1, "Siemens' Sinumerik"),
        ("G0 X1\nMCALL CYCLE81(1,2,3)\n", 2, "Siemens' Sinumerik"),
        ("$PART.MIN%\nG0 X1\n", 1, "Okuma's OSP"),
        ("%PM\nN9000\nN10 G54\n", 1, "Philips' CNC 3000"),
        ("0 BEGIN PGM A MM\n", 1, "Heidenhain's TNC"),
    ],
)
def test_another_language_is_named(text, line, name):
    assert run_gcode({"a.nc": text}, RunRequest()).stopped == (
        line,
        f"a program of {name}: its language is not read",
    )
