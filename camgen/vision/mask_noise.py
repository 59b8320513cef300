"""Noise that would break the boundary up is smoothed away before the comparison, and only then."""

from __future__ import annotations

import cv2
import numpy as np

from camgen.shapes import Note
from camgen.text import short
from camgen.vision.mask_cells import Bools, Bytes, Cells, Floats, depth
from camgen.vision.mask_channel import Found
from camgen.vision.mask_fit import some

#: Half the contrast is so many sigmas of the noise: one pixel in 150 000 is on the wrong side.
_CLEAR = 4.5
_LEAST, _MOST = 0.8, 2.5
#: Measured so far from the boundary, px: with the neighbours, the blur is out of reach.
_CLEAN = 5.0


def quiet(grey: Bytes | Floats, found: Found, cells: Cells) -> tuple[Bytes | Floats, tuple[Note, ...]]:
    """``grey``, or, where its noise is too strong for the contrast, smoothed (float32), with a note.

    A smoothed boundary of radius r moves by sigma^2 / 2 r towards its centre.
    """
    deep = 1 + _CLEAN / cells.size
    noise = max(_noise(grey, depth(side) >= deep, cells.size) for side in (found.part, ~found.part & cells.valid))
    clear = abs(found.levels.contrast) / 2 / max(noise, 1e-6)
    if clear >= _CLEAR:
        return grey, ()
    # Gauss's bell of this sigma reduces white noise by sigma * 2 sqrt(pi) (a half more is for neighbours that agree).
    sigma = float(np.clip(1.5 * _CLEAR / clear / (2 * np.sqrt(np.pi)), _LEAST, _MOST))
    what = f"picture smoothed by {short(sigma, 1)} px"
    why = f"its noise is {short(noise, 1)}, part and bench are {short(abs(found.levels.contrast), 0)} apart"
    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), sigma), np.float32)
    return smooth, (Note("assumed", what, why),)


def _noise(grey: Bytes | Floats, where: Bools, size: int) -> float:
    """Standard deviation of a pixel against its neighbours, two pixels away along the row, in the cells ``where``.

    Two, since rectifying makes next neighbours agree.
    """
    rows, columns = some(where)
    v, u = rows * size + size // 2, np.clip(columns * size + size // 2, 2, max(2, grey.shape[1] - 3))
    if grey.shape[1] < 5:
        return 0.0
    left, centre, right = (grey[v, u + k].astype(np.float32) for k in (-2, 0, 2))
    off = 2 * centre - left - right
    return 1.4826 * float(np.median(np.abs(off))) / np.sqrt(6) if off.size else 0.0
