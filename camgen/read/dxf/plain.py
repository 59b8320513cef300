"""Takes plain entities out of the text of a drawing by column, in the usual spelling of a program.

Most of a large drawing is long runs of them, and most of the time of reading is spent on making an
object of each. So they are read by column, and ezdxf gets the text with one stand-in for each run:
a point on a layer of its own, which keeps the place of the run in the drawing.

An entity that is unusual in any character stays in the text, and ezdxf reads and checks it. Unusual
are other kinds, other group codes, extrusions, names that are not ASCII, and invalid numbers.
"""

from __future__ import annotations

import re
from itertools import chain
from typing import Final

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import (
    compute_first_rows,
    find_run_starts,
    find_true_runs,
    list_range_numbers,
    measure_runs,
    number_rows,
)
from camgen.model.pose import FloatArray
from camgen.read.dxf.tags import LONGEST, LONGEST_NUMBER, Index, Mask, Tags, Texts, tabulate

LINE, ARC, CIRCLE = range(3)
#: Kinds by number.
KINDS: Final = ("LINE", "ARC", "CIRCLE")
#: Group codes of the numbers of each kind, by kind. The codes of one point are consecutive tags.
_GEOMETRY: Final = (
    ((10, 20, 30), (11, 21, 31)),
    ((10, 20, 30), (40,), (50,), (51,)),
    ((10, 20, 30), (40,)),
)
#: Kinds that belong to the entity before them.
_PARTS: Final = ("VERTEX", "ATTRIB", "SEQEND")

# Group codes.
_HANDLE, _TYPE, _LAYER, _COLOR = 5, 6, 8, 62
_MARKER, _OWNER, _WEIGHT, _TRUE_COLOR = 100, 330, 370, 420
_WHOLE = re.compile(rb" *-?\d+ *")
_HEX = re.compile(rb"[0-9A-Fa-f]+")
#: A backslash or a caret may start an escape, and other characters depend on the encoding.
_NAME = re.compile(
    rb"[^\x00-\x20\x7f-\xff\\^](?:[^\x00-\x1f\x7f-\xff\\^]*[^\x00-\x20\x7f-\xff\\^])?"
)
#: Group codes that a plain entity may have once besides its geometry: the longest value, in bytes,
#: and the pattern of a plain value.
_PROPERTIES: Final = {
    _HANDLE: (16, _HEX),
    _TYPE: (LONGEST, _NAME),
    _LAYER: (LONGEST, _NAME),
    _COLOR: (12, _WHOLE),
    _OWNER: (16, _HEX),
    _WEIGHT: (12, _WHOLE),
    _TRUE_COLOR: (12, _WHOLE),
}
#: An entity with more tags is not plain.
_MOST_TAGS = 30
#: Sequences of group codes that are tested per kind, the most frequent ones.
_MOST_SEQUENCES = 32
#: Entities of the shortest run that is taken out. A stand-in costs as much time as an entity.
LEAST = 16

_TAG = rb"\n[ \t]*%d[ \t]*\r?\n[ \t]*%b[ \t]*\r?"
_ENTITIES = re.compile(_TAG % (0, b"SECTION") + _TAG % (2, b"ENTITIES") + rb"\n")
_ENDSEC = re.compile(_TAG % (0, b"ENDSEC") + rb"\n")
#: (256,) whether each byte may be part of a number, and of a handle.
_IN_NUMBERS = np.isin(np.arange(256), np.frombuffer(b"0123456789+-.eE \0", np.uint8))
_IN_HANDLES = np.isin(np.arange(256), np.frombuffer(b"0123456789ABCDEFabcdef", np.uint8))


class PlainEntities(Struct, frozen=True, eq=False):
    """Columns of N plain entities in the order of the drawing.

    kind: (N,) index in `KINDS`.
    numbers: (N, 6) start and end of a line; center, radius, start and end angle of an arc or a
        circle. Drawing units and degrees.
    layer: (N,) index in `layers`.
    layers: names of layers.
    color: (N,) index in `colors`.
    colors: true color and color number as written, None if the entity has none.
    handles: (N,) handles, empty if the entity has none.
    owners: handles of the owners of the entities.
    """

    kind: Index
    numbers: FloatArray
    layer: Index
    layers: tuple[str, ...]
    color: Index
    colors: tuple[tuple[int | None, int | None], ...]
    handles: Texts
    owners: frozenset[str]


class Split(Struct, frozen=True, eq=False):
    """A drawing that is split into its plain entities and all others.

    text: the drawing with stand-ins in place of the plain entities.
    plain: the plain entities.
    runs: slice of the plain entities that a stand-in replaces, by the layer of the stand-in.
    """

    text: bytes
    plain: PlainEntities
    runs: dict[str, slice]


def split(data: bytes, least: int = LEAST) -> Split | None:
    """Take runs of plain entities out of the text `data` of a drawing.

    least: number of entities of the shortest run.

    Returns None if there is no such run, or if the text has 2 GB or more.
    """
    start = _ENTITIES.search(data)
    section = _find_section(data, start.end()) if start and len(data) < 2**31 else None
    tags = tabulate(data[section]) if section else None
    if section is None or tags is None or tags.code[0] != 0:
        return None
    columns = _find_plain(tags)
    # An entity that is followed by parts of it stays, since the parts stay.
    runs = find_true_runs((columns.kind >= 0) & ~np.append(tags.are(_PARTS)[1:], False))
    runs = runs[runs[:, 1] - runs[:, 0] >= least]
    return _cut(data, section, tags, columns, runs) if len(runs) else None


def _find_section(data: bytes, begin: int) -> slice | None:
    word = data.find(b"ENDSEC", begin)
    while word >= 0:
        # The pattern begins with the line feed two lines above the word. To search for the whole
        # pattern would take much longer, because it would be tried at every line.
        line = max(data.rfind(b"\n", begin - 1, word), begin - 1)
        before = data.rfind(b"\n", begin - 1, line)
        end = _ENDSEC.match(data, before) if before >= 0 else None
        if end:
            return slice(begin, end.start() + 1)
        word = data.find(b"ENDSEC", word + 1)
    return None


class _Columns(Struct, eq=False):
    """Columns of all E entities of a section.

    kind: (E,) index in `KINDS`, -1 for an entity that is not plain.
    numbers: (E, 6) as in `PlainEntities`.
    texts: (E,) values of each group code of `_PROPERTIES`, empty if the entity has none.
    """

    kind: Index
    numbers: FloatArray
    texts: dict[int, Texts]


def _find_plain(tags: Tags) -> _Columns:
    """The plain entities. All entities with the same sequence of group codes are tested together.

    A program that writes drawings uses few different sequences.
    """
    count = len(tags.head)
    texts = {code: np.zeros(count, f"S{widest}") for code, (widest, _) in _PROPERTIES.items()}
    columns = _Columns(np.full(count, -1), np.zeros((count, 6)), texts)
    # Sequences are compared by sums with random weights, which are almost never equal by chance.
    weights = np.random.default_rng(0).integers(1, 2**62, _MOST_TAGS, dtype=np.uint64)
    position = np.minimum(number_rows(tags.count), _MOST_TAGS - 1)
    key = np.add.reduceat((tags.code + 1).astype(np.uint64) * weights.take(position), tags.head)
    for kind, name in enumerate(KINDS):
        entities = np.flatnonzero(tags.are((name,)) & (tags.count <= _MOST_TAGS))
        entities = entities[np.argsort(key[entities], kind="stable")]
        bounds = np.append(find_run_starts(key[entities]), len(entities))
        frequent = np.argsort(-np.diff(bounds), kind="stable")[:_MOST_SEQUENCES]
        for k in frequent.tolist():
            _fill(columns, tags, kind, entities[bounds[k] : bounds[k + 1]])
    return columns


def _index_codes(kind: int, codes: list[int]) -> dict[int, int] | None:
    """Index of each group code in the sequence `codes` of an entity, without markers.

    Returns None if an entity with this sequence is not plain.
    """
    index_of = {code: k for k, code in enumerate(codes) if k and code != _MARKER}
    if len(index_of) < len(codes) - 1 - codes.count(_MARKER) or _LAYER not in index_of:
        return None
    allowed = set(_PROPERTIES)
    for group in _GEOMETRY[kind]:
        # A point without z has height 0.
        present = group if group[-1] in index_of else group[:2]
        first = index_of.get(present[0], -2)
        if [index_of.get(code) for code in present] != list(range(first, first + len(present))):
            return None
        allowed |= set(present)
    return index_of if allowed.issuperset(index_of) else None


def _fill(columns: _Columns, tags: Tags, kind: int, entities: Index) -> None:
    """Fill the columns of those of `entities` that are plain.

    entities: entities of one kind that probably have the same sequence of group codes. Entities
        with another sequence than the first one are skipped.
    """
    first = int(entities[0])
    codes = tags.code[tags.head[first] : tags.head[first] + tags.count[first]]
    index_of = _index_codes(kind, codes.tolist())
    if index_of is None:
        return
    entities = entities[tags.count[entities] == len(codes)]
    is_same = tags.code[tags.head[entities][:, None] + np.arange(len(codes))] == codes
    entities = entities[is_same.all(axis=1)]
    head = tags.head[entities]
    is_plain = np.ones(len(entities), np.bool_)
    numbers = np.zeros((len(entities), 6))
    for column, code in enumerate(chain(*_GEOMETRY[kind])):
        if code in index_of:
            texts = tags.values(head + index_of[code], LONGEST_NUMBER)
            numbers[:, column], is_number = _read_floats(texts)
            is_plain &= is_number
    if kind == CIRCLE:
        numbers[:, 5] = 360.0
    if kind != LINE:
        is_plain &= numbers[:, 3] > 0
    for code in _PROPERTIES.keys() & index_of.keys():
        widest, pattern = _PROPERTIES[code]
        texts = tags.values(head + index_of[code], widest)
        if code == _HANDLE:
            # All handles are different, so they are tested by their letters.
            length = np.strings.str_len(texts)
            letters = _IN_HANDLES[texts.view(np.uint8).reshape(len(texts), -1)]
            is_plain &= (length > 0) & (letters.sum(axis=1) == length)
        else:
            different, which = _find_different(texts)
            fits = [pattern.fullmatch(text) is not None for text in different.tolist()]
            is_plain &= np.array(fits, np.bool_)[which]
        columns.texts[code][entities] = texts
    columns.kind[entities[is_plain]] = kind
    columns.numbers[entities] = numbers


def _find_different(texts: Texts) -> tuple[Texts, Index]:
    """The different ones of `texts` (N,), sorted, and (N,) the index of each text among them.

    Most neighbours are equal, so only the first text of each run is compared.
    """
    counts = measure_runs(texts)
    different, which = np.unique(texts[compute_first_rows(counts)], return_inverse=True)
    return different, np.repeat(which, counts)


def _read_floats(texts: Texts) -> tuple[FloatArray, Mask]:
    """(N,) numbers, and whether each one is finite and in the usual spelling.

    Neighbours are often equal, such as heights and points in a row, so each run is read once.
    """
    counts = measure_runs(texts)
    texts = texts[compute_first_rows(counts)]
    letters = texts.view(np.uint8).reshape(len(texts), -1)
    try:
        numbers = texts.astype(np.float64)
    except ValueError:
        # Damage is left to `damage` and ezdxf, which find its place.
        numbers = np.full(len(texts), np.nan)
    is_number = _IN_NUMBERS[letters].all(axis=1) & np.isfinite(numbers)
    return np.repeat(numbers, counts), np.repeat(is_number, counts)


def _cut(data: bytes, section: slice, tags: Tags, columns: _Columns, runs: Index) -> Split:
    """The drawing with a stand-in for each of `runs`.

    runs: (R, 2) index of the first entity of each run, and of the entity after its last one.
    """
    name = b"CAMGEN-RUN-"
    while name in data:
        name += b"-"
    begin_of = section.start + np.append(tags.at[tags.head], section.stop - section.start)
    pieces: list[bytes] = []
    slices: dict[str, slice] = {}
    position = count = 0
    for run, (first, after) in enumerate(runs.tolist()):
        layer = b"%b%d" % (name, run)
        pieces += [data[position : begin_of[first]], _format_stand_in(columns, first, layer)]
        slices[layer.decode()] = slice(count, count + after - first)
        position = begin_of[after]
        count += after - first
    pieces.append(data[position:])
    rows = list_range_numbers(runs[:, 0], np.diff(runs)[:, 0])
    return Split(b"".join(pieces), _select_rows(columns, rows), slices)


def _format_stand_in(columns: _Columns, first: int, layer: bytes) -> bytes:
    text = b"0\nPOINT\n"
    for code in (_HANDLE, _OWNER):
        value = columns.texts[code][first]
        if value:
            text += b"%d\n%b\n" % (code, value)
    return text + b"8\n%b\n10\n0\n20\n0\n30\n0\n" % layer


def _select_rows(columns: _Columns, rows: Index) -> PlainEntities:
    layers, layer = _find_different(columns.texts[_LAYER][rows])
    true_colors, true_color = _find_different(columns.texts[_TRUE_COLOR][rows])
    numbers, number = _find_different(columns.texts[_COLOR][rows])
    pairs, color = np.unique(true_color * len(numbers) + number, return_inverse=True)
    colors = []
    for pair in pairs.tolist():
        first, second = true_colors[pair // len(numbers)], numbers[pair % len(numbers)]
        colors.append((int(first) if first else None, int(second) if second else None))
    owners, _ = _find_different(columns.texts[_OWNER][rows])
    return PlainEntities(
        kind=columns.kind[rows],
        numbers=columns.numbers[rows],
        layer=layer,
        layers=tuple(name.decode("ascii") for name in layers.tolist()),
        color=color,
        colors=tuple(colors),
        handles=columns.texts[_HANDLE][rows],
        owners=frozenset(owner.decode("ascii") for owner in owners.tolist()),
    )
