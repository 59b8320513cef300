"""The plan file of `--plan`: the planned motion as JSON, for scripts and for `camgen verify`.

Numbers are written so that they read back to the last bit. Rotations are matrices, since a
quaternion or Euler angles would be rounded. Most programs have few of them, so they are in a list,
and instructions have their index in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from operator import attrgetter, or_
from pathlib import Path
from typing import Annotated, Any, Literal, cast

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


class _Frame(Struct, frozen=True, forbid_unknown_fields=True):
    origin: Row
    rotation: _Index


class _Line(Struct, frozen=True, tag_field="do", omit_defaults=True, forbid_unknown_fields=True):
    """Base of the lines of `body`; `do` names the instruction."""


#: The keys of each instruction, in order. A key with `?` may be left out.
_KEYS: Mapping[type[Struct], str] = {
    MoveJ: "speed to? rotation? joints? blend? posture? called? path? work? share? rate? turn?",
    MoveL: "to rotation speed blend? force? press? posture? called? path? work? turn?",
    MoveC: "via via_rotation to rotation speed blend? force? press? posture? called? path? work?",
    Output: "signal value",
    Wait: "seconds",
    Force: "newtons press?",
    ToolChange: "number name diameter length flange_from_tool?",
    Stop: "optional?",
    Comment: "text",
}
#: The type of the value of a key; `_Number` for all other keys.
_TYPES: Mapping[str, Any] = {
    **dict.fromkeys(("to", "via", "press"), Row),
    **dict.fromkeys(("rotation", "via_rotation", "path", "number"), _Index),
    **dict.fromkeys(("joints", "posture"), tuple[_Number, ...]),
    **dict.fromkeys(("work", "optional"), bool),
    **dict.fromkeys(("signal", "name", "text"), str),
    "called": Posture,
    "flange_from_tool": _Frame,
}
#: The value of a key that is left out; None for all other keys.
_DEFAULTS: Mapping[str, Any] = {"rotation": -1, "path": -1, "work": False, "optional": False}


def _define_line(kind: type[Struct], keys: str) -> type[_Line]:
    """The type of the lines of an instruction."""
    fields: list[Any] = []
    for word in keys.split():
        key = word.removesuffix("?")
        of_value = _TYPES.get(key, _Number)
        if key == word:
            fields.append((key, of_value))
        elif key in _DEFAULTS:
            fields.append((key, of_value, _DEFAULTS[key]))
        else:
            fields.append((key, of_value | None, None))
    tag = kind.__name__.lower()
    line = msgspec.defstruct(f"_{kind.__name__}", fields, bases=(_Line,), tag=tag, frozen=True)
    return cast("type[_Line]", line)


_LINES = {kind: _define_line(kind, keys) for kind, keys in _KEYS.items()}
_AnyLine: Any = reduce(or_, _LINES.values())


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
    body: tuple[_AnyLine, ...]


class MotionFile(Struct, frozen=True, eq=False):
    """The content of a plan file.

    program: the program.
    post: name of the controller.
    options: options of `[post]`.
    chord: maximum deviation of a replaced arc, mm.
    """

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
            self.matrices.append(rotation.tolist())
        return self.places[key]


def encode(program: Program, post: str, options: Mapping[str, object], chord: float) -> bytes:
    """The plan file of ``program``, one instruction a line. ``decode`` is its inverse."""
    known = _Rotations()
    encoder = msgspec.json.Encoder(order="deterministic")
    work = _frame(program.base_from_work, known)
    tool = _frame(program.flange_from_tool, known)
    lines = [encoder.encode(_line(item, known)) for item in program.body]
    head = _File(
        format="camgen-plan 2",
        post=post,
        options=dict(options),
        chord_mm=chord,
        name=clean(program.name),
        base_from_work=work,
        flange_from_tool=tool,
        header=tuple(map(clean, program.header)),
        rotations=tuple(known.matrices),
        paths=tuple(map(_clean, program.paths)),
        body=(),
    )
    return encoder.encode(head).removesuffix(b"]}") + b"\n" + b",\n".join(lines) + b"\n]}\n"


def _clean(origin: Origin) -> Origin:
    contours = tuple(map(clean, origin.contours))
    return Origin(clean(origin.id), clean(origin.layer), contours, origin.operation)


def _frame(pose: Pose, known: _Rotations) -> _Frame:
    return _Frame(pose.origin, known.place(pose.rotation))


_Write = Callable[[Any, _Rotations], Any]
#: How the value of a key is made of an instruction, if the instruction has no such field.
_WRITE: Mapping[str, _Write] = {
    "to": lambda item, _: None if isinstance(item.target, Joints) else item.target.origin,
    "rotation": lambda item, known: (
        -1 if isinstance(item.target, Joints) else known.place(item.target.rotation)
    ),
    "joints": lambda item, _: item.target.values if isinstance(item.target, Joints) else None,
    "via": lambda item, _: item.via.origin,
    "via_rotation": lambda item, known: known.place(item.via.rotation),
    "press": lambda item, _: item.force_direction if any(item.force_direction) else None,
    "posture": lambda item, _: item.joints.values if item.joints else None,
    "called": lambda item, _: item.posture,
    "flange_from_tool": lambda item, known: (
        item.flange_from_tool and _frame(item.flange_from_tool, known)
    ),
    "value": lambda item, _: float(item.value),
    "newtons": lambda item, _: float(item.newtons),
    "name": lambda item, _: clean(item.name),
    "text": lambda item, _: clean(item.text),
}


def _find_writer(word: str) -> _Write:
    """How the value of a key is made. word: the key as in `_KEYS`."""
    key = word.removesuffix("?")
    if key in _WRITE:
        return _WRITE[key]
    read = attrgetter(key)
    if key == word or key in _DEFAULTS:
        return lambda item, _: read(item)
    return lambda item, _: read(item) or None


#: How the values of the keys of each instruction are made.
_WRITERS = {kind: list(map(_find_writer, keys.split())) for kind, keys in _KEYS.items()}


def _line(item: Instruction, known: _Rotations) -> _Line:
    kind = type(item)
    return _LINES[kind](*[write(item, known) for write in _WRITERS[kind]])


def load(file: Path, files: Files) -> MotionFile:
    """The plan in `file`. Raises JobError if it cannot be read or is not a plan."""
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
    """The plan that `encode` wrote.

    Raises ValueError, also by msgspec, if the bytes are no such plan, and Refused as `Program`.
    """
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


_FindPose = Callable[[Vec3, int], Pose]
_Read = Callable[[Any, _FindPose], Any]


def _read_target(line: Any, pose: _FindPose) -> Pose | Joints:
    if hasattr(line, "joints"):
        if line.joints is not None:
            return Joints(line.joints)
        if line.to is None:
            raise ValueError("a movej has neither joints nor to")
    return pose(line.to, line.rotation)


#: How a field of an instruction is made of a line, if it is not the value of a key of its name.
_READ: Mapping[str, _Read] = {
    "target": _read_target,
    "via": lambda line, pose: pose(line.via, line.via_rotation),
    "force_direction": lambda line, _: line.press or _NO_PRESS,
    "joints": lambda line, _: Joints(line.posture) if line.posture else None,
    "posture": lambda line, _: line.called,
    "flange_from_tool": lambda line, pose: (
        line.flange_from_tool and pose(line.flange_from_tool.origin, line.flange_from_tool.rotation)
    ),
}


def _find_reader(name: str) -> _Read:
    """How the field `name` of an instruction is made of a line."""
    read = attrgetter(name)
    if name in ("blend", "force", "turn", "share", "rate"):
        return lambda line, _: read(line) or 0.0
    return _READ.get(name, lambda line, _: read(line))


#: The instruction of each line, and how its fields are made of the line.
_READERS = {
    line: (kind, list(map(_find_reader, kind.__struct_fields__))) for kind, line in _LINES.items()
}


def _instruction(line: _Line, pose: _FindPose) -> Instruction:
    kind, readers = _READERS[type(line)]
    return cast("Instruction", kind(*[read(line, pose) for read in readers]))
