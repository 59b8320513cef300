"""The final check follows the TCP on lines and arcs; a collision costs its edge."""

import itertools
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import camgen
from bench.robots.parts import joints_on, touches, turned, unfounded
from bench.support.motions import place_motion
from camgen.check import Checks
from camgen.collision.motion import check_motion, measure_apart
from camgen.collision.scene import Allowed, Scene, make_scene
from camgen.model.errors import Blocked, BlockedPath, NoSafeProgram
from camgen.model.pose import IDENTITY, FloatArray, Pose, frozen, rotation_about, translation
from camgen.motion.joint_paths import APART, follow_all, follow_closely
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import SampledMotion, Setup, compute_flange_poses
from camgen.pipeline import programs
from camgen.plan.edges import LineTask
from camgen.plan.edges.contact import find_contacts
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange
from camgen.robots.kinematics.inverse import find_nearest
from camgen.robots.models import Box, Link
from tests.support.arm_models import by_hand

ARM = find_robot("IRB 120")
BASE, TOOL = translation(400.0, 0.0, 150.0), translation(0.0, 0.0, 100.0)
DOWN = rotation_about(0, math.pi) @ rotation_about(2, 0.3)
#: A line of 0.5 mm on which the tool rotates by 10 deg, as on a short edge.
SHORT = PosePath(
    frozen([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]),
    frozen(np.full((2, 3), np.nan)),
    frozen([DOWN @ rotation_about(1, 0.5), DOWN @ rotation_about(1, 0.5 + math.radians(10))]),
)


def make_rod_scene(obstacles: tuple[Link, ...] = ()) -> Scene:
    """The arm with a rod of 6 x 6 x 100 mm as its tool."""
    rod = Link("tool", (Box(translation(0.0, 0.0, 50.0), (3.0, 3.0, 50.0)),))
    return make_scene(ARM, (rod,), obstacles)


def make_setup() -> Setup:
    return Setup(ARM, BASE, TOOL, measure_apart=partial(measure_apart, make_rod_scene()))


def find_end_joints() -> FloatArray:
    """Joint values (2, 6) at the ends of `SHORT`."""
    start = np.array([[0.0, 0.4, 0.2, 0.1, 0.8, 0.0]])
    rotations, origins = compute_flange_poses(make_setup(), SHORT.position, SHORT.rotation)
    first = find_nearest(ARM, rotations[:1], origins[:1], start)
    return np.concatenate([first, find_nearest(ARM, rotations[1:], origins[1:], first)])


def compute_tcp(joints: FloatArray) -> FloatArray:
    """The TCP (N, 3) in the work frame, by textbook matrices."""
    tool = np.eye(4)
    tool[:3, 3] = TOOL.origin
    return np.array([(by_hand("IRB 120", np.degrees(q)) @ tool)[:3, 3] for q in joints]) - np.array(
        BASE.origin
    )


def interpolate_joints(
    joints: FloatArray, positions: FloatArray, fractions: FloatArray
) -> FloatArray:
    """Joint values at fractions of a motion; `joints` are those at the fractions `positions`."""
    return np.column_stack([np.interp(fractions, positions, column) for column in joints.T])


def test_a_joint_path_keeps_all_points_of_the_tool_near_the_line() -> None:
    fractions = np.linspace(0.0, 1.0, 401)
    rotation = turned(SHORT.rotation[0], SHORT.rotation[1], fractions)
    exact = joints_on(
        ARM,
        BASE,
        TOOL,
        place_motion(*SHORT.position[[0]], None, SHORT.position[1], fractions),
        rotation,
        find_end_joints()[0],
    )
    measure = partial(measure_apart, make_rod_scene())
    path = follow_closely(make_setup(), SHORT, find_end_joints(), np.array([True]))
    assert not len(path.lost)
    assert np.abs(compute_tcp(path.joints)[:, 1:]).max() < 1e-6
    # A joint motion between the ends deviates forty times as much, enough for a false collision.
    assert (
        measure(exact, interpolate_joints(find_end_joints(), np.array([0.0, 1.0]), fractions)).max()
        > 0.4
    )
    assert measure(exact, interpolate_joints(path.joints, path.at, fractions)).max() < APART / 2


def test_a_joint_motion_gets_no_intermediate_joint_values() -> None:
    path = follow_closely(make_setup(), SHORT, find_end_joints(), np.array([False]))
    assert np.array_equal(path.joints, find_end_joints())


def test_several_motions_are_followed_like_each_alone() -> None:
    reversed_motion = SampledMotion(find_end_joints()[::-1], SHORT.reversed())
    forward, joint_motion, backward = follow_all(
        make_setup(),
        [
            SampledMotion(find_end_joints(), SHORT),
            SampledMotion(find_end_joints()),
            reversed_motion,
        ],
    )
    alone = follow_closely(make_setup(), SHORT, find_end_joints(), np.array([True]))
    assert np.allclose(forward.joints, alone.joints, atol=1e-9)
    assert np.array_equal(forward.at, alone.at)
    assert np.array_equal(joint_motion.joints, find_end_joints())
    assert np.allclose(backward.joints, forward.joints[::-1], atol=1e-9)
    assert backward.at[[0, -1]].tolist() == [0.0, 1.0]


def test_a_line_that_is_out_of_reach_between_its_ends_is_reported() -> None:
    far = PosePath(frozen([[0.0, 0.0, 0.0], [3000.0, 0.0, 0.0]]), SHORT.via, SHORT.rotation)
    assert follow_closely(make_setup(), far, find_end_joints(), np.array([True])).lost.tolist() == [
        0
    ]


def test_an_obstacle_on_the_line_is_found_though_a_joint_motion_avoids_it() -> None:
    """A pin is at the TCP half-way along the line.

    It is at the side away from which a joint motion between the ends deviates.
    """
    path = follow_closely(make_setup(), SHORT, find_end_joints(), np.array([True]))
    half_way = interpolate_joints(path.joints, path.at, np.array([0.5]))
    even = find_end_joints().mean(axis=0)[None]
    deviation = (compute_tcp(even) - compute_tcp(half_way))[0]
    assert np.linalg.norm(deviation) > 0.1
    position = (
        compute_tcp(half_way)[0]
        + np.array(BASE.origin)
        - deviation / np.linalg.norm(deviation) * 0.02
    )
    pin = (Link("pin", (Box(Pose(IDENTITY, tuple(position.tolist())), (0.01, 0.01, 0.01)),)),)
    thin = Link("tool", (Box(translation(0.0, 0.0, 99.95), (0.01, 0.01, 0.05)),))
    scene = make_scene(ARM, (thin,), pin)
    assert check_motion(scene, path.joints, 0.02).pair >= 0
    assert check_motion(scene, find_end_joints(), 0.02).pair < 0


# Whole builds.


def make_rounded_box(sides: int) -> trimesh.Trimesh:
    """A box of 120 x 80 x 20 mm, whose upright edges are rounded by 12 mm in `sides` faces."""
    corners = []
    for quarter, middle in enumerate([(108.0, 68.0), (12.0, 68.0), (12.0, 12.0), (108.0, 12.0)]):
        angle = (np.arange(sides + 1) / sides + quarter) * (math.pi / 2)
        corners.append(np.array(middle) + 12.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    outline = np.concatenate(corners)
    count = len(outline)
    low, high = np.arange(count), np.arange(count) + count
    next_low = np.roll(low, -1)
    faces = [
        np.column_stack([low, next_low, next_low + count]),
        np.column_stack([low, next_low + count, high]),
    ]
    fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
    points = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (0.0, 20.0)])
    return trimesh.Trimesh(
        points, np.concatenate([*faces, fan + count, fan[:, ::-1]]), process=False
    )


@pytest.mark.parametrize("sides", [3, 4, 12])
def test_the_program_of_a_box_with_rounded_corners_is_free_of_collisions(
    sides: int, tmp_path: Path
) -> None:
    """400 samples of each motion show no collision, and the check refuses no motion without one."""
    make_rounded_box(sides).export(tmp_path / "box.stl")
    job = {"cell": {"robot": "IRB 120"}}
    result = camgen.build(tmp_path / "box.stl", post="rapid", job=job)
    assert len(result.tour.paths) >= 6
    assert touches(result, 400) == []
    assert unfounded(result, camgen.job(job), 400)[1] == 0


def block_checks(
    monkeypatch: pytest.MonkeyPatch, count: int, lost: Callable[[Any], tuple[BlockedPath, ...]]
) -> list[Any]:
    """Make the first `count` checks report blocked paths.

    lost: returns the blocked paths of a program. The result collects the programs checked.
    """
    programs_checked: list[Any] = []
    real = programs.check

    def check(program: Any, *others: Any) -> Checks:
        programs_checked.append(program)
        if len(programs_checked) <= count:
            raise Blocked("box.stl", "IRB 120 collides", "instruction 9", "", lost(program))
        checks = real(program, *others)
        assert isinstance(checks, Checks)
        return checks

    monkeypatch.setattr(programs, "check", check)
    return programs_checked


def find_whole(program: Any) -> int:
    """The index of the first path, apart from path 0, that runs along a whole edge."""
    return next(k for k, path in enumerate(program.paths) if k and path.id in path.contours)


def block_one_edge(program: Any) -> tuple[BlockedPath, ...]:
    """One path along a whole edge is blocked."""
    why = "collision, link 5 against part, at 1 2 3 mm"
    return (BlockedPath(find_whole(program), "collision", why),)


def block_all_paths(program: Any) -> tuple[BlockedPath, ...]:
    """All paths are blocked."""
    return tuple(
        BlockedPath(k, "collision", "collision, link 5 against part")
        for k in range(len(program.paths))
    )


@pytest.fixture
def box(tmp_path: Path) -> Path:
    make_rounded_box(12).export(tmp_path / "box.stl")
    return tmp_path / "box.stl"


def test_an_edge_that_the_check_blocks_is_skipped_and_the_others_are_run(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs_checked = block_checks(monkeypatch, 1, block_one_edge)
    result = camgen.build(box, post="rapid")
    blocked_id = programs_checked[0].paths[find_whole(programs_checked[0])].id
    assert {path.id for path in result.tour.paths} == {
        path.id for path in programs_checked[0].paths
    } - {blocked_id}
    (note,) = [note for note in result.notes if note.ids == (blocked_id,)]
    assert note.kind == "skipped"
    assert note.why == "collision, link 5 against part, at 1 2 3 mm"
    assert any(
        blocked_id in str(line) and "link 5 against part" in str(line)
        for line in result.report["notes"]
    )


def test_a_blocked_edge_is_an_error_with_strict(box: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block_checks(monkeypatch, 1, block_one_edge)
    with pytest.raises(NoSafeProgram, match="--strict"):
        camgen.build(box, post="rapid", job={"input": {"select": "e7-e8"}}, strict=True)


@pytest.mark.parametrize("where", [{"on_link": True}, {"at_end": True}], ids=["link", "end of it"])
def test_a_link_that_is_blocked_once_costs_no_edge(
    box: Path, monkeypatch: pytest.MonkeyPatch, where: dict[str, bool]
) -> None:
    """On the next attempt the tool retracts from the part on that link."""

    def blocked(program: Any) -> tuple[BlockedPath, ...]:
        return (BlockedPath(find_whole(program), "collision", "tool against part", **where),)

    programs_checked = block_checks(monkeypatch, 1, blocked)
    result = camgen.build(box, post="rapid")
    first, second = programs_checked
    assert {path.id for path in first.paths} == {path.id for path in second.paths}
    assert len(result.tour.paths) == len(first.paths)


def test_a_build_without_any_free_edge_is_refused(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block_checks(monkeypatch, 1, block_all_paths)
    with pytest.raises(
        NoSafeProgram,
        match=r"none of 16 edges can be processed: e\d+ \(collision, link 5 against part\)",
    ):
        camgen.build(box, post="rapid")


def test_every_path_that_collides_is_named_with_its_position(box: Path) -> None:
    """The check gets a wall that the planner did not know. Each blocked edge is named once."""
    tables: dict[str, Any] = {"cell": {"robot": "IRB 120", "fixtures": []}}
    free = camgen.build(box, post="rapid", job=tables)
    wall = {"cell": {**tables["cell"], "fixtures": [[59, -40, 24, 61, 120, 60]]}}
    with pytest.raises(Blocked) as refused:
        camgen.check(free.program, wall, camgen.cell("rapid", wall))
    error = refused.value
    assert 0 < len(error.lost) <= len(free.program.paths)
    assert all("against fixture 1, at " in blocked.why for blocked in error.lost)
    assert len({blocked.path for blocked in error.lost}) == len(error.lost)
    links = ("link" in error.what, "cell.base_from_work" in error.remedy)
    assert links in ((True, True), (False, False))


# The contact of the tool with the part.


def make_plate_with_hole(radius: float) -> trimesh.Trimesh:
    """A square plate of 80 x 80 x 10 mm with a round hole in its middle."""
    angle = np.arange(90) * (math.tau / 90)
    round_hole = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    extent = np.abs(round_hole).max(axis=1, keepdims=True)
    return make_plate(round_hole, 40.0 * round_hole / extent)


def make_plate(hole: FloatArray, outline: FloatArray) -> trimesh.Trimesh:
    """A plate 10 mm thick between two rings of points (N, 2)."""
    count = len(hole)
    rings = itertools.product((hole, outline), (0.0, 10.0))
    points = np.concatenate([np.insert(ring, 2, z, axis=1) for ring, z in rings])
    a = np.arange(count)
    b = np.roll(a, -1)
    faces = []
    for first_ring, second_ring in ((1, 0), (0, 2), (2, 3), (3, 1)):
        first, block_one_edge = first_ring * count, second_ring * count
        faces += [
            np.column_stack([a + first, b + first, b + block_one_edge]),
            np.column_stack([a + first, b + block_one_edge, a + block_one_edge]),
        ]
    plate = trimesh.Trimesh(points, np.concatenate(faces), process=False)
    assert plate.is_watertight
    if plate.volume < 0:
        plate.invert()
    return plate


def test_a_rim_that_enters_the_tip_of_its_tool_is_run(tmp_path: Path) -> None:
    """A tool of 6 mm is at the rim of a hole of 13 mm.

    The rim enters the square end of the tool by 0.38 mm at either side.
    """
    make_plate_with_hole(6.5).export(tmp_path / "plate.stl")
    job = {"cell": {"robot": "IRB 2400", "base_from_work": [1000, 0, 500, 0, 0, 0]}}
    part = camgen.read(tmp_path / "plate.stl")
    assert part.solid is not None
    rims = [edge for edge in part.solid.edges if edge.kind == "circle"]
    assert len(rims) == 2
    angle = np.linspace(0, math.pi, 10001)
    drop = 6.5 * (1 - np.cos(angle)) / math.sqrt(2)
    depth = np.minimum.reduce([3.0 - 6.5 * np.sin(angle), 3.0 - drop, drop]).max()
    contacts = find_contacts(rims, camgen.job(job))
    assert list(contacts.values()) == pytest.approx([depth, depth], abs=0.02)
    (upper,) = [edge.id for edge in rims if edge.points[0, 2] > 5]
    result = camgen.build(
        tmp_path / "plate.stl", post="rapid", job={**job, "input": {"select": upper}}
    )
    assert len(result.tour.paths) == 1
    expected = "the rim of 1 edge may enter the tool's tip"
    assert any(expected in note.what and note.ids == (upper,) for note in result.notes)


def build_two_plates(folder: Path) -> dict[str, float]:
    """Lengths of paths, mm, by kind of edge and id of path.

    One plate has a round hole, whose rim enters the tip by 0.47 mm. The other plate has a square
    hole 60 mm wide.
    """
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    square_plate = make_plate(30.0 * square, 50.0 * square)
    square_plate.apply_translation([0.0, -150.0, 0.0])
    both = trimesh.util.concatenate([make_plate_with_hole(5.0), square_plate])
    both.export(folder / "plates.stl")
    part = camgen.read(folder / "plates.stl")
    assert part.solid is not None
    upper = [edge for edge in part.solid.edges if edge.points[:, 2].min() > 5.0]
    kinds = {
        edge.id: edge.kind
        for edge in upper
        if edge.kind == "circle" or edge.length == pytest.approx(60.0)
    }
    job = {
        "cell": {"robot": "IRB 2400", "base_from_work": [1000, 0, 500, 0, 0, 0]},
        "input": {"select": ", ".join(kinds)},
    }
    tour = camgen.build(folder / "plates.stl", post="rapid", job=job).tour
    worked = zip(tour.paths, tour.lengths, strict=True)
    return {f"{kinds[path.contours[0]]} {path.id}": length for path, length in worked}


def test_a_straight_edge_is_not_entered_as_deep_as_a_rim(tmp_path: Path) -> None:
    """A path ends half the tool, 3 mm, before the wall, less a contact of 0.1 mm."""
    lengths = build_two_plates(tmp_path)
    lines = [length for name, length in lengths.items() if name.startswith("line")]
    assert len(lines) == 4
    assert any(name.startswith("circle") for name in lengths)
    assert all(53.0 <= length <= 60.0 - 2 * (3.0 - 0.1) + 1e-6 for length in lines)


def test_the_check_blocks_straight_edges_that_a_plan_lets_enter_deeper(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LineTask, "by_contact", lambda _, lines: [(lines, 0.47)])
    worked = build_two_plates(tmp_path)
    assert worked
    assert all(name.startswith("circle") for name in worked)


def test_a_rim_that_is_too_narrow_for_the_tool_has_no_contact() -> None:
    part = camgen.part(make_plate_with_hole(1.6))
    assert part.solid is not None
    rims = [edge for edge in part.solid.edges if edge.kind == "circle"]
    assert find_contacts(rims, camgen.job()) == {}


@pytest.mark.parametrize(("start", "collides"), [(102.0, False), (99.0, False), (96.0, True)])
def test_only_the_tip_may_enter_the_part_deeper(start: float, collides: bool) -> None:
    """A wall enters a rod, 6 mm wide and 100 mm long, by 0.3 mm from the side.

    The wall begins `start` mm along the rod, whose tip is its last 3 mm.
    """
    rod = Link("tool", (Box(translation(0.0, 0.0, 50.0), (3.0, 3.0, 50.0)),))
    joints = find_end_joints()[:1]
    rotation, origin = compute_flange_pose(joints)
    wall = Box(
        Pose(rotation, tuple((origin + rotation @ [7.7, 0.0, start + 20.0]).tolist())),
        (5.0, 5.0, 20.0),
    )
    for tip, verdict in ((0.0, start < 99.9), (0.4, collides)):
        scene = make_scene(ARM, (rod,), (), (wall,), allowed=Allowed(0.1, tip))
        check = check_motion(scene, joints, 1.0)
        assert (check.pair >= 0 and scene.pairs[check.pair] == ("tool", "part")) is verdict


def compute_flange_pose(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    rotation, origin = compute_flange(ARM, joints)
    return rotation[0], origin[0]
