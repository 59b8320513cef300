"""Fixtures of a mill from above: clamps, vices and stops as layers, each an outline with its top.

A tool that points straight down fills the space from its tip upwards. So of a fixture only its
highest surface counts: the tool meets it where its tip is below a top inside the outline. A box is
one layer. A mesh is cut into bands of height; the outline of a band holds all of the mesh from its
lower end up, its top is its upper end. This is exact for upright walls and level faces at the ends
of a band, and else higher than the mesh by at most one band.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from msgspec import Struct

from camgen.geometry.corners import check_corners
from camgen.model.job import Job, ToolTable
from camgen.model.part import Solid
from camgen.model.pose import FloatArray

#: Height of a band, mm, and bands of one mesh at most.
_BAND_MM, _MOST_BANDS = 1.0, 64
#: Heights and coordinates closer than this, mm, are the same.
_SAME_MM = 1e-6

#: A clamp holds material that reaches beneath it by this, mm.
_GRIP_MM = 1.0


class Layer(Struct, frozen=True, eq=False):
    """A part of a fixture that reaches up to one height.

    outline: polygon, or several, mm.
    top: z of its highest surface, mm.
    """

    outline: Any
    top: float


class Fixture(Struct, frozen=True, eq=False):
    """A fixture of the job.

    number: its place in `cell.fixtures`, from 1.
    layers: its layers, the highest first. The outline of each one holds that of the one before.
    bottom: height of its lowest place, z in mm.
    """

    number: int
    layers: tuple[Layer, ...]
    bottom: float

    @property
    def name(self) -> str:
        """Its name in messages."""
        return f"fixture {self.number}"

    @property
    def top(self) -> float:
        """Height of its highest surface, z in mm."""
        return self.layers[0].top

    @property
    def outline(self) -> Any:
        """Polygon of the whole fixture from above, mm."""
        return self.layers[-1].outline


class Fixtures(Struct, frozen=True, eq=False):
    """The clamps, vices and stops of a mill.

    listed: the fixtures.
    margin: `cell.margin`, the room that tool and holder keep from them, mm.
    safety: `cell.safety`, the height at which travel passes over them, mm.
    """

    listed: tuple[Fixture, ...]
    margin: float
    safety: float

    @property
    def lift(self) -> float:
        """Height of travel over a fixture above its top, mm."""
        return max(self.safety, self.margin)

    @property
    def clamped(self) -> Any:
        """The area in which fixtures lie on the stock and hold it, polygons in mm.

        Such a fixture stands above the top face, z = 0, and reaches down to it. Its border holds
        nothing.
        """
        lying = [each.outline for each in self.listed if each.bottom <= _SAME_MM < each.top]
        return shapely.buffer(shapely.union_all(lying), -_GRIP_MM)

    @property
    def travel(self) -> float:
        """Height at which travel is above all fixtures, z in mm."""
        return max(fixture.top for fixture in self.listed) + self.lift


class Body(Struct, frozen=True):
    """The tool, or a box of its holder, from a height up.

    name: "tool" or "holder".
    height: its lower end above the tip, mm.
    radius: mm.
    """

    name: str
    height: float
    radius: float


def list_fixtures(job: Job, meshes: Sequence[tuple[str, Solid]]) -> Fixtures | None:
    """The fixtures of a job; None if it has no fixtures. Raises JobError for a wrong box.

    meshes: names and shapes of those that are meshes or drawn, in their order.
    """
    shapes = iter(meshes)
    listed = [
        _make_fixture(number, given if isinstance(given, list) else next(shapes)[1])
        for number, given in enumerate(job.cell.fixtures or (), 1)
    ]
    return Fixtures(tuple(listed), job.cell.margin, job.cell.safety) if listed else None


def _make_fixture(number: int, shape: Solid | Sequence[float]) -> Fixture:
    if isinstance(shape, Solid):
        return Fixture(number, _list_layers(shape), float(shape.vertices[:, 2].min()))
    low, high = check_corners("cell.fixtures", shape)
    layer = Layer(shapely.box(*low[:2], *high[:2]), float(high[2]))
    return Fixture(number, (layer,), float(low[2]))


def list_bodies(tool: ToolTable) -> list[Body]:
    """The tool as wide as it cuts, and the boxes of its holder.

    A box stands for a round body: as wide as it is from the axis.
    """
    bodies = [Body("tool", 0.0, tool.radius)]
    for x1, y1, z1, x2, y2, z2 in tool.holder or ():
        radius = max(abs(x1), abs(y1), abs(x2), abs(y2))
        bodies.append(Body("holder", tool.length - max(z1, z2), radius))
    return bodies


def _list_layers(solid: Solid) -> tuple[Layer, ...]:
    triangles = solid.vertices[solid.faces]
    lowest, highest = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
    layers: list[Layer] = []
    outline = shapely.Polygon()
    for bottom, top in reversed(list(pairwise(_choose_levels(triangles[:, :, 2])))):
        within = (highest > bottom + _SAME_MM) & (lowest <= top + _SAME_MM)
        pieces = _project(triangles[within], bottom)
        grown = _unite(outline, pieces[shapely.area(pieces) > _SAME_MM])
        if not layers or grown.area > outline.area + _SAME_MM:
            outline = shapely.simplify(grown, _SAME_MM)
            layers.append(Layer(outline, float(top)))
    return tuple(layers)


def _unite(outline: Any, pieces: Any) -> Any:
    """An outline with polygons (N,) added. A union may lose polygons whose corners nearly meet:
    lost ones, whose middle is outside, are added one by one.
    """
    grown = shapely.union_all([outline, *pieces])
    middles = shapely.get_coordinates(shapely.centroid(pieces))
    for piece in pieces[~shapely.contains_xy(grown, middles)]:
        grown = shapely.union(grown, piece)
    return grown


def _choose_levels(heights: FloatArray) -> list[float]:
    """The ends of the bands: all heights of vertices with parts of those that are far apart; of too
    many, bands of one height.
    """
    levels = np.unique(np.round(heights, 6))
    step = max(_BAND_MM, float(np.ptp(levels)) / _MOST_BANDS)
    if len(levels) > _MOST_BANDS:
        return list(np.linspace(levels[0], levels[-1], _MOST_BANDS + 1).tolist())
    ends = [float(levels[0])]
    for bottom, top in pairwise(levels.tolist()):
        count = int(np.ceil((top - bottom) / step - _SAME_MM))
        ends += np.linspace(bottom, top, max(count, 1) + 1)[1:].tolist()
    return ends


def _project(triangles: FloatArray, bottom: float) -> Any:
    """Polygons of triangles (N, 3, 3) above a height, from above; some may be empty."""
    bottom -= _SAME_MM
    start, end = triangles, np.roll(triangles, -1, axis=1)
    above = start[:, :, 2] >= bottom
    crosses = (start[:, :, 2] - bottom) * (end[:, :, 2] - bottom) < 0
    rise = np.where(crosses, end[:, :, 2] - start[:, :, 2], 1.0)
    cut = start + ((bottom - start[:, :, 2]) / rise)[:, :, None] * (end - start)
    # Every corner, followed by the place where its side crosses the height.
    # On a grid: corners that differ by rounding alone make slivers that a union may lose.
    points = np.round(np.stack([start, cut], axis=2)[..., :2], 6)
    kept = np.stack([above, crosses], axis=2)
    which = np.broadcast_to(np.arange(len(triangles))[:, None, None], kept.shape)[kept]
    chains = shapely.linestrings(points[kept], indices=which) if kept.any() else []
    return shapely.buffer(shapely.convex_hull(chains), 0.0)
