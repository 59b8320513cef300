"""The commands and links of CONTRIBUTING.md work, and the places in docs/architecture.md exist."""

import importlib
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = "".join(re.findall(r"```sh\n(.*?)```", TEXT, re.S)).splitlines()
PLACES = re.findall(
    r"^\| [^|]+\? \| `([\w.]+):(\w+)` \|$",
    (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"),
    re.M,
)


@pytest.mark.parametrize("command", [line for line in COMMANDS if "/pytest" in line])
def test_a_command_of_pytest_finds_tests(command: str) -> None:
    words = shlex.split(command)[1:]
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    # All tests take long to collect. The options for all tests are in the README, which CI runs.
    if not any(word.startswith("tests") for word in words):
        assert " ".join(words) in README
        return
    process = subprocess.run(
        [*collect, *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stdout + process.stderr
    counts = re.findall(r"^tests/\S+\.py: (\d+)$", process.stdout, re.M)
    assert sum(map(int, counts)) > 100


@pytest.mark.parametrize("command", [line for line in COMMANDS if "/pytest" not in line])
def test_the_other_commands_are_those_of_ci(command: str) -> None:
    if command.startswith("git"):
        assert (ROOT / shlex.split(command)[-1]).is_dir()
    elif "pip install" in command or "-m venv" in command:
        assert command.replace("pip install", "pip install -q") in README
    else:
        assert command in CI


def test_the_modules_of_commands_exist() -> None:
    modules = re.findall(r"`python -m ([\w.]+)", TEXT)
    assert modules == ["tests.support.texture"]
    assert [module for module in modules if find_spec(module) is None] == []
    assert "`python fixtures/make.py`" in TEXT
    assert (ROOT / "fixtures" / "make.py").is_file()


def test_the_links_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    assert len(links) > 4
    assert [link for link in links if not (ROOT / link).is_file()] == []


def test_the_table_of_places_has_its_rows() -> None:
    assert len(PLACES) >= 15


@pytest.mark.parametrize(("module", "function"), PLACES)
def test_a_place_exists(module: str, function: str) -> None:
    assert callable(getattr(importlib.import_module(module), function))
