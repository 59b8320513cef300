"""G-code: the read-back of printed and of other texts, and its faults by line."""

import math
import random
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camgen.lang.programs import Finding
from camgen.model.errors import JobError
from camgen.model.program import MoveL
from camgen.post.plugins import find_readback
from tests.post.changes.gcode import TEXT
from tests.support.examples import fewer
from tests.support.fast_paths import list_values
from tests.support.gcode_programs import PART, SAFE, UNSAID, gcode, list_faults, read
from tests.support.rs274 import difference, posted, programs

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "gcode"
SLOW = settings(suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize(
    ("line", "options", "message"),
    [
        (
            "G53 G0 Z0",
            {"lift": False},
            "G53 has sent the tool to the machine's zero of Z, but post.lift is false",
        ),
        ("G53 G0 Z5", {}, "G53 is not read: goes to machine coordinates, which are not known here"),
        (
            "G53 G0 X0 Z0",
            {},
            "G53 is not read: goes to machine coordinates, which are not known here",
        ),
        (
            "G53 G1 Z0 F100",
            {},
            "G53 is not read: goes to machine coordinates, which are not known here",
        ),
        ("G49", {}, "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"),
        ("", {}, "X or Y moves while Z is not known; read as from 0"),
    ],
)
def test_a_text_without_the_lift_of_the_options_is_a_fault(line, options, message):
    text = f"{SAFE} G64 P0.01 Q0\n{line}\nG49\nG0 X1 Y2\nG0 Z3\nM2\n"
    assert message in [f.what for f in read(text, **options).findings]
    assert not read(text.replace(f"\n{line}\n", "\nG53 G0 Z0\n", 1)).findings


@SLOW
@given(programs(), st.integers(2, 5))
def test_the_reading_of_a_generated_program_is_the_program(plan, decimals):
    post = gcode(decimals=decimals)
    ready, text = posted(post, plan)
    assert difference(ready, read(text), post.tolerance()) == ""


def test_each_instruction_has_its_line():
    reading = read(TEXT)
    assert tuple(reading.lines) == (7, 8, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 24, 25, 26)
    assert difference(PART, reading, gcode().tolerance()) == ""


def test_a_text_without_one_of_its_lines_is_not_the_program():
    """Exceptions are comments, and a G49 before a G43."""
    for options in ({}, {"tool": 1}, {"lift": False}):
        ready, text = posted(gcode(**options), PART)
        lines = text.splitlines()
        for k, line in enumerate(lines):
            if line.startswith("(") or (line == "G49" and "tool" in options):
                continue
            reading = read("\n".join(lines[:k] + lines[k + 1 :]) + "\n", **options)
            assert difference(ready, reading, gcode().tolerance()), line


@pytest.mark.parametrize("word", ["G17", "G40", "G54", "G80", "G90", "G91.1", "G94"])
@pytest.mark.parametrize("options", [{}, {"lift": False}], ids=["lift", "no lift"])
def test_a_mode_that_is_not_set_is_a_remark_and_does_not_verify(word, options):
    """The previous program may have been aborted in another mode."""
    _, text = posted(gcode(**options), PART)
    if f"{word} " in text:
        without = text.replace(f"{word} ", "", 1)
    else:
        without = text.replace(f"{word}\n", "\n")
    first = next(k for k, line in enumerate(without.splitlines(), 1) if "G0 " in line)
    reading = read(without, **options)
    assert reading.findings == (Finding("unusual", first, f"{word} {UNSAID}"),)
    assert f"{word} not set" in difference(PART, reading, gcode(**options).tolerance())


def test_the_option_outputs_states_how_many_outputs_the_machine_has():
    more = TEXT.replace("M65 P0", "M65 P6\nM65 P0", 1)
    assert [fault.line for fault in read(more).findings] == [8]
    assert not read(more, outputs=8).findings
    assert not read(TEXT.replace("P0\n", "P7\n"), signals={"process": "P7"}).findings
    assert not read(more, signals={"process": "P0", "glue": "P6"}).findings
    assert not read(
        TEXT.replace("M64 P0", "M64 P0\nM68 E7 Q1"),
        force="analog",
        force_scale=1.0,
        force_channel=7,
    ).findings
    with pytest.raises(JobError, match="65 is not 1 to 64"):
        gcode(outputs=65)


def test_another_exact_path_mode_than_the_one_of_the_option_is_a_remark():
    exact = posted(gcode(path_tolerance=0.0), PART)[1]
    assert not read(exact, path_tolerance=0.0).findings
    findings = read(exact.replace("G61\n", "G61.1\n"), path_tolerance=0.0).findings
    assert findings == (
        Finding(
            "unusual", 6, "G61.1 where post.path_tolerance asks for G61: corners take another time"
        ),
    )


@pytest.mark.parametrize("step", range(1, 10))
def test_a_text_with_another_digit_is_not_the_program(step):
    passed = set()
    for k, character in enumerate(TEXT):
        line = TEXT.count("\n", 0, k)
        words = TEXT.splitlines()[line].split()
        if character.isdigit() and not words[0].startswith("("):
            other = TEXT[:k] + str((int(character) + step) % 10) + TEXT[k + 1 :]
            if not difference(PART, read(other), gcode().tolerance()):
                passed |= set(other.splitlines()[line].split()) - set(words)
    # The words that these replace have no effect there, and M62 switches with the next motion.
    assert passed <= {"G00", "G61.1", "G97", "G98", "G99", "M62", "M63"}


#: Finding of a line that is read as a line of a third-party program.
FOREIGN = "a word that camgen does not write; the program is read as LinuxCNC runs it"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("F9 G81 X1 Z-1 R2", FOREIGN),
        (
            "G10 L2 P1 X0",
            "G10 L2 moves G54 in X from 0; where it was, mm, is known to the machine "
            "alone; nothing "
            "from here on is read",
        ),
        ("G28", "G28 is not read: goes to a position that the machine stores"),
        ("G53 G0 Z0", "G53 is not read: goes to machine coordinates, which are not known here"),
        ("G93", FOREIGN),
        (
            "G41 D1",
            (
                "G41 is not read: cutter compensation: the controller moves the path by the "
                "radius of the tool"
            ),
        ),
        ("M60", "M60 is not read: waits for the operator: a program here runs through"),
        ("M66 P0 L3 Q5", "M66 is not read: waits for an input"),
        ("G77", "G77 is not read: not a code that is known"),
        ("#1 = 5", FOREIGN),
        ("G0 X[1+2]", FOREIGN),
        ("O100 sub", "o100 sub has no end; nothing from here on is read"),
        ("G0 X1 X2", "word X twice in one line"),
        ("G0 G1 X1", "G0 and G1 are of one group (motion)"),
        ("M3 M5", "M3 and M5 are of one group (spindle)"),
        ("M7 M8", "M7 and M8 are of one group (coolant)"),
        ("G80 G1 X1 F9", "G80 and G1 are of one group (motion)"),
        ("F9 G98 G83 X1 Z1 R1 Q1", "G83 with pecks and no depth"),
        ("G1", "G1 without a feed (F)"),
        ("O100", "word O100: nothing in the line uses it"),
        ("G1 X1", "G1 without a feed (F)"),
        ("G1 X1 F0", "G1 without a feed (F)"),
        ("G1 X1 F-5", "feed F-5 is negative"),
        ("G0 X1e3", "word E3: nothing in the line uses it"),
        ("G0 A90", "word A90: nothing in the line uses it"),
        ("G0 X", "cannot read 'X'"),
        ("G0 X1,5", "cannot read ',5'"),
        ("G80 X1", "axis words without a motion code (G0, G1, G2, G3)"),
        ("G4", "G4 without its seconds (P)"),
        ("M3", "M3 without a speed (S)"),
        ("M64", "M64 without the number of its output"),
        ("M67 E0", "M67 without its value (Q)"),
        ("M62 P0", "an output that waits for the next motion (M62, M63, M67), and none follows"),
        ("G64", "G64 without P rounds corners by any amount"),
        ("G64 P0.5", "G64 may leave the path by 0.5, post.path_tolerance is 0.01"),
        ("G55", "G55: another work offset after the first motion is not read"),
        ("T1 M6", "tool 1 is changed to, and its length is not applied (G43 H1)"),
        ("G43", "G43 shifts z by the length of a tool, but post.tool is 0"),
        ("(open", "a comment that is not closed, or closed twice"),
        ("(a (b) )", "a comment that is not closed, or closed twice"),
        ("(DEBUG,#1)", "active comment '(DEBUG,#1)'"),
        ("/G0 X1", FOREIGN),
        ("N G0 X1", "N without a number"),
        ("%", "a per cent sign that does not belong to one on the first line"),
        ("G0 X1 ß", "a character that is not ASCII outside a comment"),
        ("G1 F100 X" + "0" * 250 + "1", "260 characters, LinuxCNC reads 252"),
        ("G0 X99999999", "word X99999999 is out of range"),
        ("F100 G2 X2", "arc without a centre or radius (I, J, K or R) in its plane"),
        ("F100 G2 X2 I1 R1", "R and a centre in one arc"),
        ("F100 G2 X2 R0.9", "R0.9 does not reach the end point"),
        ("F100 G2 X0 Y0 R2", "arc with R whose end is its start"),
        ("F100 G2 X2 I1 K1", "word K1: nothing in the line uses it"),
        ("F100 G2 X2 I1.02", "the radii of the arc differ by 0.0400 mm (start 1.0200, end 0.9800)"),
        ("F100 G2 X2 I0", "arc of no radius"),
        ("F100 G2 X0 I1 P1.5", "P1.5 is not a number of turns"),
        (
            "F100 G2 X0 I1 P99999",
            "an arc of more than 20,000 pieces is refused (limits.gcode_pieces)",
        ),
        ("G90.1 F100 G2 X2 I1", "an absolute centre (G90.1) needs both its words"),
    ],
)
def test_a_wrong_line_is_a_fault(line, message):
    assert (1, message) in list_faults(line)


def test_a_text_without_its_modes_or_its_end_has_findings():
    assert [(f.line, f.what) for f in read("G21\nG0 Z5\nG61\n").findings] == [
        (2, f"G17, G40, G80, G90, G91.1, G94, G54 {UNSAID}"),
        (2, "neither G49 nor G43 before the first motion: a tool length that is on shifts Z"),
        (2, "neither G61 nor G64 P before the first motion: corners may be rounded by any amount"),
        (3, "the program has no end (M2 or M30)"),
        (3, "the program ends before the position is known in all axes"),
        (3, "G61 where post.path_tolerance asks for G64 P0.01: corners take another time"),
    ]
    no_unit = "G17 G40 G54 G80 G90 G91.1 G94 G64 P0.01 Q0 G49\nG0 X1 Y1\nM2\nG0 X2\n"
    assert [(f.line, f.what) for f in read(no_unit).findings] == [
        (1, "G49 lowers the next height by a tool length that is on; G53 G0 Z0 first"),
        (2, "a motion before G20 or G21; read as mm"),
        (2, "X or Y moves while Z is not known; read as from 0"),
        (4, "a line after the end of the program"),
    ]
    assert [f.what for f in read("").findings] == ["the program has no end (M2 or M30)"]


@pytest.mark.parametrize("end", ["", "%\n"])
def test_a_per_cent_sign_on_the_first_line_needs_another_one(end):
    """LinuxCNC says so at the end of the file."""
    setup = "%\nG21 G17 G40 G54 G80 G90 G91.1 G94 G64 P0.01 Q0 G49\nG0 X1 Y1 Z1\nM2\n"
    what = "the per cent sign of line 1 has no second one"
    assert (what in [finding.what for finding in read(setup + end).findings]) == (not end)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            ["G61 G21", "G0 Z5", "G0 Z-5", "G0 X0 Y0"],
            "an axis moves again before the position is known in all axes",
        ),
        (
            ["G61 G21", "G0 Z5", "G1 X0 Y0 F10"],
            "a feed motion from a position that is not known; read as from 0",
        ),
        (
            ["G61 G21", "G91 G0 Z5"],
            "an incremental motion from a position that is not known; read as from 0",
        ),
        (["G61 G21 G55", "G0 X0 Y0 Z5"], "work offset G55, but post.work is G54"),
        (
            ["G61 G20 F10", "G0 X0 Y0 Z5"],
            "F in the line that changes the unit: controllers differ in which unit it has",
        ),
    ],
)
def test_a_motion_before_the_position_is_known_is_a_fault(lines, message):
    assert message in [f.what for f in read("\n".join([*lines, "M2"])).findings]


def test_the_reading_continues_from_the_end_of_a_refused_line():
    text = (
        f"{SAFE} G64 P0.01 Q0 G49\nG0 Z5\nG0 X0 Y0\nF60 G2 X2 Y7 I1\nG1 X3 A9\nX4\nM2 P1\nG0 X9\n"
    )
    reading = read(text, lift=False)
    assert [(fault.line, fault.what.split(" (")[0]) for fault in reading.findings] == [
        (4, "the radii of the arc differ by 6.0711 mm"),
        (5, "word A9: nothing in the line uses it"),
        (7, "word P1: nothing in the line uses it"),
        (8, "a line after the end of the program"),
    ]
    assert [item.target.origin for item in reading.body] == [(0, 0, 5), (3, 7, 5), (4, 7, 5)]


@pytest.mark.parametrize("change", ["T2 M6 G55", "G55 T2 M6", "T2 M6\nG55", "T2 M6\nG43 H2 G55"])
def test_a_work_offset_that_changes_with_the_tool_is_a_fault(change):
    text = (
        f"{SAFE} G64 P0.01 Q0 G49\nT1 M6\nG43 H1\nG0 Z5\nG0 X0 Y0\n"
        "T2 M6\nG43 H2\nG0 Z5\nG0 X9 Y0\nM2\n"
    )
    assert not read(text, lift=False).findings
    changed = text.replace("T2 M6" if "H2" not in change else "T2 M6\nG43 H2", change)
    what = "G55: another work offset after the first motion is not read"
    assert what in [fault.what for fault in read(changed, lift=False).findings]


def test_the_length_of_the_tool_is_applied_once():
    text = posted(gcode(tool=1), PART)[1]
    late = text.replace("G43\n", "").replace("G4 P1.5", "G4 P1.5\nG43")
    assert [f.what for f in read(late, tool=1).findings] == [
        "the length of the tool is not applied (G43) before the first motion",
        "G43 after the first motion shifts the origin",
    ]


def test_a_text_with_another_tool_than_the_options_is_a_fault():
    text = posted(gcode(tool=1, work="G55"), PART)[1]
    assert not read(text, tool=1, work="G55").findings
    assert [f.what for f in read(text, tool=2, work="G55").findings] == [
        "tool T1, but post.tool is 2",
        "the tool change T2 M6 of post.tool is missing",
    ]
    with pytest.raises(JobError, match="signals"):
        read(text, signals="P0")
    with pytest.raises(JobError, match="is not a number"):
        read(text, path_tolerance="wide")


def test_half_a_circle_is_one_arc_and_a_circle_is_two():
    lead = "G21 G61\nG0 X0 Y0 Z0\nF60\n"
    for radius in (0.05, 1.0, 1000.0):
        excess = 0.0007 / radius  # rad by which rounding moves the end beyond half a circle
        x, y = radius + radius * math.cos(excess), radius * math.sin(excess)
        assert len(read(f"{lead}G2 X{x:.5f} Y{-y:.5f} I{radius}\nM2").body) == 2
        assert len(read(f"{lead}G2 I{radius}\nM2").body) == 3


def test_a_helix_is_read_as_lines_close_to_it():
    body = read("G21 G61\nG0 X0 Y0 Z0\nF60 G3 X0 Y0 Z1 I-10\nM2").body[1:]
    assert all(isinstance(item, MoveL) for item in body)
    ends = [(0.0, 0.0, 0.0)] + [item.target.origin for item in body]
    for p, q in pairwise(ends):
        middle = math.hypot((p[0] + q[0]) / 2 + 10, (p[1] + q[1]) / 2)
        assert 0 <= 10 - middle < 0.0021


# Any text


@given(st.randoms(use_true_random=False))
def test_a_changed_program_is_read_without_an_exception(chance: random.Random):
    text = list(TEXT)
    for _ in range(chance.randint(1, 12)):
        k = chance.randrange(len(text))
        text[k] = chance.choice(
            [
                "",
                "9" * 300,
                "\n",
                "G2",
                "I",
                "R-",
                "%",
                "(",
                "P7",
                "Z\x00",
                "é",
                "ı",
                *"0123456789.-;/#NO",
            ]
        )
    reading = read("".join(text))
    assert len(reading.body) == len(reading.lines)
    assert list(reading.lines) == sorted(reading.lines)
    assert [f.line for f in reading.findings] == sorted(f.line for f in reading.findings)


@given(st.one_of(st.text(), st.text("GMXYZIJKRFSTPQ0123456789.-+ \n%()/;", max_size=200)))
def test_any_text_is_read_without_an_exception(text):
    reading = read(text)
    # A text without an end always has a finding.
    assert reading.findings or any(
        end in text.upper().replace(" ", "") for end in ("M2", "M02", "M30")
    )


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared/data/gcode beside the repository")
def test_third_party_programs_have_findings():
    files = [file for file in sorted(DATA.rglob("*")) if file.is_file()]
    assert files
    for file in files:
        text = file.read_bytes().decode("utf-8", "replace")
        for name in ("gcode", "grbl"):
            assert find_readback(name)({file.name: text}, {}).findings


CODES = st.sampled_from(["", "G0", "G1", "G2", "G3"])
NUMBERS = st.dictionaries(st.sampled_from("XYZIJF"), st.decimals(-999, 999, places=3), max_size=6)


@fewer(12)
@given(st.lists(st.tuples(CODES, NUMBERS), max_size=6))
def test_the_fast_path_and_the_general_parser_read_the_same(lines):
    """Lines in lower case are read by the general parser."""
    text = "G17 G21 G40 G49 G54 G80 G90 G94\nG64 P0.01 Q0\nG0 Z9\nG0 X0 Y0\nF100\n"
    for code, words in lines:
        ordered = [f"{letter}{words[letter]}" for letter in "XYZIJF" if letter in words]
        text += " ".join([code, *ordered]).strip() + "\n"
    text += "M2\n"
    fast, general = read(text), read(text.lower())
    assert list_values(fast, True)[:2] == list_values(general, True)[:2]
    assert [fault.line for fault in fast.findings] == [fault.line for fault in general.findings]


HEAD = "G17 G21 G40 G54 G80 G90 G91.1 G94\nG64 P0.01 Q0\nG49\n"


@pytest.mark.parametrize(
    ("body", "line", "what"),
    [
        ("G0 Z50 T2\nG0 X0 Y0\nM2\n", 4, "T2 selects a tool that no M6 changes to"),
        ("G0 Z50 S9\nG0 X0 Y0\nM2\n", 4, "S9 without M3 or M4"),
        ("G0 Z50 S9\nG0 X0 Y0\nM3\nM5\nM2\n", 4, ""),
        ("S9\nS8\nM3\nG0 Z50\nG0 X0 Y0\nM5\nM2\n", 4, "S9 without M3 or M4"),
        ("G0 X0 Y0 Z50\nM2\n", 4, "Z moves together with X or Y while it is not known"),
        (
            "G0 Z50\nG0 X0\nY0\nM2\n",
            5,
            "X and Y move one after the other to where the program begins",
        ),
        ("G18\nG0 Z50\nG0 X0 Y0\nM2\n", 4, "G18 where posts write in G17"),
        ("G0 Z50\nG0 X0 Y0\nM30\n", 6, "M30 exchanges pallets before the end; posts write M2"),
        (
            "G0 Z50\nG0 X0 Y0\nG3 X10 Y0 I5.01 J0 F60\nG1 X0\nM2\n",
            6,
            "an arc whose radius goes from 5.0100 to 4.9900 mm",
        ),
        ("G0 Z50\nG0 X0 Y0\nG3 X10 Y0 I5.001 J0 F60\nG1 X0\nM2\n", 6, ""),
    ],
)
def test_a_line_that_no_post_writes_is_a_remark(body, line, what):
    findings = read(HEAD + body, lift=False).findings
    assert [(f.line, f.what) for f in findings] == ([(line, what)] if what else [])
    assert all(f.level == "unusual" for f in findings)


def test_a_tool_that_is_changed_to_twice_is_a_remark():
    head = HEAD.replace("G49", "T3 M6\nT3 M6\nG43 H3")
    findings = read(head + "G0 Z50\nG0 X0 Y0\nM2\n", tool=3, lift=False).findings
    assert [(f.line, f.what) for f in findings] == [(4, "M6 a second time")]


def test_a_lift_before_the_path_mode_is_a_remark():
    text = HEAD.replace("G64 P0.01 Q0\n", "G53 G0 Z0\n") + "G64 P0.01 Q0\nG0 X0 Y0\nG0 Z50\nM2\n"
    assert [(f.line, f.what) for f in read(text).findings] == [
        (2, "neither G61 nor G64 P before the first motion: corners may be rounded by any amount")
    ]


@pytest.mark.parametrize(
    ("comment", "message"),
    [
        ("(path c1 layer 0)", ""),
        ("(debug: no comma)", ""),
        ("(debug, #1)", "active comment '(debug, #1)'"),
        ("(py,x)", "active comment '(py,x)'"),
        ("(one) X1", ""),
        ("(two) X1 Z1 Q2", "word Q2: nothing in the line uses it"),
        ("(open", "a comment that is not closed, or closed twice"),
        ("(in (it)", "a comment that is not closed, or closed twice"),
        (f"({'x' * 300})", "302 characters, LinuxCNC reads 252"),
        ("(é)", ""),
    ],
)
def test_a_comment_between_motions_is_checked(comment, message):
    faults = list_faults("G1 X1 F100", comment, "G1 X2")
    assert [what for line, what in faults if line == 2] == ([message] if message else [])
    text = f"{SAFE} G64 P0.01 Q0\nG0 Z5\nG0 X0 Y0\nG1 X1 F100\n{comment}\nG1 X2\nM2\n"
    body = read(text).body
    assert body[-1].target.origin == (2.0, 0.0, body[-1].target.origin[2])
