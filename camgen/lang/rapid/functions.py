"""The values of RAPID's functions (technical reference manual): poses, numbers, texts, inputs.

A function of the program runs. The value of a function that is in none of the files, or that
depends on the controller, is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from camgen.lang.values import Unknown
from camgen.model.pose import (
    IDENTITY,
    Pose,
    compute_fixed_xyz,
    compute_quaternion,
    frozen,
    rotation_about,
    rotation_from_quaternion,
    to_vec3,
)

from .machine import Machine
from .places import encode_pose, pose_of, see_here, see_joints, shift_placed, turn_placed
from .tokens import Wrong
from .tree import Calling, Element, Expr, Maybe, Ref
from .values import NOTHING, RelativeTarget, Value, find_unknown, format_type, operate


def call_function(machine: Machine, call: Calling) -> Value:
    """The value of a function call. Raises Wrong if a controller cannot evaluate it."""
    routine = machine.routine(call.name)
    if routine is not None:
        return machine.call(routine, call)
    special = SPECIAL.get(call.name)
    if special is not None:
        return special(machine, call)
    values = [machine.value(arg) for arg in call.args]
    function = _PLAIN.get(call.name)
    if function is None:
        if call.name not in _UNKNOWN:
            what = f"{call.name} is in none of the files: what it gives is not known"
            machine.log.assume(what, call.name)
        return machine.ask_for(f"{call.name}()", call.name)
    unknown = find_unknown(values)
    if unknown is not None:
        return unknown
    if call.options:
        function = _WITH_OPTION.get((call.name, *sorted(name for name, _ in call.options)))
        values += [machine.value(value) for name, value in call.options if value is not None]
    if function is None or find_unknown(values) is not None:
        option = f"{call.name} with \\{call.options[0][0]}"
        machine.log.leave_out(f"{option} is not evaluated: what it gives is not known")
        return Unknown(f"{call.name}()")
    try:
        return function(*values)
    except (
        TypeError,
        ValueError,
        IndexError,
        KeyError,
        OverflowError,
        ZeroDivisionError,
        AttributeError,
        np.linalg.LinAlgError,
    ):
        types = ", ".join(map(format_type, values)) or "nothing"
        raise machine.wrong(f"{call.name} of {types}") from None


# Poses -------------------------------------------------------------------------------------------


def _offs(machine: Machine, call: Calling) -> Value:
    values = [machine.value(arg) for arg in call.args]
    if len(values) != 4 or not isinstance(values[0], (tuple, Unknown)):
        raise machine.wrong("Offs has a robtarget and three numbers")
    point, *shift = values
    machine.fit("robtarget", point)
    if isinstance(point, RelativeTarget) and all(type(v) is float for v in shift):
        return shift_placed(point, shift)
    if isinstance(point, Unknown):
        return find_unknown(point)
    if isinstance(point[0], Unknown):
        return point
    return (tuple(_add(machine, a, b) for a, b in zip(point[0], shift, strict=True)), *point[1:])


def _add(machine: Machine, a: Value, b: Value) -> Value:
    if isinstance(a, Unknown) or isinstance(b, Unknown):
        return a if isinstance(a, Unknown) else b
    if type(a) is not float or type(b) is not float:
        raise machine.wrong(f"{format_type(a)} + {format_type(b)}")
    return a + b


def _reltool(machine: Machine, call: Calling) -> Value:
    values = [machine.value(arg) for arg in call.args]
    if len(values) != 4:
        raise machine.wrong("RelTool has a robtarget and three numbers")
    turns = {name: machine.value(value) for name, value in call.options if is_given(machine, value)}
    machine.fit("robtarget", values[0])
    point, x, y, z = values
    unknown = find_unknown([x, y, z, *turns.values()])
    if not isinstance(point, RelativeTarget):
        unknown = find_unknown(point) or unknown
    if unknown is not None:
        return unknown
    if not isinstance(point, (tuple, RelativeTarget)) or not all(
        type(v) is float for v in (x, y, z)
    ):
        raise machine.wrong("RelTool has a robtarget and three numbers")
    rotation = IDENTITY
    for axis, name in enumerate(("rx", "ry", "rz")):
        if type(turns.get(name)) is float:
            rotation = frozen(rotation @ rotation_about(axis, math.radians(turns[name])))
    displacement = Pose(rotation, (x, y, z))
    if isinstance(point, RelativeTarget):
        return turn_placed(point, displacement)
    return (*encode_pose(pose_of(machine, point) @ displacement), *point[2:])


def is_given(machine: Machine, value: Expr | None) -> bool:
    """False if an argument hands on an optional parameter that was not given."""
    if not isinstance(value, Maybe):
        return True
    variable = machine.variable(value.name)
    return variable is not None and variable.storage != "absent"


def _joints_here(machine: Machine, _call: Calling) -> Value:
    if machine.position.joints is None:
        machine.log.assume("CJointT: the joints where the arm is are not known", "")
        return Unknown("CJointT()")
    return (machine.position.joints, (9e9,) * 6)


def _robot_of_joints(machine: Machine, call: Calling) -> Value:
    """The robtarget at joint values, unknown without a model of the arm (CalcRobT)."""
    joints = machine.value(call.args[0]) if len(call.args) == 2 else NOTHING
    known = isinstance(joints, tuple) and len(joints) == 2 and find_unknown(joints[0]) is None
    if isinstance(joints, tuple) and known and machine.displaced is None:
        pose = see_joints(machine, joints[0], call.args[1], dict(call.options).get("wobj"))
        if pose is not None:
            return (*encode_pose(pose), (0.0,) * 4, joints[1])
    return _need_arm(machine, call)


def _need_arm(machine: Machine, call: Calling) -> Value:
    machine.log.assume(f"{call.name} needs the arm: what it gives is not known", "")
    return Unknown(f"{call.name}()")


def _frame_of_points(p1: Value, p2: Value, p3: Value, origin: float = 1.0) -> Value:
    """The frame whose x axis leads from the first position to the second (DefFrame).

    origin: 1 for the first position, 2 for the second, 3 for the foot of the third on the x axis.
    """
    a, b, c = (
        np.array(p[0] if isinstance(p[0], tuple) else p, dtype=np.float64) for p in (p1, p2, p3)
    )
    x = (b - a) / np.linalg.norm(b - a)
    z = np.cross(x, c - a)
    z = z / np.linalg.norm(z)
    rotation = frozen(np.column_stack([x, np.cross(z, x), z]))
    place = {1.0: a, 2.0: b, 3.0: a + x * float(x @ (c - a))}[origin]
    return encode_pose(Pose(rotation, to_vec3(place)))


def _pose(value: Value) -> Pose:
    return Pose(rotation_from_quaternion(value[1]), value[0])


def _orient_zyx(z: float, y: float, x: float) -> Value:
    matrix = (
        rotation_about(2, math.radians(z))
        @ rotation_about(1, math.radians(y))
        @ rotation_about(0, math.radians(x))
    )
    return compute_quaternion(frozen(matrix))


def _euler(machine: Machine, call: Calling) -> Value:
    """The angle of R = Rz Ry Rx that the switch of EulerZYX names, deg."""
    turn = machine.value(call.argument(0))
    if find_unknown(turn) is not None:
        return find_unknown(turn)
    names = [name for name, _ in call.options]
    if (
        not isinstance(turn, tuple)
        or len(turn) != 4
        or not names
        or names[0] not in ("x", "y", "z")
        or not any(turn)
    ):
        raise machine.wrong("EulerZYX has \\X, \\Y or \\Z, and an orientation")
    return math.degrees(compute_fixed_xyz(rotation_from_quaternion(turn))["xyz".index(names[0])])


def _normalise(turn: Value) -> Value:
    norm = math.sqrt(sum(v * v for v in turn))
    return tuple(v / norm for v in turn)


# Inputs ------------------------------------------------------------------------------------------


def name_of(machine: Machine, expr: Expr | None) -> str:
    """The name of the signal that an argument denotes, directly or through a parameter."""
    if isinstance(expr, Ref):
        variable = machine.variable(expr.name)
        if variable is not None:
            value = machine.load(variable)
            if variable.storage == "parameter" and isinstance(value, Unknown) and value.key:
                return value.what
        return expr.name
    if isinstance(expr, Element):
        return name_of(machine, expr.base)
    return "" if expr is None else "a signal"


def _signal(machine: Machine, call: Calling) -> Value:
    return machine.read_signal(name_of(machine, call.argument(0)))


def _test_input(machine: Machine, call: Calling) -> Value:
    value = _signal(machine, call)
    return value if isinstance(value, Unknown) else value != 0


# Texts -------------------------------------------------------------------------------------------


def _number_text(value: float, digits: float, *_: Value) -> str:
    return f"{value:.{max(0, min(15, int(digits)))}f}"


def _value_text(value: Value) -> str:
    if type(value) is bool:
        return str(value).upper()
    if type(value) is float:
        return f"{value:.6G}"
    if isinstance(value, (tuple, list)):
        return f"[{','.join(map(_value_text, value))}]"
    return f'"{value}"'


def _part_of(text: str, start: float, length: float) -> str:
    if not 1 <= start <= len(text) or length < 0 or start - 1 + length > len(text):
        raise ValueError(text)
    return text[int(start) - 1 : int(start) - 1 + int(length)]


def _find(text: str, start: float, characters: str, *, is_in: bool = True) -> float:
    """The place, from 1, of the first character in a set (StrFind); without one length + 1.

    is_in: False for the first character that is not in the set (NotInSet).
    """
    indices = (k for k in range(int(start) - 1, len(text)) if (text[k] in characters) == is_in)
    return float(next(indices, len(text)) + 1)


def _match(text: str, start: float, pattern: str) -> float:
    place = text.find(pattern, int(start) - 1)
    return float(place + 1 if place >= 0 else len(text) + 1)


def _map(text: str, old: str, new: str) -> str:
    return text.translate({ord(a): b for a, b in zip(old, new, strict=False)})


def _number_of_text(machine: Machine, call: Calling) -> Value:
    """Assign the value of a text to the second argument; whether it has one (StrToVal)."""
    text = machine.value(call.argument(0))
    if len(call.args) != 2:
        raise machine.wrong("StrToVal has a string and a variable")
    if not isinstance(text, str):
        machine.assign(call.args[1], text if isinstance(text, Unknown) else NOTHING)
        return text if isinstance(text, Unknown) else False
    value = _read_value(text)
    if value is None:
        return False
    machine.assign(call.args[1], value)
    return True


def _read_value(text: str) -> Value:
    from .expressions import Calls  # noqa: PLC0415 (for this function alone)

    try:
        parser = Calls(text, 0)
        value = parser.primary(0)
    except Wrong:
        return None
    return value if parser.token[0] == "end" and _is_plain(value) else None


def _is_plain(value: Value) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_plain, value))
    return isinstance(value, (float, bool, str))


# Parameters, arrays and numbers ------------------------------------------------------------------


def _present(machine: Machine, call: Calling) -> Value:
    if len(call.args) != 1 or not isinstance(call.args[0], Ref):
        raise machine.wrong("Present has the name of a parameter")
    variable = machine.variable(call.args[0].name)
    return variable is not None and variable.storage != "absent"


def _dimension(machine: Machine, call: Calling) -> Value:
    if len(call.args) != 2:
        raise machine.wrong("Dim has an array and a number")
    value, which = machine.value(call.args[0]), machine.number(call.args[1])
    if isinstance(which, Unknown) or isinstance(value, Unknown):
        return which if isinstance(which, Unknown) else value
    for _ in range(int(which) - 1 if 0 < which < 4 else 0):
        value = value[0] if isinstance(value, list) and value else None
    return float(len(value)) if isinstance(value, list) else 0.0


def _rounded(machine: Machine, call: Calling) -> Value:
    value = machine.number(call.argument(0))
    digits = next((machine.number(v) for name, v in call.options if name == "dec"), 0.0)
    unknown = find_unknown((value, digits))
    if unknown is not None:
        return unknown
    scale = 10.0 ** max(0.0, min(15.0, digits))
    if call.name.startswith("trunc"):
        return math.trunc(value * scale) / scale
    return math.floor(value * scale + 0.5) / scale


def _degrees(function: Callable[[float], float]) -> Callable[[float], float]:
    return lambda value: math.degrees(function(value))


def _radians(function: Callable[[float], float]) -> Callable[[float], float]:
    return lambda value: function(math.radians(value))


def _bits(function: Callable[[int, int], int]) -> Callable[[float, float], float]:
    return lambda a, b: float(function(int(a), int(b)))


#: Bits of a whole number in a dnum.
_DNUM = 2**52 - 1
#: Functions that get their arguments as expressions, and the machine.
SPECIAL: dict[str, Callable[[Machine, Calling], Value]] = {
    "offs": _offs, "reltool": _reltool, "crobt": see_here, "cpos": see_here,
    "cjointt": _joints_here, "calcrobt": _robot_of_joints, "calcjointt": _need_arm,
    "eulerzyx": _euler, "strtoval": _number_of_text, "present": _present, "dim": _dimension,
    "testdi": _test_input,
    **dict.fromkeys(("round", "trunc", "rounddnum", "truncdnum"), _rounded),
    **dict.fromkeys(("dinput", "doutput", "ginput", "goutput", "ainput", "aoutput"), _signal),
    **dict.fromkeys(("ginputdnum", "goutputdnum", "pinput"), _signal),
}  # fmt: skip
#: Functions of the values of their arguments.
_PLAIN: dict[str, Callable[..., Value]] = {
    "abs": abs, "absdnum": abs, "sqrt": math.sqrt, "sqrtdnum": math.sqrt, "exp": math.exp,
    "pow": lambda a, b: float(a**b), "powdnum": lambda a, b: float(a**b),
    "sin": _radians(math.sin), "cos": _radians(math.cos), "tan": _radians(math.tan),
    "asin": _degrees(math.asin), "acos": _degrees(math.acos), "atan": _degrees(math.atan),
    "atan2": lambda y, x: math.degrees(math.atan2(y, x)),
    "sindnum": _radians(math.sin), "cosdnum": _radians(math.cos), "tandnum": _radians(math.tan),
    "asindnum": _degrees(math.asin), "acosdnum": _degrees(math.acos),
    "atandnum": _degrees(math.atan), "atan2dnum": lambda y, x: math.degrees(math.atan2(y, x)),
    "crossprod": lambda a, b: operate("*", a, b, 0), "numtodnum": float, "dnumtonum": float,
    "posemult": lambda a, b: encode_pose(_pose(a) @ _pose(b)),
    "poseinv": lambda a: encode_pose(_pose(a).inverse()),
    "posevect": lambda a, v: _pose(a).apply(v), "orientzyx": _orient_zyx, "norient": _normalise,
    "defframe": _frame_of_points, "distance": math.dist,
    "vectmagn": lambda v: math.sqrt(sum(x * x for x in v)),
    "dotprod": lambda a, b: float(sum(x * y for x, y in zip(a, b, strict=True))),
    "strlen": lambda text: float(len(text)), "strpart": _part_of, "strfind": _find,
    "strmatch": _match, "strmap": _map, "strorder": lambda a, b, *_: a <= b,
    "strmemb": lambda text, place, allowed: text[int(place) - 1] in allowed,
    "numtostr": _number_text, "dnumtostr": _number_text, "valtostr": _value_text,
    "bitand": _bits(int.__and__), "bitor": _bits(int.__or__), "bitxor": _bits(int.__xor__),
    "bitanddnum": _bits(int.__and__), "bitordnum": _bits(int.__or__),
    "bitxordnum": _bits(int.__xor__),
    "bitlsh": _bits(lambda a, b: (a << min(b, 64)) & 0xFF),
    "bitlshdnum": _bits(lambda a, b: (a << min(b, 64)) & _DNUM),
    **dict.fromkeys(("bitrsh", "bitrshdnum"), _bits(lambda a, b: a >> min(b, 64))),
    **dict.fromkeys(
        ("bitcheck", "bitcheckdnum"), lambda a, b: bool(int(a) >> (min(int(b), 64) - 1) & 1)
    ),
    "bitneg": lambda a: float(~int(a) & 0xFF), "bitnegdnum": lambda a: float(~int(a) & _DNUM),
    "gettaskname": lambda: "T_ROB1", "robos": lambda: False, "taskrunrob": lambda: True,
    "validio": lambda *_: True, "isfile": lambda *_: False, "opmode": lambda: 1.0,
    "runmode": lambda *_: 1.0,
}  # fmt: skip
#: Functions with an optional argument, which comes after the others.
_WITH_OPTION: dict[tuple[str, ...], Callable[..., Value]] = {
    ("defframe", "origin"): _frame_of_points, ("strfind", "notinset"): partial(_find, is_in=False),
    ("numtostr", "exp"): lambda value, digits: f"{value:.{max(0, min(15, int(digits)))}E}",
}  # fmt: skip
#: Functions whose values depend on the controller, its operator or its surroundings.
_UNKNOWN = frozenset(
    """
    argname bytetostr calcrotaxframez calcrotaxisframe camgetexposure camgetloadedjob camgetname
    camnumberofresults capgetfailsigs cdate clkread cnvdist corrread cspeedoverride ctime ctool
    cwobj dacheckmmsopt dagetfsttimeevt dagetmp dagetrobotname dagettaskname dectohex
    defaccframe defdframe egmgetstate eventtype exechandler execlevel fcgetforce
    fcgetprocessdata fcidentload fcisforcemode filesize filetime filetimednum fssize
    getaxisangle getaxisdistance getaxismovetime getmaxnumberofcyclicbool getmecunitname
    getmodalpayloadmode getmotortorque getnextcyclicbool getnextmechunit getnextsym
    getnumberofcyclicbool getserviceinfo getsignal getsignaldnum getsignalorigin getsysinfo
    gettime gettrapdata gettsistatus gettspstatus getuasusername getuasuserrights
    hand_getactualpos hextodec indexlookup indinpos indpos indspeed iounitstate ipscommand
    ipsgetparam isbrakecheckactive iscyclicbool isleadthrough ismechunitactive ispers
    isstopmoveact isstopstateevent issyncmoveon issysid istasksync isvar loadid
    maxextlinearspeed maxextreorientspeed maxrobreorientspeed maxrobspeed mirpos modexist
    modtime modtimednum motionplannerno orobt paintcommand paridposvalid paridrobvalid
    pathlengthget pathlevel pathrecvalidbwd pathrecvalidfwd pfrestart pmgratsafe pmgratservice
    pmgratstate pmgratstation pmgrnextstation pmgrtaskname pmgrtasknumber ppmovedinmanmode
    progmemfree prxgetmaxrecordpos quadr rawbyteslen readbin readcfgdata readdir readmotor
    readnum readstr readstrbin readvar remainingretries rmqgetslotname robname
    safetycontrollergetchecksum safetycontrollergetopmodepincode safetycontrollergetswversion
    safetycontrollergetuserchecksum socketgetstatus socketpeek stcalcforce stcalctorque
    stiscalib strformat stisclosed stisindgun stisopen strdigcalc strdigcmp strtobyte
    syncmoveison taskisactive taskisexecuting taskrunmec tasksinsync testandset testsignread
    textget texttabfreetoread texttabfreetouse texttabget triggdatavalid type uialphaentry
    uiclientexist uidnumentry uidnumtune uilistview uimessagebox uinumentry uinumtune
    """.split()  # noqa: SIM905 (a table)
)
