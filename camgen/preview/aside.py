"""Projects curves and paths in space to flat ones, seen from the front and above."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath, Tour, make_waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.preview.curves import lift, trace_spans

#: Direction of view, rad: rotation about the vertical from the x axis, and angle above the horizon.
TURN, TILT = -1.05, 0.6
#: Tolerance with which arcs are drawn, as a fraction of the size of the picture.
_SAG_FRACTION = 1e-4


def compute_view_axes(turn: float, tilt: float) -> FloatArray:
    """The directions to the right and up, (2, 3), of a view from these angles, rad."""
    right = (-math.sin(turn), math.cos(turn), 0.0)
    up = (-math.sin(tilt) * math.cos(turn), -math.sin(tilt) * math.sin(turn), math.cos(tilt))
    return np.array([right, up])


def project_aside(part: Part, tour: Tour) -> tuple[Part, Tour]:
    """Project the curves of `part` and the paths of `tour` to chains of lines at z = 0."""
    points = np.concatenate([curve.points for curve in part.curves])
    sag = max(float(np.linalg.norm(np.ptp(points, axis=0))) * _SAG_FRACTION, 1e-4)
    chains = _project([(curve.points, curve.via) for curve in part.curves], sag)
    contours = [
        Contour(frozen(rows), frozen(np.zeros(len(rows))), False, curve.layer, curve.id)
        for rows, curve in zip(chains, part.curves, strict=True)
    ]
    chains = _project([(path.position, path.via[1:]) for path in tour.paths], sag)
    paths: list[ToolPath] = []
    for path, rows in zip(tour.paths, chains, strict=True):
        paths.append(replace(path, table=make_waypoints(lift(rows), np.nan, path.feed[0])))
    return replace(part, contours=tuple(contours)), replace(tour, paths=tuple(paths))


def _project(chains: Sequence[tuple[FloatArray, FloatArray]], sag: float) -> list[FloatArray]:
    drawn = trace_spans(list(chains), sag)
    return np.split(drawn.points @ compute_view_axes(TURN, TILT).T, np.cumsum(drawn.counts)[:-1])
