import os
import shutil
import subprocess
from pathlib import Path

import pytest

from camgen.cli import main, parsers
from camgen.cli_job import settings
from camgen.plugins import installed
from camgen.robots.models import robots

COMMANDS = set(parsers()[1])
#: A folder that holds a shell's own functions where it is not installed in the usual place.
ZSH_FUNCTIONS = os.environ.get("ZSH_FUNCTIONS", "")


@pytest.fixture
def script(request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """The completion script of the shell that is asked for."""
    assert main(["completion", request.param]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    file = tmp_path / f"camgen.{request.param}"
    file.write_text(said.out)
    return file


def completed_by_bash(script: Path, folder: Path, *words: str) -> set[str]:
    """What bash offers for the last of the words, which it has cut as it does at a prompt."""
    code = (
        f"source {script}; COMP_WORDS=({' '.join(repr(word) for word in words)}); COMP_CWORD={len(words) - 1}\n"
        '_camgen\n(( ${#COMPREPLY[@]} )) && printf "%s\\n" "${COMPREPLY[@]}"; true'
    )
    done = subprocess.run(["bash", "--norc", "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return set(done.stdout.splitlines())


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("script", ["bash"], indirect=True)
def test_bash(script: Path, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "my part.dxf").touch()
    (folder / "own.py").touch()

    def offered(*words: str) -> set[str]:
        return completed_by_bash(script, folder, "camgen", *words)

    assert offered("") == COMMANDS | {"--help", "--version"}
    assert offered("ba") == {"batch"}
    assert offered("build", "") == {"my part.dxf", "own.py"}
    assert offered("build", "my") == {"my part.dxf"}
    assert offered("build", "--pl") == {"--plan"}
    assert offered("batch", "--") >= {"--jobs", "--dask", "--strict", "--set", "--post"}
    posts = {post.name for post in installed()}
    assert offered("build", "my part.dxf", "--post", "") == posts | {"my part.dxf", "own.py"}
    assert offered("build", "--post", "r") == {"rapid"}
    assert offered("build", "--post", "=", "r") == {"rapid"}
    assert offered("robots", "irb120") == {robot.name for robot in robots() if robot.name.startswith("irb120")}
    assert offered("build", "--set", "") == {f"{s.table}.{s.key}=" for s in settings()}
    assert offered("build", "--set", "operation.k") == {"operation.kind="}
    kinds = {"auto", "follow", "trace", "fill", "drill", "edges", "replay"}
    assert offered("build", "--set", "operation.kind", "=") == kinds
    assert offered("build", "--set", "operation.kind", "=", "f") == {"follow", "fill"}
    assert "irb120" in offered("build", "--set", "cell.robot", "=", "")
    assert offered("completion", "") == {"bash", "zsh", "fish"}
    assert offered("posts", "") == set()
    assert offered("batch", "--jobs", "") == set()


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
@pytest.mark.parametrize("script", ["fish"], indirect=True)
def test_fish(script: Path, tmp_path: Path) -> None:
    (tmp_path / "part.dxf").touch()

    def offered(line: str) -> set[str]:
        command = ["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"]
        home = os.environ | {"HOME": str(tmp_path)}
        done = subprocess.run(command, cwd=tmp_path, env=home, capture_output=True, text=True, check=True)
        return {said.split("\t")[0] for said in done.stdout.splitlines()}

    assert offered("camgen ") == COMMANDS
    assert offered("camgen build p") == {"part.dxf"}
    assert offered("camgen build --pl") == {"--plan"}
    assert offered("camgen build --post r") == {"rapid"}
    assert offered("camgen build --set operation.kind=f") >= {"operation.kind=follow", "operation.kind=fill"}
    assert offered("camgen robots irb240") == {"irb2400"}
    assert offered("camgen posts ") == set()


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
@pytest.mark.parametrize("script", ["zsh"], indirect=True)
def test_zsh(script: Path, tmp_path: Path) -> None:
    """In a zsh of its own behind a pseudo terminal, asked as by the Tab key."""
    (tmp_path / "part.dxf").touch()
    (tmp_path / ".zshrc").write_text(
        f"fpath=({ZSH_FUNCTIONS} $fpath)\nautoload -U compinit; compinit -u -D\nsource {script}\n"
        "PROMPT='ready> '\nLISTMAX=10000\nunsetopt zle_bracketed_paste\nbindkey '^I' complete-word\n"
    )

    def shown(line: str, wanted: str) -> str:
        code = (
            f"zmodload zsh/zpty; zpty z env ZDOTDIR={tmp_path} TERM=vt100 COLUMNS=200 LINES=1000 zsh -i\n"
            f"zpty -r z text '*ready> *'; zpty -w -n z '{line}'$'\\t'; zpty -r z text '*{wanted}*' && print -r -- $text"
        )
        done = subprocess.run(["zsh", "-f", "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        return done.stdout

    for line, wanted in (
        ("camgen inspe", "inspect"),
        ("camgen build par", "part.dxf"),
        ("camgen build --pl", "--plan"),
        ("camgen build --post rap", "rapid"),
        ("camgen build --set operation.ki", "operation.kind="),
        ("camgen robots irb240", "irb2400"),
    ):
        assert wanted in shown(line, wanted), line
