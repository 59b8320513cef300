"""A forked child sends its results until it ends, and the signal that ended it.

The tests may have threads, and a process with threads must not fork: a fresh process forks here.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """
import json, os, signal, time
from bench.support.children import Limits, run_in_child

LIMITS = Limits(memory=8 * 1024**3)

def usual():
    yield from (1, 2)

def killed():
    yield from (1, 2)
    os.kill(os.getpid(), signal.SIGKILL)

def failed():
    for k in range(3):
        yield 1 // (1 - k)

def late():
    yield 1
    time.sleep(1000)

def busy():
    while True:
        yield from ()

def large():
    yield len(bytes(9 * 1024**3))

child = run_in_child({work}, LIMITS._replace({limits}))
print(json.dumps([child.results, child.signal, child.peak]))
"""


@pytest.mark.parametrize(
    ("work", "limits", "results", "number"),
    [
        ("usual", "", [1, 2], 0),
        ("killed", "", [1, 2], signal.SIGKILL),
        ("failed", "", [1], 0),
        ("late", "clock=0.2", [1], signal.SIGXCPU),
        ("busy", "processor=1", [], signal.SIGXCPU),
        ("large", "", [], 0),
    ],
)
def test_results_are_received_until_the_child_ends(
    work: str, limits: str, results: list[int], number: int
) -> None:
    script = SCRIPT.replace("{work}", work).replace("{limits}", limits)
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    received, ended, peak = json.loads(process.stdout)
    assert (received, ended) == (results, number)
    assert peak > 1
