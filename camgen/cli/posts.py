"""``camgen posts``: what can be posted, where it came from, and why a broken one is broken."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli.say import Terminal, format_table
from camgen.post.plugins import list_installed


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Prints the table of posts."""
    if arguments.json:
        terminal.data(list_installed())
        return
    rows = [("name", "suffix", "origin", "about")]
    for post in list_installed():
        about = f"broken: {post.broken}" if post.broken else post.about
        rows.append((post.name, post.suffix, post.origin, about))
    terminal.out(format_table(rows))
