"""Harmful motions of an old program are warnings of the build that writes it again."""

from pathlib import Path

import camgen

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
JOB = {"post": {"signals": {"doProcess": "doProcess"}}}


def write_old_program(folder: Path, left_out: int) -> Path:
    """Writes a RAPID program of the bracket without one of its lines that switch the process off.

    left_out: index of this line among the lines that switch off, -1 for none.
    """
    (file,) = camgen.build(BRACKET, post="rapid").files
    lines = file.text.splitlines(keepends=True)
    switch_offs = [
        number for number, line in enumerate(lines) if line.strip() == "SetDO doProcess,0;"
    ]
    if left_out >= 0:
        del lines[switch_offs[left_out]]
    old = folder / "old.mod"
    old.write_text("".join(lines), encoding="utf-8")
    return old


def list_warnings(path: Path) -> list[str]:
    notes = camgen.build(path, post="rapid", job=JOB).notes
    return [note.what for note in notes if note.kind == "warning"]


def test_a_planned_program_has_no_warning_of_harm() -> None:
    notes = camgen.build(BRACKET, post="rapid").notes
    assert [note.what for note in notes if note.kind == "warning"] == []


def test_a_sound_old_program_has_no_warning_of_harm(tmp_path: Path) -> None:
    assert list_warnings(write_old_program(tmp_path, -1)) == []


def test_an_output_that_an_old_program_leaves_on_is_named_with_its_line(tmp_path: Path) -> None:
    # The first two lines that switch off are before the first path. The third one ends it.
    old = write_old_program(tmp_path, 2)
    result = camgen.build(old, post="rapid", job=JOB)
    lines = result.files[0].text.splitlines()
    warnings = [note.what for note in result.notes if note.kind == "warning"]
    assert warnings
    for warning in warnings:
        name, _, rest = warning.partition(" line ")
        number, _, text_of_finding = rest.partition(": ")
        assert name == result.files[0].name
        assert "while doProcess is on" in text_of_finding or "on already" in text_of_finding
        before = lines[: int(number)]
        switched = [line.strip() for line in before if "SetDO doProcess" in line]
        assert "SetDO doProcess,1;" in switched[-2:]
