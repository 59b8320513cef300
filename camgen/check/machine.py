"""Checks a program of a machine with linear axes: travel limits of every motion, and collisions.

A motion is linear in the axes where the TCP moves along a line. On an arc an axis may turn around
between the ends, so the extreme positions of the arc are checked too: no limit is missed between
two samples. The program itself is not changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.collide import ClearanceReport, check_clear, join_reports
from camgen.check.reach import (
    JointTrace,
    MotionRows,
    interpolate_joints,
    join_traces,
    make_pose_path,
    sample_motions,
    trace_joints,
)
from camgen.collision.cell import CellScene, make_cell_scene
from camgen.collision.motion import measure_apart
from camgen.model.errors import NoSafeProgram
from camgen.model.job import Job, ToolTable
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.program import Program, ToolChange, switch_off_first
from camgen.model.text import join_short, short
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import Setup, compute_flange_poses
from camgen.robots.kinematics.inverse import compute_solutions
from camgen.robots.kinematics.joint_limits import are_within_limits, measure_excess
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

_REMEDY = "move the part in the machine: cell.base_from_work"


class _Section(Struct, frozen=True, eq=False):
    """The part of a program that is run with one tool.

    program: its instructions, with the frame of the tool.
    tool: the tool.
    shift: index in the whole program less the index in this one.
    """

    program: Program
    tool: ToolTable
    shift: int


def check_machine(
    program: Program, job: Job, cell: Workcell, file: str
) -> tuple[JointTrace, ClearanceReport, CellScene]:
    """The axis positions along `program`, mm, its clearances, and the scene of the first tool.

    file: the input, for messages.
    Raises NoSafeProgram for a motion beyond the travel of an axis or with a leaning tool, Blocked
    for a collision.
    """
    machine = cell.arm
    assert machine is not None
    reaches: list[JointTrace] = []
    clears: list[ClearanceReport] = []
    scenes: list[CellScene] = []
    sections = _split(program, job)
    for section in sections:
        reach = check_travel(section.program, machine, file)
        scene = make_cell_scene(
            replace(job, tool=section.tool),
            replace(cell, flange_from_tool=section.program.flange_from_tool),
            None,
        )
        course = trace_joints(reach, machine, partial(measure_apart, scene.scene), file)
        clears.append(check_clear(scene, reach, course, machine, file))
        reaches.append(reach)
        scenes.append(scene)
    whole = join_traces(program, reaches, [section.shift for section in sections])
    return whole, join_reports(clears), scenes[0]


def _split(program: Program, job: Job) -> list[_Section]:
    changes = np.flatnonzero(program.columns.are(ToolChange)).tolist()
    if not changes:
        return [_Section(program, job.tool, 0)]
    sections = []
    for start, end in pairwise([*changes, len(program.body)]):
        change = program.body[start]
        assert isinstance(change, ToolChange)
        body = program.body[start + 1 : end]
        # A program switches its outputs off first.
        whole = switch_off_first(body)
        frame = change.flange_from_tool or program.flange_from_tool
        part = replace(program, body=whole, flange_from_tool=frame)
        sections.append(
            _Section(part, _find_tool(change, job), start + 1 - (len(whole) - len(body)))
        )
    return sections


def _find_tool(change: ToolChange, job: Job) -> ToolTable:
    """The tool of the job that a tool change names; `job.tool` of that size if it names none."""
    for step in job.operations:
        tool = step.tool
        named = (tool.number, tool.name, tool.diameter, tool.length)
        if named == (change.number, change.name, change.diameter, change.length):
            return tool
    return replace(
        job.tool,
        diameter=change.diameter or job.tool.diameter,
        length=change.length or job.tool.length,
    )


def check_travel(program: Program, machine: Robot, file: str) -> JointTrace:
    """The axis positions along `program`.

    file: the input, for messages.
    Raises NoSafeProgram for the position farthest beyond the travel of an axis, or a leaning tool.
    """
    columns = program.columns
    no_anchors = np.empty((0, len(machine.home)))
    rows = sample_motions(program, make_pose_path(program, machine, no_anchors))
    setup = Setup(machine, program.base_from_work, program.flange_from_tool)

    def find_axes(position: FloatArray, rotation: FloatArray) -> FloatArray:
        return compute_solutions(machine, *compute_flange_poses(setup, position, rotation))[:, 0]

    axes = find_axes(rows.pose_path.position, rows.pose_path.rotation)
    leaning = np.flatnonzero(np.isnan(axes).any(axis=1))
    if len(leaning):
        raise _refuse(program, machine, file, rows, int(leaning[0]), "the tool cannot lean")
    _check_limits(program, machine, file, rows, find_axes)
    dense, at = interpolate_joints(machine, axes, rows.free)
    motion = np.repeat(rows.motion, np.diff(at, prepend=-1))
    return JointTrace(machine.name, dense, columns.at[motion], program, rows, at)


def _check_limits(
    program: Program,
    machine: Robot,
    file: str,
    rows: MotionRows,
    find_axes: Callable[[FloatArray, FloatArray], FloatArray],
) -> None:
    """Raises NoSafeProgram for the position that is farthest beyond the travel of an axis."""
    segment, extremes = _find_extremes(rows.pose_path, find_axes)
    row = np.append(np.arange(len(rows.pose_path)), segment + 1)
    position = np.concatenate([rows.pose_path.position, extremes])
    axes = find_axes(position, rows.pose_path.rotation[row])
    if are_within_limits(machine, axes).all():
        return
    beyond = measure_excess(machine, axes)
    worst = int(beyond.max(axis=1).argmax())
    axis = int(beyond[worst].argmax())
    value = float(axes[worst, axis])
    low, high = machine.limits[axis].tolist()
    limit = f"begins at {short(low, 3)}" if value < low else f"ends at {short(high, 3)}"
    name = machine.joints[axis].name
    what = f"axis {name} would be at {short(value, 3)} mm, its travel {limit} mm"
    raise _refuse(program, machine, file, rows, int(row[worst]), what)


def _find_extremes(
    poses: PosePath, find_axes: Callable[[FloatArray, FloatArray], FloatArray]
) -> tuple[IntArray, FloatArray]:
    """The segments (K,) and positions (K, 3), mm, at which an axis turns around on an arc.

    An axis position is a constant and a sine of the angle along the arc.
    """
    spans = poses.spans
    arcs = np.flatnonzero(spans.curved)
    none = np.zeros((len(arcs), 3))
    rotation = poses.rotation[arcs + 1]
    # Movement of each axis when the TCP moves along the two directions of the arc.
    across = find_axes(spans.towards[arcs], rotation) - find_axes(none, rotation)
    along = find_axes(spans.along[arcs], rotation) - find_axes(none, rotation)
    turning = np.arctan2(along, across)
    angles = np.stack([turning, turning - math.pi, turning + math.pi], axis=2)
    inside = np.abs(angles) < spans.sweep[arcs, None, None] / 2
    arc, _, _ = np.nonzero(inside)
    segment = arcs[arc]
    return segment, spans.point(angles[inside] / spans.sweep[segment] + 0.5, segment)


def _refuse(
    program: Program, machine: Robot, file: str, rows: MotionRows, row: int, what: str
) -> NoSafeProgram:
    index = int(program.columns.at[rows.motion[row]])
    position = join_short(rows.pose_path.position[row].tolist(), 1)
    text = f"{machine.name} cannot run {program.place_of(index)} at {position} mm: {what}"
    return NoSafeProgram(file, text, f"instruction {index}", _REMEDY)
