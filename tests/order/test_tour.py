import cmath
import importlib.util
import itertools
import math
import random
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.geometry.arcs import measure_path
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import frozen
from camgen.order import search, tree
from camgen.order.arrange import TourSettings, measure_travel, order_paths
from camgen.order.solver import speed
from camgen.order.solver.greedy import join_greedily
from camgen.order.solver.plane import make_discs
from camgen.order.starts import make_starts
from camgen.plan.starting import SEAM, move_start, reverse_each
from tests.support.examples import fewer

XY = tuple[float, float]


def make(points: list[XY], vias: list[XY | None], closed: bool, **fields: object) -> ToolPath:
    """A path with feed and force that differ by segment, and press to the left of the travel."""
    n = len(points)
    position, via = np.zeros((n, 3)), np.full((n, 3), np.nan)
    position[:, :2] = points
    press, feed = np.zeros((n, 2, 3)), np.arange(n, dtype=float) + 10
    for row in range(1, n):
        if vias[row - 1] is not None:
            via[row] = (*vias[row - 1], 0.0)
        for k, t in enumerate((0.0, 1.0)):
            dx, dy = tangent(points[row - 1], vias[row - 1], points[row], t)
            press[row, k, :2] = -dy, dx
    if n > 1:
        press[0], feed[0] = press[1], feed[1]
    path = ToolPath(
        "c1",
        "0",
        make_waypoints(position, via, feed, force_direction=press, force=feed / 2),
        closed,
    )
    return replace(path, **fields)


def circle_of(a: XY, m: XY, b: XY) -> tuple[complex, float, float]:
    """Centre, start angle and signed sweep of the arc a-m-b, by the circumcentre of complex numbers."""
    za, zm, zb = complex(*a), complex(*m), complex(*b)
    w = (zb - za) / (zm - za)
    centre = za + (zm - za) * (w - abs(w) ** 2) / (2j * w.imag)
    return centre, cmath.phase(za - centre), 2 * cmath.phase((zm - centre) / (za - centre))


def tangent(a: XY, m: XY | None, b: XY, t: float) -> XY:
    if m is None:
        d = complex(*b) - complex(*a)
    else:
        _, start, sweep = circle_of(a, m, b)
        d = 1j * math.copysign(1.0, sweep) * np.exp(1j * (start + t * sweep))
    return (d / abs(d)).real, (d / abs(d)).imag


def pieces(path: ToolPath) -> list[tuple[XY, XY | None, XY]]:
    xy = [(float(x), float(y)) for x, y, _ in path.position]
    via = [None if math.isnan(x) else (float(x), float(y)) for x, y, _ in path.via]
    return [(xy[i - 1], via[i], xy[i]) for i in range(1, len(xy))]


def point(piece: tuple[XY, XY | None, XY], t: float) -> complex:
    a, m, b = piece
    if m is None:
        return complex(*a) + t * (complex(*b) - complex(*a))
    centre, start, sweep = circle_of(a, m, b)
    return complex(centre + abs(complex(*a) - centre) * np.exp(1j * (start + t * sweep)))


def length(piece: tuple[XY, XY | None, XY]) -> float:
    a, m, b = piece
    if m is None:
        return abs(complex(*b) - complex(*a))
    centre, _, sweep = circle_of(a, m, b)
    return abs(complex(*a) - centre) * abs(sweep)


def along(path: ToolPath, distance: float) -> tuple[complex, int]:
    """The point at ``distance`` along the path and the row that ends its segment."""
    for row, piece in enumerate(pieces(path), start=1):
        if distance <= length(piece) or row == len(path.position) - 1:
            return point(piece, min(distance / length(piece), 1.0)), row
        distance -= length(piece)
    raise AssertionError


def circle(x: float, y: float, r: float, **fields: object) -> ToolPath:
    a, b = (x + r, y), (x - r, y)
    return make([a, b, a], [(x, y + r), (x, y - r)], True, **fields)


def slot(x: float, y: float) -> ToolPath:
    """30 x 8, corners at x..x+22, caps to both sides; counter-clockwise from the lower left."""
    ring = [(x, y), (x + 22, y), (x + 22, y + 8), (x, y + 8), (x, y)]
    return make(ring, [None, (x + 26, y + 4), None, (x - 4, y + 4)], True)


def line(*points: XY, **fields: object) -> ToolPath:
    return make(list(points), [None] * (len(points) - 1), False, **fields)


def ids(paths: list[ToolPath]) -> list[ToolPath]:
    return [replace(path, id=f"c{i}") for i, path in enumerate(paths)]


coordinate = st.integers(-40, 40).map(float)
spot = st.tuples(coordinate, coordinate)


@st.composite
def any_path(draw: st.DrawFn) -> ToolPath:
    x, y = draw(spot)
    kind = draw(st.sampled_from(["circle", "slot", "ring", "line", "one-way", "point"]))
    if kind == "circle":
        return circle(x, y, draw(st.sampled_from([0.5, 3.0, 11.0])))
    if kind == "slot":
        return slot(x, y)
    if kind == "point":
        return make([(x, y)], [], False)
    points = [(x, y), *draw(st.lists(spot, min_size=2, max_size=4, unique=True))]
    points = [p for i, p in enumerate(points) if i == 0 or p != points[i - 1]]
    if kind == "ring":
        points = points[:-1] if points[-1] == points[0] else points
        return make([*points, points[0]], [None] * len(points), True)
    return line(*points, reversible=kind == "line")


@st.composite
def scene(draw: st.DrawFn) -> list[ToolPath]:
    paths = draw(st.lists(any_path(), min_size=1, max_size=14))
    # A parent later in the list than its children: any forest can be written so.
    parents = [draw(st.integers(i + 1, len(paths)) | st.just(-1)) for i in range(len(paths))]
    return ids(
        [
            replace(p, parent=q if q < len(paths) else -1)
            for p, q in zip(paths, parents, strict=True)
        ]
    )


def choices(path: ToolPath) -> np.ndarray:
    """Points (complex) at which ``path`` may begin, closed ones sampled at most 1.3 mm apart."""
    if path.closed:
        return np.array(
            [point(piece, t) for piece in pieces(path) for t in np.linspace(0, 1, 90).tolist()]
        )
    ends = [complex(*path.position[0, :2]), complex(*path.position[-1, :2])]
    return np.array(ends if path.reversible else ends[:1])


def encloses(paths: list[ToolPath], outer: int, inner: int) -> bool:
    while inner >= 0:
        inner = paths[inner].parent
        if inner == outer:
            return True
    return False


def check_nearest_neighbour(paths: list[ToolPath], start: XY | None, inside_first: bool) -> None:
    tour = order_paths(paths, TourSettings("nearest", start, inside_first))
    assert sorted(p.id for p in tour.paths) == sorted(p.id for p in paths)
    assert tour.method == "nearest neighbour"
    left = list(range(len(paths)))
    starts = [choices(path) for path in paths]
    here = None if start is None else complex(*start)
    walked = 0.0
    for path in tour.paths:
        index = int(path.id[1:])
        allowed = [
            i for i in left if not inside_first or not any(encloses(paths, i, j) for j in left)
        ]
        assert index in allowed
        begin = complex(*path.position[0, :2])
        others = np.concatenate([starts[i] for i in allowed])
        if here is None:
            assert begin.real <= others.real.min() + SEAM
        else:
            assert abs(begin - here) <= np.abs(others - here).min() + SEAM
            walked += abs(begin - here)
        assert np.abs(starts[index] - begin).min() < 1.5
        if len(path.position) > len(paths[index].position):
            assert min(length(piece) for piece in (pieces(path)[0], pieces(path)[-1])) > SEAM - 1e-6
        assert measure_path(path) == pytest.approx(measure_path(paths[index]), abs=1e-6)
        here = complex(*path.position[-1, :2])
        left.remove(index)
    if start is not None:
        walked += abs(here - complex(*start))
    assert tour.travel == pytest.approx(walked, abs=1e-6)


@fewer(12)
@given(scene(), st.none() | spot, st.booleans())
def test_each_step_takes_the_nearest_of_the_allowed_starts(
    paths: list[ToolPath], start: XY | None, inside_first: bool
) -> None:
    check_nearest_neighbour(paths, start, inside_first)


@fewer(10)
@given(scene(), st.none() | spot, st.booleans(), st.integers(0, 5))
def test_the_search_keeps_every_path_and_rule_between_the_bound_and_nearest_neighbour(
    paths: list[ToolPath], start: XY | None, inside_first: bool, seed: int
) -> None:
    tour = order_paths(paths, TourSettings("best", start, inside_first, seed=seed))
    ran = [int(path.id[1:]) for path in tour.paths]
    assert sorted(ran) == list(range(len(paths)))
    for k, index in enumerate(ran):
        assert not inside_first or not any(encloses(paths, index, later) for later in ran[k + 1 :])
        begin, ends = complex(*tour.paths[k].position[0, :2]), choices(paths[index])
        assert np.abs(ends - begin).min() < (1.5 if paths[index].closed else 1e-9)
        assert measure_path(tour.paths[k]) == pytest.approx(measure_path(paths[index]), abs=1e-6)
    assert tour.travel == measure_travel(tour.paths, start)
    assert tour.bound is not None
    assert 0 <= tour.bound <= tour.travel + 1e-6
    nearest = order_paths(paths, TourSettings("nearest", start, inside_first))
    assert tour.travel <= nearest.travel
    assert nearest.bound is not None
    # No tour is below the bound, whatever tour it was worked out beside.
    assert nearest.bound <= tour.travel + 1e-6
    assert (
        order_paths(paths, TourSettings("as-drawn", start, inside_first)).bound
        <= tour.travel + 1e-6
    )


def test_the_search_finds_the_shortest_way_over_a_circle() -> None:
    # From home round a circle to a line: the best start of the circle is where a ray would be reflected, (5, -3).
    tour = order_paths(
        ids([circle(5, 0, 3), line((10, -8), (0, -9), reversible=False)]),
        TourSettings(
            "best",
            (0, -8),
            inside_first=False,
        ),
    )
    assert [p.id for p in tour.paths] == ["c0", "c1"]
    assert tour.paths[0].position[0, :2].tolist() == pytest.approx([5, -3], abs=0.02)
    assert tour.travel == pytest.approx(2 * math.hypot(5, 5) + 1, abs=1e-4)


@pytest.mark.parametrize("fast", [False, True])
def test_every_size_is_searched_without_being_asked(
    fast: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if fast and importlib.util.find_spec("numba") is None:
        pytest.skip("numba (extra fast) is not installed")
    monkeypatch.setattr(search, "available", lambda: fast)
    monkeypatch.setattr(speed, "available", lambda: fast)
    rng = random.Random(3)
    many = ids(
        [
            line((x, y), (x + 1, y))
            for x, y in ((rng.uniform(0, 900), rng.uniform(0, 900)) for _ in range(1300))
        ]
    )
    few = many[:300]
    searched = order_paths(few, TourSettings("best", None, False))
    assert searched.method == "local search"
    assert searched.travel < 0.86 * order_paths(few, TourSettings("nearest", None, False)).travel
    found, nearest = (
        order_paths(many, TourSettings("best", None, False)),
        order_paths(many, TourSettings("nearest", None, False)),
    )
    assert found.method == ("local search, compiled" if fast else "local search, plain Python")
    assert found.travel < (0.82 if fast else 0.86) * nearest.travel
    assert found.bound is not None
    assert 0.7 * found.travel < found.bound <= found.travel
    again = order_paths(many, TourSettings("best", None, False))
    assert [path.id for path in again.paths] == [path.id for path in found.paths]
    assert not found.timed


def test_a_crowd_is_shortened_at_all_paths_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "available", lambda: False)
    monkeypatch.setattr(speed, "available", lambda: False)
    # Beyond this number nothing else is searched. The outline waits for all others.
    count, rng = search._ALL_TOGETHER + 1, random.Random(7)
    many = [line((x, y), (x + rng.uniform(-9, 9), y + 3))
            for x, y in ((rng.uniform(0, 3000), rng.uniform(0, 3000)) for _ in range(count - 1))]  # fmt: skip
    inside = ids([replace(path, parent=count - 1) for path in many] + [circle(1500, 1500, 2200)])
    tour, nearest = (
        order_paths(inside, TourSettings("best", (0, 0), True)),
        order_paths(inside, TourSettings("nearest", (0, 0), True)),
    )
    assert sorted(path.id for path in tour.paths) == sorted(path.id for path in inside)
    assert tour.paths[-1].id == inside[-1].id
    assert tour.travel < 0.84 * nearest.travel  # greedy alone: 0.92


@pytest.mark.parametrize("seconds", [0.05, 0.4])
def test_seconds_are_those_of_a_clock(seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # A clock of the test's own: every look at it is a hundredth of a second later.
    ticks = itertools.count()
    monkeypatch.setattr("time.monotonic", lambda: next(ticks) / 100)
    monkeypatch.setattr(speed, "available", lambda: False)
    rng = random.Random(5)
    many = ids([circle(rng.uniform(0, 900), rng.uniform(0, 900), 5) for _ in range(200)])
    tour = order_paths(many, TourSettings("best", (0, 0), False, seconds=seconds))
    assert tour.timed
    assert tour.method == f"local search of {seconds:g} s"
    assert next(ticks) <= 100 * seconds + 3
    assert tour.travel < 0.9 * order_paths(many, TourSettings("nearest", (0, 0), False)).travel
    assert sorted(path.id for path in tour.paths) == sorted(path.id for path in many)


@given(st.integers(0, 10**6), st.integers(2, 80), st.booleans(), st.booleans())
def test_a_greedy_tour_runs_every_item_after_those_inside(
    seed: int, count: int, home: bool, rules: bool
) -> None:
    rng = random.Random(seed)

    def place() -> float:
        return rng.choice([rng.uniform(0, 90), float(rng.randrange(4))])  # grids and crowds as well

    paths = ids([rng.choice([circle(place(), place(), 2), line((place(), place()), (place(), 95.0))])
                 for _ in range(count)])  # fmt: skip
    parent = [rng.randrange(k + 1, count) if rules and k + 1 < count and rng.random() < 0.4 else -1
              for k in range(count)]  # fmt: skip
    rank = [int(rules and k > count / 2) for k in range(count)]
    parent = [p if p < 0 or rank[p] == rank[k] else -1 for k, p in enumerate(parent)]
    items = search.sample_paths(paths, make_starts(paths, "any"), parent, rank).items
    tour = join_greedily(items, make_discs(items), np.zeros(2) if home else None)
    assert tour is not None
    order = tour.order.tolist()
    assert sorted(order) == list(range(count))
    assert all(p < 0 or order.index(k) < order.index(p) for k, p in enumerate(parent))
    assert sorted(rank) == [rank[k] for k in order]
    assert all(items.first[k] <= tour.enter[k] < items.first[k + 1] for k in range(count))


def turned_circle(x: float, y: float, r: float, turn: float) -> ToolPath:
    ring = [
        (x + r * math.cos(turn + k * math.pi / 2), y + r * math.sin(turn + k * math.pi / 2))
        for k in range(4)
    ]
    return make([ring[0], ring[2], ring[0]], [ring[1], ring[3]], True)


CROWDS = {
    "lines": lambda x, y, rng: line((x, y), (x + rng.uniform(-2, 2), y + 0.5)),
    "circles": lambda x, y, rng: turned_circle(x, y, rng.uniform(1, 20), rng.uniform(0, 7)),
    "slots": lambda x, y, _rng: slot(x, y),
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", CROWDS)
def test_each_step_takes_the_nearest_start_in_a_crowd(kind: str, seed: int) -> None:
    rng = random.Random(seed)
    paths = [CROWDS[kind](rng.gauss(0, 300), rng.gauss(0, 300), rng) for _ in range(300)]
    check_nearest_neighbour(ids(paths), (0, 0), inside_first=False)


def test_reverses_and_starts_between_vertices() -> None:
    far = line((100, 0), (20, 10))
    square = make([(0, 5), (10, 5), (10, 15), (0, 15), (0, 5)], [None] * 4, True)
    tour = order_paths(
        ids([far, square, circle(50, -30, 10)]), TourSettings("nearest", (4, 0), inside_first=True)
    )
    assert [p.id for p in tour.paths] == ["c1", "c0", "c2"]
    # The square begins right above the start, the line at its end, the circle towards where the line leaves the tool.
    assert tour.paths[0].position[:, :2].tolist() == [
        [4, 5],
        [10, 5],
        [10, 15],
        [0, 15],
        [0, 5],
        [4, 5],
    ]
    assert tour.paths[1].position[:, :2].tolist() == [[20, 10], [100, 0]]
    reach = math.hypot(50, 30)
    x, y = 50 + 10 * 50 / reach, -30 + 10 * 30 / reach
    assert tour.paths[2].position[0].tolist() == pytest.approx([x, y, 0])
    legs = 5 + math.hypot(16, 5) + reach - 10 + math.hypot(x - 4, y)
    assert tour.travel == pytest.approx(legs)
    assert measure_travel(tour.paths, None) == pytest.approx(math.hypot(16, 5) + reach - 10)


def test_a_one_way_path_is_entered_at_its_start() -> None:
    tour = order_paths(
        [line((50, 0), (1, 0), reversible=False)],
        TourSettings("nearest", (0, 0), inside_first=False),
    )
    assert tour.paths[0].position[0].tolist() == [50, 0, 0]
    assert tour.travel == pytest.approx(51)


def test_without_a_start_the_leftmost_comes_first() -> None:
    tour = order_paths(
        ids([line((0, 0), (5, 0)), circle(6, 40, 10), line((9, 9), (-3, 9))]),
        TourSettings(
            "nearest",
            None,
            False,
        ),
    )
    assert [p.id for p in tour.paths] == ["c1", "c2", "c0"]
    assert tour.paths[0].position[0].tolist() == pytest.approx([-4, 40, 0])
    twins = ids([line((0, 0), (1, 0)), line((0, 0), (1, 0))])
    assert [p.id for p in order_paths(twins, TourSettings("nearest", None, False)).paths] == [
        "c0",
        "c1",
    ]


def test_holes_come_before_the_outline_around_them() -> None:
    island, hole, outline = circle(0, 0, 2, parent=1), circle(0, 0, 5, parent=2), circle(0, 0, 9)
    paths = ids([island, hole, outline])
    assert [
        p.id for p in order_paths(paths, TourSettings("nearest", (20, 0), inside_first=False)).paths
    ] == [
        "c2",
        "c1",
        "c0",
    ]
    assert [
        p.id for p in order_paths(paths, TourSettings("nearest", (20, 0), inside_first=True)).paths
    ] == [
        "c0",
        "c1",
        "c2",
    ]


def test_as_drawn_changes_nothing() -> None:
    paths = ids([circle(0, 0, 9), circle(0, 0, 2, parent=0), line((9, 9), (20, 9))])
    tour = order_paths(paths, TourSettings("as-drawn", (0, 0), inside_first=True))
    assert list(tour.paths) == paths
    assert tour.method == "as drawn"
    assert tour.travel == pytest.approx(9 + 7 + math.hypot(7, 9) + math.hypot(20, 9))


def test_nothing_to_order() -> None:
    for method in ("nearest", "as-drawn"):
        tour = order_paths([], TourSettings(method, (1, 1), inside_first=True))
        assert (tour.paths, tour.travel) == ((), 0.0)


def test_refuses_what_it_cannot_order() -> None:
    with pytest.raises(ValueError, match="unknown method"):
        order_paths([circle(0, 0, 1)], TourSettings("shortest", None, inside_first=False))
    ring = [circle(0, 0, 1, parent=1), circle(0, 0, 2, parent=0), circle(9, 0, 1)]
    for paths in (ring, ring[:2]):
        for start in (None, (0.0, 0.0)):
            with pytest.raises(ValueError, match="enclose each other"):
                order_paths(paths, TourSettings("nearest", start, inside_first=True))


@fewer(12)
@given(any_path().filter(lambda p: p.closed), st.data())
def test_a_moved_start_keeps_the_path(path: ToolPath, data: st.DataObject) -> None:
    segment = data.draw(st.integers(1, len(path.position) - 1))
    fraction = data.draw(st.floats(0, 1))
    moved = move_start(path, segment, fraction)
    total = sum(length(piece) for piece in pieces(path))
    begun = sum(length(piece) for piece in pieces(path)[: segment - 1])
    begun += fraction * length(pieces(path)[segment - 1])
    assert measure_path(moved) == pytest.approx(total)
    assert moved.position[0].tolist() == moved.position[-1].tolist()
    assert min(length(piece) for piece in pieces(moved)) > 0.9e-6
    assert len(moved.position) - len(path.position) in (0, 1)
    for distance in np.linspace(0.011, 0.993, 25) * total:
        was, row = along(path, (begun + distance) % total)
        now, new_row = along(moved, distance)
        assert abs(now - was) < 3e-6
        edge = sum(length(piece) for piece in pieces(path)[:row])
        if abs((begun + distance) % total - edge) > 1e-5:
            assert moved.feed[new_row] == path.feed[row]
            assert moved.force[new_row] == path.force[row]
    assert moved.force_direction[0].tolist() == moved.force_direction[1].tolist()
    assert (moved.feed[0], moved.force[0]) == (moved.feed[1], moved.force[1])
    assert np.isnan(moved.via[0]).all()
    for row, piece in enumerate(pieces(moved), start=1):
        for k, t in enumerate((0.0, 1.0)):
            dx, dy = tangent(*piece, t)
            assert moved.force_direction[row, k] == pytest.approx(
                [-dy, dx, 0], abs=1e-5 if length(piece) < 0.01 else 1e-7
            )
        if piece[1] is not None:  # the via point stays in the middle
            assert abs(complex(*piece[1]) - complex(*piece[0])) == pytest.approx(
                abs(complex(*piece[1]) - complex(*piece[2])), abs=1e-7
            )
    for column in (
        moved.position,
        moved.via,
        moved.axis,
        moved.force_direction,
        moved.force,
        moved.feed,
    ):
        assert not column.flags.writeable
        assert len(column) == len(moved.position)


def test_a_circle_split_at_an_eighth() -> None:
    r = math.sqrt(0.5)
    moved = move_start(circle(0, 0, 1), 1, 0.25)
    assert moved.position[:, :2] == pytest.approx(np.array([[r, r], [-1, 0], [1, 0], [r, r]]))
    vias = [[math.cos(a), math.sin(a)] for a in (math.pi * 5 / 8, math.pi * 3 / 2, math.pi / 8)]
    assert moved.via[1:, :2] == pytest.approx(np.array(vias))
    # The tool runs round a pin: press is to the left, towards the centre.
    assert moved.force_direction[1] == pytest.approx(np.array([[-r, -r, 0], [1, 0, 0]]))
    assert moved.force_direction[3] == pytest.approx(np.array([[-1, 0, 0], [-r, -r, 0]]))
    assert moved.feed.tolist() == [11, 11, 12, 11]


def test_an_arc_out_of_the_plane_is_split_on_its_circle() -> None:
    # A half circle of radius 5 that stands upright over the x axis, and the line back; the tool leans with it.
    position = frozen([[5, 0, 0], [-5, 0, 0], [5, 0, 0]])
    via = frozen([[math.nan] * 3, [0, 0, 5], [math.nan] * 3])
    axis = frozen([[-1, 0, 0], [0, 0, -1], [-1, 0, 0]])
    press = frozen([[[-1, 0, 0], [1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], [[0, 0, 1], [0, 0, 1]]])
    path = ToolPath("c1", "0", make_waypoints(position, via, 1.0, axis, press), closed=True)
    moved = move_start(path, 1, 1 / 3)
    c, s = math.cos(math.pi / 3), math.sin(math.pi / 3)
    assert moved.position[0] == pytest.approx([5 * c, 0, 5 * s])
    assert moved.via[1] == pytest.approx([5 * math.cos(math.pi * 2 / 3), 0, 5 * s])
    assert moved.via[3] == pytest.approx([5 * math.cos(math.pi / 6), 0, 5 * math.sin(math.pi / 6)])
    assert moved.force_direction[1, 0] == pytest.approx([-c, 0, -s])
    # A third of the quarter turn from -x to -z.
    assert moved.axis[0] == pytest.approx([-math.cos(math.pi / 6), 0, -math.sin(math.pi / 6)])
    assert moved.axis[3] == pytest.approx(moved.axis[0])


@pytest.mark.parametrize(("segment", "fraction", "first"), [
    (1, 0.0, 0), (1, 1.0, 1), (2, 0.0, 1), (4, 1.0, 0), (3, 0.9e-6 / 22, 2), (3, 1 - 0.9e-6 / 22, 3),
])  # fmt: skip
def test_a_start_at_a_vertex_makes_no_new_one(segment: int, fraction: float, first: int) -> None:
    path = slot(0, 0)
    moved = move_start(path, segment, fraction)
    corners = path.position[:4].tolist()
    assert moved.position.tolist() == [*corners[first:], *corners[:first], corners[first]]


def test_a_start_that_is_not_on_the_path_is_refused() -> None:
    for path, segment, fraction in [
        (line((0, 0), (1, 0)), 1, 0.5), (slot(0, 0), 0, 0.5), (slot(0, 0), 5, 0.5), (slot(0, 0), 1, 1.01),
        (slot(0, 0), 1, math.nan),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=r"open path|has segments|fraction"):
            move_start(path, segment, fraction)


@given(st.lists(any_path(), max_size=5))
def test_many_are_reversed_as_one_is(paths: list[ToolPath]) -> None:
    for path, back in zip(paths, reverse_each(paths), strict=True):
        alone = path.reversed()
        for name in ("position", "via", "axis", "force_direction", "force", "feed"):
            assert np.array_equal(getattr(back, name), getattr(alone, name), equal_nan=True)


def test_thousands_at_one_point_are_no_quadratic_work(monkeypatch: pytest.MonkeyPatch) -> None:
    looked, scan = [0], tree._scan

    def counted(
        pot: list[tree.Line | tree.Arc], x: float, y: float, best: float, choice: int
    ) -> tuple[float, int]:
        looked[0] += len(pot)
        return scan(pot, x, y, best, choice)

    monkeypatch.setattr(tree, "_scan", counted)
    count = 5_000
    fan = [line((0, 0), (math.cos(i), math.sin(i))) for i in range(count)]
    assert len(order_paths(fan, TourSettings("nearest", (0, 0), inside_first=False)).paths) == count
    assert count <= looked[0] < 40 * count  # quadratic, it would be 2,500 times as many


def test_no_heavy_import() -> None:
    code = "import camgen.order, sys; print('scipy' in sys.modules, 'shapely' in sys.modules)"
    assert subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout == ("False False\n")
