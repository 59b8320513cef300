"""``cell.margin``: what comes nearer is told as it is, and avoided where there is a choice; judged by fcl alone."""

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
from camgen.plan.edges.poses import reach
from camgen.read.solid import mesh
from tests.support.built import build
from tests.support.files import source

SOLID = mesh.read(source(PARTS / "rfa1.stl"))
SPEEDS = LinkSpeeds(100.0, 100.0, 0.0)
TIGHT = "IRB 2000, nominal rfa1"


#: The margin of a job that names none, mm.
USUAL = CellTable().margin


def built(name: str, margin: float, free: bool = False, select: str = "") -> Result:
    tables = make_job(SOLID, name)
    if select:
        tables["input"] = {"select": select}
    tool = {**tables["tool"], **(FREE if free else {})}
    own = tables["cell"] if margin == USUAL else {**tables["cell"], "margin": margin}
    return build(PARTS / "rfa1.stl", post="rapid", job={**tables, "tool": tool, "cell": own})


@cache
def measured(result: Result) -> float:
    """The least distance at every row that was looked at, by a plain loop over fcl."""
    assert result.reach is not None
    judge, least = make_loop(result, SOLID), math.inf
    for row in result.reach.joints:
        least = judge.measure_clearance(row, least)
    return least


def near_notes(result: Result) -> list[str]:
    return [note.what for note in result.notes if "cell.margin" in note.why]


def test_what_is_told_is_what_fcl_measures() -> None:
    """Two links of the arm pass each other on an edge that only this posture reaches."""
    result = built(TIGHT, 2.0, select="e11, e14, e15")
    assert result.clear is not None
    least = result.clear.nearest
    assert least is not None
    assert measured(result) == pytest.approx(least.distance, abs=0.25)
    assert set(least.pair) == {"link 2", "link 4"}
    assert any(
        f"link 2 against link 4 on {least.on} at {least.at} mm" in note
        for note in near_notes(result)
    )
    told = json.loads(json.dumps(result.report))["clearance"]
    assert (told["between"], told["on"]) == (["link 2", "link 4"], least.on)


def test_each_path_and_each_link_has_its_clearance_in_the_report() -> None:
    result = built(TIGHT, 2.0, select="e11, e14, e15")
    assert result.reach is not None
    assert result.clear is not None
    judge, columns = make_loop(result, SOLID), result.program.columns
    paths = len(result.tour.paths)
    expected = np.full((paths + 1, 2), result.clear.bound)
    motions = np.searchsorted(columns.at, result.reach.owner).tolist()
    for rows, motion in zip(pairwise(result.reach.joints), motions[1:], strict=True):
        place = columns.path[motion], int(columns.works[motion])
        for row in rows:  # a path begins where the link to it ends
            expected[place] = min(expected[place], judge.measure_clearance(row, expected[place]))
    report = json.loads(json.dumps(result.report))
    reported = [[path["link_clearance_mm"], path["clearance_mm"]] for path in report["paths"]]
    assert np.allclose(reported, expected[:-1], atol=0.25)
    assert report["clearance"]["home_mm"] == pytest.approx(expected[-1, 0], abs=0.25)
    assert expected[:-1].min(axis=0).max() < 1.0  # a path and a link are close
    assert expected[:-1].max(axis=0).min() == result.clear.bound  # and others are not


@pytest.mark.parametrize(
    ("name", "select", "least"), [("IRB 2000", "e6-e10", 0.6), (TIGHT, "e11, e13-e15", 0.3)]
)
def test_where_there_is_a_choice_the_margin_is_kept_and_no_edge_is_lost(
    name: str, select: str, least: float
) -> None:
    before, after = (built(name, margin, True, select) for margin in (0.0, 2.0))
    assert measured(before) < least
    assert measured(after) >= 2.0 - 0.25
    assert len(after.tour.paths) == len(before.tour.paths)
    assert not near_notes(before)
    assert not near_notes(after)


def test_what_cannot_be_kept_costs_no_edge_and_is_told() -> None:
    """More than the cell has: as many edges as without a margin, and each place that is nearer is named."""
    before, after = (built(TIGHT, margin, select="e11, e13-e15") for margin in (0.0, 6.0))
    assert len(after.tour.paths) == len(before.tour.paths)
    assert after.clear is not None
    assert after.clear.nearest is not None
    assert after.clear.clearance < 6.0
    assert near_notes(after)
    assert after.clear.clearance == pytest.approx(measured(after), abs=0.25)


def test_of_two_ways_out_the_one_with_room_is_taken_and_else_the_one_with_most() -> None:
    result = built("IRB 2400", 2.0)
    setup, room, motions = _planned(result)
    bare = np.full((1, 3), np.nan)
    ends = [
        (PosePath(m.way.position[[0]], bare, m.way.rotation[[0]]), m.joints[0]) for m in motions[:4]
    ]
    first = [
        one.name
        for one in find_retractions(setup, room, ends, SPEEDS)
        if isinstance(one, Retraction)
    ]
    gaps = iter([0.5, 1.0, 0.25])

    def crowded(tracks: list[SampledMotion]) -> list[Blockage | float]:
        return [next(gaps, 0.1)] * len(tracks)

    seen = [
        one
        for one in find_retractions(setup, replace(room, look=crowded), ends[:1], SPEEDS)
        if isinstance(one, Retraction)
    ]
    assert len(first) == 4
    assert len(seen) == 1
    # The second that was tried has most room.
    assert seen[0].name != first[0]


def test_a_free_motion_that_comes_near_is_taken_only_where_no_other_leads() -> None:
    """All free motions come near but those by way of home: they go by it; and where these do too, none is lost."""
    setup, room, motions = _planned(built("IRB 2400", 2.0))
    home = setup.robot.home

    def crowded(tracks: list[SampledMotion]) -> list[Blockage | float]:
        free = [
            track.way is None and not any(np.allclose(row, home) for row in track.joints)
            for track in tracks
        ]
        return [
            0.1 if one and not isinstance(hit, Blockage) else hit
            for one, hit in zip(free, room.look(tracks), strict=True)
        ]

    def all_crowded(tracks: list[SampledMotion]) -> list[Blockage | float]:
        return [hit if isinstance(hit, Blockage) else 0.1 for hit in room.look(tracks)]

    plain, by_home, near = (
        find_route(
            RouteCell(setup, replace(room, look=look), home),
            motions,
            SOLID.edges,
            RouteOptions(SPEEDS, best=True),
        )
        for look in (room.look, crowded, all_crowded)
    )
    assert len(plain.legs) == len(by_home.legs) == len(near.legs) == len(motions)
    assert plain.seconds < by_home.seconds < 1e4
    assert near.seconds < 1e4


def _planned(result: Result):  # type: ignore[no-untyped-def]
    """Setup, room and motions of a build."""
    assert result.where is not None
    assert result.cell.arm is not None
    setup = make_setup(result.cell.arm, result.cell, result.where)
    edges = [
        edge for edge in SOLID.edges if edge.id in {path.contours[0] for path in result.planned}
    ]
    motions = tuple(one for one in reach(edges, setup, 2.0) if isinstance(one, EdgeMotion))
    return setup, make_free_space(result.where, setup), motions


def test_bodies_that_are_near_at_home_keep_no_margin_and_are_named() -> None:
    """The holder is 5 mm off a link of the wrist, whatever the arm does."""
    result = built("IRB 1200", 8.0, select="e1-e4")
    notes = [note.what for note in result.notes if note.what.endswith("keep no margin")]
    assert notes == ["link 5 and holder keep no margin"]
    assert result.where is not None
    assert ("link 5", "holder") in result.where.work.pairs
