"""The renderer of bench/, compared with formulas: areas, centroids, lens, noise and offsets."""

import json
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.photo.photo import read_planned
from bench.render.board import chessboard, markers
from bench.render.optics import (
    Lens,
    Shot,
    aim_camera,
    mm_per_px,
    photo_from_work,
    share,
    undistort,
    work_from_photo,
)
from bench.render.parts import NAMED, random_part
from bench.render.photos import Photo, photos, write
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop, area, box, circle, hole, pieces, rounded, slot
from bench.render.truth import offset_truth, path_error
from camgen.model.pose import pose_from_values
from camgen.read.job_file import load_job
from camgen.vision.boards.sheet import make_sheet
from camgen.vision.camera.camera import distort, read_camera
from camgen.vision.plane import fit_plane, make_plane, map_points
from tests.support.files import source

PINHOLE = Lens(np.array([[800.0, 0, 79.5], [0, 801, 59.5], [0, 0, 1]]), (0, 0, 0, 0, 0), (160, 120))
#: A lens with radial and tangential distortion of 2 % to 6 % in this small photo.
STRONG = Lens(
    np.array([[220.0, 0.3, 78], [0, 222, 61], [0, 0, 1]]),
    (-0.3, 0.12, 2e-3, -1e-3, -0.03),
    (160, 120),
)


def look_from_above(lens: Lens, scale: float = 0.5, tilt: float = 0.0, **more: object) -> Shot:
    """A camera above the origin of the work frame, which is in the middle of the photo."""
    middle = complex(*lens.matrix[:2, 2])
    rotation, origin = aim_camera(lens, 0, middle, scale, (tilt, 35, 20))
    return Shot(lens, rotation, origin, **more)  # type: ignore[arg-type]


def list_pixels(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    v, u = np.mgrid[: lens.size[1], : lens.size[0]].astype(float)
    return u.ravel(), v.ravel()


def compute_coverage(loops: tuple[Loop, ...], shot: Shot, finer: int = 1) -> np.ndarray:
    """The covered fraction of each pixel of the photo, (H, W)."""
    fractions = np.zeros(shot.lens.size[::-1])
    window, covered = share(loops, shot, finer=finer)
    fractions[window] = covered
    return fractions


# -- the lens


def test_the_lens_projects_like_opencv() -> None:
    shot = look_from_above(STRONG, tilt=25)
    rng = np.random.default_rng(0)
    mm = rng.uniform(-40, 40, (500, 3)) * [1, 0.7, 0.1]
    pose = cv2.Rodrigues(shot.rotation)[0], shot.origin
    matrix = STRONG.matrix * [[1, 0, 1], [1, 1, 1], [1, 1, 1]]  # projectPoints has no skew
    plain = replace(shot, lens=Lens(matrix, STRONG.distortion, STRONG.size))
    seen = cv2.projectPoints(mm, *pose, matrix, np.array(STRONG.distortion))[0].reshape(-1, 2)
    for k in range(len(mm)):
        x, y, z = mm[k]
        assert np.abs(np.array(photo_from_work(plain, x, y, z)) - seen[k]).max() < 1e-9


def test_the_inverse_of_the_lens_is_exact() -> None:
    shot = look_from_above(STRONG, tilt=30)
    u, v = list_pixels(STRONG)
    again = photo_from_work(shot, *work_from_photo(shot, u, v))
    assert max(np.abs(again[0] - u).max(), np.abs(again[1] - v).max()) < 1e-9
    x, y = undistort(PINHOLE, u / 800, v / 800)
    assert np.array_equal(x, u / 800)
    assert np.array_equal(y, v / 800)


def test_a_camera_looks_at_the_given_point() -> None:
    rotation, origin = aim_camera(STRONG, 12 - 7j, 50 + 90j, 0.2, (17, 120, 200))
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert np.degrees(np.arccos(-rotation[2, 2])) == pytest.approx(17)
    straight_lens = replace(STRONG, distortion=(0, 0, 0, 0, 0))
    shot = Shot(straight_lens, rotation, origin)
    assert np.hypot(*np.array(photo_from_work(shot, 12.0, -7.0)) - (50, 90)) < 1e-9
    assert mm_per_px(look_from_above(PINHOLE, 0.25), 0) == pytest.approx(0.25 * (800 / 801) ** 0.5)


# -- the covered fraction of a pixel


def test_a_camera_that_moves_smears_an_edge() -> None:
    # The edge of a half plane becomes a ramp. Its width is the motion across the edge.
    half_plane = (box(0, -60, 60, 60),)
    for motion, width in ((8, 8.0), (8j, 0.0), (6 + 8j, 6.0)):
        shot = look_from_above(PINHOLE, 0.5, blur=0.3, motion=complex(motion))
        shot = replace(shot, rotation=np.diag([1.0, -1, -1]))
        grey = render(Scene(0.0, (Layer(half_plane, 1.0),)), shot)[60].astype(float) / 255
        rise = np.diff(grey)
        middle = (np.arange(len(rise)) + 0.5) @ rise
        assert middle == pytest.approx(79.5, abs=0.05)
        variance = (np.arange(len(rise)) + 0.5 - middle) ** 2 @ rise
        # Blur and pixel have 0.17, the rounding of the motion to pixels 0.33 at most.
        assert width**2 / 12 + 0.17 < variance < width**2 / 12 + 0.17 + 0.35


def compute_ellipse(shot: Shot, radius: float) -> tuple[float, np.ndarray]:
    """Area and centre, px, of the image of a circle around the origin, without distortion."""
    h = shot.lens.matrix @ np.column_stack([shot.rotation[:, :2], shot.origin])
    back = np.linalg.inv(h)
    c = back.T @ np.diag([1, 1, -(radius**2)]) @ back
    core = np.linalg.det(c[:2, :2])
    return float(np.pi * abs(np.linalg.det(c)) / core**1.5), -np.linalg.solve(c[:2, :2], c[:2, 2])


@pytest.mark.parametrize("tilt", [0, 18, 40])
@pytest.mark.parametrize("blur", [0.3, 0.7, 1.5])
def test_a_disc_has_the_area_and_the_centroid_of_its_ellipse(tilt: float, blur: float) -> None:
    shot = look_from_above(PINHOLE, 0.5, tilt, blur=blur)
    covered = compute_coverage((circle(0, 0, 14),), shot)
    size, centre = compute_ellipse(shot, 14)
    assert abs(covered.sum() / size - 1) < 1e-6
    v, u = np.mgrid[: covered.shape[0], : covered.shape[1]]
    assert (
        np.abs(np.array([(u * covered).sum(), (v * covered).sum()]) / covered.sum() - centre).max()
        < 1e-4
    )
    assert covered.min() > -1e-6
    assert covered.max() < 1 + 1e-6


@pytest.mark.parametrize("name", [*NAMED, 0, 1])
def test_a_part_covers_its_area_and_not_its_holes(name: str | int) -> None:
    part = NAMED[name]() if isinstance(name, str) else random_part(name)
    square = Lens(
        np.array([[800.0, 0, 99.5], [0, 800, 99.5], [0, 0, 1]]), (0, 0, 0, 0, 0), (200, 200)
    )
    shot = look_from_above(square, 0.5)
    covered = compute_coverage(part, shot)
    assert covered.sum() * 0.25 == pytest.approx(area(part), rel=1e-6)
    assert -1e-6 < covered.min() < covered.max() < 1 + 1e-6
    for loop in part[1:]:
        middle = complex(loop.points.mean())
        u, v = photo_from_work(shot, np.array([middle.real]), np.array([middle.imag]))
        assert covered[round(v[0]), round(u[0])] < 1e-3


def test_areas_are_those_of_formulas() -> None:
    assert area((circle(3, 4, 5),)) == pytest.approx(25 * np.pi)
    assert area((hole(circle(3, 4, 5)),)) == pytest.approx(-25 * np.pi)
    assert area((slot(1, 2, 30, 8, 33),)) == pytest.approx(22 * 8 + 16 * np.pi)
    assert area((rounded([(0, 0, 2), (10, 0, 0), (10, 6, 2), (0, 6, 0)]),)) == pytest.approx(
        60 - 2 * (4 - np.pi)
    )


def test_an_edge_is_at_its_place_in_the_pixel() -> None:
    """An edge through the middle of a pixel covers half of it: pixel centres are whole numbers."""
    shot = replace(
        look_from_above(replace(PINHOLE, matrix=np.diag([800.0, 800, 1])), 1.0),
        origin=np.array([0, 0, 800.0]),
    )
    shot = replace(shot, rotation=np.diag([1.0, -1, -1]))  # u = x, v = -y
    covered = compute_coverage((box(10, -50, 30.25, -20.5),), shot)
    assert covered[35, 10] == pytest.approx(0.5, abs=1e-6)
    assert covered[35].sum() == pytest.approx(20.25, abs=1e-5)
    assert covered[:, 20].sum() == pytest.approx(29.5, abs=1e-5)
    assert covered[50, 20] == pytest.approx(0.5, abs=1e-6)
    assert covered[50, 10] == pytest.approx(0.25, abs=1e-6)


def test_coverage_is_that_of_many_samples_in_each_pixel() -> None:
    """The comparison samples 14 x 14 places in each pixel through the lens, and blurs them."""
    samples_per_pixel, blur = 14, 0.7
    size, rim = (64, 70), 4
    middle = np.array(STRONG.size) / 2 - np.array(size) / 2
    matrix = STRONG.matrix.copy()
    matrix[:2, 2] -= middle
    shot = look_from_above(replace(STRONG, size=size, matrix=matrix), 0.5, 18, blur=blur)
    wide, high = (pixels + 2 * rim for pixels in size)
    places = np.mgrid[: high * samples_per_pixel, : wide * samples_per_pixel]
    v, u = (places + 0.5) / samples_per_pixel - 0.5 - rim
    x, y = work_from_photo(shot, u.ravel(), v.ravel())
    # The distance of each place from the border of the ring, in steps from place to place. A place
    # on the border counts half.
    depth = np.minimum(13 - np.hypot(x - 1, y - 2), np.hypot(x - 4, y + 1) - 6).reshape(u.shape)
    inside = (0.5 + depth / np.hypot(*np.gradient(depth))).clip(0, 1)
    offsets = np.arange(-rim * samples_per_pixel, rim * samples_per_pixel + 1) / samples_per_pixel
    kernel = np.exp(-((offsets / blur) ** 2) / 2)
    blurred = cv2.sepFilter2D(inside, cv2.CV_64F, kernel / kernel.sum(), kernel / kernel.sum())
    tiles = blurred.reshape(high, samples_per_pixel, wide, samples_per_pixel)
    expected = tiles.mean(axis=(1, 3))[rim:-rim, rim:-rim]
    part = (circle(1, 2, 13), hole(circle(4, -1, 6)))
    fractions = compute_coverage(part, shot)
    assert np.abs(fractions - expected).max() < 1e-3
    assert np.abs(fractions - compute_coverage(part, shot, finer=4)).max() < 2e-6


def test_the_part_of_a_shape_outside_the_photo_counts() -> None:
    shot = look_from_above(PINHOLE, 0.5)
    covered = compute_coverage((box(-200, -5, 10, 5).moved(-np.radians(20), 0),), shot)
    # The box extends beyond the left side of the photo.
    assert covered[60, :60] == pytest.approx(1, abs=1e-6)
    assert compute_coverage((circle(500, 0, 3),), shot).max() == 0


# -- light and sensor


def test_noise_has_the_given_variance_and_is_repeatable() -> None:
    shot = look_from_above(PINHOLE, read=2.0, shot=0.02, seed=3)
    photo = render(Scene(0.4), shot)
    assert photo.tobytes() == render(Scene(0.4), shot).tobytes()
    assert photo.tobytes() != render(Scene(0.4), replace(shot, seed=4)).tobytes()
    variance = 4 + 0.02 * 0.4 * 255 + 1 / 12
    assert photo.mean() == pytest.approx(102, abs=4 * (variance / photo.size) ** 0.5)
    assert photo.var() == pytest.approx(variance, rel=4 * (2 / photo.size) ** 0.5)


def test_light_falls_off_by_the_given_values() -> None:
    shot = look_from_above(PINHOLE, gradient=(0.4, -0.2), vignetting=0.3, exposure=1.2)
    photo = render(Scene(0.5), shot)
    assert photo.shape == (120, 160)
    assert photo[60, 80] == pytest.approx(0.5 * 1.2 * 255, abs=1)
    assert photo[0, 159] == pytest.approx(0.5 * 1.2 * 1.3 * 0.7 * 255, abs=0.6)
    assert photo[119, 0] == pytest.approx(0.5 * 1.2 * 0.7 * 0.7 * 255, abs=0.6)


@pytest.mark.parametrize(
    ("linear", "code"), [(0.0, 0), (0.002, 7), (0.18, 118), (0.5, 188), (1.0, 255), (2.0, 255)]
)
def test_srgb_codes_are_those_of_the_standard(linear: float, code: int) -> None:
    """The codes are those of tables of IEC 61966-2-1; 18 % grey is 118."""
    assert np.all(render(Scene(linear), look_from_above(PINHOLE, coding="srgb")) == code)


def test_layers_cover_each_other_in_colour() -> None:
    shot = look_from_above(PINHOLE)
    low, top = Layer((circle(0, 0, 20),), 0.2), Layer((circle(0, 0, 8),), (0.9, 0.5, 0.1))
    photo = render(Scene(0.6, (low, top)), shot)
    assert photo.shape == (120, 160, 3)
    assert photo[60, 80].tolist() == [round(255 * c) for c in (0.9, 0.5, 0.1)]
    assert photo[60, 80 + 26].tolist() == [51] * 3
    assert photo[5, 5].tolist() == [153] * 3


def test_grain_is_fixed_to_the_bench() -> None:
    """From twice the distance, one pixel shows the mean of two pixels of the nearer photo."""
    far, near = (
        replace(look_from_above(PINHOLE, s), rotation=np.diag([1.0, -1, -1])) for s in (0.5, 0.25)
    )
    shots = [render(Scene(0.5, texture=0.1), shot).astype(float) for shot in (far, near)]
    assert 8 < shots[0].std() < 18
    inner, halved = shots[0][30:90, 40:120], shots[1].reshape(60, 2, 80, 2).mean(axis=(1, 3))
    assert np.corrcoef(inner.ravel(), halved.ravel())[0, 1] > 0.9


def test_files_hold_the_rendered_photo(tmp_path: Path) -> None:
    photo = render(Scene(0.5, (Layer((circle(0, 0, 9),), 0.1),)), look_from_above(PINHOLE, read=2))
    write_photo(tmp_path / "a.png", photo)
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED), photo)
    write_photo(tmp_path / "a.jpg", photo)
    assert (
        np.abs(cv2.imread(str(tmp_path / "a.jpg"), cv2.IMREAD_UNCHANGED).astype(int) - photo).mean()
        < 2
    )


# -- markers and boards


def test_markers_and_boards_are_found_by_opencv() -> None:
    lens = Lens(
        np.array([[1500.0, 0, 500], [0, 1500, 370], [0, 0, 1]]), (-0.1, 0.05, 0, 0, 0), (1000, 740)
    )
    paper = make_sheet("A4", 30)
    layers = markers((-60, -80, 250, 150), paper.ids, paper.corners, "4X4_50")
    rotation, origin = aim_camera(lens, complex(*paper.free) / 2, 500 + 370j, 0.34, (12, 60, 10))
    shot = Shot(lens, rotation, origin, read=1.5)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(render(Scene(0.4, layers), shot))
    assert sorted(ids.ravel().tolist()) == list(paper.ids)
    for number, seen in zip(ids.ravel().tolist(), corners, strict=True):
        u, v = photo_from_work(shot, *paper.corners[number].T)
        assert np.abs(seen[0] - np.column_stack([u, v])).max() < 1.5
    board, places = chessboard(9, 6, 20.0)
    rotation, origin = aim_camera(lens, places.mean(), 500 + 370j, 0.34, (20, 200, 5))
    shot = Shot(lens, rotation, origin, read=1.5)
    is_found, grid = cv2.findChessboardCornersSB(render(Scene(0.4, board), shot), (9, 6))
    assert is_found
    truth = np.column_stack(photo_from_work(shot, places.real, places.imag))
    assert max(np.abs(truth - corner).sum(axis=1).min() for corner in grid.reshape(-1, 2)) < 0.2


# -- the truth


@pytest.mark.parametrize("seed", range(4))
def test_each_point_of_the_true_path_has_the_offset_from_the_part(seed: int) -> None:
    """Distances from the part as 2000 points per piece, independent of the formulas."""
    part = random_part(seed)
    truth = offset_truth(part, 3.0)
    all_pieces = pieces(part)
    piece_index = np.repeat(np.arange(len(all_pieces.start)), 2000)
    drawn, _ = all_pieces.at(piece_index, np.tile(np.linspace(0, 1, 2000), len(all_pieces.start)))
    points = truth.points[::40]
    distances = np.array([np.abs(drawn - point).min() for point in points])
    assert np.abs(distances - 3).max() < 1e-3
    assert np.abs(all_pieces.distance(points) - 3).max() < 1e-9
    foot = points + 3 * truth.normals[::40]
    assert all_pieces.distance(foot).max() < 1e-9
    # The points are outside of the part: the winding number around each of them is 0.
    lengths = np.cumsum([2000 * len(loop.points) for loop in part])[:-1]
    windings = np.zeros(len(points))
    for loop in np.split(drawn, lengths):
        steps = (np.roll(loop, -1) - points[:, None]) / (loop - points[:, None])
        windings += np.angle(steps).sum(axis=1)
    assert np.abs(windings).max() < 1e-6


def test_the_true_path_of_a_square_has_round_and_sharp_corners() -> None:
    truth = offset_truth((box(0, 0, 20, 10),), 3.0)
    assert set(np.round(truth.points[~truth.sharp].imag, 9)) >= {-3.0, 13.0}
    around = truth.points[truth.sharp]
    assert (
        np.abs(np.abs(around[(around.real > 20) & (around.imag > 10)] - (20 + 10j)) - 3).max()
        < 1e-12
    )
    # The path inside of a frame has the corners of a smaller rectangle.
    inner = offset_truth((box(-50, -50, 50, 50), hole(box(0, 0, 20, 10))), 3.0)
    kinks = inner.points[inner.sharp & (np.abs(inner.points - (10 + 5j)) < 15)]
    assert {(round(z.real), round(z.imag)) for z in kinks.tolist()} == {
        (3, 3),
        (17, 3),
        (3, 7),
        (17, 7),
    }


def test_a_hole_too_small_for_the_tool_has_no_path() -> None:
    small = offset_truth((box(-20, -20, 20, 20), hole(circle(0, 0, 2.9))), 3.0)
    assert np.abs(small.points).min() > 20


def test_path_errors_are_the_errors_that_were_added() -> None:
    part = (
        rounded([(-30, -20, 5), (30, -20, 5), (30, 20, 5), (-30, 20, 5)]),
        hole(circle(0, 0, 9)),
    )
    truth = offset_truth(part, 3.0)
    exact = path_error(truth.points, truth)
    assert max(exact.largest, exact.near, exact.missed) < 1e-9
    shifted = path_error(truth.points + 0.02 * truth.normals, truth)
    assert (shifted.largest, shifted.rms) == pytest.approx((0.02, 0.02), abs=1e-9)
    # The path is on the wrong side of the outline, at the right distance.
    assert path_error(truth.points + 6 * truth.normals, truth).largest > 5
    half = path_error(truth.points[truth.points.real > 0], truth)
    assert half.largest < 1e-9
    assert half.missed == pytest.approx(0.5, abs=0.02)


def test_errors_at_sharp_corners_are_counted_separately() -> None:
    truth = offset_truth((box(-30, -20, 30, 20),), 3.0)
    path = truth.points.copy()
    path[truth.sharp] += 0.3 * truth.normals[truth.sharp]
    error = path_error(path, truth)
    assert error.largest < 1e-9
    assert error.near == pytest.approx(0.3, abs=1e-9)


def test_plans_are_read_with_their_arcs(tmp_path: Path) -> None:
    body = [
        {"do": "movej", "to": [0, 0, 20]},
        {"do": "movel", "to": [5, 0, 0]},
        {"do": "output", "value": 1.0},
        {"do": "movec", "via": [0, 5, 0], "to": [-5, 0, 0]},
        {"do": "movec", "via": [0, -5, 0], "to": [5, 0, 0]},
        {"do": "movel", "to": [9, 0, 0]},
        {"do": "output", "value": 0.0},
        {"do": "movel", "to": [9, 0, 20]},
    ]
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps({"body": body}))
    points = read_planned(plan)
    arcs = points[points.real <= 5.0]
    assert np.abs(np.abs(arcs) - 5).max() < 1e-9
    assert np.abs(np.diff(points)).max() <= 0.1
    assert np.abs(np.diff(points)).sum() == pytest.approx(10 * np.pi + 4, abs=1e-2)


@pytest.mark.parametrize("photo", photos(6, 1), ids=lambda photo: f"{photo.name}-{photo.plane}")
def test_job_and_camera_file_describe_the_rendered_photo(photo: Photo, tmp_path: Path) -> None:
    write(tmp_path, photo)
    job, camera = (
        load_job(tmp_path / f"{photo.name}.toml"),
        read_camera(source(tmp_path / f"{photo.name}.yaml")),
    )
    assert np.array_equal(camera.matrix, photo.shot.lens.matrix)
    outline = np.concatenate([loop.points for loop in photo.loops])
    mm = np.column_stack([outline.real, outline.imag])
    u, v = photo_from_work(photo.shot, *mm.T)
    if photo.plane == "markers":
        assert job.camera.markers == "A4"
        return
    camera_table = job.camera
    if photo.plane == "pose":
        assert camera_table.plane_from is not None
        plane = make_plane(camera, pose_from_values(camera_table.plane_from))
    else:
        plane = fit_plane(camera, camera_table.points_px, camera_table.points_mm)
    assert (
        np.abs(
            distort(camera, map_points(plane.pixel_from_work, mm)) - np.column_stack([u, v])
        ).max()
        < 2e-3
    )


def test_the_empty_bench_is_the_same_without_the_part(tmp_path: Path) -> None:
    photo = photos(1, 1)[0]
    write(tmp_path, replace(photo, empty=True))
    full, bench = (
        cv2.imread(str(tmp_path / f"{photo.name}{suffix}.png"), cv2.IMREAD_GRAYSCALE)
        for suffix in ("", "-empty")
    )
    assert load_job(tmp_path / f"{photo.name}.toml").image.background.endswith(
        f"{photo.name}-empty.png"
    )
    covered = compute_coverage(photo.loops, photo.shot)
    change = full.astype(float) / bench
    assert change[covered < 1e-6].mean() == pytest.approx(1 / 0.95, abs=0.002)
    assert abs(change[covered > 1 - 1e-6].mean() * 0.95 - 1) > 0.3


def test_the_loops_of_random_parts_keep_a_distance() -> None:
    for seed in range(60):
        part = random_part(seed)
        for first, second in combinations(part, 2):
            all_pieces = pieces((second,))
            piece_index = np.repeat(np.arange(len(all_pieces.start)), 50)
            fractions = np.tile(np.linspace(0, 1, 50), len(all_pieces.start))
            places, _ = all_pieces.at(piece_index, fractions)
            assert pieces((first,)).distance(places).min() > 0.8
        assert all(area((loop,)) < 0 for loop in part[1:])
        outer = pieces(part[:1])
        ends = np.append(outer.start, outer.start[0])
        assert all(abs(b - a) > 0.05 for a, b in pairwise(ends))
