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
from typing import Any
from unittest.mock import patch

from msgspec import Struct

import camgen
from bench.check import peer
from bench.support.runner import SHARED, Table, find_files, machine
from camgen.check.stock import TOLERANCE_MM, Cut, Design, Level, StockProof, prove
from camgen.cli.init import Chosen, template
from camgen.model.job import InputTable, Job
from camgen.plan.propose import propose
from camgen.read import read
from camgen.read.files import Files
from tests.support import rs274

#: Gouges are told from here on, mm; coordinates are printed to 0.001 mm.
FINE_MM = 0.001
COLUMNS = (
    "drawing | closed loops | in no operation | operations | tools | rs274 | gouge mm "
    "| left unexplained mm2 | left in corners, tabs mm2 | loose early | camgen min | build s "
    "| peer min | peer gouge mm | peer left unexplained mm2 | peer loose early | peer s"
)


class Row(Struct, frozen=True):
    """One drawing. cells: as ``COLUMNS`` names them, fewer where it has no program. bad: it misses a goal. minutes: of
    both programs, 0 for what is not there. built: it has a program. unexplained: mm2 at the worst level. loose: parts.
    """

    cells: tuple[str, ...]
    bad: bool = False
    minutes: tuple[float, float] = (0.0, 0.0)
    built: bool = False
    unexplained: float = 0.0
    loose: int = 0


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
        return Row((name, str(loops), "none that a drill, or a mill of 1 mm or more, could make"))
    cells = (
        name,
        str(loops),
        str(len(proposal.left)),
        str(len(proposal.operations)),
        str(len(proposal.tools)),
    )
    job = tomllib.loads(template(part.source, part.units, Chosen(proposal=proposal, active=True)))
    with _remember() as proven:
        begun = time.perf_counter()
        try:
            result = camgen.build(part, post="gcode", job=job)
        except camgen.CamgenError as error:
            if "input.units" in str(error) and units == "auto":
                return judge(path, alone, "mm")
            return Row((*cells, f"not built: {error}"), bad=bool(proven))
        seconds = time.perf_counter() - begun
    return _compare(result, proven[0], seconds, cells, alone)


def _compare(
    result: camgen.Result, proven: Proven, seconds: float, cells: tuple[str, ...], alone: bool
) -> Row:
    refused = _refuse(result)
    proof = prove_finely(proven)
    ours = peer.minutes(peer.at_the_part(result), result)
    found = peer.Peer() if alone else peer.run(result)
    theirs = prove_finely(Proven(found.cuts, proven.design)) if found.cuts else None
    row = (
        *cells,
        refused or "accepts",
        *_figures(proof),
        f"{ours:.2f}",
        f"{seconds:.2f}",
        *_theirs(found, theirs),
    )
    gouged = any(one.mm > TOLERANCE_MM for one in proof.gouges)
    unexplained = max(map(_unexplained, proof.levels), default=0.0)
    loose = sum(one.serious for one in proof.loose)
    bad = gouged or bool(refused and rs274.RS274)
    return Row(row, bad, (ours, found.minutes), True, unexplained, loose)


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


def _figures(proof: StockProof) -> tuple[str, str, str, str]:
    gouge = max((one.mm for one in proof.gouges), default=0.0)
    explained = max(
        (level.excess.corners + level.excess.tabs for level in proof.levels), default=0.0
    )
    loose = sum(one.serious for one in proof.loose)
    unexplained = max(map(_unexplained, proof.levels), default=0.0)
    return f"{gouge:.3f}", f"{unexplained:.2f}", f"{explained:.1f}", str(loose)


def _unexplained(level: Level) -> float:
    return float(level.excess.unexplained.area)


def _theirs(found: peer.Peer, proof: StockProof | None) -> tuple[str, ...]:
    if proof is None:
        return (found.why or "-", "", "", "", "")
    gouge, unexplained, _, loose = _figures(proof)
    return f"{found.minutes:.2f}", gouge, unexplained, loose, f"{found.seconds:.1f}"


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
            table.add(*(cell.replace("|", "/") for cell in row.cells))
            rows.append(row)
    _sum_up(rows, len(files))
    return int(any(row.bad for row in rows))


def _sum_up(rows: Sequence[Row], files: int) -> None:
    built = [row for row in rows if row.built]
    both = [row.minutes for row in built if row.minutes[1]]
    figures = {
        "drawings": files,
        "not read": sum(len(row.cells) == 2 for row in rows),
        "with closed loops": sum(len(row.cells) > 2 for row in rows),
        "built": len(built),
        "miss a goal": sum(row.bad for row in rows),
        "with more left than corners and tabs explain": sum(
            row.unexplained >= 0.01 for row in built
        ),
        "with parts loose early": sum(row.loose > 0 for row in built),
        "minutes of those with both": f"{sum(a for a, _ in both):.1f}",
        "minutes of the peer": f"{sum(b for _, b in both):.1f}",
        "with both": len(both),
    }
    Table(" | ".join(figures)).add(*figures.values())


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "alone"]
    folder = Path(words[0]) if words else SHARED / "dxf"
    sys.exit(main(folder, words[1:], "alone" in sys.argv[1:]))
