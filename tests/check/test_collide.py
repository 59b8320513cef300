"""The final check follows the TCP on its lines and arcs, and what collides costs its edge."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import camgen
from bench.robots.parts import Frames, count_unfounded, list_touches, turn_evenly
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
#: Half a mm in which the tool turns by 10 deg, as on a short edge.
SHORT = PosePath(
    frozen([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]),
    frozen(np.full((2, 3), np.nan)),
    frozen([DOWN @ rotation_about(1, 0.5), DOWN @ rotation_about(1, 0.5 + math.radians(10))]),
)


def tool_scene(obstacles: tuple[Link, ...] = ()) -> Scene:
    rod = Link("tool", (Box(translation(0.0, 0.0, 50.0), (3.0, 3.0, 50.0)),))
    return make_scene(ARM, (rod,), obstacles)


def setup() -> Setup:
    return Setup(ARM, BASE, TOOL, measure_apart=partial(measure_apart, tool_scene()))


def ends() -> FloatArray:
    start = np.array([[0.0, 0.4, 0.2, 0.1, 0.8, 0.0]])
    rotations, origins = compute_flange_poses(setup(), SHORT.position, SHORT.rotation)
    first = find_nearest(ARM, rotations[:1], origins[:1], start)
    return np.concatenate([first, find_nearest(ARM, rotations[1:], origins[1:], first)])


def tips(joints: FloatArray) -> FloatArray:
    """The TCP in the work frame by textbook matrices."""
    tool = np.eye(4)
    tool[:3, 3] = TOOL.origin
    return np.array([(by_hand("IRB 120", np.degrees(q)) @ tool)[:3, 3] for q in joints]) - np.array(
        BASE.origin
    )


def between(joints: FloatArray, at: FloatArray, share: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(share, at, column) for column in joints.T])


def test_between_rows_no_point_leaves_the_way_of_the_tcp() -> None:
    share = np.linspace(0.0, 1.0, 401)
    rotation = turn_evenly(SHORT.rotation[0], SHORT.rotation[1], share)
    places = place_motion(*SHORT.position[[0]], None, SHORT.position[1], share)
    exact = Frames(ARM, BASE, TOOL).find_joints(places, rotation, ends()[0])
    apart = partial(measure_apart, tool_scene())
    found = follow_closely(setup(), SHORT, ends(), np.array([True]))
    assert not len(found.lost)
    assert np.abs(tips(found.joints)[:, 1:]).max() < 1e-6
    # Two rows alone leave it by forty times as much: that was taken for a collision.
    assert apart(exact, between(ends(), np.array([0.0, 1.0]), share)).max() > 0.4
    assert apart(exact, between(found.joints, found.at, share)).max() < APART / 2


def test_where_the_joints_run_evenly_nothing_is_added() -> None:
    found = follow_closely(setup(), SHORT, ends(), np.array([False]))
    assert np.array_equal(found.joints, ends())


def test_several_tracks_are_followed_as_each_alone() -> None:
    back = SampledMotion(ends()[::-1], SHORT.reversed())
    one, even, other = follow_all(
        setup(), [SampledMotion(ends(), SHORT), SampledMotion(ends()), back]
    )
    alone = follow_closely(setup(), SHORT, ends(), np.array([True]))
    assert np.allclose(one.joints, alone.joints, atol=1e-9)
    assert np.array_equal(one.at, alone.at)
    assert np.array_equal(even.joints, ends())
    assert np.allclose(other.joints, one.joints[::-1], atol=1e-9)
    assert other.at[[0, -1]].tolist() == [0.0, 1.0]


def test_a_way_out_of_reach_between_two_rows_is_told() -> None:
    far = PosePath(frozen([[0.0, 0.0, 0.0], [3000.0, 0.0, 0.0]]), SHORT.via, SHORT.rotation)
    assert follow_closely(setup(), far, ends(), np.array([True])).lost.tolist() == [0]


def test_what_stands_on_the_line_is_met_though_evenly_run_joints_pass_it() -> None:
    """A pin at the tip half-way along the line, on the side that evenly run joints move away from."""
    middle = follow_closely(setup(), SHORT, ends(), np.array([True]))
    half = between(middle.joints, middle.at, np.array([0.5]))
    even = ends().mean(axis=0)[None]
    away = (tips(even) - tips(half))[0]
    assert np.linalg.norm(away) > 0.1
    place = tips(half)[0] + np.array(BASE.origin) - away / np.linalg.norm(away) * 0.02
    pin = (Link("pin", (Box(Pose(IDENTITY, tuple(place.tolist())), (0.01, 0.01, 0.01)),)),)
    thin = Link("tool", (Box(translation(0.0, 0.0, 99.95), (0.01, 0.01, 0.05)),))
    tested = make_scene(ARM, (thin,), pin)
    assert check_motion(tested, middle.joints, 0.02).pair >= 0
    assert check_motion(tested, ends(), 0.02).pair < 0


# -- whole builds ------------------------------------------------------------------------------------------------------


def rounded_box(sides: int) -> trimesh.Trimesh:
    """120 x 80 x 20 mm, its upright edges rounded by 12 mm, each in so many sides."""
    corners = []
    for turn, middle in enumerate([(108.0, 68.0), (12.0, 68.0), (12.0, 12.0), (108.0, 12.0)]):
        angle = (np.arange(sides + 1) / sides + turn) * (math.pi / 2)
        corners.append(np.array(middle) + 12.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    outline = np.concatenate(corners)
    count = len(outline)
    low, high = np.arange(count), np.arange(count) + count
    after = np.roll(low, -1)
    faces = [
        np.column_stack([low, after, after + count]),
        np.column_stack([low, after + count, high]),
    ]
    fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
    points = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (0.0, 20.0)])
    return trimesh.Trimesh(
        points, np.concatenate([*faces, fan + count, fan[:, ::-1]]), process=False
    )


@pytest.mark.parametrize("sides", [3, 4, 12])
def test_a_box_with_rounded_corners_comes_to_a_program_that_touches_nothing(
    sides: int, tmp_path: Path
) -> None:
    """The program was refused: "collides on edge e7: tool against part". 400 places on that way show nothing."""
    rounded_box(sides).export(tmp_path / "box.stl")
    job = {"cell": {"robot": "IRB 120"}}
    result = camgen.build(tmp_path / "box.stl", post="rapid", job=job)
    assert len(result.tour.paths) >= 6
    assert list_touches(result, 400) == []
    assert count_unfounded(result, camgen.job(job), 400)[1] == 0


def stop(
    monkeypatch: pytest.MonkeyPatch, rounds: int, lost: Callable[[Any], tuple[BlockedPath, ...]]
) -> list[Any]:
    """The check finds collisions in the first rounds."""
    asked: list[Any] = []
    real = programs.check

    def check(program: Any, *others: Any) -> Checks:
        asked.append(program)
        if len(asked) <= rounds:
            raise Blocked("box.stl", "IRB 120 collides", "instruction 9", "", lost(program))
        found = real(program, *others)
        assert isinstance(found, Checks)
        return found

    monkeypatch.setattr(programs, "check", check)
    return asked


def find_whole(program: Any) -> int:
    """The number of the first path but one along a whole edge."""
    return next(k for k, path in enumerate(program.paths) if k and path.id in path.contours)


def second(program: Any) -> tuple[BlockedPath, ...]:
    why = "collision, link 5 against part, at 1 2 3 mm"
    return (BlockedPath(find_whole(program), "collision", why),)


def every(program: Any) -> tuple[BlockedPath, ...]:
    return tuple(
        BlockedPath(k, "collision", "collision, link 5 against part")
        for k in range(len(program.paths))
    )


@pytest.fixture
def box(tmp_path: Path) -> Path:
    rounded_box(12).export(tmp_path / "box.stl")
    return tmp_path / "box.stl"


def test_what_the_check_finds_costs_its_edge_and_no_more(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = stop(monkeypatch, 1, second)
    result = camgen.build(box, post="rapid")
    gone = asked[0].paths[find_whole(asked[0])].id
    assert {one.id for one in result.tour.paths} == {one.id for one in asked[0].paths} - {gone}
    (note,) = [note for note in result.notes if note.ids == (gone,)]
    assert note.kind == "skipped"
    assert note.why == "collision, link 5 against part, at 1 2 3 mm"
    assert any(
        gone in str(line) and "link 5 against part" in str(line) for line in result.report["notes"]
    )


def test_strict_makes_an_error_of_it(box: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stop(monkeypatch, 1, second)
    with pytest.raises(NoSafeProgram, match="--strict"):
        camgen.build(box, post="rapid", job={"input": {"select": "e7-e8"}}, strict=True)


@pytest.mark.parametrize("ends", [{"way": True}, {"at_end": True}], ids=["link", "end of it"])
def test_a_link_that_is_blocked_for_once_costs_no_edge(
    box: Path, monkeypatch: pytest.MonkeyPatch, ends: dict[str, bool]
) -> None:
    """The tool leaves the part on it then."""

    def blocked(program: Any) -> tuple[BlockedPath, ...]:
        return (BlockedPath(find_whole(program), "collision", "tool against part", **ends),)

    programs_checked = stop(monkeypatch, 1, blocked)
    result = camgen.build(box, post="rapid")
    first, second_one = programs_checked
    assert {path.id for path in first.paths} == {path.id for path in second_one.paths}
    assert len(result.tour.paths) == len(first.paths)


def test_without_an_edge_left_there_is_no_program(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop(monkeypatch, 1, every)
    with pytest.raises(
        NoSafeProgram,
        match=r"none of 16 edges can be processed: e\d+ \(collision, link 5 against part\)",
    ):
        camgen.build(box, post="rapid")


def test_every_path_that_collides_is_told_with_its_place(box: Path) -> None:
    """A wall that the planner did not know of, across the way: each edge that it stops is named, the others are not."""
    tables: dict[str, Any] = {"cell": {"robot": "IRB 120", "fixtures": []}}
    free = camgen.build(box, post="rapid", job=tables)
    wall = {"cell": {**tables["cell"], "fixtures": [[59, -40, 24, 61, 120, 60]]}}
    with pytest.raises(Blocked) as refused:
        camgen.check(free.program, wall, camgen.cell("rapid", wall))
    error = refused.value
    assert 0 < len(error.lost) <= len(free.program.paths)
    assert all("against fixture 1, at " in one.why for one in error.lost)
    assert len({one.path for one in error.lost}) == len(error.lost)
    links = ("link" in error.what, "cell.base_from_work" in error.remedy)
    assert links in ((True, True), (False, False))


# -- the tool's own contact --------------------------------------------------------------------------------------------


def plate_with_hole(radius: float) -> trimesh.Trimesh:
    angle = np.arange(90) * (math.tau / 90)
    round_hole = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    reach = np.abs(round_hole).max(axis=1, keepdims=True)
    return plate_between(round_hole, 40.0 * round_hole / reach)


def plate_between(hole: FloatArray, outline: FloatArray) -> trimesh.Trimesh:
    """A plate of 10 mm between two rings of points (N, 2)."""
    count = len(hole)
    points = np.concatenate(
        [np.insert(ring, 2, z, axis=1) for ring in (hole, outline) for z in (0.0, 10.0)]
    )
    a = np.arange(count)
    b = np.roll(a, -1)
    faces = []
    for one, other in ((1, 0), (0, 2), (2, 3), (3, 1)):
        first, second = one * count, other * count
        faces += [
            np.column_stack([a + first, b + first, b + second]),
            np.column_stack([a + first, b + second, a + second]),
        ]
    made = trimesh.Trimesh(points, np.concatenate(faces), process=False)
    assert made.is_watertight
    if made.volume < 0:
        made.invert()
    return made


def test_a_rim_that_bends_into_the_tip_of_its_tool_is_run(tmp_path: Path) -> None:
    """A tool of 6 mm at the rim of a hole of 13 mm: the rim enters its square end by 0.38 mm at either side."""
    plate_with_hole(6.5).export(tmp_path / "plate.stl")
    job = {"cell": {"robot": "IRB 2400", "base_from_work": [1000, 0, 500, 0, 0, 0]}}
    part = camgen.read(tmp_path / "plate.stl")
    assert part.solid is not None
    rims = [edge for edge in part.solid.edges if edge.kind == "circle"]
    assert len(rims) == 2
    angle = np.linspace(0, math.pi, 10001)
    bent = 6.5 * (1 - np.cos(angle)) / math.sqrt(2)
    deep = np.minimum.reduce([3.0 - 6.5 * np.sin(angle), 3.0 - bent, bent]).max()
    contacts = find_contacts(rims, camgen.job(job))
    assert list(contacts.values()) == pytest.approx([deep, deep], abs=0.02)
    (upper,) = [edge.id for edge in rims if edge.points[0, 2] > 5]
    result = camgen.build(
        tmp_path / "plate.stl", post="rapid", job={**job, "input": {"select": upper}}
    )
    assert len(result.tour.paths) == 1
    expected = "the rim of 1 edge may enter the tool's tip"
    assert any(expected in note.what and note.ids == (upper,) for note in result.notes)


def build_two_plates(folder: Path) -> dict[str, float]:
    """Worked lengths: of a rim that enters the tip by 0.47 mm, and of the edges of a square hole.

    The square hole, 60 mm wide, is in a plate of its own.
    """
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    square_plate = plate_between(30.0 * square, 50.0 * square)
    square_plate.apply_translation([0.0, -150.0, 0.0])
    both = trimesh.util.concatenate([plate_with_hole(5.0), square_plate])
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


def test_no_other_edge_is_entered_as_deep_as_a_rim(tmp_path: Path) -> None:
    """Half of the tool, 3 mm, stands between the end of a path and the wall, less 0.1 mm."""
    lengths = build_two_plates(tmp_path)
    lines = [length for name, length in lengths.items() if name.startswith("line")]
    assert len(lines) == 4
    assert any(name.startswith("circle") for name in lengths)
    assert all(53.0 <= length <= 60.0 - 2 * (3.0 - 0.1) + 1e-6 for length in lines)


def test_the_check_allows_no_more_if_the_plan_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LineTask, "by_contact", lambda _, lines: [(lines, 0.47)])
    worked = build_two_plates(tmp_path)
    assert worked
    assert all(name.startswith("circle") for name in worked)


def test_a_rim_that_a_tool_does_not_fit_into_is_left_out() -> None:
    part = camgen.part(plate_with_hole(1.6))
    assert part.solid is not None
    rims = [edge for edge in part.solid.edges if edge.kind == "circle"]
    assert find_contacts(rims, camgen.job()) == {}


@pytest.mark.parametrize(("at", "met"), [(102.0, False), (99.0, False), (96.0, True)])
def test_only_the_tip_may_enter_the_part_deeper(at: float, met: bool) -> None:
    """A wall beside a rod 6 mm wide and 100 mm long, 0.3 mm in its side, from ``at`` mm along it on."""
    rod = Link("tool", (Box(translation(0.0, 0.0, 50.0), (3.0, 3.0, 50.0)),))
    joints = ends()[:1]
    turn, origin = flange_of(joints)
    wall = Box(
        Pose(turn, tuple((origin + turn @ [7.7, 0.0, at + 20.0]).tolist())), (5.0, 5.0, 20.0)
    )
    for tip, verdict in ((0.0, at < 99.9), (0.4, met)):
        tested = make_scene(ARM, (rod,), (), (wall,), allowed=Allowed(0.1, tip))
        found = check_motion(tested, joints, 1.0)
        assert (found.pair >= 0 and tested.pairs[found.pair] == ("tool", "part")) is verdict


def flange_of(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    turn, origin = compute_flange(ARM, joints)
    return turn[0], origin[0]
