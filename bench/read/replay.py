"""G-code of others against LinuxCNC's own interpreter: python -m bench.read.replay FILE_OR_FOLDER...

For every file: how many motions agree and by how much they differ at most, or the reason for which it is refused. The
judge is ``rs274 -g`` (Debian package linuxcnc-uspace), which prints the canonical calls of a program with 4 decimals of
the program's unit; half of the last one is what the comparison cannot see.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from bench.support.runner import open_table
from camgen.lang.gcode.run import run_program
from camgen.lang.programs import Ask
from camgen.lang.recorded import ProgramRun
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support import canon
from tests.support.canon import Call, Canon, Point

#: mm between replay and judge, on top of what the judge's print hides.
WITHIN = 0.001
#: Seconds after which a program is taken to have no end.
LONGEST = 20.0
#: Where the machine of rs274 stores its places: at its zero, which is that of the programs. Tools without a length.
_ZERO = {f"{name}.{axis}": 0.0 for name in ("g28", "g30", "machine") for axis in "xyz"}
_ZERO |= {f"t{n}.diameter": 0.1 for n in range(100)}
_TOOLS = "".join(f"T{n} P{n} Z0 D0.003937008 ;cutter\n" for n in range(1, 100))


@dataclass(frozen=True)
class Found:
    """deviation: mm, the largest. moves: of the judge, compared. fault: what differs, empty where nothing does."""

    moves: int
    deviation: float
    fault: str


def against(run: ProgramRun, judge: Canon) -> Found:
    """Every motion of the replay against the judge's. An arc must pass through its points in its sense."""
    mine = [item for item in run.body if isinstance(item, (MoveJ, MoveL, MoveC))]
    theirs = judge.moves[run.held :]
    starts_with_feed = mine and theirs and theirs[0].kind != "STRAIGHT_TRAVERSE"
    extra = run.entry or starts_with_feed
    begin = mine[0].target.origin if extra and mine and not judge.is_shifted else (math.inf,) * 3
    mine = [item for k, item in enumerate(mine) if k == 0 or _goes(item, mine[k - 1].target.origin)]
    before = [begin, *(call.end for call in theirs)]
    theirs = [call for call, start in zip(theirs, before, strict=False) if _leaves(call, start)]
    ends = [item.target.origin for item in mine]
    k, worst = (1 if extra else 0), 0.0
    offset = (0.0, 0.0, 0.0)
    if judge.is_shifted and theirs and len(ends) > k and theirs[0].kind != "ARC_FEED":
        offset = tuple(b - a for a, b in zip(ends[k], theirs[0].end, strict=True))
    here = tuple(a + b for a, b in zip(ends[0], offset, strict=True)) if ends else (0.0, 0.0, 0.0)
    for number, call in enumerate(theirs):
        kind, end = call.kind, call.end
        if k >= len(mine):
            return Found(number, worst, f"ends after {number} of {len(theirs)} motions")
        if kind != "ARC_FEED":
            if isinstance(mine[k], MoveJ) != (kind == "STRAIGHT_TRAVERSE") or isinstance(
                mine[k], MoveC
            ):
                return Found(
                    number,
                    worst,
                    f"motion {number + 1} is {kind} and became {type(mine[k]).__name__}",
                )
            at = _moved(ends[k], offset)
            worst, k = max(worst, math.dist(at, end)), k + 1
        else:
            k, at, off = _arc(mine, k, here, call, offset)
            worst = max(worst, off)
        if worst > 2 * WITHIN + 4 * judge.hidden:
            return Found(number, worst, f"motion {number + 1} ({kind}) is off by {worst:.4f} mm")
        here = end
    rest = len(mine) - k
    return Found(
        len(theirs),
        worst,
        f"{rest} motions more than the judge" if rest and not judge.error else "",
    )


def _goes(item: MoveJ | MoveL | MoveC, start: Point) -> bool:
    """Whether a motion is one: LinuxCNC writes down those to where the tool is as well."""
    return isinstance(item, MoveC) or math.dist(item.target.origin, start) > 1e-5


def _leaves(call: Call, start: Point) -> bool:
    return call.kind == "ARC_FEED" or math.dist(call.end, start) > 1e-5


def _moved(point: Point, offset: Point) -> Point:
    return (point[0] + offset[0], point[1] + offset[1], point[2] + offset[2])


def _arc(mine: list, k: int, here: Point, call: Call, offset: Point) -> tuple[int, Point, float]:
    """The pieces of one arc: their place after it, where they end, and how far they are off it at most (mm)."""
    (a, b), (first, second, normal), turns, end = call.centre, call.axes, call.turns, call.end
    sense = 1 if turns > 0 else -1
    begin = math.atan2(here[second] - b, here[first] - a)
    whole = (sense * (math.atan2(end[second] - b, end[first] - a) - begin)) % math.tau
    if whole < 1e-5:
        whole += math.tau
    if math.tau - whole < 1e-6 and math.dist(here, end) < 1e-4:
        whole = math.tau
    whole += (abs(turns) - 1) * math.tau
    r0, r1 = (
        math.hypot(here[first] - a, here[second] - b),
        math.hypot(end[first] - a, end[second] - b),
    )
    done, worst, last = 0.0, 0.0, here
    while k < len(mine) and done < whole - max(5e-3 / max(r0, r1, 1e-9), 1e-4):
        item = mine[k]
        if isinstance(item, MoveJ):
            return k, last, math.inf
        for pose in [item.via, item.target] if isinstance(item, MoveC) else [item.target]:
            point = _moved(pose.origin, offset)
            step = math.atan2(point[second] - b, point[first] - a) - math.atan2(
                last[second] - b, last[first] - a
            )
            done += (sense * step) % math.tau
            radius = r0 + (r1 - r0) * min(done / whole, 1.0)
            rise = here[normal] + (end[normal] - here[normal]) * done / whole
            off = abs(math.hypot(point[first] - a, point[second] - b) - radius)
            worst, last = max(worst, off, abs(point[normal] - rise)), point
        k += 1
    return k, last, max(worst, math.dist(last, end))


def row(path: Path) -> tuple[str, str]:
    """What became of one file, run as LinuxCNC's: a kind and a sentence."""
    text = path.read_text(encoding="latin-1").replace("\r\n", "\n").replace("\r", "\n")
    begin = perf_counter()
    m, stopped, _ = run_program({path.name: text}, Ask("linuxcnc", _ZERO))
    seconds = perf_counter() - begin
    judge = canon.run(text, _TOOLS, LONGEST)
    theirs = (
        judge.error.splitlines()[0][:70] if judge.error and "percent" not in judge.error else ""
    )
    refused = [(one.line, one.what) for one in m.log.list_findings() if one.level == "refused"]
    if stopped or refused:
        line, why = (refused or [stopped])[0]
        more = f"; rs274: {theirs}" if theirs else ""
        return ("refused both" if theirs else "refused"), f"line {line}: {why}{more}"
    run = ProgramRun(tuple(m.body), tuple(m.lines), (), m.held, m.entry, None, True, "mm")
    found = against(run, judge)
    told = f"{found.moves} motions, largest difference {found.deviation:.4f} mm, {seconds:.2f} s"
    if theirs:
        return "accepted alone", f"{told}; rs274: {theirs}"
    if found.fault:
        return "DIFFERS", found.fault
    return "equal" if found.moves else "no motion", told


def main() -> None:
    """The table, and how often each kind came."""
    paths = [Path(name) for name in sys.argv[1:]]
    files = [f for p in paths for f in (sorted(p.rglob("*")) if p.is_dir() else [p])]
    counts: Counter[str] = Counter()
    table = open_table("program | | ")
    for file in files:
        if file.suffix.lower() not in (".ngc", ".nc", ".gcode", ".tap") or not file.is_file():
            continue
        kind, told = row(file)
        counts[kind] += 1
        table.add(file.name, kind, told)
    print("\n" + ", ".join(f"{kind} {count}" for kind, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
