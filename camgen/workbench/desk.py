"""What lives while the workbench is open: the session, its last good build, and the pages that show it."""

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

from camgen.batch.writing import check_programs, check_targets, is_edited, write_all
from camgen.model.errors import CamgenError, JobError
from camgen.model.text import counted
from camgen.read.files import Files, identity
from camgen.workbench import session as steps
from camgen.workbench.builder import Builder, Heard, Stage, Stopped
from camgen.workbench.choose import left_out
from camgen.workbench.form import Form, form
from camgen.workbench.job_text import keeps_comments, write_job
from camgen.workbench.journal import Journal, Leftover, list_leftovers
from camgen.workbench.perform import Ask, Built, Failed, Looked, Proposed, Tell
from camgen.workbench.session import Change, Session, Tables
from camgen.workbench.usual import Usual, usual_of

#: A change is built after this pause, s, so that a slider does not start a build for each of its places.
_PAUSE = 0.15
#: Files are looked at so often, s.
_LOOK = 1.0
_NOTHING = Looked("")
Stamp = tuple[int, int] | None
#: Writes a line about the journal on the command line.
Warn = Callable[[str], None]


class Edited(JobError):
    """Programs that Save would replace were changed by hand.

    names: their file names
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        what = "was changed by hand since camgen wrote it"
        remedy = "replace it, or move it away and save again"
        super().__init__(", ".join(map(str, paths)), what, remedy=remedy)
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
    """Only the thread of its event loop touches it."""

    def __init__(self, session: Session, tell: Tell, warn: Warn) -> None:
        self.session = session
        self._warn = warn
        self.journal = Journal(session)
        #: Texts that are typed in the page and not yet applied, by their place in the job.
        self._drafts: dict[tuple[str | int, ...], Change] = {}
        #: Journals of earlier workbenches, which the page offers one after the other.
        self._offers: list[Leftover] = []
        #: Counts what was asked for; that of a build is in the address of its page.
        self.number = 0
        self.built: Built | None = None
        self.failed: Failed | None = None
        self.stage = ""
        #: What the pages are told beside that: what was written, what changed on the disk.
        self.told = ""
        self.changed_outside = False
        self.closing = False
        #: Whether a page has been opened.
        self.is_visited = False
        self.form: Form = form(session.post)
        self._listeners: set[asyncio.Queue[None]] = set()
        self._idle = asyncio.Event()
        self._pause: asyncio.TimerHandle | None = None
        self._stamps: dict[Path, Stamp] = {}
        loop = asyncio.get_running_loop()
        self._loop = loop
        self.builder = Builder(tell, self._hear, loop)
        self.look_at_files()
        self.ask()

    # Building.

    def ask(self, propose: bool = False) -> None:
        """Builds the job as it is now, and gives up what is built."""
        if self._pause is not None:
            self._pause.cancel()
        if self.closing:
            return
        self.number += 1
        one = self.session
        text = one.text if one.tables or one.base else ""
        ask = Ask(self.number, one.inputs, one.post, one.job_file, text, one.output, propose)
        self.stage = "proposing" if propose else "reading"
        self._idle.clear()
        self.builder.ask(ask)
        self.tell_all()

    def _hear(self, heard: Heard) -> None:
        if heard.number != self.number:
            # Of a build that a newer change has replaced: it is shown until that is built, and never saved.
            if isinstance(heard, Built):
                self.built = heard
        elif isinstance(heard, Stage):
            self.stage = heard.name
        else:
            self._take(heard)
        self.tell_all()

    def _take(self, heard: Built | Failed | Proposed | Stopped) -> None:
        """How the newest build ended."""
        self.stage = ""
        self._idle.set()
        if isinstance(heard, Built):
            self.built, self.failed = heard, None
            self.look_at_files()
        elif isinstance(heard, Failed):
            self.failed = heard
        elif isinstance(heard, Stopped):
            self.failed = Failed(heard.number, self._tell_stopped(), 130, (), {})
        else:
            tables: Tables = {
                **self.session.tables,
                "tools": list(heard.tools),
                "operations": list(heard.operations),
            }
            tables = steps.put(tables, ["stock", "thickness"], heard.thickness)
            self._keep(steps.step(self.session, tables))
            self.told = "depths and speeds are placeholders: measure the material, set them for tool and material"
            self.ask()

    def _tell_stopped(self) -> str:
        """The line of a build that was given up."""
        if self.built is None:
            return "stopped: there is no program yet"
        return "stopped: what is shown is the last good program"

    def become(self, session: Session) -> None:
        """Another state of the job: it is built after a short pause."""
        if session.post != self.session.post:
            self.form = form(session.post)
        if session.step == self.session.step:
            self._keep(session)
            self.tell_all()
            return
        self._keep(session)
        self.told = ""
        if self.closing:
            return
        self.number += 1  # what is built meanwhile is not of this job
        self._idle.clear()
        self.stage = "waiting"
        if self._pause is not None:
            self._pause.cancel()
        self._pause = self._loop.call_later(_PAUSE, self.ask)
        self.tell_all()

    def stop(self) -> None:
        """Gives up the build that runs; the last good one stays."""
        if self._pause is not None:
            self._pause.cancel()
        if self.stage == "waiting":
            self._take(Stopped(self.number))
        self.builder.stop()
        self.tell_all()

    # The journal.

    def _keep(self, session: Session) -> None:
        """Puts a session in the place of the present one, once its journal is on the disk."""
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
            changes = counted(leftover.changes, "change")
            text = (
                f"{changes} of {self.session.job_file} that were not saved are in {leftover.path}"
            )
            self._warn(f"{text}; the page offers them")
            self.tell_all()

    def answer_offer(self, counts: bool) -> None:
        """The user decided about the journal that is offered.

        counts: whether its changes are taken up, each as one that can be undone; else it is removed
        """
        if not self._offers:
            raise JobError("page", "no changes are offered any more", remedy="reload it")
        leftover = self._offers.pop(0)
        if counts:
            for session in leftover.resume(self.session):
                self.become(session)
            self._apply(leftover.drafts)
        # What this workbench could not write down is offered again.
        leftover.close(keep=counts and bool(self.journal.fault))
        self.tell_all()

    def change(self, changes: Sequence[Change]) -> None:
        """Applies changes of a page. JobError if the job has no place for one of them."""
        for change in changes:
            self._drafts.pop(tuple(change.path), None)
        try:
            session = steps.change(self.session, changes)
        except CamgenError:
            self._keep(self.session)
            raise
        self.become(session)

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
                session = steps.change(self.session, [draft])
            except CamgenError as error:
                refused = f"error: {error}"
                continue
            self.become(session)
        if refused:
            self.told = refused

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
            what = "was changed by somebody else"
            raise JobError(
                str(self.session.job_file),
                what,
                remedy="say which one counts: the file or the form",
            )
        one, built = self.session, self.built
        if built is None or built.number != self.number:
            why = self.failed.line.removeprefix("error: ") if self.failed else "nothing is built"
            raise JobError("save", f"there is no program to save: {why}")
        text = one.text
        files = [(one.job_file, text.encode())] if one.tables or one.base else []
        files += built.programs
        check_targets([path for path, _ in files], built.opened.values())
        check_programs(built.programs)
        edited = [] if replace_edited else [path for path, _ in built.programs if is_edited(path)]
        if edited:
            raise Edited(edited)
        write_all(files, built.opened)
        lost = one.base and not keeps_comments(one.base, text)
        self.session = replace(one, base=text if files[0][0] == one.job_file else "")
        self.journal.begin(self.session)
        self._keep(self.session)
        self._stamps[one.job_file] = stamp_of(one.job_file)
        self.told = f"written: {', '.join(str(path) for path, _ in files)}"
        self.told += f"; comments of {one.job_file} are lost" if lost else ""
        self.tell_all()
        return [path for path, _ in files]

    def look_at_files(self) -> None:
        """Remembers how the files are that a build reads; those that are known, as they were before that."""
        opened = self.built.opened.values() if self.built else ()
        paths = (*self.session.inputs, self.session.job_file, *opened)
        self._stamps = {
            path: self._stamps[path] if path in self._stamps else stamp_of(path) for path in paths
        }

    async def watch_files(self) -> None:
        """Builds again whenever a file changes on the disk, and finds journals that are left."""
        while not self.closing:
            await asyncio.sleep(_LOOK)
            await self.check_files()
            self._find_offers()

    async def check_files(self) -> None:
        """Builds again where a file has changed, and reads the job file again where nothing would be lost by it."""
        loop = asyncio.get_running_loop()
        now = await loop.run_in_executor(
            None, lambda: {path: stamp_of(path) for path in self._stamps}
        )
        changed = {
            path
            for path, stamp in now.items()
            if path in self._stamps and stamp != self._stamps[path]
        }
        if not changed:
            return
        self._stamps |= {path: now[path] for path in changed}
        if self.session.job_file in changed:
            self._job_changed()
        if changed - {self.session.job_file}:
            self.told = f"changed on the disk: {', '.join(sorted(path.name for path in changed))}"
            self.ask()

    def _job_changed(self) -> None:
        """The job file is not what it was. Where the form holds what is not saved, the user says which one counts."""
        try:
            base = (
                steps.read_base(self.session.job_file, Files())
                if self.session.job_file.exists()
                else ""
            )
        except CamgenError as error:
            self.told, self.changed_outside = str(error), True
            self.tell_all()
            return
        if base == self.session.base:
            return
        if self.session.is_saved:
            self.load_job()
        else:
            self.changed_outside = True
            self.tell_all()

    def load_job(self) -> None:
        """The job as its file has it now; what the form held can be had back by undo."""
        one = self.session
        base = steps.read_base(one.job_file, Files()) if one.job_file.exists() else ""
        tables = steps.tables_of(base)
        names = {identity(one.job_file.parent / name) for name in steps.named_files(tables)}
        self.session = steps.step(replace(one, base=base, allowed=one.allowed | names), tables)
        self.journal.begin(self.session)
        self._keep(self.session)
        self.changed_outside = False
        self.told = f"{one.job_file.name} was read again"
        self.look_at_files()
        self.ask()

    def keep_job(self) -> None:
        """The form counts; the next save replaces what somebody else has written."""
        one = self.session
        with suppress(CamgenError):  # what is no TOML is replaced as a whole
            base = steps.read_base(one.job_file, Files()) if one.job_file.exists() else ""
            self._keep(replace(one, base=base))
        self.changed_outside = False
        self.tell_all()

    # Pages.

    def tell_all(self) -> None:
        """Tells all pages that something is new."""
        for queue in self._listeners:
            with suppress(asyncio.QueueFull):  # they are told all there is when they ask
                queue.put_nowait(None)

    def join(self) -> asyncio.Queue[None]:
        """One more page."""
        queue: asyncio.Queue[None] = asyncio.Queue(1)
        queue.put_nowait(None)
        self._listeners.add(queue)
        self.is_visited = True
        return queue

    def leave(self, queue: asyncio.Queue[None]) -> None:
        """Takes a page away. The texts that are typed become changes: its fields are gone."""
        self._listeners.discard(queue)
        if not self.closing:
            self._apply_drafts()

    @property
    def pages(self) -> int:
        """How many pages show it."""
        return len(self._listeners)

    @property
    def looked(self) -> Looked:
        """What the last good build has seen of the input."""
        return self.built.looked if self.built else _NOTHING

    def state(self) -> dict[str, Any]:
        """What a page shows, as plain data; ``looked``, which may be long, is told when it is new."""
        one, built, failed = self.session, self.built, self.failed
        return {
            "number": self.number,
            "inputs": [path.name for path in one.inputs],
            "folder": one.folder.resolve().name,
            "job_file": one.job_file.name,
            "post": one.post,
            "posts": one.posts,
            "tables": plain(one.tables),
            "text": one.text,
            "saved": one.is_saved,
            "undo": len(one.before),
            "redo": len(one.after),
            "unsaved": self.journal.changes,
            "journal_fault": self.journal.fault,
            "offer": self._tell_offer(),
            "stage": self.stage,
            "told": self.told,
            "changed_outside": self.changed_outside,
            "command": command_of(one),
            "closing": self.closing,
            "built": built and self._tell_built(built),
            "failed": failed and {"line": failed.line, "code": failed.code, "place": failed.place},
            "usual": self._find_usual(),
            "picture": self._number_of_picture(),
            "left_out": left_out(one.tables, self.looked),
        }

    def _find_usual(self) -> Usual:
        """What holds where the job is silent: as in the last good build, and as the job says now."""
        built = self.built.usual if self.built else {}
        now = usual_of(self.session.tables)
        return {table: {**built.get(table, {}), **now.get(table, {})} for table in {**built, **now}}

    def _tell_built(self, built: Built) -> dict[str, Any]:
        return {
            "number": built.number,
            "rows": built.rows,
            "seconds": round(built.seconds, 2),
            "programs": [path.name for path, _ in built.programs],
            "bytes": sum(len(data) for _, data in built.programs),
        }

    def _tell_offer(self) -> dict[str, Any] | None:
        """The journal that the page offers, None without one.

        changes: number of changes that were not saved
        time: local time of the last one
        fits: whether they belong to the job file as it is now
        text: the job file with them
        """
        if not self._offers:
            return None
        leftover, session = self._offers[0], self.session
        source = session.inputs[0].name
        return {
            "changes": leftover.changes,
            "time": f"{leftover.time:%Y-%m-%d %H:%M}",
            "fits": leftover.fits(session),
            "text": write_job(session.base, leftover.steps[-1].tables, source),
        }

    def picture(self) -> str:
        """The stages of a photo, as far as the newest build came."""
        if self.failed is not None and self.failed.picture:
            return self.failed.picture
        return self.built.picture if self.built else ""

    def _number_of_picture(self) -> int:
        """Which picture it is, 0 for none."""
        if self.failed is not None and self.failed.picture:
            return self.failed.number
        return self.built.number if self.built and self.built.picture else 0


def plain(value: object) -> object:
    """What a page can read: JSON has no dates, no endless numbers, and browsers no integers beyond 2**53."""
    if isinstance(value, dict):
        return {str(key): plain(own) for key, own in value.items()}
    if isinstance(value, list):
        return [plain(own) for own in value]
    if isinstance(value, (str, bool)):
        return value
    if isinstance(value, int):
        return value if abs(value) < 2**53 else str(value)
    return value if isinstance(value, float) and math.isfinite(value) else str(value)


def stamp_of(path: Path) -> Stamp:
    """What changes when a file does: its time (ns) and its length; None where there is none."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


def command_of(session: Session) -> str:
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
