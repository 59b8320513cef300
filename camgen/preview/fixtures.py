"""The fixtures of a mill as pictures from above show them."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from camgen.model.pose import FloatArray
from camgen.preview import Built

#: A picture shows fixtures as far beyond part and paths as this part of their longer side.
_BEYOND = 0.2


class FixtureView(Struct, frozen=True, eq=False):
    """A fixture from above.

    number: its place in `cell.fixtures`, from 1.
    top: z of its highest surface, mm.
    loops: (N, 2) outlines, mm, as far as they are shown.
    """

    number: int
    top: float
    loops: tuple[FloatArray, ...]


def clip_fixtures(result: Built) -> tuple[FixtureView, ...]:
    """The fixtures around the part. A table far beyond it is cut off."""
    fixtures = result.cell.fixtures
    points = [contour.points for contour in result.part.contours]
    points += [path.position[:, :2] for path in result.tour.paths]
    if fixtures is None or not points:
        return ()
    import shapely  # noqa: PLC0415 (only with fixtures)

    drawn = np.concatenate(points)
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    beyond = _BEYOND * float((high - low).max())
    window = shapely.box(*(low - beyond), *(high + beyond))
    views = []
    for fixture in fixtures.listed:
        shown = shapely.get_parts(shapely.intersection(fixture.outline, window))
        rings = [shapely.get_coordinates(part.exterior) for part in shown if part.area > 0]
        if rings:
            views.append(FixtureView(fixture.number, fixture.top, tuple(rings)))
    return tuple(views)
