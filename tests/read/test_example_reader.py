"""The example reader of docs/writing-a-reader.md: the page shows it as it is, and it works as an installed package."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.installed import install, run

DOCS = Path(__file__).parents[2] / "docs"
EXAMPLE = DOCS / "example_reader"
SLOT = "# a slot and a line\n0,0\n80,0\n80,30\n0,30\n0,0\n\n10 10\n70 10\n\n\n5,5,1\n6,6,2\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(EXAMPLE, tmp_path_factory.mktemp("example"))


def test_the_page_shows_the_package_as_it_is() -> None:
    text = (DOCS / "writing-a-reader.md").read_text()
    blocks = dict(re.findall(r'```\w+ title="(.+?)"\n(.*?)```', text, re.S))
    assert blocks == {
        name: (EXAMPLE / name).read_text() for name in ("point_lists.py", "pyproject.toml")
    }


def test_it_is_as_short_as_promised() -> None:
    assert len((EXAMPLE / "point_lists.py").read_text().splitlines()) < 80


def test_the_installed_reader_builds_a_program(site: Path, tmp_path: Path) -> None:
    (tmp_path / "slot.xy").write_text(SLOT)
    done = run(site, "-m", "camgen", "build", "slot.xy", "--post", "gcode", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "slot.xy: mm, 2 contours (1 closed, 1 open), layer 0" in done.stderr
    assert "the contour in line 12 (its points differ in z: contours are flat)" in done.stderr
    xs = [float(x) for x in re.findall(r"X(-?[\d.]+)", (tmp_path / "slot.ngc").read_text())]
    assert np.ptp(xs) == pytest.approx(80, abs=10)


def test_it_is_asked_for_standard_input_by_name_and_by_suffix(site: Path, tmp_path: Path) -> None:
    said = []
    for name in ("points", "xy"):
        done = run(
            site, "-m", "camgen", "inspect", "-", "--format", name, data=SLOT, folder=tmp_path
        )
        assert done.returncode == 0, done.stderr
        said.append(done.stdout.splitlines())
    assert said[0] == said[1]
    assert said[0][:3] == ["list of points, units mm", "c1: 4 points, closed", "c2: 2 points, open"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1,2\n3,4\nx,5\n", "bad.xy: 'x,5' is no point (line 3)"),
        ("1,2\n3\n", "bad.xy: '3' is no point (line 2)"),
        ("1,2,3,4\n", "bad.xy: '1,2,3,4' is no point (line 1)"),
        ("1,2\nnan,2\n", "bad.xy: a coordinate is not finite (line 2)"),
        ("# nothing\n", "bad.xy: nothing to machine; give two or more lines x,y"),
    ],
)
def test_what_is_no_list_is_refused_in_one_line(
    site: Path, tmp_path: Path, text: str, says: str
) -> None:
    (tmp_path / "bad.xy").write_text(text)
    done = run(site, "-m", "camgen", "build", "bad.xy", "--post", "gcode", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"camgen: error: {says}\n")
