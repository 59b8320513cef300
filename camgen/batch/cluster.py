"""Builders on other machines: the workers of a running Dask cluster.

Nothing is shared with them but the network: what a part is made from travels with its task, the program comes back as
bytes. A worker that dies loses its tasks to the others; a task that kills worker after worker is given up by Dask.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from importlib import import_module
from typing import Any

from msgspec.structs import replace

from camgen.batch.perform import list_carried, perform
from camgen.batch.state import Outcome, Task, fault
from camgen.model.errors import CamgenError, JobError
from camgen.model.job_tables import split_name
from camgen.read.files import Files

#: Seconds until a cluster that does not answer is given up.
_PATIENCE = 10


def run(tasks: Sequence[Task], address: str) -> Generator[tuple[Task, Outcome]]:
    """Tasks as they are done, by the workers of the cluster whose scheduler is at ``address``. JobError."""
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        what = "needs the package distributed"
        raise JobError(
            f"--dask {address}", what, remedy="install camgen with the extra dask"
        ) from error
    try:
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        what = (
            "no Dask scheduler answers" if isinstance(error, OSError) else f"is no address: {error}"
        )
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
            while len(running) >= _room(client):
                yield _next(done, running)
            future = client.submit(perform, packed, pure=False)
            running[future] = task
            done.add(future)
        while running:
            yield _next(done, running)


def _next(done: Iterator[Any], running: dict[Any, Task]) -> tuple[Task, Outcome]:
    future = next(done)
    task = running.pop(future)
    if future.status == "finished":
        return task, future.result()
    error = (
        "it was cancelled" if future.status == "cancelled" else type(future.exception()).__name__
    )
    return task, fault(f"{task.source}: the cluster could not build it ({error})")


def _room(client: Any) -> int:
    """How many tasks are under way: two for each thread, since one travels while the other is built."""
    threads: dict[str, int] = client.nthreads()
    return max(4, 2 * sum(threads.values()))


def _pack(task: Task) -> Task | Outcome:
    """The task with all its files; an outcome where one cannot travel."""
    try:
        if task.post.endswith(".py"):
            raise JobError(
                task.post,
                "a post from a file does not travel to a cluster",
                remedy="build without --dask",
            )
        if split_name(task.job.cell.robot):
            what = "an arm from a URDF file does not travel to a cluster"
            raise JobError(task.job_file, what, "cell.robot", "build without --dask")
        names = [str(task.source), *list_carried(task.job)]
        files = Files(limits=task.job.limits)
        return replace(task, carried=tuple((name, files.read(name).data) for name in names))
    except CamgenError as error:
        return Outcome(error.exit_code, str(error))
