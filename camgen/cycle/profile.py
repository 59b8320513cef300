"""Speeds along a line of pieces by one acceleration, and the time that they take."""

from __future__ import annotations

import numpy as np

from camgen.pose import FloatArray


def squares(length: FloatArray, allowed: FloatArray, acceleration: FloatArray) -> FloatArray:
    """The greatest squared speeds (N + 1,) at the nodes of N pieces that acceleration and braking can hold.

    length: (N,) mm. allowed: (N + 1,) the most at each node, mm2/s2. acceleration: (N,) mm/s2. Along s the square
    changes by 2 a s at most, so that every node limits all others: v_k^2 = min over j of allowed_j + |W_k - W_j| with W
    the sum of 2 a s. That is the pass forward and the pass back of a look-ahead planner over all pieces at once, by
    running minima instead of a loop.
    """
    climb = np.append(0.0, np.cumsum(2.0 * acceleration * length))
    forward = climb + np.minimum.accumulate(allowed - climb)
    back = np.minimum.accumulate((allowed + climb)[::-1])[::-1] - climb
    return np.asarray(np.clip(np.minimum(forward, back), 0.0, allowed))


def durations(length: FloatArray, most: FloatArray, square: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Seconds (N,) of pieces between nodes of squared speed ``square`` (N + 1,), no faster than ``most`` (N,) mm/s.

    Each is a trapezoid: up to the peak, along it, down. peak^2 = (v0^2 + v1^2) / 2 + a s where there is no room for
    the way along.
    """
    before, after = square[:-1], square[1:]
    peak2 = np.minimum(most * most, (before + after) / 2 + acceleration * length)
    peak2 = np.maximum(peak2, np.maximum(before, after))
    peak = np.sqrt(peak2)
    along = np.maximum(length - (2 * peak2 - before - after) / (2 * acceleration), 0.0)
    ramps = (2 * peak - np.sqrt(before) - np.sqrt(after)) / acceleration
    return np.asarray(ramps + along / np.where(peak > 0, peak, 1.0))


def from_rest(way: FloatArray, speed: FloatArray | float, acceleration: FloatArray | float) -> FloatArray:
    """Seconds from rest to rest over ``way`` >= 0, in units that go together: a trapezoid, or a triangle if short."""
    speed, acceleration = np.asarray(speed), np.asarray(acceleration)
    short = way * acceleration < speed * speed
    return np.where(short, 2 * np.sqrt(way / acceleration), way / speed + speed / acceleration)
