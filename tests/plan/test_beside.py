"""Offset curves of a drawing: contours far from all others are computed alone, with one result."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camgen.geometry import intersect, offset, stitch, uncross
from camgen.geometry.segments import Segments, find_following, make_contour_segments
from camgen.model.part import Contour
from camgen.plan import beside as beside_module
from camgen.plan.beside import OffsetCurve, make_offset_curve, select_segments
from tests.support.drawn import circle, clockwise, contour, rectangle
from tests.support.examples import fewer


@st.composite
def draw_loops(draw: st.DrawFn) -> list[Contour]:
    """Circles, rectangles and stars with arcs, in both directions.

    The field is so large that some of them are far from all others.
    """
    drawn = []
    for _ in range(draw(st.integers(1, 8))):
        x, y, size = draw(st.integers(0, 90)), draw(st.integers(0, 90)), draw(st.floats(0.5, 15))
        kind = draw(st.sampled_from(["circle", "rectangle", "star"]))
        if kind == "star":
            count = draw(st.integers(3, 7))
            angle = 2 * math.pi * np.arange(count) / count
            radius = size * np.array(
                draw(st.lists(st.floats(0.3, 1), min_size=count, max_size=count))
            )
            bulges = draw(
                st.lists(st.sampled_from([0.0, 0.0, 0.3, -0.3]), min_size=count, max_size=count)
            )
            points = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
            shape = contour(points.tolist(), bulges)
        else:
            shape = circle(x, y, size) if kind == "circle" else rectangle(x, y, size, 1.5 * size)
        drawn.append(clockwise(shape) if draw(st.booleans()) else shape)
    return drawn


def mark_none(_: object, rows: np.ndarray, __: object) -> np.ndarray:
    """Replaces `only_at_ends`: no pair of segments meets at its ends only."""
    return np.zeros(len(rows), dtype=np.bool_)


def make_curve(drawn: list[Contour], distance: float, corner: float) -> OffsetCurve:
    source, closed = make_contour_segments(drawn), np.ones(len(drawn), dtype=np.bool_)
    label = np.zeros(len(source), dtype=np.int64)
    return make_offset_curve(
        source, find_following(source, closed), closed, label, distance, corner
    )


@fewer(10)
@given(draw_loops(), st.floats(0.3, 6), st.sampled_from([0.0, 0.5]))
def test_contours_far_from_all_others_have_the_same_offset_curves_alone(
    drawn: list[Contour], distance: float, corner: float
) -> None:
    alone = make_curve(drawn, distance, corner)
    with pytest.MonkeyPatch.context() as patch:
        # All contours are in one group, with one search tree, and all cuts are made.
        for module in (offset, beside_module):
            patch.setattr(module, "set_apart", lambda _, group, *__: group)
        patch.setattr(intersect, "FEW", 0)
        patch.setattr(stitch, "FEW", 0)
        patch.setattr(offset, "only_at_ends", mark_none)
        together = make_curve(drawn, distance, corner)
    for name in Segments.__struct_fields__:
        assert np.array_equal(getattr(alone.segments, name), getattr(together.segments, name))
    for name in ("closed", "source", "turn", "lost", "sound"):
        assert np.array_equal(getattr(alone, name), getattr(together, name))


@settings(deadline=None)
@given(draw_loops())
def test_slips_are_the_same_if_every_corner_is_tested(drawn: list[Contour]) -> None:
    source, count = make_contour_segments(drawn), len(drawn)
    following = find_following(source, np.ones(count, dtype=np.bool_))
    slips = uncross.find_slips(source, following, count)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(uncross, "only_at_ends", mark_none)
        assert np.array_equal(slips, uncross.find_slips(source, following, count))


def test_a_stretch_of_a_closed_chain_continues_over_the_end_of_the_chain() -> None:
    triangle = contour([(0, 0), (9, 0), (0, 9)])
    segments = make_contour_segments([triangle, rectangle(20, 0, 10, 10)])
    plain = np.zeros(7, np.bool_)
    closed = np.ones(2, np.bool_)
    none, shared = np.full(7, -1), np.zeros(0, np.int64)
    both = OffsetCurve(segments, closed, np.arange(7), np.zeros(7), plain, closed, none, shared)
    chosen = np.ones(7, np.bool_)
    chosen[4] = False  # the right side of the rectangle
    kept = select_segments(both, chosen[both.source])
    assert kept.closed.tolist() == [True, False]
    assert kept.segments.owner.tolist() == [0, 0, 0, 1, 1, 1]
    stretch = kept.segments.take(kept.segments.owner == 1)
    assert stretch.start.tolist() == [[30, 10], [20, 10], [20, 0]]
    assert stretch.end.tolist() == [[20, 10], [20, 0], [30, 0]]
