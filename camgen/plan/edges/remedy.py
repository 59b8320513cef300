"""What would help an edge that cannot be processed: settings that are tried one after the other, none guessed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from msgspec.structs import replace

from camgen.model.advice import ANOTHER_PLACE
from camgen.model.job import Job, ToolTable
from camgen.model.part import Note
from camgen.model.text import short
from camgen.motion.setup import EdgeMotion, UnreachableEdge

#: So many edges are looked at: each costs as much as several that are reached.
_MOST = 8
#: deg: tilts that are tried where the job has less, the largest with any roll.
_TILTS = (15.0, 30.0)
#: Tries edges, by their ids, with the settings of a job. It returns at least those with a motion.
Attempt = Callable[[Job, Sequence[str]], Sequence[EdgeMotion | UnreachableEdge]]


def remedies(
    lost: Sequence[UnreachableEdge], job: Job, attempt: Attempt, noun: str = "edge"
) -> tuple[list[UnreachableEdge], list[Note]]:
    """``lost`` with what would help each of its first, and a note where there are more."""
    able = [one.id for one in lost if one.kind != "shape"]
    tried = able[:_MOST]
    helps = _other_tools(tried, _freedoms(job), attempt)
    place = ANOTHER_PLACE if noun == "edge" else "another place"
    vain = f"no roll and no tilt up to 30 deg helps: {place} may"
    told = [
        replace(edge, remedy=helps.get(edge.id, vain) if edge.id in tried else "") for edge in lost
    ]
    rest = len(able) - len(tried)
    if not rest:
        return told, []
    what = f"what would help was looked for with the first {len(tried)} {noun}s that are left out, not with {rest} more"
    return told, [Note("assumed", what)]


def _other_tools(
    names: Sequence[str], freedoms: Sequence[tuple[Job, str]], attempt: Attempt
) -> dict[str, str]:
    """By id the least freedom of the tool that reaches the whole edge."""
    found: dict[str, str] = {}
    for job, words in freedoms:
        left = [name for name in names if name not in found]
        made = attempt(job, left) if left else ()
        found |= {one.id: f"{words} reaches it" for one in made if isinstance(one, EdgeMotion)}
    return found


def _freedoms(job: Job) -> list[tuple[Job, str]]:
    """Jobs with more freedom for the tool, the least first, and how that is written in a job."""
    tilts = [tilt for tilt in _TILTS if tilt > job.tool.axis_tilt]
    tools = [
        (replace(job.tool, axis_tilt=tilt), f"tool.axis_tilt = {short(tilt, 0)}") for tilt in tilts
    ]
    if not job.tool.symmetric:
        turned = [(_free(tool), f"{words} with tool.symmetric = true") for tool, words in tools]
        tools = [(_free(job.tool), "tool.symmetric = true"), *tools[:1], *turned]
    return [(replace(job, tool=tool), words) for tool, words in tools]


def _free(tool: ToolTable) -> ToolTable:
    """``tool`` with any turn about its axis."""
    return replace(tool, symmetric=True, turn=None)
