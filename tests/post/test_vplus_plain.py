"""The short ways of the V+ read-back against its long one: both read the same from any text, to the last bit."""

import re
from unittest.mock import patch

import pytest
from camgen_posts.readback.vplus import read
from camgen_posts.readback.vplus.robot import RobotState
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.pose import Pose
from camgen.model.program import MoveJ, MoveL, Output
from camgen.post import Reading, Remark
from camgen.read.vplus import text as vplus_text
from camgen.read.vplus.text import PIECE
from tests.support.examples import fewer
from tests.support.vplus_ways import BY_HAND, LINES, PARTS, TEXTS, check, stretches, the_long_way


@pytest.mark.parametrize(("text", "options"), TEXTS)
def test_texts_as_they_are(text: str, options: dict[str, object]) -> None:
    reading = check({"a": text}, options)
    assert stretches(text) > 4
    assert (
        sum(isinstance(item, (MoveJ, MoveL)) for item in reading.body)
        >= len(re.findall(r"(?m)^ +MOVE", text))
        > 10
    )


def test_the_pieces_are_the_whole_text() -> None:
    for text in [
        *(text for text, _ in TEXTS),
        "",
        "\n",
        "a",
        "\r\n\r\r\na\x0b\x85b",
        "MOVE f:TRANS(1,2,3,4,5,6)",
    ]:
        pieces = [piece[0] for piece in PIECE.finditer(text)]
        assert "".join(pieces) == text
        assert len(re.split(r"\r\n|\r|\n", text)) == len(LINES.findall(text)) + (
            not text or text[-1] in "\r\n"
        )


@fewer(12)
@given(st.lists(st.from_regex(r"\A-?[0-9]{1,9}(\.[0-9]{1,9})?\Z"), min_size=12, max_size=12))
def test_numbers_to_the_last_bit(numbers: list[str]) -> None:
    rows = [f"    MOVES f:TRANS({','.join(numbers[k : k + 6])})\n" for k in (0, 6, 0)]
    text = ".PROGRAM a()\nSET f = NULL\n" + "".join(rows) + ".END\n"
    reading = check({"a": text}, {})
    origins = [
        item.target.origin
        for item in reading.body
        if isinstance(item, MoveL) and isinstance(item.target, Pose)
    ]
    assert origins == [tuple(map(float, numbers[k : k + 3])) for k in (0, 6, 0)]


def test_stretches_longer_than_one_match() -> None:
    rows = [f"MOVES f:TRANS({k},0,0,0,180,180)\n" for k in range(700)]
    text = ".PROGRAM a()\nSET f = NULL\n" + "".join(rows) + "BREAK\n.END\n"
    assert 1 < stretches(text) < 5
    reading = check({"a": text}, {})
    assert [item.target.origin[0] for item in reading.body] == list(range(700))  # type: ignore[union-attr]
    assert reading.lines == tuple(range(3, 703))


def program(*lines: str) -> dict[str, str]:
    return {"a": "\n".join([".PROGRAM t()", "SET wf = TRANS(1,2,3)", *lines, ".END"]) + "\n"}


def faulty(reading: Reading) -> list[int]:
    """The lines of the faults, without those of remarks."""
    return [fault.line for fault in reading.faults if not isinstance(fault, Remark)]


def test_names_that_are_one_name_in_every_line_of_a_stretch() -> None:
    rows = [
        f"MOVES {name}:TRANS({k},0,0,0,0,0)"
        for name in ("outline_of_part1", "Outline_of_partX")
        for k in (1, 2, 3)
    ]
    reading = check(program("SET outline_of_part1 = NULL", *rows, *rows), {})
    assert faulty(reading) == [7, 8, 9, 13, 14, 15]
    assert all("are one name" in fault.what for fault in reading.faults if fault.line > 4)
    assert len(reading.body) == 12


@pytest.mark.parametrize(
    "line", ["70000 BREAK", "BREAK ; é", 'TYPE "a', "a_very_long_name_2 = 1", "?", "AUTO q", "Q"]
)
def test_a_line_with_a_fault_has_it_every_time(line: str) -> None:
    lines = ["a_very_long_name_1 = 1", line, line, "BREAK", line]
    assert sorted({line for line in faulty(check(program(*lines), {})) if line > 3}) == [4, 5, 7]


def test_names_are_looked_up_every_time() -> None:
    lines = [
        "v = 2",
        *(["v = v+1", "SPEED v ALWAYS", "SIGNAL v", "MOVES wf:TRANS(v,0,0,0,0,0)", "BREAK"] * 2),
    ]
    reading = check(
        program(*lines, "SPEED 0", "SPEED 0", "SPEED 3, 0 MMPS", "SPEED 3, 0"), {"rated": 100.0}
    )
    assert faulty(reading) == [14, 15, 16, 17]
    assert [item.signal for item in reading.body if isinstance(item, Output)] == [
        "signal 3",
        "signal 4",
    ]
    assert [(m.target.origin[0], m.speed) for m in reading.body if isinstance(m, MoveL)] == [
        (3, 3),
        (4, 4),
    ]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "lost", ["MOVES wg:TRANS(1,2,3,0,0,0)", "MOVES wf:TRANS(1,2,3,v)", "MOVES ?"]
)
def test_after_a_motion_that_is_not_read_the_place_is_not_known(lost: str) -> None:
    reading = check(
        program("MOVES wf:TRANS(1,2,3,0,0,0)", "SPEED 0", "DEPARTS 5", lost, "DEPARTS 5"), {}
    )
    assert faulty(reading) == [4, 6, 7]
    assert reading.faults[-1].what == "DEST is not known here"
    assert len(reading.body) == 2


def test_the_short_ways_are_open_and_the_long_way_shuts_them() -> None:
    """Without this the comparison could hold the long way against itself."""
    calls: list[str] = []
    whole, one = RobotState.stretch, RobotState.plain

    def stretch(robot: RobotState, plain: object) -> bool:
        calls.append("stretch")
        return whole(robot, plain)  # type: ignore[arg-type]

    def plain(robot: RobotState, statement: object) -> bool:
        calls.append("plain")
        return one(robot, statement)  # type: ignore[arg-type]

    text = BY_HAND.replace("MOVES wf:TRANS(7,8,9.5", "moves wf:trans(7,8,9.5")
    with (
        patch(PARTS + "vplus.robot.RobotState.stretch", stretch),
        patch(PARTS + "vplus.robot.RobotState.plain", plain),
    ):
        read({"a": text}, {})
        assert {"stretch", "plain"} == set(calls)
        calls.clear()
        with the_long_way():
            read({"a": text}, {})
        assert calls == []
    assert vplus_text.PIECE is PIECE


def test_what_is_remembered_ends_with_the_reading() -> None:
    first, second = read({"a": BY_HAND}, {}), read({"a": BY_HAND}, {"rated": 1.0})
    speeds = [
        [m.speed for m in reading.body if isinstance(m, MoveJ)] for reading in (first, second)
    ]
    assert speeds[0] == pytest.approx([7500 * speed for speed in speeds[1]])
