"""Resolves colors of CSS, DXF and the job file to "#rrggbb"."""

from __future__ import annotations

import colorsys
import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

from camgen.read.pieces import list_first

#: The first colors of DXF by number (AutoCAD Color Index). 7 is drawn black on white paper and
#: white on a dark screen.
ACI = {
    1: "#ff0000", 2: "#ffff00", 3: "#00ff00", 4: "#00ffff", 5: "#0000ff", 6: "#ff00ff",
    7: "#ffffff", 8: "#808080", 9: "#c0c0c0",
}  # fmt: skip
#: Names of these colors in CAD that stand for another color in CSS.
_CAD_NAMES = {"green": "#00ff00", "light gray": "#c0c0c0", "light grey": "#c0c0c0"}
_LAST_ACI = 255
#: The names of CSS (Color Module Level 4, section 6.1) with their red, green and blue.
_CSS = """
    aliceblue f0f8ff  antiquewhite faebd7  aqua 00ffff  aquamarine 7fffd4  azure f0ffff
    beige f5f5dc  bisque ffe4c4  black 000000  blanchedalmond ffebcd  blue 0000ff
    blueviolet 8a2be2  brown a52a2a  burlywood deb887  cadetblue 5f9ea0  chartreuse 7fff00
    chocolate d2691e  coral ff7f50  cornflowerblue 6495ed  cornsilk fff8dc  crimson dc143c
    cyan 00ffff  darkblue 00008b  darkcyan 008b8b  darkgoldenrod b8860b  darkgray a9a9a9
    darkgreen 006400  darkgrey a9a9a9  darkkhaki bdb76b  darkmagenta 8b008b  darkolivegreen 556b2f
    darkorange ff8c00  darkorchid 9932cc  darkred 8b0000  darksalmon e9967a  darkseagreen 8fbc8f
    darkslateblue 483d8b  darkslategray 2f4f4f  darkslategrey 2f4f4f  darkturquoise 00ced1
    darkviolet 9400d3  deeppink ff1493  deepskyblue 00bfff  dimgray 696969  dimgrey 696969
    dodgerblue 1e90ff  firebrick b22222  floralwhite fffaf0  forestgreen 228b22  fuchsia ff00ff
    gainsboro dcdcdc  ghostwhite f8f8ff  gold ffd700  goldenrod daa520  gray 808080  green 008000
    greenyellow adff2f  grey 808080  honeydew f0fff0  hotpink ff69b4  indianred cd5c5c
    indigo 4b0082  ivory fffff0  khaki f0e68c  lavender e6e6fa  lavenderblush fff0f5
    lawngreen 7cfc00  lemonchiffon fffacd  lightblue add8e6  lightcoral f08080  lightcyan e0ffff
    lightgoldenrodyellow fafad2  lightgray d3d3d3  lightgreen 90ee90  lightgrey d3d3d3
    lightpink ffb6c1  lightsalmon ffa07a  lightseagreen 20b2aa  lightskyblue 87cefa
    lightslategray 778899  lightslategrey 778899  lightsteelblue b0c4de  lightyellow ffffe0
    lime 00ff00  limegreen 32cd32  linen faf0e6  magenta ff00ff  maroon 800000
    mediumaquamarine 66cdaa  mediumblue 0000cd  mediumorchid ba55d3  mediumpurple 9370db
    mediumseagreen 3cb371  mediumslateblue 7b68ee  mediumspringgreen 00fa9a
    mediumturquoise 48d1cc  mediumvioletred c71585  midnightblue 191970  mintcream f5fffa
    mistyrose ffe4e1  moccasin ffe4b5  navajowhite ffdead  navy 000080  oldlace fdf5e6
    olive 808000  olivedrab 6b8e23  orange ffa500  orangered ff4500  orchid da70d6
    palegoldenrod eee8aa  palegreen 98fb98  paleturquoise afeeee  palevioletred db7093
    papayawhip ffefd5  peachpuff ffdab9  peru cd853f  pink ffc0cb  plum dda0dd  powderblue b0e0e6
    purple 800080  rebeccapurple 663399  red ff0000  rosybrown bc8f8f  royalblue 4169e1
    saddlebrown 8b4513  salmon fa8072  sandybrown f4a460  seagreen 2e8b57  seashell fff5ee
    sienna a0522d  silver c0c0c0  skyblue 87ceeb  slateblue 6a5acd  slategray 708090
    slategrey 708090  snow fffafa  springgreen 00ff7f  steelblue 4682b4  tan d2b48c  teal 008080
    thistle d8bfd8  tomato ff6347  turquoise 40e0d0  violet ee82ee  wheat f5deb3  white ffffff
    whitesmoke f5f5f5  yellow ffff00  yellowgreen 9acd32
"""
CSS = {name: f"#{digits}" for name, digits in re.findall(r"(\w+) (\w+)", _CSS)}
#: Well-known names, which messages list and use.
BASIC = (
    "red", "yellow", "green", "cyan", "blue", "magenta", "white", "black", "gray", "silver",
    "maroon", "olive", "lime", "teal", "navy", "purple", "orange", "brown", "pink",
)  # fmt: skip
#: Colors that `count_colors` lists one by one.
_SHOWN = 12
_HEX = re.compile(r"#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})")
_FUNCTION = re.compile(r"(rgb|hsl)a?\(([^()]*)\)")


@lru_cache(maxsize=4096)
def resolve_css(text: str) -> str:
    """The CSS color of a text, without its opacity; "" if it is not a known color.

    >>> resolve_css("Red"), resolve_css("#F80"), resolve_css("rgb(0, 50%, 255)")
    ('#ff0000', '#ff8800', '#0080ff')
    >>> resolve_css("url(#shine)")
    ''
    """
    word = text.strip().lower()
    if word in CSS:
        return CSS[word]
    if _HEX.fullmatch(word):
        if len(word) > 5:
            return word[:7]
        return f"#{word[1] * 2}{word[2] * 2}{word[3] * 2}"
    match = _FUNCTION.fullmatch(word)
    try:
        return _from_function(match[1], re.split(r"[\s,/]+", match[2].strip())) if match else ""
    except ValueError:  # not numbers
        return ""


def _from_function(name: str, values: list[str]) -> str:
    """The color of rgb (0 to 255, or percent) or of hsl (degrees and percent).

    Raises ValueError for a wrong number of values, and for a value that is not a number.
    """
    if len(values) not in (3, 4):
        raise ValueError("not three numbers")
    if name == "rgb":
        parts = [
            float(value[:-1]) / 100 if value.endswith("%") else float(value) / 255
            for value in values[:3]
        ]
    else:
        hue, saturation, light = (
            float(value.removesuffix("%").removesuffix("deg")) for value in values[:3]
        )
        parts = list(colorsys.hls_to_rgb(hue % 360 / 360, light / 100, saturation / 100))
    return "#" + "".join(f"{int(255 * min(max(part, 0.0), 1.0) + 0.5):02x}" for part in parts)


def resolve_aci(number: int) -> str:
    """The color of a number of DXF, 1 to 255. Any other number has the color of 7.

    >>> resolve_aci(1), resolve_aci(30), resolve_aci(7)
    ('#ff0000', '#ff7f00', '#ffffff')
    """
    if number in ACI or not 0 < number <= _LAST_ACI:
        return ACI.get(number, ACI[7])
    from ezdxf.colors import aci2rgb  # noqa: PLC0415 (only for what needs it)

    return "#" + "".join(f"{part:02x}" for part in aci2rgb(number))


def resolve_named(text: str) -> frozenset[str]:
    """The colors of a name, a number of DXF or "#rrggbb" in a job file; empty for another text.

    A name such as green is one color in CAD and another one in CSS. It stands for both.

    >>> sorted(resolve_named("green")), sorted(resolve_named("5")), sorted(resolve_named("grin"))
    (['#008000', '#00ff00'], ['#0000ff'], [])
    """
    word = " ".join(text.lower().split())
    if word.isdecimal():
        return frozenset({resolve_aci(int(word))} if 0 < int(word) <= _LAST_ACI else ())
    return frozenset({resolve_css(word), _CAD_NAMES.get(word, "")} - {""})


def count_colors(colors: Sequence[str]) -> str:
    """A line for `inspect` with the number of contours of each color, most first.

    "" if all have the same color.
    """
    counts = Counter(colors).most_common()
    if len(counts) < 2:
        return ""
    texts = [f"{count} {format_color(color)}" for color, count in counts]
    return f"colors of contours: {list_first(texts, _SHOWN)}"


def format_color(color: str) -> str:
    """A color with its name, if it is one of `BASIC`.

    >>> format_color("#ff0000"), format_color("#ff7f00"), format_color("")
    ('#ff0000 (red)', '#ff7f00', 'none')
    """
    for name in BASIC:
        if color in resolve_named(name):
            return f"{color} ({name})"
    return color or "none"
