"""The state of a run of a PacScript program, and its instructions so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from camgen.lang.log import Log
from camgen.lang.motion_speed import Limit, pace_motion
from camgen.lang.pacscript.values import (
    Array,
    ExternalPose,
    PoseWithFigure,
    Rate,
    Speed,
    Value,
    Vector,
    base_of,
    name_place,
)
from camgen.lang.programs import Executed, Frames, RunRequest, index_frames
from camgen.lang.run import LimitReached
from camgen.lang.values import Unknown
from camgen.model.pose import IDENTITY, Pose, Vec3, frozen, to_vec3
from camgen.model.program import (
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Stop,
    Wait,
)

#: mm/s of the TCP, and deg/s of a reorientation, at 100 %: defaults that the user may change.
RATED, RATED_TURN = 1000.0, 500.0
#: mm: assumed blend radius of `@P` and `@C`. The controller chooses how near they pass the target.
PASS_MM = 1.0
#: s: a shorter delay was probably written in seconds, while Delay counts in ms.
_SHORT_DELAY = 0.01
#: Maximum number of instructions.
_MAX_INSTRUCTIONS = 2_000_000


@dataclass(slots=True)
class Scope:
    """The names of a running procedure, in lower case.

    names: values.
    kinds: types in lower case.
    ios: number of each port of DefIO.
    assigned: names to which the procedure assigns a value somewhere.
    """

    names: dict[str, Value] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    ios: dict[str, int] = field(default_factory=dict)
    assigned: frozenset[str] = frozenset()


class Machine:
    """The state of a run.

    current_pose: pose of the TCP in the work frame in force; external if the text does not give it.
    joints: joint values, None if the text does not give them.
    """

    def __init__(
        self, assume: Mapping[str, float], points: Mapping[tuple[str, int], Value]
    ) -> None:
        self.assume, self.points = assume, points
        #: base_from_flange for joint values, rad; None if the arm is unknown.
        self.flange: Callable[[Sequence[float]], Pose | None] = RunRequest().find_flange
        self.line = 0
        self.body: list[Instruction] = []
        self.lines: list[int] = []
        self.frame: list[int] = []
        self.frames: list[Frames] = []
        self.log = Log(lambda: self.line)
        self.globals: dict[tuple[str, int], Value] = {}
        self.outputs: dict[str, Value] = {}
        self.current_pose: Pose = name_place("where the arm stands at the start")
        self.joints: Joints | None = None
        #: Values of the axes beyond the sixth, deg, NaN if they are not known.
        self.others: dict[int, float] = {}
        #: Points of the free curves, by the number of their path.
        self.paths: dict[int, list[Value]] = {}
        self.figure: int | None = None
        self.internal: Speed = 100.0
        self.external: float = 100.0
        self.numbers = {"tool": 0, "work": 0}
        self.defined: dict[tuple[str, int], Pose] = {}
        self.armed = False
        #: Another program, which is not in the text, may have taken the arm.
        self.trusting = False
        #: Line of the first Run of each concurrent program, by its name.
        self.tasks: dict[str, int] = {}
        self.motor = True
        self.moved = False
        self.passing = False
        self.home: Value | None = None
        self.forces: dict[int, tuple[int, Vec3]] = {}
        #: The force table that is on.
        self.table: int | None = None
        self.pressing: tuple[float, Vec3] = (0.0, (0.0, 0.0, 0.0))
        self.rated = self._given("rated", RATED)
        self.rated_turn = self._given("rated_turn", RATED_TURN)
        #: Indices in `frames`: by base, for the tool and work frame in force; and of all frames.
        self._frame_now: dict[str, int] = {}
        self._frames: dict[tuple[str, str, int, int], int] = {}
        self._noted_percentage = 0.0

    def _given(self, key: str, default: float) -> float:
        value = self.assume.get(key, default)
        return value if value > 0 and math.isfinite(value) else default

    def unknown(self, what: str, key: str = "") -> Value:
        """Return an external value: the assumption of the user, or else `Unknown`."""
        if key and (given := self.given(key)) is not None:
            self.log.assume(f"{what} is {given:g}, as given", key, given)
            return given
        return Unknown(what, key)

    def given(self, key: str) -> float | None:
        """Return the assumption of the user for a key with or without its brackets, or None."""
        bare = key.replace("[", "").replace("]", "")
        return self.assume.get(key, self.assume.get(bare))

    # Instructions.

    def emit(self, item: Instruction, base: str = "") -> None:
        """Add an instruction of the present line. base: frame of the target, see `ExternalPose`."""
        if len(self.body) >= _MAX_INSTRUCTIONS:
            raise LimitReached("more motions than a program can have")
        self.body.append(item)
        self.lines.append(self.line)
        if base not in self._frame_now:
            self._frame_now[base] = self._find_frame(base)
        self.frame.append(self._frame_now[base])

    def _find_frame(self, base: str) -> int:
        tool, work = self.numbers["tool"], self.numbers["work"]
        frames = Frames(
            f"{tool}", base or f"{work}", self.pose_of("tool", tool), self.pose_of("work", work)
        )
        if base:
            frames = Frames(frames.tool, base, frames.flange_from_tool)
        key = (frames.tool, frames.work, id(frames.flange_from_tool), id(frames.base_from_work))
        if key not in self._frames:
            self._frames[key] = len(self.frames)
            self.frames.append(frames)
        return self._frames[key]

    def pose_of(self, kind: str, number: int) -> Pose | None:
        """Return a tool or work frame, None if unknown. Number 0 is the flange or the base."""
        return self.defined.get((kind, number), _ORIGIN if number == 0 else None)

    def change_frame(self, kind: str, number: int) -> None:
        """Change the tool or work frame in force.

        The current pose becomes external unless the old and the new frame are known.
        """
        if number == self.numbers[kind]:
            return
        old, new = self.pose_of(kind, self.numbers[kind]), self.pose_of(kind, number)
        self.numbers[kind] = number
        self._frame_now.clear()
        if isinstance(self.current_pose, ExternalPose) or old is None or new is None:
            if self.moved:
                self.current_pose = name_place(f"the position of the arm in line {self.line}")
        elif kind == "work":
            self.current_pose = new.inverse() @ old @ self.current_pose
        else:
            self.current_pose = self.current_pose @ old.inverse() @ new

    def define_frame(self, kind: str, number: int, pose: Pose) -> None:
        """Define a tool or work frame."""
        self.defined[(kind, number)] = pose
        self._frame_now.clear()
        if self.numbers[kind] == number and self.moved:
            self.current_pose = name_place(f"the position of the arm in line {self.line}")

    def lose_motion(self) -> None:
        """Add a motion to an external pose for one that could not be evaluated."""
        speed, _ = self.speed(self.internal)
        base = f"where line {self.line} leads"
        self.log.leave_out(f"{base} is not evaluated: it is given in a frame of that name")
        self.move(MoveL(Pose(IDENTITY, (0.0, 0.0, 0.0)), speed), False, base)

    def speed(self, value: Speed) -> tuple[float, float]:
        """Convert a speed to mm/s and to the speed fraction, which is 0 for a speed of the TCP."""
        assert isinstance(value, float)
        if isinstance(value, Rate):
            return value.mm_s * self.external / 100, 0.0
        if value != self._noted_percentage:
            self._noted_percentage = value
            self.log.assume(f"100 % is assumed to be {self.rated:g} mm/s", "rated", self.rated)
        share = min(1.0, value / 100 * self.external / 100)
        return value / 100 * self.rated * self.external / 100, share

    def move(self, item: MoveJ | MoveL | MoveC, passing: bool, base: str = "") -> None:
        """Add a motion.

        passing: the next instruction may run before the arm is at the target.
        base: frame of the target, see `ExternalPose`; empty for the work frame.
        """
        if not self.armed and not self.trusting:
            self.log.find("refused", "a motion without TakeArm: the controller stops with an error")
            self.trusting = True
        if not self.motor:
            self.log.find("refused", "a motion with the motor off")
        if not self.moved and not isinstance(item, MoveJ):
            self.log.find(
                "unusual",
                "the first motion is a straight line or an arc from wherever the arm stands",
            )
        self.emit(item, base)
        self.moved, self.passing = True, passing
        target = item.target
        if isinstance(target, Joints):
            self.current_pose = self._reach(target) or name_place(
                f"where the joint values of line {self.line} lead"
            )
            self.joints = target
        else:
            self.joints = None
            if base:
                target = ExternalPose(target.rotation, target.origin, base)
            self.current_pose = target

    def _reach(self, joints: Joints) -> Pose | None:
        """Return work_from_tcp for joint values, None if the arm or a frame is unknown."""
        flange = self.flange(joints.values)
        tool = self.pose_of("tool", self.numbers["tool"])
        work = self.pose_of("work", self.numbers["work"])
        if flange is None or tool is None or work is None:
            return None
        return work.inverse() @ flange @ tool

    def go_joints(self, target: Joints, speed: Speed, blend: float, at_once: bool = False) -> None:
        """Add a motion to joint values."""
        if len(target.values) > 6:
            values = dict(enumerate(map(math.degrees, target.values[6:]), 7))
            self.move_others(values, "joint values beyond the sixth are not shown")
            target = Joints(target.values[:6])
        mm_s, share = self.speed(speed)
        self.move(MoveJ(target, mm_s, blend, share=share), blend > 0 and not at_once)
        self.figure = None

    def move_others(self, values: dict[int, float], what: str) -> None:
        """Add a loss for axes beyond the sixth.

        values: new values by axis, deg, NaN if they are not known.
        what: text of the loss.
        """
        is_moving = any(value != self.others.get(axis, value) for axis, value in values.items())
        if is_moving or any(values.values()):
            self.log.lose_axes(what, is_moving)
        self.others |= values

    def go(
        self, linear: bool, target: Pose, speed: Speed, blend: float, at_once: bool = False
    ) -> None:
        """Add a linear or a joint motion to a pose."""
        posture, figure, base, place = None, None, "", target
        if type(target) is not Pose:
            posture, figure = posture_of(target)
            place = Pose(target.rotation, target.origin)
        if isinstance(target, ExternalPose):
            base = target.base
            self.log.assume(
                f"{base} is not in the text: motions to it are given in a frame of that name"
            )
        passing = blend > 0 and not at_once
        mm_s, share = self.speed(speed)
        if linear:
            item = MoveL(place, mm_s, blend, *self.pressing, posture=posture)
            self.move(self.pace(item, share, base), passing, base)
            self.figure = figure
        else:
            self.move(MoveJ(place, mm_s, blend, posture=posture, share=share), passing, base)
            if figure is not None:
                # Without a figure the arm keeps its present one.
                self.figure = figure

    def pace(self, item: MoveL | MoveC, share: float, base: str) -> MoveL | MoveC:
        """Limit the speed of a motion by its reorientation.

        share: share of the joints' maximum speeds, 0 for a speed of the TCP, which limits no turn.
        base: frame of a `ExternalPose` target, empty for one in the work frame.
        """
        stands = base_of(self.current_pose)
        limit = Limit(item.speed, math.radians(share * self.rated_turn))
        paced = pace_motion(item, self.current_pose if stands == base else None, limit)
        assert not isinstance(paced, MoveJ)
        return paced

    def switch(self, signal: str, value: float) -> None:
        """Set an output."""
        if self.passing:
            what = "an output after a motion that passes its target"
            self.log.find("dangerous", f"{what}: it switches before the arm is there")
            self.passing = False
        self.emit(Output(signal, value))

    def wait(self, seconds: float) -> None:
        """Add a wait, s."""
        if seconds > 0:
            self.emit(Wait(seconds))
            self.passing = False
        if 0 < seconds < _SHORT_DELAY:
            self.log.find(
                "unusual", f"a delay of {seconds * 1000:g} ms: it is counted in milliseconds"
            )

    def stop(self) -> None:
        """Add a stop, until the operator continues."""
        self.emit(Stop())
        self.passing = False

    def press(self, table: int | None) -> bool:
        """Apply a force table from the next motion on, None for no force.

        Returns whether the force is known.
        """
        self.table, self.pressing = table, (0.0, (0.0, 0.0, 0.0))
        if table is None:
            return True
        frame, force = self.forces.get(table, (0, (0.0, 0.0, 0.0)))
        size = math.hypot(*force)
        is_known = frame == 2 or (frame == 1 and not isinstance(self.current_pose, ExternalPose))
        if not size or not is_known:
            return False
        if frame == 1:
            force = to_vec3(self.current_pose.rotation @ frozen(force))
        x, y, z = force
        self.pressing = (size, (x / size, y / size, z / size))
        return True

    def finish(self, stopped: tuple[int, str] | None) -> Executed:
        """Return the result of the run."""
        if self.table is not None:
            self.log.find(
                "dangerous",
                "force control is on at the end",
                line=self.lines[-1] if self.lines else 1,
            )
        return Executed(
            tuple(self.body),
            tuple(self.lines),
            tuple(self.frames),
            index_frames(self.frames, self.frame),
            stopped=stopped,
            **self.log.list_all(", ", 20),
        )


_ORIGIN = Pose(IDENTITY, (0.0, 0.0, 0.0))


def posture_of(place: Pose) -> tuple[Posture | None, int | None]:
    """Return the posture and the figure of a position, None if they are open."""
    if isinstance(place, PoseWithFigure):
        return Posture(figure=place.figure), place.figure
    return None, None


def blank(kind: str) -> Value:
    """Return the initial value of a type, whose name is in lower case."""
    return _BLANKS.get(kind, 0.0)


_BLANKS: dict[str, Value] = {
    "string": "",
    "position": _ORIGIN,
    "trans": _ORIGIN,
    "vector": Vector((0.0, 0.0, 0.0)),
    "joint": Joints((0.0,) * 6),
}


def copy_value(value: Value) -> Value:
    """Return a value for another name; arrays are copied."""
    return value.copy() if isinstance(value, Array) else value
