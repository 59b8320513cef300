"""Damaged numbers of a DXF drawing are named with their line and never guessed."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ezdxf.addons.r12writer import r12writer
from ezdxf.document import Drawing

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job, OperationTable
from camgen.model.part import Part
from camgen.read import dxf
from camgen.read.dxf.damage import repair
from camgen.read.files import Files
from tests.read.test_dxf import new, notes, read_bytes, written

SAVE = "open it in the CAD program and save it again as DXF"


def read(text: str, **operation: Any) -> Part:
    job = Job(operation=OperationTable(**operation))
    return dxf.read(Source(Path("test.dxf"), text.encode()), job, Files())


def plate() -> Drawing:
    """A rectangle of 40.5 x 20.25 mm in four lines, and a circle of 7.5 mm."""
    document, space = new()
    corners = [(0.5, 0.0), (41.0, 0.0), (41.0, 20.25), (0.5, 20.25)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        space.add_line(start, end)
    space.add_circle((10.5, 10.5), 3.75)
    return document


def spoil(text: str, entity: str, group: int, value: str) -> tuple[str, int, str]:
    """The text with `value` in a group of its first `entity` in model space.

    Returns the text, the number of the line, and the handle of the entity.
    """
    lines = text.splitlines()
    head = lines.index(entity, lines.index("ENTITIES"))
    line = next(k for k in range(head + 1, len(lines), 2) if lines[k].strip() == str(group)) + 1
    handle = lines[lines.index("  5", head) + 1]
    lines[line] = value
    return "\n".join(lines) + "\n", line + 1, handle


def with_commas(text: str) -> str:
    return re.sub(r"(?m)^(-?\d+)\.(\d+(?:e-?\d+)?)$", r"\1,\2", text)


@pytest.mark.parametrize("kind", ["auto", "trace"])
def test_decimal_commas_in_a_whole_drawing_are_read(kind: Any) -> None:
    text = with_commas(written(plate()))
    assert "40,5" not in text
    assert "3,75" in text
    part = read(text, kind=kind)
    outline, hole = part.contours
    assert np.ptp(outline.points, axis=0).tolist() == [40.5, 20.25]
    assert np.ptp(hole.points[:, 0]) == 7.5
    (note,) = part.notes
    pattern = r"assumed: decimal commas in \d+ numbers \(no number of their section has a point; "
    assert re.fullmatch(pattern + r"line \d+: '.*' is read as .*\)", str(note))
    assert not note.fails_strict


def test_decimal_commas_of_a_section_are_read() -> None:
    """The header has decimal points, as if a program copies it from a template."""
    head, name, rest = written(plate()).partition("ENTITIES")
    part = read(head + name + with_commas(rest))
    assert np.ptp(part.contours[0].points, axis=0).tolist() == [40.5, 20.25]


def test_commas_that_may_separate_thousands_are_not_read() -> None:
    document, space = new()
    space.add_circle((5, 5), 1.234)
    space.add_line((0, 0), (7, 0))
    head, name, rest = written(document).partition("ENTITIES")
    part = read(head + name + with_commas(rest).replace(",0\n", "\n"))
    assert [contour.closed for contour in part.contours] == [False]
    assert any("group 40 is '1,234', which is not a number" in note for note in notes(part))


def test_a_comma_among_points_is_not_read() -> None:
    text, line, handle = spoil(written(plate()), "LINE", 11, "41,0")
    part = read(text)
    cause = f"line {line}: group 11 is '41,0', which is not a number; {SAVE}"
    assert str(part.notes[0]) == f"skipped: LINE #{handle} on layer 0 ({cause})"
    assert [contour.closed for contour in part.contours] == [False, True]


@pytest.mark.parametrize("group", [10, 20, 30, 40])
@pytest.mark.parametrize(
    "value",
    [
        *("-1.#IND", "1.#INF", "nan", "inf", "1e999", "1D+3", "12.5mm", "0x1A", "1_000.5"),
        *("1,234.5", "1 234.5", "1.2.3", "--5", "1e", "", "-", "."),
    ],
)
def test_a_circle_with_a_damaged_number_is_left_out(group: int, value: str) -> None:
    text, line, handle = spoil(written(plate()), "CIRCLE", group, value)
    part = read(text)
    assert [contour.closed for contour in part.contours] == [True]
    cause = f"line {line}: group {group} is '{value}', which is not a number"
    assert notes(part) == [f"skipped: CIRCLE #{handle} on layer 0 ({cause}; {SAVE})"]
    assert part.notes[0].fails_strict


@pytest.mark.parametrize("value", ["+3.75", "375e-2", "  3.75 ", "3.75E0", "03.750"])
def test_unusual_spellings_of_a_number_are_read(value: str) -> None:
    text, _, _ = spoil(written(plate()), "CIRCLE", 40, value)
    part = read(text)
    assert part.notes == ()
    assert np.ptp(part.contours[1].points[:, 0]) == 7.5


@pytest.mark.parametrize("value", ["7.0", "   7", "65535"])
def test_integers_may_be_unsigned_or_written_as_numbers(value: str) -> None:
    lines = written(plate()).splitlines()
    head = lines.index("CIRCLE")
    lines[head + 1 : head + 1] = [" 62", value]
    assert read("\n".join(lines) + "\n").notes == ()


@pytest.mark.parametrize("value", ["7.5", "1x", "99999999999"])
def test_a_damaged_integer_is_named(value: str) -> None:
    lines = written(plate()).splitlines()
    head = lines.index("CIRCLE")
    lines[head + 1 : head + 1] = [" 62", value]
    (note,) = read("\n".join(lines) + "\n").notes
    assert f"line {head + 3}: group 62 is '{value}', which is not a number" in note.why


def test_a_polyline_with_a_damaged_vertex_is_left_out() -> None:
    document, space = new(version="R12")
    space.add_polyline2d([(0, 0), (40, 0), (40, 20)], close=True)
    space.add_circle((10, 10), 2)
    text, line, _ = spoil(written(document), "VERTEX", 10, "abc")
    part = read(text)
    assert [len(contour.points) for contour in part.contours] == [2]
    assert any(f"line {line}: group 10 is 'abc'" in note for note in notes(part))


def test_a_damaged_block_draws_nothing() -> None:
    document, space = new()
    block = document.blocks.new("HOLE", base_point=(1, 2))
    block.add_circle((0, 0), 3)
    space.add_blockref("HOLE", (10, 10))
    space.add_circle((40, 10), 2)
    lines = written(document).splitlines()
    place = lines.index("HOLE", lines.index("BLOCKS"))
    line = lines.index(" 10", place) + 1
    lines[line] = "1,0"
    part = read("\n".join(lines) + "\n")
    assert len(part.contours) == 1
    assert "skipped: BLOCK 'HOLE' #" in str(part.notes[0])
    assert f"line {line + 1}: group 10 is '1,0', which is not a number" in part.notes[0].why


@pytest.mark.parametrize(
    ("entity", "group"), [("LINE", 20), ("LINE", 11), ("CIRCLE", 40), ("CIRCLE", 10), ("ARC", 50)]
)
def test_a_missing_group_is_not_replaced_by_a_default(entity: str, group: int) -> None:
    document = plate()
    document.modelspace().add_arc((60, 0), 5, 10, 100)
    text, line, handle = spoil(written(document), entity, group, "GONE")
    lines = text.splitlines()
    del lines[line - 2 : line]
    part = read("\n".join(lines) + "\n")
    (note,) = (note for note in part.notes if note.kind == "skipped")
    assert note.what == f"{entity} #{handle} on layer 0"
    assert f"group {group} is missing" in note.why


def test_an_entity_with_a_repeated_group_is_left_out() -> None:
    text, line, handle = spoil(written(plate()), "CIRCLE", 40, "3.75")
    lines = text.splitlines()
    lines[line:line] = [" 40", "5.0"]
    part = read("\n".join(lines) + "\n")
    cause = f"line {line + 2}: group 40 is there twice, '3.75' and '5.0'"
    assert notes(part) == [f"skipped: CIRCLE #{handle} on layer 0 ({cause}; {SAVE})"]


@pytest.mark.parametrize("missing", [0, 1])
def test_an_entity_with_a_missing_line_is_left_out(missing: int) -> None:
    """The line of a group code is missing, or the line of its value."""
    text, line, handle = spoil(written(plate()), "CIRCLE", 40, "3.75")
    lines = text.splitlines()
    del lines[line - 2 + missing]
    part = read("\n".join(lines) + "\n")
    assert [contour.closed for contour in part.contours] == [True]
    (note,) = part.notes
    assert note.what == f"CIRCLE #{handle} on layer 0"
    assert re.match(r"line \d+: '.*' is out of step, a line before it is lost", note.why)


def test_a_header_with_a_missing_line_is_refused() -> None:
    lines = written(plate()).splitlines()
    del lines[lines.index("$INSUNITS") + 1]
    with pytest.raises(InputError, match=r"damaged beyond repair: line .* is out of step"):
        read("\n".join(lines) + "\n")


def test_a_damaged_number_of_a_table_is_replaced_with_a_note() -> None:
    lines = written(plate()).splitlines()
    line = lines.index("$LTSCALE") + 2
    lines[line] = "1.#QNAN"
    part = read("\n".join(lines) + "\n")
    what = f"line {line + 1}: group 40 of $LTSCALE was '1._QNAN', read as 0"
    assert [(note.kind, note.what, note.fails_strict) for note in part.notes] == [
        ("repaired", what.replace("_", "#"), True)
    ]
    assert len(part.contours) == 2


def test_the_state_of_a_layer_is_not_guessed() -> None:
    lines = written(plate()).splitlines()
    place = lines.index("AcDbLayerTableRecord")
    line = lines.index(" 62", place) + 1
    lines[line] = "x7"
    with pytest.raises(InputError, match=f"'x7' is not a number .*line {line + 1}, layer 0"):
        read("\n".join(lines) + "\n")


def test_a_reference_without_its_block_is_named_after_a_repair() -> None:
    document = plate()
    document.modelspace().add_blockref("GONE", (0, 0))
    text, _, handle = spoil(written(document), "CIRCLE", 40, "1.#INF")
    insert = text.splitlines()[text.splitlines().index("INSERT") + 2]
    part = read(text)
    assert [note.what for note in part.notes] == [
        f"CIRCLE #{handle} on layer 0",
        f"1 INSERT on layer 0: #{insert}",
    ]
    assert part.notes[1].why == "its block 'GONE' is missing"


def test_entities_that_the_tolerant_reader_removes_are_named() -> None:
    """If a handle is not hexadecimal, ezdxf reads tolerantly and removes the reference."""
    document = plate()
    document.modelspace().add_blockref("GONE", (0, 0))
    lines = written(document).splitlines()
    lines[lines.index("  5", lines.index("CIRCLE")) + 1] = "XYZ"
    insert = lines[lines.index("INSERT") + 2]
    listed = notes(read("\n".join(lines) + "\n"))
    assert any(note.startswith(f"skipped: INSERT #{insert} (Deleted entity") for note in listed)


def test_a_polyline_that_is_cut_off_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "cut.dxf"
    with r12writer(file) as writer:
        writer.add_circle((5, 5), 2)
        writer.add_polyline_2d([(0, 0), (40, 0), (40, 20), (0, 20)], closed=True)
    text = file.read_text()
    last = text.rindex("VERTEX")
    part = read(text[: last + 20])
    assert [len(contour.points) for contour in part.contours] == [2]
    assert "skipped: the file ends before its end mark (what would follow is lost)" in notes(part)


def test_a_sound_text_is_not_repaired() -> None:
    text = written(plate()).encode()
    assert repair("test.dxf", text) is None
    assert repair("test.dxf", text.replace(b"\n", b"\r\n")) is None
    assert repair("test.dxf", b"999\n1,5 or nan\n" + text) is None


def test_many_damaged_entities_are_counted() -> None:
    document, space = new()
    for k in range(30):
        space.add_circle((10 * k, 0.5), 3.5)
    space.add_circle((400, 0), 3)
    text = written(document).replace("\n3.5\n", "\n3.5x\n")
    part = read_bytes("test.dxf", text.encode(), Job().input, 0.01)
    assert len(part.contours) == 1
    assert len(part.notes) == 21
    assert part.notes[-1].what == "10 more damaged entities"
