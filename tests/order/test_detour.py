"""Detours home if RFA finds no retraction: searched last and with a limit, proved like any link."""

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
#: A wall straight ahead of the arm, 500 mm high.
#: The arm must be lifted to get from one side to the other.
WALL = [[250.0, -20.0, -290.0, 700.0, 20.0, 500.0]]


def make_scene(fixtures: list[list[float]], margin: float = 2.0) -> tuple[Setup, FreeSpace]:
    job = Job(cell=CellTable(robot="IRB 120", fixtures=fixtures, margin=margin))
    home = Joints(tuple(ARM.home.tolist()))
    cell = equip_cell(Cell("arm", translation(0, 0, 0), translation(0, 0, 100), home), job, ARM)
    cell_scene = make_cell_scene(job, cell, None)
    setup = make_setup(ARM, cell, cell_scene)
    return setup, make_free_space(cell_scene, setup)


def interpolate(detour_joints: FloatArray, parts: int = 400) -> FloatArray:
    """Joint values on straight lines from row to row, `parts` for each line."""
    return np.concatenate(
        [a + np.linspace(0, 1, parts)[:, None] * (b - a) for a, b in pairwise(detour_joints)]
    )


@pytest.mark.parametrize("margin", [0.0, 10.0])
def test_a_detour_around_a_wall_keeps_the_margin(margin: float) -> None:
    setup, space = make_scene(WALL, margin)
    assert isinstance(space.look([SampledMotion(np.stack([LEFT, RIGHT]))])[0], Blockage)
    detour_joints = find_detour(setup, space, LEFT, RIGHT)
    assert detour_joints is not None
    assert np.array_equal(detour_joints[[0, -1]], [LEFT, RIGHT])
    rows = interpolate(detour_joints)
    assert are_within_limits(ARM, rows).all()
    assert setup.clear(rows).all()
    # Between two samples a detour may come a little nearer.
    assert make_scene(WALL, 0.8 * margin)[0].roomy(rows).all()


def test_the_same_search_finds_the_same_short_detour() -> None:
    setup, space = make_scene(WALL)
    first, second = (find_detour(setup, space, LEFT, RIGHT) for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.tolist() == second.tolist()
    back = find_detour(setup, space, RIGHT, LEFT)
    assert back is not None
    for detour_joints in (first, back):
        seconds = (np.abs(np.diff(detour_joints, axis=0)) / ARM.speeds).max(axis=1).sum()
        assert seconds < 3 * (np.abs(LEFT - RIGHT) / ARM.speeds).max()


def test_enclosed_joint_values_have_no_detour_and_the_search_ends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both ends are free for 0.3 rad around them, and all else collides."""
    setup, space = make_scene([])
    tested: list[int] = []

    def is_near_an_end(joints: FloatArray) -> np.ndarray:
        tested.append(len(joints))
        return (np.abs(joints - LEFT).max(axis=1) < 0.3) | (
            np.abs(joints - RIGHT).max(axis=1) < 0.3
        )

    monkeypatch.setattr(detour, "MAX_SAMPLES", 5000)
    assert (
        find_detour(replace(setup, clear=is_near_an_end, roomy=is_near_an_end), space, RIGHT, LEFT)
        is None
    )
    # One search with the margin and one without, and the last samples, which are tested together.
    assert 5000 < sum(tested) < 3 * 5000


def test_an_end_that_collides_has_no_detour() -> None:
    setup, space = make_scene(WALL)
    inside = np.radians([0.0, 60, 0, 0, 30, 0])
    assert not setup.clear(inside[None])[0]
    assert find_detour(setup, space, inside, RIGHT) is None


def build_under_a_roof(tmp_path: Path) -> Result:
    """A plate of 60 x 40 x 10 mm under a roof, 100 mm above it.

    The roof is wider than the plate, so no retraction leads up from the edges.
    """
    plate = trimesh.creation.box((60, 40, 10))
    plate.apply_translation((30, 20, 5))
    plate.export(tmp_path / "plate.stl")
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


def test_edges_under_a_roof_are_left_by_detours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = build_under_a_roof(tmp_path)
    assert len(result.tour.paths) >= 2
    assert result.report["checks"]["collision"] == "partly checked"
    assert any("found by search" in note.what for note in result.notes)
    assert result.reach is not None
    assert result.where is not None
    assert (find_collisions(result.where.scene, result.reach.joints) < 0).all()
    # Between an edge and home the arm passes through other joint values.
    joint_motions = [item for item in result.program.body if isinstance(item, MoveJ)]
    assert len(joint_motions) > 2 * len(result.tour.paths) + 2
    monkeypatch.setattr(ROUTE, "find_detour", lambda *_: None)
    with pytest.raises(NoSafeProgram, match="none of"):
        build_under_a_roof(tmp_path)


def test_no_detour_is_searched_if_rfa_finds_a_retraction(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(ROUTE, "find_detour", never)
    result = camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")
    assert len(result.tour.paths) == 15
    assert not any("found by search" in note.what for note in result.notes)


def test_no_detour_is_searched_after_some_fruitless_searches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches = []
    monkeypatch.setattr(ROUTE, "find_detour", lambda *ends: searches.append(ends))
    detours = ROUTE._Detours(ROUTE.RouteCell(*make_scene(WALL), LEFT))
    assert all(detours.find_home(RIGHT) is None for _ in range(40))
    assert len(searches) == ROUTE._MAX_FRUITLESS
