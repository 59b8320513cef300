"""``camgen schema``: the JSON schema of job files, for editors that complete and check them."""

from __future__ import annotations

from argparse import Namespace

import msgspec

from camgen.cli_say import Voice, out
from camgen.schema import schema


def run(arguments: Namespace, _says: Voice) -> int:
    """Prints the schema."""
    out(msgspec.json.format(msgspec.json.encode(schema(arguments.post or "")), indent=2).decode() + "\n")
    return 0
