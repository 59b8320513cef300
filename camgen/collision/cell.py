"""The scene of a robot in its cell: links, tool and holder, fixtures, table and part."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from msgspec import Struct

from camgen.collision.hits import find_collisions, measure_clearance
from camgen.collision.mesh import make_mesh
from camgen.collision.scene import Allowed, Scene, StandingMesh, make_scene, select_pairs
from camgen.geometry.corners import Corners, check_corners
from camgen.geometry.resting import turn_down
from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Solid
from camgen.model.pose import IDENTITY, FloatArray, Pose, to_vec3, translation
from camgen.model.text import short
from camgen.robots.models import Box, Link, Robot
from camgen.robots.workcell import Workcell

#: The table that is assumed: mm below the lowest point of the part, its size beyond the part, and
#: its thickness.
_TABLE_GAP_MM, _BEYOND, _THICK = 0.5, 200.0, 20.0
#: mm that a tool may enter the part beyond its contact: rounding, and tips that are not boxes.
_TOUCH = 0.1
#: mm: a tip that is nearer to the flange is at the flange; and the thickness of the plate that
#: stands for a missing tool.
_NO_TOOL, _PLATE = 1e-6, 1.0


class Untested(Struct, frozen=True):
    """Two bodies that are not tested against each other, and the reason."""

    bodies: tuple[str, str]
    why: str

    def __str__(self) -> str:
        return " against ".join(self.bodies)


class CellScene(Struct, frozen=True, eq=False):
    """The scene of a cell, and the parts of it that have different rules.

    scene: all pairs.
    with_margin: the pairs that are to keep `margin`.
    work: all other pairs: the tool against the part, which are intended to meet, and pairs that are
        nearer than the margin at the robot's own home.
    margin: mm.
    level: height in the base frame above which an end of tool and holder is free of part and
        fixtures, mm: `room` above their top (RFA paper, section II.A).
    room: half the width of the holder, and `cell.safety`, mm.
    low, high: (3,) corners of the box around the part in the base frame, mm.
    notes: notes to the user.
    bodies: tool and holder, with their boxes at the flange.
    standing: table and fixtures, with their boxes in the base frame.
    meshes: fixtures that are meshes, with their names, work frame.
    untested: pairs that are not tested, apart from links that share a joint.
    rims: ids of the lines whose own rim may enter the tip of the tool, as `work` allows.
    strict: `work` for all other lines; None without rims.
    """

    scene: Scene
    with_margin: Scene
    work: Scene
    margin: float
    level: float
    room: float
    low: FloatArray
    high: FloatArray
    notes: tuple[Note, ...]
    bodies: tuple[Link, ...]
    standing: tuple[Link, ...]
    meshes: tuple[tuple[str, Solid], ...]
    untested: tuple[Untested, ...]
    rims: frozenset[str] = frozenset()
    strict: Scene | None = None

    def is_rim(self, contours: Sequence[str]) -> bool:
        """Whether a path along these contours is along a rim."""
        return not self.rims.isdisjoint(contours)


def make_cell_scene(
    job: Job,
    cell: Workcell,
    solid: Solid | None,
    tip: float = 0.0,
    worked: FloatArray | None = None,
) -> CellScene:
    """The surroundings of the arm of `cell`.

    job: its tool, holder and fixtures.
    solid: the part. Without fixtures it is assumed to stand on a table.
    tip: distance that the tip of the tool may enter the part beyond its contact, mm: rims that it
        works extend into it by that.
    worked: (N, 3) points in the work frame that are worked and not on the part. The box around the
        part holds them too.

    Raises JobError for invalid boxes.
    """
    robot, base_from_work = cell.arm, cell.base_from_work
    assert robot is not None
    standing, notes = _make_standing(job, base_from_work, solid)
    walls = tuple(
        StandingMesh(name, make_mesh(shape), base_from_work) for name, shape in cell.meshes
    )
    holder = list(map(partial(check_corners, "tool.holder"), job.tool.holder or ()))
    contact = job.tool.radius * math.sin(math.radians(job.tool.axis_tilt)) + _TOUCH
    contact = min(contact, job.tool.radius * 0.99)
    shaft = _make_shaft(job, cell, holder)
    _check_length(job, shaft, contact)
    tool: tuple[Link, ...] = (Link("tool", (shaft,)),)
    if holder:
        flange = Pose(IDENTITY, (0.0, 0.0, 0.0))
        tool += (Link("holder", tuple(make_box(flange, *box) for box in holder)),)
    part = make_mesh(solid) if solid is not None else ()
    overlaps = _find_overlaps(robot, tool)
    untested = _list_untested(robot, overlaps)
    allowed = Allowed(contact, tip, overlaps)
    whole = make_scene(robot, tool, (*standing, *walls), part, base_from_work, allowed)
    close = _find_close(robot, whole, tool, job.cell.margin)
    intended = {("tool", "part"), *close}
    is_work = np.array([pair in intended for pair in whole.pairs], dtype=np.bool_)
    for (a, b), distance in close.items():
        why = f"they are {short(distance, 2)} mm apart at home"
        notes.append(Note("assumed", f"{a} and {b} keep no margin", why))
    notes += [Note("assumed", f"{pair} is not tested", pair.why) for pair in untested]
    vertices = None if solid is None else solid.vertices
    points = [table for table in (vertices, worked) if table is not None]
    low, high = _measure_extent(base_from_work, np.concatenate(points or [np.zeros((1, 3))]))
    tops = [high[2]]
    for link in standing:
        if link.name != "table":
            tops += map(_measure_top, link.boxes)
    tops += [_measure_extent(base_from_work, shape.vertices)[1][2] for _, shape in cell.meshes]
    widths = [job.tool.diameter, *(math.hypot(*(high - low)[:2]) for low, high in holder)]
    room = max(widths) / 2 + job.cell.safety
    return CellScene(
        scene=whole,
        with_margin=select_pairs(whole, np.flatnonzero(~is_work).tolist()),
        work=select_pairs(whole, np.flatnonzero(is_work).tolist()),
        margin=job.cell.margin,
        level=max(tops) + room,
        room=room,
        low=low,
        high=high,
        notes=tuple(notes),
        bodies=tool,
        standing=standing,
        meshes=tuple(cell.meshes),
        untested=untested,
    )


def _find_close(
    robot: Robot, scene: Scene, tool: tuple[Link, ...], margin: float
) -> dict[tuple[str, str], float]:
    """Pairs of moving bodies nearer than `margin` at the robot's own home, and their distances, mm.

    No path gives these pairs more distance than that.
    """
    if margin <= 0:
        return {}
    moving = {body.name for body in (*robot.links, *tool)}
    pairs = [k for k, pair in enumerate(scene.pairs) if moving.issuperset(pair)]
    home = robot.home[None]
    # Nearly always all of them are farther apart.
    if float(measure_clearance(select_pairs(scene, pairs), home, margin)[0]) >= margin:
        return {}
    distances: dict[tuple[str, str], float] = {}
    for k in pairs:
        distance = float(measure_clearance(select_pairs(scene, [k]), home, margin)[0])
        if distance < margin:
            distances[scene.pairs[k]] = distance
    return distances


#: Two links are left untested if they overlap at all of this number of joint values.
_SAMPLES = 48
#: Number of links at the end of an arm whose boxes extend beyond its flange: for arms with at least
#: 6 joints, and for others.
_WRIST_LINKS, _SHORT_WRIST_LINKS = 3, 2


def _find_overlaps(robot: Robot, tool: tuple[Link, ...]) -> tuple[tuple[str, str], ...]:
    """Pairs that meet at the robot's own home because their shapes are too coarse.

    These are a body of the tool and a link of the wrist, the boxes of two links of which one is of
    the wrist, and two other links that also meet at all joint values of an even sample.
    """
    count = len(robot.joints)
    last = _WRIST_LINKS if count >= 6 else _SHORT_WRIST_LINKS
    wrist = {link.name for link in robot.links[-last:]}
    bodies = {body.name for body in tool}
    bare = make_scene(robot, tool)
    overlapping: list[tuple[str, str]] = []
    for k in _find_meeting(bare, robot.home[None]):
        pair = bare.pairs[k]
        is_tool = bool(bodies & set(pair))
        is_spared = (is_tool or bare.closer[k] is None) and bool(wrist & set(pair))
        if not (is_spared or is_tool):
            rng = np.random.default_rng(1)
            spread = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (_SAMPLES, count))
            is_spared = bool((find_collisions(select_pairs(bare, [k]), spread) >= 0).all())
        if is_spared:
            overlapping.append(pair)
    return tuple(overlapping)


def _find_meeting(tested: Scene, joints: FloatArray) -> list[int]:
    if (find_collisions(tested, joints) < 0).all():
        return []
    pairs = range(len(tested.pairs))
    return [k for k in pairs if (find_collisions(select_pairs(tested, [k]), joints) >= 0).any()]


def _list_untested(robot: Robot, overlaps: tuple[tuple[str, str], ...]) -> tuple[Untested, ...]:
    spared = [
        (robot.links[i].name, robot.links[j].name) for i, j in robot.touching if abs(i - j) > 1
    ]
    untested = [Untested(pair, "their boxes overlap at home") for pair in (*spared, *overlaps)]
    for link in robot.links:
        pair = link.name, "all others"
        if link.unread:
            untested.append(Untested(pair, f"{', '.join(link.unread)} could not be read"))
        elif not link.boxes and link is not robot.links[0]:
            untested.append(Untested(pair, "it has no shape"))
    return tuple(untested)


def _make_standing(
    job: Job, base_from_work: Pose, solid: Solid | None
) -> tuple[tuple[Link, ...], list[Note]]:
    """Fixtures that are boxes, or the table that is assumed, in the base frame."""
    table = job.cell
    if table.rests_on is not None and (table.fixtures is not None or solid is None):
        what = "has no effect with cell.fixtures" if solid else "has no effect without a 3-D part"
        raise JobError("job", what, "cell.rests_on", "leave it out")
    if table.fixtures is not None or solid is None:
        fixtures = []
        for number, shape in enumerate(table.fixtures or (), 1):
            if isinstance(shape, list):
                box = make_box(base_from_work, *check_corners("cell.fixtures", shape))
                fixtures.append(Link(f"fixture {number}", (box,)))
        return tuple(fixtures), []
    upright = Pose(turn_upright(table.rests_on), (0.0, 0.0, 0.0))
    placed = solid.vertices @ upright.rotation.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    top = float(low[2]) - _TABLE_GAP_MM
    corners = np.array([*(low[:2] - _BEYOND), top - _THICK]), np.array([*(high[:2] + _BEYOND), top])
    box = make_box(base_from_work @ upright.inverse(), *corners)
    remedy = "say what it stands on: cell.fixtures, [] for nothing"
    return (Link("table", (box,)),), [Note("assumed", "the part stands on a table", remedy)]


def turn_upright(rests_on: Sequence[float] | None) -> FloatArray:
    """The rotation (3, 3) that turns the face on which a part rests downwards."""
    if rests_on is None:
        return IDENTITY
    length = math.hypot(*rests_on)
    if len(rests_on) != 3 or not length > 0:
        raise JobError(
            "job",
            f"{rests_on} is not a direction",
            "cell.rests_on",
            "give an outward normal, [x, y, z]",
        )
    return turn_down(np.asarray(rests_on) / length)


def make_box(frame: Pose, low: FloatArray, high: FloatArray) -> Box:
    """The box between two corners in `frame`."""
    return Box(frame @ translation(*to_vec3((low + high) / 2)), to_vec3((high - low) / 2))


def _make_shaft(job: Job, cell: Cell, holder: Sequence[Corners]) -> Box:
    """The tool without its holder: as wide as its diameter, from the tip to the holder or flange.

    If the tip is at the flange there is no tool, as in many recorded programs. Then a thin plate
    stands for it. Raises JobError if the axis of the tool meets neither holder nor flange.
    """
    flange_from_tool = cell.flange_from_tool
    tip, back = np.asarray(flange_from_tool.origin), -flange_from_tool.rotation[:, 2]
    length = min((_find_entry(tip, back, *box) for box in holder), default=math.inf)
    if length == math.inf:
        length = float(tip[2] / -back[2]) if back[2] < 0 else 0.0
    if not holder and float(np.linalg.norm(tip)) < _NO_TOOL:
        length = _PLATE
    if length <= 0:
        raise JobError(
            "job",
            "the axis of the tool, from its tip backwards, meets neither holder nor flange",
            "tool.holder",
            "give the holder's boxes at the flange",
        )
    half = job.tool.radius
    return Box(flange_from_tool @ translation(0.0, 0.0, -length / 2), (half, half, length / 2))


def _check_length(job: Job, shaft: Box, contact: float) -> None:
    """Raise JobError if the tool is not longer than twice its contact.

    contact: distance that the tool may enter the part, mm.
    """
    length, least = 2 * shaft.half[2], 2 * contact
    if length > least:
        return
    setting = "tool.length"
    if job.cell.flange_from_tool is not None:
        setting = "cell.flange_from_tool"
    if job.tool.holder:
        setting = "tool.holder"
    raise JobError(
        "job",
        f"the tool is {short(length, 3)} mm long, from its tip to the flange or holder",
        setting,
        f"make it longer than {short(least, 3)} mm",
    )


def _find_entry(start: FloatArray, along: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """The distance along a ray at which it enters a box, mm; infinite if it does not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([low, high]) - start) / along
    enter, leave = float(np.nanmax(ends.min(axis=0))), float(np.nanmin(ends.max(axis=0)))
    return enter if 0 < enter <= leave else math.inf


def _measure_extent(frame: Pose, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    placed = points @ frame.rotation.T + np.asarray(frame.origin)
    return placed.min(axis=0), placed.max(axis=0)


def _measure_top(box: Box) -> float:
    rotation, half = box.link_from_box.rotation, np.asarray(box.half)
    return float(box.link_from_box.origin[2] + np.abs(rotation[2]) @ half)
