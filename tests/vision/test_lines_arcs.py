"""Outlines become lines and arcs: closed, in mm, in the right direction, as they were drawn."""

import math

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from camgen.geometry.rings import make_rings
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.errors import InputError
from camgen.model.part import Contour
from camgen.vision.lines_arcs.contours import OutlineFit, make_contours
from camgen.vision.lines_arcs.fit import fit_circles, fit_lines, join_sums, move_sums, sum_runs
from camgen.vision.lines_arcs.noise import measure
from camgen.vision.lines_arcs.polish import FittedChain, make_no_fillets, measure_from_arcs, polish
from camgen.vision.lines_arcs.runs import Runs
from camgen.vision.lines_arcs.spots import make_sound
from camgen.vision.outline import Outline, find_outlines
from tests.support.outline_pictures import (
    Drawn,
    disc,
    drawn,
    gear,
    mask_of,
    picture,
    plate,
    with_holes,
)
from tests.support.rounding import rounding_bound

#: A view with 1 mm per pixel and y up.
PIXELS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def trace(
    part: Drawn, height: int, width: int, blur: float = 0.7, noise: float = 2.0
) -> tuple[Outline, ...]:
    """Outlines of the part in a picture of it, blurred by `blur` px and with noise."""
    grey = picture(part, height, width, blur, noise)
    return find_outlines(grey, mask_of(grey))[0]


def recovered(
    part: Drawn, height: int, width: int, blur: float = 0.7, noise: float = 2.0
) -> tuple[tuple[Contour, ...], tuple[OutlineFit, ...]]:
    """Contours and fits of a picture of the part, which must give no note."""
    contours, fits, notes = make_contours(trace(part, height, width, blur, noise), PIXELS)
    assert not notes
    return contours, fits


def sample_contours(contours: tuple[Contour, ...]) -> np.ndarray:
    """Points on the contours, at most half a pixel from each other, as u + i v."""
    points, owner = flatten(make_contour_segments(contours), 1e-4)
    samples = []
    for k in range(len(contours)):
        start = points[owner == k] @ np.array([1, -1j])
        chord = np.roll(start, -1) - start
        count = np.maximum(np.ceil(np.abs(chord) * 2), 1).astype(int)
        step = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        samples.append(np.repeat(start, count) + np.repeat(chord / count, count) * step)
    return np.concatenate(samples)


def errors(part: Drawn, contours: tuple[Contour, ...], reach: float = 4.0) -> np.ndarray:
    """Distances from the contours to the drawing, and from the drawing to the contours, px.

    Points within `reach` px of a sharp corner are left out.
    """
    samples = sample_contours(contours)
    to_drawing = part.gaps(samples[~part.near_corner(samples, reach)])
    drawing = np.concatenate(part.loops)
    drawing = drawing[~part.near_corner(drawing, reach)]
    # The nearest point of a contour is at most a quarter of a pixel from a sample, along it.
    tree = shapely.STRtree(shapely.points(samples.real, samples.imag))
    nearest = tree.nearest(shapely.points(drawing.real, drawing.imag))
    to_contours = np.sqrt(np.maximum(np.abs(samples[nearest] - drawing) ** 2 - 0.25**2, 0))
    return np.concatenate([to_drawing, to_contours])


def corners(contours: tuple[Contour, ...]) -> np.ndarray:
    """The ends (N,) of all lines and arcs, as u + i v."""
    return np.concatenate([c.points for c in contours]) @ np.array([1, -1j])


def corner_errors(part: Drawn, contours: tuple[Contour, ...]) -> np.ndarray:
    """Distance (N,) px from each sharp corner of the drawing to the nearest corner found."""
    return np.abs(part.sharp[:, None] - corners(contours)).min(axis=1)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def areas(contours: tuple[Contour, ...]) -> list[float]:
    """Signed areas of the contours, mm2: positive if a contour runs counterclockwise."""
    signed = []
    for contour in contours:
        points, _ = flatten(make_contour_segments([contour]), 1e-4)
        x, y = points.T
        signed.append(float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2))
    return signed


def radii(contour: Contour) -> np.ndarray:
    segments = make_contour_segments([contour])
    return np.asarray(segments.radius[segments.is_arc])


@pytest.mark.parametrize("blur", [0.5, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("radius", [5.0, 12.0, 60.0])
def test_a_disc_is_two_arcs_of_a_circle(radius: float, blur: float) -> None:
    side = int(2 * radius) + 30
    centre = side / 2 + 0.21 + 1j * (side / 2 - 0.37)
    (circle,), (fit,) = recovered(disc(radius).placed(0, centre), side, side, blur)
    assert circle.bulges.tolist() == [1.0, 1.0]
    a, b = circle.points @ np.array([1, -1j])
    # The noise is 0.03 px per point. A radius is a mean over all points.
    assert abs((a + b) / 2 - centre) < 0.2 / np.sqrt(radius)
    assert abs(a - b) / 2 == pytest.approx(radius, abs=0.025)
    assert (fit.lines, fit.arcs, fit.doubtful) == (0, 2, 0)
    assert fit.rms_mm < 0.06


@pytest.mark.parametrize(("blur", "max_error"), [(0.5, 0.05), (0.7, 0.05), (1.0, 0.08)])
def test_a_plate_is_recovered_from_its_picture(blur: float, max_error: float) -> None:
    part = plate().placed(0.3, 300.3 + 250.1j)
    contours, fits = recovered(part, 500, 600, blur)
    assert [len(c.points) for c in contours[:1]] == [12]
    assert sorted(len(c.points) for c in contours[1:])[:4] == [2, 2, 2, 2]
    error = errors(part, contours)
    assert error.max() < max_error
    assert rms(error) < 0.015
    assert corner_errors(part, contours).max() < 0.06
    assert sorted(radii(contours[0])) == pytest.approx([5, 12, 30], abs=0.25)
    assert all(fit.doubtful == 0 for fit in fits)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_interpolated_noise_of_a_rectified_view_does_not_break_lines(seed: int) -> None:
    # Neighbours share interpolated noise. If it counted as shape, lines would become arcs.
    rng = np.random.default_rng(seed)
    part = plate().placed(rng.uniform(0, 2 * np.pi), 300 + 300j)
    grey = picture(part, 600, 600, 0.7, 2.0)
    spin = rng.uniform(1.0, 1.1) * np.exp(1j * rng.uniform(-0.3, 0.3))
    shift = 330 + 330j - spin * (300 + 300j)
    matrix = np.array([[spin.real, -spin.imag, shift.real], [spin.imag, spin.real, shift.imag]])
    view = cv2.warpAffine(grey, matrix, (660, 660), flags=cv2.INTER_LINEAR, borderValue=60)
    drawn_in_view = Drawn([spin * loop + shift for loop in part.loops], spin * part.sharp + shift)
    contours, _, notes = make_contours(find_outlines(view, mask_of(view))[0], PIXELS)
    assert not notes
    assert len(contours[0].points) == 12
    error = errors(drawn_in_view, contours)
    assert error.max() < 0.1
    assert rms(error) < 0.02
    assert corner_errors(drawn_in_view, contours).max() < 0.1


def sample_loop(part: Drawn, count: int | None = None) -> np.ndarray:
    """Evenly spaced points of the first loop, `count` or one per pixel, as u + i v."""
    loop = np.append(part.loops[0], part.loops[0][0])
    length = np.append(0.0, np.cumsum(np.abs(np.diff(loop))))
    even = np.linspace(0, length[-1], count or int(length[-1]), endpoint=False)
    return np.interp(even, length, loop.real) + 1j * np.interp(even, length, loop.imag)


def move_across(points: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """The points (N,) of a loop, moved by `offsets` (N,) px perpendicular to it."""
    across = 1j * (np.roll(points, -1) - np.roll(points, 1))
    return points + across / np.abs(across) * offsets


def make_grained_plate(seed: int) -> Contour:
    """A plate of 540 x 450 px with two rounded corners, whose edge has brushed metal's grain."""
    rng = np.random.default_rng(seed)
    shape = drawn([(0, 0, 0), (540, 0, 0), (540, 450, 90), (0, 450, 90)]).placed(0.3, 320 + 320j)
    points = sample_loop(shape)
    grain = np.convolve(rng.normal(0, 1, len(points) + 4), np.ones(5) / np.sqrt(5), "valid")
    points = move_across(points, 0.045 * grain + rng.normal(0, 0.03, len(points)))
    line = np.column_stack([points.real, points.imag])
    (contour,), _, notes = make_contours([Outline(line, line, False, 0.03, 0.7)], PIXELS)
    assert not notes
    return contour


def test_grain_breaks_no_line() -> None:
    # Five neighbours share the noise, so differences of neighbours show less than half of it.
    contours = [make_grained_plate(seed) for seed in range(12)]
    assert sum(len(contour.bulges) == 6 for contour in contours) >= 10
    assert max(len(contour.bulges) for contour in contours) <= 8


def smooth_noise(count: int, rms: float, reach: int, seed: int) -> np.ndarray:
    """Noise (N,) px of a closed outline that about `reach` neighbours share."""
    rng = np.random.default_rng(seed)
    kernel = np.exp(-((np.arange(-3 * reach, 3 * reach + 1) / reach) ** 2))
    white = np.fft.fft(rng.normal(0, 1, count)) * np.fft.fft(kernel, count)
    noise = np.fft.ifft(white).real
    return np.asarray(rms * noise / noise.std())


def make_outline(part: Drawn, offsets: np.ndarray) -> Outline:
    """The first loop of a part as N even points, moved perpendicular to it by `offsets` (N,) px."""
    points = move_across(sample_loop(part, len(offsets)), offsets)
    pairs = np.column_stack([points.real, points.imag])
    third = np.convolve(np.concatenate([offsets, offsets[:3]]), [1, -3, 3, -1], "valid")
    sigma = max(float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20)), 0.008)
    return Outline(pairs, pairs, False, sigma, 2.0)


@pytest.mark.parametrize("reach", [2, 4])
@pytest.mark.parametrize("rms", [0.1, 0.4])
def test_noise_that_neighbours_share_makes_no_corners(rms: float, reach: int) -> None:
    # Third differences show at most a tenth of this noise.
    part = drawn([(0, 0, 0), (500, 0, 0), (500, 400, 90), (0, 400, 90)]).placed(0.3, 320 + 320j)
    for seed in range(4):
        outline = make_outline(part, smooth_noise(1700, rms, reach, seed))
        (contour,), (fit,), notes = make_contours([outline], PIXELS)
        assert len(contour.bulges) <= 1.3 * 6 + 4
        assert fit.doubtful == 0
        assert not notes
        assert part.gaps(sample_contours((contour,))).max() < 4 * rms


@pytest.mark.parametrize("height", [1.0, 2.2, 5.0])
def test_a_shallow_notch_is_kept(height: float) -> None:
    notch = [(100, 0, 0), (100, height, 0), (116, height, 0), (116, 0, 0)]
    part = drawn([(0, 0, 0), *notch, (300, 0, 0), (300, 200, 0), (0, 200, 0)])
    part = part.placed(0.3, 100 + 40j)
    contours, fits, _ = make_contours(trace(part, 340, 440, 0.7, 1.0), PIXELS)
    floor = (108 + 1j * height) * np.exp(0.3j) + 100 + 40j
    assert np.abs(sample_contours(contours) - floor).min() < 0.3
    assert fits[0].lines <= 9


@pytest.mark.parametrize(("teeth", "root", "tip"), [(24, 80, 90), (30, 85, 95), (60, 180, 190)])
def test_teeth_of_a_gear_are_not_treated_as_noise(teeth: int, root: float, tip: float) -> None:
    part = gear(teeth, root, tip).placed(0.1, 200 + 200j)
    contours, fits = recovered(part, 400, 400)
    assert 4 * teeth <= fits[0].lines + fits[0].arcs <= 4 * teeth + 4
    assert part.gaps(sample_contours(contours)).max() < 0.6


def test_a_small_hole_has_no_more_noise_than_the_outline_around_it() -> None:
    # A square with large corner radii: a circle deviates from it by 0.45 px at most.
    half, radius = 10.4, 8.7
    hole = [(x * half, y * half, radius) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    outside = [(x, y, 0.0) for x, y in ((-90, -60), (90, -60), (90, 60), (-90, 60))]
    part = drawn(outside, hole).placed(0.3, 120.3 + 100j)
    contours, _ = recovered(part, 200, 240)
    assert part.gaps(sample_contours(contours[1:])).max() < 0.25


def test_the_noise_of_an_outline_is_measured_with_its_correlation() -> None:
    loops = make_rings([4000])
    for reach in (1, 3):
        residuals = smooth_noise(4000, 0.2, reach, 5)
        runs = Runs(np.array([0]), np.array([4000]), np.array([0]))
        single, means = measure(runs, loops, residuals, np.ones(4000), np.full(1, 2.0))
        assert single[0] == pytest.approx(0.2, rel=0.05)
        # Standard deviation of the means of 16 neighbours, at all places.
        mean = np.convolve(np.tile(residuals, 2), np.ones(16) / 16, "valid")[:4000].std()
        assert means[0] == pytest.approx(4 * mean, rel=0.25)
    capped, _ = measure(runs, loops, residuals, np.ones(4000), np.full(1, 0.1))
    assert capped[0] == pytest.approx(0.05)


def test_contours_are_in_mm_and_holes_run_clockwise() -> None:
    part = plate().placed(0.3, 300 + 250j)
    loops = trace(part, 500, 600)
    scale = 0.143
    view = np.array([[scale, 0.0, 10.0], [0.0, -scale, 80.0]])
    contours, fits, _ = make_contours(loops, view, "part")
    assert [c.id for c in contours] == [f"c{k + 1}" for k in range(6)]
    assert {(c.layer, c.closed) for c in contours} == {("part", True)}
    signed = areas(contours)
    assert [area > 0 for area in signed] == [not loop.hole for loop in loops]
    slot, holes = np.pi * 12**2 + 24 * 96, [np.pi * r**2 for r in (5, 10, 25, 40)]
    assert sorted(-area for area in signed if area < 0) == pytest.approx(
        sorted(scale**2 * area for area in [slot, *holes]), rel=0.008
    )
    # The hole of radius 10 px is 2.86 mm wide. It is drawn at (-60, -90) px.
    hole = min(
        contours,
        key=lambda c: np.abs(c.bulges - -1).sum() + abs(np.hypot(*np.ptp(c.points, axis=0)) - 2.86),
    )
    centre = (-60 - 90j) * np.exp(0.3j) + 300 + 250j
    assert hole.points.mean(axis=0) == pytest.approx(
        [10 + scale * centre.real, 80 - scale * centre.imag], abs=0.005
    )
    assert max(fit.rms_mm for fit in fits) < 0.03 * 1.3 * scale


def test_a_mirrored_view_gives_the_same_directions() -> None:
    loops = trace(plate().placed(0.3, 300 + 250j), 500, 600)
    mirrored, plain = (make_contours(loops, view)[0] for view in (PIXELS, np.abs(PIXELS)))
    assert areas(plain) == pytest.approx(areas(mirrored), rel=1e-9)
    for a, b in zip(mirrored, plain, strict=True):
        assert sample_contours((a,)).conj().sum() == pytest.approx(
            sample_contours((b,)).sum(), rel=1e-6
        )


def test_fillets_are_tangential_and_corners_are_not() -> None:
    part = plate().placed(0.3, 300 + 250j)
    contours, _ = recovered(part, 500, 600)
    segments = make_contour_segments(contours[:1])
    half = segments.sweep / 2
    chord = (segments.end - segments.start) @ np.array([1, 1j])
    begin, end = np.angle(chord) - half, np.angle(chord) + half
    corner_angles = np.abs((np.roll(begin, -1) - end + np.pi) % (2 * np.pi) - np.pi)
    is_arc = segments.is_arc
    next_to_arc = is_arc | np.roll(is_arc, -1)
    assert corner_angles[next_to_arc].max() < 1e-4
    assert np.degrees(np.sort(corner_angles[~next_to_arc])) == pytest.approx(
        [36.87, 53.13, 90, 90, 90, 90], abs=0.2
    )


@pytest.mark.parametrize("blur", [0.5, 0.7, 1.0])
def test_each_tooth_of_a_gear_becomes_four_lines(blur: float) -> None:
    part = gear(30, 150, 190).placed(0.1, 200 + 200j)
    contours, fits = recovered(part, 400, 400, blur)
    assert (fits[0].lines, fits[0].arcs) == (120, 0)
    error = errors(part, contours)
    assert error.max() < 0.12
    assert rms(error) < 0.02
    assert corner_errors(part, contours).max() < 0.35


def test_a_slot_is_two_lines_and_two_half_circles() -> None:
    slot = [(-60.0, -12.0, 12.0), (60.0, -12.0, 12.0), (60.0, 12.0, 12.0), (-60.0, 12.0, 12.0)]
    outside = [(-90.0, -40.0, 0.0), (90.0, -40.0, 0.0), (90.0, 40.0, 0.0), (-90.0, 40.0, 0.0)]
    part = drawn(outside, slot).placed(0.7, 110 + 110j)
    contours, fits = recovered(part, 220, 220)
    assert fits[1].lines == 2
    assert radii(contours[1]) == pytest.approx(12.0, abs=0.08)
    assert np.abs(make_contour_segments(contours[1:]).sweep).sum() == pytest.approx(
        2 * np.pi, abs=0.01
    )


def test_an_arc_of_more_than_half_a_circle_is_divided() -> None:
    # A keyhole: a disc with a narrow slit.
    ring = 40 * np.exp(1j * np.linspace(0.125, 2 * np.pi - 0.125, 2000))
    slit = np.array([10 - 4.99j, 10 + 4.99j])
    keyhole = Drawn([np.concatenate([ring, slit])], np.concatenate([ring[[0, -1]], slit]))
    part = keyhole.placed(0.4, 60 + 60j)
    contours, fits = recovered(part, 120, 120)
    assert np.abs(contours[0].bulges).max() <= 1.0
    assert (fits[0].lines, fits[0].arcs) == (3, 2)
    assert errors(part, contours).max() < 0.1


@pytest.mark.parametrize("radius", [3.0, 4.0, 6.0])
def test_a_small_corner_radius_is_not_treated_as_blur(radius: float) -> None:
    # A sharp corner instead would deviate by 0.41 of the radius.
    part = drawn([(-40, -30, 0), (40, -30, radius), (40, 30, radius), (-40, 30, 0)]).placed(
        0.4, 60 + 60.3j
    )
    contours, fits = recovered(part, 120, 120)
    assert (fits[0].lines, fits[0].arcs) == (4, 2)
    assert errors(part, contours).max() < 0.15
    assert radii(contours[0]) == pytest.approx(radius, abs=0.6)


def test_a_free_curve_is_followed_by_arcs() -> None:
    t = 2 * np.pi * np.arange(4000) / 4000
    curve = (100 * np.cos(t) + 60j * np.sin(t)) * np.exp(0.3j) + 6 * np.exp(5j * t) + 130 + 130j
    part = Drawn([curve], np.zeros(0, complex))
    contours, fits = recovered(part, 260, 260)
    error = errors(part, contours)
    assert error.max() < 0.2
    assert rms(error) < 0.04
    assert fits[0].lines + fits[0].arcs < 60


def test_a_ragged_outline_gives_no_contour_that_crosses_itself() -> None:
    rng = np.random.default_rng(5)
    for k in range(6):
        t = 2 * np.pi * np.arange(300) / 300
        curve = (50 + rng.normal(0, 1 + k, 300)) * np.exp(1j * t) + 80 + 80j
        loops = trace(Drawn([curve], curve), 160, 160, 0.7, 4.0)
        contours, fits, notes = make_contours(loops, PIXELS)
        assert len(contours) == len(fits)
        assert len(loops) - len(contours) == sum(note.kind == "skipped" for note in notes)
        for contour in contours:
            points, _ = flatten(make_contour_segments([contour]), 0.02)
            assert shapely.is_valid(shapely.Polygon(points))


def test_an_outline_that_crosses_itself_is_skipped_with_a_note() -> None:
    eight = np.column_stack(
        [30 * np.sin(np.linspace(0, 2 * np.pi, 200)), 20 * np.sin(np.linspace(0, 4 * np.pi, 200))]
    )
    contours, fits, notes = make_contours([Outline(eight, eight, False, 0.03, 0.7)], PIXELS)
    assert (contours, fits) == ((), ())
    assert [note.kind for note in notes] == ["skipped"]
    assert "crosses itself" in notes[0].what


def test_a_side_that_no_line_or_arc_fits_keeps_its_points() -> None:
    # A saw of teeth as small as the blur along one side of a square.
    saw = [(-40 + 1.5 * k, -40 + (1.2 if k % 2 else 0.0), 0.0) for k in range(54)]
    part = drawn([*saw, (40, 40, 0), (-40, 40, 0)]).placed(0.2, 70 + 70j)
    contours, fits, notes = make_contours(trace(part, 140, 140, 0.5, 1.0), PIXELS)
    assert len(contours) == 1
    assert bool(notes) == bool(fits[0].doubtful)
    side = (-40 + 40j) * np.exp(0.2j) + 70 + 70j
    assert np.abs(corners(contours) - side).min() < 0.1
    gaps = part.gaps(sample_contours(contours))
    assert np.quantile(gaps, 0.98) < 1.2
    # The saw ends in half a tooth. Its corner is found where a whole tooth has it, 0.9 px farther.
    assert gaps.max() < 1.7


def spotted(seed: int) -> Drawn:
    """A plate with rounded corners, and a ragged spot of 20 px on one side."""
    rng = np.random.default_rng(seed)
    spot = [(-10 + 0.5 * k, -60 + float(rng.normal(0, 2.5)), 0.0) for k in range(41)]
    return drawn([(-90, -60, 12), *spot, (90, -60, 12), (90, 60, 0), (-90, 60, 20)]).placed(
        0.3, 110 + 90j
    )


@pytest.mark.parametrize("seed", range(6))
def test_an_outline_is_fitted_apart_from_its_ragged_spot(seed: int) -> None:
    contours, fits, _ = make_contours(trace(spotted(seed), 190, 220, 0.5, 3.0), PIXELS)
    assert len(contours[0].points) < 60
    assert fits[0].arcs >= 3
    assert fits[0].lines_mm < 130
    # The doubtful places lie at the spot, or on one of the lines that end there.
    spot = -60j * np.exp(0.3j) + 110 + 90j
    assert all(abs(x - 1j * y - spot) < 60 for x, y in fits[0].places)
    middles = [(x + y) / 2 for x, y in (((-90 + 30j), (-90 - 30j)), ((90 + 30j), (90 - 30j)))]
    places = sample_contours(contours[:1])
    for side in middles:
        assert np.abs(places - (side * np.exp(0.3j) + 110 + 90j)).min() < 0.3


def test_the_scale_of_a_picture_does_not_change_its_lines_and_arcs() -> None:
    """A photo at 0.115741 mm/px gives the lines and arcs that it gives at 0.11574 mm/px."""
    for seed in range(2):
        loops = trace(spotted(seed), 190, 220, 0.5, 3.0)
        in_pixels = make_contours(loops, PIXELS)[0]
        for scale in (1.0, 0.11574, 0.115741, 1 / 3, 40.0):
            in_mm = make_contours(loops, PIXELS * scale)[0]
            for first, second in zip(in_pixels, in_mm, strict=True):
                assert np.allclose(first.points * scale, second.points, atol=1e-9)
                assert np.array_equal(first.bulges, second.bulges)


def test_points_that_cross_are_cut_off_and_the_others_stay() -> None:
    t = 2 * np.pi * np.arange(200) / 200
    points = 40 * np.exp(1j * t)
    # Two steps back: the line crosses itself.
    points[[50, 51, 52]] = points[[52, 51, 50]] + np.array([0.4, -0.3, 0.2])
    yes = np.ones(1, dtype=np.bool_)
    chain = FittedChain(points[:1], np.zeros(1), yes, ~yes)
    owner = np.zeros(200, dtype=np.int64)
    sound = make_sound(chain, make_no_fillets(chain), yes, points, owner, 0.01)
    assert sound is not None
    assert 0 < sound.cut < 4
    assert shapely.is_valid(
        shapely.Polygon(np.column_stack([sound.ring.corners.real, sound.ring.corners.imag]))
    )
    assert len(sound.ring.corners) > 190


def test_a_view_with_different_scales_in_x_and_y_is_refused() -> None:
    with pytest.raises(InputError, match="not to scale"):
        make_contours([], np.array([[1.0, 0, 0], [0, 1.1, 0]]))
    assert make_contours([], PIXELS) == ((), (), ())


def test_the_same_picture_gives_the_same_numbers() -> None:
    grey = picture(plate().placed(0.3, 300 + 250j), 500, 600, 0.7, 2.0)
    first, second = (
        make_contours(find_outlines(grey, mask_of(grey))[0], PIXELS)[0] for _ in range(2)
    )
    assert all(np.array_equal(a.points, b.points) for a, b in zip(first, second, strict=True))


@settings(max_examples=20)
@given(
    turn=st.floats(0, 2 * math.pi),
    u=st.floats(-0.5, 0.5),
    v=st.floats(-0.5, 0.5),
    width=st.floats(25, 60),
    height=st.floats(25, 60),
    radius=st.floats(5, 8),
)
def test_any_rectangle_with_a_hole_is_recovered(
    turn: float, u: float, v: float, width: float, height: float, radius: float
) -> None:
    a, b = width / 2, height / 2
    part = with_holes(drawn([(-a, -b, 0), (a, -b, 0), (a, b, 0), (-a, b, 0)]), (0, radius))
    part = part.placed(turn, complex(55 + u, 55 + v))
    contours, fits = recovered(part, 110, 110, 0.7, 1.0)
    # One side in some thousand shows a bend of 0.05 px beside a corner.
    assert fits[0].lines + fits[0].arcs in (4, 5)
    assert (fits[1].lines, fits[1].arcs) == (0, 2)
    assert corner_errors(part, contours).max() < 0.15
    assert errors(part, contours).max() < 0.1


def test_a_rectangle_at_any_angle_is_four_lines() -> None:
    part = drawn([(-40, -25, 0), (40, -25, 0), (40, 25, 0), (-40, 25, 0)])
    for turn in np.linspace(0, np.pi / 2, 11):
        contours, fits = recovered(part.placed(turn, 55.2 + 54.9j), 110, 110)
        assert [(fit.lines, fit.arcs) for fit in fits] == [(4, 0)]
        assert corner_errors(part.placed(turn, 55.2 + 54.9j), contours).max() < 0.1


def test_joined_and_moved_sums_of_parts_are_the_sums_of_the_whole() -> None:
    rng = np.random.default_rng(1)
    points = 300 + 200j + rng.normal(0, 5, 30) + 1j * rng.normal(0, 5, 30)
    parts = sum_runs(points, np.ones(30), np.array([0, 12]))
    whole = sum_runs(points, np.ones(30), np.array([0]))
    both = move_sums(join_sums(parts.take(np.array([0])), parts.take(np.array([1]))), whole.origin)
    assert both.sums == pytest.approx(whole.sums, rel=1e-9, abs=1e-6)


def test_a_line_and_a_circle_are_found_exactly() -> None:
    t = np.linspace(0, 1, 9)
    points = np.concatenate(
        [100 + 50j + 40 * np.exp(1j * (0.3 + 0.4 * t)), 5 + 3j + t * (30 + 40j)]
    )
    runs = sum_runs(points, np.ones(18), np.array([0, 9]))
    round_ = fit_circles(runs)
    assert 1 / abs(round_.curvature[0]) == pytest.approx(40, rel=1e-6)
    assert np.abs(round_.distances(np.array([100 + 90j, 35 + 43j]))).max() < 1e-6
    straight = fit_lines(runs)
    # The error is a difference of sums of squares of nine points, 50 px from end to end.
    rounding = 9 * 50**2 * rounding_bound(operations=30)
    assert straight.sse[1] == pytest.approx(0, abs=rounding)
    assert np.abs(straight.distances(np.array([0j, 5 + 3j + 4 - 3j]))[1]) == pytest.approx(5.0)


def test_distances_to_flat_arcs_are_exact() -> None:
    """Three chords: a half circle below it, an arc that is almost flat, and a line.

    The point lies 2 px to the left of the middle of the chord.
    """
    start, end = np.array([0j] * 3), np.array([10 + 0j] * 3)
    distances = measure_from_arcs(np.array([5 + 2j] * 3), start, end, np.array([1.0, 1e-9, 0.0]))
    assert distances == pytest.approx([2 - 5, -2, -2], abs=1e-7)


def test_a_long_chain_is_polished_to_its_points() -> None:
    # With 60 corners, the fit is solved in overlapping windows.
    corner = np.where(np.arange(60) % 2, 80.0, 100.0) * np.exp(2j * np.pi * np.arange(60) / 60)
    t = np.linspace(0.1, 0.9, 12)
    points = (corner[:, None] + (np.roll(corner, -1) - corner)[:, None] * t).ravel()
    rng = np.random.default_rng(2)
    start = corner + rng.normal(0, 0.5, 60) + 1j * rng.normal(0, 0.5, 60)
    straight = np.ones(60, dtype=bool)
    chain = FittedChain(start, np.zeros(60), straight, ~straight)
    polished = polish(chain, points, np.repeat(np.arange(60), 12), np.ones(720))
    assert np.abs(polished.corners - corner).max() < 1e-3
