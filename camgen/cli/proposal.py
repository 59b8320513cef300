"""The operations that ``camgen init`` proposes, as lines of a job file."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from camgen.model.text import counted, short
from camgen.model.toml import toml
from camgen.plan.propose import Proposal

_WIDE = 116


def list_proposed(proposal: Proposal, active: bool) -> list[str]:
    """Rows of ``[[tools]]`` and ``[[operations]]``. active: else they are comments."""
    thickness = short(proposal.thickness, 3)
    told = (
        f"Proposed from the contours. Depths are those of a material of {thickness} mm, drills go "
        "deeper by their tip: measure it, and set them and [stock] thickness. Speeds (rpm) and "
        "feeds (mm/s) are placeholders: set them for tool and material."
    )
    told += "" if active else " Delete the # in front to use it."
    if proposal.left:
        why = "they cross others, enclose nothing, or are too narrow for a mill of 1 mm"
        told += f" In no operation: {', '.join(proposal.left)} ({why})."
    lines = ["", *textwrap.wrap(told, _WIDE, initial_indent="# ", subsequent_indent="# ")]
    rows = [line for tool in proposal.tools for line in ("", "[[tools]]", *_keys(tool))]
    for one in proposal.operations:
        rows += ["", "[[operations]]", f"# {one.about}", *_keys(one.row)]
    return lines + (rows if active else [f"# {line}".rstrip() for line in rows])


def _keys(row: Mapping[str, object]) -> list[str]:
    """``key = value``, a list that is too long for a line on several."""
    lines: list[str] = []
    for key, value in row.items():
        line = f"{key} = {toml(value)}"
        if len(line) <= _WIDE or not isinstance(value, list):
            lines.append(line)
            continue
        items = textwrap.wrap(
            ", ".join(map(toml, value)), _WIDE - 4, initial_indent="    ", subsequent_indent="    "
        )
        lines += [f"{key} = [", *items, "]"]
    return lines


def describe(proposal: Proposal) -> str:
    """What is proposed, for the summary."""
    found = [one.about.partition(":")[0] for one in proposal.operations]
    return f"{', '.join(found)}, with {counted(len(proposal.tools), 'tool')}"
