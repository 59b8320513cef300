"""Rounded corners of the golden programs for arms, by the model and by a judge.

    python -m bench.check.rounding [CASE ...]

All cases, or those named. The judge reads the text itself and has formulas of its own. It counts
motions in the plane at the height of the part or below, the model all in contact. Stops are those
in the text. Exits with 1 where a corner is rounded beyond its tolerance by more than the digits of
the text.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from bench.support.runner import Cells, Scenario, run, verdict
from tests.support.rounded_paths import list_corners
from tests.test_cases import ALL, built

#: mm: half of the last digit moves both ends of a motion.
DIGITS = 0.001
#: Words of a stop in the text.
STOPS = {"rapid": ",fine,", "pacscript": "@0 ", "vplus": "BREAK"}
COLUMNS = (
    "case | post | transitions {:,} | by the model, mm {:.4f} | by the judge, mm {:.4f} "
    "| allowed, mm {:.4g} | stops {:,} | goal"
)


def measure(case: Path, post: str) -> Iterable[Cells]:
    """The row of a program."""
    result = built(case, post)
    rounded = result.rounded
    judged = 0.0
    for file in result.files:
        judged = max([judged, *(corner.mm for corner in list_corners(post, file.text))])
    # The judge does not know which lines are chords of an arc.
    is_met = rounded.excess <= DIGITS and judged <= rounded.largest + DIGITS
    stops = result.text.count(STOPS[post])
    distances = (rounded.largest, judged, rounded.allowed)
    yield (case.name, post, rounded.transitions, *distances, stops, verdict(is_met))


def main(names: list[str]) -> int:
    wanted = [(case, post) for case, post in ALL if post in STOPS]
    if names:
        wanted = [(case, post) for case, post in wanted if case.name in names]
    return run(Scenario(COLUMNS, wanted, measure))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
