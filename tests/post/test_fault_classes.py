"""Classes of texts that no post writes: the read-backs find many members of each class."""

import math
from itertools import combinations

import pytest

from camgen.lang.pacscript.words import RESERVED
from camgen.lang.programs import Finding
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    MoveJ,
    MoveL,
    Output,
    Posture,
    ToolChange,
)
from tests.support.samples import Sample

LEFTY = Posture(figure=5)
HOME = MoveJ(Joints((0.0, 0.0, math.pi / 2, 0.0, math.pi / 6, 0.0)), 100.0)


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


#: The home position of a machine with three axes.
PARKED = MoveJ(at(0, 0, 50), 100.0)
#: A path with a figure, an output and a stop at each corner.
CUT: tuple[Instruction, ...] = (
    HOME,
    MoveJ(at(0, 0, 20), 100.0, posture=LEFTY),
    MoveL(at(0, 0), 20.0, posture=LEFTY),
    Output("process", 1.0),
    MoveL(at(30, 0), 20.0, posture=LEFTY),
    Output("process", 0.0),
    MoveL(at(30, 0, 20), 100.0, posture=LEFTY),
)
#: The same path without figures.
PLAIN = tuple(
    type(item)(item.target, item.speed) if isinstance(item, MoveJ | MoveL) else item for item in CUT
)
MILLED = (PARKED, *PLAIN[1:])
PRESSED: tuple[Instruction, ...] = (
    HOME,
    MoveJ(at(0, 0, 20), 100.0),
    MoveL(at(0, 0), 20.0),
    Force(12.5, (0.0, 1.0, 0.0)),
    MoveL(at(30, 0), 20.0, force=12.5, force_direction=(0.0, 1.0, 0.0)),
    Force(0.0),
    MoveL(at(30, 0, 20), 100.0),
)


def _drill(number: int) -> tuple[Instruction, ...]:
    change = ToolChange(number, f"drill {number}", 6.0, 80.0, translation(0, 0, 80))
    down = MoveL(at(10, 10, -2), 5.0)
    up = MoveL(at(10, 10, 10), 100.0)
    spindle = Output("spindle", 3000.0)
    end = Output("spindle", 0.0)
    return (change, PARKED, spindle, MoveJ(at(10, 10, 10), 100.0), down, up, end)


RAPID = Sample("rapid", PLAIN, {})
PACSCRIPT = Sample("pacscript", CUT, {})
PRESSING = Sample("pacscript", PRESSED, {"force": "template"})
VPLUS = Sample("vplus", PLAIN, {})
TOOLS = Sample("gcode", (*_drill(1), *_drill(2)), {})
GCODE = Sample("gcode", MILLED, {})
#: A program with the tool of an option, and one whose spindle stops last.
NUMBERED = Sample("gcode", MILLED, {"tool": 3})
SPUN = Sample(
    "grbl", (Output("spindle", 0.0), PARKED, *_drill(0)[2:]), {"signals": {"process": "M8"}}
)
GRBL = Sample("grbl", MILLED, {})


def row_of(text: str, start: str) -> int:
    """Index of the first line that starts with `start`, after its blanks."""
    for row, line in enumerate(text.splitlines()):
        if line.strip().startswith(start):
            return row
    raise AssertionError(start)


# RAPID

CLAUSES = [
    "ELSE",
    "ELSEIF",
    "ENDIF",
    "ENDFOR",
    "ENDWHILE",
    "ENDTEST",
    "CASE",
    "DEFAULT",
    "THEN",
    "DO",
]
TAILS = ["", ";", " Stop;", " = 5", " 1:", "()", " x THEN", " SetDO doProcess,1;", " c1;"]


@pytest.mark.parametrize("word", CLAUSES)
@pytest.mark.parametrize("tail", TAILS)
def test_a_word_of_a_statement_that_is_not_open_is_a_fault(word: str, tail: str) -> None:
    row = row_of(RAPID.text, "MoveL")
    faults = RAPID.list_faults(RAPID.insert(row, f"{word.lower()}{tail}"))
    expected = Finding("refused", row + 1, f"{word} belongs to no statement before it")
    assert expected in faults


@pytest.mark.parametrize("word", ["ELSE", "ELSEIF", "THEN", "DO", "CASE", "DEFAULT"])
def test_a_word_of_an_open_statement_adds_no_fault(word: str) -> None:
    row = row_of(RAPID.text, "MoveL")
    faults = RAPID.list_faults(RAPID.insert(row, f"IF x THEN\n{word}\nENDIF"))
    assert Finding("refused", row + 1, "IF is a statement that is not read") in faults
    assert f"{word} belongs to no statement before it" not in [fault.what for fault in faults]


@pytest.mark.parametrize(("kind", "name"), [("tool", "tCamgen"), ("work object", "wCamgen")])
def test_another_name_of_tool_or_work_object_is_noted(kind: str, name: str) -> None:
    text = RAPID.text.replace(name, "other")
    option = kind.split(maxsplit=1)[0]
    what = f"other is the {kind} of a motion, by post.{option} it is {name}"
    assert what in [fault.what for fault in RAPID.list_faults(text)]


# PacScript

#: Words that begin statements which are read otherwise, or declarations of procedures.
_BEGIN = ["call", "dim", "if", "rem", "sub", "function", "io", "printdbg", "printmsg"]


@pytest.mark.parametrize("word", sorted(RESERVED - frozenset(_BEGIN)))
def test_a_word_of_the_language_gets_no_value(word: str) -> None:
    faults = PACSCRIPT.list_faults(
        PACSCRIPT.insert(row_of(PACSCRIPT.text, "Move L"), f"{word} = 5")
    )
    assert any(fault.level != "unusual" for fault in faults)


@pytest.mark.parametrize(
    "lines",
    [
        ("Speed", "Accel"),
        ("Speed",),
        ("Accel",),
        ("If Mps(100", "GiveArm", "Exit Sub", "End If"),
        ("If Mps(0.1)", "unit =", "End If"),
        ("Dim unit", "If Mps(0.1)", "unit =", "End If"),
    ],
)
def test_a_header_without_some_of_its_settings_has_findings(lines: tuple[str, ...]) -> None:
    text = PACSCRIPT.text.splitlines(keepends=True)
    row = row_of(PACSCRIPT.text, lines[0])
    for start in lines:
        while not text[row].strip().startswith(start):
            row += 1
        del text[row]
    assert PACSCRIPT.list_faults("".join(text))


#: A whole number of the program, another spelling of it, and a number that is not whole.
WHOLE_NUMBERS = [
    (", 5)", ", {})", ["-0.5", "0.5", "5.5", "-1.5", "4.9999", "-2", "11 / 2"]),
    ("ChangeTool 1", "ChangeTool {}", ["1.5", "0.5", "-0.5", "-1"]),
    ("ChangeWork 1", "ChangeWork {}", ["1.5", "0.5", "-0.5", "-1"]),
    ("Reset IO[24]", "Reset IO[{}]", ["24.5", "-24", "23.999"]),
    ("Keep = 0", "Keep = {}", ["0.5", "-0.5", "2"]),
]
FRACTIONS: list[tuple[str, str, str]] = []
for spelling, pattern, numbers in WHOLE_NUMBERS:
    FRACTIONS += [(spelling, pattern, number) for number in numbers]


@pytest.mark.parametrize(("before", "form", "number"), FRACTIONS)
def test_a_fraction_is_never_rounded(before: str, form: str, number: str) -> None:
    faults = PACSCRIPT.list_faults(PACSCRIPT.change(before, form.format(number)))
    assert any(fault.level != "unusual" for fault in faults)


@pytest.mark.parametrize(
    ("before", "after"),
    [("ForceParam 1,", "ForceParam 1.5,"), ("ForceCtrl True, 1", "ForceCtrl True, 1.5")],
)
def test_a_force_table_is_a_whole_number(before: str, after: str) -> None:
    assert PRESSING.is_refused(PRESSING.change(before, after))


def test_a_force_that_is_never_on_is_noted() -> None:
    line = "    ForceParam 1, 2, P(0.000, 5.000, 0.000, 0, 0, 0)"
    what = "force table 1 is set and never on"
    for start in ("GiveArm", "ForceParam"):
        rows = [
            k for k, row in enumerate(PRESSING.text.splitlines()) if row.strip().startswith(start)
        ]
        text = PRESSING.insert(rows[-1], line)
        assert Finding("unusual", rows[-1] + 1, what) in PRESSING.list_faults(text)


HEADERS = [("    TakeArm Keep = 0\n", "TakeArm"), ("    Reset IO[24]\n", "an output")]


@pytest.mark.parametrize(("line", "what"), HEADERS)
def test_the_test_of_mps_before_the_arm_or_an_output_is_a_fault(line: str, what: str) -> None:
    text = PACSCRIPT.change(line, "").replace("    Speed 10\n", f"{line}    Speed 10\n")
    assert any(fault.what.startswith(what) for fault in PACSCRIPT.list_faults(text))


# G-code


def test_a_text_without_two_lines_before_the_first_tool_change_is_refused() -> None:
    lines = TOOLS.text.splitlines(keepends=True)
    change = row_of(TOOLS.text, "T1 M6")
    header = [row for row in range(change) if not lines[row].startswith("(")]
    assert len(header) >= 5
    for pair in combinations(header, 2):
        kept = [line for row, line in enumerate(lines) if row not in pair]
        assert TOOLS.is_refused("".join(kept)), [lines[row] for row in pair]


@pytest.mark.parametrize("number", [1, 2])
def test_the_length_of_a_tool_without_its_number_is_a_fault(number: int) -> None:
    what = f"G43 without H: the length of tool {number} is asked for by H{number}"
    assert what in TOOLS.faults_after(f"G43 H{number}\n", "G43\n")


INHERITED = [("G20", "G21"), ("G91", "G90"), ("G18", "G17"), ("G19", "G17"), ("G90.1", "G91.1")]


@pytest.mark.parametrize(("code", "usual"), INHERITED)
@pytest.mark.parametrize("line", ["{}\nM2\n", "M2 {}\n"])
def test_a_mode_that_the_next_program_inherits_is_a_remark(
    code: str, usual: str, line: str
) -> None:
    faults = GCODE.faults_after("M2\n", line.format(code))
    assert f"{code} where posts write in {usual}" in faults


IDLE = [
    (NUMBERED, "T3 M6", "T1\nT3 M6", "T1 selects a tool that no M6 changes to"),
    (NUMBERED, "T3 M6", "T1 (x)\nG49\nT3 M6", "T1 selects a tool that no M6 changes to"),
    (SPUN, "M5\nM2", "M5 S1\nM2", "S1 without M3 or M4"),
    (SPUN, "M5\nM2", "M5\nS500\nM2", "S500 without M3 or M4"),
]


@pytest.mark.parametrize(("sample", "before", "after", "what"), IDLE)
def test_a_word_without_its_code_is_a_remark(
    sample: Sample, before: str, after: str, what: str
) -> None:
    assert what in sample.faults_after(before, after)


@pytest.mark.parametrize("code", ["G43 H1", "G49", "M9", "G90", "G64 P0.01 Q0", "M5"])
def test_the_lift_is_alone_in_its_line(code: str) -> None:
    faults = TOOLS.faults_after("T1 M6\nG53 G0 Z0\n", f"T1 M6\nG53 G0 Z0 {code}\n")
    assert "a code in the line of G53 G0 Z0, which posts write alone" in faults


#: Fractions of numbers that have to be whole.
GCODE_FRACTIONS = [
    (NUMBERED, "T3 M6", "T3.5 M6"),
    (NUMBERED, "T3 M6", "T2.9999 M6"),
    (TOOLS, "T1 M6", "T1.5 M6"),
    (TOOLS, "G43 H1", "G43 H1.5"),
    (GCODE, "M64 P0", "M64 P0.5"),
    (GCODE, "M65 P0", "M65 P0.9"),
]


@pytest.mark.parametrize(("sample", "before", "after"), GCODE_FRACTIONS)
def test_a_fraction_of_a_word_is_never_rounded(sample: Sample, before: str, after: str) -> None:
    assert sample.is_refused(sample.change(before, after))


@pytest.mark.parametrize("line", ["/", "/G1 X5", "/ (x)", "/G0 Z50"])
def test_a_slash_is_ignored_by_grbl_and_written_by_no_post(line: str) -> None:
    faults = GRBL.faults_after("M2\n", f"{line}\nM2\n")
    assert "a slash before a line, which GRBL ignores and no post writes" in faults


# V+

AFTER_RETURN = [
    "MOVES cg.work:TRANS(1,2,3,0,180,180)",
    "MOVE #PPOINT(0, 0, 0, 0, 30, 0)",
    "SPEED 5, 100 MMPS ALWAYS",
    "SET cg.work = TRANS(0,0,0)",
    "ANY SPEED 5",
    *("BREAK", "SIGNAL 33", "RETURN", "STOP", "PAUSE", "ELSE", "REACTE 1", "MMPS", "DETACH ()"),
    *('TYPE "x"', "CALL part()"),
]


@pytest.mark.parametrize("line", AFTER_RETURN)
def test_a_statement_after_return_never_runs(line: str) -> None:
    row = row_of(VPLUS.text, ".END")
    faults = VPLUS.list_faults(VPLUS.insert(row, line))
    assert Finding("refused", row + 1, "a statement after RETURN never runs") in faults


@pytest.mark.parametrize("line", ["10", "100", "10 BREAK", "65535 SPEED 20, 100 MMPS ALWAYS"])
def test_a_label_to_which_nothing_jumps_is_noted(line: str) -> None:
    text = VPLUS.insert(row_of(VPLUS.text, "BREAK"), line)
    label = line.split(maxsplit=1)[0]
    what = f"label {label}, to which no statement of a post jumps"
    assert what in [fault.what for fault in VPLUS.list_faults(text)]


@pytest.mark.parametrize(
    "statement", ["x = 5", "SET x = TRANS(1,2,3)", "SET #x = #PPOINT(0, 0, 0, 0, 0, 0)"]
)
def test_a_variable_that_no_post_sets_is_noted(statement: str) -> None:
    text = VPLUS.insert(row_of(VPLUS.text, "SIGNAL"), statement)
    what = "gets a value: programs of the post set tool and work alone"
    assert any(fault.what.endswith(what) for fault in VPLUS.list_faults(text))


# All languages


@pytest.mark.parametrize("sample", [RAPID, PACSCRIPT, PRESSING, VPLUS, TOOLS, GCODE, GRBL])
def test_a_text_without_two_lines_of_its_header_is_refused(sample: Sample) -> None:
    lines = sample.text.splitlines(keepends=True)
    marks = ("'", "!", "(", ";", "MODULE", "TASK PERS")
    header = [
        row
        for row, line in enumerate(lines)
        if line.strip() and not line.strip().startswith((*marks, "Move", "MOVE", "G0", "G1"))
    ]
    for pair in combinations(header[:12], 2):
        text = "".join(line for row, line in enumerate(lines) if row not in pair)
        assert sample.is_refused(text), [lines[row] for row in pair]
