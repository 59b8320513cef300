"""Bad inputs. A file in fixtures/refused has a .txt file, whose first line is the exact error."""

from pathlib import Path

import pytest

from camgen.cli import main

FOLDER = Path(__file__).parents[1] / "fixtures" / "refused"
INPUTS = sorted(
    p for p in FOLDER.iterdir() if p.suffix not in (".txt", ".py") and not p.name.startswith(".")
)


def test_there_are_bad_inputs() -> None:
    assert INPUTS


@pytest.mark.parametrize("file", INPUTS, ids=lambda p: p.name)
def test_a_bad_input_is_refused_with_its_line(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    expected = file.with_suffix(".txt").read_text(encoding="utf-8").splitlines()[0]
    monkeypatch.chdir(file.parent)
    before = sorted(file.parent.iterdir())
    code = main(["build", file.name, "--post", "gcode", "-o", str(tmp_path)])
    printed = capsys.readouterr()
    assert printed.err == f"camgen: error: {expected}\n"
    assert printed.out == ""
    assert code in (2, 3)
    assert not list(tmp_path.iterdir())
    assert sorted(file.parent.iterdir()) == before
