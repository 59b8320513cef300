"""What the page is told of the notes and of the program's text: where each note belongs, the line of each motion."""

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
from tests.preview.test_page import PARTS, changing, data
from tests.preview.test_stock import SEVERAL


def test_notes_keep_their_order_and_know_the_lines_and_paths_they_are_about() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})
    own = (
        Note("assumed", "first"),
        *result.notes,
        Note("warning", "last", "why", ("c1",), ((3.0, 4.0),), strict=True),
    )
    found = make_view(replace(result, notes=own))
    assert [(n.kind, n.what, n.why) for n in found.notes] == [(n.kind, n.what, n.why) for n in own]
    assert [n.strict for n in found.notes] == [n.fails_strict for n in own]
    (left,) = [n for n in found.notes if n.kind == "skipped" and n.lines]
    assert {found.lines[k].id for k in left.lines} == {
        line.id for line in found.lines if line.state == "skipped"
    }
    last = found.notes[-1]
    # Its contour, and the ring around its place; c1 has a path.
    assert [found.lines[k].id for k in last.lines] == ["c1", "3.00, 4.00 mm"]
    assert [found.rows[k].id for k in last.paths] == ["c1"]
    assert last.places == ((3.0, 4.0, 0.0),)
    plain = data(format_page(found))
    assert plain["notes"][-1][6][0] == pytest.approx(np.array((3.0, 4.0, 0.0)) - plain["origin"])  # type: ignore[index]


def test_of_an_edge_that_is_run_in_part_the_note_is_about_the_ends_that_are_not(
    solid: Result,
) -> None:
    found = make_view(solid)
    for note in found.notes:
        if note.kind == "skipped":
            assert note.lines
            assert {found.lines[k].state for k in note.lines} == {"skipped"}


TARGET = re.compile(r"^G1 .*?X(-?[\d.]+)")


@pytest.mark.parametrize("job", [None, SEVERAL], ids=["one tool", "two tools"])
def test_every_motion_stands_in_the_line_that_says_it(job: dict[str, object] | None) -> None:
    found = make_view(camgen.build(PARTS / "bracket.dxf", post="gcode", job=job))
    events, rows = found.track.events, found.listing.files[0][1].split("\n")
    seen = 0
    for e, line in enumerate(found.listing.lines.tolist()):
        said = TARGET.match(rows[line - 1])
        if events.kind[e] == 1 and said:
            assert float(said[1]) == pytest.approx(events.end[e, 0], abs=1e-3)
            seen += 1
    assert seen > 3


def test_lines_are_counted_through_the_programs_of_several_tools() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="rapid", job=changing())
    found = make_view(result)
    assert len(found.listing.files) > 1
    rows = [line for _, text in found.listing.files for line in text.removesuffix("\n").split("\n")]
    kinds = found.track.events.kind
    words = {0: "Move", 1: "MoveL", 2: "MoveC", 3: "WaitTime"}
    for e, line in enumerate(found.listing.lines.tolist()):
        assert words[int(kinds[e])] in rows[line - 1], (e, line)


def test_a_program_that_is_too_long_is_left_out_and_said_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result: Result = camgen.build(PARTS / "bracket.dxf", post="gcode")
    monkeypatch.setattr(listing, "MOST_LINES", 20)
    told = data(format_page(make_view(result)))["listing"]
    assert told["files"] == []  # type: ignore[index]
    assert "bracket.ngc: too long for this page" in told["why"]  # type: ignore[index]
