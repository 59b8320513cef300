"""Bad inputs: the first line of the twin .txt of a file in fixtures/refused is the exact error that it raises."""

from pathlib import Path

import pytest

from camgen.cli import main

FOLDER = Path(__file__).parents[1] / "fixtures" / "refused"
INPUTS = sorted(
    p for p in FOLDER.iterdir() if p.suffix not in (".txt", ".py") and not p.name.startswith(".")
)


def test_there_are_bad_inputs() -> None:
    assert INPUTS


@pytest.mark.parametrize("bad", INPUTS, ids=lambda p: p.name)
def test_a_bad_input_is_refused_with_its_line(
    bad: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    expected = bad.with_suffix(".txt").read_text(encoding="utf-8").splitlines()[0]
    monkeypatch.chdir(bad.parent)
    before = sorted(bad.parent.iterdir())
    code = main(["build", bad.name, "--post", "gcode", "-o", str(tmp_path)])
    said = capsys.readouterr()
    assert said.err == f"camgen: error: {expected}\n"
    assert said.out == ""
    assert code in (2, 3)
    assert not list(tmp_path.iterdir())
    assert sorted(bad.parent.iterdir()) == before
