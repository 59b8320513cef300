"""Bores: the helix with its pitch and its chords, the circle at the bottom, and the notes."""

import math

import numpy as np
import pytest
import shapely
from msgspec.structs import replace

import camgen
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job, OperationTable, ProcessTable, ToleranceTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.program import MoveJ, MoveL
from camgen.plan import Plan, plan
from tests.support.drawn import circle, part, rectangle
from tests.support.swept import centre_line

SIX = ToolTable(diameter=6.0)


def make_job(**operation: object) -> Job:
    table = OperationTable(**{"kind": "bore", "depth": 8.0, **operation})  # type: ignore[arg-type]
    return Job(tool=SIX, operation=table, process=ProcessTable(feed=10.0, spindle=8000))


def plan_bore(*contours: Contour, **operation: object) -> Plan:
    return plan(part(*contours), make_job(**operation))


def test_a_bore_is_a_helix_a_circle_at_the_bottom_and_a_line_to_the_centre() -> None:
    (path,) = plan_bore(circle(20, 10, 5)).paths
    assert (path.id, path.contours, path.depths, path.operation) == ("c1", ("c1",), (0.0,), "bore")
    assert not path.closed
    assert not path.reversible
    x, y, z = path.position.T
    helix = np.isnan(path.via[:, 0]) & (np.hypot(x - 20, y - 10) > 1)
    assert np.hypot(x - 20, y - 10)[helix] == pytest.approx(2.0)
    assert z[0] == 0.0
    assert (np.diff(z[helix]) < 0).all()
    # At the bottom: two half circles, then a line to the centre.
    assert z[-4:] == pytest.approx(-8.0)
    assert path.position[-1].tolist() == pytest.approx([20, 10, -8])
    assert np.hypot(*(path.via[-3:-1, :2] - [20, 10]).T) == pytest.approx(2.0)
    assert path.via[-3:-1, 2] == pytest.approx(-8.0)


@pytest.mark.parametrize("angle", [1.0, 3.0, 20.0])
def test_the_helix_is_at_most_as_steep_as_the_entry_angle(angle: float) -> None:
    (path,) = plan_bore(circle(0, 0, 5), entry_angle=angle).paths
    x, y, z = path.position.T
    turns = np.unwrap(np.arctan2(y[:-3], x[:-3]))
    slope = -np.diff(z[:-3]) / (2.0 * np.diff(turns))
    # The pitch is constant, the turns are whole, and there are as few of them as possible.
    assert np.ptp(slope) < 1e-9
    assert slope.max() <= math.tan(math.radians(angle)) + 1e-12
    count = (turns[-1] - turns[0]) / (2 * math.pi)
    assert count == pytest.approx(round(count))
    assert round(count) == math.ceil(8.0 / (2 * math.pi * 2.0 * math.tan(math.radians(angle))))


def test_a_turn_of_the_helix_is_at_most_as_deep_as_a_pass() -> None:
    (path,) = plan_bore(circle(0, 0, 5), entry_angle=40.0, passes=4).paths
    turns = np.unwrap(np.arctan2(path.position[:-3, 1], path.position[:-3, 0]))
    assert (turns[-1] - turns[0]) / (2 * math.pi) == pytest.approx(4)


@pytest.mark.parametrize("chord", [0.001, 0.01, 0.1])
def test_chords_deviate_from_the_helix_by_the_tolerance_at_most(chord: float) -> None:
    exact = replace(make_job(), tolerance=ToleranceTable(chord=chord))
    (path,) = plan(part(circle(0, 0, 5.8)), exact).paths
    middles = (path.position[:-4, :2] + path.position[1:-3, :2]) / 2
    deviation = 2.8 - np.hypot(*middles.T)
    assert deviation.max() <= chord
    assert deviation.max() > chord / 2 or len(middles) % 12 == 0


@pytest.mark.parametrize(("direction", "sense"), [("climb", 1), ("any", 1), ("conventional", -1)])
def test_climb_milling_has_the_wall_on_the_right(direction: str, sense: int) -> None:
    (path,) = plan_bore(circle(0, 0, 5), direction=direction, finish=0.2).paths
    x, y = path.position[:-1, :2].T
    # The wall is around the tool, so the tool has it on the right if it runs counter-clockwise.
    short = np.hypot(np.diff(x), np.diff(y)) < 0.5
    assert np.sign(x[:-1] * y[1:] - x[1:] * y[:-1])[short][0] == sense
    arc = ~np.isnan(path.via[1:-1, 0])
    before, via = path.position[:-2, :2][arc], path.via[1:-1, :2][arc]
    assert (np.sign(before[:, 0] * via[:, 1] - before[:, 1] * via[:, 0]) == sense).all()


def test_a_finishing_circle_cuts_the_allowance_of_the_helix() -> None:
    (path,) = plan_bore(circle(0, 0, 5), finish=0.3).paths
    radius = np.hypot(*path.position[:, :2].T)
    assert radius[:-4] == pytest.approx(1.7)
    assert radius[-4:-1] == pytest.approx(2.0)
    assert path.position[-7:, 2] == pytest.approx(-8.0)
    # The feed is that of the edge. The centre of the 6 mm tool runs on a radius of 2 mm, not 5 mm.
    assert path.feed[-3] == pytest.approx(10 * 2 / 5)
    assert path.feed[1] == pytest.approx(10 * 1.7 / 4.7)


@pytest.mark.parametrize("radius", [3.05, 4.0, 5.5, 6.0])
def test_the_cleared_area_is_the_circle(radius: float) -> None:
    (path,) = plan_bore(circle(0, 0, radius), depth=0.1).paths
    covered = centre_line(path).buffer(3.0, quad_segs=64)
    whole = shapely.Point(0, 0).buffer(radius, quad_segs=256)
    assert covered.difference(whole.buffer(0.005)).is_empty
    assert whole.buffer(-0.005).difference(covered).buffer(-0.003).is_empty


def test_notes_name_circles_that_cannot_be_bored() -> None:
    shapes = (
        circle(0, 0, 3, "c1"),
        circle(20, 0, 6.1, "c2"),
        circle(40, 0, 3.1, "c3"),
        circle(60, 0, 5, "c4"),
        rectangle(-20, -20, 100, 40, "c5"),
    )
    planned = plan_bore(*shapes, finish=0.2)
    # A helix on a radius below 3 mm leaves no core. The allowance makes the radius of c2 2.9 mm.
    assert [path.id for path in planned.paths] == ["c2", "c4"]
    notes = [(note.kind, note.ids) for note in planned.notes]
    assert notes == [("assumed", ()), ("skipped", ("c1",)), ("skipped", ("c3",))]
    assert "drill it, or set tool.center_cutting" in str(planned.notes[1])
    (wide,) = [n for n in plan_bore(*shapes).notes if "too wide" in n.what]
    assert wide.ids == ("c2",)
    assert "use a pocket" in wide.why


def test_only_selected_circles_of_the_given_diameters_are_bored() -> None:
    shapes = (
        circle(0, 0, 4, "c1"),
        circle(20, 0, 5, "c2"),
        circle(40, 0, 5, "c3"),
        circle(40, 0, 5.5, "c4"),
    )
    planned = plan_bore(*shapes, holes=[9, 12])
    assert [path.id for path in planned.paths] == ["c2", "c3"]
    assert [str(note) for note in planned.notes] == [
        "assumed: 1 circle of another diameter not bored (operation.holes is 9 to 12 mm)",
        "assumed: 1 circle around a smaller one not bored "
        "(the smallest of a centre is; see operation.holes)",
    ]
    (path,) = plan(Part("p", "p.dxf", "mm", shapes, (), worked=frozenset({"c4"})), make_job()).paths
    assert path.id == "c4"
    with pytest.raises(InputError, match="no circle to bore among 4 found"):
        plan_bore(*shapes, holes=[20, 30])


@pytest.mark.parametrize(
    ("tool", "process", "key"),
    [
        (ToolTable(kind="drill"), ProcessTable(), "tool.kind"),
        (ToolTable(kind="v"), ProcessTable(), "tool.kind"),
        (SIX, ProcessTable(force=3), "process.force"),
    ],
)
def test_a_setting_without_effect_on_a_bore_is_an_error(
    tool: ToolTable, process: ProcessTable, key: str
) -> None:
    wrong = Job(tool=tool, process=process, operation=OperationTable(kind="bore"))
    with pytest.raises(JobError) as error:
        plan(part(circle(0, 0, 5)), wrong)
    assert key in str(error.value)


def test_the_program_goes_down_at_the_wall_and_up_in_the_centre() -> None:
    program = camgen.build(part(circle(20, 10, 5)), job=make_job(), post="gcode").program
    moves = [item for item in program.body if isinstance(item, (MoveJ, MoveL))]
    deep = [
        k for k, item in enumerate(moves) if getattr(item.target, "origin", (0, 0, 0))[2] == -8.0
    ]
    up = moves[deep[-1] + 1]
    assert moves[deep[-1]].target.origin == pytest.approx((20, 10, -8))
    assert up.target.origin[:2] == pytest.approx((20, 10))
    assert up.target.origin[2] == pytest.approx(20)
    first = next(item for item in moves if item.target.origin[2] == 0.0)
    assert first.target.origin == pytest.approx((22, 10, 0))
