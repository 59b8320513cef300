"""The engagement in pockets is limited, measured by the cells that a disc clears on all paths."""

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
from camgen.plan.pocket.medial_axis import MedialAxis, compute_medial_axis
from tests.support.drawn import circle, contour, part, rectangle, rounded
from tests.support.engaged import engaged
from tests.support.swept import enclosed

RADIUS = 3.0
#: Pockets in which a pass at a constant distance from the walls cuts a slot somewhere.
SHAPES = {
    "rectangle": (rectangle(0, 0, 50, 36),),
    "circle": (circle(0, 0, 18),),
    "rounded": (rounded(50, 30, 5),),
    "an L": (contour([(0, 0), (50, 0), (50, 16), (18, 16), (18, 40), (0, 40)]),),
    "a neck": (
        contour([(0, 0), (24, 0), (24, 8), (34, 8), (34, 0), (60, 0),
                 (60, 24), (34, 24), (34, 16), (24, 16), (24, 24), (0, 24)]),
    ),
    "an island": (rectangle(0, 0, 50, 40), circle(22, 20, 6, "c2")),
    "bulges": (contour([(0, 0), (45, 0), (45, 30), (0, 30)], [0.3, -0.2, 0.3, 0.0]),),
}  # fmt: skip
#: Error of the measurement as a fraction of the diameter; a cell has a fortieth of it.
NOISE = 0.06


def find_axis(name: str, max_turn: float) -> MedialAxis:
    """The medial axis of a shape."""
    walls = make_contour_segments(SHAPES[name])
    following = find_following(walls, np.ones(len(SHAPES[name]), dtype=bool))
    return compute_medial_axis(walls, following, enclosed(SHAPES[name]), RADIUS, 0.6, max_turn)


def plan_channel(name: str) -> Channel:
    """The channel of a shape for passes of 2.4 mm."""
    bound = EngagementLimit(RADIUS, 2.4, 0.6, True)
    (channel,) = plan_channels(find_axis(name, bound.max_turn), RADIUS, bound, 0.0)
    return channel


def plan_pocket(*contours: Contour, **operation: object) -> Plan:
    table = OperationTable(kind="pocket", **operation)  # type: ignore[arg-type]
    return plan(part(*contours), Job(tool=ToolTable(diameter=2 * RADIUS), operation=table))


def measure_engaged_length(planned: Plan, share: float) -> float:
    """Length with an engagement above `share`, mm, without the first diameter of the paths."""
    steps = engaged(planned.paths, RADIUS)
    after_entry = np.cumsum(steps[:, 3]) > 2 * RADIUS
    return float(steps[after_entry & (steps[:, 2] > share), 3].sum())


@pytest.mark.parametrize("stepover", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_the_engagement_stays_near_the_stepover(name: str, stepover: float) -> None:
    planned = plan_pocket(*SHAPES[name], stepover=stepover)
    # The first link from a curve of the smallest radius to the next pass may engage more,
    # on a length of one tool diameter at most.
    bounded = measure_engaged_length(planned, stepover + 0.15 + NOISE)
    assert bounded <= 2 * RADIUS
    free = plan_pocket(*SHAPES[name], stepover=stepover, engagement=1.0)
    assert measure_engaged_length(free, stepover + 0.15 + NOISE) > max(RADIUS, 1.5 * bounded)


@pytest.mark.parametrize("limit", [0.45, 0.6, 0.9])
def test_the_job_may_set_the_engagement_limit(limit: float) -> None:
    planned = plan_pocket(*SHAPES["an island"], stepover=0.35, engagement=limit)
    assert measure_engaged_length(planned, limit + NOISE) <= RADIUS
    (note,) = [str(note) for note in planned.notes if "engagement" in str(note)]
    assert f"{100 * limit:.0f} % at most" in note


def test_an_engagement_limit_below_that_of_a_straight_pass_is_refused() -> None:
    with pytest.raises(
        JobError, match=r"passes 0.6 of the diameter apart .*operation.engagement.*0.65 at least"
    ):
        plan_pocket(*SHAPES["circle"], stepover=0.6, engagement=0.6)


def test_one_path_with_one_entry_clears_several_basins() -> None:
    wide = contour([(0, 0), (40, 0), (40, 16), (60, 16), (60, 0), (110, 0),
                    (110, 40), (60, 40), (60, 24), (40, 24), (40, 40), (0, 40)])  # fmt: skip
    planned = plan_pocket(wide, stepover=0.4, depth=4.0, passes=2)
    (path,) = planned.paths
    # The path leads through the neck into all corners.
    low, high = path.position[:, :2].min(axis=0), path.position[:, :2].max(axis=0)
    assert np.allclose([*low, *high], [3, 3, 107, 37], atol=0.3)
    assert measure_engaged_length(planned, 0.55 + NOISE) <= 2 * RADIUS


@pytest.mark.parametrize("name", SHAPES)
def test_the_medial_axis_has_two_nearest_walls(name: str) -> None:
    axis = find_axis(name, 0.3)
    assert len(axis.points) > 0
    border = enclosed(SHAPES[name]).boundary
    gap = shapely.distance(shapely.points(axis.points), border)
    assert np.allclose(gap, axis.wall_distance, atol=0.002)
    assert (gap > RADIUS - 0.002).all()
    # Two separate points of the walls are equally near, so a slightly larger disc meets both.
    for point, distance in zip(axis.points[::7], axis.wall_distance[::7], strict=True):
        near = shapely.Point(point).buffer(distance + 0.05, quad_segs=256).intersection(border)
        assert shapely.minimum_rotated_rectangle(near).length > 0.25 * distance
    # Links are short and never lead through a wall.
    lines = shapely.linestrings(axis.points[axis.links])
    assert (shapely.distance(lines, border) > RADIUS - 0.05).all()


@pytest.mark.parametrize("name", SHAPES)
def test_the_path_of_a_channel_stays_within_its_discs(name: str) -> None:
    channel = plan_channel(name)
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


@pytest.mark.parametrize("name", [name for name in SHAPES if name != "circle"])
def test_an_arc_that_cuts_runs_through_earlier_discs_on_short_stretches_only(name: str) -> None:
    channel = plan_channel(name)
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
        points = points_at(arc.take(np.zeros(400, dtype=int)), np.linspace(0, 1, 400))
        earlier = shapely.union_all(discs[:disc])
        inside = shapely.get_parts(shapely.LineString(points).intersection(earlier))
        assert max([part.length for part in inside], default=0.0) <= RADIUS
    assert fronts > 3


@pytest.mark.parametrize("name", SHAPES)
def test_a_link_over_a_channel_stays_within_its_discs(name: str) -> None:
    channel = plan_channel(name)
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
def test_discs_leave_at_most_the_stepover_for_the_pass_along_the_walls(name: str) -> None:
    """A disc leaves the difference from its radius to the largest radius between the walls."""
    channel = plan_channel(name)
    border = enclosed(SHAPES[name]).boundary
    middles = shapely.points([(disc.x, disc.y) for disc in channel.discs])
    largest = shapely.distance(middles, border) - RADIUS
    radii = np.array([disc.radius for disc in channel.discs])
    bound = EngagementLimit(RADIUS, 2.4, 0.6, True)
    left = largest - radii
    assert (left >= -0.003).all()
    # Larger discs are not needed. They leave material for further passes.
    small = radii < bound.min_radius - 1e-6
    assert (left[small] <= bound.stepover + 0.003).all()
    total = largest[small] + RADIUS
    share = left[small] * (2 * total - left[small]) / (4 * largest[small] * RADIUS)
    assert (share <= bound.engagement + 0.01).all()
    assert left[small].max() > 0.5
