"""Builds the jobs with one module mutated, in a separate process.

A process with all libraries imported forks a child for each mutant. The import hook of the child
compiles the changed tree under the name of the module, and camgen is imported again. No file
changes.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.util
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import FrameType, ModuleType
from typing import NamedTuple, NoReturn, TypeVar

from bench.reliability.code_mutants.cases import CASES, FILE_MARK, Case, write_drawing
from bench.reliability.code_mutants.operators import Site, mutate
from bench.reliability.code_mutants.targets import ROOT, Mutant
from bench.support.children import Limits, run_in_child

#: Seconds of the processor that a job may take, which takes 0.3 s.
_JOB_S = 8
_CHILD = Limits(memory=4_000_000_000, processor=60)
WRITTEN = "written"

Result = TypeVar("Result")


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


def warm_up() -> None:
    """Builds all jobs once, so that the libraries are imported, and forgets camgen again."""
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            _run_case(case, Path(folder))
    _forget_camgen()


def _forget_camgen() -> None:
    for name in list(sys.modules):
        if name.split(".")[0] in ("camgen", "camgen_posts"):
            del sys.modules[name]


Called = set[tuple[str, int]]


def run_cases(mutant: Mutant | None, cases: Sequence[Case] = CASES) -> list[Outcome]:
    """The outcome of each job with a mutant, or without one, in a forked child."""
    outcomes = _fork(_run_case, mutant, cases)
    missing = len(cases) - len(outcomes)
    return outcomes + [Outcome("ended", "the process ended")] * missing


def list_called(cases: Sequence[Case] = CASES) -> list[Called]:
    """The file and the first line of each function that each job calls."""
    return _fork(_trace_case, None, cases)


def _trace_case(case: Case, folder: Path) -> Called:
    called: Called = set()

    def note_call(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            called.add((frame.f_code.co_filename, frame.f_code.co_firstlineno))

    sys.setprofile(note_call)
    _run_case(case, folder)
    sys.setprofile(None)
    return {(name, line) for name, line in called if name.startswith(str(ROOT))}


def is_run(mutant: Mutant, called: Called) -> bool:
    """Whether a job calls the function in which a mutant is; code outside functions always runs."""
    first, last = find_function(mutant.source, mutant.site.line)
    if last == 0:
        return True
    path = str(ROOT / mutant.module)
    return any(name == path and first <= line <= last for name, line in called)


def find_function(source: str, line: int) -> tuple[int, int]:
    """The first and the last line of the outermost function around a line, or 0, 0.

    Defaults of arguments and decorators run when a module is imported: they are in no function.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line <= node.end_lineno:
            first = min(node.lineno, *(item.lineno for item in (node, *node.decorator_list)))
            return first, node.end_lineno
    return 0, 0


def _fork(
    run: Callable[[Case, Path], Result], mutant: Mutant | None, cases: Sequence[Case]
) -> list[Result]:
    """The results of the jobs, as far as a forked child comes."""
    return run_in_child(partial(_run_each, run, mutant, cases), _CHILD).results


def _run_each(
    run: Callable[[Case, Path], Result], mutant: Mutant | None, cases: Sequence[Case]
) -> Iterator[Result]:
    """The results of the jobs, each by code that is imported again."""
    _forget_camgen()
    if mutant is not None:
        sys.meta_path.insert(0, MutatingFinder(mutant.module, mutant.site))
    signal.signal(signal.SIGPROF, _stop_job)
    with tempfile.TemporaryDirectory() as folder:
        for case in cases:
            yield run(case, Path(folder))


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
