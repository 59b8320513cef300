"""A calibrated camera: maps its pixels to pixels without distortion and back, and reads its files.

Two kinds of files are read, those that are in use: ROS camera_info YAML
(camera_calibration_parsers) and OpenCV FileStorage (YAML, XML, JSON). Camera_info is also written.
A calibration is for one size of photo; a file without that size is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import format_limit
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.vision.camera.lens import COUNTS, distort_ideal, straighten
from camgen.vision.camera.stored import (
    AGAIN,
    Stored,
    find_numbers,
    parse_stored,
    parse_yaml,
    quote_shortened,
)

# The contents of a camera file, before they are checked.

_SIZE_REMEDY = "add image_width and image_height, the size of the calibrated photos in pixels"

_MATRIX_KEYS = (
    "camera_matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "intrinsic_matrix",
    "camera_mtx", "mtx", "K", "M", "M1",
)  # fmt: skip
_LENS_KEYS = (
    "distortion_coefficients", "Distortion_Coefficients", "distortionCoefficients",
    "distortion_coeffs", "distCoeffs", "dist_coeffs", "dist_coeff", "dist_coefs", "distortion",
    "dist", "D", "D1",
)  # fmt: skip
_WIDTH_KEYS = ("image_width", "image_Width", "imageWidth", "width")
_HEIGHT_KEYS = ("image_height", "image_Height", "imageHeight", "height")
_PAIR_KEYS = ("image_size", "imageSize", "size", "resolution", "img_size", "calibImageSize")
_NAME_KEYS = ("camera_name", "cameraName", "name")
_MODEL_KEYS = ("distortion_model", "distortionModel", "camera_model")
_FISHEYE_KEYS = ("fisheye_model", "fisheye", "Calibrate_UseFisheyeModel")


class CameraData(Struct, frozen=True, eq=False):
    """The contents of a camera file.

    matrix: camera matrix, in any shape.
    matrix_key: name of the matrix in the file.
    lens: lens coefficients, in any shape.
    lens_key: name of the coefficients in the file.
    size: (width, height) of the photos, px.
    name: name of the camera, "" for none.
    model: name of the lens model in lower case, "" for none.
    """

    matrix: FloatArray
    matrix_key: str
    lens: FloatArray
    lens_key: str
    size: tuple[int, int]
    name: str
    model: str


# -- ROS camera_info


def parse_camera_info(file: str, text: str) -> CameraData:
    """Read ROS camera_info YAML.

    Raises InputError for invalid YAML, missing keys, and matrices whose size is not rows x cols.
    """
    root = parse_yaml(file, text)
    if not isinstance(root, dict) or not all(isinstance(key, str) for key in root):
        raise InputError(file, "is not a camera_info file: it holds no named values", remedy=AGAIN)
    _check_whole_frame(file, root)
    for key, shape in {"rectification_matrix": (3, 3), "projection_matrix": (3, 4)}.items():
        if key in root and _read_matrix(file, root, key).shape != shape:
            raise InputError(file, f"{key} is not {shape[0]} x {shape[1]}", remedy=AGAIN)
    model = root.get("distortion_model", root.get("camera_model", "plumb_bob"))
    return CameraData(
        matrix=_read_matrix(file, root, "camera_matrix"),
        matrix_key="camera_matrix",
        lens=_read_matrix(file, root, "distortion_coefficients"),
        lens_key="distortion_coefficients",
        size=(_read_integer(file, root, "image_width"), _read_integer(file, root, "image_height")),
        name=str(root.get("camera_name", "")),
        model=str(model).lower(),
    )


def _check_whole_frame(file: str, root: Mapping[str, object]) -> None:
    """Raises InputError for a calibration of photos that are binned or cut out of the sensor's.

    Such photos have another camera matrix than the file states.
    """
    roi = root.get("roi")
    is_cut = isinstance(roi, dict) and any(
        str(roi.get(key, "0")) != "0" for key in ("x_offset", "y_offset")
    )
    is_binned = any(str(root.get(key, "0")) not in ("0", "1") for key in ("binning_x", "binning_y"))
    if is_cut or is_binned:
        raise InputError(
            file,
            "is for photos that are binned or cut out (binning_x, binning_y, roi)",
            remedy="calibrate with the photos as they are used",
        )


def _find_value(file: str, root: Mapping[str, object], key: str) -> object:
    """The value of a key. Raises InputError if it is missing, with a name that is similar."""
    if key not in root:
        import difflib  # noqa: PLC0415 (1 ms, only for a missing value)

        similar = difflib.get_close_matches(key, list(root), 1)
        remedy = f"{similar[0]} looks like it: correct it" if similar else AGAIN
        raise InputError(file, f"has no {key}", remedy=remedy)
    return root[key]


def _read_integer(file: str, root: Mapping[str, object], key: str) -> int:
    text = str(_find_value(file, root, key))
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError(
            file, f"{key} is {quote_shortened(text)}, not a whole number", remedy=_SIZE_REMEDY
        )
    return int(text)


def _read_matrix(file: str, root: Mapping[str, object], key: str) -> FloatArray:
    """A matrix with rows, cols and data. Raises InputError if one is missing or does not fit."""
    value = _find_value(file, root, key)
    if not isinstance(value, dict):
        raise InputError(file, f"{key} has no rows, cols and data", remedy=AGAIN)
    rows = _read_integer(file, {f"{key}: rows": value.get("rows", "")}, f"{key}: rows")
    columns = _read_integer(file, {f"{key}: cols": value.get("cols", "")}, f"{key}: cols")
    data = value.get("data")
    if not isinstance(data, list):
        raise InputError(file, f"{key} has no list of data", remedy=AGAIN)
    if len(data) != rows * columns:
        raise InputError(
            file,
            f"{key} says {rows} x {columns} and holds {counted(len(data), 'number')}",
            remedy=AGAIN,
        )
    return find_numbers(file, key, value)


# -- OpenCV FileStorage


def parse_storage(file: str, text: str) -> CameraData:
    """Read an OpenCV FileStorage: YAML, XML or JSON.

    Raises InputError for a file in none of these formats, for values that are missing or invalid,
    and for two cameras.
    """
    root = parse_stored(file, text)
    keys = tuple(root)
    _check_single_camera(file, keys)
    matrix_key = _find_key(file, keys, _MATRIX_KEYS, "camera matrix")
    lens_key = _find_key(file, keys, _LENS_KEYS, "distortion coefficients")
    name, model = _find_text(root, _NAME_KEYS), _find_text(root, _MODEL_KEYS)
    if any(root[key] not in ("0", "false") for key in _FISHEYE_KEYS if key in keys):
        model = "fisheye"
    return CameraData(
        matrix=find_numbers(file, matrix_key, root[matrix_key]),
        matrix_key=matrix_key,
        lens=find_numbers(file, lens_key, root[lens_key]),
        lens_key=lens_key,
        size=_read_size(file, root),
        name=name,
        model=model.lower(),
    )


def _check_single_camera(file: str, keys: Sequence[str]) -> None:
    for first, second in (("M1", "M2"), ("K1", "K2")):
        if first in keys and second in keys:
            raise InputError(
                file,
                f"holds two cameras, {first} and {second}",
                remedy="keep the matrix and the distortion of the one that takes the photos",
            )


def _find_key(file: str, keys: Sequence[str], names: Sequence[str], what: str) -> str:
    """The key that is one of several possible names. Raises InputError for none and for two."""
    present = [name for name in names if name in keys]
    if not present:
        contents = (
            f"it holds {quote_shortened(', '.join(keys))}" if keys else "it holds no named values"
        )
        raise InputError(file, f"has no {what}, {contents}", remedy=f"name it {names[0]}")
    if len(present) > 1:
        raise InputError(
            file, f"has its {what} twice, {present[0]} and {present[1]}", remedy="keep one of them"
        )
    return present[0]


def _find_text(root: Mapping[str, Stored], names: Sequence[str]) -> str:
    """The first value under one of several names that is a text, not a number; "" for none."""
    for name in names:
        value = root.get(name)
        if isinstance(value, str) and not _is_number(value):
            return value
    return ""


def _is_number(text: str) -> bool:
    return text.lstrip("+-").replace(".", "", 1).isdigit()


def _find_first(root: Mapping[str, Stored], names: Sequence[str]) -> str:
    """The first of several names that is a key; "" for none."""
    return next(filter(root.__contains__, names), "")


def _read_size(file: str, root: Mapping[str, Stored]) -> tuple[int, int]:
    """Width and height of the photos, px. Raises InputError if they are missing or invalid."""
    pair_key = _find_first(root, _PAIR_KEYS)
    if pair_key:
        pair = find_numbers(file, pair_key, root[pair_key])
    else:
        keys = [_find_first(root, names) for names in (_WIDTH_KEYS, _HEIGHT_KEYS)]
        if "" in keys:
            raise InputError(file, "does not say the size of the photos", remedy=_SIZE_REMEDY)
        sides = [find_numbers(file, key, root[key]) for key in keys]
        pair = np.array([side.item() if side.ndim == 0 else np.nan for side in sides])
    if pair.size != 2 or not np.isfinite(pair).all() or (pair % 1).any():
        raise InputError(
            file, "has a size of the photos that is not two whole numbers", remedy=_SIZE_REMEDY
        )
    width, height = map(int, pair.ravel().tolist())
    return width, height


# The camera.

#: Pixels along a side of a photo, at most.
_MAX_SIDE = 1_000_000
#: Largest lens coefficient. Even the third coefficient of a telephoto lens, which shows radii below
#: 0.02, is smaller.
_MAX_COEFFICIENT = 1e12
#: ROS' names of the lens models: the same polynomial with fewer or more of its coefficients.
_PLUMB_BOB, _RATIONAL = "plumb_bob", "rational_polynomial"
_MODELS = {_PLUMB_BOB: COUNTS[:3], _RATIONAL: COUNTS}


class Camera(Struct, frozen=True, eq=False):
    """A calibrated camera.

    matrix: (3, 3) [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], px.
    distortion: (n,) OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y, the first 0, 4, 5, 8,
        12 or 14 of them.
    size: (width, height) of its photos, px.
    name: name of the camera.
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]
    name: str


def sample_photo(size: tuple[int, int], count: int) -> FloatArray:
    """Pixels (N, 2) of a grid of `count` x `count` from corner to corner of the photo."""
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, count), np.linspace(0, size[1] - 1, count))
    return np.column_stack([u.ravel(), v.ravel()])


def undistort(camera: Camera, points: FloatArray) -> FloatArray:
    """Map photo pixels (N, 2) to pixels (N, 2) of a camera with this matrix and no distortion.

    Solved to 1e-9 px. nan beyond the valid radius of the lens model.
    """
    ideal = straighten(camera.distortion, _convert_to_rays(camera, points))
    return _convert_to_pixels(camera, ideal)


def distort(camera: Camera, points: FloatArray) -> FloatArray:
    """Map undistorted pixels (N, 2) to photo pixels (N, 2), as `undistort` reversed.

    nan beyond the valid radius of the lens model.
    """
    seen = distort_ideal(camera.distortion, _convert_to_rays(camera, points))
    return _convert_to_pixels(camera, seen)


def _convert_to_rays(camera: Camera, points: FloatArray) -> FloatArray:
    """Convert pixels (N, 2) to points (N, 2) at distance 1 in front of the camera.

    The matrix is upper triangular, so that this is exact without its inverse.
    """
    (fx, skew, cx), (_, fy, cy) = camera.matrix[:2].tolist()
    y = (points[:, 1] - cy) / fy
    return np.column_stack([(points[:, 0] - cx - skew * y) / fx, y])


def _convert_to_pixels(camera: Camera, points: FloatArray) -> FloatArray:
    """Convert points (N, 2) at distance 1 in front of the camera to pixels (N, 2)."""
    return np.asarray(points @ camera.matrix[:2, :2].T + camera.matrix[:2, 2])


def read_camera(source: Source) -> Camera:
    """Read a camera from a file, whose format is found from its contents.

    Raises InputError if a value is missing or not possible, with a remedy.
    """
    name, limit = source.name, source.limits.camera_bytes
    if len(source.data) > limit:
        raise InputError(
            name,
            f"has more than {format_limit(limit)} bytes, too many for a camera file",
            remedy="give the file of a calibration, or raise limits.camera_bytes",
        )
    try:
        text = source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            name,
            "cannot be read as a camera: not a text file",
            remedy="give camera_info YAML or OpenCV YAML, XML or JSON",
        ) from error
    if not text.strip():
        raise InputError(name, "is empty", remedy=AGAIN)
    is_stored = text.lstrip().startswith(("%YAML:", "<", "{")) or "!!opencv-matrix" in text
    read: Callable[[str, str], CameraData] = parse_storage if is_stored else parse_camera_info
    return _make_camera(read(name, text), source)


def format_camera_info(camera: Camera) -> str:
    """Write a camera as ROS camera_info YAML; `read_camera` returns the same numbers bit for bit.

    The rectification is the identity and the projection that of the camera itself, as for every
    camera that does not belong to a stereo pair.
    """
    model = _PLUMB_BOB if len(camera.distortion) in _MODELS[_PLUMB_BOB] else _RATIONAL
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    lines = [
        f"image_width: {camera.size[0]}",
        f"image_height: {camera.size[1]}",
        f"camera_name: {_quote(camera.name)}",
        *_format_matrix("camera_matrix", camera.matrix),
        f"distortion_model: {model}",
        *_format_matrix("distortion_coefficients", camera.distortion[None]),
        *_format_matrix("rectification_matrix", np.eye(3)),
        *_format_matrix("projection_matrix", projection),
    ]
    return "\n".join(lines) + "\n"


def _format_matrix(name: str, values: FloatArray) -> list[str]:
    rows, columns = values.shape
    data = f"  data: {values.ravel().tolist()}"
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", data]


def _quote(name: str) -> str:
    """A YAML string, always in quotes: a bare `on` or `1e5` would be read as another type."""
    return '"' + name.encode("unicode_escape").decode("ascii").replace('"', '\\"') + '"'


def _make_camera(data: CameraData, source: Source) -> Camera:
    file = source.name
    model = data.model or _RATIONAL
    if model not in _MODELS:
        raise InputError(
            file,
            f"has the lens model {model!r}, camgen knows {' and '.join(_MODELS)}",
            remedy="calibrate again with one of these",
        )
    for key, values in ((data.matrix_key, data.matrix), (data.lens_key, data.lens)):
        if not np.isfinite(values).all():
            raise InputError(file, f"{key} holds a number that is not finite", remedy=AGAIN)
    matrix, lens = data.matrix, data.lens.ravel()
    if matrix.shape != (3, 3):
        raise InputError(
            file,
            f"{data.matrix_key} is {' x '.join(map(str, matrix.shape))}, not 3 x 3",
            remedy=AGAIN,
        )
    counts = _MODELS[model]
    if len(lens) not in counts:
        raise InputError(
            file,
            f"{data.lens_key} holds {counted(len(lens), 'number')}, "
            f"{model} has {', '.join(map(str, counts))}",
            remedy=AGAIN,
        )
    if np.abs(lens).max(initial=0) > _MAX_COEFFICIENT:
        raise InputError(
            file,
            f"{data.lens_key} has a coefficient of {np.abs(lens).max():g}, more than any lens",
            remedy=AGAIN,
        )
    _check_matrix(file, data.matrix_key, matrix)
    width, height = data.size
    if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE):
        raise InputError(
            file,
            f"image size {width} x {height} is not possible",
            remedy="give the width and height of the calibrated photos in pixels",
        )
    return Camera(
        matrix=frozen(matrix),
        distortion=frozen(lens),
        size=(width, height),
        name=data.name or source.stem,
    )


def _check_matrix(file: str, key: str, matrix: FloatArray) -> None:
    for name, focal in zip(("fx", "fy"), np.diag(matrix)[:2].tolist(), strict=True):
        if focal <= 0:
            zero = " (all 0: the camera was never calibrated)" if not matrix.any() else ""
            raise InputError(
                file, f"{key}: focal length {name} is {focal:g}{zero}, not positive", remedy=AGAIN
            )
    if matrix[2].tolist() != [0, 0, 1] or matrix[1, 0] != 0:
        raise InputError(
            file,
            f"{key} is not a camera matrix",
            remedy="its rows are fx 0 cx, 0 fy cy, 0 0 1; check whether it is transposed",
        )
