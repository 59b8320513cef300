"""Smooth surfaces through a picture's cells, blind to what does not belong to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Places = tuple[NDArray[np.intp], NDArray[np.intp]]

_SAMPLES = 4_000
#: Tukey's biweight: 95 % efficient for normal noise, blind to what is farther out (Beaton and Tukey 1974).
_TUKEY = 4.685
_LEAST_SIGMA = 0.4
_SECOND, _FOURTH = (tuple((m, n) for n in range(d + 1) for m in range(d + 1 - n)) for d in (2, 4))
#: Turns of least absolute values, which bear a third of outliers without a start, and of the biweight after them.
_ABSOLUTE, _BIWEIGHT = 10, 6


def some(where: NDArray[np.bool_]) -> Places:
    """Rows and columns of at most ``_SAMPLES`` true cells, evenly spread."""
    places = np.flatnonzero(where)
    rows, columns = np.divmod(places[:: len(places) // _SAMPLES + 1], where.shape[1])
    return rows, columns


def quadratic(shape: tuple[int, ...], at: Places) -> Doubles:
    """(N, 6): the products of x and y up to the second power at the places; x and y run from -1 to 1."""
    return _products(shape, at, _SECOND)


def quartic(shape: tuple[int, ...], at: Places) -> Doubles:
    """(N, 15): the same up to the fourth power, as the light of a lens falls off."""
    return _products(shape, at, _FOURTH)


def _products(shape: tuple[int, ...], at: Places, powers: tuple[tuple[int, int], ...]) -> Doubles:
    x, y = _axes(shape)
    u, v = ([np.ones_like(c[k])] for c, k in ((x, at[1]), (y, at[0])))
    for _ in range(max(max(powers))):
        u.append(u[-1] * x[at[1]])
        v.append(v[-1] * y[at[0]])
    return np.column_stack([u[m] * v[n] for m, n in powers])


def surface(shape: tuple[int, ...], c: Doubles) -> NDArray[np.float32]:
    """(h, w): the surface of the 6 or 15 coefficients."""
    powers = _SECOND if len(c) == len(_SECOND) else _FOURTH
    degree = max(max(powers))
    table = np.zeros((degree + 1, degree + 1))
    for (m, n), factor in zip(powers, c.tolist(), strict=True):
        table[n, m] = factor
    x, y = _axes(shape)
    rows, columns = (np.vander(axis, degree + 1, increasing=True).astype(np.float32) for axis in (y, x))
    # Not by @: BLAS starts its threads for it, and waits for them on a busy machine.
    return np.asarray(np.einsum("im,jm->ij", rows @ table.astype(np.float32), columns), np.float32)


def _axes(shape: tuple[int, ...]) -> tuple[Doubles, Doubles]:
    x, y = ((np.arange(n) * 2 + 1) / n - 1 for n in (shape[1], shape[0]))
    return x, y


def robust(basis: Doubles, wanted: Doubles, turns: int = _ABSOLUTE) -> tuple[Doubles, float]:
    """Coefficients and spread by re-weighted least squares, ``turns`` of them least absolute values."""
    weights = np.ones_like(wanted)
    # A little on the diagonal: three columns of cells, or a bench of one tone, do not settle all coefficients.
    ridge = 1e-7 * np.eye(basis.shape[1]) * float(np.square(basis).sum(axis=0).max())
    for turn in range(turns + _BIWEIGHT):
        scaled = basis * weights[:, None]
        c = np.asarray(np.linalg.solve(scaled.T @ basis + ridge, scaled.T @ wanted), np.float64)
        off = np.asarray(wanted - basis @ c, np.float64)
        sigma = spread(off)
        weights = np.asarray(1 / np.maximum(np.abs(off), sigma / 4)) if turn < turns else biweight(off, sigma)
    return c, sigma


def spread(off: NDArray[np.floating]) -> float:
    """Standard deviation of most of the values, from their median distance to 0; never 0."""
    return max(_LEAST_SIGMA, 1.4826 * float(np.median(np.abs(off)))) if off.size else _LEAST_SIGMA


def biweight(off: Doubles, sigma: float) -> Doubles:
    """What each value counts: 1 to 0."""
    return np.asarray(np.square(np.clip(1 - np.square(off / (_TUKEY * sigma)), 0, None)), np.float64)


def covariance(values: Doubles) -> Doubles:
    """(c, c) of (N, c)."""
    off = values - values.mean(axis=0)
    return np.asarray(off.T @ off / len(off), np.float64)
