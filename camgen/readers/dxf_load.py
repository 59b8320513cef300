"""The bytes of a DXF file as an ezdxf document: strictly first, then tolerantly, with a note on what was wrong."""

from __future__ import annotations

import logging
import re
import struct
from io import BytesIO, TextIOWrapper
from typing import TYPE_CHECKING

from camgen.errors import InputError, one_line
from camgen.shapes import Note

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_BINARY = b"AutoCAD Binary DXF\r\n\x1a\x00"
_END = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*EOF\b")
_TAIL = 256
_SECTION = re.compile(rb"(?:^|\n)[ \t]*0[ \t]*\r?\n[ \t]*SECTION\b")
_QUIET = logging.NullHandler()
_SAVE_AGAIN = "open it in the CAD program and save it again as DXF"

#: ezdxf parses whatever it is given: besides its own errors (which are not all ValueErrors) a damaged file makes it
#: stumble over missing values in each of these ways.
_STUMBLES = (
    ValueError, TypeError, LookupError, StopIteration, AttributeError, ArithmeticError, AssertionError, RecursionError,
    struct.error, EOFError,
)  # fmt: skip


def load(name: str, data: bytes) -> tuple[Drawing, tuple[Note, ...]]:
    """The document and notes on damage. ``InputError`` if the bytes are no DXF or damaged beyond repair."""
    # Heavy, and not needed unless a DXF is read.
    from ezdxf import recover  # noqa: PLC0415
    from ezdxf.document import Drawing  # noqa: PLC0415
    from ezdxf.filemanagement import read  # noqa: PLC0415
    from ezdxf.lldxf.const import DXFError  # noqa: PLC0415
    from ezdxf.lldxf.tagger import binary_tags_loader  # noqa: PLC0415

    _insist_on_dxf(name, data)
    # Without a handler of its own ezdxf's warnings would end up on stderr.
    logging.getLogger("ezdxf").addHandler(_QUIET)
    notes: list[Note] = []
    binary = data.startswith(_BINARY)
    # At the end of most files; what a program has written behind it is rare and costs a look at everything.
    if not (b"\x00EOF\x00" in data if binary else _END.search(data, max(0, len(data) - _TAIL)) or _END.search(data)):
        notes.append(Note("skipped", "the file ends before its end mark", "what would follow is lost"))
        data = data if binary else _ended(data)
    try:
        document = Drawing.load(binary_tags_loader(data)) if binary else read(_text(data))
        # Damaged OBJECTS cost a document its model space, which shows only when it is asked for.
        document.modelspace()
        return document, tuple(notes)
    except (DXFError, *_STUMBLES) as error:
        cause = _plain(error)
        if binary:
            # The tolerant reader of ezdxf takes text only.
            raise InputError(name, f"damaged beyond repair: {cause}", "binary DXF", _SAVE_AGAIN) from error
    try:
        document, auditor = recover.read(BytesIO(data))
        document.modelspace()
    except (DXFError, *_STUMBLES) as error:
        raise InputError(name, f"damaged beyond repair: {_plain(error)}", "", _SAVE_AGAIN) from error
    count = len(auditor.fixes) + len(auditor.errors)
    what = f"the file is damaged and was read tolerantly, {count} faults mended" if count else "the file is damaged"
    notes.append(Note("repaired", f"{what}: {cause}", f"compare the contours, or {_SAVE_AGAIN}"))
    return document, tuple(notes)


def _insist_on_dxf(name: str, data: bytes) -> None:
    if not data.strip():
        raise InputError(name, "the file is empty")
    if re.match(rb"AC1\d{3}|AC\d\.\d", data):
        raise InputError(name, "is a DWG drawing", "", "save it as DXF")
    if not data.startswith(_BINARY) and not _SECTION.search(data):
        raise InputError(name, "is not a DXF file", "no section in it")


def _ended(data: bytes) -> bytes:
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
