"""A fixture blocks stretches of contours, and whole holes and pockets."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import camgen
from camgen.geometry.arcs import measure_path
from camgen.model.errors import NoSafeProgram
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.pipeline import Result
from camgen.plan.pieces import lengths_along, point_at

MOTOR = Path(__file__).parents[2] / "fixtures" / "parts" / "motor.dxf"
#: A clamp over the left end of the lower side of the plate, and one over its right side.
LEFT, RIGHT = [10.0, -10.0, -5.0, 30.0, 20.0, 30.0], [110.0, 30.0, -5.0, 135.0, 60.0, 12.0]


def build(*fixtures: object, strict: bool = False, **tables: Any) -> Result:
    job: dict[str, Any] = {
        "input": {"layers": ["OUTLINE"]},
        "operation": {"depth": 3.0},
        "process": {"spindle": 9000.0},
        "stock": {"thickness": 3.0, "held": "tape"},
        "cell": {"fixtures": list(fixtures)},
    }
    for name, table in tables.items():
        job[name] = {**job.get(name, {}), **table} if isinstance(table, dict) else table
    return camgen.build(MOTOR, post="gcode", job=job, strict=strict)


def list_fixture_notes(result: Result) -> list[str]:
    return [str(note) for note in result.notes if "fixture" in note.why]


def sample_path(path: ToolPath, step: float = 0.05) -> FloatArray:
    """Points on a path every `step` mm, (N, 2)."""
    length = float(lengths_along(path)[-1])
    return np.array([point_at(path, at)[:2] for at in np.arange(0.0, length, step)])


def measure_distances(points: FloatArray, box: list[float]) -> FloatArray:
    """Distance in the plane from points (N, 2) to a box, mm (N,)."""
    x1, y1, _, x2, y2, _ = box
    dx = np.maximum(np.maximum(x1 - points[:, 0], points[:, 0] - x2), 0)
    dy = np.maximum(np.maximum(y1 - points[:, 1], points[:, 1] - y2), 0)
    return np.asarray(np.hypot(dx, dy))


def test_a_contour_is_cut_up_to_the_clamps() -> None:
    whole = build().tour.paths[0]
    result = build(LEFT, RIGHT)
    assert [path.id for path in result.tour.paths] in (["c1.1", "c1.2"], ["c1.2", "c1.1"])
    for path in result.tour.paths:
        assert not path.closed
        points = sample_path(path)
        for clamp in (LEFT, RIGHT):
            assert measure_distances(points, clamp).min() >= 3 + 2 - 1e-6
        ends = path.position[[0, -1], :2]
        nearest = np.minimum(measure_distances(ends, LEFT), measure_distances(ends, RIGHT))
        assert nearest == pytest.approx([5.0, 5.0], abs=0.06)
    left_out = [measure_path(path) for path in result.blocked]
    kept = [measure_path(path) for path in result.tour.paths]
    assert sum(kept) + sum(left_out) == pytest.approx(measure_path(whole), abs=1e-3)
    assert sum(left_out) == pytest.approx(20 + 10 + 30 + 10, abs=2.0)
    (note,) = list_fixture_notes(result)
    expected = f"skipped: {sum(left_out):.1f} mm of path c1 (fixtures 1, 2: the tool would come "
    assert note == expected + "nearer than 2 mm, cell.margin)"


def test_the_same_stretches_are_left_out_wherever_the_path_starts() -> None:
    lengths = []
    for x, y in ((20.0, 0.0), (60.0, 0.0), (120.0, 45.0)):
        result = build(LEFT, tour={"seams": [[x, y]]})
        lengths.append(sum(measure_path(path) for path in result.blocked))
    assert max(lengths) - min(lengths) < 2e-3


def test_a_clamp_below_the_cut_does_not_block_it() -> None:
    assert list_fixture_notes(build([10, -10, -20, 30, 20, -3.0])) == []
    assert list_fixture_notes(build([10, -10, -20, 30, 20, -2.9])) != []


def test_all_passes_leave_out_the_stretches_of_the_deepest_pass() -> None:
    result = build([10, -10, -20, 30, 20, -2.0], operation={"depth": 3.0, "passes": 3})
    (path,) = result.tour.paths
    assert len(path.depths) == 3
    assert measure_distances(sample_path(path), [10, -10, -20, 30, 20, -2.0]).min() >= 5 - 1e-6


def test_a_holder_leaves_out_more_than_the_tool_and_is_named() -> None:
    holder = {"length": 30.0, "holder": [[-15, -15, 0, 15, 15, 18]]}
    bare, held = build(RIGHT), build(RIGHT, tool=holder)
    assert measure_path(held.blocked[0]) > measure_path(bare.blocked[0]) + 15
    assert "the tool and the holder would come nearer" in list_fixture_notes(held)[0]
    # With its lower end 12 mm above the tip it passes a clamp that is 8 mm high.
    low = [*RIGHT[:5], 8.0]
    assert measure_path(build(low, tool=holder).blocked[0]) == pytest.approx(
        measure_path(bare.blocked[0]), abs=1e-3
    )


def test_a_later_operation_leaves_out_the_stretches_of_an_earlier_wider_tool() -> None:
    tools = [
        {"name": "a", "number": 1, "diameter": 8.0},
        {"name": "b", "number": 2, "diameter": 3.0},
    ]
    rows = [{"kind": "follow", "tool": name, "layers": ["OUTLINE"]} for name in ("a", "b")]
    result = build(LEFT, input={}, tools=tools, operations=rows)
    small = next(path for path in result.tour.paths if path.id.startswith("1:"))
    assert measure_distances(sample_path(small), LEFT).min() == pytest.approx(4 + 2, abs=0.06)
    assert list_fixture_notes(result)[0].startswith("skipped: operation 0 (follow): ")


def test_holes_and_pockets_are_left_out_as_a_whole() -> None:
    clamp = [2.0, 2.0, -5.0, 14.0, 14.0, 20.0]
    drill = {
        "operation": {"kind": "drill", "depth": 3.0},
        "tool": {"kind": "drill", "diameter": 5.5},
    }
    result = build(
        clamp,
        input={"layers": ["HOLES"]},
        operation={"kind": "drill", "holes": [5.4, 5.6]},
        tool=drill["tool"],
    )
    assert len(result.tour.paths) == 3
    assert len(result.blocked) == 1
    pocket = {"kind": "pocket", "depth": 3.0}
    with pytest.raises(NoSafeProgram, match=r"no path is left.*fixture 1"):
        build([60, 40, -5, 70, 50, 20], input={"layers": ["POCKET"]}, operation=pocket)


def test_a_curve_in_space_is_left_out_as_a_whole() -> None:
    job: dict[str, Any] = {"operation": {"kind": "trace"}}
    whole = camgen.build(MOTOR.with_name("space.dxf"), post="gcode", job=job)
    first = whole.tour.paths[0].position
    x, y = first[0, :2].tolist()
    job["cell"] = {"fixtures": [[x - 1, y - 1, -5, x + 1, y + 1, 90]]}
    result = camgen.build(MOTOR.with_name("space.dxf"), post="gcode", job=job)
    assert len(result.tour.paths) < len(whole.tour.paths)
    assert {path.id for path in result.tour.paths} < {path.id for path in whole.tour.paths}
    assert result.fixtures is not None
    assert result.fixtures.aside >= 2


def test_a_job_without_a_path_and_a_strict_job_are_refused() -> None:
    with pytest.raises(NoSafeProgram, match=r"no path is left.*fixture 1"):
        build([-50, -50, -5, 200, 200, 20])
    with pytest.raises(NoSafeProgram, match="--strict and 1 left out"):
        build(LEFT, strict=True)


@pytest.mark.parametrize(
    "operation",
    [
        {"lead_in": 5.0, "lead_out": 5.0},
        {"entry": "ramp", "passes": 2},
        {"finish": 0.4, "passes": 2},
        {"tabs": 3},
        {"kind": "trace"},
    ],
    ids=["leads", "ramp", "finish", "tabs", "trace"],
)
def test_leads_ramps_and_passes_keep_clear_too(operation: dict[str, object]) -> None:
    """All motions of the program below the top of a clamp keep the margin from it."""
    result = build(LEFT, RIGHT, operation=operation)
    ends = result.program.columns.ends
    for clamp in (LEFT, RIGHT):
        low = ends[:, 2] < clamp[5]
        assert measure_distances(ends[low, :2], clamp).min() >= 5 - 1e-3
    assert result.fixtures is not None
    assert result.fixtures.aside >= 2 - 1e-3
    skipped = [note for note in list_fixture_notes(result) if note.startswith("skipped: ")]
    assert len(skipped) == (2 if "finish" in operation else 1)


def test_all_stretches_of_an_outline_are_run_after_the_contours_inside() -> None:
    result = build(LEFT, RIGHT, input={"layers": []})
    ids = [path.id for path in result.tour.paths]
    assert ids[-2:] in (["c1.1", "c1.2"], ["c1.2", "c1.1"])
    assert len(ids) == 7


def test_the_distance_from_a_clamp_is_the_margin_of_the_job() -> None:
    close, wide = (build(LEFT, cell={"margin": margin}) for margin in (0.0, 6.0))
    assert close.fixtures is not None
    assert close.fixtures.aside == pytest.approx(0.02, abs=0.01)
    assert wide.fixtures is not None
    assert wide.fixtures.aside == pytest.approx(6.02, abs=0.02)
    assert "would run into it" in list_fixture_notes(close)[0]


def test_a_program_for_an_arm_leaves_out_no_stretches() -> None:
    """The fixtures of an arm are bodies of its scene."""
    job = {
        "operation": {"depth": 3.0},
        "process": {"spindle": 9000.0},
        "cell": {"fixtures": [LEFT]},
        "post": {"signals": {"spindle": "aoSpindle"}},
    }
    result = camgen.build(MOTOR, post="rapid", job=job)
    assert result.fixtures is None
    assert result.blocked == ()
