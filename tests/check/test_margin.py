"""`cell.margin`: smaller clearances are reported, and avoided if possible. fcl measures them."""

import json
import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from bench.robots.rfa import FREE, PARTS, make_job, make_loop
from camgen.model.job import CellTable
from camgen.motion.cell import make_free_space, make_setup
from camgen.motion.limits import LinkSpeeds
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import Blockage, EdgeMotion, SampledMotion
from camgen.order.edges.problem import RouteCell, RouteOptions
from camgen.order.edges.retract import Retraction, find_retractions
from camgen.order.edges.route import find_route
from camgen.pipeline import Result
from camgen.read.solid import mesh
from tests.support.built import build
from tests.support.edge_shapes import reach
from tests.support.files import source

SOLID = mesh.read(source(PARTS / "rfa1.stl"))
SPEEDS = LinkSpeeds(100.0, 100.0, 0.0)
TIGHT = "IRB 2000, nominal rfa1"

#: The default margin, mm.
DEFAULT_MARGIN = CellTable().margin


def build_part(name: str, margin: float, free: bool = False, select: str = "") -> Result:
    """Build the part for a cell of the bench. free: the tool may tilt and roll."""
    tables = make_job(SOLID, name)
    if select:
        tables["input"] = {"select": select}
    tool = {**tables["tool"], **(FREE if free else {})}
    cell_table = (
        tables["cell"] if margin == DEFAULT_MARGIN else {**tables["cell"], "margin": margin}
    )
    return build(PARTS / "rfa1.stl", post="rapid", job={**tables, "tool": tool, "cell": cell_table})


@cache
def measure_clearance(result: Result) -> float:
    """The smallest clearance at all joint values of the check, mm, by a plain loop over fcl."""
    assert result.reach is not None
    fcl_loop, clearance = make_loop(result, SOLID), math.inf
    for row in result.reach.joints:
        clearance = fcl_loop.measure_clearance(row, clearance)
    return clearance


def list_margin_notes(result: Result) -> list[str]:
    """The notes about clearances below the margin."""
    return [note.what for note in result.notes if "cell.margin" in note.why]


def test_the_reported_clearance_agrees_with_fcl() -> None:
    """Two links of the arm come close on an edge that only this posture reaches."""
    result = build_part(TIGHT, 2.0, select="e11, e14, e15")
    assert result.clear is not None
    nearest = result.clear.nearest
    assert nearest is not None
    assert measure_clearance(result) == pytest.approx(nearest.distance, abs=0.25)
    assert set(nearest.pair) == {"link 2", "link 4"}
    assert any(
        f"link 2 against link 4 on {nearest.on} at {nearest.at} mm" in note
        for note in list_margin_notes(result)
    )
    report = json.loads(json.dumps(result.report))["clearance"]
    assert (report["between"], report["on"]) == (["link 2", "link 4"], nearest.on)


def test_each_path_and_each_link_has_its_clearance_in_the_report() -> None:
    result = build_part(TIGHT, 2.0, select="e11, e14, e15")
    assert result.reach is not None
    assert result.clear is not None
    fcl_loop, columns = make_loop(result, SOLID), result.program.columns
    paths = len(result.tour.paths)
    expected = np.full((paths + 1, 2), result.clear.bound)
    motions = np.searchsorted(columns.at, result.reach.owner).tolist()
    for rows, motion in zip(pairwise(result.reach.joints), motions[1:], strict=True):
        key = columns.path[motion], int(columns.works[motion])
        for row in rows:  # the last row of a link is the first one of its path
            expected[key] = min(expected[key], fcl_loop.measure_clearance(row, expected[key]))
    report = json.loads(json.dumps(result.report))
    reported = [[path["link_clearance_mm"], path["clearance_mm"]] for path in report["paths"]]
    assert np.allclose(reported, expected[:-1], atol=0.25)
    assert report["clearance"]["home_mm"] == pytest.approx(expected[-1, 0], abs=0.25)
    assert expected[:-1].min(axis=0).max() < 1.0  # a path and a link are close
    assert expected[:-1].max(axis=0).min() == result.clear.bound  # and others are not


@pytest.mark.parametrize(
    ("name", "select", "least"), [("IRB 2000", "e6-e10", 0.6), (TIGHT, "e11, e13-e15", 0.3)]
)
def test_a_margin_that_can_be_kept_is_kept_without_losing_an_edge(
    name: str, select: str, least: float
) -> None:
    before, after = (build_part(name, margin, True, select) for margin in (0.0, 2.0))
    assert measure_clearance(before) < least
    assert measure_clearance(after) >= 2.0 - 0.25
    assert len(after.tour.paths) == len(before.tour.paths)
    assert not list_margin_notes(before)
    assert not list_margin_notes(after)


def test_a_margin_that_cannot_be_kept_is_noted_without_losing_an_edge() -> None:
    """The cell has less clearance than the margin. As many edges are run as without a margin."""
    before, after = (build_part(TIGHT, margin, select="e11, e13-e15") for margin in (0.0, 6.0))
    assert len(after.tour.paths) == len(before.tour.paths)
    assert after.clear is not None
    assert after.clear.nearest is not None
    assert after.clear.clearance < 6.0
    assert list_margin_notes(after)
    assert after.clear.clearance == pytest.approx(measure_clearance(after), abs=0.25)


def test_the_retraction_with_the_most_clearance_is_chosen_if_none_keeps_the_margin() -> None:
    result = build_part("IRB 2400", 2.0)
    setup, free_space, motions = _make_problem(result)
    no_via = np.full((1, 3), np.nan)
    ends = [
        (
            PosePath(motion.pose_path.position[[0]], no_via, motion.pose_path.rotation[[0]]),
            motion.joints[0],
        )
        for motion in motions[:4]
    ]
    names = [
        retraction.name
        for retraction in find_retractions(setup, free_space, ends, SPEEDS)
        if isinstance(retraction, Retraction)
    ]
    clearances = iter([0.5, 1.0, 0.25])

    def crowded(sampled: list[SampledMotion]) -> list[Blockage | float]:
        return [next(clearances, 0.1)] * len(sampled)

    crowded_retractions = [
        retraction
        for retraction in find_retractions(
            setup, replace(free_space, look=crowded), ends[:1], SPEEDS
        )
        if isinstance(retraction, Retraction)
    ]
    assert len(names) == 4
    assert len(crowded_retractions) == 1
    # The second one that is tested has the largest clearance.
    assert crowded_retractions[0].name != names[0]


def test_a_link_within_the_margin_is_used_only_if_no_other_exists() -> None:
    """First all links but those by way of home are within the margin, so links pass home.

    Then all links are within the margin, and none is lost.
    """
    setup, free_space, motions = _make_problem(build_part("IRB 2400", 2.0))
    home = setup.robot.home

    def crowded(sampled: list[SampledMotion]) -> list[Blockage | float]:
        results = free_space.look(sampled)
        for k, motion in enumerate(sampled):
            passes_home = np.isclose(motion.joints, home).all(axis=1).any()
            if (
                motion.pose_path is None
                and not passes_home
                and not isinstance(results[k], Blockage)
            ):
                results[k] = 0.1
        return results

    def all_crowded(sampled: list[SampledMotion]) -> list[Blockage | float]:
        return [
            result if isinstance(result, Blockage) else 0.1 for result in free_space.look(sampled)
        ]

    direct, by_home, all_near = (
        find_route(
            RouteCell(setup, replace(free_space, look=look), home),
            motions,
            SOLID.edges,
            RouteOptions(SPEEDS, best=True),
        )
        for look in (free_space.look, crowded, all_crowded)
    )
    assert len(direct.legs) == len(by_home.legs) == len(all_near.legs) == len(motions)
    assert direct.seconds < by_home.seconds < 1e4
    assert all_near.seconds < 1e4


def _make_problem(result: Result):  # type: ignore[no-untyped-def]
    """Set-up, free space and motions along edges of a build."""
    assert result.where is not None
    assert result.cell.arm is not None
    setup = make_setup(result.cell.arm, result.cell, result.where)
    ids = {path.contours[0] for path in result.planned}
    edges = [edge for edge in SOLID.edges if edge.id in ids]
    motions = tuple(motion for motion in reach(edges, setup, 2.0) if isinstance(motion, EdgeMotion))
    return setup, make_free_space(result.where, setup), motions


def test_bodies_that_are_near_at_home_are_named_and_keep_no_margin() -> None:
    """The holder is 5 mm from a link of the wrist in any posture."""
    result = build_part("IRB 1200", 8.0, select="e1-e4")
    notes = [note.what for note in result.notes if note.what.endswith("keep no margin")]
    assert notes == ["link 5 and holder keep no margin"]
    assert result.where is not None
    assert ("link 5", "holder") in result.where.work.pairs
