"""A build enters each arrow of the walk once, in order (docs/architecture.md)."""

import pytest

from docs.make.walk import ARROWS, PARTS, walk_of


@pytest.mark.parametrize(
    ("source", "post"), [("bracket.dxf", "rapid"), ("rfa1.stl", "rapid"), ("gear.png", "gcode")]
)
def test_each_arrow_is_entered_once_in_order(source: str, post: str) -> None:
    job = {"page": {"size": "A4"}} if source.endswith(".png") else {}
    arrows = walk_of(PARTS / source, post, job)
    assert [arrow for arrow, _ in arrows] == list(ARROWS.values())
