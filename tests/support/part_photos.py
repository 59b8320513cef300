"""Rendered photos of flat parts from right above, and their drawings."""

from collections.abc import Sequence
from pathlib import Path

import ezdxf
import numpy as np

from bench.render.optics import shoot_from_above
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop, circle, hole, rounded
from camgen.model.part import Contour, Part

PIXEL = 0.14
#: Pixels of the pictures, and the middle of what they show, mm from the lower left corner.
WIDE, HIGH = 700, 560
MIDDLE = complex(WIDE, HIGH) / 2 * PIXEL
#: The plate of the tests: 60 x 40 mm with a hole, its middle at the origin.
PLATE = (rounded([(-30, -20, 0), (30, -20, 6), (30, 20, 0), (-30, 20, 0)]), hole(circle(-12, 4, 7)))


def photo(
    file: Path,
    loops: Sequence[Loop],
    turn: float = 0.0,
    ink: float = 0.15,
    at: complex = 0j,
    size: tuple[int, int] = (WIDE, HIGH),
) -> Path:
    """A dark part on a light bench.

    turn: rad, about the origin of the part.
    at: place of the origin from the middle of the picture, mm.
    size: pixels of the picture.
    """
    light = {"exposure": 0.9, "gradient": (0.1, -0.1)}
    shot = shoot_from_above(size, PIXEL, blur=0.7, read=1.6, shot=0.01, seed=3, **light)
    layer = Layer(tuple(loop.moved(turn, at) for loop in loops), ink, texture=0.02)
    write_photo(file, render(Scene(0.7, (layer,), texture=0.02), shot))
    return file


def drawing(loops: Sequence[Loop]) -> Part:
    contours = [
        Contour(
            np.column_stack([loop.points.real, loop.points.imag]), loop.bulges, True, "0", f"c{k}"
        )
        for k, loop in enumerate(loops, 1)
    ]
    return Part("plate", "plate.dxf", "mm", tuple(contours), ())


def write_dxf(file: Path, loops: Sequence[Loop], layers: Sequence[str] = ()) -> Path:
    """The loops as a drawing in mm, each on its layer, by default on 0."""
    document = ezdxf.new("R2010", units=4)
    for number, loop in enumerate(loops):
        rows = [(z.real, z.imag, bulge) for z, bulge in zip(loop.points, loop.bulges, strict=True)]
        look = {"layer": layers[number]} if layers else {}
        document.modelspace().add_lwpolyline(rows, format="xyb", close=True, dxfattribs=look)
    document.saveas(file)
    return file


def bumped(loop: Loop, side: int, at: float, width: float, height: float) -> Loop:
    """A bump, or a dent if ``height`` is below 0, on the straight piece ``side`` of an outer loop.

    at, width: its foot, mm from the start of the piece.
    """
    start, end = loop.points[side], loop.points[(side + 1) % len(loop.points)]
    along = (end - start) / abs(end - start)
    foot = start + along * at
    points = np.concatenate(
        [loop.points[: side + 1], [foot, foot + along * width], loop.points[side + 1 :]]
    )
    bulges = np.concatenate(
        [loop.bulges[: side + 1], [2 * height / width, 0.0], loop.bulges[side + 1 :]]
    )
    return Loop(points, bulges)


def mirrored(loop: Loop) -> Loop:
    """The loop seen from the other side, run so that its material is on the left."""
    return Loop(-loop.points[::-1].conj(), np.roll(loop.bulges[::-1], -1))
