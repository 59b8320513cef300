"""A first job for a drawing: holes, contours inside others, outlines, held by tabs.

It is a proposal. The drawing states neither the thickness of the material nor its name: depths
follow from a thickness that has to be measured, and speeds are placeholders. Contours that no tool
fits are left to the user.

- A round hole is drilled if there is a standard drill of its diameter, else a mill bores it.
- A contour is followed by the largest mill that touches 95 % of it. A smaller mill takes the rest,
  where no tabs are that it might cut off.
- Mills go in on ramps. If they take several passes, a last pass finishes the wall.
- Outlines, and holes with slugs, have as many tabs as there is room for, four at most. Where two
  have no room, a thin skin stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, compress

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nesting import Nesting, find_nesting
from camgen.geometry.segments import Segments, flatten, make_contour_segments
from camgen.model.job import StockTable, ToolRow, ToolTable
from camgen.model.materials import MATERIALS
from camgen.model.part import (
    Contour,
    Part,
    drop_ids,
    index_by_id,
    keep_ids,
    list_ids,
    list_layers,
    select_closed,
)
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.plan.drill import Hole, find_circles, select_innermost
from camgen.plan.open_outlines import check_outlines
from camgen.plan.proposed_across import choose_pocket_mill, find_across
from camgen.plan.proposed_mills import (
    FINISH_MM,
    MOST_TRIED,
    PASS,
    ChosenMill,
    Row,
    choose_mills,
    sample,
)
from camgen.plan.proposed_tools import ProposedTool, ToolRack

#: mm: assumed thickness of the material, until it is measured.
THICKNESS_MM = 3.0
#: mm: a cut through the material ends this far below it.
_THROUGH_MM = 0.5
#: mm: circles larger than this are cut, not drilled.
_LARGEST_DRILL_MM = 13.0
#: mm: there are no drills smaller than this.
_SMALLEST_DRILL_MM = 0.2
#: mm: diameters that differ by at most this are one size.
_SAME_SIZE_MM = 0.02
#: mm: the range of diameters that selects a size extends beyond it on both sides by this.
_RANGE_MARGIN_MM = 0.01
#: Maximum diameter of a counterbore, in diameters of the hole in it.
_MAX_COUNTERBORE = 3.0
#: Maximum distance between the centres of a counterbore and of its hole, in diameters of the hole.
_MAX_OFF_CENTRE = 0.1
#: Depth of a peck, in diameters of the drill.
_PECK = 3.0
#: The same as `PASS` for materials whose charts allow passes deeper than the diameter.
_DEEP_PASS = 1.0
#: Speed on a ramp, as a fraction of the feed.
_RAMP_FRACTION = 0.75
#: A path in a corner is shorter than this, in diameters of the mill before.
_CORNER_PATHS = 4.0
#: Half the tip of a drill, rad: 118 degrees.
_TIP = math.radians(59)
#: A hole is bored by a mill of at most this share of its diameter: chips need room.
_BORING_SHARE = 0.8
#: Thickness of the skin that holds an outline without room for tabs, mm.
_SKIN_MM = 0.2
#: Margin of the stock, in diameters of the widest mill: a kerf, and a frame as wide as it.
_FRAME = 2.0
#: Chords of the contours whose slugs are measured leave them by this, mm.
_CHORD_MM = 0.05
#: Diameter of the mill for which the room of tabs is estimated, mm.
_USUAL_MILL_MM = 6.0
#: Tabs are spread evenly and keep off corners: they need this factor more than their length.
_SPREAD = 1.15
#: Room for the seam of an outline beside its tabs, in lengths of a tab.
_SEAM_TABS = 1.0


class Proposed(Struct, frozen=True):
    """One operation.

    about: its contours, for a comment.
    row: row of `[[operations]]`.
    why: reason for the tool.
    """

    about: str
    row: Row
    why: str = ""


class _Tabs(Struct, frozen=True):
    """Tabs of an outline.

    number: largest number of tabs.
    width: width of a tab, mm.
    height: height of a tab, mm.
    angle: angle of the slope after a tab, deg.
    """

    number: int
    width: float
    height: float
    angle: float

    def length(self, diameter: float) -> float:
        """Length of a tab with its slopes along the path of a mill, mm."""
        slopes = self.height * (1 + 1 / math.tan(math.radians(self.angle)))
        return self.width + diameter + slopes

    def fit(self, path: float, diameter: float) -> int:
        """Number of tabs for which a closed path of the length `path`, mm, has room."""
        room = path / self.length(diameter) - _SEAM_TABS
        return math.floor(min(self.number, room / _SPREAD))

    def keys(self, number: int) -> dict[str, object]:
        """Keys of the operation."""
        if self == _TABS[0]:
            return {"tabs": number}
        return {
            "tabs": number,
            "tab_width": self.width,
            "tab_height": self.height,
            "entry_angle": self.angle,
        }


#: Tabs of an outline, of which the first that fit are taken. Makers of end mills recommend ramps of
#: at most 10 degrees.
_TABS = (_Tabs(4, 5.0, 1.0, 3.0), _Tabs(4, 3.0, 0.8, 5.0), _Tabs(3, 2.0, 0.8, 10.0))


class _TabRoom(Struct, frozen=True):
    """Loops that have room for the same tabs.

    tabs: the largest tabs that fit by the length of the loops.
    crowded: largest length of a loop beside which other kerfs leave no room for tabs, mm.
    rows: rows of the loops.
    """

    tabs: _Tabs
    crowded: float
    rows: list[int]


class Proposal(Struct, frozen=True):
    """Tools and operations for a drawing.

    tools: tools that the library lacks, or whose feeds and speeds it does not state.
    operations: rows of `[[operations]]`.
    left: ids of closed contours that no operation works on.
    thickness: material thickness, mm, from which the depths follow.
    material: name of the material, "" if it is unknown.
    margin: material around the drawing, mm, of which a frame stays beside the outlines.
    """

    tools: tuple[ProposedTool, ...]
    operations: tuple[Proposed, ...]
    left: tuple[str, ...]
    thickness: float
    material: str
    margin: float = 10.0


class _Loops(Struct, frozen=True, eq=False):
    """The closed contours of a drawing.

    thickness: material thickness, mm.
    part: the contours that bound the cuts.
    contours: all closed contours.
    nesting: the loops around each of them.
    segments: their lines and arcs.
    circles: the circles among them, by id.
    with_tabs: whether tabs hold parts and slugs.
    across: pockets that cross other contours; none of `contours`.
    """

    thickness: float
    part: Part
    contours: tuple[Contour, ...]
    nesting: Nesting
    segments: Segments
    circles: dict[str, Hole]
    with_tabs: bool
    across: tuple[Contour, ...] = ()

    def name(self, rows: Iterable[int]) -> list[str]:
        """The ids of loops."""
        return list(list_ids(take_rows(self.contours, rows)))


def propose(
    part: Part,
    stock: StockTable | None = None,
    library: Sequence[ToolRow] = (),
    *,
    with_tabs: bool = True,
) -> Proposal | None:
    """Tools and operations for a flat drawing; None if it has no sound closed contour.

    stock: thickness of the material, from which depths follow, and its name, by which feeds and
        speeds are chosen; None if nothing is known.
    library: tools to choose from before new ones are proposed.
    with_tabs: whether tabs hold parts and slugs; else a skin does.

    Raises AmbiguousInput if an outline with a gap encloses closed contours: the outlines are not
    known then.
    """
    closed = tuple(select_closed(part.contours))
    if not closed:
        return None
    check_outlines(part, list_ids(closed), "leave its layer out with input.layers")
    across = find_across(closed)
    if across:
        crossing = list_ids(across)
        closed = drop_ids(closed, crossing)
        part = replace(part, contours=drop_ids(part.contours, crossing))
    segments, stock = make_contour_segments(closed), stock or StockTable()
    loops = _Loops(
        stock.thickness or THICKNESS_MM,
        part,
        closed,
        find_nesting(segments, len(closed)),
        segments,
        index_by_id(find_circles(part)),
        with_tabs,
        across,
    )
    holes, bores, inner, outer = _sort(loops)
    # A drilled hole bounds no cut.
    drilled = set(loops.name(chain.from_iterable(holes)))
    loops = replace(loops, part=replace(part, contours=drop_ids(part.contours, drilled)))
    rack = ToolRack(library, MATERIALS[stock.material] if stock.material else None)
    operations = [
        *_drill(loops, holes, rack),
        *_clear(loops, rack),
        *_cut(loops, bores, inner, outer, rack),
    ]
    if not operations:
        return None
    rows, worked = zip(*operations, strict=True)
    left_out = list_ids(drop_ids((*closed, *across), set(chain.from_iterable(worked))))
    return Proposal(
        rack.tools,
        rows,
        left_out,
        loops.thickness,
        stock.material or "",
        max(stock.margin, _FRAME * rack.widest_mill),
    )


def _sort(loops: _Loops) -> tuple[list[list[int]], list[int], list[int], list[int]]:
    """Rows of loops, sorted by their kind of operation.

    A hole is an empty circle of the size of a drill. It lies in material, in a counterbore, or
    inside no loop.

    Returns the holes to be drilled or bored, one list for each size, the counterbores around such
    holes, the other loops inside others, and the other loops inside no loop.
    """
    nesting = loops.nesting
    # Number of loops directly inside each loop.
    inside = np.bincount(nesting.parent[nesting.parent >= 0], minlength=len(loops.contours))
    sound = (nesting.crossed < 0) & ~nesting.empty
    holes, bores, inner, outer = list[int](), list[int](), list[int](), list[int]()
    depth, parent = nesting.depth.tolist(), nesting.parent.tolist()
    for k in np.flatnonzero(sound).tolist():
        circle = loops.circles.get(loops.contours[k].id)
        if circle and _has_drill_size(circle.diameter) and not inside[k]:
            around = loops.circles.get(loops.contours[parent[k]].id) if depth[k] else None
            bored = around is not None and _is_counterbore(around, circle) and depth[k] > 1
            if depth[k] % 2 or depth[k] == 0 or bored:
                holes.append(k)
                bores += [parent[k]] if bored and inside[parent[k]] == 1 else []
                continue
        (inner if depth[k] else outer).append(k)
    inner = [k for k in inner if k not in set(bores)]
    return _by_size(loops, holes), bores, inner, outer


def _has_drill_size(diameter: float) -> bool:
    smallest = _SMALLEST_DRILL_MM - _RANGE_MARGIN_MM
    return smallest <= diameter <= _LARGEST_DRILL_MM + _RANGE_MARGIN_MM


def _is_counterbore(around: Hole, hole: Hole) -> bool:
    near = math.hypot(around.x - hole.x, around.y - hole.y) <= _MAX_OFF_CENTRE * hole.diameter
    return near and around.diameter <= _MAX_COUNTERBORE * hole.diameter


def _diameter(loops: _Loops, k: int) -> float:
    return loops.circles[loops.contours[k].id].diameter


def _by_size(loops: _Loops, rows: list[int]) -> list[list[int]]:
    """Group circles by size, the smallest first.

    The range of diameters that selects one size contains no other size.
    """
    min_step = 2 * _RANGE_MARGIN_MM + _SAME_SIZE_MM
    groups: list[list[int]] = []
    for k in sorted(rows, key=lambda k: _diameter(loops, k)):
        if groups and _diameter(loops, k) - _diameter(loops, groups[-1][-1]) <= min_step:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _drill(
    loops: _Loops, sizes: list[list[int]], rack: ToolRack
) -> Iterator[tuple[Proposed, list[str]]]:
    """An operation for each size: a standard drill, else a mill that bores."""
    through = loops.thickness + _THROUGH_MM
    for rows in sizes:
        diameters = [_diameter(loops, k) for k in rows]
        smallest, largest = min(diameters), max(diameters)
        low, high = smallest - _RANGE_MARGIN_MM, largest + _RANGE_MARGIN_MM
        about = f"{counted(len(rows), 'hole')} of {short(smallest, 3)} mm"
        chosen = _choose_holes(loops, rows, low, high)
        drill = rack.find_drill(smallest)
        # A mill leaves no core of a hole that is at most twice as wide.
        fitting = [mill for mill in rack.mills if largest / 2 <= mill <= _BORING_SHARE * smallest]
        if drill:
            depth = math.floor((through + drill / 2 / math.tan(_TIP)) * 10) / 10
            row = {"kind": "drill", "tool": rack.take("drill", drill), **chosen, "depth": depth}
            pecks = math.ceil(depth / (_PECK * drill))
            row |= {"passes": pecks} if pecks > 1 else {}
            yield Proposed(about, row, "a standard size"), loops.name(rows)
        elif fitting:
            tool = rack.take("end mill", max(fitting))
            row = {"kind": "bore", "tool": tool, **chosen, "depth": through}
            yield Proposed(about, row, "no drill has this size"), loops.name(rows)


def _choose_holes(loops: _Loops, rows: list[int], low: float, high: float) -> dict[str, object]:
    """Keys of an operation that select holes: diameters and nesting, and ids if needed.

    low, high: range of their diameters, mm.
    """
    wanted = set(loops.name(rows))
    sizes = {"holes": [round(low, 3), round(high, 3)]}
    level_of = dict(zip(list_ids(loops.contours), loops.nesting.depth.tolist(), strict=True))
    level = np.array(take_rows(level_of, loops.circles))
    for nesting, fits in (("inner", level > 0), ("outer", level == 0), ("any", level >= 0)):
        nested = list(compress(loops.circles.values(), fits))
        chosen = {hole.id for hole in select_innermost(nested) if low <= hole.diameter <= high}
        if chosen == wanted and not loops.across:
            return sizes | ({"nesting": nesting} if nesting != "any" else {})
    return sizes | {"ids": loops.name(rows)}


def _clear(loops: _Loops, rack: ToolRack) -> Iterator[tuple[Proposed, list[str]]]:
    """A pocket for contours that cross others: a recess at an edge of the part, half as deep."""
    if not loops.across:
        return
    diameter = choose_pocket_mill(loops.across, rack.mills)
    ids = list(list_ids(loops.across))
    tool = rack.take("end mill", diameter)
    depth = loops.thickness / 2
    row: dict[str, object] = {"kind": "pocket", "tool": tool, "ids": ids, "depth": depth}
    row |= {"entry": "ramp", "plunge": round(rack.feed(tool) * _RAMP_FRACTION, 2)}
    passes = math.ceil(depth / (PASS * diameter) - 1e-9)
    row |= {"passes": passes} if passes > 1 else {}
    about = f"{counted(len(ids), 'pocket')} across other contours: how deep?"
    yield Proposed(about, row, "the largest mill that reaches enough of them"), ids


def _cut(
    loops: _Loops, bores: list[int], inner: list[int], outer: list[int], rack: ToolRack
) -> Iterator[tuple[Proposed, list[str]]]:
    """Counterbores, contours inside others, and the outlines."""
    through = loops.thickness + _THROUGH_MM
    for rows in _by_size(loops, sorted(set(bores))):
        count = counted(len(rows), "counterbore")
        what = f"{count} of {short(_diameter(loops, rows[0]), 3)} mm: how deep?"
        yield from _follow(
            loops, rows, {"side": "inside", "depth": loops.thickness / 2}, what, rack
        )
    slugs, chips, inner_parts = list[int](), list[int](), list[int]()
    for k in inner:
        if loops.nesting.depth[k] % 2 == 0:
            inner_parts.append(k)
        elif _leaves_slug(loops, k, max(rack.mills)):
            slugs.append(k)
        else:
            chips.append(k)
    what = f"{counted(len(chips), 'contour')} inside others"
    yield from _follow(loops, chips, {"depth": through}, what, rack)
    for name, plural, parts in (
        ("contour around slugs", "contours around slugs", slugs),
        ("part inside others", "parts inside others", inner_parts),
        ("outline", "outlines", outer),
    ):
        for room in _by_room(loops, parts, max(rack.mills)):
            what = counted(len(room.rows), name, plural)
            yield from _follow(loops, room.rows, {"depth": through}, what, rack, room)


def _leaves_slug(loops: _Loops, row: int, widest: float) -> bool:
    """Whether a hole has to be held: its slug is larger than a chip, or has a contour on it.

    widest: diameter of the widest mill, mm.
    """
    if (loops.nesting.parent == row).any():
        return True
    points, owner = flatten(loops.segments.take(loops.segments.owner == row), _CHORD_MM)
    ring = shapely.make_valid(shapely.Polygon(points)) if len(owner) > 2 else shapely.Polygon()
    slug = shapely.get_parts(shapely.buffer(ring, -widest))
    return bool(shapely.area(slug).max(initial=0.0) > ToolTable(diameter=_USUAL_MILL_MM).chip_area)


def _measure_crowded(loops: _Loops, rows: Sequence[int], widest: float) -> FloatArray:
    """(C,) length of the loops `rows` along which kerfs of others meet theirs and cut tabs off, mm.

    widest: diameter of the widest mill, mm.
    """
    points, owner = flatten(loops.segments, _CHORD_MM)
    drawn = np.flatnonzero(np.bincount(owner, minlength=len(loops.contours)) > 2)
    chosen = np.isin(owner, drawn)
    rings = shapely.linearrings(points[chosen], indices=np.searchsorted(drawn, owner[chosen]))
    nesting = loops.nesting
    # The kerf of a hole is inside it, that of a part is outside it, in its parent.
    cell = np.where(nesting.depth % 2 == 1, np.arange(len(nesting.depth)), nesting.parent)[drawn]
    tree = shapely.STRtree(rings)
    crowded = np.zeros(len(loops.contours))
    for k in np.flatnonzero(np.isin(drawn, list(rows))).tolist():
        near = tree.query(rings[k], predicate="dwithin", distance=2 * widest)
        others = rings[near[(near != k) & (cell[near] == cell[k])]]
        reach = shapely.buffer(shapely.union_all(others), 2 * widest)
        crowded[drawn[k]] = shapely.intersection(rings[k], reach).length
    return crowded


def _by_room(loops: _Loops, rows: Sequence[int], widest: float) -> list[_TabRoom]:
    """Loops by the tabs that they have room for, the roomiest first.

    widest: diameter of the widest mill, mm.
    """
    lengths = np.bincount(loops.segments.owner, loops.segments.length, len(loops.contours))
    crowded = _measure_crowded(loops, rows, widest)
    groups: list[tuple[_Tabs, list[int]]] = [(tabs, []) for tabs in _TABS]
    for k in rows:
        fitting = [tabs.fit(float(lengths[k] - crowded[k]), _USUAL_MILL_MM) >= 2 for tabs in _TABS]
        groups[fitting.index(True) if any(fitting) else -1][1].append(k)
    return [_TabRoom(tabs, float(crowded[ks].max()), ks) for tabs, ks in groups if ks]


def _follow(
    loops: _Loops,
    rows: list[int],
    keys: Row,
    what: str,
    rack: ToolRack,
    room: _TabRoom | None = None,
) -> Iterator[tuple[Proposed, list[str]]]:
    """Operations beside the loops of `rows`: the largest mill first, then one for the rest.

    room: tabs for which the loops have room; None for loops that cut nothing out.
    """
    if not rows:
        return
    if len(rows) > MOST_TRIED:
        mills = [ChosenMill(max(rack.mills), rows, 1.0, True, math.inf, math.inf)]
    else:
        samples = sample(loops.segments, loops.nesting, np.array(rows))
        ids = dict(zip(rows, loops.name(rows), strict=True))
        mills = choose_mills(loops.part, ids, keys, samples, rack.mills)
    held = _choose_hold(loops, mills, room) if room and mills else {}
    if "tabs" in held:
        # A smaller mill in the corners would cut tabs off.
        mills = [mill for mill in mills if not mill.before]
    for mill in mills:
        worked = loops.name(mill.loops)
        about = what if len(worked) == len(rows) else f"{len(worked)} of {what}"
        why = "the largest mill that reaches enough of them"
        if mill.before:
            about = f"what larger mills leave of {what}"
            why = f"{100 * mill.share:.0f} % of their length is touched then"
        tool = rack.take("end mill", mill.diameter)
        depth = float(str(held.get("depth", keys["depth"])))
        row = {
            "kind": "follow",
            "tool": tool,
            **_choose_loops(loops, worked),
            **({"rest": True} if mill.before else {}),
            **keys,
            **_go_down(depth, mill, rack, tool, "tabs" in held),
            **(held if mill.cuts_out and "tabs" in held else {}),
            # The feeds of charts are those of the tool's centre.
            **({"max_feed_factor": 1.0} if rack.material else {}),
        }
        yield Proposed(about, row, why), worked


def _choose_hold(loops: _Loops, mills: Sequence[ChosenMill], room: _TabRoom) -> dict[str, object]:
    """Tabs for which the paths of all mills have room; else the depth of a skin."""
    for smaller in _TABS[_TABS.index(room.tabs) :] if loops.with_tabs else ():
        number = min(smaller.fit(mill.shortest - room.crowded, mill.diameter) for mill in mills)
        if number >= 2:
            return smaller.keys(number)
    return {"depth": loops.thickness - _SKIN_MM}


def _go_down(
    depth: float, mill: ChosenMill, rack: ToolRack, tool: str, may_have_tabs: bool
) -> dict[str, object]:
    """Depth, passes, entry and finish of a mill.

    A rest in corners is narrow. Open paths of a rest begin in cleared ground, if no tab is there.
    """
    is_rest = mill.before > 0
    corners = is_rest and mill.longest <= _CORNER_PATHS * mill.before
    deep = corners or (rack.material is not None and rack.material.passes > 1)
    passes = math.ceil(depth / ((_DEEP_PASS if deep else PASS) * mill.diameter) - 1e-9)
    keys: dict[str, object] = {"depth": depth}
    if may_have_tabs or not is_rest or math.isinf(mill.longest):
        keys |= {"entry": "ramp", "plunge": round(rack.feed(tool) * _RAMP_FRACTION, 2)}
    if passes > 1:
        keys |= {"passes": passes}
    if corners:
        keys |= {"direction": "any"}  # back and forth, without lifts
    if passes > 1 and mill.may_finish:
        keys |= {"finish": FINISH_MM}
    return keys


def _choose_loops(loops: _Loops, ids: list[str]) -> dict[str, object]:
    """Keys of an operation that select loops: nesting, nesting and layers, or ids.

    The first of these that selects no other loop is taken.
    """
    wanted = set(ids)
    layers = list_layers(keep_ids(loops.contours, wanted))
    folded = {layer.casefold() for layer in layers}
    for nesting, fits in (("inner", loops.nesting.depth > 0), ("outer", loops.nesting.depth == 0)):
        nested = list(compress(loops.contours, fits))
        if loops.across:  # they are inside or outside of nothing
            break
        if set(list_ids(nested)) == wanted:
            return {"nesting": nesting}
        plain = set("*?[]!").isdisjoint("".join(layers))
        if plain and {c.id for c in nested if c.layer.casefold() in folded} == wanted:
            return {"layers": layers, "nesting": nesting}
    return {"ids": ids}
