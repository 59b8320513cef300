"""Third-party programs in PacScript (RC8, RC9) and PAC (RC5, RC7) (docs/languages/pacscript.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from camgen.lang.programs import Executed, Language, RunRequest, strip_mark

_SURE = re.compile(
    r"^\s*(?:'!title\b|takearm\b|sub\s+main\b|program\s+\w+\s*$|givearm\b"
    r"|#include\s+[\"<]\w+\.(?:h|pcs)"
    r"|move\s+(?:p|l|c|ptp)\s*,|approach\s+(?:p|l)\s*,)",
    re.IGNORECASE | re.MULTILINE,
)


def recognise(text: str) -> bool:
    """Whether a text is surely PacScript."""
    return len(_SURE.findall(text[:20_000])) > 1 or strip_mark(text)[:8].lower() == "'!title "


def run(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Runs the procedure Main, or the entry of the request, once."""
    if request.options is not None:
        from camgen.lang.pacscript.strict import read  # noqa: PLC0415 (only for those of a post)

        return read(files, request.options)
    from camgen.lang.pacscript.run import ProgramRun  # noqa: PLC0415 (only for those of others)

    return ProgramRun(files, request).run()


LANGUAGE = Language(
    "pacscript",
    "DENSO PacScript and PAC",
    (".pcs", ".pac", ".pns"),
    recognise,
    run,
    takes=("entry", "points"),
)
