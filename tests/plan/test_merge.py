"""Networks as trails: every line once, as few trails as Euler allows, and a short pairing of their odd ends."""

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


def chain(
    points: list[XY],
    closed: bool = False,
    layer: str = "0",
    name: str = "c1",
    bulges: object = None,
) -> Contour:
    return Contour(frozen(points), frozen(bulges or np.zeros(len(points))), closed, layer, name)


def lines(contours: tuple[Contour, ...]) -> Counter[frozenset[XY]]:
    """The straight segments, whichever way they run."""
    found: Counter[frozenset[XY]] = Counter()
    for contour in contours:
        points = [(round(x, 6), round(y, 6)) for x, y in contour.points.tolist()]
        found.update(
            frozenset(pair) for pair in itertools.pairwise(points + points[: int(contour.closed)])
        )
    return found


def network_of(edges: Counter[frozenset[XY]]) -> list[tuple[set[XY], int]]:
    """The connected parts of a graph of segments: their nodes, and how many of these are odd."""
    degree: Counter[XY] = Counter()
    for edge, times in edges.items():
        degree.update(dict.fromkeys(edge, times))
    parts: list[set[XY]] = []
    for edge in edges:
        touching = [part for part in parts if part & edge]
        parts = [part for part in parts if not part & edge] + [set(edge).union(*touching)]
    return [(part, sum(degree[node] % 2 for node in part)) for part in parts]


@st.composite
def drawing(draw: st.DrawFn) -> list[Contour]:
    """Walks over the points of a small grid that run along no side twice; some are loops."""
    rng = random.Random(draw(st.integers(0, 10**6)))
    used: set[frozenset[XY]] = set()
    contours = []
    for k in range(draw(st.integers(1, 9))):
        at = (float(rng.randrange(6)), float(rng.randrange(6)))
        walk = [at]
        for _ in range(rng.randint(1, 9)):
            ways = [
                (at[0] + dx, at[1] + dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1))
            ]
            ways = [way for way in ways if frozenset((at, way)) not in used]
            if not ways:
                break
            used.add(frozenset((at, ways[0 if len(ways) == 1 else rng.randrange(len(ways))])))
            at = next(way for way in ways if frozenset((at, way)) in used)
            walk.append(at)
        if len(walk) > 1:
            closed = walk[0] == walk[-1] and len(walk) > 3
            contours.append(chain(walk[:-1] if closed else walk, closed, name=f"c{k}"))
    return contours


@given(drawing())
def test_every_line_is_run_once_in_as_few_trails_as_its_odd_nodes_allow(
    contours: list[Contour],
) -> None:
    made, notes = merge(contours, [False] * len(contours), 0.05)
    edges = lines(tuple(contours))
    assert lines(made) == edges
    least = 0
    for nodes, odd in network_of(edges):
        own = [c for c in contours if tuple(c.points[0].tolist()) in nodes]
        least += len(own) if len(own) == 1 else max(1, odd // 2)
    assert len(made) == least
    if not notes:
        assert made == tuple(contours)
    assert len({c.id for c in made}) == len(made)


def test_a_letter_of_a_loop_and_a_tail_is_one_trail_and_the_ends_meet_within_the_tolerance() -> (
    None
):
    ring = chain([(0, 0), (10, 0), (10, 10), (0, 10)], closed=True, name="c1")
    tail = chain([(10, 10.03), (20, 30)], name="c2")
    (one,), (note,) = merge([ring, tail], [False, False], 0.05)
    assert not one.closed
    assert sorted([one.points[0].tolist(), one.points[-1].tolist()]) == [[10, 10], [20, 30]]
    assert note.kind == "joined"
    assert "2 contours run as 1 path" in note.what
    assert merge([ring, tail], [False, False], 0.02) == ((ring, tail), ())
    assert merge([ring, tail], [True, False], 0.05) == ((ring, tail), ())


def test_an_arc_stays_what_it_was_where_its_end_is_drawn_a_little_aside() -> None:
    ring = chain([(0, 0), (10, 0), (10, 10), (0, 10)], closed=True)
    arc = chain([(10, 10.03), (20, 10.03)], name="c2", bulges=[1.0, 0.0])
    (one,), _ = merge([ring, arc], [False, False], 0.05)
    bent = np.flatnonzero(one.bulges)
    (k,) = bent.tolist()
    assert abs(one.bulges[k]) == 1.0
    assert sorted(one.points[k : k + 2].tolist()) == [[10, 10.03], [20, 10.03]]
    # The length is that of the four sides, of half the circle, and of the gap.
    steps = np.linalg.norm(np.diff(one.points, axis=0), axis=1)
    steps[k] *= math.pi / 2
    assert steps.sum() == pytest.approx(40 + 5 * math.pi + 0.03)


def test_trails_go_straight_through_crossings() -> None:
    # Two lines that cross at a vertex, and a ring through the ends of one of them.
    across = chain([(-10, 0), (0, 0), (10, 0)], name="c1")
    up = chain([(0, -10), (0, 0), (0, 10)], name="c2")
    made, _ = merge([across, up], [False, False], 0.05)
    assert sorted(len(c.points) for c in made) == [3, 3]
    assert {
        c.points[1].tolist() == [0, 0] and abs(c.points[0] + c.points[2]).max() == 0 for c in made
    } == {True}


def test_layers_are_not_mixed() -> None:
    one, two = chain([(0, 0), (5, 0), (9, 0)], layer="a"), chain([(5, 0), (5, 9)], layer="b")
    assert merge([one, two], [False, False], 0.05) == ((one, two), ())


def test_only_where_order_and_direction_do_not_count() -> None:
    rings = [
        chain([(0, 0), (10, 0), (10, 10), (0, 10)], True),
        chain([(10, 10), (20, 10), (20, 20)], True, name="c2"),
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
    counts = {
        name: sum("networks" in note.what for note in plan(part, job).notes)
        for name, job in plans.items()
    }
    assert counts == {"trace": 1, "as drawn": 0, "turning": 0, "beside": 0}
    inner = chain([(2, 2), (4, 2), (4, 4)], True, name="c3")
    held = Part("p", "p.dxf", "mm", (*rings, inner), ())
    # The outline with a hole in it is cut out by itself after the hole.
    assert with_few_lifts(held, Job(operation=trace))[1] == ()
    assert (
        len(
            with_few_lifts(held, Job(operation=OperationTable(kind="trace", inside_first=False)))[
                0
            ].contours
        )
        == 2
    )


def total(points: np.ndarray, partner: list[int]) -> float:
    return sum(math.dist(points[a], points[b]) for a, b in enumerate(partner)) / 2


@fewer(10)
@given(st.integers(0, 10**6), st.integers(0, 4))
def test_few_points_are_paired_at_the_least_length(seed: int, pairs: int) -> None:
    points = np.random.default_rng(seed).uniform(0, 9, (2 * pairs, 2))
    least = math.inf
    for order in itertools.permutations(range(2 * pairs)):
        least = min(
            least,
            sum(
                math.dist(points[a], points[b])
                for a, b in zip(order[::2], order[1::2], strict=True)
            ),
        )
    partner = pair_points(points).tolist()
    assert [partner[b] for b in partner] == list(range(2 * pairs))
    assert total(points, partner) == pytest.approx(least)


@pytest.mark.parametrize("spread", [0, 1, 100])
def test_many_points_are_paired_each_with_another(spread: int) -> None:
    points = np.random.default_rng(3).uniform(0, spread, (400, 2))
    partner = pair_points(points).tolist()
    assert [partner[b] for b in partner] == list(range(400))
    assert all(a != b for a, b in enumerate(partner))
    # Random points in a square: the shortest pairing is 0.31 sqrt(n area) long (Johnson and McGeoch); 15 % above that.
    assert total(points, partner) <= 1.15 * 0.33 * math.sqrt(400) * spread + 1e-9
