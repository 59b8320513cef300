"""Words of real programs, each in a small program, with the source of the expected motions."""

import pytest

from camgen.check.report import sum_up
from camgen.lang.gcode import interpret, predefined
from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.lang.taught import as_far_as_known
from camgen.model.program import Columns, MoveJ
from tests.support import canon
from tests.support.rs274 import needs_rs274


def run_gcode(*lines: str, dialect: str = "linuxcnc") -> Executed:
    """The run of a program of LinuxCNC, or of another dialect."""
    text = "\n".join(lines) + "\n"
    return find_language("gcode").run({"a.ngc": text}, RunRequest(dialect))


def list_findings(executed: Executed) -> list[str]:
    """The findings with line and level."""
    return [f"{item.line}: {item.level}: {item.what}" for item in executed.findings]


def list_ends(executed: Executed) -> list[list[float]]:
    """The positions at the ends of all motions, mm."""
    return Columns(executed.body).ends.tolist()


def find_extents(executed: Executed) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """The extents of the summary, mm."""
    return sum_up(Columns(executed.body)).extents


# -- rapid motions of G-code before a position is known in all axes --------------------------------

UNSHOWN = "motions and extents do not show"


@pytest.mark.parametrize(
    ("lines", "findings"),
    [
        # rs274 moves to X5000 at the height of the machine.
        (
            ("G0 X0 Y0", "G0 X5000 Y0", "G0 X0 Y0", "G0 Z5", "G1 X10 Z-1 F100"),
            [
                "3: unusual: a rapid motion from X0 Y0 to X5000 Y0 while Z is not known: "
                f"{UNSHOWN} X0 Y0",
                "4: unusual: a rapid motion from X5000 Y0 to X0 Y0 while Z is not known: "
                f"{UNSHOWN} X5000 Y0",
            ],
        ),
        # The motion from this position makes the height known.
        (
            ("G0 X5000 Y0", "G0 X0 Y0 Z5", "G1 X10 Z-1 F100"),
            [
                "3: unusual: a rapid motion from X5000 Y0 to X0 Y0 while Z is not known: "
                f"{UNSHOWN} X5000 Y0"
            ],
        ),
        (
            ("G20 G0 Z5", "G0 Z1", "G0 X1 Y0", "G1 Z-1 F4"),
            [f"3: unusual: a rapid motion from Z5 to Z1 while X and Y are not known: {UNSHOWN} Z5"],
        ),
        # The first position that is known in all axes is X5000 Y0 Z5: no motion is missing.
        (("G0 X5000 Y0", "G0 Z5", "G1 X10 Z-1 F100"), []),
        (("G0 Z5", "G0 X5000 Y0", "G1 X10 Z-1 F100"), []),
    ],
)
def test_a_rapid_motion_at_an_unknown_height_is_named(lines, findings):
    assert list_findings(run_gcode("G21 G90 G94", *lines, "M2")) == findings


@pytest.mark.parametrize(
    ("lines", "axis", "extents"),
    [
        (("G0 X0 Y0", "G0 X50 Y9", "G0 X0 Y0"), "Z", ((0, 0, 0), (50, 9, 0))),
        (("G0 X0 Y0", "G0 X50 Y9", "G1 X0 Y0 F100"), "Z", ((0, 0, 0), (50, 9, 0))),
        (("G0 X0 Z3", "G0 X50", "G0 X0", "G1 X10 F100"), "Y", ((0, 0, 3), (50, 0, 3))),
        (("G18 G0 Y0 Z3", "G0 Y50", "G0 Y0", "G1 Y10 F100"), "X", ((0, 0, 3), (0, 50, 3))),
    ],
)
def test_an_axis_that_no_line_names_is_at_0(lines, axis, extents):
    executed = run_gcode("G21 G90", *lines, "M2")
    assert list_findings(executed) == []
    (assumption,) = executed.assumed
    assert assumption.line == 2
    assert assumption.what == f"the program begins at {axis}0 (it does not say where)"
    assert find_extents(executed) == extents
    rapids = sum(line.startswith("G0") or " G0" in line for line in lines)
    assert sum(isinstance(item, MoveJ) for item in executed.body) == rapids


def test_a_replay_names_the_rapid_motions_that_it_lacks():
    lines = ("G21", "G0 X0 Y0", "G0 X50 Y0", "G0 X0 Y0", "G0 Z5", "G1 X10 F100", "M2")
    notes = [(line, str(note)) for line, note in interpret(lines).remarks]
    assert notes == [
        (
            3,
            f"warning: a rapid motion from X0 Y0 to X50 Y0 while Z is not known: {UNSHOWN} X0 Y0",
        ),
        (
            4,
            f"warning: a rapid motion from X50 Y0 to X0 Y0 while Z is not known: {UNSHOWN} X50 Y0",
        ),
    ]


# -- blanks in numbers -----------------------------------------------------------------------------


@needs_rs274
def test_linuxcnc_ignores_blanks_in_numbers():
    reference = canon.run("G21 G90 G94\nG0 X0 Y0 Z5\nG1 F300 X10 Y5 600\nM2\n")
    assert reference.error == ""
    assert reference.moves[-1].end == (10.0, 5600.0, 5.0)


@pytest.mark.parametrize(
    ("line", "dialect", "finding", "position"),
    [
        # rs274, see above.
        ("G1 X10 Y5 600", "linuxcnc", "Y5 600 is read as Y5600: blanks are ignored", (10, 5600, 5)),
        # GRBL 1.1, protocol.c: blanks are removed before the line is read.
        ("G1 X1 0.5", "grbl", "X1 0.5 is read as X10.5: blanks are ignored", (10.5, 0, 5)),
        ("G1 X - 1 0", "linuxcnc", "X - 1 0 is read as X-10: blanks are ignored", (-10, 0, 5)),
        # Marlin, gcode/parser.cpp: a value ends at a blank, the rest is ignored.
        (
            "G1 X10 Y5 600",
            "marlin",
            "Y5 600 is read as Y5: a printer ends a number at a blank",
            (10, 5, 5),
        ),
    ],
)
def test_a_blank_in_a_number_is_dangerous(line, dialect, finding, position):
    executed = run_gcode("G21 G90 G94", "G0 X0 Y0 Z5", "F300", line, "M2", dialect=dialect)
    assert list_findings(executed) == [f"4: dangerous: {finding}"]
    assert Columns(executed.body).ends[-1].tolist() == list(position)


@pytest.mark.parametrize(
    "line",
    [
        "(10 20) G1 X10 (X1 0)",
        "G1 X 10 Y 20 ; 1 2",
        "N10 G1 X10",
        "#<a 1 2> = 3",
        "#1=[1 + 2]",
        "o1 if [#1 LT 2]\no1 endif",
    ],
)
def test_a_blank_outside_of_a_number_is_not_a_finding(line):
    assert list_findings(run_gcode("G21 G90 G94", "G0 X0 Y0 Z5", "F300", line, "M2")) == []


# -- the predefined names of LinuxCNC --------------------------------------------------------------

#: Lines before a name is used.
STATES = [
    "G21 | G0 X1 Y2 Z3",
    "G20 F10 G18 | M7 M3 S500 | G0 X1 Y2 Z3 | G1 X2 | G21",
    "G21 F100 G95 M3 S50 | G0 X1 Y1 Z1 | G99 G81 X1 Y1 Z-1 R1 | M50 P0 | G96 D100 S50",
    "G21 F100 | G0 X1 Y2 Z3 | T1 M6 | M8 M4 S20 | M49 | M52 | M53 P0 | G91 G90.1 | G98",
    "G21 G93 | G0 X1 Y2 Z3 | T2 | G19 | M51 P0 | M70 | G80",
    "G21 F100 M3 S20 | G0 X1 Y2 Z3 | T1 M6 | G0 A4 B5 | G41.1 D1",
    "G21 G10 L2 P1 X0 Y0 Z0 | G0 X1 Y2 Z3 | F200 G2 X5 Y2 I2 J0 | G92 X3 | G92.1 | M48",
    "G21 | G0 X1 Y2 Z3 | G7 | F30 G1 X4",
]
#: Values of the machine of rs274.
MACHINE = {"machine.x": 0.0, "machine.y": 0.0, "machine.z": 0.0}
TOOLS = "T1 P1 Z0 D0.1 ;a\nT2 P2 Z0 D0.05 ;b\n"
#: Values of a controller: its version, its pockets and the positions of its other axes.
NOT_COMPARED = {"_task", *predefined._OF_THE_MACHINE, *predefined._OTHERS} - {"_a", "_b"}
COMPARED_NAMES = sorted(
    {
        *predefined._MODES,
        *predefined._STARTS,
        *predefined._PLACES,
        *predefined._ABSOLUTE,
        "_a",
        "_b",
    }
    - NOT_COMPARED
)


def make_name_program(names: list[str], state: str) -> str:
    """A program that stores the values of names in a state, and then moves X to each value."""
    shown = [name if name.isdigit() else f"<{name}>" for name in names]
    kept = [f"#{2000 + number}=#{name}" for number, name in enumerate(shown)]
    motions = [f"G1 F100 X#{2000 + number}" for number in range(len(names))]
    usual = "G90 G91.1 G40 G80 G94 G21 G17"
    return "\n".join([*state.split(" | "), *kept, usual, *motions, "M2"]) + "\n"


@needs_rs274
@pytest.mark.parametrize("state", STATES)
def test_predefined_names_have_the_values_of_linuxcnc(state):
    # With G41 rs274 refuses the numbered parameters of the position.
    names = [name for name in COMPARED_NAMES if not (name.isdigit() and "G41" in state)]
    text = make_name_program(names, state)
    reference = canon.run(text, TOOLS)
    assert reference.error == ""
    executed = find_language("gcode").run({"a.ngc": text}, RunRequest("linuxcnc", MACHINE))
    assert [line for line in list_findings(executed) if "refused" in line] == []
    expected = [call.end[0] for call in reference.moves[-len(names) :]]
    # The first of several equal values makes a motion of length 0, which both have.
    values = Columns(executed.body).ends[-len(names) :, 0].tolist()
    assert dict(zip(names, values, strict=True)) == pytest.approx(
        dict(zip(names, expected, strict=True)), abs=1e-3
    )


@pytest.mark.parametrize(
    ("name", "value", "key"),
    [
        ("_z", 0.0, "#<_z>"),
        ("_u", 0.0, "#<_u>"),
        ("_abs_c", 0.0, "#<_abs_c>"),
        ("_abs_x", 1.0, "machine.x"),
        ("_vmajor", 2.9, "#<_vmajor>"),
        ("_current_pocket", 0.0, "#<_current_pocket>"),
    ],
)
def test_a_value_that_the_machine_knows_is_assumed(name, value, key):
    executed = run_gcode("G21 G90", "G0 X1", f"G0 Y[#<{name}>]", "G0 Z1", "M2")
    assert list_findings(executed) == []
    assert [(item.line, item.key) for item in executed.assumed] == [(3, key)]
    assert Columns(executed.body).ends[0].tolist() == [1.0, value, 1.0]


def test_a_program_runs_on_the_machine():
    # Manual: 1 if the interpreter is part of the task that runs the machine. rs274 is not.
    executed = run_gcode("G21 G90", "G0 X0 Y0 Z#<_task>", "M2")
    assert (list_findings(executed), executed.assumed) == ([], ())
    assert Columns(executed.body).ends[0].tolist() == [0.0, 0.0, 1.0]


def test_a_predefined_name_cannot_be_set():
    # rs274: Cannot assign to read-only parameter #<_x>.
    executed = run_gcode("G21 G90", "G0 X0 Y0 Z0", "#<_x>=4", "#<_mine>=4", "G0 X#<_mine>", "M2")
    assert list_findings(executed) == ["3: refused: #<_x> cannot be set"]


# -- subroutines without a program -----------------------------------------------------------------

DRILL = """o<drill> sub
G0 X#1 Y#2
G0 Z5
G1 Z[-#3] F100
G0 Z5
o<drill> endsub
o100 sub
G0 X1 Y1 Z#1
o100 endsub
"""


def run_entry(entry: str, *arguments: float) -> Executed:
    """The run of a subroutine."""
    arguments_by_name = {f"args[{number}]": value for number, value in enumerate(arguments, 1)}
    return find_language("gcode").run(
        {"a.ngc": DRILL}, RunRequest("linuxcnc", arguments_by_name, entry=entry)
    )


@needs_rs274
def test_a_subroutine_runs_as_linuxcnc_calls_it():
    reference = canon.run(f"G21 G90\n{DRILL}o<drill> call [10] [20] [3]\nM2\n")
    executed = run_entry("drill", 10, 20, 3)
    assert list_findings(executed) == []
    assert list_ends(executed) == [list(call.end) for call in reference.moves[1:]]
    assert ("not called", "o100 (line 7)") in executed.facts


@pytest.mark.parametrize("entry", ["100", "O100", "o100"])
def test_a_subroutine_can_be_named_by_its_number(entry):
    assert list_ends(run_entry(entry, 7)) == [[1, 1, 7]]


def test_the_arguments_and_units_of_a_subroutine_are_assumed():
    executed = run_entry("o<drill>")
    assert [item.key for item in executed.assumed] == ["args", "inch"]
    assert list_ends(executed)[-1] == [0, 0, 5]


def test_a_missing_subroutine_is_refused():
    what = "there is no subroutine mill, which is asked for; the text has <drill>, 100"
    assert f"1: refused: {what}" in list_findings(run_entry("mill"))


def test_a_text_of_subroutines_lists_them():
    executed = run_gcode(*DRILL.splitlines())
    assert ("not called", "o<drill> (line 1), o100 (line 7)") in executed.facts
    assert len(executed.body) == 0


# -- newer LinuxCNC, and printers ------------------------------------------------------------------


def test_g64_may_choose_a_planner():
    # Manual of LinuxCNC's development version, G64: R is the planner. rs274 2.9: R word with no g
    # code that uses it.
    executed = run_gcode("G21 G90 G17", "G64 P0.01 R0.5", "G0 X0 Y0 Z0", "F100 G1 X10", "M2")
    assert list_findings(executed) == [
        "2: unusual: R of G64 chooses the planner of a newer LinuxCNC; version 2.9 refuses it"
    ]
    assert list_ends(executed) == [[0, 0, 0], [10, 0, 0]]


def test_lines_with_checksums_are_of_a_printer_and_checked():
    # Computed by hand: the exclusive or of the bytes before the star, as Marlin computes it.
    lines = ("N1 G28*18", "N2 G21*24", "N3 G90*16", "N4 G1 X10 Y10 F1000*88")
    executed = run_gcode(*lines, dialect="")
    assert ("dialect", "marlin (N1 G28*18)") in executed.facts
    text = "checksum {}, and that of the line is {}: the line was changed; {}"
    again = "a printer asks the host for it again"
    assert list_findings(executed) == [
        f"3: unusual: {text.format(16, 19, again)}",
        f"4: unusual: {text.format(88, 74, again)}",
    ]
    assert list_ends(executed) == [[0, 0, 0], [10, 10, 0]]
    correct = run_gcode(*lines[:2], "N3 G90*19", "N4 G1 X10 Y10 F1000*74", dialect="")
    assert list_findings(correct) == []


def test_a_product_is_not_a_checksum():
    executed = run_gcode("N1 G21 G90", "N2 #1=[2*3]", "N3 G0 X0 Y0 Z#1", "M2", dialect="")
    assert list_findings(executed) == []
    assert list_ends(executed) == [[0, 0, 6]]


# -- PacScript -------------------------------------------------------------------------------------


def run_pac(*lines: str) -> Executed:
    """The run of a program of the older dialect, PAC."""
    text = "\n".join(["PROGRAM demo", "TAKEARM", *lines, "GIVEARM", "END"]) + "\n"
    return find_language("pacscript").run({"a.pac": text}, RunRequest())


def test_a_range_of_positions_is_a_motion_to_each_of_them():
    # PAC: MOVE P, P[1 TO 3] goes through P1, P2 and P3.
    lines = [f"P{number} = (300, {number}, 300, 180, 0, 180, 5)" for number in (1, 2, 3)]
    executed = run_pac(*lines, "MOVE P, @P P[1 TO 3]", "MOVE L, @0 P[2 TO I1]", "MOVE L, P[3 TO 1]")
    assert list_ends(executed)[:3] == [[300, 1, 300], [300, 2, 300], [300, 3, 300]]
    assert [item.blend for item in executed.body[:3]] == [1.0, 1.0, 1.0]
    # The bounds of the other two ranges are not understood, so their targets are unknown.
    reasons = {(item.line, item.what) for item in executed.assumed}
    assert (6, "the pass mark of a range of positions holds for each of them") in reasons
    assert (8, "the range from 3 to 1 runs backwards: left out") in reasons
    assert [item.line for item in executed.assumed if "left out" in item.what] == [7, 8]


def test_a_free_curve_goes_through_the_points_of_its_path():
    points = "SETSPLINEPOINT 1, P(300,{0},300,180,0,180)"
    executed = run_pac(
        "MOVE P, (300,0,300,180,0,180)",
        *(points.format(y) for y in (10, 20)),
        "MOVE S, 1",
        "CLRSPLINEPOINT 1",
        points.format(5),
        "MOVE S, 1",
    )
    assert [end[1] for end in list_ends(executed)] == [0, 10, 20, 5]
    # The curve is known only to the controller: another machine must not run the lines.
    curve = "the free curve of line {} is shown as lines through its points"
    assert executed.lost == ((6, curve.format(6)), (9, curve.format(9)))


def test_rc8_has_the_same_words_for_the_path_of_a_free_curve():
    text = """Sub Main
  TakeArm
  Move P, P(300,0,300,180,0,180)
  AddPathPoint 1, P(300,10,300,180,0,180)
  Move S, 1
  ClrPathPoint 1
  Move S, 1
End Sub
"""
    executed = find_language("pacscript").run({"a.pcs": text}, RunRequest())
    assert list_ends(executed)[:2] == [[300, 0, 300], [300, 10, 300]]
    # A path without points in the text may have some in the controller.
    assert executed.frames[-1].work == "the end of the free curve of line 7"


def test_lists_of_values_add_up_to_a_position():
    # Computed by hand: 200 mm above, as P13 + (0, 0, 200, 0, 0, 0) is.
    executed = run_pac(
        "P12 = (450, -570, 450, 90, 0, 0) + (0, 0, 200, 0, 0, 0)",
        "P13 = (450, -570, 450, 90, 0, 0)",
        "P14 = P13 + (0, 0, 200, 0, 0, 0)",
        "P15 = (0, 0, 200, 0, 0, 0) + P13",
        *(f"MOVE P, P{number}" for number in (12, 13, 14, 15)),
    )
    upper, (lower,) = list_ends(executed)[::2], list_ends(executed)[1:2]
    assert upper == [pytest.approx([450, -570, 650])] * 2
    assert lower == [450, -570, 450]
    # The first list has no orientation: the shift is in the work frame as well.
    assert list_ends(executed)[3] == pytest.approx([450, -570, 650])


@pytest.mark.parametrize(
    ("lines", "moving"),
    [
        (("MOVE P, J(0,45,90,0,45,0,100)", "MOVE P, J(0,45,80,0,45,0,100)"), 0),
        (("MOVE P, J(0,45,90,0,45,0,100)", "MOVE P, J(0,45,90,0,45,0,200)"), 1),
        (("MOVE P, J(0,45,90,0,45,0,100)", "MOVE P, J(0,45,90,0,45,0,0)"), 1),
        (("MOVE P, J(0,45,90,0,45,0,100)", "DRIVEA (7, 100)"), 0),
        (("DRIVEA (7, 100)", "DRIVEA (7, 100)"), 1),
        (("DRIVE (7, 10)", "DRIVE (7, 0)"), 1),
        (("DRIVE (7, I1)", "DRIVE (7, 0)"), 1),
    ],
)
def test_a_seventh_axis_that_keeps_its_value_takes_no_time(lines, moving):
    executed = run_pac(*lines)
    assert executed.untimed == moving
    assert executed.lost[0][1].startswith("external axes: ")


# -- RAPID -----------------------------------------------------------------------------------------

#: Two targets. The statements begin in line 8.
CASE = """MODULE M
  CONST robtarget h{{2}}:=[[[500,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[600,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]];

  PROC main()
    VAR robtarget now;

    {}
    MoveL h{{1}},v100,fine,tool0;
  ENDPROC
ENDMODULE
"""


def run_rapid(*statements: str) -> Executed:
    """The run of statements of a routine."""
    text = CASE.format("\n    ".join(statements))
    return find_language("rapid").run({"m.mod": text}, RunRequest())


def list_positions(executed: Executed) -> list[tuple[str, list[float]]]:
    """The end of each motion with its frame, mm."""
    positions = Columns(executed.body).ends.round(6).tolist()
    numbers = executed.frame or (0,) * len(positions)
    works = [executed.frames[number].work for number in numbers]
    return list(zip(works, positions, strict=True))


#: The frame of the position of the arm.
ARM_FRAME = "where the arm is in line 8"


def test_positions_relative_to_an_unknown_pose_are_in_their_own_frame():
    # Computed by hand: Offs moves along the axes of the work object, from wherever the arm is.
    executed = run_rapid(
        "now:=CRobT();",
        "MoveL Offs(now,0,0,50),v100,fine,tool0;",
        "MoveL Offs(CRobT(),0,40,0),v100,fine,tool0;",
        "MoveC Offs(now,20,40,50),Offs(now,20,20,50),v100,fine,tool0;",
        "MoveJ now,v100,fine,tool0;",
    )
    assert list_findings(executed) == []
    ends = [(0, 0, 50), (0, 40, 50), (20, 20, 50), (0, 0, 0)]
    assert list_positions(executed)[:4] == [(ARM_FRAME, list(end)) for end in ends]
    assert list_positions(executed)[4] == ("", [500, 0, 500])
    assert [frame.base_from_work for frame in executed.frames if frame.work == ARM_FRAME] == [None]
    # Another machine must not run them in a frame that it knows.
    what = f"{ARM_FRAME} is not in the text: motions from there are shown in a frame of that name"
    assert (9, what) in executed.lost


def test_reltool_moves_along_the_unknown_axes_of_the_tool():
    executed = run_rapid(
        "now:=CRobT();",
        "MoveL RelTool(now,0,0,-30),v100,fine,tool0;",
        "MoveL RelTool(CRobT(),10,0,0\\Rz:=90),v100,fine,tool0;",
        "MoveL RelTool(CRobT(),10,0,0),v100,fine,tool0;",
        "MoveL Offs(CRobT(),1,0,0),v100,fine,tool0;",
    )
    along = f"{ARM_FRAME}, along the tool"
    # Computed by hand: after a quarter turn about z the x of the tool is the y of before.
    ends = [(0, 0, -30), (10, 0, -30), (10, 10, -30)]
    assert list_positions(executed)[:3] == [(along, list(end)) for end in ends]
    # The orientation of the tool in the work object is unknown: the last motion is left out.
    assert len(list_positions(executed)) == 4
    assert "a target is not known (where the arm is): motions there are left out" in [
        item.what for item in executed.assumed
    ]


@pytest.mark.parametrize(
    "statement",
    [
        "MoveL Offs(now,now.trans.x,0,0),v100,fine,tool0;",
        "now.trans.z:=5; MoveL now,v100,fine,tool0;",
        "MoveL now,v100,fine,tool0\\WObj:=wOther;",
        "MoveC now,h{1},v100,fine,tool0;",
        "PDispSet [[0,0,9],[1,0,0,0]]; MoveL now,v100,fine,tool0;",
    ],
)
def test_a_target_that_needs_the_unknown_pose_itself_is_left_out(statement):
    executed = run_rapid("now:=CRobT();", statement, "PDispOff;")
    assert [position for _, position in list_positions(executed)] == [[500, 0, 500]]
    assert any("motions there are left out" in what for _, what in executed.lost)


def test_lengths_and_extents_do_not_mix_frames():
    executed = run_rapid(
        "MoveL h{2},v100,fine,tool0;",
        "EGMRunPose id,EGM_STOP_HOLD\\X;",
        "now:=CRobT();",
        "MoveL Offs(now,0,0,50),v100,fine,tool0;",
        "MoveL Offs(now,0,30,10),v100,fine,tool0;",
    )
    carried = as_far_as_known(executed)
    sums = sum_up(Columns(carried.body), carried.works)
    # Computed by hand: 30 mm across and 40 mm down. The motions to and from the frame are unknown.
    assert sums.straight == pytest.approx(50)
    assert sorted(sums.extents_by_work.values()) == [
        ((0, 0, 10), (0, 30, 50)),
        ((500, 0, 500), (600, 0, 500)),
    ]
    assert sums.seconds == pytest.approx(0.5)
