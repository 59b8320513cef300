"""A plate as an OBJ file."""

from itertools import product
from pathlib import Path

import numpy as np

#: mm.
PLATE_SIZE = (60.0, 40.0, 10.0)
_QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def write_plate(folder: Path) -> Path:
    """The file of a box from the origin: plate.obj."""
    corners = np.array(list(product((0, 1), repeat=3))) * PLATE_SIZE
    lines = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    for a, b, c, d in _QUADS:
        lines += [f"f {a + 1} {c + 1} {b + 1}", f"f {a + 1} {d + 1} {c + 1}"]
    (folder / "plate.obj").write_text("\n".join(lines))
    return folder / "plate.obj"
