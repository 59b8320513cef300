"""The table of all readers and read-backs, each with a strategy for its inputs and its limits.

A reader returns a value, or raises an error for the user with exit code 2, or with 3 for a picture
in which no part dominates. It never raises another exception, never returns a number that is not
finite, and takes at most `SECONDS` of the processor. A read-back returns an `Executed` with its
faults and raises no error. Both return the same for the same bytes.
"""

from __future__ import annotations

import math
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from itertools import chain
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import msgspec
import numpy as np
from hypothesis import strategies as st

import camgen
from bench.reliability.fuzzing import drawings, pictures, programs, solids, texts
from camgen.check.report import sum_up
from camgen.cli import motion_file
from camgen.localize import scans
from camgen.model.files import Source
from camgen.model.job import ImageTable, Job, OperationTable
from camgen.model.program import Columns
from camgen.post.plugins import fill_tables, find_post, find_readback, make_post
from camgen.read import find_reader
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.robots.urdf import read_urdf
from camgen.robots.workcell import equip_cell
from camgen.vision.camera.camera import read_camera

#: Processor time for an input of a few kB, s: endless loops of G-code stop after 500,000 lines.
SECONDS = 60
POSTS = {"rapid": "mod", "pacscript": "pcs", "vplus": "v2", "gcode": "ngc", "grbl": "nc"}
#: Errors with exit code 2, which a reader may raise for any input.
_REFUSALS = (camgen.InputError, camgen.JobError)
#: Fields that may be infinite: limits of a joint that turns without end.
_UNBOUNDED = frozenset({"serial_limits"})


class Fuzzed(NamedTuple):
    """A reader with its inputs.

    name: its name.
    inputs: strategy for nearly valid bytes.
    call: reads the bytes.
    never_fails: whether it raises no error either.
    refusals: errors for the user that it may raise.
    weight: share of the examples: slow readers get fewer.
    """

    name: str
    inputs: st.SearchStrategy[bytes]
    call: Callable[[bytes], object]
    never_fails: bool = False
    refusals: tuple[type[camgen.CamgenError], ...] = _REFUSALS
    weight: float = 1.0


class Miss(AssertionError):
    """An outcome that a reader must not have."""


def read_twice(reader: Fuzzed, data: bytes) -> bool:
    """Reads bytes twice. Returns whether they were read; False if they were refused.

    Miss if the reader does anything else, or not the same again.
    """
    first = _read(reader, data)
    if first != _read(reader, data):
        raise Miss(f"{reader.name}: read twice, and not the same")
    return not isinstance(first, str)


def _read(reader: Fuzzed, data: bytes) -> object:
    """The numbers and texts of the value that was read, or the text of the error."""
    with _limit_time(reader.name), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # as the command line does
        try:
            value = reader.call(data)
        except camgen.CamgenError as error:
            is_for_user = isinstance(error, reader.refusals) and error.what.strip()
            if reader.never_fails or not is_for_user:
                raise Miss(f"{reader.name}: {type(error).__name__}: {error}") from error
            return str(error)
    leaves = tuple(_list_leaves(value))
    for leaf in leaves:
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise Miss(f"{reader.name}: a number that is not finite: {leaf}")
        if isinstance(leaf, _Numbers) and not leaf.finite:
            raise Miss(f"{reader.name}: an array with numbers that are not finite")
    return leaves


@contextmanager
def _limit_time(name: str) -> Iterator[None]:
    """Miss after `SECONDS` of the processor."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise Miss(f"{name}: no end within {SECONDS} s")

    before = signal.signal(signal.SIGVTALRM, end)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


class _Numbers(NamedTuple):
    """The bytes of an array, and whether all its numbers are finite."""

    data: bytes
    finite: bool


def _list_leaves(value: object) -> Iterator[object]:
    """All numbers, texts and arrays in a value, in order."""
    if isinstance(value, np.ndarray):
        finite = value.dtype.kind not in "fc" or bool(np.isfinite(value).all())
        yield _Numbers(value.tobytes(), finite)
    elif (inner := _list_items(value)) is not None:
        for item in inner:
            yield from _list_leaves(item)
    elif isinstance(value, np.generic):
        yield value.item()
    elif value is None or isinstance(value, (str, bytes, int, float)):
        yield value


def _list_items(value: object) -> Iterable[object] | None:
    """The parts of a value, None if it has no parts."""
    if isinstance(value, msgspec.Struct):
        return [getattr(value, name) for name in value.__struct_fields__ if name not in _UNBOUNDED]
    if isinstance(value, Mapping):
        return chain.from_iterable(value.items())
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    return value if isinstance(value, (tuple, list)) else None


# The calls.

_TRACE = Job(image=ImageTable(mm_per_px=0.1), operation=OperationTable(kind="trace"))
_PHOTO = Job(image=ImageTable(mm_per_px=0.1))


def _read_part(suffix: str, data: bytes, job: Job = _PHOTO) -> object:
    """Reads a part as `camgen build` does, and describes it as `camgen inspect` does."""
    source, files = Source(Path(f"part{suffix}"), data), Files()
    reader = find_reader(source)
    values: list[object] = []
    errors = []
    for step in (reader.read, reader.inspect):
        try:
            values.append(step(source, job, files))
        except camgen.CamgenError as error:
            errors.append(error)
    texts = [str(value) for value in values]
    if errors:
        raise errors[0]
    return [*values, *texts]


def _read_job(data: bytes) -> object:
    """Reads a job, and makes its cell and its posts. Other files that it names do not exist."""
    job = load_job(Path("job.toml"), (), Files([Source(Path("job.toml"), data)]))
    errors = []
    for name in POSTS:
        try:
            make_post(find_post(name), job.post)
        except camgen.JobError as error:  # an option that this post does not have
            errors.append(str(error))
    return [job, equip_cell(find_post("rapid").cell(), job), *errors]


def _read_cell(data: bytes) -> object:
    text = b'[cell]\nfile = "cell.toml"\n'
    files = Files([Source(Path("job.toml"), text), Source(Path("cell.toml"), data)])
    job = load_job(Path("job.toml"), (), files)
    return [job, equip_cell(find_post("rapid").cell(), job)]


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """The folder of inputs that are read from a path."""
    return tempfile.TemporaryDirectory()


def _read_urdf(data: bytes) -> object:
    path = Path(_folder().name) / "arm.urdf"
    path.write_bytes(data)
    return read_urdf(str(path), "", Files())


def _read_cloud(suffix: str, data: bytes) -> object:
    return scans.read_scan(Source(Path(f"scan{suffix}"), data))


def _read_camera(data: bytes) -> object:
    return read_camera(Source(Path("camera.yaml"), data))


def _read_plan(data: bytes) -> object:
    """Reads a plan as `camgen verify` does."""
    plan = motion_file.load(Path("plan.json"), Files([Source(Path("plan.json"), data)]))
    return [plan.program, plan.program.columns.ends.shape, plan.chord]


def _read_back(post: str, data: bytes) -> object:
    """Reads a program back, and adds it up as `camgen verify` does."""
    text = {f"part.{POSTS[post]}": data.decode("latin-1")}
    executed = find_readback(post)(text, fill_tables(find_post(post), {}))
    assert isinstance(executed, camgen.Executed)
    assert len(executed.body) == len(executed.lines)
    return [executed, sum_up(Columns(executed.body))]


_PARTS = {
    ".dxf": drawings.dxf(),
    ".svg": drawings.svg(),
    ".ngc": programs.gcode(),
    ".stl": solids.stl(),
    ".obj": solids.obj(),
    ".off": solids.object_file(),
    ".ply": solids.ply(),
    ".3mf": solids.three_mf(),
    ".glb": solids.glb(),
    ".xyz": solids.text_cloud(),
}
_CLOUDS = {
    "ply": (".ply", solids.ply_cloud()),
    "pcd": (".pcd", solids.pcd()),
    "text": (".xyz", solids.text_cloud()),
    "head": (".csv", solids.headed_cloud()),
    "ptx": (".ptx", solids.ptx()),
    "las": (".las", solids.las()),
}


def _list_table() -> Iterator[Fuzzed]:
    for suffix, inputs in _PARTS.items():
        yield Fuzzed(suffix[1:], inputs, partial(_read_part, suffix))
    yield Fuzzed("dxf-space", drawings.dxf(), partial(_read_part, ".dxf", job=_TRACE))
    yield Fuzzed("step", solids.step(), partial(_read_part, ".step"), weight=0.1)
    refusals = (*_REFUSALS, camgen.NoSafeProgram)
    yield Fuzzed("photo", pictures.picture, partial(_read_part, ".png"), refusals=refusals)
    yield Fuzzed("picture", pictures.picture, partial(_read_part, ".png", job=_TRACE))
    yield Fuzzed("job", texts.job(), _read_job)
    yield Fuzzed("set", texts.assignment(), lambda data: load_job(None, (data.decode(),)))
    yield Fuzzed("cell", texts.cell(), _read_cell)
    yield Fuzzed("urdf", texts.urdf(), _read_urdf)
    yield Fuzzed("camera", texts.camera(), _read_camera)
    yield Fuzzed("plan", texts.plan(), _read_plan)
    for name, (suffix, inputs) in _CLOUDS.items():
        yield Fuzzed(f"cloud-{name}", inputs, partial(_read_cloud, suffix))
    for post in POSTS:
        call = partial(_read_back, post)
        yield Fuzzed(f"verify-{post}", programs.program(post), call, never_fails=True)


TABLE = tuple(_list_table())
