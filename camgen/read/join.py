"""From a soup of drawn pieces to contours: ends that meet are joined, what is drawn twice is kept once.

Two ends meet first where they coincide, then, nearest first, where they are closer than the tolerance; each end meets
at most one other, so that a row of close points cannot collapse into one. Ends on one layer meet before ends on
different layers, and on one layer those of one color first. Where three or more ends coincide the chain goes straight
on. The order of the pieces decides only where a contour starts, which way it runs, and ties.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.ragged import each_once, following, offsets, ramp, starts_run, stretches
from camgen.model.job import Job, Step
from camgen.model.part import Contour, ContourColumns, Contours, Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted, short
from camgen.model.tolerance import NONZERO, OFF_GRID
from camgen.read.pieces import (
    BoolArray,
    IntArray,
    Soup,
    credible,
    first_of_its_kind,
    next_row,
    same_distance,
    tally,
    tidy,
)
from camgen.read.twice import cut_repeated, drop_repeated_loops, label_selections

Places = tuple[tuple[float, float], ...]

# Chains of drawn pieces: which pieces follow each other, and how their ends are made to meet.


class EndJoints(Struct, frozen=True):
    """Gaps that were closed, the largest in mm, and contours made of several layers, and of several colors."""

    count: int
    largest: float
    mixed: int
    colored: int


def chain(partner: list[int], closed: list[bool]) -> tuple[list[list[int]], list[bool]]:
    """Chains of the ends at which each piece is entered, and whether they close; in order of their first pieces."""
    count = len(closed)
    seen = [False] * count

    def follow(end: int) -> list[int]:
        chain = []
        while end >= 0 and not seen[end >> 1]:
            seen[end >> 1] = True
            chain.append(end)
            end = partner[end ^ 1]
        return chain

    found: list[tuple[int, list[int], bool]] = []
    for end in range(2 * count):
        if partner[end] < 0 and not seen[end >> 1] and not closed[end >> 1]:
            chain = follow(end)
            first = min(chain, key=lambda e: e >> 1)
            if first & 1:
                chain = [e ^ 1 for e in reversed(chain)]
            found.append((first >> 1, chain, False))
    rest = (piece for piece in range(count) if not seen[piece])
    found += [(piece, [2 * piece] if closed[piece] else follow(2 * piece), True) for piece in rest]
    found.sort(key=lambda item: item[0])
    return [chain for _, chain, _ in found], [loop for _, _, loop in found]


def assemble(
    soup: Soup, chains: list[list[int]], closed: list[bool], same: float
) -> tuple[Soup, EndJoints]:
    """The chains as pieces; where ends do not coincide a line gives way, two arcs get a short line between them."""
    sizes = np.array([len(c) for c in chains], dtype=np.intp)
    entered = np.array([e for c in chains for e in c], dtype=np.intp)
    piece, backwards = entered >> 1, (entered & 1).astype(np.bool_)
    counts = np.diff(soup.first)[piece]
    step = np.repeat(np.where(backwards, -1, 1), counts)
    base = np.where(backwards, soup.first[1:][piece] - 1, soup.first[:-1][piece])
    rows = np.repeat(base, counts) + step * ramp(counts)
    points = soup.points[rows]
    bulges = np.where(step < 0, -soup.bulges[rows - 1], soup.bulges[rows])
    whole = soup.closed[piece]
    last = np.cumsum(counts) - 1
    bulges[last[~whole]] = 0.0
    start = last - counts + 1
    loop = np.array(closed, dtype=np.bool_)
    ends = np.cumsum(sizes)
    follower = following(sizes)
    meets = ~whole
    meets[ends - 1] &= loop
    keep, gaps = _meet(points, bulges, last[meets], start[follower[meets]], same)
    chain_of_row = np.repeat(np.repeat(np.arange(len(chains)), sizes), counts)
    heads = piece[ends - sizes]
    owner, head = np.repeat(np.arange(len(chains)), sizes), np.repeat(heads, sizes)
    mixed = [
        len(each_once(owner[names[piece] != names[head]])) for names in (soup.layer, soup.color)
    ]
    length = np.bincount(chain_of_row[keep], minlength=len(chains))
    made = replace(
        soup,
        points=points[keep],
        bulges=bulges[keep] + 0.0,  # no minus zero
        first=offsets(length),
        closed=loop,
        layer=soup.layer[heads],
        kind=soup.kind[heads],
        color=soup.color[heads],
    )
    wide = gaps[gaps > same]
    return made, EndJoints(len(wide), float(wide.max(initial=0.0)), *mixed)


def _meet(
    points: FloatArray, bulges: FloatArray, a: IntArray, b: IntArray, same: float
) -> tuple[BoolArray, FloatArray]:
    """Let row ``a``, the end of a piece, meet row ``b``, the start of the next; which rows remain, and the gaps.

    Two lines meet half-way; a line moves to the end of an arc; between two arcs both points stay.
    """
    gaps = np.hypot(*(points[a] - points[b]).T)
    arc_before, arc_after = bulges[a - 1] != 0, bulges[b] != 0
    goal = np.where(arc_before[:, None], points[a], points[b])
    goal = np.where((arc_before == arc_after)[:, None], (points[a] + points[b]) / 2, goal)
    bridged = arc_before & arc_after & (gaps > same)
    exact = gaps <= same
    goal[exact] = points[b][exact]
    points[b[~bridged]] = goal[~bridged]
    keep = np.ones(len(points), dtype=np.bool_)
    keep[a[~bridged]] = False
    return keep, gaps


#: The gaps of an outline together are at most this share of its length. A plate of 100 x 60 mm may
#: be open by 16 mm. An arc of 340 degrees (5.6 %) and a dashed line are meant as they are.
GAP_SHARE = 0.05
#: A chain is not closed on itself across more than this part of its own length.
_OWN_GAP = 0.25
#: Up to so many ends at one point are paired by the least turn of all pairs; beyond, by opposite directions.
_CROWD = 32

_DAMAGED = Note("skipped", "damaged", "coordinates that are not finite or not credible")
_NO_LENGTH = Note("repaired", "dropped", "without length")
_TWICE = Note("repaired", "dropped", "drawn twice; each is used once")


def contours_of(soup: Soup, job: Job) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours of a drawing, and notes, as `contours` makes them for a job.

    Pieces on layers of clamps are joined and compared by themselves. Their contours come last.
    """
    settings = job.input.join, job.chooses_colors, job.operations
    clamps = job.clamp_layers
    on_clamps = np.array([layer.casefold() in clamps for layer in soup.layers], np.bool_)
    is_clamp = on_clamps[soup.layer]
    if not is_clamp.any():
        return contours(soup, *settings)
    part_contours, notes = contours(soup.take(~is_clamp), *settings)
    clamp_contours, clamp_notes = contours(soup.take(is_clamp), *settings)
    renamed = [
        replace(contour, id=f"c{number}")
        for number, contour in enumerate(clamp_contours, len(part_contours) + 1)
    ]
    return (*part_contours, *renamed), (*notes, *clamp_notes)


def contours(
    soup: Soup, tolerance: float, by_color: bool = False, operations: Sequence[Step] = ()
) -> tuple[tuple[Contour, ...], tuple[Note, ...]]:
    """The contours of drawn pieces in drawing order, and notes on repairs and joints.

    A contour has the layer and the color of its first piece.

    tolerance: distance up to which ends meet, mm.
    by_color: whether the job chooses contours by color.
    operations: operations that choose contours; a curve may be drawn once for each of them.
    """
    notes: list[Note] = []
    soup = _drop(soup, credible(soup), _DAMAGED, notes)
    soup = tidy(soup)
    soup = _drop(soup, np.diff(soup.first) > 1, _NO_LENGTH, notes)
    soup = _drop(soup, first_of_its_kind(soup, label_selections(soup, operations)), _TWICE, notes)
    is_open = ~(soup.closed | _meet_themselves(soup, tolerance))
    label = label_selections(soup, operations)
    cut, repeated = cut_repeated(soup, label, tolerance, is_open, np.zeros_like(is_open))
    joined, joints = _join(cut, tolerance)
    if repeated:
        # Outlines side by side, each of lines of its own, need their common edge twice.
        in_loop = _find_loop_pieces(soup, tolerance)
        loose, loose_repeated = cut_repeated(
            soup, label, tolerance, is_open & ~in_loop, np.zeros_like(is_open)
        )
        whole, whole_joints = _join(loose, tolerance)
        if whole.closed.sum() > joined.closed.sum():
            joined, joints, repeated = whole, whole_joints, loose_repeated
    soup = joined
    notes += repeated
    notes += _joint_notes(joints, tolerance, by_color)
    soup = tidy(soup)
    soup = soup.take(np.diff(soup.first) > 1)
    # Pieces and a whole of the same shape can be compared only after pieces are joined.
    soup = _drop(soup, first_of_its_kind(soup, label_selections(soup, operations)), _TWICE, notes)
    soup, repeated = drop_repeated_loops(soup, label_selections(soup, operations), tolerance)
    notes += repeated
    if not soup.closed.all():
        label = label_selections(soup, operations)
        # An outline with a gap stays whole: whether it is meant to be closed is asked later.
        compared = soup.closed | ~_are_nearly_closed(soup)
        soup, repeated = cut_repeated(soup, label, tolerance, compared, soup.closed, "contour")
        notes += repeated
    count = int((~soup.closed).sum())
    if count:
        notes.append(_open_note(soup, tolerance))
    points, bulges = frozen(soup.points), frozen(soup.bulges)
    spans = pairwise(soup.first.tolist())
    columns = ContourColumns(points, bulges, np.diff(soup.first), soup.closed)
    rows = zip(spans, soup.closed.tolist(), soup.layer.tolist(), soup.color.tolist(), strict=True)
    made = (
        Contour(
            points[a:b], bulges[a:b], closed, soup.layers[layer], f"c{i}", (), soup.colors[color]
        )
        for i, ((a, b), closed, layer, color) in enumerate(rows, start=1)
    )
    return Contours.from_columns(made, columns), tuple(notes)


def _are_nearly_closed(soup: Soup) -> BoolArray:
    """(P,) whether the ends of each piece are nearer than `GAP_SHARE` of its chords."""
    chords = np.linalg.norm(np.diff(soup.points, axis=0, append=soup.points[-1:]), axis=1)
    last = soup.first[1:] - 1
    chords[last] = 0.0
    length = np.add.reduceat(chords, soup.first[:-1])
    gap = np.linalg.norm(soup.points[last] - soup.points[soup.first[:-1]], axis=1)
    return np.asarray(gap <= GAP_SHARE * length)


def _meet_themselves(soup: Soup, tolerance: float) -> BoolArray:
    """(P,) whether the two ends of each piece are within `tolerance` mm."""
    gap = soup.points[soup.first[1:] - 1] - soup.points[soup.first[:-1]]
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]) <= tolerance)


#: Of so many ends the gaps are looked for; the number of pairs grows with their square. So many are told.
_MOST_ENDS, _TOLD = 4000, 3
#: A gap may be meant to be closed where it is no longer than this share of the drawing.
_MEANT = 0.1


def tell_gaps(pieces: Sequence[FloatArray], tolerance: float) -> tuple[str, Places]:
    """The gaps between the ends of open ``pieces`` (N, 2) that ``input.join`` would close, with their places and what
    to set; "" for none.

    tolerance: what was joined, mm. A gap is between two ends that have no nearer one, and no longer than a tenth of the
    larger of their pieces: what is farther apart is taken as meant.
    """
    if 2 * len(pieces) > _MOST_ENDS:
        return "", ()
    ends = np.array([end for piece in pieces for end in (piece[0], piece[-1])])
    meant = _MEANT * np.repeat([float(np.ptp(piece, axis=0).max()) for piece in pieces], 2)
    apart = np.hypot(*np.moveaxis(ends[:, None] - ends[None, :], 2, 0))
    np.fill_diagonal(apart, np.inf)
    apart[apart <= tolerance] = np.inf
    nearest = apart.argmin(axis=1)
    gap = apart[np.arange(len(ends)), nearest]
    mine = (nearest[nearest] == np.arange(len(ends))) & (np.arange(len(ends)) < nearest)
    mine &= gap <= np.maximum(meant, meant[nearest])
    found = np.flatnonzero(mine)[np.argsort(gap[mine], kind="stable")]
    if not len(found):
        return "", ()
    middles = (ends[found] + ends[nearest[found]]) / 2
    places = [
        f"{short(gap[k], 3)} mm near x {short(x, 2)}, y {short(y, 2)}"
        for k, (x, y) in zip(found, middles.tolist(), strict=True)
    ]
    more = f" and {counted(len(found) - _TOLD, 'other')}" if len(found) > _TOLD else ""
    join = short(closing_value(float(gap[found].max())), 3)
    noun = "gap" if len(found) == 1 else "gaps"
    told = (
        f"{noun} of {', '.join(places[:_TOLD])}{more}: input.join "
        f"= {join} closes {'it' if len(found) == 1 else 'them'}"
    )
    return told, tuple((x, y) for x, y in middles.tolist())


def closing_value(gap: float) -> float:
    """Value of `input.join` that closes a gap of `gap` mm: the next micrometre but one."""
    return math.ceil(gap * 1000 + 1) / 1000


def _open_note(soup: Soup, tolerance: float) -> Note:
    rows = np.flatnonzero(~soup.closed).tolist()
    told, places = tell_gaps(
        [soup.points[soup.first[k] : soup.first[k + 1]] for k in rows], tolerance
    )
    why = told or f"their ends meet no free end within input.join = {short(tolerance, 6)} mm"
    return Note("warning", f"open contours: {len(rows)}", why, (), places)


def _drop(soup: Soup, keep: BoolArray, told: Note, notes: list[Note]) -> Soup:
    """The pieces to keep; the note ``told`` counts the others."""
    if keep.all():
        return soup
    lost = np.flatnonzero(~keep)
    what = tally(
        [soup.kinds[k] for k in soup.kind[lost]], [soup.layers[k] for k in soup.layer[lost]]
    )
    notes.append(replace(told, what=f"{told.what}: {what}"))
    return soup.take(keep)


def _joint_notes(joints: EndJoints, tolerance: float, by_color: bool) -> list[Note]:
    notes = []
    limit = f"input.join = {short(tolerance, 6)} mm"
    if joints.count:
        gap = f"largest {joints.largest:.3g} mm"
        notes.append(
            Note("joined", f"gaps closed: {joints.count}, {gap}", f"ends closer than {limit} meet")
        )
    if joints.mixed:
        what = f"contours over more than one layer: {joints.mixed}"
        notes.append(Note("joined", what, "each counts to the layer of its first piece"))
    if joints.colored and by_color:
        what = f"contours of more than one color: {joints.colored}"
        notes.append(Note("joined", what, "each has the color of its first piece"))
    return notes


class _Ends(Struct, frozen=True, eq=False):
    """Ends 2 i (start) and 2 i + 1 (end) of each open piece i; outward directions point into the piece."""

    points: FloatArray
    directions: FloatArray
    layer: IntArray
    color: IntArray
    length: FloatArray


def _join(soup: Soup, tolerance: float) -> tuple[Soup, EndJoints]:
    """The soup with its open pieces chained; in order of the first piece of each chain."""
    partner = pair_ends(soup, tolerance)
    chains, closed = chain(partner.tolist(), soup.closed.tolist())
    return assemble(soup, chains, closed, same_distance(soup))


def _find_loop_pieces(soup: Soup, tolerance: float) -> BoolArray:
    """(P,) whether each open piece is joined to others in a closed chain."""
    chains, closed = chain(pair_ends(soup, tolerance).tolist(), soup.closed.tolist())
    in_loop = np.zeros(len(soup), np.bool_)
    for ends, is_closed in zip(chains, closed, strict=True):
        in_loop[np.array(ends) >> 1] = is_closed
    return in_loop


def pair_ends(soup: Soup, tolerance: float) -> IntArray:
    """Choose for each end of the open pieces the end that it meets.

    End 2 i is the start of piece i, end 2 i + 1 its end. Two ends meet if they are at most
    `tolerance` mm apart. Returns (2 P,) numbers of ends, -1 for an end that meets none.
    """
    same = same_distance(soup)
    tolerance = max(tolerance, 4 * same)
    partner = np.full(2 * len(soup), -1, dtype=np.intp)
    ends = _ends(soup)
    free = np.repeat(~soup.closed, 2)
    for group in _groups(ends, len(soup.colors)):
        _pair_coincident(partner, free, ends, group, same)
        _pair_near(partner, free, ends, group, (same, tolerance))
    return partner


def _groups(ends: _Ends, colors: int) -> list[IntArray]:
    """Labels of the ends that may meet, one array after the other: of one layer and color, of one layer, any two."""
    groups = [ends.layer * colors + ends.color, ends.layer, np.zeros_like(ends.layer)]
    counts = [int(np.count_nonzero(np.bincount(group))) for group in groups]
    return [group for k, group in enumerate(groups) if k == 0 or counts[k] < counts[k - 1]]


def _ends(soup: Soup) -> _Ends:
    """Places, directions and lengths of the ends of all pieces (of no use for closed ones)."""
    following = next_row(soup)
    chord = soup.points[following] - soup.points
    size = np.hypot(chord[:, 0], chord[:, 1])
    b = np.abs(soup.bulges)
    lengths = size * np.where(b > 0, (1 + b * b) * np.arctan(b) / np.where(b > 0, b, 1.0), 1.0)
    start, end = soup.first[:-1], soup.first[1:] - 1
    lengths[end[~soup.closed]] = 0.0
    directions = np.empty((len(soup), 2, 2))
    for side, rows, sign in ((0, start, 1.0), (1, np.maximum(end - 1, 0), -1.0)):
        half = 2 * np.arctan(soup.bulges[rows])
        cos, sin = np.cos(half), -sign * np.sin(half)
        c = sign * chord[rows] / np.maximum(size[rows], NONZERO)[:, None]
        directions[:, side] = np.column_stack(
            [c[:, 0] * cos - c[:, 1] * sin, c[:, 0] * sin + c[:, 1] * cos]
        )
    return _Ends(
        points=np.stack([soup.points[start], soup.points[end]], axis=1).reshape(-1, 2),
        directions=directions.reshape(-1, 2),
        layer=np.repeat(soup.layer, 2),
        color=np.repeat(soup.color, 2),
        length=np.add.reduceat(lengths, start) if len(soup) else np.zeros(0),
    )


def _pair_coincident(
    partner: IntArray, free: BoolArray, ends: _Ends, layer: IntArray, same: float
) -> None:
    """Pair the free ends that lie in one place on one layer, straightest first."""
    loose = np.flatnonzero(free & (partner < 0))
    cells = np.floor(ends.points[loose] / same + OFF_GRID).astype(np.int64)
    order = np.lexsort([cells[:, 1], cells[:, 0], layer[loose]])
    loose, cells = loose[order], cells[order]
    new = starts_run(cells) | starts_run(layer[loose])
    starts = np.append(np.flatnonzero(new), len(loose))
    counts = np.diff(starts)
    two = starts[:-1][counts == 2]
    _marry(partner, loose[two], loose[two + 1])
    for i in np.flatnonzero(counts > 2):
        for a, b in _straightest(loose[starts[i] : starts[i + 1]], ends.directions):
            partner[a], partner[b] = b, a


def _marry(partner: IntArray, a: IntArray, b: IntArray) -> None:
    partner[a], partner[b] = b, a


def _straightest(ends: IntArray, directions: FloatArray) -> list[tuple[int, int]]:
    """Pairs of the ends in one place, the smallest turn first."""
    d = directions[ends]
    if len(ends) > _CROWD:
        around = ends[np.argsort(np.arctan2(d[:, 1], d[:, 0]), kind="stable")]
        half = len(ends) // 2
        return list(zip(around[:half].tolist(), around[half : 2 * half].tolist(), strict=True))
    i, j = np.triu_indices(len(ends), 1)
    # Rounded, so that equal turns tie and do not hang on the last bit.
    order = np.argsort(np.round(np.einsum("kd,kd->k", d[i], d[j]), 9), kind="stable")
    return _greedy(ends[i][order].tolist(), ends[j][order].tolist())


def _greedy(a: list[int], b: list[int]) -> list[tuple[int, int]]:
    """The pairs in order, leaving out those of which one is taken."""
    taken: set[int] = set()
    pairs = []
    for i, j in zip(a, b, strict=True):
        if i not in taken and j not in taken:
            taken |= {i, j}
            pairs.append((i, j))
    return pairs


def _pair_near(
    partner: IntArray, free: BoolArray, ends: _Ends, layer: IntArray, reach: tuple[float, float]
) -> None:
    """Pair free ends on one layer up to the second ``reach`` apart, nearest first.

    The radius grows step by step. After each step no two free ends are that close, hence the next step
    meets few pairs however dense the drawing is.
    """
    radius, limit = reach
    loose = np.flatnonzero(free & (partner < 0))
    loose = loose[_has_neighbours(ends.points[loose], layer[loose], limit)]
    while radius < limit and len(loose):
        radius = min(4 * radius, limit)
        a, b, gap = close_pairs(ends.points[loose], layer[loose], radius)
        a, b = loose[a], loose[b]
        other, length = _chain_ends(partner, ends.length, np.unique(a))
        fair = (other[a] != b) | (gap <= _OWN_GAP * length[a])
        a, b, gap = a[fair], b[fair], gap[fair]
        lower = np.minimum(ends.points[a], ends.points[b])
        order = np.lexsort([lower[:, 1], lower[:, 0], np.round(gap / reach[0])])
        for i, j in _greedy(a[order].tolist(), b[order].tolist()):
            partner[i], partner[j] = j, i
        loose = loose[partner[loose] < 0]


def _has_neighbours(points: FloatArray, group: IntArray, radius: float) -> BoolArray:
    """Which points (N,) have another in their own or a bordering cell of the grid: a quick way to drop the rest."""
    cells = np.floor(points / radius).astype(np.int64)
    ranked = np.sort(_cell_key(cells, group))
    around = np.zeros(len(points), dtype=np.intp)
    for step in ((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
        wanted = _cell_key(cells + np.array(step), group)
        around += np.searchsorted(ranked, wanted, side="right") - np.searchsorted(ranked, wanted)
    return np.asarray(around > 1)


def close_pairs(
    points: FloatArray, group: IntArray, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of points of one group at most ``radius`` apart, and their distances: a hash grid, each pair once."""
    cells = np.floor(points / radius).astype(np.int64)
    keys = _cell_key(cells, group)
    order = np.argsort(keys, kind="stable")
    ranked = keys[order]
    found_a, found_b = [], []
    for step in ((0, 0), (1, 0), (-1, 1), (0, 1), (1, 1)):
        wanted = _cell_key(cells + np.array(step), group)
        low, high = np.searchsorted(ranked, wanted), np.searchsorted(ranked, wanted, side="right")
        a = np.repeat(np.arange(len(points)), high - low)
        b = order[stretches(low, high - low)]
        once = a < b if step == (0, 0) else np.ones(len(a), dtype=np.bool_)
        found_a.append(a[once])
        found_b.append(b[once])
    a, b = np.concatenate(found_a), np.concatenate(found_b)
    gap = np.hypot(*(points[a] - points[b]).T)
    good = (gap <= radius) & (group[a] == group[b]) & (a != b)
    return a[good], b[good], gap[good]


def _cell_key(cells: NDArray[np.int64], group: IntArray) -> NDArray[np.int64]:
    """A number per cell and group; two cells may share one, which the distance sorts out."""
    return np.asarray(
        cells[:, 0] * 0x1F123BB5159A55E5
        ^ cells[:, 1] * 0x5851F42D4C957F2D
        ^ group * 0x2545F4914F6CDD1D
    )


def _chain_ends(
    partner: IntArray, length: FloatArray, loose: IntArray
) -> tuple[IntArray, FloatArray]:
    """For each loose end the other end of its chain and the length of the chain, in arrays over all ends."""
    other = np.full(len(partner), -1, dtype=np.intp)
    total = np.zeros(len(partner))
    links, lengths = partner.tolist(), length.tolist()
    for end in loose.tolist():
        if other[end] >= 0:
            continue
        at, run = end, 0.0
        while True:
            run += lengths[at >> 1]
            far = at ^ 1
            at = links[far]
            if at < 0:
                break
        other[end], other[far] = far, end
        total[end] = total[far] = run
    return other, total
