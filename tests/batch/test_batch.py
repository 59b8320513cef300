import json
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
from tests.support.forks import get_server
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
#: A post that dies, hangs or faults for parts of certain names; for others it writes G-code.
FATAL_POST = """
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
#: A single builder, as each one is a process that imports all of camgen.
ONE_BUILDER = ("--jobs", "1")
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def ready_builders(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builders are forked by a server that has imported camgen.

    Tests of how a builder begins or ends do not use it. A builder imports the main module of its
    parent again, so pytest is hidden from it.
    """
    if os.name == "nt":
        return
    server = get_server()
    monkeypatch.setattr("camgen.batch.pool.get_context", lambda _: server)
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", None)
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)


@pytest.fixture
def work_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with three plates of different holes; commands run in it."""
    (tmp_path / "parts").mkdir()
    for name, radius in (("a", 8), ("b", 9), ("c", 10)):
        (tmp_path / "parts" / f"{name}.dxf").write_text(PLATE.format(radius=radius))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read_files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def read_table(capsys: Captured) -> tuple[dict[str, list[str]], str]:
    """The rows of the table by file, and the text of the error stream."""
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    assert lines[0].split() == ["file", "status", "paths", "time", "notes"]
    end = lines.index("") if "" in lines else len(lines)
    rows = {line.split()[0]: line.split()[1:] for line in lines[1:end]}
    # A long reason is below the table, with the name of its part.
    for line in lines[end + 1 :]:
        name, _, why = line.partition(": ")
        assert rows[name][-1] == "below"
        rows[name][-1:] = why.split()
    return rows, captured.err


def read_error(capsys: Captured) -> str:
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    return captured.err.removeprefix("camgen: error: ").rstrip("\n")


def build_one_by_one(post: str, folder: Path, *sources: str) -> dict[str, bytes]:
    folder.mkdir()
    for source in sources:
        assert main(["build", source, "--post", post, "-o", str(folder), "-q"]) == 0
    return read_files(folder)


@pytest.mark.parametrize("post", ["rapid", "pacscript"])
def test_a_batch_writes_the_bytes_of_single_builds(
    post: str, work_folder: Path, capsys: Captured
) -> None:
    Path("parts/b.toml").write_text("[tool]\ndiameter = 4.0\n")
    alone = build_one_by_one(
        post, work_folder / "alone", "parts/a.dxf", "parts/b.dxf", "parts/c.dxf"
    )
    capsys.readouterr()
    assert main(["batch", "parts/*", "--post", post, "--jobs", "2", "-o", "out"]) == 0
    rows, errors = read_table(capsys)
    # The job file b.toml is not an input.
    assert list(rows) == ["parts/a.dxf", "parts/b.dxf", "parts/c.dxf"]
    assert [row[:2] for row in rows.values()] == [["built", "2"]] * 3
    built_files = read_files(work_folder / "out")
    assert built_files.pop(state.NAME).count(b"\n") == 3
    assert built_files == alone
    assert errors.splitlines()[-1].split(maxsplit=1) == ["batch", "3 parts: 3 built"]
    assert sorted(line.split()[0] for line in errors.splitlines()[:-1]) == ["built"] * 3


@pytest.mark.usefixtures("ready_builders")
def test_a_second_run_builds_only_changed_parts(work_folder: Path, capsys: Captured) -> None:
    command = ["batch", "parts/*.dxf", "--post", "gcode", "--jobs", "1", "-o", "out"]

    def again(*more: str) -> list[str]:
        capsys.readouterr()
        assert main([*command, *more]) == 0
        return [row[0] for row in read_table(capsys)[0].values()]

    assert again() == ["built"] * 3
    first = read_files(work_folder / "out")
    assert again() == ["unchanged"] * 3
    assert read_files(work_folder / "out") == first
    (work_folder / "parts/a.dxf").write_text(PLATE.format(radius=7))
    (work_folder / "out/b.ngc").unlink()
    (work_folder / "out/c.ngc").write_bytes(first["c.ngc"] + b"\n")
    assert again() == ["built"] * 3
    assert {**read_files(work_folder / "out"), "a.ngc": b"", state.NAME: b""} == {
        **first,
        "a.ngc": b"",
        state.NAME: b"",
    }
    (work_folder / "parts/b.toml").write_text("[tool]\ndiameter = 4.0\n")
    assert again() == ["unchanged", "built", "unchanged"]
    assert again("--set", "process.feed=11") == ["built"] * 3
    assert again("--set", "process.feed=11") == ["unchanged"] * 3
    job = '[tool]\nfile = "../shop.toml"\n[[operations]]\ntool = "mill"\n'
    (work_folder / "parts/b.toml").write_text(job)
    (work_folder / "shop.toml").write_text('[[tools]]\nname = "mill"\ndiameter = 5.0\n')
    again()
    assert again() == ["unchanged"] * 3
    (work_folder / "shop.toml").write_text('[[tools]]\nname = "mill"\ndiameter = 6.0\n')
    assert again() == ["unchanged", "built", "unchanged"]


@pytest.mark.usefixtures("ready_builders")
def test_a_damaged_state_builds_only_its_last_part_again(
    work_folder: Path, capsys: Captured
) -> None:
    command = ["batch", "parts/*.dxf", "--post", "gcode", "--jobs", "1", "-o", "out"]
    assert main(command) == 0
    file = work_folder / "out" / state.NAME
    file.write_bytes(file.read_bytes()[:-9])
    capsys.readouterr()
    assert main(command) == 0
    assert [row[0] for row in read_table(capsys)[0].values()] == ["unchanged", "unchanged", "built"]


@pytest.mark.usefixtures("ready_builders")
def test_a_part_that_fails_is_listed_and_stops_no_other_part(
    work_folder: Path, capsys: Captured
) -> None:
    (work_folder / "parts/bad.dxf").write_text("no drawing")
    (work_folder / "parts/b.toml").write_text("[tool]\ndiametre = 4\n")
    outline = PLATE.format(radius=1).replace("CIRCLE", "POINT")
    (work_folder / "parts/open.dxf").write_text(
        outline.replace("11\n0\n21\n0\n0\nENDSEC", "11\n0\n21\n30\n0\nENDSEC")
    )
    words = ["batch", "parts/*.dxf", "--post", "gcode", *ONE_BUILDER, "-o", "out"]
    assert main([*words, "--report", "r.json"]) == 3
    rows, errors = read_table(capsys)
    assert [row[:2] for row in rows.values()] == [
        ["built", "2"],
        ["failed", "2"],
        ["failed", "2"],
        ["built", "2"],
        ["failed", "3"],
    ]
    assert (
        'parts/b.dxf: parts/b.toml: unknown key "diametre" ([tool]); nearest is diameter' in errors
    )
    assert "5 parts: 2 built, 3 failed" in errors
    report = json.loads((work_folder / "r.json").read_text())
    assert [part["exit_code"] for part in report["parts"]] == [0, 2, 2, 0, 3]
    assert report["parts"][0]["files"] == ["out/a.ngc"]
    assert report["parts"][0]["work_mm"] == pytest.approx(
        300 + 6 * 3.14159265 + 2 * 3.14159265 * 5, abs=1e-3
    )
    assert report["parts"][4]["error"].startswith("open.dxf: no path is left")
    assert set(read_files(work_folder / "out")) == {"a.ngc", "c.ngc", state.NAME}


@pytest.mark.parametrize("jobs", ["1", "3"])
def test_a_part_that_kills_its_process_fails_alone(
    jobs: str, work_folder: Path, capsys: Captured
) -> None:
    (work_folder / "fatal.py").write_text(FATAL_POST)
    for name in ("killed", "segfault", "leaves", "memory"):
        shutil.copy("parts/a.dxf", f"parts/{name}.dxf")
    assert main(["batch", "parts/*.dxf", "--post", "./fatal.py", "--jobs", jobs, "-o", "out"]) == 1
    rows, errors = read_table(capsys)
    status = {Path(name).stem: " ".join(row[:2]) for name, row in rows.items()}
    good = dict.fromkeys("abc", "built 2")
    assert status == good | dict.fromkeys(["killed", "segfault", "leaves", "memory"], "failed 1")
    for name, why in (
        ("killed", "the process that built it died (SIGKILL)"),
        ("segfault", "the process that built it died (SIGSEGV)"),
        ("leaves", "the process that built it died (exit code 7)"),
        ("memory", "fault: MemoryError: no more"),
    ):
        assert f"failed    parts/{name}.dxf: {why}\n" in errors
    assert set(read_files(work_folder / "out")) == {"a.ngc", "b.ngc", "c.ngc", state.NAME}


def test_only_a_part_that_hangs_is_stopped(
    work_folder: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of the batch is at 0 s until the part hangs, then at 100 s: only it is late."""
    (work_folder / "fatal.py").write_text(FATAL_POST)
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
    rows, errors = read_table(capsys)
    assert {Path(name).stem: row[0] for name, row in rows.items()} == {
        "a": "built",
        "b": "built",
        "c": "built",
        "hangs": "failed",
    }
    assert "failed    parts/hangs.dxf: was stopped, it took longer than --timeout\n" in errors
    assert set(read_files(work_folder / "out")) == {"a.ngc", "b.ngc", "c.ngc", state.NAME}


@pytest.mark.usefixtures("ready_builders")
def test_programs_keep_their_folders_from_the_first_wildcard_on(
    work_folder: Path, capsys: Captured
) -> None:
    for name in ("parts/left", "parts/right/deep"):
        Path(name).mkdir(parents=True)
        shutil.copy("parts/a.dxf", f"{name}/a.dxf")
    assert (
        main(
            ["batch", "parts/**/*.dxf", "parts/a.dxf", "--post", "gcode", *ONE_BUILDER, "-o", "out"]
        )
        == 0
    )
    assert set(read_files(work_folder / "out")) == {
        "a.ngc",
        "b.ngc",
        "c.ngc",
        "left/a.ngc",
        "right/deep/a.ngc",
        state.NAME,
    }
    capsys.readouterr()
    assert (
        main(
            [
                "batch",
                "parts/*/a.dxf",
                "parts/right/deep/a.dxf",
                "--post",
                "gcode",
                *ONE_BUILDER,
                "-o",
                "two",
            ]
        )
        == 0
    )
    assert set(read_files(work_folder / "two")) == {"a.ngc", "left/a.ngc", state.NAME}


@pytest.mark.parametrize(
    ("words", "message"),
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
def test_a_fault_of_the_whole_batch_is_reported_before_any_build(
    words: list[str], message: str, work_folder: Path, capsys: Captured
) -> None:
    (work_folder / "other").mkdir()
    (work_folder / "other/A.dxf").write_text(PLATE.format(radius=8))
    (work_folder / "old").mkdir()
    (work_folder / "old/x.ngc").write_text("G21 G90\nG1 X1 F100\nM2\n")
    before = read_files(work_folder)
    assert main(["batch", *words, "--post", "gcode"]) == 2
    assert read_error(capsys).startswith(message)
    assert read_files(work_folder) == before


@pytest.mark.usefixtures("ready_builders")
def test_a_program_of_several_files_does_not_overwrite_another_program(
    work_folder: Path, capsys: Captured
) -> None:
    shutil.copy("parts/a.dxf", "parts/a_part1.dxf")
    Path("parts/a.toml").write_text("[post]\nmax_lines = 10\n")
    assert main(["batch", "parts/a*.dxf", "--post", "rapid", *ONE_BUILDER, "-o", "out"]) == 2
    rows, errors = read_table(capsys)
    assert [row[:2] for row in rows.values()] == [["failed", "2"], ["built", "2"]]
    assert "its program would overwrite that of parts/a_part1.dxf" in errors
    assert set(read_files(work_folder / "out")) == {"a_part1.mod", state.NAME}


@pytest.mark.usefixtures("work_folder", "ready_builders")
def test_a_later_batch_does_not_overwrite_the_program_of_another_part(capsys: Captured) -> None:
    words = ["--post", "pacscript", *ONE_BUILDER, "-o", "out"]
    for name in ("日本", "中国"):
        Path(f"{name}.dxf").write_text(PLATE.format(radius=8))
    assert main(["batch", "日本.dxf", *words]) == 0
    before = read_files(Path("out"))
    assert main(["batch", "中国.dxf", *words]) == 2
    assert "job___.pcs: is the program of another part" in capsys.readouterr().out
    assert read_files(Path("out"))["job___.pcs"] == before["job___.pcs"]
    assert main(["batch", "日本.dxf", *words, "--set", "process.feed=10"]) == 0
    assert read_files(Path("out"))["job___.pcs"] != before["job___.pcs"]


@pytest.mark.usefixtures("ready_builders")
def test_a_fault_is_printed_with_its_trace_on_demand(work_folder: Path, capsys: Captured) -> None:
    (work_folder / "fatal.py").write_text(FATAL_POST)
    shutil.copy("parts/a.dxf", "parts/memory.dxf")
    command = ["batch", "parts/memory.dxf", "--post", "./fatal.py", *ONE_BUILDER, "-o", "out"]
    assert main(command) == 1
    assert "Traceback" not in capsys.readouterr().err
    assert main([*command, "-vv"]) == 1
    errors = capsys.readouterr().err
    assert "trace     Traceback (most recent call last):\n" in errors
    assert "trace     MemoryError: no more\n" in errors


@pytest.mark.usefixtures("work_folder", "ready_builders")
def test_a_terminal_shows_a_progress_bar(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal(sys.stdout, is_interactive=True)
    monkeypatch.setattr("camgen.cli.make_terminal", lambda *_, **__: terminal)
    assert main(["batch", "parts/*.dxf", "--post", "gcode", *ONE_BUILDER, "-o", "out"]) == 0
    errors = capsys.readouterr().err
    assert "\r\x1b[2K[########----------------] 1 of 3, 0 failed, about " in errors
    assert f"\r\x1b[2K[{'#' * 24}] 3 of 3, 0 failed, about 0.0 s left" in errors
    assert errors.endswith("\r\x1b[2Kbatch     3 parts: 3 built\n")


@pytest.mark.usefixtures("ready_builders")
def test_a_quiet_batch_reports_only_failures(work_folder: Path, capsys: Captured) -> None:
    (work_folder / "parts/bad.dxf").write_text("no drawing")
    assert main(["batch", "parts/*.dxf", "--post", "gcode", *ONE_BUILDER, "-o", "out", "-q"]) == 2
    assert read_error(capsys).startswith("parts/bad.dxf: ")


@pytest.mark.usefixtures("ready_builders")
def test_a_strict_batch_fails_a_part_with_a_warning(work_folder: Path, capsys: Captured) -> None:
    # The tool does not fit into this hole.
    (work_folder / "parts/b.dxf").write_text(PLATE.format(radius=2))
    options = ["--set", "tool.kind=pen", "--strict"]
    assert (
        main(["batch", "parts/*.dxf", "--post", "gcode", *ONE_BUILDER, "-o", "out", *options]) == 3
    )
    rows, _ = read_table(capsys)
    assert [row[0] for row in rows.values()] == ["built", "failed", "built"]


def restore_interrupts() -> None:
    """Let Ctrl-C end a process, which background jobs of a shell inherit as ignored."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="sends signals of POSIX")
@pytest.mark.parametrize("end_signal", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_is_ended_continues_in_the_next_run(
    end_signal: signal.Signals, work_folder: Path, capsys: Captured
) -> None:
    """The batch cannot finish before it is ended, as a part hangs in one of its two builders."""
    (work_folder / "fatal.py").write_text(FATAL_POST)
    for name in ("d", "e", "f", "g", "hangs", "i", "j"):
        (work_folder / f"parts/{name}.dxf").write_text(
            PLATE.format(radius=8 + ord(name[0]) % 10 / 10)
        )
    command = ["batch", "parts/*.dxf", "--post", "./fatal.py", "--jobs", "2", "-o", "out"]
    with subprocess.Popen(
        [sys.executable, "-m", "camgen", *command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # The new process runs nothing else before it starts the command.
        preexec_fn=restore_interrupts,  # noqa: PLW1509
    ) as process:
        wait_for(
            "programs",
            lambda: (
                len(list((work_folder / "out").glob("*.ngc"))) >= 5
                and (work_folder / "hangs").exists()
            ),
        )
        if end_signal == signal.SIGINT:
            # A terminal sends Ctrl-C to the builders too.
            os.killpg(process.pid, end_signal)
        else:
            process.kill()
        process.wait(LONG)
        (work_folder / "goes on").touch()
        errors = process.communicate(timeout=LONG)[1]
    files_at_end = read_files(work_folder / "out")
    if end_signal == signal.SIGINT:
        assert process.returncode == 130
        assert "of 10 not built; the same command continues from here" in errors.splitlines()[-1]
        assert "Traceback" not in errors
        assert not [name for name in files_at_end if name.startswith(".")]
    written_at = {
        name: (work_folder / "out" / name).stat().st_mtime_ns
        for name in files_at_end
        if name.endswith(".ngc")
    }
    assert 5 <= len(written_at) < 10
    assert main(command) == 0
    rows, _ = read_table(capsys)
    unchanged = [name for name, row in rows.items() if row[0] == "unchanged"]
    # The last program may have been written but not yet recorded.
    assert len(unchanged) >= len(written_at) - 1
    for name in unchanged:
        program = f"{Path(name).stem}.ngc"
        assert (work_folder / "out" / program).stat().st_mtime_ns == written_at[program]
    alone = build_one_by_one(
        "./fatal.py",
        work_folder / "alone",
        *sorted(str(path) for path in Path("parts").glob("*.dxf")),
    )
    built_files = {
        name: data
        for name, data in read_files(work_folder / "out").items()
        if name.endswith(".ngc")
    }
    assert built_files == alone


@pytest.mark.skipif(os.name == "nt", reason="reads the processes of POSIX")
def test_workers_end_with_a_batch_that_is_killed(work_folder: Path) -> None:
    (work_folder / "fatal.py").write_text(FATAL_POST)
    shutil.copy("parts/a.dxf", "parts/hangs.dxf")
    command = ["batch", "parts/hangs.dxf", "--post", "./fatal.py", "--jobs", "1", "-o", "out"]
    with subprocess.Popen(
        [sys.executable, "-m", "camgen", *command], stderr=subprocess.DEVNULL
    ) as process:
        wait_for(
            "the worker's number",
            lambda: (work_folder / "hangs").exists() and (work_folder / "hangs").read_text(),
        )
        process.kill()
    (work_folder / "goes on").touch()
    wait_for("the worker's end", lambda: has_ended(int((work_folder / "hangs").read_text())))


def has_ended(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    stat = Path(f"/proc/{process}/stat")
    # Z: the process has ended, and its parent has not read its exit code.
    return stat.exists() and ") Z " in stat.read_text()
