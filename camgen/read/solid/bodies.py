"""The bodies of a mesh: connected surfaces, with the names that the file gives them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.read.solid.soup import NamedVertices
from camgen.read.solid.topology import Pairs, label_components


class BodyTable(NamedTuple):
    """The bodies of a mesh: its B connected surfaces, in the order of their first faces.

    body_of_face: (F,) number of the body of each face.
    volume: (B,) mm3, negative for a surface that is inside out.
    is_closed: (B,) whether every side has two faces.
    """

    body_of_face: IntArray
    volume: FloatArray
    is_closed: BoolArray


def tabulate_bodies(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, is_turned: BoolArray | None = None
) -> BodyTable:
    """The bodies of a mesh. Faces belong to one body if they share a side with no third face.

    is_turned: (F,) faces whose winding counts as opposite. None is as False for all faces.
    """
    root = label_components(len(faces), pairs.first // 3, pairs.second // 3)
    label, body_of_face = np.unique(root, return_inverse=True)
    corners = vertices[faces] - vertices[faces].mean(axis=(0, 1))
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    if is_turned is not None:
        volume = np.where(is_turned, -volume, volume)
    total = np.asarray(np.bincount(body_of_face, volume, len(label)), dtype=np.float64)
    is_closed = np.ones(len(label), dtype=bool)
    is_closed[body_of_face[np.concatenate([pairs.open, pairs.crowded]) // 3]] = False
    return BodyTable(body_of_face, total, is_closed)


def name_bodies(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, named: NamedVertices | None
) -> tuple[str, ...]:
    """The name of each body of a mesh that is wound outward, "" for a body without one.

    A closed surface of negative volume bounds a void in another body and is not counted.
    """
    table = tabulate_bodies(vertices, faces, pairs)
    is_body = ~table.is_closed | (table.volume >= 0)
    names = np.full(len(is_body), -1)
    if named is not None:
        owners = named.owners[faces[:, 0]]
        count = len(named.names)
        keys = (table.body_of_face * count + owners)[owners >= 0]
        used, face_counts = np.unique(keys, return_counts=True)
        # The name that most faces of a body have is written last and stays.
        order = np.argsort(face_counts, kind="stable")
        names[used[order] // count] = used[order] % count
    listed = names[is_body].tolist()
    return tuple("" if k < 0 or named is None else harmless(named.names[k]) for k in listed)
