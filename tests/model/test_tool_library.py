"""`tool.file` names a library of tools. The rows of a job change its tools by name."""

from __future__ import annotations

from pathlib import Path

import pytest

import camgen
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.pipeline.inputs import compute_digest
from camgen.read.files import Files
from camgen.read.job_file import from_mapping, load_job
from camgen.read.made import make_part

LIBRARY = """\
[[tools]]
name = "drill 8"
number = 1
kind = "drill"
diameter = 8.0
feed = "180 mm/min"
speed = 2500.0

[[tools]]
name = "mill 6"
number = 2
diameter = 6.0
feed = 20.0
speed = 16000.0

[[tools]]
name = "mill 3"
number = 3
diameter = 3.0
"""
JOB = """\
[tool]
file = "lib/shop.toml"

[[tools]]
name = "mill 6"
feed = 10.0
flutes = 3

[[tools]]
name = "V 90"
number = 7
kind = "v"

[[operations]]
tool = 2

[[operations]]
tool = "drill 8"
"""


@pytest.fixture
def job_file(tmp_path: Path) -> Path:
    """A job beside a folder with its library."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "shop.toml").write_text(LIBRARY, encoding="utf-8")
    file = tmp_path / "part.toml"
    file.write_text(JOB, encoding="utf-8")
    return file


def library_of(job_file: Path) -> Path:
    return job_file.parent / "lib" / "shop.toml"


def test_a_row_of_the_job_replaces_single_keys_of_a_tool_of_the_library(job_file: Path) -> None:
    job = load_job(job_file)
    assert [(tool.name, tool.number) for tool in job.tools] == [
        ("drill 8", 1),
        ("mill 6", 2),
        ("mill 3", 3),
        ("V 90", 7),
    ]
    mill = job.tools[1]
    assert (mill.feed, mill.flutes) == (10.0, 3)  # of the job
    assert (mill.diameter, mill.speed) == (6.0, 16000.0)  # of the library
    cut, drilled = job.operations
    assert (cut.tool.diameter, cut.process.feed, cut.process.spindle) == (6.0, 10.0, 16000.0)
    # 180 mm/min are 3 mm/s.
    assert (drilled.tool.kind, drilled.process.feed, drilled.process.spindle) == (
        "drill",
        3.0,
        2500,
    )


def test_set_counts_the_rows_of_the_job(job_file: Path) -> None:
    assert load_job(job_file, ["tools.0.feed=5"]).tools[1].feed == 5.0
    with pytest.raises(
        JobError, match=r"there is no tools\.2: the job has 2 rows of \[\[tools\]\]"
    ):
        load_job(job_file, ["tools.2.feed=5"])


def test_a_library_may_be_named_by_set_and_in_python(job_file: Path) -> None:
    library = library_of(job_file)
    named = load_job(None, [f"tool.file={library}"])
    assert [tool.name for tool in named.tools] == ["drill 8", "mill 6", "mill 3"]
    mapping = {"tool": {"file": str(library)}, "tools": [{"name": "mill 3", "number": 9}]}
    job = from_mapping(mapping)
    assert [(tool.name, tool.number, tool.diameter) for tool in job.tools][2] == ("mill 3", 9, 3.0)


def test_the_library_is_among_the_files_that_were_opened(job_file: Path) -> None:
    files = Files()
    load_job(job_file, (), files)
    assert library_of(job_file).resolve() in [path.resolve() for path in files.opened.values()]


@pytest.mark.parametrize("operation", ['kind = "follow"\ntool = 2', ""], ids=["cut", "replayed"])
def test_the_digest_covers_the_library(job_file: Path, operation: str) -> None:
    """A job without operations replays a program, which selects tools by their numbers."""
    rows = f"[[operations]]\n{operation}\n" if operation else ""
    job_file.write_text(f'[tool]\nfile = "lib/shop.toml"\n{rows}', encoding="utf-8")
    part = make_part([[(0, 0), (10, 0), (10, 10), (0, 0)]])
    before = compute_digest(load_job(job_file), [part], Files())
    assert before == compute_digest(load_job(job_file), [part], Files())
    changed = LIBRARY.replace("diameter = 6.0", "diameter = 6.1")
    library_of(job_file).write_text(changed, encoding="utf-8")
    assert before != compute_digest(load_job(job_file), [part], Files())


def test_tools_of_a_library_without_operations_are_refused(job_file: Path) -> None:
    drawing = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    job = {"tool": {"file": str(library_of(job_file))}}
    with pytest.raises(JobError) as error:
        camgen.build(drawing, post="gcode", job=job)
    assert str(error.value) == (
        "job: has tools and no operation that names one ([[tools]] or tool.file); "
        "write [[operations]]"
    )


FAULTS = {
    'diameter = "x"': 'diameter must be a number > 0, not "x" ([[tools]] 2)',
    "diamter = 3.0": 'unknown key "diamter" ([[tools]] 2); nearest is diameter',
    "number = 2": "number 2 is also that of another tool ([[tools]] 2); give each its own",
    'name = "mill 6"': 'name "mill 6" is also that of another tool ([[tools]] 2); '
    "give each its own",
    "": "a tool of a library has no name ([[tools]] 2); name it: jobs find it by its name",
    'file = "a.toml"': 'unknown key "file" ([[tools]] 2); it belongs to [tool]',
    'feed = "20 mm"': "feed must be a number in mm/s or a text with its unit, not",
    "length = [": "is not TOML: ",
    "[cell]": "is a library of tools, but has [cell]; keep only [[tools]] in it",
    "[[operations]]": "is a library of tools, but has [[operations]] 0; keep only [[tools]] in it",
}


@pytest.mark.parametrize("line", FAULTS)
def test_a_fault_of_the_library_names_its_file_and_row(job_file: Path, line: str) -> None:
    library = library_of(job_file)
    two_tools = LIBRARY.partition('name = "mill 3"')[0]
    library.write_text(f"{two_tools}{line}\n", encoding="utf-8")
    with pytest.raises(JobError) as error:
        load_job(job_file)
    assert str(error.value).startswith(f"{library}: {FAULTS[line]}")


def test_a_library_without_tools_is_refused(job_file: Path) -> None:
    library_of(job_file).write_text("", encoding="utf-8")
    with pytest.raises(JobError) as error:
        load_job(job_file)
    remedy = "add one, or leave tool.file out"
    assert str(error.value) == f"{library_of(job_file)}: holds no [[tools]] (tool.file); {remedy}"


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        # Row 0 of the job changes "mill 6". The number of "mill 3" there is a fault of the job.
        (
            "tools.0.number=3",
            "number 3 is also that of another tool ([[tools]] 0); give each its own",
        ),
        (
            "tools.1.number=2",
            "number 2 is also that of another tool ([[tools]] 1); give each its own",
        ),
        ("tools.0.diameter=0", "diameter must be a number > 0, not 0 ([[tools]] 0)"),
        ("tools.0.file=a", 'unknown key "file" ([[tools]] 0); it belongs to [tool]'),
        ("tool.file=3", "file must be a text, not 3 ([tool])"),
    ],
)
def test_a_fault_of_the_job_names_the_row_of_the_job(
    job_file: Path, setting: str, message: str
) -> None:
    with pytest.raises(JobError) as error:
        load_job(job_file, [setting])
    assert str(error.value) == f"--set {setting}: {message}"


def test_a_missing_library_is_refused_with_its_setting(job_file: Path) -> None:
    library_of(job_file).unlink()
    with pytest.raises(
        JobError, match=r"shop\.toml: cannot be read: .* \(tool\.file\); give a file"
    ):
        load_job(job_file)


def test_the_limits_of_a_job_hold_for_its_library(job_file: Path) -> None:
    library = library_of(job_file)
    library.write_text(LIBRARY.replace("diameter = 3.0", "length = 20000.0"), encoding="utf-8")
    assert load_job(job_file).tools[2].length == 20000.0
    with pytest.raises(JobError) as error:
        load_job(job_file, ["limits.number=18000"])
    assert str(error.value).startswith(f"{library}: length cannot be beyond 18,000: 20000.0")


def test_an_empty_file_of_a_library_is_the_default() -> None:
    assert from_mapping({"tool": {"file": ""}}) == Job()
