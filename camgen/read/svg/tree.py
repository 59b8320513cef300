"""The walk through an SVG document: shapes with their matrices, and reports of the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from xml.etree.ElementTree import Element

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.read.layers import Layers
from camgen.read.svg.clip import HalfPlanes, join_half_planes, make_half_planes
from camgen.read.svg.path import KINDS, SHAPES, Subpath, list_corners, measure_bounds
from camgen.read.svg.style import (
    CONDITION,
    Paint,
    Painter,
    Style,
    StyleSheet,
    find_reference,
    is_gone,
    select_inherited,
)
from camgen.read.svg.transforms import find_matrix
from camgen.read.svg.values import Malformed, ViewBox, combine, fit_viewport, length, view_box
from camgen.read.svg.vocabulary import (
    ANIMATIONS,
    EFFECTS,
    GEOMETRY,
    GROUPS,
    REPORTED_ATTRIBUTES,
    REPORTED_ELEMENTS,
    SILENT_ELEMENTS,
    UNREAD,
)

SVG = "{http://www.w3.org/2000/svg}"
_INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
_HREF = ("href", "{http://www.w3.org/1999/xlink}href")
_MOVED = "its animation is not followed: drawn without it"
_CLIPPED = "its clip-path is not followed: drawn without it"
#: Elements with a style sheet: a browser takes that of a web page too.
_STYLES = (SVG + "style", "{http://www.w3.org/1999/xhtml}style")
#: Attributes that move a reference.
_PLACES = frozenset({"x", "y", "transform", "clip-path", "class"})
#: Reason for the children of a switch that are not drawn.
SWITCHED = "another child of its switch is drawn"
#: Attributes and properties that are tested on each element; most elements have none of them.
_RARE_PROPERTIES = frozenset({*EFFECTS, *UNREAD, "clip-path"})
_RARE_ATTRIBUTES = frozenset({*REPORTED_ATTRIBUTES, "requiredExtensions", "systemLanguage"})


class DrawnShape(Struct):
    """A shape that is drawn.

    subpaths: its runs, in user units.
    matrix: (2, 3), mm in the work frame of the user units.
    kind: name of its element.
    layer: name of its layer.
    paint: its paint.
    name: its id, empty without one.
    clip: edges that cut it, None without any.
    """

    subpaths: tuple[Subpath, ...]
    matrix: FloatArray
    kind: str
    layer: str
    paint: Paint
    name: str
    clip: HalfPlanes | None


class Drawing(Struct):
    """The results of the walk.

    layers: states of the layers.
    shapes: drawn shapes, the lowest first.
    reports: reasons with the number of elements by kind and layer.
    ids: ids of the first elements of each reason.
    dashed: number of shapes with dashes.
    met: number of shapes by kind and layer, drawn or not.
    """

    layers: Layers
    shapes: list[DrawnShape] = field(default_factory=list)
    reports: dict[str, Counter[tuple[str, str]]] = field(default_factory=dict)
    ids: dict[str, list[str]] = field(default_factory=dict)
    dashed: int = 0
    met: Counter[tuple[str, str]] = field(default_factory=Counter)

    def report(self, reason: str, kind: str, layer: str, name: str = "") -> None:
        """Counts an element that is not drawn, or is drawn without what the reason states."""
        self.reports.setdefault(reason, Counter())[kind, layer] += 1
        if name:
            self.ids.setdefault(reason, []).append(name)


class _Place(Struct, frozen=True):
    """The place of an element in the document.

    matrix: (2, 3), mm of user units.
    style: style of its parent.
    inherited: part of that style which children have.
    view: width and height of the viewport, user units.
    layer: name of the layer that groups around it give; empty without any.
    inside: references within which it is drawn.
    clip: edges of the viewports and clip paths around it.
    effects: reasons for which shapes in it are reported and drawn.
    """

    matrix: FloatArray
    style: Style
    inherited: Style
    view: tuple[float, float]
    layer: str = ""
    inside: frozenset[str] = frozenset()
    clip: HalfPlanes | None = None
    effects: frozenset[str] = frozenset()


class Document:
    """A document before the walk.

    root: outermost element.
    ids: elements by id.
    sheet: rules of all style elements.
    moved: ids of elements that animations elsewhere refer to.
    style: style of the outermost element.
    painter: finds the paints of shapes.
    """

    def __init__(self, root: Element) -> None:
        self.root = root
        self.sheet = StyleSheet(root)
        self.ids: dict[str, Element] = {}
        self.moved: set[str] = set()
        for element in root.iter():
            if "id" in element.attrib:
                self.ids.setdefault(element.attrib["id"], element)
            if element.tag in _STYLES:
                self.sheet.add(element)
            elif _name(element) in ANIMATIONS:
                self.moved.add(_reference(element))
        self.style = self.sheet.compute_style({}, {}, root)
        self.painter = Painter(self.ids)


def walk(
    file: str,
    document: Document,
    matrix: FloatArray,
    view: tuple[float, float],
    layers: Layers,
    limits: Limits,
) -> Drawing:
    """Finds all shapes of a document.

    matrix: (2, 3), mm of the user units of its outermost element.
    view: width and height of its viewport, user units.
    Raises InputError for a document that never ends.
    """
    drawing = Drawing(layers)
    walker = _Walker(file, drawing, document, limits.svg_depth)
    # Depth first by a list: documents nest deeper than Python calls.
    pending = list(walker.enter_root(matrix, view))[::-1]
    steps = uses = 0
    while pending:
        element, place = pending.pop()
        pending += reversed(list(walker.step(element, place)))
        steps += 1
        uses += bool(place.inside)
        if uses > limits.svg_uses:
            raise InputError(
                file,
                f"its references draw more than {format_limit(limits.svg_uses)} elements",
                remedy="draw the shapes themselves, or raise limits.svg_uses",
            )
        if steps + len(pending) > limits.svg_elements:
            raise InputError(
                file,
                f"has more than {format_limit(limits.svg_elements)} elements",
                remedy="split the drawing, or raise limits.svg_elements",
            )
    for selector in document.sheet.unread:
        drawing.report("rules of the style sheet that are not read", harmless(selector, 40), "")
    return drawing


class _Walker(Struct):
    """The state of all steps.

    deepest: number of references within each other that are allowed.
    reported: shapes by kind and layer in each element that is left out, with layer and reason.
    """

    file: str
    drawing: Drawing
    document: Document
    deepest: float
    reported: dict[tuple[Element, str, str], Counter[tuple[str, str]]] = field(default_factory=dict)

    def enter_root(
        self, matrix: FloatArray, view: tuple[float, float]
    ) -> Iterator[tuple[Element, _Place]]:
        """The children of the outermost element."""
        document = self.document
        root, style = document.root, document.style
        place = _Place(matrix, {}, {}, view)
        try:
            _check_readable(root, style)
            reason = is_gone(style) or _condition(root)
        except Malformed as error:
            reason = str(error)
        if reason:
            self._report_all(reason, root, place)
            return
        inner = self._place_inside(root, place, style, matrix)
        yield from ((child, inner) for child in root)

    def step(self, element: Element, place: _Place) -> Iterator[tuple[Element, _Place]]:
        """Draws an element, or gives its children with their place."""
        tag = _name(element)
        if tag in SILENT_ELEMENTS or not isinstance(element.tag, str):
            return
        if not tag:
            self._report_all("within an element that is not of SVG", element, place)
            return
        style = self.document.sheet.compute_style(place.style, place.inherited, element)
        reason = is_gone(style) or _condition(element)
        if reason:
            self._report_all(reason, element, place)
            return
        try:
            yield from self._enter(element, tag, place, style)
        except Malformed as error:
            self._report_all(str(error), element, place)

    def _enter(
        self, element: Element, tag: str, place: _Place, style: Style
    ) -> Iterator[tuple[Element, _Place]]:
        if tag in ANIMATIONS:
            self.drawing.report(_MOVED, tag, self._layer(place, style))
        elif tag in KINDS:
            self._draw(element, tag, place, style)
        elif tag in GROUPS or tag == "use":
            _check_readable(element, style)
            matrix = self._matrix(element, place, style, None)
            inner = self._place_inside(element, place, style, matrix)
            if tag == "use":
                yield from self._use(element, inner)
                return
            if tag == "svg":
                inner = _viewport(element, inner, element.attrib, style)
            yield from ((child, inner) for child in self._choose(element, tag, inner))
        else:
            unknown = "not an element of SVG that camgen knows"
            self._report_all(REPORTED_ELEMENTS.get(tag, unknown), element, place)

    def _matrix(
        self, element: Element, place: _Place, style: Style, subpaths: list[Subpath] | None
    ) -> FloatArray:
        """The matrix in an element.

        subpaths: subpaths of a shape; None for a group.
        """

        def measure() -> ViewBox:
            if subpaths is None:
                raise Malformed("transform-box of an element with children is not read")
            return measure_bounds(subpaths)

        box = ViewBox(0.0, 0.0, *place.view)
        matrix = find_matrix(element.attrib, style, box, measure)
        return place.matrix if matrix is None else combine(place.matrix, matrix)

    def _place_inside(
        self, element: Element, place: _Place, style: Style, matrix: FloatArray
    ) -> _Place:
        effects, clip = self._find_effects(element, place, style, matrix)
        inherited, layer = select_inherited(style), _group_layer(element, place)
        return _Place(matrix, style, inherited, place.view, layer, place.inside, clip, effects)

    def _find_effects(
        self, element: Element, place: _Place, style: Style, matrix: FloatArray
    ) -> tuple[frozenset[str], HalfPlanes | None]:
        """The reasons to report shapes in an element, and the edges that cut them."""
        effects, clip = place.effects, place.clip
        if not _RARE_PROPERTIES.isdisjoint(style):
            for name in EFFECTS.keys() & style.keys():
                without_effect, reason = EFFECTS[name]
                if style[name] != without_effect:
                    effects |= {reason}
            if style.get("clip-path", "none") != "none":
                edges = self._find_clip(style["clip-path"], matrix, place.view)
                if edges is None:
                    effects |= {_CLIPPED}
                else:
                    clip = join_half_planes(clip, edges)
        if self._is_moved(element):
            effects |= {_MOVED}
        if CONDITION in style:
            effects |= {f"{harmless(style[CONDITION], 40)} is not evaluated: drawn without it"}
        return effects, clip

    def _is_moved(self, element: Element) -> bool:
        if len(element) and any(_name(child) in ANIMATIONS for child in element):
            return True
        return element.attrib.get("id") in self.document.moved

    def _find_clip(
        self, value: str, matrix: FloatArray, view: tuple[float, float]
    ) -> HalfPlanes | None:
        """The edges of a clip path with one convex polygon; None for any other clip path."""
        target = self.document.ids.get(find_reference(value))
        if target is None or target.tag != SVG + "clipPath":
            return None
        words = [word for word in target.attrib if not word.startswith("{")]
        units = target.attrib.get("clipPathUnits", "userSpaceOnUse")
        if {*words} - {"id", "clipPathUnits"} or units != "userSpaceOnUse" or len(target) != 1:
            return None
        child = target[0]
        if _name(child) == "use" and child.attrib.keys().isdisjoint(_PLACES):
            # Illustrator refers to the rectangle.
            child = self.document.ids.get(_reference(child), child)
        style = self.document.sheet.compute_style({}, {}, child)
        kind = _name(child)
        if kind not in KINDS or is_gone(style) or _condition(child) or len(child):
            return None
        if not {"clip-path", "visibility", CONDITION}.isdisjoint(style) or self._is_moved(child):
            return None
        try:
            subpaths, fault = SHAPES[kind](_geometry(child, style), view)
            matrix = self._matrix(child, _Place(matrix, {}, {}, view), style, subpaths)
        except Malformed:
            return None
        corners = list_corners(subpaths)
        return None if fault or corners is None else _make_clip(corners, matrix)

    def _draw(self, element: Element, tag: str, place: _Place, style: Style) -> None:
        drawing = self.drawing
        paint = self.document.painter.paint(style)
        layer = place.layer or harmless(paint.layer)
        drawing.met[tag, layer] += 1
        reason = paint.reason or drawing.layers.why_not(layer)
        if reason:
            self._report(reason, element, layer)
            return
        _check_readable(element, style)
        subpaths, fault = SHAPES[tag](_geometry(element, style), place.view)
        matrix = self._matrix(element, place, style, subpaths)
        if fault:
            self._report(f"{fault}: drawn up to there", element, layer)
        if not subpaths:
            return
        effects, clip = self._find_effects(element, place, style, matrix)
        for loss in (*sorted(effects), *paint.losses):
            self._report(loss, element, layer)
        drawing.dashed += paint.is_dashed
        drawing.shapes.append(
            DrawnShape(
                tuple(subpaths),
                matrix,
                tag,
                layer,
                paint,
                element.attrib.get("id", ""),
                clip,
            )
        )

    def _choose(self, element: Element, tag: str, place: _Place) -> Iterable[Element]:
        """The children of a group that are drawn.

        A switch draws its first child whose conditions hold. A link in a link is not drawn. The
        other children are reported.
        """
        if tag == "a":
            for child in element.iterfind(SVG + "a"):
                self._report_all("a link within a link is not drawn", child, place)
            return [child for child in element if _name(child) != "a"]
        if tag != "switch":
            return element
        children = [child for child in element if _name(child) and _name(child) not in ANIMATIONS]
        chosen = next((child for child in children if not _condition(child)), None)
        for child in children:
            if child is not chosen:
                reason = _condition(child) if chosen is None else SWITCHED
                self._report_all(reason, child, place)
        return [] if chosen is None else [chosen]

    def _use(self, element: Element, place: _Place) -> Iterator[tuple[Element, _Place]]:
        name = _reference(element)
        target = self.document.ids.get(name) if name else None
        if target is None:
            raise Malformed("refers to nothing in this file")
        if name in place.inside:
            raise Malformed("refers to itself")
        if len(place.inside) > self.deepest:
            raise InputError(
                self.file,
                f"references stand more than {format_limit(self.deepest)} deep within each other",
                remedy="draw the shapes themselves, or raise limits.svg_depth",
            )
        matrix = combine(place.matrix, _shift(_geometry(element, place.style), place.view))
        inner = replace(place, matrix=matrix, inside=place.inside | {name})
        if target.tag not in (SVG + "symbol", SVG + "svg"):
            yield target, inner
            return
        _check_size(place.style)
        style = self.document.sheet.compute_style(place.style, place.inherited, target)
        reason = is_gone(style) or _condition(target)
        if reason:
            raise Malformed(reason)
        _check_readable(target, style)
        size = {key: value for key, value in element.attrib.items() if key in ("width", "height")}
        matrix = self._matrix(target, inner, style, None)
        within = self._place_inside(target, inner, style, matrix)
        within = _viewport(target, within, {**target.attrib, **size}, style)
        yield from ((child, within) for child in target)

    def _layer(self, place: _Place, style: Style) -> str:
        return place.layer or harmless(self.document.painter.paint(style).layer)

    def _report(self, reason: str, element: Element, layer: str) -> None:
        name = element.attrib.get("id", "") or _reference(element)
        self.drawing.report(reason, harmless(_name(element), 40), layer, name)

    def _report_all(self, reason: str, element: Element, place: _Place) -> None:
        """Reports an element that is left out, and the shapes in it."""
        key = element, place.layer, reason
        counts = self.reported.get(key)
        if counts is not None:
            # References draw an element again and again; its content is listed once.
            if counts:
                self.drawing.reports[reason].update(counts)
            return
        counts = self.reported[key] = Counter()
        tag = _name(element)
        for inner in element.iter():
            kind = _name(inner)
            is_drawn = kind in KINDS or kind == "use" or kind in REPORTED_ELEMENTS
            if not is_drawn and (inner is not element or not tag or tag in GROUPS):
                continue
            layer = place.layer
            if not layer:
                style = self.document.sheet.compute_style(place.style, place.inherited, inner)
                layer = self._layer(place, style)
            counts[harmless(kind, 40), layer] += 1
            self._report(reason, inner, layer)


def _name(element: Element) -> str:
    """The name of an element of SVG; empty for a comment and for an element that is not of SVG."""
    tag = element.tag
    return tag[len(SVG) :] if isinstance(tag, str) and tag.startswith(SVG) else ""


def _reference(element: Element) -> str:
    """The id that an element refers to; empty without one in this file."""
    link = next((element.attrib[key] for key in _HREF if key in element.attrib), "")
    return link[1:] if link.startswith("#") else ""


def _condition(element: Element) -> str:
    """The condition that an element depends on and that does not hold; empty without one."""
    for name in ("requiredExtensions", "systemLanguage"):
        if name in element.attrib:
            return f"its {name} is not known to hold"
    return ""


def _check_readable(element: Element, style: Style) -> None:
    """Raises Malformed for a word that changes place or size and is not read."""
    if not _RARE_ATTRIBUTES.isdisjoint(element.attrib):
        for name in sorted(REPORTED_ATTRIBUTES.keys() & element.attrib.keys()):
            raise Malformed(REPORTED_ATTRIBUTES[name])
    if not _RARE_PROPERTIES.isdisjoint(style):
        for name in sorted(UNREAD.keys() & style.keys()):
            if style[name] not in UNREAD[name]:
                raise Malformed(f"{name} {style[name][:20]} is not read")
    if style.get("display") == "contents":
        raise Malformed("display contents is not read")


def _check_size(style: Style) -> None:
    """Raises Malformed if CSS sets the place or size of a viewport: browsers differ in that."""
    for name in ("x", "y", "width", "height"):
        if name in style:
            raise Malformed(f"{name} of a viewport in CSS is not read")


def _geometry(element: Element, style: Style) -> Mapping[str, str]:
    """The attributes of an element, with the geometry that CSS sets in their place."""
    if GEOMETRY.isdisjoint(style):
        return element.attrib
    return {**element.attrib, **{name: style[name] for name in GEOMETRY & style.keys()}}


def _viewport(element: Element, place: _Place, words: Mapping[str, str], style: Style) -> _Place:
    """The place in a nested svg or a symbol: its box laid into its width and height."""
    _check_size(style)
    box = view_box(element.attrib.get("viewBox"))
    matrix = combine(place.matrix, _shift(words, place.view))
    width = length(words.get("width") or "100%", "width", place.view)
    height = length(words.get("height") or "100%", "height", place.view)
    if width < 0 or height < 0 or (box is not None and not (width and height)):
        raise Malformed("a viewport without size")
    clip = place.clip
    if style.get("overflow", "hidden").split()[0] not in ("visible", "auto"):
        corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        edges = _make_clip(corners, matrix)
        if edges is None:
            raise Malformed("a viewport without size")
        clip = join_half_planes(clip, edges)
    view = (width, height)
    if box is not None:
        aspect = element.attrib.get("preserveAspectRatio", "")
        matrix = combine(matrix, fit_viewport(box, width, height, aspect))
        view = (box.width, box.height)
    return replace(place, matrix=matrix, view=view, clip=clip)


def _shift(words: Mapping[str, str], view: tuple[float, float]) -> FloatArray:
    """The matrix (2, 3) that moves by the attributes x and y."""
    x, y = length(words.get("x") or "0", "x", view), length(words.get("y") or "0", "y", view)
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y]])


def _make_clip(corners: FloatArray, matrix: FloatArray) -> HalfPlanes | None:
    return make_half_planes(corners @ matrix[:, :2].T + matrix[:, 2])


def _group_layer(element: Element, place: _Place) -> str:
    """The layer in a group: the innermost Inkscape layer, else the outermost group with an id."""
    if element.tag != SVG + "g":
        return place.layer
    if element.attrib.get(_INKSCAPE + "groupmode") == "layer":
        return element.attrib.get(_INKSCAPE + "label") or element.attrib.get("id", "layer")
    return place.layer or element.attrib.get("id", "")
