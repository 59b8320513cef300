"""V+ expressions: numbers, bits, strings, locations."""

import math

import numpy as np
import pytest

from camgen.lang.programs import RunRequest
from camgen.lang.vplus.language import run
from camgen.model.pose import rotation_about
from camgen.model.program import MoveJ, MoveL


def execute(*lines):
    executed = run({"a.v2": "\n".join([".PROGRAM a()", *lines, ".END", ""])}, RunRequest())
    assert not [finding for finding in executed.findings if finding.level == "refused"]
    return executed


def evaluate_number(expression):
    return execute(f"x = {expression}", "MOVE TRANS(x/1000)").body[0].target.origin[0] * 1000


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("1+2*3", 7),
        ("(1+2)*3", 9),
        ("-2*-3", 6),
        ("7 MOD 3", 1),
        ("-7 MOD 3", -1),
        ("7/2", 3.5),
        ("1.5E-3*1000", 1.5),
        ("TRUE", -1),
        ("FALSE", 0),
        ("NOT TRUE", 0),
        ("NOT 0", -1),
        ("2 > 1", -1),
        ("2 <= 1", 0),
        ("1 <> 2", -1),
        ("(1 == 1) AND (2 == 2)", -1),
        ("(1 == 2) OR (2 == 2)", -1),
        ("TRUE XOR TRUE", 0),
        ("3 AND 4", -1),
        ("6 BAND 3", 2),
        ("6 BOR 3", 7),
        ("6 BXOR 3", 5),
        ("COM 0", -1),
        ("^HFF", 255),
        ("^B101", 5),
        ("^17", 15),
        ("BMASK(1,5)", 17),
        ("BCD(25)", 37),
        ("DCB(37)", 25),
        ("ABS(-5)", 5),
        ("INT(-2.7)", -2),
        ("FRACT(2.25)", 0.25),
        ("SQR(3)", 9),
        ("SQRT(16)", 4),
        ("SIN(30)", 0.5),
        ("COS(60)", 0.5),
        ("TAN(45)", 1),
        ("ATAN2(1,1)", 45),
        ("SIGN(-3)", -1),
        ("SIGN(0)", 1),
        ("MAX(1,5,3)", 5),
        ("MIN(4,2)", 2),
        ("OUTSIDE(1,5,3)", -1),
        ("OUTSIDE(1,2,3)", 0),
        ("PI", math.pi),
        ('LEN("abc")', 3),
        ('VAL("12.5mm")', 12.5),
        ('VAL("x")', 0),
        ('ASC("A")', 65),
        ('ASC("ABC", 2)', 66),
        ('POS("hello","l")', 3),
        ('POS("hello","l",4)', 4),
        ('STRDIF("a","b")', -1),
        ('"a" == "a"', -1),
        ('"a"+"b" == "ab"', -1),
        ("LNGB($LNGB(-70000))", -70000),
        ("FLTB($FLTB(1.5))", 1.5),
        ("INTB($INTB(300))", 300),
        ('LEN($MID("abcdef",2,3))', 3),
        ("VAL($CHR(55))", 7),
        ("VAL($ENCODE(/F0.2,3.14159))", 3.14),
        ("DX(TRANS(4,5,6))", 4),
        ("DZ(SHIFT(TRANS(4,5,6) BY 1,1,1))", 7),
        ("DISTANCE(TRANS(0,3,0),TRANS(4,0,0))", 5),
        ("IDENTICAL(TRANS(1),TRANS(1))", -1),
        ("IDENTICAL(TRANS(1),TRANS(1,0,0,1))", 0),
    ],
)
def test_an_expression_has_the_value_of_the_manual(expression, expected):
    assert evaluate_number(expression) == pytest.approx(expected)


def test_an_array_may_have_several_subscripts():
    executed = execute(
        "i = 2",
        "x[1,i] = 5",
        "x[i+1] = 6",
        "x[] = 1",
        "SET p[0] = TRANS(x[1,2], x[3], x[0])",
        "MOVE p[0]",
    )
    assert executed.body[0].target.origin == (5, 6, 0) or executed.body[0].target.origin == (
        5,
        6,
        1,
    )


def test_last_is_the_highest_index_of_an_array():
    assert (
        execute("x[3] = 1", "x[7] = 2", "y = LAST(x[])", "MOVE TRANS(y)").body[0].target.origin[0]
        == 7
    )


def test_decode_splits_a_string_at_a_delimiter():
    lines = [
        '$s = "12,34"',
        '$a = $DECODE($s,",",0)',
        '$b = $DECODE($s,",",1)',
        "MOVE TRANS(VAL($a),VAL($s),LEN($b))",
    ]
    assert execute(*lines).body[0].target.origin == (12, 34, 1)


def evaluate_location(expression, *before):
    """The target of a motion to a location expression."""
    executed = execute(*before, f"MOVE {expression}")
    (target,) = [item.target for item in executed.body if isinstance(item, MoveJ | MoveL)]
    return target


def test_a_compound_location_is_given_in_the_frame_of_its_first_component():
    assert evaluate_location("TRANS(1,2,3,40,50,60)").origin == (1, 2, 3)
    yaw, pitch, roll = np.radians([40, 50, 60])
    rotation = rotation_about(2, yaw) @ rotation_about(1, pitch) @ rotation_about(2, roll)
    assert np.allclose(evaluate_location("TRANS(1,2,3,40,50,60)").rotation, rotation)
    executed = execute("SET a = TRANS(10,0,0,90)", "MOVE a:TRANS(5,0,0)")
    assert executed.body[0].target.origin == (5, 0, 0)
    assert executed.frames[0].work == "a"
    assert np.allclose(executed.frames[0].base_from_work.apply((5, 0, 0)), (10, 5, 0))


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("SHIFT(TRANS(1,2,3,90) BY 10,,5)", (11, 2, 8)),
        # The inverse has the position R' (-t): the x axis of this frame points along y.
        ("INVERSE(TRANS(10,0,0,90))", (0, 10, 0)),
        ("SCALE(TRANS(1,2,3) BY 2)", (2, 4, 6)),
        ("NULL", (0, 0, 0)),
        ("FRAME(TRANS(0,0,0),TRANS(0,5,0),TRANS(-5,0,0),TRANS(7,8,9))", (7, 8, 9)),
    ],
)
def test_a_function_computes_a_location(expression, expected):
    assert evaluate_location(expression).origin == pytest.approx(expected)


def test_frame_makes_a_frame_of_four_points():
    """Its x axis points from the first to the second, y to the third; the origin is the fourth."""
    rotation = evaluate_location(
        "FRAME(TRANS(0,0,0),TRANS(0,5,0),TRANS(-5,0,0),TRANS(7,8,9))"
    ).rotation
    assert np.allclose(rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_rotations_about_an_axis_and_components_of_locations():
    assert np.allclose(evaluate_location("RZ(90)").rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    lines = ["SET p = TRANS(1,2,3,10,20,30)", "DECOMPOSE x[1] = p", "MOVE TRANS(x[4],x[5],x[6])"]
    assert execute(*lines).body[0].target.origin == pytest.approx((10, 20, 30))
    joints = ["SET #p = #PPOINT(1,2,3,4,5,6)", "DECOMPOSE x[] = #p", "MOVE TRANS(x[0],x[5])"]
    assert execute(*joints).body[0].target.origin == pytest.approx((1, 6, 0))


def test_a_comparison_without_brackets_next_to_or_is_unusual():
    executed = execute("IF 1 == 1 OR 2 == 3 THEN", "END", "IF (1 == 1) OR (2 == 3) THEN", "END")
    assert [(finding.level, finding.line) for finding in executed.findings] == [("unusual", 2)]
