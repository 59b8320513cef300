"""The notes of a build name its assumptions about the set-up."""

from __future__ import annotations

from pathlib import Path

import pytest

import camgen
from camgen.model.errors import NoSafeProgram

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
LOAD = "tool mass 0.001 kg is a placeholder"


def list_notes(result: camgen.Result, kind: str) -> list[str]:
    return [f"{note.what}; {note.why}" for note in result.notes if note.kind == kind]


def test_the_arm_of_a_part_in_space_is_assumed_without_a_robot() -> None:
    notes = list_notes(camgen.build(PARTS / "rfa1.stl", post="rapid"), "assumed")
    assert any("the arm is the IRB 120 of the built-in cell; set cell.robot" in n for n in notes)


def test_no_arm_is_assumed_where_the_job_names_it_or_none_is_used() -> None:
    named = camgen.build(PARTS / "bracket.dxf", post="rapid", job={"cell": {"robot": "IRB 1200"}})
    flat = camgen.build(PARTS / "bracket.dxf", post="rapid")
    for result in (named, flat):
        assert not any("the arm is" in note for note in list_notes(result, "assumed"))


def test_a_placeholder_load_is_assumed_and_refused_by_strict() -> None:
    notes = list_notes(camgen.build(PARTS / "bracket.dxf", post="rapid"), "assumed")
    assert any(LOAD in note and "set post.mass and post.cog" in note for note in notes)
    for post in ({"mass": 1.8, "cog": [0, 0, 55]}, {"declare": False}):
        result = camgen.build(PARTS / "bracket.dxf", post="rapid", job={"post": post}, strict=True)
        assert not any(LOAD in note for note in list_notes(result, "assumed"))
    with pytest.raises(NoSafeProgram, match=f"--strict and {LOAD}"):
        camgen.build(PARTS / "bracket.dxf", post="rapid", strict=True)
