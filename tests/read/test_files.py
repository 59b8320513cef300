"""Input files are opened through `Files`: each one once in a build, or refused with its reason."""

import io
import os
import sys
from collections import Counter
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest
import trimesh

from camgen.cli import main
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.limits import Limits
from camgen.read import inspect, read
from camgen.read.files import Files
from tests.support.clouds import scan

FIXTURES = Path(__file__).parents[2] / "fixtures"
PARTS, ROBOTS = FIXTURES / "parts", FIXTURES / "robots"


@pytest.fixture(autouse=True)
def _in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_file_with_two_names_is_opened_once(tmp_path: Path) -> None:
    Path("a.nc").write_bytes(b"first")
    Path("b.nc").symlink_to("a.nc")
    files = Files()
    assert files.read("a.nc").data == b"first"
    Path("a.nc").write_bytes(b"second")
    again = files.open(tmp_path / "b.nc")
    assert (again.data, again.path) == (b"first", tmp_path / "b.nc")
    assert Files().read("a.nc").data == b"second"


def test_released_files_are_read_again_and_keep_their_names() -> None:
    Path("a.nc").write_bytes(b"first")
    files = Files()
    assert files.read("a.nc").data == b"first"
    files.release()
    assert [path.name for path in files.opened.values()] == ["a.nc"]
    Path("a.nc").write_bytes(b"second")
    assert files.read("a.nc").data == b"second"


def test_a_given_source_is_not_opened() -> None:
    files = Files([Source(Path("stdin.dxf"), b"0\nSECTION\n")])
    assert files.read("stdin.dxf").data == b"0\nSECTION\n"


def test_a_source_is_named_as_the_user_has_it() -> None:
    source = Source(Path("folder/Part.Name.DXF"), b"123")
    assert (source.name, source.stem, source.suffix) == ("Part.Name.DXF", "Part.Name", ".dxf")
    assert repr(source) == "Source('folder/Part.Name.DXF', 3 bytes)"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plat.dxf", "plat.dxf: no such file; nearest is plate.dxf"),
        ("none/plate.dxf", "none/plate.dxf: no such file; its folder does not exist"),
        ("folder", "folder: is a folder; name the files in it"),
        ("pipe", "pipe: is not a regular file; copy it to a file, or use - with --format"),
        ("plate.dxf/x", "plate.dxf/x: cannot be read: Not a directory"),
        ("a\0b", "a b: cannot be read: embedded null byte"),
        ("loop", "loop: cannot be read: "),
    ],
)
def test_a_file_that_cannot_be_opened_is_refused_with_its_reason(name: str, message: str) -> None:
    Path("plate.dxf").touch()
    Path("folder").mkdir()
    os.mkfifo("pipe")
    Path("loop").symlink_to("loop")
    for read_file in (Files().read, read, inspect):
        with pytest.raises(InputError) as caught:
            read_file(name)
        assert str(caught.value).startswith(message)


# -- each file of a build is opened once


class OpenedFiles:
    """Counts the files in a folder that are opened for reading.

    folder: path of the folder with a separator at its end. Nothing is counted if it is empty.
    counts: number of times that each file was opened.
    """

    folder = ""
    counts: ClassVar[Counter[str]] = Counter()


def _count_opened(event: str, arguments: tuple[object, ...]) -> None:
    """A hook for audits of Python, which report `open`, `os.open` and `pathlib`."""
    if event != "open" or not OpenedFiles.folder:
        return
    path, _, flags = arguments
    if not isinstance(path, (str, bytes, os.PathLike)) or not isinstance(flags, int):
        return
    name = os.path.realpath(os.fsdecode(path))
    # ezdxf tries to open its settings in this folder, which do not exist.
    is_in_folder = name.startswith(OpenedFiles.folder) and os.path.isfile(name)
    if is_in_folder and not flags & (os.O_WRONLY | os.O_RDWR):
        OpenedFiles.counts[name.removeprefix(OpenedFiles.folder)] += 1


# A hook cannot be removed: it stays until the process ends.
sys.addaudithook(_count_opened)


def opened(*words: str) -> dict[str, int]:
    OpenedFiles.folder, OpenedFiles.counts = os.path.realpath(".") + os.sep, Counter()
    try:
        assert main([*words, "-q"]) == 0
    finally:
        OpenedFiles.folder = ""
    return dict(OpenedFiles.counts)


def copy_here(*paths: Path) -> list[str]:
    """Copies files into the working directory, and returns their names."""
    for path in paths:
        Path(path.name).write_bytes(path.read_bytes())
    return [path.name for path in paths]


def test_drawings_and_their_job_are_opened_once() -> None:
    names = copy_here(PARTS / "bracket.dxf", PARTS / "blocks.dxf", PARTS / "logo.svg")
    Path("bracket.toml").write_text('[cell]\nfile = "cell.toml"\n')
    Path("cell.toml").write_text("[cell]\nbase_from_work = [400, 0, 0, 0, 0, 0]\n")
    counts = opened("build", *names, "--post", "gcode", "-o", ".")
    assert counts == dict.fromkeys([*names, "bracket.toml", "cell.toml"], 1)


def test_old_programs_are_opened_once() -> None:
    Path("old.nc").write_text("G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F60\nG1 X10\nM2\n")
    assert opened("build", "old.nc", "--post", "rapid") == {"old.nc": 1}
    assert opened("inspect", "old.nc") == {"old.nc": 1}


def test_a_photo_its_camera_and_its_background_are_opened_once() -> None:
    bench = np.full((400, 500), 200, np.uint8)
    cv2.imwrite("empty.png", bench)
    cv2.rectangle(bench, (150, 120), (340, 270), 40, -1)
    cv2.imwrite("part.png", bench)
    rows = "rows: {}\n  cols: {}\n  data: {}\n"
    matrix, lens = [900.0, 0, 250, 0, 900, 200, 0, 0, 1], [0.0] * 5
    Path("camera.yaml").write_text(
        "image_width: 500\nimage_height: 400\ndistortion_model: plumb_bob\n"
        f"camera_matrix:\n  {rows.format(3, 3, matrix)}"
        f"distortion_coefficients:\n  {rows.format(1, 5, lens)}"
    )
    Path("part.toml").write_text(
        '[camera]\nfile = "camera.yaml"\nplane_from = [0, 0, 450, 180, 0, 0]\n'
        '[image]\nbackground = "empty.png"\n'
    )
    once = dict.fromkeys(["part.png", "part.toml", "camera.yaml", "empty.png"], 1)
    assert opened("build", "part.png", "--post", "gcode") == once
    assert opened("inspect", "part.png") == once


def test_an_arm_its_meshes_and_fixtures_that_are_meshes_are_opened_once() -> None:
    copy_here(PARTS / "bracket.dxf", ROBOTS / "six.urdf")
    meshes = Path("six_description/meshes")
    meshes.mkdir(parents=True)
    for mesh in (ROBOTS / meshes).iterdir():
        (meshes / mesh.name).write_bytes(mesh.read_bytes())
    trimesh.creation.box((20, 20, 20)).apply_translation((200, 300, 0)).export("clamp.stl")
    Path("bracket.toml").write_text(
        '[cell]\nrobot = "six.urdf"\nfixtures = ["clamp.stl"]\n'
        "base_from_work = [300, -60, -50, 0, 0, 0]\n"
        "flange_from_tool = [0, 0, 100, 0, 0, 0]\nhome = [0, -100, 0, 0, 30, 0]\n"
    )
    named = [str(meshes / name) for name in ("turn.stl", "upper.stl")]
    once = dict.fromkeys(["bracket.dxf", "bracket.toml", "six.urdf", "clamp.stl", *named], 1)
    assert opened("build", "bracket.dxf", "--post", "rapid", "--preview", "a.html") == once


@pytest.mark.parametrize("name", ["rfa1.stl", "rfa1.step"])
def test_a_part_in_space_is_opened_once(name: str) -> None:
    if name.endswith(".step"):
        pytest.importorskip("OCP", reason="the extra step is not installed")
    copy_here(PARTS / name)
    assert opened("inspect", name) == {name: 1}
    assert opened("init", name) == {name: 1}


def test_a_model_and_its_scan_are_opened_once() -> None:
    copy_here(PARTS / "rfa1.stl")
    np.savetxt("scan.xyz", scan(trimesh.load_mesh("rfa1.stl"), 1000, 1), fmt="%.4f")
    words = ["-o", "frame.toml", "--start", "0,0,0,0,0,0"]
    assert opened("localize", "rfa1.stl", "scan.xyz", *words) == {"rfa1.stl": 1, "scan.xyz": 1}


def test_verify_opens_program_and_plan_once() -> None:
    copy_here(PARTS / "bracket.dxf")
    opened("build", "bracket.dxf", "--post", "gcode", "--plan", "plan.json")
    counts = opened("verify", "bracket.ngc", "--post", "gcode", "--plan", "plan.json")
    assert counts == {"bracket.ngc": 1, "plan.json": 1}


def test_a_limit_above_the_memory_allocates_no_more_than_the_file(tmp_path: Path) -> None:
    """Python allocates as many bytes as a read may return."""
    (tmp_path / "small.txt").write_bytes(b"abc")
    files = Files(limits=Limits(file_bytes=1e18))
    assert files.read(tmp_path / "small.txt").data == b"abc"
    pipe = Files(limits=Limits(file_bytes=1e18), streams={Path("-"): io.BytesIO(b"x" * 100)})
    assert pipe.open("-").data == b"x" * 100


def test_a_stream_of_one_byte_too_many_is_refused() -> None:
    pipe = Files(limits=Limits(file_bytes=99), streams={Path("-"): io.BytesIO(b"x" * 100)})
    with pytest.raises(InputError, match="has more than 99 bytes"):
        pipe.open("-")
