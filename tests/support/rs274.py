"""Comparison of programs with the motion that LinuxCNC's interpreter makes of their text."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import strategies as st

from camgen.lang.programs import Executed
from camgen.model.pose import TOOL_DOWN, Pose, Vec3, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    Wait,
)
from camgen.post import Post, Tolerance
from tests.support.canon import RS274, Call, Canon, run
from tests.support.whole import whole

__all__ = ["Call", "Canon", "run"]
needs_rs274 = pytest.mark.skipif(
    RS274 is None, reason="rs274 is not installed (Debian package linuxcnc-uspace)"
)


def moves(canon: Canon) -> list[Call]:
    """The motions after the position is known in all axes.

    It is known after the first lift, or after the lift to the top of the machine and the rapid
    motion across at the top.
    """
    motions = canon.moves
    assert all(call.kind == "STRAIGHT_TRAVERSE" for call in motions[: canon.lead])
    if canon.lead == 2:
        top, across = motions[:2]
        assert top.end[2] == across.end[2] == 0.0, "not at the top, which is 0 in rs274"
    return motions[canon.lead :]


def assert_moves(program: Program, canon: Canon) -> None:
    """Compares the motions of the interpreter with those of a program.

    Coordinates may differ by half of the third decimal, and by the rounding of rs274 to the fourth.
    """
    wanted = [item for item in program.body if isinstance(item, (MoveJ, MoveL, MoveC))]
    got = moves(canon)
    assert [KINDS[type(item)] for item in wanted] == [call.kind for call in got]
    start: Vec3 = (0.0, 0.0, 0.0)
    for item, call in zip(wanted, got, strict=True):
        assert isinstance(item.target, Pose)
        assert close(item.target.origin, call.end, 5.6e-4), (item.target.origin, call)
        if not isinstance(item, MoveJ):
            assert abs(item.speed * 60 - call.feed) <= 1e-3 * item.speed * 60
        if isinstance(item, MoveC):
            assert_arc(start, item, call)
        start = call.end
    waits = [item.seconds for item in program.body if isinstance(item, Wait)]
    dwells = [call.value for call in canon.calls if call.kind == "DWELL"]
    assert close(waits, dwells, 5.6e-4)


def assert_arc(start: Vec3, item: MoveC, call: Call) -> None:
    """The planned via point must be half-way on the arc of the interpreter."""
    cx, cy = call.centre
    x, y, z = item.via.origin
    radius = math.hypot(start[0] - cx, start[1] - cy)
    assert abs(math.hypot(x - cx, y - cy) - radius) < 2.5e-3
    assert abs(z - call.end[2]) < 1.6e-3
    sense = 1 if call.turns > 0 else -1
    assert abs(call.turns) == 1
    whole = (sense * (angle(call.end, call.centre) - angle(start, call.centre))) % math.tau
    half = (sense * (angle((x, y, z), call.centre) - angle(start, call.centre))) % math.tau
    assert abs(half - whole / 2) * radius < 3e-3, (start, item, call)


def angle(point: Vec3, centre: tuple[float, float]) -> float:
    return math.atan2(point[1] - centre[1], point[0] - centre[0])


def close(a: object, b: object, tolerance: float) -> bool:
    """Whether two sequences of numbers are of one length and agree."""
    left, right = list(a), list(b)
    return len(left) == len(right) and all(
        abs(p - q) <= tolerance for p, q in zip(left, right, strict=True)
    )


KINDS = {MoveJ: "STRAIGHT_TRAVERSE", MoveL: "STRAIGHT_FEED", MoveC: "ARC_FEED"}


def difference(program: Program, reading: Executed, tolerance: Tolerance) -> str:
    """The first difference between a read-back and its program, "" if they are equal.

    A read-back with a finding differs.
    """
    if reading.findings:
        return f"fault {reading.findings[0]}"
    wanted = [item for item in program.body if not isinstance(item, Comment)]
    if len(wanted) != len(reading.body):
        return f"{len(wanted)} instructions, {len(reading.body)} read"
    for item, got, line in zip(wanted, reading.body, reading.lines, strict=True):
        if not _same(item, got, tolerance):
            return f"line {line}: {item} read as {got}"
    return ""


def _same(item: Instruction, got: Instruction, tolerance: Tolerance) -> bool:
    limit = tolerance.mm + 1e-9
    match item, got:
        case MoveJ(target=Pose() as wanted), MoveJ(target=Pose() as read):
            return close(wanted.origin, read.origin, limit)
        case MoveL() | MoveC(), MoveL() | MoveC() if type(item) is type(got):
            if (
                isinstance(item, MoveC)
                and isinstance(got, MoveC)
                and not close(item.via.origin, got.via.origin, 3 * limit)
            ):
                return False
            same = (
                close(item.target.origin, got.target.origin, limit)
                and abs(item.force - got.force) <= tolerance.force
            )
            return same and abs(item.speed - got.speed) <= tolerance.speed
        case Output(), Output():
            return item.signal == got.signal and abs(item.value - got.value) < 1e-6
        case Wait(), Wait():
            return abs(item.seconds - got.seconds) <= tolerance.seconds
        case Force(), Force():
            return abs(item.newtons - got.newtons) <= tolerance.force
        case Stop(), Stop():
            return item.optional == got.optional
    return False


def at(x: float, y: float, z: float) -> Pose:
    """The pose at a point with the tool straight down."""
    return Pose(TOOL_DOWN, (float(x), float(y), float(z)))


def program(*body: Instruction, name: str = "demo", header: tuple[str, ...] = ()) -> Program:
    """A program of a body that starts at the home position of the built-in cell."""
    home = MoveJ(at(0, 0, 50), 100.0)
    return Program(name, translation(0, 0, 0), translation(0, 0, 100), whole((home, *body)), header)


def posted(post: Post, plan: Program, chord: float = 0.01) -> tuple[Program, str]:
    """The prepared program and the text of its only file."""
    ready = post.prepare(plan, chord)
    (file,) = post.render(ready)
    return ready, file.text


# Random programs for three axes. Very small and very large values are frequent.


def programs() -> object:
    """A hypothesis strategy for whole programs."""
    length = st.floats(-300, 300, allow_nan=False)
    speed = st.one_of(st.floats(0.001, 900), st.sampled_from([20.0, 20.0, 33.3333]))
    straight = st.tuples(
        st.sampled_from(["J", "L", "L"]), length, length, st.floats(-60, 80), speed
    )
    radius = st.one_of(st.floats(0.02, 2), st.floats(2, 400), st.floats(400, 12000))
    sweep = st.one_of(st.floats(1e-3, math.pi), st.just(math.pi), st.just(math.pi / 2))
    arc = st.tuples(st.just("C"), radius, st.floats(-4, 4), sweep, st.sampled_from([1, -1]), speed)
    other = st.one_of(
        st.tuples(st.just("W"), st.floats(0, 5)),
        st.tuples(st.just("O"), st.sampled_from([0.0, 1.0])),
        st.tuples(st.just("#"), st.text(max_size=90)),
        st.tuples(st.just("again"), speed),
    )
    steps = st.lists(st.one_of(straight, arc, arc, other), min_size=1, max_size=30)
    return steps.map(lambda drawn: program(*_make_body(drawn)))


def _make_body(steps: list[tuple[Any, ...]]) -> list[Instruction]:
    body: list[Instruction] = []
    x, y, z = 0.0, 0.0, 50.0
    for kind, *rest in steps:
        if kind == "W":
            body.append(Wait(*rest))
        elif kind == "O":
            body.append(Output("process", *rest))
        elif kind == "#":
            body.append(Comment(*rest))
        elif kind == "again":
            body.append(MoveL(at(x, y, z), *rest))
        elif kind == "C":
            radius, begin, sweep, sense, speed = rest
            cx, cy = x - radius * math.cos(begin), y - radius * math.sin(begin)
            points = [begin + sense * sweep / 2, begin + sense * sweep]
            via, end = ((cx + radius * math.cos(a), cy + radius * math.sin(a)) for a in points)
            body.append(MoveC(at(*via, z), at(*end, z), speed))
            x, y = end
        else:
            x, y, z, speed = rest
            body.append((MoveJ if kind == "J" else MoveL)(at(x, y, z), speed))
    return body
