"""The stock proof: the effect of the motions that were read back from a program on the material.

`design` computes from drawing and job which material may be removed, and which must be. `prove`
computes the material that the motions remove. It finds cuts into material that must stay, rapid
motions and holders in material, parts that are cut loose too early, and motions into fixtures.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock.clear import Struck, find_holders, find_rapids, index_motions
from camgen.check.stock.corners import Bite, find_bites
from camgen.check.stock.design import Design, design, show_stay
from camgen.check.stock.fixtures import Clearance, Hit, examine
from camgen.check.stock.gouge import Gouge, find_gouges
from camgen.check.stock.heights import Grid, carve_grid
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves, Stated, tabulate
from camgen.check.stock.pieces import MissingTabs, Piece, Pieces, find_pieces
from camgen.check.stock.removal import MAX_LEVELS, Level, find_levels, remove_material
from camgen.check.stock.set_up import Breach, SetUp, check_set_up
from camgen.check.stock.spindle import WrongSpindle, check_spindles, follow_spindles
from camgen.check.stock.walls import Task, make_task
from camgen.geometry.fixtures import Fixtures
from camgen.model.cell import Dynamics
from camgen.model.job import StockTable
from camgen.model.pose import to_vec3
from camgen.model.text import counted, join_short, short

__all__ = [
    "TOLERANCE_MM",
    "Breach",
    "Clearance",
    "Cut",
    "Design",
    "Fault",
    "Level",
    "SetUp",
    "Stated",
    "StockProof",
    "Task",
    "design",
    "examine_fixtures",
    "make_task",
    "prove",
    "show_stay",
]

_NO_STOCK = StockTable()
FaultKind = Literal["gouge", "corner", "rapid", "holder", "spindle", "unheld", "loose", "fixture"]


class Fault(Struct, frozen=True):
    """Material that a motion cuts and must not cut, or a fixture that it meets.

    kind: kind of the fault.
    line: line of the motion in the text, from 1.
    file: name of the text.
    x, y, z: position, mm.
    mm: depth in the material or the fixture, mm; 0 for a piece that comes loose, and for a motion
        that only passes too near to a fixture.
    text: the fault in words.
    cut: number of its `Cut`.
    serious: False for a remark.
    fixture: number of the fixture, from 1; 0 for a fault in the material.
    """

    kind: FaultKind
    line: int
    file: str
    x: float
    y: float
    z: float
    mm: float
    text: str
    cut: int = 0
    serious: bool = True
    fixture: int = 0


class StockProof(Struct, frozen=True, eq=False):
    """Material that the programs cut.

    gouges: cuts into material that must stay.
    corners: rounded corners that cut deeper into such material than their tolerance.
    rapids: rapid motions in material.
    holders: motions with the holder in material.
    spindles: motions in material with a spindle at rest, to the left or too fast.
    unheld: parts that nothing holds, and tabs of the job that are missing.
    loose: other pieces that come loose.
    levels: levels of the stock, from the top.
    volumes: volume of the material that each cut is the first to remove, mm3.
    notes: parts of the proof that are missing, with the reasons.
    set_up: limits of tools and stock that the cuts exceed.
    grid: heights, for a job with too many levels, else None.
    pieces: pieces that come loose, with their shapes.
    bite: largest depth to which rounded corners cut material that must stay, mm. None: the
        rounding is not modelled, and the proof is about the programmed path only.
    fixtures: motions that meet a fixture or come too near to it.
    clearance: distances between the motions and the fixtures; None for a job without fixtures.
    """

    gouges: tuple[Fault, ...]
    corners: tuple[Fault, ...]
    rapids: tuple[Fault, ...]
    holders: tuple[Fault, ...]
    spindles: tuple[Fault, ...]
    unheld: tuple[Fault, ...]
    loose: tuple[Fault, ...]
    levels: tuple[Level, ...]
    volumes: tuple[float, ...]
    notes: tuple[str, ...]
    set_up: SetUp
    grid: Grid | None = None
    pieces: Pieces = Pieces()
    bite: float | None = None
    fixtures: tuple[Fault, ...] = ()
    clearance: Clearance | None = None

    @property
    def faults(self) -> tuple[Fault, ...]:
        """All faults in order of cut and line."""
        cutting = (*self.gouges, *self.corners, *self.rapids, *self.holders)
        faults = (*cutting, *self.spindles, *self.unheld, *self.loose, *self.fixtures)
        return tuple(sorted(faults, key=lambda fault: (fault.cut, fault.line)))

    @property
    def refused(self) -> tuple[Fault, ...]:
        """The faults for which a program is refused: all except pieces that may come loose.

        Pieces that nothing holds come after all other faults.
        """
        cutting = (fault for fault in self.faults if fault.kind not in ("unheld", "loose"))
        return (*cutting, *self.unheld)

    @property
    def volume(self) -> float:
        """Volume that all cuts remove, mm3."""
        return float(sum(self.volumes))

    @property
    def excess(self) -> float:
        """Volume of the rest material that inner corners and tabs do not explain, mm3."""
        volumes = [
            (level.top - level.bottom) * level.excess.unexplained.area for level in self.levels
        ]
        return float(sum(volumes))


def prove(
    cuts: Sequence[Cut],
    design: Design,
    dynamics: Dynamics | None = None,
    stock: StockTable = _NO_STOCK,
    fixtures: Fixtures | None = None,
    *,
    on_arm: bool = False,
) -> StockProof:
    """Prove `cuts`, one after the other, on the stock of `design`.

    dynamics: dynamics of the controller. None: it is unknown how it rounds corners.
    stock: stock of the job, for the limits of the set-up and the hold of pieces.
    fixtures: clamps, vices and stops of a mill, which also hold pieces below them. None: the job
        has none, or an arm runs it.
    on_arm: whether an arm runs the program. Then pieces may come loose.
    """
    bites = [] if dynamics is None else find_bites(cuts, design, dynamics)
    deepest = None if dynamics is None else max((bite.mm for bite in bites), default=0.0)
    moves = tabulate(cuts)
    gone = index_motions(moves, cuts)
    holders, unseen = find_holders(gone, design)
    depths = find_levels(moves, cuts, design)
    grid: Grid | None = None
    levels: tuple[Level, ...] = ()
    if len(depths) > MAX_LEVELS + 1:
        grid = carve_grid(moves, cuts, design.outline)
        volumes = grid.volumes
    else:
        levels, volumes = remove_material(moves, cuts, design, depths)
    pieces = find_pieces(gone, design, fixtures.clamped if fixtures else None, drops=on_arm)
    freed = [_loose(moves, cuts, piece, stock, pieces.has_frame) for piece in pieces.loose]
    if not on_arm and stock.held == "frame":
        freed += [_missing(moves, cuts, tabs) for tabs in pieces.missing]
    running = follow_spindles(cuts)
    spindles = check_spindles(cuts, running)
    notes = [*design.notes, *_notes(moves, unseen)]
    if not spindles.is_judged:
        notes.append("the text sets no spindle: whether the tool rotates is not judged")
    if grid:
        notes.append(grid.note)
    clearance = examine(moves, cuts, fixtures) if fixtures else None
    if clearance:
        notes += clearance.notes
    return StockProof(
        gouges=tuple(_gouge(moves, cuts, gouge) for gouge in find_gouges(moves, cuts, design)),
        corners=tuple(_bite(cuts, bite) for bite in bites if bite.excess > TOLERANCE_MM),
        rapids=tuple(_rapid(moves, cuts, hit) for hit in find_rapids(gone, design)),
        holders=tuple(_holder(moves, cuts, hit) for hit in holders),
        spindles=tuple(_spindle(cuts, each) for each in spindles.wrong),
        unheld=tuple(fault for fault in freed if fault.kind == "unheld"),
        loose=tuple(fault for fault in freed if fault.kind == "loose"),
        levels=levels,
        volumes=volumes,
        notes=tuple(notes),
        set_up=check_set_up(gone, design, stock, running),
        grid=grid,
        pieces=pieces,
        bite=deepest,
        fixtures=_list_hits(moves, cuts, clearance) if clearance else (),
        clearance=clearance,
    )


def examine_fixtures(
    cuts: Sequence[Cut], fixtures: Fixtures
) -> tuple[Clearance, tuple[Fault, ...]]:
    """Measure the distances between the motions of `cuts` and the fixtures.

    It is for programs without a stock proof. Also returns the motions that are too near.
    """
    moves = tabulate(cuts)
    clearance = examine(moves, cuts, fixtures)
    clearance = replace(clearance, notes=(*clearance.notes, *_notes(moves, 0)))
    return clearance, _list_hits(moves, cuts, clearance)


def _notes(moves: Moves, unseen: int) -> list[str]:
    notes = []
    if moves.tilted:
        tilted = counted(moves.tilted, "motion")
        notes.append(f"not judged: {tilted} with a tool that is not straight down")
    if moves.lost:
        notes.append(f"not judged: {counted(moves.lost, 'motion')} to joint values")
    if unseen:
        deep = counted(unseen, "more motion")
        notes.append(f"not judged: {deep} as deep as those with the holder in material")
    return notes


def _fault(
    moves: Moves, cuts: Sequence[Cut], kind: FaultKind, finding: Gouge | Struck | Hit, text: str
) -> Fault:
    number, line = int(moves.cut[finding.row]), int(moves.line[finding.row])
    return Fault(kind, line, cuts[number].file, *finding.place, finding.mm, text, number)


def _at(place: tuple[float, float, float]) -> str:
    return f"at {join_short(place, 3)} mm"


def _gouge(moves: Moves, cuts: Sequence[Cut], gouge: Gouge) -> Fault:
    where = "too deep in" if gouge.below else "into"
    return _fault(
        moves,
        cuts,
        "gouge",
        gouge,
        f"cuts {short(gouge.mm, 3)} mm {where} material that must stay, {_at(gouge.place)}",
    )


def _bite(cuts: Sequence[Cut], bite: Bite) -> Fault:
    return Fault(
        "corner",
        bite.line,
        cuts[bite.cut].file,
        *bite.place,
        bite.mm,
        f"the corner {_at(bite.place)} is rounded and cuts {short(bite.mm, 3)} mm into material "
        f"that must stay, {short(bite.allowed, 3)} mm are allowed",
        bite.cut,
    )


def _spindle(cuts: Sequence[Cut], wrong: WrongSpindle) -> Fault:
    speed = f"{short(wrong.speed, 0)} rpm"
    states = {
        "at rest": "with the spindle at rest",
        "to the left": f"with the spindle to the left (M4, {speed})",
        "too fast": f"at {speed}, more than tool.max_speed",
    }
    return Fault(
        "spindle",
        wrong.line,
        cuts[wrong.cut].file,
        *wrong.place,
        0.0,
        f"cuts {short(wrong.depth, 3)} mm deep {states[wrong.state]}, {_at(wrong.place)}",
        wrong.cut,
    )


def _rapid(moves: Moves, cuts: Sequence[Cut], hit: Struck) -> Fault:
    return _fault(
        moves,
        cuts,
        "rapid",
        hit,
        f"rapid motion through material, {short(hit.depth, 3)} mm below the top, {_at(hit.place)}",
    )


def _holder(moves: Moves, cuts: Sequence[Cut], hit: Struck) -> Fault:
    return _fault(
        moves,
        cuts,
        "holder",
        hit,
        f"the holder is {short(hit.depth, 3)} mm deep in material, {_at(hit.place)}",
    )


def _list_hits(moves: Moves, cuts: Sequence[Cut], clearance: Clearance) -> tuple[Fault, ...]:
    return tuple(_hit(moves, cuts, hit, clearance.margin) for hit in clearance.hits)


def _hit(moves: Moves, cuts: Sequence[Cut], hit: Hit, margin: float) -> Fault:
    if hit.mm:
        text = f"the {hit.body} runs {short(hit.mm, 3)} mm deep into fixture {hit.fixture}"
    else:
        text = (
            f"the {hit.body} passes fixture {hit.fixture} {short(hit.gap, 3)} mm apart, "
            f"cell.margin asks for {short(margin, 3)} mm"
        )
    fault = _fault(moves, cuts, "fixture", hit, f"{text}, {_at(hit.place)}")
    return replace(fault, fixture=hit.fixture)


def _loose(
    moves: Moves, cuts: Sequence[Cut], piece: Piece, stock: StockTable, has_frame: bool
) -> Fault:
    """Make the fault of a piece that comes loose; it is refused for a part or a piece with tabs."""
    length, width = piece.size
    within = f"within {piece.contour}" if piece.contour else "outside of all contours"
    name = f"the part {within}"
    if piece.kind == "slug":
        name = f"a slug of {short(length, 1)} x {short(width, 1)} mm {within}"
    z = float(moves.end[piece.row, 2])
    place = f", {_at((*piece.place, z))}"
    is_held = stock.held != "frame" and not piece.drops
    must_hold = not is_held and not piece.drops and (piece.kind == "part" or piece.tabs)
    if is_held:
        text = f"{name} is cut free{place}: {stock.held} holds it"
    elif piece.again >= 0:
        again = int(moves.line[piece.again])
        text = f"{name} comes loose before its last cut, which begins at line {again}{place}"
    else:
        text = f"{name} comes loose at its last cut{place}"
    if must_hold and not has_frame:
        text += ": the kerfs leave no frame of the stock that could hold it"
    elif must_hold:
        text += ": no tab is left that holds it" if piece.tabs else ": nothing holds it"
    freed = Struck(piece.row, (*piece.place, z), 0.0, 0.0)
    fault = _fault(moves, cuts, "unheld" if must_hold else "loose", freed, text)
    is_serious = must_hold or piece.again >= 0 or piece.tabs
    return replace(fault, serious=is_serious and not is_held)


def _missing(moves: Moves, cuts: Sequence[Cut], tabs: MissingTabs) -> Fault:
    text = f"{counted(tabs.count, 'tab')} on {tabs.contour}, the job asks for {tabs.wanted}"
    position = Struck(tabs.row, to_vec3(moves.end[tabs.row]), 0.0, 0.0)
    return _fault(moves, cuts, "unheld", position, text)
