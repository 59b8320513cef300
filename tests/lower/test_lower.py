"""From a tour to a program: sequence, heights, blends, orientations and forces."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle
from camgen.lower import lower
from camgen.model.cell import Cell
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.job import CellTable, Job, OperationTable, ProcessTable, ToleranceTable, ToolTable
from camgen.model.path import ToolPath, Tour, make_waypoints
from camgen.model.pose import (
    TOOL_DOWN,
    Pose,
    angle_between,
    pose_from_values,
    rotation_about,
    translation,
)
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.post.passes import corner_blend
from camgen.robots.workcell import equip_cell
from fixtures.program_text import dump
from tests.support.examples import fewer

ROBOT = Cell(
    "arm", translation(100, 0, 0), translation(0, 0, 0), Joints((0.0, 0.1, 0.2, 0.0, 0.3, 0.0))
)
MILL = Cell("mill", translation(0, 0, 0), translation(0, 0, 0), Pose(TOOL_DOWN, (0.0, 0.0, 50.0)))
FOLLOW = ToolTable(orient="follow")


def path(points, bulges=None, force_direction=None, force=None, feed=20.0, **more):
    """A tool path through points in the plane.

    bulges: one per segment, as in DXF.
    force_direction: pairs for start and end, one per segment.
    """
    points = np.asarray(points, dtype=float)
    n = len(points)
    position = np.column_stack([points, np.zeros(n)])
    via = np.full((n, 3), np.nan)
    for i, b in enumerate(bulges or [], start=1):
        if b:
            a, c = points[i - 1], points[i]
            chord = c - a
            # A bulge is the sagitta over half the chord. A counter-clockwise arc is to the right of
            # its chord.
            via[i, :2] = (a + c) / 2 + b / 2 * np.array([chord[1], -chord[0]])
            via[i, 2] = 0
    pressed = np.zeros((n, 2, 3))
    if force_direction is not None:
        pressed[1:, :, :2] = force_direction
        pressed[0] = pressed[1]
    forces = np.zeros(n)
    if force is not None:
        forces[1:] = force
        forces[0] = forces[1]
    settings = {"id": "c1", "layer": "cut", "closed": False, **more}
    return ToolPath(
        table=make_waypoints(position, via, feed, force_direction=pressed, force=forces),
        **settings,
    )


def program(*paths, cell=ROBOT, job=None) -> Program:
    job = job or Job()
    return lower(
        Tour(tuple(paths), 0.0, "as-drawn"),
        equip_cell(cell, job),
        job,
        "part",
        ("made for a test",),
    )


def kinds(body):
    return " ".join(type(item).__name__ for item in body)


SQUARE = path([(0, 0), (40, 0), (40, 30), (0, 30), (0, 0)], closed=True)


def test_a_square_becomes_the_expected_sequence():
    job = Job(process=ProcessTable(dwell=0.25), tool=ToolTable(length=80.0))
    assert dump(program(SQUARE, job=job)) == (
        "camgen-ir 1\nname part\nwork 100 0 0 q 1 0 0 0\ntool 0 0 80 q 1 0 0 0\n# made for a test\n"
        'path ["c1", "cut", ""]\n'
        "body\n"
        "output process 0\n"
        "movej joints 0 0.1 0.2 0 0.3 0 speed 100\n"
        "# path c1 layer cut\n"
        "movej 0 0 20 q 0 1 0 0 speed 100 path 0\n"
        "movel 0 0 2 q 0 1 0 0 speed 100 path 0\n"
        "movel 0 0 0 q 0 1 0 0 speed 6.666667 path 0\n"
        "output process 1\n"
        "wait 0.25\n"
        "movel 40 0 0 q 0 1 0 0 speed 20 path 0 work\n"
        "movel 40 30 0 q 0 1 0 0 speed 20 path 0 work\n"
        "movel 0 30 0 q 0 1 0 0 speed 20 path 0 work\n"
        "movel 0 0 0 q 0 1 0 0 speed 20 path 0 work\n"
        "output process 0\n"
        "movel 0 0 20 q 0 1 0 0 speed 100 path 0\n"
        "movej joints 0 0.1 0.2 0 0.3 0 speed 100\n"
    )


def test_a_mill_travels_by_rapid_motions_only():
    job = Job(process=ProcessTable(spindle=9000, dwell=1.0, travel=50.0))
    body = program(SQUARE, path([(60, 0), (70, 0)], id="c2"), cell=MILL, job=job).body
    assert [type(i) for i in body[:4]] == [Output, MoveJ, Output, Wait]
    assert body[2] == Output("spindle", 9000)
    assert body[-2] == Output("spindle", 0.0)
    for home in (body[1].target, body[-1].target):
        assert home.origin == MILL.home.origin
        assert home.rotation is MILL.home.rotation
    assert all(
        isinstance(i, MoveJ) == (i.speed == 50.0) for i in body if isinstance(i, (MoveJ, MoveL))
    )
    assert [i.value for i in body if isinstance(i, Output) and i.signal == "spindle"] == [
        0.0,
        9000,
        0.0,
    ]
    assert {i.signal for i in body if isinstance(i, Output)} == {"spindle"}


@pytest.mark.parametrize(
    ("process", "signal"),
    [
        (ProcessTable(), "process"),
        (ProcessTable(spindle=1.0), None),
        (ProcessTable(spindle=1.0, signal="air"), "air"),
        (ProcessTable(signal=""), None),
        (ProcessTable(signal="glue"), "glue"),
    ],
)
def test_the_process_switches_its_signal(process, signal):
    body = program(SQUARE, job=Job(process=process)).body
    names = {item.signal for item in body if isinstance(item, Output)}
    assert names - {"spindle"} == ({signal} if signal else set())
    assert ("spindle" in names) == (process.spindle > 0)


def test_a_signal_named_spindle_is_refused():
    with pytest.raises(JobError, match=r"process\.signal"):
        program(SQUARE, job=Job(process=ProcessTable(signal="spindle")))


def test_a_link_is_at_clearance_height_and_its_two_upper_corners_are_blended():
    body = program(path([(0, 0), (9, 0)]), path([(50, 0), (60, 0)], id="c2")).body
    up, comment, across, down = body[9:13]
    assert (up.target.origin, up.blend) == ((9, 0, 20), 5.0)
    assert comment == Comment("path c2 layer cut")
    assert (across.target.origin, across.blend, across.speed) == ((50, 0, 20), 5.0, 100.0)
    assert (down.target.origin, down.blend, down.speed) == ((50, 0, 2), 0.0, 100.0)


@pytest.mark.parametrize(("gap", "zone"), [(9.99, 1.0), (1.9, 0.3), (0.5, 0.0), (10.0, 5.0)])
def test_the_corners_of_a_short_link_are_blended_within_half_of_it(gap, zone):
    body = program(path([(0, 0), (9, 0)]), path([(9 + gap, 0), (60, 0)], id="c2")).body
    assert [body[9].blend, body[11].blend] == [zone, zone]


def test_a_path_that_starts_at_the_end_of_the_previous_one_has_no_link():
    body = program(path([(0, 0), (9, 0)]), path([(9, 0), (9, 9)], id="c2")).body
    ends = [i.target.origin for i in body[9:13] if not isinstance(i, Comment)]
    assert ends == [(9, 0, 20), (9, 0, 2), (9, 0, 0)]
    assert body[9].blend == 0.0


def test_the_feed_begins_above_the_top_face_at_any_depth():
    body = program(
        path([(0, 0), (9, 0)], depths=(6.0,)), job=Job(process=ProcessTable(approach=1.5))
    ).body
    moves = [i for i in body if isinstance(i, (MoveL, MoveJ)) and i.target != ROBOT.home]
    assert [i.target.origin[2] for i in moves if i.speed == 100] == [20, 1.5, 20]
    assert {i.target.origin[2] for i in body if isinstance(i, MoveL) and i.speed == 20} == {-6.0}


def test_a_closed_path_plunges_from_pass_to_pass():
    body = program(replace(SQUARE, depths=(1.0, 2.0, 3.0))).body
    heights = [i.target.origin[2] for i in body if isinstance(i, MoveL)]
    assert heights == [2, -1, -1, -1, -1, -1, -2, -2, -2, -2, -2, -3, -3, -3, -3, -3, 20]


@pytest.mark.parametrize(
    ("process", "operation", "speed"),
    [
        (ProcessTable(), "follow", 20 / 3),
        (ProcessTable(feed=60.0), "follow", 20.0),
        (ProcessTable(plunge=3.0), "follow", 3.0),
        (ProcessTable(plunge=30.0), "follow", 30.0),
        (ProcessTable(plunge=70.0), "follow", 40.0),  # the path is slower there
        (ProcessTable(), "drill", 20.0),
    ],
)
def test_a_plunge_has_its_own_speed(process, operation, speed):
    """It is a third of the feed by default, and not faster than the path. A drill has the feed."""
    fast = SQUARE.with_columns(feed=np.array([40.0, 40.0, 20.0, 20.0, 20.0]))
    fast = replace(fast, depths=(1.0, 2.0), operation=operation)
    body = program(fast, job=Job(process=process)).body
    body = [item for item in body if isinstance(item, (MoveJ, MoveL))]
    down = [b for a, b in pairwise(body) if isinstance(b, MoveL) and sinks(a, b)]
    plunges = [(-1, pytest.approx(speed)), (-2, pytest.approx(speed))]
    assert [(i.target.origin[2], i.speed) for i in down] == [(2, 100), *plunges]
    assert [i.speed for i in body if isinstance(i, MoveL)][2] == 40


def sinks(before, motion) -> bool:
    target = getattr(before, "target", None)
    return isinstance(target, Pose) and motion.target.origin[2] < target.origin[2]


def test_an_open_path_runs_back_and_forth():
    body = program(path([(0, 0), (9, 0), (9, 5)], depths=(1.0, 2.0, 3.0))).body
    cuts = [i.target.origin for i in body if isinstance(i, MoveL) and i.speed < 100]
    assert cuts == [
        (0, 0, -1),
        (9, 0, -1),
        (9, 5, -1),
        (9, 5, -2),
        (9, 0, -2),
        (0, 0, -2),
        (0, 0, -3),
        (9, 0, -3),
        (9, 5, -3),
    ]
    assert sum(isinstance(i, MoveL) and i.target.origin[2] == 20 for i in body) == 1


def test_an_open_path_that_keeps_its_direction_retracts_between_passes():
    body = program(path([(0, 0), (9, 0)], depths=(1.0, 2.0), reversible=False)).body
    assert [i.target.origin for i in body if isinstance(i, MoveL)] == [
        (0, 0, 2),
        (0, 0, -1),
        (9, 0, -1),
        (9, 0, 20),
        (0, 0, 20),
        (0, 0, 2),
        (0, 0, -2),
        (9, 0, -2),
        (9, 0, 20),
    ]


@pytest.mark.parametrize(
    ("process", "expected"),
    [
        (ProcessTable(approach=0.0), [(0, 0, 20, 100), (0, 0, 0, 100)]),
        (ProcessTable(approach=20.0), [(0, 0, 20, 100), (0, 0, 0, 20 / 3)]),
        (ProcessTable(approach=2.0), [(0, 0, 20, 100), (0, 0, 2, 100), (0, 0, 0, 20 / 3)]),
    ],
)
def test_a_motion_of_length_0_is_left_out(process, expected):
    body = program(path([(0, 0), (9, 0)]), job=Job(process=process)).body
    first = body.index(Output("process", 1.0))
    assert [(*i.target.origin, i.speed) for i in body[3:first]] == expected


def test_an_approach_above_the_clearance_height_is_refused():
    with pytest.raises(JobError, match=r"path c1.*process\.clearance"):
        program(SQUARE, job=Job(process=ProcessTable(approach=21.0)))


@pytest.mark.parametrize("depth", [0.0, 6.0])
def test_a_tilted_tool_approaches_and_retracts_along_its_axis(depth):
    """Heights are measured from the top face at any depth."""
    axis = np.array([math.sin(0.5), 0.0, -math.cos(0.5)])
    tilted = path([(0, 0), (0, 9)], depths=(depth,)).with_columns(axis=np.array(axis))
    body = program(tilted, job=Job(process=ProcessTable(switch="contact"))).body
    assert body[3].target.origin == pytest.approx(tuple(-20 * axis))
    assert body[4].target.origin == pytest.approx(tuple(-2 * axis))
    assert body[9].target.origin == pytest.approx(tuple(np.array([0, 9, 0]) - 20 * axis))
    rotation = body[5].target.rotation
    assert rotation[:, 2] == pytest.approx(axis)
    assert rotation[1, 0] == pytest.approx(0.0)
    assert rotation[0, 0] > 0


def test_a_tool_along_the_work_x_still_has_an_orientation():
    level = path([(0, 0), (0, 9)]).with_columns(axis=np.array([-1.0, 0.0, 0.0]))
    assert program(level).body[3].target.rotation[:, 0] == pytest.approx([0, 1, 0])


def test_rotations_are_shared():
    rotations = {id(i.target.rotation) for i in program(SQUARE).body if isinstance(i, MoveL)}
    assert rotations == {id(TOOL_DOWN)}


def test_a_tour_without_paths_is_refused():
    with pytest.raises(NoSafeProgram):
        program()


def test_a_path_of_one_point_is_touched():
    assert kinds(program(path([(3, 4)])).body) == (
        "Output MoveJ Comment MoveJ MoveL MoveL Output Output MoveL MoveJ"
    )


# Blends


@given(
    st.lists(st.tuples(st.floats(-3.1, 3.1), st.floats(0.05, 40.0)), min_size=2, max_size=8),
    st.sampled_from([0.001, 0.01, 0.3]),
)
def test_the_blends_of_a_polyline_are_those_of_its_corners(steps, tolerance):
    points, heading = [(0.0, 0.0)], 0.0
    for turn, length in steps:
        heading += turn
        points.append(
            (points[-1][0] + length * math.cos(heading), points[-1][1] + length * math.sin(heading))
        )
    body = program(path(points), job=Job(tolerance=ToleranceTable(chord=tolerance))).body
    first = body.index(Output("process", 1.0)) + 1
    cuts = body[first : first + len(steps)]
    for i, cut in enumerate(cuts[:-1]):
        at_corner = corner_blend(steps[i + 1][0], tolerance)
        half = min(steps[i][1], steps[i + 1][1]) / 2
        # A corner angle within 1e-9 rad of the limit of a zone may have this zone or the next one.
        above, below = (corner_blend(steps[i + 1][0] + d, tolerance) for d in (1e-9, -1e-9))
        if above == below:
            zones = [z for z in (5.0, 1.0, 0.3) if z <= min(at_corner, max(half + 1e-9, 0.3))]
            largest = pytest.approx(max(zones, default=0.0))
            assert cut.blend == largest or abs(cut.blend - half) < 1e-6
    assert cuts[-1].blend == 0.0


def test_the_corner_between_a_line_and_a_tangent_arc_is_blended():
    quarter = math.tan(math.pi / 8)
    smooth = path([(0, 0), (20, 0), (30, 10), (30, 40)], bulges=[0, quarter, 0])
    cuts = [i for i in program(smooth).body if isinstance(i, (MoveL, MoveC)) and i.work]
    # A zone of b mm leaves an arc of 10 mm by 3/32 b^2 / 10, which is 0.01 mm with b = 1.03.
    assert [c.blend for c in cuts] == [1.0, 1.0, 0.0]
    kinked = path([(0, 0), (20, 0), (30, 10), (30, 40)], bulges=[0, -quarter, 0])
    cuts = [i for i in program(kinked).body if isinstance(i, (MoveL, MoveC)) and i.work]
    assert [c.blend for c in cuts] == [0.0, 0.0, 0.0]


# Orientation along the contour


def slot(force=0.0):
    """Two lines and two half circles around a slot, clockwise, with the surface on the right."""
    points = [(0, 10), (40, 10), (40, -10), (0, -10), (0, 10)]
    down, up = (0, -1), (0, 1)
    press = [(down, down), (down, up), (up, up), (up, down)]
    return path(points, [0, -1, 0, -1], press, [force] * 4, closed=True, id="slot")


def test_follow_keeps_tool_x_on_the_surface():
    body = program(slot(), job=Job(tool=FOLLOW)).body
    cuts = [i for i in body if isinstance(i, (MoveL, MoveC)) and i.speed == 20]
    assert any(isinstance(cut, MoveC) for cut in cuts)
    for cut in cuts:
        x, y, _ = cut.target.origin
        centre = np.array([min(max(x, 0.0), 40.0), 0.0, 0.0])
        towards = (centre - (x, y, 0.0)) / 10.0
        assert cut.target.rotation[:, 0] == pytest.approx(towards, abs=1e-12)
        assert cut.target.rotation[:, 2] == pytest.approx([0, 0, -1])
        if isinstance(cut, MoveC):
            x, y, _ = cut.via.origin
            centre = np.array([min(max(x, 0.0), 40.0), 0.0, 0.0])
            assert cut.via.rotation[:, 0] == pytest.approx((centre - (x, y, 0.0)) / 10.0, abs=1e-12)


def test_a_half_circle_is_halved_if_the_tool_turns_with_it():
    body = program(slot(force=5.0), job=Job(tool=FOLLOW)).body
    arcs = [(start.target, arc) for start, arc in pairwise(body) if isinstance(arc, MoveC)]
    assert len(arcs) == 4
    for start, arc in arcs:
        centre, radius, axis, sweep = compute_circle(
            start.origin, arc.via.origin, arc.target.origin
        )
        assert radius == pytest.approx(10)
        assert sweep == pytest.approx(math.pi / 2)
        assert axis[2] == pytest.approx(-1)
        assert angle_between(start.rotation, arc.target.rotation) == pytest.approx(math.pi / 2)
        assert arc.force_direction == pytest.approx(
            tuple((centre - np.array(arc.target.origin)) / 10)
        )
        assert math.dist(start.origin, arc.via.origin) == pytest.approx(
            math.dist(arc.via.origin, arc.target.origin)
        )
    assert sum(isinstance(i, MoveC) for i in program(slot()).body) == 2


def test_the_tool_turns_at_a_fixed_tcp_in_an_inner_corner():
    inner = path(
        [(0, 0), (20, 0), (20, 20)],
        force_direction=[((0, 1), (0, 1)), ((1, 0), (1, 0))],
        force=[4.0, 6.0],
    )
    body = program(inner, job=Job(tool=FOLLOW)).body
    first = next(i for i, item in enumerate(body) if isinstance(item, Force) and item.newtons) + 2
    arrive, turn, leave = body[first : first + 3]
    assert arrive.target.origin == turn.target.origin == (20, 0, 0)
    assert arrive.blend == turn.blend == 0.0
    assert arrive.target.rotation[:, 0] == pytest.approx([0, 1, 0])
    assert turn.target.rotation[:, 0] == pytest.approx([1, 0, 0])
    assert (arrive.force, turn.force, leave.force) == (4.0, 6.0, 6.0)
    assert (arrive.force_direction, turn.force_direction, leave.force_direction) == (
        (0, 1, 0),
        (1, 0, 0),
        (1, 0, 0),
    )


def test_a_rotation_of_less_than_half_a_degree_has_no_reorientation():
    a = math.radians(0.4)
    slight = path(
        [(0, 0), (20, 0), (40, 0)],
        force_direction=[((0, 1), (0, 1)), ((-math.sin(a), math.cos(a)),) * 2],
    )
    body = program(slight, job=Job(tool=FOLLOW)).body
    cuts = [i for i in body if isinstance(i, MoveL) and i.work]
    assert len(cuts) == 2
    assert not any(cut.turn for cut in cuts)


def test_a_reorientation_has_its_own_speed():
    inner = path([(0, 0), (20, 0), (20, 20)], force_direction=[((0, 1), (0, 1)), ((1, 0), (1, 0))])
    for table, speed in ((ProcessTable(), 60.0), (ProcessTable(turn=25.0), 25.0)):
        body = program(inner, job=Job(tool=FOLLOW, process=table)).body
        turns = [math.degrees(i.turn) for i in body if isinstance(i, MoveL) and i.work]
        assert turns == pytest.approx([0, speed, 0])
        assert not any(i.turn for i in body if isinstance(i, MoveL) and not i.work)


def test_follow_needs_a_surface():
    with pytest.raises(JobError, match=r"path c1.*tool\.orient"):
        program(slot(), path([(0, 0), (9, 0)]), job=Job(tool=FOLLOW))


# Force


def test_force_is_on_only_along_sections_with_a_force():
    press = [((0, 1), (0, 1))] * 5
    partly = path(
        [(0, 0), (9, 0), (19, 0), (29, 0), (39, 0), (49, 0)],
        force_direction=press,
        force=[0, 7, 8, 0, 9],
    )
    body = program(partly).body
    first = body.index(Output("process", 1.0))
    assert kinds(body[first:]) == (
        "Output MoveL Force MoveL MoveL Force MoveL MoveL MoveL Force MoveL Output Force "
        "MoveL MoveJ"
    )
    assert [i.newtons for i in body if isinstance(i, Force)] == [0.0, 7.0, 0.0, 9.0, 0.0]
    cuts = [i for i in body[first:] if isinstance(i, MoveL)]
    assert [c.force for c in cuts] == [0, 7, 8, 0, 0, 0, 9, 0]
    # The corner from 7 N to 8 N is blended. At all other corners a force begins or ends.
    assert [c.blend for c in cuts] == [0, 5, 0, 0, 0, 0, 0, 0]
    # After a section under force: up, the section without force above the part, and down.
    assert [(c.target.origin, c.speed) for c in cuts[3:6]] == [
        ((29, 0, 5), 20.0),
        ((39, 0, 5), 20.0),
        ((39, 0, 0), pytest.approx(20 / 3)),
    ]
    # The first section, before any force, is run at its planned height.
    assert cuts[0].target.origin == (9, 0, 0)


@pytest.mark.parametrize(
    ("table", "depth", "height"),
    [
        (ProcessTable(), 0.0, 5.0),
        (ProcessTable(), 2.0, 5.0),  # above the top face at any depth
        (ProcessTable(retract=8.5), 2.0, 8.5),
        (ProcessTable(retract=50.0), 0.0, 20.0),  # not above the clearance height
    ],
)
def test_a_section_after_one_under_force_is_run_above_the_part(table, depth, height):
    """The section is a lead-out on a quarter circle, before which the tool rises."""
    quarter = math.tan(math.pi / 8)
    press = [((0, -1), (0, -1))] * 2
    left = path([(0, 0), (20, 0), (30, 10)], [0, quarter], press, [7.0, 0.0], depths=(depth,))
    body = program(left, job=Job(process=table)).body
    tail = body[-10:] if height < 20 else body[-9:]
    down, start, _, pressed, end, up, arc, _, *rest = tail
    assert (down.target.origin, start.newtons) == ((0, 0, -depth), 7.0)
    assert (pressed.target.origin, pressed.force, pressed.blend) == ((20, 0, -depth), 7.0, 0.0)
    assert end == Force(0.0)
    assert (up.target.origin, up.force, up.speed) == ((20, 0, height), 0.0, 20.0)
    assert isinstance(arc, MoveC)
    assert (arc.target.origin, arc.force, arc.work) == ((30, 10, height), 0.0, True)
    assert arc.via.origin == pytest.approx(
        (20 + 10 * math.sqrt(0.5), 10 - 10 * math.sqrt(0.5), height)
    )
    ends = [i.target.origin for i in rest if isinstance(i, MoveL)]
    assert ends == ([(30, 10, 20)] if height < 20 else [])


def test_force_is_on_before_the_process_and_off_after_it():
    pressed = path([(0, 0), (9, 0)], force_direction=[((0, 1), (0, 1))], force=[7])
    body = program(pressed).body
    assert body[:2] == (Output("process", 0.0), Force(0.0))
    assert kinds(body[6:]) == "MoveL Force Output MoveL Output Force MoveL MoveJ"
    assert body[7] == Force(7.0, (0.0, 1.0, 0.0))


def test_the_force_along_an_arc_begins_in_the_direction_at_its_start():
    """The force on a quarter circle about (0, 10) is towards its centre."""
    quarter = math.tan(math.pi / 8)
    arc = path([(0, 0), (10, 10)], [quarter], [((0, 1), (-1, 0))], [7])
    body = program(arc).body
    assert [item for item in body if isinstance(item, Force)][1] == Force(7.0, (0.0, 1.0, 0.0))
    (motion,) = [item for item in body if isinstance(item, MoveC)]
    assert motion.force_direction == (-1.0, 0.0, 0.0)


# Places at which the signal is switched

UP, DOWN = "Output MoveJ Comment MoveJ MoveL", "MoveL MoveL MoveL MoveL"


@pytest.mark.parametrize(
    ("operation", "table", "air"),
    [
        ({}, {}, False),
        ({"depth": 3.0}, {}, True),
        ({}, {"force": 5.0}, True),
        ({"depth": 3.0}, {"switch": "contact"}, False),
        ({}, {"switch": "contact", "force": 5.0}, False),
        ({}, {"switch": "air"}, True),
    ],
)
@pytest.mark.parametrize("dwell", [0.0, 0.5])
def test_a_rotating_tool_is_switched_above_the_part_and_a_torch_at_contact(
    operation, table, air, dwell
):
    job = Job(operation=OperationTable(**operation), process=ProcessTable(dwell=dwell, **table))
    cut = replace(SQUARE, depths=(operation.get("depth", 0.0),))
    body = program(cut, job=job).body
    on = "Output Wait" if dwell else "Output"
    in_air = f"{UP} {on} MoveL {DOWN} MoveL Output MoveJ"
    assert kinds(body) == (in_air if air else f"{UP} MoveL {on} {DOWN} Output MoveL MoveJ")
    first = body.index(Output("process", 1.0))
    last = len(body) - 1 - body[::-1].index(Output("process", 0.0))
    depth = operation.get("depth", 0.0)
    before, after = body[first - 1].target.origin, body[last - 1].target.origin
    assert (before, after) == (((0, 0, 2), (0, 0, 20)) if air else ((0, 0, -depth), (0, 0, -depth)))
    if dwell:
        assert body[first + 1] == Wait(0.5)


def test_a_rotating_tool_stays_on_between_passes_without_a_lift():
    job = Job(operation=OperationTable(depth=3.0, passes=3))
    body = program(replace(SQUARE, depths=(1.0, 2.0, 3.0)), job=job).body
    assert [i.value for i in body if isinstance(i, Output)] == [0.0, 1.0, 0.0]


def test_a_tool_that_is_switched_in_the_air_stops_there():
    """The approach begins at the clearance height, so the tool is switched on at that corner."""
    job = Job(process=ProcessTable(switch="air", approach=20.0))
    body = program(path([(0, 0), (9, 0)]), path([(50, 0), (60, 0)], id="c2"), job=job).body
    before_outputs = [before for before, item in pairwise(body) if isinstance(item, Output)]
    stops = [item for item in before_outputs if not isinstance(item, Comment)]
    assert [i.target.origin for i in stops] == [(0, 0, 20), (9, 0, 20), (50, 0, 20), (60, 0, 20)]
    assert not any(i.blend for i in stops)


def test_a_cut_with_the_spindle_at_rest_is_refused():
    """A machine with three axes and a depth is a mill unless `process.switch` is set."""
    job = Job(operation=OperationTable(depth=3.0))
    with pytest.raises(JobError) as caught:
        program(SQUARE, cell=MILL, job=job)
    assert str(caught.value) == (
        "job: a cut of 3 mm with the spindle at rest (process.spindle); set it to the "
        "speed in rpm, or process.switch "
        'to "contact" for a laser or a plasma torch'
    )
    program(SQUARE, cell=ROBOT, job=job)
    program(SQUARE, cell=MILL, job=Job())
    for process in (
        ProcessTable(spindle=9000),
        ProcessTable(switch="contact"),
        ProcessTable(switch="air"),
    ):
        program(SQUARE, cell=MILL, job=replace(job, process=process))


def ring(**more):
    """A path around a square of 40 mm with inward forces, along which the tool turns once."""
    inward = [(0, 1), (-1, 0), (0, -1), (1, 0)]
    press = [(direction, direction) for direction in inward]
    points = [(0, 0), (40, 0), (40, 40), (0, 40), (0, 0)]
    return path(points, force_direction=press, closed=True, depths=(1.0, 2.0, 3.0), **more)


@pytest.mark.parametrize("switch", ["contact", "air"])
@pytest.mark.parametrize("approach", [0.5, 2.0])
def test_a_tool_turns_back_between_passes_at_the_approach_height(switch, approach):
    job = Job(tool=FOLLOW, process=ProcessTable(switch=switch, approach=approach))
    body = program(ring(), job=job).body
    moves = [i for i in body if isinstance(i, (MoveJ, MoveL)) and isinstance(i.target, Pose)]
    heights = [i.target.origin[2] for i in moves if not i.work]
    # Reorientations do not change the height.
    changes = [z for a, z in zip((None, *heights), heights, strict=False) if z != a]
    assert changes == [20, approach, -1, approach, -2, approach, -3, 20]
    links = [item for item in moves if not item.work]
    assert {i.target.origin[:2] for i in links if i.target.origin[2] == approach} == {(0, 0)}
    # The process is on along each pass, and off while the tool turns back.
    on = False
    for item in body:
        if isinstance(item, Output):
            on = bool(item.value)
        elif isinstance(item, MoveL):
            assert item.work <= on
            assert not (on and item.turn and not item.work)


def test_a_mill_goes_down_between_passes_without_a_lift():
    body = program(ring(), cell=MILL, job=Job(tool=FOLLOW, process=ProcessTable(spindle=9000))).body
    heights = [i.target.origin[2] for i in body if isinstance(i, (MoveJ, MoveL)) and not i.work]
    assert heights == [50, 20, 2, -1, -2, -3, 20, 50]


# Properties of whole programs


@st.composite
def tours(draw):
    count = draw(st.integers(1, 4))
    paths = []
    for k in range(count):
        n = draw(st.integers(2, 5))
        positions = st.tuples(st.integers(-50, 50), st.integers(-50, 50))
        points = draw(st.lists(positions, min_size=n, max_size=n, unique=True))
        closed = draw(st.booleans())
        points += [points[0]] * closed
        size = {"min_size": len(points) - 1, "max_size": len(points) - 1}
        bulges = draw(st.lists(st.sampled_from([0, 0, 1.0, -0.4]), **size))
        force = draw(st.lists(st.sampled_from([0, 0, 5.0, 9.0]), **size))
        angles = draw(st.lists(st.floats(0, 6.28), **size))
        press = [
            ((math.cos(a), math.sin(a)), (math.cos(a + 0.2), math.sin(a + 0.2))) for a in angles
        ]
        depths = draw(st.sampled_from([(0.0,), (1.0,), (1.0, 2.0), (0.5, 1.0, 1.5)]))
        more = {
            "closed": closed,
            "depths": depths,
            "reversible": draw(st.booleans()),
            "id": f"c{k}",
        }
        paths.append(path(points, bulges, press, force, **more))
    return paths


@fewer(12)
@given(
    tours(),
    st.sampled_from([ROBOT, MILL]),
    st.sampled_from(["fixed", "follow"]),
    st.sampled_from([0.0, 8000.0]),
    st.sampled_from(["auto", "air"]),
)
def test_a_generated_tour_switches_the_process_on_along_its_paths_only(
    paths, cell, orient, spindle, switch
):
    job = Job(
        tool=ToolTable(orient=orient),
        process=ProcessTable(spindle=spindle, signal="on", switch=switch),
    )
    body = program(*paths, cell=cell, job=job).body
    on = pressing = False
    names: list[str] = []
    cut: dict[int, list] = {}
    position = None
    for before, item in zip((None, *body), body, strict=False):
        if isinstance(item, Comment):
            names.append(item.text.split()[1])
        elif isinstance(item, Output) and item.signal == "on" and position is not None:
            assert on != bool(item.value)
            assert not getattr(before, "blend", 0.0)
            in_air = position[2] >= job.process.approach
            assert in_air == (switch == "air") or may_end_lifted(paths)
            on = bool(item.value)
        elif isinstance(item, Force):
            pressing = item.newtons > 0
        elif isinstance(item, (MoveJ, MoveL, MoveC)):
            travel = item.speed == job.process.travel_speed
            assert not (travel and pressing)
            # A rotating tool is on while it goes straight up. On links nothing else is on.
            if travel and on:
                assert switch == "air"
                assert position[:2] == item.target.origin[:2]
            assert isinstance(item, MoveJ) <= travel
            assert item.work <= on
            if item.work:
                cut.setdefault(len(names) - 1, []).extend([position, item.target.origin])
            position = item.target.origin if isinstance(item.target, Pose) else None
    assert not on
    k = 0
    for p in paths:
        for number, depth in enumerate(p.depths):
            assert names[k] == p.id
            expected = section_ends(p, number, depth)
            assert expected <= set(cut[k])
            assert {z for _, _, z in cut[k]} == {z for _, _, z in expected}
            k += 1
    assert len(names) == k


def may_end_lifted(paths) -> bool:
    """Whether a path may end above the part, as after a section under force."""
    return any((p.force[1:] > 0).any() and not (p.force[1:] > 0).all() for p in paths)


def section_ends(p, number, depth) -> set[tuple[float, float, float]]:
    """Start and end of each section of a pass, mm.

    They are at its depth, and after a section under force 5 mm above the part.
    """
    meets = p.position[0].tolist() == p.position[-1].tolist()
    run = p.reversed() if number % 2 and p.reversible and not meets else p
    pressed, ends = False, set()
    points = run.position.tolist()
    for a, b, newtons in zip(points[:-1], points[1:], run.force[1:].tolist(), strict=True):
        height = 5.0 if pressed and not newtons else -depth
        pressed = pressed or newtons > 0
        ends |= {(a[0], a[1], height), (b[0], b[1], height)}
    return ends


# Frames


def test_frames_of_the_job_replace_those_of_the_cell():
    table = CellTable(
        base_from_work=[1, 2, 3, 0, 0, 90], flange_from_tool=[0, 0, 9, 0, 180, 0], home=[90, 0, -90]
    )
    cell = equip_cell(ROBOT, Job(cell=table))
    assert cell.base_from_work.origin == (1, 2, 3)
    assert angle_between(cell.base_from_work.rotation, rotation_about(2, math.pi / 2)) < 1e-12
    assert angle_between(cell.flange_from_tool.rotation, rotation_about(1, math.pi)) < 1e-12
    assert cell.home == Joints((math.pi / 2, 0.0, -math.pi / 2))
    again = equip_cell(cell, Job(cell=table))
    assert again.home == cell.home
    assert again.flange_from_tool.origin == pose_from_values([0, 0, 9, 0, 180, 0]).origin


def test_the_tool_frame_has_the_length_of_the_tool_by_default():
    cell = equip_cell(ROBOT, Job(tool=ToolTable(length=42.0)))
    assert cell.flange_from_tool.origin == (0, 0, 42)
    assert cell.home is ROBOT.home
    assert cell.base_from_work is ROBOT.base_from_work


def test_the_home_of_a_mill_is_a_position():
    home = equip_cell(MILL, Job(cell=CellTable(home=[1, 2, 30]))).home
    assert home.origin == (1, 2, 30)
    assert home.rotation is TOOL_DOWN


@pytest.mark.parametrize(
    ("cell", "table"),
    [
        (ROBOT, {"base_from_work": [1, 2, 3]}),
        (ROBOT, {"flange_from_tool": [0] * 16}),
        (ROBOT, {"home": []}),
        (ROBOT, {"home": [math.nan] * 6}),
        (ROBOT, {"base_from_work": [math.inf, 0, 0, 0, 0, 0]}),
        (MILL, {"home": [0] * 6}),
    ],
)
def test_an_invalid_number_of_a_frame_is_refused_with_its_key(cell, table):
    (key,) = table
    with pytest.raises(JobError, match=f"cell.{key}"):
        equip_cell(cell, Job(cell=CellTable(**table)))


def test_a_sliding_joint_of_the_home_is_in_mm() -> None:
    cell = Cell(
        "scara",
        translation(0, 0, 0),
        translation(0, 0, 0),
        Joints((0.0, 0.0, 50.0, 0.0)),
        frozenset({2}),
    )
    home = equip_cell(cell, Job(cell=CellTable(home=[0.0, 90.0, 40.0, 180.0]))).home
    assert isinstance(home, Joints)
    assert home.values == pytest.approx((0.0, math.pi / 2, 40.0, math.pi))


def test_the_tool_leaves_the_surface_between_passes_under_force() -> None:
    def lifts(force: float) -> int:
        loop = path(
            [(0, 0), (40, 0), (40, 30), (0, 0)],
            force_direction=[[(0, 1)] * 2] * 3,
            force=force,
            closed=True,
        )
        body = program(
            replace(loop, depths=(1.0, 2.0)), job=Job(process=ProcessTable(force=force))
        ).body
        return sum(isinstance(item, MoveL) and item.target.origin[2] == 20.0 for item in body)

    assert lifts(5.0) == lifts(0.0) + 1
