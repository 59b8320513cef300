"""What holds where the job is silent: defaults that hang on the input, the controller or other settings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lower.runs import plunge
from camgen.model.errors import CamgenError
from camgen.model.job import Job
from camgen.model.job_tables import defaults_beside
from camgen.model.pose import Pose, fixed_xyz
from camgen.motion.corners import compute_corner_tolerance
from camgen.order.tours import ArmTour, EdgeTour
from camgen.pipeline import Result
from camgen.plan import find_operation
from camgen.post.plugins import dynamics_of

#: By table, then by key.
Usual = dict[str, dict[str, object]]


def usual_of(tables: Mapping[str, Any]) -> Usual:
    """What the tables of a job alone say."""
    found: Usual = {}
    for (table, key), value in defaults_beside(tables).items():
        found.setdefault(table, {})[key] = value
    return found


def usual_in(result: Result) -> Usual:
    """What held in a build, as if the job had said nothing of it."""
    job = result.job
    found: Usual = {"cell": _of_cell(result, job), "process": _of_process(result, job)}
    kind = _find_kind(result, job)
    if kind:
        found["operation"] = {"kind": kind}
        silent = replace(job, tolerance=replace(job.tolerance, corner=None))
        found["tolerance"] = {"corner": round(compute_corner_tolerance(silent, kind), 6)}
    return found


def _find_kind(result: Result, job: Job) -> str:
    """What is done to such a part; "" where rows say it."""
    if job.operations:
        return ""
    try:
        return find_operation(
            result.part, replace(job, operation=replace(job.operation, kind="auto"))
        ).name
    except CamgenError:  # for such a part a kind has to be named
        return ""


def _of_process(result: Result, job: Job) -> dict[str, object]:
    process = job.process
    silent = replace(job, process=replace(process, acceleration=None))
    found: dict[str, object] = {}
    if result.cell.machine is None:
        found["acceleration"] = dynamics_of(result.post, silent).acceleration
    found["plunge"] = round(plunge(replace(process, plunge=None)), 6)
    if not isinstance(result.tour, (ArmTour, EdgeTour)):  # there the joints decide
        found["travel"] = replace(process, travel=None).travel_speed
    return found


def _of_cell(result: Result, job: Job) -> dict[str, object]:
    """Frames and home of the cell, but those that the job names."""
    cell, own = result.cell, job.cell
    found: dict[str, object] = {}
    for key, frame in (
        ("base_from_work", cell.base_from_work),
        ("flange_from_tool", cell.flange_from_tool),
    ):
        if getattr(own, key) is None:
            found[key] = _round([*frame.origin, *map(math.degrees, fixed_xyz(frame.rotation))])
    if own.home is None and isinstance(cell.home, Pose):
        found["home"] = _round(cell.home.origin)
    elif own.home is None and not isinstance(cell.home, Pose):
        values = enumerate(cell.home.values)
        found["home"] = _round([v if k in cell.sliding else math.degrees(v) for k, v in values])
    return found


def _round(values: Any) -> list[float]:
    return [round(float(value), 4) + 0.0 for value in values]
