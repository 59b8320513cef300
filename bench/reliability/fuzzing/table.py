"""All that reads what somebody else wrote, each with a strategy and with what must come of it: a table.

A reader gives a value or an error that is addressed to the user, of exit code 2: never another exception, never a
number that is not finite, nothing that takes more than ``SECONDS`` of the processor. A read-back gives a ``Executed``
with its faults, never an error. Both give the same for the same bytes.
"""

from __future__ import annotations

import math
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
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
from camgen.robots.workcell import equip
from camgen.vision.camera.camera import read_camera

#: Of the processor, for one input of a few kB: a loop of G-code without an end is given up after 500,000 lines.
SECONDS = 60
POSTS = {"rapid": "mod", "pacscript": "pcs", "vplus": "v2", "gcode": "ngc", "grbl": "nc"}
#: Without bound on purpose: limits of a joint that turns on and on.
_UNBOUNDED = frozenset({"serial_limits"})


class Fuzzed(NamedTuple):
    """name: of the reader. inputs: nearly valid bytes. call: what is read of them. never_fails: not even with an error
    for the user. weight: share of the examples, since some take long.
    """

    name: str
    inputs: st.SearchStrategy[bytes]
    call: Callable[[bytes], object]
    never_fails: bool = False
    weight: float = 1.0


class Miss(AssertionError):
    """What must not come of an input."""


def judge(one: Fuzzed, data: bytes) -> bool:
    """Whether ``data`` was read, False where it was refused. Miss for anything else."""
    first = _outcome(one, data)
    second = _outcome(one, data)
    if first != second:
        raise Miss(f"{one.name}: read twice, and not the same")
    return not isinstance(first, str)


def _outcome(one: Fuzzed, data: bytes) -> object:
    """The numbers and texts of what is read, or the line of the error."""
    with _time_bound(one.name), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # as the command line does
        try:
            found = one.call(data)
        except camgen.CamgenError as error:
            if (
                one.never_fails
                or error.exit_code != camgen.InputError.exit_code
                or not error.what.strip()
            ):
                raise Miss(f"{one.name}: {type(error).__name__}: {error}") from error
            return str(error)
    leaves = tuple(_leaves(found))
    for leaf in leaves:
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise Miss(f"{one.name}: a number that is not finite: {leaf}")
        if isinstance(leaf, _Numbers) and not leaf.finite:
            raise Miss(f"{one.name}: an array with numbers that are not finite")
    return leaves


@contextmanager
def _time_bound(name: str) -> Iterator[None]:
    """Miss after ``SECONDS`` of the processor."""

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
    """An array: its bytes, and whether all of it is finite."""

    data: bytes
    finite: bool


def _leaves(value: object) -> Iterator[object]:
    """All numbers, texts and arrays in a value, in order."""
    if isinstance(value, np.ndarray):
        finite = value.dtype.kind not in "fc" or bool(np.isfinite(value).all())
        yield _Numbers(value.tobytes(), finite)
    elif (inner := _inner(value)) is not None:
        for item in inner:
            yield from _leaves(item)
    elif isinstance(value, np.generic):
        yield value.item()
    elif value is None or isinstance(value, (str, bytes, int, float)):
        yield value


def _inner(value: object) -> Iterable[object] | None:
    """What a value is made of, None where it is one thing."""
    if isinstance(value, msgspec.Struct):
        return [getattr(value, name) for name in value.__struct_fields__ if name not in _UNBOUNDED]
    if isinstance(value, Mapping):
        return [part for pair in value.items() for part in pair]
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    return value if isinstance(value, (tuple, list)) else None


# What is called.

_TRACE = Job(image=ImageTable(mm_per_px=0.1), operation=OperationTable(kind="trace"))
_PHOTO = Job(image=ImageTable(mm_per_px=0.1))


def _read_part(suffix: str, data: bytes, job: Job = _PHOTO) -> object:
    """As ``camgen build`` reads a part, and as ``camgen inspect`` says it."""
    source, files = Source(Path(f"part{suffix}"), data), Files()
    reader = find_reader(source)
    found: list[object] = []
    errors = []
    for step in (reader.read, reader.inspect):
        try:
            found.append(step(source, job, files))
        except camgen.CamgenError as error:
            errors.append(error)
    said = [str(one) for one in found]
    if errors:
        raise errors[0]
    return [*found, *said]


def _read_job(data: bytes) -> object:
    """A job with the cell and the posts that it makes. What other files it names is not there."""
    job = load_job(Path("job.toml"), (), Files([Source(Path("job.toml"), data)]))
    return [
        job,
        equip(find_post("rapid").cell(), job),
        *(_post_errors(name, job) for name in POSTS),
    ]


def _post_errors(name: str, job: Job) -> str:
    """What a post says of its options: other posts have others."""
    try:
        make_post(find_post(name), job.post)
    except camgen.JobError as error:
        return str(error)
    return ""


def _read_cell(data: bytes) -> object:
    text = b'[cell]\nfile = "cell.toml"\n'
    files = Files([Source(Path("job.toml"), text), Source(Path("cell.toml"), data)])
    job = load_job(Path("job.toml"), (), files)
    return [job, equip(find_post("rapid").cell(), job)]


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """For what is looked at before it is read."""
    return tempfile.TemporaryDirectory()


def _read_urdf(data: bytes) -> object:
    path = Path(_folder().name) / "arm.urdf"
    path.write_bytes(data)
    return read_urdf(str(path), "", Files())


def _read_cloud(suffix: str, data: bytes) -> object:
    return scans.read_scan(Source(Path(f"scan{suffix}"), data))


def _read_plan(data: bytes) -> object:
    """A plan, held against its own program as ``camgen verify`` does."""
    found = motion_file.load(Path("plan.json"), Files([Source(Path("plan.json"), data)]))
    return [found.program, found.program.columns.ends.shape, found.chord]


def _read_back(post: str, data: bytes) -> object:
    """The reading, and its sums as ``camgen verify`` tells them."""
    text = {f"part.{POSTS[post]}": data.decode("latin-1")}
    found = find_readback(post)(text, fill_tables(find_post(post), {}))
    assert isinstance(found, camgen.Executed)
    assert len(found.body) == len(found.lines)
    return [found, sum_up(Columns(found.body))]


_KINDS = {
    ".dxf": drawings.dxf(), ".svg": drawings.svg(), ".ngc": programs.gcode(), ".stl": solids.stl(),
    ".obj": solids.obj(), ".off": solids.off(), ".ply": solids.ply(), ".3mf": solids.three_mf(), ".glb": solids.glb(),
    ".xyz": solids.text_cloud(),
}  # fmt: skip
TABLE = (
    *(Fuzzed(kind[1:], inputs, partial(_read_part, kind)) for kind, inputs in _KINDS.items()),
    Fuzzed("dxf-space", drawings.dxf(), partial(_read_part, ".dxf", job=_TRACE)),
    Fuzzed("step", solids.step(), partial(_read_part, ".step"), weight=0.1),
    Fuzzed("photo", pictures.picture, partial(_read_part, ".png")),
    Fuzzed("picture", pictures.picture, partial(_read_part, ".png", job=_TRACE)),
    Fuzzed("job", texts.job(), _read_job),
    Fuzzed("set", texts.assignment(), lambda data: load_job(None, (data.decode(),))),
    Fuzzed("cell", texts.cell(), _read_cell),
    Fuzzed("urdf", texts.urdf(), _read_urdf),
    Fuzzed("camera", texts.camera(), lambda data: read_camera(Source(Path("camera.yaml"), data))),
    Fuzzed("plan", texts.plan(), _read_plan),
    Fuzzed("cloud-ply", solids.ply_cloud(), partial(_read_cloud, ".ply")),
    Fuzzed("cloud-pcd", solids.pcd(), partial(_read_cloud, ".pcd")),
    Fuzzed("cloud-text", solids.text_cloud(), partial(_read_cloud, ".xyz")),
    Fuzzed("cloud-head", solids.headed_cloud(), partial(_read_cloud, ".csv")),
    Fuzzed("cloud-ptx", solids.ptx(), partial(_read_cloud, ".ptx")),
    Fuzzed("cloud-las", solids.las(), partial(_read_cloud, ".las")),
    *(
        Fuzzed(
            f"verify-{post}", programs.program(post), partial(_read_back, post), never_fails=True
        )
        for post in POSTS
    ),
)
