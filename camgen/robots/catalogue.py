"""The built-in robots, each described by a file: `robot` by name, `robots` for all of them.

A file in `data` is called like one of the names of its robot, in lower case with letters and digits
alone. Lengths are in mm, angles in deg, speeds in deg/s or mm/s. Its keys:

- `name`, and `also` for other names; `maker` and `controller`.
- `convention`: meaning of the joint values of the controller, which camgen uses everywhere.
- `trust`: certainty of the numbers: confirmed by two independent sources, derived from one good
  source or by calculation, or uncertain. `notes` and `sources`.
- `flange`: frame of the flange in that of the last joint, [x, y, z, rx, ry, rz].
- `home`: joint values. `pad`: distance by which the boxes should be grown.
- `touching`: pairs of links that need no test against each other.
- `rod`: a parallel rod that holds the link of a joint, so that the joint turns by its value minus
  that of another joint, within `limits`.
- `joints`: each `at` a point in the frame before it, about or along `axis`.
- `links`: the base and the link that each joint moves, with `boxes` in its frame as [x, y, z of the
  centre, half lengths].
"""

from __future__ import annotations

import math
import tomllib
from functools import cache
from importlib import resources
from typing import Literal

import msgspec
import numpy as np
from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.job_tables import split_name
from camgen.model.pose import FloatArray, Vec3, frozen, pose_from_values, translation
from camgen.model.text import suggest
from camgen.read.files import Files
from camgen.robots.chain import Joint
from camgen.robots.kinematics.arms import recognise_arm
from camgen.robots.models import Box, Link, Robot, Trust

_AXES: dict[str, Vec3] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}


class _JointRow(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    at: Vec3
    axis: Literal["x", "y", "z", "-z"]
    limits: tuple[float, float]
    speed: float
    sliding: bool = False


class _LinkRow(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    boxes: tuple[tuple[float, float, float, float, float, float], ...]


class _Rod(Struct, frozen=True, forbid_unknown_fields=True):
    joint: int
    less: int
    limits: tuple[float, float]


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    also: tuple[str, ...]
    maker: str
    controller: str
    convention: str
    trust: Trust
    notes: tuple[str, ...]
    sources: tuple[str, ...]
    flange: tuple[float, float, float, float, float, float]
    home: tuple[float, ...]
    pad: float
    touching: tuple[tuple[int, int], ...]
    joints: tuple[_JointRow, ...]
    links: tuple[_LinkRow, ...]
    rod: _Rod | None = None


def find_robot(name: str, files: Files | None = None) -> Robot:
    """The robot of a name. Capitals, spaces and hyphens do not matter.

    A name that ends in .urdf, or in .urdf#LINK for another tip than the flange, is a file.

    files: files that have been read already.

    Raises JobError with the most similar name if there is no such robot, and InputError if a file
    does not describe an arm.
    """
    if described := split_name(name):
        from camgen.robots.urdf import read_urdf  # noqa: PLC0415 (few jobs name a file)

        return read_urdf(*described, files or Files())
    file = _read(_key(name)) or _by_key().get(_key(name))
    if file is None:
        near = suggest(name, [known.name for known in _by_key().values()])
        raise JobError(
            f"robot {name}", "there is no such robot", remedy=f"{near}; camgen robots lists them"
        )
    return _make(file)


def list_robots() -> tuple[Robot, ...]:
    """All built-in robots, sorted by name."""
    return tuple(_make(file) for file in _files())


@cache
def _read(key: str) -> _File | None:
    """The file with this key, None without such a file. To read all files takes 5 ms."""
    file = resources.files("camgen.robots") / "data" / f"{key}.toml"
    if not file.is_file():
        return None
    return msgspec.convert(tomllib.loads(file.read_text()), _File, strict=False)


@cache
def _files() -> tuple[_File, ...]:
    folder = resources.files("camgen.robots") / "data"
    names = [entry.name for entry in folder.iterdir() if entry.name.endswith(".toml")]
    files = filter(None, (_read(name.removesuffix(".toml")) for name in names))
    return tuple(sorted(files, key=lambda file: file.name))


@cache
def _by_key() -> dict[str, _File]:
    keys: dict[str, _File] = {}
    for file in _files():
        keys |= dict.fromkeys(map(_key, (file.name, *file.also)), file)
    return keys


def _key(name: str) -> str:
    return "".join(filter(str.isalnum, name.casefold()))


@cache
def _make(file: _File) -> Robot:
    units = np.array([1.0 if row.sliding else math.radians(1) for row in file.joints])
    joints = tuple(
        Joint(row.name, row.sliding, translation(*row.at), _AXES[row.axis]) for row in file.joints
    )
    flange = pose_from_values(file.flange)
    coupling, serial_limits = _couple(file.rod, len(joints))
    return Robot(
        name=file.name,
        maker=file.maker,
        controller=file.controller,
        convention=file.convention,
        joints=joints,
        limits=frozen(np.array([row.limits for row in file.joints]) * units[:, None]),
        speeds=frozen(np.array([row.speed for row in file.joints]) * units),
        flange=flange,
        coupling=coupling,
        serial_limits=serial_limits,
        links=tuple(map(_make_link, file.links)),
        touching=file.touching,
        pad=file.pad,
        home=frozen(np.array(file.home) * units),
        trust=file.trust,
        notes=file.notes,
        sources=file.sources,
        arm=recognise_arm(joints, flange),
    )


def _make_link(link: _LinkRow) -> Link:
    return Link(link.name, tuple(Box(translation(*row[:3]), row[3:]) for row in link.boxes))


def _couple(rod: _Rod | None, count: int) -> tuple[FloatArray, FloatArray]:
    """The fields `coupling` and `serial_limits` of `Robot`."""
    coupling = np.eye(count)
    limits = np.tile([-math.inf, math.inf], (count, 1))
    if rod:
        coupling[rod.joint - 1, rod.less - 1] = -1.0
        limits[rod.joint - 1] = np.radians(rod.limits)
    return frozen(coupling), frozen(limits)
