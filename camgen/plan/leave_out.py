"""Plans without some of their paths: what was left out costs what needs it, and nothing else."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

from msgspec.structs import replace

from camgen.model.part import Note
from camgen.model.path import ToolPath
from camgen.plan import JobPlan, Plan, chain_paths

#: What makes room for what comes after it on the same contours: without it that would cut more than was planned.
_MAKE_ROOM = ("pocket", "bore", "drill", "follow")


def leave_out_paths(plan: Plan, lost: Mapping[str, str]) -> Plan:
    """A flat plan, of one operation or several, without some paths and what needs them, told by their ids with the
    reason. What they enclose goes to what encloses them.
    """
    # The first cause comes last: an error names the last one.
    every = find_dependent(plan, lost) | dict(lost)
    notes = (*plan.notes, *_tell(plan, every))
    if isinstance(plan, JobPlan):
        plans = tuple(_without(one, every) for one in plan.plans)
        return replace(plan, plans=plans, paths=chain_paths(plans), notes=notes)
    return replace(_without(plan, every), notes=notes)


def _without(plan: Plan, lost: Mapping[str, str]) -> Plan:
    if all(path.id not in lost for path in plan.paths):
        return plan
    kept = [k for k, path in enumerate(plan.paths) if path.id not in lost]
    place = {k: new for new, k in enumerate(kept)}
    paths = []
    for k in kept:
        parent = plan.paths[k].parent
        while parent >= 0 and parent not in place:
            parent = plan.paths[parent].parent
        paths.append(replace(plan.paths[k], parent=place.get(parent, -1)))
    return replace(plan, paths=tuple(paths))


def _tell(plan: Plan, lost: Mapping[str, str]) -> Iterator[Note]:
    """A note on each, about the path and its contours."""
    prefix: dict[str, str] = {}
    if isinstance(plan, JobPlan):
        for number, step, one in zip(plan.numbers, plan.steps, plan.plans, strict=True):
            prefix |= {
                path.id: f"operation {number} ({step.operation.kind}): " for path in one.paths
            }
    contours = {path.id: path.contours for path in plan.paths}
    for name, why in lost.items():
        ids = tuple(dict.fromkeys((name, *contours.get(name, ()))))
        yield Note("skipped", f"{prefix.get(name, '')}path {name}", why, ids)


def find_dependent(plan: Plan, lost: Container[str]) -> dict[str, str]:
    """The paths that would cut into material which those that are ``lost`` were to take away first, by id with the
    reason: they cut too, work on a contour of one that is lost, and come after it, in a later operation or because they
    enclose it.
    """
    found: dict[str, str] = {}
    missed: dict[str, str] = {}
    for one in plan.plans if isinstance(plan, JobPlan) else (plan,):
        below: list[dict[str, str]] = [{} for _ in one.paths]
        own: dict[str, str] = {}
        for k in _order_inside_first(one.paths):
            path = one.paths[k]
            first = missed | below[k]
            before = next((first[name] for name in path.contours if name in first), "")
            if path.id not in lost and before and _cuts(path):
                found[path.id] = f"path {before}, which takes material away before it, is left out"
            if (
                (path.id in lost or path.id in found)
                and _cuts(path)
                and path.operation in _MAKE_ROOM
            ):
                below[k] |= dict.fromkeys(path.contours, path.id)
                own |= below[k]
            if path.parent >= 0:
                below[path.parent] |= below[k]
        missed |= own
    return found


def _order_inside_first(paths: Sequence[ToolPath]) -> list[int]:
    """The places of the paths, each before the one around it."""
    level: list[int] = []
    for path in paths:
        count, at = 0, path.parent
        while at >= 0:
            count, at = count + 1, paths[at].parent
        level.append(count)
    return sorted(range(len(paths)), key=lambda k: -level[k])


def _cuts(path: ToolPath) -> bool:
    return max(path.depths) > 0 or bool((path.position[:, 2] < 0).any())
