"""Chamfers with a V tool: the bevel measured on the cone of the tool, sides, and narrow places."""

import math

import numpy as np
import pytest
import shapely

from camgen.model.errors import JobError
from camgen.model.job import Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.plan import Plan, plan
from camgen.plan.chamfer import compute_bevel
from tests.support.drawn import circle, contour, part, rectangle
from tests.support.swept import centre_line, enclosed


def make_job(width: float = 1.0, tool: ToolTable | None = None, **operation: object) -> Job:
    table = OperationTable(kind="chamfer", width=width, **operation)  # type: ignore[arg-type]
    return Job(tool=tool or ToolTable(kind="v", diameter=10.0), operation=table)


def plan_chamfer(
    *contours: Contour, width: float = 1.0, tool: ToolTable | None = None, **operation: object
) -> Plan:
    return plan(part(*contours), make_job(width, tool, **operation))


TOOLS = [
    ToolTable(kind="v", diameter=10.0),
    ToolTable(kind="v", diameter=10.0, tip_diameter=1.0),
    ToolTable(kind="v", diameter=12.0, tip_angle=60.0),
    ToolTable(kind="v", diameter=12.0, tip_angle=120.0, tip_diameter=2.0),
    ToolTable(kind="v", diameter=3.4, tip_angle=82.0),
]


def cone_radius(tool: ToolTable, above_tip: float) -> float:
    return tool.tip_diameter / 2 + above_tip * math.tan(math.radians(tool.tip_angle or 90.0) / 2)


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("width", [0.3, 1.0, 1.5])
def test_the_cone_cuts_the_width_and_its_tip_clears_the_wall(tool: ToolTable, width: float) -> None:
    (path,) = plan_chamfer(rectangle(0, 0, 50, 30), width=width, tool=tool).paths
    (depth,) = path.depths
    # Along the lower side the wall is y = 0, and the tool centre runs below it by the offset.
    offset = -float(path.position[:, 1].min())
    assert cone_radius(tool, depth) - offset == pytest.approx(width)
    assert offset - tool.tip_diameter / 2 >= 0.1 - 1e-9
    assert cone_radius(tool, depth) <= tool.diameter / 2 + 1e-9
    # The bevel ends at the wall, above the tip of the cone.
    below = width / math.tan(math.radians(tool.tip_angle or 90.0) / 2)
    assert cone_radius(tool, depth - below) == pytest.approx(offset)
    assert below < depth


def test_the_offset_is_smaller_for_a_small_tool() -> None:
    assert compute_bevel(make_job(1.0)).offset == pytest.approx(0.5)
    small = ToolTable(kind="v", diameter=2.6)
    assert compute_bevel(make_job(1.0, small)).offset == pytest.approx(0.3)
    with pytest.raises(JobError, match=r"operation\.width.*1\.2 mm at most"):
        compute_bevel(make_job(1.21, small))


def test_a_chamfer_is_outside_of_the_outline_and_inside_of_holes() -> None:
    shapes = (rectangle(0, 0, 60, 40), circle(20, 20, 8, "c2"))
    planned = plan_chamfer(*shapes)
    assert {path.id for path in planned.paths} == {"c1", "c2"}
    region = enclosed(shapes)
    for path in planned.paths:
        line = centre_line(path)
        assert region.distance(line) == pytest.approx(0.5, abs=0.002)
        assert not region.intersects(line)
        # The bevel has its width all along the edge.
        edge = region.boundary.geoms[0] if path.id == "c1" else region.boundary.geoms[1]
        cut = line.buffer(1.5, quad_segs=64).intersection(region)
        assert cut.hausdorff_distance(edge) == pytest.approx(1.0, abs=0.01)
        assert path.operation == "chamfer"
    (inside,) = plan_chamfer(rectangle(0, 0, 60, 40), side="inside").paths
    assert inside.position[:, 0].min() == pytest.approx(0.5)


@pytest.mark.parametrize(("direction", "sign"), [("climb", -1), ("conventional", 1)])
def test_climb_milling_has_the_part_on_the_right(direction: str, sign: int) -> None:
    (path,) = plan_chamfer(rectangle(0, 0, 60, 40), direction=direction).paths
    x, y = path.position[:, :2].T
    assert np.sign((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) == sign


def test_passes_go_down_in_equal_steps() -> None:
    (path,) = plan_chamfer(rectangle(0, 0, 60, 40), passes=3).paths
    assert path.depths == pytest.approx((0.5, 1.0, 1.5))


def test_notes_name_a_hole_that_is_too_small_and_an_open_contour() -> None:
    planned = plan_chamfer(circle(0, 0, 0.4, "c1"), rectangle(-20, -20, 40, 40, "c2"))
    assert [path.id for path in planned.paths] == ["c2"]
    (note,) = [note for note in planned.notes if note.kind == "skipped"]
    assert note.ids == ("c1",)
    assert "a V tool whose middle is 0.5 mm off the wall does not fit" in str(note)
    line = contour([(100, 0), (120, 0)], closed=False, name="c2")
    with_line = plan_chamfer(rectangle(0, 0, 60, 40), line)
    assert [note.ids for note in with_line.notes if note.kind == "skipped"] == [("c2",)]


def test_the_edge_of_a_contour_that_is_not_worked_on_is_not_cut() -> None:
    # At the top face the cone has a radius of 1.5 mm, and its axis is 0.5 mm from c1.
    # So it reaches across a gap of 1.9 mm, but not across 2.1 mm.
    for gap, ids in ((1.9, []), (2.1, ["c1"])):
        shapes = (rectangle(0, 0, 30, 30, "c1"), rectangle(30 + gap, 0, 30, 30, "c2"))
        planned = plan(Part("p", "p.dxf", "mm", shapes, (), worked=frozenset({"c1"})), make_job())
        assert [path.id for path in planned.paths] == ids
        left_out = [note.ids for note in planned.notes if note.kind == "skipped"]
        assert left_out == ([] if ids else [("c1",)])
        for path in planned.paths:
            assert shapely.box(30 + gap, 0, 60 + gap, 30).distance(centre_line(path)) >= 1.5
    both = plan(part(*shapes), make_job())
    assert {path.id for path in both.paths} == {"c1", "c2"}


@pytest.mark.parametrize(
    ("job", "key"),
    [
        (make_job(tool=ToolTable(diameter=10.0)), "tool.kind"),
        (
            Job(tool=ToolTable(kind="v"), operation=OperationTable(kind="chamfer")),
            "operation.width",
        ),
        (make_job(depth=2.0), "operation.depth"),
        (make_job(side="on"), "operation.side"),
        (make_job(finish=0.1), "operation.finish"),
        (make_job(stepover=0.5), "operation.stepover"),
    ],
)
def test_a_setting_without_effect_on_a_chamfer_is_an_error(job: Job, key: str) -> None:
    with pytest.raises(JobError) as error:
        plan(part(rectangle(0, 0, 50, 30)), job)
    assert key in str(error.value)


def test_a_chamfer_with_a_force_is_refused() -> None:
    with_force = Job(
        tool=ToolTable(kind="v", diameter=10.0),
        operation=OperationTable(kind="chamfer", width=1.0),
        process=ProcessTable(force=5.0),
    )
    with pytest.raises(JobError, match=r"process\.force"):
        plan(part(rectangle(0, 0, 50, 30)), with_force)
