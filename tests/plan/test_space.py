"""Curves in space as programs: three axes, an arm with its tool fixed, as given and square to a face; and refusals."""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

import camgen
from camgen.cli import main
from camgen.geometry.arcs import compute_circle
from camgen.model.errors import CamgenError, InputError, JobError, NoSafeProgram
from camgen.model.part import Part
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Force, MoveC, MoveJ, MoveL
from camgen.pipeline import Result
from tests.support.arm_models import by_hand

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
SPACE, SEAM = PARTS / "space.dxf", PARTS / "seam.xyz"
TRACE = {"operation": {"kind": "trace"}}
Tables = dict[str, dict[str, object]]


def points(folder: Path, text: str) -> Path:
    file = folder / "a.xyz"
    file.write_text(text)
    return file


def work(result: Result) -> list[MoveL | MoveC]:
    """The motions along the curves."""
    return [
        move
        for move in result.program.columns.moves
        if isinstance(move, (MoveL, MoveC)) and move.work
    ]


def ends(result: Result) -> FloatArray:
    return np.array([move.target.origin for move in work(result) if isinstance(move.target, Pose)])


def turned(result: Result) -> FloatArray:
    return np.array(
        [move.target.rotation for move in work(result) if isinstance(move.target, Pose)]
    )


def refused(
    part: Path | list[Path], post: str, job: Tables, kind: type[CamgenError] = JobError
) -> str:
    with pytest.raises(kind) as caught:
        camgen.build(part, post=post, job=job)
    return str(caught.value)


# Three axes.


def test_a_mill_follows_a_curve_point_by_point_and_travels_above_it(tmp_path: Path) -> None:
    rows = [[0, 0, 2], [30, 0, 2], [50, 10, 9], [70, 0, -4]]
    file = points(tmp_path, "\n".join(",".join(map(str, row)) for row in rows))
    result = camgen.build(file, post="gcode", job={"tour": {"method": "as-drawn"}})
    assert ends(result).tolist() == rows[1:]
    assert (turned(result) == np.diag([1, -1, -1])).all()
    rapids = [
        m
        for m in result.program.columns.moves
        if isinstance(m, MoveJ) and isinstance(m.target, Pose)
    ]
    travel = [m.target.origin for m in rapids if m.target.origin[2] != 4]  # type: ignore[union-attr]
    assert {z for _, _, z in travel if z < 30} == {20}
    lines = [
        line
        for line in result.text.splitlines()
        if "G1" in line or line.startswith(("X", "Y", "Z"))
    ]
    assert any("Z-4" in line for line in lines)


def test_a_flat_arc_of_a_spatial_drawing_is_an_arc_for_a_mill_and_an_upright_one_chords_within_tolerance() -> (
    None
):
    result = camgen.build(SPACE, post="gcode", job=TRACE)
    assert sum(isinstance(move, MoveC) for move in work(result)) == 2
    upright = np.array([end for end in ends(result) if abs(end[1] - 25) < 1e-9 and end[0] >= 10])
    assert np.hypot(upright[:, 0] - 20, upright[:, 2] - 3) == pytest.approx(10, abs=1e-6)
    assert (
        np.hypot(*((upright[1:] + upright[:-1]) / 2 - (20, 25, 3))[:, [0, 2]].T).min()
        >= 10 - 0.0101
    )


def test_depth_and_passes_go_below_the_curve() -> None:
    job: Tables = {
        "operation": {"kind": "trace", "depth": 3, "passes": 2},
        "process": {"spindle": 9000},
    }
    plain, deep = (
        camgen.build(SPACE, post="grbl", job=TRACE),
        camgen.build(SPACE, post="grbl", job=job),
    )
    assert len(ends(deep)) == 2 * len(ends(plain))
    assert ends(deep)[:, 2].min() == pytest.approx(ends(plain)[:, 2].min() - 3)


def test_a_mill_that_would_travel_through_the_curves_is_refused(tmp_path: Path) -> None:
    file = points(tmp_path, "0,0,0\n9,0,30.5")
    said = refused(file, "gcode", {})
    assert said.endswith("reach up to z = 30.5 (process.clearance); set it to 33 or more")
    assert camgen.build(file, post="gcode", job={"process": {"clearance": 33}}).tour.paths


def test_a_mill_does_not_lean(tmp_path: Path) -> None:
    file = points(tmp_path, "0 0 0 180 0 90\n9 0 5 180 0 -90")
    assert camgen.build(file, post="gcode").tour.paths  # a turn about the spindle is none
    assert "keeps its tool straight down, curve c1 leans it by 15 deg" in refused(SEAM, "gcode", {})
    assert camgen.build(SEAM, post="gcode", job={"tool": {"axis": "fixed"}}).tour.paths
    assert "leans it by 10 deg" in refused(
        SPACE, "gcode", TRACE | {"tool": {"angles": [170, 0, 0]}}
    )
    assert '"normal" needs an arm' in refused(SPACE, "gcode", TRACE | {"tool": {"axis": "normal"}})


def test_a_force_on_a_mill_is_refused_by_its_post() -> None:
    assert "force" in refused(SPACE, "gcode", TRACE | {"process": {"force": 5}}, NoSafeProgram)


# An arm.


@pytest.mark.parametrize("post", ["rapid", "pacscript"])
def test_arcs_in_space_stay_arcs(post: str) -> None:
    result = camgen.build(SPACE, post=post, job=TRACE)
    moves = result.program.columns.moves
    arcs = [(before, move) for before, move in pairwise(moves) if isinstance(move, MoveC)]
    swept = {"arch": 0.0, "ring": 0.0}
    for before, move in arcs:
        assert isinstance(before.target, Pose)
        assert isinstance(move.target, Pose)
        centre, radius, axis, sweep = compute_circle(
            before.target.origin, move.via.origin, move.target.origin
        )
        name = "arch" if radius == pytest.approx(10, abs=1e-9) else "ring"
        want, normal = ((20, 25, 3), 1) if name == "arch" else ((20, 45, 4), 2)
        assert centre == pytest.approx(want, abs=1e-9)
        assert abs(axis[normal]) == pytest.approx(1)
        swept[name] += sweep
    assert swept == pytest.approx({"arch": math.pi, "ring": 2 * math.pi})


def test_a_fixed_tool_stands_as_its_angles_say_and_the_joints_agree() -> None:
    job = TRACE | {"tool": {"angles": [165, 10, 30], "symmetric": False}}
    result = camgen.build(SPACE, post="rapid", job=job)
    a, b, c = np.radians([165, 10, 30])
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    assert turned(result) == pytest.approx(
        np.broadcast_to(about_z @ about_y @ about_x, (len(work(result)), 3, 3))
    )
    base, tool = matrix(result.program.base_from_work), matrix(result.program.flange_from_tool)
    seen = 0
    for move in work(result):
        if move.joints is not None and isinstance(move.target, Pose):
            found = np.linalg.inv(base) @ by_hand("IRB 120", np.degrees(move.joints.values)) @ tool
            assert found == pytest.approx(matrix(move.target), abs=1e-6)
            seen += 1
    assert seen > 50


def matrix(pose: Pose) -> FloatArray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = pose.rotation, pose.origin
    return out


def test_the_angles_of_the_points_are_those_of_the_tool(tmp_path: Path) -> None:
    rows = [
        (0, 0, 5, 180, 0, 0),
        (40, 0, 9, 170, 0, 0),
        (40, 0, 9, 170, 12, 0),
        (80, 20, 5, 180, 12, 0),
    ]
    file = points(tmp_path, "\n".join(" ".join(map(str, row)) for row in rows))
    result = camgen.build(file, post="rapid")
    forward = ends(result)[-1].tolist() == [80, 20, 5]
    wanted = rows[1:] if forward else rows[-2::-1]
    assert ends(result).tolist() == [list(row[:3]) for row in wanted]
    for rotation, row in zip(turned(result), wanted, strict=True):
        a, b = np.radians(row[3:5])
        axis = [math.sin(b) * math.cos(a), -math.sin(a), math.cos(b) * math.cos(a)]
        assert rotation[:, 2] == pytest.approx(axis)
    # The turn on the spot takes its time, and the arm stops for it.
    blends = [move.blend for move in work(result)]
    assert blends == [0, 0, 0]


def test_a_smooth_curve_is_run_without_stops_and_a_corner_with_one(tmp_path: Path) -> None:
    t = np.linspace(0, math.pi, 61)
    rows = np.column_stack([40 * np.cos(t) + 40, 40 * np.sin(t), 10 * np.sin(2 * t) + 12])
    smooth = points(tmp_path, "\n".join(" ".join(f"{v:.4f}" for v in row) for row in rows))
    job: Tables = {"tolerance": {"chord": 0.05}}
    moves = work(camgen.build(smooth, post="rapid", job=job))
    assert sum(move.blend > 0 for move in moves) == len(moves) - 1
    corner = points(tmp_path, "0 0 5\n40 0 9\n40 40 5")
    assert [move.blend for move in work(camgen.build(corner, post="rapid", job=job))] == [0, 0]


def test_a_force_presses_along_the_tool() -> None:
    job = TRACE | {
        "process": {"force": 7},
        "tool": {"angles": [170, 0, 0]},
        "post": {"force_load": "lTool"},
    }
    result = camgen.build(SPACE, post="rapid", job=job)
    axis = (0, -math.sin(math.radians(170)), math.cos(math.radians(170)))
    assert {item.newtons for item in result.program.columns.list_kinds(Force)} == {0, 7}
    assert all(move.force == 7 for move in work(result))
    assert np.array([move.force_direction for move in work(result)]) == pytest.approx(
        np.tile(axis, (len(work(result)), 1))
    )


def test_the_tool_comes_and_leaves_along_its_axis_above_all_curves(tmp_path: Path) -> None:
    file = points(tmp_path, "0 0 5 165 0 0\n60 0 25 165 0 0")
    result = camgen.build(file, post="rapid")
    moves = [
        m
        for m in result.program.columns.moves
        if isinstance(m, MoveL) and isinstance(m.target, Pose)
    ]
    places = np.array([m.target.origin for m in moves if isinstance(m.target, Pose)])
    start = next(k for k, move in enumerate(moves) if move.work) - 1
    axis = np.array([0, -math.sin(math.radians(165)), math.cos(math.radians(165))])
    for away, here in ((places[start - 1], places[start]), (places[-1], places[-2])):
        back = (away - here) / np.linalg.norm(away - here)
        assert back == pytest.approx(-axis, abs=1e-9)
    # The level: half the tool's width and cell.safety above the highest point; the approach ends 2 mm above.
    assert places[-1][2] == pytest.approx(25 + 3 + 10)


def test_a_scara_cannot_lean_and_says_so() -> None:
    assert "cannot lean its tool by 15 deg" in refused(SEAM, "vplus", {}, NoSafeProgram)


def test_what_is_out_of_reach_or_in_the_way_is_left_out_and_the_rest_is_run(tmp_path: Path) -> None:
    file = points(tmp_path, "0 0 5\n60 0 9\n\n0 40 5\n2000 40 5\n\n0 80 5\n60 80 9")
    result = camgen.build(
        file, post="rapid", job={"cell": {"fixtures": [[20, 70, -10, 40, 90, 40]]}}
    )
    left = {note.ids[0]: str(note) for note in result.notes if note.kind == "skipped"}
    assert set(left) == {"c2", "c3"}
    # The rest of the line of 2000 mm is run as far as the arm reaches.
    assert re.match(r"skipped: 17[0-9]{2}\.?[0-9]* mm of curve c2 \(out of reach", left["c2"])
    assert "fixture 1" in left["c3"]
    assert {path.id for path in result.tour.paths} == {"c1", "c2.1", "c3.1", "c3.2"}
    assert result.clear is not None
    with pytest.raises(NoSafeProgram, match="--strict"):
        camgen.build(file, post="rapid", strict=True)


def test_a_turn_of_no_certain_sense_is_left_out(tmp_path: Path) -> None:
    file = points(tmp_path, "0 0 5 180 0 0\n60 0 9 180 0 175\n")
    said = refused(file, "rapid", {}, NoSafeProgram)
    assert (
        "the tool turns by 175 deg from point 1 to the next, too far to know in which direction"
        in said
    )


# Square to the faces of a part.


def on_cylinder(folder: Path, offset: float = 0.0) -> list[Path]:
    """A stretch of a helix round a lying cylinder, radius 40, its axis along x at y = 60 and z = -20; and that."""
    mesh = trimesh.creation.cylinder(40, 120, sections=72)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0, 1, 0)))
    mesh.apply_translation((60, 60, -20))
    mesh.export(folder / "pipe.stl")
    t = np.linspace(-0.6, 0.6, 25)
    reach = 40 + offset
    rows = np.column_stack([60 + 20 * t, 60 + reach * np.sin(t), -20 + reach * np.cos(t)])
    return [
        points(folder, "\n".join(" ".join(f"{v:.5f}" for v in row) for row in rows)),
        folder / "pipe.stl",
    ]


NORMAL: Tables = {"tool": {"axis": "normal", "symmetric": True, "diameter": 2}, "process": {"feed": 10},
                  "cell": {"fixtures": []}, "input": {"units": "mm"}}  # fmt: skip


def lean_off(places: FloatArray, axes: FloatArray) -> FloatArray:
    """Deg between tool axes (N, 3) and the cylinder's normals at places (N, 3)."""
    out = (places - (0, 60, -20)) * (0, 1, 1)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return np.asarray(np.degrees(np.arccos(np.clip(-(axes * out).sum(axis=1), -1, 1))))


def test_the_tool_is_square_to_the_nearest_face(tmp_path: Path) -> None:
    result = camgen.build(on_cylinder(tmp_path, 0.5), post="rapid", job=NORMAL)
    assert [path.id for path in result.tour.paths] == ["c1"]
    places, axes = ends(result), turned(result)[:, :, 2]
    assert len(places) >= 24
    assert lean_off(places, axes).max() < 0.5
    assert lean_off((places[1:] + places[:-1]) / 2, axes[1:] + axes[:-1]).max() < 1
    assert result.clear is not None
    (note,) = [note for note in result.notes if "off pipe.stl" in note.what]
    # Flats of 5 deg lie up to 40 (1 - cos 2.5 deg) within.
    most = float(note.what.split()[4])
    assert 0.5 <= most <= 0.5 + 40 * (1 - math.cos(math.radians(2.5))) + 1e-3


def test_a_long_line_over_a_bent_face_gets_the_rows_that_the_axis_needs(tmp_path: Path) -> None:
    on_cylinder(tmp_path)
    file = points(tmp_path, "30 30 25\n90 90 25")
    result = camgen.build([file, tmp_path / "pipe.stl"], post="rapid", job=NORMAL)
    start = result.tour.paths[0].position[:1]
    assert len(work(result)) > 3
    places = np.concatenate([start, ends(result)])
    along = np.array([1, 1, 0]) / math.sqrt(2)
    assert np.linalg.norm(np.cross(places - (30, 30, 25), along), axis=1) == pytest.approx(
        0, abs=1e-9
    )
    axes = np.concatenate([result.tour.paths[0].axis[:1], turned(result)[:, :, 2]])
    # Up to 54 mm from the axis, a place whose foot is the corner of two flats is up to 2.5 (1 - 40 / 54) deg off it.
    assert lean_off(places, axes).max() < 0.66
    assert lean_off((places[1:] + places[:-1]) / 2, axes[1:] + axes[:-1]).max() < 0.66 + 0.5


def test_a_curve_over_a_sharp_edge_has_no_normal_there(tmp_path: Path) -> None:
    trimesh.creation.box((60, 60, 20)).export(tmp_path / "box.stl")
    file = points(tmp_path, "0 0 10.5\n30.5 0 10.5\n30.5 0 0\n\n-20 0 10.5\n20 0 10.5")
    result = camgen.build([file, tmp_path / "box.stl"], post="rapid", job=NORMAL)
    (left,) = [note for note in result.notes if note.kind == "skipped"]
    assert left.ids == ("c1",)
    assert "the nearest face changes its direction by 90 deg at 30.5 0 " in left.why
    assert (turned(result)[:, :, 2] == [0, 0, -1]).all()


def test_a_part_that_is_given_stands_in_the_way(tmp_path: Path) -> None:
    box = trimesh.creation.box((60, 20, 20))
    box.apply_translation((30, 10, 10))
    box.export(tmp_path / "box.stl")
    file = points(tmp_path, "0 10 10\n60 10 10\n\n0 10 30\n60 10 30")
    result = camgen.build(
        [file, tmp_path / "box.stl"], post="rapid", job={"input": {"units": "mm"}}
    )
    assert [path.id for path in result.tour.paths] == ["c2"]
    (left,) = [note for note in result.notes if note.kind == "skipped"]
    assert "part" in left.why


def test_what_goes_together_and_what_does_not() -> None:
    box = PARTS / "rfa1.stl"
    assert '"normal" needs the part on whose faces the curves lie' in refused(
        SEAM, "rapid", {"tool": {"axis": "normal"}}
    )
    assert "not tested against a part" in refused([SEAM, box], "gcode", {"tool": {"axis": "fixed"}})
    assert "or with one 3-D part" in refused([SEAM, PARTS / "plate.dxf"], "rapid", {}, InputError)
    two = camgen.build([SEAM, SPACE], post="rapid", job=TRACE | {"tool": {"symmetric": True}})
    assert {path.id for path in two.tour.paths} == {
        "1/c1",
        "1/c2",
        *(f"2/c{k}" for k in range(1, 6)),
    }


@pytest.mark.parametrize(("post", "table", "key", "value"), [
    ("rapid", "operation", "depth", 2), ("rapid", "process", "clearance", 50), ("rapid", "tool", "orient", "follow"),
    ("gcode", "process", "stay_down", True), ("gcode", "tool", "symmetric", True),
    ("gcode", "operation", "side", "left"), ("rapid", "tolerance", "simplify", 1.0),
    ("rapid", "input", "min_length", 1.0),
])  # fmt: skip
def test_settings_without_effect_are_refused(
    post: str, table: str, key: str, value: object
) -> None:
    job: Tables = {"operation": {"kind": "trace"}}
    job[table] = job.get(table, {}) | {key: value}
    assert refused(SPACE, post, job).startswith("job: has no effect on curves in space")


def test_flat_drawings_refuse_the_settings_of_curves() -> None:
    for key, value in (("axis", "fixed"), ("angles", [180, 0, 0])):
        said = refused(PARTS / "plate.dxf", "rapid", TRACE | {"tool": {key: value}})
        assert said == f"job: has no effect on a drawing (tool.{key}); leave it out"
    job: Tables = TRACE | {"cell": {"rests_on": [0, 0, 1]}}
    error = refused(PARTS / "plate.dxf", "rapid", job)
    assert error == "job: has no effect on a drawing (cell.rests_on); leave it out"


@pytest.mark.parametrize(("tool", "what"), [
    ({"axis": "given"}, "curve c1 has no angles (tool.axis)"),
    ({"axis": "normal", "angles": [0, 0, 0]}, "has no effect on a tool that stands as normal (tool.angles)"),
    ({"angles": [180, 0]}, "has 2 values (tool.angles)"),
])  # fmt: skip
def test_what_cannot_be_meant_of_the_tool(tool: dict[str, object], what: str) -> None:
    assert what in refused(SPACE, "rapid", TRACE | {"tool": tool})


def test_only_tracing_follows_curves_in_space() -> None:
    for kind in ("follow", "fill", "drill", "edges", "replay"):
        said = refused(SEAM, "rapid", {"operation": {"kind": kind}})
        assert said.endswith(
            'these are curves in space (operation.kind); set operation.kind to "trace"'
        )
    part = camgen.read(SEAM)
    assert isinstance(part, Part)
    with pytest.raises(JobError, match="give the cell"):
        camgen.plan(part)


def test_the_command_line_says_what_is_in_space(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "build",
        str(SPACE),
        "--post",
        "rapid",
        "--set",
        "operation.kind=trace",
        "-o",
        str(tmp_path),
    ]
    for ending in ("svg", "png", "html"):
        assert main([*words, "--preview", str(tmp_path / f"a.{ending}")]) == 0
    said = capsys.readouterr().err
    assert "space.dxf: mm, 5 curves (4 in space, 1 flat)" in said
    assert "all 2 mm apart or more" in said
    assert main(["build", str(SPACE), "--post", "rapid", "-o", str(tmp_path)]) == 0
    assert "5 curves" not in capsys.readouterr().err.splitlines()[0]
