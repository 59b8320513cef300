"""G-code of others: what a program does in each dialect, what is assumed, what is found. It never raises."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode.dialects import DIALECTS
from camgen.lang.gcode.language import GCODE, GRBL_LANGUAGE, run_gcode
from camgen.lang.programs import RunRequest, find_language
from camgen.model.limits import Limits
from camgen.model.program import MoveC, MoveJ, MoveL, Output, Stop, ToolChange, Wait
from tests.support.examples import fewer
from tests.support.steps import assert_linear

LEAD = ("G21 G90 G17", "G0 X0 Y0 Z5", "F600 S1000 M3")


def run(*lines, dialect="linuxcnc", lead=LEAD, end=("M2",), files=None, **assume):
    text = "\n".join([*lead, *lines, *end]) + "\n"
    given = {key.replace("_", "."): value for key, value in assume.items()}
    return run_gcode({"main.ngc": text} | (files or {}), RunRequest(dialect, given))


def ends(found):
    """Where the motions after the lead end."""
    assert found.stopped is None, found.stopped
    assert not [one for one in found.findings if one.level == "refused"], found.findings
    moves = [item for item in found.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return [tuple(round(v, 3) + 0.0 for v in item.target.origin) for item in moves[1:]]


def told(found, level):
    return [(one.line, one.what) for one in found.findings if one.level == level]


def waits(found):
    return [item.seconds for item in found.body if isinstance(item, Wait)]


def test_the_languages_are_installed():
    assert find_language("gcode").about == GCODE.about
    assert find_language("grbl").about == GRBL_LANGUAGE.about
    assert set(GCODE.dialects) == set(DIALECTS) == {
        "linuxcnc", "grbl", "fanuc", "fanuc-lathe", "mach3", "marlin", "iso",
    }  # fmt: skip
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


def test_an_ngc_file_is_linuxcncs_where_nothing_else_shows():
    assert dict(run_gcode({"a.ngc": "G0 X1\n"}, RunRequest()).facts)["dialect"] == "linuxcnc (.ngc)"


def test_an_ngc_file_with_a_probe_that_linuxcnc_lacks_is_of_another_controller():
    """gcodetools names all its files .ngc. rs274 says of G31: unknown g code used."""
    executed = run_gcode({"a.ngc": "G21\nG31 Z-10 F500\nG1 X1\n"}, RunRequest())
    assert dict(executed.facts)["dialect"] == "iso (G31)"
    assert not told(executed, "refused")
    executed = run_gcode({"a.ngc": "G21\nG64 P0.1\nG31 Z-10 F500\nM2\n"}, RunRequest())
    assert told(executed, "refused") == [(3, "G31 is not a code of linuxcnc")]


@pytest.mark.parametrize(
    ("text", "known"),
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
def test_g_code_is_known_by_its_text(text, known):
    assert GCODE.recognise(text) is known


@pytest.mark.parametrize(
    ("dialect", "line", "seconds"),
    [
        ("linuxcnc", "G4 P2", [2.0]), ("grbl", "G4 P2", [2.0]), ("mach3", "G4 P2", [2.0]),
        ("fanuc", "G4 P500", [0.5]),
        ("fanuc", "G4 X1.5", [1.5]), ("fanuc", "G4 U2", [2.0]), ("fanuc", "G4 P2.", [2.0]), ("marlin", "G4 S2", [2.0]),
        ("marlin", "G4 P500", [0.5]), ("fanuc", "G82 X1 Z-1 R2 P500 F60", [0.5]),
        ("linuxcnc", "G82 X1 Z-1 R2 P0.5", [0.5]),
    ],
)  # fmt: skip
def test_a_wait_in_the_unit_of_its_controller(dialect, line, seconds):
    assert waits(run(line, dialect=dialect)) == seconds


def test_increments_of_fanuc_and_diameters_of_its_lathes():
    assert ends(run("G0 X10 Y5", "U5 W-1", dialect="fanuc")) == [(10, 5, 5), (15, 5, 4)]
    found = run(
        "G0 X10 Z5",
        "U4",
        "G99 G1 Z0 F0.2",
        dialect="fanuc-lathe",
        lead=("G21", "G0 X0 Z5", "G97 S600 M3"),
    )
    moves = [item for item in found.body if isinstance(item, MoveL)]
    assert [item.target.origin for item in moves] == [(7, 0, 0)]
    assert moves[0].speed == pytest.approx(0.2 * 600 / 60)
    assert "X is a diameter (as on most lathes)" in [one.what for one in found.assumed]


def test_subprograms_by_number_in_this_file_and_in_others():
    sub = ["O100", "G91 G1 X1", "G90 M99"]
    assert ends(run("M98 P100 L3", end=("M2", *sub))) == [(1, 0, 5), (2, 0, 5), (3, 0, 5)]
    assert ends(run("M98 P30100", end=("M2", *sub), dialect="fanuc")) == [
        (1, 0, 5),
        (2, 0, 5),
        (3, 0, 5),
    ]
    other = {"O100.nc": "G91 G1 X1\nG90\nM99\n"}
    assert ends(run("M98 P100", "G1 Y2", files=other)) == [(1, 0, 5), (1, 2, 5)]
    assert ends(run("o<a> call [4]", files={"a.ngc": "o<a> sub\nG1 X#1\no<a> endsub\n"})) == [
        (4, 0, 5)
    ]
    found = run("M98 P7", "G1 X1")
    assert ends(found) == [(1, 0, 5)]
    assert found.assumed[0].what == "M98 P7: the subprogram is not in this file; it is left out"
    assert ends(run("M97 P50", "G1 X9", end=("M30", "N50 G1 Y3", "M99"), dialect="fanuc")) == [
        (0, 3, 5),
        (9, 3, 5),
    ]


def test_the_end_of_the_first_file_is_the_end():
    found = run("G1 X1", end=(), files={"b.ngc": "G1 X99\n"})
    assert ends(found) == [(1, 0, 5)]


def test_stops_and_tool_changes():
    found = run("M0", "M1", "T2 M6", "G1 X1", "M60")
    kinds = [
        (type(item), getattr(item, "optional", None))
        for item in found.body
        if isinstance(item, Stop | ToolChange)
    ]
    assert kinds == [(Stop, False), (Stop, True), (ToolChange, None), (Stop, False)]
    assert [one.tool for one in found.frames] == ["", "T2"]
    assert len(found.frame) == len(found.body)
    assert dict(found.facts)["tools"] == "T2"


def test_stored_places_are_assumed_or_given():
    found = run("G1 Z-3", "G28", "G0 Z5", "X1 Y1")
    assert ends(found) == [(0, 0, -3), (0, 0, 5), (0, 0, 5), (1, 1, 5)]
    assert [one.key for one in found.assumed] == ["g28.x", "g28.y", "g28.z"]
    assert ends(run("G1 Z-3", "G28 Z0", g28_z=80.0)) == [(0, 0, -3), (0, 0, 0), (0, 0, 80)]
    assert ends(run("G53 G0 Z-10", machine_z=100.0)) == [(0, 0, 90)]
    assert ends(run("G28", dialect="marlin")) == [(0, 0, 0)]


def test_an_input_is_what_the_user_says():
    found = run("M66 P3 L3 Q5", "G1 X#5399")
    assert ends(found) == [(1, 0, 5)]
    assert (found.assumed[0].key, found.assumed[0].value) == ("din3", 1.0)
    assert ends(run("M66 P3 L0", "G1 X#5399", din3=1.0)) == [(1, 0, 5)]


def test_values_of_the_machine_are_zero_or_given():
    assert ends(run("G1 X[#5221+1] Y#<_hal[a.b]>")) == [(1, 0, 5)]
    found = run_gcode(
        {"a.ngc": "G21 G90\nG0 X0 Y0 Z0\nG1 X#5221 F60\nM2\n"}, RunRequest("", {"#5221": 7.0})
    )
    assert found.body[-1].target.origin == (7, 0, 0)


def test_a_probe_runs_to_its_end():
    found = run("G38.2 Z-5", "G1 X#5063", "G0 Z#5070")
    assert ends(found) == [(0, 0, -5), (-5, 0, -5), (-5, 0, 1)]
    assert ends(run("G38.3 Z-5", "G0 Z#5070", probe=0.0)) == [(0, 0, -5), (0, 0, 0)]


def test_lines_with_a_slash_depend_on_a_switch():
    assert ends(run("/G1 X1", "G1 Y1")) == [(1, 0, 5), (1, 1, 5)]
    found = run_gcode(
        {"a.ngc": "\n".join([*LEAD, "/G1 X1", "G1 Y1", "M2"])},
        RunRequest("", {"block_delete": 1.0}),
    )
    assert ends(found) == [(0, 1, 5)]


def test_a_printer():
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
    found = run(*lines, dialect="marlin", lead=("G21 G90",), end=())
    assert [type(item) for item in found.body] == [MoveJ, MoveL, MoveL]
    assert [item.speed for item in found.body[1:]] == [20.0, 100.0]
    assert dict(found.facts)["filament"] == "-0.5 mm"
    assert not found.findings


def test_axes_that_turn_take_their_time():
    found = run("G1 A90 F360")
    assert waits(found) == [pytest.approx(15.0)]
    assert dict(found.facts)["axes that are not shown"] == "A (line 4)"


def test_splines_end_where_they_say_and_keep_to_their_hull():
    found = run("G5 X10 Y0 I0 J5 P0 Q5", "G5 X20 Y0 P0 Q-5", "G1 X25")
    points = ends(found)
    assert points[-1] == (25, 0, 5)
    assert (10, 0, 5) in points
    assert (20, 0, 5) in points
    assert max(y for _, y, _ in points) == pytest.approx(
        3.75, abs=0.01
    )  # of the middle: 3/4 of the height of the points
    assert min(y for _, y, _ in points) == pytest.approx(-3.75, abs=0.01)
    square = ends(run("G5.1 X10 Y0 I5 J5"))
    assert max(y for _, y, _ in square) == pytest.approx(2.5, abs=0.01)


def test_a_nurbs_of_a_quarter_circle_is_one():
    """Three points with weights 1, sqrt(1/2), 1 and order 3."""
    points = ends(run("G0 X10 Y0", "G5.2 P1 L3", "X10 Y10 P0.70710678", "X0 Y10 P1", "G5.3"))
    assert points[-1] == (0, 10, 5)
    assert all(abs((x * x + y * y) ** 0.5 - 10) < 0.002 for x, y, _ in points)


def test_a_cut_behind_a_tool_change_that_stopped_the_spindle_is_dangerous():
    what = "cuts with a spindle that does not turn: M6 stopped it (line 5), and no M3 follows"
    assert told(run("G1 X1", "T2 M6", "G0 X5", "G1 Z-1", "X9"), "dangerous") == [(7, what)]
    assert told(run("G1 X1", "T2 M6", "G81 X1 Y1 Z-1 R1"), "dangerous") == [(6, what)]
    assert told(run("G1 X1", "T2 M6", "S900 M3", "G1 Z-1"), "dangerous") == []
    assert told(run("G1 X1", "M5", "T2 M6", "G1 Z-1"), "dangerous") == []


def test_motions_by_column_do_not_hide_that_the_tool_is_lower_after_g49():
    level = [f"G1 X{number}" for number in range(40)]
    assert told(run("G43 H1", "G1 Z1", "G49", *level, "G1 Z4", *level), "dangerous") == [
        (47, "Z moves after G49 without the length of the tool: its tip goes lower by as much")
    ]


def test_minus_zero_is_zero_whatever_was_read_before():
    for line in ("M-0", "M0", "M-0"):
        assert Stop() in list(run("G1 X1", line).body)


def test_levels_of_findings():
    assert told(run("G43 H1", "G1 Z1", "G49", "G1 Z4"), "dangerous") == [
        (7, "Z moves after G49 without the length of the tool: its tip goes lower by as much")
    ]
    assert told(run("G1 X1", end=()), "dangerous") == [
        (4, "the file ends with the spindle on, and without M2 or M30")
    ]
    assert told(run("M5", "G1 X1", end=()), "unusual") == [
        (5, "the program has no end (M2, M30 or per cent signs): LinuxCNC stops here with an error")
    ]
    assert told(run("G4 P500"), "unusual")[0][1].startswith("G4 P500 waits for 500 s")
    assert told(run("G92 X5", "G1 X1"), "unusual") == [
        (6, "the shift of the origin by G92 or G52 is still on at the end")
    ]
    assert told(run("F600", "G20 F60", "G1 X1"), "unusual") == [
        (5, "F60 counts in the unit before G20")
    ]
    assert told(run("G41.5"), "refused") == [(4, "G41.5 is not a code of linuxcnc")]
    assert told(run("M77", dialect="iso"), "refused") == []
    assert dict(run("M77", dialect="iso").facts)["not evaluated"] == "M77 (line 4)"


def test_a_code_that_may_move_something_stops_the_run():
    found = run("G1 X1", "G51 X0 Y0 P2", "G1 X2", dialect="fanuc")
    assert found.stopped == (5, "G51 is not known, and later lines depend on where it ends")
    assert found.lines[-1] == 4


def test_after_a_refused_line_the_run_goes_on():
    found = run("G1 X1 X2", "G1 Y3")
    assert told(found, "refused") == [(4, "word X twice in one line")]
    assert found.body[-2].target.origin == (0, 3, 5)
    assert isinstance(found.body[-1], Output)


def test_a_program_that_never_ends_is_stopped():
    found = run_gcode(
        {"a.ngc": "o1 while [1]\n#1=2\no1 endwhile\n"}, RunRequest(limits=Limits(gcode_steps=1000))
    )
    assert found.stopped is not None
    assert (
        found.stopped[1]
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
    ["G0", "G1", "G2", "G3", "G5", "G5.1", "G5.2", "G5.3", "G7", "G10", "G18", "G20", "G28", "G28.1", "G30",
     "G33", "G33.1", "G38.2", "G40", "G41", "G42.1", "G43", "G43.1", "G49", "G52", "G53", "G54", "G55", "G66",
     "G67", "G68", "G69", "G12", "G13",
     "G70", "G71", "G72", "G73", "G74", "G76", "G80", "G81", "G83", "G84", "G87", "G88", "G90", "G91", "G92", "G92.2",
     "G92.3", "G93", "G95", "G96", "G99", "M0", "M6", "M19", "M61", "M66", "M70", "M72", "M73", "M97", "M98",
     "M99", "M104", "M117 hi", "L2", "L20", "P1", "P100", "Q1", "X1", "X", "Y[2]", "Z-1", "I1", "J", "J2", "K1",
     "R2", "Q.5", "F60", "S100", "M3", "M4", "D1", "D3", "H1", "E1", "T1", "T0101", "U1", "A90", "@2", "^30",
     "#1=2", "#5221", "o1 sub", "o1 endsub", "o1 call", "O100", "N10", "(", ")", ";", "%", "$H", "\x00", "é",
     "\x85", "[", "]", "=", "M2", "G4", "/", "$1", '"a"', "{x}", "*12"]
)  # fmt: skip


@fewer(12)
@given(
    st.lists(st.lists(_WORDS, max_size=7).map(" ".join), max_size=14),
    st.sampled_from(["", *DIALECTS]),
)
def test_any_text_is_executed_or_stops(lines, dialect):
    text = "\n".join(lines)
    found = run_gcode(
        {"a.nc": text},
        RunRequest(
            dialect, {"t1.diameter": 3.0}, limits=Limits(gcode_steps=2000, gcode_motions=5000)
        ),
    )
    assert len(found.body) == len(found.lines)
    assert not found.frame or len(found.frame) == len(found.body)
    assert all(1 <= line <= len(lines) for line in found.lines)
    assert list(found.findings) == sorted(found.findings, key=lambda one: one.line)
    assert found.stopped is None or found.stopped[1]


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
def test_macros_of_fanuc(lines, expected):
    assert ends(run(*lines, dialect="fanuc")) == expected


def test_the_end_of_a_macro_and_its_jumps_belong_to_its_program():
    """GOTO from a main program to a line of another file ends it. M99 P returns to a line."""
    sub = {"900.nc": "G1 X1\nM99 P20\nN30 G1 X9\nM30"}
    lines = ("M98 P900", "G1 X7", "N20 G1 X2")
    assert ends(run(*lines, dialect="fanuc", files=sub)) == [(1, 0, 5), (2, 0, 5)]
    executed = run("G1 X1", "GOTO 30", "G1 X7", dialect="fanuc", files=sub)
    assert [item.target.origin[0] for item in executed.body if isinstance(item, MoveL)] == [1.0]


def test_a_deleted_macro_does_nothing():
    lines = ("#1=0", "/IF[#1 EQ 0]GOTO 20", "G1 X1", "N20 G1 X2")
    assert ends(run(*lines, dialect="fanuc")) == [(2, 0, 5)]
    executed = run_gcode(
        {"a.nc": "\n".join([*LEAD, *lines])}, RunRequest("fanuc", {"block_delete": 1.0})
    )
    assert ends(executed) == [(1, 0, 5), (2, 0, 5)]


def test_the_condition_of_an_elseif_is_refused_in_its_own_line():
    executed = run("o1 if [0]", "G1 X1", "o1 elseif [#<a>]", "G1 X2", "o1 endif")
    assert told(executed, "refused") == [(6, "#<a> is used before it is set")]


def test_a_subroutine_whose_number_is_worked_out():
    subs = ("o101 sub", "G1 X1", "o101 endsub", "o102 sub", "G1 X2", "o102 endsub")
    found = run(*subs, "#3=2", "o[100+#3] call", "o[#3-1+100] call", "o[7] call")
    assert ends(found) == [(2, 0, 5), (1, 0, 5)]
    assert found.assumed[-1].what == "o7 call: the subroutine is not in this file; it is left out"


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
def test_what_grbl_turns_down(line, what):
    assert told(run(line, dialect="grbl"), "refused")[0][1] == what


def test_a_macro_with_arguments():
    end = ("M30", "O900", "G1 X#24 Y#2", "M99")
    assert ends(run("#2=5", "G65 P900 X4 B6", "G1 Z#2", end=end, dialect="fanuc")) == [
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
def test_macros_that_lead_nowhere(line, what):
    found = run(
        *(["#1=0", "WHILE[#1]DO1"] if line.startswith("WHILE") else [line]), dialect="fanuc"
    )
    assert [one.what for one in found.findings] == [what]
