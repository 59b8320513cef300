"""V+: the fast path of the read-back for runs of motions, names, and repeated lines."""

import re

import pytest

from camgen.lang.columns import Run
from camgen.lang.programs import Executed
from camgen.lang.vplus.strict import read
from camgen.model.program import MoveJ, MoveL, Output
from tests.post.fast_paths.vplus import BY_HAND, PATH, TEXTS


def test_each_motion_of_a_text_is_read() -> None:
    for text, options in TEXTS:
        motions = [i for i in PATH.check(text, options).body if isinstance(i, MoveJ | MoveL)]
        assert len(motions) >= len(re.findall(r"(?m)^ +MOVE", text)) > 10


def test_a_run_longer_than_one_match_is_read() -> None:
    rows = [f"MOVES f:TRANS({k},0,0,0,180,180)\n" for k in range(700)]
    text = ".PROGRAM a()\nSET f = NULL\n" + "".join(rows) + "BREAK\n.END\n"
    assert PATH.count_fast(text) == 700
    assert 1 < sum(isinstance(piece, Run) for piece in PATH.template.cut(text)) < 5
    reading = PATH.check(text, {})
    moves = [item for item in reading.body if isinstance(item, MoveL)]
    assert [move.target.origin[0] for move in moves] == list(range(700))
    assert reading.lines == tuple(range(3, 703))


def program(*lines: str) -> str:
    return "\n".join([".PROGRAM t()", "SET wf = TRANS(1,2,3)", *lines, ".END"]) + "\n"


def list_faulty_lines(reading: Executed) -> list[int]:
    """The lines of all findings except remarks."""
    return [fault.line for fault in reading.findings if fault.level != "unusual"]


def test_two_names_that_are_one_are_a_fault_in_each_line_of_a_run() -> None:
    rows = [f"MOVES outline_of_part1:TRANS({k},0,0,0,0,0)" for k in (1, 2, 3)]
    rows += [f"MOVES Outline_of_partX:TRANS({k},0,0,0,0,0)" for k in (1, 2, 3)]
    reading = PATH.check(program("SET outline_of_part1 = NULL", *rows, *rows), {})
    assert list_faulty_lines(reading) == [7, 8, 9, 13, 14, 15]
    assert all("are one name" in fault.what for fault in reading.findings if fault.line > 4)
    assert len(reading.body) == 12


@pytest.mark.parametrize(
    "line", ["70000 BREAK", "BREAK ; é", 'TYPE "a', "a_very_long_name_2 = 1", "?", "AUTO q", "Q"]
)
def test_a_repeated_line_has_its_fault_each_time(line: str) -> None:
    lines = ["a_very_long_name_1 = 1", line, line, "BREAK", line]
    faulty_lines = list_faulty_lines(PATH.check(program(*lines), {}))
    assert sorted({number for number in faulty_lines if number > 3}) == [4, 5, 7]


def test_a_repeated_line_uses_the_current_values_of_its_names() -> None:
    lines = [
        "v = 2",
        *(["v = v+1", "SPEED v ALWAYS", "SIGNAL v", "MOVES wf:TRANS(v,0,0,0,0,0)", "BREAK"] * 2),
    ]
    reading = PATH.check(
        program(*lines, "SPEED 0", "SPEED 0", "SPEED 3, 0 MMPS", "SPEED 3, 0"), {"rated": 100.0}
    )
    assert list_faulty_lines(reading) == [14, 15, 16, 17]
    assert [item.signal for item in reading.body if isinstance(item, Output)] == [
        "signal 3",
        "signal 4",
    ]
    moves = [item for item in reading.body if isinstance(item, MoveL)]
    assert [(move.target.origin[0], move.speed) for move in moves] == [(3, 3), (4, 4)]


@pytest.mark.parametrize(
    "motion", ["MOVES wg:TRANS(1,2,3,0,0,0)", "MOVES wf:TRANS(1,2,3,v)", "MOVES ?"]
)
def test_the_position_after_a_motion_that_is_not_read_is_unknown(motion: str) -> None:
    reading = PATH.check(
        program("MOVES wf:TRANS(1,2,3,0,0,0)", "SPEED 0", "DEPARTS 5", motion, "DEPARTS 5"), {}
    )
    assert list_faulty_lines(reading) == [4, 6, 7]
    assert reading.findings[-1].what == "DEST is not known here"
    assert len(reading.body) == 2


def test_a_reading_does_not_use_the_values_of_another() -> None:
    first, second = read({"a": BY_HAND}, {}), read({"a": BY_HAND}, {"rated": 1.0})
    speeds = [item.speed for item in first.body if isinstance(item, MoveJ)]
    fractions = [item.speed for item in second.body if isinstance(item, MoveJ)]
    assert speeds == pytest.approx([7500 * fraction for fraction in fractions])
