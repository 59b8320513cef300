"""The limits of V+: names, options, axes, poses, and values that a signal cannot carry."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Literal

import numpy as np

from camgen.model.errors import JobError, Refused
from camgen.model.pose import FloatArray, Pose, Vec3, compute_zyz
from camgen.model.program import (
    Force,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Stop,
    Wait,
    motions,
)
from camgen.model.text import counted

Posture = Literal["LEFTY", "RIGHTY", "ABOVE", "BELOW", "FLIP", "NOFLIP", "SINGLE", "MULTIPLE"]
#: Which posture word excludes which, and which only a six-axis arm has.
_PAIRS = (("LEFTY", "RIGHTY"), ("ABOVE", "BELOW"), ("FLIP", "NOFLIP"), ("SINGLE", "MULTIPLE"))
_SIX_AXIS_ONLY = frozenset({"ABOVE", "BELOW", "FLIP", "NOFLIP"})
#: Names longer than this collide silently.
_NAME = 15
_IDENTIFIER = re.compile(r"[a-z][a-z0-9._]*", re.IGNORECASE)
#: Words that must not name a program or a location.
_WORDS = """
    abort above abs accel aio.in aio.out align all alter altoff alton always and any appro
    appros as asc atan2 attach auto base bcd below belt bitand bits bmask brake break bstat by
    calibrate call calls case chr clear.event close closei clr.event coarse config cos cp cpoff cpon
    cycle.end dblb dcb decompose def.dio defbelt delay depart departs dest detach device din
    disable distance do drive duration dx dy dz else enable end error execute exit false fclose
    fcmnd fdelete fdirectory fempty fine flip fltb fopen fopena fopend fopenr fopenw for force
    fract frame free fseek fset garc gchain gclear gclip gcolor gcopy getc getevent gflood
    ggetline gicon gline glines global glogical gmode goto gpanel gpoint grectangle gscan gslide
    gtexture gtrans gtype halt hand here hour.meter id if ignore inrange install int int.event
    intb integrate intoff inton inverse ioget ioput iostat iotas ips jhere jmove jog keymode
    kill lasterr latch latched lefty len lngb local lock max mc mcs mid min mmps mod module
    monitor move movec movef moves movesc movesf movest movet msg multiple nest network next
    noflip nonull noop nooverlap normal not null off on open openi or outside overlap pack
    parameter pause payload pdnt.clear pdnt.notify pdnt.write pendant pi pos ppoint priority
    proceed prog.start program prompt random react reacte reacti read ready real relax relaxi
    reset retry return returne righty robot robot.opr runsig rx ry rz scale see select set
    set.event setbelt setdevice shift sig sig.ins sign signal sin single solve.angles
    solve.flags solve.trans speed sqr sqrt state status step stop strdif struct switch system
    tan tas task then time timer to tool tps trans transb true truncate type unidirect unpack
    until val value vautothr vcorrelate vdef.aoi vdef.grip vdisplay vedge vfeature vlast vlocate
    vparameter vpicture vplan vqueue vrecall vresult vruler vrun vselect vshow vstate vstore
    vsubmit vtrain vwait vwindow wait wait.event while window world write xor
"""
_TAKEN = frozenset(_WORDS.split())
#: rad: a pitch nearer to 0 or 180 deg prints as exactly that. It is the rounding of an upright tool
#: by joint values with four digits (deg), and the tolerance of the read-back.
_UPRIGHT = math.radians(5e-4)
#: V+ reals are single precision: beyond 8192 mm (2**13) their step is larger than 0.0005 mm.
_RANGE = 8192.0
#: Digits of speeds, and the smallest speed that these print within 0.1 %.
SPEED_DIGITS, _MIN_SPEED = 4, 0.05
#: The index of a refusal that concerns the whole program.
WHOLE = -1


def bad_name(name: str) -> str:
    """Return why `name` cannot be a V+ name; empty if it can."""
    if not _IDENTIFIER.fullmatch(name):
        return "is not a letter followed by letters, digits, dots and underscores"
    if len(name) > _NAME:
        return f"is longer than {_NAME} characters, of which V+ ignores the rest"
    return "is a word of V+" if is_word(name) else ""


def is_word(name: str) -> bool:
    """Whether a name is a word of V+."""
    return name.lower() in _TAKEN


def check_names(program: str, tool: str, work: str) -> None:
    """Check names. Raises JobError for one that V+ does not allow or distinguish from another one.

    An empty program name is not a name yet.
    """
    for key, value in (("program", program), ("tool", tool), ("work", work)):
        reason = "" if key == "program" and not value else bad_name(value)
        if not reason and re.search(r"\.\d+$", value):
            reason = "ends like the parts of a long program"
        if reason:
            raise JobError(f"[post] {key}", f"{value!r} {reason}", remedy="give another name")
    if len({program.lower(), tool.lower(), work.lower()}) < 3:
        key = "[post] program, tool, work"
        raise JobError(key, "have the same name", remedy="give three names")


def program_name(name: str, parts: int, used: Sequence[str]) -> str:
    """Make a V+ name of `name`, short enough for `.1` to `.parts` at its end.

    used: names that are in use.
    """
    room = _NAME - len(f".{parts}") if parts else _NAME
    clean = re.sub(r"[^a-z0-9._]", "_", name.lower())
    clean = clean[:room].rstrip("._")
    if not clean or bad_name(clean) or clean in {u.lower() for u in used}:
        clean = f"p_{clean}"[:room].rstrip("._")
    return clean


def check_signals(signals: Mapping[str, int]) -> None:
    """Check signals. Raises JobError for a number that is not an output, or is used twice."""
    seen: dict[int, str] = {}
    for signal, number in signals.items():
        if not (1 <= number <= 1000 or 2001 <= number <= 9999):
            raise JobError(
                "[post] signals",
                f"{signal} cannot be {number}",
                remedy="outputs are 1 to 1000, soft signals 2001 and up, "
                "and 1001 to 2000 are inputs",
            )
        if number in seen:
            raise JobError(
                "[post] signals",
                f"{seen[number]} and {signal} are both {number}",
                remedy="give each its own number",
            )
        seen[number] = signal


def check_posture(words: Sequence[str]) -> None:
    """Check postures. Raises JobError for unknown, repeated and contradictory words."""
    for word in words:
        pair = next((p for p in _PAIRS if word in p), None)
        if pair is None:
            raise JobError(
                "[post] posture",
                f"{word!r} is not a posture",
                remedy=f"known are {', '.join(chain.from_iterable(_PAIRS))}",
            )
        if sum(w in pair for w in words) > 1:
            raise JobError(
                "[post] posture",
                f"{pair[0]} and {pair[1]} are one choice",
                remedy="give one of them, once",
            )


def last_switches(part: Sequence[str], before: list[str]) -> list[str]:
    """Return the lines of the posture in force after `part`; `before` was in force at its start."""
    known = set(chain.from_iterable(_PAIRS))
    last = next((k for k in reversed(range(len(part))) if part[k].strip() in known), None)
    if last is None:
        return before
    first = last
    while first and part[first - 1].strip() in known:
        first -= 1
    return list(part[first : last + 1])


def check_arm(words: Sequence[str], program: Program) -> None:
    """Check the posture of a SCARA.

    Raises JobError for a posture that it does not have, or that its first position contradicts:
    joint 2 > 0 is RIGHTY.
    """
    odd = ", ".join(sorted(_SIX_AXIS_ONLY.intersection(words)))
    if odd:
        raise JobError(
            "[post] posture", f"{odd}: a SCARA has no such posture", remedy="give LEFTY or RIGHTY"
        )
    first = next((m.target for _, m in motions(program.body)), None)
    if isinstance(first, Joints) and first.values[1] != 0:
        wrong = "LEFTY" if first.values[1] > 0 else "RIGHTY"
        if wrong in words:
            angle = math.degrees(first.values[1])
            raise JobError(
                "[post] posture",
                f"{wrong}, but the first position has joint 2 at {angle:.4g} deg",
                remedy="RIGHTY goes with joint 2 > 0, LEFTY with joint 2 < 0",
            )


def axes(program: Program, post: str) -> int:
    """Return the number of joints: 4 (SCARA, joint 3 slides), 6, or 0 if no motion states it.

    Raises Refused for other numbers, and for several ones.
    """
    count = 0
    for index, motion in motions(program.body):
        joints = motion.target if isinstance(motion.target, Joints) else motion.joints
        if joints is None:
            continue
        what = f"a position has {counted(len(joints.values), 'joint value')}"
        if len(joints.values) not in (4, 6):
            raise Refused(post, index, what, "give 4 values (SCARA: deg, deg, mm, deg) or 6 (deg)")
        if count and len(joints.values) != count:
            raise Refused(post, index, f"{what}, another {count}", "give all for one arm")
        count = len(joints.values)
    return count


def unprintable(pose: Pose) -> str:
    """Return why single precision cannot carry the position, with the remedy; empty if it can."""
    x, y, z = pose.origin
    if -_RANGE <= x <= _RANGE and -_RANGE <= y <= _RANGE and -_RANGE <= z <= _RANGE:
        return ""
    return (
        f"at ({x:g}, {y:g}, {z:g}) mm is beyond {_RANGE:g} mm, where a V+ real is too coarse; "
        "move the origin nearer"
    )


def bad_orientation(rotation: FloatArray, scara: tuple[FloatArray, FloatArray] | None) -> str:
    """Return why the arm cannot take the rotation work_from_tool; empty if it can.

    scara: the rotations of base_from_work and flange_from_tool for a SCARA, otherwise None.
    """
    if not np.isfinite(rotation).all():
        return "an orientation is not finite; give another one"
    if scara is None:
        return ""
    base_from_work, flange_from_tool = scara
    axis = (base_from_work @ rotation @ flange_from_tool.T)[:, 2]
    tilt = math.atan2(math.hypot(axis[0], axis[1]), -axis[2])
    if tilt < _UPRIGHT:
        return ""
    return (
        "a SCARA cannot tilt its tool, "
        f"and this pose is {math.degrees(tilt):.4g} deg from straight down; "
        "check cell.base_from_work and cell.flange_from_tool, or use a six-axis robot"
    )


def yaw_pitch_roll(rotation: FloatArray) -> Vec3:
    """Compute ZYZ angles, rad; yaw is 0 if the pitch prints as 0 or 180 deg, as a SCARA needs."""
    if math.hypot(rotation[0, 2], rotation[1, 2]) >= _UPRIGHT:
        return compute_zyz(rotation)
    if rotation[2, 2] > 0:
        return (0.0, 0.0, math.atan2(rotation[1, 0], rotation[0, 0]))
    return (0.0, math.pi, math.atan2(rotation[1, 0], rotation[1, 1]))


def bad_speed(motion: MoveJ | MoveL, rated: float) -> str:
    """Return why SPEED cannot state the speed, with the remedy; empty if it can.

    rated: speed of a MOVE at 100 %, mm/s.
    """
    if isinstance(motion, MoveL):
        if motion.speed >= _MIN_SPEED:
            return ""
        return (
            f"{motion.speed:.4g} mm/s is below {_MIN_SPEED} mm/s, "
            "the least that prints exactly; raise process.feed"
        )
    percent = 100 * motion.speed / rated
    what = f"{motion.speed:.6g} mm/s is {percent:.4g} % of post.rated = {rated:g} mm/s"
    if percent > 100 + 1e-9:
        return f"{what}, more than 100 %; lower process.travel or raise post.rated"
    if percent < _MIN_SPEED:
        return (
            f"{what}, below the least that prints exactly, "
            f"{_MIN_SPEED} %; raise process.travel or lower post.rated"
        )
    return ""


def bad_pause(item: Wait | Stop) -> str:
    """Return why V+ cannot wait or stop so; empty if it can."""
    if isinstance(item, Stop):
        return "V+ has no optional stop; leave it out, or make it a stop" if item.optional else ""
    if item.seconds < 0.001:
        return (
            f"a wait of {item.seconds:g} s cannot be written; leave it out or wait 0.001 s or more"
        )
    return ""


def bad_turn(turn: float, rated: float) -> str:
    """Return why a reorientation at `turn` rad/s cannot be printed; empty if it can.

    rated: speed at 100 %, deg/s.
    """
    degrees, percent = math.degrees(turn), 100 * math.degrees(turn) / rated
    if percent > 100 + 1e-9:
        return (
            f"{degrees:g} deg/s is more than post.rated_turn = {rated:g} deg/s; "
            "lower process.turn or raise post.rated_turn"
        )
    if turn and percent < _MIN_SPEED:
        return (
            f"{degrees:g} deg/s is {percent:.3g} % of post.rated_turn = {rated:g} deg/s, "
            f"below the least that prints exactly, {_MIN_SPEED} %; "
            "raise process.turn or lower post.rated_turn"
        )
    return ""


def by_hand(program: Program, force: str, spindle: str, post: str) -> tuple[str, ...]:
    """Make remarks about values that the operator sets by hand, since an output is on or off.

    Raises Refused if such a value is not the same in the whole program.
    """
    remarks = []
    newtons, rpm = _find_forces(program), _find_spindle_speeds(program)
    if newtons and force == "ignore":
        remarks.append(
            f"the force of the plan, up to {max(newtons):g} N, is left out by force = ignore"
        )
    elif newtons and force == "signal":
        value = _get_only_value(newtons, "N", post)
        remarks.append(f"set {value} by hand at the valve of the output named force")
    if rpm and spindle == "on-off":
        value = _get_only_value(rpm, "rpm", post)
        remarks.append(f"set {value} by hand at the drive of the output named spindle")
    return tuple(remarks)


def _find_forces(program: Program) -> dict[float, int]:
    first: dict[float, int] = {}
    for index, item in enumerate(program.body):
        if isinstance(item, (Force, MoveL, MoveC)):
            value = item.newtons if isinstance(item, Force) else item.force
            if value > 0:
                first.setdefault(value, index)
    return first


def _find_spindle_speeds(program: Program) -> dict[float, int]:
    first: dict[float, int] = {}
    for index, item in enumerate(program.body):
        if isinstance(item, Output) and item.signal == "spindle" and item.value > 0:
            first.setdefault(item.value, index)
    return first


def _get_only_value(values: Mapping[float, int], unit: str, post: str) -> str:
    first = next(iter(values))
    for value, index in values.items():
        if not math.isclose(value, first, rel_tol=1e-6):
            raise Refused(
                post,
                index,
                f"a signal is on or off, and the program asks for {first:g} and {value:g} {unit}",
                "plan one value for the whole program",
            )
    return f"{first:g} {unit}"
