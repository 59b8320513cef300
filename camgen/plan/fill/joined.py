"""Where ink joins regions that the artwork keeps apart, and regions without any: on a board, a short and a lost net."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import shapely

from camgen.geometry.nesting import find_nesting
from camgen.geometry.ragged import run_starts
from camgen.geometry.segments import IntArray, from_contours
from camgen.model.part import Note, Part
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.plan.fill.ground import Ground, Pixels

#: So many places are told in words; the preview shows all.
_TOLD = 5


def find_bridges(ink: Pixels, region: IntArray) -> FloatArray:
    """(N, 2) px where ink joins two regions, one place for every stretch of it. region: (H, W) 1 and on, 0 outside.

    Ink is one blot where its pixels share an edge. Regions that it covers are joined; they are where as much of it is
    nearer to the one as to the other.
    """
    blot = np.asarray(cv2.connectedComponents(ink, connectivity=4)[1])
    many = int(region.max()) + 1
    on = (region > 0) & (ink > 0)
    inked = np.unique(blot[on].astype(np.int64) * many + region[on])
    shared = np.bincount(inked // many, minlength=int(blot.max()) + 1) > 1
    if not shared.any():
        return np.zeros((0, 2))
    near = np.where(shared[blot], _nearest(region), 0)
    joins = np.zeros(region.shape, dtype=np.uint8)
    pairs: list[tuple[IntArray, IntArray, IntArray]] = []
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        v, u = np.nonzero((near[one] != near[two]) & (near[one] > 0) & (near[two] > 0))
        sides = np.sort([near[one][v, u], near[two][v, u]], axis=0)
        both = np.isin(blot[v, u].astype(np.int64) * many + sides, inked).all(axis=0)
        joins[v[both], u[both]] = 255
        pairs.append((u[both], v[both], (sides[0] * many + sides[1])[both]))
    u, v, pair = (np.concatenate(column) for column in zip(*pairs, strict=True))
    stretch = np.asarray(cv2.connectedComponents(joins)[1])[v, u]
    return _middles(
        u, v, np.unique(np.column_stack([stretch, pair]), axis=0, return_inverse=True)[1].ravel()
    )


def find_bare(ink: Pixels, region: IntArray) -> FloatArray:
    """(N, 2) px, a place in each region that has no ink at all."""
    bare = np.bincount(region[ink > 0], minlength=int(region.max()) + 1) == 0
    bare[0] = False
    v, u = np.nonzero(bare[region])
    return _middles(u, v, region[v, u])


def _nearest(region: IntArray) -> IntArray:
    """(H, W) the region that is nearest to each pixel."""
    outside = (region == 0).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(
        outside, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    of = np.zeros(int(label.max()) + 1, dtype=np.int64)
    inside = region > 0
    of[label[inside]] = region[inside]
    return of[label]


def _middles(u: IntArray, v: IntArray, own: IntArray) -> FloatArray:
    """(N, 2) of the pixels (u, v) of each kind `own` the one that is nearest to the middle of them."""
    order = np.argsort(own, kind="stable")
    pixels = np.column_stack([u, v])[order].astype(np.float64)
    groups = np.split(pixels, run_starts(own[order])[1:]) if len(own) else []
    found = [group[np.argmin(((group - group.mean(axis=0)) ** 2).sum(axis=1))] for group in groups]
    return np.array(found).reshape(-1, 2)


def find_merged(part: Part, field: Ground, of: IntArray) -> FloatArray:
    """(N, 2) px where contours of a drawing lie so near to each other that the grid, and the tool, make one of them.

    of: (L,) the region of each border. Contours that cross or touch are not kept apart by the artwork.
    """
    if part.raster is not None and part.raster.borders:
        return np.zeros((0, 2))
    chosen = [part.contours[k] for k in field.contour.tolist()]
    outer = np.flatnonzero(
        (find_nesting(from_contours(chosen), len(chosen)).depth % 2 == 0) & (of > 0)
    )
    several = np.flatnonzero(np.bincount(of[outer]) > 1)
    places = []
    for one in several.tolist():
        rings = [_ring(field, k) for k in outer[of[outer] == one].tolist()]
        for k, ring in enumerate(rings[1:], 1):
            gap = shapely.shortest_line(ring, shapely.union_all(rings[:k]))
            places += [shapely.get_coordinates(gap).mean(axis=0)] if gap.length > 0 else []
    return np.array(places).reshape(-1, 2)


def _ring(field: Ground, loop: int) -> shapely.LinearRing:
    points = field.edge.points[field.edge.table.loop == loop]
    return shapely.LinearRing(np.column_stack([points.real, points.imag]))


def find_lost(field: Ground, ink: Pixels, of: IntArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2) px of the borders too small to hold a pixel: those beside all ink, and those under that of others."""
    lost = [
        field.edge.points[field.edge.table.loop == k].mean()
        for k in np.flatnonzero(of == 0).tolist()
    ]
    places = np.array([(p.real, p.imag) for p in lost]).reshape(-1, 2)
    u, v = np.rint(places).astype(np.int64).T
    under = ink[v, u] > 0
    return places[~under], places[under]


def tell_joined(
    part: Part, field: Ground, ink: Pixels, region: IntArray, of: IntArray, diameter: float
) -> tuple[Note, ...]:
    """Notes on what `ink` joins and does not reach; --strict makes both an error. diameter: of the tool, mm."""
    beside, under = find_lost(field, ink, of)
    found = (
        [find_bridges(ink, region), find_merged(part, field, of), under],
        [find_bare(ink, region), beside],
    )
    bridges, bare = (field.placed(np.concatenate(places) @ np.array([1, 1j])) for places in found)
    tool = f"a {diameter:g} mm tool"
    notes = []
    if len(bridges):
        what = f"ink joins what the artwork keeps apart at {counted(len(bridges), 'place')}: {_told(bridges)}"
        why = f"{tool} leaves no gap there; take a narrower one, or draw them farther apart"
        notes.append(Note("warning", what, why, places=_listed(bridges), strict=True))
    if len(bare):
        what = f"{counted(len(bare), 'region')} not inked at all: {_told(bare)}"
        why = f"much smaller than {tool}; take a narrower one, or remove what is no part of the artwork"
        notes.append(Note("skipped", what, why, places=_listed(bare)))
    return tuple(notes)


def _listed(places: FloatArray) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in places.tolist())


def _told(places: FloatArray) -> str:
    told: Sequence[str] = [f"({short(x, 2)}, {short(y, 2)})" for x, y in places[:_TOLD].tolist()]
    more = f" and {len(places) - _TOLD} more" if len(places) > _TOLD else ""
    return f"{', '.join(told)} mm{more}"
