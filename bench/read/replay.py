"""G-code of others against LinuxCNC's own interpreter.

    python -m bench.read.replay FILE_OR_FOLDER...

A row per file: number of motions that agree and their largest difference, or the reason for which
the file is refused. The judge is ``rs274 -g`` (Debian package linuxcnc-uspace). It prints canonical
calls with 4 decimals of the program's unit: the comparison does not see half of the last decimal.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from bench.support.runner import open_table
from bench.support.timing import timed
from camgen.lang.gcode.run import run_program
from camgen.lang.programs import RunRequest
from camgen.lang.recorded import ProgramRun
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support import canon
from tests.support.canon import Call, Canon, Point

#: Tolerance between replay and judge, mm, on top of the decimals that the judge does not print.
WITHIN = 0.001
#: Time limit of a program of the judge, s.
LONGEST = 20.0
#: A motion that is shorter stays where it is, mm.
_STILL = 1e-5
#: The machine of rs274: stored positions at the zero of the programs, and tools without a length.
_ZERO = {f"{name}.{axis}": 0.0 for name, axis in product(("g28", "g30", "machine"), "xyz")}
_ZERO |= {f"t{n}.diameter": 0.1 for n in range(100)}
_TOOLS = "".join(f"T{n} P{n} Z0 D0.003937008 ;cutter\n" for n in range(1, 100))


@dataclass(frozen=True)
class Comparison:
    """A replay compared with the judge.

    moves: number of the judge's motions that were compared.
    deviation: the largest distance, mm.
    fault: the first difference, empty without one.
    """

    moves: int
    deviation: float
    fault: str


def compare_motions(run: ProgramRun, other: Canon) -> Comparison:
    """Compares every motion of a replay with the judge's.

    The points of an arc must lie on the judge's arc, in its sense.
    """
    mine = [item for item in run.body if isinstance(item, (MoveJ, MoveL, MoveC))]
    theirs = other.moves[run.held :]
    starts_with_feed = mine and theirs and theirs[0].kind != "STRAIGHT_TRAVERSE"
    extra = run.entry or starts_with_feed
    begin = mine[0].target.origin if extra and mine and not other.is_shifted else (math.inf,) * 3
    # The judge also prints motions to the current position. They are left out on both sides.
    mine = [item for k, item in enumerate(mine) if k == 0 or _moves(item, mine[k - 1])]
    starts = [begin, *(call.end for call in theirs)]
    theirs = [
        call
        for call, start in zip(theirs, starts, strict=False)
        if call.kind == "ARC_FEED" or math.dist(call.end, start) > _STILL
    ]
    ends = [item.target.origin for item in mine]
    k, worst = (1 if extra else 0), 0.0
    offset = (0.0, 0.0, 0.0)
    if other.is_shifted and theirs and len(ends) > k and theirs[0].kind != "ARC_FEED":
        offset = tuple(b - a for a, b in zip(ends[k], theirs[0].end, strict=True))
    start = _add(ends[0], offset) if ends else (0.0, 0.0, 0.0)
    for number, call in enumerate(theirs):
        kind, end = call.kind, call.end
        if k >= len(mine):
            return Comparison(number, worst, f"ends after {number} of {len(theirs)} motions")
        item = mine[k]
        if kind == "ARC_FEED":
            k, deviation = _compare_arc(mine, k, start, call, offset)
        elif isinstance(item, MoveC) or isinstance(item, MoveJ) != (kind == "STRAIGHT_TRAVERSE"):
            fault = f"motion {number + 1} is {kind} and became {type(item).__name__}"
            return Comparison(number, worst, fault)
        else:
            k, deviation = k + 1, math.dist(_add(ends[k], offset), end)
        worst = max(worst, deviation)
        if worst > 2 * WITHIN + 4 * other.hidden:
            fault = f"motion {number + 1} ({kind}) is off by {worst:.4f} mm"
            return Comparison(number, worst, fault)
        start = end
    rest = len(mine) - k
    has_more = rest and not other.error
    return Comparison(len(theirs), worst, f"{rest} motions more than the judge" if has_more else "")


def _moves(item: MoveJ | MoveL | MoveC, before: MoveJ | MoveL | MoveC) -> bool:
    distance = math.dist(item.target.origin, before.target.origin)
    return isinstance(item, MoveC) or distance > _STILL


def _add(point: Point, offset: Point) -> Point:
    return (point[0] + offset[0], point[1] + offset[1], point[2] + offset[2])


def _compare_arc(
    mine: list[MoveJ | MoveL | MoveC], k: int, start: Point, call: Call, offset: Point
) -> tuple[int, float]:
    """Compares the motions from index `k` on with one arc of the judge.

    Returns the index of the motion after the arc, and the largest distance from the arc, mm.
    """
    (a, b), (first, second, normal), turns, end = call.centre, call.axes, call.turns, call.end
    sense = 1 if turns > 0 else -1
    begin = math.atan2(start[second] - b, start[first] - a)
    whole = (sense * (math.atan2(end[second] - b, end[first] - a) - begin)) % math.tau
    if whole < 1e-5:
        whole += math.tau
    if math.tau - whole < 1e-6 and math.dist(start, end) < 1e-4:
        whole = math.tau
    whole += (abs(turns) - 1) * math.tau
    r0 = math.hypot(start[first] - a, start[second] - b)
    r1 = math.hypot(end[first] - a, end[second] - b)
    done, worst, last = 0.0, 0.0, start
    while k < len(mine) and done < whole - max(5e-3 / max(r0, r1, 1e-9), 1e-4):
        item = mine[k]
        if isinstance(item, MoveJ):
            return k, math.inf
        for pose in [item.via, item.target] if isinstance(item, MoveC) else [item.target]:
            point = _add(pose.origin, offset)
            before = math.atan2(last[second] - b, last[first] - a)
            step = math.atan2(point[second] - b, point[first] - a) - before
            done += (sense * step) % math.tau
            radius = r0 + (r1 - r0) * min(done / whole, 1.0)
            height = start[normal] + (end[normal] - start[normal]) * done / whole
            deviation = abs(math.hypot(point[first] - a, point[second] - b) - radius)
            worst, last = max(worst, deviation, abs(point[normal] - height)), point
        k += 1
    return k, max(worst, math.dist(last, end))


def compare_file(path: Path) -> tuple[str, str]:
    """Runs a file in the dialect of LinuxCNC and by the judge. Returns outcome and sentence."""
    text = path.read_text(encoding="latin-1").replace("\r\n", "\n").replace("\r", "\n")
    played, seconds = timed(lambda: run_program({path.name: text}, RunRequest("linuxcnc", _ZERO)))
    m, stopped, _ = played
    other = canon.run(text, _TOOLS, LONGEST)
    # A file without its last per cent sign is not refused.
    is_refused = other.error and "percent" not in other.error
    other_error = other.error.splitlines()[0][:70] if is_refused else ""
    addition = f"; rs274: {other_error}" if is_refused else ""
    refused = [
        (finding.line, finding.what)
        for finding in m.log.list_findings()
        if finding.level == "refused"
    ]
    if stopped or refused:
        line, reason = (refused or [stopped])[0]
        return ("refused both" if is_refused else "refused"), f"line {line}: {reason}{addition}"
    run = ProgramRun(tuple(m.body), tuple(m.lines), (), m.held, m.entry, None, True, "mm")
    comparison = compare_motions(run, other)
    sentence = (
        f"{comparison.moves} motions, largest difference {comparison.deviation:.4f} mm, "
        f"{seconds:.2f} s"
    )
    if is_refused:
        return "accepted alone", sentence + addition
    if comparison.fault:
        return "DIFFERS", comparison.fault
    return "equal" if comparison.moves else "no motion", sentence


def main() -> None:
    """Prints the table, and the number of files of each outcome."""
    files: list[Path] = []
    for path in map(Path, sys.argv[1:]):
        files += sorted(path.rglob("*")) if path.is_dir() else [path]
    counts: Counter[str] = Counter()
    table = open_table("program | | ")
    for file in files:
        if file.suffix.lower() not in (".ngc", ".nc", ".gcode", ".tap") or not file.is_file():
            continue
        outcome, sentence = compare_file(file)
        counts[outcome] += 1
        table.add(file.name, outcome, sentence)
    print("\n" + ", ".join(f"{outcome} {count}" for outcome, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
