"""Which loops of a drawing have nothing to do with each other at some distance: told by boxes, for all of them at once.

A large drawing is mostly small loops, each by itself. What is worked out for such a loop needs no tree of all the
others, and to tell which they are takes a tree of loops, not of segments: only where their boxes meet is looked closer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from camgen.geometry.intersect import FEW, box, boxes_meet
from camgen.geometry.ragged import PAIRS, begins, each_once, stretches
from camgen.geometry.segments import IntArray, Segments, bounds
from camgen.model.pose import FloatArray

#: mm, beyond its distance nothing asks for what is so much farther from a curve: no step aside, no end that may be off
#: by a little, no check.
_BEYOND = 0.01


def box_pairs(
    asked: FloatArray, boxes: FloatArray, owner: IntArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs of a box that is ``asked`` (M, 4) and one of ``boxes`` (N, 4) that have a point in common, in chunks of
    whole boxes that are asked. owner: (N,) the loop that each of the others belongs to.
    """
    sizes = np.bincount(owner)
    order = np.argsort(owner, kind="stable")
    loops = np.flatnonzero((sizes > 0) & (sizes <= FEW))
    single = np.flatnonzero(sizes[owner[order]] > FEW)
    # A small loop is one box of the tree; its segments are looked at where that is met.
    first = np.concatenate([begins(sizes)[loops], single])
    counts = np.concatenate([sizes[loops], np.ones(len(single), dtype=np.int64)])
    tree = shapely.STRtree(
        box(np.concatenate([around(boxes, owner, len(sizes))[loops], boxes[order[single]]]))
    )
    step, done = 256, 0
    while done < len(asked):
        which, item = tree.query(box(asked[done : done + step]))
        row = order[stretches(first[item], counts[item])]
        which = np.repeat(which + done, counts[item])
        done += step
        # As many at a time as the last ones let expect.
        step = int(np.clip(PAIRS * step / max(len(which), 1), 16, 4 * step))
        met = boxes_meet(asked, which, boxes, row)
        yield which[met], row[met]


def around(boxes: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """(count, 4) the box around all ``boxes`` (N, 4) of each ``owner`` (N,); of one that has none a box that meets no
    other.
    """
    result = np.tile([np.inf, np.inf, -np.inf, -np.inf], (count, 1))
    for side, widest in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
        widest.at(result[:, side], owner, boxes[:, side])
    return result


def set_apart(
    source: Segments, group: IntArray, candidates: Segments, origin: IntArray, distance: float
) -> IntArray:
    """``group`` (N,) with labels of their own for small loops of ``source`` that are apart from all others of their
    group: their curve at ``distance`` mm is the same without the others, and theirs without them.

    candidates: all that the curves are cut out of, or the curves, to check them; origin: (C,) the segment of the source
    that each belongs to. Two loops are apart where the candidates of each are farther than the distance from the other
    and do not meet those of the other.
    """
    owner = source.owner
    sizes = np.bincount(owner)
    # Of a few segments all pairs are looked at as it is.
    asked = (sizes > 0) & (sizes <= FEW)
    asked[owner[np.bincount(group)[group] <= FEW]] = False
    loops = np.flatnonzero(asked)
    if not len(loops):
        return group
    label = np.zeros(len(sizes), dtype=np.int64)
    label[owner] = group
    drawn, made = bounds(source), around(bounds(candidates), origin, len(source))
    both = np.column_stack(
        [np.minimum(drawn[:, :2], made[:, :2]), np.maximum(drawn[:, 2:], made[:, 2:])]
    )
    reach, beside = (
        np.array([-1, -1, 1, 1]) * (distance + _BEYOND),
        np.array([-1, -1, 1, 1]) * _BEYOND,
    )
    own_drawn, own_made = (around(boxes, owner, len(sizes)) for boxes in (drawn, made))
    own_both = around(both, owner, len(sizes)) + reach
    met = [np.zeros(0, dtype=np.int64)]
    for which, segment in box_pairs(own_both[loops], both, owner):
        other = (owner[segment] != loops[which]) & (group[segment] == label[loops[which]])
        loop, row = loops[which[other]], segment[other]
        near = boxes_meet(own_made + reach, loop, drawn, row) | boxes_meet(
            own_drawn + reach, loop, made, row
        )
        near |= boxes_meet(own_made + beside, loop, made, row)
        met.append(each_once(loop[near] * len(sizes) + owner[row[near]]))
    # Of two small loops it is enough that the box of one is apart from all segments of the other.
    pairs = each_once(np.concatenate(met))
    one, two = np.divmod(pairs, len(sizes))
    together = one[~asked[two] | np.isin(two * len(sizes) + one, pairs)]
    asked[together] = False
    return np.where(asked[owner], int(group.max()) + 1 + owner, group)
