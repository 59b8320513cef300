"""V+: names, long programs in parts, and generated programs that are read back."""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from camgen_posts.vplus import VPlus
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from camgen.lang.programs import Executed
from camgen.lang.vplus.strict import read
from camgen.model.errors import Refused
from camgen.model.pose import FloatArray, Pose, angle_between
from camgen.model.program import (
    Columns,
    Comment,
    Instruction,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
    splice,
)
from camgen.post.plugins import make_post
from tests.support.examples import fewer
from tests.support.vplus_programs import (
    ANGLES,
    CELL,
    DEGENERATE,
    HOME,
    HOME6,
    assert_same,
    down,
    long_program,
    program,
    render,
    zyz_degrees,
)


def test_a_long_program_calls_its_parts() -> None:
    source = long_program(5000, "A very long name of a part")
    unsplit, text = render(source, {"max_lines": 0})
    prepared, split_text = render(source)
    names = re.findall(r"^\.PROGRAM (\S+)\(\)$", split_text, re.MULTILINE)
    assert names == ["a_very_long_n", "a_very_long_n.1", "a_very_long_n.2", "a_very_long_n.3"]
    assert max(map(len, names)) == 15
    assert split_text.count("\n.END\n") == 4
    assert [p.count("\n") <= 2000 + 8 for p in split_text.split(".PROGRAM")] == [True] * 5
    of_text, of_parts = read({"a": text}, {}), read({"a": split_text}, {})
    assert (of_text.findings, of_parts.findings) == ((), ())
    assert_same(prepared, of_parts)
    assert_same(unsplit, of_text)
    assert of_parts.work is not None
    assert of_parts.work.origin == (250, -75, 150)


class _CountedLines(Sequence[str]):
    """Lines that count how often all of them are read, and how often a single one is."""

    def __init__(self, lines: list[str]) -> None:
        self.lines, self.wholes, self.singles = lines, 0, 0

    def __len__(self) -> int:
        return len(self.lines)

    def __iter__(self) -> Iterator[str]:
        self.wholes += 1
        return iter(self.lines)

    def __getitem__(self, index: Any) -> Any:
        self.singles += 1
        return self.lines[index]


def test_each_part_of_a_long_program_is_read_once() -> None:
    """A printed part is one text, and each access to a line would split it again."""
    post = make_post(VPlus, {})
    parts = [_CountedLines(["    MOVE #PPOINT(0, 0)"] * 100) for _ in range(3)]
    post.assemble(program(HOME), parts)
    assert [(part.wholes, part.singles) for part in parts] == [(1, 0)] * 3


def test_every_part_states_a_speed_before_its_first_motion() -> None:
    _, text = render(long_program(100, "a"), {"max_lines": 20})
    parts = text.split("\n.PROGRAM ")[1:]
    assert len(parts) > 4
    for part in parts:
        lines = [line.split()[0] for line in part.splitlines()]
        motions = [i for i, word in enumerate(lines) if word.startswith("MOVE")]
        assert lines.index("SPEED") < motions[0]


def test_a_name_given_by_the_user_is_not_shortened() -> None:
    source = long_program(100, "a")
    with pytest.raises(
        Refused, match=r"outline_of_part is too long a name for 6 parts; shorten post.program to 13"
    ):
        render(source, {"program": "outline_of_part", "max_lines": 20})
    assert render(source, {"program": "outline_of_part"})[1].startswith(
        ".PROGRAM outline_of_part()\n"
    )


@given(st.text(max_size=30))
def test_any_name_becomes_a_legal_one_that_is_not_taken(name: str) -> None:
    _, text = render(Program(name, CELL.base_from_work, CELL.flange_from_tool, (HOME,)))
    header = text.splitlines()[0]
    assert re.fullmatch(r"\.PROGRAM [a-z][a-z0-9._]{0,14}\(\)", header)
    assert header[9:-2] not in ("tool", "base", "here", "null", "cg.tool", "cg.work")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("tool", "p_tool"),
        ("CG.WORK", "p_cg.work"),
        ("1st", "p_1st"),
        ("Größe 7", "gr__e_7"),
        ("", "p"),
        ("...", "p"),
    ],
)
def test_a_name_that_is_taken_gets_a_prefix(name: str, expected: str) -> None:
    _, text = render(Program(name, CELL.base_from_work, CELL.flange_from_tool, (HOME,)))
    assert text.startswith(f".PROGRAM {expected}()\n")


NUMBERS = st.floats(-400, 400)
ANY = st.builds(zyz_degrees, ANGLES, st.floats(0, 180) | DEGENERATE, ANGLES)
STRAIGHT = st.builds(lambda roll: zyz_degrees(0, 180, roll), ANGLES)


def bodies(
    rotations: st.SearchStrategy[FloatArray], home: MoveJ
) -> st.SearchStrategy[tuple[Instruction, ...]]:
    positions = st.tuples(NUMBERS, NUMBERS, NUMBERS) | st.just((1.0, 2.0, 3.0))
    poses = st.builds(Pose, rotations, positions)
    blends = st.sampled_from([0.0, 0.3, 5.0])
    item = st.one_of(
        st.builds(MoveJ, poses, st.floats(4, 7500), blends),
        st.builds(
            MoveL, poses, st.floats(0.05, 3000), blends, turn=st.floats(0.02, math.radians(1200))
        ),
        st.builds(Output, st.just("process"), st.sampled_from([0, 1])),
        st.builds(Wait, st.floats(0.001, 60)),
        st.builds(Comment, st.text(max_size=60)),
    )
    return st.lists(item, max_size=12).map(lambda items: make_printable([home, *items, home]))


def make_printable(items: list[Instruction]) -> tuple[Instruction, ...]:
    """`items` with the stops that a program needs.

    Only reorientations keep their rotational speed.
    """
    stop = True
    for i in reversed(range(len(items))):
        item = items[i]
        if isinstance(item, (MoveJ, MoveL)):
            if stop:
                items[i] = replace(item, blend=0.0)
            stop = False
        elif not isinstance(item, Comment):
            stop = True
    columns = Columns(items)
    travels = np.flatnonzero(columns.moves_are(MoveL) & ~columns.turned)
    return splice(
        items, {int(columns.at[k]): (replace(columns.moves[k], turn=0.0),) for k in travels}
    )


@fewer(12)
@given(bodies(ANY, HOME6), st.sampled_from([0, 5, 2000]))
def test_the_reading_of_a_program_for_six_axes_is_the_program(
    body: tuple[Instruction, ...], max_lines: int
) -> None:
    print_and_read(program(*body, header=("any",)), {"max_lines": max_lines})


@given(bodies(STRAIGHT, HOME))
def test_the_reading_of_a_program_for_a_scara_is_the_program(body: tuple[Instruction, ...]) -> None:
    print_and_read(program(*body), {"posture": ["RIGHTY"], "rated": 7600})


@given(st.text(max_size=80), ANY, st.tuples(NUMBERS, NUMBERS, NUMBERS))
def test_any_remark_and_any_frame_is_printed_and_read(
    remark: str, rotation: FloatArray, origin: tuple[float, float, float]
) -> None:
    frame = Pose(rotation, origin)
    source = Program(
        "a", frame, frame, (HOME6, MoveJ(down(1, 2, 3), 100)), (remark, "; .END\r\n.END")
    )
    reading = print_and_read(source, {})
    for pose in (reading.work, reading.tool):
        assert pose is not None
        assert np.allclose(pose.origin, origin, rtol=0, atol=0.0005 + 1e-9)
        assert angle_between(pose.rotation, rotation) < 1e-5


def print_and_read(source: Program, options: dict[str, object]) -> Executed:
    """Prints a program, compares its reading with it, and returns the reading."""
    prepared, text = render(source, options)
    assert text.isascii()
    assert max(map(len, text.splitlines())) <= 120
    assert "\r" not in text
    reading = read({"a.v2": text.replace("\n", "\r\n")}, options)
    assert reading.findings == ()
    assert_same(prepared, reading, options)
    return reading
