"""The bytes of a DXF file as an ezdxf document, and notes on damage."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from io import BytesIO, TextIOWrapper

from ezdxf import recover
from ezdxf.document import Drawing
from ezdxf.filemanagement import dxf_stream_info, read
from ezdxf.lldxf.const import DXFError
from ezdxf.lldxf.tagger import binary_tags_loader

from camgen.model.errors import InputError, make_one_line
from camgen.model.part import Note
from camgen.model.text import counted, harmless
from camgen.read.dxf.damage import SAVE_AGAIN, repair
from camgen.read.dxf.plain import Split, split
from camgen.read.quiet import silence

_BINARY = b"AutoCAD Binary DXF\r\n\x1a\x00"
_END = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*EOF\b[^\n]*\n?")
#: Bytes at the end of a file in which its end mark mostly is.
_TAIL = 256
_SECTION = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*SECTION\b")
#: Kinds that belong to the entity before them.
_PARTS = frozenset({b"VERTEX", b"ATTRIB", b"SEQEND"})
#: Messages of ezdxf about an entity that it left out.
_REMOVED = re.compile(r"(?:removed|deleted) (?:entity )?(\w+\(#?\w+\))", re.IGNORECASE)
#: Faults that a note lists.
_LISTED = 5

#: Exceptions of ezdxf at a damaged file. Some of its own are not DXFErrors.
_LOAD_ERRORS = (
    DXFError, ValueError, TypeError, LookupError, StopIteration, AttributeError, ArithmeticError,
    AssertionError, RecursionError, struct.error, EOFError,
)  # fmt: skip


def load_document(name: str, data: bytes) -> tuple[Drawing, Split | None, tuple[Note, ...]]:
    """The document in the bytes of the file `name`, its plain entities, and notes on damage.

    Plain entities were taken out of the document by column; None without any.

    Raises InputError for other formats, and for damage beyond repair.
    """
    if not data.startswith(_BINARY) and b"\n" not in data:
        # Old Macintoshs end lines in carriage returns alone.
        data = data.replace(b"\r", b"\n")
    _check_format(name, data)
    silence("ezdxf")
    if data.startswith(_BINARY):
        document, notes = _load_binary(name, data)
        return document, None, notes
    data, notes = _cut_end(data)
    plain = split(data)
    # Line numbers of damage are those of the whole text.
    repaired = repair(name, plain.text if plain else data)
    if repaired and plain:
        plain, repaired = None, repair(name, data)
    if repaired:
        data, repairs = repaired
        notes += repairs
    rest = plain and _load_rest(plain)
    if rest:
        return rest, plain, notes
    document, faults = _load_text(name, data)
    return document, None, notes + faults


def _load_binary(name: str, data: bytes) -> tuple[Drawing, tuple[Note, ...]]:
    notes = () if b"\x00EOF\x00" in data else (_CUT,)
    try:
        document = Drawing.load(binary_tags_loader(data))
        # Damaged objects cost a document its model space, which shows only on access.
        document.modelspace()
    except _LOAD_ERRORS as error:
        # The tolerant reader of ezdxf takes text only.
        raise InputError(
            name, f"damaged beyond repair: {_format(error)}", "binary DXF", SAVE_AGAIN
        ) from error
    return document, notes


def _load_text(name: str, data: bytes) -> tuple[Drawing, tuple[Note, ...]]:
    try:
        document = read(_decode(data))
        document.modelspace()
        return document, ()
    except _LOAD_ERRORS as error:
        cause = _format(error)
    try:
        document, auditor = recover.read(BytesIO(data))
        document.modelspace()
    except _LOAD_ERRORS as error:
        raise InputError(
            name, f"damaged beyond repair: {_format(error)}", "", SAVE_AGAIN
        ) from error
    faults = [fault.message for fault in (*auditor.fixes, *auditor.errors)]
    return document, tuple(_note_faults(cause, faults))


def _note_faults(cause: str, faults: list[str]) -> Iterator[Note]:
    what = f"the file is damaged: {cause}"
    if faults:
        count = counted(len(faults), "fault")
        what = f"the file is damaged and was read tolerantly, {count} repaired: {cause}"
    yield Note("repaired", what, f"compare the contours, or {SAVE_AGAIN}")
    for fault in faults:
        match = _REMOVED.match(fault)
        if match:
            entity = match[1].replace("(#", " #").rstrip(")")
            yield Note("skipped", entity, harmless(fault, 120))


def _load_rest(plain: Split) -> Drawing | None:
    """The document without its plain entities.

    Returns None if ezdxf has to read all of the text: because it is damaged, and the message
    names a line; because the plain entities are on paper, which depends on their owner; or because
    a stand-in is not where it was put, as where a second section replaces the first.
    """
    try:
        document = read(_decode(plain.text))
        layers = [point.dxf.layer for point in document.modelspace().query("POINT")]
    except _LOAD_ERRORS:
        return None
    if [layer for layer in layers if layer in plain.runs] != list(plain.runs):
        return None
    paper = document.block_records.get("*Paper_Space")
    if paper is not None and paper.dxf.handle in plain.plain.owners:
        return None
    return document


def _check_format(name: str, data: bytes) -> None:
    if not data.strip():
        raise InputError(name, "the file is empty")
    if re.match(rb"AC1\d{3}|AC\d\.\d", data):
        raise InputError(name, "is a DWG drawing", "", "save it as DXF")
    if not data.startswith(_BINARY) and not _SECTION.search(data):
        raise InputError(name, "is not a DXF file", "no section in it")


#: A file without its end mark.
_CUT = Note("skipped", "the file ends before its end mark", "what would follow is lost")


def _cut_end(data: bytes) -> tuple[bytes, tuple[Note, ...]]:
    """A text up to its end mark; without one, up to its last whole entity, with a note."""
    end = _END.search(data, max(0, len(data) - _TAIL)) or _END.search(data)
    if end is None:
        return _close_ends(data), (_CUT,)
    return data[: end.end()], ()


def _close_ends(data: bytes) -> bytes:
    """A text that is cut short up to its last whole entity, with the marks that close it."""
    lines = data.splitlines()
    starts = [k for k in range(0, len(lines) - 1, 2) if lines[k].strip() == b"0"]
    # A polyline of which vertices are lost is not whole.
    while len(starts) > 1 and lines[starts[-1] + 1].strip() in _PARTS:
        starts.pop()
    return b"\n".join([*lines[: max(starts, default=0)], b"0", b"ENDSEC", b"0", b"EOF", b""])


def _decode(data: bytes) -> TextIOWrapper:

    info = dxf_stream_info(TextIOWrapper(BytesIO(data), "utf-8", errors="ignore"))
    return TextIOWrapper(BytesIO(data), info.encoding, errors="surrogateescape")


def _format(error: Exception) -> str:
    # An entity without a handle is named by its address in memory.
    text = re.sub(r"\(#\d{9,}\)", "", make_one_line(str(error))).strip().rstrip(".")
    if isinstance(error, KeyError):
        text = f"no entry {text}"
    return text[:120] if text else type(error).__name__
