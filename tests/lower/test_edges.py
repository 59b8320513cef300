"""From a 3-D part to a program: what is built, what is said, what is refused."""

import json
import math
import re
import tomllib
from pathlib import Path

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
#: A plate of 60 x 40 x 10 mm before an IRB 120, its four upper edges.
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
    corners = np.array([(x, y, z) for x in (0, 60) for y in (0, 40) for z in (0, 10)], dtype=float)
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {c + 1} {b + 1}\nf {a + 1} {d + 1} {c + 1}" for a, b, c, d in faces]
    file = tmp_path / "plate.obj"
    file.write_text("\n".join(lines))
    return file


def flange_to_tip(result: Result, joints: FloatArray, arm: str = "IRB 2400") -> FloatArray:
    """The TCP in the work frame by textbook matrices, (3,)."""
    base, tool = (np.eye(4) for _ in range(2))
    base[:3, :3], base[:3, 3] = (
        result.cell.base_from_work.rotation,
        result.cell.base_from_work.origin,
    )
    tool[:3, :3], tool[:3, 3] = (
        result.cell.flange_from_tool.rotation,
        result.cell.flange_from_tool.origin,
    )
    frame = np.linalg.inv(base) @ by_hand(arm, np.degrees(joints)) @ tool
    return np.asarray(frame[:3, 3])


def test_all_edges_of_the_papers_first_part_are_run(built: Result) -> None:
    """The paper leaves 2 of these 15 out."""
    assert len(built.tour.paths) == 15
    assert not [note for note in built.notes if note.kind == "skipped"]
    assert built.report["checks"] == {"reach": "ok", "collision": "partly checked", "limits": "ok"}
    untested = [["link 4", "link 6"], ["link 4", "holder"]]
    assert [pair["bodies"] for pair in built.report["untested"]] == untested


def test_the_tool_runs_along_the_edges_at_the_offset(built: Result) -> None:
    """Between process on and off the TCP keeps 2 mm from its edge, all the way from one end to the other."""
    edges = {edge.id: edge for edge in mesh.read(source(PARTS / "rfa1.stl")).edges}
    on, name, here, seen = False, "", np.zeros(3), set()
    for item in built.program.body:
        if isinstance(item, Comment) and item.text.startswith("edge"):
            name = item.text.split()[1]
        if isinstance(item, Output):
            on = item.value > 0
        if isinstance(item, (MoveL, MoveC)):
            start, here = here, np.array(item.target.origin)
            if on:
                seen.add(name)
                points = (
                    np.linspace(start, here, 20)
                    if isinstance(item, MoveL)
                    else np.stack([start, here])
                )
                assert distances(edges[name].points, edges[name].via, points) == pytest.approx(
                    2.0, abs=0.02
                )
        if isinstance(item, MoveJ) and isinstance(item.target, Joints):
            here = flange_to_tip(built, np.array(item.target.values))
    assert seen == {path.id for path in built.tour.paths}


def distances(points: FloatArray, via: FloatArray, at: FloatArray) -> FloatArray:
    """From each of ``at`` to the polyline through points and vias, arcs cut finely."""
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
    off, *body = built.program.body
    assert off == Output("process", 0.0)
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
    # The last millimetres are run at a third of the feed; an approach along an arc at the speed of travel.
    assert {item.speed for item in slow} <= {20.0 / 3, 100.0}
    assert any(item.speed == 20.0 / 3 for item in slow)


def test_an_approach_with_a_short_last_piece_keeps_the_others() -> None:
    position = np.array([[30.0, 0, 50], [0, 0, 50], [0, 0, 1], [0, 0, 0]])
    way = PosePath(
        position, np.full((4, 3), np.nan), np.broadcast_to(np.diag([1.0, -1, -1]), (4, 3, 3))
    )
    piece = PathLink(way, np.zeros((4, 6)), np.array([700.0, 400, 90]), "approach")
    found = [
        (item.target.origin, item.speed)
        for item in _run_approach(piece, Job().process)
        if isinstance(item, MoveL)
    ]
    assert found == [((0, 0, 50), 700), ((0, 0, 1), 400), ((0, 0, 0), pytest.approx(20 / 3))]


@pytest.mark.parametrize(
    "process", [{"switch": "air"}, {"switch": "air", "plunge": 4.0, "dwell": 0.5}]
)
def test_a_tool_that_turns_is_on_before_it_comes_to_the_part_and_until_it_has_left(
    plate: Path, process: dict[str, object]
) -> None:
    result = build(plate, post="rapid", job={**PLATE, "process": process})
    off, *body = result.program.body
    assert off == Output("process", 0.0)
    on, here, switched, last = False, np.zeros(3), 0, body[0]
    for k, item in enumerate(body):
        if isinstance(item, Output):
            assert item.value != on
            on, switched = bool(item.value), switched + 1
            # The plate is a box of 60 x 40 x 10 mm; the tool centre is above its approach from it.
            assert np.linalg.norm(np.maximum(np.maximum(-here, here - (60, 40, 10)), 0)) > 2.0
            assert isinstance(body[k + 1], Wait) == bool(on and "dwell" in process)
        elif isinstance(item, MoveJ):
            assert not on
            here = flange_to_tip(result, np.array(item.target.values), "IRB 120")
        elif isinstance(item, (MoveL, MoveC)):
            assert item.work <= on
            if item.work and not last.work:
                assert last.speed == process.get("plunge", 20.0 / 3)
            here = np.array(item.target.origin)
        last = item if isinstance(item, (MoveJ, MoveL, MoveC)) else last
    assert not on
    assert switched >= 2


def test_force_presses_with_a_tool_that_was_switched_on_in_the_air(plate: Path) -> None:
    """``auto`` with a force: on, down, force on, the edge, force off, up, off."""
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


def test_the_same_job_gives_the_same_bytes(built: Result) -> None:
    again = camgen.build(PARTS / "rfa1.stl", post="rapid", job=PARTS / "rfa1.toml")
    assert again.text == built.text


@pytest.mark.parametrize(
    ("post", "arm"), [("pacscript", "VS-6556"), ("vplus", "Viper s650"), ("rapid", "IRB 120")]
)
def test_other_arms_and_controllers(plate: Path, post: str, arm: str) -> None:
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


# -- what is said ----------------------------------------------------------------------------------------------------


def test_what_cannot_be_reached_is_left_out_with_its_reason(plate: Path) -> None:
    job = {**PLATE, "input": {"select": "all"}}
    result = build(plate, post="rapid", job=job)
    skipped = [note for note in result.notes if note.kind == "skipped"]
    assert len(skipped) + len(result.tour.paths) == 12
    assert skipped
    assert all(note.what.startswith("edge e") and note.why for note in skipped)
    assert any("table" in note.why for note in skipped)
    assert any(note.what == "the part stands on a table" for note in result.notes)
    nominal = build(plate, post="rapid", job={**job, "tool": {}})
    lost = [note.why for note in nominal.notes if note.kind == "skipped"]
    assert sum(" reaches " in why or "camgen place" in why for why in lost) >= min(len(lost), 8)


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
    said = capsys.readouterr().err
    assert "IRB 120 reaches all of it" in said
    assert "not proven: link 4 against link 6; the others do not meet, all but the tool at" in said
    assert "no collision" not in said
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["input"]["edges"] == 12
    assert report["checks"]["collision"] == "partly checked"
    assert {path["id"] for path in report["paths"]} <= {"e1", "e2", "e3", "e4"}


def test_strict_refuses_what_leaves_an_edge_out(plate: Path) -> None:
    with pytest.raises(NoSafeProgram, match="--strict and"):
        camgen.build(plate, post="rapid", job={**PLATE, "input": {"select": "all"}}, strict=True)


# -- what is refused -------------------------------------------------------------------------------------------------


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
def test_settings_that_do_not_go_together(
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
    # At home the tip is 100 mm out of the flange, which points down by 30 deg: the part is put there.
    frame = by_hand("IRB 120", np.degrees(home.values))
    x, y, z = (frame @ np.array([0, 0, 90.0, 1]))[:3]
    job = {
        **PLATE,
        "cell": {"robot": "IRB 120", "base_from_work": [x - 30, y - 20, z - 5, 0, 0, 0]},
    }
    message = r"home collides: tool against (part|table), [\d.]+ mm deep, at joints [-\d. ]+ deg"
    with pytest.raises(NoSafeProgram, match=message):
        build(plate, post="rapid", job=job)


def test_a_part_without_edges_is_told(tmp_path: Path) -> None:
    """A ball: 320 triangles that meet at less than the feature angle."""
    made = trimesh.creation.icosphere(subdivisions=3, radius=30)
    made.export(tmp_path / "ball.stl")
    with pytest.raises(InputError, match=r"ball\.stl: has no sharp edges"):
        camgen.build(tmp_path / "ball.stl", post="rapid", job=PLATE)


def test_two_parts_in_one_program_are_refused(plate: Path) -> None:
    with pytest.raises(InputError, match="a 3-D part makes a program by itself"):
        camgen.build([plate, PARTS / "bracket.dxf"], post="rapid", job=PLATE)


# -- the cell --------------------------------------------------------------------------------------------------------


def test_a_fixture_may_be_a_mesh_and_is_named_when_it_is_hit(plate: Path, tmp_path: Path) -> None:
    """The same wall beside the plate, once as a box and once as a mesh: the same edges are lost to it."""
    low, high = np.array([20.0, -25, 0]), np.array([40.0, -4, 30])
    corners = np.array(
        [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {c + 1} {b + 1}\nf {a + 1} {d + 1} {c + 1}" for a, b, c, d in faces]
    (tmp_path / "wall.obj").write_text("\n".join(lines))
    lost = []
    for wall in ([*low.tolist(), *high.tolist()], str(tmp_path / "wall.obj")):
        result = camgen.build(
            plate, post="rapid", job={**PLATE, "cell": {**PLATE["cell"], "fixtures": [wall]}}
        )
        lost.append([note for note in result.notes if note.kind == "skipped"])
    box, mesh = lost
    assert [note.ids for note in box] == [note.ids for note in mesh] == [("e1",)]
    # The end of a piece is found to half a millimetre.
    assert box[0].length == pytest.approx(mesh[0].length, abs=0.5)
    assert all("tool against fixture 1" in note.why for note in box + mesh)


def test_the_cell_may_stand_in_a_file_of_its_own(plate: Path, tmp_path: Path) -> None:
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
        f'{begin}[cell]\nrobot = "IRB 120"\nbase_from_work = [300, -20, 150, 0, 0, 0]\nsafety = 12\n'
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
def test_what_is_wrong_in_the_file_of_a_cell(
    plate: Path, tmp_path: Path, text: str | None, message: str
) -> None:
    file = tmp_path / "cell.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(JobError, match=message):
        build(plate, post="rapid", job={"cell": {"file": str(file)}})


def test_what_stands_between_two_looks_parts_its_edge(plate: Path) -> None:
    """A sheet of 0.2 mm stands across an edge, 2.3 mm from where a tool of 1 mm is examined."""
    job = {**PLATE, "tool": {"diameter": 1.0}}
    sheet = [27.3, -10.0, 5.0, 27.5, -0.5, 40.0]
    for fixtures, names in (([], {"e1"}), ([sheet], {"e1.1", "e1.2"})):
        result = camgen.build(
            plate, post="rapid", job={**job, "cell": {**job["cell"], "fixtures": fixtures}}
        )
        assert {p.id for p in result.tour.paths if p.contours == ("e1",)} == names
        assert result.report["checks"]["collision"] == "partly checked"
    ends = [p.position[[0, -1], 0] for p in result.tour.paths if p.contours == ("e1",)]
    # Tool and sheet are 1.2 mm wide together; with the margin of 2 mm, ends to half a millimetre.
    (_, before), (after, _) = sorted(tuple(sorted(pair.tolist())) for pair in ends)
    assert 24.3 <= before <= 24.8 + 1e-9
    assert 30.0 - 1e-9 <= after <= 30.5
    lost = [note.why for note in result.notes if note.kind == "skipped"]
    (place,) = [
        m[1]
        for why in lost
        if (m := re.fullmatch(r"collision, tool against fixture 1, (.*) mm along it(; .*)?", why))
    ]
    assert 26.8 <= float(place) <= 28.0


def test_an_edge_on_which_the_factor_slows_the_tool_down_is_told() -> None:
    """The tip stands off a quarter of a rim by 2 mm at 45 deg, on a circle larger by 1.4 mm."""
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
