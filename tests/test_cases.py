"""Golden programs: each folder of fixtures/cases holds a job and what it makes, as a plan and for every controller.

The part is the drawing or the mesh of fixtures/parts whose name the folder's name begins with. ``posts.toml`` may hold
the options of ``[post]`` for single controllers, ``robots.toml`` the robots that check their programs. A 3-D part has a
program for the controller of its robot only. A changed expectation
(``pytest --accept``) needs its reason in the changelog.
"""

import tomllib
from functools import cache
from pathlib import Path

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
# A tool that leans is for an arm of six axes.
LEANING = [
    case for case in CASES if (FIXTURES / "parts" / f"{case.name.split('-')[0]}.xyz").exists()
]
ARMS = ("rapid", "pacscript")
ALL = [(case, post) for case in FLAT for post in (ARMS if case in LEANING else POSTS)]
ALL += [(case, "rapid") for case in SOLID]


@cache
def built(case: Path, post: str) -> Result:
    job = tomllib.loads((case / "job.toml").read_text())
    options = case / "posts.toml"
    if options.exists():
        job["post"] = tomllib.loads(options.read_text()).get(post, {})
    robots = case / "robots.toml"
    if robots.exists():
        job["cell"]["robot"] = tomllib.loads(robots.read_text()).get(post, "")
    part = next(part for part in parts(case) if part.exists())
    return camgen.build(part, post=post, job=job, name="part")


def parts(case: Path) -> list[Path]:
    """What the case may be about: the first word of its name with an ending."""
    return [FIXTURES / "parts" / (case.name.split("-")[0] + ending) for ending in ENDINGS]


def compare(file: Path, text: str, accept: bool) -> None:
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


@pytest.mark.parametrize(("case", "post"), ALL, ids=lambda one: getattr(one, "name", one))
def test_the_program_is_the_expected_one(case: Path, post: str, accept: bool) -> None:
    result = built(case, post)
    for file in result.files:
        compare(case / "expected" / file.name, file.text, accept)
    # The digits of a text move both ends of a motion by half of the last one.
    assert result.rounded.excess <= 0.001


@pytest.mark.parametrize("post", POSTS)
def test_the_same_job_gives_the_same_bytes(post: str) -> None:
    assert built.__wrapped__(CASES[0], post).text == built(CASES[0], post).text
