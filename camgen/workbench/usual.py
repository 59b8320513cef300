"""Defaults that depend on the input, the controller or other settings of the job."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from camgen.lower.runs import plunge
from camgen.model.errors import CamgenError
from camgen.model.job import Job
from camgen.model.job_tables import defaults_beside
from camgen.model.pose import Pose, compute_fixed_xyz
from camgen.motion.corners import compute_corner_tolerance
from camgen.order.tours import ArmTour, EdgeTour
from camgen.pipeline import Result
from camgen.plan import find_operation
from camgen.post.plugins import dynamics_of

#: Defaults by table, then by key.
Defaults = dict[str, dict[str, object]]


def list_defaults(tables: Mapping[str, Any]) -> Defaults:
    """The defaults that follow from the tables of a job alone."""
    defaults: Defaults = {}
    for (table, key), value in defaults_beside(tables).items():
        defaults.setdefault(table, {})[key] = value
    return defaults


def find_defaults(result: Result) -> Defaults:
    """The defaults of a build: the values for settings that the job leaves out."""
    job = result.job
    defaults: Defaults = {
        "cell": _find_cell_defaults(result, job),
        "process": _find_process_defaults(result, job),
    }
    kind = _find_kind(result, job)
    if kind:
        defaults["operation"] = {"kind": kind}
        unset = replace(job, tolerance=replace(job.tolerance, corner=None))
        defaults["tolerance"] = {"corner": round(compute_corner_tolerance(unset, kind), 6)}
    return defaults


def _find_kind(result: Result, job: Job) -> str:
    """The default operation of such a part; "" without one, and for a job with `[[operations]]`."""
    if job.operations:
        return ""
    unset = replace(job, operation=replace(job.operation, kind="auto"))
    try:
        return find_operation(result.part, unset).name
    except CamgenError:
        return ""


def _find_process_defaults(result: Result, job: Job) -> dict[str, object]:
    process = job.process
    unset = replace(job, process=replace(process, acceleration=None))
    defaults: dict[str, object] = {}
    if result.cell.machine is None:
        defaults["acceleration"] = dynamics_of(result.post, unset).acceleration
    defaults["plunge"] = round(plunge(replace(process, plunge=None)), 6)
    # The joint speeds limit the links of an arm.
    if not isinstance(result.tour, (ArmTour, EdgeTour)):
        defaults["travel"] = replace(process, travel=None).travel_speed
    return defaults


def _find_cell_defaults(result: Result, job: Job) -> dict[str, object]:
    """The frames and the home of the cell that the job does not set."""
    cell, settings = result.cell, job.cell
    defaults: dict[str, object] = {}
    for key, frame in (
        ("base_from_work", cell.base_from_work),
        ("flange_from_tool", cell.flange_from_tool),
    ):
        if getattr(settings, key) is None:
            angles = map(math.degrees, compute_fixed_xyz(frame.rotation))
            defaults[key] = _round([*frame.origin, *angles])
    if settings.home is None and isinstance(cell.home, Pose):
        defaults["home"] = _round(cell.home.origin)
    elif settings.home is None and not isinstance(cell.home, Pose):
        values = enumerate(cell.home.values)
        defaults["home"] = _round([v if k in cell.sliding else math.degrees(v) for k, v in values])
    return defaults


def _round(values: Any) -> list[float]:
    return [round(float(value), 4) + 0.0 for value in values]
