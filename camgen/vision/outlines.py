"""The borders of a part mask as closed curves of sub-pixel points, from the grey values beside them."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.errors import InputError
from camgen.pose import FloatArray, frozen
from camgen.shapes import Note
from camgen.vision.image import Pixels
from camgen.vision.outlines_edge import Edge, fitted_edge
from camgen.vision.outlines_loops import ComplexArray, IntArray, Loops, directions, loops_of

Float32 = NDArray[np.float32]

#: Points that go ahead by less than this (px) beyond the one before are left out: two profiles told the same place.
_LEAST_STEP = 0.4
#: Loops with less contrast than this many times what the edge fit leaves have no edge in the grey picture.
_LEAST_CONTRAST = 3.0
#: Blur (px) of the mask that stands for a grey picture where there is none, and the noise of what comes out. Rendered
#: discs and rectangles: 0.15 px with a blur of 1, 0.12 with 1.5, 0.10 with 2, and corners ever rounder.
_MASK_BLUR, _MASK_SIGMA = 1.5, 0.12
#: No picture is known better than this, px: what is left without any noise.
_LEAST_SIGMA = 0.008
_FEWEST = 8


class Outline(Struct, frozen=True, eq=False):
    """A closed border. points: (N, 2) view pixels, the first not repeated; with v upwards, the part is on the left.

    halfway: (N, 2), where the grey value is half-way between part and ground: off the edge by blur^2 / (2 r) where it
    bends with radius r. In ``points`` this is put right wherever the bend is the same for six pixels to both sides.
    hole: the border of a hole. sigma: noise of a point across the border, px, as far as its neighbours do not share it:
    in a rectified view interpolation ties them, and they share as much again. blur: standard deviation of the blur
    across the edge, px.
    """

    points: FloatArray
    halfway: FloatArray
    hole: bool
    sigma: float
    blur: float


def outlines(grey: Pixels | Float32, mask_pixels: Pixels) -> tuple[tuple[Outline, ...], tuple[Note, ...]]:
    """The outlines of the part in ``mask_pixels`` (H, W; not 0: part), as exact as ``grey`` (H, W) tells.

    About one point per pixel of border, nowhere interpolated, so that the noise of neighbours is independent; along
    sharp corners the points are as round as the picture. Where ``grey`` shows no edge beside the mask (a part told by
    its colour alone), the border of the mask is smoothed instead, and a note says so. Borders of fewer than 8 points
    are left out, with a note. Raises InputError if the two do not fit together.
    """
    _insist(grey, mask_pixels)
    loops, chain, holes = _chains(mask_pixels)
    if not len(loops.count):
        return (), (Note("skipped", "no part in the mask", "choose another mask"),)
    edge = fitted_edge(grey, mask_pixels, loops, chain)
    plain = _without_edge(loops, edge)
    notes = []
    if plain.any():
        edge = _mixed(loops, edge, _edge_of_mask(mask_pixels, loops, chain), plain)
        why = "the grey picture shows no edge there; their noise is about a tenth of a pixel"
        notes.append(Note("warning", f"{int(plain.sum())} of {len(plain)} outlines taken from the mask alone", why))
    found = [
        _outline(edge.halfway[rows], edge.shift[rows], bool(hole), float(blur), _MASK_SIGMA if bare else _LEAST_SIGMA)
        for rows, hole, blur, bare in zip(_ordered(loops, edge.halfway), holes, edge.blur, plain, strict=True)
    ]
    small = sum(o is None for o in found)
    if small:
        notes.append(Note("skipped", f"{small} borders of fewer than {_FEWEST} points", "they are smaller than 3 px"))
    return tuple(o for o in found if o is not None), tuple(notes)


def _insist(grey: Pixels | Float32, mask: Pixels) -> None:
    if mask.ndim != 2 or mask.dtype != np.uint8:
        raise InputError("mask", f"has shape {mask.shape} of {mask.dtype}", remedy="give (H, W) uint8")
    if grey.shape != mask.shape or grey.dtype not in (np.uint8, np.float32):
        what = f"has shape {grey.shape} of {grey.dtype} beside a mask of {mask.shape}"
        raise InputError("grey picture", what, remedy="give (H, W) uint8 or float32 of the same size")


def _chains(mask: Pixels) -> tuple[Loops, ComplexArray, NDArray[np.bool_]]:
    """The outermost pixels of the part along every border, and which borders are holes (L,)."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not chains:
        return loops_of(np.zeros(0, dtype=np.int64)), np.zeros(0, dtype=complex), np.zeros(0, dtype=bool)
    flat = np.concatenate(chains)[:, 0].astype(np.float64)
    return loops_of(np.array([len(c) for c in chains])), flat @ np.array([1, 1j]), tree[0, :, 3] >= 0


def _without_edge(loops: Loops, edge: Edge) -> NDArray[np.bool_]:
    """(L,) loops whose grey values are much the same on both sides, or change sides, or lie far from the mask."""
    contrast = np.abs(loops.mean(edge.contrast))
    misfit = np.sqrt(loops.mean(edge.misfit.astype(np.float64) ** 2))
    return np.asarray((contrast < _LEAST_CONTRAST * misfit) | (contrast < 2.0) | (loops.mean(edge.found * 1.0) < 0.9))


def _edge_of_mask(mask: Pixels, loops: Loops, chain: ComplexArray) -> Edge:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    soft = cv2.GaussianBlur(mask, (0, 0), _MASK_BLUR)
    return fitted_edge(np.asarray(soft, dtype=np.uint8), mask, loops, chain)


def _mixed(loops: Loops, edge: Edge, other: Edge, where: NDArray[np.bool_]) -> Edge:
    """``edge`` with the loops ``where`` (L,) from ``other``."""
    rows = where[loops.loop]
    return Edge(
        np.where(rows, other.halfway, edge.halfway),
        np.where(rows, other.shift, edge.shift),
        np.where(rows, other.found, edge.found),
        np.where(where, other.blur, edge.blur),
        np.where(rows, other.contrast, edge.contrast),
        np.where(rows, other.misfit, edge.misfit),
    )


def _ordered(loops: Loops, points: ComplexArray) -> list[IntArray]:
    """The rows of each loop without those whose points do not go ahead of the one before."""
    rows = np.arange(len(points))
    for _ in range(3):
        table = loops_of(np.bincount(loops.loop[rows], minlength=len(loops.count)))
        step = points[rows] - points[rows[table.beside(-1)]]
        late = (step * directions(table, points[rows]).conj()).real < _LEAST_STEP
        # Of neighbours that are late one goes, then they are looked at again; no loop loses all of its rows.
        late &= ~late[table.beside(-1)] & (table.count[table.loop] > 2)
        if not late.any():
            break
        rows = rows[~late]
    return np.split(rows, np.cumsum(np.bincount(loops.loop[rows], minlength=len(loops.count)))[:-1])


def _outline(halfway: ComplexArray, shift: ComplexArray, hole: bool, blur: float, least: float) -> Outline | None:
    if len(halfway) < _FEWEST:
        return None
    return Outline(_pairs(halfway + shift), _pairs(halfway), hole, max(_noise(halfway), least), blur)


def _pairs(points: ComplexArray) -> FloatArray:
    return frozen(np.column_stack([points.real, points.imag]))


def _noise(points: ComplexArray) -> float:
    """Noise across the border: what the third differences leave of any smooth curve; corners are outvoted."""
    a, b, c, d = (np.roll(points, -k) for k in range(4))
    along = (c - b) / np.maximum(np.abs(c - b), 1e-9)
    third = ((d - 3 * c + 3 * b - a) * along.conj()).imag
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))
