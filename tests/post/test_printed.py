"""Lines that are printed by column are those that are printed instruction by instruction."""

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

# Numbers beside and upon the middle between two digits, small ones on both sides of 0, and any.
number = st.one_of(
    st.integers(-4000, 4000).map(lambda n: n / 2000), st.sampled_from([-0.0, -0.0004, -0.0005, 0.0005, 1e-9]),
    st.floats(-900, 900),
)  # fmt: skip
point = st.tuples(number, number, st.sampled_from([0.0, -0.0, 2.0, 20.0]))
speed = st.sampled_from([5.0, 20.0, 20.0, 6.6667, 33.33333, 100.0])
blend = st.sampled_from([0.0, 1.0, 0.3, 2.5])
path = st.integers(-1, 2)


@st.composite
def bodies(draw: st.DrawFn) -> list[object]:
    """Motions, some of them arcs of a third of a circle, between remarks, waits and outputs."""
    body: list[object] = [MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0)]
    here = (0.0, 0.0, 50.0)
    for kind in draw(st.lists(st.sampled_from("JLLAAACOWT"), max_size=14)):
        owner = draw(path)
        if kind == "A":
            radius, begin, sweep = (
                draw(st.floats(3, 40)),
                draw(st.floats(-3, 3)),
                draw(st.sampled_from([1.5, -1.5])),
            )
            centre = here[0] - radius * math.cos(begin), here[1] - radius * math.sin(begin)
            ends = [
                (
                    centre[0] + radius * math.cos(begin + a),
                    centre[1] + radius * math.sin(begin + a),
                    here[2],
                )
                for a in (sweep / 2, sweep)
            ]
            here = ends[1]
            via, end = (Pose(TOOL_DOWN, one) for one in ends)
            body.append(MoveC(via, end, draw(speed), draw(blend), path=owner, work=True))
        elif kind in "JLT":
            here = draw(point)
            made = MoveJ if kind == "J" else MoveL
            posture = (
                Posture(confdata=(0, 1, 0, 0)) if kind == "T" and draw(st.booleans()) else None
            )
            body.append(
                made(Pose(TOOL_DOWN, here), draw(speed), draw(blend), posture=posture, path=owner)
            )
        elif kind == "C":
            body.append(Comment(draw(st.sampled_from(["100 %", "c1", "%s %d"]))))
        else:
            body.append(
                Output("process", draw(st.sampled_from([0.0, 1.0]))) if kind == "O" else Wait(0.5)
            )
    body += [MoveL(Pose(TOOL_DOWN, (1.0, 1.0, 20.0)), 30.0), Output("process", 0.0)]
    spoken = [item for item in body if not isinstance(item, Comment)]
    stops = {id(a) for a, b in pairwise(spoken) if not isinstance(b, MoveJ | MoveL | MoveC)}
    return [
        replace(item, blend=0.0) if id(item) in stops and hasattr(item, "blend") else item
        for item in body
    ]


def _one_by_one(name: str) -> type[Post]:
    """The post of that name, which prints no motion by column."""
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
@given(body=bodies(), most=st.sampled_from([0, 0, 8]))
def test_by_column_a_post_prints_what_it_prints_one_by_one(
    name: str, body: list[object], most: int
) -> None:
    options: dict[str, object] = {"max_lines": most} if name == "rapid" else {}
    texts = []
    for kind in (find_post(name), _one_by_one(name)):
        post = make_post(kind, options)
        texts.append(
            [
                (file.name, file.text)
                for file in post.render(post.prepare(_program(name, body), 0.05))
            ]
        )
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


def test_a_class_that_prints_motions_otherwise_than_its_parent_is_asked_for_each() -> None:
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
def test_numbers_are_rounded_as_their_text_is(decimals: int, values: list[float]) -> None:
    found = round_numbers(np.array(values), decimals)
    assert [fixed(value, decimals) for value in found.tolist()] == [
        fixed(value, decimals) for value in values
    ]
    assert not np.signbit(found[found == 0]).any()


def test_lines_are_a_sequence_of_lines() -> None:
    post = make_post(find_post("gcode"), {})
    body = [
        MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, 50.0)), 100.0),
        MoveL(Pose(TOOL_DOWN, (3.0, 0.0, 0.0)), 10.0),
        Comment("5 %"),
    ]
    seen: list[Lines] = []

    class Seen(type(post)):  # type: ignore[misc]
        def assemble(self, program, parts):  # type: ignore[no-untyped-def]
            seen.extend(parts)
            return super().assemble(program, parts)

    (file,) = Seen().render(_program("gcode", body))
    (lines,) = seen
    assert isinstance(lines, Lines)
    assert len(lines) == len(list(lines)) == 6
    assert [lines[0], lines[-2], lines[1:3]] == ["G53 G0 Z0", "G1 X3 Z0 F600", ["G49", "G0 X0 Y0"]]
    assert "\n".join(lines) in file.text
    assert list(lines)[-1] == "(5 _)"


def test_lines_that_are_given_are_cut_between_instructions() -> None:
    given_lines = [["a"], [], ["b", "c", "d"], ["e"], ["f"], []]
    columns = _program(
        "gcode", [MoveJ(Pose(TOOL_DOWN, (0.0, 0.0, k)), 100.0) for k in range(6)]
    ).columns
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
    found = list(printed)
    assert [len(lines) for lines in found] == [1, 1, 2, 1] == printed.counts().tolist()
    assert found == [list(post.line(item)) for item in program.body]
    assert re.fullmatch(r" +! 5 _", found[3][0])
