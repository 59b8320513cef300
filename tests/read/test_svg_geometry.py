"""Transforms, geometry in CSS, clips and conditions of SVG 2 give positions known by hand."""

import math
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.model.part import Part
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.read.svg.clip import cut_outline, make_half_planes
from camgen.read.svg.path import measure_bounds, tracks
from camgen.read.svg.style import evaluate_media

HEAD = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'width="100mm" height="80mm"'
)
PAGE = f'{HEAD} viewBox="0 0 100 80"'
LINE = 'fill="none" stroke="black"'
#: A rectangle of 30 x 10 around (35, 25), y down.
BOX = f'<rect x="20" y="20" width="30" height="10" {LINE}'
MM_PER_PX = 25.4 / 96


def drawn(folder: Path, body: str, page: str = PAGE) -> Part:
    path = folder / "part.svg"
    path.write_text(f"<svg {page}>{body}</svg>")
    return read(path, from_mapping({}))


def box(part: Part) -> list[float]:
    """The box around straight contours: left, lower, right and upper edge, mm, y up."""
    points = np.concatenate([contour.points for contour in part.contours])
    return [*points.min(axis=0).tolist(), *points.max(axis=0).tolist()]


def losses(part: Part) -> str:
    return "\n".join(str(note) for note in part.notes if note.kind == "skipped")


#: Transforms of the box, and its box in the work frame: left, lower, right and upper edge.
TRANSFORMS = [
    # A quarter turn around the middle gives 10 x 30 mm around (35, 55).
    ('transform="rotate(90)" transform-origin="35 25"', (30, 40, 40, 70)),
    ('transform="rotate(90)" style="transform-origin:35px 25px"', (30, 40, 40, 70)),
    ('style="transform:rotate(90deg);transform-origin:35px 25px"', (30, 40, 40, 70)),
    ('style="transform:rotate(.25turn);transform-origin:35px 25px"', (30, 40, 40, 70)),
    ('style="transform:rotate(100grad);transform-origin:35px 25px"', (30, 40, 40, 70)),
    ('style="rotate:90deg;transform-origin:35px 25px"', (30, 40, 40, 70)),
    ('style="rotate:90deg;transform-box:fill-box;transform-origin:center"', (30, 40, 40, 70)),
    ('transform="rotate(90)" transform-box="fill-box" transform-origin="50%"', (30, 40, 40, 70)),
    # Around the upper left corner (20, 20) of the box, x is 10 to 20 and y is 20 to 50.
    ('transform="rotate(90)" transform-box="fill-box"', (10, 30, 20, 60)),
    # Around the middle of the page, (x, y) moves to (50 - (y - 40), 40 + (x - 50)).
    ('transform="rotate(90)" transform-origin="center"', (60, 40, 70, 70)),
    ('style="transform:rotate(90deg);transform-origin:center"', (60, 40, 70, 70)),
    ('style="transform:rotate(90deg);transform-origin:bottom right"', (150, 50, 160, 80)),
    # 60 x 20 around (80, 25): (20, 20) goes to 2 (20, 20) + (10, 5).
    ('style="transform:translate(10px,5px) scale(2)"', (50, 15, 110, 35)),
    ('style="transform:translate(10%, 5px) scale(2)"', (50, 15, 110, 35)),
    ('style="translate:10px 5px;scale:2"', (50, 15, 110, 35)),
    ('style="translate:10px 5px;scale:200%"', (50, 15, 110, 35)),
    ('style="translate:10px;transform:translateY(5px) scaleX(2) scaleY(2)"', (50, 15, 110, 35)),
    ('style="transform:matrix(2, 0, 0, 2, 10, 5)"', (50, 15, 110, 35)),
    # In CSS, 96 px of the drawing are an inch.
    ('style="transform:translate(25.4mm)"', (116, 50, 146, 60)),
    ('style="translate:50%;transform-box:fill-box"', (35, 50, 65, 60)),
    # CSS replaces the attribute.
    ('transform="scale(9)" style="transform:none"', (20, 50, 50, 60)),
    ('transform="translate(1 2)" style="transform:translate(2px)"', (22, 50, 52, 60)),
    ('transform="translate(1 2)" style="translate:2px"', (23, 48, 53, 58)),
    ('style="transform:skewX(45deg)"', (40, 50, 80, 60)),
    ('style="transform:skew(45deg, 0)"', (40, 50, 80, 60)),
]  # fmt: skip


@pytest.mark.parametrize(("words", "expected"), TRANSFORMS, ids=[t[0] for t in TRANSFORMS])
def test_transforms_of_css_move_the_box(
    tmp_path: Path, words: str, expected: tuple[float, ...]
) -> None:
    part = drawn(tmp_path, f"{BOX} {words}/>")
    assert box(part) == pytest.approx(expected, abs=1e-9)
    assert not losses(part)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ('style="transform:rotate(90)"', "the angle 90 has no unit"),
        ('style="transform:translate(5, 6)"', "without a unit"),
        ('style="transform:rotateX(30deg)"', "transform rotatex with 1 values is not read"),
        ('style="transform:translate(calc(5px + 1px))"', "is not read"),
        ('style="transform:scale(2);transform-box:stroke-box"', "transform-box stroke-box"),
        ('style="transform:scale(2);transform-origin:left left"', "transform-origin left left"),
        ('style="rotate:x 30deg"', "transform rotate with 2 values"),
        ('style="transform:inherit"', "transform inherit is not read"),
        ("style=\"offset-path:path('M0 0h9')\"", "offset-path"),
        ('style="zoom:2"', "zoom 2 is not read"),
        ('vector-effect="fixed-position"', "vector-effect fixed-position is not read"),
        ('style="x:calc(2px)"', "x is not a length"),
        ('style="width:2em"', "width has the unit em"),
        ('style="display:contents"', "display contents is not read"),
        ('rx="-2"', "a negative radius"),
    ],
)
def test_a_value_that_is_not_read_leaves_its_shape_out(
    tmp_path: Path, words: str, reason: str
) -> None:
    part = drawn(tmp_path, f'{BOX} id="gone" {words}/><path d="M1 1h9"/>')
    assert len(part.contours) == 1
    assert reason in losses(part)
    assert "1 rect on layer black: #gone" in losses(part)


def test_a_group_that_is_not_read_names_the_shapes_in_it(tmp_path: Path) -> None:
    style = "transform:scale(2);transform-box:fill-box"
    shapes = '<path id="a" d="M1 1h9" stroke="red"/><g><circle id="b" r="3" fill="blue"/></g>'
    part = drawn(tmp_path, f'<g style="{style}">{shapes}</g>{BOX}/>')
    assert len(part.contours) == 1
    assert "1 circle, 1 path on layers blue, red: #a, #b" in losses(part)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        # Without an origin, the transform is around the middle of the page, (188.98, 151.18) px.
        ('transform="translate(10 0)"', (20 + 10 * MM_PER_PX, 50, 50 + 10 * MM_PER_PX, 60)),
        ('style="transform:translate(10mm)"', (30, 50, 60, 60)),
        ('transform="scale(2)"', (-10, 60, 50, 80)),
        ('transform="scale(2)" transform-origin="0 0"', (40, 20, 100, 40)),
        ('style="scale:2;transform-origin:100% 100%"', (-60, 100, 0, 120)),
    ],
)
def test_a_transform_of_the_outermost_svg_moves_the_page(
    tmp_path: Path, words: str, expected: tuple[float, ...]
) -> None:
    assert box(drawn(tmp_path, f"{BOX}/>", f"{PAGE} {words}")) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("shape", "center", "radius"),
    [
        ('<circle style="cx:50px;cy:40px;r:10px"', (50, 40), 10),
        ('<circle cx="20" cy="20" style="r:5px"', (20, 60), 5),
        ('<circle cx="20" cy="20" r="9" class="five"', (20, 60), 5),
        ('<circle cx="20" cy="20" r="9" style="r:5%"', (20, 60), 5 * math.sqrt(1.64 / 2)),
        ('<ellipse cx="20" cy="20" style="rx:5px;ry:auto"', (20, 60), 5),
        ('<g style="r:5px"><circle cx="20" cy="20" style="r:inherit"', (20, 60), 5),
        ('<circle cx="20" cy="20" r="5" class="important" style="r:9px"', (20, 60), 4),
    ],
)  # fmt: skip
def test_circles_in_css_have_their_position_and_size(
    tmp_path: Path, shape: str, center: tuple[float, float], radius: float
) -> None:
    sheet = "<style>.five{r:5px} .important{r:4px !important}</style>"
    end = "/></g>" if shape.startswith("<g") else "/>"
    (contour,) = drawn(tmp_path, f"{sheet}{shape} {LINE}{end}").contours
    assert np.abs(contour.bulges).tolist() == [1, 1]
    assert contour.points.mean(axis=0).tolist() == pytest.approx(center)
    assert np.ptp(contour.points, axis=0).max() == pytest.approx(2 * radius)


def test_round_corners_and_paths_in_css_are_read(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        f'<rect x="5" y="5" width="10" height="10" style="rx:2px" {LINE}/>'
        f'<path d="M0 0h5" style="d:path(\'M10 70h20\')" {LINE}/>',
    )
    # Each corner is a quarter circle, with the bulge tan(90 deg / 4).
    bulges = part.contours[0].bulges
    assert bulges[bulges != 0].tolist() == pytest.approx([-math.tan(math.pi / 8)] * 4)
    assert part.contours[1].points.tolist() == [[10, 10], [30, 10]]


SWITCHES = [
    ('<g requiredExtensions="x">{0}</g><g>{1}</g><g>{2}</g>', [1]),
    ('<g systemLanguage="de">{0}</g>{1}{2}', [1]),
    ("{0}{1}{2}", [0]),
]


@pytest.mark.parametrize(("children", "expected"), SWITCHES)
def test_a_switch_draws_its_first_child_without_conditions(
    tmp_path: Path, children: str, expected: list[int]
) -> None:
    lines = [f'<path d="M0 {10 * k}h9" stroke="#00000{k}"/>' for k in range(3)]
    part = drawn(tmp_path, f"<switch>{children.format(*lines)}</switch>")
    assert [c.points[0, 1] for c in part.contours] == [80 - 10 * k for k in expected]
    notes = [note for note in part.notes if "another child of its switch" in note.why]
    assert [(note.kind, note.what.partition(" on ")[0]) for note in notes] == [
        ("assumed", "not used: 2 path")
    ]


def test_a_child_whose_condition_is_not_known_to_hold_is_named(tmp_path: Path) -> None:
    part = drawn(
        tmp_path,
        f'<switch><path id="de" systemLanguage="de" d="M0 0h9"/></switch>'
        f'<path id="ext" requiredExtensions="x" d="M0 0h9"/>{BOX}/>',
    )
    assert len(part.contours) == 1
    assert "#de (its systemLanguage is not known to hold)" in losses(part)
    assert "#ext (its requiredExtensions is not known to hold)" in losses(part)


def test_a_link_directly_within_a_link_is_not_drawn(tmp_path: Path) -> None:
    line = '<path id="inner" d="M0 0h9"/>'
    part = drawn(tmp_path, f"<a><a>{line}</a>{BOX}/></a>")
    assert box(part) == [20, 50, 50, 60]
    assert "#inner (a link within a link is not drawn)" in losses(part)
    assert len(drawn(tmp_path, f"<a><g><a>{line}</a></g></a>").contours) == 1


INNER = f'<rect x="-5" y="5" width="50" height="10" {LINE}/>'
#: Viewports and clips of 20 x 20 at (10, 10), which cut a rectangle of 50 x 10 to two lines.
VIEWPORTS = [
    f'<svg x="10" y="10" width="20" height="20" viewBox="0 0 20 20">{INNER}</svg>',
    f'<svg x="10" y="10" width="20" height="20">{INNER}</svg>',
    f'<symbol id="s" viewBox="0 0 20 20">{INNER}</symbol>'
    '<use href="#s" x="10" y="10" width="20" height="20"/>',
    f'<symbol id="s" viewBox="0 0 20 20" x="10" y="10" width="20" height="20">{INNER}</symbol>'
    '<use href="#s"/>',
    '<clipPath id="c"><rect x="10" y="10" width="20" height="20"/></clipPath>'
    f'<g clip-path="url(#c)"><g transform="translate(10 10)">{INNER}</g></g>',
    '<clipPath id="c"><path d="M10 10V30H30V10z"/></clipPath>'
    f'<g style="clip-path:url(#c)"><g transform="translate(10 10)">{INNER}</g></g>',
]
VIEWPORTS.append(
    '<defs><rect id="r" x="10" y="10" width="20" height="20"/></defs>'
    '<clipPath id="c"><use xlink:href="#r" style="overflow:visible"/></clipPath>'
    f'<g clip-path="url(#c)"><g transform="translate(10 10)">{INNER}</g></g>'
)


@pytest.mark.parametrize("body", VIEWPORTS)
def test_viewports_and_rectangular_clip_paths_cut_lines(tmp_path: Path, body: str) -> None:
    part = drawn(tmp_path, body)
    lines = sorted(sorted(contour.points.tolist()) for contour in part.contours)
    assert np.allclose(lines, [[[10, 55], [30, 55]], [[10, 65], [30, 65]]])
    assert not losses(part)


@pytest.mark.parametrize("overflow", ['overflow="visible"', 'style="overflow:visible"'])
def test_a_visible_overflow_does_not_cut(tmp_path: Path, overflow: str) -> None:
    part = drawn(tmp_path, f'<svg x="10" y="10" width="20" height="20" {overflow}>{INNER}</svg>')
    assert box(part) == [5, 55, 55, 65]


def test_shapes_outside_of_a_viewport_and_cut_areas_are_named(tmp_path: Path) -> None:
    area = '<rect id="area" x="-5" y="5" width="50" height="10" fill="red"/>'
    far = f'<rect id="far" x="50" y="5" width="5" height="10" {LINE}/>'
    part = drawn(tmp_path, f'<svg width="20" height="20">{area}{far}</svg>{BOX}/>')
    assert len(part.contours) == 1
    assert "1 rect on layer red: #area (an area without a line, cut by" in losses(part)
    assert "1 rect on layer black: #far (outside of the viewport" in losses(part)


def test_a_circle_is_cut_into_arcs() -> None:
    corners = np.array([[0.0, -2.0], [3.0, -2.0], [3.0, 2.0], [0.0, 2.0]])
    clip = make_half_planes(corners)
    assert clip is not None
    circle = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]]), np.array([1.0, 1.0, 0.0])
    parts = cut_outline(circle, True, clip)
    assert parts is not None
    ((points, bulges),) = parts
    # The right half remains: two quarter circles from (0, -1) over (1, 0) to (0, 1).
    assert points == pytest.approx(np.array([[0, -1], [1, 0], [0, 1]]), abs=1e-12)
    assert bulges[:2] == pytest.approx(math.tan(math.pi / 8))


def test_a_clip_that_is_not_convex_is_not_used() -> None:
    arrow = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]])
    assert make_half_planes(arrow) is None
    assert make_half_planes(np.zeros((4, 2))) is None


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ("M1 2L5 9", (1, 2, 4, 7)),
        # A parabola with the control point (5, 10): y = 4 t (1 - t) 10 / 2, which is 5 high.
        ("M0 0Q5 10 10 0", (0, 0, 10, 5)),
        # In the middle, y = 3 t (1 - t) 10 is 7.5.
        ("M0 0C0 10 10 10 10 0", (0, 0, 10, 7.5)),
        ("M0 0A5 5 0 0 1 10 0", (0, -5, 10, 5)),
        ("M0 0A5 5 0 0 1 5 5", (0, 0, 5, 5)),
    ],
)
def test_the_bounds_of_a_path_are_exact(data: str, expected: tuple[float, ...]) -> None:
    bounds = measure_bounds(tracks(data)[0])
    assert (bounds.x, bounds.y, bounds.width, bounds.height) == pytest.approx(expected)


#: Style sheets, and whether they draw the second path of a group, with the class a and the id one.
SHEETS = [
    (".a{display:none}", False),
    ("g > path{display:none}", False),
    ("svg path:nth-child(2){display:none}", False),
    ("path:nth-child(3){display:none}", True),
    ("[class~=a]{display:none}", False),
    ("#one{display:inline} .a{display:none}", True),
    (".a{display:none!important} #one{display:inline}", False),
    (".a.a{display:none} .a{display:inline}", False),
    ("@media print{.a{display:none}}", True),
    ("@media screen{.a{display:none}}", False),
    ("@media not print{.a{display:none}}", False),
    ("/* .a{display:none} */", True),
    (".a{--note:'}';display:none}", False),
    (".a:hover{display:none}", True),
    (".b, .a{visibility:hidden}", False),
    ("g{visibility:hidden} .a{visibility:initial}", True),
    ("g{visibility:hidden} .a{visibility:unset}", False),
]


@pytest.mark.parametrize(("sheet", "is_drawn"), SHEETS, ids=[s[0] for s in SHEETS])
def test_a_style_sheet_hides_the_paths_that_it_selects(
    tmp_path: Path, sheet: str, is_drawn: bool
) -> None:
    sheet = sheet.replace(">", "&gt;")
    group = '<g><path d="M0 0h9" visibility="hidden"/><path class="a" id="one" d="M0 5h9"/></g>'
    part = drawn(tmp_path, f'<style>{sheet}</style>{group}<rect width="5" height="5"/>')
    assert len(part.contours) == 1 + is_drawn


@pytest.mark.parametrize(
    ("sheet", "reason"),
    [
        ("@media (min-width:9cm){.a{display:none}}", "@media _min-width:9cm_ is not evaluated"),
        ("@supports (display:block){.a{display:none}}", "@supports"),
        ("@layer base{.a{display:none}}", "@layer base is not evaluated"),
        (".a{ &amp;{display:none} }", "a rule within a rule is not evaluated"),
        (".a{display:var(--shown)}", "display: var_--shown_ is not evaluated"),
        (".a{visibility:gone}", "visibility: gone is not evaluated"),
        (".a{filter:blur(2px)}", "its filter is not followed"),
        (".a{animation:turn 2s}", "its animation is not followed"),
        (".a{fill:reddish}", "its fill is not a color: reddish"),
    ],
)
def test_a_rule_that_is_not_read_names_its_shapes(tmp_path: Path, sheet: str, reason: str) -> None:
    part = drawn(tmp_path, f'<style>{sheet}</style><path class="a" id="one" d="M0 5h9"/>')
    assert len(part.contours) == 1
    assert reason in losses(part)
    assert ": #one (" in losses(part)


def test_sheets_and_scripts_of_other_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "part.svg"
    body = '<style>@import "a.css"; a::b::c{x:y;display:none}</style><script/><path d="M0 5h9"/>'
    path.write_text(f'<?xml-stylesheet href="b.css"?><svg {PAGE}>{body}</svg>')
    notes = losses(read(path, from_mapping({})))
    assert "xml-stylesheet (style sheets of other files are not read)" in notes
    assert "1 @import _a.css_, 1 a::b::c (rules of the style sheet that are not read)" in notes
    assert "1 script on layer black (scripts are not run)" in notes


@pytest.mark.parametrize(
    ("query", "holds"),
    [
        ("", True), ("screen", True), ("only screen", True), ("print", False), ("not print", True),
        ("print, screen", True), ("not all", False), ("(min-width: 9cm)", None),
        ("(prefers-color-scheme: dark)", False), ("(prefers-color-scheme:light)", True),
        ("print, (color)", None), ("screen, (color)", True), ("screen and (color)", None),
    ],
)  # fmt: skip
def test_a_media_query_holds_or_is_not_read(query: str, holds: bool | None) -> None:
    assert evaluate_media(query) is holds


@pytest.mark.parametrize(
    "paint",
    [
        'fill="none" stroke="red" stroke-width="0"', 'fill="transparent"', 'fill="#1230"',
        'fill="#11223300"', 'fill="rgba(1,2,3,0)"', 'fill="rgb(1 2 3 / 0%)"', 'fill="url(#no)"',
        'fill="red" fill-opacity="0"', 'fill="currentColor" color="transparent"',
    ],
)  # fmt: skip
def test_a_shape_without_paint_is_named(tmp_path: Path, paint: str) -> None:
    part = drawn(tmp_path, f'<rect id="bare" width="9" height="9" {paint}/>{BOX}/>')
    assert len(part.contours) == 1
    assert "#bare" in losses(part)


@pytest.mark.parametrize(
    "words",
    [
        '<path id="moved" d="M0 5h9"><animate attributeName="x"/></path>',
        '<g><animateTransform attributeName="transform"/><path id="moved" d="M0 5h9"/></g>',
        '<path id="moved" d="M0 5h9"/><set href="#moved" attributeName="display" to="none"/>',
        '<path id="moved" d="M0 5h9" style="animation-name:turn"/>',
    ],
)
def test_an_animated_shape_is_named(tmp_path: Path, words: str) -> None:
    part = drawn(tmp_path, words)
    assert len(part.contours) == 1
    assert "#moved (its animation is not followed: drawn without it)" in losses(part)


@pytest.mark.parametrize("words", ['width=""', "", 'width="auto"', 'width=" "'])
def test_a_size_that_is_not_stated_follows_from_the_other(tmp_path: Path, words: str) -> None:
    page = f'xmlns="http://www.w3.org/2000/svg" {words} height="80mm" viewBox="0 0 100 80"'
    assert box(drawn(tmp_path, f"{BOX}/>", page)) == pytest.approx([20, 50, 50, 60])


def test_css_sets_the_size_of_the_page(tmp_path: Path) -> None:
    page = f'{PAGE.replace("mm", "px")} style="width:100mm;height:80mm;max-width:100%"'
    part = drawn(tmp_path, f"{BOX}/>", page)
    assert box(part) == pytest.approx([20, 50, 50, 60])
    assert "limits of the page in CSS: max-width" in str(part.notes)


PAPER = '<rect width="100%" height="100%" fill="white"/>'
PART = f'<rect x="20" y="20" width="40" height="30" {LINE}/><circle cx="40" cy="35" r="8" {LINE}/>'
#: Drawings with a rectangle as large as the page, and whether it is a background.
BACKGROUNDS = [
    (PAPER + PART, True),
    ('<path d="M0 0H100V80H0z" fill="#eee"/>' + PART, True),
    ('<path d="M0 80H100V0H0" fill="#eee"/>' + PART, True),
    ('<polygon points="0,0 100,0 100,80 0,80" fill="blue"/>' + PART, True),
    ('<g transform="scale(.5)"><rect width="200" height="160" fill="white"/></g>' + PART, True),
    ('<rect x="-0.05" width="100.08" height="80" fill="white"/>' + PART, True),
    (PAPER + '<circle cx="40" cy="35" r="8" fill="black"/>', True),
    ('<rect x="-10" y="-9" width="150" height="120" fill="white"/>' + PART, True),
    ('<g transform="rotate(180 50 40)"><path d="M0 0H100V80H0" fill="white"/></g>' + PART, True),
    # The rectangle has a line, is above another shape, is the only shape, or is smaller.
    (f'<rect width="100" height="80" {LINE}/>' + PART, False),
    ('<rect width="100" height="80" fill="white" stroke="black"/>' + PART, False),
    (PART + PAPER, False),
    (PAPER, False),
    ('<rect width="99" height="80" fill="white"/>' + PART, False),
    ('<rect x="1" width="100" height="80" fill="white"/>' + PART, False),
    ('<rect width="100" height="80" rx="3" fill="white"/>' + PART, False),
    ('<polygon points="0,0 100,0 100,80 1,80" fill="white"/>' + PART, False),
    ('<polygon points="0,0 100,80 100,0 0,80" fill="white"/>' + PART, False),

    # A plate is an area without a line. Its holes are areas, or belong to its path.
    ('<rect width="100" height="80" fill="gray"/><circle cx="40" r="8" fill="white"/>', False),
    ('<path d="M0 0H100V80H0zM20 20V50H60V20z" fill="white"/>' + PART, False),
]  # fmt: skip


@pytest.mark.parametrize(("body", "is_background"), BACKGROUNDS)
def test_a_background_is_not_a_contour(tmp_path: Path, body: str, is_background: bool) -> None:
    part = drawn(tmp_path, body)
    widths = [float(np.ptp(contour.points[:, 0])) for contour in part.contours]
    assert any(width > 98 for width in widths) != is_background
    notes = [note for note in part.notes if "background is not used" in note.what]
    assert [note.kind for note in notes] == ["assumed"] * is_background


def test_a_rectangle_as_large_as_the_viewbox_is_a_background(tmp_path: Path) -> None:
    page = f'{HEAD} viewBox="0 0 50 50"'
    paper = '<rect id="paper" width="50" height="50" fill="white"/>'
    part = drawn(tmp_path, f'{paper}<circle cx="20" cy="20" r="8" {LINE}/>', page)
    assert len(part.contours) == 1
    assert "a background is not used: rect #paper" in str(part.notes)


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        ('<rect x="5 mm" width="9" height="9"/>', "x is not a length: '5 mm'"),
        ('<rect x="5,5" width="9" height="9"/>', "x is not a length: '5,5'"),
        ('<polygon points="1,,2 3,4 5,6"/>', "not a list of numbers: '1,,2 3,4 5,6'"),
        ('<path transform="translate(1,,2)" d="M0 0h9"/>', "not a list of numbers"),
        ('<path transform="a&#10;b(1)" d="M0 0h9"/>', "unknown transform a b(1)"),
        ('<path d="M0 0h9"><animate/></path><path d="M0 0,,5 5"/>', "is damaged in a M command"),
    ],
)
def test_a_damaged_number_is_named(tmp_path: Path, element: str, reason: str) -> None:
    part = drawn(tmp_path, f"{element}{BOX}/>")
    assert reason in losses(part)
    assert len(part.contours) <= 2


@pytest.mark.parametrize("data", ["M0 0h9,L5 5", "M0 0h9L,5", "M0 0h9 L5,,5", "M0 0h9v,"])
def test_path_data_ends_at_a_stray_comma(tmp_path: Path, data: str) -> None:
    part = drawn(tmp_path, f'<path d="{data}"/>')
    assert part.contours[0].points.tolist() == [[0, 80], [9, 80]]
    assert "drawn up to there" in losses(part)


def test_an_arc_within_a_clip_is_not_cut_and_a_larger_one_is() -> None:
    corners = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]])
    clip = make_half_planes(corners)
    assert clip is not None
    # Three quarters of a circle of radius 4 around (4.5, 4.5), which lies in the clip.
    arc = np.array([[4.5, 0.5], [0.5, 4.5]])
    three_quarters = math.tan(3 * math.pi / 8)
    assert cut_outline((arc, np.array([three_quarters, 0.0])), False, clip) is None
    wider = (arc - 4.5) * 1.2 + 4.5
    parts = cut_outline((wider, np.array([three_quarters, 0.0])), False, clip)
    # A circle of radius 4.8 is outside of a square of half width 4.5 at each of the four sides.
    assert parts is not None
    assert len(parts) == 3


@pytest.mark.parametrize(
    "words", ['x=""', 'rx=" "', 'transform=""', 'style=""', 'fill=""', 'display=""', 'class=""']
)
def test_an_empty_attribute_is_not_set(tmp_path: Path, words: str) -> None:
    part = drawn(tmp_path, f'<rect {words} y="20" width="30" height="10"/>')
    assert box(part) == [0, 50, 30, 60]
    assert not losses(part)


@pytest.mark.parametrize(
    "clip",
    [
        '<clipPath id="c"><circle r="9"/></clipPath>',
        '<clipPath id="c"><rect width="9" height="9"/><rect width="5" height="5"/></clipPath>',
        '<clipPath id="c" clipPathUnits="objectBoundingBox"><path d="M0 0H1V1H0z"/></clipPath>',
        '<clipPath id="c" clip-path="url(#d)"><rect width="9" height="9"/></clipPath>',
        '<clipPath id="c" transform="scale(2)"><rect width="9" height="9"/></clipPath>',
        '<clipPath id="c"><path d="M0 0L9 0L1 1L0 9z"/></clipPath>',
        '<clipPath id="c"><use href="#r" x="3"/></clipPath>',
        '<clipPath id="c"><rect width="calc(9px)" height="9"/></clipPath>',
        '<clipPath id="c"><path d="M0 0H9V9H0z"><animate/></path></clipPath>',
        '<clipPath id="c"/>',
        "",
    ],
)
def test_any_other_clip_path_is_named(tmp_path: Path, clip: str) -> None:
    part = drawn(tmp_path, f'{clip}<g clip-path="url(#c)">{BOX} id="r"/></g>')
    assert box(part) == [20, 50, 50, 60]
    assert "#r (its clip-path is not followed: drawn without it)" in losses(part)


@pytest.mark.parametrize(
    "body",
    [
        "<style>path{fill:" + "(" * 3000 + ")" * 3000 + "}</style>",
        "<style>" + ":not(" * 3000 + "a" + ")" * 3000 + "{display:none}</style>",
        "<style>" + "@media screen{" * 3000 + "}" * 3000 + "</style>",
        "<path d='M0 0h9' style='fill:" + "(;" * 3000 + "'/>",
    ],
)
def test_styles_with_brackets_nested_too_deep_are_named(tmp_path: Path, body: str) -> None:
    assert "brackets more than 32 deep" in losses(drawn(tmp_path, f"{body}{BOX}/>"))


@pytest.mark.parametrize(
    "selector", ["rect ~ path", "path:nth-of-type(2)", "g:has(rect) path", "path:last-of-type"]
)
def test_selectors_of_quadratic_time_are_left_out_of_large_drawings(
    tmp_path: Path, selector: str
) -> None:
    sheet = f"<style>{selector}{{opacity:0}}</style>"
    lines = "".join(f'<path d="M0 {k / 100}h9"/>' for k in range(2000))
    small = drawn(tmp_path, f'{sheet}<g><rect/><path d="M0 0h9"/><path d="M0 9h9"/></g>{BOX}/>')
    assert "opacity is 0" in losses(small)
    assert "rules of the style sheet that are not read" in losses(drawn(tmp_path, sheet + lines))


def test_a_hidden_group_is_counted_for_each_reference_to_it(
    tmp_path: Path,
) -> None:
    group = '<defs><g id="g" opacity="0">' + '<path stroke="red" d="M0 0h9"/>' * 500 + "</g></defs>"
    part = drawn(tmp_path, group + '<use href="#g"/>' * 200 + f"{BOX}/>")
    assert "100000 path on layer red (opacity is 0)" in losses(part)


def test_an_element_of_another_program_without_shapes_is_not_reported(tmp_path: Path) -> None:
    other = '<x:view xmlns:x="http://example.org/"><x:grid/></x:view>'
    assert not losses(drawn(tmp_path, f'{other}{other}<g display="none"/>{BOX}/>'))
    shape = f'<x:view xmlns:x="http://example.org/">{BOX} id="inner"/></x:view>'
    assert "#inner (within an element that is not of SVG)" in losses(
        drawn(tmp_path, shape + BOX + "/>")
    )


def test_one_outline_is_kept_for_each_operation_that_chooses_its_color(tmp_path):
    """A square is drawn in red and again in blue. Each operation has one of the two."""
    square = '<path d="M1 1h20v20h-20z" fill="none" stroke="{}"/>'
    shapes = square.format("red") + square.format("blue")
    path = tmp_path / "two.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="40mm" height="40mm" viewBox="0 0 40 40">'
        f"{shapes}</svg>"
    )
    rows = [{"kind": "trace", "colors": ["red"]}, {"kind": "trace", "colors": ["blue"]}]
    assert len(camgen.read(path, {"operations": rows}).contours) == 2
    assert len(camgen.read(path).contours) == 1
