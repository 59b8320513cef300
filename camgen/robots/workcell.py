"""The cell of a job: the cell of the post with frames, home, arm and fixtures of the job."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Solid
from camgen.model.pose import TOOL_DOWN, Pose, pose_from_values, translation
from camgen.model.program import Joints
from camgen.model.text import counted
from camgen.robots.models import Robot

if TYPE_CHECKING:
    from camgen.geometry.fixtures import Fixtures
    from camgen.model.machine import Machine

#: Fixtures that are meshes with their names, work frame.
Meshes = tuple[tuple[str, Solid], ...]


class Workcell(Cell, frozen=True, eq=False):
    """The cell of a job.

    arm: the robot with which programs are checked, None for none.
    meshes: fixtures that are meshes.
    machine: the machine of `cell.machine`, None without it.
    fixtures: fixtures of a machine without an arm, None for none. An arm has them in its scene.
    """

    arm: Robot | None = None
    meshes: Meshes = ()
    machine: Machine | None = None
    fixtures: Fixtures | None = None


def equip_cell(cell: Cell, job: Job, arm: Robot | None = None, meshes: Meshes = ()) -> Workcell:
    """The cell with the frames and the home position of `job`.

    The built-in tool is as long as `tool.length`. A home of joint values is given in deg, or mm for
    sliding joints. The home of a machine without an arm is x, y and z of the tool in the work
    frame, mm, tool down. A robot that the job names has its own home if the job states none.

    arm: the robot with which programs are checked.
    meshes: fixtures that are meshes.

    Raises JobError for a wrong number of values or a wrong value.
    """
    table = job.cell
    if arm is not None and isinstance(cell.home, Pose) and arm.kind != "cartesian":
        raise make_machine_error()
    work = cell.base_from_work
    if table.base_from_work is not None:
        work = pose_from_values(_values("base_from_work", table.base_from_work, 6))
    tool = translation(0.0, 0.0, job.tool.length)
    if table.flange_from_tool is not None:
        tool = pose_from_values(_values("flange_from_tool", table.flange_from_tool, 6))
    home = cell.home
    fixtures = None
    if isinstance(home, Pose):
        if arm is None and table.fixtures:
            from camgen.geometry.fixtures import list_fixtures  # noqa: PLC0415 (loads shapely)

            fixtures = list_fixtures(job, meshes)
        if table.home is None:
            home = _above_travel(home, job, fixtures)
        else:
            x, y, z = _values("home", table.home, 3)
            home = Pose(TOOL_DOWN, (x, y, z))
            _check_above(home, fixtures)
    elif table.home is not None:
        count = len(table.home) or len(home.values)
        # With another number of joints it is another arm than the built-in one. The six-axis arms
        # that the posts know have no sliding joints.
        sliding = cell.sliding if count == len(home.values) else frozenset()
        values = enumerate(_values("home", table.home, count))
        home = Joints(tuple(v if k in sliding else math.radians(v) for k, v in values))
    elif table.robot and arm is not None:
        home = _choose_home(arm, cell, home)
    if arm is not None and isinstance(home, Pose) and table.base_from_work is None:
        work = _home_work(arm, home, tool)
    # A URDF is named by its file.
    name = table.robot.replace("\\", "/").rpartition("/")[2] or cell.name
    return Workcell(
        name,
        work,
        tool,
        home,
        cell.sliding,
        table.robot or cell.robot,
        cell.pace,
        arm,
        meshes,
        fixtures=fixtures,
    )


def _check_above(home: Pose, fixtures: Fixtures | None) -> None:
    """Raise JobError for a home below a fixture, because the tool moves there from anywhere."""
    height = home.origin[2]
    if fixtures is None or height >= fixtures.travel:
        return
    raise JobError(
        "job",
        f"a home at z {height:g} mm is not {fixtures.lift:g} mm above all fixtures",
        "cell.home",
        f"raise it to {fixtures.travel:g} mm, or lower cell.safety",
    )


def _above_travel(home: Pose, job: Job, fixtures: Fixtures | None) -> Pose:
    """The built-in home of a machine, raised if necessary.

    It is not below the clearance height of any operation, and `cell.safety` above all fixtures.
    """
    x, y, z = home.origin
    z = max(z, job.process.clearance, *(step.process.clearance for step in job.operations))
    if fixtures is not None:
        z = max(z, fixtures.travel)
    return replace(home, origin=(x, y, z))


def make_machine_error() -> JobError:
    """The error about an arm in the cell of a machine."""
    return JobError(
        "job", "the post is for a machine, not for an arm", "cell.robot", "leave it out"
    )


def _home_work(machine: Robot, home: Pose, tool: Pose) -> Pose:
    """The work frame of a job that states none: the home of the job is the machine's own home.

    home: pose of the tool in the work frame.
    tool: pose of the tool at the flange.
    """
    from camgen.robots.kinematics.forward import compute_flange  # noqa: PLC0415 (only for robots)

    _, origins = compute_flange(machine, machine.home[None])
    return translation(*(origins[0] - np.asarray((home @ tool.inverse()).origin)).tolist())


def _choose_home(arm: Robot, cell: Cell, builtin: Joints) -> Joints:
    """The home of a robot; the robot of the built-in cell keeps that of the cell."""
    from camgen.robots.catalogue import find_robot  # noqa: PLC0415 (only jobs with a robot load it)

    if cell.robot and arm.name == find_robot(cell.robot).name:
        return builtin
    return Joints(tuple(arm.home.tolist()))


def _values(key: str, values: Sequence[float], count: int) -> Sequence[float]:
    if len(values) != count:
        raise JobError(
            "job", f"has {counted(len(values), 'value')}", f"cell.{key}", f"give {count} values"
        )
    if not all(map(math.isfinite, values)):
        raise JobError(
            "job", "has a value that is not a finite number", f"cell.{key}", "give numbers"
        )
    return values
