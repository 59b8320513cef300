"""Read every mesh and STEP part of a folder and print a table: edges, convex length against the measured one, seconds.

    python -m bench.read.edges [FOLDER]

FOLDER holds ``truth.jsonl``, ``mesh/``, ``step/`` and ``cloud/`` (default: ``shared/data`` beside the repository). The
measured length of a mesh is that of the sharp sides of its triangles, so these are compared; the length of the edges
recognised stands beside it, and is longer where arcs were drawn with few sides. STEP needs the extra ``step``.
"""

from __future__ import annotations

import json
import re
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from bench.machine import machine
from camgen.model.errors import CamgenError
from camgen.model.part import FEATURE_ANGLE, Solid
from camgen.read.files import Files
from camgen.read.solid import STEP, mesh, step
from camgen.read.solid import mesh_file as mesh_load

DEFAULT = Path(__file__).parents[3] / "shared" / "data"
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
        136 + 4 * 75**0.5,
        "by hand, lines of a roofed block; measured without its flat faces",
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
    surface, _ = mesh.surface(Files().read(path))
    sides = surface.sides(FEATURE_ANGLE)
    along = surface.vertices[sides.end] - surface.vertices[sides.start]
    return float(np.linalg.norm(along[sides.convex], axis=1).sum())


def verdict(name: str, length: float, truth: float | None) -> str:
    if truth is not None and abs(length - truth) <= TOLERANCE * max(truth, 1e-9):
        return "ok" if not truth else f"ok, {100 * (length / truth - 1):+.3f} %"
    if name in KNOWN and abs(length - KNOWN[name][0]) <= TOLERANCE * KNOWN[name][0]:
        return f"ok, {100 * (length / KNOWN[name][0] - 1):+.3f} % of {KNOWN[name][0]:.4f} ({KNOWN[name][1]})"
    return "DIFFERS" + (f" {100 * (length / truth - 1):+.2f} %" if truth else "")


def row(path: Path, truth: dict[str, Any]) -> str:
    exact = path.suffix.lower() in STEP
    start = time.perf_counter()
    try:
        solid = (step if exact else mesh).read(Files().read(path))
    except CamgenError as error:
        return f"| {path.name} | - | - | - | - | - | refused: {error} |"
    seconds = time.perf_counter() - start
    convex, concave = counts(solid)
    true_convex, true_concave, true_length = measured(truth)
    found = f"{convex} + {concave} ({true_convex} + {true_concave})"
    kinds = (
        ", ".join(f"{n} {k}" for k, n in sorted(Counter(e.kind for e in solid.edges).items()))
        or "none"
    )
    length = convex_length(path, solid)
    recognised = sum(e.length for e in solid.edges if e.convex)
    return (
        f"| {path.name} | {found} | {length:.3f} ({true_length}) | {kinds} "
        f"| {recognised:.3f} | {seconds:.3f} | {verdict(path.name, length, true_length)} |"
    )


def main(folder: Path) -> int:
    truth = {}
    for line in (folder / "truth.jsonl").read_text().splitlines():
        entry = json.loads(line)
        truth[entry.get("file")] = entry
    print(machine(), end="\n\n")
    print(
        "| file | convex + concave (measured) | convex mm (measured) | edges | convex mm as edges | s | verdict |"
    )
    print("|---|---|---|---|---|---|---|")
    wrong = 0
    for path in sorted(p for kind in ("mesh", "step", "cloud") for p in (folder / kind).rglob("*")):
        if path.suffix.lower() in (*mesh_load.SUFFIXES, *STEP):
            line = row(path, truth.get(str(path.relative_to(folder)), {}))
            wrong += "DIFFERS" in line
            print(line)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else DEFAULT))
