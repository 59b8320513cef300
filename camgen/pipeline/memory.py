"""Memory of a build: what it frees is used again, and goes back to the system between stages."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

#: For glibc's mallopt. M_MMAP_THRESHOLD: a larger block, bytes, is mapped on its own; 32 MB is the
#: largest allowed. M_TRIM_THRESHOLD: free bytes at the end of the heap that stay with the process.
_MMAP_THRESHOLD, _LARGE = -3, 32 << 20
_TRIM_THRESHOLD, _KEPT = -1, 256 << 20
#: kB: a process that has never held more is small.
_SMALL_KB = 128_000


@cache
def _library(name: str) -> Callable[..., Any] | None:
    """A function of the C library, or None: these are glibc's."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None


@cache
def _keep_freed_blocks() -> None:
    """Makes glibc use freed memory again instead of returning it to the system at once.

    Fresh memory costs a fault for each page: 100,001 shapes take 11.5 s of processor time with this
    and 13.0 s without (median of three).
    """
    mallopt = _library("mallopt")
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)
        mallopt(_TRIM_THRESHOLD, _KEPT)


def release_memory() -> None:
    """Returns freed memory to the system, between two stages. A small process keeps it."""
    _keep_freed_blocks()
    trim = _library("malloc_trim")
    if trim is not None and not _is_small():
        trim(0)


def _is_small() -> bool:
    """Whether the process has never held much. What it has is known on Linux."""
    if sys.platform != "linux":
        return False
    import resource  # noqa: PLC0415 (not on Windows)

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss <= _SMALL_KB


@contextmanager
def pause_collector() -> Iterator[None]:
    """Without the search for cyclic garbage, of which only reading a document makes much.

    15,000 circles take 11.0 s of processor time instead of 12.9 s (median of three).
    """
    _keep_freed_blocks()
    enabled = gc.isenabled()
    gc.disable()
    gc.freeze()  # so that the one search after reading looks at objects of reading only
    try:
        yield
    finally:
        if _is_small():
            gc.freeze()  # the objects of the build are old then, and not searched at once
        gc.unfreeze()
        if enabled:
            gc.enable()
