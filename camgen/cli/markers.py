"""The command `markers`: draws a sheet of markers that define the work plane in a photo."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.inputs import check_suffix
from camgen.cli.say import Terminal
from camgen.model.text import counted, short, short_each
from camgen.vision.boards.sheet import draw_pdf, draw_svg, make_sheet

_DRAWN = {".pdf": draw_pdf, ".svg": draw_svg}


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Write the sheet, and print how to check it on paper."""
    target = Path(arguments.output)
    check_suffix(
        target,
        _DRAWN,
        "is not a kind of drawing that camgen markers writes",
        "end the name in .pdf or .svg",
    )
    sheet = make_sheet(arguments.size, arguments.marker)
    check_targets([target], [])
    write_all([(target, _DRAWN[target.suffix.lower()](sheet))], {})
    markers = f"{counted(len(sheet.ids), 'marker')} of {short(sheet.marker, 2)} mm"
    free = " x ".join(short_each(sheet.free, 0))
    check = "at 100 %, not fitted to the page; then measure the ruler: it must be 100 mm"
    terminal.rows(
        [
            ("sheet", f"{sheet.size} landscape, {markers}, free for the part: {free} mm", "plain"),
            ("print", check, "look"),
            ("written", str(target), "good"),
        ]
    )
