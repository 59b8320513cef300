"""SVG drawings are read: curves as formulas give them, units, layers, and damage with its name."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.geometry.segments import compute_bounds, flatten, make_contour_segments
from camgen.model.errors import InputError, JobError
from camgen.model.part import Part
from camgen.read import find_reader, inspect, read
from camgen.read.job_file import from_mapping
from camgen.read.svg.path import Oval, Subpath, tracks
from camgen.read.svg.transforms import read_transform
from camgen.read.svg.values import Malformed, fit_viewport, view_box
from tests.support.files import source

HEAD = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)
PAGE = 'width="100mm" height="100mm" viewBox="0 0 100 100"'


def drawn(
    tmp_path: Path, body: str, page: str = PAGE, job: dict[str, object] | None = None
) -> Part:
    path = tmp_path / "part.svg"
    path.write_text(f"<svg {HEAD} {page}>{body}</svg>")
    return read(path, from_mapping(job or {}))


def lengths(part: Part) -> list[float]:
    segments = make_contour_segments(part.contours)
    return np.bincount(segments.owner, segments.length).tolist()


def box(part: Part) -> list[float]:
    boxes = compute_bounds(make_contour_segments(part.contours))
    return [*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist()]


def notes(part: Part, kind: str) -> str:
    return "\n".join(str(note) for note in part.notes if note.kind == kind)


#: Path data, the length of its contour (mm, calculated by hand), and whether it is closed.
PATHS = [
    ("M10 10L13 14", 5.0, False),
    ("m10,10 3,4", 5.0, False),
    ("M10,10 13,14 16,10", 10.0, False),
    ("M10 10h3v4h-3z", 14.0, True),
    ("M10 10H13V14H10Z", 14.0, True),
    ("M10-10l3-4", 5.0, False),
    ("M.5.5l3e0 4", 5.0, False),
    ("M1e1 1E+1L+13 1.4e1", 5.0, False),
    ("M010 10.L13.e0 14", 5.0, False),
    ("M10 10A5 5 0 0 1 20 10", 5 * math.pi, False),
    ("M10 10A5 5 0 0110 20", 5 * math.pi, False),
    ("M10 10A5 5 0\n0\t1\r\n10 20", 5 * math.pi, False),
    ("M10 10a5 5 0 1010 0", 5 * math.pi, False),
    ("M10 10a5 5 0 015 5", 5 * math.pi / 2, False),
    ("M10 10a5 5 0 115 5", 15 * math.pi / 2, False),
    # Radii that are too small are enlarged to a half circle over the chord.
    ("M10 10a1 1 0 0 1 10 0", 5 * math.pi, False),
    # An arc with a radius of 0 is a line. An arc that ends at its start is left out.
    ("M10 10a0 5 0 0 1 3 4", 5.0, False),
    ("M10 10a5 5 0 0 1 0 0l3 4", 5.0, False),
    # These Bezier curves are lines.
    ("M10 10C11 11 12 12 13 13", 3 * math.sqrt(2), False),
    ("M10 10Q12 12 14 14", 4 * math.sqrt(2), False),
    ("M10 10c1 1 2 2 3 3s2 2 3 3", 6 * math.sqrt(2), False),
    ("M10 10q1 1 2 2t2 2", 4 * math.sqrt(2), False),
]


@pytest.mark.parametrize(("data", "length", "closed"), PATHS, ids=[path[0] for path in PATHS])
def test_path_data_gives_a_contour_of_its_length(
    tmp_path: Path, data: str, length: float, closed: bool
) -> None:
    part = drawn(tmp_path, f'<path d="{data}"/>')
    assert lengths(part) == pytest.approx([length], abs=1e-9)
    assert [c.closed for c in part.contours] == [closed]


def test_a_smooth_curve_mirrors_only_a_control_point_of_its_own_kind(tmp_path: Path) -> None:
    # After a line or a curve of another degree, the first control point is the current point (SVG
    # 1.1, 8.3.6).
    for data, without_smooth in [
        ("M10 10L20 10S30 20 30 10", "M10 10L20 10C20 10 30 20 30 10"),
        ("M10 10Q15 20 20 10S30 20 30 10", "M10 10Q15 20 20 10C20 10 30 20 30 10"),
        ("M10 10C10 20 20 20 20 10S30 0 30 10", "M10 10C10 20 20 20 20 10C20 0 30 0 30 10"),
        ("M10 10Q15 20 20 10T30 10T40 10", "M10 10Q15 20 20 10Q25 0 30 10Q35 20 40 10"),
        ("M10 10C10 20 20 20 20 10T30 10", "M10 10C10 20 20 20 20 10Q20 10 30 10"),
    ]:
        smooth, plain = (drawn(tmp_path, f'<path d="{d}"/>') for d in (data, without_smooth))
        assert np.array_equal(smooth.contours[0].points, plain.contours[0].points), data


def test_a_parabola_has_the_length_of_the_formula(tmp_path: Path) -> None:
    # The curve is the parabola y = x^2 / 10 from x = -10 to 10. Its control point is (0, -10).
    part = drawn(tmp_path, '<path d="M20 40Q30 60 40 40"/>', job={"tolerance": {"chord": 1e-4}})
    slope = 2.0
    exact = 10 / slope * (slope * math.sqrt(1 + slope**2) + math.asinh(slope))
    assert lengths(part) == pytest.approx([exact], rel=1e-5)


def test_y_runs_up_from_the_lower_edge_of_the_page(tmp_path: Path) -> None:
    part = drawn(tmp_path, '<path d="M10 20L30 60"/>')
    assert part.contours[0].points.tolist() == [[10.0, 80.0], [30.0, 40.0]]


@given(
    st.lists(
        st.tuples(
            st.sampled_from("LHVCSQTA"), st.lists(st.integers(-50, 50), min_size=7, max_size=7)
        ),
        min_size=1,
        max_size=8,
    )
)
def test_relative_commands_draw_what_absolute_ones_do(
    commands: list[tuple[str, list[int]]],
) -> None:
    size = {"L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2}
    absolute, relative = ["M3 4"], ["m3 4"]
    x, y = 3, 4
    for letter, v in commands:
        if letter == "A":
            radii = f"{abs(v[0]) + 1} {abs(v[1]) + 1} {v[2]} {v[3] % 2} {v[4] % 2}"
            absolute.append(f"A{radii} {x + v[5]} {y + v[6]}")
            relative.append(f"a{radii} {v[5]} {v[6]}")
            x, y = x + v[5], y + v[6]
            continue
        w = v[: size[letter]]
        offset = {"H": [x], "V": [y]}.get(letter, [x, y] * 3)
        absolute.append(letter + " ".join(str(a + b) for a, b in zip(w, offset, strict=False)))
        relative.append(letter.lower() + " ".join(map(str, w)))
        x, y = x + (w[-2:][0] if letter != "V" else 0), y + (w[-1] if letter != "H" else 0)
    (first, fault), (second, other_fault) = tracks("".join(absolute)), tracks("".join(relative))
    assert (fault, other_fault) == ("", "")
    numbers = zip(list_numbers(first), list_numbers(second), strict=True)
    assert all(np.allclose(a, b) for a, b in numbers)


def list_numbers(subpaths: list[Subpath]) -> list[np.ndarray]:
    """Points of the lines, and centres and half diameters of the arcs, of each subpath."""
    numbers = []
    for subpath in subpaths:
        arcs_and_lines = [
            np.append(run.center, run.first) if isinstance(run, Oval) else np.ravel(run)
            for run in subpath.runs
        ]
        numbers.append(np.concatenate(arcs_and_lines))
    return numbers


def test_many_lines_in_one_command_are_the_lines_of_single_commands() -> None:
    steps = [(k % 7 - 3, k % 5 - 2) for k in range(1, 40)]
    (joint,), _ = tracks("M1 2l" + " ".join(f"{a},{b}" for a, b in steps))
    (single,), _ = tracks("M1 2" + "".join(f"l{a} {b}" for a, b in steps))
    assert np.array_equal(joint.runs[0], single.runs[0])


SHAPES = [
    ('<line x1="10" y1="10" x2="13" y2="14"/>', 5.0),
    ('<polyline points="10,10 13,14 16,10"/>', 10.0),
    ('<polygon points="10,10 13,10 13,14"/>', 12.0),
    ('<rect x="10" y="10" width="20" height="10"/>', 60.0),
    ('<rect x="10" y="10" width="20" height="10" rx="2"/>', 60 - 16 + 4 * math.pi),
    ('<rect x="10" y="10" width="20" height="10" ry="99"/>', 20 + 10 * math.pi - 10 + 0.0),
    ('<circle cx="20" cy="20" r="10"/>', 20 * math.pi),
    ('<circle cx="20%" cy="20%" r="10%"/>', 20 * math.pi),
    ('<ellipse cx="20" cy="20" rx="10" ry="10"/>', 20 * math.pi),
    ('<ellipse cx="20" cy="20" rx="5" ry="10" transform="scale(2,1)"/>', 20 * math.pi),
]


@pytest.mark.parametrize(("body", "length"), SHAPES, ids=[shape[0] for shape in SHAPES])
def test_a_shape_gives_a_contour_of_its_length(tmp_path: Path, body: str, length: float) -> None:
    if 'ry="99"' in body:
        # Both radii of 99 are cut to half the width and half the height, so the rectangle is an
        # ellipse. Ramanujan (1914) gives its length.
        a, b = 10.0, 5.0
        h = ((a - b) / (a + b)) ** 2
        length = math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))
        assert lengths(drawn(tmp_path, body)) == pytest.approx([length], rel=1e-3)
        return
    part = drawn(tmp_path, body)
    assert lengths(part) == pytest.approx([length], abs=1e-9)


@pytest.mark.parametrize(
    "transform", ["rotate(33)", "scale(-2)", "scale(1,-1)", "rotate(10) translate(3 4) scale(.5)"]
)
def test_a_circle_that_is_not_stretched_is_two_exact_arcs(tmp_path: Path, transform: str) -> None:
    part = drawn(tmp_path, f'<circle cx="20" cy="20" r="10" transform="{transform}"/>')
    assert np.abs(part.contours[0].bulges).tolist() == [1.0, 1.0]


def test_a_stretched_circle_follows_its_ellipse(tmp_path: Path) -> None:
    part = drawn(tmp_path, '<circle cx="20" cy="40" r="10" transform="scale(2,1)"/>')
    points, _ = flatten(make_contour_segments(part.contours), 1e-4)
    x, y = (points[:, 0] - 40) / 20, (points[:, 1] - 60) / 10
    # The relative error of the equation is at most twice the distance over the shorter half axis.
    assert np.abs(np.hypot(x, y) - 1).max() <= 0.011 / 10


@pytest.mark.parametrize(
    ("text", "point", "expected"),
    [
        ("translate(3)", (1, 2), (4, 2)),
        ("translate(3,4)", (1, 2), (4, 6)),
        ("scale(2)", (1, 2), (2, 4)),
        ("scale(2 3)", (1, 2), (2, 6)),
        ("rotate(90)", (1, 2), (-2, 1)),
        ("rotate(90 1 1)", (1, 2), (0, 1)),
        ("skewX(45)", (1, 2), (3, 2)),
        ("skewY(45)", (1, 2), (1, 3)),
        ("matrix(1 2 3 4 5 6)", (1, 2), (12, 16)),
        ("translate(10,0) scale(2)", (1, 2), (12, 4)),
        ("scale(2),translate(10 0)", (1, 2), (22, 4)),
        ("", (1, 2), (1, 2)),
    ],
)
def test_a_transform_moves_a_point(
    text: str, point: tuple[float, float], expected: tuple[float, float]
) -> None:
    matrix = read_transform(text)
    assert (matrix @ (*point, 1.0)).tolist() == pytest.approx(expected)


@pytest.mark.parametrize(
    "text", ["turn(3)", "scale()", "matrix(1 2 3)", "rotate(1 2)", "scale(2) x"]
)
def test_an_invalid_transform_is_malformed(text: str) -> None:
    with pytest.raises(Malformed):
        read_transform(text)


@pytest.mark.parametrize(
    ("page", "line"),
    [
        # The page, and the length of a line of 10 units, mm.
        ('width="100mm" height="50mm" viewBox="0 0 100 50"', 10.0),
        ('width="10cm" height="5cm" viewBox="0 0 200 100"', 5.0),
        ('width="2in" height="2in" viewBox="0 0 20 20"', 25.4),
        ('width="72pt" height="72pt" viewBox="0 0 10 10"', 25.4),
        ('width="6pc" height="6pc" viewBox="0 0 10 10"', 25.4),
        ('width="96" height="96"', 10 * 25.4 / 96),
        ('width="96px" height="96px" viewBox="0 0 10 10"', 25.4),
        ('width="400q" height="400q" viewBox="0 0 10 10"', 100.0),
        ('viewBox="0 0 100 100"', 10 * 25.4 / 96),
        ("", 10 * 25.4 / 96),
        ('width="50mm" viewBox="0 0 100 70"', 5.0),
        ('width="100%" height="100%" viewBox="0 0 100 100"', 10 * 25.4 / 96),
    ],
)
def test_the_page_determines_the_unit(tmp_path: Path, page: str, line: float) -> None:
    part = drawn(tmp_path, '<line x1="0" y1="5" x2="10" y2="5"/>', page)
    assert lengths(part) == pytest.approx([line], rel=1e-12)
    is_stated = any(unit in page for unit in ("mm", "cm", "in", "pt", "pc", "q"))
    assert bool(notes(part, "assumed")) != is_stated


def test_input_units_replace_those_of_the_page_and_may_be_px(tmp_path: Path) -> None:
    line = '<line x1="0" y1="5" x2="10" y2="5"/>'
    for name, mm in [("mm", 10.0), ("inch", 254.0), ("px", 250 / 96 * 1.016), ("pt", 254 / 72)]:
        part = drawn(tmp_path, line, job={"input": {"units": name}})
        assert lengths(part) == pytest.approx([mm])
    with pytest.raises(JobError, match="unknown unit"):
        drawn(tmp_path, line, job={"input": {"units": "ell"}})


@pytest.mark.parametrize(
    ("aspect", "point"),
    [
        # Upper left corner and scales of a box of 10 x 10 in a viewport of 40 x 20.
        ("", (10, 0, 2, 2)),
        ("xMidYMid meet", (10, 0, 2, 2)),
        ("xMinYMin", (0, 0, 2, 2)),
        ("xMaxYMax", (20, 0, 2, 2)),
        ("xMidYMid slice", (0, -10, 4, 4)),
        ("xMinYMax slice", (0, -20, 4, 4)),
        ("none", (0, 0, 4, 2)),
    ],
)
def test_preserve_aspect_ratio_places_the_box_in_the_viewport(
    aspect: str, point: tuple[float, ...]
) -> None:
    box = view_box("5 6 10 10")
    assert box is not None
    matrix = fit_viewport(box, 40, 20, aspect)
    assert [*(matrix @ (5, 6, 1)), matrix[0, 0], matrix[1, 1]] == pytest.approx(point)


def test_a_layer_is_an_inkscape_layer_or_a_group_or_a_colour(tmp_path: Path) -> None:
    body = (
        '<g inkscape:groupmode="layer" inkscape:label="Cut" id="x1">'
        '<g id="inner"><path d="M0 0h9"/></g></g>'
        '<g id="engrave"><g id="deep"><path d="M0 5h9"/></g></g>'
        '<path style="stroke:#FF0000" d="M0 10h9"/><path fill="blue" d="M0 15h9"/>'
        '<path d="M0 20h9"/>'
    )
    part = drawn(tmp_path, body)
    assert [c.layer for c in part.contours] == ["Cut", "engrave", "#ff0000", "blue", "black"]
    kept = drawn(tmp_path, body, job={"input": {"layers": ["cut", "#ff*"]}})
    assert [c.layer for c in kept.contours] == ["Cut", "#ff0000"]
    assert "not used: 3 path on layers black, blue, engrave" in notes(kept, "assumed")
    with pytest.raises(JobError, match=r"no layer fits 'green'; there are|no layer fits"):
        drawn(tmp_path, body, job={"input": {"layers": ["green"]}})


def test_elements_that_are_not_visible_are_skipped_with_a_note(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        '<g display="none"><path d="M0 0h9"/><rect width="5" height="5"/></g>'
        '<g visibility="hidden"><path d="M0 0h9"/><path visibility="visible" d="M0 30h9"/></g>'
        '<path style="opacity:0" d="M0 0h9"/><path fill="none" d="M0 0h9"/>'
        '<path fill="none" stroke="red" stroke-dasharray="1 2" d="M0 50h9"/>',
    )
    assert len(part.contours) == 2
    skipped = notes(part, "skipped")
    assert "1 path, 1 rect on layer black (display is none)" in skipped
    assert "visibility is hidden" in skipped
    assert "opacity is 0" in skipped
    assert "neither stroke nor fill" in skipped
    assert "with dashes: 1" in notes(part, "assumed")


def test_elements_that_are_not_curves_are_skipped_with_a_note(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        "<text>a</text><image/><foreignObject/><blink/>"
        '<g clip-path="url(#c)"><path d="M0 0h9"/></g>'
        '<clipPath id="c"><circle r="1"/></clipPath><path marker-end="url(#m)" d="M0 9h9"/>',
    )
    assert len(part.contours) == 2
    skipped = notes(part, "skipped")
    assert "1 foreignObject, 1 image, 1 text" in skipped
    assert "1 blink" in skipped
    assert "1 path on layer black (its clip-path is not followed: drawn without it)" in skipped
    assert "its markers: marker-end is not followed: drawn without it" in skipped


def test_style_sheets_hide_by_element_class_and_id(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        "<style>/* .a{} */ .a, rect.b {display:none} #one{display:inline} "
        "circle{visibility:hidden !important}"
        "@media print {.d{display:none}} g > path {display:none}</style>"
        '<path class="a" d="M0 0h9"/><path id="one" class="a" d="M0 9h9"/>'
        '<rect class="b" width="5" height="5"/>'
        '<path class="b" d="M0 20h9"/><circle r="5"/>'
        '<path class="a" style="display:inline" d="M0 30h9"/>',
    )
    assert [c.points[0, 1] for c in part.contours] == [91.0, 80.0, 70.0]


def test_uses_symbols_and_inner_pages_are_placed(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        '<defs><rect id="r" width="10" height="10"/>'
        '<symbol id="s" viewBox="0 0 2 2"><rect width="2" height="2"/></symbol></defs>'
        '<use href="#r" x="20" y="30"/><use xlink:href="#s" x="50" y="50" width="20" height="20"/>'
        '<svg x="80" y="80" width="10" height="10" viewBox="0 0 1 1">'
        '<rect width="1" height="1"/></svg>',
    )
    boxes = [[*c.points.min(axis=0), *c.points.max(axis=0)] for c in part.contours]
    assert boxes == [[20, 60, 30, 70], [50, 30, 70, 50], [80, 10, 90, 20]]


def test_references_that_never_end_are_left_out(tmp_path: Path) -> None:
    part = drawn(tmp_path, '<g id="a"><path d="M0 0h9"/><use href="#a"/></g><use href="#gone"/>')
    assert "1 use on layer a: #a (refers to itself)" in notes(part, "skipped")
    assert "1 use on layer black: #gone (refers to nothing in this file" in notes(part, "skipped")


def test_references_that_draw_too_many_elements_are_refused(tmp_path: Path) -> None:
    levels = "".join(f'<g id="g{k}">' + f'<use href="#g{k + 1}"/>' * 10 + "</g>" for k in range(12))
    body = f'<defs>{levels}<path id="g12" d="M0 0h9"/></defs><use href="#g0"/>'
    with pytest.raises(InputError, match="its references draw more than 9,000 elements"):
        drawn(tmp_path, body, job={"limits": {"svg_uses": 9000.0}})


def test_groups_may_be_nested_5000_deep(tmp_path: Path) -> None:
    part = drawn(tmp_path, "<g>" * 5000 + '<path d="M0 0h9"/>' + "</g>" * 5000)
    assert lengths(part) == [9.0]


@pytest.mark.parametrize(
    ("data", "length"),
    [
        ("M0 0h9 L5 bad", 9.0),
        ("M0 0h9 Q1 2 3", 9.0),
        ("M0 0h9a1 1 0 2 1 3 4", 9.0),
        ("M0 0h9x", 9.0),
        ("M0 0 3 4 5", 5.0),
        ("M0 0h9M0 0P6 6L9 9", 9.0),
        ("M0 0h9L1--2 3 4", 9.0),
        ("M0 0h3v3h-3z4 4L9 9", 12.0),
    ],
)
def test_damaged_path_data_is_drawn_up_to_its_fault(
    tmp_path: Path, data: str, length: float
) -> None:
    part = drawn(tmp_path, f'<path d="{data}"/>')
    assert lengths(part) == pytest.approx([length])
    assert "drawn up to there" in notes(part, "skipped")


def test_paths_with_numbers_out_of_range_are_left_out(tmp_path: Path) -> None:
    part = drawn(
        tmp_path, '<path d="M0 0L1e999 3"/><path d="M0 0C1e300 1 2 3 4 5"/><path d="M0 0h9"/>'
    )
    assert lengths(part) == [9.0]
    assert "2 path" in notes(part, "skipped")


REFUSED = [
    (b"", "is empty"),
    (b"<svg", "is not well-formed XML"),
    (b'<?xml version="1.0"?><html/>', "is XML, but no SVG"),
    (b"<svg></svg>", "has no namespace of SVG"),
    (b'<!DOCTYPE svg [<!ENTITY a "b">]><svg/>', "defines entities"),
    (
        '<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY a "b">]><svg/>'.encode("utf-16"),
        "defines entities",
    ),
    (b"\x1f\x8b\x08", "is compressed"),
    (f"<svg {HEAD}/>".encode(), "nothing to machine"),
    (f'<svg {HEAD} viewBox="0 0 0 5"><path d="M0 0h9"/></svg>'.encode(), "viewBox is not a box"),
    (f'<svg {HEAD} width="4em"><path d="M0 0h9"/></svg>'.encode(), "width has the unit em"),
    (f"<svg {HEAD}><text>a</text></svg>".encode(), "nothing to machine"),
    (b'<?xml version="1.0" encoding="klingon"?><svg/>', "is not well-formed XML"),
]


@pytest.mark.parametrize(("data", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_a_file_that_cannot_be_used_is_refused_in_one_line(
    tmp_path: Path, data: bytes, message: str
) -> None:
    path = tmp_path / "bad.svg"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as error:
        read(path, from_mapping({}))
    assert "\n" not in str(error.value)


def test_a_doctype_without_entities_is_read(tmp_path: Path) -> None:
    path = tmp_path / "plain.xyz"
    doctype = (
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" '
        '"http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    )
    path.write_text(f'<?xml version="1.0"?>{doctype}<svg {HEAD} {PAGE}><path d="M0 0h9"/></svg>')
    assert find_reader(source(path)).name == "svg"
    assert lengths(read(path, from_mapping({}))) == [9.0]


def test_ends_that_meet_are_joined_and_duplicates_used_once(tmp_path: Path) -> None:
    part = drawn(
        tmp_path, '<path d="M0 0h9"/><path d="M9 0.01v9"/><path d="M0 50h9"/><path d="M9 50h-9"/>'
    )
    assert lengths(part) == pytest.approx([18, 9], abs=0.02)
    assert "gaps closed: 1" in notes(part, "joined")
    assert "drawn twice" in notes(part, "repaired")


def test_inspect_lists_page_layers_and_counts(tmp_path: Path) -> None:
    path = tmp_path / "part.svg"
    path.write_text(
        f'<svg {HEAD} {PAGE}><g id="cut"><circle cx="20" cy="20" r="10"/>'
        '<path d="M0 0h9"/></g></svg>'
    )
    page = str(inspect(path, from_mapping({})))
    assert "units mm, page 100 x 100 mm" in page
    assert "elements: 1 circle, 1 path" in page
    assert "contours: 1 closed, 1 open" in page
    assert "layer cut: used; 1 circle, 1 path" in page


def test_a_drawing_of_an_old_inkscape_is_a_warning(tmp_path: Path) -> None:
    for version, is_warned in [
        ("0.48.4 r9939", True),
        ("0.91 r13725", True),
        ("0.92.3", False),
        ("1.2", False),
    ]:
        page = f'width="90" height="90" inkscape:version="{version}"'
        part = drawn(tmp_path, '<path d="M0 0h9"/>', page)
        assert ("90 px for an inch" in notes(part, "warning")) == is_warned


def test_a_page_without_height_begins_at_the_drawing(tmp_path: Path) -> None:
    part = drawn(tmp_path, '<path d="M10 20h96v96"/>', "")
    assert box(part) == pytest.approx([0, 0, 25.4, 25.4])
