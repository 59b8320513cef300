"""Elements, attributes and properties of SVG 2, and the treatment of each.

A word is read, reported where it changes a drawing, or draws nothing for a reason that stands
beside it. `tests/read/test_svg_vocabulary.py` goes through the indexes of the standard.
"""

from __future__ import annotations

# Elements. Shapes stand in `path.SHAPES`.

#: Elements whose children are drawn.
GROUPS = frozenset({"g", "a", "switch", "svg"})
ANIMATIONS = frozenset({"animate", "animateColor", "animateMotion", "animateTransform", "set"})
_NOT_A_CURVE = "only shapes and paths are drawn"
#: Elements that show something and are not read, with the reason of their note.
REPORTED_ELEMENTS = {
    "text": _NOT_A_CURVE,
    "image": _NOT_A_CURVE,
    "foreignObject": _NOT_A_CURVE,
    "script": "scripts are not run",
    "discard": "animations are not run",
}
#: Elements that draw nothing by themselves, with the reason.
SILENT_ELEMENTS = {
    "defs": "its content is drawn by references",
    "symbol": "it is drawn by references",
    "clipPath": "it is read or reported where a clip-path refers to it",
    "mask": "the shapes that refer to it are reported",
    "filter": "the shapes that refer to it are reported",
    "marker": "the shapes that refer to it are reported",
    "pattern": "the shapes that refer to it are reported",
    "hatch": "the shapes that refer to it are reported",
    "linearGradient": "it is a color",
    "radialGradient": "it is a color",
    "stop": "it is a color",
    "solidcolor": "it is a color",
    "color-profile": "it is a color",
    "style": "it is read as a style sheet",
    "title": "it is a text about the drawing",
    "desc": "it is a text about the drawing",
    "metadata": "it is a text about the drawing",
    "view": "it is a target of links",
    "cursor": "it is a shape of the mouse pointer",
    "font": "it has glyphs of texts, which are reported",
    "font-face": "it names glyphs of texts, which are reported",
}

# Attributes that are not properties.

#: Attributes that are read, on the elements to which they belong.
READ_ATTRIBUTES = frozenset(
    {
        "class", "clipPathUnits", "cx", "cy", "d", "height", "href", "id", "media", "points",
        "preserveAspectRatio", "r", "requiredExtensions", "rx", "ry", "style", "systemLanguage",
        "transform", "type", "viewBox", "width", "x", "x1", "x2", "xlink:href", "y", "y1", "y2",
    }
)  # fmt: skip
#: Attributes that change a drawing and are not read, with the reason of their note.
REPORTED_ATTRIBUTES = {
    "refX": "refX is not read",
    "refY": "refY is not read",
    "onload": "scripts are not run",
    "onbegin": "scripts are not run",
    "onrepeat": "scripts are not run",
    "onend": "scripts are not run",
}


def _name_reasons(names_of: dict[str, str]) -> dict[str, str]:
    """The reason of each name. names_of: names by reason."""
    reasons: dict[str, str] = {}
    for reason, names in names_of.items():
        reasons |= dict.fromkeys(names.split(), reason)
    return reasons


#: Attributes that draw nothing, with the reason.
SILENT_ATTRIBUTES = _name_reasons(
    {
        "it belongs to animations, and the shapes that they move are reported": """
            accumulate additive attributeName begin by calcMode dur end fill from keyPoints
            keySplines keyTimes max min origin path playbackorder repeatCount repeatDur restart
            timelinebegin to values
        """,
        "it belongs to filters, and the shapes that refer to them are reported": """
            amplitude azimuth baseFrequency bias diffuseConstant divisor edgeMode elevation
            exponent filterUnits in in2 intercept k1 k2 k3 k4 kernelMatrix kernelUnitLength
            limitingConeAngle mode numOctaves operator order pointsAtX pointsAtY pointsAtZ
            preserveAlpha primitiveUnits radius result scale seed slope specularConstant
            specularExponent stdDeviation stitchTiles surfaceScale tableValues targetX targetY
            xChannelSelector yChannelSelector z
        """,
        "it belongs to gradients, which are colors": """
            fr fx fy gradientTransform gradientUnits offset spreadMethod
        """,
        "it belongs to markers, masks and patterns, whose shapes are reported": """
            markerHeight markerUnits markerWidth maskContentUnits maskUnits orient
            patternContentUnits patternTransform patternUnits
        """,
        "it belongs to texts, which are reported": """
            dx dy lengthAdjust method rotate side spacing startOffset textLength xml:space
        """,
        "it belongs to links": """
            crossorigin download hreflang ping referrerpolicy rel target xlink:title
        """,
        "it belongs to scripts, which are reported": "async defer onclick onmouseover onkeydown",
        "it describes the drawing": "lang role tabindex title xml:lang autofocus",
        "it changes dashes, and the whole line is drawn": "pathLength",
        "SVG 2 has removed it": "requiredFeatures version baseProfile zoomAndPan",
    }
)

# Properties.

#: Geometry and transforms: an attribute of that name has a grammar of its own.
GEOMETRY = frozenset({"cx", "cy", "r", "rx", "ry", "x", "y", "width", "height", "d"})
TRANSFORMS = frozenset(
    {"transform", "transform-origin", "transform-box", "translate", "rotate", "scale"}
)
#: Properties that an element has from its parent.
INHERITED = frozenset(
    {
        "visibility", "color", "stroke", "fill", "stroke-opacity", "fill-opacity",
        "stroke-width", "stroke-dasharray", "marker-start", "marker-mid", "marker-end",
    }
)  # fmt: skip
_WITHOUT_IT = "is not followed: drawn without it"
#: Properties that change the picture of shapes: value without an effect, reason of the note.
EFFECTS = {
    "mask": ("none", f"its mask {_WITHOUT_IT}"),
    "mask-image": ("none", f"its mask {_WITHOUT_IT}"),
    "mask-border": ("none", f"its mask {_WITHOUT_IT}"),
    "mask-border-source": ("none", f"its mask {_WITHOUT_IT}"),
    "filter": ("none", f"its filter {_WITHOUT_IT}"),
    "marker-start": ("none", f"its markers: marker-start {_WITHOUT_IT}"),
    "marker-mid": ("none", f"its markers: marker-mid {_WITHOUT_IT}"),
    "marker-end": ("none", f"its markers: marker-end {_WITHOUT_IT}"),
    "animation": ("none", f"its animation {_WITHOUT_IT}"),
    "animation-name": ("none", f"its animation {_WITHOUT_IT}"),
}
#: Properties that change place or size and are not read: values without an effect.
UNREAD = {
    "zoom": frozenset({"1", "normal", "100%"}),
    "offset": frozenset({"none"}),
    "offset-path": frozenset({"none"}),
    "vector-effect": frozenset({"none", "non-scaling-stroke"}),
    "overflow-x": frozenset(),
    "overflow-y": frozenset(),
    "content-visibility": frozenset({"visible", "auto"}),
    "all": frozenset(),
}
_SEEN = frozenset({"display", "opacity", "clip-path", "overflow"})
#: Limits of the size of a page in a web page, which are reported.
PAGE_LIMITS = frozenset({"max-width", "max-height", "min-width", "min-height", "aspect-ratio"})
#: Properties of keywords with their values; any other value is reported and not used.
KEYWORDS_OF = {
    "visibility": frozenset({"visible", "hidden", "collapse"}),
    "overflow": frozenset(
        {"visible", "hidden", "clip", "scroll", "auto", "overlay", "hidden hidden"}
    ),
    "display": frozenset(
        {
            "none", "contents", "inline", "block", "inline-block", "list-item", "flow", "flow-root",
            "flex", "inline-flex", "grid", "inline-grid", "run-in", "compact", "marker", "table",
            "inline-table", "table-row-group", "table-header-group", "table-footer-group",
            "table-row", "table-column-group", "table-column", "table-cell", "table-caption",
            "ruby", "ruby-base", "ruby-text", "math", "-webkit-box", "-webkit-inline-box",
        }
    ),
}  # fmt: skip
#: Shorthands with the properties that they set.
SHORTHANDS = {"marker": ("marker-start", "marker-mid", "marker-end")}
PROPERTIES = frozenset(
    {*GEOMETRY, *TRANSFORMS, *INHERITED, *EFFECTS, *UNREAD, *_SEEN, *SHORTHANDS, *PAGE_LIMITS}
)
#: Properties that an attribute of the same name sets.
PRESENTATION = frozenset(
    {*INHERITED, *_SEEN, "mask", "filter", "vector-effect"}
)  # fmt: skip
#: Values of properties that are not inherited where the style sheet of a browser says otherwise.
INITIAL = {"overflow": "visible", "transform-origin": "50% 50%"}
#: Properties that draw nothing, with the reason.
SILENT_PROPERTIES = _name_reasons(
    {
        "it changes texts, which are reported": """
            alignment-baseline baseline-shift direction dominant-baseline font font-family
            font-feature-settings font-kerning font-size font-size-adjust font-stretch font-style
            font-variant font-weight glyph-orientation-horizontal glyph-orientation-vertical
            inline-size letter-spacing line-height shape-image-threshold shape-inside shape-margin
            shape-padding shape-subtract tab-size text-align text-anchor text-decoration
            text-decoration-color text-decoration-line text-decoration-style text-indent
            text-orientation text-overflow text-rendering unicode-bidi vertical-align white-space
            word-spacing writing-mode
        """,
        "it changes colors": """
            color-interpolation color-interpolation-filters color-rendering flood-color
            flood-opacity image-rendering isolation lighting-color mix-blend-mode paint-order
            shape-rendering solid-color solid-opacity stop-color stop-opacity
        """,
        "it changes the area that is filled, and all contours are drawn": "clip-rule fill-rule",
        "it changes the ends of a wide line, and the line itself is drawn": """
            stroke-dashoffset stroke-linecap stroke-linejoin stroke-miterlimit
        """,
        "it changes masks, and the shapes that refer to them are reported": "mask-type",
        "it changes the answer to the mouse": "cursor pointer-events touch-action user-select",
        "it has an effect over time alone": "transition will-change",
        "it has an effect on boxes of web pages alone": """
            backface-visibility background clip float margin outline padding perspective
            position transform-style z-index
        """,
    }
)
