"""Curves in space as programs for three axes and for arms, and settings that are refused.

The tool of an arm is fixed, has the angles of the file, or is perpendicular to a face.
"""

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
from tests.order.test_rfa import make_matrix
from tests.support.arm_models import by_hand

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
SPACE, SEAM = PARTS / "space.dxf", PARTS / "seam.xyz"
TRACE = {"operation": {"kind": "trace"}}
Tables = dict[str, dict[str, object]]


def write_points(folder: Path, text: str) -> Path:
    file = folder / "a.xyz"
    file.write_text(text)
    return file


def list_work(result: Result) -> list[MoveL | MoveC]:
    """The motions along the curves."""
    moves = result.program.columns.moves
    return [move for move in moves if isinstance(move, (MoveL, MoveC)) and move.work]


def list_ends(result: Result) -> FloatArray:
    return np.array(
        [move.target.origin for move in list_work(result) if isinstance(move.target, Pose)]
    )


def list_rotations(result: Result) -> FloatArray:
    return np.array(
        [move.target.rotation for move in list_work(result) if isinstance(move.target, Pose)]
    )


def find_refusal(
    part: Path | list[Path], post: str, job: Tables, kind: type[CamgenError] = JobError
) -> str:
    with pytest.raises(kind) as caught:
        camgen.build(part, post=post, job=job)
    return str(caught.value)


# Three axes.


def test_a_mill_follows_a_curve_point_by_point_and_travels_above_it(tmp_path: Path) -> None:
    rows = [[0, 0, 2], [30, 0, 2], [50, 10, 9], [70, 0, -4]]
    file = write_points(tmp_path, "\n".join(",".join(map(str, row)) for row in rows))
    result = camgen.build(file, post="gcode", job={"tour": {"method": "as-drawn"}})
    assert list_ends(result).tolist() == rows[1:]
    assert (list_rotations(result) == np.diag([1, -1, -1])).all()
    rapids = [m.target for m in result.program.columns.moves if isinstance(m, MoveJ)]
    heights = {target.origin[2] for target in rapids if isinstance(target, Pose)}
    assert {z for z in heights if z < 30 and z != 4} == {20}
    lines = [
        line
        for line in result.text.splitlines()
        if "G1" in line or line.startswith(("X", "Y", "Z"))
    ]
    assert any("Z-4" in line for line in lines)


def test_a_mill_runs_a_flat_arc_as_an_arc_and_an_upright_arc_as_chords() -> None:
    result = camgen.build(SPACE, post="gcode", job=TRACE)
    assert sum(isinstance(move, MoveC) for move in list_work(result)) == 2
    upright = np.array(
        [end for end in list_ends(result) if abs(end[1] - 25) < 1e-9 and end[0] >= 10]
    )
    assert np.hypot(upright[:, 0] - 20, upright[:, 2] - 3) == pytest.approx(10, abs=1e-6)
    middles = (upright[1:] + upright[:-1]) / 2 - (20, 25, 3)
    assert np.hypot(*middles[:, [0, 2]].T).min() >= 10 - 0.0101


def test_depth_and_passes_go_below_the_curve() -> None:
    job: Tables = {
        "operation": {"kind": "trace", "depth": 3, "passes": 2},
        "process": {"spindle": 9000},
    }
    plain, deep = (camgen.build(SPACE, post="grbl", job=tables) for tables in (TRACE, job))
    assert len(list_ends(deep)) == 2 * len(list_ends(plain))
    assert list_ends(deep)[:, 2].min() == pytest.approx(list_ends(plain)[:, 2].min() - 3)


def test_a_clearance_height_below_the_top_of_the_curves_is_refused(tmp_path: Path) -> None:
    file = write_points(tmp_path, "0,0,0\n9,0,30.5")
    message = find_refusal(file, "gcode", {})
    assert message.endswith("reach up to z = 30.5 (process.clearance); set it to 33 or more")
    assert camgen.build(file, post="gcode", job={"process": {"clearance": 33}}).tour.paths


def test_a_curve_with_a_tilted_tool_is_refused_for_a_mill(tmp_path: Path) -> None:
    file = write_points(tmp_path, "0 0 0 180 0 90\n9 0 5 180 0 -90")
    assert camgen.build(file, post="gcode").tour.paths  # a roll about the spindle is allowed
    assert "keeps its tool straight down, curve c1 leans it by 15 deg" in find_refusal(
        SEAM, "gcode", {}
    )
    assert camgen.build(SEAM, post="gcode", job={"tool": {"axis": "fixed"}}).tour.paths
    assert "leans it by 10 deg" in find_refusal(
        SPACE, "gcode", TRACE | {"tool": {"angles": [170, 0, 0]}}
    )
    assert '"normal" needs an arm' in find_refusal(
        SPACE, "gcode", TRACE | {"tool": {"axis": "normal"}}
    )


def test_a_force_on_a_mill_is_refused_by_its_post() -> None:
    assert "force" in find_refusal(SPACE, "gcode", TRACE | {"process": {"force": 5}}, NoSafeProgram)


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


def test_a_fixed_tool_has_its_angles_and_the_joint_values_agree() -> None:
    job = TRACE | {"tool": {"angles": [165, 10, 30], "symmetric": False}}
    result = camgen.build(SPACE, post="rapid", job=job)
    a, b, c = np.radians([165, 10, 30])
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    assert list_rotations(result) == pytest.approx(
        np.broadcast_to(about_z @ about_y @ about_x, (len(list_work(result)), 3, 3))
    )
    base, tool = (
        make_matrix(result.program.base_from_work),
        make_matrix(result.program.flange_from_tool),
    )
    compared = 0
    for move in list_work(result):
        if move.joints is not None and isinstance(move.target, Pose):
            flange = by_hand("IRB 120", np.degrees(move.joints.values))
            assert np.linalg.inv(base) @ flange @ tool == pytest.approx(
                make_matrix(move.target), abs=1e-6
            )
            compared += 1
    assert compared > 50


def test_the_tool_has_the_angles_of_the_points(tmp_path: Path) -> None:
    rows = [
        (0, 0, 5, 180, 0, 0),
        (40, 0, 9, 170, 0, 0),
        (40, 0, 9, 170, 12, 0),
        (80, 20, 5, 180, 12, 0),
    ]
    file = write_points(tmp_path, "\n".join(" ".join(map(str, row)) for row in rows))
    result = camgen.build(file, post="rapid")
    forward = list_ends(result)[-1].tolist() == [80, 20, 5]
    wanted = rows[1:] if forward else rows[-2::-1]
    assert list_ends(result).tolist() == [list(row[:3]) for row in wanted]
    for rotation, row in zip(list_rotations(result), wanted, strict=True):
        a, b = np.radians(row[3:5])
        axis = [math.sin(b) * math.cos(a), -math.sin(a), math.cos(b) * math.cos(a)]
        assert rotation[:, 2] == pytest.approx(axis)
    # The second motion is a reorientation, and the arm stops for it.
    assert [move.blend for move in list_work(result)] == [0, 0, 0]


def test_a_smooth_curve_is_run_without_stops_and_a_corner_with_a_stop(tmp_path: Path) -> None:
    t = np.linspace(0, math.pi, 61)
    rows = np.column_stack([40 * np.cos(t) + 40, 40 * np.sin(t), 10 * np.sin(2 * t) + 12])
    smooth = write_points(tmp_path, "\n".join(f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in rows))
    job: Tables = {"tolerance": {"chord": 0.05}}
    moves = list_work(camgen.build(smooth, post="rapid", job=job))
    assert sum(move.blend > 0 for move in moves) == len(moves) - 1
    corner = write_points(tmp_path, "0 0 5\n40 0 9\n40 40 5")
    assert [move.blend for move in list_work(camgen.build(corner, post="rapid", job=job))] == [0, 0]


def test_a_force_has_the_direction_of_the_tool_axis() -> None:
    job = TRACE | {
        "process": {"force": 7},
        "tool": {"angles": [170, 0, 0]},
        "post": {"force_load": "lTool"},
    }
    result = camgen.build(SPACE, post="rapid", job=job)
    axis = (0, -math.sin(math.radians(170)), math.cos(math.radians(170)))
    assert {item.newtons for item in result.program.columns.list_kinds(Force)} == {0, 7}
    assert all(move.force == 7 for move in list_work(result))
    assert np.array([move.force_direction for move in list_work(result)]) == pytest.approx(
        np.tile(axis, (len(list_work(result)), 1))
    )


def test_approach_and_retract_run_along_the_tool_axis_to_above_all_curves(tmp_path: Path) -> None:
    file = write_points(tmp_path, "0 0 5 165 0 0\n60 0 25 165 0 0")
    result = camgen.build(file, post="rapid")
    moves = [m for m in result.program.columns.list_kinds(MoveL) if isinstance(m.target, Pose)]
    targets = np.array([m.target.origin for m in moves])
    start = next(k for k, move in enumerate(moves) if move.work) - 1
    axis = np.array([0, -math.sin(math.radians(165)), math.cos(math.radians(165))])
    for high, low in ((targets[start - 1], targets[start]), (targets[-1], targets[-2])):
        direction = (high - low) / np.linalg.norm(high - low)
        assert direction == pytest.approx(-axis, abs=1e-9)
    # The safety level is half the width of the tool and cell.safety above the highest point.
    assert targets[-1][2] == pytest.approx(25 + 3 + 10)


def test_a_tilted_tool_is_refused_for_a_scara_arm() -> None:
    assert "cannot lean its tool by 15 deg" in find_refusal(SEAM, "vplus", {}, NoSafeProgram)


def test_pieces_out_of_reach_or_with_a_collision_are_left_out_and_the_rest_is_run(
    tmp_path: Path,
) -> None:
    file = write_points(tmp_path, "0 0 5\n60 0 9\n\n0 40 5\n2000 40 5\n\n0 80 5\n60 80 9")
    result = camgen.build(
        file, post="rapid", job={"cell": {"fixtures": [[20, 70, -10, 40, 90, 40]]}}
    )
    left = {note.ids[0]: str(note) for note in result.notes if note.kind == "skipped"}
    assert set(left) == {"c2", "c3"}
    # The line of 2000 mm is run as far as the arm reaches.
    assert re.match(r"skipped: 17[0-9]{2}\.?[0-9]* mm of curve c2 \(out of reach", left["c2"])
    assert "fixture 1" in left["c3"]
    assert {path.id for path in result.tour.paths} == {"c1", "c2.1", "c3.1", "c3.2"}
    assert result.clear is not None
    with pytest.raises(NoSafeProgram, match="--strict"):
        camgen.build(file, post="rapid", strict=True)


def test_a_rotation_without_a_certain_direction_is_refused(tmp_path: Path) -> None:
    file = write_points(tmp_path, "0 0 5 180 0 0\n60 0 9 180 0 175\n")
    reason = (
        "the tool turns by 175 deg from point 1 to the next, too far to know in which direction"
    )
    assert reason in find_refusal(file, "rapid", {}, NoSafeProgram)


# Perpendicular to the faces of a part.


def write_cylinder(folder: Path, offset: float = 0.0) -> list[Path]:
    """Files of a piece of a helix and of the cylinder around which it runs.

    The cylinder has a radius of 40 mm, and its axis is parallel to x at y = 60 and z = -20 mm.
    offset: distance of the helix from the cylinder, mm.
    """
    mesh = trimesh.creation.cylinder(40, 120, sections=72)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0, 1, 0)))
    mesh.apply_translation((60, 60, -20))
    mesh.export(folder / "pipe.stl")
    t = np.linspace(-0.6, 0.6, 25)
    radius = 40 + offset
    rows = np.column_stack([60 + 20 * t, 60 + radius * np.sin(t), -20 + radius * np.cos(t)])
    text = "\n".join(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in rows)
    return [write_points(folder, text), folder / "pipe.stl"]


NORMAL: Tables = {
    "tool": {"axis": "normal", "symmetric": True, "diameter": 2},
    "process": {"feed": 10},
    "cell": {"fixtures": []},
    "input": {"units": "mm"},
}


def measure_tilt(points: FloatArray, axes: FloatArray) -> FloatArray:
    """Angle between tool axes (N, 3) and the normals of the cylinder at points (N, 3), deg (N,)."""
    out = (points - (0, 60, -20)) * (0, 1, 1)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return np.asarray(np.degrees(np.arccos(np.clip(-(axes * out).sum(axis=1), -1, 1))))


def test_the_tool_is_perpendicular_to_the_nearest_face(tmp_path: Path) -> None:
    result = camgen.build(write_cylinder(tmp_path, 0.5), post="rapid", job=NORMAL)
    assert [path.id for path in result.tour.paths] == ["c1"]
    points, axes = list_ends(result), list_rotations(result)[:, :, 2]
    assert len(points) >= 24
    assert measure_tilt(points, axes).max() < 0.5
    assert measure_tilt((points[1:] + points[:-1]) / 2, axes[1:] + axes[:-1]).max() < 1
    assert result.clear is not None
    (note,) = [note for note in result.notes if "off pipe.stl" in note.what]
    # The cylinder has flats of 5 deg, which lie up to 40 (1 - cos 2.5 deg) mm inside of it.
    distance = float(note.what.split()[4])
    assert 0.5 <= distance <= 0.5 + 40 * (1 - math.cos(math.radians(2.5))) + 1e-3


def test_a_long_line_over_a_curved_face_gets_more_waypoints_for_the_tool_axis(
    tmp_path: Path,
) -> None:
    write_cylinder(tmp_path)
    file = write_points(tmp_path, "30 30 25\n90 90 25")
    result = camgen.build([file, tmp_path / "pipe.stl"], post="rapid", job=NORMAL)
    start = result.tour.paths[0].position[:1]
    assert len(list_work(result)) > 3
    points = np.concatenate([start, list_ends(result)])
    along = np.array([1, 1, 0]) / math.sqrt(2)
    assert np.linalg.norm(np.cross(points - (30, 30, 25), along), axis=1) == pytest.approx(
        0, abs=1e-9
    )
    axes = np.concatenate([result.tour.paths[0].axis[:1], list_rotations(result)[:, :, 2]])
    # The line is up to 54 mm from the axis of the cylinder. The nearest point may be the corner of
    # two flats, which changes the direction by up to 2.5 (1 - 40 / 54) deg.
    assert measure_tilt(points, axes).max() < 0.66
    assert measure_tilt((points[1:] + points[:-1]) / 2, axes[1:] + axes[:-1]).max() < 0.66 + 0.5


def test_a_curve_over_a_sharp_edge_is_left_out(tmp_path: Path) -> None:
    trimesh.creation.box((60, 60, 20)).export(tmp_path / "box.stl")
    file = write_points(tmp_path, "0 0 10.5\n30.5 0 10.5\n30.5 0 0\n\n-20 0 10.5\n20 0 10.5")
    result = camgen.build([file, tmp_path / "box.stl"], post="rapid", job=NORMAL)
    (left,) = [note for note in result.notes if note.kind == "skipped"]
    assert left.ids == ("c1",)
    assert "the nearest face changes its direction by 90 deg at 30.5 0 " in left.why
    assert (list_rotations(result)[:, :, 2] == [0, 0, -1]).all()


def test_a_curve_through_the_given_part_is_left_out(tmp_path: Path) -> None:
    box = trimesh.creation.box((60, 20, 20))
    box.apply_translation((30, 10, 10))
    box.export(tmp_path / "box.stl")
    file = write_points(tmp_path, "0 10 10\n60 10 10\n\n0 10 30\n60 10 30")
    result = camgen.build(
        [file, tmp_path / "box.stl"], post="rapid", job={"input": {"units": "mm"}}
    )
    assert [path.id for path in result.tour.paths] == ["c2"]
    (left,) = [note for note in result.notes if note.kind == "skipped"]
    assert "part" in left.why


def test_curves_of_two_files_can_be_combined_and_other_parts_are_refused() -> None:
    box = PARTS / "rfa1.stl"
    assert '"normal" needs the part on whose faces the curves lie' in find_refusal(
        SEAM, "rapid", {"tool": {"axis": "normal"}}
    )
    assert "not tested against a part" in find_refusal(
        [SEAM, box], "gcode", {"tool": {"axis": "fixed"}}
    )
    assert "or with one 3-D part" in find_refusal(
        [SEAM, PARTS / "plate.dxf"], "rapid", {}, InputError
    )
    two = camgen.build([SEAM, SPACE], post="rapid", job=TRACE | {"tool": {"symmetric": True}})
    assert {path.id for path in two.tour.paths} == {
        "1/c1",
        "1/c2",
        *(f"2/c{k}" for k in range(1, 6)),
    }


@pytest.mark.parametrize(("post", "table", "key", "value"), [
    ("rapid", "operation", "depth", 2), ("rapid", "process", "clearance", 50),
    ("rapid", "tool", "orient", "follow"),
    ("gcode", "process", "stay_down", True), ("gcode", "tool", "symmetric", True),
    ("gcode", "operation", "side", "left"), ("rapid", "tolerance", "simplify", 1.0),
    ("rapid", "input", "min_length", 1.0),
])  # fmt: skip
def test_settings_without_effect_are_refused(
    post: str, table: str, key: str, value: object
) -> None:
    job: Tables = {"operation": {"kind": "trace"}}
    job[table] = job.get(table, {}) | {key: value}
    assert find_refusal(SPACE, post, job).startswith("job: has no effect on curves in space")


def test_flat_drawings_refuse_the_settings_of_curves() -> None:
    for table, key, value in (
        ("tool", "axis", "fixed"),
        ("tool", "angles", [180, 0, 0]),
        ("cell", "rests_on", [0, 0, 1]),
    ):
        message = find_refusal(PARTS / "plate.dxf", "rapid", TRACE | {table: {key: value}})
        assert message == f"job: has no effect on a drawing ({table}.{key}); leave it out"


@pytest.mark.parametrize(
    ("tool", "what"),
    [
        ({"axis": "given"}, "curve c1 has no angles (tool.axis)"),
        (
            {"axis": "normal", "angles": [0, 0, 0]},
            "has no effect on a tool that stands as normal (tool.angles)",
        ),
        ({"angles": [180, 0]}, "has 2 values (tool.angles)"),
    ],
)
def test_an_impossible_direction_of_the_tool_is_refused(tool: dict[str, object], what: str) -> None:
    assert what in find_refusal(SPACE, "rapid", TRACE | {"tool": tool})


def test_only_tracing_follows_curves_in_space() -> None:
    for kind in ("follow", "fill", "drill", "edges", "replay"):
        message = find_refusal(SEAM, "rapid", {"operation": {"kind": kind}})
        assert message.endswith(
            'these are curves in space (operation.kind); set operation.kind to "trace"'
        )
    part = camgen.read(SEAM)
    assert isinstance(part, Part)
    with pytest.raises(JobError, match="give the cell"):
        camgen.plan(part)


def test_the_command_line_reports_the_curves_in_space(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["build", str(SPACE), "--post", "rapid", "-o", str(tmp_path)]
    trace = ["--set", "operation.kind=trace"]
    for ending in ("svg", "png", "html"):
        assert main([*command, *trace, "--preview", str(tmp_path / f"a.{ending}")]) == 0
    output = capsys.readouterr().err
    assert "space.dxf: mm, 5 curves (4 in space, 1 flat)" in output
    assert "all 2 mm apart or more" in output
    assert main(command) == 0
    assert "5 curves" not in capsys.readouterr().err.splitlines()[0]
