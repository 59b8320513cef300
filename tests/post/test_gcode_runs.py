"""G-code: the fast path by column and the reader of single lines read the same."""

import random
from itertools import pairwise
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode import columns, motion
from camgen.lang.gcode.columns import Chunk
from camgen.lang.gcode.machine import Machine
from camgen.lang.gcode.strict_posts import list_lines, read_grbl, read_linuxcnc
from camgen.lang.programs import Executed
from camgen.model.body import Body
from camgen.model.program import MoveC, MoveJ, MoveL

HEAD = (
    "(a program)\nG17 G21 G40 G54 G80 G90 G94\nG91.1\nG64 P0.01 Q0\nM65 P0\n"
    "G53 G0 Z0\nG49\nG0 X0 Y0\nG0 Z50\n"
)
GRBL_HEAD = "G17 G21 G40 G54 G80 G90 G94\nG91.1\nM5\nG49\nG0 Z50\nG0 X0 Y0\n"
END = "M65 P0\nM2\n"

number = st.integers(-99_999, 99_999).map(lambda n: f"{n / 1000:g}")
usual = st.one_of(
    st.builds("G0 X{} Y{}".format, number, number),
    st.builds("G0 Z{}".format, st.sampled_from(["20", "2"])),
    st.builds("G1 X{} Y{} F480".format, number, number),
    st.sampled_from(["G1 Z0 F100.5", "G1 Z-1"]),
    st.builds("G1 Y{}".format, number),
    st.sampled_from(["M64 P0", "M65 P0", "(path c1 layer 0)", "(x)", "M65 P3"]),
)
arc = st.builds("G1 X{0} Y0 F300\nG{1} X{0} Y4 I0 J2".format, number, st.sampled_from([2, 3]))
odd = st.sampled_from(
    [
        "G1 X1",
        "G0",
        "G2 X1 Y1",
        "G1 X1 I2",
        "G3 X0 Y0 I1 J1",
        "G2 X1 Y2 Z3 I1",
        "G1 X1 F0",
        "M64 P9",
        "M64 P00",
        "G91",
        "G0 X1 Y1 F100",
        "G4 P0.5",
        "M3 S100",
        "g1 x1",
        "G1  X1",
        "X5",
        "G90",
        "G20",
        "G18",
        "",
        "(MSG, x)",
        "; x",
        "M2",
        "G1 X1\r",
        "G1 X1 (x)",
        "M67 E0 Q1",
        "G2 X5 Y5 I100 J0",
        "G1 X1234567",
        "G1 X0.123456789",
        "%",
        "G3 X5 I1 J0 P2",
        "G81 Z-1 R1",
        "O5 call",
    ]
)


def list_results(reading: Executed) -> list[object]:
    """Instructions, lines and findings, in a form that shows each bit."""
    return [list(map(repr, reading.body)), list(reading.lines), reading.findings]


def read_both(text: str, grbl: bool = False, **options: object) -> Executed:
    """Reads a text by column and line by line, compares the readings bit by bit, and returns one.

    Two usual lines in a row are enough for the fast path.
    """
    read = read_grbl if grbl else read_linuxcnc
    with patch.object(motion, "SHORTEST_RUN", 2):
        by_column = read({"a.ngc": text}, options)
    with patch.object(motion, "SHORTEST_RUN", 10**9):
        line_by_line = read({"a.ngc": text}, options)
    assert list_results(by_column) == list_results(line_by_line)
    return by_column


@given(st.lists(st.one_of(usual, usual, arc), max_size=30))
def test_usual_lines_are_read_the_same(lines: list[str]) -> None:
    read_both("\n".join([HEAD[:-1], "G1 X1 F100", *lines, END]))


@given(st.lists(st.one_of(usual, usual, arc, odd), max_size=25), st.booleans())
def test_usual_lines_with_odd_ones_among_them_are_read_the_same(
    lines: list[str], grbl: bool
) -> None:
    read_both("\n".join([GRBL_HEAD[:-1] if grbl else HEAD[:-1], *lines, END]), grbl)


@pytest.mark.parametrize("size", [3, 5])
def test_a_text_is_read_the_same_in_chunks_of_any_size(size: int) -> None:
    chance = random.Random(size)
    kinds = ["G1 X{} Y1 F100", "G0 Z{}", "M64 P0", "(x)", "G1 Y{}", "G4 P1"]
    with patch.object(columns, "CHUNK_LINES", size):
        for _ in range(20):
            rows = [chance.choice(kinds) for _ in range(30)]
            read_both(
                HEAD + "\n".join(row.format(k / 8) for k, row in enumerate(rows)) + "\n" + END
            )


def test_a_long_program_is_read_by_column() -> None:
    rows = [f"G1 X{k} Y1\nM64 P0\nG3 X{k}.5 Y1.5 I0 J0.5\nM65 P0\n(path)" for k in range(200)]
    counts = []
    perform = motion.perform

    def watch(m: Machine, chunk: Chunk, low: int, high: int) -> int:
        before = len(m.body)
        line = perform(m, chunk, low, high)
        counts.append(len(m.body) - before)
        return line

    with patch.object(motion, "perform", watch):
        reading = read_linuxcnc({"a.ngc": HEAD + "G1 Z0 F60\n" + "\n".join(rows) + "\n" + END}, {})
    assert sum(counts) >= 800
    assert isinstance(reading.body, Body)
    assert reading.findings == ()
    moves = [item for item in reading.body if isinstance(item, MoveJ | MoveL | MoveC)]
    arcs = [(start, arc) for start, arc in pairwise(moves) if isinstance(arc, MoveC)]
    assert len(arcs) == 200
    # Each arc is a quarter of a circle with a radius of 0.5 mm about a point above its start.
    for start, arc in arcs:
        (x, y, _), (u, v, _) = start.target.origin, arc.via.origin
        assert (u - x) ** 2 + (v - y - 0.5) ** 2 == pytest.approx(0.25)
        assert u > x


@pytest.mark.parametrize(
    ("texts", "lines"),
    [
        ([], []),
        (["a\nb\n"], ["a", "b"]),
        (["a\nb"], ["a", "b"]),
        (["\n"], [""]),
        ([""], [""]),
        (["a\n\nb\n\n"], ["a", "", "b", ""]),
        (["a\n", "b\nc"], ["a", "b", "c"]),
        (["a", ""], ["a", ""]),
    ],
)
def test_each_text_is_cut_into_lines(texts: list[str], lines: list[str]) -> None:
    assert list_lines({str(k): text for k, text in enumerate(texts)}) == lines
