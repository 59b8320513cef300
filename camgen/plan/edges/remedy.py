"""Finds remedies for edges that cannot be processed, by trying settings one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec.structs import replace

from camgen.model.advice import ANOTHER_PLACE
from camgen.model.job import Job, ToolTable
from camgen.model.part import Note
from camgen.model.text import short
from camgen.motion.setup import EdgeMotion, UnreachableEdge

#: Maximum number of edges that are tried. One takes as long as several reachable edges.
_MAX_TRIED = 8
#: Tilts to try if the job has a smaller one, deg.
_TILTS = (15.0, 30.0)
#: Tries edges, by their ids, with the settings of a job. It returns at least those with a motion.
Attempt = Callable[[Job, Sequence[str]], Sequence[EdgeMotion | UnreachableEdge]]


def find_remedies(
    lost: Sequence[UnreachableEdge], job: Job, attempt: Attempt, noun: str = "edge"
) -> tuple[list[UnreachableEdge], list[Note]]:
    """The edges `lost` with a remedy each, and a note if only the first were tried."""
    able = [edge.id for edge in lost if edge.kind != "shape"]
    tried = able[:_MAX_TRIED]
    helps = _try_freedoms(tried, _list_freedoms(job), attempt)
    place = ANOTHER_PLACE if noun == "edge" else "another place"
    no_help = f"no roll and no tilt up to 30 deg helps: {place} may"
    remedies = dict.fromkeys(tried, no_help) | helps
    remedied = [replace(edge, remedy=remedies.get(edge.id, "")) for edge in lost]
    untried = len(able) - len(tried)
    if not untried:
        return remedied, []
    count = f"the first {len(tried)} {noun}s that are left out, not with {untried} more"
    return remedied, [Note("assumed", f"what would help was looked for with {count}")]


def _try_freedoms(
    names: Sequence[str], freedoms: Sequence[tuple[Job, str]], attempt: Attempt
) -> dict[str, str]:
    """For each edge that can be reached as a whole, the smallest freedom that is enough."""
    helps: dict[str, str] = {}
    for job, words in freedoms:
        untried = [name for name in names if name not in helps]
        for result in attempt(job, untried) if untried else ():
            if isinstance(result, EdgeMotion):
                helps[result.id] = f"{words} reaches it"
    return helps


def _list_freedoms(job: Job) -> list[tuple[Job, str]]:
    """Jobs with more freedom of the tool, the smallest first, each with its settings as text."""
    tools = []
    for tilt in _TILTS:
        if tilt > job.tool.axis_tilt:
            tool = replace(job.tool, axis_tilt=tilt)
            tools.append((tool, f"tool.axis_tilt = {short(tilt, 0)}"))
    if not job.tool.symmetric:
        free = [(_free_roll(tool), f"{words} with tool.symmetric = true") for tool, words in tools]
        tools = [(_free_roll(job.tool), "tool.symmetric = true"), *tools[:1], *free]
    return [(replace(job, tool=tool), words) for tool, words in tools]


def _free_roll(tool: ToolTable) -> ToolTable:
    return replace(tool, symmetric=True, turn=None)
