"""Differences that `compare` finds or accepts, and its bounds, which follow from rounding."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.geometry.arcs import find_arc_middles
from camgen.lang.programs import Executed, Finding, Frames
from camgen.model.errors import VerifyError
from camgen.model.pose import (
    IDENTITY,
    TOOL_DOWN,
    Pose,
    frozen,
    rotation_about,
    rotation_about_axis,
    translation,
)
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Program, Wait
from camgen.post import Tolerance
from camgen.post import verify as verification
from camgen.post.passes import along
from camgen.post.verify import ARC_SLACK, compare

TOLERANCE = Tolerance(mm=0.0005, angle=1e-5, joint=1e-5, speed=0.01, force=0.01, seconds=0.001)
ALL = frozenset({"orientation", "speed", "joint-speed", "blend", "stop", "force-direction"})
HOME = MoveJ(Joints((0.1, 0.2, 0.3)), 100.0)


@pytest.fixture(autouse=True, scope="module", params=[None, 1], ids=["at once", "bit by bit"])
def _batches(request):
    """A long program is compared in batches. Their size makes no difference."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param:
            patch.setattr(verification, "_BATCH", request.param)
        yield


def at(x, y, z=0.0, rotation=TOOL_DOWN):
    return Pose(rotation, (float(x), float(y), float(z)))


BODY = (
    Output("process", 0.0),
    Force(0.0),
    HOME,
    Comment("path c1"),
    MoveJ(at(0, 0, 20), 90.0, 1.0),
    MoveL(at(10, 0), 20.0),
    Output("process", 1.0),
    Wait(0.25),
    Force(5.0, (0.0, 1.0, 0.0)),
    MoveL(at(20, 0), 20.0, 0.3, 5.0, (0.0, 1.0, 0.0)),
    MoveC(at(30, 10), at(20, 20), 15.0, 0.0, 5.0, (0.0, -1.0, 0.0)),
    Force(0.0),
    Output("process", 0.0),
)


def program(body=BODY):
    return Program("p", translation(1, 2, 3), translation(0, 0, 100), tuple(body))


def reading(body=BODY, findings=(), work=None, tool=None):
    lines = tuple(10 * i + 1 for i in range(len(body)))
    frames = (Frames(base_from_work=work, flange_from_tool=tool),)
    return Executed(tuple(body), lines, frames, findings=findings)


def changed(index, **fields):
    return reading([*BODY[:index], replace(BODY[index], **fields), *BODY[index + 1 :]])


def verify(read, carries=ALL, body=BODY, tolerance=TOLERANCE):
    return compare(program(body), read, tolerance, carries, "part.txt")


def test_equal_programs_have_no_deviation():
    deviation = verify(reading())
    assert (deviation.max_mm, deviation.max_angle, deviation.instructions) == (0.0, 0.0, 12)


def test_comments_are_not_compared():
    without = [item for item in BODY if not isinstance(item, Comment)]
    for body in (without, [Comment("x"), *BODY, Comment("y")]):
        assert verify(reading(body)).max_mm == 0.0


def test_a_fault_of_the_text_is_reported_before_a_difference():
    read = reading(
        findings=(Finding("refused", 7, "unknown word"), Finding("refused", 9, "another"))
    )
    with pytest.raises(VerifyError, match=r"part\.txt: unknown word \(line 7\)") as caught:
        verify(read)
    assert caught.value.line == 7


@pytest.mark.parametrize(
    ("index", "fields", "message"),
    [
        (
            2,
            {"target": Joints((0.1, 0.2, 0.3001))},
            "joint values reads 0.1 0.2 0.3001, planned is 0.1 0.2 0.3",
        ),
        (2, {"target": Joints((0.1, 0.2))}, "MoveJ to 2 joint values, planned is MoveJ to 3"),
        (2, {"target": at(0, 0)}, "MoveJ to 0 0 0, planned is MoveJ to 3 joint values"),
        (2, {"speed": 101.0}, "speed reads 101, planned is 100"),
        (4, {"target": at(0, 0, 20.001)}, "target reads 0 0 20.001, planned is 0 0 20"),
        (4, {"blend": 0.0}, "blend reads 0, planned is 1"),
        (5, {"target": at(0, 10)}, "target reads 0 10 0, planned is 10 0 0"),
        (5, {"target": at(10, math.nan)}, "target reads 10 nan 0"),
        (
            5,
            {"target": at(10, 0, 0, IDENTITY)},
            "orientation reads q 1 0 0 0, planned is q 0 1 0 0",
        ),
        (5, {"speed": 20.02}, "speed reads 20.02, planned is 20"),
        (5, {"blend": 0.0001}, "blend reads 0.0001, planned is 0"),
        (6, {"signal": "glue"}, "reads output glue 1, planned is output process 1"),
        (6, {"value": 0.0}, "output reads 0, planned is 1"),
        (7, {"seconds": 0.252}, "wait reads 0.252, planned is 0.25"),
        (8, {"newtons": 5.02}, "force reads 5.02, planned is 5"),
        (
            8,
            {"force_direction": (1.0, 0.0, 0.0)},
            "force along x y z reads 5 0 0, planned is 0 5 0",
        ),
        (9, {"force": 0.0}, "force reads 0, planned is 5"),
        (
            9,
            {"force_direction": (0.0, 0.0, 0.0)},
            "force along x y z reads 0 0 0, planned is 0 5 0",
        ),
        (10, {"via": at(20, 20)}, "middle of the arc reads 20 20 0, planned is 30 10 0"),
        (10, {"via": at(10, 10)}, "middle of the arc reads 10 10 0, planned is 30 10 0"),
        (10, {"via": at(30, 10, 1)}, "middle of the arc"),
        (
            10,
            {"force_direction": (0.0, 1.0, 0.0)},
            "force along x y z reads 0 5 0, planned is 0 -5 0",
        ),
    ],
)
def test_a_difference_is_reported_with_its_values(index, fields, message):
    with pytest.raises(VerifyError) as caught:
        verify(changed(index, **fields))
    assert f"instruction {index}: " in caught.value.what
    assert message in caught.value.what
    assert caught.value.line == 10 * index + 1


TURNS = (
    HOME,
    MoveJ(at(0, 0, 20), 90.0),
    MoveL(at(0, 0, 20, frozen(TOOL_DOWN @ rotation_about(2, 1.0))), 20.0, turn=0.5),
    MoveL(at(9, 0, 20, frozen(TOOL_DOWN @ rotation_about(2, 1.0))), 20.0),
)


@pytest.mark.parametrize("turn", [0.0, 0.49, 0.51, 8.7])
def test_the_speed_of_a_reorientation_is_compared_if_the_text_has_it(turn):
    read = reading([*TURNS[:2], replace(TURNS[2], turn=turn), TURNS[3]])
    verify(read, body=TURNS)
    near = replace(TOLERANCE, turn=0.001)
    with pytest.raises(
        VerifyError,
        match=rf"instruction 2: speed of turning reads {turn:g}, planned is 0.5 .line 21",
    ):
        verify(read, carries=ALL | {"turn"}, body=TURNS, tolerance=near)
    verify(read, carries=ALL | {"turn"}, body=TURNS, tolerance=replace(TOLERANCE, turn=10.0))
    verify(reading(TURNS), carries=ALL | {"turn"}, body=TURNS, tolerance=near)


def test_a_reorientation_that_is_lost_by_rounding_has_no_speed_to_compare():
    slight = (
        *TURNS[:2],
        replace(TURNS[2], target=at(0, 0, 20, frozen(TOOL_DOWN @ rotation_about(2, 1e-7)))),
    )
    read = reading([*TURNS[:2], MoveL(at(0, 0, 20), 20.0)])
    verify(read, carries=ALL | {"turn"}, body=slight)


def test_the_first_of_several_differences_is_reported():
    body = [
        *BODY[:4],
        replace(BODY[4], speed=1.0),
        replace(BODY[5], speed=1.0),
        Output("no", 1.0),
        *BODY[7:],
    ]
    with pytest.raises(VerifyError, match="instruction 4: speed"):
        verify(reading(body))


@pytest.mark.parametrize("index", [0, 1, 2, 5, 6, 10, 12])
def test_a_missing_instruction_is_found(index):
    with pytest.raises(VerifyError, match=f"instruction {index}: "):
        verify(reading([*BODY[:index], *BODY[index + 1 :]]))


def test_an_additional_and_a_missing_last_instruction_are_found():
    with pytest.raises(
        VerifyError,
        match=r"instruction 13: instruction reads wait 1 s, planned is nothing \(line 131\)",
    ):
        verify(reading([*BODY, Wait(1.0)]))
    with pytest.raises(
        VerifyError, match="instruction 12: instruction reads nothing, planned is output process 0"
    ):
        verify(reading(BODY[:-1]))


@pytest.mark.parametrize(
    ("name", "index", "fields"),
    [
        ("orientation", 5, {"target": at(10, 0, 0, IDENTITY)}),
        ("speed", 5, {"speed": 99.0}),
        ("joint-speed", 4, {"speed": 1.0}),
        ("force-direction", 8, {"force_direction": (1.0, 0.0, 0.0)}),
        ("blend", 4, {"blend": 5.0}),
    ],
)
def test_a_field_that_the_text_does_not_have_is_not_compared(name, index, fields):
    verify(changed(index, **fields), carries=ALL - {name})
    with pytest.raises(VerifyError):
        verify(changed(index, **fields), carries=frozenset({name}))


def test_the_speed_of_a_joint_replaces_the_tcp_speed():
    """The TCP speed is compared for motions without a joint speed."""
    carries = ALL | {"joint-rate"}
    rated = [*BODY[:2], replace(HOME, rate=0.5), *BODY[3:]]
    verify(reading(rated), carries, rated)
    verify(changed(2, speed=77.0, rate=0.5), carries, rated)
    verify(changed(2, rate=0.500005), carries, rated)
    for wrong in (0.51, 0.0):
        with pytest.raises(VerifyError, match=r"instruction 2: speed of a joint reads .* is 0\.5"):
            verify(changed(2, rate=wrong), carries, rated)
    with pytest.raises(VerifyError, match="instruction 2: speed reads 77"):
        verify(changed(2, speed=77.0), carries)


def test_a_stop_is_compared_even_if_the_blend_radius_is_not():
    verify(changed(4, blend=0.0), carries=ALL - {"blend", "stop"})
    with pytest.raises(VerifyError, match="instruction 4: blend"):
        verify(changed(4, blend=0.0), carries=ALL - {"blend"})


@pytest.mark.parametrize("name", ["work", "tool"])
def test_a_frame_that_the_text_has_to_state_is_required(name):
    verify(reading())
    with pytest.raises(VerifyError, match=f"the {name} frame is not in the text"):
        verify(reading(), carries=ALL | {name})


@pytest.mark.parametrize(
    ("frames", "name"),
    [
        ({"work": translation(1, 2, 3.001)}, "work"),
        ({"work": Pose(rotation_about(2, 1e-4), (1.0, 2.0, 3.0))}, "work"),
        ({"tool": translation(0, 0, 99)}, "tool"),
    ],
)
def test_a_frame_of_the_text_is_compared(frames, name):
    verify(reading(work=translation(1, 2, 3.0005), tool=translation(0, 0, 100)))
    with pytest.raises(VerifyError, match=f"the {name} frame reads"):
        verify(reading(**frames))


def test_half_a_digit_is_accepted_and_measured_as_a_distance():
    half = 0.0005
    deviation = verify(changed(9, target=at(20 + half, -half, half)))
    assert deviation.max_mm == pytest.approx(math.sqrt(3) * half)
    with pytest.raises(VerifyError):
        verify(changed(9, target=at(20.00051, 0)))


def test_the_deviation_of_an_arc_is_the_one_of_its_middle():
    via = at(*(np.array([20, 10]) + 10.002 * np.array([math.cos(0.4), math.sin(0.4)])))
    deviation = verify(changed(10, via=via), tolerance=replace(TOLERANCE, mm=0.01))
    # x^2 + y^2 - 2 k x = 100 is a circle through (0, -10) and (0, 10). It passes through a point
    # at the distance 10.002 from the origin and the angle 0.4.
    k = (10.002**2 - 100) / (2 * 10.002 * math.cos(0.4))
    assert deviation.max_mm == pytest.approx(k + math.hypot(10, k) - 10, rel=1e-6)


@pytest.mark.parametrize("angle", [1e-9, 1e-7, 3e-6, 9.9e-6])
def test_a_small_angle_is_measured_exactly(angle):
    rotation = frozen(TOOL_DOWN @ rotation_about_axis(np.array([0.6, 0.0, 0.8]), angle))
    assert verify(changed(5, target=at(10, 0, 0, rotation))).max_angle == pytest.approx(
        angle, rel=1e-6
    )


def test_a_rotation_by_180_deg_is_a_difference():
    with pytest.raises(VerifyError, match="orientation"):
        verify(changed(5, target=at(10, 0, 0, frozen(TOOL_DOWN @ rotation_about(2, math.pi)))))


def test_the_via_point_may_be_anywhere_on_the_arc():
    for angle in (-1.3, -0.2, 0.9, 1.5):
        via = at(20 + 10 * math.cos(angle), 10 + 10 * math.sin(angle))
        assert verify(changed(10, via=via)).max_mm < 1e-12


def test_an_arc_from_joint_values_is_compared_by_its_points():
    body = (HOME, MoveC(at(30, 10), at(20, 20), 15.0))
    verify(reading(body), body=body)
    other = (HOME, MoveC(at(30, 11), at(20, 20), 15.0))
    with pytest.raises(VerifyError, match="middle of the arc"):
        verify(reading(other), body=body)


def test_a_reading_needs_a_line_for_each_instruction():
    with pytest.raises(ValueError, match="13 instructions with 12 lines"):
        verify(Executed(BODY, tuple(range(12))))


def test_a_degenerate_arc_has_a_middle():
    start, end = [[0.0, 0, 0]] * 4, [[2.0, 0, 0]] * 3 + [[0.0, 0, 0]]
    via = [[0.5, 0, 0], [3.0, 0, 0], [1.0, 1, 0], [0.0, 2, 0]]
    middles = find_arc_middles(*(np.array(v, dtype=float) for v in (start, via, end)))
    assert middles == pytest.approx(np.array([[1.0, 0, 0], [3, 0, 0], [1, 1, 0], [0, 2, 0]]))


@given(
    st.floats(0.001, math.pi),
    st.floats(0.01, 0.99),
    st.sampled_from([1e-2, 1.0, 1e3, 1e6]),
    st.integers(0, 999),
)
def test_the_middle_of_an_arc_is_half_its_rotation_about_the_centre(sweep, fraction, radius, seed):
    random = np.random.default_rng(seed)
    normal = random.normal(size=3)
    turn = rotation_about_axis(normal / np.linalg.norm(normal), 2.0)
    points = (
        turn @ (radius * np.array([np.cos(a), np.sin(a), 0.0]))
        for a in (0, sweep * fraction, sweep, sweep / 2)
    )
    start, via, end, middle = points
    # A short sweep magnifies the rounding errors of the points.
    slack = 1e-14 * radius / (sweep * min(fraction, 1 - fraction)) ** 2 + 1e-12
    assert find_arc_middles(start[None], via[None], end[None])[0] == pytest.approx(
        middle, abs=slack
    )


def _rounded(values, unit):
    return np.round(np.asarray(values) / unit) * unit


def test_the_bound_of_arcs_holds_for_texts_with_a_via_point_and_with_a_centre():
    """Random arcs, rounded as by a post, stay below ARC_SLACK, and some are not far below."""
    random = np.random.default_rng(7)
    count, unit = 200_000, 0.001
    radius = 10 ** random.uniform(-2, 4, count)
    least = np.minimum(0.02 / radius, 3.0)
    sweep = least + (math.pi - least) * random.uniform(0, 1, count)
    begin, centre = random.uniform(0, 2 * math.pi, count), random.uniform(-50, 50, (count, 2))
    p, m, q = (
        np.column_stack(
            [centre + radius[:, None] * np.column_stack([np.cos(a), np.sin(a)]), np.zeros(count)]
        )
        for a in (begin, begin + sweep / 2, begin + sweep)
    )
    normal = random.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    mirror = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
    turned = [np.einsum("nij,nj->ni", mirror, v) for v in (p, m, q)]
    with_via = find_arc_middles(*(_rounded(v, unit) for v in turned))
    worst_via = np.linalg.norm(with_via - turned[1], axis=1).max() / (unit / 2)
    start, end = _rounded(p, unit), _rounded(q, unit)
    printed_centre = start[:, :2] + _rounded(centre - start[:, :2], unit)
    # A controller with I and J takes the radius at the start and halves the angle to the end.
    a, b = start[:, :2] - printed_centre, end[:, :2] - printed_centre
    angle = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.einsum("ni,ni->n", a, b)) % (
        2 * math.pi
    )
    half = np.arctan2(a[:, 1], a[:, 0]) + angle / 2
    with_centre = printed_centre + np.linalg.norm(a, axis=1)[:, None] * np.column_stack(
        [np.cos(half), np.sin(half)]
    )
    worst_centre = np.linalg.norm(with_centre - m[:, :2], axis=1).max() / (unit / 2)
    assert 2.0 < worst_via < ARC_SLACK
    assert 2.0 < worst_centre < ARC_SLACK


def round_pose(pose):
    return Pose(TOOL_DOWN, tuple(round(v, 3) for v in pose.origin))


@given(st.integers(0, 10_000), st.floats(0.5, 3.1))
def test_a_rounded_program_is_accepted(seed, sweep):
    """The numbers of lines and arcs are rounded to three digits."""
    random = np.random.default_rng(seed)
    points = random.uniform(-100, 100, (4, 3))
    body = [HOME, MoveJ(at(*points[0]), 50.0)]
    body += [MoveL(at(*p), 20.0) for p in points[1:]]
    radius = float(random.uniform(0.05, 80))
    start = at(*(points[3] + 0.0))
    side = at(
        points[3][0] + radius * math.sin(sweep),
        points[3][1] + radius * (1 - math.cos(sweep)),
        points[3][2],
    )
    half = at(
        points[3][0] + radius * math.sin(sweep / 2),
        points[3][1] + radius * (1 - math.cos(sweep / 2)),
        points[3][2],
    )
    arc = MoveC(half, side, 20.0)
    assert along(start, arc, np.array([0.5]))[0].origin == pytest.approx(half.origin, abs=1e-9)
    body.append(arc)

    def rounded(item):
        names = [name for name in ("target", "via") if isinstance(getattr(item, name, None), Pose)]
        return replace(item, **{name: round_pose(getattr(item, name)) for name in names})

    deviation = verify(reading([rounded(item) for item in body]), body=body)
    assert 0 < deviation.max_mm <= ARC_SLACK * TOLERANCE.mm
