"""Robot programs as an input: what an old program does, in one work frame and with one tool, to be posted anew.

Its structure (routines, loops, conditions) is not kept: what it does once is. Motions with other tools and in other
work objects are told anew for the first ones; nothing of their way changes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.arcs import circle, turn_about
from camgen.lang.programs import (
    Ask,
    Executed,
    Frames,
    Places,
    find_language,
    find_text_fault,
    rename_outputs,
)
from camgen.lang.recorded import ProgramRun, Recorded
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
from camgen.model.text import counted, short

Reach = Callable[[Sequence[float]], Pose | None]
#: Two frames are one where they differ by less, mm and rad.
_SAME = 1e-6
#: What a text that names no tool or work object means.
_NO_TOOL, _NO_WORK = "no tool", "the base of the robot"
#: mm that a line may be off where another tool turns, where no job says it.
_CHORD = 0.01
#: rad: a piece of a motion along which the tool turns is at most so long.
_MOST_TURN = math.radians(5.0)


class Taught(Recorded, frozen=True, eq=False, kw_only=True):
    """What a robot program does. language: its name. frames: the work object and the tool that ``run`` is told in, as
    far as the text says them.
    """

    language: str
    frames: Frames


def read(source: Source, job: Job, language: str) -> Taught:
    """The program in ``source``. InputError where it cannot be run to its end, would be turned down, or never moves."""
    return read_files([source], job, language)


def read_files(
    sources: Sequence[Source], job: Job, language: str, flange: Reach | None = None
) -> Taught:
    """The program in several files, as ``read`` does it. The first gives it its name. flange: as in ``Ask``."""
    name = " + ".join(source.name for source in sources)
    texts = {source.name: text_of(source) for source in sources}
    place = Places(texts) if len(sources) > 1 else "line {}".format
    ask = Ask(assume=_lower(job.input.assume), limits=sources[0].limits, flange=flange)
    executed = find_language(language).run(texts, ask)
    refused = [(one.line, one.what) for one in executed.findings if one.level == "refused"]
    for line, what in [*([executed.stopped] if executed.stopped else []), *refused][:1]:
        raise InputError(
            name, what, place(line), "camgen verify tells all of it; correct the program"
        )
    if not any(isinstance(item, MoveJ | MoveL | MoveC) for item in executed.body):
        raise InputError(
            name, "holds no motion", remedy="give a program that moves, with all its files"
        )
    _refuse_losses(executed, name, place)
    told = in_one_frame(executed, name, job.tolerance.chord)
    body = rename_outputs(told.body, job.input.signals, name)
    run = ProgramRun(body, told.lines, (), 0, 0.0, None, ended=True, units="mm", whole=True)
    notes = (*_note(executed, place), *told.notes)
    named = sources[0].stem, name, "mm", ()
    return Taught(*named, notes=notes, run=run, language=language, frames=told.frames)


def _note(executed: Executed, place: Callable[[int], str]) -> Iterator[Note]:
    """Notes of all that the program does beside its motions, as `camgen verify` lists it."""
    for line, what in executed.omitted:
        yield Note("skipped", f"{place(line)}: {what}", "the translation does without it")
    for finding in executed.findings:
        yield Note("warning", f"{place(finding.line)}: {finding.what}")
    for assumption in executed.assumed:
        yield Note("assumed", f"{place(assumption.line)}: {assumption.what}")
    for label, text in executed.facts:
        yield Note("assumed", f"{label}: {text}")


def _lower(given: Mapping[str, float]) -> dict[str, float]:
    return {key.lower(): value for key, value in given.items()}


def _refuse_losses(executed: Executed, name: str, place: Callable[[int], str]) -> None:
    """InputError where the program does more than its body says: an arm that runs the rest of it goes other ways."""
    for line, what in executed.lost[:1]:
        remedy = "give all files of the program, or take it out of it; camgen verify tells all that is missing"
        raise InputError(name, what, place(line), remedy)


class TaughtFacts(Struct, frozen=True):
    """What is in a robot program; its ``str`` is a page to print."""

    lines: int
    language: str
    counts: dict[str, int]
    extents: tuple[Vec3, Vec3] | None
    frames: tuple[tuple[str, str], ...]
    outputs: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    assumed: tuple[str, ...]
    found: tuple[str, ...]
    stopped: str

    def __str__(self) -> str:
        spans = zip("xyz", *self.extents, strict=True) if self.extents else ()
        tools, works = (
            ", ".join(dict.fromkeys(pair[k] for pair in self.frames if pair[k])) for k in (0, 1)
        )
        rows = [
            f"{self.language} of {counted(self.lines, 'line')}",
            f"does: {', '.join(counted(n, name) for name, n in self.counts.items() if n) or 'nothing'}",
            *(
                [
                    f"extents: {', '.join(f'{a} {short(b, 3)} to {short(c, 3)}' for a, b, c in spans)} mm"
                ]
                if spans
                else []
            ),
            *([f"tools: {tools}"] if tools else []),
            *([f"work objects: {works}"] if works else []),
            *([f"outputs: {', '.join(self.outputs)}"] if self.outputs else []),
            *(f"{label}: {text}" for label, text in self.facts),
            *(f"assumed: {text}" for text in self.assumed),
            *self.found,
            *([f"the run stops here: {self.stopped}"] if self.stopped else []),
        ]
        return "\n".join(rows)


_NAMES: dict[type[Instruction], str] = {
    MoveJ: "joint motion", MoveL: "line", MoveC: "arc", Output: "output", Wait: "wait", Force: "force change",
    ToolChange: "tool change", Stop: "stop",
}  # fmt: skip


def inspect(source: Source, language: str) -> TaughtFacts:
    """What is in the program, also where it cannot be run to its end. InputError if it is no text."""
    text = text_of(source)
    executed = find_language(language).run({source.name: text}, Ask(limits=source.limits))
    columns = Columns(executed.body)
    points = np.concatenate([columns.ends, columns.vias])
    points = points[~np.isnan(points).any(axis=1)]
    return TaughtFacts(
        lines=text.count("\n") + (not text.endswith("\n")),
        language=language,
        counts={name: int(columns.are(kind).sum()) for kind, name in _NAMES.items()},
        extents=(to_vec3(points.min(axis=0)), to_vec3(points.max(axis=0))) if len(points) else None,
        frames=tuple((one.tool, one.work) for one in executed.frames),
        outputs=tuple(dict.fromkeys(item.signal for item in columns.of(Output))),
        facts=executed.facts,
        assumed=tuple(f"line {one.line}: {one.what}" for one in executed.assumed),
        found=tuple(f"line {one.line}: {one.level}: {one.what}" for one in executed.findings),
        stopped=f"line {executed.stopped[0]}: {executed.stopped[1]}" if executed.stopped else "",
    )


def text_of(source: Source) -> str:
    """The program as text with LF line ends. InputError for what is none."""
    data = source.data
    fault = find_text_fault(data)
    if fault:
        raise InputError(
            source.name, fault, remedy="give the program as the controller saves it as text"
        )
    return data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")


# One work frame and one tool.


class Carried(Struct, frozen=True, eq=False):
    """A body in one work object and with one tool, and what is to be said of that.

    works: number of the work object of each instruction in the frames of the run, empty for one.
    """

    body: Sequence[Instruction]
    lines: Sequence[int]
    frames: Frames
    notes: tuple[Note, ...]
    works: tuple[int, ...] = ()


class _Change(Struct, frozen=True, eq=False):
    """From the frames of a motion to those of the program: to_work @ target @ to_tool."""

    to_work: Pose
    to_tool: Pose
    same: bool

    def carry(self, pose: Pose) -> Pose:
        return self.to_work @ pose @ self.to_tool

    def turn(self, direction: Vec3) -> Vec3:
        return to_vec3(self.to_work.rotation @ direction)


def as_far_as_known(executed: Executed) -> Carried:
    """What a program does in one work object and with one tool, or each motion in its own where nobody knows how they
    lie to each other.
    """
    whole = Carried(
        executed.body, executed.lines, executed.frames[0] if executed.frames else Frames(), ()
    )
    if len(executed.frames) < 2 or not any(
        isinstance(item, MoveJ | MoveL | MoveC) for item in executed.body
    ):
        return whole
    try:
        return in_one_frame(executed, "", _CHORD)
    except InputError as error:
        note = Note("assumed", "each motion is told in its own frame", f"the program {error.what}")
        return Carried(whole.body, whole.lines, whole.frames, (note,), _list_works(executed))


def _list_works(executed: Executed) -> tuple[int, ...]:
    """The number of the first frames with the work object of each instruction."""
    numbers: dict[tuple[object, ...], int] = {}
    of_frames = []
    for number, frames in enumerate(executed.frames):
        base = frames.base_from_work
        pose = None if base is None else (base.origin, base.rotation.tobytes())
        of_frames.append(numbers.setdefault((frames.work, pose), number))
    return tuple(of_frames[place] for place in executed.frame)


def in_one_frame(executed: Executed, file: str, chord: float) -> Carried:
    """What a program does in the work object and with the tool of most of its motions.

    chord: mm that a tool's centre may be off its line where it turns and another's is told. InputError where a second
    tool or work object is not known. file: for messages.
    """
    places = executed.frame or (0,) * len(executed.body)
    own = executed.frames[_find_own(executed, places)] if executed.frames else Frames()
    changes: dict[int, _Change] = {}
    body: list[Instruction] = []
    lines: list[int] = []
    here: Pose | None = None
    pieces = 0
    for item, line, place in zip(executed.body, executed.lines, places, strict=True):
        made: Sequence[Instruction] = (item,)
        if isinstance(item, Force) and not any(item.force_direction):
            pass  # off, or along what no text says
        elif isinstance(item, Force) or (
            isinstance(item, MoveJ | MoveL | MoveC) and isinstance(item.target, Pose)
        ):
            if place not in changes:
                changes[place] = _find_change(
                    executed.frames[place] if executed.frames else own, own, file, line
                )
            change = changes[place]
        if isinstance(item, Force):
            if any(item.force_direction):
                made = (replace(item, force_direction=change.turn(item.force_direction)),)
        elif isinstance(item, MoveJ | MoveL | MoveC):
            if isinstance(item.target, Pose) and not change.same:
                made = list(_carry(item, here, change, chord))
                pieces += len(made) - 1
            last = made[-1]
            assert isinstance(last, MoveJ | MoveL | MoveC)
            here = last.target if isinstance(last.target, Pose) else None
        body += made
        lines += [line] * len(made)
    return Carried(tuple(body), tuple(lines), own, _tell(executed.frames, own, changes, pieces))


def _find_own(executed: Executed, places: Sequence[int]) -> int:
    """The place of the frames that most motions have, of several the first; joint values are in no work object."""
    every = zip(executed.body, places, strict=True)
    count = Counter(
        place for move, place in every if isinstance(getattr(move, "target", None), Pose)
    )
    return count.most_common(1)[0][0] if count else 0


def _tell(
    frames: Sequence[Frames], own: Frames, changes: dict[int, _Change], pieces: int
) -> tuple[Note, ...]:
    others = [frames[place] for place, change in changes.items() if not change.same]
    if not others:
        return ()
    tools = dict.fromkeys(one.tool or _NO_TOOL for one in others if one.tool != own.tool)
    works = dict.fromkeys(one.work or _NO_WORK for one in others if one.work != own.work)
    what = "; ".join(
        f"motions {word} {', '.join(names)} are told {word} {first}"
        for word, names, first in (
            ("with", tools, own.tool or _NO_TOOL),
            ("in", works, own.work or _NO_WORK),
        )
        if names
    )
    more = f"; {counted(pieces, 'piece')} more, where the tool turns" if pieces else ""
    return (
        Note(
            "assumed",
            what,
            f"a program here has one tool and one work frame; the way is the same{more}",
        ),
    )


def _find_change(other: Frames, own: Frames, file: str, line: int) -> _Change:
    """From the frames of a motion to those of the program. InputError where they differ and the text does not say by
    how much.
    """
    to_work = _between(own.work, own.base_from_work, other.work, other.base_from_work)
    from_own = _between(other.tool, other.flange_from_tool, own.tool, own.flange_from_tool)
    for kind, found, name in (("work object", to_work, other.work), ("tool", from_own, other.tool)):
        if found is None:
            what = f"goes on with the {kind} {name or 'of the controller'}, and the text does not say where it is"
            raise InputError(
                file, what, f"line {line}", f"add the declaration of the {kind} to the file"
            )
    assert to_work is not None
    assert from_own is not None
    return _Change(to_work, from_own, _is_none(to_work) and _is_none(from_own))


_NONE = Pose(IDENTITY, (0.0, 0.0, 0.0))


def _between(name: str, frame: Pose | None, other_name: str, other: Pose | None) -> Pose | None:
    """frame_from_other, None where it is not known."""
    if frame is None or other is None:
        return _NONE if name == other_name and frame is other else None
    return frame.inverse() @ other


def _is_none(pose: Pose) -> bool:
    return (
        max(map(abs, pose.origin)) < _SAME and angle_between(pose.rotation, _NONE.rotation) < _SAME
    )


def _carry(item: Motion, here: Pose | None, change: _Change, chord: float) -> Iterator[Motion]:
    """The motion in the frames of the program. here: where that begins, in these. Where the tool turns along a line or
    an arc, the other tool's centre is on none: it goes through pieces.
    """
    assert isinstance(item.target, Pose)
    begin = None if here is None else change.to_work.inverse() @ here @ change.to_tool.inverse()
    ends = [item.target.rotation, *([item.via.rotation] if isinstance(item, MoveC) else [])]
    turn = 0.0 if begin is None else max(angle_between(begin.rotation, end) for end in ends)
    arm = math.hypot(*change.to_tool.origin)
    if isinstance(item, MoveJ) or begin is None or turn < _SAME or arm < _SAME:
        target = change.carry(item.target)
        if isinstance(item, MoveJ):
            yield replace(item, target=target)
            return
        item = replace(item, target=target, force_direction=change.turn(item.force_direction))
        yield replace(item, via=change.carry(item.via)) if isinstance(item, MoveC) else item
        return
    # The centre of the other tool leaves its chord by arm * step**2 / 8.
    step = min(math.sqrt(8 * chord / arm), _MOST_TURN)
    count = math.ceil(turn * (2 if isinstance(item, MoveC) else 1) / step)
    at = here
    seconds = _time(begin, item, turn) / count
    for k in range(1, count + 1):
        pose = change.carry(_pose_at(begin, item, k / count))
        assert at is not None
        moved = math.dist(at.origin, pose.origin)
        piece = MoveL(
            pose,
            item.speed,
            item.blend if k == count else chord,
            item.force,
            change.turn(item.force_direction),
        )
        if moved > _SAME and seconds > 0:
            piece = replace(piece, speed=moved / seconds)
        elif moved <= _SAME and seconds > 0:
            piece = replace(piece, turn=angle_between(at.rotation, pose.rotation) / seconds)
        yield piece
        at = pose


def _time(begin: Pose, item: MoveL | MoveC, turn: float) -> float:
    """The time of a motion, s. turn: angle that the tool turns, rad."""
    turning = turn / item.turn if isinstance(item, MoveL) and item.turn else 0.0
    return max(_length(begin, item) / item.speed, turning)


def _length(begin: Pose, item: MoveL | MoveC) -> float:
    if isinstance(item, MoveL):
        return math.dist(begin.origin, item.target.origin)
    _, radius, _, sweep = circle(begin.origin, item.via.origin, item.target.origin)
    return radius * sweep


def _pose_at(begin: Pose, item: MoveL | MoveC, share: float) -> Pose:
    """Where the motion is after ``share`` of its way; along an arc it stands at the via point as that says."""
    if isinstance(item, MoveL):
        a, b = np.array(begin.origin), np.array(item.target.origin)
        rotation = rotation_between(begin.rotation, item.target.rotation, share)
        return Pose(rotation, to_vec3(a + share * (b - a)))
    centre, _, axis, sweep = circle(begin.origin, item.via.origin, item.target.origin)
    arm = np.subtract(begin.origin, centre)
    x, y, z = (
        a + b for a, b in zip(turn_about(to_vec3(arm), axis, share * sweep), centre, strict=True)
    )
    over = np.subtract(item.via.origin, centre)
    turned = (
        math.atan2(float(np.cross(arm, over) @ axis), float(arm @ over)) % (2 * math.pi) / sweep
    )
    if share <= turned:
        rotation = rotation_between(begin.rotation, item.via.rotation, share / turned)
    else:
        rotation = rotation_between(
            item.via.rotation, item.target.rotation, (share - turned) / (1 - turned)
        )
    return Pose(rotation, (x, y, z))
