"""The journal of the workbench: no change is lost, however the workbench ends."""

import asyncio
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from camgen.cli.build import list_rows
from camgen.workbench.desk import Desk, Edited
from camgen.workbench.journal import Journal, Leftover, find_state_folder, list_leftovers
from camgen.workbench.session import (
    Change,
    Session,
    add_step,
    apply_changes,
    open_session,
    redo,
    undo,
)
from tests.support.benches import Bench, Json, open_bench, start_bench
from tests.support.waiting import LONG

pytest.importorskip("uvicorn", reason="the extra workbench is not installed")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture
def work(tmp_path: Path) -> Path:
    folder = tmp_path / "work"
    folder.mkdir()
    shutil.copy(PARTS / "bracket.dxf", folder / "part.dxf")
    return folder


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The state folder of the user, for this process and for the workbenches that it starts."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


@pytest.fixture
def session(work: Path, state: Path) -> Session:
    assert state.parent == work.parent
    return open_session([work / "part.dxf"], None, [], "gcode", work, ["gcode", "rapid"])


# The folder.


@pytest.mark.parametrize(
    ("platform", "environment", "folder"),
    [
        ("linux", {"XDG_STATE_HOME": "/states"}, Path("/states/camgen")),
        ("linux", {"XDG_STATE_HOME": "states"}, Path.home() / ".local/state/camgen"),
        ("linux", {}, Path.home() / ".local/state/camgen"),
        ("darwin", {}, Path.home() / "Library/Application Support/camgen"),
        ("win32", {"LOCALAPPDATA": "/users/local"}, Path("/users/local/camgen")),
        ("win32", {}, Path.home() / "AppData/Local/camgen"),
    ],
)
def test_each_system_has_its_folder(
    platform: str, environment: dict[str, str], folder: Path
) -> None:
    assert find_state_folder(environment, platform) == folder


# The file.


def set_feed(session: Session, feed: object) -> Session:
    return apply_changes(session, [Change(["process", "feed"], feed)])


def end_workbench(journal: Journal) -> None:
    """The workbench of a journal ends."""
    journal.close(keep=True)


@contextmanager
def open_leftover(session: Session) -> Iterator[Leftover]:
    """The journal that a workbench would offer; it stays on the disk."""
    (leftover,) = list_leftovers(session.job_file)
    yield leftover
    leftover.close(keep=True)


def test_changes_are_resumed_step_by_step_without_the_undone_ones(session: Session) -> None:
    journal = Journal(session)
    sessions = [session]
    for feed in (10, 11, 12):
        sessions.append(set_feed(sessions[-1], feed))
        journal.write(sessions[-1], [])
    journal.write(undo(sessions[-1]), [])
    assert journal.changes == 2
    end_workbench(journal)
    with open_leftover(session) as leftover:
        assert leftover.changes == 2
        assert leftover.fits(session)
        resumed = list(leftover.resume(session))
    assert [entry.tables["process"]["feed"] for entry in resumed] == [10, 11]
    assert undo(undo(resumed[-1])).tables == {}
    assert redo(undo(resumed[-1])) == resumed[-1]


@pytest.mark.parametrize(
    "value", [float("inf"), 10**30, 'a"\n\\', True, [1, [2.5, "b"]], {"a b": {"c": 1}}, "\x7f"]
)
def test_each_value_is_resumed_unchanged(session: Session, value: object) -> None:
    journal = Journal(session)
    journal.write(add_step(session, {"process": {"feed": value}, "when": {"d": 1}}), [])
    end_workbench(journal)
    with open_leftover(session) as leftover:
        assert leftover.steps[-1].tables == {"process": {"feed": value}, "when": {"d": 1}}


def test_a_deleted_table_and_another_controller_are_resumed(session: Session) -> None:
    session = add_step(session, {"process": {"feed": 5}, "tool": {"diameter": 3}})
    journal = Journal(session)
    journal.write(add_step(session, {"tool": {"diameter": 3}}, "rapid"), [])
    end_workbench(journal)
    with open_leftover(session) as leftover:
        (resumed,) = leftover.resume(session)
    assert (resumed.tables, resumed.post) == ({"tool": {"diameter": 3}}, "rapid")


def test_a_line_that_was_written_in_part_is_ignored(session: Session) -> None:
    journal = Journal(session)
    journal.write(set_feed(session, 10), [])
    journal.write(set_feed(session, 11), [])
    path = journal.path
    assert path is not None
    end_workbench(journal)
    path.write_bytes(path.read_bytes()[:-3])
    with open_leftover(session) as leftover:
        assert leftover.steps[-1].tables == {"process": {"feed": 10}}


def test_a_journal_is_offered_once_after_its_workbench_ended(session: Session) -> None:
    journal = Journal(session)
    journal.write(set_feed(session, 10), [])
    assert list_leftovers(session.job_file) == []
    end_workbench(journal)
    (leftover,) = list_leftovers(session.job_file)
    assert list_leftovers(session.job_file) == []
    leftover.close(keep=False)
    assert list_leftovers(session.job_file) == []


def test_without_locks_a_workbench_leaves_out_the_journals_that_it_knows(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("camgen.workbench.journal._lock", lambda handle: handle > 0)
    journal = Journal(session)
    journal.write(set_feed(session, 10), [])
    assert list_leftovers(session.job_file, [journal.path]) == []
    (leftover,) = list_leftovers(session.job_file)
    leftover.close(keep=True)
    journal.close(keep=False)


def test_journals_of_other_jobs_and_other_versions_are_left_alone(
    session: Session, state: Path
) -> None:
    journal = Journal(session)
    journal.write(set_feed(session, 10), [])
    path = journal.path
    assert path is not None
    end_workbench(journal)
    assert list_leftovers(session.job_file.with_name("other.toml")) == []
    path.write_bytes(path.read_bytes().replace(b'"journal":1', b'"journal":2'))
    assert list_leftovers(session.job_file) == []
    assert list((state / "camgen" / "workbench").iterdir()) == [path]


def test_undone_and_saved_changes_leave_no_journal(session: Session, state: Path) -> None:
    journal = Journal(session)
    changed = set_feed(session, 10)
    journal.write(changed, [])
    journal.write(undo(changed), [])
    assert journal.changes == 0
    end_workbench(journal)
    assert list_leftovers(session.job_file) == []
    journal = Journal(session)
    journal.write(changed, [])
    journal.begin(changed)
    assert journal.changes == 0
    journal.write(undo(changed), [])
    assert journal.changes == 1
    journal.close(keep=False)
    assert list((state / "camgen" / "workbench").iterdir()) == []


def test_a_write_that_fails_is_reported_and_the_next_one_holds_its_change(
    session: Session,
) -> None:
    """The disk takes the first bytes of a line, and later has space again."""
    journal = Journal(session)
    first = set_feed(session, 10)
    journal.write(first, [])
    write_all = os.write
    second = apply_changes(first, [Change(["tool", "diameter"], 4)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "camgen.workbench.journal.os.write", lambda handle, data: write_all(handle, data[:9])
        )
        journal.write(second, [])
    assert "disk is full" in journal.fault
    assert journal.path is None
    journal.write(set_feed(second, 12), [])
    assert journal.fault == ""
    end_workbench(journal)
    with open_leftover(session) as leftover:
        assert leftover.steps[-1].tables == {"process": {"feed": 12}, "tool": {"diameter": 4}}


# The workbench.


def kill(bench: Bench) -> None:
    bench.process.send_signal(signal.SIGKILL)
    bench.process.wait(LONG)


def wait_for_offer(bench: Bench) -> Json:
    """The state in which a journal is offered."""
    return bench.wait(lambda state: not state["stage"] and state["offer"])


def test_changes_and_a_text_that_is_typed_survive_a_kill(work: Path, state: Path) -> None:
    with open_bench(work, ["part.dxf"], state) as bench:
        bench.change("process", "feed", raw="31")
        bench.change("tool", "diameter", value=4)
        assert bench.post("post", post="grbl")[0] == 200
        assert bench.post("draft", path=["process", "plunge"], raw="7")[0] == 200
        kill(bench)
    assert [path.name for path in work.iterdir()] == ["part.dxf"]
    with open_bench(work, ["part.dxf"], state) as bench:
        offer = wait_for_offer(bench)
        assert offer["tables"] == {}
        assert (offer["offer"]["changes"], offer["offer"]["fits"]) == (4, True)
        assert "feed = 31\n" in offer["offer"]["text"]
        assert bench.post("journal", counts=True)[0] == 200
        resumed = bench.wait(lambda state: not state["stage"] and not state["offer"])
        expected = {"process": {"feed": 31, "plunge": 7}, "tool": {"diameter": 4}}
        assert (resumed["tables"], resumed["post"], resumed["undo"]) == (expected, "grbl", 4)
        # After a second kill the resumed changes are offered again.
        kill(bench)
    with open_bench(work, ["part.dxf"], state) as bench:
        assert wait_for_offer(bench)["offer"]["changes"] == 4
        bench.post("journal", counts=True)
        for undone in ("plunge", "post", "diameter", "feed"):
            assert bench.post("undo")[0] == 200, undone
        assert bench.wait()["tables"] == {}
        for _ in range(4):
            assert bench.post("redo")[0] == 200
        again = bench.wait(lambda state: not state["stage"] and not state["redo"])
        assert (again["tables"], again["post"]) == (expected, "grbl")
        assert bench.post("save")[0] == 200
        assert bench.wait()["unsaved"] == 0
        bench.post("close")
        assert bench.process.wait(LONG) == 0
    assert list((state / "camgen" / "workbench").iterdir()) == []


def test_changes_of_a_job_file_that_has_changed_since_are_taken_up_or_discarded(
    work: Path, state: Path
) -> None:
    with open_bench(work, ["part.dxf"], state) as bench:
        bench.change("process", "feed", value=31)
        bench.wait()
        kill(bench)
    (work / "part.toml").write_text("[tool]\ndiameter = 3\n")
    with open_bench(work, ["part.dxf"], state) as bench:
        assert wait_for_offer(bench)["offer"]["fits"] is False
        bench.post("journal", counts=True)
        assert bench.wait()["tables"] == {"process": {"feed": 31}}
        bench.post("undo")
        assert bench.wait()["tables"] == {"tool": {"diameter": 3}}
        bench.change("process", "feed", value=5)
        kill(bench)
    with open_bench(work, ["part.dxf"], state) as bench:
        assert wait_for_offer(bench)["offer"]["fits"] is True
        bench.post("journal", counts=False)
        discarded = bench.wait(lambda state: not state["stage"] and not state["offer"])
        assert discarded["tables"] == {"tool": {"diameter": 3}}
        assert bench.post("journal", counts=True)[0] == 409
        bench.post("close")
        assert bench.process.wait(LONG) == 0


def test_a_second_workbench_offers_the_changes_when_the_first_one_has_died(
    work: Path, state: Path
) -> None:
    with open_bench(work, ["part.dxf"], state) as first:
        first.change("process", "feed", value=31)
        with open_bench(work, ["part.dxf"], state) as second:
            assert second.wait()["offer"] is None
            second.change("process", "feed", value=32)
            kill(first)
            assert wait_for_offer(second)["offer"]["changes"] == 1
            assert second.wait()["tables"] == {"process": {"feed": 32}}


def read_end(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    """Exit code of a workbench, and the lines that it wrote after its address."""
    assert process.stderr is not None
    return process.wait(LONG), process.stderr.read().splitlines()


@pytest.mark.parametrize("ending", ["close", "page", "interrupt"])
def test_the_end_names_the_journal_of_changes_that_are_not_saved(
    work: Path, state: Path, ending: str
) -> None:
    with start_bench(work, ["part.dxf"], state) as process:
        assert process.stderr is not None
        bench = Bench(process, process.stderr.readline().split()[1])
        page = bench.states()
        next(page)
        bench.change("process", "feed", value=31)
        bench.post("draft", path=["process", "plunge"], raw="7")
        if ending == "close":
            bench.post("close")
        if ending == "page":
            page.close()  # type: ignore[attr-defined]
        if ending == "interrupt":
            process.send_signal(signal.SIGINT)
        if ending != "page":
            assert list(page)[-1]["closing"]
        code, lines = read_end(process)
        page.close()  # type: ignore[attr-defined]
    (journal,) = (state / "camgen" / "workbench").iterdir()
    place = f"(kept in {journal}); camgen open offers them again"
    assert lines == [f"camgen: error: part.toml: 2 changes are not saved {place}"]
    assert code == 2
    (leftover,) = list_leftovers(work / "part.toml")
    assert leftover.changes == 2
    leftover.close(keep=False)


def test_a_folder_that_cannot_be_written_is_reported_and_the_workbench_goes_on(
    work: Path, tmp_path: Path
) -> None:
    (tmp_path / "state").write_text("a file where the folder would be")
    with start_bench(work, ["part.dxf"], tmp_path / "state") as process:
        assert process.stderr is not None
        bench = Bench(process, process.stderr.readline().split()[1])
        line = process.stderr.readline()
        assert line.startswith("journal   changes that are not saved are not kept: ")
        assert str(tmp_path / "state") in line
        assert str(tmp_path / "state") in bench.wait()["journal_fault"]
        bench.change("process", "feed", value=31)
        assert bench.wait()["tables"] == {"process": {"feed": 31}}
        bench.post("close")
        code, lines = read_end(process)
    assert code == 2
    assert len(lines) == 1
    assert "part.toml: 1 change is not saved, and lost: " in lines[0]


def test_a_text_is_applied_when_its_page_is_gone(work: Path, state: Path) -> None:
    with open_bench(work, ["part.dxf"], state) as bench:
        bench.wait()
        page = bench.states()
        next(page)
        bench.post("draft", path=["process", "feed"], raw="31")
        page.close()  # type: ignore[attr-defined]
        assert bench.wait(lambda state: state["tables"])["tables"] == {"process": {"feed": 31}}


def test_a_text_that_is_deleted_or_applied_is_not_a_draft(work: Path, state: Path) -> None:
    with open_bench(work, ["part.dxf"], state) as bench:
        bench.post("draft", path=["process", "feed"], raw="3")
        bench.post("draft", path=["process", "feed"])
        assert bench.wait()["unsaved"] == 0
        bench.post("draft", path=["process", "feed"], raw="3")
        assert bench.wait()["unsaved"] == 1
        bench.change("process", "feed", raw="20")  # the default
        assert bench.wait()["unsaved"] == 0
        status, answer = bench.post("draft", path=["nothing", "feed"], raw="3")
        assert (status, "has no place nothing.feed" in answer["line"]) == (409, True)


# The desk.


def run_with_desk(session: Session, run: Callable[[Desk], Any]) -> None:
    """Runs a coroutine with a desk in its first build."""

    async def run_desk() -> None:
        desk = Desk(session, list_rows, warn=print)
        try:
            await run(desk)
        finally:
            desk.closing = True
            desk.builder.close()
            desk.end()

    asyncio.run(run_desk())


def test_a_program_that_was_changed_by_hand_is_replaced_after_a_question(
    session: Session, work: Path
) -> None:
    program = work / "part.ngc"

    async def run(desk: Desk) -> None:
        await desk.save()
        first_bytes = program.read_bytes()
        program.write_bytes(first_bytes + b"(by hand)\n")
        desk.change([Change(["process", "feed"], 31)])
        with pytest.raises(Edited, match="changed by hand since camgen wrote it"):
            await desk.save()
        assert program.read_bytes().endswith(b"(by hand)\n")
        assert not session.job_file.exists()
        await desk.save(replace_edited=True)
        assert b"by hand" not in program.read_bytes()
        await desk.save()

    run_with_desk(session, run)


def test_a_first_build_that_is_stopped_leaves_no_program_and_can_be_repeated(
    session: Session,
) -> None:
    async def run(desk: Desk) -> None:
        desk.stop()
        await desk._idle.wait()
        assert desk.built is None
        assert desk.failed is not None
        assert desk.failed.line == "stopped: there is no program yet"
        desk.request_build()
        await desk._idle.wait()
        assert desk.built is not None
        desk.request_build()
        desk.stop()
        await desk._idle.wait()
        assert desk.failed is not None
        assert desk.failed.line == "stopped: the page shows the last good program"

    run_with_desk(session, run)
