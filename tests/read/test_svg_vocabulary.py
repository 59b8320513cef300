"""The words of SVG 2: each is read, reported, or draws nothing for a reason."""

from pathlib import Path

import numpy as np
import pytest

from camgen.model.part import Part
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.read.svg.path import KINDS
from camgen.read.svg.vocabulary import (
    ANIMATIONS,
    EFFECTS,
    GROUPS,
    PAGE_LIMITS,
    PROPERTIES,
    READ_ATTRIBUTES,
    REPORTED_ATTRIBUTES,
    REPORTED_ELEMENTS,
    SILENT_ATTRIBUTES,
    SILENT_ELEMENTS,
    SILENT_PROPERTIES,
    UNREAD,
)


def list_names(text: str) -> list[str]:
    return text.split()


#: The element index of SVG 2, with the elements of filters and those of SVG 1.1 that it lacks.
ELEMENTS = list_names("""
a animate animateMotion animateTransform audio canvas circle clipPath defs desc discard ellipse
feBlend feColorMatrix feComponentTransfer feComposite feConvolveMatrix feDiffuseLighting
feDisplacementMap feDistantLight feDropShadow feFlood feFuncA feFuncB feFuncG feFuncR
feGaussianBlur feImage feMerge feMergeNode feMorphology feOffset fePointLight feSpecularLighting
feSpotLight feTile feTurbulence filter foreignObject g iframe image line linearGradient marker
mask metadata mpath path pattern polygon polyline radialGradient rect script set stop style svg
switch symbol text textPath title tspan unknown use video view
altGlyph altGlyphDef altGlyphItem animateColor color-profile cursor font font-face font-face-src
glyph glyphRef hkern missing-glyph tref vkern hatch hatchpath mesh meshgradient solidcolor
""")
#: The index of regular attributes of SVG 2, with requiredFeatures and version of SVG 1.1.
ATTRIBUTES = list_names("""
accumulate additive amplitude attributeName azimuth baseFrequency begin bias by calcMode class
clipPathUnits crossorigin cx cy d diffuseConstant divisor download dur dx dy edgeMode elevation end
exponent fill filterUnits fr from fx fy gradientTransform gradientUnits height href hreflang id in
in2 intercept k1 k2 k3 k4 kernelMatrix kernelUnitLength keyPoints keySplines keyTimes lang
lengthAdjust limitingConeAngle markerHeight markerUnits markerWidth maskContentUnits maskUnits max
media method min mode numOctaves offset onbegin onend onload onrepeat operator order orient origin
path pathLength patternContentUnits patternTransform patternUnits ping playbackorder points
pointsAtX pointsAtY pointsAtZ preserveAlpha preserveAspectRatio primitiveUnits r radius
referrerpolicy refX refY rel repeatCount repeatDur requiredExtensions requiredFeatures restart
result role rotate rx ry scale seed side slope spacing specularConstant specularExponent
spreadMethod startOffset stdDeviation stitchTiles style surfaceScale systemLanguage tabindex
tableValues target targetX targetY textLength timelinebegin title to transform type values version
viewBox width x x1 x2 xChannelSelector xlink:href xlink:title xml:lang xml:space y y1 y2
yChannelSelector z zoomAndPan
""")
#: The property index of SVG 2, with the properties of CSS that move, cut or animate a shape.
WORDS_OF_CSS = list_names("""
alignment-baseline baseline-shift clip-path clip-rule color color-interpolation
color-interpolation-filters color-rendering cursor cx cy d direction display dominant-baseline fill
fill-opacity fill-rule filter flood-color flood-opacity font font-family font-feature-settings
font-kerning font-size font-size-adjust font-stretch font-style font-variant font-weight
glyph-orientation-vertical height image-rendering inline-size isolation letter-spacing
lighting-color line-height marker marker-end marker-mid marker-start mask mask-border mask-image
mask-type mix-blend-mode opacity overflow overflow-x overflow-y paint-order pointer-events r rx ry
shape-image-threshold shape-inside shape-margin shape-padding shape-rendering shape-subtract
solid-color solid-opacity stop-color stop-opacity stroke stroke-dasharray stroke-dashoffset
stroke-linecap stroke-linejoin stroke-miterlimit stroke-opacity stroke-width tab-size text-align
text-anchor text-decoration text-decoration-color text-decoration-line text-decoration-style
text-indent text-orientation text-overflow text-rendering transform transform-box transform-origin
unicode-bidi vector-effect vertical-align visibility white-space width will-change word-spacing
writing-mode x y
all animation animation-name backface-visibility clip content-visibility offset offset-path
perspective rotate scale transform-style transition translate zoom
""")
PAGE = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'width="100mm" height="100mm" viewBox="0 0 100 100">'
)
CONTROL = '<path id="control" d="M1 1h9"/>'


def drawn(folder: Path, body: str) -> Part:
    path = folder / "part.svg"
    path.write_text(f"{PAGE}{CONTROL}{body}</svg>")
    return read(path, from_mapping({}))


def losses(part: Part) -> str:
    return "\n".join(str(note) for note in part.notes if note.kind == "skipped")


@pytest.mark.parametrize("name", ELEMENTS)
def test_each_element_is_read_reported_or_draws_nothing(tmp_path: Path, name: str) -> None:
    shape = '<rect x="20" y="20" width="9" height="9"/>'
    words = 'd="M5 5h9" points="5,5 9,9" x2="9" r="3" rx="3" width="50" height="50"'
    content = shape if name not in KINDS else ""
    part = drawn(tmp_path, f'<{name} {words} href="#control" x="3" y="3">{content}</{name}>')
    is_read = name in KINDS | GROUPS | {"use"}
    assert (len(part.contours) == 2) == is_read
    if is_read:
        assert not losses(part)
    elif name in SILENT_ELEMENTS:
        assert SILENT_ELEMENTS[name]
    else:
        assert name in losses(part)


def test_elements_stand_in_a_table_once() -> None:
    tables = (KINDS, GROUPS, ANIMATIONS, REPORTED_ELEMENTS.keys(), SILENT_ELEMENTS.keys())
    assert sum(map(len, tables)) == len(set().union(*tables))
    assert set().union(*tables) <= {*ELEMENTS}


@pytest.mark.parametrize("name", ATTRIBUTES)
def test_each_attribute_is_read_reported_or_draws_nothing(tmp_path: Path, name: str) -> None:
    tables = (READ_ATTRIBUTES, REPORTED_ATTRIBUTES, SILENT_ATTRIBUTES)
    assert sum(name in table for table in tables) == 1
    if name in READ_ATTRIBUTES:
        return
    body = f'<g {name}="3"><path d="M5 20h9"/></g>' if name != "fill" else '<path d="M5 20h9"/>'
    part = drawn(tmp_path, body)
    if name in REPORTED_ATTRIBUTES:
        assert REPORTED_ATTRIBUTES[name] in losses(part)
    else:
        assert len(part.contours) == 2
        assert SILENT_ATTRIBUTES[name]


#: Attributes that are read, each in two elements that differ by it alone.
READ = [
    ("class", "<style>.a{{display:none}}</style><path class='{}' d='M5 20h9'/>", "a", "b"),
    ("cx", '<circle cx="{}" cy="20" r="3"/>', "20", "30"),
    ("cy", '<circle cx="20" cy="{}" r="3"/>', "20", "30"),
    ("r", '<circle cx="20" cy="20" r="{}"/>', "2", "3"),
    ("rx", '<ellipse cx="20" cy="20" rx="{}" ry="4"/>', "2", "3"),
    ("ry", '<rect x="9" y="9" width="9" height="9" rx="2" ry="{}"/>', "2", "3"),
    ("d", '<path d="{}"/>', "M5 20h9", "M5 20h8"),
    ("points", '<polyline points="{}"/>', "5,20 9,9", "5,20 9,8"),
    ("x1", '<line x1="{}" x2="50" y2="9"/>', "5", "6"),
    ("x2", '<line x2="{}" y2="9"/>', "5", "6"),
    ("y1", '<line y1="{}" x2="50" y2="9"/>', "5", "6"),
    ("y2", '<line x2="5" y2="{}"/>', "5", "6"),
    ("x", '<rect x="{}" y="20" width="9" height="9"/>', "20", "30"),
    ("y", '<rect x="20" y="{}" width="9" height="9"/>', "20", "30"),
    ("width", '<rect x="20" y="20" width="{}" height="9"/>', "20", "30"),
    ("height", '<rect x="20" y="20" width="9" height="{}"/>', "20", "30"),
    ("href", '<use href="#{}" y="9"/>', "control", "other"),
    ("xlink:href", '<use xlink:href="#{}" y="9"/>', "control", "other"),
    ("id", '<defs><path id="{}" d="M5 20h9"/></defs><use href="#a"/>', "a", "b"),
    ("style", '<path style="{}" d="M5 20h9"/>', "opacity:0", "opacity:1"),
    ("transform", '<path transform="{}" d="M5 20h9"/>', "scale(2)", "scale(3)"),
    ("media", '<style media="{}">path{{opacity:0}}</style><path d="M5 9h9"/>', "print", "screen"),
    ("type", '<style type="{}">path{{opacity:0}}</style><path d="M5 9h9"/>', "text/css", "x"),
    ("viewBox", '<svg viewBox="{}"><path d="M1 2h2"/></svg>', "0 0 9 9", "0 0 4 4"),
    (
        "preserveAspectRatio",
        '<svg width="9" height="9" viewBox="0 0 9 3" preserveAspectRatio="{}">'
        '<path d="M1 2h2"/></svg>',
        "xMidYMin",
        "xMidYMax",
    ),
    (
        "clipPathUnits",
        '<clipPath id="c" clipPathUnits="{}"><path d="M0 0H3V30H0z"/></clipPath>'
        '<path clip-path="url(#c)" stroke="red" d="M1 20h9"/>',
        "userSpaceOnUse",
        "objectBoundingBox",
    ),
    ("requiredExtensions", '<path {}="x" d="M5 20h9"/>', "requiredExtensions", "class"),
    ("systemLanguage", '<path {}="x" d="M5 20h9"/>', "systemLanguage", "class"),
]  # fmt: skip


def test_each_attribute_that_is_read_has_an_example() -> None:
    assert sorted(name for name, *_ in READ) == sorted(READ_ATTRIBUTES)


@pytest.mark.parametrize(("name", "body", "first", "second"), READ, ids=[r[0] for r in READ])
def test_an_attribute_that_is_read_changes_the_drawing(
    tmp_path: Path, name: str, body: str, first: str, second: str
) -> None:
    results = []
    for value in (first, second):
        path = tmp_path / f"{name.replace(':', '-')}.svg"
        path.write_text(f"{PAGE}<rect width='1' height='1' style='opacity:1'/>{CONTROL}"
                        f"{body.format(value)}</svg>")  # fmt: skip
        contours = read(path, from_mapping({})).contours
        results.append([contour.points.tolist() for contour in contours])
    assert results[0] != results[1]


@pytest.mark.parametrize("name", WORDS_OF_CSS)
def test_each_property_is_read_reported_or_draws_nothing(tmp_path: Path, name: str) -> None:
    assert (name in PROPERTIES) != (name in SILENT_PROPERTIES)
    body = '<path style="{}:{}" stroke="red" d="M5 20h9"/>'
    plain = drawn(tmp_path, body.format("color", "red"))
    part = drawn(tmp_path, body.format(name, "3"))
    same = len(part.contours) == len(plain.contours) and all(
        np.array_equal(a.points, b.points)
        for a, b in zip(part.contours, plain.contours, strict=True)
    )
    if name in SILENT_PROPERTIES:
        assert same
        assert not losses(part)
        assert SILENT_PROPERTIES[name]
    elif name in EFFECTS or name == "marker":
        assert same
        assert "is not followed: drawn without it" in losses(part)
    elif name in UNREAD:
        assert len(part.contours) == 1
        assert f"{name} 3 is not read" in losses(part)


def test_properties_stand_in_a_table_once() -> None:
    assert not PROPERTIES & SILENT_PROPERTIES.keys()
    assert {*PROPERTIES} <= {*WORDS_OF_CSS, "mask-border-source", *PAGE_LIMITS}
