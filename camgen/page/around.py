"""What stands around a part and what the robot holds, as the test for collisions has it."""

from __future__ import annotations

from msgspec import Struct

from camgen.job import Result
from camgen.pose import IDENTITY, Pose
from camgen.robots.models import Box, Link
from camgen.solid import Solid

_HERE = Pose(IDENTITY, (0.0, 0.0, 0.0))


class Around(Struct, frozen=True, eq=False):
    """bodies: tool and holder, their boxes at the flange. standing: table and fixtures, their boxes in the work frame.
    meshes: fixtures that are meshes, work frame.
    """

    bodies: tuple[Link, ...]
    standing: tuple[Link, ...]
    meshes: tuple[tuple[str, Solid], ...]


def around(result: Result) -> Around:
    """As it was tested; without a robot nothing is, and it is what the job says. JobError for boxes that are none."""
    where = result.where
    if where is None:
        return _untested(result)
    work_from_base = result.program.base_from_work.inverse()
    standing = [
        Link(link.name, tuple(Box(work_from_base @ box.link_from_box, box.half) for box in link.boxes))
        for link in where.standing
    ]
    return Around(where.bodies, tuple(standing), where.meshes)


def _untested(result: Result) -> Around:
    job = result.job
    if not job.cell.fixtures and not job.tool.holder:
        return Around((), (), ())
    from camgen.surroundings import box_between, corners_of, mesh_fixtures  # noqa: PLC0415 (loads fcl)

    holder = tuple(box_between(_HERE, *corners_of("tool.holder", box)) for box in job.tool.holder or ())
    named = [(f"fixture {k}", box) for k, box in enumerate(job.cell.fixtures or (), 1) if not isinstance(box, str)]
    standing = [Link(name, (box_between(_HERE, *corners_of("cell.fixtures", box)),)) for name, box in named]
    return Around((Link("holder", holder),), tuple(standing), tuple(mesh_fixtures(job)))
