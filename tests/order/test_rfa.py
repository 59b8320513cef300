"""Retractions, links and the route over the edges of a part.

Textbook forward kinematics and a plain search check the results.
"""

import importlib
import math
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.rapid import Rapid
from msgspec.structs import replace

from camgen.collision.cell import make_cell_scene
from camgen.collision.hits import find_collisions
from camgen.collision.scene import Scene
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray, Pose
from camgen.motion.cell import make_free_space, make_setup
from camgen.motion.limits import LinkSpeeds
from camgen.motion.pose_paths import PosePath
from camgen.motion.reach import reach_paths
from camgen.motion.setup import (
    Blockage,
    EdgeMotion,
    FreeSpace,
    OrientationFreedom,
    SampledMotion,
    Setup,
)
from camgen.order.edges.links import (
    BY_HOME,
    FREE,
    JointLink,
    MotionEnds,
    PathLink,
    choose_links,
    find_links_at_part,
)
from camgen.order.edges.problem import RouteCell, RouteOptions
from camgen.order.edges.retract import Retraction, find_retractions
from camgen.order.edges.route import Route, find_route
from camgen.order.edges.turns import list_turns
from camgen.plan.edges.poses import make_poses
from camgen.plan.edges.select import select_edges
from camgen.read.job_file import load_job
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.workcell import equip_cell
from tests.support.arm_models import by_hand
from tests.support.edge_shapes import reach
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = find_robot("IRB 2400")
SPEEDS = LinkSpeeds(100.0, 100.0, 0.0)
WALL = Blockage("collision", "link 5 against wall", 0.0)


@cache
def load_cell(part: str) -> tuple[Setup, FreeSpace, tuple[EdgeMotion, ...]]:
    solid, job = mesh.read(source(PARTS / f"{part}.stl")), load_job(PARTS / f"{part}.toml")
    cell_scene = make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid)
    setup = make_setup(ARM, equip_cell(Rapid.cell(), job), cell_scene)
    chosen = select_edges(solid, [job.input.select])
    edges = [edge for edge in solid.edges if edge.id in chosen]
    reached = reach(edges, setup, 2.0, "mean", OrientationFreedom(math.radians(15), roll=True))
    motions = tuple(motion for motion in reached if isinstance(motion, EdgeMotion))
    return setup, make_free_space(cell_scene, setup), motions


def list_no_turns(*_: object) -> IntArray:
    """The only choice of turn counts: 0 for each joint."""
    return np.zeros((1, 6), dtype=np.int64)


@cache
def route_part(part: str, best: bool = True) -> Route:
    setup, space, motions = load_cell(part)
    edges = mesh.read(source(PARTS / f"{part}.stl")).edges
    return find_route(RouteCell(setup, space, ARM.home), motions, edges, RouteOptions(SPEEDS, best))


def make_matrix(pose: Pose) -> FloatArray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = pose.rotation, pose.origin
    return result


def compute_tcp_frames(setup: Setup, joints: FloatArray) -> FloatArray:
    """base_from_tcp (N, 4, 4) of joints (N, J) by textbook matrices."""
    tool = make_matrix(setup.flange_from_tool)
    return np.array([by_hand(setup.robot.name, np.degrees(q)) @ tool for q in joints])


def transform_to_base(setup: Setup, pose_path: PosePath) -> FloatArray:
    return np.asarray(
        pose_path.position @ setup.base_from_work.rotation.T
        + np.asarray(setup.base_from_work.origin)
    )


def make_end_pose(motion: EdgeMotion, k: int) -> PosePath:
    pose_path = motion.pose_path
    return PosePath(pose_path.position[[k]], np.full((1, 3), np.nan), pose_path.rotation[[k]])


def list_ends(motions: tuple[EdgeMotion, ...]) -> list[tuple[PosePath, FloatArray]]:
    """Pose and joint values at both ends of each motion."""
    ends = []
    for motion in motions:
        for k in (0, len(motion.pose_path) - 1):
            ends.append((make_end_pose(motion, k), motion.joints[k]))
    return ends


# -- retraction ------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_a_retraction_ends_above_the_safety_level_and_its_joints_follow_its_poses(
    part: str,
) -> None:
    setup, space, motions = load_cell(part)
    results = find_retractions(setup, space, list_ends(motions), SPEEDS)
    assert sum(isinstance(result, Retraction) for result in results) >= len(results) - 2
    for end, result in zip(list_ends(motions), results, strict=True):
        if isinstance(result, str):
            assert result
            continue
        frames = compute_tcp_frames(setup, result.joints)
        rotation = setup.base_from_work.rotation @ result.pose_path.rotation
        assert np.allclose(frames[:, :3, 3], transform_to_base(setup, result.pose_path), atol=1e-5)
        assert np.allclose(frames[:, :3, :3], rotation, atol=1e-7)
        assert np.allclose(result.joints[0], end[1], atol=1e-9)
        assert frames[-1, 2, 3] >= space.level - 1e-6
        assert np.abs(np.diff(result.sampled_joints, axis=0)).max() <= math.radians(15) + 1e-9
        assert (find_collisions(load_scene(part), result.sampled_joints) < 0).all()


@cache
def load_scene(part: str) -> Scene:
    solid, job = mesh.read(source(PARTS / f"{part}.stl")), load_job(PARTS / f"{part}.toml")
    return make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid).scene


def test_the_safety_level_is_half_the_holder_and_the_margin_above_the_part() -> None:
    solid, job = mesh.read(source(PARTS / "rfa1.stl")), load_job(PARTS / "rfa1.toml")
    cell_scene = make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid)
    top = 640.0 + 70.0  # the part is placed at 640 mm and is 70 mm high
    assert cell_scene.level == pytest.approx(top + math.hypot(70, 70) / 2 + 10.0)


def test_a_tilted_tool_retracts_along_its_axis() -> None:
    """The length of the retraction is the height divided by the cosine of the tilt (equation 1)."""
    setup, space, motions = load_cell("rfa1")
    retraction = next(
        result
        for result in find_retractions(setup, space, list_ends(motions), SPEEDS)
        if isinstance(result, Retraction)
        and result.name == "along the tool"
        and len(result.pose_path) == 2
    )
    start, stop = transform_to_base(setup, retraction.pose_path)
    back = -(setup.base_from_work.rotation @ retraction.pose_path.rotation[0])[:, 2]
    s = (space.level - start[2]) / back[2]
    assert s > 1
    assert np.allclose(stop - start, s * back, atol=1e-6)


def test_a_retraction_leads_over_the_wrist_if_the_last_two_links_are_below_the_level() -> None:
    """If a straight retraction collides, the TCP first moves to the wrist (second case)."""
    setup, space, motions = load_cell("rfa1")
    calls: list[int] = []

    def block_first_call(tracks: Sequence[SampledMotion]) -> list[Blockage | float]:
        calls.append(len(tracks))
        return [WALL if len(calls) == 1 else space.margin] * len(tracks)

    higher_space = replace(space, level=space.level + 600.0, look=block_first_call)
    chosen = list_ends(motions)
    over_wrist = [
        result
        for result in find_retractions(setup, higher_space, chosen, SPEEDS)
        if isinstance(result, Retraction) and "wrist" in result.name
    ]
    assert over_wrist
    for retraction in over_wrist:
        joints = retraction.joints[0]
        # The axes 4, 5 and 6 of an IRB 2400 meet in the wrist, 85 mm before the flange.
        flange = by_hand(ARM.name, np.degrees(joints))
        wrist = flange[:3, 3] - 85.0 * flange[:3, 2]
        assert np.allclose(transform_to_base(setup, retraction.pose_path)[1], wrist, atol=1e-6)
        assert abs(math.degrees(retraction.joints[1][4])) >= 2.0


def test_an_end_without_a_retraction_names_the_obstacle() -> None:
    setup, space, motions = load_cell("rfa1")
    block_links = replace(space, look=lambda tracks: [WALL] * len(tracks))
    (reason,) = find_retractions(setup, block_links, list_ends(motions)[:1], SPEEDS)
    assert isinstance(reason, str)
    assert "link 5 against wall" in reason


# -- links -----------------------------------------------------------------------------


def make_random_ends(n: int, seed: int) -> MotionEnds:
    rng = np.random.default_rng(seed)
    free = rng.uniform(2, 4, (2 * n, 2 * n))
    free = (free + free.T) / 2
    direct = np.where(
        rng.random((2 * n, 2 * n)) < 0.3, rng.uniform(0.1, 1, (2 * n, 2 * n)), math.inf
    )
    direct = np.minimum(direct, direct.T)
    motion = np.arange(2 * n) // 2
    direct[motion[:, None] == motion[None]] = math.inf
    return MotionEnds(
        np.zeros((2 * n, 6)),
        np.zeros((2 * n, 6)),
        rng.uniform(0.5, 2, 2 * n),
        free,
        direct,
        rng.uniform(1, 3, n),
        100.0,
    )


@pytest.mark.parametrize("seed", range(20))
def test_the_cheapest_link_is_that_of_a_plain_search(seed: int) -> None:
    """The plain search relaxes links at the part as Bellman and Ford do.

    Then it compares them with the free motions.
    """
    ends, n = make_random_ends(4, seed), 8
    home = np.random.default_rng(seed).uniform(1, 2, n)
    blocked = np.random.default_rng(seed + 99).random((n, n)) < 0.3
    blocked |= blocked.T
    best, first = choose_links(ends, find_links_at_part(ends), blocked, home)
    hop = ends.direct.copy()
    for k in range(n):
        hop[k, k ^ 1] = ends.through[k // 2]
    for a in range(n):
        reached = np.full(n, math.inf)
        reached[a] = 0.0
        for _ in range(n):
            reached = np.minimum(reached, (reached[:, None] + hop).min(axis=0))
        for b in range(n):
            if a == b:
                continue
            free = ends.free[a, b] if not blocked[a, b] else math.inf
            by_home = home[a] + home[b]
            rfa = min(free, by_home) + ends.out[a] + ends.out[b]
            assert best[a, b] == pytest.approx(min(reached[b], rfa))
            if rfa < reached[b] - 1e-9:
                assert first[a, b] == (FREE if free <= by_home else BY_HOME)


# -- route -----------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_every_motion_is_run_once_and_the_route_is_continuous(part: str) -> None:
    _, _, motions = load_cell(part)
    route = route_part(part)
    assert sorted(leg.motion.id for leg in route.legs) == sorted(motion.id for motion in motions)
    assert not route.dropped
    pieces: list[object] = []
    for leg in route.legs:
        pieces += [*leg.link, leg.motion]
    joints = ARM.home
    for piece in [*pieces, *route.back]:
        if isinstance(piece, JointLink):
            joints = piece.joints
            continue
        assert np.allclose(piece.joints[0], joints, atol=1e-9)
        joints = piece.joints[-1]
    assert np.array_equal(joints, ARM.home)


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_the_best_tour_takes_at_most_the_time_of_the_nearest_neighbour_tour(part: str) -> None:
    best, nearest = route_part(part), route_part(part, best=False)
    assert best.seconds <= best.nearest + 1e-9
    assert nearest.seconds <= nearest.nearest + 1e-9
    assert sorted(leg.motion.id for leg in best.legs) == sorted(
        leg.motion.id for leg in nearest.legs
    )


def test_edges_that_share_a_corner_are_linked_at_it() -> None:
    """The edges e1 and e3 meet, so the tool need not leave the part between them."""
    route = route_part("rfa1")
    assert [JointLink] in [list(map(type, leg.link)) for leg in route.legs]
    for before, leg in zip(route.legs, route.legs[1:], strict=False):
        if list(map(type, leg.link)) == [JointLink]:
            edges = {e.id: e for e in mesh.read(source(PARTS / "rfa1.stl")).edges}
            a, b = edges[before.motion.id], edges[leg.motion.id]
            between = a.points[[0, -1]][:, None] - b.points[[0, -1]]
            assert np.linalg.norm(between, axis=2).min() < 1e-3


def test_every_link_leaves_the_part_if_the_tool_presses_with_a_force() -> None:
    setup, space, motions = load_cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    route = find_route(
        RouteCell(setup, space, ARM.home),
        motions,
        edges,
        RouteOptions(SPEEDS, best=True, lifted=True),
    )
    assert len(route.legs) > 2
    for leg in route.legs[1:]:
        assert isinstance(leg.link[0], PathLink)
        assert leg.link[0].kind == "retraction"


def test_a_free_motion_that_collides_is_replaced_by_one_over_home() -> None:
    """All free motions between two ends are blocked, except those from home and to home."""
    setup, space, motions = load_cell("rfa2")
    at_part = {tuple(np.round(joints, 9)) for _, joints in list_ends(motions)}

    def block_links(tracks: Sequence[SampledMotion]) -> list[Blockage | float]:
        answers = space.look(tracks)
        for k, track in enumerate(tracks):
            start = tuple(np.round(track.joints[0], 9))
            over_home = any(np.allclose(row, ARM.home) for row in track.joints)
            is_blocked = len(track.joints) == 2 and not over_home and start not in at_part
            if is_blocked and not isinstance(answers[k], Blockage):
                answers[k] = WALL
        return answers

    edges = mesh.read(source(PARTS / "rfa2.stl")).edges
    route = find_route(
        RouteCell(setup, replace(space, look=block_links), ARM.home),
        motions,
        edges,
        RouteOptions(SPEEDS, best=True),
    )
    assert len(route.legs) == len(motions)
    assert route.seconds > route_part("rfa2").seconds
    for leg in route.legs[1:]:
        turns = [piece for piece in leg.link if isinstance(piece, JointLink)]
        if any(isinstance(p, PathLink) and p.kind == "retraction" for p in leg.link):
            assert any(np.allclose(turn.joints, ARM.home) for turn in turns)


def test_a_motion_without_a_link_is_left_out_and_no_link_is_tested_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All free motions to one motion are blocked, so this motion alone is left out.

    Links between the other motions are not tested again for the tour without it.
    """
    module, turned_tour = (
        importlib.import_module(f"camgen.order.edges.{name}") for name in ("route", "turned_tour")
    )
    monkeypatch.setattr(module, "find_detour", lambda *_: None)
    monkeypatch.setattr(module, "list_turns", list_no_turns)
    monkeypatch.setattr(turned_tour, "list_turns", list_no_turns)
    setup, space, motions = load_cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    unlinked = motions[1]
    retractions = find_retractions(setup, space, list_ends(motions), SPEEDS)
    safe = [result.joints[-1].tobytes() for result in retractions if isinstance(result, Retraction)]
    assert len(safe) == 2 * len(motions)
    # Two edges may start in one pose, so links from there may be tested twice.
    once = {row for row in safe if safe.count(row) == 1} | {ARM.home.tobytes()}
    places = {*safe, ARM.home.tobytes()}
    tested: list[bytes] = []

    def block_links(tracks: Sequence[SampledMotion]) -> list[Blockage | float]:
        answers: list[Blockage | float] = []
        for track in tracks:
            rows = [row.tobytes() for row in track.joints]
            if len(rows) == 2 and once.issuperset(rows):
                tested.append(b"".join(rows))
            is_free = len(rows) == 2 and places.issuperset(rows)
            is_blocked = is_free and not {*safe[2:4]}.isdisjoint(rows)
            answers.append(WALL if is_blocked else space.margin)
        return answers

    messages: list[str] = []
    options = RouteOptions(SPEEDS, best=True, lifted=True)
    blocked_cell = RouteCell(setup, replace(space, look=block_links), ARM.home)
    route = find_route(blocked_cell, motions, edges, options, messages.append)
    assert [edge.id for edge in route.dropped] == [unlinked.id]
    assert {leg.motion.id for leg in route.legs} == {motion.id for motion in motions} - {
        unlinked.id
    }
    assert len(tested) == len(set(tested))
    assert messages[0] == f"{len(motions)} edges, tour 1"
    assert messages[-1].startswith(f"{len(motions) - 1} edge")
    monkeypatch.setattr(module, "list_turns", list_turns)
    monkeypatch.setattr(turned_tour, "list_turns", list_turns)
    opened = find_route(blocked_cell, motions, edges, options)
    assert not opened.dropped
    (leg,) = [leg for leg in opened.legs if leg.motion.id == unlinked.id]
    assert np.abs(leg.motion.joints[0] - unlinked.joints[-leg.motion.backwards]).max() > math.pi


def test_a_search_without_a_free_link_ends_with_links_over_home() -> None:
    """Every free motion collides, except those from home and to home."""
    setup, space, motions = load_cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges

    def block_links(tracks: Sequence[SampledMotion]) -> list[Blockage | float]:
        answers: list[Blockage | float] = []
        for track in tracks:
            over_home = any(np.allclose(row, ARM.home) for row in track.joints)
            answers.append(space.margin if len(track.joints) != 2 or over_home else WALL)
        return answers

    messages: list[str] = []
    options = RouteOptions(SPEEDS, best=True, lifted=True)
    blocked_cell = RouteCell(setup, replace(space, look=block_links), ARM.home)
    route = find_route(blocked_cell, motions, edges, options, messages.append)
    assert not route.dropped
    assert len(route.legs) == len(motions)
    assert len(messages) <= 32
    for leg in route.legs[1:]:
        assert sum(isinstance(piece, JointLink) for piece in leg.link) == 2


def test_the_tip_may_enter_the_part_only_on_links_of_rims() -> None:
    """No motion passes the strict test, so only the motions along rims stay in the route."""
    setup, space, motions = load_cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    strict = replace(space, look=lambda tracks: [WALL] * len(tracks))
    pair = motions[:2]
    names = [motion.id for motion in pair]
    for count in (1, 2):
        cell_of_rims = RouteCell(setup, space, ARM.home, frozenset(names[:count]), strict)
        tour = find_route(cell_of_rims, pair, edges, RouteOptions(SPEEDS, best=True))
        assert sorted(leg.motion.id for leg in tour.legs) == sorted(names[:count])
        assert [edge.id for edge in tour.dropped] == names[count:]


def test_reach_reports_its_progress() -> None:
    setup, _, motions = load_cell("rfa1")
    known = {edge.id: edge for edge in mesh.read(source(PARTS / "rfa1.stl")).edges}
    reports: list[int] = []
    edges = [known[motion.id] for motion in motions[:2]]
    paths = [(edge, make_poses(edge, 2.0)) for edge in edges]
    reach_paths(paths, setup, on_progress=reports.append)
    assert reports == [0, 1]


def list_stays(tour: Route) -> set[frozenset[str]]:
    """Pairs of motions between which the tool does not leave the part."""
    pairs = set()
    for before, leg in pairwise(tour.legs):
        kinds = {piece.kind for piece in leg.link if isinstance(piece, PathLink)}
        if not kinds:
            pairs.add(frozenset((before.motion.id, leg.motion.id)))
    return pairs


def test_the_tool_leaves_the_part_between_barred_motions() -> None:
    setup, space, motions = load_cell("rfa2")
    edges = mesh.read(source(PARTS / "rfa2.stl")).edges
    stays = list_stays(route_part("rfa2"))
    assert stays
    options = RouteOptions(SPEEDS, best=True, barred=frozenset(stays))
    tour = find_route(RouteCell(setup, space, ARM.home), motions, edges, options)
    assert {leg.motion.id for leg in tour.legs} == {
        leg.motion.id for leg in route_part("rfa2").legs
    }
    assert not list_stays(tour) & stays
