"""Waiting for what another process does: for as long as a busy machine may take, and no longer than it takes."""

import time
from collections.abc import Callable

#: s. A test that waits so long has failed; one that waits for less may meet a machine that does other things.
LONG = 600.0


def wait_for(what: str, happened: Callable[[], object]) -> None:
    """Returns when ``happened`` is true. AssertionError after ``LONG``."""
    end = time.monotonic() + LONG
    while not happened():
        assert time.monotonic() < end, f"{what}: not within {LONG:g} s"
        time.sleep(0.02)
