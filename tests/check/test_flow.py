"""Blends of links between edges: they are free by a plain loop over fcl, and needed stops stay."""

import math
from functools import cache, partial

import numpy as np
import pytest
from msgspec.structs import replace

from bench.robots.rfa import FREE, PARTS, make_job, make_loop
from camgen.check.flow import blend_links
from camgen.check.passing import MotionTrace, trace_motions
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


def build_part(name: str, free: bool = False, post: str = "rapid", **process: float) -> Result:
    """Build the part for a cell of the bench. free: the tool may tilt and roll."""
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


def get_arm(result: Result) -> Robot:
    """The arm of a build."""
    assert result.cell.arm is not None
    return result.cell.arm


@cache
def trace_result(result: Result) -> MotionTrace:
    """The motions of a build; each test looks at many of them."""
    assert result.reach is not None
    return trace_motions(result.program, result.reach, get_arm(result))


def interpolate_joints(result: Result, motion: int, fraction: float) -> FloatArray:
    """Joint values (J,) at a fraction of the travel of the TCP in a motion."""
    assert result.reach is not None
    trace = trace_result(result)
    rows = trace.rows(motion)
    travel = trace.travelled[rows] - trace.travelled[rows.start]
    fractions = travel / travel[-1]
    return np.array(
        [np.interp(fraction, fractions, column) for column in result.reach.joints[rows].T]
    )


def make_parabola(result: Result, motion: int, zone: float) -> FloatArray:
    """Joint values (11, J) on a parabola from `zone` mm before the corner to as far after it."""
    trace = trace_result(result)
    lengths = [float(np.ptp(trace.travelled[trace.rows(k)])) for k in (motion, motion + 1)]
    a = interpolate_joints(result, motion, 1 - min(zone / lengths[0], 0.5))
    b = interpolate_joints(result, motion, 1.0)
    c = interpolate_joints(result, motion + 1, min(zone / lengths[1], 0.5))
    t = np.linspace(0, 1, 11)[:, None]
    return np.asarray((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c)


@pytest.mark.parametrize(
    ("name", "free"), [("IRB 2000", True), ("IRB 1200", False), ("IRB 2400", True)]
)
def test_corner_paths_are_free_and_keep_the_margin(name: str, free: bool) -> None:
    result = build_part(name, free)
    fcl_loop, blend = make_loop(result, SOLID), result.program.columns.blend
    blended = np.flatnonzero(blend > 0)
    assert len(blended) >= 12
    for motion in blended.tolist():
        for zone in (blend[motion], 1.6 * blend[motion]):
            for joints in make_parabola(result, motion, zone):
                assert fcl_loop.find_hit(joints) is None
                assert fcl_loop.measure_clearance(joints, 2.0) >= 2.0 - 1e-6


def test_motions_at_the_ends_of_edges_and_before_contact_stop() -> None:
    result = build_part("IRB 2400", True)
    columns = result.program.columns
    ends = columns.works & np.append(columns.path[1:] != columns.path[:-1], True)
    ends[:-1] |= columns.works[:-1] & ~columns.works[1:]
    assert ends.sum() >= len(result.tour.paths) == 15
    assert not columns.blend[ends].any()
    contact = np.flatnonzero(~columns.works & (columns.speed < result.job.process.feed))
    assert len(contact) > 5
    assert not columns.blend[contact].any()
    assert not columns.blend[contact - 1].any()
    # The other links have blends, apart from those before an edge. One more may stop: a motion to
    # the position where the tool is already, which an arc needs as its start.
    links = ~columns.works
    links[:1] = links[contact] = links[contact - 1] = False
    links[:-1] &= ~columns.works[1:]
    links[-1:] = False
    assert (columns.blend[links] == 0).sum() <= 1
    (note,) = [note.what for note in result.notes if "without a stop" in note.what]
    assert note.startswith(f"{int((columns.blend[~columns.works] > 0).sum())} of ")


def test_a_larger_margin_makes_blends_smaller() -> None:
    result = build_part("IRB 2400", True)
    assert result.reach is not None
    assert result.where is not None
    unblended = result.program.with_body(
        tuple(
            replace(motion, blend=0.0) if isinstance(motion, (MoveJ, MoveL)) else motion
            for motion in result.program.body
        )
    )
    inputs = unblended, result.reach
    flow = Flow(10.0, math.inf, -math.inf)
    with_margin, _ = blend_links(*inputs, replace(result.where, margin=60.0), result.cell, flow)
    without_margin, _ = blend_links(*inputs, result.where, result.cell, flow)
    assert without_margin.columns.blend.tolist() == result.program.columns.blend.tolist()
    assert (with_margin.columns.blend <= without_margin.columns.blend).all()
    assert with_margin.columns.blend.sum() < 0.8 * without_margin.columns.blend.sum()


def test_triangles_that_are_called_free_contain_no_collision() -> None:
    result = build_part("IRB 2400", True)
    assert result.where is not None
    scene, arm = result.where.scene, get_arm(result)
    assert result.reach is not None
    rng = np.random.default_rng(4)
    first = result.reach.joints[rng.integers(0, len(result.reach.joints), 150)]
    corners = first[:, None] + rng.normal(0.0, 0.1, (150, 3, len(arm.joints)))
    is_free = are_free(scene, corners, np.arange(150), 1.0)
    weights = rng.dirichlet(np.ones(3), (150, 60))
    inside = np.einsum("kns,ksj->knj", weights, corners)
    collides = (
        (find_collisions(scene, inside.reshape(-1, inside.shape[-1]), near=1.0) >= 0)
        .reshape(150, 60)
        .any(axis=1)
    )
    assert not (is_free & collides).any()
    assert is_free.sum() > 40
    assert collides.sum() > 20
    # Only a few free triangles are not recognised as free.
    assert (~is_free & ~collides).sum() < 40


def test_links_are_as_fast_as_the_joints_and_points_of_the_arm_allow() -> None:
    """A link is as fast as the joints or the fastest point of the arm, at 250 mm/s, allow."""
    result = build_part("IRB 2400", True)
    assert result.reach is not None
    assert result.where is not None
    distance = partial(measure_apart, result.where.scene)
    arm, columns = get_arm(result), result.program.columns
    trace = trace_result(result)
    full = 0
    links = np.flatnonzero(~columns.works & (columns.speed > result.job.process.feed))
    for k in links[1:].tolist():
        rows = trace.rows(k)
        mm, seconds = np.diff(trace.travelled[rows]), np.diff(trace.seconds[rows])
        if isinstance(columns.moves[k], MoveJ):
            fastest = measure_point_speed(arm, distance, result.reach.joints[rows])
            limit = min(1.0, 250.0 / fastest)
            assert 0 < columns.share[k] <= limit * 1.02
            # Links at the part are slower.
            if columns.speed[k] > result.job.process.travel_speed:
                assert columns.share[k] == pytest.approx(limit, rel=0.02)
                # The mean speed of the TCP at this fraction, rounded down to a whole number.
                mean = columns.share[k] * mm.sum() / seconds.sum()
                assert 0.98 * mean - 1 <= columns.speed[k] <= 1.01 * mean + 1
                full += 1
        elif mm.sum() > 1.0:
            # Rows along a line are 10 mm apart. Between them a joint may be a little faster than on
            # average.
            assert columns.speed[k] <= (mm / seconds).min() * 1.02
    assert full > 5


def test_all_links_keep_a_given_travel_speed() -> None:
    slow = build_part("IRB 2400", False, travel=80.0)
    fast = build_part("IRB 2400", False)
    assert slow.program.columns.speed.max() == 80.0
    assert fast.program.columns.speed[0] == 100.0  # the start of the first motion is unknown
    assert len(slow.tour.paths) == len(fast.tour.paths)
    assert fast.cycle.travel < 0.8 * slow.cycle.travel
    assert (slow.program.columns.blend > 0).sum() > 12


def test_with_a_force_lines_of_links_are_slow_and_have_no_blends() -> None:
    """The force sensor is zeroed on the approach, and the tool leaves the edge under force."""
    columns = build_part("IRB 2400", force=10.0).program.columns
    lines = ~columns.works & ~columns.moves_are(MoveJ)
    assert not columns.blend[~columns.works].any()
    assert columns.speed[lines].max() == 100.0
    assert 100.0 < columns.speed.max() <= 250.0


@pytest.mark.parametrize("post", ["pacscript", "vplus"])
def test_controllers_that_overlap_motions_blend_slow_links(post: str) -> None:
    """Fast motions overlap over half of their lengths, and that is seldom free."""
    result = build_part("IRB 1200", False, post, travel=80.0)
    text = "".join(file.text for file in result.files)
    blended = int((result.program.columns.blend > 0).sum())
    assert blended > 12
    stops = text.count("@0 ") if post == "pacscript" else text.count("BREAK")
    assert stops + blended == len(result.program.columns.moves)


# The time of blended motions.

ARM = find_robot("IRB 2400")
PACE = Dynamics(acceleration=5000.0)


def time_joint_motions(
    changes: list[FloatArray], blend: float, pace: Dynamics = PACE
) -> list[float]:
    """Seconds of joint motions from home, each by a change of the joint values (J,)."""
    joints, body = ARM.home, []
    for k, change in enumerate(changes):
        joints = joints + change
        body.append(
            MoveJ(Joints(tuple(joints.tolist())), 1e5, blend if k + 1 < len(changes) else 0.0)
        )
    frame = translation(0, 0, 0)
    home = MoveJ(Joints(tuple(ARM.home.tolist())), 100.0)
    program = Program("p", frame, translation(0, 0, 100), whole((home, Comment("x"), *body)))
    trace = check_reach(program, ARM, "p")
    seconds: list[float] = time_motions(program, pace, trace, ARM).tolist()
    return seconds[1:]


def rotate_joint(k: int, degrees: float) -> FloatArray:
    """The change of the joint values (J,) if joint k rotates alone."""
    change = np.zeros(len(ARM.home))
    change[k] = math.radians(degrees)
    return change


def test_two_equal_blended_motions_take_hardly_longer_than_a_single_one() -> None:
    change = rotate_joint(5, 60.0) + rotate_joint(0, 20.0)
    pace = replace(PACE, acceleration=1e9)
    stopped = sum(time_joint_motions([change, change], 0.0, pace))
    blended = sum(time_joint_motions([change, change], 200.0, pace))
    (single,) = time_joint_motions([2 * change], 0.0, pace)
    assert stopped == pytest.approx(
        2 * time_from_rest(np.array((change / ARM.speeds).max()), 1.0, 1 / PACE.ramp)
    )
    assert single - 1e-9 <= blended < single + 0.25 * (stopped - single)


def test_a_blend_between_two_joints_saves_one_ramp_at_most() -> None:
    """At best one joint accelerates while the other one brakes, which saves one ramp."""
    changes = [rotate_joint(0, 60.0), rotate_joint(2, 60.0)]
    pace = replace(PACE, acceleration=1e9)
    stopped = sum(time_joint_motions(changes, 0.0, pace))
    saved = [
        stopped - sum(time_joint_motions(changes, zone, pace)) for zone in (1.0, 10.0, 50.0, 200.0)
    ]
    assert saved == sorted(saved)
    assert saved[0] > 0.0
    assert 0.5 * PACE.ramp < saved[-1] <= PACE.ramp + 1e-9
    overlap = replace(pace, corner="overlap")
    assert stopped - sum(time_joint_motions(changes, 10.0, overlap)) == pytest.approx(PACE.ramp)
