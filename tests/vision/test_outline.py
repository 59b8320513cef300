"""Outlines are compared with drawn parts: bias, noise, light, order and orientation."""

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.rings import make_rings
from camgen.model.errors import InputError
from camgen.vision.outline import Outline, find_outlines
from tests.support.outline_pictures import Drawn, disc, drawn, mask_of, picture, plate, with_holes

#: A pixel is a box: it blurs like a Gaussian of this sigma.
BOX = np.sqrt(1 / 12)


def trace(grey: np.ndarray, mask: np.ndarray | None = None) -> tuple[Outline, ...]:
    """The outlines of a picture that gives no note."""
    loops, notes = find_outlines(grey, mask_of(grey) if mask is None else mask)
    assert not notes
    return loops


def list_points(loops: tuple[Outline, ...]) -> np.ndarray:
    return np.concatenate([loop.points for loop in loops]) @ np.array([1, 1j])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def area(loop: Outline) -> float:
    """Signed area, px2: positive if the loop runs counter-clockwise, seen with v upwards."""
    u, v = loop.points[:, 0], -loop.points[:, 1]
    return float((u * np.roll(v, -1) - np.roll(u, -1) * v).sum() / 2)


def radial_errors(loop: Outline, centre: complex, radius: float) -> np.ndarray:
    """Distance (N,) px of each point from the circle, positive outside of it."""
    return np.abs(loop.points @ np.array([1, 1j]) - centre) - radius


@pytest.mark.parametrize("blur", [0.5, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("radius", [5, 10, 40, 200])
def test_a_disc_is_as_large_as_drawn(radius: int, blur: float) -> None:
    side, centre = 2 * radius + 40, radius + 20.13 + 1j * (radius + 20.37)
    (loop,) = trace(picture(disc(radius).placed(0, centre), side, side, blur))
    error = radial_errors(loop, centre, radius)
    # Without the correction s^2 / (2 r), the error would be 0.03 px for r = 10 and a blur of 0.7,
    # and 0.23 px for r = 5 and a blur of 1.5.
    assert abs(error.mean()) < 0.02
    assert rms(error) < 0.03
    assert loop.blur == pytest.approx(np.hypot(blur, BOX), rel=0.15 if blur < 0.7 else 0.05)


@pytest.mark.parametrize("degrees", [0, 7, 22.5, 30, 45, 60, 81])
def test_a_straight_edge_is_exact_at_any_angle(degrees: float) -> None:
    square = drawn([(-60, -60, 0), (60, -60, 0), (60, 60, 0), (-60, 60, 0)])
    part = square.placed(np.radians(degrees), 99.7 + 100.2j)
    points = list_points(trace(picture(part, 200, 200, 0.7, 2.0)))
    on_sides = points[~part.near_corner(points, 4)]
    error = part.gaps(on_sides) * np.where(inside(part, on_sides), -1, 1)
    # Noise of 2 on a contrast of 120 leaves at least 0.027 px in a single row across the edge.
    assert rms(error) < 0.032
    assert abs(error.mean()) < 0.006


def inside(part: Drawn, points: np.ndarray) -> np.ndarray:
    ring = np.column_stack([part.loops[0].real, part.loops[0].imag])
    return np.asarray(shapely.contains_xy(shapely.Polygon(ring), points.real, points.imag))


def test_the_stated_noise_is_that_of_the_points() -> None:
    for noise in (1.0, 2.0, 4.0):
        (loop,) = trace(picture(disc(150).placed(0, 200 + 200j), 400, 400, 0.7, noise))
        assert loop.sigma == pytest.approx(rms(radial_errors(loop, 200 + 200j, 150)), rel=0.15)


def test_the_noise_of_neighbours_is_independent() -> None:
    (loop,) = trace(picture(disc(180).placed(0, 200 + 200j), 400, 400, 0.7, 4.0))
    error = radial_errors(loop, 200 + 200j, 180)
    assert abs((error * np.roll(error, 1)).mean()) < 0.15 * (error**2).mean()


@pytest.mark.parametrize("level", [80.0, 160.0])
def test_a_wrong_threshold_does_not_move_the_edge(level: float) -> None:
    grey = picture(disc(60).placed(0, 80.2 + 79.9j), 160, 160, 1.0, 2.0)
    (loop,) = trace(grey, mask_of(grey, level))
    assert abs(radial_errors(loop, 80.2 + 79.9j, 60).mean()) < 0.01


def test_shading_does_not_move_the_edge() -> None:
    grey = picture(disc(60).placed(0, 80 + 80j), 160, 160, 0.7).astype(np.float32)
    shaded = np.rint(grey * np.linspace(0.7, 1.1, 160)).astype(np.uint8)
    (loop,) = trace(shaded, mask_of(grey))
    error = radial_errors(loop, 80 + 80j, 60)
    assert abs(error.mean()) < 0.005
    assert rms(error) < 0.025


def test_a_dark_part_has_the_outlines_of_a_light_one() -> None:
    grey = 240 - picture(plate().placed(0.3, 300 + 250j), 500, 600, 0.7, 2.0)
    light = trace(240 - grey)
    dark = trace(grey, 255 - mask_of(grey))
    assert [loop.hole for loop in dark] == [loop.hole for loop in light]
    both = zip(sorted(map(area, dark)), sorted(map(area, light)), strict=True)
    assert all(a == pytest.approx(b, rel=1e-4, abs=0.2) for a, b in both)


def test_outer_borders_run_counter_clockwise_and_holes_clockwise() -> None:
    loops = trace(picture(plate().placed(0.3, 300 + 250j), 500, 600, 0.7, 2.0))
    assert sorted(loop.hole for loop in loops) == [False] + [True] * 5
    assert all((area(loop) < 0) == loop.hole for loop in loops)
    hole_areas = sorted(-area(loop) for loop in loops if loop.hole)
    slot = np.pi * 12**2 + 24 * 96
    # Chords of one pixel cut off 1 % of the smallest hole.
    drawn_areas = sorted([np.pi * r**2 for r in (5, 10, 25, 40)] + [slot])
    assert hole_areas == pytest.approx(drawn_areas, rel=0.013)


def test_an_outline_has_one_point_per_pixel_and_does_not_cross_itself() -> None:
    for noise in (0.0, 4.0):
        loops = trace(picture(plate().placed(0.3, 300 + 250j), 500, 600, 1.0, noise))
        assert len(loops) == 6
        for loop in loops:
            step = np.hypot(*(np.roll(loop.points, -1, axis=0) - loop.points).T)
            assert step.min() > 0.3
            assert step.max() < 3.5
            assert shapely.is_valid(shapely.Polygon(loop.points))


@pytest.mark.parametrize("width", [3, 4, 6])
def test_narrow_slots_and_webs_are_exact(width: int) -> None:
    # The grey value hardly reaches its plateau: the other edge must not disturb the edge.
    outline = [(-50, -30, 0), (50, -30, 0), (50, 30, 0), (-50, 30, 0)]
    slots = [
        [(-35, v, 0), (35, v, 0), (35, v + width, 0), (-35, v + width, 0)]
        for v in (-10, -10 + 2 * width)
    ]
    part = drawn(outline, *slots).placed(0.2, 80 + 60j)
    grey = picture(part, 120, 160, 0.7, 1.0)
    points = list_points(trace(grey))
    on_sides = points[~part.near_corner(points, 4)]
    assert rms(part.gaps(on_sides)) < 0.05
    assert part.gaps(on_sides).max() < 0.2


def test_a_part_that_differs_in_colour_alone_has_the_border_of_the_mask() -> None:
    part = disc(50).placed(0.1, 70.2 + 69.7j)
    mask = mask_of(picture(part, 140, 140, 0.7))
    grey = picture(part, 140, 140, 0.7, 3.0, levels=(120.0, 120.5))
    loops, notes = find_outlines(grey, mask)
    assert [note.what for note in notes] == ["1 of 1 outline taken from the mask alone"]
    assert not loops[0].has_edge
    error = radial_errors(loops[0], 70.2 + 69.7j, 50)
    assert abs(error.mean()) < 0.05
    assert rms(error) < 0.16
    assert loops[0].sigma == pytest.approx(rms(error), rel=0.3)


def test_an_edge_that_is_soft_on_one_side_is_a_warning() -> None:
    sharp = picture(disc(50).placed(0, 70 + 70j), 140, 140, 0.7)
    soft = cv2.GaussianBlur(sharp, (0, 0), 3.5)
    for grey, is_soft in ((sharp, False), (soft, False)):
        assert any("soft" in note.what for note in find_outlines(grey, mask_of(grey))[1]) == is_soft
    one_side = sharp.copy()
    one_side[:, 100:] = soft[:, 100:]
    note = find_outlines(one_side, mask_of(one_side))[1][0]
    assert note.kind == "warning"
    # The soft side begins 30 px from the centre, at a radius of 50 px: an arc of 2 arccos(0.6).
    assert float(note.what.split()[0]) == pytest.approx(100 * np.arccos(0.6) / np.pi, abs=6)


def test_small_borders_and_an_empty_mask_are_noted() -> None:
    grey = picture(disc(20).placed(0, 40 + 40j), 80, 80)
    mask = mask_of(grey)
    mask[5, 5] = mask[5, 6] = 255
    loops, notes = find_outlines(grey, mask)
    assert len(loops) == 1
    assert notes[-1].kind == "skipped"
    assert notes[-1].what == "1 border of fewer than 8 points"
    loops, notes = find_outlines(grey, np.zeros_like(mask))
    assert loops == ()
    assert notes[0].what == "no part in the mask"


def test_a_picture_and_a_mask_of_different_shape_or_type_are_refused() -> None:
    mask = np.zeros((20, 30), np.uint8)
    with pytest.raises(InputError, match=r"has shape \(30, 20\)"):
        find_outlines(np.zeros((30, 20), np.uint8), mask)
    with pytest.raises(InputError, match="mask: has shape"):
        find_outlines(np.zeros((20, 30), np.uint8), mask.astype(bool))
    with pytest.raises(InputError, match="float64"):
        find_outlines(np.zeros((20, 30)), mask)


def test_a_picture_in_float32_has_the_same_outlines() -> None:
    grey = picture(disc(30).placed(0, 50 + 50j), 100, 100, 0.7, 2.0)
    for a, b in zip(trace(grey), trace(grey.astype(np.float32)), strict=True):
        assert np.array_equal(a.points, b.points)
        assert not a.points.flags.writeable


def test_sums_around_a_loop_continue_over_its_end() -> None:
    loops = make_rings(np.array([5, 2]))
    values = np.array([1.0, 2, 3, 4, 5, 10, 20])
    assert loops.around(values, 1).tolist() == [8, 6, 9, 12, 10, 50, 40]
    assert loops.shifted(-1).tolist() == [4, 0, 1, 2, 3, 6, 5]
    assert loops.mean(values).tolist() == [3, 15]


@given(
    radius=st.floats(5, 30),
    u=st.floats(-0.5, 0.5),
    v=st.floats(-0.5, 0.5),
    blur=st.floats(0.5, 1.2),
    hole=st.booleans(),
)
def test_any_disc_and_any_hole_is_as_large_as_drawn(
    radius: float, u: float, v: float, blur: float, hole: bool
) -> None:
    centre = complex(50 + u, 50 + v)
    square = drawn([(-45, -45, 0), (45, -45, 0), (45, 45, 0), (-45, 45, 0)])
    part = (with_holes(square, (0, radius)) if hole else disc(radius)).placed(0, centre)
    loops = [loop for loop in trace(picture(part, 100, 100, blur, 1.0)) if loop.hole == hole]
    error = radial_errors(loops[0], centre, radius)
    assert abs(error.mean()) < 0.02
    assert np.abs(error).max() < 0.12


def test_the_picture_and_the_mask_are_not_changed() -> None:
    grey = picture(disc(20).placed(0, 40 + 40j), 80, 80)
    mask = mask_of(grey)
    grey_before, mask_before = grey.copy(), mask.copy()
    find_outlines(grey, mask)
    assert np.array_equal(grey, grey_before)
    assert np.array_equal(mask, mask_before)


#: A plate of the bench's tone with a corner cut out and a round hole.
PALE = np.zeros((180, 240), np.uint8)
cv2.rectangle(PALE, (30, 30), (190, 140), 1, -1)
cv2.rectangle(PALE, (110, 30), (190, 70), 0, -1)
cv2.circle(PALE, (70, 70), 22, 0, -1)


def cast_shadow(tone: float, shift: tuple[float, float], softness: float) -> np.ndarray:
    """A picture of `PALE` in a tone on a bench of 246, and its shadow, moved by `shift` px."""
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    moved = cv2.warpAffine(PALE.astype(np.float32), matrix, PALE.shape[::-1])
    moved = cv2.GaussianBlur(moved, (0, 0), softness)
    grey = np.where(PALE > 0, tone, 246 - 70 * moved)
    return np.rint(cv2.GaussianBlur(grey, (0, 0), 0.7)).astype(np.uint8)


@pytest.mark.parametrize(
    ("tone", "shift", "softness", "is_shadow"),
    [
        (246, (12, 12), 5.0, True),
        (246, (14, 8), 4.0, True),
        (246, (-9, 13), 4.0, True),
        # The edge of the shadow is as sharp as that of the part, so it may be a part.
        (246, (12, 12), 0.5, False),
        # The part is as dark as its shadow, or darker.
        (180, (12, 12), 5.0, False),
        (100, (12, 12), 5.0, False),
    ],
)
def test_the_shadow_of_a_part_in_the_tone_of_the_bench_is_recognised(
    tone: float, shift: tuple[float, float], softness: float, is_shadow: bool
) -> None:
    grey = cast_shadow(tone, shift, softness)
    loops, _ = find_outlines(grey, np.where(grey < 212, 255, 0).astype(np.uint8))
    assert len(loops) >= 1
    assert {loop.is_shadow for loop in loops} == {is_shadow}


def test_a_disc_that_is_soft_on_one_half_is_not_a_shadow() -> None:
    sharp = picture(disc(50).placed(0, 70 + 70j), 140, 140, 0.7)
    soft = cv2.GaussianBlur(sharp, (0, 0), 3.5)
    sharp[:, 70:] = soft[:, 70:]
    (loop,) = find_outlines(sharp, mask_of(sharp))[0]
    assert not loop.is_shadow
