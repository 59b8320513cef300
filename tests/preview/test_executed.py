"""The executed path in the preview: its curves compared with formulas, and posts without one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import camgen
from camgen.model.part import Contour
from camgen.pipeline import Result
from camgen.preview.executed import trace_executed
from camgen.preview.page import format_page
from camgen.preview.view import make_view
from tests.preview.test_page import PARTS, read_data

SAG_MM = 1e-4


def trace_corner(post: str, corner: float) -> Result:
    """Two lines of 40 mm with a right corner between them, traced."""
    contour = Contour([(0, 0), (40, 0), (40, 40)], [0, 0, 0], False, "0")
    job = {"operation": {"kind": "trace"}, "tolerance": {"corner": corner}}
    return camgen.build(camgen.part([contour]), post=post, job=job)


def test_the_executed_path_is_a_parabola_in_the_corner() -> None:
    result = trace_corner("rapid", 2.0)
    chains = trace_executed(result, SAG_MM)
    assert chains.counts.tolist() == [len(chains.points)]
    zone = max(result.program.columns.blend)
    # A parabola passes a right corner at zone sin(45 deg) / 2.
    distance_mm = np.linalg.norm(chains.points - [40, 0, 0], axis=1).min()
    assert distance_mm == pytest.approx(zone * math.sin(math.radians(45)) / 2, rel=1e-3)
    assert distance_mm == pytest.approx(result.rounded.mm, rel=1e-3)
    ends = chains.points[[0, -1]][:, :2]
    assert sorted(map(tuple, ends.tolist())) == [(0.0, 0.0), (40.0, 40.0)]


@pytest.mark.parametrize("post", ["rapid", "vplus", "pacscript"])
def test_the_executed_path_deviates_by_no_more_than_the_summary_states(post: str) -> None:
    job = {"tool": {"diameter": 2.0}, "tolerance": {"corner": 0.05}}
    result = camgen.build(PARTS / "bracket.dxf", post=post, job=job)
    chains = trace_executed(result, SAG_MM)
    programmed = shapely.union_all(
        [shapely.LineString(line) for line in _list_programmed(result) if len(line) > 1]
    )
    executed = [
        shapely.LineString(line)
        for line in np.split(chains.points[:, :2], np.cumsum(chains.counts)[:-1])
    ]
    farthest = max(
        shapely.hausdorff_distance(line, _clip_near(programmed, line)) for line in executed
    )
    assert farthest <= result.rounded.mm + 0.003


def _clip_near(programmed: shapely.Geometry, line: shapely.Geometry) -> shapely.Geometry:
    """The part of the programmed paths within 1 mm of a line."""
    return shapely.intersection(programmed, shapely.buffer(line, 1.0))


def _list_programmed(result: Result) -> list[np.ndarray]:
    """The programmed paths of a page as chains of points (n, 2), mm."""
    track = make_view(result).track
    path = track.events.path[track.event]
    edges = np.flatnonzero(np.diff(path)) + 1
    pieces = np.split(np.arange(len(path)), edges)
    return [
        track.position[max(rows[0] - 1, 0) : rows[-1] + 1, :2]
        for rows in pieces
        if path[rows[0]] >= 0
    ]


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_post_with_only_a_tolerance_has_no_executed_path(post: str) -> None:
    assert trace_executed(trace_corner(post, 0.05), SAG_MM) is None


def test_a_path_without_rounded_corners_has_no_executed_path() -> None:
    assert trace_executed(trace_corner("rapid", 0.0), SAG_MM) is None


def test_the_page_has_the_executed_path_and_states_the_worst_corner() -> None:
    shown = read_data(format_page(make_view(trace_corner("rapid", 2.0))))
    assert sum(shown["executed"]["counts"]) > 10
    facts = dict(shown["facts"])
    assert "at 40 0 0 mm" in facts["Rounded corners"]
    assert "executed" not in read_data(format_page(make_view(trace_corner("grbl", 0.05))))
