"""Drawings in black and white: their borders, the tolerance of the simplification, and arcs."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import camgen
from camgen.cli import main
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.plan.border_arcs import Stretches, fit_circles, fit_lines, measure_turns
from camgen.plan.page import place_on_page
from camgen.plan.simplify import simplify, thin_out
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.vision.ink import find_ink, trace_borders

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "image"
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
TRACE = {"operation": {"kind": "trace"}}


def write_picture(tmp_path: Path, picture: np.ndarray) -> Path:
    path = tmp_path / "drawing.png"
    cv2.imwrite(str(path), picture)
    return path


def read_and_simplify(path: Path, **tables: dict[str, object]) -> tuple[Part, Part]:
    """The drawing as it was read, at its size on paper, and its simplified contours."""
    tables = from_mapping({**TRACE, "image": {"mm_per_px": 0.1}, **tables})
    raw = place_on_page(read(path, tables), tables)
    return raw, simplify(raw, tables)


def sample_contours(part: Part, step: float) -> list[np.ndarray]:
    """Points of each contour at most `step` mm from each other, on its arcs within 0.1 um."""
    sampled = []
    for contour in part.contours:
        points, _ = flatten(make_contour_segments([contour]), 1e-4)
        # A thin line may be left with two points, run there and back, which are not a ring.
        end = points[:1] if contour.closed else contour.points[-1:]
        ring = shapely.segmentize(shapely.linestrings(np.concatenate([points, end])), step)
        sampled.append(shapely.get_coordinates(ring))
    return sampled


def measure_deviation(a: Part, b: Part, step: float) -> float:
    """Largest Hausdorff distance between corresponding contours, mm, sampled every `step` mm."""
    worst = 0.0
    for p, q in zip(sample_contours(a, step), sample_contours(b, step), strict=True):
        for points, corners in ((p, q), (q, p)):
            sides = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1))
            _, distances = shapely.STRtree(sides).query_nearest(
                shapely.points(points), return_distance=True, all_matches=False
            )
            assert len(distances) == len(points)
            worst = max(worst, float(distances.max()))
    return worst


def measure_area(points: np.ndarray) -> float:
    """Signed area of a polygon, positive if it runs counter-clockwise with y up."""
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@given(
    arrays(
        np.uint8,
        st.tuples(st.integers(1, 12), st.integers(1, 12)),
        elements=st.sampled_from([0, 255]),
    )
)
def test_borders_enclose_the_ink(pixels: np.ndarray) -> None:
    """A flood fill counts the connected pieces of ink and of paper.

    Each piece of ink has one outer border, and each piece of paper inside of ink is one hole.
    """
    ink = find_ink(pixels, 128.0, False)
    if ink is None:
        assert len(np.unique(pixels)) == 1
        return
    borders = trace_borders(ink)
    pieces = cv2.connectedComponents(ink.pixels.astype(np.uint8), connectivity=8)[0] - 1
    papers = cv2.connectedComponents((~ink.pixels).astype(np.uint8), connectivity=4)[0] - 1
    # v runs down: an outer border, counter-clockwise with y up, has a negative area here.
    areas = [measure_area(border) for border in borders]
    assert sum(a < 0 for a in areas) == pieces
    assert sum(a > 0 for a in areas) == papers - 1
    rows, columns = np.nonzero(ink.pixels)
    union = shapely.polygons(borders[0])
    for border in borders[1:]:
        union = union.symmetric_difference(shapely.polygons(border).buffer(0))
    assert all(shapely.intersects_xy(union.buffer(1e-9), columns, rows))


def test_grey_values_give_the_place_of_an_edge_within_a_pixel() -> None:
    # A half plane covers 30 % of the pixels of column 4.
    # Its edge lies 0.2 px left of the centre of that column.
    pixels = np.full((6, 9), 255, np.uint8)
    pixels[:, :4] = 0
    pixels[:, 4] = round(255 * 0.7)
    ink = find_ink(pixels, None, False)
    assert ink is not None
    border = trace_borders(ink)[0]
    right = border[(border[:, 0] > 3) & (border[:, 1] > 1) & (border[:, 1] < 6)]
    # A margin of one pixel of paper lies around the picture.
    # Linear interpolation between the centres of pixels is exact to a tenth of a pixel.
    assert np.abs(right[:, 0] - 1 - 3.8).max() < 0.1


def test_the_ink_is_the_side_without_the_border_unless_it_is_inverted(tmp_path: Path) -> None:
    pixels = np.full((40, 40), 255, np.uint8)
    pixels[10:30, 10:30] = 0
    for picture, job, count in [
        (pixels, {}, 1),
        (255 - pixels, {}, 1),
        (pixels, {"image": {"invert": True, "mm_per_px": 0.1}}, 2),
    ]:
        raw, _ = read_and_simplify(write_picture(tmp_path, picture), **job)
        assert len(raw.contours) == count


def test_ink_that_runs_into_the_border_is_closed_there(tmp_path: Path) -> None:
    pixels = np.full((40, 60), 255, np.uint8)
    pixels[:, 20:30] = 0
    _, drawn = read_and_simplify(write_picture(tmp_path, pixels))
    (contour,) = drawn.contours
    # The lower and the upper edge of the picture, 40 px of 0.1 mm apart.
    assert contour.points[:, 1].min() == pytest.approx(0.0, abs=0.06)
    assert contour.points[:, 1].max() == pytest.approx(4.0, abs=0.06)
    assert len(contour.points) == 4


def test_a_disc_becomes_two_arcs_of_its_radius(tmp_path: Path) -> None:
    v, u = np.mgrid[0:200, 0:200]
    for radius in (8.0, 33.3, 80.0):
        pixels = np.where(np.hypot(u - 99.7, v - 100.2) <= radius, 0, 255).astype(np.uint8)
        _, drawn = read_and_simplify(write_picture(tmp_path, pixels))
        (contour,) = drawn.contours
        assert contour.bulges.tolist() == [1.0, 1.0]
        assert np.hypot(*(contour.points[0] - contour.points[1])) / 2 == pytest.approx(
            radius / 10, abs=0.03
        )


def test_a_rotated_square_becomes_four_lines_with_sharp_corners(tmp_path: Path) -> None:
    pixels = np.full((300, 300), 255, np.uint8)
    corners = np.array(
        [[150 + 110 * np.cos(t), 150 + 110 * np.sin(t)] for t in 0.2 + np.pi / 2 * np.arange(4)]
    )
    v, u = np.mgrid[0:300, 0:300]
    inside = np.ones(pixels.shape, dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0]) >= 0
    pixels[inside] = 0
    _, drawn = read_and_simplify(write_picture(tmp_path, pixels))
    (contour,) = drawn.contours
    corners_px = np.column_stack(
        [contour.points[:, 0] * 10 - 0.5, 299.5 - contour.points[:, 1] * 10]
    )
    assert len(corners_px) == 4
    deviations = np.hypot(*(corners_px[:, None] - corners).transpose(2, 0, 1)).min(axis=0)
    assert deviations.max() < 0.8  # px, because no pixel shows the whole corner of 90 deg


@given(
    arrays(np.uint8, (14, 14), elements=st.sampled_from([0, 255])),
    st.sampled_from([0.02, 0.05, 0.1, 0.3]),
)
def test_the_drawing_deviates_from_the_border_by_the_tolerance_at_most(
    pixels: np.ndarray, tolerance: float
) -> None:
    """Noise is the hardest case, because every pixel is a corner."""
    ink = find_ink(
        cv2.resize(pixels, None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST), 128.0, False
    )
    if ink is None:
        return
    contours = tuple(
        Contour(frozen(b * [0.1, -0.1]), frozen(np.zeros(len(b))), True, "0", f"c{k}")
        for k, b in enumerate(trace_borders(ink))
    )
    raw = Part("a", "a.png", "mm", contours, ())
    drawn = Part("a", "a.png", "mm", thin_out(contours, tolerance, fits_arcs=True), ())
    assert measure_deviation(raw, drawn, 0.02) <= tolerance + 1e-3


@pytest.mark.skipif(not SHARED.exists(), reason="the shared data set is not beside the repository")
@pytest.mark.parametrize(
    "name", ["DeepPCB/00041000_temp.jpg", "mexopencv/bw.png", "scikit-image/horse.png"]
)
def test_drawings_of_real_pictures_keep_the_tolerance(name: str) -> None:
    raw, drawn = read_and_simplify(SHARED / name)
    assert measure_deviation(raw, drawn, 0.02) <= 0.1 + 1e-3
    assert sum(len(c.points) for c in drawn.contours) < sum(len(c.points) for c in raw.contours) / 5


def test_a_contour_is_simplified_without_regard_to_the_others() -> None:
    """All contours are processed together: noise, a circle, open lines, a line there and back."""
    noise = cv2.resize(
        np.random.default_rng(5).integers(0, 2, (30, 30), np.uint8) * 255, None, fx=4, fy=4
    )
    ink = find_ink(noise, 128.0, False)
    assert ink is not None
    t = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    lines = [
        (np.column_stack([30 * np.cos(t), 30 * np.sin(t)]), True),
        *((b.astype(float), True) for b in trace_borders(ink)),
        (np.column_stack([t * 9, 8 * np.sin(t)]), False),
        (np.array([[0.0, 0.0], [5.0, 0.0]]), True),
        (np.array([[0.0, 0.0], [5.0, 0.0]]), False),
    ]
    contours = [
        Contour(frozen(p), frozen(np.zeros(len(p))), c, "0", f"c{k}")
        for k, (p, c) in enumerate(lines)
    ]
    for group in (contours, contours[::-1], contours[:1]):
        together = thin_out(group, 1.0, fits_arcs=True)
        for contour, thinned in zip(group, together, strict=True):
            (alone,) = thin_out([contour], 1.0, fits_arcs=True)
            assert thinned.id == contour.id
            np.testing.assert_array_equal(thinned.points, alone.points)
            np.testing.assert_array_equal(thinned.bulges, alone.bulges)
    assert sum(bool(c.bulges.any()) for c in together) == 1
    several = thin_out(contours, 1.0, fits_arcs=True)
    assert len(several) > 10
    assert 3 < sum(bool(c.bulges.any()) for c in several) < len(several)


def test_circles_and_lines_are_recovered_from_their_points() -> None:
    t = np.linspace(0.0, 1.0, 40)
    centre, radius, turn = (
        np.array([3 + 4j, -200 + 7j, 1 - 1j]),
        np.array([5.0, 90.0, 12.0]),
        np.array([2.0, -0.5, 6.0]),
    )
    line = (centre[:, None] + radius[:, None] * np.exp(1j * turn[:, None] * t)).ravel()
    line = np.append(line, np.arange(6) * (2 + 1j))
    low = np.array([0, 40, 80, 120])
    stretches = Stretches.between(line, low, np.array([39, 79, 119, 125]))
    centres, radii, deviations = fit_circles(stretches)
    np.testing.assert_allclose(centres[:3], centre, atol=1e-9)
    np.testing.assert_allclose(radii[:3], radius, atol=1e-9)
    # A chord over the angle turn / 39 deviates by r (1 - cos(turn / 78)).
    # The approximation chord^2 / 8 r differs from it by the fraction (turn / 78)^2 / 4.
    np.testing.assert_allclose(deviations[:3], radius * (1 - np.cos(turn / 78)), rtol=2e-3)
    assert np.isnan(deviations[3])
    np.testing.assert_allclose(measure_turns(stretches, centre[[0, 1, 2, 0]])[:3], turn, atol=1e-9)
    middles, directions, line_deviations = fit_lines(stretches)
    assert (directions[3] / (2 + 1j)).imag == pytest.approx(0.0, abs=1e-12)
    assert middles[3] == pytest.approx(5 + 2.5j)
    assert line_deviations[3] == pytest.approx(0.0, abs=1e-12)
    assert line_deviations[0] > 1.0
    alone = fit_circles(Stretches.single(line[40:80]))
    np.testing.assert_allclose(
        [alone[0][0], alone[1][0], alone[2][0]], [centres[1], radii[1], deviations[1]], rtol=1e-9
    )


def test_points_of_lines_are_thinned_out_on_demand_and_arcs_stay() -> None:
    t = np.linspace(0, 3, 400)
    points = np.concatenate([np.column_stack([t * 10, np.sin(t * 3)]), [[31.0, 0.0], [33.0, 0.0]]])
    bulges = np.zeros(len(points))
    bulges[-2] = 0.5
    part = Part(
        "a", "a.dxf", "mm", (Contour(frozen(points), frozen(bulges), False, "0", "c1"),), ()
    )
    assert simplify(part, from_mapping({})).contours is part.contours
    (thin,) = simplify(part, from_mapping({"tolerance": {"simplify": 0.05}})).contours
    assert len(thin.points) < 40
    assert thin.bulges[-2] == 0.5
    line = shapely.linestrings(thin.points[:-1])
    assert shapely.distance(shapely.points(points[:-1]), line).max() <= 0.05 + 1e-12


def test_short_contours_are_left_out_and_counted() -> None:
    zeros = frozen([0.0, 0.0])
    long, short = frozen([[0.0, 0.0], [3.0, 4.0]]), frozen([[0.0, 0.0], [0.3, 0.4]])
    contours = (Contour(long, zeros, False, "0", "c1"), Contour(short, zeros, False, "0", "c2"))
    part = Part("a", "a.dxf", "mm", contours, ())
    kept = simplify(part, from_mapping({"input": {"min_length": 0.6}}))
    assert [c.id for c in kept.contours] == ["c1"]
    assert [str(n) for n in kept.notes] == [
        "skipped: 1 contour shorter than 0.6 mm (input.min_length)"
    ]


def test_a_picture_without_ink_or_without_scale_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no ink"):
        read_and_simplify(write_picture(tmp_path, np.full((9, 9), 200, np.uint8)))
    drawing = np.full((9, 9), 255, np.uint8)
    drawing[3:6, 3:6] = 0
    path = write_picture(tmp_path, drawing)
    with pytest.raises(InputError, match=r"has no scale; give \[page\] size to draw it on paper"):
        read(path, from_mapping(TRACE))
    with pytest.raises(JobError, match="has no effect on a drawing"):
        read(path, from_mapping({**TRACE, "image": {"min_area": 3.0}}))
    with pytest.raises(JobError, match="gives the scale"):
        read(path, from_mapping({**TRACE, "image": {"width_mm": 3.0}, "page": {"size": "A4"}}))


def test_a_picture_on_a_page_needs_no_scale_and_its_mask_is_placed_with_it(tmp_path: Path) -> None:
    drawing = np.full((20, 30), 255, np.uint8)
    drawing[5:15, 10:20] = 0
    job = from_mapping({**TRACE, "page": {"size": [100, 60], "margin": 5}})
    part = place_on_page(read(write_picture(tmp_path, drawing), job), job)
    # 10 px on 50 mm, in the middle of the page.
    assert part.units == "5 mm/px"
    assert part.contours[0].points.min(axis=0).tolist() == pytest.approx([25, 5])
    raster = part.raster
    assert raster is not None
    v, u = np.nonzero(raster.mask)
    middle = raster.work_from_view @ (u.mean(), v.mean(), 1.0)
    assert middle.tolist() == pytest.approx([50, 30])


def test_inspect_lists_the_strokes_of_a_drawing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawing = np.full((20, 30), 255, np.uint8)
    drawing[5:15, 10:20] = 0
    path = write_picture(tmp_path, drawing)
    on_page = ["--set", "page.size=[100, 60]", "--set", "page.margin=5", "-q"]
    assert main(["inspect", str(path), *on_page]) == 0
    output = capsys.readouterr().out
    # A square of 10 px on 50 mm.
    assert output.startswith(
        "picture of 30 x 20 px, taken as a drawing\nscale: 5 mm/px, drawing 50 x 50 mm\n"
    )
    assert (
        "strokes: 1, all closed, of 4 lines and 0 arcs; 200 mm in all, the shortest 200 mm\n"
        in output
    )
    fill = ["--set", "operation.kind=fill", "--set", "tool.diameter=0.8"]
    assert main(["inspect", str(path), *on_page, *fill]) == 0
    output = capsys.readouterr().out
    assert "borders of the ink: 1, all closed, of 4 lines and 0 arcs" in output
    assert "\nfilled with a pen of 0.8 mm (tool.diameter)\n" in output
    # The same job can be built. Without a page, inspect asks for one.
    program = str(tmp_path / "square.ngc")
    assert main(["build", str(path), "--post", "gcode", *on_page, "-o", program]) == 0
    assert main(["inspect", str(path)]) == 0
    assert "give [page] size to draw it on paper" in capsys.readouterr().out


def test_small_squares_stay_squares_and_small_discs_become_circles(tmp_path: Path) -> None:
    drawing = np.full((60, 300), 255, np.uint8)
    v, u = np.mgrid[0:60, 0:300]
    for k in range(7):
        drawing[10 : 16 + k, 10 + 40 * k : 16 + 41 * k] = 0
        drawing[np.hypot(u - 20.3 - 40 * k, v - 40.4) <= 4 + 0.7 * k] = 0
    _, thin = read_and_simplify(write_picture(tmp_path, drawing), image={"mm_per_px": 1.0})
    in_reading_order = sorted(
        thin.contours, key=lambda c: (c.points[:, 1].mean() < 30, c.points[:, 0].mean())
    )
    squares, discs = in_reading_order[:7], in_reading_order[7:]
    assert len(discs) == 7
    for k, square in enumerate(squares):
        assert (len(square.points), int((square.bulges != 0).sum())) == (4, 0), k
    for k, disc in enumerate(discs):
        assert disc.bulges.tolist() == [1.0, 1.0]
        assert np.hypot(*(disc.points[1] - disc.points[0])) / 2 == pytest.approx(
            4 + 0.7 * k, abs=0.5
        )


@pytest.mark.parametrize("name", ["gear.png", "board.png"])
def test_a_drawing_has_the_same_lines_and_arcs_at_every_scale(name: str) -> None:
    """Pixels decide, so a difference in the last digit of a distance in mm does not matter."""
    drawings = []
    for scale in (0.1, 0.11574, 0.115741, 0.3, 7.0):
        job = from_mapping({**TRACE, "image": {"mm_per_px": scale}})
        drawings.append(simplify(read(PARTS / name, job), job).contours)
        for first, scaled in zip(drawings[0], drawings[-1], strict=True):
            assert np.allclose(first.points / 0.1, scaled.points / scale, atol=1e-4)
            assert np.allclose(first.bulges, scaled.bulges, atol=1e-6)


def sketch() -> tuple[np.ndarray, np.ndarray]:
    """A picture, and the points along its line and its arc, px.

    It shows a line and an arc of 4 px, the letters N and L of 3 px, and a solid square.
    """
    finer, pixels = 4, np.full((1200, 1600), 255, np.uint8)
    t = np.linspace(0, 1.5 * np.pi, 400)
    arc = np.column_stack([300 + 60 * np.cos(t), 90 + 60 * np.sin(t)])
    line = np.column_stack([np.linspace(40, 200, 400), np.linspace(30, 130, 400)])
    for points in (arc, line):
        steps = np.round((points + 0.5) * finer - 0.5).astype(np.int32)
        cv2.polylines(pixels, [steps], False, 0, 4 * finer)
    for letter in (
        [(60, 240), (60, 200), (80, 240), (80, 200)],
        [(100, 200), (100, 240), (120, 240)],
    ):
        cv2.polylines(pixels, [np.array(letter, np.int32) * finer], False, 0, 3 * finer)
    cv2.rectangle(pixels, (1100, 760), (1400, 1060), 0, cv2.FILLED)
    small = cv2.resize(pixels, (400, 300), interpolation=cv2.INTER_AREA)
    return small, np.concatenate([arc, line])


def measure_length(part: Part) -> float:
    """Sum of the lengths of all contours, mm."""
    return float(make_contour_segments(part.contours).length.sum())


def test_thin_lines_and_lettering_are_drawn_once_along_their_middle(tmp_path: Path) -> None:
    picture, middle = sketch()
    path = write_picture(tmp_path, picture)
    parts = {}
    for lines in ("auto", "border", "centre"):
        parts[lines] = read_and_simplify(path, image={"mm_per_px": 1.0, "lines": lines})[1]
    # The square keeps its border of 4 x 75 px. All other strokes are drawn on one line, not on two.
    around = 4 * 75
    once, twice = measure_length(parts["auto"]) - around, measure_length(parts["border"]) - around
    assert 0.4 * twice < once < 0.52 * twice
    closed = [c for c in parts["auto"].contours if c.closed]
    assert len(closed) == 1
    assert any(
        "drawn once, along the middle, 1 piece along the border" in n.what
        for n in parts["auto"].notes
    )
    assert all(c.closed for c in parts["border"].contours)
    # The drawn lines deviate by less than a pixel.
    # At each end up to half of the line width of 4 px is missing.
    matrix = parts["auto"].raster.work_from_view
    drawn = shapely.union_all(
        [shapely.linestrings(points) for points in sample_contours(parts["auto"], 1.0)]
    )
    wanted = (middle + 1) @ matrix[:, :2].T + matrix[:, 2]
    deviations = shapely.distance(shapely.points(wanted), drawn)
    assert deviations.max() < 2.6
    assert np.sqrt((deviations**2).mean()) < 0.5


def test_a_dot_keeps_its_border(tmp_path: Path) -> None:
    picture = np.full((100, 100), 255, np.uint8)
    cv2.circle(picture, (50, 50), 20, 0, cv2.FILLED)
    part = read_and_simplify(
        write_picture(tmp_path, picture), image={"mm_per_px": 1.0, "lines": "centre"}
    )[1]
    assert [c.closed for c in part.contours] == [True]
    assert measure_length(part) == pytest.approx(2 * np.pi * 20, rel=0.03)


@pytest.mark.parametrize("kind", ["fill", "drill", "follow"])
def test_the_setting_of_lines_is_refused_if_the_drawing_is_not_traced(
    tmp_path: Path, kind: str
) -> None:
    picture, _ = sketch()
    job = from_mapping(
        {"operation": {"kind": kind}, "image": {"mm_per_px": 1.0, "lines": "centre"}}
    )
    with pytest.raises(JobError, match="lines: has no effect"):
        read(write_picture(tmp_path, picture), job)


def test_the_tolerance_is_a_third_of_a_pixel_for_grey_borders_and_one_for_two_values(
    tmp_path: Path,
) -> None:
    y, x = np.mgrid[:200, :200]
    grey = np.clip(np.hypot(x - 99.5, y - 99.5) - 60 + 0.5, 0, 1) * 255
    tolerances = {}
    for name, picture in (("grey", grey), ("two", np.where(grey < 128, 0, 255))):
        file = tmp_path / f"{name}.png"
        cv2.imwrite(str(file), picture.astype(np.uint8))
        job = {"page": {"size": [120.0, 120.0], "margin": 0.0}}
        result = camgen.build(file, post="gcode", job=job)
        (note,) = [note for note in result.notes if "thinned out" in note.what]
        tolerances[name] = float(note.why.split("= ")[1].split(" ")[0]) / (120 / 121)
    # The disc is 120 px wide and fills the page.
    assert tolerances["grey"] == pytest.approx(1 / 3, rel=0.02)
    assert tolerances["two"] == pytest.approx(1.0, rel=0.02)
