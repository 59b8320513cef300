"""Robot programs from controller to controller and back: python -m bench.read.translate [CASE...]

Every golden program of a robot is posted anew for every other robot, and that for its own again. The motion of the last
is compared with that of the first: the places of its tool both ways, and the seconds at its speeds. Controllers without
arcs, or with coarser digits, are in the tolerance. A case that another arm cannot reach is told with its reason.
"""

from __future__ import annotations

import math
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import camgen
from bench.machine import machine
from camgen.geometry.arcs import circle, turn_about
from camgen.model.pose import Pose, fixed_xyz, frozen
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output
from camgen.read.programs import Ask, find_language
from camgen.read.taught import in_one_frame
from camgen.robots.catalogue import robot
from camgen.robots.kinematics.forward import flange

CASES = Path(__file__).parents[2] / "fixtures" / "cases"
#: The robots' controllers, their suffixes, and what each calls output number k.
POSTS = {"rapid": (".mod", "do{}"), "vplus": (".v2", "{}"), "pacscript": (".pcs", "{}")}
#: Whose joint values the golden programs have.
ARMS = {"rapid": "abb_irb120", "vplus": "adept_cobra_s600", "pacscript": "denso_vs060"}
#: mm between points that are compared.
_STEP = 0.2
#: mm: nearer ones are one.
_SAME = 1e-6
#: So many points are compared at a time.
_SOME, _FEW = 500, 50
#: mm: where no arc is printed, chords leave it by so much; digits are rounded twice on top.
CHORD = 0.02
WITHIN = CHORD + 0.002


class Way(NamedTuple):
    """points: (N, 3) on the way at feed, base frame, mm. seconds: at its speeds. outputs: names and values, those that
    switch off before the first motion left out.
    """

    points: NDArray[np.float64]
    seconds: float
    outputs: list[tuple[str, float]]


def frames_of(case: Path, post: str) -> tuple[Pose, Pose]:
    """Base from work and flange from tool of a golden program: PacScript leaves them to the controller."""
    tables = tomllib.loads((case / "job.toml").read_text())
    own = {name: dict(tables[name]) for name in ("cell", "tool") if name in tables}
    cell = camgen.cell(post, own)
    return cell.base_from_work, cell.flange_from_tool


def way_of(file: Path, language: str, frames: tuple[Pose, Pose]) -> Way:
    """What a program does between its motions of the joints, but for lines that begin at home. frames: where the text
    says none.
    """
    executed = find_language(language).run({file.name: file.read_text(encoding="latin-1")}, Ask())
    if executed.stopped or any(one.level == "refused" for one in executed.findings):
        raise ValueError(f"{file.name}: {executed.stopped or executed.findings}")
    told = in_one_frame(executed, file.name, 0.001)
    base, tool = told.frames.base_from_work or frames[0], told.frames.flange_from_tool or frames[1]
    arm = robot(ARMS[language])
    joints = [item.target.values for item in told.body if isinstance(item, MoveJ) and isinstance(item.target, Joints)]
    homes = {*joints[:1], *joints[-1:]}
    points: list[tuple[float, float, float]] = []
    outputs: list[tuple[str, float]] = []
    seconds, here = 0.0, None
    for item in told.body:
        if isinstance(item, Output):
            outputs.append((item.signal, item.value))
        if not isinstance(item, MoveJ | MoveL | MoveC):
            continue
        if here is not None and not isinstance(item, MoveJ):
            some, length = _along(here, item)
            points += some
            seconds += length / item.speed
        target = item.target
        if not isinstance(target, Pose) and target.values in homes:
            here = None  # another arm's is elsewhere
            continue
        if not isinstance(target, Pose):
            turned, origin = flange(arm, np.array([target.values]))
            x, y, z = origin[0].tolist()
            target = base.inverse() @ Pose(frozen(turned[0]), (x, y, z)) @ tool
        here = target.origin
    moved = np.array(points or [(0.0, 0.0, 0.0)])
    # Where one motion ends another begins.
    moved = moved[np.append(True, np.abs(np.diff(moved, axis=0)).max(axis=1) > _SAME)]
    return Way(moved @ base.rotation.T + base.origin, seconds, outputs)


def _along(start: tuple[float, float, float], item: MoveL | MoveC) -> tuple[list[tuple[float, float, float]], float]:
    end = item.target.origin
    if isinstance(item, MoveL):
        length = math.dist(start, end)
        shares = np.linspace(0, 1, max(2, math.ceil(length / _STEP) + 1))[:, None]
        return [(x, y, z) for x, y, z in (start + shares * np.subtract(end, start)).tolist()], length
    centre, radius, axis, sweep = circle(start, item.via.origin, end)
    x, y, z = np.subtract(start, centre).tolist()
    turned = np.linspace(0, sweep, max(2, math.ceil(radius * sweep / _STEP) + 1)).tolist()
    arms = [turn_about((x, y, z), axis, angle) for angle in turned]
    return [(a + centre[0], b + centre[1], c + centre[2]) for a, b, c in arms], radius * sweep


def apart(a: Way, b: Way) -> float:
    """The farthest that a point of one way is from the other, mm."""
    return max(_farthest(a.points, b.points), _farthest(b.points, a.points))


def _farthest(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    near = np.concatenate([_nearest(a[k : k + _SOME], b) for k in range(0, len(a), _SOME)])
    beside = np.clip(near[:, None] + [-1, 0], 0, max(len(b) - 2, 0))
    best = _to_lines(a[:, None], b[beside], b[np.minimum(beside + 1, len(b) - 1)]).min(axis=1)
    # Where another line comes by, the nearest point may be on that, and the nearest line not beside it.
    far = np.flatnonzero(best > CHORD)
    for some in np.array_split(far, len(far) // _FEW + 1):
        best[some] = _to_lines(a[some, None], b[None, :-1], b[None, 1:]).min(axis=1)
    return float(best.max())


def _to_lines(points: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far points are from lines, all (..., 3)."""
    along = end - start
    square = (along**2).sum(axis=-1)
    share = np.clip(((points - start) * along).sum(axis=-1) / np.where(square > 0, square, 1.0), 0, 1)
    return np.asarray(np.linalg.norm(start + share[..., None] * along - points, axis=-1))


def _nearest(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.int64]:
    square = (b**2).sum(axis=1) - 2 * a @ b.T
    return np.asarray(square.argmin(axis=1))


def post_again(file: Path, source: str, target: str, folder: Path, frames: tuple[Pose, Pose]) -> Path:
    """The program ``file`` of the controller ``source`` for another one; CamgenError where that cannot be."""
    executed = find_language(source).run({file.name: file.read_text(encoding="latin-1")}, Ask())
    names = dict.fromkeys(item.signal for item in executed.body if isinstance(item, Output))
    suffix, name = POSTS[target]
    signals = {one: _number(name.format(_digits(one))) for one in names}
    job: dict[str, object] = {"operation": {"taught_on": ARMS[source]}, "tolerance": {"chord": CHORD}}
    job["cell"] = {"base_from_work": _values(frames[0]), "flange_from_tool": _values(frames[1])}
    job |= {"post": {"signals": signals}} if signals else {}
    result = camgen.build(file, post=target, job=job, name="part")
    made = folder / f"part{suffix}"
    made.write_text("".join(one.text for one in result.files), encoding="latin-1")
    return made


def _values(pose: Pose) -> list[float]:
    return [*pose.origin, *map(math.degrees, fixed_xyz(pose.rotation))]


def _digits(name: str) -> str:
    return "".join(c for c in name if c.isdigit()) or "33"


def _number(name: str) -> str | int:
    return int(name) if name.isdigit() else name


def rows(case: Path) -> list[str]:
    """A row of a Markdown table for each pair of controllers."""
    files = {source: case / "expected" / f"part{suffix}" for source, (suffix, _) in POSTS.items()}
    pairs = [(source, target) for source, file in files.items() for target in POSTS if file.exists()]
    return [f"| {case.name} | {a} | {b} | {tell(files[a], a, b)} |" for a, b in pairs if a != b]


def there_and_back(file: Path, source: str, target: str) -> tuple[Way, Way]:
    """What a golden program does, and what it does after there and back. CamgenError where it cannot go there."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        frames = frames_of(file.parents[1], source)
        there = post_again(file, source, target, Path(one), frames)
        back = post_again(there, target, source, Path(two), frames)
        return way_of(file, source, frames), way_of(back, source, frames)


def tell(file: Path, source: str, target: str) -> str:
    """How far the motion is off after there and back, and how its time differs, or why it cannot be."""
    try:
        a, b = there_and_back(file, source, target)
    except camgen.CamgenError as error:
        return f"- | - | {error}"
    same = [value for _, value in a.outputs] == [value for _, value in b.outputs]
    return f"{apart(a, b):.4f} | {abs(a.seconds - b.seconds):.3f} | {'' if same else 'outputs differ'}"


def main() -> None:
    """The table."""
    print(machine(), end="\n\n")
    print("| case | from | by way of | mm apart | s apart | |")
    print("|---|---|---|---|---|---|")
    listed = [CASES / name for name in sys.argv[1:]] or sorted(p for p in CASES.iterdir() if p.is_dir())
    for case in listed:
        for row in rows(case):
            print(row, flush=True)


if __name__ == "__main__":
    main()
