"""How far an edge bends into the tip of the tool that works it: contact, and no collision."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from camgen.model.job import Job
from camgen.model.part import Edge
from camgen.model.pose import FloatArray
from camgen.motion.pose_paths import PosePath, counts, divide
from camgen.motion.setup import dense_parts
from camgen.plan.edges.last_face import Offset
from camgen.plan.edges.poses import poses

#: Of the tool's radius: an edge that bends into its tip by more does not fit round it, and collides.
_MOST = 0.25
#: mm: what the collision test lets a tip enter anyway.
_ANYWAY = 0.1
#: mm, rad: an edge is looked at so often.
_LOOK_MM, _LOOK_TURN = 0.5, np.radians(5)


def own_contact(edges: Iterable[Edge], job: Job, direction: Offset = "mean") -> float:
    """Mm that the tip of the nominal tool may enter the part so that those of ``edges`` that bend into it by no more
    than a quarter of its radius are free of it: 0 where none does.
    """
    radius = job.tool.radius
    deep = (_depth(edge, job, radius, direction) for edge in edges if edge.kind != "line")
    return max((depth for depth in deep if _ANYWAY < depth <= _MOST * radius), default=0.0)


def _depth(edge: Edge, job: Job, radius: float, direction: Offset) -> float:
    """Mm by which the edge enters the square bar of the tool that works it, from its end or its sides."""
    tool, drawn = (poses(edge, offset, direction) for offset in (job.operation.offset, 0.0))
    if not isinstance(tool, PosePath) or not isinstance(drawn, PosePath):
        return 0.0
    points = divide(drawn, counts(drawn, _LOOK_MM, _LOOK_TURN)).position
    looks = divide(tool, dense_parts(tool))
    return max(
        (
            _enter(points, *pose, radius)
            for pose in zip(looks.position, looks.rotation, strict=True)
        ),
        default=0.0,
    )


def _enter(points: FloatArray, position: FloatArray, rotation: FloatArray, radius: float) -> float:
    """Mm by which the bar must become thinner and shorter to be free of ``points`` (N, 3), work frame."""
    x, y, z = ((points - position) @ rotation).T
    return float(np.minimum.reduce([radius - np.abs(x), radius - np.abs(y), -z]).max(initial=0.0))
