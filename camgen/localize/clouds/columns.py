"""Which columns of a text hold x, y and z, and in which unit, by the names in its head.

The names are those that programs write: `//X Y Z` (CloudCompare, ASCII export with a header),
`Points:0`, `Points_0` (ParaView, "Save Data" as CSV), `x coord` (ParaView wiki, Data formats),
easting, northing and elevation (programs for surveys), and units as in `X [mm]`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from msgspec import Struct

from camgen.read.units import MM

_WORDS = ("coord", "coordinate", "koordinate", "pos", "position", "location", "point", "points")


def _decorate(axis: str) -> frozenset[str]:
    """Names such as `x coord`, without blanks and underscores."""
    return frozenset({axis + word for word in _WORDS} | {word + axis for word in _WORDS})


_EAST = frozenset({"e", "east", "easting", "eastings", "rechtswert"})
_NORTH = frozenset({"n", "north", "northing", "northings", "hochwert"})
_HEIGHT = frozenset({"h", "height", "z", "elev", "elevation", "altitude", "höhe", "hoehe"})
#: Names of the three columns, family by family: the first family that is complete counts.
_FAMILIES = (
    (frozenset({"x"}), frozenset({"y"}), frozenset({"z"})),
    (
        frozenset({"points0", "point0"}),
        frozenset({"points1", "point1"}),
        frozenset({"points2", "point2"}),
    ),
    tuple(map(_decorate, "xyz")),
    (_EAST, _NORTH, _HEIGHT),
)
_BETWEEN = re.compile(r"[\s_.:\-]+")
#: Units as words; marks such as `"` may be quotes.
_UNITS = "|".join(sorted(filter(str.isalpha, MM), key=len, reverse=True))
_UNIT = re.compile(
    rf"(?P<name>.+?)(?:\s*[\[({{]\s*(?P<braced>{_UNITS})\s*[\])}}]"
    rf"|[\s_/]+(?:in\s+)?(?P<plain>{_UNITS}))",
    re.IGNORECASE,
)
_BRACED = re.compile(rf"[\[({{]?\s*({_UNITS})\s*[\])}}]?", re.IGNORECASE)


class Columns(Struct, frozen=True):
    """The columns of x, y and z.

    places: the indices of the columns, from 0.
    unit: the unit that the names state; "" if they state none.
    names: the three names as they are in the file.
    compass: whether they are named after directions and the height.
    """

    places: tuple[int, int, int]
    unit: str
    names: tuple[str, str, str]
    compass: bool = False


def find_columns(names: Sequence[str]) -> Columns | None:
    """The columns of x, y and z; None if the names do not hold them.

    Raises ValueError if a name is there twice or the three units differ.
    """
    plain, units = [], []
    for name in names:
        words, unit = _split_unit(name)
        plain.append(_BETWEEN.sub("", words).lower())
        units.append(unit)
    for family in _FAMILIES:
        places = [_indices(plain, axis) for axis in family]
        if not all(places):
            continue
        for indices in places:
            if len(indices) > 1:
                raise ValueError(f"the column {names[indices[1]].strip()!r} is there twice")
        x, y, z = (indices[0] for indices in places)
        stated = {units[x], units[y], units[z]}
        three = (names[x], names[y], names[z])
        if len(stated) > 1:
            raise ValueError(f"the columns {', '.join(map(str.strip, three))} have different units")
        return Columns((x, y, z), stated.pop(), three, compass=family is _FAMILIES[-1])
    return None


def _indices(names: Sequence[str], wanted: frozenset[str]) -> list[int]:
    return [k for k, name in enumerate(names) if name in wanted]


def find_unit(words: Sequence[str], places: Sequence[int]) -> str:
    """The unit in a line of units below the names; "" if the words at `places` are others.

    Raises ValueError if they differ.
    """
    matches = [_BRACED.fullmatch(words[k].strip(" \"'")) for k in places if k < len(words)]
    units = {match[1].lower() for match in matches if match}
    if len(matches) != len(places) or None in matches:
        return ""
    if len(units) > 1:
        raise ValueError(f"the columns have different units: {', '.join(sorted(units))}")
    return units.pop()


def _split_unit(name: str) -> tuple[str, str]:
    name = name.strip().strip("\"'").strip()
    match = _UNIT.fullmatch(name)
    if match is None:
        return name, ""
    return match["name"], (match["braced"] or match["plain"]).lower()
