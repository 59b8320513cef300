"""The face of an edge that was machined last: the burr is in its plane (RFA paper, fig. 7 b)."""

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
    """The rule that decides which of two faces was machined last.

    direction: the face whose normal is more along this direction was machined last.
    ranks: ranks of the two faces by the id of their edge. They decide first: the higher rank was
        machined last.
    """

    direction: Vec3 = (0.0, 0.0, 1.0)
    ranks: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    def choose(self, edge: Edge) -> int:
        """0 or 1, the face of `edge` that was machined last.

        If the rule does not decide, it is the flat face, then the first one.
        """
        mean = np.concatenate([edge.normals[:-1], edge.via_normals]).mean(axis=0)
        along = mean @ np.asarray(self.direction)
        flatness = np.linalg.norm(mean, axis=1)
        ranks = self.ranks.get(edge.id, (0, 0))
        first, second = (
            (ranks[k], round(float(along[k]), 6), round(float(flatness[k]), 6)) for k in (0, 1)
        )
        return int(second > first)


#: The default rule: the face whose normal points up more was machined last.
TOP = LastFace()
#: Direction of the offset. "mean": along the mean of both outward normals (paper, fig. 7 a).
#: A last face: along its normal, which is perpendicular to the burr in its plane.
Offset = Literal["mean"] | LastFace


def read_offset(job: Job, solid: Solid, edges: Iterable[Edge]) -> Offset:
    """The direction of the offset from `operation.offset_along` and `operation.last_face`.

    Raises JobError for an invalid direction, an unknown face, and a last face without effect.
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
        return LastFace(_make_direction(value))
    words = value.replace(",", " ").split()
    return TOP if words == ["top"] else LastFace(ranks=_rank_faces(words, solid, edges))


def _make_direction(values: list[float]) -> Vec3:
    length = math.hypot(*values)
    if len(values) != 3 or not (math.isfinite(length) and length > 0):
        raise JobError("job", f"{values} is not a direction", _KEY, _REMEDY)
    x, y, z = (v / length for v in values)
    return x, y, z


def _rank_faces(
    words: list[str], solid: Solid, edges: Iterable[Edge]
) -> dict[str, tuple[int, int]]:
    faces = make_faces(solid)
    index = {face.id: k for k, face in enumerate(faces.listed)}
    ranks = [0] * len(index)
    if not words:
        raise JobError("job", "names no face", _KEY, _REMEDY)
    for rank, word in enumerate(words, start=1):
        if word not in index:
            what, remedy = f'"{word}" is not a face', _REMEDY
            if re.fullmatch("f[0-9]+", word):
                what = f"{solid.source} has no face {word}"
                remedy = f"its faces are f1 to f{len(index)}"
            raise JobError("job", what, _KEY, remedy)
        ranks[index[word]] = rank
    adjacent = find_adjacent_faces(edges, solid, faces)
    return {name: (ranks[a], ranks[b]) for name, (a, b) in adjacent.items()}
