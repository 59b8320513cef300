"""The plain entities of a drawing, taken out of its text by column: lines, arcs and circles that say nothing unusual.

Large drawings are mostly long runs of them, and to make an object of each is most of what reading costs. ezdxf gets the
text with one stand-in for each run: a point on a layer of its own, so that the run keeps its place in the drawing.
Everything that is not plain to the last character stays in the text, and ezdxf reads and judges it as ever: other
kinds, other group codes, extrusions, names that are not ASCII, numbers that are none.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import begins, ramp, run_lengths, run_starts, stretches, true_runs
from camgen.model.pose import FloatArray
from camgen.read.dxf.tags import LONGEST, LONGEST_NUMBER, Index, Mask, Tags, Texts, tabulate

LINE, ARC, CIRCLE = range(3)
#: The kinds by number, and the group codes of their six numbers: points and what follows them stand together.
KINDS: Final = ("LINE", "ARC", "CIRCLE")
_GEOMETRY: Final = (
    ((10, 20, 30), (11, 21, 31)),
    ((10, 20, 30), (40,), (50,), (51,)),
    ((10, 20, 30), (40,)),
)
#: Kinds that belong to the entity before them.
_PARTS: Final = ("VERTEX", "ATTRIB", "SEQEND")

_HANDLE, _TYPE, _LAYER, _COLOR, _MARKER, _OWNER, _WEIGHT, _TRUE_COLOR = (
    5,
    6,
    8,
    62,
    100,
    330,
    370,
    420,
)
_WHOLE = re.compile(rb" *-?\d+ *")
_HEX = re.compile(rb"[0-9A-Fa-f]+")
#: A backslash or a caret may begin an escape, and what is not ASCII depends on the encoding.
_NAME = re.compile(
    rb"[^\x00-\x20\x7f-\xff\\^](?:[^\x00-\x1f\x7f-\xff\\^]*[^\x00-\x20\x7f-\xff\\^])?"
)
#: What may stand once beside the geometry: the most letters that are looked at, and what they are.
_BESIDE: Final = {
    _HANDLE: (16, _HEX), _TYPE: (LONGEST, _NAME), _LAYER: (LONGEST, _NAME), _COLOR: (12, _WHOLE), _OWNER: (16, _HEX),
    _WEIGHT: (12, _WHOLE), _TRUE_COLOR: (12, _WHOLE),
}  # fmt: skip
#: An entity with more tags is not plain.
_MOST_TAGS = 30
#: Of each kind so many sequences of group codes are looked at, the most frequent ones.
_MOST_SEQUENCES = 32
#: Shorter runs are left to ezdxf: a stand-in costs as much as an entity.
LEAST = 16

_TAG = rb"\n[ \t]*%d[ \t]*\r?\n[ \t]*%b[ \t]*\r?"
_ENTITIES = re.compile(_TAG % (0, b"SECTION") + _TAG % (2, b"ENTITIES") + rb"\n")
_ENDSEC = re.compile(_TAG % (0, b"ENDSEC") + rb"\n")
_OF_NUMBERS = np.isin(np.arange(256), np.frombuffer(b"0123456789+-.eE \0", np.uint8))
_OF_HANDLES = np.isin(np.arange(256), np.frombuffer(b"0123456789ABCDEFabcdef", np.uint8))


class PlainEntities(Struct, frozen=True, eq=False):
    """Columns of N plain entities in the order of the drawing, in its units and degrees.

    kind: (N,) of ``KINDS``. numbers: (N, 6), of a line its start and end, of the others center, radius, start and end.
    layer: (N,) of ``layers``. color: (N,) of ``colors``, true color and number as written. handles: (N,). owners: what
    is said to hold them.
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
    """A drawing without its plain entities. text: the rest, with stand-ins. runs: the layer of each stand-in, and the
    slice of the plain entities that it stands for.
    """

    text: bytes
    plain: PlainEntities
    runs: dict[str, slice]


def split(data: bytes, least: int = LEAST) -> Split | None:
    """``data`` of an ASCII drawing without its runs of at least so many plain entities; None if it has none."""
    start = _ENTITIES.search(data)
    section = _section(data, start.end()) if start and len(data) < 2**31 else None
    tags = tabulate(data[section]) if section else None
    if section is None or tags is None or tags.code[0] != 0:
        return None
    columns = _find(tags)
    # What follows must not belong to an entity that is no longer there.
    plain = (columns.kind >= 0) & ~np.append(tags.are(_PARTS)[1:], False)
    edges = true_runs(plain)
    edges = edges[edges[:, 1] - edges[:, 0] >= least]
    return _cut(data, section, tags, columns, edges) if len(edges) else None


def _section(data: bytes, begin: int) -> slice | None:
    """From ``begin`` to the end of the section; None if it has none."""
    place = data.find(b"ENDSEC", begin)
    while place >= 0:
        # A tag is two lines behind a line feed, and a search for all of that stops at every line.
        before = data.rfind(b"\n", begin - 1, max(data.rfind(b"\n", begin - 1, place), begin - 1))
        end = _ENDSEC.match(data, before) if before >= 0 else None
        if end:
            return slice(begin, end.start() + 1)
        place = data.find(b"ENDSEC", place + 1)
    return None


class _Columns(Struct, eq=False):
    """What is plain of E entities. kind: -1 where one is not. texts: by group code, empty where it is not said."""

    kind: Index
    numbers: FloatArray
    texts: dict[int, Texts]


def _find(tags: Tags) -> _Columns:
    """The plain entities, sequence of group codes by sequence of group codes: a writer has few of them."""
    count = len(tags.head)
    texts = {code: np.zeros(count, f"S{widest}") for code, (widest, _) in _BESIDE.items()}
    columns = _Columns(np.full(count, -1), np.zeros((count, 6)), texts)
    weights = np.random.default_rng(0).integers(1, 2**62, _MOST_TAGS, dtype=np.uint64)
    place = np.minimum(ramp(tags.count), _MOST_TAGS - 1)
    key = np.add.reduceat((tags.code + 1).astype(np.uint64) * weights.take(place), tags.head)
    for kind, name in enumerate(KINDS):
        of_kind = np.flatnonzero(tags.are((name,)) & (tags.count <= _MOST_TAGS))
        of_kind = of_kind[np.argsort(key[of_kind], kind="stable")]
        bounds = np.append(run_starts(key[of_kind]), len(of_kind))
        many = np.argsort(-np.diff(bounds), kind="stable")[:_MOST_SEQUENCES]
        for k in many.tolist():
            _fill(columns, tags, kind, of_kind[bounds[k] : bounds[k + 1]])
    return columns


def _places(kind: int, codes: list[int]) -> dict[int, int] | None:
    """Where each group code stands in the sequence, markers aside; None if such an entity is not plain."""
    rest = [code for code in codes[1:] if code != _MARKER]
    places = {code: k for k, code in enumerate(codes) if k and code != _MARKER}
    if len(places) < len(rest) or _LAYER not in places:
        return None
    known = set(_BESIDE)
    for group in _GEOMETRY[kind]:
        # A height that is not said is 0.
        said = group if group[-1] in places else group[:2]
        if [places.get(code, -1) - k for k, code in enumerate(said)] != [
            places.get(said[0], -2)
        ] * len(said):
            return None
        known |= set(said)
    return places if known.issuperset(places) else None


def _fill(columns: _Columns, tags: Tags, kind: int, entities: Index) -> None:
    """The columns of ``entities`` of one kind that have the sequence of group codes of the first, if that is plain, and
    as far as their values are.
    """
    first = int(entities[0])
    codes = tags.code[tags.head[first] : tags.head[first] + tags.count[first]]
    places = _places(kind, codes.tolist())
    if places is None:
        return
    entities = entities[tags.count[entities] == len(codes)]
    same = tags.code[tags.head[entities][:, None] + np.arange(len(codes))] == codes
    entities = entities[same.all(axis=1)]
    head = tags.head[entities]
    good = np.ones(len(entities), np.bool_)
    numbers = np.zeros((len(entities), 6))
    for k, code in enumerate(code for group in _GEOMETRY[kind] for code in group):
        if code in places:
            numbers[:, k], sound = _floats(tags.values(head + places[code], LONGEST_NUMBER))
            good &= sound
    if kind == CIRCLE:
        numbers[:, 5] = 360.0
    if kind != LINE:
        good &= numbers[:, 3] > 0
    for code in _BESIDE.keys() & places.keys():
        widest, pattern = _BESIDE[code]
        found = tags.values(head + places[code], widest)
        if code == _HANDLE:
            # No two are alike.
            letters = _OF_HANDLES[found.view(np.uint8).reshape(len(found), -1)]
            good &= (np.strings.str_len(found) > 0) & (
                letters.sum(axis=1) == np.strings.str_len(found)
            )
        else:
            different, which = _different(found)
            good &= np.array(
                [pattern.fullmatch(text) is not None for text in different.tolist()], np.bool_
            )[which]
        columns.texts[code][entities] = found
    columns.kind[entities[good]] = kind
    columns.numbers[entities] = numbers


def _different(texts: Texts) -> tuple[Texts, Index]:
    """The different ones of ``texts`` (N,), in order, and which of them each is. Neighbours are mostly alike."""
    counts = run_lengths(texts)
    different, which = np.unique(texts[begins(counts)], return_inverse=True)
    return different, np.repeat(which, counts)


def _floats(texts: Texts) -> tuple[FloatArray, Mask]:
    """(N,) The numbers, and which of them are finite and written as such. Neighbours are often alike: heights, rows."""
    counts = run_lengths(texts)
    texts = texts[begins(counts)]
    letters = texts.view(np.uint8).reshape(len(texts), -1)
    try:
        numbers = texts.astype(np.float64)
    except ValueError:
        # Damage: ezdxf finds out where, and how much of it can be read.
        numbers = np.full(len(texts), np.nan)
    sound = _OF_NUMBERS[letters].all(axis=1) & np.isfinite(numbers)
    return np.repeat(numbers, counts), np.repeat(sound, counts)


def _cut(data: bytes, section: slice, tags: Tags, columns: _Columns, edges: Index) -> Split:
    """The drawing without the entities of ``edges`` (R, first and one after the last), each run with its stand-in."""
    name = b"CAMGEN-RUN-"
    while name in data:
        name += b"-"
    bounds = section.start + np.append(tags.at[tags.head], section.stop - section.start)[edges]
    pieces, runs, kept, taken = [], {}, 0, 0
    for run, ((first, after), (begin, end)) in enumerate(
        zip(edges.tolist(), bounds.tolist(), strict=True)
    ):
        layer = b"%b%d" % (name, run)
        said = b"".join(
            b"%d\n%b\n" % (code, text)
            for code in (_HANDLE, _OWNER)
            if (text := columns.texts[code][first])
        )
        pieces += [data[kept:begin], b"0\nPOINT\n%b8\n%b\n10\n0\n20\n0\n30\n0\n" % (said, layer)]
        runs[layer.decode()] = slice(taken, taken + after - first)
        kept, taken = end, taken + after - first
    pieces.append(data[kept:])
    return Split(
        b"".join(pieces), _take(columns, stretches(edges[:, 0], np.diff(edges)[:, 0])), runs
    )


def _take(columns: _Columns, rows: Index) -> PlainEntities:
    layers, layer = _different(columns.texts[_LAYER][rows])
    (trues, true), (numbers, number) = (
        _different(columns.texts[code][rows]) for code in (_TRUE_COLOR, _COLOR)
    )
    colors, color = np.unique(true * len(numbers) + number, return_inverse=True)
    said = [(trues[k // len(numbers)], numbers[k % len(numbers)]) for k in colors.tolist()]
    owners, _ = _different(columns.texts[_OWNER][rows])
    return PlainEntities(
        kind=columns.kind[rows],
        numbers=columns.numbers[rows],
        layer=layer,
        layers=tuple(name.decode("ascii") for name in layers.tolist()),
        color=color,
        colors=tuple(
            (int(true) if true else None, int(aci) if aci else None) for true, aci in said
        ),
        handles=columns.texts[_HANDLE][rows],
        owners=frozenset(owner.decode("ascii") for owner in owners.tolist()),
    )
