"""ABB RAPID: modules for IRC5, OmniCore and, with `s4`, S4 controllers (docs/posts/rapid.md).

Sources: RAPID kernel manual 3HAC16585-1; RAPID system data types and routines 3HAC 0966-13;
tooldata in 3HAC050917-001.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import ClassVar

import numpy as np

from camgen.geometry.vectors import are_within
from camgen.model.body import NUMBER
from camgen.model.cell import Cell, Dynamics
from camgen.model.errors import Refused
from camgen.model.part import Note
from camgen.model.pose import (
    FloatArray,
    Pose,
    compute_quaternion,
    format_frame,
    rotation_from_quaternion,
    translation,
)
from camgen.model.program import (
    Columns,
    Comment,
    Force,
    Indices,
    Instruction,
    Joints,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    Wait,
    motions,
)
from camgen.model.text import counted, fixed, fixed_each, short
from camgen.post import OutputFile, Tolerance, end_of
from camgen.post.passes import remove_force
from camgen.post.printed import (
    Forms,
    Lines,
    Printed,
    join_lines,
    make_forms,
    make_printed,
    round_numbers,
)
from camgen.post.values import choose_words, note_renamed

from .force import DIGITS as FORCE_DIGITS
from .force import (
    arc_fault,
    check_sections,
    choose_calibrations,
    find_round,
    find_wide,
    move_forces,
    stop_before_calibrations,
    tool_axis,
)
from .options import (
    DIGITS,
    FARTHEST,
    LONGEST,
    NO_MASS,
    SAFE,
    RapidOptions,
    Speed,
    is_predefined,
    legal_name,
    motion_data,
    name_speeds,
    speed_text,
    zone_name,
)
from .routines import Names, Routine, call, divide_body, divide_items

#: Digits of a joint angle in deg; of a quaternion, whose square may differ from 1 by 1e-5.
_JOINT_DIGITS, _Q_DIGITS = 4, 7
_NO_AXES = "[9E9,9E9,9E9,9E9,9E9,9E9]"
#: confdata of an unknown posture; the supervision of postures is then off.
_NEUTRAL = "0,0,0,0"
#: Minimum speed, mm/s and deg/s, and minimum blend radius, mm; and maximum speed.
_MIN_SPEED_AND_ZONE, _FASTEST = 0.001, 99999
#: rad: largest value of an axis of an arm with six axes.
_FARTHEST_AXIS = math.radians(450.0)
#: A reorientation by a rotation with a smaller trace is half a turn, within 0.2 deg.
_HALF_TURN = -1 + math.radians(0.2) ** 2
_IN, _IN2 = "    ", "        "
#: Ends force control that an aborted program has left on (both words from public force programs).
_DEACT = f"{_IN2}IF FCIsForceMode() FCDeact;"


@dataclass
class Rapid(RapidOptions):
    """The post for RAPID."""

    name: ClassVar[str] = "rapid"
    suffix: ClassVar[str] = ".mod"
    about: ClassVar[str] = "ABB RAPID modules (IRC5, OmniCore, S4)"
    passes: ClassVar[tuple[str, ...]] = ("halves", "chords")
    verified_fields: ClassVar[frozenset[str]] = RapidOptions.verified_fields | {
        "confdata",
        "turn",
        "via-orientation",
    }

    #: Rotations as they are printed, by identity, with the rotation itself: programs share them.
    _rotations: dict[int, tuple[FloatArray, str]] = field(
        default_factory=dict, init=False, repr=False
    )
    #: Speed, zone, tool and work object as they are printed, by speed, blend and turn.
    _tails: dict[tuple[float, float, float], str] = field(
        default_factory=dict, init=False, repr=False
    )
    #: The change of force that the next motion makes.
    _change: Force | None = field(default=None, init=False, repr=False)
    #: Whether a motion is printed.
    _begun: bool = field(default=False, init=False, repr=False)
    #: The speeds that have a name.
    _named: frozenset[Speed] = field(default=frozenset(), init=False, repr=False)
    #: The names of routines and modules that the program has so far.
    _names: Names = field(
        default_factory=lambda: Names(LONGEST, ()), init=False, repr=False, compare=False
    )

    def list_changed(self) -> frozenset[str]:
        """Force, if it is left out."""
        return choose_words({"force": self.force == "ignore"})

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Post`. Each change of force is moved to its motion, or an option leaves it out."""
        if self.force == "ignore":
            program = remove_force(program)
        index, first = next(motions(program.body), (-1, None))
        if first is not None and not isinstance(first.target, Joints):
            raise Refused(
                self.name,
                index,
                "the first motion must be to joint values; give the home position in deg",
            )
        for frame in (program.base_from_work, program.flange_from_tool):
            if _is_far(frame):
                raise Refused(self.name, -1, f"a frame is farther than {FARTHEST} mm from its base")
        return self._prepare_forces(program, chord)

    def _prepare_forces(self, program: Program, chord: float) -> Program:
        if not _presses(program):
            return super().prepare(program, chord)
        check_sections(self.name, program.body)
        for index, item in enumerate(program.body):
            is_on = isinstance(item, Force) and item.newtons > 0
            if is_on and not (self.force_load or self.force_calibrated):
                raise Refused(
                    self.name,
                    index,
                    "the force sensor is not set to zero before pressing",
                    "give post.force_load, or post.force_calibrated = true if the cell does it",
                )
        body = move_forces(program.body, chord)
        if self.force_load:
            body = stop_before_calibrations(self.name, body)
        prepared = super().prepare(program.with_body(body), chord)
        check_sections(self.name, prepared.body)
        return prepared

    def accepts(self, columns: Columns) -> Mask:
        """Outputs, and motions to poses without joint values, in limits; arcs without faults."""
        speed, blend = columns.speed, columns.blend
        fine = columns.posed & (speed >= _MIN_SPEED_AND_ZONE) & (speed <= _FASTEST)
        turn = np.degrees(columns.turn)
        fine &= (turn == 0) | ((turn >= _MIN_SPEED_AND_ZONE) & (turn <= _FASTEST))
        fine &= (blend == 0) | ((blend >= _MIN_SPEED_AND_ZONE) & (blend <= FARTHEST))
        fine &= are_within(columns.ends, FARTHEST)
        places, special = columns.special
        fine[places] &= np.array([move.joints is None for move in special], np.bool_)
        fine &= ~_are_half_turns(columns)
        arcs = np.flatnonzero(fine & columns.moves_are(MoveC))
        fine[arcs] = self._accept_arcs(columns, arcs)
        accepted = columns.are(Comment) | columns.alike(
            Output, lambda item: not self.why_not(item, None, None)
        )
        accepted[columns.at[fine]] = True
        return accepted

    def refuses(self, columns: Columns) -> Mask:
        """Arcs that are certainly too wide."""
        refused = np.zeros(len(columns.at), np.bool_)
        arcs = columns.arcs[columns.arcs > 0]
        refused[arcs] = find_wide(columns.ends[arcs - 1], columns.vias_of(arcs), columns.ends[arcs])
        return refused

    def _accept_arcs(self, columns: Columns, arcs: Indices) -> Mask:
        # The start of the first motion is unknown, but it is not an arc.
        starts = np.where(arcs[:, None] > 0, columns.ends[arcs - 1], np.nan)
        vias = columns.vias_of(arcs)
        free = self.force_arcs | (columns.force[arcs] <= 0)
        fine: Mask = free & are_within(vias, FARTHEST)
        return fine & find_round(starts, vias, columns.ends[arcs], self.decimals)

    def why_not(self, item: Instruction, before: Motion | None, _after: Motion | None) -> str:
        """Return why RAPID, or its rules of names and numbers, does not allow `item`."""
        match item:
            case Output():
                return self._why_not_output(item)
            case MoveC():
                return self._why_not_motion(item) or self._why_not_arc(item, end_of(before))
            case MoveL():
                return self._why_not_motion(item) or _why_not_turn(item, end_of(before))
            case MoveJ():
                return self._why_not_motion(item)
            case Stop(optional=True):
                return "RAPID has no optional stop; leave it out, or make it a stop"
        return ""

    def _why_not_output(self, item: Output) -> str:
        if item.signal not in self.signals:
            example = f'{item.signal} = "{"ao" if item.signal == "spindle" else "do"}Name"'
            return f"no output is named for {item.signal}; set post.signals, e.g. {example}"
        if item.signal == "spindle" and item.value < 0:
            return (
                f"the spindle is to turn backwards ({-item.value:g} rpm)"
                ", and its output has the speed alone"
            )
        if item.signal != "spindle" and item.value not in (0, 1):
            return f"{item.signal} is a digital output and cannot be {item.value:g}; use 0 or 1"
        return ""

    def _why_not_motion(self, motion: Motion) -> str:
        target = motion.target
        for joints in (target, motion.joints):
            if isinstance(joints, Joints) and len(joints.values) != 6:
                values = counted(len(joints.values), "joint value")
                return f"{values}; RAPID here is for arms of six axes"
        if isinstance(target, Joints) and (far := max(map(abs, target.values))) > _FARTHEST_AXIS:
            return (
                f"an axis at {math.degrees(far):.0f} deg, which arms do not turn to"
                "; give 450 at most"
            )
        is_far = isinstance(target, Pose) and _is_far(target)
        if is_far or (isinstance(motion, MoveC) and _is_far(motion.via)):
            return f"a coordinate of more than {FARTHEST} mm, which a num does not carry exactly"
        turn, speeds = math.degrees(_get_turn(motion)), f"{_MIN_SPEED_AND_ZONE} to {_FASTEST}"
        if turn and not _MIN_SPEED_AND_ZONE <= turn <= _FASTEST:
            return f"a turn at {turn:g} deg/s; use {speeds} for process.turn"
        if not _MIN_SPEED_AND_ZONE <= motion.speed <= _FASTEST:
            return f"a speed of {motion.speed:g} mm/s; use {speeds}"
        if motion.blend and not _MIN_SPEED_AND_ZONE <= motion.blend <= FARTHEST:
            return (
                f"a blend radius of {motion.blend:g} mm"
                f"; use 0, or {_MIN_SPEED_AND_ZONE} to {FARTHEST}"
            )
        return ""

    def _why_not_arc(self, arc: MoveC, start: Pose | None) -> str:
        if start is None:
            return "an arc from a pose that is not known; put a straight motion before it"
        if arc.force > 0 and not self.force_arcs:
            return (
                "an arc while pressing; "
                "use straight motions, or post.force_arcs = true for FCPressC"
            )
        return arc_fault(start.origin, arc.via.origin, arc.target.origin, self.decimals)

    def print_force(self, item: Force) -> Sequence[str]:
        """Force is set with the next motion; before the first one it is switched off if on."""
        if not self._begun:
            return (_DEACT,)
        self._change = item
        return ()

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """MoveAbsJ to joint values in deg, otherwise MoveJ."""
        self._begun = True
        if isinstance(motion.target, Pose):
            return (f"{_IN2}MoveJ {self._target(motion.target, motion)},{self._tail(motion)};",)
        angles = ",".join(fixed(math.degrees(v), _JOINT_DIGITS) for v in motion.target.values)
        rest = f"{self._speed(motion)},{zone_name(motion.blend)},{self.tool}"
        return (f"{_IN2}MoveAbsJ [[{angles}],{_NO_AXES}],{rest};",)

    def movel(self, motion: MoveL) -> Sequence[str]:
        """MoveL, or the FCPress instruction that replaces it."""
        target = self._target(motion.target, motion)
        change, self._change = self._change, None
        if change is None:
            force = f"FCPressL {target}" if motion.force > 0 else f"MoveL {target}"
            return (f"{_IN2}{force},{self._tail(motion)};",)
        speed = self._speed(motion)
        if change.newtons == 0:
            return (f"{_IN2}FCPressEnd {target},{speed},{self.tool}\\WObj:={self.work};",)
        axis, newtons = self._pressing(motion)
        more = ""
        if self.force_change:
            more += f"\\ForceChange:={short(self.force_change, DIGITS)}"
        if self.force_distance:
            more += f"\\PosSupvDist:={short(self.force_distance, DIGITS)}"
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

    def stop(self, item: Stop) -> Sequence[str]:  # noqa: ARG002 (an optional one is refused)
        """Stop."""
        return (f"{_IN2}Stop;",)

    def comment(self, text: str) -> str:
        """A line of its own, as the manual asks."""
        return f"{_IN2}! {text}"

    def forms(self, program: Program) -> Forms | None:
        """Motions with only points, speed and zone; None for a program with force."""
        columns = program.columns
        if _presses(program):
            return None
        plain = np.ones(len(columns.at), np.bool_)
        plain[columns.special[0]] = False
        rows = np.flatnonzero(plain)
        arcs = columns.arcs
        via_rotation = np.zeros(len(plain), np.int32)
        via_rotation[arcs] = columns.via_rotation
        speeds, speed = np.unique(columns.speed[rows], return_inverse=True)
        blends, blend = np.unique(columns.blend[rows], return_inverse=True)
        numbers, used = np.zeros((len(plain), 6)), np.ones((len(plain), 6), np.bool_)
        numbers[arcs, :3] = round_numbers(columns.via, self.decimals)
        numbers[:, 3:] = round_numbers(columns.ends, self.decimals)
        used[:, :3] = columns.moves_are(MoveC)[:, None]
        numbers, used = numbers[rows], used[rows]
        point = ",".join([f"%.{self.decimals}f"] * 3)

        def form(kind: int, rotation: int, via: int, speed: int, blend: int) -> str:
            to, through = (
                self._target_of(point, columns.table[place], _NEUTRAL) for place in (rotation, via)
            )
            tail = self._tail_of(float(speeds[speed]), float(blends[blend]), 0.0)
            if kind == NUMBER[MoveC]:
                return f"{_IN2}MoveC {through},\n{_IN2}{_IN}{to},{tail};"
            return f"{_IN2}{'MoveJ' if kind == NUMBER[MoveJ] else 'MoveL'} {to},{tail};"

        plain_columns = columns.kinds[rows], columns.rotation[rows], via_rotation[rows]
        return make_forms(rows, [*plain_columns, speed, blend], form, numbers, used)

    def _target(self, pose: Pose, motion: Motion) -> str:
        conf, posture = _NEUTRAL, motion.posture
        if posture and posture.confdata and self.conf != "off":
            conf = ",".join(map(str, posture.confdata))
        return self._target_of(fixed_each(pose.origin, self.decimals), pose.rotation, conf)

    def _target_of(self, point: str, rotation: FloatArray, conf: str) -> str:
        return f"[[{point}],[{self._rotation(rotation)}],[{conf}],{_NO_AXES}]"

    def _rotation(self, rotation: FloatArray) -> str:
        if id(rotation) not in self._rotations:
            text = ",".join(fixed(v, _Q_DIGITS) for v in compute_quaternion(rotation))
            self._rotations[id(rotation)] = (rotation, text)
        return self._rotations[id(rotation)][1]

    def _speed(self, motion: Motion) -> str:
        return speed_text(motion.speed, _get_turn(motion), self._named)

    def _tail(self, motion: Motion) -> str:
        if not isinstance(motion, MoveJ) and motion.force > 0:
            force = self._pressing(motion)[1] + ","
            return self._end(motion.speed, motion.blend, _get_turn(motion), force)
        return self._tail_of(motion.speed, motion.blend, _get_turn(motion))

    def _tail_of(self, speed: float, blend: float, turn: float) -> str:
        key = speed, blend, turn
        if key not in self._tails:
            self._tails[key] = self._end(*key, "")
        return self._tails[key]

    def _end(self, speed: float, blend: float, turn: float, force: str) -> str:
        text = speed_text(speed, turn, self._named)
        return f"{text},{force}{zone_name(blend)},{self.tool}\\WObj:={self.work}"

    def _pressing(self, motion: MoveL | MoveC) -> tuple[str, str]:
        """Return the tool axis along which a motion presses, and the force, N.

        A force against the axis is negative.
        """
        axis_and_sign = tool_axis(motion.target.rotation, motion.force_direction)
        if axis_and_sign is None:
            raise Refused(self.name, -1, "a press direction that is not an axis of the tool")
        axis, sign = axis_and_sign
        return "xyz"[axis], short(sign * self.force_sign * motion.force, FORCE_DIGITS)

    def begin(self, program: Program) -> Sequence[str]:
        """MODULE, header, data, and main up to its first instruction."""
        head = ["%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%"] if self.s4 else []
        head.append(f"MODULE {self.module_name(program)}")
        header = [self.note(line).strip() for line in program.header]
        header += [f"! {line}" for line in self._list_assumptions(program)]
        data = motion_data(program.columns, self._named)
        head += [_IN + line for line in (*header, *self._frames(program), *data)]
        return [*head, "", f"{_IN}PROC main()", *(_IN2 + line for line in self._settings(program))]

    def _load(self) -> tuple[str, str] | None:
        if not self.declare or self.mass > NO_MASS:
            return None
        mass = f"tool mass {short(self.mass, DIGITS)} kg is a placeholder"
        remedy = (
            "set post.mass and post.cog, or post.declare = false for the tool of the controller"
        )
        return f"{mass} - loading this module overwrites {self.tool}", remedy

    def warn(self, program: Program) -> tuple[Note, ...]:
        """The load of a declared tool without a mass, for `--strict`, and another name."""
        load = self._load()
        notes = (Note("assumed", *load, strict=True),) if load else ()
        if self.program or not is_predefined(program.name):
            return notes
        return *notes, *note_renamed(program.name, self.module_name(program), "RAPID")

    def end(self, program: Program) -> Sequence[str]:
        """The ends of main and of the module."""
        return *self._handler(program, main=True), f"{_IN}ENDPROC", "ENDMODULE"

    def _list_assumptions(self, program: Program) -> Iterator[str]:
        yield from (f"load: {line}" for line in self._load() or ())
        if not self.declare:
            frames = {self.tool: program.flange_from_tool, self.work: program.base_from_work}
            for name, frame in frames.items():
                pose = format_frame(frame)
                yield f"{name} must be on the controller with the frame {pose} mm, deg"
        if self.force == "ignore":
            yield 'pressing is left out: post.force = "ignore"'
        if not _presses(program):
            return
        sense = "along" if self.force_sign > 0 else "against"
        yield (
            "force: Machining FC is installed; "
            f"a positive force pushes {sense} the axis of the tool"
        )
        threshold = short(self.force_threshold, DIGITS)
        yield f"force: travel begins when {threshold} % of the force is felt"
        zero = "the cell, before this program"
        if self.force_load:
            zero = f"FCCalib {self.force_load} in the air"
        yield f"force: the sensor is set to zero by {zero}"

    def _outputs(self, program: Program) -> list[str]:
        signals = dict.fromkeys(item.signal for item in program.columns.outputs)
        return list(chain.from_iterable(self.output(Output(name, 0.0)) for name in signals))

    def _handler(self, program: Program, *, main: bool) -> list[str]:
        outputs = self._outputs(program)
        deact = _presses(program)
        if self.on_error == "none" or not (outputs or deact):
            return []
        if not main:
            return [f"{_IN}ERROR", f"{_IN2}RAISE;"]
        lines = [*call(SAFE)] if outputs else []
        if deact:
            lines.append(_DEACT)
        return [f"{_IN}ERROR", *lines, f"{_IN2}{self.on_error.upper()};"]

    def _safe(self, program: Program) -> list[str]:
        outputs = self._outputs(program)
        if not outputs or self.on_error == "none":
            return []
        return ["", f"{_IN}PROC {SAFE}()", *outputs, f"{_IN}ENDPROC"]

    def _proc(self, routine: Routine, end: str) -> Lines:
        lines = routine.lines
        size = 2 + len(lines) + end.count("\n") + 1
        return Lines((f"\n{_IN}PROC {routine.name}()", *lines.pieces, end), lines.printed, size)

    def _frames(self, program: Program) -> list[str]:
        if not self.declare:
            return []
        pers = "PERS" if self.s4 else "TASK PERS"
        tool = self._frame(program.flange_from_tool, self.decimals)
        fixture = self.place_fixture(program.base_from_work)
        user, thing = self._frame(fixture, self.decimals), "[[0,0,0],[1,0,0,0]]"
        if self.fixture:
            # From the printed user frame, with one more digit, so that roundings do not add up.
            fixture_from_work = _round(fixture, self.decimals).inverse() @ program.base_from_work
            thing = self._frame(fixture_from_work, self.decimals + 1)
        cog = ",".join(short(v, DIGITS) for v in self.cog)
        load = f"[{short(self.mass, DIGITS)},[{cog}],[1,0,0,0],0,0,0]"
        return [
            f"{pers} tooldata {self.tool}:=[TRUE,{tool},{load}];",
            f'{pers} wobjdata {self.work}:=[FALSE,TRUE,"",{user},{thing}];',
        ]

    def _frame(self, pose: Pose, decimals: int) -> str:
        return f"[[{fixed_each(pose.origin, decimals)}],[{self._rotation(pose.rotation)}]]"

    def _settings(self, program: Program) -> list[str]:
        """Print the settings of main before it moves.

        ConfJ and ConfL are on if the posture of every motion of the kind is known.
        """
        lines = []
        columns = program.columns
        known = np.zeros(len(columns.at), np.bool_)
        places, special = columns.special
        known[places] = [bool(move.posture and move.posture.confdata) for move in special]
        for word, kinds in (("ConfJ", (MoveJ,)), ("ConfL", (MoveL, MoveC))):
            rows = columns.moves_are(*kinds) & columns.posed
            on = self.conf == "auto" and rows.any() and known[rows].all()
            lines.append(f"{word}\\{'On' if on else 'Off'};")
        if self.sing_area:
            lines.append(f"SingArea\\{self.sing_area.capitalize()};")
        if self.acc_set:
            lines.append(f"AccSet {','.join(short(v, DIGITS) for v in self.acc_set)};")
        return lines

    def module_name(self, program: Program) -> str:
        """Name the main module."""
        if self.program:
            return self.program
        name = legal_name(program.name, self.longest - len("_part9999"))
        return f"m{name}" if name.lower() in self._given() else name

    def _given(self) -> set[str]:
        names = self.tool, self.work, self.force_load, *self.signals.values()
        return {name.lower() for name in names}

    def split(self, program: Program, printed: Iterable[Sequence[str]]) -> Sequence[Lines]:
        """The body of main, then whole routines that it calls."""
        self._begun, self._change = False, None
        self._named = name_speeds(program.columns)
        self._tails.clear()
        self._names = Names(self.longest, {*self._given(), self.module_name(program).lower()})
        calibrated = self._add_calibrations(program, make_printed(program.columns, printed))
        main, *routines = divide_body(program, calibrated, self.max_lines, self._names)
        end = "\n".join((*self._handler(program, main=False), f"{_IN}ENDPROC"))
        return [main.lines, *(self._proc(routine, end) for routine in routines)]

    def _add_calibrations(self, program: Program, printed: Printed) -> Printed:
        if not self.force_load:
            return printed
        after = choose_calibrations(self.name, program.body)
        extra = (f"{_IN2}WaitTime\\InPos,0;", f"{_IN2}FCCalib {self.force_load};")

        def add(instructions: Iterable[Sequence[str]]) -> Iterator[Sequence[str]]:
            for k, lines in enumerate(instructions):
                yield (*lines, *extra) if k in after else lines

        return printed.changed(add)

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """One module, or one with main and others with routines, of at most `max_lines` lines."""
        main, *routines = parts
        *end, endmodule = self.end(program)
        first = (self.begin(program), main, end, self._safe(program))
        if not self.max_lines or sum(map(len, parts)) <= self.max_lines:
            return (self._file(program.name, *first, *routines, [endmodule]),)
        files = [self._file(program.name, *first, [endmodule])]
        for k, group in enumerate(divide_items(routines, self.max_lines), start=1):
            name = self._names.give(f"{self.module_name(program)}_part{k}")
            files.append(
                self._file(f"{program.name}_part{k}", [f"MODULE {name}"], *group, [endmodule])
            )
        self._names = Names(self.longest, ())  # a long program has many names
        return tuple(files)

    def _file(self, stem: str, *parts: Sequence[str]) -> OutputFile:
        return OutputFile(stem + self.suffix, join_lines(*parts))

    @classmethod
    def cell(cls) -> Cell:
        """ABB IRB 120 with a 200 x 150 mm sheet in front of it; home is away from singularities."""
        home = Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0))
        work, tool = translation(300, -75, 100), translation(0, 0, 100)
        return Cell("ABB IRB 120", work, tool, home, robot="IRB 120")

    def dynamics(self) -> Dynamics:
        """An average arm, which rounds corners within zones."""
        return Dynamics(corner="zone", turns=True)

    def list_verified(self) -> frozenset[str]:
        """Tool and work object if the text declares them; the posture unless `conf` is off."""
        frames = choose_words({"work": self.declare, "tool": self.declare})
        return (self.verified_fields | frames) - choose_words({"confdata": self.conf == "off"})

    def tolerance(self) -> Tolerance:
        """Half of the last printed digit; an orientation loses 2e-7 rad at most, pressing 5e-7."""
        half = 0.5 * 10**-DIGITS
        joint = math.radians(0.5 * 10**-_JOINT_DIGITS)
        return Tolerance(0.5 * 10**-self.decimals, 1e-6, joint, half, 0.5 * 10**-FORCE_DIGITS, half)


def _presses(program: Program) -> bool:
    return bool(program.columns.are(Force).any())


def _are_half_turns(columns: Columns) -> Mask:
    mask = columns.moves_are(MoveL)
    mask[1:] &= columns.posed[:-1] & (columns.rotation[1:] != columns.rotation[:-1])
    mask[:1] = False
    rows = np.flatnonzero(mask)
    both = zip(columns.rotation[rows - 1].tolist(), columns.rotation[rows].tolist(), strict=True)
    mask[rows] = [_is_half_turn(columns.table[start], columns.table[end]) for start, end in both]
    return mask


def _is_half_turn(start: FloatArray, end: FloatArray) -> bool:
    return start is not end and float(np.vdot(start, end)) < _HALF_TURN


def _why_not_turn(line: MoveL, start: Pose | None) -> str:
    if start is None or not _is_half_turn(start.rotation, line.target.rotation):
        return ""
    return (
        "the tool turns by 180 deg in one straight motion and "
        "its sense is open; put a pose between, or a joint motion"
    )


def _get_turn(motion: Motion) -> float:
    return 0.0 if isinstance(motion, MoveC) else motion.turn


def _is_far(pose: Pose) -> bool:
    x, y, z = pose.origin
    return not (abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST)


def _round(pose: Pose, decimals: int) -> Pose:
    x, y, z = (float(fixed(v, decimals)) for v in pose.origin)
    q = [float(fixed(v, _Q_DIGITS)) for v in compute_quaternion(pose.rotation)]
    return Pose(rotation_from_quaternion(q), (x, y, z))
