"""The scene of a job: where its boxes stand, how long the tool is, what is taken for granted."""

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


def made(tool: dict[str, object], cell: dict[str, object], solid: Solid | None) -> CellScene:
    job = from_mapping({"tool": tool, "cell": {"robot": "IRB 1200", **cell}})
    return make_cell_scene(
        job, equip_cell(Rapid.cell(), job, ARM, read_fixtures(job, Files())), solid
    )


def boxes(scene: Scene, name: str) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Centre, axes and half lengths of the boxes of a body, in the frame that carries it."""
    sides = [
        (box, scene.pairs[pair][0]) for box, pair in zip(scene.first, scene.of_pair, strict=True)
    ]
    sides += [
        (box, scene.pairs[pair][1]) for box, pair in zip(scene.second, scene.of_pair, strict=True)
    ]
    rows = {int(box) for box, owner in sides if owner == name}
    return [(scene.origin[k], scene.rotation[k], scene.half[k]) for k in sorted(rows)]


def test_the_tool_goes_from_its_tip_to_the_flange() -> None:
    where = made({"length": 120, "diameter": 8}, {"fixtures": [[500, 0, 0, 510, 10, 10]]}, None)
    (centre, axes, half) = boxes(where.scene, "tool")[0]
    flange = ARM.flange
    back = np.linalg.inv(flange.rotation) @ (centre - np.asarray(flange.origin))
    assert np.allclose(back, (0, 0, 60))
    assert np.allclose(np.abs(np.linalg.inv(flange.rotation) @ axes @ half), (4, 4, 60))


def test_with_a_holder_it_goes_to_the_holder() -> None:
    """A tip 200 mm out and a holder of 90 mm leave 110 mm of shaft."""
    tool = {"length": 200, "holder": [[-30, -20, 0, 30, 20, 90]]}
    where = made(tool, {"fixtures": [[500, 0, 0, 510, 10, 10]]}, None)
    assert boxes(where.scene, "tool")[0][2][2] == pytest.approx(55)
    assert sorted(boxes(where.scene, "holder")[0][2].tolist()) == pytest.approx([20, 30, 45])


def test_a_leaning_shaft_stops_where_its_axis_meets_the_holder() -> None:
    """At 45 deg from a tip 100 mm beside and 200 mm out it meets the top at z = 100 after 100 sqrt 2 mm."""
    tool = {"holder": [[-40, -40, 0, 40, 40, 100]]}
    cell = {"flange_from_tool": [-100, 0, 200, 0, -45, 0], "fixtures": [[500, 0, 0, 510, 10, 10]]}
    where = made(tool, cell, None)
    assert 2 * boxes(where.scene, "tool")[0][2][2] == pytest.approx(100 * math.sqrt(2))


def test_fixtures_stand_in_the_work_frame() -> None:
    frame = [400.0, 50.0, 30.0, 0.0, 0.0, 30.0]
    where = made({}, {"base_from_work": frame, "fixtures": [[10, 20, 0, 30, 60, 8]]}, None)
    centre, axes, half = boxes(where.scene, "fixture 1")[0]
    assert np.allclose(centre, pose_from_values(frame).apply((20, 40, 4)))
    assert np.allclose(axes, pose_from_values(frame).rotation)
    assert np.allclose(half, (10, 20, 4))


def test_a_part_stands_on_a_table_unless_the_job_says_otherwise(solid: Solid) -> None:
    assumed = made({}, {}, solid)
    assert any(note.what == "the part stands on a table" for note in assumed.notes)
    assert any("table" in pair for pair in assumed.scene.pairs)
    for fixtures in ([], [[0, 0, -50, 1, 1, -40]]):
        own = made({}, {"fixtures": fixtures}, solid)
        assert not any("table" in pair for pair in own.scene.pairs)
    flat = made({}, {}, None)
    assert not any("table" in pair for pair in flat.scene.pairs)


@pytest.mark.parametrize("normal", [(0, 0, -1), (0, 0, 2), (-1, 0, 0), (0.6, 0, 0.8)])
def test_the_table_lies_under_the_face_on_which_the_part_rests(
    solid: Solid, normal: tuple[float, float, float]
) -> None:
    """Along the normal it begins 0.5 mm beyond the part and is 20 mm thick."""
    frame = [400.0, 50.0, 30.0, 0.0, 0.0, 30.0]
    where = made({}, {"base_from_work": frame, "rests_on": list(normal)}, solid)
    centre, axes, half = boxes(where.scene, "table")[0]
    down = pose_from_values(frame).rotation @ np.array(normal) / np.linalg.norm(normal)
    placed = np.array([pose_from_values(frame).apply(v) for v in solid.vertices.tolist()])
    lowest = float((placed @ down).max())
    middle, reach = float(down @ centre), float(np.abs(down @ axes) @ half)
    assert (middle - reach, middle + reach) == pytest.approx((lowest + 0.5, lowest + 20.5))
    # It reaches 200 mm beyond the part on all sides.
    level = np.abs(down @ axes) < 0.5
    assert np.allclose((half - np.abs((placed - centre) @ axes).max(axis=0))[level], 200)


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ({"rests_on": [0, 0]}, "is not a direction"),
        ({"rests_on": [0, 0, 0]}, "is not a direction"),
        ({"rests_on": [0, 0, 1], "fixtures": []}, "has no effect with cell.fixtures"),
    ],
)
def test_a_face_that_says_nothing_is_refused(
    solid: Solid, cell: dict[str, Any], message: str
) -> None:
    with pytest.raises(JobError, match=message):
        made({}, cell, solid)
    with pytest.raises(JobError, match=r"has no effect without a 3-D part \(cell.rests_on\)"):
        made({}, {"rests_on": [0, 0, 1]}, None)


def test_high_fixtures_raise_the_level(solid: Solid) -> None:
    low = made({}, {"fixtures": []}, solid)
    high = made({}, {"fixtures": [[-50, 0, 0, -40, 10, 300]]}, solid)
    as_mesh = made({}, {"fixtures": [str(PARTS / "rfa2.stl")]}, solid)
    assert high.level - low.level == pytest.approx(300 - 70)
    assert as_mesh.level - low.level == pytest.approx(100 - 70)


def test_only_the_tool_may_touch_the_part(solid: Solid) -> None:
    """The tip 0.05 mm in the part's top is no collision, but it is one 1 mm deeper."""
    where = made({"length": 100}, {"base_from_work": [450, -45, 200, 0, 0, 0]}, solid)
    down = np.diag([1.0, -1.0, -1.0])
    at = [np.array([450 + 60, -45 + 60, 200 + 70 + 100 - deep]) for deep in (0.05, 1.05)]
    found = []
    for place in at:
        every = compute_solutions(ARM, down[None], place[None])[0]
        every = every[np.isfinite(every).all(axis=1)]
        found.append(
            {
                name_pair(where.scene, int(k)) if k >= 0 else ""
                for k in find_collisions(where.scene, every)
            }
        )
    assert "" in found[0]
    assert "" not in found[1]
    assert "tool against part" in found[1]


def test_wrist_boxes_that_reach_past_the_flange_are_said() -> None:
    """Link 4 of an IRB 2400 has a box around its fork that meets what is at the flange when the wrist is straight."""
    arm = find_robot("IRB 2400")
    cell = Cell(
        "cell",
        pose_from_values([1000.0, 0, 0, 0, 0, 0]),
        pose_from_values([0.0, 0, 100, 0, 0, 0]),
        Joints(()),
    )
    where = make_cell_scene(Job(), equip_cell(cell, Job(), arm), None)
    untested = [("link 4", "link 6"), ("link 4", "tool")]
    assert [pair.bodies for pair in where.untested] == untested
    assert [str(note) for note in where.notes] == [
        f"assumed: {a} against {b} is not tested (their boxes overlap at home)" for a, b in untested
    ]
    assert find_collisions(where.scene, arm.home[None])[0] < 0
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
def test_boxes_that_are_none(
    tool: dict[str, object], cell: dict[str, object], message: str
) -> None:
    with pytest.raises(JobError, match=message):
        made(tool, cell, None)


def test_a_fixture_that_is_no_mesh_is_told_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "clamp.stl").write_text("solid\n")
    with pytest.raises(InputError, match=r"clamp\.stl"):
        made({}, {"fixtures": [str(tmp_path / "clamp.stl")]}, None)


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
def test_a_tool_shorter_than_its_contact_names_the_setting(
    tool: dict[str, object], cell: dict[str, object], line: str
) -> None:
    """An upright tool enters the part by 0.1 mm from each end of its box."""
    with pytest.raises(JobError) as refused:
        made(tool, cell, None)
    assert str(refused.value) == line
