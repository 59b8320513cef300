"""Photos as they come: errors with and without a line that names their cause, pieces, refusals.

    python -m bench.photo.conditions [PHOTOS, 40] [FIRST, 0] [CLEAN, 20]

The rule: the photos FIRST to FIRST + PHOTOS are drawn by number from bench.render.conditions. A
photo takes each condition with a chance of one half, and draws it from its range: contrast 5 to
120, noise 0 to 4, blur 0.3 to 3 px, motion 0 to 9 px, 1 to 100 chips, a part 0 to 10 mm high (the
job states the height, again with a chance of one half), a lens of k1 -0.25 to 0 without
calibration, a brushed or wooden bench, a shadow. Three ways to tell the work plane take turns:
camgen's sheet, a ChArUco board beside the part, pairs of points. Limits are chosen with the photos
1000 and up. CLEAN photos, 2000 and up, have no such condition.

The found contours are compared with the outlines of the part's upper face: each point of a
contour, a tenth of a millimetre apart, with the nearest place of the outlines. Corners are left
out: places within 1 mm and the width of the blur and the motion of a sharp corner of the part.
Chips count as off. Outcomes:

- right: no point is off by more than 0.1 mm, and no outline is missing
- named: a line of the result has a word for one of the conditions; if it has a lens, or a height
  that the job does not state, for these
- silent: none has
- refused: no part is read

The goals: no photo is silent, at most 3 of 40 are refused, pieces of the photos that are right are
at most 1.3 times those of the part and 4, and at most 2 of 20 clean photos have a warning.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import camgen
from bench.render.conditions import PIXEL, ConditionedPhoto, Conditions, draw_conditions, draw_photo
from bench.render.scene import write_photo
from bench.render.shapes import are_away, find_corners, pieces, to_loops
from bench.support.runner import Cells, open_table, read_words, verdict
from camgen.read.files import Files
from camgen.read.image import read
from camgen.read.job_file import from_mapping

#: mm: error of a right photo, room at corners, distance of points.
MOST, CORNER, STEP = 0.1, 1.0, 0.1
#: Words of a line that names a condition as the cause.
WORDS = {
    "contrast": ("hardly differ", "contrast", "part or bench"),
    "noise": ("picture smoothed", "hardly differ"),
    "blur": ("blur", "unsharp"),
    "motion": ("blur", "motion", "unsharp"),
    "chips": ("loose", "chip", "speck", "apart"),
    "height": ("height",),
    "k1": ("lens",),
    "bench": ("texture", "grain", "hardly differ", "part or bench"),
    "shadow": ("shadow",),
}
CLEAN_FROM = 2000
#: Columns of the outcome and of the warnings.
_OUTCOME, _WARNINGS = 3, 9
COLUMNS = (
    "photo | work plane | conditions | outcome | most mm {:.3f} | rms mm {:.3f} "
    "| missing % {:.1f} | pieces {} | of the part {} | warnings {} | goal | line"
)


def measure_photo(photo: ConditionedPhoto, folder: Path) -> Iterator[Cells]:
    """The row of a photo."""
    names = ", ".join(_list_conditions(photo.conditions))
    head = (photo.number, photo.plane_by, names or "clean")
    file = folder / "photo.png"
    write_photo(file, photo.pixels)
    files = Files()
    try:
        part = read(files.read(file), from_mapping(photo.job), files)
    except (camgen.InputError, camgen.JobError, camgen.NoSafeProgram) as error:
        yield *head, "refused", None, None, None, None, None, 1, "", str(error)
        return
    largest, rms, missing = measure(part, photo)
    count = sum(len(contour.points) for contour in part.contours)
    drawn = sum(len(loop.points) for loop in photo.loops)
    is_right = largest <= MOST and missing == 0
    line = name_cause(part.notes, photo.conditions)
    outcome = "right"
    if not is_right:
        outcome = "named" if line else "silent"
    is_met = outcome != "silent" and not (is_right and count > 1.3 * drawn + 4)
    warnings = sum(note.kind == "warning" for note in part.notes)
    figures = (largest, rms, 100 * missing, count, drawn, warnings)
    yield *head, outcome, *figures, verdict(is_met), line


def measure(part: camgen.Part, photo: ConditionedPhoto) -> tuple[float, float, float]:
    """Largest and rms distance of the contours from the outlines, mm, and the share not found."""
    truth = pieces(photo.loops)
    contours = pieces(to_loops(part.contours))
    followed, drawn = contours.walk_evenly(STEP), truth.walk_evenly(STEP)
    conditions = photo.conditions
    room = CORNER + (2 * conditions.blur + conditions.motion / 2) * PIXEL
    corners = find_corners(photo.loops, 1e-3)
    distances = truth.distance(followed)[are_away(followed, corners, room)]
    from_drawn = contours.distance(drawn)[are_away(drawn, corners, room)]
    missing = float(np.mean(from_drawn > 1.0))
    rms = float(np.sqrt(np.mean(distances**2)))
    return float(distances.max(initial=0.0)), rms, missing


def name_cause(notes: tuple[camgen.Note, ...], conditions: Conditions) -> str:
    """The first line that has a word for one of the conditions; empty without one.

    A height that the job does not state, and a lens without calibration, must each have a line.
    """
    lines = [str(note) for note in notes if note.kind != "assumed" or _is_cause(note)]
    lines.sort(key=lambda line: line.startswith("assumed"))
    named = {name: _find_line(lines, WORDS[name]) for name in conditions.names}
    if not named.get("k1", "-"):
        return ""
    if not (conditions.is_told or named.get("height", "-")):
        return ""
    return next(filter(None, named.values()), "")


def _is_cause(note: camgen.Note) -> bool:
    """Whether an assumption of the summary names a cause of errors."""
    return note.what.startswith(("height 0", "lens from the photo", "the part is placed to"))


def _find_line(lines: list[str], words: tuple[str, ...]) -> str:
    """The first line with one of the words; empty without one."""
    for line in lines:
        if any(word in line for word in words):
            return line
    return ""


def _list_conditions(conditions: Conditions) -> Iterator[str]:
    for name in conditions.names:
        value = getattr(conditions, name)
        text = value if isinstance(value, str) else f"{value:.3g}"
        yield f"{name} {text}{' told' if name == 'height' and conditions.is_told else ''}"


def main(count: int, first: int, clean: int) -> int:
    """Prints the table and the outcomes; 1 if a goal is missed."""
    table = open_table(COLUMNS)
    outcomes: Counter[str] = Counter()
    warned = 0
    photos = [(number, draw_conditions(number)) for number in range(first, first + count)]
    photos += [(number, Conditions()) for number in range(CLEAN_FROM, CLEAN_FROM + clean)]
    with tempfile.TemporaryDirectory() as folder:
        for k, drawn in enumerate(photos):
            for cells in measure_photo(draw_photo(*drawn), Path(folder)):
                table.add(*cells)
                if k < count:
                    outcomes[str(cells[_OUTCOME])] += 1
                else:
                    warned += bool(cells[_WARNINGS])
    print(f"\n{', '.join(f'{n} {name}' for name, n in sorted(outcomes.items()))}")
    print(f"{warned} of {clean} clean photos have a warning or are refused")
    is_met = outcomes["refused"] <= 3 * count / 40 and warned <= clean / 10
    return int(not is_met or table.missed > 0)


if __name__ == "__main__":
    sys.exit(main(*read_words(40, 0, 20)))
