"""The fast path of the V+ read-back: stretches of motions, names, and lines that come again."""

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


def test_stretches_longer_than_one_match() -> None:
    rows = [f"MOVES f:TRANS({k},0,0,0,180,180)\n" for k in range(700)]
    text = ".PROGRAM a()\nSET f = NULL\n" + "".join(rows) + "BREAK\n.END\n"
    assert PATH.count_fast(text) == 700
    assert 1 < sum(isinstance(piece, Run) for piece in PATH.template.cut(text)) < 5
    reading = PATH.check(text, {})
    assert [item.target.origin[0] for item in reading.body] == list(range(700))  # type: ignore[union-attr]
    assert reading.lines == tuple(range(3, 703))


def program(*lines: str) -> str:
    return "\n".join([".PROGRAM t()", "SET wf = TRANS(1,2,3)", *lines, ".END"]) + "\n"


def faulty(reading: Executed) -> list[int]:
    """The lines of the faults, without those of remarks."""
    return [fault.line for fault in reading.findings if fault.level != "unusual"]


def test_names_that_are_one_name_in_every_line_of_a_stretch() -> None:
    rows = [
        f"MOVES {name}:TRANS({k},0,0,0,0,0)"
        for name in ("outline_of_part1", "Outline_of_partX")
        for k in (1, 2, 3)
    ]
    reading = PATH.check(program("SET outline_of_part1 = NULL", *rows, *rows), {})
    assert faulty(reading) == [7, 8, 9, 13, 14, 15]
    assert all("are one name" in fault.what for fault in reading.findings if fault.line > 4)
    assert len(reading.body) == 12


@pytest.mark.parametrize(
    "line", ["70000 BREAK", "BREAK ; é", 'TYPE "a', "a_very_long_name_2 = 1", "?", "AUTO q", "Q"]
)
def test_a_line_with_a_fault_has_it_every_time(line: str) -> None:
    lines = ["a_very_long_name_1 = 1", line, line, "BREAK", line]
    assert sorted({line for line in faulty(PATH.check(program(*lines), {})) if line > 3}) == [
        4,
        5,
        7,
    ]


def test_names_are_looked_up_every_time() -> None:
    lines = [
        "v = 2",
        *(["v = v+1", "SPEED v ALWAYS", "SIGNAL v", "MOVES wf:TRANS(v,0,0,0,0,0)", "BREAK"] * 2),
    ]
    reading = PATH.check(
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
    reading = PATH.check(
        program("MOVES wf:TRANS(1,2,3,0,0,0)", "SPEED 0", "DEPARTS 5", lost, "DEPARTS 5"), {}
    )
    assert faulty(reading) == [4, 6, 7]
    assert reading.findings[-1].what == "DEST is not known here"
    assert len(reading.body) == 2


def test_what_is_remembered_ends_with_the_reading() -> None:
    first, second = read({"a": BY_HAND}, {}), read({"a": BY_HAND}, {"rated": 1.0})
    speeds = [
        [m.speed for m in reading.body if isinstance(m, MoveJ)] for reading in (first, second)
    ]
    assert speeds[0] == pytest.approx([7500 * speed for speed in speeds[1]])
