"""Faces wound so that their normals point out of the part, whatever the file says."""

from __future__ import annotations

import numpy as np

from camgen.pose import FloatArray
from camgen.solid import BoolArray, IntArray
from camgen.solids.pairs import Pairs, components


def wrongly_wound(vertices: FloatArray, faces: IntArray, pairs: Pairs) -> tuple[BoolArray, int, int]:
    """(F,) the faces to turn round, how many of them disagree with their body, and how many bodies are inside out.

    Faces that hang together are wound like the most of them. A closed body is turned if its volume is negative, unless
    it lies within the box of another one: then it may be a void, and is turned if that one is.
    """
    body = components(len(faces), pairs.first // 3, pairs.second // 3)
    turn = _minority(faces, pairs, body)
    odd = int(np.count_nonzero(turn))
    corners = vertices[faces] - vertices[faces].mean(axis=(0, 1))
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6 * np.where(turn, -1, 1)
    label, of = np.unique(body, return_inverse=True)
    total = np.asarray(np.bincount(of, volume, len(label)), dtype=np.float64)
    closed = np.ones(len(label), dtype=bool)
    closed[of[np.concatenate([pairs.open, pairs.crowded]) // 3]] = False
    inverted = _inverted(corners, of, total, closed)
    return turn ^ inverted[of], odd, int(np.count_nonzero(inverted))


def _minority(faces: IntArray, pairs: Pairs, body: IntArray) -> BoolArray:
    """(F,) faces that are wound against the most of their body.

    Every face is two nodes, as it is and turned; what agrees across an edge is linked. A body whose two halves
    come out as one cannot be told inside from outside: it is left as it is.
    """
    count = len(faces)
    turn = np.zeros(count, dtype=bool)
    if not pairs.turned.any():
        return turn
    f, g = pairs.first // 3, pairs.second // 3
    swap = np.where(pairs.turned, count, 0)
    label = components(2 * count, np.concatenate([f, f + count]), np.concatenate([g + swap, g + count - swap]))
    turn = label[:count] > label[count:]
    most = np.bincount(body, turn, count) * 2 > np.bincount(body, minlength=count)
    return np.asarray((turn ^ most[body]) & (label[:count] != label[count:]))


def _inverted(corners: FloatArray, of: IntArray, volume: FloatArray, closed: BoolArray) -> BoolArray:
    """(bodies,) which closed ones are inside out: those of negative volume in no other one, and what is in them."""
    count = len(volume)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of, corners.min(axis=1))
    np.maximum.at(high, of, corners.max(axis=1))
    inverted = np.zeros(count, dtype=bool)
    for k in np.flatnonzero(closed & (volume < 0)).tolist():
        if not (closed & (low < low[k]).all(axis=1) & (high > high[k]).all(axis=1)).any():
            inverted |= closed & (low >= low[k]).all(axis=1) & (high <= high[k]).all(axis=1)
    return inverted
