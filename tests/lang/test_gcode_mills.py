"""G-code words of some mills: rotated coordinates, modal macros, circular pockets."""

import math

import numpy as np
import pytest

from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import Executed, RunRequest
from camgen.model.program import MoveC, MoveJ, MoveL

LEAD = "G21 G90 G17 G94 G0 X0 Y0 Z5\nF600.\n"


def run(text: str, dialect: str = "fanuc", **assumed: float) -> Executed:
    return run_gcode({"a.nc": LEAD + text + "\nM30\n"}, RunRequest(dialect, assumed))


def end_points(executed: Executed) -> list[tuple[float, ...]]:
    """The rounded end points of the motions after the lead, mm."""
    assert executed.stopped is None
    assert not [finding for finding in executed.findings if finding.level == "refused"]
    motions = [item for item in executed.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return [tuple(np.round(motion.target.origin, 6) + 0.0) for motion in motions[1:]]


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("fanuc", "G68 X10. Y0 R90.\nG1 X20. Y0\nX30.\nG69\nX0"),
        ("iso", "G68 X10. Y0 R90.\nG1 X20. Y0\nX30.\nG69 X0"),
        ("mach3", "G68 A10 B0 R90\nG1 X20 Y0\nX30\nG69\nX0"),
        ("mach3", "G68 A10 B0 R60\nG68 A10 B0 I1 R30\nG1 X20 Y0\nX30\nG69\nX0"),
    ],
)
def test_coordinates_are_rotated_about_the_centre(dialect, text):
    """A quarter turn about (10, 0) maps 10 mm along X to 10 mm along Y."""
    assert end_points(run(text, dialect)) == [(10, 10, 5), (10, 20, 5), (0, 20, 5)]


def test_increments_are_rotated_independently_of_the_centre():
    assert end_points(run("G68 X99. Y99. R90.\nG91 G1 X4.\nY2.\nG69\nX1.")) == [
        (0, 4, 5),
        (-2, 4, 5),
        (-1, 4, 5),
    ]


def test_arcs_and_holes_are_rotated_too():
    executed = run(
        "G68 X0 Y0 R90.\nG1 X10. Y0\nG3 X0 Y10. I-10. J0\nG0 Z1.\nG81 X5. Y0 Z-1. R1.\nG80"
    )
    arc = next(item for item in executed.body if isinstance(item, MoveC))
    half = math.sqrt(0.5) * 10
    assert arc.via.origin == pytest.approx((-half, half, 5))
    assert arc.target.origin == pytest.approx((-10, 0, 5), abs=1e-9)
    assert end_points(executed)[-3:] == [(0, 5, 1), (0, 5, -1), (0, 5, 1)]


def test_a_rotation_without_a_centre_is_about_the_tool():
    assert end_points(run("G1 X10. Y5.\nG68 R180.\nG1 X12. Y5.")) == [(10, 5, 5), (8, 5, 5)]


def test_an_angle_that_only_the_machine_knows_is_a_loss_unless_it_is_given():
    executed = run("G68 X0 Y0\nG1 X9.")
    assert executed.lost == ((3, "G68 without R: the angle is the machine's, deg"),)
    assert run("G68 X0 Y0\nG1 X9.", **{"g68.r": 90.0}).lost == ()


def test_linuxcnc_refuses_a_rotation():
    executed = run("G68 X0 Y0 R9", "linuxcnc")
    assert executed.findings[0].what == "G68 is not a code of linuxcnc"


def test_a_modal_macro_runs_after_each_motion():
    """It does not run after its own motions or after a line without a motion."""
    text = "G66 P2000 A3.\nG1 X5.\nM8\nY5. F300.\nG67\nX0\nM30\nO2000\nG91 Z#1\nZ-#1\nG90\nM99"
    assert end_points(run(text)) == [
        (5, 0, 5),
        (5, 0, 8),
        (5, 0, 5),
        (5, 5, 5),
        (5, 5, 8),
        (5, 5, 5),
        (0, 5, 5),
    ]
    assert run("G66 P1\nG1 X5.").lost == ((4, "G65 P1: the subprogram is not in this file"),)


def end_radii(executed: Executed, centre: tuple[float, float]) -> list[float]:
    """The distance of the end of each half circle from the centre, mm."""
    arcs = [item for item in executed.body if isinstance(item, MoveC)]
    return [round(math.dist(item.target.origin[:2], centre), 6) for item in arcs]


def test_a_circular_pocket_of_one_circle_starts_and_ends_with_half_circles():
    """The radius is 8 mm less the 2 mm of the tool."""
    executed = run("G1 X10. Y5.\nG13 I8. Z-1. D2", **{"t2.diameter": 4.0})
    assert end_points(executed)[:2] == [(10, 5, 5), (10, 5, -1)]
    assert end_radii(executed, (10, 5)) == [6, 6, 6, 0]
    first, *_ = (item for item in executed.body if isinstance(item, MoveC))
    # G13 turns to the left of its direction.
    assert first.via.origin == pytest.approx((13, 2, -1))
    assert [what for _, what in executed.lost] == []


def test_a_circular_pocket_is_cut_in_several_circles_and_depths():
    executed = run("G91 G12 I4. K9. Q3. Z-1. L2 D0")
    assert end_radii(executed, (0, 0)) == [4, 4, 4, 7, 7, 7, 9, 9, 9, 0] * 2
    assert {item.target.origin[2] for item in executed.body if isinstance(item, MoveC)} == {4, 3}
    first, *_ = (item for item in executed.body if isinstance(item, MoveC))
    assert first.via.origin == pytest.approx((2, 2, 4))


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("G13 Z-1.", "G13 without a radius (I), or K without Q"),
        ("G13 I4. K9. Z-1.", "G13 without a radius (I), or K without Q"),
        ("G13 I2. Z-1. D1", "G13 with a first circle (I) that is not larger than the tool"),
    ],
)
def test_a_circular_pocket_without_a_valid_radius_is_refused(line, what):
    executed = run(line, **{"t1.diameter": 8.0})
    assert [(finding.level, finding.what) for finding in executed.findings] == [("refused", what)]


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
