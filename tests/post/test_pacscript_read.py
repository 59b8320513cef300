"""PacScript: programs written by hand, and the faults of wrong ones by line."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.pacscript.strict import read
from camgen.lang.programs import Executed
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output, Wait
from tests.support.pacscript_programs import OWN_TEMPLATE, SMALL, force_program, print_text

SHARED = Path(__file__).parents[2].parent / "shared"


def script(*lines: str, before: tuple[str, ...] = ()) -> str:
    """A program with the arm at (0, 0, 50), tool down. `lines` begin in line 4 after `before`."""
    head = (
        *before,
        "Sub Main",
        "TakeArm Keep = 0",
        "Move P, @0 P(0, 0, 50, 180, 0, 0), Speed = Mps(0.1)",
    )
    return "\n".join((*head, *lines, "GiveArm", "End Sub", ""))


#: Options of programs written by hand: Mps is in m/s, and the frames are those of the controller.
METRES: dict[str, object] = {"mps": "m/s", "tool": 0, "work": 0}


def read_lines(
    *lines: str, options: dict[str, object] | None = None, before: tuple[str, ...] = ()
) -> Executed:
    return read({"part.pcs": script(*lines, before=before)}, METRES | (options or {}))


def list_faults(reading: Executed) -> list[tuple[int, str]]:
    """Line and message of each finding except remarks."""
    return [(fault.line, fault.what) for fault in reading.findings if fault.level != "unusual"]


def last_motion(reading: Executed) -> MoveJ | MoveL | MoveC:
    """The last motion of a program without faults."""
    assert list_faults(reading) == []
    item = [item for item in reading.body if isinstance(item, (MoveJ, MoveL, MoveC))][-1]
    assert isinstance(item, (MoveJ, MoveL, MoveC))
    return item


S = ", Speed = Mps(0.1)"
EARLY = "after a motion that passes its target: it may come too early"
NOWHERE = "from a place that the text does not give"
FIRST = "the first motion is not Move P: where it starts is open"


@pytest.mark.parametrize(
    ("lines", "origin"),
    [
        (("Move L, P(1, 2, 3, 180)" + S,), (1, 2, 3)),
        (("move l, @e p( 1.5 , -2 , .5 ), s=mps( 0.1 )",), (1.5, -2, 0.5)),
        (("Move PTP, @0 T(1, 2, 3, 0, -1, 0, 0, 0, -1, 5)" + S,), (1, 2, 3)),
        (("Depart L, @0 30" + S,), (0, 0, 80)),  # the tool points down, so it departs upwards
        (("Depart P, 30" + S,), (0, 0, 80)),
        (("Approach P, P(5, 6, 7, 180), @0 40" + S,), (5, 6, 47)),
        (("Approach L, P(5, 6, 7, 180, 0, 0, -1), 2 * (3 + 4)" + S,), (5, 6, 21)),
        (("Draw L, @0 V(1, -2, 3)" + S,), (1, -2, 53)),
        (
            (
                "Dim a As Position = P(1, 2, 3), b As Integer",
                "b = 7",
                "Move L, @0 a" + S,
                "Draw L, V(b)" + S,
            ),
            (8, 2, 3),
        ),
        (("P[3] = P(4, 5, 6)", "Move L, @0 P3" + S), (4, 5, 6)),
        (("P12 = P(4, 5, 6)", "Move L, @0 P[10 + 2]" + S), (4, 5, 6)),
        (("Move L, @P P(1), @0 P(2, , 4)" + S,), (2, 0, 4)),
        (("Rem Move L, @0 P(9)", "Move L, @0 P(1) " + S + " ' not P(2)"), (1, 0, 0)),
        (
            (
                "Call Go(3, 2 * 2)",
                "End Sub",
                "Sub Go(ByVal a As Integer, b)",
                "Move L, @0 P(a, b)" + S,
            ),
            (3, 4, 0),
        ),
        (
            (
                "Call Go",
                "End Sub",
                "Sub Go()",
                "Move L, @0 P(1)" + S,
                "Exit Sub",
                "Move L, P(2)" + S,
            ),
            (1, 0, 0),
        ),
        (
            ("PrintDbg 5", "Motor On", "Accel 50, 20", "Decel 5", "Move L, P(&B101, &H1F)" + S),
            (5, 31, 0),
        ),
    ],
)
def test_a_motion_statement_moves_to_its_target(
    lines: tuple[str, ...], origin: tuple[float, float, float]
) -> None:
    target = last_motion(read_lines(*lines)).target
    assert isinstance(target, Pose)
    assert target.origin == pytest.approx(origin)


def test_a_homogeneous_position_states_the_axes_of_the_tool() -> None:
    # The orient vector is tool y, along -y; the approach vector is tool z, down. So tool x, the
    # cross product of y and z, is along +x.
    target = last_motion(read_lines("Move L, T(1, 2, 3, 0, -1, 0, 0, 0, -1)" + S)).target
    assert isinstance(target, Pose)
    assert np.allclose(target.rotation, TOOL_DOWN)


def test_joint_values_are_in_degrees_and_a_motion_may_have_several_targets() -> None:
    reading = read_lines("Move P, @P J(90, -45), @5 P(1), @0 J(0, 0, 180)" + S)
    assert list_faults(reading) == []
    first, second, third = reading.body[1:]
    assert isinstance(first, MoveJ)
    assert isinstance(second, MoveJ)
    assert isinstance(third, MoveJ)
    assert first.target == Joints((math.pi / 2, -math.pi / 4))
    assert third.target == Joints((0.0, 0.0, math.pi))
    assert [first.blend > 0, second.blend, third.blend] == [True, 5.0, 0.0]
    assert reading.lines == (3, 4, 4, 4)


@pytest.mark.parametrize(
    ("lines", "mm_s"),
    [
        (("Move L, P(1), Speed = 40",), 800.0),
        (("Speed 50", "Move L, P(1)"), 1000.0),
        (("Speed 50", "ExtSpeed 10", "Move L, P(1)"), 100.0),
        (("ExtSpeed 10, 5, 5", "Speed 50", "Move L, P(1), S = 20"), 40.0),
        (("ExtSpeed 50", "Move L, P(1), Speed = Mps(0.03)"), 15.0),
        (("Speed Mps(0.02)", "Move L, P(1)"), 20.0),
        (("Move L, P(1)",), 2000.0),
        (("Speed 10", "TakeArm Keep = 1", "Move L, P(1)"), 200.0),
        (("Speed 10", "TakeArm Keep = 0", "Move L, P(1)"), 2000.0),
    ],
)
def test_a_speed_is_the_internal_times_the_external_one(
    lines: tuple[str, ...], mm_s: float
) -> None:
    assert last_motion(read_lines(*lines, options={"rated": 2000.0})).speed == pytest.approx(mm_s)


def test_a_macro_stands_for_a_number_or_text() -> None:
    before = (
        "#Define PEN 24",
        "#define FEED Speed = Mps(0.02)",
        "#Define UP PEN_UP",
        "#Define PEN_UP 5",
    )
    reading = read_lines(
        "Set IO[PEN]", "Move L, @0 P(0, 0, UP), FEED", "Reset io[ pen ]", before=before
    )
    assert list_faults(reading) == []
    switched_on, move, switched_off = reading.body[1:]
    assert (switched_on, switched_off) == (Output("process", 1.0), Output("process", 0.0))
    assert isinstance(move, MoveL)
    assert (move.target.origin, move.speed) == ((0.0, 0.0, 5.0), 20.0)


def test_outputs_are_named_by_the_signals() -> None:
    reading = read_lines(
        "Set IO[24]", "Set IO[7]", "Delay 1500", options={"signals": {"coolant": 7}}
    )
    assert reading.body[1:] == (Output("IO[24]", 1.0), Output("coolant", 1.0), Wait(1.5))


def test_a_second_file_is_called_by_its_name_and_its_lines_are_counted_on() -> None:
    main = script("Call PartA")
    part = "Sub Main\nMove L, @0 P(7)" + S + "\nEnd Sub\n"
    reading = read({"part.pcs": main, "PartA.pcs": part}, METRES)
    assert list_faults(reading) == []
    assert reading.lines == (3, main.count("\n") + 2)


@pytest.mark.parametrize(
    ("lines", "line", "what"),
    [
        (("Frobnicate 5",), 4, "unknown statement Frobnicate 5"),
        (("Payload 1000, V(0, 0, 50), V(0, 0, 0)",), 4, "Payload is not evaluated"),
        (("Drive (1, 10)",), 4, "Drive is not evaluated"),
        (("Wait IO[3] = On",), 4, "Wait is not evaluated"),
        (("If IO[1] = On Then", "Set IO[24]", "End If"), 4, "If is not evaluated, up to line 6"),
        (("If IO[1] = On Then Set IO[24]",), 4, "If is not evaluated"),
        (
            ("For i = 1 To 3", "For j = 1 To 3", "Next", "Next i"),
            4,
            "For is not evaluated, up to line 7",
        ),
        (("Do While 1", "Loop"), 4, "Do is not evaluated, up to line 5"),
        (("Select Case x", "Case 1", "End Select"), 4, "Select is not evaluated, up to line 6"),
        (("If x Then",), 4, "If has no End If"),
        (("GoTo *a",), 4, "GoTo is not evaluated"),
        (("*a:",), 4, "unknown statement *a:"),
        (("Move S, 1",), 4, "Move S is not evaluated"),
        (("Move L, @0 home" + S,), 4, "unknown name home"),
        (("Move L, @0 P[4]" + S,), 4, "P[4] is not set in the text"),
        (("Move L, @0 P(1) Ex((7, 10))" + S,), 4, "extended axes are not evaluated"),
        (("Move L, @0 J(1, 2)" + S,), 4, "a straight line to joints is not evaluated"),
        (("Move L, @Q P(1)" + S,), 4, "the pass mark of @Q P(1) is not understood"),
        (("Move L" + S,), 4, "a motion without a target"),
        (("Move L, P(1), Speed = 0.05",), 4, "a speed of 0.05 %, the controller takes 0.1 to 100"),
        (("Move L, P(1), Speed = 101",), 4, "a speed of 101 %, the controller takes 0.1 to 100"),
        (
            ("Move L, P(1), Speed = 50",),
            4,
            "a speed in percent, taken of 1000 mm/s; give the option rated",
        ),
        (("Speed 0",), 4, "a speed of 0 %, the controller takes 0.1 to 100"),
        (("Move L, P(1e999)" + S,), 4, "a number is too large"),
        (("Move L, P(1/0)" + S,), 4, "a division by zero"),
        (("Move L, CurPos" + S,), 4, "unknown name curpos"),
        (("Move L, Dev(P(1), P(2))" + S,), 4, "the function dev is not evaluated"),
        (
            ("Move C, P(1, 1, 50), @0 P(2, 2, 50)" + S,),
            4,
            "the three points of the arc are on one line",
        ),
        (("Move C, P(1, 1, 50), @0 P(0, 0.1, 50)" + S,), 4, "an arc of more than 180 deg"),
        (("Move C, P(1, 1, 50)" + S,), 4, "Move C has 1 point instead of two"),
        (("Move P, J(1)" + S, "Move C, P(1, 1, 50), P(2, 0, 50)" + S), 5, f"an arc {NOWHERE}"),
        (("Move P, J(1)" + S, "Depart L, 5" + S), 5, f"a motion {NOWHERE}"),
        (("Move L, @P P(1)" + S, "Set IO[24]"), 5, f"an output {EARLY}"),
        (("Move L, @P P(1)" + S, "Delay 5"), 5, f"a delay {EARLY}"),
        (("Move L, P(1)" + S + ", Next", "Set IO[24]"), 5, f"an output {EARLY}"),
        (("Move L, @P P(1)" + S,), 4, "the last motion passes its target"),
        (("IO[24] = On",), 4, "unknown statement IO[24] = On"),
        (("Set IO[24], 500",), 4, "an output of IO[24], 500 is not evaluated"),
        (("Set IO[-1]",), 4, "-1 is not an index"),
        (("Delay -5",), 4, "a negative delay"),
        (("GiveArm", "Move L, P(1)" + S), 5, "a motion without TakeArm"),
        (("Call Absent",), 4, "unknown procedure Absent"),
        (("ChangeTool 3",), 4, "the tool frame changes after the first motion"),
        (("Work 0, P(1)",), 4, "the work frame changes after the first motion"),
        (
            ("ForceParam 1, 2, P(0, 5)", "ForceCtrl True, 2"),
            5,
            "the force table 2 is not set in the text",
        ),
        (("ForceParam 1, 1, P(0, 5)",), 4, "a force outside the work frame is not evaluated"),
        (("ForceParam 1, 2, P(0, 5), Rate = P(1)",), 4, "ForceParam with options is not evaluated"),
        (("ForceParam 1, 2, P(0, 5)", "ForceCtrl True, 1"), 6, "force control is on at the end"),
        (("' " + "x" * 1023,), 4, "a line of more than 1024 bytes"),
        (("Sub Other",), 4, "Sub Other begins inside another procedure"),
        (('#Include "a.h"',), 4, "#Include is not evaluated"),
        (
            ("#Define A A", "Move L, P(A)" + S),
            5,
            "a macro that refers to itself or grows without end",
        ),
        (("Move L, P(" + "(" * 300 + "1" + ")" * 301 + S,), 4, "brackets nested too deep"),
    ],
)
def test_a_wrong_statement_is_a_fault_in_its_line(
    lines: tuple[str, ...], line: int, what: str
) -> None:
    faults = list_faults(read_lines(*lines))
    assert (line, what) in faults
    assert len(faults) == 1 or what.endswith("another procedure")


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("", 1, "there is no Sub Main"),
        ("Move L, P(1)\n", 1, "a statement outside a procedure"),
        ("Sub Main\nTakeArm\n", 1, "the procedure has no end"),
        ("End Sub\n", 1, "End Sub closes nothing"),
        ("Sub Main\nEnd Sub\nSub main\nEnd Sub\n", 3, "a second procedure main"),
        ("Sub Main\nTakeArm\nMove L, P(1), Speed = Mps(1)\nEnd Sub\n", 3, FIRST),
        ("Sub Main\nMove P, P(1), Speed = Mps(1)\nEnd Sub\n", 2, "a motion without TakeArm"),
        ("Sub Main\nCall Main\nEnd Sub\n", 2, "procedures that call each other without end"),
    ],
)
def test_a_text_that_is_not_made_of_procedures_has_a_fault(text: str, line: int, what: str) -> None:
    findings = read({"a.pcs": text}, {}).findings
    assert (line, what) in [(fault.line, fault.what) for fault in findings]


def test_a_program_with_too_many_statements_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("camgen.lang.pacscript.strict._STEPS", 5000)
    subs = [f"Sub s{i}\n" + f"Call s{i + 1}\n" * 10 + "End Sub\n" for i in range(15)]
    text = "".join(("Sub Main\nCall s0\nEnd Sub\n", *subs, "Sub s15\nEnd Sub\n"))
    reading = read({"a.pcs": text}, {})
    assert "more statements than a program can have" in {fault.what for fault in reading.findings}


# Any text

WORDS = [
    "Move",
    "P",
    "L",
    "C",
    ",",
    "@0",
    "@P",
    "P(",
    "J(",
    "V(",
    ")",
    "[",
    "]",
    "=",
    "Speed",
    "Mps(",
    "1e9",
    "-",
    "'",
    '"',
    "Sub",
    "End Sub",
    "Call",
    "If",
    "Then",
    "For",
    "Next",
    "#Define",
    "Dim",
    "As",
    "IO[24]",
    "Set",
    "Delay",
    "ForceParam",
    "ForceCtrl",
    "True",
    "TakeArm",
    "Keep",
    "Work",
    "Tool",
    "\n",
    "\r",
    "\x0b",
    "0",
    "7",
    "&H",
    ".",
    "*",
    "/",
    "T(",
    "\0",
]


@given(st.data())
def test_a_changed_program_is_read_without_an_exception(data: st.DataObject) -> None:
    text = print_text(force_program(), force="template", max_lines=4, define=True)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(at, min(len(text), at + 40)))
        patch = data.draw(
            st.one_of(
                st.text(max_size=6), st.lists(st.sampled_from(WORDS), max_size=5).map(" ".join)
            )
        )
        text = text[:at] + patch + text[end:]
    reading = read({"a.pcs": text}, OWN_TEMPLATE if data.draw(st.booleans()) else {})
    assert len(reading.body) == len(reading.lines)
    assert all(1 <= fault.line <= text.count("\n") + 1 for fault in reading.findings)


@given(st.lists(st.sampled_from(WORDS), max_size=60).map(" ".join))
def test_words_in_any_order_are_read_without_an_exception(text: str) -> None:
    reading = read({"a.pcs": f"Sub Main\nTakeArm\n{text}\nEnd Sub\n"}, {})
    assert len(reading.body) == len(reading.lines)


OPTION_NAMES = st.sampled_from(["rated", "signals", "force_on", "force_off"])
OPTION_VALUES = st.one_of(
    st.none(),
    st.integers(),
    st.text(max_size=5),
    st.lists(st.text(max_size=5), max_size=2),
    st.dictionaries(st.text(max_size=3), st.one_of(st.integers(), st.text(max_size=3)), max_size=2),
)


@given(st.dictionaries(OPTION_NAMES, OPTION_VALUES))
def test_options_of_any_kind_raise_no_exception(options: dict[str, object]) -> None:
    reading = read({"a.pcs": SMALL}, options)
    assert len(reading.body) == len(reading.lines)


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the shared data folder beside the repository is absent"
)
def test_a_program_of_another_maker_has_faults_and_no_instructions() -> None:
    paths = sorted(path for path in (SHARED / "data" / "robot").rglob("*") if path.is_file())
    assert paths
    for path in paths:
        reading = read({path.name: path.read_text(encoding="latin-1")}, {})
        assert reading.findings, path
        assert reading.body == ()
