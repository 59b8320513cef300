"""Files that a command reads are not overwritten, and a signal leaves no files."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from camgen.batch.writing import find_parts, write_all
from camgen.cli import main
from camgen.cli.stop import Stopped, Terminated, raise_signals
from camgen.post import Post
from tests.support.waiting import LONG

PLATE = "0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n8\n0\n10\n50\n20\n25\n40\n10\n0\nENDSEC\n0\nEOF\n"
#: A corner of a cube of 9 mm as the facets of an STL file.
CUBE = "".join(
    "facet normal 0 0 0\nouter loop\n"
    f"vertex {first}\nvertex {second}\nvertex {third}\n"
    "endloop\nendfacet\n"
    for first, second, third in (
        ("0 0 0", "0 9 0", "9 0 0"),
        ("0 0 0", "9 0 0", "0 0 9"),
        ("0 0 0", "0 0 9", "0 9 0"),
        ("9 0 0", "0 9 0", "0 0 9"),
    )
)
ROBOTS = Path(__file__).parents[2] / "fixtures" / "robots"
JOB = """
[cell]
file = "cell.toml"
fixtures = ["m.stl"]
"""
#: The file of a post that a user wrote.
OWN_POST = """
from camgen_posts.gcode import GCode
from camgen.lang.gcode.language import run_gcode


class Own(GCode):
    name = "own"


def run(files, ask):
    return run_gcode(files, ask)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the commands run, with a drawing, its job, a cell file and a fixture."""
    (tmp_path / "plate.dxf").write_text(PLATE)
    (tmp_path / "plate.toml").write_text(JOB)
    (tmp_path / "cell.toml").write_text("[cell]\nsafety = 12.0\n")
    (tmp_path / "m.stl").write_text(f"solid m\n{CUBE}endsolid m\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read_contents(folder: Path) -> dict[str, bytes]:
    """The bytes of all files below a folder, by their names."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


OPTIONS = ("-o", "--plan", "--report", "--preview")


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize(
    "read", ["m.stl", "cell.toml", "plate.toml", "plate.dxf", "other/../m.stl", "link.stl"]
)
def test_a_file_that_a_build_reads_is_not_overwritten(
    option: str, read: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "other").mkdir()
    (folder / "link.stl").symlink_to("m.stl")
    if option == "--preview":  # A preview needs the suffix of a picture.
        preview = f"{read}.svg"
        (folder / preview).symlink_to((folder / read).resolve())
        read = preview
    before = read_contents(folder)
    assert main(["build", "plate.dxf", "--post", "gcode", option, read]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert f"{read}: would overwrite " in message
    assert read_contents(folder) == before


@pytest.mark.parametrize("read", ["six.urdf", "turn.stl"])
def test_an_arm_and_its_meshes_are_not_overwritten(
    read: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("six.urdf", "turn.stl", "upper.stl"):
        (folder / name).write_bytes(next(ROBOTS.rglob(name)).read_bytes())
    before = read_contents(folder)
    words = [
        "build",
        "plate.dxf",
        "--post",
        "rapid",
        "--set",
        "cell.robot=six.urdf",
        "--plan",
        read,
    ]
    assert main(words) == 2
    assert "would overwrite" in capsys.readouterr().err
    assert read_contents(folder) == before


def test_the_file_of_a_post_is_not_overwritten(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "own.py").write_text(OWN_POST)
    before = read_contents(folder)
    assert main(["build", "plate.dxf", "--post", "own.py", "--plan", "own.py"]) == 2
    assert capsys.readouterr().err.endswith(
        "own.py: would overwrite own.py, which is read; give another name\n"
    )
    after = {
        name: content
        for name, content in read_contents(folder).items()
        if "__pycache__" not in name
    }
    assert after == before


def test_a_batch_overwrites_no_file_that_any_of_its_parts_reads(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A program, and then the report, has the name of a file that another part reads."""
    shutil.copy("plate.dxf", "lid.dxf")
    (folder / "lid.toml").write_text('[cell]\nfile = "plate.ngc"\n')
    (folder / "plate.ngc").write_text("[cell]\nsafety = 11.0\n")
    before = read_contents(folder)
    assert main(["batch", "*.dxf", "--post", "gcode"]) == 2
    assert "its program would overwrite a file that is read (plate.ngc)" in capsys.readouterr().err
    assert main(["batch", "*.dxf", "--post", "gcode", "-o", "out", "--report", "m.stl"]) == 2
    assert "m.stl: would overwrite m.stl, which is read" in capsys.readouterr().err
    assert read_contents(folder) == before


def test_the_report_of_a_batch_cannot_be_one_of_its_programs(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["batch", "plate.dxf", "--post", "gcode", "--report", "plate.ngc"]) == 2
    assert "plate.ngc: is named for two outputs" in capsys.readouterr().out
    assert (folder / "plate.ngc").read_text().startswith("{")


def test_init_writes_into_the_current_folder(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "drawings").mkdir()
    shutil.move("plate.dxf", "drawings/lid.dxf")
    assert main(["init", "drawings/lid.dxf"]) == 0
    assert "camgen build drawings/lid.dxf --job lid.toml" in capsys.readouterr().err
    assert (folder / "lid.toml").is_file()
    assert [path.name for path in (folder / "drawings").iterdir()] == ["lid.dxf"]
    assert main(["build", "drawings/lid.dxf", "--job", "lid.toml", "--post", "gcode"]) == 0


# -- signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_between_two_files_restores_the_old_files(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal after the renaming of the first file is raised when the old files are restored."""
    os_replace = os.replace

    def replace(source: Path, target: Path) -> None:
        os_replace(source, target)
        signal.raise_signal(number)

    monkeypatch.setattr("os.replace", replace)
    (tmp_path / "old").write_text("old")
    # A shell starts background processes with some signals ignored; the default is set here.
    old_handler = signal.signal(
        number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    )
    try:
        with raise_signals(), pytest.raises(Stopped):
            write_all([(tmp_path / "old", b"fresh"), (tmp_path / "new", b"fresh")], {})
    finally:
        signal.signal(number, old_handler)
    assert read_contents(tmp_path) == {"old": b"old"}
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_after_the_command_keeps_its_exit_code() -> None:
    """The process ends with 0 although it receives SIGTERM after the command."""
    code = (
        "import os, signal, sys\nfrom camgen.cli import main\nsys.argv = ['camgen', 'posts']\n"
        "code = main()\nos.kill(os.getpid(), signal.SIGTERM)\nsys.exit(code)"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert process.returncode == 0


def test_sigterm_prints_one_line_and_writes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def render(*_: object) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(Post, "render", render)
    assert main(["build", "plate.dxf", "--post", "rapid"]) == 143
    assert capsys.readouterr().err == "camgen: ended by SIGTERM\n"
    assert set(read_contents(folder)) == {"plate.dxf", "plate.toml", "cell.toml", "m.stl"}
    assert Terminated(signal.SIGTERM).number == 15


def is_group_alive(number: int) -> bool:
    try:
        os.killpg(number, 0)
    except ProcessLookupError:
        return False
    return True


def test_sigterm_ends_a_batch_with_its_builders(folder: Path) -> None:
    for k in range(6):
        shutil.copy("plate.dxf", f"part{k}.dxf")
    words = [
        sys.executable,
        "-m",
        "camgen",
        "batch",
        "part*.dxf",
        "--post",
        "gcode",
        "-o",
        "out",
        "--jobs",
        "2",
    ]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as batch:
        state = folder / "out" / "camgen-batch.jsonl"
        deadline = time.monotonic() + LONG
        while not state.exists() and batch.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
        batch.terminate()
        _, errors = batch.communicate(timeout=LONG)
        assert batch.returncode == 143, errors
        assert b"ended by SIGTERM: " in errors
    deadline = time.monotonic() + LONG
    while is_group_alive(batch.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_group_alive(batch.pid)
    assert not [path for path in (folder / "out").iterdir() if path.name.startswith(".camgen")]


def test_a_program_that_camgen_did_not_write_is_not_overwritten_by_default(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A program that was taught at the robot may exist only in this file."""
    (folder / "plate.mod").write_text("MODULE plate\n  PROC main()\n  ENDPROC\nENDMODULE\n")
    before = read_contents(folder)
    words = ["build", "plate.dxf", "--post", "rapid", "--job", "own.toml", "-q"]
    (folder / "own.toml").write_text("")
    before = read_contents(folder)
    assert main(words) == 2
    message = capsys.readouterr().err
    assert (
        "plate.mod: is there already, and camgen did not write it; name the program with -o"
        in message
    )
    assert read_contents(folder) == before
    # A name given with -o is overwritten, and so is a program that camgen wrote.
    assert main([*words, "-o", "plate.mod"]) == 0
    assert main(words) == 0


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("日本", "中国"),
        ("a" * 66 + "1", "a" * 66 + "2"),
        ("left", "right"),
    ],
)
def test_a_program_of_another_part_is_not_replaced(
    first: str, second: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """PacScript prints `__` for both names, and a header line ends after 72 characters."""
    Path("plate.dxf").rename(f"{first}.dxf")
    shutil.copy(f"{first}.dxf", f"{second}.dxf")
    Path("own.toml").write_text("")
    words = ["--post", "pacscript", "--job", "own.toml", "-q", "-o", "program.pcs"]
    assert main(["build", f"{first}.dxf", *words]) == 0
    before = read_contents(Path())
    assert main(["build", f"{second}.dxf", *words]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert "program.pcs: is the program of another part (part: " in errors[0]
    assert "give another name or folder with -o" in errors[0]
    assert read_contents(Path()) == before
    # The same part replaces its program; the program of the other part gets its name by `-o`.
    assert main(["build", f"{first}.dxf", *words, "--set", "process.feed=10"]) == 0
    assert read_contents(Path())["program.pcs"] != before["program.pcs"]
    assert main(["build", f"{second}.dxf", *words[:-1], "other.pcs"]) == 0


@pytest.mark.usefixtures("folder")
def test_names_in_other_scripts_have_one_program_name_and_two_headers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The error names the file, whose name follows from the program name."""
    Path("own.toml").write_text("")
    for name in ("日本", "中国"):
        shutil.copy("plate.dxf", f"{name}.dxf")
    words = ["--post", "pacscript", "--job", "own.toml", "-q"]
    assert main(["build", "日本.dxf", *words]) == 0
    assert main(["build", "中国.dxf", *words]) == 2
    assert "job___.pcs: is the program of another part" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus", "gcode", "grbl"])
def test_the_header_of_every_post_names_its_part(post: str) -> None:
    Path("own.toml").write_text("")
    words = ["--post", post, "--job", "own.toml", "-q", "-o", "program"]
    assert main(["build", "plate.dxf", *words]) == 0
    assert find_parts(Path("program").read_bytes()) == [b"part: plate.dxf"]
