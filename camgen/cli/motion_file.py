"""The plan file of ``--plan``: the planned motion as JSON, for scripts and for ``camgen verify``.

Numbers are written so that they read back to the last bit. Rotations are matrices, since a quaternion or an Euler
triple would be rounded on the way; most programs have few, so they stand in a list of their own and are named by their
place in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Struct, field

from camgen.check.report import clean
from camgen.model.errors import CamgenError, JobError
from camgen.model.limits import Limits
from camgen.model.pose import FloatArray, Pose, Vec3, frozen
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Posture,
    Program,
    Stop,
    ToolChange,
    Wait,
)
from camgen.read.files import Files

_MOST = Limits().number
_Number = Annotated[float, msgspec.Meta(ge=-_MOST, le=_MOST)]
_Index = Annotated[int, msgspec.Meta(ge=-1, lt=2**31)]
Row = tuple[_Number, _Number, _Number]
Matrix = tuple[Row, Row, Row]
_NO_PRESS = (0.0, 0.0, 0.0)


class _Line(
    msgspec.Struct, frozen=True, tag_field="do", omit_defaults=True, forbid_unknown_fields=True
):
    """Base of the lines of ``body``; ``do`` names the instruction."""


class _MoveJ(_Line, frozen=True, tag="movej"):
    speed: _Number
    to: Row | None = None
    rotation: _Index = -1
    joints: tuple[_Number, ...] | None = None
    blend: _Number | None = None
    posture: tuple[_Number, ...] | None = None
    called: Posture | None = None
    path: _Index = -1
    work: bool = False
    share: _Number | None = None


class _MoveL(_Line, frozen=True, tag="movel"):
    to: Row
    rotation: _Index
    speed: _Number
    blend: _Number | None = None
    force: _Number | None = None
    press: Row | None = None
    posture: tuple[_Number, ...] | None = None
    called: Posture | None = None
    path: _Index = -1
    work: bool = False
    turn: _Number | None = None


class _MoveC(_Line, frozen=True, tag="movec"):
    via: Row
    via_rotation: _Index
    to: Row
    rotation: _Index
    speed: _Number
    blend: _Number | None = None
    force: _Number | None = None
    press: Row | None = None
    posture: tuple[_Number, ...] | None = None
    called: Posture | None = None
    path: _Index = -1
    work: bool = False


class _Output(_Line, frozen=True, tag="output"):
    signal: str
    value: _Number


class _Wait(_Line, frozen=True, tag="wait"):
    seconds: _Number


class _Force(_Line, frozen=True, tag="force"):
    newtons: _Number
    press: Row | None = None


class _Frame(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    origin: Row
    rotation: _Index


class _ToolChange(_Line, frozen=True, tag="toolchange"):
    number: _Index
    name: str
    diameter: _Number
    length: _Number
    flange_from_tool: _Frame | None = None


class _Stop(_Line, frozen=True, tag="stop"):
    optional: bool = False


class _Comment(_Line, frozen=True, tag="comment"):
    text: str


_Any = _MoveJ | _MoveL | _MoveC | _Output | _Wait | _Force | _ToolChange | _Stop | _Comment


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    format: Literal["camgen-plan 1", "camgen-plan 2"]
    post: str
    options: dict[str, Any]
    chord_mm: _Number
    name: str
    base_from_work: _Frame
    flange_from_tool: _Frame
    header: tuple[str, ...]
    rotations: tuple[Matrix, ...]
    paths: tuple[Origin, ...] = ()
    body: tuple[_Any, ...]


class MotionFile(Struct, frozen=True, eq=False):
    """What a plan file holds. options: of ``[post]``. chord: mm that a replacement of an arc may deviate."""

    program: Program
    post: str
    options: dict[str, object]
    chord: float


class _Rotations(Struct, frozen=True):
    """Rotation matrices by their place, each once."""

    places: dict[bytes, int] = field(default_factory=dict)
    matrices: list[Matrix] = field(default_factory=list)

    def place(self, rotation: FloatArray) -> int:
        key = rotation.tobytes()
        if key not in self.places:
            self.places[key] = len(self.matrices)
            x, y, z = ((a, b, c) for a, b, c in rotation.tolist())
            self.matrices.append((x, y, z))
        return self.places[key]


def encode(program: Program, post: str, options: Mapping[str, object], chord: float) -> bytes:
    """The plan file of ``program``, one instruction a line. ``decode`` is its inverse."""
    known = _Rotations()
    work, tool = program.base_from_work, program.flange_from_tool
    frames = [_Frame(pose.origin, known.place(pose.rotation)) for pose in (work, tool)]
    body = [_line(item, known) for item in program.body]
    head = _File(
        format="camgen-plan 2",
        post=post,
        options=dict(options),
        chord_mm=chord,
        name=clean(program.name),
        base_from_work=frames[0],
        flange_from_tool=frames[1],
        header=tuple(clean(line) for line in program.header),
        rotations=tuple(known.matrices),
        paths=tuple(_clean(origin) for origin in program.paths),
        body=(),
    )
    encoder = msgspec.json.Encoder(order="deterministic")
    lines = [encoder.encode(line) for line in body]
    start = encoder.encode(head).removesuffix(b"[]}")
    return start + b"[\n" + b",\n".join(lines) + b"\n]}\n"


def _clean(origin: Origin) -> Origin:
    contours = tuple(clean(ident) for ident in origin.contours)
    return Origin(clean(origin.id), clean(origin.layer), contours, origin.operation)


def _line(item: Instruction, known: _Rotations) -> _Any:
    match item:
        case MoveJ():
            return _joint_line(item, known)
        case MoveL():
            place = known.place(item.target.rotation)
            return _MoveL(item.target.origin, place, item.speed, *_tail(item), item.turn or None)
        case MoveC():
            middle, place = known.place(item.via.rotation), known.place(item.target.rotation)
            return _MoveC(
                item.via.origin, middle, item.target.origin, place, item.speed, *_tail(item)
            )
        case Output():
            return _Output(item.signal, float(item.value))
        case Wait():
            return _Wait(item.seconds)
        case Force():
            return _Force(
                float(item.newtons), item.force_direction if any(item.force_direction) else None
            )
        case ToolChange():
            pose = item.flange_from_tool
            frame = None if pose is None else _Frame(pose.origin, known.place(pose.rotation))
            return _ToolChange(item.number, clean(item.name), item.diameter, item.length, frame)
        case Stop():
            return _Stop(item.optional)
        case Comment():
            return _Comment(clean(item.text))


def _joint_line(item: MoveJ, known: _Rotations) -> _MoveJ:
    posture = item.joints.values if item.joints else None
    rest = item.blend or None, posture, item.posture, item.path, item.work, item.share or None
    if isinstance(item.target, Joints):
        return _MoveJ(item.speed, None, -1, item.target.values, *rest)
    return _MoveJ(item.speed, item.target.origin, known.place(item.target.rotation), None, *rest)


_Tail = tuple[
    float | None, float | None, Vec3 | None, tuple[float, ...] | None, Posture | None, int, bool
]


def _tail(item: MoveL | MoveC) -> _Tail:
    """Blend, force, press, posture and its names, None where there is none, and the path."""
    press = item.force_direction if any(item.force_direction) else None
    joints = item.joints.values if item.joints else None
    return item.blend or None, item.force or None, press, joints, item.posture, item.path, item.work


def load(file: Path, files: Files) -> MotionFile:
    """The plan in ``file``. JobError when it cannot be read or is no plan."""
    try:
        return decode(files.open(file).data)
    except OSError as error:
        raise JobError(str(file), f"cannot be read: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError, CamgenError) as error:
        reason = error.what if isinstance(error, CamgenError) else str(error)
        raise JobError(
            str(file), f"is not a plan: {reason}", remedy="write one with camgen build --plan"
        ) from error


def decode(data: bytes) -> MotionFile:
    """The plan that ``encode`` wrote. ValueError (msgspec's included) when it is none; Refused as ``ir.Program``."""
    file = msgspec.json.decode(data, type=_File)
    rotations = [_rotation(matrix) for matrix in file.rotations]

    def pose(origin: Vec3, place: int) -> Pose:
        if not 0 <= place < len(rotations):
            raise ValueError(f"rotation {place} is not in the list")
        return Pose(rotations[place], origin)

    body = tuple(_instruction(line, pose) for line in file.body)
    work = pose(file.base_from_work.origin, file.base_from_work.rotation)
    tool = pose(file.flange_from_tool.origin, file.flange_from_tool.rotation)
    program = Program(file.name, work, tool, body, file.header, file.paths)
    return MotionFile(program, file.post, file.options, file.chord_mm)


def _rotation(matrix: Matrix) -> FloatArray:
    rotation = frozen(matrix)
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
        raise ValueError(f"{matrix} is not a rotation")
    return rotation


def _movej(line: _MoveJ, pose: Callable[[Vec3, int], Pose]) -> MoveJ:
    posture = Joints(line.posture) if line.posture else None
    owner = line.path, line.work, line.share or 0.0
    if line.joints is not None:
        return MoveJ(
            Joints(line.joints), line.speed, line.blend or 0.0, posture, line.called, *owner
        )
    if line.to is None:
        raise ValueError("a movej has neither joints nor to")
    return MoveJ(
        pose(line.to, line.rotation), line.speed, line.blend or 0.0, posture, line.called, *owner
    )


def _instruction(line: _Any, pose: Callable[[Vec3, int], Pose]) -> Instruction:
    match line:
        case _MoveJ():
            return _movej(line, pose)
        case _MoveL():
            return MoveL(pose(line.to, line.rotation), line.speed, *_end(line), line.turn or 0.0)
        case _MoveC():
            via, target = pose(line.via, line.via_rotation), pose(line.to, line.rotation)
            return MoveC(via, target, line.speed, *_end(line))
        case _Output():
            return Output(line.signal, line.value)
        case _Wait():
            return Wait(line.seconds)
        case _Force():
            return Force(line.newtons, line.press or _NO_PRESS)
        case _ToolChange():
            frame = line.flange_from_tool
            tool = None if frame is None else pose(frame.origin, frame.rotation)
            return ToolChange(line.number, line.name, line.diameter, line.length, tool)
        case _Stop():
            return Stop(line.optional)
        case _Comment():
            return Comment(line.text)


def _end(
    line: _MoveL | _MoveC,
) -> tuple[float, float, Vec3, Joints | None, Posture | None, int, bool]:
    posture = Joints(line.posture) if line.posture else None
    return (
        line.blend or 0.0,
        line.force or 0.0,
        line.press or _NO_PRESS,
        posture,
        line.called,
        line.path,
        line.work,
    )
