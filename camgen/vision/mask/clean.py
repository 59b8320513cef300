"""Cleans the mask of a part: removes specks and loose things, and fills small holes.

Checks that one or several whole parts remain, and not mere dirt.
"""

from __future__ import annotations

from itertools import compress

import cv2
import numpy as np
from numpy.typing import NDArray

from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import Note
from camgen.model.text import counted, short
from camgen.vision.mask.cells import Bools, Bytes
from camgen.vision.to_scale import ScaledView

#: Pixels: a smaller piece has no outline.
_MIN_PIXELS = 12.0
#: Column of a parent in the tree of contours of OpenCV.
_PARENT = 3
#: A piece is loose if it is smaller than this fraction of the largest one.
_LOOSE_FRACTION = 0.02
#: Parts dominate a mask if specks and loose things have at most this fraction of their area,
_MAX_LOOSE_FRACTION = 0.3
#: and there are at most this many specks and loose things,
_MAX_SPECKS = 2000
#: and at most this many parts.
_MAX_PARTS = 100
#: Places that a note lists, the largest ones.
_MAX_PLACES = 20
#: Areas that differ by less than this fraction are equal, as the digits of a scale are limited.
_AREA_TOLERANCE = 1e-4

#: Contour (N, 1, 2) through pixel centres, px.
Ring = NDArray[np.int32]


def clean_mask(
    mask: Bytes, view: ScaledView, min_area: float, name: str, *, accepts_specks: bool = False
) -> tuple[Note, ...]:
    """Remove specks and loose things, and fill small holes, in `mask` (H, W), in place.

    A piece is loose if it is small beside the largest one. The pixels of a piece are connected over
    corners too, those of a hole only over sides.

    min_area: area below which a piece is a speck and a hole is small, mm2.
    accepts_specks: whether loose things are parts, and a mask without a dominant part is built.

    Returns notes on the removed and filled pieces. Raises InputError if no part, or not the whole
    part, is shown; NoSafeProgram if no part dominates the mask.
    """
    mm2 = view.mm_per_px**2
    min_pixels = max(min_area / mm2, _MIN_PIXELS)
    # A piece of exactly the area that is asked for is large enough at every scale.
    enough = min_pixels * (1 - _AREA_TOLERANCE)
    rings, parents, pixels, filled = _measure(mask)
    outer = parents < 0
    large = outer & (pixels >= enough)
    if not large.any():
        raise _describe_empty_mask(view, pixels[outer], min_pixels * mm2, name)
    is_part = large & (accepts_specks | (pixels >= _LOOSE_FRACTION * pixels[large].max()))
    specks, loose = outer & ~large, large & ~is_part
    if not accepts_specks:
        _check_dominance(name, pixels * mm2, is_part, loose, specks)
    for k in np.flatnonzero(specks | loose).tolist():
        _erase(mask, rings[k], float(filled[k] - pixels[k]))
    small_holes = ~outer & (filled < enough)
    small_holes[~outer] &= is_part[parents[~outer]]
    for k in np.flatnonzero(small_holes).tolist():
        cv2.drawContours(mask, [rings[k]], -1, 255, cv2.FILLED)
    _check_whole(list(compress(rings, is_part)), view, name)
    limit = f"below {short(min_pixels * mm2, 3)} mm2"
    why = "set [image] min_area lower if they are more than dirt, glare or noise"
    notes: list[Note] = []
    for noun, action, selected, sizes in (
        ("speck", "left out", specks, pixels),
        ("hole", "filled", small_holes, filled),
    ):
        if selected.any():
            area = short(sizes[selected].sum() * mm2, 3)
            what = f"{counted(int(selected.sum()), noun)} {limit} {action}, {area} mm2 in all"
            notes.append(Note("assumed", what, why))
    notes += _note_loose(view, list(compress(rings, loose)), filled[loose])
    return tuple(notes)


def _measure(
    mask: Bytes,
) -> tuple[list[Ring], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Measure all pieces and holes of `mask` (H, W).

    Returns K rings, the index of the piece around each hole (-1 for a piece), the number of pixels
    of each without its holes, and the number with its holes.
    """
    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [np.asarray(ring, np.int32) for ring in contours]
    steps = np.array([len(ring) if len(ring) > 1 else 0 for ring in rings], np.float64)
    areas = np.array([cv2.contourArea(ring) for ring in rings])
    parents = np.asarray(tree)[0, :, _PARENT].astype(np.intp) if rings else np.zeros(0, np.intp)
    outer = parents < 0
    # Pick's theorem: the number of pixels inside a ring through pixel centres, with those on it
    # for a piece and without them for a hole.
    pixels = np.where(outer, areas + steps / 2 + 1, areas - steps / 2 + 1)
    filled = pixels.copy()
    np.subtract.at(pixels, parents[~outer], filled[~outer])
    return rings, parents, pixels, filled


def _check_dominance(
    name: str, mm2: NDArray[np.float64], parts: Bools, loose: Bools, specks: Bools
) -> None:
    """Raises NoSafeProgram if the parts do not dominate the mask.

    mm2: area of each piece, mm2.
    parts, loose, specks: masks of the pieces.
    """
    area, rest = float(mm2[parts].sum()), float(mm2[loose | specks].sum())
    count, small = int(parts.sum()), int((loose | specks).sum())
    if rest <= _MAX_LOOSE_FRACTION * area and small <= _MAX_SPECKS and count <= _MAX_PARTS:
        return
    what = f"no part dominates the mask: {counted(count, 'piece')} of {short(area, 0)} mm2"
    if small:
        what += f" and {counted(small, 'smaller one')} of {short(rest, 0)} mm2"
    raise NoSafeProgram(
        name,
        what,
        remedy="clean the bench, light it evenly, or choose another image.mask; "
        'image.accept = ["specks"] takes all of them for parts',
    )


def _note_loose(
    view: ScaledView, rings: list[Ring], filled: NDArray[np.float64]
) -> tuple[Note, ...]:
    """The note on loose things with the places of the largest; none without rings.

    filled: pixels of each, its holes included.
    """
    if not rings:
        return ()
    sizes = filled * view.mm_per_px**2
    order = np.argsort(-sizes, kind="stable")[:_MAX_PLACES]
    middles = np.array([rings[k][:, 0].mean(axis=0) for k in order])
    return (
        Note(
            "skipped",
            f"{counted(len(rings), 'loose thing')} beside the part, "
            f"{short(sizes.max(), 1)} mm2 or less",
            'not worked; image.accept = ["specks"] takes them for parts',
            places=view.convert_to_work(middles),
        ),
    )


def _erase(mask: Bytes, ring: Ring, hole_pixels: float) -> None:
    """Erase a piece, with its outer contour and the number of pixels in its holes."""
    if hole_pixels < _MIN_PIXELS:
        cv2.drawContours(mask, [ring], -1, 0, cv2.FILLED)
        return
    # Its hole may have other pieces in it, which stay.
    u, v = ring[0, 0].tolist()
    cv2.floodFill(mask, None, (u, v), 0, flags=8)


def _describe_empty_mask(
    view: ScaledView, pixels: NDArray[np.float64], min_mm2: float, name: str
) -> InputError:
    """The error for a mask without a part of `min_mm2`.

    pixels: number of pixels of each speck.
    """
    what = f"shows no part of {short(min_mm2, 3)} mm2 or more"
    if len(pixels):
        size = short(float(pixels.sum()) * view.mm_per_px**2, 3)
        what += f", only {counted(len(pixels), 'speck')} of {size} mm2 in all"
    return InputError(
        name,
        what,
        remedy="check its scale, set [image] min_area lower, or choose another [image] mask",
    )


def _check_whole(rings: list[Ring], view: ScaledView, name: str) -> None:
    """Raises InputError if a piece reaches the border of the area that the photo shows."""
    height, width = view.pixels.shape[:2]
    near_unseen = np.zeros((height, width), np.bool_)
    if view.valid is not None:
        unseen = np.asarray(~view.valid).view(np.uint8)
        near_unseen = cv2.dilate(unseen, np.ones((3, 3), np.uint8)) > 0
    for ring in rings:
        u, v = ring[:, 0, 0], ring[:, 0, 1]
        sides = np.array([u == 0, v == 0, u == width - 1, v == height - 1])
        touching = sides.any(axis=0) | near_unseen[v, u]
        if sides.any(axis=1).all():
            raise InputError(
                name,
                "the part fills the picture, or a frame surrounds it",
                remedy="leave bench around the whole part, crop what is not bench",
            )
        if touching.any():
            first = int(np.argmax(touching))
            x, y = (view.work_from_view @ (u[first], v[first], 1)).tolist()
            raise InputError(
                name,
                "the part, or something as dark or bright, touches the border of the picture",
                f"near x {short(x, 1)}, y {short(y, 1)} mm",
                "leave bench around the whole part, crop or cover what is not the part",
            )
