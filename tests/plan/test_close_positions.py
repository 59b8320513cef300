"""Positions of old programs that are too close for an arm are left out within the tolerance."""

from itertools import pairwise

import numpy as np
import pytest

import camgen
from camgen.model.program import MoveL
from camgen.plan.close_positions import keep_points

#: mm; short lines along a circle of this radius.
RADIUS, STEP = 20.0, 0.02
TOLERANCE = 0.01


def write_circle(count):
    angles = np.arange(count) * STEP / RADIUS
    points = np.column_stack([RADIUS * np.sin(angles), RADIUS - RADIUS * np.cos(angles)])
    lines = [f"G1 X{x:.5f} Y{y:.5f} F600" for x, y in points.tolist()]
    return points, "G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F300\n" + "\n".join(lines) + "\nG0 Z5\nM2\n"


def build(tmp_path, text, post):
    path = tmp_path / "old.nc"
    path.write_text(text)
    return camgen.build(path, post=post)


def test_positions_are_left_out_within_the_tolerance(tmp_path):
    """Chords of a circle of radius r deviate by t if they are about 1.26 mm, 2 sqrt(2 r t)."""
    points, text = write_circle(600)
    result = build(tmp_path, text, "rapid")
    lines = [item for item in result.program.body if isinstance(item, MoveL) and item.work]
    ends = np.array([line.target.origin[:2] for line in lines])
    shortest = 2 * np.sqrt(2 * RADIUS * TOLERANCE) / 2
    assert len(ends) < 600 * STEP / shortest + 3
    gaps = np.linalg.norm(ends[:, None] - points[None], axis=2).min(axis=1)
    assert gaps.max() < 1e-4
    middles = (ends[2:] + ends[1:-1]) / 2
    radius = np.linalg.norm(middles - (0, RADIUS), axis=1)
    assert (RADIUS - radius).max() < TOLERANCE + 1e-5
    note = next(note for note in result.notes if "left out" in note.what)
    assert note.kind == "assumed"
    assert note.what.startswith("line 4: ")
    assert not any("less than 0.3 mm apart" in note.what for note in result.notes)


def test_a_mill_runs_to_all_positions(tmp_path):
    _, text = write_circle(100)
    result = build(tmp_path, text, "gcode")
    assert sum(isinstance(item, MoveL) for item in result.program.body) == 100


def test_close_positions_that_stay_are_a_warning(tmp_path):
    """No point of a wave of 0.1 mm in height is near the line between its neighbours."""
    angles = np.linspace(0, 20 * np.pi, 201)
    lines = [f"G1 X{a / 20:.4f} Y{0.1 * np.sin(a):.4f} F600" for a in angles.tolist()]
    text = "G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F300\n" + "\n".join(lines) + "\nG0 Z5\nM2\n"
    result = build(tmp_path, text, "rapid")
    note = next(note for note in result.notes if note.kind == "warning")
    assert "positions at a feed are less than 0.3 mm apart" in note.what
    assert note.why == "an arm may slow down or stop there; raise tolerance.chord"


@pytest.mark.parametrize("seed", range(5))
def test_no_point_is_farther_from_the_kept_chain_than_the_tolerance(seed):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(200, 3)), axis=0)
    kept = np.flatnonzero(keep_points(points, 1.0))
    assert kept[0] == 0
    assert kept[-1] == 199
    for low, high in pairwise(kept):
        chord = points[high] - points[low]
        share = np.clip((points[low : high + 1] - points[low]) @ chord / (chord @ chord), 0, 1)
        feet = points[low] + share[:, None] * chord
        assert np.linalg.norm(points[low : high + 1] - feet, axis=1).max() <= 1.0


@pytest.mark.parametrize("turn", range(0, 360, 7))
def test_of_two_points_that_are_equally_far_the_first_is_kept(turn):
    """Otherwise the last bit of a product decides, which differs between processors."""
    angle = np.radians(turn)
    turned = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0]])
    chain = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 1.0], [3.0, 0.0]]) @ turned
    # If (1, 1) is kept, (2, 1) is 1/sqrt(5) mm from the line to the end.
    assert keep_points(chain, 0.5).tolist() == [True, True, False, True]
