"""A calibrated camera: its pixels without lens distortion and back, and its files.

Read are the two kinds that are in use: ROS camera_info YAML (camera_calibration_parsers) and OpenCV FileStorage (YAML,
XML, JSON). Written is camera_info. A calibration is for one size of photo; a file without that size is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import tell
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.vision.camera.lens import COUNTS, distort_ideal, straight
from camgen.vision.camera.stored import AGAIN, Stored, cut, find_numbers, parse_stored, parse_yaml

# What the text of a camera file says, before it is looked at whether it can be a camera.

_SIZE_REMEDY = "add image_width and image_height, the size of the calibrated photos in pixels"

_MATRIX_KEYS = (
    "camera_matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "intrinsic_matrix", "camera_mtx", "mtx", "K",
    "M", "M1",
)  # fmt: skip
_LENS_KEYS = (
    "distortion_coefficients", "Distortion_Coefficients", "distortionCoefficients", "distortion_coeffs", "distCoeffs",
    "dist_coeffs", "dist_coeff", "dist_coefs", "distortion", "dist", "D", "D1",
)  # fmt: skip
_WIDTH_KEYS = ("image_width", "image_Width", "imageWidth", "width")
_HEIGHT_KEYS = ("image_height", "image_Height", "imageHeight", "height")
_PAIR_KEYS = ("image_size", "imageSize", "size", "resolution", "img_size", "calibImageSize")
_NAME_KEYS = ("camera_name", "cameraName", "name")
_MODEL_KEYS = ("distortion_model", "distortionModel", "camera_model")
_FISHEYE_KEYS = ("fisheye_model", "fisheye", "Calibrate_UseFisheyeModel")


class CameraData(Struct, frozen=True, eq=False):
    """The parts of a camera file and what it calls them. matrix, lens: of any shape; model: "" where none is named."""

    matrix: FloatArray
    matrix_key: str
    lens: FloatArray
    lens_key: str
    size: tuple[int, int]
    name: str
    model: str


# -- ROS camera_info


def from_camera_info(file: str, text: str) -> CameraData:
    """camera_info YAML. InputError for what is no YAML, missing keys, and matrices of another size than said."""
    root = parse_yaml(file, text)
    if not isinstance(root, dict) or not all(isinstance(key, str) for key in root):
        raise InputError(file, "is no camera_info file: it holds no named values", remedy=AGAIN)
    _whole_frame(file, root)
    for key, shape in {"rectification_matrix": (3, 3), "projection_matrix": (3, 4)}.items():
        if key in root and _matrix_data(file, root, key).shape != shape:
            raise InputError(file, f"{key} is not {shape[0]} x {shape[1]}", remedy=AGAIN)
    model = next(
        (root[key] for key in ("distortion_model", "camera_model") if key in root), "plumb_bob"
    )
    return CameraData(
        matrix=_matrix_data(file, root, "camera_matrix"),
        matrix_key="camera_matrix",
        lens=_matrix_data(file, root, "distortion_coefficients"),
        lens_key="distortion_coefficients",
        size=(_whole(file, root, "image_width"), _whole(file, root, "image_height")),
        name=str(root.get("camera_name", "")),
        model=str(model).lower(),
    )


def _whole_frame(file: str, root: Mapping[str, object]) -> None:
    """A calibration for photos that are binned or cut out of the sensor's has another matrix than the file says."""
    roi = root.get("roi")
    cut = isinstance(roi, dict) and any(
        str(roi.get(key, "0")) != "0" for key in ("x_offset", "y_offset")
    )
    if cut or any(str(root.get(key, "0")) not in ("0", "1") for key in ("binning_x", "binning_y")):
        what = "is for photos that are binned or cut out (binning_x, binning_y, roi)"
        raise InputError(file, what, remedy="calibrate with the photos as they are used")


def _value(file: str, root: Mapping[str, object], key: str) -> object:
    if key not in root:
        near = get_close_matches(key, list(root), 1)
        raise InputError(
            file, f"has no {key}", remedy=f"{near[0]} looks like it: correct it" if near else AGAIN
        )
    return root[key]


def _whole(file: str, root: Mapping[str, object], key: str) -> int:
    text = str(_value(file, root, key))
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError(file, f"{key} is {cut(text)}, not a whole number", remedy=_SIZE_REMEDY)
    return int(text)


def _matrix_data(file: str, root: Mapping[str, object], key: str) -> FloatArray:
    found = _value(file, root, key)
    if not isinstance(found, dict):
        raise InputError(file, f"{key} has no rows, cols and data", remedy=AGAIN)
    rows, columns = (
        _whole(file, {f"{key}: {k}": found.get(k, "")}, f"{key}: {k}") for k in ("rows", "cols")
    )
    data = found.get("data")
    if not isinstance(data, list):
        raise InputError(file, f"{key} has no list of data", remedy=AGAIN)
    if len(data) != rows * columns:
        what = f"{key} says {rows} x {columns} and holds {counted(len(data), 'number')}"
        raise InputError(file, what, remedy=AGAIN)
    return find_numbers(file, key, found)


# -- OpenCV FileStorage


def from_storage(file: str, text: str) -> CameraData:
    """An OpenCV FileStorage: YAML, XML or JSON. InputError as for camera_info."""
    root = parse_stored(file, text)
    keys = tuple(root)
    _one_camera(file, keys)
    matrix_key = _name(file, keys, _MATRIX_KEYS, "camera matrix")
    lens_key = _name(file, keys, _LENS_KEYS, "distortion coefficients")
    name, model = (_first_text(root, which) for which in (_NAME_KEYS, _MODEL_KEYS))
    if any(root[key] not in ("0", "false") for key in _FISHEYE_KEYS if key in keys):
        model = "fisheye"
    return CameraData(
        matrix=find_numbers(file, matrix_key, root[matrix_key]),
        matrix_key=matrix_key,
        lens=find_numbers(file, lens_key, root[lens_key]),
        lens_key=lens_key,
        size=_store_size(file, root),
        name=name,
        model=model.lower(),
    )


def _one_camera(file: str, keys: Sequence[str]) -> None:
    both = next((pair for pair in (("M1", "M2"), ("K1", "K2")) if set(pair) <= set(keys)), None)
    if both:
        what = f"holds two cameras, {both[0]} and {both[1]}"
        raise InputError(
            file, what, remedy="keep the matrix and the distortion of the one that takes the photos"
        )


def _name(file: str, keys: Sequence[str], known: Sequence[str], what: str) -> str:
    found = [key for key in known if key in keys]
    if not found:
        held = f"it holds {cut(', '.join(keys))}" if keys else "it holds no named values"
        raise InputError(file, f"has no {what}, {held}", remedy=f"name it {known[0]}")
    if len(found) > 1:
        raise InputError(
            file, f"has its {what} twice, {found[0]} and {found[1]}", remedy="keep one of them"
        )
    return found[0]


def _first_text(root: Mapping[str, Stored], known: Sequence[str]) -> str:
    values = (root[key] for key in known if key in root)
    return next((value for value in values if isinstance(value, str) and not _is_number(value)), "")


def _is_number(text: str) -> bool:
    return text.lstrip("+-").replace(".", "", 1).isdigit()


def _store_size(file: str, root: Mapping[str, Stored]) -> tuple[int, int]:
    pair = next((find_numbers(file, key, root[key]) for key in _PAIR_KEYS if key in root), None)
    if pair is None:
        named = [
            next((key for key in which if key in root), "") for which in (_WIDTH_KEYS, _HEIGHT_KEYS)
        ]
        if "" in named:
            raise InputError(file, "does not say the size of the photos", remedy=_SIZE_REMEDY)
        found = [find_numbers(file, key, root[key]) for key in named]
        pair = np.array([one.item() if one.ndim == 0 else np.nan for one in found])
    if pair.size != 2 or not np.isfinite(pair).all() or (pair % 1).any():
        raise InputError(
            file, "has a size of the photos that is not two whole numbers", remedy=_SIZE_REMEDY
        )
    width, height = (int(value) for value in pair.ravel().tolist())
    return width, height


_MOST_PX = 1_000_000
#: Even the third coefficient of a telephoto lens, where the radius is below 0.02, stays under this.
_MOST_BENT = 1e12
#: Both of ROS' names are the same polynomial with fewer or more of its coefficients.
_PLUMB_BOB, _RATIONAL = "plumb_bob", "rational_polynomial"
_MODELS = {_PLUMB_BOB: COUNTS[:3], _RATIONAL: COUNTS}


class Camera(Struct, frozen=True, eq=False):
    """A camera as calibrated.

    matrix: (3, 3), px: [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]. distortion: (n,), OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1
    s2 s3 s4 tau_x tau_y, the first 0, 4, 5, 8, 12 or 14 of them. size: width and height of its photos, px.
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]
    name: str


def undistort(camera: Camera, points: FloatArray) -> FloatArray:
    """Pixels (N, 2) of the photo as a camera with this matrix and no distortion would have them.

    Solved to 1e-9 px. nan where the lens model shows nothing: beyond the place where it stops rising and turns back.
    """
    return _onto(camera, straight(camera.distortion, _from(camera, points)))


def distort(camera: Camera, points: FloatArray) -> FloatArray:
    """Photo pixels (N, 2) of undistorted ones: the inverse of ``undistort``. nan beyond the turn of the model."""
    return _onto(camera, distort_ideal(camera.distortion, _from(camera, points)))


def _from(camera: Camera, points: FloatArray) -> FloatArray:
    """Pixels as points at distance 1 before the camera. The matrix is upper triangular: exact without an inverse."""
    (fx, skew, cx), (_, fy, cy) = camera.matrix[:2].tolist()
    y = (points[:, 1] - cy) / fy
    return np.column_stack([(points[:, 0] - cx - skew * y) / fx, y])


def _onto(camera: Camera, points: FloatArray) -> FloatArray:
    moved: FloatArray = points @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    return moved


def read_camera(source: Source) -> Camera:
    """The camera in a file, by content. InputError says what is missing or cannot be meant, and what to do."""
    name = source.name
    if len(source.data) > source.limits.camera_bytes:
        what = f"has more than {tell(source.limits.camera_bytes)} bytes: no camera file"
        raise InputError(
            name, what, remedy="give the file of a calibration, or raise limits.camera_bytes"
        )
    try:
        text = source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        remedy = "give camera_info YAML or OpenCV YAML, XML or JSON"
        raise InputError(
            name, "cannot be read as a camera: not a text file", remedy=remedy
        ) from error
    if not text.strip():
        raise InputError(name, "is empty", remedy=AGAIN)
    stored = text.lstrip().startswith(("%YAML:", "<", "{")) or "!!opencv-matrix" in text
    read: Callable[[str, str], CameraData] = from_storage if stored else from_camera_info
    return _check(read(name, text), source)


def camera_info(camera: Camera) -> str:
    """ROS camera_info YAML of a camera; ``read_camera`` gives back the same numbers to the last bit.

    Rectification is the identity and the projection that of the camera itself, as for every camera that is no half of
    a stereo pair.
    """
    model = _PLUMB_BOB if len(camera.distortion) in _MODELS[_PLUMB_BOB] else _RATIONAL
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    lines = [
        f"image_width: {camera.size[0]}",
        f"image_height: {camera.size[1]}",
        f"camera_name: {_quote(camera.name)}",
        *_matrix("camera_matrix", camera.matrix),
        f"distortion_model: {model}",
        *_matrix("distortion_coefficients", camera.distortion[None]),
        *_matrix("rectification_matrix", np.eye(3)),
        *_matrix("projection_matrix", projection),
    ]
    return "\n".join(lines) + "\n"


def _matrix(name: str, values: FloatArray) -> list[str]:
    rows, columns = values.shape
    numbers = ", ".join(repr(value) for value in values.ravel().tolist())
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{numbers}]"]


def _quote(name: str) -> str:
    """A YAML string. Quoted always: a bare ``on`` or ``1e5`` would be read as something else."""
    escaped = name.encode("unicode_escape").decode("ascii").replace('"', '\\"')
    return f'"{escaped}"'


def _check(data: CameraData, source: Source) -> Camera:
    file = source.name
    model = data.model or _RATIONAL
    if model not in _MODELS:
        what = f"has the lens model {model!r}, camgen knows {' and '.join(_MODELS)}"
        raise InputError(file, what, remedy="calibrate again with one of these")
    matrix, lens = (
        _array(file, data.matrix_key, data.matrix),
        _array(file, data.lens_key, data.lens).ravel(),
    )
    if matrix.shape != (3, 3):
        raise InputError(file, f"{data.matrix_key} is {_shape(matrix)}, not 3 x 3", remedy=AGAIN)
    counts = _MODELS[model]
    if len(lens) not in counts:
        what = f"{data.lens_key} holds {counted(len(lens), 'number')}, {model} has {', '.join(map(str, counts))}"
        raise InputError(file, what, remedy=AGAIN)
    if np.abs(lens).max(initial=0) > _MOST_BENT:
        what = f"{data.lens_key} holds {float(np.abs(lens).max()):g}, no lens bends so much"
        raise InputError(file, what, remedy=AGAIN)
    _is_camera_matrix(file, data.matrix_key, matrix)
    width, height = data.size
    if not (0 < width <= _MOST_PX and 0 < height <= _MOST_PX):
        remedy = "give the width and height of the calibrated photos in pixels"
        raise InputError(file, f"image size {width} x {height} cannot be", remedy=remedy)
    return Camera(
        matrix=frozen(matrix),
        distortion=frozen(lens),
        size=(width, height),
        name=data.name or source.stem,
    )


def _array(file: str, key: str, values: FloatArray) -> FloatArray:
    if not np.isfinite(values).all():
        raise InputError(file, f"{key} holds a number that is not finite", remedy=AGAIN)
    return values


def _is_camera_matrix(file: str, key: str, matrix: FloatArray) -> None:
    for name, focal in zip(("fx", "fy"), np.diag(matrix)[:2].tolist(), strict=True):
        if focal <= 0:
            zero = " (all 0: the camera was never calibrated)" if not matrix.any() else ""
            raise InputError(
                file, f"{key}: focal length {name} is {focal:g}{zero}, not positive", remedy=AGAIN
            )
    if matrix[2].tolist() != [0, 0, 1] or matrix[1, 0] != 0:
        remedy = "its rows are fx 0 cx, 0 fy cy, 0 0 1; look whether it is transposed"
        raise InputError(file, f"{key} is no camera matrix", remedy=remedy)


def _shape(values: FloatArray) -> str:
    return " x ".join(map(str, values.shape))
