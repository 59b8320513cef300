"""Parts scanned from one viewpoint: sheets, hollow and solid parts, with and without the viewpoint.

    python -m bench.read.one_sided [VIEWS, 4] [POINTS, 20000] [PROCESSES, 1] [FOLDER | -] [PART ...]

Each part is scanned from VIEWS viewpoints around it, 600 mm away, with 0.05 mm noise, and placed at
random within 30 deg and 50 mm. It is localized in its scans, and in one scan of each of two other
parts, twice: without and with the viewpoint. FOLDER adds real meshes as parts, scaled to 150 mm. A
pose is right if no point of the surface is more than 0.2 mm off. Seconds are processor time. Prints
a table for docs/benchmarks.md. The exit code is 1 if `localize` returned a wrong pose.
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

#: mm: noise of the scanner, tolerance of a right pose, distance of the viewpoint, size of a mesh.
NOISE, OFF, AWAY, SIZE = 0.05, 0.2, 600.0, 150.0
#: Steps in the list of parts from a part to those in whose scans it is localized.
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
#: Kind of the part, given input, outcome, seconds.
Row = tuple[str, str, str, float]
OUTCOMES = ("right", "right, ambiguous", "exit 3", "exit 2", "wrong, ambiguous", "wrong")


def load_parts(folder: Path | None, names: list[str]) -> dict[str, tuple[str, trimesh.Trimesh]]:
    """Kind and mesh of each part."""
    meshes = {}
    for kind, makers in KINDS.items():
        for name, make in makers.items():
            meshes[name] = kind, make()
    for name in FIXTURES:
        meshes[name] = "solid", load(PARTS / f"{name}.stl")
    if folder is not None:
        for kind, files in REAL.items():
            for file in files:
                meshes[Path(file).stem] = kind, load(folder / file, SIZE)
    return {name: part for name, part in meshes.items() if not names or name in names}


def load(path: Path, size: float | None = None) -> trimesh.Trimesh:
    """Reads a mesh. size: length of the diagonal to which it is scaled, mm."""
    surface, _ = solids.read_surface(Files().read(path))
    diagonal = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    factor = 1.0 if size is None else size / diagonal
    return trimesh.Trimesh(surface.vertices * factor, surface.faces, process=False)


def list_viewpoints(mesh: trimesh.Trimesh, count: int) -> Array:
    """Viewpoints (count, 3) on a spiral around the part, none of them along an axis, mm."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, k * np.pi * (3 - 5**0.5) + 0.4
    radius = np.sqrt(1 - z * z)
    directions = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    return np.asarray(mesh.bounds.mean(axis=0) + AWAY * directions)


def measure_error(mesh: trimesh.Trimesh, truth: tuple[Array, Array], location: Location) -> float:
    """The largest distance of the located surface from its true place, mm.

    Where points are off, the distance between the surfaces counts: a part may look alike in
    several poses.
    """
    rng = np.random.default_rng(0)
    vertices = mesh.vertices[rng.permutation(len(mesh.vertices))[:300]]
    points = np.vstack([vertices, mesh.sample(300, seed=0)])
    pose = location.base_from_work
    located = points @ np.array(pose.rotation).T + np.array(pose.origin)
    farthest = float(np.linalg.norm(located - (points @ truth[0].T + truth[1]), axis=1).max())
    if farthest < OFF:
        return farthest
    corners = mesh.triangles
    distances = []
    for point in (located - truth[1]) @ truth[0]:
        closest = trimesh.triangles.closest_point(
            corners, np.broadcast_to(point, (len(corners), 3))
        )
        distances.append(np.linalg.norm(closest - point, axis=1).min())
    return float(max(distances))


def localize_part(
    mesh: trimesh.Trimesh, points: Array, viewpoint: Array | None, truth: tuple[Array, Array] | None
) -> tuple[str, float, str]:
    """Localizes a part in a scan. Returns the outcome, the error in mm, and figures of the fit.

    truth: rotation and origin of the part, None if it is not in the scan.
    """
    try:
        location = localize("scan", (mesh.vertices, mesh.faces), points, viewpoint=viewpoint)
    except CamgenError as error:
        return f"exit {error.exit_code}", 0.0, error.where
    error = np.inf if truth is None else measure_error(mesh, truth, location)
    outcome = "right" if error < OFF else "wrong"
    if location.rivals or location.free:
        outcome += ", ambiguous"
    return outcome, error, f"near {location.seen.near:.2f}, rims {location.run_on:.2f}"


def measure_part(job: tuple[str, int, int, Path | None, list[str]]) -> list[Row]:
    """Localizes a part in its own scans, and in one scan of each of two others."""
    name, views, count, folder, names = job
    parts = load_parts(folder, names)
    order = list(parts)
    scans = [(name, k) for k in range(views)]
    for step in OTHERS:
        if len(order) > step:
            scans.append((order[(order.index(name) + step) % len(order)], views - 1))
    part_kind, part = parts[name]
    rows = []
    for scanned, k in scans:
        mesh = parts[scanned][1]
        viewpoint = list_viewpoints(mesh, views)[k]
        rotation, origin = placed(np.random.default_rng(2000 + k), 30.0, 50.0)
        points = shells.one_sided(mesh, count, k, viewpoint, NOISE) @ rotation.T + origin
        truth = (rotation, origin) if scanned == name else None
        kind = part_kind if scanned == name else "another part"
        for given, place in (("nothing", None), ("viewpoint", rotation @ viewpoint + origin)):
            begin = time.process_time()
            outcome, error, figures = localize_part(part, points, place, truth)
            spent = time.process_time() - begin
            line = f"{name} in {scanned} {k} {given}: {outcome} {error:.3f} mm {spent:.1f} s"
            print(line, figures, file=sys.stderr, flush=True)
            rows.append((kind, given, outcome, spent))
    return rows


def main(views: int, count: int, processes: int, source: str, *names: str) -> int:
    """Prints the table."""
    folder = None if source == "-" else Path(source)
    jobs = [(name, views, count, folder, list(names)) for name in load_parts(folder, list(names))]
    rows = list(chain.from_iterable(map_inputs(measure_part, jobs, processes)))
    table = open_table(f"parts | given | runs | {' | '.join(OUTCOMES)} | s, median {{:.1f}}")
    for kind, given in sorted({row[:2] for row in rows}):
        group = [row for row in rows if row[:2] == (kind, given)]
        tally = Counter(row[2] for row in group)
        counts = [tally[outcome] for outcome in OUTCOMES]
        table.add(kind, given, len(group), *counts, np.median([row[3] for row in group]))
    return int(any(row[2].startswith("wrong") for row in rows))


if __name__ == "__main__":
    raise SystemExit(main(*read_words(4, 20_000, 1, "-")))
