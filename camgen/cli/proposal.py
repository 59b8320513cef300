"""The operations that ``camgen init`` proposes, as lines of a job file."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from camgen.model.text import counted, short
from camgen.model.toml import format_toml
from camgen.plan.propose import Proposal

_WIDE = 116
#: Reasons why contours are in no operation.
WHY_LEFT = "they cross others, enclose nothing, or no tool fits"


def list_proposed(proposal: Proposal, active: bool) -> list[str]:
    """The lines of `[[tools]]` and `[[operations]]`, as comments unless `active`."""
    thickness = short(proposal.thickness, 3)
    about = (
        f"Proposed from the contours. Depths are those of a material of {thickness} mm, drills go "
        "deeper by their tip: measure it, and set them and [stock] thickness. "
    )
    if proposal.material:
        about += (
            "Speeds (rpm) and feeds (mm/s) are the lowest of published charts for "
            f"{proposal.material} where a comment names one."
        )
    else:
        about += "Speeds (rpm) and feeds (mm/s) are placeholders: set them for tool and material."
    if not active:
        about += " Delete the # in front to use it."
    if proposal.left:
        about += f" In no operation: {', '.join(proposal.left)} ({WHY_LEFT})."
    lines = ["", *textwrap.wrap(about, _WIDE, initial_indent="# ", subsequent_indent="# ")]
    rows: list[str] = []
    for tool in proposal.tools:
        rows += ["", "[[tools]]", *_keys(tool.row, tool.comments)]
    for operation in proposal.operations:
        comment = f"# {operation.about}: {operation.why}".removesuffix(": ")
        rows += ["", "[[operations]]", comment, *_keys(operation.row, {})]
    if not active:
        rows = [f"# {line}".rstrip() for line in rows]
    return lines + rows


def _keys(row: Mapping[str, object], comments: Mapping[str, str]) -> list[str]:
    """The lines of a row, with the comments of its keys. A long list takes several lines."""
    lines: list[str] = []
    for key, value in row.items():
        line = f"{key} = {format_toml(value)}"
        if key in comments:
            line += f"  # {comments[key]}"
        if len(line) <= _WIDE or not isinstance(value, list):
            lines.append(line)
            continue
        items = textwrap.wrap(
            ", ".join(map(format_toml, value)),
            _WIDE - 4,
            initial_indent="    ",
            subsequent_indent="    ",
        )
        lines += [f"{key} = [", *items, "]"]
    return lines


def tabulate(proposal: Proposal) -> list[str]:
    """A line for each operation: tool, contours, entry, tabs, and the reason for the tool."""
    lines = []
    for operation in proposal.operations:
        row = operation.row
        parts = [operation.about, operation.why, str(row.get("entry", ""))]
        if "passes" in row and row["kind"] != "drill":
            parts.append(f"{row['passes']} passes")
        if "finish" in row:
            parts.append("a last pass at the wall")
        if "tabs" in row:
            parts.append(counted(int(str(row["tabs"])), "tab") + " each")
        lines.append(f"{row['kind']} - {row['tool']}: {', '.join(filter(None, parts))}")
    return lines


def describe(proposal: Proposal) -> str:
    """The proposal in one line, for the summary."""
    operations = [operation.about.partition(":")[0] for operation in proposal.operations]
    tools = {operation.row["tool"] for operation in proposal.operations}
    return f"{', '.join(operations)}, with {counted(len(tools), 'tool')}"
