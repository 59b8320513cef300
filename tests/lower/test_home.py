"""The home of a machine is at the clearance height or above."""

from pathlib import Path

import pytest

import camgen
from camgen.model.errors import JobError
from camgen.model.program import Columns

PLATE = Path(__file__).parents[2] / "fixtures" / "parts" / "plate.dxf"


@pytest.mark.parametrize("height", [-10.0, 19.9])
@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_home_below_the_clearance_height_is_refused(post: str, height: float) -> None:
    job = {"cell": {"home": [0.0, 0.0, height]}, "process": {"clearance": 20.0}}
    with pytest.raises(JobError, match=r"below the clearance height, 20 mm \(cell.home\)"):
        camgen.build(PLATE, post=post, job=job)


@pytest.mark.parametrize(("clearance", "height"), [(20.0, 50.0), (60.0, 60.0)])
def test_the_built_in_home_is_at_least_at_the_clearance_height(
    clearance: float, height: float
) -> None:
    result = camgen.build(PLATE, post="gcode", job={"process": {"clearance": clearance}})
    ends = Columns(result.program.body).ends
    assert ends[0, 2] == ends[-1, 2] == height


def test_the_home_is_at_the_clearance_height_of_each_operation() -> None:
    operation = {"kind": "trace", "clearance": 70.0}
    job = {
        "tools": [{"name": "pen", "diameter": 1.0}],
        "operations": [{**operation, "tool": "pen"}],
    }
    result = camgen.build(PLATE, post="gcode", job=job)
    assert Columns(result.program.body).ends[0, 2] == 70.0
