"""Which of the two faces of an edge was machined last: the burr stands in its plane (RFA paper, fig. 7 b)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from msgspec import Struct, field

from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Edge, Solid
from camgen.model.pose import Vec3
from camgen.read.solid.faces import find_adjacent_faces, make_faces

_KEY = "operation.last_face"
_REMEDY = 'give "top", a normal as [x, y, z], or ids of faces as camgen inspect prints them'


class LastFace(Struct, frozen=True):
    """looks: of two faces the one that looks more along it was machined later. ranks: by the id of an edge those of its
    two faces, which come before that: the higher one was machined later.
    """

    looks: Vec3 = (0.0, 0.0, 1.0)
    ranks: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def of(self, edge: Edge) -> int:
        """0 or 1, which face of ``edge`` was machined last. Of two alike the flat one, then the first of the edge."""
        mean = np.concatenate([edge.normals[:-1], edge.via_normals]).mean(axis=0)
        along = mean @ np.asarray(self.looks)
        flat = np.linalg.norm(mean, axis=1)
        told = self.ranks.get(edge.id, (0, 0))
        one, other = (
            (told[k], round(float(along[k]), 6), round(float(flat[k]), 6)) for k in (0, 1)
        )
        return int(other > one)


#: A part does not say which of two faces was machined last: the one that looks up more is taken.
TOP = LastFace()
#: mean: along the mean of the two outward normals (paper, fig. 7 a). A last face: square to the burr, which stands in
#: the plane of the face machined last, so that the offset is this face's normal.
Offset = Literal["mean"] | LastFace


def offset_along(job: Job, solid: Solid, edges: Iterable[Edge]) -> Offset:
    """What ``operation.offset_along`` and ``last_face`` say of ``edges``. JobError for what is neither a direction nor
    a face of the part, and for a last face that has no effect.
    """
    value = job.operation.last_face
    if job.operation.offset_along == "mean":
        if value != "top":
            raise JobError(
                "job",
                'has no effect on an offset along the "mean"',
                _KEY,
                'set operation.offset_along = "burr"',
            )
        return "mean"
    if not isinstance(value, str):
        return LastFace(_direction(value))
    words = value.replace(",", " ").split()
    return TOP if words == ["top"] else LastFace(ranks=_ranks(words, solid, edges))


def _direction(values: list[float]) -> Vec3:
    length = math.hypot(*values)
    if len(values) != 3 or not (math.isfinite(length) and length > 0):
        raise JobError("job", f"{values} is no direction", _KEY, _REMEDY)
    x, y, z = (v / length for v in values)
    return x, y, z


def _ranks(words: list[str], solid: Solid, edges: Iterable[Edge]) -> dict[str, tuple[int, int]]:
    """Faces that are named were machined after all others, in the order in which they are named."""
    faces = make_faces(solid)
    known = {face.id: k for k, face in enumerate(faces.listed)}
    ranks = [0] * len(known)
    if not words:
        raise JobError("job", "names no face", _KEY, _REMEDY)
    for rank, word in enumerate(words, start=1):
        if word not in known:
            what = (
                f"{solid.source} has no face {word}"
                if re.fullmatch("f[0-9]+", word)
                else f'"{word}" is no face'
            )
            remedy = (
                f"its faces are f1 to f{len(known)}" if re.fullmatch("f[0-9]+", word) else _REMEDY
            )
            raise JobError("job", what, _KEY, remedy)
        ranks[known[word]] = rank
    return {
        name: (ranks[a], ranks[b])
        for name, (a, b) in find_adjacent_faces(edges, solid, faces).items()
    }
