"""The local search compiled, where the extra ``fast`` (numba) is installed.

The functions of ``kernel``, the moves and ``local_search`` are compiled as they stand, and cached
beside them. Results do not differ.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from camgen.order.solver import kernel, local_search, moves, ring_moves
from camgen.order.solver.kernel import Run, Scene

#: ``local_search.search``.
Search = Callable[[Scene, Run, int, int], float]
#: The modules of the search; later ones call earlier ones.
_MODULES = (kernel, moves, ring_moves, local_search)


def available() -> bool:
    """Whether the extra ``fast`` is installed."""
    return importlib.util.find_spec("numba") is not None


def to_arrays(scene: Scene, run: Run) -> tuple[Scene, Run]:
    """The problem and the tour as arrays, which the compiled search takes."""
    columns = [np.array(value) if isinstance(value, list) else value for value in scene]
    return Scene(*columns), Run(*map(np.array, run))  # type: ignore[arg-type]


@cache
def compile_search() -> Search:
    """``local_search.search`` compiled. Its first call in a new installation takes some seconds."""
    search: Search = _compile(_MODULES)["search"]
    return search


def _compile(modules: Sequence[ModuleType]) -> dict[str, Any]:
    """All functions of ``modules`` by name. Their names must differ."""
    import numba  # noqa: PLC0415 (0.3 s, and an extra)

    sources = b"".join(Path(str(module.__file__)).read_bytes() for module in modules)
    digest = hashlib.sha256(sources).hexdigest()[:12]
    functions: dict[str, Any] = {}
    for module in modules:
        scope = vars(module).copy() | functions
        for name, value in vars(module).items():
            if isinstance(value, FunctionType) and value.__module__ == module.__name__:
                copy = FunctionType(value.__code__, scope, name, value.__defaults__)
                # The cache checks the file of a function alone, so its name changes with the files
                # of the functions that it calls.
                copy.__qualname__ = f"{name}_{digest}"
                scope[name] = functions[name] = _cache(numba.njit, copy)
    return functions


def _cache(compiler: Any, function: FunctionType) -> Any:
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # no folder can be written: compiled each time
        return compiler()(function)
