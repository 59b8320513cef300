"""Feeds and cutting speeds that materials bear, from published charts.

Figures stand in the units of their charts, inch and surface feet per minute, so that they can be
compared with them. A material without a published chart has no row.

Sources:

- HIT: HIT Tooling, "HIT Tooling Parameter Sheet": solid carbide end mills, carbide and HSS drills.
- Schultz: G.W. Schultz Tool, "Speeds and Feeds for Carbide End Mill Cutting Tools".
- AST: AST Tooling, "Recommended Feeds & Speeds for Solid Carbide Router Bits".
- Cutter Shop: "Chip Load Chart".
- HSS: "Machine Tool Speeds and Feeds", table of speeds for high-speed steel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import Struct

from camgen.model.job import MaterialName, ToolTable

#: mm of an inch, and m of a foot.
INCH_MM, FOOT_M = 25.4, 0.3048

_HIT = "HIT Tooling Parameter Sheet"
_SCHULTZ = "G.W. Schultz, Speeds and Feeds"
_AST = "AST Tooling, Speeds and Feeds"
_CUTTER_SHOP = "Cutter Shop, Chip Load Chart"
_HSS = "Machine Tool Speeds and Feeds, HSS"


class Chart(Struct, frozen=True):
    """Feeds of a tooth of a mill, or of a turn of a drill, by the diameter of the tool.

    source: published chart.
    diameters: inch, from small to large.
    low, high: recommended feeds at these diameters, inch.
    """

    source: str
    diameters: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]

    def lowest(self, diameter: float) -> float:
        """The smallest recommended feed of a tool of this diameter; both mm."""
        return self._read(self.low, diameter)

    def highest(self, diameter: float) -> float:
        """The largest recommended feed of a tool of this diameter; both mm."""
        return self._read(self.high, diameter)

    def _read(self, feeds: Sequence[float], diameter: float) -> float:
        """The feed for a diameter, mm: linear between diameters, and from 0 to the first.

        Tools wider than the last diameter have its feed.
        """
        table = np.multiply((0.0, *self.diameters), INCH_MM)
        return float(np.interp(diameter, table, (0.0, *feeds))) * INCH_MM


class Speeds(Struct, frozen=True):
    """Recommended cutting speeds.

    source: published chart.
    low, high: surface feet per minute.
    """

    source: str
    low: float
    high: float

    def turns(self, diameter: float) -> tuple[float, float]:
        """The lowest and the highest speed of the spindle, rpm, for a diameter, mm."""
        around = math.pi * diameter / 1000
        return self.low * FOOT_M / around, self.high * FOOT_M / around


#: "mill" or "drill", and the material of the cutting edges.
Key = tuple[str, str]


class Material(Struct, frozen=True):
    """Feeds and speeds for a material.

    name: name in the job.
    feeds: feeds by the tool and the material of its edges.
    speeds: cutting speeds by the same.
    passes: largest depth of a pass of a mill, in diameters.
    """

    name: MaterialName
    feeds: Mapping[Key, Chart]
    speeds: Mapping[Key, Speeds]
    passes: float


_EIGHTHS = (1 / 8, 1 / 4, 3 / 8, 1 / 2)
_MILLS = (1 / 8, 3 / 16, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1.0)
_DRILLS = (1 / 8, 3 / 16, 1 / 4, 3 / 8, 1 / 2)
_STEEL = Chart(
    _HIT,
    _MILLS,
    (0.0004, 0.0006, 0.0008, 0.0015, 0.0018, 0.0025, 0.0035),
    (0.0011, 0.0020, 0.0028, 0.0040, 0.0055, 0.0080, 0.0110),
)
_STAINLESS = Chart(
    _HIT,
    _MILLS,
    (0.0003, 0.0004, 0.0006, 0.0010, 0.0010, 0.0018, 0.0020),
    (0.0007, 0.0010, 0.0012, 0.0020, 0.0030, 0.0040, 0.0055),
)
_ALUMINIUM = Chart(
    _HIT,
    _MILLS,
    (0.0005, 0.0008, 0.0010, 0.0015, 0.0020, 0.0030, 0.0040),
    (0.0012, 0.0018, 0.0022, 0.0035, 0.0045, 0.0070, 0.0090),
)


def _drill(feeds: tuple[float, ...]) -> Chart:
    """The feeds of a turn of drills, of which the chart has one value."""
    return Chart(_HIT, _DRILLS, feeds, feeds)


def _metal(
    name: MaterialName,
    mill: Chart,
    carbide: Speeds,
    hss: Speeds,
    drills: Mapping[str, tuple[Chart, Speeds]],
) -> Material:
    """A metal, in which a pass is as deep as the mill is wide at most."""
    feeds = {("mill", "carbide"): mill, ("mill", "hss"): mill}
    speeds = {("mill", "carbide"): carbide, ("mill", "hss"): hss}
    for edge, (feed, speed) in drills.items():
        feeds["drill", edge] = feed
        speeds["drill", edge] = speed
    return Material(name, feeds, speeds, 1.0)


def _sheet(name: MaterialName, mill: Chart, speed: Speeds | None = None) -> Material:
    """A wood or plastic, in which a pass is three diameters deep at most.

    No chart limits the speed of woods.
    """
    keys = [("mill", "carbide"), ("mill", "hss")]
    feeds = dict.fromkeys(keys, mill)
    return Material(name, feeds, {} if speed is None else dict.fromkeys(keys, speed), 3.0)


#: The materials, by the names in the job.
MATERIALS: Mapping[str, Material] = {
    material.name: material
    for material in (
        _metal(
            "aluminium",
            _ALUMINIUM,
            Speeds(_HIT, 800, 2200),
            Speeds(_HSS, 250, 500),
            {"hss": (_drill((0.004, 0.005, 0.006, 0.0087, 0.0087)), Speeds(_HIT, 300, 300))},
        ),
        _metal(
            "brass",
            Chart(
                _SCHULTZ,
                (1 / 8, 1 / 4, 1 / 2, 3 / 4),
                (0.001, 0.002, 0.003, 0.004),
                (0.001, 0.002, 0.003, 0.004),
            ),
            Speeds(_SCHULTZ, 400, 700),
            Speeds(_HSS, 150, 450),
            {},
        ),
        _metal(
            "steel",
            _STEEL,
            Speeds(_HIT, 400, 450),
            Speeds(_HSS, 70, 120),
            {
                "hss": (_drill((0.004, 0.006, 0.006, 0.0087, 0.0087)), Speeds(_HIT, 125, 125)),
                "carbide": (_drill((0.005, 0.005, 0.006, 0.009, 0.011)), Speeds(_HIT, 290, 290)),
            },
        ),
        _metal(
            "stainless steel",
            _STAINLESS,
            Speeds(_HIT, 175, 250),
            Speeds(_HSS, 30, 60),
            {
                "hss": (_drill((0.003, 0.004, 0.005, 0.007, 0.008)), Speeds(_HIT, 70, 70)),
                "carbide": (_drill((0.002, 0.002, 0.002, 0.004, 0.005)), Speeds(_HIT, 200, 200)),
            },
        ),
        _sheet(
            "acrylic",
            Chart(
                _CUTTER_SHOP,
                _EIGHTHS,
                (0.003, 0.008, 0.010, 0.012),
                (0.005, 0.010, 0.012, 0.015),
            ),
            Speeds(_SCHULTZ, 800, 1600),
        ),
        _sheet(
            "plywood",
            Chart(_AST, _EIGHTHS, (0.003, 0.006, 0.015, 0.018), (0.005, 0.009, 0.018, 0.021)),
        ),
        _sheet(
            "mdf",
            Chart(_AST, _EIGHTHS, (0.004, 0.012, 0.017, 0.020), (0.007, 0.015, 0.019, 0.025)),
        ),
        _sheet(
            "hardwood",
            Chart(_AST, _EIGHTHS, (0.002, 0.005, 0.013, 0.017), (0.004, 0.007, 0.015, 0.019)),
        ),
        _sheet(
            "softwood",
            Chart(_AST, _EIGHTHS, (0.003, 0.006, 0.015, 0.019), (0.005, 0.008, 0.017, 0.021)),
        ),
    )
}


#: The charts for kinds of tools.
_KINDS = {
    "drill": "drill",
    "end mill": "mill",
    "ball mill": "mill",
    "bull nose": "mill",
    "v": "mill",
}


class Cutting(Struct, frozen=True):
    """How a tool should cut.

    speed: speed of the spindle, rpm.
    feed: feed, mm/s.
    plunge: feed of going down, mm/s.
    source: charts of these figures.
    """

    speed: float
    feed: float
    plunge: float
    source: str


def find_charts(material: Material, tool: ToolTable) -> tuple[Chart | None, Speeds | None]:
    """The chart of feeds and the cutting speeds for a tool; None if the material has none."""
    key = (_KINDS.get(tool.kind, ""), tool.edges)
    return material.feeds.get(key), material.speeds.get(key)


def recommend(material: Material, tool: ToolTable, fastest: float) -> Cutting | None:
    """Feeds and speed for a tool, at the lower end of the charts; None without a chart of feeds.

    fastest: highest speed of the spindle, rpm. A material without a cutting speed gets it.

    A drill goes down at its feed, a mill at a third of it.
    """
    chart, speeds = find_charts(material, tool)
    if chart is None:
        return None
    fastest = min(fastest, tool.max_speed or fastest)
    speed, source = fastest, chart.source
    if speeds is not None:
        speed = min(fastest, speeds.turns(tool.diameter)[0])
        source = " and ".join(dict.fromkeys((chart.source, speeds.source)))
    is_drill = tool.kind == "drill"
    feed = chart.lowest(tool.diameter) * (1 if is_drill else tool.flutes) * speed / 60
    return Cutting(speed, feed, feed if is_drill else feed / 3, source)
