"""Finds the differences between a photo and the expected shape, with positions and sizes.

Blur rounds a tip and reduces its height: a wedge of 90 deg loses 0.77 of the blur's standard
deviation. The photo is blurred once more, which costs about half as much again. The loss of this
second blur corrects the height. A flat bump loses nothing either time.
"""

from __future__ import annotations

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.photo.expected import Expected
from camgen.model.pose import FloatArray

#: Fraction of the limit at which the foot of a difference is measured. The noise of an outline is
#: smaller.
FOOT = 1 / 3
#: Chords of a quarter circle in enlarged shapes.
_CHORDS = 16
#: Rounding: pieces up to this area, mm2, and gaps up to this width, mm, do not count.
_NO_AREA, _TOUCH = 1e-9, 1e-6
#: rad: minimum corner angle of a sharp corner of the drawing.
_SHARP = 0.3
#: Standard deviations of the blur around a sharp corner within which no height is corrected. There
#: the blur rounds both outlines.
_CORNER_BLURS = 3.0
#: Pixels per standard deviation in the picture of a tip, and half of its size in standard
#: deviations.
_FINE, _WINDOW = 6, 6
#: The correction of a height, as a multiple of the loss by the second blur. A wedge lost 2.3 times
#: as much by the first one; the outline of a round tip has part of it. At 0.14 mm/px a factor of 2
#: leaves less than 0.05 mm of both.
_CORRECTION = 2.0


class Difference(Struct, frozen=True, eq=False):
    """A place at which the photo has more or less than expected, in the frame of the drawing.

    surplus: whether it has more.
    place: position of the largest deviation, mm.
    height: largest distance from the expected outline, mm; half of the width of a missing shape or
        a filled gap.
    length: length along the outline, mm; of a separate island the length of the island.
    area: area, mm2.
    contour: name of the nearest contour.
    whole: whether it is separate from the outline: a surplus or missing island, or a surplus hole.
    shape: its polygon.
    kind: a name of `camgen.check.photo.kinds`.
    """

    surplus: bool
    place: tuple[float, float]
    height: float
    length: float
    area: float
    contour: str
    whole: bool
    shape: shapely.Geometry
    kind: str = ""


class _Compared(Struct, frozen=True, eq=False):
    """The shapes that are compared, mm.

    seen: polygons of the photo.
    expected: the expected shape.
    blur: standard deviation of the blur of the photo's outline, mm.
    corners: sharp corners of the expected region.
    """

    seen: shapely.Geometry
    expected: Expected
    blur: float
    corners: shapely.Geometry


def find_differences(
    seen: shapely.Geometry, expected: Expected, least: float, blur: float
) -> tuple[Difference, ...]:
    """Find the surplus and the missing pieces of `seen`, from `least` mm on, the largest first.

    blur: standard deviation of the blur of the photo's outline, mm.
    """
    region = expected.region
    both = _Compared(seen, expected, blur, _find_sharp_corners(region))
    differences = [_measure(piece, both, True) for piece in _find_pieces(seen, region, least)]
    differences += [_measure(piece, both, False) for piece in _find_pieces(region, seen, least)]
    listed = [each for each in differences if each.whole or each.height >= least]
    return tuple(sorted(listed, key=lambda each: (-each.height, each.place)))


def _find_sharp_corners(region: shapely.Geometry) -> shapely.Geometry:
    """Find the sharp corners of the outline of `region`."""
    corners = [np.zeros((0, 2))]
    for ring in shapely.get_parts(shapely.boundary(region)):
        points = shapely.get_coordinates(ring)[:-1] @ np.array([1, 1j])
        turn = np.angle((np.roll(points, -1) - points) / (points - np.roll(points, 1)))
        sharp = points[np.abs(turn) > _SHARP]
        corners.append(np.column_stack([sharp.real, sharp.imag]))
    return shapely.multipoints(np.concatenate(corners))


def _find_pieces(
    more: shapely.Geometry, less: shapely.Geometry, least: float
) -> list[shapely.Geometry]:
    """Find the pieces of `more` without `less`, from a third of `least` mm on.

    A piece must be farther than that outside of `less`, or deeper than that inside of `more`.
    Between two borders that are nearer than twice that to each other, only one of both is possible.
    """
    foot = least * FOOT
    difference = shapely.difference(more, less)
    pieces = []
    base = shapely.union(
        shapely.difference(more, shapely.buffer(less, foot, quad_segs=_CHORDS)),
        shapely.difference(shapely.buffer(more, -foot, quad_segs=_CHORDS), less),
    )
    for piece in shapely.get_parts(base):
        if piece.geom_type == "Polygon" and piece.area > _NO_AREA:
            around = shapely.buffer(piece, 1.5 * foot, quad_segs=_CHORDS)
            parts = shapely.get_parts(shapely.intersection(difference, around))
            pieces.append(shapely.union_all(parts[shapely.intersects(parts, piece)]))
    return pieces


def _measure(piece: shapely.Geometry, both: _Compared, surplus: bool) -> Difference:
    circle = shapely.maximum_inscribed_circle(piece, tolerance=1e-3)
    # The middle counts too: in a filled hole no point of the border is far from the outline.
    points = np.concatenate([shapely.get_coordinates(circle)[:1], shapely.get_coordinates(piece)])
    expected = both.expected
    edge = shapely.boundary(expected.region)
    distance = shapely.distance(shapely.points(points), edge)
    other = expected.region if surplus else both.seen
    whole = not shapely.intersects(piece, shapely.buffer(other, _TOUCH))
    if not surplus and not expected.inked:
        whole = whole or bool(shapely.distance(piece, edge) > _TOUCH)
    # The distance of a separate shape from the outline is not its size.
    top = 0 if whole else int(distance.argmax())
    place = shapely.points(points[top])
    lines = [shapely.LineString(np.concatenate([ring, ring[:1]])) for ring in expected.rings]
    nearest = int(np.argmin(shapely.distance(np.array(lines), place)))
    if whole or expected.inked:
        box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(piece))
        length = float(np.linalg.norm(np.diff(box[:3], axis=0), axis=1).max())
    else:
        length = _measure_along(points[1:], lines[nearest])
    height = float(circle.length) if whole else float(distance[top])
    if top and shapely.distance(place, both.corners) > _CORNER_BLURS * both.blur:
        height += _compute_lost_height(both, points[top], surplus)
    x, y = points[top].tolist()
    return Difference(
        surplus=surplus,
        place=(x, y),
        height=height,
        length=length,
        area=float(shapely.area(piece)),
        contour=expected.names[nearest],
        whole=whole,
        shape=piece,
    )


def _compute_lost_height(both: _Compared, tip: FloatArray, surplus: bool) -> float:
    """Compute the height that a tip (2,) of the photo's outline lost by blur, mm."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    if not both.blur:
        return 0.0
    pixel, half = both.blur / _FINE, _WINDOW * _FINE
    foot = shapely.shortest_line(shapely.boundary(both.expected.region), shapely.points(tip))
    outwards = np.diff(shapely.get_coordinates(foot), axis=0)[0]
    if not np.hypot(*outwards) > pixel:
        return 0.0
    # The tip is between four pixels: at the centre of one it would be neither inside nor outside.
    steps = (np.arange(-half, half) + 0.5) * pixel
    reach = 2 * half * pixel
    near = shapely.intersection(both.seen, shapely.box(*(tip - reach), *(tip + reach)))
    shapely.prepare(near)
    grid = shapely.contains_xy(near, *np.meshgrid(tip[0] + steps, tip[1] + steps))
    soft = cv2.GaussianBlur(grid.astype(np.float32), (0, 0), _FINE)
    far = np.linspace(-half / 2, half / 2, 8 * half)
    direction = outwards / np.hypot(*outwards)
    u, v = (direction[:, None] * far + (half - 0.5)).astype(np.float32)
    light = cv2.remap(soft, u[:, None], v[:, None], cv2.INTER_LINEAR).ravel()
    inside = np.flatnonzero(light > 0.5 if surplus else light < 0.5)
    if not len(inside) or inside[-1] + 1 == len(far):
        return 0.0
    k = int(inside[-1])
    lost = -float(far[k] + (far[k + 1] - far[k]) * (0.5 - light[k]) / (light[k + 1] - light[k]))
    return float(np.clip(_CORRECTION * lost * pixel, 0.0, both.blur))


def _measure_along(points: FloatArray, line: shapely.Geometry) -> float:
    """Measure the length of the closed `line` that the points (N, 2) are next to, mm."""
    at = np.sort(shapely.line_locate_point(line, shapely.points(points)))
    return float(line.length - np.append(np.diff(at), at[0] + line.length - at[-1]).max())
