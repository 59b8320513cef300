"""Fixtures of a mill in a build: paths that they block, and motions that come too near to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from camgen.model.errors import Blocked, BlockedPath, NoSafeProgram
from camgen.model.job import Job
from camgen.model.path import Tour
from camgen.model.program import Comment, Program, pack
from camgen.order import ReplayTour
from camgen.pipeline.stock import MOVE_FIXTURE, StatedProgram, make_cuts, make_text_cuts
from camgen.plan import Plan
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.stock import Clearance, StockProof
    from camgen.pipeline.programs import PostedText, Request


def leave_out_blocked(plan: Plan, job: Job, cell: Workcell | None) -> Plan:
    """The plan without the paths and stretches that the fixtures of a mill block."""
    if cell is None or cell.fixtures is None:
        return plan
    from camgen.plan.clear_fixtures import clear_fixtures  # noqa: PLC0415 (only with fixtures)

    return clear_fixtures(plan, job, cell.fixtures)


def check_fixtures(program: Program, tour: Tour, request: Request, source: str) -> None:
    """Raises Blocked with the paths of a program that come too near to a fixture.

    Blocked stretches are left out before. This finds motions that were added since: leads, ramps
    and links at working height. A program that was read runs as it stands: its text is judged.
    """
    fixtures = request.cell.fixtures
    if fixtures is None or isinstance(tour, ReplayTour):
        return
    from camgen.check.stock import examine_fixtures  # noqa: PLC0415 (shapely: only with fixtures)

    rows = np.flatnonzero(~program.columns.are(Comment))
    stated = pack(program.body).take(rows)
    cuts = list(make_cuts(tour, request, [StatedProgram("", stated, rows.tolist(), program)]))
    _, faults = examine_fixtures(cuts, fixtures)
    if not faults:
        return
    lost = {program.path_at(fault.line): fault for fault in faults}
    losses = tuple(BlockedPath(path, "collision", fault.text) for path, fault in lost.items())
    first = faults[0]
    raise Blocked(source, first.text, program.place_of(first.line), MOVE_FIXTURE, losses)


def prove_fixtures(
    proof: StockProof | None,
    tour: Tour,
    request: Request,
    texts: Sequence[PostedText],
) -> Clearance | None:
    """The distances of the texts from the fixtures; None for a job without fixtures.

    proof: stock proof, which has examined the fixtures too; None: nothing is cut.
    Raises NoSafeProgram for the first motion that meets one.
    """
    if proof is not None or request.cell.fixtures is None:
        return proof.clearance if proof else None
    from camgen.check.stock import examine_fixtures  # noqa: PLC0415 (shapely: only with fixtures)

    cuts = list(make_text_cuts(tour, request, texts))
    clearance, faults = examine_fixtures(cuts, request.cell.fixtures)
    if faults:
        first = faults[0]
        more = f", and {len(faults) - 1} more like it" if len(faults) > 1 else ""
        raise NoSafeProgram(first.file, f"{first.text}{more}", f"line {first.line}", MOVE_FIXTURE)
    return clearance


def report_fixtures(clearance: Clearance) -> dict[str, object]:
    """The smallest distances from the fixtures as a table of the report, mm."""
    least = {"aside_mm": clearance.aside, "above_mm": clearance.above}
    known = {key: None if np.isinf(mm) else round(mm, 3) for key, mm in least.items()}
    return {"fixtures": {"examined": clearance.fixtures, "margin_mm": clearance.margin, **known}}
