"""The tutorial about posts: its pieces are in the example, and its commands run in their order."""

import dataclasses
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from itertools import chain
from pathlib import Path

import pytest

from camgen.post import Post
from camgen.post.kit import FEATURES, WHOLE
from camgen.post.plugins import find_post

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "docs" / "example_post"
PAGE = (ROOT / "docs" / "writing-a-post.md").read_text(encoding="utf-8")
BLOCK = re.compile(r'^```(\w+)(?: title="([\w.]+)")?\n(.*?)^```$', re.S | re.M)


def read_files() -> dict[str, str]:
    """The texts of the files of the example, by name."""
    return {
        path.name: path.read_text(encoding="utf-8") for path in EXAMPLE.iterdir() if path.is_file()
    }


def list_commands() -> list[str]:
    """The commands of the page, without their prompt."""
    commands: list[str] = []
    for language, _, body in BLOCK.findall(PAGE):
        if language == "console":
            commands += [line[2:] for line in body.splitlines()]
    return commands


def list_outputs() -> list[str]:
    return [
        body for language, title, body in BLOCK.findall(PAGE) if language == "text" and not title
    ]


def test_the_page_shows_pieces_of_the_example() -> None:
    """Each block with a file name consists of whole lines of this file, and each file is shown."""
    shown = [(title, body) for _, title, body in BLOCK.findall(PAGE) if title]
    assert {title for title, _ in shown} == set(read_files())
    for title, body in shown:
        assert "\n" + body in "\n" + read_files()[title], f"{title}: {body}"


@pytest.mark.parametrize("name", ["krl.py", "krl_language.py"])
def test_the_example_is_as_short_as_promised(name: str) -> None:
    assert len(read_files()[name].splitlines()) < 200


def test_the_language_does_not_import_the_post() -> None:
    assert not re.search(r"^\s*(?:from|import) krl\b", read_files()["krl_language.py"], re.M)
    assert "fixed_xyz" not in read_files()["krl_language.py"]


def test_the_table_of_overrides_names_all_members_of_a_post() -> None:
    """The table names the methods and class variables of a post, and no others."""
    rows = dict(re.findall(r"^\| \*\*(.+) override\*\* \| (.*) \|$", PAGE, re.M))
    assert set(rows) == {"Must", "May", "Don't"}
    names_of = {row: re.findall(r"`(\w+)`", text) for row, text in rows.items()}
    all_names = set(chain.from_iterable(names_of.values()))
    options = {option.name for option in dataclasses.fields(Post)}
    members = {
        name for name in {*vars(Post), *Post.__annotations__} if not name.startswith("_")
    } - options
    assert all_names == members
    abstract = {name for name in names_of["Must"] if name not in Post.__annotations__}
    assert abstract == Post.__abstractmethods__


def test_the_page_explains_all_features_of_the_kit() -> None:
    table = PAGE.partition("`camgen.post.kit.FEATURES`:")[2].partition("\n\n`conformance")[0]
    words: list[str] = []
    for row in re.findall(r"^\| (`.*?) \|", table, re.M):
        words += re.findall(r"`([^`]+)`", row)
    assert sorted(words) == sorted([*FEATURES, *WHOLE])


def test_options_are_those_of_the_job_on_the_page() -> None:
    (job,) = (
        body for language, title, body in BLOCK.findall(PAGE) if language == "toml" and not title
    )
    known = {
        option.name
        for option in dataclasses.fields(find_post(str(EXAMPLE / "krl.py")))
        if option.init
    }
    assert set(re.findall(r"^(\w+) =", job, re.M)) <= known


# -- the commands


def make_offline(words: list[str], site: Path) -> list[str]:
    """The command of the page for this Python. `pip` installs into a folder, without an index."""
    match words:
        case ["camgen", *rest]:
            return [sys.executable, "-m", "camgen", *rest]
        case ["pytest", *rest]:
            return [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *rest]
        case ["pip", "install", "."]:
            is_recent = tuple(int(n) for n in version("setuptools").split(".")[:2]) >= (70, 1)
            if is_recent or importlib.util.find_spec("wheel"):
                offline = [
                    "-q",
                    "--no-deps",
                    "--no-build-isolation",
                    "--no-index",
                    "--target",
                    str(site),
                ]
                return [sys.executable, "-m", "pip", "install", *offline, "."]
            # pip needs the package wheel for setuptools before 70.1. The commands of setuptools
            # install the same files.
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
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder that the page makes within that of camgen, and the output of each command."""
    if importlib.util.find_spec("setuptools") is None:
        pytest.skip("setuptools, which builds the example package, is not installed")
    camgen_folder = tmp_path_factory.mktemp("camgen")
    folder, site = camgen_folder / "krl_post", camgen_folder / "site"
    folder.mkdir()
    shutil.copytree(ROOT / "fixtures" / "parts", camgen_folder / "fixtures" / "parts")
    shutil.copytree(EXAMPLE, camgen_folder / "docs" / "example_post")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    printed = {}
    for command in list_commands():
        words = make_offline(shlex.split(command), site)
        process = subprocess.run(
            words, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert process.returncode == 0, f"{command}\n{process.stdout}{process.stderr}"
        printed[command] = process.stdout + process.stderr
    return folder, printed


def test_the_commands_of_the_page_run(tutorial: tuple[Path, dict[str, str]]) -> None:
    _, printed = tutorial
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


def test_the_conformance_kit_of_the_page_passes(tutorial: tuple[Path, dict[str, str]]) -> None:
    passed = re.search(r"(\d+) passed", tutorial[1]["pytest -q test_krl.py"])
    assert passed
    assert int(passed[1]) > 60


def test_the_outputs_on_the_page_are_printed(tutorial: tuple[Path, dict[str, str]]) -> None:
    folder, printed = tutorial
    post_row, program = list_outputs()
    assert post_row in printed["camgen posts"]
    assert program in (folder / "bracket.src").read_text(encoding="ascii")


def test_the_installed_package_runs(tutorial: tuple[Path, dict[str, str]]) -> None:
    """The entry points are those of the installed package, not of the files in the folder."""
    folder, _ = tutorial
    assert list((folder.parent / "site").glob("camgen_krl-1.0*"))
    assert (folder.parent / "site" / "krl.py").read_text(encoding="utf-8") == read_files()["krl.py"]
