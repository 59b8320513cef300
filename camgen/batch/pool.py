"""Builders on this machine: processes that live for the whole batch, one part at a time each.

``concurrent.futures`` gives up all its processes when one of them dies and does not say which task killed it. Here
every process has a pipe of its own, so a death belongs to one part and the others do not notice.

They are spawned: fork is not there on Windows and is unsafe beside the threads of OpenCV and numpy. The import costs
half a second for each process, once.
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

from camgen.batch.state import Outcome, Task, fault


class _Worker(Struct, eq=False):
    """One process, the pipe to it, what it builds, how long a part may take (s), and until when this one may
    (``monotonic``). The time begins when the process has imported what it needs, which is no matter of the part.
    """

    process: SpawnProcess
    link: Connection
    seconds: float
    task: Task | None = None
    until: float = math.inf
    imported: bool = False

    def begin(self) -> None:
        """From now on the time of the part counts."""
        self.until = monotonic() + self.seconds if self.imported else math.inf


def run(tasks: Sequence[Task], jobs: int, seconds: float) -> Generator[tuple[Task, Outcome]]:
    """Tasks as they are done, by ``jobs`` processes. seconds: what a part may take, 0: for ever."""
    left = deque(tasks)
    workers: list[_Worker] = []
    try:
        while left or any(worker.task for worker in workers):
            workers = [worker for worker in workers if worker.task or worker.process.is_alive()]
            while left and len([w for w in workers if w.task]) < jobs:
                idle = next((worker for worker in workers if not worker.task), None)
                worker = idle or _start(seconds or math.inf)
                if worker is not idle:
                    workers.append(worker)
                if _give(worker, left[0]):
                    left.popleft()
                    continue
                workers.remove(worker)
                if (
                    worker is not idle
                ):  # one that died while it had nothing to do gets a successor, this one none
                    task = left.popleft()
                    yield (
                        task,
                        fault(
                            f"{task.source}: no process can be started ({tell_death(worker.process.exitcode)})"
                        ),
                    )
            yield from _next([worker for worker in workers if worker.task])
    finally:
        for worker in workers:
            worker.process.kill()
            worker.process.join()
            worker.link.close()


def _start(seconds: float) -> _Worker:
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,), daemon=True)
    with no_interrupt():
        process.start()
    theirs.close()  # so that the pipe ends when the process does
    return _Worker(process, ours, seconds)


@contextmanager
def no_interrupt() -> Iterator[None]:
    """A process that is started in here does not hear Ctrl-C, which is for the batch: it decides what happens."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread has to do with signals
        return
    old = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, old)


def _give(worker: _Worker, task: Task) -> bool:
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


def _next(busy: Sequence[_Worker]) -> Iterator[tuple[Task, Outcome]]:
    """What is done next, or has taken too long."""
    until = min(worker.until for worker in busy)
    ready = wait(
        [worker.link for worker in busy],
        None if until == math.inf else max(0.0, until - monotonic()),
    )
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
            yield task, fault(f"{task.source}: was stopped, it took longer than --timeout")


def _receive(worker: _Worker, task: Task) -> Outcome | None:
    """The outcome of the task; None where the process only says that it begins."""
    try:
        outcome: Outcome | None = worker.link.recv()
    except (EOFError, OSError):
        worker.process.join()
        return fault(
            f"{task.source}: the process that built it died ({tell_death(worker.process.exitcode)})"
        )
    if outcome is None:
        worker.imported = True
        worker.begin()
    return outcome


def tell_death(code: int | None) -> str:
    """How a process ended, by its exit code: the name of a signal, or the code."""
    if code is not None and code < 0:
        with suppress(ValueError):  # a signal without a name
            return signal.Signals(-code).name
    return f"exit code {code}"


def _work(link: Connection) -> None:
    """What a process does: tasks from the pipe, outcomes back, until the batch is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from camgen.batch.perform import perform  # noqa: PLC0415 (only the processes that build pay for it)

    with suppress(EOFError, OSError):  # the batch has ended or was killed
        link.send(None)
        while True:
            link.send(perform(link.recv()))
