"""Marks in the shape of a + : where holes are to be drilled ("Continuous path following", section 4).

A piece of ink is a mark when two bars of one width cross at right angles, with four arms of about one length, and there
is little else. Its centre is where the middles of the bars meet, each fitted to all the ink of its two arms, with the
grey of half-covered pixels: a mask alone would know it to half a pixel only.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.vision.image import Pixels

ComplexArray = NDArray[np.complex128]

#: Width and height of a piece that may be a mark, px, and how much they and its ink may differ.
_LEAST_SIDE_PX, _MOST_SIDE_PX, _ASPECT, _FULLEST = 7, 400, 1.6, 0.75
#: Where an arm begins, as a share of how far the mark reaches, and how wide it may be as a share of the way from there.
_ROOT, _WEDGE = 0.35, 0.6
#: How unlike the four arms may be in length and width, the shortest.
_SHORTEST, _UNLIKE = 0.6, 0.6
#: The ink that may lie beside the two bars, and what of the bars must be inked.
_BESIDE, _INKED = 0.1, 0.8
#: A mark turned further is an x, rad.
_TURNED = np.radians(30.0)
#: Room around a piece whose grey belongs to it, px.
_ROOM_PX = 2


class Cross(Struct, frozen=True):
    """u, v: px of the centre. turn: rad, clockwise on the screen. reach: from the centre to the ends of the arms, px.
    width: of the bars, px.
    """

    u: float
    v: float
    turn: float
    reach: float
    width: float


def crosses(mask: Pixels, grey: Pixels) -> tuple[Cross, ...]:
    """The marks among the pieces of ``mask`` ((H, W), 255 ink) and among the holes in it, from the top down.

    grey: (H, W) or (H, W, 3), the picture that the mask was made of. A mark that touches other ink is not found.
    """
    if grey.ndim == 3:
        grey = np.asarray(cv2.cvtColor(grey, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    found = [
        cross
        for side in (mask, cv2.bitwise_not(mask))
        for cross in _in(np.asarray(side, dtype=np.uint8), grey)
    ]
    return tuple(sorted(found, key=lambda c: (c.v, c.u)))


def _in(ink: Pixels, grey: Pixels) -> Iterator[Cross]:
    _, labels, facts, _ = cv2.connectedComponentsWithStats(ink)
    for k, (u, v, wide, high, area) in enumerate(facts.tolist()):
        sized = min(wide, high) >= _LEAST_SIDE_PX and max(wide, high) <= min(
            _MOST_SIDE_PX, _ASPECT * min(wide, high)
        )
        inner = u > 0 and v > 0 and u + wide < ink.shape[1] and v + high < ink.shape[0]
        if k and sized and inner and area <= _FULLEST * wide * high:
            top, left = max(v - _ROOM_PX, 0), max(u - _ROOM_PX, 0)
            window = (slice(top, v + high + _ROOM_PX), slice(left, u + wide + _ROOM_PX))
            own = (labels[window] == k).astype(np.uint8)
            cross = _fit(own, grey[window], complex(left, top))
            if cross is not None:
                yield cross


def _fit(own: Pixels, grey: Pixels, corner: complex) -> Cross | None:
    """The mark that the pixels ``own`` are, None if they are something else."""
    points, weight = _ink(own, grey)
    centre = complex((weight * points).sum() / weight.sum())
    # A + has four-fold symmetry: the fourth power of its points adds up along its arms.
    turn = float(np.angle((weight * (points - centre) ** 4).sum()) / 4)
    for _ in range(4):
        at = (points - centre) * np.exp(-1j * turn)
        reach = float(np.sqrt(np.percentile(at.real**2 + at.imag**2, 98)))
        arms = [at * (-1j) ** k for k in range(4)]
        inside = [(a.real > _ROOT * reach) & (np.abs(a.imag) < _WEDGE * a.real) for a in arms]
        if min(float(weight[own_arm].sum()) for own_arm in inside) <= 0:
            return None
        lying, standing = inside[0] | inside[2], inside[1] | inside[3]
        a, b = _line(at.real[lying], at.imag[lying], weight[lying])
        c, d = _line(at.imag[standing], at.real[standing], weight[standing])
        y = (a + b * c) / (1 - b * d)
        centre += complex(c + d * y, y) * np.exp(1j * turn)
        turn += (b - d) / 2
    arm = np.array([_arm(a, weight, i, _ROOT * reach) for a, i in zip(arms, inside, strict=True)])
    if abs(turn) > _TURNED or not _is_cross(at, weight, arm):
        return None
    whole = centre + corner
    return Cross(whole.real, whole.imag, turn, float(arm[:, 0].mean()), float(arm[:, 1].mean()))


def _ink(own: Pixels, grey: Pixels) -> tuple[ComplexArray, FloatArray]:
    """Pixels (N,) of a piece and around it, and how much of each is inked, 0 to 1."""
    near = cv2.dilate(own, np.ones((2 * _ROOM_PX - 1, 2 * _ROOM_PX - 1), dtype=np.uint8)) > 0
    dark, light = float(np.median(grey[own > 0])), float(np.median(grey[own == 0]))
    share = (
        (grey.astype(np.float64) - light) / (dark - light)
        if dark != light
        else own.astype(np.float64)
    )
    v, u = np.nonzero(near)
    # Noise of the ground around would add up far from the middle.
    weight = share[v, u].clip(0, 1)
    return u + 1j * v, np.where(weight > 0.15, weight, 0.0)


def _line(along: FloatArray, across: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Where ``across`` = a + b ``along``, by weighted least squares: a and b."""
    total = weight.sum()
    x, y = (weight * along).sum() / total, (weight * across).sum() / total
    b = (weight * (along - x) * (across - y)).sum() / (weight * (along - x) ** 2).sum()
    return float(y - b * x), float(b)


def _arm(
    at: ComplexArray, weight: FloatArray, inside: NDArray[np.bool_], root: float
) -> tuple[float, float]:
    """How far an arm reaches, px, and how wide it is."""
    own, along = weight[inside], at.real[inside]
    # The ink of an even bar lies on average half-way between its root and its end.
    middle = float((own * along).sum() / own.sum())
    length = 2 * (middle - root)
    return root + length, float(own.sum()) / max(length, 1e-9)


def _is_cross(at: ComplexArray, weight: FloatArray, arm: FloatArray) -> bool:
    """Whether ink (N,) around a centre is two bars. arm: (4, 2) reach and width."""
    reach, width = arm.T
    wide = float(width.mean())
    if (
        reach.min() < _SHORTEST * reach.max()
        or reach.min() < 1.2 * wide
        or np.ptp(width) > _UNLIKE * wide
    ):
        return False
    half = wide / 2 + 0.75
    x, y = np.abs(at.real), np.abs(at.imag)
    bars = ((y <= half) & (x <= reach.max() + 1)) | ((x <= half) & (y <= reach.max() + 1))
    ink = float(weight.sum())
    whole = wide * (reach.sum() - wide)
    return bool(float(weight[~bars].sum()) <= _BESIDE * ink and _INKED <= ink / whole <= 2 - _INKED)
