"""Builds the jobs with one module mutated, in a separate process.

A process with all libraries imported forks a child for each mutant. The import hook of the child
compiles the changed tree under the name of the module, and camgen is imported again. No file
changes.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import signal
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, NoReturn

from bench.reliability.code_mutants.cases import CASES, FILE_MARK, Case, write_drawing
from bench.reliability.code_mutants.operators import Site, mutate
from bench.reliability.code_mutants.targets import ROOT, Mutant
from bench.support.children import Limits, run_in_child

#: Seconds of the processor that a job may take, which takes 0.3 s.
_JOB_S = 8
_CHILD = Limits(memory=4_000_000_000, processor=60)
WRITTEN = "written"


class Outcome(NamedTuple):
    """The end of one job.

    kind: `WRITTEN`, or the exit code and class of the error, or "limit" or "ended".
    text: the program, or the first line of the error.
    """

    kind: str
    text: str


class MutatingFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds one module, and runs its changed tree in place of its file."""

    def __init__(self, module: str, site: Site) -> None:
        self.path = ROOT / module
        self.name = module_name(module)
        self.site = site

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        """The spec of the mutated module; None for all others."""
        if fullname != self.name:
            return None
        is_package = self.path.name == "__init__.py"
        folder = [str(self.path.parent)] if is_package else None
        return importlib.util.spec_from_file_location(
            fullname, self.path, loader=self, submodule_search_locations=folder
        )

    def exec_module(self, module: ModuleType) -> None:
        """Runs the changed tree."""
        source = self.path.read_text(encoding="utf-8")
        exec(compile(mutate(source, self.site), str(self.path), "exec"), module.__dict__)


def module_name(module: str) -> str:
    """The name by which a file of the repository is imported."""
    name = module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    return name.replace("postprocessors", "camgen_posts", 1)


def run_mutant(mutant: Mutant) -> list[Outcome]:
    """The outcome of each job with a mutant, in a forked child."""
    outcomes = run_in_child(partial(_run_mutant, mutant), _CHILD).results
    missing = len(CASES) - len(outcomes)
    return outcomes + [Outcome("ended", "the process ended")] * missing


def _run_mutant(mutant: Mutant) -> Iterator[Outcome]:
    for name in list(sys.modules):
        if name.split(".")[0] in ("camgen", "camgen_posts"):
            del sys.modules[name]
    sys.meta_path.insert(0, MutatingFinder(mutant.module, mutant.site))
    signal.signal(signal.SIGPROF, _stop_job)
    yield from run_cases()


def run_cases() -> Iterator[Outcome]:
    """The outcome of each job."""
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            yield _run_case(case, Path(folder))


class _Slow(BaseException):
    """A job that takes longer than it may."""


def _stop_job(_number: int, _frame: object) -> NoReturn:
    raise _Slow


def _run_case(case: Case, folder: Path) -> Outcome:
    drawing = write_drawing(case, folder)
    signal.setitimer(signal.ITIMER_PROF, _JOB_S)
    try:
        from camgen.pipeline import build  # noqa: PLC0415 (the mutated module is imported here)

        result = build(drawing, post=case.post, job=case.job)
        return Outcome(WRITTEN, FILE_MARK.join(file.text for file in result.files))
    except _Slow:
        return Outcome("limit", f"more than {_JOB_S} s")
    # A mutant may fail in any way at all: each is an outcome, and the other jobs follow.
    except BaseException as error:
        code = getattr(error, "exit_code", 1)
        lines = str(error).splitlines()
        first = lines[0] if lines else ""
        return Outcome(f"{code} {type(error).__name__}", first[:200])
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
