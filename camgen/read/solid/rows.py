"""Rows of numbers in text files of meshes."""

from __future__ import annotations

import numpy as np

from camgen.model.part import IntArray
from camgen.model.pose import FloatArray


def read_table(rows: list[str], width: int) -> FloatArray:
    """(N, width) the first numbers of each row. ValueError for a row with fewer numbers."""
    if not rows:
        return np.zeros((0, width))
    return np.loadtxt(rows, usecols=range(width), ndmin=2)


def read_equal_rows(rows: list[str]) -> IntArray | None:
    """(N, M) the whole numbers of the rows; None unless each row has as many as the first."""
    try:
        return np.loadtxt(rows, dtype=np.int64, ndmin=2)
    except ValueError:
        return None
