"""Where what is seen and what is expected differ by more than a limit: places, lengths, heights.

Blur rounds a tip and takes from its height: a wedge of 90 deg loses 0.77 of the blur's standard deviation. What is seen
is blurred once more, and loses about half as much again: from that follows by how much the height is put right. A flat
bump loses nothing either time.
"""

from __future__ import annotations

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.photo.expected import Expected
from camgen.model.pose import FloatArray

#: The foot of a difference: where it is a third of the limit, which the noise of an outline is not.
FOOT = 1 / 3
#: Round corners of what is grown by a length: chords of a quarter circle.
_CHORDS = 16
#: Pieces smaller than this (mm2) are rounding; so are gaps of this, mm.
_NOTHING, _TOUCH = 1e-9, 1e-6
#: A corner of the drawing turns by more than this, rad. There blur rounds both, so that nothing is put right within so
#: many times the blur.
_SHARP, _CORNER_BLURS = 0.3, 3.0
#: Pixels of the blur, which is so many wide each way where a tip is looked at.
_FINE, _WINDOW = 6, 6
#: So many times what is lost by blurring again is put right: what a wedge lost is 2.3 times that, of a round tip the
#: outline has it already in part. At 0.14 mm/px twice leaves less than 0.05 mm of both.
_PUT_RIGHT = 2.0


class Difference(Struct, frozen=True, eq=False):
    """A place where there is too much (``much``) or too little. All mm, in the frame of the drawing.

    place: where it is greatest. height: how far it stands out of, or reaches into, what is expected; where all of it is
    missing, or a gap is filled, half of that width. length: along the outline; of an island by itself, its own. area:
    mm2. contour: the nearest. whole: it lies apart from the outline, an island too much or missing, or a hole too much.
    shape: its polygon. kind: one of camgen.check.photo.kinds.
    """

    much: bool
    place: tuple[float, float]
    height: float
    length: float
    area: float
    contour: str
    whole: bool
    shape: shapely.Geometry
    kind: str = ""


class _Compared(Struct, frozen=True, eq=False):
    """What is compared, mm. blur: of the outline seen, a standard deviation. corners: (N, 2) of the expected region."""

    seen: shapely.Geometry
    expected: Expected
    blur: float
    corners: shapely.Geometry


def differ(
    seen: shapely.Geometry, expected: Expected, least: float, blur: float
) -> tuple[Difference, ...]:
    """What is too much of ``seen`` and what is missing, from ``least`` mm on, the greatest first.

    blur: of the outline seen, mm, a standard deviation.
    """
    region = expected.region
    both = _Compared(seen, expected, blur, _corners(region))
    found = [_tell(piece, both, True) for piece in _beyond(seen, region, least)]
    found += [_tell(piece, both, False) for piece in _beyond(region, seen, least)]
    told = [one for one in found if one.whole or one.height >= least]
    return tuple(sorted(told, key=lambda one: (-one.height, one.place)))


def _corners(region: shapely.Geometry) -> shapely.Geometry:
    """The sharp corners of the outline of ``region``."""
    corners = [np.zeros((0, 2))]
    for ring in shapely.get_parts(shapely.boundary(region)):
        points = shapely.get_coordinates(ring)[:-1] @ np.array([1, 1j])
        turn = np.angle((np.roll(points, -1) - points) / (points - np.roll(points, 1)))
        sharp = points[np.abs(turn) > _SHARP]
        corners.append(np.column_stack([sharp.real, sharp.imag]))
    return shapely.multipoints(np.concatenate(corners))


def _beyond(more: shapely.Geometry, less: shapely.Geometry, least: float) -> list[shapely.Geometry]:
    """The pieces of ``more`` without ``less`` from a third of ``least`` (mm) on.

    What lies farther than that outside of the one or deeper than that inside of the other is a difference: between two
    borders nearer than twice that to each other only one of the two can be.
    """
    foot = least * FOOT
    gone = shapely.difference(more, less)
    pieces = []
    base = shapely.union(
        shapely.difference(more, shapely.buffer(less, foot, quad_segs=_CHORDS)),
        shapely.difference(shapely.buffer(more, -foot, quad_segs=_CHORDS), less),
    )
    for piece in shapely.get_parts(base):
        if piece.geom_type == "Polygon" and piece.area > _NOTHING:
            whole = shapely.intersection(gone, shapely.buffer(piece, 1.5 * foot, quad_segs=_CHORDS))
            pieces.append(
                shapely.union_all(
                    [part for part in shapely.get_parts(whole) if part.intersects(piece)]
                )
            )
    return pieces


def _tell(piece: shapely.Geometry, both: _Compared, much: bool) -> Difference:
    # With the middle of it: of a hole that is filled no point of the border is far from what is expected.
    middle, radius = _middle(piece)
    points = np.concatenate([middle, shapely.get_coordinates(piece)])
    expected = both.expected
    edge = shapely.boundary(expected.region)
    off = shapely.distance(shapely.points(points), edge)
    whole = not shapely.intersects(
        piece, shapely.buffer(expected.region if much else both.seen, _TOUCH)
    )
    if not much and not expected.inked:
        whole = whole or bool(shapely.distance(piece, edge) > _TOUCH)
    # How far something lies from the outline is not its size.
    top = 0 if whole else int(off.argmax())
    place = shapely.points(points[top])
    lines = [shapely.LineString(np.concatenate([ring, ring[:1]])) for ring in expected.rings]
    nearest = int(np.argmin(shapely.distance(np.array(lines), place)))
    length = (
        _own_length(piece)
        if whole or expected.inked
        else _along(points[1:], expected.rings[nearest])
    )
    height = radius if whole else float(off[top])
    if top and shapely.distance(place, both.corners) > _CORNER_BLURS * both.blur:
        height += _lost(both, points[top], much)
    x, y = points[top].tolist()
    return Difference(
        much,
        (x, y),
        height,
        length,
        float(shapely.area(piece)),
        expected.names[nearest],
        whole,
        piece,
    )


def _lost(both: _Compared, tip: FloatArray, much: bool) -> float:
    """What blur took from the height of a tip (2,) of the outline seen, mm."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    if not both.blur:
        return 0.0
    pixel, half = both.blur / _FINE, _WINDOW * _FINE
    foot = shapely.shortest_line(shapely.boundary(both.expected.region), shapely.points(tip))
    way = np.diff(shapely.get_coordinates(foot), axis=0)[0]
    if not np.hypot(*way) > pixel:
        return 0.0
    # The tip lies between four pixels: on the centre of one it would be neither inside nor outside.
    steps = (np.arange(-half, half) + 0.5) * pixel
    reach = 2 * half * pixel
    near = shapely.intersection(both.seen, shapely.box(*(tip - reach), *(tip + reach)))
    shapely.prepare(near)
    grid = shapely.contains_xy(near, *np.meshgrid(tip[0] + steps, tip[1] + steps))
    soft = cv2.GaussianBlur(grid.astype(np.float32), (0, 0), _FINE)
    far = np.linspace(-half / 2, half / 2, 8 * half)
    u, v = ((way / np.hypot(*way))[:, None] * far + (half - 0.5)).astype(np.float32)
    light = cv2.remap(soft, u[:, None], v[:, None], cv2.INTER_LINEAR).ravel()
    inside = np.flatnonzero(light > 0.5 if much else light < 0.5)
    if not len(inside) or inside[-1] + 1 == len(far):
        return 0.0
    k = int(inside[-1])
    gone = -float(far[k] + (far[k + 1] - far[k]) * (0.5 - light[k]) / (light[k + 1] - light[k]))
    return float(np.clip(_PUT_RIGHT * gone * pixel, 0.0, both.blur))


def _middle(piece: shapely.Geometry) -> tuple[FloatArray, float]:
    """The centre (1, 2) and the radius of the greatest circle in it."""
    circle = shapely.maximum_inscribed_circle(piece, tolerance=1e-3)
    return np.asarray(shapely.get_coordinates(circle)[:1]), float(circle.length)


def _own_length(piece: shapely.Geometry) -> float:
    """The longer side of the least rectangle around it."""
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(piece))
    return float(np.linalg.norm(np.diff(ring[:3], axis=0), axis=1).max())


def _along(points: FloatArray, ring: FloatArray) -> float:
    """How much of the closed ``ring`` (N, 2) the points lie beside."""
    line = shapely.LineString(np.concatenate([ring, ring[:1]]))
    at = np.sort(shapely.line_locate_point(line, shapely.points(points)))
    gaps = np.append(np.diff(at), at[0] + line.length - at[-1])
    return float(line.length - gaps.max())
