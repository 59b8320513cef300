"""Settings of a tour: the order of the layers, and the seams of closed paths."""

import math
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.job import Job, TourTable
from camgen.model.path import ToolPath
from camgen.order.arrange import is_free, measure_travel, order_paths
from camgen.pipeline import build
from camgen.plan.columns import straight_path
from tests.order.test_tour import circle, line, make_path, number_paths, slot
from tests.support.examples import fewer

LAYERS = ("a", "b", "c")


def make_mixed(rng: random.Random, count: int) -> list[ToolPath]:
    """Lines, circles, squares and slots on three layers, some inside of a later one."""
    paths = []
    for k in range(count):
        x, y = rng.uniform(0, 200), rng.uniform(0, 200)
        match rng.choice(["line", "circle", "square", "slot"]):
            case "line":
                path = line((x, y), (x + rng.uniform(-9, 9), y + 3))
            case "circle":
                path = circle(x, y, rng.uniform(1, 9))
            case "slot":
                path = slot(x, y)
            case _:
                path = square(x, y, rng.uniform(2, 30))
        parent = rng.randrange(k + 1, count) if k + 1 < count and rng.random() < 0.3 else -1
        paths.append(replace(path, layer=rng.choice(LAYERS), parent=parent))
    return number_paths(paths)


def square(x: float, y: float, side: float) -> ToolPath:
    ring = [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]
    return make_path(ring, [None] * 4, True)


@fewer(10)
@given(
    st.integers(0, 10**6),
    st.integers(1, 40),
    st.sampled_from(["nearest", "best", "as-drawn"]),
    st.booleans(),
)
def test_layers_come_in_the_order_of_the_job_and_inner_paths_first_within_a_layer(
    seed: int, count: int, method: str, at: bool
) -> None:
    paths = make_mixed(random.Random(seed), count)
    start = (0.0, 0.0) if at else None
    tour = order_paths(paths, TourTable(method, layers=["b", "c"]), start, True)
    assert sorted(p.id for p in tour.paths) == sorted(p.id for p in paths)
    rank = {"a": 2, "b": 0, "c": 1}
    ranks = [rank[p.layer] for p in tour.paths]
    assert ranks == sorted(ranks)
    assert tour.travel == pytest.approx(measure_travel(tour.paths, start))
    assert tour.bound is None or tour.bound <= tour.travel + 1e-6
    if method != "as-drawn":
        place = {p.id: k for k, p in enumerate(tour.paths)}
        for path in paths:
            around = path.parent
            while around >= 0:
                if rank[paths[around].layer] >= rank[path.layer]:
                    assert place[path.id] < place[paths[around].id]
                around = paths[around].parent


def test_the_first_layer_of_the_job_comes_before_a_nearer_one() -> None:
    near, far = line((1, 0), (2, 0), layer="mark"), line((90, 0), (91, 0), layer="cut")
    best = order_paths([near, far], TourTable("best", layers=["cut"]), (0, 0), True)
    assert [path.layer for path in best.paths] == ["cut", "mark"]
    settings = TourTable("as-drawn", layers=["mark", "cut"])
    kept = order_paths([far, near], settings, (0, 0), True)
    assert [path.layer for path in kept.paths] == ["mark", "cut"]


def measure_corner_distance(path: ToolPath) -> float:
    """Distance from the start of a path made by `square` to its nearest corner, mm."""
    low, high = path.position[:, :2].min(axis=0), path.position[:, :2].max(axis=0)
    corners = np.array([low, high, [low[0], high[1]], [high[0], low[1]]])
    return float(np.linalg.norm(corners - path.position[0, :2], axis=1).min())


@fewer(8)
@given(st.integers(0, 10**6), st.integers(1, 30), st.sampled_from(["nearest", "best"]))
def test_smooth_seams_keep_away_from_corners(seed: int, count: int, method: str) -> None:
    rng = random.Random(seed)
    paths = number_paths(
        [square(rng.uniform(0, 200), rng.uniform(0, 200), rng.uniform(1, 30)) for _ in range(count)]
    )
    tour = order_paths(paths, TourTable(method, seam="smooth"), (0.0, 0.0), False)
    for path in tour.paths:
        side = float(np.ptp(path.position[:, 0]))
        assert measure_corner_distance(path) >= min(1.0, side / 3) - 1e-6
        assert [*path.position[0]] == pytest.approx([*path.position[-1]])
    assert tour.bound is not None
    assert tour.bound <= tour.travel + 1e-6


def test_a_free_seam_is_at_the_nearest_corner_and_a_smooth_one_next_to_it() -> None:
    paths = [square(10, 10, 8)]
    anywhere = order_paths(paths, TourTable("best"), (0, 0), False)
    assert anywhere.paths[0].position[0, :2].tolist() == pytest.approx([10, 10], abs=0.1)
    smooth = order_paths(paths, TourTable("best", seam="smooth"), (0, 0), False)
    assert math.dist(smooth.paths[0].position[0, :2], (10, 10)) == pytest.approx(1.0, abs=1e-6)
    # A slot and a circle have no corners, so both kinds of seams are at the nearest point.
    for path, nearest in ((circle(10, 0, 3), (7.0, 0.0)), (slot(10, -4), (6.0, 0.0))):
        for seam in ("any", "smooth"):
            tour = order_paths([path], TourTable("nearest", seam=seam), (0, 0), False)
            assert tour.paths[0].position[0, :2] == pytest.approx(nearest, abs=1e-6)


def test_the_search_reports_its_progress_and_the_watcher_may_stop_it(tmp_path: Path) -> None:
    import ezdxf  # noqa: PLC0415

    document = ezdxf.new("R2010", units=4)
    rng = random.Random(8)
    for _ in range(60):
        document.modelspace().add_circle((rng.uniform(0, 300), rng.uniform(0, 300)), 2)
    file = tmp_path / "holes.dxf"
    document.saveas(file)
    job = {"operation": {"kind": "trace"}}
    names: list[str] = []
    whole = build(file, post="gcode", job=job, watch=names.append)
    assert [name for name in names if name.startswith("ordering ")]
    assert whole.text == build(file, post="gcode", job=job).text

    def stop(name: str) -> None:
        if name.startswith("ordering ") and "ordering 0%" not in name:
            raise KeyboardInterrupt

    stopped = build(file, post="gcode", job=job, watch=stop)
    notes = [note.what for note in stopped.notes]
    assert "the search for a short tour was stopped" in notes
    assert "the search for a short tour was stopped" not in [note.what for note in whole.notes]
    nearest = build(file, post="gcode", job={**job, "tour": {"method": "nearest"}})
    assert whole.tour.travel <= stopped.tour.travel < nearest.tour.travel
    assert len(stopped.tour.paths) == 60


@pytest.mark.parametrize("side", [2.0, 14.0])
def test_the_lower_bound_counts_the_gaps_between_squares(side: float) -> None:
    # Ten squares in a row, 5 mm apart, have nine links of at least 5 mm.
    row = number_paths([square(k * (side + 5), 0, side) for k in range(10)])
    tour = order_paths(row, TourTable("best", seconds=0.1), None, False)
    assert tour.bound is not None
    assert 0.93 * 45 < tour.bound <= tour.travel + 1e-6
    # The lines are in one row, so the tour is one line, and its lower bound is exact.
    ends = number_paths([line((10.0 * k, 0), (10.0 * k + 4, 0)) for k in range(10)])
    along = order_paths(ends, TourTable("best", seconds=0.1), None, False)
    assert along.travel == pytest.approx(54)
    assert along.bound == pytest.approx(54)


@pytest.mark.parametrize(
    ("waits_for", "free"),
    [
        pytest.param([2000] * 2000 + [-1], True, id="a sheet with an outline"),
        pytest.param(
            [k ^ 1 if k % 2 == 0 else -1 for k in range(2000)], False, id="every part with a hole"
        ),
        pytest.param([1, 0] + [-1] * 1998, False, id="a circle"),
        pytest.param([-1] * 10, True, id="nothing around anything"),
    ],
)
def test_a_search_starts_with_a_greedy_tour_if_few_paths_have_to_wait(
    waits_for: list[int], free: bool
) -> None:
    path = straight_path("p", np.array([[0.0, 0.0], [1.0, 0.0]]), Job(), "trace")
    assert is_free([path] * len(waits_for), waits_for, [0] * len(waits_for)) == free
