"""Batches on a real Dask cluster: a scheduler and two workers as processes of this machine."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from camgen.batch import state
from camgen.cli import main
from tests.support.waiting import LONG, wait_for

pytest.importorskip("distributed", reason="the extra dask is not installed")
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")

CIRCLE_DRAWING = (
    "0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n8\nrings\n10\n50\n20\n25\n40\n{radius}\n0\nENDSEC\n0\n"
    "EOF\n"
)
#: Makes a worker hang at its first part, so that it can be killed while it builds.
STUCK = """
from importlib import import_module
from pathlib import Path
from threading import Event
def _stuck(*arguments):
    Path({started!r}).touch()
    Event().wait()
import_module("camgen.pipeline.inputs").read = _stuck
"""


class Cluster:
    """A scheduler and its workers, by process."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder, self.stack = folder, stack
        self.log = folder / "scheduler.log"
        self._start(
            "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1"
        )
        self.address = self._wait_for_log(r"Scheduler at:\s+(tcp://\S+)")

    def start_worker(self, name: str, *more: str) -> "subprocess.Popen[bytes]":
        words = [
            self.address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
            "--name",
            name,
            *more,
        ]
        self.log = self.folder / f"{name}.log"
        worker = self._start("distributed.cli.dask_worker", *words)
        self._wait_for_log(r"(Registered to):")
        return worker

    def _start(self, module: str, *words: str) -> "subprocess.Popen[bytes]":
        code = f"import sys; sys.argv[0] = 'dask'\nfrom {module} import main\nmain()"
        command = [sys.executable, "-c", code, *words]
        # The output goes to a file, as a pipe without a reader would fill up.
        with self.log.open("wb") as log:
            process = subprocess.Popen(command, cwd=self.folder, stderr=log)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def _wait_for_log(self, pattern: str) -> str:
        wait_for(pattern, lambda: re.search(pattern, self.log.read_text()))
        return re.findall(pattern, self.log.read_text())[0]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    (tmp_path / "elsewhere").mkdir()
    with ExitStack() as stack:
        yield Cluster(tmp_path / "elsewhere", stack)


@pytest.fixture
def work_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "parts").mkdir()
    for number in range(12):
        (tmp_path / f"parts/p{number:02}.dxf").write_text(CIRCLE_DRAWING.format(radius=5 + number))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read_programs(folder: str) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes() for path in Path(folder).iterdir() if path.name != state.NAME
    }


def test_a_cluster_builds_all_parts_if_a_worker_is_killed(
    work_folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    started, stuck = cluster.folder / "begun", cluster.folder / "stuck.py"
    stuck.write_text(STUCK.format(started=str(started)))
    worker = cluster.start_worker("one", "--preload", str(stuck))
    cluster.start_worker("two")
    (work_folder / "parts/bad.dxf").write_text("no drawing")
    command = [sys.executable, "-m", "camgen", "batch", "parts/*.dxf", "--post", "rapid"]
    with subprocess.Popen(
        [*command, "-o", "out", "--dask", cluster.address], stdout=subprocess.PIPE, text=True
    ) as batch:
        wait_for("programs", lambda: started.exists() and len(list(Path("out").glob("*.mod"))) >= 3)
        os.kill(worker.pid, signal.SIGKILL)
        output = batch.communicate(timeout=LONG)[0]
    assert batch.returncode == 2
    status = [line.split()[1] for line in output.splitlines()[1:]]
    assert status == ["failed", *["built"] * 12]
    assert main(["batch", "parts/p*.dxf", "--post", "rapid", "--jobs", "2", "-o", "alone"]) == 0
    assert read_programs("out") == read_programs("alone")
    capsys.readouterr()


def test_files_of_a_job_are_sent_and_errors_name_them_as_the_user_does(
    work_folder: Path, cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    cluster.start_worker("one")
    corners = ("0 0 0", "1 0 0", "0 1 0", "0 0 1")
    facets = []
    for face in ((0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)):
        vertices = "\n".join(f"vertex {corners[corner]}" for corner in face)
        facets.append(f"facet normal 0 0 0\nouter loop\n{vertices}\nendloop\nendfacet")
    tetrahedron = "\n".join(facets)
    Path("parts/clamp.stl").write_text(f"solid clamp\n{tetrahedron}\nendsolid\n")
    Path("parts/p00.toml").write_text('[cell]\nrobot = "irb120"\nfixtures = ["clamp.stl"]\n')
    Path("parts/p01.toml").write_text('[cell]\nrobot = "irb120"\nfixtures = ["lost.stl"]\n')
    (work_folder / "parts/p02.dxf").write_text("no drawing")
    words = ["batch", "parts/p0[0-3].dxf", "--post", "rapid", "-q"]
    assert main([*words, "-o", "out", "--dask", cluster.address]) == 2
    cluster_errors = capsys.readouterr().err
    assert main([*words, "-o", "alone", "--jobs", "2"]) == 2
    assert capsys.readouterr().err == cluster_errors
    assert "parts/p01.dxf: parts/lost.stl: no such file" in cluster_errors
    assert read_programs("out") == read_programs("alone")
    assert {"p00.mod", "p03.mod"} == set(read_programs("out"))


@pytest.mark.usefixtures("work_folder")
def test_a_post_from_a_file_cannot_be_sent(
    cluster: Cluster, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("own.py").write_text(
        "from camgen.lang.gcode.language import run_gcode as run\n"
        "from camgen_posts.gcode import GCode\n\n\n"
        "class Own(GCode):\n    name = 'own'\n"
    )
    assert (
        main(["batch", "parts/p00.dxf", "--post", "./own.py", "-q", "--dask", cluster.address]) == 2
    )
    assert "a post from a file cannot be sent to a cluster" in capsys.readouterr().err


def test_a_missing_scheduler_is_an_error_in_one_line(
    work_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("camgen.batch.cluster._PATIENCE", 1)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        assert main(["batch", "parts/*.dxf", "--post", "rapid", "--dask", address]) == 2
        errors = capsys.readouterr().err.splitlines()
        assert errors[-1].startswith(f"camgen: error: --dask {address}: ")
    assert not (work_folder / state.NAME).exists()
