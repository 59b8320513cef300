"""Ways home where RFA has none: found by a search, proved like any link, tried last, and bounded."""

import importlib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

import camgen
from camgen.collision.cell import make_cell_scene
from camgen.collision.hits import find_collisions
from camgen.model.cell import Cell
from camgen.model.errors import NoSafeProgram
from camgen.model.job import CellTable, Job
from camgen.model.pose import FloatArray, translation
from camgen.model.program import Joints, MoveJ
from camgen.motion.cell import make_free_space, make_setup
from camgen.motion.setup import Blockage, FreeSpace, SampledMotion, Setup
from camgen.order.edges import detour
from camgen.order.edges.detour import find_detour
from camgen.pipeline import Result
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.joint_limits import are_within_limits
from camgen.robots.workcell import equip_cell

ARM = find_robot("IRB 120")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ROUTE = importlib.import_module("camgen.order.edges.route")
LEFT, RIGHT = np.radians([-60.0, 40, 10, 0, 40, 0]), np.radians([60.0, 40, 10, 0, 40, 0])
#: A wall straight ahead of the arm, 500 mm high: the arm must be lifted to get from one side to the other.
WALL = [[250.0, -20.0, -290.0, 700.0, 20.0, 500.0]]


def scene(fixtures: list[list[float]], margin: float = 2.0) -> tuple[Setup, FreeSpace]:
    job = Job(cell=CellTable(robot="IRB 120", fixtures=fixtures, margin=margin))
    home = Joints(tuple(ARM.home.tolist()))
    cell = equip_cell(Cell("arm", translation(0, 0, 0), translation(0, 0, 100), home), job, ARM)
    where = make_cell_scene(job, cell, None)
    setup = make_setup(ARM, cell, where)
    return setup, make_free_space(where, setup)


def even(way: FloatArray, parts: int = 400) -> FloatArray:
    """Joint values on straight lines from row to row."""
    return np.concatenate(
        [a + np.linspace(0, 1, parts)[:, None] * (b - a) for a, b in pairwise(way)]
    )


@pytest.mark.parametrize("margin", [0.0, 10.0])
def test_a_wall_is_gone_round_with_the_margin(margin: float) -> None:
    setup, room = scene(WALL, margin)
    assert isinstance(room.look([SampledMotion(np.stack([LEFT, RIGHT]))])[0], Blockage)
    way = find_detour(setup, room, LEFT, RIGHT)
    assert way is not None
    assert np.array_equal(way[[0, -1]], [LEFT, RIGHT])
    rows = even(way)
    assert are_within_limits(ARM, rows).all()
    assert setup.clear(rows).all()
    # Between two looks a way may come nearer by a little.
    where = scene(WALL, 0.8 * margin)[0]
    assert where.roomy(rows).all()


def test_the_same_question_has_the_same_answer_and_a_short_one() -> None:
    setup, room = scene(WALL)
    one, two = (find_detour(setup, room, LEFT, RIGHT) for _ in range(2))
    assert one is not None
    assert two is not None
    assert one.tolist() == two.tolist()
    back = find_detour(setup, room, RIGHT, LEFT)
    assert back is not None
    for way in (one, back):
        seconds = (np.abs(np.diff(way, axis=0)) / ARM.speeds).max(axis=1).sum()
        assert seconds < 3 * (np.abs(LEFT - RIGHT) / ARM.speeds).max()


def test_what_is_shut_in_has_no_way_and_the_search_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ends are free for 0.3 rad around them, and nothing else is."""
    setup, room = scene([])
    asked: list[int] = []

    def shut(joints: FloatArray) -> np.ndarray:
        asked.append(len(joints))
        return (np.abs(joints - LEFT).max(axis=1) < 0.3) | (
            np.abs(joints - RIGHT).max(axis=1) < 0.3
        )

    monkeypatch.setattr(detour, "MAX_SAMPLES", 5000)
    assert find_detour(replace(setup, clear=shut, roomy=shut), room, RIGHT, LEFT) is None
    # With the margin and without it, and what is asked together at the end.
    assert 5000 < sum(asked) < 3 * 5000


def test_an_end_that_collides_has_no_way() -> None:
    setup, room = scene(WALL)
    inside = np.radians([0.0, 60, 0, 0, 30, 0])
    assert not setup.clear(inside[None])[0]
    assert find_detour(setup, room, inside, RIGHT) is None


def roofed(tmp_path: Path) -> Result:
    """A plate of 60 x 40 x 10 mm under a roof 100 mm above it, wider than the plate: no way leads up from its edges."""
    made = trimesh.creation.box((60, 40, 10))
    made.apply_translation((30, 20, 5))
    made.export(tmp_path / "plate.stl")
    table = {
        "fixtures": [[-300, -300, -30, 300, 300, -1], [-60, -60, 110, 120, 100, 120]],
        "robot": "IRB 120",
    }
    frames = {
        "base_from_work": [300, -20, 150, 0, 0, 0],
        "flange_from_tool": [-60, 0, 100, 0, -45, 0],
    }
    return camgen.build(
        tmp_path / "plate.stl",
        post="rapid",
        job={
            "input": {"select": "convex, not bottom"},
            "operation": {"offset": 2},
            "tool": {"axis_tilt": 10, "symmetric": True, "holder": [[-20, -20, 0, 20, 20, 60]]},
            "cell": {**table, **frames},
        },
    )


def test_edges_under_a_roof_are_left_by_ways_that_are_searched_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = roofed(tmp_path)
    assert len(result.tour.paths) >= 2
    assert result.report["checks"]["collision"] == "partly checked"
    assert any("found by search" in note.what for note in result.notes)
    assert result.reach is not None
    assert result.where is not None
    assert (find_collisions(result.where.scene, result.reach.joints) < 0).all()
    # From edge to home and back by way of joint values that are neither.
    swings = [one for one in result.program.body if isinstance(one, MoveJ)]
    assert len(swings) > 2 * len(result.tour.paths) + 2
    monkeypatch.setattr(ROUTE, "find_detour", lambda *_: None)
    with pytest.raises(NoSafeProgram, match="none of"):
        roofed(tmp_path)


def test_where_rfa_has_a_way_nothing_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(ROUTE, "find_detour", never)
    result = camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")
    assert len(result.tour.paths) == 15
    assert not any("found by search" in note.what for note in result.notes)


def test_after_some_searches_in_vain_no_more_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(ROUTE, "find_detour", lambda *found: asked.append(found))
    detours = ROUTE._Detours(ROUTE.RouteCell(*scene(WALL), LEFT))
    assert all(detours.find_home(RIGHT) is None for _ in range(40))
    assert len(asked) == ROUTE._MAX_FRUITLESS
