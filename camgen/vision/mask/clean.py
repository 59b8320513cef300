"""From the pixels on the part's side of the level to the part: specks out, small holes filled, the rest judged."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import counted, short
from camgen.vision.mask.cells import Bools, Bytes
from camgen.vision.to_scale import ScaledView

#: Nothing smaller has an outline.
_LEAST_PIXELS = 12.0
_PARENT = 3
#: Areas that differ by less, as a share, are the same: a scale is given in digits.
_SAME = 1e-4

Ring = NDArray[np.int32]


class MaskPiece(Struct, frozen=True, eq=False):
    """A connected piece of the mask. pixels: how many it has; filled: the same with its holes."""

    ring: Ring
    pixels: float
    filled: float


def clean(mask: Bytes, view: ScaledView, min_area: float, name: str) -> tuple[Note, ...]:
    """Drops specks and fills small holes in ``mask`` (H, W), in place. InputError: no part, or not the whole part.

    min_area: mm2. Pieces hang together over corners, holes over sides.
    """
    mm2 = view.mm_per_px**2
    least = max(min_area / mm2, _LEAST_PIXELS)
    # What is just as large as asked for is so at every scale.
    enough = least * (1 - _SAME)
    found, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [np.asarray(ring, np.int32) for ring in found]
    steps = np.array([len(ring) if len(ring) > 1 else 0 for ring in rings], np.float64)
    areas = np.array([cv2.contourArea(ring) for ring in rings])
    parents = np.asarray(tree)[0, :, _PARENT].astype(np.intp) if rings else np.zeros(0, np.intp)
    outer = parents < 0
    # Pick's theorem: a ring through pixel centres holds so many pixels, with those on it or (a hole) without them.
    pixels = np.where(outer, areas + steps / 2 + 1, areas - steps / 2 + 1)
    filled = pixels.copy()
    np.subtract.at(pixels, parents[~outer], filled[~outer])
    kept = outer & (pixels >= enough)
    if not kept.any():
        raise _nothing(view, outer, pixels, least * mm2, name)
    specks = outer & ~kept
    for k in np.flatnonzero(specks).tolist():
        _erase(mask, MaskPiece(rings[k], float(pixels[k]), float(filled[k])))
    small = ~outer & (filled < enough)
    small[~outer] &= kept[parents[~outer]]
    for k in np.flatnonzero(small).tolist():
        cv2.drawContours(mask, [rings[k]], -1, 255, cv2.FILLED)
    _whole([rings[k] for k in np.flatnonzero(kept).tolist()], view, name)
    limit = f"below {short(least * mm2, 3)} mm2"
    why = "set [image] min_area lower if they are more than dirt, glare or noise"
    told = (
        ("speck", limit + " left out", specks, pixels),
        ("hole", limit + " filled", small, filled),
    )
    return tuple(
        Note(
            "assumed",
            f"{counted(int(which.sum()), what)} {done}, {short(sizes[which].sum() * mm2, 3)} mm2 in all",
            why,
        )
        for what, done, which, sizes in told
        if which.any()
    )


def _erase(mask: Bytes, piece: MaskPiece) -> None:
    if piece.filled - piece.pixels < _LEAST_PIXELS:
        cv2.drawContours(mask, [piece.ring], -1, 0, cv2.FILLED)
        return
    # A thin ring: what lies inside it stays.
    u, v = piece.ring[0, 0].tolist()
    cv2.floodFill(mask, None, (u, v), 0, flags=8)


def _nothing(
    view: ScaledView, outer: Bools, pixels: NDArray[np.float64], least: float, name: str
) -> InputError:
    size = short(float(pixels[outer].sum()) * view.mm_per_px**2, 3)
    what = f"shows no part of {short(least, 3)} mm2 or more"
    if outer.any():
        what += f", only {counted(int(outer.sum()), 'speck')} of {size} mm2 in all"
    return InputError(
        name,
        what,
        remedy="check its scale, set [image] min_area lower, or choose another [image] mask",
    )


def _whole(rings: list[Ring], view: ScaledView, name: str) -> None:
    """InputError where a piece reaches the border of what the photo shows."""
    height, width = view.pixels.shape[:2]
    beside = _beside_unseen(view.valid)
    for ring in rings:
        u, v = ring[:, 0, 0], ring[:, 0, 1]
        sides = np.array([u == 0, v == 0, u == width - 1, v == height - 1])
        touching = sides.any(axis=0) if beside is None else sides.any(axis=0) | beside[v, u]
        if not touching.any():
            continue
        if sides.any(axis=1).all():
            what = "the part fills the picture, or a frame runs round it"
            raise InputError(
                name, what, remedy="leave bench all round the part, crop what is no bench"
            )
        first = int(np.argmax(touching))
        x, y = (view.work_from_view @ (u[first], v[first], 1)).tolist()
        where = f"near x {short(x, 1)}, y {short(y, 1)} mm"
        what = "the part, or something as dark or bright, touches the border of the picture"
        remedy = "leave bench all round the part, crop or cover what is no part"
        raise InputError(name, what, where, remedy)


def _beside_unseen(valid: Bools | None) -> Bools | None:
    """The pixels next to one that the photo does not show."""
    if valid is None:
        return None
    unseen = np.asarray(~valid).view(np.uint8)
    return np.asarray(cv2.dilate(unseen, np.ones((3, 3), np.uint8)), np.uint8).view(np.bool_)
