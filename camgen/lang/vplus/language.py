"""Adept V+ as a language of controllers (docs/languages/vplus.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from camgen.lang.programs import Executed, Language, RunRequest, strip_mark

_SURE = re.compile(
    r"^\s*\.PROGRAM\s+[A-Za-z][A-Za-z0-9._]*\s*(?:\([^()]*\))?\s*(?:;.*)?$",
    re.IGNORECASE | re.MULTILINE,
)
#: Words of V+ that AS of Kawasaki lacks, and words of AS that V+ lacks: the languages look alike.
_OURS = re.compile(
    r"\b(?:MOVE[ST]?|APPROS?|DEPARTS?|SET|AUTO|LOCAL|GLOBAL|FOPENR?|MMPS|WAIT\.EVENT|ATTACH|CALLS"
    r"|TYPE)\b",
    re.IGNORECASE,
)
_THEIRS = re.compile(
    r"\b(?:[JL]MOVE\s*#?\[|LMOVE|[JL]APPRO|LDEPART|ACCURACY|TWAIT|SWAIT|POINT\s+\S+\s*=|C[12]MOVE)",
    re.IGNORECASE,
)


def recognise(text: str) -> bool:
    """Whether the beginning of a text is surely V+."""
    text = strip_mark(text)
    if not _SURE.search(text) or _THEIRS.search(text):
        return False
    return _OURS.search(text) is not None


def run(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Runs the programs in `files` from their entry on."""
    if request.options is not None:
        from camgen.lang.vplus.strict import read  # noqa: PLC0415 (only for programs of a post)

        return read(files, request.options)
    from camgen.lang.vplus.run import run_programs  # noqa: PLC0415 (only for those of others)

    return run_programs(files, request)


VPLUS = Language(
    name="vplus",
    about="Adept V+, of SmartControllers and older Staeubli arms",
    suffixes=(".v2", ".pg", ".v+", ".vb1"),
    recognise=recognise,
    run=run,
    takes=("entry", "points"),
)
