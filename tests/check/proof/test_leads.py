"""Leads that the proof accepts: on ramps, beside links at working height and rounded corners."""

import math
from typing import Any

import pytest

import camgen
from camgen.model.errors import VerifyError
from camgen.pipeline import Result
from tests.check.proof.test_saboteurs import wrong_radius
from tests.support.drawn import circle, contour, part, rectangle
from tests.support.sabotage import Patch

MILL = {"spindle": 9000.0}


def build(
    diameter: float, process: dict[str, Any], post: str = "gcode", **operation: Any
) -> Result:
    """A program beside a plate with a hole, and beside a small plate next to it."""
    drawn = part(
        rectangle(-20, -20, 40, 40), circle(0, 0, 4, "hole"), rectangle(40, 0, 20, 10, "small")
    )
    job = {"tool": {"diameter": diameter}, "operation": operation, "process": process}
    return camgen.build(drawn, post=post, job=job)


@pytest.mark.parametrize("post", ["rapid", "vplus", "gcode"])
def test_leads_beside_links_at_working_height_may_have_any_length(
    post: str, monkeypatch: Patch
) -> None:
    """The proof states that it does not examine them."""
    leads = {"lead_in": 0.5, "lead_out": 0.5, "finish": 0.3}
    result = build(3.0, {"stay_down": True}, post, **leads)
    assert result.motion.contours == 3
    assert [text for text in result.motion.unproven if text.startswith("length and shape of leads")]
    wrong_radius(monkeypatch)
    with pytest.raises(VerifyError):
        build(3.0, {"stay_down": True}, post, **leads)


def test_a_lead_out_ends_before_a_ramp_to_the_next_depth() -> None:
    """The first chord of the ramp goes down by less than 0.01 mm."""
    operation = {"lead_out": 2.0, "depth": 1.0, "passes": 3, "entry": "ramp"}
    job = {"tool": {"diameter": 0.5}, "operation": operation, "process": MILL}
    result = camgen.build(part(rectangle(0, 0, 20, 10)), post="gcode", job=job)
    assert result.motion.contours == 1


def test_a_ramp_onto_a_short_contour_runs_along_its_lead_out() -> None:
    """The way around the hole is 6 mm long, the ramp 95 mm."""
    result = build(6.0, MILL, lead_out=1.0, depth=5.0, entry="ramp")
    assert result.motion.contours == 3


def test_a_chord_of_a_lead_may_be_where_an_inner_corner_could_be_rounded() -> None:
    leads = {"lead_in": 2.0, "lead_out": 2.0}
    result = build(3.0, {}, "vplus", finish=1.0, corner_radius=0.3, **leads)
    assert result.motion.contours == 3


def test_a_link_between_two_walls_is_no_motion_along_both() -> None:
    """It begins 1.8 mm from one wall of the slot, and ends 1.5 mm from the other one."""
    corners = [(0, 0), (10, 0), (10, 4), (0, 4)]
    drawn = part(circle(5, -10.5, 16), contour(corners, [0.0, 1.0, 0.0, 1.0], name="slot"))
    job = {
        "tool": {"diameter": 3.0},
        "operation": {"finish": 0.3, "overlap": 0.5},
        "process": {"stay_down": True},
    }
    assert camgen.build(drawn, post="pacscript", job=job).motion.contours == 2


def test_a_lead_from_a_rounded_corner_is_named_as_unproven() -> None:
    """The path around the circle begins on the arc between circle and hexagon."""
    hexagon = [
        (10 + 2 * math.cos(k * math.pi / 3), 2 * math.sin(k * math.pi / 3)) for k in range(6)
    ]
    drawn = part(circle(5.2, 8.5, 2), contour(hexagon, name="hexagon"))
    operation = {"corner_radius": 3.0, "lead_out": 0.5}
    job = {"tool": {"diameter": 1.0}, "operation": operation}
    result = camgen.build(drawn, post="pacscript", job=job)
    assert result.motion.contours == 2


def test_a_lap_may_end_on_a_rounded_corner_and_leave_it_by_a_lead() -> None:
    """The path around the last shape does. The others cross each other, or are near to those."""
    first = [(0, 20), (0, 40), (30, 40), (30, 30), (10, 30), (10, 20)]
    second = [(20, 15), (30, 15), (30, 35), (40, 35), (40, 5), (20, 5)]
    third, fourth = [(40, 0), (30, 0), (30, 20), (40, 20)], [(25, 30), (25, 40), (15, 40), (15, 30)]
    shapes = []
    for number, corners in enumerate((first, second, third, fourth)):
        shapes.append(contour([(x, -y) for x, y in corners], name=f"c{number}"))
    operation = {"corner_radius": 0.3, "lead_out": 2.0}
    job = {"tool": {"diameter": 2.0}, "operation": operation, "process": {"stay_down": True}}
    result = camgen.build(part(*shapes), post="rapid", job=job)
    assert [path.id for path in result.planned] == ["c3"]
    assert result.motion.contours == 1
