"""Waits for another process, as long as a busy machine may take."""

import time
from collections.abc import Callable

#: Time after which a wait fails, s. A shorter time may be too short on a busy machine.
LONG = 600.0


def wait_for(what: str, has_happened: Callable[[], object]) -> None:
    """Returns when `has_happened` is true. Raises AssertionError with `what` after `LONG`."""
    deadline = time.monotonic() + LONG
    while not has_happened():
        assert time.monotonic() < deadline, f"{what}: not within {LONG:g} s"
        time.sleep(0.02)
