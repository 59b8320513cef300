"""Reads robot programs as an input: the motions of one run, in one work frame and with one tool.

The structure of a program (routines, loops, conditions) is not kept. Motions with other tools and
in other work objects are transformed to one tool and one work object. The arm moves as before.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle, turn_about
from camgen.lang.programs import (
    Executed,
    Frames,
    Places,
    RunRequest,
    find_language,
    find_text_fault,
    rename_outputs,
)
from camgen.lang.recorded import ProgramRun, Recorded, format_box
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.pose import (
    IDENTITY,
    Pose,
    Vec3,
    angle_between,
    rotation_between,
    to_vec3,
)
from camgen.model.program import (
    Columns,
    Force,
    Instruction,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.text import counted

#: base_from_flange of an arm from joint values, rad or mm. None for a wrong number of them.
Reach = Callable[[Sequence[float]], Pose | None]
#: mm and rad. Frames are equal if they differ by less.
_SAME = 1e-6
#: Names for messages if a text has no tool or no work object.
_NO_TOOL, _NO_WORK = "no tool", "the base of the robot"
#: mm. Distance that the TCP may leave a line on which another tool turns, without one in a job.
_CHORD = 0.01
#: rad. Maximum rotation of the tool along one piece of a motion.
_MAX_ROTATION = math.radians(5.0)


class TaughtProgram(Recorded, frozen=True, eq=False, kw_only=True):
    """A robot program as a part.

    language: name of the language.
    frames: work object and tool of the motions in `run`, None for those that the text does not
        state.
    """

    language: str
    frames: Frames


def read(source: Source, job: Job, language: str) -> TaughtProgram:
    """Reads the program in ``source``.

    Raises InputError if the program cannot be run to its end, is refused by its controller, has an
    effect that would be lost, or has no motion.
    """
    return read_files([source], job, language)


def read_files(
    sources: Sequence[Source], job: Job, language: str, flange: Reach | None = None
) -> TaughtProgram:
    """Reads a program in several files as `read` does. The part has the name of the first file.

    flange: base_from_flange of the arm from joint values, see ``RunRequest``.
    """
    name = " + ".join(source.name for source in sources)
    texts = {source.name: text_of(source) for source in sources}
    place = Places(texts) if len(sources) > 1 else "line {}".format
    assumed = {key.lower(): value for key, value in job.input.assume.items()}
    request = RunRequest(assume=assumed, limits=sources[0].limits, flange=flange)
    executed = find_language(language).run(texts, request)
    refused = [
        (finding.line, finding.what) for finding in executed.findings if finding.level == "refused"
    ]
    if executed.stopped:
        refused.insert(0, executed.stopped)
    if refused:
        line, what = refused[0]
        raise InputError(
            name, what, place(line), "camgen verify lists all of it; correct the program"
        )
    if not _has_motion(executed):
        raise InputError(
            name, "holds no motion", remedy="give a program that moves, with all its files"
        )
    if executed.lost:
        line, what = executed.lost[0]
        remedy = "give all files of the program, or take it out of it"
        raise InputError(
            name, what, place(line), f"{remedy}; camgen verify lists all that is missing"
        )
    single = in_one_frame(executed, name, job.tolerance.chord)
    body = rename_outputs(single.body, job.input.signals, name)
    run = ProgramRun(body, single.lines, (), 0, 0.0, None, ended=True, units="mm", whole=True)
    return TaughtProgram(
        name=sources[0].stem,
        source=name,
        units="mm",
        contours=(),
        notes=(*_note_executed(executed, place), *single.notes),
        run=run,
        language=language,
        frames=single.frames,
    )


def _has_motion(executed: Executed) -> bool:
    return any(isinstance(item, MoveJ | MoveL | MoveC) for item in executed.body)


def _note_executed(executed: Executed, place: Callable[[int], str]) -> Iterator[Note]:
    for line, what in executed.omitted:
        yield Note("skipped", f"{place(line)}: {what}", "the translation does without it")
    for finding in executed.findings:
        yield Note("warning", f"{place(finding.line)}: {finding.what}")
    for assumption in executed.assumed:
        yield Note("assumed", f"{place(assumption.line)}: {assumption.what}")
    for label, text in executed.facts:
        yield Note("assumed", f"{label}: {text}")


class TaughtFacts(Struct, frozen=True):
    """Summary of a robot program. Its ``str`` is a page to print.

    lines: number of lines of the text.
    language: name of the language.
    counts: number of instructions by kind.
    extents: corners of the box around all targets and via points, mm. None without a pose.
    frames: names of the tool and the work object of each pair of frames.
    outputs: names of the outputs.
    facts: label and text of each fact.
    assumed, findings: assumptions and findings, each with its line.
    stopped: line and reason of an early end, empty without one.
    """

    lines: int
    language: str
    counts: dict[str, int]
    extents: tuple[Vec3, Vec3] | None
    frames: tuple[tuple[str, str], ...]
    outputs: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    findings: tuple[str, ...]
    stopped: str

    def __str__(self) -> str:
        counts = [counted(count, name) for name, count in self.counts.items() if count]
        tools = dict.fromkeys(tool for tool, _ in self.frames if tool)
        works = dict.fromkeys(work for _, work in self.frames if work)
        rows = [
            ("does", ", ".join(counts) or "nothing"),
            ("extents", format_box(*self.extents) if self.extents else ""),
            ("tools", ", ".join(tools)),
            ("work objects", ", ".join(works)),
            ("outputs", ", ".join(self.outputs)),
        ]
        listed = [row for row in rows if row[1]]
        listed += [*self.facts, *(("assumed", text) for text in self.assumed)]
        page = [f"{self.language} of {counted(self.lines, 'line')}"]
        page += [f"{label}: {text}" for label, text in listed]
        page += self.findings
        if self.stopped:
            page.append(f"the run stops here: {self.stopped}")
        return "\n".join(page)


_NAMES: dict[type[Instruction], str] = {
    MoveJ: "joint motion",
    MoveL: "line",
    MoveC: "arc",
    Output: "output",
    Wait: "wait",
    Force: "force change",
    ToolChange: "tool change",
    Stop: "stop",
}


def inspect(source: Source, language: str) -> TaughtFacts:
    """Summarises a program, even one that cannot be run to its end.

    Raises InputError if the file is not a text.
    """
    text = text_of(source)
    executed = find_language(language).run({source.name: text}, RunRequest(limits=source.limits))
    columns = Columns(executed.body)
    points = np.concatenate([columns.ends, columns.vias])
    points = points[~np.isnan(points).any(axis=1)]
    return TaughtFacts(
        lines=text.count("\n") + (not text.endswith("\n")),
        language=language,
        counts={name: int(columns.are(kind).sum()) for kind, name in _NAMES.items()},
        extents=(to_vec3(points.min(axis=0)), to_vec3(points.max(axis=0))) if len(points) else None,
        frames=tuple((frames.tool, frames.work) for frames in executed.frames),
        outputs=tuple(dict.fromkeys(item.signal for item in columns.list_kinds(Output))),
        facts=executed.facts,
        assumed=tuple(f"line {item.line}: {item.what}" for item in executed.assumed),
        findings=tuple(
            f"line {item.line}: {item.level}: {item.what}" for item in executed.findings
        ),
        stopped=f"line {executed.stopped[0]}: {executed.stopped[1]}" if executed.stopped else "",
    )


def text_of(source: Source) -> str:
    """The program as a text with LF line ends. Raises InputError if the file is not a text."""
    data = source.data
    fault = find_text_fault(data)
    if fault:
        raise InputError(
            source.name, fault, remedy="give the program as the controller saves it as text"
        )
    return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")


# -- one work frame and one tool -------------------------------------------------------------------


class OneFrameBody(Struct, frozen=True, eq=False):
    """A body in one work object and with one tool.

    body: (N) instructions.
    lines: (N) line of each instruction, from 1.
    frames: the work object and the tool.
    notes: changes for the user.
    works: (N) index in the frames of the run of the first one with the work object of an
        instruction. Empty if the whole body is in `frames`.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    frames: Frames
    notes: tuple[Note, ...]
    works: tuple[int, ...] = ()


class _Change(Struct, frozen=True, eq=False):
    """Change from the frames of a motion to those of the program: to_work @ target @ to_tool.

    same: whether the frames are equal.
    """

    to_work: Pose
    to_tool: Pose
    same: bool

    def transform(self, pose: Pose) -> Pose:
        return self.to_work @ pose @ self.to_tool

    def rotate(self, direction: Vec3) -> Vec3:
        return to_vec3(self.to_work.rotation @ direction)


def as_far_as_known(executed: Executed) -> OneFrameBody:
    """The body in one work object and with one tool, if the text states their frames.

    Otherwise each motion stays in its own frames, and a note states that.
    """
    whole = OneFrameBody(executed.body, executed.lines, executed.first_frames, ())
    if len(executed.frames) < 2 or not _has_motion(executed):
        return whole
    try:
        return in_one_frame(executed, "", _CHORD)
    except InputError as error:
        note = Note("assumed", "each motion is given in its own frame", f"the program {error.what}")
        return OneFrameBody(whole.body, whole.lines, whole.frames, (note,), _list_works(executed))


def _list_works(executed: Executed) -> tuple[int, ...]:
    """(N) index of the first frames with the work object of each instruction."""
    firsts: dict[tuple[object, ...], int] = {}
    first_of: list[int] = []
    for index, frames in enumerate(executed.frames):
        base = frames.base_from_work
        pose = None if base is None else (base.origin, base.rotation.tobytes())
        first_of.append(firsts.setdefault((frames.work, pose), index))
    return tuple(first_of[index] for index in executed.frame)


def in_one_frame(executed: Executed, file: str, chord: float) -> OneFrameBody:
    """The body in the work object and with the tool that most of its motions have.

    file: name for messages.
    chord: distance that the TCP may leave a line on which another tool turns, mm.

    Raises InputError if the frame of a second tool or work object is not known.
    """
    indices = executed.frame or (0,) * len(executed.body)
    main = executed.first_frames
    if executed.frames:
        main = executed.frames[_find_main(executed, indices)]
    changes: dict[int, _Change] = {}

    def get_change(index: int, line: int) -> _Change:
        if index not in changes:
            frames = executed.frames[index] if executed.frames else main
            changes[index] = _find_change(frames, main, file, line)
        return changes[index]

    body: list[Instruction] = []
    lines: list[int] = []
    start: Pose | None = None
    for item, line, index in zip(executed.body, executed.lines, indices, strict=True):
        moved: Sequence[Instruction] = (item,)
        # A force without a direction is off, or its direction is not known.
        if isinstance(item, Force) and any(item.force_direction):
            direction = get_change(index, line).rotate(item.force_direction)
            moved = (replace(item, force_direction=direction),)
        elif isinstance(item, MoveJ | MoveL | MoveC):
            if isinstance(item.target, Pose) and not get_change(index, line).same:
                moved = list(_transform(item, start, changes[index], chord))
            last = moved[-1]
            assert isinstance(last, MoveJ | MoveL | MoveC)
            start = last.target if isinstance(last.target, Pose) else None
        body += moved
        lines += [line] * len(moved)
    others = [executed.frames[index] for index, change in changes.items() if not change.same]
    notes = _note_frames(others, main, len(body) - len(executed.body))
    return OneFrameBody(tuple(body), tuple(lines), main, notes)


def _find_main(executed: Executed, indices: Sequence[int]) -> int:
    """The index of the frames that most motions to a pose have, the first of several."""
    pairs = zip(executed.body, indices, strict=True)
    count = Counter(
        index for item, index in pairs if isinstance(getattr(item, "target", None), Pose)
    )
    return count.most_common(1)[0][0] if count else 0


def _note_frames(others: Sequence[Frames], main: Frames, pieces: int) -> tuple[Note, ...]:
    """The note about motions in other frames, none without such motions.

    pieces: number of motions that were added.
    """
    if not others:
        return ()
    tools = dict.fromkeys(frames.tool or _NO_TOOL for frames in others if frames.tool != main.tool)
    works = dict.fromkeys(frames.work or _NO_WORK for frames in others if frames.work != main.work)
    changes: list[str] = []
    for word, names, name in (
        ("with", tools, main.tool or _NO_TOOL),
        ("in", works, main.work or _NO_WORK),
    ):
        if names:
            changes.append(f"motions {word} {', '.join(names)} are given {word} {name}")
    why = "a program here has one tool and one work frame; the way is the same"
    if pieces:
        why += f"; {counted(pieces, 'piece')} more, where the tool turns"
    return (Note("assumed", "; ".join(changes), why),)


def _find_change(other: Frames, main: Frames, file: str, line: int) -> _Change:
    """The change from the frames of a motion to those of the program.

    Raises InputError if they differ and the text does not state one of them.
    """
    to_work = _find_between(main.work, main.base_from_work, other.work, other.base_from_work)
    to_tool = _find_between(other.tool, other.flange_from_tool, main.tool, main.flange_from_tool)
    for kind, change, name in (
        ("work object", to_work, other.work),
        ("tool", to_tool, other.tool),
    ):
        if change is None:
            raise InputError(
                file,
                f"continues with the {kind} {name or 'of the controller'}, "
                "and its place is not in the text",
                f"line {line}",
                f"add the declaration of the {kind} to the file",
            )
    assert to_work is not None
    assert to_tool is not None
    return _Change(to_work, to_tool, _is_identity(to_work) and _is_identity(to_tool))


_IDENTITY = Pose(IDENTITY, (0.0, 0.0, 0.0))


def _find_between(
    name: str, frame: Pose | None, other_name: str, other: Pose | None
) -> Pose | None:
    """frame_from_other, None if it is not known."""
    if frame is None or other is None:
        return _IDENTITY if name == other_name and frame is other else None
    return frame.inverse() @ other


def _is_identity(pose: Pose) -> bool:
    angle = angle_between(pose.rotation, _IDENTITY.rotation)
    return max(map(abs, pose.origin)) < _SAME and angle < _SAME


def _transform(item: Motion, start: Pose | None, change: _Change, chord: float) -> Iterator[Motion]:
    """The motion in the frames of the program.

    A line or an arc on which the tool turns is neither for the TCP of another tool. It becomes
    short lines.

    start: pose in the frames of the program at which the motion starts, None if not known.
    chord: distance that the TCP may leave the line or arc, mm.
    """
    assert isinstance(item.target, Pose)
    rotation = 0.0
    if start is not None:
        before = change.to_work.inverse() @ start @ change.to_tool.inverse()
        ends = [item.target.rotation]
        if isinstance(item, MoveC):
            ends.append(item.via.rotation)
        rotation = max(angle_between(before.rotation, end) for end in ends)
    radius = math.hypot(*change.to_tool.origin)
    if isinstance(item, MoveJ):
        yield replace(item, target=change.transform(item.target))
        return
    direction = change.rotate(item.force_direction)
    if start is None or rotation < _SAME or radius < _SAME:
        item = replace(item, target=change.transform(item.target), force_direction=direction)
        yield replace(item, via=change.transform(item.via)) if isinstance(item, MoveC) else item
        return
    # The TCP of the other tool leaves its chord by radius * step**2 / 8.
    step = min(math.sqrt(8 * chord / radius), _MAX_ROTATION)
    halves = 2 if isinstance(item, MoveC) else 1
    count = math.ceil(rotation * halves / step)
    seconds = _measure_time(before, item, rotation) / count
    for k in range(1, count + 1):
        pose = change.transform(_pose_at(before, item, k / count))
        distance = math.dist(start.origin, pose.origin)
        blend = item.blend if k == count else chord
        piece = MoveL(pose, item.speed, blend, item.force, direction)
        if distance > _SAME and seconds > 0:
            piece = replace(piece, speed=distance / seconds)
        elif distance <= _SAME and seconds > 0:
            piece = replace(piece, turn=angle_between(start.rotation, pose.rotation) / seconds)
        yield piece
        start = pose


def _measure_time(start: Pose, item: MoveL | MoveC, rotation: float) -> float:
    """The time of a motion, s.

    rotation: rotation of the tool along the motion, rad.
    """
    if isinstance(item, MoveC):
        _, radius, _, sweep = compute_circle(start.origin, item.via.origin, item.target.origin)
        return radius * sweep / item.speed
    length = math.dist(start.origin, item.target.origin)
    return max(length / item.speed, rotation / item.turn if item.turn else 0.0)


def _pose_at(start: Pose, item: MoveL | MoveC, fraction: float) -> Pose:
    """The pose at a fraction of the length of a motion.

    The rotation along an arc is interpolated to that of the via point, then to that of the target.
    """
    if isinstance(item, MoveL):
        a, b = np.array(start.origin), np.array(item.target.origin)
        rotation = rotation_between(start.rotation, item.target.rotation, fraction)
        return Pose(rotation, to_vec3(a + fraction * (b - a)))
    centre, _, axis, sweep = compute_circle(start.origin, item.via.origin, item.target.origin)
    arm = np.subtract(start.origin, centre)
    rotated_arm = turn_about(to_vec3(arm), axis, fraction * sweep)
    x, y, z = (a + b for a, b in zip(rotated_arm, centre, strict=True))
    via_arm = np.subtract(item.via.origin, centre)
    via_angle = math.atan2(float(np.cross(arm, via_arm) @ axis), float(arm @ via_arm))
    via_fraction = via_angle % (2 * math.pi) / sweep
    if fraction <= via_fraction:
        rotation = rotation_between(start.rotation, item.via.rotation, fraction / via_fraction)
    else:
        rest = (fraction - via_fraction) / (1 - via_fraction)
        rotation = rotation_between(item.via.rotation, item.target.rotation, rest)
    return Pose(rotation, (x, y, z))
