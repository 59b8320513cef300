"""From the pixels on the part's side of the level to the part: specks out, small holes filled, the rest judged."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import Note
from camgen.model.text import counted, short
from camgen.vision.mask.cells import Bools, Bytes
from camgen.vision.to_scale import ScaledView

#: Nothing smaller has an outline.
_LEAST_PIXELS = 12.0
_PARENT = 3
#: A piece is loose if it is smaller than this share of the largest one.
_LOOSE_SHARE = 0.02
#: Parts dominate a mask if specks and loose things have at most this share of their area, and the
#: numbers of these, and of parts, are at most the following.
_MOST_LOOSE, _MOST_SPECKS, _MOST_PARTS = 0.3, 2000, 100
#: Places of a note that are shown, the largest ones.
_MOST_PLACES = 20
#: Areas that differ by less, as a share, are the same: a scale is given in digits.
_SAME = 1e-4

Ring = NDArray[np.int32]


class MaskPiece(Struct, frozen=True, eq=False):
    """A connected piece of the mask. pixels: how many it has; filled: the same with its holes."""

    ring: Ring
    pixels: float
    filled: float


def clean(
    mask: Bytes, view: ScaledView, min_area: float, name: str, *, accepts_specks: bool = False
) -> tuple[Note, ...]:
    """Drops specks and loose things and fills small holes in ``mask`` (H, W), in place.

    A piece is loose if it is small beside the largest one. Pieces hang together over corners,
    holes over sides.

    min_area: area of a speck, mm2.
    accepts_specks: whether loose things are parts, and a mask without a dominant part is built.

    Raises InputError if no part, or not the whole part, is shown; NoSafeProgram if no part
    dominates the mask.
    """
    mm2 = view.mm_per_px**2
    least = max(min_area / mm2, _LEAST_PIXELS)
    # What is just as large as asked for is so at every scale.
    enough = least * (1 - _SAME)
    rings, parents, pixels, filled = _measure(mask)
    outer = parents < 0
    large = outer & (pixels >= enough)
    if not large.any():
        raise _nothing(view, outer, pixels, least * mm2, name)
    kept = large & (accepts_specks | (pixels >= _LOOSE_SHARE * pixels[large].max()))
    specks, loose = outer & ~large, large & ~kept
    if not accepts_specks:
        _insist_on_part(name, pixels * mm2, kept, loose, specks)
    for k in np.flatnonzero(specks | loose).tolist():
        _erase(mask, MaskPiece(rings[k], float(pixels[k]), float(filled[k])))
    small = ~outer & (filled < enough)
    small[~outer] &= kept[parents[~outer]]
    for k in np.flatnonzero(small).tolist():
        cv2.drawContours(mask, [rings[k]], -1, 255, cv2.FILLED)
    _whole([rings[k] for k in np.flatnonzero(kept).tolist()], view, name)
    limit = f"below {short(least * mm2, 3)} mm2"
    why = "set [image] min_area lower if they are more than dirt, glare or noise"
    kinds = (
        ("speck", limit + " left out", specks, pixels),
        ("hole", limit + " filled", small, filled),
    )
    notes = tuple(
        Note(
            "assumed",
            f"{counted(int(which.sum()), what)} {done}, "
            f"{short(sizes[which].sum() * mm2, 3)} mm2 in all",
            why,
        )
        for what, done, which, sizes in kinds
        if which.any()
    )
    return (*notes, *_note_loose(view, [rings[k] for k in np.flatnonzero(loose)], filled[loose]))


def _measure(
    mask: Bytes,
) -> tuple[list[Ring], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """The rings of all pieces and holes, the parent of each, its pixels, and those with holes."""
    found, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [np.asarray(ring, np.int32) for ring in found]
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


def _insist_on_part(
    name: str, mm2: NDArray[np.float64], parts: Bools, loose: Bools, specks: Bools
) -> None:
    """Raises NoSafeProgram if the parts do not dominate the mask.

    mm2: area of each piece.
    parts, loose, specks: masks of the pieces.
    """
    area, rest = float(mm2[parts].sum()), float(mm2[loose | specks].sum())
    count, small = int(parts.sum()), int((loose | specks).sum())
    if rest <= _MOST_LOOSE * area and small <= _MOST_SPECKS and count <= _MOST_PARTS:
        return
    what = f"no part dominates the mask: {counted(count, 'piece')} of {short(area, 0)} mm2"
    if small:
        what += f" and {counted(small, 'smaller one')} of {short(rest, 0)} mm2"
    remedy = (
        "clean the bench, light it evenly, or choose another image.mask; "
        'image.accept = ["specks"] takes all of them for parts'
    )
    raise NoSafeProgram(name, what, remedy=remedy)


def _note_loose(
    view: ScaledView, rings: list[Ring], filled: NDArray[np.float64]
) -> tuple[Note, ...]:
    """The note on loose things with the places of the largest."""
    if not rings:
        return ()
    sizes = filled * view.mm_per_px**2
    what = (
        f"{counted(len(rings), 'loose thing')} beside the part, {short(sizes.max(), 1)} mm2 or less"
    )
    why = 'not worked; image.accept = ["specks"] takes them for parts'
    order = np.argsort(-sizes, kind="stable")[:_MOST_PLACES]
    middles = np.array([[*rings[k][:, 0].mean(axis=0), 1.0] for k in order])
    places = tuple((x, y) for x, y in (middles @ view.work_from_view.T).tolist())
    return (Note("skipped", what, why, places=places),)


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
