"""Styles of SVG elements: presentation attributes, style sheets, style attributes and inheritance.

tinycss2 parses style sheets, cssselect2 matches their selectors. Both are imported by a drawing
with a style sheet alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from camgen.model.text import harmless
from camgen.read.colors import resolve_css
from camgen.read.svg.vocabulary import (
    GEOMETRY,
    INHERITED,
    INITIAL,
    KEYWORDS_OF,
    PRESENTATION,
    PROPERTIES,
    SHORTHANDS,
    TRANSFORMS,
)

#: Values of the properties that a drawing is read by, as CSS writes them.
Style = dict[str, str]

#: A name that is not a property: conditions on which the style of an element depends.
CONDITION = "(condition)"
#: Media of a drawing: it is read as on a screen with a light background.
_MEDIA = {
    "": True, "all": True, "screen": True, "print": False, "speech": False,
    "(prefers-color-scheme:light)": True, "(prefers-color-scheme:dark)": False,
}  # fmt: skip
#: Rules that select no element, with the reason.
_SILENT_RULES = {
    "charset": "bytes are decoded as XML says",
    "font-face": "it names glyphs of texts, which are reported",
    "keyframes": "the elements that animation names are reported",
    "counter-style": "it is for lists",
    "page": "it is for printers",
    "property": "it declares variables, and values with variables are not read",
}
#: Rules around rules, whose conditions are not evaluated.
_CONDITIONS = frozenset({"supports", "layer", "container", "scope", "document", "starting-style"})
#: Brackets within each other that are parsed: no style has more, and the parsers call themselves.
_DEEPEST = 32
_TOO_DEEP = f"a style with brackets more than {_DEEPEST} deep"
_BRACKET = re.compile(r"[()\[\]{}]")
#: Selectors whose time grows with the square of the elements, and the elements up to which they
#: are matched.
_SLOW_SELECTOR = re.compile(r"~(?!=)|:has\(|-of-type\b")
_MOST_ELEMENTS = 2000
_SIMPLE_SELECTOR = re.compile(r"\s*(?:\*|[\w-]+)?(?:[.#][\w-]+)*\s*")
_ID = re.compile(r"#([\w-]+)")
_MEASURE = re.compile(r"([-+.\d]+(?:e[-+]?\d+)?)[a-z%]*")
_COLOR_FUNCTION = re.compile(r"(?:rgb|hsl)a?\(([^()]*)\)")
_LINK = re.compile(r"\s*url\(\s*[\"']?#([^\"')]*)[\"']?\s*\)")
_COMPUTED = re.compile(r"\b(?:var|env|calc|min|max|clamp|attr|if)\(")
_COMMENT = re.compile(r"/\*.*?\*/", re.S)


class Declaration(NamedTuple):
    """A property with its value."""

    name: str
    value: str
    is_important: bool


@lru_cache(maxsize=4096)
def parse_style(text: str) -> tuple[Declaration, ...]:
    """The declarations of a style attribute for the properties that a drawing is read by."""
    if is_too_deep(text):
        return (Declaration(CONDITION, _TOO_DEEP, True),)
    if "/*" in text:
        text = _COMMENT.sub(" ", text)
    # A semicolon within a string or brackets is left to the library.
    if '"' in text or "'" in text or "\\" in text or re.search(r"\([^)]*;", text):
        import tinycss2  # noqa: PLC0415 (only for unusual styles)

        return tuple(_convert(tinycss2.parse_blocks_contents(text, skip_comments=True)))
    declarations: list[Declaration] = []
    for part in text.split(";"):
        name, colon, value = part.partition(":")
        name = name.strip().lower()
        if colon and name in PROPERTIES:
            value, mark, word = value.partition("!")
            is_important = word.strip().lower() == "important"
            if is_important or not mark:
                declarations += _declare(name, value, is_important)
    return tuple(declarations)


def _convert(nodes: list[Any]) -> Iterator[Declaration]:
    """The declarations among nodes of tinycss2."""
    import tinycss2  # noqa: PLC0415 (only for drawings with a style sheet)

    for node in nodes:
        if node.type == "declaration" and node.lower_name in PROPERTIES:
            yield from _declare(node.lower_name, tinycss2.serialize(node.value), node.important)


def _declare(name: str, value: str, is_important: bool) -> list[Declaration]:
    """The declarations of a property; a condition in place of a value that cannot be evaluated."""
    value = normalise(value)
    if not _is_readable(name, value):
        return [Declaration(CONDITION, f"{name}: {value}", True)]
    return [
        Declaration(longhand, value, is_important) for longhand in SHORTHANDS.get(name, (name,))
    ]


def _is_readable(name: str, value: str) -> bool:
    """Whether a value can be evaluated; geometry and transforms are judged where they are read."""
    if name in GEOMETRY or name in TRANSFORMS:
        return True
    if "(" in value and _COMPUTED.search(value):
        return False
    keywords = KEYWORDS_OF.get(name)
    return keywords is None or value in keywords or value in _KEYWORDS


def is_too_deep(text: str) -> bool:
    """Whether brackets stand within each other deeper than they are parsed."""
    depth = 0
    for match in _BRACKET.finditer(text):
        depth += 1 if match[0] in "([{" else -1
        if depth > _DEEPEST:
            return True
    return False


def normalise(value: str) -> str:
    """A value without blanks around it, in lower case if it has no id and no path data."""
    value = value.strip()
    return value if "(" in value and ("url(" in value or "path(" in value) else value.lower()


class StyleSheet:
    """The rules of all style elements of a document, and the styles of elements by them.

    root: outermost element of the document.
    unread: selectors and rules that are not read.
    """

    def __init__(self, root: Element) -> None:
        self.root = root
        self.unread: list[str] = []
        self._matcher: Any = None
        self._is_simple = True
        self._ids: set[str] = set()
        self._cache: dict[tuple[str, str, str], tuple[Declaration, ...]] = {}
        self._wrappers: dict[Element, Any] = {}

    def add(self, element: Element) -> None:
        """Adds the rules of a style element; of rules with equal weight the later one wins."""
        import tinycss2  # noqa: PLC0415 (only for drawings with a style sheet)

        if element.attrib.get("type", "text/css") not in ("", "text/css"):
            return
        text = "".join(element.itertext())
        if is_too_deep(text):
            self.unread.append(_TOO_DEEP)
            return
        rules = tinycss2.parse_stylesheet(text, True, True)
        self._add_media(rules, element.attrib.get("media", ""), "")

    def _add_media(self, rules: list[Any], query: str, condition: str) -> None:
        applies = evaluate_media(query)
        if applies is None:
            condition = f"@media {query}"
        if applies is not False:
            self._add_rules(rules, condition)

    def _add_rules(self, rules: list[Any], condition: str) -> None:
        import tinycss2  # noqa: PLC0415 (only for drawings with a style sheet)

        for rule in rules:
            if rule.type == "qualified-rule":
                self._add_rule(rule, condition)
                continue
            if rule.type != "at-rule":
                self.unread.append("a damaged rule")
                continue
            keyword = rule.lower_at_keyword
            prelude = " ".join(tinycss2.serialize(rule.prelude).split())
            inner = tinycss2.parse_rule_list(rule.content or [], True, True)
            if keyword == "media":
                self._add_media(inner, prelude, condition)
            elif keyword in _CONDITIONS:
                self._add_rules(inner, f"@{keyword} {prelude}".strip())
            elif keyword not in _SILENT_RULES:
                self.unread.append(f"@{keyword} {prelude}".strip())

    def _add_rule(self, rule: Any, condition: str) -> None:
        import cssselect2  # noqa: PLC0415 (only for drawings with a style sheet)
        import tinycss2  # noqa: PLC0415

        content = tinycss2.parse_blocks_contents(rule.content, True, True)
        declarations = tuple(_convert(content))
        if any(node.type in ("qualified-rule", "at-rule") for node in content):
            condition = condition or "a rule within a rule"
        elif not declarations:
            return
        if condition:
            declarations = (Declaration(CONDITION, condition, True),)
        text = tinycss2.serialize(rule.prelude)
        try:
            selectors = cssselect2.compile_selector_list(rule.prelude)
        except cssselect2.SelectorError:
            selectors = []
        if not selectors or (_SLOW_SELECTOR.search(text) and self._is_large()):
            self.unread.append(" ".join(text.split()))
            return
        self._matcher = self._matcher or cssselect2.Matcher()
        for selector in selectors:
            if selector.pseudo_element is None:
                self._matcher.add_selector(selector, declarations)
        self._is_simple &= all(map(_SIMPLE_SELECTOR.fullmatch, text.split(",")))
        self._ids.update(_ID.findall(text))

    def _is_large(self) -> bool:
        return next(islice(self.root.iter(), _MOST_ELEMENTS, None), None) is not None

    def compute_style(self, parent: Style, inherited: Style, element: Element) -> Style:
        """The style of an element.

        parent: style of the parent, for the value `inherit`.
        inherited: its part that children have without asking.
        """
        attributes = element.attrib
        style = inherited.copy()
        for name, text in attributes.items():
            if name not in PRESENTATION or not text.strip():
                continue
            value = normalise(text)
            if _is_readable(name, value):
                style[name] = value
            else:
                style[CONDITION] = f"{name}: {value}"
        declarations = self._find(element)
        if "style" in attributes:
            declarations += parse_style(attributes["style"])
        is_important = False
        for declaration in declarations:
            style[declaration.name] = declaration.value
            is_important |= declaration.is_important
        if is_important:
            for declaration in declarations:
                if declaration.is_important:
                    style[declaration.name] = declaration.value
        if not _KEYWORDS.isdisjoint(style.values()):
            _resolve(style, parent)
        return style

    def _find(self, element: Element) -> tuple[Declaration, ...]:
        """The declarations for an element, those of the strongest rule last."""
        if self._matcher is None:
            return ()
        import cssselect2  # noqa: PLC0415 (only for drawings with a style sheet)

        if not self._is_simple:
            return tuple(self._match(self._wrap(element)))
        name = element.attrib.get("id", "")
        key = element.tag, element.attrib.get("class", ""), name if name in self._ids else ""
        declarations = self._cache.get(key)
        if declarations is None:
            # Simple selectors need nothing of the elements around it.
            alone = Element(element.tag, element.attrib)
            wrapper = cssselect2.ElementWrapper.from_xml_root(alone)
            declarations = self._cache[key] = tuple(self._match(wrapper))
        return declarations

    def _match(self, wrapper: Any) -> Iterator[Declaration]:
        for *_, matched in self._matcher.match(wrapper):
            yield from matched

    def _wrap(self, element: Element) -> Any:
        import cssselect2  # noqa: PLC0415 (only for drawings with a style sheet)

        if not self._wrappers:
            tree = cssselect2.ElementWrapper.from_xml_root(self.root)
            self._wrappers = {wrapper.etree_element: wrapper for wrapper in tree.iter_subtree()}
        return self._wrappers[element]


def evaluate_media(query: str) -> bool | None:
    """Whether a list of media queries holds on a screen; None for a query of sizes and features."""
    results: list[bool | None] = []
    for part in query.lower().split(","):
        words = part.replace(": ", ":").split()
        is_negated = words[:1] == ["not"]
        if words[:1] in (["not"], ["only"]):
            words = words[1:]
        holds = _MEDIA.get(" ".join(words))
        results.append(holds if holds is None else holds != is_negated)
    if True in results:
        return True
    return None if None in results else False


_KEYWORDS = frozenset({"inherit", "initial", "unset", "revert", "revert-layer"})


def _resolve(style: Style, parent: Style) -> None:
    """Replaces the keywords that every property takes."""
    for name, value in list(style.items()):
        if value not in _KEYWORDS:
            continue
        is_inherited = value == "inherit" or (value != "initial" and name in INHERITED)
        source = parent if is_inherited else {}
        if value in ("initial", "unset"):
            source = source or INITIAL
        if name in source:
            style[name] = source[name]
        elif value != "inherit" or name not in _FROM_ATTRIBUTES:
            del style[name]


#: Properties whose value at the parent may stand in an attribute: `inherit` of them is not read.
_FROM_ATTRIBUTES = frozenset({"x", "y", "width", "height", "transform", "transform-origin"})


def select_inherited(style: Style) -> Style:
    """The part of a style that children have."""
    return {name: value for name, value in style.items() if name in INHERITED or name == CONDITION}


def is_gone(style: Style) -> str:
    """The reason that an element is not shown with its children; empty if it is shown."""
    display = style.get("display")
    if display == "none":
        return f"display is {display}"
    return "opacity is 0" if _is_zero(style.get("opacity", "1")) else ""


class Paint(NamedTuple):
    """The paint of a shape.

    reason: why the shape is not shown; empty if it is shown.
    color: color of its stroke, else of its fill, "#rrggbb"; empty for a gradient, a pattern or an
        unknown name.
    layer: color of its stroke, else of its fill, as the file writes it: its layer without a group.
    is_stroked: whether its line is painted.
    losses: reasons to report the shape, which is drawn.
    is_dashed: whether its line has dashes.
    """

    reason: str
    color: str
    layer: str
    is_stroked: bool
    losses: tuple[str, ...]
    is_dashed: bool


_PAINTS = (
    "stroke", "fill", "stroke-opacity", "fill-opacity", "stroke-width", "stroke-dasharray",
    "color", "visibility",
)  # fmt: skip
#: Paints of the shape that a marker or a reference belongs to.
_PAINTS_OF_OTHERS = frozenset({"context-fill", "context-stroke"})
#: Elements that paint lines, by their names.
_PATTERNS = frozenset({"pattern", "hatch"})


class Painter:
    """Finds the paints of shapes; a drawing has few different ones.

    ids: elements that a paint may refer to.
    """

    def __init__(self, ids: Mapping[str, Element]) -> None:
        self._ids = ids
        self._cache: dict[tuple[str | None, ...], Paint] = {}

    def paint(self, style: Style) -> Paint:
        """The paint of a shape with a style."""
        key = tuple(map(style.get, _PAINTS))
        paint = self._cache.get(key)
        if paint is None:
            paint = self._cache[key] = self._find(style)
        return paint

    def _find(self, style: Style) -> Paint:
        stroke = self._resolve(style, "stroke", "none")
        fill = self._resolve(style, "fill", "black")
        has_width = not _is_zero(style.get("stroke-width", "1"))
        reason = ""
        if style.get("visibility") in ("hidden", "collapse"):
            reason = "visibility is hidden"
        elif not fill and not (stroke and has_width):
            reason = "stroke-width is 0" if stroke else "neither stroke nor fill"
        losses = []
        for name, paint in (("stroke", stroke), ("fill", fill)):
            if self._target(paint) in _PATTERNS:
                losses.append(f"its {name} is a pattern, which is not drawn")
            elif not _is_paint(paint):
                losses.append(f"its {name} is not a color: {harmless(paint, 20)}")
        return Paint(
            reason,
            resolve_css(stroke if stroke and has_width else fill),
            _choose_layer(style),
            bool(stroke) and has_width,
            tuple(losses),
            style.get("stroke-dasharray", "none") != "none",
        )

    def _resolve(self, style: Style, name: str, initial: str) -> str:
        """The paint of stroke or fill; empty if it is not painted."""
        paint = style.get(name, initial)
        if "url(" in paint and not self._target(paint):
            paint = paint.partition(")")[2].strip() or "none"
        if paint == "currentcolor":
            paint = style.get("color", "black")
        is_hidden = is_transparent(paint) or _is_zero(style.get(f"{name}-opacity", "1"))
        return "" if is_hidden else paint

    def _target(self, paint: str) -> str:
        """The name of the element that a paint refers to; empty without one."""
        target = self._ids.get(find_reference(paint)) if "url(" in paint else None
        return "" if target is None else str(target.tag).rpartition("}")[2]


def _is_paint(paint: str) -> bool:
    """Whether a paint is a color, a function of CSS or a reference; an empty paint is."""
    is_word = paint.replace("-", "").isalpha() or paint.startswith("#")
    return not is_word or paint in _PAINTS_OF_OTHERS or bool(resolve_css(paint))


def _choose_layer(style: Style) -> str:
    stroke, fill = style.get("stroke", "none"), style.get("fill", "black")
    paints = [paint.lower() for paint in (stroke, fill) if paint not in ("none", "")]
    return paints[0] if paints else "0"


def find_reference(value: str) -> str:
    """The id in `url(#id)`; empty without one."""
    match = _LINK.match(value)
    return match[1] if match else ""


@lru_cache(maxsize=4096)
def is_transparent(paint: str) -> bool:
    """Whether a paint has no color, or an opacity of 0."""
    if paint in ("none", "transparent"):
        return True
    if paint.startswith("#"):
        return not {5: paint[4:], 9: paint[7:]}.get(len(paint), "1").strip("0")
    numbers = _COLOR_FUNCTION.fullmatch(paint)
    values = re.split(r"[\s,/]+", numbers[1].strip()) if numbers else []
    return len(values) == 4 and _is_zero(values[3])


def _is_zero(text: str) -> bool:
    match = _MEASURE.fullmatch(text)
    try:
        return match is not None and float(match[1]) <= 0
    except ValueError:
        return False
