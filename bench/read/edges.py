"""Read every mesh and STEP part of a folder and print a table: edges, convex length against the measured one, seconds.

    python -m bench.read.edges [FOLDER]

FOLDER holds ``truth.jsonl``, ``mesh/``, ``step/`` and ``cloud/`` (default: ``shared/data`` beside the repository). The
measured length of a mesh is that of the sharp sides of its triangles, so these are compared; the length of the edges
recognised stands beside it, and is longer where arcs were drawn with few sides. STEP needs the extra ``step``.
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
#: Parts that are mended before they are measured: convex length, mm, found in another way, and which.
KNOWN = {
    "triamid.stl": (28.9706, "by trimesh once it has mended the winding; measured as wound"),
    "multibody.stl": (
        5.1582,
        "by trimesh once it has turned the bodies outward; measured inside out",
    ),
    "wallhole.obj": (
        160 + 4 * 75**0.5,
        "by hand, lines of a roofed block with a groove; measured with its T-junctions open",
    ),
    "box_sides.STEP": (
        8421.617,
        "by probes around the edges of its ten bodies, which touch; measured body by body",
    ),
    "binary_HalfDonut.stl": (
        12.4858,
        "of its twin in text; measured as unreadable for a stray byte at the end",
    ),
}


def counts(solid: Solid) -> tuple[int, int]:
    """Convex and concave sides of triangles or edges of the file, before they are joined."""
    found = [m for m in (COUNTED.search(n.what) for n in solid.notes) if m]
    return (int(found[0][1]), int(found[0][2])) if found else (0, 0)


def measured(truth: dict[str, Any]) -> tuple[int, int, float | None]:
    """Convex and concave count and convex length, mm."""
    if "dihedral" in truth:
        number, length = truth["dihedral"], truth["dihedral_len_mm"]
        return number.get("convex>30", 0), number.get("concave>30", 0), length.get("convex>30", 0.0)
    return (
        truth.get("convex30_edges", 0),
        truth.get("concave30_edges", 0),
        truth.get("convex30_len"),
    )


def convex_length(path: Path, solid: Solid) -> float:
    """mm, of the sharp sides of a mesh, of the edges of a STEP part."""
    if path.suffix.lower() in STEP:
        return sum(e.length for e in solid.edges if e.convex)
    surface, _ = mesh.read_surface(Files().read(path))
    sides = find_sharp_sides(
        surface.vertices, surface.faces, surface.normals, surface.pairs, FEATURE_ANGLE
    )
    along = surface.vertices[sides.end] - surface.vertices[sides.start]
    return float(np.linalg.norm(along[sides.convex], axis=1).sum())


def verdict(name: str, length: float, truth: float | None) -> str:
    if truth is not None and abs(length - truth) <= TOLERANCE * max(truth, 1e-9):
        return "ok" if not truth else f"ok, {100 * (length / truth - 1):+.3f} %"
    if name in KNOWN and abs(length - KNOWN[name][0]) <= TOLERANCE * KNOWN[name][0]:
        return f"ok, {100 * (length / KNOWN[name][0] - 1):+.3f} % of {KNOWN[name][0]:.4f} ({KNOWN[name][1]})"
    return Missed("DIFFERS" + (f" {100 * (length / truth - 1):+.2f} %" if truth else ""))


def judge(path: Path, truth: dict[str, Any]) -> Iterator[Cells]:
    """The row of a part."""
    reader = step if path.suffix.lower() in STEP else mesh
    try:
        solid, seconds = timed(partial(reader.read, Files().read(path)))
    except CamgenError as error:
        yield path.name, *"-----", f"refused: {error}"
        return
    *true_counts, true_length = measured(truth)
    kinds = sorted(Counter(e.kind for e in solid.edges).items())
    edges = ", ".join(f"{n} {k}" for k, n in kinds) or "none"
    length = convex_length(path, solid)
    recognised = sum(e.length for e in solid.edges if e.convex)
    sides, lengths = (*counts(solid), *true_counts), (length, true_length)
    judged = verdict(path.name, length, true_length)
    yield path.name, sides, lengths, edges, recognised, seconds, judged


if __name__ == "__main__":
    (folder,) = read_words(SHARED)
    truth = read_truth(folder)
    suffixes = (*mesh_file.SUFFIXES, *STEP)
    files = [
        path for kind in ("mesh", "step", "cloud") for path in find_files(folder / kind, suffixes)
    ]
    inputs = [(path, truth.get(str(path.relative_to(folder)), {})) for path in sorted(files)]
    sys.exit(run(Scenario(COLUMNS, inputs, judge)))
