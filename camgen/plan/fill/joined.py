"""Finds ink that joins separate regions, and regions without ink: shorts and lost nets."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import shapely

from camgen.geometry.nesting import find_nesting
from camgen.geometry.ragged import concatenate_columns, find_run_starts
from camgen.geometry.segments import IntArray, make_contour_segments
from camgen.model.part import Note, Part
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.plan.fill.ground import FillGrid
from camgen.plan.image_space.field import Pixels

#: Maximum number of positions in a message; the preview shows all.
_LISTED = 5


def find_bridges(ink: Pixels, region: IntArray) -> FloatArray:
    """(N, 2) positions, px, at which ink joins two regions, one for every stretch of the border.

    region: (H, W) number of the region from 1 on, 0 outside.
    Inked pixels that share an edge are one blot. A blot joins the regions that it covers, along the
    line on which both are equally near.
    """
    blot = np.asarray(cv2.connectedComponents(ink, connectivity=4)[1])
    regions = int(region.max()) + 1
    is_inked = (region > 0) & (ink > 0)
    inked = np.unique(blot[is_inked].astype(np.int64) * regions + region[is_inked])
    is_shared = np.bincount(inked // regions, minlength=int(blot.max()) + 1) > 1
    if not is_shared.any():
        return np.zeros((0, 2))
    near = np.where(is_shared[blot], _find_nearest(region), 0)
    joins = np.zeros(region.shape, dtype=np.uint8)
    pairs: list[tuple[IntArray, IntArray, IntArray]] = []
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        v, u = np.nonzero((near[first] != near[second]) & (near[first] > 0) & (near[second] > 0))
        sides = np.sort([near[first][v, u], near[second][v, u]], axis=0)
        both = np.isin(blot[v, u].astype(np.int64) * regions + sides, inked).all(axis=0)
        joins[v[both], u[both]] = 255
        pairs.append((u[both], v[both], (sides[0] * regions + sides[1])[both]))
    u, v, pair = concatenate_columns(pairs)
    stretch = np.asarray(cv2.connectedComponents(joins)[1])[v, u]
    keys = np.column_stack([stretch, pair])
    return _find_middles(u, v, np.unique(keys, axis=0, return_inverse=True)[1].ravel())


def find_bare(ink: Pixels, region: IntArray) -> FloatArray:
    """(N, 2) a position, px, in each region without any ink."""
    bare = np.bincount(region[ink > 0], minlength=int(region.max()) + 1) == 0
    bare[0] = False
    v, u = np.nonzero(bare[region])
    return _find_middles(u, v, region[v, u])


def _find_nearest(region: IntArray) -> IntArray:
    """(H, W) the region nearest to each pixel."""
    outside = (region == 0).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(
        outside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    region_of_label = np.zeros(int(label.max()) + 1, dtype=np.int64)
    inside = region > 0
    region_of_label[label[inside]] = region[inside]
    return region_of_label[label]


def _find_middles(u: IntArray, v: IntArray, group: IntArray) -> FloatArray:
    """(N, 2) the pixel (u, v) of each group that is nearest to the mean of the group."""
    order = np.argsort(group, kind="stable")
    pixels = np.column_stack([u, v])[order].astype(np.float64)
    groups = np.split(pixels, find_run_starts(group[order])[1:]) if len(group) else []
    middles = [g[np.argmin(((g - g.mean(axis=0)) ** 2).sum(axis=1))] for g in groups]
    return np.array(middles).reshape(-1, 2)


def find_merged(part: Part, field: FillGrid, border_region: IntArray) -> FloatArray:
    """(N, 2) positions, px, at which contours are so near that grid and tool make them one.

    border_region: (L,) region of each border.
    Contours of a drawing that cross or touch are not separate, so they have no position here.
    """
    if part.raster is not None and part.raster.borders:
        return np.zeros((0, 2))
    chosen = take_rows(part.contours, field.contour)
    depth = find_nesting(make_contour_segments(chosen), len(chosen)).depth
    outer = np.flatnonzero((depth % 2 == 0) & (border_region > 0))
    shared = np.flatnonzero(np.bincount(border_region[outer]) > 1)
    places = []
    for region in shared.tolist():
        rings = [_make_ring(field, k) for k in outer[border_region[outer] == region].tolist()]
        for k, ring in enumerate(rings[1:], 1):
            gap = shapely.shortest_line(ring, shapely.union_all(rings[:k]))
            if gap.length > 0:
                places.append(shapely.get_coordinates(gap).mean(axis=0))
    return np.array(places).reshape(-1, 2)


def _make_ring(field: FillGrid, loop: int) -> shapely.LinearRing:
    points = field.edge.points[field.edge.table.loop == loop]
    return shapely.LinearRing(np.column_stack([points.real, points.imag]))


def find_lost(
    field: FillGrid, ink: Pixels, border_region: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(N, 2) positions, px, of borders too small to hold a pixel.

    Returns first those without ink, then those under the ink of other regions.
    """
    small = np.flatnonzero(border_region == 0).tolist()
    means = np.array([field.edge.points[field.edge.table.loop == k].mean() for k in small])
    places = np.column_stack([means.real, means.imag])
    u, v = np.rint(places).astype(np.int64).T
    is_inked = ink[v, u] > 0
    return places[~is_inked], places[is_inked]


def note_joined(
    part: Part,
    field: FillGrid,
    ink: Pixels,
    region: IntArray,
    border_region: IntArray,
    diameter: float,
) -> Iterator[Note]:
    """Notes on regions that `ink` joins or does not reach; --strict makes both an error.

    region, border_region: region of each pixel (H, W) and of each border (L,).
    diameter: diameter of the tool, mm.
    """
    without_ink, under_ink = find_lost(field, ink, border_region)
    joined = [find_bridges(ink, region), find_merged(part, field, border_region), under_ink]
    bridges = field.to_work(np.concatenate(joined) @ np.array([1, 1j]))
    lost = np.concatenate([find_bare(ink, region), without_ink])
    bare = field.to_work(lost @ np.array([1, 1j]))
    tool = f"a {diameter:g} mm tool"
    if len(bridges):
        count = counted(len(bridges), "place")
        yield Note(
            "warning",
            f"ink joins what the artwork keeps apart at {count}: {_format_places(bridges)}",
            f"{tool} leaves no gap there; take a narrower one, or draw them farther apart",
            places=_to_pairs(bridges),
            strict=True,
        )
    if len(bare):
        remedy = "take a narrower one, or remove what does not belong to the artwork"
        yield Note(
            "skipped",
            f"{counted(len(bare), 'region')} not inked at all: {_format_places(bare)}",
            f"much smaller than {tool}; {remedy}",
            places=_to_pairs(bare),
        )


def _to_pairs(places: FloatArray) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in places.tolist())


def _format_places(places: FloatArray) -> str:
    listed = [f"({short(x, 2)}, {short(y, 2)})" for x, y in places[:_LISTED].tolist()]
    more = f" and {len(places) - _LISTED} more" if len(places) > _LISTED else ""
    return f"{', '.join(listed)} mm{more}"
