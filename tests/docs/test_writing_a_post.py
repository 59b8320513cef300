"""The post tutorial: what it shows is in the example, and its commands are run in their order."""

import dataclasses
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from camgen.post import Post
from camgen.post.kit import FEATURES, WHOLE
from camgen.post.plugins import find_post

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_post"
PAGE = (ROOT / "docs" / "writing-a-post.md").read_text(encoding="utf-8")
BLOCK = re.compile(r'^```(\w+)(?: title="([\w.]+)")?\n(.*?)^```$', re.S | re.M)


def files() -> dict[str, str]:
    """The files of the example."""
    return {
        path.name: path.read_text(encoding="utf-8") for path in EXAMPLE.iterdir() if path.is_file()
    }


def commands() -> list[str]:
    return [
        line[2:]
        for language, _, body in BLOCK.findall(PAGE)
        if language == "console"
        for line in body.splitlines()
    ]


def outputs() -> list[str]:
    return [
        body for language, title, body in BLOCK.findall(PAGE) if language == "text" and not title
    ]


def test_the_page_shows_pieces_of_the_example() -> None:
    """Each block with a file name is whole lines of that file, and every file is shown."""
    shown = [(title, body) for _, title, body in BLOCK.findall(PAGE) if title]
    assert {title for title, _ in shown} == set(files())
    for title, body in shown:
        assert "\n" + body in "\n" + files()[title], f"{title}: {body}"


@pytest.mark.parametrize("name", ["krl.py", "krl_language.py"])
def test_the_example_is_as_short_as_promised(name: str) -> None:
    assert len(files()[name].splitlines()) < 200


def test_the_language_knows_nothing_of_the_post() -> None:
    assert not re.search(r"^\s*(?:from|import) krl\b", files()["krl_language.py"], re.M)
    assert "fixed_xyz" not in files()["krl_language.py"]


def test_what_may_be_overridden_is_there() -> None:
    """The table names every method and class variable of a post, each in one row, and none that is not there."""
    rows = dict(re.findall(r"^\| \*\*(.+) override\*\* \| (.*) \|$", PAGE, re.M))
    assert set(rows) == {"Must", "May", "Don't"}
    named = {row: re.findall(r"`(\w+)`", text) for row, text in rows.items()}
    everything = {name for row in named.values() for name in row}
    options = {one.name for one in dataclasses.fields(Post)}
    members = {
        name for name in {*vars(Post), *Post.__annotations__} if not name.startswith("_")
    } - options
    assert everything == members
    abstract = {name for name in named["Must"] if name not in Post.__annotations__}
    assert abstract == Post.__abstractmethods__


def test_the_words_of_the_kit_are_all_explained() -> None:
    table = PAGE.partition("`camgen.post.kit.FEATURES`:")[2].partition("\n\n`conformance")[0]
    words = [
        word
        for row in re.findall(r"^\| (`.*?) \|", table, re.M)
        for word in re.findall(r"`([^`]+)`", row)
    ]
    assert sorted(words) == sorted([*FEATURES, *WHOLE])


def test_options_are_those_of_the_job_on_the_page() -> None:
    (job,) = (
        body for language, title, body in BLOCK.findall(PAGE) if language == "toml" and not title
    )
    known = {one.name for one in dataclasses.fields(find_post(str(EXAMPLE / "krl.py"))) if one.init}
    assert set(re.findall(r"^(\w+) =", job, re.M)) <= known


# -- the commands


def without_network(words: list[str], site: Path) -> list[str]:
    """A command of the page as it runs here: by this Python, and ``pip`` into a folder, from what is installed."""
    match words:
        case ["camgen", *rest]:
            return [sys.executable, "-m", "camgen", *rest]
        case ["pytest", *rest]:
            return [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *rest]
        case ["pip", "install", "."]:
            recent = tuple(int(n) for n in version("setuptools").split(".")[:2]) >= (70, 1)
            if recent or importlib.util.find_spec("wheel"):
                offline = [
                    "-q",
                    "--no-deps",
                    "--no-build-isolation",
                    "--no-index",
                    "--target",
                    str(site),
                ]
                return [sys.executable, "-m", "pip", "install", *offline, "."]
            # setuptools before 70.1 needs the package wheel for pip; its own commands install the same files.
            steps = [
                "-q",
                "build",
                "-b",
                str(site / "b"),
                "install_lib",
                "-d",
                str(site),
                "install_egg_info",
                "-d",
            ]
            return [
                sys.executable,
                "-c",
                "import setuptools; setuptools.setup()",
                *steps,
                str(site),
            ]
    return words


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder that the page makes, in that of camgen, and what each of its commands prints."""
    if importlib.util.find_spec("setuptools") is None:
        pytest.skip("setuptools, which builds the example package, is not installed")
    camgen = tmp_path_factory.mktemp("camgen")
    folder, site = camgen / "krl_post", camgen / "site"
    folder.mkdir()
    shutil.copytree(ROOT / "fixtures" / "parts", camgen / "fixtures" / "parts")
    shutil.copytree(EXAMPLE, camgen / "docs" / "example_post")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    printed = {}
    for command in commands():
        words = without_network(shlex.split(command), site)
        done = subprocess.run(
            words, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        printed[command] = done.stdout + done.stderr
    return folder, printed


def test_the_commands_of_the_page_run(followed: tuple[Path, dict[str, str]]) -> None:
    _, printed = followed
    assert [command.split()[0] for command in printed] == [
        "cp",
        "pip",
        "pytest",
        "camgen",
        "cp",
        "camgen",
        "camgen",
    ]
    assert "read back, " in printed["camgen build bracket.dxf --post krl"]
    verified = printed["camgen verify bracket.src"]
    assert "KUKA KRL" in verified
    assert "refused" not in verified


def test_the_conformance_kit_of_the_page_is_green(followed: tuple[Path, dict[str, str]]) -> None:
    passed = re.search(r"(\d+) passed", followed[1]["pytest -q test_krl.py"])
    assert passed
    assert int(passed[1]) > 60


def test_what_the_page_shows_is_printed(followed: tuple[Path, dict[str, str]]) -> None:
    folder, printed = followed
    listed, program = outputs()
    assert listed in printed["camgen posts"]
    assert program in (folder / "bracket.src").read_text(encoding="ascii")


def test_the_installed_package_is_the_one_that_runs(followed: tuple[Path, dict[str, str]]) -> None:
    """Not the files in the folder, which are there too: entry points are of what is installed."""
    folder, _ = followed
    assert list((folder.parent / "site").glob("camgen_krl-1.0*"))
    assert (folder.parent / "site" / "krl.py").read_text(encoding="utf-8") == files()["krl.py"]
