"""Commands of camgen in this process, and their job files."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from camgen.cli import main
from camgen.model.toml import format_toml

#: The tables of a job: a table has settings, or rows of them.
Tables = dict[str, Any]


class Ran(NamedTuple):
    """A command that has ended.

    code: its exit code.
    lines: the lines that it printed.
    """

    code: int
    lines: list[str]


def run_camgen(*words: object) -> Ran:
    """Runs a command."""
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = main([str(word) for word in words])
    return Ran(code, (out.getvalue() + errors.getvalue()).splitlines())


def write_job(job: Mapping[str, Any], file: Path) -> None:
    """Writes tables as a job file."""
    lines: list[str] = []
    for name, content in job.items():
        for row in content if isinstance(content, list) else [content]:
            lines.append(f"[[{name}]]" if isinstance(content, list) else f"[{name}]")
            lines += [f"{key} = {format_toml(value)}" for key, value in row.items()]
    file.write_text("\n".join(lines) + "\n")
