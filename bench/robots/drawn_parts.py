"""Six kinds of parts as STEP files, with random sizes from a seed."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepFilletAPI import BRepFilletAPI_MakeFillet
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.Message import Message, Message_PrinterOStream
from OCP.ShapeUpgrade import ShapeUpgrade_UnifySameDomain
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TopAbs import TopAbs_EDGE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

#: Longest and shortest side of a part, mm.
_LONGEST, _SHORTEST = 240.0, 60.0
Shape = Any


def write_parts(folder: Path, seed: int) -> dict[str, Path]:
    """The STEP files of all six kinds, by their names."""
    Message.DefaultMessenger_s().RemovePrinters(Message_PrinterOStream.get_type_descriptor_s())
    files = {}
    for name, draw in KINDS.items():
        writer = STEPControl_Writer()
        writer.Transfer(draw(random.Random(f"{seed} {name}")), STEPControl_AsIs)
        files[name] = folder / f"{name}.step"
        writer.Write(str(files[name]))
    return files


def _box(*sides: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Shape:
    return BRepPrimAPI_MakeBox(gp_Pnt(*at), *sides).Shape()


def _cylinder(radius: float, height: float, at: tuple[float, float, float]) -> Shape:
    axes = gp_Ax2(gp_Pnt(*at), gp_Dir(0.0, 0.0, 1.0))
    return BRepPrimAPI_MakeCylinder(axes, radius, height).Shape()


def _cut(shape: Shape, tool: Shape) -> Shape:
    return BRepAlgoAPI_Cut(shape, tool).Shape()


def _join(shape: Shape, other: Shape) -> Shape:
    merged = ShapeUpgrade_UnifySameDomain(BRepAlgoAPI_Fuse(shape, other).Shape())
    merged.Build()
    return merged.Shape()


def _round_uprights(shape: Shape, radius: float) -> Shape:
    """Fillets at the upright edges of a box."""
    fillet = BRepFilletAPI_MakeFillet(shape)
    explorer = TopExp_Explorer(shape, TopAbs_EDGE)
    while explorer.More():
        edge = TopoDS.Edge(explorer.Current())
        if abs(BRepAdaptor_Curve(edge).Line().Direction().Z()) > 0.5:
            fillet.Add(radius, edge)
        explorer.Next()
    return fillet.Shape()


def _draw_block(pick: random.Random) -> Shape:
    long, wide, high = pick.uniform(120, _LONGEST), pick.uniform(80, 120), pick.uniform(40, 80)
    return _round_uprights(_box(long, wide, high), pick.uniform(8, 25))


def _draw_bracket(pick: random.Random) -> Shape:
    long, wide, high = pick.uniform(100, 200), pick.uniform(_SHORTEST, 100), pick.uniform(80, 150)
    thick = pick.uniform(8, 20)
    angle = _join(_box(long, wide, thick), _box(thick, wide, high))
    hole = _cylinder(wide / pick.uniform(4, 8), 2 * thick, (0.6 * long, wide / 2, -thick / 2))
    return _cut(angle, hole)


def _draw_plate(pick: random.Random) -> Shape:
    long, wide, high = pick.uniform(160, _LONGEST), pick.uniform(100, 150), pick.uniform(20, 40)
    plate = _box(long, wide, high)
    for k in range(3):
        side = long / 3 - pick.uniform(15, 30)
        depth = high * pick.uniform(0.3, 0.7)
        corner = (k * long / 3 + 8, pick.uniform(10, 25), high - depth)
        plate = _cut(plate, _box(side, wide - pick.uniform(50, 70), depth, at=corner))
    return plate


def _draw_hub(pick: random.Random) -> Shape:
    side, thick = pick.uniform(120, 180), pick.uniform(10, 20)
    middle, radius = side / 2, pick.uniform(25, 40)
    high = thick + pick.uniform(30, 60)
    part = _join(_box(side, side, thick), _cylinder(radius, high, (middle, middle, 0.0)))
    return _cut(part, _cylinder(radius / 2, 2 * high, (middle, middle, -high / 2)))


def _draw_sheet(pick: random.Random) -> Shape:
    long, wide, thick = pick.uniform(180, _LONGEST), pick.uniform(100, 160), pick.uniform(1.5, 3.0)
    sheet = _box(long, wide, thick)
    for k in range(3):
        place = (long * (k + 1) / 4, wide * pick.uniform(0.3, 0.7), -1.0)
        sheet = _cut(sheet, _cylinder(pick.uniform(8, 20), thick + 2, place))
    return sheet


def _draw_wheel_in_box(pick: random.Random) -> Shape:
    side, high, wall = pick.uniform(140, 200), pick.uniform(50, 80), pick.uniform(6, 12)
    inner = side - 2 * wall
    box = _cut(_box(side, side, high), _box(inner, inner, high, at=(wall, wall, wall)))
    wheel = _cylinder(inner * pick.uniform(0.25, 0.35), high * 0.5, (side / 2, side / 2, wall / 2))
    return _join(box, wheel)


#: The kinds, by their names.
KINDS: dict[str, Callable[[random.Random], Shape]] = {
    "block": _draw_block,
    "bracket": _draw_bracket,
    "plate": _draw_plate,
    "hub": _draw_hub,
    "sheet": _draw_sheet,
    "wheel in box": _draw_wheel_in_box,
}
