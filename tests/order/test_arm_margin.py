"""`cell.margin` with an arm tour: paths and links keep it, and a note names those that cannot."""

from collections.abc import Sequence
from itertools import product
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
#: A clamp next to the hole at 50 30, 1 mm from the tool in the hole.
CLAMP = [54, 25, -5, 60, 35, 40]
PLACES = list(product((0.0, 25.0, 50.0, 75.0, 100.0), (0.0, 30.0, 60.0)))


def draw_holes(folder: Path, places: Sequence[tuple[float, float]]) -> Path:
    document = ezdxf.new("R2010", units=4)
    for x, y in places:
        document.modelspace().add_circle((x, y), 2.0)
    document.saveas(folder / "holes.dxf")
    return folder / "holes.dxf"


def build_drilled(
    part: Path, fixtures: list[list[float]], margin: float, **tables: dict[str, object]
) -> Result:
    job: dict[str, dict[str, object]] = {
        "cell": {**CELL, "margin": margin, "fixtures": fixtures},
        "operation": {"kind": "drill"},
        "tool": {"symmetric": True, "diameter": 6.0},
        **tables,
    }
    return camgen.build(part, post="rapid", job=job)


def list_near(result: Result) -> list[str]:
    return [note.what for note in result.notes if "cell.margin" in note.why]


def find_path(paths: Sequence[ToolPath], point: tuple[float, float]) -> str:
    return next(path.id for path in paths if np.allclose(path.position[0, :2], point))


def test_a_panel_is_drilled_with_the_margin(tmp_path: Path) -> None:
    """With other rolls to choose from, links once came within 0.01 mm of the holder."""
    published = robotsp.make_job([])
    cell = published["cell"]
    assert isinstance(cell, dict)
    job = {**published, "cell": {**cell, "margin": 2.0}}
    result = camgen.build(robotsp.draw(robotsp.make_holes(), tmp_path), post="rapid", job=job)
    assert robotsp.count_missed(robotsp.list_joints(result), robotsp.make_holes()) == 0
    assert list_near(result) == []
    assert result.clear is not None
    assert result.clear.clearance == pytest.approx(2.0, abs=0.005)


def test_a_hole_next_to_a_clamp_is_drilled_and_the_others_keep_their_margin(tmp_path: Path) -> None:
    result = build_drilled(draw_holes(tmp_path, PLACES), [CLAMP], 2.0)
    assert isinstance(result.tour, ArmTour)
    assert not [note for note in result.notes if note.kind == "skipped"]
    assert len(result.tour.paths) == len(PLACES)
    clamped = find_path(result.tour.paths, (50.0, 30.0))
    order = [path.id for path in result.tour.paths]
    after = [*order, "home"][order.index(clamped) + 1]
    assert list_near(result)
    assert all("tool against fixture 1" in what for what in list_near(result))
    assert all(f"path {clamped} " in what or f"path {after} " in what for what in list_near(result))


def test_without_a_margin_no_note_names_a_clearance(tmp_path: Path) -> None:
    result = build_drilled(draw_holes(tmp_path, PLACES), [CLAMP], 0.0)
    assert list_near(result) == []
    assert len(result.tour.paths) == len(PLACES)


def test_a_table_under_the_tool_may_be_near_and_a_post_may_not(tmp_path: Path) -> None:
    """In every hole the tool is within 0.5 mm of the table. It keeps the margin from the post."""
    table, post = [-20.0, -20, -10, 130, 90, -0.5], [36.0, 10, -5, 40, 20, 30]
    result = build_drilled(draw_holes(tmp_path, PLACES), [table, post], 2.0)
    assert len(result.tour.paths) == len(PLACES)
    assert list_near(result)
    assert all("tool against fixture 1" in what for what in list_near(result))


def test_paths_near_a_clamp_keep_the_order_of_the_job(tmp_path: Path) -> None:
    """The order as drawn is kept. Holes come before their outline, one of them near the clamp."""
    job = {
        "cell": {**CELL, "fixtures": [CLAMP]},
        "operation": {"kind": "drill"},
        "tool": {"symmetric": True, "diameter": 6.0},
    }
    as_drawn = {**job, "tour": {"method": "as-drawn"}}
    drawn = camgen.build(draw_holes(tmp_path, PLACES), post="rapid", job=as_drawn)
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
    # The outline once was left out, because the wrist is 1.9 deg from its singularity there.
    # A fixed roll has the same distance.
    assert len(order) == 3
    for name, parent in parents.items():
        if parent >= 0:
            assert order.index(name) < order.index(ids[parent])
