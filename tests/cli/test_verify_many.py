"""``camgen verify --summary``: a row for each program, and the worst exit code."""

import json
from pathlib import Path

import pytest

from camgen.cli import main

SOUND = "G21 G90\nG0 X0 Y0 Z5\nM3 S1000\nG1 Z-1 F100\nX10\nG0 Z5\nM5\nM2\n"
#: The spindle is on at the end, and the file has no end.
DANGEROUS = SOUND.replace("M5\nM2\n", "")
#: LinuxCNC has no G123.
REFUSED = SOUND.replace("X10", "G123 X10")
POINT = "[[600,0,400],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MAIN = "MODULE a\n  PROC main()\n    part;\n  ENDPROC\nENDMODULE\n"
PART = f"MODULE b\n  PROC part()\n    MoveJ {POINT},v500,fine,tool0;\n  ENDPROC\nENDMODULE\n"


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shop").mkdir()


def write(name: str, text: str) -> None:
    Path(name).parent.mkdir(exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")


def verify(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, list[list[str]], str]:
    """Exit code, the cells of the table, and the last line."""
    code = main(["verify", *words, "--summary"])
    *rows, last = capsys.readouterr().out.splitlines()
    return code, [row.split() for row in rows[1:]], last


def test_each_file_of_a_folder_has_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    write("shop/sound.ngc", SOUND)
    write("shop/deep/dangerous.ngc", DANGEROUS)
    write("shop/refused.ngc", REFUSED)
    write("shop/notes.md", "no program")
    code, rows, last = verify(capsys, "shop")
    assert code == 2
    assert [(row[0], row[1], row[-1]) for row in rows] == [
        ("shop/deep/dangerous.ngc", "gcode", "3"),
        ("shop/refused.ngc", "gcode", "2"),
        ("shop/sound.ngc", "gcode", "0"),
    ]
    assert rows[1][2:5] == ["1", "0", "0"]
    assert last == "3 programs: 1 without refusal or danger; 1 other file in the folders"


@pytest.mark.parametrize(
    ("texts", "code"), [([SOUND], 0), ([SOUND, DANGEROUS], 3), ([DANGEROUS, REFUSED], 2)]
)
def test_the_worst_exit_code_counts(
    texts: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, text in enumerate(texts):
        write(f"shop/{number}.ngc", text)
    assert verify(capsys, "shop/*.ngc")[0] == code


def test_files_that_call_each_other_are_one_program(capsys: pytest.CaptureFixture[str]) -> None:
    write("shop/b.mod", PART)
    write("shop/a.mod", MAIN)
    write("other/a.mod", MAIN)
    code, rows, _ = verify(capsys, "shop", "other")
    assert [row[0] for row in rows] == ["shop/a.mod", "other/a.mod"]
    assert "and 1 more file" in " ".join(rows[0])
    assert rows[0][-1] == "0"
    # The other program lacks the routine of the first one.
    assert code == int(rows[1][-1]) == main(["verify", "other/a.mod", "-q"])


def test_a_file_that_is_not_a_program_does_not_stop_the_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    write("shop/sound.ngc", SOUND)
    write("shop/empty.ngc", "")
    code, rows, last = verify(capsys, "shop/empty.ngc", "shop/sound.ngc", "shop/none.ngc")
    assert code == 2
    assert [row[-1] for row in rows] == ["2", "0", "2"]
    assert "is empty" in " ".join(rows[0])
    assert last == "3 programs: 1 without refusal or danger"


def test_the_rows_as_data(capsys: pytest.CaptureFixture[str]) -> None:
    write("shop/a.mod", MAIN)
    write("shop/b.mod", PART.replace("v500", "v500,"))
    code = main(["verify", "shop", "--summary", "--json"])
    (program,) = json.loads(capsys.readouterr().out)
    assert code == program["exit_code"] == 2
    assert program["files"] == ["shop/a.mod", "shop/b.mod"]
    assert {item["level"] for item in program["findings"]} == {"refused"}
    assert program["findings"][0]["place"].startswith("b.mod line 3")


def test_the_rows_as_sarif(capsys: pytest.CaptureFixture[str]) -> None:
    """The members that SARIF 2.1.0 asks for, and a line beyond the thousandth."""
    write("shop/refused.ngc", "(x)\n" * 1200 + REFUSED)
    write("shop/empty.ngc", "")
    assert main(["verify", "shop", "--summary", "--sarif"]) == 2
    log = json.loads(capsys.readouterr().out)
    assert log["version"] == "2.1.0"
    (sarif,) = log["runs"]
    assert sarif["tool"]["driver"]["name"] == "camgen verify"
    empty, refused = sarif["results"][:2]
    assert "is empty" in empty["message"]["text"]
    place = refused["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "shop/refused.ngc"
    assert place["region"]["startLine"] == 1200 + REFUSED.split("\n").index("G123 X10") + 1
    assert refused["level"] == "error"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["shop", "--summary"], "has no file that ends as a program does"),
        (["shop/*.ngc", "--summary"], "fits no file"),
        (["shop", "--summary", "--plan", "x.json"], "--plan: is for a single program"),
        (["shop", "--summary", "--json", "--sarif"], "--sarif: and --json are both given"),
        (["shop", "--sarif"], "--sarif: is for --summary"),
        (["shop"], "add --summary"),
    ],
)
def test_wrong_words_are_refused_in_one_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
