"""``camgen schema``: the JSON schema of job files, for editors that complete and check them."""

from __future__ import annotations

from argparse import Namespace

import msgspec

from camgen.cli.say import Terminal
from camgen.post.job_schema import schema


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Prints the schema."""
    terminal.out(
        msgspec.json.format(msgspec.json.encode(schema(arguments.post or "")), indent=2).decode()
        + "\n"
    )
