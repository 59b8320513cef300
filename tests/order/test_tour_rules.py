"""What a job may ask of a tour: the order of layers, and where a closed path begins."""

import math
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.job import Job
from camgen.model.path import ToolPath
from camgen.order.arrange import TourSettings, is_free, measure_travel, order_paths
from camgen.pipeline import build
from camgen.plan.columns import straight_path
from tests.order.test_tour import XY, circle, ids, line, make, slot
from tests.support.examples import fewer

LAYERS = ("a", "b", "c")


def mixed(rng: random.Random, count: int) -> list[ToolPath]:
    """Lines, circles and squares on three layers, some inside of a later one."""
    paths = []
    for k in range(count):
        x, y = rng.uniform(0, 200), rng.uniform(0, 200)
        kind = rng.choice(["line", "circle", "square", "slot"])
        path = (
            line((x, y), (x + rng.uniform(-9, 9), y + 3))
            if kind == "line"
            else circle(x, y, rng.uniform(1, 9))
            if kind == "circle"
            else slot(x, y)
            if kind == "slot"
            else square(x, y, rng.uniform(2, 30))
        )
        parent = rng.randrange(k + 1, count) if k + 1 < count and rng.random() < 0.3 else -1
        paths.append(replace(path, layer=rng.choice(LAYERS), parent=parent))
    return ids(paths)


def square(x: float, y: float, side: float) -> ToolPath:
    ring = [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]
    return make(ring, [None] * 4, True)


@fewer(10)
@given(
    st.integers(0, 10**6),
    st.integers(1, 40),
    st.sampled_from(["nearest", "best", "as-drawn"]),
    st.booleans(),
)
def test_layers_come_in_the_order_that_is_named_and_what_is_inside_first_among_equals(
    seed: int, count: int, method: str, at: bool
) -> None:
    paths = mixed(random.Random(seed), count)
    start = (0.0, 0.0) if at else None
    tour = order_paths(paths, TourSettings(method, start, True, layers=["b", "c"]))
    assert sorted(p.id for p in tour.paths) == sorted(p.id for p in paths)
    ranks = [{"b": 0, "c": 1}.get(p.layer, 2) for p in tour.paths]
    assert ranks == sorted(ranks)
    assert tour.travel == pytest.approx(measure_travel(tour.paths, start))
    assert tour.bound is None or tour.bound <= tour.travel + 1e-6
    if method != "as-drawn":
        place = {p.id: k for k, p in enumerate(tour.paths)}
        for path in paths:
            around = path.parent
            while around >= 0:
                if {"b": 0, "c": 1}.get(paths[around].layer, 2) >= {"b": 0, "c": 1}.get(
                    path.layer, 2
                ):
                    assert place[path.id] < place[paths[around].id]
                around = paths[around].parent


def test_a_layer_that_is_named_first_comes_before_a_nearer_one() -> None:
    near, far = line((1, 0), (2, 0), layer="mark"), line((90, 0), (91, 0), layer="cut")
    assert [
        p.layer
        for p in order_paths([near, far], TourSettings("best", (0, 0), True, layers=["cut"])).paths
    ] == [
        "cut",
        "mark",
    ]
    assert [
        p.layer
        for p in order_paths(
            [far, near], TourSettings("as-drawn", (0, 0), True, layers=["mark", "cut"])
        ).paths
    ] == [
        "mark",
        "cut",
    ]


def corner_gap(path: ToolPath) -> float:
    """How far the start of a path is from where four straight sides of one of ``square`` meet."""
    low, high = path.position[:, :2].min(axis=0), path.position[:, :2].max(axis=0)
    corners = np.array([low, high, [low[0], high[1]], [high[0], low[1]]])
    return float(np.linalg.norm(corners - path.position[0, :2], axis=1).min())


@fewer(8)
@given(st.integers(0, 10**6), st.integers(1, 30), st.sampled_from(["nearest", "best"]))
def test_smooth_seams_are_off_the_corners(seed: int, count: int, method: str) -> None:
    rng = random.Random(seed)
    paths = ids(
        [square(rng.uniform(0, 200), rng.uniform(0, 200), rng.uniform(1, 30)) for _ in range(count)]
    )
    tour = order_paths(paths, TourSettings(method, (0.0, 0.0), False, seam="smooth"))
    for path in tour.paths:
        side = float(np.ptp(path.position[:, 0]))
        assert corner_gap(path) >= min(1.0, side / 3) - 1e-6
        assert [*path.position[0]] == pytest.approx([*path.position[-1]])
    assert tour.bound is not None
    assert tour.bound <= tour.travel + 1e-6


def test_a_seam_that_may_be_anywhere_is_at_the_corner_that_is_nearest() -> None:
    one = square(10, 10, 8)
    anywhere = order_paths([one], TourSettings("best", (0, 0), False))
    assert anywhere.paths[0].position[0, :2].tolist() == pytest.approx([10, 10], abs=0.1)
    smooth = order_paths([one], TourSettings("best", (0, 0), False, seam="smooth"))
    assert math.dist(smooth.paths[0].position[0, :2], (10, 10)) == pytest.approx(1.0, abs=1e-6)
    # A slot has no corner, and a circle none either: both begin where they are nearest.
    for path, nearest in ((circle(10, 0, 3), (7.0, 0.0)), (slot(10, -4), (6.0, 0.0))):
        for seam in ("any", "smooth"):
            begin: XY = tuple(
                order_paths([path], TourSettings("nearest", (0, 0), False, seam=seam))
                .paths[0]
                .position[0, :2]
            )
            assert begin == pytest.approx(nearest, abs=1e-6)


def test_who_watches_a_build_sees_how_far_the_search_is_and_may_stop_it(tmp_path: Path) -> None:
    import ezdxf  # noqa: PLC0415

    document = ezdxf.new("R2010", units=4)
    rng = random.Random(8)
    for _ in range(60):
        document.modelspace().add_circle((rng.uniform(0, 300), rng.uniform(0, 300)), 2)
    file = tmp_path / "holes.dxf"
    document.saveas(file)
    job = {"operation": {"kind": "trace"}}
    seen: list[str] = []
    whole = build(file, post="gcode", job=job, watch=seen.append)
    assert [name for name in seen if name.startswith("ordering ")]
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
def test_the_bound_sees_the_room_between_squares(side: float) -> None:
    # Ten in a row, 5 mm apart: nine ways of 5 mm at least, and the corners of one do not reach into the next.
    row = ids([square(k * (side + 5), 0, side) for k in range(10)])
    tour = order_paths(row, TourSettings("best", None, False, seconds=0.1))
    assert tour.bound is not None
    assert 0.93 * 45 < tour.bound <= tour.travel + 1e-6
    # Lines end on end: the bound is exact where the tour is one line.
    ends = ids([line((10.0 * k, 0), (10.0 * k + 4, 0)) for k in range(10)])
    along = order_paths(ends, TourSettings("best", None, False, seconds=0.1))
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
def test_a_greedy_tour_is_a_start_where_next_to_nothing_has_to_wait(
    waits_for: list[int], free: bool
) -> None:
    path = straight_path("p", np.array([[0.0, 0.0], [1.0, 0.0]]), Job(), "trace")
    assert is_free([path] * len(waits_for), waits_for, [0] * len(waits_for)) == free
