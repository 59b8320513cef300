"""Passes: the motions that replace an arc stay on it."""

import math

import numpy as np
import pytest
from camgen_posts.vplus import VPlus
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.arcs import compute_circle
from camgen.model.errors import Refused
from camgen.model.pose import (
    IDENTITY,
    TOOL_DOWN,
    Pose,
    angle_between,
    frozen,
    rotation_about_axis,
    rotation_from_fixed_xyz,
)
from camgen.model.program import Columns, Joints, MoveC, MoveJ, MoveL, Program, Wait
from camgen.post import end_of
from camgen.post.passes import PASSES, along, chords, corner_blend, halve_each, halves

ANGLES = st.floats(-3.1, 3.1)
RADII = st.floats(0.05, 500)
SWEEPS = st.floats(0.05, math.pi)


@st.composite
def arcs(draw):
    """Start, arc, the circle of the arc with its sweep, and the angle by which the tool turns."""
    plane = rotation_from_fixed_xyz(draw(ANGLES), draw(ANGLES), draw(ANGLES))
    radius, sweep = draw(RADII), draw(SWEEPS)
    centre = np.array([draw(st.floats(-100, 100)) for _ in range(3)])

    def point(fraction):
        a = sweep * fraction
        return tuple(
            (centre + plane @ (radius * np.array([math.cos(a), math.sin(a), 0.0]))).tolist()
        )

    first = rotation_from_fixed_xyz(draw(ANGLES), draw(ANGLES), draw(ANGLES))
    turn = draw(st.sampled_from([0.0, 0.5, 2.0]))
    last = first if not turn else frozen(first @ rotation_about_axis(frozen([0.0, 0.6, 0.8]), turn))
    press = tuple((-(plane @ np.array([math.cos(sweep), math.sin(sweep), 0.0]))).tolist())
    half = frozen(first @ rotation_about_axis(frozen([0.0, 0.6, 0.8]), turn / 2)) if turn else first
    middle = Pose(half, point(0.5))
    arc = MoveC(middle, Pose(last, point(1)), 10.0, draw(st.sampled_from([0.0, 5.0])), 7.0, press)
    return Pose(first, point(0)), arc, (centre, radius, plane[:, 2], sweep), turn


@given(arcs())
def test_three_points_of_an_arc_give_its_circle(drawn):
    start, arc, (centre, radius, axis, sweep), _ = drawn
    circle = compute_circle(start.origin, arc.via.origin, arc.target.origin)
    # The centre of a short arc is uncertain: rounding errors grow with 1 / sweep^2.
    slack = 1e-9 * max(1.0, radius) / sweep**2 + 1e-9 / sweep**2
    assert circle[0] == pytest.approx(centre, abs=slack)
    assert circle[1] == pytest.approx(radius, abs=slack)
    assert circle[2] == pytest.approx(axis, abs=1e-6)
    assert circle[3] == pytest.approx(sweep, abs=1e-6)


@pytest.mark.parametrize(
    "points",
    [((0, 0, 0), (1, 0, 0), (2, 0, 0)), ((0, 0, 0),) * 3, ((0, 0, 0), (1, 1, 1), (1, 1, 1))],
)
def test_three_points_on_a_line_are_refused_as_a_circle(points):
    with pytest.raises(ValueError, match="on one line"):
        compute_circle(*points)


@given(arcs(), st.floats(0.001, 0.5))
def test_chords_stay_within_the_tolerance_and_reach_the_end(drawn, tolerance):
    start, arc, (centre, radius, _, sweep), turn = drawn
    lines = chords(start, arc, tolerance)
    points = np.array([start.origin, *(line.target.origin for line in lines)])
    arms = np.linalg.norm(points - centre, axis=1)
    middles = np.linalg.norm((points[1:] + points[:-1]) / 2 - centre, axis=1)
    assert arms == pytest.approx(radius, abs=1e-6 * max(1, radius))
    assert (radius - middles).max() <= tolerance + 1e-6
    assert lines[-1].target is arc.target
    assert [type(line) for line in lines] == [MoveL] * len(lines)
    assert lines[-1].blend == arc.blend
    assert {(line.speed, line.force) for line in lines} == {(10.0, 7.0)}
    # With one line less the sagitta would exceed the tolerance.
    if len(lines) > 1 and tolerance < radius * (1 - 1e-9):
        assert radius * (1 - math.cos(sweep / (len(lines) - 1) / 2)) > tolerance * (1 - 1e-6)
    # Corners between lines are blended, within the tolerance too. A zone reaches at most half-way
    # to the next corner.
    for line in lines[:-1]:
        zone = min(line.blend, radius * math.sin(sweep / len(lines) / 2))
        assert line.blend > 0
        assert zone * math.sin(sweep / len(lines) / 2) / 2 <= tolerance * (1 + 1e-9)
    turns = [angle_between(start.rotation, line.target.rotation) for line in lines]
    fractions = np.arange(1, len(lines) + 1) / len(lines)
    assert turns == pytest.approx(turn * fractions, abs=1e-6)


@given(arcs())
def test_the_halves_of_an_arc_are_on_it(drawn):
    start, arc, (centre, radius, axis, sweep), turn = drawn
    pieces = halves(start, arc, 0.01)
    assert [type(piece) for piece in pieces] == [MoveC, MoveC]
    pose = start
    for piece in pieces:
        begin, middle, end = pose.origin, piece.via.origin, piece.target.origin
        for point in (begin, middle, end):
            arm = np.array(point) - centre
            assert np.linalg.norm(arm) == pytest.approx(
                radius, abs=1e-9 * max(1, radius / sweep**2)
            )
            assert float(arm @ axis) == pytest.approx(0, abs=1e-8 * max(1, radius))
        assert math.dist(begin, middle) == pytest.approx(2 * radius * math.sin(sweep / 8), abs=1e-7)
        assert math.dist(middle, end) == pytest.approx(2 * radius * math.sin(sweep / 8), abs=1e-7)
        angle = angle_between(pose.rotation, piece.target.rotation)
        assert angle == pytest.approx(turn / 2, abs=1e-6)
        pose = piece.target
    assert pieces[0].target.origin == pytest.approx(arc.via.origin, abs=1e-7)
    assert pieces[0].blend > 0
    assert (pieces[1].target, pieces[1].blend, pieces[1].force_direction) == (
        arc.target,
        arc.blend,
        arc.force_direction,
    )


LEVEL = st.tuples(*[st.floats(-300, 300)] * 2, RADII, ANGLES, st.floats(-math.pi, math.pi))


@given(st.lists(LEVEL, max_size=4), st.sampled_from([0.0, 5.0]), st.sampled_from([0.0, -0.5]))
def test_arcs_halved_by_column_are_those_halved_singly_to_the_last_bit(drawn, blend, z):
    body = [MoveJ(Joints((0.0,) * 6), 50.0)]
    for x, y, radius, begin, sweep in drawn:
        angles = np.linspace(begin, begin + sweep, 3)
        points = [(x + radius * math.cos(a), y + radius * math.sin(a), z) for a in angles]
        try:
            compute_circle(*points)
        except ValueError:
            continue
        via, end = (Pose(TOOL_DOWN, point) for point in points[1:])
        body += [
            MoveL(Pose(TOOL_DOWN, points[0]), 40.0),
            MoveC(via, end, 20.0, blend, path=3, work=True),
        ]
    rows, items = halve_each(Columns(body), np.arange(2, len(body), 2), 0.01)
    assert rows.tolist() == list(range(2, len(body), 2))
    planned = []
    for k in rows:
        planned += halves(body[k - 1].target, body[k], 0.01)
    pieces = [item for item in items if isinstance(item, MoveC)]
    assert [item.target.origin for item in items if isinstance(item, MoveJ)] == [
        body[k - 1].target.origin for k in rows
    ]
    assert list(map(list_fields, pieces)) == list(map(list_fields, planned))


def list_fields(arc):
    ends = [(pose.origin, id(pose.rotation)) for pose in (arc.via, arc.target)]
    return (*ends, arc.speed, arc.blend, arc.path, arc.work, arc.force, arc.posture, arc.joints)


def test_an_arc_with_force_or_tilt_is_not_halved_by_column():
    turned = frozen(TOOL_DOWN @ rotation_about_axis(frozen([0.0, 0.0, 1.0]), 0.5))
    start, via, end = (0.0, 0.0, 0.0), (5.0, 5.0, 0.0), (10.0, 0.0, 0.0)
    line = MoveL(Pose(TOOL_DOWN, start), 10.0)
    cases = [
        MoveC(Pose(TOOL_DOWN, via), Pose(TOOL_DOWN, end), 10.0, force=3.0),
        MoveC(Pose(turned, via), Pose(turned, end), 10.0),
        MoveC(Pose(TOOL_DOWN, (5.0, 5.0, 1.0)), Pose(TOOL_DOWN, end), 10.0),
    ]
    for arc in cases:
        rows, items = halve_each(Columns([line, arc]), np.array([1]), 0.01)
        assert (len(rows), len(items)) == (0, 0)


@pytest.mark.parametrize("name", sorted(PASSES))
@given(drawn=arcs())
def test_the_force_turns_with_the_arc(name, drawn):
    start, arc, (centre, radius, _, _), _ = drawn
    for piece in PASSES[name](start, arc, 0.05):
        inwards = (centre - np.array(piece.target.origin)) / radius
        assert piece.force_direction == pytest.approx(tuple(inwards), abs=1e-5)


def test_an_arc_without_force_has_pieces_without_force():
    arc = MoveC(Pose(TOOL_DOWN, (5.0, 5.0, 0.0)), Pose(TOOL_DOWN, (0.0, 10.0, 0.0)), 10.0)
    for replace_arc in PASSES.values():
        pieces = replace_arc(Pose(TOOL_DOWN, (0.0, 0.0, 0.0)), arc, 0.05)
        assert {piece.force_direction for piece in pieces} == {(0.0, 0.0, 0.0)}


def test_poses_along_an_arc_share_a_rotation_that_does_not_change():
    arc = MoveC(Pose(TOOL_DOWN, (5.0, 5.0, 0.0)), Pose(TOOL_DOWN, (0.0, 10.0, 0.0)), 10.0)
    start = Pose(TOOL_DOWN, (0.0, 0.0, 0.0))
    assert all(pose.rotation is TOOL_DOWN for pose in along(start, arc, np.array([0.1, 0.9])))


@given(st.floats(-math.pi, math.pi), st.floats(0.001, 1.0))
def test_a_blend_stays_within_the_tolerance_of_its_corner(turn, tolerance):
    blend = corner_blend(turn, tolerance)
    assert blend in (0.0, 0.3, 1.0, 5.0)
    # The parabola from b before to b after the corner halves the distance from the corner to the
    # middle of its chord.
    before, after = np.array([-1.0, 0.0]), np.array([math.cos(turn), math.sin(turn)])
    assert np.linalg.norm(blend * (before + after)) / 4 <= tolerance * (1 + 1e-9)
    larger = {0.0: 0.3, 0.3: 1.0, 1.0: 5.0}.get(blend)
    if larger:
        assert np.linalg.norm(larger * (before + after)) / 4 > tolerance * (1 - 1e-9)


def test_a_refusal_of_chords_has_their_reason() -> None:
    """V+ has no arc. If it refuses the chords too, it gives their reason."""

    class Fussy(VPlus):
        def why_not(self, item, before, after):  # type: ignore[no-untyped-def]
            reason = "this line is too short" if isinstance(item, MoveL) else ""
            return super().why_not(item, before, after) or reason

    home = MoveJ(Joints((0.0,) * 4), 100.0)
    start = Pose(TOOL_DOWN, (0.0, 0.0, 0.0))
    arc = MoveC(Pose(TOOL_DOWN, (5.0, 5.0, 0.0)), Pose(TOOL_DOWN, (10.0, 0.0, 0.0)), 10.0)
    frame = Pose(IDENTITY, (0.0, 0.0, 0.0))
    program = Program("p", frame, frame, (home, MoveJ(start, 100.0), arc))
    with pytest.raises(Refused, match="this line is too short"):
        Fussy().prepare(program, 0.01)


def test_a_post_tests_a_motion_with_its_neighbours() -> None:
    """The post refuses a line on which two blends overlap, which its controller would skip."""

    class Skipping(VPlus):
        def why_not(self, item, before, after):  # type: ignore[no-untyped-def]
            start = end_of(before)
            if isinstance(item, MoveL) and start is not None and isinstance(after, MoveL):
                length = math.dist(start.origin, item.target.origin)
                if before.blend + item.blend > length:
                    return f"the blends overlap on {length:g} mm"
            return super().why_not(item, before, after)

    def lines(blend: float) -> Program:
        poses = [Pose(TOOL_DOWN, (x, 0.0, 0.0)) for x in (0.0, 10.0, 12.0, 20.0)]
        first = MoveL(poses[1], 10.0, blend)
        rest = (Wait(0.5), MoveL(poses[2], 10.0, 0.5), MoveL(poses[3], 10.0))
        home = (MoveJ(Joints((0.0,) * 4), 100.0), MoveJ(poses[0], 100.0))
        frame = Pose(IDENTITY, (0.0, 0.0, 0.0))
        return Program("p", frame, frame, (*home, first, *rest[blend > 0 :]))

    Skipping().prepare(lines(0.0), 0.01)
    with pytest.raises(Refused, match="the blends overlap on 2 mm") as refusal:
        Skipping().prepare(lines(2.0), 0.01)
    assert refusal.value.index == 3


def test_a_force_along_the_tool_axis_is_the_same_on_all_pieces_of_an_arc() -> None:
    """The tilted tool does not turn with the arc, so the force does not turn either."""
    rotation = frozen([[1, 0, 0], [0, -0.8, -0.6], [0, 0.6, -0.8]])
    start, via, end = (
        Pose(rotation, point) for point in ((10.0, 0.0, 0.0), (0.0, 10.0, 0.0), (-10.0, 0.0, 0.0))
    )
    press = (0.0, -0.6, -0.8)
    arc = MoveC(via, end, 20.0, 0.0, 5.0, press)
    for pieces in (halves(start, arc, 0.01), chords(start, arc, 0.5)):
        assert len(pieces) > 1
        for piece in pieces:
            assert piece.force_direction == pytest.approx(press)
