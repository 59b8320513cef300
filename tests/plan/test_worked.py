"""Contours that an operation does not work on have no paths and no notes.

The tool keeps clear of the part that they bound.
"""

import numpy as np
import pytest
import shapely

from camgen.model.errors import JobError
from camgen.model.job import Job, OperationTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.plan import Plan, plan
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.swept import centre_line, enclosed, swept

PLATE = (
    rectangle(0, 0, 100, 60, "c1"),
    circle(30, 30, 10, "c2"),
    circle(70, 30, 2, "c3"),
    rounded(20, 10, 4, "c4"),
)


def plan_worked(shapes: tuple[Contour, ...], worked: set[str], **operation: object) -> Plan:
    job = Job(
        tool=ToolTable(diameter=6.0), operation=OperationTable(**{"kind": "follow", **operation})
    )
    return plan(Part("p", "p.dxf", "mm", shapes, (), worked=frozenset(worked)), job)


def test_a_hole_is_a_hole_although_its_outline_is_not_worked_on() -> None:
    planned = plan_worked(PLATE[:2], {"c2"})
    (path,) = planned.paths
    assert (path.id, path.parent, planned.notes) == ("c2", -1, ())
    assert enclosed(PLATE[1:2]).contains(centre_line(path))


def list_noted(planned: Plan) -> set[str]:
    """Contours that the notes of a plan name."""
    return set().union(*(note.ids for note in planned.notes))


def test_notes_name_only_contours_that_are_worked_on() -> None:
    shapes = (*PLATE[:3], contour([(200, 0), (210, 0)], closed=False, name="c5"))
    assert list_noted(plan_worked(shapes, {"c1", "c3"})) == {"c3"}
    assert list_noted(plan_worked(shapes, {"c1", "c2"})) == set()
    assert list_noted(plan(part(*shapes), Job(tool=ToolTable(diameter=6.0)))) == {"c3", "c5"}


def test_the_tool_keeps_clear_of_a_neighbour() -> None:
    # Two parts 5 mm apart: a tool of 6 mm does not fit between them, and only the first is cut out.
    shapes = (rectangle(0, 0, 40, 40, "c1"), rectangle(45, 10, 40, 20, "c2"))
    planned = plan_worked(shapes, {"c1"})
    assert {path.id for path in planned.paths} == {"c1"}
    assert swept(planned.paths, 3.0).intersection(enclosed(shapes)).area < 1e-2
    # No path runs along the other sides of the neighbour.
    assert shapely.union_all([centre_line(path) for path in planned.paths]).bounds[2] < 48.1
    both = plan_worked(shapes, {"c1", "c2"})
    assert max(centre_line(path).bounds[2] for path in both.paths) == pytest.approx(88.0)
    length = sum(centre_line(path).length for path in planned.paths)
    assert length == pytest.approx(4 * 40 - 20 + 6 * np.pi, abs=8.0)


def test_the_paths_are_the_same_if_all_contours_are_selected_or_none() -> None:
    shapes = (rectangle(0, 0, 40, 40, "c1"), rectangle(45, 10, 40, 20, "c2"))
    selected = plan_worked(shapes, {"c1", "c2"})
    unselected = plan(part(*shapes), Job(tool=ToolTable(diameter=6.0)))
    for first, second in zip(selected.paths, unselected.paths, strict=True):
        assert (first.position == second.position).all()


@pytest.mark.parametrize(("gap", "kept"), [(3.1, True), (2.9, False)])
def test_contours_that_cross_themselves_are_kept_clear_of(gap: float, kept: bool) -> None:
    """The tool has a diameter of 6 mm."""
    x = 100 + 3 + gap
    bow = contour([(x, 0), (x + 20, 20), (x + 20, 0), (x, 20)], name="c5")
    planned = plan_worked((PLATE[0], bow), {"c1"})
    assert [path.id for path in planned.paths] == ["c1"] * kept
    named = [note.what for note in planned.notes if "too near to crossing ones: c1" in note.what]
    assert bool(named) is not kept


@pytest.mark.parametrize("side", ["left", "right", "inside", "outside"])
def test_every_side_has_paths_only_along_contours_that_are_worked_on(side: str) -> None:
    assert {path.id for path in plan_worked(PLATE[:2], {"c2"}, side=side).paths} == {"c2"}


def test_trace_and_drill_have_paths_only_for_contours_that_are_worked_on() -> None:
    traced = plan_worked(PLATE, {"c1", "c4"}, kind="trace", shared="each")
    assert [(path.id, path.parent) for path in traced.paths] == [("c1", -1), ("c4", 0)]
    drilled = plan_worked(PLATE, {"c3", "c4"}, kind="drill")
    assert [path.id for path in drilled.paths] == ["c3"]
    assert "1 contour is not a circle and is not drilled" in [note.what for note in drilled.notes]


def test_a_trail_leaves_out_lines_that_are_not_worked_on() -> None:
    cross = (
        contour([(0, 0), (10, 0)], closed=False, name="c1"),
        contour([(5, -5), (5, 5)], closed=False, name="c2"),
        contour([(10, 0), (10, 9)], closed=False, name="c3"),
    )
    planned = plan_worked(cross, {"c1"}, kind="trace")
    (path,) = planned.paths
    assert path.contours == ("c1",)
    assert centre_line(path).length == pytest.approx(10.0)


# Finishing passes.


def test_roughing_passes_leave_the_allowance_for_the_finishing_pass() -> None:
    planned = plan_worked(PLATE[:2], {"c1", "c2"}, finish=0.3, depth=6.0, passes=3)
    by_name = {path.id: path for path in planned.paths}
    assert set(by_name) == {"c1", "c2", "c1.finish", "c2.finish"}
    region = enclosed(PLATE[:2])
    for name, path in by_name.items():
        is_last = name.endswith(".finish")
        distance = 3.0 if is_last else 3.3
        assert region.distance(centre_line(path)) == pytest.approx(distance, abs=0.002)
        assert path.depths == ((6.0,) if is_last else (2.0, 4.0, 6.0))
        assert path.closed
    # The hole is cut with its finishing pass before the outline is started.
    order = {path.id: k for k, path in enumerate(planned.paths)}
    assert by_name["c1"].parent == order["c1.finish"]
    assert by_name["c2"].parent == order["c2.finish"]
    assert by_name["c2.finish"].parent == order["c1"]
    assert by_name["c1.finish"].parent == -1


def test_a_finishing_pass_in_a_narrow_slot_goes_down_in_steps() -> None:
    shapes = (
        rectangle(0, 0, 100, 60, "c1"),
        contour([(20, 20), (60, 20), (60, 26.4), (20, 26.4)], name="c2"),
    )
    planned = plan_worked(shapes, {"c1", "c2"}, finish=0.3, depth=6.0, passes=3)
    counts = {path.id: len(path.depths) for path in planned.paths}
    assert counts == {"c1": 3, "c1.finish": 1, "c2.finish": 3}
    (note,) = [note for note in planned.notes if "pass by pass" in note.what]
    assert note.ids == ("c2",)


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"tool": ToolTable(kind="drill")}, "tool.kind"),
        ({"operation": OperationTable(finish=0.3, inside_first=False)}, "operation.inside_first"),
        ({"operation": OperationTable(width=0.3)}, "operation.width"),
        ({"operation": OperationTable(holes=[1, 2])}, "operation.holes"),
    ],
)
def test_a_setting_without_effect_on_the_operation_is_an_error(
    changed: dict[str, object], key: str
) -> None:
    with pytest.raises(JobError) as error:
        plan(part(*PLATE), Job(**changed))  # type: ignore[arg-type]
    assert key in str(error.value)
