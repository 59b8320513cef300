"""The state of an open workbench: the session, its last successful build, and its pages."""

from __future__ import annotations

import asyncio
import math
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from shlex import quote
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from camgen.batch.writing import check_programs, check_targets, is_edited, list_paths, write_all
from camgen.model.errors import CamgenError, JobError
from camgen.model.text import counted
from camgen.read.files import Files, identity
from camgen.workbench import session as steps
from camgen.workbench.builder import Builder, Report, Stage, Stopped
from camgen.workbench.choose import list_left_out
from camgen.workbench.form import Form, make_form
from camgen.workbench.job_text import keeps_comments
from camgen.workbench.journal import Journal, Leftover, list_leftovers
from camgen.workbench.perform import BuildRequest, Built, Failed, InputSummary, Proposed, Summarize
from camgen.workbench.session import Change, Session, Tables
from camgen.workbench.usual import Defaults, list_defaults

#: Pause between a change and its build, s, if another build has not ended, so that a moving slider
#: does not start many builds.
_PAUSE = 0.15
#: Period in which the files on the disk are checked for changes, s.
_CHECK_PERIOD = 0.5
#: Stands for the last successful build before there is one.
_NO_BUILD = Built(0, "", (), (), InputSummary(""), {}, "", 0.0, {})
Stamp = tuple[int, int] | None
#: Writes a line about the journal on the command line.
Warn = Callable[[str], None]


class Edited(JobError):
    """Programs that Save would replace were changed by hand.

    names: their file names
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        super().__init__(
            ", ".join(map(str, paths)),
            "was changed by hand since camgen wrote it",
            remedy="replace it, or move it away and save again",
        )
        self.names = [path.name for path in paths]


class Ending(Struct, frozen=True):
    """The state of the job when the workbench ends.

    changes: number of changes that are not saved
    kept: journal that holds them, None without a journal
    fault: reason why it could not be written, "" if it was
    """

    changes: int
    kept: Path | None
    fault: str


class Desk:
    """The state of an open workbench. Only the thread of its event loop uses it."""

    def __init__(self, session: Session, summarize: Summarize, warn: Warn) -> None:
        self.session = session
        self._warn = warn
        self.journal = Journal(session)
        #: Texts that are typed in the page and not yet applied, by their place in the job.
        self._drafts: dict[tuple[str | int, ...], Change] = {}
        #: Journals of earlier workbenches, which the page offers one after the other.
        self._offers: list[Leftover] = []
        #: Number of the last request. The address of a preview has that of its build.
        self.number = 0
        self.built: Built | None = None
        self.failed: Failed | None = None
        self.stage = ""
        #: Message for the pages: files that were written, or changed on the disk.
        self.message = ""
        self.changed_outside = False
        self.closing = False
        #: Whether a page has been opened.
        self.is_visited = False
        self.form: Form = make_form(session.post)
        self._listeners: set[asyncio.Queue[None]] = set()
        self._idle = asyncio.Event()
        self._pause: asyncio.TimerHandle | None = None
        self._stamps: dict[Path, Stamp] = {}
        self._loop = asyncio.get_running_loop()
        self.builder = Builder(summarize, self._receive, self._loop)
        self.remember_files()
        self.request_build()

    # Building.

    def request_build(self, propose: bool = False) -> None:
        """Build the job as it is now, after cancelling the current build."""
        if self._pause is not None:
            self._pause.cancel()
        if self.closing:
            return
        self.number += 1
        session = self.session
        request = BuildRequest(
            number=self.number,
            inputs=session.inputs,
            post=session.post,
            job_file=session.job_file,
            text=session.text if session.tables or session.base else "",
            output=session.output,
            propose=propose,
        )
        self.stage = "proposing" if propose else "reading"
        self._idle.clear()
        self.builder.submit(request)
        self.notify_pages()

    def _receive(self, report: Report) -> None:
        if report.number != self.number:
            # A newer change has replaced this build. It is shown until the new one is ready, but
            # never saved.
            if isinstance(report, Built):
                self.built = report
        elif isinstance(report, Stage):
            self.stage = report.name
        else:
            self._take(report)
        self.notify_pages()

    def _take(self, outcome: Built | Failed | Proposed | Stopped) -> None:
        """Take over the outcome of the newest request."""
        self.stage = ""
        self._idle.set()
        if isinstance(outcome, Built):
            self.built, self.failed = outcome, None
            self.remember_files()
        elif isinstance(outcome, Failed):
            self.failed = outcome
        elif isinstance(outcome, Stopped):
            line = "stopped: the page shows the last good program"
            if self.built is None:
                line = "stopped: there is no program yet"
            self.failed = Failed(outcome.number, line, 130, (), {})
        else:
            tables: Tables = {
                **self.session.tables,
                "tools": list(outcome.tools),
                "operations": list(outcome.operations),
            }
            tables = steps.set_value(tables, ["stock", "thickness"], outcome.thickness)
            self._keep(steps.add_step(self.session, tables))
            self.message = (
                "depths and speeds are placeholders: measure the material, "
                "set them for tool and material"
            )
            self.request_build()

    def replace_session(self, session: Session) -> None:
        """Replace the state of the job, and build it: at once, or after a pause during a build."""
        if session.post != self.session.post:
            self.form = make_form(session.post)
        if session.step == self.session.step:
            self._keep(session)
            self.notify_pages()
            return
        self._keep(session)
        self.message = ""
        if self.closing:
            return
        self.number += 1  # A build that ends meanwhile is not one of this job.
        pause = 0.0 if self._idle.is_set() else _PAUSE
        self._idle.clear()
        self.stage = "waiting"
        if self._pause is not None:
            self._pause.cancel()
        self._pause = self._loop.call_later(pause, self.request_build)
        self.notify_pages()

    def stop(self) -> None:
        """Stop the current build. The last successful one stays."""
        if self._pause is not None:
            self._pause.cancel()
        if self.stage == "waiting":
            self._take(Stopped(self.number))
        self.builder.stop()
        self.notify_pages()

    # The journal.

    def _keep(self, session: Session) -> None:
        """Replace the session, and write its journal to the disk."""
        fault = self.journal.fault
        self.session = session
        self.journal.write(session, list(self._drafts.values()))
        if self.journal.fault not in ("", fault):
            self._warn_of_fault()

    def _warn_of_fault(self) -> None:
        self._warn(f"changes that are not saved are not kept: {self.journal.fault}")

    def open_journals(self) -> None:
        """Reports a journal that cannot be written, and finds those of earlier workbenches."""
        if self.journal.fault:
            self._warn_of_fault()
        self._find_offers()

    def _find_offers(self) -> None:
        """Offers the journals of workbenches that have ended since the last search."""
        known = [self.journal.path, *(offer.path for offer in self._offers)]
        for leftover in list_leftovers(self.session.job_file, known):
            if leftover.is_saved(self.session):
                leftover.close(keep=False)
                continue
            self._offers.append(leftover)
            self._warn(
                f"{counted(leftover.changes, 'change')} of {self.session.job_file} that were not "
                f"saved are in {leftover.path}; the page offers them"
            )
            self.notify_pages()

    def answer_offer(self, counts: bool) -> None:
        """The user decided about the journal that is offered.

        counts: whether its changes are taken up, each as one that can be undone; else it is removed
        """
        if not self._offers:
            raise JobError("page", "no changes are offered any more", remedy="reload it")
        leftover = self._offers.pop(0)
        if counts:
            for session in leftover.resume(self.session):
                self.replace_session(session)
            self._apply(leftover.drafts)
        # What this workbench could not write down is offered again.
        leftover.close(keep=counts and bool(self.journal.fault))
        self.notify_pages()

    def change(self, changes: Sequence[Change]) -> None:
        """Applies changes of a page. JobError if the job has no place for one of them."""
        for change in changes:
            self._drafts.pop(tuple(change.path), None)
        try:
            session = steps.apply_changes(self.session, changes)
        except CamgenError:
            self._keep(self.session)
            raise
        self.replace_session(session)

    def draft(self, change: Change) -> None:
        """Keeps a text while it is typed. One without value and text was withdrawn."""
        steps.check_place(change)
        if change.value is None and change.raw is None:
            self._drafts.pop(tuple(change.path), None)
        else:
            self._drafts[tuple(change.path)] = change
        self._keep(self.session)

    def _apply(self, drafts: Sequence[Change]) -> None:
        """Makes changes of drafts. The page shows the line of a draft that the job cannot take."""
        refused = ""
        for draft in drafts:
            try:
                session = steps.apply_changes(self.session, [draft])
            except CamgenError as error:
                refused = f"error: {error}"
            else:
                self.replace_session(session)
        if refused:
            self.message = refused

    def end(self) -> Ending:
        """Releases the journals. Changes that are not saved stay in them."""
        self._apply_drafts()
        ending = Ending(self.journal.changes, self.journal.path, self.journal.fault)
        self.journal.close(keep=ending.changes > 0)
        for leftover in self._offers:
            leftover.close(keep=True)
        return ending

    def _apply_drafts(self) -> None:
        """Makes changes of all drafts, since the page in which they were typed is gone."""
        drafts = list(self._drafts.values())
        self._drafts.clear()
        self._apply(drafts)

    # Files.

    async def save(self, replace_edited: bool = False) -> list[Path]:
        """Writes the job file and the program, as ``camgen build`` does. Returns their paths.

        JobError if the job has no program, Edited if a program was changed by hand.
        replace_edited: whether such a program is replaced
        """
        await self._idle.wait()
        await self.check_files()
        await self._idle.wait()
        if self.changed_outside:
            raise JobError(
                str(self.session.job_file),
                "was changed outside the workbench",
                remedy="choose on the page: file or form",
            )
        session, built = self.session, self.built
        if built is None or built.number != self.number:
            why = self.failed.line.removeprefix("error: ") if self.failed else "nothing is built"
            raise JobError("save", f"there is no program to save: {why}")
        text = session.text
        files = [(session.job_file, text.encode())] if session.tables or session.base else []
        files += built.programs
        paths = list_paths(files)
        check_targets(paths, built.opened.values())
        check_programs(built.programs)
        edited = [] if replace_edited else list(filter(is_edited, list_paths(built.programs)))
        if edited:
            raise Edited(edited)
        write_all(files, built.opened)
        self.session = replace(session, base=text if files[0][0] == session.job_file else "")
        self.journal.begin(self.session)
        self._keep(self.session)
        self._stamps[session.job_file] = read_stamp(session.job_file)
        self.message = f"written: {', '.join(map(str, paths))}"
        if session.base and not keeps_comments(session.base, text):
            self.message += f"; comments of {session.job_file} are lost"
        self.notify_pages()
        return paths

    def remember_files(self) -> None:
        """Remember the stamps of the files that a build reads. Known stamps stay."""
        paths = (*self.session.inputs, self.session.job_file, *self.last.opened.values())
        self._stamps = {
            path: self._stamps[path] if path in self._stamps else read_stamp(path) for path in paths
        }

    async def watch_files(self) -> None:
        """Build again after changes on the disk, and find journals of other workbenches."""
        while not self.closing:
            await asyncio.sleep(_CHECK_PERIOD)
            await self.check_files()
            self._find_offers()

    async def check_files(self) -> None:
        """Build again if a file has changed. Read the job file again if no change would be lost."""
        stamps = await asyncio.to_thread(lambda: {path: read_stamp(path) for path in self._stamps})
        new = stamps.items() - self._stamps.items()
        changed = {path: stamp for path, stamp in new if path in self._stamps}
        if not changed:
            return
        self._stamps |= changed
        if self.session.job_file in changed:
            self._job_changed()
        if changed.keys() - {self.session.job_file}:
            names = ", ".join(sorted(path.name for path in changed))
            self.message = f"changed on the disk: {names}"
            self.request_build()

    def _job_changed(self) -> None:
        """Read the changed job file. If the form has unsaved changes, the user chooses."""
        try:
            base = self._read_base()
        except CamgenError as error:
            self.message, self.changed_outside = str(error), True
            self.notify_pages()
            return
        if base == self.session.base:
            return
        if self.session.is_saved:
            self.load_job()
        else:
            self.changed_outside = True
            self.notify_pages()

    def _read_base(self) -> str:
        file = self.session.job_file
        return steps.read_base(file, Files()) if file.exists() else ""

    def load_job(self) -> None:
        """Replace the job by that of its file. Undo restores the content of the form."""
        session, base = self.session, self._read_base()
        tables = steps.parse_tables(base)
        names = {identity(session.job_file.parent / name) for name in steps.list_files(tables)}
        session = replace(session, base=base, allowed=session.allowed | names)
        self.session = steps.add_step(session, tables)
        self.journal.begin(self.session)
        self._keep(self.session)
        self.changed_outside = False
        self.message = f"{session.job_file.name} was read again"
        self.remember_files()
        self.request_build()

    def keep_job(self) -> None:
        """Keep the form. The next save replaces the changes in the file."""
        with suppress(CamgenError):  # A file that is not TOML is replaced as a whole.
            self._keep(replace(self.session, base=self._read_base()))
        self.changed_outside = False
        self.notify_pages()

    # Pages.

    def notify_pages(self) -> None:
        """Notify all pages of a new state."""
        for queue in self._listeners:
            with suppress(asyncio.QueueFull):  # The page has not yet read the previous state.
                queue.put_nowait(None)

    def join(self) -> asyncio.Queue[None]:
        """Add a page. Its queue gets an item for each new state."""
        queue: asyncio.Queue[None] = asyncio.Queue(1)
        queue.put_nowait(None)
        self._listeners.add(queue)
        self.is_visited = True
        return queue

    def leave(self, queue: asyncio.Queue[None]) -> None:
        """Remove a page. The texts typed on it become changes, since its fields are gone."""
        self._listeners.discard(queue)
        if not self.closing:
            self._apply_drafts()

    @property
    def pages(self) -> int:
        """The number of open pages."""
        return len(self._listeners)

    @property
    def last(self) -> Built:
        """The last successful build, an empty one before there is any."""
        return self.built or _NO_BUILD

    @property
    def pictured(self) -> Built | Failed:
        """The newest build with the stages of a photo. Without one, its picture is ""."""
        if self.failed is not None and self.failed.picture:
            return self.failed
        return self.last

    def state(self) -> dict[str, Any]:
        """The state for a page as plain data, without the summary of the input."""
        session, built, failed = self.session, self.built, self.failed
        return {
            "number": self.number,
            "inputs": [path.name for path in session.inputs],
            "folder": session.folder.resolve().name,
            "job_file": session.job_file.name,
            "post": session.post,
            "posts": session.posts,
            "tables": convert_plain(session.tables),
            "text": session.text,
            "saved": session.is_saved,
            "undo": len(session.before),
            "redo": len(session.after),
            "unsaved": self.journal.changes,
            "journal_fault": self.journal.fault,
            "offer": self._describe_offer(),
            "stage": self.stage,
            "told": self.message,
            "changed_outside": self.changed_outside,
            "command": format_command(session),
            "closing": self.closing,
            "built": built
            and {
                "number": built.number,
                "rows": built.rows,
                "seconds": round(built.seconds, 2),
                "programs": [path.name for path, _ in built.programs],
                "bytes": sum(len(data) for _, data in built.programs),
            },
            "failed": failed and {"line": failed.line, "code": failed.code, "place": failed.place},
            "usual": self._find_defaults(),
            "picture": self.pictured.number if self.pictured.picture else 0,
            "left_out": list_left_out(session.tables, self.last.summary),
        }

    def _find_defaults(self) -> Defaults:
        """The defaults of the last successful build, replaced by those that follow from the job."""
        built, current = self.last.usual, list_defaults(self.session.tables)
        return {name: {**built.get(name, {}), **current.get(name, {})} for name in built | current}

    def _describe_offer(self) -> dict[str, Any] | None:
        """The journal that the page offers, None without one.

        changes: number of changes that were not saved
        time: local time of the last one
        fits: whether they belong to the job file as it is now
        text: the job file with them
        """
        if not self._offers:
            return None
        leftover, session = self._offers[0], self.session
        resumed = replace(session, tables=leftover.steps[-1].tables)
        return {
            "changes": leftover.changes,
            "time": f"{leftover.time:%Y-%m-%d %H:%M}",
            "fits": leftover.fits(session),
            "text": resumed.text,
        }


def convert_plain(value: object) -> object:
    """Convert a value of TOML for a page.

    JSON has no dates and no infinite numbers, and browsers no integers beyond 2**53: these become
    texts.
    """
    if isinstance(value, dict):
        return {str(key): convert_plain(content) for key, content in value.items()}
    if isinstance(value, list):
        return list(map(convert_plain, value))
    if isinstance(value, (str, bool)):
        return value
    if isinstance(value, int):
        return value if abs(value) < 2**53 else str(value)
    return value if isinstance(value, float) and math.isfinite(value) else str(value)


def read_stamp(path: Path) -> Stamp:
    """The time (ns) and length of a file, which change when it does; None for no file."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size


def format_command(session: Session) -> str:
    """The command that writes the same program, once the job is saved."""
    words = [
        "camgen build",
        *(quote(str(path)) for path in session.inputs),
        "--post",
        quote(session.post),
    ]
    if session.job_file != session.inputs[0].with_suffix(".toml"):
        words += ["--job", quote(str(session.job_file))]
    if session.output != Path():
        words += ["-o", quote(str(session.output))]
    return " ".join(words)
