"""Files of a batch are written completely or not at all, also if the process is killed."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from camgen.batch import writing
from camgen.batch.writing import write_all

#: A process that is killed at a call of a function of `os`, whose name and count are given.
KILLED_WRITER = """
import os, signal, sys
from pathlib import Path
from camgen.batch import writing
real = getattr(writing.os, sys.argv[1])
left = int(sys.argv[2])
def count(*args, **keywords):
    global left
    left -= 1
    if left < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*args, **keywords)
setattr(writing.os, sys.argv[1], count)
writing.write_all([(Path("old"), b"fresh"), (Path("new"), b"fresh")], {})
"""


def read_contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.fixture
def work_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").write_text("old")
    writing._remove_leftovers.cache_clear()
    return tmp_path


def write_and_kill(call: str, count: int) -> None:
    process = subprocess.run(
        [sys.executable, "-c", KILLED_WRITER, call, str(count)], capture_output=True, check=False
    )
    assert process.returncode == -signal.SIGKILL, process.stderr


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="only Linux has files without a name")
@pytest.mark.parametrize(("call", "count"), [("fsync", 0), ("fsync", 1), ("link", 0)])
def test_a_process_that_is_killed_while_it_writes_leaves_no_file(
    call: str, count: int, work_folder: Path
) -> None:
    """A file gets its name only after its bytes are on the disk."""
    write_and_kill(call, count)
    assert read_contents(work_folder) == {"old": "old"}


@pytest.mark.parametrize(
    ("call", "count"), [("link", 1), ("link", 2), ("replace", 0), ("replace", 1)]
)
def test_leftovers_of_a_process_that_was_killed_are_removed_by_the_next_one(
    call: str, count: int, work_folder: Path
) -> None:
    write_and_kill(call, count)
    assert (work_folder / "old").read_text() in ("old", "fresh")
    assert any(name.startswith(".camgen-") for name in read_contents(work_folder))
    write_all([(Path("other"), b"other")], {})
    assert set(read_contents(work_folder)) - {"new"} == {"old", "other"}


def test_only_leftovers_of_ended_processes_are_removed(work_folder: Path) -> None:
    """Files of a running process or another machine, and files with similar names, are kept."""
    kept_names = (
        f"{writing._MARK}-{os.getppid()}-0.new",
        ".camgen-00000000-999999999-0.new",
        f"{writing._MARK}-1.new",
        ".camgen",
    )
    for name in (*kept_names, f"{writing._MARK}-999999999-0.new"):
        (work_folder / name).write_text("left")
    write_all([(Path("other"), b"other")], {})
    assert set(read_contents(work_folder)) == {*kept_names, "old", "other"}


def test_a_file_that_another_process_made_meanwhile_stays(
    work_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If a file cannot be written, only the files of this call are removed."""

    def replace(*_: object) -> None:
        (work_folder / "new").write_text("of another process")
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.replace", replace)
    with pytest.raises(Exception, match="new: cannot be written: Input/output error"):
        write_all([(Path("new"), b"fresh")], {})
    assert read_contents(work_folder) == {"old": "old", "new": "of another process"}


@pytest.mark.parametrize("has_unnamed_files", [True, False])
def test_bytes_and_permissions_are_the_same_without_unnamed_files(
    has_unnamed_files: bool, work_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without unnamed files of the system, a file has a name from its start."""
    if not has_unnamed_files:
        monkeypatch.setattr(writing, "_open_unnamed", lambda _: None)
    (work_folder / "old").chmod(0o640)
    umask = os.umask(0o027)
    try:
        write_all([(Path("old"), b"fresh"), (Path("new"), b"fresh")], {})
    finally:
        os.umask(umask)
    assert read_contents(work_folder) == {"old": "fresh", "new": "fresh"}
    assert [stat.S_IMODE((work_folder / name).stat().st_mode) for name in ("old", "new")] == [
        0o640,
        0o640,
    ]
