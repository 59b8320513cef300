"""``cell.margin`` with an arm that chooses: kept along paths and ways; what cannot keep it is run, and told."""

from collections.abc import Sequence
from pathlib import Path

import ezdxf
import numpy as np
import pytest

import camgen
from bench.robots import robotsp
from camgen.model.path import ToolPath
from camgen.order import ArmTour
from camgen.pipeline import Result

CELL = {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]}
#: Beside the hole at 50 30, 1 mm from the tool there.
CLAMP = [54, 25, -5, 60, 35, 40]
PLACES = [(x, y) for x in (0.0, 25.0, 50.0, 75.0, 100.0) for y in (0.0, 30.0, 60.0)]


def draw(folder: Path, places: Sequence[tuple[float, float]]) -> Path:
    document = ezdxf.new("R2010", units=4)
    for x, y in places:
        document.modelspace().add_circle((x, y), 2.0)
    document.saveas(folder / "holes.dxf")
    return folder / "holes.dxf"


def drilled(
    part: Path, fixtures: list[list[float]], margin: float, **tables: dict[str, object]
) -> Result:
    job: dict[str, dict[str, object]] = {
        "cell": {**CELL, "margin": margin, "fixtures": fixtures},
        "operation": {"kind": "drill"},
        "tool": {"symmetric": True, "diameter": 6.0},
        **tables,
    }
    return camgen.build(part, post="rapid", job=job)


def near(result: Result) -> list[str]:
    return [note.what for note in result.notes if "cell.margin" in note.why]


def at(paths: Sequence[ToolPath], place: tuple[float, float]) -> str:
    return next(path.id for path in paths if np.allclose(path.position[0, :2], place))


def test_a_panel_is_drilled_with_the_margin(tmp_path: Path) -> None:
    """The ways came within 0.01 mm of the holder, with turns that kept 2 mm to choose from."""
    published = robotsp.make_job([])
    cell = published["cell"]
    assert isinstance(cell, dict)
    job = {**published, "cell": {**cell, "margin": 2.0}}
    result = camgen.build(robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=job)
    assert robotsp.count_missed(robotsp.list_joints(result), robotsp.make_holes()) == 0
    assert near(result) == []
    assert result.clear is not None
    assert result.clear.clearance == pytest.approx(2.0, abs=0.005)


def test_what_stands_beside_a_clamp_costs_no_hole_and_no_other_its_margin(tmp_path: Path) -> None:
    result = drilled(draw(tmp_path, PLACES), [CLAMP], 2.0)
    assert isinstance(result.tour, ArmTour)
    assert not [note for note in result.notes if note.kind == "skipped"]
    assert len(result.tour.paths) == len(PLACES)
    beside = at(result.tour.paths, (50.0, 30.0))
    order = [path.id for path in result.tour.paths]
    after = [*order, "home"][order.index(beside) + 1]
    assert near(result)
    assert all("tool against fixture 1" in what for what in near(result))
    assert all(f"path {beside} " in what or f"path {after} " in what for what in near(result))


def test_without_a_margin_nothing_is_kept_apart(tmp_path: Path) -> None:
    result = drilled(draw(tmp_path, PLACES), [CLAMP], 0.0)
    assert near(result) == []
    assert len(result.tour.paths) == len(PLACES)


def test_a_table_under_the_tool_is_meant_to_be_near(tmp_path: Path) -> None:
    """The tool comes within half a millimetre of it in every hole; a post in between is kept away from all the same."""
    table, post = [-20.0, -20, -10, 130, 90, -0.5], [36.0, 10, -5, 40, 20, 30]
    result = drilled(draw(tmp_path, PLACES), [table, post], 2.0)
    assert len(result.tour.paths) == len(PLACES)
    assert near(result)
    assert all("tool against fixture 1" in what for what in near(result))


def test_rules_hold_for_what_is_put_in(tmp_path: Path) -> None:
    """Holes inside first, with one of them beside the clamp; and the order of the drawing where that is asked for."""
    cell = {**CELL, "fixtures": [CLAMP]}
    job = {
        "cell": cell,
        "operation": {"kind": "drill"},
        "tool": {"symmetric": True, "diameter": 6.0},
    }
    drawn = camgen.build(
        draw(tmp_path, PLACES), post="rapid", job={**job, "tour": {"method": "as-drawn"}}
    )
    assert [path.id for path in drawn.tour.paths] == [path.id for path in drawn.planned]
    document = ezdxf.new("R2010", units=4)
    document.modelspace().add_circle((49, 30), 1.0)
    document.modelspace().add_circle((20, 30), 3.0)
    document.modelspace().add_lwpolyline([(-10, -10), (110, -10), (110, 70), (-10, 70)], close=True)
    document.saveas(tmp_path / "plate.dxf")
    traced = camgen.build(
        tmp_path / "plate.dxf", post="rapid", job={**job, "operation": {"kind": "trace"}}
    )
    parents = {path.id: path.parent for path in traced.planned}
    ids = [path.id for path in traced.planned]
    order = [path.id for path in traced.tour.paths]
    # The outline is run 1.9 deg from where the wrist is straight, as with a fixed turn: it was left out for that.
    assert len(order) == 3
    for name, parent in parents.items():
        if parent >= 0:
            assert order.index(name) < order.index(ids[parent])
