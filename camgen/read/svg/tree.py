"""The walk through an SVG document: shapes with their matrices and layers, and counts of what is left out."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np
from msgspec import Struct, field

from camgen.model.errors import InputError
from camgen.model.limits import Limits, tell
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.read.colors import resolve_css
from camgen.read.dxf.layers import Layers
from camgen.read.svg.path import KINDS, Subpath, shape
from camgen.read.svg.values import Malformed, combine, fit_viewport, length, transform, view_box

# Whether the style of an element lets it be drawn: attributes, simple rules of style sheets, inheritance.

#: The properties looked at; those of the second group a child has from its parent.
_OWN = ("display", "opacity", "clip-path", "mask")
_INHERITED = (
    "visibility", "color", "stroke", "fill", "stroke-opacity", "fill-opacity", "stroke-dasharray",
    "marker", "marker-start", "marker-mid", "marker-end",
)  # fmt: skip
PROPERTIES = frozenset((*_OWN, *_INHERITED))
_RULE = re.compile(r"([^{}]*)\{([^{}]*)\}")
_COMMENT = re.compile(r"/\*.*?\*/", re.S)
#: An element, a class, an id, or an element with a class or an id.
_SELECTOR = re.compile(r"(?P<tag>[\w-]+|\*)?(?:\.(?P<cls>[\w-]+)|#(?P<id>[\w-]+))?")

Style = dict[str, str]


class StyleSheet(Struct):
    """Rules by what they select: (tag, class, id) to declarations. unknown: selectors that were not understood."""

    rules: dict[tuple[str, str, str], Style] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """The rules of a style sheet; of rules for the same elements the later one wins."""
        text = _COMMENT.sub(" ", text)
        for block in re.findall(r"@[\w-]+[^{};]*\{(?:[^{}]*\{[^{}]*\})*[^{}]*\}", text):
            self.unknown.append(block.split("{")[0].strip())
            text = text.replace(block, " ")
        for selectors, body in _RULE.findall(re.sub(r"@[\w-]+[^{};]*;", " ", text)):
            wanted = declarations(body)
            if wanted:
                for selector in selectors.split(","):
                    self._rule(selector.strip(), wanted)

    def _rule(self, selector: str, wanted: Style) -> None:
        match = _SELECTOR.fullmatch(selector)
        if match is None or not selector:
            self.unknown.append(selector)
            return
        tag = (match["tag"] or "").replace("*", "")
        self.rules.setdefault((tag, match["cls"] or "", match["id"] or ""), {}).update(wanted)

    def of(self, tag: str, attributes: Mapping[str, str]) -> Style:
        """What the sheet says about an element: ids win over classes, classes over elements."""
        if not self.rules:
            return {}
        classes = attributes.get("class", "").split()
        name = attributes.get("id", "")
        found: Style = {}
        keys = [
            ("", "", ""),
            (tag, "", ""),
            *(("", c, "") for c in classes),
            *((tag, c, "") for c in classes),
        ]
        for key in (*keys, ("", "", name), (tag, "", name)):
            found |= self.rules.get(key, {})
        return found


def declarations(text: str) -> Style:
    """The declarations that matter here, without ``!important``, in lower case."""
    found = {}
    for part in text.split(";"):
        name, colon, value = part.partition(":")
        name = name.strip().lower()
        if colon and name in PROPERTIES:
            found[name] = value.replace("!important", "").strip().lower()
    return found


def is_styled(parent: Style, tag: str, attributes: Mapping[str, str], sheet: StyleSheet) -> Style:
    """The style of an element: its attributes, then the sheet, then its style attribute, else its parent's."""
    own = {name: value.strip().lower() for name, value in attributes.items() if name in PROPERTIES}
    own |= sheet.of(tag, attributes)
    if "style" in attributes:
        own |= declarations(attributes["style"])
    result = {name: parent[name] for name in _INHERITED if name in parent}
    result |= {name: value for name, value in own.items() if value != "inherit"}
    return result


def is_gone(style: Style) -> str:
    """Why an element and all that it holds is not shown, "" where it is."""
    if style.get("display") == "none":
        return "display is none"
    return "opacity is 0" if _zero(style.get("opacity", "1")) else ""


def unseen(style: Style) -> str:
    """Why a shape is not shown, "" where it is."""
    if style.get("visibility") in ("hidden", "collapse"):
        return "visibility is hidden"
    return (
        ""
        if _paint(style, "stroke", "none") or _paint(style, "fill", "black")
        else "neither stroke nor fill"
    )


def _paint(style: Style, name: str, initial: str) -> str:
    """What stroke or fill is painted with, "" where it is not. initial: where nobody says it."""
    paint = style.get(name, initial)
    return (
        ""
        if paint in ("none", "transparent") or _zero(style.get(f"{name}-opacity", "1"))
        else paint
    )


def _color(style: Style) -> str:
    """The color of what is seen of a shape: its stroke, else its fill; "" for gradients, patterns and unknown names."""
    paint = _paint(style, "stroke", "none") or _paint(style, "fill", "black")
    if paint.startswith("url("):  # a gradient or a pattern, and what is painted where there is none
        paint = paint.partition(")")[2].strip()
    return resolve_css(style.get("color", "black") if paint == "currentcolor" else paint)


def _zero(text: str) -> bool:
    try:
        return float(text.rstrip("%")) <= 0
    except ValueError:
        return False


_SVG = "{http://www.w3.org/2000/svg}"
_INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
_HREF = ("href", "{http://www.w3.org/1999/xlink}href")
_GROUPS = frozenset({"g", "a", "switch", "svg"})
#: What only defines things, or says nothing about curves.
_SILENT = frozenset(
    {"defs", "symbol", "style", "title", "desc", "metadata", "script", "clipPath", "mask", "pattern", "marker", "view",
     "linearGradient", "radialGradient", "filter", "color-profile", "cursor", "font", "font-face"}
)  # fmt: skip
#: Properties that change what is seen and are not followed.
_EFFECTS = ("clip-path", "mask")
_MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")


class DrawnShape(Struct):
    """What the walk collects. One shape is tracks under a matrix, its tag, layer and color; ``left`` counts by reason,
    kind, layer.
    """

    layers: Layers
    tracks: list[tuple[Subpath, ...]] = field(default_factory=list)
    matrices: list[FloatArray] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    colors: list[str] = field(default_factory=list)
    left: dict[str, Counter[tuple[str, str]]] = field(default_factory=dict)
    effects: Counter[str] = field(default_factory=Counter)
    dashed: int = 0
    met: Counter[tuple[str, str]] = field(default_factory=Counter)

    def leave(self, why: str, kind: str, layer: str) -> None:
        """Counts one element that is not used."""
        self.left.setdefault(why, Counter())[kind, layer] += 1


class _Place(Struct, frozen=True):
    """Where the walk is. view: of the viewport, user units. inside: elements that refer to what is walked through.

    layered: an Inkscape layer named the layer. grouped: a group did.
    """

    matrix: FloatArray
    style: Style
    view: tuple[float, float]
    layer: str = ""
    layered: bool = False
    inside: frozenset[str] = frozenset()


def walk(
    file: str,
    root: Element,
    matrix: FloatArray,
    view: tuple[float, float],
    layers: Layers,
    limits: Limits,
) -> DrawnShape:
    """All shapes below ``root``. matrix: (2, 3), mm of its user units. InputError for a document that never ends."""
    drawn = DrawnShape(layers)
    sheet = StyleSheet()
    ids: dict[str, Element] = {}
    for element in root.iter():
        if "id" in element.attrib:
            ids.setdefault(element.attrib["id"], element)
        if element.tag == _SVG + "style":
            sheet.add("".join(element.itertext()))
    place = _Place(matrix, is_styled({}, "svg", root.attrib, sheet), view)
    walker = _Walk(file, drawn, sheet, ids, limits.svg_depth)
    # Depth first by a list: documents nest deeper than Python calls.
    todo = [(child, place) for child in reversed(root)] if not is_gone(place.style) else []
    steps = uses = 0
    while todo:
        element, place = todo.pop()
        todo += reversed(list(walker.step(element, place)))
        steps += 1
        uses += bool(place.inside)
        if uses > limits.svg_uses:
            what = f"more than {tell(limits.svg_uses)} elements come of its references"
            raise InputError(
                file, what, remedy="draw the shapes themselves, or raise limits.svg_uses"
            )
        if steps + len(todo) > limits.svg_elements:
            what = f"has more than {tell(limits.svg_elements)} elements"
            raise InputError(file, what, remedy="split the drawing, or raise limits.svg_elements")
    for selector in sheet.unknown:
        drawn.leave(
            "rules of the style sheet for other than elements, classes and ids",
            harmless(selector, 40),
            "",
        )
    return drawn


class _Walk(Struct):
    """What every step needs. deepest: references within each other."""

    file: str
    drawn: DrawnShape
    sheet: StyleSheet
    ids: dict[str, Element]
    deepest: float

    def step(self, element: Element, place: _Place) -> Iterator[tuple[Element, _Place]]:
        """Draws ``element``, or gives what is inside it with the place there."""
        if not isinstance(element.tag, str) or not element.tag.startswith(_SVG):
            return
        tag = element.tag.removeprefix(_SVG)
        if tag in _SILENT:
            return
        style = is_styled(place.style, tag, element.attrib, self.sheet)
        layer = place.layer or harmless(_own_layer(style))
        why = is_gone(style)
        if why:
            for inner in element.iter():
                kind = str(inner.tag).removeprefix(_SVG)
                if kind in KINDS or kind == "use":
                    self.drawn.leave(why, kind, layer)
            return
        for effect in _EFFECTS:
            self.drawn.effects[effect] += style.get(effect, "none") != "none"
        try:
            yield from self._inside(element, tag, place, style, layer)
        except Malformed as error:
            self.drawn.leave(str(error), tag, layer)

    def _inside(
        self, element: Element, tag: str, place: _Place, style: Style, layer: str
    ) -> Iterator[tuple[Element, _Place]]:
        matrix = place.matrix
        if "transform" in element.attrib:
            matrix = combine(matrix, transform(element.attrib["transform"]))
        here = _Place(matrix, style, place.view, place.layer, place.layered, place.inside)
        if tag in KINDS:
            self._draw(element, tag, here, layer)
        elif tag == "use":
            yield from self._use(element, here, layer)
        elif tag in _GROUPS:
            if tag == "svg":
                here = _viewport(element, here, element.attrib)
            here = _group(element, tag, here)
            yield from ((child, here) for child in element)
        elif tag in ("text", "image", "foreignObject"):
            self.drawn.leave("only shapes and paths are drawn", tag, layer)
        elif tag.startswith(("animate", "set")):
            self.drawn.leave("what moves is drawn where it begins", tag, layer)
        else:
            self.drawn.leave("not an element of SVG that camgen knows", harmless(tag, 40), layer)

    def _draw(self, element: Element, tag: str, place: _Place, layer: str) -> None:
        drawn = self.drawn
        drawn.met[tag, layer] += 1
        for child in element:
            if str(child.tag).removeprefix(_SVG).startswith(("animate", "set")):
                drawn.leave(
                    "what moves is drawn where it begins", str(child.tag).removeprefix(_SVG), layer
                )
        asked = drawn.layers.why_not(layer)
        why = unseen(place.style) or asked
        if why:
            drawn.leave(why, tag, layer)
            return
        tracks, fault = shape(tag, element.attrib, place.view)
        if fault:
            drawn.leave(f"{fault}: drawn up to there", tag, layer)
        if tracks:
            drawn.effects["markers"] += any(
                place.style.get(name, "none") != "none" for name in _MARKERS
            )
            drawn.dashed += place.style.get("stroke-dasharray", "none") != "none"
            drawn.tracks.append(tuple(tracks))
            drawn.matrices.append(place.matrix)
            drawn.kinds.append(tag)
            drawn.names.append(layer)
            drawn.colors.append(_color(place.style))

    def _use(self, element: Element, place: _Place, layer: str) -> Iterator[tuple[Element, _Place]]:
        name = next((element.attrib[key] for key in _HREF if key in element.attrib), "")
        target = self.ids.get(name.removeprefix("#")) if name.startswith("#") else None
        if target is None:
            raise Malformed("refers to nothing in this file")
        if name in place.inside:
            raise Malformed("refers to itself")
        if len(place.inside) > self.deepest:
            what = f"references stand more than {tell(self.deepest)} deep within each other"
            raise InputError(
                self.file, what, remedy="draw the shapes themselves, or raise limits.svg_depth"
            )
        x, y = (length(element.attrib.get(key, "0"), key, place.view) for key in ("x", "y"))
        matrix = combine(place.matrix, np.array([[1.0, 0.0, x], [0.0, 1.0, y]]))
        inside = place.inside | {name}
        here = _Place(matrix, place.style, place.view, place.layer, place.layered, inside)
        if target.tag in (_SVG + "symbol", _SVG + "svg"):
            size = {
                **target.attrib,
                **{k: v for k, v in element.attrib.items() if k in ("width", "height")},
            }
            style = is_styled(place.style, "symbol", target.attrib, self.sheet)
            if is_gone(style):
                self.drawn.leave(is_gone(style), "use", layer)
                return
            here = _viewport(target, _with_style(here, style), size)
            yield from ((child, here) for child in target)
        else:
            yield target, here


def _with_style(place: _Place, style: Style) -> _Place:
    return _Place(place.matrix, style, place.view, place.layer, place.layered, place.inside)


def _viewport(element: Element, place: _Place, size: dict[str, str]) -> _Place:
    """The place inside a nested svg or a symbol: its box laid into its width and height (section 7.9)."""
    box = view_box(element.attrib.get("viewBox"))
    width, height = (length(size.get(key, "100%"), key, place.view) for key in ("width", "height"))
    matrix = place.matrix
    if element.tag == _SVG + "svg":
        x, y = (length(element.attrib.get(key, "0"), key, place.view) for key in ("x", "y"))
        matrix = combine(matrix, np.array([[1.0, 0.0, x], [0.0, 1.0, y]]))
    view = (width, height)
    if box is not None:
        if width <= 0 or height <= 0:
            raise Malformed("a viewport without size")
        matrix = combine(
            matrix, fit_viewport(box, width, height, element.attrib.get("preserveAspectRatio", ""))
        )
        view = (box.width, box.height)
    return _Place(matrix, place.style, view, place.layer, place.layered, place.inside)


def _group(element: Element, tag: str, place: _Place) -> _Place:
    """The place inside a group, which may name the layer: the innermost Inkscape layer, else the outermost group."""
    if tag != "g":
        return place
    name, layered = place.layer, place.layered
    if element.attrib.get(_INKSCAPE + "groupmode") == "layer":
        name, layered = (
            element.attrib.get(_INKSCAPE + "label") or element.attrib.get("id", "layer"),
            True,
        )
    elif not name:
        name = element.attrib.get("id", "")
    return _Place(place.matrix, place.style, place.view, name, layered, place.inside)


def _own_layer(style: Style) -> str:
    """Without a group the colour of the stroke is the layer, else that of the fill: what a plotter has pens for."""
    stroke, fill = style.get("stroke", "none"), style.get("fill", "black")
    return next((colour for colour in (stroke, fill) if colour not in ("none", "")), "0")
