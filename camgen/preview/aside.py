"""What lies in space, seen from the front and from above: as flat curves that a drawing has."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath, Tour, waypoints
from camgen.model.pose import FloatArray, frozen
from camgen.preview.curves import of_spans

#: Where it is seen from, rad: turned from the front to the right, and up.
TURN, TILT = -1.05, 0.6
#: Arcs are drawn to this part of the size of what is shown.
_FINE = 1e-4


def look_from(turn: float, tilt: float) -> FloatArray:
    """(2, 3): what is right and what is up in a picture that is taken from there."""
    right = (-math.sin(turn), math.cos(turn), 0.0)
    up = (-math.sin(tilt) * math.cos(turn), -math.sin(tilt) * math.sin(turn), math.cos(tilt))
    return np.array([right, up])


def see_aside(part: Part, tour: Tour) -> tuple[Part, Tour]:
    """``part`` with its curves, and ``tour`` with its paths, as they look from aside: chains of lines, z = 0."""
    every = np.concatenate([curve.points for curve in part.curves])
    sag = max(float(np.linalg.norm(np.ptp(every, axis=0))) * _FINE, 1e-4)
    shown = _flatten([(curve.points, curve.via) for curve in part.curves], sag)
    contours = [
        Contour(frozen(rows), frozen(np.zeros(len(rows))), False, curve.layer, curve.id)
        for rows, curve in zip(shown, part.curves, strict=True)
    ]
    paths = _flatten([(path.position, path.via[1:]) for path in tour.paths], sag)
    seen = [_as_seen(path, rows) for path, rows in zip(tour.paths, paths, strict=True)]
    return replace(part, contours=tuple(contours)), replace(tour, paths=tuple(seen))


def _flatten(chains: Sequence[tuple[FloatArray, FloatArray]], sag: float) -> list[FloatArray]:
    found = of_spans(list(chains), sag)
    return np.split(found.points @ look_from(TURN, TILT).T, np.cumsum(found.counts)[:-1])


def _as_seen(path: ToolPath, rows: FloatArray) -> ToolPath:
    return replace(
        path,
        table=waypoints(np.column_stack([rows, np.zeros(len(rows))]), np.nan, path.feed[0]),
    )
