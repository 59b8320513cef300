"""Reads every mesh and STEP part of a folder and compares its edges with those measured.

    python -m bench.read.edges [FOLDER]

FOLDER holds ``truth.jsonl``, ``mesh/``, ``step/`` and ``cloud/`` (default: ``shared/data`` beside
the repository). The measured length of a mesh is that of the sharp sides of its triangles, so these
are compared. The length of the recognised edges is a column too; it is longer where arcs were drawn
with few sides. STEP needs the extra ``step``.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.read.drawings import read_truth
from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, read_words, run
from bench.support.timing import timed
from camgen.model.errors import CamgenError
from camgen.model.part import FEATURE_ANGLE, Solid
from camgen.read.files import Files
from camgen.read.solid import STEP, mesh, mesh_file, step
from camgen.read.solid.sharp import find_sharp_sides

COLUMNS = (
    "file | convex + concave (measured) {} + {} ({} + {}) | convex mm (measured) {:.3f} ({}) "
    "| edges | convex mm as edges {:.3f} | s {:.3f} | verdict"
)
TOLERANCE = 0.005
COUNTED = re.compile(r"(\d+) convex and (\d+) concave")
#: The convex length of parts that were measured without repairs, mm, by another method.
KNOWN = {
    "triamid.stl": (28.9706, "by trimesh with the winding repaired; measured as wound"),
    "multibody.stl": (5.1582, "by trimesh with the bodies turned outward; measured inside out"),
    "wallhole.obj": (160 + 4 * 75**0.5, "by hand; measured with its T-junctions open"),
    "box_sides.STEP": (8421.617, "by probes around its edges; measured body by body"),
    "binary_HalfDonut.stl": (12.4858, "its twin in text; measured as unreadable"),
}


def count_sides(solid: Solid) -> tuple[int, int]:
    """Convex and concave sides of triangles or edges of the file, before they are joined."""
    for note in solid.notes:
        match = COUNTED.search(note.what)
        if match:
            return int(match[1]), int(match[2])
    return 0, 0


def read_measured(truth: dict[str, Any]) -> tuple[int, int, float | None]:
    """Convex and concave count and convex length, mm."""
    if "dihedral" in truth:
        number, length = truth["dihedral"], truth["dihedral_len_mm"]
        return number.get("convex>30", 0), number.get("concave>30", 0), length.get("convex>30", 0.0)
    numbers = truth.get("convex30_edges", 0), truth.get("concave30_edges", 0)
    return *numbers, truth.get("convex30_len")


def measure_convex(path: Path, solid: Solid) -> float:
    """The length of the convex sharp sides of a mesh, or edges of a STEP part, mm."""
    if path.suffix.lower() in STEP:
        return sum(e.length for e in solid.edges if e.convex)
    surface, _ = mesh.read_surface(Files().read(path))
    sides = find_sharp_sides(
        surface.vertices, surface.faces, surface.normals, surface.pairs, FEATURE_ANGLE
    )
    along = surface.vertices[sides.end] - surface.vertices[sides.start]
    return float(np.linalg.norm(along[sides.convex], axis=1).sum())


def compare_length(name: str, length: float, truth: float | None) -> str:
    """The verdict on the convex length of a part."""
    if truth is not None and abs(length - truth) <= TOLERANCE * max(truth, 1e-9):
        return "ok" if not truth else f"ok, {100 * (length / truth - 1):+.3f} %"
    known, method = KNOWN.get(name, (0.0, ""))
    if method and abs(length - known) <= TOLERANCE * known:
        return f"ok, {100 * (length / known - 1):+.3f} % of {known:.4f} ({method})"
    return Missed("DIFFERS" + (f" {100 * (length / truth - 1):+.2f} %" if truth else ""))


def measure(path: Path, truth: dict[str, Any]) -> Iterator[Cells]:
    """The row of a part."""
    reader = step if path.suffix.lower() in STEP else mesh
    try:
        solid, seconds = timed(partial(reader.read, Files().read(path)))
    except CamgenError as error:
        yield path.name, *"-----", f"refused: {error}"
        return
    *true_counts, true_length = read_measured(truth)
    kinds = sorted(Counter(e.kind for e in solid.edges).items())
    edges = ", ".join(f"{n} {k}" for k, n in kinds) or "none"
    length = measure_convex(path, solid)
    recognised = sum(e.length for e in solid.edges if e.convex)
    sides, lengths = (*count_sides(solid), *true_counts), (length, true_length)
    verdict = compare_length(path.name, length, true_length)
    yield path.name, sides, lengths, edges, recognised, seconds, verdict


if __name__ == "__main__":
    (folder,) = read_words(SHARED)
    truth = read_truth(folder)
    suffixes = (*mesh_file.SUFFIXES, *STEP)
    files = []
    for kind in ("mesh", "step", "cloud"):
        files += find_files(folder / kind, suffixes)
    inputs = [(path, truth.get(str(path.relative_to(folder)), {})) for path in sorted(files)]
    sys.exit(run(Scenario(COLUMNS, inputs, measure)))
