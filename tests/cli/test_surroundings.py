"""What a run must not depend on, and what it meets where it is run: other locales, no network, closed pipes, folders
that nobody may write to, another run beside it.
"""

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
#: A user that owns nothing.
NOBODY = 65534
BUILD = ("build", str(PARTS / "bracket.dxf"), "--post", "rapid")


def run(
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


#: The search for a tour is that of the drawings: half of the time of the picture would go there.
SCALED = ("--set", "image.mm_per_px=0.2", "--set", "tour.method=as-drawn")
#: Two drawings and a picture, and further words of their commands.
DRAWN = {"bracket.dxf": (), "logo.svg": (), "gear.png": SCALED}
#: Builds each of the parts in a folder of its name. The name is printed before the messages.
EACH = f"""
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
    """For each part the program, the report and the plan that one process writes, and its messages."""
    done = subprocess.run(
        [sys.executable, "-c", EACH, str(PARTS)],
        cwd=folder,
        env={"PATH": os.environ["PATH"], **env},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    pieces = re.split(rf"^({'|'.join(map(re.escape, DRAWN))})\n", done.stderr, flags=re.MULTILINE)
    assert pieces[1::2] == list(DRAWN)
    builds: Builds = {}
    for part, messages in zip(pieces[1::2], pieces[2::2], strict=True):
        written = [(folder / part / name).read_bytes() for name in ("part.ngc", "r.json", "p.json")]
        builds[part] = [*written, messages]
    return builds


@pytest.fixture(scope="module")
def built_in(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Builds]:
    """What the parts come to in an environment: one process for each."""
    return cache(lambda *env: build_each(tmp_path_factory.mktemp("parts"), dict(env)))


@pytest.mark.parametrize(
    "env",
    [
        {"PYTHONHASHSEED": "0"},
        {"PYTHONHASHSEED": "12345"},
        {"LC_ALL": "POSIX"},
        {"LC_ALL": "C.UTF-8", "LANG": "tr_TR.UTF-8"},
        {"TZ": "Asia/Kathmandu", "OMP_NUM_THREADS": "3", "OPENBLAS_NUM_THREADS": "3"},
        {"PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"},
    ],
    ids=lambda env: " ".join(f"{key}={value}" for key, value in env.items()),
)
@pytest.mark.parametrize("part", DRAWN)
def test_the_same_job_gives_the_same_bytes(
    part: str, env: dict[str, str], built_in: Callable[..., Builds]
) -> None:
    assert built_in(*env.items())[part] == built_in()[part]


#: Ends the process where anything asks for a name of the network or connects to it.
WATCHED = """
import os, sys
def hook(event, arguments):
    if event.startswith("socket.") and event not in ("socket.__new__",) or event == "urllib.Request":
        os.write(2, f"the network: {event} {arguments}".encode())
        os._exit(99)
sys.addaudithook(hook)
from camgen.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    "words",
    [
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
        (
            "build",
            str(PARTS / "gear.png"),
            "--post",
            "grbl",
            *SCALED,
            "--preview",
            "p.png",
        ),
        ("inspect", str(PARTS / "rfa1.stl")),
        ("posts",),
        ("robots",),
        ("schema",),
    ],
    ids=lambda words: " ".join(Path(word).name for word in words),
)
def test_nothing_asks_the_network(words: tuple[str, ...], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "words",
    [("posts",), ("robots", "--json"), ("inspect", str(PARTS / "bracket.dxf")), ("schema",)],
)
def test_whoever_reads_may_stop_reading(words: tuple[str, ...], tmp_path: Path) -> None:
    """As ``| head -0`` does: the pipe is closed before anything is written."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "camgen", *words]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
        check=False,
    )
    os.close(writer)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.returncode in (0, 2, 141)


def test_without_an_output_at_all_a_program_is_written(tmp_path: Path) -> None:
    """As ``>&- 2>&-`` leaves it."""
    command = f'exec "{sys.executable}" -m camgen {" ".join(BUILD)} >&- 2>&-'
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, timeout=60, check=False)
    assert done.returncode == 0
    assert (tmp_path / "bracket.mod").read_text().endswith("ENDMODULE\n")


def test_two_builds_into_one_folder_both_end_well(tmp_path: Path) -> None:
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
    beside = [
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) for _ in range(3)
    ]
    ends = [(process.communicate(timeout=120)[1], process.returncode) for process in beside]
    assert ends == [("", 0)] * 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bracket.mod", "p.json", "r.json"]
    alone = tmp_path / "alone"
    alone.mkdir()
    with contextlib.chdir(alone):
        assert main([*BUILD, "--plan", "p.json", "--report", "r.json", "-q"]) == 0
    for name in ("bracket.mod", "p.json", "r.json"):
        assert (tmp_path / name).read_bytes() == (alone / name).read_bytes()


# A disk that is full: a small one of its own, which only root can mount.
FULL = """
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
def test_a_full_disk_is_told_and_the_old_file_stays(size: str, code: int, tmp_path: Path) -> None:
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
    command = ["unshare", "-m", sys.executable, "-c", FULL, str(tmp_path), size, *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == code, done.stderr
    if code:
        assert re.fullmatch(
            r"camgen: error: b.(mod|html): cannot be written: No space left on device\n",
            done.stderr,
        )
        assert done.stdout == "['b.mod'] an older program\n"
    else:
        assert done.stdout.startswith("['b.html', 'b.mod'] MODULE")


def test_one_process_and_three_give_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What one builder makes is what three make side by side, and the table of both is the same."""
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


# As a user that may not do everything, which root is not.


#: Everything is imported by a first run, since the interpreter itself may be where nobody else can read.
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


def as_nobody(*words: str, cwd: Path, first: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", AS_NOBODY, str(first / "first.mod"), str(cwd), *words]
    return subprocess.run(
        command, cwd=first, capture_output=True, text=True, timeout=120, check=False
    )


needs_root = pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can be another user"
)


@pytest.fixture
def shared() -> Iterator[Path]:
    """A folder that every user can enter, which those of pytest are not."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        folder = Path(name)
        folder.chmod(0o755)
        (folder / "part.dxf").write_bytes((PARTS / "bracket.dxf").read_bytes())
        (folder / "part.dxf").chmod(0o644)
        yield folder


@needs_root
def test_a_folder_that_may_not_be_written_to_is_told(shared: Path, tmp_path: Path) -> None:
    done = as_nobody("build", "part.dxf", "--post", "rapid", cwd=shared, first=tmp_path)
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("camgen: error:")]
    assert len(errors) == 1
    assert "part.mod: cannot be written: Permission denied" in errors[0]
    assert sorted(path.name for path in shared.iterdir()) == ["part.dxf"]


@needs_root
def test_a_file_that_may_not_be_read_is_told(shared: Path, tmp_path: Path) -> None:
    (shared / "part.dxf").chmod(0o600)
    done = as_nobody("inspect", "part.dxf", cwd=shared, first=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("camgen: error: part.dxf: cannot be read: Permission denied")
    assert done.stderr.count("\n") == 1


@needs_root
def test_an_old_file_that_may_not_be_replaced_stays(shared: Path, tmp_path: Path) -> None:
    (shared / "part.mod").write_text("an older program\n")
    done = as_nobody("build", "part.dxf", "--post", "rapid", cwd=shared, first=tmp_path)
    assert done.returncode == 2
    assert (shared / "part.mod").read_text() == "an older program\n"
