"""Rest machining: an operation cuts only the rest material of earlier operations."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import camgen
from camgen.cli import main
from camgen.model.part import Contour, Part
from camgen.model.path import ToolPath
from camgen.pipeline import Result
from tests.support.drawn import circle, contour, rectangle

LARGE, SMALL = 3.0, 1.0


def build(*inner: Contour, **rest: object) -> Result:
    """A plate with `inner` contours, which a mill of 6 mm follows; a mill of 2 mm cuts the rest."""
    outline = rectangle(-20, -20, 140, 120, "outline")
    ids = [drawn.id for drawn in inner]
    common = {"kind": "follow", "ids": ids, "depth": 3.5, "entry": "ramp", "passes": 2}
    job = {
        "stock": {"thickness": 3.0},
        "tools": [
            {"name": "large", "number": 1, "diameter": 2 * LARGE, "speed": 9000.0},
            {"name": "small", "number": 2, "diameter": 2 * SMALL, "speed": 9000.0},
        ],
        "operations": [
            {"tool": "large", **common},
            {"tool": "small", "rest": True, **common, **rest},
        ],
    }
    part = Part("part", "part.dxf", "mm", (outline, *inner), ())
    return camgen.build(part, post="gcode", job=job)


def list_rest_paths(result: Result) -> list[ToolPath]:
    return [path for path in result.planned if path.id.startswith("1:")]


def list_first_paths(result: Result) -> list[ToolPath]:
    return [path for path in result.planned if path.id.startswith("0:")]


def make_centre_line(path: ToolPath) -> Any:
    """The centre line of a path, arcs as chords of their halves."""
    points = [path.position[0, :2]]
    for via, end in zip(path.via[1:, :2], path.position[1:, :2], strict=True):
        points += [end] if math.isnan(via[0]) else [via, end]
    return shapely.LineString(points)


def test_a_small_mill_cuts_the_corners_that_a_large_one_leaves() -> None:
    result = build(rectangle(0, 0, 60, 40, "window"))
    paths = list_rest_paths(result)
    assert len(paths) == 4
    assert not any(path.closed for path in paths)
    corners = {(round(x / 60) * 60, round(y / 40) * 40) for x, y in _list_middles(paths)}
    assert corners == {(0, 0), (60, 0), (60, 40), (0, 40)}
    for path in paths:
        # The large mill touches a wall up to 3 mm from the corner. The small one starts and ends
        # with its disc in cleared ground, so about 3 mm from the corner, along the wall.
        for x, y, _ in path.position[[0, -1]].tolist():
            along = max(min(x, 60 - x), min(y, 40 - y))
            assert LARGE - 0.4 < along < LARGE + 0.6
    assert result.motion is not None
    assert not result.motion.findings


def _list_middles(paths: list[ToolPath]) -> list[list[float]]:
    return [path.position[:, :2].mean(axis=0).tolist() for path in paths]


@pytest.mark.parametrize(
    "shape",
    [
        rectangle(0, 0, 60, 40, "window"),
        contour([(0, 0), (50, 5), (20, 15), (45, 40), (5, 30)], name="window"),
        # Two areas with a neck of 4 mm, which the large mill cannot enter.
        contour(
            [
                *((0, 0), (30, 0), (30, 18), (50, 18), (50, 0), (80, 0)),
                *((80, 40), (50, 40), (50, 22), (30, 22), (30, 40), (0, 40)),
            ],
            name="window",
        ),
    ],
)
def test_both_mills_together_cut_the_same_as_the_small_one_alone(shape: Contour) -> None:
    result = build(shape)
    large = [make_centre_line(path).buffer(LARGE) for path in list_first_paths(result)]
    small = [make_centre_line(path).buffer(SMALL) for path in list_rest_paths(result)]
    alone = shapely.Polygon(shape.points).buffer(-SMALL, join_style="mitre")
    kerf = alone.boundary.buffer(SMALL)
    left = kerf.difference(shapely.union_all([*large, *small]))
    assert left.buffer(-0.02).is_empty
    length = sum(make_centre_line(path).length for path in list_rest_paths(result))
    assert length < 0.9 * alone.length
    assert not result.motion.findings


def test_a_neck_is_entered_from_cleared_ground() -> None:
    points = [
        *((0, 0), (30, 0), (30, 18), (50, 18), (50, 0), (80, 0)),
        *((80, 40), (50, 40), (50, 22), (30, 22), (30, 40), (0, 40)),
    ]
    result = build(contour(points, name="window"))
    large = [make_centre_line(path).buffer(LARGE + 0.01) for path in list_first_paths(result)]
    cleared = shapely.union_all(large)
    for path in list_rest_paths(result):
        for x, y, _ in path.position[[0, -1]].tolist():
            assert cleared.covers(shapely.Point(x, y).buffer(SMALL - 0.02))


def test_a_note_names_a_round_hole_without_rest_material() -> None:
    result = build(rectangle(0, 0, 30, 30, "window"), circle(70, 30, 10, "hole"))
    assert {path.contours for path in list_rest_paths(result)} == {("window",)}
    assert any("nothing is left at 1 contour: hole" in note.what for note in result.notes)


def test_a_corner_that_is_missing_in_the_text_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="80mm" viewBox="0 0 100 80">'
        '<rect x="0" y="0" width="100" height="80"/><rect x="20" y="20" width="60" height="40"/>'
        "</svg>"
    )
    (tmp_path / "part.toml").write_text(
        "[stock]\nthickness = 3.0\n"
        '[[tools]]\nname = "large"\nnumber = 1\ndiameter = 6.0\nspeed = 9000.0\n'
        '[[tools]]\nname = "small"\nnumber = 2\ndiameter = 2.0\nspeed = 9000.0\n'
        '[[operations]]\ntool = "large"\nnesting = "inner"\ndepth = 3.5\nentry = "ramp"\n'
        '[[operations]]\ntool = "small"\nnesting = "inner"\nrest = true\ndepth = 3.5\n'
        'entry = "ramp"\n'
    )
    assert main(["build", "part.svg", "--post", "gcode", "-q"]) == 0
    text = (tmp_path / "part.ngc").read_text()
    *kept, last = text.split("(path 1:")
    assert len(kept) == 4
    (tmp_path / "part.ngc").write_text("(path 1:".join(kept) + last[last.index("M5") :])
    capsys.readouterr()
    command = ["verify", "part.ngc", "--post", "gcode", "--part", "part.svg", "--job", "part.toml"]
    main(command)
    summary = capsys.readouterr().out
    assert "else, up to 0.8" in summary
    assert "motion     verified" not in summary


def test_rest_machining_needs_an_operation_before_it() -> None:
    part = Part("part", "part.dxf", "mm", (rectangle(0, 0, 30, 30),), ())
    with pytest.raises(camgen.JobError, match="no operation before it takes anything"):
        camgen.build(part, post="gcode", job={"operation": {"rest": True, "depth": 2.0}})


def test_a_shallow_operation_leaves_all_of_a_deeper_contour() -> None:
    result = build(rectangle(0, 0, 60, 40, "window"), depth=5.0)
    (path,) = list_rest_paths(result)
    assert path.closed
    assert np.isclose(make_centre_line(path).length, 2 * (58 + 38))
