"""Nearly valid inputs for every reader and every read-back, made by hypothesis: what comes of them.

    python -m bench.reliability.fuzz [NAME ...] [--examples 20000] [--seed 0]

The table of ``bench.reliability.fuzzing.table`` says for each name what its inputs are made of, what is called, and
what may come of it; the tests try a few of each. A miss is printed with the smallest input that makes it, as bytes for
a test. STEP, for which a process is started each time, gets a tenth of the examples. Each name has a process of its
own, with a limit of memory: one that is ended by a signal is a miss, and its input is printed too. The same seed gives
the same inputs. Exits with 1 if there is a miss.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from hypothesis import HealthCheck, Phase, given, seed, settings

from bench.reliability.fuzzing.table import TABLE, Fuzzed, judge
from bench.support.children import Limits, run_in_child
from bench.support.runner import open_table
from bench.support.timing import peak_mb

_NAMES = {one.name: one for one in TABLE}
#: Bytes of an input that are printed, and of memory that a process may have.
_PRINTED, _LIMITS = 3000, Limits(memory=4 * 1024**3)


class Ran(NamedTuple):
    """examples: that were tried, ``read`` of them a value. miss: "" or what it is and of which input. peak: MB."""

    examples: int
    read: int
    miss: str
    seconds: float
    peak: float


def fuzz(one: Fuzzed, examples: int, start: int, last: Path) -> Ran:
    """Tries one reader until a miss. last: gets the input that is tried, for whoever looks after a crash."""
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
    @given(one.inputs)
    def attempt(data: bytes) -> None:
        nonlocal latest
        counts[0] += 1
        last.write_bytes(data)
        latest = data
        counts[1] += judge(one, data)

    began, miss = time.perf_counter(), ""
    try:
        attempt()
    except Exception as error:  # whatever a reader raises is what is looked for
        miss = f"{type(error).__name__}: {error}: {latest[:_PRINTED]!r}"
    return Ran(counts[0], counts[1], miss, time.perf_counter() - began, peak_mb())


def _in_process(name: str, examples: int, start: int) -> Ran:
    """``fuzz`` in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        last = Path(folder) / "last"
        child = run_in_child(lambda: [fuzz(_NAMES[name], examples, start, last)], _LIMITS)
        if child.results:
            return Ran(*child.results[0])
        data = last.read_bytes() if last.exists() else b""
        return Ran(0, 0, f"ended by signal {child.signal}: {data[:_PRINTED]!r}", 0.0, child.peak)


def main() -> int:
    """The table, and every miss."""
    parser = argparse.ArgumentParser(prog="python -m bench.reliability.fuzz")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", choices=[*_NAMES, []], help=", ".join(_NAMES)
    )
    parser.add_argument(
        "--examples", type=int, default=20_000, metavar="N", help="of each; default 20000"
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="another number, other inputs"
    )
    words = parser.parse_args()
    if words.examples < 1:
        parser.error("--examples: give 1 or more")
    table = open_table(
        "input | examples {:,} | read {:,} | refused {:,} | misses | seconds {:.0f} | peak MB {:.0f}"
    )
    misses = []
    for name in words.names or _NAMES:
        ran = _in_process(name, max(1, round(words.examples * _NAMES[name].weight)), words.seed)
        counts = ran.examples, ran.read, ran.examples - ran.read, int(bool(ran.miss))
        table.add(name, *counts, ran.seconds, ran.peak)
        misses += [f"{name}: {ran.miss}"] if ran.miss else []
    print()
    for miss in misses:
        print(miss)
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())
