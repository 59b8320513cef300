"""``camgen posts``: what can be posted, where it came from, and why a broken one is broken."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli.say import Terminal, format_table
from camgen.post.plugins import list_installed


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Prints the table of posts."""
    if arguments.json:
        terminal.data(list_installed())
        return 0
    rows = [("name", "suffix", "origin", "about")]
    rows += [
        (p.name, p.suffix, p.origin, f"broken: {p.broken}" if p.broken else p.about)
        for p in list_installed()
    ]
    terminal.out(format_table(rows))
    return 0
