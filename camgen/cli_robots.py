"""``camgen robots``: the built-in robots, and how well their numbers are known."""

from __future__ import annotations

from argparse import Namespace

from camgen.cli_say import Voice, out, table
from camgen.robots.models import robots


def run(_arguments: Namespace, says: Voice) -> int:
    """Prints the table of robots, with -v their notes too."""
    rows = [("name", "maker", "joints", "kind", "kinematics", "limits")]
    known = robots()
    rows += [(r.name, r.maker, str(len(r.joints)), r.kind, r.trust.kinematics, r.trust.limits) for r in known]
    text = table(rows)
    if says.verbose:
        text += "".join(f"{robot.name}: {note}\n" for robot in known for note in robot.notes)
    out(text)
    return 0
