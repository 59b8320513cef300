"""Builders on this machine: processes that live for the whole batch and build one part at a time.

`concurrent.futures` gives up all its processes when one of them dies, and does not name the task
that killed it. Here each process has its own pipe, so a death concerns one part alone.

The processes are spawned: Windows has no fork, and fork is unsafe with the threads of OpenCV and
numpy. Each process imports camgen once, which takes half a second.
"""

from __future__ import annotations

import math
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from time import monotonic

from msgspec import Struct

from camgen.batch.state import Outcome, Task, make_fault


class _Worker(Struct, eq=False):
    """One process.

    process: the process.
    link: pipe to it.
    seconds: maximum time for a part, s.
    task: task that it builds, None if it is idle.
    until: end of the time of that task, on the clock `monotonic`, s. The time starts when the
        process has imported camgen.
    imported: whether it has.
    """

    process: SpawnProcess
    link: Connection
    seconds: float
    task: Task | None = None
    until: float = math.inf
    imported: bool = False

    def begin(self) -> None:
        """Start the time of the part."""
        self.until = monotonic() + self.seconds if self.imported else math.inf


def run_local(tasks: Sequence[Task], jobs: int, seconds: float) -> Generator[tuple[Task, Outcome]]:
    """Run tasks in `jobs` processes, and yield them as they are done.

    seconds: maximum time for a part, s; 0 for no limit.
    """
    pending = deque(tasks)
    workers: list[_Worker] = []
    try:
        while pending or _list_busy(workers):
            workers = [worker for worker in workers if worker.task or worker.process.is_alive()]
            while pending and len(_list_busy(workers)) < jobs:
                idle = next((worker for worker in workers if not worker.task), None)
                worker = idle or _start(seconds or math.inf)
                if worker is not idle:
                    workers.append(worker)
                if _send_task(worker, pending[0]):
                    pending.popleft()
                    continue
                workers.remove(worker)
                # An idle process that has died is replaced. A new one that dies at once is a fault.
                if worker is not idle:
                    task = pending.popleft()
                    ending = format_exit(worker.process.exitcode)
                    yield task, make_fault(f"{task.source}: no process can be started ({ending})")
            yield from _receive_outcomes(_list_busy(workers))
    finally:
        for worker in workers:
            worker.process.kill()
            worker.process.join()
            worker.link.close()


def _list_busy(workers: Sequence[_Worker]) -> list[_Worker]:
    return [worker for worker in workers if worker.task]


def _start(seconds: float) -> _Worker:
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve_tasks, args=(theirs,), daemon=True)
    with ignore_interrupts():
        process.start()
    theirs.close()  # so that the pipe ends when the process does
    return _Worker(process, ours, seconds)


@contextmanager
def ignore_interrupts() -> Iterator[None]:
    """Start processes that ignore Ctrl-C. The batch receives it and decides what happens."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Only the main thread handles signals.
        return
    old = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, old)


def _send_task(worker: _Worker, task: Task) -> bool:
    try:
        worker.link.send(task)
    except OSError:
        worker.process.kill()
        worker.process.join()
        worker.link.close()
        return False
    worker.task = task
    worker.begin()
    return True


def _receive_outcomes(busy: Sequence[_Worker]) -> Iterator[tuple[Task, Outcome]]:
    """Wait for the next outcomes, or for the end of the time of a part."""
    until = min(worker.until for worker in busy)
    timeout = None if until == math.inf else max(0.0, until - monotonic())
    ready = wait([worker.link for worker in busy], timeout)
    for worker in busy:
        task = worker.task
        assert task is not None
        if worker.link in ready:
            if outcome := _receive(worker, task):
                worker.task = None
                yield task, outcome
        elif monotonic() >= worker.until:
            worker.task = None
            worker.process.kill()
            worker.process.join()
            what = "was stopped, it took longer than --timeout"
            yield task, make_fault(f"{task.source}: {what}")


def _receive(worker: _Worker, task: Task) -> Outcome | None:
    """The outcome of the task; None if the process reports the end of its imports."""
    try:
        outcome: Outcome | None = worker.link.recv()
    except (EOFError, OSError):
        worker.process.join()
        ending = format_exit(worker.process.exitcode)
        return make_fault(f"{task.source}: the process that built it died ({ending})")
    if outcome is None:
        worker.imported = True
        worker.begin()
    return outcome


def format_exit(code: int | None) -> str:
    """The end of a process: the name of the signal that ended it, or its exit code."""
    if code is not None and code < 0:
        with suppress(ValueError):  # a signal without a name
            return signal.Signals(-code).name
    return f"exit code {code}"


def _serve_tasks(link: Connection) -> None:
    """Build the tasks from the pipe and send their outcomes, until the batch has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from camgen.batch.perform import build_task  # noqa: PLC0415 (only in processes that build)

    with suppress(EOFError, OSError):  # the batch has ended or was killed
        link.send(None)
        while True:
            link.send(build_task(link.recv()))
