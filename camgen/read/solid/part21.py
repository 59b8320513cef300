"""Repairs the text of a STEP file (ISO 10303-21): removes damaged entities that no edge needs.

The CAD kernel marks the entities that it cannot read. Entities that define shapes, their units and
their positions in an assembly must be sound. Styles, colours, texts, dimensions and other entities
that only refer to shapes are removed from the text, with all that refers to them. The kernel reads
the rest, so that it never meets an entity that is read in part.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice

from msgspec import Struct, field

from camgen.model.part import Note
from camgen.model.text import counted, harmless

#: Texts and comments, which may contain any character.
_FREE = re.compile(rb"'(?:[^']|'')*'|/\*.*?\*/", re.DOTALL)
_INSTANCE = re.compile(rb"#([0-9]+)\s*=\s*([^;]*);")
_REFERENCE = re.compile(rb"#([0-9]+)")
_POINT = re.compile(rb"CARTESIAN_POINT\s*\(([^;]{0,400})")
_REAL = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")
#: A reference to 0, or one that may need more than 32 bits.
_LONG = re.compile(rb"#\s*(0+(?![0-9])|0*[1-9][0-9]{9,})")
_NAME = re.compile(rb"[A-Z][A-Z0-9_]*(?=\s*\()")
#: A parameter that is a list of references only.
_LIST = re.compile(rb"[(,]\s*(\(\s*#[0-9]+(?:\s*,\s*#[0-9]+)*\s*\))")
_DOCUMENT = re.compile(rb"\bDOCUMENT_FILE\s*\(\s*'((?:[^']|'')*)'")
_CAD_FILE = re.compile(
    r"\.(?:stp|step|stpz|p21|prt|sldprt|ipt|catpart|asm|par|jt|x_t|igs|iges)$", re.IGNORECASE
)

#: Message of the kernel about a parameter, by its number, that should be a text and is not.
_NO_TEXT = re.compile(
    r"(?:Set to empty string : )?Parameter n0\.([0-9]+) \(.*\) not a quoted String"
)
#: Message of the kernel about a member of a list, by its number, whose type is not allowed there.
_ILLEGAL = re.compile(r"Parameter n0\.([0-9]+) \(.*\) : Entity has illegal type")

#: Representations of shapes. A representation that holds nothing but texts is not needed.
_HOLDS_SHAPE = re.compile(rb"SHAPE_REPRESENTATION$")
#: Relations that give shapes their positions.
_RELATES = re.compile(
    rb"SHAPE_DEFINITION_REPRESENTATION|CONTEXT_DEPENDENT|REPRESENTATION_RELATIONSHIP|"
    rb"REPRESENTATION_MAP"
)
_RELATES_TWO = re.compile(rb"REPRESENTATION_RELATIONSHIP")
_ASSEMBLES = re.compile(rb"NEXT_ASSEMBLY_USAGE_OCCURRENCE")
#: Entities that may be removed from a list that is needed: draughting and the accuracy of a shape.
_DRAUGHTING = re.compile(
    rb"(?<![A-Z])(?:STYLED?|ANNOTATION|TEXT|COLOUR|FONT|DRAUGHTING|CALLOUT|PRESENTATION|LEADER|"
    rb"SYMBOL|CAMERA|PLANAR_BOX|FILL_AREA|LAYER|APPEARANCE|UNCERTAINTY_MEASURE)(?![A-Z])"
)
#: Units may be removed from such a list too, unless they are the units of shapes.
_UNIT = re.compile(rb"UNIT$")
_GEOMETRIC_UNITS = {b"LENGTH_UNIT", b"PLANE_ANGLE_UNIT", b"SOLID_ANGLE_UNIT"}
#: Change of the depth of nesting at a character.
_NESTING = {ord("("): 1, ord(")"): -1}


class _Instance(Struct):
    """An entity in the text.

    types: its type; all types of a complex entity.
    references: numbers of the entities that it refers to.
    start: offset of its number in the text.
    body: offset of its value.
    end: offset after its semicolon.
    edits: new text for ranges of offsets.
    """

    types: tuple[bytes, ...]
    references: frozenset[int]
    start: int
    body: int
    end: int
    edits: dict[tuple[int, int], bytes] = field(default_factory=dict)


class RepairedText(Struct, frozen=True):
    """The text of a STEP file without damaged entities.

    data: the text. It is not to be used if `why` is not empty.
    notes: notes on the changes.
    why: the first entity that is damaged and needed, "" if no such entity exists.
    """

    data: bytes
    notes: tuple[Note, ...]
    why: str = ""


def remove_faults(data: bytes, faults: Mapping[int, Sequence[str]]) -> RepairedText:
    """Remove the damaged entities from a text.

    faults: messages of the kernel about each damaged entity, by its index in the file.
    """
    text = _StepText(data)
    numbers = list(text.instances)
    lost: set[int] = set()
    filled = 0
    for index, messages in faults.items():
        if index >= len(numbers):
            return RepairedText(data, (), "its entities cannot be identified")
        number = numbers[index]
        filled += text.fill_texts(number, messages)
        if all(map(_NO_TEXT.match, messages)) and text.instances[number].edits:
            continue
        is_needed = number in text.needed and not text.is_dispensable(number)
        if is_needed and not text.remove_illegal(number, messages):
            return RepairedText(data, (), text.describe(number))
        if not text.instances[number].edits:
            lost.add(number)
    damaged = [text.instances[number].types for number in sorted(lost)]
    why = text.remove_referrers(lost)
    return RepairedText(text.write_without(lost), tuple(_note_repairs(damaged, filled)), why)


class _StepText:
    """A STEP file as its instances by number, in the order of the file."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        # Texts and comments become blanks, so that patterns find entities alone.
        self._bare = _FREE.sub(lambda match: b"'" + b" " * (len(match[0]) - 2) + b"'", data)
        self.instances: dict[int, _Instance] = {}
        for match in _INSTANCE.finditer(self._bare):
            value = match[2]
            names = tuple(_NAME.findall(value))
            types = names if value.lstrip().startswith(b"(") else names[:1]
            references = frozenset(map(int, _REFERENCE.findall(value)))
            self.instances[int(match[1])] = _Instance(
                types, references, match.start(), match.start(2), match.end()
            )

    @cached_property
    def referrers(self) -> dict[int, list[int]]:
        """The numbers of the instances that refer to each instance."""
        referrers: dict[int, list[int]] = defaultdict(list)
        for number, instance in self.instances.items():
            for reference in instance.references:
                referrers[reference].append(number)
        return referrers

    @cached_property
    def needed(self) -> set[int]:
        """The numbers of all instances that define shapes, their units, positions and products.

        A representation is used if it holds a shape. A relation is used if all representations and
        relations that it connects are used.
        """
        representations = self._select(_HOLDS_SHAPE)
        used = {
            k for k in representations if any(map(self._is_shape, self.instances[k].references))
        }
        relations = self._select(_RELATES) - representations
        relations_of_two = self._select(_RELATES_TWO)
        connectable = representations | relations
        size = -1
        while size < len(used):
            size = len(used)
            for number in relations:
                connected = self.instances[number].references & connectable
                fewest = 2 if number in relations_of_two else 1
                if len(connected) >= fewest and connected <= used:
                    used.add(number)
        return self._add_references(used | self._select(_ASSEMBLES))

    def _select(self, pattern: re.Pattern[bytes]) -> set[int]:
        return {
            k for k, instance in self.instances.items() if any(map(pattern.search, instance.types))
        }

    def _is_shape(self, number: int) -> bool:
        """Whether an item of a representation is a shape: neither dispensable nor a context."""
        is_context = b"CONTEXT" in b" ".join(self._find_types(number))
        return not (is_context or self.is_dispensable(number))

    def _find_types(self, number: int) -> tuple[bytes, ...]:
        """The types of an instance, none if the file does not hold it."""
        return self.instances[number].types if number in self.instances else ()

    def _add_references(self, numbers: Iterable[int]) -> set[int]:
        """The numbers with all that they refer to, directly or through others."""
        reached, pending = set(numbers), list(numbers)
        while pending:
            instance = self.instances.get(pending.pop())
            fresh = instance.references - reached if instance is not None else ()
            reached.update(fresh)
            pending += fresh
        return reached

    def is_dispensable(self, number: int) -> bool:
        """Whether an instance may be removed from a list that is needed."""
        types = self._find_types(number)
        is_unit = any(map(_UNIT.search, types)) and not _GEOMETRIC_UNITS & set(types)
        return is_unit or any(map(_DRAUGHTING.search, types))

    def fill_texts(self, number: int, messages: Sequence[str]) -> int:
        """Replace the missing texts of an instance by empty ones. Returns their number."""
        instance = self.instances[number]
        missing = sorted(set(_read_places(_NO_TEXT, messages)))
        count = 0
        # A complex instance has several records, each with its type before its parameters.
        names = _NAME.finditer(self._bare, instance.body, instance.end)
        for name in islice(names, len(instance.types)):
            record = name.start()
            spans = _find_parameters(self._bare[record : instance.end])
            for k in missing:
                if k >= len(spans):
                    break
                span = record + spans[k][0], record + spans[k][1]
                if name[0] != b"SI_UNIT" and self._bare[slice(*span)].strip() == b"$":
                    instance.edits[span] = b"''"
                    count += 1
        return count

    def remove_illegal(self, number: int, messages: Sequence[str]) -> bool:
        """Remove members of types that are not allowed from the lists of an instance.

        Returns whether that repairs the instance.
        """
        instance = self.instances[number]
        places = _read_places(_ILLEGAL, messages)
        illegal: set[int] = set()
        for parameter in _LIST.finditer(self._bare, instance.body, instance.end):
            members = list(map(int, _REFERENCE.findall(parameter[1])))
            illegal.update(members[k] for k in places if k < len(members))
        illegal = set(filter(self.is_dispensable, illegal))
        is_repairable = len(places) == len(messages) and bool(illegal)
        return is_repairable and all(self._remove_member(number, member) for member in illegal)

    def _remove_member(self, number: int, member: int) -> bool:
        """Remove `member` from the lists of an instance. Returns whether it was in lists only."""
        instance = self.instances[number]
        elsewhere = self._bare[instance.body : instance.end]
        for parameter in _LIST.finditer(self._bare, instance.body, instance.end):
            if member in map(int, _REFERENCE.findall(parameter[1])):
                before = instance.edits.get(parameter.span(1), parameter[1])
                rest = [
                    b"#" + other for other in _REFERENCE.findall(before) if int(other) != member
                ]
                instance.edits[parameter.span(1)] = b"(" + b",".join(rest) + b")"
                elsewhere = elsewhere.replace(parameter[1], b"", 1)
        return member not in map(int, _REFERENCE.findall(elsewhere))

    def remove_referrers(self, lost: set[int]) -> str:
        """Add all instances to `lost` that refer to one of them and are not needed.

        Dispensable ones are removed from the lists of needed instances. Returns the first instance
        that would be lost and is needed, "" if no such instance exists.
        """
        pending = list(lost)
        while pending:
            number = pending.pop()
            if number in self.needed and not self.is_dispensable(number):
                return self.describe(number)
            for other in self.referrers.get(number, ()):
                if other in lost:
                    continue
                if other not in self.needed:
                    lost.add(other)
                    pending.append(other)
                elif not (self.is_dispensable(number) and self._remove_member(other, number)):
                    return self.describe(number)
        return ""

    def describe(self, number: int) -> str:
        """Number and types of an instance for a message."""
        return f"#{number} {_join_types(self.instances[number].types)}"

    def write_without(self, lost: set[int]) -> bytes:
        """The text with all edits and without the instances of `lost`."""
        edits: dict[tuple[int, int], bytes] = {}
        for number, instance in self.instances.items():
            edits |= {(instance.start, instance.end): b""} if number in lost else instance.edits
        pieces, done = [], 0
        for (low, high), new in sorted(edits.items()):
            pieces += [self.data[done:low], new]
            done = high
        return b"".join([*pieces, self.data[done:]])


def _read_places(pattern: re.Pattern[str], messages: Sequence[str]) -> list[int]:
    """The index of a parameter or a member in each message that `pattern` matches."""
    return [int(match[1]) - 1 for match in map(pattern.match, messages) if match]


def _find_parameters(value: bytes) -> list[tuple[int, int]]:
    """The ranges of the parameters of the first record in `value`."""
    low = value.find(b"(") + 1
    spans, depth = [], 1
    for k in range(low, len(value)):
        depth += _NESTING.get(value[k], 0)
        if depth == 0 or (depth == 1 and value[k] == ord(",")):
            spans.append((low, k))
            low = k + 1
        if depth == 0:
            break
    return spans


def _join_types(types: Sequence[bytes]) -> str:
    return harmless(" ".join(name.decode("ascii") for name in types) or "entity")


def _note_repairs(damaged: Sequence[Sequence[bytes]], filled: int) -> Iterator[Note]:
    if damaged:
        counts = Counter(map(_join_types, damaged)).most_common()
        kinds = ", ".join(f"{count} {name}" for name, count in counts)
        what = counted(
            len(damaged), "entity that cannot be read was", "entities that cannot be read were"
        )
        yield Note("repaired", f"{what} left out: {kinds}", "no edge needs what they say")
    if filled:
        what = counted(filled, "text that is not given was", "texts that are not given were")
        yield Note("assumed", f"{what} read as empty", "a name says nothing about the edges")


#: The kernel keeps the numbers of entities in 32 bits. A larger one ends its process.
LARGEST_ID = 2**31 - 1


def find_wild_id(data: bytes) -> str:
    """The first number of an entity that the kernel cannot keep, "" if it can keep all."""
    for match in _LONG.finditer(_FREE.sub(b"' '", data)):
        if not 0 < int(match[1][:20]) <= LARGEST_ID:
            return f"#{harmless(match[1].decode('ascii'), 24)}"
    return ""


def find_wild_place(data: bytes, limit: float) -> str:
    """The first coordinate of a point above `limit`, "" if all are within it.

    The kernel cannot calculate with coordinates far beyond every part. They end its process.
    """
    for point in _POINT.finditer(_FREE.sub(b"' '", data)):
        for number in _REAL.findall(point[1]):
            if not abs(float(number)) <= limit:
                return str(number[:24], "ascii")
    return ""


def list_other_files(data: bytes) -> list[str]:
    """The names of other CAD files that contain parts of a STEP file, according to its text."""
    files = set()
    for document in _DOCUMENT.findall(data):
        name = document.decode("latin-1").replace("''", "'")
        if _CAD_FILE.search(name):
            files.add(harmless(name))
    return sorted(files)
