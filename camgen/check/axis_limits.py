"""Limits of a machine in a direction, from the limits of its axes."""

from __future__ import annotations

import numpy as np

from camgen.model.pose import FloatArray, Vec3


def limit_along(limits: Vec3, direction: FloatArray) -> FloatArray:
    """(K,) the most in each unit `direction` (K, 3) with which no axis exceeds its limit.

    Infinite for the direction 0.
    """
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray((np.asarray(limits) / np.abs(direction)).min(axis=1))


def limit_around(limits: Vec3, normal: FloatArray) -> FloatArray:
    """(K,) the most in every direction of the plane across the unit `normal` (K, 3)."""
    share = np.sqrt(np.clip(1.0 - normal * normal, 0.0, None))
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray((np.asarray(limits) / share).min(axis=1))
