"""Ways between edges without stops: what is rounded is free by a plain loop over fcl, and stops are where they must."""

import math
from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace

from bench.robots.rfa import FREE, PARTS, make_job, make_loop
from camgen.check.flow import blend_links
from camgen.check.passing import trace_motions
from camgen.check.reach import check_reach
from camgen.check.time import time_from_rest, time_motions
from camgen.collision.hits import find_collisions
from camgen.collision.motion import measure_apart
from camgen.collision.triangle import are_free
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray, translation
from camgen.model.program import Comment, Joints, MoveJ, MoveL, Program
from camgen.motion.corners import Flow
from camgen.motion.limits import measure_point_speed
from camgen.pipeline import Result
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.models import Robot
from tests.support.built import build
from tests.support.files import source
from tests.support.whole import whole

SOLID = mesh.read(source(PARTS / "rfa1.stl"))


def built(name: str, free: bool = False, post: str = "rapid", **process: float) -> Result:
    tables = make_job(SOLID, name)
    tool = {**tables["tool"], **(FREE if free else {})}
    options: dict[str, object] = {"signals": {"process": 1}} if post == "vplus" else {}
    if "force" in process:
        options |= {"force_load": "load"}
    job = {**tables, "tool": tool}
    if process:
        job["process"] = process
    if options:
        job["post"] = options
    return build(PARTS / "rfa1.stl", post=post, job=job)


def arm_of(result: Result) -> Robot:
    assert result.cell.arm is not None
    return result.cell.arm


def between(result: Result, motion: int, share: float) -> FloatArray:
    """The joints (J,) at a share of the way of the TCP in a motion."""
    assert result.reach is not None
    trace = trace_motions(result.program, result.reach, arm_of(result))
    rows = trace.rows(motion)
    at = (trace.travelled[rows] - trace.travelled[rows.start]) / (
        trace.travelled[rows.stop - 1] - trace.travelled[rows.start]
    )
    return np.array([np.interp(share, at, column) for column in result.reach.joints[rows].T])


def rounded(result: Result, motion: int, zone: float) -> FloatArray:
    """A parabola of the joints (11, J) from ``zone`` mm of the TCP before the corner to as much behind it."""
    assert result.reach is not None
    trace = trace_motions(result.program, result.reach, arm_of(result))
    long = [
        trace.travelled[(rows := trace.rows(k)).stop - 1] - trace.travelled[rows.start]
        for k in (motion, motion + 1)
    ]
    a, b, c = (
        between(result, motion, 1 - min(zone / long[0], 0.5)),
        between(result, motion, 1.0),
        between(result, motion + 1, min(zone / long[1], 0.5)),
    )
    t = np.linspace(0, 1, 11)[:, None]
    return np.asarray((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)


@pytest.mark.parametrize(
    ("name", "free"), [("IRB 2000", True), ("IRB 1200", False), ("IRB 2400", True)]
)
def test_what_is_rounded_is_free_and_keeps_the_margin(name: str, free: bool) -> None:
    result = built(name, free)
    judge, blend = make_loop(result, SOLID), result.program.columns.blend
    found = np.flatnonzero(blend > 0)
    assert len(found) >= 12
    for motion in found.tolist():
        for zone in (blend[motion], 1.6 * blend[motion]):
            for joints in rounded(result, motion, zone):
                assert judge.find_hit(joints) is None
                assert judge.measure_clearance(joints) >= 2.0 - 1e-6


def test_edges_begin_and_end_at_a_stop_and_so_does_what_leads_to_a_contact() -> None:
    result = built("IRB 2400", True)
    columns = result.program.columns
    ends = columns.works & np.append(columns.path[1:] != columns.path[:-1], True)
    ends[:-1] |= columns.works[:-1] & ~columns.works[1:]
    assert ends.sum() >= len(result.tour.paths) == 15
    assert not columns.blend[ends].any()
    contact = np.flatnonzero(~columns.works & (columns.speed < result.job.process.feed))
    assert len(contact) > 5
    assert not columns.blend[contact].any()
    assert not columns.blend[contact - 1].any()
    # The others flow, but for those before an edge and one that states where the tool is before it is run along an arc.
    links = ~columns.works
    links[:1] = links[contact] = links[contact - 1] = False
    links[:-1] &= ~columns.works[1:]
    links[-1:] = False
    assert (columns.blend[links] == 0).sum() <= 1
    (note,) = [note.what for note in result.notes if "without a stop" in note.what]
    assert note.startswith(f"{int((columns.blend[~columns.works] > 0).sum())} of ")


def test_more_margin_leaves_less_room_for_rounding() -> None:
    result = built("IRB 2400", True)
    assert result.reach is not None
    assert result.where is not None
    bare = result.program.with_body(
        tuple(
            replace(one, blend=0.0) if isinstance(one, (MoveJ, MoveL)) else one
            for one in result.program.body
        )
    )
    rest = bare, result.reach
    flow = Flow(10.0, math.inf, -math.inf)
    wide, _ = blend_links(*rest, replace(result.where, margin=60.0), result.cell, flow)
    narrow, _ = blend_links(*rest, result.where, result.cell, flow)
    assert narrow.columns.blend.tolist() == result.program.columns.blend.tolist()
    assert (wide.columns.blend <= narrow.columns.blend).all()
    assert wide.columns.blend.sum() < 0.8 * narrow.columns.blend.sum()


def test_triangles_that_are_called_free_hold_nothing_that_collides() -> None:
    result = built("IRB 2400", True)
    assert result.where is not None
    scene, arm = result.where.scene, arm_of(result)
    assert result.reach is not None
    rng = np.random.default_rng(4)
    first = result.reach.joints[rng.integers(0, len(result.reach.joints), 150)]
    corners = first[:, None] + rng.normal(0.0, 0.1, (150, 3, len(arm.joints)))
    free = are_free(scene, corners, np.arange(150), 1.0)
    shares = rng.dirichlet(np.ones(3), (150, 60))
    inside = np.einsum("kns,ksj->knj", shares, corners)
    struck = (
        (find_collisions(scene, inside.reshape(-1, inside.shape[-1]), near=1.0) >= 0)
        .reshape(150, 60)
        .any(axis=1)
    )
    assert not (free & struck).any()
    assert free.sum() > 40
    assert struck.sum() > 20
    # Few that are free are not found to be so.
    assert (~free & ~struck).sum() < 40


def test_on_links_no_joint_is_faster_than_it_may_be_and_none_could_be_faster() -> None:
    """A link is as fast as the joints or the fastest point of the arm, at 250 mm/s, allow."""
    result = built("IRB 2400", True)
    assert result.reach is not None
    assert result.where is not None
    distance = partial(measure_apart, result.where.scene)
    arm, columns = arm_of(result), result.program.columns
    trace = trace_motions(result.program, result.reach, arm)
    full = 0
    for k in np.flatnonzero(~columns.works & (columns.speed > result.job.process.feed))[
        1:
    ].tolist():
        rows = trace.rows(k)
        mm, seconds = np.diff(trace.travelled[rows]), np.diff(trace.seconds[rows])
        if isinstance(columns.moves[k], MoveJ):
            fastest = measure_point_speed(arm, distance, result.reach.joints[rows])
            limit = min(1.0, 250.0 / fastest)
            assert 0 < columns.share[k] <= limit * 1.02
            # Links at the part are slower.
            if columns.speed[k] > result.job.process.travel_speed:
                assert columns.share[k] == pytest.approx(limit, rel=0.02)
                # The mean speed of the TCP at this share, down to a whole number.
                mean = columns.share[k] * mm.sum() / seconds.sum()
                assert 0.98 * mean - 1 <= columns.speed[k] <= 1.01 * mean + 1
                full += 1
        elif mm.sum() > 1.0:
            # Along a line rows are apart by 10 mm: in between a joint may be a little faster than from row to row.
            assert columns.speed[k] <= (mm / seconds).min() * 1.02
    assert full > 5


def test_a_speed_of_travel_that_is_given_is_kept_by_all_links() -> None:
    slow = built("IRB 2400", False, travel=80.0)
    fast = built("IRB 2400", False)
    assert slow.program.columns.speed.max() == 80.0
    assert fast.program.columns.speed[0] == 100.0  # where the first motion comes from is not known
    assert len(slow.tour.paths) == len(fast.tour.paths)
    assert fast.cycle.travel < 0.8 * slow.cycle.travel
    assert (slow.program.columns.blend > 0).sum() > 12


def test_where_a_force_presses_ways_out_are_slow_and_every_corner_stops() -> None:
    """The sensor of the force is set to zero on the way, and the tool leaves the edge with the force still there."""
    columns = built("IRB 2400", force=10.0).program.columns
    lines = ~columns.works & ~columns.moves_are(MoveJ)
    assert not columns.blend[~columns.works].any()
    assert columns.speed[lines].max() == 100.0
    assert 100.0 < columns.speed.max() <= 250.0


@pytest.mark.parametrize("post", ["pacscript", "vplus"])
def test_controllers_that_overlap_motions_pass_what_is_slow_enough(post: str) -> None:
    """Where they are fast both motions are rounded over half of their ways, for which there is seldom room."""
    result = built("IRB 1200", False, post, travel=80.0)
    text = "".join(file.text for file in result.files)
    passed = int((result.program.columns.blend > 0).sum())
    assert passed > 12
    stops = text.count("@0 ") if post == "pacscript" else text.count("BREAK")
    assert stops + passed == len(result.program.columns.moves)


# The time of what is passed.

ARM = find_robot("IRB 2400")
PACE = Dynamics(acceleration=5000.0)


def swings(turns: list[FloatArray], blend: float, pace: Dynamics = PACE) -> list[float]:
    """Seconds of motions of the joints, one after the other from home."""
    at, body = ARM.home, []
    for k, turn in enumerate(turns):
        at = at + turn
        body.append(MoveJ(Joints(tuple(at.tolist())), 1e5, blend if k + 1 < len(turns) else 0.0))
    frame = translation(0, 0, 0)
    home = MoveJ(Joints(tuple(ARM.home.tolist())), 100.0)
    program = Program("p", frame, translation(0, 0, 100), whole((home, Comment("x"), *body)))
    found = check_reach(program, ARM, "p")
    seconds: list[float] = time_motions(program, pace, found, ARM)[0].tolist()
    return seconds[1:]


def one_joint(k: int, degrees: float) -> FloatArray:
    turn = np.zeros(len(ARM.home))
    turn[k] = math.radians(degrees)
    return turn


def test_a_motion_that_goes_straight_on_takes_hardly_more_than_one() -> None:
    both = one_joint(5, 60.0) + one_joint(0, 20.0)
    slow = replace(PACE, acceleration=1e9)
    apart, passed = sum(swings([both, both], 0.0, slow)), sum(swings([both, both], 200.0, slow))
    (whole_way,) = swings([2 * both], 0.0, slow)
    assert apart == pytest.approx(
        2 * time_from_rest(np.array((both / ARM.speeds).max()), 1.0, 1 / PACE.ramp)
    )
    assert whole_way - 1e-9 <= passed < whole_way + 0.25 * (apart - whole_way)


def test_a_corner_between_joints_saves_what_both_ramps_can_share() -> None:
    """Two joints in turn: at best one comes to its speed while the other slows down, which saves one ramp."""
    turns = [one_joint(0, 60.0), one_joint(2, 60.0)]
    slow = replace(PACE, acceleration=1e9)
    stopped = sum(swings(turns, 0.0, slow))
    saved = [stopped - sum(swings(turns, zone, slow)) for zone in (1.0, 10.0, 50.0, 200.0)]
    assert saved == sorted(saved)
    assert saved[0] > 0.0
    assert 0.5 * PACE.ramp < saved[-1] <= PACE.ramp + 1e-9
    lapped = replace(slow, corner="overlap")
    assert stopped - sum(swings(turns, 10.0, lapped)) == pytest.approx(PACE.ramp)
