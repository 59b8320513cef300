"""Programs along the edges of 3-D parts: motions, notes and refusals."""

import itertools
import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import camgen
from camgen.cli import main
from camgen.lower.edges import _run_approach
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Comment, Force, Joints, MoveC, MoveJ, MoveL, Output, Wait
from camgen.motion.pose_paths import PosePath
from camgen.order.edges.links import PathLink
from camgen.pipeline import Result
from camgen.read.solid import mesh
from tests.support.arm_models import by_hand
from tests.support.built import build
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: The four upper edges of a plate of 60 x 40 x 10 mm in front of an IRB 120.
PLATE = {
    "input": {"select": "e1-e4"},
    "operation": {"offset": 2},
    "tool": {"axis_tilt": 10, "symmetric": True},
    "cell": {"robot": "IRB 120", "base_from_work": [300, -20, 150, 0, 0, 0]},
}
#: The edges of the plate that all arms reach.
NEAR = {"input": {"select": "e1, e4"}}


@pytest.fixture(scope="module")
def built() -> Result:
    return camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    return write_box(tmp_path / "plate.obj", (0.0, 0.0, 0.0), (60.0, 40.0, 10.0))


def write_box(file: Path, low: tuple[float, ...], high: tuple[float, ...]) -> Path:
    """Writes a box with the corners `low` and `high`, mm, as a mesh."""
    corners = itertools.product(*zip(low, high, strict=True))
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {c + 1} {b + 1}\nf {a + 1} {d + 1} {c + 1}" for a, b, c, d in faces]
    file.write_text("\n".join(lines))
    return file


def flange_to_tip(result: Result, joints: FloatArray, arm: str = "IRB 2400") -> FloatArray:
    """The TCP in the work frame by textbook matrices, (3,)."""
    base, tool = np.eye(4), np.eye(4)
    work_frame, tool_frame = result.cell.base_from_work, result.cell.flange_from_tool
    base[:3, :3], base[:3, 3] = work_frame.rotation, work_frame.origin
    tool[:3, :3], tool[:3, 3] = tool_frame.rotation, tool_frame.origin
    frame = np.linalg.inv(base) @ by_hand(arm, np.degrees(joints)) @ tool
    return np.asarray(frame[:3, 3])


def test_all_edges_of_the_first_part_of_the_paper_are_run(built: Result) -> None:
    """The paper leaves out 2 of these 15 edges."""
    assert len(built.tour.paths) == 15
    assert not [note for note in built.notes if note.kind == "skipped"]
    assert built.report["checks"] == {"reach": "ok", "collision": "partly checked", "limits": "ok"}
    untested = [["link 4", "link 6"], ["link 4", "holder"]]
    assert [pair["bodies"] for pair in built.report["untested"]] == untested


def test_the_tool_runs_along_the_edges_at_the_offset(built: Result) -> None:
    """While the process is on, the TCP keeps a distance of 2 mm from the edge."""
    edges = {edge.id: edge for edge in mesh.read(source(PARTS / "rfa1.stl")).edges}
    on, name, position, worked = False, "", np.zeros(3), set()
    for item in built.program.body:
        if isinstance(item, Comment) and item.text.startswith("edge"):
            name = item.text.split()[1]
        if isinstance(item, Output):
            on = item.value > 0
        if isinstance(item, (MoveL, MoveC)):
            start, position = position, np.array(item.target.origin)
            if on:
                worked.add(name)
                count = 20 if isinstance(item, MoveL) else 2
                points = np.linspace(start, position, count)
                offsets = distances(edges[name].points, edges[name].via, points)
                assert offsets == pytest.approx(2.0, abs=0.02)
        if isinstance(item, MoveJ) and isinstance(item.target, Joints):
            position = flange_to_tip(built, np.array(item.target.values))
    assert worked == {path.id for path in built.tour.paths}


def distances(points: FloatArray, via: FloatArray, at: FloatArray) -> FloatArray:
    """Distances of `at` from the chain through points and via points, mm. Arcs are sampled."""
    line = [points[0]]
    for a, m, b in zip(points, via, points[1:], strict=False):
        chord, middle = b - a, (a + b) / 2
        height = np.linalg.norm(m - middle)
        if height < 1e-9:
            line += [a + t * chord for t in np.linspace(0, 1, 50)[1:]]
            continue
        half = np.linalg.norm(chord) / 2
        radius = (half**2 + height**2) / (2 * height)
        across, along = (m - middle) / height, chord / (2 * half)
        centre = m - radius * across
        angle = math.atan2(half, radius - height)
        line += [
            centre + radius * (math.cos(t) * across + math.sin(t) * along)
            for t in np.linspace(-angle, angle, 400)
        ]
    rows = np.array(line)
    a, d = rows[:-1], np.diff(rows, axis=0)
    t = np.clip(((at[:, None] - a) * d).sum(axis=2) / np.maximum((d * d).sum(axis=1), 1e-12), 0, 1)
    return np.asarray(np.linalg.norm(at[:, None] - a - t[..., None] * d, axis=2).min(axis=1))


def test_the_process_is_off_between_edges_and_home_comes_first_and_last(built: Result) -> None:
    first, last = built.program.columns.moves[0], built.program.columns.moves[-1]
    assert first.target.values == last.target.values == built.cell.home.values
    on = False
    first_output, *body = built.program.body
    assert first_output == Output("process", 0.0)
    for item in body:
        if isinstance(item, Output):
            assert item.value != on
            on = bool(item.value)
        if isinstance(item, MoveJ):
            assert not on


def test_the_approach_slows_down_before_the_part(built: Result) -> None:
    body = built.program.body
    starts = [k for k, item in enumerate(body) if isinstance(item, Output) and item.value]
    slow = [
        body[k - 1]
        for k in starts
        if isinstance(body[k - 1], MoveL) and isinstance(body[k - 2], MoveL)
    ]
    assert slow
    # The plunge has a third of the feed. An approach along an arc has the speed of links.
    assert {item.speed for item in slow} <= {20.0 / 3, 100.0}
    assert any(item.speed == 20.0 / 3 for item in slow)


def test_an_approach_with_a_short_last_piece_keeps_its_other_pieces() -> None:
    position = np.array([[30.0, 0, 50], [0, 0, 50], [0, 0, 1], [0, 0, 0]])
    rotations = np.broadcast_to(np.diag([1.0, -1, -1]), (4, 3, 3))
    pose_path = PosePath(position, np.full((4, 3), np.nan), rotations)
    piece = PathLink(pose_path, np.zeros((4, 6)), np.array([700.0, 400, 90]), "approach")
    lines = [item for item in _run_approach(piece, Job().process) if isinstance(item, MoveL)]
    assert [(item.target.origin, item.speed) for item in lines] == [
        ((0, 0, 50), 700),
        ((0, 0, 1), 400),
        ((0, 0, 0), pytest.approx(20 / 3)),
    ]


@pytest.mark.parametrize(
    "process", [{"switch": "air"}, {"switch": "air", "plunge": 4.0, "dwell": 0.5}]
)
def test_a_rotating_tool_is_switched_away_from_the_part(
    plate: Path, process: dict[str, object]
) -> None:
    result = build(plate, post="rapid", job={**PLATE, "process": process})
    first_output, *body = result.program.body
    assert first_output == Output("process", 0.0)
    on, position, switched, last = False, np.zeros(3), 0, body[0]
    for k, item in enumerate(body):
        if isinstance(item, Output):
            assert item.value != on
            on, switched = bool(item.value), switched + 1
            # The plate is a box of 60 x 40 x 10 mm, and the approach is 2 mm.
            outside = np.maximum(np.maximum(-position, position - (60, 40, 10)), 0)
            assert np.linalg.norm(outside) > 2.0
            assert isinstance(body[k + 1], Wait) == bool(on and "dwell" in process)
        elif isinstance(item, MoveJ):
            assert not on
            position = flange_to_tip(result, np.array(item.target.values), "IRB 120")
        elif isinstance(item, (MoveL, MoveC)):
            assert item.work <= on
            if item.work and not last.work:
                assert last.speed == process.get("plunge", 20.0 / 3)
            position = np.array(item.target.origin)
        last = item if isinstance(item, (MoveJ, MoveL, MoveC)) else last
    assert not on
    assert switched >= 2


def test_a_tool_under_force_is_switched_in_the_air(plate: Path) -> None:
    """The order is process on, approach, force on, edge, force off, retract, process off."""
    job = {**PLATE, **NEAR, "process": {"force": 5.0}, "post": {"force": "template"}}
    job["cell"] = {"robot": "VS-6556", "base_from_work": [320, -20, 150, 0, 0, 0]}
    result = build(plate, post="pacscript", job=job)
    assert result.program.body[:2] == (Output("process", 0.0), Force(0.0))
    on = pressing = False
    before = edges = 0
    for item in result.program.body[2:]:
        if isinstance(item, Output):
            assert not pressing
            assert not getattr(before, "work", True), "switched on the part"
            on = bool(item.value)
        elif isinstance(item, Force):
            assert on
            pressing = item.newtons == 5.0
            edges += pressing
        elif isinstance(item, (MoveL, MoveC)):
            assert item.work == pressing == (item.force == 5.0)
        before = item
    assert edges == len(result.tour.paths) > 0


def test_two_builds_of_a_job_print_the_same_text(built: Result) -> None:
    again = camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")
    assert again.text == built.text


@pytest.mark.parametrize(
    ("post", "arm"), [("pacscript", "VS-6556"), ("vplus", "Viper s650"), ("rapid", "IRB 120")]
)
def test_a_plate_is_built_for_other_arms_and_controllers(plate: Path, post: str, arm: str) -> None:
    cell = {"robot": arm, "base_from_work": [320, -20, 150, 0, 0, 0]}
    result = build(plate, post=post, job={**PLATE, **NEAR, "cell": cell})
    assert {path.id for path in result.tour.paths} == {"e1", "e4"}
    kinds = {type(item.target) for item in result.program.columns.moves}
    assert kinds == {Joints, Pose}


def test_a_step_file_gives_the_program_of_its_mesh() -> None:
    pytest.importorskip("OCP", reason="the extra step is not installed")
    job = PARTS / "rfa1.toml"
    exact = camgen.build(PARTS / "rfa1.step", post="rapid", job=job)
    assert len(exact.tour.paths) == 15


# Notes and reports


def test_an_unreachable_edge_is_left_out_with_its_reason(plate: Path) -> None:
    job = {**PLATE, "input": {"select": "all"}}
    result = build(plate, post="rapid", job=job)
    skipped = [note for note in result.notes if note.kind == "skipped"]
    assert len(skipped) + len(result.tour.paths) == 12
    assert skipped
    assert all(note.what.startswith("edge e") and note.why for note in skipped)
    assert any("table" in note.why for note in skipped)
    assert any(note.what == "the part stands on a table" for note in result.notes)
    nominal = build(plate, post="rapid", job={**job, "tool": {}})
    reasons = [note.why for note in nominal.notes if note.kind == "skipped"]
    unreachable = [why for why in reasons if " reaches " in why or "camgen place" in why]
    assert len(unreachable) >= min(len(reasons), 8)


def test_the_command_line_builds_and_reports(
    plate: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    sets = [
        "--set=input.select=e1-e4",
        "--set=operation.offset=2",
        "--set=cell.base_from_work=[300, -20, 150, 0, 0, 0]",
        "--set=tool.axis_tilt=10",
        "--set=tool.symmetric=true",
    ]
    assert main(["build", str(plate), "--post", "rapid", "--report", "r.json", *sets]) == 0
    notes = capsys.readouterr().err
    assert "IRB 120 reaches all of it" in notes
    assert "not proven: link 4 against link 6; the others do not meet, all but the tool at" in notes
    assert "no collision" not in notes
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["input"]["edges"] == 12
    assert report["checks"]["collision"] == "partly checked"
    assert {path["id"] for path in report["paths"]} <= {"e1", "e2", "e3", "e4"}


def test_strict_refuses_a_program_that_leaves_out_an_edge(plate: Path) -> None:
    with pytest.raises(NoSafeProgram, match="--strict and"):
        camgen.build(plate, post="rapid", job={**PLATE, "input": {"select": "all"}}, strict=True)


# Refusals


@pytest.mark.parametrize(
    ("table", "values", "message"),
    [
        ("operation", {"kind": "trace"}, '"trace" is for flat parts'),
        (
            "process",
            {"retract": 9},
            r"has no effect on a 3-D part .process\.retract.; leave it out",
        ),
        ("tour", {"method": "as-drawn"}, "have no drawn order"),
        ("input", {"select": "not all"}, "picks no edge; the part has 12 edges"),
        ("input", {"select": "e99"}, "has no edge e99"),
        ("cell", {"fixtures": [[0, 0, 0, 1, 1]]}, "a box has 5 values"),
        ("cell", {"fixtures": [[0, 0, 0, 1, 1, 0]]}, "a box has no size"),
        ("tool", {"holder": [[0, 0, 0, 30, 30]]}, "a box has 5 values"),
        ("cell", {"flange_from_tool": [0, 0, 100, 180, 0, 0]}, "meets neither holder nor flange"),
    ],
)
def test_settings_that_contradict_the_part_are_refused(
    plate: Path, table: str, values: dict[str, object], message: str
) -> None:
    job = {**PLATE, table: {**PLATE.get(table, {}), **values}}
    with pytest.raises(JobError, match=message):
        build(plate, post="rapid", job=job)


def test_a_machine_without_joints_is_refused(plate: Path) -> None:
    with pytest.raises(JobError, match="need an arm"):
        build(plate, post="gcode", job={"operation": {"kind": "edges"}})


def test_a_part_out_of_reach_has_no_program(plate: Path) -> None:
    job = {**PLATE, "cell": {"robot": "IRB 120", "base_from_work": [3000, 0, 0, 0, 0, 0]}}
    with pytest.raises(
        NoSafeProgram, match=r"none of 4 edges can be processed: e1 .out of reach by"
    ):
        build(plate, post="rapid", job=job)


def test_a_home_in_the_part_is_refused(plate: Path) -> None:
    home = build(plate, post="rapid", job=PLATE).cell.home
    assert isinstance(home, Joints)
    # At home the flange points down by 30 deg, and the tip is 100 mm from it. The part is there.
    frame = by_hand("IRB 120", np.degrees(home.values))
    x, y, z = (frame @ np.array([0, 0, 90.0, 1]))[:3]
    job = {
        **PLATE,
        "cell": {"robot": "IRB 120", "base_from_work": [x - 30, y - 20, z - 5, 0, 0, 0]},
    }
    message = r"home collides: tool against (part|table), [\d.]+ mm deep, at joints [-\d. ]+ deg"
    with pytest.raises(NoSafeProgram, match=message):
        build(plate, post="rapid", job=job)


def test_a_part_without_edges_is_refused(tmp_path: Path) -> None:
    """The triangles of a ball meet at less than the feature angle."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=30)
    ball.export(tmp_path / "ball.stl")
    with pytest.raises(InputError, match=r"ball\.stl: has no sharp edges"):
        camgen.build(tmp_path / "ball.stl", post="rapid", job=PLATE)


def test_two_parts_in_one_program_are_refused(plate: Path) -> None:
    with pytest.raises(InputError, match="a 3-D part makes a program by itself"):
        camgen.build([plate, PARTS / "bracket.dxf"], post="rapid", job=PLATE)


# Cells


def test_a_fixture_that_is_a_mesh_blocks_the_edges_of_its_box(plate: Path, tmp_path: Path) -> None:
    """A wall beside the plate is once a box and once a mesh."""
    low, high = (20.0, -25.0, 0.0), (40.0, -4.0, 30.0)
    skipped = []
    for wall in ([*low, *high], str(write_box(tmp_path / "wall.obj", low, high))):
        result = build_with_fixtures(plate, PLATE, [wall])
        skipped.append([note for note in result.notes if note.kind == "skipped"])
    box, mesh = skipped
    assert [note.ids for note in box] == [note.ids for note in mesh] == [("e1",)]
    # The end of a piece is found to half a millimetre.
    assert box[0].length == pytest.approx(mesh[0].length, abs=0.5)
    assert all("tool against fixture 1" in note.why for note in box + mesh)


def build_with_fixtures(plate: Path, job: dict[str, Any], fixtures: list[object]) -> Result:
    cell = {**job["cell"], "fixtures": fixtures}
    return camgen.build(plate, post="rapid", job={**job, "cell": cell})


def test_a_cell_may_be_in_a_file(plate: Path, tmp_path: Path) -> None:
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / "cell.toml").write_text(
        '[cell]\nrobot = "IRB 120"\nbase_from_work = [300, -20, 150, 0, 0, 0]\nsafety = 99\n'
    )
    job = tmp_path / "plate.toml"
    begin = '[input]\nselect = "e1-e4"\n[operation]\noffset = 2\n'
    job.write_text(f'{begin}[cell]\nfile = "cells/cell.toml"\nsafety = 12\n')
    result = camgen.build(plate, post="rapid", job=job)
    assert (result.job.cell.robot, result.job.cell.safety) == ("IRB 120", 12)
    whole = tmp_path / "whole.toml"
    whole.write_text(
        f'{begin}[cell]\nrobot = "IRB 120"\n'
        "base_from_work = [300, -20, 150, 0, 0, 0]\nsafety = 12\n"
    )
    assert camgen.build(plate, post="rapid", job=whole).text == result.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[tool]\ndiameter = 3\n", r"is the file of a cell, but has \[tool\]"),
        ('[cell]\nfile = "other.toml"\n', "names a file itself"),
        ("[cell]\nrobots = 3\n", "unknown key"),
        (None, "cannot be read: No such file"),
    ],
)
def test_an_invalid_file_of_a_cell_is_refused(
    plate: Path, tmp_path: Path, text: str | None, message: str
) -> None:
    file = tmp_path / "cell.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(JobError, match=message):
        build(plate, post="rapid", job={"cell": {"file": str(file)}})


def test_an_obstacle_between_two_samples_divides_its_edge(plate: Path) -> None:
    """A sheet of 0.2 mm crosses an edge, 2.3 mm from the nearest sample of a tool of 1 mm."""
    job = {**PLATE, "tool": {"diameter": 1.0}}
    sheet = [27.3, -10.0, 5.0, 27.5, -0.5, 40.0]
    for fixtures, names in (([], {"e1"}), ([sheet], {"e1.1", "e1.2"})):
        result = build_with_fixtures(plate, job, fixtures)
        assert {p.id for p in result.tour.paths if p.contours == ("e1",)} == names
        assert result.report["checks"]["collision"] == "partly checked"
    ends = [p.position[[0, -1], 0] for p in result.tour.paths if p.contours == ("e1",)]
    # Tool and sheet together are 1.2 mm wide, and the margin is 2 mm. Ends are found to 0.5 mm.
    (_, before), (after, _) = sorted(tuple(sorted(pair.tolist())) for pair in ends)
    assert 24.3 <= before <= 24.8 + 1e-9
    assert 30.0 - 1e-9 <= after <= 30.5
    places = []
    for note in result.notes:
        reason = r"collision, tool against fixture 1, (.*) mm along it(; .*)?"
        match = re.fullmatch(reason, note.why) if note.kind == "skipped" else None
        if match:
            places.append(float(match[1]))
    (place,) = places
    assert 26.8 <= place <= 28.0


def test_an_edge_on_which_the_feed_factor_slows_the_tool_has_a_note() -> None:
    """The TCP is 2 mm from a quarter of a rim at 45 deg, so its circle is larger by 1.4 mm."""
    job = PARTS.parent / "cases" / "rfa1-edges" / "job.toml"
    settings = tomllib.loads(job.read_text())
    settings["process"] |= {"max_feed_factor": 1.0, "force": 0.0}
    result = camgen.build(PARTS / "rfa1.stl", post="rapid", job=settings)
    rim = next(edge for edge in result.part.solid.edges if edge.id == "e4")
    radius = rim.length / (np.pi / 2)  # a quarter of a circle, 25 mm
    speed = 20.0 * radius / (radius + 2 * np.sin(np.pi / 4))
    note = next(note for note in result.notes if "slower than process.feed" in note.what)
    assert note.ids == ("e4",)
    assert f"the contact point runs at {speed:.1f} of 20 mm/s on e4" in note.what
