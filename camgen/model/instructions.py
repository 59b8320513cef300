"""The instructions of a program: small frozen values, of which a body may have a hundred thousand.

A signal is a name and an arc is two poses; the post decides how a controller spells them. A posture
is a joint solution. Its name on a controller follows from the geometry of the arm
(`robots.posture`), which posts do not know.
"""

from __future__ import annotations

from msgspec import Struct

from camgen.model.pose import Pose


class Joints(Struct, frozen=True, gc=False):
    """Joint values of the controller: rad for revolute, mm for sliding joints, axis 1 first."""

    values: tuple[float, ...]


class Posture(Struct, frozen=True, gc=False, omit_defaults=True):
    """Names that controllers give to the posture of the arm at a target; None or () if unknown.

    confdata: cf1, cf4, cf6 and cfx of ABB.
    figure: Fig of DENSO.
    switches: words of V+. Either all motions of a program have them or none, because they stay
        valid until the next ones.
    """

    confdata: tuple[int, int, int, int] | None = None
    figure: int | None = None
    switches: tuple[str, ...] = ()


#: The posture of a motion that states none.
NO_POSTURE = Posture()


class Origin(Struct, frozen=True):
    """The path to which motions belong.

    id: id of the path.
    layer: layer of the contours.
    contours: ids of the contours, or of one edge, on which the path works.
    operation: kind of the operation.
    """

    id: str
    layer: str = ""
    contours: tuple[str, ...] = ()
    operation: str = ""


class MoveJ(Struct, frozen=True, eq=False, gc=False):
    """A joint-interpolated motion.

    target: joint values, or pose of the TCP in the work frame.
    speed: limit of the speed of the TCP, mm/s.
    blend: radius, mm, within which the corner may be rounded; 0 is an exact stop.
    joints, posture: joint values and posture at a target that is a pose, if a robot is known.
    path: index in `Program.paths`, as in `MoveL`.
    work: True on the path itself, as in `MoveL`.
    share: fraction of the maximum joint speeds at which the TCP keeps to `speed`; 0: unknown.
    rate: speed of the revolute joint with the longest travel at that fraction, rad/s; 0: unknown.
    turn: limit of the speed at which the tool rotates, rad/s; 0 for no limit of its own. It is set
        if the TCP hardly moves, so that `speed` limits nothing.
    """

    target: Pose | Joints
    speed: float
    blend: float = 0.0
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False
    share: float = 0.0
    rate: float = 0.0
    turn: float = 0.0


class MoveL(Struct, frozen=True, eq=False, gc=False):
    """Linear motion of the TCP.

    target: work_from_tcp.
    speed: TCP speed, mm/s.
    blend: blend radius at the target, mm; 0 is an exact stop.
    force: contact force during this motion, N; needs a `Force` instruction before it.
    force_direction: direction of the force at the target, unit vector in the work frame, from the
        tool towards the surface.
    joints, posture: joint values and posture at the target, if a robot is known.
    path: index in `Program.paths` of the path to which the motion belongs, its approach and retract
        included; -1 for none.
    work: True on the path itself, False on its approach and retract.
    turn: speed of a reorientation at a fixed TCP, rad/s, which `speed` does not limit; 0 for any
        motion of the TCP.
    """

    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False
    turn: float = 0.0


class MoveC(Struct, frozen=True, eq=False, gc=False):
    """Circular motion of the TCP through `via`, half-way, to `target`; at most half a circle.

    The other fields are those of `MoveL`.
    """

    via: Pose
    target: Pose
    speed: float
    blend: float = 0.0
    force: float = 0.0
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joints: Joints | None = None
    posture: Posture | None = None
    path: int = -1
    work: bool = False


class Output(Struct, frozen=True, gc=False):
    """Sets a named signal.

    value: 0 off, 1 on; for "spindle" its speed, rpm.
    """

    signal: str
    value: float


class Wait(Struct, frozen=True, gc=False):
    """A pause of `seconds`, s."""

    seconds: float


class Force(Struct, frozen=True, gc=False):
    """Switches force control on or off.

    newtons: contact force from the next motion on, N. 0 switches force control off, and the next
        motion leaves the surface.
    force_direction: unit vector in the work frame, from the tool towards the surface.
    """

    newtons: float
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ToolChange(Struct, frozen=True):
    """Changes the tool, with all outputs off and the machine at home.

    number: number in the tool table of the machine.
    diameter, length: mm.
    flange_from_tool: tool frame; None for that of the program.
    """

    number: int
    name: str = ""
    diameter: float = 0.0
    length: float = 0.0
    flange_from_tool: Pose | None = None


class Stop(Struct, frozen=True, gc=False):
    """Stops until the operator continues.

    optional: stops only if the switch of the operator for optional stops is on.
    """

    optional: bool = False


class Comment(Struct, frozen=True, gc=False):
    """A remark for the reader of the program; posts remove unsafe characters from it."""

    text: str


Motion = MoveJ | MoveL | MoveC
Instruction = MoveJ | MoveL | MoveC | Output | Wait | Force | ToolChange | Stop | Comment
