"""The feed of the contact point where `process.max_feed_factor` holds the tool back."""

from __future__ import annotations

from camgen.model.job import ProcessTable
from camgen.model.part import Note
from camgen.model.text import short

#: A factor that exceeds its limit by less needs no note.
CAPPED = 1.01


def note_contact_feed(
    what: str, name: str, factor: float, process: ProcessTable, ids: tuple[str, ...]
) -> Note:
    """The note on lines along which the contact point runs slower than the feed of the job.

    what: beginning of the text.
    name: id of the slowest line.
    factor: path of the tool there divided by the length of the line.
    ids: ids of all slow lines.
    """
    speed = process.feed * process.max_feed_factor / factor
    return Note(
        "warning",
        f"{what}: the contact point runs at {short(speed, 1)} of {short(process.feed, 1)} mm/s "
        f"on {name}",
        f"the tool would run {short(factor, 1)} times as fast, and "
        f"process.max_feed_factor = {short(process.max_feed_factor, 2)}",
        ids,
    )
