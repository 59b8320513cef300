"""The arm of a V+ program: where it is, how fast, along what path and in which posture.

One for the strict read-back and for programs of other hands: both say what they make of an instruction, this carries
it out. Sources: V+ Language Reference and User's Guide as docs/posts/vplus.md quotes them. Motions do not block and run
into each other unless BREAK stands between them; SPEED without ALWAYS is for one motion; 100 % at the start.
"""

from __future__ import annotations

from functools import partial
from itertools import chain, repeat

from msgspec.structs import replace

from camgen.model.pose import Pose
from camgen.model.program import Instruction, Joints, MoveJ, MoveL, Posture

from .text import Frame, Location, Pace, Stretch
from .variables import Variables

#: What a corner without BREAK is read as, mm: V+ says that it is rounded, not by how much.
ROUNDED = 1.0
#: Posture words that exclude each other.
PAIRS = (("LEFTY", "RIGHTY"), ("ABOVE", "BELOW"), ("FLIP", "NOFLIP"), ("SINGLE", "MULTIPLE"))
POSTURES = frozenset(chain.from_iterable(PAIRS))


class Arm(Variables):
    """The arm while a text is carried out. body: what it does, in order. lines, frames: for each its line, and what its
    target is given in, None where it has no pose. turning: the rotational speeds, % of the rated one, each with the
    place in the body from which on it holds. rated: what SPEED 100 means, mm/s of the TCP.
    """

    def __init__(self, known: frozenset[str], rated: float) -> None:
        super().__init__(known)
        self.body: list[Instruction] = []
        self.lines: list[int] = []
        self.frames: list[Frame | None] = []
        self.turning: list[tuple[int, float]] = [(0, 100.0)]
        #: Least seconds of motions by their index in the body.
        self.durations: dict[int, float] = {}
        self._lasts_always, self._lasts_once = 0.0, 0.0
        self._rated = rated
        #: The place of the last motion in the body.
        self._last: int | None = None
        self._at: Location | Joints | None = None
        self._moving = False
        self._path = True
        self._always: Pace = (100.0, "%", 100.0)
        self._once: Pace | None = None
        self._monitor = 1.0
        self._posture: Posture | None = None

    def add(self, line: int, item: Instruction, frame: Frame | None = None) -> None:
        """One more instruction."""
        self.body.append(item)
        self.lines.append(line)
        self.frames.append(frame)

    def travel(
        self, line: int, target: Location | Joints, straight: bool, blend: float, share: float = 0.0
    ) -> None:
        """A motion at the speed in force. share: see ``MoveJ``."""
        setting, self._once = self._once or self._always, None
        self._turn(setting)
        self._last_for(len(self.body), len(self.body) + 1)
        speed = self._mm_per_second(setting)
        if isinstance(target, Joints):
            self.add(line, MoveJ(target, speed, blend, share=share))
        elif straight:
            self.add(line, MoveL(target.local, speed, blend, posture=self._posture), target.frame)
        else:
            self.add(
                line,
                MoveJ(target.local, speed, blend, posture=self._posture, share=share),
                target.frame,
            )
        self._at, self._moving, self._last = target, True, len(self.body) - 1

    def follow(self, plain: Stretch, frame: Frame, share: float = 0.0) -> None:
        """The motions of a stretch, in ``frame``."""
        first, others, count = self._once or self._always, self._always, len(plain.poses)
        self._once = None
        swing = (
            partial(MoveJ, posture=self._posture, share=share) if share or self._posture else MoveJ
        )
        made = (
            (partial(MoveL, posture=self._posture) if self._posture else MoveL)
            if plain.word == "MOVES"
            else swing
        )
        blend = ROUNDED if self._path else 0.0
        self._last_for(len(self.body), len(self.body) + count)
        self._turn(first)
        self.body.append(made(plain.poses[0], self._mm_per_second(first), blend))
        if count > 1:
            self._turn(others)
            self.body += map(
                made, plain.poses[1:], repeat(self._mm_per_second(others)), repeat(blend)
            )
        self.lines += range(plain.line, plain.line + count)
        self.frames += repeat(frame, count)
        self._at, self._moving, self._last = (
            Location(plain.poses[-1], frame),
            True,
            len(self.body) - 1,
        )

    def rest(self) -> None:
        """The motion comes to its end."""
        if self._last is not None:
            motion = self.body[self._last]
            if isinstance(motion, (MoveJ, MoveL)) and motion.blend:
                self.body[self._last] = replace(motion, blend=0.0)
        self._moving = False

    def set_pace(self, value: float, unit: str, turning: float, always: bool) -> None:
        """What a SPEED says."""
        if unit == "MONITOR":
            self._monitor = min(value, 100.0) / 100
        elif always:
            self._always, self._once = (value, unit, turning), None
        else:
            self._once = (value, unit, turning)

    def set_duration(self, seconds: float, always: bool) -> None:
        """The effect of a DURATION."""
        if always:
            self._lasts_always, self._lasts_once = seconds, 0.0
        else:
            self._lasts_once = seconds

    def _last_for(self, begin: int, end: int) -> None:
        """Notes the least time of the next motions, which the monitor speed scales.

        begin, end: their indices in the body.
        """
        seconds, self._lasts_once = self._lasts_once or self._lasts_always, 0.0
        for index in range(begin, end):
            if seconds:
                self.durations[index] = seconds / self._monitor
            seconds = self._lasts_always

    def set_posture(self, word: str) -> None:
        """A posture word: in force from the next motion on, and instead of the one that it excludes."""
        pair = next(pair for pair in PAIRS if word in pair)
        words = {*(self._posture.switches if self._posture else ()), word}
        words -= {*pair} - {word}
        self._posture = Posture(
            switches=tuple(word for both in PAIRS for word in both if word in words)
        )

    def _turn(self, setting: Pace) -> None:
        """Notes the rotational speed of the next motion."""
        rate = setting[2] * self._monitor
        if rate != self.turning[-1][1]:
            self.turning.append((len(self.body), rate))

    def _mm_per_second(self, setting: Pace) -> float:
        speed, unit, _ = setting
        if unit == "%":
            speed *= self._rated / 100
        return speed * self._monitor


def is_same(a: Pose | None, b: Pose | None) -> bool:
    """Whether two poses are equal to the last bit, or both missing."""
    if a is None or b is None:
        return a is b
    return a.origin == b.origin and bool((a.rotation == b.rotation).all())
