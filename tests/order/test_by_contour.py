"""What a job says of single contours: where their paths begin (tour.seams) and which run first (tour.order)."""

import math
import random
from collections.abc import Sequence
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

import camgen
from camgen.model.errors import CamgenError, JobError
from camgen.model.job import Job, TourTable
from camgen.model.part import Part
from camgen.model.path import ToolPath
from camgen.order import ArmTour
from camgen.order.arrange import TourSettings, measure_travel, order_paths
from camgen.order.starts import make_starts
from camgen.pipeline import Result, build
from camgen.plan.leave_out import leave_out_paths
from camgen.plan.seams import pin_seams
from camgen.plan.unused import check_idle
from tests.order.test_tour import along, length, pieces, point
from tests.order.test_tour_rules import mixed
from tests.support import built
from tests.support.examples import fewer

Tables = dict[str, dict[str, object]]
XY = tuple[float, float]
HOLES = [(20.0, 20.0), (50.0, 20.0), (80.0, 20.0), (20.0, 40.0), (50.0, 40.0), (80.0, 40.0)]
RADIUS, TOOL = 5.0, 4.0


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """100 x 60 mm (c1) with six holes (c2 to c7, as ``HOLES``), and a line beside it (c8)."""
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (100, 0), (100, 60), (0, 60)], close=True)
    for place in HOLES:
        space.add_circle(place, RADIUS)
    space.add_line((0, 90), (100, 90))
    file = tmp_path_factory.mktemp("plate") / "plate.dxf"
    document.saveas(file)
    return file


def made(
    plate: Path, seams: Sequence[XY] = (), order: Sequence[str] = (), **tables: dict[str, object]
) -> Result:
    tour = {"seams": [[*one] for one in seams], "order": [*order], **tables.pop("tour", {})}
    job = {"operation": {"kind": "follow"}, "tool": {"diameter": TOOL}, **tables, "tour": tour}
    return built.build(plate, post="gcode", job=job)


def begins(result: Result) -> dict[str, XY]:
    """Where each path begins, leads left away: where the closed one that was planned does."""
    return {path.id: (path.position[0, 0], path.position[0, 1]) for path in result.tour.paths}


def in_order(result: Result) -> list[str]:
    return [path.id for path in result.tour.paths]


def touch(hole: XY, towards: XY, radius: float = RADIUS - TOOL / 2) -> XY:
    """The point of the circle about ``hole`` that is nearest to ``towards``."""
    dx, dy = towards[0] - hole[0], towards[1] - hole[1]
    size = math.hypot(dx, dy)
    return hole[0] + dx / size * radius, hole[1] + dy / size * radius


#: On the contour of c2, on the path of c5, and 1.2 mm off the upper side of c1.
SEAMS: list[XY] = [(25.0, 20.0), touch(HOLES[3], (0.0, 0.0)), (37.0, 61.2)]
WANTED = {"c2": (23.0, 20.0), "c5": touch(HOLES[3], (0.0, 0.0)), "c1": (37.0, 62.0)}
DEEP = {"kind": "follow", "depth": 3.0, "passes": 2, "tabs": 3}


@pytest.mark.parametrize("method", ["best", "nearest", "as-drawn"])
@pytest.mark.parametrize("seam", ["any", "smooth"])
def test_a_path_begins_at_the_point_that_is_given_for_it(
    plate: Path, method: str, seam: str
) -> None:
    result = made(plate, SEAMS, tour={"method": method, "seam": seam})
    found = begins(result)
    for name, place in WANTED.items():
        assert found[name] == pytest.approx(place, abs=1e-6)
    # What is worked on is the same, and all others may begin anywhere.
    free = made(plate, tour={"method": method, "seam": seam})
    assert set(found) == set(begins(free))
    if method == "best":
        assert result.tour.travel >= free.tour.travel


def test_leads_passes_and_tabs_keep_the_seam(plate: Path) -> None:
    process = {"spindle": 10_000}
    result = made(
        plate,
        SEAMS,
        operation={**DEEP, "lead_in": 1.5, "lead_out": 1.0, "overlap": 1.0},
        process=process,
    )
    for path in result.tour.paths:
        if path.id in WANTED:
            # The lead is the first segment: the contour is met at its end.
            assert (path.position[1, 0], path.position[1, 1]) == pytest.approx(
                WANTED[path.id], abs=1e-6
            )
    plain = made(plate, SEAMS, operation=DEEP, process=process)
    assert {name: begins(plain)[name] for name in WANTED} == {
        n: pytest.approx(p, abs=1e-6) for n, p in WANTED.items()
    }


def test_a_lead_that_does_not_fit_at_the_seam_is_shortened_and_told(plate: Path) -> None:
    # 12 mm fit in no hole of 10 mm.
    result = made(plate, [(25.0, 20.0)], operation={"kind": "follow", "lead_in": 12.0})
    path = next(path for path in result.tour.paths if path.id == "c2")
    ends = [tuple(path.position[row, :2].tolist()) for row in (0, 1)]
    assert any(end == pytest.approx((23.0, 20.0), abs=1e-6) for end in ends)
    assert any("lead" in note.what and "c2" in note.what for note in result.notes)


def test_a_point_near_a_vertex_is_the_vertex_and_cuts_no_sliver_off(plate: Path) -> None:
    result = made(plate, [(0.05, 62.0)])
    path = next(path for path in result.tour.paths if path.id == "c1")
    assert (path.position[0, 0], path.position[0, 1]) == pytest.approx((0.0, 62.0), abs=1e-9)
    assert math.dist(path.position[0], path.position[1]) > 0.1
    assert len(path.position) == len(next(p for p in made(plate).planned if p.id == "c1").position)


@fewer(10)
@given(
    st.integers(0, 10**6),
    st.integers(2, 40),
    st.sampled_from(["nearest", "best", "as-drawn"]),
    st.booleans(),
)
def test_contours_that_are_named_come_first_in_their_order_and_pinned_starts_stay(
    seed: int, count: int, method: str, at: bool
) -> None:
    rng = random.Random(seed)
    paths = [replace(path, contours=(path.id,)) for path in mixed(rng, count)]
    pinned = {path.id for path in paths if path.closed and rng.random() < 0.4}
    paths = [replace(path, pinned=path.id in pinned) for path in paths]
    # What is inside has the lower number (``mixed``): all that is inside of what is named is named before it.
    chosen = {path.id for path in paths if rng.random() < 0.3}
    for path in paths:
        above, around = path, path.parent
        while around >= 0:
            above, around = paths[around], paths[around].parent
            if above.id in chosen:
                chosen.add(path.id)
    order = [path.id for path in paths if path.id in chosen]
    start = (0.0, 0.0) if at else None
    tour = order_paths(paths, TourSettings(method, start, True, layers=["b"], order=order))
    assert [path.id for path in tour.paths[: len(order)]] == order
    assert sorted(path.id for path in tour.paths) == sorted(path.id for path in paths)
    rest = [{"b": 0}.get(path.layer, 1) for path in tour.paths[len(order) :]]
    assert rest == sorted(rest)
    drawn = {path.id: path.position for path in paths}
    for path in tour.paths:
        if path.id in pinned:
            np.testing.assert_array_equal(path.position, drawn[path.id])
    assert tour.travel == pytest.approx(measure_travel(tour.paths, start))
    assert tour.bound is None or tour.bound <= tour.travel + 1e-6


@given(st.integers(0, 10**6), st.integers(1, 12))
def test_a_seam_is_the_nearest_point_of_the_nearest_path(seed: int, count: int) -> None:
    """By points laid closely along the paths, on circles through their complex numbers."""
    rng = random.Random(seed)
    paths = [path for path in mixed(rng, 3 * count) if path.closed][:count]
    if not paths:
        return
    on = rng.choice(paths)
    place, _ = along(on, rng.random() * sum(map(length, pieces(on))))
    place += complex(rng.uniform(-1, 1), rng.uniform(-1, 1))
    laid = [
        np.array([point(one, t) for one in pieces(path) for t in np.linspace(0, 1, 400)])
        for path in paths
    ]
    away = [float(np.abs(dots - place).min()) for dots in laid]
    empty = Part("p", "p.dxf", "mm", (), ())
    job = Job(tour=TourTable(seams=[[place.real, place.imag]]))
    (begun,), notes = pin_seams([paths], empty, job)
    assert notes == ()
    for path, drawn, dots, apart in zip(begun, paths, laid, away, strict=True):
        if not path.pinned:
            assert apart >= min(away) - 0.1
            continue
        assert apart <= min(away) + 0.1
        start = complex(path.position[0, 0], path.position[0, 1])
        # At a vertex where less than 0.1 mm would be cut off; the points are 0.1 mm apart at most.
        assert abs(start - place) <= apart + 0.2
        assert float(np.abs(dots - start).min()) <= 0.1
        assert sum(map(length, pieces(path))) == pytest.approx(sum(map(length, pieces(drawn))))
    assert any(path.pinned for path in begun)


def test_few_paths_with_seams_and_an_order_are_solved_and_no_other_start_or_order_is_shorter() -> (
    None
):
    # Three pinned squares in a row, the far one first: there is one order left to choose.
    from tests.order.test_tour_rules import ids, square  # noqa: PLC0415

    row = [
        replace(one, contours=(one.id,))
        for one in ids([square(20.0 * k, 0.0, 4.0) for k in range(3)])
    ]
    tour = order_paths(
        [replace(one, pinned=True) for one in row],
        TourSettings("best", (0.0, 0.0), True, order=["c2"]),
    )
    assert [path.id for path in tour.paths] == ["c2", "c1", "c0"]
    assert tour.travel == pytest.approx(80.0)
    assert tour.bound == pytest.approx(80.0, abs=0.01)
    assert len(make_starts([replace(one, pinned=True) for one in row]).row) == 3


def test_the_order_of_a_job_is_that_of_its_program(plate: Path) -> None:
    holes = ["c7", "c2", "c6", "c3"]
    result = made(plate, order=holes)
    assert in_order(result)[:4] == holes
    assert in_order(result)[-1] == "c1"  # what is around them waits
    everything = [*holes, "c4", "c5", "c1"]
    assert in_order(made(plate, order=everything, tour={"method": "as-drawn"})) == everything
    # It counts more than the order of the layers, which it does not undo for the others.
    assert in_order(made(plate, order=["c3"], tour={"layers": ["0"]}))[0] == "c3"
    loose = made(plate, order=["c1"], operation={"kind": "follow", "inside_first": False})
    assert in_order(loose)[0] == "c1"


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        pytest.param(
            {"order": ["c1"]}, "c1 would be run before path c2", id="the outline before its holes"
        ),
        pytest.param(
            {"order": ["c3", "c1"]}, "c1 would be run before path c2", id="before one of them"
        ),
        pytest.param({"order": ["c9"]}, "there is no contour 'c9'", id="no such contour"),
        pytest.param({"order": ["c2", "c2"]}, "'c2' is listed twice", id="twice"),
        pytest.param({"seams": [[500, 0]]}, "[500, 0] is farther than 2 mm", id="near nothing"),
        pytest.param(
            {"seams": [[50, 90]]}, "[50, 90] is farther than 2 mm", id="on an open contour"
        ),
        pytest.param({"seams": [[50, 62, 0]]}, "is not a point of the", id="three numbers"),
        pytest.param(
            {"seams": [50, 62]}, "seams must be a list of lists of numbers", id="no list of points"
        ),
        pytest.param({"order": "c2"}, 'write ["c2"]', id="no list"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    plate: Path, tables: dict[str, object], said: str
) -> None:
    with pytest.raises(CamgenError) as caught:
        build(
            plate,
            post="gcode",
            job={"operation": {"kind": "follow"}, "tool": {"diameter": 4.0}, "tour": tables},
        )
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    "source", ["a 3-D part", "a replay", "a taught program", "curves in space"]
)
@pytest.mark.parametrize("tour", [TourTable(seams=[[0.0, 0.0]]), TourTable(order=["c1"])])
def test_what_has_no_contours_refuses_them_by_name(source: str, tour: TourTable) -> None:
    with pytest.raises(JobError, match=r"tour\.(seams|order)"):
        check_idle(Job(tour=tour), source)


def test_a_point_on_a_path_is_for_that_path_and_one_on_its_contour_for_all_of_it(
    plate: Path,
) -> None:
    rows: Tables = {"operation": {"kind": "follow"}}
    several = {
        "operations": [
            {"ids": ["c2"]},
            {"ids": ["c2"], "finish": 0.0, "tool": "small"},
            {"ids": ["c3"]},
        ]
    }
    tools = {"tools": [{"name": "large", "diameter": 6.0}, {"name": "small", "diameter": 2.0}]}
    for row in (several["operations"][0], several["operations"][2]):
        row["tool"] = "large"
    job = {**rows, **several, **tools}
    on_contour = build(plate, post="rapid", job={**job, "tour": {"seams": [[20, 25]]}})
    assert begins(on_contour)["0:c2"] == pytest.approx((20.0, 22.0), abs=1e-6)
    assert begins(on_contour)["1:c2"] == pytest.approx((20.0, 24.0), abs=1e-6)
    # 24 is on the path of the small tool, which then has a point of its own; the other keeps that of the contour.
    both = build(plate, post="rapid", job={**job, "tour": {"seams": [[20, 25], [16, 20]]}})
    assert begins(both)["0:c2"] == pytest.approx((20.0, 22.0), abs=1e-6)
    assert begins(both)["1:c2"] == pytest.approx((16.0, 20.0), abs=1e-6)
    assert not [note for note in both.notes if "has no effect" in note.what]
    # Two points for one path: the one that is nearer counts, and the other one is told.
    two = build(plate, post="rapid", job={**job, "tour": {"seams": [[51.0, 20.0], [52.0, 20.0]]}})
    assert begins(two)["2:c3"] == pytest.approx((52.0, 20.0), abs=1e-6)
    assert [note.what for note in two.notes if "no effect" in note.what] == [
        "tour.seams: [51, 20] has no effect"
    ]


def test_a_point_on_an_island_is_for_the_pass_around_it_alone(plate: Path) -> None:
    operation = {"kind": "pocket", "depth": 2.0, "finish": 0.3}
    free, pinned = (
        camgen.plan(camgen.read(plate, job), job)
        for job in (
            camgen.job(
                {
                    "operation": operation,
                    "tool": {"diameter": 4.0},
                    "process": {"spindle": 9000},
                    "tour": tour,
                }
            )
            for tour in ({}, {"seams": [[25.0, 20.0]]})
        )
    )
    held = [path for path in pinned.paths if path.pinned]
    assert [path.position[0, :2].tolist() for path in held] == [
        pytest.approx([27.0, 20.0], abs=1e-6)
    ]
    # What goes down on a helix begins where there is room for it.
    assert [path.entry_radius for path in free.paths] == [
        path.entry_radius for path in pinned.paths
    ]
    assert max(path.entry_radius for path in free.paths) > 0


def test_operations_keep_their_order_and_what_the_list_says_otherwise_is_told(plate: Path) -> None:
    rows = [{"ids": ["c2", "c3", "c4"], "kind": "pocket"}, {"ids": ["c5", "c6", "c1"]}]
    job = {"operation": {"kind": "follow"}, "tool": {"diameter": TOOL}, "operations": rows}
    result = build(plate, post="rapid", job={**job, "tour": {"order": ["c6", "c4", "c3"]}})
    ran = list(dict.fromkeys(path.contours[0] for path in result.tour.paths))
    assert ran[:3] == ["c4", "c3", "c2"]
    assert ran[3:] == ["c6", "c5", "c1"]
    told = [note for note in result.notes if note.what.startswith("tour.order")]
    assert [note.what for note in told] == ["tour.order: contour c4 is run before c6"]
    kept = build(plate, post="rapid", job={**job, "tour": {"order": ["c4", "c3", "c6"]}})
    assert not [note for note in kept.notes if note.what.startswith("tour.order")]


@pytest.mark.parametrize("tool", [{"symmetric": True}, {}])
def test_an_arm_that_chooses_by_its_joints_keeps_seams_and_order(
    plate: Path, tool: dict[str, object]
) -> None:
    job = {
        "cell": {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]},
        "operation": {"kind": "trace"},
        "tool": tool,
        "tour": {"seams": [[25.0, 20.0], [50.0, 60.0]], "order": ["c6", "c2"]},
    }
    result = build(plate, post="rapid", job=job)
    assert isinstance(result.tour, ArmTour) == bool(tool)
    assert in_order(result)[:2] == ["c6", "c2"]
    assert begins(result)["c2"] == pytest.approx((25.0, 20.0), abs=1e-6)
    assert begins(result)["c1"] == pytest.approx((50.0, 60.0), abs=1e-6)


def test_ways_at_working_height_are_proven_for_the_seams_that_are_asked_for(plate: Path) -> None:
    result = made(plate, SEAMS, order=["c5"], process={"stay_down": True})
    assert in_order(result)[0] == "c5"
    assert begins(result)["c5"] == pytest.approx(WANTED["c5"], abs=1e-6)


def test_a_seam_of_a_path_that_is_lost_costs_no_other_one(plate: Path) -> None:
    tour = {"seams": [[15.0, 20.0], [55.0, 40.0]], "order": ["c4", "c6", "c2"]}
    job = camgen.job({"operation": {"kind": "trace"}, "tour": tour})
    # As after a check that has found c4 and c6 out of reach: all is ordered anew.
    plan = leave_out_paths(
        camgen.plan(camgen.read(plate, job), job), {"c4": "out of reach", "c6": "out of reach"}
    )
    found = camgen.order(plan, job)
    assert found.paths[0].id == "c2"
    assert found.paths[0].position[0, :2].tolist() == pytest.approx([15.0, 20.0], abs=1e-6)


def test_a_thousand_may_be_named() -> None:
    from tests.order.test_tour_rules import circle, ids  # noqa: PLC0415

    paths: list[ToolPath] = ids([circle(7.0 * (k % 50), 7.0 * (k // 50), 2.0) for k in range(1000)])
    paths = [replace(path, contours=(path.id,)) for path in paths]
    order = [path.id for path in reversed(paths)]
    assert [
        path.id
        for path in order_paths(paths, TourSettings("best", (0.0, 0.0), True, order=order)).paths
    ] == order
