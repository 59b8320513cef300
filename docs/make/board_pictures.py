"""The pictures of docs/fill.md and docs/drill.md.

python -m docs.make.board_pictures [FOLDER]      writes them into FOLDER (default: docs/images)
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from bench.plan.boards import MM, board, marks, part_of
from camgen.plan.fill import fill
from camgen.plan.fill.cover import make_coverage_map, run_along
from camgen.read.job_file import from_mapping
from camgen.vision.crosses import find_crosses

#: Colours of lines and marks: blue, green, red.
_LINE, _MARK = (150, 60, 20), (30, 30, 220)


def draw_coverage(pixels: int, seed: int, diameter: float) -> np.ndarray:
    """A rendered board with the area that its strokes cover, and the lines of the strokes."""
    part = part_of(board(pixels, seed, plane=True))
    paths, _, _ = fill(
        part, from_mapping({"operation": {"kind": "fill"}, "tool": {"diameter": diameter}})
    )
    coverage = make_coverage_map(part, paths, diameter, 1800)
    picture = coverage.pixels.copy()
    back = np.linalg.inv(np.vstack([coverage.work_from_map, [0, 0, 1]]))[:2]
    for path in paths:
        points = run_along(path, 0.01) @ back[:, :2].T + back[:, 2]
        cv2.polylines(
            picture,
            [np.rint(points * 16).astype(np.int32)[:, None]],
            False,
            _LINE,
            1,
            cv2.LINE_AA,
            4,
        )
    return picture[300:1200, 500:1700]


def draw_marks(seed: int) -> np.ndarray:
    """A rendered board, three times as large, with a circle and a number at each mark."""
    photo = marks(seed)
    picture = cv2.cvtColor(
        cv2.resize(photo.picture, None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST),
        cv2.COLOR_GRAY2BGR,
    )
    for k, cross in enumerate(find_crosses(photo.ink, photo.picture), 1):
        u, v = round(3 * cross.u + 1), round(3 * cross.v + 1)
        cv2.circle(picture, (u, v), round(3 * cross.reach) + 8, _MARK, 2, cv2.LINE_AA)
        cv2.putText(
            picture, str(k), (u + 40, v - 30), cv2.FONT_HERSHEY_SIMPLEX, 0.9, _MARK, 2, cv2.LINE_AA
        )
    return picture[:600, :1000]


if __name__ == "__main__":
    folder = (
        Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[2] / "docs" / "images"
    )
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in (
        ("fill-coverage", draw_coverage(600, 2, 0.85)),
        ("drill-marks", draw_marks(7)),
    ):
        small = cv2.resize(picture, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{name}.png"), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"pictures of boards at {1 / MM:.1f} px per mm in {folder.name}")
