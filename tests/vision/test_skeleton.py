"""Masks are thinned to centre lines, which are joined to strokes."""

import cv2
import numpy as np
import pytest

from camgen.vision.skeleton import Stroke, join_strokes, make_graph, thin_mask


def blobs(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    soft = cv2.GaussianBlur(random.random((90, 120)), (0, 0), random.uniform(0.6, 4.0))
    return (soft > 0.5).astype(np.uint8) * 255


def find_strokes(mask: np.ndarray) -> list[Stroke]:
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return join_strokes(make_graph(thin_mask(mask), None, depth))


def drawn(*polygons: list[tuple[int, int]]) -> np.ndarray:
    mask = np.zeros((200, 300), dtype=np.uint8)
    for polygon in polygons:
        cv2.fillPoly(mask, [np.array(polygon)], 255)
    return mask


BAR = [(50, 50), (200, 50), (200, 60), (50, 60)]


@pytest.mark.parametrize("seed", range(12))
def test_thinning_keeps_pieces_and_holes(seed: int) -> None:
    mask = blobs(seed)
    lines = thin_mask(mask)
    assert not (lines & ~mask).any()
    pieces = [cv2.connectedComponents(pixels, connectivity=8)[0] for pixels in (lines, mask)]
    assert pieces[0] == pieces[1]
    # Holes are pieces of the background, in which diagonal neighbours are not connected.
    outside = [np.pad(255 - pixels, 1, constant_values=255) for pixels in (lines, mask)]
    holes = [cv2.connectedComponents(pixels, connectivity=4)[0] for pixels in outside]
    assert holes[0] == holes[1]


@pytest.mark.parametrize("seed", range(12))
def test_thinned_lines_are_one_pixel_wide(seed: int) -> None:
    lines = thin_mask(blobs(seed)) > 0
    square = lines[1:, 1:] & lines[:-1, 1:] & lines[1:, :-1] & lines[:-1, :-1]
    # Four lines may meet in a square of 2 x 2 pixels. No place is wider.
    wide = cv2.erode(lines.astype(np.uint8), np.ones((3, 3), np.uint8))
    assert not wide.any()
    assert square.sum() <= 0.01 * lines.sum() + 2


def test_kept_pixels_stay_and_lines_end_at_them() -> None:
    mask = drawn(BAR, [(200, 30), (240, 30), (240, 80), (200, 80)])
    kept = drawn([(206, 36), (234, 36), (234, 74), (206, 74)])
    lines = thin_mask(mask, kept)
    assert (lines[kept > 0] == 255).all()
    depth = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    strokes = join_strokes(make_graph(lines, kept, depth))
    (line,) = [stroke for stroke in strokes if np.ptp(stroke.points.real) > 60]
    assert line.start != line.end  # One end is free, the other one lies at the kept pixels.
    ends = line.points[[0, -1]]
    assert min(ends.real) == pytest.approx(55, abs=2)
    assert max(ends.real) == pytest.approx(206, abs=1)


def test_the_border_of_the_picture_does_not_stop_the_thinning() -> None:
    assert cv2.countNonZero(thin_mask(np.full((20, 60), 255, dtype=np.uint8))) > 30
    assert not thin_mask(np.zeros((20, 60), dtype=np.uint8)).any()


def test_a_bar_is_one_stroke_in_its_middle() -> None:
    (stroke,) = find_strokes(drawn(BAR))
    assert np.abs(stroke.points.imag - 55).max() <= 1
    assert (stroke.start, stroke.end, stroke.closed) == (True, True, False)
    assert np.ptp(stroke.points.real) > 135


def test_a_crossing_is_two_strokes_that_continue_straight() -> None:
    strokes = find_strokes(drawn(BAR, [(120, 10), (130, 10), (130, 150), (120, 150)]))
    lengths = [max(np.ptp(stroke.points.real), np.ptp(stroke.points.imag)) for stroke in strokes]
    assert sorted(round(length, -1) for length in lengths) == [130, 140]


def test_a_branch_ends_in_the_line_that_continues() -> None:
    strokes = find_strokes(drawn(BAR, [(120, 50), (130, 50), (130, 150), (120, 150)]))
    through, branch = sorted(strokes, key=lambda stroke: -np.ptp(stroke.points.real))
    assert np.ptp(through.points.real) > 135
    assert branch.start != branch.end
    root = branch.points[0] if branch.end else branch.points[-1]
    assert np.abs(through.points - root).min() < 4


def test_a_ring_is_closed_and_a_disc_is_a_dot() -> None:
    ring = np.zeros((200, 300), dtype=np.uint8)
    cv2.circle(ring, (100, 100), 60, 255, 9)
    (stroke,) = find_strokes(ring)
    assert stroke.closed
    assert np.abs(np.abs(stroke.points - (100 + 100j)) - 60).max() < 1.5
    (dot,) = find_strokes(drawn([(90, 90), (100, 90), (100, 100), (90, 100)]))
    assert abs(dot.points.mean() - (95 + 95j)) < 1.5
    assert len(dot.points) < 4


def test_every_pixel_between_junctions_is_in_one_branch() -> None:
    mask = blobs(3)
    lines = thin_mask(mask)
    net = make_graph(lines, None, np.ones(mask.shape, dtype=np.float32))
    inner = np.concatenate([b.points[1:-1] for b in net.branches])
    assert len(np.unique(inner)) == len(inner)
    assert {*np.concatenate([b.points for b in net.branches]).tolist()} == {
        u + 1j * v for v, u in np.argwhere(lines)
    }
