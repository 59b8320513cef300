"""The search compiled, where the extra ``fast`` (numba) is installed and the work is worth the compiler's start.

The functions of ``kernel``, ``moves`` and ``rounds`` are compiled as they stand, and cached beside them. Results do
not differ.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

from camgen.order.solver import kernel, moves
from camgen.order.solver import moves as rounds
from camgen.order.solver.kernel import Run, Scene

_MODULES = (kernel, moves, rounds)
Search = Callable[[Scene, Run, int, int], float]


def available() -> bool:
    """Whether the extra ``fast`` is installed."""
    return importlib.util.find_spec("numba") is not None


@cache
def compile_search() -> Search:
    """``rounds.search`` compiled. Its first call in a new installation takes some seconds."""
    import numba  # noqa: PLC0415 (0.3 s, and an extra)

    sources = b"".join(Path(str(module.__file__)).read_bytes() for module in _MODULES)
    digest = hashlib.sha256(sources).hexdigest()[:12]
    functions: dict[str, Any] = {}
    for module in _MODULES:
        own = vars(module).copy() | functions
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value.__module__ == module.__name__:
                copy = FunctionType(value.__code__, own, name, value.__defaults__)
                # The cache looks at the file of a function only, not at those of the functions that it calls.
                copy.__qualname__ = f"{name}_{digest}"
                own[name] = functions[name] = _cache(numba.njit, copy)
    search: Search = functions["search"]
    return search


def _cache(compiler: Any, function: FunctionType) -> Any:
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # no folder can be written to: then it is compiled each time
        return compiler()(function)
