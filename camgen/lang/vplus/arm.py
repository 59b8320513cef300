"""The arm during a run: its position, speed, blends and posture, and the instructions so far.

The strict read-back and the run of third-party programs each evaluate instructions in their own
way, and call this class with the result. Sources: V+ Language Reference and User's Guide as
docs/posts/vplus.md quotes them. A motion does not block, and blends into the next one unless BREAK
is between them. SPEED without ALWAYS is for one motion; it is 100 % at the start.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import chain, repeat

from msgspec.structs import replace

from camgen.model.instructions import NO_POSTURE
from camgen.model.pose import Pose
from camgen.model.program import Instruction, Joints, MoveJ, MoveL, Posture

from .text import Frame, Location, SpeedSetting, Stretch
from .variables import Variables

#: mm: assumed blend radius of a corner without BREAK. V+ rounds it by an unknown amount.
ROUNDED = 1.0
#: Posture words that exclude each other.
PAIRS = (("LEFTY", "RIGHTY"), ("ABOVE", "BELOW"), ("FLIP", "NOFLIP"), ("SINGLE", "MULTIPLE"))
POSTURES = frozenset(chain.from_iterable(PAIRS))


class Arm(Variables):
    """The arm during a run.

    body: instructions in order.
    lines: line of each instruction.
    frames: frame of the target of each instruction, None for one without a pose.
    turning: rotational speeds, % of the rated one, each after the index in `body` where it begins.
    durations: minimum seconds of motions, by their index in `body`.

    known: names of locations that are stored on the controller.
    rated: speed of the TCP at SPEED 100, mm/s.
    """

    def __init__(self, known: frozenset[str], rated: float) -> None:
        super().__init__(known)
        self.body: list[Instruction] = []
        self.lines: list[int] = []
        self.frames: list[Frame | None] = []
        self.turning: list[tuple[int, float]] = [(0, 100.0)]
        self.durations: dict[int, float] = {}
        self._lasts_always, self._lasts_once = 0.0, 0.0
        self._rated = rated
        #: Index of the last motion in the body.
        self._last: int | None = None
        self._at: Location | Joints | None = None
        self._moving = False
        self._path = True
        self._always: SpeedSetting = (100.0, "%", 100.0)
        self._once: SpeedSetting | None = None
        self._monitor = 1.0
        self._posture: Posture | None = None

    def add(self, line: int, item: Instruction, frame: Frame | None = None) -> None:
        """Add an instruction."""
        self.body.append(item)
        self.lines.append(line)
        self.frames.append(frame)

    def travel(
        self, line: int, target: Location | Joints, straight: bool, blend: float, share: float = 0.0
    ) -> None:
        """Add a motion at the speed in force. share: speed fraction of a `MoveJ`."""
        setting, self._once = self._once or self._always, None
        self._note_rotation_speed(setting)
        self._note_durations(len(self.body), len(self.body) + 1)
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
        """Add consecutive motions in a frame."""
        first, others, count = self._once or self._always, self._always, len(plain.poses)
        self._once = None
        make_motion: Callable[[Pose, float, float], Instruction]
        if plain.word == "MOVES":
            make_motion = partial(MoveL, posture=self._posture) if self._posture else MoveL
        elif share or self._posture:
            make_motion = partial(MoveJ, posture=self._posture, share=share)
        else:
            make_motion = MoveJ
        blend = ROUNDED if self._path else 0.0
        self._note_durations(len(self.body), len(self.body) + count)
        self._note_rotation_speed(first)
        self.body.append(make_motion(plain.poses[0], self._mm_per_second(first), blend))
        if count > 1:
            self._note_rotation_speed(others)
            self.body += map(
                make_motion, plain.poses[1:], repeat(self._mm_per_second(others)), repeat(blend)
            )
        self.lines += range(plain.line, plain.line + count)
        self.frames += repeat(frame, count)
        self._at = Location(plain.poses[-1], frame)
        self._moving, self._last = True, len(self.body) - 1

    def rest(self) -> None:
        """End the last motion at its target, without a blend."""
        if self._last is not None:
            motion = self.body[self._last]
            if isinstance(motion, (MoveJ, MoveL)) and motion.blend:
                self.body[self._last] = replace(motion, blend=0.0)
        self._moving = False

    def set_speed(self, value: float, unit: str, turning: float, always: bool) -> None:
        """Apply a SPEED."""
        if unit == "MONITOR":
            self._monitor = min(value, 100.0) / 100
        elif always:
            self._always, self._once = (value, unit, turning), None
        else:
            self._once = (value, unit, turning)

    def _note_durations(self, begin: int, end: int) -> None:
        """Note the minimum time of the next motions, which the monitor speed scales.

        begin, end: their indices in the body.
        """
        seconds, self._lasts_once = self._lasts_once or self._lasts_always, 0.0
        for index in range(begin, end):
            if seconds:
                self.durations[index] = seconds / self._monitor
            seconds = self._lasts_always

    def set_posture(self, word: str) -> None:
        """Apply a posture word from the next motion on. It replaces the word that it excludes."""
        pair = next(pair for pair in PAIRS if word in pair)
        words = {*(self._posture or NO_POSTURE).switches, word}
        words -= {*pair} - {word}
        all_words = chain.from_iterable(PAIRS)
        self._posture = Posture(switches=tuple(word for word in all_words if word in words))

    def _note_rotation_speed(self, setting: SpeedSetting) -> None:
        rate = setting[2] * self._monitor
        if rate != self.turning[-1][1]:
            self.turning.append((len(self.body), rate))

    def _mm_per_second(self, setting: SpeedSetting) -> float:
        speed, unit, _ = setting
        if unit == "%":
            speed *= self._rated / 100
        return speed * self._monitor


def is_same(a: Pose | None, b: Pose | None) -> bool:
    """Whether two poses are equal to the last bit, or both None."""
    if a is None or b is None:
        return a is b
    return a.origin == b.origin and bool((a.rotation == b.rotation).all())
