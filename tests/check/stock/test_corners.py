"""Rounded corners in the stock proof, against formulas."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

import camgen
from bench.check.tangent_parts import DIGITS, measure_depth, mill
from bench.render.tangent_parts import tangent_part
from camgen.check.stock import Cut, StockProof, design, prove
from camgen.cli import main
from camgen.model.cell import Dynamics
from camgen.model.job import StockTable
from camgen.model.part import Contour
from camgen.model.program import Instruction, MoveL
from camgen.post import Post
from camgen.post.plugins import find_post
from tests.check.stock.test_stock import (
    MILL,
    make_part,
    make_pose,
    make_square,
    make_task,
    rapid_to,
)
from tests.support.rounded_paths import trace

PLATE = Path(__file__).parents[3] / "fixtures" / "parts" / "plate.dxf"
ZONES = Dynamics(corner="zone")
RADIUS = 3.0
#: Path of the middle of the mill around a square of 40 mm, with sharp corners.
CORNERS = ((-3.0, -3.0), (43.0, -3.0), (43.0, 43.0), (-3.0, 43.0), (-3.0, -3.0))


def mill_around(zone: float) -> list[Instruction]:
    """Mill around a square with this blend radius, mm, at its corners."""
    motions: list[Instruction] = [rapid_to(-3.0, -3.0, 5.0)]
    motions += [MoveL(make_pose(x, y, -5.0), 10.0, blend=zone) for x, y in CORNERS]
    return [*motions, rapid_to(-3.0, -3.0, 5.0)]


def prove_corners(
    body: Sequence[Instruction], dynamics: Dynamics | None, corner: float = 0.01
) -> StockProof:
    """The stock proof of a program around a square on a controller with these dynamics."""
    cut = Cut(body, range(1, len(body) + 1), MILL, "p.mod", corner=corner)
    tasks = [make_task(make_part(make_square("c1", 0, 40)))]
    stock = StockTable(thickness=5.0, held="tape")
    return prove([cut], design(tasks, stock), dynamics, stock)


@pytest.mark.parametrize("zone", [5.0, 10.0, 20.0])
def test_a_zone_at_a_sharp_corner_cuts_as_deep_as_its_parabola(zone: float) -> None:
    # The parabola passes a right corner at zone sin(45 deg) / 2. The programmed corner is the
    # diagonal of the radius away from the corner of the part.
    rounded = zone * math.sqrt(2) / 4
    gap = RADIUS * math.sqrt(2) - rounded
    depth = min(max(RADIUS - gap, 0.0), 5.0)
    proof = prove_corners(mill_around(zone), ZONES)
    # Eight chords deviate from a parabola by a 64th of its height, towards the part.
    assert depth - 1e-9 <= proof.bite <= depth + rounded / 64 + 1e-9
    faults = proof.corners
    # Line 2 is the plunge, and the path ends with line 6.
    assert [fault.line for fault in faults] == [3, 4, 5]
    assert all(fault.mm == pytest.approx(proof.bite) for fault in faults)
    assert proof.refused


def test_a_small_zone_at_a_sharp_corner_stays_off_the_part() -> None:
    proof = prove_corners(mill_around(2.0), ZONES)
    assert proof.bite == 0.0
    assert proof.refused == ()


def test_corners_are_not_examined_without_dynamics() -> None:
    proof = prove_corners(mill_around(20.0), None)
    assert proof.bite is None
    assert proof.refused == ()


def test_a_corner_with_a_stop_or_on_a_controller_without_blends_cuts_nothing() -> None:
    assert prove_corners(mill_around(0.0), ZONES).bite == 0.0
    assert prove_corners(mill_around(20.0), Dynamics(corner="junction")).bite == 0.0


@pytest.mark.parametrize(("corner", "faults"), [(0.02, 0), (0.005, 1)])
def test_linuxcnc_cuts_no_deeper_than_its_tolerance(corner: float, faults: int) -> None:
    proof = prove_corners(mill_around(0.0), Dynamics(corner="arc", deviation=0.02), corner)
    assert proof.bite == 0.02
    assert len(proof.corners) == faults


@pytest.mark.parametrize("number", [0, 7, 18])
def test_the_depth_agrees_with_the_measurement_of_the_bench(number: int) -> None:
    drawn = tangent_part(number)
    result = mill(drawn)
    depth = measure_depth(drawn, trace(drawn.language, result.text).executed)
    assert depth > 0.03
    assert depth - DIGITS <= result.proof.bite <= drawn.tolerance


def test_verify_refuses_a_zone_that_is_too_large_as_a_gouge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, program = tmp_path / "job.toml", tmp_path / "plate.mod"
    job.write_text("[operation]\ndepth = 5.0\n[tool]\ndiameter = 3.0\n[stock]\nthickness = 5.0\n")
    common = ["--post", "rapid", "--job", str(job)]
    assert main(["build", str(PLATE), *common, "-o", str(program), "-q"]) == 0
    verify = ["verify", str(program), "--part", str(PLATE), "--post", "rapid"]
    assert main([*verify, "--job", str(job)]) == 0
    text = program.read_text()
    zones = re.findall(r",z[015],(?=tCamgen)", text)
    assert zones
    program.write_text(re.sub(r",z[015],(?=tCamgen)", ",z20,", text))
    capsys.readouterr()
    assert main([*verify, "--job", str(job)]) == 3
    assert re.search(r"line \d+: the corner at .* is rounded and cuts", capsys.readouterr().out)


def test_a_traced_line_may_deviate_by_the_tolerance_of_corners() -> None:
    """A groove runs in material that stays; its rounded corners do not count as cuts into it."""
    contour = Contour([(0, 0), (40, 0), (40, 40)], [0, 0, 0], False, "0")
    job = {
        "tool": {"diameter": 1.0},
        "operation": {"kind": "trace", "depth": 0.5},
        "tolerance": {"corner": 0.3},
    }
    result = camgen.build(camgen.part([contour]), post="rapid", job=job)
    assert result.rounded.mm > 0.1
    assert result.proof.bite == 0.0


def test_a_post_without_dynamics_has_a_proof_of_the_programmed_path_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(find_post("gcode"), "dynamics", Post.dynamics)
    command = ["build", str(PLATE), "--post", "gcode", "-o", str(tmp_path / "plate.ngc")]
    assert main([*command, "--set", "operation.depth=2", "--set", "process.spindle=9000"]) == 0
    summary = capsys.readouterr().err + capsys.readouterr().out
    assert "of the programmed path only" in summary
    assert "rounding" not in re.findall("stock .*", summary)[0]
