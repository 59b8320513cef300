"""Contours that an operation does not work on: no paths or notes of them, but the tool keeps clear of their part."""

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


def planned(shapes: tuple[Contour, ...], worked: set[str], **operation: object) -> Plan:
    job = Job(
        tool=ToolTable(diameter=6.0), operation=OperationTable(**{"kind": "follow", **operation})
    )  # type: ignore[arg-type]
    return plan(Part("p", "p.dxf", "mm", shapes, (), worked=frozenset(worked)), job)


def test_a_hole_is_a_hole_though_its_outline_is_not_worked_on() -> None:
    made = planned(PLATE[:2], {"c2"})
    (path,) = made.paths
    assert (path.id, path.parent, made.notes) == ("c2", -1, ())
    assert enclosed(PLATE[1:2]).contains(centre_line(path))


def test_notes_are_of_what_is_worked_on() -> None:
    shapes = (*PLATE[:3], contour([(200, 0), (210, 0)], closed=False, name="c5"))
    assert {name for note in planned(shapes, {"c1", "c3"}).notes for name in note.ids} == {"c3"}
    assert {name for note in planned(shapes, {"c1", "c2"}).notes for name in note.ids} == set()
    everything = {
        name
        for note in plan(part(*shapes), Job(tool=ToolTable(diameter=6.0))).notes
        for name in note.ids
    }
    assert everything == {"c3", "c5"}


def test_the_tool_keeps_clear_of_a_neighbour() -> None:
    # Two parts 5 mm apart: a tool of 6 mm does not fit between them, and only the first is cut out.
    shapes = (rectangle(0, 0, 40, 40, "c1"), rectangle(45, 10, 40, 20, "c2"))
    made = planned(shapes, {"c1"})
    assert {path.id for path in made.paths} == {"c1"}
    assert swept(made.paths, 3.0).intersection(enclosed(shapes)).area < 1e-2
    # Nothing runs along the sides of the neighbour that are off the gap.
    assert shapely.union_all([centre_line(path) for path in made.paths]).bounds[2] < 48.1
    both = planned(shapes, {"c1", "c2"})
    assert max(centre_line(path).bounds[2] for path in both.paths) == pytest.approx(88.0)
    length = sum(centre_line(path).length for path in made.paths)
    assert length == pytest.approx(4 * 40 - 20 + 6 * np.pi, abs=8.0)


def test_all_worked_on_is_as_no_choice() -> None:
    shapes = (rectangle(0, 0, 40, 40, "c1"), rectangle(45, 10, 40, 20, "c2"))
    chosen, every = (
        planned(shapes, {"c1", "c2"}),
        plan(part(*shapes), Job(tool=ToolTable(diameter=6.0))),
    )
    for one, two in zip(chosen.paths, every.paths, strict=True):
        assert (one.position == two.position).all()


def test_what_has_no_clear_inside_is_not_kept_clear_of_and_that_is_said() -> None:
    bow = contour([(120, 0), (140, 20), (140, 0), (120, 20)], name="c5")
    (note,) = planned((PLATE[0], bow), {"c1"}).notes
    assert (
        str(note) == "warning: 1 contour not kept clear of: c5 (no clear inside, and not worked on)"
    )


@pytest.mark.parametrize("side", ["left", "right", "inside", "outside"])
def test_other_sides_follow_what_is_worked_on(side: str) -> None:
    assert {path.id for path in planned(PLATE[:2], {"c2"}, side=side).paths} == {"c2"}


def test_lines_and_holes_that_are_worked_on() -> None:
    traced = planned(PLATE, {"c1", "c4"}, kind="trace", shared="each")
    assert [(path.id, path.parent) for path in traced.paths] == [("c1", -1), ("c4", 0)]
    drilled = planned(PLATE, {"c3", "c4"}, kind="drill")
    assert [path.id for path in drilled.paths] == ["c3"]
    assert "1 contour is not a circle and is not drilled" in [note.what for note in drilled.notes]


def test_lines_that_are_not_worked_on_join_no_trail() -> None:
    cross = (
        contour([(0, 0), (10, 0)], closed=False, name="c1"),
        contour([(5, -5), (5, 5)], closed=False, name="c2"),
        contour([(10, 0), (10, 9)], closed=False, name="c3"),
    )
    made = planned(cross, {"c1"}, kind="trace")
    (path,) = made.paths
    assert path.contours == ("c1",)
    assert centre_line(path).length == pytest.approx(10.0)


# Last passes.


def test_the_rough_passes_leave_what_the_last_takes() -> None:
    made = planned(PLATE[:2], {"c1", "c2"}, finish=0.3, depth=6.0, passes=3)
    by_name = {path.id: path for path in made.paths}
    assert set(by_name) == {"c1", "c2", "c1.finish", "c2.finish"}
    region = enclosed(PLATE[:2])
    for name, distance, depths in (("c1", 3.3, (2.0, 4.0, 6.0)), ("c1.finish", 3.0, (6.0,)),
                                   ("c2", 3.3, (2.0, 4.0, 6.0)), ("c2.finish", 3.0, (6.0,))):  # fmt: skip
        path = by_name[name]
        assert region.distance(centre_line(path)) == pytest.approx(distance, abs=0.002)
        assert path.depths == depths
        assert path.closed
    # The hole is done, its last pass too, before the outline is begun.
    order = {path.id: k for k, path in enumerate(made.paths)}
    assert by_name["c1"].parent == order["c1.finish"]
    assert by_name["c2"].parent == order["c2.finish"]
    assert by_name["c2.finish"].parent == order["c1"]
    assert by_name["c1.finish"].parent == -1


def test_a_last_pass_in_a_slot_goes_down_pass_by_pass() -> None:
    shapes = (
        rectangle(0, 0, 100, 60, "c1"),
        contour([(20, 20), (60, 20), (60, 26.4), (20, 26.4)], name="c2"),
    )
    made = planned(shapes, {"c1", "c2"}, finish=0.3, depth=6.0, passes=3)
    assert {path.id: len(path.depths) for path in made.paths} == {
        "c1": 3,
        "c1.finish": 1,
        "c2.finish": 3,
    }
    (note,) = [note for note in made.notes if "pass by pass" in note.what]
    assert note.ids == ("c2",)


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"tool": ToolTable(kind="drill")}, "tool.kind"),
        ({"operation": OperationTable(finish=0.3, inside_first=False)}, "operation.inside_first"),
        ({"operation": OperationTable(width=0.3)}, "operation.width"),
        ({"operation": OperationTable(holes=[1, 2])}, "operation.holes"),
    ],
)
def test_settings_that_make_no_sense(changed: dict[str, object], place: str) -> None:
    with pytest.raises(JobError) as found:
        plan(part(*PLATE), Job(**changed))  # type: ignore[arg-type]
    assert place in str(found.value)
