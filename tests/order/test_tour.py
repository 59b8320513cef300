"""Tours in the plane: nearest neighbour, the search and its rules, and moved starts of paths."""

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
from camgen.model.job import TourTable
from camgen.model.path import ToolPath, make_waypoints
from camgen.model.pose import frozen
from camgen.order import search, tree
from camgen.order.arrange import measure_travel, order_paths
from camgen.order.solver import speed
from camgen.order.solver.greedy import join_greedily
from camgen.order.solver.plane import make_discs
from camgen.order.starts import make_starts
from camgen.plan.starting import SEAM, move_start, reverse_each
from tests.support.examples import fewer

XY = tuple[float, float]
#: Columns of a tool path.
COLUMNS = ("position", "via", "axis", "force_direction", "force", "feed")


def make_path(points: list[XY], vias: list[XY | None], closed: bool, **fields: object) -> ToolPath:
    """A path whose feed and force differ by segment, with a force to the left of the travel."""
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
    waypoints = make_waypoints(position, via, feed, force_direction=press, force=feed / 2)
    return replace(ToolPath("c1", "0", waypoints, closed), **fields)


def find_circle(a: XY, m: XY, b: XY) -> tuple[complex, float, float]:
    """Centre, start angle and signed sweep of the arc a-m-b, from the circumcentre."""
    za, zm, zb = complex(*a), complex(*m), complex(*b)
    w = (zb - za) / (zm - za)
    centre = za + (zm - za) * (w - abs(w) ** 2) / (2j * w.imag)
    return centre, cmath.phase(za - centre), 2 * cmath.phase((zm - centre) / (za - centre))


def tangent(a: XY, m: XY | None, b: XY, t: float) -> XY:
    if m is None:
        d = complex(*b) - complex(*a)
    else:
        _, start, sweep = find_circle(a, m, b)
        d = 1j * math.copysign(1.0, sweep) * np.exp(1j * (start + t * sweep))
    return (d / abs(d)).real, (d / abs(d)).imag


def list_pieces(path: ToolPath) -> list[tuple[XY, XY | None, XY]]:
    xy = [(float(x), float(y)) for x, y, _ in path.position]
    via = [None if math.isnan(x) else (float(x), float(y)) for x, y, _ in path.via]
    return [(xy[i - 1], via[i], xy[i]) for i in range(1, len(xy))]


def find_point(piece: tuple[XY, XY | None, XY], t: float) -> complex:
    a, m, b = piece
    if m is None:
        return complex(*a) + t * (complex(*b) - complex(*a))
    centre, start, sweep = find_circle(a, m, b)
    return complex(centre + abs(complex(*a) - centre) * np.exp(1j * (start + t * sweep)))


def measure_length(piece: tuple[XY, XY | None, XY]) -> float:
    a, m, b = piece
    if m is None:
        return abs(complex(*b) - complex(*a))
    centre, _, sweep = find_circle(a, m, b)
    return abs(complex(*a) - centre) * abs(sweep)


def find_point_along(path: ToolPath, distance: float) -> tuple[complex, int]:
    """Point at `distance` mm along the path, and the row at which its segment ends."""
    for row, piece in enumerate(list_pieces(path), start=1):
        if distance <= measure_length(piece) or row == len(path.position) - 1:
            return find_point(piece, min(distance / measure_length(piece), 1.0)), row
        distance -= measure_length(piece)
    raise AssertionError


def circle(x: float, y: float, r: float, **fields: object) -> ToolPath:
    a, b = (x + r, y), (x - r, y)
    return make_path([a, b, a], [(x, y + r), (x, y - r)], True, **fields)


def slot(x: float, y: float) -> ToolPath:
    """A slot of 30 x 8 mm, run counter-clockwise from its lower left corner (x, y).

    Its straight sides are 22 mm long.
    """
    ring = [(x, y), (x + 22, y), (x + 22, y + 8), (x, y + 8), (x, y)]
    return make_path(ring, [None, (x + 26, y + 4), None, (x - 4, y + 4)], True)


def line(*points: XY, **fields: object) -> ToolPath:
    return make_path(list(points), [None] * (len(points) - 1), False, **fields)


def number_paths(paths: list[ToolPath]) -> list[ToolPath]:
    return [replace(path, id=f"c{i}") for i, path in enumerate(paths)]


coordinate = st.integers(-40, 40).map(float)
spot = st.tuples(coordinate, coordinate)


@st.composite
def draw_path(draw: st.DrawFn) -> ToolPath:
    x, y = draw(spot)
    kind = draw(st.sampled_from(["circle", "slot", "ring", "line", "one-way", "point"]))
    if kind == "circle":
        return circle(x, y, draw(st.sampled_from([0.5, 3.0, 11.0])))
    if kind == "slot":
        return slot(x, y)
    if kind == "point":
        return make_path([(x, y)], [], False)
    points = [(x, y), *draw(st.lists(spot, min_size=2, max_size=4, unique=True))]
    points = [p for i, p in enumerate(points) if i == 0 or p != points[i - 1]]
    if kind == "ring":
        points = points[:-1] if points[-1] == points[0] else points
        return make_path([*points, points[0]], [None] * len(points), True)
    return line(*points, reversible=kind == "line")


@st.composite
def draw_paths(draw: st.DrawFn) -> list[ToolPath]:
    paths = draw(st.lists(draw_path(), min_size=1, max_size=14))
    # Parents come later in the list than their children. Any forest can be listed in this way.
    for i, path in enumerate(paths):
        parent = draw(st.integers(i + 1, len(paths)) | st.just(-1))
        paths[i] = replace(path, parent=parent if parent < len(paths) else -1)
    return number_paths(paths)


def list_starts(path: ToolPath) -> np.ndarray:
    """Points at which `path` may start, as complex numbers.

    On closed paths they are at most 1.3 mm apart.
    """
    if path.closed:
        starts: list[complex] = []
        for piece in list_pieces(path):
            starts += [find_point(piece, t) for t in np.linspace(0, 1, 90).tolist()]
        return np.array(starts)
    ends = [complex(*path.position[0, :2]), complex(*path.position[-1, :2])]
    return np.array(ends if path.reversible else ends[:1])


def is_inside(paths: list[ToolPath], outer: int, inner: int) -> bool:
    while inner >= 0:
        inner = paths[inner].parent
        if inner == outer:
            return True
    return False


def contains_any(paths: list[ToolPath], outer: int, items: list[int]) -> bool:
    return any(is_inside(paths, outer, inner) for inner in items)


def check_nearest_neighbour(paths: list[ToolPath], start: XY | None, inside_first: bool) -> None:
    tour = order_paths(paths, TourTable("nearest"), start, inside_first)
    assert sorted(p.id for p in tour.paths) == sorted(p.id for p in paths)
    assert tour.method == "nearest neighbour"
    left = list(range(len(paths)))
    starts = [list_starts(path) for path in paths]
    position = None if start is None else complex(*start)
    travel = 0.0
    for path in tour.paths:
        index = int(path.id[1:])
        inner = left if inside_first else []
        allowed = [i for i in left if not contains_any(paths, i, inner)]
        assert index in allowed
        begin = complex(*path.position[0, :2])
        others = np.concatenate([starts[i] for i in allowed])
        if position is None:
            assert begin.real <= others.real.min() + SEAM
        else:
            assert abs(begin - position) <= np.abs(others - position).min() + SEAM
            travel += abs(begin - position)
        assert np.abs(starts[index] - begin).min() < 1.5
        if len(path.position) > len(paths[index].position):
            assert (
                min(
                    measure_length(piece) for piece in (list_pieces(path)[0], list_pieces(path)[-1])
                )
                > SEAM - 1e-6
            )
        assert measure_path(path) == pytest.approx(measure_path(paths[index]), abs=1e-6)
        position = complex(*path.position[-1, :2])
        left.remove(index)
    if start is not None:
        travel += abs(position - complex(*start))
    assert tour.travel == pytest.approx(travel, abs=1e-6)


@fewer(12)
@given(draw_paths(), st.none() | spot, st.booleans())
def test_the_nearest_tour_takes_the_nearest_allowed_start_at_each_step(
    paths: list[ToolPath], start: XY | None, inside_first: bool
) -> None:
    check_nearest_neighbour(paths, start, inside_first)


@fewer(10)
@given(draw_paths(), st.none() | spot, st.booleans(), st.integers(0, 5))
def test_the_search_keeps_all_paths_and_rules_and_is_between_bound_and_nearest_neighbour(
    paths: list[ToolPath], start: XY | None, inside_first: bool, seed: int
) -> None:
    tour = order_paths(paths, TourTable("best", seed=seed), start, inside_first)
    order = [int(path.id[1:]) for path in tour.paths]
    assert sorted(order) == list(range(len(paths)))
    for k, index in enumerate(order):
        later = order[k + 1 :] if inside_first else []
        assert not contains_any(paths, index, later)
        begin, ends = complex(*tour.paths[k].position[0, :2]), list_starts(paths[index])
        assert np.abs(ends - begin).min() < (1.5 if paths[index].closed else 1e-9)
        assert measure_path(tour.paths[k]) == pytest.approx(measure_path(paths[index]), abs=1e-6)
    assert tour.travel == measure_travel(tour.paths, start)
    assert tour.bound is not None
    assert 0 <= tour.bound <= tour.travel + 1e-6
    nearest = order_paths(paths, TourTable("nearest"), start, inside_first)
    assert tour.travel <= nearest.travel
    assert nearest.bound is not None
    # No tour is shorter than the lower bound, by whichever method the bound was computed.
    assert nearest.bound <= tour.travel + 1e-6
    as_drawn = order_paths(paths, TourTable("as-drawn"), start, inside_first)
    assert as_drawn.bound <= tour.travel + 1e-6


def test_the_search_finds_the_shortest_tour_over_a_circle() -> None:
    # The tour leads from home over a circle to a line.
    # The best start of the circle is the point that would reflect a ray from home to the line.
    paths = number_paths([circle(5, 0, 3), line((10, -8), (0, -9), reversible=False)])
    tour = order_paths(paths, TourTable("best"), (0, -8), False)
    assert [p.id for p in tour.paths] == ["c0", "c1"]
    assert tour.paths[0].position[0, :2].tolist() == pytest.approx([5, -3], abs=0.02)
    assert tour.travel == pytest.approx(2 * math.hypot(5, 5) + 1, abs=1e-4)


@pytest.mark.parametrize("fast", [False, True])
def test_tours_of_every_size_are_searched(fast: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if fast and importlib.util.find_spec("numba") is None:
        pytest.skip("numba (extra fast) is not installed")
    monkeypatch.setattr(search, "available", lambda: fast)
    monkeypatch.setattr(speed, "available", lambda: fast)
    rng = random.Random(3)
    starts = [(rng.uniform(0, 900), rng.uniform(0, 900)) for _ in range(1300)]
    lines = number_paths([line((x, y), (x + 1, y)) for x, y in starts])
    first_lines = lines[:300]
    searched = order_paths(first_lines, TourTable("best"), None, False)
    assert searched.method == "local search"
    assert (
        searched.travel < 0.86 * order_paths(first_lines, TourTable("nearest"), None, False).travel
    )
    nearest = order_paths(lines, TourTable("nearest"), None, False)
    best = order_paths(lines, TourTable("best"), None, False)
    assert best.method == ("local search, compiled" if fast else "local search, plain Python")
    assert best.travel < (0.82 if fast else 0.86) * nearest.travel
    assert best.bound is not None
    assert 0.7 * best.travel < best.bound <= best.travel
    again = order_paths(lines, TourTable("best"), None, False)
    assert [path.id for path in again.paths] == [path.id for path in best.paths]
    assert not best.timed


def test_a_tour_of_very_many_paths_is_shortened_at_all_paths_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(search, "available", lambda: False)
    monkeypatch.setattr(speed, "available", lambda: False)
    # A tour of more paths than this is searched in no other way, and no bound is computed.
    monkeypatch.setattr(search, "_ALL_TOGETHER", search._CROWD + 1)
    monkeypatch.setattr(search, "_MANY_FOR_BOUND", search._CROWD + 1)
    # The outline comes after all other paths.
    count, rng = search._ALL_TOGETHER + 1, random.Random(7)
    inside = []
    for _ in range(count - 1):
        x, y = rng.uniform(0, 3000), rng.uniform(0, 3000)
        inside.append(line((x, y), (x + rng.uniform(-9, 9), y + 3), parent=count - 1))
    inside = number_paths([*inside, circle(1500, 1500, 2200)])
    tour = order_paths(inside, TourTable("best"), (0, 0), True)
    nearest = order_paths(inside, TourTable("nearest"), (0, 0), True)
    assert sorted(path.id for path in tour.paths) == sorted(path.id for path in inside)
    assert tour.paths[-1].id == inside[-1].id
    assert tour.travel < 0.84 * nearest.travel  # greedy alone: 0.92


@pytest.mark.parametrize("seconds", [0.05, 0.4])
def test_a_search_stops_after_its_seconds(seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # The clock of this test advances by a hundredth of a second each time it is read.
    ticks = itertools.count()
    monkeypatch.setattr("time.monotonic", lambda: next(ticks) / 100)
    monkeypatch.setattr(speed, "available", lambda: False)
    rng = random.Random(5)
    circles = number_paths(
        [circle(rng.uniform(0, 900), rng.uniform(0, 900), 5) for _ in range(200)]
    )
    tour = order_paths(circles, TourTable("best", seconds=seconds), (0, 0), False)
    assert tour.timed
    assert tour.method == f"local search of {seconds:g} s"
    assert next(ticks) <= 100 * seconds + 3
    assert tour.travel < 0.9 * order_paths(circles, TourTable("nearest"), (0, 0), False).travel
    assert sorted(path.id for path in tour.paths) == sorted(path.id for path in circles)


@given(st.integers(0, 10**6), st.integers(2, 80), st.booleans(), st.booleans())
def test_a_greedy_tour_runs_every_item_after_the_items_inside_it(
    seed: int, count: int, home: bool, rules: bool
) -> None:
    rng = random.Random(seed)

    def place() -> float:
        return rng.choice([rng.uniform(0, 90), float(rng.randrange(4))])  # grids and crowds as well

    paths = number_paths(
        [
            rng.choice([circle(place(), place(), 2), line((place(), place()), (place(), 95.0))])
            for _ in range(count)
        ]
    )
    rank = [int(rules and k > count / 2) for k in range(count)]
    parent = [-1] * count
    for k in range(count - 1):
        if rules and rng.random() < 0.4:
            outer = rng.randrange(k + 1, count)
            parent[k] = outer if rank[outer] == rank[k] else -1
    items = search.sample_paths(paths, make_starts(paths, "any"), parent, rank).items
    tour = join_greedily(items, make_discs(items), np.zeros(2) if home else None)
    assert tour is not None
    order = tour.order.tolist()
    assert sorted(order) == list(range(count))
    assert all(p < 0 or order.index(k) < order.index(p) for k, p in enumerate(parent))
    assert sorted(rank) == [rank[k] for k in order]
    assert all(items.first[k] <= tour.enter[k] < items.first[k + 1] for k in range(count))


def rotated_circle(x: float, y: float, r: float, turn: float) -> ToolPath:
    ring = [
        (x + r * math.cos(turn + k * math.pi / 2), y + r * math.sin(turn + k * math.pi / 2))
        for k in range(4)
    ]
    return make_path([ring[0], ring[2], ring[0]], [ring[1], ring[3]], True)


CROWDS = {
    "lines": lambda x, y, rng: line((x, y), (x + rng.uniform(-2, 2), y + 0.5)),
    "circles": lambda x, y, rng: rotated_circle(x, y, rng.uniform(1, 20), rng.uniform(0, 7)),
    "slots": lambda x, y, _rng: slot(x, y),
}


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", CROWDS)
def test_the_nearest_tour_of_many_paths_takes_the_nearest_start_at_each_step(
    kind: str, seed: int
) -> None:
    rng = random.Random(seed)
    paths = [CROWDS[kind](rng.gauss(0, 300), rng.gauss(0, 300), rng) for _ in range(300)]
    check_nearest_neighbour(number_paths(paths), (0, 0), inside_first=False)


def test_lines_are_reversed_and_closed_paths_start_between_vertices() -> None:
    far = line((100, 0), (20, 10))
    square = make_path([(0, 5), (10, 5), (10, 15), (0, 15), (0, 5)], [None] * 4, True)
    tour = order_paths(
        number_paths([far, square, circle(50, -30, 10)]),
        TourTable("nearest"),
        (4, 0),
        True,
    )
    assert [p.id for p in tour.paths] == ["c1", "c0", "c2"]
    # The square starts right above the start of the tour, and the line is reversed.
    # The circle starts at its nearest point to the end of the line.
    corners = [[4, 5], [10, 5], [10, 15], [0, 15], [0, 5], [4, 5]]
    assert tour.paths[0].position[:, :2].tolist() == corners
    assert tour.paths[1].position[:, :2].tolist() == [[20, 10], [100, 0]]
    reach = math.hypot(50, 30)
    x, y = 50 + 10 * 50 / reach, -30 + 10 * 30 / reach
    assert tour.paths[2].position[0].tolist() == pytest.approx([x, y, 0])
    legs = 5 + math.hypot(16, 5) + reach - 10 + math.hypot(x - 4, y)
    assert tour.travel == pytest.approx(legs)
    assert measure_travel(tour.paths, None) == pytest.approx(math.hypot(16, 5) + reach - 10)


def test_a_path_that_is_not_reversible_is_entered_at_its_start() -> None:
    tour = order_paths(
        [line((50, 0), (1, 0), reversible=False)],
        TourTable("nearest"),
        (0, 0),
        False,
    )
    assert tour.paths[0].position[0].tolist() == [50, 0, 0]
    assert tour.travel == pytest.approx(51)


def test_without_a_start_the_leftmost_path_comes_first() -> None:
    settings = TourTable("nearest")
    paths = number_paths([line((0, 0), (5, 0)), circle(6, 40, 10), line((9, 9), (-3, 9))])
    tour = order_paths(paths, settings, None, False)
    assert [p.id for p in tour.paths] == ["c1", "c2", "c0"]
    assert tour.paths[0].position[0].tolist() == pytest.approx([-4, 40, 0])
    twins = number_paths([line((0, 0), (1, 0)), line((0, 0), (1, 0))])
    assert [p.id for p in order_paths(twins, settings, None, False).paths] == ["c0", "c1"]


def test_holes_come_before_the_outline_around_them() -> None:
    island, hole, outline = circle(0, 0, 2, parent=1), circle(0, 0, 5, parent=2), circle(0, 0, 9)
    paths = number_paths([island, hole, outline])
    for inside_first, order in ((False, ["c2", "c1", "c0"]), (True, ["c0", "c1", "c2"])):
        tour = order_paths(paths, TourTable("nearest"), (20, 0), inside_first)
        assert [p.id for p in tour.paths] == order


def test_a_tour_as_drawn_keeps_order_and_starts() -> None:
    paths = number_paths([circle(0, 0, 9), circle(0, 0, 2, parent=0), line((9, 9), (20, 9))])
    tour = order_paths(paths, TourTable("as-drawn"), (0, 0), True)
    assert list(tour.paths) == paths
    assert tour.method == "as drawn"
    assert tour.travel == pytest.approx(9 + 7 + math.hypot(7, 9) + math.hypot(20, 9))


def test_a_tour_without_paths_is_empty() -> None:
    for method in ("nearest", "as-drawn"):
        tour = order_paths([], TourTable(method), (1, 1), True)
        assert (tour.paths, tour.travel) == ((), 0.0)


def test_an_unknown_method_and_paths_that_enclose_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="unknown method"):
        order_paths([circle(0, 0, 1)], TourTable("shortest"), None, False)
    ring = [circle(0, 0, 1, parent=1), circle(0, 0, 2, parent=0), circle(9, 0, 1)]
    for paths in (ring, ring[:2]):
        for start in (None, (0.0, 0.0)):
            with pytest.raises(ValueError, match="enclose each other"):
                order_paths(paths, TourTable("nearest"), start, True)


@fewer(12)
@given(draw_path().filter(lambda p: p.closed), st.data())
def test_a_moved_start_keeps_the_path(path: ToolPath, data: st.DataObject) -> None:
    segment = data.draw(st.integers(1, len(path.position) - 1))
    fraction = data.draw(st.floats(0, 1))
    moved = move_start(path, segment, fraction)
    total = sum(measure_length(piece) for piece in list_pieces(path))
    shift = sum(measure_length(piece) for piece in list_pieces(path)[: segment - 1])
    shift += fraction * measure_length(list_pieces(path)[segment - 1])
    assert measure_path(moved) == pytest.approx(total)
    assert moved.position[0].tolist() == moved.position[-1].tolist()
    assert min(measure_length(piece) for piece in list_pieces(moved)) > 0.9e-6
    assert len(moved.position) - len(path.position) in (0, 1)
    for distance in np.linspace(0.011, 0.993, 25) * total:
        expected, row = find_point_along(path, (shift + distance) % total)
        moved_point, new_row = find_point_along(moved, distance)
        assert abs(moved_point - expected) < 3e-6
        edge = sum(measure_length(piece) for piece in list_pieces(path)[:row])
        if abs((shift + distance) % total - edge) > 1e-5:
            assert moved.feed[new_row] == path.feed[row]
            assert moved.force[new_row] == path.force[row]
    assert moved.force_direction[0].tolist() == moved.force_direction[1].tolist()
    assert (moved.feed[0], moved.force[0]) == (moved.feed[1], moved.force[1])
    assert np.isnan(moved.via[0]).all()
    for row, piece in enumerate(list_pieces(moved), start=1):
        for k, t in enumerate((0.0, 1.0)):
            dx, dy = tangent(*piece, t)
            assert moved.force_direction[row, k] == pytest.approx(
                [-dy, dx, 0], abs=1e-5 if measure_length(piece) < 0.01 else 1e-7
            )
        if piece[1] is not None:  # the via point stays half-way along the arc
            a, m, b = (complex(*xy) for xy in piece)
            assert abs(m - a) == pytest.approx(abs(m - b), abs=1e-7)
    for name in COLUMNS:
        assert not getattr(moved, name).flags.writeable
        assert len(getattr(moved, name)) == len(moved.position)


def test_the_start_of_a_circle_can_be_moved_by_an_eighth() -> None:
    r = math.sqrt(0.5)
    moved = move_start(circle(0, 0, 1), 1, 0.25)
    assert moved.position[:, :2] == pytest.approx(np.array([[r, r], [-1, 0], [1, 0], [r, r]]))
    vias = [[math.cos(a), math.sin(a)] for a in (math.pi * 5 / 8, math.pi * 3 / 2, math.pi / 8)]
    assert moved.via[1:, :2] == pytest.approx(np.array(vias))
    # The tool runs around a pin with the force to its left, towards the centre.
    assert moved.force_direction[1] == pytest.approx(np.array([[-r, -r, 0], [1, 0, 0]]))
    assert moved.force_direction[3] == pytest.approx(np.array([[-1, 0, 0], [-r, -r, 0]]))
    assert moved.feed.tolist() == [11, 11, 12, 11]


def test_an_arc_out_of_the_plane_is_split_on_its_circle() -> None:
    # A vertical half circle of radius 5 mm above the x axis, and the line back.
    # The tool is tilted with it.
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
    (1, 0.0, 0), (1, 1.0, 1), (2, 0.0, 1),
    (4, 1.0, 0), (3, 0.9e-6 / 22, 2), (3, 1 - 0.9e-6 / 22, 3),
])  # fmt: skip
def test_a_start_at_a_vertex_adds_no_vertex(segment: int, fraction: float, first: int) -> None:
    path = slot(0, 0)
    moved = move_start(path, segment, fraction)
    corners = path.position[:4].tolist()
    assert moved.position.tolist() == [*corners[first:], *corners[:first], corners[first]]


def test_a_start_that_is_not_on_the_path_is_refused() -> None:
    for path, segment, fraction in [
        (line((0, 0), (1, 0)), 1, 0.5), (slot(0, 0), 0, 0.5), (slot(0, 0), 5, 0.5),
        (slot(0, 0), 1, 1.01), (slot(0, 0), 1, math.nan),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=r"open path|has segments|fraction"):
            move_start(path, segment, fraction)


@given(st.lists(draw_path(), max_size=5))
def test_many_paths_are_reversed_like_a_single_one(paths: list[ToolPath]) -> None:
    for path, back in zip(paths, reverse_each(paths), strict=True):
        alone = path.reversed()
        for name in COLUMNS:
            assert np.array_equal(getattr(back, name), getattr(alone, name), equal_nan=True)


def test_the_work_for_thousands_of_paths_at_one_point_is_not_quadratic(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scanned, scan = [0], tree._scan

    def count_scanned(
        candidates: list[tree.Line | tree.Arc], x: float, y: float, best: float, choice: int
    ) -> tuple[float, int]:
        scanned[0] += len(candidates)
        return scan(candidates, x, y, best, choice)

    monkeypatch.setattr(tree, "_scan", count_scanned)
    count = 5_000
    fan = [line((0, 0), (math.cos(i), math.sin(i))) for i in range(count)]
    assert len(order_paths(fan, TourTable("nearest"), (0, 0), False).paths) == count
    assert count <= scanned[0] < 40 * count  # quadratic work would be 2500 times as much


def test_the_module_does_not_import_scipy_and_shapely() -> None:
    code = "import camgen.order, sys; print('scipy' in sys.modules, 'shapely' in sys.modules)"
    output = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert output == "False False\n"
