"""A contour has the color that is visible, from its entity, layer, block or style."""

import io
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest

import camgen
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.read import colors, dxf, inspect, read
from camgen.read.files import Files
from camgen.read.job_file import from_mapping
from camgen.read.made import make_part


def new() -> tuple[Any, Any]:
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    document.layers.add("RED", color=1)
    document.layers.add("SKY", true_color=0x87CEEB)
    return document, document.modelspace()


def part_of(document: Any, job: Job | None = None) -> Part:
    return dxf.read(_source(document), job or Job(), Files())


def _source(document: Any) -> Source:
    text = io.StringIO()
    document.write(text)
    return Source(Path("part.dxf"), text.getvalue().encode())


@pytest.mark.parametrize(
    ("attributes", "color"),
    [
        ({}, "#ffffff"),  # BYLAYER on layer 0, which has the color 7
        ({"color": 7}, "#ffffff"),
        ({"layer": "RED"}, "#ff0000"),
        ({"layer": "red"}, "#ff0000"),  # Names of layers ignore case.
        ({"layer": "SKY"}, "#87ceeb"),
        ({"layer": "NOT IN THE TABLE"}, "#ffffff"),
        ({"layer": "RED", "color": 5}, "#0000ff"),
        ({"layer": "RED", "color": 256}, "#ff0000"),
        ({"layer": "RED", "color": 30}, "#ff7f00"),
        ({"layer": "RED", "color": 0}, "#ffffff"),  # BYBLOCK outside of a block
        ({"color": 5, "true_color": 0x102030}, "#102030"),
    ],
)
def test_an_entity_of_a_drawing_has_its_color_or_that_of_its_layer(
    attributes: dict[str, Any], color: str
) -> None:
    document, space = new()
    space.add_circle((0, 0), 5, dxfattribs=attributes)
    space.add_ellipse((20, 0), (4, 0), 0.5, dxfattribs=attributes)
    assert [c.color for c in part_of(document).contours] == [color, color]


def test_an_entity_of_a_block_may_have_the_color_of_the_reference_or_of_its_layer() -> None:
    document, space = new()
    inner = document.blocks.new("INNER")
    inner.add_circle((0, 0), 1, dxfattribs={"color": 0})  # BYBLOCK
    inner.add_circle((4, 0), 1)  # BYLAYER on layer 0: the layer of the reference
    inner.add_circle((8, 0), 1, dxfattribs={"color": 3, "layer": "RED"})
    outer = document.blocks.new("OUTER")
    outer.add_blockref("INNER", (0, 0), dxfattribs={"color": 0})
    space.add_blockref("INNER", (0, 0), dxfattribs={"color": 6, "layer": "RED"})
    space.add_blockref("OUTER", (0, 20), dxfattribs={"true_color": 0x445566, "layer": "SKY"})
    contours = part_of(document).contours
    centres = [tuple(np.round(contour.points.mean(axis=0)).tolist()) for contour in contours]
    assert dict(zip(centres, [contour.color for contour in contours], strict=True)) == {
        **{(0, 0): "#ff00ff", (4, 0): "#ff0000", (8, 0): "#00ff00"},
        **{(0, 20): "#445566", (4, 20): "#87ceeb", (8, 20): "#00ff00"},
    }


def test_pieces_of_one_color_are_joined_first() -> None:
    """A red and a blue square share a corner, at which the sides of both continue straight."""
    document, space = new()
    for color, sign in ((1, 1), (5, -1)):
        corners = [(0, 0), (10 * sign, 0), (10 * sign, 10 * sign), (0, 10 * sign)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            space.add_line(a, b, dxfattribs={"color": color})
    contours = part_of(document).contours
    assert sorted((c.color, c.closed, len(c.points)) for c in contours) == [
        ("#0000ff", True, 4),
        ("#ff0000", True, 4),
    ]


def test_a_contour_has_the_color_of_its_first_piece() -> None:
    document, space = new()
    space.add_line((0, 0), (10, 0), dxfattribs={"color": 1})
    space.add_line((10, 0), (10, 90), dxfattribs={"color": 5})
    part = part_of(document)
    assert [c.color for c in part.contours] == ["#ff0000"]
    note = "joined: contours of more than one color: 1 (each has the color of its first piece)"
    assert note not in map(str, part.notes)
    chosen = from_mapping({"operations": [{"kind": "trace", "colors": ["red"]}]})
    assert note in map(str, part_of(document, chosen).notes)


@pytest.mark.parametrize(
    ("body", "color"),
    [
        ('<path d="M0 0H9" stroke="Red"/>', "#ff0000"),
        ('<path d="M0 0H9" stroke="#0F0"/>', "#00ff00"),
        ('<path d="M0 0H9" stroke="red" style="stroke:rgb(0, 0, 255)"/>', "#0000ff"),
        ('<g stroke="navy"><path d="M0 0H9"/></g>', "#000080"),
        ('<g stroke="navy"><path d="M0 0H9" stroke="inherit"/></g>', "#000080"),
        ('<rect width="9" height="9" fill="teal"/>', "#008080"),
        ('<rect width="9" height="9" fill="teal" stroke="lime"/>', "#00ff00"),
        ('<rect width="9" height="9" fill="teal" stroke="lime" stroke-opacity="0"/>', "#008080"),
        ('<rect width="9" height="9" stroke="none"/>', "#000000"),
        ('<g color="orange"><path d="M0 0H9" stroke="currentColor"/></g>', "#ffa500"),
        ('<linearGradient id="shine"/><path d="M0 0H9" stroke="url(#shine)"/>', ""),
        ('<path d="M0 0H9" stroke="url(#shine) red"/>', "#ff0000"),
        ('<path d="M0 0H9" stroke="hsl(120, 100%, 25%)"/>', "#008000"),
        ('<path d="M0 0H9" stroke="reddish"/>', ""),
        ("<style>.cut { stroke: #FF0000 }</style><path class='cut' d='M0 0H9'/>", "#ff0000"),
    ],
)
@pytest.mark.parametrize("page", ['width="50mm" height="50mm" viewBox="0 0 50 50"', ""])
def test_a_shape_of_an_svg_has_the_color_of_its_stroke_or_its_fill(
    tmp_path: Path, body: str, color: str, page: str
) -> None:
    file = tmp_path / "part.svg"
    file.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {page}>{body}</svg>')
    assert [c.color for c in read(file, Job()).contours] == [color]


def test_inspect_counts_the_colors_if_there_are_several(tmp_path: Path) -> None:
    document, space = new()
    for k, color in enumerate((1, 1, 7)):
        space.add_circle((20 * k, 0), 5, dxfattribs={"color": color})
    file = tmp_path / "part.dxf"
    document.saveas(file)
    assert "\ncolors of contours: 2 #ff0000 (red), 1 #ffffff (white)" in str(inspect(file))
    space.query("CIRCLE[color==7]").first.dxf.color = 1
    document.saveas(file)
    assert "colors" not in str(inspect(file))


def test_twelve_colors_are_listed_and_the_rest_counted() -> None:
    text = colors.count_colors([f"#0000{k:02x}" for k in range(20)])
    assert text.count("#") == 12
    assert text.endswith(" and 8 more")


def test_a_contour_made_in_code_keeps_its_color() -> None:
    contour = Contour(np.array([(0.0, 0.0), (9.0, 0.0)]), np.zeros(2), False, "0", color="#ff0000")
    assert [c.color for c in make_part([contour]).contours] == ["#ff0000"]


def test_a_contour_keeps_its_color_on_a_page_and_when_it_is_simplified() -> None:
    lines = [[(0, 0), (10, 0), (20, 0.01), (30, 0)], [(30, 0), (30, 30)]]
    contours = [
        Contour(np.array(points, dtype=float), np.zeros(len(points)), False, "0", color="#ff0000")
        for points in lines
    ]
    tables = {
        "operation": {"kind": "trace"},
        "page": {"size": "A4"},
        "tolerance": {"simplify": 0.1},
    }
    planned = camgen.plan(make_part(contours), tables)
    assert [c.color for c in planned.part.contours] == ["#ff0000", "#ff0000"]
    assert [len(c.points) for c in planned.part.contours] == [2, 2]


@pytest.mark.parametrize("number", [0, 256, 1000])
def test_a_number_out_of_range_has_no_color(number: int) -> None:
    assert not colors.resolve_named(str(number))


def test_the_table_of_css_colors_is_complete() -> None:
    """The standard has 148 names. Six of their colors are compared."""
    assert len(colors.CSS) == 148
    named = ("rebeccapurple", "darkseagreen", "gray", "grey", "papayawhip", "green")
    assert [colors.CSS[name] for name in named] == [
        "#663399",
        "#8fbc8f",
        "#808080",
        "#808080",
        "#ffefd5",
        "#008000",
    ]
