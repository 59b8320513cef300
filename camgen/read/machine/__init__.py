"""The settings of a controller: a saved `$$` listing of GRBL, or an INI file of LinuxCNC."""

from __future__ import annotations

import re

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.machine import Machine
from camgen.read.machine.grbl import SETTING, read_listing
from camgen.read.machine.linuxcnc import SECTION, read_ini

_LINE_END = re.compile(r"\r\n|\r|\n")


def read_machine(source: Source) -> Machine:
    """The machine that a file describes. The controller is recognised by the content of the file.

    Raises InputError for another file, and for values that are missing or impossible.
    """
    lines = _LINE_END.split(source.data.decode("utf-8-sig", "replace"))
    if any(map(SETTING.match, lines)):
        return read_listing(source.name, lines)
    if any(map(SECTION.match, lines)):
        return read_ini(source.name, lines)
    raise InputError(
        source.name,
        "is neither a listing of GRBL's settings nor an INI file of LinuxCNC",
        "cell.machine",
        "save what GRBL answers to $$, or name the .ini of the machine",
    )
