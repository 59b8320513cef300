"""Boxes for a tree that finds what is near."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from camgen.pose import FloatArray


def boxed(boxes: FloatArray) -> NDArray[Any]:
    """Geometries (N,) with the boxes (N, 4) of xmin, ymin, xmax, ymax: their diagonals.

    A tree that is asked without a predicate looks at boxes alone, and a diagonal is made in half a rectangle's time.
    """
    return np.asarray(shapely.linestrings(boxes.reshape(-1, 2, 2)))
