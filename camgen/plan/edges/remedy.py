"""What would help an edge that cannot be processed: settings that are tried one after the other, none guessed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.halving import find_first
from camgen.model.job import Job, ToolTable
from camgen.model.part import Line, Note
from camgen.model.text import short
from camgen.motion.setup import EdgeMotion, UnreachableEdge

#: So many edges are looked at: each costs as much as several that are reached.
_MOST = 8
#: deg: tilts that are tried where the job has less, the largest with any roll.
_TILTS = (15.0, 30.0)
#: mm: what is tried as a trim.
_TRIMS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200)
#: What is left out at the two ends, and the share of the edge that this may be.
_ENDS = (((0.0, 1.0), 0.5), ((1.0, 0.0), 0.5), ((1.0, 1.0), 0.25))


#: mm that are left out at the start and at the end.
Ends = tuple[float, float]


class Attempts(Struct, frozen=True, eq=False):
    """By ids. whole: what comes of edges with other settings, at least of those that come to a motion. part: which
    edges come to one without so many mm at their ends. stands: on which the arm can stand so many mm from the start,
    or, where that is asked, from the end, as it must at both ends of what is left; it is known in a tenth of the time.
    """

    whole: Callable[[Job, Sequence[str]], Sequence[EdgeMotion | UnreachableEdge]]
    part: Callable[[Job, Mapping[str, Ends]], Sequence[bool]]
    stands: Callable[[Job, Mapping[str, float], bool], Sequence[bool]]


def remedies(
    lost: Sequence[UnreachableEdge],
    edges: Mapping[str, Line],
    job: Job,
    attempts: Attempts,
    noun: str = "edge",
) -> tuple[list[UnreachableEdge], list[Note]]:
    """``lost`` with what would help each of its first, and a note where there are more."""
    able = [one.id for one in lost if one.kind != "shape"]
    tried = able[:_MOST]
    freedoms = _freedoms(job)
    found = _other_tools(tried, freedoms, attempts)
    trims = _trim([edges[name] for name in tried], job, attempts)
    found |= {
        name: f"{found[name]}, {trim}" if name in found else trim for name, trim in trims.items()
    }
    if freedoms:
        other, words = freedoms[-1]
        trims = _trim([edges[name] for name in tried if name not in found], other, attempts)
        found |= {name: f"{words} and {trim}" for name, trim in trims.items()}
    vain = "no roll, no tilt up to 30 deg and no trim helps: another place may"
    vain += " (camgen place)" if noun == "edge" else ""
    told = [replace(one, remedy=found.get(one.id, vain) if one.id in tried else "") for one in lost]
    rest = len(able) - len(tried)
    if not rest:
        return told, []
    what = f"what would help was looked for with the first {len(tried)} {noun}s that are left out, not with {rest} more"
    return told, [Note("assumed", what)]


def _other_tools(
    names: Sequence[str], freedoms: Sequence[tuple[Job, str]], attempts: Attempts
) -> dict[str, str]:
    """By id the least freedom of the tool that reaches the whole edge."""
    found: dict[str, str] = {}
    for job, words in freedoms:
        left = [name for name in names if name not in found]
        made = attempts.whole(job, left) if left else ()
        found |= {one.id: f"{words} reaches it" for one in made if isinstance(one, EdgeMotion)}
    return found


def _freedoms(job: Job) -> list[tuple[Job, str]]:
    """More freedom than the tool of the job has, the least first: jobs without a trim, and how they are written."""
    tilts = [tilt for tilt in _TILTS if tilt > job.tool.axis_tilt]
    tools = [
        (replace(job.tool, axis_tilt=tilt), f"tool.axis_tilt = {short(tilt, 0)}") for tilt in tilts
    ]
    if not job.tool.symmetric:
        turned = [(_free(tool), f"{words} with tool.symmetric = true") for tool, words in tools]
        tools = [(_free(job.tool), "tool.symmetric = true"), *tools[:1], *turned]
    whole = replace(job.operation, trim=0.0)
    return [(replace(job, tool=tool, operation=whole), words) for tool, words in tools]


def _free(tool: ToolTable) -> ToolTable:
    """``tool`` with any turn about its axis."""
    return replace(tool, symmetric=True, turn=None)


def _trim(edges: Sequence[Line], job: Job, attempts: Attempts) -> dict[str, str]:
    """By id the trim with which least is left out at the ends of an edge, and how much, of those that one helps."""
    stands = _once(partial(attempts.stands, job))
    missing: dict[str, tuple[int, float]] = {}
    for ends, share in _ENDS:
        most = {edge.id: share * edge.length for edge in edges if not edge.closed}
        most |= {
            name: min(most[name], (less - 1) / sum(ends)) for name, (_, less) in missing.items()
        }
        least = _least(most, ends, stands, partial(attempts.part, job))
        missing |= {name: (trim, trim * sum(ends)) for name, trim in least.items()}
    told = {name: one for name, one in missing.items() if one[0] > job.operation.trim}
    return {
        name: f"operation.trim = {trim} reaches all but {short(less, 1)} mm"
        for name, (trim, less) in told.items()
    }


#: ``Attempts.stands`` of a job.
_Stand = Callable[[Mapping[str, float], bool], Sequence[bool]]


def _once(stands: _Stand) -> _Stand:
    """The same, but each place is asked for once."""
    known: dict[tuple[str, float, bool], bool] = {}

    def stand(less: Mapping[str, float], last: bool) -> list[bool]:
        new = {name: mm for name, mm in less.items() if (name, mm, last) not in known}
        known.update(
            zip(
                [(name, mm, last) for name, mm in new.items()],
                stands(new, last) if new else (),
                strict=True,
            )
        )
        return [known[name, mm, last] for name, mm in less.items()]

    return stand


def _least(
    most: Mapping[str, float],
    ends: Ends,
    stands: _Stand,
    reach: Callable[[Mapping[str, Ends]], Sequence[bool]],
) -> dict[str, int]:
    """By id the least trim at these ends, ``most`` mm at most, of those that one helps."""
    trims = {
        name: some
        for name, length in most.items()
        if (some := [trim for trim in _TRIMS if trim <= length])
    }

    def stand(some: Mapping[str, int]) -> list[bool]:
        good = _those(
            some, lambda some: stands({name: trim * ends[0] for name, trim in some.items()}, False)
        )
        good = _those(
            good, lambda some: stands({name: trim * ends[1] for name, trim in some.items()}, True)
        )
        return [name in good for name in some]

    def reaches(some: Mapping[str, int]) -> Sequence[bool]:
        return reach({name: (trim * ends[0], trim * ends[1]) for name, trim in some.items()})

    standing = _find_least(trims, stand)
    good = _those(standing, reaches)
    more = {
        name: [trim for trim in trims[name] if trim > least] for name, least in standing.items()
    }
    return good | _find_least(
        {name: some for name, some in more.items() if some and name not in good}, reaches
    )


#: Whether trims help, by id and in that order.
_Helps = Callable[[Mapping[str, int]], Sequence[bool]]


def _find_least(trims: Mapping[str, Sequence[int]], asked: _Helps) -> dict[str, int]:
    """By id the least of its trims that helps, of those of which the largest, which is tried first, does."""
    largest = _those({name: some[-1] for name, some in trims.items()}, asked)
    first = find_first(
        {name: len(trims[name]) - 1 for name in largest},
        lambda at: asked({name: trims[name][k] for name, k in at.items()}),
    )
    return largest | {name: trims[name][k] for name, k in first.items()}


def _those(trims: Mapping[str, int], asked: _Helps) -> dict[str, int]:
    """Those of ``trims`` that help."""
    return {
        name: trim for (name, trim), helps in zip(trims.items(), asked(trims), strict=True) if helps
    }
