"""Memory of a build: what it frees goes back to the system, and nothing searches for garbage that it does not make."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

#: For glibc's mallopt: M_MMAP_THRESHOLD, bytes above which a block goes back to the system when it is freed, and
#: M_TRIM_THRESHOLD, bytes at the end of the heap above which that goes back.
_MMAP_THRESHOLD, _LARGE = -3, 4 << 20
_TRIM_THRESHOLD, _END = -1, 32 << 20
#: kB: a process that has never held more is small.
_SMALL_KB = 128_000


@cache
def _library(name: str) -> Callable[..., Any] | None:
    """A function of the C library, where it has it: these are glibc's."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None


def _give_back_large_blocks() -> None:
    """Keeps glibc from raising that bound with each large block that is freed: what it then keeps of the arrays of a
    drawing of 100 000 entities is 90 MB.
    """
    mallopt = _library("mallopt")
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)


def give_back() -> None:
    """Between two stages: smaller blocks that were freed go back as well, of that drawing 30 to 110 MB each time.

    A small process keeps what it has: it would give pages back and ask for them again with every few arrays, for which
    a 3-D part takes 0.08 s.
    """
    trim, mallopt = _library("malloc_trim"), _library("mallopt")
    if trim is None or mallopt is None:
        return
    if _is_small():
        mallopt(_TRIM_THRESHOLD, _END)
    else:
        trim(0)


def _is_small() -> bool:
    """Whether the process has never held much. What it has is known on Linux."""
    if sys.platform != "linux":
        return False
    import resource  # noqa: PLC0415 (not on Windows)

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss <= _SMALL_KB


@contextmanager
def no_collector() -> Iterator[None]:
    """Without the search for cyclic garbage, of which a build makes little but for the document that is read.

    15 000 circles take 11.0 s of processor time instead of 12.9 s (median of three).
    """
    _give_back_large_blocks()
    enabled = gc.isenabled()
    gc.disable()
    gc.freeze()  # so that the one search after reading looks at what was read only
    try:
        yield
    finally:
        if _is_small():
            gc.freeze()  # what was made is old then, and not searched at once
        gc.unfreeze()
        if enabled:
            gc.enable()
