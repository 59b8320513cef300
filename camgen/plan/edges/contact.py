"""Depths by which rims bend into the tip of the tool that works them: contact, and no collision."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from camgen.model.job import Job
from camgen.model.part import Edge
from camgen.model.pose import FloatArray
from camgen.motion.pose_paths import PosePath, count_parts, divide
from camgen.motion.setup import count_samples
from camgen.plan.edges.last_face import Offset
from camgen.plan.edges.poses import make_poses

#: Greatest depth as a part of the tool's radius. A rim that bends deeper collides.
_MOST = 0.25
#: Depth that the collision test allows for any edge, mm.
_ANYWAY = 0.1
#: Greatest distance and turn between two samples of an edge, mm and rad.
_LOOK_MM, _LOOK_TURN = 0.5, np.radians(5)


def find_contacts(edges: Iterable[Edge], job: Job, direction: Offset = "mean") -> dict[str, float]:
    """The depth by which each rim bends into the tip of the nominal tool, mm, by its id.

    A rim is an edge that bends into the tip by more than 0.1 mm, and by a quarter of the radius of
    the tool at most. Other edges are not in the result.
    """
    depths, radius = {}, job.tool.radius
    for edge in edges:
        depth = 0.0 if edge.kind == "line" else _depth(edge, job, radius, direction)
        if _ANYWAY < depth <= _MOST * radius:
            depths[edge.id] = depth
    return depths


def _depth(edge: Edge, job: Job, radius: float, direction: Offset) -> float:
    """Depth by which an edge enters the square bar of its tool, from the end or a side, mm."""
    tool = make_poses(edge, job.operation.offset, direction)
    drawn = make_poses(edge, 0.0, direction)
    if not isinstance(tool, PosePath) or not isinstance(drawn, PosePath):
        return 0.0
    points = divide(drawn, count_parts(drawn, _LOOK_MM, _LOOK_TURN)).position
    looks = divide(tool, count_samples(tool))
    poses = zip(looks.position, looks.rotation, strict=True)
    return max((_enter(points, *pose, radius) for pose in poses), default=0.0)


def _enter(points: FloatArray, position: FloatArray, rotation: FloatArray, radius: float) -> float:
    """Depth by which the bar must shrink to be free of `points` (N, 3), work frame, mm."""
    x, y, z = ((points - position) @ rotation).T
    return float(np.minimum.reduce([radius - np.abs(x), radius - np.abs(y), -z]).max(initial=0.0))
