"""ABB RAPID as a language of controllers (docs/languages/rapid.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping

from camgen.lang.programs import Executed, Language, RunRequest, strip_mark

_BEGINNING = re.compile(r"\s*(?:%%%[^%]*%%%)?(?:\s*![^\n]*\n)*\s*MODULE\s+\w", re.IGNORECASE)


def recognise(text: str) -> bool:
    """Return whether a module begins at the start of a text."""
    return _BEGINNING.match(strip_mark(text)) is not None


def run(files: Mapping[str, str], request: RunRequest) -> Executed:
    """Runs the main routine of the modules once. Never raises for a text."""
    if request.options is not None:
        from camgen.lang.rapid.strict import read  # noqa: PLC0415 (only for programs of a post)

        return read(files, request.options)
    from camgen.lang.rapid.modules import run_modules  # noqa: PLC0415 (only for those of others)

    return run_modules(files, request)


LANGUAGE = Language(
    name="rapid",
    about="ABB RAPID: modules for S4, IRC5 and OmniCore",
    suffixes=(".mod", ".modx", ".sys", ".sysx", ".prg"),
    recognise=recognise,
    run=run,
)
