"""The instructions of a program, frozen values that a body of a hundred thousand can hold.

A signal is a name, an arc is two poses: how a controller spells them is its post's. A posture is a joint solution; what
controllers call it follows from the geometry of the arm (``robots.posture``), which posts do not know.
"""

from __future__ import annotations

from msgspec import Struct

from camgen.model.pose import Pose


class Joints(Struct, frozen=True, gc=False):
    """Controller joint values: rad for revolute, mm for sliding joints, axis 1 first."""

    values: tuple[float, ...]


class Posture(Struct, frozen=True, gc=False, omit_defaults=True):
    """What controllers call the posture in which the arm stands at the target; what is not known for sure is left out.

    confdata: ABB's cf1, cf4, cf6, cfx. figure: DENSO's Fig. switches: the words of V+, for all motions of a program or
    for none, since they stay in force.
    """

    confdata: tuple[int, int, int, int] | None = None
    figure: int | None = None
    switches: tuple[str, ...] = ()


class Origin(Struct, frozen=True):
    """What a motion is there for: the path ``id``, which works on ``contours`` (ids of contours, or of one edge) of
    ``layer`` by ``operation``.
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
    joints, posture: of the arm at a target that is a pose, where a robot is known.
    path, work: see `MoveL`.
    share: share of the joints' speeds at which the TCP keeps to `speed`; 0: not known.
    rate: speed of the turning joint with the longest travel, rad/s, at that share; 0: not known.
    turn: limit of the speed at which the tool turns, rad/s; 0: none of its own. It is set where the
        TCP hardly moves, so that its speed limits nothing.
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
    """Straight line of the TCP. target: work_from_tcp. blend: radius in mm within which the corner may be rounded, 0 =
    exact stop. force: N to press with during this motion, while a ``Force`` is on. force_direction: its direction at
    the target, unit vector in the work frame from the tool towards the surface. path: place in ``Program.paths`` of the
    one that this motion belongs to, the ways there and up from it included, -1: none. work: it runs along that path.
    turn: rad/s at which the tool turns where the TCP stays in its place, which ``speed`` does not limit; 0: the TCP
    travels.
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
    """Arc of the TCP from where it is through ``via`` (half-way) to ``target``, at most half a circle."""

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
    """Sets a named signal. value: 0 off, 1 on; for ``spindle`` its speed in rpm."""

    signal: str
    value: float


class Wait(Struct, frozen=True, gc=False):
    """Stands still for so many seconds."""

    seconds: float


class Force(Struct, frozen=True, gc=False):
    """Force control on, pressing with ``newtons`` along ``force_direction`` (unit, work frame) from the next motion on;
    0 N: off, and the next motion leaves the surface.
    """

    newtons: float
    force_direction: tuple[float, float, float] = (0.0, 0.0, 0.0)


class ToolChange(Struct, frozen=True):
    """Another tool from here on, with all outputs off and the machine at home. number: in the machine's tool table.
    diameter, length: mm. flange_from_tool: its frame; None: the program's.
    """

    number: int
    name: str = ""
    diameter: float = 0.0
    length: float = 0.0
    flange_from_tool: Pose | None = None


class Stop(Struct, frozen=True, gc=False):
    """Stands still until the operator lets it go on. optional: only where the operator's switch says so."""

    optional: bool = False


class Comment(Struct, frozen=True, gc=False):
    """A remark for whoever reads the program; posts clean it."""

    text: str


Motion = MoveJ | MoveL | MoveC
Instruction = MoveJ | MoveL | MoveC | Output | Wait | Force | ToolChange | Stop | Comment
