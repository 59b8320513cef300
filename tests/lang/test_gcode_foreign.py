"""Runs G-code of other programs in each dialect: motions, assumptions, findings, no exceptions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode import replay
from camgen.lang.gcode.dialects import DIALECTS, LOSSES, OWN_WORDS
from camgen.lang.gcode.language import GCODE, GRBL_LANGUAGE, run_gcode
from camgen.lang.programs import RunRequest, find_language
from camgen.model.limits import Limits
from camgen.model.program import MoveC, MoveJ, MoveL, Output, Stop, ToolChange, Wait
from tests.support.examples import fewer
from tests.support.steps import assert_linear

LEAD = ("G21 G90 G17", "G0 X0 Y0 Z5", "F600 S1000 M3")


def run(*lines, dialect="linuxcnc", lead=LEAD, end=("M2",), files=None, **assume):
    text = "\n".join([*lead, *lines, *end]) + "\n"
    assumed = {key.replace("_", "."): value for key, value in assume.items()}
    return run_gcode({"main.ngc": text} | (files or {}), RunRequest(dialect, assumed))


def end_points(executed):
    """The rounded end points of the motions after the lead, mm."""
    assert executed.stopped is None, executed.stopped
    assert not [finding for finding in executed.findings if finding.level == "refused"], (
        executed.findings
    )
    motions = [item for item in executed.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return [tuple(np.round(motion.target.origin, 3) + 0.0) for motion in motions[1:]]


def list_findings(executed, level):
    return [(finding.line, finding.what) for finding in executed.findings if finding.level == level]


def wait_seconds(executed):
    return [item.seconds for item in executed.body if isinstance(item, Wait)]


def test_g_code_and_grbl_are_installed_languages():
    assert find_language("gcode").about == GCODE.about
    assert find_language("grbl").about == GRBL_LANGUAGE.about
    assert (
        set(GCODE.dialects)
        == set(DIALECTS)
        == {
            "linuxcnc",
            "grbl",
            "fanuc",
            "fanuc-lathe",
            "mach3",
            "marlin",
            "iso",
        }
    )
    assert (
        GRBL_LANGUAGE.run({"a.nc": "G21\nG81 X1 Z-1 R2\n"}, RunRequest()).findings[0].what
        == "G81 is not a code of grbl"
    )


@pytest.mark.parametrize(
    ("text", "dialect"),
    [
        ("G21\nG1 X1 F60\n", "iso"),
        ("#<depth>=2\nG1 Z#<depth>\n", "linuxcnc"),
        ("o100 sub\nG1 X1\no100 endsub\n", "linuxcnc"),
        ("G64 P0.01\nG1 X1\n", "linuxcnc"),
        ("G21\nG5.1 X0 I-50 J-150\n", "linuxcnc"),
        ("G21\nG05.1X0I-50J-150\n", "linuxcnc"),
        ("O1234\nG05.1 Q1 (smooth 1)\n", "fanuc"),
        ("%\nO1234 (PART)\nG54 G0 X1\n", "fanuc"),
        ("O0001\nG28 U0 W0\n", "fanuc"),
        ("G50 S2000\nT0101\nG96 S200 M3\nG0 X50 Z2\n", "fanuc-lathe"),
        ("(made for Mach3)\nG0 X1\n", "mach3"),
        ("G0 X1\nM98 P12 L3\n", "mach3"),
        (";FLAVOR:Marlin\nG0 X1\n", "marlin"),
        ("M104 S200\nG1 X1 E2\n", "marlin"),
        ("$H\nG0 X1\n", "grbl"),
        ("(T1 D=6. - flat end mill)\nG0 X1\n", "iso"),
    ],
)
def test_a_text_shows_its_dialect(text, dialect):
    assert dict(run_gcode({"a.nc": text}, RunRequest()).facts)["dialect"].split()[0] == dialect


def test_an_ngc_file_without_other_signs_is_of_linuxcnc():
    assert dict(run_gcode({"a.ngc": "G0 X1\n"}, RunRequest()).facts)["dialect"] == "linuxcnc (.ngc)"


def test_an_ngc_file_with_a_probe_that_linuxcnc_lacks_is_of_another_controller():
    """gcodetools names all its files .ngc. For G31 rs274 reports: unknown g code used."""
    executed = run_gcode({"a.ngc": "G21\nG31 Z-10 F500\nG1 X1\n"}, RunRequest())
    assert dict(executed.facts)["dialect"] == "iso (G31)"
    assert not list_findings(executed, "refused")
    executed = run_gcode({"a.ngc": "G21\nG64 P0.1\nG31 Z-10 F500\nM2\n"}, RunRequest())
    assert list_findings(executed, "refused") == [(3, "G31 is not a code of linuxcnc")]


@pytest.mark.parametrize(
    ("text", "is_gcode"),
    [
        ("G21\nG0 X1\nG1 Y2 F60\n", True),
        ("%\nO12\nN10 G90 G00 X1.5 (a)\n", True),
        ("g0x1y2\n", True),
        ("MODULE a\n  MoveL p1,v100,z5,t1;\nENDMODULE\n", False),
        (".PROGRAM a()\n  MOVES p1\n.END\n", False),
        ("1,2,3\n4,5,6\n", False),
        ("G21\n", False),
        ("A letter that mentions G1 X10, and goes on about it.\nG1 X1\n", False),
        ("", False),
        ("\0G1 X1", False),
    ],
)
def test_a_text_is_recognised_as_g_code(text, is_gcode):
    assert GCODE.recognise(text) is is_gcode


@pytest.mark.parametrize(
    ("dialect", "line", "seconds"),
    [
        ("linuxcnc", "G4 P2", [2.0]),
        ("grbl", "G4 P2", [2.0]),
        ("mach3", "G4 P2", [2.0]),
        ("fanuc", "G4 P500", [0.5]),
        ("fanuc", "G4 X1.5", [1.5]),
        ("fanuc", "G4 U2", [2.0]),
        ("fanuc", "G4 P2.", [2.0]),
        ("marlin", "G4 S2", [2.0]),
        ("marlin", "G4 P500", [0.5]),
        ("fanuc", "G82 X1 Z-1 R2 P500 F60", [0.5]),
        ("linuxcnc", "G82 X1 Z-1 R2 P0.5", [0.5]),
    ],
)
def test_a_wait_has_the_unit_of_its_controller(dialect, line, seconds):
    assert wait_seconds(run(line, dialect=dialect)) == seconds


def test_fanuc_has_increments_by_u_and_w_and_diameters_on_lathes():
    assert end_points(run("G0 X10 Y5", "U5 W-1", dialect="fanuc")) == [(10, 5, 5), (15, 5, 4)]
    executed = run(
        "G0 X10 Z5",
        "U4",
        "G99 G1 Z0 F0.2",
        dialect="fanuc-lathe",
        lead=("G21", "G0 X0 Z5", "G97 S600 M3"),
    )
    (line,) = [item for item in executed.body if isinstance(item, MoveL)]
    assert line.target.origin == (7, 0, 0)
    assert line.speed == pytest.approx(0.2 * 600 / 60)
    assert "X is a diameter (as on most lathes)" in [
        assumption.what for assumption in executed.assumed
    ]


@pytest.mark.parametrize("times", ["2.5", "-1", "10001"])
def test_a_number_of_calls_is_not_rounded_or_cut(times):
    subprogram = ("O100", "G91 G1 X1", "G90", "M99")
    executed = run(f"M98 P100 L{times}", end=("M2", *subprogram))
    refusal = f"L{float(times):g} is not a whole number from 0 to 10,000"
    assert list_findings(executed, "refused") == [(4, refusal)]


def test_a_subprogram_is_called_by_its_number_in_any_file():
    subprogram = ["O100", "G91 G1 X1", "G90 M99"]
    assert end_points(run("M98 P100 L3", end=("M2", *subprogram))) == [
        (1, 0, 5),
        (2, 0, 5),
        (3, 0, 5),
    ]
    assert end_points(run("M98 P30100", end=("M2", *subprogram), dialect="fanuc")) == [
        (1, 0, 5),
        (2, 0, 5),
        (3, 0, 5),
    ]
    other = {"O100.nc": "G91 G1 X1\nG90\nM99\n"}
    assert end_points(run("M98 P100", "G1 Y2", files=other)) == [(1, 0, 5), (1, 2, 5)]
    assert end_points(run("o<a> call [4]", files={"a.ngc": "o<a> sub\nG1 X#1\no<a> endsub\n"})) == [
        (4, 0, 5)
    ]
    executed = run("M98 P7", "G1 X1")
    assert end_points(executed) == [(1, 0, 5)]
    assert executed.assumed[0].what == "M98 P7: the subprogram is not in this file; it is left out"
    assert end_points(
        run("M97 P50", "G1 X9", end=("M30", "N50 G1 Y3", "M99"), dialect="fanuc")
    ) == [
        (0, 3, 5),
        (9, 3, 5),
    ]


def test_a_run_ends_with_the_first_file():
    executed = run("G1 X1", end=(), files={"b.ngc": "G1 X99\n"})
    assert end_points(executed) == [(1, 0, 5)]


def test_stops_and_tool_changes_are_instructions():
    executed = run("M0", "M1", "T2 M6", "G1 X1", "M60")
    kinds = [
        (type(item), getattr(item, "optional", None))
        for item in executed.body
        if isinstance(item, Stop | ToolChange)
    ]
    assert kinds == [(Stop, False), (Stop, True), (ToolChange, None), (Stop, False)]
    assert [frame.tool for frame in executed.frames] == ["", "T2"]
    assert len(executed.frame) == len(executed.body)
    assert dict(executed.facts)["tools"] == "T2"


def test_stored_positions_are_assumed_or_given():
    executed = run("G1 Z-3", "G28", "G0 Z5", "X1 Y1")
    assert end_points(executed) == [(0, 0, -3), (0, 0, 5), (0, 0, 5), (1, 1, 5)]
    assert [assumption.key for assumption in executed.assumed] == ["g28.x", "g28.y", "g28.z"]
    assert end_points(run("G1 Z-3", "G28 Z0", g28_z=80.0)) == [(0, 0, -3), (0, 0, 0), (0, 0, 80)]
    assert end_points(run("G53 G0 Z-10", machine_z=100.0)) == [(0, 0, 90)]
    assert end_points(run("G28", dialect="marlin")) == [(0, 0, 0)]


def test_an_input_has_the_value_that_the_user_assumes():
    executed = run("M66 P3 L3 Q5", "G1 X#5399")
    assert end_points(executed) == [(1, 0, 5)]
    assert (executed.assumed[0].key, executed.assumed[0].value) == ("din3", 1.0)
    assert end_points(run("M66 P3 L0", "G1 X#5399", din3=1.0)) == [(1, 0, 5)]


def test_values_of_the_machine_are_zero_or_given():
    assert end_points(run("G1 X[#5221+1] Y#<_hal[a.b]>")) == [(1, 0, 5)]
    executed = run_gcode(
        {"a.ngc": "G21 G90\nG0 X0 Y0 Z0\nG1 X#5221 F60\nM2\n"}, RunRequest("", {"#5221": 7.0})
    )
    assert executed.body[-1].target.origin == (7, 0, 0)


def test_a_probe_motion_runs_to_its_end_point():
    executed = run("G38.2 Z-5", "G1 X#5063", "G0 Z#5070")
    assert end_points(executed) == [(0, 0, -5), (-5, 0, -5), (-5, 0, 1)]
    assert end_points(run("G38.3 Z-5", "G0 Z#5070", probe=0.0)) == [(0, 0, -5), (0, 0, 0)]


def test_lines_with_a_slash_depend_on_a_switch():
    assert end_points(run("/G1 X1", "G1 Y1")) == [(1, 0, 5), (1, 1, 5)]
    executed = run_gcode(
        {"a.ngc": "\n".join([*LEAD, "/G1 X1", "G1 Y1", "M2"])},
        RunRequest("", {"block_delete": 1.0}),
    )
    assert end_points(executed) == [(0, 1, 5)]


def test_the_program_of_a_printer_is_run_with_its_filament():
    lines = (
        "M104 S200",
        "G28 X Y Z",
        "G92 E0",
        "M83",
        "G1 X10 E0.5 F1200",
        "G0 Y5 F6000",
        "M117 Printing part G1 X9",
        "M115 U3.8.1",
        "G1 E-1",
        "M84 X Y E",
    )
    executed = run(*lines, dialect="marlin", lead=("G21 G90",), end=())
    assert [type(item) for item in executed.body] == [MoveJ, MoveL, MoveL]
    assert [item.speed for item in executed.body[1:]] == [20.0, 100.0]
    assert dict(executed.facts)["filament"] == "-0.5 mm"
    assert not executed.findings


def test_the_motion_of_a_rotary_axis_becomes_a_wait():
    executed = run("G1 A90 F360")
    assert wait_seconds(executed) == [pytest.approx(15.0)]
    assert dict(executed.facts)["axes that are not shown"] == "A (line 4)"


def test_a_spline_ends_at_its_end_point_within_its_hull():
    executed = run("G5 X10 Y0 I0 J5 P0 Q5", "G5 X20 Y0 P0 Q-5", "G1 X25")
    points = end_points(executed)
    assert points[-1] == (25, 0, 5)
    assert (10, 0, 5) in points
    assert (20, 0, 5) in points
    # The middle of the spline has 3/4 of the height of its control points.
    assert max(y for _, y, _ in points) == pytest.approx(3.75, abs=0.01)
    assert min(y for _, y, _ in points) == pytest.approx(-3.75, abs=0.01)
    quadratic = end_points(run("G5.1 X10 Y0 I5 J5"))
    assert max(y for _, y, _ in quadratic) == pytest.approx(2.5, abs=0.01)


def test_a_nurbs_can_be_a_quarter_circle():
    """It has three points with weights 1, sqrt(1/2), 1 and order 3."""
    points = end_points(run("G0 X10 Y0", "G5.2 P1 L3", "X10 Y10 P0.70710678", "X0 Y10 P1", "G5.3"))
    assert points[-1] == (0, 10, 5)
    assert all(abs((x * x + y * y) ** 0.5 - 10) < 0.002 for x, y, _ in points)


def test_the_first_point_of_a_nurbs_has_weight_1_if_its_line_has_an_end():
    """The weights 1, sqrt(1/2), 1 give a quarter circle, as LinuxCNC reads the line."""
    points = end_points(run("G0 X10 Y0", "G5.2 P0.70710678 X10 Y10", "X0 Y10 P1", "G5.3"))
    assert points[-1] == (0, 10, 5)
    assert all(abs((x * x + y * y) ** 0.5 - 10) < 0.002 for x, y, _ in points)


def test_axis_words_beside_a_code_without_a_motion_are_those_of_the_modal_motion():
    lines = ("G1 X5", "G9 X10", "G62 X11", "G187 P1 Y3", "G103 P1 Y4")
    ends = [(5, 0, 5), (10, 0, 5), (11, 0, 5), (11, 3, 5), (11, 4, 5)]
    assert end_points(run(*lines, dialect="fanuc")) == ends
    # A limit of the machine and a mirror have axis words of their own.
    lines = ("G22 X1 Y1 Z1 I0 J0 K0", "G50.1 X0", "G1 X5")
    assert end_points(run(*lines, dialect="fanuc")) == [(5, 0, 5)]


def list_idle_codes():
    """Dialects with codes that name no loss and have no X of their own."""
    for name, dialect in DIALECTS.items():
        for code, effect in dialect.idle.items():
            if code[0] == "G" and effect not in LOSSES and "X" not in OWN_WORDS.get(code, ""):
                yield name, code


@pytest.mark.parametrize(("dialect", "code"), list(list_idle_codes()))
def test_no_code_without_a_motion_takes_the_axis_words_of_its_line_in_silence(dialect, code):
    executed = run("G1 X5", f"{code} X8", dialect=dialect, diameter=0.0)
    ends = [item.target.origin[0] for item in executed.body if isinstance(item, MoveL)]
    is_preset = (dialect, code) == ("fanuc-lathe", "G50")
    assert executed.stopped is not None or ends[-1] == 8.0 or is_preset


@pytest.mark.parametrize("code", ["G50", "G60"])
def test_a_program_ends_at_axis_words_whose_meaning_depends_on_the_machine(code):
    stopped = run("G1 X1", f"{code} X10", "G1 X2", dialect="fanuc").stopped
    assert stopped == (5, f"what {code} does with axis words depends on the machine")


def test_g50_of_a_lathe_sets_the_position():
    """X is a diameter: from 100 to 5 the tool moves by 47.5."""
    executed = run("G50 X100 Z200", "G1 X5", "G1 X80 Z100", dialect="fanuc-lathe")
    assert end_points(executed) == [(-47.5, 0, 5), (-10, 0, -95)]


@pytest.mark.parametrize("line", ["G91 G28 B0", "G28 A0"])
def test_only_the_axis_that_a_line_names_goes_home(line):
    executed = run("G1 X1", line, "G90 G1 X2", dialect="fanuc")
    assert end_points(executed) == [(1, 0, 5), (2, 0, 5)]
    axis = line[-2]
    assert executed.lost == ((5, f"axis {axis} moves: only X, Y and Z are replayed"),)


def test_a_feed_beside_a_code_of_the_user_is_kept():
    motions = [item for item in run("M101 P1 F300", "G1 X5").body if isinstance(item, MoveL)]
    assert [motion.speed for motion in motions] == [5.0]


def test_further_work_offsets_are_other_places():
    """In Fanuc's dialect, P of G54 is the number of a further work offset."""
    executed = run("G54 P1", "G1 X1", "G54 P2", "G1 X2", dialect="fanuc")
    unknown = "how far apart they are is known to the machine alone"
    assert [what for _, what in executed.lost] == [
        f"G54 P1 after motions in G54: {unknown}",
        f"G54 P2 after motions in G54 P1: {unknown}",
    ]
    assert ("work offset", "G54 P1 (line 4), G54 P2 (line 6)") in executed.facts


@pytest.mark.parametrize("offset", ["G55", "G54 P2"])
def test_the_place_of_a_work_offset_is_an_assumption_of_a_build(offset):
    text = "\n".join([*LEAD, offset, "G1 X1", "M30"])
    remarks = replay({"a.nc": text}, RunRequest("fanuc"), None).remarks
    remarks = [(line, note.what) for line, note in remarks]
    assert (4, f"the origin of {offset} is that of the work frame") in remarks


@pytest.mark.parametrize(
    "lines",
    [
        ("o1 repeat [2]", "G1 X1", "o1 endrepeat Y5"),
        ("o1 if [1]", "G1 X1", "o1 else U3", "o1 endif"),
        ("o1 do Y2", "o1 while [0]"),
        ("o<s> sub X1", "o<s> endsub"),
    ],
)
def test_words_after_an_o_word_without_a_value_are_refused(lines):
    stopped = run(*lines).stopped
    assert stopped is not None
    assert stopped[1].startswith("cannot read '")


def test_a_second_loop_with_the_label_of_the_first_is_refused():
    """The end of the second one would go back to the first one in LinuxCNC."""
    loop = ("o1 do", "#1=[#1+1]", "o1 while [#1 LT 2]")
    what = "o1 is the label of another block already"
    assert list_findings(run(*loop, *loop), "refused") == [(7, what)]


def test_an_axis_does_not_turn_for_weeks():
    executed = run("G1 A3600 F0.00001")
    assert list_findings(executed, "refused") == [(4, "an axis turns for 2.16e+10 s")]


def test_a_cut_after_a_tool_change_that_stopped_the_spindle_is_dangerous():
    what = "cuts with a spindle that does not turn: M6 stopped it (line 5), and no M3 follows"
    assert list_findings(run("G1 X1", "T2 M6", "G0 X5", "G1 Z-1", "X9"), "dangerous") == [(7, what)]
    assert list_findings(run("G1 X1", "T2 M6", "G81 X1 Y1 Z-1 R1"), "dangerous") == [(6, what)]
    assert list_findings(run("G1 X1", "T2 M6", "S900 M3", "G1 Z-1"), "dangerous") == []
    assert list_findings(run("G1 X1", "M5", "T2 M6", "G1 Z-1"), "dangerous") == []


def test_the_fast_path_keeps_the_danger_of_a_lower_tool_after_g49():
    level_motions = [f"G1 X{number}" for number in range(40)]
    assert list_findings(
        run("G43 H1", "G1 Z1", "G49", *level_motions, "G1 Z4", *level_motions), "dangerous"
    ) == [(47, "Z moves after G49 without the length of the tool: its tip goes lower by as much")]


def test_minus_zero_is_zero_before_and_after_a_zero():
    for line in ("M-0", "M0", "M-0"):
        assert Stop() in list(run("G1 X1", line).body)


def test_a_finding_has_the_level_of_its_consequence():
    assert list_findings(run("G43 H1", "G1 Z1", "G49", "G1 Z4"), "dangerous") == [
        (7, "Z moves after G49 without the length of the tool: its tip goes lower by as much")
    ]
    assert list_findings(run("G1 X1", end=()), "dangerous") == [
        (4, "the file ends with the spindle on, and without M2 or M30")
    ]
    assert list_findings(run("M5", "G1 X1", end=()), "unusual") == [
        (5, "the program has no end (M2, M30 or per cent signs): LinuxCNC stops here with an error")
    ]
    assert list_findings(run("G4 P500"), "unusual")[0][1].startswith("G4 P500 waits for 500 s")
    assert list_findings(run("G92 X5", "G1 X1"), "unusual") == [
        (6, "the shift of the origin by G92 or G52 is still on at the end")
    ]
    assert list_findings(run("F600", "G20 F60", "G1 X1"), "unusual") == [
        (5, "F60 counts in the unit before G20")
    ]
    assert list_findings(run("G41.5"), "refused") == [(4, "G41.5 is not a code of linuxcnc")]
    assert list_findings(run("M77", dialect="iso"), "refused") == []
    assert dict(run("M77", dialect="iso").facts)["not evaluated"] == "M77 (line 4)"


def test_a_code_that_may_move_something_stops_the_run():
    executed = run("G1 X1", "G51 X0 Y0 P2", "G1 X2", dialect="fanuc")
    assert executed.stopped == (5, "G51 is not known, and later lines depend on where it ends")
    assert executed.lines[-1] == 4


def test_a_run_continues_after_a_refused_line():
    executed = run("G1 X1 X2", "G1 Y3")
    assert list_findings(executed, "refused") == [(4, "word X twice in one line")]
    assert executed.body[-2].target.origin == (0, 3, 5)
    assert isinstance(executed.body[-1], Output)


def test_an_endless_program_stops_at_the_limit_of_steps():
    executed = run_gcode(
        {"a.ngc": "o1 while [1]\n#1=2\no1 endwhile\n"}, RunRequest(limits=Limits(gcode_steps=1000))
    )
    assert executed.stopped is not None
    assert (
        executed.stopped[1]
        == "the program has not ended after 1,000 steps in loops and calls (limits.gcode_steps)"
    )


@pytest.mark.parametrize(
    "line",
    [
        "G1 X1 X2",
        "G77 X1",
        "G28",
        "(a",
        "G41 D3",
        "M98 P5",
        "G92.1",
        "T3 M6",
        "WHILE[0 EQ 1]DO1",
        "GOTO 5",
    ],
)
@pytest.mark.parametrize("dialect", ["linuxcnc", "fanuc"])
def test_each_fault_costs_the_same(line, dialect):
    def execute(count):
        run_gcode({"a.ngc": "\n".join([*LEAD, *[line] * count])}, RunRequest(dialect))

    assert_linear(execute, 1600)


_WORDS = st.sampled_from(
    [
        "G0", "G1", "G2", "G3", "G5", "G5.1", "G5.2", "G5.3", "G7", "G10", "G18", "G20", "G28",
        "G28.1", "G30", "G33", "G33.1", "G38.2", "G40", "G41", "G42.1", "G43", "G43.1", "G49",
        "G52", "G53", "G54", "G55", "G66", "G67", "G68", "G69", "G12", "G13", "G70", "G71", "G72",
        "G73", "G74", "G76", "G80", "G81", "G83", "G84", "G87", "G88", "G90", "G91", "G92", "G92.2",
        "G92.3", "G93", "G95", "G96", "G99", "M0", "M6", "M19", "M61", "M66", "M70", "M72", "M73",
        "M97", "M98", "M99", "M104", "M117 hi", "L2", "L20", "P1", "P100", "Q1", "X1", "X", "Y[2]",
        "Z-1", "I1", "J", "J2", "K1", "R2", "Q.5", "F60", "S100", "M3", "M4", "D1", "D3", "H1",
        "E1", "T1", "T0101", "U1", "A90", "@2", "^30", "#1=2", "#5221", "o1 sub", "o1 endsub",
        "o1 call", "O100", "N10", "(", ")", ";", "%", "$H", "\x00", "é", "\x85", "[", "]", "=",
        "M2", "G4", "/", "$1", '"a"', "{x}", "*12",
    ]
)  # fmt: skip


@fewer(12)
@given(
    st.lists(st.lists(_WORDS, max_size=7).map(" ".join), max_size=14),
    st.sampled_from(["", *DIALECTS]),
)
def test_any_text_is_executed_or_stops(lines, dialect):
    text = "\n".join(lines)
    executed = run_gcode(
        {"a.nc": text},
        RunRequest(
            dialect, {"t1.diameter": 3.0}, limits=Limits(gcode_steps=2000, gcode_motions=5000)
        ),
    )
    assert len(executed.body) == len(executed.lines)
    assert not executed.frame or len(executed.frame) == len(executed.body)
    assert all(1 <= line <= len(lines) for line in executed.lines)
    assert list(executed.findings) == sorted(executed.findings, key=lambda finding: finding.line)
    assert executed.stopped is None or executed.stopped[1]


@given(st.text(max_size=200), st.sampled_from(["", *DIALECTS]))
def test_random_characters_never_raise(text, dialect):
    run_gcode({"a.nc": text}, RunRequest(dialect))
    GCODE.recognise(text)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (("#100=2", "IF[#100 GT 1]GOTO 20", "G1 X9", "N20 G1 X3"), [(3, 0, 5)]),
        (("#100=0", "IF[#100 GT 1]GOTO20", "G1 X9", "N20 G1 X3"), [(9, 0, 5), (3, 0, 5)]),
        (("GOTO 20", "G1 X9", "N20 G1 X3"), [(3, 0, 5)]),
        (
            ("#1=0", "WHILE[#1 LT 3]DO1", "G1 X#1", "#1=#1+1", "END1", "G1 Y1"),
            [(0, 0, 5), (1, 0, 5), (2, 0, 5), (2, 1, 5)],
        ),
        (("IF[1 EQ 1]THEN #5=7", "G1 X#5"), [(7, 0, 5)]),
        (("WHILE[0 EQ 1]DO2", "G1 X9", "END2", "G1 Y1"), [(0, 1, 5)]),
        (("#1=2", "#2=#1*3-1", "G1 X#2"), [(5, 0, 5)]),
        (("#1=2", "IF[#1 EQ 2]THEN #1=#1+5", "G1 X#1"), [(7, 0, 5)]),
        (("#1=2 G1 X4", "G1 Y#1"), [(4, 0, 5), (4, 2, 5)]),
    ],
)
def test_a_macro_of_fanuc_has_jumps_loops_and_conditions(lines, expected):
    assert end_points(run(*lines, dialect="fanuc")) == expected


def test_a_jump_to_another_file_ends_the_run_and_m99_returns_to_its_line():
    """GOTO leads from a main program to a line of another file. M99 P names a line."""
    macro = {"900.nc": "G1 X1\nM99 P20\nN30 G1 X9\nM30"}
    lines = ("M98 P900", "G1 X7", "N20 G1 X2")
    assert end_points(run(*lines, dialect="fanuc", files=macro)) == [(1, 0, 5), (2, 0, 5)]
    executed = run("G1 X1", "GOTO 30", "G1 X7", dialect="fanuc", files=macro)
    assert [item.target.origin[0] for item in executed.body if isinstance(item, MoveL)] == [1.0]


def test_a_macro_with_block_delete_is_skipped():
    lines = ("#1=0", "/IF[#1 EQ 0]GOTO 20", "G1 X1", "N20 G1 X2")
    assert end_points(run(*lines, dialect="fanuc")) == [(2, 0, 5)]
    executed = run_gcode(
        {"a.nc": "\n".join([*LEAD, *lines])}, RunRequest("fanuc", {"block_delete": 1.0})
    )
    assert end_points(executed) == [(1, 0, 5), (2, 0, 5)]


def test_a_fault_in_the_condition_of_an_elseif_is_refused_at_its_line():
    executed = run("o1 if [0]", "G1 X1", "o1 elseif [#<a>]", "G1 X2", "o1 endif")
    assert list_findings(executed, "refused") == [(6, "#<a> is used before it is set")]


def test_a_subroutine_is_called_by_an_expression():
    subs = ("o101 sub", "G1 X1", "o101 endsub", "o102 sub", "G1 X2", "o102 endsub")
    executed = run(*subs, "#3=2", "o[100+#3] call", "o[#3-1+100] call", "o[7] call")
    assert end_points(executed) == [(2, 0, 5), (1, 0, 5)]
    assert (
        executed.assumed[-1].what == "o7 call: the subroutine is not in this file; it is left out"
    )


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("#1=2", "cannot read '#1=2': grbl takes letters with plain numbers alone"),
        ("G1 X[1+2]", "cannot read 'x[1+2]': grbl takes letters with plain numbers alone"),
        ("G1 X--1", "cannot read 'x--1': grbl takes letters with plain numbers alone"),
        ("G1 X1 A5", "A is not a word of grbl"),
        ("G2 I5", "G2 names neither X nor Y: grbl rejects it"),
        ("M7 M8", "M7 and M8 are of one group (coolant)"),
    ],
)
def test_a_line_that_grbl_refuses_is_refused(line, what):
    assert list_findings(run(line, dialect="grbl"), "refused")[0][1] == what


def test_a_macro_gets_arguments():
    end = ("M30", "O900", "G1 X#24 Y#2", "M99")
    assert end_points(run("#2=5", "G65 P900 X4 B6", "G1 Z#2", end=end, dialect="fanuc")) == [
        (4, 6, 5),
        (4, 6, 5),
    ]


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("GOTO 77", "a jump to N77, which no line has"),
        ("END1", "END1 has no WHILE or DO before it"),
        ("WHILE[1]DO1", "WHILE DO1 has no END1"),
    ],
)
def test_a_jump_without_a_target_and_a_loop_without_an_end_are_refused(line, what):
    lines = ["#1=0", "WHILE[#1]DO1"] if line.startswith("WHILE") else [line]
    executed = run(*lines, dialect="fanuc")
    assert [finding.what for finding in executed.findings] == [what]
