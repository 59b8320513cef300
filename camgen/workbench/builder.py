"""The process that builds for the workbench, one build at a time; one that does not end when it is asked is killed.

It is spawned like the builders of a batch (``camgen.batch.pool``), and for the same reasons.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Protocol

from msgspec import Struct

from camgen.batch.pool import no_interrupt, tell_death
from camgen.order import may_end_early
from camgen.workbench.perform import Ask, Failed, Outcome, Tell, perform

#: So long a build that is no longer wanted may go on to the end of its stage, s; what it takes at most, s.
_GRACE, _LONGEST = 0.7, 600.0


class Stage(Struct, frozen=True):
    """What the build ``number`` is doing."""

    number: int
    name: str


class Stopped(Struct, frozen=True):
    """The build ``number`` was given up."""

    number: int


Heard = Stage | Stopped | Outcome
#: What the process is told while it builds: give it up, or end the search for a short tour and go on with the best one.
_GIVE_UP, _END_SEARCH = "give up", "end the search"


class Loop(Protocol):
    """What is needed of an event loop: the desk lives in its thread."""

    def call_soon_threadsafe(self, call: Callable[[], None], /) -> object:
        """Calls it soon, in the thread of the loop."""

    def call_later(self, seconds: float, call: Callable[[], None], /) -> object:
        """Calls it after so many seconds."""


class Builder:
    """tell: the summary of a build. hear: is told, in the thread of ``loop``, what a build says and how it ended."""

    def __init__(self, tell: Tell, hear: Callable[[Heard], None], loop: Loop) -> None:
        self._tell, self._hear, self._loop = tell, hear, loop
        self._process: SpawnProcess | None = None
        self._link: Connection | None = None
        self._busy: Ask | None = None
        self._next: Ask | None = None
        #: The stage that runs, and the build that was asked to end.
        self._stage = ""
        self._ending: Ask | None = None

    def start(self) -> None:
        """Starts the process, before it is needed: its imports take half a second."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, self._tell), daemon=True)
        with no_interrupt():
            process.start()
        theirs.close()  # so that the pipe ends when the process does
        self._process, self._link = process, ours
        threading.Thread(target=self._listen, args=(process, ours), daemon=True).start()

    def ask(self, ask: Ask) -> None:
        """Builds ``ask``, and gives up what is built now."""
        if self._busy is not None:
            self._next = ask
            self._give_up(self._busy)
            return
        if self._process is None or not self._process.is_alive():
            self.start()
        assert self._link is not None
        self._busy, self._stage = ask, ""
        with suppress(OSError):  # it has just died: who listens to it says so
            self._link.send(ask)
        self._loop.call_later(_LONGEST, lambda: self._kill(ask))

    def stop(self) -> None:
        """Ends what is built now, and what waits: a search for a short tour with the best one so far, with which the
        build goes on; all else is given up. What was asked before is killed.
        """
        self._next = None
        if self._busy is None:
            return
        if self._ending is self._busy:
            self._kill(self._busy)
        elif may_end_early(self._stage):
            self._ending = self._busy
            self._tell_process(_END_SEARCH)
        else:
            self._give_up(self._busy)

    def close(self) -> None:
        """Ends the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()
        if self._link is not None:
            self._link.close()
            self._link = None

    def _give_up(self, ask: Ask) -> None:
        self._ending = ask
        self._tell_process(_GIVE_UP)
        self._loop.call_later(_GRACE, lambda: self._kill(ask))

    def _tell_process(self, what: str) -> None:
        assert self._link is not None
        with suppress(OSError):  # it has just died: who listens to it says so
            self._link.send(what)

    def _kill(self, ask: Ask) -> None:
        """Ends the process where it still builds ``ask``."""
        if self._busy is ask:
            self.close()
            self.start()
            self._end(Stopped(ask.number))

    def _end(self, heard: Heard) -> None:
        """Tells how a build ended and begins the one that waits."""
        waiting, self._busy, self._next = self._next, None, None
        self._hear(heard)
        if waiting is not None:
            self.ask(waiting)

    def _listen(self, process: SpawnProcess, link: Connection) -> None:
        """What a process says, until it dies. In a thread of its own."""
        with suppress(
            EOFError, OSError, RuntimeError
        ):  # it has died, or was closed; the loop has ended
            while True:
                heard: Heard = link.recv()
                self._loop.call_soon_threadsafe(partial(self._take, process, heard))
        process.join()
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(partial(self._take, process, None))

    def _take(self, process: SpawnProcess, heard: Heard | None) -> None:
        """What a process said, None: that it died."""
        busy = self._busy
        if process is not self._process:
            return  # it was killed, and another one has its place
        if heard is None:
            self._process = None
            why = f"fault: the process that built it died ({tell_death(process.exitcode)})"
            if busy is not None:
                self._end(Failed(busy.number, why, 1, (), {}))
        elif busy is not None and heard.number == busy.number:
            if isinstance(heard, Stage):
                self._stage = heard.name
                self._hear(heard)
            else:
                self._end(heard)


class _GivenUp(BaseException):
    """Nobody wants the build any more."""


def _work(link: Connection, tell: Tell) -> None:
    """What the process does: builds from the pipe, their outcomes back, until the workbench is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):  # the workbench has ended
        while True:
            ask = link.recv()
            if isinstance(ask, Ask):  # what else is said is of a build that has just ended
                link.send(_perform(ask, link, tell))


def _perform(ask: Ask, link: Connection, tell: Tell) -> Outcome | Stopped:
    ending = False

    def watch(name: str) -> None:
        nonlocal ending
        while link.poll():
            if link.recv() == _GIVE_UP:
                raise _GivenUp
            ending = True
        link.send(Stage(ask.number, name.replace("Ctrl-C", "Cancel")))
        if ending and may_end_early(name):
            raise KeyboardInterrupt  # as Ctrl-C on the command line: the search alone ends, and each one after it

    try:
        return perform(ask, watch, tell)
    except _GivenUp:
        return Stopped(ask.number)
