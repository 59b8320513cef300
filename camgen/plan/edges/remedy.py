"""What would help an edge that cannot be processed: settings that are tried one after the other, none guessed."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from camgen.model.job import Job, ToolTable
from camgen.model.part import Line, Note
from camgen.model.text import short
from camgen.plan.edges.motion import Reached, Unreached

#: So many edges are looked at: each costs as much as several that are reached.
_MOST = 8
#: deg: tilts that are tried where the job has less, the largest with any roll.
_TILTS = (15.0, 30.0)
#: mm: what is tried as a trim.
_TRIMS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200)
#: What is left out at the two ends, and the share of the edge that this may be.
_ENDS = (((0.0, 1.0), 0.5), ((1.0, 0.0), 0.5), ((1.0, 1.0), 0.25))


class Attempts(Struct, frozen=True, eq=False):
    """By ids. whole: what comes of edges with other settings, at least of those that come to a motion. part: whether an
    edge without so many mm at its ends comes to one. ends: whether the arm can stand where that begins and ends, as it
    must, which is known in a tenth of the time.
    """

    whole: Callable[[Job, Sequence[str]], Sequence[Reached | Unreached]]
    part: Callable[[Job, str, tuple[float, float]], bool]
    ends: Callable[[Job, str, tuple[float, float]], bool]


def remedies(
    lost: Sequence[Unreached], edges: Mapping[str, Line], job: Job, attempts: Attempts, noun: str = "edge"
) -> tuple[list[Unreached], list[Note]]:
    """``lost`` with what would help each of its first, and a note where there are more."""
    able = [one.id for one in lost if one.kind != "shape"]
    tried = able[:_MOST]
    freedoms = _freedoms(job)
    found = _other_tools(tried, freedoms, attempts)
    for name in tried:
        if trim := _trim(edges[name], job, attempts):
            found[name] = f"{found[name]}, {trim}" if name in found else trim
        elif name not in found and freedoms:
            other, words = freedoms[-1]
            if trim := _trim(edges[name], other, attempts):
                found[name] = f"{words} and {trim}"
    vain = "no roll, no tilt up to 30 deg and no trim helps: another place may"
    vain += " (camgen place)" if noun == "edge" else ""
    told = [replace(one, remedy=found.get(one.id, vain) if one.id in tried else "") for one in lost]
    rest = len(able) - len(tried)
    if not rest:
        return told, []
    what = f"what would help was looked for with the first {len(tried)} {noun}s that are left out, not with {rest} more"
    return told, [Note("assumed", what)]


def _other_tools(names: Sequence[str], freedoms: Sequence[tuple[Job, str]], attempts: Attempts) -> dict[str, str]:
    """By id the least freedom of the tool that reaches the whole edge."""
    found: dict[str, str] = {}
    for job, words in freedoms:
        left = [name for name in names if name not in found]
        made = attempts.whole(job, left) if left else ()
        found |= {one.id: f"{words} reaches it" for one in made if isinstance(one, Reached)}
    return found


def _freedoms(job: Job) -> list[tuple[Job, str]]:
    """More freedom than the tool of the job has, the least first: jobs without a trim, and how they are written."""
    tilts = [tilt for tilt in _TILTS if tilt > job.tool.axis_tilt]
    tools = [(replace(job.tool, axis_tilt=tilt), f"tool.axis_tilt = {short(tilt, 0)}") for tilt in tilts]
    if not job.tool.symmetric:
        turned = [(_free(tool), f"{words} with tool.symmetric = true") for tool, words in tools]
        tools = [(_free(job.tool), "tool.symmetric = true"), *tools[:1], *turned]
    whole = replace(job.operation, trim=0.0)
    return [(replace(job, tool=tool, operation=whole), words) for tool, words in tools]


def _free(tool: ToolTable) -> ToolTable:
    """``tool`` with any turn about its axis."""
    return replace(tool, symmetric=True, turn=None)


def _trim(edge: Line, job: Job, attempts: Attempts) -> str:
    """The trim with which least is left out at the ends of the edge, and how much; "" if none helps."""
    if edge.closed:
        return ""
    trim, missing = 0, float("inf")
    for ends, share in _ENDS:
        most = min(share * edge.length, (missing - 1) / sum(ends))
        if least := _least(edge, ends, most, job, attempts):
            trim, missing = least, least * sum(ends)
    return f"operation.trim = {trim} reaches all but {short(missing, 1)} mm" if trim > job.operation.trim else ""


def _least(edge: Line, ends: tuple[float, float], most: float, job: Job, attempts: Attempts) -> int:
    """The least trim at these ends, ``most`` mm at most; 0 where none helps."""

    def stands(trim: float) -> bool:
        return attempts.ends(job, edge.id, (trim * ends[0], trim * ends[1]))

    def reaches(trim: float) -> bool:
        return attempts.part(job, edge.id, (trim * ends[0], trim * ends[1]))

    some = [trim for trim in _TRIMS if trim <= most]
    if not some or not stands(some[-1]):
        return 0
    first = bisect_left(some, True, hi=len(some) - 1, key=stands)
    if reaches(some[first]):
        return some[first]
    more = some[first + 1 :]
    if not more or not reaches(more[-1]):
        return 0
    return more[bisect_left(more, True, hi=len(more) - 1, key=reaches)]
