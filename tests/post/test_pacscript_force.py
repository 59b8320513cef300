"""PacScript: force control by lines of a template."""

import math

import pytest
from camgen_posts.pacscript import PacScript
from msgspec.structs import replace

from camgen.lang.pacscript.strict import read
from camgen.model.program import Force, MoveL
from camgen.post.plugins import make_post
from tests.support.pacscript_programs import (
    OWN_TEMPLATE,
    assert_same,
    force_program,
    line_and_arc,
    print_body,
    print_text,
    program,
)


def test_a_force_line_is_printed_at_each_change_of_the_force() -> None:
    lines = [
        line
        for line in print_body(force_program(), force="template")
        if not line.startswith("Move")
    ]
    assert lines == [
        "ForceParam 1, 2, P(0.000, 10.000, 0.000, 0, 0, 0) ' verify",
        "ForceCtrl True, 1 ' verify",
        "ForceParam 1, 2, P(-4.000, 6.928, 0.000, 0, 0, 0) ' verify",  # 8 N x (-1/2, sqrt(3)/2)
        "ForceParam 1, 2, P(0.000, 0.000, 0.000, 0, 0, 0) ' verify",
        "ForceCtrl False ' verify",
    ]
    moves = print_body(force_program(), force="template")
    assert moves[2].startswith("Move L, @P P(10.000,")
    assert moves[4].startswith("ForceParam")
    assert moves[5].startswith("Move L, @P P(30.000,")


def test_the_force_lines_of_the_default_template_are_read_back() -> None:
    text = print_text(force_program(), force="template")
    reading = read({"a": text}, {})
    assert_same(force_program(), reading, PacScript(force="template"))
    assert reading.body[0] == Force(0.0)
    assert reading.body[3] == Force(10.0, (0.0, 1.0, 0.0))
    last = reading.body[6]
    assert isinstance(last, MoveL)
    assert last.force == pytest.approx(8.0, abs=1e-3)
    assert last.force_direction == pytest.approx((-0.5, math.sqrt(3) / 2, 0.0), abs=1e-4)


def test_a_template_of_the_user_is_printed_and_read() -> None:
    text = print_text(force_program(), **OWN_TEMPLATE)
    assert "    Call PressOn(4, -(0.000), -(10.000), -(0.000))\n    Delay 200\n" in text
    assert "    Call PressTo(8.000, -4.000, 6.928, 0.000)\n" in text
    assert_same(
        force_program(), read({"a": text}, OWN_TEMPLATE), make_post(PacScript, OWN_TEMPLATE)
    )
    # Without the template these are calls of procedures that are not in the text.
    assert read({"a": text}, {}).findings


def test_wrong_newtons_in_a_template_of_the_user_are_a_fault() -> None:
    text = print_text(force_program(), **OWN_TEMPLATE).replace("PressTo(8.000", "PressTo(9.000")
    (fault,) = read({"a": text}, OWN_TEMPLATE).findings
    assert fault.what == "the newtons of a force line are not those of its vector"
    assert "PressTo(9" in text.splitlines()[fault.line - 1]


def test_the_option_ignore_leaves_the_force_out() -> None:
    post = PacScript(force="ignore")
    prepared = post.prepare(force_program(), 0.01)
    assert not any(isinstance(item, Force) for item in prepared.body)
    assert not any(
        isinstance(item, MoveL) and (item.force or any(item.force_direction))
        for item in prepared.body
    )
    text = print_text(force_program(), force="ignore")
    assert "Force" not in text
    assert_same(prepared, read({"a": text}, {}), post)


def test_an_arc_under_force_becomes_lines_with_turning_forces() -> None:
    line, bend = line_and_arc(10.0, math.radians(90.0), 10.0)
    plan = program(
        Force(10.0, (1.0, 0.0, 0.0)),
        line,
        replace(bend, force_direction=(0.0, 1.0, 0.0)),
        Force(0.0),
    )
    post = PacScript(force="template")
    prepared = post.prepare(plan, 0.01)
    lines = [item for item in prepared.body if isinstance(item, MoveL)][1:]
    assert len(lines) > 5
    for item in lines:
        x, y = item.target.origin[0] + 10, item.target.origin[1]
        # The force is away from the centre (-10, 0).
        assert item.force_direction == pytest.approx((x / 10, y / 10, 0.0), abs=1e-9)
    (file,) = post.render(prepared)
    assert_same(prepared, read({"a": file.text}, {}), post)
