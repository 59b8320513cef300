"""Each limit is a setting of the job.

A lowered limit refuses a real input and is named in the message. A raised limit lets more pass.
"""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
import trimesh

import camgen
from camgen.cli import main
from camgen.model.errors import InputError, JobError
from camgen.model.limits import Limits
from camgen.read.files import Files
from tests.read.test_hostile import CIRCLE, array, nested, png, svg

Captured = pytest.CaptureFixture[str]
FIXTURES = Path(__file__).parents[2] / "fixtures"
DXF = (FIXTURES / "parts" / "plate.dxf").read_bytes()
SVG = svg('<g id="a"><path d="M9 9h9"/></g><use href="#a"/><use href="#a"/>').encode()
DEEP = svg(
    '<g id="a"><path d="M9 9h9"/></g><g id="b"><use href="#a"/></g><use href="#b"/>'
).encode()
RAPID = b"MODULE m\nPROC main()\nFOR i FROM 1 TO 40 DO\n"
RAPID += b"MoveL [[300,i,0],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;\n"
RAPID += b"ENDFOR\nENDPROC\nENDMODULE\n"
PACSCRIPT = b"Sub Main\nTakeArm\nFor i = 1 To 40\nMove P, P(300, i, 0, 180)\nNext\nEnd Sub\n"
VPLUS = b".PROGRAM a()\nFOR i = 1 TO 40\nMOVE TRANS(300,i,0,0,180,0)\nEND\n.END\n"
GCODE = b"G21 G90\nG0 X0 Y0 Z5\nF100\no1 repeat [9]\nG1 X9\nG1 X0\no1 endrepeat\nM2\n"
PECKS = b"G21 G90 G0 X0 Y0 Z5\nF100\nG83 X1 Y1 Z-9 R1 Q1\nM2\n"
HELIX = b"G21 G90 G0 X0 Y0 Z5\nF100\nG2 X0 Y0 Z-5 I9 J0\nM2\n"
HOLES = b"G21 G90 G0 X0 Y0 Z5\nF100\nG91 G81 X1 Y1 Z-9 R1 L9\nM2\n"
GEAR = (FIXTURES / "parts" / "gear.png").read_bytes()
STEP = (FIXTURES / "parts" / "rfa1.step").read_bytes()
STL = (FIXTURES / "parts" / "rfa1.stl").read_bytes()


def three_mf() -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr("3D/3dmodel.model", "<model/>")
    return held.getvalue()


def glb() -> bytes:
    accessors = [{"componentType": 5126, "count": 3, "type": "VEC3"}]
    text = json.dumps({"asset": {"version": "2.0"}, "accessors": accessors}).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


class Case(NamedTuple):
    """An input that a lowered limit refuses.

    name: file of the input.
    data: its bytes.
    lowered: value of the limit.
    message: part of the refusal.
    settings: other settings of the job, `key=value`.
    """

    name: str
    data: bytes
    lowered: float
    message: str
    settings: tuple[str, ...] = ()


ARM = f"cell.robot={FIXTURES / 'robots' / 'six.urdf'}"
CAMERA = ("camera.file=camera.yaml", "camera.plane_from=[0,0,500,180,0,0]")
CASES = {
    "file_bytes": Case("a.dxf", DXF, 100, "a.dxf: has more than 100 bytes"),
    "number": Case("a.dxf", DXF, 5, "diameter cannot be beyond 5: 6", ("tool.diameter=6",)),
    "passes": Case("a.dxf", DXF, 2, "passes must be 2 at most, not 3", ("operation.passes=3",)),
    "stepover": Case("a.dxf", DXF, 0.8, "stepover must be 0.8 at least, not 0.7"),
    "chord": Case("a.dxf", DXF, 0.1, "chord must be 0.1 at least, not 0.01"),
    "motions": Case("a.dxf", DXF, 3, "motions; the limit is 3"),
    "edges": Case("a.stl", STL, 3, "edges are to be processed, more than 3"),
    "dxf_depth": Case(
        "a.dxf", nested(4, 1).encode(), 3, "blocks stand more than 3 deep within each other"
    ),
    "dxf_entities": Case(
        "a.dxf", array(3, 4).encode(), 10, "blocks expand to more than 10 entities"
    ),
    "points": Case(
        "a.xyz", b"0,0,0\n9,0,0\n9,9,9\n", 2, "has more than 2 points", ("process.clearance=50",)
    ),
    "svg_bytes": Case("a.svg", SVG, 20, "has more than 20 bytes"),
    "svg_depth": Case("a.svg", DEEP, 0.5, "references stand more than 0.5 deep within each other"),
    "svg_uses": Case("a.svg", SVG, 3, "its references draw more than 3 elements"),
    "svg_elements": Case("a.svg", SVG, 2, "has more than 2 elements"),
    "svg_page": Case("a.svg", SVG, 50, "width is beyond 50 mm"),
    "picture_pixels": Case(
        "a.png", png(9, 8, 0), 80, "has 9 x 9 pixels, more than 80", ("image.mm_per_px=1",)
    ),
    "picture_bytes": Case(
        "a.png",
        png(9, 16, 6),
        80,
        "its pixels take 648 bytes, more than 80",
        ("image.mm_per_px=1",),
    ),
    "camera_bytes": Case(
        "a.png", GEAR, 5, "has more than 5 bytes, too many for a camera file", CAMERA
    ),
    "mesh_place": Case("a.stl", STL, 1, "or too large"),
    "step_seconds": Case("a.step", STEP, 1e-4, "takes the CAD kernel more than 0.0001 s"),
    "step_place": Case("a.step", STEP, 1, "no part is so large"),
    "model_bytes": Case("a.3mf", three_mf(), 5, "its model unpacks to more than 5 bytes"),
    "accessor": Case("a.glb", glb(), 0.001, "an accessor of 3 elements in a file of"),
    "gcode_steps": Case(
        "a.nc", GCODE, 5, "the program has not ended after 5 steps in loops and calls"
    ),
    "gcode_motions": Case("a.nc", GCODE.replace(b"9]", b"99]"), 5, "instructions are refused"),
    "gcode_pieces": Case("a.nc", PECKS, 5, "G83 with more than 5 pecks is refused"),
    "rapid_steps": Case(
        "a.mod", RAPID, 5, "the program has not ended after 5 steps in loops and calls"
    ),
    "pacscript_steps": Case(
        "a.pcs", PACSCRIPT, 5, "the program has not ended after 5 steps in loops and calls"
    ),
    "vplus_steps": Case(
        "a.v2", VPLUS, 5, "the program has not ended after 5 steps in loops and calls"
    ),
    "urdf_bytes": Case(
        "a.stl", STL, 100, "has more than 100 bytes: no description of a robot", (ARM,)
    ),
    "urdf_joints": Case("a.stl", STL, 5, "has 6 joints between", (ARM,)),
}
POSTS = {".stl": "rapid", ".step": "rapid"}


def set_words(*settings: str) -> list[str]:
    return list(chain(*(("--set", setting) for setting in settings)))


def run_refused(words: list[str], capsys: Captured) -> str:
    """The line that a command prints, which must be refused."""
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory of a test, with a camera file."""
    (tmp_path / "camera.yaml").write_text("image_width: 9\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


#: Limits beyond which work is left out with a note. tests/plan/test_edges_pieces.py lowers them.
LEAVES_OUT = {"stations"}


def test_every_limit_has_a_case() -> None:
    assert set(CASES) | LEAVES_OUT == {field.name for field in msgspec.structs.fields(Limits)}


@pytest.mark.parametrize("limit", CASES)
def test_a_lowered_limit_refuses_and_is_named(limit: str, folder: Path, capsys: Captured) -> None:
    case = CASES[limit]
    if case.name == "a.step" and find_spec("OCP") is None:
        pytest.skip("the extra step (the package OCP) is not installed")
    (folder / case.name).write_bytes(case.data)
    post = POSTS.get(Path(case.name).suffix, "gcode")
    before = sorted(folder.iterdir())
    words = ["build", case.name, "--post", post, *set_words(*case.settings)]
    message = run_refused([*words, *set_words(f"limits.{limit}={case.lowered}")], capsys)
    assert case.message in message
    assert f"limits.{limit}" in message
    assert sorted(folder.iterdir()) == before
    if case.data not in (STEP, STL):  # These parts take long, and other tests read them.
        main(words)
        assert case.message not in capsys.readouterr().err


@pytest.mark.parametrize("data", [HELIX, HOLES], ids=["pieces of an arc", "holes"])
def test_a_program_of_too_many_pieces_is_refused(
    data: bytes, folder: Path, capsys: Captured
) -> None:
    (folder / "a.nc").write_bytes(data)
    words = ["build", "a.nc", "--post", "gcode"]
    message = run_refused([*words, "--set", "limits.gcode_pieces=5"], capsys)
    assert "refused (limits.gcode_pieces)" in message
    assert main(words) == 0


#: File, its bytes, raised value and other settings for each limit. A limit with two cases has a
#: space after its name in one of them.
RAISED = {
    "number": ("a.dxf", DXF, "2e7", ("tool.length=1.5e7",)),
    "passes": (
        "a.dxf",
        nested(1, 1).encode(),
        "1001",
        (
            "operation.passes=1001",
            "operation.depth=1",
            "process.spindle=100",
            "operation.kind=trace",
        ),
    ),
    "stepover": (
        "a.dxf",
        nested(1, 1, CIRCLE).encode(),
        "0.001",
        ("operation.stepover=0.005", "operation.kind=fill", "tool.diameter=19.9"),
    ),
    "chord": ("a.dxf", DXF, "1e-9", ("tolerance.chord=6e-7", "post.decimals=6")),
    "dxf_depth": ("a.dxf", nested(70, 1).encode(), "100", ("operation.kind=trace",)),
    "dxf_depth ": ("a.dxf", nested(150, 1).encode(), "200", ("operation.kind=trace",)),
    "svg_page": (
        "a.svg",
        svg('<path d="M0 0h9"/>', 'width="2e6mm" height="9mm"').encode(),
        "3e6",
        ("operation.kind=trace",),
    ),
}


@pytest.mark.parametrize("case", RAISED)
def test_a_raised_limit_lets_more_pass(case: str, folder: Path, capsys: Captured) -> None:
    name, data, value, settings = RAISED[case]
    limit = case.strip()
    (folder / name).write_bytes(data)
    words = ["build", name, "--post", "gcode", *set_words(*settings)]
    assert f"limits.{limit}" in run_refused(words, capsys)
    assert main([*words, "--set", f"limits.{limit}={value}"]) == 0, capsys.readouterr().err


def test_limits_in_the_job_file_hold_for_inspect_and_batch(folder: Path, capsys: Captured) -> None:
    (folder / "a.dxf").write_bytes(DXF)
    (folder / "a.toml").write_text("[limits]\nfile_bytes = 100\n")
    message = "a.dxf: has more than 100 bytes; split it, or raise limits.file_bytes"
    assert message in run_refused(["inspect", "a.dxf"], capsys)
    assert main(["inspect", "a.dxf", "--set", "limits.file_bytes=1e6"]) == 0
    capsys.readouterr()
    assert main(["batch", "a.dxf", "--post", "gcode", "-o", "out", "--jobs", "1"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_limits_hold_for_standard_input(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["build", "-", "--format", "dxf", "--post", "gcode", "-o", "a.ngc"]
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(DXF)))
    message = run_refused([*words, "--set", "limits.file_bytes=100"], capsys)
    problem = "has more than 100 bytes; split it, or raise limits.file_bytes"
    assert message == f"camgen: error: -: {problem}\n"
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(DXF)))
    assert main(words) == 0


def test_limits_hold_for_calls_from_python(folder: Path) -> None:
    (folder / "a.dxf").write_bytes(DXF)
    job = {"limits": {"dxf_entities": 2}}
    calls: tuple[Callable[[], object], ...] = (
        lambda: camgen.read("a.dxf", job),
        lambda: camgen.build("a.dxf", post="gcode", job=job),
    )
    for call in calls:
        with pytest.raises(InputError, match=r"limits\.dxf_entities"):
            call()
    with pytest.raises(JobError, match="edges must be a number > 0, not 0"):
        camgen.job({"limits": {"edges": 0}})


def test_files_under_other_limits_are_read_once(folder: Path) -> None:
    (folder / "a.nc").write_text("G21")
    files = Files()
    other = files.within(Limits(file_bytes=2))
    assert files.read("a.nc").data == other.read("a.nc").data
    assert other.read("a.nc").limits.file_bytes == 2
    assert list(other.opened) == list(files.opened)
    (folder / "b.nc").write_text("G21")
    with pytest.raises(InputError, match="has more than 2 bytes"):
        other.read("b.nc")


def test_the_refusal_of_a_noisy_mesh_suggests_to_smooth_it(folder: Path, capsys: Captured) -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=40)
    noise = np.random.default_rng(1).normal(scale=1.2, size=ball.vertices.shape)
    trimesh.Trimesh(ball.vertices + noise, ball.faces, process=False).export(folder / "noisy.stl")
    words = ["build", "noisy.stl", "--post", "rapid", "--set", "input.select=all"]
    message = run_refused(words, capsys)
    assert "edges are to be processed, more than 2,000 (input.select); smooth the mesh" in message
    assert message.endswith("or raise limits.edges\n")
