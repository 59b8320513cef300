"""The text form of a program: one instruction a line, words and numbers, ``camgen-ir 1`` first."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from camgen.model.pose import Pose, quaternion, rotation_from_quaternion
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    Motion,
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
from camgen.model.text import harmless, short

#: Digits of the text form: 1e-6 mm, and quaternions to 1e-9.
_DIGITS, _ANGLE_DIGITS = 6, 9


def dump(program: Program) -> str:
    """The program as text, exact to 1e-6 mm. ``parse`` is its inverse."""
    lines = ["camgen-ir 1", f"name {harmless(program.name)}"]
    lines.append("work " + _pose_text(program.base_from_work))
    lines.append("tool " + _pose_text(program.flange_from_tool))
    lines += [f"# {harmless(line, 200)}" for line in program.header]
    lines += [
        "path " + json.dumps([one.id, one.layer, one.operation, *one.contours])
        for one in program.paths
    ]
    lines.append("body")
    rotations: dict[bytes, str] = {}
    lines += [_line(item, rotations) for item in program.body]
    return "\n".join(lines) + "\n"


def _line(item: Instruction, rotations: dict[bytes, str]) -> str:
    match item:
        case MoveJ():
            return "movej " + _target_text(item.target, rotations) + _tail(item)
        case MoveL():
            return "movel " + _pose_text(item.target, rotations) + _tail(item)
        case MoveC():
            via = _pose_text(item.via, rotations)
            return f"movec {via} to {_pose_text(item.target, rotations)}" + _tail(item)
        case Output():
            return f"output {harmless(item.signal)} {short(item.value, _DIGITS)}"
        case Wait():
            return f"wait {short(item.seconds, _DIGITS)}"
        case Force():
            return f"force {short(item.newtons, _DIGITS)} press {_numbers(item.force_direction, _ANGLE_DIGITS)}"
        case ToolChange():
            frame = (
                ""
                if item.flange_from_tool is None
                else f" frame {_pose_text(item.flange_from_tool)}"
            )
            size = f"{short(item.diameter, _DIGITS)} {short(item.length, _DIGITS)}"
            return f"toolchange {item.number} {size}{frame} name {harmless(item.name)}"
        case Stop():
            return "stop optional" if item.optional else "stop"
        case Comment():
            return f"# {harmless(item.text, 200)}"


def _target_text(target: Pose | Joints, rotations: dict[bytes, str]) -> str:
    if isinstance(target, Joints):
        return "joints " + _numbers(target.values, _ANGLE_DIGITS)
    return _pose_text(target, rotations)


def _numbers(values: tuple[float, ...], digits: int) -> str:
    return " ".join(short(v, digits) for v in values)


def _pose_text(pose: Pose, rotations: dict[bytes, str] | None = None) -> str:
    cache = {} if rotations is None else rotations
    key = pose.rotation.tobytes()
    if key not in cache:
        cache[key] = _numbers(quaternion(pose.rotation), _ANGLE_DIGITS)
    return f"{_numbers(pose.origin, _DIGITS)} q {cache[key]}"


def _tail(item: Motion) -> str:
    text = f" speed {short(item.speed, _DIGITS)}"
    if item.blend:
        text += f" blend {short(item.blend, _DIGITS)}"
    if not isinstance(item, MoveJ) and (item.force or any(item.force_direction)):
        text += f" force {short(item.force, _DIGITS)} press {_numbers(item.force_direction, _ANGLE_DIGITS)}"
    if isinstance(item, MoveL) and item.turn:
        text += f" turn {short(item.turn, _ANGLE_DIGITS)}"
    if item.path >= 0:
        text += f" path {item.path}" + (" work" if item.work else "")
    if isinstance(item, MoveJ) and item.share:
        text += f" share {short(item.share, _ANGLE_DIGITS)}"
    if item.joints is not None:
        text += " at " + _numbers(item.joints.values, _ANGLE_DIGITS)
    return text if item.posture is None else text + _posture_text(item.posture)


def _posture_text(posture: Posture) -> str:
    text = "" if posture.confdata is None else " confdata " + " ".join(map(str, posture.confdata))
    text += "" if posture.figure is None else f" figure {posture.figure}"
    return text + (
        " switches " + " ".join(map(harmless, posture.switches)) if posture.switches else ""
    )


def parse(text: str) -> Program:
    """The program that ``dump`` wrote. ValueError names the line that cannot be read."""
    lines = text.splitlines()
    if not lines or lines[0] != "camgen-ir 1":
        raise ValueError("line 1: not a camgen-ir 1 text")
    head: dict[str, list[Any]] = {word: [] for word in _HEAD}
    body: list[Instruction] = []
    in_body = False
    for number, line in enumerate(lines[1:], start=2):
        word, _, rest = line.partition(" ")
        try:
            if word == "body":
                in_body = True
            elif word in _HEAD and not in_body:
                head[word].append(_HEAD[word](rest))
            elif word:
                body.append(_parse_instruction(word, rest))
        except (ValueError, IndexError, KeyError, ZeroDivisionError) as error:
            raise ValueError(f"line {number}: {line!r}: {error}") from error
    name, work, tool = (
        head[word][-1] if head[word] else _NEUTRAL[word] for word in ("name", "work", "tool")
    )
    return Program(name, work, tool, tuple(body), tuple(head["#"]), tuple(head["path"]))


def _parse_origin(rest: str) -> Origin:
    ident, layer, operation, *contours = json.loads(rest)
    return Origin(ident, layer, tuple(contours), operation)


_HERE = Pose(rotation_from_quaternion((1.0, 0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))
#: What stands for a word of the head that is not there.
_NEUTRAL: dict[str, Any] = {"name": "", "work": _HERE, "tool": _HERE}
_TAIL_WORDS = (
    "speed",
    "blend",
    "force",
    "press",
    "turn",
    "at",
    "path",
    "share",
    "confdata",
    "figure",
    "switches",
)


def _parse_pose(words: list[str]) -> Pose:
    x, y, z = (float(w) for w in words[:3])
    if words[3] != "q" or len(words) != 8:
        raise ValueError("a pose is x y z q w x y z")
    return Pose(rotation_from_quaternion([float(w) for w in words[4:8]]), (x, y, z))


#: How the words before ``body`` are read.
_HEAD: dict[str, Callable[[str], Any]] = {
    "name": str,
    "work": lambda rest: _parse_pose(rest.split()),
    "tool": lambda rest: _parse_pose(rest.split()),
    "#": str,
    "path": _parse_origin,
}


def _split(words: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """The words before the tail, and the tail by its words."""
    tail: dict[str, list[str]] = {}
    head: list[str] = []
    current: list[str] | None = None
    for word in words:
        if word in _TAIL_WORDS:
            current = tail.setdefault(word, [])
        elif current is None:
            head.append(word)
        else:
            current.append(word)
    return head, tail


def _parse_instruction(word: str, rest: str) -> Instruction:
    if word == "#":
        return Comment(rest)
    if word == "output":
        signal, value = rest.rsplit(" ", 1)
        return Output(signal, float(value))
    if word == "wait":
        return Wait(float(rest))
    if word == "stop":
        return Stop(rest == "optional")
    if word == "toolchange":
        words, _, name = rest.partition(" name ")
        number, diameter, length, *frame = words.removesuffix(" name").split()
        pose = _parse_pose(frame[1:]) if frame else None
        return ToolChange(int(number), name, float(diameter), float(length), pose)
    head, tail = _split(rest.split())
    if word == "force":
        x, y, z = map(float, tail["press"])
        return Force(float(head[0]), (x, y, z))
    speed = float(tail["speed"][0])
    blend = float(tail.get("blend", ["0"])[0])
    joints = Joints(tuple(map(float, tail["at"]))) if "at" in tail else None
    posture = _posture(tail)
    index, *work = tail.get("path", ["-1"])
    owner = int(index), bool(work)
    if word == "movej":
        target = (
            Joints(tuple(float(w) for w in head[1:])) if head[0] == "joints" else _parse_pose(head)
        )
        return MoveJ(
            target, speed, blend, joints, posture, *owner, float(tail.get("share", ["0"])[0])
        )
    force = float(tail.get("force", ["0"])[0])
    x, y, z = map(float, tail.get("press", ["0"] * 3))
    manner = (speed, blend, force, (x, y, z), joints, posture, *owner)
    if word == "movel":
        return MoveL(_parse_pose(head), *manner, turn=float(tail.get("turn", ["0"])[0]))
    if word == "movec":
        middle = head.index("to")
        return MoveC(_parse_pose(head[:middle]), _parse_pose(head[middle + 1 :]), *manner)
    raise ValueError(f"unknown instruction {word!r}")


def _posture(tail: dict[str, list[str]]) -> Posture | None:
    """What the tail says of the posture, if it does."""
    if not tail.keys() & {"confdata", "figure", "switches"}:
        return None
    confdata = None
    if "confdata" in tail:
        cf1, cf4, cf6, cfx = map(int, tail["confdata"])
        confdata = (cf1, cf4, cf6, cfx)
    figure = int(tail["figure"][0]) if "figure" in tail else None
    return Posture(confdata, figure, tuple(tail.get("switches", ())))
