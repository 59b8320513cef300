"""Printing by column gives the lines of printing instruction by instruction."""

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import (
    Comment,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Posture,
    Program,
    Wait,
    switch_off_first,
)
from camgen.model.text import fixed
from camgen.post import Post
from camgen.post.plugins import find_post, make_post
from camgen.post.printed import Lines, Printed, join_lines, make_printed, round_numbers
from tests.support.examples import fewer

POSTS = ("gcode", "grbl", "rapid")
TURNED = frozen(TOOL_DOWN @ rotation_about(2, 0.3))

# Numbers at and near the middle between two digits, small ones on both sides of 0, and any.
number = st.one_of(
    st.integers(-4000, 4000).map(lambda n: n / 2000),
    st.sampled_from([-0.0, -0.0004, -0.0005, 0.0005, 1e-9]),
    st.floats(-900, 900),
)
point = st.tuples(number, number, st.sampled_from([0.0, -0.0, 2.0, 20.0]))
speed = st.sampled_from([5.0, 20.0, 20.0, 6.6667, 33.33333, 100.0])
blend = st.sampled_from([0.0, 1.0, 0.3, 2.5])
path = st.integers(-1, 2)


@st.composite
def bodies(draw: st.DrawFn) -> list[object]:
    """Motions, arcs of 86 deg among them, between comments, waits and outputs."""
    body: list[object] = [MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0)]
    position = (0.0, 0.0, 50.0)
    for kind in draw(st.lists(st.sampled_from("JLLAAACOWT"), max_size=14)):
        owner = draw(path)
        if kind == "A":
            radius, begin = draw(st.floats(3, 40)), draw(st.floats(-3, 3))
            sweep = draw(st.sampled_from([1.5, -1.5]))
            x = position[0] - radius * math.cos(begin)
            y = position[1] - radius * math.sin(begin)
            points = [
                (x + radius * math.cos(a), y + radius * math.sin(a), position[2])
                for a in (begin + sweep / 2, begin + sweep)
            ]
            position = points[1]
            via, end = (Pose(TOOL_DOWN, point) for point in points)
            body.append(MoveC(via, end, draw(speed), draw(blend), path=owner, work=True))
        elif kind in "JLT":
            position = draw(point)
            motion = MoveJ if kind == "J" else MoveL
            stated = kind == "T" and draw(st.booleans())
            posture = Posture(confdata=(0, 1, 0, 0)) if stated else None
            target = Pose(TOOL_DOWN, position)
            body.append(motion(target, draw(speed), draw(blend), posture=posture, path=owner))
        elif kind == "C":
            body.append(Comment(draw(st.sampled_from(["100 %", "c1", "%s %d"]))))
        else:
            value = st.sampled_from([0.0, 1.0])
            body.append(Output("process", draw(value)) if kind == "O" else Wait(0.5))
    body += [MoveL(Pose(TOOL_DOWN, (1.0, 1.0, 20.0)), 30.0), Output("process", 0.0)]
    items = [item for item in body if not isinstance(item, Comment)]
    stops = {id(a) for a, b in pairwise(items) if not isinstance(b, MoveJ | MoveL | MoveC)}
    return [
        replace(item, blend=0.0) if id(item) in stops and hasattr(item, "blend") else item
        for item in body
    ]


def _print_singly(name: str) -> type[Post]:
    """The post of that name as a class that prints each motion singly."""
    kind = find_post(name)
    return type(kind.__name__, (kind,), {"movel": kind.movel})


def _program(name: str, body: list[object]) -> Program:
    cell = find_post(name).cell()
    paths = tuple(Origin(f"c{k}") for k in range(3))
    start = [MoveJ(cell.home, 100.0)] if name == "rapid" else []
    safe = switch_off_first([*start, *body])
    return Program("kit", cell.base_from_work, cell.flange_from_tool, safe, paths=paths)


@pytest.mark.parametrize("name", POSTS)
@fewer(12)
@given(body=bodies(), max_lines=st.sampled_from([0, 0, 8]))
def test_a_post_prints_the_same_by_column_and_singly(
    name: str, body: list[object], max_lines: int
) -> None:
    options: dict[str, object] = {"max_lines": max_lines} if name == "rapid" else {}
    texts = []
    for kind in (find_post(name), _print_singly(name)):
        post = make_post(kind, options)
        files = post.render(post.prepare(_program(name, body), 0.05))
        texts.append([(file.name, file.text) for file in files])
    assert texts[0] == texts[1]


@pytest.mark.parametrize("name", POSTS)
def test_usual_motions_are_printed_by_column(name: str) -> None:
    post = make_post(find_post(name), {})
    body = [MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0)]
    body += [
        MoveL(Pose(TOOL_DOWN, (k / 7, k % 5 / 3, 0.0)), 10.0 + k % 3, float(k < 99))
        for k in range(100)
    ]
    program = post.prepare(_program(name, body), 0.05)
    post.render(program)
    forms = post.forms(program)
    assert forms is not None
    assert len(forms.rows) >= 100


def test_a_class_with_another_motion_than_its_parent_prints_each_singly() -> None:
    kind = find_post("gcode")

    class Loud(kind):
        def movel(self, motion: MoveL) -> list[str]:
            return [*super().movel(motion), "(line)"]

    body = [
        MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0),
        *(MoveL(Pose(TOOL_DOWN, (k, 0, 0)), 10.0) for k in (1, 2)),
    ]
    (file,) = make_post(Loud, {}).render(_program("gcode", body))
    assert file.text.count("(line)") == 2


@pytest.mark.parametrize("decimals", [0, 2, 3, 6])
@given(values=st.lists(st.one_of(number, st.floats(-1e5, 1e5)), max_size=6))
def test_numbers_are_rounded_as_in_their_text(decimals: int, values: list[float]) -> None:
    rounded = round_numbers(np.array(values), decimals)
    assert [fixed(value, decimals) for value in rounded.tolist()] == [
        fixed(value, decimals) for value in values
    ]
    assert not np.signbit(rounded[rounded == 0]).any()


def test_the_lines_of_a_text_are_a_sequence() -> None:
    post = make_post(find_post("gcode"), {})
    body = [
        MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0),
        MoveL(Pose(TOOL_DOWN, (3.0, 0.0, 0.0)), 10.0),
        Comment("5 %"),
    ]
    assembled: list[Lines] = []

    class Observed(type(post)):  # type: ignore[misc]
        def assemble(self, program, parts):  # type: ignore[no-untyped-def]
            assembled.extend(parts)
            return super().assemble(program, parts)

    (file,) = Observed().render(_program("gcode", body))
    (lines,) = assembled
    assert isinstance(lines, Lines)
    assert len(lines) == len(list(lines)) == 6
    assert [lines[0], lines[-2], lines[1:3]] == ["G53 G0 Z0", "G1 X3 Z0 F600", ["G49", "G0 X0 Y0"]]
    assert "\n".join(lines) in file.text
    assert list(lines)[-1] == "(5 _)"


def test_given_lines_are_cut_between_instructions() -> None:
    given_lines = [["a"], [], ["b", "c", "d"], ["e"], ["f"], []]
    body: list[object] = [MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, k)), 100.0) for k in range(6)]
    columns = _program("gcode", body).columns
    printed = make_printed(columns, given_lines)
    assert make_printed(columns, printed) is printed
    assert [list(part) for part in printed.parts(2)] == [["a"], ["b", "c", "d"], ["e", "f"]]
    assert [list(part) for part in printed.parts(0)] == [["a", "b", "c", "d", "e", "f"]]
    assert join_lines(["% head"], printed.parts(0)[0], ["end"]) == "% head\na\nb\nc\nd\ne\nf\nend\n"


def test_each_instruction_has_its_lines() -> None:
    post = make_post(find_post("rapid"), {})
    arc = MoveC(Pose(TURNED, (8.0, 2.0, 0.0)), Pose(TURNED, (10.0, 10.0, 0.0)), 10.0)
    program = _program("rapid", [MoveL(Pose(TURNED, (0.0, 0.0, 0.0)), 10.0), arc, Comment("5 %")])
    post.render(program)
    printed = Printed(
        program.columns, lambda items: map(post.line, items), lambda: post.forms(program)
    )
    rows = list(printed)
    assert [len(lines) for lines in rows] == [1, 1, 2, 1] == printed.counts().tolist()
    assert rows == [list(post.line(item)) for item in program.body]
    assert re.fullmatch(r" +! 5 _", rows[3][0])
