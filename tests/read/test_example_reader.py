"""The example reader is shown in docs/writing-a-reader.md and works as an installed package."""

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


def test_the_page_shows_the_files_of_the_package() -> None:
    text = (DOCS / "writing-a-reader.md").read_text()
    blocks = dict(re.findall(r'```\w+ title="(.+?)"\n(.*?)```', text, re.S))
    assert blocks == {
        name: (EXAMPLE / name).read_text() for name in ("point_lists.py", "pyproject.toml")
    }


def test_the_example_has_fewer_than_80_lines() -> None:
    assert len((EXAMPLE / "point_lists.py").read_text().splitlines()) < 80


def test_the_installed_reader_builds_a_program(site: Path, tmp_path: Path) -> None:
    (tmp_path / "slot.xy").write_text(SLOT)
    done = run(site, "-m", "camgen", "build", "slot.xy", "--post", "gcode", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "slot.xy: mm, 2 contours (1 closed, 1 open), layer 0" in done.stderr
    assert "the contour in line 12 (its points differ in z: contours are flat)" in done.stderr
    xs = [float(x) for x in re.findall(r"X(-?[\d.]+)", (tmp_path / "slot.ngc").read_text())]
    assert np.ptp(xs) == pytest.approx(80, abs=10)


def test_the_reader_is_chosen_for_standard_input_by_name_and_by_suffix(
    site: Path, tmp_path: Path
) -> None:
    pages = []
    for name in ("points", "xy"):
        words = ["-m", "camgen", "inspect", "-", "--format", name]
        done = run(site, *words, data=SLOT, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        pages.append(done.stdout.splitlines())
    assert pages[0] == pages[1]
    assert pages[0][:3] == [
        "list of points, units mm",
        "c1: 4 points, closed",
        "c2: 2 points, open",
    ]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3,4\nx,5\n", "bad.xy: 'x,5' is not a point (line 3)"),
        ("1,2\n3\n", "bad.xy: '3' is not a point (line 2)"),
        ("1,2,3,4\n", "bad.xy: '1,2,3,4' is not a point (line 1)"),
        ("1,2\nnan,2\n", "bad.xy: a coordinate is not finite (line 2)"),
        ("# nothing\n", "bad.xy: nothing to machine; give two or more lines x,y"),
    ],
)
def test_an_invalid_list_is_refused_in_one_line(
    site: Path, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "bad.xy").write_text(text)
    done = run(site, "-m", "camgen", "build", "bad.xy", "--post", "gcode", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"camgen: error: {message}\n")
