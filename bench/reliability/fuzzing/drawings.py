"""Nearly valid DXF and SVG."""

from __future__ import annotations

from html import escape
from itertools import chain

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import counts, encode, names, numbers, plain_numbers, rarely

# DXF: entities as lists of group codes with the kind of their values (`_VALUES`), or a colon and
# a text.

_POINT = "10n 20n 30p"
_VERTICES = "10n 20n 42n 10n 20n 10n 20n 42p"
_KNOTS = "40:0 40:0 40:0 40:0 40:1 40:1 40:1 40:1"
_EXTRUDED = "210:0 220:0 230:-1"
_ENTITIES = {
    "LINE": (f"{_POINT} 11n 21n 31p", f"{_POINT} 11n 21n 31n {_EXTRUDED}"),
    "CIRCLE": (f"{_POINT} 40n", f"{_POINT} 40n 210n 220n 230n"),
    "ARC": (f"{_POINT} 40n 50n 51n", f"{_POINT} 40n 50n 51n {_EXTRUDED}"),
    "ELLIPSE": (f"{_POINT} 11n 21n 31p 40n 41n 42n",),
    "LWPOLYLINE": (
        f"90c 70c {_VERTICES}",
        f"90c 70:1 43n 38n {_VERTICES}",
        f"90:3 70:1 40n 41n {_VERTICES}",
    ),
    "SPLINE": (
        f"70c 71:3 72:8 73:4 74:0 {_KNOTS} {_POINT} {_POINT} {_POINT} {_POINT}",
        f"70:4 71c 72c 73c {_KNOTS} 41n 41n 41n 41n {_POINT} {_POINT} {_POINT} {_POINT}",
        "70:8 71:3 74:3 11n 21n 31p 11n 21n 31p 11n 21n 31p",
    ),
    "POINT": (_POINT,),
    "TEXT": (f"{_POINT} 40n 1t 50n 72c 11n 21n 31p",),
    "MTEXT": (f"{_POINT} 40n 41n 71c 1t",),
    "INSERT": (
        f"2:a {_POINT} 41n 42n 43n 50n",
        f"2:b {_POINT} 70c 71c 44n 45n",
        f"2t {_POINT} 41n {_EXTRUDED}",
    ),
    "HATCH": (
        f"{_POINT} 2:SOLID 70:1 71:0 91:1 92:2 72:1 73:1 93:3 10n 20n 42n 10n 20n 42p 10n 20n 42p "
        "97:0 75:0 76:1 98:0",
        f"{_POINT} 2t 70c 71c 91c 92:1 93:2 72:1 10n 20n 11n 21n 72:2 10n 20n 40n 50n 51n 73c 97c "
        "75c 76c 98c",
        f"{_POINT} 2:X 70:0 71:0 91:1 92:1 93:1 72:3 10n 20n 11n 21n 40n 50n 51n 73:1 97:0 75:0 "
        "76:1 52n 41n 77c 78:1 53n 43n 44n 45n 46n 79c 49n 98:0",
    ),
    "SOLID": (f"{_POINT} 11n 21n 31p 12n 22n 32p 13n 23n 33p",),
    "3DFACE": (f"{_POINT} 11n 21n 31n 12n 22n 32n 13n 23n 33n 70c",),
    "RAY": (f"{_POINT} 11n 21n 31p",),
    "MLINE": (
        f"2:STANDARD 40n 70c 71c 72:2 73:1 {_POINT} 11n 21n 31p 12n 22n 32p 13n 23n 33p 74c 41n "
        "75:0",
    ),
    "LEADER": (f"76:2 {_POINT} {_POINT}",),
    "DIMENSION": (f"2:a {_POINT} 70c 13n 23n 14n 24n",),
    "HELIX": (f"71:3 72:8 73:4 {_KNOTS} {_POINT} {_POINT} {_POINT} {_POINT} 40n 41n 42n",),
    "MESH": ("71c 72c 91c 92c 10n 20n 30n 93c 90c 94:0 95:0",),
    "WIPEOUT": (f"{_POINT} 11n 21n 31p 12n 22n 32p 13n 23n 71:1 91:2 14n 24n 14n 24n",),
    "ACAD_PROXY_ENTITY": ("90:498 91c 70c",),
}
_POLYLINE = (
    "0:POLYLINE 8:0 66:1 70c 10:0 20:0 30p 0:VERTEX 8:0 10n 20n 30p 42n 0:VERTEX 8:0 10n 20n 42n "
    "70c 0:VERTEX 8:0 10n 20n 30n 0:SEQEND 8:0"
)
#: The subclass of an entity, which newer files name, if it is not the entity in title case.
_SUBCLASSES = {
    "ARC": "Circle",
    "LWPOLYLINE": "Polyline",
    "MTEXT": "MText",
    "INSERT": "BlockReference",
    "SOLID": "Trace",
    "3DFACE": "Face",
    "HELIX": "Spline",
    "MESH": "SubDMesh",
    "ACAD_PROXY_ENTITY": "ProxyEntity",
}
_LAYERS = (
    "0:SECTION 2:TABLES 0:TABLE 2:LAYER 70:1 0:LAYER 2t 70c 62n 6:CONTINUOUS 0:ENDTAB 0:ENDSEC"
)
#: The values of a template, by the letter after their group code.
_VALUES = {
    "n": numbers,
    "p": plain_numbers,
    "c": counts,
    "t": names,
    "u": st.sampled_from(("0", "1", "2", "4", "5", "6", "4", "4", "25", "-1", "x")),
    "v": st.sampled_from(("AC1009", "AC1015", "AC1024", "AC1032", "AC9999")),
}
_Pair = tuple[str, str]


def _fill(draw: st.DrawFn, template: str) -> list[_Pair]:
    """The group codes and values of a template."""
    pairs = []
    for word in template.split():
        code, colon, value = word.partition(":")
        if not colon:
            code, value = word[:-1], draw(_VALUES[word[-1]])
        pairs.append((code, value))
    return pairs


@st.composite
def _pairs(draw: st.DrawFn, template: str) -> list[_Pair]:
    """The pairs of a template, at times one dropped, doubled or of an odd code."""
    pairs = _fill(draw, template)
    if draw(rarely):
        place = draw(st.integers(0, len(pairs) - 1))
        pair = pairs[place]
        others = ([], [pair, pair], [("1071", "x"), pair], [("x", "0")])
        pairs[place : place + 1] = draw(st.sampled_from(others))
    return pairs


@st.composite
def _entity(draw: st.DrawFn) -> list[_Pair]:
    kind = draw(st.sampled_from((*_ENTITIES, "POLYLINE")))
    if kind == "POLYLINE":
        return draw(_pairs(_POLYLINE))
    body = draw(_pairs(draw(st.sampled_from(_ENTITIES[kind]))))
    if kind == "ARC":
        body.insert(4, ("100", "AcDbArc"))
    extra = [("62", draw(counts))] if draw(rarely) else []
    head = [("0", kind), ("100", "AcDbEntity"), ("8", draw(names) if draw(rarely) else "0"), *extra]
    return [*head, ("100", f"AcDb{_SUBCLASSES.get(kind, kind.title())}"), *body]


_entities = st.lists(_entity(), min_size=1, max_size=5)


@st.composite
def dxf(draw: st.DrawFn) -> bytes:
    """A drawing without handles: header, layers, blocks that may name each other, entities."""
    version = "9:$ACADVER 1v" if draw(st.booleans()) else ""
    header = f"0:SECTION 2:HEADER {version} 9:$INSUNITS 70u 9:$MEASUREMENT 70c 0:ENDSEC"
    pairs = _fill(draw, header)
    if draw(st.booleans()):
        pairs += _fill(draw, _LAYERS)
    pairs += _fill(draw, "0:SECTION 2:BLOCKS")
    for name in draw(st.sampled_from(("", "a", "ab", "ab"))):
        pairs += _fill(draw, f"0:BLOCK 8:0 2:{name} 70:0 10n 20:0 30:0")
        pairs += chain.from_iterable(draw(_entities))
        pairs += _fill(draw, "0:ENDBLK 8:0")
    pairs += _fill(draw, "0:ENDSEC 0:SECTION 2:ENTITIES")
    pairs += chain.from_iterable(draw(_entities))
    pairs += _fill(draw, "0:ENDSEC 0:EOF")
    return encode("".join(f"{code}\n{value}\n" for code, value in pairs))


# SVG: elements with their attributes.

_LENGTHS = st.builds(
    str.__add__,
    numbers,
    st.sampled_from(("",) * 4 + ("mm", "cm", "in", "px", "%", "pt", "em", "x")),
)
_SEPARATOR = st.sampled_from((" ", " ", ",", ", ", "", "\n"))
_PATH_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_ANGLES = {"skewX": 1, "skewY": 1, "rotate": 3, "turn": 1}
_TRANSFORM_COUNTS = {"translate": 2, "scale": 2, "matrix": 6} | _ANGLES
_FLAGS = ("0", "1", "0", "1", "2", "-1", "")


@st.composite
def _path(draw: st.DrawFn) -> str:
    text = "M" + draw(plain_numbers) + " " + draw(numbers)
    for letter in draw(st.lists(st.sampled_from("MLHVCSQTAZmlhvcsqtaz"), max_size=6)):
        count = _PATH_COUNTS[letter.upper()] + (draw(st.integers(-1, 2)) if draw(rarely) else 0)
        values = [draw(numbers) for _ in range(count)]
        if letter in "aA" and count > 4:
            values[3:5] = [draw(st.sampled_from(_FLAGS)) for _ in values[3:5]]
        text += letter + draw(_SEPARATOR).join(values)
    return text + (draw(names) if draw(rarely) else "")


@st.composite
def _transform(draw: st.DrawFn) -> str:
    parts = []
    for name in draw(st.lists(st.sampled_from(tuple(_TRANSFORM_COUNTS)), min_size=1, max_size=3)):
        count = _TRANSFORM_COUNTS[name] + (draw(st.integers(-1, 1)) if draw(rarely) else 0)
        parts.append(f"{name}({draw(_SEPARATOR).join(draw(numbers) for _ in range(count))})")
    return draw(_SEPARATOR).join(parts)


_POINTS = st.builds(" ".join, st.lists(numbers, max_size=7))
_IDS = st.sampled_from("abcd")
_COLOUR = st.sampled_from(
    ("none", "red", "#f00", "rgb(1,2,3)", "url(#a)", "", "#x", "currentColor", "inherit")
)
_STYLE = st.sampled_from(
    (
        *("fill:none", "display:none", "stroke:red;fill:none", "visibility:hidden", ";;:", "a"),
        *("stroke-width:1e400", "opacity:x", "transform:rotate(1deg) scale(x)"),
        "transform:translate(9px, 1e400px);transform-box:fill-box;transform-origin:center",
        *("translate:5px;rotate:x 3deg;scale:0", "r:calc(3px);cx:9px;width:1e999px"),
        *("d:path('M0 0h9a1 1 0 0 1 2 2')", "display:contents;overflow:visible"),
        "fill:url(#a) red;mask:url('#b');stroke:var(--x)",
        "visibility:inherit!important;opacity:unset",
    )
)
_REFERENCE = st.builds("#{}".format, _IDS) | st.sampled_from(("", "#", "a", "http://x/#a", "#root"))
_SHAPES: dict[str, dict[str, st.SearchStrategy[str]]] = {
    "path": {"d": _path()},
    "rect": dict.fromkeys(("x", "y", "width", "height", "rx", "ry"), _LENGTHS),
    "circle": dict.fromkeys(("cx", "cy", "r"), _LENGTHS),
    "ellipse": dict.fromkeys(("cx", "cy", "rx", "ry"), _LENGTHS),
    "line": dict.fromkeys(("x1", "y1", "x2", "y2"), _LENGTHS),
    "polyline": {"points": _POINTS},
    "polygon": {"points": _POINTS},
    "use": {"href": _REFERENCE, "x": _LENGTHS, "y": _LENGTHS, "width": _LENGTHS},
    "text": {"x": _LENGTHS},
    "image": {"href": _REFERENCE, "width": _LENGTHS},
}
_VIEW = st.builds(" ".join, st.lists(numbers, min_size=4, max_size=4)) | st.sampled_from(
    ("", "0 0", "0,0,10,10", "0 0 9 9")
)
_ASPECT = st.sampled_from(("none", "xMidYMid slice", "x"))
_BOXES: dict[str, dict[str, st.SearchStrategy[str]]] = {
    **{name: {} for name in ("g", "defs", "clipPath", "a", "switch", "mask", "metadata", "style")},
    "symbol": {"viewBox": _VIEW, "preserveAspectRatio": _ASPECT},
    "svg": {"viewBox": _VIEW} | dict.fromkeys(("width", "height", "x"), _LENGTHS),
    "marker": {"refX": _LENGTHS},
    "pattern": {"width": _LENGTHS},
}
_COMMON = {
    "transform": _transform(),
    "id": _IDS,
    "style": _STYLE,
    "stroke": _COLOUR,
    "fill": _COLOUR,
    "class": names,
    "display": st.just("none"),
    "stroke-width": _LENGTHS,
    "clip-path": st.just("url(#a)"),
    "inkscape:label": names,
}


def _write_attribute(key: str, value: str) -> str:
    return f' {key}="{escape(value)}"'.replace("\x00", "")


@st.composite
def _element(draw: st.DrawFn, depth: int = 0) -> str:
    is_box = depth < 3 and draw(st.integers(0, 2)) == 0
    table = _BOXES if is_box else _SHAPES
    tag = draw(st.sampled_from(tuple(table)))
    attributes = {key: draw(value) for key, value in table[tag].items() if not draw(rarely)}
    for key in draw(st.lists(st.sampled_from(tuple(_COMMON)), max_size=3, unique=True)):
        attributes[key] = draw(_COMMON[key])
    opening = tag + "".join(map(_write_attribute, attributes, attributes.values()))
    if not is_box:
        return f"<{opening}/>"
    inner = "".join(draw(st.lists(_element(depth + 1), max_size=3)))
    return f"<{opening}>{inner}</{tag}>"


@st.composite
def svg(draw: st.DrawFn) -> bytes:
    """A page of shapes, groups and uses."""
    length = _LENGTHS if draw(rarely) else st.sampled_from(("100mm", "200", "8in"))
    view = _VIEW if draw(rarely) else st.sampled_from(("0 0 100 80", "-5,3,10,10"))
    root = '<svg xmlns="http://www.w3.org/2000/svg" id="root"'
    root += ' xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    for key, values in (("width", length), ("height", length), ("viewBox", view)):
        if draw(st.booleans()):
            root += _write_attribute(key, draw(values))
    body = "".join(draw(st.lists(_element(), min_size=1, max_size=4)))
    return encode(f"{root}>{body}</svg>")
