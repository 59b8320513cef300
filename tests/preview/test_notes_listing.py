"""Notes and program text in the page: the place of each note, and the line of each motion."""

import re

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.model.part import Note
from camgen.pipeline import Result
from camgen.preview import listing
from camgen.preview.page import format_page
from camgen.preview.view import make_view
from tests.preview.test_page import PARTS, make_job_of_two_tools, read_data
from tests.preview.test_stock import SEVERAL


def test_notes_keep_their_order_and_have_their_lines_paths_and_places() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})
    notes = (
        Note("assumed", "first"),
        *result.notes,
        Note("warning", "last", "why", ("c1",), ((3.0, 4.0),), strict=True),
    )
    view = make_view(replace(result, notes=notes))
    assert [(n.kind, n.what, n.why) for n in view.notes] == [(n.kind, n.what, n.why) for n in notes]
    assert [n.strict for n in view.notes] == [n.fails_strict for n in notes]
    (skipped_note,) = [n for n in view.notes if n.kind == "skipped" and n.lines]
    assert {view.lines[k].id for k in skipped_note.lines} == {
        line.id for line in view.lines if line.state == "skipped"
    }
    last_note = view.notes[-1]
    # The note marks its contour c1, which has a path, and a ring around its place.
    assert [view.lines[k].id for k in last_note.lines] == ["c1", "3.00, 4.00 mm"]
    assert [view.rows[k].id for k in last_note.paths] == ["c1"]
    assert last_note.places == ((3.0, 4.0, 0.0),)
    page_data = read_data(format_page(view))
    assert page_data["notes"][-1][6][0] == pytest.approx(
        np.array((3.0, 4.0, 0.0)) - page_data["origin"]
    )


def test_the_note_of_an_edge_run_in_part_marks_the_ends_that_are_left_out(
    solid: Result,
) -> None:
    view = make_view(solid)
    for note in view.notes:
        if note.kind == "skipped":
            assert note.lines
            assert {view.lines[k].state for k in note.lines} == {"skipped"}


TARGET = re.compile(r"^G1 .*?X(-?[\d.]+)")


@pytest.mark.parametrize("job", [None, SEVERAL], ids=["one tool", "two tools"])
def test_each_motion_has_the_line_of_the_program_that_moves_to_its_end(
    job: dict[str, object] | None,
) -> None:
    view = make_view(camgen.build(PARTS / "bracket.dxf", post="gcode", job=job))
    events, program_lines = view.track.events, view.listing.files[0][1].split("\n")
    compared = 0
    for e, line in enumerate(view.listing.lines.tolist()):
        match = TARGET.match(program_lines[line - 1])
        if events.kind[e] == 1 and match:
            assert float(match[1]) == pytest.approx(events.end[e, 0], abs=1e-3)
            compared += 1
    assert compared > 3


def test_lines_are_counted_over_all_programs_of_several_tools() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="rapid", job=make_job_of_two_tools())
    view = make_view(result)
    assert len(view.listing.files) > 1
    program_lines: list[str] = []
    for _, text in view.listing.files:
        program_lines += text.removesuffix("\n").split("\n")
    kinds = view.track.events.kind
    words = {0: "Move", 1: "MoveL", 2: "MoveC", 3: "WaitTime"}
    for e, line in enumerate(view.listing.lines.tolist()):
        assert words[int(kinds[e])] in program_lines[line - 1], (e, line)


def test_a_program_that_is_too_long_is_replaced_by_a_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result: Result = camgen.build(PARTS / "bracket.dxf", post="gcode")
    monkeypatch.setattr(listing, "MOST_LINES", 20)
    listed = read_data(format_page(make_view(result)))["listing"]
    assert listed["files"] == []
    assert "bracket.ngc: too long for this page" in listed["why"]
