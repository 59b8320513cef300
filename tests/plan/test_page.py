"""[page]: the algorithms of continuous-path.md, section 3.2, compared with their formulas."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.segments import compute_bounds, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.job import PageTable
from camgen.model.page import compute_page_size
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.model.text import short
from camgen.plan import plan
from camgen.plan.page import place_on_page
from camgen.read import read
from camgen.read.job_file import from_mapping

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


def part_of(
    points: list[list[float]],
    bulges: list[float] | None = None,
    closed: bool = False,
    units: str = "mm",
) -> Part:
    bulge = frozen(bulges if bulges is not None else np.zeros(len(points)))
    return Part("part", "part.dxf", units, (Contour(frozen(points), bulge, closed, "0", "c1"),), ())


def place(part: Part, **page: object) -> Part:
    return place_on_page(part, from_mapping({"page": page}))


def find_bounds(part: Part) -> list[float]:
    boxes = compute_bounds(make_contour_segments(part.contours))
    return [*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist()]


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ("A4", (210, 297)),
        ("a4 landscape", (297, 210)),
        ("A3 portrait", (297, 420)),
        ("letter", (215.9, 279.4)),
        ([80, 60], (80, 60)),
    ],
)
def test_a_page_has_its_named_or_given_size(
    size: str | list[float], expected: tuple[float, float]
) -> None:
    assert compute_page_size(PageTable(size=size)) == expected


@given(
    st.lists(st.tuples(st.floats(-500, 500), st.floats(-500, 500)), min_size=2, max_size=9),
    st.floats(30, 400),
    st.floats(30, 400),
    st.floats(0, 14),
)
def test_a_drawing_is_scaled_by_the_smaller_ratio_and_centred(
    points: list[tuple[float, float]], width: float, height: float, margin: float
) -> None:
    p = np.array(points)
    low, high = p.min(axis=0), p.max(axis=0)
    if (high - low).min() < 1e-3:
        return
    part = place(part_of(p.tolist()), size=[width, height], margin=margin)
    r = min((width - 2 * margin) / (high - low)[0], (height - 2 * margin) / (high - low)[1])
    expected = (p - (low + high) / 2) * r + [width / 2, height / 2]
    assert np.allclose(part.contours[0].points, expected, atol=1e-9)


def test_arcs_are_fitted_with_their_bulges_and_stay_arcs() -> None:
    # A circle, given by two points on its horizontal diameter.
    part = place(part_of([[0, 0], [10, 0]], [1.0, 1.0], True), size=[100, 60], margin=5)
    assert find_bounds(part) == pytest.approx([25, 5, 75, 55])
    assert part.contours[0].bulges.tolist() == [1.0, 1.0]


def test_a_single_line_fits_by_its_length() -> None:
    assert find_bounds(
        place(part_of([[3, 4], [13, 4]]), size=[100, 60], margin=10)
    ) == pytest.approx([10, 30, 90, 30])


def test_a_given_scale_is_mm_per_unit_of_the_file() -> None:
    for units, mm in [("mm", 1.0), ("inch", 25.4), ("0.5 mm/unit", 0.5)]:
        part = place(part_of([[0, 0], [10 * mm, 20 * mm]], units=units), size="A4", scale=2)
        assert find_bounds(part) == pytest.approx([95, 128.5, 115, 168.5]), units


def test_the_scale_true_keeps_the_size() -> None:
    assert find_bounds(
        place(part_of([[5, 5], [15, 25]]), size="A4", scale="true")
    ) == pytest.approx([100, 138.5, 110, 158.5])


def test_a_drawing_that_leaves_the_page_is_refused_with_the_numbers() -> None:
    with pytest.raises(InputError) as error:
        place(part_of([[0, 0], [195, 10]]), size="A4", scale="true")
    text = (
        "leaves the page: the drawing is 195 x 10 mm, the page 210 x 297 mm with a margin of 10 mm"
    )
    assert text in str(error.value)
    place(part_of([[0, 0], [190, 10]]), size="A4", scale="true")


@pytest.mark.parametrize(
    ("page", "what"),
    [
        ({"size": "A9"}, 'unknown page "A9"'),
        ({"size": [100]}, "is not a width and a height"),
        ({"size": [100, -1]}, "is not a width and a height"),
        ({"size": "A6", "margin": 60}, "leaves nothing of 105 x 148 mm"),
        ({"margin": 5}, "has no effect without a size"),
        ({"size": "A4", "scale": "huge"}, "scale must be one of"),
    ],
)
def test_an_invalid_page_is_refused(page: dict[str, object], what: str) -> None:
    with pytest.raises(JobError, match=what):
        place(part_of([[0, 0], [1, 1]]), **page)


def test_a_scale_per_unit_of_two_units_is_refused() -> None:
    with pytest.raises(JobError, match="does not go with units"):
        place(part_of([[0, 0], [1, 1]], units="inch + mm"), size="A4", scale=2)


def test_without_a_page_nothing_changes() -> None:
    part = part_of([[0, 0], [1, 1]])
    assert place_on_page(part, from_mapping({})) is part


@pytest.mark.parametrize("size", ["A5", [120, 100], "A4 landscape"])
@pytest.mark.parametrize("tolerance", [{}, {"simplify": 0.8}])
def test_the_lines_of_a_picture_keep_the_margin(size: object, tolerance: dict[str, float]) -> None:
    """The lines and arcs keep it, not the pixels, which are up to a pixel from them."""
    job = from_mapping({"page": {"size": size, "margin": 10}, "tolerance": tolerance})
    drawing = plan(read(PARTS / "gear.png", job), job)
    low_x, low_y, high_x, high_y = find_bounds(drawing.part)
    width, height = compute_page_size(job.page)
    least = min(low_x, low_y, width - high_x, height - high_y)
    assert least == pytest.approx(10, abs=1e-6)
    assert (low_x + high_x, low_y + high_y) == pytest.approx((width, height))
    notes = [note.what for note in drawing.notes if note.what.startswith("centred on a page")]
    assert len(notes) == 1
    assert f"drawing {short(high_x - low_x, 2)} x {short(high_y - low_y, 2)} mm" in notes[0]
    scale = notes[0].replace(" = ", "=").replace("1 px=", "").replace(" mm,", " mm/px,")
    assert drawing.part.units in scale


def test_a_drawing_with_a_given_scale_is_centred_by_its_lines() -> None:
    job = from_mapping({"page": {"size": [200, 150], "scale": 0.2}})
    drawing = plan(read(PARTS / "gear.png", job), job)
    low_x, low_y, high_x, high_y = find_bounds(drawing.part)
    assert (low_x + high_x, low_y + high_y) == pytest.approx((200, 150))
    assert drawing.part.units == "0.2 mm/px"
    tight = from_mapping({"page": {"size": [high_x - low_x + 19.9, 150], "scale": 0.2}})
    with pytest.raises(InputError, match="leaves the page"):
        plan(read(PARTS / "gear.png", tight), tight)
