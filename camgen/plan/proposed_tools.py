"""Chooses the tools of a proposal, from a library or new ones, with feeds and speeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from msgspec import Struct

from camgen.model.job import MaterialName, ToolRow, ToolTable
from camgen.model.materials import MATERIALS, Material, find_charts, recommend
from camgen.model.text import short

Kind = Literal["drill", "end mill"]

#: Diameters of usual end mills, mm.
_MILLS = (8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0, 0.8, 0.5)
#: Steps of the diameters of twist drills after DIN 338 and DIN 1899: largest diameter and step, mm.
_DRILL_STEPS = ((3.0, 0.05), (14.0, 0.1))
#: Step of the diameters of inch drills, mm: 1/64 inch.
_INCH_STEP_MM = 25.4 / 64
#: A standard drill may differ from its hole by this, mm.
_STANDARD_MM = 0.011
#: A drill of a library may be smaller than its hole by this, mm.
_SMALLER_MM = 0.02
#: Differences of diameters by rounding, mm.
_ROUNDING_MM = 1e-6
#: Highest speed of a small spindle, rpm.
_FASTEST = 10_000.0
#: Material whose feeds and speeds are placeholders. Only those of stainless steel are lower.
_UNKNOWN: MaterialName = "steel"


class ProposedTool(Struct, frozen=True):
    """A tool that the operations of a proposal use.

    row: row of `[[tools]]`; a tool of the library has only what the library does not say.
    comments: source of a value, by its key.
    """

    row: Mapping[str, object]
    comments: Mapping[str, str]


class ToolRack:
    """Collects the tools of a proposal.

    library: tools of the library.
    material: material that is cut, None if it is unknown.
    """

    def __init__(self, library: Sequence[ToolRow], material: Material | None) -> None:
        self.library = library
        self.material = material
        self._names: dict[tuple[str, float], str] = {}
        self._tools: dict[str, ProposedTool] = {}
        self._last_number = max((tool.number for tool in library), default=0)

    @property
    def tools(self) -> tuple[ProposedTool, ...]:
        """The tools for `[[tools]]` of the job, in the order in which they were taken."""
        return tuple(tool for tool in self._tools.values() if len(tool.row) > 1)

    @property
    def mills(self) -> tuple[float, ...]:
        """Diameters of the library's end mills, mm, or of usual ones, the largest first."""
        diameters = {tool.diameter for tool in self.library if tool.kind == "end mill"}
        return tuple(sorted(diameters, reverse=True)) or _MILLS

    @property
    def widest_mill(self) -> float:
        """The diameter of the widest mill that was taken, mm; 0 without any."""
        return max([size for kind, size in self._names if kind == "end mill"], default=0.0)

    def find_drill(self, hole: float) -> float | None:
        """The diameter of a drill for a hole, mm, from library or standard; None without one."""
        in_library = self._find_in_library("drill", hole)
        if in_library is not None:
            return in_library.diameter
        steps = [step for largest, step in _DRILL_STEPS if hole <= largest + _STANDARD_MM]
        sizes = [
            round(round(hole / step) * step, 4) for step in [*steps[:1], _INCH_STEP_MM] if steps
        ]
        near = [size for size in sizes if abs(size - hole) <= _STANDARD_MM and size > 0]
        return min(near, key=lambda size: abs(size - hole), default=None)

    def feed(self, name: str) -> float:
        """The feed of a tool that was taken, mm/s."""
        known = [tool.feed for tool in self.library if tool.name == name and tool.feed]
        return float(known[0] if known else str(self._tools[name].row["feed"]))

    def take(self, kind: Kind, diameter: float) -> str:
        """The name of a tool of this kind and diameter, mm. It is new if the library has none."""
        key = (kind, diameter)
        if key not in self._names:
            tool = self._find(kind, diameter)
            self._names[key] = tool.name
            self._tools[tool.name] = self._propose(tool)
        return self._names[key]

    def _find(self, kind: Kind, diameter: float) -> ToolRow:
        known = self._find_in_library(kind, diameter)
        if known is not None:
            return known
        self._last_number += 1
        name = f"{kind.removeprefix('end ')} {short(diameter, 3)}"
        if name in [tool.name for tool in self.library]:
            name = f"{name} ({self._last_number})"
        return ToolRow(name=name, number=self._last_number, kind=kind, diameter=diameter)

    def _find_in_library(self, kind: Kind, diameter: float) -> ToolRow | None:
        smaller = _SMALLER_MM if kind == "drill" else 0.0
        fitting = [
            tool
            for tool in self.library
            if tool.kind == kind
            and -_ROUNDING_MM <= diameter - tool.diameter <= smaller + _ROUNDING_MM
        ]
        return max(fitting, key=lambda tool: tool.diameter, default=None)

    def _propose(self, tool: ToolRow) -> ProposedTool:
        row: dict[str, object] = {"name": tool.name}
        if tool not in self.library:
            row |= {"number": tool.number, "kind": tool.kind, "diameter": tool.diameter}
        values, comments = _choose_cutting(tool, self.material)
        own_comments: dict[str, str] = {}
        for key, value in values.items():
            if getattr(tool, key) is None:
                row[key] = value
                own_comments[key] = comments[key]
        return ProposedTool(row, own_comments)


def _choose_cutting(
    tool: ToolTable, material: Material | None
) -> tuple[dict[str, float], dict[str, str]]:
    """Speed (rpm), feed and plunge (mm/s) of a tool, and comments on them by their keys.

    A comment names the chart of a value. Without a chart of the material the values are those of
    steel, as placeholders. A drill goes down at its feed and has no plunge.
    """
    cutting = recommend(material, tool, _FASTEST) if material else None
    lacking = ""
    if cutting is None:
        cutting = recommend(MATERIALS[_UNKNOWN], tool, _FASTEST)
        lacking = f"placeholder, that of {_UNKNOWN}"
        lacking += f": no chart of {material.name} for a {tool.kind}" if material else ""
    assert cutting is not None, f"{_UNKNOWN} has charts for all proposed tools"
    step = 10.0 if cutting.speed >= 100 else 1.0
    speed = math.floor(cutting.speed / step) * step
    share = speed / cutting.speed
    values = {"speed": speed, "feed": round(cutting.feed * share, 2)}
    if tool.kind != "drill":
        values["plunge"] = round(cutting.plunge * share, 2)
    comments = dict.fromkeys(values, lacking or cutting.source)
    if not lacking and material and find_charts(material, tool)[1] is None:
        comments["speed"] = f"the highest of a small spindle: no chart of {material.name} limits it"
    return values, comments
