"""The judge of LinuxCNC's paths: its reading of a text, and its distances, by hand."""

import math
from pathlib import Path

import numpy as np
import pytest

from bench.controllers.executed_path import (
    Samples,
    measure_distance,
    measure_from_polyline,
    measure_from_span,
    measure_seconds,
)
from bench.controllers.programmed_path import Span, read_path

HEADER = "G53 G0 Z0\nG49\nG64 P0.02 Q0\nG0 X0 Y0\nG0 Z10\n"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """A folder as LinuxCNC's: work offset (100, 50, -150), tool 2 is 62 mm long."""
    (tmp_path / "mill.var").write_text("5221\t100.0\n5222\t50.0\n5223\t-150.0\n")
    (tmp_path / "tool.tbl").write_text("T1 P1 Z61 D6.0\nT2 P2 Z62 D6.0\n")
    return tmp_path


def test_lines_arcs_and_waits_are_read(machine: Path) -> None:
    text = HEADER + "(note X9)\nG1 X4 F600\nG3 X6 Y2 I0 J2 F300\nG4 P1.5\nG2 X4 Y0 I-2 J0\nM2\n"
    path = read_path(text, machine)
    assert (path.tolerance, path.dwell) == (0.02, 1.5)
    assert path.home.tolist() == [100, 50, -140]
    line, left, right = path.spans[2:]
    assert (line.line, line.end.tolist()) == (7, [104, 50, -140])
    assert (left.centre.tolist(), left.sweep) == ([104, 52], pytest.approx(math.pi / 2))
    assert (right.centre.tolist(), right.sweep) == ([104, 52], pytest.approx(-math.pi / 2))


def test_a_tool_length_raises_the_path(machine: Path) -> None:
    path = read_path(HEADER + "T2 M6\nG43 H2\nG0 Z5\n", machine)
    assert path.spans[-1].end.tolist() == [100, 50, -150 + 62 + 5]


def test_cycles_go_down_in_pecks(machine: Path) -> None:
    text = HEADER + "G98 G83 X1 Y2 Z-3 R1 Q2 F60\nX3 Y2\nG80\nG0 Z20\n"
    spans = read_path(text, machine).spans[2:]
    heights = [round(float(span.end[2]) + 150, 9) for span in spans]
    hole = [1, -1, 1, -1 + 0.254, -3, 10]
    assert heights == [10, *hole, 10, *hole, 20]
    assert [span.line for span in spans] == [6] * 7 + [7] * 7 + [9]


def test_words_of_others_are_refused(machine: Path) -> None:
    with pytest.raises(ValueError, match="line 6: G5 is not known"):
        read_path(HEADER + "G5 X1\n", machine)


def test_distance_from_a_line_and_an_arc() -> None:
    line = Span(1, np.zeros(3), np.array([10.0, 0, 0]), np.full(2, np.nan), 0.0)
    places = np.array([[5, 3, 4], [-3, 0, 4], [13, 4, 0]], dtype=float)
    assert measure_from_span(line, places) == pytest.approx([5, 5, 5])
    # A quarter of a circle of 5 mm about zero, from +x to +y.
    start, end = np.array([5.0, 0, 0]), np.array([0.0, 5, 0])
    arc = Span(1, start, end, np.zeros(2), math.pi / 2)
    places = np.array([[6, 8, 0], [3, 4, 2], [5, -1, 0], [-1, 5, 0]], dtype=float)
    assert measure_from_span(arc, places) == pytest.approx([5, 2, 1, 1])
    back = Span(1, end, start, np.zeros(2), -math.pi / 2)
    assert measure_from_span(back, places) == pytest.approx([5, 2, 1, 1])


def test_a_corner_that_is_cut_is_found(machine: Path) -> None:
    path = read_path(HEADER + "G1 X10 F600\nG1 Y10\nM2\n", machine)
    turns = [span.end for span in path.spans[:2]]
    whole = np.array([[0, 0, 0], *turns, [110, 50, -140], [110, 60, -140]], dtype=float)
    lines = np.array([4, 4, 5, 6, 7])
    assert measure_distance(Samples(whole, lines), path) == (0.0, 0)
    # From 0.3 mm before the corner straight to 0.3 mm after it: half of the diagonal.
    cut = np.insert(whole, 3, [109.7, 50, -140], axis=0)
    cut[4] = [110, 50.3, -140]
    distance, line = measure_distance(Samples(cut, np.array([4, 4, 5, 6, 7, 7])), path)
    assert (distance, line) == (pytest.approx(0.3 * math.sqrt(0.5)), 6)
    assert measure_from_polyline(whole, np.array([111.0, 55, -140])) == 1.0


def test_seconds_begin_at_home(machine: Path) -> None:
    path = read_path(HEADER + "G1 X10 F600\nM2\n", machine)
    x = np.append(np.full(5, 100.0), np.linspace(100, 110, 41)[1:])
    places = np.column_stack([x, np.full(45, 50.0), np.full(45, -140.0)])
    places[:4, 2] = -150
    lines = np.append(np.full(5, 5), np.full(40, 6))
    assert measure_seconds(Samples(places, lines), path) == pytest.approx(0.040)
