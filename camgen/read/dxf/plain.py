"""Lines, circles and arcs in the usual spelling, which large drawings consist of, cut out of a text before ezdxf reads
the rest: it takes 40 microseconds and a kilobyte for each of them.

What is odd about an entity leaves it to ezdxf; what is odd about the file, all of them.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from camgen.model.pose import Vec3

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_NUMBER = rb" *([-+]?[0-9]{1,15}(?:\.[0-9]{0,20})?(?:[eE][-+]?[0-9]{1,2})?) *\n"
#: From release 13 on entities say to which class their numbers belong.
_RELEASE = re.compile(rb"\n *9\n\$ACADVER\n *1\nAC10(?:1[2-9]|[2-9][0-9])\n")
_BEGIN = re.compile(rb"\n *0\nSECTION\n *2\nENTITIES\n")
_END = re.compile(rb" *0\nENDSEC\n")


def _numbers(*codes: int) -> bytes:
    return b"".join(rb" *%d\n" % code + _NUMBER for code in codes)


#: Kind, handle, owner, layer, color; start and end of a line; centre and radius of a circle, angles of an arc. A color
#: is a number of the palette, a name what no reader turns into another one.
_ENTITY = re.compile(
    rb" *0\n(LINE|CIRCLE|ARC)\n *5\n([1-9A-F][0-9A-F]{0,15})\n(?: *330\n([0-9A-F]{1,16})\n)? *100\nAcDbEntity\n"
    rb" *8\n([A-Za-z0-9_.$+-](?:[A-Za-z0-9_.$+ -]{0,200}[A-Za-z0-9_.$+-])?)\n(?: *6\n[A-Za-z0-9_.$+ -]{0,200}\n)?"
    rb"(?: *62\n *(25[0-6]|2[0-4][0-9]|1?[0-9]?[0-9]) *\n)?(?: *370\n *-?[0-9]{1,3} *\n)? *100\nAcDb"
    rb"(?:Line\n" + _numbers(10, 20, 30, 11, 21, 31) + rb"|Circle\n" + _numbers(10, 20, 30, 40)
    + rb"(?: *100\nAcDbArc\n" + _numbers(50, 51) + rb")?)(?= *0\n)"
)  # fmt: skip
_FIELDS = 6
#: After these ezdxf looks for what belongs to them: an entity there is no plain one.
_LEADING = frozenset((b"POLYLINE", b"INSERT", b"VERTEX", b"ATTRIB"))


class _Point(Struct, frozen=True, gc=False):
    xyz: Vec3


class _Entity(Struct, frozen=True, gc=False):
    """What the walk asks an entity of ezdxf."""

    kind: str
    attributes: dict[str, Any]

    def dxftype(self) -> str:
        return self.kind

    def dxfattribs(self) -> dict[str, Any]:
        return self.attributes


class PlainEntities(Struct, eq=False):
    """Columns of what was cut out, and the text that is left.

    numbers: six of each. owners: the layouts that they say they belong to. before: how many come before the other
    entities of the section, by handle.
    """

    rest: bytes
    kinds: list[str]
    handles: list[str]
    layers: list[str]
    colors: list[int | None]
    numbers: array[float]
    owners: frozenset[str]
    before: dict[str, int]

    def belong(self, document: Drawing) -> bool:
        """Whether all of them are in model space, and no handle is used twice. document: of the rest."""
        paper = document.block_records.get("*Paper_Space")
        return paper.dxf.handle not in self.owners and not any(handle in document.entitydb for handle in self.handles)

    def merge(self, others: Iterable[Any]) -> Iterator[Any]:
        """All entities of model space in drawing order. others: those that ezdxf has read, in theirs."""
        done = 0
        for other in others:
            until = self.before.get(other.dxf.handle, 0)
            yield from map(self._entity, range(done, until))
            done = max(done, until)
            yield other
        yield from map(self._entity, range(done, len(self.kinds)))

    def _entity(self, place: int) -> _Entity:
        kind = self.kinds[place]
        a, b, c, d, e, f = self.numbers[_FIELDS * place : _FIELDS * (place + 1)]
        said: dict[str, Any] = {"handle": self.handles[place], "layer": self.layers[place]}
        color = self.colors[place]
        if color is not None:
            said["color"] = color
        if kind == "LINE":
            said |= {"start": _Point((a, b, c)), "end": _Point((d, e, f))}
        else:
            said |= {"center": _Point((a, b, c)), "radius": d}
        if kind == "ARC":
            said |= {"start_angle": e, "end_angle": f}
        return _Entity(kind, said)


def cut(data: bytes) -> PlainEntities | None:
    """The plain entities of a DXF text; None where there are none, or where it is not sure what the text says."""
    data = data.replace(b"\r\n", b"\n")
    begins = [found.end() for found in _BEGIN.finditer(data)]
    if len(begins) != 1 or b"\r" in data or not _RELEASE.search(data, 0, begins[0]):
        return None
    end = _END.search(data, begins[0])
    if end is None:
        return None
    found = PlainEntities(b"", [], [], [], [], array("d"), frozenset(), {})
    owners: set[bytes] = set()
    names: dict[bytes, str] = {}
    pieces = [data[: begins[0]]]
    at, leading = begins[0], False
    for one in _ENTITY.finditer(data, begins[0], end.end()):
        if one.start() > at:
            last = _note_others(data[at : one.start()], found)
            if last is None:
                return None
            leading = last in _LEADING
        if leading or not _add(found, one.groups(), owners, names):
            last = _note_others(one[0], found)
            if last is None:
                return None
            leading = last in _LEADING
            pieces.append(data[at : one.end()])
        else:
            pieces.append(data[at : one.start()])
        at = one.end()
    if _note_others(data[at : end.start()], found) is None or not found.kinds:
        return None
    if len(set(found.handles)) < len(found.handles):
        return None
    pieces.append(data[at:])
    found.rest, found.owners = b"".join(pieces), frozenset(owner.decode() for owner in owners)
    return found


def _add(found: PlainEntities, said: Sequence[bytes | None], owners: set[bytes], names: dict[bytes, str]) -> bool:
    """Adds an entity; whether it is what its name says."""
    kind, handle, owner, layer, color, *numbers = said
    line, circle, arc = numbers[0], numbers[6], numbers[10]
    if kind is None or handle is None or layer is None:
        return False
    if (kind == b"LINE") != (line is not None) or (kind == b"ARC") != (arc is not None):
        return False
    values = numbers[:6] if circle is None else [*numbers[6:10], *((0, 0) if arc is None else numbers[10:])]
    found.kinds.append("LINE" if kind == b"LINE" else "ARC" if kind == b"ARC" else "CIRCLE")
    found.handles.append(handle.decode())
    found.layers.append(names.setdefault(layer, layer.decode()))
    found.colors.append(None if color is None else int(color))
    found.numbers.extend(float(value or 0) for value in values)
    if owner is not None:
        owners.add(owner)
    return True


def _note_others(text: bytes, found: PlainEntities) -> bytes | None:
    """Notes how many plain entities come before those in ``text``; the kind of the last one, None for odd ones."""
    lines = text.split(b"\n")
    if lines.pop() or len(lines) % 2:
        return None
    last, handle = b"", b"?"
    for padded, value in zip(lines[::2], lines[1::2], strict=True):
        code = padded.strip()
        if code == b"0":
            if not handle:
                return None
            last, handle = value.strip(), b""
        elif code == b"5" and not handle:
            handle = value
            name = handle.decode("ascii", "replace")
            if name in found.before:
                return None
            found.before[name] = len(found.kinds)
    return last if handle else None
