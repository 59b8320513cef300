"""Builds that are done once: a second call for the same program gets the first result."""

import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import camgen
from camgen.model.part import Part
from camgen.pipeline import JobLike, Result, list_inputs, load_settings
from camgen.pipeline.inputs import read_parts
from camgen.read.files import Files

Build = Callable[..., Result]
Inputs = Path | Part | Sequence[Path | Part]

#: Number of results that are kept. A new result replaces the oldest one.
_MOST = 48


def key_of_parts(
    inputs: Inputs, *, post: str, job: JobLike, files: Files | None = None, **_: object
) -> bytes:
    """The parts as the job has them read, the job and the controller.

    Inputs with equal parts get programs that differ in their headers only.
    """
    files = files or Files()
    settings = load_settings(job, files)
    parts = read_parts(list_inputs(inputs), settings, files.within(settings.limits))
    return pickle.dumps((parts, settings, post))


def key_of_files(
    inputs: Inputs, *, post: str, job: JobLike, files: Files | None = None, **options: Any
) -> bytes:
    """The values that decide the bytes of a program: input files, job, controller and name.

    Files that the job names must stay as they are.
    """
    files = files or Files()
    sources = [files.read(path) for path in list_inputs(inputs)]
    contents = [(source.path.name, bytes(source.data)) for source in sources]
    chosen = (options.get("name", ""), options.get("strict", False))
    return pickle.dumps((contents, load_settings(job, files), post, chosen))


def build_once(build: Build, key_of: Callable[..., bytes]) -> Build:
    """``build`` with a memory. Results are frozen, so that callers may share them.

    ``key_of`` gets the arguments of a call. Calls with equal keys make the same program.
    """
    results: dict[bytes, Result] = {}

    def remembering(inputs: Inputs, **options: Any) -> Result:
        key = key_of(inputs, **options)
        if key not in results:
            result = build(inputs, **options)
            if len(results) == _MOST:
                del results[next(iter(results))]
            results[key] = result
        return results[key]

    return remembering


_BUILD_FILE = build_once(camgen.build, key_of_files)


def build(part: Path, post: str, job: Mapping[str, object]) -> Result:
    """``camgen.build`` of a drawing or model in a file, done once for all tests."""
    return _BUILD_FILE(part, post=post, job=job)
