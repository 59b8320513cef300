"""Engagement in pockets is bounded: judged by counting the cells that a disc takes along the paths, links and all."""

import numpy as np
import pytest
import shapely

from camgen.geometry.segments import find_following, make_contour_segments, points_at
from camgen.model.errors import JobError
from camgen.model.job import Job, OperationTable, ToolTable
from camgen.model.part import Contour
from camgen.plan import Plan, plan
from camgen.plan.pocket.channel import Channel, plan_channels
from camgen.plan.pocket.engagement_limit import EngagementLimit
from camgen.plan.pocket.medial_axis import compute_medial_axis
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.engaged import engaged
from tests.support.swept import enclosed

RADIUS = 3.0
#: Each with corners, curves, necks or islands in which a pass at one distance from the walls cuts a slot.
SHAPES = {
    "rectangle": (rectangle(0, 0, 50, 36),),
    "circle": (circle(0, 0, 18),),
    "rounded": (rounded(50, 30, 5),),
    "an L": (contour([(0, 0), (50, 0), (50, 16), (18, 16), (18, 40), (0, 40)]),),
    "a neck": (
        contour([(0, 0), (24, 0), (24, 8), (34, 8), (34, 0), (60, 0), (60, 24), (34, 24), (34, 16), (24, 16),
                 (24, 24), (0, 24)]),
    ),
    "an island": (rectangle(0, 0, 50, 40), circle(22, 20, 6, "c2")),
    "bulges": (contour([(0, 0), (45, 0), (45, 30), (0, 30)], [0.3, -0.2, 0.3, 0.0]),),
}  # fmt: skip
#: The judge's own noise: a cell has a hundredth of the diameter.
NOISE = 0.06


def planned(*contours: Contour, **operation: object) -> Plan:
    table = OperationTable(kind="pocket", **operation)  # type: ignore[arg-type]
    return plan(part(*contours), Job(tool=ToolTable(diameter=2 * RADIUS), operation=table))


def way_above(made: Plan, share: float) -> float:
    """Mm of way on which more than ``share`` of the diameter is engaged, but for the turn or two of an entry."""
    found = engaged(made.paths, RADIUS)
    first = np.cumsum(found[:, 3]) > 2 * RADIUS
    return float(found[first & (found[:, 2] > share), 3].sum())


@pytest.mark.parametrize("stepover", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_no_more_of_the_tool_is_engaged_than_was_asked(name: str, stepover: float) -> None:
    made = planned(*SHAPES[name], stepover=stepover)
    # The first link from a curve of the least radius to the next ring may engage more, no longer than the tool is wide.
    bounded = way_above(made, stepover + 0.15 + NOISE)
    assert bounded <= 2 * RADIUS
    free = planned(*SHAPES[name], stepover=stepover, engagement=1.0)
    assert way_above(free, stepover + 0.15 + NOISE) > max(RADIUS, 1.5 * bounded)


@pytest.mark.parametrize("most", [0.45, 0.6, 0.9])
def test_the_bound_may_be_asked_for(most: float) -> None:
    made = planned(*SHAPES["an island"], stepover=0.35, engagement=most)
    assert way_above(made, most + NOISE) <= RADIUS
    (note,) = [str(note) for note in made.notes if "engagement" in str(note)]
    assert f"{100 * most:.0f} % at most" in note


def test_a_bound_below_a_straight_pass_is_refused() -> None:
    with pytest.raises(
        JobError, match=r"passes 0.6 of the diameter apart .*operation.engagement.*0.65 at least"
    ):
        planned(*SHAPES["circle"], stepover=0.6, engagement=0.6)


def test_where_there_are_several_basins_one_path_goes_down_once_and_clears_them_all() -> None:
    wide = contour([(0, 0), (40, 0), (40, 16), (60, 16), (60, 0), (110, 0), (110, 40), (60, 40), (60, 24), (40, 24),
                    (40, 40), (0, 40)])  # fmt: skip
    made = planned(wide, stepover=0.4, depth=4.0, passes=2)
    (path,) = made.paths
    # It leads through the neck, into all corners.
    low, high = path.position[:, :2].min(axis=0), path.position[:, :2].max(axis=0)
    assert np.allclose([*low, *high], [3, 3, 107, 37], atol=0.3)
    assert way_above(made, 0.55 + NOISE) <= 2 * RADIUS


@pytest.mark.parametrize("name", SHAPES)
def test_the_ridge_is_as_far_from_two_walls(name: str) -> None:
    walls = make_contour_segments(SHAPES[name])
    following = find_following(walls, np.ones(len(SHAPES[name]), dtype=bool))
    region = enclosed(SHAPES[name])
    axis = compute_medial_axis(walls, following, region, RADIUS, 0.6, 0.3)
    assert len(axis.points) > 0
    border = region.boundary
    gap = shapely.distance(shapely.points(axis.points), border)
    assert np.allclose(gap, axis.wall_distance, atol=0.002)
    assert (gap > RADIUS - 0.002).all()
    # Two places of the walls, apart from each other, are as near: what of them is within a little more has parts.
    for place, room in zip(axis.points[::7], axis.wall_distance[::7], strict=True):
        near = shapely.Point(place).buffer(room + 0.05, quad_segs=256).intersection(border)
        assert shapely.minimum_rotated_rectangle(near).length > 0.25 * room
    # Links are short, and never lead through a wall.
    lines = shapely.linestrings(axis.points[axis.links])
    assert (shapely.distance(lines, border) > RADIUS - 0.05).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_way_of_a_channel_never_leaves_its_discs(name: str) -> None:
    walls = make_contour_segments(SHAPES[name])
    following = find_following(walls, np.ones(len(SHAPES[name]), dtype=bool))
    bound = EngagementLimit(RADIUS, 2.4, 0.6, True)
    axis = compute_medial_axis(
        walls, following, enclosed(SHAPES[name]), RADIUS, 0.6, bound.max_turn
    )
    (channel,) = plan_channels(axis, RADIUS, bound, 0.0)
    assert channel.engagements.max() <= 0.6 + 1e-9
    ends = np.vstack([channel.chain.start, channel.chain.end[-1:]])
    assert np.allclose(ends[0], ends[-1])
    assert np.allclose(channel.chain.start[1:], channel.chain.end[:-1])
    clear = channel.make_polygon(0.01)
    assert clear.contains(shapely.MultiPoint(ends))
    straight = ~channel.chain.is_arc
    lines = shapely.linestrings(
        np.stack([channel.chain.start[straight], channel.chain.end[straight]], axis=1)
    )
    assert clear.covers(lines).all()


def laid(name: str) -> Channel:
    """The channel of a shape for passes of 2.4 mm."""
    walls = make_contour_segments(SHAPES[name])
    following = find_following(walls, np.ones(len(SHAPES[name]), dtype=bool))
    bound = EngagementLimit(RADIUS, 2.4, 0.6, True)
    axis = compute_medial_axis(
        walls, following, enclosed(SHAPES[name]), RADIUS, 0.6, bound.max_turn
    )
    (channel,) = plan_channels(axis, RADIUS, bound, 0.0)
    return channel


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "circle"])
def test_a_front_runs_through_earlier_discs_on_short_stretches_only(name: str) -> None:
    channel = laid(name)
    arcs = channel.chain.take(channel.chain.is_arc)
    middles = np.array([(disc.x, disc.y) for disc in channel.discs])
    discs = shapely.buffer(
        shapely.points(middles), [disc.radius - 1e-3 for disc in channel.discs], quad_segs=256
    )
    fronts = 0
    for row in range(len(arcs)):
        arc = arcs.take(np.array([row]))
        gaps = np.hypot(*(middles - arc.centre).T)
        disc = int(np.argmin(gaps))
        if disc == 0 or gaps[disc] > 1e-6:
            continue
        fronts += 1
        places = points_at(arc.take(np.zeros(400, dtype=int)), np.linspace(0, 1, 400))
        earlier = shapely.union_all(discs[:disc])
        inside = shapely.get_parts(shapely.LineString(places).intersection(earlier))
        assert max([part.length for part in inside], default=0.0) <= RADIUS
    assert fronts > 3


@pytest.mark.parametrize("name", SHAPES)
def test_a_way_over_a_channel_stays_in_its_discs(name: str) -> None:
    channel = laid(name)
    ground = channel.make_polygon(0.0).buffer(0.01)
    middles = np.array([(disc.x, disc.y) for disc in channel.discs])
    assert channel.contains(middles).all()
    far = np.array([channel.discs[0].x, channel.discs[0].y]) + 200.0
    assert not channel.contains(far[None]).any()
    for start in middles[:: max(len(middles) // 5, 1)]:
        for end in middles[:: max(len(middles) // 7, 1)]:
            corners = channel.find_link(start, end)
            assert np.array_equal(corners[0], start)
            assert np.array_equal(corners[-1], end)
            assert ground.covers(shapely.LineString(corners))


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "circle"])
def test_discs_leave_the_pass_along_the_walls_no_more_than_it_may_take(name: str) -> None:
    """Distances say how much is left: a disc as large as the walls allow leaves nothing."""
    channel = laid(name)
    border = enclosed(SHAPES[name]).boundary
    middles = shapely.points([(disc.x, disc.y) for disc in channel.discs])
    largest = shapely.distance(middles, border) - RADIUS
    rooms = np.array([disc.radius for disc in channel.discs])
    bound = EngagementLimit(RADIUS, 2.4, 0.6, True)
    left = largest - rooms
    assert (left >= -0.003).all()
    # Larger ones are not needed; those leave material for further passes.
    small = rooms < bound.min_radius - 1e-6
    assert (left[small] <= bound.stepover + 0.003).all()
    total = largest[small] + RADIUS
    share = left[small] * (2 * total - left[small]) / (4 * largest[small] * RADIUS)
    assert (share <= bound.engagement + 0.01).all()
    assert left[small].max() > 0.5
