"""A calibrated camera: its pixels without lens distortion and back, and its files.

Read are the two kinds that are in use: ROS camera_info YAML (camera_calibration_parsers) and OpenCV FileStorage (YAML,
XML, JSON). Written is camera_info. A calibration is for one size of photo; a file without that size is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.errors import InputError
from camgen.pose import FloatArray, frozen
from camgen.vision.camera_data import Data, from_camera_info, from_storage
from camgen.vision.lens import COUNTS, bent, straight

_MOST_BYTES = 1_000_000
_MOST_PX = 1_000_000
#: Even the third coefficient of a telephoto lens, where the radius is below 0.02, stays under this.
_MOST_BENT = 1e12
#: Both of ROS' names are the same polynomial with fewer or more of its coefficients.
_PLUMB_BOB, _RATIONAL = "plumb_bob", "rational_polynomial"
_MODELS = {_PLUMB_BOB: COUNTS[:3], _RATIONAL: COUNTS}
_LOOKS = "copy it again, or calibrate with camgen calibrate"


class Camera(Struct, frozen=True, eq=False):
    """A camera as calibrated.

    matrix: (3, 3), px: [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]. distortion: (n,), OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1
    s2 s3 s4 tau_x tau_y, the first 0, 4, 5, 8, 12 or 14 of them. size: width and height of its photos, px.
    """

    matrix: FloatArray
    distortion: FloatArray
    size: tuple[int, int]
    name: str


def undistorted(camera: Camera, points: FloatArray) -> FloatArray:
    """Pixels (N, 2) of the photo as a camera with this matrix and no distortion would have them.

    Solved to 1e-9 px. nan where the lens model shows nothing: beyond the place where it stops rising and turns back.
    """
    return _onto(camera, straight(camera.distortion, _from(camera, points)))


def distorted(camera: Camera, points: FloatArray) -> FloatArray:
    """Photo pixels (N, 2) of undistorted ones: the inverse of ``undistorted``. nan beyond the turn of the model."""
    return _onto(camera, bent(camera.distortion, _from(camera, points)))


def _from(camera: Camera, points: FloatArray) -> FloatArray:
    """Pixels as points at distance 1 before the camera. The matrix is upper triangular: exact without an inverse."""
    (fx, skew, cx), (_, fy, cy) = camera.matrix[:2].tolist()
    y = (points[:, 1] - cy) / fy
    return np.column_stack([(points[:, 0] - cx - skew * y) / fx, y])


def _onto(camera: Camera, points: FloatArray) -> FloatArray:
    moved: FloatArray = points @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    return moved


def read_camera(path: Path) -> Camera:
    """The camera in a file, by content. InputError says what is missing or cannot be meant, and what to do."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(path.name, "is too large for a camera file", remedy="give the file of a calibration")
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: a zero byte in a name, or no text at all
        reason = "not a text file" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", str(error))
        remedy = "give camera_info YAML or OpenCV YAML, XML or JSON"
        raise InputError(path.name, f"cannot be read as a camera: {reason}", remedy=remedy) from error
    if not text.strip():
        raise InputError(path.name, "is empty", remedy=_LOOKS)
    stored = text.lstrip().startswith(("%YAML:", "<", "{")) or "!!opencv-matrix" in text
    read: Callable[[str, str], Data] = from_storage if stored else from_camera_info
    return _checked(read(path.name, text), path)


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
        f"camera_name: {_quoted(camera.name)}",
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


def _quoted(name: str) -> str:
    """A YAML string. Quoted always: a bare ``on`` or ``1e5`` would be read as something else."""
    escaped = name.encode("unicode_escape").decode("ascii").replace('"', '\\"')
    return f'"{escaped}"'


def _checked(data: Data, path: Path) -> Camera:
    file = path.name
    model = data.model or _RATIONAL
    if model not in _MODELS:
        what = f"has the lens model {model!r}, camgen knows {' and '.join(_MODELS)}"
        raise InputError(file, what, remedy="calibrate again with one of these")
    matrix, lens = _array(file, data.matrix_key, data.matrix), _array(file, data.lens_key, data.lens).ravel()
    if matrix.shape != (3, 3):
        raise InputError(file, f"{data.matrix_key} is {_shape(matrix)}, not 3 x 3", remedy=_LOOKS)
    counts = _MODELS[model]
    if len(lens) not in counts:
        what = f"{data.lens_key} holds {len(lens)} numbers, {model} has {', '.join(map(str, counts))}"
        raise InputError(file, what, remedy=_LOOKS)
    if np.abs(lens).max(initial=0) > _MOST_BENT:
        what = f"{data.lens_key} holds {float(np.abs(lens).max()):g}, no lens bends so much"
        raise InputError(file, what, remedy=_LOOKS)
    _is_camera_matrix(file, data.matrix_key, matrix)
    width, height = data.size
    if not (0 < width <= _MOST_PX and 0 < height <= _MOST_PX):
        remedy = "give the width and height of the calibrated photos in pixels"
        raise InputError(file, f"image size {width} x {height} cannot be", remedy=remedy)
    return Camera(matrix=frozen(matrix), distortion=frozen(lens), size=(width, height), name=data.name or path.stem)


def _array(file: str, key: str, values: FloatArray) -> FloatArray:
    if not np.isfinite(values).all():
        raise InputError(file, f"{key} holds a number that is not finite", remedy=_LOOKS)
    return values


def _is_camera_matrix(file: str, key: str, matrix: FloatArray) -> None:
    for name, focal in zip(("fx", "fy"), np.diag(matrix)[:2].tolist(), strict=True):
        if focal <= 0:
            zero = " (all 0: the camera was never calibrated)" if not matrix.any() else ""
            raise InputError(file, f"{key}: focal length {name} is {focal:g}{zero}, not positive", remedy=_LOOKS)
    if matrix[2].tolist() != [0, 0, 1] or matrix[1, 0] != 0:
        remedy = "its rows are fx 0 cx, 0 fy cy, 0 0 1; look whether it is transposed"
        raise InputError(file, f"{key} is no camera matrix", remedy=remedy)


def _shape(values: FloatArray) -> str:
    return " x ".join(map(str, values.shape))
