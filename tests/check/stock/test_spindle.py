"""The spindle has to rotate in the right direction and speed while a tool is in material."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.check.stock import Cut, StockProof, design, prove
from camgen.cli import main
from camgen.model.job import StockTable, ToolTable
from camgen.model.program import Instruction, Output
from tests.check.stock.test_stock import MILL, cut_around, make_part, make_square, make_task

PLATE = Path(__file__).parents[3] / "fixtures" / "parts" / "plate.dxf"
NOT_EXAMINED = "the text sets no spindle: whether the tool rotates is not judged"
AROUND_SQUARE = cut_around(0, 40, 3.0, -5.0)


def prove_round(*bodies: Sequence[Instruction], tool: ToolTable = MILL) -> StockProof:
    """The proof of cuts of one file, all around a square."""
    cuts, line = [], 1
    for body in bodies:
        cuts.append(Cut(body, range(line, line + len(body)), tool, "p.ngc"))
        line += len(body)
    tasks = [make_task(make_part(make_square("c1", 0, 40)), tool=tool)]
    stock = StockTable(thickness=5.0, held="tape")
    return prove(cuts, design(tasks, stock), stock=stock)


@pytest.mark.parametrize(
    ("speed", "text"),
    [
        (9000.0, ""),
        (0.0, "cuts 5 mm deep with the spindle at rest"),
        (-9000.0, "with the spindle to the left (M4, 9000 rpm)"),
        (9500.0, "at 9500 rpm, more than tool.max_speed"),
    ],
)
def test_the_spindle_rotates_clockwise_at_no_more_than_the_maximum_speed(
    speed: float, text: str
) -> None:
    tool = replace(MILL, max_speed=9000.0)
    proof = prove_round([Output("spindle", speed), *AROUND_SQUARE], tool=tool)
    assert len(proof.spindles) == bool(text)
    # The plunge is the third instruction, and the first one in material.
    assert all(fault.line == 3 and text in fault.text for fault in proof.spindles)
    assert proof.refused == proof.spindles
    assert NOT_EXAMINED not in proof.notes


def test_consecutive_motions_without_a_spindle_are_one_fault() -> None:
    body = [Output("spindle", 9000.0), *AROUND_SQUARE]
    body[4:4] = [Output("spindle", 0.0)]
    body[7:7] = [Output("spindle", 9000.0)]
    body[9:9] = [Output("spindle", 0.0)]
    assert [fault.line for fault in prove_round(body).spindles] == [6, 11]


def test_the_spindle_stays_on_between_the_cuts_of_a_file() -> None:
    proof = prove_round([Output("spindle", 9000.0), *AROUND_SQUARE], AROUND_SQUARE)
    assert proof.spindles == ()
    assert NOT_EXAMINED not in proof.notes


def test_the_spindle_may_stop_before_the_retract() -> None:
    body = [
        Output("spindle", 9000.0),
        *AROUND_SQUARE[:-1],
        Output("spindle", 0.0),
        AROUND_SQUARE[-1],
    ]
    assert prove_round(body).spindles == ()


def test_a_text_without_a_spindle_is_not_examined() -> None:
    proof = prove_round([Output("process", 0.0), *AROUND_SQUARE])
    assert proof.spindles == ()
    assert NOT_EXAMINED in proof.notes


def test_a_laser_has_no_spindle() -> None:
    laser = replace(MILL, kind="laser")
    proof = prove_round([Output("process", 1.0), *AROUND_SQUARE], tool=laser)
    assert proof.spindles == ()
    assert NOT_EXAMINED not in proof.notes


def test_verify_refuses_a_mill_that_does_not_rotate_clockwise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, program = tmp_path / "job.toml", tmp_path / "plate.ngc"
    job.write_text("[operation]\ndepth = 5.0\n[tool]\ndiameter = 3.0\n[process]\nspindle = 9000\n")
    common = ["--post", "gcode", "--job", str(job)]
    assert main(["build", str(PLATE), *common, "-o", str(program), "-q"]) == 0
    verify = ["verify", str(program), "--part", str(PLATE), *common]
    assert main(verify) == 0
    text = program.read_text()
    assert text.count("S9000 M3\n") == 1
    for words, finding in (("M5\n", "at rest"), ("S9000 M4\n", r"to the left \(M4, 9000 rpm\)")):
        program.write_text(text.replace("S9000 M3\n", words))
        capsys.readouterr()
        assert main(verify) == 3
        assert re.search(rf"with the spindle {finding}", capsys.readouterr().err)
