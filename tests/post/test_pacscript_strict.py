"""PacScript: speeds, figures and types in the read-back, besides the tables of changes."""

import pytest

from camgen.lang.pacscript.strict import read
from tests.post.changes.pacscript import PROGRAMS, TARGET


def test_the_internal_speed_is_compared_with_the_option_unless_a_motion_uses_it() -> None:
    """A motion without a speed uses it, and then the speed of the motion is compared."""
    lines = (
        "TakeArm Keep = 0",
        "Speed 30",
        "Accel 50, 50",
        "ChangeTool 1",
        "ChangeWork 1",
        "Move P, @0 P(1, 2, 3)",
    )
    for last in ("Move P, @0 P(4, 5, 6)", "Move P, @0 P(4.0, 5.0, 6.0), Speed = 5"):
        text = "\n".join(("Sub Main", *lines, last, "GiveArm", "End Sub", ""))
        assert read({"a": text}, {}).findings == ()
    text = text.replace("P(1, 2, 3)", "P(1, 2, 3), Speed = 5")
    assert [fault.what for fault in read({"a": text}, {}).findings] == [
        "Speed 30, by post.internal_speed it is 10"
    ]


def test_a_fault_is_reported_before_a_remark_on_its_line() -> None:
    plain = PROGRAMS["plain"]
    faults = plain.list_faults(plain.change(TARGET, "(, 2, x)"))
    assert [fault.level == "unusual" for fault in faults] == [False, True, True]


def test_a_figure_after_an_open_one_may_be_any() -> None:
    """On a line to figure -1, axis 4 may pass half a turn."""
    text = PROGRAMS["plain"].text
    lines = text.splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if "Move L" in line)
    opened = list(lines)
    opened[first] = lines[first].replace(", 5)", ", -1)")
    arc = next(k for k, line in enumerate(lines) if "Move C" in line)
    other = [line.replace(", 5)", ", 1)") if k >= arc else line for k, line in enumerate(opened)]
    assert read({"a": "".join(opened)}, {}).findings == ()
    assert read({"a": "".join(other)}, {}).findings == ()


@pytest.mark.parametrize(
    ("declared", "value", "holds"),
    [
        ("Single", "0.5", True),
        ("Double", "0.5", True),
        ("Integer", "5", True),
        ("Integer", "0.5", False),
        ("Position", "P(1, 2, 3)", True),
        ("Position", "J(1)", False),
        ("Joint", "J(1)", True),
        ("Joint", "5", False),
        ("Vector", "V(1)", True),
        ("Vector", "P(1)", False),
        ("Trans", "T(1, 2, 3, 0, 1, 0, 0, 0, 1)", True),
        ("Variant", "P(1)", True),
        ("Variant", "5", True),
    ],
)
def test_a_variable_holds_what_its_type_does(declared: str, value: str, holds: bool) -> None:
    for text in (f"Dim a As {declared} = {value}", f"Dim a As {declared}\na = {value}"):
        faults = read({"a": f"Sub Main\n{text}\nEnd Sub\n"}, {}).findings
        assert any(fault.level != "unusual" for fault in faults) is not holds
