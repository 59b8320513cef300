"""All that a build reads: the part, the cell with its arm and fixtures, and the digest that stands for them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.lang.programs import Frames
from camgen.lang.recorded import Recorded
from camgen.model.cell import Cell
from camgen.model.errors import InputError, JobError
from camgen.model.job import Choice, Job, OperationTable, ProcessTable, ToolRow, ToolTable
from camgen.model.job_tables import ROWS, split_name
from camgen.model.part import Contour, Note, OpenOutline, Part, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Joints
from camgen.model.text import counted, short
from camgen.read import find_reader, read
from camgen.read.clamps import set_clamps_aside
from camgen.read.files import Files, identity
from camgen.read.move import move_part
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell, equip

#: Hints on the assumed acceleration of mills, for each kind of corner.
_MILLS = {"arc": "", "junction": "; GRBL's own default of 10 mm/s2 takes far longer"}


class Inputs(Struct, frozen=True, eq=False):
    """What was read; no file is opened after it. digest: of all its bytes and the settings."""

    digest: str
    part: Part
    cell: Workcell


def read_inputs(sources: Sequence[Path | Part], job: Job, cell: Cell, files: Files) -> Inputs:
    """All that ``job`` needs. cell: of the post; 3-D parts have its robot where the job names none."""
    digest = digest_of(job, sources, files)
    part = read_parts(sources, job, files)
    return Inputs(digest, part, read_cell(part, job, cell, files))


def read_cell(part: Part | None, job: Job, cell: Cell, files: Files) -> Workcell:
    """The cell of ``job`` on the base of ``cell``, that of a post, with the arm that ``part`` is checked with."""
    files = files.within(job.limits)
    if job.cell.machine:
        return add_machine(_read_cell(part, job, cell, files), job, files)
    return _read_cell(part, job, cell, files)


def _read_cell(part: Part | None, job: Job, cell: Cell, files: Files) -> Workcell:
    in_space = part is not None and (part.solid is not None or bool(part.curves))
    taught = _frames_of(part)
    arm = _hold(_arm(job.cell.robot or (cell.robot if in_space or taught else ""), files), job)
    meshes = _meshes(part, job, files)
    if taught is None:
        return equip(cell, job, arm, meshes)
    if taught.base_from_work is not None:
        cell = replace(cell, base_from_work=taught.base_from_work)
    equipped = equip(cell, job, arm, meshes)
    if taught.flange_from_tool is None or job.cell.flange_from_tool is not None:
        return equipped
    return replace(equipped, flange_from_tool=taught.flange_from_tool)


def add_machine(cell: Workcell, job: Job, files: Files) -> Workcell:
    """`cell` with the machine of `cell.machine`.

    Raises JobError for a machine that the post or another setting contradicts.
    """
    from camgen.read.machine import read_machine  # noqa: PLC0415 (only jobs with a machine)

    try:
        machine = read_machine(files.read(job.cell.machine))
    except InputError as error:
        raise InputError(
            job.cell.machine, error.what, error.where or "cell.machine", error.remedy
        ) from error
    if machine.corner != cell.pace.corner:
        what = f"{machine.file} is for {machine.controller}, the post for another controller"
        remedy = f"build with --post {machine.post}, or leave it out"
        raise JobError("job", what, "cell.machine", remedy)
    if cell.arm is not None:
        what = "cell.robot and cell.machine both describe the machine"
        raise JobError("job", what, "cell.machine", "leave one of them out")
    if job.process.acceleration:
        what = f"{machine.file} states the acceleration of each axis"
        remedy = "leave it out, or cell.machine"
        raise JobError("job", what, "process.acceleration", remedy)
    return replace(cell, machine=machine, pace=machine.drive(cell.pace))


def _frames_of(part: Part | None) -> Frames | None:
    """What a robot program says of its frames; None for everything else."""
    if not (isinstance(part, Recorded) and part.run.whole):
        return None
    from camgen.lang.taught import Taught  # noqa: PLC0415 (only for what needs it)

    return part.frames if isinstance(part, Taught) else None


def read_parts(sources: Sequence[Path | Part], job: Job, files: Files) -> Part:
    """The part in one or several inputs. Programs in one language are one program."""
    paths = [one for one in sources if isinstance(one, Path)]
    if len(paths) == len(sources) and (len(paths) > 1 or job.operation.taught_on):
        language = _find_language(paths, job, files)
        if language == "gcode":
            from camgen.lang.gcode import read_files as read_gcode  # noqa: PLC0415 (only for what needs it)

            return read_gcode([files.within(job.limits).read(path) for path in paths], job)
        if language:
            from camgen.lang.taught import read_files  # noqa: PLC0415 (only for what needs it)
            from camgen.plan.taught import find_flange  # noqa: PLC0415 (only for what needs it)

            flange = find_flange(job.operation.taught_on) if job.operation.taught_on else None
            return read_files(
                [files.within(job.limits).read(path) for path in paths], job, language, flange
            )
    # Several drawings in one work frame are moved together.
    kept = replace(job, input=replace(job.input, origin=""))
    parts = [
        source if isinstance(source, Part) else _read(source, kept, files) for source in sources
    ]
    return move_part(set_clamps_aside(join_parts(parts), job), job)


def _find_language(paths: Sequence[Path], job: Job, files: Files) -> str:
    """The language of a controller that all files are in, "" where they are not."""
    try:
        readers = [find_reader(files.within(job.limits).read(path)) for path in paths]
    except InputError:
        return ""  # told when it is read
    names = {reader.name for reader in readers if reader.makes == "program"}
    return names.pop() if len(names) == 1 and all(r.makes == "program" for r in readers) else ""


def join_parts(parts: Sequence[Part]) -> Part:
    """Several parts in one work frame as one. Contour ids get the place of their input in front: ``2/c7``.

    Curves in space go together with each other, and with the one 3-D part that they lie on or beside.
    """
    if len(parts) == 1:
        return parts[0]
    solids = [part.solid for part in parts if part.solid is not None]
    curves = [part for part in parts if part.curves]
    if curves and len(curves) + len(solids) == len(parts) and len(solids) <= 1:
        return _join_curves(parts, solids[0] if solids else None)
    if curves:
        what = "curves in space make a program by themselves, or with one 3-D part"
        raise InputError(curves[0].source, what, remedy="build them alone")
    alone = [
        part
        for part in parts
        if part.raster is not None or part.solid is not None or isinstance(part, Recorded)
    ]
    if alone:
        what = (
            "picture"
            if alone[0].raster is not None
            else "program"
            if alone[0].solid is None
            else "3-D part"
        )
        raise InputError(
            alone[0].source, f"a {what} makes a program by itself", remedy="build it alone"
        )
    contours: list[Contour] = []
    clamps: list[Contour] = []
    outlines: list[OpenOutline] = []
    for k, part in enumerate(parts, 1):
        contours += [replace(c, id=f"{k}/{c.id}") for c in part.contours]
        clamps += [replace(c, id=f"{k}/{c.id}") for c in part.clamps]
        outlines += [_prefix_ids(outline, f"{k}/") for outline in part.open_outlines]
    return replace(
        _head(parts),
        contours=tuple(contours),
        clamps=tuple(clamps),
        open_outlines=tuple(outlines),
    )


def _prefix_ids(outline: OpenOutline, before: str) -> OpenOutline:
    """The outline with `before` in front of all its ids."""
    ids = tuple(before + name for name in outline.ids)
    inside = tuple(before + name for name in outline.inside)
    return replace(outline, ids=ids, inside=inside)


def _head(parts: Sequence[Part]) -> Part:
    """Names, units and notes of several parts."""
    notes = [
        replace(note, what=f"{part.source}: {note.what}") for part in parts for note in part.notes
    ]
    return Part(
        name=parts[0].name,
        source=" + ".join(part.source for part in parts),
        units=" + ".join(dict.fromkeys(part.units for part in parts)),
        contours=(),
        notes=tuple(notes),
    )


def _join_curves(parts: Sequence[Part], solid: Solid | None) -> Part:
    """Curves of one or several files, with what they lie on."""
    own = [part for part in parts if part.curves]
    listed = [
        (f"{k}/" if len(own) > 1 else "", c) for k, part in enumerate(parts, 1) for c in part.curves
    ]
    return replace(
        _head(parts),
        curves=tuple(replace(c, id=before + c.id) for before, c in listed),
        solid=solid,
    )


def _read(path: Path, job: Job, files: Files) -> Part:
    """A reader knows its file by name only; the user is told the path that he gave."""
    try:
        return read(path, job, files)
    except InputError as error:
        if error.file != path.name:
            raise
        raise InputError(str(path), error.what, error.where, error.remedy) from error


def _arm(name: str, files: Files) -> Robot | None:
    """The robot of this name, none without one."""
    if not name:
        return None
    from camgen.robots.catalogue import robot  # noqa: PLC0415 (only jobs with a robot load it)

    return robot(name, files)


def _hold(arm: Robot | None, job: Job) -> Robot | None:
    """``arm`` with the speeds and accelerations to which the job holds its joints. JobError for what they cannot be."""
    speeds, gains = job.cell.joint_speeds, job.cell.joint_accelerations
    if speeds is None and gains is None:
        return arm
    if arm is None:
        key = "cell.joint_speeds" if speeds is not None else "cell.joint_accelerations"
        raise JobError(
            "job", "has no effect without an arm", key, "set cell.robot, or leave it out"
        )
    held = None if speeds is None else _by_joint(arm, speeds, "cell.joint_speeds")
    if held is not None:
        held = np.minimum(held, arm.speeds)
    return replace(
        arm,
        held=None if held is None else frozen(held),
        accelerations=None
        if gains is None
        else frozen(_by_joint(arm, gains, "cell.joint_accelerations")),
    )


def _by_joint(arm: Robot, values: Sequence[float], key: str) -> FloatArray:
    """One value above 0 for each joint of ``arm``, rad or mm."""
    if len(values) != len(arm.joints) or not all(math.isfinite(v) and v > 0 for v in values):
        what = f"{arm.name} has {len(arm.joints)} joints; {counted(len(values), 'value')} given"
        raise JobError("job", what, key, "give one above 0 for each, deg or mm")
    return np.array(
        [
            v if joint.sliding else math.radians(v)
            for v, joint in zip(values, arm.joints, strict=True)
        ]
    )


def _meshes(part: Part | None, job: Job, files: Files) -> tuple[tuple[str, Solid], ...]:
    """Fixtures that are meshes or drawn, with their names, work frame."""
    if all(isinstance(given, list) for given in job.cell.fixtures or ()):
        return ()
    from camgen.read.solid import read_fixtures  # noqa: PLC0415 (only for what needs it)

    return read_fixtures(job, files, part)


def digest_of(job: Job, sources: Sequence[Path | Part], files: Files) -> str:
    """Twelve hex digits that stand for the settings and the bytes of all files that are read."""
    if not sources:
        raise InputError("input", "none is given")
    files = files.within(job.limits)
    total = hashlib.sha256(msgspec.json.encode(_own(job), order="deterministic"))
    seen: set[str] = set()
    for source in sources:
        if isinstance(source, Part):
            total.update(_bytes_of(source))
            continue
        data = files.read(source).data
        if identity(source) in seen:
            raise InputError(str(source), "is given twice", remedy="name every input once")
        seen.add(identity(source))
        total.update(b"%d:" % len(data))
        total.update(data)
    arm: Sequence[Path] = ()
    if described := split_name(job.cell.robot):
        from camgen.robots.urdf.xml import list_urdf_files  # noqa: PLC0415 (only arms from a URDF need it)

        arm = list_urdf_files(described[0], files)
    named = [("image.background", job.image.background), ("camera.file", job.camera.file)]
    named.append(("image.lamp_moved", job.image.lamp_moved))
    named += [("cell.robot", str(path)) for path in arm]
    named.append(("cell.machine", job.cell.machine))
    named += [("cell.fixtures", one) for one in job.cell.fixtures or () if isinstance(one, str)]
    for setting, name in named:
        if name or setting == "cell.fixtures":
            total.update(_read_setting(setting, name, files))
    return total.hexdigest()[:12]


def _read_setting(setting: str, name: str, files: Files) -> bytes:
    """The bytes of a file that a setting names. InputError with the setting."""
    try:
        return files.read(name).data
    except InputError as error:
        where, remedy = error.where or setting, error.remedy or "give a file that exists"
        raise InputError(error.file, error.what, where, remedy) from error


def _bytes_of(part: Part) -> bytes:
    """What stands for a part that was made in code."""
    contours = (*part.contours, *part.clamps)
    columns: list[NDArray[Any]] = [column for c in contours for column in (c.points, c.bulges)]
    for curve in part.curves:
        columns += [
            curve.points,
            curve.middles,
            curve.curved,
            *([] if curve.rotations is None else [curve.rotations]),
        ]
    if part.solid is not None:
        columns += [part.solid.vertices, part.solid.faces]
    if part.raster is not None:
        columns += [part.raster.mask, *part.raster.borders]
    if isinstance(part, Recorded):
        return repr(part.run).encode()
    names = [(c.id, c.layer, c.closed) for c in contours] + [
        (c.id, c.layer, c.closed) for c in part.curves
    ]
    return msgspec.json.encode(names) + b"".join(column.tobytes() for column in columns)


def _own(job: Job) -> dict[str, object]:
    """What the job sets differently from the defaults: a new setting leaves the programs of old jobs as they are."""
    image, camera, cell = job.image, job.camera, job.cell
    # Of a file its bytes count, wherever it lies.
    photos = {key: Path(getattr(image, key)).name for key in ("background", "lamp_moved")}
    image = replace(image, **photos)
    camera = replace(camera, file=Path(camera.file).name)
    if described := split_name(cell.robot):
        cell = replace(cell, robot="#".join((Path(described[0]).name, described[1])))
    cell = replace(cell, machine=Path(cell.machine).name)
    if cell.fixtures:
        fixtures = [Path(one).name if isinstance(one, str) else one for one in cell.fixtures]
        cell = replace(cell, fixtures=fixtures)
    tables = msgspec.to_builtins(replace(job, image=image, camera=camera, cell=cell))
    defaults = msgspec.to_builtins(Job())
    own: dict[str, object] = {
        name: _changed(table, defaults[name])
        for name, table in tables.items()
        if table != defaults[name] and name not in ROWS
    }
    if job.tools and not job.operations:  # of a program that is replayed
        rows, default = msgspec.to_builtins(job.tools), msgspec.to_builtins(ToolRow())
        own["tools"] = [_changed(row, default) for row in rows]
    if job.operations:  # each has all that it needs of [[tools]]
        usual = {
            "tool": ToolTable(),
            "operation": OperationTable(),
            "process": ProcessTable(),
            "choice": Choice(),
        }
        own["operations"] = {
            str(place): {
                name: _changed(row[name], msgspec.to_builtins(table))
                for name, table in usual.items()
            }
            for place, row in enumerate(tables["operations"])
        }
    return own


def _changed(table: dict[str, object], default: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in table.items() if value != default.get(key)}


def note_work_frame(job: Job, cell: Workcell) -> tuple[Note, ...]:
    """The work zero of a machine whose travel is checked, if the job does not state it."""
    if cell.arm is None or isinstance(cell.home, Joints) or job.cell.base_from_work is not None:
        return ()
    position = " ".join(short(value, 3) for value in cell.base_from_work.origin)
    what = f"the work zero is at {position} mm of {cell.arm.name}"
    return (Note("assumed", what, "set cell.base_from_work to the work offset of the machine"),)


def note_machine(cell: Workcell, job: Job) -> tuple[Note, ...]:
    """The acceleration of a mill that neither a machine nor the job states."""
    if cell.machine is not None:
        return cell.machine.notes
    hint = _MILLS.get(cell.pace.corner)
    if hint is None or job.process.acceleration:
        return ()
    what = f"the time is that of a machine with {cell.pace.acceleration:g} mm/s2"
    return (Note("assumed", what, f"cell.machine names yours{hint}"),)


def note_urdf(name: str, arm: Robot | None) -> tuple[Note, ...]:
    """What was assumed of an arm that a URDF describes; the built-in ones are described to the end."""
    described = split_name(name)
    if not (described and arm):
        return ()
    file = Path(described[0]).name
    why = "their zeros and signs need not be the controller's: compare one pose with the teach pendant"
    notes = [Note("assumed", f"{file}: {note}") for note in arm.notes]
    return (
        *notes,
        Note("warning", f"{file}: home and posture are in the joint values of the URDF", why),
    )
