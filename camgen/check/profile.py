"""Speeds along a row of pieces with one acceleration each, and the time that they take."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray


def squares(length: FloatArray, allowed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """The greatest squared speeds (N + 1,) at the nodes of N pieces, mm2/s2.

    Along s the square changes by at most 2 a s, so that every node limits all others:
    v_k^2 = min over j of allowed_j + |W_k - W_j|, with W the sum of 2 a s. These are the two passes
    of a planner with look-ahead, forward and back, by running minima instead of a loop.

    length: lengths of the pieces (N,), mm.
    allowed: greatest squares at the nodes (N + 1,), mm2/s2.
    acceleration: accelerations along the pieces (N,), mm/s2.
    """
    climb = np.append(0.0, np.cumsum(2.0 * acceleration * length))
    forward = climb + np.minimum.accumulate(allowed - climb)
    back = np.minimum.accumulate((allowed + climb)[::-1])[::-1] - climb
    return np.asarray(np.clip(np.minimum(forward, back), 0.0, allowed))


def durations(
    length: FloatArray, limit: FloatArray, square: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Seconds (N,) of N pieces.

    Each is a trapezoid: up to the peak, along it, down. Without room for the way along it
    peak^2 = (v0^2 + v1^2) / 2 + a s.

    length: lengths of the pieces (N,), mm.
    limit: speed limits along the pieces (N,), mm/s.
    square: squared speeds at the nodes (N + 1,), mm2/s2.
    acceleration: accelerations along the pieces (N,), mm/s2.
    """
    before, after = square[:-1], square[1:]
    peak2 = np.minimum(limit * limit, (before + after) / 2 + acceleration * length)
    peak2 = np.maximum(peak2, np.maximum(before, after))
    peak = np.sqrt(peak2)
    along = np.maximum(length - (2 * peak2 - before - after) / (2 * acceleration), 0.0)
    ramps = (2 * peak - np.sqrt(before) - np.sqrt(after)) / acceleration
    return np.asarray(ramps + along / np.where(peak > 0, peak, 1.0))
