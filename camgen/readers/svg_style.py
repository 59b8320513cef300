"""Whether the style of an element lets it be drawn: attributes, simple rules of style sheets, inheritance."""

from __future__ import annotations

import re
from collections.abc import Mapping

from msgspec import Struct, field

#: The properties looked at; those of the second group a child has from its parent.
_OWN = ("display", "opacity", "clip-path", "mask")
_INHERITED = (
    "visibility", "stroke", "fill", "stroke-opacity", "fill-opacity", "stroke-dasharray",
    "marker", "marker-start", "marker-mid", "marker-end",
)  # fmt: skip
PROPERTIES = frozenset((*_OWN, *_INHERITED))
_RULE = re.compile(r"([^{}]*)\{([^{}]*)\}")
_COMMENT = re.compile(r"/\*.*?\*/", re.S)
#: An element, a class, an id, or an element with a class or an id.
_SELECTOR = re.compile(r"(?P<tag>[\w-]+|\*)?(?:\.(?P<cls>[\w-]+)|#(?P<id>[\w-]+))?")

Style = dict[str, str]


class Sheet(Struct):
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
        keys = [("", "", ""), (tag, "", ""), *(("", c, "") for c in classes), *((tag, c, "") for c in classes)]
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


def styled(parent: Style, tag: str, attributes: Mapping[str, str], sheet: Sheet) -> Style:
    """The style of an element: its attributes, then the sheet, then its style attribute, else its parent's."""
    own = {name: value.strip().lower() for name, value in attributes.items() if name in PROPERTIES}
    own |= sheet.of(tag, attributes)
    if "style" in attributes:
        own |= declarations(attributes["style"])
    result = {name: parent[name] for name in _INHERITED if name in parent}
    result |= {name: value for name, value in own.items() if value != "inherit"}
    return result


def gone(style: Style) -> str:
    """Why an element and all that it holds is not shown, "" where it is."""
    if style.get("display") == "none":
        return "display is none"
    return "opacity is 0" if _zero(style.get("opacity", "1")) else ""


def unseen(style: Style) -> str:
    """Why a shape is not shown, "" where it is."""
    if style.get("visibility") in ("hidden", "collapse"):
        return "visibility is hidden"
    stroke = style.get("stroke", "none") in ("none", "transparent") or _zero(style.get("stroke-opacity", "1"))
    fill = style.get("fill", "black") in ("none", "transparent") or _zero(style.get("fill-opacity", "1"))
    return "neither stroke nor fill" if stroke and fill else ""


def _zero(text: str) -> bool:
    try:
        return float(text.rstrip("%")) <= 0
    except ValueError:
        return False
