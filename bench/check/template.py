"""The job that ``camgen init --operations`` proposes, for every drawing, beside FreeCAD's.

    python -m bench.check.template [FOLDER] [NAME ...] [alone]

Circles are drilled, the rest is cut with tabs. Programs are for LinuxCNC. NAME chooses drawings by
their names in the table; all of FOLDER without one. With `alone` the peer is left out. Exits with 1
if LinuxCNC's own interpreter refuses a program, or a program would cut more than 0.005 mm into what
must stay.
"""

from __future__ import annotations

import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import camgen
from bench.check import peer
from bench.support.runner import SHARED, Cells, Missed, Scenario, Table, fill, find_files, machine
from camgen.check.stock import TOLERANCE_MM, Cut, Design, StockProof, prove
from camgen.cli.init import Chosen, write_template
from camgen.model.job import InputTable, Job
from camgen.plan.propose import propose
from camgen.read import read
from camgen.read.files import Files
from tests.support import rs274

#: Depth from which a gouge is listed, mm; coordinates are printed to 0.001 mm.
FINE_MM = 0.001
COLUMNS = (
    "drawing | closed loops | in no operation | rs274 | gouge mm {:.3f} "
    "| left unexplained mm2 {:.2f} | loose early | camgen min {:.2f} | build s {:.2f} "
    "| peer min {:.2f} | peer gouge mm {:.3f} | peer loose early | peer s {:.1f}"
)
#: Sums of all drawings.
TOTALS = (
    "drawings",
    "not read",
    "with closed loops",
    "built",
    "with more left than corners and tabs explain",
    "with parts loose early",
    "with both",
    "minutes of those with both",
    "minutes of the peer",
)


class Figures(NamedTuple):
    """Figures of a proof.

    gouge: depth of the deepest gouge, mm.
    unexplained: material that is left without a reason at the worst level, mm2.
    loose: number of parts that come loose too early.
    """

    gouge: float
    unexplained: float
    loose: int


def measure(name: str, path: Path, alone: bool, totals: Counter[str]) -> Iterator[Cells]:
    """The row of a drawing; none if it has no closed loop. Counts it in the totals."""
    totals["drawings"] += 1
    units = "auto"
    try:
        part = read(path, Job(), Files())
    except camgen.CamgenError as error:
        if any(kind in path.read_bytes() for kind in (b"CIRCLE", b"POLYLINE")):
            totals["not read"] += 1
            yield name, f"not read: {error}"
        return
    loops = sum(contour.closed for contour in part.contours)
    if not loops:
        return
    totals["with closed loops"] += 1
    try:
        row = _measure_build(part, alone, totals)
    except camgen.CamgenError as error:
        if "input.units" not in str(error):
            raise
        units = "mm"
        part = read(path, Job(input=InputTable(units=units)), Files())
        row = _measure_build(part, alone, totals)
    yield name if units == "auto" else f"{name} as {units}", loops, *row


def _measure_build(part: camgen.Part, alone: bool, totals: Counter[str]) -> Sequence[object]:
    """The cells of a program, and of the peer's programs."""
    proposal = propose(part)
    if proposal is None:
        return ("none that a drill, or a mill of 1 mm or more, could make",)
    text = write_template(part.source, part.units, Chosen(proposal=proposal, active=True))
    with _record_proofs() as proofs:
        start = time.perf_counter()
        try:
            result = camgen.build(part, post="gcode", job=tomllib.loads(text))
        except camgen.CamgenError as error:
            if "input.units" in str(error):
                raise
            refusal = f"not built: {error}"
            return len(proposal.left), Missed(refusal) if proofs else refusal
        seconds = time.perf_counter() - start
    cuts, wanted = proofs[0]
    figures = measure_proof(cuts, wanted)
    minutes = peer.measure_minutes(peer.list_bodies(result), result)
    totals["built"] += 1
    totals["with more left than corners and tabs explain"] += figures.unexplained >= 0.01
    totals["with parts loose early"] += figures.loose > 0
    gouge = figures.gouge
    cell = Missed(f"{gouge:.3f}") if gouge > TOLERANCE_MM else gouge
    cells = [len(proposal.left), run_rs274(result), cell, *figures[1:], minutes, seconds]
    other = peer.Peer() if alone else peer.run(result)
    if not other.cuts:
        return [*cells, other.why or "-"]
    theirs = measure_proof(other.cuts, wanted)
    totals["with both"] += 1
    totals["minutes of those with both"] += minutes
    totals["minutes of the peer"] += other.minutes
    return [*cells, other.minutes, theirs.gouge, theirs.loose, other.seconds]


@contextmanager
def _record_proofs() -> Iterator[list[tuple[Sequence[Cut], Design]]]:
    """The arguments of all stock proofs meanwhile."""
    recorded: list[tuple[Sequence[Cut], Design]] = []

    def record(cuts: Sequence[Cut], design: Design, *settings: Any, **more: Any) -> StockProof:
        recorded.append((cuts, design))
        return prove(cuts, design, *settings, **more)

    with patch.object(sys.modules["camgen.check.stock"], "prove", record):
        yield recorded


def measure_proof(cuts: Sequence[Cut], wanted: Design) -> Figures:
    """The figures of a proof that lists gouges from ``FINE_MM`` on."""
    with patch.object(sys.modules["camgen.check.stock.gouge"], "TOLERANCE_MM", FINE_MM):
        proof = prove(cuts, wanted)
    excesses = [level.excess for level in proof.levels]
    return Figures(
        max((fault.mm for fault in proof.gouges), default=0.0),
        max((float(excess.unexplained.area) for excess in excesses), default=0.0),
        sum(piece.serious for piece in proof.loose),
    )


def run_rs274(result: camgen.Result) -> str:
    """The verdict of LinuxCNC's interpreter."""
    if rs274.RS274 is None:
        return "not installed"
    # Lengths of 0: the program is judged by its own coordinates.
    rows = [f"T{tool.number} P{tool.number} Z0 D{tool.diameter}\n" for tool in result.job.tools]
    error = " ".join(rs274.run(result.text, "".join(rows)).error.split())
    return Missed(error[:80]) if error else "accepts"


def main(folder: Path, names: Sequence[str], alone: bool) -> int:
    """Prints the tables; 1 if a drawing misses a goal."""
    files = {f"{path.parent.name}/{path.name}": path for path in find_files(folder, (".dxf",))}
    print(f"{machine()}\n\npeer: {'none' if alone else peer.LACKING or 'FreeCAD'}")
    totals: Counter[str] = Counter()
    inputs = [(name, path) for name, path in files.items() if name in (names or [name])]
    table = fill(Scenario(COLUMNS, inputs, partial(measure, alone=alone, totals=totals)))
    sums = [f"{totals[name]:g}" for name in TOTALS]
    Table(f"{' | '.join(TOTALS)} | miss a goal").add(*sums, table.missed)
    return int(table.missed > 0)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "alone"]
    folder = Path(words[0]) if words else SHARED / "dxf"
    sys.exit(main(folder, words[1:], "alone" in sys.argv[1:]))
