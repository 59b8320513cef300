"""The map of the covered areas, and programs that fill a DXF and an SVG drawing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.plan.fill.cover import COLOURS, make_coverage_map

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
JOB = {"operation": {"kind": "fill"}, "tool": {"diameter": 0.85}}


def test_the_map_shows_the_areas_of_the_report() -> None:
    result = camgen.build(PARTS / "copper.dxf", post="gcode", job=JOB)
    picture = make_coverage_map(result.part, result.tour.paths, 0.85, 1500)
    mm2 = float(-np.linalg.det(picture.work_from_map[:, :2]))
    areas = [mm2 * float((picture.pixels == colour).all(axis=2).sum()) for colour in COLOURS]
    coverage = result.coverage
    assert coverage is not None
    # The copper is two pads, a track and a plane.
    # It has four holes and a clearance with a pad in it.
    circles = np.pi * (-2 * 0.4**2 - 1.6**2 + 1.0**2 - 0.4**2)
    assert coverage.copper == pytest.approx(2 * 9 + 9 * 0.5 + 15 * 6 + circles, abs=0.02)
    assert areas[1] == pytest.approx(coverage.covered, abs=0.1)
    assert areas[2] == pytest.approx(coverage.copper - coverage.covered, abs=0.1)
    assert areas[3] == pytest.approx(coverage.outside + coverage.thin, abs=0.1)
    assert coverage.enough


def test_an_svg_drawing_is_filled_and_its_hole_stays_free(tmp_path: Path) -> None:
    drawing = tmp_path / "plane.svg"
    drawing.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
        '<path d="M1 1 H19 V9 H1 Z M10 3 A2 2 0 0 0 10 7 A2 2 0 0 0 10 3 Z" fill="black"/></svg>'
    )
    result = camgen.build(drawing, post="vplus", job=JOB)
    assert result.coverage is not None
    assert result.coverage.copper == pytest.approx(18 * 8 - np.pi * 4, rel=1e-3)
    assert result.coverage.enough
    assert result.coverage.outside <= 0.02 * result.coverage.copper
    points = np.concatenate([path.position for path in result.tour.paths])
    assert (np.hypot(points[:, 0] - 10, points[:, 1] - 5) > 2).all()


def test_a_job_of_another_kind_has_no_coverage() -> None:
    result = camgen.build(PARTS / "plate.dxf", post="gcode", job={"operation": {"kind": "drill"}})
    assert result.coverage is None
    assert "coverage" not in result.report
