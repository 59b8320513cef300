"""Planners: a Part to ToolPaths. One function per file."""

from __future__ import annotations

from dataclasses import dataclass

from camgen.paths import ToolPath
from camgen.settings import Job
from camgen.shapes import Note, Part


@dataclass(frozen=True, slots=True)
class Plan:
    """The paths of a part in the order of its contours, and what the planner left out or wants known."""

    paths: tuple[ToolPath, ...]
    notes: tuple[Note, ...]


def plan(part: Part, job: Job) -> Plan:
    """The tool paths of ``part`` as ``job`` asks for them."""
    if job.operation.kind == "trace" or job.operation.side == "on":
        from camgen.planners.trace import trace  # noqa: PLC0415 (shapely is loaded only by what needs it)

        return Plan(trace(part, job), ())
    from camgen.planners.follow import follow  # noqa: PLC0415

    paths, notes = follow(part, job)
    return Plan(paths, notes)
