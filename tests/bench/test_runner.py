"""The runner of benches: tables row by row, refused inputs, missed goals, words of the command."""

import sys
from pathlib import Path

import numpy as np
import pytest

from bench.robots.rfa import run_build
from bench.support.motions import measure_motion, sample_motion, sample_plane
from bench.support.runner import (
    PARTS,
    Missed,
    Scenario,
    Table,
    machine,
    read_words,
    run,
    verdict,
)
from bench.support.timing import measure_process
from camgen.model.errors import InputError

COLUMNS = "drawing | off mm {:.2f} | range s **{:.1f}** to {:.1f} | share {:.0f} % | "


def test_a_table_writes_its_cells_by_the_formats_of_its_columns(
    capsys: pytest.CaptureFixture[str],
) -> None:
    table = Table(COLUMNS)
    table.add("a", 0.126, (1, 2.25), 12.4, "ok")
    table.add("b", None, "none")
    assert capsys.readouterr().out.splitlines()[1:] == [
        "| drawing | off mm | range s | share | |",
        "|---|---|---|---|---|",
        "| a | 0.13 | **1.0** to 2.2 | 12 % | ok |",
        "| b | | none | | |",
    ]
    assert table.missed == 0


def test_a_missed_goal_and_a_refused_input_fail_the_bench(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def measure(size: float) -> list[tuple[object, ...]]:
        if size < 0:
            raise InputError("a.dxf", "is empty", "draw something")
        return [(size, verdict(size < 2))]

    good = Scenario("size {:g} | ", [(1.0,)], measure)
    assert run(good, note="; quiet") == 0
    assert capsys.readouterr().out.startswith(f"{machine()}; quiet\n")
    assert run(good, good._replace(inputs=[(3.0,)], title="Large ones:")) == 1
    assert "\nLarge ones:\n\n| size | |\n|---|---|\n| 3 | **missed** |\n" in capsys.readouterr().out
    refused = good._replace(inputs=[(-1.0,)])
    assert run(refused) == 1
    assert "| -1.0 | refused: a.dxf: is empty" in capsys.readouterr().out
    assert run(refused._replace(may_refuse=True)) == 0


def test_words_have_the_types_of_their_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["bench", "7", "0.5", "rfa1", "rfa2"])
    assert read_words(5, 4.0) == [7, 0.5, "rfa1", "rfa2"]
    assert read_words(5, 4.0, "-", "a", 9) == [7, 0.5, "rfa1", "rfa2", 9]


def test_a_process_that_fails_ends_the_bench_with_its_words() -> None:
    process = measure_process([sys.executable, "-c", "print(6 * 7)"])
    assert process.text == "42\n"
    assert process.peak > 1
    with pytest.raises(SystemExit, match="no such thing"):
        measure_process([sys.executable, "-c", "raise SystemExit('no such thing')"])


def test_an_arc_is_sampled_along_its_circle() -> None:
    """Three quarters of a circle of 2 mm about (1, 0), which climbs nowhere."""
    start, via, end = np.array([3.0, 0, 5]), np.array([-1.0, 0, 5]), np.array([1.0, -2, 5])
    assert measure_motion(start, via, end) == pytest.approx(3 * np.pi)
    points = sample_motion(start, via, end, 0.1)
    assert np.hypot(points[:, 0] - 1, points[:, 1]) == pytest.approx(2.0)
    assert points[:, 2] == pytest.approx(5.0)
    assert points[[0, -1]] == pytest.approx(np.array([start, end]))
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.1
    # An arc that stands upright is a line as seen from above.
    upright = sample_plane(start, None, np.array([7.0, 0, 8]), 1.0)
    assert upright == pytest.approx(3 + np.linspace(0, 4, 6))


def test_a_cell_with_a_missed_goal_is_counted_by_row(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("a {:g} | b")
    table.add(Missed("2 mm"), Missed("3 mm"))
    table.add(1, "ok")
    assert table.missed == 1
    assert "| 2 mm | 3 mm |" in capsys.readouterr().out


def test_a_build_of_an_arm_is_a_process_with_the_settings_of_its_job(tmp_path: Path) -> None:
    part = tmp_path / "bracket.dxf"
    part.write_bytes((PARTS / part.name).read_bytes())
    process = run_build(part, {"process": {"feed": 12.5}, "tool": {"diameter": 3.0}})
    assert process.processor > 0
    assert "12.5" in part.with_suffix(".mod").read_text()
