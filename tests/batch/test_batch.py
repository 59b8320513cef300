import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from camgen.batch import state
from camgen.cli import main
from camgen.cli.say import Terminal
from tests.support.waiting import LONG, wait_for

PLATE = (
    "0\nSECTION\n2\nENTITIES\n"
    "0\nCIRCLE\n8\nholes\n10\n50\n20\n25\n40\n{radius}\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n0\n11\n100\n21\n0\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n0\n11\n100\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n100\n20\n50\n11\n0\n21\n50\n"
    "0\nLINE\n8\noutline\n10\n0\n20\n50\n11\n0\n21\n0\n"
    "0\nENDSEC\n0\nEOF\n"
)
#: A post that dies, hangs or faults where the program's name says so, with G-code's text and read-back.
FATAL = """
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from camgen_posts.gcode import GCode
from camgen.lang.gcode.language import run_gcode as run


@dataclass
class Fatal(GCode):
    name: ClassVar[str] = "fatal"

    def begin(self, program):
        if program.name == "killed":
            os.kill(os.getpid(), 9)
        if program.name == "segfault":
            os.kill(os.getpid(), 11)
        if program.name == "leaves":
            os._exit(7)
        if program.name == "memory":
            raise MemoryError("no more")
        if program.name == "hangs":
            Path("hangs").write_text(str(os.getpid()))
            while not Path("goes on").exists():
                time.sleep(0.02)
        return super().begin(program)
"""
#: One builder: each is a process that imports all of camgen.
ONE = ("--jobs", "1")
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def ready_builders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builders are forked by a server that has imported camgen.

    Tests of how a builder begins or ends do not use it. A builder imports the main module of its
    parent again, so pytest is hidden from it.
    """
    if os.name == "nt":
        return
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["camgen.batch.perform", "camgen.read.dxf", "shapely", "ezdxf"])
    monkeypatch.setattr("camgen.batch.pool.get_context", lambda _: server)
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with three plates of different holes; commands run in it."""
    (tmp_path / "parts").mkdir()
    for name, radius in (("a", 8), ("b", 9), ("c", 10)):
        (tmp_path / "parts" / f"{name}.dxf").write_text(PLATE.format(radius=radius))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


def table(capsys: Captured) -> tuple[dict[str, list[str]], str]:
    """The rows of the table by file, and what was said besides."""
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert lines[0].split() == ["file", "status", "paths", "time", "notes"]
    end = lines.index("") if "" in lines else len(lines)
    rows = {line.split()[0]: line.split()[1:] for line in lines[1:end]}
    # A long reason stands below the table, with the name of its part.
    for line in lines[end + 1 :]:
        name, _, why = line.partition(": ")
        assert rows[name][-1] == "below"
        rows[name][-1:] = why.split()
    return rows, said.err


def error_of(capsys: Captured) -> str:
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    return said.err.removeprefix("camgen: error: ").rstrip("\n")


def one_by_one(post: str, folder: Path, *sources: str) -> dict[str, bytes]:
    folder.mkdir()
    for source in sources:
        assert main(["build", source, "--post", post, "-o", str(folder), "-q"]) == 0
    return files(folder)


@pytest.mark.parametrize("post", ["rapid", "pacscript"])
def test_same_bytes_as_one_by_one(post: str, here: Path, capsys: Captured) -> None:
    Path("parts/b.toml").write_text("[tool]\ndiameter = 4.0\n")
    alone = one_by_one(post, here / "alone", "parts/a.dxf", "parts/b.dxf", "parts/c.dxf")
    capsys.readouterr()
    assert main(["batch", "parts/*", "--post", post, "--jobs", "2", "-o", "out"]) == 0
    rows, said = table(capsys)
    assert list(rows) == [
        "parts/a.dxf",
        "parts/b.dxf",
        "parts/c.dxf",
    ]  # the job file b.toml is none of the inputs
    assert [row[:2] for row in rows.values()] == [["built", "2"]] * 3
    made = files(here / "out")
    assert made.pop(state.NAME).count(b"\n") == 3
    assert made == alone
    assert said.splitlines()[-1].split(maxsplit=1) == ["batch", "3 parts: 3 built"]
    assert sorted(line.split()[0] for line in said.splitlines()[:-1]) == ["built"] * 3


@pytest.mark.usefixtures("ready_builders")
def test_a_second_run_builds_only_what_changed(here: Path, capsys: Captured) -> None:
    command = ["batch", "parts/*.dxf", "--post", "gcode", "--jobs", "1", "-o", "out"]

    def again(*more: str) -> list[str]:
        capsys.readouterr()
        assert main([*command, *more]) == 0
        return [row[0] for row in table(capsys)[0].values()]

    assert again() == ["built"] * 3
    first = files(here / "out")
    assert again() == ["unchanged"] * 3
    assert files(here / "out") == first
    (here / "parts/a.dxf").write_text(PLATE.format(radius=7))
    (here / "out/b.ngc").unlink()
    (here / "out/c.ngc").write_bytes(first["c.ngc"] + b"\n")
    assert again() == ["built"] * 3
    assert {**files(here / "out"), "a.ngc": b"", state.NAME: b""} == {
        **first,
        "a.ngc": b"",
        state.NAME: b"",
    }
    (here / "parts/b.toml").write_text("[tool]\ndiameter = 4.0\n")
    assert again() == ["unchanged", "built", "unchanged"]
    assert again("--set", "process.feed=11") == ["built"] * 3
    assert again("--set", "process.feed=11") == ["unchanged"] * 3
    job = '[tool]\nfile = "../shop.toml"\n[[operations]]\ntool = "mill"\n'
    (here / "parts/b.toml").write_text(job)
    (here / "shop.toml").write_text('[[tools]]\nname = "mill"\ndiameter = 5.0\n')
    again()
    assert again() == ["unchanged"] * 3
    (here / "shop.toml").write_text('[[tools]]\nname = "mill"\ndiameter = 6.0\n')
    assert again() == ["unchanged", "built", "unchanged"]


@pytest.mark.usefixtures("ready_builders")
def test_a_cut_off_state_costs_its_last_part_only(here: Path, capsys: Captured) -> None:
    command = ["batch", "parts/*.dxf", "--post", "gcode", "--jobs", "1", "-o", "out"]
    assert main(command) == 0
    file = here / "out" / state.NAME
    file.write_bytes(file.read_bytes()[:-9])
    capsys.readouterr()
    assert main(command) == 0
    assert [row[0] for row in table(capsys)[0].values()] == ["unchanged", "unchanged", "built"]


@pytest.mark.usefixtures("ready_builders")
def test_failures_are_listed_and_stop_no_other(here: Path, capsys: Captured) -> None:
    (here / "parts/bad.dxf").write_text("no drawing")
    (here / "parts/b.toml").write_text("[tool]\ndiametre = 4\n")
    line = PLATE.format(radius=1).replace("CIRCLE", "POINT")  # an outline alone
    (here / "parts/open.dxf").write_text(
        line.replace("11\n0\n21\n0\n0\nENDSEC", "11\n0\n21\n30\n0\nENDSEC")
    )
    words = ["batch", "parts/*.dxf", "--post", "gcode", *ONE, "-o", "out"]
    assert main([*words, "--report", "r.json"]) == 3
    rows, said = table(capsys)
    assert [row[:2] for row in rows.values()] == [
        ["built", "2"],
        ["failed", "2"],
        ["failed", "2"],
        ["built", "2"],
        ["failed", "3"],
    ]
    assert 'parts/b.dxf: parts/b.toml: unknown key "diametre" ([tool]); nearest is diameter' in said
    assert "5 parts: 2 built, 3 failed" in said
    report = json.loads((here / "r.json").read_text())
    assert [part["exit_code"] for part in report["parts"]] == [0, 2, 2, 0, 3]
    assert report["parts"][0]["files"] == ["out/a.ngc"]
    assert report["parts"][0]["work_mm"] == pytest.approx(
        300 + 6 * 3.14159265 + 2 * 3.14159265 * 5, abs=1e-3
    )
    assert report["parts"][4]["error"].startswith("open.dxf: no path is left")
    assert set(files(here / "out")) == {"a.ngc", "c.ngc", state.NAME}


@pytest.mark.parametrize("jobs", ["1", "3"])
def test_a_part_that_kills_its_process_fails_alone(jobs: str, here: Path, capsys: Captured) -> None:
    (here / "fatal.py").write_text(FATAL)
    for name in ("killed", "segfault", "leaves", "memory"):
        shutil.copy("parts/a.dxf", f"parts/{name}.dxf")
    assert main(["batch", "parts/*.dxf", "--post", "./fatal.py", "--jobs", jobs, "-o", "out"]) == 1
    rows, said = table(capsys)
    status = {Path(name).stem: " ".join(row[:2]) for name, row in rows.items()}
    good = dict.fromkeys("abc", "built 2")
    assert status == good | dict.fromkeys(["killed", "segfault", "leaves", "memory"], "failed 1")
    for name, why in (
        ("killed", "the process that built it died (SIGKILL)"),
        ("segfault", "the process that built it died (SIGSEGV)"),
        ("leaves", "the process that built it died (exit code 7)"),
        ("memory", "fault: MemoryError: no more"),
    ):
        assert f"failed    parts/{name}.dxf: {why}\n" in said
    assert set(files(here / "out")) == {"a.ngc", "b.ngc", "c.ngc", state.NAME}


def test_a_part_that_hangs_is_stopped_and_no_other(
    here: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of the batch stands still until the part hangs, and later again: nothing else is late."""
    (here / "fatal.py").write_text(FATAL)
    shutil.copy("parts/a.dxf", "parts/hangs.dxf")
    monkeypatch.setattr(
        "camgen.batch.pool.monotonic", lambda: 100.0 if Path("hangs").exists() else 0.0
    )
    words = [
        "batch",
        "parts/[ac].dxf",
        "parts/hangs.dxf",
        "parts/b.dxf",
        "--post",
        "./fatal.py",
        "--jobs",
        "1",
    ]
    assert main([*words, "--timeout", "0.1", "-o", "out"]) == 1
    rows, said = table(capsys)
    assert {Path(name).stem: row[0] for name, row in rows.items()} == {
        "a": "built", "b": "built", "c": "built", "hangs": "failed",
    }  # fmt: skip
    assert "failed    parts/hangs.dxf: was stopped, it took longer than --timeout\n" in said
    assert set(files(here / "out")) == {"a.ngc", "b.ngc", "c.ngc", state.NAME}


@pytest.mark.usefixtures("ready_builders")
def test_folders_from_the_first_wildcard_on_are_kept(here: Path, capsys: Captured) -> None:
    for name in ("parts/left", "parts/right/deep"):
        Path(name).mkdir(parents=True)
        shutil.copy("parts/a.dxf", f"{name}/a.dxf")
    assert (
        main(["batch", "parts/**/*.dxf", "parts/a.dxf", "--post", "gcode", *ONE, "-o", "out"]) == 0
    )
    assert set(files(here / "out")) == {
        "a.ngc", "b.ngc", "c.ngc", "left/a.ngc", "right/deep/a.ngc", state.NAME,
    }  # fmt: skip
    capsys.readouterr()
    assert (
        main(
            [
                "batch",
                "parts/*/a.dxf",
                "parts/right/deep/a.dxf",
                "--post",
                "gcode",
                *ONE,
                "-o",
                "two",
            ]
        )
        == 0
    )
    assert set(files(here / "two")) == {"a.ngc", "left/a.ngc", state.NAME}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nothing/*.dxf"], "nothing/*.dxf: no file matches; "),
        (["parts/none.dxf"], "parts/none.dxf: no such file; "),
        (["parts"], "parts: is a folder; "),
        (["parts/*.dxf", "--jobs", "0"], "--jobs: must be 1 or more, not 0"),
        (["parts/*.dxf", "--timeout", "nan"], "--timeout: must be 0 or more seconds, not nan"),
        (
            ["parts/*.dxf", "--set", "tool.x=1"],
            '--set tool.x=1: unknown key "x" ([tool]); one of file, name, ',
        ),
        (["parts/*.dxf", "--job", "no.toml"], "no.toml: cannot be read: "),
        (["parts/*.dxf", "-o", "parts/a.dxf"], "parts/a.dxf: is not a folder; "),
        (
            ["parts/*.dxf", "--dask", "tcp://x:1", "--jobs", "2"],
            "--dask: the cluster has its own limits",
        ),
        (
            ["parts/a.dxf", "other/A.dxf"],
            "parts/a.dxf: its program would have the same name as that of other/A.dxf (a.ngc); ",
        ),
        (
            ["parts/*.dxf", "--set", "post.program=x"],
            "parts/b.dxf: its program would have the same name as that of parts/a",
        ),
        (
            ["old/*.ngc", "-o", "old"],
            "old/x.ngc: its program would overwrite a file that is read (x.ngc); ",
        ),
    ],
)
def test_what_is_wrong_for_all_is_said_at_once(
    words: list[str], says: str, here: Path, capsys: Captured
) -> None:
    (here / "other").mkdir()
    (here / "other/A.dxf").write_text(PLATE.format(radius=8))
    (here / "old").mkdir()
    (here / "old/x.ngc").write_text("G21 G90\nG1 X1 F100\nM2\n")
    before = files(here)
    assert main(["batch", *words, "--post", "gcode"]) == 2
    assert error_of(capsys).startswith(says)
    assert files(here) == before


@pytest.mark.usefixtures("ready_builders")
def test_a_program_of_several_files_never_takes_anothers_name(here: Path, capsys: Captured) -> None:
    shutil.copy("parts/a.dxf", "parts/a_part1.dxf")
    Path("parts/a.toml").write_text("[post]\nmax_lines = 10\n")
    assert main(["batch", "parts/a*.dxf", "--post", "rapid", *ONE, "-o", "out"]) == 2
    rows, said = table(capsys)
    assert [row[:2] for row in rows.values()] == [["failed", "2"], ["built", "2"]]
    assert "its program would overwrite that of parts/a_part1.dxf" in said
    assert set(files(here / "out")) == {"a_part1.mod", state.NAME}


@pytest.mark.usefixtures("here", "ready_builders")
def test_a_later_batch_replaces_no_program_of_another_part(capsys: Captured) -> None:
    words = ["--post", "pacscript", *ONE, "-o", "out"]
    for name in ("日本", "中国"):
        Path(f"{name}.dxf").write_text(PLATE.format(radius=8))
    assert main(["batch", "日本.dxf", *words]) == 0
    before = files(Path("out"))
    assert main(["batch", "中国.dxf", *words]) == 2
    assert "job___.pcs: is the program of another part" in capsys.readouterr().out
    assert files(Path("out"))["job___.pcs"] == before["job___.pcs"]
    assert main(["batch", "日本.dxf", *words, "--set", "process.feed=10"]) == 0
    assert files(Path("out"))["job___.pcs"] != before["job___.pcs"]


@pytest.mark.usefixtures("ready_builders")
def test_a_fault_tells_its_trace_when_asked(here: Path, capsys: Captured) -> None:
    (here / "fatal.py").write_text(FATAL)
    shutil.copy("parts/a.dxf", "parts/memory.dxf")
    command = ["batch", "parts/memory.dxf", "--post", "./fatal.py", *ONE, "-o", "out"]
    assert main(command) == 1
    assert "Traceback" not in capsys.readouterr().err
    assert main([*command, "-vv"]) == 1
    said = capsys.readouterr().err
    assert "trace     Traceback (most recent call last):\n" in said
    assert "trace     MemoryError: no more\n" in said


@pytest.mark.usefixtures("here", "ready_builders")
def test_a_terminal_gets_a_bar(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal(sys.stdout, is_interactive=True)
    monkeypatch.setattr("camgen.cli.make_terminal", lambda *_, **__: terminal)
    assert main(["batch", "parts/*.dxf", "--post", "gcode", *ONE, "-o", "out"]) == 0
    said = capsys.readouterr().err
    assert "\r\x1b[2K[########----------------] 1 of 3, 0 failed, about " in said
    assert f"\r\x1b[2K[{'#' * 24}] 3 of 3, 0 failed, about 0.0 s left" in said
    assert said.endswith("\r\x1b[2Kbatch     3 parts: 3 built\n")


@pytest.mark.usefixtures("ready_builders")
def test_quiet_says_only_what_failed(here: Path, capsys: Captured) -> None:
    (here / "parts/bad.dxf").write_text("no drawing")
    assert main(["batch", "parts/*.dxf", "--post", "gcode", *ONE, "-o", "out", "-q"]) == 2
    assert error_of(capsys).startswith("parts/bad.dxf: ")


@pytest.mark.usefixtures("ready_builders")
def test_strict(here: Path, capsys: Captured) -> None:
    narrow = PLATE.format(radius=2)  # a hole that the tool does not fit
    (here / "parts/b.dxf").write_text(narrow)
    options = ["--set", "tool.kind=pen", "--strict"]
    assert main(["batch", "parts/*.dxf", "--post", "gcode", *ONE, "-o", "out", *options]) == 3
    rows, _ = table(capsys)
    assert [row[0] for row in rows.values()] == ["built", "failed", "built"]


def _hear_interrupts() -> None:
    """Tests that a shell runs in the background inherit that Ctrl-C is not heard."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="sends signals of POSIX")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_is_ended_goes_on_where_it_was(
    how: signal.Signals, here: Path, capsys: Captured
) -> None:
    """One of its two processes hangs until the batch is run again, so it cannot be done before it is ended."""
    (here / "fatal.py").write_text(FATAL)
    for name in ("d", "e", "f", "g", "hangs", "i", "j"):
        (here / f"parts/{name}.dxf").write_text(PLATE.format(radius=8 + ord(name[0]) % 10 / 10))
    command = ["batch", "parts/*.dxf", "--post", "./fatal.py", "--jobs", "2", "-o", "out"]
    with subprocess.Popen(
        [sys.executable, "-m", "camgen", *command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=_hear_interrupts,  # noqa: PLW1509 (nothing else runs in this process but what starts it)
    ) as process:
        wait_for(
            "programs",
            lambda: len(list((here / "out").glob("*.ngc"))) >= 5 and (here / "hangs").exists(),
        )
        if how == signal.SIGINT:
            os.killpg(process.pid, how)  # as a terminal does: to the workers, too
        else:
            process.kill()
        process.wait(LONG)
        (here / "goes on").touch()
        said = process.communicate(timeout=LONG)[1]
    done = files(here / "out")
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "of 10 not built; the same command continues from here" in said.splitlines()[-1]
        assert "Traceback" not in said
        assert not [name for name in done if name.startswith(".")]
    times = {
        name: (here / "out" / name).stat().st_mtime_ns for name in done if name.endswith(".ngc")
    }
    assert 5 <= len(times) < 10
    assert main(command) == 0
    rows, _ = table(capsys)
    unchanged = [name for name, row in rows.items() if row[0] == "unchanged"]
    assert len(unchanged) >= len(times) - 1  # one may have been written and not yet recorded
    for name in unchanged:
        program = f"{Path(name).stem}.ngc"
        assert (here / "out" / program).stat().st_mtime_ns == times[program]
    alone = one_by_one(
        "./fatal.py", here / "alone", *sorted(str(p) for p in Path("parts").glob("*.dxf"))
    )
    made = {name: data for name, data in files(here / "out").items() if name.endswith(".ngc")}
    assert made == alone


@pytest.mark.skipif(os.name == "nt", reason="looks at processes as POSIX has them")
def test_workers_end_with_a_batch_that_is_killed(here: Path) -> None:
    (here / "fatal.py").write_text(FATAL)
    shutil.copy("parts/a.dxf", "parts/hangs.dxf")
    command = ["batch", "parts/hangs.dxf", "--post", "./fatal.py", "--jobs", "1", "-o", "out"]
    with subprocess.Popen(
        [sys.executable, "-m", "camgen", *command], stderr=subprocess.DEVNULL
    ) as process:
        wait_for(
            "the worker's number",
            lambda: (here / "hangs").exists() and (here / "hangs").read_text(),
        )
        process.kill()
    (here / "goes on").touch()
    wait_for("the worker's end", lambda: _ended(int((here / "hangs").read_text())))


def _ended(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and ") Z " in stat.read_text()  # ended, and nobody asked yet
