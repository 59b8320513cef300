"""DXF drawings, ASCII and binary, R12 to R2018: the curves of model space as contours, or as curves in space.

``docs/inputs/dxf.md`` tells what is used, how ends are joined and what each note means.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from io import BytesIO, TextIOWrapper
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from camgen.model.errors import InputError, one_line
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Contour, Curve, Note, Part
from camgen.model.pose import FloatArray
from camgen.model.text import counted, harmless, short
from camgen.read import join, space, units
from camgen.read.colors import count_colors
from camgen.read.dxf.entities import REPAIRED, DrawnEntities, walk
from camgen.read.dxf.flatten import FLAT_MM, Flat, flatten
from camgen.read.dxf.in_space import place_in_space
from camgen.read.dxf.layers import NOT_ASKED, layers_of
from camgen.read.dxf.plain import Split, split
from camgen.read.files import Files
from camgen.read.open_outlines import find_open_outlines
from camgen.read.pieces import tally
from camgen.read.quiet import silence

if TYPE_CHECKING:
    from ezdxf.document import Drawing


# The bytes of a DXF file as an ezdxf document: strictly first, then tolerantly, with a note on what was wrong.

_BINARY = b"AutoCAD Binary DXF\r\n\x1a\x00"
_END = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*EOF\b")
_TAIL = 256
_SECTION = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*SECTION\b")
_SAVE_AGAIN = "open it in the CAD program and save it again as DXF"

#: ezdxf parses whatever it is given: besides its own errors (which are not all ValueErrors) a damaged file makes it
#: stumble over missing values in each of these ways.
_STUMBLES = (
    ValueError, TypeError, LookupError, StopIteration, AttributeError, ArithmeticError, AssertionError, RecursionError,
    struct.error, EOFError,
)  # fmt: skip


class _Loaded(Struct, frozen=True):
    """The document without what ``plain`` has taken out of it, and notes on damage."""

    document: Drawing
    plain: Split | None
    notes: tuple[Note, ...]


def _load(name: str, data: bytes) -> _Loaded:
    """``InputError`` if the bytes are no DXF or damaged beyond repair."""
    # Heavy, and not needed unless a DXF is read.
    from ezdxf import recover  # noqa: PLC0415
    from ezdxf.document import Drawing  # noqa: PLC0415
    from ezdxf.filemanagement import read  # noqa: PLC0415
    from ezdxf.lldxf.const import DXFError  # noqa: PLC0415
    from ezdxf.lldxf.tagger import binary_tags_loader  # noqa: PLC0415

    data = _with_line_feeds(data)
    _insist_on_dxf(name, data)
    silence("ezdxf")
    notes: list[Note] = []
    binary = data.startswith(_BINARY)
    # At the end of most files; what a program has written behind it is rare and costs a look at everything.
    if not (
        b"\x00EOF\x00" in data
        if binary
        else _END.search(data, max(0, len(data) - _TAIL)) or _END.search(data)
    ):
        notes.append(
            Note("skipped", "the file ends before its end mark", "what would follow is lost")
        )
        data = data if binary else _close_ends(data)
    plain = None if binary else split(data)
    document = plain and _load_rest(plain)
    if document:
        return _Loaded(document, plain, tuple(notes))
    try:
        document = Drawing.load(binary_tags_loader(data)) if binary else read(_text(data))
        # Damaged OBJECTS cost a document its model space, which shows only when it is asked for.
        document.modelspace()
        return _Loaded(document, None, tuple(notes))
    except (DXFError, *_STUMBLES) as error:
        cause = _plain(error)
        if binary:
            # The tolerant reader of ezdxf takes text only.
            raise InputError(
                name, f"damaged beyond repair: {cause}", "binary DXF", _SAVE_AGAIN
            ) from error
    try:
        document, auditor = recover.read(BytesIO(data))
        document.modelspace()
    except (DXFError, *_STUMBLES) as error:
        raise InputError(
            name, f"damaged beyond repair: {_plain(error)}", "", _SAVE_AGAIN
        ) from error
    count = len(auditor.fixes) + len(auditor.errors)
    mended = f" and was read tolerantly, {counted(count, 'fault')} mended" if count else ""
    notes.append(
        Note(
            "repaired",
            f"the file is damaged{mended}: {cause}",
            f"compare the contours, or {_SAVE_AGAIN}",
        )
    )
    return _Loaded(document, None, tuple(notes))


def _load_rest(plain: Split) -> Drawing | None:
    """The document without its plain entities; None where ezdxf is to see all of the text: because it is damaged, and
    the message names a line, because the plain entities are on paper, which is decided by who is said to own them, or
    because a stand-in is not where it was put, as where a second section replaces the first.
    """
    from ezdxf.filemanagement import read  # noqa: PLC0415
    from ezdxf.lldxf.const import DXFError  # noqa: PLC0415

    try:
        document = read(_text(plain.text))
        points = [point.dxf.layer for point in document.modelspace().query("POINT")]
    except (DXFError, *_STUMBLES):
        return None
    if [layer for layer in points if layer in plain.runs] != list(plain.runs):
        return None
    paper = document.block_records.get("*Paper_Space")
    return None if paper is not None and paper.dxf.handle in plain.plain.owners else document


def _with_line_feeds(data: bytes) -> bytes:
    """The text with line feeds where lines end in carriage returns alone, as on the old Macintosh."""
    return data if data.startswith(_BINARY) or b"\n" in data else data.replace(b"\r", b"\n")


def _insist_on_dxf(name: str, data: bytes) -> None:
    if not data.strip():
        raise InputError(name, "the file is empty")
    if re.match(rb"AC1\d{3}|AC\d\.\d", data):
        raise InputError(name, "is a DWG drawing", "", "save it as DXF")
    if not data.startswith(_BINARY) and not _SECTION.search(data):
        raise InputError(name, "is not a DXF file", "no section in it")


def _close_ends(data: bytes) -> bytes:
    """A text that is cut short up to its last whole entity, with the marks that close it."""
    lines = data.splitlines()
    starts = [i for i in range(0, len(lines), 2) if lines[i].strip() == b"0"]
    return b"\n".join([*lines[: starts[-1] if starts else 0], b"0", b"ENDSEC", b"0", b"EOF", b""])


def _text(data: bytes) -> TextIOWrapper:
    """The text in the encoding its header names."""
    from ezdxf.filemanagement import dxf_stream_info  # noqa: PLC0415

    info = dxf_stream_info(TextIOWrapper(BytesIO(data), "utf-8", errors="ignore"))
    return TextIOWrapper(BytesIO(data), info.encoding, errors="surrogateescape")


def _plain(error: Exception) -> str:
    # An entity without a handle is named by where it lies in memory.
    text = re.sub(r"\(#\d{9,}\)", "", one_line(str(error))).strip().rstrip(".")
    if isinstance(error, KeyError):
        text = f"no entry {text}"
    return text[:120] if text else type(error).__name__


#: So many curves out of the plane are named one by one, the rest is counted.
_NAMED = 5
#: Layers that every document has, whether the file names them or not.
_ALWAYS = {"0", "defpoints"}


class LayerFacts(Struct, frozen=True):
    """A layer: name, state ("used", or why not) and how many entities of each kind it has, blocks expanded."""

    name: str
    state: str
    counts: tuple[tuple[str, int], ...]


class DxfFacts(Struct, frozen=True):
    """What is in a DXF file; its ``str`` is a page to print.

    closed and open: contours after joining; space: curves that leave the plane; colors: of contours, where they have
    several; size: mm; notes as of ``read``.
    """

    version: str
    units: str
    layers: tuple[LayerFacts, ...]
    counts: tuple[tuple[str, int], ...]
    closed: int
    open: int
    space: int
    size: tuple[float, ...]
    notes: tuple[Note, ...]
    colors: str = ""

    def __str__(self) -> str:
        width, height = (short(v, 3) for v in self.size[:2])
        lines = [
            f"DXF {self.version}, units {self.units}, used part {width} x {height} mm",
            f"entities: {_list_counts(self.counts)}",
            f"contours: {self.closed} closed, {self.open} open"
            + (f"; {counted(self.space, 'curve')} in space" if self.space else ""),
            *(
                f"layer {layer.name}: {layer.state}; {_list_counts(layer.counts)}"
                for layer in self.layers
            ),
            *filter(None, [self.colors]),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


class _Read(Struct, frozen=True):
    version: str
    units: str
    drawn: DrawnEntities
    contours: tuple[Contour, ...]
    curves: tuple[Curve, ...]
    space: int
    size: tuple[float, ...]
    about_file: tuple[Note, ...]
    left: tuple[Note, ...]

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.about_file + self.left


def read(source: Source, job: Job, _files: Files) -> Part:
    """The drawing in ``source``, read with ``[input]``; ellipses and splines within ``tolerance.chord``.

    Where a curve leaves the plane and is to be traced, off any page, all of the drawing is read as curves in space.
    ``InputError`` if it cannot be read or holds nothing to machine, ``JobError`` for unknown units or layers.
    """
    name = source.name
    found = _read(source, job)
    if not found.contours and not found.curves:
        damage = [n.what for n in found.about_file if n.kind in {"repaired", "skipped", "warning"}]
        left = "; ".join([*damage, *(f"{n.what}: {n.why}" for n in found.left)])
        raise InputError(
            name,
            "nothing to machine",
            left or "the drawing is empty",
            "draw curves on a visible layer",
        )
    return Part(
        source.stem,
        name,
        found.units,
        found.contours,
        found.notes,
        curves=found.curves,
        open_outlines=find_open_outlines(found.contours, job),
    )


def inspect(source: Source, job: Job, _files: Files) -> DxfFacts:
    """What is in the drawing. ``InputError`` if it cannot be read, ``JobError`` as for ``read``."""
    found = _read(source, job)
    drawn = found.drawn
    kinds: Counter[str] = Counter()
    by_layer: dict[str, Counter[str]] = {name: Counter() for name in drawn.layers.names}
    for (kind, layer), count in drawn.met.items():
        kinds[kind] += count
        by_layer.setdefault(layer.casefold(), Counter())[kind] += count
    layers = tuple(
        LayerFacts(
            harmless(drawn.layers.names[key]),
            drawn.layers.why_not(drawn.layers.names[key]) or "used",
            counts,
        )
        for key, counts in ((key, tuple(sorted(by_layer[key].items()))) for key in sorted(by_layer))
        if counts or key not in _ALWAYS
    )
    closed = sum(c.closed for c in found.contours)
    return DxfFacts(
        version=found.version,
        units=found.units,
        layers=layers,
        counts=tuple(sorted(kinds.items())),
        closed=closed,
        open=len(found.contours) - closed,
        space=found.space,
        size=found.size,
        notes=found.notes,
        colors=count_colors([c.color for c in found.contours]),
    )


def _read(source: Source, job: Job) -> _Read:
    name, data, settings, chord = source.name, source.data, job.input, job.tolerance.chord
    loaded = _load(name, data)
    document, notes = loaded.document, loaded.notes
    version = f"{document.dxfversion} ({document.acad_release})"
    unit, scale, unit_notes = units.resolve(name, settings.units, *_state(name, document, data))
    layers = layers_of(document, settings.layers)
    contours: tuple[Contour, ...] = ()
    curves: tuple[Curve, ...] = ()
    # Damaged files hold infinities; what comes of them is found and told by name.
    with np.errstate(invalid="ignore", over="ignore"):
        drawn = walk(name, document, loaded.plain, scale, layers, source.limits)
        layers.check(name)
        # The document is the largest thing in memory and no longer needed.
        del document, loaded
        flat = flatten(drawn, chord)
        if flat.tilted and _is_meant_in_space(job):
            curves, joints = space.curves(
                place_in_space(name, drawn, chord, source.limits), settings.join
            )
            left = (
                *_left(drawn),
                *_take(drawn),
                *joints,
                *([space.tell_which(curves)] if curves else []),
            )
        else:
            contours, joints = join.contours(flat.soup, settings.join, job.chooses_colors)
            left = (*_left(drawn), *_not_flat(drawn, flat), *_level(flat), *_take(drawn), *joints)
    rows = [c.points for c in contours] + [c.points for c in curves]
    size = _size(rows)
    doubts = (
        units.doubts(size, unit, name) if rows and settings.units.strip().lower() == "auto" else ()
    )
    about_file = (*notes, *unit_notes, *doubts)
    return _Read(
        version, unit, drawn, contours, curves, len(flat.tilted), size[:2], about_file, left
    )


def _is_meant_in_space(job: Job) -> bool:
    """Whether curves that leave the plane are to be followed: a page is flat, and so is all but tracing."""
    return job.operation.kind == "trace" and not job.page.size


def _state(name: str, document: Drawing, data: bytes) -> tuple[int, int | None]:
    """$INSUNITS (0: none) and $MEASUREMENT of the header, None if there is none.

    ezdxf fills a header that is missing with defaults (metres), hence the look at the bytes.
    """
    found: list[int | None] = []
    for key in ("$INSUNITS", "$MEASUREMENT"):
        value = document.header.get(key, 0) if key.encode() in data else None
        try:
            found.append(None if value is None else int(value))
        except ValueError as error:
            remedy = "save it again from the CAD program, or mend the header"
            raise InputError(
                name, f"is damaged: {str(value)[:20]!r} is no number", key, remedy
            ) from error
    insunits, measurement = found
    return insunits or 0, measurement


def _size(rows: list[FloatArray]) -> tuple[float, ...]:
    """Along the axes, over all points (N, D), mm."""
    return tuple(np.ptp(np.concatenate(rows), axis=0).tolist()) if rows else (0.0, 0.0)


def _list_counts(counts: tuple[tuple[str, int], ...]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts) or "none"


def _count(counts: Counter[tuple[str, str]]) -> str:
    return tally([kind for kind, _ in counts.elements()], [layer for _, layer in counts])


def _left(drawn: DrawnEntities) -> list[Note]:
    """One note per reason for which entities were not used."""
    notes = []
    for why, counts in drawn.left.items():
        if why == NOT_ASKED:
            notes.append(Note("assumed", f"not used: {_count(counts)}", why))
        elif why in REPAIRED:
            notes.append(Note("repaired", f"dropped: {_count(counts)}", why))
        else:
            notes.append(Note("skipped", _count(counts), why))
    return notes


def _not_flat(drawn: DrawnEntities, flat: Flat) -> list[Note]:
    """Notes on curves that leave the plane, by name, and on those whose numbers make no curve."""
    notes = []
    if flat.damaged:
        what = tally([drawn.kind[i] for i in flat.damaged], [drawn.layer[i] for i in flat.damaged])
        notes.append(Note("skipped", what, "damaged numbers"))
    if flat.tilted:
        named = [
            f"{_name(drawn, i)} on layer {harmless(drawn.layer[i])} leaves the plane by {short(height, 3)} mm"
            for i, height in sorted(flat.tilted.items())[:_NAMED]
        ]
        more = len(flat.tilted) - len(named)
        what = "; ".join(named) + (f"; and {more} more" if more else "")
        why = "curves must be flat and parallel to the XY plane; nothing is projected"
        notes.append(
            Note("skipped", what, f'{why}; operation.kind = "trace" follows them in space')
        )
    return notes


def _name(drawn: DrawnEntities, owner: int) -> str:
    """A kind with its handle, where the file gives it one."""
    handle = drawn.handle[owner]
    return f"{drawn.kind[owner]} #{harmless(handle)}" if handle else drawn.kind[owner]


def _level(flat: Flat) -> list[Note]:
    """A note on heights, which a flat drawing has none of."""
    notes = []
    heights = flat.heights[np.isfinite(flat.heights)]
    low, high = float(heights.min(initial=0.0)), float(heights.max(initial=0.0))
    if max(-low, high) > FLAT_MM:
        low, high = float(heights.min()), float(heights.max())
        at = short(low, 3) if high - low <= FLAT_MM else f"{short(low, 3)} to {short(high, 3)}"
        notes.append(
            Note("assumed", f"curves drawn at z = {at} mm", "taken as lying in the work plane")
        )
    return notes


def _take(drawn: DrawnEntities) -> list[Note]:
    """Notes on what was taken for something simpler: thickness, widths."""
    notes = []
    if drawn.flattened:
        notes.append(
            Note(
                "assumed", f"with thickness: {_count(drawn.flattened)}", "the curve itself is used"
            )
        )
    if drawn.widths:
        notes.append(
            Note("assumed", f"with width: {_count(drawn.widths)}", "the centre line is used")
        )
    return notes
