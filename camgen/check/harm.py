"""Harm in the motion of a program of any language and any author.

The judge knows no plan. It compares parts of one program with each other:

- A process output is on in slow motions and off in travel, again and again. Where it is on in a
  travel motion, or off where the tool works, the program differs from itself.
- A flat program works at few heights. A motion below all of them, and travel at one of them, run
  into the part.
- A contour keeps its direction at the ends of its arcs. An arc of the wrong sense turns back.
- A motion with another tool, frame, speed or orientation than both of its neighbours is likely a
  slip.

A part that differs as often as not is how the program is meant. `_FEW` says how rare it must be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from msgspec import Struct

from camgen.lang.programs import LEVELS, Executed, Finding, Level
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Indices, Mask, MoveC, MoveJ, Output
from camgen.model.sequences import find_first_places
from camgen.model.text import short

#: Periods of an output, and arcs of a program, from which a rule is read, at least.
_LEAST = 3
#: Share of exceptions to a rule. More of them are meant.
_FEW = 1 / 3
#: Share of the ends of working motions that lie at the heights of a flat program.
_FLAT = 0.9
#: Heights of a flat program, at most. More of them are a relief.
_MOST_HEIGHTS = 3
#: Heights that differ by less are one, mm: texts have two or three digits.
_SAME_HEIGHT = 0.01
#: A motion is that much below all others, mm: more than wear or a finishing cut.
_DEEPER = 0.5
#: A shorter motion covers no way, mm.
_STANDS = 0.01
#: Length of travel across the part that counts, mm.
_ACROSS = 0.5
#: Ratio of a speed, or of the value of an output, to those beside it.
_RATIO = 10.0
#: Angle between two motions that turn back, deg. Texts are exact to a few degrees in small arcs.
_BACK = 170.0
#: Angle up to which a contour keeps its direction, deg.
_SMOOTH = 5.0
#: Angle up to which chords are one contour, deg. Sharper corners may be meant as stops.
_KEEPS_ON = 30.0
#: Turn of the tool that counts, deg.
_TURN = 10.0


class Trace(Struct, frozen=True, eq=False):
    """The M motions of a program by column.

    line: (M,) line of the text.
    place: (M,) index in the body.
    is_joint: (M,) joint motions, G0 among them.
    is_arc: (M,) arcs.
    start, end: (M, 3) ends, mm in the work frame. NaN if they are not known there.
    length: (M,) of the chord, mm. NaN if it is not known.
    leaving, arriving: (M, 3) directions at start and end, of any length. NaN if they are not known.
    speed: (M,) mm/s.
    blend: (M,) mm.
    frame: (M,) index of tool and work frame.
    rotation: (M,) index in `rotations`, -1 for joint values.
    rotations: rotations of the tool, 3 x 3.
    """

    line: Indices
    place: Indices
    is_joint: Mask
    is_arc: Mask
    start: FloatArray
    end: FloatArray
    length: FloatArray
    leaving: FloatArray
    arriving: FloatArray
    speed: FloatArray
    blend: FloatArray
    frame: Indices
    rotation: Indices
    rotations: Sequence[FloatArray]

    @property
    def moves(self) -> Mask:
        """(M,): motions that cover some way, or may."""
        return ~(self.length <= _STANDS)


class Process(Struct, frozen=True, eq=False):
    """An output that is on while the tool works.

    signal: its name.
    is_on: (M,) whether it is on in each motion.
    period: (M,) number of the period in which it is on, -1 while it is off.
    heights: heights at which the program works, mm, the lowest first. Empty if it is not flat, or
        if it works in several frames.
    is_comparable: (M,) whether a motion ends in the frame of these heights.
    """

    signal: str
    is_on: Mask
    period: Indices
    heights: tuple[float, ...]
    is_comparable: Mask

    @property
    def count(self) -> int:
        """Number of periods."""
        return int(self.period.max()) + 1


def find_harm(executed: Executed) -> tuple[Finding, ...]:
    """Return what may do harm in the motion of a run, by line, each line once.

    A line with a finding of its language has another one only if that is worse.
    """
    columns = Columns(executed.body)
    if not len(columns.at):
        return ()
    trace = trace_motion(executed, columns)
    places = np.flatnonzero(columns.are(Output))
    outputs = list(zip(places.tolist(), columns.pick(places), strict=True))
    processes = find_processes(trace, outputs)
    findings = [*_check_outputs(executed, outputs, processes)]
    for level, check in _PROCESS_CHECKS:
        for process in processes:
            for motion, what in check(trace, process):
                findings.append(Finding(level, int(trace.line[motion]), what))
    for level, check_motion in _MOTION_CHECKS:
        for motion, what in check_motion(trace):
            findings.append(Finding(level, int(trace.line[motion]), what))
    findings.sort(key=lambda finding: (finding.line, LEVELS.index(finding.level)))
    known: dict[int, int] = {}
    for finding in executed.findings:
        level_number = LEVELS.index(finding.level)
        known[finding.line] = min(level_number, known.get(finding.line, level_number))
    worst: list[Finding] = []
    for finding in findings:
        level_number = LEVELS.index(finding.level)
        if level_number < known.get(finding.line, len(LEVELS)):
            known[finding.line] = level_number
            worst.append(finding)
    return tuple(worst)


# -- the motion ------------------------------------------------------------------------------------


def trace_motion(executed: Executed, columns: Columns) -> Trace:
    """Return the motions of a run by column."""
    at = columns.at
    frames = np.array(executed.frame or [0] * len(executed.body), np.int64)[at]
    end = columns.ends
    start = np.full_like(end, np.nan)
    start[1:] = end[:-1]
    lines = np.asarray(executed.lines)[at]
    # What the run left out between two motions may have moved the tool.
    left_out = np.searchsorted(sorted(line for line, _ in executed.lost), lines, side="right")
    start[1:][(frames[1:] != frames[:-1]) | (left_out[1:] != left_out[:-1])] = np.nan
    leaving = end - start
    arriving = leaving.copy()
    arcs = columns.arcs
    if len(arcs):
        leaving[arcs] = _tangent(start[arcs], columns.via, end[arcs])
        arriving[arcs] = -_tangent(end[arcs], columns.via, start[arcs])
    return Trace(
        line=lines,
        place=at,
        is_joint=columns.moves_are(MoveJ),
        is_arc=columns.moves_are(MoveC),
        start=start,
        end=end,
        length=np.linalg.norm(end - start, axis=1),
        leaving=leaving,
        arriving=arriving,
        speed=columns.speed,
        blend=columns.blend,
        frame=frames,
        rotation=np.asarray(columns.rotation, np.int64),
        rotations=columns.table,
    )


def _tangent(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """Return the directions (A, 3) in which arcs leave `start`. NaN for full circles.

    An inversion about `start` maps the circle to a line along its tangent.
    """
    to_via, to_end = via - start, end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        inverted = to_via / _square(to_via) - to_end / _square(to_end)
    return np.asarray(inverted)


def _square(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", vectors, vectors)[:, None])


def _angles(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the angles (K,) between directions (K, 3), deg. NaN for unknown ones."""
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosines = np.einsum("ij,ij->i", before, after) / lengths
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


# -- process outputs -------------------------------------------------------------------------------


def find_processes(trace: Trace, outputs: Sequence[tuple[int, Output]]) -> list[Process]:
    """Return the outputs that are on while the tool works.

    Such an output is on in at least two periods with straight motions or arcs. Few of them have
    travel: joint motions, or motions as fast as those while it is off.
    """
    switches: dict[str, list[tuple[int, float]]] = {}
    for place, item in outputs:
        switches.setdefault(item.signal, []).append((place, item.value))
    processes = []
    for signal, steps in switches.items():
        places = np.array([place for place, _ in steps])
        is_set = np.array([False, *(value != 0 for _, value in steps)])
        is_on = is_set[np.searchsorted(places, trace.place)]
        if not is_on.any() or is_on.all():
            continue
        begins = np.concatenate([is_on[:1], is_on[1:] & ~is_on[:-1]])
        period = np.where(is_on, np.cumsum(begins) - 1, -1)
        works = is_on & ~trace.is_joint & trace.moves
        travel = _is_travel(trace, is_on) & is_on & trace.moves
        periods, with_travel = set(period[works].tolist()), set(period[travel].tolist())
        if len(periods) < 2 or len(with_travel) > _FEW * len(periods):
            continue
        comparable = np.isin(trace.frame, trace.frame[works])
        processes.append(Process(signal, is_on, period, _find_heights(trace, works), comparable))
    return processes


def _is_travel(trace: Trace, is_on: Mask) -> Mask:
    """Return which motions are travel (M,): of the joints, or as fast as those while it is off."""
    travels = trace.speed[~is_on & trace.moves]
    works = trace.speed[is_on & trace.moves & ~trace.is_joint]
    if not len(travels) or not len(works):
        return trace.is_joint
    travel, work = _find_median(travels), _find_median(works)
    if travel < 2 * work:
        return trace.is_joint
    return np.asarray(trace.is_joint | (trace.speed > 0.9 * travel))


def _find_median(values: FloatArray) -> float:
    """Return the middle value, or the mean of the two middle ones."""
    # `np.median` imports the masked arrays of numpy, 5 ms of a short build.
    ordered, half = np.sort(values), len(values) // 2
    return float(ordered[half] + ordered[-1 - half]) / 2


def _find_heights(trace: Trace, works: Mask) -> tuple[float, ...]:
    """Return the heights of a flat program, the lowest first. Empty for another program."""
    frames = trace.frame[works]
    if (frames != frames[:1]).any():
        return ()
    heights = trace.end[works, 2]
    heights = np.round(heights[np.isfinite(heights)] / _SAME_HEIGHT) * _SAME_HEIGHT
    if not len(heights):
        return ()
    values, counts = np.unique(heights, return_counts=True)
    often = np.argsort(-counts, kind="stable")[:_MOST_HEIGHTS]
    often = often[counts[often] > 1]
    if counts[often].sum() < _FLAT * len(heights):
        return ()
    return tuple(sorted(values[often].tolist()))


#: Numbers of motions with the texts of their findings.
Marks = Iterator[tuple[int, str]]


def _find_travel_on(trace: Trace, process: Process) -> Marks:
    """Yield travel motions while the output is on."""
    travel = _is_travel(trace, process.is_on) & process.is_on & trace.moves
    for motion in np.flatnonzero(travel).tolist():
        kind = "a joint or rapid motion" if trace.is_joint[motion] else "a motion at travel speed"
        yield motion, f"{kind} while {process.signal} is on, which is off in all other travel"


def _find_deep_motions(trace: Trace, process: Process) -> Marks:
    """Yield motions that end below all heights at which the program works."""
    if not process.heights:
        return
    lowest = process.heights[0]
    deep = np.flatnonzero(process.is_comparable & (trace.end[:, 2] < lowest - _DEEPER)).tolist()
    if len(deep) > max(1, 0.05 * len(trace.line)):
        return
    for motion in deep:
        depth = lowest - float(trace.end[motion, 2])
        what = f"{short(depth, 2)} mm deeper than in the motions with {process.signal} on"
        yield motion, f"the tool goes {what}"


def _find_low_travel(trace: Trace, process: Process) -> Marks:
    """Yield travel at working height while the output is off, and travel that comes down aslant."""
    for motion in _find_idle(trace, process, _is_travel(trace, process.is_on)):
        height = short(float(trace.end[motion, 2]), 2)
        yield (
            motion,
            f"the tool travels to Z {height}, where the tool works: it drags or comes down aslant",
        )


def _find_idle_work(trace: Trace, process: Process) -> Marks:
    """Yield motions at working height and feed while the output is off."""
    highest = max(process.heights, default=0.0) + _SAME_HEIGHT
    with np.errstate(invalid="ignore"):
        level = ~_is_travel(trace, process.is_on) & (trace.start[:, 2] <= highest)
    for motion in _find_idle(trace, process, level):
        yield motion, f"the tool runs at working height with {process.signal} off"


def _find_idle(trace: Trace, process: Process, among: Mask) -> list[int]:
    """Return the first motion of each run across to working height while the output is off.

    among: (M,) motions that are examined.
    Empty if this is how the program is meant: it has as many of them as periods of work.
    """
    if not process.heights:
        return []
    with np.errstate(invalid="ignore"):
        is_low = trace.end[:, 2] <= process.heights[-1] + _SAME_HEIGHT
        is_low &= trace.end[:, 2] >= process.heights[0] - _DEEPER
        across = np.linalg.norm((trace.end - trace.start)[:, :2], axis=1)
    idle = ~process.is_on & process.is_comparable & is_low & among & (across > _STANDS)
    begins = np.flatnonzero(idle & ~np.concatenate([[False], idle[:-1]]))
    ends = np.flatnonzero(idle & ~np.concatenate([idle[1:], [False]])) + 1
    lengths = np.concatenate([[0.0], np.cumsum(np.where(idle, across, 0.0))])
    first = begins[lengths[ends] - lengths[begins] > _ACROSS].tolist()
    return first if process.count >= _LEAST and len(first) <= _FEW * process.count else []


def _find_deep_paths(trace: Trace, process: Process) -> Marks:
    """Yield the begin of a path that is deeper as a whole than all others, which are alike."""
    motions = np.flatnonzero(process.is_on & ~trace.is_joint)
    if not len(motions):
        return
    first = np.flatnonzero(np.diff(process.period[motions], prepend=-1))
    # The lowest place is NaN if one is not known.
    lows = np.minimum.reduceat(trace.end[motions, 2], first)
    first, lows = first[np.isfinite(lows)], lows[np.isfinite(lows)]
    if len(lows) < _LEAST:
        return
    deepest = int(lows.argmin())
    others = np.delete(lows, deepest)
    if lows[deepest] < others.min() - _DEEPER and np.ptp(others) < _SAME_HEIGHT:
        depth = short(float(others.min() - lows[deepest]), 2)
        yield int(motions[first[deepest]]), f"a path {depth} mm deeper than all others"


def _find_stops(trace: Trace, process: Process) -> Marks:
    """Yield the only exact stop without a corner, in a program whose contours run through."""
    inside = process.is_on & trace.moves & ~_is_travel(trace, process.is_on)
    # The last motion of a path stops in any case, and so does a part of an arc.
    goes_on = inside[1:] & (process.period[1:] == process.period[:-1])
    inside[:-1] &= goes_on & (trace.line[1:] != trace.line[:-1])
    inside[-1:] = False
    with np.errstate(invalid="ignore"):
        inside[:-1] &= _junctions(trace)[1:] < _KEEPS_ON
    stops = np.flatnonzero(inside & (trace.blend <= 0))
    if len(stops) == 1 and inside.sum() > 2 * _LEAST:
        yield int(stops[0]), "an exact stop in a contour that runs through otherwise: a dwell mark"


def _find_repeats(trace: Trace, process: Process) -> Marks:
    """Yield the begin of a path that was run before, in a program that runs each path once."""
    ends: dict[bytes, int] = {}
    repeats = []
    order = np.searchsorted(process.period[process.is_on], np.arange(process.count + 1))
    motions = np.flatnonzero(process.is_on)
    for low, high in zip(order[:-1].tolist(), order[1:].tolist(), strict=True):
        path = motions[low:high]
        key = np.round(trace.end[path], 3).tobytes()
        if len(path) > 1 and key in ends:
            repeats.append(int(path[0]))
        ends[key] = low
    if len(ends) >= _LEAST and len(repeats) == 1:
        yield repeats[0], "the path that begins here is run twice, each other path once"


# -- single motions --------------------------------------------------------------------------------


def _find_reversals(trace: Trace) -> Marks:
    """Yield an arc at which the path turns back: the sense of the arc is likely the other one.

    A cusp is smooth at the other end of the arc.
    """
    arcs, before, after = _ends_of_arcs(trace)
    with np.errstate(invalid="ignore"):
        back = (before > _BACK) & ~(after < _SMOOTH) | (after > _BACK) & ~(before < _SMOOTH)
    odd = arcs[back]
    if len(odd) == 1:
        yield int(odd[0]), "an arc at which the path turns back: via point or sense of the arc"


def _find_corners(trace: Trace) -> Marks:
    """Yield arcs that have a corner at both ends, in a program whose arcs go on smoothly."""
    arcs, before, after = _ends_of_arcs(trace)
    is_known = np.isfinite(before) & np.isfinite(after)
    with np.errstate(invalid="ignore"):
        is_smooth = (before < _SMOOTH) & (after < _SMOOTH)
        is_corner = (before > _SMOOTH) & (after > _SMOOTH)
    odd = arcs[is_known & is_corner]
    if len(odd) == 1 and np.count_nonzero(is_known & is_smooth) >= _LEAST:
        yield (
            int(odd[0]),
            "an arc that leaves the path at both ends, as no other arc of the program",
        )


def _ends_of_arcs(trace: Trace) -> tuple[Indices, FloatArray, FloatArray]:
    """Return the arcs (A,), and the angles (A,) of the path at their starts and ends, deg.

    A run may have divided an arc of one line into several. They count as one.
    """
    if not trace.is_arc.any():
        return np.empty(0, np.intp), np.empty(0), np.empty(0)
    angles = np.append(_junctions_from_above(trace), np.nan)
    same = trace.is_arc[1:] & trace.is_arc[:-1] & (trace.line[1:] == trace.line[:-1])
    first = np.flatnonzero(trace.is_arc & ~np.concatenate([[False], same]))
    last = np.flatnonzero(trace.is_arc & ~np.concatenate([same, [False]]))
    return first, angles[first], angles[last + 1]


def _junctions(trace: Trace) -> FloatArray:
    """Return the angle (M,) between each motion and the one before, deg.

    NaN at the first motion, and beside joint motions and motions along Z.
    """
    angles = np.full(len(trace.line), np.nan)
    angles[1:] = _angles(trace.arriving[:-1], trace.leaving[1:])
    with np.errstate(invalid="ignore"):
        across = np.linalg.norm((trace.end - trace.start)[:, :2], axis=1) > _STANDS
    is_path = ~trace.is_joint & (across | trace.is_arc)
    angles[1:][~(is_path[1:] & is_path[:-1])] = np.nan
    return angles


def _junctions_from_above(trace: Trace) -> FloatArray:
    """Return the smaller angle (M,) of that in space and that from above, deg.

    A ramp on a contour turns nothing.
    """
    angles = _junctions(trace)
    from_above = _angles(trace.arriving[:-1] * (1, 1, 0), trace.leaving[1:] * (1, 1, 0))
    angles[1:] = np.where(np.isnan(angles[1:]), np.nan, np.fmin(angles[1:], from_above))
    return angles


def _find_odd_frames(trace: Trace) -> Marks:
    """Yield a motion with another tool or frame than both neighbours, in whose frame most run."""
    frame = trace.frame
    single = _find_single(frame, ~trace.is_joint)
    if len(single) == 1 and np.count_nonzero(frame == frame[single[0] - 1]) > 2 * _LEAST:
        what = "the motion runs with another tool or in another frame than the motions beside it"
        yield single[0], what


def _find_single(values: Indices, is_compared: Mask) -> list[int]:
    """Return the motions whose value (M,) differs from that of both neighbours.

    is_compared: (M,) motions that may be one of the three.
    """
    if len(values) < _LEAST:
        return []
    odd = (values[1:-1] != values[:-2]) & (values[:-2] == values[2:])
    odd &= is_compared[1:-1] & is_compared[:-2] & is_compared[2:]
    motions: list[int] = (np.flatnonzero(odd) + 1).tolist()
    return motions


def _find_while_on(find: Callable[[Trace], Marks], trace: Trace, process: Process) -> Marks:
    """Yield what `find` yields while the output is on."""
    yield from (mark for mark in find(trace) if process.is_on[mark[0]])


def _find_odd_speeds(trace: Trace) -> Marks:
    """Yield runs of a speed that is far from the speeds before and after, along one path.

    A run that is slower than travel has no finding if it is the only level one: it is the feed.
    """
    path = np.flatnonzero(~trace.is_joint)
    if len(path) < _LEAST:
        return
    changes = np.flatnonzero(trace.speed[path][1:] != trace.speed[path][:-1]) + 1
    first = path[np.concatenate([[0], changes])]
    speed = trace.speed[first]
    with np.errstate(divide="ignore", invalid="ignore"):
        before, after = speed[1:-1] / speed[:-2], speed[1:-1] / speed[2:]
        odd = np.fmin(before, after) >= _RATIO
        odd |= np.fmax(before, after) <= 1 / _RATIO
    is_level = np.abs(trace.end[first, 2] - trace.start[first, 2]) < _SAME_HEIGHT
    # A motion that covers no way has no speed.
    is_level &= trace.moves[first]
    is_work = is_level & (speed < trace.speed.max())
    for run in (np.flatnonzero(odd) + 1).tolist():
        is_only = is_work[run] and np.count_nonzero(is_work) == 1
        if is_level[run] and not is_only and np.count_nonzero(speed == speed[run]) == 1:
            what = f"the motion runs at {short(float(speed[run]), 3)} mm/s"
            yield int(first[run]), f"{what}, ten times more or less than the motions beside it"


def _find_odd_turns(trace: Trace) -> Marks:
    """Yield the single place of a path with another orientation than both neighbours.

    If a joint motion turns the tool like this too, the turn is meant.
    """
    rotations = _number_rotations(trace)
    single = _find_single(rotations, ~trace.is_joint)
    if len(single) != 1 or len(_find_single(rotations, trace.rotation >= 0)) != 1:
        return
    before, turned = (trace.rotations[trace.rotation[single[0] + k]] for k in (-1, 0))
    angle = _turn_between(before, turned)
    if angle > _TURN:
        yield single[0], f"the tool turns by {short(angle, 1)} deg in this place alone"


def _number_rotations(trace: Trace) -> Indices:
    """Return a number (M,) for the orientation of each motion, the same for equal ones."""
    rounded = [np.round(rotation, 4).tobytes() for rotation in trace.rotations]
    first = find_first_places(rounded)
    return np.array([first[key] for key in rounded] + [-1], np.int64)[trace.rotation]


def _turn_between(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two orientations, deg."""
    cosine = (float(np.trace(first.T @ second)) - 1) / 2
    return float(np.degrees(np.arccos(min(1.0, max(-1.0, cosine)))))


# -- outputs ---------------------------------------------------------------------------------------


def _check_outputs(
    executed: Executed, outputs: Sequence[tuple[int, Output]], processes: Sequence[Process]
) -> Iterator[Finding]:
    """Yield process outputs that end on, are switched on twice, or have another value once."""
    for process in processes:
        steps = [(place, item.value) for place, item in outputs if item.signal == process.signal]
        last, value = steps[-1]
        if value and executed.stopped is None:
            line = executed.lines[last]
            yield Finding("dangerous", line, f"{process.signal} is still on at the end")
        values = [value for _, value in steps if value]
        usual = _find_median(np.array(values))
        odd = [value for value in values if not usual / _RATIO < value < usual * _RATIO]
        before = 0.0
        for place, value in steps:
            line = executed.lines[place]
            if value and value == before:
                what = f"{process.signal} is switched on and is on already: it was not switched off"
                yield Finding("unusual", line, what)
            if len(odd) == 1 and value == odd[0] and len(values) >= _LEAST:
                what = f"{process.signal} is set to {value:g}, and to {usual:g} everywhere else"
                yield Finding("dangerous", line, what)
            before = value


_PROCESS_CHECKS: tuple[tuple[Level, Callable[[Trace, Process], Marks]], ...] = (
    ("dangerous", _find_travel_on),
    ("dangerous", _find_deep_motions),
    ("dangerous", _find_low_travel),
    ("dangerous", partial(_find_while_on, _find_odd_frames)),
    ("dangerous", partial(_find_while_on, _find_odd_turns)),
    ("unusual", _find_idle_work),
    ("unusual", _find_deep_paths),
    ("unusual", _find_stops),
    ("unusual", _find_repeats),
)
_MOTION_CHECKS: tuple[tuple[Level, Callable[[Trace], Marks]], ...] = (
    ("dangerous", _find_reversals),
    ("unusual", _find_odd_frames),
    ("unusual", _find_odd_turns),
    ("unusual", _find_odd_speeds),
    ("unusual", _find_corners),
)
