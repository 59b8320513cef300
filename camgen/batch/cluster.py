"""Builders on other machines: the workers of a running Dask cluster.

They share nothing but the network. So a task carries its input and the files that its job names,
and the worker reads no other file. It writes none: an `Outcome` has the bytes of all files of the
program, which the caller writes. The tasks of a worker that dies go to the others. Dask gives up a
task that kills several workers.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from importlib import import_module
from typing import Any

from msgspec.structs import replace

from camgen.batch.perform import build_task, list_carried
from camgen.batch.state import Outcome, Task, make_fault
from camgen.model.errors import CamgenError, JobError
from camgen.model.job_tables import split_name
from camgen.read.files import Files

#: Time to wait for the answer of a cluster, s.
_PATIENCE = 10


def run_on_cluster(tasks: Sequence[Task], address: str) -> Generator[tuple[Task, Outcome]]:
    """Run tasks on the cluster whose scheduler is at `address`, and yield them as they are done.

    Raises JobError if the scheduler cannot be used.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise JobError(
            f"--dask {address}",
            "needs the package distributed",
            remedy="install camgen with the extra dask",
        ) from error
    try:
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        what = f"is not an address: {error}"
        if isinstance(error, OSError):
            what = "no Dask scheduler answers"
        raise JobError(
            f"--dask {address}", what, remedy="give tcp://HOST:PORT as the scheduler prints it"
        ) from error
    with client:
        running: dict[Any, Task] = {}
        done = distributed.as_completed(loop=client.loop)
        for task in tasks:
            packed = _pack(task)
            if isinstance(packed, Outcome):
                yield task, packed
                continue
            while len(running) >= _count_slots(client):
                yield _take_outcome(done, running)
            # Without `pure=False` Dask would answer an equal task by the result of the first one.
            future = client.submit(build_task, packed, pure=False)
            running[future] = task
            done.add(future)
        while running:
            yield _take_outcome(done, running)


def _take_outcome(done: Iterator[Any], running: dict[Any, Task]) -> tuple[Task, Outcome]:
    future = next(done)
    task = running.pop(future)
    if future.status == "finished":
        return task, future.result()
    error = (
        "it was cancelled" if future.status == "cancelled" else type(future.exception()).__name__
    )
    return task, make_fault(f"{task.source}: the cluster could not build it ({error})")


def _count_slots(client: Any) -> int:
    """The number of tasks to submit: two per thread, one that is built and one that travels."""
    threads: dict[str, int] = client.nthreads()
    return max(4, 2 * sum(threads.values()))


def _pack(task: Task) -> Task | Outcome:
    """The task with all its files, or an outcome if one of them cannot be sent."""
    remedy = "build without --dask"
    try:
        if task.post.endswith(".py"):
            raise JobError(
                task.post, "a post from a file cannot be sent to a cluster", remedy=remedy
            )
        if split_name(task.job.cell.robot):
            raise JobError(
                task.job_file,
                "an arm from a URDF file cannot be sent to a cluster",
                "cell.robot",
                remedy,
            )
        names = [str(task.source), *list_carried(task.job)]
        files = Files(limits=task.job.limits)
        return replace(task, carried=tuple((name, files.read(name).data) for name in names))
    except CamgenError as error:
        return Outcome(error.exit_code, str(error))
