"""The process that builds for the workbench, one request at a time.

A build that does not stop in time is killed. The process is spawned like the builders of a batch
(`camgen.batch.pool`), for the same reasons.
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

from camgen.batch.pool import format_exit, ignore_interrupts
from camgen.order import may_end_early
from camgen.workbench.perform import BuildRequest, Failed, Outcome, Summarize, run_request

#: Time in which a cancelled build may finish its stage, and maximum time of a build, s.
_GRACE, _LONGEST = 0.7, 600.0


class Stage(Struct, frozen=True):
    """The stage `name` that the request `number` has reached."""

    number: int
    name: str


class Stopped(Struct, frozen=True):
    """The request `number` was cancelled."""

    number: int


Report = Stage | Stopped | Outcome
#: Orders to the process while it builds: cancel the build, or end the search for a short tour and
#: continue with the best one.
_CANCEL, _END_SEARCH = "cancel", "end the search"


class Loop(Protocol):
    """The methods of an event loop that are used here."""

    def call_soon_threadsafe(self, call: Callable[[], None], /) -> object:
        """Call it soon, in the thread of the loop."""

    def call_later(self, seconds: float, call: Callable[[], None], /) -> object:
        """Call it after some seconds."""


class Builder:
    """Runs requests in another process.

    summarize: makes the summary of a build.
    on_report: called in the thread of `loop` with each report of a build, the last one its outcome.
    loop: event loop of the workbench.
    """

    def __init__(
        self, summarize: Summarize, on_report: Callable[[Report], None], loop: Loop
    ) -> None:
        self._summarize, self._on_report, self._loop = summarize, on_report, loop
        self._process: SpawnProcess | None = None
        self._link: Connection | None = None
        self._busy: BuildRequest | None = None
        self._next: BuildRequest | None = None
        #: The current stage, and the request that got an order to end.
        self._stage = ""
        self._ending: BuildRequest | None = None

    def start(self) -> None:
        """Start the process before it is needed: its imports take half a second."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_serve_requests, args=(theirs, self._summarize), daemon=True
        )
        with ignore_interrupts():
            process.start()
        theirs.close()  # so that the pipe ends when the process does
        self._process, self._link = process, ours
        threading.Thread(target=self._listen, args=(process, ours), daemon=True).start()

    def submit(self, request: BuildRequest) -> None:
        """Run a request, after cancelling the current one."""
        if self._busy is not None:
            self._next = request
            self._cancel(self._busy)
            return
        if self._process is None or not self._process.is_alive():
            self.start()
        self._busy, self._stage = request, ""
        self._send(request)
        self._loop.call_later(_LONGEST, lambda: self._kill(request))

    def stop(self) -> None:
        """End the current build, and forget the waiting one.

        The first call ends a search for a short tour, and the build continues with the best one so
        far; in any other stage the build is cancelled. The second call kills the process.
        """
        self._next = None
        if self._busy is None:
            return
        if self._ending is self._busy:
            self._kill(self._busy)
        elif may_end_early(self._stage):
            self._ending = self._busy
            self._send(_END_SEARCH)
        else:
            self._cancel(self._busy)

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.join()
        if self._link is not None:
            self._link.close()
            self._link = None

    def _cancel(self, request: BuildRequest) -> None:
        self._ending = request
        self._send(_CANCEL)
        self._loop.call_later(_GRACE, lambda: self._kill(request))

    def _send(self, order: BuildRequest | str) -> None:
        assert self._link is not None
        with suppress(OSError):  # The process has just died, which `_listen` reports.
            self._link.send(order)

    def _kill(self, request: BuildRequest) -> None:
        """Replace the process if it still runs `request`."""
        if self._busy is request:
            self.close()
            self.start()
            self._end(Stopped(request.number))

    def _end(self, report: Report) -> None:
        """Report the outcome of a build, and start the waiting one."""
        waiting, self._busy, self._next = self._next, None, None
        self._on_report(report)
        if waiting is not None:
            self.submit(waiting)

    def _listen(self, process: SpawnProcess, link: Connection) -> None:
        """Receive the reports of a process until it dies. Runs in its own thread."""
        # The pipe ends when the process dies or is closed; RuntimeError when the loop has ended.
        with suppress(EOFError, OSError, RuntimeError):
            while True:
                report: Report = link.recv()
                self._loop.call_soon_threadsafe(partial(self._take, process, report))
        process.join()
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(partial(self._take, process, None))

    def _take(self, process: SpawnProcess, report: Report | None) -> None:
        """Handle a report of a process; None if it has died."""
        busy = self._busy
        if process is not self._process:
            return  # It was killed and replaced.
        if report is None:
            self._process = None
            line = f"fault: the process that built it died ({format_exit(process.exitcode)})"
            if busy is not None:
                self._end(Failed(busy.number, line, 1, (), {}))
        elif busy is not None and report.number == busy.number:
            if isinstance(report, Stage):
                self._stage = report.name
                self._on_report(report)
            else:
                self._end(report)


class _Cancelled(BaseException):
    """Another request, or the user, has cancelled the build."""


def _serve_requests(link: Connection, summarize: Summarize) -> None:
    """Run the requests from the pipe and send their outcomes, until the workbench has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(EOFError, OSError):  # the workbench has ended
        while True:
            message = link.recv()
            if isinstance(message, BuildRequest):  # An order to a build that has ended is ignored.
                link.send(_run_request(message, link, summarize))


def _run_request(
    request: BuildRequest, link: Connection, summarize: Summarize
) -> Outcome | Stopped:
    must_end = False

    def watch(name: str) -> None:
        nonlocal must_end
        while link.poll():
            if link.recv() == _CANCEL:
                raise _Cancelled
            must_end = True
        link.send(Stage(request.number, name.replace("Ctrl-C", "Cancel")))
        if must_end and may_end_early(name):
            # As Ctrl-C on the command line: it ends this search, and each later one.
            raise KeyboardInterrupt

    try:
        return run_request(request, watch, summarize)
    except _Cancelled:
        return Stopped(request.number)
