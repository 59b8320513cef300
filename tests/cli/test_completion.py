import os
import re
import select
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from camgen.cli import main, make_parsers
from camgen.model.job_tables import list_settings
from camgen.post.plugins import list_installed
from camgen.robots.catalogue import find_robot
from tests.support.waiting import LONG

COMMANDS = set(make_parsers()[1])


@pytest.fixture
def script(
    request: pytest.FixtureRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Path:
    """The completion script of the shell that the parameter names."""
    assert main(["completion", request.param]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    file = tmp_path / f"camgen.{request.param}"
    file.write_text(printed.out)
    return file


def complete_in_bash(script: Path, folder: Path, *words: str) -> set[str]:
    """The words that bash offers for the last word. `words` are split as bash splits a line."""
    code = (
        f"source {script}; COMP_WORDS=({' '.join(repr(word) for word in words)}); "
        f"COMP_CWORD={len(words) - 1}\n"
        '_camgen\n(( ${#COMPREPLY[@]} )) && printf "%s\\n" "${COMPREPLY[@]}"; true'
    )
    process = subprocess.run(
        ["bash", "--norc", "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    assert process.stderr == ""
    return set(process.stdout.splitlines())


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize("script", ["bash"], indirect=True)
def test_bash_completes_commands_options_settings_and_files(script: Path, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "my part.dxf").touch()
    (folder / "own.py").touch()

    def offered(*words: str) -> set[str]:
        return complete_in_bash(script, folder, "camgen", *words)

    assert offered("") == COMMANDS | {"--help", "--version"}
    assert offered("ba") == {"batch"}
    assert offered("build", "") == {"my part.dxf", "own.py"}
    assert offered("build", "my") == {"my part.dxf"}
    assert offered("build", "--pl") == {"--plan"}
    assert offered("batch", "--") >= {"--jobs", "--dask", "--strict", "--set", "--post"}
    posts = {post.name for post in list_installed()}
    assert offered("build", "my part.dxf", "--post", "") == posts | {"my part.dxf", "own.py"}
    assert offered("build", "--post", "r") == {"rapid"}
    assert offered("build", "--post", "=", "r") == {"rapid"}
    assert offered("robots", "irb120") == {"irb120", "irb1200"}
    assert offered("build", "--set", "") == {f"{s.table}.{s.key}=" for s in list_settings()}
    assert offered("build", "--set", "operation.k") == {"operation.kind="}
    kinds = {
        "auto",
        "follow",
        "trace",
        "fill",
        "pocket",
        "bore",
        "chamfer",
        "drill",
        "edges",
        "replay",
    }
    assert offered("build", "--set", "operation.kind", "=") == kinds
    assert offered("build", "--set", "operation.kind", "=", "f") == {"follow", "fill"}
    assert offered("build", "--set", "=", "operation.kind", "=", "f") == {"follow", "fill"}
    assert offered("build", "--set", "operation.kind", "=", "fill", "my") == {"my part.dxf"}
    assert "irb120" in offered("build", "--set", "cell.robot", "=", "")
    for word in offered("robots", "") - {"my part.dxf", "own.py"}:
        assert find_robot(word)
    assert offered("completion", "") == {"bash", "zsh", "fish"}
    assert offered("posts", "") == set()
    assert offered("batch", "--jobs", "") == set()


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
@pytest.mark.parametrize("script", ["fish"], indirect=True)
def test_fish_completes_commands_options_settings_and_files(script: Path, tmp_path: Path) -> None:
    (tmp_path / "part.dxf").touch()

    def offered(line: str) -> set[str]:
        command = ["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"]
        home = os.environ | {"HOME": str(tmp_path)}
        process = subprocess.run(
            command, cwd=tmp_path, env=home, capture_output=True, text=True, check=True
        )
        return {row.split("\t")[0] for row in process.stdout.splitlines()}

    assert offered("camgen ") == COMMANDS
    assert offered("camgen build p") == {"part.dxf"}
    assert offered("camgen build one.dxf p") == {"part.dxf"}
    assert offered("camgen build --pl") == {"--plan"}
    assert offered("camgen build --post r") == {"rapid"}
    assert offered("camgen build --set operation.kind=f") >= {
        "operation.kind=follow",
        "operation.kind=fill",
    }
    assert offered("camgen robots irb240") == {"irb2400"}
    assert offered("camgen posts ") == set()


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
@pytest.mark.parametrize("script", ["zsh"], indirect=True)
def test_zsh_completes_commands_options_settings_and_files(script: Path, tmp_path: Path) -> None:
    """The Tab key is pressed at the prompt of a new zsh, after either way of loading the script."""
    (tmp_path / "part.dxf").touch()
    for source, typed, wanted in (
        ("source", "camgen inspe", "camgen inspect"),
        ("eval", "camgen inspe", "camgen inspect"),
        ("source", "camgen build par", "camgen build part.dxf"),
        ("source", "camgen verify one.mod par", "camgen verify one.mod part.dxf"),
        ("source", "camgen build one.dxf --pl", "camgen build one.dxf --plan"),
        ("source", "camgen build --post rap", "camgen build --post rapid"),
        ("source", "camgen build --set operation.ki", "camgen build --set operation.kind="),
        (
            "source",
            "camgen build --set operation.kind=dr",
            "camgen build --set operation.kind=drill",
        ),
        ("source", "camgen robots irb240", "camgen robots irb2400"),
    ):
        load = {"source": f"source {script}", "eval": f'eval "$(<{script})"'}[source]
        lines = (
            "autoload -U compinit",
            "compinit -u -D",
            load,
            "PROMPT='ready> '",
            "bindkey '^I' complete-word",
        )
        (tmp_path / ".zshrc").write_text("\n".join(lines) + "\n")
        assert wanted in _complete_in_zsh(typed, wanted, tmp_path), (source, typed)


def _complete_in_zsh(typed: str, wanted: str, folder: Path) -> str:
    """The text of a terminal after Tab, read until it holds `wanted`."""
    import pty  # noqa: PLC0415 (POSIX only)

    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execvpe(
            "zsh",
            ["zsh", "-i"],
            os.environ | {"ZDOTDIR": str(folder), "TERM": "vt100", "COLUMNS": "200"},
        )
    screen, has_typed, deadline = "", False, time.monotonic() + LONG
    while wanted not in screen and time.monotonic() < deadline:
        if select.select([terminal], [], [], 0.2)[0]:
            screen += re.sub(r"[\x00\x07]|.\x08", "", os.read(terminal, 65536).decode())
        if "ready> " in screen and not has_typed:
            os.write(terminal, typed.encode() + b"\t")
            has_typed = True
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    os.close(terminal)
    return screen
