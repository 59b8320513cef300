"""What a controller knows while it runs a PacScript program, and what the program has done so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from camgen.lang.log import Log
from camgen.lang.motion_speed import Limit, pace_motion
from camgen.lang.pacscript.values import (
    Array,
    Figured,
    Placed,
    Rate,
    Speed,
    Value,
    Vector,
    name_place,
)
from camgen.lang.programs import Executed, Frames
from camgen.lang.run import LimitReached
from camgen.lang.values import Unknown
from camgen.model.pose import IDENTITY, Pose, Vec3, frozen, to_vec3
from camgen.model.program import (
    Force,
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

#: mm/s at 100 %, and deg/s of a turn on the spot, where the user says nothing else.
RATED, RATED_TURN = 1000.0, 500.0
#: The blend of ``@P`` and ``@C``, mm: how near they pass their target is the controller's choice.
PASS_MM = 1.0
#: A program may do so many things.
#: A delay below was rather meant in another unit, s.
_SHORT_DELAY = 0.01
_MOST_MOTIONS = 2_000_000


@dataclass(slots=True)
class Scope:
    """The names of a procedure that runs. kinds: their types in small letters; ios: those of DefIO; assigned: names
    that it gives a value somewhere.
    """

    names: dict[str, Value] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)
    ios: dict[str, tuple[str, int]] = field(default_factory=dict)
    assigned: frozenset[str] = frozenset()


class Machine:
    """The state of a run.

    current_pose: pose of the TCP in the work frame in force. `Placed` if the text does not give it.
    joints: joint values, None if the text does not give them.
    """

    def __init__(
        self, assume: Mapping[str, float], points: Mapping[tuple[str, int], Value]
    ) -> None:
        self.assume, self.points = assume, points
        #: base_from_flange from joint values, where the arm is known.
        self.flange: Callable[[Sequence[float]], Pose | None] | None = None
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
        #: Whether somebody whom the text does not show may have taken the arm.
        self.trusting = False
        # Programs that Run starts beside this one.
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
        #: The place in ``frames`` by base, with the tool and the work frame in force; and of all so far.
        self._frame_now: dict[str, int] = {}
        self._frames: dict[tuple[str, str, int, int], int] = {}
        self._told = 0.0

    def _given(self, key: str, default: float) -> float:
        value = self.assume.get(key, default)
        return value if value > 0 and math.isfinite(value) else default

    def unknown(self, what: str, key: str = "") -> Value:
        """A value that no text holds: the user's where he gives one."""
        if key and (given := self.given(key)) is not None:
            self.log.assume(f"{what} is {given:g}, as given", key, given)
            return given
        return Unknown(what, key)

    def given(self, key: str) -> float | None:
        """What the user says of a key, with or without its brackets."""
        found = self.assume.get(key)
        return self.assume.get(key.replace("[", "").replace("]", "")) if found is None else found

    # What the program does.

    def emit(self, item: Instruction, base: str = "") -> None:
        """Adds an instruction of the present line. base: of a motion in the frame of a place that no text holds."""
        if len(self.body) >= _MOST_MOTIONS:
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
        """A tool or a work frame; 0 is the flange or the base."""
        return self.defined.get((kind, number), _ORIGIN if number == 0 else None)

    def change_frame(self, kind: str, number: int) -> None:
        """Takes another tool or work frame; where the TCP is in it is only known of two work frames that are known."""
        if number == self.numbers[kind]:
            return
        old, new = self.pose_of(kind, self.numbers[kind]), self.pose_of(kind, number)
        self.numbers[kind] = number
        self._frame_now.clear()
        if isinstance(self.current_pose, Placed) or old is None or new is None:
            if self.moved:
                self.current_pose = name_place(f"where the arm stands in line {self.line}")
        elif kind == "work":
            self.current_pose = new.inverse() @ old @ self.current_pose
        else:
            self.current_pose = self.current_pose @ old.inverse() @ new

    def define_frame(self, kind: str, number: int, pose: Pose) -> None:
        """Writes the definition of a tool or a work frame."""
        self.defined[(kind, number)] = pose
        self._frame_now.clear()
        if self.numbers[kind] == number and self.moved:
            self.current_pose = name_place(f"where the arm stands in line {self.line}")

    def own(self) -> None:
        """A motion needs the arm and its power."""
        if not self.armed and not self.trusting:
            self.log.find("refused", "a motion without TakeArm: the controller stops with an error")
            self.trusting = True
        if not self.motor:
            self.log.find("refused", "a motion with the motor off")

    def lose_motion(self) -> None:
        """A motion that could not be evaluated leads to where nobody knows."""
        speed, _ = self.speed(self.internal)
        base = f"where line {self.line} leads"
        self.log.leave_out(f"{base} is not evaluated: it is told in a frame of that name")
        self.move(MoveL(Pose(IDENTITY, (0.0, 0.0, 0.0)), speed), False, base)

    def speed(self, value: Speed) -> tuple[float, float]:
        """mm/s, and the share of the joints' greatest speeds, 0 where the speed is one of the TCP."""
        assert isinstance(value, float)
        if isinstance(value, Rate):
            return value.mm_s * self.external / 100, 0.0
        if value != self._told:
            self._told = value
            self.log.assume(f"100 % is taken for {self.rated:g} mm/s", "rated", self.rated)
        return value / 100 * self.rated * self.external / 100, min(
            1.0, value / 100 * self.external / 100
        )

    def move(self, item: MoveJ | MoveL | MoveC, passing: bool, base: str = "") -> None:
        """Adds a motion. passing: what follows may happen before the arm is there. base: of ``Placed``."""
        self.own()
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
            self.current_pose, self.joints = (
                (Placed(target.rotation, target.origin, base) if base else target),
                None,
            )

    def _reach(self, joints: Joints) -> Pose | None:
        """Where joint values put the tool in the work frame in force, where the arm and both are known."""
        flange = self.flange(joints.values) if self.flange is not None else None
        tool, work = (
            self.pose_of("tool", self.numbers["tool"]),
            self.pose_of("work", self.numbers["work"]),
        )
        return (
            None
            if flange is None or tool is None or work is None
            else work.inverse() @ flange @ tool
        )

    def go_joints(self, target: Joints, speed: Speed, blend: float, at_once: bool = False) -> None:
        """Moves the axes to values of their own."""
        if len(target.values) > 6:
            values = dict(enumerate(map(math.degrees, target.values[6:]), 7))
            self.move_others(values, "joint values beyond the sixth are not shown")
            target = Joints(target.values[:6])
        mm_s, share = self.speed(speed)
        self.move(MoveJ(target, mm_s, blend, share=share), blend > 0 and not at_once)
        self.figure = None

    def move_others(self, values: dict[int, float], what: str) -> None:
        """Adds a loss for axes beyond the sixth.

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
        """Moves the TCP to a place, straight or as the axes run."""
        posture, said, base, place = None, None, "", target
        if type(target) is not Pose:
            posture, said = posture_of(target)
            place = Pose(target.rotation, target.origin)
        if isinstance(target, Placed):
            base = target.base
            self.log.assume(
                f"{base} is not in the text: motions to it are told in a frame of that name"
            )
        passing = blend > 0 and not at_once
        mm_s, share = self.speed(speed)
        if linear:
            item = MoveL(place, mm_s, blend, *self.pressing, posture=posture)
            self.move(self.pace(item, share, base), passing, base)
            self.figure = said
        else:
            self.move(MoveJ(place, mm_s, blend, posture=posture, share=share), passing, base)
            if said is not None:
                # Without a figure the arm keeps the one that it has.
                self.figure = said

    def pace(self, item: MoveL | MoveC, share: float, base: str) -> MoveL | MoveC:
        """The motion at the speed that its speed of turning leaves.

        share: share of the joints' maximum speeds, 0 for a speed of the TCP, which limits no turn.
        base: frame of a `Placed` target, empty for one in the work frame.
        """
        stands = self.current_pose.base if isinstance(self.current_pose, Placed) else ""
        limit = Limit(item.speed, math.radians(share * self.rated_turn))
        paced = pace_motion(item, self.current_pose if stands == base else None, limit)
        assert not isinstance(paced, MoveJ)
        return paced

    def switch(self, signal: str, value: float) -> None:
        """Sets an output."""
        if self.passing:
            what = "an output after a motion that passes its target: it switches before the arm is there"
            self.log.find("dangerous", what)
            self.passing = False
        self.emit(Output(signal, value))

    def wait(self, seconds: float) -> None:
        """Stands still."""
        if seconds > 0:
            self.emit(Wait(seconds))
            self.passing = False
        if 0 < seconds < _SHORT_DELAY:
            self.log.find(
                "unusual", f"a delay of {seconds * 1000:g} ms: it is counted in milliseconds"
            )

    def stop(self) -> None:
        """Stands still until the operator lets it go on."""
        self.emit(Stop())

    def press(self, table: int | None) -> bool:
        """Presses as a force table says from the next motion on, None: not at all. Whether its force is known."""
        self.table, self.pressing = table, (0.0, (0.0, 0.0, 0.0))
        if table is None:
            return True
        frame, force = self.forces.get(table, (0, (0.0, 0.0, 0.0)))
        size = math.hypot(*force)
        if (
            not size
            or frame not in (1, 2)
            or (frame == 1 and isinstance(self.current_pose, Placed))
        ):
            return False
        if frame == 1:
            force = to_vec3(self.current_pose.rotation @ frozen(force))
        x, y, z = force
        self.pressing = (size, (x / size, y / size, z / size))
        return True

    def tell_force(self) -> None:
        """Adds the force that is on, 0 N: none."""
        self.emit(Force(*self.pressing))

    def finish(self, stopped: tuple[int, str] | None) -> Executed:
        """All that was found."""
        if self.table is not None:
            self.log.find(
                "dangerous",
                "force control is on at the end",
                line=self.lines[-1] if self.lines else 1,
            )
        several = len(self.frames) > 1
        return Executed(
            tuple(self.body),
            tuple(self.lines),
            tuple(self.frames),
            tuple(self.frame) if several else (),
            self.log.list_findings(),
            self.log.list_assumed(),
            self.log.list_facts(", ", 20),
            self.log.list_lost(),
            self.log.list_omitted(),
            stopped,
            self.log.is_limited,
            self.log.untimed,
            self.log.list_choices(),
            self.log.steps,
        )


_ORIGIN = Pose(IDENTITY, (0.0, 0.0, 0.0))


def posture_of(place: Pose) -> tuple[Posture | None, int | None]:
    """What a position says of the posture of the arm, and its figure."""
    if isinstance(place, Figured):
        return Posture(figure=place.figure), place.figure
    return None, None


def blank(kind: str) -> Value:
    """The value of a name of a type, in small letters, before anything is assigned to it."""
    return _BLANKS.get(kind, 0.0)


_BLANKS: dict[str, Value] = {
    "string": "",
    "position": _ORIGIN,
    "trans": _ORIGIN,
    "vector": Vector((0.0, 0.0, 0.0)),
    "joint": Joints((0.0,) * 6),
}


def copy_value(value: Value) -> Value:
    """``value`` for another name: arrays are copied."""
    return value.copy() if isinstance(value, Array) else value
