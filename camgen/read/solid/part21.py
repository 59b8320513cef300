"""The text of a STEP file (ISO 10303-21): what of it no edge needs, so that a fault there costs the part nothing.

The CAD kernel marks the entities that it cannot read. What a shape is made of, its units and its place in an assembly
must be sound. Styles, colours, texts, dimensions and what else refers to the shape need not: they are taken out of
the text, with all that refers to them, and the kernel reads the rest. So it never meets an entity that is half read.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import islice

from msgspec import Struct, field

from camgen.model.part import Note
from camgen.model.text import counted, harmless

#: What may hold any character: texts and comments.
_FREE = re.compile(rb"'(?:[^']|'')*'|/\*.*?\*/", re.DOTALL)
_INSTANCE = re.compile(rb"#([0-9]+)\s*=\s*([^;]*);")
_REFERENCE = re.compile(rb"#([0-9]+)")
#: A number that may be 0, or beyond 32 bits.
_POINT = re.compile(rb"CARTESIAN_POINT\s*\(([^;]{0,400})")
_REAL = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")
_LONG = re.compile(rb"#\s*(0+(?![0-9])|0*[1-9][0-9]{9,})")
_NAME = re.compile(rb"[A-Z][A-Z0-9_]*(?=\s*\()")
#: A parameter that is a list of nothing but references.
_LIST = re.compile(rb"[(,]\s*(\(\s*#[0-9]+(?:\s*,\s*#[0-9]+)*\s*\))")
_DOCUMENT = re.compile(rb"\bDOCUMENT_FILE\s*\(\s*'((?:[^']|'')*)'")
_CAD_FILE = re.compile(
    r"\.(?:stp|step|stpz|p21|prt|sldprt|ipt|catpart|asm|par|jt|x_t|igs|iges)$", re.IGNORECASE
)

#: How the kernel says that a text is missing, and at which parameter; that one of a list is of a type that cannot be.
_NO_TEXT = re.compile(
    r"(?:Set to empty string : )?Parameter n0\.([0-9]+) \(.*\) not a quoted String"
)
_ILLEGAL = re.compile(r"Parameter n0\.([0-9]+) \(.*\) : Entity has illegal type")

#: Representations of shapes. Those of nothing but texts are needed by none.
_HOLDS_SHAPE = re.compile(rb"SHAPE_REPRESENTATION$")
#: What puts shapes in their places.
_RELATES = re.compile(
    rb"SHAPE_DEFINITION_REPRESENTATION|CONTEXT_DEPENDENT|REPRESENTATION_RELATIONSHIP|REPRESENTATION_MAP"
)
_RELATES_TWO = re.compile(rb"REPRESENTATION_RELATIONSHIP")
_ASSEMBLES = re.compile(rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE")
#: What may be taken out of a list that is needed: draughting, the accuracy of a shape, units that no edge has.
_DRAUGHTING = re.compile(
    rb"(?<![A-Z])(?:STYLED?|ANNOTATION|TEXT|COLOUR|FONT|DRAUGHTING|CALLOUT|PRESENTATION|LEADER|SYMBOL|CAMERA|PLANAR_BOX|"
    rb"FILL_AREA|LAYER|APPEARANCE|UNCERTAINTY_MEASURE)(?![A-Z])"
)
_UNIT, _GEOMETRIC_UNIT = (
    re.compile(rb"UNIT$"),
    {b"LENGTH_UNIT", b"PLANE_ANGLE_UNIT", b"SOLID_ANGLE_UNIT"},
)


class _Instance(Struct):
    """types: its name, all names of a complex one. start, end: of what stands for it in the text, up to the semicolon.
    body: where its value begins. edits: what is put in place of parts of the text.
    """

    types: tuple[bytes, ...]
    references: frozenset[int]
    start: int
    body: int
    end: int
    edits: dict[tuple[int, int], bytes] = field(default_factory=dict)


class Mended(Struct, frozen=True):
    """data: without what could not be read and no edge needs. notes: what that was. why: of what is needed, the first
    that is not sound, empty where all is; then ``data`` is not to be used.
    """

    data: bytes
    notes: tuple[Note, ...]
    why: str = ""


def take_out(data: bytes, faults: Mapping[int, Sequence[str]]) -> Mended:
    """The text without the entities that are not sound. faults: what the kernel says of each, by its place in the file
    from 0.
    """
    text = _Text(data)
    ids = list(text.instances)
    lost: set[int] = set()
    empty = 0
    for place, said in faults.items():
        if place >= len(ids):
            return Mended(data, (), "its entities cannot be told apart")
        number = ids[place]
        empty += text.fill(number, said)
        if all(_NO_TEXT.match(one) for one in said) and text.instances[number].edits:
            continue
        if number in text.needed and not (
            text.is_dispensable(number) or text.take_from_lists(number, said)
        ):
            return Mended(data, (), text.name(number))
        if not text.instances[number].edits:
            lost.add(number)
    bad = sorted(lost)
    why = text.lose(lost)
    return Mended(text.without(lost), _notes([text.instances[k].types for k in bad], empty), why)


class _Text:
    """A STEP file as its instances by number, in the order of the file."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        bare = _FREE.sub(lambda found: b"'" + b" " * (len(found[0]) - 2) + b"'", data)
        self._bare = bare
        self.instances: dict[int, _Instance] = {}
        for found in _INSTANCE.finditer(bare):
            value = found[2]
            names = tuple(_NAME.findall(value))
            types = names if value.lstrip().startswith(b"(") else names[:1]
            references = frozenset(map(int, _REFERENCE.findall(value)))
            self.instances[int(found[1])] = _Instance(
                types, references, found.start(), found.start(2), found.end()
            )

    @cached_property
    def referrers(self) -> dict[int, list[int]]:
        """By number, who refers to it."""
        found: dict[int, list[int]] = defaultdict(list)
        for number, one in self.instances.items():
            for other in one.references:
                found[other].append(number)
        return found

    @cached_property
    def needed(self) -> set[int]:
        """What shapes are made of, with their units, their places and the products they belong to."""
        holds = self._with(_HOLDS_SHAPE)
        useful = {k for k in holds if any(map(self._is_shape, self.instances[k].references))}
        relates = {
            k: 2 if k in self._with(_RELATES_TWO) else 1 for k in self._with(_RELATES) - holds
        }
        grown = True
        while grown:
            known = holds | relates.keys()
            more = {
                k
                for k, least in relates.items()
                if len(found := self.instances[k].references & known) >= least and found <= useful
            }
            grown, useful = not more <= useful, useful | more
        return self._below(useful | self._with(_ASSEMBLES))

    def _with(self, pattern: re.Pattern[bytes]) -> set[int]:
        """The numbers of the instances with a name like this."""
        return {k for k, one in self.instances.items() if any(map(pattern.search, one.types))}

    def _is_shape(self, number: int) -> bool:
        one = self.instances.get(number)
        return one is None or not (
            self.is_dispensable(number) or any(b"CONTEXT" in name for name in one.types)
        )

    def _below(self, numbers: Iterable[int]) -> set[int]:
        """The numbers with all that they refer to, and what that refers to."""
        found, left = set(numbers), list(numbers)
        while left:
            one = self.instances.get(left.pop())
            fresh = one.references - found if one is not None else ()
            found.update(fresh)
            left += fresh
        return found

    def is_dispensable(self, number: int) -> bool:
        """Whether a list that is needed may do without it."""
        types = self.instances[number].types if number in self.instances else ()
        unit = any(map(_UNIT.search, types)) and not _GEOMETRIC_UNIT & set(types)
        return unit or any(map(_DRAUGHTING.search, types))

    def fill(self, number: int, said: Sequence[str]) -> int:
        """Puts the empty text where one is missing in an entity. Returns the number of texts."""
        instance = self.instances[number]
        missing = {int(match[1]) - 1 for match in map(_NO_TEXT.match, said) if match}
        count = 0
        for name, record in self._records(instance):
            spans = _parameters(self._bare[record : instance.end])
            for low, high in (spans[k] for k in sorted(missing) if k < len(spans)):
                span = record + low, record + high
                if name != b"SI_UNIT" and self._bare[slice(*span)].strip() == b"$":
                    instance.edits[span] = b"''"
                    count += 1
        return count

    def _records(self, instance: _Instance) -> list[tuple[bytes, int]]:
        """The name of each record of an entity, several of a complex one, and where it begins."""
        names = islice(_NAME.finditer(self._bare, instance.body, instance.end), len(instance.types))
        return [(name[0], name.start()) for name in names]

    def take_from_lists(self, number: int, said: Sequence[str]) -> bool:
        """Takes what is of a type that cannot be out of the lists of an entity; whether that mends it."""
        one = self.instances[number]
        places = [found and int(found[1]) - 1 for found in map(_ILLEGAL.match, said)]
        taken: set[int] = set()
        for found in _LIST.finditer(self._bare, one.body, one.end):
            members = list(map(int, _REFERENCE.findall(found[1])))
            taken.update(members[k] for k in places if k is not None and k < len(members))
        taken = {member for member in taken if self.is_dispensable(member)}
        return (
            None not in places
            and bool(taken)
            and all(self._take(number, member) for member in taken)
        )

    def _take(self, number: int, member: int) -> bool:
        """Takes ``member`` out of the lists of an entity; whether it stood in lists alone."""
        one = self.instances[number]
        elsewhere = self._bare[one.body : one.end]
        for found in _LIST.finditer(self._bare, one.body, one.end):
            if member in map(int, _REFERENCE.findall(found[1])):
                before = one.edits.get(found.span(1), found[1])
                rest = [
                    b"#" + other for other in _REFERENCE.findall(before) if int(other) != member
                ]
                one.edits[found.span(1)] = b"(" + b",".join(rest) + b")"
                elsewhere = elsewhere.replace(found[1], b"", 1)
        return member not in map(int, _REFERENCE.findall(elsewhere))

    def lose(self, lost: set[int]) -> str:
        """Adds to ``lost`` all that refers to it, and takes it out of the lists of what is needed. Returns the first
        that is needed itself, empty where none is.
        """
        left = list(lost)
        while left:
            number = left.pop()
            if number in self.needed and not self.is_dispensable(number):
                return self.name(number)
            for other in self.referrers.get(number, ()):
                if other in lost:
                    continue
                if other not in self.needed:
                    lost.add(other)
                    left.append(other)
                elif not (self.is_dispensable(number) and self._take(other, number)):
                    return self.name(number)
        return ""

    def name(self, number: int) -> str:
        """An entity for a message."""
        return f"#{number} {_tell(self.instances[number].types)}"

    def without(self, lost: set[int]) -> bytes:
        """The text without the instances ``lost``, as edited."""
        edits = {(self.instances[k].start, self.instances[k].end): b"" for k in lost}
        edits |= {
            span: new
            for k, one in self.instances.items()
            if k not in lost
            for span, new in one.edits.items()
        }
        pieces, done = [], 0
        for (low, high), new in sorted(edits.items()):
            pieces += [self.data[done:low], new]
            done = high
        return b"".join([*pieces, self.data[done:]])


def _parameters(value: bytes) -> list[tuple[int, int]]:
    """Where the parameters of an entity of one name stand in its value."""
    low = value.find(b"(") + 1
    spans, depth = [], 1
    for k in range(low, len(value)):
        depth += {40: 1, 41: -1}.get(value[k], 0)
        if (value[k] == 44 and depth == 1) or depth == 0:
            spans.append((low, k))
            low = k + 1
        if depth == 0:
            break
    return spans


def _tell(types: Sequence[bytes]) -> str:
    return harmless(" ".join(name.decode("ascii") for name in types) or "entity")


def _notes(bad: Sequence[Sequence[bytes]], empty: int) -> tuple[Note, ...]:
    notes = []
    if bad:
        kinds = ", ".join(
            f"{count} {name}" for name, count in Counter(map(_tell, bad)).most_common()
        )
        many = counted(
            len(bad), "entity that cannot be read was", "entities that cannot be read were"
        )
        notes.append(Note("repaired", f"{many} left out: {kinds}", "no edge needs what they say"))
    if empty:
        many = counted(empty, "text that is not given was", "texts that are not given were")
        notes.append(
            Note(
                "assumed",
                f"{many} taken as empty",
                "a name says nothing about the edges",
            )
        )
    return tuple(notes)


#: The kernel holds the numbers of entities in 32 bits.
LARGEST_ID = 2**31 - 1


def find_wild_id(data: bytes) -> str:
    """The first number of an entity, or of what one refers to, that the kernel cannot hold: beyond 32 bits it ends the
    process. Empty where all can be.
    """
    bare = _FREE.sub(b"' '", data)
    wild = (found[1] for found in _LONG.finditer(bare) if not 0 < int(found[1][:20]) <= LARGEST_ID)
    return next((f"#{harmless(number.decode('ascii'), 24)}" for number in wild), "")


def find_wild_place(data: bytes, most: float) -> str:
    """The first coordinate of a point with which the kernel cannot calculate: far beyond every part it ends the
    process. Empty where all can be.
    """
    bare = _FREE.sub(b"' '", data)
    points = (number for found in _POINT.finditer(bare) for number in _REAL.findall(found[1]))
    return next(
        (number.decode("ascii")[:24] for number in points if not abs(float(number)) <= most), ""
    )


def list_other_files(data: bytes) -> list[str]:
    """The names of the files in which a STEP file says that parts of it are."""
    names = (name.decode("latin-1").replace("''", "'") for name in _DOCUMENT.findall(data))
    return sorted({harmless(name) for name in names if _CAD_FILE.search(name)})
