"""Where the part hangs on how it is told from the bench: what was chosen beside the other ways.

Of a part that stands clear of its bench every way finds the same, but for the blur of its border. A cast shadow, a
shiny face or uneven light does not lie on the same side for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
from msgspec import Struct

from camgen.vision.mask.cells import Bools, Bytes, Cells, depth, inner_cells
from camgen.vision.mask.channel import Found
from camgen.vision.mask.level import spread_out

#: A part has two tones if what lies between them is so much of all that varies in it (evenly spread values: 0.75), and
#: they are so far apart, of 255.
_TWO_TONES, _APART = 0.8, 8.0
#: So far, of the contrast, the level is moved to both sides.
_MOVED = 0.25
#: Cells that a blurred border may move by; deeper it is more than the border that differs.
_BORDER = 2.5
#: A place is told from this share of the part on.
_SHARE = 0.002


class Doubt(Struct, frozen=True, eq=False):
    """where (h, w): cells that another way sees differently. by: which way, and how many cells, most first.

    places: (row, column) of a cell in each of the places, the largest first.
    """

    where: Bools
    by: tuple[tuple[str, int], ...]
    places: tuple[tuple[int, int], ...]


def other_levels(found: Found, cells: Cells) -> dict[str, Bools]:
    """The part with its border a quarter of the contrast nearer to the bench's tone, and to its own."""
    levels = found.levels
    level = spread_out(levels.tiles, levels.tile, found.part.shape)
    side = np.less if levels.contrast < 0 else np.greater
    return {
        f"a level nearer to {name}": np.asarray(
            side(found.channel.cells, level + np.float32(share * levels.contrast)) & cells.valid,
            np.bool_,
        )
        for name, share in (("the bench", -_MOVED), ("the part", _MOVED))
    }


def first_tone(found: Found) -> Bools | None:
    """The larger part of two, if the part has two tones: the other one may be its shadow. None where it has one."""
    inner = inner_cells(found.part)
    # In the light of the bench: a part in uneven light has many tones.
    bench = np.maximum(found.bench.values, np.float32(1))
    values = found.channel.cells * (
        np.median(bench) / bench if found.channel.black == 0 else np.float32(1)
    )
    tones = values[inner]
    if not len(tones):
        return None
    seen = np.clip(np.rint(tones), 0, 255).astype(np.uint8)
    level = float(cv2.threshold(seen, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[0]) + 0.5
    high = tones > level
    share = float(np.mean(high))
    if not 0 < share < 1:
        return None
    apart = float(tones[high].mean() - tones[~high].mean())
    if apart < _APART or share * (1 - share) * apart**2 < _TWO_TONES * float(tones.var()):
        return None
    return np.asarray(found.part & ((values > level) == (share > 0.5)), np.bool_)


def find_doubt(
    part: Bools, others: Mapping[str, Bools], cells: Cells, least: float
) -> Doubt | None:
    """Where the ``others`` by name differ from ``part``; None where nothing does. least: px2 of a place."""
    where = np.zeros_like(part)
    by: dict[str, int] = {}
    small = max(least / cells.size**2, _SHARE * np.count_nonzero(part))
    for name, other in others.items():
        differs = _places_of(part ^ other, small)
        if differs is not None:
            by[name] = int(np.count_nonzero(differs))
            where |= differs
    if not by:
        return None
    _, _, stats, middles = cv2.connectedComponentsWithStats(where.view(np.uint8))
    order = np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")
    places = tuple((round(float(v)), round(float(u))) for u, v in middles[1:][order].tolist())
    return Doubt(where, tuple(sorted(by.items(), key=lambda item: -item[1])), places)


def _places_of(differs: Bools, small: float) -> Bools | None:
    """The places of ``differs`` that are wider than a border and not ``small``, whole."""
    deep = depth(differs) > _BORDER
    if not deep.any():
        return None
    count, labels, stats, _ = cv2.connectedComponentsWithStats(differs.view(np.uint8))
    kept = np.zeros(count, np.bool_)
    kept[np.unique(labels[deep])] = True
    kept &= stats[:, cv2.CC_STAT_AREA] >= small
    kept[0] = False
    return np.asarray(kept[labels], np.bool_) if kept.any() else None


def show_doubt(doubt: Doubt, cells: Cells, shape: tuple[int, ...]) -> Bytes:
    """(H, W): 255 at the pixels in doubt."""
    size = (doubt.where.shape[1] * cells.size, doubt.where.shape[0] * cells.size)
    whole = cv2.resize(
        doubt.where.view(np.uint8) * np.uint8(255), size, interpolation=cv2.INTER_NEAREST
    )
    below, beside = shape[0] - whole.shape[0], shape[1] - whole.shape[1]
    return np.asarray(
        cv2.copyMakeBorder(whole, 0, below, 0, beside, cv2.BORDER_CONSTANT, value=0), np.uint8
    )
