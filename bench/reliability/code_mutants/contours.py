"""Rules of the judge for each kind of job: contours followed, lines traced, pockets and holes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from bench.reliability.code_mutants.cases import Case
from bench.reliability.code_mutants.judge import (
    DIGIT_MM,
    SPEED_FRACTION,
    Piece,
    Run,
    Wrong,
    check_program,
    check_speed,
    find_angle,
    follow_state,
)
from bench.reliability.code_mutants.shapes import Array, Shape, make_region, offset_ring
from bench.reliability.code_mutants.traces import FREE, Step, Switch

#: A followed contour keeps its distance within this, and the chord tolerance of the job, mm.
_FOLLOW_MM = 0.005
#: Lengths along a curve may differ by this, mm: chords and flattened curves.
_LENGTH_MM = 0.08


def check_job(case: Case, steps: Sequence[Step]) -> None:
    """Raises Wrong if the steps do not do what the job asks."""
    runs = check_program(case, steps)
    if case.kind == "follow":
        _check_follow(case, list(case.shapes), runs)
    elif case.kind == "trace":
        _check_trace(case, runs)
    elif case.kind == "pocket":
        _check_pocket(case, runs)
    elif case.kind == "drill":
        _check_drill(case, steps, runs)
    else:
        _check_operations(case, steps, runs)


def _list_levels(case: Case) -> list[float]:
    """The heights of the passes, mm, from the top."""
    depth = case.setting("operation", "depth")
    passes = int(case.setting("operation", "passes", 1))
    return [-depth * (number + 1) / passes for number in range(passes)]


def _tolerance(case: Case) -> float:
    return _FOLLOW_MM + case.setting("tolerance", "chord") + DIGIT_MM


def _check_on(case: Case, piece: Piece) -> None:
    """Checks that the tool works while it is in the material, on a line or an arc."""
    if piece.motion.kind == FREE:
        raise piece.complain("a rapid motion below the clearance height")
    if case.signal and not piece.is_on:
        raise piece.complain("work with the signal off")
    if case.spindle and piece.rpm == 0.0:
        raise piece.complain("work with the spindle off")


# Follow


def _check_follow(case: Case, shapes: list[Shape], runs: list[Run]) -> None:
    radius = case.setting("tool", "diameter") / 2.0
    rings = [offset_ring(shape, radius) for shape in shapes]
    has_ramp = case.job["operation"].get("entry") == "ramp"
    counts: dict[tuple[int, int], int] = {}
    order: list[int] = []
    for run in runs:
        for piece in run.pieces:
            _check_on(case, piece)
        number = _find_ring(case, run, rings)
        shape, ring = shapes[number], rings[number]
        contour = _split_leads(case, run, ring, shapes)
        before, after = run.pieces.index(contour[0]), run.pieces.index(contour[-1]) + 1
        slack = _LENGTH_MM + _find_touching(case, run.pieces[:before], "lead_in")
        slack += _find_touching(case, run.pieces[after:], "lead_out")
        travelled = _measure_travel(case, contour, ring, shape)
        has_pressed = False
        for piece in contour:
            _check_contour_feed(case, piece, shapes)
            _check_force(case, piece, shapes, has_pressed)
            has_pressed |= piece.motion.force > 0.0
        if has_ramp:
            _check_ramp(case, contour, ring, shape)
            level = len(_list_levels(case)) - 1
        else:
            level = _find_level(case, contour)
            wanted = ring.length + case.setting("operation", "overlap")
            if abs(travelled - wanted) > slack:
                message = f"{shape.name} is run for {travelled:.3f} mm, not {wanted:.3f} mm"
                raise contour[-1].complain(message)
        key = (number, level)
        counts[key] = counts.get(key, 0) + 1
        if not has_ramp and level > 0 and not counts.get((number, level - 1)):
            raise contour[0].complain("a pass before the one above it")
        order.append(number)
    _check_counts(case, shapes, counts, has_ramp)
    _check_order(shapes, order)


def _check_counts(
    case: Case, shapes: list[Shape], counts: dict[tuple[int, int], int], has_ramp: bool
) -> None:
    levels = range(len(_list_levels(case)))
    if has_ramp:
        levels = range(len(levels) - 1, len(levels))
    for number, shape in enumerate(shapes):
        for level in levels:
            count = counts.get((number, level), 0)
            if count != 1:
                raise Wrong(f"{shape.name}, pass {level}: run {count} times")


def _check_order(shapes: list[Shape], order: list[int]) -> None:
    """Checks that holes come before the outline around them."""
    outlines = [place for place, number in enumerate(order) if not shapes[number].is_hole]
    holes = [place for place, number in enumerate(order) if shapes[number].is_hole]
    if outlines and holes and min(outlines) < max(holes):
        raise Wrong("an outline is run before a hole in it")


def _find_ring(case: Case, run: Run, rings: Sequence[shapely.Geometry]) -> int:
    """The index of the curve that most of a run lies on."""
    points = shapely.points(run.points[:, :2])
    shares = [float((shapely.distance(ring, points) < _tolerance(case)).mean()) for ring in rings]
    best = int(np.argmax(shares))
    if shares[best] == 0.0:
        raise run.pieces[0].complain("work that is on no curve")
    return best


def _split_leads(case: Case, run: Run, ring: shapely.Geometry, shapes: list[Shape]) -> list[Piece]:
    """The motions on the curve; checks those before and after them, which have to be leads."""
    tolerance = _tolerance(case)
    on_curve = []
    for piece in run.pieces:
        distances = shapely.distance(ring, piece.places)
        on_curve.append(bool(distances.max() < tolerance))
    if not any(on_curve):
        raise run.pieces[0].complain("leaves its curve")
    first = on_curve.index(True)
    last = len(on_curve) - on_curve[::-1].index(True)
    if not all(on_curve[first:last]):
        raise run.pieces[on_curve.index(False, first)].complain("leaves its curve")
    contour = run.pieces[first:last]
    _check_lead(case, run.pieces[:first], contour[0], "lead_in", shapes)
    _check_lead(case, run.pieces[last:][::-1], contour[-1], "lead_out", shapes)
    return contour


def _check_lead(
    case: Case, lead: list[Piece], neighbour: Piece, key: str, shapes: list[Shape]
) -> None:
    """Checks a quarter circle of the given length beside the part, tangent to the curve."""
    wanted = case.setting("operation", key)
    length = sum(piece.length for piece in lead)
    if abs(length - wanted) > _LENGTH_MM + _find_touching(case, lead, key):
        raise neighbour.complain(f"{key} of {length:.3f} mm, not {wanted:g} mm")
    if not lead:
        return
    points = np.concatenate([piece.points for piece in lead])
    radius = case.setting("tool", "diameter") / 2.0
    distances = shapely.distance(make_region(tuple(shapes)), shapely.points(points[:, :2]))
    if distances.min() < radius - _tolerance(case):
        raise lead[0].complain(f"a lead {distances.min():.3f} mm from the part")
    if np.ptp(np.append(points[:, 2], neighbour.points[:, 2])) > DIGIT_MM:
        raise lead[0].complain("a lead at another height than its curve")
    far = lead[-1] if key == "lead_out" else lead[0]
    corner, turning = _end_directions(lead, neighbour, key)
    # The chords that the job allows leave a quarter circle by half of the angle that each spans.
    chord = case.setting("tolerance", "chord") if len(lead) > 1 else 0.0
    half = math.acos(1.0 - chord / (wanted / (math.pi / 2.0)))
    if corner > math.radians(6.0) + 2.0 * half:
        raise far.complain("a lead that is not tangent to its curve")
    # Half of a chord is missing at both ends, and the chord at the curve may count as part of it.
    if abs(turning - math.pi / 2.0) > math.radians(12.0) + 4.0 * half:
        raise far.complain("a lead that is not a quarter circle")
    speed = min(case.setting("process", "feed"), neighbour.motion.speed)
    for piece in lead:
        check_speed(piece, speed)
        if piece.motion.force:
            raise piece.complain("force on a lead")


def _find_touching(case: Case, lead: list[Piece], key: str) -> float:
    """Length of a lead made of chords, mm, that may be as near to the curve as a motion along it.

    That is its first chord.
    """
    chord = case.setting("tolerance", "chord") if len(lead) > 1 else 0.0
    return math.sqrt(8.0 * chord * case.setting("operation", key) / (math.pi / 2.0))


def _end_directions(lead: list[Piece], neighbour: Piece, key: str) -> tuple[float, float]:
    """The angle between a lead and its curve, and the angle through which the lead turns, rad.

    lead: the motions between the free end and the curve, the free end first.
    """
    if key == "lead_in":
        touch, free = lead[-1].find_direction(-1), lead[0].find_direction(0)
        curve = neighbour.find_direction(0)
    else:
        touch, free = lead[-1].find_direction(0), lead[0].find_direction(-1)
        curve = neighbour.find_direction(-1)
    return find_angle(touch, curve), find_angle(touch, free)


def _measure_travel(
    case: Case, contour: list[Piece], ring: shapely.Geometry, shape: Shape
) -> float:
    """The length run along a closed curve, mm; checks the direction of every step."""
    is_climb = case.job["operation"].get("direction", "climb") == "climb"
    # Climb keeps the part on the right: outlines are run clockwise, holes counter-clockwise.
    sign = 1.0 if shape.is_hole == is_climb else -1.0
    total = 0.0
    for piece in contour:
        positions = shapely.line_locate_point(ring, piece.places)
        steps = np.diff(positions)
        steps -= np.round(steps / ring.length) * ring.length
        if (sign * steps < -2.0 * DIGIT_MM).any():
            raise piece.complain(f"runs {shape.name} in the wrong direction")
        total += float(sign * steps.sum())
    return total


def _find_level(case: Case, contour: list[Piece]) -> int:
    heights = np.concatenate([piece.points[:, 2] for piece in contour])
    if case.setting("process", "force"):
        heights = heights[:1]
    if np.ptp(heights) > DIGIT_MM:
        raise contour[0].complain("a pass that is not level")
    levels = np.array(_list_levels(case))
    level = int(np.argmin(np.abs(levels - heights[0])))
    if abs(levels[level] - heights[0]) > DIGIT_MM:
        raise contour[0].complain(f"a pass at {heights[0]:.3f}, not at one of {levels.tolist()}")
    return level


def _check_contour_feed(case: Case, piece: Piece, shapes: list[Shape]) -> None:
    """Checks the feed of a level motion, which the radius of the touched arc decides."""
    if np.ptp(piece.points[:, 2]) > DIGIT_MM:
        return
    middle = piece.points[len(piece.points) // 2, :2]
    check_speed(piece, _find_feed(case, middle, shapes))


def _find_feed(case: Case, place: Array, shapes: list[Shape]) -> float:
    feed, radius = case.setting("process", "feed"), case.setting("tool", "diameter") / 2.0
    touched, shape = _find_contact(case, place, shapes)
    cap = feed * case.setting("process", "max_feed_factor")
    if touched is None:
        return cap
    if math.isinf(touched):
        return feed
    is_inner = shape.is_hole
    factor = (touched - radius if is_inner else touched + radius) / touched
    return min(feed * factor, cap)


def _find_contact(case: Case, place: Array, shapes: list[Shape]) -> tuple[float | None, Shape]:
    """The radius (mm) of the arc that the tool touches at a place, (2,) mm, and its contour.

    inf for a line, None for a corner.
    """
    radius = case.setting("tool", "diameter") / 2.0
    for shape in shapes:
        touched = shape.find_contact(place, radius, _tolerance(case))
        if touched is not None:
            return touched, shape
    return None, shapes[0]


def _check_force(case: Case, piece: Piece, shapes: list[Shape], has_pressed: bool) -> None:
    """Checks the force, which is 0 about sharp corners, and that tool x points at the part.

    A tool that has pressed runs about corners at the retract height.
    """
    wanted = case.setting("process", "force")
    middle = piece.points[len(piece.points) // 2, :2]
    touched, _ = _find_contact(case, middle, shapes)
    expected = wanted if touched is not None else 0.0
    if wanted:
        is_raised = touched is None and has_pressed
        height = case.setting("process", "retract") if is_raised else 0.0
        if np.abs(piece.points[:, 2] - height).max() > DIGIT_MM:
            raise piece.complain(f"not at height {height:g}")
    if not abs(piece.motion.force - expected) <= 1e-3:
        raise piece.complain(f"a force of {piece.motion.force:g} N, not {expected:g} N")
    if case.job["tool"].get("orient") != "follow":
        return
    assert piece.motion.rotation is not None
    boundary = shapely.union_all([shapely.LineString(shape.flatten()) for shape in shapes])
    end = piece.points[-1, :2]
    tool_x = piece.motion.rotation[:2, 0]
    ahead = end + tool_x * (case.setting("tool", "diameter") / 2.0)
    if shapely.distance(boundary, shapely.Point(ahead)) > 0.05:
        raise piece.complain("tool x does not point at the part")


# Ramps and tabs

#: Length of a bin along a curve in which the depth cut so far is kept, mm.
_BIN_MM = 0.25


def _check_ramp(case: Case, contour: list[Piece], ring: shapely.Geometry, shape: Shape) -> None:
    """Checks slopes, their speeds, how much is cut at once, and the depth reached all along."""
    levels = _list_levels(case)
    step = levels[0]
    bins = np.zeros(math.ceil(ring.length / _BIN_MM) + 1)
    entry = math.tan(math.radians(case.setting("operation", "entry_angle")))
    tab_top = levels[-1] + case.setting("operation", "tab_height")
    for piece in contour:
        start, end = piece.points[0, 2], piece.points[-1, 2]
        flat = math.dist(piece.points[0, :2], piece.points[-1, :2])
        slope = abs(end - start) / max(flat, 1e-9)
        is_tab = max(start, end) < tab_top + DIGIT_MM
        steepest = 1.0 if is_tab and end > start else entry
        if slope > steepest * 1.05 + 0.01:
            raise piece.complain(f"a slope of {math.degrees(math.atan(slope)):.1f} deg")
        if end < start - DIGIT_MM:
            _check_down(case, piece, slope, is_tab)
        # Samples are as far apart as bins are long: with those between them no bin is left out.
        between = (piece.points[1:] + piece.points[:-1]) / 2.0
        points = np.concatenate([piece.points, between])
        positions = shapely.line_locate_point(ring, shapely.points(points[:, :2]))
        places = np.floor(positions / _BIN_MM).astype(int)
        if (points[:, 2] < bins[places] + step - 0.05).any():
            raise piece.complain("cuts deeper at once than one pass")
        np.minimum.at(bins, places, points[:, 2])
    _check_depths(case, bins[: int(ring.length / _BIN_MM)], shape)


def _check_down(case: Case, piece: Piece, slope: float, is_tab: bool) -> None:
    """Checks the speed downwards: an entry at plunge, from a tab no faster than plunge."""
    plunge = case.setting("process", "plunge")
    if not is_tab:
        check_speed(piece, plunge)
        return
    length = max(math.dist(piece.points[0], piece.points[-1]), DIGIT_MM)
    # A short piece is as steep as its printed digits make it.
    share = math.sin(math.atan(slope)) - DIGIT_MM / length
    if piece.motion.speed * share > plunge * 1.01:
        raise piece.complain("down from a tab faster than plunge")


def _check_depths(case: Case, bins: Array, shape: Shape) -> None:
    """Checks that the whole depth is reached all along, except at the tabs."""
    depth, count = case.setting("operation", "depth"), int(case.setting("operation", "tabs"))
    is_raised = bins > -depth + 0.05
    if shape.is_hole or not count:
        if is_raised.any():
            raise Wrong(f"{shape.name}: the depth is not reached everywhere")
        return
    top = -depth + case.setting("operation", "tab_height")
    if bins.max() > top + DIGIT_MM:
        raise Wrong(f"{shape.name}: a tab higher than {top:g}")
    begins = np.flatnonzero(is_raised & ~np.roll(is_raised, 1))
    if len(begins) != count:
        raise Wrong(f"{shape.name}: {len(begins)} tabs, not {count}")
    is_top = np.abs(bins - top) < DIGIT_MM
    wanted = case.setting("operation", "tab_width") + case.setting("tool", "diameter")
    for begin in begins:
        rolled = np.roll(is_top, -begin)
        raised = np.roll(is_raised, -begin)
        end = int(np.argmin(raised))
        length = rolled[:end].sum() * _BIN_MM
        if abs(length - wanted) > 2.0 * _BIN_MM:
            raise Wrong(f"{shape.name}: a tab of {length:.2f} mm, not {wanted:g} mm")


# Trace


def _check_trace(case: Case, runs: list[Run]) -> None:
    lines = [shapely.LineString(shape.flatten()) for shape in case.shapes]
    drawing = shapely.union_all(lines)
    wanted = sum(shape.length for shape in case.shapes)
    levels = _list_levels(case)
    lengths = [0.0] * len(levels)
    cut: list[list[Array]] = [[] for _ in levels]
    for run in runs:
        for piece in run.pieces:
            _check_on(case, piece)
            distances = shapely.distance(drawing, piece.places)
            if distances.max() > case.setting("tolerance", "chord") + DIGIT_MM:
                raise piece.complain(f"{distances.max():.3f} mm from every line")
            level = _find_level(case, [piece])
            if level > 0 and not _is_covered(piece.points, cut[level - 1]):
                raise piece.complain("a pass before the one above it")
            check_speed(piece, case.setting("process", "feed"))
            if piece.motion.force:
                raise piece.complain("force on a traced line")
            lengths[level] += piece.length
            cut[level].append(piece.points)
    for level, points in enumerate(cut):
        for shape in case.shapes:
            if not points or not _is_covered(_add_height(shape.flatten(), levels[level]), points):
                raise Wrong(f"{shape.name}, pass {level}: not run along all of it")
        if abs(lengths[level] - wanted) > _LENGTH_MM:
            raise Wrong(f"pass {level}: {lengths[level]:.2f} mm run, {wanted:.2f} mm drawn")


def _add_height(points: Array, height: float) -> Array:
    return np.column_stack([points, np.full(len(points), height)])


def _is_covered(points: Array, cut: list[Array]) -> bool:
    """Whether every point lies on a motion of `cut`, seen from above."""
    if not cut:
        return False
    lines = shapely.union_all([shapely.LineString(piece[:, :2]) for piece in cut])
    return bool(shapely.distance(lines, shapely.points(points[:, :2])).max() < 0.03)


# Pocket


def _check_pocket(case: Case, runs: list[Run]) -> None:
    radius = case.setting("tool", "diameter") / 2.0
    wall = make_region(case.shapes)
    allowed = shapely.buffer(wall, -radius)
    reachable = shapely.buffer(allowed, radius, quad_segs=64)
    levels = _list_levels(case)
    swept: list[list[shapely.Geometry]] = [[] for _ in levels]
    along_wall = [0.0] * len(levels)
    feed = case.setting("process", "feed")
    ring = shapely.get_exterior_ring(allowed)
    ring = ring if ring.is_ccw else shapely.reverse(ring)
    for run in runs:
        for piece in run.pieces:
            _check_on(case, piece)
            distances = shapely.distance(allowed, piece.places)
            if distances.max() > _FOLLOW_MM + DIGIT_MM:
                raise piece.complain(f"cuts {distances.max():.3f} mm into the wall")
            level = _find_level(case, [piece])
            if level > 0 and not swept[level - 1]:
                raise piece.complain("a pass before the one above it")
            if not 0.02 * feed <= piece.motion.speed <= feed * (1.0 + SPEED_FRACTION):
                raise piece.complain(f"{piece.motion.speed:g} mm/s")
            if piece.motion.via is None:
                check_speed(piece, feed)
            swept[level].append(shapely.LineString(piece.points[:, :2]))
            along_wall[level] += _measure_along(piece, ring)
    for level, lines in enumerate(swept):
        cleared = shapely.buffer(shapely.union_all(lines), radius, quad_segs=64)
        rest = shapely.difference(reachable, cleared).area
        if rest > 0.05:
            raise Wrong(f"pass {level}: {rest:.3f} mm2 of the pocket not cleared")
        # Climb: the wall on the right, so once around counter-clockwise.
        if abs(along_wall[level] - ring.length) > _LENGTH_MM:
            raise Wrong(f"pass {level}: {along_wall[level]:.2f} mm along the wall")


def _measure_along(piece: Piece, ring: shapely.Geometry) -> float:
    """The signed length that a motion runs along the last pass at the wall, mm."""
    if shapely.distance(ring, piece.places).max() > _FOLLOW_MM + DIGIT_MM:
        return 0.0
    steps = np.diff(shapely.line_locate_point(ring, piece.places))
    return float((steps - np.round(steps / ring.length) * ring.length).sum())


# Drill


def _check_drill(case: Case, steps: Sequence[Step], runs: list[Run]) -> None:
    if runs:
        raise runs[0].pieces[0].complain("moves across below the clearance height")
    centres = np.array([_centre_of(shape) for shape in case.shapes])
    drilled: list[int] = []
    deepest = np.zeros(len(centres))
    approach = case.setting("process", "approach")
    for piece in follow_state(case, steps):
        is_in_air = float(piece.points[:, 2].min()) > approach + DIGIT_MM
        if not piece.is_known or not piece.is_vertical or piece.length < DIGIT_MM or is_in_air:
            continue
        distances = np.hypot(*(centres - piece.points[0, :2]).T)
        hole = int(np.argmin(distances))
        if distances[hole] > DIGIT_MM:
            raise piece.complain("drills where there is no hole")
        if not drilled or drilled[-1] != hole:
            drilled.append(hole)
        end = float(piece.points[-1, 2])
        if end < deepest[hole] - DIGIT_MM:
            _check_peck(case, piece, float(deepest[hole]))
            deepest[hole] = end
        elif end < piece.points[0, 2]:
            _check_return(case, piece, float(deepest[hole]))
    _check_holes(case, drilled, deepest)


def _check_holes(case: Case, drilled: list[int], deepest: Array) -> None:
    """Checks that each hole is drilled once, to its depth."""
    depth = case.setting("operation", "depth")
    for hole, shape in enumerate(case.shapes):
        if drilled.count(hole) != 1:
            raise Wrong(f"{shape.name}: drilled {drilled.count(hole)} times")
        if abs(deepest[hole] + depth) > DIGIT_MM:
            raise Wrong(f"{shape.name}: {-deepest[hole]:.3f} mm deep, not {depth:g} mm")


def _check_peck(case: Case, piece: Piece, before: float) -> None:
    """Checks a motion that drills deeper than `before`, mm."""
    _check_on(case, piece)
    start, end = float(piece.points[0, 2]), float(piece.points[-1, 2])
    highest = max(case.setting("process", "approach"), before + _ABOVE_MM)
    if not before - DIGIT_MM <= start <= highest + DIGIT_MM:
        raise piece.complain("drills from another height than that of approach")
    check_speed(piece, case.setting("process", "feed"))
    peck = case.setting("operation", "depth") / case.setting("operation", "passes", 1)
    if before - end > peck + DIGIT_MM:
        raise piece.complain(f"a peck of {before - end:.3f} mm, not {peck:.3f} mm")


def _check_return(case: Case, piece: Piece, before: float) -> None:
    """Checks a motion down to where the hole is drilled: fast ones end above the bottom."""
    speed, end = piece.motion.speed, float(piece.points[-1, 2])
    feed, travel = case.setting("process", "feed"), case.setting("process", "travel")
    if abs(speed - feed) <= SPEED_FRACTION * feed:
        return
    if not math.isnan(speed) and abs(speed - travel) > SPEED_FRACTION * travel:
        raise piece.complain(f"{speed:g} mm/s, not feed or travel")
    if end < 0.0 and end < before + _ABOVE_MM - DIGIT_MM:
        raise piece.complain("a rapid motion to the bottom of the hole")


#: Height above the bottom of a hole at which drilling begins again, mm.
_ABOVE_MM = 0.254


def _centre_of(shape: Shape) -> tuple[float, float]:
    return ((shape.vertices[0][0] + shape.vertices[1][0]) / 2.0, shape.vertices[0][1])


# Two operations with a tool each


def _check_operations(case: Case, steps: Sequence[Step], runs: list[Run]) -> None:
    """Judges the runs of each operation as a job of its own, at the spindle speed of its tool."""
    speeds = [step.value for step in steps if isinstance(step, Switch) and step.value > 0.0]
    tools = {tool["name"]: tool for tool in case.job["tools"]}  # type: ignore[index]
    wanted = [tools[row["tool"]]["speed"] for row in case.job["operations"]]  # type: ignore[index]
    if speeds != wanted:
        raise Wrong(f"spindle speeds {speeds}, not {wanted}")
    for row in case.job["operations"]:
        tool = tools[row["tool"]]  # type: ignore[index]
        is_inner = row["nesting"] == "inner"  # type: ignore[index]
        shapes = [shape for shape in case.shapes if shape.is_hole == is_inner]
        job = {**case.job, "operation": row, "tool": tool}
        part = case._replace(job=job)  # type: ignore[arg-type]
        turning = [run for run in runs if run.pieces[0].rpm == tool["speed"]]
        _check_follow(part, shapes, turning)
