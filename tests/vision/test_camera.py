"""Cameras distort points as OpenCV does. Files of three kinds are read, damaged ones refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from camgen.model.errors import InputError
from camgen.model.pose import frozen
from camgen.vision.camera.camera import Camera, distort, format_camera_info, read_camera, undistort
from camgen.vision.camera.lens import distort_ideal, find_fold, straighten
from tests.support.files import source

MATRIX = frozen([[800.0, 0, 321], [0, 802, 236], [0, 0, 1]])
#: Distortion of a lens by the number of its coefficients, in the order of OpenCV.
LENSES = {
    0: [],
    4: [-0.28, 0.1, 0.001, -0.0007],
    5: [-0.28, 0.1, 0.001, -0.0007, -0.02],
    8: [0.9, 0.15, 0.0005, -0.0003, 0.002, 1.25, 0.4, 0.02],
}
LENSES[12] = [*LENSES[8], 0.001, -0.002, 0.0015, 0.0007]
LENSES[14] = [*LENSES[12], 0.03, -0.02]


def camera(count: int, name: str = "bench") -> Camera:
    return Camera(matrix=MATRIX, distortion=frozen(LENSES[count]), size=(640, 480), name=name)


def grid() -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, 639, 13), np.linspace(0, 479, 11))
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize("count", LENSES)
def test_distorted_points_are_those_that_opencv_projects(count: int) -> None:
    px = grid()
    rays = np.column_stack([(px - MATRIX[:2, 2]) / np.diag(MATRIX)[:2], np.ones(len(px))])
    lens = np.array(LENSES[count]) if count else None
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), MATRIX, lens)[0].reshape(-1, 2)
    assert np.abs(distort(camera(count), px) - expected).max() < 1e-9


@pytest.mark.parametrize("count", LENSES)
def test_undistorting_is_the_inverse_of_distorting_to_1e_9_px(count: int) -> None:
    px = grid()
    ideal = undistort(camera(count), px)
    assert np.abs(distort(camera(count), ideal) - px).max() < 1e-9
    if count:
        assert np.abs(ideal - px).max() > 5  # The lenses do bend.


def test_a_matrix_may_have_skew() -> None:
    skewed = Camera(
        frozen([[800.0, 3, 321], [0, 802, 236], [0, 0, 1]]), frozen(LENSES[5]), (640, 480), "skew"
    )
    px = grid()
    assert np.abs(distort(skewed, undistort(skewed, px)) - px).max() < 1e-9
    assert np.allclose(undistort(skewed, np.array([[321.0, 236]])), [[321, 236]])


def test_points_beyond_the_fold_of_the_lens_model_are_nan() -> None:
    """x (1 - x^2 / 2) increases up to x = sqrt(2/3), where it is 0.5443."""
    lens = np.array([-0.5, 0, 0, 0])
    assert find_fold(lens) == pytest.approx(np.sqrt(2 / 3), abs=1e-12)
    near, far = np.array([[0.81, 0]]), np.array([[0.83, 0]])
    assert distort_ideal(lens, near)[0, 0] == pytest.approx(0.81 - 0.81**3 / 2, abs=1e-15)
    assert np.isnan(distort_ideal(lens, far)).all()
    assert straighten(lens, np.array([[0.5442, 0]]))[0, 0] == pytest.approx(0.8095, abs=0.01)
    assert np.isnan(straighten(lens, np.array([[0.5444, 0]]))).all()


@settings(derandomize=True)
@given(
    st.floats(-0.5, 0.5),
    st.floats(-0.3, 0.3),
    st.floats(-0.01, 0.01),
    st.floats(-0.01, 0.01),
    st.floats(-0.2, 0.2),
)
def test_straightened_points_distort_back_and_lie_before_the_fold(
    k1: float, k2: float, p1: float, p2: float, k3: float
) -> None:
    lens = np.array([k1, k2, p1, p2, k3])
    seen = np.column_stack([np.linspace(-1.5, 1.5, 31), np.linspace(0.9, -0.7, 31)])
    ideal = straighten(lens, seen)
    is_known = np.isfinite(ideal).all(axis=1)
    assert is_known[17]  # A point near the middle can always be straightened.
    assert np.allclose(distort_ideal(lens, ideal[is_known]), seen[is_known], rtol=0, atol=1e-11)
    assert np.all(np.linalg.norm(ideal[is_known], axis=1) < find_fold(lens))


def test_a_coefficient_of_nearly_zero_does_no_harm() -> None:
    lens = np.array([0.1, 0, 0, 0, 5e-324])
    assert np.allclose(distort_ideal(lens, np.array([[1.0, 0]])), [[1.1, 0]])


# -- files


@pytest.mark.parametrize("count", LENSES)
def test_camera_info_keeps_every_bit(tmp_path: Path, count: int) -> None:
    before = camera(count, name='on: "1e5" \u00b5')
    path = tmp_path / "camera.yaml"
    path.write_text(format_camera_info(before))
    after = read_camera(source(path))
    assert np.array_equal(after.matrix, before.matrix)
    assert np.array_equal(after.distortion, before.distortion)
    assert (after.size, after.name) == (before.size, before.name)


def test_camera_info_has_the_keys_and_shapes_of_ros() -> None:
    """The file is read by another YAML reader and looks like one of camera_calibration_parsers."""
    info = yaml.safe_load(format_camera_info(camera(5)))
    assert (info["image_width"], info["image_height"], info["camera_name"]) == (640, 480, "bench")
    assert info["distortion_model"] == "plumb_bob"
    assert info["camera_matrix"] == {"rows": 3, "cols": 3, "data": MATRIX.ravel().tolist()}
    assert info["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": LENSES[5]}
    assert info["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()
    projection = info["projection_matrix"]
    assert (projection["rows"], projection["cols"]) == (3, 4)
    rational = yaml.safe_load(format_camera_info(camera(8)))
    assert rational["distortion_model"] == "rational_polynomial"


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_a_file_that_opencv_stores_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"stored{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array(MATRIX))
    storage.write("distortion_coefficients", np.array(LENSES[5])[:, None])
    storage.release()
    stored = read_camera(source(path))
    assert np.allclose(stored.matrix, MATRIX, rtol=1e-15)
    assert np.allclose(stored.distortion, LENSES[5], rtol=1e-15)
    assert (stored.size, stored.name) == ((640, 480), "stored")


GOOD = format_camera_info(camera(5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a: [1, 2", "is not YAML"),
        ("just words", "holds no named values"),
        (GOOD.replace("image_width: 640\n", ""), "has no image_width"),
        (GOOD.replace("640", "640.5"), "image_width is '640.5', not a whole number"),
        (GOOD.replace("640", "0"), "image size 0 x 480 is not possible"),
        (GOOD.replace("camera_matrix", "camera_matrx"), "camera_matrx looks like it"),
        (GOOD.replace("[800.0", "[abc", 1), "camera_matrix holds 'abc', not a number"),
        (GOOD.replace("800.0", ".nan"), "holds a number that is not finite"),
        (GOOD.replace("[800.0", "[-800.0"), "focal length fx is -800, not positive"),
        (GOOD.replace("cols: 5", "cols: 6"), "says 1 x 6 and holds 5 numbers"),
        (GOOD.replace("plumb_bob", "equidistant"), "has the lens model 'equidistant'"),
        (GOOD.replace("-0.28,", "-0.28e99,"), "more than any lens"),
        (GOOD + "roi:\n  x_offset: 12\n  y_offset: 0\n", "photos that are binned or cut out"),
        ("%YAML:1.0\n---\ncamera_matrix: 3\n", "has no distortion coefficients"),
        ("%YAML:1.0\n---\nD: 3\n", "has no camera matrix"),
        ("<opencv_storage></opencv_storage>", "holds no named values"),
        ("<opencv_storage><K>", "is not XML: no element found (line 1)"),
        (
            '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage><K>&b;</K></opencv_storage>',
            "a document type or an entity",
        ),
        ("{", "is not JSON"),
        ('{"K": [[1, 0, 2], [0, 1]], "D": 3}', "K is not a matrix of numbers"),
        ('{"K": ' + "[" * 5000 + "]" * 5000 + "}", "nested too deep"),
        ("%YAML:1.0\n---\nK: [1, 2\n", "is not YAML: expected ',' or ']'"),
        (
            "%YAML:1.0\n---\nK: !!opencv-matrix\n  rows: 3\n  cols: 3\n"
            f"  data: [{'1,' * 8}]\nD: 1\n",
            "K says 3 x 3 and holds 8 numbers",
        ),
        (
            "%YAML:1.0\n---\nK: !!opencv-matrix\n  rows: 1e9\n  cols: 3\n  data: [1]\nD: 1\n",
            "K: rows is not a number of rows or columns",
        ),
        # OpenCV's own reader ends the process here.
        (
            "%YAMLnull:1.0\n---\nimage_width: 640\n"
            "K: !!opencv-matrix\n  rows: 3\n  colsnull: 3\n  data: [1]\nD: 1\n",
            "K is not a matrix of numbers",
        ),
    ],
)
def test_an_invalid_camera_file_is_refused_in_one_line(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_camera(source(path))
    assert message in str(caught.value)
    assert str(caught.value).startswith("bad.yaml: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "photo.yaml").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(InputError, match="not a text file"):
        read_camera(source(tmp_path / "photo.yaml"))
