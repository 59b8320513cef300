"""Tries nearly valid inputs, made by hypothesis, on every reader and every read-back.

    python -m bench.reliability.fuzz [EXAMPLES, 20000] [SEED, 0] [NAME ...]

The table in `bench.reliability.fuzzing.table` has the inputs, the call and the allowed outcomes of
each name; the tests try a few inputs of each. A miss is printed with the smallest input that causes
it, as bytes for a test. STEP starts a process for each input and gets a tenth of the examples. Each
name runs in a process with limited memory. A process that a signal ends is a miss, too. The same
seed gives the same inputs. The exit code is 1 if there is a miss.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from hypothesis import HealthCheck, Phase, given, seed, settings

from bench.reliability.fuzzing.table import TABLE, Fuzzed, read_twice
from bench.support.children import Limits, run_in_child
from bench.support.runner import open_table, read_words
from bench.support.timing import peak_mb

_READERS = {reader.name: reader for reader in TABLE}
#: Bytes of an input that are printed.
_PRINTED = 3000
_LIMITS = Limits(memory=4 * 1024**3)


class Tried(NamedTuple):
    """The examples of a reader.

    examples: number of inputs.
    read: number of inputs that gave a value.
    miss: the miss and its input, "" without one.
    seconds: time by the clock.
    peak: the largest resident memory, MB.
    """

    examples: int
    read: int
    miss: str
    seconds: float
    peak: float


def fuzz(reader: Fuzzed, examples: int, start: int, last: Path) -> Tried:
    """Tries a reader until a miss.

    last: file into which each input is written before it is tried: it is left after a crash.
    """
    counts = [0, 0]
    latest = b""

    @seed(start)
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
        print_blob=False,
    )
    @given(reader.inputs)
    def attempt(data: bytes) -> None:
        nonlocal latest
        counts[0] += 1
        last.write_bytes(data)
        latest = data
        counts[1] += read_twice(reader, data)

    began, miss = time.perf_counter(), ""
    try:
        attempt()
    except Exception as error:  # the bench looks for any exception
        miss = f"{type(error).__name__}: {error}: {latest[:_PRINTED]!r}"
    return Tried(counts[0], counts[1], miss, time.perf_counter() - began, peak_mb())


def _fuzz_in_child(name: str, examples: int, start: int) -> Tried:
    with tempfile.TemporaryDirectory() as folder:
        last = Path(folder) / "last"
        child = run_in_child(lambda: [fuzz(_READERS[name], examples, start, last)], _LIMITS)
        if child.results:
            return Tried(*child.results[0])
        data = last.read_bytes() if last.exists() else b""
        return Tried(0, 0, f"ended by signal {child.signal}: {data[:_PRINTED]!r}", 0.0, child.peak)


def main(count: int, start: int, *names: str) -> int:
    """Prints the table and every miss."""
    table = open_table(
        "input | examples {:,} | read {:,} | refused {:,} | misses | seconds {:.0f} "
        "| peak MB {:.0f}"
    )
    misses = []
    for name in names or _READERS:
        examples = max(1, round(count * _READERS[name].weight))
        tried = _fuzz_in_child(name, examples, start)
        refused = tried.examples - tried.read
        table.add(name, tried.examples, tried.read, refused, int(bool(tried.miss)), *tried[3:])
        if tried.miss:
            misses.append(f"{name}: {tried.miss}")
    print("", *misses, sep="\n")
    return int(bool(misses))


if __name__ == "__main__":
    sys.exit(main(*read_words(20_000, 0)))
