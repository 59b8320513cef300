"""Deliberate mistakes between the drawing and the text: each one is refused.

A saboteur changes one function of planning, ordering, lowering, a pass or a post. The build has to
end with exit code 4, or 3 if the stock proof comes first, and with a line that names a place.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.model.body import Body
from camgen.model.errors import NoSafeProgram, VerifyError
from camgen.model.program import MoveL, Output
from tests.support.built import build
from tests.support.sabotage import (
    PARTS,
    Patch,
    change_program,
    change_result,
    module,
    with_columns,
)

MILL: dict[str, Any] = {
    "operation": {"depth": 2.0, "passes": 2},
    "process": {"spindle": 9000.0, "feed": 15.0},
    "tool": {"diameter": 4.0},
}
#: Shift of all targets, mm.
SHIFT = np.array([0.1, 0.0, 0.0])


def shift(patch: Patch) -> None:
    """All targets are shifted by 0.1 mm."""
    change_program(patch, lambda body: with_columns(body, end=body.packed.end + SHIFT))


def mirror(patch: Patch) -> None:
    """The part is mirrored."""
    flip = np.array([-1.0, 1.0, 1.0])
    change_program(
        patch,
        lambda body: with_columns(body, end=body.packed.end * flip, via=body.packed.via * flip),
    )


def faster(patch: Patch) -> None:
    """All speeds are three times as high."""
    change_program(patch, lambda body: with_columns(body, speed=body.packed.speed * 3))


def deeper(patch: Patch) -> None:
    """Each target below the top face is 1 mm deeper."""

    def change(body: Body) -> Body:
        end = body.packed.end.copy()
        end[end[:, 2] < 0, 2] -= 1.0
        return with_columns(body, end=end)

    change_program(patch, change)


def low_travel(patch: Patch) -> None:
    """Travel is at a quarter of the clearance height."""

    def change(body: Body) -> Body:
        end = body.packed.end.copy()
        end[end[:, 2] > 10, 2] /= 4
        return with_columns(body, end=end)

    change_program(patch, change)


def change_instructions(patch: Patch, change: Callable[[Any], Any]) -> None:
    """Change each instruction of the program."""
    pack = module("model.body").pack
    change_program(patch, lambda body: pack([change(item) for item in body]))


def change_paths(patch: Patch, change: Callable[[Any], Any]) -> None:
    """Change each path of the tour."""

    def changed(tour: Any) -> Any:
        return replace(tour, paths=tuple(change(path) for path in tour.paths))

    change_result(patch, "pipeline", "order", changed)


def chords_as_lines(patch: Patch) -> None:
    """Each arc becomes one straight line."""

    def change(item: Any) -> Any:
        if not hasattr(item, "via"):
            return item
        return MoveL(item.target, item.speed, path=item.path, work=item.work)

    change_instructions(patch, change)


def half(patch: Patch) -> None:
    """The second half of the motions along paths is missing."""

    def change(body: Body) -> Body:
        works = np.flatnonzero(body.packed.work)
        dropped = body.at[works[len(works) // 2 :]]
        return body.take(np.setdiff1d(np.arange(len(body)), dropped))

    change_program(patch, change)


def without_last_path(patch: Patch) -> None:
    """The last path of the tour is missing without a note."""
    change_result(patch, "pipeline", "order", lambda tour: replace(tour, paths=tour.paths[:-1]))


def one_pass(patch: Patch) -> None:
    """The last pass in depth is missing."""
    change_paths(patch, lambda path: replace(path, depths=path.depths[:-1]))


def against(patch: Patch) -> None:
    """The paths are run against their direction."""
    change_paths(patch, lambda path: path.reversed())


def backwards(drawn: Any) -> Any:
    """The segments of contours in reverse."""
    return module("geometry.segments").reverse_segments(drawn)[0]


def swapped_side(patch: Patch) -> None:
    """Outer contours are followed on their inside, and holes on their outside."""
    change_result(patch, "plan.follow", "reverse_loops", backwards)


def wrong_radius(patch: Patch) -> None:
    """The offset is 0.1 mm too small."""
    original = module("plan.follow").run_beside

    def changed(part: Any, job: Any, distance: float, *given: Any) -> Any:
        return original(part, job, distance - 0.1, *given)

    patch.setattr(module("plan.follow"), "run_beside", changed)


def half_depth(patch: Patch) -> None:
    """Every pass is half as deep."""
    change_result(
        patch, "plan.follow", "compute_depths", lambda depths: tuple(d / 2 for d in depths)
    )


def lead_to_the_other_side(patch: Patch) -> None:
    """Leads are inside the part."""
    change_result(patch, "order.leads", "_travel_sign", lambda sign: -sign)
    patch.setattr(module("order.leads"), "_is_clear", lambda *_: True)


def signal_off(patch: Patch) -> None:
    """The process output is never switched on."""
    patch.setattr(module("lower.contours"), "switch_on", lambda _process: iter(()))


def signal_stays_on(patch: Patch) -> None:
    """The process output is on during travel."""

    def change(body: Body) -> Body:
        items = []
        outputs = 0
        for item in body:
            outputs += isinstance(item, Output)
            if not (isinstance(item, Output) and item.value == 0 and outputs > 2):
                items.append(item)
        items.insert(len(items) - 1, Output("process", 0.0))
        return module("model.body").pack(items)

    change_program(patch, change)


def slow_spindle(patch: Patch) -> None:
    """The spindle rotates at a tenth of its speed."""

    def change(item: Any) -> Any:
        is_spindle = isinstance(item, Output) and item.signal == "spindle"
        return Output("spindle", item.value / 10) if is_spindle else item

    change_instructions(patch, change)


def without_force(patch: Patch) -> None:
    """The force is half the force of the job."""
    change_paths(patch, lambda path: path.with_columns(force=path.force / 2))


def neighbours_gouged(patch: Patch) -> None:
    """Offset curves keep no distance from other contours."""
    original = module("plan.follow").make_offset_curve

    def changed(source: Any, following: Any, closed: Any, *given: Any) -> Any:
        return original(source, following, closed, source.owner, *given[1:])

    patch.setattr(module("plan.follow"), "make_offset_curve", changed)


def drilled_off_centre(patch: Patch) -> None:
    """Holes are drilled 0.2 mm off their centres."""
    original = module("plan.drill")._make_path

    def changed(hole: Any, job: Any) -> Any:
        return original(replace(hole, x=hole.x + 0.2), job)

    patch.setattr(module("plan.drill"), "_make_path", changed)


def shallow_holes(patch: Patch) -> None:
    """Holes are 1 mm too shallow."""
    change_result(patch, "plan.drill", "_plan_pecks", lambda levels: [z + 1.0 for z in levels])


def narrow_bores(patch: Patch) -> None:
    """The last circle of a bore is missing."""
    original = module("plan.bore")._make_circle
    patch.setattr(
        module("plan.bore"), "_make_circle", lambda radius, z, sense: original(radius / 2, z, sense)
    )


def half_cleared(patch: Patch) -> None:
    """The second half of the only path of a pocket is missing."""

    def change(tour: Any) -> Any:
        (path,) = tour.paths
        return replace(tour, paths=(path.rows(0, len(path) // 2),))

    change_result(patch, "pipeline", "order", change)


FORCE = {
    "process": {"force": 5.0},
    "tool": {"orient": "follow"},
    "post": {"force_calibrated": True},
}
LEADS = {**MILL, "operation": {"depth": 2.0, "lead_in": 3.0, "lead_out": 3.0}}
DRILL = {
    "operation": {"kind": "drill", "depth": 5.0},
    "tool": {"diameter": 3.3},
    "process": {"spindle": 2000.0, "feed": 3.0},
}
BORE = {"operation": {"kind": "bore", "depth": 2.0}, "tool": {"diameter": 5.0}}
BORE |= {"process": {"spindle": 9000.0}}
POCKET = {**MILL, "operation": {"kind": "pocket", "depth": 2.0}, "tool": {"diameter": 3.0}}

Case = tuple[Callable[[Patch], None], str, str, Mapping[str, Any]]
CASES: list[Case] = [
    (shift, "bracket.dxf", "gcode", {}),
    (shift, "blocks.dxf", "rapid", {"operation": {"kind": "trace"}}),
    (mirror, "bracket.dxf", "grbl", {}),
    (faster, "bracket.dxf", "gcode", {}),
    (faster, "logo.svg", "pacscript", {"operation": {"kind": "trace"}}),
    (deeper, "bracket.dxf", "gcode", MILL),
    (low_travel, "bracket.dxf", "rapid", {}),
    (chords_as_lines, "bracket.dxf", "gcode", {}),
    (chords_as_lines, "bracket.dxf", "vplus", {}),
    (half, "bracket.dxf", "gcode", {}),
    (half, "blocks.dxf", "vplus", {"operation": {"kind": "trace"}}),
    (without_last_path, "bracket.dxf", "gcode", {}),
    (one_pass, "bracket.dxf", "gcode", MILL),
    (against, "bracket.dxf", "gcode", {}),
    (swapped_side, "bracket.dxf", "rapid", {}),
    (wrong_radius, "bracket.dxf", "gcode", {}),
    (half_depth, "bracket.dxf", "gcode", MILL),
    (lead_to_the_other_side, "bracket.dxf", "gcode", LEADS),
    (signal_off, "bracket.dxf", "rapid", {}),
    (signal_stays_on, "bracket.dxf", "gcode", {}),
    (slow_spindle, "bracket.dxf", "gcode", MILL),
    (without_force, "bracket.dxf", "rapid", FORCE),
    (drilled_off_centre, "plate.dxf", "gcode", DRILL),
    (shallow_holes, "plate.dxf", "gcode", DRILL),
    (narrow_bores, "bracket.dxf", "gcode", BORE),
    (half_cleared, "bracket.dxf", "gcode", POCKET),
]


@pytest.mark.parametrize(
    ("saboteur", "part", "post", "job"),
    CASES,
    ids=[f"{case[0].__name__}-{case[1]}-{case[2]}" for case in CASES],
)
def test_a_mistake_is_refused_with_its_place(
    saboteur: Callable[[Patch], None],
    part: str,
    post: str,
    job: Mapping[str, Any],
    monkeypatch: Patch,
) -> None:
    build(PARTS / part, post=post, job=job)  # the build succeeds without the saboteur
    saboteur(monkeypatch)
    with pytest.raises((VerifyError, NoSafeProgram)) as caught:
        camgen.build(PARTS / part, post=post, job=dict(job))
    text = str(caught.value)
    assert re.search(r"instruction \d+|line \d+|contour c\d+| mm\b", text), text


def test_a_path_that_gouges_a_neighbour_is_found(monkeypatch: Patch) -> None:
    plates = [[(x, 0), (x + 40, 0), (x + 40, 20), (x, 20), (x, 0)] for x in (0, 44)]
    part = camgen.part([np.array(plate, float) for plate in plates])
    camgen.build(part, post="gcode", job={})
    neighbours_gouged(monkeypatch)
    with pytest.raises(VerifyError, match=r"nearer to contour c\d|works where nothing is drawn"):
        camgen.build(part, post="gcode", job={})
