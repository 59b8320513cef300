import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from camgen.lang.programs import Finding, find_language
from camgen.model.errors import JobError, Refused
from camgen.model.program import Comment, Force, MoveC, MoveJ, MoveL, Output, Stop, Wait
from camgen.post.kit import Case, cases, check_case
from camgen.post.plugins import find_post, find_readback, make_post
from tests.post.changes.grbl import TEXT
from tests.support.examples import fewer
from tests.support.gcode_programs import UNSAID, S
from tests.support.rs274 import (
    assert_moves,
    at,
    difference,
    needs_rs274,
    posted,
    program,
    programs,
    run,
)

SLOW = settings(suppress_health_check=[HealthCheck.too_slow])
#: Lines that the parser of GRBL 1.1 takes, by the list of supported codes in its documentation.
KNOWN = re.compile(
    r"(?:(?:G(?:0|1|2|3|4|17|18|19|20|21|40|49|5[3-9]|61|80|90|91|91\.1|93|94)|M(?:"
    r"0|2|3|4|5|7|8|9|30))(?=[A-Z]|$)"
    r"|[XYZIJKRFSPTN][+-]?[0-9.]+)*"
)


def grbl(**options):
    return make_post(find_post("grbl"), options)


def read(text, **options):
    return find_readback("grbl")({"part.nc": text}, options)


def list_faults(*lines, **options):
    """Line and message of each finding; the first of `lines` is line 1."""
    modes = "G17 G21 G40 G49 G54 G80 G90 G91.1 G94"
    text = "\n".join([modes, "G0 Z5", "G0 X0 Y0", *lines, "M2", ""])
    return [(fault.line - 3, fault.what) for fault in read(text, **options).findings]


def assert_firmware_takes(text):
    """Every line fits into the line buffer of the firmware and suits its parser.

    This check shares no code with the reader.
    """
    assert text.isascii()
    assert text.endswith("M2\n")
    for line in text.splitlines():
        assert not re.search(r"[!~?%$\x00-\x1f\x7f]", line)
        bare = re.sub(r"\([^()]*\)| ", "", line)
        assert len(bare) <= 79
        assert len(line) <= 79
        assert KNOWN.fullmatch(bare), line


def test_a_stop_waits_for_the_operator_and_is_read_back():
    ready, text = posted(
        grbl(), program(MoveJ(at(5, 5, 10), 100.0), Stop(), MoveL(at(5, 5, 5), 2.0))
    )
    assert "\nM0\n" in text
    assert difference(ready, read(text), grbl().tolerance()) == ""


def test_grbl_has_no_optional_stop():
    with pytest.raises(Refused, match="GRBL passes over M1"):
        posted(grbl(), program(MoveJ(at(5, 5, 10), 100.0), Stop(optional=True)))


PART = program(
    MoveJ(at(5, 5, 10), 100.0),
    MoveL(at(5, 5, -1.5), 2.0),
    Output("process", 1.0),
    Wait(0.25),
    MoveL(at(45, 5, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 - S, -1.5), at(55, 15, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 + S, -1.5), at(45, 25, -1.5), 10.0),
    MoveL(at(5, 5, -1.5), 100 / 3),
    Output("process", 0.0),
    Comment("lift!"),
    MoveL(at(5, 5, 10), 100 / 3),
    MoveJ(at(0, 0, 50), 100.0),
)


def test_the_page_of_the_post_shows_the_expected_text():
    page = Path(__file__).parents[2] / "docs" / "posts" / "grbl.md"
    assert f"```\n{TEXT}```" in page.read_text()


def test_the_text_of_a_part_is_the_expected_one():
    assert posted(grbl(), PART)[1] == TEXT
    assert_firmware_takes(TEXT)
    assert difference(PART, read(TEXT), grbl().tolerance()) == ""


def test_the_option_lift_moves_to_the_zero_of_the_machine_first():
    ready, text = posted(grbl(lift=True), PART)
    assert text.splitlines()[4:9] == ["M5", "G53 G0 Z0", "G49", "G0 X0 Y0", "G0 Z50"]
    assert_firmware_takes(text)
    assert difference(ready, read(text, lift=True), grbl().tolerance()) == ""
    assert "post.lift is false" in read(text).findings[0].what


@pytest.mark.parametrize(
    ("options", "switched_on", "switched_off"),
    [
        ({"power": 250.5}, "M3 S250.5", "M5"),
        ({"signals": {"process": "M4"}}, "M4 S1000", "M5"),
        ({"signals": {"process": "M7"}}, "M7", "M9"),
        ({"signals": {"process": "M8"}}, "M8", "M9"),
    ],
)
def test_the_process_may_be_a_laser_or_a_coolant_output(options, switched_on, switched_off):
    _, text = posted(grbl(**options), PART)
    assert text == TEXT.replace("M3 S1000", switched_on).replace("M5", switched_off)
    assert_firmware_takes(text)
    assert difference(PART, read(text, **options), grbl(**options).tolerance()) == ""
    assert difference(PART, read(text, signals={"glue": "M3"}, power=7), grbl().tolerance())


SPINNING = program(Output("spindle", 8000.0), MoveL(at(1, 0, 0), 10.0), Output("spindle", 0.0))


def test_a_spindle_has_its_speed():
    _, text = posted(grbl(), SPINNING)
    assert text.splitlines()[-4:] == ["M3 S8000", "G1 X1 Z0 F600", "M5", "M2"]
    assert difference(SPINNING, read(text), grbl().tolerance()) == ""


def test_a_power_that_is_not_the_one_of_the_option_is_a_spindle_speed():
    twice = TEXT.replace("G1 X5 Y5 F2000", "M3 S999\nG1 X5 Y5 F2000")
    outputs = [item for item in read(twice).body if isinstance(item, Output)]
    assert [i.value for i in outputs if i.signal == "spindle"] == [0, 1000, 999, 0]


@pytest.mark.parametrize(
    ("plan", "options", "message"),
    [
        (
            program(Output("spindle", 8000.0), Output("process", 1.0)),
            {},
            "grbl: signal process and the spindle share one output (instruction 1); "
            'put the signal on a coolant line, e.g. post.signals = {process = "M8"}',
        ),
        (
            program(Output("spindle", 1000.0)),
            {},
            "grbl: a spindle at 1000 rpm reads like signal process at post.power (instruction 0); "
            "change post.power or put the signal on a coolant line, e.g. post.signals = "
            '{process = "M8"}',
        ),
        (
            program(Force(5.0, (1.0, 0.0, 0.0)), MoveL(at(1, 0, 0), 10.0), Force(0.0)),
            {},
            (
                "grbl: G-code has no force control; set process.force = 0 or post.force = "
                '"ignore" (instruction 0)'
            ),
        ),
    ],
)
def test_a_refusal_names_index_and_remedy(plan, options, message):
    with pytest.raises(Refused) as caught:
        grbl(**options).prepare(plan, 0.01)
    assert str(caught.value) == message


def test_a_spindle_may_run_with_a_coolant_output():
    plan = program(
        Output("spindle", 1000.0),
        Output("process", 1.0),
        Output("process", 0.0),
        Output("spindle", 0.0),
    )
    options = {"signals": {"process": "M8"}}
    _, text = posted(grbl(**options), plan)
    assert text.splitlines()[-5:] == ["M3 S1000", "M8", "M9", "M5", "M2"]
    assert difference(plan, read(text, **options), grbl(**options).tolerance()) == ""


def test_the_option_ignore_leaves_the_force_out():
    plan = program(
        Force(5.0, (1.0, 0.0, 0.0)),
        MoveL(at(1, 0, 0), 10.0, 0.0, 5.0, (1.0, 0.0, 0.0)),
        Force(0.0),
        MoveL(at(1, 0, 9), 1.0),
    )
    ready, text = posted(grbl(force="ignore"), plan)
    assert difference(ready, read(text, force="ignore"), grbl().tolerance()) == ""


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"work": "G59.1"}, "is not a work offset; one of G54, G55, G56, G57, G58, G59"),
        (
            {"signals": {"process": "P0"}},
            "'P0' is not an output of this controller; one of M3, M4, M7, M8",
        ),
        ({"signals": {"process": "M3 S1\nG0 Z-9"}}, "is not an output of this controller"),
        ({"signals": {"a": "M3", "b": "M4"}}, "M3 is switched off by another signal too"),
        ({"power": 0.0}, "must be more than 0 and at most 99999, not 0"),
        ({"power": math.inf}, "must be more than 0 and at most 99999, not inf"),
        ({"tool": 1}, "grbl has no such option"),
        ({"path_tolerance": 0.01}, "grbl has no such option"),
        ({"force": "analog"}, "Invalid enum value 'analog'"),
        ({"max_lines": -1}, "must be 0 or more, not -1; 0: the program is not split"),
    ],
)
def test_an_invalid_option_is_refused(options, message):
    with pytest.raises(JobError) as caught:
        grbl(**options)
    assert message in str(caught.value)


@pytest.mark.parametrize("case", cases(), ids=str)
def test_conformance(case: Case):
    lacks = {"joints", "tilt", "signals", "large", "force", "split"}
    lacks |= {"tool changes", "optional stops"}
    # Comments, and the last digit of a centre: an arc may deviate by six times half a digit.
    meaningless = (r"\(.*\)", r"[IJ]-?\d+\.\d\d(\d)")
    check_case(find_post("grbl"), find_language("grbl"), case, {}, lacks, meaningless)


HOSTILE = [
    "!",
    "~",
    "?",
    "a) M3 S1000 (b",
    "a\nM3 S1000",
    "%",
    "$H",
    "Größe",
    "\x18",
    "\x85",
    "ä" * 300,
    "x" * 300,
]


def test_a_comment_has_no_character_that_acts_at_once():
    plan = program(
        *(Comment(text) for text in HOSTILE), MoveL(at(1, 0, 0), 10.0), name="a!b", header=("?",)
    )
    ready, text = posted(grbl(), plan)
    assert_firmware_takes(text)
    assert difference(ready, read(text), grbl().tolerance()) == ""


def test_the_longest_lines_fit():
    big = 99_998.999999
    via = (big - 10_000 * (1 - math.cos(0.5)), -big + 10_000 * math.sin(0.5))
    end = (big - 10_000 * (1 - math.cos(1.0)), -big + 10_000 * math.sin(1.0))
    plan = program(
        MoveL(at(big, -big, -big), 1.0), MoveC(at(*via, -big), at(*end, -big), 999_998.99 / 60)
    )
    _, text = posted(grbl(decimals=6), plan)
    assert "G3" in text
    assert_firmware_takes(text)


@needs_rs274
@fewer(12, [HealthCheck.too_slow])
@given(programs())
def test_linuxcnc_and_the_read_back_run_a_generated_program_as_planned(plan):
    ready, text = posted(grbl(), plan)
    assert_firmware_takes(text)
    assert difference(ready, read(text), grbl().tolerance()) == ""
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)


@SLOW
@given(programs())
def test_the_radii_of_an_arc_agree_in_32_bits(plan):
    """GRBL computes in 32-bit floats. Its error 33 is at 0.5 mm, or at 0.005 mm and 0.1 %."""
    _, text = posted(grbl(), plan)
    x = y = np.float32(0)
    for line in text.splitlines():
        if line.startswith("("):
            continue
        words = {word[0]: np.float32(word[1:]) for word in line.split() if word[0] in "XYIJ"}
        nx, ny = words.get("X", x), words.get("Y", y)
        if line.startswith(("G2 ", "G3 ")):
            i, j = words["I"], words["J"]
            differ = abs(np.hypot(i, j) - np.hypot(nx - x - i, ny - y - j))
            assert differ <= 0.5
            assert differ <= 0.005 or differ <= 0.001 * np.hypot(i, j)
        x, y = nx, ny


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("G64 P0.01", "G64 is not read: not a code of GRBL"),
        ("G43 H1", "G43 is not read: not a code of GRBL"),
        ("G61.1", "G61.1 is not read: not a code of GRBL"),
        ("G90.1", "G90.1 is not read: not a code of GRBL"),
        ("G59.1", "G59.1 is not read: not a code of GRBL"),
        ("G81 X1 Z-1 R2", "G81 is not read: a drilling cycle"),
        ("G98", "G98 is not read: not a code of GRBL"),
        ("M6", "M6 is not read: not a code of GRBL"),
        ("M64 P0", "M64 is not read: not a code of GRBL"),
        ("M1", "M1 is not read: stops where the operator wants it"),
        ("%", "cannot read '%'"),
        ("$H", "cannot read '$H'"),
        ("#1=2", "parameters and expressions are not read"),
        ("(wait!)", "character '!' acts at once or is not ASCII; GRBL rejects it in comments too"),
        ("; ~", "character '~' acts at once or is not ASCII; GRBL rejects it in comments too"),
        ("(ä)", "character 'ä' acts at once or is not ASCII; GRBL rejects it in comments too"),
        (
            "G0 X1 \x18",
            "character '\\x18' acts at once or is not ASCII; GRBL rejects it in comments too",
        ),
        ("G1 F100 X" + "0" * 72 + "1", "80 characters without blanks and comments, GRBL reads 79"),
        ("G2 I5 F100", "G2 without an end point"),
        (
            "F100 G2 X2 I1.006",
            "the radii of the arc differ by 0.0120 mm (start 1.0060, end 0.9940)",
        ),
        ("F100 G2 X2 R0.9999", "R0.9999 does not reach the end point"),
        ("F100 G2 X2 I1 P2", "P2 has no meaning in an arc"),
        ("G4 P-1", "G4 without its seconds (P)"),
        ("G1 X1", "G1 without a feed (F)"),
    ],
)
def test_a_wrong_line_is_a_fault(line, message):
    assert (1, message) in list_faults(line)


@pytest.mark.parametrize("word", ["G17", "G40", "G54", "G80", "G90", "G91.1", "G94"])
def test_a_mode_that_is_not_set_is_a_remark_and_does_not_verify(word):
    if f"{word} " in TEXT:
        reading = read(TEXT.replace(f"{word} ", "", 1))
    else:
        reading = read(TEXT.replace(f"{word}\n", "\n"))
    assert reading.findings == (Finding("unusual", 7, f"{word} {UNSAID}"),)
    assert f"{word} not set" in difference(PART, reading, grbl().tolerance())


def test_a_tool_number_without_a_change_is_a_remark():
    idle = (1, "T255 selects a tool that no M6 changes to")
    assert list_faults("T255", "N10000000 G0 X1", "N9999999.5 G0 X2") == [idle]


def test_a_line_that_grbl_takes_is_read():
    comment = "(" + "c" * 200 + ") G0 X1"
    assert list_faults("/G0 X1", "(a (b)", "; x ( y", "N7 g1 x 1 0 f1 00", "T1", comment) == [
        (1, "a slash before a line, which GRBL ignores and no post writes"),
        (2, "a comment that is not closed, or closed twice"),
        (5, "T1 selects a tool that no M6 changes to"),
    ]
    assert list_faults("G1 F100 X" + "0" * 71 + "1") == []


def test_a_text_without_one_of_its_lines_is_not_the_program():
    lines = TEXT.splitlines()
    for k, line in enumerate(lines):
        if not line.startswith("("):
            reading = read("\n".join(lines[:k] + lines[k + 1 :]) + "\n")
            assert difference(PART, reading, grbl().tolerance()), line


@given(st.randoms(use_true_random=False))
def test_a_changed_program_is_read_without_an_exception(chance: random.Random):
    text = list(TEXT)
    for _ in range(chance.randint(1, 12)):
        text[chance.randrange(len(text))] = chance.choice(
            ["", "9" * 60, "\n", "G2", "R-", "%", "(", "é", *"0123456789.-;/NS"]
        )
    reading = read("".join(text))
    assert len(reading.body) == len(reading.lines)


@given(st.one_of(st.text(), st.text("GMXYZIJKRFSTPQ0123456789.-+ \n%()/;", max_size=200)))
def test_any_text_is_read_without_an_exception(text):
    reading = read(text)
    # A text without an end always has a finding.
    assert reading.findings or any(
        end in text.upper().replace(" ", "") for end in ("M2", "M02", "M30")
    )
