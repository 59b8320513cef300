"""Seconds and memory of calls and of processes. Imports nothing heavy, as `runner`."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any, NamedTuple

#: The system reports memory in bytes, or in kB.
UNITS_PER_MB = 1e6 if sys.platform == "darwin" else 1e3


class Process(NamedTuple):
    """A process that has ended.

    text: its output.
    seconds: time by the clock, s.
    processor: time of the processor, s.
    peak: the largest resident memory, MB.
    """

    text: str
    seconds: float
    processor: float
    peak: float


def python(module: str, *words: object) -> list[str]:
    """The command that runs a module."""
    return [sys.executable, "-m", module, *map(str, words)]


def measure_process(command: list[str]) -> Process:
    """Runs a command. SystemExit with its output if it fails."""
    with tempfile.TemporaryFile() as output:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=output, stderr=output)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        text = output.read().decode()
    if process.returncode:
        sys.exit(f"{' '.join(command)}\n{text}")
    spent = usage.ru_utime + usage.ru_stime
    return Process(text, seconds, spent, usage.ru_maxrss / UNITS_PER_MB)


def measure_in_turns(commands: dict[str, list[str]], runs: int) -> dict[str, list[Process]]:
    """The runs of each command, one of each after the other."""
    values: dict[str, list[Process]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            values[name].append(measure_process(command))
    return values


def peak_mb() -> float:
    """The largest resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / UNITS_PER_MB


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """The result of a call, and its seconds by the clock."""
    start = time.perf_counter()
    result = call()
    return result, time.perf_counter() - start


def list_seconds(call: Callable[[], object], runs: int) -> list[float]:
    """Seconds of each of some runs of a call."""
    return [timed(call)[1] for _ in range(runs)]


def best_seconds(call: Callable[[], object], runs: int) -> float:
    """Seconds of the fastest run of a call."""
    return min(list_seconds(call, runs))


def median_seconds(call: Callable[[], object], runs: int) -> float:
    """The median of the seconds of a call."""
    return statistics.median(list_seconds(call, runs))
