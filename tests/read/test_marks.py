"""POINTs of a drawing are places to drill. Other operations skip them."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

import camgen
from camgen.cli import main
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Choice, InputTable, Job, OperationTable, ProcessTable, Step, ToolTable
from camgen.model.part import Part
from camgen.read import dxf
from camgen.read.extent import measure_box
from camgen.read.files import Files
from camgen.read.made import make_part
from camgen.read.move import move_part
from tests.read.test_dxf import new, notes, written

DRILL = Job(tool=ToolTable(diameter=4.0), operation=OperationTable(kind="drill"))


def read(document: Any, job: Job = DRILL) -> Part:
    return dxf.read(Source(Path("test.dxf"), written(document).encode()), job, Files())


def places(part: Part, job: Job = DRILL) -> list[tuple[float, float]]:
    """Places that the plan of a part drills, mm."""
    paths = camgen.plan(part, job).paths
    return sorted((round(path.position[0, 0], 9), round(path.position[0, 1], 9)) for path in paths)


def plate(*points: tuple[float, float]) -> Any:
    document, space = new()
    space.add_lwpolyline([(0, 0), (40, 0), (40, 20), (0, 20)], close=True)
    for point in points:
        space.add_point(point)
    return document


def test_points_are_holes_with_the_diameter_of_the_tool() -> None:
    part = read(plate((10, 10), (20, 10), (30, 10)))
    assert [contour.is_mark for contour in part.contours] == [False, True, True, True]
    assert places(part) == [(10, 10), (20, 10), (30, 10)]
    assert notes(part) == [
        "assumed: 3 POINT on layer 0 taken as holes of 4 mm (a point has no diameter: that of the "
        "tool which drills it)"
    ]


def test_a_mark_stays_a_mark_in_a_part_that_is_made_in_code() -> None:
    part = read(plate((10, 10)))
    assert [contour.is_mark for contour in make_part(part.contours).contours] == [False, True]


@pytest.mark.parametrize("kind", ["auto", "follow", "trace", "pocket"])
def test_other_operations_skip_points_with_a_note(kind: Any) -> None:
    part = read(plate((10, 10)), Job(operation=OperationTable(kind=kind)))
    assert len(part.contours) == 1
    assert notes(part) == [
        'skipped: 1 POINT on layer 0 (a place to drill, by operation.kind = "drill" without '
        "operation.holes)"
    ]


def test_points_in_blocks_are_rotated_scaled_and_repeated() -> None:
    """The point (1, 0) of a block at (5, 5), rotated by 90 deg and scaled by 3, is at (5, 8)."""
    document, space = new()
    block = document.blocks.new("P", base_point=(0, 0))
    block.add_point((1, 0))
    array = {"rotation": 90, "xscale": 3, "yscale": 3, "column_count": 2, "column_spacing": 10}
    space.add_blockref("P", (5, 5), dxfattribs=array)
    assert places(read(document)) == [pytest.approx((5, 8)), pytest.approx((5, 18))]


def test_a_point_at_the_centre_of_a_circle_is_its_mark() -> None:
    document = plate((10, 10), (30, 10), (30, 10.01))
    space = document.modelspace()
    space.add_circle((10, 10), 4)
    for k in range(4):
        space.add_arc((20, 10), 2, 90 * k, 90 * k + 90)
    space.add_point((20, 10))
    part = read(document)
    assert places(part) == [(10, 10), (20, 10), (30, 10)]
    dropped = "repaired: dropped: 3 POINTs (at the centre of a circle, or drawn twice)"
    assert dropped in notes(part)
    assert [contour.is_mark for contour in part.contours].count(True) == 1


def test_a_drawing_of_points_alone_can_be_drilled() -> None:
    document, space = new()
    space.add_point((3, 4))
    assert places(read(document)) == [(3, 4)]
    with pytest.raises(InputError, match=r"nothing to machine .* a place to drill"):
        read(document, Job())


def step(kind: Any, diameter: float, *layers: str) -> Step:
    return Step(
        tool=ToolTable(diameter=diameter),
        operation=OperationTable(kind=kind),
        process=ProcessTable(),
        choice=Choice(layers=list(layers)),
    )


def test_each_point_has_the_tool_of_its_operation() -> None:
    document = plate((10, 10))
    for x, layer in ((20, "M5"), (30, "NOTES")):
        document.modelspace().add_point((x, 10), dxfattribs={"layer": layer})
    steps = [step("drill", 5, "M5"), step("drill", 3, "0"), step("follow", 6, "*")]
    job = Job(operations=steps)
    part = read(document, job)
    marks = [contour for contour in part.contours if contour.is_mark]
    widths = [(c.layer, float(c.points[0, 0] - c.points[1, 0])) for c in marks]
    assert widths == [("0", 3.0), ("M5", 5.0)]
    planned = camgen.plan(part, job)
    worked = [(path.operation, path.layer) for path in planned.paths]
    assert sorted(worked) == [("drill", "0"), ("drill", "M5"), ("follow", "0")]
    assert "skipped: 1 POINT on layer NOTES" in notes(part)[0]


def test_an_operation_that_chooses_diameters_drills_no_points() -> None:
    """Such a drawing has circles for its holes. Points are often marks of a construction."""
    document = plate((20, 10))
    document.modelspace().add_circle((10, 10), 2)
    holes = OperationTable(kind="drill", holes=[3.9, 4.1])
    assert places(read(document, Job(operation=holes)), Job(operation=holes)) == [(10, 10)]
    both = [step("drill", 4, "*"), step("drill", 4, "*"), step("follow", 6, "*")]
    both[0] = replace(both[0], operation=replace(both[0].operation, holes=[3.9, 4.1]))
    job = Job(operations=both)
    paths = camgen.plan(read(document, job), job).paths
    assert [path.operation for path in paths].count("drill") == 3


def test_points_do_not_count_for_the_size_and_the_origin() -> None:
    document = plate((0, 0))
    job = Job(tool=DRILL.tool, operation=DRILL.operation, input=InputTable(origin="lower-left"))
    part = move_part(read(document, job), job)
    assert part.moved == (0, 0)
    assert [side.tolist() for side in measure_box(part.contours)] == [[0, 0], [40, 20]]


def test_a_program_that_drills_points_is_proven(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "points.dxf"
    plate((10, 10), (30, 10)).saveas(path)
    program = tmp_path / "points.ngc"
    command = ["build", str(path), "--post", "gcode", "-o", str(program)]
    for setting in ("operation.kind=drill", "operation.depth=3", "process.spindle=9000"):
        command += ["--set", setting]
    command += ["--set", "tool.diameter=4", "--set", "process.feed=10"]
    assert main(command) == 0
    assert "no gouge, no rapid motion in material" in capsys.readouterr().err
    text = program.read_text()
    assert "X10 Y10 Z-3" in text
    assert "X30 Y10" in text
