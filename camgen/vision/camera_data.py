"""What the text of a camera file says, before it is looked at whether it can be a camera.

camera_info is YAML; every scalar is taken as text first, since YAML would make a number of a camera name like 0012 and
a text of 1e-05. FileStorage is what OpenCV itself reads; the names in it are those of OpenCV's samples and of common
scripts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.pose import FloatArray

if TYPE_CHECKING:
    import cv2

_AGAIN = "copy it again, or calibrate with camgen calibrate"
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


class Data(Struct, frozen=True, eq=False):
    """The parts of a camera file and what it calls them. matrix, lens: of any shape; model: "" where none is named."""

    matrix: FloatArray
    matrix_key: str
    lens: FloatArray
    lens_key: str
    size: tuple[int, int]
    name: str
    model: str


# -- ROS camera_info


def from_camera_info(file: str, text: str) -> Data:
    """camera_info YAML. InputError for what is no YAML, missing keys, and matrices of another size than said."""
    import yaml  # noqa: PLC0415 (loaded only by what needs it)

    try:
        root = yaml.load(text, Loader=yaml.BaseLoader)  # strings, lists and maps, nothing else
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}" if mark else ""
        raise InputError(file, f"is no YAML: {error.problem or error.context}", where, _AGAIN) from error
    except (yaml.YAMLError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise InputError(file, f"is no YAML: {reason}", remedy=_AGAIN) from error
    if not isinstance(root, dict) or not all(isinstance(key, str) for key in root):
        raise InputError(file, "is no camera_info file: it holds no named values", remedy=_AGAIN)
    _whole_frame(file, root)
    for key, shape in {"rectification_matrix": (3, 3), "projection_matrix": (3, 4)}.items():
        if key in root and _matrix(file, root, key).shape != shape:
            raise InputError(file, f"{key} is not {shape[0]} x {shape[1]}", remedy=_AGAIN)
    model = next((root[key] for key in ("distortion_model", "camera_model") if key in root), "plumb_bob")
    return Data(
        matrix=_matrix(file, root, "camera_matrix"),
        matrix_key="camera_matrix",
        lens=_matrix(file, root, "distortion_coefficients"),
        lens_key="distortion_coefficients",
        size=(_whole(file, root, "image_width"), _whole(file, root, "image_height")),
        name=str(root.get("camera_name", "")),
        model=str(model).lower(),
    )


def _whole_frame(file: str, root: Mapping[str, object]) -> None:
    """A calibration for photos that are binned or cut out of the sensor's has another matrix than the file says."""
    roi = root.get("roi")
    cut = isinstance(roi, dict) and any(str(roi.get(key, "0")) != "0" for key in ("x_offset", "y_offset"))
    if cut or any(str(root.get(key, "0")) not in ("0", "1") for key in ("binning_x", "binning_y")):
        what = "is for photos that are binned or cut out (binning_x, binning_y, roi)"
        raise InputError(file, what, remedy="calibrate with the photos as they are used")


def _value(file: str, root: Mapping[str, object], key: str) -> object:
    if key not in root:
        near = get_close_matches(key, list(root), 1)
        raise InputError(file, f"has no {key}", remedy=f"{near[0]} looks like it: correct it" if near else _AGAIN)
    return root[key]


def _whole(file: str, root: Mapping[str, object], key: str) -> int:
    text = str(_value(file, root, key))
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise InputError(file, f"{key} is {_cut(text)}, not a whole number", remedy=_SIZE_REMEDY)
    return int(text)


def _matrix(file: str, root: Mapping[str, object], key: str) -> FloatArray:
    found = _value(file, root, key)
    if not isinstance(found, dict):
        raise InputError(file, f"{key} has no rows, cols and data", remedy=_AGAIN)
    rows, columns = (_whole(file, {f"{key}: {k}": found.get(k, "")}, f"{key}: {k}") for k in ("rows", "cols"))
    data = found.get("data")
    if not isinstance(data, list):
        raise InputError(file, f"{key} has no list of data", remedy=_AGAIN)
    if len(data) != rows * columns:
        what = f"{key} says {rows} x {columns} and holds {len(data)} numbers"
        raise InputError(file, what, remedy=_AGAIN)
    try:
        return np.array([_number(value) for value in data], dtype=np.float64).reshape(rows, columns)
    except ValueError as error:
        raise InputError(file, f"{key} holds {_cut(str(error))}, not a number", remedy=_AGAIN) from error


def _number(value: object) -> float:
    """A YAML float. Python's float takes more than that (1_000, nan): what is no plain number is named, not guessed."""
    text = str(value)
    if text.lower().lstrip("+-") in (".inf", ".nan"):
        return float("nan")
    try:
        if "_" in text:
            raise ValueError
        return float(text)
    except ValueError as error:
        raise ValueError(text) from error


def _cut(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...")


# -- OpenCV FileStorage


def from_storage(file: str, text: str) -> Data:
    """An OpenCV FileStorage: YAML, XML or JSON. InputError as for camera_info."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        keys = tuple(root.keys()) if root.isMap() else ()
    except (cv2.error, SystemError) as error:  # SystemError: what OpenCV's constructor makes of its own errors
        raise InputError(file, f"cannot be read by OpenCV: {_reason(error)}", remedy=_AGAIN) from error
    _one_camera(file, keys)
    matrix_key = _named(file, keys, _MATRIX_KEYS, "camera matrix")
    lens_key = _named(file, keys, _LENS_KEYS, "distortion coefficients")
    name, model = (_first_text(root, keys, which) for which in (_NAME_KEYS, _MODEL_KEYS))
    if any(root.getNode(key).isInt() and root.getNode(key).real() for key in _FISHEYE_KEYS if key in keys):
        model = "fisheye"
    return Data(
        matrix=_stored(file, root.getNode(matrix_key), matrix_key),
        matrix_key=matrix_key,
        lens=_stored(file, root.getNode(lens_key), lens_key),
        lens_key=lens_key,
        size=_stored_size(file, root, keys),
        name=name,
        model=model.lower(),
    )


def _one_camera(file: str, keys: Sequence[str]) -> None:
    both = next((pair for pair in (("M1", "M2"), ("K1", "K2")) if set(pair) <= set(keys)), None)
    if both:
        what = f"holds two cameras, {both[0]} and {both[1]}"
        raise InputError(file, what, remedy="keep the matrix and the distortion of the one that takes the photos")


def _named(file: str, keys: Sequence[str], known: Sequence[str], what: str) -> str:
    found = [key for key in known if key in keys]
    if not found:
        held = f"it holds {_cut(', '.join(keys))}" if keys else "it holds no named values"
        raise InputError(file, f"has no {what}, {held}", remedy=f"name it {known[0]}")
    if len(found) > 1:
        raise InputError(file, f"has its {what} twice, {found[0]} and {found[1]}", remedy="keep one of them")
    return found[0]


def _first_text(root: cv2.FileNode, keys: Sequence[str], known: Sequence[str]) -> str:
    nodes = [root.getNode(key) for key in known if key in keys]
    return next((str(node.string()) for node in nodes if node.isString()), "")


def _stored(file: str, node: cv2.FileNode, key: str) -> FloatArray:
    """A matrix of OpenCV, or plain lists of numbers."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    try:
        found = node.mat() if node.isMap() else _listed(node)
    except (cv2.error, SystemError) as error:
        raise InputError(file, f"{key} cannot be read by OpenCV: {_reason(error)}", remedy=_AGAIN) from error
    if found is None or found.ndim > 2:
        raise InputError(file, f"{key} is no matrix of numbers", remedy=_AGAIN)
    return np.asarray(found, dtype=np.float64)


def _listed(node: cv2.FileNode) -> FloatArray | None:
    items = [node.at(i) for i in range(node.size())] if node.isSeq() else []
    if all(item.isInt() or item.isReal() for item in items):
        return np.array([item.real() for item in items])
    rows = [_listed(item) for item in items]
    lengths = {-1 if row is None or row.ndim != 1 else len(row) for row in rows}
    return np.array(rows) if len(lengths) == 1 and lengths != {-1} else None


def _stored_size(file: str, root: cv2.FileNode, keys: Sequence[str]) -> tuple[int, int]:
    pair = next((_listed(root.getNode(key)) for key in _PAIR_KEYS if key in keys), None)
    if pair is None:
        nodes = [next((root.getNode(k) for k in which if k in keys), None) for which in (_WIDTH_KEYS, _HEIGHT_KEYS)]
        pair = np.array([node.real() if node is not None and (node.isInt() or node.isReal()) else -1 for node in nodes])
        if (pair == -1).any():
            raise InputError(file, "does not say the size of the photos", remedy=_SIZE_REMEDY)
    if pair.shape != (2,) or not np.isfinite(pair).all() or (pair % 1).any():
        raise InputError(file, "has a size of the photos that is not two whole numbers", remedy=_SIZE_REMEDY)
    width, height = (int(value) for value in pair.tolist())
    return width, height


def _reason(error: Exception) -> str:
    """What OpenCV says, without where in its source."""
    cause = error.__cause__ if isinstance(error, SystemError) and error.__cause__ else error
    said = getattr(cause, "err", "") or str(cause)
    return " ".join(str(said).split())[:120]
