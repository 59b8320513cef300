"""camgen verify of a program of ours takes the post from its header, if job and part agree."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from camgen.cli import main

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
JOB = "[operation]\nkind = 'trace'\n[tool]\ndiameter = 4.0\n"
SUFFIXES = {"gcode": "ngc", "grbl": "nc", "rapid": "mod", "pacscript": "pcs", "vplus": "v2"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(PARTS / "bracket.dxf", tmp_path)
    (tmp_path / "bracket.toml").write_text(JOB)
    return tmp_path


def build(post: str) -> str:
    assert main(["build", "bracket.dxf", "--post", post, "-q"]) == 0
    return f"bracket.{SUFFIXES[post]}"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("post", SUFFIXES)
def test_the_header_names_the_post(post: str, capsys: pytest.CaptureFixture[str]) -> None:
    program = build(post)
    assert main(["verify", program]) == 0
    named = capsys.readouterr().out
    assert main(["verify", program, "--post", post]) == 0
    lines = [line for line in named.splitlines() if not line.startswith("plan ")]
    assert len(lines) == named.count("\n") - 1
    assert capsys.readouterr().out.splitlines() == lines
    # As the job is known, the program is read back and not judged by its language.
    assert "language" not in named


@pytest.mark.parametrize("file", ["bracket.toml", "bracket.dxf"])
def test_a_job_or_a_part_that_has_changed_is_named(
    folder: Path, file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program = build("rapid")
    with (folder / file).open("a") as text:
        text.write("[process]\nfeed = 5.0\n" if file.endswith("toml") else "0\nEOF\n")
    assert main(["verify", program]) == 2
    assert "the job or the part has changed since" in capsys.readouterr().err
    assert main(["verify", program, "--post", "rapid"]) == 0


@pytest.mark.parametrize("name", ["../bracket.dxf", "/etc/passwd", "other.dxf"])
def test_no_file_that_the_header_names_is_opened(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program = Path(build("rapid"))
    (folder / "other.dxf").write_bytes((folder / "bracket.dxf").read_bytes())
    program.write_text(program.read_text().replace("part: bracket.dxf", f"part: {name}"))
    assert main(["verify", str(program)]) == 2
    assert "no part bracket.* stands beside the program" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_a_post_that_is_not_installed_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    program = Path(build("rapid"))
    program.write_text(program.read_text().replace("post: rapid", "post: karel"))
    assert main(["verify", str(program)]) == 2
    assert "the header names karel, which is not installed" in capsys.readouterr().err


def test_one_of_several_programs_has_the_job_of_all(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        '[[tools]]\nname = "drill"\nnumber = 1\nkind = "drill"\ndiameter = 8\nspeed = 3000',
        '[[tools]]\nname = "mill"\nnumber = 2\ndiameter = 6\nlength = 80\nspeed = 9000',
        '[[operations]]\nkind = "drill"\ntool = "drill"\ndepth = 10\nholes = [7.9, 8.1]',
        '[[operations]]\nkind = "follow"\ntool = "mill"\nlayers = ["OUTLINE"]\ndepth = 3',
    ]
    (folder / "bracket.toml").write_text("\n".join(rows))
    build("grbl")
    assert main(["verify", "bracket_2.nc"]) == 0
    assert "language" not in capsys.readouterr().out
