"""Parts scanned from one place: sheets, hollow parts and solid ones, with and without the place of the scanner.

    python -m bench.read.one_sided [VIEWS, 4] [POINTS, 20000] [PROCESSES, 1] [FOLDER | -] [PART ...]

Each part is scanned from VIEWS places around it, 600 mm away, with 0.05 mm noise, placed at random within 30 deg and
50 mm, and looked for in two ways: without a word, and told where the scanner stood. FOLDER: real meshes as parts too,
scaled to 150 mm. Then every part is looked for in one scan of each of two others. Right: its surface is nowhere more
than 0.2 mm off. Seconds are processor time. Prints a table for docs/benchmarks.md, and exits with 1 where a wrong pose
was given with exit code 0.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from itertools import chain
from pathlib import Path

import numpy as np
import trimesh

from bench.support.children import map_inputs
from bench.support.runner import PARTS, open_table, read_words
from camgen.localize import Location, localize
from camgen.model.errors import CamgenError
from camgen.read.files import Files
from camgen.read.solid import mesh as solids
from tests.support import shells
from tests.support.clouds import placed

NOISE, OFF, AWAY, SIZE = 0.05, 0.2, 600.0, 150.0
#: In the scans of which other parts, so many places further in the list, a part is looked for.
OTHERS = (1, 4)
KINDS = {
    "sheets": {"sheet 1.6": shells.sheet, "angle 2": shells.angle, "steps 1.2": shells.step_sheet},
    "hollow": {
        "tray": shells.tray,
        "housing": shells.housing,
        "channel": shells.channel,
        "comb": shells.comb,
    },
}
FIXTURES = ("rfa1", "rfa2")
#: Closed meshes of the folder that may be parts, by how thin they are.
REAL = {
    "sheets": ("trimesh/1002_tray_bottom.STL", "trimesh/plate_holes.STL"),
    "solid": ("trimesh/featuretype.STL", "numpy-stl/ascii_Star.stl"),
}
Array = np.ndarray
#: What was looked for, what was told, what came of it, seconds.
Row = tuple[str, str, str, float]
OUTCOMES = ("right", "right, ambiguous", "exit 3", "exit 2", "wrong, ambiguous", "wrong")


def parts(folder: Path | None, names: list[str]) -> dict[str, tuple[str, trimesh.Trimesh]]:
    """Kind and mesh of each part."""
    found = {name: (kind, make()) for kind, some in KINDS.items() for name, make in some.items()}
    found |= {name: ("solid", load(PARTS / f"{name}.stl")) for name in FIXTURES}
    if folder is not None:
        found |= {
            Path(name).stem: (kind, load(folder / name, SIZE))
            for kind, some in REAL.items()
            for name in some
        }
    return {name: part for name, part in found.items() if not names or name in names}


def load(path: Path, size: float | None = None) -> trimesh.Trimesh:
    surface, _ = solids.read_surface(Files().read(path))
    factor = 1.0 if size is None else size / float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    return trimesh.Trimesh(surface.vertices * factor, surface.faces, process=False)


def eyes(mesh: trimesh.Trimesh, count: int) -> Array:
    """Places (count, 3) on a spiral around the part, none of them along an axis."""
    k = np.arange(count) + 0.5
    up, turn = 1 - 2 * k / count, k * np.pi * (3 - 5**0.5) + 0.4
    round_ = np.sqrt(1 - up * up)
    return np.asarray(
        mesh.bounds.mean(axis=0)
        + AWAY * np.column_stack([round_ * np.cos(turn), round_ * np.sin(turn), up])
    )


def off(mesh: trimesh.Trimesh, truth: tuple[Array, Array], found: Location) -> float:
    """How far the surface stands from where it should, mm at most: of parts that look alike in several poses the
    distance between the surfaces, not between their points.
    """
    rng = np.random.default_rng(0)
    spots = np.vstack(
        [mesh.vertices[rng.permutation(len(mesh.vertices))[:300]], mesh.sample(300, seed=0)]
    )
    pose = found.base_from_work
    there = spots @ np.array(pose.rotation).T + np.array(pose.origin)
    farthest = float(np.linalg.norm(there - (spots @ truth[0].T + truth[1]), axis=1).max())
    if farthest < OFF:
        return farthest
    back = (there - truth[1]) @ truth[0]
    corners = mesh.triangles
    least = [
        np.linalg.norm(
            trimesh.triangles.closest_point(corners, np.broadcast_to(p, (len(corners), 3))) - p,
            axis=1,
        ).min()
        for p in back
    ]
    return float(max(least))


def outcome(
    mesh: trimesh.Trimesh, points: Array, eye: Array | None, truth: tuple[Array, Array] | None
) -> tuple[str, float, str]:
    """What ``localize`` makes of a scan, mm off and what it says. truth: None where the part is not in the scan."""
    try:
        found = localize("scan", (mesh.vertices, mesh.faces), points, viewpoint=eye)
    except CamgenError as error:
        return f"exit {error.exit_code}", 0.0, error.where
    error = np.inf if truth is None else off(mesh, truth, found)
    told = bool(found.rivals or found.free)
    return (
        ("right" if error < OFF else "wrong") + (", ambiguous" if told else ""),
        error,
        f"near {found.seen.near:.2f}, rims {found.run_on:.2f}",
    )


def run(job: tuple[str, int, int, Path | None, list[str]]) -> list[Row]:
    """All that is looked for of one part: in its own scans, and in one scan of each of two others."""
    name, views, count, folder, names = job
    every = parts(folder, names)
    listed = list(every)
    others = [
        listed[(listed.index(name) + step) % len(listed)] for step in OTHERS if len(listed) > step
    ]
    rows = []
    for there, k in [*((name, k) for k in range(views)), *((other, views - 1) for other in others)]:
        mesh = every[there][1]
        eye = eyes(mesh, views)[k]
        turn, shift = placed(np.random.default_rng(2000 + k), 30.0, 50.0)
        points = shells.one_sided(mesh, count, k, eye, NOISE) @ turn.T + shift
        for way, place in (("nothing", None), ("viewpoint", turn @ eye + shift)):
            begin = time.process_time()
            verdict, error, said = outcome(
                every[name][1], points, place, (turn, shift) if there == name else None
            )
            spent = time.process_time() - begin
            print(
                f"{name} in {there} {k} {way}: {verdict} {error:.3f} mm {spent:.1f} s {said}",
                file=sys.stderr,
                flush=True,
            )
            rows.append((every[name][0] if there == name else "another part", way, verdict, spent))
    return rows


def main(views: int, count: int, processes: int, source: str, *names: str) -> int:
    folder = None if source == "-" else Path(source)
    jobs = [(name, views, count, folder, list(names)) for name in parts(folder, list(names))]
    rows = list(chain.from_iterable(map_inputs(run, jobs, processes)))
    table = open_table(f"parts | told | runs | {' | '.join(OUTCOMES)} | s, median {{:.1f}}")
    for kind, way in sorted({row[:2] for row in rows}):
        group = [row for row in rows if row[:2] == (kind, way)]
        tally = Counter(row[2] for row in group)
        counts = [tally[outcome] for outcome in OUTCOMES]
        table.add(kind, way, len(group), *counts, np.median([row[3] for row in group]))
    return int(any(row[2].startswith("wrong") for row in rows))


if __name__ == "__main__":
    raise SystemExit(main(*read_words(4, 20_000, 1, "-")))
