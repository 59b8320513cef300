"""The settings of a controller are read from listings of GRBL and INI files of LinuxCNC."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.machine import Machine
from camgen.read.machine import read_machine

MACHINES = Path(__file__).parents[2] / "fixtures" / "machines"
ROUTER = (MACHINES / "router.txt").read_text()
MILL = (MACHINES / "mill.ini").read_text()


def machine(text: str | bytes, name: str = "machine.txt") -> Machine:
    data = text.encode() if isinstance(text, str) else text
    return read_machine(Source(Path(name), data))


def fault(text: str | bytes) -> str:
    with pytest.raises(InputError) as refused:
        machine(text)
    message = str(refused.value)
    assert "\n" not in message
    return message


def machine_or_error(text: str) -> Machine | str:
    try:
        return machine(text)
    except InputError as error:
        return str(error)


def changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1
    return text.replace(old, new)


def test_a_listing_of_grbl_gives_limits_in_mm_and_s() -> None:
    router = machine(ROUTER)
    assert (router.controller, router.post, router.corner) == ("GRBL", "grbl", "junction")
    # The listing has mm/min.
    assert router.axes.rates == pytest.approx((5000 / 60, 3500 / 60, 10.0))
    assert router.axes.accelerations == (350.0, 180.0, 60.0)
    assert router.axes.steps == (80.0, 160.0, 400.0)
    assert (router.low, router.high) == ((-400.0, -300.0, -90.0), (0.0, 0.0, 0.0))
    assert (router.deviation, router.chord) == (0.02, 0.002)
    # An idle delay of 255 keeps the motors on, so that the machine does not pause.
    assert router.pause == 0.0
    assert router.notes == ()


def test_a_listing_with_the_remarks_of_other_programs_is_read() -> None:
    noted = [
        line + " (a remark, mm/min)" if line.startswith("$") else line
        for line in ROUTER.splitlines()
    ]
    head = ["\ufeff>>> $$", "[VER:1.1h.20190830:]", "[OPT:V,15,128]", ""]
    session = [*head, *noted, "<Idle|FS:0,0>"]
    assert machine("\r\n".join(session)) == machine(ROUTER)
    assert machine(ROUTER + ROUTER) == machine(ROUTER)


def test_an_idle_delay_is_a_pause() -> None:
    assert machine(changed(ROUTER, "$1=255", "$1=25")).pause == 0.025


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("$1=255", "$1 = 25 ms of idle delay at a stop"),
        ("$12=0.002", "$12 = 0.002 mm of arc tolerance"),
        ("$101=160.000", "$101 = 250 steps/mm in Y"),
    ],
)
def test_a_setting_of_little_weight_is_assumed_with_a_note(setting: str, text: str) -> None:
    notes = machine(changed(ROUTER, setting + "\n", "")).notes
    assert [note.what for note in notes] == [text]
    assert notes[0].kind == "assumed"


@pytest.mark.parametrize(
    "name", ["$11", "$110", "$111", "$112", "$120", "$121", "$122", "$130", "$131", "$132"]
)
def test_a_limit_is_never_assumed(name: str) -> None:
    lines = [line for line in ROUTER.splitlines() if not line.startswith(name + "=")]
    remedy = "save all that GRBL answers to $$"
    assert fault("\n".join(lines)) == f"machine.txt: has no {name} (cell.machine); {remedy}"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("$120=350.000", "$120=fast", "$120 = fast is not a number (line 30)"),
        ("$120=350.000", "$120=", "$120 =  is not a number (line 30)"),
        ("$120=350.000", "$120=1e999", "$120 = 1e999 is not a finite number (line 30)"),
        ("$120=350.000", "$120=nan", "$120 = nan is not a number (line 30)"),
        ("$120=350.000", "$120=-350.000", "$120 = -350.000 is not above 0 (line 30)"),
        ("$120=350.000", "$120=1_000", "$120 = 1_000 is not a number (line 30)"),
        ("$120=350.000", "$120=3e9", "$120 = 3e9 is above 1e+09 (line 30)"),
        ("$120=350.000", "$120=1e-9", "$120 = 1e-9 is below 1e-06 (line 30)"),
        ("$110=5000.000", "$110=0.000", "$110 = 0.000 is not above 0 (line 27)"),
        ("$132=90.000", "$132=0.000", "$132 = 0.000 is not above 0 (line 35)"),
        ("$11=0.020", "$11=-0.020", "$11 = -0.020 is below 0 (line 10)"),
        ("$1=255", "$1=256", "$1 = 256 is above 255 (line 3)"),
        ("$120=350.000", "$120=350.000 $121=1", "$120 is followed by '_121=1' (line 30)"),
        ("$121=180.000", "$120=180.000", "$120 is 180.000 here and 350.000 in line 30 (line 31)"),
    ],
)
def test_a_fault_in_a_listing_names_its_line(old: str, new: str, message: str) -> None:
    assert fault(changed(ROUTER, old, new)).startswith(f"machine.txt: {message}; ")


def test_an_ini_file_of_linuxcnc_in_inches_gives_limits_in_mm() -> None:
    mill = machine(MILL)
    assert (mill.controller, mill.post, mill.corner) == ("LinuxCNC", "gcode", "arc")
    inch = 25.4
    assert mill.axes.rates == pytest.approx((3 * inch, 2.5 * inch, 1 * inch))
    assert mill.axes.accelerations == pytest.approx((20 * inch, 15 * inch, 10 * inch))
    assert mill.axes.steps is None
    assert mill.low == pytest.approx((-0.5 * inch, 0.0, -6 * inch))
    assert mill.high == pytest.approx((12 * inch, 8 * inch, 0.0))
    assert (mill.speed, mill.acceleration) == pytest.approx((4 * inch, 30 * inch))
    assert mill.deviation is None


@pytest.mark.parametrize(
    ("unit", "mm"), [("mm", 1.0), ("metric", 1.0), ("in", 25.4), ("IMPERIAL", 25.4)]
)
def test_the_units_of_an_ini_file_are_used(unit: str, mm: float) -> None:
    mill = machine(changed(MILL, "LINEAR_UNITS = inch", f"LINEAR_UNITS = {unit}"))
    assert mill.axes.rates[0] == pytest.approx(3.0 * mm)
    assert mill.high[0] == pytest.approx(12.0 * mm)


def test_the_limits_along_the_path_have_old_names_and_may_be_missing() -> None:
    old = changed(MILL, "MAX_LINEAR_VELOCITY", "MAX_VELOCITY")
    old = changed(old, "MAX_LINEAR_ACCELERATION", "MAX_ACCELERATION")
    assert machine(old) == machine(MILL)
    without = changed(old, "MAX_VELOCITY = 4.0\nMAX_ACCELERATION = 30.0\n", "")
    assert (machine(without).speed, machine(without).acceleration) == (math.inf, math.inf)


def test_joints_of_trivial_kinematics_limit_their_axis() -> None:
    slow = changed(
        MILL, "JOINT_1]\nTYPE = LINEAR\nMAX_VELOCITY = 2.5", "JOINT_1]\nMAX_VELOCITY = 2"
    )
    assert machine(slow).axes.rates[1] == pytest.approx(2 * 25.4)
    # With another kinematics, a joint is not an axis.
    bent = changed(slow, "trivkins coordinates=XYZ", "genserkins")
    assert machine(bent).axes.rates[1] == pytest.approx(2.5 * 25.4)
    # Joints 1 and 2 both move Y.
    gantry = changed(MILL, "coordinates=XYZ", "coordinates=xyyz")
    assert machine(gantry).axes.rates[1] == pytest.approx(1 * 25.4)
    joints = changed(MILL, "MAX_LIMIT = 8.0\nMAX_VELOCITY = 2.5\n", "MAX_LIMIT = 8.0\n")
    assert machine(joints).axes.rates[1] == pytest.approx(2.5 * 25.4)


def test_the_first_of_two_values_counts_and_comments_are_ignored() -> None:
    twice = changed(
        MILL, "MAX_LIMIT = 12.0", "MAX_LIMIT = 12.0\n# MAX_LIMIT = 1\n;x\nMAX_LIMIT = 2"
    )
    assert machine(twice) == machine(MILL)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("LINEAR_UNITS = inch\n", "", "has no [TRAJ] LINEAR_UNITS (cell.machine); add it"),
        ("LINEAR_UNITS = inch", "LINEAR_UNITS = ell", "[TRAJ] LINEAR_UNITS = ell is not known"),
        ("MIN_LIMIT = -6.0\n", "", "has no [AXIS_Z] MIN_LIMIT (cell.machine); add it"),
        ("MAX_LIMIT = 8.0", "MAX_LIMIT = -8.0", "[AXIS_Y] MIN_LIMIT = 0.0 leaves no travel"),
        ("MAX_LIMIT = 8.0", "MAX_LIMIT = 8.0 # in", "[AXIS_Y] MAX_LIMIT = 8.0 # in is not a num"),
        ("[AXIS_X]", "[AXIS_0]", "has no [AXIS_X] MIN_LIMIT (cell.machine)"),
        ("= -0.5", "= inf", "[AXIS_X] MIN_LIMIT = inf is not a number (line 17)"),
        ("MAX_LINEAR_VELOCITY = 4.0", "MAX_LINEAR_VELOCITY = 0", "[TRAJ] MAX_LINEAR_VELOCITY = 0"),
        ("[KINS]", "#INCLUDE kins.inc\n[KINS]", "#INCLUDE kins.inc is not followed (line 6)"),
    ],
)
def test_a_fault_in_an_ini_file_names_its_variable(old: str, new: str, message: str) -> None:
    assert fault(changed(MILL, old, new)).startswith(f"machine.txt: {message}")


@pytest.mark.parametrize("data", [b"", b"\x00\xff\x00", b"G21\nG0 X1\n", b"a = 1\n", b"<xml/>"])
def test_a_file_that_is_neither_a_listing_nor_an_ini_file_is_refused(data: bytes) -> None:
    assert fault(data).startswith("machine.txt: is neither a listing of GRBL's settings nor an INI")


@pytest.mark.parametrize("start", ["MAX_VELOCITY = ", "$120=", "[", "$", "#"])
def test_the_time_for_a_long_line_is_proportional_to_its_length(start: str) -> None:
    """A pattern that backtracks over half a million blanks would take hours."""
    line = start + " " * 500_000 + "x"
    assert fault("\n".join(["$1=25", "[TRAJ]", line])).count("\n") == 0
    assert fault("\n".join(["[TRAJ]", line])).count("\n") == 0


@given(
    st.sampled_from([ROUTER, MILL]),
    st.lists(
        st.tuples(st.integers(0, 60), st.text("$1290=[]#.-+eXYZ_ \\n\\x00é", max_size=12)),
        max_size=6,
    ),
)
def test_a_damaged_file_gives_valid_limits_or_is_refused(
    text: str, changes: list[tuple[int, str]]
) -> None:
    lines = text.splitlines()
    for place, line in changes:
        lines[place % len(lines)] = line
    result = machine_or_error("\n".join(lines))
    if isinstance(result, str):
        assert "\n" not in result
        return
    numbers = (*result.axes.rates, *result.axes.accelerations)
    assert all(math.isfinite(number) and number > 0 for number in numbers)
    assert all(low < high for low, high in zip(result.low, result.high, strict=True))
