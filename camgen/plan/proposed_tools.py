"""Chooses the tools of a proposal, from a library or new ones, with feeds and speeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

from msgspec import Struct

from camgen.model.job import ToolRow, ToolTable
from camgen.model.materials import Material, find_charts, recommend
from camgen.model.text import short

Kind = Literal["drill", "end mill"]

#: Diameters of usual end mills, mm, in the order in which they are tried.
_MILLS = (6.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0)
#: A drill of a library may be smaller than its hole by this, mm.
_SMALLER_MM = 0.02
#: Differences of diameters by rounding, mm.
_ROUNDING_MM = 1e-6
#: Highest speed of a small spindle, rpm.
_FASTEST = 10_000.0
#: Cutting speeds that most metals, woods and plastics bear, m/min.
_CUTTING_SPEEDS = {"drill": 30.0, "end mill": 60.0}
#: Feed of a turn as a share of the diameter: of a drill, and of a mill with two teeth.
_FEEDS = {"drill": 0.02, "end mill": 0.01}


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
        self._last_number = max([0, *(tool.number for tool in library)])

    @property
    def tools(self) -> tuple[ProposedTool, ...]:
        """The tools for `[[tools]]` of the job, in the order in which they were taken."""
        return tuple(tool for tool in self._tools.values() if len(tool.row) > 1)

    @property
    def mills(self) -> tuple[float, ...]:
        """Diameters of end mills, mm, in the order in which they are tried.

        The library's, from the usual one to the smallest, then larger ones; usual ones without any.
        """
        diameters = {tool.diameter for tool in self.library if tool.kind == "end mill"}
        return tuple(sorted(diameters, key=lambda d: (d > _MILLS[0], -d))) or _MILLS

    def take(self, kind: Kind, diameter: float) -> str:
        """The name of a tool of this kind and diameter, mm. It is new if the library has none."""
        key = (kind, diameter)
        if key not in self._names:
            tool = self._find(kind, diameter)
            self._names[key] = tool.name
            self._tools[tool.name] = self._propose(tool)
        return self._names[key]

    def _find(self, kind: Kind, diameter: float) -> ToolRow:
        """The tool of the library that fits best, else a new one."""
        smaller = _SMALLER_MM if kind == "drill" else 0.0
        fitting = [
            tool
            for tool in self.library
            if tool.kind == kind
            and -_ROUNDING_MM <= diameter - tool.diameter <= smaller + _ROUNDING_MM
        ]
        if fitting:
            return max(fitting, key=lambda tool: tool.diameter)
        self._last_number += 1
        name = f"{kind.removeprefix('end ')} {short(diameter, 3)}"
        if name in [tool.name for tool in self.library]:
            name = f"{name} ({self._last_number})"
        return ToolRow(name=name, number=self._last_number, kind=kind, diameter=diameter)

    def _propose(self, tool: ToolRow) -> ProposedTool:
        """The row of a tool, with the feeds and speeds that the library does not state."""
        is_new = tool.name not in [known.name for known in self.library]
        row: dict[str, object] = {"name": tool.name}
        if is_new:
            row |= {"number": tool.number, "kind": tool.kind, "diameter": tool.diameter}
        values, comments = _choose_cutting(tool, self.material)
        missing = [key for key in values if getattr(tool, key) is None]
        row |= {key: values[key] for key in missing}
        return ProposedTool(row, {key: comments[key] for key in missing if key in comments})


def _choose_cutting(
    tool: ToolTable, material: Material | None
) -> tuple[dict[str, float], dict[str, str]]:
    """Speed (rpm), feed and plunge (mm/s) of a tool, and comments on them by their keys.

    A comment names the chart of a value. Values without a chart are placeholders. A drill goes down
    at its feed and has no plunge.
    """
    cutting = recommend(material, tool, _FASTEST) if material else None
    if material is None or cutting is None:
        values = _guess_cutting(tool)
        why = f"placeholder: no chart of {material.name} for a {tool.kind}" if material else ""
        return values, dict.fromkeys(values, why) if why else {}
    step = 10.0 if cutting.speed >= 100 else 1.0
    speed = math.floor(cutting.speed / step) * step
    share = speed / cutting.speed
    values = {"speed": speed, "feed": round(cutting.feed * share, 2)}
    if tool.kind != "drill":
        values["plunge"] = round(cutting.plunge * share, 2)
    comments = dict.fromkeys(values, cutting.source)
    if find_charts(material, tool)[1] is None:
        comments["speed"] = f"the highest of a small spindle: no chart of {material.name} limits it"
    return values, comments


def _guess_cutting(tool: ToolTable) -> dict[str, float]:
    """Speed (rpm) and feed (mm/s) that most materials bear."""
    turns = 1000 * _CUTTING_SPEEDS[tool.kind] / math.pi / tool.diameter
    speed = max(100.0, round(min(_FASTEST, tool.max_speed or _FASTEST, turns), -2))
    feed = speed * _FEEDS[tool.kind] * tool.diameter / 60
    return {"speed": speed, "feed": max(round(feed, 1), 0.1)}
