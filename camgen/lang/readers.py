"""The readers of old programs, as the entry points name them.

All readers are asked about each input, so the interpreters are imported when they are needed.
"""

from __future__ import annotations

from importlib import import_module

from camgen.lang.gcode_text import SUFFIXES, is_gcode
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.read import Reader
from camgen.read.files import Files
from camgen.read.formats import call_late

GCODE = Reader(
    name="gcode",
    about="G-code",
    suffixes=SUFFIXES,
    makes="program",
    read=call_late("camgen.lang.gcode", "read"),
    inspect=call_late("camgen.lang.gcode", "inspect"),
    recognise=lambda head: is_gcode(
        head.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    ),
)


def _make_reader(name: str, about: str, suffixes: tuple[str, ...]) -> Reader:
    """The reader of programs of robots in the language ``name``."""

    def read(source: Source, job: Job, _files: Files) -> Part:
        part: Part = import_module("camgen.lang.taught").read(source, job, name)
        return part

    def inspect(source: Source, _job: Job, _files: Files) -> object:
        facts: object = import_module("camgen.lang.taught").inspect(source, name)
        return facts

    return Reader(name, about, suffixes, "program", read, inspect)


RAPID = _make_reader("rapid", "a RAPID module", (".mod", ".modx", ".prg", ".sys", ".sysx"))
VPLUS = _make_reader("vplus", "a V+ program", (".v2", ".pg", ".vp"))
PACSCRIPT = _make_reader("pacscript", "a PacScript program", (".pcs", ".pac"))
