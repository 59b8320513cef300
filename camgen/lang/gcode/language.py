"""G-code as two languages of controllers: LinuxCNC and its relatives, and GRBL."""

from __future__ import annotations

from collections.abc import Mapping

from camgen.lang.gcode.dialects import DIALECTS, GRBL, Dialect
from camgen.lang.gcode_text import SUFFIXES, is_gcode
from camgen.lang.programs import Executed, Language, RunRequest


def run_gcode(
    files: Mapping[str, str], request: RunRequest, usual: Dialect | None = None
) -> Executed:
    """Runs G-code in the dialect of the request, else in `usual` or the one that the text shows."""
    if request.options is not None:
        from camgen.lang.gcode.strict_posts import read_linuxcnc  # noqa: PLC0415 (a read-back)

        return read_linuxcnc(files, request.options)
    from camgen.lang.gcode.run import run  # noqa: PLC0415 (only for programs of others)

    return run(files, request, usual)


def run_grbl(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Runs G-code in the dialect of the request, else as GRBL does."""
    if request.options is not None:
        from camgen.lang.gcode.strict_posts import read_grbl  # noqa: PLC0415 (a read-back)

        return read_grbl(files, request.options)
    return run_gcode(files, request, GRBL)


GCODE = Language(
    name="gcode",
    about="G-code of LinuxCNC, Fanuc, Mach3, GRBL and Marlin",
    suffixes=SUFFIXES,
    recognise=is_gcode,
    run=run_gcode,
    dialects=tuple(DIALECTS),
)
GRBL_LANGUAGE = Language(
    name="grbl",
    about="G-code of GRBL 1.1",
    suffixes=SUFFIXES,
    recognise=lambda _: False,
    run=run_grbl,
    dialects=tuple(DIALECTS),
    takes=(),
)
