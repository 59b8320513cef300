"""The files that a job reads: their bytes, and the digest that stands for them and for the settings."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from camgen.content import readable
from camgen.errors import InputError
from camgen.robots.urdf_name import split_name
from camgen.settings import Job


def digest_of(job: Job, sources: Sequence[Path]) -> str:
    """Twelve hex digits that stand for the settings and the bytes of all files that are read."""
    if not sources:
        raise InputError("input", "none is given")
    total = hashlib.sha256(msgspec.json.encode(_own(job), order="deterministic"))
    seen: dict[str, Path] = {}
    for source in sources:
        data = readable(source)
        real = os.path.realpath(source)
        if real in seen:
            raise InputError(str(source), "is given twice", remedy="name every input once")
        seen[real] = source
        total.update(b"%d:" % len(data))
        total.update(data)
    arm: Sequence[Path] = ()
    if described := split_name(job.cell.robot):
        from camgen.robots.urdf_files import urdf_files  # noqa: PLC0415 (only arms from a URDF need it)

        arm = urdf_files(described[0])
    meshes = [one for one in job.cell.fixtures or () if isinstance(one, str)]
    for name in (job.image.background, job.camera.file, *map(str, arm), *meshes):
        if name:
            total.update(readable(Path(name)))
    return total.hexdigest()[:12]


def _own(job: Job) -> dict[str, object]:
    """What the job sets differently from the defaults: a new setting leaves the programs of old jobs as they are."""
    image, camera, cell = job.image, job.camera, job.cell
    # Of a file its bytes count, wherever it lies.
    image = replace(image, background=Path(image.background).name)
    camera = replace(camera, file=Path(camera.file).name)
    if described := split_name(cell.robot):
        cell = replace(cell, robot="#".join((Path(described[0]).name, described[1])))
    if cell.fixtures:
        fixtures = [Path(one).name if isinstance(one, str) else one for one in cell.fixtures]
        cell = replace(cell, fixtures=fixtures)
    tables = msgspec.to_builtins(replace(job, image=image, camera=camera, cell=cell))
    defaults = msgspec.to_builtins(Job())
    return {
        name: {key: value for key, value in table.items() if value != defaults[name].get(key)}
        for name, table in tables.items()
        if table != defaults[name]
    }
