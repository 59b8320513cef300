"""Boxes of a job, which are given by two opposite corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.errors import JobError
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: Two opposite corners of a box, the lower ones first.
Corners = tuple[FloatArray, FloatArray]


def check_corners(key: str, values: Sequence[float]) -> Corners:
    """The corners of a box of a job, the lower one first. Raises JobError for a wrong box.

    key: key of the job for the message.
    """
    if len(values) != 6:
        raise JobError(
            "job",
            f"a box has {counted(len(values), 'value')}",
            key,
            "give two corners: [x, y, z, x, y, z]",
        )
    ends = np.reshape(values, (2, 3)).astype(np.float64)
    low, high = ends.min(axis=0), ends.max(axis=0)
    if not np.isfinite(ends).all() or (high - low).min() <= 0:
        raise JobError(
            "job", "a box has no size", key, "give two corners that differ in x, y and z"
        )
    return low, high
