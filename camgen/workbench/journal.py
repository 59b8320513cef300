"""The journal: changes of a job that are not saved, on the disk before the page is answered.

A journal is a file of JSON lines in the state folder of the user, never in the folder of the part.
Its first line names the job file, each further line is a `Record`. The workbench that writes it
holds a lock on it. The system releases the lock when that process ends, however it ends, and the
next workbench of the same job file offers the changes.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import sys
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import msgspec
from msgspec import Struct

from camgen.model.toml import format_toml
from camgen.read.files import identity, reason
from camgen.workbench.session import Change, Session, Step, Tables, add_step

#: Version of the format. Journals of another version are left alone.
_VERSION = 1
#: Characters of the name of a job file that may stand in the name of its journal.
_UNSAFE = re.compile(r"[^A-Za-z0-9._-]")
#: Byte of the file that is locked on Windows, where a lock forbids reading: far beyond the text.
_LOCKED_BYTE = 1 << 40


class Head(Struct, frozen=True):
    """First line of a journal.

    journal: version of the format
    job: absolute path of the job file
    """

    journal: int
    job: str


class Record(Struct, frozen=True):
    """The difference of the job to the record before it.

    digest: hash of the job file to which the changes belong, see `find_digest`
    post: name of the controller
    text: the tables that differ, as TOML
    drop: names of the tables that are gone
    drafts: texts that are typed in fields of the page and not yet applied
    """

    digest: str
    post: str
    text: str = ""
    drop: tuple[str, ...] = ()
    drafts: tuple[Change, ...] = ()


def find_state_folder(
    environment: Mapping[str, str] = os.environ, platform: str = sys.platform
) -> Path:
    """The folder of camgen for the state of a user. RuntimeError if the user has no home."""
    if platform == "win32":
        return Path(environment.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "camgen"
    if platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "camgen"
    state = environment.get("XDG_STATE_HOME", "")
    # The XDG base directory specification demands that a relative path is ignored.
    base = Path(state) if os.path.isabs(state) else Path.home() / ".local" / "state"
    return base / "camgen"


def find_digest(base: str) -> str:
    """The hash of a job file's text."""
    return hashlib.sha256(base.encode()).hexdigest()


class Trail:
    """The steps from the saved job to the present one. An undone step leaves the trail."""

    def __init__(self, saved: Step) -> None:
        self.steps = [saved]

    def add(self, following: Step) -> None:
        """Adds a step, or takes the last one away if `following` undoes it."""
        if following == self.steps[-1]:
            return
        if len(self.steps) > 1 and following == self.steps[-2]:
            self.steps.pop()
        else:
            self.steps.append(following)

    @property
    def changes(self) -> int:
        """Number of steps from the saved job."""
        return len(self.steps) - 1 if self.steps[-1] != self.steps[0] else 0


class Journal:
    """Writes the journal of a session.

    fault: reason why changes are not on the disk, "" while they are
    """

    def __init__(self, session: Session) -> None:
        self.fault = ""
        self._job = session.job_file
        self._path: Path | None = None
        self._handle = -1
        self.begin(session)
        self._probe()

    @property
    def path(self) -> Path | None:
        """The file that holds the changes; None without changes, or if it cannot be written."""
        return None if self.fault else self._path

    @property
    def changes(self) -> int:
        """Number of changes that are not saved, drafts included."""
        return self._trail.changes + len(self._written.drafts)

    def begin(self, session: Session) -> None:
        """Starts again with a job that is saved: its journal is removed."""
        self.close(keep=False)
        self._trail = Trail(session.step)
        self._tables = session.tables
        self._written = self._first = _record(session, {}, ())

    def write(self, session: Session, drafts: Sequence[Change]) -> None:
        """Appends the job as it is now. It is on the disk on return, or `fault` says why not."""
        record = _record(session, self._tables, drafts)
        self._trail.add(session.step)
        if record == msgspec.structs.replace(self._written, text="", drop=()):
            return
        try:
            if self._handle < 0:
                self._create()
            _append(self._handle, record)
        except (OSError, ValueError, RuntimeError) as error:
            self.fault = _format_fault(error)
            return
        self.fault = ""
        self._tables, self._written = session.tables, record

    def close(self, keep: bool) -> None:
        """Releases the file. keep: whether it stays for the next workbench of the job."""
        if self._handle >= 0:
            _release(self._handle, None if keep else self._path)
        self._handle, self._path = -1, None

    def _probe(self) -> None:
        """Looks whether the folder can be written before there is anything to lose."""
        try:
            folder = _make_folder()
        except (OSError, RuntimeError) as error:
            self.fault = _format_fault(error)
            return
        if not os.access(folder, os.W_OK):
            self.fault = f"{folder} cannot be written"

    def _create(self) -> None:
        folder = _make_folder()
        for number in itertools.count():
            path = folder / f"{_stem(self._job)}-{number}.jsonl"
            with suppress(FileExistsError):
                handle = _open(path, os.O_CREAT | os.O_EXCL)
                # Another workbench may have removed the empty file before it was locked.
                if _lock(handle) and path.exists():
                    break
                os.close(handle)
        try:
            _append(handle, Head(_VERSION, os.path.abspath(self._job)))
            _append(handle, self._first)
        except OSError:
            _release(handle, path)
            raise
        self._handle, self._path = handle, path


class Leftover:
    """A journal that a workbench of the same job has left behind. It stays locked.

    steps: the saved job, then the job after each change
    drafts: texts that were typed and not applied
    digest: hash of the job file to which the changes belong
    time: local time of the last change
    """

    def __init__(self, path: Path, handle: int, records: Sequence[Record]) -> None:
        self.path, self._handle = path, handle
        tables: Tables = {}
        steps = []
        for record in records:
            tables = {name: table for name, table in tables.items() if name not in record.drop}
            tables |= tomllib.loads(record.text)
            steps.append(Step(tables, record.post))
        trail = Trail(steps[0])
        for following in steps[1:]:
            trail.add(following)
        self.steps = trail.steps
        self.drafts, self.digest = records[-1].drafts, records[-1].digest
        self.changes = trail.changes + len(self.drafts)
        self.time = datetime.fromtimestamp(os.fstat(handle).st_mtime)

    def fits(self, session: Session) -> bool:
        """Whether the job file is the one to which the changes belong."""
        return self.digest == find_digest(session.base)

    def is_saved(self, session: Session) -> bool:
        """Whether the job file holds all changes: the workbench ended while it saved."""
        saved = tomllib.loads(session.base) == self.steps[-1].tables
        return saved and not self.drafts and not self.fits(session)

    def resume(self, session: Session) -> Iterator[Session]:
        """The session after each change, without the drafts.

        One step holds all changes if they began from another job than that of the session.
        """
        steps = self.steps[1:] if self.steps[0] == session.step else self.steps[-1:]
        for following in steps:
            post = following.post if following.post in session.posts else session.post
            session = add_step(session, following.tables, post)
            yield session

    def close(self, keep: bool) -> None:
        """Releases the journal. keep: whether it is offered again."""
        _release(self._handle, None if keep else self.path)


def list_leftovers(job_file: Path, known: Collection[Path | None] = ()) -> list[Leftover]:
    """The journals of a job file whose workbench has ended, the oldest first.

    They are locked, so that no other workbench offers them. Empty if the folder cannot be read.
    known: journals to pass over, which matters on a file system without locks
    """
    try:
        folder = find_state_folder() / "workbench"
        names = [name for name in os.listdir(folder) if name.startswith(f"{_stem(job_file)}-")]
    except (OSError, RuntimeError):
        return []
    leftovers = [_read(folder / name) for name in names if folder / name not in known]
    return sorted(filter(None, leftovers), key=lambda leftover: leftover.time)


def _read(path: Path) -> Leftover | None:
    """A journal, locked. None if it is in use, cannot be read, or holds no change.

    A journal without a change is removed.
    """
    try:
        handle = _open(path, 0)
    except OSError:
        return None
    if not _lock(handle):
        os.close(handle)
        return None
    with open(handle, "rb", closefd=False) as stream:
        lines = stream.read().split(b"\n")[:-1]  # a line without its end was not written whole
    try:
        is_current = not lines or msgspec.json.decode(lines[0], type=Head).journal == _VERSION
        leftover = Leftover(path, handle, list(_decode(lines[1:]))) if lines[2:] else None
    except (msgspec.MsgspecError, tomllib.TOMLDecodeError, IndexError):
        is_current, leftover = False, None
    if leftover is None or not is_current or not leftover.changes:
        _release(handle, path if is_current else None)
        return None
    return leftover


def _decode(lines: Sequence[bytes]) -> Iterator[Record]:
    """The records of a journal. A line that a full disk has cut is passed over."""
    for line in lines:
        with suppress(msgspec.DecodeError):
            yield msgspec.json.decode(line, type=Record)


def _record(session: Session, before: Tables, drafts: Sequence[Change]) -> Record:
    """The difference of the job to the tables of the record before."""
    tables = session.tables
    changed = {name: table for name, table in tables.items() if before.get(name) != table}
    return Record(
        digest=find_digest(session.base),
        post=session.post,
        text="".join(
            f"{format_toml(name)} = {format_toml(table)}\n" for name, table in changed.items()
        ),
        drop=tuple(name for name in before if name not in tables),
        drafts=tuple(drafts),
    )


# Files.


def _make_folder() -> Path:
    """The folder of the journals, which only the user may read."""
    folder = find_state_folder() / "workbench"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _stem(job_file: Path) -> str:
    """The start of the names of a job file's journals."""
    digest = hashlib.sha256(identity(job_file).encode()).hexdigest()[:16]
    return f"{_UNSAFE.sub('_', job_file.stem)[:40]}-{digest}"


def _open(path: Path, flags: int) -> int:
    return os.open(path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0) | flags, 0o600)


def _append(handle: int, line: Head | Record) -> None:
    """Appends a line, on the disk on return. OSError if it is not whole; the file is as before."""
    data = msgspec.json.encode(line) + b"\n"
    size = os.fstat(handle).st_size
    try:
        if os.write(handle, data) < len(data):
            raise OSError("the disk is full")
        os.fsync(handle)
    except OSError:
        with suppress(OSError):
            os.ftruncate(handle, size)
        raise


def _lock(handle: int) -> bool:
    """Whether this process has the lock of a file now. A file system without locks grants it."""
    try:
        if sys.platform == "win32":
            import msvcrt  # noqa: PLC0415 (Windows only)

            os.lseek(handle, _LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            os.lseek(handle, 0, os.SEEK_SET)
        else:
            import fcntl  # noqa: PLC0415 (not on Windows)

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, (BlockingIOError, PermissionError))
    return True


def _release(handle: int, remove: Path | None) -> None:
    """Closes a file, which unlocks it. remove: its path if it is to be deleted, None keeps it.

    A file that cannot be deleted stays: if its changes are saved, it is not offered.
    """
    is_windows = sys.platform == "win32"
    if remove is not None and not is_windows:
        with suppress(OSError):
            remove.unlink()  # still locked: no other workbench offers it
    os.close(handle)
    if remove is not None and is_windows:
        with suppress(OSError):
            remove.unlink()  # Windows deletes no open file


def _format_fault(error: OSError | ValueError | RuntimeError) -> str:
    """The reason why the journal cannot be written, with the path if the system names it."""
    path = getattr(error, "filename", None)
    text = str(error) if isinstance(error, RuntimeError) else reason(error)
    return f"{path} cannot be written: {text}" if path else f"it cannot be written: {text}"
