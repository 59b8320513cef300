"""Finds loops of a drawing that have no influence on each other's offset curves, by their boxes.

A large drawing consists mostly of small loops, each by itself. The offset curve of such a loop
needs no tree of all other segments. To find these loops, one tree of loops is enough: segments are
compared only where the boxes of their loops meet.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from camgen.geometry.intersect import FEW, boxes_meet, make_boxes, query_tree
from camgen.geometry.ragged import compute_first_rows, list_range_numbers, select_distinct
from camgen.geometry.segments import IntArray, Segments, compute_bounds
from camgen.model.pose import FloatArray

#: mm: margin around boxes. The steps aside, tolerances of ends and checks of an offset reach no
#: farther than this beyond its distance.
_MARGIN_MM = 0.01
#: Outward direction of xmin, ymin, xmax and ymax of a box.
_OUTWARD = np.array([-1, -1, 1, 1])


def find_box_pairs(
    queries: FloatArray, boxes: FloatArray, owner: IntArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield pairs of rows of `queries` (M, 4) and `boxes` (N, 4) that have a point in common.

    Pairs come in chunks, all pairs of a row of `queries` in the same chunk. Boxes are xmin, ymin,
    xmax, ymax, mm.

    owner: (N,) the loop to which each of `boxes` belongs.
    """
    sizes = np.bincount(owner)
    order = np.argsort(owner, kind="stable")
    loops = np.flatnonzero((sizes > 0) & (sizes <= FEW))
    single = np.flatnonzero(sizes[owner[order]] > FEW)
    # A small loop is one box of the tree. Its segments are compared only if that box is met.
    first = np.concatenate([compute_first_rows(sizes)[loops], single])
    counts = np.concatenate([sizes[loops], np.ones(len(single), dtype=np.int64)])
    loop_boxes = merge_boxes(boxes, owner, len(sizes))[loops]
    tree = shapely.STRtree(make_boxes(np.concatenate([loop_boxes, boxes[order[single]]])))
    for query, item in query_tree(tree, queries):
        row = order[list_range_numbers(first[item], counts[item])]
        which = np.repeat(query, counts[item])
        meets = boxes_meet(queries, which, boxes, row)
        yield which[meets], row[meets]


def merge_boxes(boxes: FloatArray, owner: IntArray, count: int) -> FloatArray:
    """(count, 4) the box around all `boxes` (N, 4) of each `owner` (N,).

    An owner without boxes gets a box from inf to -inf, which meets no other.
    """
    result = np.tile([np.inf, np.inf, -np.inf, -np.inf], (count, 1))
    for side, widest in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
        widest.at(result[:, side], owner, boxes[:, side])
    return result


def set_apart(
    source: Segments, group: IntArray, candidates: Segments, origin: IntArray, distance: float
) -> IntArray:
    """`group` (N,) with labels of their own for the small loops that are independent.

    The offset curve of an independent loop at `distance` mm is the same with and without the other
    loops of its group, and theirs with and without it. Two loops are independent if the candidates
    of each are farther than `distance` from the other loop, and the candidates of the two do not
    meet.

    source: N segments of loops.
    group: (N,) labels; only loops with the same label are compared.
    candidates: C segments from which the offset curves are cut, or the curves themselves.
    origin: (C,) the segment of `source` to which each candidate belongs.
    """
    owner = source.owner
    sizes = np.bincount(owner)
    # In a group of few segments all pairs are compared anyway.
    is_tested = (sizes > 0) & (sizes <= FEW)
    is_tested[owner[np.bincount(group)[group] <= FEW]] = False
    loops = np.flatnonzero(is_tested)
    if not len(loops):
        return group
    label = np.zeros(len(sizes), dtype=np.int64)
    label[owner] = group
    drawn = compute_bounds(source)
    offset_boxes = merge_boxes(compute_bounds(candidates), origin, len(source))
    both = np.column_stack(
        [
            np.minimum(drawn[:, :2], offset_boxes[:, :2]),
            np.maximum(drawn[:, 2:], offset_boxes[:, 2:]),
        ]
    )
    reach = _OUTWARD * (distance + _MARGIN_MM)
    margin = _OUTWARD * _MARGIN_MM
    loop_drawn = merge_boxes(drawn, owner, len(sizes))
    loop_offset = merge_boxes(offset_boxes, owner, len(sizes))
    loop_both = merge_boxes(both, owner, len(sizes)) + reach
    met = [np.zeros(0, dtype=np.int64)]
    for which, segment in find_box_pairs(loop_both[loops], both, owner):
        is_other = (owner[segment] != loops[which]) & (group[segment] == label[loops[which]])
        loop, row = loops[which[is_other]], segment[is_other]
        near = boxes_meet(loop_offset + reach, loop, drawn, row)
        near |= boxes_meet(loop_drawn + reach, loop, offset_boxes, row)
        near |= boxes_meet(loop_offset + margin, loop, offset_boxes, row)
        met.append(select_distinct(loop[near] * len(sizes) + owner[row[near]]))
    # Two small loops are independent if the box of one is clear of all segments of the other.
    pairs = select_distinct(np.concatenate(met))
    first, second = np.divmod(pairs, len(sizes))
    is_tested[first[~is_tested[second] | np.isin(second * len(sizes) + first, pairs)]] = False
    return np.where(is_tested[owner], int(group.max()) + 1 + owner, group)
