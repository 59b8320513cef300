"""One template job for every drawing: what is round and small drilled, the rest cut with tabs, judged and timed.

    python -m bench.check.template [FOLDER] [NAME ...] [alone]

The job of a drawing is the one that ``camgen init --operations`` writes, built for LinuxCNC. NAME: drawings, as the
table names them; all of FOLDER without one. alone: without the peer. Exits with 1 where LinuxCNC's own interpreter
refuses a program, or one would cut more than 0.005 mm into what must stay.
"""

from __future__ import annotations

import sys
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

from msgspec import Struct

import camgen
from bench.check import peer
from bench.support.runner import SHARED, Table, find_files, machine
from camgen.check.stock import TOLERANCE_MM, Cut, Design, StockProof, prove
from camgen.cli.init import Chosen, write_template
from camgen.model.job import InputTable, Job
from camgen.plan.propose import propose
from camgen.read import read
from camgen.read.files import Files
from tests.support import rs274

#: Gouges are told from here on, mm; coordinates are printed to 0.001 mm.
FINE_MM = 0.001
COLUMNS = (
    "drawing | closed loops | in no operation | operations | tools | rs274 | gouge mm {:.3f} "
    "| left unexplained mm2 {:.2f} | left in corners, tabs mm2 {:.1f} | loose early "
    "| camgen min {:.2f} | build s {:.2f} | peer min {:.2f} | peer gouge mm {:.3f} "
    "| peer left unexplained mm2 {:.2f} | peer loose early | peer s {:.1f}"
)


class Figures(NamedTuple):
    """Figures of a proof.

    gouge: depth of the deepest, mm.
    unexplained: material that is left without a reason at the worst level, mm2.
    explained: material that is left in corners and for tabs at the worst level, mm2.
    loose: number of parts that come loose too early.
    """

    gouge: float
    unexplained: float
    explained: float
    loose: int


class Row(NamedTuple):
    """A drawing.

    cells: as `COLUMNS` names them, fewer if it has no program.
    is_bad: whether it misses a goal.
    minutes: times of the program and of that of the peer, 0 without one.
    figures: those of the program, None without one.
    """

    cells: tuple[object, ...]
    is_bad: bool = False
    minutes: tuple[float, float] = (0.0, 0.0)
    figures: Figures | None = None


class Proven(Struct, frozen=True, eq=False):
    """What a proof looks at."""

    cuts: Sequence[Cut]
    design: Design


def judge(path: Path, alone: bool, units: str = "auto") -> Row | None:
    """The row of one drawing; None where it has no closed loop."""
    name = f"{path.parent.name}/{path.name}{'' if units == 'auto' else f' as {units}'}"
    try:
        part = read(path, Job(input=InputTable(units=units)), Files())
    except camgen.CamgenError as error:
        may_be_closed = any(kind in path.read_bytes() for kind in (b"CIRCLE", b"POLYLINE"))
        return Row((name, f"not read: {error}")) if may_be_closed else None
    loops = sum(contour.closed for contour in part.contours)
    if not loops:
        return None
    proposal = propose(part)
    if proposal is None:
        return Row((name, loops, "none that a drill, or a mill of 1 mm or more, could make"))
    counts = len(proposal.left), len(proposal.operations), len(proposal.tools)
    cells = (name, loops, *counts)
    job = tomllib.loads(
        write_template(part.source, part.units, Chosen(proposal=proposal, active=True))
    )
    with _remember() as proven:
        begun = time.perf_counter()
        try:
            result = camgen.build(part, post="gcode", job=job)
        except camgen.CamgenError as error:
            if "input.units" in str(error) and units == "auto":
                return judge(path, alone, "mm")
            return Row((*cells, f"not built: {error}"), is_bad=bool(proven))
        seconds = time.perf_counter() - begun
    return _compare(result, proven[0], seconds, cells, alone)


def _compare(
    result: camgen.Result, proven: Proven, seconds: float, cells: tuple[object, ...], alone: bool
) -> Row:
    refused = _refuse(result)
    proof = prove_finely(proven)
    figures = measure(proof)
    ours = peer.minutes(peer.at_the_part(result), result)
    found = peer.Peer() if alone else peer.run(result)
    theirs: tuple[object, ...] = (found.why or "-",)
    if found.cuts:
        gouge, unexplained, _, loose = measure(prove_finely(Proven(found.cuts, proven.design)))
        theirs = found.minutes, gouge, unexplained, loose, found.seconds
    cells = (*cells, refused or "accepts", *figures, ours, seconds, *theirs)
    is_gouged = any(fault.mm > TOLERANCE_MM for fault in proof.gouges)
    is_bad = is_gouged or bool(refused and rs274.RS274)
    return Row(cells, is_bad, (ours, found.minutes), figures)


@contextmanager
def _remember() -> Iterator[list[Proven]]:
    """What the proofs of builds look at."""
    kept: list[Proven] = []

    def keep(cuts: Sequence[Cut], design: Design, *settings: Any, **more: Any) -> StockProof:
        kept.append(Proven(cuts, design))
        return prove(cuts, design, *settings, **more)

    with patch.object(sys.modules["camgen.check.stock"], "prove", keep):
        yield kept


def prove_finely(proven: Proven) -> StockProof:
    """The proof that tells gouges from ``FINE_MM`` on."""
    with patch.object(sys.modules["camgen.check.stock.gouge"], "TOLERANCE_MM", FINE_MM):
        return prove(proven.cuts, proven.design)


def _refuse(result: camgen.Result) -> str:
    """What LinuxCNC's interpreter says against the program; "" where it accepts it."""
    if rs274.RS274 is None:
        return "not installed"
    # Lengths of 0: the program is judged by its own coordinates.
    tools = "".join(
        f"T{tool.number} P{tool.number} Z0 D{tool.diameter}\n" for tool in result.job.tools
    )
    return " ".join(rs274.run(result.text, tools).error.split())[:80]


def measure(proof: StockProof) -> Figures:
    """The figures of a proof."""
    excesses = [level.excess for level in proof.levels]
    return Figures(
        max((fault.mm for fault in proof.gouges), default=0.0),
        max((float(excess.unexplained.area) for excess in excesses), default=0.0),
        max((excess.corners + excess.tabs for excess in excesses), default=0.0),
        sum(piece.serious for piece in proof.loose),
    )


def main(folder: Path, names: Sequence[str], alone: bool) -> int:
    files = find_files(folder, (".dxf",))
    files = [path for path in files if not names or f"{path.parent.name}/{path.name}" in names]
    print(machine())
    there = peer.LACKING or "FreeCAD's Path workbench"
    print(f"\npeer: {'none' if alone else there}")
    table = Table(COLUMNS)
    rows = []
    for path in files:
        row = judge(path, alone)
        if row is not None:
            table.add(*(str(c).replace("|", "/") if isinstance(c, str) else c for c in row.cells))
            rows.append(row)
    _sum_up(rows, len(files))
    return int(any(row.is_bad for row in rows))


def _sum_up(rows: Sequence[Row], files: int) -> None:
    built = [row.figures for row in rows if row.figures]
    both = [row.minutes for row in rows if row.minutes[1]]
    figures = {
        "drawings": files,
        "not read": sum(len(row.cells) == 2 for row in rows),
        "with closed loops": sum(len(row.cells) > 2 for row in rows),
        "built": len(built),
        "miss a goal": sum(row.is_bad for row in rows),
        "with more left than corners and tabs explain": sum(f.unexplained >= 0.01 for f in built),
        "with parts loose early": sum(f.loose > 0 for f in built),
        "minutes of those with both": f"{sum(ours for ours, _ in both):.1f}",
        "minutes of the peer": f"{sum(theirs for _, theirs in both):.1f}",
        "with both": len(both),
    }
    Table(" | ".join(figures)).add(*figures.values())


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "alone"]
    folder = Path(words[0]) if words else SHARED / "dxf"
    sys.exit(main(folder, words[1:], "alone" in sys.argv[1:]))
