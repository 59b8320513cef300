"""Defaults that the form shows, as they held in a build."""

from pathlib import Path

import camgen
from camgen.workbench.usual import find_defaults

FIXTURES = Path(__file__).parents[2] / "fixtures"


def test_the_acceleration_of_a_machine_is_no_default() -> None:
    """A machine has an acceleration for each axis; the setting beside it would be refused."""
    part = FIXTURES / "parts" / "bracket.dxf"
    plain = camgen.build(part, post="grbl")
    assert find_defaults(plain)["process"]["acceleration"] == 500.0
    machine = {"cell": {"machine": str(FIXTURES / "machines" / "router.txt")}}
    named = camgen.build(part, post="grbl", job=machine)
    assert "acceleration" not in find_defaults(named)["process"]
