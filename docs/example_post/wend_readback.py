"""Reads a WEND program back, from the language's manual alone: nothing here is taken from the post."""

import math
import re
from collections.abc import Mapping

from camgen.model.pose import Pose, pose_from_values
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL, Output, Wait
from camgen.post import Fault, Reading

_NUMBER = r"(-?\d+(?:\.\d+)?)"
_PLACE = " ".join([_NUMBER] * 6)
_MANNER = rf" AT {_NUMBER} NEAR {_NUMBER}"
_STATEMENTS = {
    word: re.compile(f"{word} {rest}")
    for word, rest in {
        "PROGRAM": r"[A-Za-z0-9_]{1,16}",
        "WORK": _PLACE,
        "TOOL": _PLACE,
        "JOINT": f"{_PLACE} AT {_NUMBER}",
        "GOTO": _PLACE + _MANNER,
        "LINE": _PLACE + _MANNER,
        "ARC": f"{_PLACE} TO {_PLACE}{_MANNER}",
        "OUT": r"(\d+) ([01])",
        "PAUSE": _NUMBER,
    }.items()
}


def read(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    """What the files say. options: as in ``[post]``, for the names of the outputs."""
    given = options.get("signals", {"process": 1})
    names = {number: name for name, number in given.items()} if isinstance(given, dict) else {}
    body: list[Instruction] = []
    lines: list[int] = []
    faults: list[Fault] = []
    frames: dict[str, Pose] = {}
    text = [line for content in files.values() for line in content.splitlines()]
    for number, line in enumerate(text, start=1):
        if line.startswith("*") or line == "END":
            continue
        word = line.partition(" ")[0]
        match = _STATEMENTS[word].fullmatch(line) if word in _STATEMENTS else None
        if match is None:
            faults.append(Fault(number, f"not a WEND statement: {line}"))
            continue
        values = [float(value) for value in match.groups()]
        if word in ("WORK", "TOOL"):
            if word in frames or body:
                faults.append(Fault(number, f"{word} must stand once, before the first motion"))
            frames[word] = pose_from_values(values)
        elif word == "OUT" and values[0] not in names:
            faults.append(Fault(number, f"no signal has the output {values[0]:g}"))
        elif word != "PROGRAM":
            body.append(_instruction(word, values, names))
            lines.append(number)
    if not text or not text[0].startswith("PROGRAM") or text.count("END") != 1 or text[-1] != "END":
        faults.append(Fault(len(text), "a program runs from PROGRAM to END"))
    return Reading(tuple(body), tuple(lines), tuple(faults), frames.get("WORK"), frames.get("TOOL"))


def _instruction(word: str, values: list[float], names: Mapping[int, str]) -> Instruction:
    if word == "OUT":
        return Output(names[int(values[0])], values[1])
    if word == "PAUSE":
        return Wait(values[0])
    if word == "JOINT":
        return MoveJ(Joints(tuple(math.radians(value) for value in values[:6])), values[6])
    *_, speed, blend = values
    first = pose_from_values(values[:6])
    if word == "GOTO":
        return MoveJ(first, speed, blend)
    if word == "LINE":
        return MoveL(first, speed, blend)
    return MoveC(first, pose_from_values(values[6:12]), speed, blend)
