"""``camgen posts``: what can be posted, where it came from, and why a broken one is broken."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli.say import Voice, out, table
from camgen.post.plugins import list_installed


def run(_arguments: Namespace, _says: Voice) -> int:
    """Prints the table of posts."""
    rows = [("name", "suffix", "origin", "about")]
    rows += [(p.name, p.suffix, p.origin, f"broken: {p.broken}" if p.broken else p.about) for p in list_installed()]
    out(table(rows))
    return 0
