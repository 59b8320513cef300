"""Settings of single contours: seams of their paths (tour.seams) and their order (tour.order)."""

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
from camgen.order.arrange import measure_travel, order_paths
from camgen.order.starts import make_starts
from camgen.pipeline import Result, build
from camgen.plan.leave_out import leave_out_paths
from camgen.plan.seams import pin_seams
from camgen.plan.unused import check_idle
from tests.order.test_tour import find_point, find_point_along, list_pieces, measure_length
from tests.order.test_tour_rules import circle, make_mixed, number_paths, square
from tests.support import built
from tests.support.examples import fewer

Tables = dict[str, dict[str, object]]
XY = tuple[float, float]
HOLES = [(20.0, 20.0), (50.0, 20.0), (80.0, 20.0), (20.0, 40.0), (50.0, 40.0), (80.0, 40.0)]
RADIUS, TOOL = 5.0, 4.0


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate of 100 x 60 mm (c1) with six holes (c2 to c7, at `HOLES`) and a line near it (c8)."""
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (100, 0), (100, 60), (0, 60)], close=True)
    for centre in HOLES:
        space.add_circle(centre, RADIUS)
    space.add_line((0, 90), (100, 90))
    file = tmp_path_factory.mktemp("plate") / "plate.dxf"
    document.saveas(file)
    return file


def build_plate(
    plate: Path, seams: Sequence[XY] = (), order: Sequence[str] = (), **tables: dict[str, object]
) -> Result:
    tour = {"seams": list(map(list, seams)), "order": [*order], **tables.pop("tour", {})}
    job = {"operation": {"kind": "follow"}, "tool": {"diameter": TOOL}, **tables, "tour": tour}
    return built.build(plate, post="gcode", job=job)


def list_starts(result: Result) -> dict[str, XY]:
    """First point of each path, mm. Without leads this is the seam of a closed path."""
    return {path.id: (path.position[0, 0], path.position[0, 1]) for path in result.tour.paths}


def list_ids(result: Result) -> list[str]:
    return [path.id for path in result.tour.paths]


def find_nearest(hole: XY, towards: XY, radius: float = RADIUS - TOOL / 2) -> XY:
    """Point of the circle around `hole` that is nearest to `towards`, mm."""
    dx, dy = towards[0] - hole[0], towards[1] - hole[1]
    size = math.hypot(dx, dy)
    return hole[0] + dx / size * radius, hole[1] + dy / size * radius


#: On the contour of c2, on the path of c5, and 1.2 mm from the upper side of c1.
SEAMS: list[XY] = [(25.0, 20.0), find_nearest(HOLES[3], (0.0, 0.0)), (37.0, 61.2)]
WANTED = {"c2": (23.0, 20.0), "c5": find_nearest(HOLES[3], (0.0, 0.0)), "c1": (37.0, 62.0)}
DEEP = {"kind": "follow", "depth": 3.0, "passes": 2, "tabs": 3}


@pytest.mark.parametrize("method", ["best", "nearest", "as-drawn"])
@pytest.mark.parametrize("seam", ["any", "smooth"])
def test_a_path_starts_at_its_seam(plate: Path, method: str, seam: str) -> None:
    result = build_plate(plate, SEAMS, tour={"method": method, "seam": seam})
    starts = list_starts(result)
    for name, start in WANTED.items():
        assert starts[name] == pytest.approx(start, abs=1e-6)
    # Without seams the same paths are run, and they may start anywhere.
    free = build_plate(plate, tour={"method": method, "seam": seam})
    assert set(starts) == set(list_starts(free))
    if method == "best":
        assert result.tour.travel >= free.tour.travel


def test_leads_passes_and_tabs_keep_the_seam(plate: Path) -> None:
    process = {"spindle": 10_000}
    result = build_plate(
        plate,
        SEAMS,
        operation={**DEEP, "lead_in": 1.5, "lead_out": 1.0, "overlap": 1.0},
        process=process,
    )
    for path in result.tour.paths:
        if path.id in WANTED:
            # The lead-in is the first segment, so its end is the seam.
            assert path.position[1, :2] == pytest.approx(WANTED[path.id], abs=1e-6)
    plain = list_starts(build_plate(plate, SEAMS, operation=DEEP, process=process))
    for name, start in WANTED.items():
        assert plain[name] == pytest.approx(start, abs=1e-6)


def test_a_lead_that_does_not_fit_at_the_seam_is_shortened_with_a_note(plate: Path) -> None:
    # A lead of 12 mm does not fit in a hole with a diameter of 10 mm.
    result = build_plate(plate, [(25.0, 20.0)], operation={"kind": "follow", "lead_in": 12.0})
    path = next(path for path in result.tour.paths if path.id == "c2")
    ends = [tuple(path.position[row, :2].tolist()) for row in (0, 1)]
    assert any(end == pytest.approx((23.0, 20.0), abs=1e-6) for end in ends)
    assert any("lead" in note.what and "c2" in note.what for note in result.notes)


def test_a_seam_near_a_vertex_is_moved_to_the_vertex(plate: Path) -> None:
    result = build_plate(plate, [(0.05, 62.0)])
    path = next(path for path in result.tour.paths if path.id == "c1")
    assert (path.position[0, 0], path.position[0, 1]) == pytest.approx((0.0, 62.0), abs=1e-9)
    assert math.dist(path.position[0], path.position[1]) > 0.1
    (planned,) = [path for path in build_plate(plate).planned if path.id == "c1"]
    assert len(path.position) == len(planned.position)


@fewer(10)
@given(
    st.integers(0, 10**6),
    st.integers(2, 40),
    st.sampled_from(["nearest", "best", "as-drawn"]),
    st.booleans(),
)
def test_listed_contours_come_first_in_their_order_and_pinned_starts_stay(
    seed: int, count: int, method: str, at: bool
) -> None:
    rng = random.Random(seed)
    paths = [replace(path, contours=(path.id,)) for path in make_mixed(rng, count)]
    pinned = {path.id for path in paths if path.closed and rng.random() < 0.4}
    paths = [replace(path, pinned=path.id in pinned) for path in paths]
    # A path inside another one has the lower number (see `make_mixed`).
    # So the paths inside a chosen path are listed before it.
    chosen = {path.id for path in paths if rng.random() < 0.3}
    for path in paths:
        above, around = path, path.parent
        while around >= 0:
            above, around = paths[around], paths[around].parent
            if above.id in chosen:
                chosen.add(path.id)
    order = [path.id for path in paths if path.id in chosen]
    start = (0.0, 0.0) if at else None
    tour = order_paths(paths, TourTable(method, layers=["b"], order=order), start, True)
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
    """Compared with the nearest of many points along the paths."""
    rng = random.Random(seed)
    paths = [path for path in make_mixed(rng, 3 * count) if path.closed][:count]
    if not paths:
        return
    on = rng.choice(paths)
    seam, _ = find_point_along(on, rng.random() * sum(map(measure_length, list_pieces(on))))
    seam += complex(rng.uniform(-1, 1), rng.uniform(-1, 1))
    samples = [_sample(path) for path in paths]
    distances = [float(np.abs(points - seam).min()) for points in samples]
    empty = Part("p", "p.dxf", "mm", (), ())
    job = Job(tour=TourTable(seams=[[seam.real, seam.imag]]))
    (moved,), notes = pin_seams([paths], empty, job)
    assert notes == ()
    for path, drawn, points, distance in zip(moved, paths, samples, distances, strict=True):
        if not path.pinned:
            assert distance >= min(distances) - 0.1
            continue
        assert distance <= min(distances) + 0.1
        start = complex(path.position[0, 0], path.position[0, 1])
        # A seam less than 0.1 mm from a vertex is moved to it. The points are 0.1 mm apart at most.
        assert abs(start - seam) <= distance + 0.2
        assert float(np.abs(points - start).min()) <= 0.1
        assert sum(map(measure_length, list_pieces(path))) == pytest.approx(
            sum(map(measure_length, list_pieces(drawn)))
        )
    assert any(path.pinned for path in moved)


def _sample(path: ToolPath) -> np.ndarray:
    """400 points of each segment of a path, as complex numbers."""
    points: list[complex] = []
    for piece in list_pieces(path):
        points += [find_point(piece, t) for t in np.linspace(0, 1, 400)]
    return np.array(points)


def test_a_tour_of_few_pinned_paths_with_an_order_is_proven_the_shortest() -> None:
    # Three pinned squares in a row, the farthest of them first.
    squares = number_paths([square(20.0 * k, 0.0, 4.0) for k in range(3)])
    row = [replace(path, contours=(path.id,), pinned=True) for path in squares]
    tour = order_paths(row, TourTable("best", order=["c2"]), (0.0, 0.0), True)
    assert [path.id for path in tour.paths] == ["c2", "c1", "c0"]
    assert tour.travel == pytest.approx(80.0)
    assert tour.bound == pytest.approx(80.0, abs=0.01)
    assert len(make_starts(row).row) == 3


def test_the_program_has_the_order_of_the_job(plate: Path) -> None:
    holes = ["c7", "c2", "c6", "c3"]
    result = build_plate(plate, order=holes)
    assert list_ids(result)[:4] == holes
    assert list_ids(result)[-1] == "c1"  # the outline comes after its holes
    everything = [*holes, "c4", "c5", "c1"]
    assert list_ids(build_plate(plate, order=everything, tour={"method": "as-drawn"})) == everything
    # This order takes precedence over that of the layers, which still holds for the other contours.
    assert list_ids(build_plate(plate, order=["c3"], tour={"layers": ["0"]}))[0] == "c3"
    loose = build_plate(plate, order=["c1"], operation={"kind": "follow", "inside_first": False})
    assert list_ids(loose)[0] == "c1"


@pytest.mark.parametrize(
    ("tables", "message"),
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
def test_a_wrong_seam_or_order_is_refused_in_one_line(
    plate: Path, tables: dict[str, object], message: str
) -> None:
    job = {"operation": {"kind": "follow"}, "tool": {"diameter": 4.0}, "tour": tables}
    with pytest.raises(CamgenError) as caught:
        build(plate, post="gcode", job=job)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    "source", ["a 3-D part", "a replay", "a taught program", "curves in space"]
)
@pytest.mark.parametrize("tour", [TourTable(seams=[[0.0, 0.0]]), TourTable(order=["c1"])])
def test_a_source_without_contours_refuses_seams_and_an_order(source: str, tour: TourTable) -> None:
    with pytest.raises(JobError, match=r"tour\.(seams|order)"):
        check_idle(Job(tour=tour), source)


def test_a_seam_on_a_path_is_for_that_path_and_one_on_a_contour_for_all_its_paths(
    plate: Path,
) -> None:
    job = {
        "operation": {"kind": "follow"},
        "operations": [
            {"ids": ["c2"], "tool": "large"},
            {"ids": ["c2"], "finish": 0.0, "tool": "small"},
            {"ids": ["c3"], "tool": "large"},
        ],
        "tools": [{"name": "large", "diameter": 6.0}, {"name": "small", "diameter": 2.0}],
    }
    on_contour = build(plate, post="rapid", job={**job, "tour": {"seams": [[20, 25]]}})
    assert list_starts(on_contour)["0:c2"] == pytest.approx((20.0, 22.0), abs=1e-6)
    assert list_starts(on_contour)["1:c2"] == pytest.approx((20.0, 24.0), abs=1e-6)
    # The second seam is on the path of the small tool. The path of the large tool keeps the first.
    both = build(plate, post="rapid", job={**job, "tour": {"seams": [[20, 25], [16, 20]]}})
    assert list_starts(both)["0:c2"] == pytest.approx((20.0, 22.0), abs=1e-6)
    assert list_starts(both)["1:c2"] == pytest.approx((16.0, 20.0), abs=1e-6)
    assert not [note for note in both.notes if "has no effect" in note.what]
    # If a path has two seams, the nearer one is used, and a note names the other.
    two = build(plate, post="rapid", job={**job, "tour": {"seams": [[51.0, 20.0], [52.0, 20.0]]}})
    assert list_starts(two)["2:c3"] == pytest.approx((52.0, 20.0), abs=1e-6)
    assert [note.what for note in two.notes if "no effect" in note.what] == [
        "tour.seams: [51, 20] has no effect"
    ]


def test_a_seam_on_an_island_is_for_the_pass_around_it_alone(plate: Path) -> None:
    tables = {
        "operation": {"kind": "pocket", "depth": 2.0, "finish": 0.3},
        "tool": {"diameter": 4.0},
        "process": {"spindle": 9000},
    }
    jobs = [camgen.job({**tables, "tour": tour}) for tour in ({}, {"seams": [[25.0, 20.0]]})]
    free, pinned = (camgen.plan(camgen.read(plate, job), job) for job in jobs)
    (held,) = [path for path in pinned.paths if path.pinned]
    assert held.position[0, :2].tolist() == pytest.approx([27.0, 20.0], abs=1e-6)
    # Paths that start with a helix start where there is space for it.
    radii = [path.entry_radius for path in free.paths]
    assert radii == [path.entry_radius for path in pinned.paths]
    assert max(radii) > 0


def test_a_note_names_a_contour_whose_order_differs_from_that_of_the_operations(
    plate: Path,
) -> None:
    rows = [{"ids": ["c2", "c3", "c4"], "kind": "pocket"}, {"ids": ["c5", "c6", "c1"]}]
    job = {"operation": {"kind": "follow"}, "tool": {"diameter": TOOL}, "operations": rows}
    result = build(plate, post="rapid", job={**job, "tour": {"order": ["c6", "c4", "c3"]}})
    run = list(dict.fromkeys(path.contours[0] for path in result.tour.paths))
    assert run[:3] == ["c4", "c3", "c2"]
    assert run[3:] == ["c6", "c5", "c1"]
    notes = [note.what for note in result.notes if note.what.startswith("tour.order")]
    assert notes == ["tour.order: contour c4 is run before c6"]
    kept = build(plate, post="rapid", job={**job, "tour": {"order": ["c4", "c3", "c6"]}})
    assert not [note for note in kept.notes if note.what.startswith("tour.order")]


@pytest.mark.parametrize("tool", [{"symmetric": True}, {}])
def test_an_arm_tour_keeps_seams_and_order(plate: Path, tool: dict[str, object]) -> None:
    job = {
        "cell": {"robot": "IRB 1200", "base_from_work": [450, -60, 0, 0, 0, 0]},
        "operation": {"kind": "trace"},
        "tool": tool,
        "tour": {"seams": [[25.0, 20.0], [50.0, 60.0]], "order": ["c6", "c2"]},
    }
    result = build(plate, post="rapid", job=job)
    assert isinstance(result.tour, ArmTour) == bool(tool)
    assert list_ids(result)[:2] == ["c6", "c2"]
    assert list_starts(result)["c2"] == pytest.approx((25.0, 20.0), abs=1e-6)
    assert list_starts(result)["c1"] == pytest.approx((50.0, 60.0), abs=1e-6)


def test_links_at_working_height_keep_the_seams(plate: Path) -> None:
    result = build_plate(plate, SEAMS, order=["c5"], process={"stay_down": True})
    assert list_ids(result)[0] == "c5"
    assert list_starts(result)["c5"] == pytest.approx(WANTED["c5"], abs=1e-6)


def test_seams_stay_if_other_paths_are_left_out(plate: Path) -> None:
    tour = {"seams": [[15.0, 20.0], [55.0, 40.0]], "order": ["c4", "c6", "c2"]}
    job = camgen.job({"operation": {"kind": "trace"}, "tour": tour})
    # As after a check of the reach: c4 and c6 are left out, and the others are ordered again.
    plan = leave_out_paths(
        camgen.plan(camgen.read(plate, job), job), {"c4": "out of reach", "c6": "out of reach"}
    )
    tour = camgen.order(plan, job)
    assert tour.paths[0].id == "c2"
    assert tour.paths[0].position[0, :2].tolist() == pytest.approx([15.0, 20.0], abs=1e-6)


def test_the_order_may_list_a_thousand_contours() -> None:
    paths: list[ToolPath] = number_paths(
        [circle(7.0 * (k % 50), 7.0 * (k // 50), 2.0) for k in range(1000)]
    )
    paths = [replace(path, contours=(path.id,)) for path in paths]
    order = [path.id for path in reversed(paths)]
    tour = order_paths(paths, TourTable("best", order=order), (0.0, 0.0), True)
    assert [path.id for path in tour.paths] == order
