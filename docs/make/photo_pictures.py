"""The picture of refused photos in docs/benchmarks.md.

python -m docs.make.photo_pictures [FOLDER]      writes it into FOLDER (default: docs/images)
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from bench.render.conditions import draw_conditions, draw_photo

#: Numbers of the photos that `bench.photo.conditions` refuses.
REFUSED = (11, 17, 23)
#: Width and height of each, px.
_SIZE = (360, 300)


def show(number: int) -> np.ndarray:
    """The part of a photo around the part, (300, 360) uint8, with the number of the photo."""
    photo = draw_photo(number, draw_conditions(number))
    low, high = photo.box
    middle, half = (low + high) / 2, np.ptp(photo.box, axis=0).max() * 0.6
    left, top = (middle - half * np.array([1.2, 1.0])).clip(0).astype(int)
    right, bottom = (middle + half * np.array([1.2, 1.0])).astype(int)
    picture = cv2.resize(photo.pixels[top:bottom, left:right], _SIZE, interpolation=cv2.INTER_AREA)
    cv2.putText(picture, str(number), (8, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.9, 255, 4, cv2.LINE_AA)
    cv2.putText(picture, str(number), (8, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.9, 0, 1, cv2.LINE_AA)
    return np.asarray(picture)


def main(folder: Path) -> None:
    picture = np.hstack([show(number) for number in REFUSED])
    cv2.imwrite(str(folder / "photos-refused.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
