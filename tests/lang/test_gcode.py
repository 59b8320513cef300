"""Runs G-code of other programs: words, parameters, flow, offsets, cycles and refusals."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode import interpret
from camgen.lang.gcode.machine import Machine
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.program import MoveC, MoveJ, MoveL, Output, Wait
from camgen.read import inspect, read

EXPONENT = "is a number with an exponent, which G-code does not have; write it with its decimals"


def run(*lines, lead=("G21 G90", "G0 X0 Y0 Z0", "F600")):
    return interpret([*lead, *lines])


def end_points(executed):
    """The rounded end points of the motions after the lead, whose rapid is the first motion, mm."""
    assert executed.stopped is None, executed.stopped
    motions = [item for item in executed.body if isinstance(item, MoveJ | MoveL | MoveC)]
    return [tuple(np.round(motion.target.origin, 6)) for motion in motions[1:]]


def find_refusal(*lines, lead=("G21 G90", "G0 X0 Y0 Z0", "F600")):
    """The line, counted after the lead, and the reason at which a run stops."""
    executed = run(*lines, lead=lead)
    assert executed.stopped is not None
    return executed.stopped[0] - len(lead), executed.stopped[1]


def test_units_increments_and_feeds_are_converted_to_mm():
    executed = run("G1 X10 F120", "G20", "Y1", "F60", "G91 X1", "G21 X-1.5")
    assert end_points(executed) == [(10, 0, 0), (10, 25.4, 0), (35.4, 25.4, 0), (33.9, 25.4, 0)]
    # The feed is 120 mm/min, then 60 inches per minute.
    speeds = [item.speed for item in executed.body if isinstance(item, MoveL)]
    assert speeds == pytest.approx([2.0, 2.0, 25.4, 25.4])


@pytest.mark.parametrize(
    "lead",
    [
        ("G53 G0 Z0", "G0 X1 Y2", "G0 Z3"),
        ("G0 Z9", "G53 G0 Z0", "G0 X1 Y2", "Z3"),
        ("g53 g0 z0", "G0 X1 Y2 Z3"),
    ],
)
def test_a_motion_to_the_top_of_the_machine_is_not_an_instruction(lead):
    """After G53 G0 Z0 no motion is emitted until X, Y and Z in the work frame are known."""
    executed = interpret(["G21 G90", *lead, "G1 X5 F60", "M2"])
    assert executed.stopped is None
    assert [(type(item), item.target.origin) for item in executed.body] == [
        (MoveJ, (1, 2, 3)),
        (MoveL, (5, 2, 3)),
    ]
    assert not executed.remarks


def test_a_cut_from_the_top_of_the_machine_starts_at_an_assumed_height():
    executed = interpret(["G21 G90", "G0 Z9", "G53 G0 Z0", "G0 X1 Y2", "G1 Z-1 F60", "M2"])
    assert [item.target.origin for item in executed.body] == [(1, 2, 0), (1, 2, -1)]
    assert [str(note) for _, note in executed.remarks] == [
        "assumed: the program begins at Z0 (it does not say where)"
    ]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("G53", "G53 without G0 or G1"),
        ("G53 G2 X1 I1", "G53 without G0 or G1"),
        ("G91 G53 G0 Z0", "G53 among increments (G91)"),
    ],
)
def test_a_use_of_g53_that_linuxcnc_refuses_is_refused(line, why):
    assert find_refusal(line, lead=()) == (1, why)


def test_spellings_of_a_line_are_equivalent():
    expected = run("G1 X1.5 Y-2", "X3")
    for spelling in (
        ("g01x+1.50y-2.", "x3"),
        ("N10 G1X1.5 (a) Y - 2.0 ; rest", "\tX 3"),
        ("/g1 x1.5 y[1-3]", "x#4", "x3"),
    ):
        assert end_points(run(*spelling))[0] == end_points(expected)[0]


@pytest.mark.parametrize(
    ("line", "end", "via"),
    [
        ("G2 X10 Y10 I10 J0", (10, 10, 0), (10 - 10 * math.sqrt(0.5), 10 * math.sqrt(0.5), 0)),
        ("G3 X10 Y10 R10", (10, 10, 0), (10 * math.sqrt(0.5), 10 - 10 * math.sqrt(0.5), 0)),
        ("G18 G3 X10 Z10 I10 K0", (10, 0, 10), (10 - 10 * math.sqrt(0.5), 0, 10 * math.sqrt(0.5))),
        ("G19 G2 Y10 Z10 J10 K0", (0, 10, 10), (0, 10 - 10 * math.sqrt(0.5), 10 * math.sqrt(0.5))),
        (
            "G90.1 G2 X10 Y10 I10 J0",
            (10, 10, 0),
            (10 - 10 * math.sqrt(0.5), 10 * math.sqrt(0.5), 0),
        ),
    ],
)
def test_an_arc_has_its_via_point_half_way(line, end, via):
    """The via point of a quarter circle is at 45 deg. In G18 X is the second axis, hence G3."""
    (arc,) = (item for item in run(line).body if isinstance(item, MoveC))
    assert arc.via.origin == pytest.approx(via, abs=1e-9)
    assert arc.target.origin == pytest.approx(end, abs=1e-9)


def test_a_full_circle_becomes_two_half_circles():
    arcs = [item for item in run("G2 I5").body if isinstance(item, MoveC)]
    assert [arc.target.origin for arc in arcs] == [
        pytest.approx((10, 0, 0)),
        pytest.approx((0, 0, 0), abs=1e-9),
    ]
    assert arcs[0].via.origin == pytest.approx((5, 5, 0))


def test_the_usual_first_line_of_a_mill_is_accepted():
    """In many controllers, also in LinuxCNC, G80 is in another modal group than G0."""
    assert end_points(run("G0 G17 G40 G49 G80 G90 G94", "X1", "G80 G1 X2", "X3")) == [
        (1, 0, 0),
        (2, 0, 0),
        (3, 0, 0),
    ]


def test_a_helix_becomes_lines():
    executed = run("G3 X0 Y0 Z-4 I5 P2")
    points = [item.target.origin for item in executed.body if isinstance(item, MoveL)]
    assert points[-1] == pytest.approx((0, 0, -4))
    for k, (x, y, z) in enumerate(points, 1):
        angle = 4 * math.pi * k / len(points)
        assert (x, y) == pytest.approx((5 - 5 * math.cos(angle), -5 * math.sin(angle)), abs=1e-9)
        assert z == pytest.approx(-4 * k / len(points))


def test_parameters_have_numbers_names_and_expressions():
    lines = (
        "#1=2",
        "#<a>=[#1 * 3 ** 2 - 1]",
        "G1 X#<a> Y[ATAN[1]/[1]] Z-#1",
        "#1=7 X#1",
        "X[#5420 + 1] Y[#5421 * 2]",
    )
    assert end_points(run(*lines)) == [(17, 45, -2), (2, 45, -2), (3, 90, -2)]


def test_branches_loops_and_subroutines_are_run():
    lines = (
        "o1 sub",
        " o2 if [#1 GT 1]",
        "  G1 X#1",
        "  o1 call [#1 - 1]",
        " o2 else",
        "  G1 Y#2",
        " o2 endif",
        "o1 endsub [#1]",
        "o1 call [3]",
        "#3=0",
        "o5 while [#3 LT 2]",
        "#3=[#3+1]",
        "G1 Z#3",
        "o5 endwhile",
        "o6 repeat [3]",
        "G91 G1 X1",
        "G90",
        "o6 endrepeat",
        "o7 do",
        "#3=[#3-1]",
        "o8 if [#3 LT 0]",
        "o7 break",
        "o8 endif",
        "o7 while [1]",
        "G1 Y[#<_value>]",
    )
    expected = [
        (3, 0, 0),
        (2, 0, 0),
        (2, 0, 0),
        (2, 0, 1),
        (2, 0, 2),
        (3, 0, 2),
        (4, 0, 2),
        (5, 0, 2),
        (5, 3, 2),
    ]
    assert end_points(run(*lines)) == expected


def test_a_program_stops_at_its_limits():
    line, why = find_refusal("o1 while [1]", "o1 endwhile")
    assert line in (1, 2)
    assert (
        why
        == "the program has not ended after 500,000 steps in loops and calls (limits.gcode_steps)"
    )
    assert find_refusal("o1 sub", "o1 call", "o1 endsub", "o1 call")[1].startswith(
        "o1 call: more than 10 subroutines"
    )
    assert "pieces" in find_refusal("G2 I900000 Z1")[1]
    assert "pecks" in find_refusal("G83 X1 Z-100 R1 Q0.0001")[1]
    assert "nested too deeply" in find_refusal("G1 X" + "[" * 100_000)[1]


def test_polar_words_are_radius_and_angle():
    """They count from the origin, which G92 has moved by 10 mm, and add up in G91."""
    executed = run("G1 @10 ^0", "^90", "@5", "G91 ^90 @5", "G90 G92 X0", "@10 ^180")
    assert end_points(executed) == [(10, 0, 0), (0, 10, 0), (0, 5, 0), (-10, 0, 0), (-20, 0, 0)]
    why = "a polar word (@, ^) outside G17, or beside X and Y"
    assert find_refusal("G18 G1 @1 ^1") == (1, why)
    assert find_refusal("G1 X1 ^1") == (1, why)
    assert find_refusal("G1 ^1") == (1, "a polar word (@, ^) alone or in G91, from the origin")


def test_g92_and_g10_shift_the_origin():
    executed = run(
        "G1 X10", "G92 X0", "X5", "G92.1", "X5", "G10 L20 P1 X100", "X101", "G10 L2 P2 X0", "X102"
    )
    assert end_points(executed) == [(10, 0, 0), (15, 0, 0), (5, 0, 0), (6, 0, 0), (7, 0, 0)]
    known = (
        "G10 L2 P1 X1",
        "G10 L2 P2 X11 Y0 Z0",
        "G10 L2 P1 Y0 Z0",
        "G0 X0 Y0 Z0",
        "G1 F60 X1",
        "G55 X1",
    )
    assert end_points(run(*known, lead=("G21",))) == [(1, 0, 0), (11, 0, 0)]
    assert find_refusal("G1 X1", "G55 X1") == (
        2,
        "G55 after motions in G54: how far apart they are is known to the machine alone",
    )


def test_the_first_position_is_that_of_the_program_or_an_assumption():
    executed = interpret(["G21", "G0 Z5", "G0 X1", "Y2", "G1 X3 F60", "M2"])
    assert isinstance(executed.body[0], MoveJ)
    assert executed.body[0].target.origin == (1, 2, 5)
    assert (executed.held, executed.entry, executed.remarks) == (2, 0.0, ())
    executed = interpret(["G21", "G0 X1 Y1", "G1 Z-1 F60", "M2"])
    assert [item.target.origin for item in executed.body] == [(1, 1, 0), (1, 1, -1)]
    assert executed.entry == 1.0
    assert [str(note) for _, note in executed.remarks] == [
        "assumed: the program begins at Z0 (it does not say where)",
    ]


def test_a_line_with_block_delete_is_run_and_noted():
    executed = run("/G1 X5", "/X6")
    assert end_points(executed) == [(5, 0, 0), (6, 0, 0)]
    assert [str(note) for _, note in executed.remarks] == [
        "assumed: lines with / are run (whether they are depends on a switch of the operator)",
    ]


def test_outputs_and_waits_are_instructions():
    executed = run(
        "M3 S1000", "G4 P0.5", "S500", "M8", "M64 P2", "M67 E1 Q2.5", "G1 X1", "M9", "M5", "M2"
    )
    assert [item for item in executed.body if isinstance(item, Output | Wait)] == [
        Output("spindle", 1000),
        Wait(0.5),
        Output("spindle", 500),
        Output("flood", 1),
        Output("dout2", 1),
        Output("aout1", 2.5),
        Output("flood", 0),
        Output("spindle", 0),
    ]


def test_the_end_switches_off_all_outputs_that_are_on():
    executed = run("M4 S900", "M7", "G1 X1", "M30", "G1 X9")
    assert [item for item in executed.body if isinstance(item, Output)][-2:] == [
        Output("spindle", 0.0),
        Output("mist", 0.0),
    ]
    assert Output("spindle", -900.0) in executed.body
    assert end_points(executed) == [(1, 0, 0)]


def test_a_spindle_without_a_speed_is_the_output_process():
    assert [item for item in run("M3", "G1 X1", "M5").body if isinstance(item, Output)] == [
        Output("process", 1.0),
        Output("process", 0.0),
    ]


def test_feeds_count_per_time_or_per_turn():
    """G93 moves 10 mm in half a minute; in G95 0.1 mm per turn at 600 rpm is 60 mm/min."""
    executed = run("G93 G1 X10 F2", "G94 F60 X0", "M3 S600", "G95 F0.1", "X10")
    assert [item.speed for item in executed.body if isinstance(item, MoveL)] == pytest.approx(
        [10 / 30, 1.0, 1.0]
    )
    assert find_refusal("G93 G1 X1 F1", "X2") == (
        2,
        "G1 without F: with G93 every motion has its own",
    )
    assert find_refusal("G95 F1 G1 X1") == (1, "a feed per turn (G95) while the spindle stands")


def test_exact_stop_and_exact_path_have_no_blends():
    executed = run("G1 X1", "G61", "X2", "G64 P0.1", "X3", "G61.1 X4")
    assert [item.blend for item in executed.body if isinstance(item, MoveL)] == [1.0, 0.0, 1.0, 0.0]


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        (
            ["G41 D1"],
            "G41: the path depends on the radius of tool 1, which is not known; give tool 1 "
            "a row of [[tools]] with "
            'its number and diameter, or operation.compensation = "as-programmed"',
        ),
        (["G38.2 Z-1"], "G38.2 probes: how far it goes is not in the text"),
        (
            ["G84 Z-1 R1"],
            "G84 taps: the spindle keeps step with the feed, for which programs here have no word",
        ),
        (
            ["G74 Z-1 R1"],
            "G74 taps: the spindle keeps step with the feed, for which programs here have no word",
        ),
        (
            ["G33 Z-1 K1"],
            (
                "G33 cuts a thread: the spindle keeps step with the feed, for which programs "
                "here have no word"
            ),
        ),
        (["G87 X1 Z-1 R1 K1 I1"], "G87 stops the spindle at an angle and goes in beside the hole"),
        (["G88 X1 Z-1 R1 P1"], "G88 lets the operator bring the tool up"),
        (
            ["S100 M3", "G96 D9 S9"],
            "G96 is of a lathe: the spindle turns faster towards the centre",
        ),
        (["M19 R9"], "M19 turns the spindle to an angle"),
        (["G7"], "G7 is of a lathe: X is a diameter"),
        (["M150"], "M150: a program or remap of the user's"),
        (["G5 X1"], "G5 without P and Q"),
        (["G66"], "G66 is not a code of linuxcnc"),
        (["M66 P0 L3 Q1"], "M66 waits for an input"),
        (["M98 P1"], "M98 P1: the subprogram is not in this file"),
        (["A90"], "axis A moves: only X, Y and Z are replayed"),
        (["G0 G1 X1"], "G0 and G1 are of one group (motion)"),
        (["G1 X1 X2"], "word X twice in one line"),
        (["G1 X1 H3"], "word H3: nothing in the line uses it"),
        (["G80", "X1"], "axis words without a motion code (G0, G1, G2, G3)"),
        (["G1 X1e3"], f"X1e3 {EXPONENT}"),
        (["G1 X#<none>"], "#<none> is used before it is set"),
        (["G1 X#5161"], "#5161 is a value of the machine"),
        (["G1 X[1/0]"], "1 / 0 has no value"),
        (["G1 X[SQRT[-1]]"], "SQRT[-1] has no value"),
        (["G1 X1 (open"], "a comment that is not closed, or closed twice"),
        (["o9 call"], "o9 call: the subroutine is not in this file"),
        (["F0", "G1 X1"], "G1 without a feed (F)"),
        (["G2 X1"], "arc without a centre or radius (I, J, K or R) in its plane"),
        (["G81 X1 Z-1"], "G81 without R"),
        (["G81 X1 Z2 R1"], "G81 begins (R) below its end"),
        (["G1 X99999999"], "word X99999999 is out of range"),
        ([";py,print(1)"], "a line of Python"),
    ],
)
def test_a_line_that_cannot_be_run_is_refused_with_its_reason(lines, why):
    assert find_refusal(*lines) == (len(lines), why)


@pytest.mark.parametrize(
    ("lines", "line", "why"),
    [
        (["o1 if [1]"], 1, "o1 if has no end"),
        (["o1 endif"], 1, "o1 endif has no if before it"),
        (["o1 if [1]", "o2 endif"], 2, "o2 endif has no if before it; o1 if is open"),
        (["o1 break"], 1, "o1 break is not in such a loop"),
        (["o1 sub", "o1 endsub", "o1 sub", "o1 endsub"], 3, "o1 sub is there twice"),
    ],
)
def test_an_unclosed_block_is_found_before_the_run(lines, line, why):
    executed = run(*lines)
    assert executed.body == ()
    assert executed.stopped == (3 + line, why)


_WORDS = st.sampled_from(
    [
        "G0", "G1", "G2", "G3", "G20", "G21", "G90", "G91", "G81", "G83", "G80", "G92", "G10", "L2",
        "P1", "X1", "Y[2]", "Z-1", "I1", "J", "R2", "Q.5", "F60", "S1", "M3", "M5", "M6", "T1",
        "#1=2", "#<a>", "o1 sub", "o1 endsub", "o1 call", "o2 while [#1]", "o2 endwhile", "(", ")",
        ";", "%", "\x00", "é", "[", "]", "=", "**", "M2", "G4", "A1", "N5", "/",
    ]
)  # fmt: skip


@given(st.lists(st.lists(_WORDS, max_size=6).map(" ".join), max_size=12))
def test_any_text_is_run_or_stops_with_a_reason(lines):
    executed = interpret(lines)
    assert len(executed.body) == len(executed.lines)
    assert all(1 <= line <= len(lines) for line in executed.lines)
    assert executed.stopped is None or (
        1 <= executed.stopped[0] <= len(lines) and executed.stopped[1]
    )


_NUMBER = st.decimals(-50, 50, places=3).map(str)
_MOTION = st.tuples(
    st.sampled_from(["G0 ", "G1 ", "", "G01", "N7 "]),
    _NUMBER,
    _NUMBER,
    st.sampled_from(
        ["", " F90", "Z1", " (X9)", ";X9", " (a,b)", "(open", " Z1 (a) (b)", "; py,1", " G4"]
    ),
)


@given(st.lists(_MOTION, min_size=1, max_size=20), st.sampled_from(["G20", "G21"]))
def test_the_fast_path_gives_the_motions_of_the_parser(motions, unit):
    lines = [
        unit,
        "G0 X0 Y0 Z0",
        "F60",
        "G1 X1",
        *(f"{word}X{x}Y{y}{rest}" for word, x, y, rest in motions),
        "G2 I3",
        "G3 X1 R9",
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Machine, "is_settled", lambda _: False)
        by_parser = interpret(lines)
    by_column = interpret(lines)
    assert [(type(item), item.target.origin, item.speed) for item in by_column.body] == [
        (type(item), item.target.origin, item.speed) for item in by_parser.body
    ]
    assert (by_column.lines, by_column.stopped) == (by_parser.lines, by_parser.stopped)


def write_file(tmp_path: Path, text: str, name: str = "old.ngc") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode("latin-1"))
    return path


def test_an_error_names_file_line_and_reason(tmp_path):
    with pytest.raises(InputError) as error:
        read(write_file(tmp_path, "G21\r\nG0 X0\r\nG38.2 Z0\r\n"), Job())
    assert str(error.value) == (
        "old.ngc: G38.2 probes: how far it goes is not in the text (line 3); correct the line, "
        "or build from the drawing"
    )


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "is empty"),
        ("\0\0G1", "is not a text"),
        ("G21\nG0 X1\nM2\n", "holds no motion at feed (G1, G2, G3 or a cycle)"),
    ],
)
def test_a_file_without_a_program_is_refused(tmp_path, text, what):
    with pytest.raises(InputError) as error:
        read(write_file(tmp_path, text), Job())
    assert error.value.what == what


def test_inspect_describes_a_program(tmp_path):
    path = write_file(
        tmp_path, "G20 G90\nG0 X0 Y0 Z1\nM3 S100\nG1 Z0 F60\nX2\nG2 X0 I-1\nG33 K1\n", "old.tap"
    )
    assert str(inspect(path, Job())).split("\n") == [
        "G-code of 7 lines, units inch",
        "does: 1 rapid motion, 3 lines, 1 arc, 2 outputs, 0 waits",
        "work: x 0 to 50.8, y -25.4 to 0, z 0 to 0 mm",
        # The thread has a pitch of an inch, at 100 rpm.
        "feeds: 25.4 to 42.333 mm/s",
        "outputs: spindle",
        "cannot be replayed: line 7: G33 cuts a thread: the spindle keeps step with the "
        "feed, for which programs here "
        "have no word",
    ]
