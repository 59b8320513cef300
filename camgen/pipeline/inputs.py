"""Reads the inputs of a build: the part, the cell with its arm and fixtures, and their digest."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

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
from camgen.model.part import Contour, Curve, Note, OpenOutline, Part, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.program import Joints
from camgen.model.text import counted, short_each
from camgen.read import find_reader, read
from camgen.read.clamps import set_clamps_aside
from camgen.read.files import Files, identity
from camgen.read.move import move_part
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell, equip_cell

#: Hints on the assumed acceleration of mills, for each kind of corner.
_MILLS = {"arc": "", "junction": "; GRBL's own default of 10 mm/s2 takes far longer"}


class Inputs(Struct, frozen=True, eq=False):
    """The inputs of a build. No file is opened after they are read.

    digest: digest of the bytes of all files and of the settings.
    part: the part.
    cell: the cell with its arm and fixtures.
    """

    digest: str
    part: Part
    cell: Workcell


def read_inputs(sources: Sequence[Path | Part], job: Job, cell: Cell, files: Files) -> Inputs:
    """Read all that `job` needs.

    cell: cell of the post. Its robot is used for 3-D parts if the job names none.
    """
    digest = compute_digest(job, sources, files)
    part = read_parts(sources, job, files)
    return Inputs(digest, part, read_cell(part, job, cell, files))


def read_cell(part: Part | None, job: Job, cell: Cell, files: Files) -> Workcell:
    """The cell of `job` with the arm with which `part` is checked.

    cell: cell of the post, whose values hold where the job has none.
    """
    files = files.within(job.limits)
    workcell = _read_cell(part, job, cell, files)
    return add_machine(workcell, job, files) if job.cell.machine else workcell


def _read_cell(part: Part | None, job: Job, cell: Cell, files: Files) -> Workcell:
    in_space = part is not None and (part.solid is not None or bool(part.curves))
    taught = _find_frames(part)
    arm = _limit_joints(
        _find_robot(job.cell.robot or (cell.robot if in_space or taught else ""), files), job
    )
    meshes = _read_meshes(part, job, files)
    if taught is None:
        return equip_cell(cell, job, arm, meshes)
    if taught.base_from_work is not None:
        cell = replace(cell, base_from_work=taught.base_from_work)
    equipped = equip_cell(cell, job, arm, meshes)
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
        raise JobError(
            "job",
            f"{machine.file} is for {machine.controller}, the post for another controller",
            "cell.machine",
            f"build with --post {machine.post}, or leave it out",
        )
    if cell.arm is not None:
        raise JobError(
            "job",
            "cell.robot and cell.machine both describe the machine",
            "cell.machine",
            "leave one of them out",
        )
    if job.process.acceleration:
        raise JobError(
            "job",
            f"{machine.file} states the acceleration of each axis",
            "process.acceleration",
            "leave it out, or cell.machine",
        )
    return replace(cell, machine=machine, pace=machine.drive(cell.pace))


def _find_frames(part: Part | None) -> Frames | None:
    """The frames that a robot program states; None for any other part."""
    if not (isinstance(part, Recorded) and part.run.whole):
        return None
    from camgen.lang.taught import TaughtProgram  # noqa: PLC0415 (only for robot programs)

    return part.frames if isinstance(part, TaughtProgram) else None


def read_parts(sources: Sequence[Path | Part], job: Job, files: Files) -> Part:
    """The part in one or several inputs. Programs in one language are one program."""
    paths = [source for source in sources if isinstance(source, Path)]
    if len(paths) == len(sources) and (len(paths) > 1 or job.operation.taught_on):
        limited = files.within(job.limits)
        language = _find_language(paths, limited)
        if language == "gcode":
            from camgen.lang.gcode import read_files as read_gcode  # noqa: PLC0415 (only G-code)

            return read_gcode(list(map(limited.read, paths)), job)
        if language:
            from camgen.lang.taught import read_files  # noqa: PLC0415 (only for robot programs)
            from camgen.plan.taught import find_flange  # noqa: PLC0415 (only for robot programs)

            flange = find_flange(job.operation.taught_on) if job.operation.taught_on else None
            return read_files(list(map(limited.read, paths)), job, language, flange)
    # Several drawings in one work frame are moved together, after all are read.
    unmoved = replace(job, input=replace(job.input, origin=""))
    parts = [
        source if isinstance(source, Part) else _read(source, unmoved, files) for source in sources
    ]
    return move_part(set_clamps_aside(join_parts(parts), job), job)


def _find_language(paths: Sequence[Path], files: Files) -> str:
    """The controller language in which all files are written, "" without one."""
    names = set()
    try:
        for path in paths:
            reader = find_reader(files.read(path))
            names.add(reader.name if reader.makes == "program" else "")
    except InputError:
        return ""  # the reader raises it again, with the path
    return names.pop() if len(names) == 1 else ""


def join_parts(parts: Sequence[Part]) -> Part:
    """Join several parts in one work frame.

    The ids of contours get the number of their input in front: `2/c7`. Curves in space join with
    each other, and with at most one 3-D part.
    """
    if len(parts) == 1:
        return parts[0]
    solids = [part.solid for part in parts if part.solid is not None]
    curves = [part for part in parts if part.curves]
    if curves and len(curves) + len(solids) == len(parts) and len(solids) <= 1:
        return _join_curves(parts, solids[0] if solids else None)
    if curves:
        raise InputError(
            curves[0].source,
            "curves in space make a program by themselves, or with one 3-D part",
            remedy="build them alone",
        )
    for part in parts:
        kinds = {
            "picture": part.raster is not None,
            "3-D part": part.solid is not None,
            "program": isinstance(part, Recorded),
        }
        for kind, applies in kinds.items():
            if applies:
                raise InputError(
                    part.source, f"a {kind} makes a program by itself", remedy="build it alone"
                )
    contours: list[Contour] = []
    clamps: list[Contour] = []
    outlines: list[OpenOutline] = []
    for k, part in enumerate(parts, 1):
        contours += _prefix_each(part.contours, f"{k}/")
        clamps += _prefix_each(part.clamps, f"{k}/")
        outlines += [_prefix_ids(outline, f"{k}/") for outline in part.open_outlines]
    return replace(
        _join_heads(parts),
        contours=tuple(contours),
        clamps=tuple(clamps),
        open_outlines=tuple(outlines),
    )


_Line = TypeVar("_Line", Contour, Curve)


def _prefix_each(lines: Sequence[_Line], prefix: str) -> list[_Line]:
    return [replace(line, id=prefix + line.id) for line in lines]


def _prefix_ids(outline: OpenOutline, prefix: str) -> OpenOutline:
    """The outline with `prefix` in front of all its ids."""
    ids = tuple(prefix + name for name in outline.ids)
    inside = tuple(prefix + name for name in outline.inside)
    return replace(outline, ids=ids, inside=inside)


def _join_heads(parts: Sequence[Part]) -> Part:
    """A part without contours, with the names, units and notes of several parts."""
    notes: list[Note] = []
    for part in parts:
        notes += [replace(note, what=f"{part.source}: {note.what}") for note in part.notes]
    return Part(
        name=parts[0].name,
        source=" + ".join(part.source for part in parts),
        units=" + ".join(dict.fromkeys(part.units for part in parts)),
        contours=(),
        notes=tuple(notes),
    )


def _join_curves(parts: Sequence[Part], solid: Solid | None) -> Part:
    """The curves of one or several files, with the 3-D part `solid`."""
    several = sum(bool(part.curves) for part in parts) > 1
    curves: list[Curve] = []
    for k, part in enumerate(parts, 1):
        curves += _prefix_each(part.curves, f"{k}/" if several else "")
    return replace(_join_heads(parts), curves=tuple(curves), solid=solid)


def _read(path: Path, job: Job, files: Files) -> Part:
    """Read a part. An error has the path that the user gave; a reader knows the name alone."""
    try:
        return read(path, job, files)
    except InputError as error:
        if error.file != path.name:
            raise
        raise InputError(str(path), error.what, error.where, error.remedy) from error


def _find_robot(name: str, files: Files) -> Robot | None:
    if not name:
        return None
    from camgen.robots.catalogue import find_robot  # noqa: PLC0415 (only jobs with a robot load it)

    return find_robot(name, files)


def _limit_joints(arm: Robot | None, job: Job) -> Robot | None:
    """`arm` with the joint speeds and accelerations of the job.

    Raises JobError for invalid values, and for values without an arm.
    """
    speeds = _convert_joint_values(arm, job.cell.joint_speeds, "cell.joint_speeds")
    gains = _convert_joint_values(arm, job.cell.joint_accelerations, "cell.joint_accelerations")
    if arm is None or (speeds is None and gains is None):
        return arm
    if speeds is not None:
        speeds = frozen(np.minimum(speeds, arm.speeds))
    return replace(arm, held=speeds, accelerations=gains)


def _convert_joint_values(
    arm: Robot | None, values: Sequence[float] | None, key: str
) -> FloatArray | None:
    """The values of the setting `key`, one above 0 for each joint of `arm`, in rad or mm."""
    if values is None:
        return None
    if arm is None:
        raise JobError(
            "job", "has no effect without an arm", key, "set cell.robot, or leave it out"
        )
    if len(values) != len(arm.joints) or not all(math.isfinite(v) and v > 0 for v in values):
        raise JobError(
            "job",
            f"{arm.name} has {len(arm.joints)} joints; {counted(len(values), 'value')} given",
            key,
            "give one value above 0 for each joint, deg or mm",
        )
    factors = [1.0 if joint.sliding else math.pi / 180 for joint in arm.joints]
    return frozen(np.array(values) * factors)


def _read_meshes(part: Part | None, job: Job, files: Files) -> tuple[tuple[str, Solid], ...]:
    """Fixtures that are meshes or drawn, with their names, in the work frame."""
    if all(isinstance(fixture, list) for fixture in job.cell.fixtures or ()):
        return ()
    from camgen.read.solid import read_fixtures  # noqa: PLC0415 (only for mesh fixtures)

    return read_fixtures(job, files, part)


def compute_digest(job: Job, sources: Sequence[Path | Part], files: Files) -> str:
    """The digest of the settings and of the bytes of all files that are read, twelve hex digits."""
    if not sources:
        raise InputError("input", "none is given")
    files = files.within(job.limits)
    total = hashlib.sha256(msgspec.json.encode(_list_changes(job), order="deterministic"))
    seen: set[str] = set()
    for source in sources:
        if isinstance(source, Part):
            total.update(_encode_part(source))
            continue
        data = files.read(source).data
        if identity(source) in seen:
            raise InputError(str(source), "is given twice", remedy="name every input once")
        seen.add(identity(source))
        total.update(b"%d:" % len(data))
        total.update(data)
    named = [("image.background", job.image.background), ("camera.file", job.camera.file)]
    named.append(("image.lamp_moved", job.image.lamp_moved))
    if described := split_name(job.cell.robot):
        from camgen.robots.urdf.xml import list_urdf_files  # noqa: PLC0415 (only for a URDF)

        for path in list_urdf_files(described[0], files):
            named.append(("cell.robot", str(path)))
    named.append(("cell.machine", job.cell.machine))
    fixtures = job.cell.fixtures or ()
    named += [("cell.fixtures", fixture) for fixture in fixtures if isinstance(fixture, str)]
    for setting, name in named:
        if name or setting == "cell.fixtures":
            total.update(_read_setting(setting, name, files))
    return total.hexdigest()[:12]


def _read_setting(setting: str, name: str, files: Files) -> bytes:
    """The bytes of a file that a setting names. Raises InputError with the setting."""
    try:
        return files.read(name).data
    except InputError as error:
        where, remedy = error.where or setting, error.remedy or "give a file that exists"
        raise InputError(error.file, error.what, where, remedy) from error


def _encode_part(part: Part) -> bytes:
    """The bytes that identify a part that was made in code."""
    if isinstance(part, Recorded):
        return repr(part.run).encode()
    contours = (*part.contours, *part.clamps)
    columns: list[NDArray[Any]] = []
    for contour in contours:
        columns += [contour.points, contour.bulges]
    for curve in part.curves:
        columns += [curve.points, curve.middles, curve.curved]
        if curve.rotations is not None:
            columns.append(curve.rotations)
    if part.solid is not None:
        columns += [part.solid.vertices, part.solid.faces]
    if part.raster is not None:
        columns += [part.raster.mask, *part.raster.borders]
    chains: list[Contour | Curve] = [*contours, *part.curves]
    names = [(chain.id, chain.layer, chain.closed) for chain in chains]
    return msgspec.json.encode(names) + b"".join(column.tobytes() for column in columns)


def _list_changes(job: Job) -> dict[str, object]:
    """The settings of the job that differ from the defaults.

    Settings with their default are left out, so that a new setting does not change the digest of
    old jobs. A file has its name alone, wherever it lies; its bytes are in the digest.
    """
    image, camera, cell = job.image, job.camera, job.cell
    background, lamp_moved = Path(image.background).name, Path(image.lamp_moved).name
    image = replace(image, background=background, lamp_moved=lamp_moved)
    camera = replace(camera, file=Path(camera.file).name)
    if described := split_name(cell.robot):
        cell = replace(cell, robot="#".join((Path(described[0]).name, described[1])))
    cell = replace(cell, machine=Path(cell.machine).name)
    if cell.fixtures:
        fixtures = [Path(row).name if isinstance(row, str) else row for row in cell.fixtures]
        cell = replace(cell, fixtures=fixtures)
    tables = msgspec.to_builtins(replace(job, image=image, camera=camera, cell=cell))
    defaults = msgspec.to_builtins(Job())
    changes: dict[str, object] = {}
    for name, table in tables.items():
        if table != defaults[name] and name not in ROWS:
            changes[name] = _select_changed(table, defaults[name])
    if job.tools and not job.operations:  # a replay, whose tools are not in its operations
        rows, default = msgspec.to_builtins(job.tools), msgspec.to_builtins(ToolRow())
        changes["tools"] = [_select_changed(row, default) for row in rows]
    if job.operations:  # an operation has all settings of its row of [[tools]]
        step_defaults = {
            "tool": msgspec.to_builtins(ToolTable()),
            "operation": msgspec.to_builtins(OperationTable()),
            "process": msgspec.to_builtins(ProcessTable()),
            "choice": msgspec.to_builtins(Choice()),
        }
        steps: dict[str, object] = {}
        for number, row in enumerate(tables["operations"]):
            steps[str(number)] = {
                name: _select_changed(row[name], default) for name, default in step_defaults.items()
            }
        changes["operations"] = steps
    return changes


def _select_changed(table: dict[str, object], default: dict[str, object]) -> dict[str, object]:
    return {key: value for key, value in table.items() if value != default.get(key)}


def note_work_frame(job: Job, cell: Workcell) -> tuple[Note, ...]:
    """The work zero of a machine whose travel is checked, if the job does not state it."""
    if cell.arm is None or isinstance(cell.home, Joints) or job.cell.base_from_work is not None:
        return ()
    position = " ".join(short_each(cell.base_from_work.origin, 3))
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
    """Notes on values that a URDF does not state. Built-in arms have no such values."""
    described = split_name(name)
    if not (described and arm):
        return ()
    file = Path(described[0]).name
    notes = [Note("assumed", f"{file}: {note}") for note in arm.notes]
    what = f"{file}: home and posture are in the joint values of the URDF"
    why = (
        "the zeros and signs of the controller may differ: compare one pose with the teach pendant"
    )
    return (*notes, Note("warning", what, why))
