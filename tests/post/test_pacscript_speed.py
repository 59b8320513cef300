"""PacScript: a program determines the unit of `Mps` on its controller, and other speeds."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from camgen_posts.pacscript import PacScript
from msgspec.structs import replace

import camgen
from camgen.lang.pacscript.strict import read
from camgen.lang.programs import Executed
from camgen.model.errors import Refused, VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about, translation
from camgen.model.program import Comment, Instruction, MoveJ, MoveL, Program
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.post.changes.pacscript import PRESSING, TEMPLATE
from tests.support.pacscript_programs import HOME, TOOL, down, print_text
from tests.support.whole import whole

WORK = translation(300, -75, 150)
SPEEDS = (100.0, 60.0, 12.5, 20.0)


def program(*body: Instruction) -> Program:
    return Program("part", WORK, TOOL, whole((MoveJ(HOME, 100.0), *body)))


def small_program() -> Program:
    return program(MoveJ(down(0, 0, 20), 60.0), MoveL(down(0), 12.5), MoveL(down(20), 20.0))


def verify(plan: Program, text: str, **options: object) -> None:
    post = make_post(PacScript, options)
    reading = read({"part.pcs": text}, options)
    compare(post.prepare(plan, 0.01), reading, post.tolerance(), post.list_verified(), "part.pcs")


# A simulated controller, which executes each statement of the text


def run(text: str, mps: Callable[[float], float], switched: list[str] | None = None) -> list[float]:
    """Runs a text on a controller and returns the speed of each motion, %.

    mps: the function Mps of the controller.
    switched: the statements that switch something are appended to it.
    """
    names: dict[str, object] = {"Mps": mps, "switched": [] if switched is None else switched}
    subs: dict[str, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("Sub "):
            subs[re.split(r"[ (]", line)[1]] = rows = []
        elif line.startswith("    ") and not line.strip().startswith("'"):
            rows.append(line.strip())
    return perform(subs, "Main", names)


def perform(subs: dict[str, list[str]], name: str, names: dict[str, object]) -> list[float]:
    """Executes a Sub and returns the speed of each motion, %."""
    speeds: list[float] = []
    skipping = False
    for row in subs[name]:
        if row.startswith("If "):
            skipping = not eval(row[3:-5].replace(" Or ", " or "), names)
        elif row == "End If":
            skipping = False
        elif skipping:
            continue
        elif row == "Exit Sub":
            return speeds
        elif row.startswith(("Set ", "Reset ", "Force")):
            names["switched"].append(row)  # type: ignore[attr-defined]
        elif row.startswith("Call "):
            speeds += perform(subs, re.split(r"[ (]", row)[1], dict(names))
        elif match := re.fullmatch(r"(?:Dim )?(\w+)(?: As Single)? = ([\d.]+)", row):
            names[match[1]] = float(match[2])
        elif match := re.search(r"^Move .*, Speed = (.*)", row):
            speeds.append(eval(match[1], names))
    return speeds


@pytest.mark.parametrize("fastest", [1500.0, 2000.0, 8250.0, 11000.0])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize("least", [0.0, 0.1])
@pytest.mark.parametrize("options", [{}, {"max_lines": 2}, {"ext_speed": 50.0}])
def test_every_arm_moves_at_the_planned_speed(
    fastest: float, unit: float, least: float, options: dict[str, object]
) -> None:
    """A controller may use `least` for a smaller percentage."""
    plan = program(*(MoveL(down(k), speed) for k, speed in enumerate(SPEEDS, 1)))
    plan = plan.with_body((plan.body[0], MoveJ(down(0), 100.0), *plan.body[1:]))
    speeds = run(print_text(plan, **options), lambda mps: max(100 * mps * unit / fastest, least))
    external = float(str(options.get("ext_speed", 100.0)))
    percent = 100 / fastest * 100 / external
    wanted = [max(speed * percent, least) for speed in (100.0, 100.0, *SPEEDS)]
    assert speeds == pytest.approx(wanted)


@pytest.mark.parametrize(
    "mps", [lambda speed: speed, lambda speed: -speed, lambda speed: 1e6 * speed, lambda _: 0.0]
)
def test_a_controller_whose_mps_is_not_a_percentage_moves_nothing(
    mps: Callable[[float], float],
) -> None:
    assert run(print_text(small_program()), mps) == []


#: The statements that switch off each output and force control.
OFF = ["Reset IO[24]", "Reset IO[7]", "ForceCtrl False ' verify"]


@pytest.mark.parametrize(
    "options", [{}, {"max_lines": 2}, {"mps": "mm/s"}, {"speed": "percent", "rated": 2000.0}]
)
def test_all_is_switched_off_before_the_test_of_mps(options: dict[str, object]) -> None:
    """The test may leave the Sub. An aborted run may have left outputs on."""
    text = print_text(program(*PRESSING), **TEMPLATE, **options)
    switched: list[str] = []
    assert (run(text, lambda _: 0.0, switched) == []) == (not options.keys() & {"mps", "speed"})
    assert switched[:3] == OFF
    starts = re.search(r"^ *(If|Set|Move|Call|ForceCtrl True)\b.*", text, re.MULTILINE)[0]
    places = [text.index(line) for line in ("TakeArm Keep = 0", OFF[0], OFF[2], starts)]
    assert places == sorted(set(places))
    # Once at the start, and once in the program itself.
    assert [text.count(line) for line in OFF] == [2, 2, 2]
    verify(program(*PRESSING), text, **TEMPLATE, **options)


def test_a_given_unit_of_mps_is_not_tested() -> None:
    for mps, speed in (("mm/s", "Mps(12.5)"), ("m/s", "Mps(0.0125)")):
        text = print_text(small_program(), mps=mps)
        assert text.count(f"Speed = {speed}\n") == 1
        assert "unit" not in text
        verify(small_program(), text, mps=mps)
        with pytest.raises(VerifyError, match="speed reads"):
            verify(small_program(), text, mps={"mm/s": "m/s", "m/s": "mm/s"}[mps])


def test_a_speed_in_percent_has_no_mps() -> None:
    assert "Mps" not in print_text(small_program(), speed="percent", rated=2000.0)


# The read-back in both units


def test_the_text_is_read_the_same_in_both_units() -> None:
    reading = read({"part.pcs": print_text(small_program())}, {})
    assert reading.findings == ()
    assert [item.speed for item in reading.body if isinstance(item, (MoveJ, MoveL))] == [
        100.0,
        60.0,
        12.5,
        20.0,
    ]
    verify(small_program(), print_text(small_program()))
    verify(small_program(), print_text(small_program(), max_lines=2), max_lines=2)


ARM = "depends on the arm"
UNIT = "as the controller reads Mps in mm/s or in m/s; give the option mps"


def test_a_wrong_factor_of_the_unit_is_another_speed() -> None:
    """With 1.5 and 0.0015 instead of 1 and 0.001 both units give one speed, but a wrong one."""
    text = (
        print_text(small_program())
        .replace("Single = 1\n", "Single = 1.5\n")
        .replace("unit = 0.001", "unit = 0.0015")
    )
    faults = read({"part.pcs": text}, {}).findings
    assert [fault.what for fault in faults if fault.level != "unusual"] == [
        f"whether 150 mm/s is over 20 % {ARM}"
    ]
    begin, end = text.index("    If Mps(100"), text.index("    Speed 10\n")
    with pytest.raises(VerifyError, match=OTHERWISE):
        verify(small_program(), text[:begin] + text[end:])
    body = read({"part.pcs": text[:begin] + text[end:]}, {}).body
    speeds = [item.speed for item in body if isinstance(item, MoveL)]
    planned = [item.speed for item in small_program().body if isinstance(item, MoveL)]
    assert speeds == pytest.approx([1.5 * speed for speed in planned])


def script(*lines: str, head: str = "Move P, @0 P(0, 0, 50, 180, 0, 0), Speed = 10") -> Executed:
    begin = ("Sub Main", "TakeArm Keep = 0", "Speed 10", "Accel 50, 50", head)
    text = "\n".join((*begin, *lines, "GiveArm", "End Sub", ""))
    return read({"part.pcs": text}, {"tool": 0, "work": 0})


ASSIGNED = "a variable gets a value, outside the question of the post for Mps"
NOT_ASKED = (
    "a speed that depends on the unit of Mps, "
    "and the questions of the post for it are not asked before"
)
OTHERWISE = "Mps is asked otherwise than by the programs of the post"


def test_a_program_that_does_not_test_mps_leaves_its_speeds_open() -> None:
    reading = script("Move L, P(1), Speed = Mps(30)", "Move L, P(2), Speed = Mps(20)")
    (remark,) = reading.findings
    assert remark.level == "unusual"
    assert (remark.line, remark.what) == (6, f"30 or 30000 mm/s, {UNIT}")
    assert [item.speed for item in reading.body[1:] if isinstance(item, MoveL)] == [30.0, 20.0]


@pytest.mark.parametrize(
    ("lines", "speed"),
    [
        (("a = 1", "If Mps(0.1) < 0.2 Then", "a = 2", "Else", "a = 0.002", "End If"), 80.0),
        (("a = 2", "If (0.2 < Mps(0.1)) Then", "a = a / 1000", "EndIf"), 80.0),
        (
            ("a = 2", "If (Mps(0.1) > 0.2) And (Mps(0.2) > 0.3) Then", "a = 1 - 0.998", "End If"),
            80.0,
        ),
        (
            (
                "a = 2",
                "If Mps(0.1) > 40 Then",
                "Move L, P(1)",
                "If x Then",
                "y",
                "End If",
                "End If",
                "a = 2",
                "If Mps(0.1) > 0.2 Then",
                "a = 0.002",
                "End If",
            ),
            80.0,
        ),
    ],
)
def test_another_test_of_mps_is_read_with_remarks(lines: tuple[str, ...], speed: float) -> None:
    reading = script(*lines, "Move L, P(1), Speed = Mps(a * 40)")
    assert all(fault.level == "unusual" for fault in reading.findings)
    assert {fault.what for fault in reading.findings} == {OTHERWISE, ASSIGNED, NOT_ASKED}
    assert reading.body[-1].speed == pytest.approx(speed)  # type: ignore[union-attr]


def test_a_condition_without_mps_is_not_evaluated() -> None:
    for condition in ("IO[3] = On", "a > 3"):
        _, fault = script("a = 4", f"If {condition} Then", "a = 5", "End If").findings
        assert fault.what == "If is not evaluated, up to line 9"
    (fault,) = script("If Mps(0.1) > 0.2 Then", "a = 5", "ElseIf 1 < 2 Then", "End If").findings
    assert fault.what == "If is not evaluated, up to line 9"


# Joint motions by their speed fraction


def with_fraction(share: float) -> Program:
    """A program with a joint motion at a speed fraction."""
    return program(MoveJ(down(0, 0, 20), 60.0, share=share), MoveL(down(0), 12.5))


@pytest.mark.parametrize(
    "options", [{}, {"speed": "percent", "rated": 2000.0}, {"ext_speed": 40.0}]
)
def test_a_speed_fraction_is_printed_in_percent(options: dict[str, object]) -> None:
    text = print_text(with_fraction(0.123456), **options)
    external = float(str(options.get("ext_speed", 100.0)))
    (line,) = (row for row in text.splitlines() if "Move P, @0 P(" in row)
    assert float(line.rpartition("= ")[2]) == pytest.approx(12.3456 * 100 / external)
    verify(with_fraction(0.123456), text, **options)


def test_a_post_without_speed_fractions_verifies_the_speed() -> None:
    """A speed fraction is that of one controller only."""
    plan = with_fraction(0.5)
    body = [replace(item, share=0.0) if isinstance(item, MoveJ) else item for item in plan.body]
    reading = Executed(tuple(body), (1,) * 3, ())
    carries = PacScript.verified_fields - {"joint-share"}
    compare(plan, reading, PacScript().tolerance(), carries, "part")
    body[1] = replace(reading.body[1], speed=59.0)
    slower = Executed(tuple(body), (1,) * 3, ())
    with pytest.raises(VerifyError, match="speed reads 59, planned is 60"):
        compare(plan, slower, PacScript().tolerance(), carries, "part")


@pytest.mark.parametrize(
    ("share", "external", "percent"), [(0.0005, 0.0, "0.05"), (0.5, 30.0, "166.7")]
)
def test_a_speed_fraction_that_no_controller_takes_is_refused(
    share: float, external: float, percent: str
) -> None:
    message = (
        f"pacscript: 60 mm/s is {percent} % of what the joints can do on this way (instruction 1); "
        "the controller takes 0.1 to 100 %; change the speed or post.ext_speed"
    )
    with pytest.raises(Refused) as refused:
        print_text(with_fraction(share), ext_speed=external)
    assert str(refused.value) == message


# Reorientations


def reorientation(degrees: float) -> Program:
    """A program with a reorientation by 90 deg at a fixed TCP, at `degrees` per second."""
    turned = frozen(rotation_about(2, math.pi / 2) @ TOOL_DOWN)
    quarter = MoveL(Pose(turned, (0.0, 0.0, 0.0)), 20.0, turn=math.radians(degrees))
    return program(MoveL(down(0), 12.5), quarter, MoveL(Pose(turned, (9.0, 0.0, 0.0)), 20.0))


@pytest.mark.parametrize(
    ("options", "percent"),
    [
        ({}, "12"),  # 60 of 500 deg/s
        ({"rated_turn": 240.0}, "25"),
        ({"rated_turn": 700.0}, "8.5714"),
        ({"ext_speed": 50.0}, "24"),
        ({"mps": "m/s"}, "12"),
        ({"speed": "percent", "rated": 2000.0}, "12"),
    ],
)
def test_a_reorientation_has_a_percentage_of_the_rated_turn(
    options: dict[str, object], percent: str
) -> None:
    text = print_text(reorientation(60.0), **options)
    before, turn, after = (row.strip() for row in text.splitlines() if "Move L" in row)
    target = "P(0.000, 0.000, 0.000, 180.0000, 0.0000, 90.0000, -1)"
    assert turn == f"Move L, @0 {target}, Speed = {percent}"
    if "speed" not in options:
        assert "Mps(" in before
        assert "Mps(" in after
    verify(reorientation(60.0), text, **options)
    reading = read({"part.pcs": text}, options)
    turns = [item.turn for item in reading.body if isinstance(item, MoveL)]
    tolerance = PacScript(rated_turn=700.0).tolerance().turn
    assert turns == pytest.approx([0.0, math.radians(60.0), 0.0], abs=tolerance)


def test_a_reorientation_below_the_digits_of_the_text_verifies() -> None:
    rotation = frozen(rotation_about(2, 1e-9) @ TOOL_DOWN)
    plan = program(
        MoveL(down(0), 12.5), MoveL(Pose(rotation, (0.0, 0.0, 0.0)), 20.0, turn=math.radians(60.0))
    )
    text = print_text(plan)
    verify(plan, text)
    with pytest.raises(VerifyError, match="speed of turning reads"):
        verify(plan, text.replace("Speed = 12\n", "Speed = 13\n"))


def test_a_reorientation_that_was_printed_for_another_arm_does_not_verify() -> None:
    with pytest.raises(VerifyError, match="speed of turning"):
        verify(reorientation(60.0), print_text(reorientation(60.0), rated_turn=240.0))


@pytest.mark.parametrize(
    ("degrees", "options", "numbers"),
    [
        (0.4, {}, "a turn at 0.4 deg/s is 0.08 % of 500"),
        (501.0, {}, "a turn at 501 deg/s is 100.2 % of 500"),
        (60.0, {"rated_turn": 50.0}, "a turn at 60 deg/s is 120 % of 50"),
        (60.0, {"ext_speed": 10.0}, "a turn at 60 deg/s is 120 % of 500"),
    ],
)
def test_a_reorientation_that_no_controller_makes_is_refused(
    degrees: float, options: dict[str, object], numbers: str
) -> None:
    with pytest.raises(Refused) as refused:
        print_text(reorientation(degrees), **options)
    assert str(refused.value) == (
        f"pacscript: {numbers}, the controller takes 0.1 to 100 %; "
        "change process.turn or correct post.rated_turn (instruction 2)"
    )
    for within in (0.5, 500.0):
        verify(reorientation(within), print_text(reorientation(within)))


def test_a_reorientation_under_force_keeps_its_force() -> None:
    press = (0.0, 1.0, 0.0)
    turned = frozen(rotation_about(2, 0.3) @ TOOL_DOWN)
    quarter = MoveL(Pose(turned, (2.0, 0.0, 0.0)), 20.0, 0.0, 9.0, press, turn=1.0)
    plan = program(*PRESSING[:4], quarter, *PRESSING[4:])
    text = print_text(plan, **TEMPLATE)
    assert text.count("Speed = 11.4592\n") == 1  # 57.2958 of 500 deg/s
    verify(plan, text, **TEMPLATE)


# The minimum speed


@pytest.mark.parametrize(
    ("speed", "options", "warning"),
    [
        (11.0, {}, ""),
        (5.0, {}, "5 mm/s, under 0.1 % of an arm that does more than 5000 mm/s"),
        (5.0, {"ext_speed": 40.0}, ""),
        (5.0, {"rated": 2000.0}, ""),
        (5.0, {"rated": 2000.0, "speed": "percent"}, ""),
    ],
)
def test_a_speed_that_may_be_below_the_minimum_has_a_warning(
    speed: float, options: dict[str, object], warning: str
) -> None:
    plan = program(MoveJ(down(0, 0, 20), 60.0), MoveL(down(0), speed))
    text = print_text(plan, **options)
    assert (f"' slowest motion: {warning}\n" in text) == bool(warning)
    assert ("slowest" in text) == bool(warning)
    notes = make_post(PacScript, options).warn(plan)
    assert [note.what for note in notes] == ([f"slowest motion: {warning}"] if warning else [])


def test_the_tcp_speed_of_a_reorientation_has_no_warning() -> None:
    plan = reorientation(60.0)
    body = [replace(item, speed=1.0) if getattr(item, "turn", 0) else item for item in plan.body]
    slow = plan.with_body(tuple(body))
    assert "slowest" not in print_text(slow)
    assert make_post(PacScript, {}).warn(slow) == ()


def test_a_build_reports_the_warning() -> None:
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    slow = camgen.build(part, post="pacscript", job={"process": {"feed": 4.0}}).notes
    assert "warning: slowest motion: 1 mm/s, under 0.1 % of an arm" in "\n".join(map(str, slow))
    fast = camgen.build(part, post="pacscript", job={"process": {"feed": 80.0}}).notes
    assert "slowest" not in "\n".join(map(str, fast))


# Spellings of third-party programs


def test_a_statement_may_continue_on_the_next_lines() -> None:
    reading = script("Set _", "IO[24]", "Move P, _", "  P(1, 2, _", "\t3), Speed = 10", "Delay 5")
    assert reading.findings == ()
    assert reading.lines == (5, 6, 8, 11)
    assert reading.body[2].target.origin == (1.0, 2.0, 3.0)  # type: ignore[union-attr]
    move = "Move P, @0 P(1.000, 2.000, 3.000), Speed = 10"
    (fault,) = script("Delay _", move).findings  # `move` alone would be a motion
    assert fault.line == 6
    (fault,) = read({"a.pcs": "Sub Main\nEnd Sub\nDelay _"}, {}).findings
    assert (fault.line, fault.what) == (3, "the statement goes on after the last line")


def test_a_position_without_its_p_and_an_unusual_pass_mark_are_remarks() -> None:
    reading = script(
        "Move L, @C (1, 2, 3, 180, 0, 90, 5), Speed = 10", "Move L, @0 (4, 5, 6), Speed = 10"
    )
    faults = [fault.what for fault in reading.findings]
    assert faults == [
        "a speed in percent, taken of 1000 mm/s; give the option rated",
        "a position stands without its P",
        "the pass mark @C, which no program of the post says",
    ]
    first, second = reading.body[1:]
    assert isinstance(first, MoveL)
    assert isinstance(second, MoveL)
    assert (first.target.origin, first.blend > 0) == ((1.0, 2.0, 3.0), True)
    assert first.posture is not None
    assert first.posture.figure == 5
    # Rz(90) Rx(180) turns tool x to work y.
    assert first.target.rotation[:, 0].round(9).tolist() == [0.0, 1.0, 0.0]
    assert (second.target.origin, second.blend) == ((4.0, 5.0, 6.0), 0.0)


def test_two_values_in_brackets_are_not_a_position() -> None:
    (fault,) = script("a = (1, 2)").findings
    assert fault.what == "two values in brackets are not evaluated"


def test_a_comment_never_ends_in_a_continuation_mark() -> None:
    """In Basic a line that ends in a blank and _ continues on the next one, maybe in a comment."""
    text = print_text(
        program(Comment("layer _"), Comment("_"), Comment("a_"), MoveJ(down(0), 10.0))
    )
    assert "    ' layer _.\n    ' _.\n    ' a_\n" in text
    assert read({"a.pcs": text}, {}).findings == ()
    (remark,) = read({"a.pcs": text.replace("layer _.", "layer _")}, {}).findings
    assert remark.level == "unusual"
    assert remark.what == "a comment that ends in _: the controller may join the next line to it"


@pytest.mark.parametrize("name", ["unit", "Status", "log", "TrackMove"])
def test_a_word_of_the_language_does_not_name_a_program(name: str) -> None:
    (file,) = PacScript().render(replace(small_program(), name=name))
    assert file.name == f"job_{name}.pcs"
