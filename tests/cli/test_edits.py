"""A program that was edited by hand is replaced with --force alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from camgen.cli import main
from camgen.model.signature import read_signature, sign

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
JOB = """
[operation]
depth = 3.0
entry = "ramp"
[process]
spindle = 9000.0
feed = 10.0
"""
SUFFIXES = {"gcode": "ngc", "grbl": "nc", "rapid": "mod", "pacscript": "pcs", "vplus": "v2"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    shutil.copy(PARTS / "bracket.dxf", tmp_path)
    (tmp_path / "bracket.toml").write_text(JOB)
    return tmp_path


def build(post: str = "gcode", *options: str) -> Path:
    assert main(["build", "bracket.dxf", "--post", post, "-q", *options]) == 0
    return Path(f"bracket.{SUFFIXES[post]}")


#: Arms without a spindle.
NO_SPINDLE = ("--set", "process.spindle=0")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("post", SUFFIXES)
def test_each_post_writes_the_digest_of_its_text(post: str) -> None:
    options = () if post in ("gcode", "grbl") else NO_SPINDLE
    text = build(post, *options).read_text()
    assert read_signature(text) == "as written"
    assert read_signature(text.replace("\n", "\r\n")) == "as written"
    assert read_signature(text.replace("\n", "  \n") + "\n\n") == "as written"
    line = text.splitlines()[-3]
    assert read_signature(text.replace(line, f"{line}1")) == "edited"


def test_a_text_without_a_header_is_unsigned() -> None:
    assert sign("G0 X1\n") == "G0 X1\n"
    assert read_signature("G0 X1\n") == "unsigned"


def edit(program: Path) -> str:
    """The program with another depth, written over it."""
    text = program.read_text()
    edited = text.replace("Z-3", "Z-2")
    assert edited != text
    program.write_text(edited)
    return edited


@pytest.mark.usefixtures("folder")
def test_an_edited_program_is_replaced_with_force_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = build()
    written = program.read_text()
    edited = edit(program)
    assert main(["build", "bracket.dxf", "--post", "gcode"]) == 2
    assert "bracket.ngc: was edited since camgen wrote it; --force" in capsys.readouterr().err
    assert program.read_text() == edited
    build("gcode", "--force")
    assert program.read_text() == written


def test_a_batch_keeps_an_edited_program(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "out"
    command = ["batch", "bracket.dxf", "--post", "gcode", "-o", str(out), "--jobs", "1"]
    assert main(command) == 0
    program = out / "bracket.ngc"
    written, edited = program.read_text(), edit(program)
    assert main(command) == 2
    assert "was edited since camgen wrote it" in capsys.readouterr().out
    assert program.read_text() == edited
    assert main([*command, "--force"]) == 0
    assert program.read_text() == written


@pytest.mark.usefixtures("folder")
def test_a_program_without_a_digest_is_replaced() -> None:
    program = build()
    text = program.read_text()
    digest = text.partition(" - text ")[2][:12]
    program.write_text(text.replace(f" - text {digest}", "").replace("Z-3", "Z-2"))
    build()
    assert program.read_text() == text


@pytest.mark.usefixtures("folder")
def test_verify_states_whether_the_text_was_edited(capsys: pytest.CaptureFixture[str]) -> None:
    program = build()
    assert main(["verify", "bracket.ngc"]) == 0
    out = capsys.readouterr().out
    assert "the text is as camgen wrote it" in out
    assert "equal to what its job and bracket.dxf make" in out
    edit(program)
    assert main(["verify", "bracket.ngc"]) == 4
    printed = capsys.readouterr()
    assert "the text was edited since camgen wrote it" in printed.out
    assert "differs from what its job and bracket.dxf make" in printed.err
    # The text has no fault: a user who meant the edit names the post.
    assert main(["verify", "bracket.ngc", "--post", "gcode"]) == 0
    assert "the text was edited since camgen wrote it" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_a_digest_made_right_again_still_differs_from_the_plan(
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = build()
    digest = program.read_text().partition(" - text ")[2][:12]
    program.write_text(sign(edit(program).replace(f" - text {digest}", "")))
    assert main(["verify", "bracket.ngc"]) == 0
    out = capsys.readouterr().out
    assert "the text is as camgen wrote it" in out
    assert "plan       differs from what its job and bracket.dxf make" in out


@pytest.mark.usefixtures("folder")
def test_a_program_of_another_version_is_not_compared(
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = build()
    program.write_text(program.read_text().replace("camgen 0.1.0", "camgen 0.0.9"))
    assert main(["verify", "bracket.ngc"]) == 0
    assert "camgen 0.0.9 wrote it, this is 0.1.0" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        # The plunge is a third of the feed of 10 mm/s, and the ramps run at it.
        ("F600", "F6000", "is fed 100 mm/s, the job states 20 mm/s at most"),
        ("S9000", "S18000", "turns 2 times faster or slower than the job states, 9000 rpm"),
        ("S9000", "S4500", "turns 2 times faster or slower than the job states, 9000 rpm"),
    ],
)
def test_feeds_and_speeds_of_a_text_are_compared_with_its_job(
    old: str, new: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program = build()
    command = ["verify", "bracket.ngc", "--part", "bracket.dxf", "--post", "gcode"]
    assert main(command) == 0
    assert "the job states" not in capsys.readouterr().out
    text = program.read_text()
    assert old in text
    program.write_text(text.replace(old, new))
    assert main(command) == 0
    assert line in capsys.readouterr().out
