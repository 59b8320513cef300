"""Limits of tools and stock, which jobs exceed by a known amount or keep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import camgen
from camgen.model.errors import NoSafeProgram
from camgen.pipeline import Result

PARTS = Path(__file__).parents[3] / "fixtures" / "parts"
#: A mill of 6 mm with two flutes that ramps down in passes of 3 mm, in aluminium of 6 mm.
SOUND: Mapping[str, Mapping[str, Any]] = {
    "stock": {"thickness": 6.0, "material": "aluminium", "held": "tape"},
    "tool": {"diameter": 6.0, "cutting_length": 20.0, "max_speed": 20_000.0},
    "operation": {"depth": 6.0, "passes": 2, "entry": "ramp"},
    "process": {"spindle": 12_000.0, "feed": 8.0, "max_feed_factor": 1.0},
}


def build(changes: Mapping[str, object], strict: bool = False) -> Result:
    """Build the bracket for LinuxCNC with changes of the sound job, by `table.key`."""
    job = {name: dict(keys) for name, keys in SOUND.items()}
    for name, value in changes.items():
        table, key = name.split(".")
        job[table][key] = value
    return camgen.build(PARTS / "bracket.dxf", post="gcode", job=job, strict=strict)


def list_exceeded(changes: Mapping[str, object]) -> list[str]:
    """The texts of the limits that a job exceeds."""
    proof = build(changes).proof
    assert proof is not None
    return [breach.what for breach in proof.set_up.breaches]


def test_a_sound_job_exceeds_no_limit_and_all_limits_are_examined() -> None:
    result = build({}, strict=True)
    assert result.proof is not None
    assert result.proof.set_up.breaches == ()
    assert result.proof.set_up.unexamined == ()
    assert len(result.proof.set_up.examined) == 6


#: Feed per tooth, mm, and rpm of a mill of 6 mm by HIT's chart for 6061: 0.0018 inch at 3/16 inch,
#: 0.0022 inch at 1/4 inch, 2200 feet per minute.
TOOTH_MM = 25.4 * (0.0018 + 0.0004 * (6 / 25.4 - 3 / 16) * 16)
MAX_RPM = 2200 * 304.8 / (6 * math.pi)


@pytest.mark.parametrize(
    ("changes", "value", "limit"),
    [
        ({"operation.depth": 6.6}, "goes 6.6 mm deep", "6 mm thick and 0.5 mm below it"),
        ({"operation.depth": 6.6, "stock.below": 0.6}, "", ""),
        (
            {"operation.depth": 30.0, "operation.passes": 9, "tool.cutting_length": 30.0},
            "goes 30 mm deep",
            "6 mm thick",
        ),
        ({"tool.cutting_length": 5.0}, "goes 6 mm deep", "edges are 5 mm long"),
        (
            {"stock.thickness": 9.0, "operation.depth": 9.0, "operation.passes": 1},
            "takes 9 mm in one pass",
            "at most 6 mm are usual (1 diameters)",
        ),
        ({"stock.material": "mdf", "operation.passes": 1, "process.feed": 20.0}, "", ""),
        ({"operation.entry": "plunge"}, "goes straight down, 3 mm into material", ""),
        ({"operation.entry": "plunge", "tool.center_cutting": True}, "", ""),
        (
            {"process.feed": 24.0},
            "is fed 0.06 mm a tooth",
            f"in aluminium at most {TOOTH_MM:.3f} mm",
        ),
        ({"process.feed": 24.0, "tool.flutes": 3}, "", ""),
        ({"process.feed": 24.0, "process.spindle": 18_000.0}, "", ""),
        (
            {"process.spindle": 40_000.0, "tool.max_speed": 50_000.0},
            "turns at 40000 rpm",
            f"{MAX_RPM:.0f}",
        ),
    ],
)
def test_a_limit_is_exceeded_or_kept(changes: Mapping[str, object], value: str, limit: str) -> None:
    lines = list_exceeded(changes)
    assert len(lines) == bool(value)
    for line in lines:
        assert value in line
        assert limit in line


def test_the_depth_of_a_pass_is_that_of_the_remaining_material() -> None:
    """The first operation removes 2.4 mm, and the second one the next 2.4 mm."""
    tool = {"name": "mill", "diameter": 2.5, "speed": 12_000.0, "feed": 3.0}
    steps = [
        {"kind": "follow", "tool": "mill", "depth": depth, "entry": "ramp"} for depth in (2.4, 4.8)
    ]
    job = {"stock": {"thickness": 5.0, "material": "steel", "held": "tape"}, "tools": [tool]}
    proof = camgen.build(
        PARTS / "bracket.dxf", post="gcode", job={**job, "operations": steps}
    ).proof
    assert proof is not None
    assert [line.what for line in proof.set_up.breaches if "one pass" in line.what] == []
    alone = camgen.build(
        PARTS / "bracket.dxf", post="gcode", job={**job, "operations": steps[1:]}
    ).proof
    assert alone is not None
    assert any("takes 4.8 mm in one pass" in line.what for line in alone.set_up.breaches)


def test_the_tip_of_a_drill_may_go_below_the_stock() -> None:
    """A drill of 8 mm has a tip of 4 / tan 59 deg = 2.403 mm."""
    job = {
        "stock": {"thickness": 5.0, "held": "tape"},
        "tool": {"kind": "drill", "diameter": 8.0},
        "process": {"spindle": 1500.0, "feed": 2.0},
    }
    for depth, lines in ((7.9, 0), (7.92, 1)):
        drill = {"kind": "drill", "depth": depth}
        proof = camgen.build(
            PARTS / "bracket.dxf", post="gcode", job={**job, "operation": drill}
        ).proof
        assert proof is not None
        assert len(proof.set_up.breaches) == lines


def test_a_plunge_into_a_drilled_hole_is_not_into_material() -> None:
    tools = [
        {"name": "drill", "number": 1, "kind": "drill", "diameter": 8.0, "speed": 1500.0},
        {"name": "mill", "number": 2, "diameter": 4.0, "speed": 9000.0, "feed": 5.0},
    ]
    holes = {"kind": "drill", "tool": "drill", "depth": 4.0}
    again = {"kind": "drill", "tool": "mill", "holes": [7.9, 8.1], "depth": 3.0}
    outline = {"kind": "follow", "tool": "mill", "layers": ["OUTLINE"], "depth": 3.0}
    outline |= {"entry": "ramp", "passes": 3}
    lines = {}
    for name, steps in (("alone", [again, outline]), ("drilled", [holes, again, outline])):
        job = {"stock": {"thickness": 5.0, "held": "tape"}, "tools": tools, "operations": steps}
        proof = camgen.build(PARTS / "bracket.dxf", post="gcode", job=job).proof
        assert proof is not None
        lines[name] = [line.what for line in proof.set_up.breaches]
    assert any("straight down" in line for line in lines["alone"])
    assert not any("straight down" in line for line in lines["drilled"])


def test_a_tool_that_only_drills_has_the_feed_limit_of_a_drill() -> None:
    """HIT: a drill of 8 mm in aluminium has at most 0.0074 inch per turn, 3.76 mm/s at 1200 rpm.

    The second peck begins above the face, since the first one is shorter than the approach.
    """
    job = {
        "stock": {"thickness": 9.0, "material": "aluminium", "held": "tape"},
        "tool": {"diameter": 8.0},
        "operation": {"kind": "drill", "depth": 9.0, "passes": 4},
    }
    for feed, lines in ((3.7, 0), (3.85, 1)):
        process = {"spindle": 1200.0, "feed": feed}
        proof = camgen.build(
            PARTS / "bracket.dxf", post="gcode", job={**job, "process": process}
        ).proof
        assert proof is not None
        assert len(proof.set_up.breaches) == lines
        assert all("a turn" in breach.what for breach in proof.set_up.breaches)


@pytest.mark.parametrize(("kind", "lines"), [("end mill", 1), ("drill", 0)])
def test_an_end_mill_that_only_drills_is_noted_as_an_assumption(kind: str, lines: int) -> None:
    job = {
        "tool": {"kind": kind, "diameter": 8.0},
        "operation": {"kind": "drill", "depth": 3.0},
        "process": {"spindle": 1200.0, "feed": 2.0},
    }
    notes = camgen.build(PARTS / "bracket.dxf", post="gcode", job=job).notes
    assumed = [note for note in notes if "8 mm only drills" in note.what]
    assert [note.kind for note in assumed] == ["assumed"] * lines


def test_an_exceeded_limit_is_an_error_with_strict() -> None:
    with pytest.raises(NoSafeProgram, match="goes 30 mm deep"):
        build({"operation.depth": 30.0, "operation.passes": 9}, strict=True)


def test_without_a_material_the_largest_limit_of_all_materials_holds() -> None:
    """AST: MDF has 0.012 to 0.015 inch per tooth at 1/4 inch, more than all others."""
    limit = 25.4 * (0.007 + 0.008 * (6 / 25.4 - 1 / 8) * 8)
    lines = list_exceeded({"stock.material": None, "process.feed": 150.0})
    assert len(lines) == 1
    assert f"in no material more than {limit:.3f} mm" in lines[0]


@pytest.mark.parametrize(
    ("post", "job", "lines"),
    [
        ("gcode", {}, 1),
        ("gcode", {"tool": {"kind": "pen"}}, 0),
        ("gcode", {"operation": {"kind": "trace"}}, 0),
        ("rapid", {"process": {"spindle": 9000.0}, "post": {"signals": {"spindle": "ao"}}}, 1),
        ("rapid", {}, 0),
        (
            "rapid",
            {
                "process": {"force": 5.0},
                "tool": {"orient": "follow"},
                "post": {"force_calibrated": True},
            },
            0,
        ),
    ],
)
def test_a_rotating_mill_without_a_depth_is_warned_about(
    post: str, job: Mapping[str, object], lines: int
) -> None:
    notes = camgen.build(PARTS / "bracket.dxf", post=post, job=job).notes
    warnings = [note for note in notes if "operation.depth is 0" in note.what]
    assert len(warnings) == lines
    assert all(note.fails_strict for note in warnings)
