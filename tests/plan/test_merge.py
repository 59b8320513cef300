"""Networks as trails: every line is run once, in as few trails as Euler's theorem allows.

Also tested: the pairing of their odd nodes is short.
"""

import itertools
import math
import random
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.pairing import pair_points
from camgen.model.job import InputTable, Job, OperationTable, ToolTable, TourTable
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.plan import plan
from camgen.plan.merge import merge
from camgen.plan.trace import with_few_lifts
from tests.support.examples import fewer

XY = tuple[float, float]


def make_chain(
    points: list[XY],
    closed: bool = False,
    layer: str = "0",
    name: str = "c1",
    bulges: object = None,
) -> Contour:
    return Contour(frozen(points), frozen(bulges or np.zeros(len(points))), closed, layer, name)


def count_segments(contours: tuple[Contour, ...]) -> Counter[frozenset[XY]]:
    """The straight segments, without their direction, and how often each is run."""
    segments: Counter[frozenset[XY]] = Counter()
    for contour in contours:
        points = [(round(x, 6), round(y, 6)) for x, y in contour.points.tolist()]
        segments.update(map(frozenset, itertools.pairwise(points + points[: int(contour.closed)])))
    return segments


def find_networks(edges: Counter[frozenset[XY]]) -> list[tuple[set[XY], int]]:
    """Nodes of each connected part of a graph of segments, and the number of its odd nodes."""
    degree: Counter[XY] = Counter()
    for edge, times in edges.items():
        degree.update(dict.fromkeys(edge, times))
    parts: list[set[XY]] = []
    for edge in edges:
        touching = [part for part in parts if part & edge]
        parts = [part for part in parts if not part & edge] + [set(edge).union(*touching)]
    odd = {node for node, times in degree.items() if times % 2}
    return [(part, len(part & odd)) for part in parts]


@st.composite
def draw_walks(draw: st.DrawFn) -> list[Contour]:
    """Walks over the points of a small grid that run along each side once; some are closed."""
    rng = random.Random(draw(st.integers(0, 10**6)))
    used: set[frozenset[XY]] = set()
    contours = []
    for k in range(draw(st.integers(1, 9))):
        at = (float(rng.randrange(6)), float(rng.randrange(6)))
        walk = [at]
        for _ in range(rng.randint(1, 9)):
            nodes = [
                (at[0] + dx, at[1] + dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1))
            ]
            nodes = [node for node in nodes if frozenset((at, node)) not in used]
            if not nodes:
                break
            node = nodes[0 if len(nodes) == 1 else rng.randrange(len(nodes))]
            used.add(frozenset((at, node)))
            at = node
            walk.append(at)
        if len(walk) > 1:
            closed = walk[0] == walk[-1] and len(walk) > 3
            contours.append(make_chain(walk[:-1] if closed else walk, closed, name=f"c{k}"))
    return contours


@given(draw_walks())
def test_every_line_is_run_once_in_as_few_trails_as_its_odd_nodes_allow(
    contours: list[Contour],
) -> None:
    trails, notes = merge(contours, [False] * len(contours), 0.05)
    edges = count_segments(tuple(contours))
    assert count_segments(trails) == edges
    least = 0
    for nodes, odd in find_networks(edges):
        members = [c for c in contours if tuple(c.points[0].tolist()) in nodes]
        least += 1 if len(members) == 1 else max(1, odd // 2)
    assert len(trails) == least
    if not notes:
        assert trails == tuple(contours)
    assert len({c.id for c in trails}) == len(trails)


def test_a_loop_and_a_tail_that_meet_within_the_tolerance_are_one_trail() -> None:
    ring = make_chain([(0, 0), (10, 0), (10, 10), (0, 10)], closed=True, name="c1")
    tail = make_chain([(10, 10.03), (20, 30)], name="c2")
    (trail,), (note,) = merge([ring, tail], [False, False], 0.05)
    assert not trail.closed
    assert sorted([trail.points[0].tolist(), trail.points[-1].tolist()]) == [[10, 10], [20, 30]]
    assert note.kind == "joined"
    assert "2 contours run as 1 path" in note.what
    assert merge([ring, tail], [False, False], 0.02) == ((ring, tail), ())
    assert merge([ring, tail], [True, False], 0.05) == ((ring, tail), ())


def test_an_arc_is_not_changed_if_its_end_is_drawn_near_a_node() -> None:
    ring = make_chain([(0, 0), (10, 0), (10, 10), (0, 10)], closed=True)
    arc = make_chain([(10, 10.03), (20, 10.03)], name="c2", bulges=[1.0, 0.0])
    (trail,), _ = merge([ring, arc], [False, False], 0.05)
    (k,) = np.flatnonzero(trail.bulges).tolist()
    assert abs(trail.bulges[k]) == 1.0
    assert sorted(trail.points[k : k + 2].tolist()) == [[10, 10.03], [20, 10.03]]
    # The length is that of the four sides, the half circle and the gap.
    steps = np.linalg.norm(np.diff(trail.points, axis=0), axis=1)
    steps[k] *= math.pi / 2
    assert steps.sum() == pytest.approx(40 + 5 * math.pi + 0.03)


def test_trails_go_straight_through_crossings() -> None:
    # Two lines cross at a vertex.
    across = make_chain([(-10, 0), (0, 0), (10, 0)], name="c1")
    up = make_chain([(0, -10), (0, 0), (0, 10)], name="c2")
    trails, _ = merge([across, up], [False, False], 0.05)
    assert sorted(len(c.points) for c in trails) == [3, 3]
    for trail in trails:
        assert trail.points[1].tolist() == [0, 0]
        assert abs(trail.points[0] + trail.points[2]).max() == 0


def test_contours_of_different_layers_are_not_merged() -> None:
    first, second = (
        make_chain([(0, 0), (5, 0), (9, 0)], layer="a"),
        make_chain([(5, 0), (5, 9)], layer="b"),
    )
    assert merge([first, second], [False, False], 0.05) == ((first, second), ())


def test_contours_are_merged_only_if_order_and_direction_do_not_matter() -> None:
    rings = [
        make_chain([(0, 0), (10, 0), (10, 10), (0, 10)], True),
        make_chain([(10, 10), (20, 10), (20, 20)], True, name="c2"),
    ]
    part = Part("p", "p.dxf", "mm", tuple(rings), ())
    trace = OperationTable(kind="trace")
    plans = {
        "trace": Job(operation=trace),
        "as drawn": Job(operation=trace, tour=TourTable(method="as-drawn")),
        "turning": Job(operation=trace, tool=ToolTable(orient="follow")),
        "beside": Job(
            operation=OperationTable(kind="follow"),
            tool=ToolTable(diameter=1.0),
            input=InputTable(join=0.0),
        ),
    }
    for name, job in plans.items():
        notes = [note for note in plan(part, job).notes if "networks" in note.what]
        assert len(notes) == (name == "trace"), name
    inner = make_chain([(2, 2), (4, 2), (4, 4)], True, name="c3")
    with_hole = Part("p", "p.dxf", "mm", (*rings, inner), ())
    # The outline with a hole in it is cut out alone, after the hole.
    assert with_few_lifts(with_hole, Job(operation=trace))[1] == ()
    any_order = Job(operation=OperationTable(kind="trace", inside_first=False))
    assert len(with_few_lifts(with_hole, any_order)[0].contours) == 2


def measure_total(points: np.ndarray, partner: list[int]) -> float:
    return sum(math.dist(points[a], points[b]) for a, b in enumerate(partner)) / 2


@fewer(10)
@given(st.integers(0, 10**6), st.integers(0, 4))
def test_few_points_are_paired_at_the_least_length(seed: int, pairs: int) -> None:
    points = np.random.default_rng(seed).uniform(0, 9, (2 * pairs, 2))
    least = math.inf
    for order in itertools.permutations(range(2 * pairs)):
        distances = np.linalg.norm(points[list(order[::2])] - points[list(order[1::2])], axis=1)
        least = min(least, distances.sum())
    partner = pair_points(points).tolist()
    assert [partner[b] for b in partner] == list(range(2 * pairs))
    assert measure_total(points, partner) == pytest.approx(least)


@pytest.mark.parametrize("spread", [0, 1, 100])
def test_many_points_are_paired_each_with_another(spread: int) -> None:
    points = np.random.default_rng(3).uniform(0, spread, (400, 2))
    partner = pair_points(points).tolist()
    assert [partner[b] for b in partner] == list(range(400))
    assert all(a != b for a, b in enumerate(partner))
    # For random points in a square the shortest pairing is 0.31 sqrt(n area) long, according to
    # Johnson and McGeoch. The limit is 0.33 sqrt(n area) and 15 %.
    assert measure_total(points, partner) <= 1.15 * 0.33 * math.sqrt(400) * spread + 1e-9
