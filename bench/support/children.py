"""Work in forked children with limits of time and memory: what they give, and what ended them."""

from __future__ import annotations

import os
import resource
import signal
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, NoReturn, TypeVar

from bench.support.timing import UNITS_PER_MB

Input, Result = TypeVar("Input"), TypeVar("Result")


def map_inputs(
    work: Callable[[Input], Result], inputs: Sequence[Input], processes: int
) -> list[Result]:
    """The results of inputs in their order. One process is this one."""
    if processes == 1:
        return [work(each) for each in inputs]
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        return list(
            pool.map(work, inputs, chunksize=max(1, min(8, len(inputs) // (2 * processes))))
        )


class Limits(NamedTuple):
    """Limits of a child.

    memory: bytes of address space.
    processor: seconds of the processor in all, -1 for any.
    clock: seconds by the clock from one result to the next, None for any.
    """

    memory: int
    processor: int = resource.RLIM_INFINITY
    clock: float | None = None


class Child(NamedTuple):
    """A child that has ended.

    results: the results that it gave before it ended.
    signal: number of the signal that ended it, SIGXCPU if its time was up, 0 without a signal.
    peak: the largest resident memory, MB.
    """

    results: list[Any]
    signal: int
    peak: float


def run_in_child(work: Callable[[], Iterable[object]], limits: Limits) -> Child:
    """Runs work in a fork of this process.

    A lock that another thread holds stays locked in the child: the caller starts no threads.

    work: gives the results one by one. What it prints is thrown away.
    """
    receiver, sender = Pipe(duplex=False)
    child = os.fork()
    if child == 0:
        receiver.close()
        _work(work, limits, sender)
    sender.close()
    results, is_late = [], False
    with receiver, suppress(EOFError):
        while receiver.poll(limits.clock):
            results.append(receiver.recv())
        is_late = True
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    ending = signal.SIGXCPU if is_late else number
    return Child(results, int(ending), usage.ru_maxrss / UNITS_PER_MB)


def _work(work: Callable[[], Iterable[object]], limits: Limits, sender: Connection) -> NoReturn:
    """The child: sends the results and ends the process, whatever happens."""
    try:
        if limits.processor != resource.RLIM_INFINITY:
            resource.setrlimit(resource.RLIMIT_CPU, (limits.processor, limits.processor + 5))
        resource.setrlimit(resource.RLIMIT_AS, (limits.memory, limits.memory))
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        for result in work():
            sender.send(result)
        sys.stdout.flush()
    finally:
        os._exit(0)
