"""Straight edges and circular rims by formulas, with the normals of both faces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from camgen.model.part import Edge
from camgen.model.pose import FloatArray
from camgen.motion.reach import reach_paths
from camgen.motion.setup import EdgeMotion, OrientationFreedom, Setup, UnreachableEdge
from camgen.plan.edges.last_face import Offset
from camgen.plan.edges.poses import make_poses

Vector = Sequence[float]
_NOMINAL = OrientationFreedom()


def straight(start: Vector, end: Vector, first: Vector, second: Vector, name: str = "e1") -> Edge:
    """A straight edge with constant normals of its two faces."""
    points = np.array([start, end], dtype=np.float64)
    normals = np.array([first, second], dtype=np.float64)
    both = np.stack([normals, normals])
    angle = math.acos(np.clip(normals[0] @ normals[1], -1, 1))
    length = float(np.linalg.norm(points[1] - points[0]))
    via = points.mean(axis=0, keepdims=True)
    return Edge(name, "line", points, via, both, both[:1], angle, True, False, 0.0, length)


def rim(centre: Vector, radius: float, outer: bool, name: str = "e1") -> Edge:
    """The upper rim of an upright cylinder: a boss (`outer`) or a bore."""
    angles = np.arange(5) * (math.pi / 2)
    radial = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    points = np.array(centre) + radius * radial
    points[4] = points[0]
    up = np.broadcast_to([0.0, 0.0, 1.0], radial.shape)
    normals: FloatArray = np.stack([up, radial if outer else -radial], axis=1)
    return Edge(
        name, "circle", points[::2], points[1::2], normals[::2], normals[1::2],
        math.pi / 2, True, True, radius, math.tau * radius,
    )  # fmt: skip


def reach(
    edges: Iterable[Edge],
    setup: Setup,
    offset: float,
    direction: Offset = "mean",
    freedom: OrientationFreedom = _NOMINAL,
) -> tuple[EdgeMotion | UnreachableEdge, ...]:
    """Run the arm along `edges`, `offset` mm away from them, as `reach_paths` says."""
    paths = [(edge, make_poses(edge, offset, direction)) for edge in edges]
    return reach_paths(paths, setup, freedom)
