"""Golden programs: each folder of fixtures/cases holds a job, its plan and its programs.

The name of the folder begins with the name of its part in fixtures/parts. `posts.toml` may hold the
options of [post] for single controllers, `robots.toml` the robots that check their programs. A 3-D
part has a program for the controller of its robot only. A changed expectation (`pytest --accept`)
needs its reason in the changelog.
"""

import tomllib
from functools import cache
from pathlib import Path

import msgspec
import pytest

import camgen
from camgen.lower import lower
from camgen.pipeline import Result
from fixtures.program_text import dump, parse

FIXTURES = Path(__file__).parents[1] / "fixtures"
CASES = sorted(p for p in (FIXTURES / "cases").iterdir() if p.is_dir())
ENDINGS = (".stl", ".dxf", ".svg", ".png", ".xyz")
POSTS = ("rapid", "pacscript", "vplus", "gcode", "grbl")
SOLID = [case for case in CASES if (FIXTURES / "parts" / f"{case.name.split('-')[0]}.stl").exists()]
FLAT = [case for case in CASES if case not in SOLID]
# Cases with a tilted tool, which needs an arm of six axes.
LEANING = [
    case for case in CASES if (FIXTURES / "parts" / f"{case.name.split('-')[0]}.xyz").exists()
]
ARMS = ("rapid", "pacscript")
#: Each case with each of its controllers.
ALL: list[tuple[Path, str]] = []
for _case in FLAT:
    ALL += [(_case, _post) for _post in (ARMS if _case in LEANING else POSTS)]
ALL += [(case, "rapid") for case in SOLID]


@cache
def built(case: Path, post: str) -> Result:
    """The result of a case for a controller. It is built once."""
    job = tomllib.loads((case / "job.toml").read_text())
    options = case / "posts.toml"
    if options.exists():
        job["post"] = tomllib.loads(options.read_text()).get(post, {})
    robots = case / "robots.toml"
    if robots.exists():
        job["cell"]["robot"] = tomllib.loads(robots.read_text()).get(post, "")
    return camgen.build(find_part(case), post=post, job=job, name="part")


def parts(case: Path) -> list[Path]:
    """The possible files of the part: the first word of the name of the case with each ending."""
    return [FIXTURES / "parts" / (case.name.split("-")[0] + ending) for ending in ENDINGS]


def find_part(case: Path) -> Path:
    """The file of the part of a case."""
    return next(part for part in parts(case) if part.exists())


def compare(file: Path, text: str, accept: bool) -> None:
    """Compares a text with the expected lines of a file. accept: the file is written first."""
    if accept:
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    assert file.exists(), f"{file.name} is not expected; look at it and run pytest --accept"
    assert text.splitlines() == file.read_text().splitlines()


def test_there_are_cases() -> None:
    assert len(CASES) >= 5


@pytest.mark.parametrize("case", FLAT, ids=lambda p: p.name)
def test_the_plan_is_the_expected_one(case: Path, accept: bool) -> None:
    result = built(case, "rapid")
    plan = dump(lower(result.tour, result.cell, result.job, "part", ()))
    compare(case / "expected" / "plan.ir", plan, accept)
    assert len(parse(plan).body) == plan.count("\n") - 5 - len(result.tour.paths)


@pytest.mark.parametrize(("case", "post"), ALL, ids=lambda value: getattr(value, "name", value))
def test_the_program_is_the_expected_one(case: Path, post: str, accept: bool) -> None:
    result = built(case, post)
    for file in result.files:
        compare(case / "expected" / file.name, file.text, accept)
    # Rounding to the digits of the text moves each end of a motion by half of the last digit.
    assert result.rounded.excess <= 0.001


@pytest.mark.parametrize(("case", "post"), ALL, ids=lambda value: getattr(value, "name", value))
def test_the_report_can_be_written(case: Path, post: str) -> None:
    assert msgspec.json.decode(msgspec.json.encode(built(case, post).report))


@pytest.mark.parametrize("post", POSTS)
def test_the_same_job_gives_the_same_bytes(post: str) -> None:
    assert built.__wrapped__(CASES[0], post).text == built(CASES[0], post).text
