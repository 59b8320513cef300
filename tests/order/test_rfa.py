"""Ways out, links and the route over the edges of a part: judged by forward kinematics and by hand."""

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
from camgen.plan.edges.poses import make_poses, reach
from camgen.plan.edges.select import select_edges
from camgen.read.job_file import load_job
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.workcell import equip_cell
from tests.support.arm_models import by_hand
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = find_robot("IRB 2400")
SPEEDS = LinkSpeeds(100.0, 100.0, 0.0)
WALL = Blockage("collision", "link 5 against wall", 0.0)


@cache
def cell(part: str) -> tuple[Setup, FreeSpace, tuple[EdgeMotion, ...]]:
    solid, job = mesh.read(source(PARTS / f"{part}.stl")), load_job(PARTS / f"{part}.toml")
    where = make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid)
    setup = make_setup(ARM, equip_cell(Rapid.cell(), job), where)
    chosen = select_edges(solid, [job.input.select])
    edges = [edge for edge in solid.edges if edge.id in chosen]
    found = reach(edges, setup, 2.0, "mean", OrientationFreedom(math.radians(15), roll=True))
    return (
        setup,
        make_free_space(where, setup),
        tuple(one for one in found if isinstance(one, EdgeMotion)),
    )


def no_turns(*_: object) -> IntArray:
    """No whole turns to choose from."""
    return np.zeros((1, 6), dtype=np.int64)


@cache
def routed(part: str, best: bool = True) -> Route:
    setup, room, motions = cell(part)
    edges = mesh.read(source(PARTS / f"{part}.stl")).edges
    return find_route(RouteCell(setup, room, ARM.home), motions, edges, RouteOptions(SPEEDS, best))


def matrix(pose: Pose) -> FloatArray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = pose.rotation, pose.origin
    return out


def tcp(setup: Setup, joints: FloatArray) -> FloatArray:
    """base_from_tcp (N, 4, 4) of joints (N, J) by textbook matrices."""
    tool = matrix(setup.flange_from_tool)
    return np.array([by_hand(setup.robot.name, np.degrees(q)) @ tool for q in joints])


def in_base(setup: Setup, way: PosePath) -> FloatArray:
    return np.asarray(
        way.position @ setup.base_from_work.rotation.T + np.asarray(setup.base_from_work.origin)
    )


def ends(motions: tuple[EdgeMotion, ...]) -> list[tuple[PosePath, FloatArray]]:
    bare = np.full((1, 3), np.nan)
    return [
        (PosePath(m.pose_path.position[[k]], bare, m.pose_path.rotation[[k]]), m.joints[k])
        for m in motions
        for k in (0, len(m.pose_path) - 1)
    ]


# -- retraction ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_a_way_out_ends_above_the_level_and_the_joints_follow_it(part: str) -> None:
    setup, room, motions = cell(part)
    found = find_retractions(setup, room, ends(motions), SPEEDS)
    ways = [one for one in found if isinstance(one, Retraction)]
    assert len(ways) >= len(found) - 2
    for end, one in zip(ends(motions), found, strict=True):
        if isinstance(one, str):
            assert one
            continue
        frames = tcp(setup, one.joints)
        assert np.allclose(frames[:, :3, 3], in_base(setup, one.pose_path), atol=1e-5)
        assert np.allclose(
            frames[:, :3, :3], setup.base_from_work.rotation @ one.pose_path.rotation, atol=1e-7
        )
        assert np.allclose(one.joints[0], end[1], atol=1e-9)
        assert frames[-1, 2, 3] >= room.level - 1e-6
        assert np.abs(np.diff(one.sampled_joints, axis=0)).max() <= math.radians(15) + 1e-9
        assert (find_collisions(scene_of(part), one.sampled_joints) < 0).all()


@cache
def scene_of(part: str) -> Scene:
    solid, job = mesh.read(source(PARTS / f"{part}.stl")), load_job(PARTS / f"{part}.toml")
    return make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid).scene


def test_the_level_is_half_the_holder_and_the_safety_above_the_part() -> None:
    solid, job = mesh.read(source(PARTS / "rfa1.stl")), load_job(PARTS / "rfa1.toml")
    where = make_cell_scene(job, equip_cell(Rapid.cell(), job, ARM), solid)
    top = 640.0 + 70.0  # the part stands at 640 mm and is 70 mm high
    assert where.level == pytest.approx(top + math.hypot(70, 70) / 2 + 10.0)


def test_a_tool_that_leans_goes_back_along_itself() -> None:
    """The length of the way is the height divided by the cosine of the lean (equation 1)."""
    setup, room, motions = cell("rfa1")
    one = next(
        way
        for way in find_retractions(setup, room, ends(motions), SPEEDS)
        if isinstance(way, Retraction) and way.name == "along the tool" and len(way.pose_path) == 2
    )
    start, stop = in_base(setup, one.pose_path)
    back = -(setup.base_from_work.rotation @ one.pose_path.rotation[0])[:, 2]
    s = (room.level - start[2]) / back[2]
    assert s > 1
    assert np.allclose(stop - start, s * back, atol=1e-6)


def test_with_the_last_two_links_below_the_level_the_tool_goes_over_the_wrist() -> None:
    """Where a way straight back collides, the first segment takes the TCP to where the wrist was (second case)."""
    setup, room, motions = cell("rfa1")
    calls: list[int] = []

    def only_third(several: Sequence[SampledMotion]) -> list[Blockage | float]:
        calls.append(len(several))
        return [WALL if len(calls) == 1 else room.margin] * len(several)

    deep = replace(room, level=room.level + 600.0, look=only_third)
    chosen = ends(motions)
    found = [
        one
        for one in find_retractions(setup, deep, chosen, SPEEDS)
        if isinstance(one, Retraction) and "wrist" in one.name
    ]
    assert found
    for one in found:
        joints = one.joints[0]
        # The wrist's place is where the axes 4, 5 and 6 meet: 85 mm behind the flange of an IRB 2400.
        flange = by_hand(ARM.name, np.degrees(joints))
        wrist = flange[:3, 3] - 85.0 * flange[:3, 2]
        assert np.allclose(in_base(setup, one.pose_path)[1], wrist, atol=1e-6)
        assert abs(math.degrees(one.joints[1][4])) >= 2.0


def test_an_end_without_a_way_says_what_stands_in_it() -> None:
    setup, room, motions = cell("rfa1")
    walled = replace(room, look=lambda several: [WALL] * len(several))
    (found,) = find_retractions(setup, walled, ends(motions)[:1], SPEEDS)
    assert isinstance(found, str)
    assert "link 5 against wall" in found


# -- links -----------------------------------------------------------------------------------------------------------


def table(n: int, seed: int) -> MotionEnds:
    rng = np.random.default_rng(seed)
    free = rng.uniform(2, 4, (2 * n, 2 * n))
    free = (free + free.T) / 2
    direct = np.where(
        rng.random((2 * n, 2 * n)) < 0.3, rng.uniform(0.1, 1, (2 * n, 2 * n)), math.inf
    )
    direct = np.minimum(direct, direct.T)
    own = np.arange(2 * n) // 2
    direct[own[:, None] == own[None]] = math.inf
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
    """Against Bellman and Ford's relaxation over the same moves, and the free motion beside them."""
    ends_, n = table(4, seed), 8
    home = np.random.default_rng(seed).uniform(1, 2, n)
    blocked = np.random.default_rng(seed + 99).random((n, n)) < 0.3
    blocked |= blocked.T
    best, first = choose_links(ends_, find_links_at_part(ends_), blocked, home)
    hop = ends_.direct.copy()
    for k in range(n):
        hop[k, k ^ 1] = ends_.through[k // 2]
    for a in range(n):
        reached = np.full(n, math.inf)
        reached[a] = 0.0
        for _ in range(n):
            reached = np.minimum(reached, (reached[:, None] + hop).min(axis=0))
        for b in range(n):
            if a == b:
                continue
            free = ends_.free[a, b] if not blocked[a, b] else math.inf
            by_home = home[a] + home[b]
            rfa = min(free, by_home) + ends_.out[a] + ends_.out[b]
            assert best[a, b] == pytest.approx(min(reached[b], rfa))
            if rfa < reached[b] - 1e-9:
                assert first[a, b] == (FREE if free <= by_home else BY_HOME)


# -- route -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_every_motion_is_run_once_and_each_piece_begins_where_the_last_one_ended(part: str) -> None:
    _, _, motions = cell(part)
    made = routed(part)
    assert sorted(leg.motion.id for leg in made.legs) == sorted(motion.id for motion in motions)
    assert not made.dropped
    here = ARM.home
    for piece in [p for leg in made.legs for p in (*leg.link, leg.motion)] + [*made.back]:
        if isinstance(piece, JointLink):
            here = piece.joints
            continue
        assert np.allclose(piece.joints[0], here, atol=1e-9)
        here = piece.joints[-1]
    assert np.array_equal(here, ARM.home)


@pytest.mark.parametrize("part", ["rfa1", "rfa2"])
def test_the_best_tour_is_no_slower_than_the_nearest_neighbours(part: str) -> None:
    best, nearest = routed(part), routed(part, best=False)
    assert best.seconds <= best.nearest + 1e-9
    assert nearest.seconds <= nearest.nearest + 1e-9
    assert sorted(leg.motion.id for leg in best.legs) == sorted(
        leg.motion.id for leg in nearest.legs
    )


def test_edges_that_share_a_corner_are_linked_at_it() -> None:
    """Between e1 and e3, which meet, the tool need not leave the part."""
    made = routed("rfa1")
    kinds = [tuple(type(piece) for piece in leg.link) for leg in made.legs]
    assert (JointLink,) in kinds
    for before, leg in zip(made.legs, made.legs[1:], strict=False):
        if [type(piece) for piece in leg.link] == [JointLink]:
            edges = {e.id: e for e in mesh.read(source(PARTS / "rfa1.stl")).edges}
            a, b = edges[before.motion.id], edges[leg.motion.id]
            assert (
                min(np.linalg.norm(p - q) for p in a.points[[0, -1]] for q in b.points[[0, -1]])
                < 1e-3
            )


def test_where_a_force_presses_every_link_leaves_the_part() -> None:
    setup, room, motions = cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    made = find_route(
        RouteCell(setup, room, ARM.home),
        motions,
        edges,
        RouteOptions(SPEEDS, best=True, lifted=True),
    )
    assert len(made.legs) > 2
    for leg in made.legs[1:]:
        assert isinstance(leg.link[0], PathLink)
        assert leg.link[0].kind == "retraction"


def test_a_free_motion_that_collides_is_not_taken() -> None:
    """All free motions between two ends are walled off: they go by way of home, or not at all."""
    setup, room, motions = cell("rfa2")
    free = {tuple(np.round(m.joints[k], 9)) for m in motions for k in (0, -1)}

    def walled(several: Sequence[SampledMotion]) -> list[Blockage | float]:
        said = room.look(several)
        every = [track.joints for track in several]
        pairs = [
            len(rows) == 2 and not any(np.allclose(row, ARM.home) for row in rows) for rows in every
        ]
        pairs = [
            two and tuple(np.round(rows[0], 9)) not in free
            for two, rows in zip(pairs, every, strict=True)
        ]
        return [
            WALL if two and not isinstance(hit, Blockage) else hit
            for hit, two in zip(said, pairs, strict=True)
        ]

    edges = mesh.read(source(PARTS / "rfa2.stl")).edges
    made = find_route(
        RouteCell(setup, replace(room, look=walled), ARM.home),
        motions,
        edges,
        RouteOptions(SPEEDS, best=True),
    )
    assert len(made.legs) == len(motions)
    assert made.seconds > routed("rfa2").seconds
    for leg in made.legs[1:]:
        turns = [piece for piece in leg.link if isinstance(piece, JointLink)]
        if any(isinstance(p, PathLink) and p.kind == "retraction" for p in leg.link):
            assert any(np.allclose(turn.joints, ARM.home) for turn in turns)


def test_what_no_way_leads_to_is_left_out_and_nothing_is_tested_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All free motions to one motion are walled off: it alone is left out, and what is known of the others is kept."""
    module, turned_tour = (
        importlib.import_module(f"camgen.order.edges.{name}") for name in ("route", "turned_tour")
    )
    monkeypatch.setattr(module, "find_detour", lambda *_: None)
    monkeypatch.setattr(module, "list_turns", no_turns)
    monkeypatch.setattr(turned_tour, "list_turns", no_turns)
    setup, room, motions = cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    lost = motions[1]
    outs = find_retractions(
        setup, room, [(_end(one, k), one.joints[k]) for one in motions for k in (0, -1)], SPEEDS
    )
    safe = [out.joints[-1].tobytes() for out in outs if isinstance(out, Retraction)]
    assert len(safe) == 2 * len(motions)
    once = {row for row in safe if safe.count(row) == 1} | {
        ARM.home.tobytes()
    }  # two edges may begin in one pose
    places = {*safe, ARM.home.tobytes()}
    asked: list[bytes] = []

    def walled(several: Sequence[SampledMotion]) -> list[Blockage | float]:
        rows = [[row.tobytes() for row in track.joints] for track in several]
        free = [len(two) == 2 and places.issuperset(two) for two in rows]
        asked.extend(b"".join(two) for two in rows if len(two) == 2 and once.issuperset(two))
        return [WALL if is_free and not {*safe[2:4]}.isdisjoint(two) else room.margin
                for two, is_free in zip(rows, free, strict=True)]  # fmt: skip

    told: list[str] = []
    options = RouteOptions(SPEEDS, best=True, lifted=True)
    made = find_route(
        RouteCell(setup, replace(room, look=walled), ARM.home), motions, edges, options, told.append
    )
    assert [one.id for one in made.dropped] == [lost.id]
    assert {leg.motion.id for leg in made.legs} == {one.id for one in motions} - {lost.id}
    assert len(asked) == len(set(asked))
    assert told[0] == f"{len(motions)} edges, tour 1"
    assert told[-1].startswith(f"{len(motions) - 1} edge")
    monkeypatch.setattr(module, "list_turns", list_turns)
    monkeypatch.setattr(turned_tour, "list_turns", list_turns)
    opened = find_route(
        RouteCell(setup, replace(room, look=walled), ARM.home), motions, edges, options
    )
    assert not opened.dropped
    (leg,) = [leg for leg in opened.legs if leg.motion.id == lost.id]
    assert np.abs(leg.motion.joints[0] - lost.joints[-leg.motion.backwards]).max() > math.pi


def _end(motion: EdgeMotion, k: int) -> PosePath:
    way = motion.pose_path
    return PosePath(way.position[[k]], np.full((1, 3), np.nan), way.rotation[[k]])


def test_a_search_that_finds_no_end_is_ended() -> None:
    """Every free motion collides but those home: after the last round all go by way of home."""
    setup, room, motions = cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges

    def walled(several: Sequence[SampledMotion]) -> list[Blockage | float]:
        home = (any(np.allclose(row, ARM.home) for row in track.joints) for track in several)
        return [
            room.margin if len(track.joints) != 2 or free else WALL
            for track, free in zip(several, home, strict=True)
        ]

    told: list[str] = []
    options = RouteOptions(SPEEDS, best=True, lifted=True)
    made = find_route(
        RouteCell(setup, replace(room, look=walled), ARM.home), motions, edges, options, told.append
    )
    assert not made.dropped
    assert len(made.legs) == len(motions)
    assert len(told) <= 32
    for leg in made.legs[1:]:
        assert sum(isinstance(piece, JointLink) for piece in leg.link) == 2


def test_the_tip_may_enter_the_part_on_links_of_rims_alone() -> None:
    """No motion passes the strict test: rims alone stay in the route."""
    setup, room, motions = cell("rfa1")
    edges = mesh.read(source(PARTS / "rfa1.stl")).edges
    strict = replace(room, look=lambda several: [WALL] * len(several))
    pair = motions[:2]
    names = [motion.id for motion in pair]
    for count in (1, 2):
        cell_of_rims = RouteCell(setup, room, ARM.home, frozenset(names[:count]), strict)
        tour = find_route(cell_of_rims, pair, edges, RouteOptions(SPEEDS, best=True))
        assert sorted(leg.motion.id for leg in tour.legs) == sorted(names[:count])
        assert [edge.id for edge in tour.dropped] == names[count:]


def test_reaching_tells_how_far_it_is() -> None:
    setup, _, motions = cell("rfa1")
    known = {edge.id: edge for edge in mesh.read(source(PARTS / "rfa1.stl")).edges}
    told: list[int] = []
    edges = [known[one.id] for one in motions[:2]]
    reach_paths([(edge, make_poses(edge, 2.0)) for edge in edges], setup, on_progress=told.append)
    assert told == [0, 1]


def list_stays(tour: Route) -> set[frozenset[str]]:
    """Pairs of motions between which the tool does not leave the part."""
    pairs = set()
    for before, leg in pairwise(tour.legs):
        kinds = {piece.kind for piece in leg.link if isinstance(piece, PathLink)}
        if not kinds:
            pairs.add(frozenset((before.motion.id, leg.motion.id)))
    return pairs


def test_between_barred_motions_the_tool_leaves_the_part() -> None:
    setup, room, motions = cell("rfa2")
    edges = mesh.read(source(PARTS / "rfa2.stl")).edges
    stays = list_stays(routed("rfa2"))
    assert stays
    options = RouteOptions(SPEEDS, best=True, barred=frozenset(stays))
    tour = find_route(RouteCell(setup, room, ARM.home), motions, edges, options)
    assert {leg.motion.id for leg in tour.legs} == {leg.motion.id for leg in routed("rfa2").legs}
    assert not list_stays(tour) & stays
