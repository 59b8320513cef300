"""The example of docs/writing-an-operation.md: it is installed and used, the page shows it."""

import json
import re
from itertools import pairwise
from pathlib import Path

import pytest

from tests.support.installed import install, run

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_operation"
PAGE = (ROOT / "docs" / "writing-an-operation.md").read_text(encoding="utf-8")
#: Builds a part with a job. Prints the ends, contours and operation of each path, the number of
#: paths in the program, and the deviation of the read-back, mm.
CODE = """
import json, sys, camgen
result = camgen.build(sys.argv[1], post="gcode", job=json.loads(sys.argv[2]))
paths = []
for p in result.tour.paths:
    paths.append((p.position[0].tolist(), p.position[-1].tolist(), p.contours, p.operation))
print(json.dumps([paths, len(result.program.paths), result.deviation.max_mm]))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(EXAMPLE, tmp_path_factory.mktemp("hatch"))


def test_the_page_shows_the_files() -> None:
    shown = re.findall(r'^```\w+ title="([^"]+)"\n(.*?)^```$', PAGE, re.S | re.M)
    assert [name for name, _ in shown] == ["hatch.py", "pyproject.toml"]
    for name, text in shown:
        assert text == (EXAMPLE / name).read_text(encoding="utf-8")


def test_the_operation_hatches_with_its_spacing_and_its_angle(site: Path) -> None:
    part = ROOT / "fixtures" / "parts" / "bracket.dxf"
    job = {"operation": {"kind": "hatch", "options": {"spacing": 4.0, "angle": 0.0}}}
    done = run(site, "-c", CODE, str(part), json.dumps(job))
    assert done.returncode == 0, done.stderr
    paths, origins, deviation = json.loads(done.stdout)
    assert origins == len(paths) > 5
    assert deviation < 1e-3
    heights = sorted({round(start[1], 6) for start, _, _, _ in paths})
    assert all(start[1] == pytest.approx(end[1]) for start, end, _, _ in paths)
    assert [b - a for a, b in pairwise(heights)] == pytest.approx([4.0] * (len(heights) - 1))
    assert {operation for *_, operation in paths} == {"hatch"}
    assert all(len(contours) > 1 for _, _, contours, _ in paths)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"operation": {"kind": "hatch", "options": {"spacng": 4.0}}}, "spacng"),
        ({"operation": {"kind": "hatch", "options": {"spacing": "wide"}}}, "Expected `float`"),
        ({"operation": {"kind": "hatch", "options": {"spacing": 0.0}}}, "nothing to hatch"),
        ({"operation": {"kind": "hutch"}}, "kind must be one of"),
    ],
)
def test_a_wrong_setting_is_an_error(site: Path, tables: dict[str, object], message: str) -> None:
    part = ROOT / "fixtures" / "parts" / "bracket.dxf"
    done = run(site, "-c", CODE, str(part), json.dumps(tables))
    assert done.returncode == 1
    assert message in done.stderr.splitlines()[-1]


def test_a_solid_is_refused_before_the_operation_sees_it(site: Path) -> None:
    job = {"operation": {"kind": "hatch"}}
    done = run(site, "-c", CODE, str(ROOT / "fixtures" / "parts" / "rfa1.stl"), json.dumps(job))
    assert '"hatch" is for flat parts, this is a 3-D part' in done.stderr


def test_the_job_of_the_page_builds_on_the_command_line(site: Path, tmp_path: Path) -> None:
    block = re.search(r"^```text\n(.*?)^```$", PAGE, re.S | re.M)
    (tmp_path / "job.toml").write_text(block[1])  # type: ignore[index]
    part = str(ROOT / "fixtures" / "parts" / "bracket.dxf")
    command = ["-m", "camgen", "build", part, "--post", "gcode", "--job", "job.toml"]
    done = run(site, *command, "-o", "a.ngc", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.ngc").exists()
