"""Files on their way: what a killed process leaves, what the next one clears, and how it goes without names to hide."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from camgen.batch import writing
from camgen.batch.writing import write_all

#: A process that is killed when it has opened, written or named so many files.
KILLED = """
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


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").write_text("old")
    writing._remove_leftovers.cache_clear()
    return tmp_path


def kill_at(call: str, count: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", KILLED, call, str(count)], capture_output=True, check=False
    )
    assert done.returncode == -signal.SIGKILL, done.stderr


@pytest.mark.skipif(
    not hasattr(os, "O_TMPFILE"), reason="files without a name are a thing of Linux"
)
@pytest.mark.parametrize(("call", "count"), [("fsync", 0), ("fsync", 1), ("link", 0)])
def test_a_process_killed_while_it_writes_leaves_nothing(call: str, count: int, here: Path) -> None:
    """All that takes time is done before a file has a name."""
    kill_at(call, count)
    assert contents(here) == {"old": "old"}


@pytest.mark.parametrize(
    ("call", "count"), [("link", 1), ("link", 2), ("replace", 0), ("replace", 1)]
)
def test_what_one_killed_among_names_leaves_the_next_one_clears(
    call: str, count: int, here: Path
) -> None:
    kill_at(call, count)
    assert (here / "old").read_text() in ("old", "fresh")
    assert any(name.startswith(".camgen-") for name in contents(here))
    write_all([(Path("other"), b"other")], {})
    assert set(contents(here)) - {"new"} == {"old", "other"}


def test_only_what_is_nobodys_is_cleared(here: Path) -> None:
    """A file of a process that runs, of another machine, and what is merely named alike."""
    kept = (
        f"{writing._MARK}-{os.getppid()}-0.new",
        ".camgen-00000000-999999999-0.new",
        f"{writing._MARK}-1.new",
        ".camgen",
    )
    for name in (*kept, f"{writing._MARK}-999999999-0.new"):
        (here / name).write_text("left")
    write_all([(Path("other"), b"other")], {})
    assert set(contents(here)) == {*kept, "old", "other"}


def test_a_file_that_somebody_else_made_meanwhile_stays(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taking back removes what it has made, and nothing else."""

    def replace(*_: object) -> None:
        (here / "new").write_text("of another process")
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.replace", replace)
    with pytest.raises(Exception, match="new: cannot be written: Input/output error"):
        write_all([(Path("new"), b"fresh")], {})
    assert contents(here) == {"old": "old", "new": "of another process"}


@pytest.mark.parametrize("unnamed", [True, False])
def test_rights_and_bytes_are_the_same_without_files_without_names(
    unnamed: bool, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a system or a file system that has none, a file has a name from its beginning."""
    if not unnamed:
        monkeypatch.setattr(writing, "_open_unnamed", lambda _: None)
    (here / "old").chmod(0o640)
    before = os.umask(0o027)
    try:
        write_all([(Path("old"), b"fresh"), (Path("new"), b"fresh")], {})
    finally:
        os.umask(before)
    assert contents(here) == {"old": "fresh", "new": "fresh"}
    assert [stat.S_IMODE((here / name).stat().st_mode) for name in ("old", "new")] == [0o640, 0o640]
