"""The scale of a rectified view. The module loads no OpenCV, so that its users need not either."""

from __future__ import annotations

import numpy as np

from camgen.model.errors import InputError
from camgen.model.pose import FloatArray


def measure_scale(work_from_view: FloatArray) -> float:
    """The scale, mm per pixel, of a transform (2, 3) that keeps shapes (PIST eq. 14).

    Raises InputError for a transform that stretches or shears.
    """
    matrix = np.asarray(work_from_view, dtype=np.float64)
    square = matrix[:, :2].T @ matrix[:, :2] if matrix.shape == (2, 3) else np.zeros((2, 2))
    scale = float(np.sqrt(np.trace(square) / 2))
    if (
        not np.isfinite(matrix).all()
        or scale <= 0
        or np.abs(square / scale**2 - np.eye(2)).max() > 1e-6
    ):
        raise InputError(
            "view",
            "the view is not to scale: one pixel is not as long in every direction",
            remedy="rectify the photo first",
        )
    return scale
