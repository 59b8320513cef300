"""The image-space planner on drawn masks: python -m bench.photo.image_space [PARTS, 20] [RUNS, 7]

A part with sharp and round corners, a notch, a slot and holes lies at random in the view. Points of the tool's path,
0.1 mm apart, are measured against the drawn outline (shapely); what is within 1 mm of where a sharp corner acts is told
apart. `ideal`: a pixel is part where its centre is. `photo`: the share of each pixel that the part covers, blurred by
0.7 px, with noise of sigma 2 on a contrast of 120, cut half-way.

Routes: `pixels`, the paper's whole pixels and the gradient of the distance image; `mask`, the iso-line found from the
mask alone; `border`, the iso-line around the drawn outline, as if the photo had told it without error.

Then the best seconds of RUNS at 10.5 megapixels (0: none), beside the OpenCV calls that are needed in any case, and
the peak memory.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
import shapely

from bench.machine import machine
from bench.render.shapes import Pieces, flatten, rounded
from bench.support.runner import Table, read_words
from bench.support.timing import best_seconds, peak_mb
from camgen.geometry.arcs import path_length
from camgen.model.job import Job, OperationTable, ProcessTable, ToolTable
from camgen.model.path import ToolPath
from camgen.plan.image_space import image_space

RADIUS = 3.0
SCALES = (0.143, 0.3)
#: mm: x, y and the radius of the corner, counter-clockwise; where the outline turns right is an inner corner.
OUTLINE = [
    (0, 0, 6), (30, 0, 0), (38, 12, 4), (46, 0, 0), (76, 0, 10), (76, 40, 0), (60, 40, 0), (60, 63, 3), (20, 63, 0),
    (20, 50, 4), (0, 50, 0),
]  # fmt: skip
SLOT = [(26, 26, 4.5), (44, 26, 4.5), (44, 35, 4.5), (26, 35, 4.5)]
HOLES = [(12, 14, 5.0), (63, 15, 8.0)]
MIDDLE = 38 + 31j
ROUTES = ("pixels", "mask", "border")


class Drawn(NamedTuple):
    """The loops (mm), the part, its lines for measuring, and the sharp corners with how far around they are felt."""

    loops: list[np.ndarray]
    polygon: shapely.Polygon
    tree: shapely.STRtree
    sharp: np.ndarray
    reach: np.ndarray


def main(count: int, runs: int) -> None:
    print(f"{machine()}, OpenCV {cv2.__version__}\n")
    accuracy(count)
    if runs:
        speed(runs)


def accuracy(count: int) -> None:
    print(f"Tool {2 * RADIUS:g} mm, {count} parts each;", end=" ")
    print("errors of the tool centre and of the force angle.")
    table = Table(
        "mask | mm/px {:g} | route | max mm {:.3f} | rms mm {:.4f} | max px {:.2f} | rms px {:.3f} "
        "| at sharp corners max mm {:.3f} | angle max deg {:.1f} | rms deg {:.2f} "
        "| waypoints/m {:.0f}"
    )
    for kind in ("ideal", "photo"):
        for scale in SCALES:
            rows: dict[str, list[tuple[np.ndarray, ...]]] = {route: [] for route in ROUTES}
            for seed in range(count):
                rng = np.random.default_rng(seed)
                part = drawn(rng.uniform(0, 2 * np.pi), complex(*rng.uniform(60, 61, 2)))
                pixels, view = rendered(part, scale, kind, rng)
                for route in ROUTES:
                    paths = planned(pixels, view, route, part)
                    rows[route].append(errors(paths, part))
            for route, found in rows.items():
                table.add(kind, scale, route, *measure(found, scale))


def measure(found: list[tuple[np.ndarray, ...]], scale: float) -> tuple[float, ...]:
    """The figures of a route."""
    away, near, angle, sizes = (np.concatenate(column) for column in zip(*found, strict=True))
    density = 1000 * sizes[0::2].sum() / sizes[1::2].sum()
    off = float(np.abs(away).max())
    path = off, rms(away), off / scale, rms(away) / scale, np.abs(near).max()
    return *path, np.abs(angle).max(), rms(angle), density


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def drawn_loop(corners: list[tuple[float, float, float]]) -> np.ndarray:
    """The outline with arcs in half degrees."""

    def count(whole: Pieces) -> np.ndarray:
        half_degrees = (np.degrees(np.abs(whole.sweep)) * 2).astype(int)
        return np.where(whole.sweep == 0, 1, np.maximum(half_degrees - 1, 1))

    return flatten(rounded(corners), count)


def drawn(turn: float, place: complex) -> Drawn:
    """The part turned by ``turn`` rad, its middle at ``place``."""
    circle = np.exp(2j * np.pi * np.arange(720) / 720)
    at = np.array([complex(x, y) for x, y, _ in OUTLINE])
    loops = [
        drawn_loop(OUTLINE),
        drawn_loop(SLOT),
        *(complex(x, y) + r * circle for x, y, r in HOLES),
        at,
    ]
    *loops, at = [(loop - MIDDLE) * np.exp(1j * turn) + place for loop in loops]
    rings = [np.column_stack([loop.real, loop.imag]) for loop in loops]
    lines = [
        shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)) for ring in rings
    ]
    inner = np.angle((np.roll(at, -1) - at) / (at - np.roll(at, 1))) < 0
    sharp = np.array([radius == 0 for _, _, radius in OUTLINE])
    # The path bends where it is a radius from both sides of a square inner corner, and rolls about an outer one.
    reach = np.where(inner, RADIUS * np.sqrt(2), RADIUS) + 1.0
    tree = shapely.STRtree(np.concatenate(lines))
    return Drawn(loops, shapely.Polygon(rings[0], rings[1:]), tree, at[sharp], reach[sharp])


def rendered(
    part: Drawn, scale: float, kind: str, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The mask of 120 x 120 mm, y up, and work_from_view."""
    size = round(120 / scale)
    view = np.array([[scale, 0.0, 0.0], [0.0, -scale, scale * (size - 1)]])
    loops = [np.rint(in_view(loop, view) * 256).astype(np.int32) for loop in part.loops]
    inside = cv2.fillPoly(np.zeros((size, size), np.uint8), loops, 255, shift=8) > 0
    rim = cv2.polylines(np.zeros((size, size), np.uint8), loops, True, 255, 5, shift=8)
    v, u = np.nonzero(rim)
    shares = (np.arange(4) - 1.5) / 4 if kind == "photo" else np.zeros(1)
    covered = np.zeros(len(u))
    shapely.prepare(part.polygon)
    for down in shares:
        for right in shares:
            x, y = scale * (u + right), scale * (size - 1 - v - down)
            covered += shapely.contains_xy(part.polygon, x, y)
    grey = inside.astype(np.float32)
    grey[v, u] = covered / len(shares) ** 2
    if kind == "photo":
        grey = cv2.GaussianBlur(grey, (0, 0), 0.7) + rng.normal(0, 2 / 120, grey.shape).astype(
            np.float32
        )
    return np.where(grey > 0.5, 255, 0).astype(np.uint8), view


def in_view(loop: np.ndarray, view: np.ndarray) -> np.ndarray:
    scale = view[0, 0]
    return np.column_stack([loop.real / scale, (view[1, 2] - loop.imag) / scale])


def planned(pixels: np.ndarray, view: np.ndarray, route: str, part: Drawn) -> tuple[ToolPath, ...]:
    job = Job(tool=ToolTable(diameter=2 * RADIUS), process=ProcessTable(feed=5.0, force=2.0))
    borders = [in_view(loop, view) for loop in part.loops] if route == "border" else None
    paths, _ = image_space(pixels, view, job, exact=route != "pixels", borders=borders)
    assert len(paths) == len(part.loops), f"{len(paths)} paths beside {len(part.loops)} loops"
    return paths


def errors(paths: tuple[ToolPath, ...], part: Drawn) -> tuple[np.ndarray, ...]:
    """Away from sharp corners and near them: distance of points along the path less the tool's radius, mm; of the
    force angle, deg, at waypoints away from them; number of waypoints and length of each path.
    """
    away, near, angles, sizes = [], [], [], []
    for path in paths:
        at = path.position[:, 0] + 1j * path.position[:, 1]
        steps = np.maximum(np.ceil(np.abs(np.diff(at)) / 0.1).astype(int), 1)
        points = np.concatenate(
            [np.linspace(a, b, n + 1) for a, b, n in zip(at[:-1], at[1:], steps, strict=True)]
        )
        gap = measured(points, part)[0] - RADIUS
        felt = feeling(points, part)
        away.append(gap[~felt])
        near.append(gap[felt])
        _, foot = measured(at[1:], part)
        press = path.force_direction[1:, 1, 0] + 1j * path.force_direction[1:, 1, 1]
        angle = np.degrees(np.angle(press / (foot - at[1:])))
        angles.append(angle[~feeling(at[1:], part)])
        sizes.append([len(at) - 1.0, path_length(path)])
    return np.concatenate(away), np.concatenate(near), np.concatenate(angles), np.concatenate(sizes)


def measured(points: np.ndarray, part: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """The distance from each point to the outline, mm, and the nearest point of it."""
    places = shapely.points(points.real, points.imag)
    lines = part.tree.geometries[part.tree.nearest(places)]
    foot = shapely.line_interpolate_point(lines, shapely.line_locate_point(lines, places))
    return shapely.distance(places, lines), shapely.get_x(foot) + 1j * shapely.get_y(foot)


def feeling(points: np.ndarray, part: Drawn) -> np.ndarray:
    return (np.abs(points[:, None] - part.sharp) < part.reach).any(axis=1)


def speed(runs: int) -> None:
    """A plate of 3400 x 2400 px with 40 holes in a view of 3840 x 2748."""
    loops = [np.exp(2j * np.pi * np.arange(720) / 720) * 50 + complex(400 * i + 700, 400 * j + 500) for i in range(7)
             for j in range(5)]  # fmt: skip
    rings = [
        np.rint(np.column_stack([loop.real, loop.imag]) * 256).astype(np.int32) for loop in loops
    ]
    pixels = np.zeros((2748, 3840), np.uint8)
    pixels[150:2600, 200:3650] = 255
    cv2.fillPoly(pixels, rings, 0, shift=8)
    view = np.array([[0.143, 0.0, 0.0], [0.0, -0.143, 0.0]])
    tool = ToolTable(diameter=2 * RADIUS)
    jobs = {
        "": Job(tool=tool),
        ", corner radius 2": Job(tool=tool, operation=OperationTable(corner_radius=2.0)),
    }
    table = Table(f"10.5 megapixels, 36 paths | best of {runs}, s {{:.3f}}")
    opencv = "cv2.distanceTransform and cv2.findContours alone"
    table.add(opencv, best_seconds(partial(bare, pixels), runs))
    before = peak_mb()
    for name, exact in (("pixels", False), ("mask", True)):
        for corners, job in jobs.items():
            plan = partial(image_space, pixels, view, job, exact=exact)
            table.add(f"route {name}{corners}", best_seconds(plan, runs))
    print(f"\nPeak memory {peak_mb():.0f} MB, of which {before:.0f} MB before the planner ran")


def bare(pixels: np.ndarray) -> None:
    far = cv2.distanceTransform(cv2.bitwise_not(pixels), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cv2.findContours(
        cv2.compare(far, RADIUS / 0.143, cv2.CMP_LE), cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE
    )


if __name__ == "__main__":
    main(*read_words(20, 7))
