"""What PacScript programs do when they are run: the expected values are worked out by hand from the manual."""

import math

import numpy as np
import pytest

from camgen.lang.pacscript.language import LANGUAGE
from camgen.lang.programs import Executed, RunRequest
from camgen.model.pose import Pose
from camgen.model.program import Force, Joints, MoveC, MoveJ, MoveL, Output, Posture, Stop, Wait

HOME = "Move P, @0 P(400, 0, 300, 180, 0, 180, -1)"


def run(
    *lines: str, tail: str = "", points: dict[str, str] | None = None, **assume: float
) -> Executed:
    """What a Main of these lines does; they begin at line 3."""
    text = "\n".join(["Sub Main", "TakeArm Keep = 0", *lines, "End Sub", tail])
    return LANGUAGE.run({"part.pcs": text}, RunRequest(assume=assume, points=points or {}))


def origins(found: Executed) -> list[tuple[float, ...]]:
    return [
        tuple(round(v, 6) + 0.0 for v in item.target.origin)
        for item in found.body
        if isinstance(item, (MoveJ, MoveL, MoveC)) and isinstance(item.target, Pose)
    ]


def levels(found: Executed) -> list[tuple[str, int]]:
    return [(one.level, one.line) for one in found.findings]


# -- motions ---------------------------------------------------------------------------------------------------------


def test_targets_marks_and_speeds_of_a_list_of_places() -> None:
    found = run(
        "Speed 40",
        "Move P, @P P(1, 2, 3), @E P(4, 5, 6), @7 P(7, 8, 9), S = 20",
        "Move L, P(1, 1, 1)",
        rated=2000,
    )
    motions = [item for item in found.body if isinstance(item, (MoveJ, MoveL))]
    assert origins(found) == [(1, 2, 3), (4, 5, 6), (7, 8, 9), (1, 1, 1)]
    assert [item.blend for item in motions] == [1, 0, 7, 0]
    assert [item.speed for item in motions] == [400, 400, 400, 800]
    assert [item.share for item in motions if isinstance(item, MoveJ)] == [0.2, 0.2, 0.2]
    assert found.lines == (4, 4, 4, 5)


def test_the_external_speed_is_a_factor() -> None:
    found = run("ExtSpeed 50", HOME, "Move L, P(0, 0, 0), Speed = Mps(80)")
    joint, line = found.body
    assert isinstance(joint, MoveJ)
    assert isinstance(line, MoveL)
    assert (joint.speed, joint.share) == (500, 0.5)
    assert line.speed == 40


@pytest.mark.parametrize(("assume", "speed"), [({}, 80.0), ({"mps": 1000.0}, 80_000.0)])
def test_the_unit_of_mps_is_an_assumption(assume: dict[str, float], speed: float) -> None:
    found = run("Move P, P(0, 0, 0), Speed = Mps(80)", **assume)
    (motion,) = found.body
    assert isinstance(motion, MoveJ)
    assert (motion.speed, motion.share) == (speed, 0)
    assert [(one.key, one.value) for one in found.assumed] == [("mps", speed / 80)]


def test_angles_are_fixed_ones_and_figures_are_kept() -> None:
    found = run(
        "Move P, P(1, 2, 3, 10, 20, 30, 5)",
        "Move P, P(1, 2, 3, 0, 0, 90)",
        "Move P, P(1, 2, 3, 0, 0, 0, -2)",
    )
    first, second, third = found.body
    rx, ry, rz = (np.radians(v) for v in (10, 20, 30))
    about = {
        "x": np.array(
            [[1, 0, 0], [0, math.cos(rx), -math.sin(rx)], [0, math.sin(rx), math.cos(rx)]]
        ),
        "y": np.array(
            [[math.cos(ry), 0, math.sin(ry)], [0, 1, 0], [-math.sin(ry), 0, math.cos(ry)]]
        ),
        "z": np.array(
            [[math.cos(rz), -math.sin(rz), 0], [math.sin(rz), math.cos(rz), 0], [0, 0, 1]]
        ),
    }
    assert isinstance(first, MoveJ)
    assert isinstance(first.target, Pose)
    assert np.allclose(first.target.rotation, about["z"] @ about["y"] @ about["x"])
    assert first.posture == Posture(figure=5)
    assert [item.posture for item in (second, third) if isinstance(item, MoveJ)] == [None, None]


def test_joints_are_in_radians_and_extended_axes_left_out() -> None:
    found = run(
        "Move P, J(90, -45, 0, 0, 30, 180, 500, 600)",
        "DriveA (1, 0), (6, 90)",
        "Drive (2, 45), (7, 10)",
    )
    values = [
        item.target.values
        for item in found.body
        if isinstance(item, MoveJ) and isinstance(item.target, Joints)
    ]
    right = math.pi / 2
    assert values[0] == pytest.approx((right, -right / 2, 0, 0, math.pi / 6, math.pi))
    assert values[1] == pytest.approx((0, -right / 2, 0, 0, math.pi / 6, right))
    assert values[2] == pytest.approx((0, 0, 0, 0, math.pi / 6, right))
    assert (
        "external axes",
        "joint values beyond the sixth are not shown, axis 7 moves",
    ) in found.facts


def test_approach_and_depart_go_back_along_the_tool_and_draw_along_the_frame() -> None:
    """The tool points down, so that back is up; turned by 90 deg about y it points along x."""
    found = run(
        "Approach P, P(400, 0, 300, 180, 0, 180), @P 40",
        "Move L, P(400, 0, 300, 180, 0, 180)",
        "Depart L, 25",
        "Draw L, V(1, 2, 3)",
        "Approach L, P(400, 0, 300, 0, 90, 0), 10",
    )
    assert origins(found) == [
        (400, 0, 340),
        (400, 0, 300),
        (400, 0, 325),
        (401, 2, 328),
        (390, 0, 300),
    ]


def test_an_arc_keeps_its_via_point_where_it_is_half_way() -> None:
    found = run(HOME, "Move C, P(500, 100, 300, 180, 0, 180), @P P(600, 0, 300, 180, 0, 180)")
    arc = found.body[1]
    assert isinstance(arc, MoveC)
    assert arc.via.origin == (500, 100, 300)
    assert arc.target.origin == (600, 0, 300)
    assert arc.blend == 1


def test_an_arc_of_more_than_half_a_circle_is_two() -> None:
    """About (500, 0) from (400, 0) over (500, 100) and (600, 0) to (500, -100): 270 deg, two pieces of 135 deg."""
    found = run(HOME, "Move C, P(600, 0, 300, 180, 0, 180), P(500, -100, 300, 180, 0, 180)")
    first, second = found.body[1:]
    assert isinstance(first, MoveC)
    assert isinstance(second, MoveC)
    half = 100 * math.sqrt(0.5)
    assert first.target.origin == pytest.approx((500 + half, half, 300))
    assert first.via.origin == pytest.approx(
        (500 - 100 * math.cos(3 * math.pi / 8), 100 * math.sin(3 * math.pi / 8), 300)
    )
    assert second.target.origin == (500, -100, 300)


def test_an_arc_through_points_on_a_line_is_refused() -> None:
    found = run(HOME, "Move C, P(500, 0, 300), P(600, 0, 300)", "Depart L, 10")
    assert levels(found) == [("refused", 4)]
    assert len(found.body) == 2


def test_an_arc_between_two_figures_is_unusual() -> None:
    """A line to a place whose figure is open may end in any."""
    arc = "Move C, P(500, 100, 300, 180, 0, 180, 13), P(600, 0, 300, 180, 0, 180, 13)"
    start = "P(400, 0, 300, 180, 0, 180, 5)"
    assert levels(run(f"Move P, {start}", arc)) == [("unusual", 4)]
    assert levels(run(f"Move P, {start}", "Move P, P(400, 0, 300, 180, 0, 180)", arc)) == [
        ("unusual", 5)
    ]
    assert levels(run(f"Move P, {start}", "Move L, P(400, 0, 300, 180, 0, 180, -1)", arc)) == []


def test_rotations() -> None:
    """The tool points down, so that a positive turn in XY is one about -z; RotateH turns about the tool's own z."""
    found = run(
        "Move P, P(400, 0, 300, 180, 0, 0)",
        "Rotate XY, 90, V(300, 0, 0)",
        "RotateH 90",
        "Rotate XY, 90, V(300, 0, 0), static = 1",
    )
    assert origins(found) == [(400, 0, 300), (300, -100, 300), (300, -100, 300), (400, 0, 300)]
    turn = found.body[2]
    assert isinstance(turn, MoveL)
    assert turn.turn > 0
    assert np.allclose(turn.target.rotation, np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]]))


def test_an_arch_goes_up_across_and_down() -> None:
    """The height is the larger of the two distances to the top, so from the lower place."""
    found = run(HOME, "ArchMove P(500, 0, 350, 180, 0, 180), 100")
    assert origins(found)[1:] == [(400, 0, 400), (500, 0, 400), (500, 0, 350)]


def test_places_by_functions() -> None:
    found = run(
        "Dim p As Position",
        "p = P(100, 200, 300, 180, 0, 0)",
        "Move P, Dev(p, P(1, 2, 3))",
        "Move P, DevH(p, P(1, 2, 3))",
        "LetX p = 5",
        "LetZ p = PosZ(p) + 7",
        "Move P, p",
        "Move P, Dev(CurPos, P(0, 0, 1))",
        "Move P, J2P(J(0, 0, 90, 0, 0, 0))",
    )
    assert origins(found) == [(101, 202, 303), (101, 198, 297), (5, 200, 307), (5, 200, 308)]
    last = found.body[-1]
    assert isinstance(last, MoveJ)
    assert isinstance(last.target, Joints)


# -- frames, outputs, waits ------------------------------------------------------------------------------------------


def test_frames_in_force() -> None:
    found = run(
        "Tool 2, P(0, 0, 100)",
        "Work 3, P(1, 2, 3, 0, 0, 90)",
        "ChangeTool 2",
        HOME,
        "ChangeWork 3",
        "Move P, P(0, 0, 0)",
        "ChangeWork 7",
        "Move P, P(0, 0, 0)",
    )
    assert [(one.tool, one.work) for one in found.frames] == [("2", "0"), ("2", "3"), ("2", "7")]
    assert found.frame == (0, 1, 2)
    tool, work = found.frames[1].flange_from_tool, found.frames[1].base_from_work
    assert tool is not None
    assert work is not None
    assert tool.origin == (0, 0, 100)
    assert work.origin == (1, 2, 3)
    assert found.frames[2].base_from_work is None


def test_where_the_arm_stands_is_told_in_another_work_frame() -> None:
    """(400, 0, 300) in the base is, in a frame at (100, 0, 0) turned by 90 deg about z, at (0, -300, 300)."""
    found = run("Work 1, P(100, 0, 0, 0, 0, 90)", HOME, "ChangeWork 1", "Draw L, V(0, 0, 0)")
    assert origins(found)[1] == (0, -300, 300)


def test_outputs_and_waits() -> None:
    found = run(
        "Set IO[24]",
        "Reset IO25",
        "Set IO[1 To 3]",
        "IO[7] = On",
        "Set IO[8] = 0",
        "Delay 1500",
        "Hold",
        'MsgBox("on?")',
        'x = MsgBox("yes?", 1)',
    )
    assert found.body == (
        Output("24", 1), Output("25", 0), Output("1", 1), Output("2", 1), Output("3", 1), Output("7", 1),
        Output("8", 0), Wait(1.5), Stop(), Stop(), Stop(),
    )  # fmt: skip


def test_ports_with_names_of_their_own() -> None:
    found = run("DefIO lamps = Byte, 64", "lamps = 5", "If lamps = 5 Then Set IO[1]")
    assert found.body == (Output("lamps", 5), Output("1", 1))


def test_an_output_in_a_corner_is_dangerous() -> None:
    found = run(
        HOME,
        "Move L, @P P(1, 2, 3)",
        "Set IO[24]",
        "Move L, @P P(1, 2, 3)",
        "Arrive 90",
        "Set IO[24]",
        "Move L, @P P(0, 0, 0), Next",
        "Set IO[24]",
    )
    assert levels(found) == [("dangerous", 5)]


def test_force_in_the_work_frame_and_left_on() -> None:
    found = run(
        HOME,
        "ForceParam 1, 2, P(0, 0, -10)",
        "ForceCtrl True, 1",
        "Move L, P(0, 0, 300)",
        "ForceParam 1, 2, P(3, 4, 0)",
        "Move L, P(9, 0, 300)",
    )
    assert found.body[1] == Force(10, (0, 0, -1))
    assert [
        (item.force, item.force_direction) for item in found.body if isinstance(item, MoveL)
    ] == [
        (10, (0, 0, -1)),
        (5, (0.6, 0.8, 0)),
    ]
    assert levels(found) == [("dangerous", 8)]


def test_a_line_first_and_a_delay_in_seconds_are_unusual() -> None:
    assert levels(run("Move L, P(1, 2, 3)", "Delay 2")) == [("unusual", 3), ("unusual", 4)]


# -- the way through -------------------------------------------------------------------------------------------------

COUNTED = [
    ("For i = 1 To 3\nSet IO[i]\nNext", "123"),
    ("For i = 3 To 1 Step -1\nSet IO[i]\nNext i", "321"),
    ("For i = 1 To 9\nIf i = 3 Then Exit For\nSet IO[i]\nNext", "12"),
    ("For i = 5 To 1\nSet IO[i]\nNext", ""),
    ("i = 1\nDo While i < 4\nSet IO[i]\ni = i + 1\nLoop", "123"),
    ("i = 1\nDo\nSet IO[i]\ni = i + 1\nLoop Until i = 3", "12"),
    ("i = 1\nWhile i < 3\nSet IO[i]\ni = i + 1\nWend", "12"),
    ("i = 1\nDo\nIf i > 3 Then Exit Do\nSet IO[i]\ni = i + 1\nLoop", "123"),
    ("i = 1\n*again\nSet IO[i]\ni = i + 1\nIf i < 4 Then GoTo again", "123"),
    ("GoSub a\nGoSub a\nExit Sub\n*a\nSet IO[7]\nReturn", "77"),
    ("On 2 GoTo a, b\n*a\nSet IO[1]\n*b\nSet IO[2]", "2"),
    ("If 1 > 2 Then\nSet IO[1]\nElseIf 2 > 1 Then\nSet IO[2]\nElse\nSet IO[3]\nEnd If", "2"),
    ("If 1 > 2 Then Set IO[1] : Set IO[2] Else Set IO[3] : Set IO[4]", "34"),
    ("Select Case 5\nCase 1, 2\nSet IO[1]\nCase 3 To 6\nSet IO[2]\nCase Else\nSet IO[3]\nEnd Select", "2"),
    ("Select Case 9\nCase Is > 8\nSet IO[1]\nCase Else\nSet IO[3]\nEnd Select", "1"),
    ('Select Case "b"\nCase "a"\nSet IO[1]\nCase "b"\nSet IO[2]\nEnd Select', "2"),
    ("Dim a(2) As Integer\na(0) = 1\na(2) = 3\nSet IO[a(0)]\nSet IO[a(2)]", "13"),
    ("Dim a(2) As Integer\nb = a\na(0) = 1\nIf b(0) = 0 Then Set IO[1]", "1"),
    ("Dim x As Integer = 2.6\nSet IO[x]", "3"),
    ("If Not (1 = 2) And (2 = 2 Or 3 = 4) Then Set IO[1]", "1"),
    ("Set IO[7 \\ 2]\nSet IO[7 Mod 4]\nSet IO[2 ^ 3]\nSet IO[1 + 2 * 3]", "3387"),
    ("Set IO[&B101 And 6]\nSet IO[1 << 2]\nSet IO[&HF >> 2]", "443"),
    ('If "a" & 1 = "a1" Then Set IO[1]\nSet IO[Val("7x")]\nSet IO[Len("abc")]', "173"),
    ('v = Split("4,5", ",")\nSet IO[v(1)]\nSet IO[UBound(v)]', "51"),
    ('If Sprintf("%d-%.1f-%s", 3, 2.25, "z") = "3-2.2-z" Then Set IO[1]', "1"),
    ("Set IO[Int(2.9)]\nSet IO[Abs(-3)]\nSet IO[Sqr(16)]\nSet IO[Sin(90)]", "2341"),
    ("I[5] = 4\nSet IO[I5]", "4"),
    ("For i = 1 To 2\nI[i] = i + 4\nNext\nSet IO[I[2]]\nSet IO[i]", "63"),
    ('If "a""b" = "a" & Chr(34) & "b" Then Set IO[1]', "1"),
    ("On Error GoTo h\nErr.Raise 5\nSet IO[1]\nh:\nSet IO[2]", "2"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "outputs"), COUNTED)
def test_the_way_through(text: str, outputs: str) -> None:
    found = run(*text.split("\n"))
    assert "".join(item.signal for item in found.body if isinstance(item, Output)) == outputs
    assert not found.findings
    assert found.stopped is None


def test_procedures_with_values_and_references() -> None:
    found = run(
        "x = 1", "Call Add(x, 4)", "Set IO[x]", "Set IO[Twice(x)]", "Keep x", "Set IO[x]", "Set IO[Nine]",
        tail="Sub Add(ByRef a As Integer, ByVal b As Integer)\na = a + b\nb = 0\nEnd Sub\n"
        "Function Twice(ByVal a As Integer) As Integer\na = a * 2\nTwice = a\nEnd Function\n"
        "Sub Keep(ByVal a)\na = 100\nEnd Sub\nFunction Nine As Integer\nNine = 9\nEnd Function",
    )  # fmt: skip
    assert [item.signal for item in found.body if isinstance(item, Output)] == ["5", "10", "5", "9"]


def test_a_variable_is_given_back_only_if_it_changed() -> None:
    found = run(
        "Dim x As Single = 2.6",
        "Call Look(x)",
        "Set IO[Int(x * 10)]",
        tail="Sub Look(n As Integer)\ny = n\nEnd Sub",
    )
    assert found.body == (Output("26", 1),)


def test_too_many_values_are_refused_and_endless_calls_stop() -> None:
    assert levels(run("Call A(1)", tail="Sub A\nEnd Sub")) == [("refused", 3)]
    found = run("Call A", tail="Sub A\nCall A\nEnd Sub")
    assert found.stopped == (6, "procedures that call each other without end")


ENDLESS = ("runs forever", "from line 4: shown once")


def test_an_endless_loop_is_shown_once() -> None:
    found = run(HOME, "Do", "Move L, P(1, 2, 3)", "n = n + 1", "Loop")
    assert len(found.body) == 2
    assert found.stopped is None
    assert ENDLESS in found.facts


def test_a_loop_that_goes_nowhere_and_one_that_is_too_long() -> None:
    found = run("x = 0", "Do", "x = 1", "x = 0", "If x = 5 Then Exit Do", "Loop")
    assert ENDLESS in found.facts
    switched = run("x = 0", "Do", "x = 1 - x", "If x = 5 Then Exit Do", "Loop")
    assert ENDLESS in switched.facts
    counted = run("Do", "x = x + 1", "If x > 5000 Then Exit Do", "Loop", "Set IO[Int(x / 1000)]")
    assert counted.body == (Output("5", 1),)
    forever = run("For i = 1 To 10000000", "Next")
    assert forever.stopped is not None
    assert forever.stopped[1].startswith("the program has not ended after 500,000 steps")


# -- what no text holds ----------------------------------------------------------------------------------------------


def test_a_wait_is_over_at_once_and_what_it_waits_for_holds() -> None:
    found = run("Wait IO[8] = On", "If IO[8] = On Then Set IO[1] Else Set IO[2]")
    assert found.body == (Output("1", 1),)
    assert [(one.line, one.what, one.key) for one in found.assumed] == [
        (3, "Wait for IO[8] is over at once", "io[8]")
    ]


def test_a_wait_against_what_the_user_says_stops() -> None:
    found = run("Wait IO[8] = On", "Set IO[1]", **{"io8": 0.0})
    assert found.stopped == (3, "waits forever: io[8] is given otherwise")
    assert run("Wait IO[8] = On", "Set IO[1]", **{"io[8]": 1.0}).body == (Output("1", 1),)


@pytest.mark.parametrize(
    ("text", "outputs"),
    [
        ("If IO[3] = On Then\nSet IO[1]\nExit Sub\nEnd If\nSet IO[2]", "2"),
        ("If IO[3] = On Then\nSet IO[1]\nElse\nExit Sub\nEnd If\nSet IO[2]", "12"),
        ("If IO[3] = On Then Set IO[1]\nSet IO[2]", "12"),
        ("If I[3] <> 0 Then Set IO[1]\nSet IO[2]", "2"),
        ("Do While IO[3] = Off\nLoop\nSet IO[2]", "2"),
        ("Do While IO[3] = Off\nSet IO[1]\nLoop\nSet IO[2]", "12"),
        ("Do\nDelay 10\nLoop Until IO[3] = On\nSet IO[2]", "2"),
        ("Do\nSet IO[1]\nIf IO[3] = On Then Exit Do\nLoop\nSet IO[2]", "12"),
        ("For i = 1 To I[7]\nSet IO[1]\nNext\nSet IO[2]", "12"),
        ("Select Case I[3]\nCase 1\nx = 1\nCase 2\nSet IO[1]\nEnd Select\nSet IO[2]", "12"),
    ],
)
def test_the_way_that_leads_on(text: str, outputs: str) -> None:
    found = run(*text.split("\n"))
    assert "".join(item.signal for item in found.body if isinstance(item, Output)) == outputs
    assert found.assumed
    assert found.stopped is None


def test_what_the_user_says_decides() -> None:
    text = (
        "If I[3] = 2 Then Set IO[1]",
        "If IO[4] = Off Then Set IO[2]",
        "If speed_mode > 1 Then Set IO[3]",
    )
    found = run(*text, **{"i3": 2.0, "io[4]": 1.0, "speed_mode": 5.0})
    assert [item.signal for item in found.body if isinstance(item, Output)] == ["1", "3"]


def test_places_that_no_text_holds_are_frames_of_their_names() -> None:
    """An approach lies along the tool of the place, so its frame tells it; a way along the work frame is unknown."""
    found = run(
        "Approach P, P[1], 50",
        "Move L, P[1]",
        "Depart L, 20",
        "Draw L, V(1, 2, 3)",
        "Set IO[1]",
        HOME,
    )
    assert origins(found) == [(0, 0, -50), (0, 0, 0), (0, 0, -20), (0, 0, 0), (400, 0, 300)]
    assert [one.work for one in found.frames] == [
        "P[1]",
        "a place beside where the arm stands of line 6",
        "0",
    ]
    assert [one.base_from_work is None for one in found.frames] == [True, True, False]
    assert found.frame == (0, 0, 0, 1, 2, 2)
    assert "P[1] is not in the text: motions to it are given in a frame of that name" in [
        one.what for one in found.assumed
    ]


@pytest.mark.parametrize(
    ("text", "works"),
    [
        ("Depart L, 5", ["where the arm stands at the start"]),
        ("Move P, J(0, 0, 90)\nDepart L, 5", ["0", "where the joint values of line 3 lead"]),
        ("Move P, Dev(P[1], P(0, 0, 5))", ["dev of P[1] of line 3"]),
        ("p = P[1]\nLetZ p = 5\nMove P, p", ["P[1] as changed in line 4"]),
        ("Move P, DevH(P[1], P(0, 0, 5))", ["P[1]"]),
        ("Move P, P[I[2]]", ["P[...] at a place that is not known of line 3"]),
        ("Drive (1, 10)", ["where the axes of line 3 lead"]),
        ("Move P, J[3]", ["J[3]"]),
        ("Move L, J(1, 2, 3)", ["where the joint values of line 3 lead"]),
        ("Move S, 1", ["the end of the free curve of line 3"]),
        (HOME + "\nMove C, P[1], P[2]", ["0", "P[2]"]),
        (HOME + "\nRotate XYH, 30, V(0, 0, 0)", ["0", "the end of the turn of line 4"]),
        ("GoHome", ["the home position of the controller"]),
        ("Move P, 5 + P(1, 2)", ["where line 3 leads"]),
    ],
)
def test_where_the_arm_goes_if_no_text_says_it(text: str, works: list[str]) -> None:
    found = run(*text.split("\n"))
    assert [one.work for one in found.frames] == works
    assert found.assumed


POINTS = {
    "named": {"a.csv": "P[1], 1, 2, 3, 180, 0, 0, 5\nJ2 = J(0, 90)\n' a comment\nI[3], 7\n"},
    "numbered": {
        "P_Var.csv": 'a heading\n,"X","Y"\n1,1.000,2.0,3,180,0,0,"5 - Lefty | Above","P1"\n2,0,0,0,0,0,0,-1,""\n'
    },
}


@pytest.mark.parametrize("points", POINTS.values(), ids=POINTS)
def test_variables_of_files(points: dict[str, str]) -> None:
    found = run("Move P, P1", points=points)
    (motion,) = found.body
    assert origins(found) == [(1, 2, 3)]
    assert isinstance(motion, MoveJ)
    assert motion.posture == Posture(figure=5)


def test_other_variables_of_files() -> None:
    found = run("Move P, J[2]", "Set IO[I3]", points=POINTS["named"])
    motion, output = found.body
    assert isinstance(motion, MoveJ)
    assert motion.target == Joints((0.0, math.pi / 2))
    assert output == Output("7", 1)


def test_what_the_program_sets_is_before_the_file() -> None:
    assert origins(run("P1 = P(9, 9, 9)", "Move P, P[1]", points=POINTS["named"])) == [(9, 9, 9)]


def test_other_tasks_devices_and_routines_are_named() -> None:
    found = run("Run Other", "Comm.Open 8", "Call Gripper(1)", HOME)
    assert ("other tasks", "other, not shown") in found.facts
    assert ("other devices", "comm.open") in found.facts
    assert [one.what for one in found.assumed][:1] == [
        "gripper is in no file that is given: left out, with all that it moves and sets"
    ]


def test_another_task_is_looked_at_by_itself() -> None:
    task = (
        "Sub Watch\nTakeArm\nMove P, @P P(9, 9, 9)\nSet IO[30]\nDelay 5\nDelay -5\nHold\nEnd Sub\n"
    )
    found = LANGUAGE.run(
        {"a.pcs": f"Sub Main\nRun Watch\nRun Watch\nEnd Sub\n{task}"}, RunRequest()
    )
    assert not found.body
    assert (
        dict(found.facts)["other tasks"] == "watch: sets 30 to 1, stops, waits, 1 motion, not shown"
    )
    assert [(one.level, one.line, one.what[:9]) for one in found.findings] == [
        ("dangerous", 8, found.findings[0].what[:9]), ("unusual", 9, "in watch:"), ("unusual", 10, "in watch:"),
    ]  # fmt: skip


def test_a_task_in_a_file_of_its_own() -> None:
    other = "Sub Main\nSet IO[30]\nRun Main\nEnd Sub\n"
    found = LANGUAGE.run(
        {"a.pcs": "Sub Main\nRun Watch\nEnd Sub\n", "Watch.pcs": other}, RunRequest(entry="a")
    )
    assert dict(found.facts)["other tasks"] == "watch: sets 30 to 1, not shown"
    assert found.lost == ((2, "another task, watch, is not shown: sets 30 to 1"),)


# -- files -----------------------------------------------------------------------------------------------------------

MAIN = '#Include "..\\lib\\Names.h"\nSub Main\nTakeArm\nCall Grip(PEN)\nCall Other(3)\nEnd Sub\n'
NAMES = '#Ifndef NAMES\n#Define NAMES\n#Define PEN 24\n#Include "Names.h"\nSub Grip(n)\nSet IO[n]\nEnd Sub\n#EndIf\n'
OTHER = "Sub Main(ByVal n As Integer)\nReset IO[n]\nEnd Sub\n"


def test_files_include_and_call_each_other_and_lines_are_counted_through() -> None:
    found = LANGUAGE.run(
        {"a/Main1.pcs": MAIN, "lib/Names.h": NAMES, "Other.pcs": OTHER}, RunRequest()
    )
    assert found.body == (Output("24", 1), Output("3", 0))
    assert found.lines == (12, 16)
    assert not found.findings


def test_files_that_are_missing_are_named() -> None:
    found = LANGUAGE.run({"main1.pcs": MAIN}, RunRequest())
    assert ("files that are not given", "names.h") in found.facts
    assert "names.h is not given: what it holds is not known" in [one.what for one in found.assumed]
    assert not found.findings


def test_where_to_begin() -> None:
    files = {"a.pcs": "Sub One\nSet IO[1]\nEnd Sub\nSub Two(n)\nSet IO[n]\nEnd Sub\n"}
    assert LANGUAGE.run(files, RunRequest()).stopped == (
        1,
        "there is no Sub Main: choose where to begin of one, two",
    )
    assert LANGUAGE.run(files, RunRequest(entry="One")).body == (Output("1", 1),)
    assert LANGUAGE.run(files, RunRequest(entry="two", assume={"n": 5})).body == (Output("5", 1),)
    assert LANGUAGE.run(files, RunRequest(entry="three")).stopped == (
        1,
        "there is no procedure three",
    )
    assert LANGUAGE.run({"a.pcs": "Sub Sample\nSet IO[1]\nEnd Sub\n"}, RunRequest()).body == (
        Output("1", 1),
    )
    assert LANGUAGE.run(
        {"a.pcs": OTHER, "b.pcs": "Sub Main\nSet IO[2]\nEnd Sub\n"}, RunRequest(entry="b")
    ).body == (Output("2", 1),)


def test_a_predefined_name_can_be_given() -> None:
    text = "Sub Main\n#If __SCARA_ROBOT__ = 1\nSet IO[1]\n#Else\nSet IO[2]\n#EndIf\nEnd Sub\n"
    assert LANGUAGE.run({"a.pcs": text}, RunRequest()).body == (Output("2", 1),)
    assert LANGUAGE.run({"a.pcs": text}, RunRequest(assume={"__scara_robot__": 1})).body == (
        Output("1", 1),
    )


def test_line_ends_of_any_kind() -> None:
    for end in ("\n", "\r\n", "\r"):
        found = LANGUAGE.run(
            {"a.pcs": end.join(("Sub Main", "Set IO[1]", "End Sub"))}, RunRequest()
        )
        assert (found.body, found.lines) == ((Output("1", 1),), (2,))


# -- the older dialect -----------------------------------------------------------------------------------------------

PAC = """'!TITLE "old"
PROGRAM old
DEFINT n = 2
DEFPOS top, low
DIM array(3) AS SINGLE
TAKEARM
top = (400, 0, 300, 180, 0, 180, 5)
low = top + (0, 0, 50)H
HOME top
GOHOME
array(1) = 7
*again:
  MOVE L, @P low, S = 20
  SET IO[n]
  n = n + 1
IF n < 4 THEN *again
DRIVEA (1, 10), (2, 0), (3, 90), (4, 0), (5, 0), (6, 0)
GOSUB *off
GIVEARM
END
*off
RESET IO[array(1)]
RETURN
"""


def test_the_older_dialect() -> None:
    found = LANGUAGE.run({"old.pac": PAC}, RunRequest())
    assert origins(found) == [(400, 0, 300), (400, 0, 250), (400, 0, 250)]
    assert [item.signal for item in found.body if isinstance(item, Output)] == ["2", "3", "7"]
    assert found.stopped is None
    assert levels(found) == [("dangerous", 14)]


OLDER = """PROGRAM old
#DEFINE PART I10
DEFINT n% = 1, st = -1
DIM data#(3)
DEFSTR text$
TAKEARM 0 keep=0
CALL Fill(data())
text = STR$(n) + CHR$(65)
IF text = "1A" THEN SET IO[1]
IF data(2) = 5 THEN SET IO[2]
COM_STATE #8, st
PRINT #8, text
WAIT PART = 2
ON PART GOSUB *a, *b
END
*a:
SET IO[3]
RETURN
*b:
SET IO[4]
RETURN
"""


def test_what_the_older_dialect_writes_otherwise() -> None:
    found = LANGUAGE.run({"old.pac": OLDER}, RunRequest())
    assert [item.signal for item in found.body if isinstance(item, Output)] == ["1", "2", "4"]
    assert not found.findings
    assert "data from fill is not known: the branch is gone into" in [
        one.what for one in found.assumed
    ]


def test_an_error_on_a_way_that_was_guessed_is_not_refused() -> None:
    assert levels(run("If I[3] = 0 Then\nMotor Off\nEnd If", HOME)) == [("possible", 6)]
    assert levels(run("Motor Off", HOME)) == [("refused", 4)]


def test_a_program_beside_a_header_of_the_same_name_and_a_procedure_of_an_included_file() -> None:
    files = {
        "a.h": "#Define PEN 24\n",
        "a.pcs": '#Include "a.h"\nSub Main\nSet IO[PEN]\nEnd Sub\n',
        "b.pcs": OTHER,
    }
    assert LANGUAGE.run(files, RunRequest(entry="a")).body == (Output("24", 1),)
    files = {
        "m.pcs": '#Include "n.pcs"\nSub Main\nEnd Sub\n',
        "n.pcs": "Sub Inner\nSet IO[3]\nEnd Sub\n",
    }
    assert LANGUAGE.run(files, RunRequest(entry="inner")).body == (Output("3", 1),)


@pytest.mark.parametrize(("scara", "above"), [(0.0, -30), (1.0, 30)])
def test_an_arm_of_four_axes_departs_upwards(scara: float, above: float) -> None:
    found = run(
        "Move P, P(400, 0, 0, 0, 0, 90)",
        "Depart L, 30",
        "Approach P, P(0, 0, 0), 30",
        **{"__scara_robot__": scara},
    )
    assert origins(found) == [(400, 0, 0), (400, 0, above), (0, 0, above)]
    key = [one.key for one in found.assumed if "points up" in one.what]
    assert key == ([] if scara else ["__scara_robot__"])


# -- blocks in one line ------------------------------------------------------------------------


def test_end_if_in_the_line_of_its_if_leaves_the_blocks_around_it_open() -> None:
    run_once = run("For i = 1 To 2", "If i = 1 Then Set IO[24] : End If", HOME, "Next i")
    assert not run_once.findings
    assert [type(item) for item in run_once.body] == [Output, MoveJ, MoveJ]


def test_a_loop_that_a_single_line_if_leaves_open_is_refused() -> None:
    program = run("If IO[8] Then For i = 1 To 2", HOME)
    assert [(finding.line, finding.what) for finding in program.findings] == [
        (3, "For has no Next")
    ]
    assert [type(item) for item in program.body] == [MoveJ]


def test_a_function_in_an_unknown_condition_is_called_once() -> None:
    tail = f"Function Look\n{HOME}\nLook = IO[8]\nEnd Function"
    program = run("If Look = 1 Then", "Set IO[24]", "End If", tail=tail)
    assert [type(item) for item in program.body] == [MoveJ, Output]
