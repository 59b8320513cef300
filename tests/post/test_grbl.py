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
S = 10 / math.sqrt(2)
#: The letters and codes of GRBL 1.1 that the firmware's parser takes, from its documentation of supported G-code.
KNOWN = re.compile(
    r"(?:(?:G(?:0|1|2|3|4|17|18|19|20|21|40|49|5[3-9]|61|80|90|91|91\.1|93|94)|M(?:0|2|3|4|5|7|8|9|30))(?=[A-Z]|$)"
    r"|[XYZIJKRFSPTN][+-]?[0-9.]+)*"
)


def grbl(**options):
    return make_post(find_post("grbl"), options)


def read(text, **options):
    return find_readback("grbl")({"part.nc": text}, options)


def faults(*lines, **options):
    text = "\n".join(
        ["G17 G21 G40 G49 G54 G80 G90 G91.1 G94", "G0 Z5", "G0 X0 Y0", *lines, "M2", ""]
    )
    return [(fault.line - 3, fault.what) for fault in read(text, **options).findings]


def assert_takes(text):
    """What the firmware's line buffer and parser ask of every line, by a check that shares nothing with the reader."""
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


def test_the_page_of_the_post_shows_this_text():
    page = Path(__file__).parents[2] / "docs" / "posts" / "grbl.md"
    assert f"```\n{TEXT}```" in page.read_text()


def test_text_of_a_part():
    assert posted(grbl(), PART)[1] == TEXT
    assert_takes(TEXT)
    assert difference(PART, read(TEXT), grbl().tolerance()) == ""


def test_a_machine_that_has_its_zero_at_the_top_may_go_there_first():
    ready, text = posted(grbl(lift=True), PART)
    assert text.splitlines()[4:9] == ["M5", "G53 G0 Z0", "G49", "G0 X0 Y0", "G0 Z50"]
    assert_takes(text)
    assert difference(ready, read(text, lift=True), grbl().tolerance()) == ""
    assert "post.lift is false" in read(text).findings[0].what


@pytest.mark.parametrize(
    ("options", "on", "off"),
    [
        ({"power": 250.5}, "M3 S250.5", "M5"),
        ({"signals": {"process": "M4"}}, "M4 S1000", "M5"),
        ({"signals": {"process": "M7"}}, "M7", "M9"),
        ({"signals": {"process": "M8"}}, "M8", "M9"),
    ],
)
def test_outputs_of_the_process(options, on, off):
    _, text = posted(grbl(**options), PART)
    assert text == TEXT.replace("M3 S1000", on).replace("M5", off)
    assert_takes(text)
    assert difference(PART, read(text, **options), grbl(**options).tolerance()) == ""
    assert difference(PART, read(text, signals={"glue": "M3"}, power=7), grbl().tolerance())


SPINNING = program(Output("spindle", 8000.0), MoveL(at(1, 0, 0), 10.0), Output("spindle", 0.0))


def test_a_spindle_is_not_a_signal():
    _, text = posted(grbl(), SPINNING)
    assert text.splitlines()[-4:] == ["M3 S8000", "G1 X1 Z0 F600", "M5", "M2"]
    assert difference(SPINNING, read(text), grbl().tolerance()) == ""


def test_a_line_of_another_power_is_no_signal():
    twice = TEXT.replace("G1 X5 Y5 F2000", "M3 S999\nG1 X5 Y5 F2000")
    assert [
        i.value for i in read(twice).body if isinstance(i, Output) and i.signal == "spindle"
    ] == [0, 1000, 999, 0]


@pytest.mark.parametrize(
    ("plan", "options", "says"),
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
            'change post.power or put the signal on a coolant line, e.g. post.signals = {process = "M8"}',
        ),
        (
            program(Force(5.0, (1.0, 0.0, 0.0)), MoveL(at(1, 0, 0), 10.0), Force(0.0)),
            {},
            'grbl: G-code has no force control; set process.force = 0 or post.force = "ignore" (instruction 0)',
        ),
    ],
)
def test_refusals(plan, options, says):
    with pytest.raises(Refused) as caught:
        grbl(**options).prepare(plan, 0.01)
    assert str(caught.value) == says


def test_spindle_and_coolant_go_together():
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


def test_force_left_out_by_the_user():
    plan = program(
        Force(5.0, (1.0, 0.0, 0.0)),
        MoveL(at(1, 0, 0), 10.0, 0.0, 5.0, (1.0, 0.0, 0.0)),
        Force(0.0),
        MoveL(at(1, 0, 9), 1.0),
    )
    ready, text = posted(grbl(force="ignore"), plan)
    assert difference(ready, read(text, force="ignore"), grbl().tolerance()) == ""


@pytest.mark.parametrize(
    ("options", "says"),
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
def test_options_that_cannot_be_meant(options, says):
    with pytest.raises(JobError) as caught:
        grbl(**options)
    assert says in str(caught.value)


@pytest.mark.parametrize("case", cases(), ids=str)
def test_conformance(case: Case):
    lacks = {"joints", "tilt", "signals", "large", "force", "split"}
    lacks |= {"tool changes", "optional stops"}
    # Remarks; and the last digit of a centre, since an arc may be off by six times half a digit.
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


def test_hostile_comments_reach_no_interrupt():
    plan = program(
        *(Comment(text) for text in HOSTILE), MoveL(at(1, 0, 0), 10.0), name="a!b", header=("?",)
    )
    ready, text = posted(grbl(), plan)
    assert_takes(text)
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
    assert_takes(text)


@needs_rs274
@fewer(12, [HealthCheck.too_slow])
@given(programs())
def test_interpreter_readback_and_program_agree(plan):
    ready, text = posted(grbl(), plan)
    assert_takes(text)
    assert difference(ready, read(text), grbl().tolerance()) == ""
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)


@SLOW
@given(programs())
def test_arcs_hold_in_32_bits(plan):
    """GRBL computes in 32-bit floats: its two radii still agree (error 33: 0.5 mm, or 0.005 mm and 0.1 %)."""
    _, text = posted(grbl(), plan)
    x = y = np.float32(0)
    for line in text.splitlines():
        words = {
            w[0]: np.float32(w[1:])
            for w in line.split()
            if w[0] in "XYIJ" and not line.startswith("(")
        }
        nx, ny = words.get("X", x), words.get("Y", y)
        if line.startswith(("G2 ", "G3 ")):
            i, j = words["I"], words["J"]
            differ = abs(np.hypot(i, j) - np.hypot(nx - x - i, ny - y - j))
            assert differ <= 0.5
            assert differ <= 0.005 or differ <= 0.001 * np.hypot(i, j)
        x, y = nx, ny


@pytest.mark.parametrize(
    ("line", "says"),
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
def test_faults_name_line_and_word(line, says):
    assert (1, says) in faults(line)


UNSAID = "not set before the first motion: the program before may have left it otherwise"


@pytest.mark.parametrize("word", ["G17", "G40", "G54", "G80", "G90", "G91.1", "G94"])
def test_a_mode_that_is_not_said_is_a_fault_of_our_program(word):
    left = (
        TEXT.replace(f"{word} ", "", 1) if f"{word} " in TEXT else TEXT.replace(f"{word}\n", "\n")
    )
    assert read(left).findings == (Finding("unusual", 7, f"{word} {UNSAID}"),)
    assert f"{word} not set" in difference(PART, read(left), grbl().tolerance())


def test_tools_and_numbers_within_the_firmware():
    idle = (1, "T255 selects a tool that no M6 changes to")
    assert faults("T255", "N10000000 G0 X1", "N9999999.5 G0 X2") == [idle]


def test_what_grbl_takes():
    assert faults(
        "/G0 X1", "(a (b)", "; x ( y", "N7 g1 x 1 0 f1 00", "T1", "(" + "c" * 200 + ") G0 X1"
    ) == [
        (1, "a slash before a line, which GRBL ignores and no post writes"),
        (2, "a comment that is not closed, or closed twice"),
        (5, "T1 selects a tool that no M6 changes to"),
    ]
    assert faults("G1 F100 X" + "0" * 71 + "1") == []


def test_every_line_matters():
    lines = TEXT.splitlines()
    for k, line in enumerate(lines):
        if not line.startswith("("):
            left = read("\n".join(lines[:k] + lines[k + 1 :]) + "\n")
            assert difference(PART, left, grbl().tolerance()), line


@given(st.randoms(use_true_random=False))
def test_changed_texts_never_raise(chance: random.Random):
    text = list(TEXT)
    for _ in range(chance.randint(1, 12)):
        text[chance.randrange(len(text))] = chance.choice(
            ["", "9" * 60, "\n", "G2", "R-", "%", "(", "é", *"0123456789.-;/NS"]
        )
    reading = read("".join(text))
    assert len(reading.body) == len(reading.lines)


@given(st.one_of(st.text(), st.text("GMXYZIJKRFSTPQ0123456789.-+ \n%()/;", max_size=200)))
def test_any_text_gives_a_reading(text):
    reading = read(text)
    # Only a text that ends as a program does can be without a fault.
    assert reading.findings or any(
        end in text.upper().replace(" ", "") for end in ("M2", "M02", "M30")
    )
