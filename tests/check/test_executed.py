"""The executed path of a text, by the model of its controller and by an independent one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.check.executed import ReadText, Rounding, measure_text
from camgen.cli import main
from camgen.model.errors import NoSafeProgram
from camgen.model.program import Columns
from camgen.post.plugins import dynamics_of, fill_tables, find_readback
from tests.support.rounded_paths import list_corners
from tests.test_cases import ALL, built

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: mm: rounding of the last digit at both ends of a motion.
DIGITS = 0.001
#: Cases tested here; `python -m bench.check.rounding` measures all.
MEASURED = [
    (case, post)
    for case, post in ALL
    if case.name in ("bracket-follow", "blocks-trace", "gear-trace", "logo-trace")
    and post in ("rapid", "pacscript", "vplus")
]


@pytest.mark.parametrize(
    ("case", "post"), MEASURED, ids=lambda value: getattr(value, "name", value)
)
def test_the_deviation_agrees_with_an_independent_model(case: Path, post: str) -> None:
    result = built(case, post)
    corners = list_corners(post, result.text)
    assert len(corners) == result.rounded.transitions
    assert max(corners).mm == pytest.approx(result.rounded.mm, rel=0.02, abs=DIGITS / 10)
    assert max(corners).mm <= result.rounded.allowed + DIGITS


def measure_changed(result: camgen.Result, text: str) -> Rounding:
    """The rounding of a changed text."""
    options = fill_tables(type(result.post), result.job.post)
    reading = find_readback(result.post.name)({"a": text}, options)
    columns, planned = Columns(reading.body), result.program.columns
    allowed = np.full(len(columns.at), result.rounded.allowed)
    lines = np.asarray(reading.lines)[columns.at]
    dynamics = dynamics_of(result.post, result.job)
    return measure_text(ReadText(columns, lines, planned.works, allowed, "a"), dynamics, 0.01)


def test_each_zone_that_is_too_large_is_found() -> None:
    """Both models find the same corner, at its line, with the same deviation."""
    case = next(case for case, _ in MEASURED if case.name == "bracket-follow")
    result = built(case, "rapid")
    text = result.files[0].text
    too_large = 0
    for zone in re.finditer(r",(z0|z1|z5),(?=tCamgen)", text):
        changed = f"{text[: zone.start()]},z10,{text[zone.end() :]}"
        worst = max(list_corners("rapid", changed))
        if worst.mm <= result.rounded.allowed + 2 * DIGITS:
            continue
        rounded = measure_changed(result, changed)
        assert rounded.line == worst.line
        assert rounded.mm == pytest.approx(worst.mm, rel=0.03)
        too_large += 1
    assert too_large >= 15


def test_a_tolerance_that_cannot_be_kept_is_refused_with_the_corner() -> None:
    job = {
        "operation": {"kind": "trace"},
        "tolerance": {"corner": 0.002},
        "post": {"path_tolerance": 0.01},
    }
    with pytest.raises(
        NoSafeProgram, match=r"rounds the corner at .* mm by 0.01 mm.* \(line \d+\)"
    ) as caught:
        camgen.build(PARTS / "bracket.dxf", post="gcode", job=job)
    assert caught.value.exit_code == 3
    assert "post.path_tolerance = 0.002" in caught.value.remedy


@pytest.mark.parametrize(
    ("corner", "line"), [(0.002, "G64 P0.002 Q0"), (0.5, "G64 P0.01 Q0"), (0.0, "G61")]
)
def test_linuxcnc_gets_the_tolerance_of_the_job(corner: float, line: str) -> None:
    job = {"operation": {"kind": "trace"}, "tolerance": {"corner": corner}}
    assert f"\n{line}\n" in camgen.build(PARTS / "bracket.dxf", post="gcode", job=job).text


@pytest.mark.parametrize("corner", [0.0, 0.002])
def test_verify_expects_the_tolerance_of_the_job(
    corner: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, part = tmp_path / "job.toml", str(PARTS / "bracket.dxf")
    job.write_text(f"[tolerance]\ncorner = {corner}\n")
    common = ["--post", "gcode", "--job", str(job)]
    program = str(tmp_path / "part.ngc")
    assert main(["build", part, *common, "-o", program, "-q"]) == 0
    assert main(["verify", program, *common, "--part", part]) == 0
    assert "path_tolerance" not in capsys.readouterr().out


def test_grbl_does_not_deviate_from_the_path() -> None:
    rounded = camgen.build(PARTS / "bracket.dxf", post="grbl").rounded
    assert rounded.transitions > 0
    assert rounded.mm == 0.0
