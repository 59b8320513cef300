"""Joins drawn pieces to contours whose ends meet, and keeps curves that are drawn twice once.

Ends that coincide meet first. Then ends up to the tolerance apart meet, nearest first. Each end
meets at most one other, so that a row of close points cannot collapse into one. Ends of one layer
and color meet first, then ends of one layer, then any. Where three or more ends coincide the chain
goes straight on. The order of the pieces decides only start, direction and ties.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise, product
from operator import itemgetter

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.ragged import (
    compute_offsets,
    find_following_rows,
    list_range_numbers,
    mark_run_starts,
    number_rows,
    select_distinct,
)
from camgen.model.job import Job, Step
from camgen.model.part import Contour, ContourColumns, Contours, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.sequences import take_rows
from camgen.model.text import counted, short
from camgen.model.tolerance import NONZERO, OFF_GRID
from camgen.read.pieces import (
    BoolArray,
    DrawnPieces,
    IntArray,
    are_credible,
    are_first,
    compute_same_distance,
    describe_elements,
    find_next_rows,
    normalize_pieces,
)
from camgen.read.twice import cut_repeated, drop_repeated_loops, label_selections

#: Points (x, y), mm.
Places = tuple[tuple[float, float], ...]

# Chains of pieces. Numbers of ends: 2 i is the start of piece i, 2 i + 1 its end.


class EndJoints(Struct, frozen=True):
    """Joints of a drawing.

    count: number of gaps that were closed.
    largest: largest of these gaps, mm.
    mixed: number of contours with pieces of several layers.
    colored: number of contours with pieces of several colors.
    """

    count: int
    largest: float
    mixed: int
    colored: int


def chain(partner: list[int], closed: list[bool]) -> tuple[list[list[int]], list[bool]]:
    """Chains of pieces whose ends meet, in order of their first pieces, and whether each is closed.

    A chain is the ends at which its pieces are entered.

    partner: the end that each end meets, -1 for none.
    closed: whether each piece is closed.
    """
    count = len(closed)
    is_used = [False] * count

    def follow(end: int) -> list[int]:
        ends = []
        while end >= 0 and not is_used[end >> 1]:
            is_used[end >> 1] = True
            ends.append(end)
            end = partner[end ^ 1]
        return ends

    chains: list[tuple[int, list[int], bool]] = []
    for end in range(2 * count):
        if partner[end] < 0 and not is_used[end >> 1] and not closed[end >> 1]:
            ends = follow(end)
            first = min(ends, key=lambda end: end >> 1)
            if first & 1:
                ends = [end ^ 1 for end in reversed(ends)]
            chains.append((first >> 1, ends, False))
    for piece in range(count):
        if not is_used[piece]:
            chains.append((piece, [2 * piece] if closed[piece] else follow(2 * piece), True))
    chains.sort(key=itemgetter(0))
    return [ends for _, ends, _ in chains], [is_closed for _, _, is_closed in chains]


def assemble(
    soup: DrawnPieces, chains: list[list[int]], closed: list[bool], same: float
) -> tuple[DrawnPieces, EndJoints]:
    """The chains as pieces, and their joints.

    Lines are changed until their ends meet. Two arcs get a short line between them.

    closed: whether each chain is closed.
    same: distance below which two points are one, mm.
    """
    sizes = np.array(list(map(len, chains)), dtype=np.intp)
    chain_of_piece = np.repeat(np.arange(len(chains)), sizes)
    entered = np.array(list(itertools.chain.from_iterable(chains)), dtype=np.intp)
    piece, is_reversed = entered >> 1, (entered & 1).astype(np.bool_)
    counts = np.diff(soup.first)[piece]
    step = np.repeat(np.where(is_reversed, -1, 1), counts)
    base = np.where(is_reversed, soup.first[1:][piece] - 1, soup.first[:-1][piece])
    rows = np.repeat(base, counts) + step * number_rows(counts)
    points = soup.points[rows]
    bulges = np.where(step < 0, -soup.bulges[rows - 1], soup.bulges[rows])
    is_closed_piece = soup.closed[piece]
    last = np.cumsum(counts) - 1
    bulges[last[~is_closed_piece]] = 0.0
    start = last - counts + 1
    is_loop = np.array(closed, dtype=np.bool_)
    ends = np.cumsum(sizes)
    meets_next = ~is_closed_piece
    meets_next[ends - 1] &= is_loop
    keep, gaps = _meet(
        points, bulges, last[meets_next], start[find_following_rows(sizes)[meets_next]], same
    )
    heads = piece[ends - sizes]
    head = np.repeat(heads, sizes)
    mixed = [
        len(select_distinct(chain_of_piece[names[piece] != names[head]]))
        for names in (soup.layer, soup.color)
    ]
    length = np.bincount(np.repeat(chain_of_piece, counts)[keep], minlength=len(chains))
    assembled = replace(
        soup,
        points=points[keep],
        bulges=bulges[keep] + 0.0,  # no minus zero
        first=compute_offsets(length),
        closed=is_loop,
        layer=soup.layer[heads],
        kind=soup.kind[heads],
        color=soup.color[heads],
    )
    wide = gaps[gaps > same]
    return assembled, EndJoints(len(wide), float(wide.max(initial=0.0)), *mixed)


def _meet(
    points: FloatArray, bulges: FloatArray, before: IntArray, after: IntArray, same: float
) -> tuple[BoolArray, FloatArray]:
    """Move ends of pieces to starts of the next ones: which rows remain, and the gaps in mm.

    Two lines meet half-way. A line is moved to the end of an arc. Between two arcs both points
    stay.

    points: changed in place.
    before, after: rows of the ends, and of the starts that follow them.
    """
    gaps = np.hypot(*(points[before] - points[after]).T)
    is_arc_before, is_arc_after = bulges[before - 1] != 0, bulges[after] != 0
    goal = np.where(is_arc_before[:, None], points[before], points[after])
    middle = (points[before] + points[after]) / 2
    goal = np.where((is_arc_before == is_arc_after)[:, None], middle, goal)
    is_bridged = is_arc_before & is_arc_after & (gaps > same)
    coincides = gaps <= same
    goal[coincides] = points[after][coincides]
    points[after[~is_bridged]] = goal[~is_bridged]
    keep = np.ones(len(points), dtype=np.bool_)
    keep[before[~is_bridged]] = False
    return keep, gaps


#: Largest sum of the gaps of an outline, as a fraction of its length. A plate of 100 x 60 mm may be
#: open by 16 mm. An arc of 340 degrees (5.6 %) and a dashed line are open on purpose.
GAP_SHARE = 0.05
#: Largest gap across which a chain is closed, as a fraction of its length.
_OWN_GAP = 0.25
#: Up to this number of ends in one point, all their pairs are compared by their corner angles. More
#: are paired by opposite directions.
_CROWD = 32

_DAMAGED = Note("skipped", "damaged", "coordinates that are not finite or not credible")
_NO_LENGTH = Note("repaired", "dropped", "without length")
_TWICE = Note("repaired", "dropped", "drawn twice; each is used once")


def make_job_contours(soup: DrawnPieces, job: Job) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours of a drawing, and notes, as `make_contours` makes them for a job.

    Pieces on layers of clamps are joined and compared by themselves. Their contours come last.
    """
    settings = job.input.join, job.chooses_colors, job.operations
    clamps = job.clamp_layers
    on_clamps = np.array([layer.casefold() in clamps for layer in soup.layers], np.bool_)
    is_clamp = on_clamps[soup.layer]
    if not is_clamp.any():
        return make_contours(soup, *settings)
    part_contours, notes = make_contours(soup.take(~is_clamp), *settings)
    clamp_contours, clamp_notes = make_contours(soup.take(is_clamp), *settings)
    renamed = [
        replace(contour, id=f"c{number}")
        for number, contour in enumerate(clamp_contours, len(part_contours) + 1)
    ]
    return (*part_contours, *renamed), (*notes, *clamp_notes)


def make_contours(
    soup: DrawnPieces, tolerance: float, by_color: bool = False, operations: Sequence[Step] = ()
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours of drawn pieces in drawing order, and notes on repairs and joints.

    A contour has the layer and the color of its first piece.

    tolerance: distance up to which ends meet, mm.
    by_color: whether the job chooses contours by color.
    operations: operations that choose contours; a curve may be drawn once for each of them.
    """
    notes: list[Note] = []
    soup = _drop(soup, are_credible(soup), _DAMAGED, notes)
    soup = normalize_pieces(soup)
    soup = _drop(soup, np.diff(soup.first) > 1, _NO_LENGTH, notes)
    soup = _drop(soup, are_first(soup, label_selections(soup, operations)), _TWICE, notes)
    gap = soup.points[soup.first[1:] - 1] - soup.points[soup.first[:-1]]
    is_open = ~(soup.closed | (np.hypot(gap[:, 0], gap[:, 1]) <= tolerance))
    label = label_selections(soup, operations)
    cut, repeated = cut_repeated(soup, label, tolerance, is_open, np.zeros_like(is_open))
    joined, joints = _join(cut, tolerance)
    if repeated:
        # Two outlines side by side, each with lines of its own, need their common edge twice.
        is_loose = is_open & ~_find_loop_pieces(soup, tolerance)
        loose, loose_repeated = cut_repeated(
            soup, label, tolerance, is_loose, np.zeros_like(is_open)
        )
        whole, whole_joints = _join(loose, tolerance)
        if whole.closed.sum() > joined.closed.sum():
            joined, joints, repeated = whole, whole_joints, loose_repeated
    soup = joined
    notes += repeated
    notes += _note_joints(joints, tolerance, by_color)
    soup = normalize_pieces(soup)
    soup = soup.take(np.diff(soup.first) > 1)
    # Several pieces and one piece of the same shape can be compared only after pieces are joined.
    soup = _drop(soup, are_first(soup, label_selections(soup, operations)), _TWICE, notes)
    soup, repeated = drop_repeated_loops(soup, label_selections(soup, operations), tolerance)
    notes += repeated
    if not soup.closed.all():
        label = label_selections(soup, operations)
        # An outline with a gap stays whole. Later it is decided whether it should be closed.
        compared = soup.closed | ~_are_nearly_closed(soup)
        soup, repeated = cut_repeated(soup, label, tolerance, compared, soup.closed, "contour")
        notes += repeated
    if not soup.closed.all():
        notes.append(_note_open(soup, tolerance))
    return _convert_to_contours(soup), tuple(notes)


def _convert_to_contours(soup: DrawnPieces) -> tuple[Contour, ...]:
    points, bulges = frozen(soup.points), frozen(soup.bulges)
    columns = ContourColumns(points, bulges, np.diff(soup.first), soup.closed)
    spans = pairwise(soup.first.tolist())
    rows = zip(spans, soup.closed.tolist(), soup.layer.tolist(), soup.color.tolist(), strict=True)
    contours = (
        Contour(
            points[first:after],
            bulges[first:after],
            closed,
            soup.layers[layer],
            f"c{number}",
            (),
            soup.colors[color],
        )
        for number, ((first, after), closed, layer, color) in enumerate(rows, start=1)
    )
    return Contours.from_columns(contours, columns)


def _are_nearly_closed(soup: DrawnPieces) -> BoolArray:
    """(P,) whether the ends of each piece are nearer than `GAP_SHARE` of its chords."""
    chords = np.linalg.norm(np.diff(soup.points, axis=0, append=soup.points[-1:]), axis=1)
    last = soup.first[1:] - 1
    chords[last] = 0.0
    length = np.add.reduceat(chords, soup.first[:-1])
    gap = np.linalg.norm(soup.points[last] - soup.points[soup.first[:-1]], axis=1)
    return np.asarray(gap <= GAP_SHARE * length)


#: Ends among which gaps are searched, at most. The number of pairs grows with their square.
_MOST_ENDS = 4000
#: Gaps that a note lists.
_LISTED = 3
#: A gap up to this fraction of the larger piece may be unintended.
_MAX_GAP_FRACTION = 0.1


def format_gaps(pieces: Sequence[FloatArray], tolerance: float) -> tuple[str, Places]:
    """A text on gaps that `input.join` would close, with its value, and their middles.

    A gap is between two ends that are nearest to each other. Gaps above a tenth of the larger of
    their pieces are assumed to be intended. Without gaps the text is "".

    pieces: (N, 2) points of each open piece, mm.
    tolerance: distance up to which ends were joined, mm.
    """
    if 2 * len(pieces) > _MOST_ENDS:
        return "", ()
    ends = np.concatenate([piece[[0, -1]] for piece in pieces])
    sizes = [float(np.ptp(piece, axis=0).max()) for piece in pieces]
    largest_gap = _MAX_GAP_FRACTION * np.repeat(sizes, 2)
    distance = np.hypot(*np.moveaxis(ends[:, None] - ends[None, :], 2, 0))
    np.fill_diagonal(distance, np.inf)
    distance[distance <= tolerance] = np.inf
    nearest = distance.argmin(axis=1)
    numbers = np.arange(len(ends))
    gap = distance[numbers, nearest]
    is_gap = (nearest[nearest] == numbers) & (numbers < nearest)
    is_gap &= gap <= np.maximum(largest_gap, largest_gap[nearest])
    gaps = np.flatnonzero(is_gap)[np.argsort(gap[is_gap], kind="stable")]
    if not len(gaps):
        return "", ()
    middles = ((ends[gaps] + ends[nearest[gaps]]) / 2).tolist()
    text = ", ".join(
        f"{short(length, 3)} mm near x {short(x, 2)}, y {short(y, 2)}"
        for length, (x, y) in zip(gap[gaps[:_LISTED]].tolist(), middles, strict=False)
    )
    if len(gaps) > _LISTED:
        text += f" and {counted(len(gaps) - _LISTED, 'other')}"
    join = short(compute_join(float(gap[gaps].max())), 3)
    noun, pronoun = ("gap", "it") if len(gaps) == 1 else ("gaps", "them")
    places = tuple((x, y) for x, y in middles)
    return f"{noun} of {text}: input.join = {join} closes {pronoun}", places


def compute_join(gap: float) -> float:
    """Value of `input.join` that closes a gap of `gap` mm: the next micrometre but one."""
    return math.ceil(gap * 1000 + 1) / 1000


def _note_open(soup: DrawnPieces, tolerance: float) -> Note:
    is_open = soup.take(~soup.closed)
    pieces = np.split(is_open.points, is_open.first[1:-1])
    why, places = format_gaps(pieces, tolerance)
    why = why or f"their ends meet no free end within input.join = {short(tolerance, 6)} mm"
    return Note("warning", f"open contours: {len(pieces)}", why, (), places)


def _drop(soup: DrawnPieces, keep: BoolArray, note: Note, notes: list[Note]) -> DrawnPieces:
    """The pieces to keep. The others are counted by `note`, which is added to `notes`."""
    if keep.all():
        return soup
    kinds, layers = soup.kind[~keep].tolist(), soup.layer[~keep].tolist()
    dropped = describe_elements(take_rows(soup.kinds, kinds), take_rows(soup.layers, layers))
    notes.append(replace(note, what=f"{note.what}: {dropped}"))
    return soup.take(keep)


def _note_joints(joints: EndJoints, tolerance: float, by_color: bool) -> Iterator[Note]:
    if joints.count:
        gaps = f"gaps closed: {joints.count}, largest {joints.largest:.3g} mm"
        yield Note("joined", gaps, f"ends closer than input.join = {short(tolerance, 6)} mm meet")
    if joints.mixed:
        yield Note(
            "joined",
            f"contours over more than one layer: {joints.mixed}",
            "each counts to the layer of its first piece",
        )
    if joints.colored and by_color:
        yield Note(
            "joined",
            f"contours of more than one color: {joints.colored}",
            "each has the color of its first piece",
        )


class _Ends(Struct, frozen=True, eq=False):
    """Ends of P pieces. The ends of closed pieces are not used.

    points: (2 P, 2) mm.
    directions: (2 P, 2) unit vectors from each end into its piece.
    length: (P,) lengths of the pieces, mm.
    """

    points: FloatArray
    directions: FloatArray
    length: FloatArray


def _join(soup: DrawnPieces, tolerance: float) -> tuple[DrawnPieces, EndJoints]:
    chains, closed = chain(pair_ends(soup, tolerance).tolist(), soup.closed.tolist())
    return assemble(soup, chains, closed, compute_same_distance(soup))


def _find_loop_pieces(soup: DrawnPieces, tolerance: float) -> BoolArray:
    """(P,) whether each open piece is joined to others in a closed chain."""
    chains, closed = chain(pair_ends(soup, tolerance).tolist(), soup.closed.tolist())
    in_loop = np.zeros(len(soup), np.bool_)
    for ends, is_closed in zip(chains, closed, strict=True):
        in_loop[np.array(ends) >> 1] = is_closed
    return in_loop


def pair_ends(soup: DrawnPieces, tolerance: float) -> IntArray:
    """Choose for each end of the open pieces the end that it meets.

    End 2 i is the start of piece i, end 2 i + 1 its end. Two ends meet if they are at most
    `tolerance` mm apart. Returns (2 P,) numbers of ends, -1 for an end that meets none.
    """
    same = compute_same_distance(soup)
    tolerance = max(tolerance, 4 * same)
    partner = np.full(2 * len(soup), -1, dtype=np.intp)
    ends = _find_ends(soup)
    is_free = np.repeat(~soup.closed, 2)
    for group in _list_groups(soup):
        _pair_coincident(partner, is_free, ends, group, same)
        _pair_near(partner, is_free, ends, group, (same, tolerance))
    return partner


def _list_groups(soup: DrawnPieces) -> list[IntArray]:
    """Labels of the ends of pieces. Ends with equal labels may meet, first by the first labels.

    The labels are layer and color, the layer, and one for all. Labels that make the same groups as
    the labels before are left out.
    """
    labels = [soup.layer * len(soup.colors) + soup.color, soup.layer, np.zeros_like(soup.layer)]
    counts = [int(np.count_nonzero(np.bincount(label))) for label in labels]
    is_new = [True, counts[1] < counts[0], counts[2] < counts[1]]
    return [np.repeat(label, 2) for label in itertools.compress(labels, is_new)]


def _find_ends(soup: DrawnPieces) -> _Ends:
    chord = soup.points[find_next_rows(soup)] - soup.points
    size = np.hypot(chord[:, 0], chord[:, 1])
    b = np.abs(soup.bulges)
    lengths = size * np.where(b > 0, (1 + b * b) * np.arctan(b) / np.where(b > 0, b, 1.0), 1.0)
    start, end = soup.first[:-1], soup.first[1:] - 1
    lengths[end[~soup.closed]] = 0.0
    directions = np.empty((len(soup), 2, 2))
    for side, rows, sign in ((0, start, 1.0), (1, np.maximum(end - 1, 0), -1.0)):
        # The tangent of an arc is its chord, rotated by half the angle of the arc.
        half = 2 * np.arctan(soup.bulges[rows])
        cos, sin = np.cos(half), -sign * np.sin(half)
        x, y = (sign * chord[rows] / np.maximum(size[rows], NONZERO)[:, None]).T
        directions[:, side] = np.column_stack([x * cos - y * sin, x * sin + y * cos])
    return _Ends(
        points=np.stack([soup.points[start], soup.points[end]], axis=1).reshape(-1, 2),
        directions=directions.reshape(-1, 2),
        length=np.add.reduceat(lengths, start) if len(soup) else np.zeros(0),
    )


def _pair_coincident(
    partner: IntArray, is_free: BoolArray, ends: _Ends, group: IntArray, same: float
) -> None:
    """Pair free ends in one point and one group, the smallest corner angle first.

    partner: changed in place.
    """
    loose = np.flatnonzero(is_free & (partner < 0))
    cells = np.floor(ends.points[loose] / same + OFF_GRID).astype(np.int64)
    order = np.lexsort([cells[:, 1], cells[:, 0], group[loose]])
    loose, cells = loose[order], cells[order]
    is_first = mark_run_starts(cells) | mark_run_starts(group[loose])
    starts = np.append(np.flatnonzero(is_first), len(loose))
    counts = np.diff(starts)
    first = loose[starts[:-1][counts == 2]]
    second = loose[starts[:-1][counts == 2] + 1]
    partner[first], partner[second] = second, first
    for k in np.flatnonzero(counts > 2):
        for a, b in _pair_straightest(loose[starts[k] : starts[k + 1]], ends.directions):
            partner[a], partner[b] = b, a


def _pair_straightest(ends: IntArray, directions: FloatArray) -> Iterable[tuple[int, int]]:
    """Pairs of `ends` in one point, the smallest corner angle first."""
    d = directions[ends]
    if len(ends) > _CROWD:
        sorted_ends = ends[np.argsort(np.arctan2(d[:, 1], d[:, 0]), kind="stable")].tolist()
        half = len(ends) // 2
        return zip(sorted_ends[:half], sorted_ends[half : 2 * half], strict=True)
    i, j = np.triu_indices(len(ends), 1)
    # Rounded, so that equal angles tie and do not depend on the last bit.
    order = np.argsort(np.round(np.einsum("kd,kd->k", d[i], d[j]), 9), kind="stable")
    return _select_disjoint(ends[i][order].tolist(), ends[j][order].tolist())


def _select_disjoint(first: list[int], second: list[int]) -> Iterator[tuple[int, int]]:
    """Pairs in order, without those of which an end belongs to an earlier pair."""
    taken: set[int] = set()
    for a, b in zip(first, second, strict=True):
        if a not in taken and b not in taken:
            taken |= {a, b}
            yield a, b


def _pair_near(
    partner: IntArray, is_free: BoolArray, ends: _Ends, group: IntArray, radii: tuple[float, float]
) -> None:
    """Pair free ends of one group that are near to each other, nearest first.

    The radius grows in steps. After each step no two free ends are that near, so that the next step
    finds few pairs, even in a dense drawing.

    partner: changed in place.
    radii: distance below which two points are one, and largest distance of a pair, mm.
    """
    radius, limit = radii
    loose = np.flatnonzero(is_free & (partner < 0))
    loose = loose[_have_neighbours(ends.points[loose], group[loose], limit)]
    while radius < limit and len(loose):
        radius = min(4 * radius, limit)
        a, b, gap = find_close_pairs(ends.points[loose], group[loose], radius)
        a, b = loose[a], loose[b]
        other, length = _find_chain_ends(partner, ends.length, np.unique(a))
        is_allowed = (other[a] != b) | (gap <= _OWN_GAP * length[a])
        a, b, gap = a[is_allowed], b[is_allowed], gap[is_allowed]
        lower = np.minimum(ends.points[a], ends.points[b])
        order = np.lexsort([lower[:, 1], lower[:, 0], np.round(gap / radii[0])])
        for first, second in _select_disjoint(a[order].tolist(), b[order].tolist()):
            partner[first], partner[second] = second, first
        loose = loose[partner[loose] < 0]


def _have_neighbours(points: FloatArray, group: IntArray, radius: float) -> BoolArray:
    """(N,) whether the 3 x 3 cells around each point have another point of its group.

    This quickly removes points without a pair. The cells are `radius` mm wide.
    """
    cells = np.floor(points / radius).astype(np.int64)
    ranked = np.sort(_compute_cell_keys(cells, group))
    count = np.zeros(len(points), dtype=np.intp)
    for step in product((-1, 0, 1), repeat=2):
        keys = _compute_cell_keys(cells + np.array(step), group)
        count += np.searchsorted(ranked, keys, side="right") - np.searchsorted(ranked, keys)
    return np.asarray(count > 1)


def find_close_pairs(
    points: FloatArray, group: IntArray, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of points of one group that are at most `radius` mm apart, and their distances.

    Each pair occurs once. The points are sorted into the cells of a grid.

    points: (N, 2) mm.
    group: (N,) label of the group of each point.

    Returns (K,) indices of the first and of the second points, and (K,) distances in mm.
    """
    cells = np.floor(points / radius).astype(np.int64)
    keys = _compute_cell_keys(cells, group)
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    firsts, seconds = [], []
    for step in ((0, 0), (1, 0), (-1, 1), (0, 1), (1, 1)):
        keys = _compute_cell_keys(cells + np.array(step), group)
        low, high = np.searchsorted(ranked, keys), np.searchsorted(ranked, keys, side="right")
        a = np.repeat(np.arange(len(points)), high - low)
        b = order[list_range_numbers(low, high - low)]
        if step == (0, 0):
            a, b = a[a < b], b[a < b]
        firsts.append(a)
        seconds.append(b)
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    gap = np.hypot(*(points[a] - points[b]).T)
    is_pair = (gap <= radius) & (group[a] == group[b]) & (a != b)
    return a[is_pair], b[is_pair], gap[is_pair]


def _compute_cell_keys(cells: NDArray[np.int64], group: IntArray) -> NDArray[np.int64]:
    """A number for the cell and the group of each point.

    Two cells may have the same number. Their points are separated by distance and group later.
    """
    return np.asarray(
        cells[:, 0] * 0x1F123BB5159A55E5
        ^ cells[:, 1] * 0x5851F42D4C957F2D
        ^ group * 0x2545F4914F6CDD1D
    )


def _find_chain_ends(
    partner: IntArray, length: FloatArray, loose: IntArray
) -> tuple[IntArray, FloatArray]:
    """(2 P,) the other end of the chain of each loose end, and (2 P,) the length of the chain.

    Other ends have -1 and 0.
    """
    other = np.full(len(partner), -1, dtype=np.intp)
    total = np.zeros(len(partner))
    partners, lengths = partner.tolist(), length.tolist()
    for start in loose.tolist():
        if other[start] >= 0:
            continue
        end, chain_length = start, 0.0
        while end >= 0:
            chain_length += lengths[end >> 1]
            last = end ^ 1
            end = partners[last]
        other[start], other[last] = last, start
        total[start] = total[last] = chain_length
    return other, total
