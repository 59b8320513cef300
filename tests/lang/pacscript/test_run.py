"""Runs PacScript programs; the expected values were computed by hand from the manual."""

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
    """Run a Main with these lines, of which the first is line 3 of the file."""
    text = "\n".join(["Sub Main", "TakeArm Keep = 0", *lines, "End Sub", tail])
    return LANGUAGE.run({"part.pcs": text}, RunRequest(assume=assume, points=points or {}))


def origins(executed: Executed) -> list[tuple[float, ...]]:
    """The target positions of all motions to a pose, mm."""
    return [
        tuple(np.round(item.target.origin, 6) + 0.0)
        for item in executed.body
        if isinstance(item, (MoveJ, MoveL, MoveC)) and isinstance(item.target, Pose)
    ]


def signals(executed: Executed) -> list[str]:
    """The signals that are set, in order."""
    return [item.signal for item in executed.body if isinstance(item, Output)]


def levels(executed: Executed) -> list[tuple[str, int]]:
    return [(finding.level, finding.line) for finding in executed.findings]


# -- motions ---------------------------------------------------------------------------------------


def test_a_motion_to_several_positions_uses_the_pass_mark_of_each_and_one_speed() -> None:
    executed = run(
        "Speed 40",
        "Move P, @P P(1, 2, 3), @E P(4, 5, 6), @7 P(7, 8, 9), S = 20",
        "Move L, P(1, 1, 1)",
        rated=2000,
    )
    motions = [item for item in executed.body if isinstance(item, (MoveJ, MoveL))]
    assert origins(executed) == [(1, 2, 3), (4, 5, 6), (7, 8, 9), (1, 1, 1)]
    assert [item.blend for item in motions] == [1, 0, 7, 0]
    assert [item.speed for item in motions] == [400, 400, 400, 800]
    assert [item.share for item in motions if isinstance(item, MoveJ)] == [0.2, 0.2, 0.2]
    assert executed.lines == (4, 4, 4, 5)


def test_a_position_of_two_vectors_has_its_figure() -> None:
    executed = run(HOME, "Move P, P(V(350, 0, 300), V(180, 0, 180), 5)")
    posture = executed.body[-1].posture
    assert origins(executed)[-1] == (350, 0, 300)
    assert posture is not None
    assert posture.figure == 5


def test_a_vector_that_is_not_in_the_text_leads_to_an_unknown_place() -> None:
    executed = run(HOME, "Draw L, P50")
    frame = executed.frames[executed.frame[-1]]
    assert frame.work == "a place beside where the arm stands of line 4"
    assert frame.base_from_work is None


def test_the_external_speed_scales_joint_and_linear_motions() -> None:
    executed = run("ExtSpeed 50", HOME, "Move L, P(0, 0, 0), Speed = Mps(80)")
    joint, line = executed.body
    assert isinstance(joint, MoveJ)
    assert isinstance(line, MoveL)
    assert (joint.speed, joint.share) == (500, 0.5)
    assert line.speed == 40


@pytest.mark.parametrize(("assume", "speed"), [({}, 80.0), ({"mps": 1000.0}, 80_000.0)])
def test_the_unit_of_mps_is_an_assumption(assume: dict[str, float], speed: float) -> None:
    executed = run("Move P, P(0, 0, 0), Speed = Mps(80)", **assume)
    (motion,) = executed.body
    assert isinstance(motion, MoveJ)
    assert (motion.speed, motion.share) == (speed, 0)
    assert [(assumption.key, assumption.value) for assumption in executed.assumed] == [
        ("mps", speed / 80)
    ]


def test_angles_turn_about_fixed_axes_and_a_figure_is_the_posture() -> None:
    executed = run(
        "Move P, P(1, 2, 3, 10, 20, 30, 5)",
        "Move P, P(1, 2, 3, 0, 0, 90)",
        "Move P, P(1, 2, 3, 0, 0, 0, -2)",
    )
    first, second, third = executed.body
    rx, ry, rz = np.radians((10, 20, 30))
    rotation = {
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
    assert np.allclose(first.target.rotation, rotation["z"] @ rotation["y"] @ rotation["x"])
    assert first.posture == Posture(figure=5)
    assert [item.posture for item in (second, third) if isinstance(item, MoveJ)] == [None, None]


def test_joint_values_are_converted_to_radians_without_external_axes() -> None:
    executed = run(
        "Move P, J(90, -45, 0, 0, 30, 180, 500, 600)",
        "DriveA (1, 0), (6, 90)",
        "Drive (2, 45), (7, 10)",
    )
    values = [
        item.target.values
        for item in executed.body
        if isinstance(item, MoveJ) and isinstance(item.target, Joints)
    ]
    right = math.pi / 2
    assert values[0] == pytest.approx((right, -right / 2, 0, 0, math.pi / 6, math.pi))
    assert values[1] == pytest.approx((0, -right / 2, 0, 0, math.pi / 6, right))
    assert values[2] == pytest.approx((0, 0, 0, 0, math.pi / 6, right))
    assert (
        "external axes",
        "joint values beyond the sixth are not shown, axis 7 moves",
    ) in executed.facts


def test_approach_and_depart_retract_along_the_tool_and_draw_moves_along_the_frame() -> None:
    """A tool that points down retracts upwards; turned by 90 deg about y it points along x."""
    executed = run(
        "Approach P, P(400, 0, 300, 180, 0, 180), @P 40",
        "Move L, P(400, 0, 300, 180, 0, 180)",
        "Depart L, 25",
        "Draw L, V(1, 2, 3)",
        "Approach L, P(400, 0, 300, 0, 90, 0), 10",
    )
    assert origins(executed) == [
        (400, 0, 340),
        (400, 0, 300),
        (400, 0, 325),
        (401, 2, 328),
        (390, 0, 300),
    ]


def test_an_arc_keeps_a_via_point_that_is_half_way() -> None:
    executed = run(HOME, "Move C, P(500, 100, 300, 180, 0, 180), @P P(600, 0, 300, 180, 0, 180)")
    arc = executed.body[1]
    assert isinstance(arc, MoveC)
    assert arc.via.origin == (500, 100, 300)
    assert arc.target.origin == (600, 0, 300)
    assert arc.blend == 1


def test_an_arc_of_more_than_half_a_circle_is_halved() -> None:
    """The arc of 270 deg becomes two arcs of 135 deg.

    Its centre is (500, 0). It runs from (400, 0) over (500, 100) and (600, 0) to (500, -100).
    """
    executed = run(HOME, "Move C, P(600, 0, 300, 180, 0, 180), P(500, -100, 300, 180, 0, 180)")
    first, second = executed.body[1:]
    assert isinstance(first, MoveC)
    assert isinstance(second, MoveC)
    half = 100 * math.sqrt(0.5)
    assert first.target.origin == pytest.approx((500 + half, half, 300))
    assert first.via.origin == pytest.approx(
        (500 - 100 * math.cos(3 * math.pi / 8), 100 * math.sin(3 * math.pi / 8), 300)
    )
    assert second.target.origin == (500, -100, 300)


def test_an_arc_through_points_on_a_line_is_refused() -> None:
    executed = run(HOME, "Move C, P(500, 0, 300), P(600, 0, 300)", "Depart L, 10")
    assert levels(executed) == [("refused", 4)]
    assert len(executed.body) == 2


def test_an_arc_between_two_figures_is_unusual() -> None:
    """After a line to a position without a figure, any figure is possible."""
    arc = "Move C, P(500, 100, 300, 180, 0, 180, 13), P(600, 0, 300, 180, 0, 180, 13)"
    start = "P(400, 0, 300, 180, 0, 180, 5)"
    assert levels(run(f"Move P, {start}", arc)) == [("unusual", 4)]
    assert levels(run(f"Move P, {start}", "Move P, P(400, 0, 300, 180, 0, 180)", arc)) == [
        ("unusual", 5)
    ]
    assert levels(run(f"Move P, {start}", "Move L, P(400, 0, 300, 180, 0, 180, -1)", arc)) == []


def test_rotations_turn_about_an_axis_of_the_frame_or_of_the_tool() -> None:
    """The tool points down: a positive angle in XY turns about -z. RotateH turns about tool z."""
    executed = run(
        "Move P, P(400, 0, 300, 180, 0, 0)",
        "Rotate XY, 90, V(300, 0, 0)",
        "RotateH 90",
        "Rotate XY, 90, V(300, 0, 0), static = 1",
    )
    assert origins(executed) == [(400, 0, 300), (300, -100, 300), (300, -100, 300), (400, 0, 300)]
    reorientation = executed.body[2]
    assert isinstance(reorientation, MoveL)
    assert reorientation.turn > 0
    assert np.allclose(reorientation.target.rotation, [[0, -1, 0], [-1, 0, 0], [0, 0, -1]])


def test_an_arch_moves_up_across_and_down() -> None:
    """The height of an arch is measured from the lower one of its two ends."""
    arch = "ArchMove P(500, 0, 350, 180, 0, 180), 100"
    assert origins(run(HOME, arch))[1:] == [(400, 0, 400), (500, 0, 400), (500, 0, 350)]


def test_functions_compute_positions() -> None:
    executed = run(
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
    assert origins(executed) == [(101, 202, 303), (101, 198, 297), (5, 200, 307), (5, 200, 308)]
    last = executed.body[-1]
    assert isinstance(last, MoveJ)
    assert isinstance(last.target, Joints)


# -- frames, outputs, waits ------------------------------------------------------------------------


def test_each_motion_has_the_tool_and_work_frame_that_were_chosen_last() -> None:
    executed = run(
        "Tool 2, P(0, 0, 100)",
        "Work 3, P(1, 2, 3, 0, 0, 90)",
        "ChangeTool 2",
        HOME,
        "ChangeWork 3",
        "Move P, P(0, 0, 0)",
        "ChangeWork 7",
        "Move P, P(0, 0, 0)",
    )
    assert [(frame.tool, frame.work) for frame in executed.frames] == [
        ("2", "0"),
        ("2", "3"),
        ("2", "7"),
    ]
    assert executed.frame == (0, 1, 2)
    tool, work = executed.frames[1].flange_from_tool, executed.frames[1].base_from_work
    assert tool is not None
    assert work is not None
    assert tool.origin == (0, 0, 100)
    assert work.origin == (1, 2, 3)
    assert executed.frames[2].base_from_work is None


def test_the_position_of_the_arm_is_converted_to_a_new_work_frame() -> None:
    """The work frame is at (100, 0, 0), turned by 90 deg about z.

    (400, 0, 300) in the base is (0, -300, 300) in this frame.
    """
    executed = run("Work 1, P(100, 0, 0, 0, 0, 90)", HOME, "ChangeWork 1", "Draw L, V(0, 0, 0)")
    assert origins(executed)[1] == (0, -300, 300)


def test_outputs_delays_and_stops_are_run_in_order() -> None:
    executed = run(
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
    assert executed.body == (
        *(Output("24", 1), Output("25", 0)),
        *(Output("1", 1), Output("2", 1), Output("3", 1), Output("7", 1), Output("8", 0)),
        *(Wait(1.5), Stop(), Stop(), Stop()),
    )


def test_a_range_of_very_many_outputs_is_left_out_and_named() -> None:
    executed = run("Set IO[24 To 300]", "Set IO[1]")
    assert executed.body == (Output("1", 1),)
    assert executed.lost == ((3, "IO[24 To 300] names more than 256 outputs: left out"),)


def test_a_port_can_be_named_and_set() -> None:
    executed = run("DefIO lamps = Byte, 64", "lamps = 5", "If lamps = 5 Then Set IO[1]")
    assert executed.body == (Output("lamps", 5), Output("1", 1))


def test_a_port_that_is_set_to_0_is_known() -> None:
    executed = run("DefIO lamp = Bit, 64", "Reset lamp", "If lamp = 0 Then Set IO[1]")
    assert signals(executed) == ["lamp", "1"]
    assert executed.choices == ()


@pytest.mark.parametrize("digits", ["&H" + "F" * 300, "&B" + "1" * 400])
def test_a_hexadecimal_or_binary_number_is_read_whole(digits: str) -> None:
    assert [(finding.line, finding.what) for finding in run(f"I1 = {digits}").findings] == [
        (3, "a number is too large")
    ]


def test_an_output_in_a_corner_is_dangerous() -> None:
    executed = run(
        HOME,
        "Move L, @P P(1, 2, 3)",
        "Set IO[24]",
        "Move L, @P P(1, 2, 3)",
        "Arrive 90",
        "Set IO[24]",
        "Move L, @P P(0, 0, 0), Next",
        "Set IO[24]",
    )
    assert levels(executed) == [("dangerous", 5)]


def test_force_is_in_the_work_frame_and_dangerous_if_it_stays_on() -> None:
    executed = run(
        HOME,
        "ForceParam 1, 2, P(0, 0, -10)",
        "ForceCtrl True, 1",
        "Move L, P(0, 0, 300)",
        "ForceParam 1, 2, P(3, 4, 0)",
        "Move L, P(9, 0, 300)",
    )
    assert executed.body[1] == Force(10, (0, 0, -1))
    assert [
        (item.force, item.force_direction) for item in executed.body if isinstance(item, MoveL)
    ] == [
        (10, (0, 0, -1)),
        (5, (0.6, 0.8, 0)),
    ]
    assert levels(executed) == [("dangerous", 8)]


def test_a_line_as_first_motion_and_a_delay_in_seconds_are_unusual() -> None:
    assert levels(run("Move L, P(1, 2, 3)", "Delay 2")) == [("unusual", 3), ("unusual", 4)]


# -- control flow and expressions ------------------------------------------------------------------

#: Statements, and the outputs that they set, in order.
OUTPUTS_OF_STATEMENTS = [
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
    (
        "Select Case 5\nCase 1, 2\nSet IO[1]\nCase 3 To 6\nSet IO[2]\n"
        "Case Else\nSet IO[3]\nEnd Select",
        "2",
    ),
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
]


@pytest.mark.parametrize(("text", "outputs"), OUTPUTS_OF_STATEMENTS)
def test_statements_set_the_outputs_that_the_manual_defines(text: str, outputs: str) -> None:
    executed = run(*text.split("\n"))
    assert "".join(signals(executed)) == outputs
    assert not executed.findings
    assert executed.stopped is None


def test_procedures_get_values_and_references() -> None:
    executed = run(
        "x = 1",
        "Call Add(x, 4)",
        "Set IO[x]",
        "Set IO[Twice(x)]",
        "Keep x",
        "Set IO[x]",
        "Set IO[Nine]",
        tail="Sub Add(ByRef a As Integer, ByVal b As Integer)\na = a + b\nb = 0\nEnd Sub\n"
        "Function Twice(ByVal a As Integer) As Integer\na = a * 2\nTwice = a\nEnd Function\n"
        "Sub Keep(ByVal a)\na = 100\nEnd Sub\nFunction Nine As Integer\nNine = 9\nEnd Function",
    )
    assert signals(executed) == ["5", "10", "5", "9"]


def test_a_reference_parameter_changes_its_variable_only_if_it_is_assigned() -> None:
    executed = run(
        "Dim x As Single = 2.6",
        "Call Look(x)",
        "Set IO[Int(x * 10)]",
        tail="Sub Look(n As Integer)\ny = n\nEnd Sub",
    )
    assert executed.body == (Output("26", 1),)


def test_too_many_arguments_are_refused_and_endless_recursion_stops() -> None:
    assert levels(run("Call A(1)", tail="Sub A\nEnd Sub")) == [("refused", 3)]
    assert run("Call A", tail="Sub A\nCall A\nEnd Sub").stopped == (
        6,
        "procedures that call each other without end",
    )


ENDLESS_FACT = ("runs forever", "from line 4: shown once")


def test_an_endless_loop_is_shown_once() -> None:
    executed = run(HOME, "Do", "Move L, P(1, 2, 3)", "n = n + 1", "Loop")
    assert len(executed.body) == 2
    assert executed.stopped is None
    assert ENDLESS_FACT in executed.facts


def test_a_loop_at_a_fixed_point_is_endless_and_a_long_loop_stops_the_run() -> None:
    end = ("If x = 5 Then Exit Do", "Loop")
    assert ENDLESS_FACT in run("x = 0", "Do", "x = 1", "x = 0", *end).facts
    assert ENDLESS_FACT in run("x = 0", "Do", "x = 1 - x", *end).facts
    counted = run("Do", "x = x + 1", "If x > 5000 Then Exit Do", "Loop", "Set IO[Int(x / 1000)]")
    assert counted.body == (Output("5", 1),)
    stopped = run("For i = 1 To 10000000", "Next").stopped
    assert stopped is not None
    assert stopped[1].startswith("the program has not ended after 500,000 steps")


# -- unknown values --------------------------------------------------------------------------------


def test_a_wait_ends_at_once_and_its_condition_holds_after_it() -> None:
    executed = run("Wait IO[8] = On", "If IO[8] = On Then Set IO[1] Else Set IO[2]")
    assert executed.body == (Output("1", 1),)
    assert [(entry.line, entry.what, entry.key) for entry in executed.assumed] == [
        (3, "Wait for IO[8] is over at once", "io[8]")
    ]


def test_a_wait_for_another_value_than_the_user_assumes_stops_the_run() -> None:
    lines = ("Wait IO[8] = On", "Set IO[1]")
    assert run(*lines, io8=0.0).stopped == (3, "waits forever: io[8] is given otherwise")
    assert run(*lines, **{"io[8]": 1.0}).body == (Output("1", 1),)


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
def test_an_unknown_condition_takes_the_branch_that_continues(text: str, outputs: str) -> None:
    executed = run(*text.split("\n"))
    assert "".join(signals(executed)) == outputs
    assert executed.assumed
    assert executed.stopped is None


def test_values_that_the_user_assumes_decide_conditions() -> None:
    text = (
        "If I[3] = 2 Then Set IO[1]",
        "If IO[4] = Off Then Set IO[2]",
        "If speed_mode > 1 Then Set IO[3]",
    )
    assert signals(run(*text, **{"i3": 2.0, "io[4]": 1.0, "speed_mode": 5.0})) == ["1", "3"]


def test_an_unknown_position_is_the_origin_of_a_frame_with_its_name() -> None:
    """A retraction along the tool is known in that frame, a motion along the work frame is not."""
    executed = run(
        "Approach P, P[1], 50",
        "Move L, P[1]",
        "Depart L, 20",
        "Draw L, V(1, 2, 3)",
        "Set IO[1]",
        HOME,
    )
    assert origins(executed) == [(0, 0, -50), (0, 0, 0), (0, 0, -20), (0, 0, 0), (400, 0, 300)]
    assert [frame.work for frame in executed.frames] == [
        "P[1]",
        "a place beside where the arm stands of line 6",
        "0",
    ]
    assert [frame.base_from_work is None for frame in executed.frames] == [True, True, False]
    assert executed.frame == (0, 0, 0, 1, 2, 2)
    assert "P[1] is not in the text: motions to it are given in a frame of that name" in [
        assumption.what for assumption in executed.assumed
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
def test_the_frame_of_an_unknown_target_says_how_it_was_reached(
    text: str, works: list[str]
) -> None:
    executed = run(*text.split("\n"))
    assert [frame.work for frame in executed.frames] == works
    assert executed.assumed


POINTS = {
    "named": {"a.csv": "P[1], 1, 2, 3, 180, 0, 0, 5\nJ2 = J(0, 90)\n' a comment\nI[3], 7\n"},
    "numbered": {
        "P_Var.csv": 'a heading\n,"X","Y"\n'
        '1,1.000,2.0,3,180,0,0,"5 - Lefty | Above","P1"\n2,0,0,0,0,0,0,-1,""\n'
    },
}


@pytest.mark.parametrize("points", POINTS.values(), ids=POINTS)
def test_a_position_of_a_file_of_variables_has_its_figure(points: dict[str, str]) -> None:
    executed = run("Move P, P1", points=points)
    (motion,) = executed.body
    assert origins(executed) == [(1, 2, 3)]
    assert isinstance(motion, MoveJ)
    assert motion.posture == Posture(figure=5)


def test_joint_values_and_integers_of_a_file_of_variables_are_used() -> None:
    executed = run("Move P, J[2]", "Set IO[I3]", points=POINTS["named"])
    motion, output = executed.body
    assert isinstance(motion, MoveJ)
    assert motion.target == Joints((0.0, math.pi / 2))
    assert output == Output("7", 1)


def test_a_value_that_the_program_assigns_replaces_that_of_the_file() -> None:
    assert origins(run("P1 = P(9, 9, 9)", "Move P, P[1]", points=POINTS["named"])) == [(9, 9, 9)]


def test_other_tasks_devices_and_routines_are_named() -> None:
    executed = run("Run Other", "Comm.Open 8", "Call Gripper(1)", HOME)
    assert ("other tasks", "other, not shown") in executed.facts
    assert ("other devices", "comm.open") in executed.facts
    assert executed.assumed[0].what == (
        "gripper is in no file that is given: left out, with all that it moves and sets"
    )


def test_a_concurrent_task_is_checked_on_its_own() -> None:
    task = (
        "Sub Watch\nTakeArm\nMove P, @P P(9, 9, 9)\nSet IO[30]\nDelay 5\nDelay -5\nHold\nEnd Sub\n"
    )
    executed = LANGUAGE.run(
        {"a.pcs": f"Sub Main\nRun Watch\nRun Watch\nEnd Sub\n{task}"}, RunRequest()
    )
    assert not executed.body
    assert (
        dict(executed.facts)["other tasks"]
        == "watch: sets 30 to 1, stops, waits, 1 motion, not shown"
    )
    assert levels(executed) == [("dangerous", 8), ("unusual", 9), ("unusual", 10)]
    assert [finding.what[:9] for finding in executed.findings[1:]] == ["in watch:"] * 2


def test_a_task_can_be_the_main_of_another_file() -> None:
    other = "Sub Main\nSet IO[30]\nRun Main\nEnd Sub\n"
    executed = LANGUAGE.run(
        {"a.pcs": "Sub Main\nRun Watch\nEnd Sub\n", "Watch.pcs": other}, RunRequest(entry="a")
    )
    assert dict(executed.facts)["other tasks"] == "watch: sets 30 to 1, not shown"
    assert executed.lost == ((2, "another task, watch, is not shown: sets 30 to 1"),)


# -- files -----------------------------------------------------------------------------------------

MAIN = '#Include "..\\lib\\Names.h"\nSub Main\nTakeArm\nCall Grip(PEN)\nCall Other(3)\nEnd Sub\n'
NAMES = (
    '#Ifndef NAMES\n#Define NAMES\n#Define PEN 24\n#Include "Names.h"\n'
    "Sub Grip(n)\nSet IO[n]\nEnd Sub\n#EndIf\n"
)
OTHER = "Sub Main(ByVal n As Integer)\nReset IO[n]\nEnd Sub\n"


def test_files_include_and_call_each_other_and_their_lines_are_counted_on() -> None:
    executed = LANGUAGE.run(
        {"a/Main1.pcs": MAIN, "lib/Names.h": NAMES, "Other.pcs": OTHER}, RunRequest()
    )
    assert executed.body == (Output("24", 1), Output("3", 0))
    assert executed.lines == (12, 16)
    assert not executed.findings


def test_files_that_are_missing_are_named() -> None:
    executed = LANGUAGE.run({"main1.pcs": MAIN}, RunRequest())
    assert ("files that are not given", "names.h") in executed.facts
    assert "names.h is not given: what it holds is not known" in [
        assumption.what for assumption in executed.assumed
    ]
    assert not executed.findings


def test_the_entry_is_main_the_only_procedure_or_the_one_that_the_user_names() -> None:
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


def test_all_kinds_of_line_ends_are_read() -> None:
    for end in ("\n", "\r\n", "\r"):
        executed = LANGUAGE.run(
            {"a.pcs": end.join(("Sub Main", "Set IO[1]", "End Sub"))}, RunRequest()
        )
        assert (executed.body, executed.lines) == ((Output("1", 1),), (2,))


# -- the older dialect -----------------------------------------------------------------------------

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


def test_a_program_of_the_older_dialect_is_run() -> None:
    executed = LANGUAGE.run({"old.pac": PAC}, RunRequest())
    assert origins(executed) == [(400, 0, 300), (400, 0, 250), (400, 0, 250)]
    assert signals(executed) == ["2", "3", "7"]
    assert executed.stopped is None
    assert levels(executed) == [("dangerous", 14)]


PAC_SPELLINGS = """PROGRAM old
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


def test_the_spellings_of_the_older_dialect_are_read() -> None:
    executed = LANGUAGE.run({"old.pac": PAC_SPELLINGS}, RunRequest())
    assert signals(executed) == ["1", "2", "4"]
    assert not executed.findings
    assert "data from fill is not known: the branch is gone into" in [
        assumption.what for assumption in executed.assumed
    ]


def test_an_error_in_a_branch_that_was_guessed_is_possible_not_refused() -> None:
    assert levels(run("If I[3] = 0 Then\nMotor Off\nEnd If", HOME)) == [("possible", 6)]
    assert levels(run("Motor Off", HOME)) == [("refused", 4)]


def test_the_entry_may_share_its_name_with_a_header_or_be_in_an_included_file() -> None:
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


@pytest.mark.parametrize(("scara", "height"), [(0.0, -30), (1.0, 30)])
def test_an_arm_of_four_axes_departs_upwards(scara: float, height: float) -> None:
    executed = run(
        "Move P, P(400, 0, 0, 0, 0, 90)",
        "Depart L, 30",
        "Approach P, P(0, 0, 0), 30",
        **{"__scara_robot__": scara},
    )
    assert origins(executed) == [(400, 0, 0), (400, 0, height), (0, 0, height)]
    keys = [assumption.key for assumption in executed.assumed if "points up" in assumption.what]
    assert keys == ([] if scara else ["__scara_robot__"])


# -- blocks in one line ------------------------------------------------------------------------


def test_end_if_in_the_line_of_its_if_leaves_the_blocks_around_it_open() -> None:
    executed = run("For i = 1 To 2", "If i = 1 Then Set IO[24] : End If", HOME, "Next i")
    assert not executed.findings
    assert [type(item) for item in executed.body] == [Output, MoveJ, MoveJ]


def test_a_loop_that_a_single_line_if_leaves_open_is_refused() -> None:
    executed = run("If IO[8] Then For i = 1 To 2", HOME)
    assert [(finding.line, finding.what) for finding in executed.findings] == [
        (3, "For has no Next")
    ]
    assert [type(item) for item in executed.body] == [MoveJ]


def test_a_function_in_an_unknown_condition_is_called_once() -> None:
    tail = f"Function Look\n{HOME}\nLook = IO[8]\nEnd Function"
    executed = run("If Look = 1 Then", "Set IO[24]", "End If", tail=tail)
    assert [type(item) for item in executed.body] == [MoveJ, Output]
