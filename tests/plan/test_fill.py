"""Filling: GEOS measures the ink of the strokes, without the picture of the planner."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

import camgen
from bench.plan.boards import GOALS, board, part_of
from camgen.geometry.arcs import measure_path
from camgen.geometry.rings import make_rings
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath
from camgen.model.pose import frozen
from camgen.plan import Plan, plan
from camgen.plan.fill import fill
from camgen.plan.fill.cover import measure_areas, paint
from camgen.read import read
from camgen.read.job_file import from_mapping

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "image" / "DeepPCB"


def make_job(diameter: float, **operation: object) -> Job:
    return from_mapping(
        {"operation": {"kind": "fill", **operation}, "tool": {"diameter": diameter}}
    )


def loop(
    points: list[tuple[float, float]], layer: str = "0", bulge: float = 0.0, closed: bool = True
) -> Contour:
    return Contour(frozen(points), frozen(np.full(len(points), bulge)), closed, layer, "c")


def rectangle(x: float, y: float, wide: float, tall: float, layer: str = "0") -> Contour:
    return loop([(x, y), (x + wide, y), (x + wide, y + tall), (x, y + tall)], layer)


def circle(x: float, y: float, radius: float, layer: str = "0") -> Contour:
    return loop([(x - radius, y), (x + radius, y)], layer, 1.0)


def part_with(*contours: Contour) -> Part:
    return Part("part", "part.dxf", "mm", contours, ())


def plan_fill(part: Part, diameter: float, **operation: object) -> Plan:
    return plan(part, make_job(diameter, **operation))


def sample_path(path: ToolPath) -> np.ndarray:
    """Points along a path, (N, 2), each arc as 64 chords of the circle through its three points."""
    points = path.position[:1, :2] @ [1, 1j]
    for start, via, end in zip(path.position, path.via[1:], path.position[1:], strict=False):
        a, v, b = (complex(p[0], p[1]) for p in (start, via, end))
        if np.isnan(v):
            points = np.append(points, b)
            continue
        # The centre is the intersection of the bisectors of the two chords.
        # Each half of the arc has a sweep below 180 deg.
        p, q = v - a, b - v
        along = (((b - a) / 2) * q.conjugate()).real / ((1j * p) * q.conjugate()).real
        centre = a + p / 2 + 1j * p * along
        turn = np.angle((v - centre) / (a - centre)) + np.angle((b - centre) / (v - centre))
        points = np.append(
            points, centre + (a - centre) * np.exp(1j * turn * np.arange(1, 65) / 64)
        )
    return np.column_stack([points.real, points.imag])


def ink_area(paths: tuple[ToolPath, ...], diameter: float) -> shapely.Geometry:
    """Area that a marker of this diameter inks along the paths."""
    lines = [
        shapely.LineString(sample_path(p))
        if len(p.position) > 1
        else shapely.Point(p.position[0, :2])
        for p in paths
    ]
    return shapely.union_all([line.buffer(diameter / 2, quad_segs=32) for line in lines])


def measure_shares(
    paths: tuple[ToolPath, ...], diameter: float, copper: shapely.Geometry
) -> tuple[float, float]:
    """Area of copper with ink and area of ink without copper, as fractions of the copper."""
    painted_ = ink_area(paths, diameter)
    covered, outside = painted_.intersection(copper).area, painted_.difference(copper).area
    return covered / copper.area, outside / copper.area


def find_copper(part: Part) -> shapely.Geometry:
    """Copper of a board: the area within an odd number of borders in the picture, mm."""
    assert part.raster is not None
    matrix = part.raster.work_from_view
    result = shapely.Polygon()
    for border in part.raster.borders:
        outline = shapely.Polygon(border @ matrix[:, :2].T + matrix[:, 2])
        result = result.symmetric_difference(outline)
    return result


def test_a_plate_with_a_hole_is_covered_and_the_hole_stays_free() -> None:
    part = part_with(rectangle(0, 0, 40, 25), circle(20, 12, 6))
    paths = plan_fill(part, 0.85).paths
    copper = shapely.box(0, 0, 40, 25).difference(shapely.Point(20, 12).buffer(6, quad_segs=64))
    covered, outside = measure_shares(paths, 0.85, copper)
    assert covered > 0.998
    assert outside < 0.0005
    # Every stroke keeps the radius of the marker from the borders, up to a tolerance.
    border = copper.boundary
    nearest = min(
        border.distance(shapely.LineString(sample_path(p))) for p in paths if len(p.position) > 1
    )
    assert nearest > 0.425 - 0.02
    assert all((p.force_direction == 0).all() and (p.position[:, 2] == 0).all() for p in paths)


def test_the_passes_of_a_region_and_its_bridges_are_one_closed_stroke() -> None:
    plates = [
        rectangle(0, 0, 40, 25),
        circle(20, 12, 6),
        rectangle(40.5, 0, 12, 9),
        circle(60, 20, 2.2),
    ]
    paths = tuple(p for p in plan_fill(part_with(*plates), 0.85).paths if p.id.startswith("f"))
    assert [p.closed for p in paths] == [True] * 3
    assert all((p.position[0] == p.position[-1]).all() for p in paths)
    copper = shapely.union_all([
        shapely.box(0, 0, 40, 25).difference(shapely.Point(20, 12).buffer(6, quad_segs=64)),
        shapely.box(40.5, 0, 52.5, 9), shapely.Point(60, 20).buffer(2.2, quad_segs=64),
    ])  # fmt: skip
    covered, outside = measure_shares(paths, 0.85, copper)
    assert covered > 0.99
    assert outside < 0.0005
    # A bridge is run there and back, and it is as long as the distance of two passes.
    length = sum(shapely.LineString(sample_path(p)).length for p in paths)
    assert length * 0.595 < 1.05 * copper.area


def test_an_island_in_a_hole_is_covered() -> None:
    part = part_with(rectangle(0, 0, 30, 30), rectangle(5, 5, 20, 20), rectangle(10, 10, 10, 10))
    box = shapely.box
    copper = box(0, 0, 30, 30).difference(box(5, 5, 25, 25)).union(box(10, 10, 20, 20))
    covered, outside = measure_shares(plan_fill(part, 1.0).paths, 1.0, copper)
    assert covered > 0.995
    assert outside < 0.001


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 4])
def test_a_track_thinner_than_the_marker_is_one_stroke_along_its_middle(turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    corners = [
        (c * x - s * y, s * x + c * y) for x, y in ((0, -0.25), (20, -0.25), (20, 0.25), (0, 0.25))
    ]
    (path,) = plan_fill(part_with(loop(corners)), 0.85).paths
    along = path.position[:, :2] @ [c, s]
    across = path.position[:, :2] @ [-s, c]
    assert np.abs(across).max() < 0.03
    # The round end of the ink reaches the end of the track and up to 0.04 mm beyond it.
    for reach in (0.425 - along.min(), along.max() + 0.425 - 20):
        assert 0.0 <= reach <= 0.04
    assert not path.closed


@pytest.mark.parametrize("width", [0.85, 0.87, 0.95, 1.0, 1.2, 1.45, 1.7, 2.3, 2.9])
def test_tracks_of_any_width_from_the_marker_on_are_covered(width: float) -> None:
    paths = plan_fill(part_with(rectangle(0, 0, 30, width)), 0.85).paths
    covered, outside = measure_shares(paths, 0.85, shapely.box(0, 0, 30, width))
    assert covered > 0.98
    assert outside < 0.01


def test_a_track_between_two_pads_meets_their_passes() -> None:
    lower = [(0, 0), (4, 0), (4, 1.8), (16, 1.8), (16, 0), (20, 0)]
    upper = [(20, 4), (16, 4), (16, 2.3), (4, 2.3), (4, 4), (0, 4)]
    result = plan_fill(part_with(loop(lower + upper)), 0.85)
    assert ink_area(result.paths, 0.85).geom_type == "Polygon"
    assert len([p for p in result.paths if p.id.startswith("m")]) == 1
    assert "1 by both" in result.notes[0].what


def test_the_corners_of_a_square_pad_around_its_hole_are_touched() -> None:
    paths = plan_fill(part_with(rectangle(0, 0, 2.0, 2.0), circle(1.0, 1.0, 0.3)), 0.85).paths
    copper = shapely.box(0, 0, 2.0, 2.0).difference(
        shapely.Point(1.0, 1.0).buffer(0.3, quad_segs=64)
    )
    lines = tuple(path for path in paths if not path.id.startswith("r"))
    before, after = (measure_shares(strokes, 0.85, copper) for strokes in (lines, paths))
    assert len(paths) - len(lines) == 4
    assert after[0] > before[0] + 0.05
    assert after[1] - before[1] < (after[0] - before[0]) / 2


def test_an_island_smaller_than_the_marker_is_one_touch() -> None:
    (path,) = plan_fill(part_with(circle(5, 7, 0.3)), 0.85).paths
    assert path.position.shape == (1, 3)
    assert path.position[0, :2] == pytest.approx([5, 7], abs=0.01)


@pytest.mark.parametrize("diameter", [0.85, 0.3])
def test_rendered_boards_meet_the_goals(diameter: float) -> None:
    # Every track is wider than the marker, so all ink outside of the copper counts.
    part = part_of(board(700, 5, plane=True, widths=(0.9, 1.2, 2.0)))
    check_goals(part, diameter)


def check_goals(part: Part, diameter: float) -> None:
    covered, outside = measure_shares(plan_fill(part, diameter).paths, diameter, find_copper(part))
    smallest_covered, largest_outside = GOALS[diameter]
    assert covered >= smallest_covered
    assert outside <= largest_outside


def test_the_reported_coverage_is_that_measured_by_geos() -> None:
    part = part_of(board(600, 6, plane=False))
    paths, _, areas = fill(part, make_job(0.85))
    copper = find_copper(part)
    covered, outside = measure_shares(paths, 0.85, copper)
    assert areas.copper == pytest.approx(copper.area, rel=1e-3)
    assert areas.covered / areas.copper == pytest.approx(covered, abs=1e-3)
    assert (areas.outside + areas.thin) / areas.copper == pytest.approx(outside, abs=1e-3)
    assert areas.thin > 0


def test_the_coverage_of_a_stroke_and_a_touch_is_that_of_their_formulas() -> None:
    square = np.array([0, 10, 10 + 10j, 10j])
    stroke, touch = np.array([5 + 5j, 15 + 5j]), np.array([2 + 0j])
    areas = measure_areas(make_rings([4]), square, [stroke], [touch], 1.0)
    assert areas.copper == pytest.approx(100, rel=2e-3)
    # The stroke is a capsule of radius 1. Half of it is inside, and half of the disc of the touch.
    assert areas.covered == pytest.approx(10 + np.pi / 2 + np.pi / 2, rel=5e-3)
    assert areas.outside == pytest.approx(10 + np.pi / 2, rel=5e-3)
    assert areas.thin == pytest.approx(np.pi / 2, rel=2e-2)


def test_painted_pixels_are_those_within_the_radius() -> None:
    random = np.random.default_rng(1)
    start = random.uniform(10, 90, 40) + 1j * random.uniform(10, 90, 40)
    end = start + random.normal(0, 9, 40) + 1j * random.normal(0, 9, 40)
    end[:8] = start[:8]
    end[8:16] = start[8:16] + random.uniform(-9, 9, 8)
    end[16:24] = start[16:24] + 1j * random.uniform(-9, 9, 8)
    v, u = np.mgrid[:100, :100]
    points = shapely.points(u, v)
    lines = shapely.linestrings(
        [[(a.real, a.imag), (b.real, b.imag + 1e-9)] for a, b in zip(start, end, strict=True)]
    )
    expected = shapely.distance(points, shapely.multilinestrings(lines)) <= 4.3
    assert ((paint(start, end, 4.3, (100, 100)) > 0) == expected).all()


def test_regions_keep_their_layers_and_a_note_counts_open_contours() -> None:
    part = part_with(
        rectangle(0, 0, 10, 10, "top"),
        circle(5, 5, 2, "holes"),
        rectangle(20, 0, 5, 5, "pads"),
        loop([(0, 40), (30, 40)], closed=False),
    )
    result = plan_fill(part, 1.0)
    left = {p.layer for p in result.paths if p.position[0, 0] < 15}
    right = {p.layer for p in result.paths if p.position[0, 0] > 15}
    assert left == {"top"}
    assert right == {"pads"}
    assert [n.what for n in result.notes if n.kind == "skipped"] == ["1 open contour not filled"]
    assert len({p.id for p in result.paths}) == len(result.paths)


def test_the_stepover_is_the_distance_of_the_passes() -> None:
    part = part_with(rectangle(0, 0, 20, 20))
    for stepover in (0.5, 0.9):
        loops = [p for p in plan_fill(part, 1.0, stepover=stepover).paths if p.id.startswith("f")]
        across = shapely.LineString([(10.13, 0), (10.13, 9)])
        met = [
            shapely.get_coordinates(shapely.LineString(sample_path(p)).intersection(across))[:, 1]
            for p in loops
        ]
        assert np.diff(np.sort(np.concatenate(met)))[:8] == pytest.approx([stepover] * 8, abs=0.02)
        assert np.concatenate(met).min() == pytest.approx(0.5, abs=0.01)


def test_strokes_have_the_depths_and_the_force_of_the_job() -> None:
    job = from_mapping(
        {"operation": {"kind": "fill", "depth": 0.4, "passes": 2}, "process": {"force": 3.0}}
    )
    paths = plan(part_with(rectangle(0, 0, 30, 20)), job).paths
    assert paths
    for path in paths:
        assert path.depths == (0.2, 0.4)
        assert (path.force == 3.0).all()
        assert (path.force_direction == [0, 0, -1]).all()


def test_a_drawing_that_cannot_be_filled_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match="no closed contour to fill"):
        plan_fill(part_with(loop([(0, 0), (10, 0)], closed=False)), 1.0)
    with pytest.raises(JobError, match="too small for a drawing of 3000 x 3000 mm"):
        plan_fill(part_with(rectangle(0, 0, 3000, 3000)), 0.5)
    wide = np.zeros((6400, 6400), dtype=np.uint8)
    wide[100:110, 100:120] = 255
    with pytest.raises(JobError, match="px of the picture"):
        plan_fill(part_of(wide), 0.1)


def test_programs_of_fills_are_read_back_and_have_no_leads(tmp_path: Path) -> None:
    picture = tmp_path / "board.png"
    cv2.imwrite(str(picture), 255 - board(500, 2, plane=False))
    job = {
        "operation": {"kind": "fill", "overlap": 2.0, "lead_in": 1.0},
        "tool": {"diameter": 0.85},
        "image": {"mm_per_px": 25.4 / 300},
    }
    for post in ("vplus", "gcode", "rapid"):
        result = camgen.build(picture, post=post, job=job)
        assert result.deviation.max_mm < 0.001
        assert result.coverage is not None
        assert result.report["coverage"]["covered_percent"] == pytest.approx(
            100 * result.coverage.covered / result.coverage.copper, abs=1e-3
        )
        # Leads and overlaps belong to paths along contours, so the strokes are not longer.
        plain = plan(result.part, result.job).paths
        assert sum(measure_path(p) for p in result.tour.paths) == pytest.approx(
            sum(measure_path(p) for p in plain), abs=1e-6
        )


@pytest.mark.skipif(not SHARED.is_dir(), reason="shared board pictures are not there")
@pytest.mark.parametrize("name", ["00041000_temp.jpg", "00041002_temp.jpg", "20085001_temp.jpg"])
def test_real_boards_meet_the_goals(name: str) -> None:
    scale = {"operation": {"kind": "fill"}, "image": {"mm_per_px": 25.4 / 300}}
    part = read(SHARED / name, from_mapping(scale))
    for diameter in GOALS:
        check_goals(part, diameter)


def test_a_tool_of_millions_of_pixels_draws_a_thin_bar_as_one_stroke(tmp_path: Path) -> None:
    """The length of averages is limited to the longest stroke, which is 60 px here."""
    picture = np.full((60, 90), 255, np.uint8)
    picture[28:32, 15:75] = 0
    cv2.imwrite(str(tmp_path / "bar.png"), picture)
    job = {"operation": {"kind": "fill"}, "image": {"mm_per_px": 1e-6}}
    result = camgen.build(tmp_path / "bar.png", post="gcode", job=job)
    assert len(result.tour.paths) == 1
