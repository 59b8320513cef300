"""Runs in other environments: locales, no network, closed pipes, no permissions, full disks."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from camgen.cli import main

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "fixtures" / "parts"
#: The id of a user who owns no files.
NOBODY = 65534
BUILD = ("build", str(PARTS / "bracket.dxf"), "--post", "rapid")


def run_camgen(
    *words: str, cwd: Path, env: dict[str, str] | None = None, **more: object
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "camgen", *words]
    environment = {"PATH": os.environ["PATH"], **(env or {})}
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        command,
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        **more,
    )


#: Settings for the picture. A search for its tour would double the time; the drawings have one.
SCALED = ("--set", "image.mm_per_px=0.2", "--set", "tour.method=as-drawn")
#: Two drawings and a picture, and further words of their commands.
DRAWN = {"bracket.dxf": (), "logo.svg": (), "gear.png": SCALED}
#: Builds each of the parts in a folder of its name. The name is printed before the messages.
BUILD_EACH = f"""
import os, sys
from camgen.cli import main
for name, more in {DRAWN!r}.items():
    os.makedirs(name)
    os.chdir(name)
    print(name, file=sys.stderr, flush=True)
    words = ["build", os.path.join(sys.argv[1], name), "--post", "gcode", *more]
    assert main([*words, "--report", "r.json", "--plan", "p.json", "-o", "part.ngc"]) == 0
    os.chdir("..")
"""
Builds = dict[str, list[bytes | str]]


def build_each(folder: Path, env: dict[str, str]) -> Builds:
    """The program, report, plan and messages of each part, which one process builds."""
    process = subprocess.run(
        [sys.executable, "-c", BUILD_EACH, str(PARTS)],
        cwd=folder,
        env={"PATH": os.environ["PATH"], **env},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    pieces = re.split(
        rf"^({'|'.join(map(re.escape, DRAWN))})\n", process.stderr, flags=re.MULTILINE
    )
    assert pieces[1::2] == list(DRAWN)
    builds: Builds = {}
    for part, messages in zip(pieces[1::2], pieces[2::2], strict=True):
        written = [(folder / part / name).read_bytes() for name in ("part.ngc", "r.json", "p.json")]
        builds[part] = [*written, messages]
    return builds


@pytest.fixture(scope="module")
def built_in(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Builds]:
    """The builds in an environment; one process for each environment."""
    return cache(lambda *env: build_each(tmp_path_factory.mktemp("parts"), dict(env)))


@pytest.mark.parametrize(
    "env",
    [
        {"PYTHONHASHSEED": "0", "LC_ALL": "POSIX", "TZ": "Asia/Kathmandu"},
        {"PYTHONHASHSEED": "12345", "LC_ALL": "C.UTF-8", "LANG": "tr_TR.UTF-8"},
        {
            "PYTHONUTF8": "0",
            "PYTHONIOENCODING": "ascii",
            "OMP_NUM_THREADS": "3",
            "OPENBLAS_NUM_THREADS": "3",
        },
    ],
    ids=lambda env: " ".join(f"{key}={value}" for key, value in env.items()),
)
@pytest.mark.parametrize("part", DRAWN)
def test_the_same_job_gives_the_same_bytes(
    part: str, env: dict[str, str], built_in: Callable[..., Builds]
) -> None:
    assert built_in(*env.items())[part] == built_in()[part]


#: Commands that build, and commands that only print.
COMMANDS = (
    BUILD,
    (
        "build",
        str(PARTS / "logo.svg"),
        "--post",
        "pacscript",
        "--set",
        "operation.kind=trace",
        "--preview",
        "p.html",
    ),
    ("build", str(PARTS / "gear.png"), "--post", "grbl", *SCALED, "--preview", "p.png"),
    ("inspect", str(PARTS / "rfa1.stl")),
    ("posts",),
    ("robots",),
    ("schema",),
)
#: Runs the commands. It ends with code 99 if one looks up a host or connects to one.
WITHOUT_NETWORK = f"""
import os, sys
words = ()
def hook(event, arguments):
    is_socket = event.startswith("socket.") and event not in ("socket.__new__",)
    if is_socket or event == "urllib.Request":
        os.write(2, f"the network: {{event}} {{arguments}} of {{words}}".encode())
        os._exit(99)
sys.addaudithook(hook)
from camgen.cli import main
for words in {COMMANDS!r}:
    assert main(words) == 0, words
"""


def test_no_command_opens_the_network(tmp_path: Path) -> None:
    """One process runs all commands. It imports a module at the first that needs it."""
    process = subprocess.run(
        [sys.executable, "-c", WITHOUT_NETWORK],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert process.returncode == 0, process.stderr


@pytest.mark.parametrize(
    "words",
    [("posts",), ("robots", "--json"), ("inspect", str(PARTS / "bracket.dxf")), ("schema",)],
)
def test_a_closed_pipe_ends_a_command_without_a_traceback(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    """The reader closes the pipe before the command writes, as `| head -0` does."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "camgen", *words]
    process = subprocess.run(
        command,
        cwd=tmp_path,
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    os.close(writer)
    assert "Traceback" not in process.stderr
    assert "Exception ignored" not in process.stderr
    assert process.returncode in (0, 2, 141)


def test_a_program_is_written_with_closed_output_streams(tmp_path: Path) -> None:
    """The shell closes standard output and standard error: `>&- 2>&-`."""
    command = f'exec "{sys.executable}" -m camgen {" ".join(BUILD)} >&- 2>&-'
    process = subprocess.run(["sh", "-c", command], cwd=tmp_path, timeout=60, check=False)
    assert process.returncode == 0
    assert (tmp_path / "bracket.mod").read_text().endswith("ENDMODULE\n")


def test_three_builds_at_once_into_one_folder_succeed(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "camgen",
        *BUILD,
        "--plan",
        "p.json",
        "--report",
        "r.json",
        "-q",
    ]
    builders = [
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(3)
    ]
    results = [(process.communicate(timeout=120)[1], process.returncode) for process in builders]
    assert results == [("", 0)] * 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bracket.mod", "p.json", "r.json"]
    alone = tmp_path / "alone"
    alone.mkdir()
    with contextlib.chdir(alone):
        assert main([*BUILD, "--plan", "p.json", "--report", "r.json", "-q"]) == 0
    for name in ("bracket.mod", "p.json", "r.json"):
        assert (tmp_path / name).read_bytes() == (alone / name).read_bytes()


#: Runs a command on a small disk, which only root can mount.
ON_FULL_DISK = """
import subprocess, sys
from camgen.cli import main
folder, *words = sys.argv[1:]
subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={words.pop(0)}", "none", folder], check=True)
open(f"{folder}/b.mod", "w").write("an older program")
import os
os.chdir(folder)
code = main(words)
print(sorted(os.listdir()), open("b.mod").read()[:16])
sys.exit(code)
"""


@pytest.mark.skipif(
    subprocess.run(["unshare", "-m", "true"], capture_output=True, check=False).returncode != 0
    if shutil.which("unshare")
    else True,
    reason="only root can mount a small disk",
)
@pytest.mark.parametrize(("size", "code"), [("8k", 2), ("16k", 2), ("10m", 0)])
def test_a_full_disk_is_reported_and_the_old_file_kept(
    size: str, code: int, tmp_path: Path
) -> None:
    words = [
        "build",
        str(PARTS / "bracket.dxf"),
        "--post",
        "rapid",
        "-q",
        "-o",
        "b.mod",
        "--preview",
        "b.html",
    ]
    command = ["unshare", "-m", sys.executable, "-c", ON_FULL_DISK, str(tmp_path), size, *words]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert process.returncode == code, process.stderr
    if code:
        assert re.fullmatch(
            r"camgen: error: b.(mod|html): cannot be written: No space left on device\n",
            process.stderr,
        )
        assert process.stdout == "['b.mod'] an older program\n"
    else:
        assert process.stdout.startswith("['b.html', 'b.mod'] MODULE")


def test_one_process_and_three_write_the_same_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The exit code, the table and the programs of one builder are those of three."""
    builds = []
    names = [str(PARTS / name) for name in ("bracket.dxf", "plate.dxf", "logo.svg", "gaps.dxf")]
    for count in ("1", "3"):
        folder = tmp_path / count
        folder.mkdir()
        words = ["--post", "rapid", "--jobs", count, "-o", "out", "--report", "r.json"]
        with contextlib.chdir(folder):
            code = main(["batch", *names, *words])
        table = re.sub(r"\d+\.\d s\b.*", "", capsys.readouterr().out)
        programs = {path.name: path.read_bytes() for path in (folder / "out").glob("*.mod")}
        builds.append((code, table, programs))
    assert builds[0] == builds[1]
    assert len(builds[0][2]) >= 3


# -- a user without permissions, unlike root


#: Runs a command as another user. A build before it imports all modules, because the user may not
#: be able to read the files of the interpreter.
AS_NOBODY = f"""
import os, sys
from camgen.cli import main
first, folder, *words = sys.argv[1:]
assert main(["build", {str(PARTS / "bracket.dxf")!r}, "--post", "rapid", "-q", "-o", first]) == 0
os.chdir(folder)
os.setgid({NOBODY})
os.setuid({NOBODY})
sys.exit(main(words))
"""


def run_as_nobody(*words: str, cwd: Path, first: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", AS_NOBODY, str(first / "first.mod"), str(cwd), *words]
    return subprocess.run(
        command, cwd=first, capture_output=True, text=True, timeout=120, check=False
    )


needs_root = pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can be another user"
)


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder with a drawing that each user can enter. The folders of pytest are private."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        folder.chmod(0o755)
        (folder / "part.dxf").write_bytes((PARTS / "bracket.dxf").read_bytes())
        (folder / "part.dxf").chmod(0o644)
        yield folder


@needs_root
def test_a_folder_without_write_permission_is_reported(shared: Path, tmp_path: Path) -> None:
    process = run_as_nobody("build", "part.dxf", "--post", "rapid", cwd=shared, first=tmp_path)
    assert process.returncode == 2
    errors = [line for line in process.stderr.splitlines() if line.startswith("camgen: error:")]
    assert len(errors) == 1
    assert "part.mod: cannot be written: Permission denied" in errors[0]
    assert sorted(path.name for path in shared.iterdir()) == ["part.dxf"]


@needs_root
def test_a_file_without_read_permission_is_reported(shared: Path, tmp_path: Path) -> None:
    (shared / "part.dxf").chmod(0o600)
    process = run_as_nobody("inspect", "part.dxf", cwd=shared, first=tmp_path)
    assert process.returncode == 2
    assert process.stderr.startswith("camgen: error: part.dxf: cannot be read: Permission denied")
    assert process.stderr.count("\n") == 1


@needs_root
def test_an_old_file_in_a_read_only_folder_is_kept(shared: Path, tmp_path: Path) -> None:
    (shared / "part.mod").write_text("an older program\n")
    process = run_as_nobody("build", "part.dxf", "--post", "rapid", cwd=shared, first=tmp_path)
    assert process.returncode == 2
    assert (shared / "part.mod").read_text() == "an older program\n"
