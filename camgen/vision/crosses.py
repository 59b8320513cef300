"""Finds marks in the shape of a +, where holes are to be drilled.

See "Continuous path following", section 4. A piece of ink is a mark if two bars of the same width
cross at right angles, with four arms of about the same length, and there is little other ink. Its
centre is the crossing of the middle lines of the bars. Each is fitted to all the ink of its two
arms, with the grey of half-covered pixels; a mask alone would give it to half a pixel only.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.rings import ComplexArray
from camgen.model.pose import FloatArray
from camgen.vision.image import Pixels, convert_to_grey

#: px: smallest and largest width and height of a mark.
_MIN_SIDE, _MAX_SIDE = 7, 400
#: Largest ratio of width and height, and largest fraction of the box that is ink.
_MAX_ASPECT, _MAX_FILL = 1.6, 0.75
#: Distance from the centre at which an arm begins, as a fraction of the reach of the mark.
_ARM_BEGIN = 0.35
#: Largest distance of an arm from its middle line, as a fraction of the distance from the centre.
_MAX_ARM_SLOPE = 0.6
#: Smallest ratio of the shortest and the longest arm.
_MIN_LENGTH_RATIO = 0.6
#: Smallest length of an arm, in widths of the bars.
_MIN_LENGTH = 1.2
#: Largest difference between the widths of the arms, as a fraction of the mean.
_MAX_WIDTH_DIFFERENCE = 0.6
#: Largest fraction of the ink that is beside the two bars.
_MAX_INK_BESIDE = 0.1
#: Smallest fraction of the bars that is ink. There may be as much too much ink.
_MIN_INK = 0.8
#: rad: a mark that is rotated by more is an x.
_MAX_ROTATION = np.radians(30.0)
#: px: distance from a piece up to which grey belongs to it.
_GREY_REACH = 2


class Cross(Struct, frozen=True):
    """A mark.

    u, v: centre, px.
    turn: rotation, rad, clockwise on the screen.
    reach: mean distance from the centre to the ends of the arms, px.
    width: mean width of the bars, px.
    """

    u: float
    v: float
    turn: float
    reach: float
    width: float


def find_crosses(mask: Pixels, grey: Pixels) -> tuple[Cross, ...]:
    """Find the marks among the pieces of a mask, and among the holes in it, from the top down.

    A mark that touches other ink is not found.

    mask: (H, W), 255 ink.
    grey: (H, W) or (H, W, 3), the picture that the mask was made of.
    """
    grey = convert_to_grey(grey)
    marks = [*_find_marks(mask, grey)]
    marks += _find_marks(np.asarray(cv2.bitwise_not(mask), dtype=np.uint8), grey)
    return tuple(sorted(marks, key=lambda mark: (mark.v, mark.u)))


def _find_marks(ink: Pixels, grey: Pixels) -> Iterator[Cross]:
    """Yield the marks among the pieces of `ink` (H, W) away from the border of the picture."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(ink)
    for k, (u, v, width, height, area) in enumerate(stats.tolist()):
        shorter, longer = min(width, height), max(width, height)
        has_size = shorter >= _MIN_SIDE and longer <= min(_MAX_SIDE, _MAX_ASPECT * shorter)
        is_inside = u > 0 and v > 0 and u + width < ink.shape[1] and v + height < ink.shape[0]
        # Piece 0 is everything that is not ink.
        if k and has_size and is_inside and area <= _MAX_FILL * width * height:
            top, left = max(v - _GREY_REACH, 0), max(u - _GREY_REACH, 0)
            rows, columns = (
                slice(top, v + height + _GREY_REACH),
                slice(left, u + width + _GREY_REACH),
            )
            piece = (labels[rows, columns] == k).astype(np.uint8)
            mark = _fit_mark(piece, grey[rows, columns], complex(left, top))
            if mark is not None:
                yield mark


def _fit_mark(piece: Pixels, grey: Pixels, corner: complex) -> Cross | None:
    """Fit a mark to a piece of ink, or return None if it is something else.

    piece, grey: (h, w), the piece and the picture in a window.
    corner: u + iv of the upper left pixel of the window.
    """
    points, weight = _weigh_ink(piece, grey)
    centre = complex((weight * points).sum() / weight.sum())
    # A + has four-fold symmetry: the fourth power of its points adds up along its arms.
    turn = float(np.angle((weight * (points - centre) ** 4).sum()) / 4)
    for _ in range(4):
        local = (points - centre) * np.exp(-1j * turn)
        reach = float(np.sqrt(np.percentile(local.real**2 + local.imag**2, 98)))
        arms = [local * (-1j) ** k for k in range(4)]
        inside = [
            (arm.real > _ARM_BEGIN * reach) & (np.abs(arm.imag) < _MAX_ARM_SLOPE * arm.real)
            for arm in arms
        ]
        if min(float(weight[arm_ink].sum()) for arm_ink in inside) <= 0:
            return None
        lying, standing = inside[0] | inside[2], inside[1] | inside[3]
        a, b = _fit_line(local.real[lying], local.imag[lying], weight[lying])
        c, d = _fit_line(local.imag[standing], local.real[standing], weight[standing])
        y = (a + b * c) / (1 - b * d)
        centre += complex(c + d * y, y) * np.exp(1j * turn)
        turn += (b - d) / 2
    sizes = np.array(
        [
            _measure_arm(arm, weight, arm_ink, _ARM_BEGIN * reach)
            for arm, arm_ink in zip(arms, inside, strict=True)
        ]
    )
    if abs(turn) > _MAX_ROTATION or not _is_cross(local, weight, sizes):
        return None
    place = centre + corner
    return Cross(place.real, place.imag, turn, float(sizes[:, 0].mean()), float(sizes[:, 1].mean()))


def _weigh_ink(piece: Pixels, grey: Pixels) -> tuple[ComplexArray, FloatArray]:
    """The pixels (N,) of a piece and around it, and the fraction of each that is ink."""
    size = 2 * _GREY_REACH - 1
    near = cv2.dilate(piece, np.ones((size, size), dtype=np.uint8)) > 0
    dark, light = float(np.median(grey[piece > 0])), float(np.median(grey[piece == 0]))
    fraction = piece.astype(np.float64)
    if dark != light:
        fraction = (grey.astype(np.float64) - light) / (dark - light)
    v, u = np.nonzero(near)
    weight = fraction[v, u].clip(0, 1)
    # A small weight is noise of the paper, and would add up far from the middle.
    return u + 1j * v, np.where(weight > 0.15, weight, 0.0)


def _fit_line(along: FloatArray, across: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Fit `across` = a + b `along` by weighted least squares; returns a and b."""
    total = weight.sum()
    x, y = (weight * along).sum() / total, (weight * across).sum() / total
    b = (weight * (along - x) * (across - y)).sum() / (weight * (along - x) ** 2).sum()
    return float(y - b * x), float(b)


def _measure_arm(
    local: ComplexArray, weight: FloatArray, inside: NDArray[np.bool_], root: float
) -> tuple[float, float]:
    """Reach and width of an arm, px.

    local: (N,) the ink, with the arm along the real axis.
    inside: (N,) the ink of the arm.
    root: distance from the centre at which it begins, px.
    """
    arm_weight, along = weight[inside], local.real[inside]
    # The ink of an even bar lies on average half-way along it.
    middle = float((arm_weight * along).sum() / arm_weight.sum())
    length = 2 * (middle - root)
    return root + length, float(arm_weight.sum()) / max(length, 1e-9)


def _is_cross(local: ComplexArray, weight: FloatArray, arms: FloatArray) -> bool:
    """Whether ink (N,) around a centre has the shape of two bars.

    arms: (4, 2) reach and width of each arm, px.
    """
    reach, widths = arms.T
    width = float(widths.mean())
    min_length = max(_MIN_LENGTH_RATIO * reach.max(), _MIN_LENGTH * width)
    if reach.min() < min_length or np.ptp(widths) > _MAX_WIDTH_DIFFERENCE * width:
        return False
    half = width / 2 + 0.75
    x, y = np.abs(local.real), np.abs(local.imag)
    in_bars = ((y <= half) & (x <= reach.max() + 1)) | ((x <= half) & (y <= reach.max() + 1))
    ink = float(weight.sum())
    if float(weight[~in_bars].sum()) > _MAX_INK_BESIDE * ink:
        return False
    bar_area = width * (reach.sum() - width)
    return bool(_MIN_INK <= ink / bar_area <= 2 - _MIN_INK)
