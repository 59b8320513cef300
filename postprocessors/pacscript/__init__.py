"""DENSO PacScript for RC8, RC8A and RC9 controllers.

docs/posts/pacscript.md describes the text and its uncertain parts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice, takewhile
from typing import ClassVar

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle
from camgen.model.cell import Cell
from camgen.model.errors import Refused
from camgen.model.instructions import NO_POSTURE
from camgen.model.part import Note
from camgen.model.pose import IDENTITY, Pose, Vec3, angle_between, compute_fixed_xyz, translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    ToolChange,
    Wait,
)
from camgen.model.text import counted, fixed, harmless, short
from camgen.post import OutputFile, Tolerance, end_of
from camgen.post.passes import remove_force
from camgen.post.values import choose_line, choose_words, note_renamed

from .options import PacScriptOptions, derive, is_reserved

#: Digits of an angle (deg), of a speed in mm/s and in percent, of a force (N).
_ANGLE, _SPEED, _PERCENT, _NEWTON, _INDENT = 4, 4, 4, 3, "    "
#: Maximum length of a line, bytes; maximum delay, ms (a signed 32-bit integer); maximum force, N;
#: and smallest change of a force component that is printed, N.
_LONGEST_LINE, _LONGEST_DELAY_MS, _MAX_FORCE_N, _FORCE_STEP_N = 1024, 2**31 - 1, 5000.0, 0.01
#: Range of an internal speed, %; and the speed at 100 % of the fastest arm, mm/s.
_MIN_PERCENT, _MAX_PERCENT, _FASTEST_ARM = 0.1, 100.0, 11_000.0
#: Finds the unit in which Mps reads its number, and ends if Mps gives no percentage in either unit.
_ASK = """\
' Mps() is a percentage: 0.1 m/s is over 0.5 % of any arm, 0.1 mm/s not over 0.1 %
Dim unit As Single = 1
If Mps(0.1) > 0.2 Then
    unit = 0.001
End If
' now Mps(100 * unit) is 100 mm/s; no motion where that is not 0.5 to 20 %
If Mps(100 * unit) < 0.5 Or Mps(100 * unit) > 20 Then
    GiveArm
    Exit Sub
End If""".splitlines()
#: Minimum chord of an arc, mm, and maximum reorientation along it, rad. Beyond these, the path of
#: the controller is open.
_MIN_CHORD_MM, _MAX_TOOL_TURN = 0.2, math.radians(179.0)


@dataclass
class PacScript(PacScriptOptions):
    """The post for PacScript.

    Poses are in the work frame, mm and degrees with R = Rz Ry Rx, with the figure if it is known,
    otherwise -1 (undefined).
    """

    name: ClassVar[str] = "pacscript"
    suffix: ClassVar[str] = ".pcs"
    about: ClassVar[str] = "DENSO RC8, RC8A and RC9 (PacScript)"
    newline: ClassVar[str] = "\r\n"
    passes: ClassVar[tuple[str, ...]] = ("halves", "chords")
    verified_fields: ClassVar[frozenset[str]] = frozenset(
        {
            "orientation",
            "speed",
            "joint-speed",
            "joint-share",
            "stop",
            "turn",
            "force-direction",
            "figure",
        }
    )

    #: The force that the controller presses with (N, work frame), None while force control is off.
    _pressing: Vec3 | None = field(default=None, init=False, repr=False)
    _angles: dict[bytes, str] = field(default_factory=dict, init=False, repr=False)

    def why_not(self, item: Instruction, before: Motion | None, _after: Motion | None) -> str:
        """Return the first reason against `item`, with its remedy."""
        match item:
            case Output():
                return self._output_reason(item)
            case Wait() if item.seconds * 1000 > _LONGEST_DELAY_MS:
                return "the wait is longer than a Delay holds; shorten it"
            case Force():
                return self._force_reason(item.newtons, item.force_direction)
            case Stop():
                return "the post has no stop for the operator; leave it out"
            case Wait() | Comment() | ToolChange():
                return ""
        reason = self._speed_reason(item.speed) or self._turn_reason(item)
        if not reason and self.pass_mark == "mm" and item.blend != int(item.blend):
            reason = (
                f'a blend of {item.blend:g} mm is not a whole number; set post.pass_mark to "P"'
            )
        if isinstance(item, MoveJ):
            return reason or _joints_reason(item)
        if item.force > 0:
            reason = reason or self._force_reason(item.force, item.force_direction)
        return reason or (self._arc_reason(item, end_of(before)) if isinstance(item, MoveC) else "")

    def _output_reason(self, item: Output) -> str:
        if item.signal not in self.signals:
            return f"the signal {item.signal} has no IO number; add it to post.signals"
        if item.signal == "spindle":
            if item.value < 0:
                speed = f"{-item.value:g} rpm"
                return f"the spindle is to turn backwards ({speed}), and an IO is on or off"
            if self.spindle != "on-off":
                remedy = 'set the speed at its drive and post.spindle to "on-off"'
                return f"an IO does not carry a spindle speed; {remedy}"
        elif item.value not in (0, 1):
            return f"an IO is on or off, not {item.value:g}; use 0 or 1"
        return ""

    def _percent(self, mm_s: float) -> float:
        return 100 * self._scaled(mm_s) / self.rated

    def _scaled(self, mm_s: float) -> float:
        """Compute the internal speed that gives `mm_s`; the external speed multiplies it."""
        return mm_s * 100 / (self.ext_speed or 100)

    def _turning(self, motion: MoveL) -> float:
        return self._scaled(100 * math.degrees(motion.turn) / self.rated_turn)

    def _turn_reason(self, item: Motion) -> str:
        if not isinstance(item, MoveL) or not item.turn:
            return ""
        # As it is printed: a turn at exactly the rated speed may be above 100 % by rounding.
        if _MIN_PERCENT <= round(self._turning(item), _PERCENT) <= _MAX_PERCENT:
            return ""
        turn, percent = math.degrees(item.turn), self._turning(item)
        return (
            f"a turn at {turn:g} deg/s is {percent:.4g} % of {self.rated_turn:g}, "
            "the controller takes 0.1 to 100 %; change process.turn or correct post.rated_turn"
        )

    def _speed_reason(self, mm_s: float) -> str:
        if self.rated and not _MIN_PERCENT <= self._percent(mm_s) <= _MAX_PERCENT:
            return (
                f"{mm_s:g} mm/s is {self._percent(mm_s):.4g} % of the rated {self.rated:g} mm/s, "
                "the controller takes 0.1 to 100 %; change the speed or correct post.rated"
            )
        if mm_s < 0.05:
            return f"{mm_s:g} mm/s is too slow to be written to 0.1 %; raise the speed"
        return ""

    def _force_reason(self, newtons: float, press: Vec3) -> str:
        if newtons <= 0:
            return ""
        if self.force == "refuse":
            return (
                "the arguments of force control are not public; "
                'check post.force_on and set post.force to "template", or to "ignore"'
            )
        if newtons > _MAX_FORCE_N:
            limit = f"the {_MAX_FORCE_N:g} N of a force table"
            return f"{newtons:g} N is more than {limit}; lower the force"
        if abs(math.hypot(*press) - 1) < 1e-3:
            return ""
        return "the force has no direction; follow one side of the contour"

    def _arc_reason(self, arc: MoveC, start: Pose | None) -> str:
        if start is None:
            return "an arc starts where the text gives no pose; move to a pose first"
        _, radius, _, sweep = compute_circle(start.origin, arc.via.origin, arc.target.origin)
        if sweep > math.pi + 1e-6:
            return "an arc of more than 180 deg; halve it"
        if angle_between(start.rotation, arc.target.rotation) > _MAX_TOOL_TURN:
            return "the tool turns by 180 deg along an arc and its sense is open; halve it"
        sagitta = radius * (1 - math.cos(sweep / 2))
        if 2 * radius * math.sin(sweep / 2) < _MIN_CHORD_MM or sagitta < 10 * 10**-self.decimals:
            return "the arc is too small or too flat for its digits; use lines"
        if arc.force > 0 and self.force == "template":
            return "the direction of the force would not turn along an arc; use lines"
        return ""

    def list_verified(self) -> frozenset[str]:
        """Tool and work frame if the text defines them; the blend radius if it is in mm."""
        given = {
            "tool": self.define and bool(self.tool),
            "work": self.define and bool(self.work),
            "blend": self.pass_mark == "mm",
        }
        return self.verified_fields | choose_words(given)

    def list_changed(self) -> frozenset[str]:
        """Force, if it is left out, and the speed of the spindle, which an IO does not carry."""
        return choose_words({"force": self.force == "ignore", "spindle": self.spindle == "on-off"})

    def prepare(self, program: Program, chord: float) -> Program:
        """See `Post`. May leave out force, and replaces spindle speeds by comments."""
        for option, frame in (("tool", program.flange_from_tool), ("work", program.base_from_work)):
            difference = [*frame.origin, *(frame.rotation - IDENTITY).flat]
            if not getattr(self, option) and not np.allclose(difference, 0):
                raise Refused(
                    self.name,
                    -1,
                    f"{option} 0 is the controller's own, but the program has a frame of its own",
                    f"give post.{option} from 1 on",
                )
        if self.force == "ignore":
            program = remove_force(program)
        prepared = super().prepare(program, chord)
        body: list[Instruction] = []
        for item in prepared.body:
            if isinstance(item, Output) and item.signal == "spindle" and item.value not in (0, 1):
                body.append(Comment(f"spindle at {item.value:g} rpm: set at its drive"))
                body.append(replace(item, value=1.0))
            else:
                body.append(item)
        return prepared if len(body) == len(prepared.body) else prepared.with_body(tuple(body))

    @property
    def _asks(self) -> bool:
        return self.speed == "mps" and self.mps == "ask"

    def begin(self, program: Program) -> Sequence[str]:
        """Title, remarks and settings.

        Raises Refused for a joint motion beyond the range of an internal speed.
        """
        self._check_shares(program)
        first = next((item for item in program.body if isinstance(item, MoveJ)), None)
        posture = "that of the arm at the start"
        if first is not None and isinstance(first.target, Joints):
            posture = "fixed by the first joint move"
        if any(_figure(item) is not None for item in program.columns.moves):
            posture += ", then by Fig; -1: as it is"
        lines = [
            f'\'!TITLE "{harmless(program.name)}"',
            *(self.note(line) for line in program.header),
        ]
        order = "is set below to" if self.define else "must be set on the pendant to"
        frames = {
            f"work {self.work}": program.base_from_work,
            f"tool {self.tool}": program.flange_from_tool,
        }
        lines += [
            f"' {name} {order}: {self._pose(frame)} mm, deg" for name, frame in frames.items()
        ]
        lines.append(f"' posture: {posture}")
        if self.force == "ignore":
            lines.append("' pressing is left out")
        elif any(isinstance(item, Force) for item in program.body):
            table = f"table {self.force_table}, N in the work frame"
            lines.append(f"' force: {table}; lines that say verify are assumed")
            lines.append("' force: the sensor is set to zero by the cell, before this program")
        external = "the pendant's, 100 % for the planned speeds"
        if self.ext_speed:
            external = f"{self.ext_speed:g} %"
        if self.rated:
            external += f", 100 % is {self.rated:g} mm/s"
        lines.append(f"' external speed: {external}")
        if slow := self._slowest(program):
            lines.append(f"' slowest motion: {slow}")
        lines.append("Sub Main")
        return [*lines, *(_INDENT + line for line in self._settings(program))]

    def _check_shares(self, program: Program) -> None:
        columns = program.columns
        percent = self._scaled(100.0) * columns.share
        is_wrong = (percent > 0) & ~((percent >= _MIN_PERCENT) & (percent <= _MAX_PERCENT))
        for motion in np.flatnonzero(is_wrong)[:1]:
            mm_s = columns.moves[motion].speed
            raise Refused(
                self.name,
                int(columns.at[motion]),
                f"{mm_s:g} mm/s is {percent[motion]:.4g} % of what the joints can do on this way",
                "the controller takes 0.1 to 100 %; change the speed or post.ext_speed",
            )

    def _slowest(self, program: Program) -> str:
        """Describe the slowest motion by Mps if it may be below 0.1 % of a fast arm, else empty."""
        columns = program.columns
        mm_s = columns.speed[(columns.share == 0) & (columns.turn == 0)].min(initial=np.inf)
        limit = 100 * self._scaled(float(mm_s)) / _MIN_PERCENT
        if self.rated or self.speed == "percent" or limit >= _FASTEST_ARM:
            return ""
        arm = f"an arm that does more than {round(limit, -1):.0f} mm/s"
        return f"{short(mm_s, 2)} mm/s, under 0.1 % of {arm}"

    def warn(self, program: Program) -> tuple[Note, ...]:
        """A speed that may be below the minimum of the controller, and a changed name."""
        slow = self._slowest(program)
        why = "the controller takes 0.1 % at least; give post.rated, or raise the speed"
        notes = (Note("warning", f"slowest motion: {slow}", why),) if slow else ()
        if self.program or not is_reserved(program.name):
            return notes
        return *notes, *note_renamed(program.name, derive(program.name), "PacScript")

    def _settings(self, program: Program) -> list[str]:
        """Print all outputs off, the unit of Mps, and the settings that TakeArm may reset.

        Accel comes after Speed, which changes it too.
        """
        accel = short(self.accel, _PERCENT)
        lines = ["TakeArm Keep = 0"]
        for item in program.body[: _count_off(program)]:
            lines += self.line(item)
        if self._asks:
            lines += _ASK
        if self.ext_speed:
            lines.append(f"ExtSpeed {short(self.ext_speed, _PERCENT)}")
        lines += [f"Speed {short(self.internal_speed, _PERCENT)}", f"Accel {accel}, {accel}"]
        if self.define:
            lines.append(f"Tool {self.tool}, P({self._pose(program.flange_from_tool)})")
            lines.append(f"Work {self.work}, P({self._pose(program.base_from_work)})")
        return [*lines, f"ChangeTool {self.tool}", f"ChangeWork {self.work}"]

    def end(self, program: Program) -> Sequence[str]:  # noqa: ARG002
        """Gives the arm back."""
        return (f"{_INDENT}GiveArm", "End Sub")

    def movej(self, motion: MoveJ) -> Sequence[str]:
        """Move P to joints or to a pose."""
        if isinstance(motion.target, Joints):
            place = f"J({', '.join(fixed(math.degrees(v), _ANGLE) for v in motion.target.values)})"
        else:
            place = self._target(motion.target, motion)
        return (f"Move P, {self._mark(motion)} {place}{self._tail(motion)}",)

    def movel(self, motion: MoveL) -> Sequence[str]:
        """Move L, after its change of force."""
        target = self._target(motion.target, motion)
        line = f"Move L, {self._mark(motion)} {target}{self._tail(motion)}"
        return (*self._changed(motion), line)

    def movec(self, motion: MoveC) -> Sequence[str]:
        """Move C; the mark belongs to the end point."""
        via, end = (self._target(pose, motion) for pose in (motion.via, motion.target))
        return (
            *self._changed(motion),
            f"Move C, {via}, {self._mark(motion)} {end}{self._tail(motion)}",
        )

    def output(self, item: Output) -> Sequence[str]:
        """Set or Reset of an IO."""
        port = f"IO[{self.signals[item.signal]}]"
        return choose_line(item.value, f"Set {port}", f"Reset {port}")

    def wait(self, item: Wait) -> Sequence[str]:
        """Delay in ms."""
        return (f"Delay {round(item.seconds * 1000)}",)

    def comment(self, text: str) -> str:
        """A comment line. A final ` _` would join the next line, so it gets a point."""
        return f"' {text}." if f" {text}".endswith(" _") else f"' {text}"

    def print_force(self, item: Force) -> list[str]:
        """The lines of the template."""
        if item.newtons <= 0:
            self._pressing = None
            return [line.format(n=self.force_table) for line in self.force_off]
        self._pressing = _times(item.newtons, item.force_direction)
        return self._filled(self.force_on)

    def _changed(self, motion: MoveL | MoveC) -> list[str]:
        if self._pressing is None:
            return []
        wanted = _times(motion.force, motion.force_direction)
        if all(abs(a - b) <= _FORCE_STEP_N for a, b in zip(wanted, self._pressing, strict=True)):
            return []
        self._pressing = wanted
        return self._filled(self.force_change)

    def _filled(self, template: list[str]) -> list[str]:
        x, y, z = self._pressing or (0.0, 0.0, 0.0)
        values = zip(("x", "y", "z", "newtons"), (x, y, z, math.hypot(x, y, z)), strict=True)
        texts = {key: fixed(value, _NEWTON) for key, value in values}
        return [line.format(n=self.force_table, **texts) for line in template]

    def _mark(self, motion: Motion) -> str:
        passing = "P" if self.pass_mark == "P" else f"{int(motion.blend)}"
        return f"@{passing}" if motion.blend else "@0"

    def _tail(self, motion: Motion) -> str:
        if isinstance(motion, MoveL) and motion.turn:
            return f", Speed = {short(self._turning(motion), _PERCENT)}"
        if isinstance(motion, MoveJ) and motion.share:
            return f", Speed = {short(self._scaled(100 * motion.share), _PERCENT)}"
        if self.speed == "percent":
            return f", Speed = {short(self._percent(motion.speed), _PERCENT)}"
        mm_s = self._scaled(motion.speed)
        if self.mps == "m/s":
            return f", Speed = Mps({short(mm_s / 1000, _SPEED + 3)})"
        return f", Speed = Mps({short(mm_s, _SPEED)}{' * unit' if self._asks else ''})"

    def _target(self, pose: Pose, motion: Motion) -> str:
        figure = _figure(motion)
        return f"P({self._pose(pose)}, {-1 if figure is None else figure})"

    def _pose(self, pose: Pose) -> str:
        key = pose.rotation.tobytes()
        if key not in self._angles:
            self._angles[key] = ", ".join(
                fixed(math.degrees(v), _ANGLE) for v in compute_fixed_xyz(pose.rotation)
            )
        x, y, z = (fixed(v, self.decimals) for v in pose.origin)
        return f"{x}, {y}, {z}, {self._angles[key]}"

    def split(self, program: Program, printed: Iterable[Sequence[str]]) -> Sequence[Sequence[str]]:
        """The body after the first instructions that switch all off; these are in the settings."""
        return super().split(program, islice(printed, _count_off(program), None))

    def assemble(self, program: Program, parts: Sequence[Sequence[str]]) -> tuple[OutputFile, ...]:
        """One file; a body of more than `max_lines` lines becomes Subs that Main calls in turn."""
        name = self.program or derive(program.name)
        subs = _split(list(chain.from_iterable(parts)), self.max_lines)
        names = [f"{name[:50]}_part{i + 1}" for i in range(len(subs))] if len(subs) > 1 else []
        given, taken = ("(unit)", "(ByVal unit As Single)") if self._asks else ("", "")
        body = [f"Call {sub}{given}" for sub in names] or subs[0]
        lines = [*self.begin(program), *(_INDENT + line for line in body), *self.end(program)]
        for sub, content in zip(names, subs, strict=False):
            lines += [f"Sub {sub}{taken}", *(_INDENT + line for line in content), "End Sub"]
        longest = max(lines, key=len)
        if len(longest) > _LONGEST_LINE:
            raise Refused(
                self.name,
                -1,
                f"a line of {len(longest)} bytes, the controller takes {_LONGEST_LINE}",
                "shorten it",
            )
        return (OutputFile(name + self.suffix, "\n".join(lines) + "\n"),)

    @classmethod
    def cell(cls) -> Cell:
        """A VS-060 with a sheet of 200 x 150 mm flat in front of it, 150 mm above its base."""
        home = Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0)))
        work, tool = translation(300, -75, 150), translation(0, 0, 100)
        return Cell("DENSO VS-060", work, tool, home, robot="VS-060")

    def tolerance(self) -> Tolerance:
        """Half of the last digit; three angles add up in an orientation, and a force has steps."""
        degree = math.radians(0.51 * 10**-_ANGLE)
        per_digit = 10**-_SPEED if self.speed == "mps" else self.rated / 100 * 10**-_PERCENT
        share = 0.51 * 10 ** -(_PERCENT + 2)
        mm, force = 0.501 * 10**-self.decimals, 2 * _FORCE_STEP_N
        turn = math.radians(share * self.rated_turn)
        return Tolerance(mm, 3 * degree, degree, 0.51 * per_digit, force, 0.00051, turn, share)


def _count_off(program: Program) -> int:
    return len(list(takewhile(_is_off, program.body)))


def _is_off(item: Instruction) -> bool:
    if isinstance(item, Force):
        return item.newtons == 0
    return isinstance(item, Output) and item.value == 0


def _figure(motion: Motion) -> int | None:
    return (motion.posture or NO_POSTURE).figure


def _joints_reason(motion: MoveJ) -> str:
    if isinstance(motion.target, Pose) or len(motion.target.values) in (1, 2, 3, 5, 6, 7, 8):
        return ""
    remedy = "give a pose, or the angles of an arm that only turns"
    axes = counted(len(motion.target.values), "axis", "axes")
    return f"J() of {axes}: four-axis arms slide on axis 3, J() ends with 8; {remedy}"


def _times(newtons: float, press: Vec3) -> Vec3:
    return (newtons * press[0], newtons * press[1], newtons * press[2])


def _split(lines: list[str], limit: int) -> list[list[str]]:
    """Divide lines into runs of at most `limit`, if possible after a motion that stops.

    Only the second half of a run is searched for such a motion.
    """
    runs: list[list[str]] = []
    at = 0
    while limit and len(lines) - at > limit:
        ends = range(at + limit, at + limit // 2, -1)
        end = next((end for end in ends if "@0 " in lines[end - 1]), at + limit)
        runs.append(lines[at:end])
        at = end
    return [*runs, lines[at:]]
