"""``camgen markers``: draws the sheet of markers that tells a photo where the work plane is."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Voice
from camgen.model.errors import JobError
from camgen.model.text import counted, short
from camgen.vision.boards.sheet import draw_pdf, draw_svg, make_sheet

_DRAWN = {".pdf": draw_pdf, ".svg": draw_svg}


def run(arguments: Namespace, says: Voice) -> int:
    """Writes the sheet and says what to check on the paper."""
    target = Path(arguments.output)
    drawn = _DRAWN.get(target.suffix.lower())
    if drawn is None:
        raise JobError(
            str(target),
            "is no kind of drawing that camgen writes",
            remedy="end the name in .pdf or .svg",
        )
    what = make_sheet(arguments.size, arguments.marker)
    check_targets([target], [])
    write_all([(target, drawn(what))], {})
    side, free = short(what.marker, 2), " x ".join(short(v, 0) for v in what.free)
    text = f"{what.size} landscape, {counted(len(what.ids), 'marker')} of {side} mm, free for the part: {free} mm"
    says.rows(
        [
            ("sheet", text, "plain"),
            (
                "print",
                "at 100 %, not fitted to the page; then measure the ruler: it must be 100 mm",
                "look",
            ),
            ("written", str(target), "good"),
        ]
    )
    return 0
