"""Mistakes of the motions around a contour: each one is refused with its own message."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.model.body import Body
from camgen.model.errors import VerifyError
from camgen.model.program import Output, Wait
from tests.check.proof.test_saboteurs import against, change_paths, swapped_side
from tests.support.built import build
from tests.support.drawn import circle, contour, part
from tests.support.sabotage import (
    PARTS,
    Patch,
    change_program,
    change_result,
    module,
    with_columns,
)

MILL: dict[str, Any] = {
    "operation": {"depth": 3.0, "passes": 2},
    "process": {"spindle": 9000.0, "feed": 15.0, "plunge": 5.0},
    "tool": {"diameter": 4.0},
}


def make_mill_job(**operation: Any) -> dict[str, Any]:
    """The job of a mill with further keys of the operation."""
    return {**MILL, "operation": {**MILL["operation"], **operation}}


def find_plunges(body: Body) -> Any:
    """Whether each motion (M,) is straight down."""
    end = body.packed.end
    step = np.diff(end, axis=0, prepend=end[:1])
    return (np.abs(step[:, :2]).max(axis=1) < 1e-6) & (step[:, 2] < 0)


def fast_plunge(patch: Patch) -> None:
    """The tool plunges to the part three times as fast."""

    def change(body: Body) -> Body:
        low = find_plunges(body) & (body.packed.end[:, 2] < 1.0)
        return with_columns(body, speed=np.where(low, 3.0, 1.0) * body.packed.speed)

    change_program(patch, change)


def without_approach(patch: Patch) -> None:
    """The tool does not stop above the part."""

    def change(body: Body) -> Body:
        at_approach = find_plunges(body) & (np.abs(body.packed.end[:, 2] - 2.0) < 1e-6)
        dropped = body.at[np.flatnonzero(at_approach)]
        return body.take(np.setdiff1d(np.arange(len(body)), dropped))

    change_program(patch, change)


def low_retract(patch: Patch) -> None:
    """The tool retracts to a quarter of the clearance height after a path."""

    def change(body: Body) -> Body:
        end = body.packed.end.copy()
        end[1:-1][end[1:-1, 2] == 20.0, 2] = 5.0
        return with_columns(body, end=end)

    change_program(patch, change)


def keep(body: Body, is_wanted: Callable[[Any], bool]) -> Body:
    """The instructions for which `is_wanted` is true."""
    return module("model.body").pack([item for item in body if is_wanted(item)])


def without_wait(patch: Patch) -> None:
    """The program does not wait for the spindle."""
    change_program(patch, lambda body: keep(body, lambda item: not isinstance(item, Wait)))


def half_leads(patch: Patch) -> None:
    """Leads are half as long."""
    original = module("order.leads")._make_lead

    def changed(path: Any, length: float, *given: Any) -> Any:
        return original(path, length / 2, *given)

    patch.setattr(module("order.leads"), "_make_lead", changed)


def straight_leads(patch: Patch) -> None:
    """Leads are lines and not quarter circles."""
    original = module("order.leads")._make_lead

    def changed(path: Any, length: float, end: int, _ring: bool, feed: float) -> Any:
        return original(path, length, end, False, feed)

    patch.setattr(module("order.leads"), "_make_lead", changed)


def fast_leads(patch: Patch) -> None:
    """Leads are run at 1.5 times the feed of the job."""
    original = module("order.leads")._make_lead

    def changed(path: Any, length: float, end: int, make_polygon: bool, feed: float) -> Any:
        faster = path.with_columns(feed=path.feed * 1.5)
        return original(faster, length, end, make_polygon, feed * 1.5)

    patch.setattr(module("order.leads"), "_make_lead", changed)


def no_place_for_leads(patch: Patch) -> None:
    """Leads are left out, with a note that they do not fit."""
    patch.setattr(module("order.leads"), "_is_clear", lambda *_: False)


def without_overlap(patch: Patch) -> None:
    """Paths end at their seam."""
    patch.setattr(module("order.leads"), "_add_overlap", lambda path, _overlap: path)


def run_twice(patch: Patch) -> None:
    """Closed paths are run twice."""
    original = module("order.leads")._add_overlap
    patch.setattr(module("order.leads"), "_add_overlap", lambda path, _length: original(path, 1e6))


def without_tabs(patch: Patch) -> None:
    """Tabs are placed, but no path is raised over them."""
    patch.setattr(module("order.tabs"), "_raise_floor", lambda loop, *_: loop.path)


def no_place_for_tabs(patch: Patch) -> None:
    """Tabs are left out, with a note that they do not fit."""
    patch.setattr(module("order.tabs"), "_choose_places", lambda *_: ([], False))


def narrow_tabs(patch: Patch) -> None:
    """Tabs are 1 mm too narrow."""
    change_result(patch, "order.tabs", "_compute_size", lambda tab: replace(tab, top=tab.top - 0.5))


def descend(patch: Patch, slope: float, plunge: float) -> None:
    """Change the slope and the speed of ramps by factors."""
    original = module("lower.runs")._Descent

    def changed(tangent: float, chord: float, speed: float, limit: float) -> Any:
        return original(tangent * slope, chord, speed * plunge, limit)

    patch.setattr(module("lower.runs"), "_Descent", changed)


def steep_ramps(patch: Patch) -> None:
    """Ramps are twice as steep."""
    descend(patch, 2.0, 1.0)


def fast_ramps(patch: Patch) -> None:
    """Ramps are run twice as fast."""
    descend(patch, 1.0, 2.0)


def plunge_for_ramps(patch: Patch) -> None:
    """The tool plunges although the job asks for ramps."""
    original = module("lower.runs")._plan_passes

    def changed(paths: Any, job: Any, descent: Any, down: bool) -> Any:
        operation = replace(job.operation, entry="plunge")
        return original(paths, replace(job, operation=operation), descent, down)

    patch.setattr(module("lower.runs"), "_plan_passes", changed)


def deepest_first(patch: Patch) -> None:
    """The passes are run from the deepest one to the highest."""
    change_paths(patch, lambda path: replace(path, depths=path.depths[::-1]))


def around_first(patch: Patch) -> None:
    """The outline is run before the holes in it."""
    change_result(patch, "pipeline", "order", lambda tour: replace(tour, paths=tour.paths[::-1]))


def wide_zones(patch: Patch) -> None:
    """Every corner has a blend radius of 5 mm."""

    def change(body: Body) -> Body:
        next_works = np.append(body.packed.work[1:], False)
        blend = np.where(body.packed.work & next_works, 5.0, body.packed.blend)
        return with_columns(body, blend=blend)

    change_program(patch, change)


def fixed_tool(patch: Patch) -> None:
    """The tool keeps its orientation along the contour."""
    rows = module("lower.columns")
    patch.setattr(rows, "orient_along", rows.orient_fixed)


def away_from_the_part(patch: Patch) -> None:
    """The force points away from the part."""
    change_paths(patch, lambda path: path.with_columns(force_direction=-path.force_direction))


def off_too_early(patch: Patch) -> None:
    """The output is off before the drill is out of its hole."""

    def change(body: Body) -> Body:
        items = []
        for index, item in enumerate(body):
            is_off = isinstance(item, Output) and item.value == 0 and index > 2
            items.insert(len(items) - is_off, item)
        return module("model.body").pack(items)

    change_program(patch, change)


def one_peck(patch: Patch) -> None:
    """Holes are drilled in one stroke."""
    change_result(patch, "plan.drill", "_plan_pecks", lambda levels: levels[-1:])


LEADS = make_mill_job(lead_in=3.0, lead_out=2.0)
LEADS_IN_AIR = {"operation": {"lead_in": 3.0, "lead_out": 2.0}}
RAMPS = make_mill_job(entry="ramp", entry_angle=10.0)
TABS = make_mill_job(entry="ramp", entry_angle=10.0, tabs=3, tab_width=4.0, tab_height=1.0)
FORCE = {
    "process": {"force": 5.0},
    "tool": {"orient": "follow"},
    "post": {"force_calibrated": True},
}
DRILL = {
    "operation": {"kind": "drill", "depth": 6.0, "passes": 3},
    "tool": {"diameter": 3.3},
    "process": {"feed": 3.0, "switch": "contact"},
}
POCKET = make_mill_job(kind="pocket")
#: A pocket without trochoidal loops: reversed, their returns would be refused by the stock proof.
LEVEL_POCKET = make_mill_job(kind="pocket", engagement=1.0)

Case = tuple[Callable[[Patch], None], str, str, Mapping[str, Any], str]
CASES: list[Case] = [
    (fast_plunge, "bracket.dxf", "gcode", MILL, "has a speed of 15 mm/s, the job asks for 5"),
    (without_approach, "bracket.dxf", "rapid", {}, "without a stop at process.approach"),
    (low_retract, "bracket.dxf", "rapid", {}, "works|to less than process.clearance|from below"),
    (
        without_wait,
        "bracket.dxf",
        "gcode",
        {**MILL, "process": {**MILL["process"], "dwell": 1.0}},
        "with a wait of 0 s, process.dwell is 1 s",
    ),
    (half_leads, "bracket.dxf", "gcode", LEADS, "has a lead_in of 1.500 mm"),
    (fast_leads, "bracket.dxf", "rapid", LEADS_IN_AIR, "mm/s on a lead, the job asks for"),
    (straight_leads, "plate.dxf", "gcode", LEADS, "differs from a quarter circle|lead_in of 0.000"),
    (no_place_for_leads, "bracket.dxf", "gcode", LEADS, "although there is room for it"),
    (
        without_overlap,
        "bracket.dxf",
        "gcode",
        make_mill_job(overlap=2.0),
        "2 mm beyond the seam|again",
    ),
    (run_twice, "bracket.dxf", "gcode", make_mill_job(overlap=2.0), "is run again|beyond the seam"),
    (without_tabs, "bracket.dxf", "gcode", TABS, "with 0 tabs, the job asks for 3"),
    (no_place_for_tabs, "bracket.dxf", "vplus", TABS, "with 0 tabs, the job asks for 3"),
    (narrow_tabs, "bracket.dxf", "grbl", TABS, r"a tab of [67]\.\d+ mm, the job asks for 8.000"),
    (steep_ramps, "bracket.dxf", "gcode", RAMPS, "is steeper than the job allows"),
    (fast_ramps, "bracket.dxf", "gcode", RAMPS, "on a slope faster than process.plunge"),
    (plunge_for_ramps, "bracket.dxf", "gcode", RAMPS, "deeper than its path has run before"),
    (deepest_first, "bracket.dxf", "gcode", MILL, "runs pass 2 before the pass above it"),
    (against, "plate.dxf", "gcode", MILL, "against operation.direction"),
    (around_first, "bracket.dxf", "gcode", MILL, "works around contour c[234], which is worked"),
    (
        wide_zones,
        "blocks.dxf",
        "rapid",
        {"operation": {"kind": "trace"}},
        "in a corner that is rounded by [12]",
    ),
    (
        fixed_tool,
        "bracket.dxf",
        "rapid",
        {"tool": {"orient": "follow"}},
        "ends with tool x away from the contour",
    ),
    (away_from_the_part, "bracket.dxf", "rapid", FORCE, "presses away|tool x away"),
    (
        off_too_early,
        "plate.dxf",
        "rapid",
        {**DRILL, "process": {"switch": "air"}},
        "works with output process off",
    ),
    (one_peck, "plate.dxf", "gcode", DRILL, "drills deeper at once than 2 mm"),
    (against, "bracket.dxf", "gcode", LEVEL_POCKET, "along wall c[1-4] against operation"),
]


@pytest.mark.parametrize(
    ("saboteur", "part", "post", "job", "sentence"),
    CASES,
    ids=[f"{case[0].__name__}-{case[1]}-{case[2]}" for case in CASES],
)
def test_a_mistake_is_refused_with_its_message(
    saboteur: Callable[[Patch], None],
    part: str,
    post: str,
    job: Mapping[str, Any],
    sentence: str,
    monkeypatch: Patch,
) -> None:
    if post == "vplus":
        job = {**job, "post": {"spindle": "on-off", "signals": {"spindle": 7}}}
    build(PARTS / part, post=post, job=job)  # the build succeeds without the saboteur
    saboteur(monkeypatch)
    with pytest.raises(VerifyError) as caught:
        camgen.build(PARTS / part, post=post, job=dict(job))
    assert re.search(sentence, str(caught.value)), str(caught.value)


def make_polygon(count: int) -> Any:
    """A circle with a radius of 10 mm as a polygon; 130 edges or more are shorter than 0.5 mm."""
    angle = np.linspace(0.0, 2 * math.pi, count + 1)
    points = np.column_stack([10 * np.cos(angle), 10 * np.sin(angle)])
    points[-1] = points[0]
    return camgen.part([points])


@pytest.mark.parametrize("saboteur", [swapped_side, against])
@pytest.mark.parametrize("count", [40, 200])
def test_the_side_and_the_direction_of_short_motions_are_examined(
    saboteur: Callable[[Patch], None], count: int, monkeypatch: Patch
) -> None:
    job = {"tolerance": {"arc_fit": 0.0}, "tool": {"diameter": 3.0}}
    camgen.build(make_polygon(count), post="gcode", job=job)
    saboteur(monkeypatch)
    with pytest.raises(VerifyError, match=r"wrong side|against operation\.direction"):
        camgen.build(make_polygon(count), post="gcode", job=job)


def test_a_rounded_inner_corner_may_lie_near_another_contour() -> None:
    """Paths on the right of contours that cross. The tool does not keep clear of other contours."""
    first = contour([(20, 40), (30, 40), (30, 30), (40, 30), (40, 50), (20, 50)], name="first")
    second = contour([(20, 29), (40, 29), (40, 49), (30, 49), (30, 39), (20, 39)], name="second")
    operation = {"kind": "follow", "side": "right", "corner_radius": 2.0}
    job = {"tool": {"diameter": 4.0}, "operation": operation}
    assert camgen.build(part(first, second), post="rapid", job=job).motion.contours == 2


def test_a_visit_may_begin_with_a_ramp_from_the_pass_before() -> None:
    """The chords of the ramp are so short that the first one goes down by less than 0.002 mm."""
    operation = {"kind": "pocket", "depth": 5.0, "passes": 3, "entry": "ramp", "stepover": 0.2}
    job = {**MILL, "tool": {"diameter": 3.0}, "operation": operation}
    assert camgen.build(part(circle(0, 0, 2)), post="gcode", job=job).motion.contours == 1


def test_roughing_passes_are_rounded_as_far_from_the_walls_as_the_allowance() -> None:
    hole = [(0, 0), (20, 0), (20, 20), (0, 20)]
    frame = [(-9, -9), (29, -9), (29, 29), (-9, 29)]
    drawn = part(contour(frame, name="frame"), contour(hole, name="hole"))
    operation = {"finish": 1.0, "corner_radius": 0.5, "depth": 2.0}
    job = {**MILL, "tool": {"diameter": 2.0}, "operation": operation}
    assert camgen.build(drawn, post="gcode", job=job).motion.contours == 2


def test_a_tolerance_as_large_as_the_tool_is_named_as_unproven() -> None:
    job = {"tolerance": {"chord": 2.0, "arc_fit": 2.0}, "tool": {"diameter": 3.0}}
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job=job)
    (reason,) = result.motion.unproven
    assert reason.startswith("follow: the tolerances of the job are larger than half")


@pytest.mark.parametrize(("post", "is_named"), [("gcode", True), ("rapid", False)])
def test_the_direction_of_tool_x_is_unproven_in_a_text_without_orientations(
    post: str, is_named: bool
) -> None:
    result = camgen.build(
        PARTS / "bracket.dxf", post=post, job={"tool": {"orient": "follow", "diameter": 4.0}}
    )
    claim = "that tool x points at the contour: the text states no orientation"
    assert (claim in result.motion.unproven) == is_named
