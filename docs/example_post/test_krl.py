"""Post and language agree on all programs of the conformance kit, with two sets of options."""

import pytest
from krl import Krl
from krl_language import KRL

from camgen.post.kit import Case, cases, check_case

MORE = {
    "signals": {"process": 3, "glue": 4, "spindle": 7},
    "spindle_rpm": 12000.0,
    "max_speed": 3000.0,
    "decimals": 4,
}
#: Parts of the text that mean nothing: a remark, the sign of 180 deg, and the last digit of the
#: auxiliary point of an arc, which may lie anywhere on it.
MEANINGLESS = (
    r";.*",
    r"[ABC]( |-)180\.0+",
    r"CIRC \{X -?\d+\.\d+(\d),",
    r"CIRC \{X [-.\d]+, Y -?\d+\.\d+(\d),",
)


@pytest.mark.parametrize("case", cases(), ids=str)
def test_conformance(case: Case) -> None:
    """As the options are by default: one output, up to 2000 mm/s."""
    lacks = {"force", "spindle", "signals", "stops", "tool changes", "split", "fast"}
    check_case(Krl, KRL, case, lacks=lacks, meaningless=MEANINGLESS)


@pytest.mark.parametrize("case", cases(), ids=str)
def test_conformance_with_options(case: Case) -> None:
    """With outputs for all signals, and a faster robot."""
    lacks = {"force", "stops", "tool changes", "split"}
    check_case(Krl, KRL, case, MORE, lacks, MEANINGLESS)
