"""The search compiled, where the extra ``fast`` (numba) is installed and the work is worth the compiler's start.

The functions of ``kernel``, ``moves`` and ``ring_moves`` are compiled as they stand, and cached beside them. Results do
not differ.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from camgen.order.solver import kernel, moves, ring_moves
from camgen.order.solver.kernel import Run, Scene
from camgen.order.solver.ring_moves import Ring

Search = Callable[[Scene, Run, int, int], float]
Shorten = Callable[[Ring, int], None]


def available() -> bool:
    """Whether the extra ``fast`` is installed."""
    return importlib.util.find_spec("numba") is not None


@cache
def compile_search() -> Search:
    """``moves.search`` compiled. Its first call in a new installation takes some seconds."""
    search: Search = _compile((kernel, moves))["search"]
    return search


@cache
def compile_ring() -> Shorten:
    """``ring_moves.search`` compiled, in the same way."""
    search: Shorten = _compile((ring_moves,))["search"]
    return search


def _compile(modules: Sequence[ModuleType]) -> dict[str, Any]:
    """All functions of ``modules``, of which later ones call earlier ones, by name."""
    import numba  # noqa: PLC0415 (0.3 s, and an extra)

    sources = b"".join(Path(str(module.__file__)).read_bytes() for module in modules)
    digest = hashlib.sha256(sources).hexdigest()[:12]
    functions: dict[str, Any] = {}
    for module in modules:
        own = vars(module).copy() | functions
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value.__module__ == module.__name__:
                copy = FunctionType(value.__code__, own, name, value.__defaults__)
                # The cache looks at the file of a function only, not at those of the functions that it calls.
                copy.__qualname__ = f"{name}_{digest}"
                own[name] = functions[name] = _cache(numba.njit, copy)
    return functions


def _cache(compiler: Any, function: FunctionType) -> Any:
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # no folder can be written to: then it is compiled each time
        return compiler()(function)
