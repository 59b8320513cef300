"""Robots as data: ``robot`` by name, ``robots`` all of them.

A robot is a file in ``data`` that is called like one of its names, in small letters and digits alone. Its keys:
``name``, and ``also`` for other names; ``maker`` and ``controller``; ``convention``: what the controller's joint values
are, which are the joint values everywhere in camgen; ``trust``: how well the numbers are known (confirmed: two
independent sources; derived: one good source or worked out; uncertain); ``notes`` and ``sources``; ``flange``: its
frame in the last joint's, [x, y, z, rx, ry, rz]; ``home``; ``pad``: how much the boxes should be grown; ``touching``:
pairs of links that need no test against each other; ``rod``: a parallel rod that holds the joint's link, so that the
joint turns by its value less another's, within ``limits``; ``joints``: each ``at`` a place in the frame before it,
about or along ``axis``; ``links``: the base and the link that each joint moves, with ``boxes`` in its frame as [x, y, z
of the centre, half lengths]. Lengths mm, angles deg, speeds deg/s or mm/s.
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
from camgen.robots.kinematics.arms import recognise
from camgen.robots.models import Box, Link, Robot, Triple, Trust

_AXES: dict[str, Vec3] = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-z": (0, 0, -1)}


class _JointRow(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    at: Triple
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


def robot(name: str, files: Files | None = None) -> Robot:
    """The robot ``name``; capitals, spaces and hyphens do not matter. JobError with the nearest name if none has it.

    A name that ends in .urdf, or in .urdf#LINK for another tip than the flange, is a file; InputError if it is no arm.
    files: what has been read already.
    """
    if described := split_name(name):
        from camgen.robots.urdf import read_urdf  # noqa: PLC0415 (it makes a Robot, and few jobs name a file)

        return read_urdf(*described, files or Files())
    file = _read(_key(name)) or _by_key().get(_key(name))
    if file is None:
        near = suggest(name, [one.name for one in _by_key().values()])
        raise JobError(
            f"robot {name}", "there is no such robot", remedy=f"{near}; camgen robots lists them"
        )
    return _make(file)


def robots() -> tuple[Robot, ...]:
    """All built-in robots by name."""
    return tuple(_make(file) for file in _files())


@cache
def _read(key: str) -> _File | None:
    """The robot whose file is called ``key``: to read all for one takes 5 ms of every build."""
    file = resources.files("camgen.robots") / "data" / f"{key}.toml"
    return (
        msgspec.convert(tomllib.loads(file.read_text()), _File, strict=False)
        if file.is_file()
        else None
    )


@cache
def _files() -> tuple[_File, ...]:
    folder = resources.files("camgen.robots") / "data"
    keys = [
        entry.name.removesuffix(".toml")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    ]
    files = [file for key in keys if (file := _read(key))]
    return tuple(sorted(files, key=lambda file: file.name))


@cache
def _by_key() -> dict[str, _File]:
    return {_key(name): file for file in _files() for name in (file.name, *file.also)}


def _key(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


@cache
def _make(file: _File) -> Robot:
    units = np.array([1.0 if row.sliding else math.radians(1) for row in file.joints])
    joints = tuple(
        Joint(row.name, row.sliding, translation(*row.at), _AXES[row.axis]) for row in file.joints
    )
    flange = pose_from_values(file.flange)
    coupling, serial_limits = _rod(file.rod, len(joints))
    boxes = [
        tuple(Box(translation(*row[:3]), row[3:]) for row in link.boxes) for link in file.links
    ]
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
        links=tuple(Link(link.name, own) for link, own in zip(file.links, boxes, strict=True)),
        touching=file.touching,
        pad=file.pad,
        home=frozen(np.array(file.home) * units),
        trust=file.trust,
        notes=file.notes,
        sources=file.sources,
        arm=recognise(joints, flange),
    )


def _rod(rod: _Rod | None, count: int) -> tuple[FloatArray, FloatArray]:
    """The coupling (J, J) and the limits (J, 2) of the serial chain, rad."""
    coupling = np.eye(count)
    limits = np.tile([-math.inf, math.inf], (count, 1))
    if rod:
        coupling[rod.joint - 1, rod.less - 1] = -1.0
        limits[rod.joint - 1] = np.radians(rod.limits)
    return frozen(coupling), frozen(limits)
