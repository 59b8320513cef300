"""The command `markers`: draws a sheet of markers that define the work plane in a photo."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Terminal
from camgen.model.errors import JobError
from camgen.model.text import counted, short, short_each
from camgen.vision.boards.sheet import draw_pdf, draw_svg, make_sheet

_DRAWN = {".pdf": draw_pdf, ".svg": draw_svg}


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Write the sheet, and print how to check it on paper."""
    target = Path(arguments.output)
    draw = _DRAWN.get(target.suffix.lower())
    if draw is None:
        raise JobError(
            str(target),
            "is not a kind of drawing that camgen markers writes",
            remedy="end the name in .pdf or .svg",
        )
    sheet = make_sheet(arguments.size, arguments.marker)
    check_targets([target], [])
    write_all([(target, draw(sheet))], {})
    markers = f"{counted(len(sheet.ids), 'marker')} of {short(sheet.marker, 2)} mm"
    free = " x ".join(short_each(sheet.free, 0))
    text = f"{sheet.size} landscape, {markers}, free for the part: {free} mm"
    check = "at 100 %, not fitted to the page; then measure the ruler: it must be 100 mm"
    terminal.rows([("sheet", text, "plain"), ("print", check, "look")])
    terminal.rows([("written", str(target), "good")])
    return 0
