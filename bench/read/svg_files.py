"""SVG drawings from a grammar: a page, a style sheet and fragments, each of which shows a feature.

A drawing has a page of `PAGES` and six fragments. The first fragment of drawing n is feature n of
`FEATURES`, counted round; the others are drawn by the seed. A fragment has one shape or a few, in
up to three containers. Each shape has a color of its own, as its stroke or as its fill: the name
of its layer for camgen. A group that is referred to has an id, which is the name of its layer too.
Lengths and angles are rounded to 0.1.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import NamedTuple

SVG = "http://www.w3.org/2000/svg"
XLINK = "http://www.w3.org/1999/xlink"
#: Color of the first shape of a drawing; each further shape has the next color.
FIRST_COLOR = 0x100001
#: Fragments of a drawing.
FRAGMENTS = 6

#: Attributes of the outer svg element, and the size in px of a page without a stated size.
PAGES = {
    "mm": ('width="100mm" height="80mm" viewBox="0 0 100 80"', (378, 302)),
    "offset box": ('width="120mm" height="90mm" viewBox="-10 5 120 90"', (454, 340)),
    "px": ('width="300" height="250"', (300, 250)),
    "px box": ('width="300px" height="200px" viewBox="0 0 150 100"', (300, 200)),
    "box alone": ('viewBox="0 0 150 120"', (150, 120)),
    "cm, min max": (
        'width="10cm" height="10cm" viewBox="0 0 100 80" preserveAspectRatio="xMinYMax"',
        (378, 378),
    ),
    "none": (
        'width="100mm" height="50mm" viewBox="0 0 100 80" preserveAspectRatio="none"',
        (378, 189),
    ),
    "slice": (
        'width="90mm" height="80mm" viewBox="0 0 100 80" preserveAspectRatio="xMidYMid slice"',
        (340, 302),
    ),
    "empty width": ('width="" height="80mm" viewBox="0 0 100 80"', (378, 302)),
    "size in CSS": ('style="width:100mm;height:80mm" viewBox="0 0 100 80"', (378, 302)),
    "size in CSS over attributes": (
        'width="50" height="40" style="width:100mm;height:80mm" viewBox="0 0 100 80"',
        (378, 302),
    ),
    "transform": (
        'width="100mm" height="80mm" viewBox="0 0 100 80" transform="translate(10 4)"',
        (378, 302),
    ),
    "transform in CSS": (
        'width="100mm" height="80mm" viewBox="0 0 100 80" '
        'style="transform:rotate(90deg);transform-origin:20px 10px"',
        (378, 302),
    ),
    "turned about the middle": (
        'width="100mm" height="80mm" viewBox="0 0 100 80" transform="rotate(90)"',
        (378, 302),
    ),
}


class Drawing(NamedTuple):
    """A drawing of the grammar.

    text: the file.
    page: name of its page.
    window: width and height of a page without a stated size, px.
    layers: names that the layer of each shape may have.
    features: name of the feature of each shape.
    """

    text: str
    page: str
    window: tuple[int, int]
    layers: list[frozenset[str]]
    features: list[str]


class Writer:
    """The state of a drawing while it is written."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.layers: list[frozenset[str]] = []
        self.features: list[str] = []
        self.rules: list[str] = []
        self.definitions: list[str] = []
        self.feature = ""
        self.names = 0

    def number(self, lower: float, upper: float) -> float:
        """A random number with one decimal."""
        return round(self.random.uniform(lower, upper), 1)

    def pick(self, *choices: str) -> str:
        """A random choice."""
        return self.random.choice(choices)

    def name(self, stem: str) -> str:
        """An id or a class that the drawing has only once."""
        self.names += 1
        return f"{stem}{self.names}"

    def color(self, *layers: str) -> str:
        """The color of the next shape. layers: further names of its layer."""
        color = f"#{FIRST_COLOR + len(self.layers):06x}"
        self.layers.append(frozenset((color, *layers)))
        self.features.append(self.feature)
        return color

    def paint(self, style: str = "", layers: tuple[str, ...] = ()) -> str:
        """Attributes that color the next shape. style: its further declarations."""
        shape, color = len(self.layers), self.color(*layers)
        manner = self.pick("attribute", "style", "fill")
        words = {
            "attribute": f'stroke="{color}" fill="none"',
            "style": "",
            "fill": f'fill="{color}"',
        }[manner]
        if manner == "style":
            style = f"fill:none;stroke:{color};{style}"
        quoted = f' style="{style}"' if style else ""
        return f'data-shape="{shape}" {words}{quoted}'

    def element(self, extra: str = "", style: str = "", layers: tuple[str, ...] = ()) -> str:
        """A random shape with further attributes and declarations."""
        return f"<{self.geometry()} {self.paint(style, layers)} {extra}/>"

    def geometry(self) -> str:
        """The name and the geometry of a random shape as attributes."""
        x, y = self.number(15, 60), self.number(15, 50)
        a, b = self.number(4, 20), self.number(4, 20)
        forms = [
            f'rect x="{x}" y="{y}" width="{a}" height="{b}"',
            f'rect x="{x}" y="{y}" width="{a}" height="{b}" rx="{self.number(0.5, 4)}"',
            f'rect x="{x}mm" y="{y}" width="12%" height="{b}px" rx="3" ry="1.5"',
            f'circle cx="{x}" cy="{y}" r="{a / 2}"',
            f'circle cx="{x}%" cy="{y}%" r="{self.number(3, 9)}%"',
            f'ellipse cx="{x}" cy="{y}" rx="{a / 2}" ry="{b / 2}"',
            f'line x1="{x}" y1="{y}" x2="{x + a}" y2="{y - b}"',
            f'polyline points="{x},{y} {x + a},{y} {x + a} {y + b}"',
            f'polygon points="{x} {y}, {x + a} {y}, {x + a} {y + b}"',
            f'path d="M{x} {y}h{a}v{b}l-3-2z"',
            f'path d="M{x},{y}c2,-9 {a},9 {a},{b}s5 5-4,6q2 2 3-1t3 3"',
            f'path d="M{x} {y}a{a} {b} 20 1 0 7 6A{a} {a} 0 01{x + 9} {y}"',
            f'path d="M{x} {y}l5 5m3 0l5 2h4M{x - 9} {y}v{b}"',
        ]
        return self.random.choice(forms)

    def shape(self, geometry: str, style: str = "") -> str:
        """A shape with this name and geometry."""
        return f"<{geometry} {self.paint(style)}/>"

    def page(self, words: str) -> str:
        """A nested page with further attributes."""
        where = 'x="5" y="5" width="50" height="40" viewBox="0 0 70 60"'
        return f"<svg {where} {words}>{self.element()}</svg>"

    def define(self, tag: str, words: str) -> str:
        """The id of a new definition, a random shape in an element."""
        name = self.name("page" if tag == "svg" else tag)
        inner = self.element(layers=(name,))
        self.definitions.append(f'<{tag} id="{name}" {words}>{inner}</{tag}>')
        return name

    def transform(self) -> str:
        """A transform attribute."""
        parts = [
            f"translate({self.number(-9, 9)})",
            f"translate({self.number(-9, 9)},{self.number(-9, 9)})",
            f"rotate({self.number(-90, 90)})",
            f"rotate({self.number(-90, 90)} {self.number(10, 50)} {self.number(10, 50)})",
            f"scale({self.number(0.5, 1.5)})",
            f"scale({self.number(0.5, 1.5)} {self.number(-1.2, 1.2) or 1})",
            f"skewX({self.number(-20, 20)})",
            f"skewY({self.number(-20, 20)})",
            f"matrix(.9 .1 -.2 1.1 {self.number(-9, 9)} 3)",
        ]
        chosen = self.random.sample(parts, self.random.randint(1, 3))
        return f'transform="{" ".join(chosen)}"'

    def css_transform(self) -> str:
        """Functions of a transform property in CSS."""
        parts = [
            f"translate({self.number(-9, 9)}px, {self.number(-3, 3)}mm)",
            f"translate({self.number(-20, 20)}%, 5%)",
            f"translateX({self.number(-9, 9)}px)",
            f"translateY({self.number(-9, 9)}pt)",
            f"rotate({self.number(-90, 90)}deg)",
            f"rotate({self.number(-1, 1)}rad)",
            f"rotate({self.number(0.1, 0.4)}turn)",
            f"rotate({self.number(-90, 90)}grad)",
            f"scale({self.number(0.5, 1.5)})",
            f"scale({self.number(0.5, 1.5)}, {self.number(0.5, 1.5)})",
            f"scaleX({self.number(0.5, 1.5)})",
            f"scaleY({self.number(0.5, 1.5)})",
            f"skew({self.number(-20, 20)}deg, 5deg)",
            f"skewX({self.number(-20, 20)}deg)",
            "matrix(1, 0.1, 0, 1.2, 3, 4)",
        ]
        return " ".join(self.random.sample(parts, self.random.randint(1, 3)))

    def origin(self) -> str:
        """A value of transform-origin."""
        return self.pick(
            "35 25", "20px 30px", "center", "left top", "right", "bottom", "50% 20%", "10mm 50%",
            "top right", "0 0", "30px",
        )  # fmt: skip

    def origin_in_box(self) -> str:
        """A declaration of transform-origin for a box that a transform-box may name."""
        return f"transform-origin:{self.origin().replace('35 25', 'center')}"


# Fragments that need more than one expression. Each takes the writer and returns elements.


def _group(writer: Writer) -> str:
    inner = writer.element(writer.transform())
    tag = writer.pick("g", "a")
    return f"<g {writer.transform()}><{tag}>{inner}</{tag}>{writer.element()}</g>"


def _origin_attribute(writer: Writer) -> str:
    words = f'{writer.transform()} transform-origin="{writer.origin()}"'
    is_group = writer.number(0, 1) < 0.4
    return f"<g {words}>{writer.element()}</g>" if is_group else writer.element(words)


def _css_transform(writer: Writer) -> str:
    style = f"transform:{writer.css_transform()}"
    if writer.number(0, 1) < 0.4:
        return f'<g style="{style}">{writer.element()}</g>'
    return writer.element('transform="scale(3)"', style)


def _transform_box(writer: Writer) -> str:
    box = writer.pick("fill-box", "view-box", "content-box", "stroke-box", "border-box")
    style = f"transform:{writer.css_transform()};transform-box:{box}"
    return writer.element("", f"{style};{writer.origin_in_box()}")


def _single_transforms(writer: Writer) -> str:
    style = ";".join(
        [
            f"translate:{writer.pick('5px', '3px 2mm', '10% 5px', 'none')}",
            f"rotate:{writer.pick('30deg', '0.2turn', 'z 20deg', 'none')}",
            f"scale:{writer.pick('1.2', '0.8 1.1', '120%', 'none')}",
            writer.origin_in_box(),
        ]
    )
    return writer.element(writer.transform(), style)


def _rect_in_css(writer: Writer) -> str:
    width, height = writer.number(10, 30), writer.pick("4mm", "20%", "15px")
    style = f"x:20px;y:25%;width:{width}px;height:{height};rx:{writer.pick('2px', '1mm', 'auto')}"
    return writer.shape('rect x="1" y="1" width="5" height="5"', style)


def _geometry_in_sheet(writer: Writer) -> str:
    name = writer.name("geo")
    writer.rules.append(f".{name}{{r:{writer.number(4, 12)}px;cx:40px;cy:30px !important}}")
    return writer.shape(f'circle r="2" cy="3" class="{name}"')


def _switch(writer: Writer) -> str:
    first = writer.pick(
        'requiredExtensions="http://example.org/x"',
        'systemLanguage="de"',
        'requiredExtensions=""',
        "",
    )
    shapes = "".join(f"<g>{writer.element()}</g>" for _ in range(2))
    return f"<switch><g {first}>{writer.element()}</g>{shapes}</switch>"


def _nested_page(writer: Writer) -> str:
    overflow = writer.pick(
        "", "", 'overflow="visible"', 'style="overflow:visible"', 'overflow="auto"'
    )
    box = writer.pick(
        'viewBox="0 0 60 60"', 'viewBox="10 10 50 40" preserveAspectRatio="xMinYMax slice"', "",
        'viewBox="0 0 30 60" preserveAspectRatio="none"', 'viewBox=""', 'viewBox="0 0 9 bad"',
    )  # fmt: skip
    where = f'x="{writer.number(0, 20)}" y="10%" width="{writer.number(30, 50)}" height="40"'
    moved = writer.element(writer.transform())
    return f"<svg {where} {box} {overflow}>{writer.element()}<g>{moved}</g></svg>"


def _use(writer: Writer) -> str:
    name = writer.name("shape")
    writer.definitions.append(writer.element(f'id="{name}"', layers=(name,)))
    href = writer.pick("href", "xlink:href")
    moved = writer.pick(
        "", 'x="7" y="3"', writer.transform(),
        'x="3" style="transform:rotate(20deg);transform-origin:center"',
        'style="x:6px;y:2mm"', 'transform="scale(1.1)" transform-origin="20 20" y="4"',
    )  # fmt: skip
    return f'<use {href}="#{name}" {moved}/><use {href}="#{name}" x="15"/>'


def _use_of_group(writer: Writer) -> str:
    name = writer.name("group")
    inner = writer.element(layers=(name,))
    writer.definitions.append(f'<g id="{name}" {writer.transform()}>{inner}</g>')
    return f'<use href="#{name}" x="4"/>'


def _symbol(writer: Writer) -> str:
    words = writer.pick(
        'viewBox="0 0 60 60"', "", 'viewBox="0 0 60 50" preserveAspectRatio="xMaxYMin"',
        'viewBox="0 0 60 60" overflow="visible"', 'viewBox="0 0 60 60" x="4" y="5"',
        'viewBox="0 0 60 60" width="40" height="30"', 'viewBox="0 0 60 60" refX="5" refY="5"',
        'viewBox="0 0 60 60" transform="rotate(10)"',
    )  # fmt: skip
    name = writer.define("symbol", words)
    size = writer.pick('width="50" height="40"', "", 'width="30"', 'x="5" y="4" height="30"')
    return f'<use href="#{name}" {size}/>'


def _use_of_page(writer: Writer) -> str:
    name = writer.define("svg", 'width="40" height="30" viewBox="0 0 70 60"')
    size = writer.pick('width="60" height="50"', "", 'width="30"')
    return f'<use href="#{name}" {size} y="3"/>'


def _hidden(writer: Writer) -> str:
    words = writer.pick(
        'display="none"', 'visibility="hidden"', 'opacity="0"', 'style="display:none"'
    )
    inner = writer.element(writer.pick("", 'visibility="visible"', 'display="inline"'))
    return f"<g {words}>{inner}</g>{writer.element()}"


def _unpainted(writer: Writer) -> str:
    name, shape = writer.name("bare"), len(writer.layers)
    color = writer.color(name)
    words = writer.pick(
        f'fill="none" stroke="{color}" stroke-width="0"',
        f'fill="none" stroke="{color}" stroke-opacity="0"',
        'fill="rgba(1,2,3,0)"', 'fill="transparent"', 'fill="#12345600"', 'fill="url(#nowhere)"',
        f'fill="none" stroke="{color}" style="stroke:none"',
    )  # fmt: skip
    box = 'x="20" y="20" width="20" height="9"'
    return f'<rect id="{name}" {box} data-shape="{shape}" {words}/>'


def _inherited(writer: Writer) -> str:
    shape, color = len(writer.layers), writer.color()
    words = writer.pick("", 'fill="inherit"')
    inner = f'<{writer.geometry()} data-shape="{shape}" {words}/>'
    return f'<g fill="none" stroke="{color}">{inner}</g>'


def _initial(writer: Writer) -> str:
    style = writer.pick(
        "visibility:initial", "visibility:inherit", "visibility:unset", "transform:initial"
    )
    inner = writer.element('transform="scale(1.1)"', style)
    return f'<g visibility="hidden">{inner}</g>'


def _selectors(writer: Writer) -> str:
    name, other = writer.name("sel"), writer.name("id")
    action = writer.pick("display:none", "transform:translate(9px,4px)", "visibility:hidden")
    selector = writer.pick(
        f".{name}", f"g > .{name}", f"g .{name}:first-child", f".{name}[class]", f"#{other}",
        f"*.{name}#{other}", f".{name}:not(#{other})", f"[class='{name}']", f".none, .{name}",
        f"g:hover .{name}", f":is(.{name}, .x)",
    )  # fmt: skip
    writer.rules.append(f"{selector}{{{action}}}")
    inner = writer.element(f'class="{name}" id="{other}"')
    return f"<g>{inner}</g>"


def _cascade(writer: Writer) -> str:
    name, other = writer.name("cas"), writer.name("id")
    writer.rules.append(
        writer.pick(
            f"#{other}{{display:inline}} .{name}{{display:none}}",
            f".{name}{{display:none}} #{other}{{display:inline}}",
            f".{name}{{display:none !important}} #{other}{{display:inline}}",
            f".{name}{{visibility:hidden}} .{name}{{visibility:visible}}",
            f".{name}.{name}{{display:none}} .{name}{{display:inline}}",
        )
    )
    style = writer.pick("", "display:inline", "display:none", "visibility:visible")
    words = writer.pick("", 'display="none"', 'visibility="hidden"')
    return writer.element(f'class="{name}" id="{other}" {words}', style)


def _media(writer: Writer) -> str:
    name = writer.name("media")
    query = writer.pick("print", "screen", "all", "(min-width:1px)", "not print", "screen, print")
    writer.rules.append(f"@media {query}{{.{name}{{display:none}}}}")
    return writer.element(f'class="{name}"')


def _at_rules(writer: Writer) -> str:
    name = writer.name("at")
    rule = writer.pick(
        f"@supports (display:block){{.{name}{{display:none}}}}",
        f"@layer base{{.{name}{{display:none}}}}",
        f"g{{ .{name}{{display:none}} }}",
        f".{name}{{ &{{display:none}} }}",
        f"@font-face{{font-family:x;src:url(x.woff)}} .{name}{{display:none}}",
        f"/* .{name}{{display:none}} */",
        f".{name}{{display:none;;x:;:y}}",
        f".{name}{{--note:'}}';display:none}}",
    )
    writer.rules.append(rule)
    inner = writer.element(f'class="{name}"')
    return f"<g>{inner}</g>"


def _clip(writer: Writer) -> str:
    name = writer.name("clip")
    inner = writer.pick(
        '<rect x="10" y="10" width="30" height="30"/>', '<circle cx="30" cy="30" r="20"/>',
        '<path d="M0 0H60V70H0z"/>', '<rect width="999" height="999"/>',
        '<rect width="40" height="40" transform="rotate(20)"/>', "",
        '<rect width="9" height="9"/><rect x="20" width="30" height="60"/>',
    )  # fmt: skip
    units = writer.pick("", 'clipPathUnits="objectBoundingBox"')
    writer.definitions.append(f'<clipPath id="{name}" {units}>{inner}</clipPath>')
    words = writer.pick(f'clip-path="url(#{name})"', f'style="clip-path:url(#{name})"')
    return f"<g {words}>{writer.element()}</g>"


def _effects(writer: Writer) -> str:
    name = writer.name("effect")
    writer.definitions.append(
        f'<mask id="m{name}"><rect width="20" height="20" fill="white"/></mask>'
        f'<filter id="f{name}"><feOffset dx="5"/></filter>'
        f'<marker id="k{name}"><rect width="2" height="2"/></marker>'
        f'<pattern id="p{name}" width="4" height="4" patternUnits="userSpaceOnUse">'
        '<rect width="2" height="2"/></pattern>'
    )
    words = writer.pick(
        f'mask="url(#m{name})"', f'filter="url(#f{name})"', f'marker-end="url(#k{name})"'
    )
    shape, color = len(writer.layers), writer.color()
    paint = f'stroke="{color}" fill="url(#p{name})"'
    patterned = f'<rect x="9" y="9" width="30" height="20" data-shape="{shape}" {paint}/>'
    return writer.element(words) + patterned


def _moving(writer: Writer) -> str:
    inner = writer.pick(
        '<animate attributeName="opacity" from="0" to="1" dur="1s"/>',
        '<animateTransform attributeName="transform" type="scale" from="2" to="3" dur="1s"/>',
        '<set attributeName="display" to="none" begin="0s"/>',
        '<animateMotion path="M10 10h20" dur="2s"/>',
    )
    shape = f"<{writer.geometry()} {writer.paint()}>{inner}</"
    return f"{shape}{shape[1:].split(' ', 1)[0]}>"


def _harmless(writer: Writer) -> str:
    words = writer.pick(
        'pathLength="10" stroke-dasharray="1 1"', 'vector-effect="non-scaling-stroke"',
        'stroke-width="3"', 'fill-rule="evenodd"', 'paint-order="stroke"', 'role="img"',
        'tabindex="1"', 'cursor="help" pointer-events="none"', 'shape-rendering="crispEdges"',
    )  # fmt: skip
    return f"<title>t</title><desc>d</desc><metadata/>{writer.element(words)}"


def _unknown(writer: Writer) -> str:
    container = writer.pick("foo", "text", "foreignObject", "hatch", "clipPath", "marker", "font")
    return f"<{container}>{writer.element()}</{container}>"


#: Fragments by the name of the feature that they show.
FEATURES: dict[str, Callable[[Writer], str]] = {
    "plain": lambda writer: writer.element(),
    "transform attribute": lambda writer: writer.element(writer.transform()),
    "groups": _group,
    "transform-origin attribute": _origin_attribute,
    "transform-origin in CSS": lambda writer: writer.element(
        writer.transform(), f"transform-origin:{writer.origin()}"
    ),
    "transform in CSS": _css_transform,
    "transform none in CSS": lambda writer: writer.element(writer.transform(), "transform:none"),
    "transform-box": _transform_box,
    "transform-box of a group": lambda writer: (
        f'<g style="transform:{writer.css_transform()};transform-box:fill-box;'
        f'transform-origin:center">{writer.element()}{writer.element()}</g>'
    ),
    "translate, rotate, scale": _single_transforms,
    "transform in space": lambda writer: writer.element(
        style="transform:"
        + writer.pick("rotate3d(1,0,0,40deg)", "translateZ(3px)", "rotateY(30deg)")
    ),
    "damaged transform": lambda writer: writer.element(
        writer.pick('transform="turn(3)"', 'transform="rotate(30deg)"', 'transform="scale(2) x"')
    ),
    "damaged transform in CSS": lambda writer: writer.element(
        style="transform:"
        + writer.pick("rotate(30)", "translate(3, 4)", "turn(3deg)", "scale(2px)")
    ),
    "circle in CSS": lambda writer: writer.shape(
        'circle cx="9" r="3"',
        f"cx:{writer.number(20, 60)}px;cy:{writer.pick('9mm', '30%', '40px')};r:5%",
    ),
    "ellipse in CSS": lambda writer: writer.shape(
        'ellipse cx="40" cy="30"',
        f"rx:{writer.number(5, 15)}px;ry:{writer.pick('auto', '2mm', '10%')}",
    ),
    "rect in CSS": _rect_in_css,
    "path in CSS": lambda writer: writer.shape(
        'path d="M0 0h5"', f"d:path('M10 20h{writer.number(9, 30)}v9q3 3-4 5z')"
    ),
    "geometry in a sheet": _geometry_in_sheet,
    "calc and relative units": lambda writer: writer.shape(
        'circle cx="30" cy="30" r="7"',
        writer.pick("r:calc(2px + 5%)", "r:2em", "r:var(--radius)", "r:5vw", "cx:calc(9px*2)"),
    ),
    "negative sizes": lambda writer: writer.shape(
        writer.pick(
            'ellipse cx="40" cy="30" rx="-5" ry="10"',
            'rect x="20" y="20" width="20" height="10" rx="-2" ry="3"',
            'circle cx="40" cy="30" r="-4"',
            'rect x="20" y="20" width="-20" height="10"',
        )
    ),
    "empty and damaged values": lambda writer: writer.shape(
        writer.pick(
            'rect x="" y="20" width="20" height="10"',
            'rect x="20" y="20" width="20" height="10" rx=""',
            'circle cx="" cy="30" r="4"',
            'path d="M10 10h5" transform=""',
            'rect x="2o" y="20" width="20" height="10"',
            'polygon points="10,10 20,10 20,30 5"',
            'path d="M10 10h20v9l5 bad"',
        )
    ),
    "switch": _switch,
    "conditions": lambda writer: writer.element(
        writer.pick('systemLanguage="de"', 'requiredExtensions="x"', 'requiredFeatures="x"')
    ),
    "nested svg": _nested_page,
    "nested svg with a transform": lambda writer: writer.page(
        writer.pick(
            'transform="rotate(20)"', 'style="transform:scale(1.2);transform-origin:20px 10px"'
        )
    ),
    "nested svg sized in CSS": lambda writer: writer.page('style="width:60px;height:30px"'),
    "nested svg that clips": lambda writer: (
        '<svg x="10" y="10" width="20" height="20" viewBox="0 0 20 20">'
        + writer.shape('rect x="-5" y="5" width="50" height="10"')
        + "</svg>"
    ),
    "use": _use,
    "use of a group": _use_of_group,
    "symbol": _symbol,
    "use of an svg": _use_of_page,
    "hidden": _hidden,
    "display contents": lambda writer: (
        f'<g transform="translate(5 5)" style="display:contents">{writer.element()}</g>'
    ),
    "unpainted": _unpainted,
    "inherited paint": _inherited,
    "initial": _initial,
    "inherited geometry": lambda writer: (
        '<g style="r:9px">' + writer.shape('circle cx="30" cy="30" r="4"', "r:inherit") + "</g>"
    ),
    "selectors": _selectors,
    "cascade": _cascade,
    "media": _media,
    "at-rules": _at_rules,
    "clip-path": _clip,
    "mask, filter, marker": _effects,
    "animation": _moving,
    "animated group": lambda writer: (
        '<g><animateTransform attributeName="transform" type="scale" from="2" to="3" dur="1s"/>'
        f"{writer.element()}</g>"
    ),
    "offset-path": lambda writer: writer.element(
        style="offset-path:path('M5 5h20');offset-distance:50%"
    ),
    "without effect": _harmless,
    "unknown containers": _unknown,
    "other namespace": lambda writer: (
        f'<x:y xmlns:x="http://example.org/">{writer.element()}</x:y>'
    ),
    "text and images": lambda writer: (
        '<text x="5" y="9">a</text><image width="9" height="9" href="data:,"/>'
        f'<foreignObject width="5" height="5"/>{writer.element()}'
    ),
}


def draw(seed: int) -> Drawing:
    """The drawing of a seed."""
    writer = Writer(seed)
    names = list(FEATURES)
    chosen = [names[seed % len(names)]]
    chosen += [writer.random.choice(names) for _ in range(FRAGMENTS - 1)]
    page = writer.random.choice(list(PAGES))
    words, window = PAGES[page]
    fragments = []
    for writer.feature in chosen:
        fragments.append(FEATURES[writer.feature](writer))
    sheet = f"<style>{' '.join(writer.rules)}</style>".replace(" > ", " &gt; ").replace(
        "&{", "&amp;{"
    )
    lines = [
        f'<svg xmlns="{SVG}" xmlns:xlink="{XLINK}" {words}>',
        sheet,
        f"<defs>{''.join(writer.definitions)}</defs>",
        *fragments,
        "</svg>\n",
    ]
    return Drawing("\n".join(lines), page, window, writer.layers, writer.features)
