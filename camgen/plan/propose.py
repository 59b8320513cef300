"""A first job for a drawing: round holes drilled, what lies inside cut next, outlines last, held by tabs.

It is a proposal. The drawing knows neither how thick the material is nor what it is of: depths follow from a thickness
that somebody has to measure, and speeds are placeholders. What no tool of the list fits is left to the user.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.nesting import Nesting, nest
from camgen.geometry.segments import Segments, from_contours
from camgen.model.errors import CamgenError
from camgen.model.job import StockTable, ToolRow
from camgen.model.materials import MATERIALS
from camgen.model.part import Contour, Part
from camgen.model.pose import FloatArray
from camgen.model.text import counted, short
from camgen.plan import plan
from camgen.plan.drill import Hole, find_circles, innermost
from camgen.plan.open_outlines import check_outlines
from camgen.plan.proposed_tools import ProposedTool, ToolRack
from camgen.read.job_file import from_mapping

#: Thickness of the material, mm, until it is measured.
THICKNESS_MM = 3.0
#: A cut through the material ends so far below it, mm.
_THROUGH_MM = 0.5
#: Larger circles are cut, mm, and of smaller ones there is no drill.
_LARGEST_DRILL, _SMALLEST_DRILL = 13.0, 0.2
#: Diameters that differ by no more are one size, mm; so much more and less is in the range that chooses it.
_SAME_SIZE, _ROOM = 0.02, 0.01
#: A circle around a hole, up to so many times as wide, is a counterbore; so far off, in diameters of the hole.
_COUNTERBORE, _OFF_CENTRE = 3.0, 0.1
#: Fillets that are smaller, mm, are corners: no mill is chosen by them.
_CORNER = 0.5
#: Up to so many loops mills are tried in turn; of more the largest that the fillets allow is taken.
_MOST_TRIED = 3000
#: The depth of a pass of a mill and of a peck of a drill, as parts of the diameter.
_PASS, _PECK = 0.5, 3.0
#: Half the tip of a drill, rad: 118 degrees.
_TIP = math.radians(59)
TABS = 4

Row = Mapping[str, object]


class Proposed(Struct, frozen=True):
    """One operation. about: what it does, for a comment. row: of ``[[operations]]``."""

    about: str
    row: Row


class Proposal(Struct, frozen=True):
    """Tools and operations for a drawing.

    tools: tools that the library lacks, or whose feeds and speeds it does not state.
    operations: rows of ``[[operations]]``.
    left: ids of closed contours that no operation works on.
    thickness: material thickness, mm, from which the depths follow.
    material: name of the material, "" if it is unknown.
    """

    tools: tuple[ProposedTool, ...]
    operations: tuple[Proposed, ...]
    left: tuple[str, ...]
    thickness: float
    material: str


class _Loops(Struct, frozen=True, eq=False):
    """The closed contours of a drawing.

    thickness: material thickness, mm.
    part: the contours that bound the cuts.
    contours: all closed contours.
    nesting: the loops around each of them.
    segments: their lines and arcs.
    circles: the circles among them, by id.
    """

    thickness: float
    part: Part
    contours: tuple[Contour, ...]
    nesting: Nesting
    segments: Segments
    circles: dict[str, Hole]

    def name(self, rows: Sequence[int]) -> list[str]:
        """The ids of loops."""
        return [self.contours[k].id for k in rows]

    def count_inside(self) -> list[int]:
        """How many loops lie directly inside each."""
        parent = self.nesting.parent
        return [
            int(count) for count in np.bincount(parent[parent >= 0], minlength=len(self.contours))
        ]


class _Sorted(Struct, frozen=True):
    """Which loops, by row, are what. holes: by size. bores: circles around holes. inner, outer: the others."""

    holes: list[list[int]]
    bores: list[int]
    inner: list[int]
    outer: list[int]


def propose(
    part: Part, stock: StockTable | None = None, library: Sequence[ToolRow] = ()
) -> Proposal | None:
    """Tools and operations for the closed contours of a flat drawing; None where it has none, or none that is sound.

    stock: thickness of the material, from which depths follow, and its name, by which feeds and
        speeds are chosen; None if nothing is known.
    library: tools to choose from before new ones are proposed.

    Raises AmbiguousInput if an outline with a gap encloses closed contours, because the outlines are
    not known then.
    """
    closed = tuple(c for c in part.contours if c.closed)
    if not closed:
        return None
    check_outlines(part, {c.id for c in closed}, "leave its layer out with input.layers")
    segments, stock = from_contours(closed), stock or StockTable()
    loops = _Loops(
        stock.thickness or THICKNESS_MM,
        part,
        closed,
        nest(segments, len(closed)),
        segments,
        {hole.id: hole for hole in find_circles(part)},
    )
    kinds = _sort(loops)
    drilled = {name for rows in kinds.holes for name in loops.name(rows)}
    # What is drilled is no border of what is cut.
    loops = replace(
        loops, part=replace(part, contours=tuple(c for c in part.contours if c.id not in drilled))
    )
    rack = ToolRack(library, MATERIALS[stock.material] if stock.material else None)
    operations = [*_drill(loops, kinds.holes, rack), *_cut(loops, kinds, rack)]
    if not operations:
        return None
    used = {name for _, ids in operations for name in ids}
    left = tuple(c.id for c in closed if c.id not in used)
    rows = tuple(one for one, _ in operations)
    return Proposal(rack.tools, rows, left, loops.thickness, stock.material or "")


def _sort(loops: _Loops) -> _Sorted:
    """Holes are circles with nothing in them that a drill makes: in material, in a wider circle, or all there is."""
    nesting, inside = loops.nesting, loops.count_inside()
    sound = (nesting.crossed < 0) & ~nesting.empty
    holes, bores, inner, outer = list[int](), list[int](), list[int](), list[int]()
    depth, parent = nesting.depth.tolist(), nesting.parent.tolist()
    for k in np.flatnonzero(sound).tolist():
        circle = loops.circles.get(loops.contours[k].id)
        if (
            circle
            and _SMALLEST_DRILL - _ROOM <= circle.diameter <= _LARGEST_DRILL + _ROOM
            and not inside[k]
        ):
            around = loops.circles.get(loops.contours[parent[k]].id) if depth[k] else None
            bored = around is not None and _is_counterbore(around, circle) and depth[k] > 1
            if depth[k] % 2 or depth[k] == 0 or bored:
                holes.append(k)
                bores += [parent[k]] if bored and inside[parent[k]] == 1 else []
                continue
        (inner if depth[k] else outer).append(k)
    inner = [k for k in inner if k not in set(bores)]
    return _Sorted(_by_size(loops, holes), bores, inner, outer)


def _is_counterbore(around: Hole, hole: Hole) -> bool:
    near = math.hypot(around.x - hole.x, around.y - hole.y) <= _OFF_CENTRE * hole.diameter
    return near and around.diameter <= _COUNTERBORE * hole.diameter


def _diameter(loops: _Loops, k: int) -> float:
    return loops.circles[loops.contours[k].id].diameter


def _by_size(loops: _Loops, rows: list[int]) -> list[list[int]]:
    """Circles of one size each, the smallest first, so far apart that no range of diameters holds two sizes."""
    groups: list[list[int]] = []
    for k in sorted(rows, key=lambda k: _diameter(loops, k)):
        if (
            groups
            and _diameter(loops, k) - _diameter(loops, groups[-1][-1]) <= 2 * _ROOM + _SAME_SIZE
        ):
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _drill(
    loops: _Loops, sizes: list[list[int]], rack: ToolRack
) -> Iterator[tuple[Proposed, list[str]]]:
    """An operation for each size, with a drill of the rack."""
    for rows in sizes:
        sizes_here = [_diameter(loops, k) for k in rows]
        low, high = min(sizes_here) - _ROOM, max(sizes_here) + _ROOM
        diameter = max(round(min(sizes_here), 2), _ROOM)  # no hole becomes wider than it is drawn
        deepest = loops.thickness + _THROUGH_MM + diameter / 2 / math.tan(_TIP)
        depth = math.floor(deepest * 10) / 10
        row = {
            "kind": "drill",
            "tool": rack.take("drill", diameter),
            **_choose_holes(loops, rows, low, high),
            "depth": depth,
        }
        pecks = math.ceil(depth / (_PECK * diameter))
        row |= {"passes": pecks} if pecks > 1 else {}
        yield (
            Proposed(f"{counted(len(rows), 'hole')} of {short(diameter, 3)} mm", row),
            loops.name(rows),
        )


def _choose_holes(loops: _Loops, rows: list[int], low: float, high: float) -> dict[str, object]:
    """By diameter and nesting where that chooses these and no others, else by their ids too."""
    wanted = set(loops.name(rows))
    sizes = {"holes": [round(low, 3), round(high, 3)]}
    level = dict(zip((c.id for c in loops.contours), loops.nesting.depth.tolist(), strict=True))
    for nesting, fits in (
        ("inner", lambda n: n > 0),
        ("outer", lambda n: n == 0),
        ("any", lambda _: True),
    ):
        found = innermost([hole for name, hole in loops.circles.items() if fits(level[name])])
        if {hole.id for hole in found if low <= hole.diameter <= high} == wanted:
            return sizes | ({"nesting": nesting} if nesting != "any" else {})
    return sizes | {"ids": loops.name(rows)}


def _cut(loops: _Loops, kinds: _Sorted, rack: ToolRack) -> Iterator[tuple[Proposed, list[str]]]:
    """Counterbores, what lies inside, and the outlines."""
    through = loops.thickness + _THROUGH_MM
    bores = _by_size(loops, sorted(set(kinds.bores)))
    for rows in bores:
        what = f"{counted(len(rows), 'counterbore')} of {short(_diameter(loops, rows[0]), 3)} mm: how deep?"
        yield from _follow(
            loops, rows, {"side": "inside", "depth": loops.thickness / 2}, what, rack
        )
    what = counted(len(kinds.inner), "contour") + " inside others"
    # Parts in windows are held by tabs, and the windows around them too.
    is_part = loops.nesting.depth[[*kinds.inner, *kinds.bores]] % 2 == 0
    tabs = {"tabs": TABS} if is_part.any() else {}
    yield from _follow(loops, kinds.inner, {"depth": through, **tabs}, what, rack)
    what = counted(len(kinds.outer), "outline")
    yield from _follow(loops, kinds.outer, {"depth": through, "tabs": TABS}, what, rack)


def _follow(
    loops: _Loops, rows: list[int], keys: dict[str, object], what: str, rack: ToolRack
) -> Iterator[tuple[Proposed, list[str]]]:
    """One operation beside the loops of ``rows`` with the mill of the rack that fits them best."""
    if not rows:
        return
    diameter, fitting = _fit_mill(loops, rows, keys, rack.mills)
    if not fitting:
        return
    depth = float(str(keys["depth"]))
    passes = math.ceil(depth / (_PASS * diameter))
    chosen = _choose_loops(loops, fitting)
    keys = {
        "kind": "follow",
        "tool": rack.take("end mill", diameter),
        **chosen,
        **keys,
        "entry": "ramp",
        # The feeds of charts are those of the tool's centre.
        **({"max_feed_factor": 1.0} if rack.material else {}),
        **({"passes": passes} if passes > 1 else {}),
    }
    yield Proposed(what, keys), fitting


def _choose_loops(loops: _Loops, ids: list[str]) -> dict[str, object]:
    """By nesting, or by nesting and layers, where that chooses these and no others, else by their ids."""
    wanted = set(ids)
    layers = sorted({c.layer for c in loops.contours if c.id in wanted})
    folded = {layer.casefold() for layer in layers}
    for nesting, fits in (("inner", loops.nesting.depth > 0), ("outer", loops.nesting.depth == 0)):
        found = [c for c, fit in zip(loops.contours, fits.tolist(), strict=True) if fit]
        if {c.id for c in found} == wanted:
            return {"nesting": nesting}
        plain = not any(set(layer) & set("*?[]!") for layer in layers)
        if plain and {c.id for c in found if c.layer.casefold() in folded} == wanted:
            return {"layers": layers, "nesting": nesting}
    return {"ids": ids}


def _fit_mill(
    loops: _Loops, rows: list[int], keys: Row, diameters: Sequence[float]
) -> tuple[float, list[str]]:
    """The diameter that cuts most of the loops, the first of several, and the ids of these loops."""
    widest = 2 * float(_fillets(loops, rows).min(initial=np.inf)) + _SAME_SIZE
    mills = [diameter for diameter in diameters if diameter <= widest] or [min(diameters)]
    ids = loops.name(rows)
    if len(rows) > _MOST_TRIED:
        return mills[0], ids
    best: tuple[float, list[str]] = (mills[0], [])
    for diameter in mills:
        fitting = _try(loops.part, ids, keys, diameter)
        if len(fitting) > len(best[1]):
            best = (diameter, fitting)
        if len(fitting) == len(ids):
            break
    return best


def _fillets(loops: _Loops, rows: list[int]) -> FloatArray:
    """Radii, mm, of the arcs that a mill runs into: bent towards where it is, inside of holes, outside of parts."""
    segments, nesting = loops.segments, loops.nesting
    hole = nesting.depth[segments.owner] % 2 == 1
    inwards = np.sign(segments.sweep) == np.sign(nesting.area[segments.owner])
    chosen = (
        segments.is_arc
        & (hole == inwards)
        & np.isin(segments.owner, rows)
        & (segments.radius >= _CORNER)
    )
    return np.asarray(segments.radius[chosen])


def _try(part: Part, ids: list[str], keys: Row, diameter: float) -> list[str]:
    """Which of the contours ``ids`` have a path with this mill."""
    row = {"kind": "follow", "ids": ids, **keys}
    job = from_mapping({"tool": {"diameter": diameter}, "operations": [row]})
    try:
        made = plan(part, job)
    except CamgenError:  # it fits none
        return []
    found = {name for path in made.paths for name in path.contours}
    return [name for name in ids if name in found]
