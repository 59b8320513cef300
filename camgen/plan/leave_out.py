"""Removes paths from a plan, together with the paths that depend on them."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

from msgspec.structs import replace

from camgen.geometry.ragged import number_kept
from camgen.model.part import Note, index_by_id, list_ids
from camgen.model.path import ToolPath
from camgen.plan import JobPlan, Plan, join_paths

#: Operations that clear material for later paths on the same contours. Without them a later path
#: would cut more than was planned.
_CLEARING = ("pocket", "bore", "drill", "follow")


def leave_out_paths(plan: Plan, lost: Mapping[str, str]) -> Plan:
    """Remove paths, and the paths that depend on them, from the plan of a flat part.

    lost: reason for each path id.
    The children of a removed path get the path around it as their parent. Each removed path has a
    note.
    """
    # The first cause comes last: an error names the last one.
    removed = find_dependent(plan, lost) | dict(lost)
    notes = (*plan.notes, *_note_paths(plan, removed))
    if isinstance(plan, JobPlan):
        plans = tuple(_select_paths(step_plan, removed) for step_plan in plan.plans)
        return replace(plan, plans=plans, paths=join_paths(plans), notes=notes)
    return replace(_select_paths(plan, removed), notes=notes)


def _select_paths(plan: Plan, removed: Mapping[str, str]) -> Plan:
    kept = [k for k, path in enumerate(plan.paths) if path.id not in removed]
    if len(kept) == len(plan.paths):
        return plan
    new_index = number_kept(kept)
    paths = []
    for k in kept:
        parent = plan.paths[k].parent
        while parent >= 0 and parent not in new_index:
            parent = plan.paths[parent].parent
        paths.append(replace(plan.paths[k], parent=new_index.get(parent, -1)))
    return replace(plan, paths=tuple(paths))


def _note_paths(plan: Plan, removed: Mapping[str, str]) -> Iterator[Note]:
    prefix: dict[str, str] = {}
    if isinstance(plan, JobPlan):
        for number, step, step_plan in zip(plan.numbers, plan.steps, plan.plans, strict=True):
            text = f"operation {number} ({step.operation.kind}): "
            prefix |= dict.fromkeys(list_ids(step_plan.paths), text)
    paths = index_by_id(plan.paths)
    for name, why in removed.items():
        contours = paths[name].contours if name in paths else ()
        ids = tuple(dict.fromkeys((name, *contours)))
        yield Note("skipped", f"{prefix.get(name, '')}path {name}", why, ids)


def find_dependent(plan: Plan, lost: Container[str]) -> dict[str, str]:
    """The paths that would cut into material which the paths `lost` should have cleared before.

    Such a path cuts, works on a contour of a lost path, and comes after it: in a later operation,
    or because it encloses it. Returns the reason for each path id.
    """
    dependent: dict[str, str] = {}
    uncleared: dict[str, str] = {}
    for step_plan in plan.plans if isinstance(plan, JobPlan) else (plan,):
        enclosed: list[dict[str, str]] = [{} for _ in step_plan.paths]
        step_uncleared: dict[str, str] = {}
        for k in _order_inside_first(step_plan.paths):
            path = step_plan.paths[k]
            earlier = uncleared | enclosed[k]
            cause = next((earlier[name] for name in path.contours if name in earlier), "")
            if path.id not in lost and cause and _cuts(path):
                dependent[path.id] = (
                    f"path {cause}, which takes material away before it, is left out"
                )
            is_removed = path.id in lost or path.id in dependent
            if is_removed and _cuts(path) and path.operation in _CLEARING:
                enclosed[k] |= dict.fromkeys(path.contours, path.id)
                step_uncleared |= enclosed[k]
            if path.parent >= 0:
                enclosed[path.parent] |= enclosed[k]
        uncleared |= step_uncleared
    return dependent


def _order_inside_first(paths: Sequence[ToolPath]) -> list[int]:
    depths: list[int] = []
    for path in paths:
        depth, parent = 0, path.parent
        while parent >= 0:
            depth, parent = depth + 1, paths[parent].parent
        depths.append(depth)
    return sorted(range(len(paths)), key=lambda k: -depths[k])


def _cuts(path: ToolPath) -> bool:
    return max(path.depths) > 0 or bool((path.position[:, 2] < 0).any())
