"""The scene of a job: positions of its boxes, length of the tool, assumptions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camgen_posts.rapid import Rapid
from msgspec.structs import replace

from camgen.collision.cell import CellScene, make_cell_scene
from camgen.collision.hits import find_collisions
from camgen.collision.scene import Scene, name_pair
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Solid
from camgen.model.pose import FloatArray, pose_from_values
from camgen.model.program import Joints
from camgen.read.files import Files
from camgen.read.job_file import from_mapping
from camgen.read.solid import mesh, read_fixtures
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.workcell import equip_cell
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = find_robot("IRB 1200")


@pytest.fixture(scope="module")
def solid() -> Solid:
    return mesh.read(source(PARTS / "rfa1.stl"))


def make_scene_of_job(
    tool: dict[str, object], cell: dict[str, object], solid: Solid | None
) -> CellScene:
    """The scene of an IRB 1200 with these tables of a job."""
    job = from_mapping({"tool": tool, "cell": {"robot": "IRB 1200", **cell}})
    workcell = equip_cell(Rapid.cell(), job, ARM, read_fixtures(job, Files()))
    return make_cell_scene(job, workcell, solid)


def list_boxes(scene: Scene, name: str) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Centre, axes and half lengths of the boxes of a body, in the frame of its link."""
    sides = [
        (box, scene.pairs[pair][0]) for box, pair in zip(scene.first, scene.of_pair, strict=True)
    ]
    sides += [
        (box, scene.pairs[pair][1]) for box, pair in zip(scene.second, scene.of_pair, strict=True)
    ]
    rows = {int(box) for box, owner in sides if owner == name}
    return [(scene.origin[k], scene.rotation[k], scene.half[k]) for k in sorted(rows)]


def test_the_box_of_a_tool_is_from_its_tip_to_the_flange() -> None:
    cell_scene = make_scene_of_job(
        {"length": 120, "diameter": 8}, {"fixtures": [[500, 0, 0, 510, 10, 10]]}, None
    )
    (centre, axes, half) = list_boxes(cell_scene.scene, "tool")[0]
    flange = ARM.flange
    in_flange = np.linalg.inv(flange.rotation) @ (centre - np.asarray(flange.origin))
    assert np.allclose(in_flange, (0, 0, 60))
    assert np.allclose(np.abs(np.linalg.inv(flange.rotation) @ axes @ half), (4, 4, 60))


def test_the_box_of_a_tool_with_a_holder_ends_at_the_holder() -> None:
    """The tip is 200 mm from the flange and the holder is 90 mm long: the shaft has 110 mm."""
    tool = {"length": 200, "holder": [[-30, -20, 0, 30, 20, 90]]}
    cell_scene = make_scene_of_job(tool, {"fixtures": [[500, 0, 0, 510, 10, 10]]}, None)
    assert list_boxes(cell_scene.scene, "tool")[0][2][2] == pytest.approx(55)
    assert sorted(list_boxes(cell_scene.scene, "holder")[0][2].tolist()) == pytest.approx(
        [20, 30, 45]
    )


def test_an_oblique_shaft_ends_where_its_axis_meets_the_holder() -> None:
    """The tip is at x = -100 and z = 200 mm, the top of the holder at z = 100 mm.

    At 45 deg the shaft meets it after 100 sqrt 2 mm.
    """
    tool = {"holder": [[-40, -40, 0, 40, 40, 100]]}
    cell = {"flange_from_tool": [-100, 0, 200, 0, -45, 0], "fixtures": [[500, 0, 0, 510, 10, 10]]}
    cell_scene = make_scene_of_job(tool, cell, None)
    assert 2 * list_boxes(cell_scene.scene, "tool")[0][2][2] == pytest.approx(100 * math.sqrt(2))


def test_fixtures_are_placed_in_the_work_frame() -> None:
    frame = [400.0, 50.0, 30.0, 0.0, 0.0, 30.0]
    cell_scene = make_scene_of_job(
        {}, {"base_from_work": frame, "fixtures": [[10, 20, 0, 30, 60, 8]]}, None
    )
    centre, axes, half = list_boxes(cell_scene.scene, "fixture 1")[0]
    assert np.allclose(centre, pose_from_values(frame).apply((20, 40, 4)))
    assert np.allclose(axes, pose_from_values(frame).rotation)
    assert np.allclose(half, (10, 20, 4))


def test_a_table_is_assumed_below_a_solid_part_without_fixtures(solid: Solid) -> None:
    default = make_scene_of_job({}, {}, solid)
    assert any(note.what == "the part stands on a table" for note in default.notes)
    assert any("table" in pair for pair in default.scene.pairs)
    for fixtures in ([], [[0, 0, -50, 1, 1, -40]]):
        with_fixtures = make_scene_of_job({}, {"fixtures": fixtures}, solid)
        assert not any("table" in pair for pair in with_fixtures.scene.pairs)
    flat = make_scene_of_job({}, {}, None)
    assert not any("table" in pair for pair in flat.scene.pairs)


@pytest.mark.parametrize("normal", [(0, 0, -1), (0, 0, 2), (-1, 0, 0), (0.6, 0, 0.8)])
def test_the_table_is_below_the_face_on_which_the_part_rests(
    solid: Solid, normal: tuple[float, float, float]
) -> None:
    """Along the normal the table begins 0.5 mm beyond the part; it is 20 mm thick."""
    frame = [400.0, 50.0, 30.0, 0.0, 0.0, 30.0]
    cell_scene = make_scene_of_job({}, {"base_from_work": frame, "rests_on": list(normal)}, solid)
    centre, axes, half = list_boxes(cell_scene.scene, "table")[0]
    down = pose_from_values(frame).rotation @ np.array(normal) / np.linalg.norm(normal)
    placed = np.array([pose_from_values(frame).apply(vertex) for vertex in solid.vertices.tolist()])
    lowest = float((placed @ down).max())
    middle, half_thickness = float(down @ centre), float(np.abs(down @ axes) @ half)
    assert (middle - half_thickness, middle + half_thickness) == pytest.approx(
        (lowest + 0.5, lowest + 20.5)
    )
    # The table extends 200 mm beyond the part on all sides.
    is_horizontal = np.abs(down @ axes) < 0.5
    assert np.allclose((half - np.abs((placed - centre) @ axes).max(axis=0))[is_horizontal], 200)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ({"rests_on": [0, 0]}, "is not a direction"),
        ({"rests_on": [0, 0, 0]}, "is not a direction"),
        ({"rests_on": [0, 0, 1], "fixtures": []}, "has no effect with cell.fixtures"),
    ],
)
def test_a_direction_of_rest_that_is_invalid_or_unused_is_refused(
    solid: Solid, cell: dict[str, Any], message: str
) -> None:
    with pytest.raises(JobError, match=message):
        make_scene_of_job({}, cell, solid)
    with pytest.raises(JobError, match=r"has no effect without a 3-D part \(cell.rests_on\)"):
        make_scene_of_job({}, {"rests_on": [0, 0, 1]}, None)


def test_high_fixtures_raise_the_safety_height(solid: Solid) -> None:
    low = make_scene_of_job({}, {"fixtures": []}, solid)
    high = make_scene_of_job({}, {"fixtures": [[-50, 0, 0, -40, 10, 300]]}, solid)
    as_mesh = make_scene_of_job({}, {"fixtures": [str(PARTS / "rfa2.stl")]}, solid)
    assert high.level - low.level == pytest.approx(300 - 70)
    assert as_mesh.level - low.level == pytest.approx(100 - 70)


def test_a_tool_may_touch_the_part_by_its_contact_only(solid: Solid) -> None:
    """The tip may be 0.05 mm below the top of the part, but not 1.05 mm."""
    cell_scene = make_scene_of_job(
        {"length": 100}, {"base_from_work": [450, -45, 200, 0, 0, 0]}, solid
    )
    down = np.diag([1.0, -1.0, -1.0])
    flanges = [np.array([450 + 60, -45 + 60, 200 + 70 + 100 - depth]) for depth in (0.05, 1.05)]
    pairs = []
    for flange in flanges:
        solutions = compute_solutions(ARM, down[None], flange[None])[0]
        solutions = solutions[np.isfinite(solutions).all(axis=1)]
        hits = find_collisions(cell_scene.scene, solutions).tolist()
        pairs.append({name_pair(cell_scene.scene, k) if k >= 0 else "" for k in hits})
    assert "" in pairs[0]
    assert "" not in pairs[1]
    assert "tool against part" in pairs[1]


def test_boxes_that_overlap_at_home_are_noted_as_untested() -> None:
    """The box around the fork of link 4 of an IRB 2400 overlaps the tool of a straight wrist."""
    arm = find_robot("IRB 2400")
    cell = Cell(
        "cell",
        pose_from_values([1000.0, 0, 0, 0, 0, 0]),
        pose_from_values([0.0, 0, 100, 0, 0, 0]),
        Joints(()),
    )
    cell_scene = make_cell_scene(Job(), equip_cell(cell, Job(), arm), None)
    untested = [("link 4", "link 6"), ("link 4", "tool")]
    assert [pair.bodies for pair in cell_scene.untested] == untested
    assert [str(note) for note in cell_scene.notes] == [
        f"assumed: {a} against {b} is not tested (their boxes overlap at home)" for a, b in untested
    ]
    assert find_collisions(cell_scene.scene, arm.home[None])[0] < 0
    plain = make_cell_scene(Job(), equip_cell(cell, Job(), ARM), None)
    assert [pair.bodies for pair in plain.untested] == untested[:1]


@pytest.mark.parametrize(
    ("tool", "cell", "message"),
    [
        ({"holder": [[0, 0, 0, 1, 1]]}, {}, "a box has 5 values"),
        ({}, {"fixtures": [[0, 0, 0, 1, 1, 0]]}, "a box has no size"),
        (
            {"holder": [[50, 50, 0, 80, 80, 50]]},
            {"flange_from_tool": [0, 0, 100, 180, 0, 0]},
            "meets neither",
        ),
    ],
)
def test_an_invalid_box_is_refused(
    tool: dict[str, object], cell: dict[str, object], message: str
) -> None:
    with pytest.raises(JobError, match=message):
        make_scene_of_job(tool, cell, None)


def test_an_invalid_mesh_of_a_fixture_is_refused_with_its_name(tmp_path: Path) -> None:
    (tmp_path / "clamp.stl").write_text("solid\n")
    with pytest.raises(InputError, match=r"clamp\.stl"):
        make_scene_of_job({}, {"fixtures": [str(tmp_path / "clamp.stl")]}, None)


def test_the_job_is_not_changed(solid: Solid) -> None:
    job = from_mapping({"cell": {"robot": "IRB 1200", "fixtures": [[0, 0, -50, 1, 1, -40]]}})
    before = replace(job)
    make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM, read_fixtures(job, Files())), solid)
    assert job == before


@pytest.mark.parametrize(
    ("tool", "cell", "line"),
    [
        (
            {"length": 0.2},
            {},
            "job: the tool is 0.2 mm long, from its tip to the flange or holder (tool.length); "
            "make it longer than 0.2 mm",
        ),
        (
            {},
            {"flange_from_tool": [0, 0, 0.1, 0, 0, 0]},
            "job: the tool is 0.1 mm long, from its tip to the flange or holder "
            "(cell.flange_from_tool); make it longer than 0.2 mm",
        ),
        (
            {"length": 90.1, "holder": [[-30, -20, 0, 30, 20, 90]]},
            {},
            "job: the tool is 0.1 mm long, from its tip to the flange or holder (tool.holder); "
            "make it longer than 0.2 mm",
        ),
    ],
    ids=["length", "frame", "holder"],
)
def test_a_tool_shorter_than_its_contact_is_refused_with_the_setting(
    tool: dict[str, object], cell: dict[str, object], line: str
) -> None:
    """An upright tool enters the part by 0.1 mm from each end of its box."""
    with pytest.raises(JobError) as refused:
        make_scene_of_job(tool, cell, None)
    assert str(refused.value) == line
