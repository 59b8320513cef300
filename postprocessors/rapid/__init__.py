"""ABB RAPID: modules for IRC5, OmniCore and, with ``s4``, S4 controllers (docs/posts/rapid.md).

Sources: RAPID kernel manual 3HAC16585-1; RAPID system data types and routines 3HAC 0966-13; tooldata in 3HAC050917-001.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from camgen.model.cell import Cell
from camgen.model.errors import JobError, Refused
from camgen.model.pose import FloatArray, Pose, quaternion, translation
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Instruction,
    Joints,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
    motions,
    take,
)
from camgen.model.text import counted, fixed, fixed_each, short
from camgen.post import OutputFile, Tolerance
from camgen.post.passes import without_force

from .force import DIGITS as FORCE_DIGITS
from .force import arc_fault, check_sections, settle, tool_axis
from .options import DIGITS, RapidOptions, legal_name, motion_data, speed_name, zone_name

#: Digits of a joint angle in deg; of a quaternion, whose square may differ from 1 by 1e-5.
_JOINT_DIGITS, _Q_DIGITS = 4, 7
_NO_AXES = "[9E9,9E9,9E9,9E9,9E9,9E9]"
#: confdata where no posture is known for sure; the supervision of postures is then off.
_NEUTRAL = "0,0,0,0"
#: Up to here a num (24 bits) tells 0.001 mm apart; least and greatest speed, mm/s, and least blend radius, mm.
_FARTHEST, _LEAST_SPEED_AND_ZONE, _FASTEST = 8388, 0.001, 99999
_IN, _IN2 = "    ", "        "


@dataclass
class Rapid(RapidOptions):
    """Posts RAPID."""

    name: ClassVar[str] = "rapid"
    suffix: ClassVar[str] = ".mod"
    about: ClassVar[str] = "ABB RAPID modules (IRC5, OmniCore, S4)"
    passes: ClassVar[tuple[str, ...]] = ("halves", "chords")
    verified_fields: ClassVar[frozenset[str]] = RapidOptions.verified_fields | {"confdata"}

    #: Rotations as they are printed, by identity, with the rotation itself: programs share them.
    _rotations: dict[int, tuple[FloatArray, str]] = field(default_factory=dict, init=False, repr=False)
    #: The change of force that the next motion makes.
    _change: Force | None = field(default=None, init=False, repr=False)
    #: What is printed behind the first motion.
    _calibration: tuple[str, ...] = field(default=(), init=False, repr=False)

    # -- legality ------------------------------------------------------------------------------------------------

    def prepare(self, program: Program, chord: float) -> Program:
        """See ``Post``; each change of force is moved to its motion, or all pressing left out where options say so."""
        if self.force == "ignore":
            program = without_force(program)
        index, first = next(motions(program.body), (-1, None))
        if first is not None and not isinstance(first.target, Joints):
            raise Refused(self.name, index, "the first motion must be to joint values; give the home position in deg")
        for frame in (program.base_from_work, program.flange_from_tool):
            if _far(frame):
                raise Refused(self.name, -1, f"a frame is farther than {_FARTHEST} mm from its base")
        return self._pressing_prepared(program, chord)

    def _pressing_prepared(self, program: Program, chord: float) -> Program:
        if not any(isinstance(item, Force) for item in program.body):
            return super().prepare(program, chord)
        check_sections(self.name, program.body)
        if self.force_load:
            index, first = next(motions(program.body))
            if first.blend:
                raise Refused(self.name, index, "the first motion must stop, so that FCCalib can follow it")
            self._calibration = (f"{_IN2}WaitTime\\InPos,0;", f"{_IN2}FCCalib {self.force_load};")
        prepared = super().prepare(program.with_body(settle(program.body, chord)), chord)
        check_sections(self.name, prepared.body)
        return prepared

    def accepts(self, columns: Columns) -> Mask:
        """Motions without joints to poses, in bounds, that are no arcs."""
        speed, blend = columns.speed, columns.blend
        fine = columns.posed & ~columns.moves_are(MoveC) & (speed >= _LEAST_SPEED_AND_ZONE) & (speed <= _FASTEST)
        fine &= (blend == 0) | ((blend >= _LEAST_SPEED_AND_ZONE) & (blend <= _FARTHEST))
        fine[fine] = (np.abs(columns.ends[fine]) <= _FARTHEST).all(axis=1)
        fine[fine] = [move.joints is None for move in take(columns.moves, fine)]
        accepted = columns.are(Comment)
        accepted[columns.at[fine]] = True
        return accepted

    def why_not(self, item: Instruction, start: Pose | None) -> str:
        """What RAPID, or its rules of names and numbers, does not allow."""
        match item:
            case Output():
                return self._why_not_output(item)
            case MoveC():
                return self._why_not_motion(item) or self._why_not_arc(item, start)
            case MoveJ() | MoveL():
                return self._why_not_motion(item)
        return ""

    def _why_not_output(self, item: Output) -> str:
        if item.signal not in self.signals:
            prefix = "ao" if item.signal == "spindle" else "do"
            return f'no output is named for {item.signal}; set post.signals, e.g. {item.signal} = "{prefix}Name"'
        if item.signal != "spindle" and item.value not in (0, 1):
            return f"{item.signal} is a digital output and cannot be {item.value:g}; use 0 or 1"
        return ""

    def _why_not_motion(self, motion: Motion) -> str:
        target = motion.target
        for joints in (target, motion.joints):
            if isinstance(joints, Joints) and len(joints.values) != 6:
                return f"{counted(len(joints.values), 'joint value')}; RAPID here is for arms of six axes"
        if (isinstance(target, Pose) and _far(target)) or (isinstance(motion, MoveC) and _far(motion.via)):
            return f"a coordinate of more than {_FARTHEST} mm, which a num does not carry exactly"
        if not _LEAST_SPEED_AND_ZONE <= motion.speed <= _FASTEST:
            return f"a speed of {motion.speed:g} mm/s; use {_LEAST_SPEED_AND_ZONE} to {_FASTEST}"
        if motion.blend and not _LEAST_SPEED_AND_ZONE <= motion.blend <= _FARTHEST:
            return f"a blend radius of {motion.blend:g} mm; use 0, or {_LEAST_SPEED_AND_ZONE} to {_FARTHEST}"
        return ""

    def _why_not_arc(self, arc: MoveC, start: Pose | None) -> str:
        if start is None:
            return "an arc from a pose that is not known; put a straight motion before it"
        if arc.force > 0 and not self.force_arcs:
            return "an arc while pressing; use straight motions, or post.force_arcs = true for FCPressC"
        return arc_fault(start.origin, arc.via.origin, arc.target.origin, 10**-self.decimals)

    # -- instructions --------------------------------------------------------------------------------------------

    def print_force(self, item: Force) -> Sequence[str]:
        """Force on and off are part of the next motion."""
        self._change = item
        return ()

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """MoveAbsJ to joints, in deg, else MoveJ. After the first one, in the air, the force sensor is set to zero."""
        if isinstance(motion.target, Pose):
            return (f"{_IN2}MoveJ {self._target(motion.target, motion)},{self._tail(motion)};",)
        angles = ",".join(fixed(math.degrees(v), _JOINT_DIGITS) for v in motion.target.values)
        rest = f"{speed_name(motion.speed)},{zone_name(motion.blend)},{self.tool}"
        calibration, self._calibration = self._calibration, ()
        return (f"{_IN2}MoveAbsJ [[{angles}],{_NO_AXES}],{rest};", *calibration)

    def movel(self, motion: MoveL) -> Sequence[str]:
        """MoveL, or the FCPress instruction in its place."""
        target = self._target(motion.target, motion)
        change, self._change = self._change, None
        if change is None:
            force = f"FCPressL {target}" if motion.force > 0 else f"MoveL {target}"
            return (f"{_IN2}{force},{self._tail(motion)};",)
        speed = speed_name(motion.speed)
        if change.newtons == 0:
            return (f"{_IN2}FCPressEnd {target},{speed},{self.tool}\\WObj:={self.work};",)
        axis, newtons = self._pressing(motion)
        more = "".join(
            f"\\{name}:={short(value, DIGITS)}"
            for name, value in (("ForceChange", self.force_change), ("PosSupvDist", self.force_distance))
            if value
        )
        rest = f"{zone_name(motion.blend)},{self.tool}\\WObj:={self.work};"
        threshold = short(self.force_threshold, DIGITS)
        return (
            f"{_IN2}FCPress1LStart {target},",
            f"{_IN2}{_IN}{speed},\\F{axis}:={newtons},{threshold}{more},{rest}",
        )

    def movec(self, motion: MoveC) -> Sequence[str]:
        """MoveC, or FCPressC, on two lines to keep them short."""
        word = "FCPressC" if motion.force > 0 else "MoveC"
        return (
            f"{_IN2}{word} {self._target(motion.via, motion)},",
            f"{_IN2}{_IN}{self._target(motion.target, motion)},{self._tail(motion)};",
        )

    def output(self, item: Output) -> Sequence[str]:
        """SetDO, for the spindle SetAO."""
        word = "SetAO" if item.signal == "spindle" else "SetDO"
        return (f"{_IN2}{word} {self.signals[item.signal]},{short(item.value, DIGITS)};",)

    def wait(self, item: Wait) -> Sequence[str]:
        """WaitTime, s."""
        return (f"{_IN2}WaitTime {short(item.seconds, DIGITS)};",)

    def comment(self, text: str) -> str:
        """A line of its own, as the manual asks."""
        return f"{_IN2}! {text}"

    # -- parts of an instruction ---------------------------------------------------------------------------------

    def _target(self, pose: Pose, motion: Motion) -> str:
        """A robtarget written out: cheaper in program memory than a named one."""
        known = motion.posture.confdata if motion.posture and self.conf != "off" else None
        conf = ",".join(map(str, known)) if known else _NEUTRAL
        return f"[[{fixed_each(pose.origin, self.decimals)}],[{self._rotation(pose)}],[{conf}],{_NO_AXES}]"

    def _rotation(self, pose: Pose) -> str:
        rotation = pose.rotation
        if id(rotation) not in self._rotations:
            self._rotations[id(rotation)] = rotation, ",".join(fixed(v, _Q_DIGITS) for v in quaternion(rotation))
        return self._rotations[id(rotation)][1]

    def _tail(self, motion: Motion) -> str:
        """Speed, force while pressing, zone, tool and work object."""
        force = ""
        if not isinstance(motion, MoveJ) and motion.force > 0:
            force = self._pressing(motion)[1] + ","
        return f"{speed_name(motion.speed)},{force}{zone_name(motion.blend)},{self.tool}\\WObj:={self.work}"

    def _pressing(self, motion: MoveL | MoveC) -> tuple[str, str]:
        """The tool axis along which a motion presses, and with how many N: negative against the axis."""
        found = tool_axis(motion.target.rotation, motion.force_direction)
        if found is None:
            raise Refused(self.name, -1, "a press direction that is no axis of the tool")
        axis, sign = found
        return "xyz"[axis], short(sign * self.force_sign * motion.force, FORCE_DIGITS)

    # -- files ---------------------------------------------------------------------------------------------------

    def begin(self, program: Program) -> Sequence[str]:
        """MODULE, header, data, and main up to its first instruction."""
        head = ["%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%"] if self.s4 else []
        head.append(f"MODULE {self.module_name(program)}")
        header = [self.note(line).strip() for line in program.header]
        if self.force == "ignore":
            header.append('! pressing is left out: post.force = "ignore"')
        head += [_IN + line for line in (*header, *self._frames(program), *motion_data(program))]
        return [*head, "", f"{_IN}PROC main()", *(_IN2 + line for line in self._supervision(program))]

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002 (the same for every program)
        """The ends of main and of the module."""
        return f"{_IN}ENDPROC", "ENDMODULE"

    def _frames(self, program: Program) -> list[str]:
        if not self.declare:
            return []
        pers = "PERS" if self.s4 else "TASK PERS"
        tool, work = (
            f"[[{','.join(fixed(v, self.decimals) for v in pose.origin)}],[{self._rotation(pose)}]]"
            for pose in (program.flange_from_tool, program.base_from_work)
        )
        cog = ",".join(short(v, DIGITS) for v in self.cog)
        load = f"[{short(self.mass, DIGITS)},[{cog}],[1,0,0,0],0,0,0]"
        return [
            f"{pers} tooldata {self.tool}:=[TRUE,{tool},{load}];",
            f'{pers} wobjdata {self.work}:=[FALSE,TRUE,"",{work},[[0,0,0],[1,0,0,0]]];',
        ]

    def _supervision(self, program: Program) -> list[str]:
        """ConfJ and ConfL: on where every motion of the kind knows its posture."""
        lines = []
        for word, kinds in (("ConfJ", (MoveJ,)), ("ConfL", (MoveL, MoveC))):
            columns = program.columns
            found = take(columns.moves, columns.moves_are(*kinds) & columns.posed)
            on = self.conf == "auto" and found and all(m.posture and m.posture.confdata for m in found)
            lines.append(f"{word}\\{'On' if on else 'Off'};")
        return lines

    def module_name(self, program: Program) -> str:
        """The name of the main module."""
        if self.program:
            return self.program
        name = legal_name(program.name, self.longest - len("_part9999"))
        taken = {self.tool.lower(), self.work.lower(), *(v.lower() for v in self.signals.values())}
        return f"m{name}" if name.lower() in taken else name

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """One module, or a main module that calls Part1, Part2, ... each in a module of its own."""
        if len(parts) == 1:
            return super().assemble(program, parts)
        name = self.module_name(program)
        if len(f"{name}_part{len(parts)}") > self.longest:
            what = f"{name!r} is too long for a program in {len(parts)} parts"
            raise JobError("[post] program", what, remedy="shorten it or raise post.max_lines")
        calls = [f"{_IN2}Part{k};" for k in range(1, len(parts) + 1)]
        files = [self._file(program.name, [*self.begin(program), *calls, *self.end(program)])]
        for k, part in enumerate(parts, start=1):
            lines = [f"MODULE {name}_part{k}", f"{_IN}PROC Part{k}()", *part, f"{_IN}ENDPROC", "ENDMODULE"]
            files.append(self._file(f"{program.name}_part{k}", lines))
        return tuple(files)

    def _file(self, stem: str, lines: Sequence[str]) -> OutputFile:
        return OutputFile(stem + self.suffix, "\n".join(lines) + "\n")

    @classmethod
    def cell(cls) -> Cell:
        """ABB IRB 120 with a 200 x 150 mm sheet in front of it; its home keeps axis 5 off its singularity."""
        home = Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0))
        return Cell("ABB IRB 120", translation(300, -75, 100), translation(0, 0, 100), home, robot="IRB 120")

    def list_verified(self) -> frozenset[str]:
        """Tool and work object are in the text where it declares them, the posture unless it is not to be."""
        frames: frozenset[str] = frozenset({"work", "tool"}) if self.declare else frozenset()
        return (self.verified_fields | frames) - ({"confdata"} if self.conf == "off" else frozenset())

    def tolerance(self) -> Tolerance:
        """Half the last printed digit; an orientation loses at most 2e-7 rad to its seven digits, pressing 5e-7."""
        half = 0.5 * 10**-DIGITS
        joint = math.radians(0.5 * 10**-_JOINT_DIGITS)
        return Tolerance(0.5 * 10**-self.decimals, 1e-6, joint, half, 0.5 * 10**-FORCE_DIGITS, half)


def _far(pose: Pose) -> bool:
    x, y, z = pose.origin
    return not (abs(x) <= _FARTHEST and abs(y) <= _FARTHEST and abs(z) <= _FARTHEST)
