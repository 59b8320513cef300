"""Places of things in a rendered photo, and the share of each pixel that they cover.

Coverage is the integral of a layer's area, weighted with the pixel's own square blurred by a
Gaussian. That integral over the area is turned into one along its outline (Green's theorem), which
is sampled densely, drawn through the lens by formula and summed up pixel by pixel. So coverage and
blur are exact, there is no grid of sub-pixels, and no inverse of the lens.

    share(p) = - sum over the outline of  S(u - p_u) k(v - p_v) dv
    k = box of 1 px * Gaussian,  S' = k

The minus: outlines have material on their left seen from above, and v runs against y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bench.render.shapes import Loop, Pieces, pieces

#: The blur is cut off here, in sigmas: 6e-7 of an edge is lost.
_TAIL = 5.0
#: Outline points that are summed up at a time.
_CHUNK = 2_000
#: Nodes and weights of Gauss' quadrature, from -1 to 1.
_GAUSS = np.polynomial.legendre.leggauss(4)
#: Nodes and weights from 0 to 1.
_NODES, _WEIGHTS = (_GAUSS[0] + 1) / 2, _GAUSS[1] / 2
#: Imaginary step of a derivative, so small that it is exact to the last digit.
_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Lens:
    """A pin-hole camera with distortion.

    matrix: (3, 3), px.
    distortion: k1 k2 p1 p2 k3.
    size: width and height, px.
    """

    matrix: np.ndarray
    distortion: tuple[float, float, float, float, float]
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shot:
    """The place of the camera, the light, and the errors of the sensor.

    rotation, origin: camera_from_work, z forward, mm.
    blur: standard deviation, px, without the pixel's own square.
    motion: path of the camera during the photo, u + i v, px.
    gradient: change of light from left to right and from above to below, as a share of the middle.
    vignetting: share of the light that the corners lose.
    read: standard deviation of the noise, in 1/255 of white.
    shot: variance that each 1/255 of light adds, in squares of 1/255.
    coding: "linear" or "srgb".
    """

    lens: Lens
    rotation: np.ndarray
    origin: np.ndarray
    blur: float = 0.7
    motion: complex = 0j
    exposure: float = 1.0
    gradient: tuple[float, float] = (0.0, 0.0)
    vignetting: float = 0.0
    read: float = 0.0
    shot: float = 0.0
    coding: str = "linear"
    seed: int = 0


# -- places in the photo


def aim_camera(
    lens: Lens, place: complex, pixel: complex, scale: float, turns: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """camera_from_work (rotation, origin) with a place, mm, in a pixel before distortion.

    scale: mm of a pixel at that depth.
    turns: angle between optical axis and bench normal, direction in the photo of the axis of that
        tilt, and roll of the camera, deg.
    """
    tilt, direction, roll = np.radians(turns)
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    cross = np.cross(np.eye(3), -axis)
    tilted = np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross
    cos, sin = np.cos(roll), np.sin(roll)
    turned = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
    rotation = tilted @ np.diag([1.0, -1.0, -1.0]) @ turned
    ray = np.linalg.solve(lens.matrix, [pixel.real, pixel.imag, 1.0])
    point = rotation @ [place.real, place.imag, 0.0]
    return rotation, ray * scale * lens.matrix[0, 0] - point


def shoot_from_above(size: tuple[int, int], scale: float, **fields: object) -> Shot:
    """A photo from straight above, the origin in its middle.

    scale: mm of a pixel.
    fields: further fields of the shot.
    """
    middle = complex(size[0] - 1, size[1] - 1) / 2
    matrix = np.array([[9000.0, 0, middle.real], [0, 9000, middle.imag], [0, 0, 1]])
    lens = Lens(matrix, (0,) * 5, size)
    return Shot(lens, *aim_camera(lens, 0j, middle, scale, (0, 0, 0)), **fields)


def distort(lens: Lens, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays a, b (at distance 1) after radial and tangential distortion (Brown), also complex."""
    k1, k2, p1, p2, k3 = lens.distortion
    r = a * a + b * b
    radial = 1 + r * (k1 + r * (k2 + r * k3))
    u = a * radial + 2 * p1 * a * b + p2 * (r + 2 * a * a)
    v = b * radial + p1 * (r + 2 * b * b) + 2 * p2 * a * b
    return u, v


def undistort(lens: Lens, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of ``distort`` by Newton's method, until the steps vanish."""
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = a.copy(), b.copy()
    for _ in range(30):
        fx, fy = distort(lens, x, y)
        r = x * x + y * y
        radial, slope = 1 + r * (k1 + r * (k2 + r * k3)), 2 * (k1 + r * (2 * k2 + r * 3 * k3))
        # The derivative is symmetric.
        xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
        yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
        xy = x * y * slope + 2 * (p1 * x + p2 * y)
        gone_x, gone_y = a - fx, b - fy
        det = xx * yy - xy * xy
        step_x, step_y = (yy * gone_x - xy * gone_y) / det, (xx * gone_y - xy * gone_x) / det
        x, y = x + step_x, y + step_y
        if max(np.abs(step_x).max(), np.abs(step_y).max()) < 1e-15:
            break
    return x, y


def photo_from_work(
    shot: Shot, x: np.ndarray, y: np.ndarray, z: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels u, v of places in mm. Complex places carry a derivative along."""
    r, t = shot.rotation, shot.origin
    depth = r[2, 0] * x + r[2, 1] * y + (r[2, 2] * z + t[2])
    a = (r[0, 0] * x + r[0, 1] * y + (r[0, 2] * z + t[0])) / depth
    b = (r[1, 0] * x + r[1, 1] * y + (r[1, 2] * z + t[1])) / depth
    a, b = distort(shot.lens, a, b)
    (fx, skew, cu), (_, fy, cv) = shot.lens.matrix[:2].tolist()
    return fx * a + skew * b + cu, fy * b + cv


def work_from_photo(shot: Shot, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places x, y (mm, z = 0) of pixels: the inverse of ``photo_from_work``."""
    (fx, skew, cu), (_, fy, cv) = shot.lens.matrix[:2].tolist()
    b = (v - cv) / fy
    a, b = undistort(shot.lens, (u - cu - skew * b) / fx, b)
    back = np.linalg.inv(np.column_stack([shot.rotation[:, :2], shot.origin]))
    x, y, w = (row[0] * a + row[1] * b + row[2] for row in back)
    return x / w, y / w


def mm_per_px(shot: Shot, place: complex) -> float:
    """The size of a pixel at a place of the work plane: the root of its area."""
    x = place.real + np.array([1j * _STEP, 0])
    y = place.imag + np.array([0, 1j * _STEP])
    u, v = photo_from_work(shot, x, y)
    return float(abs(np.linalg.det(np.array([u.imag, v.imag]) / _STEP)) ** -0.5)


# -- the share of a pixel that a layer covers


def share(
    loops: Sequence[Loop], shot: Shot, z: float = 0.0, finer: int = 1
) -> tuple[tuple[slice, slice], np.ndarray]:
    """Rows and columns of the photo, and the share of each pixel there (H, W) that loops cover.

    Outside of them it is 0.

    finer: factor for the number of points along the outlines, to see that there are enough.
    """
    u, v, dv = _outline(loops, shot, z, finer)
    reach = 0.5 + _TAIL * shot.blur
    left, right = math.floor(u.min() - reach) - 1, math.ceil(u.max() + reach) + 2
    top, bottom = math.floor(v.min() - reach) - 1, math.ceil(v.max() + reach) + 2
    width, height = shot.lens.size
    # Points to the left of the photo count within it, since sums run from left to right.
    total = np.zeros((bottom - top + 1) * (right - left + 1))
    for k in range(0, len(u), _CHUNK):
        chunk = slice(k, k + _CHUNK)
        _add(total, right - left + 1, u[chunk] - left, v[chunk] - top, dv[chunk], shot.blur)
    covered = total.reshape(bottom - top + 1, -1).cumsum(axis=1)
    rows = slice(max(top, 0), min(bottom + 1, height))
    columns = slice(max(left, 0), min(right + 1, width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0))
    down = slice(rows.start - top, rows.stop - top)
    across = slice(columns.start - left, columns.stop - left)
    return (rows, columns), covered[down, across]


def _outline(
    loops: Sequence[Loop], shot: Shot, z: float, finer: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points along the outlines in the photo, px, and the share of each in the integral over dv."""
    all_pieces = pieces(loops)
    count = len(all_pieces.start)
    probe = np.repeat(np.arange(count), 5)
    _, _, du, dv = _seen(all_pieces, probe, np.tile(np.linspace(0, 1, 5), count), shot, z)
    # Elements as long as the blur is wide, a pixel at most: exact to 1e-6 with four nodes each.
    speed = np.hypot(du, dv).reshape(-1, 5).max(axis=1)
    elements = np.ceil(1.1 * finer * speed / min(1.0, shot.blur)).astype(int).clip(1)
    which = np.repeat(np.arange(count), elements)
    number = np.arange(len(which)) - np.repeat(np.cumsum(elements) - elements, elements)
    t = (number[:, None] + _NODES) / elements[which][:, None]
    u, v, _, dv = _seen(all_pieces, np.repeat(which, len(_NODES)), t.ravel(), shot, z)
    return u, v, dv * (_WEIGHTS / elements[which][:, None]).ravel()


def _seen(
    what: Pieces, which: np.ndarray, t: np.ndarray, shot: Shot, z: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels u, v of places on the pieces, and their derivatives by t."""
    place, rate = what.at(which, t)
    u, v = photo_from_work(
        shot, place.real + 1j * _STEP * rate.real, place.imag + 1j * _STEP * rate.imag, z
    )
    return u.real, v.real, u.imag / _STEP, v.imag / _STEP


def _add(
    total: np.ndarray, width: int, u: np.ndarray, v: np.ndarray, dv: np.ndarray, blur: float
) -> None:
    """Adds the contribution of each point to the change between neighbouring pixels of its row."""
    reach = 0.5 + _TAIL * blur
    first_u, first_v = np.ceil(u - reach).astype(np.int64), np.ceil(v - reach).astype(np.int64)
    weights, kernels = _tabulate(blur)
    weight = _look_up(weights, u - first_u - (reach - 1))
    rows = _look_up(kernels, v - first_v - (reach - 1)) * dv[:, None]
    across, down = np.arange(weight.shape[1]), np.arange(rows.shape[1])
    offsets = (down[:, None] * width + across).ravel()
    pixel = (first_v * width + first_u)[:, None] + offsets
    np.add.at(total, pixel.ravel(), (rows[:, :, None] * weight[:, None, :]).ravel())


def _look_up(table: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Rows of a table, interpolated. share: (N,) from 0, the first row, to 1, the last one."""
    place = share * (len(table) - 1)
    row = place.astype(np.int64).clip(0, len(table) - 2)
    first = table[row]
    return first + (place - row)[:, None] * (table[row + 1] - first)


@lru_cache(maxsize=8)
def _tabulate(blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Changes of S from pixel to pixel, and k of the text above, in steps of 1/1024 px.

    A row has all pixels that a point reaches, from the first one on, which is `_TAIL` sigmas away
    and up to a pixel less.
    """
    reach = 0.5 + _TAIL * blur
    count = math.ceil(2 * reach) + 1
    first = np.linspace(reach - 1, reach, 1025)[:, None]

    def whole(t: float) -> float:
        return 0.5 * (1 + math.erf(t / blur / math.sqrt(2)))

    def twice(t: float) -> float:
        return t * whole(t) + blur * math.exp(-((t / blur) ** 2) / 2) / math.sqrt(2 * math.pi)

    def integrate(function: Callable[[float], float], distance: np.ndarray) -> np.ndarray:
        """The integral of the derivative of a function over a pixel at each distance."""
        ends = np.vectorize(function)(np.stack([distance - 0.5, distance + 0.5]))
        return ends[1] - ends[0]

    step = integrate(twice, first - np.arange(-1, count + 1))
    return step[:, :-1] - step[:, 1:], integrate(whole, first - np.arange(count))
