"""The set-up of a program: depths, passes, feeds and speeds against the stock and the tools.

Each rule compares the motions of the text with a limit that has a source: a key of the job or a
published chart. The rules judge plausibility. A breach damages a tool or the board beneath, but
not the part's shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.stock.clear import SweptAreas, find_in_own_hole
from camgen.check.stock.design import Design
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves
from camgen.check.stock.spindle import Running, turns
from camgen.geometry.intersect import measure_distances
from camgen.geometry.segments import IntArray, points_at
from camgen.model.job import StockTable, ToolTable
from camgen.model.materials import MATERIALS, Material, find_charts
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.text import short

#: A value above its limit by this factor exceeds it: texts are printed in digits.
_NEARLY = 1.01
#: Larger values have no decimals.
_WHOLE = 1000.0
#: A spindle that is only switched on has this speed in a text.
_SWITCHED_ON = 1.0
#: Whole angle at the tip of a drill, deg.
_DRILL_ANGLE = 118.0
#: Depth of a pass without a material, in diameters.
_PASSES = max(material.passes for material in MATERIALS.values())
#: Pairs of a point and a motion that are measured at once.
_PAIRS = 200_000
_TINY = 1e-12
#: Remedy for a text that says something else than its job.
_BY_JOB = "the text was edited, or the job"
#: Mills that need not cut over their centre.
_FLAT_MILLS = ("end mill", "bull nose")


class Breach(Struct, frozen=True):
    """A limit that a tool exceeds.

    line: line of the first motion that exceeds it, from 1.
    file: name of the text.
    place: end of that motion, mm.
    what: the largest value and the limit in words.
    remedy: source of the limit, and the keys to set.
    """

    line: int
    file: str
    place: Vec3
    what: str
    remedy: str


class SetUp(Struct, frozen=True):
    """The examined limits.

    breaches: limits that are exceeded, in order of cut.
    examined: names of the examined properties.
    unexamined: names of the others, each with the key that is not set.
    """

    breaches: tuple[Breach, ...]
    examined: tuple[str, ...]
    unexamined: tuple[str, ...]


class _Case(NamedTuple):
    """One tool.

    tool: the tool.
    gone: material taken by all cuts.
    design: permissions of the drawing.
    rows: (K,) rows in `gone` of this tool's motions at feed in material, except motions back into
        a hole.
    stock: stock of the job.
    running: motions of each cut with this tool, by its number.
    """

    tool: ToolTable
    gone: SweptAreas
    design: Design
    rows: IntArray
    stock: StockTable
    running: dict[int, Running]

    @property
    def material(self) -> Material | None:
        """The material of the stock, None if the job does not state it."""
        return MATERIALS[self.stock.material] if self.stock.material else None

    @property
    def name(self) -> str:
        """The tool in messages."""
        return self.tool.name or f"the {self.tool.kind} of {short(self.tool.diameter, 3)} mm"

    @property
    def where(self) -> str:
        """The material in messages."""
        return f"in {self.stock.material} at most" if self.material else "in no material more than"


def check_set_up(
    gone: SweptAreas, design: Design, stock: StockTable, running: Sequence[Running]
) -> SetUp:
    """The limits of the set-up that the cuts in `gone` exceed.

    running: motions of each cut with the spindle.
    """
    moves = gone.moves
    at_feed = gone.rows[~moves.rapid[gone.rows] & ~moves.rising[gone.rows]]
    at_feed = at_feed[~find_in_own_hole(moves, at_feed)]
    cases = []
    for tool, numbers in _group_by_tool(gone.cuts):
        rows = at_feed[np.isin(moves.cut[at_feed], numbers)]
        motions = {number: running[number] for number in numbers}
        if len(rows):
            cases.append(_Case(tool, gone, design, rows, stock, motions))
    breaches: list[Breach] = []
    for case in cases:
        breaches += filter(None, [rule(case) for rule in _RULES])
    return SetUp(tuple(breaches), *_name_examined(cases, stock))


def _group_by_tool(cuts: Sequence[Cut]) -> list[tuple[ToolTable, list[int]]]:
    groups: list[tuple[ToolTable, list[int]]] = []
    for number, cut in enumerate(cuts):
        if not turns(cut):
            continue
        known = next((numbers for tool, numbers in groups if tool == cut.tool), None)
        if known is None:
            groups.append((cut.tool, [number]))
        else:
            known.append(number)
    return groups


def _name_examined(
    cases: Sequence[_Case], stock: StockTable
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The properties that were examined, and the others with the keys that are not set."""
    if not cases:
        return (), ()
    tools = [case.tool for case in cases]
    examined, unexamined = ["passes", "plunges"], []
    for name, is_known, key in (
        ("depth", stock.thickness is not None, "stock.thickness"),
        ("feed of a tooth and cutting speed", stock.material is not None, "stock.material"),
        ("cutting length", all(tool.cutting_length for tool in tools), "tool.cutting_length"),
        ("speed of the spindle", all(tool.max_speed for tool in tools), "tool.max_speed"),
    ):
        if is_known:
            examined.append(name)
        else:
            unexamined.append(f"{name} ({key})")
    return tuple(examined), tuple(unexamined)


# Depths: rows of the stock proof.


def _exceed_stock(case: _Case) -> Breach | None:
    stock = case.stock
    if stock.thickness is None:
        return None
    depths = case.gone.moves.deepest[case.rows] - _tip(case.tool)
    what = (
        f"{case.name} goes {{}} mm deep, the stock is {short(stock.thickness, 3)} mm thick and "
        f"{short(stock.below, 3)} mm below it are allowed"
    )
    remedy = "set operation.depth, stock.thickness or stock.below"
    return _breach_of_rows(case, depths, stock.thickness + stock.below + TOLERANCE_MM, what, remedy)


def _tip(tool: ToolTable) -> float:
    """The length of a drill's tip, mm; 0 for other tools."""
    if tool.kind != "drill":
        return 0.0
    return tool.radius / math.tan(math.radians((tool.tip_angle or _DRILL_ANGLE) / 2))


def _exceed_edges(case: _Case) -> Breach | None:
    if case.tool.cutting_length is None:
        return None
    edges = case.tool.cutting_length
    what = f"{case.name} goes {{}} mm deep, its cutting edges are {short(edges, 3)} mm long"
    remedy = "set operation.depth or tool.cutting_length"
    depths = case.gone.moves.deepest[case.rows]
    return _breach_of_rows(case, depths, edges + TOLERANCE_MM, what, remedy)


def _exceed_pass(case: _Case) -> Breach | None:
    """A mill that takes too deep a pass, half-way along its level motions.

    A ramp is judged by the level motion after it, which takes what the ramp leaves.
    """
    if case.tool.kind == "drill":
        return None
    diameters = case.material.passes if case.material else _PASSES
    limit = diameters * case.tool.diameter
    moves = case.gone.moves
    level = moves.level[case.rows] & ~moves.upright[case.rows]
    rows = case.rows[level & (moves.deepest[case.rows] > limit + TOLERANCE_MM)]
    if not len(rows):
        return None
    points = points_at(moves.plane.take(rows), np.full(len(rows), 0.5))
    depths = moves.deepest[rows] - _find_cleared(case.gone, rows, points)
    what = (
        f"{case.name} takes {{}} mm in one pass, {case.where} {short(limit, 3)} mm are usual "
        f"({short(diameters, 1)} diameters)"
    )
    source = "charts of mills end at one diameter in metal, at three in wood and plastics"
    remedy = f"{source}; set operation.passes"
    return _breach_of_rows(case._replace(rows=rows), depths, limit + TOLERANCE_MM, what, remedy)


def _plunge(case: _Case) -> Breach | None:
    """A mill that goes straight down into material and need not cut over its centre."""
    if case.tool.kind not in _FLAT_MILLS or case.tool.center_cutting:
        return None
    moves = case.gone.moves
    rows = case.rows[moves.upright[case.rows]]
    points = moves.plane.end[rows]
    meets = shapely.distance(case.design.outline, shapely.points(points)) <= case.tool.radius
    rows, points = rows[meets], points[meets]
    depths = moves.deepest[rows] - _find_cleared(case.gone, rows, points)
    what = f"{case.name} goes straight down, {{}} mm into material"
    source = "not every end mill cuts over its centre"
    remedy = f'{source}; set operation.entry = "ramp" or "helix", or tool.center_cutting = true'
    return _breach_of_rows(case._replace(rows=rows), depths, 10 * TOLERANCE_MM, what, remedy)


def _find_cleared(gone: SweptAreas, rows: IntArray, points: FloatArray) -> FloatArray:
    """(K,) depths, mm, to which earlier motions have cleared points.

    rows: (K,) motions.
    points: (K, 2) places of the tool's axis during them, mm.
    """
    cleared = np.zeros(len(rows))
    radius = np.array([cut.tool.radius for cut in gone.cuts])
    moves = gone.moves
    step, first = 256, 0
    while first < len(rows):
        which, places = gone.tree.query(shapely.points(points[first : first + step]))
        which, earlier = which + first, gone.rows[places]
        first += step
        # The program decides how many motions pass over a point.
        step = int(np.clip(_PAIRS * step / max(len(which), 1), 16, 4 * step))
        before = (earlier < rows[which]) & ~moves.rapid[earlier]
        which, earlier = which[before], earlier[before]
        inside = (
            measure_distances(points[which], moves.plane, earlier) <= radius[moves.cut[earlier]]
        )
        which, earlier = which[inside], earlier[inside]
        np.maximum.at(cleared, which, _depths_at(moves, earlier, points[which]))
    return cleared


def _depths_at(moves: Moves, rows: IntArray, points: FloatArray) -> FloatArray:
    """(K,) depths, mm, of motions where they pass by points, (K, 2) mm."""
    start = moves.plane.start[rows]
    chord = moves.plane.end[rows] - start
    square = np.maximum((chord**2).sum(axis=1), _TINY)
    share = np.clip(((points - start) * chord).sum(axis=1) / square, 0.0, 1.0)
    first, last = moves.down[rows].T
    depth = first + share * (last - first)
    return np.asarray(np.where(moves.upright[rows], np.maximum(first, last), depth))


def _breach_of_rows(
    case: _Case, values: FloatArray, limit: float, what: str, remedy: str
) -> Breach | None:
    """The breach of motions whose values, mm, are above a limit; None if none is.

    values: (K,) values of `case.rows`.
    what: words with a field for the largest value.
    """
    above = np.flatnonzero(values > limit)
    if not len(above):
        return None
    moves, row = case.gone.moves, int(case.rows[above[0]])
    cut = case.gone.cuts[int(moves.cut[row])]
    worst = float(values[above].max())
    digits = 0 if worst > _WHOLE else 3
    place = to_vec3(moves.end[row])
    return Breach(int(moves.line[row]), cut.file, place, what.format(short(worst, digits)), remedy)


# Feeds and speeds: columns of the text.


def _exceed_tooth(case: _Case) -> Breach | None:
    """A tooth, or the turn of a drill, that is fed more than the material bears."""
    materials = [case.material] if case.material else MATERIALS.values()
    charts = [find_charts(material, case.tool)[0] for material in materials]
    known = [chart for chart in charts if chart is not None]
    if not known:
        return None
    chart = max(known, key=lambda chart: chart.highest(case.tool.diameter))
    limit = chart.highest(case.tool.diameter)
    is_drill = case.tool.kind == "drill"
    edges = 1 if is_drill else case.tool.flutes

    judged = case.rows[case.gone.moves.upright[case.rows] == is_drill]

    def feed(running: Running) -> FloatArray:
        per_edge = running.columns.speed * 60 / running.speed / edges
        return np.where(running.speed > _SWITCHED_ON, per_edge, 0.0)

    noun = "turn" if is_drill else "tooth"
    what = f"{case.name} is fed {{}} mm a {noun}, {case.where} {short(limit, 3)} mm are usual"
    keys = "the feed or the speed of the tool, tool.flutes, or process.max_feed_factor"
    remedy = f"{chart.source}; set {keys}"
    return _breach_of_text(case._replace(rows=judged), feed, limit, what, remedy)


def _exceed_speed(case: _Case) -> Breach | None:
    speeds = find_charts(case.material, case.tool)[1] if case.material else None
    if speeds is None:
        return None
    limit = speeds.turns(case.tool.diameter)[1]

    def turning(running: Running) -> FloatArray:
        return running.speed

    what = (
        f"{case.name} turns at {{}} rpm, {case.where} {short(limit, 0)} rpm are usual at this "
        "diameter"
    )
    remedy = f"{speeds.source}; set the speed of the tool"
    return _breach_of_text(case, turning, limit, what, remedy)


def _exceed_job(case: _Case) -> Breach | None:
    moves = case.gone.moves
    stated = [case.gone.cuts[number].stated for number in case.running]
    known = [each for each in stated if each is not None]
    if not known or len(known) < len(stated):
        return None
    upright = moves.upright[case.rows]
    feeds = max(each.feed for each in known), max(each.plunge for each in known)
    for chosen, limit in zip((~upright, upright), feeds, strict=True):
        what = f"{case.name} is fed {{}} mm/s, the job states {short(limit, 3)} mm/s at most"
        rows = case._replace(rows=case.rows[chosen])
        breach = _breach_of_text(rows, lambda running: running.columns.speed, limit, what, _BY_JOB)
        if breach is not None:
            return breach
    return None


def _differ_from_job(case: _Case) -> Breach | None:
    stated: set[float] = set()
    for number in case.running:
        cut = case.gone.cuts[number]
        stated.update(cut.stated.speeds if cut.stated else ())
    if not stated:
        return None

    def measure_ratio(running: Running) -> FloatArray:
        ratios = [np.maximum(running.speed / speed, speed / running.speed) for speed in stated]
        return np.where(running.speed > _SWITCHED_ON, np.min(ratios, axis=0), 0.0)

    speeds = " or ".join(short(speed, 0) for speed in sorted(stated))
    what = f"{case.name} turns {{}} times faster or slower than the job states, {speeds} rpm"
    return _breach_of_text(case, measure_ratio, 1.0, what, _BY_JOB)


def _breach_of_text(
    case: _Case, value: Callable[[Running], FloatArray], limit: float, what: str, remedy: str
) -> Breach | None:
    """The breach of motions whose values in the text are above a limit; None if none is.

    value: (M,) values of the motions of a cut.
    what: words with a field for the largest value.
    """
    moves = case.gone.moves
    values = np.zeros(len(case.rows))
    for number, running in case.running.items():
        chosen = moves.cut[case.rows] == number
        with np.errstate(invalid="ignore", divide="ignore"):
            values[chosen] = np.nan_to_num(value(running))[moves.motion[case.rows[chosen]]]
    return _breach_of_rows(case, values, limit * _NEARLY, what, remedy)


_RULES: tuple[Callable[[_Case], Breach | None], ...] = (
    _exceed_stock,
    _exceed_edges,
    _exceed_pass,
    _plunge,
    _exceed_tooth,
    _exceed_speed,
    _exceed_job,
    _differ_from_job,
)
